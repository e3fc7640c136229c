//! Reads COLLADA 1.4 and 1.5: the polygons of every geometry that the visual scene shows, where its nodes place it.
//!
//! Our own reader on `roxmltree`: of the format only geometries and their places are wanted. Format: Khronos, COLLADA 1.4.1 specification (2008).

use std::collections::HashMap;

use glam::{DAffine3, DMat3, DVec3};
use roxmltree::Node;

use super::raw::Raw;
use super::xml::{DEEPEST, at, attribute, child, children, exactly, text, turn, wrong};
use super::{MeshFileError, MeshFileProblem, quoted, xml};

mod geometry;

use geometry::Geometry;

/// Vertices and triangles in the order in which the scene shows them; each instance of a geometry is a part. Without a scene,
/// the geometries as they are. The unit is that of the file's `<unit>`, else the metre.
pub(super) fn read(bytes: &[u8]) -> Result<Raw, MeshFileError> {
    let document = xml::parse(bytes)?;
    let root = document.root_element();
    if root.tag_name().name() != "COLLADA" {
        return Err(wrong(root, format!("is no COLLADA: begins with <{}>", root.tag_name().name())));
    }
    let mut library = Library { by_id: HashMap::new(), read: HashMap::new() };
    for node in root.descendants().filter(Node::is_element) {
        if let Some(id) = node.attribute("id") {
            library.by_id.entry(id).or_insert(node);
        }
    }
    let mut raw = Raw { mm_per_unit: Some(1000.0 * metres(root)?), ..Raw::default() };
    let scene = child(root, "scene").and_then(|scene| child(scene, "instance_visual_scene"));
    let Some(instance) = scene else {
        for list in children(root, "library_geometries") {
            for geometry in children(list, "geometry") {
                library.add(&mut raw, geometry, &DAffine3::IDENTITY, name(geometry))?;
                raw.check_growth(bytes.len())?;
            }
        }
        return Ok(raw);
    };
    let scene = library.named(instance, "url")?;
    let mut waiting: Vec<(Node, DAffine3, usize)> = vec![(scene, DAffine3::IDENTITY, 0)];
    // Nodes may be instanced: a circle of them would never end, and a tower of them nearly never.
    let mut steps = 0;
    while let Some((node, outer, depth)) = waiting.pop() {
        steps += 1;
        if depth > DEEPEST || steps > 1_000_000 {
            return Err(wrong(node, "nodes lie in each other too deep, or in a circle"));
        }
        let place = outer * place(node)?;
        let first = waiting.len();
        for child in node.children().filter(Node::is_element) {
            match child.tag_name().name() {
                "node" => waiting.push((child, place, depth + 1)),
                "instance_node" => waiting.push((library.named(child, "url")?, place, depth + 1)),
                "instance_geometry" => {
                    let geometry = library.named(child, "url")?;
                    let name = if node == scene { name(geometry) } else { name(node) };
                    library.add(&mut raw, geometry, &place, name)?;
                    raw.check_growth(bytes.len())?;
                }
                "instance_controller" => {
                    let problem = MeshFileProblem::Unsupported("has a skin, whose pose is not read".into());
                    return Err(at(child, problem));
                }
                _ => {}
            }
        }
        waiting[first..].reverse();
    }
    Ok(raw)
}

/// Metres of a coordinate of 1.
fn metres(root: Node) -> Result<f64, MeshFileError> {
    let Some(unit) = child(root, "asset").and_then(|asset| child(asset, "unit")) else { return Ok(1.0) };
    let metres: f64 = unit.attribute("meter").map_or(Ok(1.0), |_| xml::parsed(unit, "meter"))?;
    if metres > 0.0 && metres.is_finite() { Ok(metres) } else { Err(wrong(unit, "meter is no length above 0")) }
}

fn name<'a>(node: Node<'a, '_>) -> &'a str {
    node.attribute("name").or_else(|| node.attribute("id")).unwrap_or("geometry")
}

/// Where a node is in the one that it is in: its transforms one after the other.
fn place(node: Node) -> Result<DAffine3, MeshFileError> {
    let mut place = DAffine3::IDENTITY;
    for step in node.children().filter(Node::is_element) {
        let numbers = || text(step);
        place *= match step.tag_name().name() {
            "matrix" => {
                let m: [f64; 16] = exactly(step, &numbers())?;
                let column = |k: usize| DVec3::new(m[k], m[4 + k], m[8 + k]);
                DAffine3 { matrix3: DMat3::from_cols(column(0), column(1), column(2)), translation: column(3) }
            }
            "translate" => DAffine3::from_translation(DVec3::from_array(exactly(step, &numbers())?)),
            "scale" => DAffine3::from_scale(DVec3::from_array(exactly(step, &numbers())?)),
            "rotate" => {
                let [x, y, z, degrees] = exactly(step, &numbers())?;
                turn(DVec3::new(x, y, z), degrees)
            }
            odd @ ("skew" | "lookat") => {
                return Err(at(step, MeshFileProblem::Unsupported(format!("has a <{odd}>, which is not read"))));
            }
            _ => continue,
        };
    }
    Ok(place)
}

/// What elements refer to.
struct Library<'a, 'i> {
    by_id: HashMap<&'a str, Node<'a, 'i>>,
    /// Geometries that were read, by the number of their element.
    read: HashMap<usize, Geometry>,
}

impl<'a, 'i: 'a> Library<'a, 'i> {
    /// The element that an attribute of this one names, `#id`.
    fn named(&self, node: Node<'a, 'i>, key: &str) -> Result<Node<'a, 'i>, MeshFileError> {
        let url = attribute(node, key)?;
        let Some(id) = url.strip_prefix('#') else {
            let name = quoted(url.as_bytes());
            return Err(at(node, MeshFileProblem::Unsupported(format!("names another file, {name}"))));
        };
        self.by_id.get(id).copied().ok_or_else(|| wrong(node, format!("nothing has the id {}", quoted(id.as_bytes()))))
    }

    fn add(
        &mut self,
        raw: &mut Raw,
        geometry: Node<'a, 'i>,
        place: &DAffine3,
        name: &str,
    ) -> Result<(), MeshFileError> {
        let key = geometry.id().get_usize();
        if !self.read.contains_key(&key) {
            let read = Geometry::read(geometry, self)?;
            self.read.insert(key, read);
        }
        let Geometry { points, triangles } = &self.read[&key];
        raw.parts.begin(name, raw.triangles.len());
        let first = raw.add_vertices(place, points.iter().copied())?;
        raw.add_triangles(place, first, triangles);
        Ok(())
    }
}

#[cfg(test)]
mod tests;
