//! From job to plan: defaults, presets, files and tables resolved, every mistake found.
//!
//! After this nothing that depends on what the user wrote can fail: stages get a [`Plan`] and never see the job.

use std::path::{Path, PathBuf};
use std::sync::Arc;

use sha2::{Digest, Sha256};

use crate::config::diagnostic::{Problem, Problems, Report};
use crate::config::output::{Exr, Layer};
use crate::config::quantity::Quantity;
use crate::config::{self, Job, Overrides, Written, scene};
use crate::dataset::layout::Layout;
use crate::depth::Camera;
use crate::fidelity::{Choices, Fidelity, Rung};
use crate::gelpad::elastic::LARGEST_STRAIN;
use crate::optics::background::Reference;
use crate::{camera, gelpad, optics};

mod check;
mod objects;

use check::Check;
pub use objects::{Draw, Object, stem};

/// Everything a sample depends on, resolved and checked.
pub struct Plan {
    /// The job with every default written out; paths are absolute here.
    pub job: Job,
    /// SHA-256 over all that decides the bytes of the dataset; paths are not part of it, contents are.
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
    /// Row-major RGB of a sample without contact: the background, unless the model of the light adds to a flat pad.
    pub untouched: Vec<u8>,
    /// The objects, in the order of the job.
    pub objects: Arc<[Object]>,
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
    /// Rung of the accuracy ladder. While it is still to be chosen, the most exact one.
    pub rung: Rung,
    /// The models that were chosen.
    pub models: Choices,
    /// The job itself names its model of the light, which then stays whatever rung is tried.
    pub optics_named: bool,
    /// Model of the gelpad, made ready.
    pub pad: gelpad::Pad,
    /// Model of the light, made ready.
    pub shader: optics::Shader,
    /// Layers to be written, in the order of [`Layer::ALL`].
    pub layers: Vec<Layer>,
    /// How float layers are stored.
    pub exr: Exr,
    /// Things the user should know that are no mistakes.
    pub notes: Vec<String>,
}

impl Plan {
    /// Reads and resolves the job file at `path`. On failure, every mistake found in it.
    pub fn load(path: &Path, overrides: &Overrides) -> Result<Self, Report> {
        let mut problems = Problems::default();
        let written = config::read(path, overrides, &mut problems)?;
        Self::resolve(written, problems)
    }

    /// Resolves a job that was read; `problems` holds the mistakes of form found while reading.
    pub fn resolve(written: Written, mut problems: Problems) -> Result<Self, Report> {
        let Written { mut job, document, broken, sensor_known } = written;
        if broken {
            return Err(Report::new(&problems, &document.sources));
        }
        let mut check = Check { document: &document, problems: &mut problems };
        let optics_named = job.optics.is_some();
        fill(&mut job);
        check_dataset(&mut check, &job);
        check_sensor(&mut check, &job);
        check_scene(&mut check, &job, sensor_known);
        check_models(&mut check, &job);
        let reference = resolve_background(&mut check, &mut job);
        let mut notes = Vec::new();
        let found = objects::load(&mut check, &mut job, &mut notes);
        let layout = Layout::new(job.dataset.samples.unwrap_or(1), job.dataset.samples_per_shard, job.dataset.splits);
        let draw = objects::divide(&mut check, &job, &found);
        let objects: Arc<[Object]> = found.objects.into();
        let (Some(draw), Some((reference, reference_note)), true) = (draw, reference, problems.is_empty()) else {
            return Err(Report::new(&problems, &document.sources));
        };
        notes.extend(reference_note);
        notes.extend(strain_note(&job));
        let models = chosen_models(&job);
        let camera = view(&job);
        let pad = gelpad::Pad::new(&models.gelpad, &job.sensor, &camera);
        let shader = optics::Shader::new(&models.optics, &job.sensor, &camera);
        let mut classes: Vec<String> = objects.iter().map(|object| object.class.clone()).collect();
        classes.sort();
        classes.dedup();
        let mut layers = job.output.layers.clone();
        layers.sort();
        layers.dedup();
        Ok(Self {
            fingerprint: fingerprint(&job),
            name: job.dataset.name.clone().unwrap_or_default(),
            seed: job.dataset.seed,
            layout,
            camera,
            thickness_mm: job.sensor.gelpad_thickness_mm,
            untouched: untouched(&shader, &camera, &reference),
            reference,
            objects,
            classes,
            draw,
            pose: job.pose.clone(),
            indentation_mm: job.indentation.depth_mm.clone().unwrap_or_default(),
            no_contact: job.indentation.no_contact,
            rung: rung(&job),
            models,
            optics_named,
            pad,
            shader,
            layers,
            exr: job.output.exr,
            notes,
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

    /// The same with the models of `rung`, whatever gelpad the job chose; a light that the job names stays.
    pub fn at(&self, rung: Rung) -> Self {
        let mut models = rung.choices();
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
        let pad = gelpad::Pad::new(&models.gelpad, &job.sensor, &self.camera);
        let shader = optics::Shader::new(&models.optics, &job.sensor, &self.camera);
        Self {
            fingerprint: fingerprint(&job),
            name: self.name.clone(),
            seed: self.seed,
            layout: self.layout.clone(),
            camera: self.camera,
            thickness_mm: self.thickness_mm,
            untouched: untouched(&shader, &self.camera, &self.reference),
            reference: self.reference.clone(),
            objects: Arc::clone(&self.objects),
            classes: self.classes.clone(),
            draw: self.draw.clone(),
            pose: self.pose.clone(),
            indentation_mm: self.indentation_mm.clone(),
            no_contact: self.no_contact,
            rung,
            models,
            optics_named: self.optics_named,
            pad,
            shader,
            layers: self.layers.clone(),
            exr: self.exr,
            notes: self.notes.clone(),
            job,
        }
    }

    /// Number of an object's class in [`Plan::classes`].
    pub fn class_index(&self, object: &Object) -> usize {
        self.classes.binary_search(&object.class).unwrap_or_default()
    }

    /// Where the dataset goes unless the command line says otherwise.
    pub fn default_output(&self) -> PathBuf {
        Path::new("out").join(&self.name)
    }
}

/// Writes out the defaults that depend on other keys.
fn fill(job: &mut Job) {
    job.fidelity.get_or_insert(Rung::default().into());
    let choices = rung(job).choices();
    job.gelpad.get_or_insert(choices.gelpad);
    job.optics.get_or_insert(choices.optics);
    job.sensor.preset = None;
    job.sensor.file = None;
}

/// The rung of a job; the most exact one while it is still to be chosen.
fn rung(job: &Job) -> Rung {
    job.fidelity.map_or(Rung::default(), |fidelity| fidelity.rung().unwrap_or(Rung::Reference))
}

fn chosen_models(job: &Job) -> Choices {
    let choices = rung(job).choices();
    Choices {
        gelpad: job.gelpad.clone().unwrap_or(choices.gelpad),
        optics: job.optics.clone().unwrap_or(choices.optics),
    }
}

/// What the camera sees without contact.
fn untouched(shader: &optics::Shader, camera: &Camera, reference: &Reference) -> Vec<u8> {
    let [width, height] = camera.resolution_px;
    let flat = gelpad::untouched(width, height, None, gelpad::Numerics::DIRECT);
    camera::expose(&shader.shade(&flat, reference), reference).rgb
}

fn view(job: &Job) -> Camera {
    let resolution_px = job.sensor.resolution_px.map(|px| px as usize);
    let mm_per_px = std::array::from_fn(|k| job.sensor.field_of_view_mm[k] / resolution_px[k].max(1) as f64);
    Camera { resolution_px, mm_per_px }
}

fn check_dataset(check: &mut Check<'_>, job: &Job) {
    let dataset = &job.dataset;
    match &dataset.name {
        None => check.missing("dataset.name", "for example name = \"quickstart\""),
        Some(name) => {
            let plain = |c: char| c.is_ascii_alphanumeric() || matches!(c, '-' | '_' | '.');
            if name.is_empty() || name.len() > 100 || name.starts_with('.') || !name.chars().all(plain) {
                check.wrong(
                    "dataset.name",
                    format!("{name:?} cannot be the name of a dataset"),
                    "use 1 to 100 letters, digits, `-`, `_` and `.`, not starting with `.`",
                );
            }
        }
    }
    match dataset.samples {
        None => check.missing("dataset.samples", "for example samples = 200"),
        Some(samples) => check.number("dataset.samples", samples as f64, 1.0..=1e9, "samples"),
    }
    check.number("dataset.seed", dataset.seed as f64, 0.0..=9_007_199_254_740_991.0, "");
    check.number("dataset.samples_per_shard", dataset.samples_per_shard as f64, 1.0..=1e6, "samples");
    let shards = dataset.samples.unwrap_or(0).div_ceil(dataset.samples_per_shard.max(1));
    if (1_000_000..=1_000_000_000).contains(&shards) {
        let message = format!("{shards} shards are too many: their names count to 999999");
        check.wrong("dataset.samples_per_shard", message, "raise samples_per_shard");
    }
    let splits = dataset.splits;
    for (name, share) in [("train", splits.train), ("val", splits.val), ("test", splits.test)] {
        check.number(&format!("dataset.splits.{name}"), share, 0.0..=1.0, "");
    }
    let sum = splits.train + splits.val + splits.test;
    if (sum - 1.0).abs() > 1e-9 && check.sound("dataset.splits") {
        check.wrong("dataset.splits", format!("the splits sum to {sum}"), "train, val and test must sum to 1");
    }
}

fn check_sensor(check: &mut Check<'_>, job: &Job) {
    let sensor = &job.sensor;
    for k in 0..2 {
        check.number(&format!("sensor.resolution_px.{k}"), f64::from(sensor.resolution_px[k]), 1.0..=8192.0, "px");
        check.number(&format!("sensor.field_of_view_mm.{k}"), sensor.field_of_view_mm[k], 1e-3..=1e4, "mm");
    }
    check.number("sensor.gelpad_thickness_mm", sensor.gelpad_thickness_mm, 1e-2..=1e3, "mm");
    check.number("sensor.gelpad_youngs_modulus_kpa", sensor.gelpad_youngs_modulus_kpa, 1e-3..=1e9, "kPa");
    check.number("sensor.gelpad_poisson_ratio", sensor.gelpad_poisson_ratio, 0.0..=0.4999, "");
    if sensor.name.is_empty() {
        check.wrong("sensor.name", "the sensor's name is empty", "for example name = \"my-sensor\"");
    }
    let look = &sensor.rendered_background;
    for k in 0..3 {
        check.number(&format!("sensor.rendered_background.color.{k}"), look.color[k], 0.0..=1.0, "");
    }
    check.number("sensor.rendered_background.glow", look.glow, 0.0..=10.0, "");
    check.number("sensor.rendered_background.glow_reach_mm", look.glow_reach_mm, 1e-3..=1e6, "mm");
    check.number("sensor.rendered_background.vignette", look.vignette, 0.0..=1.0, "");
    check.number("sensor.rendered_background.grain", look.grain, 0.0..=1.0, "");
    check.number("sensor.rendered_background.grain_size_mm", look.grain_size_mm, 1e-3..=1e3, "mm");
    if sensor.led.is_empty() {
        check.wrong("sensor.led", "the sensor has no LED", "add at least one [[sensor.led]] table");
    }
    for (i, led) in sensor.led.iter().enumerate() {
        let path = |key: &str| format!("sensor.led.{i}.{key}");
        check.number(&path("azimuth_deg"), led.azimuth_deg, -3600.0..=3600.0, "degrees");
        check.number(&path("elevation_deg"), led.elevation_deg, 0.0..=90.0, "degrees");
        check.number(&path("intensity"), led.intensity, 0.0..=100.0, "");
        for k in 0..3 {
            check.number(&path(&format!("color.{k}")), led.color[k], 0.0..=1.0, "");
        }
    }
}

fn check_scene(check: &mut Check<'_>, job: &Job, sensor_known: bool) {
    let pose = &job.pose;
    check.quantity("pose.yaw_deg", &pose.yaw_deg, -3600.0..=3600.0, "degrees");
    check.quantity("pose.tilt_deg", &pose.tilt_deg, -90.0..=90.0, "degrees");
    check.quantity("pose.tilt_azimuth_deg", &pose.tilt_azimuth_deg, -3600.0..=3600.0, "degrees");
    check.quantity("pose.x_mm", &pose.x_mm, -1e4..=1e4, "mm");
    check.quantity("pose.y_mm", &pose.y_mm, -1e4..=1e4, "mm");
    match &job.indentation.depth_mm {
        None => check.missing("indentation.depth_mm", "for example depth_mm = [0.2, 1.5] under [indentation]"),
        Some(depth) if sensor_known && check.sound("sensor.gelpad_thickness_mm") => {
            let thickness = job.sensor.gelpad_thickness_mm;
            check.quantity("indentation.depth_mm", depth, 0.0..=thickness, "mm, the thickness of the gelpad");
            if depth.support().1 == thickness {
                let message = format!("depth_mm may be {thickness}, which presses the pad flat to the shell");
                check.wrong("indentation.depth_mm", message, format!("stay below the pad's thickness, {thickness} mm"));
            }
        }
        // The thickness is not known.
        Some(depth) => check.quantity("indentation.depth_mm", depth, 0.0..=1e3, "mm"),
    }
    check.number("indentation.no_contact", job.indentation.no_contact, 0.0..=1.0, "");
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

fn check_models(check: &mut Check<'_>, job: &Job) {
    match job.fidelity {
        Some(Fidelity::MaxErrorUm(um)) => check.number("fidelity.max_error_um", um, 1e-3..=1e5, "um"),
        Some(Fidelity::MaxMs(ms)) => check.number("fidelity.max_ms", ms, 1e-3..=1e6, "ms"),
        _ => {}
    }
    if job.fidelity.is_some_and(|fidelity| fidelity.rung().is_none()) && check.document.get("gelpad").is_some() {
        let message = "`gelpad` leaves nothing to choose for `fidelity`";
        check.wrong("gelpad", message, "leave `gelpad` out, or name a rung in `fidelity`");
    }
    let Choices { gelpad, optics } = chosen_models(job);
    match &gelpad {
        gelpad::Model::None(_) => {}
        gelpad::Model::MeanBlur(blur) => {
            check.odd("gelpad.mean_blur.kernel_px", blur.kernel_px);
            check.number("gelpad.mean_blur.passes", f64::from(blur.passes), 0.0..=64.0, "");
        }
        gelpad::Model::Gaussian(gaussian) => {
            for (i, width) in gaussian.kernels_px.iter().enumerate() {
                check.odd(&format!("gelpad.gaussian.kernels_px.{i}"), *width);
            }
            if gaussian.kernels_px.len() > 8 {
                let message = format!("{} blurs are too many", gaussian.kernels_px.len());
                check.wrong("gelpad.gaussian.kernels_px", message, "allowed: up to 8");
            }
            check.odd("gelpad.gaussian.smoothing_px", gaussian.smoothing_px);
        }
        gelpad::Model::Elastic(elastic) => {
            check.number("gelpad.elastic.tolerance_um", elastic.tolerance_um, 0.01..=1e3, "um");
            let most = f64::from(elastic.max_iterations);
            check.number("gelpad.elastic.max_iterations", most, 1.0..=1e4, "iterations");
        }
    }
    match &optics {
        optics::Model::Phong(phong) => {
            check.number("optics.phong.ambient", phong.ambient, 0.0..=1.0, "");
            check.number("optics.phong.diffuse", phong.diffuse, 0.0..=10.0, "");
            check.number("optics.phong.specular", phong.specular, 0.0..=10.0, "");
            check.number("optics.phong.shininess", phong.shininess, 0.0..=1000.0, "");
            check.number("optics.phong.darkening", phong.darkening, 0.0..=1.0, "");
        }
    }
    for (i, layer) in job.output.layers.iter().enumerate() {
        let path = format!("output.layers.{i}");
        match layer {
            Layer::Markers => check.wrong(&path, "this sensor has no printed markers", "leave `markers` out"),
            layer if !gelpad.gives(*layer) => {
                let message = format!("the gelpad model `{}` knows no pressure", gelpad.name());
                check.wrong(&path, message, "leave `pressure` out, or choose a model that solves the contact");
            }
            _ => {}
        }
    }
}

/// The untouched pad's picture, and a note where a photograph was resampled. `None` after a mistake.
fn resolve_background(check: &mut Check<'_>, job: &mut Job) -> Option<(Reference, Option<String>)> {
    let camera = view(job);
    let [width, height] = camera.resolution_px;
    let sizes = [width, height].iter().all(|size| (1..=8192).contains(size));
    let Some(written) = job.sensor.background.clone() else {
        let sound = sizes && check.problems.is_empty();
        return sound.then(|| (Reference::rendered(&job.sensor, &camera), None));
    };
    let path = check.document.folder("sensor.background").join(&written);
    let image = std::fs::read(&path).map_err(|error| error.to_string()).and_then(|bytes| {
        let sha256 = hex(&Sha256::digest(&bytes));
        crate::dataset::png::decode_rgb(&bytes).map(|image| (image, sha256))
    });
    let (image, sha256) = match image {
        Ok(found) => found,
        Err(reason) => {
            let message = format!("cannot read the background {}: {reason}", path.display());
            check.wrong("sensor.background", message, "an 8-bit PNG of the untouched pad belongs here");
            return None;
        }
    };
    if let Some(expected) = &job.sensor.background_sha256
        && *expected != sha256
    {
        let message = format!("the background {} has changed: its SHA-256 is {sha256}", path.display());
        check.wrong("sensor.background_sha256", message, "restore the file, or remove this key");
    }
    job.sensor.background = Some(path.to_string_lossy().into_owned());
    job.sensor.background_sha256 = Some(sha256);
    if !sizes {
        return None;
    }
    let size = (width as u32, height as u32);
    let note = (image.dimensions() != size).then(|| {
        let (w, h) = image.dimensions();
        format!("{}: {w}x{h} px, resampled to the sensor's {width}x{height} px", path.display())
    });
    let image = match note {
        Some(_) => image::imageops::resize(&image, size.0, size.1, image::imageops::FilterType::Triangle),
        None => image,
    };
    Some((Reference::new(width, height, image.into_raw()), note))
}

/// SHA-256 over the resolved job and the generator's version. Of a mesh's path only the name counts, which is the
/// object's in the labels; contents are known by their hashes.
fn fingerprint(job: &Job) -> String {
    let mut job = job.clone();
    job.sensor.background = None;
    for object in &mut job.object {
        object.path = object.path.as_deref().map(stem);
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
