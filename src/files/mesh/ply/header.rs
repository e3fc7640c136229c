//! The header of a PLY file: which elements it has, with which properties, in which encoding.

use crate::mesh::{MeshFileError, MeshFileProblem, Words, quoted};

pub(super) struct Header {
    pub(super) encoding: Encoding,
    pub(super) elements: Vec<Element>,
}

#[derive(Clone, Copy)]
pub(super) enum Encoding {
    Ascii,
    LittleEndian,
    BigEndian,
}

pub(super) struct Element {
    pub(super) kind: Kind,
    pub(super) name: String,
    pub(super) count: u64,
    pub(super) line: usize,
    pub(super) properties: Vec<Property>,
}

#[derive(Clone, Copy, PartialEq)]
pub(super) enum Kind {
    Vertex,
    Face,
    /// Triangles in strips: corner after corner, -1 between two strips.
    Strips,
    Other,
}

#[derive(Clone, Copy)]
pub(super) struct Property {
    pub(super) role: Role,
    /// Type of the length, if this is a list.
    pub(super) list: Option<Scalar>,
    pub(super) scalar: Scalar,
}

#[derive(Clone, Copy, PartialEq)]
pub(super) enum Role {
    Coordinate(usize),
    Corners,
    /// A colour of a Gaussian splat.
    Splat,
    Other,
}

#[derive(Clone, Copy, PartialEq)]
pub(super) enum Scalar {
    I8,
    U8,
    I16,
    U16,
    I32,
    U32,
    F32,
    F64,
}

impl Scalar {
    fn named(name: &[u8]) -> Option<Scalar> {
        match name {
            b"char" | b"int8" => Some(Scalar::I8),
            b"uchar" | b"uint8" => Some(Scalar::U8),
            b"short" | b"int16" => Some(Scalar::I16),
            b"ushort" | b"uint16" => Some(Scalar::U16),
            b"int" | b"int32" => Some(Scalar::I32),
            b"uint" | b"uint32" => Some(Scalar::U32),
            b"float" | b"float32" => Some(Scalar::F32),
            b"double" | b"float64" => Some(Scalar::F64),
            _ => None,
        }
    }

    pub(super) fn size(self) -> usize {
        match self {
            Scalar::I8 | Scalar::U8 => 1,
            Scalar::I16 | Scalar::U16 => 2,
            Scalar::I32 | Scalar::U32 | Scalar::F32 => 4,
            Scalar::F64 => 8,
        }
    }
}

impl Header {
    /// Leaves `words` at the first byte of the body.
    pub(super) fn read(words: &mut Words) -> Result<Header, MeshFileError> {
        if words.word() != Some(b"ply") || words.break_len(words.at) == 0 {
            return Err(MeshFileError::at_line(1, MeshFileProblem::Malformed("a PLY file starts with `ply`".into())));
        }
        // Where lines end with a CR alone, an LF after the last one belongs to the body.
        let is_lone_cr = words.bytes[words.at] == b'\r' && words.break_len(words.at) == 1;
        let mut encoding = None;
        let mut elements = Vec::new();
        while words.next_line() {
            let line = words.line;
            let Some(keyword) = words.word() else {
                continue;
            };
            let done = match keyword {
                b"comment" | b"obj_info" => Ok(()),
                b"format" => format(words).map(|found| encoding = Some(found)),
                b"element" => Element::read(words, line, &elements).map(|element| elements.push(element)),
                b"property" => match elements.last_mut() {
                    Some(element) => Property::read(words, element),
                    None => malformed("a property stands before the first element".into()),
                },
                b"end_header" => {
                    let encoding = encoding.ok_or_else(|| {
                        MeshFileError::at_line(line, MeshFileProblem::Malformed("no `format` above".into()))
                    })?;
                    elements.iter().try_for_each(Element::check)?;
                    while let Some(b' ' | b'\t') = words.bytes.get(words.at) {
                        words.at += 1;
                    }
                    words.at += if is_lone_cr { 1 } else { words.break_len(words.at) };
                    words.at = words.at.min(words.bytes.len());
                    words.line += 1;
                    return Ok(Header { encoding, elements });
                }
                word => malformed(format!("{} is not a word of a PLY header", quoted(word))),
            };
            done.map_err(|problem| MeshFileError::at_line(line, problem))?;
        }
        Err(MeshFileProblem::EndsEarly("the header".into()).into())
    }
}

pub(super) fn malformed<T>(message: String) -> Result<T, MeshFileProblem> {
    Err(MeshFileProblem::Malformed(message))
}

fn format(words: &mut Words) -> Result<Encoding, MeshFileProblem> {
    match words.word() {
        Some(b"ascii") => Ok(Encoding::Ascii),
        Some(b"binary_little_endian") => Ok(Encoding::LittleEndian),
        Some(b"binary_big_endian") => Ok(Encoding::BigEndian),
        word => malformed(format!("{} is not a format of PLY", quoted(word.unwrap_or_default()))),
    }
}

impl Element {
    fn read(words: &mut Words, line: usize, before: &[Element]) -> Result<Element, MeshFileProblem> {
        let (Some(name), Some(count)) = (words.word(), words.word()) else {
            return malformed("an element needs a name and a count".into());
        };
        let count = str::from_utf8(count)
            .ok()
            .and_then(|count| count.parse().ok())
            .ok_or_else(|| MeshFileProblem::Malformed(format!("{} is not a count", quoted(count))))?;
        let kind = match name {
            b"vertex" => Kind::Vertex,
            b"face" => Kind::Face,
            b"tristrips" | b"tristrip" => Kind::Strips,
            _ => Kind::Other,
        };
        let name = quoted(name);
        if kind != Kind::Other && before.iter().any(|element| element.kind == kind) {
            return malformed(format!("a second element {name}"));
        }
        Ok(Element { kind, name, count, line, properties: Vec::new() })
    }

    pub(super) fn has(&self, role: Role) -> bool {
        self.properties.iter().any(|property| property.role == role)
    }

    /// Whether the element has the properties that we need.
    fn check(&self) -> Result<(), MeshFileError> {
        let missing = match self.kind {
            Kind::Vertex if !(0..3).all(|axis| self.has(Role::Coordinate(axis))) => "numbers x, y and z",
            Kind::Face | Kind::Strips if self.count > 0 && !self.has(Role::Corners) => "list vertex_indices",
            _ => return Ok(()),
        };
        let message = format!("element {} lacks the {missing}", self.name);
        Err(MeshFileError::at_line(self.line, MeshFileProblem::Malformed(message)))
    }
}

impl Property {
    /// Appends the property that is declared next to those of `element`.
    fn read(words: &mut Words, element: &mut Element) -> Result<(), MeshFileProblem> {
        let scalar = |name: Option<&[u8]>| {
            let name = name.unwrap_or_default();
            Scalar::named(name)
                .ok_or_else(|| MeshFileProblem::Malformed(format!("{} is not a type of PLY", quoted(name))))
        };
        let (list, scalar) = match words.word() {
            Some(b"list") => (Some(scalar(words.word())?), scalar(words.word())?),
            name => (None, scalar(name)?),
        };
        if matches!(list, Some(Scalar::F32 | Scalar::F64)) {
            return malformed("the length of a list must be an integer".into());
        }
        let Some(name) = words.word() else {
            return malformed("a property needs a name".into());
        };
        let role = match (element.kind, name, list) {
            (Kind::Vertex, b"x", None) => Role::Coordinate(0),
            (Kind::Vertex, b"y", None) => Role::Coordinate(1),
            (Kind::Vertex, b"z", None) => Role::Coordinate(2),
            (Kind::Face | Kind::Strips, b"vertex_indices" | b"vertex_index", Some(_)) => Role::Corners,
            (Kind::Vertex, b"f_dc_0", None) => Role::Splat,
            _ => Role::Other,
        };
        if role != Role::Other && element.has(role) {
            return malformed(format!("a second property {}", quoted(name)));
        }
        element.properties.push(Property { role, list, scalar });
        Ok(())
    }
}
