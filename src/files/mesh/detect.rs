//! Detects what a file is by its bytes, whatever its name says.
//!
//! A binary STL may begin with any bytes. It is known by its length, which is checked before all else. The statements
//! of an OBJ have no mark of their own: a file named as one is an OBJ unless it begins as another format does.

use std::path::Path;

use super::{Format, WordReader, obj, off, stl};
use crate::foreign::{self, EXPORT_FROM_BLENDER, EXPORT_USD, ForeignFile, UNPACK_ARCHIVE};
use crate::zip;

/// What a file is.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum Detected {
    /// A mesh of this format.
    Mesh(Format),
    /// Something else.
    Foreign(ForeignFile),
}

use Detected::Mesh;

const CAD_HELP: &str = "open it in a CAD program, such as FreeCAD, and export it as .stl or .3mf";
const MESHES_IN_IT: &str =
    "name the meshes that it refers to, each by path = \"FILE\" or all by path = \"FOLDER/*.stl\"";
const XACRO_HELP: &str = "expand it, and name what comes out: xacro IN.xacro > OUT.urdf";
const POINTS_HELP: &str =
    "it holds points: reconstruct a surface, e.g. in CloudCompare or MeshLab, and export it as .ply or .stl";
const SOLVER_HELP: &str = "take its surface, e.g. in ParaView: Extract Surface, then File > Save Data as .stl or .ply";
const PICTURE_HELP: &str = "a height map is a grey .png, or an .npy, .npz or .exr";

/// Other formats: the extensions of their files, what they are, and what to do.
const OTHER_EXTENSIONS: &[(&[&str], &str, &str)] = &[
    (&["fbx"], "an FBX file, which is not read", EXPORT_FROM_BLENDER),
    (&["blend"], "a Blender file, which is not read", EXPORT_FROM_BLENDER),
    (&["usd", "usda", "usdc", "usdz"], "a USD file, which is not read", EXPORT_USD),
    (
        &["3ds", "max", "ma", "mb", "c4d", "lwo", "abc", "x3d", "wrl", "x", "ztl"],
        "a scene, which is not read",
        EXPORT_FROM_BLENDER,
    ),
    (&["step", "stp", "iges", "igs"], "a CAD model, which is not read", CAD_HELP),
    (
        &[
            "sldprt",
            "sldasm",
            "ipt",
            "iam",
            "catpart",
            "catproduct",
            "prt",
            "asm",
            "par",
            "f3d",
            "3dm",
            "sat",
            "x_t",
            "x_b",
            "jt",
            "brep",
            "fcstd",
            "scad",
            "skp",
            "dwg",
            "dxf",
        ],
        "a CAD model, which is not read",
        CAD_HELP,
    ),
    (&["sdf", "world"], "an SDF file, which is not read", MESHES_IN_IT),
    (&["mjcf", "xml", "mjb"], "a model of MuJoCo, which is not read", MESHES_IN_IT),
    (&["xacro"], "a xacro file, whose macros are not expanded", XACRO_HELP),
    (&["srdf"], "an SRDF file, which holds no shapes", "name the robot's .urdf"),
    (&["mtl"], "a table of materials, which belongs to an OBJ", "name the .obj that goes with it"),
    (&["bin"], "a buffer, which belongs to a glTF", "name the .gltf that goes with it"),
    (&["pcd", "las", "laz", "e57", "xyz", "pts", "splat", "spz"], "a point cloud, which is not read", POINTS_HELP),
    (
        &["msh", "vtk", "vtu", "vtp", "inp", "bdf", "nas", "med", "exo"],
        "a solver's mesh, which is not read",
        SOLVER_HELP,
    ),
    (&["drc"], "a mesh packed by Draco", "unpack it: draco_decoder -i IN.drc -o OUT.obj"),
    (&["amf", "gcode"], "a printer's file, which is not read", "export it as .3mf or .stl from the slicer"),
    (&["zip", "gz", "tgz", "tar", "bz2", "xz", "7z", "rar", "zst"], "an archive", UNPACK_ARCHIVE),
    (&["jpg", "jpeg", "bmp", "gif", "tif", "tiff", "webp", "svg"], "a picture", PICTURE_HELP),
];

/// The first bytes of files of other formats, what they are, and what to do.
const SIGNATURES: &[(&[u8], &str, &str)] = &[
    (b"; FBX", "an FBX file, which is not read", EXPORT_FROM_BLENDER),
    (b"PXR-USDC", "a USD file, which is not read", EXPORT_USD),
    (b"#usda", "a USD file, which is not read", EXPORT_USD),
    (b"#VRML", "a VRML scene, which is not read", EXPORT_FROM_BLENDER),
    (b"xof 0", "a scene of DirectX, which is not read", EXPORT_FROM_BLENDER),
    (b"//Maya", "a scene of Maya, which is not read", EXPORT_FROM_BLENDER),
    (b"DBRep", "a BREP of OpenCASCADE, which is not read", CAD_HELP),
    (b"CASCADE Topology", "a BREP of OpenCASCADE, which is not read", CAD_HELP),
    (b"3D Geometry File Format", "a Rhino file, which is not read", CAD_HELP),
    (b"\xd0\xcf\x11\xe0\xa1\xb1\x1a\xe1", "a CAD part or an Office document, which is not read", CAD_HELP),
    (b"# .PCD", "a point cloud, which is not read", POINTS_HELP),
    (b"LASF", "a point cloud, which is not read", POINTS_HELP),
    (b"ASTM-E57", "a point cloud, which is not read", POINTS_HELP),
    (b"# vtk DataFile", "a solver's mesh, which is not read", SOLVER_HELP),
    (b"$MeshFormat", "a solver's mesh, which is not read", SOLVER_HELP),
    (b"MeshVersionFormatted", "a solver's mesh, which is not read", SOLVER_HELP),
    (b"DRACO", "a mesh packed by Draco", "unpack it: draco_decoder -i IN.drc -o OUT.obj"),
    (b"newmtl ", "a table of materials, which belongs to an OBJ", "name the .obj that goes with it"),
];

/// Outermost elements of XML documents of other formats, what they are, and what to do.
const XML_ROOTS: &[(&str, &str, &str)] = &[
    ("sdf", "an SDF file, which is not read", MESHES_IN_IT),
    ("mujoco", "a model of MuJoCo, which is not read", MESHES_IN_IT),
    ("mujocoinclude", "a model of MuJoCo, which is not read", MESHES_IN_IT),
    ("X3D", "an X3D scene, which is not read", EXPORT_FROM_BLENDER),
    ("amf", "a printer's file, which is not read", "export it as .3mf or .stl from the slicer"),
    ("VTKFile", "a solver's mesh, which is not read", SOLVER_HELP),
    ("model", "the model inside a 3MF", "name the .3mf that it was in"),
    ("svg", "a drawing (SVG)", "extrude it in a CAD program, and export it as .stl or .3mf"),
    ("html", "a web page (HTML)", "download the file itself: the page says why it did not come"),
    ("Error", "a server's answer, not the file itself", "download it again: the answer says why it did not come"),
];

/// Says what a file with this extension is, if it is one of another format.
pub(super) fn identify_by_extension(path: &Path) -> Option<ForeignFile> {
    let ending = path.extension()?.to_str()?.to_ascii_lowercase();
    let (_, what, help) = OTHER_EXTENSIONS.iter().find(|(endings, ..)| endings.contains(&ending.as_str()))?;
    Some(ForeignFile { what, help })
}

/// Detects what a file is that is named as one of `format` and is not. Returns `None` if it may be one, or if the kind
/// is unknown.
pub(super) fn detect_mismatch(format: Format, bytes: &[u8]) -> Option<Detected> {
    let may_be = match format {
        // Any JSON may be meant as glTF: the reader then says what is missing.
        Format::Gltf => WordReader::new(bytes).next_word_any_line().is_some_and(|word| word.starts_with(b"{")),
        // An archive that is cut off has no list of members.
        Format::ThreeMf => bytes.starts_with(b"PK") && zip::list_member_names(bytes).is_empty(),
        _ => false,
    };
    if may_be {
        return None;
    }
    detect_content(bytes).filter(|detected| *detected != Mesh(format))
}

/// Detects what a file is, as far as that is certain.
pub(super) fn detect_content(bytes: &[u8]) -> Option<Detected> {
    if stl::is_binary(bytes) {
        return Some(Mesh(Format::Stl));
    }
    let foreign = |what, help| Some(Detected::Foreign(ForeignFile { what, help }));
    if bytes.starts_with(b"PK\x03\x04") {
        let members = zip::list_member_names(bytes);
        let ends = |ending: &str| members.iter().any(|name| name.ends_with(ending));
        return match () {
            () if ends(".model") => Some(Mesh(Format::ThreeMf)),
            () if ends(".usdc") || ends(".usda") || ends(".usd") => {
                foreign("a USD file, which is not read", EXPORT_USD)
            }
            () if ends(".npy") => {
                foreign("an archive of NumPy arrays", "a height map keeps its ending, .npz; a mesh is no array")
            }
            () if ends("Document.xml") => foreign("a FreeCAD file, which is not read", CAD_HELP),
            () => foreign("a ZIP archive", UNPACK_ARCHIVE),
        };
    }
    let text = bytes.strip_prefix(b"\xef\xbb\xbf").unwrap_or(bytes);
    let known = SIGNATURES.iter().find(|(beginning, ..)| text.starts_with(beginning));
    if let Some((_, what, help)) = known {
        return foreign(what, help);
    }
    // The 80 bytes of an STL's header may be zeros, too: zeros alone count only if the file has nothing else.
    let is_hollow = bytes.iter().take(512).all(|byte| *byte == 0);
    if (!is_hollow || bytes.iter().all(|byte| *byte == 0))
        && let Some(found) = foreign::identify_foreign_file(bytes)
    {
        return Some(Detected::Foreign(found));
    }
    detect_by_first_word(bytes)
}

/// Detects what a text is by its first word, or by its statements.
fn detect_by_first_word(bytes: &[u8]) -> Option<Detected> {
    let mut words = WordReader::new(bytes);
    let first = words.next_word_any_line()?;
    if first.starts_with(b"glTF") {
        return Some(Mesh(Format::Gltf));
    }
    if first == b"ply" && words.break_len(words.at) > 0 {
        return Some(Mesh(Format::Ply));
    }
    if is_text(bytes) {
        if first.starts_with(b"<") {
            return detect_by_xml_root(bytes);
        }
        if first.starts_with(b"{") {
            let has = |key: &[u8]| bytes.windows(key.len()).any(|window| window == key);
            let other = ForeignFile { what: "JSON", help: "it may say itself why it is not what belongs here" };
            let is_gltf = has(b"\"asset\"") && (has(b"\"meshes\"") || has(b"\"nodes\""));
            return Some(if is_gltf { Mesh(Format::Gltf) } else { Detected::Foreign(other) });
        }
        if off::is_off(bytes) {
            return Some(Mesh(Format::Off));
        }
        if stl::is_ascii(bytes) {
            return Some(Mesh(Format::Stl));
        }
        if is_iges(bytes) {
            return Some(Detected::Foreign(ForeignFile { what: "an IGES file, which is not read", help: CAD_HELP }));
        }
        if obj::is_obj(bytes) {
            return Some(Mesh(Format::Obj));
        }
    }
    None
}

/// Returns true if there is no zero byte near the beginning. Text never has one, and most binary files do.
fn is_text(bytes: &[u8]) -> bool {
    !bytes.iter().take(1024).any(|byte| *byte == 0)
}

/// Returns true for lines of 80 columns of which the first ends in `S`, its section, and 1, its number.
fn is_iges(bytes: &[u8]) -> bool {
    bytes.get(72..80).is_some_and(|end| end[0] == b'S' && end[1..].trim_ascii() == b"1")
}

/// Detects what an XML document is by its outermost element.
fn detect_by_xml_root(bytes: &[u8]) -> Option<Detected> {
    let name = find_xml_root(bytes)?;
    let local = name.rsplit(':').next().unwrap_or_default();
    match local {
        "COLLADA" => Some(Mesh(Format::Dae)),
        "robot" => Some(Mesh(Format::Urdf)),
        _ => {
            let known = XML_ROOTS.iter().find(|(root, ..)| root.eq_ignore_ascii_case(local));
            known.map(|(_, what, help)| Detected::Foreign(ForeignFile { what, help }))
        }
    }
}

/// Finds the name of the outermost element, behind declarations and comments.
fn find_xml_root(bytes: &[u8]) -> Option<&str> {
    let mut rest = bytes;
    loop {
        let at = rest.iter().position(|byte| *byte == b'<')?;
        rest = &rest[at + 1..];
        let after = |end: &[u8]| rest.windows(end.len()).position(|window| window == end).map(|at| at + end.len());
        rest = match rest.first()? {
            b'?' => &rest[after(b"?>")?..],
            b'!' if rest.starts_with(b"!--") => &rest[after(b"-->")?..],
            b'!' => &rest[after(b">")?..],
            _ => {
                let end = rest.iter().position(|byte| byte.is_ascii_whitespace() || matches!(byte, b'>' | b'/'));
                return str::from_utf8(&rest[..end.unwrap_or(rest.len())]).ok();
            }
        };
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::mesh::tests::{cube_dae, cube_obj, cubes};
    use crate::zip::encode_stored;

    fn what(bytes: &[u8]) -> &'static str {
        match detect_content(bytes) {
            Some(Detected::Foreign(foreign)) => foreign.what,
            other => panic!("{other:?}"),
        }
    }

    #[test]
    fn every_format_is_known_by_its_bytes_and_none_is_taken_for_another() {
        for (format, bytes) in cubes() {
            assert_eq!(detect_content(&bytes), Some(Mesh(format)), "{format:?}");
            for named in Format::ALL {
                let expected = (named != format).then_some(Mesh(format));
                // Any JSON may be a glTF.
                let expected = expected.filter(|_| named != Format::Gltf || bytes[0] != b'{');
                assert_eq!(detect_mismatch(named, &bytes), expected, "{format:?} named as {named:?}");
            }
        }
        let robot = b"<?xml version=\"1.0\"?>\n<!-- <COLLADA> -->\n<robot name=\"r\"/>";
        assert_eq!(detect_content(robot), Some(Mesh(Format::Urdf)));
    }

    /// Makes a binary STL whose header begins as `header` does and counts `count` of its twelve facets.
    fn stl(header: &[u8], count: u32) -> Vec<u8> {
        let mut bytes = header.to_vec();
        bytes.resize(80, 0);
        bytes.extend(count.to_le_bytes());
        for k in 0..12 {
            bytes.extend([0; 12]);
            bytes.extend([0.0, 0.0, k as f32, 1.0, 0.0, 0.0, 0.0, 1.0, 0.0].map(f32::to_le_bytes).as_flattened());
            bytes.extend([0; 2]);
        }
        bytes
    }

    #[test]
    fn an_stl_may_begin_as_anything() {
        for header in [
            &b""[..],
            b"ply\n",
            b"PK\x03\x04",
            b"\x89PNG\r\n\x1a\n",
            b"glTF",
            b"OFF",
            b"<html>",
            b"BZh",
            b"Kaydara FBX Binary",
            b"version https://git-lfs.github.com/spec/",
        ] {
            assert_eq!(detect_mismatch(Format::Stl, &stl(header, 12)), None, "{header:?}");
        }
        // If only its count is wrong, its header alone is no reason to take it for something else.
        for header in [&b""[..], b"exported by x", b"\x01\x02", b"v 0 0 0 \nf 1"] {
            for count in [0, 3, u32::MAX] {
                assert_eq!(detect_mismatch(Format::Stl, &stl(header, count)), None, "{header:?} {count}");
            }
        }
    }

    #[test]
    fn what_is_no_mesh_is_named() {
        let zip = |name: &str| encode_stored(&[(name, b"")]);
        for (bytes, expected) in [
            (&b""[..], "empty"),
            (b"version https://git-lfs.github.com/spec/v1\noid", "a pointer of Git LFS"),
            (b"\n<!DOCTYPE html>", "a web page"),
            (b"<!-- a -->\n<html>", "a web page"),
            (b"<?xml version='1.0'?><Error><Code>AccessDenied</Code>", "a server's answer"),
            (b"{\"message\": \"Not Found\"}", "JSON"),
            (b"\xff\xd8\xff\xe0", "a JPEG picture"),
            (b"\x93NUMPY\x01\x00", "a NumPy array"),
            (&[0; 2000], "all zeros"),
            (&zip("a.npy"), "an archive of NumPy arrays"),
            (&zip("robot/a.stl"), "a ZIP archive"),
            (&zip("scene.usdc"), "a USD file"),
            (b"\x1f\x8b\x08", "packed by gzip"),
            (b"Kaydara FBX Binary  \x00\x1a\x00", "an FBX file"),
            (b"; FBX 7.3.0 project file\n", "an FBX file"),
            (b"ISO-10303-21;\nHEADER;", "a STEP file"),
            (b"<sdf version=\"1.6\">", "an SDF file"),
            (b"<?xml version=\"1.0\"?>\n<mujoco model=\"a\">", "a model of MuJoCo"),
            (b"# .PCD v0.7\n", "a point cloud"),
            (b"newmtl red\nKd 1 0 0\n", "a table of materials"),
            (format!("{:72}S      1\n", "").as_bytes(), "an IGES file"),
        ] {
            assert!(what(bytes).starts_with(expected), "{expected}: {}", what(bytes));
        }
        for unknown in [&b"a mug\n"[..], b"solid of a kind", b"\x01\x02\x03\x04", b"<a/>", b"v\n", b"4 1 0\n0 0 0\n"] {
            assert_eq!(detect_content(unknown), None, "{unknown:?}");
        }
    }

    #[test]
    fn endings_of_other_formats_have_a_way_out_and_are_none_that_is_read() {
        for (endings, what, help) in OTHER_EXTENSIONS {
            assert!(!what.is_empty() && !help.is_empty());
            for ending in *endings {
                let path = format!("a.{}", ending.to_uppercase());
                assert_eq!(Format::from_path(Path::new(&path)), None, "{ending}");
                assert_eq!(
                    identify_by_extension(Path::new(&path)).map(|foreign| foreign.help),
                    Some(*help),
                    "{ending}"
                );
            }
        }
        assert_eq!(identify_by_extension(Path::new("fbx")), None);
        assert_eq!(identify_by_extension(Path::new("a.obj")), None);
    }

    #[test]
    fn statements_of_an_obj_are_known_after_comments_and_names() {
        assert_eq!(detect_content(&cube_obj()), Some(Mesh(Format::Obj)));
        assert_eq!(
            detect_content(b"# x\nmtllib a.mtl\ng\nv 0 0 0\nvt 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n"),
            Some(Mesh(Format::Obj))
        );
        assert_eq!(detect_mismatch(Format::Stl, b"v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n"), Some(Mesh(Format::Obj)));
        assert_eq!(detect_mismatch(Format::Obj, &cube_dae()), Some(Mesh(Format::Dae)));
    }
}
