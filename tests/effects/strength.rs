//! An effect of strength zero is none at all, and a pad that nothing touches is the untouched pad, byte for byte.

use std::cell::RefCell;

use gelsim_core::effects::{Effect, EffectPolicy};
use gelsim_files::sensor::quantity::Quantity;
use gelsim_job::config::Job;
use gelsim_job::plan::Plan;
use gelsim_job::sample::render;
use proptest::test_runner::{Config, RngSeed, TestCaseError, TestRunner};

use crate::plan::plan;
use crate::random_jobs::{Draw, job};

/// Presses of every kind of pad, and none.
const PRESSES: [&str; 5] = [
    "gelpad.none = {}\nindentation.depth_mm = 0.6\n",
    "fidelity = 'paper'\nindentation.depth_mm = 0.6\n",
    "gelpad.gaussian = { kernels_px = [5] }\nindentation.depth_mm = 0.6\n",
    "fidelity = 'standard'\nindentation.depth_mm = 0.6\n",
    "fidelity = 'standard'\nindentation = { depth_mm = 0.6, no_contact = 1.0 }\n",
];

fn plan_of(press: &str, more: &str) -> Plan {
    plan(&format!(
        "{press}{more}\ndataset = {{ name = 'zero', samples = 1 }}\nsensor.resolution_px = [48, 36]\n\
         object = [{{ path = 'objects/gear.obj' }}]\n"
    ))
}

fn image(press: &str, more: &str) -> Vec<u8> {
    render(&plan_of(press, more), 0).impression.image.rgb
}

/// Lines of a job that ask for an effect at strength zero, and those without which it is none.
const ZEROS: [(&str, &str); 15] = [
    ("texture = { patterns = ['noise', 'woven'], amplitude_mm = 0.0 }", ""),
    ("texture.amplitude_mm = { choice = [0.0] }", ""),
    ("markers.diameter_mm = 0.0", ""),
    ("markers.diameter_mm = { choice = [0.0] }", ""),
    ("markers = {}\nshear = { x_mm = 0.0, y_mm = 0.0, twist_deg = 0.0 }", "markers = {}"),
    (
        "markers = {}\nshear = { x_mm = { choice = [0.0] }, friction = { coulomb = { coefficient = 0.3 } } }",
        "markers = {}",
    ),
    ("markers.color = [1.0, 1.0, 1.0]", ""),
    ("camera = {}", ""),
    ("camera = { distortion_k1 = 0.0, vignette = 0.0, defocus_mm = 0.0, exposure = 1.0, read_noise_levels = 0.0 }", ""),
    (
        "camera = { distortion_k1 = { choice = [0.0] }, distortion_k2 = { choice = [0.0] }, vignette = { choice = [0.0] }, \
         defocus_mm = { choice = [0.0] }, exposure = { choice = [1.0] }, red_gain = { choice = [1.0] }, \
         shot_noise_levels = { choice = [0.0] } }",
        "",
    ),
    ("sensor.grain = { height_um = 0.0, size_mm = 0.1 }", ""),
    ("optics = 'led'\nsensor.coat.albedo = 0.0", "optics = 'led'"),
    // A window between equal bodies reflects only what runs along it.
    ("optics = 'led'\nsensor.window = { distance_mm = 900.0, refractive_index = 1.0 }", "optics = 'led'"),
    // What an LED looks like is only seen in the shadows that it casts.
    (
        "optics.phong.shadows = 'none'\nsensor.led = [{ angular_size_deg = [40.0, 40.0] }]",
        "optics.phong.shadows = 'none'\nsensor.led = [{}]",
    ),
    (
        "sensor.led = [{ elevation_deg = 80.0, angular_size_deg = [0.0, 0.0] }]",
        "sensor.led = [{ elevation_deg = 80.0, angular_size_deg = [5.0, 5.0] }]\noptics.phong.shadows = 'none'",
    ),
];

#[test]
fn an_effect_of_strength_zero_does_not_move_the_image() {
    for press in PRESSES {
        for (zero, none) in ZEROS {
            // A gear's walls rise above any LED where nothing smooths them.
            let steep = zero.contains("80.0") && press.contains("none = {}");
            assert!(steep || image(press, zero) == image(press, none), "{zero} in\n{press}");
        }
    }
}

#[test]
fn a_pad_that_is_hardly_curved_is_hardly_another_one() {
    for press in PRESSES {
        let (curved, flat) = (image(press, "sensor.rest_shape.dome.radius_mm = 1e6"), image(press, ""));
        let levels = |(a, b): (&u8, &u8)| a.abs_diff(*b);
        let most = curved.iter().zip(&flat).map(levels).max().unwrap_or(0);
        let moved = curved.iter().zip(&flat).filter(|pair| levels(*pair) > 0).count();
        println!("dome of 1 km: {moved} of {} values differ, by up to {most}", flat.len());
        assert!(most <= 1 && moved < flat.len() / 50, "{moved} values by up to {most} in\n{press}");
    }
}

#[test]
fn an_effect_that_is_left_out_is_as_one_that_the_job_does_not_have() {
    let cases = [
        (Effect::Texture, "texture = { amplitude_mm = 0.1, scale_mm = 2.0 }"),
        (Effect::Markers, "markers = {}"),
        (Effect::Defocus, "camera.defocus_mm = 0.5"),
        (Effect::Distortion, "camera.distortion_k1 = 0.2"),
        (Effect::Vignette, "camera.vignette = 0.5"),
        (Effect::Exposure, "camera.exposure = 1.4"),
        (Effect::Noise, "camera.read_noise_levels = 4.0"),
    ];
    for press in PRESSES {
        for (effect, lines) in cases {
            let (with, none) = (plan_of(press, lines), image(press, ""));
            let left_out = render(&with.with_policy(EffectPolicy::Without(effect)), 0);
            assert!(left_out.impression.image.rgb == none, "{} in\n{press}", effect.name());
            let texture_on_nothing = effect == Effect::Texture && press.contains("no_contact");
            assert_eq!(
                render(&with, 0).impression.image.rgb != none,
                !texture_on_nothing,
                "{} is seen in\n{press}",
                effect.name()
            );
        }
    }
}

/// The same job with nothing that touches the pad.
fn without_contact(job: &str) -> String {
    let lines = job.lines().filter(|line| !line.starts_with("no_contact"));
    let lines = lines.flat_map(|line| match line {
        "[indentation]" => vec![line, "no_contact = 1.0"],
        line => vec![line],
    });
    lines.collect::<Vec<_>>().join("\n")
}

/// True if the camera and the print are the same in every sample, and nothing is noisy.
fn constant(job: &Job) -> bool {
    let camera = &job.camera;
    let quantities = [
        &camera.distortion_k1,
        &camera.distortion_k2,
        &camera.vignette,
        &camera.defocus_mm,
        &camera.exposure,
        &camera.red_gain,
        &camera.blue_gain,
    ];
    let printed = job.markers.iter().flat_map(|markers| markers.quantities());
    let noiseless = [&camera.shot_noise_levels, &camera.read_noise_levels, &camera.speckle_levels]
        .iter()
        .all(|law| law.support() == (0.0, 0.0));
    noiseless && quantities.into_iter().chain(printed).all(|law| matches!(law, Quantity::Constant(_)))
}

#[test]
fn a_pad_that_nothing_touches_is_the_untouched_pad() {
    let cases = if crate::thorough() { 300 } else { 120 };
    let config = Config { cases, rng_seed: RngSeed::Fixed(2), failure_persistence: None, ..Config::default() };
    let tried = RefCell::new(0);
    let result = TestRunner::new(config).run(&job(Draw::Effects), |job| {
        let job = without_contact(&job);
        let gated = plan(&job);
        if constant(gated.job()) {
            *tried.borrow_mut() += 1;
            for plan in [gated.with_policy(EffectPolicy::All), gated] {
                let (image, untouched) = (render(&plan, 0).impression.image, &plan.simulator.untouched());
                let counts = (image.clipped_px, image.saturated_px) == (untouched.clipped_px, untouched.saturated_px);
                if image.rgb != untouched.rgb || !counts {
                    return Err(TestCaseError::fail(job));
                }
            }
        }
        Ok(())
    });
    result.unwrap_or_else(|error| panic!("{error}"));
    assert!(*tried.borrow() > cases / 15, "{} jobs", tried.borrow());
}
