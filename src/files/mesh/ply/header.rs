//! Reads the header of a PLY file: its encoding, its elements and their properties.

use crate::mesh::{MeshFileError, MeshFileProblem, WordReader, quote_word};

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
    pub(super) kind: ElementKind,
    pub(super) name: String,
    pub(super) count: u64,
    pub(super) line: usize,
    pub(super) properties: Vec<Property>,
}

#[derive(Clone, Copy, PartialEq)]
pub(super) enum ElementKind {
    Vertex,
    Face,
    /// Triangle strips: corner after corner, with -1 between two strips.
    Strips,
    Other,
}

#[derive(Clone, Copy)]
pub(super) struct Property {
    pub(super) role: PropertyRole,
    /// The type of the length, if the property is a list.
    pub(super) list: Option<ScalarType>,
    pub(super) scalar: ScalarType,
}

#[derive(Clone, Copy, PartialEq)]
pub(super) enum PropertyRole {
    Coordinate(usize),
    Corners,
    /// The property that marks a Gaussian splat: its first colour coefficient.
    Splat,
    Other,
}

#[derive(Clone, Copy, PartialEq)]
pub(super) enum ScalarType {
    I8,
    U8,
    I16,
    U16,
    I32,
    U32,
    F32,
    F64,
}

impl ScalarType {
    fn from_name(name: &[u8]) -> Option<ScalarType> {
        match name {
            b"char" | b"int8" => Some(ScalarType::I8),
            b"uchar" | b"uint8" => Some(ScalarType::U8),
            b"short" | b"int16" => Some(ScalarType::I16),
            b"ushort" | b"uint16" => Some(ScalarType::U16),
            b"int" | b"int32" => Some(ScalarType::I32),
            b"uint" | b"uint32" => Some(ScalarType::U32),
            b"float" | b"float32" => Some(ScalarType::F32),
            b"double" | b"float64" => Some(ScalarType::F64),
            _ => None,
        }
    }

    pub(super) fn size(self) -> usize {
        match self {
            ScalarType::I8 | ScalarType::U8 => 1,
            ScalarType::I16 | ScalarType::U16 => 2,
            ScalarType::I32 | ScalarType::U32 | ScalarType::F32 => 4,
            ScalarType::F64 => 8,
        }
    }
}

impl Header {
    /// Reads the header and leaves `words` at the first byte of the body.
    pub(super) fn read(words: &mut WordReader) -> Result<Header, MeshFileError> {
        if words.next_word() != Some(b"ply") || words.break_len(words.at) == 0 {
            return Err(MeshFileError::at_line(1, MeshFileProblem::Malformed("a PLY file starts with `ply`".into())));
        }
        // If lines end with a CR alone, an LF after the last one belongs to the body.
        let is_lone_cr = words.bytes[words.at] == b'\r' && words.break_len(words.at) == 1;
        let mut encoding = None;
        let mut elements = Vec::new();
        while words.next_line() {
            let line = words.line;
            let Some(keyword) = words.next_word() else {
                continue;
            };
            let done = match keyword {
                b"comment" | b"obj_info" => Ok(()),
                b"format" => read_encoding(words).map(|found| encoding = Some(found)),
                b"element" => Element::read(words, line, &elements).map(|element| elements.push(element)),
                b"property" => match elements.last_mut() {
                    Some(element) => Property::append_declared(words, element),
                    None => malformed("a property stands before the first element".into()),
                },
                b"end_header" => {
                    let encoding = encoding.ok_or_else(|| {
                        MeshFileError::at_line(line, MeshFileProblem::Malformed("no `format` above".into()))
                    })?;
                    elements.iter().try_for_each(Element::check_properties)?;
                    while let Some(b' ' | b'\t') = words.bytes.get(words.at) {
                        words.at += 1;
                    }
                    words.at += if is_lone_cr { 1 } else { words.break_len(words.at) };
                    words.at = words.at.min(words.bytes.len());
                    words.line += 1;
                    return Ok(Header { encoding, elements });
                }
                word => malformed(format!("{} is not a word of a PLY header", quote_word(word))),
            };
            done.map_err(|problem| MeshFileError::at_line(line, problem))?;
        }
        Err(MeshFileProblem::UnexpectedEnd("the header".into()).into())
    }
}

pub(super) fn malformed<T>(message: String) -> Result<T, MeshFileProblem> {
    Err(MeshFileProblem::Malformed(message))
}

fn read_encoding(words: &mut WordReader) -> Result<Encoding, MeshFileProblem> {
    match words.next_word() {
        Some(b"ascii") => Ok(Encoding::Ascii),
        Some(b"binary_little_endian") => Ok(Encoding::LittleEndian),
        Some(b"binary_big_endian") => Ok(Encoding::BigEndian),
        word => malformed(format!("{} is not a format of PLY", quote_word(word.unwrap_or_default()))),
    }
}

impl Element {
    fn read(words: &mut WordReader, line: usize, before: &[Element]) -> Result<Element, MeshFileProblem> {
        let (Some(name), Some(count)) = (words.next_word(), words.next_word()) else {
            return malformed("an element needs a name and a count".into());
        };
        let count = str::from_utf8(count)
            .ok()
            .and_then(|count| count.parse().ok())
            .ok_or_else(|| MeshFileProblem::Malformed(format!("{} is not a count", quote_word(count))))?;
        let kind = match name {
            b"vertex" => ElementKind::Vertex,
            b"face" => ElementKind::Face,
            b"tristrips" | b"tristrip" => ElementKind::Strips,
            _ => ElementKind::Other,
        };
        let name = quote_word(name);
        if kind != ElementKind::Other && before.iter().any(|element| element.kind == kind) {
            return malformed(format!("a second element {name}"));
        }
        Ok(Element { kind, name, count, line, properties: Vec::new() })
    }

    pub(super) fn has_role(&self, role: PropertyRole) -> bool {
        self.properties.iter().any(|property| property.role == role)
    }

    /// Checks that the element has the properties that are needed.
    fn check_properties(&self) -> Result<(), MeshFileError> {
        let missing = match self.kind {
            ElementKind::Vertex if !(0..3).all(|axis| self.has_role(PropertyRole::Coordinate(axis))) => {
                "numbers x, y and z"
            }
            ElementKind::Face | ElementKind::Strips if self.count > 0 && !self.has_role(PropertyRole::Corners) => {
                "list vertex_indices"
            }
            _ => return Ok(()),
        };
        let message = format!("element {} lacks the {missing}", self.name);
        Err(MeshFileError::at_line(self.line, MeshFileProblem::Malformed(message)))
    }
}

impl Property {
    /// Reads the declaration of a property and appends it to those of `element`.
    fn append_declared(words: &mut WordReader, element: &mut Element) -> Result<(), MeshFileProblem> {
        let scalar = |name: Option<&[u8]>| {
            let name = name.unwrap_or_default();
            ScalarType::from_name(name)
                .ok_or_else(|| MeshFileProblem::Malformed(format!("{} is not a type of PLY", quote_word(name))))
        };
        let (list, scalar) = match words.next_word() {
            Some(b"list") => (Some(scalar(words.next_word())?), scalar(words.next_word())?),
            name => (None, scalar(name)?),
        };
        if matches!(list, Some(ScalarType::F32 | ScalarType::F64)) {
            return malformed("the length of a list must be an integer".into());
        }
        let Some(name) = words.next_word() else {
            return malformed("a property needs a name".into());
        };
        let role = match (element.kind, name, list) {
            (ElementKind::Vertex, b"x", None) => PropertyRole::Coordinate(0),
            (ElementKind::Vertex, b"y", None) => PropertyRole::Coordinate(1),
            (ElementKind::Vertex, b"z", None) => PropertyRole::Coordinate(2),
            (ElementKind::Face | ElementKind::Strips, b"vertex_indices" | b"vertex_index", Some(_)) => {
                PropertyRole::Corners
            }
            (ElementKind::Vertex, b"f_dc_0", None) => PropertyRole::Splat,
            _ => PropertyRole::Other,
        };
        if role != PropertyRole::Other && element.has_role(role) {
            return malformed(format!("a second property {}", quote_word(name)));
        }
        element.properties.push(Property { role, list, scalar });
        Ok(())
    }
}
