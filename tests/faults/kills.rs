//! SIGKILL at any moment: the same command makes the bytes of an undisturbed run.

use std::collections::BTreeMap;
use std::fs;
use std::os::unix::process::ExitStatusExt;
use std::time::{Duration, Instant};

use crate::rig::{Random, assert_like_whole, assert_whole_or_absent, finished, in_folders, many_shards, with_whole};
use crate::support::Folder;

const SHARDS: usize = 12;
const RUN: &str = "generate job.toml --quiet --out killed --threads 3";

/// Where a run was when it was killed.
fn moment(folder: &Folder) -> &'static str {
    let stats = finished(folder, "killed", "stats");
    let tars = finished(folder, "killed", "data");
    match () {
        () if !folder.path("killed").exists() => "1 before the folder",
        () if !folder.path("killed/job.toml").exists() => "2 before job.toml",
        () if tars == 0 => "3 in the first shards",
        () if tars > stats => "4 between a shard and its stats",
        () if stats < SHARDS => "5 in a later shard",
        () if !folder.path("killed/README.md").exists() => "6 between the last shard and the card",
        () => "7 after the card",
    }
}

#[derive(Clone, Copy)]
enum When {
    After(Duration),
    /// As soon as all shards are there.
    Finalizing,
}

/// Starts a run and kills it. False if it had ended.
fn kill(folder: &Folder, when: When) -> bool {
    kill_of(folder, RUN, when)
}

fn kill_of(folder: &Folder, arguments: &str, when: When) -> bool {
    let mut run = folder.spawn(arguments);
    match when {
        When::After(wait) => std::thread::sleep(wait),
        When::Finalizing => {
            while finished(folder, "killed", "stats") < SHARDS && run.try_wait().expect("a child").is_none() {
                std::thread::yield_now();
            }
        }
    }
    run.kill().expect("a child");
    run.wait().expect("a child").signal() == Some(9)
}

#[test]
fn runs_killed_at_fifty_moments_are_finished_by_the_same_command() {
    killed(&many_shards(), 50);
}

#[test]
fn runs_that_write_folders_killed_at_thirty_moments_are_finished_by_the_same_command() {
    killed(&in_folders(&many_shards()), 30);
}

fn killed(job: &str, most: u32) {
    let folder = with_whole(job);
    let start = Instant::now();
    folder.succeed(&RUN.replace("killed", "timed"));
    let typical = start.elapsed();
    let mut random = Random(1);
    let (mut kills, mut again) = (0, 0);
    let mut moments: BTreeMap<&str, u32> = BTreeMap::new();
    for attempt in 0.. {
        assert!(attempt < 10 * most, "most runs end before they can be killed");
        let unit = random.unit();
        let when = match attempt % 8 {
            0 => When::After(Duration::from_millis(8).mul_f64(unit)),
            1 => When::Finalizing,
            _ => When::After(typical.mul_f64(unit)),
        };
        if kill(&folder, when) {
            kills += 1;
            *moments.entry(moment(&folder)).or_default() += 1;
            assert_whole_or_absent(&folder, "killed");
            // Every third time the run that goes on is killed too.
            if kills % 3 == 0 && kill(&folder, When::After(typical.mul_f64(random.unit()))) {
                again += 1;
                assert_whole_or_absent(&folder, "killed");
            }
        }
        folder.succeed(RUN);
        assert_like_whole(&folder, "killed");
        fs::remove_dir_all(folder.path("killed")).expect("a folder");
        if kills == most {
            break;
        }
    }
    println!("{kills} runs killed, {again} of them twice; when they were killed: {moments:?}");
    let midway: u32 = moments.iter().filter(|&(&name, _)| ("3".."6").contains(&name)).map(|(_, count)| count).sum();
    assert!(midway >= most / 10, "hardly a kill met a shard: {moments:?}");
}

#[test]
fn a_dataset_that_was_being_replaced_is_never_a_mixture() {
    replaced(&many_shards());
}

#[test]
fn a_dataset_of_folders_that_was_being_replaced_is_never_a_mixture() {
    replaced(&in_folders(&many_shards()));
}

fn replaced(job: &str) {
    let folder = with_whole(job);
    let mut random = Random(2);
    let (mut kills, mut refused) = (0, 0);
    while kills < 20 {
        folder.succeed("generate job.toml --quiet --out killed --seed 8 --shards 0..3");
        let wait = Duration::from_millis(60).mul_f64(random.unit());
        kills += u32::from(kill_of(&folder, &format!("{RUN} --overwrite"), When::After(wait)));
        // Either nothing was removed for good, and what is there is another job's, or nothing of that is left.
        let output = folder.gelsim(RUN).output().expect("it runs");
        match output.status.code() {
            Some(0) => {}
            Some(2) => {
                assert!(String::from_utf8_lossy(&output.stderr).contains("dataset.seed is 8 there and 7 here"));
                refused += 1;
                folder.succeed(&format!("{RUN} --overwrite"));
            }
            other => panic!("{other:?}: {}", String::from_utf8_lossy(&output.stderr)),
        }
        assert_like_whole(&folder, "killed");
        fs::remove_dir_all(folder.path("killed")).expect("a folder");
    }
    println!("{kills} runs killed that replaced a dataset; {refused} times it was still the old one");
}

#[test]
fn a_repair_of_folders_that_is_killed_is_finished_by_the_same_command() {
    let folder = with_whole(&in_folders(&many_shards()));
    let shards: Vec<String> = fs::read_dir(folder.path("whole/data"))
        .expect("a folder")
        .map(|entry| entry.expect("an entry").file_name().to_string_lossy().into_owned())
        .collect();
    folder.succeed(RUN);
    let (mut random, mut kills) = (Random(3), 0);
    for attempt in 0.. {
        assert!(attempt < 200, "most runs end before they can be killed");
        // A file that is missing in one, changed in another; a third one gone.
        for (k, shard) in shards.iter().enumerate().filter(|(k, _)| k % 2 == 0) {
            let path = folder.path("killed/data").join(shard);
            match k % 3 {
                0 => fs::remove_file(path.join("metadata.jsonl")).expect("a file"),
                1 => fs::write(path.join("metadata.jsonl"), "{}").expect("a file"),
                _ => fs::remove_dir_all(path).expect("a folder"),
            }
        }
        kills += u32::from(kill(&folder, When::After(Duration::from_millis(150).mul_f64(random.unit()))));
        folder.succeed(RUN);
        assert_like_whole(&folder, "killed");
        if kills == 20 {
            break;
        }
    }
    println!("{kills} runs killed that repaired a dataset");
}

/// Every state between two steps of the exchange of a damaged folder, made by hand.
#[test]
fn whatever_step_of_an_exchange_of_folders_was_the_last_the_same_command_goes_on() {
    let folder = with_whole(&in_folders(&many_shards()));
    let at = |name: &str| folder.path(&format!("killed/data/{name}"));
    let (shard, partial, aside) = ("val-000001", ".val-000001.partial", ".val-000001.replaced.partial");
    let copy = |from: &str, to: &str| {
        fs::create_dir_all(at(to)).expect("a folder");
        for entry in fs::read_dir(folder.path("whole/data").join(from)).expect("a folder").flatten() {
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
        assert_like_whole(&folder, "killed");
    }
}
