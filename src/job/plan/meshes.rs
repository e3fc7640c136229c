//! Reads the mesh files of a job.

use std::collections::HashMap;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::SystemTime;

use rayon::prelude::*;
use serde::Serialize;

use super::faces;
use super::geometry::{FileContent, Geometry, MeshFile, MeshStore, read_file};
use super::mesh_cache::{FileState, MeshCache};
use super::mesh_facts::{MeshFacts, find_level_side};
use crate::config::Job;
use crate::config::object::{Object, Parts};
use crate::config::scene::Face;
use crate::inspection::{MeshSize, SensorPad};
use gelsim_core::mesh::clusters::Clusters;
use gelsim_core::mesh::facets::Facets;
use gelsim_core::mesh::{CleanupReport, Mesh};
use gelsim_core::pose::Side;
use gelsim_files::diagnostic::Diagnostic;
use gelsim_files::mesh::{LoadedMesh, MeshFileError};

/// Most files of which all meshes are held in memory. Among few files, some may be so large that reading one of them
/// again takes seconds.
const FEW_FILES: usize = 256;

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
    /// What is known of it.
    pub facts: MeshFacts,
    /// Its geometry.
    pub geometry: Geometry,
}

/// The meshes in a file, or why it cannot be used.
pub type MeshFileResult = Arc<Result<Vec<MeshPart>, MeshFileError>>;

/// How the meshes of an `[[object]]` are read and examined. Tables for which it is the same share what is read.
#[derive(Serialize)]
struct Reading<'a> {
    object: Object,
    pad: &'a SensorPad,
    is_richest_pressed: bool,
    level_side: Option<Side>,
}

impl<'a> Reading<'a> {
    fn new(job: &Job, object: &Object, pad: &'a SensorPad) -> Self {
        let of_file = Object {
            unit: object.unit,
            urdf: object.urdf,
            packages: object.packages.clone(),
            parts: if object.part.is_some() { Parts::Separate } else { object.parts },
            mm_per_px: object.mm_per_px,
            height_mm: object.height_mm,
            length_mm: object.length_mm.clone(),
            ..Object::default()
        };
        let is_richest_pressed = job.pose.face == Face::Auto && job.pose.at.is_side();
        Self { object: of_file, pad, is_richest_pressed, level_side: find_level_side(job) }
    }

    /// Describes it as a text that differs from that of any other one.
    fn to_key(&self) -> String {
        serde_json::to_string(self).unwrap_or_default()
    }

    /// Examines a mesh that was read. Also returns its geometry.
    fn examine(&self, name: Option<String>, loaded: LoadedMesh) -> (MeshFacts, Clusters) {
        let LoadedMesh { mesh, cleaned, sha256, file_summary, mm_per_unit, states_its_unit, packages, remarks, .. } =
            loaded;
        let size = MeshSize::new(&mesh, mm_per_unit, states_its_unit);
        let (facts, clusters) = self.examine_mesh(&mesh, cleaned, sha256, size);
        let knows_its_unit = file_summary.format.has_known_unit();
        (MeshFacts { name, knows_its_unit, packages, remarks, ..facts }, clusters)
    }

    /// Examines a mesh in millimetres that is a complete file.
    fn examine_mesh(
        &self,
        mesh: &Mesh,
        cleaned: CleanupReport,
        sha256: String,
        size: MeshSize,
    ) -> (MeshFacts, Clusters) {
        let (clusters, facets) = rayon::join(|| Clusters::new(mesh), || Facets::from_mesh(mesh));
        let reach_mm = self.pad.thickness_mm;
        let find_richest = || match &self.object.length_mm {
            // At the size at which it is usually pressed.
            Some(length_mm) => {
                let scale = length_mm.scaled_by(1.0 / size.largest_extent_mm()).typical_value();
                faces::find_richest_side(&clusters.scaled(scale), reach_mm)
            }
            None => faces::find_richest_side(&clusters, reach_mm),
        };
        let facts = MeshFacts {
            name: None,
            facets,
            cleaned,
            size,
            rows_per_capture: self.pad.count_capture_rows(mesh),
            knows_its_unit: true,
            sha256,
            packages: Vec::new(),
            remarks: Vec::new(),
            richest_side: self.is_richest_pressed.then(find_richest),
            richer_side: self.level_side.and_then(|side| faces::find_richer_side(side, &clusters, reach_mm)),
        };
        (facts, clusters)
    }
}

/// Reads the files on all threads, and notes if what they hold cannot be remembered. Each file is read once, however
/// many tables use a part of it. Of many files only what is new is read, if the job was read before.
pub fn read_mesh_files(job: &Job, files: &[ObjectFile], pad: &SensorPad) -> (Vec<MeshFileResult>, Option<Diagnostic>) {
    let readings: Vec<Reading<'_>> = job.object.iter().map(|object| Reading::new(job, object, pad)).collect();
    let keys: Vec<String> = readings.iter().map(Reading::to_key).collect();
    let mut numbers = HashMap::new();
    let mut different = Vec::new();
    let places: Vec<usize> = files
        .iter()
        .map(|file| {
            *numbers.entry((&file.path, &keys[file.entry])).or_insert_with(|| {
                different.push(file);
                different.len() - 1
            })
        })
        .collect();
    let are_few = different.len() <= FEW_FILES;
    let cache = if are_few { None } else { open_cache(job, files, &keys) };
    let store = Arc::new(MeshStore::default());
    let start = SystemTime::now();
    let tables: Vec<Arc<Object>> = readings.iter().map(|reading| Arc::new(reading.object.clone())).collect();
    let read: Vec<(MeshFileResult, Option<FileState>)> = different
        .par_iter()
        .map(|file| {
            let of_file = |sha256: &str| Arc::new(MeshFile::new(&file.path, &tables[file.entry], sha256, &store));
            let now = cache.as_ref().and_then(|_| FileState::of(&file.path, start));
            let known = cache.as_ref().zip(now).and_then(|(cache, now)| cache.find(file.entry, &file.path, now));
            if let Some(known) = known.filter(|known| !known.is_empty()) {
                let source = of_file(&known[0].sha256);
                let part = |(part, facts)| MeshPart { facts, geometry: Geometry::in_file(&source, part) };
                return (Arc::new(Ok(known.into_iter().enumerate().map(part).collect())), now);
            }
            let reading = &readings[file.entry];
            let examined = read_file(&file.path, &reading.object).map(|(parts, names_other_files)| {
                let examined = match parts {
                    FileContent::Plate { mesh, cleaned, sha256 } => {
                        let size = MeshSize::new(&mesh, 1.0, true);
                        vec![reading.examine_mesh(&mesh, cleaned, sha256, size)]
                    }
                    FileContent::Parts(parts) => {
                        let part = |(name, loaded): (String, LoadedMesh)| {
                            reading.examine(Some(name).filter(|name| !name.is_empty()), loaded)
                        };
                        parts.into_iter().map(part).collect()
                    }
                };
                (examined, names_other_files)
            });
            // What depends on other files may change while this one stays.
            let now = now.filter(|_| matches!(examined, Ok((_, false))));
            let parts = examined.map(|(examined, _)| {
                let sha256 = examined.first().map_or("", |(facts, _)| facts.sha256.as_str());
                let source = of_file(sha256);
                let (facts, clusters): (Vec<_>, Vec<_>) = examined.into_iter().unzip();
                let clusters: Vec<Arc<Clusters>> = clusters.into_iter().map(Arc::new).collect();
                let geometry: Vec<Geometry> = match are_few {
                    true => clusters.into_iter().map(Geometry::Held).collect(),
                    false => {
                        let kept = store.keep(&source, clusters);
                        (0..kept.len()).map(|part| Geometry::in_file(&source, part)).collect()
                    }
                };
                facts.into_iter().zip(geometry).map(|(facts, geometry)| MeshPart { facts, geometry }).collect()
            });
            (Arc::new(parts), now)
        })
        .collect();
    let note = cache.and_then(|cache| {
        let known = different.iter().zip(&read).filter_map(|(file, (parts, state))| {
            let parts = Result::as_ref(parts).ok()?;
            Some((file.entry, &*file.path, (*state)?, parts.iter().map(|part| &part.facts).collect()))
        });
        cache.save(known.collect())
    });
    (places.into_iter().map(|place| Arc::clone(&read[place].0)).collect(), note)
}

/// Opens what is remembered of a job with these files, whose tables are read as `keys` say.
fn open_cache(job: &Job, files: &[ObjectFile], keys: &[String]) -> Option<MeshCache> {
    // A label is the path in the folder of the table, unless the table says otherwise.
    let mut folders = vec![""; job.object.len()];
    for ObjectFile { entry, path, label } in files {
        folders[*entry] = path.to_str().and_then(|path| path.strip_suffix(label.as_str())).unwrap_or("");
    }
    let written = job.object.iter().map(|object| object.path.as_deref().unwrap_or_default());
    let tables: Vec<(&str, &str, &str)> =
        folders.into_iter().zip(written).zip(keys).map(|((folder, path), key)| (folder, path, &**key)).collect();
    MeshCache::open(&tables)
}
