//! What the tests share: an undisturbed dataset to compare with, a run held at a step, a shell, a disk of one's own.

use std::io::{BufRead, BufReader, Read};
use std::os::unix::process::ExitStatusExt;
use std::process::{Child, ChildStderr, ChildStdin, Command, Output, Stdio};

use gelsim_files::fail_point::FAIL_POINT_VARIABLE;

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

/// A job whose samples are sequences of three frames.
pub fn in_sequences(job: &str) -> String {
    let depth = "[indentation]\ndepth_mm = { log_uniform = [0.3, 1.2] }\nno_contact = 0.25\n";
    let sequence = "[sequence]\nframe_rate_hz = 25.0\nfriction.coefficient = 0.5\n[[sequence.phase]]\nname = \"press\"\n\
                    duration_s = 0.08\ndepth_mm = [0.3, 0.6]\n";
    edited(job, &[(depth, sequence)])
}

/// A folder with a job and what an undisturbed run of it makes, in `complete`.
pub fn with_undisturbed(job: &str) -> Folder {
    let folder = Folder::with_job(job);
    folder.succeed("generate job.toml --quiet --out complete");
    folder
}

/// Nothing of a dataset begins with a dot: no partial file, no lock.
pub fn assert_swept(folder: &Folder, name: &str) {
    let hidden: Vec<String> =
        folder.files(name).into_keys().filter(|file| file.split('/').any(|part| part.starts_with('.'))).collect();
    assert!(hidden.is_empty(), "left behind: {hidden:?}");
}

/// The dataset `name` is the undisturbed one, byte for byte, and nothing else is there.
pub fn assert_like_undisturbed(folder: &Folder, name: &str) {
    assert_swept(folder, name);
    assert_same_files(&folder.lasting_files("complete"), &folder.lasting_files(name));
    assert_eq!(folder.files("complete/stats").len(), folder.files(&format!("{name}/stats")).len());
}

/// Whatever has its final name in the unfinished dataset `name` is what an undisturbed run makes; stats, which hold
/// times, are complete and fit their tars.
pub fn assert_complete_or_absent(folder: &Folder, name: &str) {
    if !folder.path(name).exists() {
        return;
    }
    let (complete, found) = (folder.files("complete"), folder.files(name));
    for (file, bytes) in found.iter().filter(|(file, _)| !file.split('/').any(|part| part.starts_with('.'))) {
        if let Some(shard) = file.strip_prefix("stats/").and_then(|file| file.strip_suffix(".json")) {
            let stats: serde_json::Value = serde_json::from_slice(bytes).expect("a stats file is complete");
            let of_shard = |name: &str| {
                let rest = name.strip_prefix("data/").and_then(|name| name.strip_prefix(shard));
                rest.is_some_and(|rest| rest == ".tar" || rest.starts_with('/'))
            };
            let bytes: usize = found.iter().filter(|(name, _)| of_shard(name)).map(|(_, bytes)| bytes.len()).sum();
            assert_eq!(stats["bytes"], bytes, "{file}");
        } else {
            assert!(complete[file] == *bytes, "{file} is not what an undisturbed run makes");
        }
    }
}

/// A run that waits at a step; killed if it is dropped.
pub struct Held {
    run: Child,
    input: Option<ChildStdin>,
    said: BufReader<ChildStderr>,
}

impl Held {
    /// Starts a run and waits until it gets to the step `at`, of a shard or file if that is named. Otherwise its end.
    pub fn at(folder: &Folder, arguments: &str, at: &str) -> Result<Self, Output> {
        let mut command = Command::new(env!("CARGO_BIN_EXE_gelsim"));
        command.current_dir(folder.path("")).args(arguments.split(' ')).env(FAIL_POINT_VARIABLE, at);
        let mut run = command.stdin(Stdio::piped()).stderr(Stdio::piped()).spawn().expect("the command starts");
        let input = run.stdin.take();
        let mut held = Self { said: BufReader::new(run.stderr.take().expect("a pipe")), run, input };
        let mut lines = String::new();
        loop {
            let start = lines.len();
            if held.said.read_line(&mut lines).expect("text") == 0 {
                return Err(held.ended(lines));
            }
            if lines[start..].starts_with(FAIL_POINT_VARIABLE) {
                return Ok(held);
            }
        }
    }

    pub fn id(&self) -> u32 {
        self.run.id()
    }

    /// SIGKILL.
    pub fn kill(mut self) {
        self.run.kill().expect("a child");
        assert_eq!(self.run.wait().expect("a child").signal(), Some(9));
    }

    /// Lets it go on to its end, wherever else it gets to the step. What it said after the step it was held at.
    pub fn go_on(mut self) -> Output {
        drop(self.input.take());
        let mut said = String::new();
        self.said.read_to_string(&mut said).expect("text");
        self.ended(said)
    }

    fn ended(&mut self, said: String) -> Output {
        Output { status: self.run.wait().expect("a child"), stdout: Vec::new(), stderr: said.into_bytes() }
    }
}

impl Drop for Held {
    fn drop(&mut self) {
        let _ = self.run.kill();
        let _ = self.run.wait();
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
pub fn messages_of(output: &Output) -> String {
    let text = String::from_utf8_lossy(&output.stderr).into_owned();
    assert!(!text.contains("panicked") && output.status.code() != Some(101), "a panic: {text}");
    text
}
