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

/// Bytes that a word may end before: a backslash only at the end of a line.
const MAY_END: [bool; 256] = {
    let mut ends = [false; 256];
    let bytes = b" \t\x0b\x0c\n\r#\\";
    let mut k = 0;
    while k < bytes.len() {
        ends[bytes[k] as usize] = true;
        k += 1;
    }
    ends
};

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
        loop {
            end += rest[end..].iter().position(|byte| MAY_END[usize::from(*byte)]).unwrap_or(rest.len() - end);
            if rest.get(end) != Some(&b'\\') || self.break_len(self.at + end + 1) > 0 {
                break;
            }
            end += 1;
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
    if let Some(number) = plain(word) {
        return Ok(number);
    }
    let text = str::from_utf8(word).ok();
    match text.and_then(|text| text.parse().ok()) {
        Some(number) => Ok(number),
        None if text.is_some_and(|text| text.trim_start_matches(['+', '-']).starts_with("nan(")) => Ok(f64::NAN),
        None if text.is_some_and(has_decimal_comma) => {
            let help =
                "numbers have a decimal point: export it again where the system's language writes one (LC_ALL=C)";
            Err(MeshFileProblem::advised(format!("{} is not a number", quoted(word)), help))
        }
        None => Err(MeshFileProblem::Malformed(format!("{} is not a number", quoted(word)))),
    }
}

/// True of a number with a comma where others have a point.
fn has_decimal_comma(text: &str) -> bool {
    text.matches(',').count() == 1 && text.replace(',', ".").parse::<f64>().is_ok()
}

/// A number of digits and a point, as most are: the same as the general way gives, in a third of its time. `None` if it is
/// anything else.
fn plain(word: &[u8]) -> Option<f64> {
    /// Digits whose number a float holds exactly, as it does their power of ten: one division then rounds once.
    const MOST_DIGITS: usize = 15;
    const TENS: [f64; MOST_DIGITS + 1] =
        [1e0, 1e1, 1e2, 1e3, 1e4, 1e5, 1e6, 1e7, 1e8, 1e9, 1e10, 1e11, 1e12, 1e13, 1e14, 1e15];
    let (sign, digits) = match word {
        [b'-', rest @ ..] => (-1.0, rest),
        _ => (1.0, word),
    };
    if digits.len() < 2 || digits.len() > MOST_DIGITS + 1 {
        return None;
    }
    let (mut number, mut after_point) = (0_u64, None);
    for (at, byte) in digits.iter().enumerate() {
        match byte {
            b'0'..=b'9' => number = 10 * number + u64::from(byte - b'0'),
            b'.' if after_point.is_none() => after_point = Some(digits.len() - 1 - at),
            _ => return None,
        }
    }
    // Sixteen digits without a point are one too many.
    let after_point = after_point?;
    Some(sign * (number as f64 / TENS[after_point]))
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

/// The name of a file for a message, whole unless it is longer than any is.
pub(super) fn named(name: &str) -> String {
    const LONGEST: usize = 300;
    let shown: String = name.chars().take(LONGEST).collect();
    let more = if shown.len() < name.len() { ".." } else { "" };
    format!("`{}{more}`", shown.escape_debug())
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        /// The quick way and the general one give the same bits.
        #[test]
        fn plain_numbers_are_what_the_standard_library_reads(word in "-?[0-9]{0,9}\\.?[0-9]{0,9}") {
            if let Some(number) = plain(word.as_bytes()) {
                prop_assert_eq!(number.to_bits(), word.parse::<f64>().unwrap().to_bits());
            }
        }
    }

    #[test]
    fn numbers_with_a_point_are_plain_and_others_are_not() {
        for (word, expected) in [("1.", Some(1.0)), ("-.5", Some(-0.5)), ("12.345678", Some(12.345678))] {
            assert_eq!(plain(word.as_bytes()), expected, "{word}");
        }
        for word in ["", ".", "-.", "1", "1.2.3", "1e5", "+1.0", "nan", "1234567890.1234567", "1,0"] {
            assert_eq!(plain(word.as_bytes()), None, "{word}");
        }
    }
}
