//! `gelsim calibrate --force` and `gelsim compare --force`: what they write, what they refuse, what a job takes from
//! it. How well moduli are recovered, the tests of `gelsim-lab` tell.

use std::fmt::Write;

use super::calibrated::add_sensor;
use crate::support::{Folder, JOB, assert_same_files, edited, json};

/// Modulus, kPa, and coefficient of friction of the pad that is hidden.
const HIDDEN: [f64; 2] = [120.0, 0.7];

/// Presses of a flat punch: the force is exactly proportional to the depth, and relaxes by 0.3 in 0.5 s.
fn table(presses: impl IntoIterator<Item = u32>, modulus_kpa: f64) -> String {
    let mut text = String::from("press,punch_radius_mm,depth_mm,force_n,time_s\n");
    for press in presses {
        let depth_mm = 0.1 + 0.04 * f64::from(press);
        // About 1 + 1.3 a / h times that on a half-space; 2 % more or less from press to press.
        let noise = 1.0 + 0.02 * (f64::from(press * 37 % 11) / 5.0 - 1.0);
        let first_n = 1e-3 * modulus_kpa * 2.0 * 1.5 * depth_mm / 0.77 * 1.7 * noise;
        for k in 0..25 {
            let t = 0.1 * f64::from(k);
            let force_n = first_n * (0.7 + 0.3 * (-t / 0.5).exp());
            writeln!(text, "p{press},1.5,{depth_mm},{force_n},{t}").expect("a string");
        }
    }
    text
}

fn folder() -> Folder {
    let folder = Folder::new();
    add_sensor(&folder);
    folder.write("forces.csv", table(0..8, HIDDEN[0]));
    folder.write("others.csv", table(8..12, HIDDEN[0]));
    folder
}

#[test]
fn the_sensor_file_keeps_its_other_keys_and_files_and_predicts_other_presses() {
    let folder = folder();
    let said = folder.stdout_of("calibrate --force forces.csv --sensor sensor.toml --out out/mine.toml");
    for words in ["Young's modulus", " ± ", "relaxation, share", "8 presses, 200 rows", "no shear_force_n"] {
        assert!(said.contains(words), "{words}: {said}");
    }
    let sensor: toml::Table = folder.read("out/mine.toml").parse().expect("TOML");
    assert_eq!(sensor["background"].as_str(), Some("../untouched.png"));
    assert_eq!(sensor["calibration"].as_str(), Some("../table.json"));
    assert_eq!(sensor["name"].as_str(), Some("mine"));
    let mode = &sensor["gelpad_relaxation"].as_array().expect("modes")[0];
    let [share, time_s] = ["share", "time_s"].map(|key| mode[key].as_float().expect("a number"));
    assert!((share - 0.3).abs() < 0.01 && (time_s - 0.5).abs() < 0.02, "{share} {time_s}");
    let found = json(&folder, "out/mine.force.json");
    assert_eq!(found["presses"].as_array().map(Vec::len), Some(8));
    assert!(found["values"][0]["standard_error"].as_f64().is_some_and(|error| error > 0.0));
    assert_eq!(found["covariance"].as_array().map(Vec::len), Some(3));
    assert!(folder.read("out/mine.force.html").contains("<svg"));

    let compare = "compare --force others.csv --sensor out/mine.toml --out compared";
    let said = folder.stdout_of(&format!("{compare} --per-image"));
    assert!(said.contains("p9") && said.contains("normal force"), "{said}");
    let compared = json(&folder, "compared/force.json");
    assert!(compared["normal"]["rms_share"].as_f64().is_some_and(|share| share < 0.03), "{compared}");
    assert_eq!(folder.read("compared/force.csv").lines().count(), 1 + 4 * 25);

    let first = folder.files("out");
    folder.succeed("calibrate --force forces.csv --sensor sensor.toml --out out/mine.toml --threads 1 --quiet");
    assert_same_files(&first, &folder.files("out"));
    // The sensor that was written is one to start from.
    folder.succeed("calibrate --force forces.csv --sensor out/mine.toml --out out/mine.toml --quiet");
    let again: toml::Table = folder.read("out/mine.toml").parse().expect("TOML");
    assert_eq!(again["background"].as_str(), Some("../untouched.png"));
}

#[test]
fn hopeless_presses_end_with_status_1_and_write_nothing_unless_they_are_to_be_kept() {
    let folder = folder();
    folder.write("forces.csv", table(0..2, HIDDEN[0]));
    let before = folder.files("");
    let command = "calibrate --force forces.csv --out out/mine.toml";
    let said = folder.fail(command, 1);
    assert!(said.contains("2 of the 3 presses") && said.contains("nothing is written"), "{said}");
    assert_same_files(&before, &folder.files(""));
    let said = folder.succeed(&format!("{command} --keep-anyway"));
    assert!(said.contains("2 of the 3 presses"), "{said}");
    assert!(folder.path("out/mine.toml").exists());
    folder.write("forces.csv", table(0..8, 1e6));
    let said = folder.fail(command, 1);
    assert!(said.contains("gelpads have 1 to 10000 kPa"), "{said}");
}

#[test]
fn mistakes_in_tables_and_arguments_end_with_status_2() {
    let folder = folder();
    folder.write("forces.csv", table(0..8, HIDDEN[0]).replace("p3,1.5,", "p3,x,"));
    let said = folder.fail("calibrate --force forces.csv --out out/mine.toml", 2);
    assert!(
        said.contains("forces.csv:77") && said.contains("25 rows have a `punch_radius_mm` that is no number"),
        "{said}"
    );
    folder.fail("calibrate --force nowhere.csv --out out/mine.toml", 2);
    folder.fail("calibrate --force forces.csv --detect --out out/mine.toml", 2);
    folder.fail("calibrate --fit-zero --out out/mine.toml", 2);
    folder.fail("calibrate --force others.csv --sensor geltip --out out/mine.toml", 2);
    folder.fail("compare --force others.csv", 2);
    folder.fail("compare --force others.csv --sensor geltip", 2);
    folder.fail("compare", 2);
    assert!(!folder.path("out").exists());
}

#[test]
fn sequences_take_the_friction_of_their_sensor_unless_the_job_says_another() {
    let phase = "[sequence]\n[[sequence.phase]]\nname = \"press\"\nduration_s = 0.04\ndepth_mm = 0.6\n";
    let indentation = "[indentation]\ndepth_mm = { log_uniform = [0.3, 1.2] }\nno_contact = 0.25\n";
    let job = edited(JOB, &[(indentation, phase)]);
    let sensor = "[sensor]\ngelpad_friction_coefficient = 0.7\n";
    let folder = Folder::with_job(&edited(&job, &[("[sensor]\n", sensor)]));
    let friction = |arguments: &str| {
        folder.succeed(&format!("generate job.toml --quiet --out out {arguments}"));
        let job: toml::Table = folder.read("out/job.toml").parse().expect("TOML");
        std::fs::remove_dir_all(folder.path("out")).expect("a dataset");
        job["sequence"]["friction"]["coefficient"].as_float()
    };
    assert_eq!(friction("--samples 1"), Some(HIDDEN[1]));
    assert_eq!(friction("--samples 1 --set sequence.friction.coefficient=0.4"), Some(0.4));
    let said = folder.fail("plan job.toml --set sensor.gelpad_friction_coefficient=11", 2);
    assert!(said.contains("gelpad_friction_coefficient"), "{said}");
}
