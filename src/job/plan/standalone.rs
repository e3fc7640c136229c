//! A sensor by itself, without a job: a preset or a sensor file, with the files that it names.

use std::path::Path;
use std::sync::Arc;

use super::check::Check;
use super::{files, gel, ranges};
use crate::config::document::Document;
use crate::config::{self, Job, Overrides, Written};
use gelsim_core::sensor::{Background, Sensor};
use gelsim_files::diagnostic::{Diagnostic, Diagnostics, Report, user_error};
use gelsim_files::sensor;

/// A sensor and what its files hold.
#[derive(Clone, Debug)]
pub struct Standalone {
    /// As it was written; paths are as they are found from the current folder.
    pub written: sensor::Sensor,
    /// As the simulator knows it.
    pub sensor: Sensor,
}

/// Reads the preset or the sensor file of this name. On failure, every mistake in it.
pub fn sensor(name: &str) -> Result<Standalone, Report> {
    let mut problems = Diagnostics::default();
    let Written { mut job, document, .. } = written(name, &mut problems);
    match resolve(&mut Check { document: &document, problems: &mut problems }, &mut job) {
        Some(standalone) => Ok(standalone),
        None => Err(Report::new(&problems, &document.sources)),
    }
}

/// The same of a flat sensor: `why` says what would be wrong with another one, and what to do instead.
pub fn flat_sensor(name: &str, [why, instead]: [&str; 2]) -> Result<Standalone, Report> {
    let mut problems = Diagnostics::default();
    let Written { mut job, document, .. } = written(name, &mut problems);
    let mut check = Check { document: &document, problems: &mut problems };
    if job.sensor.shape.is_some() {
        check.error("sensor.shape", why, instead);
    }
    match resolve(&mut check, &mut job) {
        Some(standalone) => Ok(standalone),
        None => Err(Report::new(&problems, &document.sources)),
    }
}

/// Width and height of its view, px, without a look at its files and ranges.
pub fn resolution_px(name: &str) -> Result<[usize; 2], Report> {
    let mut problems = Diagnostics::default();
    let Written { job, document, .. } = written(name, &mut problems);
    match problems.is_empty() {
        true => Ok(super::view(&job).resolution_px),
        false => Err(Report::new(&problems, &document.sources)),
    }
}

/// The sensor of a job that was read, its files found. `None` after a mistake.
pub fn resolve(check: &mut Check<'_>, job: &mut Job) -> Option<Standalone> {
    check.one_sensor(&job.sensor);
    gel::read(check, &mut job.sensor);
    ranges::sensor(check, job);
    let backgrounds = files::backgrounds(check, job);
    let calibration = files::calibration(check, job);
    let (photographs, _) = backgrounds.filter(|_| check.problems.is_empty())?;
    let mut sensor = job.bare_sensor();
    sensor.calibration = calibration.map(Arc::new);
    if let Some(photograph) = photographs.first() {
        sensor.background = Background::Photograph(Arc::clone(&photograph.image));
    }
    Some(Standalone { written: job.sensor.clone(), sensor })
}

/// What of a sensor a file of it could not hold: what is out of range, as a job that names the file would say.
pub fn out_of_range(sensor: &sensor::Sensor) -> Vec<Diagnostic> {
    let job = Job {
        camera: sensor.camera.clone().unwrap_or_default(),
        markers: sensor.markers.clone(),
        sensor: sensor.clone(),
        ..Job::default()
    };
    let (document, mut problems) = (Document::empty(), Diagnostics::default());
    let mut check = Check { document: &document, problems: &mut problems };
    ranges::sensor(&mut check, &job);
    ranges::pad_surface(&mut check, &job);
    ranges::camera(&mut check, &job);
    problems.into_iter().collect()
}

fn written(name: &str, problems: &mut Diagnostics) -> Written {
    config::read_sensor(name, Vec::new(), &Overrides::default(), problems)
}

/// The sensor that a sensor file describes, such as one that `gelsim calibrate` wrote, with the files that it names.
///
/// # Errors
///
/// Every mistake in the file, with its place.
pub fn load(path: &Path) -> Result<Sensor, Report> {
    let Some(path) = path.to_str() else {
        return Err(user_error("the path of the sensor file is not UTF-8", "rename the file or its folder"));
    };
    let mut problems = Diagnostics::default();
    let written = config::read_sensor_file(path, &mut problems);
    resolved(written, problems)
}

fn resolved(written: Written, mut problems: Diagnostics) -> Result<Sensor, Report> {
    let Written { mut job, document, .. } = written;
    let mut check = Check { document: &document, problems: &mut problems };
    check.one_sensor(&job.sensor);
    gel::read(&mut check, &mut job.sensor);
    ranges::sensor(&mut check, &job);
    ranges::pad_surface(&mut check, &job);
    ranges::camera(&mut check, &job);
    let found = super::complete_sensor(&mut check, &mut job);
    match found.filter(|_| problems.is_empty()) {
        Some((sensor, ..)) => Ok(sensor),
        None => Err(Report::new(&problems, &document.sources)),
    }
}
