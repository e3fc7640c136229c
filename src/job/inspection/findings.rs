//! What a user should know of a mesh: how severe it is, what it is, and what to do.

use serde::Serialize;

use super::sides::{MAX_ROWS, SideReport};
use super::{MAX_EXTENT_MM, MeshSize, SensorPad};
use gelsim_core::mesh::CleanupReport;
use gelsim_core::pose::Anchor;
use gelsim_files::diagnostic::{Diagnostic, Severity};
use gelsim_files::length::{Unit, is_plausible_length};
use gelsim_files::mesh::{MeshFileError, Remark};
use gelsim_files::number_format::{format_count, format_number};
use gelsim_files::spelling::strip_os_error_codes;

/// Kinds of findings.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum FindingKind {
    /// The file holds no mesh that can be used.
    Unreadable,
    /// It is larger than positions can span.
    TooLarge,
    /// It is smaller than a pixel.
    TooSmall,
    /// Its coordinates look like another unit.
    Unit,
    /// Some vertices are not finite.
    NotFinite,
    /// No pixel's centre meets what touches first.
    Slips,
    /// Much of what touches is narrower than two pixels.
    Thin,
    /// It has so many long triangles that every capture takes long.
    Slow,
    /// It is large compared with the view.
    Large,
    /// It is so far from its origin that 32-bit floats are coarse there.
    FarFromOrigin,
    /// With its bounds centred, what touches first lies outside the view.
    OffCentre,
    /// A flat side covers the whole view.
    Featureless,
    /// It was divided by its own size, so that its real size is unknown.
    Normalised,
    /// Its format is not the one that its extension says.
    Misnamed,
    /// The file counts another number of triangles than it holds.
    Count,
}

impl FindingKind {
    /// Returns the finding in a few words.
    pub fn short_text(self) -> &'static str {
        match self {
            Self::Unreadable => "cannot be read",
            Self::TooLarge => "too large",
            Self::TooSmall => "too small",
            Self::Unit => "another unit?",
            Self::Normalised => "has no unit",
            Self::NotFinite => "not finite",
            Self::Slips => "slips between pixels",
            Self::Thin => "thin",
            Self::Slow => "slow",
            Self::Large => "large",
            Self::FarFromOrigin => "far from its origin",
            Self::OffCentre => "touches off centre",
            Self::Featureless => "flat",
            Self::Misnamed => "another format",
            Self::Count => "miscounted",
        }
    }

    /// Returns what is true of several meshes, to stand after their number.
    fn plural_cause(self) -> &'static str {
        match self {
            Self::Unreadable => "meshes cannot be read",
            Self::TooLarge => "meshes are larger than positions can span",
            Self::TooSmall => "meshes are smaller than a pixel",
            Self::Unit => "meshes look like another unit",
            Self::Normalised => "meshes are divided by their own size and have no unit",
            Self::NotFinite => "meshes have vertices that are not finite, which were dropped",
            Self::Slips => "meshes slip between the pixels with what touches first",
            Self::Thin => "meshes touch with what is mostly narrower than two pixels",
            Self::Slow => "meshes take long to be captured",
            Self::Large => "meshes are much larger than the view",
            Self::FarFromOrigin => "meshes are far from their origin, and rounded",
            Self::OffCentre => "meshes touch beside the middle of the view, or not at all",
            Self::Featureless => "meshes have flat faces larger than the view",
            Self::Misnamed => "meshes are of another format than their endings say, and read as that",
            Self::Count => "meshes hold other triangles than they count",
        }
    }
}

/// A finding about a mesh.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
pub struct MeshFinding {
    /// How severe it is.
    pub severity: Severity,
    /// The kind of finding.
    pub kind: FindingKind,
    /// The finding in one sentence.
    pub message: String,
    /// What to do.
    pub help: String,
    /// What differs from mesh to mesh, in a few words; empty if nothing does.
    #[serde(skip)]
    detail: String,
}

impl MeshFinding {
    fn new(severity: Severity, kind: FindingKind, message: impl Into<String>, help: impl Into<String>) -> Self {
        Self { severity, kind, message: strip_os_error_codes(message.into()), help: help.into(), detail: String::new() }
    }

    fn with_detail(mut self, detail: String) -> Self {
        self.detail = detail;
        self
    }

    /// Returns true if the mesh probably does not have the size as which it was read.
    pub fn doubts_the_size(&self) -> bool {
        matches!(self.kind, FindingKind::TooLarge | FindingKind::TooSmall | FindingKind::Unit | FindingKind::Normalised)
    }

    /// Converts to a diagnostic about the mesh that messages call `shown`. Findings of the same kind become one
    /// message.
    pub fn to_diagnostic(&self, shown: &str) -> Diagnostic {
        let subject = if self.detail.is_empty() { shown.to_owned() } else { format!("{shown} ({})", self.detail) };
        let problem = Diagnostic::new(format!("{shown}: {}", self.message)).help(self.help.as_str());
        let problem = if self.doubts_the_size() { problem.explaining_no_contact() } else { problem };
        Diagnostic { severity: self.severity, ..problem }.about(subject, self.kind.plural_cause())
    }
}

/// Fractions of what touches: from the first on there is a note that it is thin, from the second on a warning.
pub const THIN_FRACTIONS: [f64; 2] = [0.2, 0.5];

/// Makes the finding for a file that cannot be used.
pub fn report_unreadable(error: MeshFileError) -> MeshFinding {
    let help = error.help();
    // The heading of the message already names the file.
    let error = MeshFileError { path: None, ..error };
    MeshFinding::new(Severity::Error, FindingKind::Unreadable, error.to_string(), help)
}

/// Makes the finding for something that was unclear when a file was read.
pub fn report_remark(remark: &Remark) -> MeshFinding {
    let (severity, kind) = match remark {
        Remark::Misnamed(_) => (Severity::Note, FindingKind::Misnamed),
        Remark::Count { .. } => (Severity::Warning, FindingKind::Count),
    };
    MeshFinding::new(severity, kind, remark.to_string(), remark.help())
}

/// Finds what a user should know of the mesh itself: its size compared with the pad, and what was dropped of it.
pub fn inspect_mesh(size: &MeshSize, cleaned: &CleanupReport, pad: &SensorPad) -> Vec<MeshFinding> {
    [compare_with_view(size, pad), report_not_finite(cleaned), report_far_from_origin(size, pad)]
        .into_iter()
        .flatten()
        .collect()
}

/// Compares the size with the view. Another unit is suggested only if nothing states one.
fn compare_with_view(size: &MeshSize, pad: &SensorPad) -> Option<MeshFinding> {
    let largest_mm = size.largest_extent_mm();
    let [width, height] = pad.field_of_view_mm;
    let under = format!("under {}", Unit::format_as_written(size.mm_per_unit));
    let by = size.known_from.map_or(&*under, |source| source.words());
    let measured = format!("{} mm long {by}", format_number(largest_mm));
    let detail = format!("{} mm", format_number(largest_mm));
    let view = format!("a view of {} x {} mm", format_number(width), format_number(height));
    let likely = size.guess_unit(pad);
    let (looks, help) = match likely {
        _ if is_plausible_length(largest_mm, pad.field_of_view_mm) => return None,
        Some((unit, mm)) => (
            format!("; its values look like {} ({} mm)", unit.plural_name(), format_number(mm)),
            format!("if they are, write unit = \"{}\" under [[object]]", unit.name()),
        ),
        None => (
            String::new(),
            format!("write how long it is under [[object]]: length_mm = {}", format_number(usual_length_mm(pad))),
        ),
    };
    let finding = |severity, kind, message: String| {
        Some(MeshFinding::new(severity, kind, message, help.as_str()).with_detail(detail.clone()))
    };
    if largest_mm > MAX_EXTENT_MM {
        let message = format!("{measured}, more than the {MAX_EXTENT_MM} mm that positions can span{looks}");
        return finding(Severity::Warning, FindingKind::TooLarge, message);
    }
    if largest_mm < pad.pixel_size_mm() {
        let message = format!("{measured}, less than a pixel ({} mm){looks}", format_number(pad.pixel_size_mm()));
        return finding(Severity::Warning, FindingKind::TooSmall, message);
    }
    if size.is_normalised() {
        let message = format!(
            "{measured}: its coordinates were divided by its own size, as in sets for learning, so that no unit fits it"
        );
        return finding(Severity::Warning, FindingKind::Normalised, message);
    }
    if likely.is_some() {
        return finding(Severity::Warning, FindingKind::Unit, format!("{measured} against {view}{looks}"));
    }
    let message = format!("{measured} against {view}");
    let help = "if that is its size, `anchor`, `x_mm` and `y_mm` of [pose] choose the part to press; if not, write length_mm under [[object]]";
    Some(MeshFinding::new(Severity::Note, FindingKind::Large, message, help).with_detail(detail))
}

/// Returns a length that fits a pad's view, mm.
pub fn usual_length_mm(pad: &SensorPad) -> f64 {
    pad.field_of_view_mm[0].min(pad.field_of_view_mm[1]).round()
}

impl MeshSize {
    /// Guesses the unit of the coordinates if they do not look like the one with which they were read. Returns the
    /// unit, and the mesh's length in mm with it; `None` if the size is plausible or the unit is known.
    pub fn guess_unit(&self, pad: &SensorPad) -> Option<(Unit, f64)> {
        let may_be = self.known_from.is_none() && !self.is_normalised();
        may_be
            .then(|| Unit::guess_from_size(self.mm_per_unit, self.largest_extent_mm(), pad.field_of_view_mm))
            .flatten()
    }
}

/// Reports vertices that were dropped since they are not finite. Whatever else is dropped changes no image.
fn report_not_finite(cleaned: &CleanupReport) -> Option<MeshFinding> {
    (cleaned.non_finite_vertices > 0).then(|| {
        let (one, many) =
            ("vertex that is not finite, with its triangles", "vertices that are not finite, with their triangles");
        let message = format!("dropped {}", format_count(cleaned.non_finite_vertices, one, many));
        let help = "the file is damaged: export it again; there may be holes now";
        MeshFinding::new(Severity::Warning, FindingKind::NotFinite, message, help)
            .with_detail(format!("{} vertices", cleaned.non_finite_vertices))
    })
}

/// Reports a mesh so far from its origin that 32-bit floats are coarse there.
fn report_far_from_origin(size: &MeshSize, pad: &SensorPad) -> Option<MeshFinding> {
    let reach_mm = (0..3).map(|k| size.centre_mm[k].abs() + size.size_mm[k] / 2.0).fold(0.0, f64::max);
    let step_mm = reach_mm * f64::from(f32::EPSILON);
    (step_mm > pad.pixel_size_mm() / 10.0 && reach_mm > 2.0 * size.largest_extent_mm()).then(|| {
        let message = format!(
            "it lies {} mm from its origin: where it was ever stored in 32-bit floats, its vertices are rounded to {} mm",
            format_number(reach_mm),
            format_number(step_mm)
        );
        MeshFinding::new(Severity::Note, FindingKind::FarFromOrigin, message, "move it to its origin before it is exported")
            .with_detail(format!("{} mm", format_number(reach_mm)))
    })
}

/// Reports captures that would take long.
pub fn report_slow(rows_per_capture: f64) -> Option<MeshFinding> {
    (rows_per_capture > MAX_ROWS).then(|| {
        let rows = format_number(rows_per_capture);
        let message = format!("its triangles fill {rows} rows of pixels, half a second or more for every capture");
        let help = "remesh it: many long, thin triangles lie side by side or over each other";
        MeshFinding::new(Severity::Warning, FindingKind::Slow, message, help)
    })
}

/// Makes the finding that the fraction `fraction` of what touches is thin.
pub fn report_thin(what: &str, fraction: f64, pad: &SensorPad) -> MeshFinding {
    let severity = if fraction >= THIN_FRACTIONS[1] { Severity::Warning } else { Severity::Note };
    let message = format!("{what} is narrower than two pixels ({} mm)", format_number(2.0 * pad.pixel_size_mm()));
    let help =
        "contact comes and goes with the position there: give walls a thickness, or take a sensor with finer pixels";
    MeshFinding::new(severity, FindingKind::Thin, message, help).with_detail(format!("{:.0} %", 100.0 * fraction))
}

/// Makes the finding that what touches slips between the pixels' centres.
pub fn report_slipping(what: &str, pad: &SensorPad) -> MeshFinding {
    let message = format!("{what} slips between the pixels: no centre meets it");
    let help = format!(
        "make it wider than a pixel ({} mm), or take a sensor with finer pixels",
        format_number(pad.pixel_size_mm())
    );
    MeshFinding::new(Severity::Warning, FindingKind::Slips, message, help)
}

/// Reports what the captures of the six sides show.
pub fn report_captures(sides: &[SideReport], pad: &SensorPad) -> Vec<MeshFinding> {
    let mut found = Vec::new();
    let press = format_number(pad.press_mm);
    if let Some(names) = join_side_names(sides, |side| side.slips) {
        found.push(report_slipping(&format!("{names}: what touches first"), pad));
    }
    let worst = sides.iter().map(|side| side.thin_fraction).fold(0.0, f64::max);
    if let Some(names) = join_side_names(sides, |side| side.thin_fraction >= THIN_FRACTIONS[0]) {
        let what = format!("{names}: up to {:.0} % of what touches at {press} mm", 100.0 * worst);
        found.push(report_thin(&what, worst, pad));
    }
    if let Some(names) = join_side_names(sides, |side| side.anchor == Some(Anchor::Contact)) {
        let message = format!("{names}: with its bounds in the middle of the view, the lowest point is outside");
        found.push(MeshFinding::new(
            Severity::Note,
            FindingKind::OffCentre,
            message,
            "write anchor = \"contact\" under [pose]",
        ));
    }
    if let Some(names) = join_side_names(sides, |side| side.anchor.is_none() && !side.slips) {
        let message = format!("{names}: in the middle of the view nothing touches, whatever the anchor");
        found.push(MeshFinding::new(
            Severity::Note,
            FindingKind::OffCentre,
            message,
            "move it with `x_mm` and `y_mm` of [pose]",
        ));
    }
    let flat = |side: &SideReport| {
        side.touching_fraction == 1.0 && side.relief_mm.is_some_and(|[low, high]| high - low < 1e-3)
    };
    if let Some(names) = join_side_names(sides, flat) {
        let message = format!("{names}: a flat face covers the whole view, where a level press shows nothing");
        found.push(MeshFinding::new(
            Severity::Note,
            FindingKind::Featureless,
            message,
            "tilt it, or move an edge into view with `x_mm` and `y_mm`",
        ));
    }
    found
}

/// Joins the names of the sides for which `holds` is true; `None` if there are none.
fn join_side_names(sides: &[SideReport], holds: impl Fn(&SideReport) -> bool) -> Option<String> {
    let names: Vec<&str> = sides.iter().filter(|side| holds(side)).map(|side| side.face.name()).collect();
    (!names.is_empty()).then(|| names.join(", "))
}
