//! Texts that a user wrote, and places in them: what a message needs to show file, line and column.

use std::path::PathBuf;

/// One text that was read.
#[derive(Clone, Debug)]
pub struct Source {
    /// What messages call it: the path as the user gave it, or the command-line flag.
    pub name: String,
    /// The text itself.
    pub text: String,
    /// Folder that relative paths in this text start from.
    pub folder: PathBuf,
}

/// A range of bytes in one source.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct Place {
    /// Which of the sources that were read, counted from 0.
    pub source: usize,
    /// First byte.
    pub start: usize,
    /// One past the last byte.
    pub end: usize,
}
