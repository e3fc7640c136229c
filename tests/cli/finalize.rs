//! `gelsim finalize`: describes a dataset once all its parts are there, and names what is not.

use std::fs;

use crate::support::{Folder, JOB, assert_same_files, edited};

/// Jobs of several kinds: what they record must be enough to describe the dataset without its meshes.
fn jobs() -> Vec<String> {
    let twins = edited(JOB, &[("path = \"cone.obj\"", "path = \"twin/cube.obj\"")]);
    let many = edited(JOB, &[("resolution_px = [48, 36]", "preset = \"digit\"\nresolution_px = [48, 64]")]);
    let chosen = format!("fidelity = {{ max_error_um = 20.0 }}\n{JOB}\n[markers]\npitch_mm = 2.0\n");
    vec![JOB.to_owned(), twins, many, chosen]
}

fn without_descriptions(folder: &Folder) {
    for name in ["dataset.json", "wids.json", "README.md"] {
        fs::remove_file(folder.path(&format!("out/{name}"))).expect("it was there");
    }
}

#[test]
fn what_generate_writes_at_its_end_is_written_again_from_the_folder_alone() {
    for job in jobs() {
        let folder = Folder::with_job(&job);
        fs::create_dir(folder.path("twin")).expect("a folder");
        fs::copy(folder.path("cone.obj"), folder.path("twin/cube.obj")).expect("a mesh");
        folder.succeed("generate job.toml --out out");
        let before = folder.files("out");
        for mesh in ["cube.obj", "cone.obj", "twin/cube.obj"] {
            fs::remove_file(folder.path(mesh)).expect("a mesh");
        }
        for _ in 0..2 {
            without_descriptions(&folder);
            let assert = folder.gelsim("finalize out").assert().success();
            let said = String::from_utf8_lossy(&assert.get_output().stdout).into_owned();
            assert!(said.starts_with("out: 8 samples in 4 shards, ") && said.ends_with(": finalized\n"), "{said}");
            assert_same_files(&before, &folder.files("out"));
        }
        let time = || fs::metadata(folder.path("out/dataset.json")).and_then(|meta| meta.modified()).expect("a time");
        let written = time();
        folder.succeed("finalize out --quick");
        assert_eq!(written, time(), "what is the same is not written again");
    }
}

#[test]
fn missing_and_broken_shards_are_named_and_nothing_is_described() {
    let folder = Folder::with_job(JOB);
    folder.succeed("generate job.toml --out out");
    without_descriptions(&folder);
    let complete = fs::read(folder.path("out/data/test-000000.tar")).expect("a shard");
    let mut flipped = complete.clone();
    flipped[700] ^= 1;
    folder.write("out/data/test-000000.tar", &flipped);
    fs::remove_file(folder.path("out/data/train-000001.tar")).expect("a shard");
    fs::remove_file(folder.path("out/stats/val-000000.json")).expect("stats");
    folder.write("out/data/.train-000001.lock", "process 77 on node3\n");

    let refused = |flags: &str| {
        let assert = folder.gelsim(&format!("finalize out{flags}")).assert().code(1);
        assert!(!folder.path("out/dataset.json").exists());
        String::from_utf8_lossy(&assert.get_output().stdout).into_owned()
    };
    let said = refused("");
    let lines: Vec<&str> = said.lines().collect();
    assert_eq!(lines.len(), 6, "{said}");
    assert_eq!(lines[0], "data/train-000001.tar: is missing; process 77 on node3 writes it, or was stopped");
    assert_eq!(lines[1], "stats/val-000000.json: is missing");
    assert!(lines[2].starts_with("data/test-000000.tar: is not what was written: it has "), "{said}");
    assert_eq!(lines[3], "out: 8 samples in 4 shards: not finalized");
    assert_eq!(lines[4..], ["fix it with", "  gelsim generate out/job.toml --out out"]);
    // A flipped byte has no size.
    assert!(!refused(" --quick").contains("test-000000"));
    folder.write("out/data/test-000000.tar", &complete[..512]);
    assert!(refused(" --quick").contains("data/test-000000.tar: is not what was written: it has 512 bytes, "));

    folder.succeed("generate job.toml --out out");
    folder.succeed("finalize out");
    folder.succeed("verify out");
}

#[test]
fn folders_that_are_no_dataset_of_this_version_are_refused() {
    let folder = Folder::with_job(JOB);
    assert!(folder.fail("finalize nowhere", 2).contains("nowhere is no dataset"));
    folder.succeed("generate job.toml --out out");
    without_descriptions(&folder);
    let job = folder.read("out/job.toml");
    folder.write("out/job.toml", job.replacen(concat!(env!("CARGO_PKG_VERSION"), "."), "0.0.9.", 1));
    assert!(folder.fail("finalize out", 2).contains("out was made by gelsim 0.0.9, this is "));
    folder.write("out/job.toml", job.replacen("seed = 7", "seed = 8", 1));
    let assert = folder.gelsim("finalize out").assert().code(1);
    let said = String::from_utf8_lossy(&assert.get_output().stdout).into_owned();
    assert!(said.starts_with("job.toml: is not what was written, and not the job of its shards\n"), "{said}");
    // Followed, it is the job as it was written.
    assert!(said.ends_with("fix it with\n  gelsim generate JOB.toml --out out\n"), "{said}");
    folder.succeed("generate job.toml --out out");
    folder.succeed("finalize out");
}
