//! `gelsim calibrate`

mod summary;

use std::fs;
use std::path::{Path, PathBuf};

use clap::Args;
use image::RgbImage;

use self::summary::{HEAD, camera_summary, leds_summary, lines, row, summary};
use super::guesses::whole;
use super::store::local_output;
use super::{Failure, checked_threads, no_threads, print, say};
use crate::core::fidelity::Fidelity;
use crate::core::optics::calibrated::{Colors, Table};
use crate::dataset::encode::json;
use crate::files::diagnostic::user_error;
use crate::files::hash::sha256;
use crate::files::png::encode_rgb;
use crate::files::sensor::Sensor;
use crate::files::write::write_output;
use crate::job::plan::standalone;
use crate::lab::calibrate::camera::{MeasuredCamera, measure};
use crate::lab::calibrate::evaluate::{Evaluated, evaluate, picture_name};
use crate::lab::calibrate::gelsight::{self, Left};
use crate::lab::calibrate::leds::FittedLeds;
use crate::lab::calibrate::page::{Page, PressPanel};
use crate::lab::calibrate::run::{Calibration, Request, run, run_leds};
use crate::lab::calibrate::taxim::{Imported, import};
use crate::lab::calibrate::train::Settings;
use crate::lab::calibrate::{Geometry, Session, session, surfaces};
use crate::lab::compare::score::Score;

/// Fit the light of a real sensor to presses of a ball, or simulate presses with a sensor that was fitted.
#[derive(Debug, Args)]
#[command(after_help = "\
Example:
  gelsim calibrate presses.csv --background untouched.png --out mine.toml
  gelsim calibrate --leds three.csv --background untouched.png --out mine.toml
  gelsim calibrate --evaluate others.csv --sensor mine.toml --out simulated
  gelsim calibrate --taxim taxim/calib/gelsight --out mine.toml
  gelsim calibrate --gelsight devices/series2_2EF6_4JNW.yaml --out mine.toml

PRESSES.csv has a row for each picture of a ball in the pad: file, centre_x_px, centre_y_px, radius_px of the visible \
disc, ball_radius_mm, mm_per_px; paths are relative to it. Beside mine.toml come mine.calibration.json, \
mine.background.png and mine.html, a page of plots and pictures. In a job: [sensor] file = \"mine.toml\".")]
pub struct Calibrate {
    /// The table of presses to learn from
    #[arg(value_name = "PRESSES.csv", required_unless_present_any = ["evaluate", "taxim", "gelsight"])]
    #[arg(conflicts_with_all = ["evaluate", "taxim", "gelsight"], requires = "background")]
    presses: Option<PathBuf>,
    /// Background image: the untouched pad
    #[arg(long, value_name = "BG.png", conflicts_with_all = ["evaluate", "taxim", "gelsight"])]
    background: Option<PathBuf>,
    /// Take over a calibration of Taxim's: a folder with polycalib.npz, dataPack.npz and params.json
    #[arg(long, value_name = "DIR", conflicts_with_all = ["evaluate", "detect", "drop_bad", "contact_over_disc"])]
    taxim: Option<PathBuf>,
    /// Take over a calibration that GelSight publishes: the YAML file of a device, beside its flat field as PNG
    #[arg(long, value_name = "DEVICE.yaml", conflicts_with_all = ["evaluate", "taxim", "detect", "drop_bad", "contact_over_disc"])]
    gelsight: Option<PathBuf>,
    /// Simulate the presses of this table from circle and ball alone, and say how far they are from the images
    #[arg(long, value_name = "PRESSES.csv", requires = "sensor")]
    evaluate: Option<PathBuf>,
    /// With --evaluate the sensor; else a preset or a sensor file from which comes what is not fitted
    #[arg(long, value_name = "PRESET|SENSOR.toml")]
    sensor: Option<String>,
    /// The sensor file to write; with --evaluate the folder for the pictures
    #[arg(short, long, value_name = "SENSOR.toml|DIR", value_parser = local_output())]
    out: PathBuf,
    /// Fit the LEDs alone, for the optics models phong and led: three presses are enough
    #[arg(long, conflicts_with_all = ["evaluate", "taxim", "gelsight", "drop_bad", "steps"])]
    leds: bool,
    /// Folder for the pad's surface under each press as arrays (mm), normals and contact masks: labels for the images
    #[arg(long, value_name = "DIR", conflicts_with_all = ["evaluate", "taxim", "gelsight"])]
    surfaces: Option<PathBuf>,
    /// Look for circles that the table lacks, and say how sure each is
    #[arg(long, conflicts_with = "evaluate")]
    detect: bool,
    /// Leave out presses that may be unusable
    #[arg(long, conflicts_with = "evaluate")]
    drop_bad: bool,
    /// Thickness of the pad, mm [default: chosen]
    #[arg(long, value_name = "MM", value_parser = above_zero, conflicts_with = "evaluate")]
    thickness_mm: Option<f64>,
    /// Radius of the contact over that of the visible disc [default: chosen; with --leds 0.95; with --evaluate the sensor's,
    /// or 0.95]
    #[arg(long, value_name = "FRACTION", value_parser = fraction)]
    contact_over_disc: Option<f64>,
    /// Steps of training; fewer are quicker and less exact [default: 1500]
    #[arg(long, value_name = "N", value_parser = steps)]
    #[arg(conflicts_with_all = ["evaluate", "taxim", "gelsight"])]
    steps: Option<u32>,
    /// Threads [default: all cores]
    #[arg(short = 'j', long, value_name = "T", value_parser = whole::<usize>)]
    threads: Option<usize>,
    /// Fidelity level for --evaluate
    #[arg(long, value_name = "LEVEL", value_parser = super::fidelity_level(), default_value = "standard", requires = "evaluate")]
    fidelity: Fidelity,
}

/// What of a gel that has a shape cannot be calibrated, and what to do instead.
const FLAT_ONLY: [&str; 2] = [
    "balls are calibrated on flat pads, and the sensor's gel has a shape: a circle gives the depth of a ball from the size of a pixel on \
     the pad, which differs from place to place there, and light that is learnt by normals alone holds in one place only",
    "write the sensor file by hand: `background` (a photograph of the untouched gel) and an [[led]] table for each LED; then press the \
     balls by a job and hold the images against the real ones with gelsim compare",
];

fn above_zero(text: &str) -> Result<f64, String> {
    match text.parse::<f64>() {
        Ok(value) if (1e-2..=1e3).contains(&value) => Ok(value),
        _ => Err(String::from("write a number from 0.01 to 1000")),
    }
}

fn steps(text: &str) -> Result<u32, String> {
    whole(text).and_then(|steps| match (1..=1_000_000).contains(&steps) {
        true => Ok(steps),
        false => Err(String::from("write a whole number from 1 to 1000000")),
    })
}

/// What a table of measured light may hold.
fn fraction(text: &str) -> Result<f64, String> {
    match text.parse::<f64>() {
        Ok(value) if (0.1..=10.0).contains(&value) => Ok(value),
        _ => Err(String::from("write a number from 0.1 to 10")),
    }
}

impl Calibrate {
    pub(super) fn run(self) -> Result<(), Failure> {
        match checked_threads(self.threads)? {
            None => self.run_here(),
            Some(threads) => {
                let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build();
                pool.map_err(|error| no_threads(&error))?.install(|| self.run_here())
            }
        }
    }

    /// Runs on the threads of the pool that this is called in.
    fn run_here(&self) -> Result<(), Failure> {
        if let (Some(table), Some(sensor)) = (&self.evaluate, &self.sensor) {
            return self.evaluate(table, sensor);
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
            surfaces::check(folder)?;
            let within = |path: &Path| std::path::absolute(path).map_err(|error| failed(path, &error));
            if within(&self.out)?.starts_with(within(folder)?) {
                let message = format!("{} would be among the surfaces", self.out.display());
                return Err(user_error(message, "choose another folder with --surfaces").into());
            }
        }
        let start = match &self.sensor {
            Some(name) => standalone::flat_sensor(name, FLAT_ONLY)?.written,
            None => Sensor::default(),
        };
        match (&self.presses, &self.background, &self.taxim, &self.gelsight) {
            (Some(presses), Some(background), ..) => self.calibrate(presses, background, start),
            (_, _, Some(folder), _) => self.import(folder, start),
            (.., Some(device)) => self.import_lamps(device, start),
            _ => Err(user_error("nothing to calibrate", "see gelsim calibrate --help").into()),
        }
    }

    fn evaluate(&self, table: &Path, sensor: &str) -> Result<(), Failure> {
        let sensor = standalone::flat_sensor(sensor, FLAT_ONLY)?.sensor;
        if self.out.exists() && !self.out.is_dir() {
            return Err(
                user_error(format!("{} is not a folder", self.out.display()), "choose a folder with --out").into()
            );
        }
        let presses = evaluate(table, &sensor, self.contact_over_disc, self.fidelity)?;
        fs::create_dir_all(&self.out).map_err(|error| failed(&self.out, &error))?;
        let mut lines = Vec::new();
        for Evaluated { file, simulated, scores, warnings } in &presses {
            warnings.iter().for_each(|warning| say(&format!("warning: {file}: {warning}")));
            let path = self.out.join(picture_name(file));
            let [width, height] = sensor.resolution_px;
            write(&path, &encode_rgb(width, height, simulated))?;
            let figures = scores.as_ref().map(|scores| row(scores.contact.as_ref(), Some(&scores.full_image)));
            lines.push(format!("{file:<28} {}", figures.unwrap_or_default()));
        }
        let scores: Vec<_> = presses.iter().filter_map(|press| press.scores.as_ref()).collect();
        let contact = Score::mean(scores.iter().filter_map(|scores| scores.contact.as_ref()));
        let full_image = Score::mean(scores.iter().map(|scores| &scores.full_image));
        let total = format!("mean of {}", scores.len());
        lines.push(format!("{total:<28} {}", row(contact.as_ref(), full_image.as_ref())));
        print(&format!("{:<28} {}\n{}\n", "", HEAD, lines.join("\n")))?;
        say(&format!("-> {}", self.out.display()));
        Ok(())
    }

    fn calibrate(&self, presses: &Path, background: &Path, sensor: Sensor) -> Result<(), Failure> {
        let fewest = if self.leds { session::FEWEST_FOR_LEDS } else { session::FEWEST };
        let (session, notes) = session::read(presses, background, sensor, self.detect, fewest)?;
        notes.iter().for_each(|note| say(&format!("note: {note}")));
        let defaults = Settings::default();
        let request = Request {
            settings: Settings { steps: self.steps.map_or(defaults.steps, |steps| steps as usize), ..defaults },
            thickness_mm: self.thickness_mm,
            contact_over_disc: self.contact_over_disc,
            drops_bad: self.drop_bad,
        };
        if self.leds {
            return self.fit_leds(&session, &request);
        }
        let count = session.observations.len();
        let Some(found) = run(session, &request) else {
            let message = format!("of {count} presses too few are usable");
            return Err(user_error(message, "leave --drop-bad out to see what speaks against each").into());
        };
        let mut warnings = Vec::new();
        for (file, doubts) in &found.dropped {
            warnings.push(format!("{file} left out: {}", doubts.join("; ")));
        }
        for (observation, doubts) in
            found.session.observations.iter().zip(&found.outlier_reasons).filter(|(_, doubts)| !doubts.is_empty())
        {
            warnings.push(format!("{}: {}", observation.file, doubts.join("; ")));
        }
        warnings.iter().for_each(|warning| say(&format!("warning: {warning}")));

        let summary = summary(&found);
        let sensor = with_leds(found.session.sensor(found.geometry.thickness_mm), &found.leds);
        let sensor = with_camera(sensor, found.camera.as_ref());
        self.write_surfaces(&found.session, found.geometry)?;
        let page_path = self.out.with_extension("html");
        let page = page(&self.name(), &found, &summary, &warnings);
        self.write_sensor(sensor, &found.session.background, Some(&found.table), &summary, Some((&page_path, page)))?;
        print(&lines(&summary))?;
        say(&format!("-> {}, {}", self.out.display(), page_path.display()));
        Ok(())
    }

    /// Fits the LEDs alone.
    fn fit_leds(&self, session: &Session, request: &Request) -> Result<(), Failure> {
        let geometry = request.geometry(session);
        let found = run_leds(session, geometry).ok_or_else(|| {
            user_error("no pixel of the presses can be learnt from", "they are out of view, or the background is white")
        })?;
        let camera = measure(session);
        let sensor = with_camera(with_leds(session.sensor(geometry.thickness_mm), &found), camera.as_ref());
        self.write_surfaces(session, geometry)?;
        let about = [leds_summary(&found), camera_summary(camera.as_ref())].concat();
        self.write_sensor(sensor, &session.background, None, &about, None)?;
        print(&lines(&about))?;
        say(&format!("-> {}", self.out.display()));
        Ok(())
    }

    fn import(&self, folder: &Path, sensor: Sensor) -> Result<(), Failure> {
        let Imported { name, resolution_px, field_of_view_mm, background, colors } = import(folder)?;
        let thickness_mm = self.thickness_mm.unwrap_or(sensor.gelpad_thickness_mm);
        let sensor = Sensor { resolution_px, field_of_view_mm, gelpad_thickness_mm: thickness_mm, ..sensor };
        let about = [(String::from("colours"), format!("Taxim's of {name}"))];
        self.write_sensor(sensor, &background, Some(&Table::new(Colors::Taxim(colors), 1.0)), &about, None)?;
        say(&format!("-> {}", self.out.display()));
        Ok(())
    }

    fn import_lamps(&self, device: &Path, sensor: Sensor) -> Result<(), Failure> {
        let gelsight::Imported { name, resolution_px, field_of_view_mm, lamps, flat_field } = gelsight::import(device)?;
        let mut about = vec![(String::from("lamps"), format!("GelSight's of {name}"))];
        match flat_field {
            Err(reason) => {
                say(&format!("warning: {reason}: the flat field is taken as even, images lack the vignetting"))
            }
            Ok(fitted) => about.extend(lamps.iter().zip(fitted).map(|(lamp, Left { rms, most })| {
                let left = format!("{rms:.2} grey levels RMS left by the polynomial, {most:.1} at most");
                (format!("flat field of lamp {}", lamp.name), left)
            })),
        }
        about.push((
            String::from("gelpad"),
            String::from("not in the calibration: thickness and stiffness are nominal"),
        ));
        let sensor = Sensor {
            name: self.name(),
            preset: None,
            file: None,
            resolution_px,
            field_of_view_mm,
            gelpad_thickness_mm: self.thickness_mm.unwrap_or(sensor.gelpad_thickness_mm),
            background: None,
            background_sha256: None,
            calibration: None,
            calibration_sha256: None,
            darkening: 0.0,
            stray_light: None,
            light_residual: None,
            led: Vec::new(),
            lamp: Vec::new(),
            unit: None,
            ..sensor
        };
        let internal = |error: toml::ser::Error| Failure::running(error.to_string());
        let mut table = toml::Table::try_from(&sensor).map_err(internal)?;
        // The lamps show the untouched pad.
        table.remove("rendered_background");
        let text = toml::to_string(&table).map_err(internal)?;
        let text = format!("{}\n{text}{}", head(&about), gelsight::tables(&lamps));
        self.make_folder()?;
        write(&self.out, text.as_bytes())?;
        print(&lines(&about))?;
        say(&format!("-> {}", self.out.display()));
        Ok(())
    }

    /// Makes the folder of the sensor file.
    fn make_folder(&self) -> Result<(), Failure> {
        match self.out.parent().filter(|folder| !folder.as_os_str().is_empty()) {
            Some(folder) => fs::create_dir_all(folder).map_err(|error| failed(folder, &error)),
            None => Ok(()),
        }
    }

    fn write_surfaces(&self, session: &Session, geometry: Geometry) -> Result<(), Failure> {
        let Some(folder) = &self.surfaces else { return Ok(()) };
        surfaces::write(session, geometry, folder).map_err(|(path, error)| failed(&path, &error))
    }

    /// The sensor's name.
    fn name(&self) -> String {
        self.out.file_stem().map_or_else(String::new, |stem| stem.to_string_lossy().into_owned())
    }

    /// Writes the sensor file last: what it names is there then.
    fn write_sensor(
        &self,
        sensor: Sensor,
        background: &RgbImage,
        table: Option<&Table>,
        about: &[(String, String)],
        page: Option<(&Path, String)>,
    ) -> Result<(), Failure> {
        let [table_path, background_path] =
            ["calibration.json", "background.png"].map(|end| self.out.with_extension(end));
        let table = table.map(|table| [json(table).as_slice(), b"\n"].concat());
        let picture = encode_rgb(background.width() as usize, background.height() as usize, background);
        let sensor = Sensor {
            name: self.name(),
            preset: None,
            file: None,
            background: Some(file_name(&background_path)),
            background_sha256: Some(sha256(&picture)),
            calibration: table.is_some().then(|| file_name(&table_path)),
            calibration_sha256: table.as_deref().map(sha256),
            // What was fitted takes the place of another sensor's lamps.
            led: if sensor.led.is_empty() { Sensor::default().led } else { sensor.led },
            lamp: Vec::new(),
            ..sensor
        };
        let text = toml::to_string(&sensor).map_err(|error| Failure::running(error.to_string()))?;
        self.make_folder()?;
        write(&background_path, &picture)?;
        if let Some(table) = &table {
            write(&table_path, table)?;
        }
        if let Some((path, page)) = page {
            write(path, page.as_bytes())?;
        }
        write(&self.out, format!("{}\n{text}", head(about)).as_bytes())
    }
}

/// A sensor with these LEDs. What darkens with depth is in the light that they were fitted to.
fn with_leds(sensor: Sensor, found: &FittedLeds) -> Sensor {
    let (led, stray_light) = (found.leds.clone(), Some(found.stray_light));
    // What other LEDs left unexplained is not what these leave.
    Sensor { led, stray_light, light_residual: None, darkening: 0.0, ..sensor }
}

/// A sensor with this camera, as far as it was measured.
fn with_camera(sensor: Sensor, found: Option<&MeasuredCamera>) -> Sensor {
    let Some(found) = found else { return sensor };
    let camera = found.distribution(sensor.camera.unwrap_or_default());
    Sensor { camera: Some(camera), ..sensor }
}

/// The comment at the head of a sensor file.
fn head(about: &[(String, String)]) -> String {
    let about: String = about.iter().map(|(what, figure)| format!("# {what}: {figure}\n")).collect();
    format!("# Written by gelsim calibrate.\n{about}")
}

fn page(name: &str, found: &Calibration, summary: &[(String, String)], warnings: &[String]) -> String {
    let presses = found.session.observations.iter().zip(&found.held_out).zip(&found.outlier_reasons);
    let shown: Vec<PressPanel> = presses
        .map(|((observation, held_out), outlier_reasons)| PressPanel {
            file: observation.file.clone(),
            real: observation.image.clone(),
            simulated: held_out.simulated.clone(),
            circle: Some(observation.circle),
            scores: held_out.scores,
            outlier_reasons: outlier_reasons.clone(),
        })
        .collect();
    let normals = found.colors();
    Page { sensor: name, summary, warnings, presses: &shown, normals: &normals }.html()
}

fn file_name(path: &Path) -> String {
    path.file_name().map_or_else(String::new, |name| name.to_string_lossy().into_owned())
}

fn write(path: &Path, bytes: &[u8]) -> Result<(), Failure> {
    write_output(path, bytes).map_err(|error| failed(path, &error))
}

fn failed(path: &Path, error: &dyn std::fmt::Display) -> Failure {
    Failure::running(format!("{}: {error}", path.display()))
}
