//! What can be wrong with a mesh file, and what to do about it.

use std::fmt;
use std::io;
use std::path::{Path, PathBuf};

use super::format::{ENDINGS, Format};
use super::missing_files::MissingFiles;
use super::points::LoosePoints;
use crate::foreign::ForeignFile;
use crate::input::suggest_file_name;
use gelsim_core::mesh::MeshError;

/// Why a mesh file cannot be used, and where. Its text is one line, such as
/// `objects/a.obj:17: face refers to vertex 9, but the file has 8 so far`.
#[derive(Debug, thiserror::Error)]
pub struct MeshFileError {
    /// The file, if it is known.
    pub path: Option<PathBuf>,
    /// The line of the file, counted from 1, if it is a text and one line is to blame.
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
    /// The file is not a mesh, by its bytes.
    #[error("is {}", .0.what)]
    Foreign(ForeignFile),
    /// The extension is that of no [`Format`](super::Format). Holds what to do.
    #[error("is not named like a mesh: use {ENDINGS}")]
    UnknownExtension(String),
    /// The file's content makes no mesh.
    #[error(transparent)]
    Mesh(#[from] MeshError),
    /// The file holds points without a surface.
    #[error("{0}")]
    Points(LoosePoints),
    /// The file names other files that are not there.
    #[error("{0}")]
    Missing(MissingFiles),
    /// A file that this one names is wrong.
    #[error("names {name}: {error}")]
    InNamedFile {
        /// The name as the file writes it, in quotes.
        name: String,
        /// What is wrong there.
        error: Box<MeshFileError>,
    },
    /// The file breaks the rules of its format.
    #[error("{0}")]
    Malformed(String),
    /// The file is valid, but uses something that is not read.
    #[error("{0}")]
    Unsupported(String),
    /// Any other problem, with a help of its own.
    #[error("{what}")]
    WithHelp {
        /// What is wrong.
        what: String,
        /// What to do.
        help: String,
    },
    /// An image or array is not a height map.
    #[error("is no height map: {0}")]
    InvalidHeightMap(String),
    /// A header says that there is more (or, in binary STL, less) than there is.
    #[error("says {claimed} {what} but has room for {room}")]
    CountMismatch {
        /// The number in the header.
        claimed: u64,
        /// What is counted.
        what: String,
        /// The number that fits into the bytes that follow, at most.
        room: u64,
    },
    /// The file ends before it is complete.
    #[error("ends too early: in {0}")]
    UnexpectedEnd(String),
}

/// What to do with a damaged mesh.
const EXPORT_HELP: &str =
    "export it again from the program that made it, or as .obj, .ply, .stl or .glb from Blender or MeshLab";

/// What a height map must be.
pub const HEIGHT_MAP_HELP: &str =
    "a grey PNG of 8 or 16 bits, or an npy, npz or EXR file with values from 0 to 1, belongs here";

impl MeshFileProblem {
    /// Makes a problem with a help of its own.
    pub(super) fn with_help(what: impl Into<String>, help: impl Into<String>) -> Self {
        Self::WithHelp { what: what.into(), help: help.into() }
    }

    /// Makes a problem from a failed read: the system denies it, or something else stands in the file's place.
    pub(super) fn from_io_error(error: io::Error) -> Self {
        match error.get_ref().and_then(|inner| inner.downcast_ref::<ForeignFile>()) {
            Some(foreign) => Self::Foreign(*foreign),
            None => Self::Unreadable(error),
        }
    }

    /// Returns what to do.
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
            Self::UnknownExtension(help) | Self::WithHelp { help, .. } => help,
            Self::Points(points) => points.help(),
            Self::Missing(missing) => return missing.help(),
            Self::InNamedFile { error, .. } => return error.help(),
            Self::Mesh(MeshError::NoSuchVertex { .. } | MeshError::NoFiniteVertex) | Self::Malformed(_) => EXPORT_HELP,
            Self::Mesh(MeshError::TooLarge(_)) => {
                "write the unit of its coordinates, such as unit = \"mm\", under [[object]]"
            }
            Self::Mesh(MeshError::TooMany(_)) => "reduce its triangles, e.g. with the modifier Decimate of Blender",
            Self::Mesh(_) => "there is nothing in it to press: export it again, with its faces",
            Self::CountMismatch { .. } | Self::UnexpectedEnd(_) => {
                "it is cut off or damaged: copy, download or export it again"
            }
            Self::Unsupported(_) => "export it without that, or in another format",
            Self::InvalidHeightMap(_) => HEIGHT_MAP_HELP,
        };
        help.to_owned()
    }
}

impl MeshFileError {
    /// Returns what to do. For a file that is not there this is the name of a similar one beside it.
    pub fn help(&self) -> String {
        let is_absent = |error: &io::Error| error.kind() == io::ErrorKind::NotFound;
        match (&self.problem, &self.path) {
            (MeshFileProblem::Unreadable(error), Some(path)) if is_absent(error) => {
                let is_mesh = |path: &Path| Format::from_path(path).is_some();
                match suggest_file_name(path, is_mesh) {
                    Some(name) => format!("did you mean {}?", path.with_file_name(name).display()),
                    None => self.problem.help(),
                }
            }
            _ => self.problem.help(),
        }
    }

    /// Returns what is true of several files with such a problem, to stand after their number.
    pub fn plural_cause(&self) -> String {
        let cause = match &self.problem {
            MeshFileProblem::Unreadable(_) => "meshes cannot be read",
            MeshFileProblem::Foreign(foreign) => return format!("files are each {}", foreign.what),
            MeshFileProblem::UnknownExtension(_) => "files are not named like meshes",
            MeshFileProblem::Mesh(_) => "meshes hold nothing that can be pressed",
            MeshFileProblem::Points(_) => "files hold points and no triangle",
            MeshFileProblem::Missing(_) => "files name others that are not there",
            MeshFileProblem::InNamedFile { .. } => "files name others that cannot be used",
            MeshFileProblem::Unsupported(_) => "meshes use what is not read",
            MeshFileProblem::WithHelp { .. } => "meshes cannot be used",
            MeshFileProblem::InvalidHeightMap(_) => "files are no height maps",
            MeshFileProblem::Malformed(_)
            | MeshFileProblem::CountMismatch { .. }
            | MeshFileProblem::UnexpectedEnd(_) => "meshes are damaged",
        };
        cause.to_owned()
    }

    /// Sets the path, unless the error is already known to be in another file.
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
