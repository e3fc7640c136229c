//! Few open files, few threads, little memory: words instead of a panic, and the same command goes on without the limit.

use std::collections::BTreeMap;
use std::fs;
use std::os::unix::fs::PermissionsExt;
use std::os::unix::process::ExitStatusExt;

use super::rig::{assert_complete_or_absent, assert_like_undisturbed, messages_of, shell, with_undisturbed};
use crate::support::{Folder, JOB};

fn start_anew(folder: &Folder) {
    let _ = fs::remove_dir_all(folder.path("out"));
}

#[test]
fn few_open_files_are_named_and_twenty_are_enough() {
    let folder = with_undisturbed(JOB);
    let mut enough = Vec::new();
    for limit in 3..=20 {
        start_anew(&folder);
        let script = format!("ulimit -n {limit}; exec \"$G\" generate job.toml --quiet --threads 2 --out out");
        let output = shell(&folder, &script, &[]);
        let text = messages_of(&output);
        assert_complete_or_absent(&folder, "out");
        match output.status.code() {
            Some(0) => enough.push(limit),
            Some(1) => assert!(text.contains("Too many open files") && text.contains("ulimit -n"), "{limit}: {text}"),
            // The job cannot be opened, which is the user's; or the program's own libraries.
            Some(2) => assert!(text.contains("Too many open files"), "{limit}: {text}"),
            Some(127) => assert!(text.contains("shared libraries"), "{limit}: {text}"),
            other => panic!("{limit}: {other:?}: {text}"),
        }
        folder.succeed("generate job.toml --quiet --out out");
        assert_like_undisturbed(&folder, "out");
    }
    println!("enough open files: {enough:?}");
    assert!(enough.contains(&20));
}

#[test]
fn a_system_without_more_threads_is_named() {
    let folder = with_undisturbed(JOB);
    // The limit does not bind the superuser, so that somebody else runs a copy in a folder that all may write.
    let copy = folder.path("copy");
    fs::copy(env!("CARGO_BIN_EXE_gelsim"), &copy).expect("a copy of the program");
    fs::set_permissions(&copy, fs::Permissions::from_mode(0o755)).expect("a mode");
    fs::set_permissions(folder.path(""), fs::Permissions::from_mode(0o777)).expect("a mode");
    let mut ends: BTreeMap<i32, u32> = BTreeMap::new();
    for limit in 1..=12 {
        let script = "run=; [ $(id -u) = 0 ] && run='setpriv --reuid=54321 --regid=54321 --clear-groups'
            exec prlimit --nproc=$LIMIT $run ./copy generate job.toml --quiet --threads 2 --out out";
        let output = shell(&folder, script, &[("LIMIT", &limit.to_string())]);
        let text = messages_of(&output);
        match output.status.code() {
            Some(0) => {}
            Some(1) if text.contains("temporarily unavailable") => assert!(text.contains("ulimit -u"), "{text}"),
            other => {
                println!("left out: nobody to run it as ({other:?}: {text})");
                return;
            }
        }
        *ends.entry(output.status.code().unwrap_or(-1)).or_default() += 1;
        assert_complete_or_absent(&folder, "out");
    }
    println!("limits of threads, by exit status: {ends:?}");
    assert!(ends.contains_key(&1), "no limit was met");
    // What the others wrote may be theirs alone.
    start_anew(&folder);
    folder.succeed("generate job.toml --quiet --out out");
    assert_like_undisturbed(&folder, "out");
}

#[test]
fn too_little_memory_ends_a_run_but_no_shard() {
    let folder = with_undisturbed(JOB);
    let mut ends: BTreeMap<String, u32> = BTreeMap::new();
    for mib in [16, 24, 32, 48, 64, 96, 128, 192, 256, 384, 512, 1024, 1536, 2048, 4096] {
        start_anew(&folder);
        let script = format!("ulimit -v {}; exec \"$G\" generate job.toml --quiet --threads 2 --out out", mib * 1024);
        let output = shell(&folder, &script, &[]);
        let text = messages_of(&output);
        let end = match (output.status.code(), output.status.signal()) {
            (Some(0), _) => "done",
            (Some(1), _) => {
                assert!(text.starts_with("error: "), "{mib} MiB: {text}");
                "error"
            }
            // The first allocation that asks whether it can be had is a file's that is read; which that is depends on the
            // size of the program.
            (Some(2), _) => {
                assert!(text.contains("cannot be read: out of memory"), "{mib} MiB: {text}");
                "error"
            }
            (Some(127), _) => "not started",
            // Rust has no other end for an allocation that fails, the system none for a stack that cannot grow.
            (None, Some(6)) => {
                let is_told = text.contains("memory allocation of ") || text.contains("out of memory");
                assert!(is_told, "{mib} MiB: {text}");
                "aborted"
            }
            (None, Some(11)) => "aborted",
            other => panic!("{mib} MiB: {other:?}: {text}"),
        };
        *ends.entry(end.to_owned()).or_default() += 1;
        assert_complete_or_absent(&folder, "out");
        folder.succeed("generate job.toml --quiet --out out");
        assert_like_undisturbed(&folder, "out");
    }
    println!("limits of memory, by how the run ended: {ends:?}");
    assert!(ends.contains_key("done") && ends.len() > 1);
}
