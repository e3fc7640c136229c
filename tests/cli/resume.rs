//! Stopped, killed, damaged, run twice at once: the same command finishes the dataset, with the bytes of an undisturbed
//! run; and a folder that is somebody else's stays as it is.

use std::fs::{self, File};
use std::io::Write;
use std::time::SystemTime;

use crate::support::{Folder, JOB, assert_same_files, edited, made_by};

fn modified(folder: &Folder, name: &str) -> SystemTime {
    let meta = fs::metadata(folder.path(name)).unwrap_or_else(|error| panic!("{name}: {error}"));
    meta.modified().expect("a time")
}

/// Nothing of the dataset begins with a dot: no partial file, no lock.
fn assert_swept(folder: &Folder, name: &str) {
    let hidden: Vec<String> = folder
        .files(name)
        .into_keys()
        .filter(|file| file.split('/').any(|part| part.starts_with('.')) || file.ends_with(".partial"))
        .collect();
    assert!(hidden.is_empty(), "left behind: {hidden:?}");
}

#[cfg(unix)]
mod stopped {
    use std::process::Child;
    use std::time::Duration;

    use super::*;

    /// A short shard and then a long one, in which a run can be caught.
    fn long_job() -> Folder {
        let edits = [
            ("samples = 8", "samples = 100"),
            ("samples_per_shard = 3", "samples_per_shard = 1000"),
            ("[48, 36]", "[320, 240]"),
            ("{ train = 0.5, val = 0.25, test = 0.25 }", "{ train = 0.1, val = 0.9 }"),
            ("[\"depth\", \"contact\"]", "[\"depth\", \"normal\"]"),
        ];
        let folder = Folder::with_job(&edited(JOB, &edits));
        folder.succeed("generate job.toml --quiet --out undisturbed");
        folder
    }

    const SHORT: [&str; 2] = ["caught/data/train-000000.tar", "caught/stats/train-000000.json"];

    /// Starts the run, waits until the short shard is complete and the long one grows, and sends the signal. Exit
    /// status, if it exited, and what it said. A machine may be so busy that the run ends first: then once more.
    fn interrupt_run(folder: &Folder, signal: &str) -> (Option<i32>, String) {
        for _ in 0..10 {
            let mut run: Child = folder.spawn("generate job.toml --out caught --threads 1");
            let partial = folder.path("caught/data/.val-000000.tar.partial");
            let grows = || fs::metadata(&partial).is_ok_and(|meta| meta.len() > 0);
            while !grows() && run.try_wait().expect("a child").is_none() {
                std::thread::sleep(Duration::from_millis(1));
            }
            let kill = format!("kill -{signal} {}", run.id());
            std::process::Command::new("sh").args(["-c", &kill]).output().expect("a shell");
            let output = run.wait_with_output().expect("it ends");
            if output.status.success() {
                fs::remove_dir_all(folder.path("caught")).expect("a folder");
                continue;
            }
            assert!(
                !folder.path("caught/data/val-000000.tar").exists(),
                "a shard has its name only when it is complete"
            );
            assert!(!folder.path("caught/stats/val-000000.json").exists());
            assert!(!folder.path("caught/dataset.json").exists());
            return (output.status.code(), String::from_utf8_lossy(&output.stderr).into_owned());
        }
        panic!("ten runs ended before they could be stopped");
    }

    /// Runs the same command again, which must go on and end like an undisturbed run.
    fn assert_resumes(folder: &Folder) {
        let before = SHORT.map(|name| modified(folder, name));
        let said = folder.succeed("generate job.toml --out caught");
        assert!(said.contains("90 samples in 1 shard,") && said.contains("1 shard was there already"), "{said}");
        assert_eq!(SHORT.map(|name| modified(folder, name)), before, "what was complete is not touched");
        assert_swept(folder, "caught");
        assert_same_files(&folder.lasting_files("undisturbed"), &folder.lasting_files("caught"));
    }

    #[test]
    fn a_killed_run_is_finished_by_the_same_command() {
        let folder = long_job();
        let (status, _) = interrupt_run(&folder, "KILL");
        assert_eq!(status, None, "killed");
        assert!(folder.path("caught/data/.val-000000.tar.partial").exists(), "killed in the middle of the shard");
        assert_resumes(&folder);
    }

    #[test]
    fn an_interrupted_run_ends_with_130_and_is_finished_by_the_same_command() {
        let folder = long_job();
        let (status, said) = interrupt_run(&folder, "INT");
        assert_eq!(status, Some(130), "{said}");
        assert!(said.contains("the same command goes on from there"), "{said}");
        assert_swept(&folder, "caught");
        assert_resumes(&folder);
    }

    #[test]
    fn a_terminated_run_ends_with_143_and_is_finished_by_the_same_command() {
        let folder = long_job();
        let (status, said) = interrupt_run(&folder, "TERM");
        assert_eq!(status, Some(143), "{said}");
        assert_swept(&folder, "caught");
        assert_resumes(&folder);
    }

    #[test]
    fn a_killed_run_can_be_finished_in_parts() {
        let folder = long_job();
        interrupt_run(&folder, "KILL");
        // What another killed run may have left beside a shard that is complete.
        folder.write("caught/data/.train-000000.lock", "process 1 on elsewhere\n");
        folder.write("caught/stats/.train-000000.json.1.partial", "{");
        folder.succeed("generate job.toml --quiet --out caught --partition 1/2");
        assert_swept(&folder, "caught");
        assert_same_files(&folder.lasting_files("undisturbed"), &folder.lasting_files("caught"));
    }
}

/// The job of [`JOB`], made in `complete`, and in `out`, too, but for what `damage` does to it.
fn damaged(damage: impl Fn(&Folder)) -> Folder {
    let folder = Folder::with_job(JOB);
    folder.succeed("generate job.toml --quiet --out complete");
    folder.succeed("generate job.toml --quiet --out out");
    damage(&folder);
    folder
}

/// Runs the job again: only the damaged shard may be written.
fn assert_repaired(folder: &Folder) {
    let intact = "out/data/train-000000.tar";
    let before = modified(folder, intact);
    let said = folder.succeed("generate job.toml --out out");
    assert!(said.contains(" in 1 shard,") && said.contains("3 shards were there already"), "{said}");
    assert_eq!(modified(folder, intact), before);
    assert_swept(folder, "out");
    assert_same_files(&folder.lasting_files("complete"), &folder.lasting_files("out"));
}

#[test]
fn a_complete_dataset_is_not_made_again() {
    let folder = damaged(|_| ());
    let tars = ["train-000000", "train-000001", "val-000000", "test-000000"].map(|name| format!("out/data/{name}.tar"));
    let before = tars.each_ref().map(|name| modified(&folder, name));
    let said = folder.succeed("generate job.toml --out out");
    assert!(said.contains("0 samples in 0 shards") && said.contains("4 shards were there already"), "{said}");
    assert_eq!(tars.each_ref().map(|name| modified(&folder, name)), before);
}

#[test]
fn a_truncated_shard_is_made_again_and_no_other() {
    let folder = damaged(|folder| {
        let tar = File::options().write(true).open(folder.path("out/data/val-000000.tar")).expect("a tar");
        tar.set_len(1000).expect("shorter");
    });
    assert_repaired(&folder);
}

#[test]
fn a_missing_shard_is_made_again_and_no_other() {
    assert_repaired(&damaged(|folder| fs::remove_file(folder.path("out/data/val-000000.tar")).expect("a tar")));
}

#[test]
fn a_shard_without_stats_is_made_again_and_no_other() {
    assert_repaired(&damaged(|folder| fs::remove_file(folder.path("out/stats/test-000000.json")).expect("stats")));
}

#[test]
fn a_shard_with_broken_stats_is_made_again_and_no_other() {
    assert_repaired(&damaged(|folder| folder.write("out/stats/test-000000.json", "{ \"samples\": ")));
}

#[test]
fn missing_files_about_the_whole_are_written_again() {
    let folder = damaged(|folder| {
        for name in ["dataset.json", "wids.json", "README.md"] {
            fs::remove_file(folder.path("out").join(name)).expect("a file");
        }
    });
    folder.succeed("generate job.toml --quiet --out out");
    assert_same_files(&folder.files("complete/data"), &folder.files("out/data"));
    assert_same_files(&folder.lasting_files("complete"), &folder.lasting_files("out"));
}

#[test]
fn the_folder_of_another_job_is_refused_by_the_key_that_differs() {
    let folder = Folder::with_job(JOB);
    folder.succeed("generate job.toml --quiet --out out");
    let before = folder.files("out");
    for (flags, words) in [
        ("--seed 8", "dataset.seed is 7 there and 8 here"),
        ("--samples 7", "dataset.samples is 8 there and 7 here"),
        ("--set pose.face=\"+x\"", "pose.face is \"-z\" there and \"+x\" here"),
        ("--set object.1.weight=3", "object.1.weight is 2.0 there and 3.0 here"),
        ("--set object.0.path=\"cone.obj\"", "object.0.sha256 is "),
        ("--set object=[{path=\"cube.obj\"}]", "object has 2 elements there and 1 here"),
        (
            "--set gelpad.elastic={resolution=\"half\",tolerance_um=2.0}",
            "gelpad.elastic.tolerance_um is 1.0 there and 2.0 here",
        ),
    ] {
        let text = folder.fail(&format!("generate job.toml --out out {flags}"), 2);
        assert!(text.contains("out holds a dataset of another job") && text.contains(words), "{words:?} in\n{text}");
        assert!(text.contains("--overwrite"), "{text}");
    }
    assert_same_files(&before, &folder.files("out"));
}

#[test]
fn a_mesh_of_another_name_is_another_job() {
    let edits = [("\"cube.obj\"", "\"cube.obj\"\nclass = \"box\"")];
    let folder = Folder::with_job(&edited(JOB, &edits));
    folder.succeed("generate job.toml --quiet --out out");
    fs::copy(folder.path("cube.obj"), folder.path("block.obj")).expect("a copy");
    // The label's object.id would change.
    let text = folder.fail("generate job.toml --out out --set object.0.path=\"block.obj\"", 2);
    assert!(text.contains("object.0.path is \"../cube.obj\" there and \"block.obj\" here"), "{text}");
    // So would object.path, of the same mesh in another folder, unless the job says what labels give.
    fs::create_dir(folder.path("moved")).expect("a folder");
    fs::copy(folder.path("cube.obj"), folder.path("moved/cube.obj")).expect("a copy");
    let moved = "generate job.toml --out out --set object.0.path=\"moved/cube.obj\"";
    let text = folder.fail(moved, 2);
    assert!(text.contains("object.0.label_path is \"cube.obj\" there and \"moved/cube.obj\" here"), "{text}");
    folder.succeed(&format!("{moved} --set object.0.label_path=\"cube.obj\""));
}

#[test]
fn overwrite_replaces_the_dataset_of_another_job() {
    let folder = Folder::with_job(JOB);
    folder.succeed("generate job.toml --quiet --out out");
    // Something of the user's own, such as a contact sheet, stays.
    folder.write("out/sheet.png", "a picture");
    folder.succeed("generate job.toml --quiet --out fresh --seed 8 --samples 2");
    folder.succeed("generate job.toml --quiet --out out --seed 8 --samples 2 --overwrite");
    assert_eq!(folder.read("out/sheet.png"), "a picture");
    fs::remove_file(folder.path("out/sheet.png")).expect("a picture");
    assert_same_files(&folder.lasting_files("fresh"), &folder.lasting_files("out"));
    assert_eq!(folder.files("out/stats").len(), folder.files("fresh/stats").len(), "no stats of the old shards stay");
}

#[test]
fn overwrite_makes_the_same_dataset_anew() {
    let folder = damaged(|_| ());
    let said = folder.succeed("generate job.toml --out out --overwrite");
    assert!(said.contains("8 samples in 4 shards"), "{said}");
    assert_same_files(&folder.lasting_files("complete"), &folder.lasting_files("out"));
}

#[test]
fn a_folder_with_other_things_in_it_is_refused_and_left_alone() {
    for (name, content) in [
        ("theirs/notes.txt", "mine"),
        // Names that a dataset has too.
        ("theirs/data/measured.csv", "1,2,3"),
        ("theirs/README.md", "my project"),
        ("theirs/job.toml", JOB),
        ("theirs/job.toml", "this is not even TOML ["),
    ] {
        let folder = Folder::with_job(JOB);
        fs::create_dir_all(folder.path(name).parent().expect("a folder")).expect("a folder");
        folder.write(name, content);
        let before = folder.files("theirs");
        for flags in ["", " --overwrite"] {
            let text = folder.fail(&format!("generate job.toml --out theirs{flags}"), 2);
            assert!(text.contains("theirs is not empty and holds no dataset of gelsim"), "{name}: {text}");
            assert!(!text.contains("--overwrite"), "it would not help: {text}");
        }
        assert_same_files(&before, &folder.files("theirs"));
        assert_eq!(fs::read_dir(folder.path("theirs")).expect("a folder").count(), 1, "nothing was added");
    }
}

#[test]
fn an_empty_folder_is_used_and_a_missing_one_made() {
    let folder = Folder::with_job(JOB);
    fs::create_dir(folder.path("empty")).expect("a folder");
    folder.succeed("generate job.toml --quiet --out empty");
    folder.succeed("generate job.toml --quiet --out not/yet/there");
    assert_same_files(&folder.files("empty/data"), &folder.files("not/yet/there/data"));
}

#[test]
fn a_folder_that_a_run_left_right_at_its_start_is_used() {
    let folder = Folder::with_job(JOB);
    fs::create_dir_all(folder.path("out/data")).expect("a folder");
    fs::create_dir_all(folder.path("out/stats")).expect("a folder");
    folder.write("out/.job.toml.123.partial", "# The job");
    folder.succeed("generate job.toml --quiet --out out");
}

#[test]
fn a_dataset_of_another_version_is_refused_by_that_version() {
    let folder = damaged(|folder| made_by(folder, "out", "0.0.1"));
    let text = folder.fail("generate job.toml --out out", 2);
    assert!(text.contains("gelsim 0.0.1 made it") && text.contains("--overwrite"), "{text}");
    folder.succeed("generate job.toml --quiet --out out --overwrite");
    assert_same_files(&folder.lasting_files("complete"), &folder.lasting_files("out"));
}

#[test]
fn who_holds_a_shard_is_named_and_the_other_shards_are_written() {
    let folder = Folder::with_job(JOB);
    folder.succeed("generate job.toml --quiet --out complete");
    folder.succeed("generate job.toml --quiet --out out --shards 0..1");
    let mut lock = File::create(folder.path("out/data/.val-000000.lock")).expect("a lock file");
    writeln!(lock, "process 4711 on elsewhere").expect("a line");
    lock.lock().expect("the lock is free");
    let text = folder.fail("generate job.toml --out out", 1);
    assert!(text.contains("val-000000 is being written by process 4711 on elsewhere"), "{text}");
    assert!(!folder.path("out/data/val-000000.tar").exists() && !folder.path("out/dataset.json").exists());
    assert!(folder.path("out/data/test-000000.tar").exists());
    // The holder dies: its lock goes, its lock file stays.
    drop(lock);
    folder.succeed("generate job.toml --out out");
    assert_swept(&folder, "out");
    assert_same_files(&folder.lasting_files("complete"), &folder.lasting_files("out"));
}

#[test]
fn processes_at_once_on_the_same_shards_finish_the_dataset_together() {
    let edits = [
        ("samples = 8", "samples = 60"),
        ("samples_per_shard = 3", "samples_per_shard = 10"),
        ("[48, 36]", "[96, 72]"),
    ];
    let folder = Folder::with_job(&edited(JOB, &edits));
    folder.succeed("generate job.toml --quiet --out complete");
    let runs: Vec<_> = (0..3).map(|_| folder.spawn("generate job.toml --out out --threads 1")).collect();
    let mut finished = 0;
    for run in runs {
        let output = run.wait_with_output().expect("it ends");
        let said = String::from_utf8_lossy(&output.stderr);
        match output.status.code() {
            Some(0) => finished += 1,
            Some(1) => assert!(said.contains(" is being written by process "), "{said}"),
            other => panic!("{other:?}: {said}"),
        }
    }
    // Whoever wrote the last shard saw that it was the last.
    assert!(finished >= 1);
    assert_swept(&folder, "out");
    assert_same_files(&folder.lasting_files("complete"), &folder.lasting_files("out"));
}
