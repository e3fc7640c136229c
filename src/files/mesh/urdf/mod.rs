//! Reads URDF: the shapes of a robot's links, at its zero configuration. Meshes are read from their files; boxes, cylinders
//! and spheres become triangles.
//!
//! Our own reader on `roxmltree`: of the format only shapes and the places of joints are wanted. Format:
//! wiki.ros.org/urdf/XML.

use std::collections::HashMap;
use std::path::{Path, PathBuf};

use glam::{DAffine3, DVec3};
use roxmltree::Node;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::others::Others;
use super::raw::Raw;
use super::xml::{at, attribute, child, children, exactly, parsed, rolled, wrong};
use super::{Format, MeshFileError, MeshFileProblem, quoted, xml};

mod shapes;

/// Which shapes of a robot's links are meant.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum UrdfShapes {
    /// Those that are shown.
    #[default]
    Visual,
    /// Those that collide.
    Collision,
}

impl UrdfShapes {
    fn tag(self) -> &'static str {
        match self {
            Self::Visual => "visual",
            Self::Collision => "collision",
        }
    }
}

/// Vertices and triangles link by link; each link with a shape is a part. The unit is the metre.
pub(super) fn read(bytes: &[u8], shapes: UrdfShapes, others: &mut Others) -> Result<Raw, MeshFileError> {
    let document = xml::parse(bytes)?;
    let root = document.root_element();
    if root.tag_name().name() != "robot" {
        return Err(wrong(root, format!("is no URDF: begins with <{}>", root.tag_name().name())));
    }
    let is_macro = |node: &Node| node.tag_name().namespace().is_some_and(|space| space.contains("xacro"));
    if let Some(node) = root.descendants().find(is_macro) {
        return Err(at(node, MeshFileProblem::Unsupported("has macros: expand them with the program xacro".into())));
    }
    let links: Vec<Node> = children(root, "link").collect();
    let places = places(root, &links)?;
    let mut raw = Raw { mm_per_unit: Some(1000.0), ..Raw::default() };
    let mut meshes: HashMap<PathBuf, Raw> = HashMap::new();
    let mut size = bytes.len();
    for (link, place) in links.iter().zip(places) {
        raw.parts.begin(link.attribute("name").unwrap_or("link"), raw.triangles.len());
        for shape in children(*link, shapes.tag()) {
            let place = place * origin(shape)?;
            let Some(geometry) = child(shape, "geometry").and_then(|geometry| geometry.first_element_child()) else {
                return Err(wrong(shape, format!("<{}> has no geometry", shapes.tag())));
            };
            match geometry.tag_name().name() {
                "mesh" => {
                    let (path, name) = (mesh_path(geometry, others)?, attribute(geometry, "filename")?);
                    if !meshes.contains_key(&path) {
                        let (bytes, mesh) = mesh(geometry, name, &path, others)?;
                        size += bytes;
                        meshes.insert(path.clone(), mesh);
                    }
                    let scale = match geometry.attribute("scale") {
                        Some(scale) => DVec3::from_array(exactly(geometry, scale)?),
                        None => DVec3::ONE,
                    };
                    append(&mut raw, &(place * DAffine3::from_scale(scale)), &meshes[&path])?;
                }
                "box" => {
                    let size = exactly(geometry, attribute(geometry, "size")?)?;
                    append(&mut raw, &place, &shapes::block(size))?;
                }
                "cylinder" => {
                    let cylinder = shapes::cylinder(parsed(geometry, "radius")?, parsed(geometry, "length")?);
                    append(&mut raw, &place, &cylinder)?;
                }
                "sphere" => append(&mut raw, &place, &shapes::sphere(parsed(geometry, "radius")?))?,
                odd => {
                    let what = format!("has the shape {}, which is not read", quoted(odd.as_bytes()));
                    return Err(at(geometry, MeshFileProblem::Unsupported(what)));
                }
            }
            raw.check_growth(size)?;
        }
    }
    Ok(raw)
}

/// Where each link is in the root's frame, with every joint at zero.
fn places(root: Node, links: &[Node]) -> Result<Vec<DAffine3>, MeshFileError> {
    let names: HashMap<&str, usize> =
        links.iter().enumerate().filter_map(|(i, link)| Some((link.attribute("name")?, i))).collect();
    // Of each link: the one it hangs on, and where.
    let mut held: Vec<Option<(usize, DAffine3, Node)>> = vec![None; links.len()];
    for joint in children(root, "joint") {
        let [parent, child] = ["parent", "child"].map(|end| {
            let node = child(joint, end).ok_or_else(|| wrong(joint, format!("<joint> has no {end}")))?;
            let name = attribute(node, "link")?;
            let unknown = || wrong(node, format!("there is no link {}", quoted(name.as_bytes())));
            names.get(name).copied().ok_or_else(unknown)
        });
        let (parent, child) = (parent?, child?);
        if held[child].replace((parent, origin(joint)?, joint)).is_some() {
            return Err(wrong(joint, "its child hangs on another joint, too"));
        }
    }
    // Link by link towards the root, and back.
    let mut places: Vec<Option<DAffine3>> = vec![None; links.len()];
    for link in 0..links.len() {
        let mut way = Vec::new();
        let mut next = link;
        let mut place = loop {
            match (places[next], held[next]) {
                (Some(place), _) => break place,
                (None, None) => break DAffine3::IDENTITY,
                (None, Some((parent, at, joint))) => {
                    way.push((next, at));
                    if way.len() > links.len() {
                        return Err(wrong(joint, "the joints go in a circle"));
                    }
                    next = parent;
                }
            }
        };
        for (number, at) in way.into_iter().rev() {
            place *= at;
            places[number] = Some(place);
        }
        places[link].get_or_insert(place);
    }
    Ok(places.into_iter().flatten().collect())
}

/// The `<origin>` in an element.
fn origin(node: Node) -> Result<DAffine3, MeshFileError> {
    let Some(origin) = child(node, "origin") else { return Ok(DAffine3::IDENTITY) };
    let three = |key: &str| origin.attribute(key).map_or(Ok([0.0; 3]), |text| exactly(origin, text));
    Ok(rolled(three("rpy")?, three("xyz")?))
}

/// The path of the file that a `<mesh>` names: beside the robot, or in a package, whose folder is this one or above it.
fn mesh_path(node: Node, others: &Others) -> Result<PathBuf, MeshFileError> {
    let name = attribute(node, "filename")?;
    let Some(folder) = others.folder() else {
        let what = format!("names another file, {}", quoted(name.as_bytes()));
        return Err(at(node, MeshFileProblem::Unsupported(what)));
    };
    if let Some(path) = name.strip_prefix("file://") {
        return Ok(folder.join(path));
    }
    let Some(in_package) = ["package://", "model://"].iter().find_map(|scheme| name.strip_prefix(scheme)) else {
        if name.contains("://") {
            let what = format!("names {}, which is no file", quoted(name.as_bytes()));
            return Err(at(node, MeshFileProblem::Unsupported(what)));
        }
        return Ok(folder.join(name));
    };
    let package = in_package.split('/').next().unwrap_or_default();
    let rest = &in_package[package.len()..];
    let absolute = std::path::absolute(folder).unwrap_or_else(|_| folder.to_owned());
    let mut found = absolute.ancestors().flat_map(|above| {
        let own = (above.file_name() == Some(package.as_ref())).then(|| above.to_owned());
        own.into_iter().chain([above.join(package)])
    });
    match found.find(|package| package.is_dir()) {
        Some(package) => Ok(package.join(rest.trim_start_matches('/'))),
        None => {
            let what = format!("no folder here or above is called {}, as the package", quoted(package.as_bytes()));
            Err(wrong(node, what))
        }
    }
}

/// The mesh of a `<mesh>`, in metres, and how many bytes it was read from.
fn mesh(node: Node, name: &str, path: &Path, others: &mut Others) -> Result<(usize, Raw), MeshFileError> {
    let format = match Format::from_path(path) {
        Some(format) if format != Format::Urdf => format,
        _ => {
            let what = format!("names {}, which is no mesh that is read", quoted(name.as_bytes()));
            return Err(at(node, MeshFileProblem::Unsupported(what)));
        }
    };
    let bytes = others.read(name, path)?;
    let raw = others.within(path, |others| super::read(&bytes, format, UrdfShapes::default(), others));
    let mut raw = raw.map_err(|error| error.in_file(path))?;
    // What knows no unit is in metres here.
    let metres = raw.mm_per_unit.map_or(1.0, |mm| mm / 1000.0);
    raw.vertices.as_flattened_mut().iter_mut().for_each(|coordinate| *coordinate *= metres);
    Ok((bytes.len(), raw))
}

fn append(raw: &mut Raw, place: &DAffine3, shape: &Raw) -> Result<(), MeshFileError> {
    let first = raw.add_vertices(place, shape.vertices.iter().copied())?;
    raw.add_triangles(place, first, &shape.triangles);
    Ok(())
}

#[cfg(test)]
mod tests;
