//! From surface to light: what brightness each pixel sends to the camera.

use crate::base::light::{LazyLight, Light};
use serde::{Deserialize, Serialize};

use crate::base::grid::{Grid, Rect};
use crate::base::view::View;
use crate::effects::EffectLog;
use crate::gelpad::Contact;

pub mod background;
pub mod calibrated;
pub mod coarse;
mod heat;
pub mod lamps;
pub mod led;
mod led_shader;
pub mod light_error;
pub mod light_pattern;
pub mod near_light;
pub mod normals;
pub mod phong;
pub mod residual;
pub mod shadow;
pub mod skin;
mod threshold;

use background::BackgroundImage;
use calibrated::{Calibrated, CalibrationTable};
use lamps::{Lamp, Lamps};
use led::Led;
use near_light::bounce::Coat;
use near_light::window::Window;
use phong::Phong;
use residual::LightResidual;

/// The models of the light.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
#[serde(rename_all = "snake_case")]
pub enum Model {
    /// LEDs at infinity, diffuse and specular reflection (Phong 1975, as used by Gomes, Wilson and Luo 2019).
    Phong(Phong),
    /// LEDs at their distance, with the reflection of `phong`: rows of LEDs with a lobe, their images in the window, and
    /// one bounce between parts of the coat.
    Led(Phong),
    /// Calibrated optics, which `gelsim calibrate` measured on a real sensor; the sensor's `calibration` names the
    /// file. The default where there is one.
    Calibrated(Calibrated),
    /// One grey image under each of the sensor's lamps, as its maker measured them, and their composite in colour; the
    /// sensor's `lamp` tables hold them. The default where there are any.
    Lamps(Lamps),
}

/// What is known of a sensor's light. It decides which model a fidelity level chooses.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum LightSource {
    /// Its LEDs only.
    Leds,
    /// Lamps, each measured on its own.
    Lamps,
    /// A calibration.
    Calibration,
}

impl LightSource {
    /// Returns what is known of a sensor that may have a calibration and lamps; a calibration comes first.
    pub fn new(has_calibration: bool, lamps: &[Lamp]) -> Self {
        match (has_calibration, lamps) {
            (true, _) => Self::Calibration,
            (false, []) => Self::Leds,
            (false, _) => Self::Lamps,
        }
    }
}

impl Model {
    /// Returns the model's name in jobs and labels.
    pub fn name(&self) -> &'static str {
        match self {
            Self::Phong(_) => "phong",
            Self::Led(_) => "led",
            Self::Calibrated(_) => "calibrated",
            Self::Lamps(_) => "lamps",
        }
    }

    /// Returns the parameters of the models with LEDs, to be changed; `None` for the others.
    pub fn phong_mut(&mut self) -> Option<&mut Phong> {
        match self {
            Self::Phong(phong) | Self::Led(phong) => Some(phong),
            Self::Calibrated(_) | Self::Lamps(_) => None,
        }
    }

    /// Returns the parameters of the models with LEDs; `None` for the others.
    pub fn phong(&self) -> Option<&Phong> {
        match self {
            Self::Phong(phong) | Self::Led(phong) => Some(phong),
            Self::Calibrated(_) | Self::Lamps(_) => None,
        }
    }
}

/// What decides a sensor's light, besides the background image.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Illumination<'a> {
    /// The LEDs.
    pub leds: &'a [Led],
    /// The lamps.
    pub lamps: &'a [Lamp],
    /// Width and height of the pad's window that the image shows, mm.
    pub field_of_view_mm: [f64; 2],
    /// Thickness of the pad, mm.
    pub thickness_mm: f64,
    /// True if the background image is a photograph.
    pub is_photograph: bool,
    /// Fraction of the light that is lost where the pad is pressed down to the shell.
    pub darkening: f64,
    /// Light of the background image that is not the LEDs', 0 to 1 in each channel: what the LEDs add is scaled by the
    /// rest of that image. `None`: it is not scaled.
    pub stray_light: Option<[f64; 3]>,
    /// Light that the LEDs leave unexplained.
    pub residual: Option<&'a LightResidual>,
    /// The window in which near LEDs are mirrored.
    pub window: Option<&'a Window>,
    /// How the coat reflects.
    pub coat: Coat,
}

impl Illumination<'_> {
    /// Returns the fraction of the light that is lost per mm of displacement.
    fn darkening_per_mm(&self, phong: &Phong) -> f64 {
        phong.darkening.unwrap_or(self.darkening) / self.thickness_mm
    }
}

/// A model prepared for one sensor: everything that is the same in every sample.
pub enum Shader {
    /// See [`Model::Phong`] and [`Model::Led`].
    Leds(Box<led_shader::LedShader>),
    /// See [`Model::Calibrated`].
    Calibrated(Box<calibrated::CalibratedShader>),
    /// See [`Model::Lamps`].
    Lamps(Box<lamps::LampShader>),
}

impl Shader {
    /// Prepares `model` for a sensor whose pad has `relief` at rest. `table` is the sensor's calibration; with
    /// calibrated optics and no table, no press changes the picture.
    pub fn new(
        model: &Model,
        table: Option<&CalibrationTable>,
        light: &Illumination,
        view: &View,
        relief: Option<Grid<f32>>,
    ) -> Self {
        let leds = |phong, near| Self::Leds(Box::new(led_shader::LedShader::new(phong, near, light, view, relief)));
        match model {
            Model::Phong(phong) => leds(*phong, false),
            Model::Led(phong) => leds(*phong, true),
            Model::Calibrated(calibrated) => {
                Self::Calibrated(Box::new(calibrated::CalibratedShader::new(*calibrated, table, view)))
            }
            Model::Lamps(_) => Self::Lamps(Box::new(lamps::LampShader::new(light.lamps, view))),
        }
    }

    /// Returns true if the model averages light within pixels.
    pub(crate) fn averages_within_pixels(&self) -> bool {
        matches!(self, Self::Leds(_))
    }

    /// Returns the fraction of the pixels in contact that are steeper or deeper than the presses that a calibration was
    /// fitted to; 0 with another model.
    pub fn extrapolated_fraction(&self, contact: &Contact) -> f64 {
        match self {
            Self::Leds(_) | Self::Lamps(_) => 0.0,
            Self::Calibrated(calibrated) => calibrated.extrapolated_fraction(contact),
        }
    }

    /// Computes the light of the untouched pad over its picture `rest`.
    pub(crate) fn untouched_light(&self, rest: &BackgroundImage) -> Light {
        match self {
            Self::Leds(leds) => leds.untouched_light(rest),
            Self::Calibrated(_) | Self::Lamps(_) => rest.light(Rect::whole(rest.width, rest.height)),
        }
    }

    /// Computes the light from the pad where it differs from that of the untouched pad, whose picture is `rest`.
    pub fn shade<'a>(
        &'a self,
        contact: &'a Contact,
        rest: &'a BackgroundImage,
        effects: &mut EffectLog,
    ) -> LazyLight<'a> {
        match self {
            Self::Leds(leds) => leds.shade(contact, rest, effects),
            Self::Calibrated(calibrated) => calibrated.shade(contact, rest, effects).into(),
            Self::Lamps(lamps) => lamps.shade(contact, rest, effects).into(),
        }
    }
}
