//! Gels that are not flat, and pins: what a run writes, that nothing depends on threads or on which effects are skipped, and
//! what is refused.

use serde_json::Value;

use crate::support::{Folder, edited};

const JOB: &str = r#"
[dataset]
name = "pins"
samples = 8
seed = 5
samples_per_shard = 4
[sensor]
preset = "tactip"
[[object]]
path = "edge_slab.obj"
[[object]]
path = "sphere.obj"
[pose]
anchor = "origin"
yaw_deg = [0.0, 360.0]
roll_deg = [-10.0, 10.0]
pitch_deg = [-10.0, 10.0]
x_mm = [-6.0, 6.0]
y_mm = [-6.0, 6.0]
[indentation]
depth_mm = [0.5, 3.0]
no_contact = 0.2
[output]
layers = ["depth", "surface", "contact", "normal", "pressure", "reference", "pins"]
"#;

fn folder(job: &str) -> Folder {
    Folder::with_objects(job, &["sphere", "edge_slab", "cube"])
}

#[test]
fn a_dataset_of_pins_is_complete_and_the_same_on_any_number_of_threads() {
    let folder = folder(JOB);
    folder.assert_same_on_four_threads();
    folder.succeed("generate job.toml --quiet --out folders --set output.container=\"folder\"");
    for name in ["one", "folders"] {
        folder.succeed(&format!("verify {name}"));
    }
    folder.succeed("reproduce one 5");
    folder.succeed("report one");
    folder.succeed("preview one --out strip.png");
    let samples = folder.samples("one");
    let mut touching = 0;
    for files in samples.values() {
        let label: Value = serde_json::from_slice(&files["json"]).expect("JSON");
        let pins: Value = serde_json::from_slice(&files["pins.json"]).expect("JSON");
        for key in ["rest_px", "moved_px", "rest_mm", "moved_mm"] {
            assert_eq!(pins[key].as_array().expect("a list").len(), 331);
        }
        let contact = &label["contact"];
        let force: Vec<f64> = contact["force_vector_n"]
            .as_array()
            .expect("three")
            .iter()
            .map(|n| n.as_f64().expect("a number"))
            .collect();
        let size = force.iter().map(|n| n * n).sum::<f64>().sqrt();
        assert!((size - contact["total_force_n"].as_f64().expect("known")).abs() < 1e-9);
        if contact["in_contact"] == true {
            touching += 1;
            assert!(force[2] < 0.0, "the object pushes into the gel");
            assert!(label["markers"]["max_motion_px"].as_f64().expect("a number") > 0.0);
        } else {
            assert_eq!(pins["rest_px"], pins["moved_px"]);
            assert_eq!((force[2], size), (0.0, 0.0));
        }
    }
    assert!((4..8).contains(&touching), "{touching}");
}

/// The oracle of gating: everything computed everywhere gives the same bytes.
#[test]
fn what_is_skipped_would_change_nothing() {
    let folder = folder(JOB);
    folder.succeed("generate job.toml --quiet --out gated");
    folder.succeed("generate job.toml --quiet --out all --set effects=\"all\"");
    let (gated, all) = (folder.samples("gated"), folder.samples("all"));
    for (key, files) in gated {
        for (name, bytes) in files.into_iter().filter(|(name, _)| name != "json") {
            assert!(all[&key][&name] == bytes, "{key}.{name}");
        }
    }
}

#[test]
fn without_jitter_noise_and_threshold_an_untouched_gel_is_its_reference() {
    let job = edited(
        JOB,
        &[
            ("no_contact = 0.2", "no_contact = 1.0"),
            ("[pose]", "[camera]\nread_noise_levels = 0.0\nthreshold = 0.0\n[pose]"),
        ],
    );
    let job = edited(
        &job,
        &[("preset = \"tactip\"", "preset = \"tactip\"\npins.size_jitter = 0.0\npins.place_jitter_mm = 0.0")],
    );
    let folder = folder(&job);
    folder.succeed("generate job.toml --quiet --out out");
    for files in folder.samples("out").into_values() {
        assert!(files["tactile.png"] == files["reference.png"]);
    }
    assert!(folder.labels("out").values().all(|label| label["effects"]["markers"]["reason"] == "nothing moves them"));
}

const FINGER: &str = r#"
[dataset]
name = "finger"
samples = 8
seed = 5
samples_per_shard = 4
[sensor]
preset = "geltip"
resolution_px = [120, 90]
[[object]]
path = "cube.obj"
[[object]]
path = "sphere.obj"
[pose]
from_tip_mm = [0.0, 30.0]
around_deg = [0.0, 360.0]
yaw_deg = [0.0, 360.0]
[indentation]
depth_mm = [0.3, 1.0]
no_contact = 0.2
[output]
layers = ["depth", "surface", "contact", "normal", "pressure", "reference"]
"#;

#[test]
fn a_finger_lit_along_its_gel_gives_a_complete_dataset_and_skipping_changes_no_byte_of_it() {
    let folder = folder(FINGER);
    folder.assert_same_on_four_threads();
    folder.succeed("generate job.toml --quiet --out all --all-effects");
    folder.succeed("verify one");
    folder.succeed("reproduce one 5");
    folder.succeed("report one");
    folder.succeed("preview one --out strip.png");
    let (samples, all) = (folder.samples("one"), folder.samples("all"));
    let mut touching = 0;
    for (key, files) in &samples {
        for (name, bytes) in files.iter().filter(|(name, _)| *name != "json") {
            assert!(all[key][name] == *bytes, "{key}.{name}");
        }
        let label: Value = serde_json::from_slice(&files["json"]).expect("JSON");
        let in_contact = label["contact"]["in_contact"] == true;
        touching += u32::from(in_contact);
        assert_eq!(label["effects"]["shading"]["ran"], label["indentation_depth_mm"] != 0.0, "{label}");
        let changed = files["tactile.png"] != files["reference.png"];
        assert!(changed || !in_contact, "{key}");
        // Into the gel: towards its axis, and up from below.
        let place = [0, 1, 2].map(|k| label["pose"]["translation_mm"][k].as_f64().expect("a number"));
        let force = [0, 1, 2].map(|k| label["contact"]["force_vector_n"][k].as_f64().expect("a number"));
        let towards_axis = -(place[0] * force[0] + place[1] * force[1]);
        assert!(!in_contact || towards_axis + 10.0 * force[2].abs() > 0.0, "{key}: {force:?}");
    }
    assert!((4..8).contains(&touching), "{touching}");
}

#[test]
fn a_photograph_of_a_finger_is_the_image_where_nothing_touches() {
    let folder = folder(FINGER);
    folder.succeed("generate job.toml --quiet --out one --set dataset.samples=2");
    let first = folder.samples("one").into_values().next().expect("a sample");
    folder.write("photograph.png", first["reference.png"].clone());
    let sets = "--set dataset.samples=1 --set sensor.background=\"photograph.png\" --set indentation.no_contact=1.0 \
                --set sensor.camera.read_noise_levels=0.0";
    folder.succeed(&format!("generate job.toml --quiet --out two {sets}"));
    let second = folder.samples("two").into_values().next().expect("a sample");
    let pixels = |bytes: &[u8]| image::load_from_memory(bytes).expect("a PNG").into_rgb8().into_raw();
    assert!(pixels(&second["tactile.png"]) == pixels(&first["reference.png"]));
}

#[test]
fn depth_on_the_axis_is_independent_of_the_tilt_and_draws_beside_it_are_rejected() {
    let job = edited(
        JOB,
        &[
            ("[[object]]\npath = \"sphere.obj\"\n", ""),
            ("[indentation]\n", "[indentation]\nat = \"axis\"\n"),
            ("no_contact = 0.2", ""),
            ("[output]", "[output]\non_unhealthy = \"reject\""),
        ],
    );
    let folder = folder(&job);
    folder.succeed("generate job.toml --quiet --out out");
    let labels = folder.labels("out");
    assert!(labels.values().any(|label| label["attempt"] != 0), "some draws are beside the axis");
    for label in labels.into_values() {
        let number = |value: &Value| value.as_f64().expect("a number");
        let [x, y, z, w] = [0, 1, 2, 3].map(|k| number(&label["pose"]["quaternion_xyzw"][k]));
        let place = [0, 1, 2].map(|k| number(&label["pose"]["translation_mm"][k]));
        // The point at that depth on the axis, in the mesh's frame: on its lower face, or on the face at its edge.
        let p = [-place[0], -place[1], -number(&label["indentation_depth_mm"]) - place[2]];
        let rows = [
            [2.0 * (x * y - z * w), 1.0 - 2.0 * (x * x + z * z), 2.0 * (y * z + x * w)],
            [2.0 * (x * z + y * w), 2.0 * (y * z - x * w), 1.0 - 2.0 * (x * x + y * y)],
        ];
        let [across, above] = rows.map(|row| (0..3).map(|k| row[k] * p[k]).sum::<f64>());
        let near = |mm: f64| mm.abs() < 1e-4;
        assert!((near(above) && across > -1e-4) || (near(across) && above > 0.0), "{across} {above}");
    }
}

#[test]
fn what_is_for_flat_pads_is_refused_with_its_place() {
    let folder = folder(JOB);
    for (set, said) in [
        ("camera.distortion_k1=0.1", "distortion by [camera] on a gel that has a shape"),
        ("fidelity=\"paper\"", "a pad that is not elastic on a gel that has a shape"),
    ] {
        let said_of = folder.fail(&format!("plan job.toml --set {set}"), 2);
        assert!(said_of.contains(said), "{set}: {said_of}");
    }
    let said = folder.fail("render --stream --depth-unit mm --sensor tactip --plane-mm 10", 2);
    assert!(said.contains("leave it out: the frame's camera stands where [sensor.lens] says"), "{said}");
}
