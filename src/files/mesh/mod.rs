//! Reads mesh files: each becomes one cleaned [`Mesh`] in millimetres, or one for each of its parts.
//!
//! Each format has a reader. All of them give vertices and triangles to [`Mesh::new`], which cleans and centres them. A
//! reader reserves memory only for what it has seen to fit into the file, not for what the file claims. Axes stay as
//! they are in the file.

mod dae;
mod detect;
mod error;
mod format;
mod gltf;
mod missing_files;
mod obj;
mod off;
mod packages;
mod plate;
mod ply;
mod points;
mod polygon;
mod raw;
mod remark;
mod resources;
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
pub use error::{HEIGHT_MAP_HELP, MeshFileError, MeshFileProblem};
pub use format::{ENDINGS, Format};
pub use missing_files::{MissingFile, MissingFiles, MissingReason, ResourceKind};
pub use plate::{PlateSize, is_height_map, load_plate};
pub use points::{LoosePoints, PointKind};
use raw::RawMesh;
pub use remark::Remark;
use resources::Resources;
pub use urdf::UrdfShapes;
use words::{WordReader, parse_number, quote_word, read_coordinates};

/// Returns what to do with files whose extension is that of a known format that is not read.
pub fn suggest_export(path: &Path) -> Option<&'static str> {
    detect::identify_by_extension(path).map(|foreign| foreign.help)
}

/// How a mesh file is to be read.
#[derive(Clone, Copy, Debug, Default)]
pub struct MeshReadOptions<'a> {
    /// Millimetres of a coordinate of 1. `None` takes what the format or the file says, else 1.
    pub mm_per_unit: Option<f64>,
    /// Which shapes of a URDF are read.
    pub urdf: UrdfShapes,
    /// Folders of packages in which the meshes of a URDF are looked for.
    pub packages: &'a [String],
}

impl From<f64> for MeshReadOptions<'_> {
    fn from(mm_per_unit: f64) -> Self {
        Self { mm_per_unit: Some(mm_per_unit), ..Self::default() }
    }
}

/// A mesh read from a file.
#[derive(Clone, Debug)]
pub struct LoadedMesh {
    /// The mesh, in mm.
    pub mesh: Mesh,
    /// What cleaning removed.
    pub cleaned: CleanupReport,
    /// SHA-256 of the file's bytes, in lower-case hexadecimal digits. For a file that names others (buffers, a robot's
    /// meshes) it is that of a list of all their hashes, so that it changes with any of them.
    pub sha256: String,
    /// What the file held before cleaning.
    pub file_summary: MeshFileSummary,
    /// The millimetres of a coordinate of 1 with which the file was read.
    pub mm_per_unit: f64,
    /// Whether the format or the file says so.
    pub states_its_unit: bool,
    /// The folders in which the meshes of a URDF are found when it is read again: those that were given, and those of
    /// packages that were found through the environment.
    pub packages: Vec<String>,
    /// What a user should know of how the file was read.
    pub remarks: Vec<Remark>,
    /// Whether the mesh also depends on other files, which the file names.
    pub names_other_files: bool,
}

/// What a file holds, before cleaning.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
pub struct MeshFileSummary {
    /// The format.
    pub format: Format,
    /// The size of the file, bytes.
    pub bytes: usize,
    /// Number of vertices: three per triangle in STL.
    pub vertices: usize,
    /// Number of triangles, with those into which polygons were divided.
    pub triangles: usize,
}

/// Reads the file at `path` as one mesh. Its extension, in any case, tells the format, unless its bytes are those of
/// another one.
///
/// # Errors
///
/// Every [`MeshFileProblem`], with the path and, for a text, the line.
pub fn load<'a>(path: &Path, reading: impl Into<MeshReadOptions<'a>>) -> Result<LoadedMesh, MeshFileError> {
    let reading = reading.into();
    let (file, raw) = read_mesh_file(path, reading)?;
    file.build_mesh(raw)
}

/// Reads the parts of the file at `path`. Each is a mesh of its own with a unique name. A file without parts is one
/// part without a name.
///
/// # Errors
///
/// Those of [`load`], and if a part alone makes no mesh.
pub fn load_parts<'a>(
    path: &Path,
    reading: impl Into<MeshReadOptions<'a>>,
) -> Result<Vec<(String, LoadedMesh)>, MeshFileError> {
    let reading = reading.into();
    let (file, raw) = read_mesh_file(path, reading)?;
    if raw.parts.is_empty() || raw.triangles.is_empty() {
        return Ok(vec![(String::new(), file.build_mesh(raw)?)]);
    }
    raw.split_parts().into_iter().map(|(name, raw)| Ok((name, file.build_mesh(raw)?))).collect()
}

/// Reads a mesh from the bytes of a file that names no other files. A coordinate of 1 in it is `mm_per_unit` mm. Never
/// panics.
///
/// # Errors
///
/// Those of [`load`], without the path.
pub fn parse(bytes: &[u8], format: Format, mm_per_unit: f64) -> Result<(Mesh, CleanupReport), MeshFileError> {
    let (_, raw) = read_mesh_bytes(bytes, format, UrdfShapes::default(), &mut Resources::none())?;
    raw.into_mesh(mm_per_unit)
}

/// A file that was read, without its shape.
struct MeshFile<'a> {
    path: &'a Path,
    format: Format,
    bytes: usize,
    sha256: String,
    mm_per_unit: f64,
    states_its_unit: bool,
    packages: Vec<String>,
    remarks: Vec<Remark>,
    names_other_files: bool,
}

impl MeshFile<'_> {
    fn build_mesh(&self, raw: RawMesh) -> Result<LoadedMesh, MeshFileError> {
        let (vertices, triangles) = (raw.vertices.len(), raw.triangles.len());
        let file_summary = MeshFileSummary { format: self.format, bytes: self.bytes, vertices, triangles };
        let Self { mm_per_unit, states_its_unit, .. } = *self;
        let (mesh, cleaned) = raw.into_mesh(mm_per_unit).map_err(|error| error.in_file(self.path))?;
        Ok(LoadedMesh {
            mesh,
            cleaned,
            sha256: self.sha256.clone(),
            file_summary,
            mm_per_unit,
            states_its_unit,
            packages: self.packages.clone(),
            remarks: self.remarks.clone(),
            names_other_files: self.names_other_files,
        })
    }
}

fn read_mesh_file<'a>(path: &'a Path, reading: MeshReadOptions) -> Result<(MeshFile<'a>, RawMesh), MeshFileError> {
    let in_file = |error: MeshFileError| error.in_file(path);
    let named = Format::from_path(path).ok_or_else(|| in_file(explain_unknown_extension(path).into()))?;
    let bytes = input::read(path, input::MAX_MESH_BYTES)
        .map_err(|error| in_file(MeshFileProblem::from_io_error(error).into()))?;
    let mut others = Resources::beside_file(path, reading.packages);
    // Hash and parse at the same time: the hash of a large file takes a sixth of the time of reading it.
    let (raw, own) = rayon::join(|| read_mesh_bytes(&bytes, named, reading.urdf, &mut others), || sha256(&bytes));
    let (format, mut raw) = raw.map_err(in_file)?;
    let sha256 = others.combined_sha256(own);
    let mm_per_unit = reading.mm_per_unit.or(raw.mm_per_unit).unwrap_or(1.0);
    let states_its_unit = reading.mm_per_unit.is_none() && raw.mm_per_unit.is_some();
    let misnamed = (format != named).then_some(Remark::Misnamed(format));
    let remarks = misnamed.into_iter().chain(std::mem::take(&mut raw.remarks)).collect();
    let packages = if format == Format::Urdf { others.package_folders() } else { Vec::new() };
    let (bytes, names_other_files) = (bytes.len(), others.has_read_files());
    let file =
        MeshFile { path, format, bytes, sha256, mm_per_unit, states_its_unit, packages, remarks, names_other_files };
    Ok((file, raw))
}

/// Says what is wrong with a file whose extension is that of no format.
fn explain_unknown_extension(path: &Path) -> MeshFileProblem {
    /// Most bytes of a file that is looked into.
    const MAX_BYTES: u64 = 64 << 20;
    if let Err(error) = path.metadata() {
        return MeshFileProblem::Unreadable(error);
    }
    if is_height_map(path) {
        let help =
            "a height map becomes an object in a job: mm_per_px and height_mm under [[object]] say how large it is";
        return MeshFileProblem::UnknownExtension(help.into());
    }
    let bytes = match input::read(path, MAX_BYTES).map_err(MeshFileProblem::from_io_error) {
        Ok(bytes) => Some(bytes),
        Err(problem @ MeshFileProblem::Foreign(_)) => return problem,
        Err(_) => None,
    };
    let detected = bytes.as_deref().and_then(detect::detect_content);
    let is_empty = bytes.is_some_and(|bytes| bytes.is_empty());
    match (detected, detect::identify_by_extension(path)) {
        (Some(Detected::Mesh(format)), _) => {
            let help = format!("it is {} by its bytes: give it the ending .{}", format.name(), format.extensions()[0]);
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

/// Reads the mesh in the bytes of a file whose name says the format `named`. Also returns the format that it really
/// has.
fn read_mesh_bytes(
    bytes: &[u8],
    named: Format,
    urdf: UrdfShapes,
    others: &mut Resources,
) -> Result<(Format, RawMesh), MeshFileError> {
    let format = match detect::detect_mismatch(named, bytes) {
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
    Ok((format, raw?.require_surface()?))
}

#[cfg(test)]
mod tests;
