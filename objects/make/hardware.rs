//! Machine parts: nut, bolt, screws, gear, brick.

use crate::basic::disc;
use crate::outline::{arc, circle, inset, moved, polar, rectangle};
use crate::solid::{P2, P3, Solid, at};
use crate::sweep::{Thread, revolve, ring, rise, round, sink};

/// A metric thread of 60 degrees: (fraction of the pitch, depth as a fraction of the pitch).
const METRIC: [P2; 3] = [[0.0, 0.0], [0.4, 0.55], [0.55, 0.55]];

/// An M6 nut, 10 mm across flats, corners turned off at 30 degrees, with its thread.
pub fn hexagon_nut() -> Solid {
    const HEIGHT_MM: f64 = 5.0;
    const BORE_MM: f64 = 3.35;
    let (around, bore) = (round(180), round(72));
    let mut solid = Solid::new();
    let [turned, top] = chamfered_hexagon(5.0, 4.75, HEIGHT_MM, &around);
    let under = |p: &P3| [p[0], p[1], HEIGHT_MM - p[2]];
    let foot: Vec<P3> = top.iter().map(under).collect();
    let low = turned.iter().map(under).collect();
    solid.loft(&[foot.clone(), low, turned, top.clone()]);
    let mouth = |z: f64| ring(BORE_MM, z, &bore);
    solid.cap_up(&flat(&top), &[flat(&mouth(0.0))], HEIGHT_MM);
    solid.cap_down(&flat(&foot), &[flat(&mouth(0.0))], 0.0);
    let (from_z, to_z, end_radius) = (0.25, HEIGHT_MM - 0.25, 3.1);
    let profile = METRIC.map(|[at, depth]| [at, end_radius - depth]);
    let thread = Thread { profile: &profile, pitch: 1.0, end_radius, from_z, to_z, degrees: &bore };
    solid.band(&mouth(HEIGHT_MM), &ring(end_radius, to_z, &bore));
    thread.inner(&mut solid);
    solid.band(&ring(end_radius, from_z, &bore), &mouth(0.0));
    solid
}

/// An M5 bolt with a hexagon head, lying as it would on a table: on its head and its tip.
pub fn bolt() -> Solid {
    const FLAT_MM: f64 = 4.0;
    const ROOT_MM: f64 = 2.06;
    const LENGTH_MM: f64 = 11.0;
    const PITCH_MM: f64 = 0.8;
    // The line through the edge of the head and the last full crest lies in the pad's plane.
    let slope = (FLAT_MM - ROOT_MM - 0.55 * PITCH_MM) / (LENGTH_MM - 0.6 * PITCH_MM);
    let length = (1.0 + slope * slope).sqrt();
    let (cos, sin) = (1.0 / length, slope / length);
    let mut solid = Solid::fine().turned([[-sin, 0.0, cos], [0.0, -1.0, 0.0], [cos, 0.0, sin]]);
    // Fine where the bolt faces the pad, direction 0.
    let near = (-16..16).map(|i| 3.75 * f64::from(i));
    let far = (0..16).map(|i| 60.0 + 15.0 * f64::from(i));
    let mut degrees: Vec<f64> = near.chain(far).map(|d| d.rem_euclid(360.0)).collect();
    degrees.sort_by(f64::total_cmp);
    let [turned, top] = chamfered_hexagon(FLAT_MM, 3.8, 3.5, &degrees);
    let below = |p: &P3| [p[0], p[1], -p[2]];
    solid.loft(&[
        top.iter().map(below).collect(),
        turned.iter().map(below).collect(),
        hexagon(FLAT_MM, 0.0, &degrees),
        ring(ROOT_MM, 0.0, &degrees),
    ]);
    let mut end = top.clone();
    end.reverse();
    solid.fan(&end.iter().map(below).collect::<Vec<_>>(), [0.0, 0.0, -3.5]);
    let profile = METRIC.map(|[at, depth]| [at, ROOT_MM + depth * PITCH_MM]);
    let thread = Thread {
        profile: &profile,
        pitch: PITCH_MM,
        end_radius: ROOT_MM,
        from_z: 0.0,
        to_z: LENGTH_MM,
        degrees: &degrees,
    };
    thread.outer(&mut solid);
    solid.band(&ring(ROOT_MM, LENGTH_MM, &degrees), &ring(1.7, LENGTH_MM + 0.3, &degrees));
    disc(&mut solid, 1.7, LENGTH_MM + 0.3, &degrees);
    solid
}

/// The pan head of an M4 machine screw with a cross recess, on a short shank.
pub fn phillips_screw() -> Solid {
    const WING_MM: f64 = 2.2;
    const HALF_WIDTH_MM: f64 = 0.45;
    const RIM_MM: f64 = 3.75;
    const ROUND_MM: f64 = 2.65;
    const DOME_MM: f64 = 7.5;
    let corner = libm::atan2(HALF_WIDTH_MM, WING_MM).to_degrees();
    let quarter = (0..8)
        .map(|i| corner * (f64::from(i) / 4.0 - 1.0))
        .chain((0..12).map(|i| corner + (90.0 - 2.0 * corner) * f64::from(i) / 12.0));
    let quarter: Vec<f64> = quarter.collect();
    let degrees: Vec<f64> = (0..4).flat_map(|k| quarter.iter().map(move |d| d + 90.0 * f64::from(k))).collect();
    // Radius of the cross, whose arms lie along x and y.
    let cross = |deg: f64| {
        let [x, y] = polar(1.0, deg).map(f64::abs);
        (WING_MM / x.max(y)).min(HALF_WIDTH_MM / x.min(y))
    };
    let top = 2.6;
    let dome = |r: f64| top + (DOME_MM * DOME_MM - r * r).sqrt() - DOME_MM;
    let lift = |radius: &dyn Fn(f64) -> f64, z: &dyn Fn(f64) -> f64| -> Vec<P3> {
        let point = |&deg: &f64| {
            let [x, y] = polar(radius(deg), deg);
            [x, y, z(radius(deg))]
        };
        degrees.iter().map(point).collect()
    };
    // The rim rounds into the dome where the dome falls by 30 degrees.
    let rim = polar(0.25, 60.0);
    let outer = |deg: f64, z: f64| ring(RIM_MM - rim[0] + polar(0.25, deg)[0], z, &degrees);
    let shoulder = |deg: f64| dome(RIM_MM) - rim[1] + polar(0.25, deg)[1];
    let mut loops = vec![ring(2.0, 0.0, &degrees), outer(0.0, 0.0)];
    loops.extend([0.0, 20.0, 40.0].map(|deg| outer(deg, shoulder(deg))));
    for i in 0..6 {
        let r = RIM_MM - (RIM_MM - ROUND_MM) * f64::from(i) / 5.0;
        loops.push(ring(r, dome(r), &degrees));
    }
    // Inside the last circle the loops take on the shape of the cross.
    for i in 1..=6 {
        let t = f64::from(i) / 6.0;
        let radius = |deg: f64| ROUND_MM + (cross(deg) + 0.07 - ROUND_MM) * t;
        loops.push(lift(&radius, &dome));
    }
    loops.push(lift(&cross, &|r| dome(r) - 0.07));
    let floor = lift(&|deg| 0.5 * cross(deg), &|_| top - 1.5);
    loops.push(floor.clone());
    let mut solid = Solid::fine();
    solid.loft(&loops);
    solid.fan(&floor, [0.0, 0.0, top - 1.8]);
    solid.band(&ring(2.0, -5.0, &degrees), &ring(2.0, 0.0, &degrees));
    let mut end = ring(2.0, -5.0, &degrees);
    end.reverse();
    solid.fan(&end, [0.0, 0.0, -5.0]);
    solid
}

/// The head of an M5 socket screw, hexagon recess of 4 mm, on a short shank.
pub fn socket_screw() -> Solid {
    let around = round(180);
    let mut solid = Solid::new();
    let profile = [[0.0, -4.0], [2.5, -4.0], [2.5, 0.0], [4.25, 0.0], [4.25, 4.65], [3.9, 5.0]];
    revolve(&mut solid, &profile, &around);
    let socket = circle([0.0, 0.0], 2.0 / 0.75f64.sqrt(), 0.0, 6);
    let mouth = inset(&socket, -0.15);
    let rim = flat(&ring(3.9, 0.0, &around));
    solid.cap_up(&rim, std::slice::from_ref(&mouth), 5.0);
    let floor = sink(&mut solid, &mouth, 5.0, &[[-0.15, 0.15], [-0.15, 2.4]]);
    solid.fan(&at(&floor, 2.6), [0.0, 0.0, 1.6]);
    solid
}

/// A spur gear of 18 involute teeth, module 0.7 mm, with a web, five holes and a keyed bore.
pub fn gear() -> Solid {
    const FACE_MM: f64 = 3.0;
    const WEB_MM: f64 = 2.2;
    let teeth = gear_outline(18, 0.7);
    let bore = keyed_bore(1.5, 0.35, 2.0);
    let hub = circle([0.0, 0.0], 2.5, 0.7, 80);
    let web = circle([0.0, 0.0], 4.7, 0.3, 120);
    let holes: Vec<Vec<P2>> =
        (0..5).map(|i| moved(&circle([0.0, 0.0], 0.75, 1.3, 30), polar(3.6, 72.0 * f64::from(i) + 18.0))).collect();
    let mut solid = Solid::new();
    let crown = rise(&mut solid, &teeth, 0.0, &[[0.0, FACE_MM - 0.12], [0.12, FACE_MM]]);
    solid.cap_up(&crown, std::slice::from_ref(&web), FACE_MM);
    let web_foot = sink(&mut solid, &web, FACE_MM, &[[-0.15, FACE_MM - WEB_MM]]);
    let hub_foot = inset(&hub, -0.15);
    let mut openings = holes.clone();
    openings.push(hub_foot.clone());
    solid.cap_up(&web_foot, &openings, WEB_MM);
    solid.band(&at(&hub_foot, WEB_MM), &at(&hub, FACE_MM));
    solid.cap_up(&hub, std::slice::from_ref(&bore), FACE_MM);
    sink(&mut solid, &bore, FACE_MM, &[[0.0, FACE_MM]]);
    let mut through = vec![bore];
    for hole in holes {
        sink(&mut solid, &hole, WEB_MM, &[[0.0, WEB_MM]]);
        through.push(hole);
    }
    solid.cap_down(&teeth, &through, 0.0);
    solid
}

/// A toy brick with two by two studs, hollow behind.
pub fn brick() -> Solid {
    const HALF_MM: f64 = 7.9;
    const BODY_MM: f64 = 9.6;
    const ROOF_MM: f64 = 8.4;
    let square = |half: f64| rectangle([-half, -half], [half, half]);
    let body = square(HALF_MM);
    let mut solid = Solid::new();
    let top = rise(&mut solid, &body, 0.0, &[[0.0, BODY_MM - 0.15], [0.15, BODY_MM]]);
    let studs: Vec<Vec<P2>> = [[-4.0, -4.0], [4.0, -4.0], [4.0, 4.0], [-4.0, 4.0]]
        .iter()
        .map(|&centre| circle(centre, 2.4, 0.6, 96))
        .collect();
    solid.cap_up(&top, &studs, BODY_MM);
    for stud in &studs {
        let steps = [[0.0, 1.62], [0.13, 1.75]];
        let rim = rise(&mut solid, stud, BODY_MM, &steps);
        solid.cap_up(&rim, &[], BODY_MM + 1.75);
    }
    let hollow = square(HALF_MM - 1.2);
    let tube = circle([0.0, 0.0], 3.25, 0.6, 40);
    let core = circle([0.0, 0.0], 2.4, 0.3, 40);
    solid.cap_down(&body, std::slice::from_ref(&hollow), 0.0);
    solid.cap_down(&tube, std::slice::from_ref(&core), 0.0);
    sink(&mut solid, &hollow, ROOF_MM, &[[0.0, ROOF_MM]]);
    rise(&mut solid, &tube, 0.0, &[[0.0, ROOF_MM]]);
    sink(&mut solid, &core, ROOF_MM, &[[0.0, ROOF_MM]]);
    solid.cap_down(&hollow, std::slice::from_ref(&tube), ROOF_MM);
    solid.cap_down(&core, &[], ROOF_MM);
    solid
}

fn flat(points: &[P3]) -> Vec<P2> {
    points.iter().map(|&[x, y, _]| [x, y]).collect()
}

fn hexagon_radius(flat: f64, deg: f64) -> f64 {
    flat / polar(1.0, deg - 60.0 * libm::round(deg / 60.0))[0]
}

fn hexagon(flat: f64, z: f64, degrees: &[f64]) -> Vec<P3> {
    let point = |&d: &f64| polar(hexagon_radius(flat, d), d);
    at(&degrees.iter().map(point).collect::<Vec<_>>(), z)
}

/// The loops where a cone of 30 degrees, starting at radius `circle` on top, leaves the flats, and
/// that circle.
fn chamfered_hexagon(flat: f64, circle: f64, height: f64, degrees: &[f64]) -> [Vec<P3>; 2] {
    let slope = 1.0 / 3f64.sqrt();
    let edge = degrees.iter().map(|&d| {
        let r = hexagon_radius(flat, d);
        let [x, y] = polar(r, d);
        [x, y, height - slope * (r - circle)]
    });
    [edge.collect(), ring(circle, height, degrees)]
}

fn keyed_bore(r: f64, half_key: f64, key_depth: f64) -> Vec<P2> {
    let edge = libm::asin(half_key / r).to_degrees();
    let mut outline = arc([0.0, 0.0], r, 90.0 + edge, 450.0 - edge, 60);
    outline.extend([[half_key, key_depth], [-half_key, key_depth]]);
    outline
}

fn gear_outline(teeth: usize, module: f64) -> Vec<P2> {
    const PRESSURE_ANGLE_DEG: f64 = 20.0;
    let pitch_radius = module * teeth as f64 / 2.0;
    let (root, tip) = (pitch_radius - 1.25 * module, pitch_radius + module);
    let base = pitch_radius * polar(1.0, PRESSURE_ANGLE_DEG)[0];
    let involute = |r: f64| {
        let a = libm::acos((base / r).min(1.0));
        (libm::tan(a) - a).to_degrees()
    };
    // Half the angle a tooth takes at radius r; below the base circle its flanks are radial.
    let half = |r: f64| 90.0 / teeth as f64 + involute(pitch_radius) - involute(r.max(base));
    let flank: Vec<f64> = (0..=4).map(|i| base + (tip - base) * f64::from(i) / 4.0).collect();
    let mut outline = Vec::new();
    for tooth in 0..teeth {
        let middle = 360.0 * tooth as f64 / teeth as f64;
        outline.push(polar(root, middle - half(root) - 1.0));
        outline.extend(flank.iter().map(|&r| polar(r, middle - half(r))));
        outline.push(polar(tip, middle));
        outline.extend(flank.iter().rev().map(|&r| polar(r, middle + half(r))));
        outline.push(polar(root, middle + half(root) + 1.0));
    }
    outline
}
