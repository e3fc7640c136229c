//! Texts that a user wrote, and places in them: what a message needs to show file, line and column.

use std::path::PathBuf;

/// A text that was read.
#[derive(Clone, Debug)]
pub struct SourceText {
    /// The name in messages: the path as the user gave it, or the command-line flag.
    pub name: String,
    /// The text itself.
    pub text: String,
    /// The folder that relative paths in this text start from.
    pub folder: PathBuf,
}

/// A range of bytes in a source.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct SourceSpan {
    /// Index of the source among those that were read.
    pub source: usize,
    /// Offset of the first byte.
    pub start: usize,
    /// Offset one past the last byte.
    pub end: usize,
}
