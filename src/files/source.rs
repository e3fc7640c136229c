//! Texts that a user wrote, and places in them: what a message needs to show file, line and column.

use std::iter;
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

/// The lines of a text, found once for messages about many of them. Lines are counted from 1.
#[derive(Clone, Debug)]
pub struct LineStarts {
    /// Offset of each line's first byte; the last is that of the line that would follow.
    starts: Vec<usize>,
}

impl LineStarts {
    /// Finds the lines of a text.
    pub fn find(text: &str) -> Self {
        let behind_ends = text.match_indices('\n').map(|(end, _)| end + 1);
        Self { starts: iter::once(0).chain(behind_ends).chain([text.len() + 1]).collect() }
    }

    /// Returns the place of a line in the first source, without its line end; of the last line if there are fewer.
    pub fn place(&self, line: u64) -> SourceSpan {
        let line = (line as usize).clamp(1, self.starts.len() - 1);
        SourceSpan { source: 0, start: self.starts[line - 1], end: self.starts[line] - 1 }
    }

    /// Returns the number of the line that holds the byte at `offset`.
    pub fn number_at(&self, offset: usize) -> usize {
        self.starts[..self.starts.len() - 1].partition_point(|start| *start <= offset)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn lines_are_those_that_counting_line_ends_finds() {
        for text in ["", "a", "\n", "ab\n", "ab\ncd", "\n\nab\n\n"] {
            let lines = LineStarts::find(text);
            let all: Vec<&str> = text.split('\n').collect();
            for (k, line) in all.iter().enumerate() {
                let SourceSpan { start, end, .. } = lines.place(k as u64 + 1);
                assert_eq!(&text[start..end], *line, "{text:?}, line {}", k + 1);
            }
            for line in [0, all.len() as u64 + 1, u64::MAX] {
                assert!(lines.place(line).end <= text.len(), "{text:?}, line {line}");
            }
            for offset in 0..=text.len() {
                assert_eq!(lines.number_at(offset), text[..offset].matches('\n').count() + 1, "{text:?} at {offset}");
            }
            assert_eq!(lines.number_at(usize::MAX), all.len(), "{text:?}");
        }
    }
}
