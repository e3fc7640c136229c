//! `[[object]]`: what is pressed into the pad.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::config::texture::TextureDistribution;
use crate::layout::Split;
pub use gelsim_files::length::Unit;
use gelsim_files::mesh::{MeshReadOptions, PlateSize, UrdfShapes};
use gelsim_files::sensor::quantity::Quantity;

/// One `[[object]]` table.
#[derive(Clone, Debug, Serialize, Deserialize, JsonSchema)]
#[serde(default, deny_unknown_fields)]
pub struct Object {
    /// A mesh file (.obj, .stl, .ply, .off, .glb, .gltf, .dae, .3mf), a robot (.urdf) or a height map (.png, .npy,
    /// .npz, .exr), relative to the file this stands in; `*`, `?` and `[..]` name several.
    #[schemars(required)]
    pub path: Option<String>,
    /// Unit of the mesh's coordinates. Without it, what the format or the file says, else mm.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub unit: Option<Unit>,
    /// Class written to the labels. Without it, the file's name without its extension.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub class: Option<String>,
    /// How often the object is drawn, relative to the others.
    pub weight: f64,
    /// SHA-256 of the mesh file in lower-case hex, or of all files if it names others; if given, another content is
    /// refused.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub sha256: Option<String>,
    /// Which shapes of a URDF are pressed.
    #[serde(skip_serializing_if = "is_default")]
    pub urdf: UrdfShapes,
    /// Folders of packages in which the meshes of a URDF are looked for, relative to the file this stands in.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub packages: Vec<String>,
    /// What names the class if `class` does not: the file's stem, or, if files share it, the folder by which they
    /// differ.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub class_from: Option<ClassFrom>,
    /// Whether the parts of a file are one object, or one object each.
    #[serde(skip_serializing_if = "is_default")]
    pub parts: Parts,
    /// The part of the file that is pressed; without it all parts.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub part: Option<String>,
    /// Factor on the object's size, drawn for each sample.
    #[serde(skip_serializing_if = "is_one")]
    pub scale: Quantity,
    /// Length of the object's longest side, mm, drawn for each sample, in place of `unit` and `scale`: for meshes that
    /// were divided by their own size. 0.001 to 10000.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub length_mm: Option<Quantity>,
    /// The split that the object is in, with `split_by = "object"`. Objects without it are divided between the splits.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub split: Option<Split>,
    /// What happens if a mesh cannot be read.
    #[serde(skip_serializing_if = "is_default")]
    pub on_bad: OnBad,
    /// The path in labels. Without it, `path` as it is written.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub label_path: Option<String>,
    /// Distance between the samples of a height map, mm, 0.0001 to 100.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub mm_per_px: Option<f64>,
    /// Height of a height map's largest possible value over the smallest, mm, 0.0001 to 100.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub height_mm: Option<f64>,
    /// Young's modulus of an elastic object, kPa, 0.1 to 1e9; without it the object is rigid.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub youngs_modulus_kpa: Option<Quantity>,
    /// Poisson ratio of an elastic object, 0 to 0.5; 0.48 if left out.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub poisson_ratio: Option<Quantity>,
    /// Coefficient of friction between pad and object, 0 to 10, in place of the job's. Used only if the job has
    /// friction.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub friction: Option<Quantity>,
    /// Micro relief of this object, in place of the job's `[texture]`.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub texture: Option<TextureDistribution>,
}

/// The Poisson ratio of an elastic object whose job gives none: that of rubber.
pub const DEFAULT_POISSON_RATIO: f64 = 0.48;

/// What names the class of a mesh.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum ClassFrom {
    /// The file's name without its extension.
    Stem,
    /// The folder that the first wildcard of `path` stands for; without a wildcard, the folder that the file is in.
    Folder,
    /// The file's name with its extension.
    File,
}

/// How the parts of a file are taken.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum Parts {
    /// All parts are one object.
    #[default]
    Together,
    /// Each part is an object of its own.
    Separate,
}

/// What happens if a mesh cannot be read.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum OnBad {
    /// The job is refused.
    #[default]
    Error,
    /// The mesh is left out, with a note.
    Skip,
}

fn is_one(scale: &Quantity) -> bool {
    *scale == Quantity::Constant(1.0)
}

impl Object {
    /// Returns how the object's files are to be read.
    pub fn read_options(&self) -> MeshReadOptions<'_> {
        MeshReadOptions { mm_per_unit: self.unit.map(Unit::mm_per_unit), urdf: self.urdf, packages: &self.packages }
    }

    /// Returns the factor on the size of an object whose longest side, as its file is read, is `largest_mm`.
    pub fn size_factor(&self, largest_mm: f64) -> Quantity {
        match &self.length_mm {
            Some(length_mm) => length_mm.scaled_by(1.0 / largest_mm),
            None => self.scale.clone(),
        }
    }

    /// Returns the size of the object's height maps, if it is given.
    pub fn plate_size(&self) -> Option<PlateSize> {
        let (mm_per_px, height_mm) = self.mm_per_px.zip(self.height_mm)?;
        (mm_per_px > 0.0 && height_mm > 0.0).then_some(PlateSize { mm_per_px, height_mm })
    }
}

/// Returns true for a default value. Such keys are left out, so that a job written before they existed reads the same.
fn is_default<T: Default + PartialEq>(value: &T) -> bool {
    *value == T::default()
}

impl Default for Object {
    fn default() -> Self {
        Self {
            path: None,
            unit: None,
            class: None,
            weight: 1.0,
            sha256: None,
            urdf: UrdfShapes::default(),
            packages: Vec::new(),
            class_from: None,
            parts: Parts::default(),
            part: None,
            scale: Quantity::Constant(1.0),
            length_mm: None,
            split: None,
            on_bad: OnBad::default(),
            label_path: None,
            mm_per_px: None,
            height_mm: None,
            youngs_modulus_kpa: None,
            poisson_ratio: None,
            friction: None,
            texture: None,
        }
    }
}
