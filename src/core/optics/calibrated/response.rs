//! The colour of a calibrated sensor: a polynomial in the surface's normal, whose coefficients follow from place,
//! height and shadows by a small neural network with one hidden layer.
//!
//! The difference from the untouched pad's picture is, for each channel, the sum over terms m of C_m(s) t_m(n), less
//! the constant term of a flat pad. t_m are the products of n_x and n_y up to the fourth degree; s holds the
//! displacement, the place and the fraction of the sky that is hidden in each of eight directions. A flat, unloaded pad
//! gives exactly the untouched picture. Light and coating change quickly with the normal, so the polynomial is
//! evaluated at every pixel. Its coefficients vary as slowly as heights and shadows do, so they are computed on a
//! coarser grid. The model is ours; a colour that is polynomial in slopes with coefficients by place is Taxim's (Si and
//! Yuan 2022).

use serde::{Deserialize, Serialize};

use crate::optics::shadow::ShadowCaster;

/// Directions into which the sky is divided.
pub const SECTORS: usize = 8;
/// Inputs of the network: displacement, place along x and y, hidden sky in each direction.
pub const INPUTS: usize = 3 + SECTORS;
/// Terms of the polynomial: the constant, and the products of n_x and n_y of degrees 1 to 4.
pub const TERMS: usize = 15;
/// Outputs of the network, a coefficient for each term and channel: red of all terms, then green, then blue.
pub const OUTPUTS: usize = 3 * TERMS;

/// Lowest and highest elevation of the sky that counts, degrees.
pub const SKY_DEG: [f64; 2] = [5.0, 60.0];

/// Slope of a surface that hides none of that sky.
pub const FLATTEST_CASTER: f64 = 0.04;

/// A fitted response: the weights of the network, and the range that it was fitted to.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct CalibrationResponse {
    /// Displacement that is an input of 1, mm.
    pub height_mm: f32,
    /// Distance from the middle of the image that is an input of 1, mm.
    pub place_mm: f32,
    /// Lowest and highest displacement it was fitted to, mm. Others are clamped to them.
    pub heights_mm: [f32; 2],
    /// Largest length of (n_x, n_y) it was fitted to. Steeper normals are clamped to it.
    pub steepest: f32,
    /// For each hidden unit, the weights of the inputs, and its bias.
    pub hidden: Vec<[f32; INPUTS + 1]>,
    /// For each output, the weights of the hidden units and of the inputs, and its bias; levels are fractions of full
    /// scale.
    pub outputs: Vec<Vec<f32>>,
}

impl Default for CalibrationResponse {
    /// A response that changes nothing.
    fn default() -> Self {
        let outputs = vec![vec![0.0; INPUTS + 1]; OUTPUTS];
        Self { height_mm: 1.0, place_mm: 1.0, heights_mm: [0.0; 2], steepest: 1.0, hidden: Vec::new(), outputs }
    }
}

/// Returns the casters that stand for the sky in each direction, for shadows on a grid with pixels of `mm_per_px`.
pub fn sky_casters(mm_per_px: [f64; 2]) -> Vec<ShadowCaster> {
    let [low, high] = SKY_DEG;
    let width = 360.0 / SECTORS as f64;
    let sector = |k| ShadowCaster::new(width * k as f64, 0.5 * (low + high), [width, high - low], mm_per_px);
    (0..SECTORS).map(sector).collect()
}

impl CalibrationResponse {
    /// Checks numbers that came from a file; an error says what is wrong with them.
    pub fn validate(&self) -> Result<(), String> {
        let widths = self.outputs.iter().all(|row| row.len() == self.hidden.len() + INPUTS + 1);
        if self.outputs.len() != OUTPUTS || !widths || self.hidden.len() > 1024 {
            return Err(format!(
                "a response has {OUTPUTS} outputs, each with a weight for every hidden unit (at most 1024) and {INPUTS} \
                 inputs, and a bias"
            ));
        }
        let scales = [self.height_mm, self.place_mm, self.steepest];
        let all = self.hidden.iter().flatten().chain(self.outputs.iter().flatten()).chain(&self.heights_mm);
        if !all.chain(&scales).all(|value| value.abs() <= 1e6) {
            return Err(String::from("a response has a number that is not finite, or larger than a million"));
        }
        let [low, high] = self.heights_mm;
        if scales.iter().any(|scale| *scale < 1e-6) || self.steepest > 1.0 || low > 0.0 || high < 0.0 {
            return Err(String::from(
                "a response's scales are at least 1e-6, its steepest normal at most 1, and its heights include 0",
            ));
        }
        Ok(())
    }

    /// Computes the outputs at one point, slowly and exactly.
    pub(crate) fn outputs_at(&self, inputs: &[f64]) -> Vec<f64> {
        let sum = |weights: &[f32], values: &[f64]| -> f64 {
            weights.iter().zip(values).map(|(weight, value)| f64::from(*weight) * value).sum()
        };
        let hidden: Vec<f64> = self
            .hidden
            .iter()
            .map(|weights| {
                let x = (sum(weights, inputs) + f64::from(weights[INPUTS])).clamp(-3.0, 3.0);
                x * (27.0 + x * x) / (27.0 + 9.0 * x * x)
            })
            .collect();
        let of = |weights: &Vec<f32>| {
            let (from_hidden, rest) = weights.split_at(hidden.len());
            sum(from_hidden, &hidden) + sum(rest, inputs) + f64::from(rest[INPUTS])
        };
        self.outputs.iter().map(of).collect()
    }

    /// Computes the change of red, green and blue at one pixel, as fractions of full scale, slowly and exactly.
    /// `hidden` is the fraction of the sky that is hidden in each direction.
    pub fn change(&self, normal: [f64; 2], height_mm: f64, place_mm: [f64; 2], hidden: [f64; SECTORS]) -> [f64; 3] {
        let [low, high] = self.heights_mm.map(f64::from);
        let mut inputs = vec![height_mm.clamp(low, high) / f64::from(self.height_mm)];
        inputs.extend(place_mm.map(|mm| mm / f64::from(self.place_mm)));
        inputs.extend(hidden);
        let here = self.outputs_at(&inputs);
        // At rest only the place counts: no displacement, no hidden sky.
        inputs.iter_mut().enumerate().filter(|(k, _)| !matches!(k, 1 | 2)).for_each(|(_, input)| *input = 0.0);
        let at_rest = self.outputs_at(&inputs);
        let length = libm::hypot(normal[0], normal[1]);
        let kept = (f64::from(self.steepest) / length).min(1.0);
        let terms = normal_terms((normal[0] * kept) as f32, (normal[1] * kept) as f32);
        std::array::from_fn(|channel| {
            let first = channel * TERMS;
            let sum: f64 = terms.iter().zip(&here[first..]).map(|(term, factor)| f64::from(*term) * factor).sum();
            sum - at_rest[first]
        })
    }

    /// Returns by how much each coefficient can change while the displacement goes from 0 to an input of 1.
    pub fn steepness(&self) -> Vec<f64> {
        let of = |weights: &Vec<f32>| {
            let through: f64 = self.hidden.iter().zip(weights).map(|(unit, w)| f64::from((unit[0] * w).abs())).sum();
            through + f64::from(weights[self.hidden.len()].abs())
        };
        self.outputs.iter().map(of).collect()
    }
}

/// The activation function of the hidden units: close to tanh. It reaches -1 and 1 at -3 and 3, smoothly, and stays
/// there.
#[inline(always)]
pub fn activation(x: f32) -> f32 {
    let x = if x < 3.0 { x } else { 3.0 };
    let x = if x > -3.0 { x } else { -3.0 };
    x * (27.0 + x * x) / (27.0 + 9.0 * x * x)
}

/// Returns the slope of [`activation`] at x.
#[inline(always)]
pub fn activation_slope(x: f32) -> f32 {
    let square = if x.abs() < 3.0 { x * x } else { 9.0 };
    let root = (9.0 - square) / (27.0 + 9.0 * square);
    27.0 / 3.0 * root * root
}

/// For each term from degree 2 on, which two of the terms before it make it as their product.
pub const TERM_FACTORS: [[usize; 2]; TERMS - 3] =
    [[1, 1], [2, 1], [2, 2], [3, 1], [3, 2], [5, 1], [5, 2], [3, 3], [4, 3], [5, 3], [5, 4], [5, 5]];

/// Computes the terms at a normal: 1, n_y, n_x, then their products of degrees 2 to 4, powers of n_x rising.
pub fn normal_terms(x: f32, y: f32) -> [f32; TERMS] {
    let mut terms = [1.0; TERMS];
    (terms[1], terms[2]) = (y, x);
    for (number, [a, b]) in (TERMS - TERM_FACTORS.len()..).zip(TERM_FACTORS) {
        terms[number] = terms[a] * terms[b];
    }
    terms
}

/// The degree of each of [`normal_terms`].
pub const TERM_DEGREES: [i32; TERMS] = [0, 1, 1, 2, 2, 2, 3, 3, 3, 3, 4, 4, 4, 4, 4];

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_hidden_function_is_close_to_tanh_and_its_slope_is_its_own() {
        for k in -5000..=5000 {
            let x = k as f32 * 1e-3;
            assert!((f64::from(activation(x)) - libm::tanh(f64::from(x))).abs() < 0.025, "{x}");
            let slope = (f64::from(activation(x + 1e-2)) - f64::from(activation(x - 1e-2))) / 2e-2;
            assert!((slope - f64::from(activation_slope(x))).abs() < 2e-3, "{x}: {slope}");
        }
        assert_eq!((activation(f32::INFINITY), activation(f32::NEG_INFINITY)), (1.0, -1.0));
    }

    #[test]
    fn terms_have_their_degrees() {
        let [once, twice] = [normal_terms(0.3, -0.2), normal_terms(0.6, -0.4)];
        for m in 0..TERMS {
            assert!((twice[m] - once[m] * 2.0_f32.powi(TERM_DEGREES[m])).abs() < 1e-6, "{m}");
        }
    }
}
