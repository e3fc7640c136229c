//! Effects in jobs, sensor files, labels and statistics, and what `gelsim plan` says of them.

use gelsim_core::effects::Effect;

use crate::support::{Folder, JOB, edited, json};

/// A sensor with a camera and markers of its own.
const SENSOR: &str = "name = \"mine\"\n[camera]\nvignette = 0.3\ndefocus_mm = 0.1\n[markers]\npitch_mm = 2.0\n";

fn with_effects() -> String {
    let tables = "[texture]\npatterns = [\"knurled\", \"woven\"]\namplitude_mm = [0.01, 0.05]\n[shear]\nx_mm = 0.2\n\
                  [camera]\nread_noise_levels = 1.0\n[output]";
    let sensor = "[sensor]\nfile = \"mine.toml\"";
    edited(JOB, &[("[output]", tables), ("[sensor]", sensor), ("\"contact\"]", "\"contact\", \"markers\"]")])
}

#[test]
fn a_jobs_camera_and_markers_override_single_keys_of_the_sensors() {
    let folder = Folder::with_job(&with_effects());
    folder.write("mine.toml", SENSOR);
    folder.succeed("generate job.toml --quiet --set markers.diameter_mm=0.3");
    let job: toml::Table = folder.read("out/small/job.toml").parse().expect("TOML");
    let number = |table: &str, key: &str| job[table][key].as_float().expect("a number");
    assert_eq!([number("camera", "vignette"), number("camera", "read_noise_levels")], [0.3, 1.0]);
    assert_eq!([number("markers", "pitch_mm"), number("markers", "diameter_mm")], [2.0, 0.3]);
    assert!(!job["sensor"].as_table().expect("a table").contains_key("camera"), "said once");
    // The resolved job makes the same bytes without the sensor's file.
    folder.succeed("generate out/small/job.toml --quiet --out again");
    assert_eq!(folder.files("out/small/data"), folder.files("again/data"));
}

#[test]
fn labels_and_statistics_say_what_ran_and_why() {
    let folder = Folder::with_job(&with_effects());
    folder.write("mine.toml", SENSOR);
    folder.succeed("generate job.toml --quiet");
    let (mut ran, mut moved) = (vec![0; Effect::ALL.len()], 0);
    for (key, label) in folder.labels("out/small") {
        let touches = label["contact"]["in_contact"] == true;
        for (count, effect) in ran.iter_mut().zip(Effect::ALL) {
            let note = &label["effects"][effect.name()];
            assert!(!note["reason"].as_str().expect("a text").is_empty(), "{key} {}", effect.name());
            *count += u64::from(note["ran"] == true);
        }
        // Texture may lift a tip off the pad.
        assert!(!touches || label["effects"]["texture"]["ran"] == true, "{key}");
        assert_eq!(label["effects"]["noise"]["ran"], true, "{key}");
        assert_eq!(label["effects"]["grain"]["ran"], false, "{key}");
        assert_eq!(label["effects"]["grain"]["reason"], "the pad is smooth and flat", "{key}");
        let pattern = label["texture"]["pattern"].as_str().expect("a text");
        assert!(["knurled", "woven"].contains(&pattern), "{key} {pattern}");
        assert!(label["markers"]["count"].as_u64().expect("a number") > 20, "{key}");
        let motion = label["markers"]["max_motion_px"].as_f64().expect("a number");
        let force = label["shear"]["force_n"][0].as_f64().expect("a number");
        assert!(touches || (motion == 0.0 && force == 0.0), "{key}");
        moved += u64::from(motion > 0.1 && force > 0.0);
    }
    assert!(moved >= 4, "{moved} samples move their markers");
    let mut counted = vec![0; Effect::ALL.len()];
    for shard in ["train-000000", "train-000001", "val-000000", "test-000000"] {
        let stats = json(&folder, &format!("out/small/stats/{shard}.json"));
        for (count, effect) in counted.iter_mut().zip(Effect::ALL) {
            let of = &stats["effects"][effect.name()];
            *count += of["ran"].as_u64().expect("a number");
            let all = of["ran"].as_u64().zip(of["skipped"].as_u64()).map(|(ran, skipped)| ran + skipped);
            assert_eq!(all, stats["samples"].as_u64());
            let seconds = of["seconds"].as_f64().expect("a number");
            assert!(seconds >= 0.0 && (seconds > 0.0 || effect != Effect::Noise), "{}", effect.name());
        }
    }
    assert_eq!(ran, counted);
}

#[test]
fn the_markers_layer_holds_pairs_of_pixels() {
    let folder = Folder::with_job(&with_effects());
    folder.write("mine.toml", SENSOR);
    folder.succeed("generate job.toml --quiet");
    for (key, members) in folder.samples("out/small") {
        let label: serde_json::Value = serde_json::from_slice(&members["json"]).expect("JSON");
        let layer: serde_json::Value = serde_json::from_slice(&members["markers.json"]).expect("JSON");
        let pairs = |name: &str| -> Vec<[f64; 2]> { serde_json::from_value(layer[name].clone()).expect("pairs") };
        let (rest, moved) = (pairs("rest_px"), pairs("moved_px"));
        assert_eq!(rest.len() as u64, label["markers"]["count"].as_u64().expect("a number"), "{key}");
        let motion = |(a, b): (&[f64; 2], &[f64; 2])| (a[0] - b[0]).hypot(a[1] - b[1]);
        let largest = rest.iter().zip(&moved).map(motion).fold(0.0, f64::max);
        assert!((largest - label["markers"]["max_motion_px"].as_f64().expect("a number")).abs() < 1e-9, "{key}");
    }
}

#[test]
fn all_effects_is_part_of_the_job() {
    let folder = Folder::with_job(JOB);
    folder.succeed("generate job.toml --quiet --all-effects");
    for (key, label) in folder.labels("out/small") {
        assert_eq!(label["effects"]["shading"]["ran"], true, "{key}");
        assert_eq!(label["effects"]["markers"]["ran"], false, "what is not there cannot run");
    }
    assert!(folder.read("out/small/job.toml").contains("effects = \"all\""));
    let refused = folder.fail("generate job.toml --quiet", 2);
    assert!(refused.contains("effects is \"all\" there and \"called_for\" here"), "{refused}");
}

#[test]
fn plan_says_what_a_run_would_do_and_writes_nothing() {
    let folder = Folder::with_job(&with_effects());
    folder.write("mine.toml", SENSOR);
    let before = folder.files("");
    let text = folder.gelsim("plan job.toml --set dataset.samples=40").assert().success();
    let text = String::from_utf8(text.get_output().stdout.clone()).expect("UTF-8");
    assert_eq!(folder.files(""), before, "nothing is written");
    let line = |name: &str| {
        let line = text.lines().find(|line| line.split_whitespace().next() == Some(name));
        line.unwrap_or_else(|| panic!("no {name} in\n{text}"))
    };
    for effect in Effect::ALL {
        let words: Vec<&str> = line(effect.name()).split_whitespace().collect();
        let (ran, probed): (u64, u64) = (words[1].parse().expect("a count"), words[3].parse().expect("a count"));
        assert!(ran <= probed && (32..=40).contains(&probed), "{text}");
    }
    assert!(line("noise").contains("every pixel is noisy") && line("rest_shape").ends_with("the pad is flat"));
    assert!(line("texture").contains("a textured object reaches into the pad ("), "{text}");
    assert!(text.contains("40 samples of 48x36 px in 15 shards"), "{text}");
    assert!(line("size").contains("15 shards") && line("size").contains("free at out/small"));

    let part = folder.gelsim("plan job.toml --set dataset.samples=40 --partition 1/5 --threads 1").assert().success();
    let part = String::from_utf8(part.get_output().stdout.clone()).expect("UTF-8");
    assert!(part.contains("in 3 shards") && part.contains("on 1 thread"), "{part}");
}

#[test]
fn plan_foresees_the_bytes_of_a_run() {
    let folder = Folder::with_job(JOB);
    let text = folder.gelsim("plan job.toml --samples 30").assert().success();
    let text = String::from_utf8(text.get_output().stdout.clone()).expect("UTF-8");
    let size = text.lines().find_map(|line| line.strip_prefix("size   ")).expect("a size");
    let (number, unit) = size.split_once(" in ").expect("a size").0.split_once(' ').expect("a unit");
    let unit = match unit {
        "KiB" => 1024.0,
        "MiB" => 1024.0 * 1024.0,
        other => panic!("{other}"),
    };
    let expected = number.parse::<f64>().expect("a number") * unit;
    folder.succeed("generate job.toml --samples 30 --quiet");
    let found: usize = folder.files("out/small/data").values().map(Vec::len).sum();
    assert!((found as f64 / expected - 1.0).abs() < 0.05, "{found} bytes, foreseen {expected}");
}

#[test]
fn plan_refuses_what_generate_refuses() {
    let folder = Folder::with_job(&edited(JOB, &[("samples = 8", "samples = 0")]));
    assert!(folder.fail("plan job.toml", 2).contains("samples = 0 is out of range"));
    folder.write("job.toml", JOB);
    assert!(folder.fail("plan job.toml --threads 0", 2).contains("--threads 0 cannot work"));
    assert!(folder.fail("plan job.toml --shards 0..99", 2).contains("reaches beyond"));
}
