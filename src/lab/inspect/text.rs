//! An inspection as text: a block of facts, a table of the six sides, findings with what to do.

use std::fmt::Write;

use super::{Inspection, MeshFacts};
use crate::text_table::TextTable;
use gelsim_core::pose::Anchor;
use gelsim_files::diagnostic::Severity;
use gelsim_files::number_format::{format_count, format_number, format_percent};
use gelsim_job::config::object::Unit;
use gelsim_job::inspection::SensorPad;
use gelsim_job::inspection::findings::{FindingKind, MeshFinding};

/// Formats what the meshes are compared with, followed by an empty line.
pub fn format_heading(pad: &SensorPad) -> String {
    let ([width, height], [x, y]) = (pad.resolution_px, pad.field_of_view_mm.map(format_number));
    let (pixel, thickness) = (format_number(pad.pixel_size_mm()), format_number(pad.thickness_mm));
    format!(
        "against {}: {width} x {height} px on {x} x {y} mm, {pixel} mm/px, pad {thickness} mm thick\n\n",
        pad.sensor
    )
}

/// Formats the block of one mesh, followed by an empty line, for a terminal of `columns`.
pub fn format_inspection(inspection: &Inspection, pad: &SensorPad, columns: Option<usize>) -> String {
    let mut text = to_single_line(&inspection.file) + "\n";
    if let Some(facts) = &inspection.mesh {
        text += &format_facts(facts);
        text += &format_sides(facts, pad, columns);
    }
    for MeshFinding { severity, kind, message, help, .. } in &inspection.findings {
        // The likely unit can be tried at once: say how.
        let unit = inspection
            .mesh
            .as_ref()
            .filter(|_| *kind == FindingKind::Unit)
            .and_then(|facts| facts.size.guess_unit(pad));
        let here = unit.map_or(String::new(), |(unit, _)| format!(" (here: --unit {})", unit.name()));
        let _ = writeln!(text, "  {:<8} {message}\n  {:>8} {help}{here}", severity.name(), "->");
    }
    if inspection.findings.is_empty() {
        text += "  ok       nothing to act on\n";
    }
    text + "\n"
}

/// Formats one line about several meshes: how many have findings of each severity.
pub fn format_summary(inspections: &[Inspection]) -> String {
    let count = |severity| inspections.iter().filter(|inspection| inspection.severity == severity).count();
    format!(
        "{}: {} ok, {} with notes, {} with warnings, {} with errors\n",
        format_count(inspections.len(), "mesh", "meshes"),
        count(None),
        count(Some(Severity::Note)),
        count(Some(Severity::Warning)),
        count(Some(Severity::Error)),
    )
}

/// Formats the facts about a mesh, a line for each.
fn format_facts(facts: &MeshFacts) -> String {
    let mut text = String::new();
    let mut line = |name: &str, what: String| {
        let _ = writeln!(text, "  {name:<8} {what}");
    };
    let MeshFacts { given, surface, .. } = facts;
    line(
        "file",
        format!("{}, {}, sha256 {}", given.format.name(), format_count(given.bytes, "byte", "bytes"), facts.sha256),
    );
    let [x, y, z] = facts.size_mm.map(format_number);
    let [cx, cy, cz] = facts.centre_mm.map(format_number);
    let unit = match facts.unit {
        Some(unit) => format!("unit \"{}\"", unit.name()),
        None => Unit::format_as_written(facts.mm_per_unit),
    };
    line("size", format!("{x} x {y} x {z} mm around ({cx}, {cy}, {cz}), {unit}"));
    let readings: Vec<String> = facts
        .readings
        .iter()
        .map(|reading| {
            let verdict = if reading.plausible { "" } else { " (unlikely)" };
            format!("{}: {} mm{verdict}", reading.unit.name(), format_number(reading.largest_mm))
        })
        .collect();
    line("as unit", readings.join(", "));
    let [triangles, vertices] =
        [format_count(facts.triangles, "triangle", "triangles"), format_count(facts.vertices, "vertex", "vertices")];
    let dropped = [(facts.cleaned.zero_area, "without area"), (facts.cleaned.duplicates, "twice there")];
    let dropped: String = dropped
        .iter()
        .filter(|(count, _)| *count > 0)
        .map(|(count, why)| format!("; {} {why} left out", format_count(*count, "triangle", "triangles")))
        .collect();
    line("mesh", format!("{triangles}, {vertices} (in the file {} and {}){dropped}", given.triangles, given.vertices));
    let mut hangs = vec![format_count(surface.parts, "part", "parts"), format!("{} closed", surface.closed_parts)];
    hangs.push(match surface.holes {
        0 => String::from("0 holes"),
        holes => format!(
            "{} with {}, the longest {} mm around",
            format_count(holes, "hole", "holes"),
            format_count(surface.open_edges, "open edge", "open edges"),
            format_number(surface.longest_rim_mm)
        ),
    });
    for (count, one, many) in [
        (surface.non_manifold_edges, "edge of more than two triangles", "edges of more than two triangles"),
        (surface.flipped_triangles, "triangle that faces another way", "triangles that face another way"),
        (surface.inverted_parts, "part inside out, or a cavity", "parts inside out, or cavities"),
        (surface.one_sided_parts, "part with one side only", "parts with one side only"),
        (surface.specks, "part smaller than two pixels", "parts smaller than two pixels"),
    ] {
        if count > 0 {
            hangs.push(format_count(count, one, many));
        }
    }
    line("surface", hangs.join(", "));
    text
}

/// Formats a table with one line per side: what the camera would see of it.
fn format_sides(facts: &MeshFacts, pad: &SensorPad, columns: Option<usize>) -> String {
    if facts.sides.is_empty() {
        return String::new();
    }
    let depth = format!("at {} mm", format_number(pad.press_mm));
    let mut table = TextTable::new(&[
        ["face", "outline", "outline", "fits", "of view", "relief", "touches", "thin", "anchor"],
        ["", "mm", "px", "", "", "mm", &depth, "", ""],
    ]);
    for side in &facts.sides {
        let [x, y] = side.outline_mm.map(format_number);
        let [u, v] = side.outline_px.map(|px| format!("{px:.0}"));
        let anchor = match side.anchor {
            Some(Anchor::Contact) => "contact",
            Some(_) => "bounds",
            None => "-",
        };
        table.add_row([
            format!("{}{}", side.face.name(), if facts.auto_face == Some(side.face) { "*" } else { "" }),
            format!("{x} x {y}"),
            format!("{u} x {v}"),
            String::from(if side.fits { "yes" } else { "no" }),
            format_percent(side.view_fraction),
            side.relief_mm.map_or(String::from("-"), |[low, high]| format!("{low:.2}..{high:.2}")),
            format!("{} px", side.touching_px),
            format_percent(side.thin_fraction),
            anchor.to_owned(),
        ]);
    }
    let table = table.render(columns.map(|columns| columns.saturating_sub(2)));
    let rows = table.lines().map(|line| if line.is_empty() { String::from("\n") } else { format!("  {line}\n") });
    rows.chain([String::from("  * face = \"auto\" presses this side\n")]).collect()
}

/// Returns a file's name on one line, with control characters escaped.
pub(super) fn to_single_line(file: &str) -> String {
    let plain = |c: char| if c.is_control() { c.escape_default().to_string() } else { c.to_string() };
    file.chars().map(plain).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_file_name_stays_on_its_line() {
        assert_eq!(to_single_line("a b\nü.obj"), "a b\\nü.obj");
    }
}
