//! The folder of an output: written under another name beside it, and renamed as a whole.

use std::collections::HashSet;
use std::fs;
use std::io;
use std::path::{Path, PathBuf};

use crate::dataset::cleanup::REPORT;
use crate::dataset::lock::Lock;
use crate::dataset::refused::Refused;
use crate::files::diagnostic::user_error;
use crate::files::input;
use crate::files::write::sync_all_in;

/// Name of the description of an output.
pub const SUMMARY: &str = "augment.json";
/// Name of the list of its files, as `sha256sum` writes it.
pub const FILES: &str = "files.sha256";

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
        // Of a run that was killed.
        let cleared = absent_is_fine(fs::remove_dir_all(&partial)).and_then(|()| fs::create_dir(&partial));
        cleared.map_err(|error| Refused::Io(partial.clone(), error))?;
        Ok(Self { root: root.to_owned(), partial, finished: false, _lock: lock })
    }

    /// Gives the folder its name, in place of what is there.
    pub fn finish(mut self) -> io::Result<()> {
        sync_all_in(&fs::File::open(&self.partial)?)?;
        let name = self.root.file_name().unwrap_or_default().to_string_lossy().into_owned();
        let aside = self.root.with_file_name(format!(".{name}.replaced.partial"));
        absent_is_fine(fs::remove_dir_all(&aside))?;
        absent_is_fine(fs::rename(&self.root, &aside))?;
        fs::rename(&self.partial, &self.root)?;
        self.finished = true;
        absent_is_fine(fs::remove_dir_all(&aside))
    }
}

impl Drop for Place {
    fn drop(&mut self) {
        if !self.finished {
            // What is left behind would only be removed by the next run.
            let _ = fs::remove_dir_all(&self.partial);
        }
    }
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

fn absent_is_fine(result: io::Result<()>) -> io::Result<()> {
    match result {
        Err(error) if error.kind() != io::ErrorKind::NotFound => Err(error),
        _ => Ok(()),
    }
}

/// The first file in an output that is not in its list. A folder that cannot be read may hold one.
fn strangers(root: &Path) -> io::Result<Option<PathBuf>> {
    let list = input::read_inside(&root.join(FILES), input::MOST_IMAGE_BYTES).unwrap_or_default();
    let list = String::from_utf8_lossy(&list);
    let mut ours: HashSet<PathBuf> =
        list.lines().filter_map(|line| Some(root.join(line.split_once("  ")?.1))).collect();
    ours.insert(root.join(FILES));
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
