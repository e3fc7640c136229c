//! Things to read by touch: a coin, a letter, a key. Drawn as they are to be read.

use crate::basic::fillet;
use crate::outline::{arc, circle, inset, moved, polar, rectangle, rounded_rectangle, scaled, stroke};
use crate::solid::{P2, P3, Solid, at};
use crate::sweep::{revolve, rise, round, sink};

/// The letter R, 1.5 mm proud of a plate.
pub fn letter() -> Solid {
    const PLATE_MM: f64 = 2.0;
    const HEIGHT_MM: f64 = 1.5;
    let centre = [-3.7, -5.0];
    let mut outline = vec![[0.0, 0.0], [1.9, 0.0], [1.9, 3.8], [2.9, 3.8], [5.1, 0.0], [7.4, 0.0]];
    outline.extend(arc([4.0, 6.95], 3.05, -67.0, 90.0, 60));
    outline.push([0.0, 10.0]);
    let mut counter = arc([4.0, 6.95], 1.4, -90.0, 90.0, 48);
    counter.extend([[1.9, 8.35], [1.9, 5.55]]);
    let (outline, counter) = (moved(&outline, centre), moved(&counter, centre));
    let plate = rounded_rectangle(12.0, 13.2, 1.5, 20);
    let mut solid = Solid::new();
    rise(&mut solid, &plate, 0.0, &[[0.0, PLATE_MM]]);
    solid.cap_down(&plate, &[], 0.0);
    solid.cap_up(&plate, std::slice::from_ref(&outline), PLATE_MM);
    solid.cap_up(&counter, &[], PLATE_MM);
    let edge: Vec<P2> = fillet(0.2, 4).collect();
    let wall = [0.0, HEIGHT_MM - 0.2];
    let up = edge.iter().map(|&[d, dz]| [d, wall[1] + dz]);
    let face = rise(&mut solid, &outline, PLATE_MM, &[wall].into_iter().chain(up).collect::<Vec<_>>());
    // The wall of the counter, from its rounded mouth down to the plate.
    let mouth = inset(&counter, -0.2);
    let mut down: Vec<P2> = edge.iter().rev().skip(1).map(|&[d, dz]| [d - 0.2, 0.2 - dz]).collect();
    down.extend([[-0.2, 0.2], [-0.2, HEIGHT_MM]]);
    sink(&mut solid, &mouth, PLATE_MM + HEIGHT_MM, &down);
    solid.cap_up(&face, &[mouth], PLATE_MM + HEIGHT_MM);
    solid
}

/// A small flat key of 19 mm: bow with a hole and a sunk panel, cuts along one edge, a groove in the blade.
pub fn key() -> Solid {
    const THICK_MM: f64 = 2.0;
    // Drawn 25 mm long, made to fit the window.
    const SCALE: f64 = 0.76;
    const BEVEL_MM: f64 = 0.15;
    let bow = [-7.6, 0.0];
    let mut outline = arc(bow, 5.0, 24.0, 336.0, 132);
    outline.extend([[-2.6, -2.4], [10.6, -2.4], [12.4, -0.9], [12.4, -0.3]]);
    outline.extend([[11.2, 1.1], [10.3, 1.1], [9.4, 0.3], [8.6, 0.3], [7.6, 1.5], [6.8, 1.5]]);
    outline.extend([[6.1, 0.8], [5.3, 0.8], [4.3, 1.9], [3.5, 1.9], [2.5, 0.5], [1.7, 0.5]]);
    outline.extend([[0.2, 2.1], [-1.2, 2.1], [-1.6, 3.0], [-2.6, 3.0]]);
    let hole = circle([-9.7, 0.0], 1.3, 1.1, 60);
    let panel = circle(bow, 4.1, 0.5, 120);
    let groove = moved(&rounded_rectangle(12.4, 0.9, 0.44, 12), [4.6, -1.1]);
    let [outline, hole, panel, groove] = [outline, hole, panel, groove].map(|drawn| scaled(&drawn, SCALE));
    let mut solid = Solid::new();
    let face = rise(&mut solid, &outline, 0.0, &[[0.0, THICK_MM - BEVEL_MM], [BEVEL_MM, THICK_MM]]);
    solid.cap_up(&face, &[panel.clone(), groove.clone()], THICK_MM);
    let bed = sink(&mut solid, &groove, THICK_MM, &[[-0.12, 0.6]]);
    solid.cap_up(&bed, &[], THICK_MM - 0.6);
    let floor = sink(&mut solid, &panel, THICK_MM, &[[-0.12, 0.35]]);
    solid.cap_up(&floor, std::slice::from_ref(&hole), THICK_MM - 0.35);
    sink(&mut solid, &hole, THICK_MM - 0.35, &[[0.0, THICK_MM - 0.35]]);
    solid.cap_down(&outline, &[hole], 0.0);
    solid
}

/// A coin of 14 mm: rim, beads, an inscription, laurel and a star, in relief of up to 0.5 mm.
pub fn coin() -> Solid {
    const FIELD_MM: f64 = 1.4;
    let around = round(180);
    let mut solid = Solid::new();
    let rim = [[0.0, 0.0], [7.0, 0.0], [7.0, 1.74], [6.92, 1.86], [6.72, 1.9], [6.5, 1.86], [6.3, FIELD_MM]];
    revolve(&mut solid, &rim, &around);
    let mut feet: Vec<Vec<P2>> = Vec::new();
    for i in 0..60 {
        let deg = 6.0 * f64::from(i) + 1.0;
        // Turned each by itself: corners of three beads in one line would upset the triangulation.
        feet.push(bead(&mut solid, polar(5.98, deg), 1.37 * deg, FIELD_MM));
    }
    for outline in inscription() {
        let face = rise(&mut solid, &outline, FIELD_MM, &[[0.0, 0.18], [0.06, 0.27]]);
        solid.cap_up(&face, &[], FIELD_MM + 0.27);
        feet.push(outline);
    }
    for side in [1.0, -1.0] {
        for i in 0..6 {
            let along = 12.0 * f64::from(i) + 8.0;
            for (r, lean) in [(5.05, 33.0), (4.35, -29.0)] {
                let middle = polar(r, -90.0 + side * (along + if lean > 0.0 { 3.0 } else { 0.0 }));
                let direction = -90.0 + side * (along + 90.0 - lean);
                feet.push(leaf(&mut solid, middle, direction, FIELD_MM));
            }
        }
    }
    let star: Vec<P2> =
        (0..10).map(|i| polar(if i % 2 == 0 { 3.3 } else { 1.3 }, 90.0 + 36.0 * f64::from(i))).collect();
    let edge = rise(&mut solid, &star, FIELD_MM, &[[0.02, 0.12]]);
    solid.fan(&at(&edge, FIELD_MM + 0.12), [0.0, 0.0, FIELD_MM + 0.5]);
    feet.push(star);
    let field: Vec<P2> = around.iter().map(|&d| polar(6.3, d)).collect();
    solid.cap_up(&field, &feet, FIELD_MM);
    solid
}

/// A low dome of eight sides on `centre`; returns its foot.
fn bead(solid: &mut Solid, centre: P2, deg: f64, z: f64) -> Vec<P2> {
    let [foot, shoulder] = [0.17, 0.11].map(|r| circle(centre, r, deg, 8));
    solid.band(&at(&foot, z), &at(&shoulder, z + 0.11));
    solid.fan(&at(&shoulder, z + 0.11), [centre[0], centre[1], z + 0.15]);
    foot
}

/// A pointed leaf with a raised vein; returns its foot.
fn leaf(solid: &mut Solid, [x, y]: P2, direction: f64, z: f64) -> Vec<P2> {
    let [cos, sin] = polar(1.0, direction);
    let place = |along: f64, across: f64, up: f64| -> P3 {
        [x + along * cos - across * sin, y + along * sin + across * cos, z + up]
    };
    let stations = [(-0.3, 0.16, 0.2), (-0.05, 0.21, 0.26), (0.2, 0.16, 0.22)];
    let vein = stations.map(|(along, _, up)| place(along, 0.0, up));
    let right = stations.map(|(along, half, _)| place(along, -half, 0.0));
    let left = stations.map(|(along, half, _)| place(along, half, 0.0));
    let (base, tip) = (place(-0.5, 0.0, 0.0), place(0.52, 0.0, 0.0));
    let edge = [&[base], &right[..], &[tip]].concat();
    let middle = [&[base], &vein[..], &[tip]].concat();
    let other = [&[base], &left[..], &[tip]].concat();
    for i in 0..4 {
        solid.face(&[edge[i], edge[i + 1], middle[i + 1], middle[i]]);
        solid.face(&[middle[i], middle[i + 1], other[i + 1], other[i]]);
    }
    let rim = edge.iter().chain(left.iter().rev());
    rim.map(|&[x, y, _]| [x, y]).collect()
}

/// The word GELSIM, bent over the top of the coin.
fn inscription() -> Vec<Vec<P2>> {
    const BASE_MM: f64 = 4.15;
    const SCALE_MM: f64 = 1.4;
    const GAP: f64 = 0.4;
    let glyphs = [glyph_g(), glyph_e(), glyph_l(), glyph_s(), rectangle([0.0, 0.0], [0.2, 1.0]), glyph_m()];
    let widths = [0.8, 0.6, 0.58, 0.66, 0.2, 0.86];
    let total = widths.iter().sum::<f64>() + GAP * 5.0;
    let mut start = -total / 2.0;
    let mut bent = Vec::new();
    for (glyph, width) in glyphs.iter().zip(widths) {
        let around = |[x, y]: P2| {
            // Measured along the middle of the letters.
            let deg = ((start + x) * SCALE_MM / (BASE_MM + SCALE_MM / 2.0)).to_degrees();
            polar(BASE_MM + y * SCALE_MM, 90.0 - deg)
        };
        bent.push(glyph.iter().map(|&p| around(p)).collect());
        start += width + GAP;
    }
    bent
}

fn glyph_g() -> Vec<P2> {
    let mut line: Vec<P2> = ellipse([0.42, 0.5], [0.32, 0.405], 48.0, 335.0, 22);
    line.extend([[0.72, 0.47], [0.45, 0.47]]);
    stroke(&line, 0.19)
}

fn glyph_s() -> Vec<P2> {
    let mut line = ellipse([0.33, 0.705], [0.235, 0.2], 25.0, 262.0, 14);
    line.extend(ellipse([0.33, 0.295], [0.235, 0.2], 82.0, -155.0, 14));
    stroke(&line, 0.19)
}

fn glyph_e() -> Vec<P2> {
    [
        [0.0, 0.0],
        [0.6, 0.0],
        [0.6, 0.19],
        [0.2, 0.19],
        [0.2, 0.405],
        [0.52, 0.405],
        [0.52, 0.595],
        [0.2, 0.595],
        [0.2, 0.81],
        [0.6, 0.81],
        [0.6, 1.0],
        [0.0, 1.0],
    ]
    .to_vec()
}

fn glyph_l() -> Vec<P2> {
    [[0.0, 0.0], [0.58, 0.0], [0.58, 0.19], [0.2, 0.19], [0.2, 1.0], [0.0, 1.0]].to_vec()
}

fn glyph_m() -> Vec<P2> {
    [
        [0.0, 0.0],
        [0.18, 0.0],
        [0.18, 0.6],
        [0.36, 0.14],
        [0.5, 0.14],
        [0.68, 0.6],
        [0.68, 0.0],
        [0.86, 0.0],
        [0.86, 1.0],
        [0.66, 1.0],
        [0.43, 0.45],
        [0.2, 1.0],
        [0.0, 1.0],
    ]
    .to_vec()
}

fn ellipse([x, y]: P2, [a, b]: P2, from_deg: f64, to_deg: f64, steps: usize) -> Vec<P2> {
    let unit = arc([0.0, 0.0], 1.0, from_deg, to_deg, steps);
    unit.iter().map(|[c, s]| [x + a * c, y + b * s]).collect()
}
