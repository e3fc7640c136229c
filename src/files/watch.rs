//! Which files were looked at since a command began to watch, and whether one of them has changed.
//!
//! What opens files, or looks whether they are there, notes them here, so that nothing needs a list of what a job
//! names: a file that is missing is watched, too. Files are compared by time of change, size and number, which also
//! works on file systems of a network, and where an editor puts a new file in the place of the old one.

use std::collections::HashMap;
use std::fs::Metadata;
use std::os::unix::fs::MetadataExt;
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Mutex, MutexGuard, PoisonError};

/// Whether anybody watches. Without it no lock is taken, which a forked process could find locked for ever.
static IS_WATCHING: AtomicBool = AtomicBool::new(false);

/// The state of each file when it was first looked at; `None` for one that was not there.
static WATCHED: Mutex<Option<Watched>> = Mutex::new(None);

type Watched = HashMap<PathBuf, Option<FileState>>;

/// What differs between two states of a file or a folder.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
struct FileState {
    changed: (i64, i64),
    bytes: u64,
    number: u64,
}

impl FileState {
    fn new(metadata: &Metadata) -> Self {
        Self { changed: (metadata.mtime(), metadata.mtime_nsec()), bytes: metadata.len(), number: metadata.ino() }
    }

    fn of(path: &Path) -> Option<Self> {
        path.metadata().ok().as_ref().map(Self::new)
    }
}

/// Forgets all files. From now on, those that are looked at are noted.
pub fn restart() {
    *lock() = Some(HashMap::new());
    IS_WATCHING.store(true, Ordering::Relaxed);
}

/// Returns true if a file is not as it was when it was first looked at.
pub fn has_changed() -> bool {
    lock().iter().flatten().any(|(path, state)| FileState::of(path) != *state)
}

/// Notes a file or a folder that is looked at, whether it is there or not.
pub fn note_path(path: &Path) {
    if IS_WATCHING.load(Ordering::Relaxed) {
        // The parent of a name alone is the current folder.
        let path = if path == Path::new("") { Path::new(".") } else { path };
        note(path, FileState::of(path));
    }
}

/// Notes a file that was opened, as it was then.
pub fn note_open_file(path: &Path, metadata: &Metadata) {
    if IS_WATCHING.load(Ordering::Relaxed) {
        note(path, Some(FileState::new(metadata)));
    }
}

fn note(path: &Path, state: Option<FileState>) {
    if let Some(watched) = lock().as_mut()
        && !watched.contains_key(path)
    {
        watched.insert(path.to_owned(), state);
    }
}

fn lock() -> MutexGuard<'static, Option<Watched>> {
    WATCHED.lock().unwrap_or_else(PoisonError::into_inner)
}

#[cfg(test)]
mod tests {
    use std::fs;

    use super::*;

    #[test]
    fn what_is_written_replaced_made_or_removed_has_changed() {
        let folder = tempfile::tempdir().unwrap();
        let path = |name: &str| folder.path().join(name);
        let look = || {
            restart();
            ["job", "mesh", "missing"].iter().for_each(|name| note_path(&path(name)));
        };
        fs::write(path("job"), "one").unwrap();
        fs::write(path("mesh"), "1").unwrap();
        look();
        assert!(!has_changed());
        fs::write(path("unwatched"), "").unwrap();
        assert!(!has_changed(), "nobody looked at it");
        fs::write(path("job"), "longer").unwrap();
        assert!(has_changed());
        look();
        // As editors save: of the same size, in its place.
        fs::write(path("new"), "9").unwrap();
        fs::rename(path("new"), path("mesh")).unwrap();
        assert!(has_changed());
        look();
        fs::write(path("missing"), "").unwrap();
        assert!(has_changed());
        look();
        fs::remove_file(path("job")).unwrap();
        assert!(has_changed());
        // A later look is no new beginning.
        note_path(&path("job"));
        assert!(has_changed());
        look();
        assert!(!has_changed());
    }
}
