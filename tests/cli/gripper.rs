//! Two fingers that hold one object: what a run writes of a grip, that the forces are in balance, that each image is the one that
//! its own finger alone would give, that nothing depends on threads or division, and what is said of mistakes.

use std::collections::BTreeMap;

use glam::{DQuat, DVec3};
use serde_json::Value;

use crate::support::{Folder, assert_same_files, edited};

const CLOSING: &str = "force_n = { log_uniform = [0.3, 3.0] }";
const RIGHT: &str = r#"[gripper.right]
preset = "gelsight-mini"
resolution_px = [60, 80]
gelpad_youngs_modulus_kpa = [60.0, 300.0]
"#;

/// Six grips in two shards, by two sensors of which one differs from sample to sample.
fn job() -> String {
    format!(
        r#"
[dataset]
name = "grips"
samples = 6
seed = 11
samples_per_shard = 3
splits = {{ train = 0.5, val = 0.5, test = 0.0 }}
[sensor]
preset = "gelsight-2014"
resolution_px = [80, 60]
[gripper]
{CLOSING}
{RIGHT}
[[object]]
path = "sphere.obj"
[[object]]
path = "cube.obj"
[[object]]
path = "bolt.obj"
[pose]
face = "any"
yaw_deg = [0.0, 360.0]
tilt_deg = [0.0, 6.0]
x_mm = [-2.0, 2.0]
y_mm = [-2.0, 2.0]
[output]
layers = ["depth", "contact"]
"#
    )
}

fn folder(job: &str) -> Folder {
    Folder::with_objects(job, &["sphere", "cube", "bolt"])
}

fn number(value: &Value) -> f64 {
    value.as_f64().unwrap_or_else(|| panic!("{value} is no number"))
}

fn vector(value: &Value) -> DVec3 {
    let values = value.as_array().expect("a list");
    DVec3::from_array([0, 1, 2].map(|k| number(&values[k])))
}

fn rotation(value: &Value) -> DQuat {
    let values = value.as_array().expect("a list");
    DQuat::from_array([0, 1, 2, 3].map(|k| number(&values[k])))
}

/// A point of the object in the frame of a pose.
fn placed(pose: &Value, q: DVec3) -> DVec3 {
    rotation(&pose["quaternion_xyzw"]) * q + vector(&pose["translation_mm"])
}

/// Grey levels of a PNG, and the largest difference of two.
fn differ(one: &[u8], other: &[u8]) -> u8 {
    let [one, other] = [one, other].map(|bytes| image::load_from_memory(bytes).expect("a picture").to_rgb8());
    assert_eq!(one.dimensions(), other.dimensions());
    one.iter().zip(other.iter()).map(|(a, b)| a.abs_diff(*b)).max().expect("pixels")
}

#[test]
fn a_grip_has_the_files_of_both_fingers_and_forces_in_balance_whatever_is_held() {
    let folder = folder(&job());
    folder.succeed("generate job.toml --quiet");
    let samples = folder.samples("out/grips");
    assert_eq!(samples.len(), 6);
    let mut names: Vec<String> = Vec::new();
    for finger in ["left", "right"] {
        names.extend(["contact.png", "depth.exr", "tactile.png"].map(|layer| format!("{finger}.{layer}")));
    }
    names.push(String::from("json"));
    names.sort();
    let mut stiffness = Vec::new();
    for (key, files) in &samples {
        assert_eq!(files.keys().cloned().collect::<Vec<_>>(), names, "{key}");
        for (finger, size) in [("left", (80, 60)), ("right", (60, 80))] {
            let picture = image::load_from_memory(&files[&format!("{finger}.tactile.png")]).expect("a picture");
            assert_eq!((picture.width(), picture.height()), size);
        }
    }
    for (key, label) in folder.labels("out/grips") {
        let grip = &label["gripper"];
        let forces = ["left", "right"].map(|finger| number(&label[finger]["contact"]["total_force_n"]));
        assert!((forces[0] - forces[1]).abs() <= 1e-3 * forces[0].max(forces[1]), "{key}: {forces:?}");
        assert!(grip["balanced"] == true && (0.29..3.1).contains(&forces[0]), "{key}: {forces:?}");
        assert_eq!(number(&grip["residual_n"]), forces[0] - forces[1]);
        assert_eq!(number(&grip["force_n"]), 0.5 * (forces[0] + forces[1]));
        assert!(number(&grip["presses"]) < 40.0, "{key}: {}", grip["presses"]);
        // The depths of both fingers are what the object is wider than the gripper.
        let depths = ["left", "right"].map(|finger| number(&label[finger]["indentation_depth_mm"]));
        let squeeze = number(&grip["object_width_mm"]) - number(&grip["width_mm"]);
        assert!((depths[0] + depths[1] - squeeze).abs() < 1e-9, "{key}: {depths:?} {squeeze}");
        // One object in three frames.
        let q = DVec3::new(1.0, -2.0, 3.5);
        let at = placed(&grip["pose"], q);
        for finger in ["left", "right"] {
            let there = placed(&label[finger]["pose"], q);
            let expected = placed(&grip[format!("{finger}_frame")], at);
            assert!((there - expected).length() < 1e-9, "{key} {finger}: {there} {expected}");
            assert_eq!(label[finger]["health"]["healthy"], true);
        }
        let half = 0.5 * number(&grip["width_mm"]);
        let [left, right] = ["left", "right"].map(|finger| placed(&label[finger]["pose"], q));
        assert!((left - DVec3::new(at.x, at.y, at.z + half)).length() < 1e-9);
        assert!((right - DVec3::new(-at.x, at.y, half - at.z)).length() < 1e-9);
        stiffness.push(number(&label["right"]["sensor"]["gelpad_youngs_modulus_kpa"]));
        assert_eq!(
            (&label["left"]["sensor"]["name"], &label["right"]["sensor"]["name"]),
            (&Value::from("gelsight-2014"), &Value::from("gelsight-mini"))
        );
        assert!(["left", "right"].iter().all(|finger| label[*finger]["contact"]["in_contact"] == true), "{key}");
    }
    stiffness.dedup();
    assert_eq!(stiffness.len(), 6, "each is drawn anew");
}

/// A ball of 4 mm between two of the same sensor; the job of one finger that presses it is the same but for `closing`.
fn ball(closing: &str) -> String {
    let text = edited(&job(), &[(CLOSING, closing), (RIGHT, "")]);
    let objects = "[[object]]\npath = \"cube.obj\"\n[[object]]\npath = \"bolt.obj\"\n";
    edited(&text, &[(objects, ""), ("face = \"any\"\n", "")])
}

#[test]
fn two_equal_fingers_see_a_ball_alike_and_as_one_of_them_alone_would() {
    let folder = folder(&edited(&ball("squeeze_mm = 1.4"), &[("x_mm = [-2.0, 2.0]", "x_mm = 0.0")]));
    folder.succeed("generate job.toml --quiet --out grips");
    let (grips, labels) = (folder.samples("grips"), folder.labels("grips"));
    for (key, files) in &grips {
        let label = &labels[key];
        assert!(differ(&files["left.tactile.png"], &files["right.tactile.png"]) <= 1, "{key}");
        for finger in ["left", "right"] {
            assert!((number(&label[finger]["indentation_depth_mm"]) - 0.7).abs() < 1e-3, "{key} {finger}");
        }
        assert_eq!(label["gripper"]["presses"], 2, "the middle is the first guess");
        assert!(
            ["x", "y"].iter().enumerate().all(|(k, _)| {
                number(&label["gripper"]["torque_nmm"][k]).abs() < 1e-2 * number(&label["gripper"]["force_n"])
            }),
            "{key}: {}",
            label["gripper"]
        );
    }
    let press =
        edited(&folder.read("job.toml"), &[("[gripper]\nsqueeze_mm = 1.4\n", "[indentation]\ndepth_mm = 0.7\n")]);
    folder.write("press.toml", press);
    folder.succeed("generate press.toml --quiet --out presses");
    for (key, files) in folder.samples("presses") {
        let of_left: BTreeMap<String, Vec<u8>> = grips[&key]
            .iter()
            .filter_map(|(name, bytes)| Some((name.strip_prefix("left.")?.to_owned(), bytes.clone())))
            .collect();
        let alone = files.into_iter().filter(|(name, _)| name != "json").collect();
        assert_same_files(&of_left, &alone);
    }
}

#[test]
fn the_right_image_is_the_left_one_of_the_object_turned_by_hand() {
    // A bolt that lies across the fingers, beside the middle: half a turn about y is face +z and half a turn of yaw.
    let pose =
        "face = \"any\"\nyaw_deg = [0.0, 360.0]\ntilt_deg = [0.0, 6.0]\nx_mm = [-2.0, 2.0]\ny_mm = [-2.0, 2.0]\n";
    let turned =
        |face: &str, yaw: f64, x: f64| format!("face = \"{face}\"\nyaw_deg = {yaw:?}\nx_mm = {x:?}\ny_mm = 0.7\n");
    let objects = "[[object]]\npath = \"sphere.obj\"\n[[object]]\npath = \"cube.obj\"\n";
    let job =
        |pose_of: &str| edited(&job(), &[(pose, pose_of), (objects, ""), (RIGHT, ""), (CLOSING, "force_n = 1.5")]);
    let folder = folder(&job(&turned("-z", 30.0, 1.5)));
    folder.write("turned.toml", job(&turned("+z", 150.0, -1.5)));
    folder.succeed("generate job.toml --quiet --out one --samples 1");
    folder.succeed("generate turned.toml --quiet --out other --samples 1");
    let [one, other] = ["one", "other"].map(|name| folder.samples(name).remove("000000000").expect("a sample"));
    for (here, there) in [("left", "right"), ("right", "left")] {
        let levels = differ(&one[&format!("{here}.tactile.png")], &other[&format!("{there}.tactile.png")]);
        assert!(levels <= 2, "{here}: {levels} grey levels");
    }
    assert!(differ(&one["left.tactile.png"], &one["right.tactile.png"]) > 20, "the fingers see it from both sides");
}

#[test]
fn a_width_gives_the_force_that_gave_it() {
    let folder =
        folder(&edited(&job(), &[("gelpad_youngs_modulus_kpa = [60.0, 300.0]", "gelpad_youngs_modulus_kpa = 90.0")]));
    folder.succeed("generate job.toml --quiet --out forces");
    for (key, label) in folder.labels("forces") {
        let width = number(&label["gripper"]["width_mm"]);
        let again = edited(&folder.read("job.toml"), &[(CLOSING, &format!("width_mm = {width:?}"))]);
        folder.write("widths.toml", again);
        folder.succeed("generate widths.toml --quiet --out widths --overwrite");
        let found = &folder.labels("widths")[&key];
        let [force, expected] = [found, &label].map(|label| number(&label["gripper"]["force_n"]));
        assert!((force / expected - 1.0).abs() < 5e-3, "{key}: {force} N of {expected} N");
        for finger in ["left", "right"] {
            let [depth, expected] = [found, &label].map(|label| number(&label[finger]["indentation_depth_mm"]));
            assert!((depth - expected).abs() < 5e-3, "{key} {finger}: {depth} mm of {expected} mm");
        }
    }
}

#[test]
fn bytes_do_not_depend_on_threads_division_or_where_a_run_ended() {
    let folder = folder(&job());
    folder.assert_same_however_divided();
    // A shard of which the end is missing is made anew.
    folder.succeed("generate job.toml --quiet --out ended --shards 0..1");
    std::fs::remove_file(folder.path("ended/stats/train-000000.json")).expect("it is there");
    folder.succeed("generate job.toml --quiet --out ended");
    assert_same_files(&folder.lasting_files("one"), &folder.lasting_files("ended"));
    folder.succeed("verify one");
    let said = folder.stdout_of("reproduce one 4");
    assert!(said.contains("right.depth.exr: the same") && said.contains("the same sample"), "{said}");
    // Its own job is the same job.
    folder.succeed("generate one/job.toml --quiet --out again");
    assert_same_files(&folder.lasting_files("one"), &folder.lasting_files("again"));
}

#[test]
fn all_effects_give_the_same_pixels() {
    let folder = folder(&job());
    folder.succeed("generate job.toml --quiet --out some");
    folder.succeed("generate job.toml --quiet --out all --all-effects");
    let all = folder.samples("all");
    for (key, files) in folder.samples("some") {
        for finger in ["left", "right"] {
            let name = format!("{finger}.tactile.png");
            assert!(differ(&files[&name], &all[&key][&name]) <= 1, "{key} {finger}");
        }
    }
}

#[test]
fn fingers_that_do_not_reach_the_object_see_nothing_of_it() {
    let folder = folder(&edited(&job(), &[(CLOSING, "width_mm = 60.0")]));
    folder.write("open.toml", format!("{}[indentation]\nno_contact = 1.0\n", job()));
    folder.succeed("generate job.toml --quiet --out wide");
    folder.succeed("generate open.toml --quiet --out open");
    for name in ["wide", "open"] {
        for (key, label) in folder.labels(name) {
            let grip = &label["gripper"];
            assert_eq!((number(&grip["force_n"]), number(&grip["residual_n"])), (0.0, 0.0), "{key}");
            let gap = number(&grip["width_mm"]) - number(&grip["object_width_mm"]);
            assert!(if name == "wide" { gap > 20.0 } else { (gap - 0.2).abs() < 1e-9 }, "{key}: {gap}");
            for finger in ["left", "right"] {
                assert_eq!(label[finger]["contact"]["in_contact"], false);
                assert_eq!(label[finger]["indentation_depth_mm"], 0.0);
            }
        }
    }
}

#[test]
fn what_the_pads_cannot_give_is_not_healthy_and_says_why() {
    for (closing, words) in [
        (
            "force_n = 1e4",
            "10000.000 N are wanted, but at 2.700 mm, 0.9 of the pad's thickness, the left finger has only",
        ),
        ("width_mm = 0.5", "mm closer than the object is wide, and give way by"),
    ] {
        let folder = folder(&edited(&job(), &[(CLOSING, closing)]));
        let said = folder.fail("generate job.toml --quiet --set output.on_unhealthy=\"fail\"", 1);
        assert!(said.contains(words), "{said}");
        let said =
            folder.fail("generate job.toml --quiet --out kept --samples 2 --set output.on_unhealthy=\"keep\"", 1);
        assert!(said.contains("none of the 2 samples is healthy"), "{said}");
        // Nor are they the second time, when all of them are there.
        let again = "generate job.toml --quiet --out kept --samples 2 --set output.on_unhealthy=\"keep\"";
        assert!(folder.fail(again, 1).contains("none of the 2 samples is healthy"));
        folder.succeed("verify kept");
        for (key, label) in folder.labels("kept") {
            assert_eq!(label["gripper"]["balanced"], false, "{key}");
            assert_eq!(label["right"]["health"]["healthy"], false, "{key}");
        }
    }
}

#[test]
fn sheets_and_reports_show_both_fingers_and_what_looks_at_one_says_so() {
    let folder = folder(&job());
    folder.succeed("generate job.toml --quiet --out grips");
    folder.succeed("preview grips --out sheet.png");
    folder.succeed("preview job.toml --key 1 --out one.png");
    let picture = image::load_from_memory(&folder.read_bytes("one.png")).expect("a picture");
    // Three panels of 80 x 60 px, and below them three of 60 x 80.
    let (width, height) = (picture.width(), picture.height());
    assert!(width >= 3 * 80 && height >= 60 + 80, "{width} x {height}");
    folder.succeed("report grips --out page.html");
    let page = folder.read("page.html");
    for words in ["left.tactile.png", "right.depth.exr"] {
        assert!(page.contains(words), "{words}");
    }
    let card = folder.read("grips/README.md");
    for words in [
        "- {name: left.tactile.png,",
        "- {name: right.depth.exr,",
        "KEY.right.tactile.png",
        "`gelsight-mini` (60 x 80 px",
    ] {
        assert!(card.contains(words), "{words}: {card}");
    }
    for (command, words) in [
        ("tradeoff job.toml", "tradeoff looks at one sensor"),
        ("preview job.toml --effects --out e.png", "--effects looks at one sensor"),
        ("preview job.toml --key 0 --apng --out e.png", "--apng shows a sequence"),
    ] {
        let said = folder.fail(command, 2);
        assert!(said.contains(words), "{command}: {said}");
    }
}

#[test]
fn verify_misses_a_finger_and_finds_a_file_of_none() {
    let folder = folder(&job());
    folder.succeed("generate job.toml --quiet --out grips");
    let shard = folder.path("grips/data/train-000000.tar");
    let edit = |name: &str, to: Option<&str>| {
        let mut out = tar::Builder::new(Vec::new());
        for member in crate::support::members(&shard) {
            let mut header = tar::Header::new_ustar();
            header.set_size(member.bytes.len() as u64);
            header.set_mode(0o644);
            let path = if member.name == name { to } else { Some(member.name.as_str()) };
            if let Some(path) = path {
                out.append_data(&mut header, path, member.bytes.as_slice()).expect("room");
            }
        }
        out.into_inner().expect("room")
    };
    let complete = std::fs::read(&shard).expect("it is there");
    let first = crate::support::members(&shard)[0].name.clone();
    assert!(first.ends_with(".left.tactile.png"), "{first}");
    let key = &first[..9];
    let strange = format!("{key}.middle.tactile.png");
    for (name, to, words) in [
        (first.clone(), None, format!("{first} is missing")),
        (first.clone(), Some(strange.as_str()), format!("{strange} does not belong there")),
    ] {
        std::fs::write(&shard, edit(&name, to)).expect("a file");
        let said = folder.stdout_of("verify grips");
        assert!(said.contains(&words), "{said}");
        std::fs::write(&shard, &complete).expect("a file");
    }
}

#[test]
fn mistakes_are_said_at_their_places() {
    for (from, to, words, place) in [
        (CLOSING, "", "missing key `force_n` in [gripper]", "[gripper]"),
        (CLOSING, "force_n = 1.0\nwidth_mm = 20.0", "both `width_mm` and `force_n` say how far", "force_n = 1.0"),
        (CLOSING, "force_n = -1.0", "force_n may be -1", "force_n = -1.0"),
        (
            CLOSING,
            "squeeze_mm = 9.0",
            "squeeze_mm may be 9, and both gelpads together are as thick as 7 mm",
            "squeeze_mm = 9.0",
        ),
        (CLOSING, "squeze_mm = 1.0", "squeze_mm", "squeze_mm = 1.0"),
        (
            "preset = \"gelsight-mini\"",
            "preset = \"gelsight-mimi\"",
            "no sensor preset is called `gelsight-mimi`",
            "mimi",
        ),
        ("resolution_px = [60, 80]", "resolution_px = [0, 80]", "resolution_px = 0 is out of range", "[0, 80]"),
        ("gelpad_youngs_modulus_kpa = [60.0, 300.0]", "gelpad_yongs = 1.0", "gelpad_yongs", "gelpad_yongs"),
        ("preset = \"gelsight-mini\"", "preset = \"geltip\"", "the gel of `geltip` has a shape", "geltip"),
        (
            "preset = \"gelsight-mini\"",
            "preset = \"gelsight-series2\"",
            "the light of `gelsight-2014` is `phong`, that of `gelsight-series2` is `lamps`",
            "leave [gripper.right] out",
        ),
        ("preset = \"gelsight-2014\"", "preset = \"geltip\"", "the gel of `geltip` has a shape", "geltip"),
        ("[pose]", "[indentation]\ndepth_mm = 0.5\n[pose]", "says how deep each finger is pressed", "depth_mm = 0.5"),
        ("[pose]", "[gelpad.mean_blur]\n[pose]", "the gelpad model `mean_blur` knows no force", "gelpad.mean_blur"),
        ("[output]", "[output]\ncontainer = \"folder\"", "a grip has two", "container"),
    ] {
        let folder = folder(&edited(&job(), &[(from, to)]));
        let said = folder.fail("plan job.toml", 2);
        assert!(said.contains(words) && said.contains(place), "{to}: {said}");
    }
    for fidelity in ["\"paper\"", "{ max_ms = 5.0 }"] {
        let folder = folder(&format!("fidelity = {fidelity}\n{}", job()));
        let said = folder.fail("plan job.toml", 2);
        assert!(said.contains("job.toml:1:"), "{said}");
    }
}

const PHASES: &str = r#"
[sequence]
friction = { coefficient = [0.3, 0.6] }
[[sequence.phase]]
name = "close"
duration_s = 0.12
force_n = [0.5, 1.5]
[[sequence.phase]]
name = "lift"
duration_s = 0.2
y_mm = [1.0, 2.0]
twist_deg = [-5.0, 5.0]
[[sequence.phase]]
name = "open"
duration_s = 0.12
squeeze_mm = -0.2
"#;

fn lift() -> String {
    edited(
        &job(),
        &[
            (CLOSING, ""),
            ("samples = 6", "samples = 4"),
            ("samples_per_shard = 3", "samples_per_shard = 2"),
            ("[output]", &format!("{PHASES}[output]")),
        ],
    )
}

#[test]
fn fingers_close_lift_and_open_in_balance_and_the_object_slides_along_both() {
    let folder = folder(&lift());
    folder.succeed("generate job.toml --quiet --out lifts");
    folder.succeed("verify lifts");
    let samples = folder.samples("lifts");
    let mut slid = 0;
    for (key, label) in folder.labels("lifts") {
        let sequence = &label["sequence"];
        let frames = label["frames"].as_array().expect("frames");
        assert_eq!(sequence["frames"].as_u64(), Some(frames.len() as u64));
        for (k, frame) in frames.iter().enumerate() {
            let files = &samples[&key];
            assert!(["left", "right"].iter().all(|finger| files.contains_key(&format!("f{k:04}.{finger}.depth.exr"))));
            assert_eq!(frame["left"]["health"]["healthy"], true, "{key} {k}: {}", frame["left"]["health"]["reason"]);
            let grip = &frame["gripper"];
            let forces = ["left", "right"].map(|finger| vector(&frame[finger]["wrench"]["force_n"]));
            let normal = forces.map(|force| 0.0 - force.z);
            assert!((normal[0] - normal[1]).abs() <= 2e-3 * normal[0].max(normal[1]), "{key} {k}: {normal:?}");
            assert_eq!(number(&grip["force_n"]), 0.5 * (normal[0] + normal[1]));
            // What pulls a pad along is no more than friction holds, and both are pulled the way that the object goes.
            let coefficient = number(&sequence["friction_coefficient"]);
            for force in forces {
                assert!(force.x.hypot(force.y) <= coefficient * -force.z * 1.0001 + 1e-9, "{key} {k}: {force}");
            }
            if frame["phase"] == "lift" {
                assert!(forces.iter().all(|force| force.y > 0.0), "{key} {k}: down in both images: {forces:?}");
                slid += u32::from(frame["left"]["slip"]["state"] == "gross");
            }
            // One object in three frames, whatever has moved.
            let q = DVec3::new(1.0, -2.0, 3.5);
            let at = placed(&grip["pose"], q);
            for finger in ["left", "right"] {
                let there = placed(&frame[finger]["pose"], q);
                assert!((there - placed(&grip[format!("{finger}_frame")], at)).length() < 1e-9, "{key} {k} {finger}");
            }
        }
        let wanted = number(&sequence["phases"][0]["force_n"]);
        let last = sequence["phases"][0]["frames"].as_u64().expect("a count") as usize - 1;
        let closed = number(&frames[last]["gripper"]["force_n"]);
        assert!((closed / wanted - 1.0).abs() < 5e-3, "{key}: {closed} N of {wanted} N");
        let open = frames.last().expect("frames");
        assert_eq!(
            (&open["left"]["contact"]["in_contact"], number(&open["gripper"]["force_n"])),
            (&Value::from(false), 0.0)
        );
    }
    assert!(slid > 3, "{slid}");
    folder.succeed("generate job.toml --quiet --out four --threads 4");
    assert_same_files(&folder.lasting_files("lifts"), &folder.lasting_files("four"));
    folder.succeed("generate lifts/job.toml --quiet --out again");
    assert_same_files(&folder.lasting_files("lifts"), &folder.lasting_files("again"));
    let said = folder.stdout_of("reproduce lifts 1");
    assert!(said.contains("f0003.right.tactile.png: the same") && said.contains("the same sample"), "{said}");
    folder.succeed("preview lifts --out sheet.png");
    folder.succeed("preview job.toml --key 0 --apng --out film.png");
    folder.succeed("report lifts --out page.html");
    assert!(folder.read("page.html").contains("f*.right.tactile.png"));
}

#[test]
fn the_first_frame_of_a_squeeze_is_the_grip_byte_for_byte_but_for_the_force_it_is_balanced_by() {
    // Between equal pads a ball is in the middle, whichever force is balanced.
    let phase = "[sequence]\n[[sequence.phase]]\nname = \"a\"\nduration_s = 0.04\nsqueeze_mm = 1.4\n";
    let folder = folder(&edited(&ball("squeeze_mm = 1.4"), &[("x_mm = [-2.0, 2.0]", "x_mm = 0.0")]));
    let sequence =
        edited(&folder.read("job.toml"), &[("squeeze_mm = 1.4\n", ""), ("[output]", &format!("{phase}[output]"))]);
    folder.write("sequence.toml", sequence);
    folder.succeed("generate job.toml --quiet --out grips");
    folder.succeed("generate sequence.toml --quiet --out moves");
    let moves = folder.samples("moves");
    for (key, files) in folder.samples("grips") {
        let expected: BTreeMap<String, Vec<u8>> = files
            .into_iter()
            .filter(|(name, _)| name != "json")
            .map(|(name, bytes)| (format!("f0000.{name}"), bytes))
            .collect();
        let mut found = moves[&key].clone();
        found.remove("json");
        assert_same_files(&expected, &found);
    }
}

#[test]
fn mistakes_of_a_grippers_phases_are_said_at_their_places() {
    for (from, to, words, place) in [
        (
            "[gripper]\n",
            "[gripper]\nforce_n = 1.0\n",
            "the phases of a sequence say how far the fingers close",
            "force_n = 1.0",
        ),
        ("squeeze_mm = -0.2", "depth_mm = -0.2", "a gripper's fingers are pressed equally", "depth_mm = -0.2"),
        ("squeeze_mm = -0.2", "squeeze_mm = 20.0", "squeeze_mm may be 20", "squeeze_mm = 20.0"),
        (
            "squeeze_mm = -0.2",
            "squeeze_mm = -0.2\nwidth_mm = 9.0",
            "both `width_mm` and `squeeze_mm` say how far",
            "squeeze_mm",
        ),
        ("twist_deg = [-5.0, 5.0]", "tilt_deg = 3.0", "does not roll over one of them", "tilt_deg = 3.0"),
    ] {
        let folder = folder(&edited(&lift(), &[(from, to)]));
        let said = folder.fail("plan job.toml", 2);
        assert!(said.contains(words) && said.contains(place), "{to}: {said}");
    }
    let alone = edited(&lift(), &[("[gripper]\n", ""), (RIGHT, "")]);
    let said = folder(&alone).fail("plan job.toml", 2);
    assert!(said.contains("`squeeze_mm` is of two fingers, and this job has one"), "{said}");
}
