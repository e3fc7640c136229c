//! How the light of an LED varies over the pad: a polynomial of the place, for each channel.
//!
//! LEDs shine through light guides, walls and the gel, so what reaches a place of a real pad follows neither from the
//! distance nor from the picture of the untouched pad. A polynomial of the second degree holds what presses all over
//! the pad show. The model is ours.

use serde::{Deserialize, Serialize};

/// Most coefficients of a channel: of 1, x, y, x^2, x y and y^2.
pub const MOST_TERMS: usize = 6;
/// How many coefficients a channel may have: an even light, one linear in the place, and a quadratic one.
pub const TERM_COUNTS: [usize; 3] = [1, 3, MOST_TERMS];

/// Factors on the colour of an LED over the pad.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
#[serde(default, deny_unknown_fields)]
pub struct LightPattern {
    /// Coefficients of red for 1, x, y, x^2, x y and y^2, with x and y from -1 to 1 over the image: one, three or six of
    /// them, -100 to 100. Where the sum is below 0, it is 0.
    pub red: Vec<f64>,
    /// Coefficients of green, in the same order.
    pub green: Vec<f64>,
    /// Coefficients of blue, in the same order.
    pub blue: Vec<f64>,
}

impl Default for LightPattern {
    fn default() -> Self {
        Self { red: vec![1.0], green: vec![1.0], blue: vec![1.0] }
    }
}

impl LightPattern {
    /// Returns the coefficients of red, green and blue.
    pub fn channels(&self) -> [&[f64]; 3] {
        [&self.red, &self.green, &self.blue]
    }

    /// Returns all coefficients of red, green and blue: those that are not given are 0.
    pub fn all_terms(&self) -> [[f64; MOST_TERMS]; 3] {
        self.channels().map(|terms| std::array::from_fn(|k| terms.get(k).copied().unwrap_or(0.0)))
    }
}

/// Colour times intensity of an LED, over the view.
#[derive(Clone, Debug)]
pub(crate) struct LightColor {
    /// Without a pattern.
    pub even: [f32; 3],
    /// For each channel the coefficients of 1, x, y, x^2, x y and y^2; `None` if the light is the same everywhere.
    pub terms: Option<[[f32; MOST_TERMS]; 3]>,
}

impl LightColor {
    /// Makes the colour of an LED.
    pub fn new(color: [f64; 3], intensity: f64, pattern: Option<&LightPattern>) -> Self {
        let terms = pattern.map(|pattern| {
            let all = pattern.all_terms();
            std::array::from_fn(|channel| all[channel].map(|term| (color[channel] * intensity * term) as f32))
        });
        Self { even: color.map(|share| (share * intensity) as f32), terms }
    }

    /// Returns a bound on each channel.
    pub fn most(&self) -> [f32; 3] {
        match &self.terms {
            None => self.even,
            Some(terms) => terms.map(|terms| terms.iter().map(|term| term.abs()).sum()),
        }
    }

    /// Adds to each channel's row at y this colour times what a row gains over `flat`. `columns` are the places along
    /// the row, x and y from -1 to 1.
    #[inline(always)]
    pub fn add_to_row(&self, gain: &[f32], flat: f32, columns: &[f32], y: f32, [red, green, blue]: [&mut [f32]; 3]) {
        let width = gain.len();
        let (red, green, blue, columns) =
            (&mut red[..width], &mut green[..width], &mut blue[..width], &columns[..width]);
        match &self.terms {
            None => {
                let color = self.even;
                for x in 0..width {
                    let gain = gain[x] - flat;
                    red[x] += gain * color[0];
                    green[x] += gain * color[1];
                    blue[x] += gain * color[2];
                }
            }
            Some(terms) => {
                let [of_red, of_green, of_blue] = terms.each_ref().map(|terms| along_row(terms, y));
                for x in 0..width {
                    let (gain, at) = (gain[x] - flat, columns[x]);
                    red[x] += gain * of_red.at(at);
                    green[x] += gain * of_green.at(at);
                    blue[x] += gain * of_blue.at(at);
                }
            }
        }
    }
}

/// A polynomial of the place along a row.
#[derive(Clone, Copy)]
pub(crate) struct RowPolynomial([f32; 3]);

impl RowPolynomial {
    /// Computes it, no less than 0, at x.
    #[inline(always)]
    pub fn at(self, x: f32) -> f32 {
        let [a, b, c] = self.0;
        (a + x * (b + x * c)).max(0.0)
    }
}

/// Returns the polynomial with these coefficients along the row at y.
pub(crate) fn along_row([one, x, y, xx, xy, yy]: &[f32; MOST_TERMS], at_y: f32) -> RowPolynomial {
    RowPolynomial([one + at_y * (y + at_y * yy), x + at_y * xy, *xx])
}

/// Returns where a pixel lies along a side of `size` pixels, -1 to 1.
pub(crate) fn place_along(size: usize, pixel: usize) -> f32 {
    (2.0 * pixel as f32 + 1.0) / size as f32 - 1.0
}
