//! The ranges that values of a job must keep, checked with the place of each key.

use std::ops::RangeInclusive;

use crate::config::document::{Document, Value};
use crate::config::is_guess_at;
use gelsim_core::gelpad::USUAL_DEPTHS;
use gelsim_files::diagnostic::{Diagnostic, Diagnostics};
use gelsim_files::figures::{figure, tidy};
use gelsim_files::sensor::Sensor;
use gelsim_files::sensor::quantity::Quantity;

/// Collects what is wrong with a job, with the places of its keys.
pub struct Check<'a> {
    /// Where the keys stand.
    pub document: &'a Document,
    /// What was found.
    pub problems: &'a mut Diagnostics,
}

impl Check<'_> {
    /// Adds a mistake at a dotted path; where nobody wrote anything near it, at the start of the job.
    pub fn error(&mut self, path: &str, message: impl Into<String>, help: impl Into<String>) {
        let place = self.document.place(path).unwrap_or(self.document.root.place);
        self.problems.push(Diagnostic::new(message).at(place).help(help));
    }

    /// Adds that a needed key is missing, unless a mistake found before explains it: the key was written, but wrongly;
    /// the key or a table on the way to it was misspelt; the table is none.
    pub fn missing(&mut self, path: &str, help: &str) {
        if self.document.get(path).is_some() || self.misspelt(path) {
            return;
        }
        let (table, key) = path.rsplit_once('.').unwrap_or(("", path));
        let message = match (table, table.starts_with("object")) {
            ("", _) => format!("missing key `{key}`"),
            (_, true) => format!("missing key `{key}` in [[object]]"),
            (table, false) => format!("missing key `{key}` in [{table}]"),
        };
        self.error(path, message, help);
    }

    /// True if the way to `path` ends at an unknown key that looks like it, or at something that is no table.
    pub fn misspelt(&self, path: &str) -> bool {
        let mut node = &self.document.root;
        for segment in path.split('.') {
            match (node.child(segment), &node.value) {
                (Some(child), _) => node = child,
                (None, Value::Table(entries)) => {
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

    /// True if nothing was found wrong at `path` or below it, and it was not misspelt.
    pub fn sound(&self, path: &str) -> bool {
        let Some(node) = self.document.get(path) else { return !self.misspelt(path) };
        let shown = self.document.place(path);
        !self.problems.places().any(|place| Some(place) == shown || node.holds(place))
    }

    /// A number in a range; `unit` follows the numbers in the message. If it is drawn at random, all that may be drawn.
    pub fn number(&mut self, path: &str, value: f64, range: RangeInclusive<f64>, unit: &str) {
        let document = self.document;
        if let Some(quantity) = document.random.of(path) {
            self.quantity(path, quantity, range, unit);
        } else if !range.contains(&value) && self.sound(path) {
            let help = allowed(&range, unit);
            // What was worked out has more digits than anybody writes.
            let has_many = value.fract() != 0.0 && format!("{value}").len() > 12;
            let shown = if has_many { figure(value) } else { format!("{value}") };
            self.error(path, format!("{} = {shown} is out of range", key(path)), help);
        }
    }

    /// The same of one of many keys of which `cause` may be true: those together are one message.
    pub fn error_of(&mut self, path: &str, cause: &str, message: impl Into<String>, help: impl Into<String>) {
        let place = self.document.place(path).unwrap_or(self.document.root.place);
        let subject = path.split('.').filter(|segment| segment.parse::<usize>().is_err()).collect::<Vec<_>>().join(".");
        self.problems.push(Diagnostic::new(message).at(place).help(help).of(subject, cause));
    }

    /// Refuses what is drawn at random of a sensor, where there is one sensor and not one for each sample.
    pub fn one_sensor(&mut self, sensor: &Sensor) {
        let document = self.document;
        let help = "write a constant: only a job draws a sensor for each sample";
        for (path, _) in &document.random.numbers {
            let message = format!("{} is drawn at random", key(path));
            self.error_of(&format!("sensor.{path}"), "numbers are drawn at random", message, help);
        }
        if !document.random.backgrounds.is_empty() {
            let help = "name one file: only a job draws a background for each sample";
            self.error("sensor.background", "several background images", help);
        }
        if sensor.unit.as_ref().is_some_and(|unit| unit.variation != 0.0) {
            self.error("sensor.unit.variation", "variation is drawn at random", "leave it out, or write 0.0");
        }
    }

    /// The width of a kernel, px: odd, 1 to 255.
    pub fn odd(&mut self, path: &str, width: u32) {
        self.number(path, f64::from(width), 1.0..=255.0, "px, odd");
        if width.is_multiple_of(2) && (1..=255).contains(&width) {
            let help = format!("write {} or {}", width - 1, width + 1);
            self.error(path, format!("{} must be odd: a kernel has a middle pixel", key(path)), help);
        }
    }

    /// A random quantity: a sound distribution whose values all lie in a range.
    pub fn quantity(&mut self, path: &str, quantity: &Quantity, range: RangeInclusive<f64>, unit: &str) {
        if let Some((message, help)) = quantity.mistake() {
            self.error(path, format!("{}: {message}", key(path)), help);
            return;
        }
        let (min, max) = quantity.support();
        if min < *range.start() || max > *range.end() {
            let reached = reached(min, max);
            let message = format!("{} may be {reached}, which is out of range", key(path));
            let help = match (min.is_finite() && max.is_finite(), quantity) {
                (false, _) => format!("{}; give the normal distribution a `min` and a `max`", allowed(&range, unit)),
                _ => allowed(&range, unit),
            };
            self.error(path, message, help);
        }
    }

    /// The depth of a press, which stays above the shell behind a pad `thickness_mm` thick; `behind` names what is there.
    pub fn depth(&mut self, path: &str, quantity: &Quantity, least_mm: f64, thickness_mm: f64, behind: &str) {
        if let Some((message, help)) = quantity.mistake() {
            self.error(path, format!("{}: {message}", key(path)), help);
            return;
        }
        let (min, max) = quantity.support();
        if min < least_mm || max >= thickness_mm {
            let most = tidy(thickness_mm, true);
            let message = match max >= thickness_mm {
                true => format!("{} may be {}, and {behind} {most} mm", key(path), reached(min, max)),
                false => format!("{} may be {}, which is out of range", key(path), reached(min, max)),
            };
            let limits = match min.is_finite() && max.is_finite() {
                true => "",
                false => "; give the normal distribution a `min` and a `max`",
            };
            let [low, high] = USUAL_DEPTHS.map(|share| figure(share * thickness_mm));
            let help =
                format!("allowed: {least_mm} to below {most} mm; usual is {} = [{low}, {high}]{limits}", key(path));
            self.error(path, message, help);
        }
    }
}

/// The key that a path ends in; the number of an element of a list is no key.
fn key(path: &str) -> &str {
    path.rsplit('.').find(|segment| segment.parse::<usize>().is_err()).unwrap_or(path)
}

/// What may be drawn, in words.
fn reached(min: f64, max: f64) -> String {
    match (min.is_finite(), max.is_finite()) {
        _ if min == max => format!("{min}"),
        (true, true) => format!("{min} to {max}"),
        (true, false) => format!("anything from {min} up"),
        (false, true) => format!("anything up to {max}"),
        (false, false) => String::from("any number"),
    }
}

fn allowed(range: &RangeInclusive<f64>, unit: &str) -> String {
    let unit = if unit.is_empty() { String::new() } else { format!(" {unit}") };
    format!("allowed: {} to {}{unit}", tidy(*range.start(), false), tidy(*range.end(), true))
}
