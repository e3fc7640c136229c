//! Simulates presses that a sensor file never saw, from circle and ball alone: `gelsim calibrate --evaluate`.

use crate::core::camera::CameraParams;
use crate::core::sensor::Sensor;
use crate::core::simulator::Simulator;
use std::path::Path;

use image::RgbImage;
use rayon::prelude::*;

use super::geometry::{Ball, Balls};
use super::pixels::DILATE;
use super::{Geometry, picture, session};
use crate::core::effects::EffectPolicy;
use crate::core::fidelity::Fidelity;
use crate::files::diagnostic::{Diagnostics, Report};
use crate::lab::compare::score::{Scores, score};
use crate::lab::presses::{self, Press};

/// A simulated press.
pub struct Evaluated {
    /// The image's file, as the table has it.
    pub file: String,
    /// The picture.
    pub simulated: RgbImage,
    /// How far it is from the real one, if that is there.
    pub scores: Option<Scores>,
    /// What is odd about it.
    pub warnings: Vec<String>,
}

/// Simulates the presses of a table at a fidelity level, the contact so much smaller than the visible disc: if nothing is
/// said, as the sensor's calibration found it, or as usual. On failure, every mistake in the table.
pub fn evaluate(
    table: &Path,
    sensor: &Sensor,
    contact_over_disc: Option<f64>,
    fidelity: Fidelity,
) -> Result<Vec<Evaluated>, Report> {
    let table = presses::read(table)?;
    let mut problems = Diagnostics::default();
    let mut names: Vec<String> = Vec::new();
    for press in &table.presses {
        let mut wrong = |message: String, help: &str| problems.push(table.problem(press.line, message).help(help));
        let name = picture_name(&press.file);
        if names.contains(&name) {
            let help = "pictures are written under the images' names without folders, as .png";
            wrong(format!("{}: a second picture would be called {name}", press.file), help);
        }
        names.push(name);
        if press.circle.is_none() {
            wrong(format!("{}: no circle", press.file), "where and how deep the ball is, follows from it");
        }
        if press.ball_radius_mm.is_none() {
            wrong(format!("{}: no ball_radius_mm", press.file), "give the radius of the ball in every row");
        }
    }
    if !problems.is_empty() {
        return Err(table.report(&problems));
    }
    // The presses are of a smooth, flat pad; noise would be an error of its own.
    let still = CameraParams { shot_noise_levels: 0.0, read_noise_levels: 0.0, speckle_levels: 0.0, ..sensor.camera };
    let sensor = Sensor { rest_surface: None, coating: None, camera: still, ..sensor.clone() };
    let models = fidelity.models(sensor.light_source());
    let simulator = Simulator::with_models(sensor, models, EffectPolicy::WhereNeeded);
    let radii_mm = table.presses.iter().filter_map(|press| press.ball_radius_mm);
    let balls = Balls::new(radii_mm, &simulator.sensor().gelpad);
    let calibrated = simulator.sensor().calibration.as_ref().map(|table| table.contact_over_disc);
    let contact_over_disc = contact_over_disc.or(calibrated).unwrap_or(Geometry::USUAL_CONTACT);
    let one = |press: &Press| {
        let ball = balls.of_radius(press.ball_radius_mm?);
        Some(simulate(press, ball, contact_over_disc, &simulator))
    };
    Ok(table.presses.par_iter().filter_map(one).collect())
}

fn simulate(press: &Press, ball: &Ball, contact_over_disc: f64, simulator: &Simulator) -> Evaluated {
    let view = simulator.view();
    let mut warnings = Vec::new();
    let own_mm_per_px = view.mm_per_px[0];
    let mm_per_px = press.mm_per_px.unwrap_or(own_mm_per_px);
    if (mm_per_px / own_mm_per_px - 1.0).abs() > 0.01 {
        warnings.push(format!("{mm_per_px} mm per px in the table, {own_mm_per_px:.6} on the sensor, which counts"));
    }
    let (centre_px, radius_px) = press.circle.map_or(([0.0; 2], 0.0), |circle| (circle.centre_px, circle.radius_px));
    let depth_mm = ball.depth_mm(radius_px * own_mm_per_px * contact_over_disc).unwrap_or_else(|| {
        warnings.push(String::from("its circle is too large for its ball; the deepest press is shown"));
        ball.deepest_mm()
    });
    let contact = ball.press(simulator.pad(), view, centre_px, depth_mm);
    let light = simulator.light(&contact);
    let simulated = picture(&light, simulator.background());
    let real = session::picture(&press.path);
    let scores = match real {
        Ok(real) if real.dimensions() == simulated.dimensions() => {
            Some(score(&real, &simulated, press.circle.as_ref(), DILATE))
        }
        Ok(_) => {
            warnings.push(String::from("not of the sensor's size: not compared"));
            None
        }
        Err(reason) => {
            warnings.push(format!("not compared: {reason}"));
            None
        }
    };
    Evaluated { file: press.file.clone(), simulated, scores, warnings }
}

/// What the picture for an image is called: its name without folders, with the ending of a PNG.
pub fn picture_name(file: &str) -> String {
    let name = file.rsplit(['/', '\\']).next().unwrap_or(file);
    let stem = name.rsplit_once('.').map_or(name, |(stem, _)| stem);
    format!("{stem}.png")
}
