//! The proof that gating is safe: random samples with the effects that they call for against the same with all.
//!
//! Layers and labels must be the same. Where the surface is flat beyond what was shaded, so must the image be; else a
//! halo was cut that changes the light by less than [`BOUND`], which gains may raise, and rounding may tip.

use std::cell::RefCell;

use gelsim::effects::{Effect, Gate, Ledger, PerEffect};
use gelsim::gelpad::SURFACE_BORDER;
use gelsim::grid::Grid;
use gelsim::label::Label;
use gelsim::optics::normals::normals;
use gelsim::plan::Plan;
use gelsim::render::{Sample, render};
use proptest::test_runner::{Config, RngSeed, TestCaseError, TestRunner};

use crate::jobs::job;
use crate::plan::plan;

/// What the halo that is cut changes at most, grey levels; see `src/optics/visible.rs`.
const BOUND: f64 = 0.45;

/// What was seen in all samples.
#[derive(Default)]
struct Tally {
    samples: u32,
    /// For each effect how often it ran, and how often only all effects together made it run.
    ran_and_left_out: PerEffect<[u32; 2]>,
    /// With nothing but flat surface left out, and else.
    exact: u32,
    cut: u32,
    /// Of the latter with a value that differs; their values, and those that differ.
    moved: u32,
    values: u64,
    values_moved: u64,
    /// By most, grey levels.
    most: u8,
}

/// What is known of a sample but for its image and its effects: all bits of every layer.
fn layers(plan: &Plan, sample: &Sample) -> (Vec<Vec<u32>>, Grid<u8>) {
    let bits = |values: &[f32]| values.iter().map(|value| value.to_bits()).collect::<Vec<_>>();
    let contact = &sample.contact;
    let pressure = contact.pressure.as_ref().map_or(Vec::new(), |pressure| bits(&pressure.data));
    let normals = bits(normals(contact, &plan.camera).as_flattened());
    let floats = vec![bits(&sample.depth.below_pad().data), bits(&contact.surface.data), pressure, normals];
    (floats, contact.mask.clone())
}

/// The label without what became of the effects. A halo that is cut may have been beyond black or white.
fn described(sample: &Sample, exact: bool) -> Label {
    let mut label = Label { effects: PerEffect::default(), ..sample.label.clone() };
    if !exact {
        (label.health.clipped_px, label.health.saturated_px) = (0, 0);
    }
    label
}

/// True if the surface is flat and at rest at every pixel that was not shaded.
fn flat_beyond_light(plan: &Plan, sample: &Sample) -> bool {
    let light = plan.ready.shader.shade(&sample.contact, &plan.reference, &mut Ledger::new(Gate::CalledFor));
    let (lit, surface) = (light.region, &sample.contact.surface);
    let flat = |x: usize, y: usize| {
        let at = |dx: usize, dy: usize| surface.at(x + dx, y + dy);
        at(0, 1) == at(2, 1) && at(1, 0) == at(1, 2) && at(1, 1) == 0.0
    };
    let [width, height] = plan.camera.resolution_px;
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
    a.image.rgb.iter().zip(&b.image.rgb).map(|(a, b)| a.abs_diff(*b)).filter(|levels| *levels > 0)
}

/// Compares a job's samples with the effects that they call for and with all.
fn compare(job: &str, tally: &mut Tally) -> Result<(), String> {
    let gated = plan(job);
    let everything = gated.with_gate(Gate::All);
    for index in 0..gated.layout.samples() {
        let (sample, oracle) = (render(&gated, index), render(&everything, index));
        let wrong = |what: String| Err(format!("sample {index}: {what} in\n{job}"));
        if layers(&gated, &sample) != layers(&everything, &oracle) || sample.ink != oracle.ink {
            return wrong(String::from("another layer"));
        }
        let exact = flat_beyond_light(&gated, &sample);
        let (label, other) = (described(&sample, exact), described(&oracle, exact));
        if label != other || sample.lens != oracle.lens {
            return wrong(format!("{label:?} is not {other:?}"));
        }
        if !label.health.finite {
            return wrong(String::from("something is not finite"));
        }
        let (most, allowed) = (differences(&sample, &oracle).max().unwrap_or(0), if exact { 0 } else { allowed(&label) });
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
            assert!(ran_there || !ran, "{} runs only when it is called for", effect.name());
            let [run, left_out] = &mut self.ran_and_left_out[effect];
            *run += u32::from(ran);
            *left_out += u32::from(ran_there && !ran);
        }
        self.exact += u32::from(exact);
        if !exact {
            self.cut += 1;
            let count = differences(sample, oracle).count() as u64;
            self.moved += u32::from(count > 0);
            self.values += sample.image.rgb.len() as u64;
            self.values_moved += count;
            self.most = self.most.max(differences(sample, oracle).max().unwrap_or(0));
        }
    }

    fn show(&self) {
        for (effect, [ran, left_out]) in self.ran_and_left_out.iter() {
            println!("{:12} ran {ran:4}, left out {left_out:4} of {}", effect.name(), self.samples);
        }
        println!("nothing but flat surface left out: {}, all the same", self.exact);
        let share = 100.0 * self.values_moved as f64 / self.values.max(1) as f64;
        println!("halo cut: {}, {} of them differ, in {share:.2} % of values, by up to {}", self.cut, self.moved, self.most);
    }
}

#[test]
fn what_a_sample_does_not_call_for_would_not_change_it() {
    let cases: u32 = std::env::var("CASES").map_or(200, |c| c.parse().unwrap());
    let seed: u64 = std::env::var("SEED").map_or(1, |c| c.parse().unwrap());
    let config = Config { cases, rng_seed: RngSeed::Fixed(seed), failure_persistence: None, max_shrink_iters: 300, ..Config::default() };
    let tally = RefCell::new(Tally::default());
    let result = TestRunner::new(config).run(&job(), |job| {
        compare(&job, &mut tally.borrow_mut()).map_err(TestCaseError::fail)
    });
    tally.borrow().show();
    if let Err(error) = result {
        panic!("{error}");
    }
}

const FLAT_LIGHT: &str = "
dataset = { name = 'hard', samples = 1 }
sensor.resolution_px = [48, 36]
object = [{ path = 'objects/sphere.obj' }]
indentation.depth_mm = 0.4
";

#[test]
fn a_slope_too_flat_to_be_seen_may_cast_a_shadow_that_is() {
    let leds = "[[sensor.led]]\nelevation_deg = 3.0\nangular_size_deg = [6.0, 6.0]\n";
    let job = format!("{FLAT_LIGHT}optics.phong = {{ diffuse = 0.0, specular = 1.5, shininess = 0.0, darkening = 0.0 }}\n{leds}");
    compare(&job, &mut Tally::default()).unwrap_or_else(|wrong| panic!("{wrong}"));
}

#[test]
fn leds_of_one_colour_each_are_seen_with_a_lobe_of_any_steepness() {
    let led = |azimuth: u32, color: &str| format!("[[sensor.led]]\nazimuth_deg = {azimuth}.0\ncolor = {color}\n");
    let leds = [led(0, "[1.0, 0.0, 0.0]"), led(120, "[0.0, 1.0, 0.0]"), led(240, "[0.0, 0.0, 1.0]")].concat();
    for shininess in [0.0, 0.5, 1.0, 30.0] {
        let job = format!("{FLAT_LIGHT}optics.phong = {{ shininess = {shininess:?}, darkening = 0.0 }}\n{leds}");
        compare(&job, &mut Tally::default()).unwrap_or_else(|wrong| panic!("{wrong}"));
    }
}
