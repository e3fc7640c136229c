//! Reads the rows of a CSV file that a user wrote and remembers where each stands, so that a message can point there.

use std::iter;
use std::path::Path;

use csv::{ReaderBuilder, StringRecord};

use crate::diagnostic::{Diagnostic, Diagnostics, Report, user_error};
use crate::foreign;
use crate::source::{SourceSpan, SourceText};

/// One record of a CSV file.
pub struct TableRow<'a> {
    /// The text of the whole file.
    pub text: &'a str,
    /// The offset of the record's first byte.
    pub start: usize,
    /// The offset just behind the record's last byte, without its line end.
    pub end: usize,
    /// The line on which the record begins, from 1.
    pub line: u64,
    /// The cells as they were written, without their quotes.
    pub cells: StringRecord,
}

impl TableRow<'_> {
    /// Returns the cell number `index` without the spaces around it, or an empty text if there is none.
    pub fn cell(&self, index: usize) -> &str {
        self.cells.get(index).unwrap_or_default().trim()
    }

    /// Makes an error that points at the cell number `index`.
    pub fn error_in_cell(&self, index: usize, message: impl Into<String>) -> Diagnostic {
        Diagnostic::new(message).at(cell_place(self.text, self.start, index))
    }
}

/// Iterates over the records of a text. Empty lines are left out.
pub fn iter_rows(text: &str) -> impl Iterator<Item = TableRow<'_>> {
    let mut reader = ReaderBuilder::new().has_headers(false).flexible(true).from_reader(text.as_bytes());
    let (mut line, mut counted) = (1, 0);
    iter::from_fn(move || {
        let mut cells = StringRecord::new();
        // Nothing can fail: the text is in memory and UTF-8.
        if !reader.read_record(&mut cells).ok()? {
            return None;
        }
        // The reader passes over empty lines in silence: skip them, so that the place is that of the record itself.
        let from = cells.position().map_or(0, |position| position.byte() as usize);
        let start = from + text[from..].bytes().take_while(|byte| *byte == b'\n').count();
        let end = start + text[start..reader.position().byte() as usize].trim_end_matches('\n').len();
        line += text[counted..start].bytes().filter(|byte| *byte == b'\n').count() as u64;
        counted = start;
        Some(TableRow { text, start, end, line, cells })
    })
}

/// Returns the place of the record that begins at `start`: its first line.
pub fn row_place(text: &str, start: usize) -> SourceSpan {
    let length = text[start..].find('\n').unwrap_or(text.len() - start);
    SourceSpan { source: 0, start, end: start + length }
}

/// Returns the place of the cell number `index` of the record that begins at `start`, its quotes included.
pub fn cell_place(text: &str, start: usize, index: usize) -> SourceSpan {
    let (mut quoted, mut from, mut left) = (false, start, index);
    let mut end = text.len();
    for (at, byte) in text.bytes().enumerate().skip(start) {
        match byte {
            b'"' if quoted => quoted = false,
            // A quote opens a cell at its start, or is the second of two that stand for one.
            b'"' => quoted = at == from || text.as_bytes()[at - 1] == b'"',
            b',' if !quoted && left > 0 => (from, left) = (at + 1, left - 1),
            b',' | b'\n' if !quoted => {
                end = at;
                break;
            }
            _ => {}
        }
    }
    SourceSpan { source: 0, start: from, end }
}

/// Finds a quote that is never closed, or that is closed before the end of its cell. A reader would take all that
/// follows, rows included, for one cell. Returns `None` if all quotes are in order.
pub fn check_quotes(text: &str) -> Option<Diagnostic> {
    let bytes = text.as_bytes();
    let (mut at, mut at_start) = (0, true);
    while at < bytes.len() {
        if !(at_start && bytes[at] == b'"') {
            at_start = matches!(bytes[at], b',' | b'\n');
            at += 1;
            continue;
        }
        let opened = at;
        at += 1;
        // Two quotes stand for one in the text.
        while at < bytes.len() && (bytes[at] != b'"' || bytes.get(at + 1) == Some(&b'"')) {
            at += if bytes[at] == b'"' { 2 } else { 1 };
        }
        let end = text[opened..].find('\n').map_or(text.len(), |length| opened + length);
        let place = SourceSpan { source: 0, start: opened, end };
        if at >= bytes.len() {
            let problem = Diagnostic::new("a quote is opened and never closed").at(place);
            return Some(problem.help("write `\"` at the cell's end, or two of them for one that is in the text"));
        }
        at += 1;
        at += bytes[at..].iter().take_while(|byte| matches!(byte, b' ' | b'\t')).count();
        if !matches!(bytes.get(at), None | Some(b',' | b'\n')) {
            let line = text[..at].bytes().filter(|byte| *byte == b'\n').count() + 1;
            let message = format!("a quote is opened here and closed on line {line}, where its cell does not end");
            let help = "write `\"` at the cell's end, or two of them for one that is in the text";
            return Some(Diagnostic::new(message).at(place).help(help));
        }
        at_start = false;
    }
    None
}

/// Decodes the text of a table and unifies its line ends to `\n`. The error holds the text as far as it can be shown,
/// and what is wrong with it.
pub fn decode_table(bytes: &[u8]) -> Result<String, (String, Diagnostic)> {
    let bytes = bytes.strip_prefix("\u{feff}".as_bytes()).unwrap_or(bytes);
    let text = String::from_utf8_lossy(bytes).replace("\r\n", "\n").replace('\r', "\n");
    if let Err(error) = str::from_utf8(bytes) {
        let problem = explain_invalid_utf8(&bytes[..error.valid_up_to()], &text);
        return Err((text, problem));
    }
    match text.find('\0') {
        None => Ok(text),
        Some(at) => {
            let problem = Diagnostic::new("the table has a NUL byte, which is no text");
            let problem = problem.at(SourceSpan { source: 0, start: at, end: at + 1 });
            Err((text, problem.help("save it in UTF-8, or copy it again: a part of it is damaged")))
        }
    }
}

/// Decodes the table in the file at `path` with line ends `\n`. The error is a report that shows the place that is no
/// UTF-8 text.
pub fn decode_source(path: &Path, bytes: &[u8]) -> Result<SourceText, Report> {
    let folder = path.parent().unwrap_or(Path::new("")).to_owned();
    let name = path.display().to_string();
    match decode_table(bytes) {
        Ok(text) => Ok(SourceText { name, text, folder }),
        Err((text, problem)) => {
            let mut problems = Diagnostics::default();
            problems.push(problem);
            Err(Report::new(&problems, &[SourceText { name, text, folder }]))
        }
    }
}

/// Decodes a table as [`decode_source`] does. A file of another kind is refused by its kind.
pub fn decode_user_table(path: &Path, bytes: &[u8]) -> Result<SourceText, Report> {
    // An empty file has a message of its own.
    if let Some(foreign) = foreign::identify_foreign_file(bytes).filter(|_| !bytes.is_empty()) {
        let message = format!("{} is no table: it is {}", path.display(), foreign.what);
        let help = if foreign.what.contains("ZIP") {
            "a spreadsheet (.xlsx, .ods) is such an archive: save it as CSV in UTF-8, and name that file"
        } else {
            foreign.help
        };
        return Err(user_error(message, help));
    }
    decode_source(path, bytes)
}

/// Makes the message for a table that is not UTF-8, from the bytes before the first wrong one and the text that is
/// shown.
fn explain_invalid_utf8(before: &[u8], text: &str) -> Diagnostic {
    // The text that is shown has one byte for each "\r\n", so the place is one byte earlier for each of them.
    let returns = before.windows(2).filter(|pair| pair == b"\r\n").count();
    let start = before.len() - returns;
    let length = text[start..].chars().next().map_or(0, char::len_utf8);
    let problem = Diagnostic::new("the table is not UTF-8").at(SourceSpan { source: 0, start, end: start + length });
    problem.help("save it as CSV in UTF-8")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_quote_that_nothing_closes_is_found_where_it_is_opened() {
        let place =
            |text: &str| check_quotes(text).map(|problem| (problem.place.expect("a place").start, problem.message));
        for sound in [
            "a,b\n1,\"x, y\"\n",
            "a\n\"two\nlines\"\n",
            "a,b\n\"\",\"say \"\"x\"\"\"",
            "a\n5\" disk\n",
            "a, \"b\n",
            "\"a\" ,1\n",
            "\"a\",\"b\"",
        ] {
            assert_eq!(place(sound), None, "{sound}");
        }
        for (text, at, word) in [
            ("file,d\n\"0.png,0.5\n1.png,0.6\n", 7, "never closed"),
            ("file,d\n\"0.png,0.5\n1.png,\"x\"\n", 7, "closed on line 3"),
            ("file,d\n\"0.png,0.5\n\"1.png\",0.6\n", 7, "closed on line 3"),
            ("file,d\n0.png,\"a\"\"\n", 13, "never closed"),
            ("\"file,d\n", 0, "never closed"),
        ] {
            let (found, message) = place(text).unwrap_or_else(|| panic!("{text}"));
            assert!(found == at && message.contains(word), "{text}: {found} {message}");
        }
    }

    #[test]
    fn what_is_no_text_is_told_with_its_place() {
        assert_eq!(decode_table(b"\xef\xbb\xbfa\r\nb\rc").as_deref(), Ok("a\nb\nc"));
        for (bytes, start, word) in
            [(b"a\r\nb\xff".as_slice(), 3, "not UTF-8"), (b"a\nb\0c", 3, "NUL"), (b"\xff\xfea\0", 0, "not UTF-8")]
        {
            let (_, problem) = decode_table(bytes).expect_err("no text");
            assert!(problem.message.contains(word), "{}", problem.message);
            assert_eq!(problem.place.map(|place| place.start), Some(start), "{word}");
        }
    }
}
