//! The formats of mesh files.

use std::path::Path;

use serde::{Deserialize, Serialize};

/// The file extensions that are read, for messages.
pub const ENDINGS: &str = ".obj, .stl, .ply, .off, .glb, .gltf, .dae, .3mf or .urdf";

/// A format of mesh files. Of two files of one object, the one whose format comes first is taken.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Format {
    /// Wavefront OBJ: `v` and `f` statements make the shape, `o` and `g` its parts; everything else is ignored.
    Obj,
    /// STL, ASCII or binary.
    Stl,
    /// PLY: ASCII or binary of either byte order.
    Ply,
    /// OFF of Geomview: ASCII, with or without colours and normals.
    Off,
    /// glTF 2.0, as one binary file or as JSON beside its buffers.
    Gltf,
    /// COLLADA 1.4 or 1.5.
    Dae,
    /// 3D Manufacturing Format: XML in a ZIP file.
    #[serde(rename = "3mf")]
    ThreeMf,
    /// URDF, a robot: its links name meshes, which are placed as at its zero configuration.
    Urdf,
}

impl Format {
    /// All formats.
    pub const ALL: [Self; 8] =
        [Self::Obj, Self::Stl, Self::Ply, Self::Off, Self::Gltf, Self::Dae, Self::ThreeMf, Self::Urdf];

    /// Returns the extensions of the format's files, in lower case.
    pub fn extensions(self) -> &'static [&'static str] {
        match self {
            Self::Obj => &["obj"],
            Self::Stl => &["stl"],
            Self::Ply => &["ply"],
            Self::Off => &["off"],
            Self::Gltf => &["glb", "gltf"],
            Self::Dae => &["dae"],
            Self::ThreeMf => &["3mf"],
            Self::Urdf => &["urdf"],
        }
    }

    /// Returns the format that the extension of `path`, in any case, stands for.
    pub fn from_path(path: &Path) -> Option<Self> {
        let ending = path.extension()?.to_str()?.to_ascii_lowercase();
        Self::ALL.into_iter().find(|format| format.extensions().contains(&ending.as_str()))
    }

    /// Returns true if the format or its files say how long a coordinate of 1 is.
    pub fn has_known_unit(self) -> bool {
        matches!(self, Self::Gltf | Self::Dae | Self::ThreeMf | Self::Urdf)
    }

    /// Returns the name of the format as people write it.
    pub fn name(self) -> &'static str {
        match self {
            Self::Obj => "OBJ",
            Self::Stl => "STL",
            Self::Ply => "PLY",
            Self::Off => "OFF",
            Self::Gltf => "glTF",
            Self::Dae => "COLLADA",
            Self::ThreeMf => "3MF",
            Self::Urdf => "URDF",
        }
    }
}
