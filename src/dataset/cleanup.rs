//! The names in a dataset's folder that are ours: what they must be, and how they go.
//!
//! Nothing is written through a link: folders and files of ours must be plain ones, which is looked at before a run
//! writes anything; new files are made under names that did not exist, locks are never opened through a link. What has
//! another name stays, whatever happens.

use std::fs::{self, FileType};
use std::io;
use std::path::{Path, PathBuf};

use super::imagefolder;
use super::lock::Lock;
use gelsim_files::fail_point::Step;
use gelsim_files::write::absent_is_fine;
use gelsim_job::layout::Split;

/// Files that describe a whole dataset. They are there only while it is whole.
pub const DESCRIPTIONS: [&str; 3] = ["dataset.json", "wids.json", "README.md"];

/// Files beside the folders. job.toml goes last: while it is there, what remains is known to be ours.
const FILES: [&str; 5] = ["README.md", "dataset.json", "wids.json", REPORT, "job.toml"];

/// Name of the page about the dataset, where it is kept beside the data.
pub const REPORT: &str = "report.html";

/// Folders of the shards' files.
pub const FOLDERS: [&str; 2] = [DATA, "stats"];
/// The one with the shards themselves.
pub const DATA: &str = "data";

/// Name of [`lock`].
pub const LOCK: &str = ".gelsim.lock";

/// The file that is locked while something other than a shard is written.
pub fn lock(root: &Path) -> PathBuf {
    root.join(LOCK)
}

/// A path and what went wrong there.
type Failed = (PathBuf, io::Error);

/// What stands under a name of ours in `root` but is not what we make there: a link, a pipe, a folder instead of a
/// file. In words; none if all is well.
pub fn strange(root: &Path) -> Result<Option<String>, Failed> {
    for folder in FOLDERS {
        let path = root.join(folder);
        match kind(&path)? {
            Some(kind) if !kind.is_dir() => return Ok(Some(describe(&path, kind))),
            _ => {}
        }
    }
    for file in FILES.into_iter().chain([LOCK]) {
        let path = root.join(file);
        match kind(&path)? {
            Some(kind) if !kind.is_file() => return Ok(Some(describe(&path, kind))),
            _ => {}
        }
    }
    for folder in FOLDERS {
        for Ours { path, is_folder, .. } in of_shards(root, folder)? {
            match kind(&path)? {
                Some(kind) if kind.is_dir() && is_folder => {
                    let inside = imagefolder::strange(&path).map_err(|error| (path.clone(), error))?;
                    if let Some(inside) = inside.map(|name| path.join(name))
                        && let Some(kind) = self::kind(&inside)?
                    {
                        return Ok(Some(describe(&inside, kind)));
                    }
                }
                Some(kind) if !kind.is_file() || is_folder => return Ok(Some(describe(&path, kind))),
                _ => {}
            }
        }
    }
    Ok(None)
}

/// What is at `path` itself, links not followed.
fn kind(path: &Path) -> Result<Option<FileType>, Failed> {
    match fs::symlink_metadata(path) {
        Ok(meta) => Ok(Some(meta.file_type())),
        Err(error) if error.kind() == io::ErrorKind::NotFound => Ok(None),
        Err(error) => Err((path.to_owned(), error)),
    }
}

fn describe(path: &Path, kind: FileType) -> String {
    let what = match kind {
        kind if kind.is_symlink() => "a symbolic link",
        kind if kind.is_dir() => "a folder",
        kind if kind.is_file() => "a file",
        _ => "neither a file nor a folder",
    };
    format!("{} is {what}", path.display())
}

/// The shard that a file or folder in `data` or `stats` belongs to, partial ones and locks included; and the rest of its
/// name, after the shard's.
fn shard(name: &str) -> Option<(&str, &str)> {
    let hidden = name.strip_prefix('.').unwrap_or(name);
    let (stem, ending) = hidden.split_at(hidden.find('.').unwrap_or(hidden.len()));
    let (split, number) = stem.split_once('-')?;
    let counted = number.len() == 6 && number.bytes().all(|byte| byte.is_ascii_digit());
    let ours = counted && Split::ALL.iter().any(|known| known.name() == split);
    // Hidden names of ours say what they are.
    (ours && (!ending.is_empty() || hidden == name)).then_some((stem, ending))
}

/// Something of a shard's.
struct Ours {
    path: PathBuf,
    /// Name of the shard.
    shard: String,
    /// True if it is a shard that is a folder, also while it is written or goes aside.
    is_folder: bool,
}

/// What is there of shards in the folder `folder` of a dataset; nothing if there is no such folder.
fn of_shards(root: &Path, folder: &str) -> Result<Vec<Ours>, Failed> {
    let path = root.join(folder);
    let mut found = Vec::new();
    for name in entries(&path).map_err(|error| (path.clone(), error))? {
        let Some((shard, ending)) = name.to_str().and_then(shard) else { continue };
        let is_folder = ["", ".partial", ".replaced.partial"].contains(&ending);
        if !is_folder || folder == DATA {
            found.push(Ours { path: path.join(&name), shard: shard.to_owned(), is_folder });
        }
    }
    Ok(found)
}

/// The names in a folder; none if it is not there.
pub fn entries(folder: &Path) -> io::Result<Vec<std::ffi::OsString>> {
    match fs::read_dir(folder) {
        Ok(entries) => entries.map(|entry| entry.map(|entry| entry.file_name())).collect(),
        Err(error) if error.kind() == io::ErrorKind::NotFound => Ok(Vec::new()),
        Err(error) => Err(error),
    }
}

/// True if the folder has something in it that may not be a dataset's.
pub fn is_foreign(root: &Path) -> io::Result<bool> {
    for name in entries(root)? {
        let name = name.to_string_lossy();
        // A run that was killed right at its start leaves these: shards come after job.toml.
        let is_empty = |folder: &str| entries(&root.join(folder)).is_ok_and(|inside| inside.is_empty());
        let ours = name == LOCK || name.starts_with(".job.toml.") || FOLDERS.contains(&&*name) && is_empty(&name);
        if !ours {
            return Ok(true);
        }
    }
    Ok(false)
}

/// The stats of shards in `root`, whole or not.
pub fn stats(root: &Path) -> Result<Vec<PathBuf>, Failed> {
    let of_shards = of_shards(root, "stats")?.into_iter().map(|ours| ours.path);
    let is_stats = |path: &PathBuf| path.file_name().is_some_and(|name| !name.to_string_lossy().starts_with('.'));
    Ok(of_shards.filter(is_stats).collect())
}

/// Removes the dataset in `root` and nothing else, under its [`lock`]. The inner error says who is writing there: then
/// nothing is removed.
pub fn clear(root: &Path) -> Result<Result<(), String>, Failed> {
    let mut held = Vec::new();
    for Ours { path, shard, .. } in of_shards(root, DATA)? {
        if path.extension().is_some_and(|ending| ending == "lock") {
            match Lock::take(&path).map_err(|error| (path, error))? {
                Ok(lock) => held.push(lock),
                Err(holder) => return Ok(Err(format!("{shard} is being written by {holder}"))),
            }
        }
    }
    for folder in FOLDERS {
        for Ours { path, .. } in of_shards(root, folder)? {
            match remove(&path) {
                // Something of the user's own is in it.
                Err(error) if error.kind() == io::ErrorKind::DirectoryNotEmpty => {}
                removed => removed.map_err(|error| (path.clone(), error))?,
            }
            Step::OldShardRemoved.reached(&path);
        }
        let folder = root.join(folder);
        match fs::remove_dir(&folder) {
            // Something of the user's own is in it.
            Err(error) if error.kind() == io::ErrorKind::DirectoryNotEmpty => {}
            removed => absent_is_fine(removed).map_err(|error| (folder.clone(), error))?,
        }
        Step::OldFolderRemoved.reached(&folder);
    }
    for path in FILES.map(|file| root.join(file)) {
        remove(&path).map_err(|error| (path.clone(), error))?;
        Step::OldFileRemoved.reached(&path);
    }
    Ok(Ok(()))
}

/// Removes what killed runs left. Only under the [`lock`] of a dataset of which all shards are complete; what belongs
/// to a shard that another process has locked stays.
pub fn sweep(root: &Path) -> io::Result<()> {
    for name in entries(root)? {
        let partial = name.to_str().is_some_and(|name| {
            let of_ours = FILES.iter().any(|file| name.strip_prefix('.').is_some_and(|rest| rest.starts_with(file)));
            of_ours && name.ends_with(".partial")
        });
        if partial {
            remove(&root.join(name))?;
        }
    }
    for folder in FOLDERS {
        for Ours { path, shard, .. } in of_shards(root, folder).map_err(|(_, error)| error)? {
            let name = path.file_name().expect("found under a name").to_string_lossy();
            if name.starts_with('.') && (name.ends_with(".partial") || name.ends_with(".lock")) {
                // A lock that is free goes with the file it was taken on.
                let lock = Lock::take(&root.join(DATA).join(format!(".{shard}.lock")))?;
                if lock.is_ok() {
                    remove(&path)?;
                }
            }
        }
    }
    Ok(())
}

/// Removes a file, or the folder of a shard unless something is in it that is not ours; if it is there.
pub fn remove(path: &Path) -> io::Result<()> {
    match path.symlink_metadata() {
        Ok(meta) if meta.is_dir() => absent_is_fine(imagefolder::remove(path)),
        _ => absent_is_fine(fs::remove_file(path)),
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
        assert_eq!(ours.map(|name| shard(name).is_some()), [true; 5]);
        assert_eq!(theirs.map(shard), [None; 8]);
        assert_eq!(shard(".train-000003.json.77.partial"), Some(("train-000003", ".json.77.partial")));
    }

    #[test]
    fn what_is_not_ours_outlives_the_dataset() {
        let root = tempfile::tempdir().expect("a folder");
        let path = |name: &str| root.path().join(name);
        for folder in FOLDERS {
            fs::create_dir(path(folder)).expect("a folder");
        }
        let ours = ["data/train-000000.tar", "stats/train-000000.json", "job.toml", "README.md"];
        let theirs = ["data/measured.csv", "notes.txt"];
        for name in ours.iter().chain(&theirs) {
            fs::write(path(name), name).expect("a file");
        }
        clear(root.path()).expect("no failure").expect("nobody writes");
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
        clear(root.path()).expect("no failure").expect("nobody writes");
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
        let held = Lock::take(&path("data/.train-000000.lock")).expect("a lock").expect("free");
        let names = ["data/.train-000000.tar.partial", "data/.train-000001.tar.partial", "data/.train-000001.lock"];
        for name in names {
            fs::write(path(name), "").expect("a file");
        }
        sweep(root.path()).expect("swept");
        assert_eq!(names.map(|name| path(name).exists()), [true, false, false]);
        assert!(path("data/.train-000000.lock").exists());
        let holder = clear(root.path()).expect("no failure").expect_err("a writer");
        assert!(holder.starts_with("train-000000 is being written by process "), "{holder}");
        assert!(path(names[0]).exists());
        drop(held);
        clear(root.path()).expect("no failure").expect("nobody writes");
        assert!(!path("data").exists());
    }
}
