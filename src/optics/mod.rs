//! From surface to light: what brightness each pixel sends to the camera.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::config::sensor::Sensor;
use crate::depth::Camera;
use crate::gelpad::Contact;
use crate::grid::Rect;

pub mod background;
pub mod normals;
pub mod phong;

use background::Reference;

/// The models of the light.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum Model {
    /// LEDs at infinity, diffuse and specular reflection (Phong 1975, as used by Gomes, Wilson and Luo 2019).
    Phong(phong::Phong),
}

impl Model {
    /// Its name in jobs and labels.
    pub fn name(&self) -> &'static str {
        match self {
            Self::Phong(_) => "phong",
        }
    }
}

/// A model made ready for one sensor: everything that is the same for every sample.
pub enum Shader {
    /// See [`Model::Phong`].
    Phong(phong::Shader),
}

impl Shader {
    /// Prepares `model` for `sensor`.
    pub fn new(model: &Model, sensor: &Sensor, camera: &Camera) -> Self {
        match model {
            Model::Phong(phong) => Self::Phong(phong::Shader::new(phong, sensor, camera)),
        }
    }

    /// True if depth alone takes light away.
    pub fn darkens(&self) -> bool {
        match self {
            Self::Phong(shader) => shader.darkens(),
        }
    }

    /// The light from the pad: `rest` is what the camera sees of it untouched.
    pub fn shade(&self, contact: &Contact, rest: &Reference) -> Light {
        match self {
            Self::Phong(shader) => shader.shade(contact, rest),
        }
    }
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
