//! `[[photometric]]`: stands in for the recipes.

use image::RgbImage;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::camera::Image;
use crate::config::quantity::Quantity;
use crate::config::sensor::Sensor;
use crate::depth::Camera;
use crate::optics::background::{Reference, quantise};
use crate::plan::check::Check;
use crate::rng::{Stage, stream};

pub mod noise;
use noise::Level;

/// One `[[photometric]]` table. What is left out changes nothing.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(default, deny_unknown_fields)]
pub struct Photometric {
    /// Images made of each real one, 1 to 1000.
    pub copies: u32,
    /// Exposure: display values times 2 to this power, -4 to 4.
    pub exposure_ev: Quantity,
}

impl Default for Photometric {
    fn default() -> Self {
        Self { copies: 1, exposure_ev: Quantity::Constant(0.0) }
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

/// A table made ready for one sensor.
#[derive(Clone, Debug)]
pub struct Recipe {
    laws: Photometric,
}

/// What was drawn for one image and done to it.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Applied {
    /// Display values were multiplied by 2 to this power.
    pub exposure_ev: f64,
}

impl Photometric {
    /// Finds every mistake in the table at the dotted path `at`.
    pub fn check(&self, check: &mut Check<'_>, at: &str, _taken: Option<&Taken>) {
        check.number(&format!("{at}.copies"), f64::from(self.copies), 1.0..=1000.0, "images");
        check.quantity(&format!("{at}.exposure_ev"), &self.exposure_ev, -4.0..=4.0, "");
    }

    /// Makes the table ready.
    pub fn ready(&self, _check: &mut Check<'_>, _at: &str, _taken: &Taken) -> Option<Recipe> {
        Some(Recipe { laws: self.clone() })
    }
}

impl Recipe {
    /// How many images are wanted of each real one.
    pub fn copies(&self) -> u32 {
        self.laws.copies
    }

    /// Augments an image.
    pub fn apply(&self, image: &RgbImage, seed: u64, number: u64) -> (Image, Applied) {
        let exposure_ev = stream(seed, Stage::Exposure, number).draw(&self.laws.exposure_ev);
        let gain = libm::exp2(exposure_ev);
        let mut out = Image::black(image.width() as usize, image.height() as usize);
        for (to, from) in out.rgb.iter_mut().zip(image.as_raw()) {
            *to = quantise((gain * f64::from(*from) / 255.0) as f32);
        }
        (out, Applied { exposure_ev })
    }
}
