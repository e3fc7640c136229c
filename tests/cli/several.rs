//! `[scene]`: several objects in one press, as the command writes and refuses them.

use serde_json::Value;

use crate::support::{Folder, JOB, assert_same_files, edited};

/// [`JOB`] with up to three small objects in each press.
fn job() -> String {
    edited(
        JOB,
        &[
            ("[sensor]", "[scene]\nobjects_per_sample = [1, 3]\n\n[sensor]"),
            ("path = \"cube.obj\"", "path = \"cube.obj\"\nscale = [0.2, 0.5]"),
            ("path = \"cone.obj\"", "path = \"cone.obj\"\nscale = 0.3"),
            ("x_mm = { normal = { mean = 0.0, std = 1.0, min = -3.0, max = 3.0 } }", "x_mm = [-6.0, 6.0]"),
            ("y_mm = [-2.0, 2.0]", "y_mm = [-4.0, 4.0]"),
            ("\"contact\"]", "\"contact\", \"instance\"]"),
        ],
    )
}

#[test]
fn several_objects_are_the_same_however_the_work_is_divided() {
    let folder = Folder::with_job(&job());
    let said = folder.succeed("generate job.toml --out complete --threads 1");
    assert!(!said.contains("note") && !said.contains("place"), "{said}");
    folder.succeed("generate job.toml --quiet --out threads --threads 3");
    assert_same_files(&folder.lasting_files("complete"), &folder.lasting_files("threads"));
    for part in [2, 0, 1] {
        folder.succeed(&format!("generate job.toml --quiet --out parts --partition {part}/3"));
    }
    assert_same_files(&folder.lasting_files("complete"), &folder.lasting_files("parts"));
    folder.succeed("verify complete");
    folder.succeed("reproduce complete 5");
    folder.succeed("preview complete --out sheet.png");
    folder.succeed("preview job.toml --out sheet.png");
    folder.succeed("report complete --out report.html");
    folder.succeed("plan job.toml");
    folder.succeed("generate job.toml --quiet --out folder --set output.container=\"folder\"");
    folder.succeed("verify folder");
    let mut counts = [0; 4];
    for (key, members) in folder.samples("complete") {
        let label: Value = serde_json::from_slice(&members["json"]).expect("JSON");
        let objects = label["objects"].as_array().expect("a list");
        counts[objects.len()] += 1;
        assert_eq!(objects[0]["id"], label["object"]["id"], "{key}");
        assert_eq!(label["unplaced_objects"], 0);
    }
    assert!(counts[0] == 0 && counts[2] + counts[3] > 0, "{counts:?}");
}

#[test]
fn objects_that_find_no_place_are_left_out_and_said() {
    let large =
        edited(&job(), &[("scale = [0.2, 0.5]", "scale = 2.0"), ("scale = 0.3", "scale = 2.0"), ("[1, 3]", "3")]);
    let folder = Folder::with_job(&large);
    let said = folder.succeed("generate job.toml --out large");
    let labels = folder.samples("large").into_values().map(|members| {
        let label: Value = serde_json::from_slice(&members["json"]).expect("JSON");
        (
            label["objects"].as_array().expect("a list").len() as u64,
            label["unplaced_objects"].as_u64().expect("a count"),
        )
    });
    let left_out: u64 = labels
        .map(|(placed, left_out)| {
            assert_eq!(placed + left_out, 3);
            left_out
        })
        .sum();
    assert!(left_out > 8, "{left_out}");
    assert!(
        said.contains(&format!("left out for want of a place: {left_out} objects, see unplaced_objects")),
        "{said}"
    );
    let note = format!("of the 24 objects of the first 8 samples {left_out} find no place among the others");
    assert!(said.contains(&note), "{note}\n{said}");
    let refused = folder.fail("generate job.toml --out strict --strict", 2);
    assert!(refused.contains("find no place among the others"), "{refused}");
    folder.succeed("verify large");
    let stats: u64 = folder
        .files("large/stats")
        .values()
        .map(|text| serde_json::from_slice::<Value>(text).expect("JSON")["unplaced_objects"].as_u64().expect("a count"))
        .sum();
    assert_eq!(stats, left_out);
    let json = folder.succeed("generate job.toml --out json --log-format json");
    assert!(json.contains(&format!("\"unplaced_objects\":{left_out}")), "{json}");
}

#[test]
fn a_sequence_of_several_objects_is_refused_at_its_place() {
    let sequence = "[sequence]\n[[sequence.phase]]\nname = \"press\"\nduration_s = 0.2\ndepth_mm = 0.5\n\n[output]";
    let text =
        edited(&job(), &[("[output]", sequence), ("depth_mm = { log_uniform = [0.3, 1.2] }\nno_contact = 0.25\n", "")]);
    let said = Folder::with_job(&text).fail("plan job.toml", 2);
    assert!(said.contains("a sequence moves one object, and [scene] wants several"), "{said}");
}
