//! What a user should know of a mesh: how bad it is, what it is, and the way out.

use serde::Serialize;

use super::sides::{MOST_ROWS, Side};
use super::{LARGEST_MM, MeshSize, SensorPad};
use gelsim_core::mesh::CleanupReport;
use gelsim_core::pose::Anchor;
use gelsim_files::diagnostic::{Diagnostic, Severity};
use gelsim_files::figures::{counted, figure};
use gelsim_files::length::{Unit, is_plausible};
use gelsim_files::mesh::{MeshFileError, Remark};
use gelsim_files::spelling::without_codes;

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
    /// Divided by its own size, so that nothing says how large it is.
    Normalised,
    /// Of another format than its ending says.
    Misnamed,
    /// It counts other triangles than it holds.
    Count,
}

impl Kind {
    /// In few words.
    pub fn words(self) -> &'static str {
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

    /// What is true of several meshes, behind their number.
    fn cause(self) -> &'static str {
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

/// One thing to know of a mesh.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
pub struct Finding {
    /// How bad it is.
    pub severity: Severity,
    /// What it is.
    pub kind: Kind,
    /// The same in words.
    pub message: String,
    /// The way out.
    pub help: String,
    /// What differs from mesh to mesh, in few words; empty if nothing does.
    #[serde(skip)]
    detail: String,
}

impl Finding {
    fn new(severity: Severity, kind: Kind, message: impl Into<String>, help: impl Into<String>) -> Self {
        Self { severity, kind, message: without_codes(message.into()), help: help.into(), detail: String::new() }
    }

    fn detail(mut self, detail: String) -> Self {
        self.detail = detail;
        self
    }

    /// True if the mesh is probably not as large as it was taken for.
    pub fn doubts_the_size(&self) -> bool {
        matches!(self.kind, Kind::TooLarge | Kind::TooSmall | Kind::Unit | Kind::Normalised)
    }

    /// The same as it is said of a mesh that messages call `shown`: with others of its kind in one message.
    pub fn diagnostic(&self, shown: &str) -> Diagnostic {
        let subject = if self.detail.is_empty() { shown.to_owned() } else { format!("{shown} ({})", self.detail) };
        let problem = Diagnostic::new(format!("{shown}: {}", self.message)).help(self.help.as_str());
        let problem = if self.doubts_the_size() { problem.explains_misses() } else { problem };
        Diagnostic { severity: self.severity, ..problem }.of(subject, self.kind.cause())
    }
}

/// The fraction of what touches from which on it is worth a note that it is thin, and the fraction from which on a
/// warning.
pub const THIN_FRACTIONS: [f64; 2] = [0.2, 0.5];

/// A file that cannot be used.
pub fn unreadable(error: MeshFileError) -> Finding {
    let help = error.help();
    // The heading names the file already.
    let error = MeshFileError { path: None, ..error };
    Finding::new(Severity::Error, Kind::Unreadable, error.to_string(), help)
}

/// What was unclear when a file was read.
pub fn remark(remark: &Remark) -> Finding {
    let (severity, kind) = match remark {
        Remark::Misnamed(_) => (Severity::Note, Kind::Misnamed),
        Remark::Count { .. } => (Severity::Warning, Kind::Count),
    };
    Finding::new(severity, kind, remark.to_string(), remark.help())
}

/// What is to be known of the mesh itself: its size against the pad, and what was dropped of it.
pub fn of_mesh(size: &MeshSize, cleaned: &CleanupReport, pad: &SensorPad) -> Vec<Finding> {
    [against_view(size, pad), not_finite(cleaned), far(size, pad)].into_iter().flatten().collect()
}

/// The size against the view. Another unit is only guessed where nothing states one.
fn against_view(size: &MeshSize, pad: &SensorPad) -> Option<Finding> {
    let largest_mm = size.largest_mm();
    let [width, height] = pad.field_of_view_mm;
    let under = format!("under {}", Unit::written(size.mm_per_unit));
    let by = size.known_from.unwrap_or(&under);
    let measured = format!("{} mm long {by}", figure(largest_mm));
    let detail = format!("{} mm", figure(largest_mm));
    let view = format!("a view of {} x {} mm", figure(width), figure(height));
    let likely = size.likely_unit(pad);
    let (looks, help) = match likely {
        _ if is_plausible(largest_mm, pad.field_of_view_mm) => return None,
        Some((unit, mm)) => (
            format!("; its values look like {} ({} mm)", unit.in_words(), figure(mm)),
            format!("if they are, write unit = \"{}\" under [[object]]", unit.name()),
        ),
        None => {
            (String::new(), format!("write how long it is under [[object]]: length_mm = {}", figure(usual_mm(pad))))
        }
    };
    let finding = |severity, kind, message: String| {
        Some(Finding::new(severity, kind, message, help.as_str()).detail(detail.clone()))
    };
    if largest_mm > LARGEST_MM {
        let message = format!("{measured}, more than the {LARGEST_MM} mm that positions can span{looks}");
        return finding(Severity::Warning, Kind::TooLarge, message);
    }
    if largest_mm < pad.pixel_mm() {
        let message = format!("{measured}, less than a pixel ({} mm){looks}", figure(pad.pixel_mm()));
        return finding(Severity::Warning, Kind::TooSmall, message);
    }
    if size.is_normalised() {
        let message = format!(
            "{measured}: its coordinates were divided by its own size, as in sets for learning, so that no unit fits it"
        );
        return finding(Severity::Warning, Kind::Normalised, message);
    }
    if likely.is_some() {
        return finding(Severity::Warning, Kind::Unit, format!("{measured} against {view}{looks}"));
    }
    let message = format!("{measured} against {view}");
    let help = "if that is its size, `anchor`, `x_mm` and `y_mm` of [pose] choose the part to press; if not, write length_mm under [[object]]";
    Some(Finding::new(Severity::Note, Kind::Large, message, help).detail(detail))
}

/// A length that fits a pad's view, mm.
pub fn usual_mm(pad: &SensorPad) -> f64 {
    pad.field_of_view_mm[0].min(pad.field_of_view_mm[1]).round()
}

impl MeshSize {
    /// The unit that its coordinates look like, where they look like another one than they were taken for, and its length in
    /// that, mm.
    pub fn likely_unit(&self, pad: &SensorPad) -> Option<(Unit, f64)> {
        let may_be = self.known_from.is_none() && !self.is_normalised();
        may_be.then(|| Unit::likely(self.mm_per_unit, self.largest_mm(), pad.field_of_view_mm)).flatten()
    }
}

/// What cleaning dropped because it is no number. What else it drops changes no image.
fn not_finite(cleaned: &CleanupReport) -> Option<Finding> {
    (cleaned.non_finite_vertices > 0).then(|| {
        let (one, many) =
            ("vertex that is not finite, with its triangles", "vertices that are not finite, with their triangles");
        let message = format!("dropped {}", counted(cleaned.non_finite_vertices, one, many));
        let help = "the file is damaged: export it again; there may be holes now";
        Finding::new(Severity::Warning, Kind::NotFinite, message, help)
            .detail(format!("{} vertices", cleaned.non_finite_vertices))
    })
}

/// So far from its origin that 32-bit numbers are coarse there.
fn far(size: &MeshSize, pad: &SensorPad) -> Option<Finding> {
    let reach_mm = (0..3).map(|k| size.centre_mm[k].abs() + size.size_mm[k] / 2.0).fold(0.0, f64::max);
    let step_mm = reach_mm * f64::from(f32::EPSILON);
    (step_mm > pad.pixel_mm() / 10.0 && reach_mm > 2.0 * size.largest_mm()).then(|| {
        let message = format!(
            "it lies {} mm from its origin: where it was ever stored in 32-bit floats, its vertices are rounded to {} mm",
            figure(reach_mm),
            figure(step_mm)
        );
        Finding::new(Severity::Note, Kind::FarFromOrigin, message, "move it to its origin before it is exported")
            .detail(format!("{} mm", figure(reach_mm)))
    })
}

/// How long captures would take.
pub fn slow(rows_per_capture: f64) -> Option<Finding> {
    (rows_per_capture > MOST_ROWS).then(|| {
        let rows = figure(rows_per_capture);
        let message = format!("its triangles fill {rows} rows of pixels, half a second or more for every capture");
        let help = "remesh it: many long, thin triangles lie side by side or over each other";
        Finding::new(Severity::Warning, Kind::Slow, message, help)
    })
}

/// What touches is thin: so much of it.
pub fn thin(what: &str, fraction: f64, pad: &SensorPad) -> Finding {
    let severity = if fraction >= THIN_FRACTIONS[1] { Severity::Warning } else { Severity::Note };
    let message = format!("{what} is narrower than two pixels ({} mm)", figure(2.0 * pad.pixel_mm()));
    let help =
        "contact comes and goes with the position there: give walls a thickness, or take a sensor with finer pixels";
    Finding::new(severity, Kind::Thin, message, help).detail(format!("{:.0} %", 100.0 * fraction))
}

/// What touches slips between the pixels' centres.
pub fn slips(what: &str, pad: &SensorPad) -> Finding {
    let message = format!("{what} slips between the pixels: no centre meets it");
    let help =
        format!("make it wider than a pixel ({} mm), or take a sensor with finer pixels", figure(pad.pixel_mm()));
    Finding::new(Severity::Warning, Kind::Slips, message, help)
}

/// What the six captures show.
pub fn captured(sides: &[Side], pad: &SensorPad) -> Vec<Finding> {
    let mut found = Vec::new();
    let press = figure(pad.press_mm);
    if let Some(names) = names(sides, |side| side.slips) {
        found.push(slips(&format!("{names}: what touches first"), pad));
    }
    let worst = sides.iter().map(|side| side.thin_fraction).fold(0.0, f64::max);
    if let Some(names) = names(sides, |side| side.thin_fraction >= THIN_FRACTIONS[0]) {
        let what = format!("{names}: up to {:.0} % of what touches at {press} mm", 100.0 * worst);
        found.push(thin(&what, worst, pad));
    }
    if let Some(names) = names(sides, |side| side.anchor == Some(Anchor::Contact)) {
        let message = format!("{names}: with its bounds in the middle of the view, the lowest point is outside");
        found.push(Finding::new(Severity::Note, Kind::OffCentre, message, "write anchor = \"contact\" under [pose]"));
    }
    if let Some(names) = names(sides, |side| side.anchor.is_none() && !side.slips) {
        let message = format!("{names}: in the middle of the view nothing touches, whatever the anchor");
        found.push(Finding::new(Severity::Note, Kind::OffCentre, message, "move it with `x_mm` and `y_mm` of [pose]"));
    }
    let flat =
        |side: &Side| side.touching_fraction == 1.0 && side.relief_mm.is_some_and(|[low, high]| high - low < 1e-3);
    if let Some(names) = names(sides, flat) {
        let message = format!("{names}: a flat face covers the whole view, where a level press shows nothing");
        found.push(Finding::new(
            Severity::Note,
            Kind::Featureless,
            message,
            "tilt it, or move an edge into view with `x_mm` and `y_mm`",
        ));
    }
    found
}

/// The names of the sides for which `holds`, if there are any.
fn names(sides: &[Side], holds: impl Fn(&Side) -> bool) -> Option<String> {
    let names: Vec<&str> = sides.iter().filter(|side| holds(side)).map(|side| side.face.name()).collect();
    (!names.is_empty()).then(|| names.join(", "))
}
