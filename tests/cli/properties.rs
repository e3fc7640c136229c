//! Jobs nobody thought of: random valid ones render, random values are accepted or refused, random text is read or
//! refused, and nothing panics. In the process itself, so that a panic shows where it comes from.

use gelsim_files::diagnostic::{Diagnostics, Display, Report};
use gelsim_job::config::{self, Overrides};
use gelsim_job::plan::Plan;
use gelsim_job::sample::render;
use proptest::prelude::*;

use crate::support::repository;

/// Resolves a job whose meshes are relative to `objects/`.
fn resolve(text: &str, set: Vec<(String, String)>) -> Result<Plan, Report> {
    let mut problems = Diagnostics::default();
    let overrides = Overrides { set, fidelity: None };
    let folder = repository().join("objects");
    let written = config::read_text("job.toml", text.to_owned(), &folder, &overrides, &mut problems);
    Plan::resolve(written, problems)
}

/// A number as TOML.
fn number(range: std::ops::RangeInclusive<f64>) -> impl Strategy<Value = String> {
    let (min, max) = (*range.start(), *range.end());
    prop_oneof![4 => (min..=max).boxed(), 1 => Just(min).boxed(), 1 => Just(max).boxed()]
        .prop_map(|value: f64| toml::Value::Float(value).to_string())
}

/// A random quantity with all its values in a range.
fn quantity(min: f64, max: f64) -> impl Strategy<Value = String> {
    let pair = (min..=max, min..=max).prop_map(|(a, b)| (a.min(b), a.max(b)));
    let positive = (min.max(1e-3)..=max, min.max(1e-3)..=max).prop_map(|(a, b)| (a.min(b), a.max(b)));
    prop_oneof![
        (min..=max).prop_map(|value| format!("{value:?}")),
        pair.clone().prop_map(|(a, b)| format!("[{a:?}, {b:?}]")),
        pair.clone().prop_map(|(a, b)| format!("{{ uniform = [{a:?}, {b:?}] }}")),
        positive.prop_map(|(a, b)| format!("{{ log_uniform = [{a:?}, {b:?}] }}")),
        // A mean inside the limits and a wide curve keep far more than 1 %.
        (pair, 0.0..=1.0_f64).prop_map(|((a, b), at)| {
            let (mean, std) = (a + (b - a) * at, b - a);
            format!("{{ normal = {{ mean = {mean:?}, std = {std:?}, min = {a:?}, max = {b:?} }} }}")
        }),
        proptest::collection::vec(min..=max, 1..5).prop_map(|values| format!("{{ choice = {values:?} }}")),
    ]
}

fn one_of(choices: &'static [&'static str]) -> impl Strategy<Value = &'static str> {
    proptest::sample::select(choices)
}

fn dataset() -> impl Strategy<Value = String> {
    let splits = one_of(&[
        "{ train = 1.0 }",
        "{ test = 1.0 }",
        "{ train = 0.5, val = 0.5 }",
        "{ train = 0.7, val = 0.2, test = 0.1 }",
        "{ val = 1, train = 0 }",
    ]);
    let order = one_of(&["weighted", "in_turn"]);
    (1..=3_u64, 0..1_u64 << 53, 1..=4_u64, splits, order).prop_map(|(samples, seed, per_shard, splits, order)| {
        format!(
            "[dataset]\nname = \"random\"\nsamples = {samples}\nseed = {seed}\nsamples_per_shard = {per_shard}\n\
             splits = {splits}\nobject_order = \"{order}\"\n"
        )
    })
}

fn sensor() -> impl Strategy<Value = String> {
    let led =
        (number(-360.0..=360.0), number(0.0..=90.0), proptest::array::uniform3(0.0..=1.0_f64), number(0.0..=100.0))
            .prop_map(|(azimuth, elevation, color, intensity)| {
                format!(
                    "[[sensor.led]]\nazimuth_deg = {azimuth}\nelevation_deg = {elevation}\ncolor = {color:?}\n\
                 intensity = {intensity}\n"
                )
            });
    let window = (number(0.5..=100.0), number(0.5..=100.0), number(0.0..=0.4999), number(1e-3..=1e9));
    let look = (number(0.0..=10.0), number(1e-3..=1e6), number(0.0..=1.0), number(0.0..=1.0), number(1e-3..=1e3));
    let preset = one_of(&["gelsight-2014", "gelsight-2017", "gelsight-mini", "digit"]);
    (preset, window, look, proptest::collection::vec(led, 0..4)).prop_map(|(preset, window, look, leds)| {
        let (x, y, poisson, young) = window;
        let (glow, reach, vignette, grain, size) = look;
        format!(
            "[sensor]\npreset = \"{preset}\"\nresolution_px = [24, 18]\nfield_of_view_mm = [{x}, {y}]\n\
             gelpad_thickness_mm = 2.0\ngelpad_poisson_ratio = {poisson}\ngelpad_youngs_modulus_kpa = {young}\n\
             [sensor.rendered_background]\nglow = {glow}\nglow_reach_mm = {reach}\nvignette = {vignette}\n\
             grain = {grain}\ngrain_size_mm = {size}\n{}",
            leds.concat()
        )
    })
}

fn objects() -> impl Strategy<Value = String> {
    let object = (one_of(&["cube.obj", "cone.obj", "cub?.obj"]), one_of(&["mm", "cm", "m", "in"]), number(1e-6..=1e9));
    proptest::collection::vec(object, 1..3).prop_map(|objects| {
        let table =
            |(path, unit, weight)| format!("[[object]]\npath = \"{path}\"\nunit = \"{unit}\"\nweight = {weight}\n");
        objects.into_iter().map(table).collect()
    })
}

fn scene() -> impl Strategy<Value = String> {
    let face = one_of(&["any", "+x", "-x", "+y", "-y", "+z", "-z"]);
    let anchor = one_of(&["bounds", "origin", "contact"]);
    let angles = (quantity(-3600.0, 3600.0), quantity(-90.0, 90.0), quantity(-3600.0, 3600.0));
    let place = (quantity(-20.0, 20.0), quantity(-1e4, 1e4));
    let press = (quantity(0.0, 2.0), number(0.0..=1.0), 1..=4_u32);
    (face, anchor, angles, place, press).prop_map(
        |(face, anchor, (yaw, tilt, azimuth), (x, y), (depth, no_contact, most))| {
            // Several objects at one place are refused.
            let y = if most > 1 { String::from("[-8.0, 9.0]") } else { y };
            format!(
                "[scene]\nobjects_per_sample = [1, {most}]\n[pose]\nface = \"{face}\"\nanchor = \"{anchor}\"\nyaw_deg = {yaw}\ntilt_deg = {tilt}\n\
             tilt_azimuth_deg = {azimuth}\nx_mm = {x}\ny_mm = {y}\n\
             [indentation]\ndepth_mm = {depth}\nno_contact = {no_contact}\n"
            )
        },
    )
}

fn gelpad() -> impl Strategy<Value = String> {
    let odd = || (0..8_u32).prop_map(|half| 2 * half + 1);
    let elastic = (one_of(&["full", "half", "quarter"]), number(0.05..=1000.0), 1..100_u32);
    prop_oneof![
        Just(String::from("[gelpad.none]\n")),
        (odd(), 0..6_u32)
            .prop_map(|(kernel, passes)| format!("[gelpad.mean_blur]\nkernel_px = {kernel}\npasses = {passes}\n")),
        (proptest::collection::vec(odd(), 0..4), odd()).prop_map(|(kernels, smoothing)| {
            format!("[gelpad.gaussian]\nkernels_px = {kernels:?}\nsmoothing_px = {smoothing}\n")
        }),
        elastic.prop_map(|(resolution, tolerance, most)| {
            format!(
                "[gelpad.elastic]\nresolution = \"{resolution}\"\ntolerance_um = {tolerance}\n\
                 max_iterations = {most}\n"
            )
        }),
    ]
}

fn models_and_output() -> impl Strategy<Value = String> {
    let light = (number(0.0..=1.0), number(0.0..=10.0), number(0.0..=10.0), number(0.0..=1000.0), number(0.0..=1.0));
    let layers =
        proptest::sample::subsequence(vec!["depth", "surface", "contact", "normal", "reference", "instance"], 0..=6);
    let storage = (one_of(&["half", "float"]), one_of(&["none", "rle", "zip"]));
    (gelpad(), light, layers, storage).prop_map(|(gelpad, light, mut layers, (pixel, compression))| {
        let (ambient, diffuse, specular, shininess, darkening) = light;
        if gelpad.contains("elastic") {
            layers.push("pressure");
        }
        format!(
            "{gelpad}\
             [optics.phong]\nambient = {ambient}\ndiffuse = {diffuse}\nspecular = {specular}\n\
             shininess = {shininess}\ndarkening = {darkening}\n\
             [output]\nlayers = {layers:?}\nexr = {{ pixel = \"{pixel}\", compression = \"{compression}\" }}\n"
        )
    })
}

fn job() -> impl Strategy<Value = String> {
    (dataset(), sensor(), objects(), scene(), models_and_output())
        .prop_map(|(dataset, sensor, objects, scene, rest)| dataset + &sensor + &objects + &scene + &rest)
}

/// Every key that takes a number, and values near and far from what it takes. Of the image's size only small ones:
/// a large one is no mistake, only slow.
const NUMBERS: &[&str] = &[
    "dataset.samples",
    "dataset.seed",
    "dataset.samples_per_shard",
    "dataset.splits.train",
    "dataset.splits.val",
    "dataset.splits.test",
    "sensor.field_of_view_mm.0",
    "sensor.field_of_view_mm.1",
    "sensor.gelpad_thickness_mm",
    "sensor.gelpad_youngs_modulus_kpa",
    "sensor.gelpad_poisson_ratio",
    "sensor.rendered_background.color.0",
    "sensor.rendered_background.glow",
    "sensor.rendered_background.glow_reach_mm",
    "sensor.rendered_background.vignette",
    "sensor.rendered_background.grain",
    "sensor.rendered_background.grain_size_mm",
    "sensor.rendered_background.dust_per_cm2",
    "sensor.rendered_background.dust_size_mm",
    "sensor.led.0.azimuth_deg",
    "sensor.led.0.elevation_deg",
    "sensor.led.0.color.2",
    "sensor.led.0.intensity",
    "object.0.weight",
    "object.1.weight",
    "pose.yaw_deg",
    "pose.tilt_deg.uniform.0",
    "pose.tilt_deg.uniform.1",
    "pose.tilt_azimuth_deg",
    "pose.x_mm.normal.mean",
    "pose.x_mm.normal.std",
    "pose.x_mm.normal.min",
    "pose.x_mm.normal.max",
    "pose.y_mm.0",
    "pose.y_mm.1",
    "indentation.depth_mm.log_uniform.0",
    "indentation.depth_mm.log_uniform.1",
    "indentation.no_contact",
    "gelpad.mean_blur.kernel_px",
    "gelpad.mean_blur.passes",
    "gelpad.gaussian.kernels_px.0",
    "gelpad.gaussian.smoothing_px",
    "gelpad.elastic.tolerance_um",
    "gelpad.elastic.max_iterations",
    "fidelity.max_error_um",
    "fidelity.max_ms",
    "optics.phong.ambient",
    "optics.phong.diffuse",
    "optics.phong.specular",
    "optics.phong.shininess",
    "optics.phong.darkening",
];

const SIZES: &[&str] = &["sensor.resolution_px.0", "sensor.resolution_px.1"];

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
path = "cube.obj"
[[object]]
path = "cube.obj"
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

fn nasty_number() -> impl Strategy<Value = String> {
    let words = [
        "nan",
        "inf",
        "-inf",
        "0",
        "-0.0",
        "1",
        "-1",
        "2",
        "0.5",
        "1e-320",
        "1e308",
        "-1e308",
        "1.7976931348623157e308",
        "9007199254740991",
        "9007199254740993",
        "9223372036854775807",
        "-9223372036854775808",
        "18446744073709551616",
        "4294967295",
        "4294967296",
        "1000000000",
        "1000001",
        "256",
        "255",
        "65",
        "1e-3",
        "9e-4",
        "90.00001",
        "1_000",
        "0x10",
        "[1, 2]",
        "[nan, inf]",
        "{ normal = { mean = 1e308, std = 1e308 } }",
        "{ choice = [-inf] }",
        "true",
    ];
    prop_oneof![
        3 => proptest::sample::select(words.to_vec()).prop_map(str::to_owned),
        1 => any::<f64>().prop_map(|value| toml::Value::Float(value).to_string()),
        1 => any::<i64>().prop_map(|value| value.to_string()),
    ]
}

/// One small change of a text.
#[derive(Clone, Debug)]
enum Edit {
    Remove { at: f64, length: usize },
    Insert { at: f64, text: String },
    Repeat { at: f64, length: usize, to: f64 },
}

fn edit() -> impl Strategy<Value = Edit> {
    let at = || 0.0..1.0_f64;
    let bits = [
        "[",
        "]",
        "[[",
        "]]",
        "{",
        "}",
        "=",
        "\"",
        "'",
        "\n",
        "\r\n",
        "#",
        ",",
        ".",
        "-",
        "+",
        "e",
        "\\",
        "\\u0000",
        "\0",
        "é",
        "\u{1F600}",
        "\t",
        "nan",
        "true",
        "a",
        "_",
        "\"\"\"",
        "1979-05-27",
        "**",
        "../",
        "7",
    ];
    let inserted =
        proptest::collection::vec(proptest::sample::select(bits.to_vec()), 1..3).prop_map(|bits| bits.concat());
    prop_oneof![
        (at(), 1..30_usize).prop_map(|(at, length)| Edit::Remove { at, length }),
        (at(), inserted).prop_map(|(at, text)| Edit::Insert { at, text }),
        (at(), 1..60_usize, at()).prop_map(|(at, length, to)| Edit::Repeat { at, length, to }),
    ]
}

fn apply(text: &str, edit: &Edit) -> String {
    let mut chars: Vec<char> = text.chars().collect();
    let place = |at: f64, count: usize| ((at * count as f64) as usize).min(count);
    let count = chars.len();
    match edit {
        Edit::Remove { at, length } => {
            let at = place(*at, count);
            chars.drain(at..(at + length).min(count));
        }
        Edit::Insert { at, text } => {
            let at = place(*at, count);
            chars.splice(at..at, text.chars());
        }
        Edit::Repeat { at, length, to } => {
            let at = place(*at, count);
            let copy: Vec<char> = chars[at..(at + length).min(count)].to_vec();
            let to = place(*to, count);
            chars.splice(to..to, copy);
        }
    }
    chars.into_iter().collect()
}

/// A report, plain and with colours, that says something about each problem.
fn assert_sound(report: &Report) {
    assert!(report.to_string().starts_with("error: "));
    assert!(report.render(Display { is_styled: true, columns: Some(40) }).contains("error"));
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 256, failure_persistence: None, ..ProptestConfig::default() })]

    #[test]
    fn every_valid_job_renders_finite_samples(text in job()) {
        let plan = resolve(&text, Vec::new()).unwrap_or_else(|report| panic!("{report}\nin\n{text}"));
        for index in 0..plan.layout.samples() {
            let sample = render(&plan, index);
            prop_assert!(sample.label.health.finite, "sample {} of\n{}", index, text);
            prop_assert_eq!((sample.impression.image.width, sample.impression.image.height), (24, 18));
            prop_assert_eq!(sample.impression.image.rgb.len(), 24 * 18 * 3);
            let json = serde_json::to_value(&sample.label).expect("JSON");
            let nulls = ["/object/material/youngs_modulus_kpa", "/object/material/poisson_ratio", "/object/material/friction", "/contact/force_n", "/contact/total_force_n", "/contact/in_view_fraction", "/contact/peak_pressure_kpa", "/numerics/residual_um", "/numerics/model_error_um"];
            let count = nulls.iter().filter(|path| json.pointer(path).is_some_and(|value| value.is_null())).count();
            let shares = sample.label.objects.iter().filter(|object| object.contact.force_n.is_none()).count();
            prop_assert!(shares == 0 || sample.label.contact.force_n.is_none());
            prop_assert_eq!(json.to_string().matches("null").count(), count + shares, "NaN is written as null: {}", json);
            let depth = sample.label.contact.max_depth_mm;
            prop_assert!((0.0..=plan.thickness_mm()).contains(&depth), "{} mm deep in\n{}", depth, text);
        }
    }

    #[test]
    fn the_resolved_job_resolves_to_itself(text in job()) {
        let plan = resolve(&text, Vec::new()).unwrap_or_else(|report| panic!("{report}\nin\n{text}"));
        let resolved = toml::to_string(plan.job()).expect("a job is TOML");
        let again = resolve(&resolved, Vec::new()).unwrap_or_else(|report| panic!("{report}\nin\n{resolved}"));
        prop_assert_eq!(&plan.fingerprint, &again.fingerprint);
        prop_assert_eq!(resolved, toml::to_string(again.job()).expect("a job is TOML"));
    }

    #[test]
    fn any_number_at_any_key_is_taken_or_refused(
        changes in proptest::collection::vec((proptest::sample::select(NUMBERS), nasty_number()), 1..4),
        size in proptest::option::of((proptest::sample::select(SIZES), one_of(&["0", "1", "-1", "64", "8193", "1e3", "nan"]))),
    ) {
        let changes = changes.into_iter().chain(size.map(|(key, value)| (key, value.to_owned())));
        let set: Vec<(String, String)> =
            changes.map(|(key, value)| (String::from("--set"), format!("{key} = {value}"))).collect();
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
        let text = edits.iter().fold(PLAIN.to_owned(), |text, edit| apply(&text, edit));
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
    if let Err(report) = resolve(PLAIN, Vec::new()) {
        panic!("{report}");
    }
    for key in NUMBERS.iter().chain(SIZES) {
        let known = |path: &str| resolve(PLAIN, vec![(String::from("--set"), format!("{path} = \"x\""))]);
        let Err(report) = known(key) else { panic!("{key} takes a text") };
        assert!(!report.to_string().contains("unknown"), "{key} is no key: {report}");
    }
}
