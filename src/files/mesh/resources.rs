//! Reads the other files that a mesh file names, and remembers their hashes.

use std::io;
use std::path::{Path, PathBuf};

use super::packages::{FileReference, PackageFinder};
use super::{MeshFileError, MeshFileProblem, MissingReason};
use crate::hash::sha256;
use crate::input;

/// Reads the files that a mesh file names.
pub(super) struct Resources {
    folder: Option<PathBuf>,
    packages: PackageFinder,
    /// Bytes that all further files may still have together.
    bytes_left: u64,
    /// Each file's name as it is written, and its SHA-256, in the order in which they were read.
    hashes: Vec<(String, String)>,
}

impl Resources {
    /// For a mesh file at `path`, whose packages are also looked for in these folders.
    pub(super) fn beside_file(path: &Path, packages: &[String]) -> Self {
        let folder = Some(path.parent().unwrap_or(Path::new("")).to_owned());
        Self { folder, packages: PackageFinder::new(packages), ..Self::none() }
    }

    /// For a mesh file that may name no others.
    pub(super) fn none() -> Self {
        Self { folder: None, packages: PackageFinder::new(&[]), bytes_left: input::MAX_MESH_BYTES, hashes: Vec::new() }
    }

    /// Finds the file that a robot refers to. The inner error says why there is none. Returns `None` if no other files
    /// are read.
    pub(super) fn find_file(&mut self, named: &FileReference) -> Option<Result<PathBuf, MissingReason>> {
        let folder = self.folder.as_deref()?;
        Some(self.packages.find_file(folder, named))
    }

    /// Returns the folders in which the packages are found again.
    pub(super) fn package_folders(&self) -> Vec<String> {
        self.packages.required_folders()
    }

    /// Returns the folder that relative names start from.
    pub(super) fn folder(&self) -> Option<&Path> {
        self.folder.as_deref()
    }

    /// Reads the file at `path`, which the mesh file calls `name`, and remembers its hash.
    pub(super) fn read_file(&mut self, name: &str, path: &Path) -> Result<Vec<u8>, MeshFileError> {
        let unreadable = |error: io::Error| MeshFileError::from(MeshFileProblem::from_io_error(error));
        let bytes = input::read(path, self.bytes_left).map_err(unreadable)?;
        self.bytes_left -= bytes.len() as u64;
        self.hashes.push((name.to_owned(), sha256(&bytes)));
        Ok(bytes)
    }

    /// Returns true if a file was read.
    pub(super) fn has_read_files(&self) -> bool {
        !self.hashes.is_empty()
    }

    /// Calls `what` with relative names starting from the folder of `path`.
    pub(super) fn with_base_folder<T>(&mut self, path: &Path, what: impl FnOnce(&mut Self) -> T) -> T {
        let outer = self.folder.replace(path.parent().unwrap_or(Path::new("")).to_owned());
        let done = what(self);
        self.folder = outer;
        done
    }

    /// Returns the SHA-256 of a file whose own hash is `own` and of all that it names. Without other files it is `own`;
    /// else it is that of the lines which `sha256sum` would print of all of them, the file itself under no name.
    pub(super) fn combined_sha256(&self, own: String) -> String {
        if self.hashes.is_empty() {
            return own;
        }
        let mut lines = format!("{own}  \n");
        self.hashes.iter().for_each(|(name, sha256)| lines += &format!("{sha256}  {name}\n"));
        sha256(lines.as_bytes())
    }
}
