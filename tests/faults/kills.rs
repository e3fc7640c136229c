//! SIGKILL at any moment: the same command makes the bytes of an undisturbed run.

use std::collections::BTreeMap;
use std::fs;
use std::os::unix::process::ExitStatusExt;
use std::time::{Duration, Instant};

use crate::rig::{Random, assert_like_whole, assert_whole_or_absent, finished, many_shards, with_whole};
use crate::support::Folder;

const SHARDS: usize = 12;
const KILLS: u32 = 50;
const RUN: &str = "generate job.toml --quiet --out killed --threads 3";

/// Where a run was when it was killed.
fn moment(folder: &Folder) -> &'static str {
    let stats = finished(folder, "killed", "stats");
    let tars = finished(folder, "killed", "data");
    match () {
        () if !folder.path("killed").exists() => "1 before the folder",
        () if !folder.path("killed/job.toml").exists() => "2 before job.toml",
        () if tars == 0 => "3 in the first shards",
        () if tars > stats => "4 between a tar and its stats",
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
    let folder = with_whole(&many_shards());
    let start = Instant::now();
    folder.succeed(&RUN.replace("killed", "timed"));
    let typical = start.elapsed();
    let mut random = Random(1);
    let (mut kills, mut again) = (0, 0);
    let mut moments: BTreeMap<&str, u32> = BTreeMap::new();
    for attempt in 0.. {
        assert!(attempt < 10 * KILLS, "most runs end before they can be killed");
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
        if kills == KILLS {
            break;
        }
    }
    println!("{kills} runs killed, {again} of them twice; when they were killed: {moments:?}");
    let midway: u32 = moments.iter().filter(|&(&name, _)| ("3".."6").contains(&name)).map(|(_, count)| count).sum();
    assert!(midway >= KILLS / 10, "hardly a kill met a shard: {moments:?}");
}

#[test]
fn a_dataset_that_was_being_replaced_is_never_a_mixture() {
    let folder = with_whole(&many_shards());
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
