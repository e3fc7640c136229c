//! Reads PLY: ASCII, binary little-endian and binary big-endian (Turk, The PLY Polygon File Format, 1994).
//!
//! Our own reader, since `ply-rs-bw` 4 is safe against headers that lie but refuses `nan`, `.5`, `1.` and names that
//! are not UTF-8, and allocates for every element and face.

use crate::mesh::points::{LoosePoints, PointKind};
use crate::mesh::polygon::{MAX_CORNERS, Triangulator, too_many_corners};
use crate::mesh::raw::iter_strip_triangles;
use crate::mesh::{MeshFileError, MeshFileProblem, RawMesh, WordReader, parse_number};
use gelsim_core::mesh::MeshError;

mod header;

use header::{Element, ElementKind, Encoding, Header, Property, PropertyRole, ScalarType, malformed};

/// Reads vertices and triangles in the order of the file. Elements and properties may come in any order; those that say
/// nothing about the shape are ignored.
pub(super) fn read(bytes: &[u8]) -> Result<RawMesh, MeshFileError> {
    let mut words = WordReader::new(bytes);
    let header = Header::read(&mut words)?;
    let (vertices, faces) = match header.encoding {
        Encoding::Ascii => read_body(&header, AsciiBody { words }),
        Encoding::LittleEndian => read_body(&header, BinaryBody::<false>(&words.bytes[words.at..])),
        Encoding::BigEndian => read_body(&header, BinaryBody::<true>(&words.bytes[words.at..])),
    }?;

    let mut triangles = Vec::with_capacity(faces.lengths.len());
    let mut cutter = Triangulator::new();
    let mut rest = &faces.corners[..];
    for &length in &faces.lengths {
        let (corners, after) = rest.split_at(length as usize);
        cutter.triangulate(&vertices, corners, &mut triangles)?;
        rest = after;
    }
    let has = |role: PropertyRole| header.elements.iter().any(|element| element.has_role(role));
    let has_edges = header.elements.iter().any(|element| element.name == "`edge`" && element.count > 0);
    let kind = match has(PropertyRole::Splat) {
        true => PointKind::Splats,
        false if has_edges => PointKind::Lines,
        false => PointKind::Cloud,
    };
    Ok(RawMesh { vertices, triangles, points: LoosePoints { count: 0, kind }, ..RawMesh::default() })
}

/// Polygons as they are read. They are cut later, since their vertices may follow them in the file.
#[derive(Default)]
struct Faces {
    corners: Vec<u32>,
    /// Number of corners of each face.
    lengths: Vec<u32>,
}

/// The body of a file, read value by value. Integers of PLY have at most 32 bits, so that f64 holds them exactly.
trait Body {
    /// Returns how many elements with these properties the rest has room for, at most.
    fn max_elements(&self, properties: &[Property]) -> u64;

    /// Goes to the next element. Returns its line if the body is text, or `None` at the end of the file.
    fn begin_element(&mut self) -> Option<Option<usize>>;

    /// Reads a value. Returns `Ok(None)` if the element ends too early.
    fn read_value(&mut self, scalar: ScalarType) -> Result<Option<f64>, MeshFileProblem>;

    /// Skips `count` values. Returns false if the element ends too early.
    fn skip_values(&mut self, count: usize, scalar: ScalarType) -> bool;

    /// Leaves the element. Returns false if there is more in it.
    fn end_element(&mut self) -> bool;
}

struct AsciiBody<'a> {
    words: WordReader<'a>,
}

impl Body for AsciiBody<'_> {
    fn max_elements(&self, properties: &[Property]) -> u64 {
        // Every value has at least a digit, and a blank or a line break between it and the next.
        let rest = self.words.bytes.len() - self.words.at;
        (rest as u64).div_ceil(2) / properties.len() as u64
    }

    fn begin_element(&mut self) -> Option<Option<usize>> {
        while !self.words.has_word() {
            if !self.words.next_line() {
                return None;
            }
        }
        Some(Some(self.words.line))
    }

    fn read_value(&mut self, _: ScalarType) -> Result<Option<f64>, MeshFileProblem> {
        self.words.next_word().map(parse_number).transpose()
    }

    fn skip_values(&mut self, count: usize, _: ScalarType) -> bool {
        (0..count).all(|_| self.words.next_word().is_some())
    }

    fn end_element(&mut self) -> bool {
        let is_end = self.words.next_word().is_none();
        self.words.next_line();
        is_end
    }
}

struct BinaryBody<'a, const IS_BIG: bool>(&'a [u8]);

impl<const IS_BIG: bool> BinaryBody<'_, IS_BIG> {
    fn take_bytes<const N: usize>(&mut self) -> Option<[u8; N]> {
        let (&value, rest) = self.0.split_first_chunk()?;
        self.0 = rest;
        let mut value: [u8; N] = value;
        if IS_BIG {
            value.reverse();
        }
        Some(value)
    }
}

impl<const IS_BIG: bool> Body for BinaryBody<'_, IS_BIG> {
    fn max_elements(&self, properties: &[Property]) -> u64 {
        let size = |property: &Property| property.list.unwrap_or(property.scalar).size();
        (self.0.len() / properties.iter().map(size).sum::<usize>()) as u64
    }

    fn begin_element(&mut self) -> Option<Option<usize>> {
        Some(None)
    }

    fn read_value(&mut self, scalar: ScalarType) -> Result<Option<f64>, MeshFileProblem> {
        Ok(match scalar {
            ScalarType::I8 => self.take_bytes().map(|bytes| i8::from_le_bytes(bytes).into()),
            ScalarType::U8 => self.take_bytes().map(|bytes| u8::from_le_bytes(bytes).into()),
            ScalarType::I16 => self.take_bytes().map(|bytes| i16::from_le_bytes(bytes).into()),
            ScalarType::U16 => self.take_bytes().map(|bytes| u16::from_le_bytes(bytes).into()),
            ScalarType::I32 => self.take_bytes().map(|bytes| i32::from_le_bytes(bytes).into()),
            ScalarType::U32 => self.take_bytes().map(|bytes| u32::from_le_bytes(bytes).into()),
            ScalarType::F32 => self.take_bytes().map(|bytes| f32::from_le_bytes(bytes).into()),
            ScalarType::F64 => self.take_bytes().map(f64::from_le_bytes),
        })
    }

    fn skip_values(&mut self, count: usize, scalar: ScalarType) -> bool {
        let rest = count.checked_mul(scalar.size()).and_then(|len| self.0.get(len..));
        self.0 = rest.unwrap_or_default();
        rest.is_some()
    }

    fn end_element(&mut self) -> bool {
        true
    }
}

fn read_body(header: &Header, mut body: impl Body) -> Result<(Vec<[f64; 3]>, Faces), MeshFileError> {
    let is_vertex = |element: &&Element| element.kind == ElementKind::Vertex;
    let vertex_count = header.elements.iter().find(is_vertex).map_or(0, |element| element.count);
    let mut vertices = Vec::new();
    let mut faces = Faces::default();
    for element in header.elements.iter().filter(|element| !element.properties.is_empty()) {
        let room = body.max_elements(&element.properties);
        if element.count > room {
            let what = format!("elements {}", element.name);
            return Err(MeshFileProblem::CountMismatch { claimed: element.count, what, room }.into());
        }
        match element.kind {
            ElementKind::Vertex => vertices.reserve_exact(element.count as usize),
            ElementKind::Face => faces.lengths.reserve_exact(element.count as usize),
            ElementKind::Strips | ElementKind::Other => {}
        }
        for number in 0..element.count {
            let early =
                || MeshFileProblem::UnexpectedEnd(format!("element {} {number} of {}", element.name, element.count));
            let line = body.begin_element().ok_or_else(early)?;
            let mut vertex = [0.0; 3];
            let complete = read_element(&mut body, element, vertex_count, &mut vertex, &mut faces)
                .map_err(|problem| MeshFileError { path: None, line, problem })?;
            if !complete {
                return Err(match line {
                    None => early().into(),
                    Some(line) => {
                        let message = format!("fewer values than an element {} has", element.name);
                        MeshFileError::at_line(line, MeshFileProblem::Malformed(message))
                    }
                });
            }
            if !body.end_element() {
                let message = format!("more values than an element {} has", element.name);
                return Err(MeshFileError { path: None, line, problem: MeshFileProblem::Malformed(message) });
            }
            if element.kind == ElementKind::Vertex {
                vertices.push(vertex);
            }
        }
    }
    Ok((vertices, faces))
}

/// Reads one element into `vertex` or onto `faces`, if it is one of these. Returns false if it ends too early.
fn read_element(
    body: &mut impl Body,
    element: &Element,
    vertex_count: u64,
    vertex: &mut [f64; 3],
    faces: &mut Faces,
) -> Result<bool, MeshFileProblem> {
    for property in &element.properties {
        let Some(list) = property.list else {
            let Some(value) = body.read_value(property.scalar)? else {
                return Ok(false);
            };
            if let PropertyRole::Coordinate(axis) = property.role {
                vertex[axis] = value;
            }
            continue;
        };
        let Some(given) = body.read_value(list)? else {
            return Ok(false);
        };
        let length = given as u32;
        if f64::from(length) != given {
            return malformed(format!("{given} is not the length of a list"));
        }
        if property.role != PropertyRole::Corners {
            if !body.skip_values(length as usize, property.scalar) {
                return Ok(false);
            }
            continue;
        }
        if element.kind == ElementKind::Strips {
            return read_strips(body, property.scalar, length, vertex_count, faces);
        }
        if length as usize > MAX_CORNERS {
            return Err(too_many_corners(length as usize));
        }
        for _ in 0..length {
            let Some(index) = body.read_value(property.scalar)? else {
                return Ok(false);
            };
            faces.corners.push(to_vertex_index(index, vertex_count)?);
        }
        faces.lengths.push(length);
    }
    Ok(true)
}

/// Converts a value of the file to the index of a vertex.
fn to_vertex_index(index: f64, vertex_count: u64) -> Result<u32, MeshFileProblem> {
    // The cast saturates: a value that is not a whole number from 0 to u32::MAX differs after it.
    let corner = index as u32;
    if f64::from(corner) != index && index.fract() != 0.0 {
        return malformed(format!("{index} is not the number of a vertex"));
    }
    if f64::from(corner) != index || u64::from(corner) >= vertex_count {
        let (index, count) = (index as i64, vertex_count as usize);
        return Err(MeshError::NoSuchVertex { index, count, note: ", counted from 0" }.into());
    }
    Ok(corner)
}

/// Reads a list of strips and appends their triangles to `faces`. Returns false if it ends too early.
fn read_strips(
    body: &mut impl Body,
    scalar: ScalarType,
    length: u32,
    vertex_count: u64,
    faces: &mut Faces,
) -> Result<bool, MeshFileProblem> {
    let mut run: Vec<u32> = Vec::new();
    let end = |run: &mut Vec<u32>, faces: &mut Faces| {
        for triangle in iter_strip_triangles(run) {
            faces.corners.extend(triangle);
            faces.lengths.push(3);
        }
        run.clear();
    };
    for _ in 0..length {
        let Some(index) = body.read_value(scalar)? else {
            return Ok(false);
        };
        if index == -1.0 {
            end(&mut run, faces);
        } else {
            run.push(to_vertex_index(index, vertex_count)?);
        }
    }
    end(&mut run, faces);
    Ok(true)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::mesh::{Format, parse};

    const VERTEX: &str = "element vertex 4\nproperty float x\nproperty float y\nproperty float z\n";
    const FACE: &str = "element face 2\nproperty list uchar int vertex_indices\n";
    const SQUARE: &str = "0 0 0\n1 0 0\n1 1 0\n0 1 0\n";
    const TWO: &str = "3 0 1 2\n3 0 2 3\n";

    fn ascii(header: &str, body: &str) -> Vec<u8> {
        format!("ply\nformat ascii 1.0\n{header}end_header\n{body}").into_bytes()
    }

    fn binary(header: &str, body: &[u8]) -> Vec<u8> {
        let mut bytes = format!("ply\nformat binary_little_endian 1.0\n{header}end_header\n").into_bytes();
        bytes.extend(body);
        bytes
    }

    fn failure(bytes: &[u8]) -> String {
        read(bytes).err().unwrap().to_string()
    }

    #[test]
    fn vertices_and_faces_may_be_named_and_ordered_in_any_way() {
        for (header, body) in [
            (format!("{VERTEX}{FACE}"), format!("{SQUARE}{TWO}")),
            (format!("{FACE}{VERTEX}"), format!("{TWO}{SQUARE}")),
            (format!("{VERTEX}{}", FACE.replace("indices", "index")), format!("{SQUARE}{TWO}")),
            (format!("{VERTEX}{}", FACE.replace("uchar int", "int32 float64")), format!("{SQUARE}{TWO}")),
            (
                format!("{}{FACE}", VERTEX.replace("float x", "double nx\nproperty list char int q\nproperty int16 x")),
                format!("9.5 2 7 7 0 0 0\n0 0 1 0 0\n0 1 4 1 1 0\n0 0 0 1 0\n{TWO}"),
            ),
        ] {
            let raw = read(&ascii(&header, &body)).unwrap();
            assert_eq!(raw.vertices, [[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [1.0, 1.0, 0.0], [0.0, 1.0, 0.0]]);
            assert_eq!(raw.triangles, [[0, 1, 2], [0, 2, 3]]);
        }
    }

    #[test]
    fn strips_are_cut_into_triangles_that_face_one_way() {
        let strips = |kind: &str| format!("{VERTEX}element tristrips 1\nproperty list int {kind} vertex_indices\n");
        // Two strips, and in the first one a corner twice, which turns it over.
        let expected = [[0, 1, 2], [2, 1, 3], [3, 0, 1], [0, 2, 1]];
        let text = ascii(&strips("int"), &format!("{SQUARE}12 0 1 2 3 3 0 1 -1 0 2 1 -1\n"));
        assert_eq!(read(&text).unwrap().triangles, expected);
        let mut body = Vec::new();
        for vertex in [[0.0f32, 0.0, 0.0], [1.0, 0.0, 0.0], [1.0, 1.0, 0.0], [0.0, 1.0, 0.0]] {
            body.extend(vertex.map(f32::to_le_bytes).as_flattened());
        }
        body.extend(12i32.to_le_bytes());
        body.extend([0, 1, 2, 3, 3, 0, 1, -1, 0, 2, 1, -1].map(i16::to_le_bytes).as_flattened());
        let bytes = binary(&strips("short"), &body);
        assert_eq!(read(&bytes).unwrap().triangles, expected);
        assert_eq!(failure(&bytes[..bytes.len() - 1]), "ends too early: in element `tristrips` 0 of 1");
        let wrong = ascii(&strips("int"), &format!("{SQUARE}3 0 1 4\n"));
        assert_eq!(failure(&wrong), "line 14: face refers to vertex 4, but the file has 4, counted from 0");
        let wrong = ascii(&strips("int").replace("indices", "names"), "");
        assert_eq!(failure(&wrong), "line 7: element `tristrips` lacks the list vertex_indices");
    }

    #[test]
    fn other_elements_are_passed_over() {
        let edge = "element edge 2\nproperty int vertex1\nproperty list uchar float weights\n";
        let nothing = "element nothing 4294967295\n";
        let text = ascii(
            &format!("{edge}{nothing}{VERTEX}{edge}{FACE}"),
            &format!("5 0\n6 2 .5 1.\n{SQUARE}5 1 nan\n6 0\n{TWO}"),
        );
        assert_eq!(read(&text).unwrap().triangles, [[0, 1, 2], [0, 2, 3]]);

        let mut body = Vec::new();
        for weights in [0u8, 3] {
            body.extend(5i32.to_le_bytes());
            body.push(weights);
            body.extend(vec![0xee; 4 * usize::from(weights)]);
        }
        for vertex in [[0.0f32, 0.0, 0.0], [1.0, 0.0, 0.0], [1.0, 1.0, 0.0], [0.0, 1.0, 0.0]] {
            body.extend(vertex.map(f32::to_le_bytes).as_flattened());
        }
        for face in [[0i32, 1, 2], [0, 2, 3]] {
            body.push(3);
            body.extend(face.map(i32::to_le_bytes).as_flattened());
        }
        let raw = read(&binary(&format!("{edge}{nothing}{VERTEX}{FACE}"), &body)).unwrap();
        assert_eq!(raw.vertices[2], [1.0, 1.0, 0.0]);
        assert_eq!(raw.triangles, [[0, 1, 2], [0, 2, 3]]);
    }

    #[test]
    fn lines_may_end_in_any_way_and_comments_hold_anything() {
        let text = ascii(
            &format!("comment made by \\\nobj_info 7 # 8\ncomment\n{VERTEX}comment x\n{FACE}"),
            &format!("\n{SQUARE}  \n\t{TWO}\n"),
        );
        for end in ["\n", "\r\n", "\r"] {
            let mut text = String::from_utf8(text.clone()).unwrap().replace('\n', end).into_bytes();
            let at = text.windows(7).position(|part| part == b"made by").unwrap();
            text[at] = 0xff;
            assert_eq!(read(&text).unwrap().triangles.len(), 2, "{end:?}");
        }
    }

    #[test]
    fn a_binary_body_starts_after_one_line_end_whatever_its_first_byte_is() {
        let header = "element vertex 1\nproperty uchar x\nproperty uchar y\nproperty uchar z\n";
        for first in [b'\n', b'\r', b' ', b'#'] {
            for end in ["\n", "\r\n", "\r"] {
                let bytes = binary(header, &[]);
                let mut bytes = String::from_utf8(bytes).unwrap().replace('\n', end).into_bytes();
                bytes.extend([first, 2, 3]);
                assert_eq!(read(&bytes).unwrap().vertices, [[f64::from(first), 2.0, 3.0]], "{end:?}");
            }
        }
    }

    #[test]
    fn every_type_of_number_is_read_in_both_byte_orders() {
        for (name, size, bytes, expected) in [
            ("char", 1, vec![0x85], -123.0),
            ("uint8", 1, vec![0x85], 133.0),
            ("short", 2, vec![0x85, 0x01], -31487.0),
            ("ushort", 2, vec![0x85, 0x01], 34049.0),
            ("int", 4, vec![0xff, 0xff, 0xff, 0xfe], -2.0),
            ("uint32", 4, vec![0xff, 0xff, 0xff, 0xfe], 4_294_967_294.0),
            ("float32", 4, 1.5f32.to_be_bytes().to_vec(), 1.5),
            ("double", 8, 0.1f64.to_be_bytes().to_vec(), 0.1),
        ] {
            assert_eq!(bytes.len(), size);
            let header = format!("element vertex 1\nproperty {name} x\nproperty {name} y\nproperty {name} z\n");
            let little: Vec<u8> = bytes.iter().rev().copied().collect();
            let little = binary(&header, &little.repeat(3));
            let big = String::from_utf8(binary(&header, &[])).unwrap().replace("little", "big");
            let big = [big.into_bytes(), bytes.repeat(3)].concat();
            assert_eq!(read(&little).unwrap().vertices, [[expected; 3]], "{name}");
            assert_eq!(read(&big).unwrap().vertices, [[expected; 3]], "{name}");
        }
    }

    #[test]
    fn concave_faces_are_cut_properly() {
        let header = VERTEX.replace('4', "6") + &FACE.replace('2', "1");
        let text = ascii(&header, "0 0 0\n4 0 0\n4 1 0\n1 1 0\n1 3 0\n0 3 0\n6 1 2 3 4 5 0\n");
        let raw = read(&text).unwrap();
        let twice_area: f64 = raw
            .triangles
            .iter()
            .map(|triangle| {
                let [a, b, c] = triangle.map(|i| raw.vertices[i as usize]);
                (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0])
            })
            .inspect(|&area| assert!(area > 0.0))
            .sum();
        assert_eq!(twice_area, 12.0);
    }

    #[test]
    fn a_lying_header_is_refused_before_memory_is_reserved() {
        let most = u64::MAX.to_string();
        for (bytes, expected) in [
            (
                ascii(&format!("{}{FACE}", VERTEX.replace('4', &most)), SQUARE),
                "says 18446744073709551615 elements `vertex` but has room for 4",
            ),
            (
                ascii(&format!("{VERTEX}{}", FACE.replace('2', "4000000000")), &format!("{SQUARE}{TWO}")),
                "says 4000000000 elements `face` but has room for 8",
            ),
            (
                binary(&VERTEX.replace('4', "4294967295"), &[0; 50]),
                "says 4294967295 elements `vertex` but has room for 4",
            ),
            (
                binary(&FACE.replace('2', &most), &[0; 5]),
                "says 18446744073709551615 elements `face` but has room for 5",
            ),
            (
                binary("element a 1\nproperty list uint double b\n", &[0xff; 100]),
                "ends too early: in element `a` 0 of 1",
            ),
            (
                binary("element face 1\nproperty list uint uchar vertex_index\n", &[0xff; 100]),
                "a face has 4294967295 corners, more than the 16384 allowed",
            ),
        ] {
            assert_eq!(failure(&bytes), expected);
        }
    }

    #[test]
    fn errors_in_the_body_name_the_line() {
        for (from, to, expected) in [
            ("1 1 0", "1 1", "line 12: fewer values than an element `vertex` has"),
            ("1 1 0", "1 1 0 0", "line 12: more values than an element `vertex` has"),
            ("1 1 0", "1 1 0,5", "line 12: `0,5` is not a number"),
            ("3 0 2 3", "3 0 2", "line 16: fewer values than an element `face` has"),
            ("3 0 2 3", "3 0 2 4", "line 16: face refers to vertex 4, but the file has 4, counted from 0"),
            ("3 0 2 3", "3 0 2 -1", "line 16: face refers to vertex -1, but the file has 4, counted from 0"),
            ("3 0 2 3", "3 0 2 1.5", "line 16: 1.5 is not the number of a vertex"),
            ("3 0 2 3", "-3 0 2 3", "line 16: -3 is not the length of a list"),
            ("3 0 2 3", "nan 0 2 3", "line 16: NaN is not the length of a list"),
            ("3 0 2 3\n", "", "ends too early: in element `face` 1 of 2"),
        ] {
            let body = format!("{SQUARE}\n{TWO}").replace(from, to);
            assert_eq!(failure(&ascii(&format!("{VERTEX}{FACE}"), &body)), expected, "{to}");
        }
    }

    #[test]
    fn errors_in_the_header_name_the_line() {
        let header = format!("ply\nformat ascii 1.0\n{VERTEX}{FACE}end_header\n");
        for (from, to, expected) in [
            ("ply\n", "plywood\n", "line 1: a PLY file starts with `ply`"),
            ("ascii", "utf8", "line 2: `utf8` is not a format of PLY"),
            ("format", "comment", "line 9: no `format` above"),
            ("vertex 4", "vertex four", "line 3: `four` is not a count"),
            ("vertex 4", "vertex", "line 3: an element needs a name and a count"),
            ("element vertex 4\n", "", "line 3: a property stands before the first element"),
            ("face", "vertex", "line 7: a second element `vertex`"),
            ("float y", "half y", "line 5: `half` is not a type of PLY"),
            ("float y", "float x", "line 5: a second property `x`"),
            ("float y", "float v", "line 3: element `vertex` lacks the numbers x, y and z"),
            ("float y", "float", "line 5: a property needs a name"),
            ("property float y", "attribute float y", "line 5: `attribute` is not a word of a PLY header"),
            ("uchar int", "float int", "line 8: the length of a list must be an integer"),
            ("vertex_indices", "corners", "line 7: element `face` lacks the list vertex_indices"),
            ("list uchar int", "int", "line 7: element `face` lacks the list vertex_indices"),
            ("end_header\n", "", "ends too early: in the header"),
        ] {
            assert_eq!(failure(header.replacen(from, to, 1).as_bytes()), expected, "{to}");
        }
        assert_eq!(failure(b""), "line 1: a PLY file starts with `ply`");
    }

    #[test]
    fn files_without_vertices_or_faces_are_refused() {
        for (bytes, expected) in [
            (ascii(VERTEX, SQUARE), "is a point cloud: 4 points and no triangle"),
            (
                ascii(&VERTEX.replace("float x", "float f_dc_0\nproperty float x"), &SQUARE.replace('\n', " 0\n")),
                "holds Gaussian splats: 4 points and no triangle",
            ),
            (
                ascii(&format!("{VERTEX}element edge 1\nproperty int vertex1\n"), &format!("{SQUARE}0\n")),
                "holds lines alone: 4 points and no triangle",
            ),
            (ascii(&VERTEX.replace('4', "0"), ""), "no vertex"),
            (ascii("", ""), "no vertex"),
            (
                ascii(&format!("{VERTEX}{FACE}"), &format!("{SQUARE}0\n0\n")),
                "is a point cloud: 4 points and no triangle",
            ),
        ] {
            assert_eq!(parse(&bytes, Format::Ply, 1.0).unwrap_err().to_string(), expected);
        }
    }

    #[test]
    fn vertices_that_are_not_numbers_are_dropped_and_counted() {
        let text = ascii(&format!("{VERTEX}{FACE}"), &format!("{SQUARE}{TWO}").replacen("0 1 0", "0 NaN 0", 1));
        let (mesh, cleaned) = parse(&text, Format::Ply, 1.0).unwrap();
        assert_eq!((mesh.triangles.len(), cleaned.non_finite_vertices), (1, 1));
    }
}
