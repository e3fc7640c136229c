//! What the formats in XML have in common.

use glam::{DAffine3, DMat3, DQuat, DVec3};
use roxmltree::{Document, Node};

use super::{MeshFileError, MeshFileProblem, quoted};

/// Elements may lie in each other so deep.
pub(super) const DEEPEST: usize = 256;

/// Parses XML; a document type is no part of these formats.
pub(super) fn parse(bytes: &[u8]) -> Result<Document<'_>, MeshFileError> {
    let bytes = bytes.strip_prefix(b"\xef\xbb\xbf").unwrap_or(bytes);
    let text = str::from_utf8(bytes).map_err(|error| {
        let line = 1 + bytes[..error.valid_up_to()].iter().filter(|byte| **byte == b'\n').count();
        let help = "save it as UTF-8, e.g. iconv -f latin1 -t utf-8 IN > OUT";
        MeshFileError::at_line(line, MeshFileProblem::advised("is not UTF-8", help))
    })?;
    Document::parse(text).map_err(|error| {
        let message = format!("is not XML: {}", error.to_string().replace(char::is_control, " "));
        MeshFileError::at_line(error.pos().row as usize, MeshFileProblem::Malformed(message))
    })
}

/// What is wrong at an element.
pub(super) fn wrong(node: Node, message: impl Into<String>) -> MeshFileError {
    at(node, MeshFileProblem::Malformed(message.into()))
}

/// The same with any problem.
pub(super) fn at(node: Node, problem: MeshFileProblem) -> MeshFileError {
    MeshFileError::at_line(line(node), problem)
}

/// The line that an element begins in, counted from 1.
pub(super) fn line(node: Node) -> usize {
    node.document().text_pos_at(node.range().start).row as usize
}

/// The elements of that name in an element, whatever their namespace.
pub(super) fn children<'a, 'i: 'a>(node: Node<'a, 'i>, name: &'static str) -> impl Iterator<Item = Node<'a, 'i>> {
    node.children().filter(move |child| child.is_element() && child.tag_name().name() == name)
}

/// The first of them.
pub(super) fn child<'a, 'i: 'a>(node: Node<'a, 'i>, name: &'static str) -> Option<Node<'a, 'i>> {
    children(node, name).next()
}

/// An attribute that must be there.
pub(super) fn attribute<'a>(node: Node<'a, '_>, name: &str) -> Result<&'a str, MeshFileError> {
    node.attribute(name).ok_or_else(|| wrong(node, format!("<{}> has no {name}", node.tag_name().name())))
}

/// An attribute that is a number.
pub(super) fn parsed<T: std::str::FromStr>(node: Node, name: &str) -> Result<T, MeshFileError> {
    let text = attribute(node, name)?;
    text.trim()
        .parse()
        .map_err(|_| wrong(node, format!("{name} {} is not a number that belongs there", quoted(text.as_bytes()))))
}

/// The text in an element, of all its pieces.
pub(super) fn text(node: Node) -> String {
    node.children().filter(|child| child.is_text()).filter_map(|child| child.text()).collect()
}

/// The numbers in a text.
pub(super) fn numbers<T: std::str::FromStr>(node: Node, text: &str) -> Result<Vec<T>, MeshFileError> {
    let number = |word: &str| {
        word.parse().map_err(|_| wrong(node, format!("{} is not a number that belongs there", quoted(word.as_bytes()))))
    };
    text.split_ascii_whitespace().map(number).collect()
}

/// So many numbers in a text.
pub(super) fn exactly<const N: usize>(node: Node, text: &str) -> Result<[f64; N], MeshFileError> {
    let numbers = numbers(node, text)?;
    let given = numbers.len();
    let name = node.tag_name().name();
    numbers.try_into().map_err(|_| wrong(node, format!("<{name}> has {given} numbers instead of {N}")))
}

/// A turn about an axis by degrees.
pub(super) fn turn(axis: DVec3, degrees: f64) -> DAffine3 {
    DAffine3::from_quat(DQuat::from_axis_angle(axis.normalize_or_zero(), degrees.to_radians()))
}

/// Turns about the fixed x, then y, then z, radians, and a shift: as URDF writes a place.
pub(super) fn rolled([roll, pitch, yaw]: [f64; 3], shift: [f64; 3]) -> DAffine3 {
    let turn = DMat3::from_rotation_z(yaw) * DMat3::from_rotation_y(pitch) * DMat3::from_rotation_x(roll);
    DAffine3 { matrix3: turn, translation: DVec3::from_array(shift) }
}
