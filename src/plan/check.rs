//! The ranges that values of a job must keep, checked with the place of each key.

use std::ops::RangeInclusive;

use crate::config::diagnostic::{Problem, Problems};
use crate::config::document::Document;
use crate::config::quantity::Quantity;

/// Collects what is wrong with a job, with the places of its keys.
pub struct Check<'a> {
    /// Where the keys stand.
    pub document: &'a Document,
    /// What was found.
    pub problems: &'a mut Problems,
}

impl Check<'_> {
    /// Adds a mistake at a dotted path.
    pub fn wrong(&mut self, path: &str, message: impl Into<String>, help: impl Into<String>) {
        let place = self.document.place(path);
        self.problems.push(Problem::new(message).at(place).help(help));
    }

    /// True if the key was written. A key that is missing although needed is only news if no other mistake hides it.
    pub fn written(&self, path: &str) -> bool {
        self.document.get(path).is_some()
    }

    /// A number in a range; `unit` follows the numbers in the message.
    pub fn number(&mut self, path: &str, value: f64, range: RangeInclusive<f64>, unit: &str) {
        if !range.contains(&value) {
            let help = allowed(&range, unit);
            self.wrong(path, format!("{} = {value} is out of range", last(path)), help);
        }
    }

    /// A random quantity: a sound law whose values all lie in a range.
    pub fn quantity(&mut self, path: &str, quantity: &Quantity, range: RangeInclusive<f64>, unit: &str) {
        if let Some((message, help)) = quantity.mistake() {
            self.wrong(path, format!("{}: {message}", last(path)), help);
            return;
        }
        let (min, max) = quantity.support();
        if min < *range.start() || max > *range.end() {
            let reached = match (min.is_finite(), max.is_finite()) {
                _ if min == max => format!("{min}"),
                (true, true) => format!("{min} to {max}"),
                (true, false) => format!("anything from {min} up"),
                (false, true) => format!("anything up to {max}"),
                (false, false) => String::from("any number"),
            };
            let message = format!("{} may be {reached}, which is out of range", last(path));
            let help = match (min.is_finite() && max.is_finite(), quantity) {
                (false, _) => format!("{}; give the normal distribution a `min` and a `max`", allowed(&range, unit)),
                _ => allowed(&range, unit),
            };
            self.wrong(path, message, help);
        }
    }
}

fn last(path: &str) -> &str {
    path.rsplit('.').next().unwrap_or(path)
}

fn allowed(range: &RangeInclusive<f64>, unit: &str) -> String {
    let unit = if unit.is_empty() { String::new() } else { format!(" {unit}") };
    format!("allowed: {} to {}{unit}", range.start(), range.end())
}
