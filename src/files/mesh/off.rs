//! Reads OFF of Geomview in ASCII: vertices and faces. Normals, colours and texture coordinates are ignored.
//!
//! Format: Geomview manual, Object File Format (1996).

use crate::mesh::polygon::Triangulator;
use crate::mesh::{MeshFileError, MeshFileProblem, RawMesh, WordReader, quote_word, read_coordinates};
use gelsim_core::mesh::MeshError;

/// Reads vertices and triangles in the order of the file. Each vertex and each face begins a line.
pub(super) fn read(bytes: &[u8]) -> Result<RawMesh, MeshFileError> {
    let mut words = WordReader::new(bytes);
    let [vertices, faces] = read_header(&mut words)?;
    let mut raw = RawMesh::default();
    for _ in 0..vertices {
        begin_line(&mut words, "the vertices")?;
        let line = words.line;
        let vertex = read_coordinates(&mut words).map_err(|problem| MeshFileError::at_line(line, problem))?;
        raw.vertices.push(vertex);
        words.next_line();
    }
    let mut cutter = Triangulator::new();
    let mut corners = Vec::new();
    for _ in 0..faces {
        begin_line(&mut words, "the faces")?;
        let line = words.line;
        read_face(&mut words, raw.vertices.len(), &mut corners)
            .and_then(|()| cutter.triangulate(&raw.vertices, &corners, &mut raw.triangles))
            .map_err(|problem| MeshFileError::at_line(line, problem))?;
        words.next_line();
    }
    Ok(raw)
}

/// Returns true for a text that begins with the keyword of OFF and a number.
pub(super) fn is_off(bytes: &[u8]) -> bool {
    let mut words = WordReader::new(bytes);
    let first = words.next_word_any_line().unwrap_or_default();
    let Some(at) = first.windows(3).position(|window| window == b"OFF") else { return false };
    let (flags, glued) = (&first[..at], &first[at + 3..]);
    let is_count = |word: &[u8]| !word.is_empty() && word.iter().all(u8::is_ascii_digit);
    let follows = if glued.is_empty() { words.next_word_any_line().unwrap_or_default() } else { glued };
    flags.iter().all(|flag| b"STCN4n".contains(flag)) && (is_count(follows) || follows == b"BINARY")
}

/// Reads the numbers of vertices and faces. The counts may stand right behind the keyword, as in the files of ModelNet,
/// and the keyword may be missing.
fn read_header(words: &mut WordReader) -> Result<[u64; 2], MeshFileError> {
    let wrong = |line: usize, problem: MeshFileProblem| Err(MeshFileError::at_line(line, problem));
    let mut ahead = *words;
    let Some(first) = ahead.next_word_any_line() else {
        return Err(MeshFileProblem::UnexpectedEnd("the header".into()).into());
    };
    let line = ahead.line;
    match first.windows(3).position(|window| window == b"OFF") {
        Some(at) => {
            let (flags, glued) = (&first[..at], &first[at + 3..]);
            if flags.iter().any(|flag| matches!(flag, b'4' | b'n')) {
                return wrong(line, MeshFileProblem::Unsupported("is OFF of another dimension than three".into()));
            }
            if !matches!(flags.strip_prefix(b"ST").unwrap_or(flags), b"" | b"C" | b"N" | b"CN") {
                let message = format!("{} is not a header of OFF", quote_word(first));
                return wrong(line, MeshFileProblem::Malformed(message));
            }
            words.next_word_any_line();
            // Go back to the count that is glued to the keyword.
            words.at -= glued.len();
        }
        None if first.iter().all(u8::is_ascii_digit) => {}
        None => {
            return wrong(line, MeshFileProblem::Malformed(format!("{} is not a header of OFF", quote_word(first))));
        }
    }
    let mut counts = [0; 2];
    for count in &mut counts {
        match words.next_word_any_line() {
            Some(b"BINARY") => {
                return wrong(words.line, MeshFileProblem::Unsupported("is binary OFF, of which ASCII is read".into()));
            }
            Some(word) => match str::from_utf8(word).ok().and_then(|word| word.parse().ok()) {
                Some(number) => *count = number,
                None => {
                    let message = format!("{} is not a number of vertices or faces", quote_word(word));
                    return wrong(words.line, MeshFileProblem::Malformed(message));
                }
            },
            None => return Err(MeshFileProblem::UnexpectedEnd("the header".into()).into()),
        }
    }
    // The rest of the line is the number of edges, which is not needed.
    words.next_line();
    Ok(counts)
}

/// Goes to the next line that has a word.
fn begin_line(words: &mut WordReader, what: &str) -> Result<(), MeshFileError> {
    while !words.has_word() {
        if !words.next_line() {
            return Err(MeshFileProblem::UnexpectedEnd(what.into()).into());
        }
    }
    Ok(())
}

/// Fills `corners` with the vertices of a face, counted from 0.
fn read_face(words: &mut WordReader, count: usize, corners: &mut Vec<u32>) -> Result<(), MeshFileProblem> {
    let integer = |word: &[u8]| str::from_utf8(word).ok().and_then(|word| word.parse::<i64>().ok());
    let first = words.next_word().unwrap_or_default();
    let Some(length) = integer(first).filter(|length| *length > 0) else {
        return Err(MeshFileProblem::Malformed(format!("{} is not a number of corners", quote_word(first))));
    };
    corners.clear();
    for given in 0..length {
        let Some(word) = words.next_word() else {
            return Err(MeshFileProblem::Malformed(format!("a face has {given} corners instead of {length}")));
        };
        let Some(index) = integer(word) else {
            return Err(MeshFileProblem::Malformed(format!("{} is not a corner of a face", quote_word(word))));
        };
        match u32::try_from(index).ok().filter(|corner| (*corner as usize) < count) {
            Some(corner) => corners.push(corner),
            None => return Err(MeshError::NoSuchVertex { index, count, note: "" }.into()),
        }
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    const BODY: &str = "0 0 0\n1 0 0\n1 1 0\n0 1 0\n";

    fn count(text: &str) -> (usize, usize) {
        let raw = read(text.as_bytes()).unwrap_or_else(|error| panic!("{text:?}: {error}"));
        (raw.vertices.len(), raw.triangles.len())
    }

    fn failure(text: &str) -> String {
        read(text.as_bytes()).err().unwrap().to_string()
    }

    #[test]
    fn headers_of_all_kinds_are_read() {
        for head in
            ["OFF\n4 1 0\n", "OFF 4 1 0\n", "OFF4 1 0\n", "# a\n\nCOFF # b\n# c\n4 1\n", "STCNOFF\n4 1 4\n", "4 1 0\n"]
        {
            assert_eq!(count(&format!("{head}{BODY}4 0 1 2 3\n")), (4, 2), "{head:?}");
        }
    }

    #[test]
    fn colours_and_normals_are_passed_over() {
        let text = "CNOFF\n3 1 3\n0 0 0 0 0 1 255 0 0 255\n\n1 0 0 0 0 1 9 9 9 9\n# between\n0 1 0 0 0 1 1 1 1 1\n3 0 1 2 0.5 0.5 0.5\n";
        assert_eq!(count(text), (3, 1));
    }

    #[test]
    fn errors_name_the_line() {
        for (text, expected) in [
            ("", "ends too early: in the header"),
            ("OFF", "ends too early: in the header"),
            ("PLY\n", "line 1: `PLY` is not a header of OFF"),
            ("OFF BINARY\n", "line 1: is binary OFF, of which ASCII is read"),
            ("4OFF\n1 1 1\n", "line 1: is OFF of another dimension than three"),
            ("nOFF\n3\n", "line 1: is OFF of another dimension than three"),
            ("OFF\n3 x 0\n", "line 2: `x` is not a number of vertices or faces"),
            ("OFF\n99999999999 1 0\n0 0 0\n", "ends too early: in the vertices"),
            ("OFF\n1 9 0\n0 0 0\n", "ends too early: in the faces"),
            ("OFF\n1 1 0\n0 0\n", "line 3: a vertex has 2 coordinates instead of 3"),
            ("OFF\n1 1 0\n0 0 0\n3 0 0\n", "line 4: a face has 2 corners instead of 3"),
            ("OFF\n1 1 0\n0 0 0\n3 0 0 1\n", "line 4: face refers to vertex 1, but the file has 1"),
            ("OFF\n1 1 0\n0 0 0\n3 0 0 -1\n", "line 4: face refers to vertex -1, but the file has 1"),
            ("OFF\n1 1 0\n0 0 0\n0\n", "line 4: `0` is not a number of corners"),
        ] {
            assert_eq!(failure(text), expected, "{text:?}");
        }
    }
}
