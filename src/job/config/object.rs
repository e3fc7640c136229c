//! `[[object]]`: what is pressed into the pad.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::config::texture::TextureDistribution;
use crate::layout::Split;
pub use gelsim_files::length::Unit;
use gelsim_files::mesh::{PlateSize, Reading, UrdfShapes};
use gelsim_files::sensor::quantity::Quantity;

/// One `[[object]]` table.
#[derive(Clone, Debug, Serialize, Deserialize, JsonSchema)]
#[serde(default, deny_unknown_fields)]
pub struct Object {
    /// A mesh file (.obj, .stl, .ply, .off, .glb, .gltf, .dae, .3mf), a robot (.urdf) or a height map (.png, .npy, .npz, .exr), relative to the file this stands in;
    /// `*`, `?` and `[..]` name several.
    #[schemars(required)]
    pub path: Option<String>,
    /// Unit of the mesh's coordinates; what the format or the file says where it is left out, else mm.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub unit: Option<Unit>,
    /// Class written to the labels; the file's name without its ending where it is left out.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub class: Option<String>,
    /// How often the object is drawn, relative to the others.
    pub weight: f64,
    /// SHA-256 of the mesh file in lower-case hex, of all files where it names others; if given, another content is refused.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub sha256: Option<String>,
    /// Which shapes of a URDF are pressed.
    #[serde(skip_serializing_if = "is_default")]
    pub urdf: UrdfShapes,
    /// Folders of packages in which the meshes of a URDF may be, relative to the file this stands in.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub packages: Vec<String>,
    /// What names the class where `class` does not; the file's stem, or where files share it the folder by which they differ.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub class_from: Option<ClassFrom>,
    /// Whether the parts of a file are one object, or one each.
    #[serde(skip_serializing_if = "is_default")]
    pub parts: Parts,
    /// The one part of the file that is meant.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub part: Option<String>,
    /// Factor on the object's size, drawn for each sample.
    #[serde(skip_serializing_if = "is_one")]
    pub scale: Quantity,
    /// Length of the object's longest side, mm, drawn for each sample, in place of `unit` and `scale`: for meshes that were divided
    /// by their own size. 0.001 to 10000.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub length_mm: Option<Quantity>,
    /// The one split that the object is in; with `split_by = "object"`. The others are divided between the splits.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub split: Option<Split>,
    /// What becomes of the job if a mesh cannot be read.
    #[serde(skip_serializing_if = "is_default")]
    pub on_bad: OnBad,
    /// What labels give as the path; `path` as it is written where it is left out.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub label_path: Option<String>,
    /// Distance between the samples of a height map, mm, 0.0001 to 100.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub mm_per_px: Option<f64>,
    /// Height of a height map's largest possible value over the smallest, mm, 0.0001 to 100.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub height_mm: Option<f64>,
    /// Young's modulus of an object that gives way, kPa, 0.1 to 1e9; without it the object is rigid.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub youngs_modulus_kpa: Option<Quantity>,
    /// Its Poisson ratio, 0 to 0.5; 0.48 where it is left out.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub poisson_ratio: Option<Quantity>,
    /// Coefficient of friction between pad and object, 0 to 10, in place of the job's, where the job has any friction.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub friction: Option<Quantity>,
    /// Micro relief of this object, in place of the job's `[texture]`.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub texture: Option<TextureDistribution>,
}

/// The Poisson ratio of an object that gives way, where its job says none: that of rubber.
pub const POISSON_RATIO: f64 = 0.48;

/// What names the class of a mesh.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum ClassFrom {
    /// The file's name without its ending.
    Stem,
    /// The folder that the first wildcard of `path` stands for; without one, the folder that the file is in.
    Folder,
    /// The file's name with its ending.
    File,
}

/// How the parts of a file are taken.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum Parts {
    /// All as one object.
    #[default]
    Together,
    /// Each as an object of its own.
    Separate,
}

/// What becomes of a job if a mesh cannot be read.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum OnBad {
    /// It is refused.
    #[default]
    Error,
    /// The mesh is left out, with a note.
    Skip,
}

fn is_one(scale: &Quantity) -> bool {
    *scale == Quantity::Constant(1.0)
}

impl Object {
    /// How its files are to be read.
    pub fn reading(&self) -> Reading<'_> {
        Reading { mm_per_unit: self.unit.map(Unit::mm), urdf: self.urdf, packages: &self.packages }
    }

    /// Factor on the size of an object that is so long as its file is read, mm.
    pub fn factor(&self, largest_mm: f64) -> Quantity {
        match &self.length_mm {
            Some(length_mm) => length_mm.times(1.0 / largest_mm),
            None => self.scale.clone(),
        }
    }

    /// How large its height maps are, if it says so.
    pub fn plate_size(&self) -> Option<PlateSize> {
        let (mm_per_px, height_mm) = self.mm_per_px.zip(self.height_mm)?;
        (mm_per_px > 0.0 && height_mm > 0.0).then_some(PlateSize { mm_per_px, height_mm })
    }
}

/// Keys that nobody wrote are left out, so that a job reads as it did before there were any.
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
