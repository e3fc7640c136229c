//! Light that one part of the coat throws onto another.
//!
//! A dent's flank sees its surroundings rise, and receives a share of the light that they scatter. With H the horizon's
//! slope in an azimuth, what rises hides H^2 / (1 + H^2) of the light of an even sky from that side. The mean over all
//! azimuths, S, times the light around, E averaged over some tenths of a millimetre, times the coat's albedo, is the
//! light of one bounce but for a factor: what is around is not lit as the mean is, and only what faces the point
//! counts. The factor was fitted to traced light (docs/explanation/light.md).

use serde::{Deserialize, Serialize};

use super::horizons::Horizons;
use crate::base::grid::Grid;
use crate::base::simd::simd_dispatch;

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
/// The Gaussian ends after so many standard deviations.
const TAIL: f64 = 2.0;

/// Returns how far around a point light is averaged, pixels of a grid.
pub(crate) fn radius_px(pixel_mm: [f64; 2]) -> [usize; 2] {
    pixel_mm.map(|mm| libm::ceil(TAIL * AROUND_MM / mm) as usize)
}

/// Computes the share of an even sky's light that each point loses to what rises around it.
pub(crate) fn hidden_sky(horizons: &Horizons) -> Vec<f32> {
    let least = hidden_share(FLATTEST_SLOPE);
    horizons.mean_over_azimuths(
        #[inline(always)]
        |slope| if slope > FLATTEST_SLOPE { hidden_share(slope) - least } else { 0.0 },
    )
}

/// Turns the light that each point receives from the LEDs, by channel, into that which it receives from its
/// surroundings. `hidden` are the shares of [`hidden_sky`] there.
pub(crate) fn bounce(direct: &mut [Grid<f32>; 3], hidden: &[f32], pixel_mm: [f64; 2], albedo: f64) {
    let gain = GAIN * albedo as f32;
    for plane in direct {
        average(plane, pixel_mm);
        for (light, hidden) in plane.data.iter_mut().zip(hidden) {
            *light *= gain * hidden;
        }
    }
}

/// Returns the share of an even sky's light, from the side of an azimuth, that a horizon hides.
#[inline(always)]
fn hidden_share(slope: f32) -> f32 {
    let square = slope * slope;
    square / (1.0 + square)
}

/// Averages a grid by the Gaussian; beyond its border it goes on as there.
fn average(plane: &mut Grid<f32>, pixel_mm: [f64; 2]) {
    let radius = radius_px(pixel_mm);
    let [across, down] = [0, 1].map(|k| weights(radius[k], pixel_mm[k]));
    let (width, height) = (plane.width, plane.height);
    let mut wide = vec![0.0; width + 2 * radius[0]];
    let mut sums = Grid::<f32>::new(width, height);
    simd_dispatch(
        #[inline(always)]
        || {
            for y in 0..height {
                let row = plane.row_mut(y);
                wide[..radius[0]].fill(row[0]);
                wide[radius[0]..][..width].copy_from_slice(row);
                wide[radius[0] + width..].fill(row[width - 1]);
                row.fill(0.0);
                for (k, weight) in across.iter().enumerate() {
                    for (sum, value) in row.iter_mut().zip(&wide[k..][..width]) {
                        *sum += weight * value;
                    }
                }
            }
            for y in 0..height {
                let sums = sums.row_mut(y);
                for (k, weight) in down.iter().enumerate() {
                    let from = (y + k).saturating_sub(radius[1]).min(height - 1);
                    for (sum, value) in sums.iter_mut().zip(plane.row(from)) {
                        *sum += weight * value;
                    }
                }
            }
        },
    );
    *plane = sums;
}

/// Returns the weights of the Gaussian, whose sum is 1.
fn weights(radius: usize, pixel_mm: f64) -> Vec<f32> {
    let weight = |k: usize| {
        let away = (k as f64 - radius as f64) * pixel_mm / AROUND_MM;
        libm::exp(-0.5 * away * away)
    };
    let all: Vec<f64> = (0..=2 * radius).map(weight).collect();
    let sum: f64 = all.iter().sum();
    all.iter().map(|weight| (weight / sum) as f32).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_even_light_stays_and_a_point_becomes_the_gaussian() {
        let mut even = Grid { width: 9, height: 4, data: vec![2.0; 36] };
        average(&mut even, [0.2, 0.3]);
        assert!(even.data.iter().all(|value| (value - 2.0).abs() < 1e-5), "{:?}", even.data);
        let mut point = Grid::new(41, 41);
        point.data[20 * 41 + 20] = 1.0;
        average(&mut point, [0.1, 0.1]);
        let variance: f32 = (0..41).map(|x| point.row(20)[x] * 0.01 * (x as f32 - 20.0).powi(2)).sum::<f32>()
            / point.row(20).iter().sum::<f32>();
        assert!((variance.sqrt() - 0.8).abs() < 0.12, "the tails are cut: {}", variance.sqrt());
    }
}
