//! Real presses of every sensor against simulated ones: by a model of the other presses, and where the error is.

use std::path::{Path, PathBuf};

use gelsim_core::base::rng::random_stream;
use gelsim_core::fidelity::Fidelity;
use gelsim_core::optics;
use gelsim_core::optics::calibrated::CalibrationTable;
use gelsim_lab::calibrate::leds::fit_leds;
use gelsim_lab::calibrate::progress::ProgressMeter;
use gelsim_lab::calibrate::run::{Calibration, CalibrationRequest, calibrate};
use gelsim_lab::calibrate::train::TrainingSettings;
use gelsim_lab::calibrate::{Geometry, Session, build_table, fit_response};
use gelsim_lab::compare::picture;
use gelsim_lab::compare::score::Scores;
use image::RgbImage;
use rayon::prelude::*;

use super::real::{self, contact_mae, format_means, half, mean, score_pictures, simulate};

/// Sensors with good annotations, and the largest MAE of their contacts.
const GOOD: [(&str, f64); 3] = [("gelsight_taxim", 4.3), ("gsmini_gssdk", 4.1), ("gelsight_thu", 8.5)];
/// Radii that are tried for each circle, of its own.
const RADII: [f64; 9] = [0.9, 0.925, 0.95, 0.975, 1.0, 1.025, 1.05, 1.075, 1.1];
/// Limits of the zones by the distance from the circle's centre, radii.
const ZONES: [f64; 7] = [0.0, 0.6, 0.9, 1.1, 1.3, 2.5, f64::INFINITY];
/// From here on, in radii, a press changes nothing.
const FAR: f64 = 4.0;

fn folders(of: &Path) -> Vec<PathBuf> {
    let entries = std::fs::read_dir(of).expect("a folder that can be read");
    let mut folders: Vec<PathBuf> = entries.map(|entry| entry.expect("an entry").path()).collect();
    folders.retain(|path| path.join("annotations.csv").is_file());
    folders.sort();
    folders
}

fn name(folder: &Path) -> String {
    folder.file_name().expect("a name").to_string_lossy().into_owned()
}

fn shader(session: &Session, table: Option<&CalibrationTable>) -> optics::Shader {
    let optics = Fidelity::Standard.models(optics::LightSource::new(table.is_some(), &[])).optics;
    optics::Shader::new(&optics, table, &session.sensor.illumination(), &session.camera, None)
}

/// The presses as `table` has them, with circles of `by` times their radii.
fn press(session: &Session, geometry: Geometry, table: Option<&CalibrationTable>, by: f64) -> Vec<RgbImage> {
    let mut sized = session.clone();
    sized.observations.iter_mut().for_each(|observation| observation.circle.radius_px *= by);
    sized.sensor = sized.sensor_at_thickness(geometry.thickness_mm);
    simulate(session, &sized.press_surfaces(geometry, &half()).contacts, &shader(&sized, table))
}

/// For each press the nearest of several pictures.
fn best(tried: &[Vec<Scores>]) -> Vec<Scores> {
    let of = |press: usize| tried.iter().map(|all| all[press]).min_by(|a, b| contact_mae(a).total_cmp(&contact_mae(b)));
    (0..tried[0].len()).filter_map(of).collect()
}

/// `image` moved by whole pixels, over `rest` where nothing comes in.
fn moved(image: &RgbImage, rest: &RgbImage, by: [i64; 2]) -> RgbImage {
    let (width, height) = (i64::from(image.width()), i64::from(image.height()));
    RgbImage::from_fn(image.width(), image.height(), |x, y| {
        let [sx, sy] = [i64::from(x) - by[0], i64::from(y) - by[1]];
        let inside = (0..width).contains(&sx) && (0..height).contains(&sy);
        // What the press changes moves; the pad's own picture stays.
        let (to, from) = (rest.get_pixel(x, y).0, if inside { Some((sx as u32, sy as u32)) } else { None });
        let change = from.map_or([0; 3], |(sx, sy)| {
            let (sim, flat) = (image.get_pixel(sx, sy).0, rest.get_pixel(sx, sy).0);
            [0, 1, 2].map(|k| i32::from(sim[k]) - i32::from(flat[k]))
        });
        image::Rgb([0, 1, 2].map(|k| (i32::from(to[k]) + change[k]).clamp(0, 255) as u8))
    })
}

/// Sums of absolute differences and counts of values in each of [`ZONES`], and beyond [`FAR`]: as they are, and less the
/// image's own mean there.
struct Zones {
    sums: [[f64; 2]; ZONES.len() - 1],
    far: f64,
    noise: f64,
}

impl Zones {
    fn of(observation: &gelsim_lab::calibrate::Observation, simulated: &RgbImage) -> Self {
        let mut sums = [[0.0; 2]; ZONES.len() - 1];
        let mut far: [Vec<f64>; 3] = Default::default();
        let [cx, cy] = observation.circle.centre_px;
        for ((x, y, real), sim) in observation.image.enumerate_pixels().zip(simulated.pixels()) {
            let distance = (f64::from(x) - cx).hypot(f64::from(y) - cy) / observation.circle.radius_px;
            let zone = ZONES.partition_point(|limit| *limit <= distance) - 1;
            for (far, (sim, real)) in far.iter_mut().zip(sim.0.iter().zip(real.0)) {
                let error = f64::from(*sim) - f64::from(real);
                sums[zone] = [sums[zone][0] + error.abs(), sums[zone][1] + 1.0];
                if distance > FAR {
                    far.push(error);
                }
            }
        }
        let noise = far.iter().flat_map(|errors| {
            let offset = mean(errors.iter().copied());
            errors.iter().map(move |error| (error - offset).abs())
        });
        Self { sums, far: mean(far.iter().flatten().map(|error| error.abs())), noise: mean(noise) }
    }

    /// Mean errors in the zones, and each zone's share of those up to `until`, %.
    fn format_zones(all: &[Self]) -> String {
        let sum = |zone: usize, k: usize| all.iter().map(|zones| zones.sums[zone][k]).sum::<f64>();
        let shares = |zones: std::ops::Range<usize>| -> String {
            let total: f64 = zones.clone().map(|zone| sum(zone, 0)).sum();
            zones.map(|zone| format!("{:5.0}", 100.0 * sum(zone, 0) / total)).collect()
        };
        let errors: String = (0..ZONES.len() - 1).map(|zone| format!("{:6.2}", sum(zone, 0) / sum(zone, 1))).collect();
        let far = |of: fn(&Self) -> f64| match mean(all.iter().map(of)) {
            far if far.is_finite() => format!("{far:5.2}"),
            // A picture without such a place.
            _ => String::from("    -"),
        };
        let (far, noise) = (far(|zones| zones.far), far(|zones| zones.noise));
        format!("{errors} |{} |{} | {far} {noise}", shares(0..4), shares(0..ZONES.len() - 1))
    }
}

/// The cross-validated pictures, the nearest, the middle and the furthest, beside the real ones.
fn draw(name: &str, found: &Calibration) {
    let mut order: Vec<usize> = (0..found.held_out.len()).collect();
    order.sort_by(|a, b| contact_mae(&found.held_out[*a].scores).total_cmp(&contact_mae(&found.held_out[*b].scores)));
    let rows = [0, order.len() / 2, order.len() - 1].map(|rank| {
        let (observation, held_out) = (&found.session.observations[order[rank]], &found.held_out[order[rank]]);
        picture::comparison_row(
            format!("{}: MAE {:.2}", observation.file, contact_mae(&held_out.scores)),
            &observation.image,
            &held_out.simulated,
        )
    });
    real::write(&format!("{name}.png"), &picture::draw_comparison_sheet(rows.into(), 480));
}

#[test]
fn real_presses_of_every_sensor_are_nearer_to_a_calibrated_one_than_to_its_background() {
    let Some(folder) = real::folder() else { return };
    let mut zones = Vec::new();
    println!("sensor, presses; contact (1.3 radii) MAE / PSNR dB / SSIM | whole image MAE");
    for folder in folders(&folder) {
        let (name, Some(session)) = (name(&folder), real::session(&folder)) else { continue };
        let found = calibrate(session, &CalibrationRequest::default()).expect("enough presses");
        let (session, geometry) = (&found.session, found.geometry);
        let count = session.observations.len();
        let bare = score_pictures(session, &vec![session.background.clone(); count]);
        let phong = score_pictures(session, &press(session, geometry, None, 1.0));
        let held_out: Vec<Scores> = found.held_out.iter().map(|held_out| held_out.scores).collect();
        let sized = RADII.map(|by| score_pictures(session, &press(session, geometry, Some(&found.table), by)));
        let placed: Vec<Scores> = session
            .observations
            .par_iter()
            .zip(&found.held_out)
            .filter_map(|(observation, held_out)| {
                let by = (-3..=3).flat_map(|x| (-3..=3).map(move |y| [x, y]));
                let all = by.map(|by| {
                    let image = moved(&held_out.simulated, &session.background, by);
                    gelsim_lab::compare::score::score_images(
                        &observation.image,
                        &image,
                        Some(&observation.circle),
                        gelsim_lab::calibrate::pixels::ERROR_REACH,
                    )
                });
                all.min_by(|a, b| contact_mae(a).total_cmp(&contact_mae(b)))
            })
            .collect();
        println!(
            "{name}, {count}; thickness {} mm, contact over disc {:.2}; the fit leaves {:.2} of the better guess's error",
            geometry.thickness_mm,
            geometry.contact_over_disc,
            found.verdict.remaining_share()
        );
        assert!(!found.verdict.is_hopeless(), "{name}: {}", found.verdict.to_sentence());
        let line = |what: &str, scores: &[Scores]| println!("    {what:44} {}", format_means(scores.iter()));
        line("background alone", &bare);
        line("phong, not calibrated, this background", &phong);
        line("calibrated, cross-validated", &held_out);
        line("the same, centre moved to the best in 3 px", &placed);
        line("calibrated, in sample", &sized[RADII.len() / 2]);
        line("the same, the best of radii x 0.9 to 1.1", &best(&sized));
        let own: Vec<Zones> = session
            .observations
            .par_iter()
            .zip(&found.held_out)
            .map(|(observation, held_out)| Zones::of(observation, &held_out.simulated))
            .collect();
        zones.push(format!("{name:16}{}", Zones::format_zones(&own)));
        draw(&name, &found);
        let error = |scores: &[Scores]| mean(scores.iter().map(contact_mae));
        assert!(error(&held_out) < 0.5 * error(&bare) && error(&held_out) < error(&phong), "{name}");
        if let Some((_, most)) = GOOD.iter().find(|(good, _)| *good == name) {
            assert!(error(&held_out) <= *most, "{name}: {}", error(&held_out));
        }
    }
    println!(
        "\nzones 0-.6 .6-.9 .9-1.1 1.1-1.3 1.3-2.5 beyond: MAE | share of the contact's error, % | of the image's, % |"
    );
    println!("beyond 4 radii: MAE, and less each image's mean");
    println!("{}", zones.join("\n"));
}

#[test]
fn more_presses_bring_a_sensor_nearer() {
    const SENSOR: &str = "gsmini_gssdk";
    const HELD_OUT: usize = 8;
    let Some(folder) = real::folder() else { return };
    let session = real::session(&folder.join(SENSOR)).expect("a table of presses");
    let all = session.observations.len();
    let order = random_stream(0, "calibration", 7).sample_without_replacement((0..all).collect(), all);
    let part = |of: &[usize]| {
        let observations = of.iter().map(|k| session.observations[*k].clone()).collect();
        Session { observations, ..session.clone() }
    };
    let others = part(&order[..HELD_OUT]);
    let error = |count: usize| {
        let found = calibrate(part(&order[HELD_OUT..HELD_OUT + count]), &CalibrationRequest::default())
            .expect("enough presses");
        let scores = score_pictures(&others, &press(&others, found.geometry, Some(&found.table), 1.0));
        println!("{SENSOR}: {count:2} presses, tested on {HELD_OUT} others: {}", format_means(scores.iter()));
        mean(scores.iter().map(contact_mae))
    };
    let errors = [5, 8, 12, 20, all - HELD_OUT].map(error);
    assert!(errors[4] < 0.9 * errors[0], "{errors:?}");
}

#[test]
fn few_presses_say_more_where_leds_carry_them_over_the_pad() {
    const SENSORS: [&str; 5] = ["gelsight_taxim", "gsmini_gssdk", "gelsight_thu", "gelsight_fots", "digit_fots"];
    const COUNTS: [usize; 3] = [5, 8, 16];
    const HELD_OUT: usize = 6;
    let Some(folder) = real::folder() else { return };
    // Shorter than a calibration's, since there are many of them.
    let settings = TrainingSettings { networks: 2, steps: 800, ..TrainingSettings::default() };
    let mut gains = Vec::new();
    for sensor in SENSORS {
        let session = real::session(&folder.join(sensor)).expect("a table of presses");
        let all = session.observations.len();
        let thickness_mm = session.sensor.gelpad_thickness_mm;
        let geometry = Geometry { thickness_mm, contact_over_disc: Geometry::USUAL_CONTACT };
        let surfaces = session.press_surfaces(geometry, &half());
        let pixels = session.sample_pixels(&session.draw_places(4000), &surfaces, true);
        // Errors by the presses alone, and with LEDs that carry them, of presses that are in neither.
        let errors = |count: usize, draw: u64| {
            let order = random_stream(draw, "calibration", 7).sample_without_replacement((0..all).collect(), all);
            let (held_out, learnt) = order[..HELD_OUT + count].split_at(HELD_OUT);
            let observations = held_out.iter().map(|k| session.observations[*k].clone()).collect();
            let others = Session { observations, ..session.clone() };
            let contacts: Vec<_> = held_out.iter().map(|k| surfaces.contacts[*k].clone()).collect();
            let learnt: Vec<_> = learnt.iter().map(|k| &pixels[*k]).collect();
            let leds = fit_leds(learnt.iter().copied()).expect("pixels");
            [None, Some(&leds)].map(|carriers| {
                let quiet = ProgressMeter::new(1, &|_, _| {});
                let response = fit_response(&session, &learnt, carriers, &settings, 100, &quiet);
                let table = build_table(response, geometry).with_extrapolation(leds.extrapolation());
                let simulated = simulate(&others, &contacts, &shader(&others, Some(&table)));
                mean(score_pictures(&others, &simulated).iter().map(contact_mae))
            })
        };
        for count in COUNTS.into_iter().filter(|count| count + HELD_OUT <= all) {
            let each: Vec<[f64; 2]> = (0..6).into_par_iter().map(|draw| errors(count, draw)).collect();
            let [alone, carried] = [0, 1].map(|k| mean(each.iter().map(|errors| errors[k])));
            println!("{sensor}: {count:2} presses: MAE {alone:.2} alone, {carried:.2} carried by LEDs");
            assert!(carried < 1.03 * alone, "{sensor}, {count}: {alone}, {carried}");
            if count == COUNTS[0] {
                gains.push(carried / alone);
            }
        }
    }
    assert!(mean(gains.iter().copied()) < 0.95, "{gains:?}");
}
