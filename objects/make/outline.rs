//! Closed outlines in the drawing plane, all counter-clockwise, in mm and degrees.
//!
//! Sines and cosines come from libm, so that the files do not depend on the machine's own.

use crate::solid::P2;

/// The point at distance `r` from the origin in direction `deg`.
pub fn polar(r: f64, deg: f64) -> P2 {
    let (sin, cos) = libm::sincos(deg.to_radians());
    [r * cos, r * sin]
}

/// `steps + 1` points of an arc from `from_deg` to `to_deg`, both ends included.
pub fn arc([x, y]: P2, r: f64, from_deg: f64, to_deg: f64, steps: usize) -> Vec<P2> {
    (0..=steps)
        .map(|i| {
            let t = i as f64 / steps as f64;
            let [dx, dy] = polar(r, from_deg + (to_deg - from_deg) * t);
            [x + dx, y + dy]
        })
        .collect()
}

/// A full circle of `steps` points; the first one lies in direction `from_deg`.
pub fn circle(centre: P2, r: f64, from_deg: f64, steps: usize) -> Vec<P2> {
    let mut points = arc(centre, r, from_deg, from_deg + 360.0, steps);
    points.pop();
    points
}

/// A rectangle about the origin with round corners of radius `r`, `steps` chords to each; with `r`
/// half the height its ends are half circles.
pub fn rounded_rectangle(width: f64, height: f64, r: f64, steps: usize) -> Vec<P2> {
    let (x, y) = (width / 2.0 - r, height / 2.0 - r);
    let corners = [[x, y], [-x, y], [-x, -y], [x, -y]];
    let mut outline: Vec<P2> =
        (0..4).flat_map(|k| arc(corners[k], r, 90.0 * k as f64, 90.0 * (k + 1) as f64, steps)).collect();
    outline.dedup_by(|a, b| close(*a, *b));
    if close(outline[0], outline[outline.len() - 1]) {
        outline.pop();
    }
    outline
}

/// A rectangle from corner to corner.
pub fn rectangle([x0, y0]: P2, [x1, y1]: P2) -> Vec<P2> {
    vec![[x0, y0], [x1, y0], [x1, y1], [x0, y1]]
}

/// The outline with every edge moved inwards by `d` (outwards where negative), corners mitred.
pub fn inset(outline: &[P2], d: f64) -> Vec<P2> {
    let n = outline.len();
    (0..n)
        .map(|i| {
            let [before, p, after] = [outline[(i + n - 1) % n], outline[i], outline[(i + 1) % n]];
            mitre(p, left(before, p), left(p, after), d)
        })
        .collect()
}

/// The outline of a pen stroke of constant width with square ends along a line of points.
pub fn stroke(line: &[P2], width: f64) -> Vec<P2> {
    let last = line.len() - 1;
    let side = |d: f64| -> Vec<P2> {
        (0..=last)
            .map(|i| {
                let before = left(line[i.max(1) - 1], line[i.max(1)]);
                let after = left(line[i.min(last - 1)], line[i.min(last - 1) + 1]);
                mitre(line[i], before, after, d)
            })
            .collect()
    };
    let mut outline = side(-width / 2.0);
    outline.extend(side(width / 2.0).into_iter().rev());
    outline
}

/// The outline with every point moved by `by`.
pub fn moved(outline: &[P2], by: P2) -> Vec<P2> {
    outline.iter().map(|p| [p[0] + by[0], p[1] + by[1]]).collect()
}

/// The outline enlarged `k` times about the origin.
pub fn scaled(outline: &[P2], k: f64) -> Vec<P2> {
    outline.iter().map(|p| p.map(|c| c * k)).collect()
}

fn close(a: P2, b: P2) -> bool {
    (a[0] - b[0]).abs() + (a[1] - b[1]).abs() < 1e-6
}

/// Unit vector to the left of the way from `a` to `b`.
fn left(a: P2, b: P2) -> P2 {
    let (dx, dy) = (b[0] - a[0], b[1] - a[1]);
    let length = (dx * dx + dy * dy).sqrt();
    [-dy / length, dx / length]
}

fn mitre(p: P2, m: P2, n: P2, d: f64) -> P2 {
    let scale = d / (1.0 + m[0] * n[0] + m[1] * n[1]);
    [p[0] + scale * (m[0] + n[0]), p[1] + scale * (m[1] + n[1])]
}
