//! `[output]`: which layers a sample has besides the tactile image, and how they are stored.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::health::OnUnhealthy;

/// The `[output]` table.
#[derive(Clone, Debug, Serialize, Deserialize, JsonSchema)]
#[serde(default, deny_unknown_fields)]
pub struct Output {
    /// Layers written beside the tactile image.
    pub layers: Vec<Layer>,
    /// How float layers are stored.
    pub exr: Exr,
    /// What becomes of a sample that is not finite, not within bounds or not solved.
    pub on_unhealthy: OnUnhealthy,
}

impl Default for Output {
    fn default() -> Self {
        Self { layers: vec![Layer::Depth], exr: Exr::default(), on_unhealthy: OnUnhealthy::default() }
    }
}

/// A layer of a sample.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum Layer {
    /// How far the object reaches below the undeformed pad surface, mm.
    Depth,
    /// Displacement of the pad's surface, mm, positive into the pad.
    Surface,
    /// 255 where the pad touches the object.
    Contact,
    /// Unit normals of the pad's surface, towards the camera.
    Normal,
    /// Pressure between pad and object, kPa; only from models that solve the contact.
    Pressure,
    /// Rest and moved positions of printed markers; only for sensors that have them.
    Markers,
    /// The image without any contact.
    Reference,
}

impl Layer {
    /// Every layer, in the order in which a sample's members are written.
    pub const ALL: [Self; 7] =
        [Self::Depth, Self::Surface, Self::Contact, Self::Normal, Self::Pressure, Self::Markers, Self::Reference];

    /// The end of the member's name, after the sample's key.
    pub fn suffix(self) -> &'static str {
        match self {
            Self::Depth => "depth.exr",
            Self::Surface => "surface.exr",
            Self::Contact => "contact.png",
            Self::Normal => "normal.exr",
            Self::Pressure => "pressure.exr",
            Self::Markers => "markers.json",
            Self::Reference => "reference.png",
        }
    }
}

/// Storage of float layers.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(default, deny_unknown_fields)]
pub struct Exr {
    /// Precision of a pixel.
    pub pixel: Pixel,
    /// Lossless compression.
    pub compression: Compression,
}

/// Precision of an EXR pixel.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum Pixel {
    /// 16 bits: at most 1 um of rounding below 4 mm.
    #[default]
    Half,
    /// 32 bits: every bit kept.
    Float,
}

/// Compression of an EXR file.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum Compression {
    /// No compression.
    None,
    /// Run lengths: quickest.
    Rle,
    /// Deflate over 16 rows: smallest.
    #[default]
    Zip,
}
