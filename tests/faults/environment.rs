//! Time zone, language, clock, closed or broken outputs, a current folder that is gone: the same bytes, or words.

use std::fs::{self, File};
use std::process::{Command, Stdio};
use std::time::{Duration, SystemTime};

use super::rig::{assert_like_undisturbed, messages_of, shell, with_undisturbed};
use crate::support::{Folder, JOB};

#[test]
fn neither_time_zone_nor_language_nor_home_changes_a_byte() {
    let folder = with_undisturbed(JOB);
    for environment in [
        "TZ=Pacific/Kiritimati",
        "TZ=nonsense",
        "LC_ALL=tr_TR.UTF-8 LANG=tr_TR.UTF-8",
        "LC_ALL=de_DE LC_NUMERIC=de_DE",
        "HOME=/nonexistent TMPDIR=/nonexistent",
        "-u HOME -u PATH -u USER",
        "-i",
        "TERM=dumb NO_COLOR=1 CLICOLOR_FORCE=1",
        "RAYON_NUM_THREADS=1",
        "RAYON_NUM_THREADS=nonsense",
    ] {
        let output = shell(&folder, &format!("env {environment} \"$G\" generate job.toml --out out"), &[]);
        assert!(output.status.success(), "{environment}: {}", messages_of(&output));
        assert_like_undisturbed(&folder, "out");
        fs::remove_dir_all(folder.path("out")).expect("a folder");
    }
}

#[test]
fn a_clock_that_runs_backwards_decides_nothing() {
    let folder = with_undisturbed(JOB);
    let year = Duration::from_secs(365 * 24 * 3600);
    // What the clock leaves on a disk: files from a future that has become past, and the other way round.
    for time in [SystemTime::now() + 80 * year, SystemTime::UNIX_EPOCH] {
        folder.succeed("generate job.toml --quiet --out out --shards 0..2");
        for name in folder.files("out").into_keys().chain([String::from("../cube.obj"), String::from("../job.toml")]) {
            let file = File::options().append(true).open(folder.path("out").join(name)).expect("a file");
            file.set_modified(time).expect("a time");
        }
        let text = folder.succeed("generate job.toml --out out");
        assert!(text.contains("2 shards were there already"), "{text}");
        assert_like_undisturbed(&folder, "out");
        fs::remove_dir_all(folder.path("out")).expect("a folder");
    }
}

#[test]
fn nobody_has_to_listen() {
    let folder = with_undisturbed(JOB);
    for closed in ["<&- >&- 2>&-", "2>&-", ">&-", "> /dev/full", "2> /dev/full", "> /dev/full 2> /dev/full"] {
        let output = shell(&folder, &format!("\"$G\" generate job.toml --out out {closed}"), &[]);
        assert_eq!(output.status.code(), Some(0), "{closed}: {}", messages_of(&output));
        assert_like_undisturbed(&folder, "out");
        fs::remove_dir_all(folder.path("out")).expect("a folder");
        // Also where there is an error to report.
        let output = shell(&folder, &format!("\"$G\" generate missing.toml {closed}"), &[]);
        assert_eq!(output.status.code(), Some(2), "{closed}");
    }
    // What must be printed and cannot be is an error.
    let output = shell(&folder, "\"$G\" schema job > /dev/full", &[]);
    assert_eq!(output.status.code(), Some(1));
    assert!(messages_of(&output).contains("standard output: No space left on device"));
}

#[test]
fn a_reader_of_the_messages_that_goes_away_stops_nothing() {
    let folder = with_undisturbed(JOB);
    for (arguments, status) in [("generate job.toml --out out", 0), ("generate missing.toml", 2), ("plan", 2)] {
        let mut command = Command::new(env!("CARGO_BIN_EXE_gelsim"));
        command.current_dir(folder.path("")).args(arguments.split(' ')).stderr(Stdio::piped());
        let mut run = command.spawn().expect("the command starts");
        drop(run.stderr.take());
        assert_eq!(run.wait().expect("it ends").code(), Some(status), "{arguments}");
    }
    assert_like_undisturbed(&folder, "out");
}

#[test]
fn a_current_folder_that_is_gone_is_no_panic() {
    let folder: Folder = with_undisturbed(JOB);
    let gone = |command: &str| shell(&folder, &format!("mkdir gone && cd gone && rmdir ../gone && {command}"), &[]);
    for (arguments, status) in [
        ("../job.toml --out out", 1),
        ("job.toml", 2),
        ("$HERE/job.toml --out out", 1),
        ("$HERE/job.toml --out $HERE/out", 0),
    ] {
        let here = folder.path("").display().to_string();
        let arguments = arguments.replace("$HERE/", &here);
        let output = gone(&format!("exec \"$G\" generate {arguments} --quiet"));
        let text = messages_of(&output);
        // A system may resolve `..` of a folder that is gone, or not.
        let fits =
            output.status.code() == Some(status) || arguments.starts_with("..") && output.status.code() == Some(2);
        assert!(fits, "{arguments}: {text}");
        assert!(status == 0 || text.contains("No such file or directory"), "{text}");
    }
    assert_like_undisturbed(&folder, "out");
}
