//! The files that a mesh file names: read beside it, and remembered by their hashes.

use std::io;
use std::path::{Path, PathBuf};

use super::packages::{Named, Packages};
use super::{MeshFileError, MeshFileProblem, Reason};
use crate::hash::sha256;
use crate::input;

/// Reads the files that a mesh file names.
pub(super) struct Others {
    folder: Option<PathBuf>,
    packages: Packages,
    /// Bytes that all of them together may still have.
    left: u64,
    /// Name as it is written, and SHA-256, in the order in which they were read.
    read: Vec<(String, String)>,
}

impl Others {
    /// Beside the file at `path`, and in packages in these folders.
    pub(super) fn beside(path: &Path, packages: &[String]) -> Self {
        let folder = Some(path.parent().unwrap_or(Path::new("")).to_owned());
        Self { folder, packages: Packages::new(packages), ..Self::none() }
    }

    /// None at all.
    pub(super) fn none() -> Self {
        Self { folder: None, packages: Packages::new(&[]), left: input::MOST_MESH_BYTES, read: Vec::new() }
    }

    /// Where a file is that a robot names; on failure, why it is nowhere. `None` where no other file is read.
    pub(super) fn find(&mut self, named: &Named) -> Option<Result<PathBuf, Reason>> {
        let folder = self.folder.as_deref()?;
        Some(self.packages.find(folder, named))
    }

    /// The folders in which packages are found again.
    pub(super) fn packages(&self) -> Vec<String> {
        self.packages.needed()
    }

    /// The folder that relative names start from.
    pub(super) fn folder(&self) -> Option<&Path> {
        self.folder.as_deref()
    }

    /// The file at `path`, which is written as `name`.
    pub(super) fn read(&mut self, name: &str, path: &Path) -> Result<Vec<u8>, MeshFileError> {
        let unreadable = |error: io::Error| MeshFileError::from(MeshFileProblem::unreadable(error));
        let bytes = input::read(path, self.left).map_err(unreadable)?;
        self.left -= bytes.len() as u64;
        self.read.push((name.to_owned(), sha256(&bytes)));
        Ok(bytes)
    }

    /// Does something with relative names starting from the folder of `path`.
    pub(super) fn within<T>(&mut self, path: &Path, what: impl FnOnce(&mut Self) -> T) -> T {
        let outer = self.folder.replace(path.parent().unwrap_or(Path::new("")).to_owned());
        let done = what(self);
        self.folder = outer;
        done
    }

    /// SHA-256 of a file of this hash and of all that it names: its own if it names none, else that of the lines which
    /// `sha256sum` would print of them, the file itself under no name.
    pub(super) fn sha256(&self, own: String) -> String {
        if self.read.is_empty() {
            return own;
        }
        let mut lines = format!("{own}  \n");
        self.read.iter().for_each(|(name, sha256)| lines += &format!("{sha256}  {name}\n"));
        sha256(lines.as_bytes())
    }
}
