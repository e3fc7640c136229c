//! Reads COLLADA 1.4 and 1.5: the polygons of every geometry that the visual scene shows, where its nodes place it.
//!
//! Our own reader on `roxmltree`, since only geometries and their places are needed. Format: Khronos, COLLADA 1.4.1
//! specification (2008).

use std::collections::HashMap;

use glam::{DAffine3, DMat3, DVec3};
use roxmltree::Node;

use super::raw::RawMesh;
use super::xml::{
    MAX_ELEMENT_DEPTH, children_named, collect_text, find_child, malformed_at, parse_exactly, problem_at,
    require_attribute, rotation_about,
};
use super::{MeshFileError, MeshFileProblem, quote_word, xml};

mod geometry;

use geometry::Geometry;

/// Reads vertices and triangles in the order in which the scene shows them. Each instance of a geometry is a part.
/// Without a scene, all geometries are read where they are. The unit is that of the file's `<unit>`, else the metre.
pub(super) fn read(bytes: &[u8]) -> Result<RawMesh, MeshFileError> {
    let document = xml::parse(bytes)?;
    let root = document.root_element();
    if root.tag_name().name() != "COLLADA" {
        return Err(malformed_at(root, format!("is no COLLADA: begins with <{}>", root.tag_name().name())));
    }
    let mut library = ElementLibrary { by_id: HashMap::new(), geometries: HashMap::new() };
    for node in root.descendants().filter(Node::is_element) {
        if let Some(id) = node.attribute("id") {
            library.by_id.entry(id).or_insert(node);
        }
    }
    let mut raw = RawMesh { mm_per_unit: Some(1000.0 * read_metres_per_unit(root)?), ..RawMesh::default() };
    let scene = find_child(root, "scene").and_then(|scene| find_child(scene, "instance_visual_scene"));
    let Some(instance) = scene else {
        for list in children_named(root, "library_geometries") {
            for geometry in children_named(list, "geometry") {
                library.add_instance(&mut raw, geometry, &DAffine3::IDENTITY, geometry_name(geometry))?;
                raw.check_growth(bytes.len())?;
            }
        }
        return Ok(raw);
    };
    let scene = library.find_referenced(instance, "url")?;
    let mut waiting: Vec<(Node, DAffine3, usize)> = vec![(scene, DAffine3::IDENTITY, 0)];
    // Nodes may be instanced: a circle of them would never end, and a doubling tower of them nearly never.
    let mut steps = 0;
    while let Some((node, outer, depth)) = waiting.pop() {
        steps += 1;
        if depth > MAX_ELEMENT_DEPTH || steps > 1_000_000 {
            return Err(malformed_at(node, "nodes lie in each other too deep, or in a circle"));
        }
        let place = outer * read_transform(node)?;
        let first = waiting.len();
        for child in node.children().filter(Node::is_element) {
            match child.tag_name().name() {
                "node" => waiting.push((child, place, depth + 1)),
                "instance_node" => waiting.push((library.find_referenced(child, "url")?, place, depth + 1)),
                "instance_geometry" => {
                    let geometry = library.find_referenced(child, "url")?;
                    let name = if node == scene { geometry_name(geometry) } else { geometry_name(node) };
                    library.add_instance(&mut raw, geometry, &place, name)?;
                    raw.check_growth(bytes.len())?;
                }
                "instance_controller" => {
                    let problem = MeshFileProblem::Unsupported("has a skin, whose pose is not read".into());
                    return Err(problem_at(child, problem));
                }
                _ => {}
            }
        }
        // The stack gives back the last one first: reverse the children to keep the order of the file.
        waiting[first..].reverse();
    }
    Ok(raw)
}

/// Reads how many metres a coordinate of 1 is.
fn read_metres_per_unit(root: Node) -> Result<f64, MeshFileError> {
    let Some(unit) = find_child(root, "asset").and_then(|asset| find_child(asset, "unit")) else { return Ok(1.0) };
    let metres: f64 = unit.attribute("meter").map_or(Ok(1.0), |_| xml::parse_attribute(unit, "meter"))?;
    if metres > 0.0 && metres.is_finite() { Ok(metres) } else { Err(malformed_at(unit, "meter is no length above 0")) }
}

fn geometry_name<'a>(node: Node<'a, '_>) -> &'a str {
    node.attribute("name").or_else(|| node.attribute("id")).unwrap_or("geometry")
}

/// Reads the place of a node in its parent: its transforms one after the other.
fn read_transform(node: Node) -> Result<DAffine3, MeshFileError> {
    let mut place = DAffine3::IDENTITY;
    for step in node.children().filter(Node::is_element) {
        let numbers = || collect_text(step);
        place *= match step.tag_name().name() {
            "matrix" => {
                let m: [f64; 16] = parse_exactly(step, &numbers())?;
                // COLLADA writes matrices row by row.
                let column = |k: usize| DVec3::new(m[k], m[4 + k], m[8 + k]);
                DAffine3 { matrix3: DMat3::from_cols(column(0), column(1), column(2)), translation: column(3) }
            }
            "translate" => DAffine3::from_translation(DVec3::from_array(parse_exactly(step, &numbers())?)),
            "scale" => DAffine3::from_scale(DVec3::from_array(parse_exactly(step, &numbers())?)),
            "rotate" => {
                let [x, y, z, degrees] = parse_exactly(step, &numbers())?;
                rotation_about(DVec3::new(x, y, z), degrees)
            }
            odd @ ("skew" | "lookat") => {
                return Err(problem_at(
                    step,
                    MeshFileProblem::Unsupported(format!("has a <{odd}>, which is not read")),
                ));
            }
            _ => continue,
        };
    }
    Ok(place)
}

/// The elements of a file by their ids, and the geometries that were read.
struct ElementLibrary<'a, 'i> {
    by_id: HashMap<&'a str, Node<'a, 'i>>,
    /// Geometries that were read, by the node number of their element.
    geometries: HashMap<usize, Geometry>,
}

impl<'a, 'i: 'a> ElementLibrary<'a, 'i> {
    /// Finds the element that the attribute `key` of `node` refers to as `#id`.
    fn find_referenced(&self, node: Node<'a, 'i>, key: &str) -> Result<Node<'a, 'i>, MeshFileError> {
        let url = require_attribute(node, key)?;
        let Some(id) = url.strip_prefix('#') else {
            let name = quote_word(url.as_bytes());
            return Err(problem_at(node, MeshFileProblem::Unsupported(format!("names another file, {name}"))));
        };
        self.by_id
            .get(id)
            .copied()
            .ok_or_else(|| malformed_at(node, format!("nothing has the id {}", quote_word(id.as_bytes()))))
    }

    fn add_instance(
        &mut self,
        raw: &mut RawMesh,
        geometry: Node<'a, 'i>,
        place: &DAffine3,
        name: &str,
    ) -> Result<(), MeshFileError> {
        let key = geometry.id().get_usize();
        if !self.geometries.contains_key(&key) {
            let read = Geometry::read(geometry, self)?;
            self.geometries.insert(key, read);
        }
        let Geometry { points, triangles } = &self.geometries[&key];
        raw.parts.begin_part(name, raw.triangles.len());
        let first = raw.add_vertices(place, points.iter().copied())?;
        raw.add_triangles(place, first, triangles);
        Ok(())
    }
}

#[cfg(test)]
mod tests;
