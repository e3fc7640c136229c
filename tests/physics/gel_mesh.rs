//! Gels that are meshes: against the same gel as a dome, a capsule or a flat pad, and what a mesh may be.

use gelsim::SensorExt;
use std::sync::Arc;

use gelsim::{Fidelity, Impression, Indenter, PadPlane, Pose, Sensor, Simulator};
use gelsim_core::base::chart::Chart;
use gelsim_core::base::gel::{GelCapsule, GelDome, GelShape};
use gelsim_core::base::gel_surface::geodesic_chart::GeodesicChart;
use gelsim_core::base::gel_surface::{GelSurface, GelSurfaceError};
use gelsim_core::base::view::View;
use gelsim_core::camera::pins::PinTip;
use gelsim_core::camera::projection::{LensModel, Pinhole};
use gelsim_core::depth::CaptureWindow;
use gelsim_core::depth::normal_capture::NormalCapture;
use gelsim_core::mesh::Mesh;
use gelsim_core::mesh::clusters::Clusters;
use glam::DVec3;

use super::curved_sequences::{pushed, slide, wrench};
use super::support::bundled_objects;
use gelsim_oracle::mesh_rays::first_met;
use gelsim_oracle::shapes::Shape;

/// A surface that is round about z: `profile` gives the distance from the axis and the height, from the tip (0) to the rim (1).
fn turned(meridians: usize, rings: usize, profile: impl Fn(f64) -> [f64; 2]) -> Shape {
    Shape::crossed_sheet(meridians, rings, |i, j| {
        let [away, z] = profile(j as f64 / rings as f64);
        let azimuth = std::f64::consts::TAU * (i % meridians) as f64 / meridians as f64;
        [away * azimuth.cos(), away * azimuth.sin(), z]
    })
}

fn dome(radius_mm: f64, meridians: usize, rings: usize) -> Shape {
    turned(meridians, rings, |share| {
        let angle = share * std::f64::consts::FRAC_PI_2;
        [radius_mm * angle.sin(), radius_mm * (angle.cos() - 1.0)]
    })
}

fn capsule(radius_mm: f64, length_mm: f64, meridians: usize, rings: usize) -> Shape {
    let quarter_mm = std::f64::consts::FRAC_PI_2 * radius_mm;
    let all_mm = quarter_mm + length_mm - radius_mm;
    turned(meridians, rings, |share| {
        let along_mm = share * all_mm;
        let angle = (along_mm / radius_mm).min(std::f64::consts::FRAC_PI_2);
        [radius_mm * angle.sin(), radius_mm * (angle.cos() - 1.0) - (along_mm - quarter_mm).max(0.0)]
    })
}

fn surface(shape: Shape) -> GelShape {
    let (mesh, _) = Mesh::new(shape.vertices, shape.triangles).expect("a mesh");
    let centre = DVec3::from_array(mesh.centre_mm);
    let points = mesh.vertices.iter().map(|vertex| DVec3::from_array(vertex.map(f64::from)) + centre).collect();
    GelShape::Mesh(Arc::new(GelSurface::new(points, mesh.triangles).expect("a gel's surface")))
}

fn ball(radius_mm: f64) -> Arc<Clusters> {
    Arc::new(Shape::ball_around_origin(radius_mm, 192, 96).clusters())
}

/// A lit gel without noise.
fn sensor(shape: GelShape, px: [usize; 2], behind_mm: f64, fov_deg: f64) -> Sensor {
    let mut sensor = Sensor::preset("geltip").expect("a preset");
    sensor.resolution_px = px;
    sensor.shape = Some(shape);
    let position_mm = [0.0, 0.0, -behind_mm];
    sensor.lens = LensModel::Pinhole(Pinhole { fov_deg, position_mm, look_at_mm: [0.0; 3] });
    sensor.camera.read_noise_levels = 0.0;
    sensor
}

fn press(simulator: &Simulator, like: &GelShape, ball_mm: f64, depth_mm: f64, at: [f64; 2]) -> Impression {
    let (axes, origin_mm) = like.frame_at(at[0], at[1]);
    let pose = Pose::from_quaternion([0.0, 0.0, 0.0, 1.0], [0.0, 0.0, ball_mm - depth_mm]).within(axes, origin_mm);
    simulator.press(&Indenter::clusters(ball(ball_mm), pose))
}

/// Levels by which two pictures differ: at the most, in all but a thousandth of the values, and on average.
fn levels(a: &[u8], b: &[u8]) -> (u8, u8, f64) {
    let mut off: Vec<u8> = a.iter().zip(b).map(|(a, b)| a.abs_diff(*b)).collect();
    off.sort_unstable();
    let mean = off.iter().map(|off| f64::from(*off)).sum::<f64>() / off.len() as f64;
    (off[off.len() - 1], off[off.len() * 999 / 1000], mean)
}

/// What two sensors may differ in that shall be the same: points of the gel, um; normals, degrees; depth, um; force, as a share.
struct Bounds {
    sites_um: f64,
    normals_deg: f64,
    depth_um: f64,
    force: f64,
}

/// A round gel against a mesh of it, over some presses; LEDs stand in the gel at these places, or at its rim.
fn compare(
    name: &str,
    exact: &GelShape,
    mesh: &GelShape,
    sensor: impl Fn(&GelShape) -> Sensor,
    places: &[[f64; 2]],
    most: &Bounds,
) {
    let sensors = [sensor(exact), sensor(mesh)];
    let camera = sensors[0].projection();
    let [width, height] = sensors[0].resolution_px;
    let (mut apart_um, mut normals_deg, mut lost) = (0.0_f64, 0.0_f64, 0);
    for (x, y) in (0..height).flat_map(|y| (0..width).map(move |x| (x, y))) {
        let px = [x as f64 + 0.5, y as f64 + 0.5];
        match [exact, mesh].map(|shape| camera.site(shape, px)) {
            [Some(a), Some(b)] => {
                apart_um = apart_um.max(1e3 * a.point_mm.distance(b.point_mm));
                normals_deg = normals_deg.max(a.normal.angle_between(b.normal).to_degrees());
            }
            [None, None] => {}
            _ => lost += 1,
        }
    }
    println!(
        "{name}: points {apart_um:.1} um, normals {normals_deg:.3} degrees apart at most, {lost} pixels see one gel alone"
    );
    assert!(
        apart_um < most.sites_um && normals_deg < most.normals_deg && lost == 0,
        "{apart_um} um, {normals_deg} degrees, {lost} lost"
    );
    let near = [[5.0, 0.0, -15.0], [-3.0, 4.0, -16.0], [-3.0, -4.0, -14.0]];
    for (lit, positions) in [("inside", near.map(Some)), ("at the rim", [None; 3])] {
        let simulators = sensors.each_ref().map(|sensor| {
            let mut sensor = sensor.clone();
            for (led, position_mm) in sensor.leds.iter_mut().zip(positions) {
                led.position_mm = position_mm;
            }
            Simulator::new(&sensor, Fidelity::High).expect("a sound sensor")
        });
        let (largest, all_but_few, mean) = levels(&simulators[0].untouched().rgb, &simulators[1].untouched().rgb);
        println!("  LEDs {lit}, untouched: {largest} levels, {all_but_few} but for a thousandth, {mean:.3} on average");
        for at in places {
            let [a, b] = simulators.each_ref().map(|simulator| press(simulator, exact, 4.0, 0.8, *at));
            let force = |found: &Impression| found.contact.force_n.expect("an elastic pad");
            let depth_um = 1e3 * f64::from((a.depth.deepest_mm - b.depth.deepest_mm).abs());
            let share = force(&b) / force(&a);
            let (largest, all_but_few, mean) = levels(&a.image.rgb, &b.image.rgb);
            println!(
                "  {at:?}: depth {depth_um:.2} um, force {share:.5}, {largest} levels, {all_but_few} but for a thousandth, {mean:.3} on average"
            );
            assert!(
                depth_um < most.depth_um && (share - 1.0).abs() < most.force,
                "{depth_um} um, {share} of the force"
            );
            let levels = if lit == "inside" { (6, 0.1) } else { (20, 1.0) };
            assert!(all_but_few <= levels.0 && mean < levels.1, "{all_but_few} levels, {mean} on average");
        }
    }
}

#[test]
fn a_mesh_of_a_dome_is_a_dome() {
    let mesh = surface(dome(20.0, 160, 60));
    let exact = GelShape::Dome(GelDome { radius_mm: 20.0 });
    let places = [[0.0, 0.0], [3.0, 20.0], [9.0, 130.0], [16.0, 250.0]];
    let most = Bounds { sites_um: 5.0, normals_deg: 0.02, depth_um: 5.0, force: 2e-3 };
    compare("dome", &exact, &mesh, |shape| sensor(shape.clone(), [160, 120], 40.0, 50.0), &places, &most);
}

#[test]
fn walls_are_where_they_are_on_the_dome_at_every_place() {
    let exact = GelShape::Dome(GelDome { radius_mm: 20.0 });
    let sensors = [exact.clone(), surface(dome(20.0, 160, 60))].map(|shape| sensor(shape, [160, 120], 40.0, 50.0));
    let simulators = sensors.each_ref().map(|sensor| Simulator::new(sensor, Fidelity::High).expect("a sound sensor"));
    let path = std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("objects/cube.obj");
    let cube = Arc::new(Shape::bundled(&path).clusters());
    let (mut apart_um, mut worst) = (Vec::new(), 0.0_f64);
    for k in 0..12 {
        let (axes, origin_mm) = exact.frame_at(1.1 * f64::from(k), 67.0 * f64::from(k));
        let turned = [0.02, 0.03, 0.3, 0.9534];
        let length = turned.iter().map(|q| q * q).sum::<f64>().sqrt();
        let pose =
            Pose::from_quaternion(turned.map(|q| q / length), [0.0; 3]).lowered(-0.5, &cube).within(axes, origin_mm);
        let [a, b] =
            simulators.each_ref().map(|simulator| simulator.press(&Indenter::clusters(Arc::clone(&cube), pose)));
        let depths = a.depth_mm().into_iter().zip(b.depth_mm());
        apart_um.extend(depths.filter(|(a, b)| a.max(*b) > 0.0).map(|(a, b)| 1e3 * (a - b).abs()));
        let force = |found: &Impression| found.contact.force_n.expect("an elastic pad");
        worst = worst.max((force(&b) / force(&a) - 1.0).abs());
    }
    // A wall that passes a node within a micrometre may stand on either side of it.
    apart_um.sort_unstable_by(f32::total_cmp);
    let most_um = apart_um[apart_um.len() * 199 / 200];
    println!("dome: twelve cubes: depth {most_um:.1} um apart but for one in 200 places, force {:.2} %", 100.0 * worst);
    assert!(most_um < 30.0 && worst < 8e-3, "{most_um} um, {worst}");
}

#[test]
fn a_mesh_of_a_capsule_is_a_capsule() {
    let mesh = surface(capsule(11.485, 50.0, 96, 120));
    let exact = GelShape::Capsule(GelCapsule { radius_mm: 11.485, length_mm: 50.0 });
    let places = [[0.0, 0.0], [6.0, 20.0], [18.0, 130.0], [26.0, 250.0]];
    // The curvature has a step where ball and cylinder meet, which normals of vertices round off.
    let most = Bounds { sites_um: 40.0, normals_deg: 1.0, depth_um: 8.0, force: 5e-3 };
    compare("capsule", &exact, &mesh, |shape| sensor(shape.clone(), [160, 120], 45.5, 90.0), &places, &most);
}

#[test]
fn a_slide_over_a_mesh_is_that_over_the_same_gel_by_formula() {
    let finger = GelShape::Capsule(GelCapsule { radius_mm: 11.485, length_mm: 50.0 });
    let cases = [
        (
            "dome",
            GelShape::Dome(GelDome { radius_mm: 20.0 }),
            surface(dome(20.0, 160, 60)),
            [[0.0, 0.0], [12.0, 130.0]],
        ),
        ("finger", finger, surface(capsule(11.485, 50.0, 96, 120)), [[2.0, 0.0], [28.0, 250.0]]),
    ];
    for (name, exact, mesh, places) in cases {
        let simulators = [&exact, &mesh].map(|shape| {
            let sensor = sensor(shape.clone(), [120, 90], 45.5, 60.0);
            Simulator::new(&sensor, Fidelity::Standard).expect("a sound sensor").with_flow()
        });
        for (place, [from_tip_mm, around_deg]) in places.into_iter().enumerate() {
            let (axes, origin_mm) = exact.frame_at(from_tip_mm, around_deg);
            // Around the gel, and along it, in both places or one way in each; far enough to leave the first chart.
            let shifts_mm = [[0.0, 0.3], [0.25, 0.05]];
            for shift_mm in if crate::thorough() { &shifts_mm[..] } else { &shifts_mm[place..=place] } {
                let frames = pushed(5, 0.8, *shift_mm, 2.0);
                let [a, b] = simulators
                    .each_ref()
                    .map(|simulator| slide(simulator, 4.0, PadPlane { axes, origin_mm }, 0.5, &frames));
                let (mut force, mut sticks, mut flow_um) = (0.0_f64, 0.0_f64, 0.0_f32);
                for (a, b) in a.iter().zip(&b) {
                    let [by_formula, by_mesh] = [a, b].map(|found| wrench(found)[0]);
                    force = force.max((by_formula - by_mesh).length() / by_formula.length().max(0.05));
                    let [stick, other] =
                        [a, b].map(|found| found.sliding.as_ref().expect("a frame").slip.stick_fraction);
                    sticks = sticks.max((stick - other).abs());
                    let off = a.flow_mm().into_iter().flatten().zip(b.flow_mm().into_iter().flatten());
                    let mut off: Vec<f32> = off.map(|(a, b)| 1e3 * (a - b).abs()).collect();
                    off.sort_by(f32::total_cmp);
                    flow_um = flow_um.max(off[off.len() * 999 / 1000]);
                }
                println!(
                    "a slide over a mesh, {name} at {from_tip_mm} mm by {shift_mm:?}: force within {:.2} %, sticking share {sticks:.3}, \
                     motion {flow_um:.1} um but for a thousandth",
                    100.0 * force
                );
                assert!(
                    force < 0.03 && sticks < 0.1 && flow_um < 30.0,
                    "force {force}, sticking {sticks}, {flow_um} um"
                );
                let [last, _] = wrench(b.last().expect("frames"));
                let last = axes.transpose() * last;
                assert!(last.truncate().length() > 0.1 * last.z.abs(), "it is pulled: {last}");
            }
        }
    }
}

/// A flat sheet of few triangles, seen from straight below.
#[test]
fn a_flat_mesh_is_a_flat_pad() {
    let mut flat = Sensor::preset("gelsight-2014").expect("a preset").with_resolution([96, 72]);
    flat.camera.read_noise_levels = 0.0;
    let sheet = Shape::crossed_sheet(4, 3, |i, j| [20.0 * i as f64 - 40.0, 20.0 * j as f64 - 30.0, 0.0]);
    let mut shaped = flat.clone();
    shaped.shape = Some(surface(sheet));
    shaped.lens = LensModel::Orthographic;
    let simulators = [flat, shaped].map(|sensor| Simulator::new(&sensor, Fidelity::High).expect("a sound sensor"));
    let (view, other) = (simulators[0].view(), simulators[1].view());
    assert!((0..2).all(|k| (view.mm_per_px[k] / other.mm_per_px[k] - 1.0).abs() < 1e-9), "{view:?} {other:?}");
    for [x, y] in [[0.0, 0.0], [4.3, -3.1]] {
        let pose = Pose::from_quaternion([0.0, 0.0, 0.0, 1.0], [x, y, 4.0 - 0.6]);
        let [a, b] = simulators.each_ref().map(|simulator| simulator.press(&Indenter::clusters(ball(4.0), pose)));
        let largest = |a: &[f32], b: &[f32]| a.iter().zip(b).map(|(a, b)| (a - b).abs()).fold(0.0, f32::max);
        let surface_um = 1e3 * largest(&a.contact.surface.data, &b.contact.surface.data);
        let share = b.contact.force_n.expect("an elastic pad") / a.contact.force_n.expect("an elastic pad");
        println!("a flat mesh at {x} {y}: surface {surface_um:.2} um, force {share:.6}");
        assert!(surface_um < 0.5 && (share - 1.0).abs() < 1e-3, "{surface_um} um, {share} of the force");
    }
}

/// Every node of a mesh's chart against a plain loop over all triangles.
#[test]
fn capture_on_a_mesh_is_what_rays_meet() {
    let shape = surface(capsule(9.0, 24.0, 40, 40));
    let view = View { resolution_px: [48, 40], mm_per_px: [0.3, 0.35] };
    let GelShape::Mesh(skin) = &shape else { panic!("a mesh") };
    let nodes = NormalCapture::new(&shape, &view, 4);
    let window = CaptureWindow { above_mm: 0.4, margin_px: 4 };
    let (mut compared, mut met, mut worst_um) = (0, 0, 0.0_f64);
    for path in bundled_objects().into_iter().step_by(4) {
        let object = Shape::bundled(&path).clusters();
        for (from_tip_mm, around_deg) in [(0.0, 0.0), (11.0, 70.0), (19.0, 200.0)] {
            let (axes, origin_mm) = shape.frame_at(from_tip_mm, around_deg);
            let up = DVec3::from_array(object.centre_mm()).z;
            let pose = Pose::from_quaternion([0.0, 0.0, 0.0, 1.0], [0.0, 0.0, 1.5 - up]).within(axes, origin_mm);
            let chart = match from_tip_mm == 0.0 {
                true => Chart::at_tip(&shape),
                false => Chart::from_geodesics(Arc::new(GeodesicChart::around_point(skin, origin_mm, 16.0))),
            };
            let depth = nodes.capture(&object, &pose, &chart, window, 1.0);
            let geodesics = chart.geodesics().expect("a mesh's");
            for number in (0..56 * 48).step_by(37) {
                let (x, y) = (number % 56, number / 56);
                let at = view.point_mm([x as f64 - 3.5, y as f64 - 3.5]);
                let rest = chart.surface_frame(at);
                let from = rest.point_mm - 2.0 * rest.normal;
                let ray = first_met(&object, &pose, from, rest.normal).map_or(0.4, |t| (t - 2.0).min(0.4));
                let expected = if geodesics.is_on_gel(at, 0.0) { ray.max(-1.0) } else { 0.4 };
                let found = f64::from(-depth.penetration.at(x, y));
                worst_um = worst_um.max(1e3 * (found - expected).abs());
                compared += 1;
                met += usize::from(expected < 0.4);
            }
        }
    }
    println!("rays: {compared} normals, {met} of them met something, {worst_um:.3} um apart at most");
    assert!(worst_um < 0.5 && met > compared / 20, "{worst_um} um, {met} of {compared}");
}

#[test]
fn pins_of_a_mesh_rest_where_those_of_the_dome_do() {
    let at_rest = |shape: GelShape| {
        let mut sensor = Sensor::preset("tactip").expect("a preset");
        sensor.shape = Some(shape);
        let pins = sensor.pins.as_ref().expect("it has pins");
        pins.at_rest(sensor.shape.as_ref().expect("it has one"), &sensor.projection())
    };
    let [exact, mesh] = [GelShape::Dome(GelDome { radius_mm: 20.0 }), surface(dome(20.0, 160, 60))].map(at_rest);
    let apart = |(a, b): (&PinTip, &PinTip)| a.at_mm.distance(b.at_mm);
    let worst_um = 1e3 * exact.iter().zip(&mesh).map(apart).fold(0.0, f64::max);
    println!("{} pins at rest {worst_um:.2} um apart at most", exact.len());
    assert!(exact.len() == mesh.len() && worst_um < 20.0, "{} and {} pins, {worst_um} um", exact.len(), mesh.len());
}

#[test]
fn what_is_no_gel_is_refused_and_sharp_edges_are_counted() {
    let made = |shape: Shape| {
        let points = shape.vertices.into_iter().map(DVec3::from_array).collect();
        GelSurface::new(points, shape.triangles)
    };
    let cap = dome(5.0, 24, 8);
    let beside = cap.map(|[x, y, z]| [x + 30.0, y, z]);
    // Seams are not joined without cleaning.
    let joined = |shape: &Shape| {
        let (mesh, _) = Mesh::new(shape.vertices.clone(), shape.triangles.clone()).expect("a mesh");
        let centre = DVec3::from_array(mesh.centre_mm);
        let point = |vertex: &[f32; 3]| (DVec3::from_array(vertex.map(f64::from)) + centre).to_array();
        Shape { vertices: mesh.vertices.iter().map(point).collect(), triangles: mesh.triangles }
    };
    assert!(matches!(made(joined(&beside)), Err(GelSurfaceError::NoTip(..))));
    assert!(
        matches!(made(joined(&cap.map(|[x, y, z]| [x, y, z + 1.0]))), Err(GelSurfaceError::TipElsewhere(z)) if (z - 1.0).abs() < 1e-6)
    );
    let mut two = joined(&cap);
    let more = joined(&beside);
    let count = two.vertices.len() as u32;
    two.vertices.extend(more.vertices);
    two.triangles.extend(more.triangles.iter().map(|corners| corners.map(|corner| corner + count)));
    assert!(matches!(made(two), Err(GelSurfaceError::Pieces { count: 2, .. })));
    // A box: its bottom is no part of it, its edges stay sharp, and its top is flat to them.
    let mut cube = joined(&Shape::soup([
        [[-5.0, -4.0, 0.0], [5.0, -4.0, 0.0], [5.0, 4.0, 0.0]],
        [[-5.0, -4.0, 0.0], [5.0, 4.0, 0.0], [-5.0, 4.0, 0.0]],
        [[-5.0, -4.0, 0.0], [-5.0, -4.0, -6.0], [5.0, -4.0, 0.0]],
        [[5.0, -4.0, 0.0], [-5.0, -4.0, -6.0], [5.0, -4.0, -6.0]],
        [[5.0, -4.0, 0.0], [5.0, -4.0, -6.0], [5.0, 4.0, 0.0]],
        [[5.0, 4.0, 0.0], [5.0, -4.0, -6.0], [5.0, 4.0, -6.0]],
    ]));
    cube.triangles.reverse();
    let skin = made(cube).expect("a surface");
    assert_eq!(skin.sharp_edges(), 3);
    let (point, normal) = skin.nearest(DVec3::new(4.9, 3.9, 0.5));
    assert!(
        normal.abs_diff_eq(DVec3::Z, 1e-12) && point.abs_diff_eq(DVec3::new(4.9, 3.9, 0.0), 1e-9),
        "{point} {normal}"
    );
    // The way over the edge unfolds it.
    let (axes, origin_mm) = GelShape::Mesh(Arc::new(skin)).frame_at(6.5, 0.0);
    assert!(
        origin_mm.abs_diff_eq(DVec3::new(5.0, 0.0, -1.5), 1e-6) && axes.z_axis.abs_diff_eq(DVec3::X, 1e-6),
        "{origin_mm}"
    );
}
