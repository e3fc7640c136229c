//! Several processes in one folder: who holds a shard is named, nothing is written twice, a dead holder holds nothing.

use std::fs;
use std::os::unix::process::ExitStatusExt;
use std::process::Child;
use std::time::Duration;

use crate::rig::{Random, assert_like_whole, assert_whole_or_absent, many_shards, with_whole};
use crate::support::{Folder, JOB, edited};

fn signal(run: &Child, name: &str) {
    let sent = std::process::Command::new("kill").args([name, &run.id().to_string()]).status();
    assert!(sent.expect("kill").success());
}

/// A run that was stopped in the middle of its first shard, which it holds; it is killed when this is dropped.
struct Asleep(Child);

impl Asleep {
    fn at(folder: &Folder, partial: &str, arguments: &str) -> Self {
        let run = folder.spawn(arguments);
        while fs::metadata(folder.path(partial)).map_or(0, |meta| meta.len()) == 0 {
            std::thread::sleep(Duration::from_millis(1));
        }
        signal(&run, "-STOP");
        Self(run)
    }
}

impl Drop for Asleep {
    fn drop(&mut self) {
        let _ = self.0.kill();
        let _ = self.0.wait();
    }
}

#[test]
fn a_shard_has_one_writer_who_is_named_and_whose_death_frees_it() {
    let edits = [("samples_per_shard = 3", "samples_per_shard = 1000"), ("[48, 36]", "[320, 240]")];
    let folder = with_whole(&edited(&edited(JOB, &edits), &[("samples = 8", "samples = 80")]));
    let partial = "out/data/.train-000000.tar.partial";
    let holder = Asleep::at(&folder, partial, "generate job.toml --quiet --out out --threads 1");
    let named = format!("train-000000 is being written by process {} on ", holder.0.id());
    let text = folder.fail("generate job.toml --out out --shards 0..1", 1);
    assert!(text.contains(&named), "{text}");
    // Nor can its dataset be replaced under its hands.
    let before = fs::read(folder.path(partial)).expect("a partial file");
    let text = folder.fail("generate job.toml --out out --overwrite", 2);
    assert!(text.contains("out cannot be replaced") && text.contains(&named), "{text}");
    // Others do the rest, and do not sweep what it needs.
    let text = folder.fail("generate job.toml --out out", 1);
    assert!(text.contains(&named) && text.contains("all other shards are done"), "{text}");
    assert!(folder.path("out/data/val-000000.tar").exists() && folder.path("out/data/test-000000.tar").exists());
    assert!(before == fs::read(folder.path(partial)).expect("a partial file"));
    drop(holder);
    assert!(folder.path(partial).exists() && folder.path("out/data/.train-000000.lock").exists());
    folder.succeed("generate job.toml --quiet --out out");
    assert_like_whole(&folder, "out");
}

#[test]
fn a_writer_whose_partial_file_was_replaced_does_not_bring_it_to_its_final_name() {
    let edits = [("samples_per_shard = 3", "samples_per_shard = 1000"), ("[48, 36]", "[320, 240]")];
    let folder = with_whole(&edited(&edited(JOB, &edits), &[("samples = 8", "samples = 80")]));
    let partial = "out/data/.train-000000.tar.partial";
    // What is in a tar's first 256 KiB stands in memory until there is more.
    let mut run = Asleep::at(&folder, partial, "generate job.toml --quiet --out out --threads 1");
    fs::remove_file(folder.path(partial)).expect("a partial file");
    folder.write(partial, "half a shard");
    signal(&run.0, "-CONT");
    let status = run.0.wait().expect("it ends");
    assert_eq!(status.code(), Some(1));
    assert!(!folder.path("out/data/train-000000.tar").exists());
    folder.succeed("generate job.toml --quiet --out out");
    assert_like_whole(&folder, "out");
}

#[test]
fn a_folder_that_is_removed_under_a_run_is_an_error_in_words() {
    let edits = [("samples_per_shard = 3", "samples_per_shard = 1000"), ("[48, 36]", "[320, 240]")];
    let folder = with_whole(&edited(&edited(JOB, &edits), &[("samples = 8", "samples = 80")]));
    let partial = "out/data/.train-000000.tar.partial";
    let mut run = Asleep::at(&folder, partial, "generate job.toml --quiet --out out --threads 1");
    fs::remove_dir_all(folder.path("out")).expect("a folder");
    signal(&run.0, "-CONT");
    let status = run.0.wait().expect("it ends");
    let mut said = String::new();
    std::io::Read::read_to_string(run.0.stderr.as_mut().expect("a pipe"), &mut said).expect("text");
    assert_eq!(status.code(), Some(1), "{said}");
    // Which file it misses first depends on where it was stopped.
    assert!(said.starts_with("error: out/") && said.contains("the same command goes on"), "{said}");
    folder.succeed("generate job.toml --quiet --out out");
    assert_like_whole(&folder, "out");
}

#[test]
fn eight_processes_share_a_folder_while_some_are_killed_and_started_again() {
    const PARTS: u64 = 8;
    let folder = with_whole(&many_shards());
    let killed: u32 = std::thread::scope(|scope| {
        let parts: Vec<_> = (0..PARTS)
            .map(|part| {
                let folder = &folder;
                scope.spawn(move || {
                    let arguments = format!("generate job.toml --out out --threads 1 --partition {part}/{PARTS}");
                    let mut random = Random(100 + part);
                    let mut killed = 0;
                    // Odd parts are killed up to three times.
                    for _ in 0..3 * (part % 2) {
                        let mut run = folder.spawn(&arguments);
                        std::thread::sleep(Duration::from_millis((random.unit() * 150.0) as u64));
                        run.kill().expect("a child");
                        killed += u32::from(run.wait().expect("a child").signal() == Some(9));
                    }
                    let output = folder.spawn(&arguments).wait_with_output().expect("it ends");
                    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
                    killed
                })
            })
            .collect();
        parts.into_iter().map(|part| part.join().expect("a part")).sum()
    });
    println!("{PARTS} processes shared a folder, {killed} kills among them");
    assert!(killed > 0);
    assert_whole_or_absent(&folder, "out");
    // Who finished last described the dataset; what a kill left after that, this sweeps.
    assert!(folder.path("out/dataset.json").exists());
    folder.succeed("generate job.toml --quiet --out out");
    assert_like_whole(&folder, "out");
}
