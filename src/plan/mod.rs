//! From job to plan: defaults, presets, files and tables resolved, every mistake found.
//!
//! After this nothing that depends on what the user wrote can fail: stages get a [`Plan`] and never see the job.

use std::collections::BTreeSet;
use std::io;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use sha2::{Digest, Sha256};

use crate::camera::{self, Shot, print::Markers};
use crate::config::diagnostic::{Problem, Problems, Report};
use crate::config::output::{Exr, Layer};
use crate::config::quantity::Quantity;
use crate::config::{self, Job, Overrides, Written, scene};
use crate::dataset::layout::Layout;
use crate::depth::Camera;
use crate::depth::relief::Relief;
use crate::depth::texture::Texture;
use crate::effects::{Effect, Gate};
use crate::fidelity::{Choices, Fidelity, Rung};
use crate::gelpad::elastic::LARGEST_STRAIN;
use crate::gelpad::elastic::inplane::InPlane;
use crate::gelpad::rest;
use crate::grid::Grid;
use crate::health::OnUnhealthy;
use crate::optics::background::Reference;
use crate::optics::calibrated::Table;
use crate::{gelpad, optics};

pub mod check;
mod files;
pub mod frames;
mod objects;
pub mod ranges;
pub mod standalone;

use check::Check;
pub use objects::{Draw, Object, ids, stem};

/// Everything a sample depends on, resolved and checked.
pub struct Plan {
    /// The job with every default written out; paths are absolute here.
    pub job: Job,
    /// SHA-256 over all that decides the bytes of a sample; paths are not part of it, contents are.
    pub fingerprint: String,
    /// Name of the dataset.
    pub name: String,
    /// Seed of all randomness.
    pub seed: u64,
    /// Samples, splits and shards.
    pub layout: Layout,
    /// View and pixel pitch.
    pub camera: Camera,
    /// Thickness of the pad, mm.
    pub thickness_mm: f64,
    /// The background: what is seen of the untouched pad before any model adds to it.
    pub reference: Reference,
    /// What was measured on the sensor, if anything was.
    pub calibration: Option<Table>,
    /// The objects, in the order of the job.
    pub objects: Arc<[Object]>,
    /// The texture's patterns; none if no sample has a texture.
    pub textures: Arc<[Relief]>,
    /// How far a curved pad lies below its highest point, mm, on the grid of [`gelpad::Contact::surface`].
    pub drop_mm: Option<Grid<f32>>,
    /// Class names, sorted; an object's `class_index` counts here.
    pub classes: Vec<String>,
    /// For each of [`crate::dataset::layout::Split::ALL`]: how its objects are drawn.
    pub draw: [Draw; 3],
    /// Laws of the pose.
    pub pose: scene::Pose,
    /// Law of the indentation depth, mm.
    pub indentation_mm: Quantity,
    /// Share of samples without contact.
    pub no_contact: f64,
    /// Laws of the texture.
    pub texture: Texture,
    /// Laws of the object's motion in the pad's plane.
    pub shear: scene::Shear,
    /// Laws of the print on the pad; none if it has none, or is to be left out.
    pub markers: Option<Markers>,
    /// Laws of the camera.
    pub settings: camera::Settings,
    /// Rung of the accuracy ladder. While it is still to be chosen, the most exact one.
    pub rung: Rung,
    /// The models that were chosen.
    pub models: Choices,
    /// The job itself names its model of the light, which then stays whatever rung is tried.
    pub optics_named: bool,
    /// The models, made ready.
    pub ready: Ready,
    /// Which effects run.
    pub gate: Gate,
    /// Layers to be written, in the order of [`Layer::ALL`].
    pub layers: Vec<Layer>,
    /// How float layers are stored.
    pub exr: Exr,
    /// What becomes of an unhealthy sample.
    pub on_unhealthy: OnUnhealthy,
    /// Things the user should know that are no mistakes.
    pub notes: Vec<String>,
    /// The sensor file that the job names, for messages: what is in it is in the job.
    pub sensor_file: Option<PathBuf>,
}

/// The models of a plan, made ready: everything that is the same for every sample.
pub struct Ready {
    /// The gelpad.
    pub pad: gelpad::Pad,
    /// In-plane motion of the pad, where markers show it.
    pub in_plane: Option<InPlane>,
    /// The light.
    pub shader: optics::Shader,
    /// The camera.
    pub body: camera::Body,
}

/// What the models are made from beside the job: contents of the files that it names.
struct Files<'a> {
    reference: &'a Reference,
    calibration: Option<&'a Table>,
    drop_mm: Option<&'a Grid<f32>>,
}

impl Ready {
    fn new(job: &Job, models: &Choices, view: &Camera, files: &Files<'_>) -> Self {
        let sensor = &job.sensor;
        let pad = gelpad::Pad::new(&models.gelpad, sensor, view);
        let relief = match job.effects {
            Gate::Without(Effect::Grain) => None,
            Gate::Without(Effect::RestShape) => rest::relief(None, sensor.grain.as_ref(), view),
            _ => rest::relief(files.drop_mm, sensor.grain.as_ref(), view),
        };
        let shader = optics::Shader::new(&models.optics, files.calibration, sensor, view, relief);
        let printed = printed(job);
        let in_plane = printed.and_then(|_| pad.in_plane(sensor, view));
        let print = printed.and_then(|markers| Some(markers.ink(&markers.constant()?, None, view)));
        let resting = Shot::resting(&job.camera).gated(job.effects);
        let body =
            camera::Body::new(view, shader.untouched(files.reference), sensor.background.is_some(), resting, print);
        Self { pad, in_plane, shader, body }
    }
}

impl Plan {
    /// Reads and resolves the job file at `path`. On failure, every mistake found in it.
    pub fn load(path: &Path, overrides: &Overrides) -> Result<Self, Report> {
        let mut problems = Problems::default();
        let written = config::read(path, overrides, &mut problems)?;
        Self::resolve(written, problems)
    }

    /// Reads and resolves a job from text; relative paths in it start from `folder`, and messages call it `name`.
    pub fn read(name: &str, text: String, folder: &Path, overrides: &Overrides) -> Result<Self, Report> {
        let mut problems = Problems::default();
        let written = config::read_text(name, text, folder, overrides, &mut problems);
        Self::resolve(written, problems)
    }

    /// Its job as text, with every default written out and absolute paths: a plan of that text renders the same, in any
    /// folder.
    pub fn to_toml(&self) -> io::Result<String> {
        let mut job = self.job.clone();
        for path in job.paths_mut() {
            let absolute = std::path::absolute(&path)?.into_os_string().into_string();
            *path = absolute.map_err(|path| io::Error::other(format!("{}: not UTF-8", path.display())))?;
        }
        toml::to_string(&job).map_err(io::Error::other)
    }

    /// Resolves a job that was read; `problems` holds the mistakes of form found while reading.
    pub fn resolve(written: Written, problems: Problems) -> Result<Self, Report> {
        Self::resolve_with(written, problems, |check, job, notes| {
            let found = objects::load(check, job, notes);
            let draw = objects::divide(check, job, &found)?;
            Some((found.objects, draw))
        })
    }

    /// The same with objects, and how they are drawn, from elsewhere than the job.
    fn resolve_with(
        written: Written,
        mut problems: Problems,
        objects: impl FnOnce(&mut Check<'_>, &mut Job, &mut Vec<String>) -> Option<(Vec<Object>, [Draw; 3])>,
    ) -> Result<Self, Report> {
        let Written { mut job, document, broken, sensor_known } = written;
        if broken {
            return Err(Report::new(&problems, &document.sources));
        }
        let mut check = Check { document: &document, problems: &mut problems };
        let optics_named = job.optics.is_some();
        let sensor_file = job.sensor.file.as_ref().map(|file| document.folder("sensor.file").join(file));
        fill(&mut job);
        ranges::dataset(&mut check, &job);
        ranges::sensor(&mut check, &job);
        ranges::pad_surface(&mut check, &job);
        ranges::scene(&mut check, &job, sensor_known);
        ranges::object_effects(&mut check, &job);
        ranges::camera(&mut check, &job);
        ranges::models(&mut check, &job);
        let reference = files::background(&mut check, &mut job);
        let calibration = files::calibration(&mut check, &mut job);
        let textures = files::textures(&mut check, &mut job);
        let drop_mm = files::drop_mm(&mut check, &mut job);
        let mut notes = Vec::new();
        let found = objects(&mut check, &mut job, &mut notes);
        let (Some((objects, draw)), Some((reference, reference_note)), true) = (found, reference, problems.is_empty())
        else {
            return Err(Report::new(&problems, &document.sources));
        };
        let objects: Arc<[Object]> = objects.into();
        notes.extend(reference_note);
        notes.extend(strain_note(&job));
        let models = chosen_models(&job);
        let camera = view(&job);
        let files = Files { reference: &reference, calibration: calibration.as_ref(), drop_mm: drop_mm.as_ref() };
        let ready = Ready::new(&job, &models, &camera, &files);
        Ok(Self {
            fingerprint: fingerprint(&job),
            name: job.dataset.name.clone().unwrap_or_default(),
            seed: job.dataset.seed,
            layout: Layout::of(&job.dataset),
            camera,
            thickness_mm: job.sensor.gelpad_thickness_mm,
            reference,
            calibration,
            textures: textures.into(),
            drop_mm,
            classes: classes(objects.iter().map(|object| object.class.as_str())),
            objects,
            draw,
            pose: job.pose.clone(),
            indentation_mm: job.indentation.depth_mm.clone().unwrap_or_default(),
            no_contact: job.indentation.no_contact,
            texture: job.texture.clone(),
            shear: job.shear.clone(),
            markers: printed(&job).cloned(),
            settings: job.camera.clone(),
            rung: rung(&job),
            models,
            optics_named,
            ready,
            layers: job.output.layers_in_order(),
            exr: job.output.exr,
            on_unhealthy: job.output.on_unhealthy,
            notes,
            sensor_file,
            gate: job.effects,
            job,
        })
    }

    /// The bound by which the job's rung is still to be chosen.
    pub fn open_choice(&self) -> Option<Fidelity> {
        self.job.fidelity.filter(|fidelity| fidelity.rung().is_none())
    }

    /// The same with other models under the same rung's name, for comparisons.
    pub fn with_models(&self, models: Choices) -> Self {
        self.with(self.job.clone(), self.rung, models)
    }

    /// The same with other effects, for comparisons.
    pub fn with_gate(&self, gate: Gate) -> Self {
        let mut job = self.job.clone();
        job.effects = gate;
        self.with(job, self.rung, self.models.clone())
    }

    /// The same with the models of `rung`, whatever gelpad the job chose; a light that the job names stays.
    pub fn at(&self, rung: Rung) -> Self {
        let mut models = rung.choices(self.calibration.is_some());
        if self.optics_named {
            models.optics = self.models.optics.clone();
        }
        let mut job = self.job.clone();
        job.fidelity = Some(rung.into());
        job.gelpad = Some(models.gelpad.clone());
        job.optics = Some(models.optics.clone());
        self.with(job, rung, models)
    }

    fn with(&self, job: Job, rung: Rung, models: Choices) -> Self {
        let files = Files {
            reference: &self.reference,
            calibration: self.calibration.as_ref(),
            drop_mm: self.drop_mm.as_ref(),
        };
        Self {
            ready: Ready::new(&job, &models, &self.camera, &files),
            fingerprint: fingerprint(&job),
            name: self.name.clone(),
            seed: self.seed,
            layout: self.layout.clone(),
            camera: self.camera,
            thickness_mm: self.thickness_mm,
            reference: self.reference.clone(),
            objects: Arc::clone(&self.objects),
            textures: Arc::clone(&self.textures),
            calibration: self.calibration.clone(),
            drop_mm: self.drop_mm.clone(),
            classes: self.classes.clone(),
            draw: self.draw.clone(),
            pose: self.pose.clone(),
            indentation_mm: self.indentation_mm.clone(),
            no_contact: self.no_contact,
            texture: self.texture.clone(),
            shear: self.shear.clone(),
            markers: printed(&job).cloned(),
            settings: self.settings.clone(),
            rung,
            models,
            optics_named: self.optics_named,
            layers: self.layers.clone(),
            exr: self.exr,
            on_unhealthy: self.on_unhealthy,
            notes: self.notes.clone(),
            sensor_file: self.sensor_file.clone(),
            gate: job.effects,
            job,
        }
    }

    /// Number of a class in [`Plan::classes`].
    pub fn class_index(&self, class: &str) -> usize {
        self.classes.binary_search_by(|known| known.as_str().cmp(class)).unwrap_or_default()
    }

    /// Where the dataset goes unless the command line says otherwise.
    pub fn default_output(&self) -> PathBuf {
        Path::new("out").join(&self.name)
    }
}

/// The print on the pad, unless it is to be left out.
fn printed(job: &Job) -> Option<&Markers> {
    job.markers.as_ref().filter(|_| job.effects != Gate::Without(Effect::Markers))
}

/// Writes out the defaults that depend on other keys.
fn fill(job: &mut Job) {
    job.fidelity.get_or_insert(Rung::default().into());
    let choices = rung(job).choices(job.sensor.calibration.is_some());
    job.gelpad.get_or_insert(choices.gelpad);
    job.optics.get_or_insert(choices.optics);
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

/// The rung of a job; the most exact one while it is still to be chosen.
pub fn rung(job: &Job) -> Rung {
    job.fidelity.map_or(Rung::default(), |fidelity| fidelity.rung().unwrap_or(Rung::Reference))
}

fn chosen_models(job: &Job) -> Choices {
    let choices = rung(job).choices(job.sensor.calibration.is_some());
    Choices {
        gelpad: job.gelpad.clone().unwrap_or(choices.gelpad),
        optics: job.optics.clone().unwrap_or(choices.optics),
    }
}

/// View and pixel pitch of a job's sensor.
pub fn view(job: &Job) -> Camera {
    let resolution_px = job.sensor.resolution_px.map(|px| px as usize);
    let mm_per_px = std::array::from_fn(|k| job.sensor.field_of_view_mm[k] / resolution_px[k].max(1) as f64);
    Camera { resolution_px, mm_per_px }
}

/// A word of warning where the elastic pad is pressed beyond what its theory holds for.
fn strain_note(job: &Job) -> Option<String> {
    let deepest = job.indentation.depth_mm.as_ref()?.support().1;
    let thickness = job.sensor.gelpad_thickness_mm;
    let elastic = matches!(chosen_models(job).gelpad, gelpad::Model::Elastic(_));
    (elastic && deepest > LARGEST_STRAIN * thickness).then(|| {
        format!(
            "indentation.depth_mm may be {deepest}, over half of the pad's {thickness} mm: linear elasticity does not hold \
             there; such samples have numerics.beyond_theory in their labels"
        )
    })
}

/// SHA-256 over the resolved job and the generator's version. Of a mesh's path only the name counts, which is the
/// object's in the labels; contents are known by their hashes. The number of samples decides no sample's bytes, so that
/// it may be raised later.
pub fn fingerprint(job: &Job) -> String {
    let mut job = job.clone();
    job.dataset.samples = None;
    let meshes = job.object.iter().map(|object| object.path.as_deref().map(stem)).collect::<Vec<_>>();
    job.paths_mut().for_each(String::clear);
    for (object, stem) in job.object.iter_mut().zip(meshes) {
        object.path = stem;
    }
    let text = serde_json::to_string(&job).unwrap_or_default();
    hex(&Sha256::digest(format!("gelsim {}\n{text}", env!("CARGO_PKG_VERSION")).as_bytes()))
}

/// Lower-case hex.
pub fn hex(bytes: &[u8]) -> String {
    bytes.iter().map(|byte| format!("{byte:02x}")).collect()
}

/// A mistake found outside the job's text, such as in a flag.
pub fn usage(message: impl Into<String>, help: impl Into<String>) -> Report {
    let mut problems = Problems::default();
    problems.push(Problem::new(message).help(help));
    Report::new(&problems, &[])
}
