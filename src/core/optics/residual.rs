//! Light of a real pad that its LEDs leave unexplained: a polynomial of each channel in the surface's normal and
//! displacement.
//!
//! Coatings, walls of the housing and light that is reflected more than once make a real pad answer to a slope
//! differently from Lambert's and Phong's surfaces, and change its colour where it is pressed in. What presses of a
//! ball show besides the LEDs is fitted by the products of n_x and n_y up to the third degree, and by w, w n_y and w
//! n_x, with w the displacement. Each coefficient may vary linearly over the pad. A flat, unloaded pad shows none of it.
//! Outside the normals and displacements that it was fitted to it stays as at their limits, while the light of the LEDs
//! goes on. The model is ours.

use std::ops::Range;

use serde::{Deserialize, Serialize};

use super::led::Normals;

/// Terms of a channel: n_y, n_x, n_y^2, n_x n_y, n_x^2, n_y^3, n_x n_y^2, n_x^2 n_y, n_x^3, w, w n_y, w n_x.
pub const TERMS: usize = 12;

/// The degree in the normal of each term without w.
const TERM_DEGREES: [i32; 9] = [1, 1, 2, 2, 2, 3, 3, 3, 3];

/// Light that the LEDs leave unexplained.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
#[serde(deny_unknown_fields)]
pub struct LightResidual {
    /// Largest length of (n_x, n_y) it was fitted to, 0.01 to 1. Steeper normals are clamped to it.
    pub steepest: f64,
    /// Lowest and highest displacement it was fitted to, mm: -100 to 0, and 0 to 100. Others are clamped to them.
    pub heights_mm: [f64; 2],
    /// Coefficients of red for n_y, n_x, n_y^2, n_x n_y, n_x^2, n_y^3, n_x n_y^2, n_x^2 n_y, n_x^3, w, w n_y and w n_x,
    /// with w in mm, -100 to 100; scaled by the background as the LEDs are. 12 of them are the same everywhere; of 36
    /// the second dozen counts times x and the third times y, from -1 to 1 over the image.
    pub red: Vec<f64>,
    /// Coefficients of green, in the same order.
    pub green: Vec<f64>,
    /// Coefficients of blue, in the same order.
    pub blue: Vec<f64>,
}

/// How many coefficients a channel may have.
pub const TERM_COUNTS: [usize; 2] = [TERMS, 3 * TERMS];

/// Coefficients of each channel.
type Coefficients<T> = [[T; TERMS]; 3];

impl LightResidual {
    /// Returns the coefficients of red, green and blue.
    pub fn channels(&self) -> [&[f64]; 3] {
        [&self.red, &self.green, &self.blue]
    }

    /// Returns the coefficients that count once (0), times x (1) or times y (2).
    fn part(&self, part: usize) -> Coefficients<f64> {
        self.channels().map(|terms| std::array::from_fn(|k| terms.get(part * TERMS + k).copied().unwrap_or_default()))
    }

    /// Returns for each coefficient the largest size that it has anywhere on the pad.
    fn largest(&self) -> Coefficients<f64> {
        let parts = [0, 1, 2].map(|part| self.part(part));
        std::array::from_fn(|channel| {
            std::array::from_fn(|k| parts.iter().map(|part| part[channel][k].abs()).sum::<f64>())
        })
    }

    /// Returns a bound on the change of each channel by slopes whose angle is below `angle`, rad, at any displacement.
    pub fn change_by_angle(&self, angle: f64) -> [f64; 3] {
        let deepest = self.heights_mm.map(f64::abs).into_iter().fold(0.0, f64::max);
        self.largest().map(|terms| {
            let of_normal: f64 =
                terms.iter().zip(TERM_DEGREES).map(|(term, degree)| term * libm::pow(angle, f64::from(degree))).sum();
            of_normal + (terms[10] + terms[11]) * deepest * angle
        })
    }

    /// Returns the largest change of a channel by the displacement alone, per mm.
    pub fn change_per_mm(&self) -> f64 {
        self.largest().map(|terms| terms[9]).into_iter().fold(0.0, f64::max)
    }

    /// Converts it to the shader's numbers.
    pub(crate) fn prepare(&self) -> PreparedResidual {
        PreparedResidual {
            steepest: self.steepest as f32,
            heights_mm: self.heights_mm.map(|mm| mm as f32),
            parts: [0, 1, 2].map(|part| self.part(part).map(|terms| terms.map(|term| term as f32))),
            varies: self.channels().into_iter().any(|terms| terms.len() > TERMS),
        }
    }
}

/// A [`LightResidual`] in the shader's numbers.
pub struct PreparedResidual {
    steepest: f32,
    heights_mm: [f32; 2],
    /// The coefficients that count once, times x, and times y.
    parts: [Coefficients<f32>; 3],
    /// Whether coefficients vary over the pad.
    pub(crate) varies: bool,
}

/// The residual along a row of pixels.
pub(crate) struct ResidualRow<'a> {
    residual: &'a PreparedResidual,
    /// The coefficients that count once.
    even: Coefficients<f32>,
}

/// Light of the residual along a row or over a part of the view, a plane for each channel.
pub type Planes = [Vec<f32>; 3];

impl PreparedResidual {
    /// Returns the residual along the row at `y`, -1 to 1 over the view.
    pub(crate) fn along_row(&self, y: f32) -> ResidualRow<'_> {
        let [even, _, by_y] = &self.parts;
        let at = |channel: usize, k: usize| match self.varies {
            true => even[channel][k] + y * by_y[channel][k],
            false => even[channel][k],
        };
        ResidualRow { residual: self, even: std::array::from_fn(|channel| std::array::from_fn(|k| at(channel, k))) }
    }
}

impl ResidualRow<'_> {
    /// Adds the residual's light of normals and displacements (mm) to `sums`. `columns` say where they are, -1 to 1 over
    /// the view; they are not used where nothing varies.
    #[inline(always)]
    pub(crate) fn add(&self, normals: &Normals, heights_mm: &[f32], columns: &[f32], sums: [&mut [f32]; 3]) {
        let width = heights_mm.len();
        let (normal_x, normal_y) = (&normals.x[..width], &normals.y[..width]);
        let [red, green, blue] = sums.map(|sum| &mut sum[..width]);
        let PreparedResidual { steepest, heights_mm: [lowest, highest], .. } = *self.residual;
        let inputs = |x: usize| {
            let (nx, ny, w) = (normal_x[x], normal_y[x], heights_mm[x]);
            let length = (nx * nx + ny * ny).sqrt();
            let kept = steepest / if length > steepest { length } else { steepest };
            let w = if w < highest { w } else { highest };
            [nx * kept, ny * kept, if w > lowest { w } else { lowest }]
        };
        if self.residual.varies {
            let (by_x, columns) = (&self.residual.parts[1], &columns[..width]);
            for x in 0..width {
                let (inputs, at) = (inputs(x), columns[x]);
                red[x] += polynomial(&self.even[0], inputs) + at * polynomial(&by_x[0], inputs);
                green[x] += polynomial(&self.even[1], inputs) + at * polynomial(&by_x[1], inputs);
                blue[x] += polynomial(&self.even[2], inputs) + at * polynomial(&by_x[2], inputs);
            }
        } else {
            for x in 0..width {
                let inputs = inputs(x);
                red[x] += polynomial(&self.even[0], inputs);
                green[x] += polynomial(&self.even[1], inputs);
                blue[x] += polynomial(&self.even[2], inputs);
            }
        }
    }
}

/// Computes the sum of the terms.
#[inline(always)]
fn polynomial(c: &[f32; TERMS], [nx, ny, w]: [f32; 3]) -> f32 {
    let by_x = c[1] + nx * (c[4] + nx * c[8]) + ny * (c[3] + nx * c[7]) + w * c[11];
    let by_y = c[0] + ny * (c[2] + ny * c[5] + nx * c[6]) + w * c[10];
    nx * by_x + ny * by_y + w * c[9]
}

/// Sets each plane to `width` zeros.
#[inline(always)]
pub fn reset_planes(planes: &mut Planes, width: usize) {
    for plane in planes {
        plane.clear();
        plane.resize(width, 0.0);
    }
}

/// Returns the same part of each plane.
#[inline(always)]
pub fn slice_planes(planes: &mut Planes, run: Range<usize>) -> [&mut [f32]; 3] {
    planes.each_mut().map(|plane| &mut plane[run.clone()])
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::base::rng::random_stream;

    #[test]
    fn it_is_the_sum_of_its_terms_and_never_more_than_its_bounds() {
        let mut random = random_stream(11, "residual", 0);
        for _ in 0..2000 {
            let mut number = |scale: f64| scale * (2.0 * random.uniform() - 1.0);
            let mut coefficients = |count: usize| (0..count).map(|_| number(1.0)).collect::<Vec<f64>>();
            let [red, green, blue] = [TERMS, 3 * TERMS, TERMS].map(&mut coefficients);
            let residual = LightResidual { steepest: 0.6, heights_mm: [-0.2, 1.5], red, green, blue };
            let (nx, ny, mm, place) = (number(0.7), number(0.7), number(2.0), [number(1.0), number(1.0)]);
            let normals = Normals { x: vec![nx as f32], y: vec![ny as f32], z: vec![0.0] };
            let mut planes = Planes::default();
            reset_planes(&mut planes, 1);
            let [along, down] = place.map(|at| at as f32);
            let prepared = residual.prepare();
            prepared.along_row(down).add(&normals, &[mm as f32], &[along], slice_planes(&mut planes, 0..1));
            let kept = (0.6 / nx.hypot(ny)).min(1.0);
            let (x, y, w) = (nx * kept, ny * kept, mm.clamp(-0.2, 1.5));
            let terms = [y, x, y * y, x * y, x * x, y.powi(3), x * y * y, x * x * y, x.powi(3), w, w * y, w * x];
            let angle = nx.hypot(ny).min(1.0).asin();
            let most = residual.change_by_angle(angle).map(|change| change + residual.change_per_mm() * mm.abs());
            for ((found, coefficients), most) in planes.iter().zip(residual.channels()).zip(most) {
                let factors = [1.0, place[0], place[1]].into_iter().flat_map(|factor| terms.map(|term| factor * term));
                let sum: f64 = factors.zip(coefficients).map(|(term, c)| term * c).sum();
                assert!((f64::from(found[0]) - sum).abs() < 1e-5, "{found:?} for {sum}");
                assert!(sum.abs() <= most, "{sum} over {most}");
            }
        }
    }
}
