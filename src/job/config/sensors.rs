//! `[sensors]`: the same presses under several sensors.

use std::io;
use std::path::Path;

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use gelsim_files::diagnostic::{Diagnostic, Diagnostics};
use gelsim_files::foreign::decode_text;
use gelsim_files::input;

use super::document::{Document, TomlEntry, TomlNode, TomlValue};

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
    /// A job with presses for calibration, relative to the file this stands in. They are made under each sensor as well,
    /// and kept apart. The job has no sensors of its own.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub calibration: Option<String>,
}

/// The parts of a job that its calibration presses share: the sensors, and how they are simulated.
const SHARED: [&str; 8] = ["sensors", "sensor", "markers", "camera", "fidelity", "gelpad", "optics", "effects"];

impl Default for Sensors {
    fn default() -> Self {
        Self { from: Vec::new(), count: None, paired: true, calibration: None }
    }
}

impl Sensors {
    /// Takes `sensors.calibration` out of a document that names such a job. Returns the document of its presses under
    /// the sensors of this one.
    pub(super) fn take_calibration(document: &mut Document, problems: &mut Diagnostics) -> Option<Document> {
        let node = document.get("sensors.calibration").cloned()?;
        // What is no text is reported when the job is read.
        let written = node.as_str()?;
        let path = document.folder_of("sensors.calibration").join(written);
        let text = input::read(&path, super::document::MAX_READ_BYTES)
            .and_then(|bytes| decode_text(bytes).map_err(io::Error::other));
        let text = text.map_err(|error| {
            let message = format!("cannot read the job of the calibration presses {}: {error}", path.display());
            let jobs = |path: &Path| path.extension().is_some_and(|ending| ending == "toml");
            let help = match input::suggest_file_name(&path, jobs).filter(|_| error.kind() == io::ErrorKind::NotFound) {
                Some(name) => format!("did you mean {}?", Path::new(written).with_file_name(name).display()),
                None => String::from("name a job with objects, poses and depths, relative to the file this stands in"),
            };
            problems.push(Diagnostic::new(message).at(node.place).help(help));
        });
        let folder = path.parent().unwrap_or(Path::new("")).to_owned();
        let mut found = Diagnostics::default();
        let tree = document.add_source(&path.display().to_string(), text.ok()?, &folder, &mut found);
        let is_sound = found.is_empty();
        problems.extend(found);
        let mut own = document.clone();
        let TomlValue::Table(all) = &mut own.root.value else { return None };
        all.retain(|entry| SHARED.contains(&&*entry.key));
        if let Some(TomlNode { value: TomlValue::Table(keys), .. }) = own.root.child_mut("sensors") {
            keys.retain(|entry| entry.key != "calibration");
        }
        let TomlValue::Table(presses) = tree.value else { return None };
        for TomlEntry { key, key_place, node } in presses {
            if SHARED.contains(&&*key) {
                let message = format!("the calibration presses have `{key}` of their own");
                let help = "leave it out: they are pressed into the sensors of the set, as the set's job says";
                problems.push(Diagnostic::new(message).at(key_place).help(help));
            } else {
                own.set(&[key], key_place, node).ok()?;
            }
        }
        // The same seeds draw the same units.
        if let Some(TomlNode { value: TomlValue::Table(keys), .. }) = own.root.child_mut("dataset") {
            keys.retain(|entry| !["seed", "sensor_seed", "name"].contains(&&*entry.key));
        }
        for key in ["seed", "sensor_seed"] {
            if let Some(node) = document.get(&format!("dataset.{key}")).cloned() {
                own.set(&["dataset", key].map(str::to_owned), node.place, node).ok()?;
            }
        }
        let name = document.get("dataset.name").and_then(TomlNode::as_str).unwrap_or_default();
        let value = TomlValue::String(format!("{name}-calibration"));
        own.set(&["dataset", "name"].map(str::to_owned), node.place, TomlNode { place: node.place, value }).ok()?;
        is_sound.then_some(own)
    }

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
