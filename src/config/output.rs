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
    /// Format of float layers: depth, surface, normal, pressure.
    pub depth_format: DepthFormat,
    /// How those are stored that are EXR pictures.
    pub exr: Exr,
    /// What holds a shard's files.
    pub container: Container,
    /// What becomes of a sample that is not finite, not within bounds or not solved.
    pub on_unhealthy: OnUnhealthy,
}

impl Output {
    /// The layers that are written, each once, in the order of [`Layer::ALL`].
    pub fn layers_in_order(&self) -> Vec<Layer> {
        Layer::ALL.into_iter().filter(|layer| self.layers.contains(layer)).collect()
    }
}

impl Default for Output {
    fn default() -> Self {
        Self {
            layers: vec![Layer::Depth],
            depth_format: DepthFormat::default(),
            exr: Exr::default(),
            container: Container::default(),
            on_unhealthy: OnUnhealthy::default(),
        }
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

    /// Its name in jobs, members and labels.
    pub fn name(self) -> &'static str {
        match self {
            Self::Depth => "depth",
            Self::Surface => "surface",
            Self::Contact => "contact",
            Self::Normal => "normal",
            Self::Pressure => "pressure",
            Self::Markers => "markers",
            Self::Reference => "reference",
        }
    }

    /// How it is written where float layers have the format `format`. Only depth and surface have a range that 16-bit
    /// steps suit.
    pub fn coding(self, format: DepthFormat) -> Coding {
        match (self, format) {
            (Self::Contact | Self::Reference, _) => Coding::Png,
            (Self::Markers, _) => Coding::Json,
            (Self::Depth | Self::Surface, DepthFormat::Png16) => Coding::Png16,
            (_, DepthFormat::Npy) => Coding::Npy,
            (_, DepthFormat::Exr | DepthFormat::Png16) => Coding::Exr,
        }
    }

    /// The end of the member's name, after the sample's key.
    pub fn suffix(self, format: DepthFormat) -> String {
        format!("{}.{}", self.name(), self.coding(format).ending())
    }
}

/// Format of float layers.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum DepthFormat {
    /// OpenEXR pictures.
    #[default]
    Exr,
    /// NumPy arrays of float32.
    Npy,
    /// Depth and surface as 16-bit grey PNG, in steps that the label names; other layers as EXR.
    Png16,
}

impl DepthFormat {
    /// Every format.
    pub const ALL: [Self; 3] = [Self::Exr, Self::Npy, Self::Png16];

    /// Its name in jobs.
    pub fn name(self) -> &'static str {
        match self {
            Self::Exr => "exr",
            Self::Npy => "npy",
            Self::Png16 => "png16",
        }
    }
}

/// How a layer is written.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Coding {
    /// OpenEXR.
    Exr,
    /// NumPy array.
    Npy,
    /// PNG of 16 bits: not `.png`, which readers of tars cut to 8 bits.
    Png16,
    /// PNG of 8 bits.
    Png,
    /// JSON.
    Json,
}

impl Coding {
    /// The end of a file's name, after the last dot.
    pub fn ending(self) -> &'static str {
        match self {
            Self::Exr => "exr",
            Self::Npy => "npy",
            Self::Png16 => "png16",
            Self::Png => "png",
            Self::Json => "json",
        }
    }
}

/// What holds a shard's files.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum Container {
    /// A tar, which WebDataset reads.
    #[default]
    Tar,
    /// A folder with a metadata.jsonl, as the imagefolder of Hugging Face.
    Folder,
}

impl Container {
    /// Its name in jobs.
    pub fn name(self) -> &'static str {
        match self {
            Self::Tar => "tar",
            Self::Folder => "folder",
        }
    }
}

/// Storage of EXR layers.
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
