//! `generate --log-format json`: one object a line on standard error, whatever happens.

use serde_json::Value;

use crate::support::{Folder, JOB, edited};

fn events(said: &str) -> Vec<Value> {
    said.lines().map(|line| serde_json::from_str(line).unwrap_or_else(|error| panic!("{error}: {line}"))).collect()
}

fn names(events: &[Value]) -> Vec<&str> {
    events.iter().map(|event| event["event"].as_str().expect("every line says what it is")).collect()
}

#[test]
fn a_run_says_what_it_starts_and_what_it_did() {
    let folder = Folder::with_job(&edited(JOB, &[("no_contact = 0.25", "no_contact = 0.25\n# 80 %")]));
    folder.succeed("generate job.toml --out out --shards 0..1");
    let said = events(&folder.succeed("generate job.toml --out out --log-format json"));
    assert_eq!(names(&said), ["start", "done"]);
    let (start, done) = (&said[0], &said[1]);
    assert_eq!(start["generator"], format!("gelsim {}", env!("CARGO_PKG_VERSION")));
    assert_eq!(
        (&start["samples"], &start["shards"], &start["shards_there_already"]),
        (&5.into(), &3.into(), &1.into())
    );
    assert_eq!((&done["samples"], &done["shards"], &done["shards_there_already"]), (&5.into(), &3.into(), &1.into()));
    assert_eq!((&done["rejected"], &done["complete"], &done["out"]), (&0.into(), &true.into(), &"out".into()));
    assert_eq!((&done["samples_before"], &done["shards_made_again"]), (&Value::Null, &Value::Array(vec![])));
    let number = |key: &str| done[key].as_f64().unwrap_or_else(|| panic!("{key}"));
    assert!((number("samples_per_s") * number("seconds") - 5.0).abs() < 1e-9);
    let shards = ["train-000001", "val-000000", "test-000000"].map(|name| folder.path(&format!("out/data/{name}.tar")));
    let bytes: u64 = shards.iter().map(|path| std::fs::metadata(path).expect("a shard").len()).sum();
    assert_eq!(done["bytes"], bytes);
}

#[test]
fn mistakes_and_notes_are_lines_too_and_quiet_leaves_only_errors() {
    let folder = Folder::with_job(&edited(JOB, &[("{ log_uniform = [0.3, 1.2] }", "2.0")]));
    let said = events(&folder.succeed("generate job.toml --out out --log-format json"));
    assert_eq!(names(&said), ["note", "start", "done"]);
    assert!(said[0]["message"].as_str().expect("a text").contains("linear elasticity"));
    assert_eq!(folder.succeed("generate job.toml --out out --log-format json --quiet"), "");

    for flags in ["", " --quiet"] {
        let job = "generate job.toml --out out --log-format json --set pose.z=1 --set indentation.depth_mm=-1";
        let said = events(&folder.fail(&format!("{job}{flags}"), 2));
        assert_eq!(names(&said), ["error"]);
        assert_eq!(said[0]["status"], 2);
        let message = said[0]["message"].as_str().expect("a text");
        assert!(message.contains("pose.z") && message.contains("indentation.depth_mm"), "{message}");
        assert!(!message.contains('\u{1b}'), "no colours in a log");
    }
}

#[test]
fn the_last_line_has_samples_rejected_seconds_speed_and_bytes() {
    let folder = Folder::with_job(JOB);
    let said = folder.succeed("generate job.toml --out out");
    let last = said.lines().last().expect("a line");
    assert!(last.starts_with("8 samples in 4 shards, 7 of 8 in contact, 0 rejected, "), "{last}");
    for part in [" KiB, ", " s (", " samples/s) -> out"] {
        assert!(last.contains(part), "{part}: {last}");
    }
}
