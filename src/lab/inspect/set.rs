//! A whole set of meshes: which files it is, and a table of them.

use std::fmt::Write;
use std::io;
use std::path::{Path, PathBuf};

use glob::Pattern;

use super::text::printable;
use super::{Inspection, MeshFacts};
use crate::files::figures::{counted, figure};
use crate::files::input::matching;
use crate::files::mesh::Format;
use crate::job::config::object::{Unit, is_plausible};

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
pub fn table(meshes: &[Inspection], field_of_view_mm: [f64; 2]) -> String {
    let mut text = format!(
        "{:<8} {:>24} {:>10} {:<6} {:<4} {}\n",
        "worst", "size mm", "triangles", "closed", "unit", "file: worst finding"
    );
    for Inspection { file, severity, mesh, findings } in meshes {
        let [size, triangles, closed, unit] = match mesh {
            Some(facts) => row(facts, field_of_view_mm),
            None => [const { String::new() }; 4].map(|_| String::from("-")),
        };
        let worst = findings.first().map_or(String::new(), |finding| format!(": {}", finding.message));
        let (name, file) = (severity.name(), printable(file));
        let _ = writeln!(text, "{name:<8} {size:>24} {triangles:>10} {closed:<6} {unit:<4} {file}{worst}");
    }
    text
}

fn row(facts: &MeshFacts, field_of_view_mm: [f64; 2]) -> [String; 4] {
    let size = facts.size_mm.map(figure).join(" x ");
    let closed = facts.surface.closed_parts == facts.surface.parts;
    [size, facts.triangles.to_string(), String::from(if closed { "yes" } else { "no" }), looks(facts, field_of_view_mm)]
}

/// The unit that a mesh's values look like; `?` if none fits.
fn looks(facts: &MeshFacts, field_of_view_mm: [f64; 2]) -> String {
    if is_plausible(facts.largest_mm(), field_of_view_mm) {
        return facts.unit.map_or_else(|| figure(facts.mm_per_unit), |unit| unit.name().to_owned());
    }
    let likely = Unit::likely(facts.mm_per_unit, facts.largest_mm(), field_of_view_mm);
    likely.map_or(String::from("?"), |(unit, _)| unit.name().to_owned())
}

/// What they are together: triangles, how many are closed, and which units their values look like.
pub fn totals(meshes: &[Inspection], field_of_view_mm: [f64; 2]) -> String {
    let facts: Vec<&MeshFacts> = meshes.iter().filter_map(|mesh| mesh.mesh.as_ref()).collect();
    let triangles: usize = facts.iter().map(|facts| facts.triangles).sum();
    let closed = facts.iter().filter(|facts| facts.surface.closed_parts == facts.surface.parts).count();
    let mut units: Vec<(String, usize)> = Vec::new();
    for unit in facts.iter().map(|facts| looks(facts, field_of_view_mm)) {
        match units.iter_mut().find(|(known, _)| *known == unit) {
            Some((_, count)) => *count += 1,
            None => units.push((unit, 1)),
        }
    }
    units.sort_by_key(|(_, count)| std::cmp::Reverse(*count));
    let units: Vec<String> = units.iter().map(|(unit, count)| format!("{unit} {count}")).collect();
    format!("{}, {closed} closed; units: {}\n", counted(triangles, "triangle", "triangles"), units.join(", "))
}
