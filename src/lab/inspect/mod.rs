//! What a mesh is like, and what a sensor would see of it: what `gelsim inspect` prints.
//!
//! Facts are counted on the cleaned mesh ([`crate::lab::inspect::surface`]) or measured on captures of its six sides
//! ([`sides`]); findings ([`findings`]) are what a user should know of them, each with a way out. Capture takes the
//! nearest surface whatever way it faces, so holes and flipped triangles are no more than noted. Whether a surface
//! passes through itself is not looked at, for the same reason.

use std::path::{Path, PathBuf};

use rayon::prelude::*;
use serde::Serialize;

use crate::core::base::view::View;
use crate::core::mesh::Cleaned;
use crate::core::mesh::clusters::Clusters;
use crate::files::mesh;
use crate::files::mesh::{Given, Loaded};
use crate::files::sensor::{PRESETS, Sensor};
use crate::job::config::object::{Unit, is_plausible};
use crate::job::config::scene::Face;
use crate::job::plan::faces;
use crate::lab::inspect::surface::{Surface, survey};

pub mod findings;
pub mod job;
pub mod set;
pub mod sides;
pub mod surface;
pub mod text;

use findings::{Finding, Severity};
use sides::Side;

/// All that was inspected; the JSON that `gelsim inspect --json` prints.
#[derive(Clone, Debug, Serialize)]
pub struct InspectReport {
    /// What the meshes were held against.
    pub pad: SensorPad,
    /// One entry per file, in the order asked for.
    pub meshes: Vec<Inspection>,
}

/// The sensor that a mesh is held against.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct SensorPad {
    /// The preset's name.
    pub sensor: String,
    /// Width and height of the image, px.
    pub resolution_px: [usize; 2],
    /// Width and height of the window that the image shows, mm.
    pub field_of_view_mm: [f64; 2],
    /// Distance between pixel centres, mm.
    pub mm_per_px: [f64; 2],
    /// Thickness of the pad, mm.
    pub thickness_mm: f64,
    /// How deep sides are pressed to see what touches, mm: 1, or half of a thinner pad.
    pub press_mm: f64,
}

/// One file.
#[derive(Clone, Debug, Serialize)]
pub struct Inspection {
    /// Its path as it was given; what is not UTF-8 in it is replaced.
    pub file: String,
    /// That of the worst finding; `ok` without any.
    pub severity: Severity,
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
    pub cleaned: Cleaned,
    /// How the triangles hang together.
    pub surface: Surface,
    /// Rows of the sensor's pixels that its triangles fill, summed up, in the mean capture of a side: time goes with it.
    pub rows_per_capture: f64,
    /// The six sides as captured; none if the mesh is too large, too small or too slow for that, or is one of a set.
    pub sides: Vec<Side>,
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

/// The largest extent that there may be, mm: positions in a job reach as far.
pub const LARGEST_MM: f64 = 1e4;

impl SensorPad {
    /// The preset with this name, if there is one.
    pub fn preset(name: &str) -> Option<Self> {
        let (_, text) = PRESETS.iter().find(|(preset, _)| *preset == name)?;
        Some(Self::new(&toml::from_str(text).ok()?))
    }

    /// A sensor's pad.
    pub fn new(sensor: &Sensor) -> Self {
        let resolution_px = sensor.resolution_px.map(|px| px.max(1) as usize);
        let field_of_view_mm = sensor.field_of_view_mm;
        Self {
            sensor: sensor.name.clone(),
            resolution_px,
            field_of_view_mm,
            mm_per_px: [0, 1].map(|k| field_of_view_mm[k] / resolution_px[k] as f64),
            thickness_mm: sensor.gelpad_thickness_mm,
            press_mm: f64::min(1.0, sensor.gelpad_thickness_mm / 2.0),
        }
    }

    /// The larger distance between pixel centres, mm.
    pub fn pixel_mm(&self) -> f64 {
        self.mm_per_px[0].max(self.mm_per_px[1])
    }

    /// The view with every pixel divided into `by` times `by`.
    fn camera(&self, by: usize) -> View {
        View { resolution_px: self.resolution_px.map(|px| px * by), mm_per_px: self.mm_per_px.map(|mm| mm / by as f64) }
    }
}

impl MeshFacts {
    fn new(loaded: Loaded, pad: &SensorPad, look: Look) -> Self {
        let Loaded { mesh, cleaned, sha256, given, mm_per_unit } = loaded;
        // The bounding box is centred on zero.
        let half = |k: usize| mesh.vertices.iter().map(|vertex| vertex[k].abs()).fold(0.0, f32::max);
        let size_mm = [0, 1, 2].map(|k| 2.0 * f64::from(half(k)));
        let largest_mm = size_mm.into_iter().fold(0.0, f64::max);
        let readings = Unit::ALL.map(|other| {
            let largest_mm = largest_mm / mm_per_unit * other.mm();
            Reading { unit: other, largest_mm, plausible: is_plausible(largest_mm, pad.field_of_view_mm) }
        });
        let rows_per_capture = sides::rows(&mesh, pad);
        let is_captured = look == Look::Close
            && (pad.pixel_mm()..=LARGEST_MM).contains(&largest_mm)
            && rows_per_capture <= sides::MOST_ROWS;
        let (sides, auto_face) = match is_captured {
            true => {
                let object = Clusters::new(&mesh);
                let auto = Face::of(faces::richest(&object, pad.thickness_mm));
                (sides::sides(&object, size_mm, pad), Some(auto))
            }
            false => (Vec::new(), None),
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
            auto_face,
        }
    }

    /// The largest extent, mm.
    pub fn largest_mm(&self) -> f64 {
        self.size_mm.into_iter().fold(0.0, f64::max)
    }
}

/// How much of a mesh is looked at.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Look {
    /// All, with captures of its six sides.
    Close,
    /// All but the captures, which take most of the time.
    Brief,
}

/// Looks briefly at many meshes, on all threads; the worst first, those as bad as each other by their names.
pub fn inspect_set(paths: &[PathBuf], unit: Option<Unit>, pad: &SensorPad) -> Vec<Inspection> {
    let mut found: Vec<Inspection> = paths.par_iter().map(|path| inspect(path, unit, pad, Look::Brief)).collect();
    found.sort_by(|a, b| b.severity.cmp(&a.severity).then_with(|| a.file.cmp(&b.file)));
    found
}

/// Reads a mesh whose coordinates are in `unit`, or in what the file says, and looks at it as `pad` would.
pub fn inspect(path: &Path, unit: Option<Unit>, pad: &SensorPad, look: Look) -> Inspection {
    let reading = mesh::Reading { mm_per_unit: unit.map(Unit::mm), ..Default::default() };
    let (mesh, mut findings) = match mesh::load(path, reading) {
        Ok(loaded) => {
            let facts = MeshFacts::new(loaded, pad, look);
            let findings = findings::find(&facts, pad);
            (Some(facts), findings)
        }
        Err(error) => (None, vec![findings::unreadable(error)]),
    };
    findings.sort_by_key(|finding| std::cmp::Reverse(finding.severity));
    let severity = findings.first().map_or(Severity::Ok, |finding| finding.severity);
    Inspection { file: path.to_string_lossy().into_owned(), severity, mesh, findings }
}

#[cfg(test)]
mod tests;
