//! Detection on presses that the simulator makes, where the circle is known, and on pictures without any.

use std::path::Path;

use gelsim_files::diagnostic::Diagnostics;
use gelsim_files::sensor::PRESETS;
use gelsim_job::config::{self, Overrides};
use gelsim_job::plan::Plan;
use gelsim_job::sample::render;
use gelsim_lab::calibrate::detect::detect_disc;
use gelsim_lab::calibrate::outliers::{OutlierReason, outlier_reasons};
use gelsim_lab::metrics::statistics::median;
use gelsim_lab::presses::Circle;
use image::{Rgb, RgbImage};

use crate::is_flat;

/// Presses of a ball of 4 mm on a sensor; `more` stands at the end of the job.
pub fn plan(sensor: &str, pose: &str, more: &str) -> Plan {
    let job = format!(
        "[dataset]\nname = \"presses\"\nsamples = 100\nseed = 7\n[sensor]\npreset = \"{sensor}\"\n\
         [[object]]\npath = \"objects/sphere.obj\"\n[pose]\n{pose}\n\
         [indentation]\ndepth_mm = [0.25, 0.6]\n[output]\nlayers = []\n{more}"
    );
    let mut problems = Diagnostics::default();
    let folder = Path::new(env!("CARGO_MANIFEST_DIR"));
    let written = config::read_job_text("job", job, folder, &Overrides::default(), &mut problems);
    match Plan::resolve(written, problems) {
        Ok(plan) => plan,
        Err(report) => panic!("{report}"),
    }
}

/// Image, untouched pad and true contact of a sample.
pub fn press(plan: &Plan, index: u64) -> (RgbImage, RgbImage, Circle) {
    let sample = render(plan, index);
    let picture = |image: &gelsim_core::camera::Image| {
        RgbImage::from_raw(image.width as u32, image.height as u32, image.rgb.clone()).expect("all pixels")
    };
    let camera = plan.simulator.view();
    let [x, y] = [0, 1].map(|k| {
        let middle = camera.resolution_px[k] as f64 / 2.0 - 0.5;
        middle + sample.label.pose.translation_mm[k] / camera.mm_per_px[k]
    });
    // The contact is round: its radius is that of its largest row or column, also if a part of it is out of view.
    let mask = &sample.impression.contact.mask;
    let wide = (0..mask.height).map(|y| mask.row(y).iter().filter(|value| **value > 0).count()).max();
    let tall = (0..mask.width).map(|x| (0..mask.height).filter(|y| mask.at(x, *y) > 0).count()).max();
    let radius_px = wide.max(tall).expect("a picture") as f64 / 2.0;
    (picture(&sample.impression.image), picture(plan.simulator.untouched()), Circle { centre_px: [x, y], radius_px })
}

fn distance_px(a: &Circle, b: &Circle) -> f64 {
    (a.centre_px[0] - b.centre_px[0]).hypot(a.centre_px[1] - b.centre_px[1])
}

const CAMERA: &str = "[camera]\nread_noise_levels = 2.0\nexposure = [0.95, 1.05]\n";

#[test]
fn discs_are_found_on_every_sensor_through_noise_and_drift() {
    for (sensor, _) in PRESETS.into_iter().filter(|(name, _)| is_flat(name)) {
        let plan = plan(sensor, "x_mm = [-3.0, 3.0]\ny_mm = [-3.0, 3.0]", CAMERA);
        let (mut far, mut ratio) = (Vec::new(), Vec::new());
        for index in 0..10 {
            let (image, background, truth) = press(&plan, index);
            let found = detect_disc(&image, &background).expect("a disc");
            far.push(distance_px(&found.circle, &truth));
            ratio.push(found.circle.radius_px / truth.radius_px);
            let far = far[index as usize];
            assert!(far < 8.0 && (far < 3.0 || found.confidence < 0.5), "{sensor}: {far} px and {}", found.confidence);
        }
        let [middle, size] = [&far, &ratio].map(|values| median(values).expect("ten"));
        println!("{sensor}: {middle:.2} px, radius {size:.3}");
        // What is pressed in changes colour all over on a DIGIT, on one side hardly against the pad around.
        let near = if sensor == "digit" { 7 } else { 9 };
        assert!(middle < 1.5 && far.iter().filter(|far| **far < 3.0).count() >= near, "{sensor}: {far:?}");
        // The visible disc is the contact times a factor, the same for all presses of a sensor.
        assert!((0.9..1.3).contains(&size) && ratio.iter().all(|r| (r / size - 1.0).abs() < 0.2), "{ratio:?}");
    }
}

#[test]
fn a_disc_that_is_partly_out_of_view_is_found_and_named() {
    let plan = plan("gelsight-mini", "x_mm = 8.9\ny_mm = [-4.0, 4.0]", CAMERA);
    for index in 0..6 {
        let (image, background, truth) = press(&plan, index);
        let found = detect_disc(&image, &background).expect("a disc");
        assert!(distance_px(&found.circle, &truth) < 0.25 * truth.radius_px, "{found:?} instead of {truth:?}");
        let named = outlier_reasons(&image, &background, &truth);
        assert!(
            named.iter().any(|one| matches!(one, OutlierReason::OutOfView { fraction } if *fraction > 0.2)),
            "{named:?}"
        );
    }
}

/// Grey levels that look random, within 4 of 0.
fn noise(x: u32, y: u32, k: u32) -> i32 {
    let mut bits = (x * 640 + y) * 3 + k;
    bits = (bits ^ (bits >> 16)).wrapping_mul(0x7feb_352d);
    bits = (bits ^ (bits >> 15)).wrapping_mul(0x846c_a68b);
    (bits >> 16) as i32 % 9 - 4
}

fn noisy(image: &RgbImage, gain: f64) -> RgbImage {
    RgbImage::from_fn(image.width(), image.height(), |x, y| {
        let pixel = image.get_pixel(x, y).0;
        let level = |k: usize| (gain * f64::from(pixel[k])) as i32 + noise(x, y, k as u32);
        Rgb([0, 1, 2].map(|k| level(k).clamp(0, 255) as u8))
    })
}

#[test]
fn nothing_pressed_is_nothing_sure() {
    let (_, background, circle) = press(&plan("gelsight-mini", "x_mm = 0.0\ny_mm = 0.0", ""), 0);
    assert_eq!(detect_disc(&background, &background), None);
    let mut specks = noisy(&background, 0.97);
    for (x, y, size) in [(40, 50, 3), (200, 120, 6), (290, 200, 2), (100, 220, 4)] {
        for (x, y) in (x..x + size).flat_map(|x| (y..y + size).map(move |y| (x, y))) {
            specks.put_pixel(x, y, Rgb([0, 10, 20]));
        }
    }
    for image in [noisy(&background, 1.0), noisy(&background, 1.1), specks] {
        let found = detect_disc(&image, &background);
        assert!(found.is_none_or(|found| found.confidence < 0.2), "{found:?}");
        assert!(outlier_reasons(&image, &background, &circle).contains(&OutlierReason::NoChange));
    }
}

#[test]
fn dust_beside_a_press_does_not_catch_the_eye() {
    let plan = plan("gelsight-mini", "x_mm = [-3.0, 3.0]\ny_mm = [-2.0, 2.0]", CAMERA);
    for index in 0..4 {
        let (mut image, background, truth) = press(&plan, index);
        for (x, y) in [(12, 20), (300, 30), (30, 220), (280, 200)] {
            (0..25).for_each(|k| image.put_pixel(x + k % 5, y + k / 5, Rgb([255, 255, 0])));
        }
        let found = detect_disc(&image, &background).expect("a disc");
        assert!(distance_px(&found.circle, &truth) < 3.0, "{found:?} instead of {truth:?}");
    }
}

#[test]
fn right_circles_pass_and_wrong_ones_are_named() {
    let plan = plan("gelsight-mini", "x_mm = [-4.0, 4.0]\ny_mm = [-3.0, 3.0]", CAMERA);
    let (mut passed, mut moved, mut grown) = (0, 0, 0);
    for index in 0..10 {
        let (image, background, circle) = press(&plan, index);
        let named = |circle: Circle| !outlier_reasons(&image, &background, &circle).is_empty();
        passed += usize::from(!named(circle));
        moved += usize::from(named(Circle { centre_px: [circle.centre_px[0] + 12.0, circle.centre_px[1]], ..circle }));
        grown += usize::from(named(Circle { radius_px: 1.5 * circle.radius_px, ..circle }));
    }
    assert!(passed >= 9 && moved >= 9 && grown >= 9, "{passed} {moved} {grown}");
}

#[test]
fn saturated_presses_are_named() {
    let (mut image, background, circle) = press(&plan("gelsight-mini", "x_mm = 0.0\ny_mm = 0.0", ""), 0);
    for pixel in image.pixels_mut() {
        pixel.0 = pixel.0.map(|level| level.saturating_mul(4));
    }
    let named = outlier_reasons(&image, &background, &circle);
    assert!(
        named.iter().any(|one| matches!(one, OutlierReason::Saturated { fraction } if *fraction > 0.9)),
        "{named:?}"
    );
}

#[test]
fn no_picture_is_too_odd() {
    for (width, height) in [(1, 1), (2, 1), (1, 300), (300, 1), (7, 7), (24, 24), (640, 3)] {
        let pictures = [
            RgbImage::new(width, height),
            RgbImage::from_pixel(width, height, Rgb([255; 3])),
            noisy(&RgbImage::from_pixel(width, height, Rgb([128; 3])), 1.0),
        ];
        for (image, background) in pictures.iter().flat_map(|a| pictures.iter().map(move |b| (a, b))) {
            if let Some(found) = detect_disc(image, background) {
                let Circle { centre_px: [x, y], radius_px } = found.circle;
                assert!(x.is_finite() && y.is_finite() && radius_px > 0.0 && (0.0..=1.0).contains(&found.confidence));
                assert!(found.confidence < 0.5, "{found:?} in {width} x {height}");
            }
            for circle in [[0.0, 0.0, 1.0], [-1e300, 1e300, 1e-300], [0.5, 0.5, 1e300]] {
                let circle = Circle { centre_px: [circle[0], circle[1]], radius_px: circle[2] };
                outlier_reasons(image, background, &circle).iter().for_each(|one| assert!(!one.to_string().is_empty()));
            }
        }
    }
}
