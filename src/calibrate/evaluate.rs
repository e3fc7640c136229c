//! Simulates presses that a sensor file never saw, from circle and ball alone: `gelsim calibrate --evaluate`.

use std::path::Path;

use image::RgbImage;
use rayon::prelude::*;

use super::geometry::{Ball, Balls};
use super::pixels::DILATE;
use super::{picture, session};
use crate::compare::score::{Scores, score};
use crate::config::diagnostic::{Problems, Report};
use crate::effects::{Gate, Ledger};
use crate::fidelity::Rung;
use crate::gelpad::Pad;
use crate::optics::Shader;
use crate::plan::standalone::Standalone;
use crate::presses::{self, Press};

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

/// Simulates the presses of a table at a rung. On failure, every mistake in the table.
pub fn evaluate(table: &Path, sensor: &Standalone, rung: Rung) -> Result<Vec<Evaluated>, Report> {
    let table = presses::read(table)?;
    let mut problems = Problems::default();
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
    let choices = rung.choices(sensor.calibration.is_some());
    let pad = Pad::new(&choices.gelpad, &sensor.sensor, &sensor.camera);
    let calibration = sensor.calibration.as_ref();
    let shader = Shader::new(&choices.optics, calibration, &sensor.sensor, &sensor.camera, None);
    let balls = Balls::new(table.presses.iter().filter_map(|press| press.ball_radius_mm), &sensor.sensor);
    let one = |press: &Press| Some(simulate(press, balls.of(press.ball_radius_mm?), sensor, &pad, &shader));
    Ok(table.presses.par_iter().filter_map(one).collect())
}

fn simulate(press: &Press, ball: &Ball, sensor: &Standalone, pad: &Pad, shader: &Shader) -> Evaluated {
    let mut warnings = Vec::new();
    let own_pitch = sensor.camera.mm_per_px[0];
    let pitch = press.mm_per_px.unwrap_or(own_pitch);
    if (pitch / own_pitch - 1.0).abs() > 0.01 {
        warnings.push(format!("{pitch} mm per px in the table, {own_pitch:.6} on the sensor, which counts"));
    }
    let share = sensor.calibration.as_ref().map_or(1.0, |table| table.contact_over_disc);
    let (centre_px, radius_px) = press.circle.map_or(([0.0; 2], 0.0), |circle| (circle.centre_px, circle.radius_px));
    let depth_mm = ball.depth_mm(radius_px * own_pitch * share).unwrap_or_else(|| {
        warnings.push(String::from("its circle is too large for its ball; the deepest press is shown"));
        ball.deepest_mm()
    });
    let contact = ball.press(pad, &sensor.camera, centre_px, depth_mm);
    let light = shader.shade(&contact, &sensor.reference, &mut Ledger::new(Gate::CalledFor));
    let simulated = picture(&light, &sensor.reference);
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
