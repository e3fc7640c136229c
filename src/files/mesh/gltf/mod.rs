//! Reads glTF 2.0: the triangles of every mesh that a scene shows, where its nodes place it.
//!
//! Our own reader, since the crate `gltf` 1.4 overflows when it adds up the offsets of damaged files, and panics where
//! something is missing. Format: Khronos, glTF 2.0 specification (2021).

use std::collections::HashMap;

use glam::{DAffine3, DMat3, DQuat, DVec3};

use super::points::PointKind;
use super::raw::{RawMesh, iter_fan_triangles, iter_strip_triangles};
use super::resources::Resources;
use super::{MeshFileError, MeshFileProblem};
use gelsim_core::mesh::MeshError;

mod buffers;
mod document;

use buffers::Buffers;
use document::{Document, Mesh, Node, Primitive};

/// Extensions that a file may require: those about appearance, and one for shorter coordinates.
const SUPPORTED_EXTENSIONS: [&str; 6] =
    ["KHR_mesh_quantization", "KHR_materials_", "KHR_texture_", "EXT_texture_", "KHR_lights_", "KHR_animation_pointer"];

/// The greatest depth of nodes in nodes.
const MAX_NODE_DEPTH: usize = 256;

pub(super) fn malformed<T>(message: String) -> Result<T, MeshFileError> {
    Err(MeshFileProblem::Malformed(message).into())
}

fn unsupported<T>(message: String) -> Result<T, MeshFileError> {
    Err(MeshFileProblem::Unsupported(message).into())
}

/// Reads vertices and triangles in the order in which scenes name them. Each node with a mesh is a part. The unit is
/// the metre.
pub(super) fn read(bytes: &[u8], others: &mut Resources) -> Result<RawMesh, MeshFileError> {
    let (document, binary) = document::parse(bytes)?;
    for extension in &document.extensions_required {
        if !SUPPORTED_EXTENSIONS.iter().any(|known| extension.starts_with(known)) {
            let name = extension.escape_debug();
            return unsupported(format!("requires the extension {name}, which is not read"));
        }
    }
    if !document.asset.version.starts_with("2.") {
        return unsupported(format!("is glTF {}, of which 2.0 is read", document.asset.version.escape_debug()));
    }
    let mut buffers = Buffers::new(&document, binary, others);
    let mut raw = RawMesh { mm_per_unit: Some(1000.0), ..RawMesh::default() };
    let mut seen = vec![false; document.nodes.len()];
    let mut waiting: Vec<(usize, DAffine3, usize)> =
        find_root_nodes(&document).into_iter().rev().map(|root| (root, DAffine3::IDENTITY, 0)).collect();
    while let Some((number, outer, depth)) = waiting.pop() {
        let Some(node) = document.nodes.get(number) else {
            return malformed(format!("refers to node {number}, but has {}", document.nodes.len()));
        };
        // The format allows a node one parent. A circle would never end.
        if std::mem::replace(&mut seen[number], true) || depth > MAX_NODE_DEPTH {
            return malformed(format!("node {number} is the child of two nodes, or of itself"));
        }
        let place = outer * read_transform(node);
        if let Some(at) = node.mesh {
            let Some(mesh) = document.meshes.get(at) else {
                return malformed(format!(
                    "node {number} refers to mesh {at}, but there are {}",
                    document.meshes.len()
                ));
            };
            if node.skin.is_some() {
                return unsupported(format!("node {number} has a skin, whose pose is not read"));
            }
            let name = [&node.name, &mesh.name].into_iter().flatten().find(|name| !name.is_empty());
            let name = name.cloned().unwrap_or_else(|| format!("node{number}"));
            raw.parts.begin_part(&name, raw.triangles.len());
            add_mesh(&mut raw, mesh, &place, &mut buffers, bytes.len())?;
        }
        waiting.extend(node.children.iter().rev().map(|&child| (child, place, depth + 1)));
    }
    Ok(raw)
}

/// Returns the nodes that scenes begin with, each once. If there is no scene, these are the nodes that are nobody's
/// child.
fn find_root_nodes(document: &Document) -> Vec<usize> {
    let mut taken = vec![false; document.nodes.len()];
    if document.scenes.is_empty() {
        for child in document.nodes.iter().flat_map(|node| &node.children) {
            if let Some(taken) = taken.get_mut(*child) {
                *taken = true;
            }
        }
        return (0..taken.len()).filter(|&node| !taken[node]).collect();
    }
    let named = document.scenes.iter().flat_map(|scene| &scene.nodes).copied();
    // A node that does not exist is kept: it is reported when it is read.
    named.filter(|&node| taken.get_mut(node).is_none_or(|taken| !std::mem::replace(taken, true))).collect()
}

/// Reads the place of a node in its parent.
fn read_transform(node: &Node) -> DAffine3 {
    if let Some(m) = node.matrix {
        let column = |k: usize| DVec3::new(m[4 * k], m[4 * k + 1], m[4 * k + 2]);
        return DAffine3 { matrix3: DMat3::from_cols(column(0), column(1), column(2)), translation: column(3) };
    }
    let turn = match node.rotation {
        Some(quaternion) => DQuat::from_array(quaternion).normalize(),
        None => DQuat::IDENTITY,
    };
    DAffine3::from_scale_rotation_translation(
        DVec3::from_array(node.scale.unwrap_or([1.0; 3])),
        turn,
        DVec3::from_array(node.translation.unwrap_or([0.0; 3])),
    )
}

fn add_mesh(
    raw: &mut RawMesh,
    mesh: &Mesh,
    place: &DAffine3,
    buffers: &mut Buffers,
    file: usize,
) -> Result<(), MeshFileError> {
    // Primitives often share vertices: by accessor, the first of its vertices and their number.
    let mut added: HashMap<usize, (u32, usize)> = HashMap::new();
    for primitive in &mesh.primitives {
        // A primitive without a mode has 4, triangles; below 4 are points and lines.
        let mode = primitive.mode.unwrap_or(4);
        if mode < 4 {
            let accessor = primitive.attributes.get("POSITION").and_then(|positions| buffers.element_count(*positions));
            let is_splat = primitive.extensions.keys().any(|name| name.contains("gaussian_splatting"));
            raw.points.kind = match mode {
                0 if is_splat => PointKind::Splats,
                0 => PointKind::Cloud,
                _ => PointKind::Lines,
            };
            raw.points.count = raw.points.count.saturating_add(accessor.unwrap_or(0));
            continue;
        }
        if primitive.extensions.contains_key("KHR_draco_mesh_compression") {
            return unsupported(String::from("is compressed by Draco, which is not read"));
        }
        let Some(&positions) = primitive.attributes.get("POSITION") else { continue };
        let (first, count) = match added.get(&positions) {
            Some(known) => *known,
            None => {
                let points = buffers.read_points(positions)?;
                let new = (raw.add_vertices(place, points.iter().copied())?, points.len());
                added.insert(positions, new);
                new
            }
        };
        raw.add_triangles(place, first, &read_triangles(primitive, mode, count, buffers)?);
        raw.check_growth(file + buffers.bytes)?;
    }
    Ok(())
}

/// Reads the triangles of a primitive with a mode from 4 up, as indices of its `count` vertices.
fn read_triangles(
    primitive: &Primitive,
    mode: u32,
    count: usize,
    buffers: &mut Buffers,
) -> Result<Vec<[u32; 3]>, MeshFileError> {
    let corners = match primitive.indices {
        Some(indices) => buffers.read_indices(indices)?,
        None => (0..count as u32).collect(),
    };
    if let Some(&index) = corners.iter().find(|corner| **corner as usize >= count) {
        return Err(MeshError::NoSuchVertex { index: index.into(), count, note: " in this primitive" }.into());
    }
    Ok(match mode {
        4 => corners.as_chunks::<3>().0.to_vec(),
        5 => iter_strip_triangles(&corners).collect(),
        6 => iter_fan_triangles(&corners).collect(),
        mode => return malformed(format!("a primitive has mode {mode}, but the last is 6")),
    })
}

#[cfg(test)]
mod tests;
