//! A calibrated sensor in jobs: tables that are none, files that have changed, datasets that are made again.

use std::fs;

use gelsim_core::optics::calibrated::response::{CalibrationResponse, INPUTS, OUTPUTS, TERMS};
use gelsim_dataset::encode;
use gelsim_lab::calibrate::{Geometry, build_table};
use image::{Rgb, RgbImage};

use crate::support::{Folder, JOB, assert_same_files, edited};

pub const SIZE_PX: [u32; 2] = [96, 72];

/// The untouched pad.
pub fn rest() -> RgbImage {
    RgbImage::from_fn(SIZE_PX[0], SIZE_PX[1], |x, y| Rgb([100 + (x / 4) as u8, 110 + (y / 4) as u8, 120]))
}

/// What `gelsim calibrate` could have written: red grows with n_x, green with n_y, and all darken with depth.
fn calibration_table() -> String {
    let mut outputs = vec![vec![0.0; 1 + INPUTS + 1]; OUTPUTS];
    for (channel, slopes) in [[0.0, 0.5], [0.5, 0.0], [-0.25, -0.25]].into_iter().enumerate() {
        let rows = &mut outputs[channel * TERMS..];
        // Weights are of the hidden unit, then of the inputs; the last is the bias.
        rows[0][1] = -0.125;
        rows[1][INPUTS + 1] = slopes[0];
        rows[2][INPUTS + 1] = slopes[1];
        rows[2][0] = 0.0625;
    }
    let hidden = vec![[0.5; INPUTS + 1]];
    let response = CalibrationResponse {
        height_mm: 0.5,
        place_mm: 9.5,
        heights_mm: [-0.25, 1.0],
        steepest: 0.75,
        hidden,
        outputs,
    };
    let table = build_table(response, Geometry { thickness_mm: 3.0, contact_over_disc: 0.9375 });
    String::from_utf8(encode::to_json_line(&table)).expect("UTF-8")
}

/// Adds sensor.toml with its table.json and untouched.png.
pub fn add_sensor(folder: &Folder) {
    rest().save(folder.path("untouched.png")).expect("an image");
    folder.write("table.json", calibration_table());
    folder.write(
        "sensor.toml",
        "name = \"mine\"\nresolution_px = [96, 72]\nfield_of_view_mm = [19.2, 14.4]\ngelpad_thickness_mm = 3.0\n\
         background = \"untouched.png\"\ncalibration = \"table.json\"\n",
    );
}

/// The usual small job with that sensor.
fn folder() -> Folder {
    let folder = Folder::with_job(&edited(JOB, &[("resolution_px = [48, 36]", "file = \"sensor.toml\"")]));
    add_sensor(&folder);
    folder
}

#[test]
fn tables_that_are_none_are_refused_in_words_at_their_key() {
    let folder = folder();
    folder.succeed("plan job.toml");
    let good = calibration_table();
    let with = |from: &str, to: &str| {
        assert!(good.contains(from), "{from} is not in {good}");
        good.replacen(from, to, 1)
    };
    let many = format!("\"hidden\":[{}]", vec!["[0,0,0,0,0,0,0,0,0,0,0,0]"; 1025].join(","));
    let unit = "\"hidden\":[[0.5,0.5,0.5,0.5,0.5,0.5,0.5,0.5,0.5,0.5,0.5,0.5]]";
    let widths = "a response has 45 outputs";
    let compact: serde_json::Value = serde_json::from_str(&good).expect("JSON");
    assert_eq!(compact.to_string(), good, "the edits below know how it is written");
    for (what, text, words) in [
        ("nothing", String::new(), "no table of `gelsim calibrate`: EOF"),
        ("half of it", good[..good.len() / 2].to_owned(), "no table of `gelsim calibrate`: EOF"),
        ("another file", String::from("[1, 2]"), "no table of `gelsim calibrate`"),
        ("NaN as null", with("-0.125", "null"), "invalid type: null"),
        ("NaN", with("-0.125", "NaN"), "no table of `gelsim calibrate`"),
        ("a weight too many", with("-0.125", "-0.125,0.0"), widths),
        ("a weight too few", with("-0.125,", ""), widths),
        ("an input too few", with("[[0.5,0.5,", "[[0.5,"), "invalid length 11"),
        ("too many units", with(unit, &many), widths),
        ("a large number", with("-0.125", "1e9"), "not finite, or larger than a million"),
        ("more than 32 bits hold", with("-0.125", "-1e300"), "number out of range"),
        ("no scale", with("\"place_mm\":9.5", "\"place_mm\":0.0"), "scales are at least 1e-6"),
        ("a normal longer than 1", with("\"steepest\":0.75", "\"steepest\":1.5"), "its steepest normal at most 1"),
        ("heights without 0", with("[-0.25,1.0]", "[0.25,1.0]"), "its heights include 0"),
        ("no disc", with("\"contact_over_disc\":0.9375", "\"contact_over_disc\":0.0"), "contact_over_disc is 0"),
        ("another key", with("\"steepest\":", "\"steep\":"), "unknown field `steep`"),
        ("the future", with("\"calibration_version\":1", "\"calibration_version\":3"), "which is newer than this one"),
        (
            "the future with more in it",
            with("\"calibration_version\":1", "\"calibration_version\":7,\"more\":[]"),
            "which is newer than this one",
        ),
        (
            "the past",
            with("\"calibration_version\":1", "\"calibration_version\":0"),
            "version 0 of the file is not known",
        ),
    ] {
        folder.write("table.json", text);
        for command in ["plan job.toml", "generate job.toml --out out"] {
            let said = folder.fail(command, 2);
            let placed = said.contains("cannot read the calibration table.json") && said.contains("sensor.toml:6:");
            assert!(placed && said.contains(words) && said.contains("help: "), "{what}:\n{said}");
        }
    }
    assert!(!folder.path("out").exists());
    fs::remove_file(folder.path("table.json")).expect("a file");
    let said = folder.fail("plan job.toml", 2);
    assert!(said.contains("cannot read the calibration table.json") && said.contains("sensor.toml:6:"), "{said}");
}

#[test]
fn a_table_that_has_changed_is_told_by_its_hash() {
    let folder = folder();
    let hash = "0".repeat(64);
    folder.write("sensor.toml", folder.read("sensor.toml") + &format!("calibration_sha256 = \"{hash}\"\n"));
    let said = folder.fail("plan job.toml", 2);
    assert!(said.contains("the calibration table.json has changed: its SHA-256 is "), "{said}");
    assert!(said.contains("sensor.toml:7:") && said.contains("restore the file, or remove this key"), "{said}");
}

#[test]
fn calibrated_light_needs_a_calibrated_sensor() {
    let folder = Folder::with_job(&format!("{JOB}[optics.calibrated]\nspacing_mm = 0.5\n"));
    let said = folder.fail("plan job.toml", 2);
    assert!(
        said.contains("help: ")
            && said.contains("`gelsim calibrate`")
            && said.contains("file = \"...\" under [sensor]"),
        "{said}"
    );
    assert!(said.contains("job.toml:") && said.contains("optics"), "{said}");
}

#[test]
fn datasets_of_a_calibrated_sensor_are_resumed_verified_and_reproduced() {
    let folder = folder();
    folder.succeed("generate job.toml --quiet --out out");
    let complete = folder.lasting_files("out");
    for (key, label) in folder.labels("out") {
        assert_eq!(
            (label["optics_model"].as_str(), label["fidelity"].as_str()),
            (Some("calibrated"), Some("standard"))
        );
        let touches = label["contact"]["in_contact"] == true;
        let picture = image::load_from_memory(&folder.samples("out")[&key]["tactile.png"]).expect("a picture");
        assert_eq!(touches, picture.into_rgb8() != rest(), "sample {key}");
    }
    folder.gelsim("verify out").assert().success();
    folder.gelsim("reproduce out 3").assert().success();
    fs::remove_file(folder.path("out/data/train-000001.tar")).expect("a shard");
    folder.gelsim("verify out").assert().code(1);
    folder.succeed("generate job.toml --quiet --out out");
    assert_same_files(&complete, &folder.lasting_files("out"));
    // The dataset knows its table by its hash.
    folder.write("table.json", calibration_table().replacen("-0.125", "-0.25", 1));
    let said = folder.fail("reproduce out 3", 2);
    assert!(said.contains("table.json has changed"), "{said}");
    let said = folder.fail("generate job.toml --out out", 2);
    assert!(said.contains("out") && said.contains("help: "), "{said}");
    assert_same_files(&complete, &folder.lasting_files("out"));
}

#[test]
fn what_the_presses_of_the_calibration_did_not_reach_is_said_by_plan_generate_and_labels() {
    let folder = folder();
    let share = |label: &serde_json::Value| label["numerics"]["light_outside_range"].as_f64().expect("a number");
    // The cube's walls are steeper than any ball.
    let planned = folder.gelsim("plan job.toml").assert().success();
    let planned = String::from_utf8_lossy(&planned.get_output().stdout).into_owned();
    let words = "of the contact is steeper or deeper than the presses that the optics were calibrated on";
    assert!(planned.contains("\nlight  ") && planned.contains(words), "{planned}");
    let said = folder.succeed("generate job.toml --out steep");
    assert!(said.contains(words) && said.contains("numerics.light_outside_range"), "{said}");
    let labels = folder.labels("steep");
    assert!(labels.values().all(|label| (0.0..=1.0).contains(&share(label))));
    let area = |label: &serde_json::Value| label["contact"]["area_mm2"].as_f64().expect("a number");
    let total: f64 = labels.values().map(area).sum();
    let percent = 100.0 * labels.values().map(|label| area(label) * share(label)).sum::<f64>() / total;
    assert!(percent > 0.5 && said.contains(&format!("{percent:.1} % of the contact")), "{percent} {said}");
    assert!(labels.values().any(|label| area(label) == 0.0 && share(label) == 0.0), "nothing touches");

    // A table whose presses were as deep and as steep as anything, and other optics: there is nothing to say.
    folder.succeed("generate job.toml --out other --set optics=\"phong\"");
    let all = calibration_table().replace("\"steepest\":0.75", "\"steepest\":1.0").replace("[-0.25,1.0]", "[-9.0,9.0]");
    folder.write("table.json", all);
    let said = folder.succeed("generate job.toml --out within");
    assert!(!said.contains(words), "{said}");
    for name in ["other", "within"] {
        assert!(folder.labels(name).values().all(|label| share(label) == 0.0), "{name}");
    }
}

#[test]
fn light_goes_on_beyond_the_presses_where_the_table_says_how() {
    let folder = folder();
    folder.succeed("generate job.toml --quiet --out clamped");
    let led = r#"{"azimuth_deg":0.0,"elevation_deg":40.0,"intensity":2.0}"#;
    let beyond = format!(r#","beyond":{{"leds":[{led}],"stray_light":[0.1,0.1,0.1],"per_mm":[0.0,0.0,-0.1]}}}}"#);
    let text = calibration_table().replace("\"calibration_version\":1", "\"calibration_version\":2");
    let with = |beyond: &str| text.trim_end().strip_suffix('}').expect("an object").to_owned() + beyond;
    folder.write("table.json", with(&beyond));
    folder.succeed("generate job.toml --quiet --out goes_on");
    let (before, after) = (folder.samples("clamped"), folder.samples("goes_on"));
    let same = |key: &String| before[key]["tactile.png"] == after[key]["tactile.png"];
    let labels = folder.labels("goes_on");
    let (touching, free): (Vec<_>, Vec<_>) =
        labels.iter().partition(|(_, label)| label["contact"]["in_contact"] == true);
    assert!(!free.is_empty() && free.iter().all(|(key, _)| same(key)), "the pad is flat there");
    assert!(touching.iter().any(|(key, _)| !same(key)), "the light is still cut off at the presses' edge");
    folder.write("table.json", with(&beyond.replace("\"elevation_deg\":40.0", "\"elevation_deg\":140.0")));
    let said = folder.fail("plan job.toml", 2);
    assert!(said.contains("elevations of 0 to 90 degrees") && said.contains("sensor.toml:6:"), "{said}");
}
