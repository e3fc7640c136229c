//! The sensors of a job that presses its objects into several: each has a plan, and a dataset, of its own.

use std::collections::HashSet;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use super::check::JobChecker;
use super::fingerprint::compute_fingerprint;
use super::sensors::{DrawnSensor, SensorSampling};
use super::{Photograph, Plan};
use crate::config::Job;
use crate::config::output::OnUnhealthy;
use gelsim_core::base::rng::random_stream;
use gelsim_core::sensor::Background;
use gelsim_core::simulator::Simulator;
use gelsim_files::diagnostic::{Diagnostic, Report};
use gelsim_files::hash::sha256;

/// Most units of a sensor.
const MAX_UNITS: u32 = 1000;

/// Largest seed: readers of JSON may take it for a float.
const MAX_SEED: u64 = (1 << 53) - 1;

/// Folder of the calibration presses in that of the set.
pub const CALIBRATION_FOLDER: &str = "calibration";

/// One sensor of a set, with the plan of its dataset.
#[derive(Clone)]
pub struct SetMember {
    /// Name of the dataset's folder in that of the set.
    pub folder: String,
    /// Number of the unit, if units were drawn.
    pub unit: Option<u32>,
    /// The plan. Its job has no `[sensors]`, and presses what this sensor alone would be pressed with.
    pub plan: Plan,
}

/// Checks `[sensors]`. Units that are drawn differ as real ones do, unless the job says how much.
pub(super) fn check_sensors(check: &mut JobChecker<'_>, job: &mut Job) {
    let Some(sensors) = &job.sensors else { return };
    if let Some(count) = sensors.count {
        check.require_in_range("sensors.count", f64::from(count), 1.0..=f64::from(MAX_UNITS), "units");
        if check.document.get("sensor.unit.variation").is_none() {
            job.sensor.unit.get_or_insert_default().variation = 1.0;
        }
    }
    let is_empty_list = sensors.from.is_empty() && check.is_valid("sensors.from");
    if is_empty_list && check.document.get("sensors.from").is_some() {
        let help = "name presets (gelsim list sensors) or sensor files, or leave the key out for that of [sensor]";
        check.report_error("sensors.from", "the list of sensors is empty", help);
    }
    if is_empty_list && sensors.count.is_none() && check.is_valid("sensors") {
        let help = "write count = 8 for as many units of the sensor, or from = [\"gelsight-mini\", \"digit\"], or both";
        check.report_error("sensors", "[sensors] names no sensors", help);
    }
    if job.presets.is_some() {
        let help = "name them in sensors.from for a dataset of each, or leave [sensors] out for one dataset of all";
        check.report_error("sensor.preset", "a list of presets in a job with [sensors]", help);
    }
    if job.gripper.is_some() {
        let help = "leave one of them out: a gripper holds each object between two sensors of its own";
        check.report_error("sensors", "both [sensors] and [gripper] say which sensors touch an object", help);
    }
    if sensors.paired && job.output.on_unhealthy == OnUnhealthy::Reject {
        let message = "samples that one sensor draws again are no pairs";
        let help = "write on_unhealthy = \"keep\", which their labels tell, or paired = false under [sensors]";
        check.report_error("output.on_unhealthy", message, help);
    }
}

impl Plan {
    /// Returns the problem of an object of which the richest side, which the job presses, is another one with the pad of
    /// a further sensor: the press would not be the same.
    pub(super) fn find_other_side(&self, further: &[Self]) -> Option<Diagnostic> {
        let others = further
            .iter()
            .flat_map(|other| self.sampling.objects.iter().zip(&other.sampling.objects).map(move |pair| (other, pair)));
        let (other, (object, _)) =
            others.into_iter().find(|(_, (own, of_other))| own.richest_side != of_other.richest_side)?;
        let message = format!(
            "face = \"auto\" presses another side of {} into {} than into {}, as their pads are not equally thick",
            object.path, other.job.sensor.name, self.job.sensor.name
        );
        Some(Diagnostic::new(message).help("write a side, such as face = \"-z\", or face = \"any\""))
    }

    /// Returns the plan of a job whose further sensors have these plans. What all have in common is kept once.
    pub(super) fn with_further_sensors(mut self, further: Vec<Self>) -> Self {
        for mut further in further {
            self.notes = self.notes.merged_with_new(&further.notes);
            self.explains_no_contact |= further.explains_no_contact;
            further.sampling = Arc::clone(&self.sampling);
            self.further_sensors.push(further);
        }
        self
    }

    /// Returns the plan with the calibration presses of its sensors.
    pub(super) fn with_calibration(mut self, presses: Self) -> Self {
        self.notes = self.notes.merged_with_new(&presses.notes);
        self.calibration = Some(Box::new(presses));
        self
    }

    /// Returns the sensors of a job with `[sensors]`, in order; `None` for a job of one sensor. Each is prepared, which
    /// takes some milliseconds.
    pub fn sensor_set(&self) -> Option<Vec<SetMember>> {
        let named = self.name_sensors()?;
        Some(named.into_iter().map(|(folder, unit, plan)| plan.to_member(folder, unit)).collect())
    }

    /// Names the folder of each sensor of a job with `[sensors]`, with the number of its unit and the plan it comes from.
    fn name_sensors(&self) -> Option<Vec<(String, Option<u32>, &Self)>> {
        let sensors = self.job.sensors.as_ref()?;
        let mut known = HashSet::from([CALIBRATION_FOLDER.to_owned()]);
        let mut named = Vec::new();
        for of_sensor in std::iter::once(self).chain(&self.further_sensors) {
            let name = unique_name(&of_sensor.job.sensor.name, &mut known);
            match sensors.count {
                None => named.push((name, None, of_sensor)),
                Some(count) => {
                    named.extend((0..count).map(|unit| (format!("{name}-{unit:04}"), Some(unit), of_sensor)));
                }
            }
        }
        Some(named)
    }

    /// Returns the folders of the job's datasets, if its own or that of its set is `root`.
    pub fn dataset_folders(&self, root: &Path) -> Vec<PathBuf> {
        match self.name_sensors() {
            None => vec![root.to_owned()],
            Some(named) => named.iter().map(|(folder, ..)| root.join(folder)).collect(),
        }
    }

    /// Returns a note for commands that show one sensor, if the job has `[sensors]`.
    pub fn note_one_of_sensors(&self) -> Report {
        let Some(named) = self.name_sensors().filter(|named| named.len() > 1) else { return Report::default() };
        let message = format!("the job has {} sensors; this shows {}", named.len(), self.job.sensor.name);
        let help =
            "gelsim generate presses the objects into all of them; to see another one, put it first in sensors.from";
        Diagnostic::note(message).help(help).into()
    }

    /// Makes the plan of a sensor's dataset in the folder `folder`; with `unit`, of a unit that is drawn.
    fn to_member(&self, folder: String, unit: Option<u32>) -> SetMember {
        // It depends on the folder alone, so that sensors can be added to a set.
        let stream = sha256(format!("sensors.{folder}").as_bytes());
        let seed = random_stream(self.sensor_seed(), &stream[..24], 0).next_bits() & MAX_SEED;
        let mut job = self.job.clone();
        let is_paired = job.sensors.take().is_none_or(|sensors| sensors.paired);
        job.dataset.sensor_seed = Some(seed);
        if !is_paired {
            job.dataset.seed = seed;
        }
        job.dataset.name = Some(format!("{}-{folder}", self.name()));
        let drawn = unit.and_then(|_| self.sensors.sample(&self.job, |name| random_stream(seed, name, 0)));
        let plan = Self { further_sensors: Vec::new(), calibration: None, ..self.clone() };
        let plan = match drawn {
            None => Self { fingerprint: compute_fingerprint(&job), job, ..plan },
            Some(drawn) => {
                let simulator = Arc::new(self.simulator_of(&drawn));
                let photograph = self.sensors.photographs.get(drawn.photograph).cloned();
                if let Some(Photograph { sha256, .. }) = &photograph
                    && let Some(path) = self.job.random.backgrounds.get(drawn.photograph)
                {
                    job.sensor.background = Some(path.clone());
                    job.sensor.background_sha256 = Some(sha256.clone());
                }
                let (background, background_sha256) = (job.sensor.background, job.sensor.background_sha256);
                job.sensor = drawn.numbers;
                (job.sensor.background, job.sensor.background_sha256) = (background, background_sha256);
                job.sensor.unit = None;
                job.random = Default::default();
                let sensors = Arc::new(SensorSampling::new(&job, photograph.into_iter().collect()));
                Self { fingerprint: compute_fingerprint(&job), simulator, sensors, job, ..plan }
            }
        };
        SetMember { folder, unit, plan }
    }

    /// Returns true if both plans press the same objects in the same way, as far as that does not depend on the sensor.
    pub(crate) fn presses_like(&self, other: &Self) -> bool {
        let (own, others) = (&self.job, &other.job);
        Arc::ptr_eq(&self.sampling, &other.sampling)
            && self.other_sensors.is_empty()
            && other.other_sensors.is_empty()
            && own.dataset.seed == others.dataset.seed
            && own.pose == others.pose
            && own.indentation == others.indentation
            && own.shear == others.shear
            && own.texture == others.texture
            && own.scene == others.scene
            && self.layout == other.layout
    }

    /// Returns the simulator of a sensor that was drawn. It shares with that of the plan what both have in common.
    pub(crate) fn simulator_of(&self, drawn: &DrawnSensor) -> Simulator {
        let nominal = self.simulator.sensor();
        let mut sensor = drawn.numbers.to_simulator_sensor(self.job.markers.as_ref(), &self.job.camera);
        sensor.relaxation.clone_from(&nominal.relaxation);
        sensor.calibration = nominal.calibration.clone();
        sensor.rest_surface = nominal.rest_surface.clone();
        if let Some(photograph) = self.sensors.photographs.get(drawn.photograph) {
            sensor.background = Background::Photograph(Arc::clone(&photograph.image));
        }
        self.simulator.variant(sensor)
    }
}

/// Returns the name of a folder for a sensor called `name` that is not in `known`, whatever the case of its letters.
fn unique_name(name: &str, known: &mut HashSet<String>) -> String {
    let allowed = |c: char| if c.is_ascii_alphanumeric() || "-_.".contains(c) { c } else { '-' };
    let plain: String = name.chars().map(allowed).collect();
    let plain = plain.trim_matches(['.', '-']);
    let plain = if plain.is_empty() { "sensor" } else { plain };
    let numbered = (2..).map(|number| format!("{plain}-{number}"));
    std::iter::once(plain.to_owned())
        .chain(numbered)
        .find(|name| known.insert(name.to_lowercase()))
        .expect("there is always another number")
}
