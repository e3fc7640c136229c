//! Jobs nobody thought of: random valid ones render, random values are accepted or refused, random text is read or
//! refused, and nothing panics. In the process itself, so that a panic shows where it comes from.

use gelsim_files::diagnostic::{Diagnostics, DisplayOptions, Report};
use gelsim_job::config::{self, Overrides};
use gelsim_job::plan::Plan;
use gelsim_job::sample::render;
use proptest::prelude::*;
use proptest::sample::select;
use proptest::test_runner::RngSeed;

use crate::random_jobs::mistakes::{edit, edited, nasty_number};
use crate::random_jobs::{Draw, job, keys_of_numbers};
use crate::support::repository;

/// Resolves a job whose paths are relative to the repository.
fn resolve(text: &str, set: Vec<(String, String)>) -> Result<Plan, Report> {
    let mut problems = Diagnostics::default();
    let overrides = Overrides { set, fidelity: None };
    let written = config::read_job_text("job.toml", text.to_owned(), repository(), &overrides, &mut problems);
    Plan::resolve(written, problems)
}

/// What a label need not know.
const NULLS: [&str; 14] = [
    "/object/material/youngs_modulus_kpa",
    "/object/material/poisson_ratio",
    "/object/material/friction",
    "/contact/force_n",
    "/contact/total_force_n",
    "/contact/total_force_at_least_n",
    "/contact/in_view_fraction",
    "/contact/peak_pressure_kpa",
    "/numerics/residual_um",
    "/numerics/model_error_um",
    "/numerics/light_error_levels",
    "/shear/force_n",
    "/shear/torque_nmm",
    "/shear/slipping",
];

/// Where nulls are.
fn find_nulls(value: &serde_json::Value, path: &str, found: &mut Vec<String>) {
    match value {
        serde_json::Value::Null => found.push(path.to_owned()),
        serde_json::Value::Array(items) => {
            items.iter().enumerate().for_each(|(at, item)| find_nulls(item, &format!("{path}/{at}"), found));
        }
        serde_json::Value::Object(map) => {
            map.iter().for_each(|(key, item)| find_nulls(item, &format!("{path}/{key}"), found));
        }
        _ => (),
    }
}

fn resolve_valid(text: &str) -> Plan {
    resolve(text, Vec::new()).unwrap_or_else(|report| panic!("{report}\nin\n{text}"))
}

/// A number that is put in the place of a key's.
fn setting(key: &str, value: &str) -> (String, String) {
    (String::from("--set"), format!("{key} = {value}"))
}

/// Numbers in lists and distributions of the plain job, or of tables that it has not; the random jobs' keys take the
/// others.
const NUMBERS_WITHIN: &[&str] = &[
    "dataset.splits.train",
    "dataset.splits.val",
    "dataset.splits.test",
    "sensor.field_of_view_mm.0",
    "sensor.field_of_view_mm.1",
    "sensor.gelpad_thickness_mm",
    "sensor.rendered_background.color.0",
    "sensor.led.0.azimuth_deg",
    "sensor.led.0.elevation_deg",
    "sensor.led.0.color.2",
    "sensor.led.0.intensity",
    "object.0.weight",
    "object.1.weight",
    "pose.tilt_deg.uniform.0",
    "pose.tilt_deg.uniform.1",
    "pose.x_mm.normal.mean",
    "pose.x_mm.normal.std",
    "pose.x_mm.normal.min",
    "pose.x_mm.normal.max",
    "pose.y_mm.0",
    "pose.y_mm.1",
    "indentation.depth_mm.log_uniform.0",
    "indentation.depth_mm.log_uniform.1",
    "gelpad.mean_blur.kernel_px",
    "gelpad.mean_blur.passes",
    "gelpad.gaussian.kernels_px.0",
    "gelpad.gaussian.smoothing_px",
    "gelpad.elastic.tolerance_um",
    "gelpad.elastic.max_iterations",
    "fidelity.max_error_um",
    "fidelity.max_ms",
];

/// Of the image's size only small ones are tried: a large one is no mistake, only slow.
const SIZES: [&str; 2] = ["sensor.resolution_px.0", "sensor.resolution_px.1"];

/// Every key that takes a number.
fn numbers() -> Vec<String> {
    NUMBERS_WITHIN.iter().map(|key| key.to_string()).chain(keys_of_numbers()).collect()
}

const PLAIN: &str = r#"
[dataset]
name = "plain"
samples = 3
splits = { train = 0.5, val = 0.25, test = 0.25 }
[sensor]
resolution_px = [8, 6]
field_of_view_mm = [20.0, 15.0]
rendered_background = { color = [0.5, 0.5, 0.5] }
[[sensor.led]]
color = [1.0, 0.5, 0.0]
[[object]]
path = "objects/cube.obj"
[[object]]
path = "objects/cube.obj"
weight = 2.0
[pose]
tilt_deg = { uniform = [0.0, 8.0] }
x_mm = { normal = { mean = 0.0, std = 1.0, min = -3.0, max = 3.0 } }
y_mm = [-2.0, 2.0]
[indentation]
depth_mm = { log_uniform = [0.3, 1.2] }
[output]
layers = ["depth", "contact"]
"#;

/// A report, plain and with colours, that says something about each problem.
fn assert_sound(report: &Report) {
    assert!(report.to_string().starts_with("error: "), "{report}");
    assert!(report.render(DisplayOptions { is_styled: true, columns: Some(40) }).contains("error"));
}

/// Few jobs, the same at every run; with `GELSIM_THOROUGH`, as in `.ci/run --full`, more of them and others each time.
fn config() -> ProptestConfig {
    let (cases, rng_seed) = match crate::thorough() {
        true => (256, RngSeed::Random),
        false => (64, RngSeed::Fixed(5)),
    };
    ProptestConfig { cases, rng_seed, failure_persistence: None, ..ProptestConfig::default() }
}

proptest! {
    #![proptest_config(config())]

    #[test]
    fn every_valid_job_renders_finite_samples(text in job(Draw::Ranges)) {
        let plan = resolve_valid(&text);
        for index in 0..plan.layout.sample_count() {
            let sample = render(&plan, index);
            prop_assert!(sample.label.health.finite, "sample {} of\n{}", index, text);
            prop_assert_eq!((sample.impression.image.width, sample.impression.image.height), (24, 18));
            prop_assert_eq!(sample.impression.image.rgb.len(), 24 * 18 * 3);
            let json = serde_json::to_value(&sample.label).expect("JSON");
            let mut found = Vec::new();
            find_nulls(&json, "", &mut found);
            let in_part = |path: &str| path.trim_start_matches("/objects/").trim_start_matches(char::is_numeric).to_owned();
            found.retain(|path| !NULLS.contains(&in_part(path).as_str()));
            prop_assert!(found.is_empty(), "NaN is written as null: {:?} of {}", found, json);
            let contact = &sample.label.contact;
            let is_split = sample.label.objects.iter().all(|object| object.contact.force_n.is_some());
            prop_assert!(is_split || contact.force_n.is_none(), "{:?}", contact);
            let depth = sample.label.contact.max_depth_mm;
            prop_assert!((0.0..=plan.thickness_mm()).contains(&depth), "{} mm deep in\n{}", depth, text);
        }
    }

    #[test]
    fn the_resolved_job_resolves_to_itself(text in job(Draw::Ranges)) {
        let plan = resolve_valid(&text);
        let resolved = plan.job().to_toml().expect("a job is TOML");
        let again = resolve_valid(&resolved);
        prop_assert_eq!(&plan.fingerprint, &again.fingerprint);
        prop_assert_eq!(resolved, again.job().to_toml().expect("a job is TOML"));
    }

    #[test]
    fn any_number_at_any_key_is_taken_or_refused(
        changes in proptest::collection::vec((select(numbers()), nasty_number()), 1..4),
        size in proptest::option::of((select(&SIZES), select(&["0", "1", "-1", "64", "8193", "1e3", "nan"]))),
    ) {
        let changes = changes.iter().map(|(key, value)| setting(key, value));
        let set: Vec<_> = changes.chain(size.map(|(key, value)| setting(key, value))).collect();
        match resolve(PLAIN, set.clone()) {
            Ok(plan) => {
                prop_assert!(plan.layout.shard_count() > 0, "{set:?}");
                prop_assert!(!plan.sampling.objects.is_empty());
            }
            Err(report) => assert_sound(&report),
        }
    }

    #[test]
    fn any_edit_of_a_job_is_taken_or_refused(edits in proptest::collection::vec(edit(), 1..4)) {
        let text = edits.iter().fold(PLAIN.to_owned(), |text, edit| edited(&text, edit));
        if let Err(report) = resolve(&text, Vec::new()) {
            assert_sound(&report);
        }
    }

    #[test]
    fn any_override_is_taken_or_refused(key in "[a-z_.0-9\"' ]{0,20}", value in "[-\\[\\]{}=\"a-z0-9., ]{0,12}") {
        if let Err(report) = resolve(PLAIN, vec![(String::from("--set"), format!("{key}={value}"))]) {
            assert_sound(&report);
        }
    }
}

#[test]
fn the_plain_job_of_these_tests_is_valid() {
    resolve_valid(PLAIN);
    for key in numbers().iter().map(String::as_str).chain(SIZES) {
        let Err(report) = resolve(PLAIN, vec![setting(key, "\"x\"")]) else { panic!("{key} takes a text") };
        assert!(!report.to_string().contains("unknown"), "{key} is no key: {report}");
    }
}
