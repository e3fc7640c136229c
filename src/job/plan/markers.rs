//! Settles whether a grid or a file says where the dots of `[markers]` are, reads the file, and checks both.

use std::collections::BTreeSet;
use std::sync::Arc;

use super::check::JobChecker;
use super::{files, paths};
use gelsim_files::number_format::round_bound;
use gelsim_files::sensor::markers::{MarkerDistribution, parse_marker_table};
use gelsim_files::sensor::quantity::Quantity;

/// Most dots on and around the view.
const MAX_DOTS: f64 = 200_000.0;
/// Largest width of a dot with its edge over the distance between dots.
const MAX_WIDTH_PER_SPACING: f64 = 20.0;

/// Reads the file of the dots of the table at `at`, if it has one, and remembers its hash.
///
/// A file in a job takes the place of the grid in its sensor file or preset, and a grid that of a file. In one source they
/// contradict each other.
pub fn read_marker_file(check: &mut JobChecker<'_>, at: &str, markers: &mut MarkerDistribution) {
    let key = |name: &str| format!("{at}.{name}");
    let document = check.document;
    // The job and the command line are one; a sensor file stands before the preset that it starts from.
    let rank = |name: &str| {
        let source = document.get(&key(name))?.place.source;
        Some(if document.sources[source].name.starts_with("--") { 0 } else { source })
    };
    let Some(of_file) = rank("file").filter(|_| markers.file.is_some()) else { return };
    let of_grid = ["pitch_mm", "pitch_y_mm", "rows", "columns", "missing"].map(|name| (name, rank(name)));
    if of_grid.iter().any(|(_, rank)| rank.is_some_and(|rank| rank < of_file)) {
        (markers.file, markers.file_sha256) = (None, None);
        return;
    }
    for (name, _) in of_grid.iter().filter(|(_, rank)| *rank == Some(of_file)) {
        let message = format!("`{name}` describes a grid, and `file` names the places of the dots");
        check.report_error(&key(name), message, format!("leave out `{name}`, or `file`"));
    }
    let is_below = |name: &str| rank(name).is_none_or(|rank| rank > of_file);
    markers.leave_out_grid();
    if is_below("offset_mm") {
        markers.offset_mm = [0.0; 2];
    }
    // Measured places are not off by chance, unless somebody says so.
    if is_below("jitter_mm") {
        markers.jitter_mm = Quantity::Constant(0.0);
    }
    let MarkerDistribution { file: Some(path), file_sha256, dots, .. } = markers else { return };
    // A hash of another file says nothing about this one.
    if is_below("file_sha256") {
        *file_sha256 = None;
    }
    let bytes = |bytes: &[u8]| Ok(bytes.to_vec());
    if let Some(bytes) = files::read_input_file(check, &key("file"), &paths::DOTS, path, file_sha256, bytes) {
        match parse_marker_table(path, &bytes) {
            Ok(found) => *dots = Some(Arc::new(found)),
            Err(mistakes) => {
                for message in mistakes {
                    let help = "the first line is x_mm,y_mm, or x_mm,y_mm,diameter_mm; each further one a dot, mm from the \
                                middle of the view to the right and down";
                    check.report_error(&key("file"), message, help);
                }
            }
        }
    }
}

/// Checks the `[markers]` table at `at`. The view is `None` if the sensor's is not valid.
pub fn check_markers(
    check: &mut JobChecker<'_>,
    at: &str,
    markers: &MarkerDistribution,
    field_of_view_mm: Option<[f64; 2]>,
) {
    let key = |name: &str| format!("{at}.{name}");
    for (name, pitch) in [("pitch_mm", &markers.pitch_mm), ("pitch_y_mm", &markers.pitch_y_mm)] {
        if let Some(pitch) = pitch {
            check.require_quantity_in_range(&key(name), pitch, 0.05..=1e3, "mm");
        }
    }
    check.require_quantity_in_range(&key("diameter_mm"), &markers.diameter_mm, 0.0..=100.0, "mm");
    check.require_quantity_in_range(&key("jitter_mm"), &markers.jitter_mm, 0.0..=100.0, "mm");
    check.require_in_range(&key("edge_mm"), markers.edge_mm, 0.0..=10.0, "mm");
    for k in 0..2 {
        check.require_in_range(&key(&format!("offset_mm.{k}")), markers.offset_mm[k], -1e3..=1e3, "mm");
    }
    for k in 0..3 {
        check.require_in_range(&key(&format!("color.{k}")), markers.color[k], 0.0..=1.0, "");
    }
    check_counts(check, at, markers);
    if let Some(field_of_view_mm) = field_of_view_mm.filter(|_| check.is_valid(at)) {
        match &markers.dots {
            Some(_) => check_coverage(check, at, markers, field_of_view_mm),
            None => check_dots(check, at, markers, field_of_view_mm),
        }
    }
}

/// Checks the rows and columns of a grid, and which of its dots are missing.
fn check_counts(check: &mut JobChecker<'_>, at: &str, markers: &MarkerDistribution) {
    let key = |name: &str| format!("{at}.{name}");
    for (name, count) in [("rows", markers.rows), ("columns", markers.columns)] {
        if let Some(count) = count {
            check.require_in_range(&key(name), f64::from(count), 1.0..=1000.0, name);
        }
    }
    let [rows, columns] = match (markers.rows, markers.columns) {
        (Some(rows), Some(columns)) => [rows, columns],
        (None, None) if markers.missing.is_empty() => return,
        (None, None) => {
            let help = "write rows and columns, too; without them the grid has no first row";
            check.report_error(&key("missing"), "`missing` names rows and columns, and the grid counts none", help);
            return;
        }
        (rows, _) => {
            let (given, other) = if rows.is_some() { ("rows", "columns") } else { ("columns", "rows") };
            let help = format!("write {other} = 7, say; or leave both out for a grid that covers the view");
            check.report_error(&key(given), format!("`{given}` without `{other}`"), help);
            return;
        }
    };
    let mut known = BTreeSet::new();
    for (k, place) in markers.missing.iter().enumerate() {
        let at = key(&format!("missing.{k}"));
        if place[0] >= rows || place[1] >= columns {
            let message = format!("the grid has no dot in row {}, column {}", place[0], place[1]);
            let help = format!(
                "row and column count from 0 at the top left: here up to [{}, {}]",
                rows.saturating_sub(1),
                columns.saturating_sub(1)
            );
            check.report_error(&at, message, help);
        } else if !known.insert(*place) {
            let message = format!("the dot in row {}, column {} is missing twice", place[0], place[1]);
            check.report_error(&at, message, "leave one of them out");
        }
    }
}

/// Limits how many measured dots may overlap, as [`check_dots`] does for a grid.
fn check_coverage(check: &mut JobChecker<'_>, at: &str, markers: &MarkerDistribution, field_of_view_mm: [f64; 2]) {
    let shared = markers.diameter_mm.support().1;
    let width = |diameter_mm: Option<f64>| diameter_mm.unwrap_or(shared) + markers.edge_mm;
    let covered: f64 = markers.dots.iter().flat_map(|dots| dots.iter()).map(|dot| width(dot.diameter_mm).powi(2)).sum();
    let times = covered / field_of_view_mm.iter().product::<f64>();
    let most = MAX_WIDTH_PER_SPACING * MAX_WIDTH_PER_SPACING;
    if shared > 0.0 && times > most {
        let message = format!("the dots, with their edges, cover the view {times:.0} times");
        check.report_error(&format!("{at}.file"), message, format!("allowed: up to {most} times; make them smaller"));
    }
}

/// Limits the number of dots on and around the view, and how many of them may overlap. More of either would take
/// seconds per sample.
fn check_dots(check: &mut JobChecker<'_>, at: &str, markers: &MarkerDistribution, field_of_view_mm: [f64; 2]) {
    let least = |pitch: &Option<Quantity>| pitch.as_ref().map(|pitch| pitch.support().0);
    let Some(across) = least(&markers.pitch_mm) else { return };
    let down = least(&markers.pitch_y_mm).unwrap_or(across);
    let (pitch, name) = if down < across { (down, "pitch_y_mm") } else { (across, "pitch_mm") };
    let diameter = markers.diameter_mm.support().1;
    let around = diameter + markers.jitter_mm.support().1;
    let many = |factor: f64| -> f64 {
        let pitches = [across, down].map(|pitch| factor * pitch);
        (0..2).map(|k| (field_of_view_mm[k] + 2.0 * around) / pitches[k] + 1.0).product()
    };
    let is_counted = markers.rows.is_some();
    let dots = many(1.0);
    if diameter > 0.0 && dots > MAX_DOTS && !is_counted {
        let message = format!("a pitch of {pitch} mm may need {dots:.0} dots on the view and around it");
        let widest = (diameter + markers.edge_mm) / MAX_WIDTH_PER_SPACING;
        let enough = (0..400).map(|k| libm::pow(1.05, f64::from(k))).find(|factor| many(*factor) <= MAX_DOTS);
        let enough = round_bound(enough.map_or(1e3, |factor| pitch * factor).max(widest), false);
        let help = format!("allowed: up to {MAX_DOTS} dots; write {name} = {enough} or more, or smaller dots");
        check.report_error(&format!("{at}.{name}"), message, help);
    } else if let (Some(rows), Some(columns)) = (markers.rows, markers.columns)
        && f64::from(rows) * f64::from(columns) > MAX_DOTS
    {
        let message = format!("{rows} rows of {columns} dots are {}", u64::from(rows) * u64::from(columns));
        check.report_error(&format!("{at}.rows"), message, format!("allowed: up to {MAX_DOTS} dots"));
    } else if diameter + markers.edge_mm > MAX_WIDTH_PER_SPACING * pitch {
        let message = format!("dots of {diameter} mm with edges of {} mm lie over each other", markers.edge_mm);
        let (key, other) = if markers.edge_mm < MAX_WIDTH_PER_SPACING * pitch {
            ("diameter_mm", markers.edge_mm)
        } else {
            ("edge_mm", diameter)
        };
        let most = round_bound((MAX_WIDTH_PER_SPACING * pitch - other).max(0.0), true);
        let help = format!(
            "write {key} = {most} or less: up to {MAX_WIDTH_PER_SPACING} times as wide as {name}, with the edge"
        );
        check.report_error(&format!("{at}.{key}"), message, help);
    }
}
