//! Simulates presses that a sensor file was not fitted to, from circle and ball alone: `gelsim calibrate --evaluate`.

use gelsim_core::sensor::{Background, Sensor};
use gelsim_core::simulator::Simulator;
use gelsim_core::simulator::Stages;
use image::RgbImage;
use rayon::prelude::*;

use super::detect::detect_disc;
use super::dots::Dots;
use super::geometry::{Ball, Balls};
use super::judge::{Findings, background, circles, scale};
use super::outliers::OutlierReason;
use super::pixels::ERROR_REACH;
use super::{Geometry, Observation, Session, light_to_rgb, session};
use crate::compare::score::{Scores, score_images};
use crate::presses::square::SquarePixels;
use crate::presses::{Circle, PressColumn, PressRow, PressTable};
use gelsim_core::effects::EffectPolicy;
use gelsim_core::fidelity::Fidelity;
use gelsim_files::diagnostic::{Diagnostic, Diagnostics, Report, Severity};
use gelsim_files::image_file;
use gelsim_files::sensor;

/// A simulated press.
pub struct EvaluatedPress {
    /// The image's file, as the table has it.
    pub file: String,
    /// Simulated image.
    pub simulated: RgbImage,
    /// Distance from the real image; none if there is no real one.
    pub scores: Option<Scores>,
    /// Distance of the background alone from the real image.
    pub background_scores: Option<Scores>,
}

/// Simulated presses of a table.
pub struct Evaluation {
    /// One per row.
    pub presses: Vec<EvaluatedPress>,
    /// Findings about table, images and sensor.
    pub findings: Findings,
}

/// Options of the simulation.
#[derive(Clone, Copy, Debug)]
pub struct EvaluationOptions {
    /// Radius of the contact over that of the visible disc; by default that of the sensor's calibration, or the usual
    /// one.
    pub contact_over_disc: Option<f64>,
    /// Fidelity level.
    pub fidelity: Fidelity,
    /// Whether to detect circles that the table lacks.
    pub finds_circles: bool,
}

/// Simulates the presses of a table. On failure returns every mistake in the table.
pub fn evaluate_presses(
    mut table: PressTable,
    sensor: &Sensor,
    options: EvaluationOptions,
) -> Result<Evaluation, Report> {
    // The presses are those of a smooth, flat pad, and simulated noise would add to the error.
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

    let mut images: Vec<Result<RgbImage, String>> =
        table.presses.par_iter().map(|press| session::read_picture(&press.path)).collect();
    let mut notes = std::mem::take(&mut table.notes);
    let size = images.iter().find_map(|image| Some(image.as_ref().ok()?.dimensions()));
    if let Some(square) = size.zip(session::usual_pixel_size(&table)).and_then(|(size, mm)| SquarePixels::new(size, mm))
    {
        square.resample_presses(&mut table, &mut images);
        notes.push(square.to_note());
    }
    if is_printed {
        images = images.into_par_iter().map(|image| image.map(remove_dots)).collect();
    }
    let (mut problems, unusable) = (Diagnostics::default(), find_unusable_images(&table, &images, &untouched));
    let circles = find_circles(&table, &images, &untouched, options.finds_circles, &mut problems);
    check_table(&table, &mut problems);
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
    let one = |((press, circle), image): ((&PressRow, &Option<Circle>), &Result<RgbImage, String>)| {
        let ball = balls.of_radius(press.ball_radius_mm?);
        let of_size = image.as_ref().ok().filter(|image| image.dimensions() == untouched.dimensions());
        Some(simulate_press(
            press,
            (*circle)?,
            ball,
            contact_over_disc,
            &simulator,
            of_size.map(|image| (image, &untouched)),
        ))
    };
    let (presses, too_large): (Vec<EvaluatedPress>, Vec<bool>) = rows.filter_map(one).unzip();
    let session = to_observations(&table, &circles, images, untouched, &simulator);
    let as_warning = |found: Diagnostic| Diagnostic { severity: Severity::Warning, ..found };
    let mut findings = Findings(notes);
    findings.extend(scale::judge_scale(&session, options.contact_over_disc.or(calibrated), None));
    if is_photograph {
        let circles = circles::judge_circles(&session);
        // Images of another unit of the sensor are allowed here: warn, but go on.
        let other_pad = background::judge_background(&session);
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
    findings.extend(check_pixel_sizes(&table, simulator.view().mm_per_px[0]));
    let deepest = table.presses.iter().zip(too_large).filter(|(_, too_large)| *too_large);
    findings.extend(deepest.map(|(press, _)| {
        let found = OutlierReason::TooLarge.to_warning(&press.file);
        found.help("the deepest press is shown: correct `radius_px` or `ball_radius_mm`, or leave the rows out")
    }));
    Ok(Evaluation { presses, findings })
}

const OTHER_PAD: &str =
    "the errors below are those of this difference, too: name the sensor file of these images with --sensor";

/// Fills the dots in an image, if there are any.
fn remove_dots(image: RgbImage) -> RgbImage {
    match Dots::find(&image) {
        Some((_, cleared)) => cleared.image,
        None => image,
    }
}

/// Returns the rows whose image cannot be compared with a simulated one.
fn find_unusable_images(
    table: &PressTable,
    images: &[Result<RgbImage, String>],
    untouched: &RgbImage,
) -> Vec<Diagnostic> {
    let size = |image: &RgbImage| format!("{}x{} px", image.width(), image.height());
    let own = size(untouched);
    let rows = table.presses.iter().zip(images);
    let one = |(press, image): (&PressRow, &Result<RgbImage, String>)| match image {
        Err(reason) => Some(session::explain_unreadable(table, press, reason)),
        Ok(image) if image.dimensions() != untouched.dimensions() => {
            let message = format!("{} is {}, the sensor {own}", press.file, size(image));
            let cause = format!("images are {}, and the sensor {own}", size(image));
            let help = format!("resize them to {own}, or name the sensor of these images with --sensor");
            Some(table.row_problem(press.line, message).about(press.file.as_str(), cause).help(help))
        }
        Ok(_) => None,
    };
    rows.filter_map(one).collect()
}

/// Returns the circle of each row, detected if it is missing and `detects`.
fn find_circles(
    table: &PressTable,
    images: &[Result<RgbImage, String>],
    untouched: &RgbImage,
    detects: bool,
    problems: &mut Diagnostics,
) -> Vec<Option<Circle>> {
    let look = |(press, image): (&PressRow, &Result<RgbImage, String>)| match (press.circle, image) {
        (None, Ok(image)) if detects && image.dimensions() == untouched.dimensions() => {
            detect_disc(image, untouched).map(|found| found.circle)
        }
        (circle, _) => circle,
    };
    let circles: Vec<Option<Circle>> = table.presses.par_iter().zip(images).map(look).collect();
    for (press, _) in table.presses.iter().zip(&circles).filter(|(_, circle)| circle.is_none()) {
        let problem = table.row_problem(press.line, format!("{}: no circle", press.file));
        let (cause, help) = if detects {
            (
                "images show no press that is found",
                String::from("write the circle into the table, or leave the row out"),
            )
        } else {
            let help = format!("{}, or add --detect to have it looked for", table.circle_advice);
            ("images have no circle in the table", help)
        };
        problems.push(problem.about(press.file.as_str(), cause).help(help));
    }
    circles
}

/// Reports what else in a table prevents the simulation: pictures with one name, missing balls.
fn check_table(table: &PressTable, problems: &mut Diagnostics) {
    let mut names: Vec<String> = Vec::new();
    for press in &table.presses {
        let name = picture_name(&press.file);
        if names.contains(&name) {
            let problem =
                table.row_problem(press.line, format!("{}: a second picture would be called {name}", press.file));
            let problem = problem.about(press.file.as_str(), "pictures would have the name of another one");
            problems.push(problem.help(format!(
                "rename the images, or write a table for each folder: pictures have the names of the images ({}) without \
                 folders, and end in .png",
                image_file::FORMAT_NAMES
            )));
        }
        names.push(name);
    }
    match table.report_missing_column(PressColumn::BallRadius, "the radius of the ball in mm") {
        Some(lacking) => problems.push(lacking),
        None => {
            for press in table.presses.iter().filter(|press| press.ball_radius_mm.is_none()) {
                let problem = table.row_problem(press.line, format!("{}: no ball_radius_mm", press.file));
                let problem = problem.about(press.file.as_str(), "rows have no `ball_radius_mm`");
                problems.push(problem.help("write the radius of the ball in mm into every row"));
            }
        }
    }
}

/// Warns about rows whose pixel size differs from the sensor's, which is used.
fn check_pixel_sizes(table: &PressTable, own: f64) -> Vec<Diagnostic> {
    let odd = table.presses.iter().filter_map(|press| Some((press, press.mm_per_px?[0])));
    let odd = odd.filter(|(_, mm)| (mm / own - 1.0).abs() > 0.01).map(|(press, mm)| {
        let message = format!("{}: {mm} mm per px in the table, {own:.6} on the sensor, which counts", press.file);
        let cause = format!("rows have another `mm_per_px` than the sensor, {own:.6}, which counts");
        let help = "check `field_of_view_mm` of the sensor, and `mm_per_px` of the table";
        Diagnostic::warning(message).about(format!("{} ({mm})", press.file), cause).help(help)
    });
    odd.collect()
}

/// Returns the presses with usable images, as a session for the checks of a calibration.
fn to_observations(
    table: &PressTable,
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

/// Simulates a press and scores it. True if its circle is too large for any contact of its ball.
fn simulate_press(
    press: &PressRow,
    circle: Circle,
    ball: &Ball,
    contact_over_disc: f64,
    simulator: &Simulator,
    real: Option<(&RgbImage, &RgbImage)>,
) -> (EvaluatedPress, bool) {
    let view = simulator.view();
    let found = ball.depth_mm(circle.radius_px * view.mm_per_px[0] * contact_over_disc);
    let contact = ball.press(simulator.pad(), view, circle.centre_px, found.unwrap_or(ball.deepest_mm()));
    let light = simulator.shade_contact(&contact);
    let simulated = light_to_rgb(&light, simulator.background());
    let scores = real.map(|(real, _)| score_images(real, &simulated, Some(&circle), ERROR_REACH));
    let bare = real.map(|(real, untouched)| score_images(real, untouched, Some(&circle), ERROR_REACH));
    (EvaluatedPress { file: press.file.clone(), simulated, scores, background_scores: bare }, found.is_none())
}

/// Name of the picture for an image: the image's name without folders, ending in `.png`. In folders of gs_sdk all images
/// have one name: there it is that of their folders.
pub fn picture_name(file: &str) -> String {
    if let Some(folders) = file.strip_suffix("/gelsight.png") {
        return format!("{}.png", folders.replace(['/', '\\'], "_"));
    }
    let name = file.rsplit(['/', '\\']).next().unwrap_or(file);
    let stem = name.rsplit_once('.').map_or(name, |(stem, _)| stem);
    format!("{stem}.png")
}
