//! What a user should know of a mesh: how bad it is, what it is, and the way out.

use serde::Serialize;

use super::sides::{MOST_ROWS, Side};
use super::{LARGEST_MM, MeshFacts, SensorPad};
use crate::core::pose::Anchor;
use crate::files::figures::{counted, figure};
use crate::files::mesh::MeshFileError;
use crate::job::config::object::{Unit, is_plausible};

/// How bad a finding is.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Severity {
    /// Nothing to say.
    Ok,
    /// Good to know; the images are right.
    Note,
    /// The images are probably not what is wanted.
    Warning,
    /// The mesh cannot be used, or nothing of use would be captured.
    Error,
}

impl Severity {
    /// As it is printed.
    pub fn name(self) -> &'static str {
        match self {
            Self::Ok => "ok",
            Self::Note => "note",
            Self::Warning => "warning",
            Self::Error => "error",
        }
    }
}

/// What was found.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Kind {
    /// The file holds no mesh that can be used.
    Unreadable,
    /// No pose reaches around it.
    TooLarge,
    /// Smaller than a pixel.
    TooSmall,
    /// The coordinates look like another unit's.
    Unit,
    /// Some vertices are not finite.
    NotFinite,
    /// No pixel's centre meets what touches first.
    Slips,
    /// Much of what touches is narrower than two pixels.
    Thin,
    /// So many long triangles that every capture takes long.
    Slow,
    /// Large against the view.
    Large,
    /// So far from its origin that 32-bit floats are coarse.
    FarFromOrigin,
    /// With the bounds centred, what touches first lies outside the view.
    OffCentre,
    /// A flat side covers the whole view.
    Featureless,
    /// Triangles without area were dropped.
    WithoutArea,
    /// Duplicate triangles were dropped.
    Duplicates,
    /// Holes.
    Holes,
    /// Edges of more than two triangles.
    NonManifold,
    /// Triangles that face another way than their neighbours.
    Flipped,
    /// Closed parts that face inwards.
    InsideOut,
    /// Parts with one side only.
    OneSided,
    /// Parts smaller than two pixels.
    Specks,
}

/// One thing to know of a mesh.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
pub struct Finding {
    /// How bad it is.
    pub severity: Severity,
    /// What it is.
    pub kind: Kind,
    /// The same in words.
    pub message: String,
    /// The way out, or why none is needed.
    pub help: String,
}

impl Finding {
    fn new(severity: Severity, kind: Kind, message: impl Into<String>, help: impl Into<String>) -> Self {
        Self { severity, kind, message: message.into(), help: help.into() }
    }
}

/// The fraction of what touches from which on it is worth a note that it is thin, and the fraction from which on a
/// warning.
const THIN_FRACTIONS: [f64; 2] = [0.05, 0.5];

/// A file that cannot be used.
pub fn unreadable(error: MeshFileError) -> Finding {
    let help = error.help();
    // The heading names the file already.
    let error = MeshFileError { path: None, ..error };
    Finding::new(Severity::Error, Kind::Unreadable, error.to_string(), help)
}

/// All that there is to know of a mesh that could be read.
pub fn find(facts: &MeshFacts, pad: &SensorPad) -> Vec<Finding> {
    let mut found: Vec<Finding> = size(facts, pad).into_iter().collect();
    found.extend(cleaning(facts));
    found.extend(slow(facts));
    // In the wrong unit, sides tell nothing.
    if Unit::likely(facts.mm_per_unit, facts.largest_mm(), pad.field_of_view_mm).is_none() {
        found.extend(captured(&facts.sides, pad));
    }
    found.extend(shape(facts, pad));
    found
}

/// The size against the pad.
fn size(facts: &MeshFacts, pad: &SensorPad) -> Option<Finding> {
    let largest_mm = facts.largest_mm();
    let [width, height] = pad.field_of_view_mm;
    let measured = format!("{} mm long under {}", figure(largest_mm), Unit::written(facts.mm_per_unit));
    let likely = Unit::likely(facts.mm_per_unit, largest_mm, pad.field_of_view_mm);
    let help = match likely {
        Some((unit, _)) => {
            format!("if they are, write unit = \"{}\" under [[object]] (here: --unit {})", unit.name(), unit.name())
        }
        None => String::from("scale it in the program it comes from"),
    };
    let looks = likely
        .map_or(String::new(), |(unit, mm)| format!("; its values look like {} ({} mm)", unit.in_words(), figure(mm)));
    if largest_mm > LARGEST_MM {
        let message = format!("{measured}, more than the {LARGEST_MM} mm that positions can span{looks}");
        return Some(Finding::new(Severity::Error, Kind::TooLarge, message, help));
    }
    if largest_mm < pad.pixel_mm() {
        let message = format!("{measured}, less than a pixel ({} mm){looks}", figure(pad.pixel_mm()));
        return Some(Finding::new(Severity::Error, Kind::TooSmall, message, help));
    }
    let view = format!("a view of {} x {} mm", figure(width), figure(height));
    if likely.is_some() {
        return Some(Finding::new(Severity::Warning, Kind::Unit, format!("{measured} against {view}{looks}"), help));
    }
    (!is_plausible(largest_mm, pad.field_of_view_mm)).then(|| {
        let message = format!("{measured} against {view}, and no other unit fits better");
        let help =
            "if that is its size, nothing is wrong: `anchor`, `x_mm` and `y_mm` of [pose] choose the part to press";
        Finding::new(Severity::Note, Kind::Large, message, help)
    })
}

/// What cleaning dropped, and what was rounded before.
fn cleaning(facts: &MeshFacts) -> Vec<Finding> {
    let mut found = Vec::new();
    let cleaned = &facts.cleaned;
    let mut add = |count: usize, severity, kind, one: &str, many: &str, help: &str| {
        if count > 0 {
            found.push(Finding::new(severity, kind, format!("dropped {}", counted(count, one, many)), help));
        }
    };
    add(
        cleaned.non_finite_vertices,
        Severity::Warning,
        Kind::NotFinite,
        "vertex that is not finite, with its triangles",
        "vertices that are not finite, with their triangles",
        "the file is damaged: export it again; there may be holes now",
    );
    let harmless = "nothing to do: a job drops them, too";
    let (one, many) = ("triangle without area", "triangles without area");
    add(cleaned.zero_area, Severity::Note, Kind::WithoutArea, one, many, harmless);
    let (one, many) = ("duplicate triangle", "duplicate triangles");
    add(cleaned.duplicates, Severity::Note, Kind::Duplicates, one, many, harmless);
    found
}

/// How long captures would take.
fn slow(facts: &MeshFacts) -> Option<Finding> {
    (facts.rows_per_capture > MOST_ROWS).then(|| {
        let rows = figure(facts.rows_per_capture);
        let message = format!(
            "its triangles fill {rows} rows of pixels, half a second or more for every capture: its sides are left out"
        );
        let help = "remesh it: many long, thin triangles lie side by side or over each other";
        Finding::new(Severity::Warning, Kind::Slow, message, help)
    })
}

/// What the six captures show.
fn captured(sides: &[Side], pad: &SensorPad) -> Vec<Finding> {
    let mut found = Vec::new();
    let mut add = |severity, kind, message: String, help: &str| {
        found.push(Finding::new(severity, kind, message, help));
    };
    let press = figure(pad.press_mm);
    let two_px = figure(2.0 * pad.pixel_mm());
    if let Some(names) = names(sides, |side| side.slips) {
        let message = format!("{names}: what touches first slips between the pixels: no centre meets it");
        add(Severity::Warning, Kind::Slips, message, "take a sensor with finer pixels, or make it wider than a pixel");
    }
    let worst = sides.iter().map(|side| side.thin_fraction).fold(0.0, f64::max);
    if let Some(names) = names(sides, |side| side.thin_fraction >= THIN_FRACTIONS[0]) {
        let severity = if worst >= THIN_FRACTIONS[1] { Severity::Warning } else { Severity::Note };
        let message = format!(
            "{names}: up to {:.0} % of what touches at {press} mm is narrower than two pixels ({two_px} mm)",
            100.0 * worst
        );
        let help = "it comes and goes with the position: take a sensor with finer pixels, or make it wider";
        add(severity, Kind::Thin, message, help);
    }
    if let Some(names) = names(sides, |side| side.anchor == Some(Anchor::Contact)) {
        let message = format!("{names}: with its bounds in the middle of the view, the lowest point is outside");
        add(Severity::Note, Kind::OffCentre, message, "write anchor = \"contact\" under [pose]");
    }
    if let Some(names) = names(sides, |side| side.anchor.is_none() && !side.slips) {
        let message = format!("{names}: in the middle of the view nothing touches, whatever the anchor");
        add(Severity::Note, Kind::OffCentre, message, "move it with `x_mm` and `y_mm` of [pose]");
    }
    let flat =
        |side: &Side| side.touching_fraction == 1.0 && side.relief_mm.is_some_and(|[low, high]| high - low < 1e-3);
    if let Some(names) = names(sides, flat) {
        let message = format!("{names}: a flat face covers the whole view, where a level press shows nothing");
        add(Severity::Note, Kind::Featureless, message, "tilt it, or move an edge into view with `x_mm` and `y_mm`");
    }
    found
}

/// The names of the sides for which `holds`, if there are any.
fn names(sides: &[Side], holds: impl Fn(&Side) -> bool) -> Option<String> {
    let names: Vec<&str> = sides.iter().filter(|side| holds(side)).map(|side| side.face.name()).collect();
    (!names.is_empty()).then(|| names.join(", "))
}

/// How the triangles hang together, and where they are. Nothing of it makes a depth map wrong.
fn shape(facts: &MeshFacts, pad: &SensorPad) -> Vec<Finding> {
    let surface = &facts.surface;
    let mut found = Vec::new();
    let mut note = |count: usize, kind, message: String, help: &str| {
        if count > 0 {
            found.push(Finding::new(Severity::Note, kind, message, help));
        }
    };
    let (holes, edges) =
        (counted(surface.holes, "hole", "holes"), counted(surface.open_edges, "open edge", "open edges"));
    let message = format!("{holes} with {edges}, the longest {} mm around", figure(surface.longest_rim_mm));
    let help = "capture sees the nearest surface: fine unless a hole faces the pad";
    note(surface.holes, Kind::Holes, message, help);
    let any_way = "nothing to do: capture takes triangles from both sides";
    let crowded = counted(surface.non_manifold_edges, "edge has", "edges have");
    let message = format!("{crowded} more than two triangles");
    note(
        surface.non_manifold_edges,
        Kind::NonManifold,
        message,
        "nothing to do: capture takes every triangle by itself",
    );
    let flipped = counted(surface.flipped_triangles, "triangle faces", "triangles face");
    let message = format!("{flipped} another way than most of the part");
    note(surface.flipped_triangles, Kind::Flipped, message, any_way);
    let (inverted, closed) = (surface.inverted_parts, surface.closed_parts);
    let message = format!("{inverted} of {} inside out, or a cavity", counted(closed, "closed part", "closed parts"));
    note(inverted, Kind::InsideOut, message, any_way);
    let one_sided = counted(surface.one_sided_parts, "part has", "parts have");
    note(surface.one_sided_parts, Kind::OneSided, format!("{one_sided} one side only"), any_way);
    let specks = counted(surface.specks, "part is", "parts are");
    let message = format!("{specks} smaller than two pixels ({} mm)", figure(2.0 * pad.pixel_mm()));
    note(surface.specks, Kind::Specks, message, "remove them if they are left over from a scan");

    let reach_mm = (0..3).map(|k| facts.centre_mm[k].abs() + facts.size_mm[k] / 2.0).fold(0.0, f64::max);
    let step_mm = reach_mm * f64::from(f32::EPSILON);
    let message = format!(
        "it lies {} mm from its origin: where it was ever stored in 32-bit floats, its vertices are rounded to {} mm",
        figure(reach_mm),
        figure(step_mm)
    );
    let is_coarse = step_mm > pad.pixel_mm() / 10.0 && reach_mm > 2.0 * facts.largest_mm();
    note(usize::from(is_coarse), Kind::FarFromOrigin, message, "move it to its origin before it is exported");
    found
}
