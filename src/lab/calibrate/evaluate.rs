//! Simulates presses that a sensor file never saw, from circle and ball alone: `gelsim calibrate --evaluate`.

use gelsim_core::sensor::{Background, Sensor};
use gelsim_core::simulator::Simulator;
use gelsim_core::simulator::Stages;
use std::path::Path;

use image::RgbImage;
use rayon::prelude::*;

use super::detect::detect;
use super::dots::Dots;
use super::geometry::{Ball, Balls};
use super::judge::{Findings, background, circles, scale};
use super::outliers::OutlierReason;
use super::pixels::DILATE;
use super::{Geometry, Observation, Session, picture, session};
use crate::compare::score::{Scores, score};
use crate::presses::{self, Circle, Column, Press, Table};
use gelsim_core::effects::EffectPolicy;
use gelsim_core::fidelity::Fidelity;
use gelsim_files::diagnostic::{Diagnostic, Diagnostics, Report, Severity};
use gelsim_files::image_file;
use gelsim_files::sensor;

/// A simulated press.
pub struct EvaluatedPress {
    /// The image's file, as the table has it.
    pub file: String,
    /// The picture.
    pub simulated: RgbImage,
    /// How far it is from the real one, if that is there.
    pub scores: Option<Scores>,
    /// How far the background alone is from the real one.
    pub bare: Option<Scores>,
}

/// Presses of a table, simulated.
pub struct Evaluation {
    /// One for each row.
    pub presses: Vec<EvaluatedPress>,
    /// What speaks against table, images and sensor.
    pub findings: Findings,
}

/// How presses are simulated.
#[derive(Clone, Copy, Debug)]
pub struct Options {
    /// Radius of the contact over that of the visible disc; if nothing is said, as the sensor's calibration found it, or as
    /// usual.
    pub contact_over_disc: Option<f64>,
    /// Fidelity level.
    pub fidelity: Fidelity,
    /// Look for circles that the table lacks.
    pub detects: bool,
}

/// Simulates the presses of a table. On failure, every mistake in the table.
pub fn evaluate(table: &Path, sensor: &Sensor, options: Options) -> Result<Evaluation, Report> {
    let table = presses::read(table)?;
    // The presses are of a smooth, flat pad; noise would be an error of its own.
    let mut still = sensor.camera;
    (still.shot_noise_levels, still.read_noise_levels, still.speckle_levels) = (0.0, 0.0, 0.0);
    let is_printed = sensor.markers.is_some();
    let is_photograph = matches!(sensor.background, Background::Photograph(_));
    let mut sensor = sensor.clone();
    (sensor.rest_surface, sensor.coating, sensor.camera) = (None, None, still);
    let models = options.fidelity.models(sensor.light_source());
    let simulator = Simulator::with_models(sensor, models, EffectPolicy::WhereNeeded);
    let rest = simulator.background();
    let untouched = RgbImage::from_raw(rest.width as u32, rest.height as u32, rest.rgb.clone());
    let untouched = untouched.expect("three bytes for each pixel of the background");

    let read =
        |press: &Press| session::picture(&press.path).map(|image| if is_printed { without_dots(image) } else { image });
    let images: Vec<Result<RgbImage, String>> = table.presses.par_iter().map(read).collect();
    let (mut problems, unusable) = (Diagnostics::default(), unusable(&table, &images, &untouched));
    let circles = circles_of(&table, &images, &untouched, options.detects, &mut problems);
    mistakes(&table, &mut problems);
    if unusable.len() == table.presses.len() {
        problems.extend(unusable.iter().cloned());
    }
    if !problems.is_empty() {
        return Err(table.report(&problems));
    }
    let balls = Balls::new(table.presses.iter().filter_map(|press| press.ball_radius_mm), &simulator.sensor().gelpad);
    let calibrated = simulator.sensor().calibration.as_ref().map(|table| table.contact_over_disc);
    let contact_over_disc = options.contact_over_disc.or(calibrated).unwrap_or(Geometry::USUAL_CONTACT);
    let rows = table.presses.par_iter().zip(&circles).zip(&images);
    let one = |((press, circle), image): ((&Press, &Option<Circle>), &Result<RgbImage, String>)| {
        let ball = balls.of_radius(press.ball_radius_mm?);
        let of_size = image.as_ref().ok().filter(|image| image.dimensions() == untouched.dimensions());
        Some(simulate(press, (*circle)?, ball, contact_over_disc, &simulator, of_size.map(|image| (image, &untouched))))
    };
    let (presses, too_large): (Vec<EvaluatedPress>, Vec<bool>) = rows.filter_map(one).unzip();
    let session = of_images(&table, &circles, images, untouched, &simulator);
    let as_warning = |found: Diagnostic| Diagnostic { severity: Severity::Warning, ..found };
    let mut findings = Findings::default();
    findings.extend(scale::findings(&session, None));
    if is_photograph {
        let circles = circles::findings(&session);
        // A sensor may be held against images of another unit.
        let other_pad = background::findings(&session);
        let is_same_pad = other_pad.is_empty();
        let of_pad = |found| Diagnostic { help: Some(OTHER_PAD.to_owned()), ..as_warning(found) };
        findings.extend(circles.into_iter().filter(|_| is_same_pad));
        findings.extend(other_pad.into_iter().map(of_pad));
    }
    let large = too_large.iter().filter(|too_large| **too_large).count();
    if 2 * large >= too_large.len() && !findings.are_hopeless() {
        let message = format!("{large} of {} circles are larger than any contact of their balls", too_large.len());
        let help = "check `radius_px`, which is the radius of the disc and not its diameter, and `ball_radius_mm`; and \
                    --contact-over-disc, if it is given";
        findings.extend([Diagnostic::new(message).help(help)]);
    }
    findings.extend(unusable.into_iter().map(as_warning));
    findings.extend(other_pitches(&table, simulator.view().mm_per_px[0]));
    let deepest = table.presses.iter().zip(too_large).filter(|(_, too_large)| *too_large);
    findings.extend(deepest.map(|(press, _)| {
        let found = OutlierReason::TooLarge.warning(&press.file);
        found.help("the deepest press is shown: correct `radius_px` or `ball_radius_mm`, or leave the rows out")
    }));
    Ok(Evaluation { presses, findings })
}

const OTHER_PAD: &str =
    "the errors below are those of this difference, too: name the sensor file of these images with --sensor";

/// The image without dots, if there are any.
fn without_dots(image: RgbImage) -> RgbImage {
    match Dots::find(&image) {
        Some((_, cleared)) => cleared.image,
        None => image,
    }
}

/// Rows whose image cannot be held against the simulated one.
fn unusable(table: &Table, images: &[Result<RgbImage, String>], untouched: &RgbImage) -> Vec<Diagnostic> {
    let size = |image: &RgbImage| format!("{}x{} px", image.width(), image.height());
    let own = size(untouched);
    let rows = table.presses.iter().zip(images);
    let one = |(press, image): (&Press, &Result<RgbImage, String>)| match image {
        Err(reason) => Some(session::unreadable(table, press, reason)),
        Ok(image) if image.dimensions() != untouched.dimensions() => {
            let message = format!("{} is {}, the sensor {own}", press.file, size(image));
            let cause = format!("images are {}, and the sensor {own}", size(image));
            let help = format!("resize them to {own}, or name the sensor of these images with --sensor");
            Some(table.problem(press.line, message).of(press.file.as_str(), cause).help(help))
        }
        Ok(_) => None,
    };
    rows.filter_map(one).collect()
}

/// The circle of each row, looked for where that is wished.
fn circles_of(
    table: &Table,
    images: &[Result<RgbImage, String>],
    untouched: &RgbImage,
    detects: bool,
    problems: &mut Diagnostics,
) -> Vec<Option<Circle>> {
    let look = |(press, image): (&Press, &Result<RgbImage, String>)| match (press.circle, image) {
        (None, Ok(image)) if detects && image.dimensions() == untouched.dimensions() => {
            detect(image, untouched).map(|found| found.circle)
        }
        (circle, _) => circle,
    };
    let circles: Vec<Option<Circle>> = table.presses.par_iter().zip(images).map(look).collect();
    for (press, _) in table.presses.iter().zip(&circles).filter(|(_, circle)| circle.is_none()) {
        let problem = table.problem(press.line, format!("{}: no circle", press.file));
        let (cause, help) = if detects {
            ("images show no press that is found", "write the circle into the table, or leave the row out")
        } else {
            (
                "images have no circle in the table",
                "write the circle into the table, or add --detect to have it looked for",
            )
        };
        problems.push(problem.of(press.file.as_str(), cause).help(help));
    }
    circles
}

/// What else of a table cannot be simulated.
fn mistakes(table: &Table, problems: &mut Diagnostics) {
    let mut names: Vec<String> = Vec::new();
    for press in &table.presses {
        let name = picture_name(&press.file);
        if names.contains(&name) {
            let problem = table.problem(press.line, format!("{}: a second picture would be called {name}", press.file));
            let problem = problem.of(press.file.as_str(), "pictures would have the name of another one");
            problems.push(problem.help(format!(
                "rename the images, or write a table for each folder: pictures have the names of the images ({}) without \
                 folders, and end in .png",
                image_file::NAMES
            )));
        }
        names.push(name);
    }
    match table.lacks(Column::BallRadius, "the radius of the ball in mm") {
        Some(lacking) => problems.push(lacking),
        None => {
            for press in table.presses.iter().filter(|press| press.ball_radius_mm.is_none()) {
                let problem = table.problem(press.line, format!("{}: no ball_radius_mm", press.file));
                let problem = problem.of(press.file.as_str(), "rows have no `ball_radius_mm`");
                problems.push(problem.help("write the radius of the ball in mm into every row"));
            }
        }
    }
}

/// Rows with another size of pixels than the sensor's, which counts.
fn other_pitches(table: &Table, own: f64) -> Vec<Diagnostic> {
    let odd = table.presses.iter().filter_map(|press| Some((press, press.mm_per_px?)));
    let odd = odd.filter(|(_, pitch)| (pitch / own - 1.0).abs() > 0.01).map(|(press, pitch)| {
        let message = format!("{}: {pitch} mm per px in the table, {own:.6} on the sensor, which counts", press.file);
        let cause = format!("rows have another `mm_per_px` than the sensor, {own:.6}, which counts");
        let help = "check `field_of_view_mm` of the sensor, and `mm_per_px` of the table";
        Diagnostic::warning(message).of(format!("{} ({pitch})", press.file), cause).help(help)
    });
    odd.collect()
}

/// The presses whose images can be looked at, as those of a calibration.
fn of_images(
    table: &Table,
    circles: &[Option<Circle>],
    images: Vec<Result<RgbImage, String>>,
    background: RgbImage,
    simulator: &Simulator,
) -> Session {
    let size = background.dimensions();
    let rows = table.presses.iter().zip(circles).zip(images);
    let observations = rows.filter_map(|((press, circle), image)| {
        let image = image.ok().filter(|image| image.dimensions() == size)?;
        Some(Observation::new(press.file.as_str(), image, (*circle)?, press.ball_radius_mm?))
    });
    Session {
        sensor: sensor::Sensor::default(),
        camera: *simulator.view(),
        observations: observations.collect(),
        background,
        printed: None,
    }
}

fn simulate(
    press: &Press,
    circle: Circle,
    ball: &Ball,
    contact_over_disc: f64,
    simulator: &Simulator,
    real: Option<(&RgbImage, &RgbImage)>,
) -> (EvaluatedPress, bool) {
    let view = simulator.view();
    let found = ball.depth_mm(circle.radius_px * view.mm_per_px[0] * contact_over_disc);
    let contact = ball.press(simulator.pad(), view, circle.centre_px, found.unwrap_or(ball.deepest_mm()));
    let light = simulator.light(&contact);
    let simulated = picture(&light, simulator.background());
    let scores = real.map(|(real, _)| score(real, &simulated, Some(&circle), DILATE));
    let bare = real.map(|(real, untouched)| score(real, untouched, Some(&circle), DILATE));
    (EvaluatedPress { file: press.file.clone(), simulated, scores, bare }, found.is_none())
}

/// What the picture for an image is called: its name without folders, with the ending of a PNG.
pub fn picture_name(file: &str) -> String {
    let name = file.rsplit(['/', '\\']).next().unwrap_or(file);
    let stem = name.rsplit_once('.').map_or(name, |(stem, _)| stem);
    format!("{stem}.png")
}
