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
use super::packages::Named;
use super::raw::Raw;
use super::words::named;
use super::xml::{at, attribute, child, children, exactly, line, parsed, rolled, wrong};
use super::{Format, MeshFileError, MeshFileProblem, Missing, MissingFile, Wanted, detect, quoted, xml};
use crate::figures::counted;

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
    /// Both of them.
    pub const ALL: [Self; 2] = [Self::Visual, Self::Collision];

    /// As it is written, which is the name of its element, too.
    pub fn name(self) -> &'static str {
        match self {
            Self::Visual => "visual",
            Self::Collision => "collision",
        }
    }

    fn other(self) -> Self {
        match self {
            Self::Visual => Self::Collision,
            Self::Collision => Self::Visual,
        }
    }
}

const EXPAND: &str = "expand it with ROS's program xacro, and name what comes out: xacro IN.xacro > OUT.urdf";

/// Vertices and triangles link by link; each link with a shape is a part. The unit is the metre.
pub(super) fn read(bytes: &[u8], shapes: UrdfShapes, others: &mut Others) -> Result<Raw, MeshFileError> {
    let document = xml::parse(bytes)?;
    let root = document.root_element();
    if root.tag_name().name() != "robot" {
        return Err(wrong(root, format!("is no URDF: begins with <{}>", root.tag_name().name())));
    }
    let is_macro = |node: &Node| {
        node.tag_name().namespace().is_some_and(|space| space.contains("xacro"))
            || node.attributes().any(|attribute| attribute.value().contains("${"))
    };
    if let Some(node) = root.descendants().find(is_macro) {
        return Err(at(node, MeshFileProblem::advised("is a xacro file, whose macros are not expanded", EXPAND)));
    }
    let links: Vec<Node> = children(root, "link").collect();
    let paths = mesh_paths(&links, shapes, others)?;
    let places = places(root, &links)?;
    check_shapes(root, &links, shapes)?;
    let mut raw = Raw { mm_per_unit: Some(1000.0), ..Raw::default() };
    let mut meshes: HashMap<PathBuf, Raw> = HashMap::new();
    let mut size = bytes.len();
    for (link, place) in links.iter().zip(places) {
        raw.parts.begin(link.attribute("name").unwrap_or("link"), raw.triangles.len());
        for shape in children(*link, shapes.name()) {
            let place = place * origin(shape)?;
            let Some(geometry) = child(shape, "geometry").and_then(|geometry| geometry.first_element_child()) else {
                return Err(wrong(shape, format!("<{}> has no geometry", shapes.name())));
            };
            match geometry.tag_name().name() {
                "mesh" => {
                    let name = attribute(geometry, "filename")?;
                    let Some(path) = paths.get(name) else {
                        let what = format!("names another file, {}", named(name));
                        return Err(at(geometry, MeshFileProblem::Unsupported(what)));
                    };
                    if !meshes.contains_key(path) {
                        let wrong = |error| {
                            let error = Box::new(error);
                            at(geometry, MeshFileProblem::Named { name: named(name), error })
                        };
                        let (bytes, mesh) = mesh(name, path, others).map_err(wrong)?;
                        size += bytes;
                        meshes.insert(path.clone(), mesh);
                    }
                    let scale = match geometry.attribute("scale") {
                        Some(scale) => DVec3::from_array(exactly(geometry, scale)?),
                        None => DVec3::ONE,
                    };
                    append(&mut raw, &(place * DAffine3::from_scale(scale)), &meshes[path])?;
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

/// Refuses a robot without a shape of this kind.
fn check_shapes(root: Node, links: &[Node], shapes: UrdfShapes) -> Result<(), MeshFileError> {
    let count = |shapes: UrdfShapes| links.iter().flat_map(|link| children(*link, shapes.name())).count();
    let (tag, other) = (shapes.name(), shapes.other().name());
    match (count(shapes), count(shapes.other())) {
        (0, 0) => {
            let help = "it holds joints and frames alone: name the robot whose links have <visual> or <collision>";
            Err(at(root, MeshFileProblem::advised("has no link with a shape", help)))
        }
        (0, others) => {
            let (one, many) = (format!("{other} shape"), format!("{other} shapes"));
            let what = format!("has no {tag} shape, but {}", counted(others, &one, &many));
            let help = format!("urdf = \"{other}\" under [[object]] takes those (gelsim inspect: --urdf {other})");
            Err(at(root, MeshFileProblem::advised(what, help)))
        }
        _ => Ok(()),
    }
}

/// Where the meshes are that the links name, by the names that are written; none where no other file is read. An error tells all
/// that are not there.
fn mesh_paths<'a>(
    links: &[Node<'a, '_>],
    shapes: UrdfShapes,
    others: &mut Others,
) -> Result<HashMap<&'a str, PathBuf>, MeshFileError> {
    let mut paths = HashMap::new();
    let mut files: Vec<MissingFile> = Vec::new();
    let geometries =
        links.iter().flat_map(|link| children(*link, shapes.name())).flat_map(|shape| children(shape, "geometry"));
    for node in geometries.flat_map(|geometry| children(geometry, "mesh")) {
        let name = attribute(node, "filename")?;
        if paths.contains_key(name) || files.iter().any(|file| file.name == name) {
            continue;
        }
        let place = Named::new(name);
        if place == Named::Macro {
            let what = format!("names {}, which has a macro that is not expanded", named(name));
            return Err(at(node, MeshFileProblem::advised(what, EXPAND)));
        }
        match others.find(&place) {
            None => {}
            Some(Ok(path)) => {
                paths.insert(name, path);
            }
            Some(Err(reason)) => {
                files.push(MissingFile { name: name.to_owned(), line: Some(line(node)), reason });
            }
        }
    }
    match files.first().map(|file| file.line) {
        None => Ok(paths),
        Some(line) => {
            let problem = MeshFileProblem::Missing(Missing { what: Wanted::Mesh, files });
            Err(MeshFileError { path: None, line, problem })
        }
    }
}

/// The mesh that is written as `name`, in metres, and how many bytes it was read from.
fn mesh(name: &str, path: &Path, others: &mut Others) -> Result<(usize, Raw), MeshFileError> {
    let format = match Format::from_path(path) {
        Some(Format::Urdf) => {
            let help = "name a mesh there: a robot has no other robot in it";
            return Err(MeshFileProblem::advised("is no mesh, but a robot", help).into());
        }
        Some(format) => format,
        None => {
            let help = detect::by_ending(path).map_or("export it as .stl, .obj or .dae", |foreign| foreign.help);
            let help = format!("{help}; write its new name in the robot");
            return Err(MeshFileProblem::advised("is not named like a mesh", help).into());
        }
    };
    let bytes = others.read(name, path)?;
    let (format, mut raw) = others.within(path, |others| super::read(&bytes, format, UrdfShapes::default(), others))?;
    if format == Format::Urdf {
        return Err(MeshFileProblem::advised("is no mesh, but a robot", "name a mesh there").into());
    }
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
