//! Displacement of a bonded layer around one pressed pixel, integrated in f64 another way than the code does.

use std::f64::consts::TAU;

use gelsim_core::gelpad::elastic::layer::ElasticLayer;

/// The displacement at (`x`, `y`) from uniform pressure 1 on a pixel around the origin, f64. The layer's answer g(r) to
/// a unit force is rotationally symmetric, so that its integral over a rectangle is one around the rectangle's border of
/// S(r) / r^2, with S(r) the integral of g(r) r from 0 to r: (1 / 2 pi) times that of G(q) r J1(q r) over q.
pub fn pressed_pixel(layer: ElasticLayer, pitch: [f64; 2], x: f64, y: f64) -> f64 {
    let [dx, dy] = pitch;
    let (left, right, above, below) = (x - dx / 2.0, x + dx / 2.0, y - dy / 2.0, y + dy / 2.0);
    let sides = [(right, above, below), (-left, above, below), (below, left, right), (-above, left, right)];
    sides.map(|(away, from, to)| side(layer, away, from, to)).iter().sum()
}

/// One side of the border: a line `away` from the point, from `from` to `to` along it.
fn side(layer: ElasticLayer, away: f64, from: f64, to: f64) -> f64 {
    if away == 0.0 {
        return 0.0;
    }
    // By angle, in which the integrand is smooth however near the point is.
    let angle = |along: f64| (along / away.abs()).atan();
    let (start, end) = (angle(from), angle(to));
    away.signum() * integral(start, end, 24, |angle| within(layer, away.abs() / angle.cos()))
}

/// S(r).
fn within(layer: ElasticLayer, r: f64) -> f64 {
    let h = layer.thickness_mm;
    let half_space = layer.half_space_compliance();
    // Less the half-space's, whose S is r times its constant; beyond q h = 20 the two differ by 1e-14.
    let rest = |s: f64| (layer.normal_compliance(s / h) / h - half_space / s.max(1e-12)) * libm::j1(s * r / h);
    r / TAU * (half_space + integral(1e-9, 20.0, 60 + (20.0 * r / h) as usize, rest))
}

/// Simpson's rule on `panels` parts, with Gauss's three points in each.
fn integral(from: f64, to: f64, panels: usize, value: impl Fn(f64) -> f64) -> f64 {
    let step = (to - from) / panels as f64;
    let panel = |k: usize| {
        let middle = from + (k as f64 + 0.5) * step;
        let off = 0.6_f64.sqrt() * step / 2.0;
        (5.0 * value(middle - off) + 8.0 * value(middle) + 5.0 * value(middle + off)) / 18.0
    };
    (0..panels).map(panel).sum::<f64>() * step
}
