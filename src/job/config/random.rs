//! Random values in `[sensor]` in place of constants: distributions of its numbers, backgrounds and presets to choose
//! from.
//!
//! The rest of the job is read with a typical value of each number and the first background. So `[sensor]` always
//! describes one sensor, in the middle of those that samples have.

use serde_json::{Value as Json, json};

use super::Job;
use super::document::{Document, TomlNode, TomlValue};
use super::reader;
use gelsim_files::diagnostic::{Diagnostic, Diagnostics};
use gelsim_files::sensor::Sensor;
use gelsim_files::sensor::quantity::Quantity;
use gelsim_files::sensor::random::SensorDistribution;

/// Takes what is random out of the document's sensor. The second value is the tree with constants in its place, or
/// `None` if nothing is random.
pub fn take_distributions(document: &Document, problems: &mut Diagnostics) -> (SensorDistribution, Option<TomlNode>) {
    let mut taken = SensorDistribution::default();
    let mut constants: Vec<(String, TomlValue)> = Vec::new();
    let leds = match document.get("sensor.led").map(|node| &node.value) {
        Some(TomlValue::Array(items)) => items.len(),
        _ => 0,
    };
    for (path, _) in Sensor::with_every_number(leds).numbers_mut() {
        let full = format!("sensor.{path}");
        let Some(node) = document.get(&full) else { continue };
        if matches!(node.value, TomlValue::Array(_) | TomlValue::Table(_)) {
            // If it cannot be read, that is reported, and any number will do in its place.
            let quantity = reader::read_node::<Quantity>(node, problems);
            let typical = quantity.as_ref().map_or(0.0, Quantity::typical_value);
            constants.push((full, TomlValue::Float(typical)));
            taken.numbers.extend(quantity.map(|quantity| (path, quantity)));
        }
    }
    if let Some(node) = document.get("sensor.background") {
        let has_hash = document.get("sensor.background_sha256").is_some_and(|node| node.as_str().is_some());
        let several = match &node.value {
            TomlValue::Array(_) => reader::read_node::<Vec<String>>(node, problems),
            // With a hash it is one file, even if its name looks like a pattern.
            TomlValue::String(text) if text.contains(['*', '?', '[']) && !has_hash => Some(vec![text.clone()]),
            _ => None,
        };
        let is_list = matches!(node.value, TomlValue::Array(_));
        taken.backgrounds = several.unwrap_or_default();
        if is_list {
            if taken.backgrounds.is_empty() {
                let problem = Diagnostic::new("the list of backgrounds is empty").at(node.place);
                problems.push(problem.help("name at least one file, or leave `background` out"));
            }
            let first = taken.backgrounds.first().cloned().unwrap_or_default();
            constants.push((String::from("sensor.background"), TomlValue::String(first)));
        }
    }
    if let Some(node) =
        document.get("sensor.background_sha256").filter(|node| matches!(node.value, TomlValue::Array(_)))
    {
        taken.background_sha256 = reader::read_node(node, problems).unwrap_or_default();
        let first = taken.background_sha256.first().cloned().unwrap_or_default();
        constants.push((String::from("sensor.background_sha256"), TomlValue::String(first)));
    }
    let plain = (!constants.is_empty()).then(|| {
        let mut root = document.root.clone();
        for (path, value) in constants {
            let node = path.split('.').try_fold(&mut root, |node, segment| node.child_mut(segment));
            node.expect("it was found there just now").value = value;
        }
        root
    });
    (taken, plain)
}

/// Puts what is random back into a job's `[sensor]`, so that it is as it was written.
pub fn restore_distributions(random: &SensorDistribution, sensor: &mut Json) {
    for (path, quantity) in &random.numbers {
        let place = sensor.pointer_mut(&format!("/{}", path.replace('.', "/")));
        *place.expect("every number of a sensor is written out") = json!(quantity);
    }
    if !random.backgrounds.is_empty() {
        sensor["background"] = json!(random.backgrounds);
        sensor["background_sha256"] = json!(random.background_sha256);
    }
}

/// The presets of which each sample gets one, and what the job itself says of the sensor.
#[derive(Clone, Debug, PartialEq)]
pub struct SensorPresets {
    /// Names of the presets, at least two.
    pub names: Vec<String>,
    /// `[sensor]`, `[markers]` and `[camera]` as they are written, without what the presets add.
    written: Json,
}

/// The tables in which presets say something.
const TABLES: [&str; 3] = ["sensor", "markers", "camera"];

impl SensorPresets {
    /// Takes a list of presets out of the document, whose sensor is then the first one. Returns each preset with a
    /// document of its own, or `None` if there is no list.
    pub fn take_from(document: &mut Document, problems: &mut Diagnostics) -> Option<Vec<(Self, Document)>> {
        let node = document.get("sensor.preset")?.clone();
        let TomlValue::Array(items) = &node.value else { return None };
        if items.is_empty() {
            let problem = Diagnostic::new("the list of presets is empty").at(node.place);
            problems.push(problem.help("name at least one, or leave `preset` out"));
        }
        let names: Vec<String> = reader::read_node(&node, problems).unwrap_or_default();
        let mut written = Json::Object(Default::default());
        for name in TABLES {
            if let Some(table) = document.get(name) {
                written[name] = to_json(table);
            }
        }
        let of_preset = |(name, item): (&String, &TomlNode)| {
            let mut own = document.clone();
            set_preset(&mut own, TomlNode { place: item.place, value: TomlValue::String(name.clone()) });
            (Self { names: names.clone(), written: written.clone() }, own)
        };
        let all: Vec<(Self, Document)> = names.iter().zip(items).map(of_preset).collect();
        match all.first() {
            Some((_, first)) => *document = first.clone(),
            // The empty list was reported above.
            None => set_preset(
                document,
                TomlNode { place: node.place, value: TomlValue::String(String::from("gelsight-2014")) },
            ),
        }
        Some(all)
    }

    /// Replaces the first preset's sensor in the job by what is written, with the files and hashes that were found.
    pub fn restore_into(&self, job: &mut Json) {
        let found = job["sensor"].take();
        let markers = job["markers"].clone();
        for name in TABLES {
            match self.written.get(name) {
                Some(table) => job[name] = table.clone(),
                None => _ = job.as_object_mut().map(|job| job.remove(name)),
            }
        }
        job["sensor"]["preset"] = json!(self.names);
        for key in ["background", "background_sha256", "calibration", "calibration_sha256", "rest_shape"] {
            if let Some(value) = found.get(key).filter(|value| !value.is_null()) {
                job["sensor"][key] = value.clone();
            }
        }
        if job["sensor"].pointer("/shape/mesh").is_some() {
            job["sensor"]["shape"] = found["shape"].clone();
        }
        if job["sensor"].pointer("/pins/layout/file").is_some() {
            for key in ["layout", "layout_sha256"] {
                job["sensor"]["pins"][key] = found["pins"][key].clone();
            }
        }
        for table in ["/markers", "/sensor/markers"] {
            if let Some(table) = job.pointer_mut(table).filter(|table| table.get("file").is_some()) {
                for key in ["file", "file_sha256"] {
                    table[key] = markers[key].clone();
                }
                table.sort_all_objects();
            }
        }
    }
}

fn set_preset(document: &mut Document, node: TomlNode) {
    let place = node.place;
    let path = ["sensor", "preset"].map(str::to_owned);
    document.set(&path, place, node).expect("nothing stands in the way of a key that is there");
}

/// Converts a tree to JSON, without places and with sorted keys.
fn to_json(node: &TomlNode) -> Json {
    match &node.value {
        TomlValue::Bool(truth) => json!(truth),
        TomlValue::Integer(number) => json!(number),
        TomlValue::Float(number) => json!(number),
        TomlValue::String(text) => json!(text),
        // No key takes a date, so it never gets here.
        TomlValue::Datetime => Json::Null,
        TomlValue::Array(items) => items.iter().map(to_json).collect(),
        TomlValue::Table(entries) => {
            let mut sorted: Vec<(&String, Json)> =
                entries.iter().map(|entry| (&entry.key, to_json(&entry.node))).collect();
            sorted.sort_by_key(|(key, _)| *key);
            sorted.into_iter().map(|(key, value)| (key.clone(), value)).collect()
        }
    }
}

/// Returns a job with the sensor of another preset.
pub fn replace_sensor(job: &Job, other: Job) -> Job {
    let Job { sensor, random, markers, camera, .. } = other;
    Job { sensor, random, markers, camera, ..job.clone() }
}

/// Removes all nulls, which TOML cannot express.
pub fn drop_nulls(tree: &mut Json) {
    match tree {
        Json::Object(entries) => {
            entries.retain(|_, value| !value.is_null());
            entries.values_mut().for_each(drop_nulls);
        }
        Json::Array(items) => items.iter_mut().for_each(drop_nulls),
        _ => {}
    }
}
