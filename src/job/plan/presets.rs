//! The sensors of a job that names several presets.

use std::sync::Arc;

use crate::config::document::{Document, Node};
use crate::config::{self, Job};
use gelsim_core::optics::LightSource;
use gelsim_core::sensor::Sensor;
use gelsim_files::diagnostic::Diagnostics;
use gelsim_files::sensor::PRESETS;

use super::check::Check;
use super::sensors::SensorSampling;
use super::{Plan, Scope, chosen_models, complete_sensor, fill, gel, ranges, simulator};

/// A sensor of another preset, found sound.
pub(super) struct OtherSensor {
    pub job: Job,
    sensor: Sensor,
    sampling: SensorSampling,
}

impl OtherSensor {
    /// Of a job whose defaults were written out; `None` after a mistake.
    pub fn checked(scope: Scope, mut job: Job, mut check: Check<'_>) -> Option<Self> {
        ranges::sensor(&mut check, &job);
        ranges::pad_surface(&mut check, &job);
        if scope == Scope::Dataset {
            ranges::scene(&mut check, &job, true);
        }
        ranges::camera(&mut check, &job);
        job.sensor.unit = job.sensor.unit.take().filter(|unit| unit.variation != 0.0);
        let (sensor, photographs, _) = complete_sensor(&mut check, &mut job)?;
        let sampling = SensorSampling::new(&job, photographs);
        Some(Self { job, sensor, sampling })
    }

    /// A plan with this sensor, in all else like `first`.
    pub fn plan(self, first: &Plan) -> Plan {
        let job = config::random::with_sensor_of(&first.job, self.job);
        let simulator = simulator(self.sensor, chosen_models(&job), job.effects, &job);
        Plan { simulator: Arc::new(simulator), sensors: Arc::new(self.sampling), job, ..first.clone() }
    }
}

/// The sensors of the job's other presets; what is wrong with them goes to `problems`.
pub(super) fn others_sensors(
    scope: Scope,
    first: &Job,
    others: Vec<(Job, Document)>,
    problems: &mut Diagnostics,
) -> Vec<OtherSensor> {
    let mut found = Vec::new();
    for (mut job, document) in others {
        let name = document.get("sensor.preset").and_then(Node::as_str);
        if !PRESETS.iter().any(|(known, _)| Some(*known) == name) {
            // Said where it was read.
            continue;
        }
        let mut check = Check { document: &document, problems: &mut *problems };
        fill(&mut job);
        gel::read(&mut check, &mut job.sensor);
        let (own, expected) = (job.sensor.resolution_px, first.sensor.resolution_px);
        if own != expected {
            let names = [&first.sensor.name, &job.sensor.name];
            let message = format!("`{}` has {expected:?} px, `{}` {own:?} px", names[0], names[1]);
            let help =
                format!("give all of them one: resolution_px = [{}, {}] under [sensor]", expected[0], expected[1]);
            check.error("sensor.preset", message, help);
        }
        // A job has one model of the light.
        if (job.sensor.light_source() == LightSource::Lamps) != (first.sensor.light_source() == LightSource::Lamps) {
            let names = [&first.sensor.name, &job.sensor.name];
            let message = format!("of `{}` and `{}` one has lamps, the other LEDs", names[0], names[1]);
            check.error("sensor.preset", message, "name presets with LEDs only, or with lamps only");
        }
        found.extend(OtherSensor::checked(scope, job, check));
    }
    found
}
