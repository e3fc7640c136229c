//! A sensor by itself, without a job: a preset or a sensor file, with the files that it names.

use std::path::Path;

use super::check::Check;
use super::{files, ranges};
use crate::config::diagnostic::{Problems, Report};
use crate::config::sensor::{PRESETS, Sensor};
use crate::config::{self, Job, Overrides, Written};
use crate::depth::Camera;
use crate::optics::background::Reference;
use crate::optics::calibrated::Table;

/// A sensor and what its files hold.
#[derive(Clone, Debug)]
pub struct Standalone {
    /// Its values; paths are as they are found from the current folder.
    pub sensor: Sensor,
    /// Its view.
    pub camera: Camera,
    /// The untouched pad.
    pub reference: Reference,
    /// What was measured on it, if anything was.
    pub calibration: Option<Table>,
}

/// Reads the preset or the sensor file of this name. On failure, every mistake in it.
pub fn sensor(name: &str) -> Result<Standalone, Report> {
    let mut problems = Problems::default();
    let Written { mut job, document, .. } = written(name, &mut problems);
    match of(&mut Check { document: &document, problems: &mut problems }, &mut job) {
        Some(standalone) => Ok(standalone),
        None => Err(Report::new(&problems, &document.sources)),
    }
}

/// Width and height of its view, px, without a look at its files and ranges.
pub fn resolution_px(name: &str) -> Result<[usize; 2], Report> {
    let mut problems = Problems::default();
    let Written { job, document, .. } = written(name, &mut problems);
    match problems.is_empty() {
        true => Ok(super::view(&job).resolution_px),
        false => Err(Report::new(&problems, &document.sources)),
    }
}

/// The sensor of a job that was read, its files found. `None` after a mistake.
pub fn of(check: &mut Check<'_>, job: &mut Job) -> Option<Standalone> {
    ranges::sensor(check, job);
    let reference = files::background(check, job);
    let calibration = files::calibration(check, job);
    let (reference, _) = reference.filter(|_| check.problems.is_empty())?;
    Some(Standalone { sensor: job.sensor.clone(), camera: super::view(job), reference, calibration })
}

fn written(name: &str, problems: &mut Problems) -> Written {
    config::read_text("--sensor", table(name), Path::new(""), &Overrides::default(), problems)
}

/// The `[sensor]` table of a job that names the preset or the sensor file.
pub fn table(name: &str) -> String {
    let key = if PRESETS.iter().any(|(known, _)| *known == name) { "preset" } else { "file" };
    format!("[sensor]\n{key} = {}\n", toml::Value::from(name))
}
