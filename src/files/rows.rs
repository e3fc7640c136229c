//! Rows of a CSV file that a user wrote, each with the place where it stands.

use std::iter;
use std::path::Path;

use csv::{ReaderBuilder, StringRecord};

use crate::files::diagnostic::{Diagnostic, Diagnostics, Report};
use crate::files::source::{Place, Source};

/// One record of the file.
pub struct Row<'a> {
    /// The whole text.
    pub text: &'a str,
    /// Its first byte.
    pub start: usize,
    /// The byte behind its last, without its line end.
    pub end: usize,
    /// Its line, from 1.
    pub line: u64,
    /// Its cells as they were written, without their quotes.
    pub cells: StringRecord,
}

impl Row<'_> {
    /// The cell number `index` without the spaces around it; empty if there is none.
    pub fn cell(&self, index: usize) -> &str {
        self.cells.get(index).unwrap_or_default().trim()
    }

    /// A mistake in the cell number `index`.
    pub fn wrong(&self, index: usize, message: impl Into<String>) -> Diagnostic {
        Diagnostic::new(message).at(cell_place(self.text, self.start, index))
    }
}

/// The records of a text without empty lines.
pub fn rows(text: &str) -> impl Iterator<Item = Row<'_>> {
    let mut reader = ReaderBuilder::new().has_headers(false).flexible(true).from_reader(text.as_bytes());
    let (mut line, mut counted) = (1, 0);
    iter::from_fn(move || {
        let mut cells = StringRecord::new();
        // Nothing can fail: the text is in memory and UTF-8.
        if !reader.read_record(&mut cells).ok()? {
            return None;
        }
        let from = cells.position().map_or(0, |position| position.byte() as usize);
        let start = from + text[from..].bytes().take_while(|byte| *byte == b'\n').count();
        let end = start + text[start..reader.position().byte() as usize].trim_end_matches('\n').len();
        line += text[counted..start].bytes().filter(|byte| *byte == b'\n').count() as u64;
        counted = start;
        Some(Row { text, start, end, line, cells })
    })
}

/// Where the record that begins at `start` stands: its first line.
pub fn row_place(text: &str, start: usize) -> Place {
    let length = text[start..].find('\n').unwrap_or(text.len() - start);
    Place { source: 0, start, end: start + length }
}

/// Where the cell number `index` of the record that begins at `start` stands, its quotes included.
pub fn cell_place(text: &str, start: usize, index: usize) -> Place {
    let (mut quoted, mut from, mut left) = (false, start, index);
    let mut end = text.len();
    for (at, byte) in text.bytes().enumerate().skip(start) {
        match byte {
            b'"' if quoted => quoted = false,
            // At the cell's start, or the second one of two that stand for one.
            b'"' => quoted = at == from || text.as_bytes()[at - 1] == b'"',
            b',' if !quoted && left > 0 => (from, left) = (at + 1, left - 1),
            b',' | b'\n' if !quoted => {
                end = at;
                break;
            }
            _ => {}
        }
    }
    Place { source: 0, start: from, end }
}

/// The text of the table in the file at `path`, with one kind of line end; a report if it is not UTF-8.
pub fn source(path: &Path, bytes: &[u8]) -> Result<Source, Report> {
    let bytes = bytes.strip_prefix("\u{feff}".as_bytes()).unwrap_or(bytes);
    let text = String::from_utf8_lossy(bytes).replace("\r\n", "\n").replace('\r', "\n");
    let folder = path.parent().unwrap_or(Path::new("")).to_owned();
    let source = Source { name: path.display().to_string(), text, folder };
    match str::from_utf8(bytes) {
        Ok(_) => Ok(source),
        Err(error) => {
            let mut problems = Diagnostics::default();
            problems.push(not_utf8(&bytes[..error.valid_up_to()], &source.text));
            Err(Report::new(&problems, &[source]))
        }
    }
}

/// The bytes before the first that is not UTF-8, and the whole text.
fn not_utf8(before: &[u8], text: &str) -> Diagnostic {
    let returns = before.windows(2).filter(|pair| pair == b"\r\n").count();
    let start = before.len() - returns;
    let length = text[start..].chars().next().map_or(0, char::len_utf8);
    let problem = Diagnostic::new("the table is not UTF-8").at(Place { source: 0, start, end: start + length });
    problem.help("save it as CSV in UTF-8")
}
