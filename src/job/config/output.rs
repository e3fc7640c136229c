//! `[output]`: which layers a sample has besides the tactile image, and how they are stored.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::layers::{DepthFormat, OutputLayer};
use gelsim_files::exr::Exr;

/// The `[output]` table.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(default, deny_unknown_fields)]
pub struct Output {
    /// Layers that are written beside the tactile image.
    pub layers: Vec<OutputLayer>,
    /// Format of float layers: depth, surface, normal, pressure.
    pub depth_format: DepthFormat,
    /// How layers are stored that are EXR images.
    pub exr: Exr,
    /// Whether a shard is a tar or a folder.
    pub container: Container,
    /// What happens to a sample that is not finite, not within bounds or not solved.
    pub on_unhealthy: OnUnhealthy,
}

impl Output {
    /// Returns the layers that are written, each once, in the order of [`OutputLayer::ALL`].
    pub fn layers_in_order(&self) -> Vec<OutputLayer> {
        OutputLayer::ALL.into_iter().filter(|layer| self.layers.contains(layer)).collect()
    }
}

impl Default for Output {
    fn default() -> Self {
        Self {
            layers: vec![OutputLayer::Depth],
            depth_format: DepthFormat::default(),
            exr: Exr::default(),
            container: Container::default(),
            on_unhealthy: OnUnhealthy::default(),
        }
    }
}

/// What happens to an unhealthy sample.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum OnUnhealthy {
    /// It is kept; its label says what is wrong.
    #[default]
    Keep,
    /// It is listed in the shard's stats and drawn again, at most 100 times.
    Reject,
    /// The run stops.
    Fail,
}

/// Form of a shard.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum Container {
    /// A tar, which WebDataset reads.
    #[default]
    Tar,
    /// A folder with a metadata.jsonl, for Hugging Face's imagefolder.
    Folder,
}

impl Container {
    /// Returns the name in a job.
    pub fn name(self) -> &'static str {
        match self {
            Self::Tar => "tar",
            Self::Folder => "folder",
        }
    }
}
