//! What can be wrong with a mesh file.

use std::fmt;
use std::io;
use std::path::{Path, PathBuf};

use super::format::ENDINGS;
use crate::core::mesh::MeshError;

/// Why a mesh file cannot be used, and where. Its text is one line, such as
/// `objects/a.obj:17: face refers to vertex 9, but the file has 8 so far`.
#[derive(Debug, thiserror::Error)]
pub struct MeshFileError {
    /// The file, where it is known.
    pub path: Option<PathBuf>,
    /// The line in it, counted from 1, in a text format and where one line is to blame.
    pub line: Option<usize>,
    /// What is wrong.
    pub problem: MeshFileProblem,
}

/// What can be wrong with a mesh file.
#[derive(Debug, thiserror::Error)]
pub enum MeshFileProblem {
    /// The file cannot be read from the disk.
    #[error("cannot be read: {0}")]
    Unreadable(io::Error),
    /// The extension names no format of [`Format`](super::Format).
    #[error("is not named like a mesh: use {ENDINGS}")]
    UnknownExtension,
    /// What it holds makes no mesh.
    #[error(transparent)]
    Mesh(#[from] MeshError),
    /// The file breaks the rules of its format.
    #[error("{0}")]
    Malformed(String),
    /// The file is sound, and uses what is not read.
    #[error("{0}")]
    Unsupported(String),
    /// A picture or array is no height map.
    #[error("is no height map: {0}")]
    NoHeightMap(String),
    /// A header says that there is more (or, in binary STL, less) than there is.
    #[error("says {claimed} {what} but has room for {room}")]
    Room {
        /// Number in the header.
        claimed: u64,
        /// Of what.
        what: String,
        /// At most so many fit in the bytes that follow.
        room: u64,
    },
    /// The file ends before it is complete.
    #[error("ends too early: in {0}")]
    EndsEarly(String),
}

impl MeshFileError {
    /// A way out.
    pub fn help(&self) -> &'static str {
        match &self.problem {
            MeshFileProblem::Unreadable(error) if error.kind() == io::ErrorKind::OutOfMemory => {
                "free some memory, or use a smaller mesh"
            }
            MeshFileProblem::Unreadable(_) => "check the path and who may read it",
            MeshFileProblem::UnknownExtension => "export it as one of these, or give the file the ending of its format",
            MeshFileProblem::Unsupported(_) => "export it without that, or in another format",
            MeshFileProblem::NoHeightMap(_) => {
                "a grey PNG of 8 or 16 bits, or an npy or EXR file with values from 0 to 1, belongs here"
            }
            _ => "repair the mesh, or leave it out",
        }
    }

    /// What is true of several files with such a problem, behind their number.
    pub fn cause(&self) -> &'static str {
        match &self.problem {
            MeshFileProblem::Unreadable(_) => "meshes cannot be read",
            MeshFileProblem::UnknownExtension => "files are not named like meshes",
            MeshFileProblem::Mesh(_) => "meshes hold nothing that can be pressed",
            MeshFileProblem::Unsupported(_) => "meshes use what is not read",
            MeshFileProblem::NoHeightMap(_) => "files are no height maps",
            MeshFileProblem::Malformed(_) | MeshFileProblem::Room { .. } | MeshFileProblem::EndsEarly(_) => {
                "meshes are damaged"
            }
        }
    }

    /// The same in this file, unless it is known to be in another one.
    pub(super) fn in_file(self, path: &Path) -> Self {
        Self { path: self.path.or_else(|| Some(path.to_owned())), ..self }
    }

    pub(super) fn at_line(line: usize, problem: MeshFileProblem) -> Self {
        MeshFileError { path: None, line: Some(line), problem }
    }
}

impl From<MeshError> for MeshFileError {
    fn from(error: MeshError) -> Self {
        MeshFileProblem::Mesh(error).into()
    }
}

impl From<MeshFileProblem> for MeshFileError {
    fn from(problem: MeshFileProblem) -> Self {
        MeshFileError { path: None, line: None, problem }
    }
}

impl fmt::Display for MeshFileError {
    fn fmt(&self, f: &mut fmt::Formatter) -> fmt::Result {
        match (&self.path, self.line) {
            (Some(path), Some(line)) => write!(f, "{}:{line}: ", path.display())?,
            (Some(path), None) => write!(f, "{}: ", path.display())?,
            (None, Some(line)) => write!(f, "line {line}: ")?,
            (None, None) => {}
        }
        self.problem.fmt(f)
    }
}
