//! `[camera]`: the distributions that each sample's camera is drawn from.

use serde::{Deserialize, Serialize};

use super::quantity::Quantity;
use gelsim_core::camera::CameraParams;

/// The `[camera]` table. A key that is left out has the value of an ideal camera.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "formats", derive(schemars::JsonSchema))]
#[serde(default, deny_unknown_fields)]
#[cfg_attr(feature = "formats", schemars(rename = "Settings"))]
pub struct CameraDistribution {
    /// Radial distortion k1: a pixel at distance r from the middle, in half diagonals, shows what an ideal lens would
    /// show at r (1 + k1 r^2 + k2 r^4). Above 0 is barrel-shaped.
    pub distortion_k1: Quantity,
    /// Radial distortion k2.
    pub distortion_k2: Quantity,
    /// Fraction of the light that is lost in the image's corners, 0 to 1; elsewhere in proportion to r^2.
    pub vignette: Quantity,
    /// Standard deviation of the blur, mm on the pad, 0 to 1.
    pub defocus_mm: Quantity,
    /// Factor on all brightness, 0.01 to 100.
    pub exposure: Quantity,
    /// Factor on red, 0.01 to 100.
    pub red_gain: Quantity,
    /// Factor on blue, 0.01 to 100.
    pub blue_gain: Quantity,
    /// Standard deviation of the shot noise of a white pixel, grey levels of 255. For other pixels it is in proportion
    /// to the root of their brightness.
    pub shot_noise_levels: Quantity,
    /// Standard deviation of the read noise, grey levels of 255.
    pub read_noise_levels: Quantity,
    /// Factors on the noise of red, green and blue, 0 to 10.
    pub noise_color: [f64; 3],
    /// Correlation of the noise of neighbouring pixels, 0 to 0.7.
    pub noise_correlation: Quantity,
    /// Standard deviation of the speckle that the skin shows where it is touched, grey levels of 255. It is different
    /// in each press.
    pub speckle_levels: Quantity,
    /// Fraction of full scale from which a pixel is white, and below which it is black, 0 to 1; 0 leaves the image as
    /// it is.
    pub threshold: f64,
}

impl Default for CameraDistribution {
    fn default() -> Self {
        let (zero, one) = (Quantity::Constant(0.0), Quantity::Constant(1.0));
        Self {
            distortion_k1: zero.clone(),
            distortion_k2: zero.clone(),
            vignette: zero.clone(),
            defocus_mm: zero.clone(),
            exposure: one.clone(),
            red_gain: one.clone(),
            blue_gain: one,
            shot_noise_levels: zero.clone(),
            read_noise_levels: zero.clone(),
            noise_color: [1.0; 3],
            noise_correlation: zero.clone(),
            speckle_levels: zero,
            threshold: 0.0,
        }
    }
}

impl CameraDistribution {
    /// Draws the camera parameters of one sample. `draw` gets the name of each quantity and returns its value;
    /// `noise_key` selects the sample's noise.
    pub fn sample_params(&self, noise_key: u64, draw: impl Fn(&str, &Quantity) -> f64) -> CameraParams {
        let exposure = draw("exposure", &self.exposure);
        let mut camera = CameraParams::default();
        camera.distortion = [draw("distortion k1", &self.distortion_k1), draw("distortion k2", &self.distortion_k2)];
        camera.vignette = draw("vignette", &self.vignette);
        camera.defocus_mm = draw("defocus", &self.defocus_mm);
        camera.gains =
            [exposure * draw("red gain", &self.red_gain), exposure, exposure * draw("blue gain", &self.blue_gain)];
        camera.shot_noise_levels = draw("shot noise", &self.shot_noise_levels);
        camera.read_noise_levels = draw("read noise", &self.read_noise_levels);
        camera.noise_color = self.noise_color;
        camera.noise_correlation = draw("noise correlation", &self.noise_correlation);
        camera.speckle_levels = draw("speckle", &self.speckle_levels);
        camera.threshold = self.threshold;
        camera.noise_key = noise_key;
        camera
    }

    /// Returns the camera of the background image. Quantities that vary from sample to sample are ideal there.
    pub fn background_params(&self) -> CameraParams {
        let ideal = |name: &str| if matches!(name, "exposure" | "red gain" | "blue gain") { 1.0 } else { 0.0 };
        self.sample_params(0, |name, quantity| match quantity {
            Quantity::Constant(value) => *value,
            Quantity::Random(_) => ideal(name),
        })
    }
}
