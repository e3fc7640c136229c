//! What the tests share: an undisturbed dataset to compare with, random moments, a shell, a disk of one's own.

use std::fs;
use std::os::unix::process::ExitStatusExt;
use std::process::{Command, Output, Stdio};

use crate::support::{Folder, JOB, assert_same_files, edited};

/// 12 small shards, a few tenths of a second of work.
pub fn many_shards() -> String {
    let edits =
        [("samples = 8", "samples = 48"), ("samples_per_shard = 3", "samples_per_shard = 4"), ("[48, 36]", "[96, 72]")];
    edited(JOB, &edits)
}

/// A job whose shards are folders.
pub fn in_folders(job: &str) -> String {
    edited(job, &[("[output]", "[output]\ncontainer = \"folder\"")])
}

/// A folder with a job and what an undisturbed run of it makes, in `whole`.
pub fn with_whole(job: &str) -> Folder {
    let folder = Folder::with_job(job);
    folder.succeed("generate job.toml --quiet --out whole");
    folder
}

/// Nothing of a dataset begins with a dot: no partial file, no lock.
pub fn assert_swept(folder: &Folder, name: &str) {
    let hidden: Vec<String> =
        folder.files(name).into_keys().filter(|file| file.split('/').any(|part| part.starts_with('.'))).collect();
    assert!(hidden.is_empty(), "left behind: {hidden:?}");
}

/// The dataset `name` is the undisturbed one, byte for byte, and nothing else is there.
pub fn assert_like_whole(folder: &Folder, name: &str) {
    assert_swept(folder, name);
    assert_same_files(&folder.lasting_files("whole"), &folder.lasting_files(name));
    assert_eq!(folder.files("whole/stats").len(), folder.files(&format!("{name}/stats")).len());
}

/// Whatever has its final name in the unfinished dataset `name` is what an undisturbed run makes; stats, which hold
/// times, are whole and fit their tars.
pub fn assert_whole_or_absent(folder: &Folder, name: &str) {
    if !folder.path(name).exists() {
        return;
    }
    let (whole, found) = (folder.files("whole"), folder.files(name));
    for (file, bytes) in found.iter().filter(|(file, _)| !file.split('/').any(|part| part.starts_with('.'))) {
        if let Some(shard) = file.strip_prefix("stats/").and_then(|file| file.strip_suffix(".json")) {
            let stats: serde_json::Value = serde_json::from_slice(bytes).expect("a stats file is whole");
            let of_shard = |name: &str| {
                let rest = name.strip_prefix("data/").and_then(|name| name.strip_prefix(shard));
                rest.is_some_and(|rest| rest == ".tar" || rest.starts_with('/'))
            };
            let bytes: usize = found.iter().filter(|(name, _)| of_shard(name)).map(|(_, bytes)| bytes.len()).sum();
            assert_eq!(stats["bytes"], bytes, "{file}");
        } else {
            assert!(whole[file] == *bytes, "{file} is not what an undisturbed run makes");
        }
    }
}

/// How many files of the dataset `name` are in `folder` of it under their final names.
pub fn finished(folder: &Folder, name: &str, sub: &str) -> usize {
    let entries = fs::read_dir(folder.path(name).join(sub)).into_iter().flatten().flatten();
    entries.filter(|entry| !entry.file_name().to_string_lossy().starts_with('.')).count()
}

/// Random numbers that are the same in every run (SplitMix64).
pub struct Random(pub u64);

impl Random {
    /// In [0, 1).
    pub fn unit(&mut self) -> f64 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mut z = self.0;
        z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        ((z ^ (z >> 31)) >> 11) as f64 / (1_u64 << 53) as f64
    }
}

/// Runs a script in `folder`, with the command as `$G` and what `environment` adds.
pub fn shell(folder: &Folder, script: &str, environment: &[(&str, &str)]) -> Output {
    shell_by(&["sh"], folder, script, environment)
}

/// The same in namespaces of its own, where it may mount. None where the system does not allow that, which is said.
pub fn shell_with_mounts(folder: &Folder, script: &str, environment: &[(&str, &str)]) -> Option<Output> {
    let try_out = "mkdir -p probe && mount -t tmpfs none probe && umount probe && rmdir probe";
    let unshare = ["unshare", "-rm", "sh"];
    if !shell_by(&unshare, folder, try_out, &[]).status.success() {
        println!("left out: this system does not let tests mount");
        return None;
    }
    Some(shell_by(&unshare, folder, script, environment))
}

fn shell_by(by: &[&str], folder: &Folder, script: &str, environment: &[(&str, &str)]) -> Output {
    let mut command = Command::new(by[0]);
    command.args(&by[1..]).args(["-c", script]).current_dir(folder.path("")).stdin(Stdio::null());
    command.env("G", env!("CARGO_BIN_EXE_gelsim")).envs(environment.iter().copied());
    match command.output() {
        Ok(output) => output,
        // No such program: as if it had failed.
        Err(_) => Output { status: ExitStatusExt::from_raw(127 << 8), stdout: Vec::new(), stderr: Vec::new() },
    }
}

/// What a script said on standard error; it must not be the words of a panic.
pub fn said(output: &Output) -> String {
    let text = String::from_utf8_lossy(&output.stderr).into_owned();
    assert!(!text.contains("panicked") && output.status.code() != Some(101), "a panic: {text}");
    text
}
