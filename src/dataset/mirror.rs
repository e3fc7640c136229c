//! Mirrors a dataset in an object store as a folder on this machine. Every object is shown by its name and length, and
//! the small files that describe the dataset and its shards by their content, too.
//!
//! The code that generates and completes datasets works in that folder as in any other, and the changes then go to the
//! store: each shard in one piece, then its stats; the files that describe the dataset last. Only the length of a shard
//! in the store is kept here, so that the disk never holds more shards than there are threads.

use crate::container::ShardContainer;
use std::collections::{BTreeMap, BTreeSet};
use std::fs::{self, File};
use std::io;
use std::path::{Path, PathBuf};
use std::sync::{Mutex, PoisonError};

use rayon::prelude::*;

use super::cleanup::{DATA_FOLDER, DESCRIPTION_FILES, SHARD_FOLDERS};
use super::dataset_error::DatasetError;
use super::finalize::{Finalized, check_same_version, finalize};
use super::folder::{KnownJob, check_still_ours};
use super::paths::ShardPaths;
use super::recorded::RecordedDataset;
use super::stats::ShardStats;
use super::verify::{CheckLevel, DatasetFinding};
use super::versioned::Versioned;
use gelsim_files::input::{self, MAX_METADATA_BYTES};
use gelsim_files::store::{Store, StoreEntry};
use gelsim_files::write::{ignore_not_found, remove_abandoned_partials};
use gelsim_job::layout::{Layout, Shard};
use gelsim_job::plan::Plan;

/// Name of mirrors' folders. A dot stands before it, and the number of the process behind it.
const FOLDER_NAME: &str = "gelsim-store";

/// The file that says to which job a dataset belongs.
const JOB_FILE: &str = "job.toml";

/// The folder that mirrors a dataset in a store. It is removed when this is dropped.
pub struct StoreMirror<'a> {
    store: &'a dyn Store,
    root: PathBuf,
    /// Names of the objects of which the folder has a file.
    shown: Mutex<BTreeSet<String>>,
    /// What was found of the job.
    known_job: KnownJob,
    /// The job in the store, as it was last read.
    job: Mutex<Option<Vec<u8>>>,
    /// The folder, locked to show other hosts that it is in use.
    _held: File,
}

impl<'a> StoreMirror<'a> {
    /// Makes an empty folder in `beside`, and first removes what killed runs left there.
    pub fn create(store: &'a dyn Store, beside: &Path) -> Result<Self, DatasetError> {
        let root = beside.join(format!(".{FOLDER_NAME}.{}.partial", std::process::id()));
        let begin = || {
            fs::create_dir_all(beside)?;
            remove_abandoned_partials(beside, |name| name == FOLDER_NAME)?;
            fs::create_dir(&root)?;
            let held = File::open(&root)?;
            // Where there are no locks, only the number of the process tells.
            let _ = held.try_lock();
            Ok(held)
        };
        let held = begin().map_err(|error| DatasetError::Io(root.clone(), error))?;
        Ok(Self {
            store,
            root,
            shown: Mutex::default(),
            job: Mutex::default(),
            known_job: KnownJob::default(),
            _held: held,
        })
    }

    /// Returns the folder.
    pub fn root(&self) -> &Path {
        &self.root
    }

    /// Fills the folder with what is in the store. Of stats, only those whose names are `wanted` are read. If the store
    /// has no job, all are read, since only they say to which job the shards belong.
    pub fn fetch(&self, wanted: impl Fn(&str) -> bool + Sync) -> Result<(), DatasetError> {
        let (objects, folders) = self.store.list_top().map_err(|error| self.to_dataset_error("", error))?;
        for (name, length) in &objects {
            if folders.contains(name) {
                return Err(self.to_dataset_error(
                    name,
                    io::Error::other("is an object and a folder of others, which no disk can show"),
                ));
            }
            if name == JOB_FILE {
                *lock_mutex(&self.job) = self.copy_object(name)?;
            } else if DESCRIPTION_FILES.contains(&name.as_str()) {
                self.copy_object(name)?;
            } else {
                self.create_placeholder(name, *length)?;
            }
        }
        let has_job = lock_mutex(&self.job).is_some();
        for folder in folders {
            let path = self.root.join(&folder);
            fs::create_dir(&path).map_err(|error| DatasetError::Io(path, error))?;
            if SHARD_FOLDERS.contains(&folder.as_str()) {
                let listed = self.store.list(&folder).map_err(|error| self.to_dataset_error(&folder, error))?;
                self.show_objects(&listed, |name| !has_job || wanted(name))?;
            }
        }
        Ok(())
    }

    /// Adds objects of `data` and `stats` to the folder; of stats only those that are `wanted`.
    fn show_objects(&self, listed: &[StoreEntry], wanted: impl Fn(&str) -> bool + Sync) -> Result<(), DatasetError> {
        listed.par_iter().try_for_each(|(name, length)| {
            let is_stats = name.starts_with("stats/") && name.ends_with(".json");
            match is_stats {
                true if wanted(name) => self.copy_object(name).map(drop),
                true => Ok(()),
                false => self.create_placeholder(name, *length),
            }
        })
    }

    /// Adds an object with its content, and returns that; `None` if the object is gone.
    fn copy_object(&self, name: &str) -> Result<Option<Vec<u8>>, DatasetError> {
        let bytes = self.store.get(name, MAX_METADATA_BYTES).map_err(|error| self.to_dataset_error(name, error))?;
        if let Some(bytes) = &bytes {
            let path = self.root.join(name);
            fs::write(&path, bytes).map_err(|error| DatasetError::Io(path, error))?;
            lock_mutex(&self.shown).insert(name.to_owned());
        }
        Ok(bytes)
    }

    /// Adds an object as a sparse file of its length, which takes no room. For an object in a subfolder, only the
    /// subfolder is made.
    fn create_placeholder(&self, name: &str, length: u64) -> Result<(), DatasetError> {
        let mut parts = name.split('/');
        let path = self.root.join(parts.by_ref().take(2).collect::<Vec<_>>().join("/"));
        let below = parts.next().is_some();
        let made =
            if below { fs::create_dir_all(&path) } else { File::create(&path).and_then(|file| file.set_len(length)) };
        made.map_err(|error| DatasetError::Io(path, error))?;
        if !below {
            lock_mutex(&self.shown).insert(name.to_owned());
        }
        Ok(())
    }

    /// Brings to the store what was done in the folder to begin `plan`. Objects that were removed from the folder are
    /// removed from the store, the files that describe the dataset first; then the job is written.
    pub fn push_beginning(&self, plan: &Plan) -> Result<(), DatasetError> {
        let shown = lock_mutex(&self.shown).clone();
        let gone = |name: &&String| !self.root.join(name.as_str()).exists();
        // Files that describe the dataset are at the top; shards and stats are in folders.
        let (shards, files): (Vec<&String>, Vec<&String>) =
            shown.iter().filter(gone).partition(|name| name.contains('/'));
        files.iter().try_for_each(|name| self.remove_object(name))?;
        shards.par_iter().try_for_each(|name| self.remove_object(name))?;

        let path = self.root.join(JOB_FILE);
        let text =
            input::read_without_links(&path, MAX_METADATA_BYTES).map_err(|error| DatasetError::Io(path, error))?;
        let before = lock_mutex(&self.job).clone();
        if before.as_ref() == Some(&text) {
            return Ok(());
        }
        let failed = |error| self.to_dataset_error(JOB_FILE, error);
        let put = match before {
            // Another run may have begun just now, of the same job or of another: do not replace its job.
            None => self.store.put_new(JOB_FILE, text.clone()).map_err(failed)?,
            Some(_) => self.store.put(JOB_FILE, text.clone()).map(|()| true).map_err(failed)?,
        };
        if !put {
            return self.still_ours(plan);
        }
        *lock_mutex(&self.job) = Some(text);
        Ok(())
    }

    /// Refuses if the dataset in the store is no longer the plan's, since another run may have replaced it.
    pub fn still_ours(&self, plan: &Plan) -> Result<(), DatasetError> {
        let found =
            self.store.get(JOB_FILE, MAX_METADATA_BYTES).map_err(|error| self.to_dataset_error(JOB_FILE, error))?;
        let mut job = lock_mutex(&self.job);
        if *job != found {
            let path = self.root.join(JOB_FILE);
            let shown = match &found {
                Some(text) => fs::write(&path, text),
                None => ignore_not_found(fs::remove_file(&path)),
            };
            shown.map_err(|error| DatasetError::Io(path, error))?;
            *job = found;
        }
        check_still_ours(&self.root, plan, &self.known_job)
    }

    /// Brings a finished shard to the store, and then its stats. If the store has `older` stats, they are removed
    /// first, so that they never vouch for the new shard.
    pub fn push_shard(&self, paths: &ShardPaths, stats: &ShardStats, older: bool) -> Result<(), DatasetError> {
        let (data, stats_name) = (self.object_name(&paths.data), self.object_name(&paths.stats));
        if older {
            self.remove_object(&stats_name)?;
        }
        self.store.put_file(&data, &paths.data).map_err(|error| self.to_dataset_error(&data, error))?;
        self.create_placeholder(&data, stats.bytes)?;
        let text = fs::read(&paths.stats).map_err(|error| DatasetError::Io(paths.stats.clone(), error))?;
        self.store.put(&stats_name, text).map_err(|error| self.to_dataset_error(&stats_name, error))?;
        lock_mutex(&self.shown).insert(stats_name);
        Ok(())
    }

    /// Updates the folder with what others have put into the store or removed from it. Stats are read only once all
    /// shards are there, since nobody needs them earlier.
    pub fn refresh(&self, layout: &Layout) -> Result<(), DatasetError> {
        let mut found = BTreeMap::new();
        for folder in SHARD_FOLDERS {
            found.extend(self.store.list(folder).map_err(|error| self.to_dataset_error(folder, error))?);
        }
        let shards = (0..layout.shard_count()).map(|number| layout.shard(number).name());
        let is_there = |name: String| {
            found.contains_key(&format!("{DATA_FOLDER}/{name}.tar"))
                && found.contains_key(&format!("stats/{name}.json"))
        };
        let all = shards.into_iter().all(is_there);
        let shown = lock_mutex(&self.shown).clone();
        for name in shown.iter().filter(|name| name.contains('/') && !found.contains_key(*name)) {
            let path = self.root.join(name);
            ignore_not_found(fs::remove_file(&path)).map_err(|error| DatasetError::Io(path, error))?;
            lock_mutex(&self.shown).remove(name);
        }
        let data = |name: &String| name.starts_with(DATA_FOLDER);
        let changed: Vec<StoreEntry> =
            found.into_iter().filter(|(name, _)| data(name) || !shown.contains(name)).collect();
        self.show_objects(&changed, |_| all)
    }

    /// Brings the files that describe the dataset to the store, dataset.json last. A file that would not change is left
    /// alone.
    pub fn push_descriptions(&self) -> Result<(), DatasetError> {
        for name in DESCRIPTION_FILES.into_iter().rev() {
            let path = self.root.join(name);
            let text = match fs::read(&path) {
                Ok(text) => text,
                Err(error) if error.kind() == io::ErrorKind::NotFound => continue,
                Err(error) => return Err(DatasetError::Io(path, error)),
            };
            let failed = |error| self.to_dataset_error(name, error);
            if self.store.get(name, MAX_METADATA_BYTES).map_err(failed)?.as_ref() != Some(&text) {
                self.store.put(name, text).map_err(failed)?;
            }
        }
        Ok(())
    }

    /// Finds shards in the store that have the right length, but not the content that was written. Reads all of them.
    fn find_changed_shards(&self, recorded: &RecordedDataset) -> Result<Vec<DatasetFinding>, DatasetError> {
        let container = recorded.job.output.container;
        let shards: Vec<Shard> =
            (0..recorded.layout.shard_count()).map(|number| recorded.layout.shard(number)).collect();
        let changed = |shard: &Shard| {
            let Some(stats) = ShardStats::read(&recorded.shard_paths(shard).stats)? else { return Ok(None) };
            let name = container.relative_path(shard);
            let found = self.store.digest(&name).map_err(|error| self.to_dataset_error(&name, error))?;
            let (_, found) = found.filter(|(length, _)| *length == stats.bytes).unwrap_or((0, stats.sha256.clone()));
            let what = format!("is not what was written: it has SHA-256 {found}, {} was written", stats.sha256);
            Ok((found != stats.sha256).then(|| DatasetFinding::new(name, what)))
        };
        shards.par_iter().filter_map(|shard| changed(shard).transpose()).collect()
    }

    fn remove_object(&self, name: &str) -> Result<(), DatasetError> {
        self.store.remove(name).map_err(|error| self.to_dataset_error(name, error))?;
        lock_mutex(&self.shown).remove(name);
        Ok(())
    }

    /// Returns the name of the object that a file of the folder mirrors.
    fn object_name(&self, path: &Path) -> String {
        path.strip_prefix(&self.root).unwrap_or(path).to_string_lossy().into_owned()
    }

    fn to_dataset_error(&self, name: &str, error: io::Error) -> DatasetError {
        DatasetError::Io(PathBuf::from(self.store.full_address(name)), error)
    }

    /// Replaces the folder by the store's address in an error, since the folder means nothing to a user. An error of
    /// this machine's disk stays as it is.
    pub fn with_store_address(&self, refused: DatasetError) -> DatasetError {
        match refused {
            DatasetError::Usage(report) => DatasetError::Usage(
                report.with_replaced_text(&self.root.to_string_lossy(), &self.store.full_address("")),
            ),
            DatasetError::Io(path, error) if error.raw_os_error().is_none() && path.starts_with(&self.root) => {
                self.to_dataset_error(&self.object_name(&path), error)
            }
            other => other,
        }
    }
}

impl Drop for StoreMirror<'_> {
    fn drop(&mut self) {
        // If something of it stays, the next run removes it.
        let _ = fs::remove_dir_all(&self.root);
    }
}

/// Locks a mutex, even if a thread has panicked while it held it: no holder panics between two changes that belong
/// together.
fn lock_mutex<T>(mutex: &Mutex<T>) -> std::sync::MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}

/// Completes a dataset in a store, as [`finalize`] does on disk, and returns the result and the dataset's layout.
/// `beside` is the folder for its mirror.
pub fn finalize_in_store(
    store: &dyn Store,
    beside: &Path,
    depth: CheckLevel,
) -> Result<(Finalized, Layout), DatasetError> {
    let mirror = StoreMirror::create(store, beside)?;
    let described = || {
        mirror.fetch(|_| true)?;
        let recorded = RecordedDataset::open(mirror.root()).map_err(DatasetError::Usage)?;
        check_same_version(&recorded).map_err(DatasetError::Usage)?;
        let changed = if depth > CheckLevel::Sizes { mirror.find_changed_shards(&recorded)? } else { Vec::new() };
        if !changed.is_empty() {
            return Ok((Finalized::Invalid(changed), recorded.layout));
        }
        let finalized = finalize(&recorded, CheckLevel::Sizes)?;
        if matches!(finalized, Finalized::Valid { .. }) {
            mirror.push_descriptions()?;
        }
        Ok((finalized, recorded.layout))
    };
    described().map_err(|refused| mirror.with_store_address(refused))
}
