//! Sequences and texture on gels that are not flat: what a run writes of them, that one frame is a press, that nothing depends on
//! threads or on which effects are skipped, and what is said of ways that lead off the gel.

use std::collections::BTreeMap;

use serde_json::Value;

use crate::support::{Folder, edited};

const FINGER: &str = r#"
fidelity = "draft"
[dataset]
name = "finger"
samples = 3
seed = 11
samples_per_shard = 2
[sensor]
preset = "geltip"
resolution_px = [80, 60]
[[object]]
path = "cube.obj"
[[object]]
path = "sphere.obj"
[pose]
from_tip_mm = [0.0, 30.0]
around_deg = [0.0, 360.0]
yaw_deg = [0.0, 360.0]
[texture]
patterns = ["knurled"]
amplitude_mm = [0.02, 0.08]
scale_mm = 1.2
"#;

const PHASES: &str = r#"
[sequence]
friction = { coefficient = [0.3, 0.8] }
[[sequence.phase]]
name = "press"
duration_s = 0.12
force_n = [0.5, 1.5]
[[sequence.phase]]
name = "slide"
duration_s = 0.16
x_mm = [-1.0, 1.0]
y_mm = [-0.6, 0.6]
twist_deg = [-10.0, 10.0]
[[sequence.phase]]
name = "roll"
duration_s = 0.08
tilt_deg = [-4.0, 4.0]
[[sequence.phase]]
name = "release"
duration_s = 0.08
depth_mm = -0.1
"#;

const LAYERS: &str =
    "[output]\nlayers = [\"depth\", \"surface\", \"contact\", \"normal\", \"pressure\", \"gap\", \"slip\", \"flow\"]\n";

fn folder(job: &str) -> Folder {
    Folder::with_objects(job, &["sphere", "cube"])
}

fn tactip(job: &str) -> String {
    let sensor = "preset = \"tactip\"\nresolution_px = [64, 64]";
    edited(job, &[("preset = \"geltip\"\nresolution_px = [80, 60]", sensor), ("30.0]", "12.0]")])
}

#[test]
fn sequences_on_a_gel_are_complete_and_the_same_on_any_number_of_threads() {
    let finger = format!("{FINGER}{PHASES}{LAYERS}");
    for job in [finger.clone(), edited(&tactip(&finger), &[("\"flow\"", "\"flow\", \"pins\"")])] {
        let folder = folder(&job);
        folder.assert_same_on_four_threads();
        folder.succeed("generate job.toml --quiet --out all --all-effects");
        folder.succeed("verify one");
        folder.succeed("reproduce one 1");
        let (samples, all) = (folder.samples("one"), folder.samples("all"));
        let (mut pulled, mut slipping) = (false, false);
        for (key, files) in &samples {
            for (name, bytes) in files.iter().filter(|(name, _)| *name != "json") {
                assert!(all[key][name] == *bytes, "{key}.{name}");
            }
            let label: Value = serde_json::from_slice(&files["json"]).expect("JSON");
            let frames = label["frames"].as_array().expect("a list");
            assert_eq!(frames.len(), 11);
            let mu = label["sequence"]["friction_coefficient"].as_f64().expect("a number");
            for frame in frames {
                let force = [0, 1, 2].map(|k| frame["wrench"]["force_n"][k].as_f64().expect("a number"));
                let size = force.iter().map(|n| n * n).sum::<f64>().sqrt();
                let touches = frame["slip"]["state"] != "none" || frame["slip"]["stick_fraction"] != 0.0;
                assert_eq!(size > 0.0, touches, "{frame}");
                assert_eq!(frame["numerics"]["converged"], true);
                slipping |= frame["slip"]["state"] != "none";
                // Of pressure and pull together no more than the law lets.
                let normal = size / (1.0 + mu * mu).sqrt();
                pulled |= size > 0.0 && frame["contact"]["force_n"].as_f64().expect("known") > normal;
            }
            let last = frames.last().expect("frames");
            assert_eq!(last["contact"]["in_contact"], false, "it is lifted");
            assert_eq!(last["wrench"]["force_n"][2], 0.0);
        }
        assert!(pulled && slipping, "some slip");
    }
}

#[test]
fn one_frame_on_a_gel_is_the_press_byte_for_byte() {
    let layers = "[output]\nlayers = [\"depth\", \"surface\", \"contact\", \"normal\", \"pressure\", \"gap\"]\n";
    let press = format!("{FINGER}[indentation]\ndepth_mm = 0.6\n{layers}");
    for press in [press.clone(), edited(&tactip(&press), &[("\"gap\"", "\"gap\", \"pins\"")])] {
        let phase = "[sequence]\n[[sequence.phase]]\nname = \"press\"\nduration_s = 0.04\ndepth_mm = 0.6\n";
        let folder = folder(&press);
        folder.write("moves.toml", edited(&press, &[("[indentation]\ndepth_mm = 0.6\n", phase)]));
        let touches = folder.assert_presses_are_first_frames();
        assert!(touches >= 2, "{touches}");
    }
}

#[test]
fn a_way_that_leads_off_the_gel_is_noted_before_work_starts() {
    let job = format!("{FINGER}{PHASES}");
    let folder = folder(&edited(&job, &[("force_n = [0.5, 1.5]", "depth_mm = 0.8")]));
    // Along the finger there is room; around it, 5 mm lead to where the gel is 1.16 mm lower.
    let quiet = folder.succeed("plan job.toml");
    let along = folder
        .gelsim("plan job.toml --set sequence.phase.1.x_mm=9.0 --set pose.from_tip_mm=25.0")
        .output()
        .expect("it runs");
    let along = String::from_utf8_lossy(&along.stderr).into_owned();
    let around = folder.gelsim("plan job.toml --set sequence.phase.1.y_mm=5.0").output().expect("it runs");
    let said = String::from_utf8_lossy(&around.stderr).into_owned() + &String::from_utf8_lossy(&around.stdout);
    assert!(said.contains("the object may come 5 mm from where it began, where the gel lies 1.15 mm lower"), "{said}");
    assert!(!quiet.contains("leave the gel") && !along.contains("leave the gel"), "{quiet} {along}");
}

#[test]
fn flow_and_gap_of_a_press_lie_where_it_is() {
    let layers = "[output]\nlayers = [\"gap\", \"flow\", \"contact\"]\n";
    let shear = "[indentation]\ndepth_mm = 1.5\n[shear]\nx_mm = 0.3\n";
    let tip = ("from_tip_mm = [0.0, 30.0]\naround_deg = [0.0, 360.0]\n", "");
    let job = edited(FINGER, &[tip, ("\"geltip\"", "\"tactip\""), ("[80, 60]", "[48, 36]")]);
    let folder = folder(&format!("{job}{shear}{layers}"));
    folder.succeed("generate job.toml --quiet --out out");
    for (key, files) in folder.samples("out") {
        let planes: BTreeMap<String, Vec<f32>> = crate::support::exr_planes(&files["flow.exr"]).into_iter().collect();
        let gap = crate::support::exr_planes(&files["gap.exr"]).remove(0).1;
        let mask = image::load_from_memory(&files["contact.png"]).expect("a PNG").into_luma8().into_raw();
        let (mut touched, mut close, mut right) = (0, 0, 0.0);
        for (at, _) in mask.iter().enumerate().filter(|(_, touches)| **touches > 0) {
            close += i32::from(gap[at] < 0.02);
            touched += 1;
            right += planes["X"][at];
        }
        assert!(touched > 10 && gap.iter().any(|mm| *mm > 0.1) && gap.contains(&-1.0), "{key}: {touched}");
        // All but its edge, where pixels show what is between nodes of the chart.
        assert!(2 * close > touched, "{key}: {close} of {touched}");
        // It sticks: taken along by what the object is pushed by, to the right.
        assert!((right / touched as f32 - 0.3).abs() < 0.06, "{key}: {}", right / touched as f32);
    }
}
