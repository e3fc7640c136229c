//! `[[photometric]]`: a real image as another lamp, another pad's coating or another camera would have shown it.
//!
//! All of it acts on display values, as the simulator's own camera does, and by that camera's code: the picture of
//! another untouched pad takes the place of its own ([`background`]), then come lens, print, gains and noise ([`recipe`]).
//! Nothing moves a pixel: a mirrored, turned or cropped image would have its light on the wrong side.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::camera::print::Markers;
use crate::config::quantity::Quantity;
use crate::config::sensor::Sensor;
use crate::depth::Camera;
use crate::optics::background::Reference;
use crate::plan::check::Check;
use crate::plan::ranges;

pub mod background;
pub mod noise;
pub mod recipe;
#[cfg(test)]
mod tests;

use noise::Level;
pub use recipe::{Applied, Recipe};

/// One `[[photometric]]` table. What is left out changes nothing.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(default, deny_unknown_fields)]
pub struct Photometric {
    /// Images made of each real one, 1 to 1000.
    pub copies: u32,
    /// Pictures of untouched pads, relative to the file this stands in, or `"rendered"` for the one that the sensor
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
    /// Standard deviation of a blur, px along x, and as many mm along y, 0 to 20.
    pub blur_px: Quantity,
    /// Share of the light that is lost in the image's corners, 0 to 1; elsewhere in proportion to the square of the
    /// distance from the middle.
    pub vignette: Quantity,
    /// Dots printed on the pad, at rest.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub markers: Option<Markers>,
}

impl Default for Photometric {
    fn default() -> Self {
        let (zero, one) = (Quantity::Constant(0.0), Quantity::Constant(1.0));
        Self {
            copies: 1,
            background: Vec::new(),
            led_gain: one.clone(),
            white_balance: one,
            exposure_ev: zero.clone(),
            noise_level: zero.clone(),
            blur_px: zero.clone(),
            vignette: zero,
            markers: None,
        }
    }
}

/// The sensor that took the images of a set.
#[derive(Clone, Debug)]
pub struct Taken {
    /// Its values.
    pub sensor: Sensor,
    /// What the images show: their size, and the pitch of their pixels on the pad.
    pub view: Camera,
    /// The untouched pad as the set shows it, of the images' size.
    pub background: Option<Reference>,
    /// Its noise, if it is known.
    pub noise: Option<Level>,
}

impl Photometric {
    /// Finds every mistake in the table at the dotted path `at` (`photometric.0`). `taken` is the sensor, as far as it is
    /// known.
    pub fn check(&self, check: &mut Check<'_>, at: &str, taken: Option<&Taken>) {
        let key = |name: &str| format!("{at}.{name}");
        check.number(&key("copies"), f64::from(self.copies), 1.0..=1000.0, "images");
        check.quantity(&key("led_gain"), &self.led_gain, 0.01..=100.0, "");
        check.quantity(&key("white_balance"), &self.white_balance, 0.01..=100.0, "");
        check.quantity(&key("exposure_ev"), &self.exposure_ev, -4.0..=4.0, "");
        check.quantity(&key("noise_level"), &self.noise_level, 0.0..=20.0, "times the sensor's");
        check.quantity(&key("blur_px"), &self.blur_px, 0.0..=20.0, "px");
        check.quantity(&key("vignette"), &self.vignette, 0.0..=1.0, "");
        if let Some(markers) = &self.markers {
            let view = taken.map(|taken| taken.sensor.field_of_view_mm);
            ranges::markers(check, &key("markers"), markers, view);
        }
        let Some(taken) = taken else { return };
        if self.noise_level.support() != (0.0, 0.0) && taken.noise.is_none() {
            let help = "give [sensor.camera] read_noise_levels, or at least two images of one size to measure it from";
            check.wrong(&key("noise_level"), "nothing is known of this sensor's noise", help);
        }
        if !self.background.is_empty() && taken.background.is_none() {
            let help = "name the set's picture of the untouched pad: [input] background = \"...\"";
            check.wrong(&key("background"), "the image's own background is not known", help);
        }
    }

    /// Makes the table at the dotted path `at` ready, with the pictures that it names. `None` after a mistake.
    pub fn ready(&self, check: &mut Check<'_>, at: &str, taken: &Taken) -> Option<Recipe> {
        let swaps = background::read(check, &format!("{at}.background"), &self.background, taken);
        check.sound(at).then(|| Recipe::new(self.clone(), taken, swaps))
    }
}
