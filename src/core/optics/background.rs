//! The picture of the untouched pad: a photograph, or one that is rendered.
//!
//! The rendered one is a plausible look, not a measurement: diffuse light, a glow that falls off from each LED's edge
//! of the image, a vignette, and the fine grain of the coating and specks of dust, which are the same in every sample.
//! The model is ours. A `pattern`, however, is measured: what real pads of a kind have in common, as a polynomial of
//! fourth degree in each channel.

use super::led::Led;
use crate::base::grain::grain_noise;
use crate::base::grid::{Grid, Rect};
use crate::base::light::Light;
use crate::base::light::quantise;
use crate::base::rng::random_stream;
use crate::base::simd::simd_dispatch;
use crate::base::view::View;
use serde::{Deserialize, Serialize};

/// What the camera sees without contact, as 8-bit display values.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct BackgroundImage {
    /// Columns.
    pub width: usize,
    /// Rows.
    pub height: usize,
    /// Row-major RGB.
    pub rgb: Vec<u8>,
    /// The same pixels as one plane per channel.
    pub planes: [Vec<u8>; 3],
    /// Pixels with a channel at full scale.
    pub saturated_px: u64,
}

impl BackgroundImage {
    /// Makes a background image of row-major RGB.
    pub fn new(width: usize, height: usize, rgb: Vec<u8>) -> Self {
        let planes = std::array::from_fn(|k| rgb.iter().skip(k).step_by(3).copied().collect());
        let mut reference = Self { width, height, rgb, planes, saturated_px: 0 };
        reference.saturated_px = reference.count_saturated_pixels(Rect::whole(width, height));
        reference
    }

    /// Returns a part of it as light.
    pub fn light(&self, region: Rect) -> Light {
        let planes = self.planes.each_ref().map(|plane| {
            let mut light = vec![0.0; region.area()];
            simd_dispatch(
                #[inline(always)]
                || {
                    for (row, light) in light.chunks_exact_mut(region.width().max(1)).enumerate() {
                        let levels = &plane[(region.y0 + row) * self.width + region.x0..][..light.len()];
                        for (light, level) in light.iter_mut().zip(levels) {
                            *light = f32::from(*level) * (1.0 / 255.0);
                        }
                    }
                },
            );
            light
        });
        Light { region, planes }
    }

    /// Counts the pixels of a part that have a channel at full scale.
    #[inline(always)]
    pub(crate) fn count_saturated_pixels(&self, part: Rect) -> u64 {
        let [red, green, blue] = &self.planes;
        let mut count = 0;
        for y in part.y0..part.y1 {
            let row = y * self.width + part.x0..y * self.width + part.x1;
            let pixels = red[row.clone()].iter().zip(&green[row.clone()]).zip(&blue[row]);
            let saturated = pixels.map(|((red, green), blue)| u32::from((*red).max(*green).max(*blue) == 255));
            count += u64::from(saturated.sum::<u32>());
        }
        count
    }

    /// Renders the untouched pad of a sensor without a photograph.
    pub(crate) fn render(look: &RenderedBackground, leds: &[Led], field_of_view_mm: [f64; 2], view: &View) -> Self {
        Self::render_with_noise(&look.grain_noise(view), look, leds, field_of_view_mm, view)
    }

    /// Renders the untouched pad with this noise of the coating's grain ([`RenderedBackground::grain_noise`]), which
    /// other looks may share.
    pub(crate) fn render_with_noise(
        grain: &Grid<f32>,
        look: &RenderedBackground,
        leds: &[Led],
        field_of_view_mm: [f64; 2],
        view: &View,
    ) -> Self {
        // The glow falls exponentially with the distance to the LED, which is one along x plus one along y. So it is a
        // product of two factors, which are computed per column and per row.
        let along = |led: &Led, k: usize| -> Vec<f64> {
            let (sin, cos) = led.place().azimuth;
            let (towards, half) = ([cos, sin][k], field_of_view_mm[k] / 2.0);
            let distance =
                |at: usize| half * libm::fabs(towards) - pixel_centre_mm(at, k, field_of_view_mm, view) * towards;
            (0..view.resolution_px[k]).map(|at| libm::exp(-distance(at) / look.glow_reach_mm)).collect()
        };
        let strengths: Vec<[Vec<f64>; 2]> = leds.iter().map(|led| [along(led, 0), along(led, 1)]).collect();
        let glow = |led: usize, [i, j]: [usize; 2]| {
            let [columns, rows] = &strengths[led];
            columns[i] * rows[j]
        };
        Self::render_with_glow(grain, look, leds, field_of_view_mm, view, glow)
    }

    /// Renders the untouched pad with the glow of each LED, 1 at the LED, that `strength` gives for the LED's number
    /// and a pixel's column and row.
    pub(crate) fn render_with_glow(
        grain: &Grid<f32>,
        look: &RenderedBackground,
        leds: &[Led],
        field_of_view_mm: [f64; 2],
        view: &View,
        strength: impl Fn(usize, [usize; 2]) -> f64,
    ) -> Self {
        let [width, height] = view.resolution_px;
        let half = field_of_view_mm.map(|mm| mm / 2.0);
        let corner = half[0] * half[0] + half[1] * half[1];
        let leds = if look.glow == 0.0 { &[] } else { leds };
        let dust = look.dust_transmission(field_of_view_mm, view);
        let columns_mm: Vec<f64> = (0..width).map(|i| pixel_centre_mm(i, 0, field_of_view_mm, view)).collect();
        let (mut colors, mut glow) = ([0; 3].map(|_| vec![0.0; width]), vec![0.0; width]);
        let mut rgb = Vec::with_capacity(width * height * 3);
        for j in 0..height {
            let y = pixel_centre_mm(j, 1, field_of_view_mm, view);
            for (values, color) in colors.iter_mut().zip(look.color) {
                values.fill(color);
            }
            if let Some(pattern) = &look.pattern {
                for (i, x) in columns_mm.iter().enumerate() {
                    let factors = pattern.color_at(x / half[0], y / half[1]);
                    colors.iter_mut().zip(factors).for_each(|(values, factor)| values[i] *= factor);
                }
            }
            for (number, led) in leds.iter().enumerate() {
                for (i, glow) in glow.iter_mut().enumerate() {
                    *glow = look.glow * led.intensity * strength(number, [i, j]);
                }
                simd_dispatch(
                    #[inline(always)]
                    || {
                        for (values, share) in colors.iter_mut().zip(led.color) {
                            for (value, glow) in values.iter_mut().zip(&glow) {
                                // Light that is added to a bright pad saturates softly, and never exceeds white.
                                *value += (glow * share).min(1.0) * (1.0 - *value);
                            }
                        }
                    },
                );
            }
            for (i, x) in columns_mm.iter().enumerate() {
                let kept = 1.0 - look.vignette * (x * x + y * y) / corner;
                let grain = look.grain * f64::from(grain.at(i, j));
                let kept = kept * dust.as_ref().map_or(1.0, |dust| f64::from(dust.at(i, j)));
                rgb.extend(colors.each_ref().map(|values| quantise((values[i] * kept + grain) as f32)));
            }
        }
        Self::new(width, height, rgb)
    }
}

/// What another background image of the same size adds to an image, in grey levels.
#[derive(Clone, Debug)]
pub struct BackgroundChange {
    /// The other background minus the image's own, row-major RGB.
    difference: Vec<i16>,
}

impl BackgroundChange {
    /// Computes the change from a background image to the row-major RGB of another one.
    pub fn new(own: &BackgroundImage, other: &[u8]) -> Self {
        let difference = other.iter().zip(&own.rgb).map(|(other, own)| i16::from(*other) - i16::from(*own));
        Self { difference: difference.collect() }
    }

    /// Returns row-major RGB as light over the other background, 1 = full scale. Values may leave 0 to 1.
    pub fn apply(&self, rgb: &[u8]) -> [Vec<f32>; 3] {
        let levels = |k: usize| {
            let pixels = rgb.iter().zip(&self.difference).skip(k).step_by(3);
            pixels.map(|(level, change)| f32::from(i16::from(*level) + change) * (1.0 / 255.0)).collect()
        };
        std::array::from_fn(levels)
    }
}

/// Returns where the centre of a column (`k` is 0) or of a row (`k` is 1) lies, mm from the middle of the image.
fn pixel_centre_mm(at: usize, k: usize, field_of_view_mm: [f64; 2], view: &View) -> f64 {
    (at as f64 + 0.5) * view.mm_per_px[k] - field_of_view_mm[k] / 2.0
}

/// Largest number of specks of dust that are drawn.
const MAX_SPECKS: f64 = 20_000.0;

/// Parameters of the image that an untouched pad gives, for sensors without a photograph of it.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
#[serde(default, deny_unknown_fields)]
pub struct RenderedBackground {
    /// Red, green and blue of the diffuse light in the pad's middle, 0 to 1.
    pub color: [f64; 3],
    /// Brightness that each LED adds at its edge of the image, times its colour and intensity.
    pub glow: f64,
    /// Distance over which that brightness falls to 37 %, mm.
    pub glow_reach_mm: f64,
    /// Share of the light that is lost in the image's corners, 0 to 1.
    pub vignette: f64,
    /// Standard deviation of the coating's grain, as a share of full scale.
    pub grain: f64,
    /// Size of the grain, mm.
    pub grain_size_mm: f64,
    /// Specks of dust per cm^2 of pad, 0 to 1000.
    pub dust_per_cm2: f64,
    /// Size of the specks, mm: half of the width at which they are half as strong.
    pub dust_size_mm: f64,
    /// How each channel varies over the pad, times `color`.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub pattern: Option<Box<Pattern>>,
}

/// A polynomial of fourth degree for each channel in the place x, y, each from -1 at the left and the top of the image
/// to 1: the coefficients of 1, y, y^2, y^3, y^4, x, x y, x y^2, x y^3, x^2, x^2 y, x^2 y^2, x^3, x^3 y, x^4.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
#[serde(deny_unknown_fields)]
pub struct Pattern {
    /// Coefficients of red.
    pub red: [f64; 15],
    /// Coefficients of green.
    pub green: [f64; 15],
    /// Coefficients of blue.
    pub blue: [f64; 15],
}

impl RenderedBackground {
    /// Computes the noise of the grain over a view, with mean 0 and standard deviation 1.
    pub(crate) fn grain_noise(&self, view: &View) -> Grid<f32> {
        let [width, height] = view.resolution_px;
        grain_noise(width, height, self.grain_size_mm, view, "grain")
    }

    /// Computes the fraction of the light that specks of dust leave, above 1 where they shine; `None` without dust. A
    /// denser pad has the specks of a sparser one, and more.
    fn dust_transmission(&self, field_of_view_mm: [f64; 2], view: &View) -> Option<Grid<f32>> {
        /// Strength of the strongest speck; most are far weaker.
        const STRONGEST: f64 = 0.3;
        /// One speck in so many shines instead of taking light.
        const SHINING: usize = 6;
        let area_cm2 = field_of_view_mm[0] * field_of_view_mm[1] / 100.0;
        // Limited: where a view of metres had more specks, they would look like grain.
        let count = (self.dust_per_cm2 * area_cm2).round().min(MAX_SPECKS) as usize;
        if count == 0 {
            return None;
        }
        let [width, height] = view.resolution_px;
        let mut shares = Grid { width, height, data: vec![1.0; width * height] };
        for number in 0..count {
            let mut random = random_stream(0, "dust", number as u64);
            let middle = [0, 1].map(|k| random.uniform() * view.resolution_px[k] as f64);
            let size_mm = self.dust_size_mm * (0.5 + random.uniform());
            let strength = STRONGEST * random.uniform() * random.uniform();
            let strength = if random.uniform_below(SHINING) == 0 { strength } else { -strength };
            // Never smaller than half a pixel: the camera would blur it to that.
            let reach: [f64; 2] = std::array::from_fn(|k| (size_mm / view.mm_per_px[k]).max(0.5));
            let span = |k: usize| {
                let [first, end] = [-4.0, 4.0].map(|side| middle[k] + side * reach[k]);
                first.max(0.0) as usize..(end.ceil() as usize).min(view.resolution_px[k])
            };
            for y in span(1) {
                for x in span(0) {
                    let away = [x, y].map(|at| at as f64 + 0.5);
                    let away: f64 = (0..2).map(|k| ((away[k] - middle[k]) / reach[k]).powi(2)).sum();
                    shares.row_mut(y)[x] += (strength * libm::exp(-std::f64::consts::LN_2 * away)) as f32;
                }
            }
        }
        // Specks that overlap could take more than all of the light.
        shares.data.iter_mut().for_each(|share| *share = share.max(0.0));
        Some(shares)
    }
}

impl Pattern {
    /// Returns red, green and blue at a place; never below 0.
    fn color_at(&self, x: f64, y: f64) -> [f64; 3] {
        self.polynomial(x, y).map(|value| value.max(0.0))
    }

    /// Returns the polynomials of red, green and blue at a place, x and y from -1 to 1.
    pub fn polynomial(&self, x: f64, y: f64) -> [f64; 3] {
        let powers = |v: f64| [1.0, v, v * v, v * v * v, v * v * v * v];
        let (px, py) = (powers(x), powers(y));
        [&self.red, &self.green, &self.blue]
            .map(|coefficients| term_powers().zip(coefficients).map(|((i, j), c)| c * px[i] * py[j]).sum())
    }
}

/// Returns the powers of x and y that a pattern's coefficients belong to, in their order.
fn term_powers() -> impl Iterator<Item = (usize, usize)> {
    (0..5).flat_map(|i| (0..5 - i).map(move |j| (i, j)))
}

/// Makes numbers that vary together as a pattern's coefficients do from independent ones, the weights of Legendre
/// polynomials, each as strong as the next.
///
/// The coefficients along one direction of real pads balance each other. If they were drawn one by one, they would not.
pub fn correlate_coefficients(independent: &[f64; 15]) -> [f64; 15] {
    /// Coefficients of the powers of x in Legendre polynomials of mean square 1 over -1 to 1.
    const LEGENDRE: [[f64; 5]; 5] = [
        [1.0, 0.0, 0.0, 0.0, 0.0],
        [0.0, 1.732_050_807_568_877_2, 0.0, 0.0, 0.0],
        [-1.118_033_988_749_895, 0.0, 3.354_101_966_249_684_8, 0.0, 0.0],
        [0.0, -3.968_626_966_596_886, 0.0, 6.614_378_277_661_476, 0.0],
        [1.125, 0.0, -11.25, 0.0, 13.125],
    ];
    let mut correlated = [0.0; 15];
    for (correlated, (i, j)) in correlated.iter_mut().zip(term_powers()) {
        let weights = term_powers().map(|(a, b)| LEGENDRE[a][i] * LEGENDRE[b][j]);
        let (sum, squares) = weights
            .zip(independent)
            .fold((0.0, 0.0), |(sum, squares), (weight, number)| (sum + weight * number, squares + weight * weight));
        *correlated = sum / f64::sqrt(squares);
    }
    correlated
}

impl Default for RenderedBackground {
    fn default() -> Self {
        Self {
            color: [0.46, 0.44, 0.48],
            glow: 0.28,
            glow_reach_mm: 5.0,
            vignette: 0.22,
            grain: 0.006,
            grain_size_mm: 0.12,
            dust_per_cm2: 0.0,
            dust_size_mm: 0.06,
            pattern: None,
        }
    }
}
