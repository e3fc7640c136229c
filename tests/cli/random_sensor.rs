//! Sensors that are drawn for each sample: numbers, backgrounds, units.

use gelsim::SensorExt;
use std::collections::BTreeSet;
use std::fs;

use gelsim_core::optics::background::RenderedBackground;
use gelsim_core::optics::led::Led;
use gelsim_core::sensor::{Background, Sensor};
use gelsim_core::simulator::Simulator;
use gelsim_job::config::Overrides;
use gelsim_job::layout::Split;
use gelsim_job::plan::Plan;
use gelsim_job::sample::{press, render};
use gelsim_job::scene::Scene;
use serde_json::Value;

use crate::support::{Folder, JOB, assert_same_files, edited, json};

/// A job whose sensor is randomized in every way that takes no file.
fn randomized() -> String {
    let sensor = r#"preset = "gelsight-mini"
resolution_px = [48, 36]
gelpad_thickness_mm = [3.0, 5.0]
gelpad_youngs_modulus_kpa = { log_uniform = [70.0, 300.0] }
darkening = { choice = [0.0, 0.1] }
stray_light = [[0.05, 0.15], 0.3, 0.3]

[sensor.rendered_background]
glow = [0.0, 0.2]
color = [0.3, { normal = { mean = 0.4, std = 0.1, min = 0.2, max = 0.6 } }, 0.5]

[sensor.unit]
variation = 1.0

[[sensor.led]]
azimuth_deg = [250.0, 270.0]
elevation_deg = [20.0, 40.0]
intensity = [1.0, 2.0]
distance_mm = [15.0, 30.0]
color = [1.0, [0.0, 0.3], 0.0]

[[sensor.led]]
azimuth_deg = 90.0"#;
    edited(
        JOB,
        &[
            ("resolution_px = [48, 36]", sensor),
            ("layers = [\"depth\", \"contact\"]", "layers = [\"depth\", \"reference\"]"),
        ],
    )
}

fn plan(folder: &Folder, name: &str) -> Plan {
    Plan::load(&folder.path(name), &Overrides::default()).unwrap_or_else(|report| panic!("{}", report.to_string()))
}

fn labels(folder: &Folder, name: &str) -> Vec<Value> {
    let plan = plan(folder, name);
    (0..8).map(|index| serde_json::to_value(render(&plan, index).label).expect("a label")).collect()
}

#[test]
fn labels_say_what_was_drawn_and_it_is_what_was_simulated() {
    let folder = Folder::with_job(&randomized());
    let plan = plan(&folder, "job.toml");
    let mut seen = Vec::new();
    for index in 0..8 {
        let scene = Scene::draw(&plan, index, 0);
        let sample = press(&plan, &scene);
        let (label, sensor) = (&sample.label.sensor, sample.simulator.sensor());
        assert!((2.7..=5.4).contains(&label.gelpad_thickness_mm), "{label:?}");
        assert_eq!(label.gelpad_thickness_mm, sensor.gelpad.thickness_mm);
        assert_eq!(label.leds[0].elevation_deg, sensor.leds[0].elevation_deg);
        assert_eq!(label.leds[0].color[1], sensor.leds[0].color[1]);
        assert_eq!(label.background.pattern.len(), 45);
        assert_eq!(label.stray_light[1..], [0.3, 0.3]);
        seen.push((
            label.gelpad_thickness_mm,
            label.leds[0].azimuth_deg,
            label.background.color[1],
            label.background.pattern[1],
        ));
        // A variant is what would have been made of its sensor from nothing.
        let anew = Simulator::with_models(sensor.clone(), plan.simulator.models().clone(), plan.simulator.policy());
        let impression = anew.press_with(&scene.to_press(&plan));
        assert!(impression.image.rgb == sample.impression.image.rgb, "sample {index}");
        assert_eq!(anew.untouched().rgb, sample.simulator.untouched().rgb);
        assert_eq!(impression.contact.force_n, sample.impression.contact.force_n);
    }
    for (i, one) in seen.iter().enumerate() {
        assert!(
            seen[i + 1..]
                .iter()
                .all(|other| one.0 != other.0 && one.1 != other.1 && one.2 != other.2 && one.3 != other.3)
        );
    }
}

#[test]
fn a_randomized_dataset_verifies_reproduces_and_comes_out_of_its_own_job() {
    let folder = Folder::with_job(&randomized());
    folder.succeed("generate job.toml --quiet --out one --threads 1");
    folder.succeed("generate job.toml --quiet --out two --partition 1/2");
    folder.succeed("generate job.toml --quiet --out two --partition 0/2");
    assert_same_files(&folder.lasting_files("one"), &folder.lasting_files("two"));
    folder.succeed("verify one");
    folder.succeed("reproduce one 3");
    folder.succeed("generate one/job.toml --quiet --out again");
    assert_same_files(&folder.lasting_files("one/data"), &folder.lasting_files("again/data"));
    assert_eq!(json(&folder, "one/dataset.json")["fingerprint"], json(&folder, "again/dataset.json")["fingerprint"]);
}

#[test]
fn quantities_without_choice_give_the_bytes_of_constants() {
    let degenerate = "gelpad_thickness_mm = [2.5, 2.5]\ngelpad_youngs_modulus_kpa = { log_uniform = [107.3, 107.3] }\n\
                      darkening = { choice = [0.1] }\nrendered_background.color = [{ normal = { mean = 0.31, std = 0.0 } }, 0.3, [0.4, 0.4]]\n\
                      unit.variation = 0.0";
    let constant = "gelpad_thickness_mm = 2.5\ngelpad_youngs_modulus_kpa = 107.3\ndarkening = 0.1\n\
                    rendered_background.color = [0.31, 0.3, 0.4]";
    let job =
        |sensor: &str| edited(JOB, &[("resolution_px = [48, 36]", &format!("resolution_px = [48, 36]\n{sensor}"))]);
    let folder = Folder::with_job(&job(degenerate));
    fs::write(folder.path("constant.toml"), job(constant)).expect("written");
    folder.succeed("generate job.toml --quiet --out degenerate");
    folder.succeed("generate constant.toml --quiet --out constant");
    assert_same_files(&folder.lasting_files("degenerate/data"), &folder.lasting_files("constant/data"));
}

#[test]
fn a_variant_renders_as_the_same_sensor_made_anew() {
    let leds = |sensor: &mut Sensor, edit: fn(&mut Led)| sensor.leds.iter_mut().for_each(edit);
    let edits: [&dyn Fn(&mut Sensor); 11] = [
        &|_| (),
        &|sensor| sensor.gelpad.youngs_modulus_kpa *= 1.3,
        &|sensor| sensor.gelpad.poisson_ratio *= 0.9,
        &|sensor| sensor.gelpad.thickness_mm *= 1.2,
        &|sensor| sensor.darkening = 0.2,
        &|sensor| sensor.stray_light = Some([0.2; 3]),
        &|sensor| sensor.camera.gains = [0.9, 1.0, 1.1],
        &|sensor| sensor.field_of_view_mm = sensor.field_of_view_mm.map(|mm| 1.1 * mm),
        &|sensor| sensor.background = Background::Rendered(RenderedBackground::default()),
        &|sensor| leds(sensor, |led| led.intensity *= 0.8),
        &|sensor| leds(sensor, |led| led.elevation_deg *= 0.8),
    ];
    for preset in ["digit", "tactip", "geltip"] {
        let folder = Folder::with_job(&edited(
            JOB,
            &[("[sensor]", &format!("[sensor]\npreset = '{preset}'")), ("no_contact = 0.25", "")],
        ));
        let plan = plan(&folder, "job.toml");
        let known = &plan.simulator;
        for (number, edit) in edits.iter().enumerate() {
            let mut sensor = known.sensor().clone();
            edit(&mut sensor);
            let mut press = Scene::draw(&plan, 0, 0).to_press(&plan);
            press.camera = sensor.camera;
            let variant = known.variant(sensor.clone());
            let anew = Simulator::with_models(sensor, known.models().clone(), known.policy());
            let [shared, own] = [&variant, &anew].map(|simulator| simulator.press_with(&press));
            assert!(shared.image.rgb == own.image.rgb, "{preset}, edit {number}");
            assert_eq!(shared.contact.force_n, own.contact.force_n, "{preset}, edit {number}");
            assert!(own.contact.force_n > Some(0.0), "{preset}, edit {number}: nothing is pressed");
            assert!(variant.untouched().rgb == anew.untouched().rgb, "{preset}, edit {number}");
        }
    }
}

#[test]
fn one_more_quantity_shifts_no_other() {
    let folder = Folder::with_job(&randomized());
    let before = labels(&folder, "job.toml");
    fs::write(
        folder.path("more.toml"),
        edited(&randomized(), &[("azimuth_deg = 90.0", "azimuth_deg = 90.0\nintensity = [0.5, 1.0]")]),
    )
    .expect("written");
    for (mut one, mut other) in before.into_iter().zip(labels(&folder, "more.toml")) {
        assert_ne!(one["sensor"]["leds"][1]["intensity"], other["sensor"]["leds"][1]["intensity"]);
        for label in [&mut one, &mut other] {
            label["sensor"]["leds"][1]["intensity"] = Value::Null;
        }
        assert_eq!(one["sensor"], other["sensor"]);
        assert_eq!(one["pose"], other["pose"]);
    }
}

#[test]
fn each_sample_draws_a_background_and_all_have_the_sensors_size() {
    let sensor = "resolution_px = [48, 36]\nbackground = [\"grey.png\", \"more/*.png\"]";
    let folder =
        Folder::with_job(&edited(JOB, &[("resolution_px = [48, 36]", sensor), ("samples = 8", "samples = 24")]));
    fs::create_dir(folder.path("more")).expect("a folder");
    let paint = |name: &str, size: [u32; 2], level: u8| {
        image::RgbImage::from_pixel(size[0], size[1], image::Rgb([level; 3])).save(folder.path(name)).expect("saved");
    };
    paint("grey.png", [48, 36], 90);
    paint("more/a.png", [48, 36], 110);
    paint("more/b.png", [36, 48], 130);
    let said = folder.fail("plan job.toml", 2);
    assert!(said.contains("b.png is 36x48 px, the sensor 48x36 px") && said.contains("job.toml:11:27"), "{said}");
    paint("more/b.png", [48, 36], 130);

    let plan = plan(&folder, "job.toml");
    let mut files: Vec<String> = Vec::new();
    for index in 0..24 {
        let sample = render(&plan, index);
        let background = sample.label.sensor.background;
        let level = sample.simulator.untouched().rgb[0];
        let expected = [("grey.png", 90), ("a.png", 110), ("b.png", 130)];
        assert!(expected.contains(&(background.file.as_str(), level)), "{background:?} {level}");
        assert_eq!(background.sha256.len(), 64);
        files.push(background.file);
    }
    files.sort();
    files.dedup();
    assert_eq!(files.len(), 3);
    folder.succeed("generate job.toml --quiet --out one");
    folder.succeed("generate one/job.toml --quiet --out again");
    assert_same_files(&folder.lasting_files("one/data"), &folder.lasting_files("again/data"));
    paint("grey.png", [48, 36], 91);
    let said = folder.fail("generate one/job.toml --out third", 2);
    assert!(said.contains("grey.png has changed"), "{said}");
}

#[test]
fn mistakes_in_random_sensors_are_all_said_with_their_places() {
    let sensor = r#"resolution_px = [48, 36]
gelpad_thickness_mm = [1.0, 3.0]
darkening = [0.5, 1.5]
gelpad_youngs_modulus_kpa = { uniforn = [1.0, 2.0] }
stray_light = [0.1, [0.2, 0.1], 0.0]

[[sensor.led]]
elevation_deg = { normal = { mean = 30.0, std = 5.0 } }
color = [1.0, 1.0, [0.5, 2.0]]"#;
    let folder = Folder::with_job(&edited(JOB, &[("resolution_px = [48, 36]", sensor)]));
    let said = folder.fail("plan job.toml", 2);
    for expected in [
        "depth_mm may be 0.3 to 1.2, and the thinnest gelpad",
        "the thinnest gelpad is as thick as 1 mm",
        "darkening may be 0.5 to 1.5, which is out of range",
        "unknown distribution `uniforn`",
        "stray_light: inverted range: 0.2 is above 0.1",
        "elevation_deg may be any number, which is out of range",
        "color may be 0.5 to 2, which is out of range",
        "job.toml:12:13",
        "job.toml:18:20",
    ] {
        assert!(said.contains(expected), "{expected}\n{said}");
    }
    let unit = "resolution_px = [48, 36]\nunit = { variation = 1.0, led_elevation_deg = 8.0 }";
    let folder = Folder::with_job(&edited(JOB, &[("resolution_px = [48, 36]", unit)]));
    let said = folder.fail("plan job.toml", 2);
    assert!(
        said.contains("units may be out of range: elevation_deg = -7.4") && said.contains("job.toml:11:"),
        "{said}"
    );
}

#[test]
fn one_sensor_is_one_sensor_where_there_is_no_job() {
    let folder = Folder::with_job(JOB);
    fs::write(folder.path("random.toml"), "darkening = [0.0, 0.2]\nunit.variation = 0.5\n").expect("written");
    let error = gelsim::Sensor::load(folder.path("random.toml")).expect_err("it is not one sensor");
    let said = error.to_string();
    assert!(said.contains("darkening is drawn at random") && said.contains("variation is drawn"), "{said}");
}

#[test]
fn every_preset_may_vary_as_its_units_do() {
    for (name, _) in gelsim_files::sensor::PRESETS {
        let sensor = format!("preset = \"{name}\"\nresolution_px = [48, 36]\nunit.variation = 1.0");
        let folder = Folder::with_job(&edited(JOB, &[("resolution_px = [48, 36]", &sensor)]));
        let labels = labels(&folder, "job.toml");
        let thickness = |label: &Value| label["sensor"]["gelpad_thickness_mm"].as_f64().expect("a number");
        assert_ne!(thickness(&labels[0]), thickness(&labels[1]), "{name}");
    }
}

#[test]
fn each_sample_draws_one_of_several_presets() {
    let sensor = "preset = [\"digit\", \"gelsight-mini\"]\nresolution_px = [48, 36]\ndarkening = [0.0, 0.1]\nunit.variation = 0.5";
    let folder = Folder::with_job(&edited(JOB, &[("resolution_px = [48, 36]", sensor)]));
    let labels = labels(&folder, "job.toml");
    for (name, wide_mm) in [("digit", 16.0), ("gelsight-mini", 18.6)] {
        let mut own = labels.iter().filter(|label| label["sensor"]["name"] == name);
        let found = own.next().unwrap_or_else(|| panic!("no sample has a {name}"));
        assert_eq!(found["sensor"]["mm_per_px"][0], wide_mm / 48.0, "{found}");
    }
    folder.succeed("generate job.toml --quiet --out one");
    folder.succeed("verify one");
    folder.succeed("reproduce one 5");
    folder.succeed("finalize one");
    folder.succeed("generate one/job.toml --quiet --out again");
    assert_same_files(&folder.lasting_files("one"), &folder.lasting_files("again"));

    let apart = edited(JOB, &[("resolution_px = [48, 36]", "preset = [\"gelsight-mini\", \"digit\", \"digits\"]")]);
    let folder =
        Folder::with_job(&edited(&apart, &[("depth_mm = { log_uniform = [0.3, 1.2] }", "depth_mm = [0.3, 5.0]")]));
    let said = folder.fail("plan job.toml", 2);
    for expected in [
        "`gelsight-mini` has [320, 240] px, `digit` [240, 320] px",
        "resolution_px = [320, 240] under [sensor]",
        "no sensor preset is called `digits`",
        "depth_mm may be 0.3 to 5, and the gelpad is as thick as 4 mm",
        "job.toml:10:28",
        "job.toml:10:37",
    ] {
        assert!(said.contains(expected), "{expected}\n{said}");
    }
}

#[test]
fn a_split_of_a_handful_of_samples_has_every_class() {
    let quickstart = Plan::load(&crate::support::repository().join("configs/quickstart.toml"), &Overrides::default());
    let plan = quickstart.unwrap_or_else(|report| panic!("{}", report.to_string()));
    for split in [Split::Val, Split::Test] {
        let of_split = |first: u64| -> BTreeSet<String> {
            let indices = (first..first + 8).map(|position| plan.layout.index_of(split, position));
            let objects = indices.map(|index| Scene::draw(&plan, index, 0).pressed);
            objects.map(|pressed| format!("{pressed:?}")).collect()
        };
        assert_eq!((of_split(0).len(), of_split(8).len()), (8, 8), "eight classes in eight samples of {split:?}");
    }
}
