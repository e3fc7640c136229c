//! The same bytes whatever the thread count, the division of the work, and what stands beside a sample.

use crate::support::{Folder, JOB, assert_same_files, edited};

#[test]
fn tars_are_the_same_for_every_number_of_threads() {
    let folder = Folder::with_job(&edited(JOB, &[("samples_per_shard = 3", "samples_per_shard = 40")]));
    // Two blocks of a shard, so that threads also share one.
    folder.succeed("generate job.toml --quiet --samples 60 --out one --threads 1");
    for threads in [2, 5] {
        folder.succeed(&format!("generate job.toml --quiet --samples 60 --out many-{threads} --threads {threads}"));
        assert_same_files(&folder.lasting_files("one"), &folder.lasting_files(&format!("many-{threads}")));
    }
}

#[test]
fn shard_ranges_in_separate_runs_make_the_dataset_of_a_single_run() {
    let folder = Folder::with_job(JOB);
    folder.succeed("generate job.toml --quiet --out complete");
    let first = folder.succeed("generate job.toml --out parts --shards 1..3");
    assert!(first.contains("the dataset is not complete yet"), "{first}");
    assert!(!folder.path("parts/dataset.json").exists());
    let names: Vec<String> = folder.files("parts/data").into_keys().collect();
    assert_eq!(names, ["train-000001.tar", "val-000000.tar"], "shards are counted over train, val, test");
    folder.succeed("generate job.toml --quiet --out parts --shards 3..4");
    let last = folder.succeed("generate job.toml --out parts --shards 0..1");
    assert!(!last.contains("not complete"), "{last}");
    assert_same_files(&folder.lasting_files("complete"), &folder.lasting_files("parts"));
}

#[test]
fn partitions_in_any_order_make_the_dataset_of_a_single_run() {
    let folder = Folder::with_job(JOB);
    folder.succeed("generate job.toml --quiet --out complete");
    for count in [2, 3, 7] {
        for part in (0..count).rev() {
            folder.succeed(&format!("generate job.toml --quiet --out parts-{count} --partition {part}/{count}"));
        }
        assert_same_files(&folder.lasting_files("complete"), &folder.lasting_files(&format!("parts-{count}")));
    }
}

#[test]
fn a_part_that_overwrites_leaves_what_other_parts_of_the_job_have_made() {
    let folder = Folder::with_job(JOB);
    folder.succeed("generate job.toml --quiet --out complete");
    // Another job was there.
    folder.succeed("generate job.toml --quiet --out parts --seed 99");
    for part in 0..2 {
        folder.succeed(&format!("generate job.toml --quiet --out parts --partition {part}/2 --overwrite"));
    }
    assert_same_files(&folder.lasting_files("complete"), &folder.lasting_files("parts"));
}

#[test]
fn partitions_at_the_same_time_make_the_dataset_of_a_single_run() {
    let folder = Folder::with_job(JOB);
    folder.succeed("generate job.toml --quiet --out complete");
    let parts: Vec<_> =
        (0..4).map(|part| folder.spawn(&format!("generate job.toml --out parts --partition {part}/4"))).collect();
    for part in parts {
        let output = part.wait_with_output().expect("it ends");
        assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    }
    assert_same_files(&folder.lasting_files("complete"), &folder.lasting_files("parts"));
}

#[test]
fn a_sample_does_not_depend_on_how_many_there_are() {
    let folder = Folder::with_job(JOB);
    folder.succeed("generate job.toml --quiet --out few --samples 5");
    folder.succeed("generate job.toml --quiet --out many --samples 31");
    let (few, many) = (folder.samples("few"), folder.samples("many"));
    assert_eq!(few.len(), 5);
    for (key, members) in &few {
        assert_same_files(members, &many[key]);
    }
}

#[test]
fn a_sample_does_not_depend_on_the_size_of_the_shards() {
    let folder = Folder::with_job(JOB);
    folder.succeed("generate job.toml --quiet --out small");
    folder.succeed("generate job.toml --quiet --out large --set dataset.samples_per_shard=100");
    assert_ne!(folder.files("small/data").len(), folder.files("large/data").len());
    assert_eq!(folder.samples("small"), folder.samples("large"));
}

#[test]
fn a_sample_depends_on_the_seed() {
    let folder = Folder::with_job(JOB);
    folder.succeed("generate job.toml --quiet --out one --seed 1");
    folder.succeed("generate job.toml --quiet --out two --seed 2");
    let (one, two) = (folder.samples("one"), folder.samples("two"));
    let same = one.keys().filter(|key| one[*key]["depth.exr"] == two[*key]["depth.exr"]).count();
    // Samples without contact have the same empty depth map.
    assert!(same < one.len() / 2, "{same} of {} are the same", one.len());
}

#[test]
fn a_quantity_that_is_drawn_otherwise_moves_no_other_quantity() {
    let folder = Folder::with_job(JOB);
    folder.succeed("generate job.toml --quiet --out before");
    let before = folder.labels("before");
    let untouched = |label: &serde_json::Value, but: &str| {
        let pose = &label["pose"];
        let all = [
            ("object", label["object"].clone()),
            ("split", label["split"].clone()),
            ("yaw", pose["yaw_deg"].clone()),
            ("tilt", pose["tilt_deg"].clone()),
            ("tilt azimuth", pose["tilt_azimuth_deg"].clone()),
            ("depth", label["indentation_depth_mm"].clone()),
        ];
        all.into_iter().filter(|(name, _)| *name != but).collect::<Vec<_>>()
    };
    for (number, (change, moved)) in [
        ("pose.x_mm=[-1.0,1.0]", "x"),
        ("pose.x_mm=0.5", "x"),
        ("pose.yaw_deg={normal={mean=10.0,std=5.0}}", "yaw"),
        ("pose.tilt_deg=3.0", "tilt"),
        ("indentation.depth_mm=[0.1,0.2]", "depth"),
        ("output.layers=[]", "nothing"),
    ]
    .into_iter()
    .enumerate()
    {
        let change = change.replace("std=5.0}", "std=5.0,min=-90.0,max=90.0}");
        folder.succeed(&format!("generate job.toml --quiet --out after-{number} --set {change}"));
        let after = folder.labels(&format!("after-{number}"));
        for (key, label) in &before {
            assert_eq!(untouched(label, moved), untouched(&after[key], moved), "{change}, sample {key}");
        }
        if moved != "nothing" {
            assert_ne!(before, after, "{change} must change something");
        }
    }
}
