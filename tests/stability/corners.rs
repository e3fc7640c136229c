//! Jobs at random corners of all ranges at once: what no named case has put together.

use std::panic::{AssertUnwindSafe, catch_unwind};
use std::time::{Duration, Instant};

use gelsim_core::fidelity::Fidelity;

use super::case::{Case, Dress};
use super::shapes::{Random, Shape};
use super::sound;

/// Keys with values at the ends of their ranges, and some between.
const KEYS: [(&str, &[&str]); 44] = [
    ("sensor.gelpad_youngs_modulus_kpa", &["1e-3", "1e9"]),
    ("sensor.darkening", &["0.0", "1.0"]),
    ("sensor.stray_light", &["[0.0, 0.0, 0.0]", "[0.4, 0.0, 1.0]"]),
    (
        "sensor.rendered_background.pattern",
        &["{ red = [0,0,0,0,0,0,0,0,0,0,0,0,0,0,0], green = [1,0,0,0,0,0,0,0,0,0,0,0,0,0,0], \
             blue = [100,-100,100,-100,100,-100,100,-100,100,-100,100,-100,100,-100,100] }"],
    ),
    ("sensor.rendered_background.color", &["[0.0, 0.0, 0.0]", "[1.0, 1.0, 1.0]"]),
    ("sensor.rendered_background.glow", &["0.0", "10.0"]),
    ("sensor.rendered_background.glow_reach_mm", &["1e-3", "1e6"]),
    ("sensor.rendered_background.vignette", &["0.0", "1.0"]),
    ("sensor.rendered_background.grain", &["0.0", "1.0"]),
    ("sensor.rendered_background.grain_size_mm", &["1e-3", "1e3"]),
    ("sensor.rendered_background.dust_per_cm2", &["0.0", "1e3"]),
    ("sensor.rendered_background.dust_size_mm", &["1e-3", "10.0"]),
    (
        "sensor.light_residual",
        &[
            "{ steepest = 0.01, heights_mm = [0.0, 0.0], red = [100,100,100,100,100,100,100,100,100,100,100,100], \
             green = [0,0,0,0,0,0,0,0,0,0,0,0], blue = [0,0,0,0,0,0,0,0,0,-100,100,-100] }",
            "{ steepest = 1.0, heights_mm = [-100.0, 100.0], red = [100,-100,100,-100,100,-100,100,-100,100,-100,100,-100], \
             green = [1,0,0,0,0,0,0,0,0,0,0,0], blue = [0,0,0,0,0,0,0,0,0,100,100,100] }",
        ],
    ),
    ("sensor.grain", &["{ height_um = 100.0, size_mm = 1e-3 }", "{ height_um = 100.0, size_mm = 1e3 }"]),
    ("pose.yaw_deg", &["1e-9", "45.0", "-90.0", "3600.0"]),
    ("pose.tilt_deg", &["1e-9", "0.01", "89.9999", "90.0", "-90.0"]),
    ("pose.tilt_azimuth_deg", &["0.0", "90.0", "-3600.0"]),
    ("pose.face", &["'any'", "'+x'", "'-y'"]),
    ("pose.anchor", &["'bounds'", "'contact'"]),
    ("pose.x_mm", &["1e-9", "1e4"]),
    ("texture.patterns", &["['brushed']", "['knurled']", "['woven']", "['dimples']"]),
    ("texture.amplitude_mm", &["0.0", "1e-9", "10.0"]),
    ("texture.scale_mm", &["1e-3", "1e3"]),
    ("shear.x_mm", &["0.0", "-10.0", "10.0"]),
    ("shear.twist_deg", &["0.0", "-45.0", "45.0"]),
    ("shear.friction", &["'stick'", "{ coulomb = { coefficient = 0.0 } }", "{ coulomb = { coefficient = 10.0 } }"]),
    ("markers.pitch_mm", &["0.05", "1.5", "1e3"]),
    ("markers.diameter_mm", &["0.0", "0.4", "100.0"]),
    ("markers.jitter_mm", &["0.0", "100.0"]),
    ("markers.edge_mm", &["0.0", "10.0"]),
    ("optics.MODEL.ambient", &["0.0", "1.0"]),
    ("optics.MODEL.diffuse", &["0.0", "10.0"]),
    ("optics.MODEL.specular", &["0.0", "10.0"]),
    ("optics.MODEL.shininess", &["0.0", "0.5", "1.0", "65.0", "1000.0"]),
    ("optics.MODEL.darkening", &["0.0", "1.0"]),
    ("optics.MODEL.equation", &["'literal'"]),
    (
        "optics.MODEL.shadows",
        &["'none'", "{ soft = { resolution = 'full' } }", "{ soft = { resolution = 'quarter' } }"],
    ),
    ("camera.distortion_k1", &["-0.25", "0.0", "1.0"]),
    ("camera.distortion_k2", &["0.0", "1.0"]),
    ("camera.vignette", &["0.0", "1.0"]),
    ("camera.defocus_mm", &["0.0", "1.0"]),
    ("camera.exposure", &["0.01", "100.0"]),
    ("camera.red_gain", &["0.01", "100.0"]),
    ("camera.shot_noise_levels", &["0.0", "255.0"]),
];

fn pick<T: Copy>(random: &mut Random, values: &[T]) -> T {
    values[(random.unit() * values.len() as f64) as usize]
}

fn led(random: &mut Random) -> String {
    let mut one = |values: &[&str]| pick(random, values).to_owned();
    format!(
        "{{ azimuth_deg = {}, elevation_deg = {}, angular_size_deg = {}, distance_mm = {}, intensity = {} }}",
        one(&["0.0", "90.0", "123.0", "-3600.0"]),
        one(&["0.0", "1e-9", "8.5", "45.0", "90.0"]),
        one(&["[0.0, 0.0]", "[40.0, 10.0]", "[90.0, 90.0]"]),
        one(&["0.01", "1.0", "20.0", "1e6"]),
        one(&["0.0", "1.0", "100.0"]),
    )
}

fn case(random: &mut Random) -> Case {
    let px = pick(random, &[[1, 1], [2, 1], [3, 5], [24, 18], [7, 64], [61, 1]]);
    let pitch = pick(random, &[1e-5, 1e-3, 0.05, 0.4, 0.4, 10.0, 200.0]);
    let pitches = [pitch, pitch * pick(random, &[1.0, 1.0, 1.0, 0.03, 900.0])];
    let mm_per_px = [0, 1].map(|k| (pitches[k] * f64::from(px[k])).clamp(1e-3, 1e4) / f64::from(px[k]));
    let thickness_mm = pick(random, &[0.01, 0.05, 0.5, 3.0, 3.0, 1000.0]);
    let depth_mm = thickness_mm * pick(random, &[1e-9, 1e-3, 0.1, 0.3, 0.99]);
    let size = (0..2).map(|k| f64::from(px[k]) * mm_per_px[k]).fold(0.0, f64::max);
    let shape = match (random.unit() * 6.0) as u32 {
        0 => Shape::ball(0.3 * size, 24, 12),
        1 => Shape::plate(0.5 * size, 0.5 * size),
        2 => Shape::plate(9.0 * size, 9.0 * size),
        3 => Shape::cap(size, size),
        4 => Shape::tiles(px, mm_per_px, 8, |i, j| {
            (((i * 7 + j * 13) & 3) > 0).then_some(f64::from((i * 5 + j * 3) & 7) * 0.1 * depth_mm)
        }),
        _ => Shape::soup([[[0.0, 0.0, 0.0], [size, 0.1 * size, 0.0], [0.0, size, 0.3 * size]]]),
    };
    let mut case =
        Case::new("corner", "").view(px, mm_per_px).pad(thickness_mm, pick(random, &[0.0, 0.3, 0.48, 0.4999]));
    for (key, values) in KEYS {
        if random.unit() < 0.25 {
            case = case.set(format!("{key} = {}", pick(random, values)));
        }
    }
    if random.unit() < 0.5 {
        let leds: Vec<String> = (0..1 + (random.unit() * 3.0) as usize).map(|_| led(random)).collect();
        case = case.set(format!("sensor.led = [{}]", leds.join(", ")));
    }
    case.shape(shape).depth(depth_mm)
}

#[test]
fn random_corners_of_all_ranges_give_sound_samples_or_are_refused() {
    let jobs: u64 = if crate::thorough() { 200 } else { 80 };
    let (mut refused, mut wrong, mut slowest) = (0, Vec::new(), (Duration::ZERO, String::new()));
    for number in 0..jobs {
        let mut random = Random(1000 + number);
        let case = case(&mut random);
        let dress = pick(&mut random, &[Dress::Plain, Dress::Still, Dress::Noisy]);
        let rung = pick(&mut random, &Fidelity::ALL);
        let start = Instant::now();
        let outcome = catch_unwind(AssertUnwindSafe(|| match case.plan(dress) {
            Ok(plan) => sound::check(&plan.with_fidelity(rung)).map(|_| false),
            Err(_) => Ok(true),
        }));
        let what = || format!("job {number}, {dress:?}, {}: {case:?}", rung.name());
        match outcome {
            Ok(Ok(was_refused)) => refused += u64::from(was_refused),
            Ok(Err(text)) => wrong.push(format!("{text}: {}", what())),
            Err(_) => wrong.push(format!("panicked: {}", what())),
        }
        if start.elapsed() > slowest.0 {
            slowest = (start.elapsed(), what());
        }
    }
    println!(
        "random corners: {jobs} jobs, {refused} refused; the slowest took {} ms: {}",
        slowest.0.as_millis(),
        slowest.1
    );
    assert!(wrong.is_empty(), "{} findings:\n{}", wrong.len(), wrong.join("\n"));
    assert!(refused < jobs / 3, "{refused} of {jobs} jobs were refused");
}
