//! Why a dataset's folder or a file in it could not be used: the user's to decide, or the disk's.

use std::io;
use std::path::PathBuf;

use gelsim_files::diagnostic::Report;

/// Why a folder could not be used.
#[derive(Debug)]
pub enum Refused {
    /// The user has to decide something.
    Usage(Report),
    /// The disk said no.
    Io(PathBuf, io::Error),
}
