//! A dataset in an object store, as a folder on this machine shows it: every object below the address by its name and
//! length, the small files that describe the dataset and its shards by their content, too.
//!
//! What makes and describes datasets works in that folder as in any other, and what it changed there goes to the store: a
//! shard whole, then its stats; the files that describe the dataset last. Of a shard that is in the store only the
//! length stays here, so that this machine's disk holds no more shards than there are threads.

use crate::container::ShardContainer;
use std::collections::{BTreeMap, BTreeSet};
use std::fs::{self, File};
use std::io;
use std::path::{Path, PathBuf};
use std::sync::{Mutex, PoisonError};

use rayon::prelude::*;

use super::cleanup::{DATA, DESCRIPTIONS, FOLDERS};
use super::finalize::{Finalized, finalize, same_version};
use super::folder::still_ours;
use super::paths::Paths;
use super::recorded::Recorded;
use super::refused::Refused;
use super::stats::Stats;
use super::verify::{CheckLevel, Finding};
use super::versioned::Versioned;
use gelsim_files::input::{self, MOST_METADATA_BYTES};
use gelsim_files::store::{Entry, Store};
use gelsim_files::write::{absent_is_fine, sweep};
use gelsim_job::layout::{Layout, Shard};
use gelsim_job::plan::Plan;

/// The folders of mirrors, with a dot before, and the number of their process behind it.
const NAME: &str = "gelsim-store";

/// The file that says whose a dataset is.
const JOB: &str = "job.toml";

/// The folder that shows a store's dataset. It goes when this is dropped.
pub struct Mirror<'a> {
    store: &'a dyn Store,
    root: PathBuf,
    /// Objects of which the folder holds a file.
    shown: Mutex<BTreeSet<String>>,
    /// The job in the store, as it was last seen.
    job: Mutex<Option<Vec<u8>>>,
    /// Locked: shows that the folder is in use to processes that do not see this one.
    _held: File,
}

impl<'a> Mirror<'a> {
    /// Makes an empty folder in `beside`, where what killed runs left goes first.
    pub fn begin(store: &'a dyn Store, beside: &Path) -> Result<Self, Refused> {
        let root = beside.join(format!(".{NAME}.{}.partial", std::process::id()));
        let begin = || {
            fs::create_dir_all(beside)?;
            sweep(beside, |name| name == NAME)?;
            fs::create_dir(&root)?;
            let held = File::open(&root)?;
            // Where there are no locks, the number of the process alone tells.
            let _ = held.try_lock();
            Ok(held)
        };
        let held = begin().map_err(|error| Refused::Io(root.clone(), error))?;
        Ok(Self { store, root, shown: Mutex::default(), job: Mutex::default(), _held: held })
    }

    /// The folder.
    pub fn root(&self) -> &Path {
        &self.root
    }

    /// Shows what is in the store. Of stats only those that are `wanted`, by name, unless there is no job: then all, since they
    /// alone say whose the shards are.
    pub fn fetch(&self, wanted: impl Fn(&str) -> bool + Sync) -> Result<(), Refused> {
        let (objects, folders) = self.store.top().map_err(|error| self.failed("", error))?;
        for (name, length) in &objects {
            if folders.contains(name) {
                return Err(
                    self.failed(name, io::Error::other("is an object and a folder of others, which no disk can show"))
                );
            }
            if name == JOB {
                *locked(&self.job) = self.copy(name)?;
            } else if DESCRIPTIONS.contains(&name.as_str()) {
                self.copy(name)?;
            } else {
                self.stand_in(name, *length)?;
            }
        }
        let has_job = locked(&self.job).is_some();
        for folder in folders {
            let path = self.root.join(&folder);
            fs::create_dir(&path).map_err(|error| Refused::Io(path, error))?;
            if FOLDERS.contains(&folder.as_str()) {
                let listed = self.store.list(&folder).map_err(|error| self.failed(&folder, error))?;
                self.show(&listed, |name| !has_job || wanted(name))?;
            }
        }
        Ok(())
    }

    /// Shows objects of `data` and `stats`; of stats those that are `wanted`.
    fn show(&self, listed: &[Entry], wanted: impl Fn(&str) -> bool + Sync) -> Result<(), Refused> {
        listed.par_iter().try_for_each(|(name, length)| {
            let is_stats = name.starts_with("stats/") && name.ends_with(".json");
            match is_stats {
                true if wanted(name) => self.copy(name).map(drop),
                true => Ok(()),
                false => self.stand_in(name, *length),
            }
        })
    }

    /// Shows an object by its content, and gives that; nothing if it is gone.
    fn copy(&self, name: &str) -> Result<Option<Vec<u8>>, Refused> {
        let bytes = self.store.get(name, MOST_METADATA_BYTES).map_err(|error| self.failed(name, error))?;
        if let Some(bytes) = &bytes {
            let path = self.root.join(name);
            fs::write(&path, bytes).map_err(|error| Refused::Io(path, error))?;
            locked(&self.shown).insert(name.to_owned());
        }
        Ok(bytes)
    }

    /// Shows an object by its name and length: a file without content, which takes no room. Of an object further down only
    /// the folder it is in.
    fn stand_in(&self, name: &str, length: u64) -> Result<(), Refused> {
        let mut parts = name.split('/');
        let path = self.root.join(parts.by_ref().take(2).collect::<Vec<_>>().join("/"));
        let below = parts.next().is_some();
        let made =
            if below { fs::create_dir_all(&path) } else { File::create(&path).and_then(|file| file.set_len(length)) };
        made.map_err(|error| Refused::Io(path, error))?;
        if !below {
            locked(&self.shown).insert(name.to_owned());
        }
        Ok(())
    }

    /// Takes to the store what was made of the folder to begin `plan` there: what went from it goes, what describes the
    /// dataset first; then comes the job.
    pub fn push_beginning(&self, plan: &Plan) -> Result<(), Refused> {
        let shown = locked(&self.shown).clone();
        let gone = |name: &&String| !self.root.join(name.as_str()).exists();
        let (shards, files): (Vec<&String>, Vec<&String>) =
            shown.iter().filter(gone).partition(|name| name.contains('/'));
        files.iter().try_for_each(|name| self.remove(name))?;
        shards.par_iter().try_for_each(|name| self.remove(name))?;

        let path = self.root.join(JOB);
        let text = input::read_inside(&path, MOST_METADATA_BYTES).map_err(|error| Refused::Io(path, error))?;
        let before = locked(&self.job).clone();
        if before.as_ref() == Some(&text) {
            return Ok(());
        }
        let failed = |error| self.failed(JOB, error);
        let put = match before {
            // Another run may have begun just now: of the same job, or not.
            None => self.store.put_new(JOB, text.clone()).map_err(failed)?,
            Some(_) => self.store.put(JOB, text.clone()).map(|()| true).map_err(failed)?,
        };
        if !put {
            return self.still_ours(plan);
        }
        *locked(&self.job) = Some(text);
        Ok(())
    }

    /// Refuses if the dataset in the store is no longer the plan's: another run may have replaced it.
    pub fn still_ours(&self, plan: &Plan) -> Result<(), Refused> {
        let there = self.store.get(JOB, MOST_METADATA_BYTES).map_err(|error| self.failed(JOB, error))?;
        let mut job = locked(&self.job);
        if *job != there {
            let path = self.root.join(JOB);
            let shown = match &there {
                Some(text) => fs::write(&path, text),
                None => absent_is_fine(fs::remove_file(&path)),
            };
            shown.map_err(|error| Refused::Io(path, error))?;
            *job = there;
        }
        still_ours(&self.root, plan)
    }

    /// Takes a finished shard to the store, then its stats. If the store has `older` stats, they go first: they must not vouch
    /// for what takes the place of their shard.
    pub fn push_shard(&self, paths: &Paths, stats: &Stats, older: bool) -> Result<(), Refused> {
        let (data, stats_name) = (self.name(&paths.data), self.name(&paths.stats));
        if older {
            self.remove(&stats_name)?;
        }
        self.store.put_file(&data, &paths.data).map_err(|error| self.failed(&data, error))?;
        self.stand_in(&data, stats.bytes)?;
        let text = fs::read(&paths.stats).map_err(|error| Refused::Io(paths.stats.clone(), error))?;
        self.store.put(&stats_name, text).map_err(|error| self.failed(&stats_name, error))?;
        locked(&self.shown).insert(stats_name);
        Ok(())
    }

    /// Shows what others have put there and removed since; their stats once all shards are there, since only then somebody
    /// reads them.
    pub fn refresh(&self, layout: &Layout) -> Result<(), Refused> {
        let mut there = BTreeMap::new();
        for folder in FOLDERS {
            there.extend(self.store.list(folder).map_err(|error| self.failed(folder, error))?);
        }
        let shards = (0..layout.shard_count()).map(|number| layout.shard(number).name());
        let is_there = |name: String| {
            there.contains_key(&format!("{DATA}/{name}.tar")) && there.contains_key(&format!("stats/{name}.json"))
        };
        let all = shards.into_iter().all(is_there);
        let shown = locked(&self.shown).clone();
        for name in shown.iter().filter(|name| name.contains('/') && !there.contains_key(*name)) {
            let path = self.root.join(name);
            absent_is_fine(fs::remove_file(&path)).map_err(|error| Refused::Io(path, error))?;
            locked(&self.shown).remove(name);
        }
        let data = |name: &String| name.starts_with(DATA);
        let changed: Vec<Entry> = there.into_iter().filter(|(name, _)| data(name) || !shown.contains(name)).collect();
        self.show(&changed, |_| all)
    }

    /// Takes to the store what describes the whole dataset, dataset.json last. What is the same there stays.
    pub fn push_descriptions(&self) -> Result<(), Refused> {
        for name in DESCRIPTIONS.into_iter().rev() {
            let path = self.root.join(name);
            let text = match fs::read(&path) {
                Ok(text) => text,
                Err(error) if error.kind() == io::ErrorKind::NotFound => continue,
                Err(error) => return Err(Refused::Io(path, error)),
            };
            let failed = |error| self.failed(name, error);
            if self.store.get(name, MOST_METADATA_BYTES).map_err(failed)?.as_ref() != Some(&text) {
                self.store.put(name, text).map_err(failed)?;
            }
        }
        Ok(())
    }

    /// Shards in the store that are as long as what was written, but not it: reads all of them.
    fn changed(&self, recorded: &Recorded) -> Result<Vec<Finding>, Refused> {
        let container = recorded.job.output.container;
        let shards: Vec<Shard> =
            (0..recorded.layout.shard_count()).map(|number| recorded.layout.shard(number)).collect();
        let changed = |shard: &Shard| {
            let Some(stats) = Stats::read(&recorded.paths(shard).stats)? else { return Ok(None) };
            let name = container.file(shard);
            let found = self.store.digest(&name).map_err(|error| self.failed(&name, error))?;
            let (_, found) = found.filter(|(length, _)| *length == stats.bytes).unwrap_or((0, stats.sha256.clone()));
            let what = format!("is not what was written: it has SHA-256 {found}, {} was written", stats.sha256);
            Ok((found != stats.sha256).then(|| Finding::new(name, what)))
        };
        shards.par_iter().filter_map(|shard| changed(shard).transpose()).collect()
    }

    fn remove(&self, name: &str) -> Result<(), Refused> {
        self.store.remove(name).map_err(|error| self.failed(name, error))?;
        locked(&self.shown).remove(name);
        Ok(())
    }

    /// An object's name, by the file that shows it.
    fn name(&self, path: &Path) -> String {
        path.strip_prefix(&self.root).unwrap_or(path).to_string_lossy().into_owned()
    }

    fn failed(&self, name: &str, error: io::Error) -> Refused {
        Refused::Io(PathBuf::from(self.store.address(name)), error)
    }

    /// The same with the store's address in place of the folder's, which means nothing to who reads it; unless it is this
    /// machine's disk that failed.
    pub fn in_its_words(&self, refused: Refused) -> Refused {
        match refused {
            Refused::Usage(report) => {
                Refused::Usage(report.saying(&self.root.to_string_lossy(), &self.store.address("")))
            }
            Refused::Io(path, error) if error.raw_os_error().is_none() && path.starts_with(&self.root) => {
                self.failed(&self.name(&path), error)
            }
            other => other,
        }
    }
}

impl Drop for Mirror<'_> {
    fn drop(&mut self) {
        // What is left of it the next run removes.
        let _ = fs::remove_dir_all(&self.root);
    }
}

/// What is behind a lock. Nothing that holds one panics between two changes that belong together.
fn locked<T>(mutex: &Mutex<T>) -> std::sync::MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}

/// Describes a dataset in a store, as [`finalize`] does one on disk: what became of it, and the dataset's layout. `beside` is where
/// its mirror may be.
pub fn finalize_in(store: &dyn Store, beside: &Path, depth: CheckLevel) -> Result<(Finalized, Layout), Refused> {
    let mirror = Mirror::begin(store, beside)?;
    let described = || {
        mirror.fetch(|_| true)?;
        let recorded = Recorded::open(mirror.root()).map_err(Refused::Usage)?;
        same_version(&recorded).map_err(Refused::Usage)?;
        let changed = if depth > CheckLevel::Sizes { mirror.changed(&recorded)? } else { Vec::new() };
        if !changed.is_empty() {
            return Ok((Finalized::Wanting(changed), recorded.layout));
        }
        let finalized = finalize(&recorded, CheckLevel::Sizes)?;
        if matches!(finalized, Finalized::Whole { .. }) {
            mirror.push_descriptions()?;
        }
        Ok((finalized, recorded.layout))
    };
    described().map_err(|refused| mirror.in_its_words(refused))
}
