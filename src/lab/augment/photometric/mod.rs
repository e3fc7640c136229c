//! `[[photometric]]`: shows a real image as other LEDs, the coating of another pad or another camera would have shown
//! it.
//!
//! Everything acts on display values, as the simulator's camera does, and uses that camera's code: another pad's
//! picture replaces the image's own background ([`background`]), then come lens, print, gains and noise ([`recipe`]).
//! No pixel is moved: a mirrored, rotated or cropped image would have its light on the wrong side.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use gelsim_core::base::view::View;
use gelsim_core::effects::EffectPolicy;
use gelsim_core::fidelity::Fidelity;
use gelsim_core::optics::background::BackgroundImage;
use gelsim_core::sensor as simulated;
use gelsim_core::simulator::Simulator;
use gelsim_files::sensor::Sensor;
use gelsim_files::sensor::markers::MarkerDistribution;
use gelsim_files::sensor::quantity::Quantity;
use gelsim_job::plan::check::JobChecker;
use gelsim_job::plan::markers::check_markers;
use gelsim_lab::metrics::noise::NoiseLevel;

pub mod background;
pub mod recipe;
#[cfg(test)]
mod tests;

pub use recipe::{AppliedAugmentation, PhotometricRecipe};

/// One `[[photometric]]` table. What is left out changes nothing.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(default, deny_unknown_fields)]
pub struct Photometric {
    /// Images made of each real one, 1 to 1000.
    pub copies: u32,
    /// The splits that get copies; those for training where it is left out.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub splits: Option<Vec<String>>,
    /// Background images, relative to the file this stands in, or `"rendered"` for the one that the sensor
    /// renders: the image gets one of them instead of its own background.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub background: Vec<String>,
    /// Factor on the LEDs of each channel, drawn for red, green and blue by itself, 0.01 to 100.
    pub led_gain: Quantity,
    /// Factor on red and, drawn by itself, on blue, 0.01 to 100.
    pub white_balance: Quantity,
    /// Exposure: display values times 2 to this power, -4 to 4.
    pub exposure_ev: Quantity,
    /// Standard deviation that the image's noise is to have, as a multiple of the sensor's, 0 to 20; noise is only ever
    /// added.
    pub noise_level: Quantity,
    /// Defocus: standard deviation of the blur, px along x, and as many mm along y, 0 to 20.
    #[serde(rename = "blur_px")]
    pub defocus_px: Quantity,
    /// Fraction of the light that is lost in the image's corners, 0 to 1; elsewhere in proportion to the square of the
    /// distance from the middle.
    pub vignette: Quantity,
    /// Markers printed on the pad, at rest.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub markers: Option<MarkerDistribution>,
}

impl Default for Photometric {
    fn default() -> Self {
        let (zero, one) = (Quantity::Constant(0.0), Quantity::Constant(1.0));
        Self {
            copies: 1,
            splits: None,
            background: Vec::new(),
            led_gain: one.clone(),
            white_balance: one,
            exposure_ev: zero.clone(),
            noise_level: zero.clone(),
            defocus_px: zero.clone(),
            vignette: zero,
            markers: None,
        }
    }
}

/// Facts about the sensor that took the images of a set.
#[derive(Clone, Debug)]
pub struct SensorProfile {
    /// Values of the sensor.
    pub sensor: Sensor,
    /// Resolution of the images, and size of their pixels on the pad.
    pub view: View,
    /// Background image of the set, in the images' size.
    pub background: Option<BackgroundImage>,
    /// Noise, if it is known.
    pub noise: Option<NoiseLevel>,
}

impl SensorProfile {
    /// Renders the sensor's background image.
    pub fn render_background(&self) -> BackgroundImage {
        // On a gel that has a shape, the sensor's own camera takes the picture, including its defocus.
        let sensor = self.sensor.to_simulator_sensor(None, &self.sensor.camera.clone().unwrap_or_default());
        render_background(sensor.with_resolution(self.view.resolution_px))
    }
}

/// Renders the image of a sensor's untouched gel; if the gel has a shape, as its camera sees it.
pub fn render_background(sensor: simulated::Sensor) -> BackgroundImage {
    if sensor.shape.is_none() {
        return BackgroundImage::clone(&sensor.background());
    }
    let models = Fidelity::Standard.models(sensor.light_source());
    Simulator::with_models(sensor, models, EffectPolicy::default()).background().clone()
}

impl Photometric {
    /// Checks the table at the dotted path `at` (`photometric.0`). `profile` is the sensor, as far as it is known.
    pub fn check(&self, check: &mut JobChecker<'_>, at: &str, profile: Option<&SensorProfile>) {
        let key = |name: &str| format!("{at}.{name}");
        check.require_in_range(&key("copies"), f64::from(self.copies), 1.0..=1000.0, "images");
        check.require_quantity_in_range(&key("led_gain"), &self.led_gain, 0.01..=100.0, "");
        check.require_quantity_in_range(&key("white_balance"), &self.white_balance, 0.01..=100.0, "");
        check.require_quantity_in_range(&key("exposure_ev"), &self.exposure_ev, -4.0..=4.0, "");
        check.require_quantity_in_range(&key("noise_level"), &self.noise_level, 0.0..=20.0, "times the sensor's");
        check.require_quantity_in_range(&key("blur_px"), &self.defocus_px, 0.0..=20.0, "px");
        check.require_quantity_in_range(&key("vignette"), &self.vignette, 0.0..=1.0, "");
        if let Some(markers) = &self.markers {
            let view = profile.map(|profile| profile.sensor.field_of_view_mm);
            check_markers(check, &key("markers"), markers, view);
        }
        let Some(profile) = profile else { return };
        if profile.sensor.shape.is_some() && self.markers.is_some() {
            let message = "print on a gel that has a shape is not simulated";
            check.report_error(&key("markers"), message, "leave it out, or take a flat sensor");
        }
        if profile.sensor.pins.is_some() && !self.background.is_empty() {
            let message = "in place of another background the pins that a press moved would be seen twice";
            check.report_error(
                &key("background"),
                message,
                "leave it out; [mixing] makes new samples of a sensor with pins",
            );
        }
        if self.noise_level.support() != (0.0, 0.0) && profile.noise.is_none() {
            let help = "give [sensor.camera] read_noise_levels, or at least two images of one size to measure it from";
            check.report_error(&key("noise_level"), "nothing is known of this sensor's noise", help);
        }
        if !self.background.is_empty() && profile.background.is_none() && profile.sensor.pins.is_none() {
            let help = "name the set's background image: [input] background = \"...\"";
            check.report_error(&key("background"), "the image's own background is not known", help);
        }
    }

    /// Builds the recipe of the table at the dotted path `at`, with the pictures that it names. `None` after a mistake.
    pub fn build_recipe(
        &self,
        check: &mut JobChecker<'_>,
        at: &str,
        profile: &SensorProfile,
    ) -> Option<PhotometricRecipe> {
        let swaps = background::read_swaps(check, &format!("{at}.background"), &self.background, profile);
        check.is_valid(at).then(|| PhotometricRecipe::new(self.clone(), profile, swaps))
    }
}
