//! SIGKILL at every step of a dataset's life, when it is begun, repaired, replaced or made larger: the same command makes
//! the bytes of an undisturbed run.
//!
//! A run waits at the step that `gelsim_files::fail_point` names, and is killed there: the first time that one of three
//! threads gets to it, and once more, alone, at a shard or file in the middle.

use std::fs;

use gelsim_files::fail_point::{FAIL_POINT_VARIABLE, Step};

use super::rig::{
    Held, assert_complete_or_absent, assert_like_undisturbed, in_folders, in_sequences, many_shards, messages_of,
    shell, with_undisturbed,
};
use crate::support::{Folder, JOB, edited};

const RUN: &str = "generate job.toml --quiet --out killed --threads 3";

/// What a run finds in its folder.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Before {
    Nothing,
    /// One shard broken, one gone, one without its stats.
    Damaged,
    /// Another job's dataset, which the run replaces.
    Another,
    /// A smaller dataset of the same job.
    Smaller,
}

/// The steps, a module of tests each.
macro_rules! steps {
    ($($test:ident: $step:ident,)*) => {
        /// The steps that a test here kills at.
        const STEPS: &[Step] = &[$(Step::$step),*];

        $(mod $test {
            #[test]
            fn of_tars() {
                super::killed(super::Step::$step, false);
            }

            #[test]
            fn of_folders() {
                super::killed(super::Step::$step, true);
            }
        })*
    };
}

steps! {
    old_shard_removed: OldShardRemoved,
    old_folder_removed: OldFolderRemoved,
    old_file_removed: OldFileRemoved,
    folders_made: FoldersMade,
    dataset_locked: DatasetLocked,
    file_begun: FileBegun,
    file_written: FileWritten,
    file_renamed: FileRenamed,
    shard_locked: ShardLocked,
    shard_begun: ShardBegun,
    sample_appended: SampleAppended,
    shard_written: ShardWritten,
    shard_synced: ShardSynced,
    old_stats_removed: OldStatsRemoved,
    old_shard_aside: OldShardAside,
    shard_renamed: ShardRenamed,
    shard_in_place: ShardInPlace,
    shard_done: ShardDone,
    dataset_checked: DatasetChecked,
    dataset_swept: DatasetSwept,
    dataset_described: DatasetDescribed,
}

#[test]
fn the_steps_are_those_of_the_program() {
    assert_eq!(STEPS, Step::ALL);
}

/// Shards or files at which a run is to be killed at a step, too.
fn middles(step: Step, before: Before, folders: bool) -> &'static [&'static str] {
    match step {
        Step::FileBegun | Step::FileWritten | Step::FileRenamed => match before {
            Before::Nothing | Before::Another if folders => {
                &["job.toml", "train-000001.json", "dataset.json", "README.md"]
            }
            Before::Nothing | Before::Another => {
                &["job.toml", "train-000001.json", "dataset.json", "README.md", "wids.json"]
            }
            // What describes the dataset is still right.
            Before::Damaged => &["train-000001.json"],
            Before::Smaller => &["job.toml", "train-000001.json", "README.md"],
        },
        Step::OldFileRemoved if before == Before::Another => &["README.md", "job.toml"],
        Step::OldFileRemoved if before == Before::Smaller => &["README.md"],
        Step::OldShardRemoved => &["train-000001", "train-000001.json"],
        Step::OldFolderRemoved => &["stats"],
        Step::ShardLocked
        | Step::ShardBegun
        | Step::SampleAppended
        | Step::ShardWritten
        | Step::ShardSynced
        | Step::OldStatsRemoved
        | Step::OldShardAside
        | Step::ShardRenamed
        | Step::ShardInPlace
        | Step::ShardDone => &["train-000001"],
        Step::OldFileRemoved
        | Step::FoldersMade
        | Step::DatasetLocked
        | Step::DatasetChecked
        | Step::DatasetSwept
        | Step::DatasetDescribed => &[],
    }
}

/// Whether a run gets to a step at all.
fn gets_to(step: Step, before: Before, folders: bool) -> bool {
    match step {
        Step::OldShardRemoved | Step::OldFolderRemoved => before == Before::Another,
        // A run that begins a dataset looks for old files, too.
        Step::OldFileRemoved => before != Before::Damaged,
        Step::OldShardAside => folders,
        _ => true,
    }
}

/// A sequence is appended as a whole: what differs from presses lies between the steps at which its shard is written.
#[test]
fn sequences_at_the_steps_of_a_shard() {
    for step in [Step::ShardBegun, Step::SampleAppended, Step::ShardWritten, Step::ShardRenamed] {
        killed_in(&in_sequences(JOB), step, false);
    }
}

fn killed(step: Step, folders: bool) {
    let job = if folders { in_folders(JOB) } else { JOB.to_owned() };
    killed_in(&job, step, folders);
}

fn killed_in(job: &str, step: Step, folders: bool) {
    let folder = with_undisturbed(job);
    folder.write("smaller.toml", edited(job, &[("samples = 8", "samples = 5")]));
    let mut kills = 0;
    for before in [Before::Nothing, Before::Damaged, Before::Another, Before::Smaller] {
        if !gets_to(step, before, folders) {
            prepare(&folder, before, folders);
            assert!(Held::at(&folder, &run_on(before), step.name()).is_err(), "{before:?}: it got there");
            fs::remove_dir_all(folder.path("killed")).expect("a folder");
            continue;
        }
        let middles = middles(step, before, folders);
        let steps = middles.iter().map(|of| (1, format!("{}: {of}", step.name())));
        for (threads, at) in [(3, step.name().to_owned())].into_iter().chain(steps) {
            println!("{before:?}, {at}");
            prepare(&folder, before, folders);
            let run = run_on(before).replace("--threads 3", &format!("--threads {threads}"));
            let held = Held::at(&folder, &run, &at)
                .unwrap_or_else(|end| panic!("it did not get there: {}", messages_of(&end)));
            if threads == 1 && before == Before::Nothing {
                assert_stands(&folder, step, at.split(": ").nth(1).unwrap_or_default());
            }
            held.kill();
            kills += 1;
            // The run that goes on is killed at the same step if it gets there again.
            if before == Before::Nothing {
                assert_complete_or_absent(&folder, "killed");
                if let Ok(held) = Held::at(&folder, &run, step.name()) {
                    held.kill();
                    kills += 1;
                    assert_complete_or_absent(&folder, "killed");
                }
            }
            finish(&folder, before);
            assert_like_undisturbed(&folder, "killed");
            fs::remove_dir_all(folder.path("killed")).expect("a folder");
        }
    }
    println!("{kills} runs killed");
}

fn run_on(before: Before) -> String {
    if before == Before::Another { format!("{RUN} --overwrite") } else { RUN.to_owned() }
}

/// Makes `killed` what a run is to find.
fn prepare(folder: &Folder, before: Before, folders: bool) {
    let damage = |shard: &str| folder.path(&format!("killed/data/{shard}"));
    match before {
        Before::Nothing => {}
        Before::Damaged if folders => {
            folder.succeed(RUN);
            fs::write(damage("train-000001/metadata.jsonl"), "{}").expect("a file");
            fs::remove_dir_all(damage("val-000000")).expect("a folder");
        }
        Before::Damaged => {
            folder.succeed(RUN);
            fs::write(damage("train-000001.tar"), "half a tar").expect("a file");
            fs::remove_file(damage("val-000000.tar")).expect("a file");
        }
        Before::Another => drop(folder.succeed("generate job.toml --quiet --out killed --seed 8")),
        Before::Smaller => drop(folder.succeed("generate smaller.toml --quiet --out killed")),
    }
    if before == Before::Damaged {
        fs::remove_file(folder.path("killed/stats/test-000000.json")).expect("a file");
    }
}

/// What the kill left becomes the dataset. Of one that was being replaced either the old job stands there, and is refused
/// as at first, or nothing is left of it.
fn finish(folder: &Folder, before: Before) {
    let there = fs::read_to_string(folder.path("killed/job.toml")).unwrap_or_default();
    if before == Before::Another && there.contains("seed = 8") {
        let text = folder.fail(RUN, 2);
        assert!(text.contains("dataset.seed is 8 there and 7 here"), "{text}");
        folder.succeed(&run_on(before));
    } else {
        folder.succeed(RUN);
    }
}

/// What is there of the shard or file `of` at a step of a run that began with nothing.
fn assert_stands(folder: &Folder, step: Step, of: &str) {
    let there = |name: &str| folder.path(&format!("killed/{name}")).exists();
    let shard = |hidden: &str, end: &str| ["", ".tar"].iter().any(|tar| there(&format!("data/{hidden}{of}{tar}{end}")));
    let of_shard = || (shard(".", ".lock"), shard(".", ".partial"), shard("", ""), there(&format!("stats/{of}.json")));
    match step {
        Step::FileBegun | Step::FileWritten => assert!(!there(of) && !there(&format!("stats/{of}"))),
        Step::FileRenamed => assert!(there(of) || there(&format!("stats/{of}"))),
        Step::ShardLocked => assert_eq!(of_shard(), (true, false, false, false)),
        Step::ShardBegun
        | Step::SampleAppended
        | Step::ShardWritten
        | Step::ShardSynced
        | Step::OldStatsRemoved
        | Step::OldShardAside => assert_eq!(of_shard(), (true, true, false, false)),
        Step::ShardRenamed | Step::ShardInPlace => assert_eq!(of_shard(), (true, false, true, false)),
        Step::ShardDone => assert_eq!(of_shard(), (false, false, true, true)),
        _ => panic!("{step:?} is of no shard or file"),
    }
}

/// A variable that was left in the environment.
#[test]
fn where_nobody_answers_a_run_says_the_step_and_goes_on() {
    let folder = with_undisturbed(JOB);
    for (at, met) in [("shard renamed", 4), ("shard renamed: val-000000", 1), ("shard", 0), ("1", 0)] {
        let output = shell(&folder, "\"$G\" generate job.toml --quiet --out killed", &[(FAIL_POINT_VARIABLE, at)]);
        assert!(output.status.success());
        assert_eq!(
            messages_of(&output).matches("GELSIM_FAIL_POINT: shard renamed: ").count(),
            met,
            "{}",
            messages_of(&output)
        );
        assert_like_undisturbed(&folder, "killed");
        fs::remove_dir_all(folder.path("killed")).expect("a folder");
    }
}

/// Every state between two steps of the exchange of a damaged folder, made by hand.
#[test]
fn whatever_step_of_an_exchange_of_folders_was_the_last_the_same_command_goes_on() {
    let folder = with_undisturbed(&in_folders(&many_shards()));
    let at = |name: &str| folder.path(&format!("killed/data/{name}"));
    let (shard, partial, aside) = ("val-000001", ".val-000001.partial", ".val-000001.replaced.partial");
    let copy = |from: &str, to: &str| {
        fs::create_dir_all(at(to)).expect("a folder");
        for entry in fs::read_dir(folder.path("complete/data").join(from)).expect("a folder").flatten() {
            fs::copy(entry.path(), at(to).join(entry.file_name())).expect("a file");
        }
    };
    let gone = |name: &str| fs::remove_dir_all(at(name)).expect("a folder");
    type State<'a> = (&'a str, Box<dyn Fn() + 'a>);
    let states: [State<'_>; 6] = [
        ("written, the old one in place", Box::new(|| copy(shard, partial))),
        (
            "the old one aside",
            Box::new(|| {
                copy(shard, partial);
                fs::rename(at(shard), at(aside)).expect("a folder");
            }),
        ),
        ("the new one in place", Box::new(|| copy(shard, aside))),
        (
            "the old one half gone",
            Box::new(|| {
                copy(shard, aside);
                fs::remove_file(at(aside).join("metadata.jsonl")).expect("a file");
            }),
        ),
        (
            "half written, nothing in place",
            Box::new(|| {
                copy(shard, partial);
                fs::remove_file(at(partial).join("metadata.jsonl")).expect("a file");
                gone(shard);
            }),
        ),
        (
            "an empty folder in place",
            Box::new(|| {
                gone(shard);
                fs::create_dir(at(shard)).expect("a folder");
            }),
        ),
    ];
    for (name, state) in states {
        folder.succeed(RUN);
        fs::remove_file(folder.path("killed/stats/val-000001.json")).expect("stats");
        folder.write("killed/data/.val-000001.lock", "process 1 on elsewhere\n");
        state();
        println!("{name}");
        folder.succeed(RUN);
        assert_like_undisturbed(&folder, "killed");
    }
}
