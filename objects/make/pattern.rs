//! Patterned surfaces: ridges, gratings, waves, domes, knurl, and a twisted rope.

use crate::outline::{circle, moved, polar, rectangle};
use crate::solid::{P2, P3, Solid};
use crate::sweep::height_field;

/// Height of the plate under a pattern, mm.
const PLATE_MM: f64 = 2.0;

/// Two ridges that cross at a right angle.
pub fn crossed_ridges() -> Solid {
    let mut lines = vec![-7.0];
    lines.extend(crest_lines(0.0, 0.8, 1.5));
    lines.push(7.0);
    let height = |x: f64, y: f64| PLATE_MM + crest(x, 0.8, 1.5).max(crest(y, 0.8, 1.5));
    let mut solid = Solid::fine();
    height_field(&mut solid, &lines, &lines, height);
    solid
}

/// Six equal ridges, 2.5 mm apart.
pub fn parallel_ridges() -> Solid {
    let ridges: Vec<[f64; 3]> = (0..6).map(|i| [2.5 * i as f64 - 6.25, 0.6, 1.2]).collect();
    ridges_along_y(&ridges, 8.0, 6.5)
}

/// Ridges from 0.3 to 2 mm wide, each followed by a gap of its own width.
pub fn grating() -> Solid {
    let mut ridges = Vec::new();
    let mut edge = -6.6;
    for width in [0.3, 0.4, 0.5, 0.7, 0.9, 1.2, 1.6, 2.0] {
        ridges.push([edge + width / 2.0, width / 2.0, 0.8]);
        edge += 2.0 * width;
    }
    ridges_along_y(&ridges, 7.0, 5.5)
}

/// A sine of 4 mm wave length and 1 mm from trough to crest.
pub fn wave() -> Solid {
    let xs: Vec<f64> = (0..=240).map(|i| i as f64 / 15.0 - 8.0).collect();
    let height = |x: f64, _| PLATE_MM + 0.5 * libm::cos(std::f64::consts::TAU * x / 4.0);
    let mut solid = Solid::fine();
    height_field(&mut solid, &xs, &[-6.0, 6.0], height);
    solid
}

/// Pyramids with flat tops, 1.5 mm apart, as a knurling tool leaves them.
pub fn knurl() -> Solid {
    let lines = |n: usize| -> Vec<f64> {
        let first = -0.75 * n as f64;
        let cell = [0.0, 0.55, 0.95];
        let inner = (0..3 * n).map(|i| first + 1.5 * (i / 3) as f64 + cell[i % 3]);
        inner.chain([-first]).collect()
    };
    let tooth = |t: f64| ((libm::fabs(t / 1.5 - libm::round(t / 1.5)) * 1.5) / 0.55).min(1.0);
    let (xs, ys) = (lines(9), lines(7));
    // The outermost lines are grooves, and every groove lies a whole pitch from them.
    let height = |x: f64, y: f64| PLATE_MM + 0.7 * tooth(x - xs[0]).min(tooth(y - ys[0]));
    let mut solid = Solid::new();
    height_field(&mut solid, &xs, &ys, height);
    solid
}

/// Twelve hemispheres of 1 mm radius on a plate, 4 mm apart.
pub fn dots() -> Solid {
    const PITCH_MM: f64 = 4.0;
    const DOME_MM: f64 = 1.0;
    const CELLS: usize = 12;
    let mut solid = Solid::fine();
    let rim = circle([0.0, 0.0], DOME_MM, -45.0, 4 * CELLS);
    for i in 0..4 {
        for j in 0..3 {
            let [x0, y0] = [PITCH_MM * (i as f64 - 2.0), PITCH_MM * (j as f64 - 1.5)];
            let [x1, y1] = [x0 + PITCH_MM, y0 + PITCH_MM];
            let cell = rectangle([x0, y0], [x1, y1]);
            let centre = [x0 + PITCH_MM / 2.0, y0 + PITCH_MM / 2.0];
            solid.cap_up(&cell, &[moved(&rim, centre)], PLATE_MM);
            solid.cap_down(&cell, &[], 0.0);
            dome(&mut solid, [centre[0], centre[1], PLATE_MM], DOME_MM, CELLS);
            let outside = [j == 0, i == 3, j == 2, i == 0];
            for side in (0..4).filter(|&side| outside[side]) {
                let ([ax, ay], [bx, by]) = (cell[side], cell[(side + 1) % 4]);
                let foot = [[ax, ay, 0.0], [bx, by, 0.0]];
                solid.face(&[foot[0], foot[1], [bx, by, PLATE_MM], [ax, ay, PLATE_MM]]);
            }
        }
    }
    solid
}

/// A three-strand rope of 4.7 mm along x; facets are finer where it faces the pad.
pub fn rope() -> Solid {
    const LENGTH_MM: f64 = 17.0;
    const ROWS: usize = 54;
    const LAY_MM: f64 = 17.0;
    let rows: Vec<[f64; 2]> = (0..=ROWS)
        .map(|i| i as f64 / ROWS as f64)
        .map(|t| [LENGTH_MM * (t - 0.5), 360.0 * LENGTH_MM / LAY_MM * t])
        .collect();
    let mut solid = Solid::fine();
    let mut ends = [Vec::new(), Vec::new()];
    // Directions run from the pad's, positive towards -y; the two windows share their borders.
    for (from, to, chords) in [(-100.0, 100.0, 32), (100.0, 260.0, 8)] {
        let loops: Vec<Vec<P3>> = rows
            .iter()
            .map(|&[x, twist]| {
                strand_lines(chords).map(|line| strand_point(x, twist, (line + twist).clamp(from, to))).collect()
            })
            .collect();
        for pair in loops.windows(2) {
            for k in 1..pair[0].len() {
                solid.face(&[pair[0][k - 1], pair[0][k], pair[1][k], pair[1][k - 1]]);
            }
        }
        for (end, line) in ends.iter_mut().zip([&loops[0], &loops[ROWS]]) {
            end.extend(line.iter().copied());
        }
    }
    let middle = LENGTH_MM / 2.0;
    ends[0].reverse();
    for (rim, x) in ends.iter().zip([-middle, middle]) {
        solid.fan(rim, [x, 0.0, 0.0]);
    }
    solid
}

const STRAND_MM: f64 = 1.2;
const STRAND_OFFSET_MM: f64 = 0.95 * STRAND_MM;

/// Directions of the lines along the strands before any twist, over enough turns for a window.
fn strand_lines(chords: usize) -> impl Iterator<Item = f64> {
    // Neighbouring strands meet 60 degrees from the middle of each, seen from the rope's axis.
    let half = 60.0 + libm::asin(STRAND_OFFSET_MM / STRAND_MM * 0.75f64.sqrt()).to_degrees();
    (-5 * chords as i64..=3 * chords as i64).map(move |i| {
        let n = chords as i64;
        let a = half * (2.0 * i.rem_euclid(n) as f64 / n as f64 - 1.0);
        let [x, y] = polar(STRAND_MM, a);
        120.0 * i.div_euclid(n) as f64 + libm::atan2(y, x + STRAND_OFFSET_MM).to_degrees()
    })
}

fn strand_point(x: f64, twist: f64, deg: f64) -> P3 {
    let turned = deg - twist;
    let [along, across] = polar(STRAND_OFFSET_MM, turned - 120.0 * libm::round(turned / 120.0));
    let r = along + (STRAND_MM * STRAND_MM - across * across).sqrt();
    let [up, side] = polar(r, deg);
    [x, -side, up]
}

/// Ridges [centre, half width, height] along the whole of a plate of half size `x`, `y`.
fn ridges_along_y(ridges: &[[f64; 3]], x: f64, y: f64) -> Solid {
    let mut xs = vec![-x];
    for &[centre, half, height] in ridges {
        xs.extend(crest_lines(centre, half, height));
    }
    xs.push(x);
    let profile = |x: f64, _| {
        let over = ridges.iter().map(|&[c, half, height]| crest(x - c, half, height));
        PLATE_MM + over.fold(0.0, f64::max)
    };
    let mut solid = Solid::fine();
    height_field(&mut solid, &xs, &[-y, y], profile);
    solid
}

/// How far a ridge's flank leans out between its round shoulder and its foot, mm.
const FLANK_MM: f64 = 0.06;

fn shoulder(half: f64, height: f64) -> f64 {
    (0.9 * (half - FLANK_MM)).min(0.6 * height)
}

/// Height over the plate at `x` from the middle of a ridge with round shoulders.
fn crest(x: f64, half: f64, height: f64) -> f64 {
    let r = shoulder(half, height);
    let (flat, edge) = (half - FLANK_MM - r, half - FLANK_MM);
    let x = x.abs();
    if x <= flat {
        height
    } else if x <= edge + 1e-9 {
        height - r + (r * r - (x - flat) * (x - flat)).max(0.0).sqrt()
    } else {
        ((half - x) / FLANK_MM).clamp(0.0, 1.0) * (height - r)
    }
}

/// The lines a ridge needs: even angles over its shoulders, and the foot of each flank.
fn crest_lines(centre: f64, half: f64, height: f64) -> Vec<f64> {
    let r = shoulder(half, height);
    let steps = if half < 0.4 { 8 } else { 12 };
    let right: Vec<f64> = (0..=steps)
        .map(|i| half - FLANK_MM - r + polar(r, 90.0 - 90.0 * i as f64 / steps as f64)[0])
        .chain([half])
        .collect();
    let left = right.iter().rev().map(|x| centre - x);
    left.chain(right.iter().map(|x| centre + x)).collect()
}

/// A hemisphere on `centre`, open below; its rim has `4 * cells` points, the first at -45 degrees.
fn dome(solid: &mut Solid, centre: P3, r: f64, cells: usize) {
    let tan = |deg: f64| libm::tan(deg.to_radians());
    // Rows down the side: steep facets look small from above and may be taller.
    let rows = [45.0, 34.0, 20.0, 0.0].map(tan);
    let even = |i: usize| tan(90.0 * i as f64 / cells as f64 - 45.0);
    let place = |p: P3| {
        let scale = r / (p[0] * p[0] + p[1] * p[1] + p[2] * p[2]).sqrt();
        [0, 1, 2].map(|k| centre[k] + scale * p[k])
    };
    for i in 0..cells {
        let (a, b) = (even(i), even(i + 1));
        for j in 0..cells {
            let (c, d) = (even(j), even(j + 1));
            solid.face(&[[a, c, 1.0], [b, c, 1.0], [b, d, 1.0], [a, d, 1.0]].map(place));
        }
        for pair in rows.windows(2) {
            let (c, d) = (pair[1], pair[0]);
            let side: [P3; 4] = [[1.0, a, c], [1.0, b, c], [1.0, b, d], [1.0, a, d]];
            for quarter in 0..4 {
                solid.face(&side.map(|[x, y, z]| {
                    let [x, y]: P2 = [[x, y], [-y, x], [-x, -y], [y, -x]][quarter];
                    place([x, y, z])
                }));
            }
        }
    }
}
