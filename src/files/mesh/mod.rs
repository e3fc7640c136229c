//! Mesh files: each becomes one cleaned [`Mesh`] in millimetres, or one of each of its parts.
//!
//! Each format has its reader; all of them give vertices and triangles to [`Mesh::new`], which cleans and
//! centres. Readers reserve no memory for what a file claims before they have seen that it has room for it. Axes stay
//! as they are in the file.

mod dae;
mod error;
mod format;
mod gltf;
mod obj;
mod off;
mod others;
mod plate;
mod ply;
mod polygon;
mod raw;
mod stl;
mod threemf;
mod urdf;
mod words;
mod xml;

use std::path::Path;

use serde::Serialize;

use super::hash::sha256;
use super::input;
use crate::core::mesh::{Cleaned, Mesh};

pub use error::{MeshFileError, MeshFileProblem};
pub use format::{ENDINGS, Format};
use others::Others;
pub use plate::{PlateSize, is_height_map, load_plate};
use raw::Raw;
pub use urdf::UrdfShapes;
use words::{Words, coordinates, number, quoted};

/// How a mesh file is to be read.
#[derive(Clone, Copy, Debug, Default)]
pub struct Reading {
    /// Millimetres of a coordinate of 1; if none, what the format or the file says, else 1.
    pub mm_per_unit: Option<f64>,
    /// Which shapes of a URDF are meant.
    pub urdf: UrdfShapes,
}

impl From<f64> for Reading {
    fn from(mm_per_unit: f64) -> Self {
        Self { mm_per_unit: Some(mm_per_unit), ..Self::default() }
    }
}

/// A mesh read from a file.
#[derive(Clone, Debug)]
pub struct Loaded {
    /// The mesh, in mm.
    pub mesh: Mesh,
    /// What cleaning removed.
    pub cleaned: Cleaned,
    /// SHA-256 of the file's bytes, in lower-case hexadecimal digits. Of a file that names others (buffers, a robot's
    /// meshes) that of a list of its own hash and theirs, so that it changes with any of them.
    pub sha256: String,
    /// What the file held.
    pub given: Given,
    /// Millimetres that a coordinate of 1 was taken for.
    pub mm_per_unit: f64,
    /// That is what the format or the file says.
    pub states_its_unit: bool,
}

/// What a file holds, before anything is cleaned.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
pub struct Given {
    /// Its format.
    pub format: Format,
    /// Its size.
    pub bytes: usize,
    /// Vertices: three per triangle in STL.
    pub vertices: usize,
    /// Triangles, with those into which polygons were divided.
    pub triangles: usize,
}

/// Reads the file at `path` as one mesh; its ending, in any case, tells the format.
///
/// # Errors
///
/// Every [`MeshFileProblem`] there is, with the path and, in text, the line.
pub fn load(path: &Path, reading: impl Into<Reading>) -> Result<Loaded, MeshFileError> {
    let reading = reading.into();
    let (file, raw) = read_file(path, reading)?;
    file.loaded(raw)
}

/// Reads the parts of the file at `path`, each a mesh of its own with a name that no other part has. A file without parts
/// is one part without a name.
///
/// # Errors
///
/// As [`load`]; also if a part alone makes no mesh.
pub fn load_parts(path: &Path, reading: impl Into<Reading>) -> Result<Vec<(String, Loaded)>, MeshFileError> {
    let reading = reading.into();
    let (file, raw) = read_file(path, reading)?;
    if raw.parts.is_empty() || raw.triangles.is_empty() {
        return Ok(vec![(String::new(), file.loaded(raw)?)]);
    }
    raw.split().into_iter().map(|(name, raw)| Ok((name, file.loaded(raw)?))).collect()
}

/// Reads a mesh from the bytes of a file that names no others; a coordinate of 1 in it is `mm_per_unit` mm. Never panics.
///
/// # Errors
///
/// As [`load`], without the path.
pub fn parse(bytes: &[u8], format: Format, mm_per_unit: f64) -> Result<(Mesh, Cleaned), MeshFileError> {
    let raw = read(bytes, format, UrdfShapes::default(), &mut Others::beside(None))?;
    raw.mesh(mm_per_unit)
}

/// A file, read.
struct FileRead<'a> {
    path: &'a Path,
    format: Format,
    bytes: usize,
    sha256: String,
    mm_per_unit: f64,
    states_its_unit: bool,
}

impl FileRead<'_> {
    fn loaded(&self, raw: Raw) -> Result<Loaded, MeshFileError> {
        let (vertices, triangles) = (raw.vertices.len(), raw.triangles.len());
        let given = Given { format: self.format, bytes: self.bytes, vertices, triangles };
        let Self { mm_per_unit, states_its_unit, .. } = *self;
        let (mesh, cleaned) = raw.mesh(mm_per_unit).map_err(|error| error.in_file(self.path))?;
        Ok(Loaded { mesh, cleaned, sha256: self.sha256.clone(), given, mm_per_unit, states_its_unit })
    }
}

fn read_file(path: &Path, reading: Reading) -> Result<(FileRead<'_>, Raw), MeshFileError> {
    let in_file = |error: MeshFileError| error.in_file(path);
    let format = Format::from_path(path).ok_or_else(|| match path.metadata() {
        Err(error) => in_file(MeshFileProblem::Unreadable(error).into()),
        Ok(_) => in_file(MeshFileProblem::UnknownExtension.into()),
    })?;
    let bytes = input::read(path, input::MOST_MESH_BYTES)
        .map_err(|error| in_file(MeshFileProblem::Unreadable(error).into()))?;
    let mut others = Others::beside(Some(path));
    // The hash of a large file takes a sixth of its reading.
    let (raw, own) = rayon::join(|| read(&bytes, format, reading.urdf, &mut others), || sha256(&bytes));
    let raw = raw.map_err(in_file)?;
    let sha256 = others.sha256(own);
    let mm_per_unit = reading.mm_per_unit.or(raw.mm_per_unit).unwrap_or(1.0);
    let states_its_unit = reading.mm_per_unit.is_none() && raw.mm_per_unit.is_some();
    Ok((FileRead { path, format, bytes: bytes.len(), sha256, mm_per_unit, states_its_unit }, raw))
}

fn read(bytes: &[u8], format: Format, urdf: UrdfShapes, others: &mut Others) -> Result<Raw, MeshFileError> {
    match format {
        Format::Obj => obj::read(bytes),
        Format::Stl => stl::read(bytes),
        Format::Ply => ply::read(bytes),
        Format::Off => off::read(bytes),
        Format::Gltf => gltf::read(bytes, others),
        Format::Dae => dae::read(bytes),
        Format::ThreeMf => threemf::read(bytes),
        Format::Urdf => urdf::read(bytes, urdf, others),
    }
}

#[cfg(test)]
mod tests;
