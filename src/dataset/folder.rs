//! The folder of a dataset: made, recognised, refused if another job made it.

use gelsim_files::fail_point::Step;
use std::collections::BTreeSet;
use std::fs;
use std::io;
use std::path::{Path, PathBuf};

use super::cleanup::{self, DESCRIPTIONS, FOLDERS, is_foreign, lock};
use super::lock::Lock;
use super::refused::Refused;
use super::seal::{BLANK, is_sealed, sealed};
use super::stats::Stats;
use super::versioned::Versioned;
use gelsim_core::fidelity::Fidelity;
use gelsim_files::diagnostic::user_error;
use gelsim_files::input;
use gelsim_files::write::write_whole;
use gelsim_job::config::document::{MOST_READ, RESOLVED};
use gelsim_job::plan::{Plan, stem};

/// What stands before the seal in a job.toml.
const SEAL: &str = "# SHA-256 of this file with 64 zeros in this place: ";

/// Makes `root` ready for `plan`: a new folder, an empty one, or one that the same job began. Nothing in it may be a
/// link that leads out of it. A job that differs from the recorded one only in having more samples takes the folder
/// over: then the number of samples before. Paths in its job.toml are relative to `seen_from`, which need not be there.
pub fn prepare(root: &Path, seen_from: &Path, plan: &Plan, overwrite: bool) -> Result<Option<u64>, Refused> {
    let io = |path: &Path| {
        let path = path.to_owned();
        move |error| Refused::Io(path, error)
    };
    let failed = |(path, error)| Refused::Io(path, error);
    let refused = |message: String, help: &str| Err(Refused::Usage(user_error(message, help)));
    if root.as_os_str().is_empty() {
        return refused(String::from("the output folder has no name"), "choose a new or empty folder with --out");
    }
    if root.symlink_metadata().is_ok() && !root.is_dir() {
        return refused(format!("{} is not a folder", root.display()), "choose a new or empty folder with --out");
    }
    if let Some(strange) = cleanup::strange(root).map_err(failed)? {
        return refused(
            format!("{strange}, which is not what gelsim made there"),
            "remove it, or choose another folder with --out; gelsim writes nothing through a link",
        );
    }
    // Before anything is made there.
    admitted(root, plan, overwrite)?;
    for folder in FOLDERS {
        let path = root.join(folder);
        fs::create_dir_all(&path).map_err(io(&path))?;
    }
    Step::FoldersMade.reached(root);
    let lock = lock(root);
    let _alone = Lock::wait(&lock).map_err(io(&lock))?;
    Step::DatasetLocked.reached(root);
    // Another process may have begun a dataset just now.
    let found = admitted(root, plan, overwrite)?;
    if overwrite && found != There::Nothing {
        if let Err(writer) = cleanup::clear(root).map_err(failed)? {
            let message = format!("{} cannot be replaced: {writer}", root.display());
            return refused(message, "wait until it is done, or stop it");
        }
        for folder in FOLDERS {
            let path = root.join(folder);
            fs::create_dir_all(&path).map_err(io(&path))?;
        }
    }
    let is_ours = found == There::Ours && !overwrite;
    let grown_from = recorded_samples(root).filter(|there| is_ours && *there < plan.layout.samples());
    if !is_ours || grown_from.is_some() {
        // First, so that none ever stands beside a job that asks for more.
        for name in DESCRIPTIONS.into_iter().chain([cleanup::REPORT]) {
            let path = root.join(name);
            cleanup::remove(&path).map_err(io(&path))?;
            Step::OldFileRemoved.reached(&path);
        }
        let job_path = root.join("job.toml");
        let text = match resolved_job(seen_from, plan).map_err(io(&job_path))? {
            Ok(text) => text,
            Err(path) => {
                let message = format!("{} is not UTF-8, so that no job can hold it", path.display());
                return refused(message, "rename the file or its folders");
            }
        };
        write_whole(&job_path, text.as_bytes()).map_err(io(&job_path))?;
    }
    Ok(grown_from)
}

/// What is in the folder of a dataset to be.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum There {
    /// Nothing that counts.
    Nothing,
    /// A dataset that the plan goes on with.
    Ours,
    /// Shards of the plan beside a job.toml that is lost or not as it was written.
    JobLost,
    /// A dataset of another job.
    Another,
}

/// Refuses a folder that the plan has no right to.
fn admitted(root: &Path, plan: &Plan, overwrite: bool) -> Result<There, Refused> {
    let refused = |message: String, help: &str| Err(Refused::Usage(user_error(message, help)));
    let job_path = root.join("job.toml");
    let text = match input::read_inside(&job_path, MOST_READ) {
        Ok(bytes) => Some(bytes),
        Err(error) if error.kind() == io::ErrorKind::NotFound => None,
        Err(error) => return Err(Refused::Io(job_path, error)),
    };
    let text = text.map(|bytes| String::from_utf8_lossy(&bytes).into_owned());
    let begun = text.as_ref().filter(|text| text.starts_with(RESOLVED));
    let elsewhere = "choose another folder with --out, or replace that dataset with --overwrite";
    let differs = begun.map(|text| differences(text, plan)).unwrap_or_default();
    let another =
        |differs: &[String]| format!("{} holds a dataset of another job: {}", root.display(), differs.join("; "));
    if begun.is_some_and(|text| is_as_written(text)) {
        return match differs.is_empty() {
            true => Ok(There::Ours),
            false if overwrite => Ok(There::Another),
            false => refused(another(&differs), elsewhere),
        };
    }
    // What is left says whose it is.
    let shards = fingerprints(root)?;
    match (shards.is_empty(), begun) {
        (false, _) if overwrite => Ok(There::Another),
        (false, _) if shards.iter().all(|found| *found == plan.fingerprint) => Ok(There::JobLost),
        (false, _) => {
            let what = if text.is_some() { "is not what was written" } else { "is lost" };
            let why = if differs.is_empty() { String::new() } else { format!(": {}", differs.join("; ")) };
            let message = format!("{} holds shards of another job, and its job.toml {what}{why}", root.display());
            refused(message, elsewhere)
        }
        (true, Some(_)) if overwrite || differs.is_empty() => Ok(There::JobLost),
        (true, Some(_)) => refused(another(&differs), elsewhere),
        (true, None) if text.is_none() && !is_foreign(root).map_err(|error| Refused::Io(root.to_owned(), error))? => {
            Ok(There::Nothing)
        }
        // Another process may have begun the dataset just now.
        (true, None) if text.is_none() && job_path.exists() => admitted(root, plan, overwrite),
        (true, None) => {
            let message = format!("{} is not empty and holds no dataset of gelsim", root.display());
            refused(message, "choose a new or empty folder with --out")
        }
    }
}

/// Of which jobs the shards in the folder are.
fn fingerprints(root: &Path) -> Result<BTreeSet<String>, Refused> {
    let stats = cleanup::stats(root).map_err(|(path, error)| Refused::Io(path, error))?;
    let read = |path: PathBuf| Ok(Stats::read(&path)?.map(|stats| stats.fingerprint));
    stats.into_iter().filter_map(|path| read(path).transpose()).collect()
}

/// Refuses if the dataset in `root` is no longer the plan's: another run may have replaced it. Under the dataset's lock.
pub fn still_ours(root: &Path, plan: &Plan) -> Result<(), Refused> {
    let path = root.join("job.toml");
    let text = match input::read_inside(&path, MOST_READ) {
        Ok(bytes) => String::from_utf8_lossy(&bytes).into_owned(),
        Err(error) if error.kind() == io::ErrorKind::NotFound => String::new(),
        Err(error) => return Err(Refused::Io(path, error)),
    };
    let mut differs = differences(&text, plan);
    // Another run may have made it larger.
    differs.retain(|key| !key.starts_with("dataset.samples "));
    if is_as_written(&text) && differs.is_empty() {
        return Ok(());
    }
    let message = format!("{} was taken over by a run of another job: {}", root.display(), differs.join("; "));
    Err(Refused::Usage(user_error(message, "choose another folder with --out")))
}

/// True if it is the text of a job.toml, byte for byte as it was written.
pub fn is_as_written(text: &str) -> bool {
    text.starts_with(RESOLVED) && is_sealed(text.as_bytes(), SEAL)
}

/// The text of the job.toml of a dataset in `root`, if there is one.
pub fn recorded_text(root: &Path) -> Option<String> {
    let bytes = input::read_inside(&root.join("job.toml"), MOST_READ).ok()?;
    String::from_utf8(bytes).ok().filter(|text| text.starts_with(RESOLVED))
}

/// The fidelity level that the dataset in `root` was begun with, if there is one.
pub fn recorded_fidelity(root: &Path) -> Option<Fidelity> {
    let job: toml::Table = recorded_text(root)?.parse().ok()?;
    let name = job.get("fidelity")?.as_str()?;
    Fidelity::ALL.into_iter().find(|level| level.name() == name)
}

/// The number of samples that the dataset in `root` has or is to have.
pub fn recorded_samples(root: &Path) -> Option<u64> {
    samples(&recorded_text(root)?.parse().ok()?)
}

fn samples(job: &toml::Table) -> Option<u64> {
    job.get("dataset")?.get("samples")?.as_integer()?.try_into().ok()
}

/// The version of gelsim that made the dataset in `root`.
pub fn recorded_version(root: &Path) -> Option<String> {
    version(&recorded_text(root)?).map(str::to_owned)
}

/// What the first line of a resolved job says; `None` of another text.
fn version(job: &str) -> Option<&str> {
    Some(job.lines().next()?.strip_prefix(RESOLVED)?.trim().trim_end_matches('.'))
}

/// The text of `job.toml`: every default written out, paths relative to `root`. The inner error is a path that no text can
/// hold.
fn resolved_job(root: &Path, plan: &Plan) -> io::Result<Result<String, PathBuf>> {
    let root = canonical(root)?;
    let mut job = plan.job().clone();
    for path in job.paths_mut() {
        match relative(path, &root)?.into_os_string().into_string() {
            Ok(text) => *path = if cfg!(windows) { text.replace('\\', "/") } else { text },
            Err(path) => return Ok(Err(path.into())),
        }
    }
    let text = job.to_toml()?;
    let text = format!("{RESOLVED} {}.\n{SEAL}{BLANK}\n\n{text}", env!("CARGO_PKG_VERSION"));
    Ok(Ok(sealed(&text, SEAL)))
}

/// The path without links, as far as it is there.
fn canonical(path: &Path) -> io::Result<PathBuf> {
    let path = std::path::absolute(path)?;
    match (path.canonicalize(), path.parent(), path.file_name()) {
        (Err(error), Some(folder), Some(name)) if error.kind() == io::ErrorKind::NotFound => {
            Ok(canonical(folder)?.join(name))
        }
        (found, ..) => found,
    }
}

fn relative(path: &str, root: &Path) -> io::Result<PathBuf> {
    let path = std::path::absolute(path)?;
    // A link keeps its name: an object is called by it.
    let path = match (path.parent(), path.file_name()) {
        (Some(folder), Some(name)) => folder.canonicalize()?.join(name),
        _ => path,
    };
    Ok(pathdiff::diff_paths(&path, root).unwrap_or(path))
}

/// What differs between the job of a dataset and the plan's, more samples aside, by dotted key and, where a file
/// changed, by its name; folders aside, because contents have hashes.
fn differences(there: &str, plan: &Plan) -> Vec<String> {
    match version(there) {
        Some(env!("CARGO_PKG_VERSION")) => {}
        version => {
            let version = version.unwrap_or("of another time");
            return vec![format!("gelsim {version} made it, this is {}", env!("CARGO_PKG_VERSION"))];
        }
    }
    let Ok(there) = there.parse::<toml::Table>() else {
        return vec![String::from("its job.toml is not valid TOML")];
    };
    let Some(here) = plan.job().to_toml().ok().and_then(|text| text.parse::<toml::Table>().ok()) else {
        return Vec::new();
    };
    let mut found = Vec::new();
    compare("", &toml::Value::Table(there), &toml::Value::Table(here), &mut found);
    if found.len() > MOST_NAMED {
        let more = found.len() - MOST_NAMED;
        found.truncate(MOST_NAMED);
        found.push(format!("and {more} more keys"));
    }
    // Its keys are in the job as if they had been written there.
    if let Some(file) = &plan.sensor_file
        && found.iter().any(|key| ["sensor.", "markers.", "camera."].iter().any(|table| key.starts_with(table)))
    {
        found.push(format!("the sensor file is {}", file.display()));
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
                let is_object = path.starts_with("object.");
                let image = path.ends_with(".path") && !is_object;
                // Where meshes are found says nothing of them.
                let packages = path.ends_with(".packages") && is_object;
                let file =
                    ["sensor.background", "sensor.calibration", "sensor.pins.layout.file"].contains(&path.as_str());
                if image || file || packages {
                    continue;
                }
                if let Some(file) = changed(key, a, b) {
                    found.push(format!("{file} has changed: {path} is {} there and {} here", a[key], b[key]));
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
        // A dataset may grow.
        (toml::Value::Integer(a), toml::Value::Integer(b)) if path == "dataset.samples" && a < b => {}
        // The name of a mesh is the object's in the labels.
        (toml::Value::String(a), toml::Value::String(b))
            if path.starts_with("object.") && path.ends_with(".path") && stem(a) == stem(b) => {}
        (a, b) if a != b => found.push(format!("{path} is {a} there and {b} here")),
        _ => {}
    }
}

/// The file, by its path here, whose hash is at `key` of two tables and differs between them.
fn changed<'a>(key: &str, there: &toml::Table, here: &'a toml::Table) -> Option<&'a str> {
    let name = match key {
        "sha256" => "path",
        "background_sha256" => "background",
        "calibration_sha256" => "calibration",
        _ => return None,
    };
    let differs = there.get(key)? != here.get(key)?;
    here.get(name)?.as_str().filter(|_| differs)
}
