//! The job file as it is written: serde types, one file for each table, and the place of each key.
//!
//! Reading collects every error ([`gelsim_files::diagnostic`]). Whether values fit together is checked by the plan.

use std::io;
use std::path::Path;

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

pub mod dataset;
pub mod document;
pub mod fidelity;
mod file_kind;
pub mod gripper;
mod guesses;
mod level;
mod merge;
pub mod object;
pub mod output;
pub mod random;
mod reader;
pub mod scene;
pub mod sensors;
pub mod sequence;
mod synonyms;
mod syntax_help;
pub mod texture;

use document::{Document, TomlNode, TomlValue};
pub use file_kind::FileKind;
use gelsim_core::effects::EffectPolicy;
use gelsim_core::fidelity::Fidelity;
use gelsim_core::{gelpad, optics};
use gelsim_files::diagnostic::{Diagnostics, Report, user_error};
use gelsim_files::foreign::decode_text;
use gelsim_files::input;
use gelsim_files::mesh::Format;
use gelsim_files::sensor::camera::CameraDistribution;
use gelsim_files::sensor::markers::MarkerDistribution;
use gelsim_files::sensor::quantity::Quantity;
use gelsim_files::sensor::random::SensorDistribution;
use gelsim_files::sensor::{self, Sensor};
use gelsim_files::spelling::quote_for_shell;
pub use guesses::{format_integer, guess_choice, is_guess_at, suggest_choice};
use merge::merge_document;
pub use merge::{MergedDocument, read_merged};
use sequence::SequenceFriction;

/// A job. Keys that are left out have the default that is named with each.
#[derive(Clone, Debug, Default, Serialize, Deserialize, JsonSchema)]
#[serde(default, deny_unknown_fields)]
pub struct Job {
    /// Fidelity level, or a bound by which it is chosen. It fills the gelpad and optics choices that the job leaves
    /// open.
    pub fidelity: Option<fidelity::FidelityChoice>,
    /// Which effects run: those that a sample needs, or all of them.
    pub effects: EffectPolicy,
    /// Model of the gelpad's shape under the object.
    pub gelpad: Option<gelpad::Model>,
    /// Model of the light that the camera sees.
    pub optics: Option<optics::Model>,
    /// How many samples, from which seed, in which shards and splits.
    pub dataset: dataset::Dataset,
    /// The sensor.
    pub sensor: Sensor,
    /// Several sensors under the same presses, each with a dataset of its own; without it there is one.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub sensors: Option<sensors::Sensors>,
    /// The objects.
    #[schemars(required)]
    pub object: Vec<object::Object>,
    /// How many objects are pressed in together; without it each sample has one object.
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
    /// What is drawn anew of the sensor for each sample; `sensor` then has a typical value in its place.
    #[serde(skip)]
    pub random: SensorDistribution,
    /// The presets of which each sample gets one. `sensor`, `random`, `markers` and `camera` are those of the first.
    #[serde(skip)]
    pub presets: Option<random::SensorPresets>,
}

impl Job {
    /// Returns everything in the job as a tree, as it would be written.
    pub fn to_json(&self) -> serde_json::Value {
        let mut tree =
            serde_json::to_value(self).expect("a job has string keys, and a job leaves no single effect out");
        random::restore_distributions(&self.random, &mut tree["sensor"]);
        if let Some(gripper) = self.gripper.as_ref().filter(|gripper| gripper.right.is_some()) {
            random::restore_distributions(&gripper.right_random, &mut tree["gripper"]["right"]);
        }
        if let Some(presets) = &self.presets {
            presets.restore_into(&mut tree);
        }
        tree
    }

    /// Returns the sensor of the simulator, without what is in files.
    pub fn sensor_without_files(&self) -> gelsim_core::sensor::Sensor {
        let mut sensor = self.sensor.to_simulator_sensor(self.markers.as_ref(), &self.camera);
        // A grip balances elastic fingers.
        if self.gripper.is_some() {
            sensor.relaxation.clear();
        }
        sensor
    }

    /// Formats everything in the job as TOML, with paths as they are.
    pub fn to_toml(&self) -> io::Result<String> {
        let mut tree = self.to_json();
        random::drop_nulls(&mut tree);
        toml::to_string(&tree).map_err(io::Error::other)
    }

    /// Returns how many objects a sample may have.
    pub fn objects_per_sample(&self) -> scene::Count {
        self.scene.map_or_else(scene::Count::default, |scene| scene.objects_per_sample)
    }

    /// Iterates over the paths of all files that the job names.
    pub fn paths_mut(&mut self) -> impl Iterator<Item = &mut String> {
        let objects = self.object.iter_mut().flat_map(|object| {
            let textures = object.texture.iter_mut().flat_map(texture::TextureDistribution::paths_mut);
            object.path.iter_mut().chain(&mut object.packages).chain(textures)
        });
        let textures = self.texture.paths_mut();
        let markers = self.markers.iter_mut().filter_map(|markers| markers.file.as_mut());
        let left = sensor_paths_mut(&mut self.sensor).chain(markers).chain(&mut self.random.backgrounds);
        let right = self.gripper.iter_mut().flat_map(|gripper| {
            gripper
                .right
                .iter_mut()
                .flat_map(|right| sensor_paths_mut(right))
                .chain(&mut gripper.right_random.backgrounds)
        });
        objects.chain(textures).chain(left).chain(right)
    }

    /// Returns the sensor with its markers and camera, as a sensor file has them.
    pub fn sensor_with_camera(&self) -> Sensor {
        Sensor { markers: self.markers.clone(), camera: Some(self.camera.clone()), ..self.sensor.clone() }
    }
}

/// Gives a sequence the friction of its sensor's gelpad, if that is known.
fn fill_friction_from_sensor(job: &mut Job) {
    if let (Some(sequence), Some(coefficient)) = (&mut job.sequence, job.sensor.gelpad_friction_coefficient) {
        sequence.friction = SequenceFriction::Coefficient(Quantity::Constant(coefficient));
    }
}

/// Iterates over the paths of all files that a sensor names, without the backgrounds of which each sample gets one.
pub fn sensor_paths_mut(sensor: &mut Sensor) -> impl Iterator<Item = &mut String> {
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
    let markers = sensor.markers.as_mut().and_then(|markers| markers.file.as_mut());
    shape.into_iter().chain(gel).chain(pins).chain(markers).chain(&mut sensor.background).chain(&mut sensor.calibration)
}

/// Changes of the command line to a job.
#[derive(Clone, Debug, Default)]
pub struct Overrides {
    /// Dotted path and TOML value, as `--set` takes them, each after the flag that messages name.
    pub set: Vec<(String, String)>,
    /// Level that replaces the job's fidelity; what the job says of physics stays.
    pub fidelity: Option<Fidelity>,
}

impl Overrides {
    /// Makes the overrides of the flags `--samples`, `--seed`, `--fidelity`, `--all-effects` and `--set`.
    pub fn from_flags(
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

/// A job that was read, with the places of its keys.
#[derive(Clone, Debug)]
pub struct ParsedJob {
    /// The job, with defaults for what is not written or not readable.
    pub job: Job,
    /// All its sources and the merged tree.
    pub document: Document,
    /// Whether the text is not TOML, or another kind of file. What stands after a syntax error is uncertain, so nothing
    /// else is reported.
    pub broken: bool,
    /// Whether the sensor file or preset that the job names could be read.
    pub sensor_known: bool,
    /// The job with the sensor of each of its other presets, if it names several.
    pub other_presets: Vec<(Job, Document)>,
    /// The job with the sensor of a gripper's right finger, if it names one.
    pub right_finger: Option<(Job, Document)>,
    /// The job with each further sensor of `[sensors]`.
    pub further_sensors: Vec<Self>,
    /// The calibration presses of `[sensors]`.
    pub calibration: Option<Box<Self>>,
}

/// Reads the job file at `path` with `overrides` merged over it.
///
/// Errors of form (syntax, unknown keys, wrong types) are added to `problems`. What could be read is returned all the
/// same, so that the plan finds the errors of meaning in the same run. It fails only if there is no text at all.
pub fn read_job(path: &Path, overrides: &Overrides, problems: &mut Diagnostics) -> Result<ParsedJob, Report> {
    let name = path.display().to_string();
    if Format::from_path(path).is_some() {
        let folder = path.parent().filter(|folder| *folder != Path::new("")).unwrap_or(Path::new("."));
        let help = format!(
            "gelsim inspect {} says what it is like; gelsim init --objects {} job.toml writes a job that presses it",
            quote_for_shell(path),
            quote_for_shell(folder)
        );
        return Err(user_error(format!("{name} is a mesh, not a job"), help));
    }
    let text = input::read(path, document::MAX_READ_BYTES).map_err(|error| {
        let message = format!("{name}: cannot read the job: {error}");
        match path.is_dir() {
            true => user_error(message, "name the job file, which ends in .toml"),
            false if error.kind() == io::ErrorKind::NotFound => {
                let jobs = |path: &Path| path.extension().is_some_and(|ending| ending == "toml");
                let help = match input::suggest_file_name(path, jobs) {
                    Some(name) => format!("did you mean {}?", path.with_file_name(name).display()),
                    None => String::from("gelsim init FILE.toml writes a job to start from"),
                };
                user_error(message, help)
            }
            false => user_error(message, "name the job file, a text that ends in .toml"),
        }
    })?;
    let text = decode_text(text)
        .map_err(|reason| user_error(format!("{name}: cannot read the job: {reason}"), "a job is a text in UTF-8"))?;
    let folder = path.parent().unwrap_or(Path::new(""));
    Ok(read_job_text(&name, text, folder, overrides, problems))
}

/// Reads a job from a text, as [`read_job`] does from a file.
pub fn read_job_text(
    name: &str,
    text: String,
    folder: &Path,
    overrides: &Overrides,
    problems: &mut Diagnostics,
) -> ParsedJob {
    let merged = read_merged(FileKind::Job, name, text, folder, &overrides.set, problems);
    to_parsed_job(merged, overrides, problems)
}

/// Reads a sensor by the name of its preset or the path of its file, as a job that says only that, with the values
/// `given` at dotted paths and with `overrides`. Messages call it `--sensor`.
pub fn read_sensor(
    name: &str,
    given: Vec<(&str, TomlValue)>,
    overrides: &Overrides,
    problems: &mut Diagnostics,
) -> ParsedJob {
    let key = if sensor::PRESETS.iter().any(|(known, _)| *known == name) { "sensor.preset" } else { "sensor.file" };
    read_named_sensor(key, name, given, overrides, problems)
}

/// Reads the sensor file at this path, as a job that says only that.
pub fn read_sensor_file(path: &str, problems: &mut Diagnostics) -> ParsedJob {
    read_named_sensor("sensor.file", path, Vec::new(), &Overrides::default(), problems)
}

fn read_named_sensor(
    key: &str,
    name: &str,
    given: Vec<(&str, TomlValue)>,
    overrides: &Overrides,
    problems: &mut Diagnostics,
) -> ParsedJob {
    let mut document = Document::from_flag("--sensor", name);
    let place = document.root.place;
    for (path, value) in [(key, TomlValue::String(name.to_owned()))].into_iter().chain(given) {
        let path: Vec<String> = path.split('.').map(str::to_owned).collect();
        document.set(&path, place, TomlNode { place, value }).expect("nothing stands in the way of another key");
    }
    let merged = merge_document(document, &overrides.set, problems);
    to_parsed_job(merged, overrides, problems)
}

fn to_parsed_job(merged: MergedDocument<Job>, overrides: &Overrides, problems: &mut Diagnostics) -> ParsedJob {
    let MergedDocument {
        value: mut job,
        document,
        broken,
        sensor_known,
        other_presets: others,
        right_finger: right,
        presets,
        further_sensors,
        calibration,
    } = merged;
    if !broken {
        match overrides.fidelity {
            Some(level) => level::replace_level(&mut job, &document, level, problems),
            None => level::fill_from_level(&mut job, &document),
        }
    }
    job.random = document.random.clone();
    job.presets = presets;
    let other = |job: &Job, (other, document): (Job, Document)| {
        let other = Job { random: document.random.clone(), ..other };
        (random::replace_sensor(job, other), document)
    };
    let right = right.map(|right| other(&job, right));
    if let (Some(gripper), Some((right, _))) = (&mut job.gripper, &right) {
        gripper.right = Some(Box::new(right.sensor_with_camera()));
        gripper.right_random = right.random.clone();
    }
    let mut others: Vec<(Job, Document)> = others.into_iter().map(|preset| other(&job, preset)).collect();
    if document.get("sequence.friction").is_none() {
        let jobs = others.iter_mut().map(|(job, _)| job);
        jobs.chain([&mut job]).for_each(fill_friction_from_sensor);
    }
    let further = further_sensors.into_iter().map(|further| to_parsed_job(further, overrides, problems)).collect();
    let calibration = calibration.map(|presses| Box::new(to_parsed_job(*presses, overrides, problems)));
    ParsedJob {
        job,
        document,
        broken,
        sensor_known,
        other_presets: others,
        right_finger: right,
        further_sensors: further,
        calibration,
    }
}
