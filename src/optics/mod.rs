//! From surface to light: what brightness each pixel sends to the camera.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::config::sensor::Sensor;
use crate::depth::Camera;
use crate::effects::Ledger;
use crate::gelpad::Contact;
use crate::grid::{Grid, Rect};

pub mod background;
pub mod calibrated;
pub mod coarse;
mod lamp;
mod leds;
pub mod normals;
pub mod phong;
pub mod shadow;
mod visible;

use background::Reference;
use calibrated::{Calibrated, Table};
use phong::Phong;

/// The models of the light.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum Model {
    /// LEDs at infinity, diffuse and specular reflection (Phong 1975, as used by Gomes, Wilson and Luo 2019).
    Phong(Phong),
    /// The same with LEDs at their distance: direction and brightness differ from pixel to pixel.
    Led(Phong),
    /// What `gelsim calibrate` measured on a real sensor; the sensor's `calibration` names the file. The default where
    /// there is one.
    Calibrated(Calibrated),
}

impl Model {
    /// Its name in jobs and labels.
    pub fn name(&self) -> &'static str {
        match self {
            Self::Phong(_) => "phong",
            Self::Led(_) => "led",
            Self::Calibrated(_) => "calibrated",
        }
    }

    /// Parameters of the models with LEDs.
    pub fn phong(&self) -> Option<&Phong> {
        match self {
            Self::Phong(phong) | Self::Led(phong) => Some(phong),
            Self::Calibrated(_) => None,
        }
    }
}

/// A model made ready for one sensor: everything that is the same for every sample.
pub enum Shader {
    /// See [`Model::Phong`] and [`Model::Led`].
    Leds(Box<leds::Shader>),
    /// See [`Model::Calibrated`].
    Calibrated(Box<calibrated::Shader>),
}

/// Brightness where the press can change it, 1 = full scale; it may leave 0 .. 1. Outside `region` the picture is the
/// untouched pad's, exactly.
#[derive(Clone, Debug, Default)]
pub struct Light {
    /// Part of the view that is held here.
    pub region: Rect,
    /// Red, green and blue of the region's pixels, row-major.
    pub planes: [Vec<f32>; 3],
}

impl Shader {
    /// Prepares `model` for `sensor`, whose pad has `relief` at rest. `table` is what was measured on the sensor; a
    /// calibrated model without any changes nothing.
    pub fn new(
        model: &Model,
        table: Option<&Table>,
        sensor: &Sensor,
        camera: &Camera,
        relief: Option<Grid<f32>>,
    ) -> Self {
        let leds = |phong, near| Self::Leds(Box::new(leds::Shader::new(phong, near, sensor, camera, relief)));
        match model {
            Model::Phong(phong) => leds(*phong, false),
            Model::Led(phong) => leds(*phong, true),
            Model::Calibrated(calibrated) => {
                Self::Calibrated(Box::new(calibrated::Shader::new(*calibrated, table, camera)))
            }
        }
    }

    /// The light of the untouched pad over its picture `rest`.
    pub fn untouched(&self, rest: &Reference) -> Light {
        match self {
            Self::Leds(leds) => leds.untouched(rest),
            Self::Calibrated(_) => rest.light(Rect::whole(rest.width, rest.height)),
        }
    }

    /// The light from the pad where it differs from that of the untouched one, whose picture is `rest`.
    pub fn shade(&self, contact: &Contact, rest: &Reference, effects: &mut Ledger) -> Light {
        match self {
            Self::Leds(leds) => leds.shade(contact, rest, effects),
            Self::Calibrated(calibrated) => calibrated.shade(contact, rest, effects),
        }
    }
}
