//! Resolves a job to a plan: defaults, presets, files and tables, with every error reported.
//!
//! After this, nothing that depends on what the user wrote can fail. A [`Plan`] is the job, the simulator of its
//! sensor, the sources from which its samples are drawn, and their layout.

use std::collections::BTreeSet;
use std::io;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use crate::config::fidelity::FidelityChoice;
use crate::config::output::Output;
use crate::config::{self, Job, Overrides, ParsedJob};
use crate::layers::OutputLayer;
use crate::layout::Layout;
use gelsim_core::base::rng::{random_stream, redraw_index};
use gelsim_core::base::view::View;
use gelsim_core::depth::relief::Relief;
use gelsim_core::effects::EffectPolicy;
use gelsim_core::fidelity::{Fidelity, Models};
use gelsim_core::sensor::{Background, Sensor};
use gelsim_core::simulator::Simulator;
use gelsim_files::diagnostic::{Consequence, Diagnostic, Diagnostics, Report, user_error};

pub mod check;
mod curved;
pub mod faces;
mod files;
mod fingerprint;
pub mod frames;
mod gel;
mod geometry;
mod gripper;
pub mod markers;
mod materials;
mod mesh_cache;
mod mesh_facts;
mod meshes;
mod naming;
mod notes;
mod object_notes;
pub mod object_sampler;
mod objects;
mod paths;
mod presets;
pub mod ranges;
mod remedies;
mod sensor_set;
pub mod sensors;
mod sequence;
mod several_objects;
pub mod standalone;
mod strain;
mod unused;
mod variants;

use check::JobChecker;
pub use files::Photograph;
pub use fingerprint::compute_fingerprint;
pub use naming::{file_stem, object_name};
use notes::SensorRole;
use object_sampler::ObjectSampler;
pub use objects::{PreparedObject, make_unique_ids};
use presets::resolve_other_presets;
pub use sensor_set::{CALIBRATION_FOLDER, SetMember};
use sensors::SensorSampling;

/// Everything on which a sample depends, resolved and checked. A clone shares all large data.
#[derive(Clone)]
pub struct Plan {
    /// The job with every default written out and absolute paths. Its tables are the distributions of the samples.
    pub(crate) job: Job,
    /// The prepared simulator of the sensor. If the fidelity is still to be chosen, it has the most exact level. If
    /// samples have different sensors, it is that of typical values; see [`crate::scene::Scene::simulator`].
    pub simulator: Arc<Simulator>,
    /// The distributions from which sensors are drawn.
    pub sensors: Arc<SensorSampling>,
    /// What samples are drawn from besides the job's tables.
    pub sampling: Arc<SampleSources>,
    /// Splits and shards of the samples.
    pub layout: Layout,
    /// SHA-256 over all that decides the bytes of a sample: contents of files, but not their paths.
    pub fingerprint: String,
    /// What the user should know of the job, besides errors.
    pub notes: Report,
    /// Whether one of the notes explains why samples may touch nothing.
    pub explains_no_contact: bool,
    /// The sensor file that the job names, for messages. Its content is part of the job.
    pub sensor_file: Option<PathBuf>,
    /// Whether the job names its own optics model, which then stays at every fidelity level.
    optics_named: bool,
    /// Whether the job names its own shadows, which then stay at every fidelity level.
    shadows_named: bool,
    /// Plans with the sensors of the job's other presets, if it names several.
    other_sensors: Vec<Self>,
    /// Plan with the sensor of a gripper's right finger, if that has one of its own.
    right_finger: Option<Box<Self>>,
    /// Plans with the further sensors of `[sensors]`.
    further_sensors: Vec<Self>,
    /// Plan of the calibration presses of `[sensors]`.
    pub calibration: Option<Box<Self>>,
}

/// What samples are drawn from: the contents of the files that a job names.
#[derive(Debug)]
pub struct SampleSources {
    /// The objects, in the order of the job.
    pub objects: Vec<PreparedObject>,
    /// Class names, sorted. An object's `class_index` is an index into this list.
    pub classes: Vec<String>,
    /// For each of [`crate::layout::Split::ALL`], how its objects are drawn.
    pub object_samplers: [ObjectSampler; 3],
    /// Patterns of the texture; empty if no sample has texture.
    pub textures: Vec<Arc<Relief>>,
    /// Whether the object of any sample is moved in the pad's plane.
    pub moves_objects: bool,
}

/// Which parts of a job its user wrote. This decides what can be wrong with it.
#[derive(Clone, Copy, PartialEq, Eq)]
enum Scope {
    /// All parts: a dataset.
    Dataset,
    /// The sensor and the objects. Their poses come from elsewhere.
    Objects,
    /// Only the sensor. Depth frames are pressed.
    Frames,
}

impl Plan {
    /// Reads and resolves the job file at `path`. The error reports all that is wrong with it.
    pub fn load(path: &Path, overrides: &Overrides) -> Result<Self, Report> {
        let mut problems = Diagnostics::default();
        let written = config::read_job(path, overrides, &mut problems)?;
        Self::resolve(written, problems)
    }

    /// Reads and resolves a job from a text. Relative paths in it start from `folder`, and messages call it `name`.
    pub fn read(name: &str, text: String, folder: &Path, overrides: &Overrides) -> Result<Self, Report> {
        let mut problems = Diagnostics::default();
        let written = config::read_job_text(name, text, folder, overrides, &mut problems);
        Self::resolve(written, problems)
    }

    /// Resolves a job that was read. `problems` holds the errors of form that were found while reading.
    pub fn resolve(written: ParsedJob, problems: Diagnostics) -> Result<Self, Report> {
        Self::resolve_in(Scope::Dataset, written, problems)
    }

    /// Resolves the sensor and the objects of a job that says no more. How they are pressed is known otherwise.
    pub fn resolve_objects(written: ParsedJob, problems: Diagnostics) -> Result<Self, Report> {
        Self::resolve_in(Scope::Objects, written, problems)
    }

    fn resolve_in(scope: Scope, written: ParsedJob, mut problems: Diagnostics) -> Result<Self, Report> {
        // All documents of a job number their sources in the same way, and the first one has all.
        let sources = written.document.sources.clone();
        Self::resolve_set(scope, written, &mut problems).ok_or_else(|| Report::new(&problems, &sources))
    }

    /// Resolves the job with all its sensors, and their calibration presses. Errors go to `problems`; after one, `None`
    /// is returned.
    fn resolve_set(scope: Scope, mut written: ParsedJob, problems: &mut Diagnostics) -> Option<Self> {
        let further = std::mem::take(&mut written.further_sensors);
        let calibration = written.calibration.take();
        let of_face = written.document.place_of("pose.face");
        let first = Self::resolve_one(scope, written, problems);
        // All are resolved, so that all mistakes are found.
        let further: Vec<Option<Self>> =
            further.into_iter().map(|written| Self::resolve_one(scope, written, problems)).collect();
        let calibration = calibration.map(|presses| Self::resolve_set(scope, *presses, problems));
        let (first, further) = (first?, further.into_iter().collect::<Option<Vec<Self>>>()?);
        if let Some(problem) = first.find_other_side(&further) {
            problems.push(problem.at(of_face));
            return None;
        }
        let plan = first.with_further_sensors(further);
        match calibration {
            Some(presses) => Some(plan.with_calibration(presses?)),
            None => Some(plan),
        }
    }

    /// Resolves the job with one of its sensors. Errors go to `problems`; after one, `None` is returned.
    fn resolve_one(scope: Scope, written: ParsedJob, problems: &mut Diagnostics) -> Option<Self> {
        let ParsedJob {
            mut job,
            document,
            broken,
            sensor_known,
            other_presets: others,
            right_finger: right,
            further_sensors: _,
            calibration: _,
        } = written;
        if broken {
            return None;
        }
        let mut check = JobChecker { document: &document, problems: &mut *problems };
        // The job's optics count as its own only if they differ from the level's.
        let of_level = job_fidelity(&job).models(job.sensor.light_source()).optics;
        let optics_named = job.optics.as_ref().is_some_and(|own| *own != of_level);
        let shadows_named =
            job.optics.as_ref().is_some_and(|own| document.get(&format!("optics.{}.shadows", own.name())).is_some());
        let sensor_file = job.sensor.file.as_ref().map(|file| document.folder_of("sensor.file").join(file));
        fill_defaults(&mut job);
        gel::read_gel_files(&mut check, &mut job);
        if scope == Scope::Dataset {
            ranges::check_dataset(&mut check, &job);
        }
        if scope == Scope::Frames {
            ranges::check_seed(&mut check, &job);
        }
        ranges::check_sensor(&mut check, &job);
        ranges::check_pad_surface(&mut check, &job);
        if scope == Scope::Dataset {
            ranges::check_pose(&mut check, &job, sensor_known);
            if let Some(gripper) = &job.gripper {
                gripper::check_gripper(&mut check, &job, gripper, right.as_ref().map(|(right, _)| right), sensor_known);
            }
            several_objects::check_scene(&mut check, &job);
        }
        ranges::check_object_effects(&mut check, &job);
        ranges::check_camera(&mut check, &job);
        ranges::check_models(&mut check, &job);
        materials::check_materials(&mut check, &job);
        curved::check_curved_job(&mut check, &job, scope);
        strain::check_strain(&mut check, &job, scope);
        sensor_set::check_sensors(&mut check, &mut job);
        // If units do not differ, their standard deviations do not belong to the job.
        job.sensor.unit = job.sensor.unit.take().filter(|unit| unit.variation != 0.0);
        let sensor = build_sensor(&mut check, &mut job);
        let others = resolve_other_presets(scope, &job, others, check.problems);
        let right = right.and_then(|right| gripper::resolve_right_finger(scope, &job, right, check.problems));
        if let (Some(gripper), Some(right)) = (&mut job.gripper, &right) {
            // Take the right finger's job as it is after its files were read.
            gripper.right = Some(Box::new(right.job.sensor_with_camera()));
            gripper.right_random = right.job.random.clone();
        }
        let mut check = JobChecker { document: &document, problems: &mut *problems };
        let textures = files::load_textures(&mut check, "texture", &mut job.texture);
        let mut notes = Diagnostics::default();
        notes.extend(unused::note_unused_object_keys(&job, &document));
        let found = match scope {
            Scope::Frames => Some((Vec::new(), ObjectSampler::NONE)),
            Scope::Objects => {
                objects::refuse_scaling(&mut check, &job);
                Some((objects::load_objects(&mut check, &mut job, &mut notes).objects, ObjectSampler::NONE))
            }
            Scope::Dataset => {
                let found = objects::load_objects(&mut check, &mut job, &mut notes);
                objects::divide_objects(&mut check, &job, &found).map(|draw| (found.objects, draw))
            }
        };
        // From here on there are no errors.
        let (Some((objects, draw)), Some((sensor, photographs, background_note)), true) =
            (found, sensor, problems.is_empty())
        else {
            return None;
        };
        notes.extend(background_note);
        notes.extend(gel::note_coarse_gel(&job.sensor));
        let has_several_sensors = job.sensors.as_ref().is_some_and(|sensors| sensors.from.len() > 1);
        let whose = match scope {
            Scope::Frames => SensorRole::Frames,
            _ if !others.is_empty() || has_several_sensors => SensorRole::Presets,
            _ => SensorRole::Job,
        };
        notes.extend(notes::collect_job_notes(&job, whose, |key| document.place_of(key)));
        notes.extend(unused::note_unused_keys(&job, &document));
        let others_jobs = others.iter().map(|other| (&other.job, SensorRole::Presets));
        for (other, whose) in others_jobs.chain(right.iter().map(|right| (&right.job, SensorRole::Right))) {
            // What was already noted for another sensor is not repeated.
            let known: Vec<String> = notes.iter().map(|note| note.message.clone()).collect();
            notes.extend(
                notes::collect_job_notes(other, whose, |_| None)
                    .into_iter()
                    .filter(|note| !known.contains(&note.message)),
            );
        }
        let simulator = create_simulator(sensor, chosen_models(&job), job.effects, &job);
        let classes = list_classes(objects.iter().map(|object| object.class.as_str()));
        let sampling =
            SampleSources { objects, classes, object_samplers: draw, textures, moves_objects: job.shear.has_motion() };
        let plan = Self {
            simulator: Arc::new(simulator),
            sensors: Arc::new(SensorSampling::new(&job, photographs)),
            sampling: Arc::new(sampling),
            layout: Layout::from_dataset(&job.dataset),
            fingerprint: compute_fingerprint(&job),
            explains_no_contact: has_no_contact_note(&notes),
            notes: Report::new(&notes, &document.sources),
            sensor_file,
            optics_named,
            shadows_named,
            other_sensors: Vec::new(),
            right_finger: None,
            further_sensors: Vec::new(),
            calibration: None,
            job,
        };
        let right = right.map(|right| Box::new(right.into_plan(&plan)));
        let plan = Self { right_finger: right, ..plan };
        let others = others.into_iter().map(|other| other.into_plan(&plan)).collect();
        Some(Self { other_sensors: others, ..plan })
    }

    /// Returns the job.
    pub fn job(&self) -> &Job {
        &self.job
    }

    /// Formats the job as TOML, with every default written out and absolute paths. A plan of that text renders the same
    /// samples, in any folder.
    pub fn to_toml(&self) -> io::Result<String> {
        let mut job = self.job.clone();
        for path in job.paths_mut() {
            let absolute = std::path::absolute(&path)?.into_os_string().into_string();
            *path = absolute.map_err(|path| io::Error::other(format!("{}: not UTF-8", path.display())))?;
        }
        job.to_toml()
    }

    /// Returns the name of the dataset; empty if there is none.
    pub fn name(&self) -> &str {
        self.job.dataset.name.as_deref().unwrap_or("")
    }

    /// Returns a mesh file that could not be read again when a sample needed it, and why. The samples that were drawn
    /// since then are not those of the job.
    pub fn find_mesh_failure(&self) -> Option<(PathBuf, io::Error)> {
        // All objects share what is known of failures.
        let (path, reason) = self.sampling.objects.first()?.geometry.failure()?;
        Some((path.clone(), io::Error::other(reason.clone())))
    }

    /// Describes which sides of the objects are pressed, or returns `None` if the job says it.
    pub fn pressed_sides(&self) -> Option<String> {
        objects::pressed_sides(&self.sampling.objects)
    }

    /// Returns the seed of all randomness.
    pub fn seed(&self) -> u64 {
        self.job.dataset.seed
    }

    /// Returns the seed of what belongs to the sensor and not to the press.
    pub fn sensor_seed(&self) -> u64 {
        self.job.dataset.sensor_seed.unwrap_or(self.job.dataset.seed)
    }

    /// Returns what is written of a sample.
    pub fn output(&self) -> &Output {
        &self.job.output
    }

    /// Returns the layers to be written, in the order of [`OutputLayer::ALL`].
    pub fn layers(&self) -> Vec<OutputLayer> {
        self.job.output.layers_in_order()
    }

    /// Returns the fidelity level; the most exact one while it is still to be chosen.
    pub fn fidelity(&self) -> Fidelity {
        job_fidelity(&self.job)
    }

    /// Returns the thickness of the pad, mm.
    pub fn thickness_mm(&self) -> f64 {
        self.simulator.sensor().gelpad.thickness_mm
    }

    /// Refuses a job of sequences or of a gripper, for a command `what` that works on single presses.
    ///
    /// # Errors
    ///
    /// If the job is such a one.
    pub fn require_single_presses(&self, what: &str) -> Result<(), Report> {
        self.require_one_sensor(what)?;
        match self.job.sequence {
            None => Ok(()),
            Some(_) => Err(user_error(
                format!("{what} looks at single presses, and the samples of this job are sequences"),
                format!("take a job without it: {}", remedies::suggest_single_presses(&self.job, "[sequence]")),
            )),
        }
    }

    /// Refuses a job of a gripper, for a command `what` that works on one sensor.
    ///
    /// # Errors
    ///
    /// If the job is such a one.
    pub fn require_one_sensor(&self, what: &str) -> Result<(), Report> {
        match self.job.gripper {
            None => Ok(()),
            Some(_) => Err(user_error(
                format!("{what} looks at one sensor, and the samples of this job are held by two"),
                format!("take a job without one: {}", remedies::suggest_single_presses(&self.job, "[gripper]")),
            )),
        }
    }

    /// Refuses a job with several objects in a press, for a command `what` that works on one.
    ///
    /// # Errors
    ///
    /// If the job is such a one.
    pub fn require_single_objects(&self, what: &str) -> Result<(), Report> {
        match self.job.objects_per_sample().max {
            1 => Ok(()),
            _ => Err(user_error(
                format!("{what} looks at the press of one object, and samples of this job have several"),
                "take a job without it: leave [scene] out, or write objects_per_sample = 1 in it",
            )),
        }
    }

    /// Returns the plan of a gripper's right finger. It is this plan, unless that finger has a sensor of its own.
    pub fn right_finger(&self) -> &Self {
        self.right_finger.as_deref().unwrap_or(self)
    }

    /// Returns true if the job needs a gelpad model that solves the contact, for pressures or tractions.
    pub fn solves_contact(&self) -> bool {
        let Job { sensor, sequence, gripper, object, indentation, .. } = &self.job;
        let layers = self.layers();
        let of_contact = [OutputLayer::Pressure, OutputLayer::Flow, OutputLayer::Traction]
            .iter()
            .any(|layer| layers.contains(layer));
        let soft = object.iter().any(|object| object.youngs_modulus_kpa.is_some());
        of_contact
            || soft
            || indentation.force_n.is_some()
            || sensor.shape.is_some()
            || sequence.is_some()
            || gripper.is_some()
    }

    /// Returns the bound by which the job's fidelity level is still to be chosen; `None` if it is chosen.
    pub fn open_fidelity_choice(&self) -> Option<FidelityChoice> {
        self.job.fidelity.filter(|fidelity| fidelity.level().is_none())
    }

    /// Returns the plan for a draw of a sample. It is this plan, unless the job names several presets, of which the
    /// draw gets one.
    pub fn for_sample(&self, index: u64, attempt: u32) -> &Self {
        if self.other_sensors.is_empty() {
            return self;
        }
        let number = random_stream(self.sensor_seed(), "sensor preset", redraw_index(index, attempt))
            .uniform_below(1 + self.other_sensors.len());
        if number == 0 { self } else { &self.other_sensors[number - 1] }
    }

    /// Returns the index of a class, or `None` if the plan does not have it, as for a depth frame without a class.
    pub fn class_index(&self, class: &str) -> Option<usize> {
        self.sampling.classes.binary_search_by(|known| known.as_str().cmp(class)).ok()
    }

    /// Returns the folder where the dataset is written unless the command line names another.
    pub fn default_output(&self) -> PathBuf {
        Path::new("out").join(self.name())
    }
}

/// Builds the sensor of a job with what its files hold. Also returns its photographs, and a note if one was stretched.
/// Returns `None` after an error.
fn build_sensor(check: &mut JobChecker<'_>, job: &mut Job) -> Option<(Sensor, Vec<Photograph>, Option<Diagnostic>)> {
    let backgrounds = files::load_backgrounds(check, job);
    let calibration = files::load_calibration(check, job);
    let rest_surface = files::load_rest_surface(check, job);
    let (photographs, note) = backgrounds?;
    let mut sensor = job.sensor_without_files();
    (sensor.calibration, sensor.rest_surface) = (calibration.map(Arc::new), rest_surface);
    if let Some(photograph) = photographs.first() {
        sensor.background = Background::Photograph(Arc::clone(&photograph.image));
    }
    Some((sensor, photographs, note))
}

/// Returns true if one of a job's notes says why its samples may touch nothing.
fn has_no_contact_note(notes: &Diagnostics) -> bool {
    notes.iter().any(|note| note.consequence == Some(Consequence::NoContact))
}

/// Fills in the defaults that depend on other keys.
fn fill_defaults(job: &mut Job) {
    job.fidelity.get_or_insert(Fidelity::default().into());
    let models = job_fidelity(job).models(job.sensor.light_source());
    job.gelpad.get_or_insert(models.gelpad);
    job.optics.get_or_insert(models.optics);
    job.sensor.preset = None;
    job.sensor.file = None;
    // These were merged under the job's own tables when the job was read.
    job.sensor.markers = None;
    job.sensor.camera = None;
}

/// Lists class names in the order of their `class_index`.
pub fn list_classes<'a>(of_objects: impl Iterator<Item = &'a str>) -> Vec<String> {
    let names: BTreeSet<&str> = of_objects.collect();
    names.into_iter().map(str::to_owned).collect()
}

/// Returns the fidelity level of a job; the most exact one while it is still to be chosen.
pub fn job_fidelity(job: &Job) -> Fidelity {
    job.fidelity.map_or(Fidelity::default(), |fidelity| fidelity.level().unwrap_or(Fidelity::Reference))
}

/// Returns true if a layer shows how friction moves or pulls the pad along its surface.
pub(crate) fn shows_motion(layers: &[OutputLayer]) -> bool {
    layers.iter().any(|layer| matches!(layer, OutputLayer::Flow | OutputLayer::Traction))
}

/// Creates the simulator for the layers that a job needs.
fn create_simulator(sensor: Sensor, models: Models, policy: EffectPolicy, job: &Job) -> Simulator {
    let simulator = Simulator::with_models(sensor, models, policy);
    if shows_motion(&job.output.layers) { simulator.with_flow() } else { simulator }
}

fn chosen_models(job: &Job) -> Models {
    let models = job_fidelity(job).models(job.sensor.light_source());
    Models { gelpad: job.gelpad.clone().unwrap_or(models.gelpad), optics: job.optics.clone().unwrap_or(models.optics) }
}

/// Returns the view of a job's sensor.
pub fn sensor_view(job: &Job) -> View {
    job.sensor_without_files().view()
}
