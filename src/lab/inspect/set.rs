//! A whole set of meshes: which files it is, and a table of them.

use std::fmt::Write;
use std::io;
use std::path::{Path, PathBuf};

use glob::Pattern;

use super::text::printable;
use super::{Inspection, MeshFacts, severity_name};
use gelsim_files::diagnostic::{Diagnostics, Report};
use gelsim_files::figures::{counted, figure};
use gelsim_files::input::matching;
use gelsim_files::length::is_plausible;
use gelsim_files::mesh::Format;
use gelsim_job::inspection::SensorPad;

/// The meshes that a path names: those of a folder and of the folders in it, those that a pattern matches, else itself. The
/// second value is true if it may be several.
///
/// # Errors
///
/// A pattern that is none, and folders that the system cannot read.
pub fn meshes(path: &Path) -> io::Result<(Vec<PathBuf>, bool)> {
    let text = path.to_string_lossy();
    let is_pattern = text.contains(['*', '?', '[']) && !path.exists();
    if !path.is_dir() && !is_pattern {
        return Ok((vec![path.to_owned()], false));
    }
    let pattern = if is_pattern { text.into_owned() } else { format!("{}/**/*", Pattern::escape(&text)) };
    let mut found =
        matching(glob::glob(&pattern).map_err(|error| io::Error::other(format!("{pattern}: {}", error.msg)))?)?;
    if !is_pattern {
        found.retain(|path| Format::from_path(path).is_some());
    }
    Ok((found, true))
}

/// A line per mesh: severity, size, triangles, whether it is closed, the unit that its values look like, name and worst finding.
pub fn table(meshes: &[Inspection], pad: &SensorPad) -> String {
    let mut text = format!(
        "{:<8} {:>22} {:>9} {:<6} {:<4} {}\n",
        "worst", "size mm", "triangles", "closed", "unit", "file: worst finding"
    );
    for Inspection { file, severity, mesh, findings } in meshes {
        let [size, triangles, closed, unit] = match mesh {
            Some(facts) => row(facts, pad),
            None => [const { String::new() }; 4].map(|_| String::from("-")),
        };
        let worst = findings.first().map_or(String::new(), |finding| format!(": {}", finding.kind.words()));
        let (name, file) = (severity_name(*severity), printable(file));
        let _ = writeln!(text, "{name:<8} {size:>22} {triangles:>9} {closed:<6} {unit:<4} {file}{worst}");
    }
    text
}

/// What was found, each cause once, with what to do.
pub fn findings(meshes: &[Inspection]) -> Report {
    let mut found = Diagnostics::default();
    for Inspection { file, findings, .. } in meshes {
        found.extend(findings.iter().map(|finding| finding.diagnostic(&printable(file))));
    }
    Report::new(&found, &[])
}

fn row(facts: &MeshFacts, pad: &SensorPad) -> [String; 4] {
    let size = facts.size_mm.map(figure).join(" x ");
    let closed = facts.surface.closed_parts == facts.surface.parts;
    [size, facts.triangles.to_string(), String::from(if closed { "yes" } else { "no" }), looks(facts, pad)]
}

/// The unit that a mesh's values are in or look like; `?` if none fits.
fn looks(facts: &MeshFacts, pad: &SensorPad) -> String {
    if facts.size.known_from.is_some() || is_plausible(facts.largest_mm(), pad.field_of_view_mm) {
        return facts.unit.map_or_else(|| figure(facts.mm_per_unit), |unit| unit.name().to_owned());
    }
    facts.size.likely_unit(pad).map_or(String::from("?"), |(unit, _)| unit.name().to_owned())
}

/// What they are together: triangles, how many are closed, and which units their values look like.
pub fn totals(meshes: &[Inspection], pad: &SensorPad) -> String {
    let facts: Vec<&MeshFacts> = meshes.iter().filter_map(|mesh| mesh.mesh.as_ref()).collect();
    let triangles: usize = facts.iter().map(|facts| facts.triangles).sum();
    let closed = facts.iter().filter(|facts| facts.surface.closed_parts == facts.surface.parts).count();
    let mut units: Vec<(String, usize)> = Vec::new();
    for unit in facts.iter().map(|facts| looks(facts, pad)) {
        match units.iter_mut().find(|(known, _)| *known == unit) {
            Some((_, count)) => *count += 1,
            None => units.push((unit, 1)),
        }
    }
    units.sort_by_key(|(_, count)| std::cmp::Reverse(*count));
    let units: Vec<String> = units.iter().map(|(unit, count)| format!("{unit} {count}")).collect();
    format!("{}, {closed} closed; units: {}\n", counted(triangles, "triangle", "triangles"), units.join(", "))
}
