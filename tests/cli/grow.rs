//! A dataset that is made larger later: full shards stay as they are, and in the end it is the one that was asked for at
//! once.

use std::fs;

use crate::support::{Folder, JOB, assert_same_files, edited, json};

/// What `of` says of the file `name`.
fn metadata_of<T>(folder: &Folder, name: &str, of: impl Fn(&fs::Metadata) -> T) -> T {
    of(&fs::metadata(folder.path(name)).unwrap_or_else(|error| panic!("{name}: {error}")))
}

#[test]
fn a_raised_number_of_samples_extends_the_dataset_and_leaves_full_shards_alone() {
    use std::os::unix::fs::MetadataExt;

    for split_by in ["sample", "object"] {
        let job = edited(JOB, &[("seed = 7", &format!("seed = 7\nsplit_by = \"{split_by}\""))]);
        let job = if split_by == "object" { edited(&job, &[("val = 0.25, test = 0.25", "test = 0.5")]) } else { job };
        let folder = Folder::with_job(&job);
        folder.succeed("generate job.toml --samples 30 --out at-once");
        folder.succeed("generate job.toml --out grown");
        let full = ["grown/data/train-000000.tar", "grown/stats/train-000000.json"];
        let before = full.map(|name| metadata_of(&folder, name, |meta| (meta.ino(), meta.modified().expect("a time"))));

        let said = folder.succeed("generate job.toml --samples 13 --out grown");
        assert!(said.contains("; the dataset had 8 samples"), "{said}");
        let said = folder.succeed("generate job.toml --samples 30 --out grown");
        assert!(said.contains("; the dataset had 13 samples"), "{said}");
        let after = full.map(|name| metadata_of(&folder, name, |meta| (meta.ino(), meta.modified().expect("a time"))));
        assert_eq!(before, after, "a full shard is not touched");
        assert_same_files(&folder.lasting_files("at-once"), &folder.lasting_files("grown"));
        folder.succeed("verify grown");
        let said = folder.succeed("generate job.toml --samples 30 --out grown");
        assert!(said.starts_with("0 samples") && !said.contains("the dataset had"), "{said}");
    }
}

#[test]
fn parts_that_grow_a_dataset_together_end_as_one_run() {
    let folder = Folder::with_job(JOB);
    folder.succeed("generate job.toml --samples 30 --out at-once");
    folder.succeed("generate job.toml --out grown");
    folder.succeed("report grown");
    folder.succeed("generate job.toml --samples 30 --out grown --partition 1/3");
    // While it grows nothing says that it is complete.
    for name in ["dataset.json", "wids.json", "README.md", "report.html"] {
        assert!(!folder.path(&format!("grown/{name}")).exists(), "{name}");
    }
    folder.gelsim("finalize grown").assert().code(1);
    folder.succeed("generate job.toml --samples 30 --out grown --partition 0/3");
    folder.succeed("generate job.toml --samples 30 --out grown --partition 2/3");
    assert_same_files(&folder.lasting_files("at-once"), &folder.lasting_files("grown"));
}

#[test]
fn a_dataset_does_not_shrink_and_grows_in_nothing_else() {
    let folder = Folder::with_job(JOB);
    folder.succeed("generate job.toml --out small");
    let before = folder.files("small");
    let said = folder.fail("generate job.toml --samples 7 --out small", 2);
    assert!(said.contains("dataset.samples is 8 there and 7 here"), "{said}");
    for other in ["dataset.samples_per_shard=4", "dataset.seed=8", "pose.x_mm=0.5"] {
        let said = folder.fail(&format!("generate job.toml --samples 30 --out small --set {other}"), 2);
        assert!(said.contains(other.split('=').next().expect("a key")), "{said}");
        assert!(!said.contains("dataset.samples is"), "{said}");
    }
    assert_same_files(&before, &folder.files("small"));
    assert_eq!(json(&folder, "small/dataset.json")["samples"], 8);
}
