//! Errors about a dataset's folder or its files: those that the user has to decide on, and those of the disk.

use std::io;
use std::path::PathBuf;

use gelsim_files::diagnostic::Report;

/// Why a dataset's folder could not be used.
#[derive(Debug)]
pub enum DatasetError {
    /// The user has to decide something.
    Usage(Report),
    /// Reading or writing this path failed.
    Io(PathBuf, io::Error),
}
