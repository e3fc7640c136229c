//! One shard on disk: a tar or a folder, whole or not there at all.
//!
//! The order of events makes every state after a crash recoverable: the shard is written beside its final place, synced,
//! renamed; then the stats file, likewise. A shard is complete if its stats file is there. The lock file is held by
//! the operating system (it frees it when a process dies) and says who writes.

use std::fs::{self, File, OpenOptions, TryLockError};
use std::io::{self, Read, Seek, Write};
use std::os::unix::fs::{MetadataExt, OpenOptionsExt};
use std::path::{Path, PathBuf};

use rustix::fs::OFlags;
use rustix::io::Errno;

use super::encode::Member;
use super::layout::Shard;
use super::stats::Stats;
use super::{container, names};
use crate::config::output::Container;

/// The names that a shard has on disk.
#[derive(Clone, Debug)]
pub struct Paths {
    /// What the shard is.
    pub container: Container,
    /// The tar or folder.
    pub data: PathBuf,
    /// The same while it is written.
    pub partial: PathBuf,
    /// The stats file.
    pub stats: PathBuf,
    /// The lock file.
    pub lock: PathBuf,
}

impl Paths {
    /// The names of `shard` in the dataset at `root`.
    pub fn new(root: &Path, shard: &Shard, container: Container) -> Self {
        let (name, file_name) = (shard.name(), container.file_name(shard));
        let data = root.join("data");
        Self {
            container,
            partial: data.join(format!(".{file_name}.partial")),
            stats: root.join("stats").join(format!("{name}.json")),
            lock: data.join(format!(".{name}.lock")),
            data: data.join(file_name),
        }
    }
}

/// The right to write something, held until dropped. The operating system frees it when a process dies.
pub struct Lock {
    path: PathBuf,
    file: File,
}

impl Lock {
    /// Takes the lock that the file at `path` stands for, or says who has it.
    pub fn take(path: &Path) -> io::Result<Result<Self, String>> {
        loop {
            let mut file = open_lock(path)?;
            match file.try_lock() {
                Ok(()) => {}
                Err(TryLockError::WouldBlock) => {
                    let mut holder = String::new();
                    file.read_to_string(&mut holder)?;
                    let holder = holder.trim();
                    let unnamed = String::from("another process");
                    return Ok(Err(if holder.is_empty() { unnamed } else { holder.to_owned() }));
                }
                Err(TryLockError::Error(error)) if knows_no_locks(&error) => {}
                Err(TryLockError::Error(error)) => return Err(error),
            }
            if let Some(lock) = Self::signed(file, path)? {
                return Ok(Ok(lock));
            }
        }
    }

    /// Takes the lock, and waits while another process has it.
    pub fn wait(path: &Path) -> io::Result<Self> {
        loop {
            let file = open_lock(path)?;
            match file.lock() {
                Err(error) if !knows_no_locks(&error) => return Err(error),
                _ => {}
            }
            if let Some(lock) = Self::signed(file, path)? {
                return Ok(lock);
            }
        }
    }

    /// Writes into the locked file who holds it. `None` if the file is no longer the one at `path`: whoever finishes
    /// removes it, and a lock on a removed file protects nothing.
    fn signed(file: File, path: &Path) -> io::Result<Option<Self>> {
        if !same_file(&file, path) {
            return Ok(None);
        }
        let holder = format!("process {} on {}\n", std::process::id(), host());
        let lock = Self { path: path.to_owned(), file };
        let mut file = &lock.file;
        file.set_len(0)?;
        file.rewind()?;
        file.write_all(holder.as_bytes())?;
        Ok(Some(lock))
    }
}

/// True if it is the file system that has no locks, as some network folders. Nothing is then lost but work: who finishes a
/// shard looks whether it still is the file that was begun, and both would have written the same bytes.
fn knows_no_locks(error: &io::Error) -> bool {
    error.kind() == io::ErrorKind::Unsupported || error.raw_os_error() == Some(Errno::NOLCK.raw_os_error())
}

/// Opens a lock file, which is about to be written: only a plain file that has no other name, and not through a link.
fn open_lock(path: &Path) -> io::Result<File> {
    let mut options = OpenOptions::new();
    options.read(true).write(true).create(true).truncate(false);
    // Without waiting for the other end, should it be a pipe.
    options.custom_flags((OFlags::NOFOLLOW | OFlags::NONBLOCK).bits() as i32);
    let file = options.open(path)?;
    let meta = file.metadata()?;
    if meta.is_file() && meta.nlink() <= 1 {
        return Ok(file);
    }
    Err(io::Error::new(io::ErrorKind::InvalidInput, "not a plain file, or one with a second name; remove it"))
}

/// Makes a new file in place of what a killed run may have left there. Never opens what is there: it may be a link.
pub(super) fn create_anew(path: &Path) -> io::Result<File> {
    match fs::remove_file(path) {
        Err(error) if error.kind() != io::ErrorKind::NotFound => Err(error),
        _ => OpenOptions::new().write(true).create_new(true).open(path),
    }
}

impl Drop for Lock {
    fn drop(&mut self) {
        // Nothing depends on it: a lock file that stays is locked anew by the next run.
        let _ = fs::remove_file(&self.path);
    }
}

/// True if `path` itself, links not followed, is the open file.
pub(super) fn same_file(file: &File, path: &Path) -> bool {
    match (file.metadata(), fs::symlink_metadata(path)) {
        (Ok(open), Ok(named)) => open.dev() == named.dev() && open.ino() == named.ino(),
        _ => false,
    }
}

fn host() -> String {
    let name = fs::read_to_string("/proc/sys/kernel/hostname").unwrap_or_default();
    let name = name.trim();
    if name.is_empty() { String::from("this host") } else { name.to_owned() }
}

/// A shard being written.
pub struct Writer {
    paths: Paths,
    files: container::Writer,
    /// What is known of the shard so far; whoever appends samples counts them here.
    pub stats: Stats,
    finished: bool,
    _lock: Lock,
}

impl Writer {
    /// Starts a shard of which the lock is held.
    pub fn create(paths: Paths, lock: Lock, shard: &Shard, fingerprint: &str) -> io::Result<Self> {
        let files = paths.container.create(&paths.partial, &paths.data, shard)?;
        let stats = Stats::new(shard, paths.container, fingerprint);
        Ok(Self { paths, files, stats, finished: false, _lock: lock })
    }

    /// Appends a sample's files. Samples must come in the order of the shard.
    pub fn append(&mut self, key: &str, members: &[Member]) -> io::Result<()> {
        self.files.append(key, members)
    }

    /// Brings the shard to disk under its final name, then its stats. On failure, the file that could not be written.
    pub fn finish(mut self) -> Result<Stats, (PathBuf, io::Error)> {
        self.finish_files().map_err(|error| (self.paths.partial.clone(), error))?;
        self.write_stats().map_err(|error| (self.paths.stats.clone(), error))?;
        Ok(self.stats.clone())
    }

    fn finish_files(&mut self) -> io::Result<()> {
        (self.stats.bytes, self.stats.sha256) = self.files.finish(&self.paths.partial)?;
        // A stats file of an earlier, damaged shard must not vouch for the new one while both are exchanged.
        match fs::remove_file(&self.paths.stats) {
            Err(error) if error.kind() != io::ErrorKind::NotFound => return Err(error),
            _ => {}
        }
        self.paths.container.put_in_place(&self.paths.partial, &self.paths.data)?;
        self.finished = true;
        sync_folder(&self.paths.data)
    }

    fn write_stats(&self) -> io::Result<()> {
        let mut text = serde_json::to_vec_pretty(&self.stats).map_err(io::Error::other)?;
        text.push(b'\n');
        write_whole(&self.paths.stats, &text)
    }
}

impl Drop for Writer {
    fn drop(&mut self) {
        if !self.finished {
            // After an error or a stop: what is left behind would only be overwritten.
            let _ = names::remove(&self.paths.partial);
        }
    }
}

/// Writes a file so that it is there whole or not at all.
pub fn write_whole(path: &Path, bytes: &[u8]) -> io::Result<()> {
    replace(path, bytes, File::sync_all)?;
    sync_folder(path)
}

/// The same without bringing it to disk, for one of many files; see [`super::imagefolder::sync`].
pub fn write_one_of_many(path: &Path, bytes: &[u8]) -> io::Result<()> {
    replace(path, bytes, |_| Ok(()))
}

fn replace(path: &Path, bytes: &[u8], sync: impl FnOnce(&File) -> io::Result<()>) -> io::Result<()> {
    let name = path.file_name().map_or(String::from("file"), |name| name.to_string_lossy().into_owned());
    let partial = path.with_file_name(format!(".{name}.{}.partial", std::process::id()));
    let written = create_anew(&partial).and_then(|mut file| {
        file.write_all(bytes)?;
        sync(&file)
    });
    if let Err(error) = written.and_then(|()| fs::rename(&partial, path)) {
        let _ = fs::remove_file(&partial);
        return Err(error);
    }
    Ok(())
}

/// Makes a rename in the folder of `path` survive a power cut.
fn sync_folder(path: &Path) -> io::Result<()> {
    match path.parent() {
        // A bare name is in the current folder.
        Some(folder) if folder.as_os_str().is_empty() => sync_folder(&Path::new(".").join(path)),
        Some(folder) if cfg!(unix) => File::open(folder)?.sync_all(),
        _ => Ok(()),
    }
}
