//! Helpers for the formats in XML.

use glam::{DAffine3, DMat3, DQuat, DVec3};
use roxmltree::{Document, Node};

use super::{MeshFileError, MeshFileProblem, quote_word};

/// The greatest depth of elements in elements.
pub(super) const MAX_ELEMENT_DEPTH: usize = 256;

/// Parses XML. A document type is refused, since these formats have none.
pub(super) fn parse(bytes: &[u8]) -> Result<Document<'_>, MeshFileError> {
    let bytes = bytes.strip_prefix(b"\xef\xbb\xbf").unwrap_or(bytes);
    let text = str::from_utf8(bytes).map_err(|error| {
        let line = 1 + bytes[..error.valid_up_to()].iter().filter(|byte| **byte == b'\n').count();
        let help = "save it as UTF-8, e.g. iconv -f latin1 -t utf-8 IN > OUT";
        MeshFileError::at_line(line, MeshFileProblem::with_help("is not UTF-8", help))
    })?;
    Document::parse(text).map_err(|error| {
        let message = format!("is not XML: {}", error.to_string().replace(char::is_control, " "));
        MeshFileError::at_line(error.pos().row as usize, MeshFileProblem::Malformed(message))
    })
}

/// Makes an error about the rules of the format at an element.
pub(super) fn malformed_at(node: Node, message: impl Into<String>) -> MeshFileError {
    problem_at(node, MeshFileProblem::Malformed(message.into()))
}

/// Makes an error of any kind at an element.
pub(super) fn problem_at(node: Node, problem: MeshFileProblem) -> MeshFileError {
    MeshFileError::at_line(line_number(node), problem)
}

/// Returns the line on which an element begins, counted from 1.
pub(super) fn line_number(node: Node) -> usize {
    node.document().text_pos_at(node.range().start).row as usize
}

/// Iterates over the child elements of that name, whatever their namespace.
pub(super) fn children_named<'a, 'i: 'a>(node: Node<'a, 'i>, name: &'static str) -> impl Iterator<Item = Node<'a, 'i>> {
    node.children().filter(move |child| child.is_element() && child.tag_name().name() == name)
}

/// Returns the first child element of that name.
pub(super) fn find_child<'a, 'i: 'a>(node: Node<'a, 'i>, name: &'static str) -> Option<Node<'a, 'i>> {
    children_named(node, name).next()
}

/// Returns an attribute, or an error if it is missing.
pub(super) fn require_attribute<'a>(node: Node<'a, '_>, name: &str) -> Result<&'a str, MeshFileError> {
    node.attribute(name).ok_or_else(|| malformed_at(node, format!("<{}> has no {name}", node.tag_name().name())))
}

/// Parses an attribute that must be a number.
pub(super) fn parse_attribute<T: std::str::FromStr>(node: Node, name: &str) -> Result<T, MeshFileError> {
    let text = require_attribute(node, name)?;
    text.trim().parse().map_err(|_| {
        malformed_at(node, format!("{name} {} is not a number that belongs there", quote_word(text.as_bytes())))
    })
}

/// Joins all pieces of text in an element.
pub(super) fn collect_text(node: Node) -> String {
    node.children().filter(|child| child.is_text()).filter_map(|child| child.text()).collect()
}

/// Parses the numbers in a text.
pub(super) fn parse_numbers<T: std::str::FromStr>(node: Node, text: &str) -> Result<Vec<T>, MeshFileError> {
    let number = |word: &str| {
        word.parse().map_err(|_| {
            malformed_at(node, format!("{} is not a number that belongs there", quote_word(word.as_bytes())))
        })
    };
    text.split_ascii_whitespace().map(number).collect()
}

/// Parses exactly `N` numbers in a text.
pub(super) fn parse_exactly<const N: usize>(node: Node, text: &str) -> Result<[f64; N], MeshFileError> {
    let numbers = parse_numbers(node, text)?;
    let given = numbers.len();
    let name = node.tag_name().name();
    numbers.try_into().map_err(|_| malformed_at(node, format!("<{name}> has {given} numbers instead of {N}")))
}

/// Makes a rotation about an axis, in degrees.
pub(super) fn rotation_about(axis: DVec3, degrees: f64) -> DAffine3 {
    DAffine3::from_quat(DQuat::from_axis_angle(axis.normalize_or_zero(), degrees.to_radians()))
}

/// Makes a transform from rotations about the fixed x, then y, then z, in radians, and a shift, as URDF writes a place.
pub(super) fn transform_from_rpy([roll, pitch, yaw]: [f64; 3], shift: [f64; 3]) -> DAffine3 {
    let turn = DMat3::from_rotation_z(yaw) * DMat3::from_rotation_y(pitch) * DMat3::from_rotation_x(roll);
    DAffine3 { matrix3: turn, translation: DVec3::from_array(shift) }
}
