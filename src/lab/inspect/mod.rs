//! What a mesh is like, and what a sensor would see of it: what `gelsim inspect` prints.
//!
//! Facts are counted on the cleaned mesh ([`crate::inspect::surface`]) or measured on captures of its six sides
//! ([`sides`]); findings ([`gelsim_job::inspection::findings`]) are what a user should act on, each with a way out. Capture takes
//! the nearest surface whatever way it faces, so holes and flipped triangles are facts, not findings. Whether a surface
//! passes through itself is not looked at, for the same reason.

use std::path::{Path, PathBuf};

use rayon::prelude::*;
use serde::Serialize;

use crate::inspect::surface::{Surface, survey};
use gelsim_core::mesh::CleanupReport;
use gelsim_core::mesh::clusters::Clusters;
use gelsim_files::diagnostic::Severity;
use gelsim_files::length::{Unit, is_plausible};
use gelsim_files::mesh;
use gelsim_files::mesh::{Given, Loaded};
use gelsim_job::config::scene::Face;
use gelsim_job::inspection::findings::{self, Finding};
use gelsim_job::inspection::sides::{self, Side};
use gelsim_job::inspection::{LARGEST_MM, MeshSize, SensorPad};
use gelsim_job::plan::faces;

pub mod job;
pub mod set;
pub mod surface;
pub mod text;

/// All that was inspected; the JSON that `gelsim inspect --json` prints.
#[derive(Clone, Debug, Serialize)]
pub struct InspectReport {
    /// What the meshes were held against.
    pub pad: SensorPad,
    /// One entry per file, in the order asked for.
    pub meshes: Vec<Inspection>,
}

/// One file.
#[derive(Clone, Debug, Serialize)]
pub struct Inspection {
    /// Its path as it was given; what is not UTF-8 in it is replaced.
    pub file: String,
    /// That of the worst finding; `ok` without any.
    #[serde(serialize_with = "or_ok")]
    pub severity: Option<Severity>,
    /// What is known of the mesh; null if it cannot be read.
    pub mesh: Option<MeshFacts>,
    /// What to know of it, the worst first.
    pub findings: Vec<Finding>,
}

/// What was counted and measured.
#[derive(Clone, Debug, Serialize)]
pub struct MeshFacts {
    /// What the file held.
    pub given: Given,
    /// SHA-256 of the file's bytes, lower-case hex.
    pub sha256: String,
    /// The unit that its coordinates were taken for; null if it is none that a job names.
    pub unit: Option<Unit>,
    /// Millimetres that a coordinate of 1 was taken for.
    pub mm_per_unit: f64,
    /// Extents of the cleaned mesh along x, y, z, mm.
    pub size_mm: [f64; 3],
    /// Centre of its bounding box, mm.
    pub centre_mm: [f64; 3],
    /// Its size in every unit that there is.
    pub readings: [Reading; 4],
    /// Vertices after cleaning, each at another place.
    pub vertices: usize,
    /// Triangles after cleaning.
    pub triangles: usize,
    /// What cleaning dropped.
    pub cleaned: CleanupReport,
    /// How the triangles hang together.
    pub surface: Surface,
    /// Rows of the sensor's pixels that its triangles fill, summed up, in the mean capture of a side: time goes with it.
    pub rows_per_capture: f64,
    /// The six sides as captured; none if the mesh is too large, too small or too slow for that.
    pub sides: Vec<Side>,
    /// How large it is, and whether its file says so.
    #[serde(skip)]
    pub size: MeshSize,
    /// The side that `face = "auto"` presses, the one with the most relief; null where the sides were not captured.
    pub auto_face: Option<Face>,
}

/// A mesh's size if its coordinates were in a unit.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Reading {
    /// The unit.
    pub unit: Unit,
    /// The largest extent then, mm.
    pub largest_mm: f64,
    /// That is the size of something one presses into the pad: from a tenth of the view's shorter side to twenty times
    /// its longer one.
    pub plausible: bool,
}

impl MeshFacts {
    fn new(loaded: Loaded, pad: &SensorPad) -> Self {
        let Loaded { mesh, cleaned, sha256, given, mm_per_unit, states_its_unit, .. } = loaded;
        let size = MeshSize::new(&mesh, mm_per_unit, states_its_unit);
        let (size_mm, largest_mm) = (size.size_mm, size.largest_mm());
        let readings = Unit::ALL.map(|other| {
            let largest_mm = largest_mm / mm_per_unit * other.mm();
            Reading { unit: other, largest_mm, plausible: is_plausible(largest_mm, pad.field_of_view_mm) }
        });
        let rows_per_capture = sides::rows(&mesh, pad);
        let is_captured = (pad.pixel_mm()..=LARGEST_MM).contains(&largest_mm) && rows_per_capture <= sides::MOST_ROWS;
        let (sides, auto_face) = if is_captured {
            let object = Clusters::new(&mesh);
            let auto = Face::of(faces::richest(&object, pad.thickness_mm));
            (sides::sides(&object, size_mm, pad), Some(auto))
        } else {
            (Vec::new(), None)
        };
        Self {
            given,
            sha256,
            unit: Unit::of_mm(mm_per_unit),
            mm_per_unit,
            size_mm,
            centre_mm: mesh.centre_mm,
            readings,
            vertices: mesh.vertices.len(),
            triangles: mesh.triangles.len(),
            cleaned,
            surface: survey(&mesh, 2.0 * pad.pixel_mm()),
            rows_per_capture,
            sides,
            size,
            auto_face,
        }
    }

    /// The largest extent, mm.
    pub fn largest_mm(&self) -> f64 {
        self.size.largest_mm()
    }

    /// All that there is to act on.
    fn findings(&self, pad: &SensorPad) -> Vec<Finding> {
        let mut found = findings::of_mesh(&self.size, &self.cleaned, pad);
        found.extend(findings::slow(self.rows_per_capture));
        // Of another size than the true one, sides tell nothing.
        if is_plausible(self.largest_mm(), pad.field_of_view_mm) || self.size.known_from.is_some() {
            found.extend(findings::captured(&self.sides, pad));
        }
        found
    }
}

/// Looks at many meshes, on all threads; the worst first, those as bad as each other by their names. `seen` is told of each.
pub fn inspect_set(
    paths: &[PathBuf],
    reading: mesh::Reading,
    pad: &SensorPad,
    seen: impl Fn() + Sync,
) -> Vec<Inspection> {
    let inspected = |path: &PathBuf| {
        let inspection = inspect(path, reading, pad);
        seen();
        inspection
    };
    let mut found: Vec<Inspection> = paths.par_iter().map(inspected).collect();
    found.sort_by(|a, b| b.severity.cmp(&a.severity).then_with(|| a.file.cmp(&b.file)));
    found
}

/// Reads a mesh and looks at it as `pad` would.
pub fn inspect(path: &Path, reading: mesh::Reading, pad: &SensorPad) -> Inspection {
    let (mesh, mut findings) = match mesh::load(path, reading) {
        Ok(loaded) => {
            let remarks: Vec<Finding> = loaded.remarks.iter().map(findings::remark).collect();
            let facts = MeshFacts::new(loaded, pad);
            let findings = remarks.into_iter().chain(facts.findings(pad)).collect();
            (Some(facts), findings)
        }
        Err(error) => (None, vec![findings::unreadable(error)]),
    };
    findings.sort_by_key(|finding| std::cmp::Reverse(finding.severity));
    let severity = findings.first().map(|finding| finding.severity);
    Inspection { file: path.to_string_lossy().into_owned(), severity, mesh, findings }
}

/// A severity's name in JSON and tables; `ok` without one.
pub fn severity_name(severity: Option<Severity>) -> &'static str {
    severity.map_or("ok", Severity::name)
}

fn or_ok<S: serde::Serializer>(severity: &Option<Severity>, serializer: S) -> Result<S::Ok, S::Error> {
    serializer.serialize_str(severity_name(*severity))
}

#[cfg(test)]
mod tests;
