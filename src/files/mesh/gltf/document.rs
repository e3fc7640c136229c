//! The parts of a glTF file's JSON that say where triangles are.

use std::collections::BTreeMap;

use serde::Deserialize;
use serde::de::IgnoredAny;

use crate::mesh::{MeshFileError, MeshFileProblem};

#[derive(Deserialize)]
#[serde(rename_all = "camelCase")]
pub(super) struct Document {
    pub(super) asset: Asset,
    #[serde(default)]
    pub(super) extensions_required: Vec<String>,
    #[serde(default)]
    pub(super) scenes: Vec<Scene>,
    #[serde(default)]
    pub(super) nodes: Vec<Node>,
    #[serde(default)]
    pub(super) meshes: Vec<Mesh>,
    #[serde(default)]
    pub(super) accessors: Vec<Accessor>,
    #[serde(default)]
    pub(super) buffer_views: Vec<BufferView>,
    #[serde(default)]
    pub(super) buffers: Vec<Buffer>,
}

#[derive(Deserialize)]
pub(super) struct Asset {
    pub(super) version: String,
}

#[derive(Deserialize)]
pub(super) struct Scene {
    #[serde(default)]
    pub(super) nodes: Vec<usize>,
}

#[derive(Deserialize)]
pub(super) struct Node {
    pub(super) name: Option<String>,
    pub(super) mesh: Option<usize>,
    pub(super) skin: Option<usize>,
    #[serde(default)]
    pub(super) children: Vec<usize>,
    /// The transform, column by column.
    pub(super) matrix: Option<[f64; 16]>,
    pub(super) translation: Option<[f64; 3]>,
    /// A quaternion in the order x, y, z, w.
    pub(super) rotation: Option<[f64; 4]>,
    pub(super) scale: Option<[f64; 3]>,
}

#[derive(Deserialize)]
pub(super) struct Mesh {
    pub(super) name: Option<String>,
    #[serde(default)]
    pub(super) primitives: Vec<Primitive>,
}

#[derive(Deserialize)]
pub(super) struct Primitive {
    #[serde(default)]
    pub(super) attributes: BTreeMap<String, usize>,
    pub(super) indices: Option<usize>,
    pub(super) mode: Option<u32>,
    #[serde(default)]
    pub(super) extensions: BTreeMap<String, IgnoredAny>,
}

#[derive(Deserialize)]
#[serde(rename_all = "camelCase")]
pub(super) struct Accessor {
    pub(super) buffer_view: Option<usize>,
    #[serde(default)]
    pub(super) byte_offset: usize,
    pub(super) component_type: u32,
    #[serde(default)]
    pub(super) normalized: bool,
    pub(super) count: usize,
    #[serde(rename = "type")]
    pub(super) kind: String,
    pub(super) sparse: Option<IgnoredAny>,
}

#[derive(Deserialize)]
#[serde(rename_all = "camelCase")]
pub(super) struct BufferView {
    pub(super) buffer: usize,
    #[serde(default)]
    pub(super) byte_offset: usize,
    pub(super) byte_length: usize,
    pub(super) byte_stride: Option<usize>,
}

#[derive(Deserialize)]
#[serde(rename_all = "camelCase")]
pub(super) struct Buffer {
    pub(super) uri: Option<String>,
    pub(super) byte_length: usize,
}

/// Parses the JSON of a file. Also returns the buffer that follows it in a binary file.
pub(super) fn parse(bytes: &[u8]) -> Result<(Document, Option<&[u8]>), MeshFileError> {
    let (json, binary) = match bytes.strip_prefix(b"glTF") {
        Some(rest) => split_chunks(rest)?,
        None => (bytes.strip_prefix(b"\xef\xbb\xbf").unwrap_or(bytes), None),
    };
    let document = serde_json::from_slice(json).map_err(|error| {
        let message = format!("is not glTF: {}", error.to_string().replace(char::is_control, " "));
        let line = (!bytes.starts_with(b"glTF")).then(|| error.line());
        MeshFileError { path: None, line, problem: MeshFileProblem::Malformed(message) }
    })?;
    Ok((document, binary))
}

/// Splits what follows the first four bytes of a binary file into its JSON and its buffer.
fn split_chunks(rest: &[u8]) -> Result<(&[u8], Option<&[u8]>), MeshFileError> {
    let early = || MeshFileProblem::UnexpectedEnd("the chunks of a binary file".into());
    let ([version, _length], mut rest) = read_u32_pair(rest).ok_or_else(early)?;
    if version != 2 {
        return Err(MeshFileProblem::Unsupported(format!("is binary glTF {version}, of which 2 is read")).into());
    }
    let mut chunk = |kind: &[u8; 4]| {
        let ([length, found], after) = read_u32_pair(rest)?;
        let (content, after) = after.split_at_checked(length as usize)?;
        rest = after;
        (found == u32::from_le_bytes(*kind)).then_some(content)
    };
    let json = chunk(b"JSON").ok_or_else(early)?;
    Ok((json, chunk(b"BIN\0")))
}

fn read_u32_pair(bytes: &[u8]) -> Option<([u32; 2], &[u8])> {
    let (numbers, rest) = bytes.split_first_chunk::<8>()?;
    let [first, second] = [0, 4].map(|at| numbers[at..at + 4].try_into().map(u32::from_le_bytes));
    Some(([first.ok()?, second.ok()?], rest))
}
