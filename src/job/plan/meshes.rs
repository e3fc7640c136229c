//! Reads the mesh files of a job.

use std::collections::HashMap;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use rayon::prelude::*;

use super::object_notes::Facets;
use crate::config::object::{Object, Parts};
use crate::inspection::{MeshSize, SensorPad, sides};
use gelsim_core::mesh::clusters::Clusters;
use gelsim_core::mesh::{CleanupReport, Mesh};
use gelsim_files::mesh::{self, LoadedMesh, MeshFileError, Remark};

/// A file that an `[[object]]` names.
pub struct ObjectFile {
    /// Index of the table.
    pub entry: usize,
    /// Path of the file.
    pub path: PathBuf,
    /// Path in labels.
    pub label: String,
}

impl ObjectFile {
    /// Makes the entry of the file at `path`, which the table with this index names; relative paths in it start from
    /// `folder`. In labels the path is as written, or as a pattern found it relative to the folder.
    pub fn new(entry: usize, path: PathBuf, object: &Object, folder: &Path) -> Self {
        let written = object.path.as_deref().unwrap_or_default();
        let label = match &object.label_path {
            Some(label) => label.clone(),
            None if path == folder.join(written) => written.to_owned(),
            None => path.strip_prefix(folder).unwrap_or(&path).to_string_lossy().into_owned(),
        };
        Self { entry, path, label }
    }
}

/// A mesh of a file, ready to be pressed.
pub struct MeshPart {
    /// Name of the part in the file; `None` if the mesh is the complete file.
    pub name: Option<String>,
    /// Geometry of the mesh.
    pub clusters: Arc<Clusters>,
    /// Facets of round surfaces.
    pub facets: Facets,
    /// What cleaning removed.
    pub cleaned: CleanupReport,
    /// Size and place.
    pub size: MeshSize,
    /// Number of pixel rows that its triangles fill in a capture.
    pub rows_per_capture: f64,
    /// Whether the format defines what a coordinate of 1 is.
    pub knows_its_unit: bool,
    /// SHA-256 of the file, in lower-case hex.
    pub sha256: String,
    /// Folders in which the meshes that the file names are found again.
    pub packages: Vec<String>,
    /// What a user should know of how the file was read.
    pub remarks: Vec<Remark>,
}

impl MeshPart {
    fn new(name: Option<String>, loaded: LoadedMesh, pad: &SensorPad) -> Self {
        let LoadedMesh { mesh, cleaned, sha256, file_summary, mm_per_unit, states_its_unit, packages, remarks } =
            loaded;
        let size = MeshSize::new(&mesh, mm_per_unit, states_its_unit);
        let knows_its_unit = file_summary.format.has_known_unit();
        Self { name, knows_its_unit, packages, remarks, ..Self::from_mesh(&mesh, cleaned, sha256, size, pad) }
    }

    /// Makes the part for a mesh in millimetres that is a complete file.
    fn from_mesh(mesh: &Mesh, cleaned: CleanupReport, sha256: String, size: MeshSize, pad: &SensorPad) -> Self {
        let (clusters, facets) = rayon::join(|| Clusters::new(mesh), || Facets::from_mesh(mesh));
        Self {
            name: None,
            clusters: Arc::new(clusters),
            facets,
            cleaned,
            size,
            rows_per_capture: sides::count_capture_rows(mesh, pad),
            knows_its_unit: true,
            sha256,
            packages: Vec::new(),
            remarks: Vec::new(),
        }
    }
}

/// The meshes in a file, or why it cannot be used.
pub type MeshFileResult = Arc<Result<Vec<MeshPart>, MeshFileError>>;

/// Reads the files on all threads. Each file is read once, however many tables use a part of it.
pub fn read_mesh_files(objects: &[Object], files: &[ObjectFile], pad: &SensorPad) -> Vec<MeshFileResult> {
    // Tables that read the same file in the same way share the result.
    let key = |file: &ObjectFile| {
        let object = &objects[file.entry];
        let apart = object.part.is_some() || object.parts == Parts::Separate;
        let plate = object.plate_size().map(|size| [size.mm_per_px, size.height_mm].map(f64::to_bits));
        (file.path.clone(), object.unit, object.urdf, &object.packages, apart, plate)
    };
    let mut numbers = HashMap::new();
    let mut different = Vec::new();
    let places: Vec<usize> = files
        .iter()
        .map(|file| {
            *numbers.entry(key(file)).or_insert_with(|| {
                different.push(file);
                different.len() - 1
            })
        })
        .collect();
    let read: Vec<MeshFileResult> = different
        .par_iter()
        .map(|file| {
            let (.., apart, _) = key(file);
            let object = &objects[file.entry];
            if let Some(size) = object.plate_size().filter(|_| mesh::is_height_map(&file.path)) {
                let plate = mesh::load_plate(&file.path, size);
                return Arc::new(plate.map(|(mesh, cleaned, sha256)| {
                    let size = MeshSize::new(&mesh, 1.0, true);
                    vec![MeshPart::from_mesh(&mesh, cleaned, sha256, size, pad)]
                }));
            }
            let reading = object.read_options();
            let parts = match apart {
                true => mesh::load_parts(&file.path, reading),
                false => mesh::load(&file.path, reading).map(|loaded| vec![(String::new(), loaded)]),
            };
            let part = |(name, loaded): (String, LoadedMesh)| {
                MeshPart::new(Some(name).filter(|name| !name.is_empty()), loaded, pad)
            };
            Arc::new(parts.map(|parts| parts.into_iter().map(part).collect()))
        })
        .collect();
    places.into_iter().map(|place| Arc::clone(&read[place])).collect()
}
