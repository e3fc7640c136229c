//! Light that one part of the coat throws onto another.
//!
//! A dent's flank sees its surroundings rise, and receives a share of the light that they scatter. With H the horizon's
//! slope in an azimuth, what rises hides H^2 / (1 + H^2) of the light of an even sky from that side. The mean over all
//! azimuths, S, times the light around, E averaged over some tenths of a millimetre, times the coat's albedo, is the
//! light of one bounce but for a factor: what is around is not lit as the mean is, and only what faces the point
//! counts. The factor was fitted to traced light (docs/explanation/light.md).

use serde::{Deserialize, Serialize};

use super::horizons::Horizons;
use crate::base::gaussian_blur;

/// Reflection of the coat, which decides how much light one part of it throws onto another.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
#[serde(deny_unknown_fields)]
pub struct Coat {
    /// Share of the light that it scatters, 0 to 1; 0: no bounce.
    pub albedo: f64,
}

/// Slopes of the horizon up to this one throw no light: it would be under a hundredth of the light around.
pub(crate) const FLATTEST_SLOPE: f32 = 0.2;
/// What of the light around a bounce brings, over `albedo` times the share of the sky that is hidden.
const GAIN: f32 = 0.8;
/// Light around a point is averaged by a Gaussian of this standard deviation, mm.
const AROUND_MM: f64 = 0.8;

/// Returns how far around a point light is averaged, pixels of a grid.
pub(crate) fn radius_px(pixel_mm: [f64; 2]) -> usize {
    gaussian_blur::reach_px(sigma_px(pixel_mm))
}

fn sigma_px(pixel_mm: [f64; 2]) -> [f64; 2] {
    pixel_mm.map(|mm| AROUND_MM / mm)
}

/// Computes the share of an even sky's light that each point loses to what rises around it.
pub(crate) fn hidden_sky(horizons: &Horizons) -> Vec<f32> {
    let least = hidden_share(FLATTEST_SLOPE);
    horizons.mean_over_azimuths(
        #[inline(always)]
        |slope| hidden_share(slope.max(FLATTEST_SLOPE)) - least,
    )
}

/// Turns the light that each point of a grid `width` wide receives from the LEDs, by channel, into that which it
/// receives from its surroundings. `hidden` are the shares of [`hidden_sky`] there.
pub(crate) fn bounce(
    direct: &[Vec<f32>; 3],
    width: usize,
    hidden: &[f32],
    pixel_mm: [f64; 2],
    albedo: f64,
) -> [Vec<f32>; 3] {
    let gain = GAIN * albedo as f32;
    let mut around = gaussian_blur::blur_whole(direct, width, hidden.len() / width, sigma_px(pixel_mm));
    for plane in &mut around {
        for (light, hidden) in plane.iter_mut().zip(hidden) {
            *light *= gain * hidden;
        }
    }
    around
}

/// Returns the share of an even sky's light, from the side of an azimuth, that a horizon hides.
#[inline(always)]
fn hidden_share(slope: f32) -> f32 {
    let square = slope * slope;
    square / (1.0 + square)
}
