//! Several processes in one folder: who holds a shard is named, nothing is written twice, a dead holder holds nothing.

use std::fs;

use gelsim_files::fail_point::{FAIL_POINT_VARIABLE, Step};

use super::rig::{
    Held, assert_complete_or_absent, assert_like_undisturbed, many_shards, messages_of, with_undisturbed,
};
use crate::support::{Folder, JOB};

const PARTIAL: &str = "out/data/.train-000000.tar.partial";

/// A run that has written its first shard, and holds it, but has not given it its name.
fn holder(folder: &Folder) -> Held {
    let held = Held::at(folder, "generate job.toml --quiet --out out --threads 1", Step::ShardWritten.name());
    held.unwrap_or_else(|end| panic!("{end:?}"))
}

#[test]
fn a_shard_has_one_writer_who_is_named_and_whose_death_frees_it() {
    let folder = with_undisturbed(JOB);
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
    assert_like_undisturbed(&folder, "out");
}

#[test]
fn a_writer_whose_partial_file_was_replaced_does_not_bring_it_to_its_final_name() {
    let folder = with_undisturbed(JOB);
    let run = holder(&folder);
    fs::remove_file(folder.path(PARTIAL)).expect("a partial file");
    folder.write(PARTIAL, "half a shard");
    assert_eq!(run.go_on().status.code(), Some(1));
    assert!(!folder.path("out/data/train-000000.tar").exists());
    folder.succeed("generate job.toml --quiet --out out");
    assert_like_undisturbed(&folder, "out");
}

#[test]
fn a_folder_that_is_removed_under_a_run_is_an_error_in_words() {
    let folder = with_undisturbed(JOB);
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
        let text = messages_of(&output);
        println!("{step:?}: {text}");
        assert_eq!(output.status.code(), Some(1), "{step:?}: {text}");
        let error = text.lines().find(|line| !line.starts_with(FAIL_POINT_VARIABLE)).unwrap_or_default();
        assert!(error.starts_with("error: out") && text.contains("the same command goes on"), "{step:?}: {text}");
        folder.succeed("generate job.toml --quiet --out out");
        assert_like_undisturbed(&folder, "out");
        fs::remove_dir_all(folder.path("out")).expect("a folder");
    }
}

#[test]
fn eight_processes_share_a_folder_while_some_are_killed_and_started_again() {
    const PARTS: u64 = 8;
    let folder = with_undisturbed(&many_shards());
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
    assert_complete_or_absent(&folder, "out");
    // Who finished last described the dataset; what a kill left after that, this sweeps.
    assert!(folder.path("out/dataset.json").exists());
    folder.succeed("generate job.toml --quiet --out out");
    assert_like_undisturbed(&folder, "out");
}

/// Two jobs that begin in one folder at the same moment: one wins, the other is refused by name of what differs, and what is
/// there in the end is the winner's and complete.
#[test]
fn of_two_jobs_in_one_folder_one_wins() {
    let mut winners = [0, 0];
    for round in 0..24 {
        let folder = Folder::with_job(JOB);
        let both = ["7", "8"].map(|seed| folder.spawn(&format!("generate job.toml --quiet --out out --seed {seed}")));
        let ended = both.map(|child| child.wait_with_output().expect("it ends"));
        let won: Vec<usize> = (0..2).filter(|k| ended[*k].status.success()).collect();
        let said = ended.each_ref().map(|output| String::from_utf8_lossy(&output.stderr).into_owned());
        assert_eq!(won.len(), 1, "round {round}: {said:?}");
        let refused = &said[1 - won[0]];
        assert_eq!(ended[1 - won[0]].status.code(), Some(2), "{refused}");
        assert!(refused.contains("another job: dataset.seed is "), "{refused}");
        folder.succeed("verify out");
        assert!(folder.labels("out").values().all(|label| label["seed"] == 7 + won[0]));
        winners[won[0]] += 1;
    }
    println!("{winners:?} wins of two jobs that began at once");
}

/// Two runs that replace a dataset at the same moment: at least one ends well, and one dataset is there, complete.
#[test]
fn of_two_runs_that_replace_a_dataset_one_dataset_is_left() {
    let folder = Folder::with_job(JOB);
    let mut both_ended = 0;
    for round in 0..24 {
        let both = ["7", "8"]
            .map(|seed| folder.spawn(&format!("generate job.toml --quiet --out out --overwrite --seed {seed}")));
        let ended = both.map(|child| child.wait_with_output().expect("it ends"));
        let said = ended.each_ref().map(|output| String::from_utf8_lossy(&output.stderr).into_owned());
        let won = ended.iter().filter(|output| output.status.success()).count();
        assert!(won >= 1, "round {round}: {said:?}");
        both_ended += usize::from(won == 2);
        folder.succeed("verify out");
        let seeds: std::collections::BTreeSet<u64> =
            folder.labels("out").values().map(|label| label["seed"].as_u64().expect("a seed")).collect();
        assert_eq!(seeds.len(), 1, "round {round}: {said:?}");
    }
    println!("{both_ended} times one after the other");
}
