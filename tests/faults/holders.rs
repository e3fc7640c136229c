//! Several processes in one folder: who holds a shard is named, nothing is written twice, a dead holder holds nothing.

use std::fs;

use gelsim::files::fail_point::{Step, VARIABLE};

use super::rig::{Held, assert_like_whole, assert_whole_or_absent, many_shards, said, with_whole};
use crate::support::{Folder, JOB};

const PARTIAL: &str = "out/data/.train-000000.tar.partial";

/// A run that has written its first shard, and holds it, but has not given it its name.
fn holder(folder: &Folder) -> Held {
    let held = Held::at(folder, "generate job.toml --quiet --out out --threads 1", Step::ShardWritten.name());
    held.unwrap_or_else(|end| panic!("{end:?}"))
}

#[test]
fn a_shard_has_one_writer_who_is_named_and_whose_death_frees_it() {
    let folder = with_whole(JOB);
    let holder = holder(&folder);
    let named = format!("train-000000 is being written by process {} on ", holder.id());
    let text = folder.fail("generate job.toml --out out --shards 0..1", 1);
    assert!(text.contains(&named), "{text}");
    // Nor can its dataset be replaced under its hands.
    let before = fs::read(folder.path(PARTIAL)).expect("a partial file");
    let text = folder.fail("generate job.toml --out out --overwrite", 2);
    assert!(text.contains("out cannot be replaced") && text.contains(&named), "{text}");
    // Others do the rest, and do not sweep what it needs.
    let text = folder.fail("generate job.toml --out out", 1);
    assert!(text.contains(&named) && text.contains("all other shards are done"), "{text}");
    assert!(folder.path("out/data/val-000000.tar").exists() && folder.path("out/data/test-000000.tar").exists());
    assert!(before == fs::read(folder.path(PARTIAL)).expect("a partial file"));
    drop(holder);
    assert!(folder.path(PARTIAL).exists() && folder.path("out/data/.train-000000.lock").exists());
    folder.succeed("generate job.toml --quiet --out out");
    assert_like_whole(&folder, "out");
}

#[test]
fn a_writer_whose_partial_file_was_replaced_does_not_bring_it_to_its_final_name() {
    let folder = with_whole(JOB);
    let run = holder(&folder);
    fs::remove_file(folder.path(PARTIAL)).expect("a partial file");
    folder.write(PARTIAL, "half a shard");
    assert_eq!(run.go_on().status.code(), Some(1));
    assert!(!folder.path("out/data/train-000000.tar").exists());
    folder.succeed("generate job.toml --quiet --out out");
    assert_like_whole(&folder, "out");
}

#[test]
fn a_folder_that_is_removed_under_a_run_is_an_error_in_words() {
    let folder = with_whole(JOB);
    // All but the last two: the last shard is done then, and the dataset is described.
    for step in [
        Step::FoldersMade,
        Step::DatasetLocked,
        Step::FileBegun,
        Step::FileWritten,
        Step::FileRenamed,
        Step::ShardLocked,
        Step::ShardBegun,
        Step::SampleAppended,
        Step::ShardWritten,
        Step::ShardSynced,
        Step::OldStatsRemoved,
        Step::ShardRenamed,
        Step::ShardInPlace,
        Step::ShardDone,
        Step::DatasetChecked,
    ] {
        let held = Held::at(&folder, "generate job.toml --quiet --out out --threads 1", step.name());
        let held = held.unwrap_or_else(|end| panic!("{step:?}: {end:?}"));
        fs::remove_dir_all(folder.path("out")).expect("a folder");
        let output = held.go_on();
        let text = said(&output);
        println!("{step:?}: {text}");
        assert_eq!(output.status.code(), Some(1), "{step:?}: {text}");
        let error = text.lines().find(|line| !line.starts_with(VARIABLE)).unwrap_or_default();
        assert!(error.starts_with("error: out") && text.contains("the same command goes on"), "{step:?}: {text}");
        folder.succeed("generate job.toml --quiet --out out");
        assert_like_whole(&folder, "out");
        fs::remove_dir_all(folder.path("out")).expect("a folder");
    }
}

#[test]
fn eight_processes_share_a_folder_while_some_are_killed_and_started_again() {
    const PARTS: u64 = 8;
    let folder = with_whole(&many_shards());
    let killed: usize = std::thread::scope(|scope| {
        let parts: Vec<_> = (0..PARTS)
            .map(|part| {
                let folder = &folder;
                scope.spawn(move || {
                    let arguments = format!("generate job.toml --out out --threads 1 --partition {part}/{PARTS}");
                    // Odd parts are killed three times.
                    let steps = [Step::SampleAppended, Step::ShardRenamed, Step::FileWritten];
                    let killed = if part % 2 == 1 { steps.as_slice() } else { &[] };
                    for step in killed {
                        let held = Held::at(folder, &arguments, step.name());
                        held.unwrap_or_else(|end| panic!("{step:?}: {end:?}")).kill();
                    }
                    let output = folder.spawn(&arguments).wait_with_output().expect("it ends");
                    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
                    killed.len()
                })
            })
            .collect();
        parts.into_iter().map(|part| part.join().expect("a part")).sum()
    });
    println!("{PARTS} processes shared a folder, {killed} kills among them");
    assert_eq!(killed, 12);
    assert_whole_or_absent(&folder, "out");
    // Who finished last described the dataset; what a kill left after that, this sweeps.
    assert!(folder.path("out/dataset.json").exists());
    folder.succeed("generate job.toml --quiet --out out");
    assert_like_whole(&folder, "out");
}
