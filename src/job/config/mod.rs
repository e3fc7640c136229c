//! The job file exactly as written: one file per table, serde types, and where each key stands.
//!
//! Reading collects every mistake ([`crate::files::diagnostic`]); what values mean together is the plan's business.

use std::io;
use std::path::Path;

use schemars::JsonSchema;
use serde::de::DeserializeOwned;
use serde::{Deserialize, Serialize};

pub mod dataset;
pub mod document;
pub mod fidelity;
pub mod gripper;
pub mod object;
pub mod output;
pub mod random;
mod reader;
pub mod scene;
pub mod sequence;
mod slips;
pub mod texture;

use crate::files::diagnostic::{Diagnostic, Diagnostics, Report, user_error};
use crate::files::mesh::Format;
use crate::files::spelling::nearest;
use document::{Document, Node, Value};

use crate::core::effects::EffectPolicy;
use crate::core::fidelity::Fidelity;
use crate::core::{gelpad, optics};
use crate::files::input;
use crate::files::sensor::camera::CameraDistribution;
use crate::files::sensor::markers::MarkerDistribution;
use crate::files::sensor::random::SensorDistribution;
use crate::files::sensor::{self, Sensor};
use crate::files::source::Place;

/// A job. Keys that are left out have the defaults named with each.
#[derive(Clone, Debug, Default, Serialize, Deserialize, JsonSchema)]
#[serde(default, deny_unknown_fields)]
pub struct Job {
    /// Fidelity level, or what it is to be chosen by; fills the gelpad and optics choices that the job leaves
    /// open.
    pub fidelity: Option<fidelity::FidelityChoice>,
    /// Which effects run: those that a sample calls for, or all that there are.
    pub effects: EffectPolicy,
    /// Model of the gelpad's shape under the object.
    pub gelpad: Option<gelpad::Model>,
    /// Model of the light that the camera sees.
    pub optics: Option<optics::Model>,
    /// How many samples, from which seed, in which shards and splits.
    pub dataset: dataset::Dataset,
    /// The sensor.
    pub sensor: Sensor,
    /// The objects.
    #[schemars(required)]
    pub object: Vec<object::Object>,
    /// How many objects are pressed in together; without it each sample has one.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub scene: Option<scene::Scene>,
    /// How the object is turned and placed.
    pub pose: scene::Pose,
    /// How deep it is pressed.
    pub indentation: scene::Indentation,
    /// How the object moves in the pad's plane after it was pressed in.
    pub shear: scene::Shear,
    /// Makes each sample a sequence of frames; without it a sample is one press.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub sequence: Option<sequence::Sequence>,
    /// Makes each sample one object between two fingers; without it a sample is a press into one sensor.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub gripper: Option<gripper::Gripper>,
    /// Micro relief of the object.
    pub texture: texture::TextureDistribution,
    /// Dots printed on the pad; keys that are left out are the sensor's.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub markers: Option<MarkerDistribution>,
    /// The camera; keys that are left out are the sensor's.
    pub camera: CameraDistribution,
    /// What is written.
    pub output: output::Output,
    /// What of the sensor is drawn anew for each sample; it stands where `sensor` has a typical value.
    #[serde(skip)]
    pub random: SensorDistribution,
    /// The presets of which each sample has one; `sensor`, `random`, `markers` and `camera` are those of the first.
    #[serde(skip)]
    pub presets: Option<random::Presets>,
}

impl Job {
    /// Everything in it as a tree, as it would be written.
    pub fn to_json(&self) -> serde_json::Value {
        let mut tree =
            serde_json::to_value(self).expect("a job has string keys, and a job leaves no single effect out");
        random::put_back(&self.random, &mut tree["sensor"]);
        if let Some(gripper) = self.gripper.as_ref().filter(|gripper| gripper.right.is_some()) {
            random::put_back(&gripper.right_random, &mut tree["gripper"]["right"]);
        }
        if let Some(presets) = &self.presets {
            presets.put_back(&mut tree);
        }
        tree
    }

    /// Its sensor as the simulator knows it, less what is in files.
    pub fn bare_sensor(&self) -> crate::core::sensor::Sensor {
        self.sensor.to_simulated(self.markers.as_ref(), &self.camera)
    }

    /// Everything in it as text; paths as they are.
    pub fn to_toml(&self) -> io::Result<String> {
        let right_is_constant = self.gripper.as_ref().is_none_or(|gripper| gripper.right_random.is_empty());
        if self.random.is_empty() && self.presets.is_none() && right_is_constant {
            return toml::to_string(self).map_err(io::Error::other);
        }
        let mut tree = self.to_json();
        random::drop_nulls(&mut tree);
        toml::to_string(&tree).map_err(io::Error::other)
    }

    /// How many objects a sample may have.
    pub fn objects_per_sample(&self) -> scene::Count {
        self.scene.map_or_else(scene::Count::default, |scene| scene.objects_per_sample)
    }

    /// The paths of all files that it names.
    pub fn paths_mut(&mut self) -> impl Iterator<Item = &mut String> {
        let objects = self.object.iter_mut().flat_map(|object| {
            let textures = object.texture.iter_mut().flat_map(texture::TextureDistribution::paths_mut);
            object.path.iter_mut().chain(textures)
        });
        let textures = self.texture.paths_mut();
        let left = sensor_paths_mut(&mut self.sensor).chain(&mut self.random.backgrounds);
        let right = self.gripper.iter_mut().flat_map(|gripper| {
            gripper
                .right
                .iter_mut()
                .flat_map(|right| sensor_paths_mut(right))
                .chain(&mut gripper.right_random.backgrounds)
        });
        objects.chain(textures).chain(left).chain(right)
    }

    /// Its sensor with its markers and camera in it, as a sensor file has them.
    pub fn whole_sensor(&self) -> Sensor {
        Sensor { markers: self.markers.clone(), camera: Some(self.camera.clone()), ..self.sensor.clone() }
    }
}

/// The paths of all files that a sensor names, but those of which each sample has one.
fn sensor_paths_mut(sensor: &mut Sensor) -> impl Iterator<Item = &mut String> {
    let shape = match &mut sensor.rest_shape {
        Some(sensor::RestShape::HeightMap(map)) => Some(&mut map.path),
        _ => None,
    };
    let gel = match &mut sensor.shape {
        Some(sensor::shape::SensorShape::Mesh(mesh)) => Some(&mut mesh.path),
        _ => None,
    };
    let pins = sensor.pins.as_mut().and_then(|pins| match &mut pins.layout {
        sensor::pins::PinLayout::File(path) => Some(path),
        _ => None,
    });
    shape.into_iter().chain(gel).chain(pins).chain(&mut sensor.background).chain(&mut sensor.calibration)
}

/// What the command line changes in a job.
#[derive(Clone, Debug, Default)]
pub struct Overrides {
    /// Dotted path and TOML value, as `--set` takes them, together with the flag that messages name.
    pub set: Vec<(String, String)>,
    /// Replaces the job's fidelity, gelpad and optics.
    pub fidelity: Option<Fidelity>,
}

impl Overrides {
    /// What the flags `--samples`, `--seed`, `--fidelity`, `--all-effects` and `--set` change.
    pub fn of_flags(
        samples: Option<u64>,
        seed: Option<u64>,
        fidelity: Option<Fidelity>,
        all_effects: bool,
        set: &[String],
    ) -> Self {
        let mut set: Vec<(String, String)> = set.iter().map(|text| (String::from("--set"), text.clone())).collect();
        for (flag, key, value) in [("--samples", "samples", samples), ("--seed", "seed", seed)] {
            set.extend(value.map(|value| (flag.to_owned(), format!("dataset.{key} = {value}"))));
        }
        if all_effects {
            set.push((String::from("--all-effects"), String::from("effects = \"all\"")));
        }
        Self { set, fidelity }
    }
}

/// A job together with where its keys stand.
#[derive(Clone, Debug)]
pub struct Written {
    /// The job, with defaults for what is not written or not readable.
    pub job: Job,
    /// Every text it came from.
    pub document: Document,
    /// The job's text is not TOML. What stands after a slip of syntax is a guess, so nothing else is said about it.
    pub broken: bool,
    /// The sensor file or preset that the job names could be read.
    pub sensor_known: bool,
    /// The job with the sensors of its other presets, where it names several.
    pub others: Vec<(Job, Document)>,
    /// The job with the sensor of a gripper's right finger, where it names one.
    pub right: Option<(Job, Document)>,
}

/// Reads the job file at `path` with `overrides` laid over it.
///
/// Mistakes of form (syntax, unknown keys, wrong types) are added to `problems`; what could be read is returned all
/// the same, so that the plan finds the mistakes of meaning in one go. Fails only if there is no text at all.
pub fn read(path: &Path, overrides: &Overrides, problems: &mut Diagnostics) -> Result<Written, Report> {
    let name = path.display().to_string();
    if Format::from_path(path).is_some() {
        let help = format!(
            "name it in one: path = \"{name}\" under [[object]]; gelsim init --objects FOLDER writes a job for the meshes of a folder"
        );
        return Err(user_error(format!("{name} is a mesh, not a job"), help));
    }
    let text = input::read(path, document::MOST_READ).map_err(|error| {
        let message = format!("{name}: cannot read the job: {error}");
        match path.is_dir() {
            true => user_error(message, "name the job file, which ends in .toml"),
            false if error.kind() == io::ErrorKind::NotFound => {
                let jobs = |path: &Path| path.extension().is_some_and(|ending| ending == "toml");
                let help = match input::meant(path, jobs) {
                    Some(name) => format!("did you mean {}?", path.with_file_name(name).display()),
                    None => String::from("gelsim init FILE.toml writes a job to start from"),
                };
                user_error(message, help)
            }
            false => Report::message(message),
        }
    })?;
    let text = String::from_utf8(text)
        .map_err(|error| Report::message(format!("{name}: not UTF-8 at byte {}", error.utf8_error().valid_up_to())))?;
    let folder = path.parent().unwrap_or(Path::new(""));
    Ok(read_text(&name, text, folder, overrides, problems))
}

/// Reads a job from text; see [`read`].
pub fn read_text(
    name: &str,
    text: String,
    folder: &Path,
    overrides: &Overrides,
    problems: &mut Diagnostics,
) -> Written {
    written(lay(name, text, folder, &overrides.set, problems), overrides)
}

/// Reads a sensor by the name of its preset or the path of its file: a job that says no more than that, the values `given`
/// at dotted paths, and what `overrides` say. Messages call it `--sensor`.
pub fn read_sensor(
    name: &str,
    given: Vec<(&str, Value)>,
    overrides: &Overrides,
    problems: &mut Diagnostics,
) -> Written {
    let key = if sensor::PRESETS.iter().any(|(known, _)| *known == name) { "sensor.preset" } else { "sensor.file" };
    read_named(key, name, given, overrides, problems)
}

/// Reads the sensor file at this path.
pub fn read_sensor_file(path: &str, problems: &mut Diagnostics) -> Written {
    read_named("sensor.file", path, Vec::new(), &Overrides::default(), problems)
}

fn read_named(
    key: &str,
    name: &str,
    given: Vec<(&str, Value)>,
    overrides: &Overrides,
    problems: &mut Diagnostics,
) -> Written {
    let mut document = Document::of_flag("--sensor", name);
    let place = document.root.place;
    for (path, value) in [(key, Value::String(name.to_owned()))].into_iter().chain(given) {
        let path: Vec<String> = path.split('.').map(str::to_owned).collect();
        document.set(&path, place, Node { place, value }).expect("nothing stands in the way of another key");
    }
    written(lay_over(document, &overrides.set, problems), overrides)
}

fn written(laid: Laid<Job>, overrides: &Overrides) -> Written {
    let Laid { value: mut job, document, broken, sensor_known, others, right, presets } = laid;
    if let Some(level) = overrides.fidelity.filter(|_| !broken) {
        job.fidelity = Some(level.into());
        job.gelpad = None;
        job.optics = None;
    }
    job.random = document.random.clone();
    job.presets = presets;
    let other = |job: &Job, (other, document): (Job, Document)| {
        let other = Job { random: document.random.clone(), ..other };
        (random::with_sensor_of(job, other), document)
    };
    let right = right.map(|right| other(&job, right));
    if let (Some(gripper), Some((right, _))) = (&mut job.gripper, &right) {
        gripper.right = Some(Box::new(right.whole_sensor()));
        gripper.right_random = right.random.clone();
    }
    let others = others.into_iter().map(|preset| other(&job, preset)).collect();
    Written { job, document, broken, sensor_known, others, right }
}

/// A file with a `[sensor]` table, read, and where its keys stand.
pub struct Laid<T> {
    /// What it says, with defaults for what is not written or not readable.
    pub value: T,
    /// Every text it came from.
    pub document: Document,
    /// The text is not TOML; nothing else is said about it.
    pub broken: bool,
    /// The sensor file or preset that it names could be read.
    pub sensor_known: bool,
    /// The same with other presets, where it names several.
    pub others: Vec<(T, Document)>,
    /// The same with the sensor of a gripper's right finger, where there is one.
    pub right: Option<(T, Document)>,
    /// Those presets.
    pub presets: Option<random::Presets>,
}

/// Reads `text` as a `T` with the assignments `set` laid over it (flag and assignment each) and the sensor that it names
/// laid under its `[sensor]`, `[markers]` and `[camera]`. Mistakes of form are added to `problems`.
pub fn lay<T: DeserializeOwned + Default>(
    name: &str,
    text: String,
    folder: &Path,
    set: &[(String, String)],
    problems: &mut Diagnostics,
) -> Laid<T> {
    let document = Document::parse(name, text, folder, problems);
    if !problems.is_empty() {
        return Laid {
            value: T::default(),
            document,
            broken: true,
            sensor_known: false,
            others: Vec::new(),
            right: None,
            presets: None,
        };
    }
    lay_over(document, set, problems)
}

fn lay_over<T: DeserializeOwned + Default>(
    mut document: Document,
    set: &[(String, String)],
    problems: &mut Diagnostics,
) -> Laid<T> {
    for (flag, assignment) in set {
        apply_override(&mut document, flag, assignment, problems);
    }
    let right = of_right_finger(&mut document);
    let several = random::Presets::take(&mut document, problems).unwrap_or_default();
    let (value, sensor_known) = with_sensor(&mut document, problems);
    let right = right.map(|mut right| {
        // Places are in texts that both know.
        right.sources.clone_from(&document.sources);
        let (value, _) = with_sensor(&mut right, problems);
        document.sources.clone_from(&right.sources);
        (value, right)
    });
    let mut others = Vec::new();
    let mut presets = None;
    if several.len() > 1 {
        for (of_preset, mut other) in several {
            // Places are in texts that all of them know.
            other.sources.clone_from(&document.sources);
            if presets.is_some() {
                let (value, _) = with_sensor(&mut other, problems);
                document.sources.clone_from(&other.sources);
                others.push((value, other));
            }
            presets = Some(of_preset);
        }
    }
    Laid { value, document, broken: false, sensor_known, others, right, presets }
}

/// The document of the right finger, where a gripper has one of its own: the table `gripper.right` is its `[sensor]`, and what
/// the job says beside its sensor of markers and camera is not of it. In the document itself stays an empty table.
fn of_right_finger(document: &mut Document) -> Option<Document> {
    let finger = document.get("gripper.right").filter(|node| matches!(node.value, Value::Table(_)))?.clone();
    let mut right = document.clone();
    ["gripper", "sensor", "markers", "camera"].into_iter().for_each(|name| right.remove(name));
    let place = finger.place;
    let path = |keys: &[&str]| keys.iter().map(|key| (*key).to_owned()).collect::<Vec<_>>();
    right.set(&path(&["sensor"]), place, finger).expect("a document is a table");
    let empty = Node { place, value: Value::Table(Vec::new()) };
    document.set(&path(&["gripper", "right"]), place, empty).expect("it is there");
    Some(right)
}

/// Reads a document over the sensor that it names. The second value is false if that cannot be read.
fn with_sensor<T: DeserializeOwned + Default>(document: &mut Document, problems: &mut Diagnostics) -> (T, bool) {
    let sensor_known = lay_under_sensor(document, problems);
    for table in ["markers", "camera"] {
        document.move_up("sensor", table);
    }
    let (random, plain) = random::take(document, problems);
    document.random = random;
    let value = reader::read(plain.as_ref().unwrap_or(&document.root), problems).unwrap_or_default();
    (value, sensor_known)
}

fn apply_override(document: &mut Document, flag: &str, assignment: &str, problems: &mut Diagnostics) {
    let source = document.sources.len();
    let mut found = Diagnostics::default();
    let tree = document.add_source(flag, assignment.to_owned(), Path::new(""), &mut found);
    let key = assignment.split('=').next().unwrap_or_default();
    let key_place = Place { source, start: 0, end: key.trim_end().len() };
    let mut path: Vec<String> = Vec::new();
    let mut node: &Node = &tree;
    // A dotted key parses to tables of one key each: the way down to the value is the path. It has as many steps as
    // the key has dots outside quotes, so that an inline table as the value is not taken for more path.
    let steps = dotted_steps(key);
    while path.len() < steps
        && let Value::Table(entries) = &node.value
        && let [entry] = entries.as_slice()
    {
        path.push(entry.key.clone());
        node = &entry.node;
    }
    if !found.is_empty() || path.len() != steps {
        let problem = Diagnostic::new(format!("not an assignment: `{assignment}`"))
            .at(Place { source, start: 0, end: assignment.len() })
            .help("write dotted.path=VALUE with a TOML value, for example --set 'sensor.resolution_px=[320, 240]' or --set 'dataset.name=\"mine\"'");
        problems.push(problem);
        return;
    }
    let node = node.clone();
    if let Err(reason) = document.set(&path, key_place, node) {
        problems.push(Diagnostic::new(reason).at(key_place));
    }
}

fn dotted_steps(key: &str) -> usize {
    let mut quote = None;
    1 + key
        .chars()
        .filter(|&c| {
            match (quote, c) {
                (None, '"' | '\'') => quote = Some(c),
                (Some(open), c) if open == c => quote = None,
                _ => {}
            }
            c == '.' && quote.is_none()
        })
        .count()
}

/// Lays the sensor file and the preset that the job names under its `[sensor]` table. False if one cannot be read.
fn lay_under_sensor(document: &mut Document, problems: &mut Diagnostics) -> bool {
    let mut known = true;
    let preset_key = document.get("sensor.preset").cloned();
    if let Some(file) = document.get("sensor.file").cloned()
        && let Some(written) = file.as_str()
    {
        if preset_key.is_some() {
            let problem = Diagnostic::new("both `preset` and `file` name a sensor")
                .at(file.place)
                .help("keep one; a sensor file may itself start with `preset = \"...\"`");
            problems.push(problem);
        }
        let path = document.folder("sensor.file").join(written);
        let text = input::read(&path, document::MOST_READ)
            .and_then(|bytes| String::from_utf8(bytes).map_err(io::Error::other));
        match text {
            Ok(text) => {
                let folder = path.parent().unwrap_or(Path::new("")).to_owned();
                let mut found = Diagnostics::default();
                let tree = document.add_source(&path.display().to_string(), text, &folder, &mut found);
                known = found.is_empty();
                problems.extend(found);
                if let Some(second) = tree.child("file") {
                    let problem = Diagnostic::new("a sensor file cannot start from another one")
                        .at(second.place)
                        .help("it may start from a preset: preset = \"...\"");
                    problems.push(problem);
                }
                if known {
                    document.underlay("sensor", tree);
                }
            }
            Err(error) => {
                known = false;
                let message = format!("cannot read the sensor file {}: {error}", path.display());
                let help = "a path is relative to the file it stands in; gelsim list sensors shows the presets";
                problems.push(Diagnostic::new(message).at(file.place).help(help));
            }
        }
    }
    let Some(preset) = document.get("sensor.preset").cloned() else { return known };
    let Some(name) = preset.as_str() else { return false };
    let names = sensor::PRESETS.map(|(name, _)| name);
    match sensor::PRESETS.iter().find(|(known, _)| *known == name) {
        Some((_, text)) => {
            let label = format!("preset {name}");
            let tree = document.add_source(&label, (*text).to_owned(), Path::new(""), problems);
            document.underlay("sensor", tree);
            known
        }
        None => {
            let near = nearest(name, names).map_or(String::new(), |near| format!("did you mean `{near}`? "));
            let help = format!("{near}one of {}", crate::files::spelling::one_of(&names));
            problems.push(Diagnostic::new(format!("no sensor preset is called `{name}`")).at(preset.place).help(help));
            false
        }
    }
}
