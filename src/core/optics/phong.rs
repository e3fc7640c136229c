//! LEDs with diffuse and specular reflection, over the picture of the untouched pad.
//!
//! Source: Phong (1975); constants and lights of Gomes, Wilson and Luo (2019). With N the surface normal, l the
//! direction to the LED, R = 2 (N.l) N - l and V = (0, 0, -1) towards the camera, an LED gives k_d max(0, N.l) + k_s
//! max(0, R.V)^alpha. The paper adds that to the background image. But a photograph of the untouched pad already holds
//! the light that a flat pad reflects. So the flat pad's own term is subtracted, and an untouched pad gives exactly the
//! background (`equation = "literal"` gives the paper's sum). The darkening with depth is ours: a fraction of the light
//! is lost that grows in proportion to the displacement.
//!
//! The light of LEDs is not even over a real pad: where the untouched pad is bright, a slope changes it more. If a
//! sensor's `stray_light` s is known, what its LEDs add is scaled by what they gave the untouched pad, background - s,
//! in each channel. So LEDs that were fitted to one unit suit the background image of another.
//!
//! Valid for low relief without interreflection; light is added in display values, as in the paper.

use serde::{Deserialize, Serialize};

use crate::base::grid::Resolution;
use crate::base::simd::simd_dispatch;

/// Parameters of Phong shading.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
#[serde(default, deny_unknown_fields)]
pub struct Phong {
    /// k_a: share of the background image that is seen, 0 to 1. Not in the paper: 1.
    pub ambient: f64,
    /// k_d: diffuse reflection, 0 to 10. The paper's: 0.5.
    pub diffuse: f64,
    /// k_s: specular reflection, 0 to 10. The paper's: 0.15.
    pub specular: f64,
    /// alpha: exponent of the specular lobe, 0 to 1000. The paper's: 5.
    pub shininess: f64,
    /// Share of the light lost where the pad is pressed down to the shell, 0 to 1; the sensor's where it is left out.
    /// Not in the paper.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub darkening: Option<f64>,
    /// What is added to the background.
    pub equation: Equation,
    /// Shadows that the surface casts on itself. Not in the paper.
    pub shadows: Shadows,
}

impl Default for Phong {
    fn default() -> Self {
        Self {
            ambient: 1.0,
            diffuse: 0.5,
            specular: 0.15,
            shininess: 5.0,
            darkening: None,
            equation: Equation::Relative,
            shadows: Shadows::Soft(SoftShadows::default()),
        }
    }
}

/// What is added to the background.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
#[serde(rename_all = "snake_case")]
pub enum Equation {
    /// Phong(N) - Phong(flat): an untouched pad is the background.
    Relative,
    /// Phong(N), as the paper writes it: an untouched pad is brighter than the background.
    Literal,
}

/// Shadows that the surface casts on itself.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
#[serde(rename_all = "snake_case")]
pub enum Shadows {
    /// None.
    None,
    /// Of every LED, as soft as its angular size makes them.
    Soft(SoftShadows),
}

/// Parameters of soft shadows.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
#[serde(default, deny_unknown_fields)]
pub struct SoftShadows {
    /// Grid on which shadows are found; in between they are interpolated.
    pub resolution: Resolution,
}

impl Default for SoftShadows {
    fn default() -> Self {
        Self { resolution: Resolution::Half }
    }
}

/// A loop along a row of pixels that raises numbers to a power.
pub(super) trait WithPower {
    /// Runs the loop.
    fn run(self, power: impl Fn(f32) -> f32 + Copy);
}

/// Runs a loop with x -> x^exponent for x >= 0. Small whole exponents are products; others go through `libm`. The loop is
/// all that is compiled for each kind of exponent, so it should hold nothing else.
pub(super) fn run_with_power(exponent: f64, task: impl WithPower) {
    if exponent == 5.0 {
        dispatch_with_power(
            task,
            #[inline(always)]
            |x| (x * x) * (x * x) * x,
        )
    } else if exponent == exponent.trunc() && (0.0..=64.0).contains(&exponent) {
        let exponent = exponent as u32;
        dispatch_with_power(
            task,
            #[inline(always)]
            move |x| (0..exponent).fold(1.0, |product, _| product * x),
        )
    } else {
        let exponent = exponent as f32;
        dispatch_with_power(task, move |x| libm::powf(x, exponent))
    }
}

fn dispatch_with_power(task: impl WithPower, power: impl Fn(f32) -> f32 + Copy) {
    simd_dispatch(
        #[inline(always)]
        || task.run(power),
    );
}
