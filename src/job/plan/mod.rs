//! From job to plan: defaults, presets, files and tables resolved, every mistake found.
//!
//! After this nothing that depends on what the user wrote can fail. A [`Plan`] is the job, the simulator of its sensor,
//! what its samples are drawn from, and their layout.

use std::collections::BTreeSet;
use std::io;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use crate::config::fidelity::FidelityChoice;
use crate::config::output::Output;
use crate::config::{self, Job, Overrides, Written};
use crate::layers::OutputLayer;
use crate::layout::Layout;
use gelsim_core::base::rng::{redrawn, stream};
use gelsim_core::base::view::View;
use gelsim_core::depth::relief::Relief;
use gelsim_core::effects::EffectPolicy;
use gelsim_core::fidelity::{Fidelity, Models};
use gelsim_core::sensor::{Background, Sensor};
use gelsim_core::simulator::Simulator;
use gelsim_files::diagnostic::{Consequence, Diagnostic, Diagnostics, Report, user_error};

pub mod check;
mod curved;
pub mod draw;
pub mod faces;
mod files;
mod fingerprint;
pub mod frames;
mod gel;
mod gripper;
mod materials;
mod meshes;
mod naming;
mod notes;
mod object_notes;
mod objects;
mod paths;
mod presets;
pub mod ranges;
mod remedies;
pub mod sensors;
mod sequence;
mod several;
pub mod standalone;
mod unused;
mod variants;

use check::Check;
use draw::Draw;
pub use files::Photograph;
pub use fingerprint::fingerprint;
pub use naming::{name, stem};
use notes::Whose;
pub use objects::{Object, ids};
use presets::others_sensors;
use sensors::SensorSampling;

/// Everything a sample depends on, resolved and checked. A clone shares all that is large.
#[derive(Clone)]
pub struct Plan {
    /// The job with every default written out; paths are absolute here. Its tables are the distributions of the samples.
    pub(crate) job: Job,
    /// The sensor, made ready. While the fidelity is still to be chosen, at the most exact level. Where samples differ in
    /// their sensors, that of typical values; see [`crate::scene::Scene::simulator`].
    pub simulator: Arc<Simulator>,
    /// What sensors are drawn from.
    pub sensors: Arc<SensorSampling>,
    /// What samples are drawn from beside the job's tables.
    pub sampling: Arc<Sampling>,
    /// Samples, splits and shards.
    pub layout: Layout,
    /// SHA-256 over all that decides the bytes of a sample; paths are not part of it, contents are.
    pub fingerprint: String,
    /// What the user should know of the job that is no mistake.
    pub notes: Report,
    /// One of them says why samples may touch nothing.
    pub explains_misses: bool,
    /// The sensor file that the job names, for messages: what is in it is in the job.
    pub sensor_file: Option<PathBuf>,
    /// The job itself names its model of the light, which then stays whatever level is tried.
    optics_named: bool,
    /// The same of its shadows.
    shadows_named: bool,
    /// The same with the sensors of the job's other presets, where it names several.
    others: Vec<Self>,
    /// The same with the sensor of a gripper's right finger, where that has one of its own.
    right: Option<Box<Self>>,
}

/// What samples are drawn from: contents of the files that a job names.
#[derive(Debug)]
pub struct Sampling {
    /// The objects, in the order of the job.
    pub objects: Vec<Object>,
    /// Class names, sorted; an object's `class_index` counts here.
    pub classes: Vec<String>,
    /// For each of [`crate::layout::Split::ALL`]: how its objects are drawn.
    pub draw: [Draw; 3],
    /// The texture's patterns; none if no sample has a texture.
    pub textures: Vec<Arc<Relief>>,
    /// Some sample's object is moved in the pad's plane.
    pub moves_objects: bool,
}

/// What of a job its user wrote, which decides what can be wrong with it.
#[derive(Clone, Copy, PartialEq, Eq)]
enum Scope {
    /// All: a dataset.
    Dataset,
    /// The sensor and the objects: where they are pressed comes from elsewhere.
    Objects,
    /// The sensor alone: what is pressed comes as depth frames.
    Frames,
}

impl Plan {
    /// Reads and resolves the job file at `path`. On failure, every mistake found in it.
    pub fn load(path: &Path, overrides: &Overrides) -> Result<Self, Report> {
        let mut problems = Diagnostics::default();
        let written = config::read(path, overrides, &mut problems)?;
        Self::resolve(written, problems)
    }

    /// Reads and resolves a job from text; relative paths in it start from `folder`, and messages call it `name`.
    pub fn read(name: &str, text: String, folder: &Path, overrides: &Overrides) -> Result<Self, Report> {
        let mut problems = Diagnostics::default();
        let written = config::read_text(name, text, folder, overrides, &mut problems);
        Self::resolve(written, problems)
    }

    /// Resolves a job that was read; `problems` holds the mistakes of form found while reading.
    pub fn resolve(written: Written, problems: Diagnostics) -> Result<Self, Report> {
        Self::resolve_in(Scope::Dataset, written, problems)
    }

    /// Resolves the sensor and the objects of a job that says no more: how they are pressed is known otherwise.
    pub fn resolve_objects(written: Written, problems: Diagnostics) -> Result<Self, Report> {
        Self::resolve_in(Scope::Objects, written, problems)
    }

    fn resolve_in(scope: Scope, written: Written, mut problems: Diagnostics) -> Result<Self, Report> {
        let Written { mut job, document, broken, sensor_known, others, right } = written;
        if broken {
            return Err(Report::new(&problems, &document.sources));
        }
        let mut check = Check { document: &document, problems: &mut problems };
        // What is said and is not what the level stands for anyway.
        let of_level = level(&job).models(job.sensor.light_source()).optics;
        let optics_named = job.optics.as_ref().is_some_and(|own| *own != of_level);
        let shadows_named =
            job.optics.as_ref().is_some_and(|own| document.get(&format!("optics.{}.shadows", own.name())).is_some());
        let sensor_file = job.sensor.file.as_ref().map(|file| document.folder("sensor.file").join(file));
        fill(&mut job);
        gel::read(&mut check, &mut job.sensor);
        if scope == Scope::Dataset {
            ranges::dataset(&mut check, &job);
        }
        if scope == Scope::Frames {
            ranges::seed(&mut check, &job);
        }
        ranges::sensor(&mut check, &job);
        ranges::pad_surface(&mut check, &job);
        if scope == Scope::Dataset {
            ranges::scene(&mut check, &job, sensor_known);
            if let Some(gripper) = &job.gripper {
                gripper::check(&mut check, &job, gripper, right.as_ref().map(|(right, _)| right), sensor_known);
            }
            several::check(&mut check, &job);
        }
        ranges::object_effects(&mut check, &job);
        ranges::camera(&mut check, &job);
        ranges::models(&mut check, &job);
        materials::check(&mut check, &job);
        curved::job(&mut check, &job, scope);
        // Where units do not differ, how much they would is no part of the job.
        job.sensor.unit = job.sensor.unit.take().filter(|unit| unit.variation != 0.0);
        let sensor = complete_sensor(&mut check, &mut job);
        let others = others_sensors(scope, &job, others, check.problems);
        let right = right.and_then(|right| gripper::right_finger(scope, &job, right, check.problems));
        if let (Some(gripper), Some(right)) = (&mut job.gripper, &right) {
            // With what its files hold.
            gripper.right = Some(Box::new(right.job.whole_sensor()));
            gripper.right_random = right.job.random.clone();
        }
        let mut check = Check { document: &document, problems: &mut problems };
        let textures = files::textures(&mut check, "texture", &mut job.texture);
        let mut notes = Diagnostics::default();
        notes.extend(unused::of_objects(&job, &document));
        let found = match scope {
            Scope::Frames => Some((Vec::new(), Draw::NOTHING)),
            Scope::Objects => {
                objects::as_they_are(&mut check, &job);
                Some((objects::load(&mut check, &mut job, &mut notes).objects, Draw::NOTHING))
            }
            Scope::Dataset => {
                let found = objects::load(&mut check, &mut job, &mut notes);
                objects::divide(&mut check, &job, &found).map(|draw| (found.objects, draw))
            }
        };
        let (Some((objects, draw)), Some((sensor, photographs, background_note)), true) =
            (found, sensor, problems.is_empty())
        else {
            return Err(Report::new(&problems, &document.sources));
        };
        notes.extend(background_note);
        notes.extend(gel::notes(&job.sensor));
        let whose = match scope {
            Scope::Frames => Whose::Frames,
            _ if !others.is_empty() => Whose::Presets,
            _ => Whose::Job,
        };
        notes.extend(notes::of(&job, whose, |key| document.place(key)));
        notes.extend(unused::of(&job, &document));
        let others_jobs = others.iter().map(|other| (&other.job, Whose::Presets));
        for (other, whose) in others_jobs.chain(right.iter().map(|right| (&right.job, Whose::Right))) {
            let known: Vec<String> = notes.iter().map(|note| note.message.clone()).collect();
            notes.extend(notes::of(other, whose, |_| None).into_iter().filter(|note| !known.contains(&note.message)));
        }
        let simulator = simulator(sensor, chosen_models(&job), job.effects, &job);
        let classes = classes(objects.iter().map(|object| object.class.as_str()));
        let sampling = Sampling { objects, classes, draw, textures, moves_objects: job.shear.any() };
        let plan = Self {
            simulator: Arc::new(simulator),
            sensors: Arc::new(SensorSampling::new(&job, photographs)),
            sampling: Arc::new(sampling),
            layout: Layout::from_dataset(&job.dataset),
            fingerprint: fingerprint(&job),
            explains_misses: explains_misses(&notes),
            notes: Report::new(&notes, &document.sources),
            sensor_file,
            optics_named,
            shadows_named,
            others: Vec::new(),
            right: None,
            job,
        };
        let right = right.map(|right| Box::new(right.plan(&plan)));
        let plan = Self { right, ..plan };
        let others = others.into_iter().map(|other| other.plan(&plan)).collect();
        Ok(Self { others, ..plan })
    }

    /// Its job.
    pub fn job(&self) -> &Job {
        &self.job
    }

    /// Its job as text, with every default written out and absolute paths: a plan of that text renders the same, in any
    /// folder.
    pub fn to_toml(&self) -> io::Result<String> {
        let mut job = self.job.clone();
        for path in job.paths_mut() {
            let absolute = std::path::absolute(&path)?.into_os_string().into_string();
            *path = absolute.map_err(|path| io::Error::other(format!("{}: not UTF-8", path.display())))?;
        }
        job.to_toml()
    }

    /// Name of the dataset; empty where there is none.
    pub fn name(&self) -> &str {
        self.job.dataset.name.as_deref().unwrap_or("")
    }

    /// Which sides of its objects are pressed, where the job leaves that open.
    pub fn pressed_sides(&self) -> Option<String> {
        objects::pressed_sides(&self.sampling.objects)
    }

    /// Seed of all randomness.
    pub fn seed(&self) -> u64 {
        self.job.dataset.seed
    }

    /// What is written of a sample.
    pub fn output(&self) -> &Output {
        &self.job.output
    }

    /// Layers to be written, in the order of [`OutputLayer::ALL`].
    pub fn layers(&self) -> Vec<OutputLayer> {
        self.job.output.layers_in_order()
    }

    /// Fidelity level. While it is still to be chosen, the most exact one.
    pub fn fidelity(&self) -> Fidelity {
        level(&self.job)
    }

    /// Thickness of the pad, mm.
    pub fn thickness_mm(&self) -> f64 {
        self.simulator.sensor().gelpad.thickness_mm
    }

    /// Refuses a job of sequences or of a gripper where `what` looks at single presses.
    ///
    /// # Errors
    ///
    /// What is wrong with such a job.
    pub fn of_presses(&self, what: &str) -> Result<(), Report> {
        self.of_one_sensor(what)?;
        match self.job.sequence {
            None => Ok(()),
            Some(_) => Err(user_error(
                format!("{what} looks at single presses, and the samples of this job are sequences"),
                format!("take a job without it: {}", remedies::single_presses(&self.job, "[sequence]")),
            )),
        }
    }

    /// Refuses a job of a gripper where `what` looks at one sensor.
    ///
    /// # Errors
    ///
    /// What is wrong with such a job.
    pub fn of_one_sensor(&self, what: &str) -> Result<(), Report> {
        match self.job.gripper {
            None => Ok(()),
            Some(_) => Err(user_error(
                format!("{what} looks at one sensor, and the samples of this job are held by two"),
                format!("take a job without one: {}", remedies::single_presses(&self.job, "[gripper]")),
            )),
        }
    }

    /// Refuses a job of several objects in a press where `what` looks at one.
    ///
    /// # Errors
    ///
    /// What is wrong with such a job.
    pub fn of_single_objects(&self, what: &str) -> Result<(), Report> {
        match self.job.objects_per_sample().most {
            1 => Ok(()),
            _ => Err(user_error(
                format!("{what} looks at the press of one object, and samples of this job have several"),
                "take a job without it: leave [scene] out, or write objects_per_sample = 1 in it",
            )),
        }
    }

    /// The plan of a gripper's right finger: this one, or where that finger has a sensor of its own, the same with it.
    pub fn right(&self) -> &Self {
        self.right.as_deref().unwrap_or(self)
    }

    /// True if the job asks for what only a gelpad model that solves the contact knows: pressures, and tractions.
    pub fn solves_contact(&self) -> bool {
        let Job { sensor, sequence, gripper, object, .. } = &self.job;
        let layers = self.layers();
        let of_contact = [OutputLayer::Pressure, OutputLayer::Flow].iter().any(|layer| layers.contains(layer));
        let soft = object.iter().any(|object| object.youngs_modulus_kpa.is_some());
        of_contact || soft || sensor.shape.is_some() || sequence.is_some() || gripper.is_some()
    }

    /// The bound by which the job's fidelity level is still to be chosen.
    pub fn open_choice(&self) -> Option<FidelityChoice> {
        self.job.fidelity.filter(|fidelity| fidelity.level().is_none())
    }

    /// The plan that a draw of a sample follows: this one, or where the job names several presets, that of one of them.
    pub fn of_sample(&self, index: u64, attempt: u32) -> &Self {
        if self.others.is_empty() {
            return self;
        }
        let number = stream(self.seed(), "sensor preset", redrawn(index, attempt)).below(1 + self.others.len());
        if number == 0 { self } else { &self.others[number - 1] }
    }

    /// Number of a class among the plan's. Every object has one; a depth frame whose class nobody named has none.
    pub fn class_index(&self, class: &str) -> Option<usize> {
        self.sampling.classes.binary_search_by(|known| known.as_str().cmp(class)).ok()
    }

    /// Where the dataset goes unless the command line says otherwise.
    pub fn default_output(&self) -> PathBuf {
        Path::new("out").join(self.name())
    }
}

/// The sensor of a job with what its files hold, its photographs, and a note where one was resampled. `None` after a
/// mistake.
fn complete_sensor(check: &mut Check<'_>, job: &mut Job) -> Option<(Sensor, Vec<Photograph>, Option<Diagnostic>)> {
    let backgrounds = files::backgrounds(check, job);
    let calibration = files::calibration(check, job);
    let rest_surface = files::rest_surface(check, job);
    let (photographs, note) = backgrounds?;
    let mut sensor = job.bare_sensor();
    (sensor.calibration, sensor.rest_surface) = (calibration.map(Arc::new), rest_surface);
    if let Some(photograph) = photographs.first() {
        sensor.background = Background::Photograph(Arc::clone(&photograph.image));
    }
    Some((sensor, photographs, note))
}

/// True if one of a job's notes says why its samples may touch nothing.
fn explains_misses(notes: &Diagnostics) -> bool {
    notes.iter().any(|note| note.consequence == Some(Consequence::NoContact))
}

/// Writes out the defaults that depend on other keys.
fn fill(job: &mut Job) {
    job.fidelity.get_or_insert(Fidelity::default().into());
    let models = level(job).models(job.sensor.light_source());
    job.gelpad.get_or_insert(models.gelpad);
    job.optics.get_or_insert(models.optics);
    job.sensor.preset = None;
    job.sensor.file = None;
    // Laid under the job's own tables when they were read.
    job.sensor.markers = None;
    job.sensor.camera = None;
}

/// Class names in the order of their `class_index`.
pub fn classes<'a>(of_objects: impl Iterator<Item = &'a str>) -> Vec<String> {
    let names: BTreeSet<&str> = of_objects.collect();
    names.into_iter().map(str::to_owned).collect()
}

/// The fidelity level of a job; the most exact one while it is still to be chosen.
pub fn level(job: &Job) -> Fidelity {
    job.fidelity.map_or(Fidelity::default(), |fidelity| fidelity.level().unwrap_or(Fidelity::Reference))
}

/// What simulates the layers that a job wants.
fn simulator(sensor: Sensor, models: Models, policy: EffectPolicy, job: &Job) -> Simulator {
    let simulator = Simulator::with_models(sensor, models, policy);
    if job.output.layers.contains(&OutputLayer::Flow) { simulator.with_flow() } else { simulator }
}

fn chosen_models(job: &Job) -> Models {
    let models = level(job).models(job.sensor.light_source());
    Models { gelpad: job.gelpad.clone().unwrap_or(models.gelpad), optics: job.optics.clone().unwrap_or(models.optics) }
}

/// View of a job's sensor.
pub fn view(job: &Job) -> View {
    job.bare_sensor().view()
}
