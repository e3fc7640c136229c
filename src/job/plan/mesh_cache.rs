//! Remembers what is known of the meshes of large sets, so that the next command on the same job reads only those that
//! have changed.
//!
//! Each job has one file in the user's cache folder, a JSON array a line for each mesh file. An entry holds as long as
//! the mesh file has the same size and time of change. Geometry is not in it: it is read when it is needed, and a
//! content that the SHA-256 here does not fit stops the run.

use std::collections::HashMap;
use std::env;
use std::fs::{self, File};
use std::io;
use std::path::{Path, PathBuf};
use std::time::{Duration, SystemTime, UNIX_EPOCH};

use rayon::prelude::*;
use serde::{Deserialize, Serialize};

use super::mesh_facts::MeshFacts;
use gelsim_files::diagnostic::Diagnostic;
use gelsim_files::hash::sha256;
use gelsim_files::write::write_without_sync;

/// Raised whenever a mesh would be read or examined otherwise than before.
const VERSION: u32 = 1;

/// Most jobs that are remembered.
const MAX_JOBS: usize = 8;

/// A file that was changed within this time before it was read may change again with the same time, since file systems
/// count in steps.
const CLOCK_STEP: Duration = Duration::from_secs(2);

/// Size and time of change of a file.
#[derive(Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
pub struct FileState {
    bytes: u64,
    changed_ns: u64,
}

impl FileState {
    /// Returns the state of the file at `path`, unless it may still be changing at the time `now`.
    pub fn of(path: &Path, now: SystemTime) -> Option<Self> {
        let metadata = fs::metadata(path).ok()?;
        let changed = metadata.modified().ok()?;
        let changed_ns = u64::try_from(changed.duration_since(UNIX_EPOCH).ok()?.as_nanos()).ok()?;
        (changed + CLOCK_STEP < now).then_some(Self { bytes: metadata.len(), changed_ns })
    }
}

/// What is known of the files of a job.
pub struct MeshCache {
    path: PathBuf,
    known: HashMap<(usize, PathBuf), (FileState, Vec<MeshFacts>)>,
}

/// A line: the number of the `[[object]]`, the mesh file, its state, and what is known of its parts.
type Line<Parts> = (usize, PathBuf, FileState, Parts);

impl MeshCache {
    /// Reads what is known of a job whose `[[object]]` tables stand in these folders, have these paths and are read as
    /// these keys say. Returns `None` if there is no folder for it.
    pub fn open(tables: &[(&str, &str, &str)]) -> Option<Self> {
        let folder = cache_folder()?.join("meshes");
        let here = env::current_dir().ok()?;
        let job = sha256(format!("{VERSION} {} {here:?} {tables:?}", env!("CARGO_PKG_VERSION")).as_bytes());
        let path = folder.join(format!("{}.jsonl", &job[..32]));
        let text = fs::read_to_string(&path).unwrap_or_default();
        let lines: Vec<&str> = text.lines().collect();
        let read = |line: &&str| {
            let (table, path, state, parts) = serde_json::from_str::<Line<Vec<MeshFacts>>>(line).ok()?;
            Some(((table, path), (state, parts)))
        };
        Some(Self { path, known: lines.par_iter().filter_map(read).collect() })
    }

    /// Returns what is known of the file at `path`, as the `[[object]]` of this number reads it.
    pub fn find(&self, table: usize, path: &Path, now: FileState) -> Option<Vec<MeshFacts>> {
        let (state, parts) = self.known.get(&(table, path.to_owned()))?;
        (*state == now).then(|| parts.clone())
    }

    /// Writes what is known now, if that is more than before. Returns a note if it cannot be written.
    pub fn save(self, known: Vec<(usize, &Path, FileState, Vec<&MeshFacts>)>) -> Option<Diagnostic> {
        let is_known = |(table, path, state, _): &(usize, &Path, FileState, Vec<&MeshFacts>)| {
            self.known.get(&(*table, path.to_path_buf())).is_some_and(|(before, _)| before == state)
        };
        if known.iter().all(is_known) && known.len() == self.known.len() {
            // The job is used: it is not among those that are forgotten.
            let _ = File::open(&self.path).and_then(|file| file.set_modified(SystemTime::now()));
            return None;
        }
        let lines: Vec<String> = known.par_iter().filter_map(|line| serde_json::to_string(line).ok()).collect();
        self.write(&(lines.join("\n") + "\n")).err().map(|error| {
            let message = format!("{}: cannot remember what the meshes hold: {error}", self.path.display());
            let help = "the next command reads all of them again; GELSIM_CACHE_DIR names another folder";
            Diagnostic::info(message).help(help)
        })
    }

    fn write(&self, text: &str) -> io::Result<()> {
        let folder = self.path.parent().unwrap_or(Path::new(""));
        fs::create_dir_all(folder)?;
        write_without_sync(&self.path, text.as_bytes())?;
        let mut jobs: Vec<(SystemTime, PathBuf)> = fs::read_dir(folder)?
            .filter_map(|entry| {
                let entry = entry.ok()?;
                let path = entry.path();
                (path.extension()? == "jsonl").then_some((entry.metadata().ok()?.modified().ok()?, path))
            })
            .collect();
        jobs.sort();
        for (_, path) in jobs.iter().rev().skip(MAX_JOBS) {
            // Another process may have removed it.
            let _ = fs::remove_file(path);
        }
        Ok(())
    }
}

/// Returns the folder for what can be computed again: that of the user's programs, or the one that is set.
fn cache_folder() -> Option<PathBuf> {
    let from = |name: &str| env::var_os(name).filter(|value| !value.is_empty()).map(PathBuf::from);
    // Programs are to ignore a relative XDG_CACHE_HOME.
    let absolute = |name: &str| from(name).filter(|path| path.is_absolute());
    from("GELSIM_CACHE_DIR")
        .or_else(|| Some(absolute("XDG_CACHE_HOME")?.join("gelsim")))
        .or_else(|| Some(absolute("HOME")?.join(".cache/gelsim")))
}
