//! `[sensors]`: the same presses under several sensors.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use gelsim_files::diagnostic::{Diagnostic, Diagnostics};

use super::document::{Document, TomlNode, TomlValue};

/// The `[sensors]` table: several sensors, each with a dataset of its own in the folder of the set.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(default, deny_unknown_fields)]
pub struct Sensors {
    /// Presets and sensor files, the latter relative to the file this stands in. Without it there is one, that of
    /// `[sensor]`, whose other keys hold for all.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub from: Vec<String>,
    /// Units of each, 1 to 1000, drawn as `[sensor.unit]` and the ranges in `[sensor]` say; each keeps what was drawn
    /// for it in all its samples. Without it each is one sensor, as it is described.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub count: Option<u32>,
    /// Whether a sample is the same press under all sensors: object, pose, depth, texture and motion.
    pub paired: bool,
}

impl Default for Sensors {
    fn default() -> Self {
        Self { from: Vec::new(), count: None, paired: true }
    }
}

impl Sensors {
    /// Splits a document with a list `sensors.from` into one for each sensor. `document` becomes that of the first; the
    /// others are returned.
    pub(super) fn split_document(document: &mut Document, problems: &mut Diagnostics) -> Vec<Document> {
        let Some(node) = document.get("sensors.from").cloned() else { return Vec::new() };
        // What is no list of texts is reported when the job is read.
        let TomlValue::Array(items) = node.value else { return Vec::new() };
        let named: Vec<(&TomlNode, &str)> = items.iter().filter_map(|item| Some((item, item.as_str()?))).collect();
        if named.is_empty() || named.len() < items.len() {
            return Vec::new();
        }
        for key in ["sensor.preset", "sensor.file"] {
            if let Some(own) = document.get(key) {
                let message = format!("both `{key}` and `sensors.from` name the sensor");
                problems.push(Diagnostic::new(message).at(own.place).help("keep one of them"));
                return Vec::new();
            }
        }
        let mut of_each = named.into_iter().map(|(item, name)| {
            let key = if name.contains(['/', '\\']) || name.ends_with(".toml") { "file" } else { "preset" };
            let path = ["sensor", key].map(str::to_owned);
            let mut own = document.clone();
            // If `sensor` is no table, that is reported when the job is read.
            let _ = own.set(&path, item.place, item.clone());
            own
        });
        let first = of_each.next();
        let others = of_each.collect();
        *document = first.expect("the list is not empty");
        others
    }
}
