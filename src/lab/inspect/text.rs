//! An inspection as text: a block of facts, a table of the six sides, findings with their ways out.

use std::fmt::Write;

use super::findings::{Finding, Severity};
use super::{Inspection, MeshFacts, SensorPad};
use crate::core::pose::Anchor;
use crate::files::figures::{counted, figure, percent};
use crate::job::config::object::Unit;

/// What the meshes are held against, with an empty line at its end.
pub fn heading(pad: &SensorPad) -> String {
    let ([width, height], [x, y]) = (pad.resolution_px, pad.field_of_view_mm.map(figure));
    let (pixel, thickness) = (figure(pad.pixel_mm()), figure(pad.thickness_mm));
    format!(
        "against {}: {width} x {height} px on {x} x {y} mm, {pixel} mm/px, pad {thickness} mm thick\n\n",
        pad.sensor
    )
}

/// The block of one mesh, with an empty line at its end.
pub fn block(inspection: &Inspection, pad: &SensorPad) -> String {
    let mut text = printable(&inspection.file) + "\n";
    if let Some(facts) = &inspection.mesh {
        text += &about(facts);
        text += &sides(facts, pad);
    }
    for Finding { severity, message, help, .. } in &inspection.findings {
        let _ = writeln!(text, "  {:<8} {message}\n  {:>8} {help}", severity.name(), "->");
    }
    if inspection.severity == Severity::Ok {
        text += "  ok       nothing to note\n";
    }
    text + "\n"
}

/// One line about several meshes: how many are how bad.
pub fn summary(inspections: &[Inspection]) -> String {
    let count = |severity| inspections.iter().filter(|inspection| inspection.severity == severity).count();
    format!(
        "{}: {} ok, {} with notes, {} with warnings, {} with errors\n",
        counted(inspections.len(), "mesh", "meshes"),
        count(Severity::Ok),
        count(Severity::Note),
        count(Severity::Warning),
        count(Severity::Error),
    )
}

fn about(facts: &MeshFacts) -> String {
    let mut text = String::new();
    let mut line = |name: &str, what: String| {
        let _ = writeln!(text, "  {name:<8} {what}");
    };
    let MeshFacts { given, surface, .. } = facts;
    line(
        "file",
        format!("{}, {}, sha256 {}", given.format.name(), counted(given.bytes, "byte", "bytes"), facts.sha256),
    );
    let [x, y, z] = facts.size_mm.map(figure);
    let [cx, cy, cz] = facts.centre_mm.map(figure);
    let unit = match facts.unit {
        Some(unit) => format!("unit \"{}\"", unit.name()),
        None => Unit::written(facts.mm_per_unit),
    };
    line("size", format!("{x} x {y} x {z} mm around ({cx}, {cy}, {cz}), {unit}"));
    let readings: Vec<String> = facts
        .readings
        .iter()
        .map(|reading| {
            let verdict = if reading.plausible { "" } else { " (unlikely)" };
            format!("{}: {} mm{verdict}", reading.unit.name(), figure(reading.largest_mm))
        })
        .collect();
    line("as unit", readings.join(", "));
    let [triangles, vertices] =
        [counted(facts.triangles, "triangle", "triangles"), counted(facts.vertices, "vertex", "vertices")];
    line("mesh", format!("{triangles}, {vertices} (in the file {} and {})", given.triangles, given.vertices));
    let mut hangs = vec![
        counted(surface.parts, "part", "parts"),
        format!("{} closed", surface.closed_parts),
        counted(surface.holes, "hole", "holes"),
    ];
    for (count, one, many) in [
        (surface.non_manifold_edges, "crowded edge", "crowded edges"),
        (surface.flipped_triangles, "flipped triangle", "flipped triangles"),
        (surface.inverted_parts, "part inside out", "parts inside out"),
    ] {
        if count > 0 {
            hangs.push(counted(count, one, many));
        }
    }
    line("surface", hangs.join(", "));
    text
}

/// A line per side: what the camera would have under it.
fn sides(facts: &MeshFacts, pad: &SensorPad) -> String {
    if facts.sides.is_empty() {
        return String::new();
    }
    let touching = format!("touches at {} mm", figure(pad.press_mm));
    let mut text = format!(
        "  {:<4} {:>17} {:>15} {:>6} {:>7}  {:<13} {:>15} {:>6}  {}\n",
        "face", "outline mm", "px", "fits", "of view", "relief mm", touching, "thin", "anchor"
    );
    for side in &facts.sides {
        let [x, y] = side.outline_mm.map(figure);
        let [u, v] = side.outline_px.map(|px| format!("{px:.0}"));
        let relief = side.relief_mm.map_or(String::from("-"), |[low, high]| format!("{low:.3}..{high:.3}"));
        let anchor = match side.anchor {
            Some(Anchor::Contact) => "contact",
            Some(_) => "bounds",
            None => "-",
        };
        let auto = if facts.auto_face == Some(side.face) { "  <- face = \"auto\"" } else { "" };
        let _ = writeln!(
            text,
            "  {:<4} {:>17} {:>15} {:>6} {:>7}  {relief:<13} {:>15} {:>6}  {anchor}{auto}",
            side.face.name(),
            format!("{x} x {y}"),
            format!("{u} x {v}"),
            if side.fits { "yes" } else { "no" },
            percent(side.view_fraction),
            format!("{} px", side.touching_px),
            percent(side.thin_fraction),
        );
    }
    text
}

/// A file's name on one line, whatever is in it.
pub(super) fn printable(file: &str) -> String {
    let plain = |c: char| if c.is_control() { c.escape_default().to_string() } else { c.to_string() };
    file.chars().map(plain).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_file_name_stays_on_its_line() {
        assert_eq!(printable("a b\nü.obj"), "a b\\nü.obj");
    }
}
