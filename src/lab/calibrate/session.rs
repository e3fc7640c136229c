//! Reads the inputs of `gelsim calibrate`: a table of presses, their images, and the background image.

use std::ops::RangeInclusive;
use std::path::Path;

use image::RgbImage;
use rayon::prelude::*;

use super::dots::{Dots, InpaintedImage};
use super::{Observation, PrintedDots, Session};
use crate::calibrate::detect::{Detection, detect_disc};
use crate::presses::square::{MAX_RATIO, SquarePixels};
use crate::presses::{PressColumn, PressRow, PressTable};
use gelsim_core::base::view::View;
use gelsim_files::diagnostic::{Diagnostic, Diagnostics, Report};
use gelsim_files::image_file;
use gelsim_files::input;
use gelsim_files::sensor::Sensor;

/// Least number of presses for a calibration: a fit to fewer does not hold for other presses.
pub const MIN_PRESSES: usize = 5;
/// Least number of presses for LEDs: fewer do not tell three LEDs apart.
pub const MIN_PRESSES_FOR_LEDS: usize = 3;

/// Sides of the view that a sensor file may have, mm.
const VIEWS_MM: RangeInclusive<f64> = 1e-3..=1e4;
/// Confidence below which a detected circle gets a warning.
const SURE_CONFIDENCE: f64 = 0.5;

/// Reads an image file of any known format. The error says why it cannot be read.
pub fn read_picture(path: &Path) -> Result<RgbImage, String> {
    input::read(path, input::MAX_IMAGE_BYTES)
        .map_err(|error| error.to_string())
        .and_then(|bytes| image_file::decode_rgb(&bytes))
}

/// Reports that an image of a table cannot be read, and how to fix it.
pub fn explain_unreadable(table: &PressTable, press: &PressRow, reason: &str) -> Diagnostic {
    let is_missing = !press.path.exists();
    let help = match () {
        () if is_missing && press.file.contains('\\') => String::from("write / in place of \\ in the names of images"),
        () if is_missing => match find_other_ending(&press.path) {
            Some(other) => format!("is {other} meant? write the image's own ending"),
            None => format!("images are looked for from the table's folder, {}", table_folder(table)),
        },
        () => String::from("put the image in its place, or leave its row out"),
    };
    let (what, cause) = if is_missing {
        (format!("cannot read {}: it does not exist", press.path.display()), String::from("images do not exist"))
    } else {
        (format!("cannot read {}: {reason}", press.path.display()), format!("images cannot be read: {reason}"))
    };
    table.row_problem(press.line, what).about(press.file.as_str(), cause).help(help)
}

/// Returns the name of an existing image that differs from this one by its ending alone.
fn find_other_ending(path: &Path) -> Option<String> {
    let endings = ["png", "jpg", "jpeg", "PNG", "JPG", "bmp", "tif", "tiff", "webp"];
    let other = endings.into_iter().map(|ending| path.with_extension(ending)).find(|other| other.is_file())?;
    Some(other.file_name()?.to_string_lossy().into_owned())
}

fn table_folder(table: &PressTable) -> String {
    match table.path.parent() {
        Some(folder) if !folder.as_os_str().is_empty() => folder.display().to_string(),
        _ => String::from("the current one"),
    }
}

/// Reads the images of a table as a session of `sensor`, whose view is taken from the table and the background image.
/// `detects`: circles that the table lacks are looked for. Returns the session with notes, or all mistakes.
pub fn read_session(
    mut table: PressTable,
    background: &Path,
    sensor: Sensor,
    detects: bool,
    fewest: usize,
) -> Result<(Session, Diagnostics), Report> {
    let mut problems = Diagnostics::default();
    let untouched = read_picture(background);
    if let Err(reason) = &untouched {
        let message = format!("cannot read the background {}: {reason}", background.display());
        let help = format!("name an image of the untouched pad ({}) with --background", image_file::FORMAT_NAMES);
        problems.push(Diagnostic::new(message).help(help));
    }
    let mut background = untouched.ok();
    let mut images: Vec<Result<RgbImage, String>> =
        table.presses.par_iter().map(|press| read_picture(&press.path)).collect();
    for (press, image) in table.presses.iter().zip(&images) {
        if let Err(reason) = image {
            problems.push(explain_unreadable(&table, press, reason));
        }
    }
    if let Some(background) = &background {
        problems.extend(check_image_sizes(&table, &images, background));
    }
    let pixel_mm = usual_pixel_size(&table);
    problems.extend(check_numbers(&table, pixel_mm));
    // Mistakes are collected rather than returned one by one, so that the user sees all of them in one run.
    let mut notes = Diagnostics::default();
    notes.extend(table.notes.drain(..));
    if let (Some(picture), Some(mm)) = (&mut background, pixel_mm)
        && let Some(square) = SquarePixels::new(picture.dimensions(), mm)
    {
        square.resample_presses(&mut table, &mut images);
        *picture = square.resample_image(picture);
        notes.push(square.to_note());
    }
    let mm_per_px = pixel_mm.map(|[x, y]| x.min(y));
    let printed = background.as_ref().and_then(Dots::find);
    let rest = printed.as_ref().map(|(_, cleared)| &cleared.image).or(background.as_ref());
    let looked: Vec<PressReading> = table
        .presses
        .par_iter()
        .zip(images)
        .filter_map(|(press, image)| Some(inspect_press(press, image.ok()?, rest?, printed.as_ref(), detects)))
        .collect();
    for press in table.presses.iter().filter(|press| press.circle.is_none() && !detects) {
        let problem = table.row_problem(press.line, format!("{}: no circle", press.file));
        let problem = problem.about(press.file.as_str(), "images have no circle in the table");
        problems.push(problem.help(format!("{}, or add --detect to have it looked for", table.circle_advice)));
    }
    for PressReading { press, found, .. } in looked.iter().filter(|looked| looked.is_looked_for) {
        match found {
            None => {
                let problem = table.row_problem(press.line, format!("{}: no press is found in it", press.file));
                let problem = problem.about(press.file.as_str(), "images show no press that is found");
                problems.push(problem.help("write the circle into the table, or leave the row out"));
            }
            Some(found) => notes.push(describe_detection(press, found)),
        }
    }
    if problems.is_empty() && looked.len() < fewest {
        problems.push(report_few_presses(&table, looked.len(), fewest));
    }
    let Some(background) = background else { return Err(table.report(&problems)) };
    let resolution_px = <[u32; 2]>::from(background.dimensions());
    let field_of_view_mm = resolution_px.map(|px| f64::from(px) * mm_per_px.unwrap_or(1.0));
    if field_of_view_mm.iter().any(|mm| !VIEWS_MM.contains(mm)) {
        let message = format!("the view would be {:.3e} x {:.3e} mm", field_of_view_mm[0], field_of_view_mm[1]);
        problems.push(table.row_problem(2, message).help("mm_per_px is the width of a pixel on the pad, in mm"));
    }
    let Some(mm_per_px) = mm_per_px.filter(|_| problems.is_empty()) else { return Err(table.report(&problems)) };
    let sensor = Sensor { resolution_px, field_of_view_mm, ..sensor };
    let camera = View { resolution_px: resolution_px.map(|px| px as usize), mm_per_px: [mm_per_px; 2] };
    let motion = looked.iter().flat_map(|looked| looked.motion.iter().copied()).collect();
    let observations = looked.into_iter().filter_map(PressReading::into_observation).collect();
    let (printed, background) = match printed {
        None => (None, background),
        Some((dots, cleared)) => (Some(PrintedDots { dots: dots.with_motion(motion), background }), cleared.image),
    };
    Ok((Session { sensor, camera, background, observations, printed }, notes))
}

fn report_few_presses(table: &PressTable, count: usize, fewest: usize) -> Diagnostic {
    let last = table.presses.last().map_or(1, |press| press.line);
    let message = format!("{count} presses are too few to learn from");
    table.row_problem(last, message).help(format!("give {fewest} at least; 20 to 50 all over the picture are good"))
}

/// Reports images of another size than the background image. If all images are of one size, the background image is
/// wrong.
fn check_image_sizes(
    table: &PressTable,
    images: &[Result<RgbImage, String>],
    background: &RgbImage,
) -> Vec<Diagnostic> {
    let size = |image: &RgbImage| format!("{}x{} px", image.width(), image.height());
    let own = size(background);
    let read: Vec<(&PressRow, &RgbImage)> =
        table.presses.iter().zip(images).filter_map(|(press, image)| Some((press, image.as_ref().ok()?))).collect();
    let other = |image: &RgbImage| image.dimensions() != background.dimensions();
    let same = read.windows(2).all(|two| two[0].1.dimensions() == two[1].1.dimensions());
    if let (true, [(_, first), _, ..]) = (same, read.as_slice())
        && other(first)
    {
        let message = format!("all images are {}, and the background is {own}", size(first));
        let help = format!("name a background image of {} with --background, or resize it", size(first));
        return vec![Diagnostic::new(message).help(help)];
    }
    let wrong = read.into_iter().filter(|(_, image)| other(image)).map(|(press, image)| {
        let message = format!("{} is {}, the background {own}", press.file, size(image));
        let problem = table.row_problem(press.line, message).help("resize these images, or leave their rows out");
        problem.about(
            format!("{} ({})", press.file, size(image)),
            format!("images are not of the background's size, {own}"),
        )
    });
    wrong.collect()
}

/// Returns the pixel size that most rows have, mm; the first one of equally frequent ones.
pub fn usual_pixel_size(table: &PressTable) -> Option<[f64; 2]> {
    let all: Vec<[f64; 2]> = table.presses.iter().filter_map(|press| press.mm_per_px).collect();
    let count = |mm: [f64; 2]| all.iter().filter(|own| is_same_size(**own, mm)).count();
    let most = all.iter().map(|mm| count(*mm)).max()?;
    all.iter().copied().find(|mm| count(*mm) == most)
}

fn is_same_size(a: [f64; 2], b: [f64; 2]) -> bool {
    (0..2).all(|k| (a[k] / b[k] - 1.0).abs() <= 1e-6)
}

fn format_pixel_size([x, y]: [f64; 2]) -> String {
    if x == y { x.to_string() } else { format!("{x} x {y}") }
}

/// Reports missing and differing numbers of balls and pixels. `usual_mm` is the pixel size that most rows have.
fn check_numbers(table: &PressTable, usual_mm: Option<[f64; 2]>) -> Vec<Diagnostic> {
    let mut all = Vec::new();
    let columns = [
        (PressColumn::BallRadius, "ball_radius_mm", "the radius of the ball in mm"),
        (PressColumn::PixelSize, "mm_per_px", "the width of a pixel on the pad in mm"),
    ];
    for (column, name, what) in columns {
        if let Some(lacking) = table.report_missing_column(column, what) {
            all.push(lacking);
            continue;
        }
        let is_empty = |press: &&PressRow| match column {
            PressColumn::BallRadius => press.ball_radius_mm.is_none(),
            _ => press.mm_per_px.is_none(),
        };
        all.extend(table.presses.iter().filter(is_empty).map(|press| {
            let problem = table.row_problem(press.line, format!("{}: no {name}", press.file));
            let problem = problem.about(press.file.as_str(), format!("rows have no `{name}`"));
            problem.help(format!("write {what} into every row"))
        }));
    }
    let odd = table.presses.iter().filter_map(|press| {
        let is_odd = !is_same_size(press.mm_per_px?, usual_mm?);
        let [own, usual] = [press.mm_per_px?, usual_mm?].map(format_pixel_size);
        let problem = || {
            let problem =
                table.row_problem(press.line, format!("{}: {own} mm per px, {usual} in most rows", press.file));
            let cause = format!("rows have another `mm_per_px` than most, {usual}");
            problem.about(format!("{} ({own})", press.file), cause)
        };
        is_odd.then(|| problem().help("one camera has one pixel size: write the same into every row"))
    });
    all.extend(odd);
    if let Some([x, y]) = usual_mm.filter(|[x, y]| !(1.0 / MAX_RATIO..=MAX_RATIO).contains(&(x / y))) {
        let message = format!("pixels of {x} x {y} mm are more than {MAX_RATIO} times as long as wide");
        let help = "write width and height of a pixel on the pad, in mm, as `mm_per_px_x` and `mm_per_px_y`";
        all.push(table.row_problem(table.presses[0].line, message).help(help));
    }
    all
}

/// What the image of a row shows.
struct PressReading<'a> {
    press: &'a PressRow,
    cleared: InpaintedImage,
    motion: Vec<f64>,
    is_looked_for: bool,
    found: Option<Detection>,
}

fn inspect_press<'a>(
    press: &'a PressRow,
    image: RgbImage,
    rest: &RgbImage,
    printed: Option<&(Dots, InpaintedImage)>,
    detects: bool,
) -> PressReading<'a> {
    let is_of_size = image.dimensions() == rest.dimensions();
    let (cleared, motion) = match printed.filter(|_| is_of_size) {
        None => (InpaintedImage { image, ink: Vec::new() }, Vec::new()),
        Some((dots, untouched)) => {
            let (mut cleared, motion) = dots.inpaint_dots(&image);
            // A pixel that a dot covers in either image has no known change.
            cleared.ink.iter_mut().zip(&untouched.ink).for_each(|(ink, other)| *ink |= *other);
            (cleared, motion)
        }
    };
    let is_looked_for = detects && press.circle.is_none() && is_of_size;
    let found = if is_looked_for { detect_disc(&cleared.image, rest) } else { None };
    PressReading { press, cleared, motion, is_looked_for, found }
}

impl PressReading<'_> {
    fn into_observation(self) -> Option<Observation> {
        let Self { press, cleared: InpaintedImage { image, ink }, found, .. } = self;
        Some(Observation {
            file: press.file.clone(),
            image,
            circle: press.circle.or(found.map(|found| found.circle))?,
            confidence: found.map(|found| found.confidence),
            ball_radius_mm: press.ball_radius_mm?,
            ink,
        })
    }
}

/// Describes a detected circle: a note, or a warning if the detection is not sure.
fn describe_detection(press: &PressRow, found: &Detection) -> Diagnostic {
    let ([x, y], radius) = (found.circle.centre_px, found.circle.radius_px);
    let sure = (100.0 * found.confidence).round();
    let message = format!("{}: circle found at {x:.1}, {y:.1} of radius {radius:.1} px, {sure} % sure", press.file);
    if found.confidence < SURE_CONFIDENCE {
        let cause = "circles were found, but not surely";
        let help =
            "look at them in the page beside the sensor file; where one is wrong, write the right one into the table";
        Diagnostic::warning(message).about(format!("{} ({sure} % sure)", press.file), cause).help(help)
    } else {
        Diagnostic::note(message).about(format!("{} ({sure} % sure)", press.file), "circles were found")
    }
}
