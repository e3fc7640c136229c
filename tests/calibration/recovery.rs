//! What is learnt of a hidden sensor, held against its own noise-free pictures of surfaces that nothing was learnt from:
//! mean absolute errors in the box around the contact, in levels, bounded by 1.3 times what was measured. The cone is
//! steeper than any ball that is learnt from, which costs most of its error.

use std::sync::LazyLock;

use gelsim_core::base::rng::random_stream;
use gelsim_core::optics::calibrated::CalibrationTable;
use gelsim_lab::calibrate::outliers::OutlierReason;
use gelsim_lab::calibrate::run::{Calibration, CalibrationRequest, calibrate};
use gelsim_lab::calibrate::train::TrainingSettings;
use gelsim_lab::calibrate::{Observation, Session};

use super::sensor::{
    BACKGROUND, BALLS, CONTACT_OVER_DISC, Press, THICKNESS_MM, mean_error, presses, session, simulated, uncalibrated,
};

/// A smaller model, learnt in a hurry; in a greater one unless all is to be tried.
fn quick() -> TrainingSettings {
    let (steps, batch) = if crate::thorough() { (500, 1024) } else { (250, 512) };
    TrainingSettings { networks: 2, units: 12, steps, batch, rate: 1e-2, decay: 0.1 }
}

/// Where nothing has to be chosen.
fn known_geometry() -> CalibrationRequest {
    CalibrationRequest {
        thickness_mm: Some(THICKNESS_MM),
        contact_over_disc: Some(CONTACT_OVER_DISC),
        drops_outliers: false,
        settings: quick(),
    }
}

/// From good presses, with everything left to be chosen.
pub static GOOD: LazyLock<Calibration> = LazyLock::new(|| {
    calibrated(session(BALLS.iter()), &CalibrationRequest { settings: quick(), ..CalibrationRequest::default() })
});

fn calibrated(session: Session, request: &CalibrationRequest) -> Calibration {
    calibrate(session, request).expect("presses enough")
}

/// Errors on unseen presses of each object, printed; none over its bound.
fn assert_errors(what: &str, table: &CalibrationTable, bounds: [f64; 4]) {
    let errors = super::sensor::UNSEEN.each_ref().map(|(_, presses)| mean_error(presses, |c| simulated(table, c)));
    println!("{what}: {errors:.2?}");
    for ((error, bound), (name, _)) in errors.iter().zip(bounds).zip(&*super::sensor::UNSEEN) {
        assert!(*error <= bound, "{what}, {name}: {error:.2} levels, at most {bound}");
    }
}

fn names<'a>(doubted: impl Iterator<Item = (&'a String, &'a Vec<OutlierReason>)>) -> Vec<&'a str> {
    doubted.filter(|(_, doubts)| !doubts.is_empty()).map(|(file, _)| file.as_str()).collect()
}

#[test]
fn good_presses_teach_the_light_of_unseen_presses_and_shapes() {
    let (found, table) = (&*GOOD, GOOD.table.clone());
    println!("{:?}, cross-validated {:?}", found.geometry, found.mean_errors());
    assert!((found.geometry.contact_over_disc - CONTACT_OVER_DISC).abs() <= 0.031, "{:?}", found.geometry);
    let bare = super::sensor::UNSEEN.each_ref().map(|(_, presses)| mean_error(presses, |_| BACKGROUND.clone()));
    let phong = super::sensor::UNSEEN.each_ref().map(|(_, presses)| mean_error(presses, uncalibrated));
    println!("ball, cylinder, cone, dots: background alone {bare:.2?}, not calibrated {phong:.2?}");
    assert_errors("calibrated", &table, [2.1, 1.9, 15.0, 3.1]);
    for ((name, presses), other) in super::sensor::UNSEEN.iter().zip(bare.iter().zip(&phong)) {
        let error = mean_error(presses, |contact| simulated(&table, contact));
        let (bare, phong) = other;
        assert!(error < 0.5 * bare && error < 0.3 * phong, "{name}: {error} levels, {bare} and {phong} without");
    }
    let doubted =
        names(found.session.observations.iter().map(|observation| &observation.file).zip(&found.outlier_reasons));
    assert!(doubted.len() <= 1, "{doubted:?}");
}

#[test]
fn circles_that_are_off_by_two_pixels_cost_little() {
    let mut session = session(BALLS.iter());
    for (k, observation) in session.observations.iter_mut().enumerate() {
        let mut random = random_stream(1, "x", k as u64);
        let (sin, cos) = (std::f64::consts::TAU * random.uniform()).sin_cos();
        let [x, y] = observation.circle.centre_px;
        observation.circle.centre_px = [x + 2.0 * cos, y + 2.0 * sin];
    }
    assert_errors("2 px off", &calibrated(session, &known_geometry()).table, [2.7, 2.1, 10.6, 3.3]);
}

/// Three of thirty presses are wrong: a circle elsewhere, one too large, one too small.
fn spoil_three(observations: &mut [Observation]) -> [String; 3] {
    let [x, y] = observations[4].circle.centre_px;
    observations[4].circle.centre_px = [x + if x > 100.0 { -30.0 } else { 30.0 }, y];
    observations[11].circle.radius_px *= 1.6;
    observations[23].circle.radius_px *= 0.55;
    [4, 11, 23].map(|k| observations[k].file.clone())
}

#[test]
fn bad_presses_are_named_and_left_out_if_that_is_wished() {
    let mut session = session(BALLS.iter());
    let bad = spoil_three(&mut session.observations);
    let kept = calibrated(session.clone(), &known_geometry());
    let doubted =
        names(kept.session.observations.iter().map(|observation| &observation.file).zip(&kept.outlier_reasons));
    println!("doubted {doubted:?}");
    assert!(bad.iter().all(|file| doubted.contains(&file.as_str())), "{doubted:?}");
    assert!(doubted.len() <= bad.len() + 1 && kept.dropped.is_empty(), "{doubted:?}");
    assert_errors("bad presses kept", &kept.table, [2.0, 1.8, 13.2, 3.2]);

    let left = calibrated(session, &CalibrationRequest { drops_outliers: true, ..known_geometry() });
    let dropped = names(left.dropped.iter().map(|(file, doubts)| (file, doubts)));
    println!("dropped {dropped:?}");
    assert!(bad.iter().all(|file| dropped.contains(&file.as_str())), "{dropped:?}");
    // Two good ones went with them when this was written: beside the one that is left, they look odd.
    assert!(dropped.len() <= bad.len() + 2 && left.session.observations.len() + dropped.len() == 30, "{dropped:?}");
    let cone = if crate::thorough() { 10.4 } else { 14.1 };
    assert_errors("bad presses left out", &left.table, [2.1, 1.9, cone, 3.1]);
}

#[test]
fn ten_presses_are_enough_for_a_rough_light() {
    assert_errors(
        "10 presses",
        &calibrated(session(BALLS.iter().take(10)), &known_geometry()).table,
        [2.4, 1.9, 14.4, 3.4],
    );
}

#[test]
fn where_nothing_was_pressed_the_light_stays_sane() {
    let left = presses("sphere", "x_mm = [-5.6, -0.5]\ny_mm = [-3.8, 3.8]", "[0.2, 0.7]", 20);
    let table = calibrated(session(&left), &known_geometry()).table;
    let right = presses("sphere", "x_mm = [2.0, 5.5]\ny_mm = [-3.7, 3.7]", "[0.25, 0.65]", 6);
    let error = |presses: &[Press]| mean_error(presses, |contact| simulated(&table, contact));
    let bare = mean_error(&right, |_| BACKGROUND.clone());
    let (there, here) = (error(&left[..6]), error(&right));
    println!("left {there:.2} levels, right {here:.2}, its background alone {bare:.2}");
    assert!(there < 2.6 && here < bare, "{there} {here} {bare}");
}
