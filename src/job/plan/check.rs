//! Checks the ranges of a job's values, and reports errors at the places of their keys.

use std::ops::RangeInclusive;

use crate::config::document::{Document, TomlValue};
use crate::config::is_guess_at;
use gelsim_core::gelpad::USUAL_DEPTHS;
use gelsim_files::diagnostic::{Diagnostic, Diagnostics};
use gelsim_files::number_format::{format_number, round_bound};
use gelsim_files::sensor::Sensor;
use gelsim_files::sensor::quantity::Quantity;

/// Collects what is wrong with a job, with the places of its keys.
pub struct JobChecker<'a> {
    /// The document with the places of the keys.
    pub document: &'a Document,
    /// The problems that were found.
    pub problems: &'a mut Diagnostics,
}

impl JobChecker<'_> {
    /// Adds an error at a dotted path. If nothing near the path was written, it is placed at the start of the job.
    pub fn report_error(&mut self, path: &str, message: impl Into<String>, help: impl Into<String>) {
        let place = self.document.place_of(path).unwrap_or(self.document.root.place);
        self.problems.push(Diagnostic::new(message).at(place).help(help));
    }

    /// Adds an error that a needed key is missing, unless an earlier error explains it: the key was written with a
    /// wrong value, the key or a table on the way was misspelt, or what should be a table is none.
    pub fn report_missing(&mut self, path: &str, help: &str) {
        if self.document.get(path).is_some() || self.is_misspelt(path) {
            return;
        }
        let (table, key) = path.rsplit_once('.').unwrap_or(("", path));
        let message = match (table, table.starts_with("object")) {
            ("", _) => format!("missing key `{key}`"),
            (_, true) => format!("missing key `{key}` in [[object]]"),
            (table, false) => format!("missing key `{key}` in [{table}]"),
        };
        self.report_error(path, message, help);
    }

    /// Returns true if the way to `path` ends at an unknown key that may be a misspelling, or at a value that is no
    /// table.
    pub fn is_misspelt(&self, path: &str) -> bool {
        let mut node = &self.document.root;
        for segment in path.split('.') {
            match (node.child(segment), &node.value) {
                (Some(child), _) => node = child,
                (None, TomlValue::Table(entries)) => {
                    return entries.iter().any(|entry| {
                        let unknown = self.problems.places().any(|place| place == entry.key_place);
                        unknown && is_guess_at(&entry.key, segment)
                    });
                }
                (None, _) => return true,
            }
        }
        false
    }

    /// Returns true if nothing was found wrong at `path` or below it, and it was not misspelt.
    pub fn is_valid(&self, path: &str) -> bool {
        let Some(node) = self.document.get(path) else { return !self.is_misspelt(path) };
        let shown = self.document.place_of(path);
        !self.problems.places().any(|place| Some(place) == shown || node.contains_place(place))
    }

    /// Requires a number to be in a range. `unit` follows the numbers in the message. If the number is drawn at random,
    /// all values that may be drawn must be in the range.
    pub fn require_in_range(&mut self, path: &str, value: f64, range: RangeInclusive<f64>, unit: &str) {
        let document = self.document;
        if let Some(quantity) = document.random.distribution_at(path) {
            self.require_quantity_in_range(path, quantity, range, unit);
        } else if !range.contains(&value) && self.is_valid(path) {
            let help = describe_allowed(&range, unit);
            // A computed value has more digits than anybody would write.
            let has_many = value.fract() != 0.0 && format!("{value}").len() > 12;
            let shown = if has_many { format_number(value) } else { format!("{value}") };
            self.report_error(path, format!("{} = {shown} is out of range", last_key(path)), help);
        }
    }

    /// Adds an error at one of many keys of which `cause` may be true. All errors with the same cause become one
    /// message.
    pub fn report_grouped_error(
        &mut self,
        path: &str,
        cause: &str,
        message: impl Into<String>,
        help: impl Into<String>,
    ) {
        let place = self.document.place_of(path).unwrap_or(self.document.root.place);
        let subject = path.split('.').filter(|segment| segment.parse::<usize>().is_err()).collect::<Vec<_>>().join(".");
        self.problems.push(Diagnostic::new(message).at(place).help(help).about(subject, cause));
    }

    /// Refuses random values of a sensor, for commands that use one sensor and not one for each sample.
    pub fn refuse_random_sensor(&mut self, sensor: &Sensor) {
        let document = self.document;
        let help = "write a constant: only a job draws a sensor for each sample";
        for (path, _) in &document.random.numbers {
            let message = format!("{} is drawn at random", last_key(path));
            self.report_grouped_error(&format!("sensor.{path}"), "numbers are drawn at random", message, help);
        }
        if !document.random.backgrounds.is_empty() {
            let help = "name one file: only a job draws a background for each sample";
            self.report_error("sensor.background", "several background images", help);
        }
        if sensor.unit.as_ref().is_some_and(|unit| unit.variation != 0.0) {
            self.report_error("sensor.unit.variation", "variation is drawn at random", "leave it out, or write 0.0");
        }
    }

    /// Requires the width of a kernel, px, to be odd and from 1 to 255.
    pub fn require_odd_width(&mut self, path: &str, width: u32) {
        self.require_in_range(path, f64::from(width), 1.0..=255.0, "px, odd");
        if width.is_multiple_of(2) && (1..=255).contains(&width) {
            let help = format!("write {} or {}", width - 1, width + 1);
            self.report_error(path, format!("{} must be odd: a kernel has a middle pixel", last_key(path)), help);
        }
    }

    /// Requires a random quantity to have a valid distribution whose values all lie in a range.
    pub fn require_quantity_in_range(
        &mut self,
        path: &str,
        quantity: &Quantity,
        range: RangeInclusive<f64>,
        unit: &str,
    ) {
        if let Some((message, help)) = quantity.find_error() {
            self.report_error(path, format!("{}: {message}", last_key(path)), help);
            return;
        }
        let (min, max) = quantity.support();
        if min < *range.start() || max > *range.end() {
            let reached = describe_support(min, max);
            let message = format!("{} may be {reached}, which is out of range", last_key(path));
            let help = match (min.is_finite() && max.is_finite(), quantity) {
                (false, _) => {
                    format!("{}; give the normal distribution a `min` and a `max`", describe_allowed(&range, unit))
                }
                _ => describe_allowed(&range, unit),
            };
            self.report_error(path, message, help);
        }
    }

    /// Requires the depth of a press to stay above the shell behind a pad `thickness_mm` thick. `behind` names what is
    /// there.
    pub fn require_depth_in_range(
        &mut self,
        path: &str,
        quantity: &Quantity,
        least_mm: f64,
        thickness_mm: f64,
        behind: &str,
    ) {
        if let Some((message, help)) = quantity.find_error() {
            self.report_error(path, format!("{}: {message}", last_key(path)), help);
            return;
        }
        let (min, max) = quantity.support();
        if min < least_mm || max >= thickness_mm {
            let most = round_bound(thickness_mm, true);
            let message = match max >= thickness_mm {
                true => format!("{} may be {}, and {behind} {most} mm", last_key(path), describe_support(min, max)),
                false => format!("{} may be {}, which is out of range", last_key(path), describe_support(min, max)),
            };
            let limits = match min.is_finite() && max.is_finite() {
                true => "",
                false => "; give the normal distribution a `min` and a `max`",
            };
            let [low, high] = USUAL_DEPTHS.map(|share| format_number(share * thickness_mm));
            let help = format!(
                "allowed: {least_mm} to below {most} mm; usual is {} = [{low}, {high}]{limits}",
                last_key(path)
            );
            self.report_error(path, message, help);
        }
    }
}

/// Returns the last key of a path, leaving out indices of list elements.
fn last_key(path: &str) -> &str {
    path.rsplit('.').find(|segment| segment.parse::<usize>().is_err()).unwrap_or(path)
}

/// Describes in words what may be drawn.
fn describe_support(min: f64, max: f64) -> String {
    match (min.is_finite(), max.is_finite()) {
        _ if min == max => format!("{min}"),
        (true, true) => format!("{min} to {max}"),
        (true, false) => format!("anything from {min} up"),
        (false, true) => format!("anything up to {max}"),
        (false, false) => String::from("any number"),
    }
}

fn describe_allowed(range: &RangeInclusive<f64>, unit: &str) -> String {
    let unit = if unit.is_empty() { String::new() } else { format!(" {unit}") };
    format!("allowed: {} to {}{unit}", round_bound(*range.start(), false), round_bound(*range.end(), true))
}
