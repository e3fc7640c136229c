//! Reads OFF of Geomview in ASCII: vertices and faces; normals, colours and texture coordinates are passed over.
//!
//! Format: Geomview manual, Object File Format (1996).

use crate::mesh::polygon::Cutter;
use crate::mesh::{MeshFileError, MeshFileProblem, Raw, Words, coordinates, quoted};
use gelsim_core::mesh::MeshError;

/// Vertices and triangles in the order of the file: each vertex and each face begins a line.
pub(super) fn read(bytes: &[u8]) -> Result<Raw, MeshFileError> {
    let mut words = Words::new(bytes);
    let [vertices, faces] = header(&mut words)?;
    let mut raw = Raw::default();
    for _ in 0..vertices {
        begin(&mut words, "the vertices")?;
        let line = words.line;
        let vertex = coordinates(&mut words).map_err(|problem| MeshFileError::at_line(line, problem))?;
        raw.vertices.push(vertex);
        words.next_line();
    }
    let mut cutter = Cutter::new();
    let mut corners = Vec::new();
    for _ in 0..faces {
        begin(&mut words, "the faces")?;
        let line = words.line;
        face(&mut words, raw.vertices.len(), &mut corners)
            .and_then(|()| cutter.cut(&raw.vertices, &corners, &mut raw.triangles))
            .map_err(|problem| MeshFileError::at_line(line, problem))?;
        words.next_line();
    }
    Ok(raw)
}

/// True of text that begins with the keyword of OFF and a number.
pub(super) fn is_off(bytes: &[u8]) -> bool {
    let mut words = Words::new(bytes);
    let first = words.word_anywhere().unwrap_or_default();
    let Some(at) = first.windows(3).position(|window| window == b"OFF") else { return false };
    let (flags, glued) = (&first[..at], &first[at + 3..]);
    let is_count = |word: &[u8]| !word.is_empty() && word.iter().all(u8::is_ascii_digit);
    let follows = if glued.is_empty() { words.word_anywhere().unwrap_or_default() } else { glued };
    flags.iter().all(|flag| b"STCN4n".contains(flag)) && (is_count(follows) || follows == b"BINARY")
}

/// How many vertices and faces there are. The counts may stand right behind the keyword, as in ModelNet's files, and
/// the keyword may be missing.
fn header(words: &mut Words) -> Result<[u64; 2], MeshFileError> {
    let wrong = |line: usize, problem: MeshFileProblem| Err(MeshFileError::at_line(line, problem));
    let mut ahead = *words;
    let Some(first) = ahead.word_anywhere() else {
        return Err(MeshFileProblem::EndsEarly("the header".into()).into());
    };
    let line = ahead.line;
    match first.windows(3).position(|window| window == b"OFF") {
        Some(at) => {
            let (flags, glued) = (&first[..at], &first[at + 3..]);
            if flags.iter().any(|flag| matches!(flag, b'4' | b'n')) {
                return wrong(line, MeshFileProblem::Unsupported("is OFF of another dimension than three".into()));
            }
            if !matches!(flags.strip_prefix(b"ST").unwrap_or(flags), b"" | b"C" | b"N" | b"CN") {
                let message = format!("{} is not a header of OFF", quoted(first));
                return wrong(line, MeshFileProblem::Malformed(message));
            }
            words.word_anywhere();
            words.at -= glued.len();
        }
        None if first.iter().all(u8::is_ascii_digit) => {}
        None => {
            return wrong(line, MeshFileProblem::Malformed(format!("{} is not a header of OFF", quoted(first))));
        }
    }
    let mut counts = [0; 2];
    for count in &mut counts {
        match words.word_anywhere() {
            Some(b"BINARY") => {
                return wrong(words.line, MeshFileProblem::Unsupported("is binary OFF, of which ASCII is read".into()));
            }
            Some(word) => match str::from_utf8(word).ok().and_then(|word| word.parse().ok()) {
                Some(number) => *count = number,
                None => {
                    let message = format!("{} is not a number of vertices or faces", quoted(word));
                    return wrong(words.line, MeshFileProblem::Malformed(message));
                }
            },
            None => return Err(MeshFileProblem::EndsEarly("the header".into()).into()),
        }
    }
    // The number of edges, which nobody needs.
    words.next_line();
    Ok(counts)
}

/// Goes to the next line with a word.
fn begin(words: &mut Words, what: &str) -> Result<(), MeshFileError> {
    while !words.has_word() {
        if !words.next_line() {
            return Err(MeshFileProblem::EndsEarly(what.into()).into());
        }
    }
    Ok(())
}

/// Fills `corners` with the vertices of a face.
fn face(words: &mut Words, count: usize, corners: &mut Vec<u32>) -> Result<(), MeshFileProblem> {
    let integer = |word: &[u8]| str::from_utf8(word).ok().and_then(|word| word.parse::<i64>().ok());
    let first = words.word().unwrap_or_default();
    let Some(length) = integer(first).filter(|length| *length > 0) else {
        return Err(MeshFileProblem::Malformed(format!("{} is not a number of corners", quoted(first))));
    };
    corners.clear();
    for given in 0..length {
        let Some(word) = words.word() else {
            return Err(MeshFileProblem::Malformed(format!("a face has {given} corners instead of {length}")));
        };
        let Some(index) = integer(word) else {
            return Err(MeshFileProblem::Malformed(format!("{} is not a corner of a face", quoted(word))));
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
