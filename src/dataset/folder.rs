//! The folder of a dataset: made, recognised, refused if another job made it.

use std::fs;
use std::io;
use std::path::{Path, PathBuf};

use super::shard::write_whole;
use crate::config::Job;
use crate::config::diagnostic::Report;
use crate::plan::{Plan, usage};

/// Names in a dataset's folder that are ours to write and, with `--overwrite`, to remove.
/// job.toml goes last: while it is there, what remains is known to be ours.
const FILES: [&str; 4] = ["README.md", "dataset.json", "wids.json", "job.toml"];
const FOLDERS: [&str; 2] = ["data", "stats"];

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
    if overwrite {
        clear(root).map_err(io(root))?;
    }
    let job_path = root.join("job.toml");
    let there = match fs::read_to_string(&job_path) {
        Ok(text) => Some(text),
        Err(error) if error.kind() == io::ErrorKind::NotFound => None,
        Err(error) => return Err(Refused::Io(job_path, error)),
    };
    match there {
        Some(text) => {
            let differs = differences(&text, &plan.job);
            if !differs.is_empty() {
                let message = format!("{} holds a dataset of another job: {}", root.display(), differs.join("; "));
                let help = "choose another folder with --out, or replace that dataset with --overwrite";
                return Err(Refused::Usage(usage(message, help)));
            }
        }
        None if is_foreign(root).map_err(io(root))? => {
            let message = format!("{} is not empty and holds no dataset of gelsim", root.display());
            return Err(Refused::Usage(usage(message, "choose a new or empty folder with --out")));
        }
        None => {}
    }
    for folder in FOLDERS {
        let path = root.join(folder);
        fs::create_dir_all(&path).map_err(io(&path))?;
    }
    if !job_path.exists() {
        let text = resolved_job(root, plan).map_err(io(&job_path))?;
        write_whole(&job_path, text.as_bytes()).map_err(io(&job_path))?;
    }
    Ok(())
}

/// True if the folder has something in it that may not be a dataset's.
fn is_foreign(root: &Path) -> io::Result<bool> {
    let entries = match fs::read_dir(root) {
        Ok(entries) => entries,
        Err(error) if error.kind() == io::ErrorKind::NotFound => return Ok(false),
        Err(error) => return Err(error),
    };
    for entry in entries {
        let name = entry?.file_name();
        let name = name.to_string_lossy();
        // A run that was killed right at its start leaves these.
        let ours = FOLDERS.contains(&&*name) || name.starts_with(".job.toml.");
        if !ours {
            return Ok(true);
        }
    }
    Ok(false)
}

/// Removes the dataset in `root`, if `job.toml` says that there is one, and nothing else.
fn clear(root: &Path) -> io::Result<()> {
    if !root.join("job.toml").exists() {
        return Ok(());
    }
    let absent_is_fine = |result: io::Result<()>| match result {
        Err(error) if error.kind() != io::ErrorKind::NotFound => Err(error),
        _ => Ok(()),
    };
    for folder in FOLDERS {
        absent_is_fine(fs::remove_dir_all(root.join(folder)))?;
    }
    for file in FILES {
        absent_is_fine(fs::remove_file(root.join(file)))?;
    }
    Ok(())
}

/// The text of `job.toml`: every default written out, paths relative to `root`, which must exist.
fn resolved_job(root: &Path, plan: &Plan) -> io::Result<String> {
    let root = root.canonicalize()?;
    let relative = |path: &str| -> io::Result<String> {
        let path = Path::new(path).canonicalize()?;
        let relative = pathdiff::diff_paths(&path, &root).unwrap_or(path);
        Ok(relative.to_string_lossy().replace('\\', "/"))
    };
    let mut job = plan.job.clone();
    for object in &mut job.object {
        object.path = object.path.as_deref().map(relative).transpose()?;
    }
    job.sensor.background = job.sensor.background.as_deref().map(relative).transpose()?;
    let text = toml::to_string(&job).map_err(io::Error::other)?;
    let version = env!("CARGO_PKG_VERSION");
    Ok(format!("# The job of this dataset with every default written out, resolved by gelsim {version}.\n\n{text}"))
}

/// What differs between the job of a dataset and `job`, by dotted key; paths aside, because contents have hashes.
fn differences(there: &str, job: &Job) -> Vec<String> {
    let version = format!("resolved by gelsim {}.", env!("CARGO_PKG_VERSION"));
    let first = there.lines().next().unwrap_or_default();
    if !first.ends_with(&version) {
        return vec![format!("its job.toml says `{first}`, this is version {}", env!("CARGO_PKG_VERSION"))];
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
                if is_path(&path) {
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
        (a, b) if a != b => found.push(format!("{path} is {a} there and {b} here")),
        _ => {}
    }
}

fn is_path(dotted: &str) -> bool {
    dotted == "sensor.background" || (dotted.starts_with("object.") && dotted.ends_with(".path"))
}
