//! Reads the files of a sensor's gel: the mesh of its shape, the table of its pins, and that of the dots printed on it.

use std::sync::Arc;

use glam::DVec3;

use super::check::JobChecker;
use super::markers::read_marker_file;
use super::{files, paths};
use crate::config::Job;
use crate::config::object::Unit;
use gelsim_core::base::gel_surface::{GelSurface, GelSurfaceError};
use gelsim_files::diagnostic::Diagnostic;
use gelsim_files::mesh;
use gelsim_files::number_format::format_number;
use gelsim_files::sensor::Sensor;
use gelsim_files::sensor::pins::{PinLayout, parse_pin_table};
use gelsim_files::sensor::shape::{GelMesh, SensorShape};

/// The least and greatest width of a gel, mm.
const WIDTHS_MM: [f64; 2] = [1.0, 1e3];
/// Most triangles of a gel's mesh.
const MAX_TRIANGLES: usize = 500_000;

/// Reads the files that the shape, pins and markers of a job's sensor name, and remembers their hashes.
pub fn read_gel_files(check: &mut JobChecker<'_>, job: &mut Job) {
    if let Some(markers) = &mut job.markers {
        read_marker_file(check, "markers", markers);
    }
    let sensor = &mut job.sensor;
    if let Some(SensorShape::Mesh(mesh)) = &mut sensor.shape {
        mesh.surface = read_gel_surface(check, mesh);
    }
    if let Some(pins) = &mut sensor.pins
        && let PinLayout::File(path) = &mut pins.layout
    {
        // A count of pins from a preset or a sensor file belongs to its own layout. A layout from a file has its own
        // number.
        let source = |key: &str| check.document.place_of(&format!("sensor.pins.{key}")).map(|place| place.source);
        if pins.count.is_some() && source("count") != source("layout") {
            pins.count = None;
        }
        if pins.spacing_mm.is_some() && source("spacing_mm") != source("layout") {
            pins.spacing_mm = None;
        }
        let sha256 = &mut pins.layout_sha256;
        let table = |bytes: &[u8]| Ok(bytes.to_vec());
        let bytes = files::read_input_file(check, "sensor.pins.layout.file", &paths::PINS, path, sha256, table);
        if let Some(bytes) = bytes {
            match parse_pin_table(path, &bytes) {
                Ok(places) => pins.places_mm = Some(Arc::new(places)),
                Err(mistakes) => {
                    for message in mistakes {
                        let help = "the first line is x_mm,y_mm; each further one a pin, mm from the tip over the gel";
                        check.report_error("sensor.pins.layout.file", message, help);
                    }
                }
            }
        }
    }
}

fn read_gel_surface(check: &mut JobChecker<'_>, mesh: &mut GelMesh) -> Option<Arc<GelSurface>> {
    const KEY: &str = "sensor.shape.mesh.path";
    for k in 0..3 {
        check.require_in_range(&format!("sensor.shape.mesh.offset_mm.{k}"), mesh.offset_mm[k], -1e4..=1e4, "mm");
    }
    if paths::refuse_empty_path(check, KEY, &mesh.path, &paths::GELS) {
        return None;
    }
    let found = check.document.folder_of(KEY).join(&mesh.path);
    let Some(path) = found.to_str() else {
        check.report_error(
            KEY,
            "the path of the gel's mesh is not UTF-8, so that no job can hold it",
            "rename the file",
        );
        return None;
    };
    let reading =
        mesh::MeshReadOptions { mm_per_unit: mesh.unit.map(Unit::mm_per_unit), ..mesh::MeshReadOptions::default() };
    let loaded = match mesh::load(&found, reading) {
        Ok(loaded) => loaded,
        Err(error) => {
            let belongs = format!("a mesh of the gel's outer surface belongs here ({})", mesh::ENDINGS);
            let help = match found.is_file() {
                true => format!("{}; {belongs}", error.help()),
                false => format!("{}; {belongs}", paths::suggest_for_missing(check, KEY, &mesh.path, &paths::GELS)),
            };
            check.report_error(KEY, format!("cannot read the gel's mesh {error}"), help);
            return None;
        }
    };
    let (key, file) = (|| String::from("sensor.shape.mesh.sha256"), || format!("the gel's mesh {path}"));
    files::check_hash(check, key, mesh.sha256.as_deref(), &loaded.sha256, file);
    mesh.path = path.to_owned();
    mesh.sha256 = Some(loaded.sha256);
    let mesh::LoadedMesh { mesh: triangles, mm_per_unit, .. } = loaded;
    let half = triangles.vertices.iter().flatten().fold(0.0, |largest: f32, place| largest.max(place.abs()));
    let across_mm = 2.0 * f64::from(half);
    if !(WIDTHS_MM[0]..=WIDTHS_MM[1]).contains(&across_mm) {
        let message = format!(
            "the gel's mesh {path} is {across_mm:.3} mm across, read with {}",
            Unit::format_as_written(mm_per_unit)
        );
        let fits =
            |unit: &Unit| (WIDTHS_MM[0]..=WIDTHS_MM[1]).contains(&(across_mm / mm_per_unit * unit.mm_per_unit()));
        // For a gel that is too small, metres are more likely than inches.
        let fitting = [Unit::M, Unit::Mm, Unit::In, Unit::Cm].into_iter().find(fits);
        let help = match fitting {
            Some(unit) => format!(
                "gels are 1 to 1000 mm large: with unit = \"{}\" it is {} mm",
                unit.name(),
                format_number(across_mm / mm_per_unit * unit.mm_per_unit())
            ),
            None => String::from("gels are 1 to 1000 mm large, and no unit makes this one so: scale it in its file"),
        };
        check.report_error(KEY, message, help);
        return None;
    }
    if triangles.triangles.len() > MAX_TRIANGLES {
        let message = format!("the gel's mesh {path} has {} triangles", triangles.triangles.len());
        check.report_error(KEY, message, format!("allowed: up to {MAX_TRIANGLES}; the surface is smooth between them"));
        return None;
    }
    let offset = DVec3::from_array(triangles.centre_mm) + DVec3::from_array(mesh.offset_mm);
    let point = |vertex: &[f32; 3]| DVec3::from_array(vertex.map(f64::from)) + offset;
    match GelSurface::new(triangles.vertices.iter().map(point).collect(), triangles.triangles) {
        Ok(surface) => Some(Arc::new(surface)),
        Err(error) => {
            check.report_error(KEY, format!("{path}: {error}"), suggest_fix(&error, mesh.offset_mm));
            None
        }
    }
}

/// Suggests what to do about a mesh that is no gel's surface.
fn suggest_fix(error: &GelSurfaceError, offset_mm: [f64; 3]) -> String {
    match error {
        GelSurfaceError::TipElsewhere(z) => {
            let [x, y, moved] = offset_mm;
            let moved = libm::round((moved - z) * 1e3) / 1e3 + 0.0;
            format!("the tip is where the z axis leaves the gel: write offset_mm = [{x:?}, {y:?}, {moved:?}]")
        }
        GelSurfaceError::NoTip(low, high) => {
            let middle = -0.5 * (*low + *high) + DVec3::from_array(offset_mm);
            let [x, y] = [middle.x, middle.y].map(|mm| libm::round(mm * 1e3) / 1e3 + 0.0);
            format!(
                "the tip is where the z axis leaves the gel: turn the mesh, or move it with offset_mm = [{x:?}, {y:?}, {z:?}]",
                z = offset_mm[2]
            )
        }
        GelSurfaceError::SteepTip(_) => String::from("z goes out of the gel at its tip: turn the mesh in its file"),
        GelSurfaceError::SheetsMeet(_) => {
            String::from("the gel's outer surface is one sheet: delete what else is in the file")
        }
        GelSurfaceError::Pieces { .. } => String::from(
            "the gel's outer surface is one piece: delete what else is in the file, or join what belongs together",
        ),
        GelSurfaceError::Twisted(_) => String::from("delete or fix the triangles there"),
    }
}

/// Makes notes for a gel's mesh that is allowed but will be seen to be coarse.
pub fn note_coarse_gel(sensor: &Sensor) -> Vec<Diagnostic> {
    /// Angle between facets from which an edge is visible, degrees.
    const COARSE_DEG: f64 = 20.0;
    let Some(SensorShape::Mesh(GelMesh { path, surface: Some(surface), .. })) = &sensor.shape else {
        return Vec::new();
    };
    let mut notes = Vec::new();
    let coarsest = surface.coarsest_deg();
    if coarsest > COARSE_DEG {
        let message = format!("{path}: the gel's surface turns by {coarsest:.0} degrees over one edge");
        notes.push(Diagnostic::note(message).help("a finer mesh is truer to the shape"));
    }
    if surface.sharp_edges() > 0 {
        let message = format!("{path}: {} edges are sharper than 40 degrees and stay so", surface.sharp_edges());
        notes.push(Diagnostic::warning(message).help("press beside them: contacts over them are not simulated well"));
    }
    notes
}
