//! Samples whose contact is not solved: kept and counted, drawn again and listed, or the end of the run.

use crate::support::{Folder, JOB, assert_same_files, edited, json};

/// [`JOB`] with a solver that gives up early, so that some samples are not solved.
fn with_unsolved_samples(on_unhealthy: &str) -> Folder {
    let solver = "gelpad = { elastic = { resolution = \"full\", max_iterations = 3, tolerance_um = 0.5 } }\n";
    let job = edited(JOB, &[("samples = 8", "samples = 24")]);
    Folder::with_job(&format!("{solver}{job}on_unhealthy = \"{on_unhealthy}\"\n"))
}

fn labels(folder: &Folder) -> Vec<serde_json::Value> {
    folder.labels("out").into_values().collect()
}

fn stats(folder: &Folder) -> Vec<serde_json::Value> {
    folder.files("out/stats").keys().map(|name| json(folder, &format!("out/stats/{name}"))).collect()
}

fn sum(folder: &Folder, key: &str) -> u64 {
    stats(folder).iter().map(|stats| stats[key].as_u64().expect("a count")).sum()
}

#[test]
fn kept_samples_say_what_is_wrong_and_are_counted() {
    let folder = with_unsolved_samples("keep");
    let said = folder.succeed("generate job.toml --out out");
    let labels = labels(&folder);
    assert_eq!(labels.len(), 24);
    let ill: Vec<_> = labels.iter().filter(|label| label["health"]["healthy"] == false).collect();
    assert!(!ill.is_empty() && ill.len() < 24, "{}", ill.len());
    for label in &labels {
        let converged = label["numerics"]["converged"].as_bool().expect("known");
        let residual = label["numerics"]["residual_um"].as_f64().expect("known");
        assert_eq!(label["health"]["healthy"], converged);
        assert_eq!(converged, residual <= 0.5, "{residual}");
        let reason = label["health"]["reason"].as_str().expect("a text");
        assert_eq!(reason.is_empty(), converged, "{reason}");
        assert!(
            converged || reason.starts_with("the contact is not solved: ") && reason.ends_with(" after 3 iterations")
        );
        assert_eq!(label["attempt"], 0);
    }
    let count = ill.len() as u64;
    assert_eq!([sum(&folder, "unhealthy"), sum(&folder, "unconverged"), sum(&folder, "rejected")], [count, count, 0]);
    assert!(said.contains(&format!("contact not solved to the tolerance: {count} samples")), "{said}");
    assert!(said.contains(&format!("not healthy: {count} samples")), "{said}");
    folder.gelsim("verify out").assert().success();
}

#[test]
fn rejected_samples_are_drawn_again_and_listed_with_reason_seed_and_label() {
    let folder = with_unsolved_samples("reject");
    let said = folder.succeed("generate job.toml --out out --threads 2");
    let labels = labels(&folder);
    assert!(labels.iter().all(|label| label["health"]["healthy"] == true && label["numerics"]["converged"] == true));
    let attempts: u64 = labels.iter().map(|label| label["attempt"].as_u64().expect("a number")).sum();
    assert!(attempts > 0);
    assert_eq!([sum(&folder, "rejected"), sum(&folder, "unhealthy")], [attempts, 0]);
    assert!(said.contains(&format!("rejected and drawn again: {attempts} draws")), "{said}");
    for stats in stats(&folder) {
        let listed = stats["rejections"].as_array().expect("a list");
        assert_eq!(stats["rejected"].as_u64(), Some(listed.len() as u64));
        for rejection in listed {
            let (key, attempt) = (&rejection["key"], rejection["attempt"].as_u64().expect("a number"));
            assert_eq!((rejection["seed"].as_u64(), &rejection["label"]["key"]), (Some(7), key));
            assert_eq!(rejection["reason"], rejection["label"]["health"]["reason"]);
            let taken = labels.iter().find(|label| &label["key"] == key).expect("the sample");
            assert!(attempt < taken["attempt"].as_u64().expect("a number"));
            assert_ne!(taken["pose"], rejection["label"]["pose"], "drawn anew");
            assert_eq!(taken["split"], rejection["label"]["split"]);
        }
    }
    // What was drawn again can be drawn once more.
    let again = labels.iter().find(|label| label["attempt"].as_u64() > Some(0)).expect("one");
    folder.gelsim(&format!("reproduce out {}", again["key"].as_str().expect("a key"))).assert().success();
    // Nor do threads, shards and partitions matter.
    folder.succeed("generate job.toml --quiet --out parts --partition 1/3 --threads 1");
    folder.succeed("generate job.toml --quiet --out parts --partition 0/3 --threads 3");
    folder.succeed("generate job.toml --quiet --out parts --partition 2/3 --threads 2");
    assert_same_files(&folder.lasting_files("out"), &folder.lasting_files("parts"));
}

#[test]
fn a_run_that_wants_no_unhealthy_sample_stops_at_one_and_names_it() {
    let folder = with_unsolved_samples("fail");
    let said = folder.fail("generate job.toml --out out", 1);
    assert!(
        said.contains("sample 0000000") && said.contains("(seed 7, drawn 1 time) is not healthy: the contact"),
        "{said}"
    );
    assert!(said.contains("finished shards stay"), "{said}");
    assert!(!folder.path("out/dataset.json").exists());
}

#[test]
fn a_job_of_which_no_draw_is_healthy_ends_instead_of_drawing_for_ever() {
    let folder = with_unsolved_samples("reject");
    let said = folder.fail("generate job.toml --out out --set gelpad.elastic.max_iterations=1 --set indentation.depth_mm=1.0 --set indentation.no_contact=0.0", 1);
    assert!(said.contains("(seed 7, drawn 100 times) is not healthy: the contact is not solved"), "{said}");
}
