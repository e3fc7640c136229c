//! What can be wrong with a mesh file.

use std::fmt;
use std::io;
use std::path::{Path, PathBuf};

use super::format::{ENDINGS, Format};
use super::missing::Missing;
use super::points::Points;
use crate::foreign::Foreign;
use crate::input::meant;
use gelsim_core::mesh::MeshError;

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
    /// It is something else than a mesh, by its bytes.
    #[error("is {}", .0.what)]
    Foreign(Foreign),
    /// The extension names no format of [`Format`](super::Format); what to do.
    #[error("is not named like a mesh: use {ENDINGS}")]
    UnknownExtension(String),
    /// What it holds makes no mesh.
    #[error(transparent)]
    Mesh(#[from] MeshError),
    /// It holds points without a surface.
    #[error("{0}")]
    Points(Points),
    /// It names files that are not there.
    #[error("{0}")]
    Missing(Missing),
    /// A file that it names is wrong.
    #[error("names {name}: {error}")]
    Named {
        /// As the file writes it, in quotes.
        name: String,
        /// What is wrong there.
        error: Box<MeshFileError>,
    },
    /// The file breaks the rules of its format.
    #[error("{0}")]
    Malformed(String),
    /// The file is sound, and uses what is not read.
    #[error("{0}")]
    Unsupported(String),
    /// Anything with a way out of its own.
    #[error("{what}")]
    Advised {
        /// What it is.
        what: String,
        /// The way out.
        help: String,
    },
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

/// The formats in which programs that make meshes write what is read here.
const EXPORT: &str =
    "export it again from the program that made it, or as .obj, .ply, .stl or .glb from Blender or MeshLab";

/// What belongs where a height map does.
pub const HEIGHT_MAP: &str =
    "a grey PNG of 8 or 16 bits, or an npy, npz or EXR file with values from 0 to 1, belongs here";

impl MeshFileProblem {
    /// The same with a way out of its own.
    pub(super) fn advised(what: impl Into<String>, help: impl Into<String>) -> Self {
        Self::Advised { what: what.into(), help: help.into() }
    }

    /// A file that the system does not let be read, or in whose place something stands.
    pub(super) fn unreadable(error: io::Error) -> Self {
        match error.get_ref().and_then(|inner| inner.downcast_ref::<Foreign>()) {
            Some(foreign) => Self::Foreign(*foreign),
            None => Self::Unreadable(error),
        }
    }

    /// A way out.
    fn help(&self) -> String {
        let help = match self {
            Self::Unreadable(error) if error.kind() == io::ErrorKind::OutOfMemory => {
                "free some memory, or use a smaller mesh"
            }
            Self::Unreadable(error) if error.kind() == io::ErrorKind::PermissionDenied => {
                "let it be read, and the folders that it is in: chmod +r FILE, chmod +x FOLDER"
            }
            Self::Unreadable(_) => "check the path: a file belongs there",
            Self::Foreign(foreign) => foreign.help,
            Self::UnknownExtension(help) | Self::Advised { help, .. } => help,
            Self::Points(points) => points.help(),
            Self::Missing(missing) => return missing.help(),
            Self::Named { error, .. } => return error.help(),
            Self::Mesh(MeshError::NoSuchVertex { .. } | MeshError::NoFiniteVertex) | Self::Malformed(_) => EXPORT,
            Self::Mesh(MeshError::TooLarge(_)) => {
                "write the unit of its coordinates, such as unit = \"mm\", under [[object]]"
            }
            Self::Mesh(MeshError::TooMany(_)) => "reduce its triangles, e.g. with the modifier Decimate of Blender",
            Self::Mesh(_) => "there is nothing in it to press: export it again, with its faces",
            Self::Room { .. } | Self::EndsEarly(_) => "it is cut off or damaged: copy, download or export it again",
            Self::Unsupported(_) => "export it without that, or in another format",
            Self::NoHeightMap(_) => HEIGHT_MAP,
        };
        help.to_owned()
    }
}

impl MeshFileError {
    /// A way out.
    pub fn help(&self) -> String {
        let is_absent = |error: &io::Error| error.kind() == io::ErrorKind::NotFound;
        match (&self.problem, &self.path) {
            (MeshFileProblem::Unreadable(error), Some(path)) if is_absent(error) => {
                let is_mesh = |path: &Path| Format::from_path(path).is_some();
                match meant(path, is_mesh) {
                    Some(name) => format!("did you mean {}?", path.with_file_name(name).display()),
                    None => self.problem.help(),
                }
            }
            _ => self.problem.help(),
        }
    }

    /// What is true of several files with such a problem, behind their number.
    pub fn cause(&self) -> String {
        let cause = match &self.problem {
            MeshFileProblem::Unreadable(_) => "meshes cannot be read",
            MeshFileProblem::Foreign(foreign) => return format!("files are each {}", foreign.what),
            MeshFileProblem::UnknownExtension(_) => "files are not named like meshes",
            MeshFileProblem::Mesh(_) => "meshes hold nothing that can be pressed",
            MeshFileProblem::Points(_) => "files hold points and no triangle",
            MeshFileProblem::Missing(_) => "files name others that are not there",
            MeshFileProblem::Named { .. } => "files name others that cannot be used",
            MeshFileProblem::Unsupported(_) => "meshes use what is not read",
            MeshFileProblem::Advised { .. } => "meshes cannot be used",
            MeshFileProblem::NoHeightMap(_) => "files are no height maps",
            MeshFileProblem::Malformed(_) | MeshFileProblem::Room { .. } | MeshFileProblem::EndsEarly(_) => {
                "meshes are damaged"
            }
        };
        cause.to_owned()
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
