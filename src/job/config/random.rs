//! What stands in `[sensor]` in place of constants: distributions of its numbers, and backgrounds to choose from.
//!
//! The rest of the job is read as if each number were a typical one and the background the first; so `[sensor]` always
//! describes one sensor, in the middle of those that samples have.

use serde_json::{Value as Json, json};

use super::Job;
use super::document::{Document, Node, Value};
use super::reader;
use gelsim_files::diagnostic::{Diagnostic, Diagnostics};
use gelsim_files::sensor::Sensor;
use gelsim_files::sensor::quantity::Quantity;
use gelsim_files::sensor::random::SensorDistribution;

/// Takes what is random out of the document's sensor. The second value is the tree with constants in its place; none
/// where nothing is.
pub fn take(document: &Document, problems: &mut Diagnostics) -> (SensorDistribution, Option<Node>) {
    let mut taken = SensorDistribution::default();
    let mut constants: Vec<(String, Value)> = Vec::new();
    let leds = match document.get("sensor.led").map(|node| &node.value) {
        Some(Value::Array(items)) => items.len(),
        _ => 0,
    };
    for (path, _) in Sensor::with_every_number(leds).numbers_mut() {
        let full = format!("sensor.{path}");
        let Some(node) = document.get(&full) else { continue };
        if matches!(node.value, Value::Array(_) | Value::Table(_)) {
            // What cannot be read is said; the number then stands for nothing.
            let quantity = reader::read::<Quantity>(node, problems);
            let typical = quantity.as_ref().map_or(0.0, Quantity::typical);
            constants.push((full, Value::Float(typical)));
            taken.numbers.extend(quantity.map(|quantity| (path, quantity)));
        }
    }
    if let Some(node) = document.get("sensor.background") {
        let has_hash = document.get("sensor.background_sha256").is_some_and(|node| node.as_str().is_some());
        let several = match &node.value {
            Value::Array(_) => reader::read::<Vec<String>>(node, problems),
            // With a hash it is one file, whatever its name.
            Value::String(text) if text.contains(['*', '?', '[']) && !has_hash => Some(vec![text.clone()]),
            _ => None,
        };
        let is_list = matches!(node.value, Value::Array(_));
        taken.backgrounds = several.unwrap_or_default();
        if is_list {
            if taken.backgrounds.is_empty() {
                let problem = Diagnostic::new("the list of backgrounds is empty").at(node.place);
                problems.push(problem.help("name at least one file, or leave `background` out"));
            }
            let first = taken.backgrounds.first().cloned().unwrap_or_default();
            constants.push((String::from("sensor.background"), Value::String(first)));
        }
    }
    if let Some(node) = document.get("sensor.background_sha256").filter(|node| matches!(node.value, Value::Array(_))) {
        taken.background_sha256 = reader::read(node, problems).unwrap_or_default();
        let first = taken.background_sha256.first().cloned().unwrap_or_default();
        constants.push((String::from("sensor.background_sha256"), Value::String(first)));
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
pub fn put_back(random: &SensorDistribution, sensor: &mut Json) {
    for (path, quantity) in &random.numbers {
        let place = sensor.pointer_mut(&format!("/{}", path.replace('.', "/")));
        *place.expect("every number of a sensor is written out") = json!(quantity);
    }
    if !random.backgrounds.is_empty() {
        sensor["background"] = json!(random.backgrounds);
        sensor["background_sha256"] = json!(random.background_sha256);
    }
}

/// The presets of which each sample has one, and what the job says of the sensor, whichever it is.
#[derive(Clone, Debug, PartialEq)]
pub struct Presets {
    /// Their names, at least two.
    pub names: Vec<String>,
    /// `[sensor]`, `[markers]` and `[camera]` as they are written, without what the presets say.
    written: Json,
}

/// Tables in which presets say something.
const TABLES: [&str; 3] = ["sensor", "markers", "camera"];

impl Presets {
    /// Takes a list of presets out of the document, whose sensor then is the first one. `None` where there is no list.
    pub fn take(document: &mut Document, problems: &mut Diagnostics) -> Option<Vec<(Self, Document)>> {
        let node = document.get("sensor.preset")?.clone();
        let Value::Array(items) = &node.value else { return None };
        if items.is_empty() {
            let problem = Diagnostic::new("the list of presets is empty").at(node.place);
            problems.push(problem.help("name at least one, or leave `preset` out"));
        }
        let names: Vec<String> = reader::read(&node, problems).unwrap_or_default();
        let mut written = Json::Object(Default::default());
        for name in TABLES {
            if let Some(table) = document.get(name) {
                written[name] = plain(table);
            }
        }
        let of_preset = |(name, item): (&String, &Node)| {
            let mut own = document.clone();
            set_preset(&mut own, Node { place: item.place, value: Value::String(name.clone()) });
            (Self { names: names.clone(), written: written.clone() }, own)
        };
        let all: Vec<(Self, Document)> = names.iter().zip(items).map(of_preset).collect();
        match all.first() {
            Some((_, first)) => *document = first.clone(),
            // Said above.
            None => {
                set_preset(document, Node { place: node.place, value: Value::String(String::from("gelsight-2014")) })
            }
        }
        Some(all)
    }

    /// Puts what is written in place of the first preset's sensor, with the files and hashes that were found.
    pub fn put_back(&self, job: &mut Json) {
        let found = job["sensor"].take();
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
    }
}

fn set_preset(document: &mut Document, node: Node) {
    let place = node.place;
    let path = ["sensor", "preset"].map(str::to_owned);
    document.set(&path, place, node).expect("nothing stands in the way of a key that is there");
}

/// A tree without places, keys sorted.
fn plain(node: &Node) -> Json {
    match &node.value {
        Value::Bool(truth) => json!(truth),
        Value::Integer(number) => json!(number),
        Value::Float(number) => json!(number),
        Value::String(text) => json!(text),
        // No key takes one.
        Value::Datetime => Json::Null,
        Value::Array(items) => items.iter().map(plain).collect(),
        Value::Table(entries) => {
            let mut sorted: Vec<(&String, Json)> =
                entries.iter().map(|entry| (&entry.key, plain(&entry.node))).collect();
            sorted.sort_by_key(|(key, _)| *key);
            sorted.into_iter().map(|(key, value)| (key.clone(), value)).collect()
        }
    }
}

/// A job with the sensor of another preset.
pub fn with_sensor_of(job: &Job, other: Job) -> Job {
    let Job { sensor, random, markers, camera, .. } = other;
    Job { sensor, random, markers, camera, ..job.clone() }
}

/// TOML has no word for nothing.
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
