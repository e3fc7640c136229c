//! Inspects meshes: what they are like, and what a sensor would see of them. `gelsim inspect` prints it.
//!
//! Facts are counted on the cleaned mesh ([`crate::inspect::surface`]) or measured on captures of its six sides
//! ([`sides`]). Findings ([`gelsim_job::inspection::findings`]) are what a user should act on, each with a remedy.
//! Capture takes the nearest surface, whichever way it faces, so holes and flipped triangles are facts, not findings.
//! For the same reason nobody checks whether a surface passes through itself.

use std::path::{Path, PathBuf};

use rayon::prelude::*;
use serde::Serialize;

use crate::inspect::surface::{MeshSurvey, survey_mesh};
use gelsim_core::mesh::CleanupReport;
use gelsim_core::mesh::clusters::Clusters;
use gelsim_files::diagnostic::Severity;
use gelsim_files::length::{Unit, is_plausible_length};
use gelsim_files::mesh;
use gelsim_files::mesh::{LoadedMesh, MeshFileSummary};
use gelsim_job::config::scene::Face;
use gelsim_job::inspection::findings::{self, MeshFinding};
use gelsim_job::inspection::sides::{self, SideReport};
use gelsim_job::inspection::{MAX_EXTENT_MM, MeshSize, SensorPad};
use gelsim_job::plan::faces;

mod choose;
pub mod job;
pub mod set;
pub mod surface;
pub mod text;

/// Result of an inspection: the JSON that `gelsim inspect --json` prints.
#[derive(Clone, Debug, Serialize)]
pub struct InspectReport {
    /// Sensor that the meshes are compared with.
    pub pad: SensorPad,
    /// One entry per file, in the order asked for.
    pub meshes: Vec<Inspection>,
}

/// One file.
#[derive(Clone, Debug, Serialize)]
pub struct Inspection {
    /// Path as it was given; bytes that are not UTF-8 are replaced.
    pub file: String,
    /// Severity of the worst finding; `ok` without any.
    #[serde(serialize_with = "or_ok")]
    pub severity: Option<Severity>,
    /// Facts about the mesh; null if it cannot be read.
    pub mesh: Option<MeshFacts>,
    /// Findings, the worst first.
    pub findings: Vec<MeshFinding>,
}

/// Facts that were counted and measured.
#[derive(Clone, Debug, Serialize)]
pub struct MeshFacts {
    /// Contents of the file.
    pub given: MeshFileSummary,
    /// SHA-256 of the file's bytes, lower-case hex.
    pub sha256: String,
    /// Unit in which its coordinates were read; null if it is none that a job can name.
    pub unit: Option<Unit>,
    /// Millimetres per unit of the coordinates.
    pub mm_per_unit: f64,
    /// Extents of the cleaned mesh along x, y, z, mm.
    pub size_mm: [f64; 3],
    /// Centre of the bounding box, mm.
    pub centre_mm: [f64; 3],
    /// Size in every unit.
    pub readings: [UnitReading; 4],
    /// Vertices after cleaning, all at different places.
    pub vertices: usize,
    /// Triangles after cleaning.
    pub triangles: usize,
    /// What cleaning dropped.
    pub cleaned: CleanupReport,
    /// How the triangles are connected.
    pub surface: MeshSurvey,
    /// Rows of the sensor's pixels that the triangles fill in the mean capture of a side, summed up: capture time is
    /// proportional to it.
    pub rows_per_capture: f64,
    /// The six sides as captured; none if the mesh is too large, too small or too slow for that.
    pub sides: Vec<SideReport>,
    /// Size, and whether the file states it.
    #[serde(skip)]
    pub size: MeshSize,
    /// Side that `face = "auto"` presses, which has the most relief; null if the sides were not captured.
    pub auto_face: Option<Face>,
}

/// A mesh's size if its coordinates were in a unit.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct UnitReading {
    /// The unit.
    pub unit: Unit,
    /// Largest extent in that unit, mm.
    pub largest_mm: f64,
    /// Whether that is a plausible size of something that is pressed into the pad: from a tenth of the view's shorter
    /// side to twenty times its longer one.
    pub plausible: bool,
}

impl MeshFacts {
    fn new(loaded: LoadedMesh, pad: &SensorPad) -> Self {
        let LoadedMesh { mesh, cleaned, sha256, file_summary: given, mm_per_unit, states_its_unit, .. } = loaded;
        let size = MeshSize::new(&mesh, mm_per_unit, states_its_unit);
        let (size_mm, largest_mm) = (size.size_mm, size.largest_extent_mm());
        let readings = Unit::ALL.map(|other| {
            let largest_mm = largest_mm / mm_per_unit * other.mm_per_unit();
            UnitReading { unit: other, largest_mm, plausible: is_plausible_length(largest_mm, pad.field_of_view_mm) }
        });
        let rows_per_capture = pad.count_capture_rows(&mesh);
        let is_captured =
            (pad.pixel_size_mm()..=MAX_EXTENT_MM).contains(&largest_mm) && rows_per_capture <= sides::MAX_ROWS;
        let (sides, auto_face) = if is_captured {
            let object = Clusters::new(&mesh);
            let auto = Face::from_side(faces::find_richest_side(&object, pad.thickness_mm));
            (sides::capture_sides(&object, size_mm, pad), Some(auto))
        } else {
            (Vec::new(), None)
        };
        Self {
            given,
            sha256,
            unit: Unit::from_mm(mm_per_unit),
            mm_per_unit,
            size_mm,
            centre_mm: mesh.centre_mm,
            readings,
            vertices: mesh.vertices.len(),
            triangles: mesh.triangles.len(),
            cleaned,
            surface: survey_mesh(&mesh, 2.0 * pad.pixel_size_mm()),
            rows_per_capture,
            sides,
            size,
            auto_face,
        }
    }

    /// Largest extent, mm.
    pub fn largest_mm(&self) -> f64 {
        self.size.largest_extent_mm()
    }

    /// Lists all findings.
    fn list_findings(&self, pad: &SensorPad) -> Vec<MeshFinding> {
        let mut found = findings::inspect_mesh(&self.size, &self.cleaned, pad);
        found.extend(findings::report_slow(self.rows_per_capture));
        // At a wrong size the captured sides mean nothing.
        if is_plausible_length(self.largest_mm(), pad.field_of_view_mm) || self.size.known_from.is_some() {
            found.extend(findings::report_captures(&self.sides, pad));
        }
        found
    }
}

/// Inspects many meshes on all threads. Returns the worst first, and equally bad ones by their names. Calls `seen`
/// after each.
pub fn inspect_meshes(
    paths: &[PathBuf],
    reading: mesh::MeshReadOptions,
    pad: &SensorPad,
    seen: impl Fn() + Sync,
) -> Vec<Inspection> {
    let inspected = |path: &PathBuf| {
        let inspection = inspect_mesh(path, reading, pad);
        seen();
        inspection
    };
    let mut found: Vec<Inspection> = paths.par_iter().map(inspected).collect();
    found.sort_by(|a, b| b.severity.cmp(&a.severity).then_with(|| a.file.cmp(&b.file)));
    found
}

/// Reads a mesh and inspects it for the sensor's pad.
pub fn inspect_mesh(path: &Path, reading: mesh::MeshReadOptions, pad: &SensorPad) -> Inspection {
    let (mesh, mut findings) = match mesh::load(path, reading) {
        Ok(loaded) => {
            let remarks: Vec<MeshFinding> = loaded.remarks.iter().map(findings::report_remark).collect();
            let facts = MeshFacts::new(loaded, pad);
            let findings = remarks.into_iter().chain(facts.list_findings(pad)).collect();
            (Some(facts), findings)
        }
        Err(error) => (None, vec![findings::report_unreadable(error)]),
    };
    findings.sort_by_key(|finding| std::cmp::Reverse(finding.severity));
    let severity = findings.first().map(|finding| finding.severity);
    Inspection { file: path.to_string_lossy().into_owned(), severity, mesh, findings }
}

/// Name of a severity in JSON and tables; `ok` without one.
pub fn severity_name(severity: Option<Severity>) -> &'static str {
    severity.map_or("ok", Severity::name)
}

fn or_ok<S: serde::Serializer>(severity: &Option<Severity>, serializer: S) -> Result<S::Ok, S::Error> {
    serializer.serialize_str(severity_name(*severity))
}

#[cfg(test)]
mod tests;
