//! Sets of meshes: which files a path names, and a table of them.

use std::fmt::Write;
use std::io;
use std::path::{Path, PathBuf};

use glob::Pattern;

use super::text::to_single_line;
use super::{Inspection, MeshFacts, severity_name};
use gelsim_files::diagnostic::{Diagnostics, Report};
use gelsim_files::input::find_matching_files;
use gelsim_files::length::is_plausible_length;
use gelsim_files::mesh::Format;
use gelsim_files::number_format::{format_count, format_number};
use gelsim_job::inspection::SensorPad;
use gelsim_job::inspection::findings::FindingKind;

/// Finds the meshes that a path names: those in a folder and its subfolders, those that a pattern matches, else the
/// path itself. The second value is true for a folder or pattern.
///
/// # Errors
///
/// A pattern that is not valid, and folders that the system cannot read.
pub fn find_meshes(path: &Path) -> io::Result<(Vec<PathBuf>, bool)> {
    let text = path.to_string_lossy();
    let is_pattern = text.contains(['*', '?', '[']) && !path.exists();
    if !path.is_dir() && !is_pattern {
        return Ok((vec![path.to_owned()], false));
    }
    let pattern = if is_pattern { text.into_owned() } else { format!("{}/**/*", Pattern::escape(&text)) };
    let mut found =
        find_matching_files(&pattern).map_err(|error| io::Error::other(format!("{pattern}: {}", error.msg)))??;
    if !is_pattern {
        found.retain(|path| Format::from_path(path).is_some());
    }
    Ok((found, true))
}

/// Formats one line per mesh: severity, size, triangles, whether it is closed, its likely unit, name and worst finding.
pub fn to_text_table(meshes: &[Inspection], pad: &SensorPad) -> String {
    let mut text = format!(
        "{:<8} {:>22} {:>9} {:<6} {:<4} {}\n",
        "worst", "size mm", "triangles", "closed", "unit", "file: worst finding"
    );
    for Inspection { file, severity, mesh, findings } in meshes {
        let [size, triangles, closed, unit] = match mesh {
            Some(facts) => size_cells(facts, pad),
            None => [const { String::new() }; 4].map(|_| String::from("-")),
        };
        let worst = findings.first().map_or(String::new(), |finding| match finding.kind {
            // Why is not the same for all.
            FindingKind::Unreadable => format!(": {}", to_single_line(&finding.message)),
            kind => format!(": {}", kind.short_text()),
        });
        let (name, file) = (severity_name(*severity), to_single_line(file));
        let _ = writeln!(text, "{name:<8} {size:>22} {triangles:>9} {closed:<6} {unit:<4} {file}{worst}");
    }
    text
}

/// Collects all findings, each cause once, with what to do.
pub fn collect_findings(meshes: &[Inspection]) -> Report {
    let mut found = Diagnostics::default();
    for Inspection { file, findings, .. } in meshes {
        found.extend(findings.iter().map(|finding| finding.to_diagnostic(&to_single_line(file))));
    }
    Report::new(&found, &[])
}

/// Formats the cells of a mesh: size, triangles, whether it is closed, unit.
fn size_cells(facts: &MeshFacts, pad: &SensorPad) -> [String; 4] {
    let size = facts.size_mm.map(format_number).join(" x ");
    let closed = facts.surface.closed_parts == facts.surface.parts;
    [size, facts.triangles.to_string(), String::from(if closed { "yes" } else { "no" }), likely_unit(facts, pad)]
}

/// Name of the unit that a mesh's values are in or seem to be in; `?` if none fits.
fn likely_unit(facts: &MeshFacts, pad: &SensorPad) -> String {
    if facts.size.known_from.is_some() || is_plausible_length(facts.largest_mm(), pad.field_of_view_mm) {
        return facts.unit.map_or_else(|| format_number(facts.mm_per_unit), |unit| unit.name().to_owned());
    }
    facts.size.guess_unit(pad).map_or(String::from("?"), |(unit, _)| unit.name().to_owned())
}

/// Formats totals: triangles, how many meshes are closed, and the likely units.
pub fn format_totals(meshes: &[Inspection], pad: &SensorPad) -> String {
    let facts: Vec<&MeshFacts> = meshes.iter().filter_map(|mesh| mesh.mesh.as_ref()).collect();
    let triangles: usize = facts.iter().map(|facts| facts.triangles).sum();
    let closed = facts.iter().filter(|facts| facts.surface.closed_parts == facts.surface.parts).count();
    let mut units: Vec<(String, usize)> = Vec::new();
    for unit in facts.iter().map(|facts| likely_unit(facts, pad)) {
        match units.iter_mut().find(|(known, _)| *known == unit) {
            Some((_, count)) => *count += 1,
            None => units.push((unit, 1)),
        }
    }
    units.sort_by_key(|(_, count)| std::cmp::Reverse(*count));
    let units: Vec<String> = units.iter().map(|(unit, count)| format!("{unit} {count}")).collect();
    format!("{}, {closed} closed; units: {}\n", format_count(triangles, "triangle", "triangles"), units.join(", "))
}
