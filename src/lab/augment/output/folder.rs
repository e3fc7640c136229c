//! The folder of an output. It is written under another name next to its final place, and renamed when it is complete.

use std::collections::HashSet;
use std::fs;
use std::io;
use std::path::{Path, PathBuf};

use gelsim_dataset::cleanup::REPORT_FILE;
use gelsim_dataset::dataset_error::DatasetError;
use gelsim_dataset::lock::Lock;
use gelsim_files::diagnostic::user_error;
use gelsim_files::input;
use gelsim_files::write::{ignore_not_found, recreate_file, swap_folder, sync_all_in, sync_folder};

/// Name of an output's description.
pub const SUMMARY: &str = "augment.json";
/// Name of the list of all files, in the format of `sha256sum`.
pub const CHECKSUMS: &str = "files.sha256";

/// Empty file that marks a folder as begun by a run, which may remove it.
const MARKER: &str = ".gelsim-augment";

/// Files that describe an output.
pub const DESCRIPTIONS: [&str; 4] = ["README.md", SUMMARY, REPORT_FILE, CHECKSUMS];

/// A folder into which an output is being written.
pub struct OutputFolder {
    root: PathBuf,
    /// Folder into which it is written.
    pub partial: PathBuf,
    finished: bool,
    _lock: Lock,
}

impl OutputFolder {
    /// Creates a folder for an output that will be at `root`. Fails if `root` and `input` lie in each other, or if
    /// `root` holds something; an output is replaced if `overwrite`.
    pub fn create(root: &Path, input: &Path, overwrite: bool) -> Result<Self, DatasetError> {
        let refused = |message: String, help: &str| Err(DatasetError::Usage(user_error(message, help)));
        let another = "choose a new or empty folder with --out";
        let Some(name) = root.file_name().map(|name| name.to_string_lossy().into_owned()) else {
            return refused(format!("{} cannot be the output's folder", root.display()), another);
        };
        if let Ok(meta) = root.symlink_metadata() {
            if !meta.is_dir() {
                return refused(format!("{} is not a folder", root.display()), another);
            }
            let empty = fs::read_dir(root).map_err(|error| DatasetError::Io(root.to_owned(), error))?.next().is_none();
            if !empty && !root.join(SUMMARY).is_file() {
                return refused(
                    format!("{} is not empty and holds no output of gelsim augment", root.display()),
                    another,
                );
            }
            if !empty && !overwrite {
                let help = "choose another folder with --out, or replace it with --overwrite";
                return refused(format!("{} holds an output already", root.display()), help);
            }
            let stranger = find_unlisted_file(root).map_err(|error| DatasetError::Io(root.to_owned(), error))?;
            if let Some(stranger) = stranger.filter(|_| !empty) {
                let message = format!("{} is in the output, and gelsim did not make it", stranger.display());
                return refused(message, "move it away, or choose another folder with --out");
            }
        }
        let folder = root.parent().filter(|folder| !folder.as_os_str().is_empty()).unwrap_or(Path::new("."));
        let real = |path: &Path| resolve_path(path).map_err(|error| DatasetError::Io(path.to_owned(), error));
        let (out, input) = (real(folder)?.join(&name), real(input)?);
        if out.starts_with(&input) || input.starts_with(&out) {
            let message = format!("the output {} and the input {} are in each other", out.display(), input.display());
            return refused(message, "choose a folder beside the input with --out");
        }
        fs::create_dir_all(folder).map_err(|error| DatasetError::Io(folder.to_owned(), error))?;
        let (lock, partial) = (folder.join(format!(".{name}.lock")), folder.join(format!(".{name}.partial")));
        let lock = match Lock::try_acquire(&lock).map_err(|error| DatasetError::Io(lock, error))? {
            Ok(lock) => lock,
            Err(holder) => {
                return refused(format!("{} is being written by {holder}", root.display()), "wait until it is done");
            }
        };
        if let Some(stranger) = find_foreign_file(&partial).map_err(|error| DatasetError::Io(partial.clone(), error))? {
            let message = format!("{} is where the output is written, and gelsim did not make it", stranger.display());
            return refused(message, "move it away, or choose another folder with --out");
        }
        let made = remove_partial(&partial).and_then(|()| {
            fs::create_dir(&partial)?;
            recreate_file(&partial.join(MARKER)).map(drop)
        });
        made.map_err(|error| DatasetError::Io(partial.clone(), error))?;
        Ok(Self { root: root.to_owned(), partial, finished: false, _lock: lock })
    }

    /// Gives the folder its final name. If an output exists there, the two are swapped, so that at every instant one of
    /// them has the name; then the old one's own files are removed. If that fails, the new output is in place
    /// nevertheless.
    pub fn finish(mut self) -> Result<(), IncompleteOutput> {
        let exchange = || {
            sync_all_in(&fs::File::open(&self.partial)?)?;
            if self.root.is_dir() {
                // If the run is killed after the swap, the marker tells the next run that the old folder is its to
                // remove.
                recreate_file(&self.root.join(MARKER))?;
            }
            fs::remove_file(self.partial.join(MARKER))?;
            swap_folder(&self.partial, &self.root)
        };
        if let Err(error) = exchange() {
            // The run fails for another reason anyway; the next run recognises the file.
            let _ = fs::remove_file(self.root.join(MARKER));
            return Err(IncompleteOutput::NothingWritten(self.root.clone(), error));
        }
        self.finished = true;
        let clear = || {
            sync_folder(&self.root)?;
            if !self.partial.try_exists()? {
                return Ok(());
            }
            if let Some(stranger) = find_unlisted_file(&self.partial)? {
                let what = format!("{} was put into it meanwhile", stranger.display());
                return Err(io::Error::new(io::ErrorKind::DirectoryNotEmpty, what));
            }
            remove_partial(&self.partial)
        };
        clear().map_err(|error| IncompleteOutput::OldNotRemoved(self.partial.clone(), error))
    }
}

/// Why an output is not in its final state.
pub enum IncompleteOutput {
    /// It did not get its final name.
    NothingWritten(PathBuf, io::Error),
    /// It did, but the old output is still in this folder.
    OldNotRemoved(PathBuf, io::Error),
}

impl Drop for OutputFolder {
    fn drop(&mut self) {
        if !self.finished {
            // If this fails, the next run removes what is left.
            let _ = remove_partial(&self.partial);
        }
    }
}

/// Finds something that no run made, in a folder with the name that a run wants to write under. A folder that a run
/// began holds [`MARKER`]; before that it is empty, and at the end it is a complete output.
fn find_foreign_file(partial: &Path) -> io::Result<Option<PathBuf>> {
    match partial.symlink_metadata() {
        Err(error) if error.kind() == io::ErrorKind::NotFound => return Ok(None),
        Err(error) => return Err(error),
        Ok(meta) if !meta.is_dir() => return Ok(Some(partial.to_owned())),
        _ if partial.join(MARKER).symlink_metadata().is_ok_and(|marker| marker.is_file()) => return Ok(None),
        _ => {}
    }
    match fs::read_dir(partial)?.next().transpose()? {
        Some(first) if !partial.join(SUMMARY).is_file() => Ok(Some(first.path())),
        _ => find_unlisted_file(partial),
    }
}

/// Removes a folder that is or was being written, if it exists. [`MARKER`] goes last, so that the rest can be
/// recognised.
fn remove_partial(partial: &Path) -> io::Result<()> {
    let entries = match fs::read_dir(partial) {
        Err(error) if error.kind() == io::ErrorKind::NotFound => return Ok(()),
        entries => entries?,
    };
    for entry in entries {
        let entry = entry?;
        if entry.file_type()?.is_dir() {
            fs::remove_dir_all(entry.path())?;
        } else if entry.file_name() != MARKER {
            fs::remove_file(entry.path())?;
        }
    }
    ignore_not_found(fs::remove_file(partial.join(MARKER)))?;
    fs::remove_dir(partial)
}

/// Resolves a path without links. Its last parts need not exist.
fn resolve_path(path: &Path) -> io::Result<PathBuf> {
    let path = std::path::absolute(path)?;
    match (path.canonicalize(), path.parent(), path.file_name()) {
        (Err(error), Some(folder), Some(name)) if error.kind() == io::ErrorKind::NotFound => {
            Ok(resolve_path(folder)?.join(name))
        }
        (found, ..) => found,
    }
}

/// Finds a file in an output that its list does not name. Fails if a folder cannot be read: it may hold one.
fn find_unlisted_file(root: &Path) -> io::Result<Option<PathBuf>> {
    let list = input::read_without_links(&root.join(CHECKSUMS), input::MAX_IMAGE_BYTES).unwrap_or_default();
    let list = String::from_utf8_lossy(&list);
    let mut ours: HashSet<PathBuf> =
        list.lines().filter_map(|line| Some(root.join(line.split_once("  ")?.1))).collect();
    ours.extend([CHECKSUMS, MARKER].map(|name| root.join(name)));
    let mut folders = vec![root.to_owned()];
    while let Some(folder) = folders.pop() {
        for entry in fs::read_dir(&folder)? {
            let entry = entry?;
            match entry.file_type() {
                Ok(kind) if kind.is_dir() => folders.push(entry.path()),
                _ if !ours.contains(&entry.path()) => return Ok(Some(entry.path())),
                _ => {}
            }
        }
    }
    Ok(None)
}
