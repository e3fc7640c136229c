//! Splits text formats into words and numbers.

use super::MeshFileProblem;

/// Splits text in any encoding that contains ASCII into words and counts its lines.
///
/// A line ends with LF, CR LF or CR. Words are separated by blanks, or by `\` at the end of a line; `#` starts a
/// comment.
#[derive(Clone, Copy)]
pub(super) struct WordReader<'a> {
    pub(super) bytes: &'a [u8],
    pub(super) at: usize,
    /// The line of the next word, counted from 1.
    pub(super) line: usize,
}

/// Bytes before which a word may end. A backslash ends a word only at the end of a line.
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

impl<'a> WordReader<'a> {
    pub(super) fn new(bytes: &'a [u8]) -> Self {
        WordReader { bytes: bytes.strip_prefix(b"\xef\xbb\xbf").unwrap_or(bytes), at: 0, line: 1 }
    }

    /// Returns the next word of this line, or of the lines that continue it.
    pub(super) fn next_word(&mut self) -> Option<&'a [u8]> {
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

    /// Skips blanks and returns true if a word follows in this line.
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

    /// Returns the next word of this line or any further one.
    pub(super) fn next_word_any_line(&mut self) -> Option<&'a [u8]> {
        loop {
            match self.next_word() {
                None if self.next_line() => {}
                word => return word,
            }
        }
    }

    /// Skips the rest of this line. Returns false if it was the last one.
    pub(super) fn next_line(&mut self) -> bool {
        let rest = &self.bytes[self.at..];
        let len = rest.iter().position(|byte| matches!(byte, b'\n' | b'\r')).unwrap_or(rest.len());
        self.at += len;
        self.at += self.break_len(self.at);
        self.line += 1;
        self.at < self.bytes.len()
    }

    /// Returns the number of bytes of the line break at `at`, or 0 if there is none.
    pub(super) fn break_len(&self, at: usize) -> usize {
        match (self.bytes.get(at), self.bytes.get(at + 1)) {
            (Some(b'\r'), Some(b'\n')) => 2,
            (Some(b'\r' | b'\n'), _) => 1,
            _ => 0,
        }
    }
}

/// Parses a number, or the `nan(ind)` of some C libraries.
pub(super) fn parse_number(word: &[u8]) -> Result<f64, MeshFileProblem> {
    if let Some(number) = parse_plain_decimal(word) {
        return Ok(number);
    }
    let text = str::from_utf8(word).ok();
    match text.and_then(|text| text.parse().ok()) {
        Some(number) => Ok(number),
        None if text.is_some_and(|text| text.trim_start_matches(['+', '-']).starts_with("nan(")) => Ok(f64::NAN),
        None if text.is_some_and(has_decimal_comma) => {
            let help =
                "numbers have a decimal point: export it again where the system's language writes one (LC_ALL=C)";
            Err(MeshFileProblem::with_help(format!("{} is not a number", quote_word(word)), help))
        }
        None => Err(MeshFileProblem::Malformed(format!("{} is not a number", quote_word(word)))),
    }
}

/// Returns true for a number with a comma in place of the decimal point.
fn has_decimal_comma(text: &str) -> bool {
    text.matches(',').count() == 1 && text.replace(',', ".").parse::<f64>().is_ok()
}

/// Parses a number of digits and a point, as most are. The result is that of the general way, in a third of its time.
/// Returns `None` for anything else.
fn parse_plain_decimal(word: &[u8]) -> Option<f64> {
    /// Most digits. A float holds a whole number of this many digits exactly, and its power of ten, too, so that one
    /// division rounds once.
    const MAX_DIGITS: usize = 15;
    const TENS: [f64; MAX_DIGITS + 1] =
        [1e0, 1e1, 1e2, 1e3, 1e4, 1e5, 1e6, 1e7, 1e8, 1e9, 1e10, 1e11, 1e12, 1e13, 1e14, 1e15];
    let (sign, digits) = match word {
        [b'-', rest @ ..] => (-1.0, rest),
        _ => (1.0, word),
    };
    if digits.len() < 2 || digits.len() > MAX_DIGITS + 1 {
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
    // A number without a point may have sixteen digits, one too many, and is left to the general way.
    let after_point = after_point?;
    Some(sign * (number as f64 / TENS[after_point]))
}

/// Reads the next three numbers of the line.
pub(super) fn read_coordinates(words: &mut WordReader) -> Result<[f64; 3], MeshFileProblem> {
    let mut point = [0.0; 3];
    for (given, coordinate) in point.iter_mut().enumerate() {
        let word = words
            .next_word()
            .ok_or_else(|| MeshFileProblem::Malformed(format!("a vertex has {given} coordinates instead of 3")))?;
        *coordinate = parse_number(word)?;
    }
    Ok(point)
}

/// Quotes the start of a word for an error message, on one line whatever its bytes are.
pub(super) fn quote_word(word: &[u8]) -> String {
    let text = String::from_utf8_lossy(&word[..word.len().min(40)]);
    format!("`{}`", text.escape_debug())
}

/// Quotes the name of a file for a message, in full unless it is longer than any real name.
pub(super) fn quote_file_name(name: &str) -> String {
    const MAX_CHARS: usize = 300;
    let shown: String = name.chars().take(MAX_CHARS).collect();
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
            if let Some(number) = parse_plain_decimal(word.as_bytes()) {
                prop_assert_eq!(number.to_bits(), word.parse::<f64>().unwrap().to_bits());
            }
        }
    }

    #[test]
    fn numbers_with_a_point_are_plain_and_others_are_not() {
        for (word, expected) in [("1.", Some(1.0)), ("-.5", Some(-0.5)), ("12.345678", Some(12.345678))] {
            assert_eq!(parse_plain_decimal(word.as_bytes()), expected, "{word}");
        }
        for word in ["", ".", "-.", "1", "1.2.3", "1e5", "+1.0", "nan", "1234567890.1234567", "1,0"] {
            assert_eq!(parse_plain_decimal(word.as_bytes()), None, "{word}");
        }
    }
}
