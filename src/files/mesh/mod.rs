//! Mesh files: each becomes one cleaned [`Mesh`] in millimetres, or one of each of its parts.
//!
//! Each format has its reader; all of them give vertices and triangles to [`Mesh::new`], which cleans and
//! centres. Readers reserve no memory for what a file claims before they have seen that it has room for it. Axes stay
//! as they are in the file.

mod dae;
mod detect;
mod error;
mod format;
mod gltf;
mod missing;
mod obj;
mod off;
mod others;
mod packages;
mod plate;
mod ply;
mod points;
mod polygon;
mod raw;
mod remark;
mod stl;
mod threemf;
mod urdf;
mod uri;
mod words;
mod xml;

use std::path::Path;

use serde::Serialize;

use super::hash::sha256;
use super::input;
use gelsim_core::mesh::{CleanupReport, Mesh};

use detect::Detected;
pub use error::{HEIGHT_MAP, MeshFileError, MeshFileProblem};
pub use format::{ENDINGS, Format};
pub use missing::{Missing, MissingFile, Reason, Wanted};
use others::Others;
pub use plate::{PlateSize, is_height_map, load_plate};
pub use points::{PointKind, Points};
use raw::Raw;
pub use remark::Remark;
pub use urdf::UrdfShapes;
use words::{Words, coordinates, number, quoted};

/// What to do with files that are named like this, where that is another format than those that are read.
pub fn other_format(path: &Path) -> Option<&'static str> {
    detect::by_ending(path).map(|foreign| foreign.help)
}

/// How a mesh file is to be read.
#[derive(Clone, Copy, Debug, Default)]
pub struct Reading<'a> {
    /// Millimetres of a coordinate of 1; if none, what the format or the file says, else 1.
    pub mm_per_unit: Option<f64>,
    /// Which shapes of a URDF are meant.
    pub urdf: UrdfShapes,
    /// Folders of packages in which the meshes of a URDF may be.
    pub packages: &'a [String],
}

impl From<f64> for Reading<'_> {
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
    pub cleaned: CleanupReport,
    /// SHA-256 of the file's bytes, in lower-case hexadecimal digits. Of a file that names others (buffers, a robot's
    /// meshes) that of a list of its own hash and theirs, so that it changes with any of them.
    pub sha256: String,
    /// What the file held.
    pub given: Given,
    /// Millimetres that a coordinate of 1 was taken for.
    pub mm_per_unit: f64,
    /// That is what the format or the file says.
    pub states_its_unit: bool,
    /// Folders in which the meshes of a URDF are looked for when it is read again: those that were given, and those of packages
    /// that were found through the environment.
    pub packages: Vec<String>,
    /// What to know of how it was read.
    pub remarks: Vec<Remark>,
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

/// Reads the file at `path` as one mesh; its ending, in any case, tells the format, unless its bytes are those of another one.
///
/// # Errors
///
/// Every [`MeshFileProblem`] there is, with the path and, in text, the line.
pub fn load<'a>(path: &Path, reading: impl Into<Reading<'a>>) -> Result<Loaded, MeshFileError> {
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
pub fn load_parts<'a>(path: &Path, reading: impl Into<Reading<'a>>) -> Result<Vec<(String, Loaded)>, MeshFileError> {
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
pub fn parse(bytes: &[u8], format: Format, mm_per_unit: f64) -> Result<(Mesh, CleanupReport), MeshFileError> {
    let (_, raw) = read(bytes, format, UrdfShapes::default(), &mut Others::none())?;
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
    packages: Vec<String>,
    remarks: Vec<Remark>,
}

impl FileRead<'_> {
    fn loaded(&self, raw: Raw) -> Result<Loaded, MeshFileError> {
        let (vertices, triangles) = (raw.vertices.len(), raw.triangles.len());
        let given = Given { format: self.format, bytes: self.bytes, vertices, triangles };
        let Self { mm_per_unit, states_its_unit, .. } = *self;
        let (mesh, cleaned) = raw.mesh(mm_per_unit).map_err(|error| error.in_file(self.path))?;
        Ok(Loaded {
            mesh,
            cleaned,
            sha256: self.sha256.clone(),
            given,
            mm_per_unit,
            states_its_unit,
            packages: self.packages.clone(),
            remarks: self.remarks.clone(),
        })
    }
}

fn read_file<'a>(path: &'a Path, reading: Reading) -> Result<(FileRead<'a>, Raw), MeshFileError> {
    let in_file = |error: MeshFileError| error.in_file(path);
    let named = Format::from_path(path).ok_or_else(|| in_file(unknown(path).into()))?;
    let bytes = input::read(path, input::MOST_MESH_BYTES)
        .map_err(|error| in_file(MeshFileProblem::unreadable(error).into()))?;
    let mut others = Others::beside(path, reading.packages);
    // The hash of a large file takes a sixth of its reading.
    let (raw, own) = rayon::join(|| read(&bytes, named, reading.urdf, &mut others), || sha256(&bytes));
    let (format, mut raw) = raw.map_err(in_file)?;
    let sha256 = others.sha256(own);
    let mm_per_unit = reading.mm_per_unit.or(raw.mm_per_unit).unwrap_or(1.0);
    let states_its_unit = reading.mm_per_unit.is_none() && raw.mm_per_unit.is_some();
    let misnamed = (format != named).then_some(Remark::Misnamed(format));
    let remarks = misnamed.into_iter().chain(std::mem::take(&mut raw.remarks)).collect();
    let packages = if format == Format::Urdf { others.packages() } else { Vec::new() };
    let bytes = bytes.len();
    Ok((FileRead { path, format, bytes, sha256, mm_per_unit, states_its_unit, packages, remarks }, raw))
}

/// What is wrong with a file whose ending names no format.
fn unknown(path: &Path) -> MeshFileProblem {
    /// A larger one is not looked into.
    const MOST: u64 = 64 << 20;
    if let Err(error) = path.metadata() {
        return MeshFileProblem::Unreadable(error);
    }
    if is_height_map(path) {
        let help =
            "a height map becomes an object in a job: mm_per_px and height_mm under [[object]] say how large it is";
        return MeshFileProblem::UnknownExtension(help.into());
    }
    let bytes = match input::read(path, MOST).map_err(MeshFileProblem::unreadable) {
        Ok(bytes) => Some(bytes),
        Err(problem @ MeshFileProblem::Foreign(_)) => return problem,
        Err(_) => None,
    };
    let detected = bytes.as_deref().and_then(detect::detect);
    let is_empty = bytes.is_some_and(|bytes| bytes.is_empty());
    match (detected, detect::by_ending(path)) {
        (Some(Detected::Mesh(format)), _) => {
            let help = format!("it is {} by its bytes: give it the ending .{}", format.name(), format.endings()[0]);
            MeshFileProblem::UnknownExtension(help)
        }
        (Some(Detected::Foreign(foreign)), of_ending) if of_ending.is_none() || is_empty => {
            MeshFileProblem::Foreign(foreign)
        }
        (_, Some(foreign)) => MeshFileProblem::UnknownExtension(foreign.help.into()),
        (_, None) => {
            let help = "export it as one of these, or give the file the ending of its format; `path` in a job takes height \
                        maps, too: .png, .npy, .npz or .exr";
            MeshFileProblem::UnknownExtension(help.into())
        }
    }
}

/// The mesh in the bytes of a file that is named as one of `named`, and the format that it is read as.
fn read(bytes: &[u8], named: Format, urdf: UrdfShapes, others: &mut Others) -> Result<(Format, Raw), MeshFileError> {
    let format = match detect::other_than(named, bytes) {
        Some(Detected::Mesh(format)) => format,
        Some(Detected::Foreign(foreign)) => return Err(MeshFileProblem::Foreign(foreign).into()),
        None => named,
    };
    let raw = match format {
        Format::Obj => obj::read(bytes),
        Format::Stl => stl::read(bytes),
        Format::Ply => ply::read(bytes),
        Format::Off => off::read(bytes),
        Format::Gltf => gltf::read(bytes, others),
        Format::Dae => dae::read(bytes),
        Format::ThreeMf => threemf::read(bytes),
        Format::Urdf => urdf::read(bytes, urdf, others),
    };
    Ok((format, raw?.with_surface()?))
}

#[cfg(test)]
mod tests;
