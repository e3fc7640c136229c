//! The words of text formats.

use super::MeshFileProblem;

/// Takes text apart into words and counts its lines, in any encoding that contains ASCII.
///
/// A line ends with LF, CR LF or CR. Between words stand blanks, or `\` at the end of a line; `#` starts a comment.
#[derive(Clone, Copy)]
pub(super) struct Words<'a> {
    pub(super) bytes: &'a [u8],
    pub(super) at: usize,
    /// The line of the next word, counted from 1.
    pub(super) line: usize,
}

impl<'a> Words<'a> {
    pub(super) fn new(bytes: &'a [u8]) -> Self {
        Words { bytes: bytes.strip_prefix(b"\xef\xbb\xbf").unwrap_or(bytes), at: 0, line: 1 }
    }

    /// The next word of this line, or of the lines that continue it.
    pub(super) fn word(&mut self) -> Option<&'a [u8]> {
        if !self.has_word() {
            return None;
        }
        let rest = &self.bytes[self.at..];
        let mut end = 1;
        while let Some(byte) = rest.get(end) {
            match byte {
                b' ' | b'\t' | b'\x0b' | b'\x0c' | b'\n' | b'\r' | b'#' => break,
                b'\\' if self.break_len(self.at + end + 1) > 0 => break,
                _ => end += 1,
            }
        }
        self.at += end;
        Some(&rest[..end])
    }

    /// Passes over blanks; whether a word follows in this line.
    pub(super) fn has_word(&mut self) -> bool {
        loop {
            match self.bytes.get(self.at) {
                Some(b' ' | b'\t' | b'\x0b' | b'\x0c') => self.at += 1,
                Some(b'\\') if self.break_len(self.at + 1) > 0 => {
                    self.at += 1 + self.break_len(self.at + 1);
                    self.line += 1;
                }
                None | Some(b'\n' | b'\r' | b'#') => return false,
                Some(_) => return true,
            }
        }
    }

    /// The next word of this line or any further one.
    pub(super) fn word_anywhere(&mut self) -> Option<&'a [u8]> {
        loop {
            match self.word() {
                None if self.next_line() => {}
                word => return word,
            }
        }
    }

    /// Passes over the rest of this line; false if no further one follows.
    pub(super) fn next_line(&mut self) -> bool {
        let rest = &self.bytes[self.at..];
        let len = rest.iter().position(|byte| matches!(byte, b'\n' | b'\r')).unwrap_or(rest.len());
        self.at += len;
        self.at += self.break_len(self.at);
        self.line += 1;
        self.at < self.bytes.len()
    }

    /// Bytes of the line break at `at`: 0 if there is none.
    pub(super) fn break_len(&self, at: usize) -> usize {
        match (self.bytes.get(at), self.bytes.get(at + 1)) {
            (Some(b'\r'), Some(b'\n')) => 2,
            (Some(b'\r' | b'\n'), _) => 1,
            _ => 0,
        }
    }
}

/// A number; also the `nan(ind)` of some C libraries.
pub(super) fn number(word: &[u8]) -> Result<f64, MeshFileProblem> {
    let text = str::from_utf8(word).ok();
    match text.and_then(|text| text.parse().ok()) {
        Some(number) => Ok(number),
        None if text.is_some_and(|text| text.trim_start_matches(['+', '-']).starts_with("nan(")) => Ok(f64::NAN),
        None => Err(MeshFileProblem::Malformed(format!("{} is not a number", quoted(word)))),
    }
}

/// The next three numbers of the line.
pub(super) fn coordinates(words: &mut Words) -> Result<[f64; 3], MeshFileProblem> {
    let mut point = [0.0; 3];
    for (given, coordinate) in point.iter_mut().enumerate() {
        let word = words
            .word()
            .ok_or_else(|| MeshFileProblem::Malformed(format!("a vertex has {given} coordinates instead of 3")))?;
        *coordinate = number(word)?;
    }
    Ok(point)
}

/// The start of a word for an error message, on one line whatever its bytes are.
pub(super) fn quoted(word: &[u8]) -> String {
    let text = String::from_utf8_lossy(&word[..word.len().min(40)]);
    format!("`{}`", text.escape_debug())
}
