use super::*;
use proptest::prelude::*;
use std::fs;

pub(super) const CORNERS: [[f32; 3]; 8] = [
    [1.5, 2.0, -4.0],
    [5.5, 2.0, -4.0],
    [5.5, 6.0, -4.0],
    [1.5, 6.0, -4.0],
    [1.5, 2.0, 0.0],
    [5.5, 2.0, 0.0],
    [5.5, 6.0, 0.0],
    [1.5, 6.0, 0.0],
];
pub(super) const FACES: [[u32; 4]; 6] =
    [[0, 3, 2, 1], [4, 5, 6, 7], [0, 1, 5, 4], [1, 2, 6, 5], [2, 3, 7, 6], [3, 0, 4, 7]];

pub(super) fn triangles() -> Vec<[u32; 3]> {
    FACES.iter().flat_map(|&[a, b, c, d]| [[a, b, c], [a, c, d]]).collect()
}

pub(super) fn cube_obj() -> Vec<u8> {
    let mut text = String::from("# a cube\no cube\n");
    for [x, y, z] in CORNERS {
        text += &format!("v {x} {y} {z}\n");
    }
    for face in FACES {
        let [a, b, c, d] = face.map(|i| i + 1);
        text += &format!("f {a}/1/1 {b}//2 {c}/3 {d}\n");
    }
    text.into_bytes()
}

fn cube_stl_ascii() -> Vec<u8> {
    let mut text = String::from("solid cube\n");
    for triangle in triangles() {
        text += "facet normal 0 0 1\n  outer loop\n";
        for [x, y, z] in triangle.map(|i| CORNERS[i as usize]) {
            text += &format!("    vertex {x:e} {y:e} {z:e}\n");
        }
        text += "  endloop\nendfacet\n";
    }
    (text + "endsolid cube\n").into_bytes()
}

fn cube_stl_binary() -> Vec<u8> {
    let mut bytes = b"solid this header is binary all the same".to_vec();
    bytes.resize(80, b' ');
    bytes.extend(12u32.to_le_bytes());
    for triangle in triangles() {
        bytes.extend([0; 12]);
        for corner in triangle.map(|i| CORNERS[i as usize]) {
            bytes.extend(corner.map(f32::to_le_bytes).as_flattened());
        }
        bytes.extend([0; 2]);
    }
    bytes
}

fn cube_ply_ascii() -> Vec<u8> {
    let mut text = String::from(
        "ply\nformat ascii 1.0\ncomment a cube\nelement vertex 8\nproperty float x\nproperty float y\n\
         property float z\nelement face 6\nproperty list uchar int vertex_indices\nend_header\n",
    );
    for [x, y, z] in CORNERS {
        text += &format!("{x} {y} {z}\n");
    }
    for [a, b, c, d] in FACES {
        text += &format!("4 {a} {b} {c} {d}\n");
    }
    text.into_bytes()
}

fn cube_ply_binary(big: bool) -> Vec<u8> {
    let order = if big { "big" } else { "little" };
    let mut bytes = format!(
        "ply\nformat binary_{order}_endian 1.0\nelement vertex 8\nproperty double z\nproperty uchar red\n\
         property float y\nproperty short x2\nproperty float x\nelement face 6\n\
         property list ushort uint vertex_index\nproperty list uchar float texcoord\nend_header\n"
    )
    .into_bytes();
    let mut put = |value: &[u8]| {
        if big {
            bytes.extend(value.iter().rev());
        } else {
            bytes.extend(value);
        }
    };
    for [x, y, z] in CORNERS {
        put(&f64::from(z).to_le_bytes());
        put(&[200]);
        put(&y.to_le_bytes());
        put(&(-3i16).to_le_bytes());
        put(&x.to_le_bytes());
    }
    for face in FACES {
        put(&4u16.to_le_bytes());
        face.iter().for_each(|i| put(&i.to_le_bytes()));
        put(&[2]);
        put(&0.5f32.to_le_bytes());
        put(&0.5f32.to_le_bytes());
    }
    bytes
}

fn cube_off() -> Vec<u8> {
    let mut text = String::from("OFF\n8 6 12\n");
    for [x, y, z] in CORNERS {
        text += &format!("{x} {y} {z}\n");
    }
    for [a, b, c, d] in FACES {
        text += &format!("4 {a} {b} {c} {d} 0.5 0.5 0.5\n");
    }
    text.into_bytes()
}

/// The buffer of the cube: positions, then indices.
pub(super) fn cube_buffer() -> Vec<u8> {
    let mut bytes: Vec<u8> = CORNERS.as_flattened().iter().flat_map(|x| x.to_le_bytes()).collect();
    bytes.extend(triangles().as_flattened().iter().flat_map(|index| (*index as u16).to_le_bytes()));
    bytes
}

/// The JSON of the cube, with `uri` in its buffer.
pub(super) fn cube_gltf(uri: &str) -> String {
    format!(
        r#"{{"asset":{{"version":"2.0"}},"scene":0,"scenes":[{{"nodes":[0]}}],
"nodes":[{{"name":"cube","mesh":0}}],
"meshes":[{{"primitives":[{{"attributes":{{"POSITION":0}},"indices":1}}]}}],
"accessors":[{{"bufferView":0,"componentType":5126,"count":8,"type":"VEC3"}},
{{"bufferView":1,"componentType":5123,"count":36,"type":"SCALAR"}}],
"bufferViews":[{{"buffer":0,"byteLength":96}},{{"buffer":0,"byteOffset":96,"byteLength":72}}],
"buffers":[{{{uri}"byteLength":168}}]}}"#
    )
}

fn cube_gltf_inline() -> Vec<u8> {
    use base64::Engine;
    let data = base64::engine::general_purpose::STANDARD.encode(cube_buffer());
    cube_gltf(&format!("\"uri\":\"data:application/octet-stream;base64,{data}\",")).into_bytes()
}

pub(super) fn glb(json: &str, binary: &[u8]) -> Vec<u8> {
    let mut json = json.as_bytes().to_vec();
    json.resize(json.len().next_multiple_of(4), b' ');
    let mut bytes = b"glTF".to_vec();
    bytes.extend([2, 12 + 16 + json.len() as u32 + binary.len() as u32].map(u32::to_le_bytes).as_flattened());
    for (kind, content) in [(b"JSON", &json[..]), (b"BIN\0", binary)] {
        bytes.extend((content.len() as u32).to_le_bytes());
        bytes.extend(kind);
        bytes.extend(content);
    }
    bytes
}

fn numbers(numbers: impl IntoIterator<Item = impl ToString>) -> String {
    numbers.into_iter().map(|number| number.to_string()).collect::<Vec<_>>().join(" ")
}

pub(super) fn cube_dae() -> Vec<u8> {
    let (points, corners) =
        (numbers(CORNERS.as_flattened()), numbers(FACES.as_flattened().iter().map(|i| format!("{i} 0"))));
    format!(
        r##"<?xml version="1.0"?>
<COLLADA xmlns="http://www.collada.org/2005/11/COLLADASchema" version="1.4.1">
<asset><unit name="inch" meter="0.0254"/><up_axis>Z_UP</up_axis></asset>
<library_geometries><geometry id="g" name="Cube"><mesh>
<source id="p"><float_array id="a" count="24">{points}</float_array>
<technique_common><accessor source="#a" count="8" stride="3"/></technique_common></source>
<vertices id="v"><input semantic="POSITION" source="#p"/></vertices>
<polylist count="6"><input semantic="VERTEX" source="#v" offset="0"/><input semantic="NORMAL" source="#n" offset="1"/>
<vcount>4 4 4 4 4 4</vcount><p>{corners}</p></polylist>
</mesh></geometry></library_geometries>
<library_visual_scenes><visual_scene id="s"><node name="lid"><instance_geometry url="#g"/></node></visual_scene></library_visual_scenes>
<scene><instance_visual_scene url="#s"/></scene></COLLADA>"##
    )
    .into_bytes()
}

/// The XML of a 3MF.
pub(super) fn cube_model() -> String {
    let vertices: String =
        CORNERS.iter().map(|[x, y, z]| format!("<vertex x=\"{x}\" y=\"{y}\" z=\"{z}\"/>\n")).collect();
    let triangles: String =
        triangles().iter().map(|[a, b, c]| format!("<triangle v1=\"{a}\" v2=\"{b}\" v3=\"{c}\"/>\n")).collect();
    format!(
        r#"<?xml version="1.0" encoding="UTF-8"?>
<model unit="inch" xmlns="http://schemas.microsoft.com/3dmanufacturing/core/2015/02">
<resources><object id="1" name="cube" type="model"><mesh><vertices>
{vertices}</vertices><triangles>
{triangles}</triangles></mesh></object></resources>
<build><item objectid="1"/></build></model>"#
    )
}

fn cube_3mf() -> Vec<u8> {
    crate::zip::encode_stored(&[("3D/3dmodel.model", cube_model().as_bytes())])
}

pub(super) fn cubes() -> [(Format, Vec<u8>); 11] {
    [
        (Format::Obj, cube_obj()),
        (Format::Stl, cube_stl_ascii()),
        (Format::Stl, cube_stl_binary()),
        (Format::Ply, cube_ply_ascii()),
        (Format::Ply, cube_ply_binary(false)),
        (Format::Ply, cube_ply_binary(true)),
        (Format::Off, cube_off()),
        (Format::Gltf, cube_gltf_inline()),
        (Format::Gltf, glb(&cube_gltf(""), &cube_buffer())),
        (Format::Dae, cube_dae()),
        (Format::ThreeMf, cube_3mf()),
    ]
}

#[test]
fn one_cube_is_the_same_mesh_in_every_format() {
    let (expected, _) = parse(&cube_obj(), Format::Obj, 2.0).unwrap();
    assert_eq!(expected.centre_mm, [7.0, 8.0, -4.0]);
    assert_eq!((expected.vertices.len(), expected.triangles.len()), (8, 12));
    assert!(expected.vertices.as_flattened().iter().all(|x| x.abs() == 4.0));
    for (i, (format, bytes)) in cubes().into_iter().enumerate() {
        let (mesh, cleaned) = parse(&bytes, format, 2.0).unwrap();
        assert_eq!(mesh, expected, "{i}");
        assert_eq!(cleaned, CleanupReport::default());
    }
}

#[test]
fn a_file_is_read_by_its_extension_in_any_case_and_hashed() {
    let folder = tempfile::tempdir().unwrap();
    for (i, (format, bytes)) in cubes().into_iter().enumerate() {
        let path = folder.path().join(format!("{i}.{}", format.extensions()[0].to_uppercase()));
        fs::write(&path, bytes).unwrap();
        let loaded = load(&path, MeshReadOptions::default()).unwrap();
        assert_eq!(loaded.mesh.triangles.len(), 12);
        let says = match format {
            Format::Gltf => 1000.0,
            Format::Dae | Format::ThreeMf => 25.4,
            _ => 1.0,
        };
        assert_eq!(loaded.mm_per_unit, says, "{format:?}");
    }
    let path = folder.path().join("abc.Obj");
    fs::write(&path, "abc").unwrap();
    assert_eq!(load(&path, 1.0).unwrap_err().to_string(), format!("{}: no vertex", path.display()));
    fs::write(&path, "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n").unwrap();
    assert_eq!(load(&path, 1.0).unwrap().sha256, "697b00ab13410c52a542d2e9c63711fcc04e9cbf6c0d3439a9b43cc812e6e713");
}

#[test]
fn errors_name_the_file_and_the_line() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.obj");
    fs::write(&path, "v 0 0 0\nv 1 0 0\nf 1 2 9\n").unwrap();
    assert_eq!(
        load(&path, 1.0).unwrap_err().to_string(),
        format!("{}:3: face refers to vertex 9, but the file has 2 so far", path.display())
    );
    let missing = load(&folder.path().join("no.stl"), 1.0).unwrap_err();
    assert!(matches!(missing.problem, MeshFileProblem::Unreadable(_)));
    assert!(missing.to_string().contains("no.stl: cannot be read: "), "{missing}");
    for name in ["a.step", "obj", ".obj"] {
        let path = folder.path().join(name);
        assert!(matches!(load(&path, 1.0).unwrap_err().problem, MeshFileProblem::Unreadable(_)), "it is not there");
        fs::write(&path, "x").unwrap();
        let said = load(&path, 1.0).unwrap_err().to_string();
        assert_eq!(said, format!("{}: is not named like a mesh: use {ENDINGS}", path.display()));
    }
}

/// Returns what is said of a file of this name with these bytes, and what to do.
fn said(name: &str, bytes: &[u8]) -> (String, String) {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join(name);
    fs::write(&path, bytes).unwrap();
    let error = load(&path, 1.0).unwrap_err();
    (error.to_string().replace(&format!("{}: ", path.display()), ""), error.help())
}

#[test]
fn what_is_no_mesh_is_told_before_a_parser_speaks() {
    let pointer = b"version https://git-lfs.github.com/spec/v1\noid sha256:1\nsize 9\n";
    for name in ["a.stl", "a.obj", "a.ply", "a.off", "a.glb", "a.gltf", "a.dae", "a.3mf", "a.urdf", "a.step"] {
        for (bytes, what, help) in [
            (&pointer[..], "is a pointer of Git LFS, not the file itself", "git lfs pull"),
            (b"", "is empty", "copy or download it again"),
            (b"<!DOCTYPE html><html>", "is a web page (HTML)", "download the file itself"),
            (b"\x00\x05\x16\x07\x00\x02\x00\x00Mac OS X", "is a companion file of macOS", "without ._ before it"),
        ] {
            let (said, way_out) = said(name, bytes);
            assert!(said.starts_with(what) && way_out.contains(help), "{name}: {said}: {way_out}");
        }
    }
    let (said, help) = said("a.obj", b"Kaydara FBX Binary  \x00");
    assert_eq!((said.as_str(), help.contains("Blender")), ("is an FBX file", true));
}

#[test]
fn an_ending_that_is_not_read_has_its_own_way_out() {
    for (name, bytes, help) in [
        ("a.fbx", &b"Kaydara FBX Binary  \x00"[..], "open it in Blender and export it as .glb"),
        ("A.STEP", b"ISO-10303-21;", "FreeCAD"),
        ("a.sldprt", b"\xd0\xcf\x11\xe0\xa1\xb1\x1a\xe1", "export it as .stl or .3mf"),
        ("model.sdf", b"<sdf>", "name the meshes that it refers to"),
        ("r.urdf.xacro", b"<robot>", "xacro IN.xacro > OUT.urdf"),
        ("a.pcd", b"# .PCD v0.7", "reconstruct a surface"),
        ("a.txt", b"a mug", "`path` in a job takes height maps, too: .png, .npy, .npz or .exr"),
        ("a.png", b"", "mm_per_px and height_mm under [[object]]"),
        ("a.stl.download", &cube_stl_binary(), "it is STL by its bytes: give it the ending .stl"),
    ] {
        let (said, way_out) = said(name, bytes);
        // A robot is recognised whatever its name is; its macros are what keeps it from being read.
        let expected = if name.ends_with("xacro") { "it is URDF by its bytes" } else { help };
        assert!(
            said.starts_with("is not named like a mesh") && way_out.contains(expected),
            "{name}: {said}: {way_out}"
        );
    }
}

#[test]
fn a_mesh_of_another_format_than_its_ending_says_is_read_by_its_bytes() {
    let folder = tempfile::tempdir().unwrap();
    let (expected, _) = parse(&cube_obj(), Format::Obj, 2.0).unwrap();
    for (format, bytes) in cubes() {
        for named in Format::ALL.into_iter().filter(|named| *named != format) {
            let path = folder.path().join(format!("a.{}", named.extensions()[0]));
            fs::write(&path, &bytes).unwrap();
            let Ok(loaded) = load(&path, 2.0) else { panic!("{format:?} named as {named:?}") };
            assert_eq!((&loaded.mesh, loaded.file_summary.format), (&expected, format), "named as {named:?}");
            assert_eq!(loaded.remarks, [Remark::Misnamed(format)]);
            assert_eq!(load(&path, MeshReadOptions::default()).unwrap().states_its_unit, format.has_known_unit());
        }
    }
    let path = folder.path().join("a.stl");
    fs::write(&path, cube_stl_ascii()).unwrap();
    assert!(load(&path, 1.0).unwrap().remarks.is_empty());
}

#[test]
fn a_mesh_too_large_to_be_one_is_told_the_unit_that_fits() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.obj");
    fs::write(&path, "v 0 0 0\nv 20000 0 0\nv 0 20000 0\nf 1 2 3\n").unwrap();
    let error = load(&path, 1000.0).unwrap_err();
    assert!(error.to_string().contains("is 2.000e7 mm across"), "{error}");
    assert!(error.help().contains("unit = \"mm\" under [[object]]: it is 20000 mm long then"), "{}", error.help());
    assert!(load(&path, 1.0).is_ok());
}

#[test]
fn a_number_with_a_comma_is_told() {
    let (text, help) = said("a.obj", b"v 0,5 0 0\n");
    assert!(
        text.ends_with(":1: `0,5` is not a number") && help.contains("numbers have a decimal point"),
        "{text}: {help}"
    );
}

#[test]
fn a_unit_that_is_not_finite_leaves_no_finite_vertex() {
    let error = parse(&cube_obj(), Format::Obj, f64::NAN).unwrap_err();
    assert_eq!(error.to_string(), "no vertex with finite coordinates");
}

#[test]
fn words_end_at_blanks_comments_and_continued_lines() {
    let mut words = WordReader::new(b"\xef\xbb\xbf a\tbc#d\\\n\\e\\\r\n f\\ \r\rg");
    assert_eq!(words.next_word(), Some(&b"a"[..]));
    assert_eq!(words.next_word(), Some(&b"bc"[..]));
    assert_eq!(words.next_word(), None);
    assert!(words.next_line());
    assert_eq!((words.next_word(), words.line), (Some(&b"\\e"[..]), 2));
    assert_eq!((words.next_word(), words.line), (Some(&b"f\\"[..]), 3));
    assert_eq!(words.next_word(), None);
    assert_eq!((words.next_word_any_line(), words.line), (Some(&b"g"[..]), 5));
    assert_eq!(words.next_word_any_line(), None);
    assert!(!words.next_line());
}

#[test]
fn numbers_may_be_scientific_or_not_finite() {
    for (word, expected) in [("-1.5E+3", -1500.0), (".5", 0.5), ("2.", 2.0), ("+inf", f64::INFINITY)] {
        assert_eq!(parse_number(word.as_bytes()).unwrap(), expected);
    }
    for word in ["nan", "NaN", "-nan(ind)"] {
        assert!(parse_number(word.as_bytes()).unwrap().is_nan());
    }
    assert_eq!(parse_number(b"1,5\xff\n").unwrap_err().to_string(), "`1,5\u{fffd}\\n` is not a number");
}

fn parse_all(bytes: &[u8]) {
    for format in Format::ALL {
        if let Err(error) = parse(bytes, format, 1.0) {
            assert!(!error.to_string().contains('\n'), "{error}");
        }
    }
}

const ROBOT: &str = r#"<robot name="r">
<link name="a"><visual><geometry><box size="1 2 3"/></geometry></visual></link>
<link name="b"><visual><origin xyz="0 0 1" rpy="0 1 0"/><geometry><sphere radius="1"/></geometry></visual></link>
<joint name="j" type="fixed"><origin xyz="1 0 0"/><parent link="a"/><child link="b"/></joint></robot>"#;

proptest! {
    #[test]
    fn random_bytes_never_panic(bytes in prop::collection::vec(any::<u8>(), 0..300)) {
        parse_all(&bytes);
        let mut binary = bytes.clone();
        binary.splice(0..0, *b"solid ");
        parse_all(&binary);
        let mut ply = b"ply\nformat binary_little_endian 1.0\nelement vertex 9\nproperty char x\n\
            property char y\nproperty half z\nelement face 9\nproperty list char char vertex_index\n\
            end_header\n".to_vec();
        ply.extend(&bytes);
        parse_all(&ply);
    }

    #[test]
    fn random_statements_never_panic(
        words in prop::collection::vec(
            prop::sample::select(vec![
                "v", "f", "1", "-1", "2", "3/4", "0", "nan", "1e39", "9999999999", "\n", "\n", "\\\n", "#",
                "\r", "solid", "facet", "outer loop", "vertex", "vertex 0 1 2", "endfacet", "ply\n",
                "format ascii 1.0\n", "element vertex 3\n", "element face", "property list uchar int",
                "property float", "x", "y", "z", "vertex_index", "end_header\n", "OFF", "3 1 0\n",
            ]),
            0..200,
        ),
    ) {
        parse_all(words.join(" ").as_bytes());
    }

    #[test]
    fn damaged_files_never_panic(
        which in 0usize..11,
        edits in prop::collection::vec((any::<prop::sample::Index>(), any::<u8>()), 1..8),
        len in any::<prop::sample::Index>(),
        is_cut in any::<bool>(),
    ) {
        let mut bytes = cubes()[which].1.clone();
        for (at, value) in edits {
            let at = at.index(bytes.len());
            bytes[at] = value;
        }
        if is_cut {
            bytes.truncate(len.index(bytes.len()));
        }
        parse_all(&bytes);
    }

    /// Formats whose text is mostly marks: damage that leaves the text readable goes deeper.
    #[test]
    fn damaged_text_never_panics(
        which in 0usize..6,
        edits in prop::collection::vec((any::<prop::sample::Index>(), 0usize..20), 1..6),
    ) {
        let texts = [
            cube_gltf_inline(), cube_dae(), cube_model().into_bytes(), ROBOT.as_bytes().to_vec(), cube_off(), cube_obj(),
        ];
        let pieces = [
            "0", "9", "-", "1e9", "99999999999999999999", "\"", "<", ">", "/>", "[", "]", "{}", ",", " ", "#g", "nan",
            "null", "\n", "4294967295", "0.5",
        ];
        let mut text = texts[which].clone();
        for (at, piece) in edits {
            let at = at.index(text.len());
            let end = (at + 1).min(text.len());
            text.splice(at..end, pieces[piece].bytes());
        }
        parse_all(&text);
        parse_all(&crate::zip::encode_stored(&[("3D/3dmodel.model", &text)]));
        parse_all(&glb(&String::from_utf8_lossy(&text), &cube_buffer()));
    }
}
