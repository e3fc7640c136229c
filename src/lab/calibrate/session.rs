//! Reads what `gelsim calibrate` starts from: a table of presses, their images, the background image.

use std::ops::RangeInclusive;
use std::path::Path;

use image::RgbImage;

use super::{Observation, Session};
use crate::core::base::view::View;
use crate::files::diagnostic::{Diagnostic, Diagnostics, Report};
use crate::files::image_file;
use crate::files::input;
use crate::files::sensor::Sensor;
use crate::lab::calibrate::detect::detect;
use crate::lab::presses::{self, Press, Table};

/// Fewer presses teach nothing that holds elsewhere.
pub const FEWEST: usize = 5;
/// Fewer do not tell three LEDs apart.
pub const FEWEST_FOR_LEDS: usize = 3;

/// Sides of the view that a sensor file may have, mm.
const VIEWS_MM: RangeInclusive<f64> = 1e-3..=1e4;

/// Reads an 8-bit picture.
pub fn picture(path: &Path) -> Result<RgbImage, String> {
    input::read(path, input::MOST_IMAGE_BYTES)
        .map_err(|error| error.to_string())
        .and_then(|bytes| image_file::decode_rgb(&bytes))
}

/// Reads a session of `sensor`, of which only the view is not known yet. Circles that the table lacks are looked for if
/// `detects`. Returns notes with it, and every mistake instead of it.
pub fn read(
    table: &Path,
    background: &Path,
    sensor: Sensor,
    detects: bool,
    fewest: usize,
) -> Result<(Session, Vec<String>), Report> {
    let table = presses::read(table)?;
    let mut problems = Diagnostics::default();
    let untouched = picture(background);
    if let Err(reason) = &untouched {
        let message = format!("cannot read the background {}: {reason}", background.display());
        problems.push(Diagnostic::new(message).help("a PNG of the untouched pad belongs here"));
    }
    let background = untouched.ok();
    let (mut notes, mut observations) = (Vec::new(), Vec::new());
    let pitch = table.presses.iter().find_map(|press| press.mm_per_px);
    for press in &table.presses {
        match observation(press, background.as_ref(), pitch, detects) {
            Ok((press, note)) => {
                observations.push(press);
                notes.extend(note);
            }
            Err(found) => found.into_iter().for_each(|(message, help)| {
                problems.push(table.problem(press.line, message).help(help));
            }),
        }
    }
    if problems.is_empty() && observations.len() < fewest {
        problems.push(few(&table, observations.len(), fewest));
    }
    let Some(background) = background else { return Err(table.report(&problems)) };
    let resolution_px = <[u32; 2]>::from(background.dimensions());
    let field_of_view_mm = resolution_px.map(|px| f64::from(px) * pitch.unwrap_or(1.0));
    if field_of_view_mm.iter().any(|mm| !VIEWS_MM.contains(mm)) {
        let message = format!("the view would be {:.3e} x {:.3e} mm", field_of_view_mm[0], field_of_view_mm[1]);
        problems.push(table.problem(2, message).help("mm_per_px is the width of a pixel on the pad, in mm"));
    }
    let Some(pitch) = pitch.filter(|_| problems.is_empty()) else { return Err(table.report(&problems)) };
    let sensor = Sensor { resolution_px, field_of_view_mm, ..sensor };
    let camera = View { resolution_px: resolution_px.map(|px| px as usize), mm_per_px: [pitch; 2] };
    Ok((Session { sensor, camera, background, observations }, notes))
}

fn few(table: &Table, count: usize, fewest: usize) -> Diagnostic {
    let last = table.presses.last().map_or(1, |press| press.line);
    let message = format!("{count} presses are too few to learn from");
    table.problem(last, message).help(format!("give {fewest} at least; 20 to 50 all over the picture are good"))
}

type Mistakes = Vec<(String, String)>;

/// One row with its image, and a note where its circle was looked for.
fn observation(
    press: &Press,
    background: Option<&RgbImage>,
    pitch: Option<f64>,
    detects: bool,
) -> Result<(Observation, Option<String>), Mistakes> {
    let mut mistakes: Mistakes = Vec::new();
    let mut wrong = |message: String, help: &str| mistakes.push((message, help.to_owned()));
    let image = picture(&press.path);
    let other_size = |image: &RgbImage| background.map(RgbImage::dimensions).filter(|size| *size != image.dimensions());
    let image = match image.map(|image| (other_size(&image), image)) {
        Ok((None, image)) => Some(image),
        Ok((Some((bw, bh)), image)) => {
            let (w, h) = image.dimensions();
            wrong(
                format!("{} is {w}x{h} px, the background {bw}x{bh} px", press.file),
                "all pictures of a sensor have one size",
            );
            None
        }
        Err(reason) => {
            wrong(
                format!("cannot read {}: {reason}", press.path.display()),
                "paths are relative to the table's folder",
            );
            None
        }
    };
    if press.ball_radius_mm.is_none() {
        wrong(format!("{}: no ball_radius_mm", press.file), "give the radius of the ball in every row");
    }
    match (press.mm_per_px, pitch) {
        (Some(own), Some(first)) if (own / first - 1.0).abs() > 1e-6 => {
            wrong(
                format!("{}: {own} mm per px, {first} in the rows before", press.file),
                "one camera has one pixel size",
            );
        }
        (Some(_), _) => {}
        (None, _) => wrong(format!("{}: no mm_per_px", press.file), "give the size of the pixels in every row"),
    }
    let (mut circle, mut note) = (press.circle, None);
    if circle.is_none() && !detects {
        wrong(format!("{}: no circle", press.file), "annotate it, or add --detect to have it looked for");
    } else if let (None, Some(image), Some(background)) = (circle, &image, background) {
        match detect(image, background) {
            Some(found) => {
                circle = Some(found.circle);
                let ([x, y], radius) = (found.circle.centre_px, found.circle.radius_px);
                let sure = 100.0 * found.confidence;
                let file = &press.file;
                note =
                    Some(format!("{file}: circle found at {x:.1}, {y:.1} of radius {radius:.1} px, {sure:.0} % sure"));
            }
            None => wrong(format!("{}: no press is found in it", press.file), "annotate it, or leave the row out"),
        }
    }
    match (image, circle, press.ball_radius_mm) {
        (Some(image), Some(circle), Some(ball_radius_mm)) if mistakes.is_empty() => {
            Ok((Observation { file: press.file.clone(), image, circle, ball_radius_mm }, note))
        }
        // Perhaps none: without a background nothing can be looked for.
        _ => Err(mistakes),
    }
}
