//! Reads 3MF: the objects of the build where it places them, from XML in a ZIP file.
//!
//! Our own reader on `roxmltree` and the ZIP reader of `npz` files. Format: 3MF Consortium, Core Specification 1.3
//! (2021) and Production Extension 1.1, which puts objects into further files of the archive.

use std::collections::HashMap;

use glam::{DAffine3, DMat3, DVec3};
use roxmltree::{Document, Node};

use super::raw::RawMesh;
use super::xml::{
    self, MAX_ELEMENT_DEPTH, children_named, find_child, malformed_at, parse_attribute, parse_exactly, problem_at,
    require_attribute,
};
use super::{MeshFileError, MeshFileProblem, quote_word};
use crate::zip::ZipArchive;
use gelsim_core::mesh::MeshError;

/// Extensions that a file may require: those about places of objects and about appearance.
const SUPPORTED_EXTENSIONS: [&str; 4] = [
    "http://schemas.microsoft.com/3dmanufacturing/production/",
    "http://schemas.microsoft.com/3dmanufacturing/material/",
    "http://schemas.microsoft.com/3dmanufacturing/securecontent/",
    "http://schemas.bambulab.com/",
];

/// The main model of an archive that does not name it.
const DEFAULT_MODEL_PATH: &str = "3D/3dmodel.model";

/// Reads vertices and triangles in the order of the build. Each item of the build is a part.
pub(super) fn read(bytes: &[u8]) -> Result<RawMesh, MeshFileError> {
    let damaged = |reason: String| MeshFileError::from(MeshFileProblem::Malformed(reason));
    let zip = ZipArchive::open(bytes.to_vec()).map_err(damaged)?;
    let main = find_main_model(&zip)?;
    // Read every model of the archive, so that references to another model are found.
    let mut names: Vec<&str> = zip.names().filter(|name| name.ends_with(".model") && *name != main).collect();
    names.insert(0, &main);
    let mut texts = Vec::new();
    for name in names {
        let text =
            zip.unpack_member(name, 1).unwrap_or_else(|| Err(format!("it has no {}", quote_word(name.as_bytes()))));
        texts.push((name, text.map_err(|reason| damaged(format!("{}: {reason}", quote_word(name.as_bytes()))))?));
    }
    let in_model = |name: &str, error: MeshFileError| match error.line {
        // The line is that of a file inside the archive, so it goes into the message.
        Some(line) => damaged(format!("{} line {line}: {}", quote_word(name.as_bytes()), error.problem)),
        None => error,
    };
    let documents = texts
        .iter()
        .map(|(name, text)| Ok((*name, xml::parse(text).map_err(|error| in_model(name, error))?)))
        .collect::<Result<Vec<_>, MeshFileError>>()?;
    let mut build = MeshBuilder { models: Vec::new(), raw: RawMesh::default(), bytes: bytes.len(), steps: 0 };
    for (name, document) in &documents {
        build.models.push(Model::new(name, document).map_err(|error| in_model(name, error))?);
    }
    let root = documents[0].1.root_element();
    build.add_items(root).map_err(|error| in_model(&main, error))?;
    build.raw.mm_per_unit = Some(read_mm_per_unit(root).map_err(|error| in_model(&main, error))?);
    Ok(build.raw)
}

/// Finds the name of the archive's main model.
fn find_main_model(zip: &ZipArchive) -> Result<String, MeshFileError> {
    let Some(Ok(relations)) = zip.unpack_member("_rels/.rels", 1) else { return Ok(DEFAULT_MODEL_PATH.into()) };
    let document = xml::parse(&relations)?;
    let mut relations = document.root_element().children().filter(Node::is_element);
    let model = relations.find(|node| node.attribute("Type").is_some_and(|kind| kind.ends_with("/3dmodel")));
    let target = model.and_then(|model| model.attribute("Target"));
    Ok(target.map_or(DEFAULT_MODEL_PATH, |target| target.trim_start_matches('/')).to_owned())
}

/// Reads how many millimetres a coordinate of 1 is.
fn read_mm_per_unit(root: Node) -> Result<f64, MeshFileError> {
    Ok(match root.attribute("unit").unwrap_or("millimeter") {
        "micron" => 0.001,
        "millimeter" => 1.0,
        "centimeter" => 10.0,
        "inch" => 25.4,
        "foot" => 304.8,
        "meter" => 1000.0,
        odd => return Err(malformed_at(root, format!("unit {} is none of 3MF", quote_word(odd.as_bytes())))),
    })
}

/// One model file of the archive with its objects.
struct Model<'a> {
    name: &'a str,
    objects: HashMap<&'a str, Node<'a, 'a>>,
}

impl<'a> Model<'a> {
    fn new(name: &'a str, document: &'a Document) -> Result<Self, MeshFileError> {
        let root = document.root_element();
        if root.tag_name().name() != "model" {
            return Err(malformed_at(root, format!("is no 3MF: begins with <{}>", root.tag_name().name())));
        }
        for prefix in root.attribute("requiredextensions").unwrap_or_default().split_ascii_whitespace() {
            let space = root.lookup_namespace_uri(Some(prefix)).unwrap_or(prefix);
            if !SUPPORTED_EXTENSIONS.iter().any(|known| space.starts_with(known)) {
                let what = format!("requires the extension {}, which is not read", quote_word(space.as_bytes()));
                return Err(problem_at(root, MeshFileProblem::Unsupported(what)));
            }
        }
        let objects =
            find_child(root, "resources").into_iter().flat_map(|resources| children_named(resources, "object"));
        Ok(Self { name, objects: objects.filter_map(|object| Some((object.attribute("id")?, object))).collect() })
    }
}

struct MeshBuilder<'a> {
    models: Vec<Model<'a>>,
    raw: RawMesh,
    bytes: usize,
    steps: usize,
}

impl<'a> MeshBuilder<'a> {
    fn add_items(&mut self, root: Node<'a, 'a>) -> Result<(), MeshFileError> {
        for item in find_child(root, "build").into_iter().flat_map(|build| children_named(build, "item")) {
            let (model, object) = self.find_object(0, item)?;
            let name = object.attribute("name").or_else(|| object.attribute("id")).unwrap_or("object");
            self.raw.parts.begin_part(name, self.raw.triangles.len());
            self.add_object(model, object, read_transform(item)?, 0)?;
        }
        Ok(())
    }

    /// Finds the object to which an item or a component refers, and the index of the model that it is in.
    fn find_object(&self, model: usize, node: Node<'a, 'a>) -> Result<(usize, Node<'a, 'a>), MeshFileError> {
        let id = require_attribute(node, "objectid")?;
        let path = node.attributes().find(|attribute| attribute.name() == "path" && attribute.namespace().is_some());
        let found = match path {
            None => Some(model),
            Some(path) => self.models.iter().position(|model| model.name == path.value().trim_start_matches('/')),
        };
        found
            .and_then(|model| Some((model, *self.models[model].objects.get(id)?)))
            .ok_or_else(|| malformed_at(node, format!("there is no object {}", quote_word(id.as_bytes()))))
    }

    fn add_object(
        &mut self,
        model: usize,
        object: Node<'a, 'a>,
        place: DAffine3,
        depth: usize,
    ) -> Result<(), MeshFileError> {
        self.steps += 1;
        // Components may refer to objects that contain them, or double their number with each level.
        if depth > MAX_ELEMENT_DEPTH.min(64) || self.steps > 1_000_000 {
            return Err(malformed_at(object, "objects lie in each other too deep, or in a circle"));
        }
        if let Some(mesh) = find_child(object, "mesh") {
            self.add_mesh(mesh, &place)?;
        }
        for component in find_child(object, "components").into_iter().flat_map(|list| children_named(list, "component"))
        {
            let (model, object) = self.find_object(model, component)?;
            self.add_object(model, object, place * self::read_transform(component)?, depth + 1)?;
        }
        Ok(())
    }

    fn add_mesh(&mut self, mesh: Node<'a, 'a>, place: &DAffine3) -> Result<(), MeshFileError> {
        let mut points = Vec::new();
        for vertex in find_child(mesh, "vertices").into_iter().flat_map(|list| children_named(list, "vertex")) {
            points.push([parse_attribute(vertex, "x")?, parse_attribute(vertex, "y")?, parse_attribute(vertex, "z")?]);
        }
        let mut triangles = Vec::new();
        for triangle in find_child(mesh, "triangles").into_iter().flat_map(|list| children_named(list, "triangle")) {
            let mut corners = [0; 3];
            for (corner, key) in corners.iter_mut().zip(["v1", "v2", "v3"]) {
                let index: i64 = parse_attribute(triangle, key)?;
                let count = points.len();
                *corner = u32::try_from(index).ok().filter(|index| (*index as usize) < count).ok_or_else(|| {
                    problem_at(triangle, MeshError::NoSuchVertex { index, count, note: " in this object" }.into())
                })?;
            }
            triangles.push(corners);
        }
        let first = self.raw.add_vertices(place, points.into_iter())?;
        self.raw.add_triangles(place, first, &triangles);
        self.raw.check_growth(self.bytes)
    }
}

/// Reads the place of an item or a component: four rows of x, y and z, which are the images of the three axes and of
/// the origin.
fn read_transform(node: Node) -> Result<DAffine3, MeshFileError> {
    let Some(text) = node.attribute("transform") else { return Ok(DAffine3::IDENTITY) };
    let m: [f64; 12] = parse_exactly(node, text)?;
    let row = |k: usize| DVec3::new(m[3 * k], m[3 * k + 1], m[3 * k + 2]);
    Ok(DAffine3 { matrix3: DMat3::from_cols(row(0), row(1), row(2)), translation: row(3) })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::mesh::tests::{CORNERS, cube_model};
    use crate::zip::encode_stored;

    fn edited(from: &str, to: &str) -> String {
        let text = cube_model();
        assert_eq!(text.matches(from).count(), 1, "{from}");
        text.replace(from, to)
    }

    fn read_model(text: &str) -> Result<RawMesh, String> {
        read(&encode_stored(&[("3D/3dmodel.model", text.as_bytes())])).map_err(|error| error.to_string())
    }

    #[test]
    fn items_and_components_are_placed() {
        let object = r#"<object id="2"><components><component objectid="1" transform="0 1 0 -1 0 0 0 0 1 10 0 0"/></components></object></resources>"#;
        let text = edited("</resources>", object)
            .replace("<item objectid=\"1\"/>", "<item objectid=\"2\" transform=\"2 0 0 0 2 0 0 0 2 0 0 1\"/>");
        let raw = read_model(&text).unwrap();
        let [x, y, z] = CORNERS[6].map(f64::from);
        assert_eq!(raw.vertices[6], [2.0 * (10.0 - y), 2.0 * x, 2.0 * z + 1.0]);
        assert_eq!(raw.mm_per_unit, Some(25.4));
    }

    #[test]
    fn objects_may_be_in_another_file_of_the_archive() {
        let main = r#"<model xmlns:p="http://schemas.microsoft.com/3dmanufacturing/production/2015/06" requiredextensions="p">
            <resources><object id="7"><components><component objectid="1" p:path="/3D/Objects/a.model"/></components></object></resources>
            <build><item objectid="7"/></build></model>"#;
        let rels = r#"<Relationships><Relationship Target="/3D/top.model" Type="http://schemas.microsoft.com/3dmanufacturing/2013/01/3dmodel"/></Relationships>"#;
        let archive = encode_stored(&[
            ("3D/Objects/a.model", cube_model().as_bytes()),
            ("3D/top.model", main.as_bytes()),
            ("_rels/.rels", rels.as_bytes()),
        ]);
        let raw = read(&archive).unwrap_or_else(|error| panic!("{error}"));
        assert_eq!((raw.triangles.len(), raw.mm_per_unit), (12, Some(1.0)));
    }

    #[test]
    fn what_is_wrong_is_said_with_its_line_in_the_model() {
        for (text, expected) in [
            (edited("unit=\"inch\"", "unit=\"mile\""), "`3D/3dmodel.model` line 2: unit `mile` is none of 3MF"),
            (
                edited("item objectid=\"1\"", "item objectid=\"2\""),
                "`3D/3dmodel.model` line 26: there is no object `2`",
            ),
            (
                edited("v1=\"0\" v2=\"3\" v3=\"2\"", "v1=\"0\" v2=\"8\" v3=\"2\""),
                "`3D/3dmodel.model` line 13: face refers to vertex 8, but the file has 8 in this object",
            ),
            (
                edited("unit=\"inch\"", "requiredextensions=\"b\" xmlns:b=\"http://beams\""),
                "`3D/3dmodel.model` line 2: requires the extension `http://beams`, which is not read",
            ),
            (
                edited("</mesh></object>", "</mesh><components><component objectid=\"1\"/></components></object>"),
                "`3D/3dmodel.model` line 3: objects lie in each other too deep, or in a circle",
            ),
        ] {
            assert_eq!(read_model(&text).expect_err("a mistake"), expected);
        }
        assert_eq!(read(b"PK").err().unwrap().to_string(), "it is not a ZIP archive, or it is cut off");
        let empty = read(&encode_stored(&[])).err().unwrap().to_string();
        assert_eq!(empty, "`3D/3dmodel.model`: it has no `3D/3dmodel.model`");
    }
}
