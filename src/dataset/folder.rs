//! The folder of a dataset: made, recognised, refused if another job made it.

use std::fs;
use std::io;
use std::path::{Path, PathBuf};

use super::shard::{Lock, write_whole};
use crate::config::Job;
use crate::config::diagnostic::Report;
use crate::fidelity::Rung;
use crate::plan::{Plan, stem, usage};

/// Names in a dataset's folder that are ours to write and, with `--overwrite`, to remove.
/// job.toml goes last: while it is there, what remains is known to be ours.
const FILES: [&str; 4] = ["README.md", "dataset.json", "wids.json", "job.toml"];
const FOLDERS: [&str; 2] = ["data", "stats"];

/// How the job.toml of a dataset begins; a version follows.
const TITLE: &str = "# The job of this dataset with every default written out, resolved by gelsim";

/// Why a folder could not be used.
#[derive(Debug)]
pub enum Refused {
    /// The user has to decide something.
    Usage(Report),
    /// The disk said no.
    Io(PathBuf, io::Error),
}

/// Makes `root` ready for `plan`: a new folder, an empty one, or one that the same job began.
pub fn prepare(root: &Path, plan: &Plan, overwrite: bool) -> Result<(), Refused> {
    let io = |path: &Path| {
        let path = path.to_owned();
        move |error| Refused::Io(path, error)
    };
    let refused = |message: String, help: &str| Err(Refused::Usage(usage(message, help)));
    if root.exists() && !root.is_dir() {
        return refused(format!("{} is not a folder", root.display()), "choose a new or empty folder with --out");
    }
    let job_path = root.join("job.toml");
    loop {
        let there = match fs::read_to_string(&job_path) {
            Ok(text) => Some(text),
            Err(error) if error.kind() == io::ErrorKind::NotFound => None,
            Err(error) => return Err(Refused::Io(job_path, error)),
        };
        match there {
            Some(text) if text.starts_with(TITLE) => {
                let differs = differences(&text, &plan.job);
                if overwrite {
                    clear(root).map_err(io(root))?;
                } else if !differs.is_empty() {
                    let message = format!("{} holds a dataset of another job: {}", root.display(), differs.join("; "));
                    return refused(
                        message,
                        "choose another folder with --out, or replace that dataset with --overwrite",
                    );
                }
                break;
            }
            None if !is_foreign(root).map_err(io(root))? => break,
            // Another process may have begun the dataset just now.
            None if job_path.exists() => {}
            _ => {
                let message = format!("{} is not empty and holds no dataset of gelsim", root.display());
                return refused(message, "choose a new or empty folder with --out");
            }
        }
    }
    for folder in FOLDERS {
        let path = root.join(folder);
        fs::create_dir_all(&path).map_err(io(&path))?;
    }
    let lock = lock(root);
    let _alone = Lock::wait(&lock).map_err(io(&lock))?;
    if !job_path.exists() {
        let text = resolved_job(root, plan).map_err(io(&job_path))?;
        write_whole(&job_path, text.as_bytes()).map_err(io(&job_path))?;
    }
    Ok(())
}

/// The rung that the dataset in `root` was begun with, if there is one.
pub fn recorded_rung(root: &Path) -> Option<Rung> {
    let text = fs::read_to_string(root.join("job.toml")).ok().filter(|text| text.starts_with(TITLE))?;
    let job: toml::Table = text.parse().ok()?;
    let name = job.get("fidelity")?.as_str()?;
    Rung::ALL.into_iter().find(|rung| rung.name() == name)
}

/// True if the folder has something in it that may not be a dataset's.
fn is_foreign(root: &Path) -> io::Result<bool> {
    let entries = match fs::read_dir(root) {
        Ok(entries) => entries,
        Err(error) if error.kind() == io::ErrorKind::NotFound => return Ok(false),
        Err(error) => return Err(error),
    };
    for entry in entries {
        let entry = entry?;
        let name = entry.file_name();
        let name = name.to_string_lossy();
        // A run that was killed right at its start leaves these: shards come after job.toml.
        let is_empty = || fs::read_dir(entry.path()).is_ok_and(|mut inside| inside.next().is_none());
        let ours = name == LOCK || name.starts_with(".job.toml.") || FOLDERS.contains(&&*name) && is_empty();
        if !ours {
            return Ok(true);
        }
    }
    Ok(false)
}

/// Removes the dataset in `root` and nothing else.
fn clear(root: &Path) -> io::Result<()> {
    for folder in FOLDERS {
        absent_is_fine(fs::remove_dir_all(root.join(folder)))?;
    }
    for file in FILES {
        absent_is_fine(fs::remove_file(root.join(file)))?;
    }
    Ok(())
}

/// The file that is locked while something other than a shard is written.
pub fn lock(root: &Path) -> PathBuf {
    root.join(LOCK)
}

const LOCK: &str = ".gelsim.lock";

/// Removes what killed runs left. Only under the [`lock`] of a dataset of which all shards are complete: then nobody
/// needs a partial file or a shard's lock any more.
pub fn sweep(root: &Path) -> io::Result<()> {
    for folder in [root.to_owned(), root.join("data"), root.join("stats")] {
        for entry in fs::read_dir(folder)? {
            let path = entry?.path();
            let name = path.file_name().unwrap_or_default().to_string_lossy();
            let leftover = name.ends_with(".partial") || name.ends_with(".lock");
            if name.starts_with('.') && leftover && name != LOCK {
                absent_is_fine(fs::remove_file(&path))?;
            }
        }
    }
    Ok(())
}

fn absent_is_fine(result: io::Result<()>) -> io::Result<()> {
    match result {
        Err(error) if error.kind() != io::ErrorKind::NotFound => Err(error),
        _ => Ok(()),
    }
}

/// The text of `job.toml`: every default written out, paths relative to `root`, which must exist.
fn resolved_job(root: &Path, plan: &Plan) -> io::Result<String> {
    let root = root.canonicalize()?;
    let relative = |path: &str| -> io::Result<String> {
        let path = std::path::absolute(path)?;
        // A link keeps its name: an object is called by it.
        let path = match (path.parent(), path.file_name()) {
            (Some(folder), Some(name)) => folder.canonicalize()?.join(name),
            _ => path,
        };
        let relative = pathdiff::diff_paths(&path, &root).unwrap_or(path);
        Ok(relative.to_string_lossy().replace('\\', "/"))
    };
    let mut job = plan.job.clone();
    for path in job.paths_mut() {
        *path = relative(path)?;
    }
    let text = toml::to_string(&job).map_err(io::Error::other)?;
    Ok(format!("{TITLE} {}.\n\n{text}", env!("CARGO_PKG_VERSION")))
}

/// What differs between the job of a dataset and `job`, by dotted key; folders aside, because contents have hashes.
fn differences(there: &str, job: &Job) -> Vec<String> {
    let first = there.lines().next().unwrap_or_default();
    let version = first.strip_prefix(TITLE).unwrap_or_default().trim().trim_end_matches('.');
    if version != env!("CARGO_PKG_VERSION") {
        return vec![format!("gelsim {version} made it, this is {}", env!("CARGO_PKG_VERSION"))];
    }
    let Ok(there) = there.parse::<toml::Table>() else {
        return vec![String::from("its job.toml is not valid TOML")];
    };
    let Ok(here) = toml::Table::try_from(job) else { return Vec::new() };
    let mut found = Vec::new();
    compare("", &toml::Value::Table(there), &toml::Value::Table(here), &mut found);
    if found.len() > MOST_NAMED {
        let more = found.len() - MOST_NAMED;
        found.truncate(MOST_NAMED);
        found.push(format!("and {more} more keys"));
    }
    found
}

const MOST_NAMED: usize = 6;

fn compare(path: &str, there: &toml::Value, here: &toml::Value, found: &mut Vec<String>) {
    let below = |key: &str| if path.is_empty() { key.to_owned() } else { format!("{path}.{key}") };
    match (there, here) {
        (toml::Value::Table(a), toml::Value::Table(b)) => {
            let keys: std::collections::BTreeSet<&String> = a.keys().chain(b.keys()).collect();
            for key in keys {
                let path = below(key);
                let image = path.ends_with(".path") && !path.starts_with("object.");
                if image || path == "sensor.background" {
                    continue;
                }
                match (a.get(key), b.get(key)) {
                    (Some(a), Some(b)) => compare(&path, a, b, found),
                    (Some(a), None) => found.push(format!("{path} is {a} there and absent here")),
                    (None, Some(b)) => found.push(format!("{path} is absent there and {b} here")),
                    (None, None) => {}
                }
            }
        }
        (toml::Value::Array(a), toml::Value::Array(b)) if a.len() == b.len() && a.iter().any(toml::Value::is_table) => {
            for (i, (a, b)) in a.iter().zip(b).enumerate() {
                compare(&below(&i.to_string()), a, b, found);
            }
        }
        (toml::Value::Array(a), toml::Value::Array(b)) if a.len() != b.len() => {
            found.push(format!("{path} has {} elements there and {} here", a.len(), b.len()));
        }
        // The name of a mesh is the object's in the labels.
        (toml::Value::String(a), toml::Value::String(b))
            if path.starts_with("object.") && path.ends_with(".path") && stem(a) == stem(b) => {}
        (a, b) if a != b => found.push(format!("{path} is {a} there and {b} here")),
        _ => {}
    }
}
