//! What is said of real presses as a whole: nothing as they are, and the mistake where one was made. Prints the figures that
//! the thresholds stand between.
//!
//!     GELSIM_REAL_DATA=FOLDER cargo test --release --test library reality::judge -- --nocapture

use std::path::Path;

use gelsim_lab::calibrate::judge::fit::FitVerdict;
use gelsim_lab::calibrate::judge::scale::{self, SessionSizes};
use gelsim_lab::calibrate::judge::{self, background, circles};
use gelsim_lab::calibrate::run::{CalibrationRequest, calibrate, calibrate_leds};
use gelsim_lab::calibrate::train::TrainingSettings;
use gelsim_lab::calibrate::{Session, dots};
use image::{RgbImage, imageops};

use super::real;

/// Sets on which the thresholds were chosen; the others were kept apart until they were.
const CHOSEN_ON: [&str; 4] = ["gelsight_thu", "gsmini_gssdk", "gelsight_taxim", "gelsight_fots"];

/// Every sensor with balls of known radius.
fn sessions(folder: &Path) -> Vec<(String, Session)> {
    let entries = std::fs::read_dir(folder).expect("a folder that can be read");
    let mut folders: Vec<_> = entries.map(|entry| entry.expect("an entry").path()).collect();
    folders.retain(|path| path.join("annotations.csv").is_file() && path.join("background.png").is_file());
    folders.sort();
    let named = |path: &std::path::PathBuf| {
        let name = path.file_name().expect("a name").to_string_lossy().into_owned();
        Some((name, real::session(path)?))
    };
    let found: Vec<_> = folders.iter().filter_map(named).collect();
    assert!(!found.is_empty(), "no folder of {} has an annotations.csv and a background.png", folder.display());
    found
}

/// All that is said of a session before a fit: errors, and notes in brackets.
fn messages_before_a_fit(session: &Session) -> Vec<String> {
    let all = [scale::judge_scale(session, None, None), judge::judge_images(session)].concat();
    all.iter().map(|found| format!("{}: {}", found.severity.name(), found.full_message())).collect()
}

type Change = (&'static str, fn(&mut Session), &'static str);

fn pictures(session: &mut Session, change: impl Fn(&mut RgbImage)) {
    session.observations.iter_mut().for_each(|press| change(&mut press.image));
}

fn scaled(image: &mut RgbImage, by: f64) {
    image
        .pixels_mut()
        .for_each(|pixel| pixel.0 = pixel.0.map(|level| (by * f64::from(level)).round().min(255.0) as u8));
}

fn exchange_channels(image: &mut RgbImage) {
    image.pixels_mut().for_each(|pixel| pixel.0.reverse());
}

fn circles_to(session: &mut Session, to: impl Fn([f64; 2], f64) -> ([f64; 2], f64)) {
    for press in &mut session.observations {
        (press.circle.centre_px, press.circle.radius_px) = to(press.circle.centre_px, press.circle.radius_px);
    }
}

fn low(session: &Session) -> f64 {
    session.camera.resolution_px[1] as f64 - 1.0
}

/// One mistake each, and words that name it.
const CHANGES: [Change; 24] = [
    (
        "background in BGR",
        |s| exchange_channels(&mut s.background),
        "red and blue of the background image are exchanged",
    ),
    ("presses in BGR", |s| pictures(s, exchange_channels), "red and blue of the background image are exchanged"),
    ("background x 0.7", |s| scaled(&mut s.background, 0.7), "times as bright away from the discs"),
    ("background x 0.85", |s| scaled(&mut s.background, 0.85), "times as bright away from the discs"),
    ("background x 1.2", |s| scaled(&mut s.background, 1.2), "times as bright away from the discs"),
    ("presses x 0.8", |s| pictures(s, |image| scaled(image, 0.8)), "times as bright away from the discs"),
    ("background mirrored", |s| s.background = imageops::flip_horizontal(&s.background), "mirrored left to right"),
    ("background upside down", |s| s.background = imageops::rotate180(&s.background), "turned by 180 degrees"),
    (
        "a press as background",
        |s| s.background = s.observations.remove(0).image,
        "the pad is not untouched in the background image",
    ),
    ("centres exchanged", |s| circles_to(s, |[x, y], r| ([y, x], r)), "`centre_x_px` and `centre_y_px` look exchanged"),
    (
        "rows from below",
        |s| {
            let low = low(s);
            circles_to(s, |[x, y], r| ([x, low - y], r));
        },
        "`centre_y_px` looks counted from the lower edge",
    ),
    ("corners of boxes", |s| circles_to(s, |[x, y], r| ([x - r, y - r], r)), "upper left corner of a box"),
    ("twice as wide", |s| circles_to(s, |[x, y], r| ([2.0 * x, 2.0 * y], 2.0 * r)), "an image twice as wide"),
    ("half as wide", |s| circles_to(s, |[x, y], r| ([x / 2.0, y / 2.0], r / 2.0)), "an image half as wide"),
    (
        "fractions",
        |s| {
            let [width, height] = s.camera.resolution_px.map(|px| px as f64);
            circles_to(s, |[x, y], r| ([x / width, y / height], r / width));
        },
        "fractions of the image's width and height",
    ),
    (
        "a row further down",
        |s| {
            let last = s.observations.len() - 1;
            let circles: Vec<_> = s.observations.iter().map(|press| press.circle).collect();
            for (k, press) in s.observations.iter_mut().enumerate() {
                press.circle = circles[if k == 0 { last } else { k - 1 }];
            }
        },
        "the circles look exchanged between the rows",
    ),
    ("diameters", |s| circles_to(s, |at, r| (at, 2.0 * r)), "`radius_px` looks like a diameter"),
    ("half radii", |s| circles_to(s, |at, r| (at, 0.5 * r)), "`radius_px` looks like half of the radius"),
    (
        "balls in metres",
        |s| s.observations.iter_mut().for_each(|press| press.ball_radius_mm *= 1e-3),
        "`ball_radius_mm` looks like metres",
    ),
    (
        "balls in cm",
        |s| s.observations.iter_mut().for_each(|press| press.ball_radius_mm *= 0.1),
        "`ball_radius_mm` looks like centimetres",
    ),
    (
        "pixels in metres",
        |s| s.camera.mm_per_px = s.camera.mm_per_px.map(|mm| 1e-3 * mm),
        "looks like metres per pixel",
    ),
    (
        "pixels in cm",
        |s| s.camera.mm_per_px = s.camera.mm_per_px.map(|mm| 0.1 * mm),
        "looks like centimetres per pixel",
    ),
    ("pixels in um", |s| s.camera.mm_per_px = s.camera.mm_per_px.map(|mm| 1e3 * mm), "micrometres per pixel"),
    ("pixels per mm", |s| s.camera.mm_per_px = s.camera.mm_per_px.map(|mm| 1.0 / mm), "pixels per mm"),
];

#[test]
fn real_presses_are_not_spoken_against_and_each_mistake_in_them_is_named() {
    let Some(folder) = real::folder() else { return };
    let sessions = sessions(&folder);
    println!(
        "set                  disc/ball  differs  left  left/change  rearranged  factors             common  held  80 %"
    );
    for (name, session) in &sessions {
        let sizes = SessionSizes::from_session(session);
        let found = background::compare_background(session).expect("enough of the pad is away from the discs");
        let [red, green, blue] = found.factors;
        let [held, holding] = circles::circle_statistics(session);
        println!(
            "{name:20} {:9.2} {:8.2} {:5.2} {:12.2} {:11.2}  {red:.2} {green:.2} {blue:.2} {:13.3} {held:5.2} {holding:5.2}{}",
            sizes.disc_over_ball(),
            found.as_it_is,
            found.left,
            found.left / found.change,
            found.rearranged,
            found.in_common,
            if CHOSEN_ON.contains(&name.as_str()) { "" } else { "  (kept apart)" },
        );
        let said = messages_before_a_fit(session);
        said.iter().for_each(|text| println!("    {text}"));
        assert!(!said.iter().any(|text| text.starts_with("error: ")), "{name}");
        assert_eq!(dots::Dots::find(&session.background).map(|(dots, _)| dots.count), None, "{name}");
    }
    let mut missed = Vec::new();
    println!("\nmistake                  named in");
    for (what, change, words) in CHANGES {
        let mut named = Vec::new();
        for (name, session) in &sessions {
            let mut session = session.clone();
            change(&mut session);
            let said = messages_before_a_fit(&session);
            match said.iter().any(|text| text.starts_with("error: ") && text.contains(words)) {
                true => named.push(name.as_str()),
                false => missed.push(format!("{what}, {name}: {said:?}")),
            }
        }
        println!("{what:24} {} of {}: {}", named.len(), sessions.len(), named.join(", "));
    }
    println!("\nnot named as such:\n{}", missed.join("\n"));
    let all = CHANGES.len() * sessions.len();
    assert!(missed.len() * 20 <= all, "{} of {all}", missed.len());
}

#[test]
fn a_background_of_the_presses_kind_is_found_and_fits_as_well() {
    let Some(folder) = real::folder() else { return };
    for (name, session) in sessions(&folder) {
        let own = background::compare_background(&session).expect("a pad").left;
        for (what, change, _) in CHANGES.iter().take(8) {
            let mut changed = session.clone();
            change(&mut changed);
            let (matched, done) = background::match_background(changed);
            let left = background::compare_background(&matched).expect("a pad");
            println!("{name}: {what}: {done}; {:.2} grey levels are left, {own:.2} before", left.left);
            assert!(left.found.is_nothing(), "{name}: {what}: {:?}", left.found);
        }
    }
}

/// What fits of broken presses leave of the better guess's error, the network's and that of LEDs alone.
#[test]
fn fits_of_broken_presses_are_told_from_good_ones() {
    let Some(folder) = real::folder() else { return };
    let settings = TrainingSettings { steps: 300, ..TrainingSettings::default() };
    let request = CalibrationRequest {
        thickness_mm: Some(4.0),
        contact_over_disc: Some(0.94),
        settings,
        ..CalibrationRequest::default()
    };
    let named = |verdict: &FitVerdict| {
        format!("{:4.2}{}", verdict.remaining_share(), if verdict.is_hopeless() { " none" } else { "     " })
    };
    let broken = [0, 2, 6, 8, 9, 10, 15, 16, 17].map(|k| CHANGES[k]);
    println!("what is left of the better guess's error by networks, by LEDs alone");
    for (name, session) in sessions(&folder) {
        let whole: [Change; 1] = [("as they are", |_| {}, "")];
        let random: [Change; 1] = [(
            "centres at random",
            |s| {
                let [width, height] = s.camera.resolution_px.map(|px| px as f64);
                for (k, press) in s.observations.iter_mut().enumerate() {
                    let at = |by: f64| (0.5 + by * k as f64).fract() * 0.8 + 0.1;
                    press.circle.centre_px = [width * at(0.618), height * at(0.381)];
                }
            },
            "",
        )];
        for (what, change, _) in whole.iter().chain(&random).chain(&broken) {
            let mut changed = session.clone();
            change(&mut changed);
            let leds = calibrate_leds(&changed, request.default_geometry(&changed)).map(|found| found.verdict);
            let found = calibrate(changed, &request).map(|found| found.verdict);
            let shown = |verdict: Option<FitVerdict>| verdict.as_ref().map_or(String::from("no pixel"), named);
            println!("{name:20} {what:24} {}  {}", shown(found), shown(leds));
            if *what == "as they are" {
                assert!(found.is_some_and(|verdict| !verdict.is_hopeless()), "{name}");
                assert!(leds.is_some_and(|verdict| verdict.remaining_share() < 0.7), "{name}");
            }
            if *what == "centres at random" {
                assert!(found.is_none_or(|verdict| verdict.is_hopeless()), "{name}");
            }
        }
    }
}
