//! `[sensor.shape]`: the shape of a gel that is not flat, as a sensor file writes it.

use std::sync::Arc;

use serde::{Deserialize, Serialize};

use crate::length::Unit;
use gelsim_core::base::gel::{GelCapsule, GelDome, GelShape};
use gelsim_core::base::gel_surface::GelSurface;

/// The outer surface of an untouched gel that is not flat.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "formats", derive(schemars::JsonSchema))]
#[cfg_attr(feature = "formats", schemars(rename = "GelShape"))]
#[serde(rename_all = "snake_case")]
pub enum SensorShape {
    /// Half of a ball.
    Dome(GelDome),
    /// A finger: half of a ball on a cylinder of the same radius.
    Capsule(GelCapsule),
    /// Any other: the gel's outer surface in a mesh file.
    Mesh(GelMesh),
}

/// See [`SensorShape::Mesh`].
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "formats", derive(schemars::JsonSchema))]
#[serde(deny_unknown_fields)]
pub struct GelMesh {
    /// A mesh file (.obj, .stl, .ply, .off, .glb, .gltf, .dae, .3mf), relative to the file this stands in: the gel's
    /// outer surface in the sensor's frame, with z out of the tip.
    pub path: String,
    /// Unit of the mesh's coordinates. Without it, what the format or the file says, else mm.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub unit: Option<Unit>,
    /// Translation of the mesh, mm. The tip, where the z axis leaves the gel, must come to be at the origin.
    #[serde(default, skip_serializing_if = "is_zero")]
    pub offset_mm: [f64; 3],
    /// SHA-256 of the file in lower-case hex; if given, another content is refused.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub sha256: Option<String>,
    /// The surface in the file, once it was read.
    #[serde(skip)]
    pub surface: Option<Arc<GelSurface>>,
}

fn is_zero(offset_mm: &[f64; 3]) -> bool {
    *offset_mm == [0.0; 3]
}

impl SensorShape {
    /// Converts to the shape of the simulator. Returns `None` for a mesh that was not read.
    pub fn to_gel_shape(&self) -> Option<GelShape> {
        match self {
            Self::Dome(dome) => Some(GelShape::Dome(*dome)),
            Self::Capsule(capsule) => Some(GelShape::Capsule(*capsule)),
            Self::Mesh(GelMesh { surface, .. }) => surface.clone().map(GelShape::Mesh),
        }
    }
}
