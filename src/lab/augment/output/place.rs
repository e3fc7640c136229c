//! The folder of an output: written under another name beside it, and renamed as a whole.

use std::collections::HashSet;
use std::fs;
use std::io;
use std::path::{Path, PathBuf};

use gelsim_dataset::cleanup::REPORT;
use gelsim_dataset::lock::Lock;
use gelsim_dataset::refused::Refused;
use gelsim_files::diagnostic::user_error;
use gelsim_files::input;
use gelsim_files::write::{absent_is_fine, create_anew, put_folder, sync_all_in, sync_folder};

/// Name of the description of an output.
pub const SUMMARY: &str = "augment.json";
/// Name of the list of its files, as `sha256sum` writes it.
pub const FILES: &str = "files.sha256";

/// An empty file in a folder that a run began: it is the run's to remove.
const MARKER: &str = ".gelsim-augment";

/// Files that say what an output is.
pub const DESCRIPTIONS: [&str; 4] = ["README.md", SUMMARY, REPORT, FILES];

/// A folder that an output is being written to.
pub struct Place {
    root: PathBuf,
    /// Where it is written.
    pub partial: PathBuf,
    finished: bool,
    _lock: Lock,
}

impl Place {
    /// Makes a folder for an output that will be at `root`; `input` must not be touched by it. Refuses to replace what is
    /// there, unless that is an output and `overwrite`.
    pub fn take(root: &Path, input: &Path, overwrite: bool) -> Result<Self, Refused> {
        let refused = |message: String, help: &str| Err(Refused::Usage(user_error(message, help)));
        let another = "choose a new or empty folder with --out";
        let Some(name) = root.file_name().map(|name| name.to_string_lossy().into_owned()) else {
            return refused(format!("{} cannot be the output's folder", root.display()), another);
        };
        if let Ok(meta) = root.symlink_metadata() {
            if !meta.is_dir() {
                return refused(format!("{} is not a folder", root.display()), another);
            }
            let empty = fs::read_dir(root).map_err(|error| Refused::Io(root.to_owned(), error))?.next().is_none();
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
            let stranger = strangers(root).map_err(|error| Refused::Io(root.to_owned(), error))?;
            if let Some(stranger) = stranger.filter(|_| !empty) {
                let message = format!("{} is in the output, and gelsim did not make it", stranger.display());
                return refused(message, "move it away, or choose another folder with --out");
            }
        }
        let folder = root.parent().filter(|folder| !folder.as_os_str().is_empty()).unwrap_or(Path::new("."));
        let real = |path: &Path| resolved(path).map_err(|error| Refused::Io(path.to_owned(), error));
        let (out, input) = (real(folder)?.join(&name), real(input)?);
        if out.starts_with(&input) || input.starts_with(&out) {
            let message = format!("the output {} and the input {} are in each other", out.display(), input.display());
            return refused(message, "choose a folder beside the input with --out");
        }
        fs::create_dir_all(folder).map_err(|error| Refused::Io(folder.to_owned(), error))?;
        let (lock, partial) = (folder.join(format!(".{name}.lock")), folder.join(format!(".{name}.partial")));
        let lock = match Lock::take(&lock).map_err(|error| Refused::Io(lock, error))? {
            Ok(lock) => lock,
            Err(holder) => {
                return refused(format!("{} is being written by {holder}", root.display()), "wait until it is done");
            }
        };
        if let Some(stranger) = not_ours(&partial).map_err(|error| Refused::Io(partial.clone(), error))? {
            let message = format!("{} is where the output is written, and gelsim did not make it", stranger.display());
            return refused(message, "move it away, or choose another folder with --out");
        }
        let made = remove(&partial).and_then(|()| {
            fs::create_dir(&partial)?;
            create_anew(&partial.join(MARKER)).map(drop)
        });
        made.map_err(|error| Refused::Io(partial.clone(), error))?;
        Ok(Self { root: root.to_owned(), partial, finished: false, _lock: lock })
    }

    /// Gives the folder its name, in place of what is there: at every instant one of the two has it. What gelsim made of
    /// the other goes; if that fails, the output is there all the same.
    pub fn finish(mut self) -> Result<(), IncompleteOutput> {
        let exchange = || {
            sync_all_in(&fs::File::open(&self.partial)?)?;
            if self.root.is_dir() {
                // Wherever this is killed, what is left says whose it is.
                create_anew(&self.root.join(MARKER))?;
            }
            fs::remove_file(self.partial.join(MARKER))?;
            put_folder(&self.partial, &self.root)
        };
        if let Err(error) = exchange() {
            // The run fails for another reason; the next one knows the file.
            let _ = fs::remove_file(self.root.join(MARKER));
            return Err(IncompleteOutput::NothingWritten(self.root.clone(), error));
        }
        self.finished = true;
        let clear = || {
            sync_folder(&self.root)?;
            if !self.partial.try_exists()? {
                return Ok(());
            }
            if let Some(stranger) = strangers(&self.partial)? {
                let what = format!("{} was put into it meanwhile", stranger.display());
                return Err(io::Error::new(io::ErrorKind::DirectoryNotEmpty, what));
            }
            remove(&self.partial)
        };
        clear().map_err(|error| IncompleteOutput::OldStays(self.partial.clone(), error))
    }
}

/// Why an output is not as it should be.
pub enum IncompleteOutput {
    /// It has not got its name.
    NothingWritten(PathBuf, io::Error),
    /// It has, but what was there before is still in this folder.
    OldStays(PathBuf, io::Error),
}

impl Drop for Place {
    fn drop(&mut self) {
        if !self.finished {
            // What is left behind would only be removed by the next run.
            let _ = remove(&self.partial);
        }
    }
}

/// What keeps a folder under the name of one that is being written from being taken: something in it that no run made.
/// One that a run began holds [`MARKER`]; before that it is empty, and at the end a whole output.
fn not_ours(partial: &Path) -> io::Result<Option<PathBuf>> {
    match partial.symlink_metadata() {
        Err(error) if error.kind() == io::ErrorKind::NotFound => return Ok(None),
        Err(error) => return Err(error),
        Ok(there) if !there.is_dir() => return Ok(Some(partial.to_owned())),
        _ if partial.join(MARKER).symlink_metadata().is_ok_and(|marker| marker.is_file()) => return Ok(None),
        _ => {}
    }
    match fs::read_dir(partial)?.next().transpose()? {
        Some(first) if !partial.join(SUMMARY).is_file() => Ok(Some(first.path())),
        _ => strangers(partial),
    }
}

/// Removes a folder that is being written, or was, if it is there: [`MARKER`] last.
fn remove(partial: &Path) -> io::Result<()> {
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
    absent_is_fine(fs::remove_file(partial.join(MARKER)))?;
    fs::remove_dir(partial)
}

/// A path without links in it, of which the last parts need not be there.
fn resolved(path: &Path) -> io::Result<PathBuf> {
    let path = std::path::absolute(path)?;
    match (path.canonicalize(), path.parent(), path.file_name()) {
        (Err(error), Some(folder), Some(name)) if error.kind() == io::ErrorKind::NotFound => {
            Ok(resolved(folder)?.join(name))
        }
        (found, ..) => found,
    }
}

/// The first file in an output that is not in its list. A folder that cannot be read may hold one.
fn strangers(root: &Path) -> io::Result<Option<PathBuf>> {
    let list = input::read_inside(&root.join(FILES), input::MOST_IMAGE_BYTES).unwrap_or_default();
    let list = String::from_utf8_lossy(&list);
    let mut ours: HashSet<PathBuf> =
        list.lines().filter_map(|line| Some(root.join(line.split_once("  ")?.1))).collect();
    ours.extend([FILES, MARKER].map(|name| root.join(name)));
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
