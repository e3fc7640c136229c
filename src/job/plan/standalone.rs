//! Loads a sensor without a job: a preset or a sensor file, with the files that it names.

use std::path::Path;
use std::sync::Arc;

use super::check::JobChecker;
use super::{files, gel, ranges};
use crate::config::document::Document;
use crate::config::{self, Job, Overrides, ParsedJob};
use gelsim_core::sensor::{Background, Sensor};
use gelsim_files::diagnostic::{Diagnostic, Diagnostics, Report, user_error};
use gelsim_files::sensor;

/// A sensor with the content of its files.
#[derive(Clone, Debug)]
pub struct StandaloneSensor {
    /// The sensor as it was written. Paths are relative to the current folder.
    pub written: sensor::Sensor,
    /// The sensor of the simulator.
    pub sensor: Sensor,
}

/// Loads the preset or the sensor file of this name. The error reports all that is wrong with it.
pub fn load_sensor(name: &str) -> Result<StandaloneSensor, Report> {
    let mut problems = Diagnostics::default();
    let ParsedJob { mut job, document, .. } = read_sensor_by_name(name, &mut problems);
    match resolve_sensor(&mut JobChecker { document: &document, problems: &mut problems }, &mut job) {
        Some(standalone) => Ok(standalone),
        None => Err(Report::new(&problems, &document.sources)),
    }
}

/// Loads a flat sensor as [`load_sensor`] does. `why` says what is wrong with another one, and `instead` what to do.
pub fn load_flat_sensor(name: &str, [why, instead]: [&str; 2]) -> Result<StandaloneSensor, Report> {
    let mut problems = Diagnostics::default();
    let ParsedJob { mut job, document, .. } = read_sensor_by_name(name, &mut problems);
    let mut check = JobChecker { document: &document, problems: &mut problems };
    if job.sensor.shape.is_some() {
        check.report_error("sensor.shape", why, instead);
    }
    match resolve_sensor(&mut check, &mut job) {
        Some(standalone) => Ok(standalone),
        None => Err(Report::new(&problems, &document.sources)),
    }
}

/// Reads the width and height of a sensor's view, px, without checking its files and ranges.
pub fn read_resolution_px(name: &str) -> Result<[usize; 2], Report> {
    let mut problems = Diagnostics::default();
    let ParsedJob { job, document, .. } = read_sensor_by_name(name, &mut problems);
    match problems.is_empty() {
        true => Ok(super::sensor_view(&job).resolution_px),
        false => Err(Report::new(&problems, &document.sources)),
    }
}

/// Resolves the sensor of a job that was read, and reads its files. Returns `None` after an error.
pub fn resolve_sensor(check: &mut JobChecker<'_>, job: &mut Job) -> Option<StandaloneSensor> {
    check.refuse_random_sensor(&job.sensor);
    gel::read_gel_files(check, job);
    ranges::check_sensor(check, job);
    let backgrounds = files::load_backgrounds(check, job);
    let calibration = files::load_calibration(check, job);
    let (photographs, _) = backgrounds.filter(|_| check.problems.is_empty())?;
    let mut sensor = job.sensor_without_files();
    sensor.calibration = calibration.map(Arc::new);
    if let Some(photograph) = photographs.first() {
        sensor.background = Background::Photograph(Arc::clone(&photograph.image));
    }
    Some(StandaloneSensor { written: job.sensor.clone(), sensor })
}

/// Finds the values of a sensor that would be out of range in a sensor file.
pub fn find_out_of_range(sensor: &sensor::Sensor) -> Vec<Diagnostic> {
    let job = Job {
        camera: sensor.camera.clone().unwrap_or_default(),
        markers: sensor.markers.clone(),
        sensor: sensor.clone(),
        ..Job::default()
    };
    let (document, mut problems) = (Document::empty(), Diagnostics::default());
    let mut check = JobChecker { document: &document, problems: &mut problems };
    ranges::check_sensor(&mut check, &job);
    ranges::check_pad_surface(&mut check, &job);
    ranges::check_camera(&mut check, &job);
    problems.into_iter().collect()
}

fn read_sensor_by_name(name: &str, problems: &mut Diagnostics) -> ParsedJob {
    config::read_sensor(name, Vec::new(), &Overrides::default(), problems)
}

/// Loads the sensor that a sensor file describes, such as one written by `gelsim calibrate`, with the files that it
/// names.
///
/// # Errors
///
/// All that is wrong with the file, with the places.
pub fn load_sensor_file(path: &Path) -> Result<Sensor, Report> {
    let Some(path) = path.to_str() else {
        return Err(user_error("the path of the sensor file is not UTF-8", "rename the file or its folder"));
    };
    let mut problems = Diagnostics::default();
    let written = config::read_sensor_file(path, &mut problems);
    resolve_parsed(written, problems)
}

fn resolve_parsed(written: ParsedJob, mut problems: Diagnostics) -> Result<Sensor, Report> {
    let ParsedJob { mut job, document, .. } = written;
    let mut check = JobChecker { document: &document, problems: &mut problems };
    check.refuse_random_sensor(&job.sensor);
    gel::read_gel_files(&mut check, &mut job);
    ranges::check_sensor(&mut check, &job);
    ranges::check_pad_surface(&mut check, &job);
    ranges::check_camera(&mut check, &job);
    let found = super::build_sensor(&mut check, &mut job);
    match found.filter(|_| problems.is_empty()) {
        Some((sensor, ..)) => Ok(sensor),
        None => Err(Report::new(&problems, &document.sources)),
    }
}
