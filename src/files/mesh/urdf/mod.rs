//! Reads URDF: the shapes of a robot's links at its zero configuration. Meshes are read from their files; boxes,
//! cylinders and spheres become triangles.
//!
//! Our own reader on `roxmltree`, since only shapes and the places of joints are needed. Format: wiki.ros.org/urdf/XML.

use std::collections::HashMap;
use std::path::{Path, PathBuf};

use glam::{DAffine3, DVec3};
use roxmltree::Node;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::packages::FileReference;
use super::raw::RawMesh;
use super::resources::Resources;
use super::words::quote_file_name;
use super::xml::{
    children_named, find_child, line_number, malformed_at, parse_attribute, parse_exactly, problem_at,
    require_attribute, transform_from_rpy,
};
use super::{Format, MeshFileError, MeshFileProblem, MissingFile, MissingFiles, ResourceKind, detect, quote_word, xml};
use crate::number_format::format_count;

mod shapes;

/// Which shapes of a robot's links are read.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum UrdfShapes {
    /// The shapes that are shown.
    #[default]
    Visual,
    /// The shapes that collide.
    Collision,
}

impl UrdfShapes {
    /// Both kinds.
    pub const ALL: [Self; 2] = [Self::Visual, Self::Collision];

    /// Returns the name in a job, which is also that of the XML element.
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

const EXPAND_HELP: &str = "expand it with ROS's program xacro, and name what comes out: xacro IN.xacro > OUT.urdf";

/// Reads vertices and triangles link by link. Each link with a shape is a part. The unit is the metre.
pub(super) fn read(bytes: &[u8], shapes: UrdfShapes, others: &mut Resources) -> Result<RawMesh, MeshFileError> {
    let document = xml::parse(bytes)?;
    let root = document.root_element();
    if root.tag_name().name() != "robot" {
        return Err(malformed_at(root, format!("is no URDF: begins with <{}>", root.tag_name().name())));
    }
    let is_macro = |node: &Node| {
        node.tag_name().namespace().is_some_and(|space| space.contains("xacro"))
            || node.attributes().any(|attribute| attribute.value().contains("${"))
    };
    if let Some(node) = root.descendants().find(is_macro) {
        return Err(problem_at(
            node,
            MeshFileProblem::with_help("is a xacro file, whose macros are not expanded", EXPAND_HELP),
        ));
    }
    // Missing files come first, all of them together: a user fixes them once.
    let links: Vec<Node> = children_named(root, "link").collect();
    let paths = find_mesh_paths(&links, shapes, others)?;
    let places = compute_link_transforms(root, &links)?;
    check_shapes(root, &links, shapes)?;
    let mut raw = RawMesh { mm_per_unit: Some(1000.0), ..RawMesh::default() };
    let mut meshes: HashMap<PathBuf, RawMesh> = HashMap::new();
    let mut size = bytes.len();
    for (link, place) in links.iter().zip(places) {
        raw.parts.begin_part(link.attribute("name").unwrap_or("link"), raw.triangles.len());
        for shape in children_named(*link, shapes.name()) {
            let place = place * read_origin(shape)?;
            let Some(geometry) = find_child(shape, "geometry").and_then(|geometry| geometry.first_element_child())
            else {
                return Err(malformed_at(shape, format!("<{}> has no geometry", shapes.name())));
            };
            match geometry.tag_name().name() {
                "mesh" => {
                    let name = require_attribute(geometry, "filename")?;
                    let Some(path) = paths.get(name) else {
                        let what = format!("names another file, {}", quote_file_name(name));
                        return Err(problem_at(geometry, MeshFileProblem::Unsupported(what)));
                    };
                    if !meshes.contains_key(path) {
                        let wrong = |error| {
                            let error = Box::new(error);
                            problem_at(geometry, MeshFileProblem::InNamedFile { name: quote_file_name(name), error })
                        };
                        let (bytes, mesh) = read_mesh(name, path, others).map_err(wrong)?;
                        size += bytes;
                        meshes.insert(path.clone(), mesh);
                    }
                    let scale = match geometry.attribute("scale") {
                        Some(scale) => DVec3::from_array(parse_exactly(geometry, scale)?),
                        None => DVec3::ONE,
                    };
                    append_shape(&mut raw, &(place * DAffine3::from_scale(scale)), &meshes[path])?;
                }
                "box" => {
                    let size = parse_exactly(geometry, require_attribute(geometry, "size")?)?;
                    append_shape(&mut raw, &place, &shapes::create_box(size))?;
                }
                "cylinder" => {
                    let cylinder = shapes::create_cylinder(
                        parse_attribute(geometry, "radius")?,
                        parse_attribute(geometry, "length")?,
                    );
                    append_shape(&mut raw, &place, &cylinder)?;
                }
                "sphere" => {
                    append_shape(&mut raw, &place, &shapes::create_sphere(parse_attribute(geometry, "radius")?))?
                }
                odd => {
                    let what = format!("has the shape {}, which is not read", quote_word(odd.as_bytes()));
                    return Err(problem_at(geometry, MeshFileProblem::Unsupported(what)));
                }
            }
            raw.check_growth(size)?;
        }
    }
    Ok(raw)
}

/// Computes the place of each link in the root's frame with every joint at zero.
fn compute_link_transforms(root: Node, links: &[Node]) -> Result<Vec<DAffine3>, MeshFileError> {
    let names: HashMap<&str, usize> =
        links.iter().enumerate().filter_map(|(i, link)| Some((link.attribute("name")?, i))).collect();
    // For each link: its parent, its place in the parent's frame, and the joint.
    let mut held: Vec<Option<(usize, DAffine3, Node)>> = vec![None; links.len()];
    for joint in children_named(root, "joint") {
        let [parent, child] = ["parent", "child"].map(|end| {
            let node = find_child(joint, end).ok_or_else(|| malformed_at(joint, format!("<joint> has no {end}")))?;
            let name = require_attribute(node, "link")?;
            let unknown = || malformed_at(node, format!("there is no link {}", quote_word(name.as_bytes())));
            names.get(name).copied().ok_or_else(unknown)
        });
        let (parent, child) = (parent?, child?);
        if held[child].replace((parent, read_origin(joint)?, joint)).is_some() {
            return Err(malformed_at(joint, "its child hangs on another joint, too"));
        }
    }
    // From each link go up to one whose place is known, and compute the places on the way back.
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
                        return Err(malformed_at(joint, "the joints go in a circle"));
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

/// Reads the `<origin>` of an element; without one it is the identity.
fn read_origin(node: Node) -> Result<DAffine3, MeshFileError> {
    let Some(origin) = find_child(node, "origin") else { return Ok(DAffine3::IDENTITY) };
    let three = |key: &str| origin.attribute(key).map_or(Ok([0.0; 3]), |text| parse_exactly(origin, text));
    Ok(transform_from_rpy(three("rpy")?, three("xyz")?))
}

/// Refuses a robot that has no shape of this kind. The help names the other kind if the robot has that.
fn check_shapes(root: Node, links: &[Node], shapes: UrdfShapes) -> Result<(), MeshFileError> {
    let count = |shapes: UrdfShapes| links.iter().flat_map(|link| children_named(*link, shapes.name())).count();
    let (tag, other) = (shapes.name(), shapes.other().name());
    match (count(shapes), count(shapes.other())) {
        (0, 0) => {
            let help = "it holds joints and frames alone: name the robot whose links have <visual> or <collision>";
            Err(problem_at(root, MeshFileProblem::with_help("has no link with a shape", help)))
        }
        (0, others) => {
            let (one, many) = (format!("{other} shape"), format!("{other} shapes"));
            let what = format!("has no {tag} shape, but {}", format_count(others, &one, &many));
            let help = format!("urdf = \"{other}\" under [[object]] takes those (gelsim inspect: --urdf {other})");
            Err(problem_at(root, MeshFileProblem::with_help(what, help)))
        }
        _ => Ok(()),
    }
}

/// Finds the files of the meshes that the links name, by the names as written. A name is left out if no other files are
/// read. The error names all files that do not exist.
fn find_mesh_paths<'a>(
    links: &[Node<'a, '_>],
    shapes: UrdfShapes,
    others: &mut Resources,
) -> Result<HashMap<&'a str, PathBuf>, MeshFileError> {
    let mut paths = HashMap::new();
    let mut files: Vec<MissingFile> = Vec::new();
    let geometries = links
        .iter()
        .flat_map(|link| children_named(*link, shapes.name()))
        .flat_map(|shape| children_named(shape, "geometry"));
    for node in geometries.flat_map(|geometry| children_named(geometry, "mesh")) {
        let name = require_attribute(node, "filename")?;
        if paths.contains_key(name) || files.iter().any(|file| file.name == name) {
            continue;
        }
        let place = FileReference::parse(name);
        if place == FileReference::Macro {
            let what = format!("names {}, which has a macro that is not expanded", quote_file_name(name));
            return Err(problem_at(node, MeshFileProblem::with_help(what, EXPAND_HELP)));
        }
        match others.find_file(&place) {
            None => {}
            Some(Ok(path)) => {
                paths.insert(name, path);
            }
            Some(Err(reason)) => {
                files.push(MissingFile { name: name.to_owned(), line: Some(line_number(node)), reason });
            }
        }
    }
    match files.first().map(|file| file.line) {
        None => Ok(paths),
        Some(line) => {
            let problem = MeshFileProblem::Missing(MissingFiles { what: ResourceKind::Mesh, files });
            Err(MeshFileError { path: None, line, problem })
        }
    }
}

/// Reads the mesh called `name`, in metres. Also returns the number of bytes it was read from.
fn read_mesh(name: &str, path: &Path, others: &mut Resources) -> Result<(usize, RawMesh), MeshFileError> {
    let format = match Format::from_path(path) {
        Some(Format::Urdf) => {
            let help = "name a mesh there: a robot has no other robot in it";
            return Err(MeshFileProblem::with_help("is no mesh, but a robot", help).into());
        }
        Some(format) => format,
        None => {
            let help =
                detect::identify_by_extension(path).map_or("export it as .stl, .obj or .dae", |foreign| foreign.help);
            let help = format!("{help}; write its new name in the robot");
            return Err(MeshFileProblem::with_help("is not named like a mesh", help).into());
        }
    };
    let bytes = others.read_file(name, path)?;
    let (format, mut raw) = others
        .with_base_folder(path, |others| super::read_mesh_bytes(&bytes, format, UrdfShapes::default(), others))?;
    if format == Format::Urdf {
        return Err(MeshFileProblem::with_help("is no mesh, but a robot", "name a mesh there").into());
    }
    // A mesh whose format has no unit is in metres here, as URDF is.
    let metres = raw.mm_per_unit.map_or(1.0, |mm| mm / 1000.0);
    raw.vertices.as_flattened_mut().iter_mut().for_each(|coordinate| *coordinate *= metres);
    Ok((bytes.len(), raw))
}

fn append_shape(raw: &mut RawMesh, place: &DAffine3, shape: &RawMesh) -> Result<(), MeshFileError> {
    let first = raw.add_vertices(place, shape.vertices.iter().copied())?;
    raw.add_triangles(place, first, &shape.triangles);
    Ok(())
}

#[cfg(test)]
mod tests;
