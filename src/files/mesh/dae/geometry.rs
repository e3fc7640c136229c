//! Reads the points and polygons of one geometry of a COLLADA file.

use std::collections::HashMap;

use roxmltree::Node;

use super::ElementLibrary;
use crate::mesh::polygon::Triangulator;
use crate::mesh::raw::{iter_fan_triangles, iter_strip_triangles};
use crate::mesh::xml::{
    children_named, collect_text, find_child, malformed_at, parse_attribute, parse_numbers, problem_at,
};
use crate::mesh::{MeshFileError, MeshFileProblem, quote_word};
use gelsim_core::mesh::MeshError;

pub(super) struct Geometry {
    pub(super) points: Vec<[f64; 3]>,
    pub(super) triangles: Vec<[u32; 3]>,
}

impl Geometry {
    pub(super) fn read<'a, 'i>(node: Node<'a, 'i>, library: &ElementLibrary<'a, 'i>) -> Result<Self, MeshFileError> {
        let mut geometry = Self { points: Vec::new(), triangles: Vec::new() };
        // A geometry may be a spline or the hull of another one: those have no triangles.
        let Some(mesh) = find_child(node, "mesh") else { return Ok(geometry) };
        let mut sources: HashMap<usize, (usize, usize)> = HashMap::new();
        let mut cutter = Triangulator::new();
        for element in mesh.children().filter(Node::is_element) {
            let kind = element.tag_name().name();
            if matches!(kind, "triangles" | "polylist" | "polygons" | "tristrips" | "trifans") {
                geometry.add_primitive(element, kind, library, &mut sources, &mut cutter)?;
            }
        }
        Ok(geometry)
    }

    fn add_primitive<'a, 'i>(
        &mut self,
        element: Node<'a, 'i>,
        kind: &str,
        library: &ElementLibrary<'a, 'i>,
        sources: &mut HashMap<usize, (usize, usize)>,
        cutter: &mut Triangulator,
    ) -> Result<(), MeshFileError> {
        let mut stride = 1;
        let mut vertex = None;
        for input in children_named(element, "input") {
            let offset: usize = parse_attribute(input, "offset")?;
            if offset >= 64 {
                return Err(malformed_at(input, "has more than 64 inputs"));
            }
            stride = stride.max(offset + 1);
            if input.attribute("semantic") == Some("VERTEX") {
                vertex = Some((offset, input));
            }
        }
        let Some((offset, input)) = vertex else {
            return match find_child(element, "p") {
                Some(_) => Err(malformed_at(element, format!("<{kind}> has no input VERTEX"))),
                None => Ok(()),
            };
        };
        let vertices = library.find_referenced(input, "source")?;
        let positions = children_named(vertices, "input").find(|input| input.attribute("semantic") == Some("POSITION"));
        let Some(positions) = positions else { return Err(malformed_at(vertices, "<vertices> has no input POSITION")) };
        let source = library.find_referenced(positions, "source")?;
        let (first, count) = match sources.get(&source.id().get_usize()) {
            Some(known) => *known,
            None => {
                let first = self.points.len();
                self.points.extend(read_points(source, library)?);
                let new = (first, self.points.len() - first);
                sources.insert(source.id().get_usize(), new);
                new
            }
        };
        let corner = |node: Node, index: i64| match usize::try_from(index).ok().filter(|index| *index < count) {
            Some(index) => Ok((first + index) as u32),
            None => Err(problem_at(node, MeshError::NoSuchVertex { index, count, note: " in this geometry" }.into())),
        };
        let corners = |node: Node| -> Result<Vec<u32>, MeshFileError> {
            // One <p> holds an index for every input of every corner; `offset` is that of the vertex among them.
            let indices: Vec<i64> = parse_numbers(node, &collect_text(node))?;
            indices.chunks_exact(stride).map(|indices| corner(node, indices[offset])).collect()
        };
        if find_child(element, "ph").is_some() {
            let problem = MeshFileProblem::Unsupported("has polygons with holes (<ph>), which are not read".into());
            return Err(problem_at(element, problem));
        }
        let mut lengths: Vec<usize> = Vec::new();
        if kind == "polylist" {
            for vcount in children_named(element, "vcount") {
                lengths.extend(parse_numbers::<usize>(vcount, &collect_text(vcount))?);
            }
        }
        for p in children_named(element, "p") {
            let corners = corners(p)?;
            match kind {
                "triangles" => self.triangles.extend(corners.as_chunks::<3>().0),
                "tristrips" => self.triangles.extend(iter_strip_triangles(&corners)),
                "trifans" => self.triangles.extend(iter_fan_triangles(&corners)),
                "polylist" => {
                    let mut rest = &corners[..];
                    for &length in &lengths {
                        let Some((polygon, after)) = rest.split_at_checked(length) else {
                            let message = "<vcount> has more corners than <p>";
                            return Err(malformed_at(p, message));
                        };
                        cutter
                            .triangulate(&self.points, polygon, &mut self.triangles)
                            .map_err(|problem| problem_at(p, problem))?;
                        rest = after;
                    }
                }
                _ => cutter
                    .triangulate(&self.points, &corners, &mut self.triangles)
                    .map_err(|problem| problem_at(p, problem))?,
            }
        }
        Ok(())
    }
}

/// Reads the points of a source: x, y and z from the start of the stride of every element.
fn read_points<'a, 'i>(source: Node<'a, 'i>, library: &ElementLibrary<'a, 'i>) -> Result<Vec<[f64; 3]>, MeshFileError> {
    let accessor = find_child(source, "technique_common").and_then(|technique| find_child(technique, "accessor"));
    let array = match accessor {
        Some(accessor) => library.find_referenced(accessor, "source")?,
        None => find_child(source, "float_array").ok_or_else(|| malformed_at(source, "<source> has no float_array"))?,
    };
    let number =
        |key: &str, default: usize| match accessor.and_then(|accessor| accessor.attribute(key).map(|_| accessor)) {
            Some(accessor) => parse_attribute(accessor, key),
            None => Ok(default),
        };
    let (stride, offset) = (number("stride", 3)?, number("offset", 0)?);
    if array.tag_name().name() != "float_array" {
        let name = quote_word(array.tag_name().name().as_bytes());
        return Err(malformed_at(array, format!("points are in {name}, not in a float_array")));
    }
    if stride < 3 {
        return Err(malformed_at(source, format!("points have {stride} coordinates instead of 3")));
    }
    let numbers: Vec<f64> = parse_numbers(array, &collect_text(array))?;
    let used = numbers.get(offset..).unwrap_or_default();
    let points: Vec<[f64; 3]> = used.chunks(stride).filter_map(|point| point.first_chunk().copied()).collect();
    let count = number("count", points.len())?;
    if count > points.len() {
        let (claimed, room) = (count as u64, points.len() as u64);
        return Err(problem_at(array, MeshFileProblem::CountMismatch { claimed, what: "points".into(), room }));
    }
    Ok(points)
}
