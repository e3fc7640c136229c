//! `gelsim calibrate`: fits a sensor file to presses of a real sensor, takes over published calibrations, and simulates
//! presses with a fitted sensor.

mod evaluate;
mod force;
mod published;
mod summary;

use gelsim_files::calibration;
use std::collections::HashSet;
use std::fs;
use std::io;
use std::path::{Path, PathBuf};

use clap::Args;
use image::RgbImage;

use self::summary::{
    format_lines, summarise_calibration, summarise_camera, summarise_dots, summarise_leds, summarise_verdict,
};
use super::guesses::parse_whole_number;
use super::log::Log;
use super::progress::bar::Bar;
use super::store::local_path_parser;
use super::{Failure, check_thread_count, print_result, print_to_stderr, threads_failure};
use gelsim_core::fidelity::Fidelity;
use gelsim_core::optics::calibrated::CalibrationTable;
use gelsim_dataset::encode::to_json_line;
use gelsim_files::diagnostic::{Diagnostic, Diagnostics, Report, user_error};
use gelsim_files::hash::sha256;
use gelsim_files::png::encode_rgb;
use gelsim_files::sensor::Sensor;
use gelsim_files::write::write_output;
use gelsim_job::plan::standalone;
use gelsim_lab::calibrate::camera::{MeasuredCamera, measure_camera};
use gelsim_lab::calibrate::judge::{self, Findings, background, fit, scale};
use gelsim_lab::calibrate::leds::FittedLeds;
use gelsim_lab::calibrate::outliers::OutlierReason;
use gelsim_lab::calibrate::page::{CalibrationPage, PressPanel};
use gelsim_lab::calibrate::run::{
    Calibration, CalibrationError, CalibrationRequest, LedCalibration, calibrate_leds, calibrate_with_progress,
    find_outliers,
};
use gelsim_lab::calibrate::train::TrainingSettings;
use gelsim_lab::calibrate::{Geometry, Session, session, surfaces};
use gelsim_lab::presses::folder::GivenFacts;
use gelsim_lab::presses::{self, PressTable};

/// Fit light or gelpad of a real sensor to presses, or simulate presses with a sensor that was fitted.
#[derive(Debug, Args)]
#[command(after_help = "\
Example:
  gelsim calibrate presses.csv --background untouched.png --out mine.toml
  gelsim calibrate gs_sdk/calib_data --mm-per-px 0.0634 --out mine.toml
  gelsim calibrate --leds three.csv --background untouched.png --out mine.toml
  gelsim calibrate --evaluate others.csv --sensor mine.toml --out simulated
  gelsim calibrate --taxim taxim/calib/gelsight --out mine.toml
  gelsim calibrate --gelsight devices/series2_2EF6_4JNW.yaml --out mine.toml
  gelsim calibrate --force forces.csv --sensor mine.toml --out mine.toml

PRESSES.csv has a row for each picture of a ball in the pad: file, centre_x_px, centre_y_px, radius_px of the visible \
disc, ball_radius_mm, mm_per_px; paths are relative to it. In its place, DIR is a calibration folder of gs_sdk or \
py3DCal. Beside mine.toml come mine.calibration.json, \
mine.background.png and mine.html, a page of plots and pictures. In a job: [sensor] file = \"mine.toml\".

FORCES.csv has a row for each moment of each press: press (its name), ball_radius_mm or punch_radius_mm, depth_mm or \
contact_radius_mm, force_n, and if they are known time_s, shear_mm, shear_force_n.")]
pub struct Calibrate {
    /// The table of presses to learn from, or a calibration folder of gs_sdk or py3DCal
    #[arg(value_name = "PRESSES.csv|DIR", required_unless_present_any = ["evaluate", "taxim", "gelsight", "force"])]
    #[arg(conflicts_with_all = ["evaluate", "taxim", "gelsight", "force"])]
    presses: Option<PathBuf>,
    /// Background image: the untouched pad; folders have one
    #[arg(long, value_name = "BG.png", conflicts_with_all = ["evaluate", "taxim", "gelsight"])]
    background: Option<PathBuf>,
    /// Take over a calibration of Taxim's: a folder with polycalib.npz, dataPack.npz and params.json
    #[arg(long, value_name = "DIR", conflicts_with_all = ["evaluate", "detect", "drop_bad", "contact_over_disc"])]
    taxim: Option<PathBuf>,
    /// Take over a calibration that GelSight publishes: the YAML file of a device, beside its flat field as PNG
    #[arg(long, value_name = "DEVICE.yaml", conflicts_with_all = ["evaluate", "taxim", "detect", "drop_bad", "contact_over_disc"])]
    gelsight: Option<PathBuf>,
    /// Fit Young's modulus, relaxation and friction of the gelpad to presses with measured forces
    #[arg(long, value_name = "FORCES.csv")]
    #[arg(conflicts_with_all = ["background", "taxim", "gelsight", "evaluate", "leds", "surfaces", "detect"])]
    #[arg(conflicts_with_all = ["match_background", "contact_over_disc", "steps"])]
    force: Option<PathBuf>,
    /// With --force: the zero of depth_mm is not known; fit one offset for the whole table
    #[arg(long, requires = "force")]
    fit_zero: bool,
    /// Simulate the presses of this table from circle and ball alone, and say how far they are from the images
    #[arg(long, value_name = "PRESSES.csv|DIR", requires = "sensor")]
    evaluate: Option<PathBuf>,
    /// Width of a pixel on the pad, mm, where a folder does not tell: `ppmm` of gs_sdk
    #[arg(long, value_name = "MM", value_parser = parse_pixel_size, conflicts_with_all = ["taxim", "gelsight", "force"])]
    mm_per_px: Option<f64>,
    /// Radius of the ball, mm, where a folder of py3DCal does not tell
    #[arg(long, value_name = "MM", value_parser = parse_positive, conflicts_with_all = ["taxim", "gelsight", "force"])]
    ball_radius_mm: Option<f64>,
    /// With --evaluate the sensor; else a preset or a sensor file from which comes what is not fitted
    #[arg(long, value_name = "PRESET|SENSOR.toml")]
    sensor: Option<String>,
    /// The sensor file to write; with --evaluate the folder for the pictures
    #[arg(short, long, value_name = "SENSOR.toml|DIR", value_parser = local_path_parser())]
    out: PathBuf,
    /// Fit the LEDs alone, for the optics models phong and led: three presses are enough
    #[arg(long, conflicts_with_all = ["evaluate", "taxim", "gelsight", "drop_bad", "steps"])]
    leds: bool,
    /// Folder for the pad's surface under each press as arrays (mm), normals and contact masks: labels for the images
    #[arg(long, value_name = "DIR", conflicts_with_all = ["evaluate", "taxim", "gelsight"])]
    surfaces: Option<PathBuf>,
    /// Look for circles that the table lacks, and say how sure each is
    #[arg(long)]
    detect: bool,
    /// Leave out presses that may be unusable
    #[arg(long, conflicts_with = "evaluate")]
    drop_bad: bool,
    /// Rotate the background image, reorder its channels and scale its brightness to match the presses outside their
    /// discs
    #[arg(long, conflicts_with_all = ["evaluate", "taxim", "gelsight"])]
    match_background: bool,
    /// Continue where the result is unlikely to be usable: the reasons become warnings
    #[arg(long)]
    keep_anyway: bool,
    /// Thickness of the pad, mm [default: chosen]
    #[arg(long, value_name = "MM", value_parser = parse_positive, conflicts_with = "evaluate")]
    thickness_mm: Option<f64>,
    /// Radius of the contact over that of the visible disc [default: chosen; with --leds 0.95; with --evaluate the
    /// sensor's, or 0.95]
    #[arg(long, value_name = "FRACTION", value_parser = parse_contact_over_disc)]
    contact_over_disc: Option<f64>,
    /// Steps of training; fewer are quicker and less exact [default: 1500]
    #[arg(long, value_name = "N", value_parser = parse_steps)]
    #[arg(conflicts_with_all = ["evaluate", "taxim", "gelsight"])]
    steps: Option<u32>,
    /// Threads [default: all cores]
    #[arg(short = 'j', long, value_name = "T", value_parser = parse_whole_number::<usize>)]
    threads: Option<usize>,
    /// Fidelity level for --evaluate
    #[arg(long, value_name = "LEVEL", value_parser = super::fidelity_level_parser(), default_value = "standard", requires = "evaluate")]
    fidelity: Fidelity,
    /// Print only the results and errors
    #[arg(short, long)]
    quiet: bool,
}

/// Why a gel that has a shape cannot be calibrated, and what to do instead.
const FLAT_ONLY: [&str; 2] = [
    "balls are calibrated on flat pads, and the sensor's gel has a shape: there the pixel size, which turns a circle into the depth of a ball, \
     differs from place to place, and light that is learnt by normals alone holds in one place only",
    "write the sensor file by hand: `background` (a photograph of the untouched gel) and an [[led]] table for each LED; then simulate \
     the presses with a job and compare its images with the real ones: gelsim compare",
];

fn parse_positive(text: &str) -> Result<f64, String> {
    match text.parse::<f64>() {
        Ok(value) if (1e-2..=1e3).contains(&value) => Ok(value),
        _ => Err(String::from("write a number from 0.01 to 1000")),
    }
}

fn parse_pixel_size(text: &str) -> Result<f64, String> {
    match text.parse::<f64>() {
        Ok(value) if (1e-6..=1e3).contains(&value) => Ok(value),
        _ => Err(String::from("write a number from 0.000001 to 1000")),
    }
}

fn parse_steps(text: &str) -> Result<u32, String> {
    parse_whole_number(text).and_then(|steps| {
        if (1..=1_000_000).contains(&steps) {
            Ok(steps)
        } else {
            Err(String::from("write a whole number from 1 to 1000000"))
        }
    })
}

/// Parses the radius of the contact over that of the visible disc. What people see as the disc is the contact and a
/// little more, so no contact lies outside these bounds.
fn parse_contact_over_disc(text: &str) -> Result<f64, String> {
    match text.parse::<f64>() {
        Ok(value) if (0.5..=1.5).contains(&value) => Ok(value),
        _ => Err(String::from("write a number from 0.5 to 1.5; where it was fitted it is 0.88 to 1")),
    }
}

impl Calibrate {
    pub(super) fn run(self) -> Result<(), Failure> {
        match check_thread_count(self.threads)? {
            None => self.run_in_pool(),
            Some(threads) => {
                let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build();
                pool.map_err(|error| threads_failure(&error))?.install(|| self.run_in_pool())
            }
        }
    }

    /// Runs the command on the current thread pool.
    fn run_in_pool(&self) -> Result<(), Failure> {
        if let (Some(table), Some(sensor)) = (&self.evaluate, &self.sensor) {
            return self.evaluate_table(table, sensor);
        }
        if self.out.extension().is_none_or(|end| end != "toml") {
            let message = format!("{} is no name for a sensor file", self.out.display());
            return Err(user_error(message, "it ends in .toml: --out my-sensor.toml").into());
        }
        if self.out.is_dir() {
            return Err(user_error(format!("{} is a folder", self.out.display()), "choose a file with --out").into());
        }
        if let Some(file) = self.out.ancestors().skip(1).find(|above| above.is_file()) {
            let message = format!("{} is no folder", file.display());
            return Err(user_error(message, "choose another place with --out").into());
        }
        if let Some(folder) = &self.surfaces {
            surfaces::check_folder(folder)?;
            let within = |path: &Path| std::path::absolute(path).map_err(|error| path_failure(path, &error));
            if within(&self.out)?.starts_with(within(folder)?) {
                let message = format!("{} would be among the surfaces", self.out.display());
                return Err(user_error(message, "choose another folder with --surfaces").into());
            }
        }
        let start = match &self.sensor {
            Some(name) => {
                let flat_only = if self.force.is_some() { force::FLAT_ONLY } else { FLAT_ONLY };
                standalone::load_flat_sensor(name, flat_only)?.written
            }
            None => Sensor::default(),
        };
        if let Some(presses) = &self.force {
            return self.fit_forces(presses, start);
        }
        match (&self.presses, &self.taxim, &self.gelsight) {
            (Some(presses), ..) => self.fit_presses(presses, start),
            (_, Some(folder), _) => self.import_taxim(folder, start),
            (.., Some(device)) => self.import_lamps(device, start),
            _ => Err(user_error("nothing to calibrate", "see gelsim calibrate --help").into()),
        }
    }

    /// Reads a table of presses, or a calibration folder.
    fn read_presses(&self, path: &Path) -> Result<PressTable, Report> {
        let &Self { mm_per_px, ball_radius_mm, .. } = self;
        let has_sensor = self.evaluate.is_some();
        let has_background = has_sensor || self.background.is_some();
        presses::folder::read(path, GivenFacts { mm_per_px, ball_radius_mm, has_background, has_sensor })
    }

    fn log(&self) -> Log {
        Log::plain_text(self.quiet)
    }

    /// Reports what was found. Fails if it makes the result unusable, unless `--keep-anyway` is there. Returns the
    /// findings as warnings.
    fn report_findings(&self, findings: Findings) -> Result<Vec<Diagnostic>, Failure> {
        if findings.are_hopeless() && !self.keep_anyway {
            Log::plain_text(false).print_notes(&build_report(findings.0));
            let last = Diagnostic::note("nothing is written").help("--keep-anyway continues, with these as warnings");
            Log::plain_text(false).print_notes(&last.into());
            return Err(Failure::already_reported(1));
        }
        let findings = findings.into_warnings();
        self.log().print_notes(&build_report(findings.0.clone()));
        Ok(findings.0)
    }

    /// Refuses if one of the files that will be written is one that is read.
    fn refuse_to_overwrite(
        &self,
        table: &PressTable,
        written: impl Iterator<Item = PathBuf>,
        help: &str,
    ) -> Result<(), Failure> {
        let written: HashSet<PathBuf> = written.filter_map(|path| path.canonicalize().ok()).collect();
        let mut problems = Diagnostics::default();
        let images = table.presses.iter().map(|press| &press.path);
        // One that is not matched is written as it was read.
        let matched = self.background.as_ref().or(table.background.as_ref()).filter(|_| self.match_background);
        for read in images.chain(matched) {
            if read.canonicalize().is_ok_and(|path| written.contains(&path)) {
                let name = read.display().to_string();
                let problem = Diagnostic::new(format!("{name} would be written over")).help(help);
                problems.push(problem.about(name, "files would be written over"));
            }
        }
        if problems.is_empty() { Ok(()) } else { Err(Report::new(&problems, &[]).into()) }
    }

    fn fit_presses(&self, presses: &Path, sensor: Sensor) -> Result<(), Failure> {
        let table = self.read_presses(presses)?;
        let written = ["background.png", "png"].map(|end| self.out.with_extension(end));
        self.refuse_to_overwrite(&table, written.into_iter(), "choose another place with --out")?;
        let Some(background_image) = self.background.as_ref().or(table.background.as_ref()).cloned() else {
            let help = "name an image of the untouched pad with --background";
            return Err(user_error(format!("{}: no background image", presses.display()), help).into());
        };
        let fewest = if self.leds { session::MIN_PRESSES_FOR_LEDS } else { session::MIN_PRESSES };
        let named = self.sensor.as_deref().map(|name| (name, sensor.field_of_view_mm));
        let (mut session, notes) = session::read_session(table, &background_image, sensor, self.detect, fewest)?;
        self.log().print_notes(&Report::new(&notes, &[]));
        let mut said: Vec<Diagnostic> = notes.into_iter().collect();
        if self.match_background {
            let (matched, what) = background::match_background(session);
            session = matched;
            self.log().print_note(&what);
            said.push(Diagnostic::note(what));
        }
        if let Some(found) = note_printed_dots(&session) {
            self.log().print_notes(&found.clone().into());
            said.push(found);
        }
        let defaults = TrainingSettings::default();
        let request = CalibrationRequest {
            settings: TrainingSettings { steps: self.steps.map_or(defaults.steps, |steps| steps as usize), ..defaults },
            thickness_mm: self.thickness_mm,
            contact_over_disc: self.contact_over_disc,
            drops_outliers: self.drop_bad,
        };
        let doubts = find_outliers(&session);
        said.extend(self.report_findings(find_doubts_before_fit(&session, &request, named, &doubts))?);
        if self.leds {
            return self.fit_leds(&session, &request);
        }
        let files: Vec<String> = session.observations.iter().map(|press| press.file.clone()).collect();
        let bar = Bar::in_thousandths(!self.quiet);
        let found =
            calibrate_with_progress(session, doubts, &request, &|done, what| bar.show((1000.0 * done) as u64, what));
        bar.end();
        let found = found.map_err(|unfit| explain_unfit(&unfit, files.len()))?;
        let is_short = request.settings.steps < TrainingSettings::default().steps;
        said.extend(self.report_findings(find_doubts_after_fit(&found, is_short))?);
        self.write_fit(&found, &said)
    }

    /// Writes the sensor file of a calibration, its table, background, page and surfaces, and prints the figures.
    fn write_fit(&self, found: &Calibration, said: &[Diagnostic]) -> Result<(), Failure> {
        let summary = summarise_calibration(found);
        let sensor = with_leds(found.session.sensor_at_thickness(found.geometry.thickness_mm), &found.leds);
        let sensor = with_camera(with_print(sensor, &found.session), found.camera.as_ref());
        let sensor = self.with_own_name(sensor);
        check_representable(&sensor, Some(&found.table))?;
        self.write_surfaces(&found.session, found.geometry)?;
        let page_path = self.out.with_extension("html");
        let page = render_page(&self.sensor_name(), found, &summary, &build_report(said.to_vec()).messages_with_help());
        self.write_sensor(
            sensor,
            written_background(&found.session),
            Some(&found.table),
            &summary,
            Some((&page_path, page)),
        )?;
        print_result(&format_lines(&summary))?;
        self.report_written(&format!("{}, {}", self.out.display(), page_path.display()));
        Ok(())
    }

    /// Prints where the output was written.
    fn report_written(&self, what: &str) {
        if !self.quiet {
            print_to_stderr(&format!("-> {what}"));
        }
    }

    /// Fits only the LEDs, and writes the sensor file.
    fn fit_leds(&self, session: &Session, request: &CalibrationRequest) -> Result<(), Failure> {
        let geometry = request.default_geometry(session);
        let found = calibrate_leds(session, geometry)
            .ok_or_else(|| explain_unfit(&CalibrationError::NoPixel, session.observations.len()))?;
        let LedCalibration { leds, verdict, too_large } = &found;
        let large = too_large.iter().filter(|too_large| **too_large).count();
        let mut findings = Findings::default();
        findings.extend(fit::judge_leds(leds));
        findings.extend(verdict.to_finding(large, too_large.len(), false));
        let warned = session.observations.iter().zip(too_large).filter(|(_, too_large)| **too_large);
        findings.extend(warned.map(|(press, _)| OutlierReason::TooLarge.to_warning(&press.file)));
        self.report_findings(findings)?;
        let camera = measure_camera(session);
        let sensor = with_print(with_leds(session.sensor_at_thickness(geometry.thickness_mm), leds), session);
        let sensor = self.with_own_name(with_camera(sensor, camera.as_ref()));
        check_representable(&sensor, None)?;
        self.write_surfaces(session, geometry)?;
        let about = [
            summarise_verdict(verdict),
            summarise_dots(session),
            summarise_leds(leds),
            summarise_camera(camera.as_ref()),
        ];
        let about = about.concat();
        self.write_sensor(sensor, written_background(session), None, &about, None)?;
        print_result(&format_lines(&about))?;
        self.report_written(&self.out.display().to_string());
        Ok(())
    }

    /// Creates the folder of the sensor file.
    fn create_parent_folder(&self) -> Result<(), Failure> {
        match self.out.parent().filter(|folder| !folder.as_os_str().is_empty()) {
            Some(folder) => fs::create_dir_all(folder).map_err(|error| denied_failure(folder, &error)),
            None => Ok(()),
        }
    }

    fn write_surfaces(&self, session: &Session, geometry: Geometry) -> Result<(), Failure> {
        let Some(folder) = &self.surfaces else { return Ok(()) };
        surfaces::write_surfaces(session, geometry, folder).map_err(|(path, error)| denied_failure(&path, &error))
    }

    /// Returns the sensor's name: that of the file without its ending.
    fn sensor_name(&self) -> String {
        self.out.file_stem().map_or_else(String::new, |stem| stem.to_string_lossy().into_owned())
    }

    /// Returns the sensor under its own name, without the preset, file and lamps that it started from.
    fn with_own_name(&self, sensor: Sensor) -> Sensor {
        Sensor {
            name: self.sensor_name(),
            preset: None,
            file: None,
            led: if sensor.led.is_empty() { Sensor::default().led } else { sensor.led },
            lamp: Vec::new(),
            ..sensor
        }
    }

    /// Writes the sensor file, after the files that it names: when it exists, they do.
    fn write_sensor(
        &self,
        sensor: Sensor,
        background: &RgbImage,
        table: Option<&CalibrationTable>,
        about: &[(String, String)],
        page: Option<(&Path, String)>,
    ) -> Result<(), Failure> {
        let [table_path, background_path] =
            ["calibration.json", "background.png"].map(|end| self.out.with_extension(end));
        let table = table.map(|table| [to_json_line(table).as_slice(), b"\n"].concat());
        let picture = encode_rgb(background.width() as usize, background.height() as usize, background);
        let sensor = Sensor {
            background: Some(file_name(&background_path)),
            background_sha256: Some(sha256(&picture)),
            calibration: table.is_some().then(|| file_name(&table_path)),
            calibration_sha256: table.as_deref().map(sha256),
            ..sensor
        };
        let text = format_sensor(&sensor, false)?;
        self.create_parent_folder()?;
        write_file(&background_path, &picture)?;
        if let Some(table) = &table {
            write_file(&table_path, table)?;
        }
        if let Some((path, page)) = page {
            write_file(path, page.as_bytes())?;
        }
        write_file(&self.out, format!("{}\n{text}", format_header(about)).as_bytes())
    }
}

/// Collects what speaks against the presses and their table before the fit, the likely causes first.
fn find_doubts_before_fit(
    session: &Session,
    request: &CalibrationRequest,
    named: Option<(&str, [f64; 2])>,
    doubts: &[Vec<OutlierReason>],
) -> Findings {
    let mut findings = Findings::default();
    findings.extend(scale::judge_scale(session, request.contact_over_disc, named));
    findings.extend(judge::judge_images(session));
    // A wrong scale or background spoils every press: name that cause, not each press.
    if !findings.are_hopeless() {
        findings.extend(fit::judge_contacts(session, request.thickness_mm, request.contact_over_disc));
        findings.extend(fit::judge_doubts(doubts));
        findings.extend(collect_warnings(session.observations.iter().map(|press| press.file.as_str()).zip(doubts)));
    }
    findings
}

/// Collects what speaks against the fit, and what the fit says against its presses. `is_short` says that the training
/// was cut short.
fn find_doubts_after_fit(found: &Calibration, is_short: bool) -> Findings {
    let all = found.session.observations.len();
    let doubtful = found.outlier_reasons.iter().filter(|doubts| !doubts.is_empty()).count();
    let mut findings = Findings::default();
    findings.extend(fit::judge_leds(&found.leds));
    findings.extend(found.verdict.to_finding(doubtful, all, is_short));
    let left_out = found.dropped.iter().map(|(file, doubts)| (file.as_str(), doubts));
    findings.extend(left_out.flat_map(|(file, _)| {
        let message = format!("{file} left out");
        Some(Diagnostic::warning(message).about(file, "presses are left out, for the reasons above"))
    }));
    let files = found.session.observations.iter().map(|press| press.file.as_str());
    let new =
        found.outlier_reasons.iter().map(|doubts| doubts.iter().filter(|doubt| doubt.is_of_fit()).copied().collect());
    let new: Vec<Vec<OutlierReason>> = new.collect();
    let of_fit: Vec<Vec<OutlierReason>> = found
        .dropped
        .iter()
        .map(|(_, doubts)| doubts.iter().filter(|doubt| doubt.is_of_fit()).copied().collect())
        .collect();
    findings.extend(collect_warnings(found.dropped.iter().map(|(file, _)| file.as_str()).zip(&of_fit)));
    findings.extend(collect_warnings(files.zip(&new)));
    findings
}

/// Returns the doubts about each press as warnings.
fn collect_warnings<'a>(presses: impl Iterator<Item = (&'a str, &'a Vec<OutlierReason>)>) -> Vec<Diagnostic> {
    presses.flat_map(|(file, doubts)| doubts.iter().map(move |doubt| doubt.to_warning(file))).collect()
}

/// Builds a report in which diagnostics of one cause are folded into one.
fn build_report(all: Vec<Diagnostic>) -> Report {
    let mut folded = Diagnostics::default();
    folded.extend(all);
    Report::new(&folded, &[])
}

/// Returns the failure of a calibration that got no result.
fn explain_unfit(unfit: &CalibrationError, count: usize) -> Failure {
    match unfit {
        CalibrationError::NoPixel => user_error(
            "no pixel of the presses can be learnt from: they are out of view, or white in the background",
            "look at the circles in the table, and at the background image",
        )
        .into(),
        CalibrationError::TooFew(dropped) => {
            let message = format!(
                "of {count} presses {} are usable, and {} are needed",
                count - dropped.len(),
                session::MIN_PRESSES
            );
            let help = if dropped.is_empty() {
                "add presses to the table"
            } else {
                "correct those that the warnings name, or leave --drop-bad out"
            };
            let first = Diagnostic::new(message).help(help);
            // Doubts that need no fit were reported before it.
            let of_fit = |doubts: &[OutlierReason]| doubts.iter().filter(|doubt| doubt.is_of_fit()).copied().collect();
            let new: Vec<(&str, Vec<OutlierReason>)> =
                dropped.iter().map(|(file, doubts)| (file.as_str(), of_fit(doubts))).collect();
            let why = collect_warnings(new.iter().map(|(file, doubts)| (*file, doubts)));
            build_report([vec![first], why].concat()).into()
        }
    }
}

/// Fails if the fit is outside the range of a sensor file, so that no job would accept it.
fn check_representable(sensor: &Sensor, table: Option<&CalibrationTable>) -> Result<(), Failure> {
    let mut wrong = standalone::find_out_of_range(sensor);
    if let Some(Err(reason)) = table.map(|table| calibration::parse_calibration(&to_json_line(table))) {
        wrong.push(Diagnostic::new(reason));
    }
    if wrong.is_empty() {
        return Ok(());
    }
    let message = "what was fitted is out of the range of a sensor file, and nothing is written";
    let help = "check `ball_radius_mm`, `mm_per_px`, the circles, and --sensor, from which comes what is not fitted";
    wrong.insert(0, Diagnostic::new(message).help(help));
    Log::plain_text(false).print_notes(&build_report(wrong));
    Err(Failure::already_reported(1))
}

/// Returns the note on dots that are printed on the pad; `None` without dots.
fn note_printed_dots(session: &Session) -> Option<Diagnostic> {
    let printed = session.printed.as_ref()?;
    let (_, figures) = summarise_dots(session).into_iter().next()?;
    let help = match printed.dots.to_markers(session.camera.mm_per_px[0]) {
        Some(_) => {
            "what they cover is not learnt; the background image is written without them, and they stand under [markers] in the \
                    sensor file, so that they move with the pad"
        }
        None => {
            "what they cover is not learnt; the background image keeps them, where they do not move: for dots that do, give it \
                 without dots, and write a [markers] table"
        }
    };
    Some(Diagnostic::note(format!("dots are printed on the pad: {figures}")).help(help))
}

/// Returns the background image to write: with dots only if no [markers] table can describe them.
fn written_background(session: &Session) -> &RgbImage {
    match &session.printed {
        Some(printed) if printed.dots.to_markers(session.camera.mm_per_px[0]).is_none() => &printed.background,
        _ => &session.background,
    }
}

/// Returns the sensor with the dots that are printed on its pad.
fn with_print(sensor: Sensor, session: &Session) -> Sensor {
    let print = session.printed.as_ref().map(|printed| printed.dots.to_markers(session.camera.mm_per_px[0]));
    match print {
        Some(markers) => Sensor { markers, ..sensor },
        None => sensor,
    }
}

/// Returns the sensor with these LEDs. They were fitted to light that darkens with depth, so the sensor has no
/// darkening of its own.
fn with_leds(sensor: Sensor, found: &FittedLeds) -> Sensor {
    let (led, stray_light) = (found.leds.clone(), Some(found.stray_light));
    // The residual that the sensor had belongs to other LEDs.
    Sensor { led, stray_light, light_residual: None, darkening: 0.0, ..sensor }
}

/// Returns the sensor with the measured camera, if there is one.
fn with_camera(sensor: Sensor, found: Option<&MeasuredCamera>) -> Sensor {
    let Some(found) = found else { return sensor };
    let camera = found.to_distribution(sensor.camera.unwrap_or_default());
    Sensor { camera: Some(camera), ..sensor }
}

/// Formats the keys of a sensor file. Lamps describe the untouched pad themselves, so that a rendered background has no
/// meaning beside them.
fn format_sensor(sensor: &Sensor, has_lamps: bool) -> Result<String, Failure> {
    let internal = |error: toml::ser::Error| Failure::runtime(error.to_string());
    if !has_lamps {
        return toml::to_string(sensor).map_err(internal);
    }
    let mut keys = toml::Table::try_from(sensor).map_err(internal)?;
    keys.remove("rendered_background");
    toml::to_string(&keys).map_err(internal)
}

/// Formats the comment at the head of a sensor file.
fn format_header(about: &[(String, String)]) -> String {
    let about: String = about.iter().map(|(what, figure)| format!("# {what}: {figure}\n")).collect();
    format!("# Written by gelsim calibrate.\n{about}")
}

/// Renders the HTML page of a calibration.
fn render_page(name: &str, found: &Calibration, summary: &[(String, String)], warnings: &[String]) -> String {
    let presses = found.session.observations.iter().zip(&found.held_out).zip(&found.outlier_reasons);
    let shown: Vec<PressPanel> = presses
        .map(|((observation, held_out), outlier_reasons)| PressPanel {
            file: observation.file.clone(),
            real: observation.image.clone(),
            simulated: held_out.simulated.clone(),
            circle: Some(observation.circle),
            scores: held_out.scores,
            outlier_reasons: panel_texts(observation.confidence, outlier_reasons),
        })
        .collect();
    let normals = found.color_discs();
    let verdict = (found.verdict.to_sentence(), found.verdict.is_hopeless());
    CalibrationPage { sensor: name, verdict, summary, warnings, presses: &shown, normals: &normals }.to_html()
}

/// Returns the lines below the pictures of a press: how sure its circle is, and the doubts about it.
fn panel_texts(confidence: Option<f64>, doubts: &[OutlierReason]) -> Vec<String> {
    let found = confidence.map(|confidence| format!("its circle was found, {:.0} % sure", 100.0 * confidence));
    found.into_iter().chain(doubts.iter().map(ToString::to_string)).collect()
}

fn file_name(path: &Path) -> String {
    path.file_name().map_or_else(String::new, |name| name.to_string_lossy().into_owned())
}

fn write_file(path: &Path, bytes: &[u8]) -> Result<(), Failure> {
    write_output(path, bytes).map_err(|error| denied_failure(path, &error))
}

/// Returns the failure of a path that the system refused, with what to do about it.
fn denied_failure(path: &Path, error: &io::Error) -> Failure {
    Failure::access_denied(&format!("{}: {error}", path.display()), error, "choose another place with --out")
}

fn path_failure(path: &Path, error: &dyn std::fmt::Display) -> Failure {
    Failure::runtime(format!("{}: {error}", path.display()))
}
