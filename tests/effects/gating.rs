//! The proof that gating is safe: random samples with the effects that they call for against the same with all.
//!
//! Layers and labels must be the same. Where the surface is flat beyond what was shaded, so must the image be; else a
//! halo was cut that changes the light by less than [`BOUND`], which gains may raise, and rounding may tip.

use gelsim_core::simulator::Stages;
use std::cell::RefCell;
use std::collections::BTreeMap;

use gelsim_core::base::grid::Grid;
use gelsim_core::base::view::SURFACE_BORDER;
use gelsim_core::effects::{Effect, EffectLog, EffectPolicy, PerEffect};
use gelsim_core::optics::normals::surface_normals;
use gelsim_job::label::Label;
use gelsim_job::plan::Plan;
use gelsim_job::sample::Sample;
use gelsim_job::sample::render;
use proptest::test_runner::{Config, RngSeed, TestCaseError, TestRunner};

use crate::plan::plan;
use crate::random_jobs::{Draw, job, with_files};

/// What the halo that is cut changes at most, grey levels; see `src/optics/visible.rs`.
const BOUND: f64 = 0.45;

/// What was seen in all samples.
#[derive(Default)]
struct Tally {
    samples: u32,
    /// For each effect how often it ran, and how often only the wish for all made it run.
    ran_and_left_out: PerEffect<[u32; 2]>,
    /// By the gelpad's model.
    cuts: BTreeMap<String, Cut>,
}

/// What leaving out did to the images of samples.
#[derive(Default)]
struct Cut {
    /// Samples with nothing but flat surface left out.
    exact: u32,
    /// The others.
    halo: u32,
    /// Those of the others with a value that differs.
    moved: u32,
    /// Values of the others, and those that differ.
    values: u64,
    values_moved: u64,
    /// By most, grey levels.
    most: u8,
}

/// What is known of a sample but for its image and its effects: all bits of every layer.
fn layers(plan: &Plan, sample: &Sample) -> (Vec<Vec<u32>>, Grid<u8>) {
    let bits = |values: &[f32]| values.iter().map(|value| value.to_bits()).collect::<Vec<_>>();
    let contact = &sample.impression.contact;
    let pressure = contact.pressure.as_ref().map_or(Vec::new(), |pressure| bits(&pressure.data));
    let normals = bits(surface_normals(contact, plan.simulator.view()).as_flattened());
    let floats = vec![bits(&sample.impression.depth.below_pad().data), bits(&contact.surface.data), pressure, normals];
    (floats, contact.mask.clone())
}

/// The label without what became of the effects. A halo that is cut may have been beyond black or white.
fn label_without_effects(sample: &Sample, exact: bool) -> Label {
    let mut label = Label { effects: PerEffect::default(), ..sample.label.clone() };
    if !exact {
        (label.health.clipped_px, label.health.saturated_px) = (0, 0);
    }
    label
}

/// True if the surface is flat and at rest at every pixel that was not shaded.
fn flat_beyond_light(plan: &Plan, sample: &Sample) -> bool {
    let mut where_needed = EffectLog::new(EffectPolicy::WhereNeeded);
    let (contact, background) = (&sample.impression.contact, plan.simulator.background());
    let light = plan.simulator.shader().shade(contact, background, &mut where_needed).into_light();
    assert!(light.planes.iter().flatten().all(|value| value.is_finite()), "the light is finite");
    let (lit, surface) = (light.region, &contact.surface);
    let flat = |x: usize, y: usize| {
        let at = |dx: usize, dy: usize| surface.at(x + dx, y + dy);
        at(0, 1) == at(2, 1) && at(1, 0) == at(1, 2) && at(1, 1) == 0.0
    };
    let [width, height] = plan.simulator.view().resolution_px;
    assert_eq!((surface.width, surface.height), (width + 2 * SURFACE_BORDER, height + 2 * SURFACE_BORDER));
    let unlit = |x: usize, y: usize| !(lit.x0..lit.x1).contains(&x) || !(lit.y0..lit.y1).contains(&y);
    (0..height).all(|y| (0..width).all(|x| !unlit(x, y) || flat(x, y)))
}

/// Grey levels by which a halo that is cut may move a value.
fn allowed(label: &Label) -> u8 {
    let gain = label.camera.gains.iter().copied().fold(0.0, f64::max);
    let levels = BOUND * gain;
    // Noise goes with the root of the light, which moves most where it is dark; it stays within 5.2 standard deviations.
    let noise = 5.2 * label.camera.shot_noise_levels * (levels / 255.0).sqrt();
    (levels + noise).floor() as u8 + 1
}

fn differences<'a>(a: &'a Sample, b: &'a Sample) -> impl Iterator<Item = u8> + 'a {
    a.impression.image.rgb.iter().zip(&b.impression.image.rgb).map(|(a, b)| a.abs_diff(*b)).filter(|levels| *levels > 0)
}

/// Compares a job's samples with the effects that they call for and with all.
fn compare(job: &str, tally: &mut Tally) -> Result<(), String> {
    let gated = plan(job);
    let everything = gated.with_policy(EffectPolicy::All);
    for index in 0..gated.layout.sample_count() {
        let (sample, oracle) = (render(&gated, index), render(&everything, index));
        let wrong = |what: String| Err(format!("sample {index}: {what} in\n{job}"));
        if layers(&gated, &sample) != layers(&everything, &oracle)
            || sample.impression.markers != oracle.impression.markers
        {
            return wrong(String::from("another layer"));
        }
        let exact = flat_beyond_light(&gated, &sample);
        let (label, other) = (label_without_effects(&sample, exact), label_without_effects(&oracle, exact));
        if label != other || sample.impression.lens != oracle.impression.lens {
            return wrong(format!("{label:?} is not {other:?}"));
        }
        if !label.health.finite {
            return wrong(String::from("something is not finite"));
        }
        let (most, allowed) =
            (differences(&sample, &oracle).max().unwrap_or(0), if exact { 0 } else { allowed(&label) });
        if most > allowed {
            let count = differences(&sample, &oracle).count();
            return wrong(format!("{count} values differ by up to {most} levels; allowed: {allowed}"));
        }
        tally.add(&sample, &oracle, exact);
    }
    Ok(())
}

impl Tally {
    fn add(&mut self, sample: &Sample, oracle: &Sample, exact: bool) {
        self.samples += 1;
        for effect in Effect::ALL {
            let (ran, ran_there) = (sample.label.effects[effect].ran, oracle.label.effects[effect].ran);
            assert!(ran_there || !ran, "{} runs if all do", effect.name());
            assert!(!sample.label.effects[effect].reason.is_empty(), "{}", effect.name());
            let [run, left_out] = &mut self.ran_and_left_out[effect];
            *run += u32::from(ran);
            *left_out += u32::from(ran_there && !ran);
        }
        let cut = self.cuts.entry(sample.label.models.gelpad_model.clone()).or_default();
        if exact {
            cut.exact += 1;
            return;
        }
        let moved = differences(sample, oracle).count() as u64;
        cut.halo += 1;
        cut.moved += u32::from(moved > 0);
        cut.values += sample.impression.image.rgb.len() as u64;
        cut.values_moved += moved;
        cut.most = cut.most.max(differences(sample, oracle).max().unwrap_or(0));
    }

    fn show(&self) {
        for (effect, [ran, left_out]) in self.ran_and_left_out.iter() {
            println!("{:12} ran {ran:4}, left out {left_out:4} of {}", effect.name(), self.samples);
        }
        for (model, Cut { exact, halo, moved, values, values_moved, most }) in &self.cuts {
            let share = 100.0 * *values_moved as f64 / (*values).max(1) as f64;
            println!(
                "{model:12} {exact} exact; of {halo} others {moved} differ, in {share:.2} % of values, by up to {most}"
            );
        }
    }
}

#[test]
fn what_a_sample_does_not_call_for_would_not_change_it() {
    let cases = if crate::thorough() { 500 } else { 150 };
    let config = Config { cases, rng_seed: RngSeed::Fixed(1), failure_persistence: None, ..Config::default() };
    let tally = RefCell::new(Tally::default());
    let one = |job: String| compare(&job, &mut tally.borrow_mut()).map_err(TestCaseError::fail);
    let result = TestRunner::new(config).run(&job(Draw::Effects), one);
    let tally = tally.into_inner();
    tally.show();
    result.unwrap_or_else(|error| panic!("{error}"));
    // These jobs are single presses of linear pads: nothing relaxes, and finite strain is left out where it is small, not
    // where it changes nothing.
    let elsewhere = [Effect::FiniteStrain, Effect::Relaxation];
    for (effect, [ran, left_out]) in tally.ran_and_left_out.iter().filter(|(of, _)| !elsewhere.contains(of)) {
        // A camera is noisy everywhere or not at all.
        let both = *ran > cases / 50 && (*left_out > cases / 50 || effect == Effect::Noise);
        assert!(both, "{} ran {ran} times and was left out {left_out} times", effect.name());
    }
    for model in ["none", "mean_blur", "gaussian", "elastic"] {
        let Cut { exact, halo, .. } = tally.cuts[model];
        // Without a model of the pad there is no halo, but for presses that are nowhere steep enough to be seen.
        assert!(exact > cases / 50 && (halo > cases / 500 || model == "none"), "{model}: {exact} exact, {halo} others");
    }
    let moved: u64 = tally.cuts.values().map(|cut| cut.values_moved).sum();
    assert!(moved > 0, "nothing was ever cut: this test would not see what cutting does");
}

const BALL: &str = "
dataset = { name = 'hard', samples = 4 }
sensor.resolution_px = [48, 36]
object = [{ path = 'objects/sphere.obj' }]
indentation.depth_mm = 0.4
";

fn assert_gating_is_safe(lines: &str) {
    compare(&format!("{BALL}{lines}"), &mut Tally::default()).unwrap_or_else(|wrong| panic!("{wrong}"));
}

#[test]
fn what_comes_near_the_border_is_mirrored_there_by_defocus_and_lens() {
    for x_mm in [0.0, 6.2, 6.6, 7.0, 7.4, 7.8] {
        for camera in ["distortion_k1 = 0.25", "distortion_k1 = 0.25, defocus_mm = 0.5", "defocus_mm = 1.0"] {
            // Without shadows, which would reach the border themselves.
            let press = format!("gelpad.none = {{}}\noptics.phong.shadows = 'none'\npose.x_mm = {x_mm:?}");
            assert_gating_is_safe(&format!("{press}\ncamera = {{ {camera} }}"));
        }
    }
}

#[test]
fn dots_on_a_photograph_are_as_blurred_without_a_press_as_with_one() {
    let camera = "markers = {}\ncamera.defocus_mm = { choice = [0.3] }\nindentation.no_contact = 1.0\n";
    assert_gating_is_safe(&with_files(format!("{camera}sensor.background = 'PHOTOGRAPH'")));
}

#[test]
fn pixels_that_are_cut_are_counted_once() {
    for gelpad in ["gelpad.none = {}", "fidelity = 'standard'"] {
        let job = format!("{BALL}{gelpad}\noptics.phong.equation = 'literal'\ncamera.exposure = 2.0");
        compare(&job, &mut Tally::default()).unwrap_or_else(|wrong| panic!("{wrong}"));
        let clipped = render(&plan(&job), 0).label.health.clipped_px;
        assert!((1..=48 * 36).contains(&clipped), "{clipped} pixels");
    }
}

#[test]
fn an_object_that_rests_does_not_slip_even_without_friction() {
    assert_gating_is_safe(
        "markers = {}\nshear = { x_mm = { choice = [0.0, 0.3] }, friction = { coulomb = { coefficient = 0.0 } } }",
    );
}

#[test]
fn friction_that_nothing_shows_changes_nothing() {
    for elastic in ["tolerance_um = 300.0", "tolerance_um = 30.0", "resolution = 'half'"] {
        let press = format!("gelpad.elastic = {{ {elastic}, friction = 'stick' }}");
        assert_gating_is_safe(&press);
        assert_gating_is_safe(&format!("{press}\nmarkers = {{}}\nshear.x_mm = {{ choice = [0.0, 0.3] }}"));
    }
}

#[test]
fn a_near_led_gives_a_flat_pixel_the_same_in_every_part_of_the_view() {
    // Half of an odd grey level is on the edge between two.
    assert_gating_is_safe("gelpad.none = {}\noptics.led = {}\ncamera.exposure = 0.5");
    assert_gating_is_safe("gelpad.none = {}\noptics.led = { ambient = 0.0 }");
}

#[test]
fn a_pad_that_sinks_or_bulges_without_a_slope_is_seen_under_a_near_led() {
    for (distance_mm, elevation_deg) in [(5.0, 70.0), (8.0, 15.0), (9.0, 45.0), (30.0, 89.0)] {
        let optics = "optics.led = { darkening = 0.0, shadows = 'none', specular = 0.6 }";
        let led = format!("[[sensor.led]]\ndistance_mm = {distance_mm:?}\nelevation_deg = {elevation_deg:?}\n");
        for pad in ["fidelity = 'standard'", "gelpad.none = {}\nsensor.rest_shape.dome.radius_mm = 40.0"] {
            assert_gating_is_safe(&format!("{pad}\n{optics}\n{led}"));
        }
    }
}

#[test]
fn a_slope_too_flat_to_be_seen_may_cast_a_shadow_that_is() {
    let leds = "[[sensor.led]]\nelevation_deg = 3.0\nangular_size_deg = [6.0, 6.0]\n";
    let job =
        format!("{BALL}optics.phong = {{ diffuse = 0.0, specular = 1.5, shininess = 0.0, darkening = 0.0 }}\n{leds}");
    compare(&job, &mut Tally::default()).unwrap_or_else(|wrong| panic!("{wrong}"));
}

#[test]
fn leds_of_one_colour_each_are_seen_with_a_lobe_of_any_steepness() {
    let led = |azimuth: u32, color: &str| format!("[[sensor.led]]\nazimuth_deg = {azimuth}.0\ncolor = {color}\n");
    let leds = [led(0, "[1.0, 0.0, 0.0]"), led(120, "[0.0, 1.0, 0.0]"), led(240, "[0.0, 0.0, 1.0]")].concat();
    for shininess in [0.0, 0.5, 1.0, 30.0] {
        assert_gating_is_safe(&format!("optics.phong = {{ shininess = {shininess:?}, darkening = 0.0 }}\n{leds}"));
    }
}
