//! The mesh files of a job: where they are, and what is read from them.

use std::collections::HashMap;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use rayon::prelude::*;

use super::object_notes::Facets;
use crate::config::object::{Object, Parts};
use crate::inspection::{MeshSize, SensorPad, sides};
use gelsim_core::mesh::clusters::Clusters;
use gelsim_core::mesh::{CleanupReport, Mesh};
use gelsim_files::mesh::{self, Loaded, MeshFileError, Remark};

/// A file that an `[[object]]` names.
pub struct File {
    /// Number of the table.
    pub entry: usize,
    /// Where it is.
    pub path: PathBuf,
    /// The same for labels.
    pub label: String,
}

impl File {
    /// The file at `path`, which the table of this number names; relative paths in it start from `folder`. In labels it is as
    /// written, or as a pattern found it from the folder on.
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
pub struct Part {
    /// Its name in the file; none if it is all of it.
    pub name: Option<String>,
    /// Its geometry.
    pub clusters: Arc<Clusters>,
    /// Its facets.
    pub facets: Facets,
    /// What cleaning removed.
    pub cleaned: CleanupReport,
    /// How large it is, and where.
    pub size: MeshSize,
    /// Rows of the sensor's pixels that its triangles fill in a capture.
    pub rows_per_capture: f64,
    /// The format says what a coordinate of 1 is.
    pub knows_its_unit: bool,
    /// SHA-256 of the file, lower-case hex.
    pub sha256: String,
    /// Folders in which the meshes that the file names are found again.
    pub packages: Vec<String>,
    /// What to know of how the file was read.
    pub remarks: Vec<Remark>,
}

impl Part {
    fn new(name: Option<String>, loaded: Loaded, pad: &SensorPad) -> Self {
        let Loaded { mesh, cleaned, sha256, given, mm_per_unit, states_its_unit, packages, remarks } = loaded;
        let size = MeshSize::new(&mesh, mm_per_unit, states_its_unit);
        let knows_its_unit = given.format.knows_its_unit();
        Self { name, knows_its_unit, packages, remarks, ..Self::of(&mesh, cleaned, sha256, size, pad) }
    }

    /// A mesh in millimetres that is all of its file.
    fn of(mesh: &Mesh, cleaned: CleanupReport, sha256: String, size: MeshSize, pad: &SensorPad) -> Self {
        let (clusters, facets) = rayon::join(|| Clusters::new(mesh), || Facets::of(mesh));
        Self {
            name: None,
            clusters: Arc::new(clusters),
            facets,
            cleaned,
            size,
            rows_per_capture: sides::rows(mesh, pad),
            knows_its_unit: true,
            sha256,
            packages: Vec::new(),
            remarks: Vec::new(),
        }
    }
}

/// What a file holds, or why it cannot be used.
pub type Read = Arc<Result<Vec<Part>, MeshFileError>>;

/// Reads the files, on all threads and each once, however many tables take a part of it.
pub fn read(objects: &[Object], files: &[File], pad: &SensorPad) -> Vec<Read> {
    let key = |file: &File| {
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
    let read: Vec<Read> = different
        .par_iter()
        .map(|file| {
            let (.., apart, _) = key(file);
            let object = &objects[file.entry];
            if let Some(size) = object.plate_size().filter(|_| mesh::is_height_map(&file.path)) {
                let plate = mesh::load_plate(&file.path, size);
                return Arc::new(plate.map(|(mesh, cleaned, sha256)| {
                    let size = MeshSize::new(&mesh, 1.0, true);
                    vec![Part::of(&mesh, cleaned, sha256, size, pad)]
                }));
            }
            let reading = object.reading();
            let parts = match apart {
                true => mesh::load_parts(&file.path, reading),
                false => mesh::load(&file.path, reading).map(|loaded| vec![(String::new(), loaded)]),
            };
            let part =
                |(name, loaded): (String, Loaded)| Part::new(Some(name).filter(|name| !name.is_empty()), loaded, pad);
            Arc::new(parts.map(|parts| parts.into_iter().map(part).collect()))
        })
        .collect();
    places.into_iter().map(|place| Arc::clone(&read[place])).collect()
}
