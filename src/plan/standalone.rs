//! A sensor by itself, without a job: a preset or a sensor file, with the files that it names.

use std::path::Path;

use super::check::Check;
use super::{files, ranges};
use crate::config::diagnostic::{Problems, Report};
use crate::config::sensor::{PRESETS, Sensor};
use crate::config::{self, Job, Overrides};
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
    let preset = PRESETS.iter().any(|(known, _)| *known == name);
    let key = if preset { "preset" } else { "file" };
    let text = format!("[sensor]\n{key} = {}\n", toml::Value::from(name));
    let mut problems = Problems::default();
    let written = config::read_text("--sensor", text, Path::new(""), &Overrides::default(), &mut problems);
    let (mut job, document) = (written.job, written.document);
    match of(&mut Check { document: &document, problems: &mut problems }, &mut job) {
        Some(standalone) => Ok(standalone),
        None => Err(Report::new(&problems, &document.sources)),
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
