//! Prepares the folder of a dataset: makes it, recognises it, or refuses it if another job made it.

use gelsim_files::fail_point::Step;
use std::collections::BTreeSet;
use std::fs;
use std::io;
use std::path::{Path, PathBuf};
use std::sync::{Mutex, PoisonError};
use std::time::SystemTime;

use super::cleanup::{self, DESCRIPTION_FILES, SHARD_FOLDERS, has_foreign_entries, lock_path};
use super::dataset_error::DatasetError;
use super::lock::Lock;
use super::self_hash::{BLANK_HASH, has_valid_self_hash, insert_self_hash};
use super::stats::ShardStats;
use super::versioned::Versioned;
use gelsim_core::fidelity::Fidelity;
use gelsim_files::diagnostic::user_error;
use gelsim_files::input::{self, RelativePaths};
use gelsim_files::write::write_atomically;
use gelsim_job::config::document::{MAX_READ_BYTES, RESOLVED_HEADER};
use gelsim_job::plan::{Plan, file_stem};

/// What stands before the file's own hash in a job.toml.
const SELF_HASH_MARK: &str = "# SHA-256 of this file with 64 zeros in this place: ";

/// Refuses a folder that the plan may not use: what is no folder, holds another dataset that is not replaced, or has an
/// entry that is a link. Changes nothing.
pub fn require_usable_folder(root: &Path, plan: &Plan, replaced: Replaced) -> Result<(), DatasetError> {
    let refused = |message: String, help: &str| Err(DatasetError::Usage(user_error(message, help)));
    if root.as_os_str().is_empty() {
        return refused(String::from("the output folder has no name"), "choose a new or empty folder with --out");
    }
    if root.symlink_metadata().is_ok() && !root.is_dir() {
        return refused(format!("{} is not a folder", root.display()), "choose a new or empty folder with --out");
    }
    let on_the_way = root.ancestors().skip(1).find(|above| above.exists() || above.as_os_str().is_empty());
    if let Some(file) = on_the_way.filter(|above| above.exists() && !above.is_dir()) {
        return refused(format!("{} is not a folder", file.display()), "choose a new or empty folder with --out");
    }
    if let Some(strange) = cleanup::find_strange_entry(root).map_err(|(path, error)| DatasetError::Io(path, error))? {
        return refused(
            format!("{strange}, which is not what gelsim made there"),
            "remove it, or choose another folder with --out; gelsim writes nothing through a link",
        );
    }
    check_folder(root, plan, replaced != Replaced::Nothing).map(drop)
}

/// Prepares `root` for `plan`: a new folder, an empty one, or one that the same job began. No entry in it may be a link
/// that leads out of it. If the job differs from the recorded one only by more samples, it takes the folder over, and
/// the earlier number of samples is returned. Paths in the new job.toml are relative to `seen_from`, which need not
/// exist.
pub fn prepare_folder(
    root: &Path,
    seen_from: &Path,
    plan: &Plan,
    replaced: Replaced,
) -> Result<Option<u64>, DatasetError> {
    let overwrite = replaced != Replaced::Nothing;
    let io = |path: &Path| {
        let path = path.to_owned();
        move |error| DatasetError::Io(path, error)
    };
    let failed = |(path, error)| DatasetError::Io(path, error);
    let refused = |message: String, help: &str| Err(DatasetError::Usage(user_error(message, help)));
    // Check before anything is made in the folder, and again under the lock.
    require_usable_folder(root, plan, replaced)?;
    for folder in SHARD_FOLDERS {
        let path = root.join(folder);
        fs::create_dir_all(&path).map_err(io(&path))?;
    }
    Step::FoldersMade.pause_if_requested(root);
    let lock = lock_path(root);
    let _alone = Lock::acquire(&lock).map_err(io(&lock))?;
    Step::DatasetLocked.pause_if_requested(root);
    // Another process may have begun a dataset since the first check.
    let found = check_folder(root, plan, overwrite)?;
    // What is there of the same job is what the other parts have made.
    let overwrite = overwrite && !(replaced == Replaced::OtherJobs && found == FolderState::SameJob);
    if overwrite && found != FolderState::Empty {
        if let Err(writer) = cleanup::remove_dataset(root).map_err(failed)? {
            let message = format!("{} cannot be replaced: {writer}", root.display());
            return refused(message, "wait until it is done, or stop it");
        }
        for folder in SHARD_FOLDERS {
            let path = root.join(folder);
            fs::create_dir_all(&path).map_err(io(&path))?;
        }
    }
    let is_ours = found == FolderState::SameJob && !overwrite;
    let grown_from = recorded_samples(root).filter(|there| is_ours && *there < plan.layout.sample_count());
    if !is_ours || grown_from.is_some() {
        // These go first, so that a description never stands beside a job that asks for more samples.
        for name in DESCRIPTION_FILES.into_iter().chain([cleanup::REPORT_FILE]) {
            let path = root.join(name);
            cleanup::remove_path(&path).map_err(io(&path))?;
            Step::OldFileRemoved.pause_if_requested(&path);
        }
        let job_path = root.join("job.toml");
        let text = match format_resolved_job(seen_from, plan).map_err(io(&job_path))? {
            Ok(text) => text,
            Err(path) => {
                let message = format!("{} is not UTF-8, so that no job can hold it", path.display());
                return refused(message, "rename the file or its folders");
            }
        };
        write_atomically(&job_path, text.as_bytes()).map_err(io(&job_path))?;
    }
    Ok(grown_from)
}

/// Datasets that a new one replaces in its folder.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Replaced {
    /// None.
    Nothing,
    /// Those of other jobs.
    OtherJobs,
    /// All.
    All,
}

/// What is in the folder where a dataset will be written.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum FolderState {
    /// Nothing that counts.
    Empty,
    /// A dataset that the plan continues.
    SameJob,
    /// Shards of the plan, beside a job.toml that is lost or was changed.
    LostJob,
    /// A dataset of another job, which will be replaced.
    OtherJob,
}

/// Checks what is in the folder, and refuses one that the plan may not use.
fn check_folder(root: &Path, plan: &Plan, overwrite: bool) -> Result<FolderState, DatasetError> {
    let refused = |message: String, help: &str| Err(DatasetError::Usage(user_error(message, help)));
    let job_path = root.join("job.toml");
    let text = match input::read_without_links(&job_path, MAX_READ_BYTES) {
        Ok(bytes) => Some(bytes),
        Err(error) if error.kind() == io::ErrorKind::NotFound => None,
        Err(error) => return Err(DatasetError::Io(job_path, error)),
    };
    let text = text.map(|bytes| String::from_utf8_lossy(&bytes).into_owned());
    let begun = text.as_ref().filter(|text| text.starts_with(RESOLVED_HEADER));
    let elsewhere = "choose another folder with --out, or replace that dataset with --overwrite";
    let differs = begun.map(|text| list_differences(text, root, plan)).unwrap_or_default();
    let another =
        |differs: &[String]| format!("{} holds a dataset of another job: {}", root.display(), differs.join("; "));
    if begun.is_some_and(|text| is_unmodified(text)) {
        return match differs.is_empty() {
            true => Ok(FolderState::SameJob),
            false if overwrite => Ok(FolderState::OtherJob),
            false => refused(another(&differs), elsewhere),
        };
    }
    // The job.toml does not say whose dataset it is, so the shards must.
    let shards = read_fingerprints(root)?;
    match (shards.is_empty(), begun) {
        (false, _) if overwrite => Ok(FolderState::OtherJob),
        (false, _) if shards.iter().all(|found| *found == plan.fingerprint) => Ok(FolderState::LostJob),
        (false, _) => {
            let what = if text.is_some() { "is not what was written" } else { "is lost" };
            let why = if differs.is_empty() { String::new() } else { format!(": {}", differs.join("; ")) };
            let message = format!("{} holds shards of another job, and its job.toml {what}{why}", root.display());
            refused(message, elsewhere)
        }
        (true, Some(_)) if overwrite || differs.is_empty() => Ok(FolderState::LostJob),
        (true, Some(_)) => refused(another(&differs), elsewhere),
        (true, None)
            if text.is_none()
                && !has_foreign_entries(root).map_err(|error| DatasetError::Io(root.to_owned(), error))? =>
        {
            Ok(FolderState::Empty)
        }
        // Another process may have begun the dataset since job.toml was looked for.
        (true, None) if text.is_none() && job_path.exists() => check_folder(root, plan, overwrite),
        (true, None) => {
            let message = format!("{} is not empty and holds no dataset of gelsim", root.display());
            refused(message, "choose a new or empty folder with --out")
        }
    }
}

/// Reads which jobs, by their fingerprints, the shards in the folder belong to.
fn read_fingerprints(root: &Path) -> Result<BTreeSet<String>, DatasetError> {
    let stats = cleanup::list_stats_files(root).map_err(|(path, error)| DatasetError::Io(path, error))?;
    let read = |path: PathBuf| Ok(ShardStats::read(&path)?.map(|stats| stats.fingerprint));
    stats.into_iter().filter_map(|path| read(path).transpose()).collect()
}

/// The job.toml that was last found to be a plan's. The same file needs no second look, which takes long if the job has
/// many objects.
#[derive(Default)]
pub struct KnownJob(Mutex<Option<FileIdentity>>);

/// What tells a file from one that replaced it: its number, its size and its time of change.
#[derive(PartialEq, Eq)]
struct FileIdentity(u64, u64, SystemTime);

impl FileIdentity {
    fn of(path: &Path) -> Option<Self> {
        let metadata = fs::symlink_metadata(path).ok()?;
        #[cfg(unix)]
        let number = std::os::unix::fs::MetadataExt::ino(&metadata);
        #[cfg(not(unix))]
        let number = 0;
        Some(Self(number, metadata.len(), metadata.modified().ok()?))
    }
}

/// Refuses if the dataset in `root` is no longer the plan's, since another run may have replaced it. The caller holds
/// the dataset's lock.
pub fn check_still_ours(root: &Path, plan: &Plan, known: &KnownJob) -> Result<(), DatasetError> {
    let path = root.join("job.toml");
    let identity = FileIdentity::of(&path);
    let mut known = known.0.lock().unwrap_or_else(PoisonError::into_inner);
    if identity.is_some() && *known == identity {
        return Ok(());
    }
    let text = match input::read_without_links(&path, MAX_READ_BYTES) {
        Ok(bytes) => String::from_utf8_lossy(&bytes).into_owned(),
        Err(error) if error.kind() == io::ErrorKind::NotFound => String::new(),
        Err(error) => return Err(DatasetError::Io(path, error)),
    };
    let mut differs = list_differences(&text, root, plan);
    // Another run may have raised the number of samples.
    differs.retain(|key| !key.starts_with("dataset.samples "));
    if is_unmodified(&text) && differs.is_empty() {
        *known = identity;
        return Ok(());
    }
    let message = format!("{} was taken over by a run of another job: {}", root.display(), differs.join("; "));
    Err(DatasetError::Usage(user_error(message, "choose another folder with --out")))
}

/// Returns true if a text is that of a job.toml exactly as it was written.
pub fn is_unmodified(text: &str) -> bool {
    text.starts_with(RESOLVED_HEADER) && has_valid_self_hash(text.as_bytes(), SELF_HASH_MARK)
}

/// Returns the text of the job.toml of a dataset in `root`, or `None` if there is none.
pub fn recorded_text(root: &Path) -> Option<String> {
    let bytes = input::read_without_links(&root.join("job.toml"), MAX_READ_BYTES).ok()?;
    String::from_utf8(bytes).ok().filter(|text| text.starts_with(RESOLVED_HEADER))
}

/// Returns the fidelity level with which the dataset in `root` was begun, or `None` if there is none.
pub fn recorded_fidelity(root: &Path) -> Option<Fidelity> {
    let job: toml::Table = recorded_text(root)?.parse().ok()?;
    let name = job.get("fidelity")?.as_str()?;
    Fidelity::ALL.into_iter().find(|level| level.name() == name)
}

/// Returns the number of samples that the dataset in `root` has or will have, or `None` if there is none.
pub fn recorded_samples(root: &Path) -> Option<u64> {
    parse_sample_count(&recorded_text(root)?.parse().ok()?)
}

fn parse_sample_count(job: &toml::Table) -> Option<u64> {
    job.get("dataset")?.get("samples")?.as_integer()?.try_into().ok()
}

/// Returns the version of gelsim that made the dataset in `root`, or `None` if there is none.
pub fn recorded_version(root: &Path) -> Option<String> {
    parse_version(&recorded_text(root)?).map(str::to_owned)
}

/// Returns the version in the first line of a resolved job, or `None` for any other text.
fn parse_version(job: &str) -> Option<&str> {
    Some(job.lines().next()?.strip_prefix(RESOLVED_HEADER)?.trim().trim_end_matches('.'))
}

/// Formats `job.toml`: every default written out, paths relative to `root`. The inner error is a path that no text can
/// hold.
fn format_resolved_job(root: &Path, plan: &Plan) -> io::Result<Result<String, PathBuf>> {
    let mut paths = RelativePaths::seen_from(root)?;
    let mut job = plan.job().clone();
    for path in job.paths_mut() {
        match paths.make_relative(Path::new(path.as_str()))?.into_os_string().into_string() {
            Ok(text) => *path = if cfg!(windows) { text.replace('\\', "/") } else { text },
            Err(path) => return Ok(Err(path.into())),
        }
    }
    let text = job.to_toml()?;
    let text = format!("{RESOLVED_HEADER} {}.\n{SELF_HASH_MARK}{BLANK_HASH}\n\n{text}", env!("CARGO_PKG_VERSION"));
    Ok(Ok(insert_self_hash(&text, SELF_HASH_MARK)))
}

/// Lists what differs between the recorded job and the plan's, by dotted key and, if a file changed, by its name. More
/// samples are no difference. Nor are folders, since contents are compared by their hashes.
fn list_differences(recorded: &str, root: &Path, plan: &Plan) -> Vec<String> {
    // The usual case, without reading the text.
    if format_resolved_job(root, plan).is_ok_and(|text| text.is_ok_and(|text| text == recorded)) {
        return Vec::new();
    }
    match parse_version(recorded) {
        Some(env!("CARGO_PKG_VERSION")) => {}
        version => {
            let version = version.unwrap_or("of another time");
            return vec![format!("gelsim {version} made it, this is {}", env!("CARGO_PKG_VERSION"))];
        }
    }
    let Ok(recorded) = recorded.parse::<toml::Table>() else {
        return vec![String::from("its job.toml is not valid TOML")];
    };
    let Some(here) = plan.job().to_toml().ok().and_then(|text| text.parse::<toml::Table>().ok()) else {
        return Vec::new();
    };
    let mut found = Vec::new();
    compare_values("", &toml::Value::Table(recorded), &toml::Value::Table(here), &mut found);
    if found.len() > MAX_NAMED {
        let more = found.len() - MAX_NAMED;
        found.truncate(MAX_NAMED);
        found.push(format!("and {more} more keys"));
    }
    // A sensor file's keys are in the job as if they stood there, so name the file, too.
    if let Some(file) = &plan.sensor_file
        && found.iter().any(|key| ["sensor.", "markers.", "camera."].iter().any(|table| key.starts_with(table)))
    {
        found.push(format!("the sensor file is {}", file.display()));
    }
    found
}

/// Most differences that are named.
const MAX_NAMED: usize = 6;

fn compare_values(path: &str, recorded: &toml::Value, here: &toml::Value, found: &mut Vec<String>) {
    let below = |key: &str| if path.is_empty() { key.to_owned() } else { format!("{path}.{key}") };
    match (recorded, here) {
        (toml::Value::Table(a), toml::Value::Table(b)) => {
            let keys: std::collections::BTreeSet<&String> = a.keys().chain(b.keys()).collect();
            for key in keys {
                let path = below(key);
                let is_object = path.starts_with("object.");
                let image = path.ends_with(".path") && !is_object;
                // Where meshes are found does not matter, since their contents have hashes.
                let packages = path.ends_with(".packages") && is_object;
                if image || names_hashed_file(&path) || packages {
                    continue;
                }
                if let Some(file) = find_changed_file(key, a, b) {
                    found.push(format!("{file} has changed: {path} is {} there and {} here", a[key], b[key]));
                    continue;
                }
                match (a.get(key), b.get(key)) {
                    (Some(a), Some(b)) => compare_values(&path, a, b, found),
                    (Some(a), None) => found.push(format!("{path} is {a} there and absent here")),
                    (None, Some(b)) => found.push(format!("{path} is absent there and {b} here")),
                    (None, None) => {}
                }
            }
        }
        (toml::Value::Array(a), toml::Value::Array(b)) if a.len() == b.len() && a.iter().any(toml::Value::is_table) => {
            for (i, (a, b)) in a.iter().zip(b).enumerate() {
                compare_values(&below(&i.to_string()), a, b, found);
            }
        }
        (toml::Value::Array(a), toml::Value::Array(b)) if a.len() != b.len() => {
            found.push(format!("{path} has {} elements there and {} here", a.len(), b.len()));
        }
        // A dataset may grow.
        (toml::Value::Integer(a), toml::Value::Integer(b)) if path == "dataset.samples" && a < b => {}
        // The name of a mesh file is the object's name in the labels, so only the stem counts.
        (toml::Value::String(a), toml::Value::String(b))
            if path.starts_with("object.") && path.ends_with(".path") && file_stem(a) == file_stem(b) => {}
        (a, b) if a != b => found.push(format!("{path} is {a} there and {b} here")),
        _ => {}
    }
}

/// Returns true for a key of a sensor, of the other finger's, too, that names a file whose hash stands beside it.
fn names_hashed_file(path: &str) -> bool {
    let of_sensor = path.strip_prefix("gripper.right.").or_else(|| path.strip_prefix("sensor.")).unwrap_or(path);
    let is_sensors = of_sensor != path && ["background", "calibration", "pins.layout.file"].contains(&of_sensor);
    is_sensors || of_sensor == "markers.file"
}

/// Returns the file, by its path in the plan's job, whose hash at `key` differs between two tables; `None` if `key` is
/// no hash, or the hashes are equal.
fn find_changed_file<'a>(key: &str, recorded: &toml::Table, here: &'a toml::Table) -> Option<&'a str> {
    let name = match key {
        "sha256" => "path",
        "background_sha256" => "background",
        "calibration_sha256" => "calibration",
        "file_sha256" => "file",
        _ => return None,
    };
    let differs = recorded.get(key)? != here.get(key)?;
    here.get(name)?.as_str().filter(|_| differs)
}
