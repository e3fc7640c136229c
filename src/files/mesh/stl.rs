//! Reads STL, binary and ASCII.
//!
//! Our own reader, since `stl_io` 0.11 takes a binary file whose header starts with "solid" for text. Of text it reads
//! only UTF-8 in lower case, with normals, up to the first `endsolid`, and its errors name no line.

use crate::mesh::remark::Remark;
use crate::mesh::{MeshFileError, MeshFileProblem, RawMesh, WordReader, quote_word, read_coordinates};
use gelsim_core::mesh::MeshError;

const HEADER_BYTES: usize = 84;
const FACET_BYTES: usize = 50;

/// Reads the triangles in the order of the file. Each has three vertices of its own.
pub(super) fn read(bytes: &[u8]) -> Result<RawMesh, MeshFileError> {
    let raw = match bytes.split_at_checked(HEADER_BYTES) {
        Some((header, facets)) if is_complete(header, facets) || !is_text(bytes) => read_binary(header, facets)?,
        _ if is_text(bytes) => read_ascii(bytes)?,
        _ => return Err(MeshFileProblem::Malformed("is neither ASCII nor binary STL".into()).into()),
    };
    if raw.triangles.is_empty() {
        return Err(MeshError::NoTriangle.into());
    }
    Ok(raw)
}

/// Returns true for a binary file that is as long as its header says.
pub(super) fn is_binary(bytes: &[u8]) -> bool {
    bytes
        .split_at_checked(HEADER_BYTES)
        .is_some_and(|(header, facets)| read_facet_count(header) > 0 && is_complete(header, facets))
}

/// Returns true for a text with a facet, or an end, right after its first line.
pub(super) fn is_ascii(bytes: &[u8]) -> bool {
    let mut words = WordReader::new(bytes);
    let begins =
        words.next_word_any_line().is_some_and(|word| word.eq_ignore_ascii_case(b"solid")) && words.next_line();
    let second = words.next_word_any_line().and_then(parse_keyword);
    begins && matches!(second, Some(Keyword::Facet | Keyword::EndSolid | Keyword::Solid))
}

fn read_facet_count(header: &[u8]) -> u64 {
    header.last_chunk().map_or(0, |count| u32::from_le_bytes(*count).into())
}

fn is_complete(header: &[u8], facets: &[u8]) -> bool {
    facets.len() as u64 == read_facet_count(header) * FACET_BYTES as u64
}

/// Returns true if the file starts as text does. Binary files have a zero early on: the count has one if it is below
/// 2^24.
fn is_text(bytes: &[u8]) -> bool {
    WordReader::new(bytes).next_word_any_line().is_some_and(|word| word.eq_ignore_ascii_case(b"solid"))
        && !bytes.iter().take(1024).any(|&byte| byte == 0)
}

fn read_binary(header: &[u8], facets: &[u8]) -> Result<RawMesh, MeshFileProblem> {
    let claimed = read_facet_count(header);
    let room = (facets.len() / FACET_BYTES) as u64;
    // A rest that is shorter than a facet, or is all zeros, is padding. Any other rest means that the count or the
    // length is wrong.
    let used = facets.len().min((claimed as usize).saturating_mul(FACET_BYTES));
    let padding = &facets[used..];
    let is_padding = padding.len() < FACET_BYTES || (claimed > 0 && padding.iter().all(|&byte| byte == 0));
    let is_trusted = claimed <= room && is_padding;
    // A program that writes facets as they come knows their number last, and some never go back to write it.
    let is_complete_file = room > 0 && facets.len().is_multiple_of(FACET_BYTES) && has_plausible_corners(facets);
    if !is_trusted && !is_complete_file {
        return Err(MeshFileProblem::CountMismatch { claimed, what: "triangles".into(), room });
    }
    let used = if is_trusted { used } else { facets.len() };
    // A count of 0 or of all ones says that it was never filled in: there is nothing to remark on.
    let is_open = claimed == 0 || claimed == u64::from(u32::MAX);
    let remarks = if is_trusted || is_open { Vec::new() } else { vec![Remark::Count { claimed, held: room }] };
    if 3 * room > u64::from(u32::MAX) {
        return Err(MeshError::TooMany("corners").into());
    }
    let facets = facets[..used].as_chunks::<FACET_BYTES>().0;
    let mut vertices = Vec::with_capacity(3 * facets.len());
    for facet in facets {
        // 12 bytes of normal, 3 corners of 12, 2 bytes of attributes
        let corners = facet[12..48].as_chunks::<4>().0;
        for corner in corners.as_chunks::<3>().0 {
            vertices.push(corner.map(|bytes| f32::from_le_bytes(bytes).into()));
        }
    }
    let triangles = (0..facets.len() as u32).map(|i| [3 * i, 3 * i + 1, 3 * i + 2]).collect();
    Ok(RawMesh { vertices, triangles, remarks, ..RawMesh::default() })
}

/// Returns true if all corners are numbers of a usual size. Other bytes read as floats hardly ever are.
fn has_plausible_corners(facets: &[u8]) -> bool {
    let number = |bytes: &[u8; 4]| f32::from_le_bytes(*bytes);
    let is_likely = |x: f32| x == 0.0 || (1e-20..1e15).contains(&x.abs());
    facets
        .as_chunks::<FACET_BYTES>()
        .0
        .iter()
        .all(|facet| facet[12..48].as_chunks::<4>().0.iter().map(number).all(is_likely))
}

#[derive(Clone, Copy)]
enum Keyword {
    Solid,
    Facet,
    Loop,
    Vertex,
    EndFacet,
    EndSolid,
}

const KEYWORDS: [(&str, Keyword); 8] = [
    ("vertex", Keyword::Vertex),
    ("outer", Keyword::Loop),
    ("loop", Keyword::Loop),
    ("endloop", Keyword::Loop),
    ("facet", Keyword::Facet),
    ("endfacet", Keyword::EndFacet),
    ("solid", Keyword::Solid),
    ("endsolid", Keyword::EndSolid),
];

fn parse_keyword(word: &[u8]) -> Option<Keyword> {
    let found = KEYWORDS.iter().find(|(name, _)| word.eq_ignore_ascii_case(name.as_bytes()));
    found.map(|&(_, keyword)| keyword)
}

/// Reads text. Normals are ignored, whatever they are. Lines may be broken anywhere but in a vertex or a name.
fn read_ascii(bytes: &[u8]) -> Result<RawMesh, MeshFileError> {
    let mut raw = RawMesh::default();
    let mut words = WordReader::new(bytes);
    // Number of vertices before the facet that is open.
    let mut open: Option<usize> = None;
    while let Some(word) = words.next_word_any_line() {
        let line = words.line;
        let wrong = |message: String| Err(MeshFileError::at_line(line, MeshFileProblem::Malformed(message)));
        match (parse_keyword(word), open) {
            (Some(Keyword::Solid | Keyword::EndSolid), None) => {
                words.next_line();
            }
            (Some(Keyword::Facet), None) => {
                open = Some(raw.vertices.len());
                // Skip what stands for a normal: all words up to the next keyword.
                let mut ahead = words;
                while ahead.next_word_any_line().is_some_and(|word| parse_keyword(word).is_none()) {
                    words = ahead;
                }
            }
            (Some(Keyword::Loop), Some(_)) => {}
            (Some(Keyword::Vertex), Some(_)) => {
                let vertex = read_coordinates(&mut words).map_err(|problem| MeshFileError::at_line(line, problem))?;
                raw.vertices.push(vertex);
            }
            (Some(Keyword::EndFacet), Some(start)) => {
                match (raw.vertices.len() - start, u32::try_from(start)) {
                    (3, Ok(start)) if start < u32::MAX - 3 => {
                        raw.triangles.push([start, start + 1, start + 2]);
                    }
                    (3, _) => return Err(MeshError::TooMany("corners").into()),
                    (given, _) => {
                        return wrong(format!("a facet has {given} vertices instead of 3"));
                    }
                }
                open = None;
            }
            (Some(_), Some(_)) => return wrong(format!("{} inside a facet", quote_word(word))),
            (Some(_), None) => return wrong(format!("{} outside a facet", quote_word(word))),
            (None, _) => return wrong(format!("{} is not a word of STL", quote_word(word))),
        }
    }
    match open {
        Some(_) => Err(MeshFileProblem::UnexpectedEnd("a facet".into()).into()),
        None => Ok(raw),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A binary file with `count` in its header and `facets` different triangles.
    fn file(header: &[u8], count: u32, facets: u32) -> Vec<u8> {
        let mut bytes = header.to_vec();
        bytes.resize(80, b' ');
        bytes.extend(count.to_le_bytes());
        for i in 0..facets {
            bytes.extend([0xff; 12]);
            for corner in [[0.0, 0.0, i as f32], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]] {
                bytes.extend(corner.map(f32::to_le_bytes).as_flattened());
            }
            bytes.extend([7, 7]);
        }
        bytes
    }

    fn failure(bytes: &[u8]) -> String {
        read(bytes).err().unwrap().to_string()
    }

    fn count(text: &[u8]) -> usize {
        read(text).unwrap().triangles.len()
    }

    const FACET: &str = "facet normal 0 0 1\nouter loop\nvertex 0 0 0\nvertex 1 0 0\nvertex 0 1 0\nendloop\nendfacet\n";

    #[test]
    fn a_binary_file_is_told_by_its_length_even_if_it_starts_with_solid() {
        for header in [&b""[..], b"solid", b"solid x\nfacet normal", b"\xff\xfe"] {
            let raw = read(&file(header, 12, 12)).unwrap();
            assert_eq!(raw.triangles.len(), 12);
            assert_eq!(raw.vertices[33], [0.0, 0.0, 11.0]);
            assert_eq!(raw.triangles[11], [33, 34, 35]);
        }
    }

    #[test]
    fn padding_after_the_last_facet_is_passed_over() {
        for header in [&b""[..], b"solid"] {
            let mut bytes = file(header, 12, 12);
            bytes.extend([1, 2, 3]);
            assert_eq!(count(&bytes), 12);
            bytes.truncate(84 + 12 * 50);
            bytes.extend([0; 512]);
            assert_eq!(count(&bytes), 12);
        }
    }

    #[test]
    fn a_lying_header_is_refused_before_memory_is_reserved() {
        for claimed in [12, 13, 3000, u32::MAX] {
            let mut short = file(b"", claimed, 12);
            short.pop();
            assert_eq!(failure(&short), format!("says {claimed} triangles but has room for 11"));
        }
        let mut longer = file(b"", 3, 12);
        longer.push(1);
        assert_eq!(failure(&longer), "says 3 triangles but has room for 12");
        // As many bytes as complete facets, but random: few of their numbers are lengths.
        let mut noise = file(b"", 7, 12);
        (84..684).for_each(|at| noise[at] = ((at * at * 31) >> 3) as u8);
        assert_eq!(failure(&noise), "says 7 triangles but has room for 12");
    }

    #[test]
    fn whole_facets_are_read_whatever_the_header_counts() {
        for header in [&b""[..], b"solid"] {
            for (claimed, is_said) in [(0, false), (u32::MAX, false), (3, true), (13, true)] {
                let raw = read(&file(header, claimed, 12)).unwrap();
                assert_eq!(raw.triangles.len(), 12);
                let count = Remark::Count { claimed: claimed.into(), held: 12 };
                assert_eq!(raw.remarks, if is_said { vec![count] } else { vec![] }, "{claimed}");
            }
        }
    }

    #[test]
    fn files_without_a_triangle_are_refused() {
        assert_eq!(failure(&file(b"", 0, 0)), "no triangle");
        assert_eq!(failure(b"solid empty\nendsolid empty\n"), "no triangle");
        assert_eq!(failure(b"solid"), "no triangle");
        assert_eq!(failure(b""), "is neither ASCII nor binary STL");
        assert_eq!(failure(b"not a mesh"), "is neither ASCII nor binary STL");
    }

    #[test]
    fn text_may_have_any_case_blanks_and_line_ends() {
        let text = format!("solid a\n{FACET}endsolid a\n");
        for variant in [
            text.to_uppercase(),
            text.replace('\n', "\r\n"),
            text.replace('\n', "\r"),
            text.replace(' ', " \t "),
            text.replace('\n', "\n\n \n"),
            format!("\u{feff}\n  {text}"),
            text.replace("\nouter loop\n", " outer  loop ").replace("\nendloop\nendfacet", " endloop endfacet"),
        ] {
            let raw = read(variant.as_bytes()).unwrap();
            assert_eq!(raw.vertices, [[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]], "{variant:?}");
            assert_eq!(raw.triangles, [[0, 1, 2]]);
        }
    }

    #[test]
    fn several_solids_make_one_mesh() {
        assert_eq!(count(format!("solid a\n{FACET}endsolid\n\nsolid b\n{FACET}{FACET}endsolid b").as_bytes()), 3);
        assert_eq!(count(format!("solid\n{FACET}solid\n{FACET}").as_bytes()), 2);
    }

    #[test]
    fn normals_may_be_missing_or_wrong() {
        for normal in ["facet", "facet normal", "facet normal nan nan nan", "facet normal 1.#QNAN x", "facet\n1 2 3"] {
            let text = FACET.replace("facet normal 0 0 1", normal);
            assert_eq!(count(format!("solid\n{text}endsolid\n").as_bytes()), 1, "{normal}");
        }
    }

    #[test]
    fn names_may_be_anything() {
        let mut text = b"solid caf\xe9 facet \xff\\\n".to_vec();
        text.extend(FACET.as_bytes());
        text.extend(b"endsolid caf\xe9 \x80\n");
        assert_eq!(count(&text), 1);
    }

    #[test]
    fn numbers_keep_more_digits_than_f32_has() {
        let text = FACET.replace("vertex 1 0 0", "vertex 1000000.001 1e-3 NaN");
        let raw = read(format!("solid\n{text}").as_bytes()).unwrap();
        assert_eq!(raw.vertices[1][..2], [1_000_000.001, 1e-3]);
        assert!(raw.vertices[1][2].is_nan());
    }

    #[test]
    fn errors_in_text_name_the_line() {
        for (from, to, expected) in [
            ("vertex 1 0 0", "vertex 1 0", "line 5: a vertex has 2 coordinates instead of 3"),
            ("vertex 1 0 0", "vertex 1 0 0,5", "line 5: `0,5` is not a number"),
            ("vertex 1 0 0\n", "", "line 7: a facet has 2 vertices instead of 3"),
            ("vertex 1 0 0", "vertex 1 0 0\nvertex 1 1 0", "line 9: a facet has 4 vertices instead of 3"),
            ("vertex 1 0 0", "vertx 1 0 0", "line 5: `vertx` is not a word of STL"),
            ("endfacet", "facet", "line 8: `facet` inside a facet"),
            ("endfacet", "endsolid", "line 8: `endsolid` inside a facet"),
            ("endfacet", "endfacet\nendloop", "line 9: `endloop` outside a facet"),
            ("endfacet", "", "ends too early: in a facet"),
        ] {
            assert_eq!(failure(format!("solid a\n{}", FACET.replace(from, to)).as_bytes()), expected);
        }
    }
}
