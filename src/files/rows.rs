//! Rows of a CSV file that a user wrote, each with the place where it stands.

use std::iter;
use std::path::Path;

use csv::{ReaderBuilder, StringRecord};

use crate::diagnostic::{Diagnostic, Diagnostics, Report};
use crate::source::{Place, Source};

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

/// A quote that is not where CSV has one: never closed, or closed before the end of its cell. Readers would take what follows,
/// rows and all, for one cell.
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
        // Two quotes stand for one.
        while at < bytes.len() && (bytes[at] != b'"' || bytes.get(at + 1) == Some(&b'"')) {
            at += if bytes[at] == b'"' { 2 } else { 1 };
        }
        let end = text[opened..].find('\n').map_or(text.len(), |length| opened + length);
        let place = Place { source: 0, start: opened, end };
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

/// The text of a table, with one kind of line end; else what is wrong with it, and the text as far as it can be shown.
pub fn decode(bytes: &[u8]) -> Result<String, (String, Diagnostic)> {
    let bytes = bytes.strip_prefix("\u{feff}".as_bytes()).unwrap_or(bytes);
    let text = String::from_utf8_lossy(bytes).replace("\r\n", "\n").replace('\r', "\n");
    if let Err(error) = str::from_utf8(bytes) {
        let problem = not_utf8(&bytes[..error.valid_up_to()], &text);
        return Err((text, problem));
    }
    match text.find('\0') {
        None => Ok(text),
        Some(at) => {
            let problem = Diagnostic::new("the table has a NUL byte, which is no text");
            let problem = problem.at(Place { source: 0, start: at, end: at + 1 });
            Err((text, problem.help("save it in UTF-8, or copy it again: a part of it is damaged")))
        }
    }
}

/// The text of the table in the file at `path`, with one kind of line end; a report if it is not UTF-8.
pub fn source(path: &Path, bytes: &[u8]) -> Result<Source, Report> {
    let folder = path.parent().unwrap_or(Path::new("")).to_owned();
    let name = path.display().to_string();
    match decode(bytes) {
        Ok(text) => Ok(Source { name, text, folder }),
        Err((text, problem)) => {
            let mut problems = Diagnostics::default();
            problems.push(problem);
            Err(Report::new(&problems, &[Source { name, text, folder }]))
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
        assert_eq!(decode(b"\xef\xbb\xbfa\r\nb\rc").as_deref(), Ok("a\nb\nc"));
        for (bytes, start, word) in
            [(b"a\r\nb\xff".as_slice(), 3, "not UTF-8"), (b"a\nb\0c", 3, "NUL"), (b"\xff\xfea\0", 0, "not UTF-8")]
        {
            let (_, problem) = decode(bytes).expect_err("no text");
            assert!(problem.message.contains(word), "{}", problem.message);
            assert_eq!(problem.place.map(|place| place.start), Some(start), "{word}");
        }
    }
}
