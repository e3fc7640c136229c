//! The files and folders of a dataset by name: checks that they are what gelsim makes, and removes them.
//!
//! Nothing is written through a link. Before a run writes anything, the dataset's files and folders are checked to be
//! plain ones; new files get names that did not exist, and locks are never opened through a link. Entries with other
//! names are never touched.

use std::fs::{self, FileType};
use std::io;
use std::path::{Path, PathBuf};

use super::imagefolder;
use super::lock::Lock;
use gelsim_files::fail_point::Step;
use gelsim_files::write::ignore_not_found;
use gelsim_job::layout::Split;

/// Files that describe a complete dataset. They exist only while it is complete.
pub const DESCRIPTION_FILES: [&str; 3] = ["dataset.json", "wids.json", "README.md"];

/// Files beside the folders. job.toml is removed last: while it is there, the rest is known to be a dataset of gelsim.
const ROOT_FILES: [&str; 5] = ["README.md", "dataset.json", "wids.json", REPORT_FILE, "job.toml"];

/// Name of the report page, if it is kept beside the data.
pub const REPORT_FILE: &str = "report.html";

/// Folders that hold the files of shards.
pub const SHARD_FOLDERS: [&str; 2] = [DATA_FOLDER, "stats"];
/// The folder of the shards themselves.
pub const DATA_FOLDER: &str = "data";

/// Name of the file of [`lock_path`].
pub const LOCK_FILE: &str = ".gelsim.lock";

/// Returns the path of the file that is locked while something other than a shard is written.
pub fn lock_path(root: &Path) -> PathBuf {
    root.join(LOCK_FILE)
}

/// A path and what went wrong there.
type PathError = (PathBuf, io::Error);

/// Finds an entry in `root` that has a name of gelsim's but is not what gelsim makes there: a link, a pipe, a folder
/// instead of a file. Returns its description, or `None` if all is well.
pub fn find_strange_entry(root: &Path) -> Result<Option<String>, PathError> {
    for folder in SHARD_FOLDERS {
        let path = root.join(folder);
        match read_file_type(&path)? {
            Some(kind) if !kind.is_dir() => return Ok(Some(describe_file_type(&path, kind))),
            _ => {}
        }
    }
    for file in ROOT_FILES.into_iter().chain([LOCK_FILE]) {
        let path = root.join(file);
        match read_file_type(&path)? {
            Some(kind) if !kind.is_file() => return Ok(Some(describe_file_type(&path, kind))),
            _ => {}
        }
    }
    for folder in SHARD_FOLDERS {
        for ShardFile { path, is_folder, .. } in list_shard_files(root, folder)? {
            match read_file_type(&path)? {
                Some(kind) if kind.is_dir() && is_folder => {
                    let inside = imagefolder::find_strange_file(&path).map_err(|error| (path.clone(), error))?;
                    if let Some(inside) = inside.map(|name| path.join(name))
                        && let Some(kind) = self::read_file_type(&inside)?
                    {
                        return Ok(Some(describe_file_type(&inside, kind)));
                    }
                }
                Some(kind) if !kind.is_file() || is_folder => return Ok(Some(describe_file_type(&path, kind))),
                _ => {}
            }
        }
    }
    Ok(None)
}

/// Returns the type of what is at `path` itself, without following links; `None` if there is nothing.
fn read_file_type(path: &Path) -> Result<Option<FileType>, PathError> {
    match fs::symlink_metadata(path) {
        Ok(meta) => Ok(Some(meta.file_type())),
        Err(error) if error.kind() == io::ErrorKind::NotFound => Ok(None),
        Err(error) => Err((path.to_owned(), error)),
    }
}

fn describe_file_type(path: &Path, kind: FileType) -> String {
    let what = match kind {
        kind if kind.is_symlink() => "a symbolic link",
        kind if kind.is_dir() => "a folder",
        kind if kind.is_file() => "a file",
        _ => "neither a file nor a folder",
    };
    format!("{} is {what}", path.display())
}

/// Parses the name of a file or folder in `data` or `stats`, partial ones and locks included. Returns the name of the
/// shard and the rest; `None` if it is none of a shard's.
fn parse_shard_name(name: &str) -> Option<(&str, &str)> {
    let hidden = name.strip_prefix('.').unwrap_or(name);
    let (stem, ending) = hidden.split_at(hidden.find('.').unwrap_or(hidden.len()));
    let (split, number) = stem.split_once('-')?;
    let counted = number.len() == 6 && number.bytes().all(|byte| byte.is_ascii_digit());
    let ours = counted && Split::ALL.iter().any(|known| known.name() == split);
    // A hidden name must have an ending that says what it is.
    (ours && (!ending.is_empty() || hidden == name)).then_some((stem, ending))
}

/// A file or folder of a shard.
struct ShardFile {
    path: PathBuf,
    /// Name of the shard.
    shard: String,
    /// Whether it is a shard in the form of a folder, also while it is being written or replaced.
    is_folder: bool,
}

/// Lists what belongs to shards in the folder `folder` of a dataset; empty if there is no such folder.
fn list_shard_files(root: &Path, folder: &str) -> Result<Vec<ShardFile>, PathError> {
    let path = root.join(folder);
    let mut found = Vec::new();
    for name in list_folder(&path).map_err(|error| (path.clone(), error))? {
        let Some((shard, ending)) = name.to_str().and_then(parse_shard_name) else { continue };
        let is_folder = ["", ".partial", ".replaced.partial"].contains(&ending);
        if !is_folder || folder == DATA_FOLDER {
            found.push(ShardFile { path: path.join(&name), shard: shard.to_owned(), is_folder });
        }
    }
    Ok(found)
}

/// Lists the names in a folder; empty if it does not exist.
pub fn list_folder(folder: &Path) -> io::Result<Vec<std::ffi::OsString>> {
    match fs::read_dir(folder) {
        Ok(entries) => entries.map(|entry| entry.map(|entry| entry.file_name())).collect(),
        Err(error) if error.kind() == io::ErrorKind::NotFound => Ok(Vec::new()),
        Err(error) => Err(error),
    }
}

/// Returns true if the folder has an entry that may not be a dataset's.
pub fn has_foreign_entries(root: &Path) -> io::Result<bool> {
    for name in list_folder(root)? {
        let name = name.to_string_lossy();
        // A run that was killed right at its start leaves only these: shards come after job.toml.
        let is_empty = |folder: &str| list_folder(&root.join(folder)).is_ok_and(|inside| inside.is_empty());
        let ours =
            name == LOCK_FILE || name.starts_with(".job.toml.") || SHARD_FOLDERS.contains(&&*name) && is_empty(&name);
        if !ours {
            return Ok(true);
        }
    }
    Ok(false)
}

/// Lists the files of stats in `root`, valid or not.
pub fn list_stats_files(root: &Path) -> Result<Vec<PathBuf>, PathError> {
    let of_shards = list_shard_files(root, "stats")?.into_iter().map(|ours| ours.path);
    let is_stats = |path: &PathBuf| path.file_name().is_some_and(|name| !name.to_string_lossy().starts_with('.'));
    Ok(of_shards.filter(is_stats).collect())
}

/// Removes the dataset in `root` and nothing else. The caller holds the lock of [`lock_path`]. The inner error says who
/// is writing a shard; then nothing is removed.
pub fn remove_dataset(root: &Path) -> Result<Result<(), String>, PathError> {
    // Hold the lock of every shard until the end, so that no other run begins one meanwhile.
    let mut held = Vec::new();
    for ShardFile { path, shard, .. } in list_shard_files(root, DATA_FOLDER)? {
        if path.extension().is_some_and(|ending| ending == "lock") {
            match Lock::try_acquire(&path).map_err(|error| (path, error))? {
                Ok(lock) => held.push(lock),
                Err(holder) => return Ok(Err(format!("{shard} is being written by {holder}"))),
            }
        }
    }
    for folder in SHARD_FOLDERS {
        for ShardFile { path, .. } in list_shard_files(root, folder)? {
            match remove_path(&path) {
                // It holds something of the user's own.
                Err(error) if error.kind() == io::ErrorKind::DirectoryNotEmpty => {}
                removed => removed.map_err(|error| (path.clone(), error))?,
            }
            Step::OldShardRemoved.pause_if_requested(&path);
        }
        let folder = root.join(folder);
        match fs::remove_dir(&folder) {
            // It holds something of the user's own.
            Err(error) if error.kind() == io::ErrorKind::DirectoryNotEmpty => {}
            removed => ignore_not_found(removed).map_err(|error| (folder.clone(), error))?,
        }
        Step::OldFolderRemoved.pause_if_requested(&folder);
    }
    for path in ROOT_FILES.map(|file| root.join(file)) {
        remove_path(&path).map_err(|error| (path.clone(), error))?;
        Step::OldFileRemoved.pause_if_requested(&path);
    }
    Ok(Ok(()))
}

/// Removes what killed runs left. The caller holds the lock of [`lock_path`], and all shards must be complete. What
/// belongs to a shard that another process has locked stays.
pub fn remove_leftovers(root: &Path) -> io::Result<()> {
    for name in list_folder(root)? {
        let partial = name.to_str().is_some_and(|name| {
            let of_ours =
                ROOT_FILES.iter().any(|file| name.strip_prefix('.').is_some_and(|rest| rest.starts_with(file)));
            of_ours && name.ends_with(".partial")
        });
        if partial {
            remove_path(&root.join(name))?;
        }
    }
    for folder in SHARD_FOLDERS {
        for ShardFile { path, shard, .. } in list_shard_files(root, folder).map_err(|(_, error)| error)? {
            let name = path.file_name().expect("found under a name").to_string_lossy();
            if name.starts_with('.') && (name.ends_with(".partial") || name.ends_with(".lock")) {
                // A lock that is free is removed with its file.
                let lock = Lock::try_acquire(&root.join(DATA_FOLDER).join(format!(".{shard}.lock")))?;
                if lock.is_ok() {
                    remove_path(&path)?;
                }
            }
        }
    }
    Ok(())
}

/// Removes a file, or the folder of a shard unless it holds something that gelsim did not make. It need not exist.
pub fn remove_path(path: &Path) -> io::Result<()> {
    match path.symlink_metadata() {
        Ok(meta) if meta.is_dir() => ignore_not_found(imagefolder::remove_folder(path)),
        _ => ignore_not_found(fs::remove_file(path)),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn files_of_shards_are_told_from_others() {
        let ours =
            ["train-000000.tar", "train-000000", ".val-000012.tar.partial", ".test-999999.lock", "train-000001.json"];
        let theirs =
            [".train-000000", "train-00000.tar", "other-000000.tar", "train-+00001", "measured.csv", ".", "", "-"];
        assert_eq!(ours.map(|name| parse_shard_name(name).is_some()), [true; 5]);
        assert_eq!(theirs.map(parse_shard_name), [None; 8]);
        assert_eq!(parse_shard_name(".train-000003.json.77.partial"), Some(("train-000003", ".json.77.partial")));
    }

    #[test]
    fn what_is_not_ours_outlives_the_dataset() {
        let root = tempfile::tempdir().expect("a folder");
        let path = |name: &str| root.path().join(name);
        for folder in SHARD_FOLDERS {
            fs::create_dir(path(folder)).expect("a folder");
        }
        let ours = ["data/train-000000.tar", "stats/train-000000.json", "job.toml", "README.md"];
        let theirs = ["data/measured.csv", "notes.txt"];
        for name in ours.iter().chain(&theirs) {
            fs::write(path(name), name).expect("a file");
        }
        remove_dataset(root.path()).expect("no failure").expect("nobody writes");
        assert!(ours.iter().all(|name| !path(name).exists()) && !path("stats").exists());
        assert!(theirs.iter().all(|name| path(name).exists()));
    }

    #[test]
    fn a_shard_that_is_a_folder_goes_but_for_what_is_not_ours() {
        let root = tempfile::tempdir().expect("a folder");
        let path = |name: &str| root.path().join(name);
        let folders = ["data/train-000000", "data/.train-000001.partial", "data/.val-000000.replaced.partial"];
        for folder in folders.iter().chain(&["stats/train-000000", "data/train-000002"]) {
            fs::create_dir_all(path(folder)).expect("a folder");
            fs::write(path(folder).join("000000001.json"), "{}").expect("a file");
        }
        fs::write(path("data/train-000002/notes.txt"), "mine").expect("a file");
        remove_dataset(root.path()).expect("no failure").expect("nobody writes");
        assert!(folders.iter().all(|name| !path(name).exists()));
        assert!(path("stats/train-000000/000000001.json").exists(), "no shard's");
        assert!(path("data/train-000002/notes.txt").exists());
        assert!(!path("data/train-000002/000000001.json").exists());
    }

    #[test]
    fn what_a_writer_holds_is_neither_swept_nor_cleared() {
        let root = tempfile::tempdir().expect("a folder");
        let path = |name: &str| root.path().join(name);
        fs::create_dir(path("data")).expect("a folder");
        let held = Lock::try_acquire(&path("data/.train-000000.lock")).expect("a lock").expect("free");
        let names = ["data/.train-000000.tar.partial", "data/.train-000001.tar.partial", "data/.train-000001.lock"];
        for name in names {
            fs::write(path(name), "").expect("a file");
        }
        remove_leftovers(root.path()).expect("swept");
        assert_eq!(names.map(|name| path(name).exists()), [true, false, false]);
        assert!(path("data/.train-000000.lock").exists());
        let holder = remove_dataset(root.path()).expect("no failure").expect_err("a writer");
        assert!(holder.starts_with("train-000000 is being written by process "), "{holder}");
        assert!(path(names[0]).exists());
        drop(held);
        remove_dataset(root.path()).expect("no failure").expect("nobody writes");
        assert!(!path("data").exists());
    }
}
