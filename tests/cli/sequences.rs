//! Sequences: what a run writes of them, that one frame is a press, that nothing depends on threads or division, and what is said of
//! mistakes.

use serde_json::Value;

use crate::support::{Folder, edited};

const PHASES: &str = r#"
[sequence]
friction = { coefficient = [0.3, 0.8] }
[[sequence.phase]]
name = "press"
duration_s = [0.1, 0.2]
depth_mm = [0.3, 0.8]
[[sequence.phase]]
name = "slide"
duration_s = 0.3
x_mm = [-1.5, 1.5]
y_mm = [-1.0, 1.0]
twist_deg = [-10.0, 10.0]
profile = "smooth"
[[sequence.phase]]
name = "roll"
duration_s = 0.2
tilt_deg = [-6.0, 6.0]
tilt_azimuth_deg = [0.0, 360.0]
[[sequence.phase]]
name = "release"
duration_s = 0.1
depth_mm = -0.1
"#;

/// Six sequences in two shards.
fn job() -> String {
    let start = r#"
[dataset]
name = "moves"
samples = 6
seed = 11
samples_per_shard = 3
splits = { train = 0.5, val = 0.5, test = 0.0 }
[sensor]
preset = "gelsight-2014"
resolution_px = [64, 48]
[markers]
pitch_mm = 2.0
[[object]]
path = "sphere.obj"
[[object]]
path = "cube.obj"
[pose]
yaw_deg = [0.0, 360.0]
tilt_deg = [0.0, 4.0]
x_mm = [-2.0, 2.0]
[output]
layers = ["depth", "contact", "markers", "slip", "flow"]
"#;
    format!("{start}{PHASES}")
}

fn folder(job: &str) -> Folder {
    Folder::with_objects(job, &["sphere", "cube", "cone", "thin_ridge", "flat_face"])
}

fn numbers(value: &Value) -> Vec<f64> {
    value.as_array().expect("a list").iter().map(|number| number.as_f64().expect("a number")).collect()
}

fn frames(label: &Value) -> &Vec<Value> {
    label["frames"].as_array().expect("frames")
}

#[test]
fn one_frame_that_presses_is_the_press_byte_for_byte() {
    let press = edited(
        &job(),
        &[
            (
                PHASES,
                "[indentation]\ndepth_mm = 0.6\n[texture]\npatterns = [\"knurled\"]\namplitude_mm = 0.05\nscale_mm = 0.8\n",
            ),
            (", \"slip\", \"flow\"", ""),
        ],
    );
    let phase = "[sequence]\n[[sequence.phase]]\nname = \"press\"\nduration_s = 0.04\ndepth_mm = 0.6\n";
    let sequence = edited(&press, &[("[indentation]\ndepth_mm = 0.6\n", phase)]);
    let folder = folder(&press);
    folder.write("moves.toml", sequence);
    let touches = folder.assert_presses_are_first_frames();
    assert_eq!(folder.samples("press").len(), 6);
    assert!(touches > 3, "{touches}");
}

#[test]
fn bytes_do_not_depend_on_threads_or_on_how_the_work_is_divided() {
    let folder = folder(&job());
    folder.assert_same_however_divided();
    folder.succeed("verify one");
    let said = folder.stdout_of("reproduce one 4");
    assert!(said.contains("f0003.flow.exr: the same") && said.contains("the same sample"), "{said}");
}

#[test]
fn labels_say_what_each_frame_shows_and_no_force_is_larger_than_friction_holds() {
    let folder = folder(&job());
    folder.succeed("generate job.toml --quiet");
    let labels = folder.labels("out/moves");
    assert_eq!(labels.len(), 6);
    let (mut slid, mut rested) = (0, 0);
    for (key, label) in labels {
        let sequence = &label["sequence"];
        let phases = sequence["phases"].as_array().expect("phases");
        let names: Vec<&str> = phases.iter().map(|phase| phase["name"].as_str().expect("a name")).collect();
        assert_eq!(names, ["press", "slide", "roll", "release"]);
        let coefficient = sequence["friction_coefficient"].as_f64().expect("a number");
        assert!((0.3..=0.8).contains(&coefficient));
        let duration: f64 = phases.iter().map(|phase| phase["duration_s"].as_f64().expect("s")).sum();
        let count = (duration * 25.0 - 1e-9).ceil() as usize;
        assert_eq!((frames(&label).len(), sequence["frames"].as_u64()), (count, Some(count as u64)));
        let of_phases: u64 = phases.iter().map(|phase| phase["frames"].as_u64().expect("a count")).sum();
        assert_eq!(of_phases, count as u64, "{key}");
        let (mut first_slip, mut gross) = (None, None);
        for (k, frame) in frames(&label).iter().enumerate() {
            assert_eq!(frame["index"], k);
            assert!((frame["t_s"].as_f64().expect("s") - (k + 1) as f64 / 25.0).abs() < 1e-12);
            assert_eq!(frame["health"]["healthy"], true, "{key} {k}: {}", frame["health"]["reason"]);
            let force = numbers(&frame["wrench"]["force_n"]);
            let (along, normal) = (force[0].hypot(force[1]), -force[2]);
            assert!(normal >= 0.0 && along <= coefficient * normal * (1.0 + 1e-4) + 1e-9, "{key} {k}: {force:?}");
            let touches = frame["contact"]["in_contact"] == true;
            let share = frame["slip"]["stick_fraction"].as_f64().expect("a share");
            let state = frame["slip"]["state"].as_str().expect("a state");
            assert!((0.0..=1.0).contains(&share));
            match state {
                "gross" => {
                    gross = gross.or(frame["t_s"].as_f64());
                    assert_eq!(share, 0.0);
                    slid += 1;
                }
                "none" if touches => {
                    assert!(share >= 0.95);
                    rested += 1;
                }
                _ => {}
            }
            if state != "none" {
                first_slip = first_slip.or(frame["t_s"].as_f64());
            }
            assert!(frame["slip"]["dissipated_nmm"].as_f64().expect("N mm") >= -1e-6);
        }
        assert_eq!((sequence["first_slip_s"].as_f64(), sequence["gross_slip_s"].as_f64()), (first_slip, gross));
        let last = frames(&label).last().expect("frames");
        assert_eq!(last["contact"]["in_contact"], false, "released");
        assert_eq!(numbers(&last["wrench"]["force_n"]), [0.0; 3]);
    }
    assert!(slid > 5 && rested > 5, "{slid} {rested}");
}

#[test]
fn a_force_is_found_and_one_that_the_pad_does_not_give_is_said() {
    let phases = r#"
[sequence]
friction = "stick"
[[sequence.phase]]
name = "load"
duration_s = 0.08
force_n = FORCE
[[sequence.phase]]
name = "tilt"
duration_s = 0.08
tilt_deg = 5.0
force_n = 0.5
"#;
    let with = |force: &str| edited(&job(), &[(PHASES, &phases.replace("FORCE", force))]);
    let folder = folder(&with("[0.3, 1.5]"));
    folder.succeed("generate job.toml --quiet");
    for (key, label) in folder.labels("out/moves") {
        assert_eq!(label["sequence"]["friction_coefficient"], Value::Null);
        for phase in label["sequence"]["phases"].as_array().expect("phases") {
            let last =
                phase["first_frame"].as_u64().expect("a number") + phase["frames"].as_u64().expect("a number") - 1;
            let force = numbers(&frames(&label)[last as usize]["wrench"]["force_n"]);
            let wanted = phase["force_n"].as_f64().expect("N");
            assert!((-force[2] / wanted - 1.0).abs() < 3e-3, "{key}: {force:?} of {wanted}");
        }
    }
    folder.write("hard.toml", with("1e5"));
    let said = folder.fail("generate hard.toml --quiet --out hard --set output.on_unhealthy=\"fail\"", 1);
    assert!(said.contains("phase `load` wants 100000.000 N, but at"), "{said}");
}

#[test]
fn hard_cases_are_finite_bounded_and_deterministic() {
    let hard = r#"
[sequence]
friction = { coefficient = MU }
[[sequence.phase]]
name = "jump"
depth_mm = 0.9
[[sequence.phase]]
name = "off the view"
duration_s = 0.12
x_mm = 14.0
[[sequence.phase]]
name = "back"
duration_s = 0.12
x_mm = -14.0
twist_deg = 400.0
[[sequence.phase]]
name = "lost"
depth_mm = -1.0
[[sequence.phase]]
name = "found in the same frame"
depth_mm = 0.2
[[sequence.phase]]
name = "roll far"
duration_s = 0.08
tilt_deg = 40.0
[[sequence.phase]]
name = "one pixel"
duration_s = 0.04
depth_mm = 1e-4
"#;
    for (object, mu) in [("cone", "0.0"), ("thin_ridge", "10.0"), ("flat_face", "0.5"), ("sphere", "1e-6")] {
        let job = edited(
            &job(),
            &[(PHASES, &hard.replace("MU", mu)), ("path = \"sphere.obj\"", &format!("path = \"{object}.obj\""))],
        );
        let folder = folder(&job);
        folder.succeed("generate job.toml --quiet --samples 2 --set output.on_unhealthy=\"keep\"");
        folder.succeed("verify out/moves");
        for (key, label) in folder.labels("out/moves") {
            for (k, frame) in frames(&label).iter().enumerate() {
                assert_eq!(frame["health"]["finite"], true, "{object} {mu} {key} {k}");
                let force = numbers(&frame["wrench"]["force_n"]);
                let mu: f64 = mu.parse().expect("a number");
                let most = mu * -force[2] * (1.0 + 1e-4) + 1e-9;
                assert!(force[0].hypot(force[1]) <= most, "{object} {mu} {key} {k}: {force:?}");
                assert_eq!(frame["health"]["healthy"], true, "{object} {mu} {key} {k}: {}", frame["health"]["reason"]);
            }
        }
    }
}

#[test]
fn a_folder_has_a_row_for_each_frame_and_verify_misses_a_frame() {
    let folder = folder(&job());
    folder.succeed("generate job.toml --quiet --set output.container=\"folder\"");
    folder.succeed("verify out/moves");
    let rows = folder.read("out/moves/data/train-000000/metadata.jsonl");
    let rows: Vec<Value> = rows.lines().map(|row| serde_json::from_str(row).expect("JSON")).collect();
    let counts: u64 = rows
        .iter()
        .filter(|row| row["frame"]["index"] == 0)
        .map(|row| row["sequence"]["frames"].as_u64().expect("a count"))
        .sum();
    assert_eq!(rows.len() as u64, counts);
    let first = rows[0]["file_name"].as_str().expect("a name");
    assert!(
        first.ends_with(".f0000.tactile.png")
            && rows[0]["flow_path"].as_str().is_some_and(|path| path.ends_with(".f0000.flow.exr"))
    );
    std::fs::remove_file(folder.path("out/moves/data/train-000000").join(first)).expect("it is there");
    let said = folder.stdout_of("verify out/moves");
    assert!(said.contains(&format!("{first} is missing")), "{said}");
}

#[test]
fn strips_films_and_reports_show_sequences() {
    let folder = folder(&job());
    folder.succeed("generate job.toml --quiet");
    folder.succeed("preview out/moves --out sheet.png");
    folder.succeed("preview job.toml --out job.png --count 2");
    folder.succeed("preview out/moves --key 1 --apng --out film.png");
    let film = folder.read_bytes("film.png");
    let count = frames(&folder.labels("out/moves")["000000001"]).len() as u32;
    let at = film.windows(4).position(|kind| kind == b"acTL").expect("an animation");
    assert_eq!(film[at + 4..at + 8], count.to_be_bytes());
    folder.succeed("report out/moves --out page.html");
    let page = folder.read("page.html");
    for words in ["<h2>Sequences</h2>", "Force over time", "Onset of gross slip", "f*.tactile.png"] {
        assert!(page.contains(words), "{words}");
    }
    for (command, words) in [
        ("preview job.toml --effects --out e.png", "--effects looks at single presses"),
        ("preview out/moves --apng --out e.png", "--key"),
    ] {
        let said = folder.fail(command, 2);
        assert!(said.contains(words), "{command}: {said}");
    }
}

#[test]
fn tradeoff_compares_force_slip_and_motion() {
    let folder = folder(&job());
    let table = folder.stdout_of("tradeoff job.toml --samples 2 --out t --quiet");
    assert!(table.contains("2 sequences of") && table.contains("flow"), "{table}");
    let result: Value = serde_json::from_str(&folder.read("t/tradeoff.json")).expect("JSON");
    let rows = result["rows"].as_array().expect("rows");
    let levels: Vec<&str> = rows.iter().map(|row| row["level"].as_str().expect("a name")).collect();
    assert_eq!(levels, ["draft", "standard", "high", "reference"]);
    let of = |key: &str| rows.iter().map(|row| row[key].as_f64().expect("a number")).collect::<Vec<_>>();
    let (force, flow) = (of("force_percent"), of("flow_um"));
    assert!(force.iter().all(|percent| *percent < 1.0) && flow[3] < flow[0] && flow[3] > 0.0, "{force:?} {flow:?}");
    assert!(folder.read("t/tradeoff.csv").lines().count() == 5 && folder.read("t/tradeoff.svg").contains("<svg"));
}

#[test]
fn mistakes_are_said_at_their_places() {
    for (from, to, words) in [
        ("depth_mm = [0.3, 0.8]", "depth_mm = [0.3, 8.0]", "depth_mm may be 0.3 to 8"),
        ("depth_mm = [0.3, 0.8]", "depth_mm = 0.3\nforce_n = 1.0", "both `depth_mm` and `force_n` say how deep"),
        ("duration_s = 0.3", "duration_s = -0.3", "duration_s may be -0.3"),
        ("duration_s = 0.3", "duration_s = 3000.0", "a sequence may have 75012 frames"),
        ("name = \"roll\"\n", "", "missing key `name`"),
        ("profile = \"smooth\"", "profile = \"smoth\"", "smoth"),
        ("coefficient = [0.3, 0.8]", "coefficient = [0.3, 80.0]", "coefficient may be 0.3 to 80"),
        (
            "[sequence]",
            "[indentation]\ndepth_mm = 0.5\n[sequence]",
            "the phases of a sequence say how deep the object is",
        ),
        ("[sequence]", "[indentation]\nno_contact = 0.5\n[sequence]", "whether the object touches"),
        ("[sequence]", "[shear]\nx_mm = 0.5\n[sequence]", "the phases of a sequence move the object"),
        ("[sequence]", "[gelpad.elastic]\nfriction = \"stick\"\n[sequence]", "a sequence has a friction of its own"),
        ("[sequence]", "[gelpad.mean_blur]\n[sequence]", "the gelpad model `mean_blur` knows no tractions"),
        ("[sequence]\n", "[sequence]\nframe_rate_hz = 0.0\n", "frame_rate_hz = 0 is out of range"),
        (PHASES, "[indentation]\ndepth_mm = 0.5\n", "a single press has no slip"),
        (PHASES, "[sequence]\n", "missing key `phase`"),
    ] {
        let folder = folder(&edited(&job(), &[(from, to)]));
        let said = folder.fail("plan job.toml", 2);
        assert!(said.contains(words) && said.contains("job.toml:"), "{to}: {said}");
    }
    for (from, to, words) in [
        (
            "x_mm = [-1.5, 1.5]",
            "x_mm = [-1.5, 9.5]",
            "in phase `slide` the point that [pose] places may come to x = -3.5 to 11.5 mm",
        ),
        ("depth_mm = [0.3, 0.8]", "depth_mm = [0.3, 1.8]", "depth_mm of a phase may be 1.8, over half of the pad's"),
    ] {
        let folder = folder(&edited(&job(), &[(from, to)]));
        let said = folder.succeed("plan job.toml");
        assert!(said.contains(words), "{to}: {said}");
    }
    let folder = folder(&format!("fidelity = {{ max_ms = 5.0 }}\n{}", job()));
    let said = folder.fail("plan job.toml", 2);
    assert!(said.contains("the level of a sequence is not chosen"), "{said}");
}

/// A float32 npy array.
fn npy(shape: &str, kind: &str, bytes: &[u8]) -> Vec<u8> {
    let mut header = format!("{{'descr': '{kind}', 'fortran_order': False, 'shape': {shape}, }}");
    header += &" ".repeat(63 - (10 + header.len()) % 64);
    header += "\n";
    let mut out = b"\x93NUMPY\x01\x00".to_vec();
    out.extend((header.len() as u16).to_le_bytes());
    out.extend(header.as_bytes());
    out.extend(bytes);
    out
}

#[test]
fn depth_frames_with_poses_become_frames_with_friction() {
    let job = edited(
        &job(),
        &[
            ("friction = { coefficient = [0.3, 0.8] }", "friction = { coefficient = 0.3 }"),
            ("path = \"sphere.obj\"", "path = \"cube.obj\"\nclass = \"a\""),
            ("tilt_deg = [0.0, 4.0]", ""),
            ("tilt_deg = [-6.0, 6.0]", ""),
            ("x_mm = [-1.5, 1.5]\ny_mm = [-1.0, 1.0]", "x_mm = 1.5\ny_mm = -1.0"),
        ],
    );
    let folder = folder(&job);
    folder.succeed("generate job.toml --quiet --samples 1 --set output.depth_format=\"npy\"");
    let label = folder.labels("out/moves").remove("000000000").expect("a label");
    let files = folder.samples("out/moves").remove("000000000").expect("a sample");
    std::fs::create_dir(folder.path("seen")).expect("a folder");
    let mut poses = String::from("file,quaternion_x,quaternion_y,quaternion_z,quaternion_w,x_mm,y_mm,z_mm\n");
    let mut piped = Vec::new();
    for (k, frame) in frames(&label).iter().enumerate() {
        let depth = &files[&format!("f{k:04}.depth.npy")];
        let values = depth[depth.len() - 4 * 64 * 48..].chunks_exact(4);
        // Heights over the pad; nothing where it does not reach below it.
        let heights = values.map(|four| f32::from_le_bytes([four[0], four[1], four[2], four[3]]));
        let bytes: Vec<u8> = heights.flat_map(|mm| if mm > 0.0 { -mm } else { 5.0 }.to_le_bytes()).collect();
        let seen = npy("(48, 64)", "<f4", &bytes);
        folder.write(&format!("seen/{k:03}.npy"), &seen);
        let (q, t) = (numbers(&frame["pose"]["quaternion_xyzw"]), numbers(&frame["pose"]["translation_mm"]));
        let all: Vec<f64> = q.into_iter().chain(t).collect();
        poses += &format!("{k:03},{}\n", all.iter().map(|value| format!("{value:?}")).collect::<Vec<_>>().join(","));
        piped.extend(npy("(7,)", "<f8", &all.iter().flat_map(|value| value.to_le_bytes()).collect::<Vec<u8>>()));
        piped.extend(seen);
    }
    folder.write("poses.csv", poses);
    let camera = "--depth-unit mm --plane-mm 0 --sensor gelsight-2014 --set markers.pitch_mm=2.0";
    folder.succeed(&format!(
        "render --depth seen {camera} --poses poses.csv --sequence 0.3 --layers slip,flow --out touched --quiet"
    ));
    let mut gross = 0;
    for (k, frame) in frames(&label).iter().enumerate() {
        let row: Value = serde_json::from_str(&folder.read(&format!("touched/{k:03}.json"))).expect("JSON");
        let [found, wanted] = [&row["frame"], frame].map(|frame| numbers(&frame["wrench"]["force_n"]));
        let largest = 1.0;
        for (found, wanted) in found.iter().zip(&wanted) {
            assert!((found - wanted).abs() < 0.05 * largest, "{k}: {found:?} {wanted:?}");
        }
        if frame["slip"]["state"] == "gross" {
            gross += u32::from(row["frame"]["slip"]["state"] == "gross");
        }
        assert!(folder.path(&format!("touched/{k:03}.flow.exr")).exists());
        assert_eq!(row["sequence"]["frames"], frames(&label).len());
    }
    assert!(gross > 2, "{gross}");
    // The same through a pipe.
    let mut streamed = folder.gelsim(&format!("render --stream {camera} --sequence 0.3 --quiet"));
    let output = streamed.write_stdin(piped.clone()).output().expect("it runs");
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    let image = 128 + 3 * 64 * 48;
    assert_eq!(output.stdout.len(), image * frames(&label).len());
    let last = image::load_from_memory(&folder.read_bytes(&format!("touched/{:03}.tactile.png", 5))).expect("a PNG");
    assert!(output.stdout[5 * image + 128..6 * image] == *last.to_rgb8().as_raw());
    for (change, words) in [(6, "its pose"), (piped.len() - 4, "frame")] {
        let mut broken = piped.clone();
        broken.truncate(change + (if change == 6 { 0 } else { 2 }));
        let output =
            folder.gelsim(&format!("render --stream {camera} --sequence 0.3 --quiet")).write_stdin(broken).output();
        let output = output.expect("it runs");
        let said = String::from_utf8_lossy(&output.stderr);
        assert!(output.status.code() == Some(1) && (said.contains(words) || said.contains("frame")), "{said}");
    }
    let names: Vec<String> = (0..frames(&label).len()).map(|k| format!("{k:03}\n")).collect();
    folder.write("still.csv", format!("file\n{}", names.concat()));
    let turned = |k: usize| if k == 2 { "0.0,0.0,0.17365,0.98481" } else { "0.0,0.0,0.0,1.0" };
    let rows: Vec<String> = (0..names.len()).map(|k| format!("{k:03},{}\n", turned(k))).collect();
    folder.write("turned.csv", format!("file,quaternion_x,quaternion_y,quaternion_z,quaternion_w\n{}", rows.concat()));
    let rows: Vec<String> = (0..names.len()).map(|k| format!("{k:03},{},0,0\n", ["1e10", "0"][k.min(1)])).collect();
    folder.write("far.csv", format!("file,x_mm,y_mm,z_mm\n{}", rows.concat()));
    for (more, words) in [
        ("--sequence 0.3 --poses far.csv", "seen/000.npy: the object is 1e10 mm away from the sensor"),
        ("--sequence 0.3 --poses still.csv", "the object's pose is the same in every frame"),
        ("--sequence 0.3 --poses turned.csv", "seen/002.npy: the object turns by 20.0 degrees since the frame before"),
        ("--sequence 0.3", "--sequence needs the object's poses"),
        ("--sequence 0.3 --poses poses.csv --fidelity paper", "knows no tractions"),
        ("--sequence 0.3 --poses poses.csv --fidelity finite-strain", "choose --fidelity high"),
        ("--sequence 0.3 --poses poses.csv --set gelpad.elastic.strain_correction=true", "leave it out"),
        ("--sequence 50 --poses poses.csv", "a coefficient of 0 to 10, or stick"),
    ] {
        let said = folder.fail(&format!("render --depth seen {camera} {more} --out no"), 2);
        assert!(said.contains(words), "{more}: {said}");
        assert!(!folder.path("no").exists(), "{more}");
    }
}
