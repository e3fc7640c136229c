//! The points and polygons of one geometry of a COLLADA file.

use std::collections::HashMap;

use roxmltree::Node;

use super::Library;
use crate::mesh::polygon::Cutter;
use crate::mesh::raw::{fan, strip};
use crate::mesh::xml::{at, child, children, numbers, parsed, text, wrong};
use crate::mesh::{MeshFileError, MeshFileProblem, quoted};
use gelsim_core::mesh::MeshError;

pub(super) struct Geometry {
    pub(super) points: Vec<[f64; 3]>,
    pub(super) triangles: Vec<[u32; 3]>,
}

impl Geometry {
    pub(super) fn read<'a, 'i>(node: Node<'a, 'i>, library: &Library<'a, 'i>) -> Result<Self, MeshFileError> {
        let mut geometry = Self { points: Vec::new(), triangles: Vec::new() };
        // Splines and shapes of convex hulls have no triangles.
        let Some(mesh) = child(node, "mesh") else { return Ok(geometry) };
        let mut sources: HashMap<usize, (usize, usize)> = HashMap::new();
        let mut cutter = Cutter::new();
        for element in mesh.children().filter(Node::is_element) {
            let kind = element.tag_name().name();
            if matches!(kind, "triangles" | "polylist" | "polygons" | "tristrips" | "trifans") {
                geometry.add(element, kind, library, &mut sources, &mut cutter)?;
            }
        }
        Ok(geometry)
    }

    fn add<'a, 'i>(
        &mut self,
        element: Node<'a, 'i>,
        kind: &str,
        library: &Library<'a, 'i>,
        sources: &mut HashMap<usize, (usize, usize)>,
        cutter: &mut Cutter,
    ) -> Result<(), MeshFileError> {
        let mut stride = 1;
        let mut vertex = None;
        for input in children(element, "input") {
            let offset: usize = parsed(input, "offset")?;
            if offset >= 64 {
                return Err(wrong(input, "has more than 64 inputs"));
            }
            stride = stride.max(offset + 1);
            if input.attribute("semantic") == Some("VERTEX") {
                vertex = Some((offset, input));
            }
        }
        let Some((offset, input)) = vertex else {
            return match child(element, "p") {
                Some(_) => Err(wrong(element, format!("<{kind}> has no input VERTEX"))),
                None => Ok(()),
            };
        };
        let vertices = library.named(input, "source")?;
        let positions = children(vertices, "input").find(|input| input.attribute("semantic") == Some("POSITION"));
        let Some(positions) = positions else { return Err(wrong(vertices, "<vertices> has no input POSITION")) };
        let source = library.named(positions, "source")?;
        let (first, count) = match sources.get(&source.id().get_usize()) {
            Some(known) => *known,
            None => {
                let first = self.points.len();
                self.points.extend(points(source, library)?);
                let new = (first, self.points.len() - first);
                sources.insert(source.id().get_usize(), new);
                new
            }
        };
        let corner = |node: Node, index: i64| match usize::try_from(index).ok().filter(|index| *index < count) {
            Some(index) => Ok((first + index) as u32),
            None => Err(at(node, MeshError::NoSuchVertex { index, count, note: " in this geometry" }.into())),
        };
        let corners = |node: Node| -> Result<Vec<u32>, MeshFileError> {
            let indices: Vec<i64> = numbers(node, &text(node))?;
            indices.chunks_exact(stride).map(|indices| corner(node, indices[offset])).collect()
        };
        if child(element, "ph").is_some() {
            let problem = MeshFileProblem::Unsupported("has polygons with holes (<ph>), which are not read".into());
            return Err(at(element, problem));
        }
        let mut lengths: Vec<usize> = Vec::new();
        if kind == "polylist" {
            for vcount in children(element, "vcount") {
                lengths.extend(numbers::<usize>(vcount, &text(vcount))?);
            }
        }
        for p in children(element, "p") {
            let corners = corners(p)?;
            match kind {
                "triangles" => self.triangles.extend(corners.as_chunks::<3>().0),
                "tristrips" => self.triangles.extend(strip(&corners)),
                "trifans" => self.triangles.extend(fan(&corners)),
                "polylist" => {
                    let mut rest = &corners[..];
                    for &length in &lengths {
                        let Some((polygon, after)) = rest.split_at_checked(length) else {
                            let message = "<vcount> has more corners than <p>";
                            return Err(wrong(p, message));
                        };
                        cutter.cut(&self.points, polygon, &mut self.triangles).map_err(|problem| at(p, problem))?;
                        rest = after;
                    }
                }
                _ => cutter.cut(&self.points, &corners, &mut self.triangles).map_err(|problem| at(p, problem))?,
            }
        }
        Ok(())
    }
}

/// The points of a source: x, y and z of every element, at the start of its stride.
fn points<'a, 'i>(source: Node<'a, 'i>, library: &Library<'a, 'i>) -> Result<Vec<[f64; 3]>, MeshFileError> {
    let accessor = child(source, "technique_common").and_then(|technique| child(technique, "accessor"));
    let array = match accessor {
        Some(accessor) => library.named(accessor, "source")?,
        None => child(source, "float_array").ok_or_else(|| wrong(source, "<source> has no float_array"))?,
    };
    let number =
        |key: &str, default: usize| match accessor.and_then(|accessor| accessor.attribute(key).map(|_| accessor)) {
            Some(accessor) => parsed(accessor, key),
            None => Ok(default),
        };
    let (stride, offset) = (number("stride", 3)?, number("offset", 0)?);
    if array.tag_name().name() != "float_array" {
        let name = quoted(array.tag_name().name().as_bytes());
        return Err(wrong(array, format!("points are in {name}, not in a float_array")));
    }
    if stride < 3 {
        return Err(wrong(source, format!("points have {stride} coordinates instead of 3")));
    }
    let numbers: Vec<f64> = numbers(array, &text(array))?;
    let used = numbers.get(offset..).unwrap_or_default();
    let points: Vec<[f64; 3]> = used.chunks(stride).filter_map(|point| point.first_chunk().copied()).collect();
    let count = number("count", points.len())?;
    if count > points.len() {
        let (claimed, room) = (count as u64, points.len() as u64);
        return Err(at(array, MeshFileProblem::Room { claimed, what: "points".into(), room }));
    }
    Ok(points)
}
