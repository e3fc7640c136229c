//! The window between gel and air, in which the pad sees its LEDs a second time.
//!
//! Light that meets the window from within is reflected by Fresnel's share R, and all of it beyond the critical angle
//! (Fresnel 1823; unpolarised light is the mean of both polarisations). So each LED has an image as far behind the
//! window as it stands before it. R rises without bound at the critical angle. An LED is no point, so R is averaged over
//! the range of angles that it spans.

use serde::{Deserialize, Serialize};

/// Half the range of cosines over which the reflected share is averaged: about what an LED of 1 mm spans at 15 mm.
const HALF_SPAN: f64 = 0.03;
/// Steps of the table from a cosine of 0 to 1.
const STEPS: usize = 256;
/// Points at which the share is taken to average it.
const AVERAGED: usize = 64;

/// The window between gel and air.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
#[serde(deny_unknown_fields)]
pub struct Window {
    /// Distance from the untouched coat, mm, 0.01 to 1000. The LEDs are nearer to the coat than the window.
    pub distance_mm: f64,
    /// Refractive index of gel and window over that of air, 1 to 3.
    #[serde(default = "default_refractive_index")]
    pub refractive_index: f64,
}

/// Refractive index of silicone over that of air.
pub(crate) const SILICONE_INDEX: f64 = 1.41;

fn default_refractive_index() -> f64 {
    SILICONE_INDEX
}

/// Share of light that a window reflects, by the cosine of the angle at which the light meets it.
#[derive(Clone, Debug)]
pub(crate) struct ReflectedShares {
    table: Vec<f32>,
    /// Bound on the change of the share, per unit of the cosine.
    pub most_per_cosine: f64,
}

impl ReflectedShares {
    pub fn new(refractive_index: f64) -> Self {
        let averaged = |step: usize| {
            let middle = step as f64 / STEPS as f64;
            let at = |k: usize| middle + HALF_SPAN * ((2 * k + 1) as f64 / AVERAGED as f64 - 1.0);
            (0..AVERAGED).map(|k| fresnel(refractive_index, at(k))).sum::<f64>() / AVERAGED as f64
        };
        // Once more the last value, so that a cosine of 1 has a neighbour.
        let table: Vec<f64> = (0..=STEPS + 1).map(|step| averaged(step.min(STEPS))).collect();
        let steepest = table.windows(2).map(|pair| (pair[1] - pair[0]).abs()).fold(0.0, f64::max);
        Self {
            table: table.iter().map(|share| *share as f32).collect(),
            // Half a percent more, for rounding to 32 bits.
            most_per_cosine: 1.005 * steepest * STEPS as f64,
        }
    }

    /// Returns the reflected share at a cosine from 0 to 1.
    #[inline(always)]
    pub fn at_cosine(&self, cosine: f32) -> f32 {
        let at = cosine.clamp(0.0, 1.0) * STEPS as f32;
        let step = at as usize;
        let (below, above) = (self.table[step], self.table[step + 1]);
        below + (above - below) * (at - step as f32)
    }
}

/// Returns the share of unpolarised light that is reflected from within a body, by its refractive index and the cosine
/// of the angle to the surface's normal.
pub fn fresnel(refractive_index: f64, cosine: f64) -> f64 {
    let cosine = cosine.abs().min(1.0);
    let sine_outside_squared = refractive_index * refractive_index * (1.0 - cosine * cosine);
    if sine_outside_squared >= 1.0 {
        return 1.0;
    }
    let outside = (1.0 - sine_outside_squared).sqrt();
    let across = (refractive_index * cosine - outside) / (refractive_index * cosine + outside);
    let within = (cosine - refractive_index * outside) / (cosine + refractive_index * outside);
    0.5 * (across * across + within * within)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn light_is_reflected_as_fresnel_says() {
        let index = 1.41;
        assert!((fresnel(index, 1.0) - (0.41_f64 / 2.41).powi(2)).abs() < 1e-12, "straight on");
        let critical = (1.0 - 1.0 / (index * index)).sqrt();
        assert_eq!(fresnel(index, critical - 1e-9), 1.0, "beyond the critical angle of 45.2 degrees");
        assert!(fresnel(index, critical + 1e-3) < 0.9);
        // At Brewster's angle, tan = 1 / index from within, only one polarisation is reflected.
        let brewster = (1.0 / index).atan();
        let outside = (index * brewster.sin()).asin();
        let expected = 0.5 * ((brewster - outside).sin() / (brewster + outside).sin()).powi(2);
        assert!((fresnel(index, brewster.cos()) - expected).abs() < 1e-12);
    }

    #[test]
    fn the_table_is_the_mean_over_an_led_and_changes_no_faster_than_it_says() {
        for index in [1.0, 1.2, 1.41, 1.5, 3.0] {
            let shares = ReflectedShares::new(index);
            for k in 0..2000 {
                let cosine = f64::from(k) / 2000.0;
                let share = f64::from(shares.at_cosine(cosine as f32));
                let around = (0..400).map(|j| fresnel(index, cosine + HALF_SPAN * (f64::from(j) / 199.5 - 1.0)));
                let mean = around.sum::<f64>() / 400.0;
                assert!((share - mean).abs() < 0.02, "{index} {cosine}: {share}, not {mean}");
                let next = f64::from(shares.at_cosine((cosine + 1e-3) as f32));
                assert!((next - share).abs() <= shares.most_per_cosine * 1e-3 + 1e-6, "{index} {cosine}");
            }
            assert!(shares.at_cosine(f32::NAN).is_nan() || shares.at_cosine(f32::NAN) <= 1.0);
        }
    }
}
