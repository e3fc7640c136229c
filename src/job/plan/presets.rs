//! The sensors of a job that names several presets.

use std::sync::Arc;

use crate::config::document::{Document, TomlNode};
use crate::config::{self, Job};
use gelsim_core::optics::LightSource;
use gelsim_core::sensor::Sensor;
use gelsim_files::diagnostic::Diagnostics;
use gelsim_files::sensor::PRESETS;

use super::check::JobChecker;
use super::sensors::SensorSampling;
use super::{Plan, Scope, build_sensor, chosen_models, create_simulator, fill_defaults, gel, ranges, strain};

/// A sensor of another preset that was checked and built.
pub(super) struct OtherSensor {
    pub job: Job,
    sensor: Sensor,
    sampling: SensorSampling,
}

impl OtherSensor {
    /// Checks and builds the sensor of a job whose defaults were filled in. Returns `None` after an error.
    pub fn check_and_build(scope: Scope, mut job: Job, mut check: JobChecker<'_>) -> Option<Self> {
        ranges::check_sensor(&mut check, &job);
        ranges::check_pad_surface(&mut check, &job);
        if scope == Scope::Dataset {
            ranges::check_pose(&mut check, &job, true);
        }
        ranges::check_camera(&mut check, &job);
        if job.gripper.is_none() {
            strain::check_strain(&mut check, &job, scope);
        }
        job.sensor.unit = job.sensor.unit.take().filter(|unit| unit.variation != 0.0);
        let (sensor, photographs, _) = build_sensor(&mut check, &mut job)?;
        let sampling = SensorSampling::new(&job, photographs);
        Some(Self { job, sensor, sampling })
    }

    /// Makes a plan with this sensor that is otherwise like `first`.
    pub fn into_plan(self, first: &Plan) -> Plan {
        let job = config::random::replace_sensor(&first.job, self.job);
        let simulator = create_simulator(self.sensor, chosen_models(&job), job.effects, &job);
        Plan { simulator: Arc::new(simulator), sensors: Arc::new(self.sampling), job, ..first.clone() }
    }
}

/// Checks and builds the sensors of the job's other presets. Errors go to `problems`.
pub(super) fn resolve_other_presets(
    scope: Scope,
    first: &Job,
    others: Vec<(Job, Document)>,
    problems: &mut Diagnostics,
) -> Vec<OtherSensor> {
    let mut found = Vec::new();
    for (mut job, document) in others {
        let name = document.get("sensor.preset").and_then(TomlNode::as_str);
        if !PRESETS.iter().any(|(known, _)| Some(*known) == name) {
            // An unknown preset was reported when the job was read.
            continue;
        }
        let mut check = JobChecker { document: &document, problems: &mut *problems };
        fill_defaults(&mut job);
        gel::read_gel_files(&mut check, &mut job);
        let (own, expected) = (job.sensor.resolution_px, first.sensor.resolution_px);
        if own != expected {
            let names = [&first.sensor.name, &job.sensor.name];
            let message = format!("`{}` has {expected:?} px, `{}` {own:?} px", names[0], names[1]);
            let help =
                format!("give all of them one: resolution_px = [{}, {}] under [sensor]", expected[0], expected[1]);
            check.report_error("sensor.preset", message, help);
        }
        // All presets of a job must share one optics model.
        if (job.sensor.light_source() == LightSource::Lamps) != (first.sensor.light_source() == LightSource::Lamps) {
            let names = [&first.sensor.name, &job.sensor.name];
            let message = format!("of `{}` and `{}` one has lamps, the other LEDs", names[0], names[1]);
            check.report_error("sensor.preset", message, "name presets with LEDs only, or with lamps only");
        }
        found.extend(OtherSensor::check_and_build(scope, job, check));
    }
    found
}
