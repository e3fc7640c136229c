use super::*;
use crate::files::mesh::tests::cube_obj;
use crate::files::mesh::{Reading, load, load_parts, parse};
use std::fs;

fn read_text(text: &str) -> Raw {
    read(text.as_bytes(), UrdfShapes::Visual, &mut Others::beside(None)).unwrap_or_else(|error| panic!("{error}"))
}

fn visual(geometry: &str) -> String {
    format!("<robot><link name=\"a\"><visual><geometry>{geometry}</geometry></visual></link></robot>")
}

/// Volume inside closed triangles that face outwards.
fn volume(raw: &Raw) -> f64 {
    let of = |t: &[u32; 3]| {
        let [a, b, c] = t.map(|i| DVec3::from_array(raw.vertices[i as usize]));
        a.dot(b.cross(c)) / 6.0
    };
    raw.triangles.iter().map(of).sum()
}

#[test]
fn shapes_have_their_volume_and_face_outwards() {
    use std::f64::consts::PI;
    for (geometry, expected, tolerance) in [
        ("<box size=\"1 2 3\"/>", 6.0, 1e-12),
        ("<cylinder radius=\"2\" length=\"3\"/>", 12.0 * PI, 2e-4),
        ("<sphere radius=\"2\"/>", 32.0 / 3.0 * PI, 4e-4),
    ] {
        let raw = read_text(&visual(geometry));
        let found = volume(&raw);
        assert!((found / expected - 1.0).abs() < tolerance, "{geometry}: {found} {expected}");
        let (_, cleaned) = raw.mesh(1.0).unwrap();
        assert_eq!(cleaned, Default::default());
    }
}

#[test]
fn joints_place_links_at_their_zero() {
    let text = r#"<robot><joint><parent link="a"/><child link="b"/><origin xyz="1 0 0" rpy="0 0 1.5707963267948966"/></joint>
<joint><parent link="b"/><child link="c"/><origin xyz="2 0 0"/></joint>
<link name="c"><visual><origin xyz="0 0 5"/><geometry><box size="2 2 2"/></geometry></visual></link>
<link name="a"/><link name="b"/></robot>"#;
    let (mesh, _) = parse(text.as_bytes(), Format::Urdf, 1.0).unwrap();
    let expected = [1.0, 2.0, 5.0];
    assert!((0..3).all(|k| (mesh.centre_mm[k] - expected[k]).abs() < 1e-12), "{:?}", mesh.centre_mm);
}

#[test]
fn meshes_are_found_beside_and_in_packages_and_hashed() {
    let folder = tempfile::tempdir().unwrap();
    let package = folder.path().join("my_robot");
    fs::create_dir_all(package.join("urdf")).unwrap();
    fs::create_dir_all(package.join("meshes")).unwrap();
    fs::write(package.join("meshes/cube.obj"), cube_obj()).unwrap();
    let path = package.join("urdf/r.urdf");
    let write = |name: &str| {
        fs::write(&path, visual(&format!("<mesh filename=\"{name}\" scale=\"0.001 0.001 0.001\"/>"))).unwrap()
    };
    let expected = parse(&cube_obj(), Format::Obj, 1.0).unwrap().0;
    let mut hashes = Vec::new();
    for name in ["package://my_robot/meshes/cube.obj", "../meshes/cube.obj", "model://my_robot/meshes/cube.obj"] {
        write(name);
        let loaded = load(&path, Reading::default()).unwrap();
        assert_eq!((loaded.mesh.triangles.len(), loaded.mm_per_unit), (expected.triangles.len(), 1000.0));
        let apart = loaded.mesh.vertices.as_flattened().iter().zip(expected.vertices.as_flattened());
        assert!(apart.into_iter().all(|(a, b)| (a - b).abs() < 1e-5), "{name}");
        hashes.push(loaded.sha256);
    }
    fs::write(package.join("meshes/cube.obj"), [cube_obj(), b"# more\n".to_vec()].concat()).unwrap();
    assert!(!hashes.contains(&load(&path, Reading::default()).unwrap().sha256));
    for (name, expected) in [
        ("package://none/cube.obj", "r.urdf:1: no folder here or above is called `none`, as the package"),
        ("http://a/cube.obj", "r.urdf:1: names `http://a/cube.obj`, which is no file"),
        ("a.txt", "r.urdf:1: names `a.txt`, which is no mesh that is read"),
        ("r.urdf", "r.urdf:1: names `r.urdf`, which is no mesh that is read"),
        ("no.stl", "no.stl: cannot be read: "),
    ] {
        write(name);
        let error = load(&path, Reading::default()).unwrap_err().to_string();
        assert!(error.contains(expected), "{error}");
    }
}

#[test]
fn links_are_parts_and_collisions_another_choice() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("r.urdf");
    let of = |name: &str, size: u32| {
        format!(
            "<link name=\"{name}\"><visual><geometry><box size=\"{size} 1 1\"/></geometry></visual><collision><geometry><box size=\"9 9 9\"/></geometry></collision></link>"
        )
    };
    fs::write(&path, format!("<robot>{}<link name=\"bare\"/>{}</robot>", of("a", 1), of("b", 2))).unwrap();
    let names: Vec<String> = load_parts(&path, 1.0).unwrap().into_iter().map(|(name, _)| name).collect();
    assert_eq!(names, ["a", "b"]);
    let collision = load(&path, Reading { mm_per_unit: Some(1.0), urdf: UrdfShapes::Collision }).unwrap();
    assert_eq!(collision.mesh.vertices[0].map(f32::abs), [4.5; 3]);
}

#[test]
fn errors_name_the_line() {
    for (text, expected) in [
        ("<a/>", "line 1: is no URDF: begins with <a>"),
        (
            "<robot xmlns:xacro=\"http://ros.org/wiki/xacro\">\n<xacro:if/></robot>",
            "line 2: has macros: expand them with the program xacro",
        ),
        ("<robot><link name=\"a\"/>\n<joint><parent link=\"a\"/></joint></robot>", "line 2: <joint> has no child"),
        (
            "<robot><link name=\"a\"/>\n<joint><parent link=\"a\"/><child link=\"b\"/></joint></robot>",
            "line 2: there is no link `b`",
        ),
        (
            "<robot><link name=\"a\"/>\n<joint><parent link=\"a\"/><child link=\"a\"/></joint></robot>",
            "line 2: the joints go in a circle",
        ),
        ("<robot><link><visual>\n</visual></link></robot>", "line 1: <visual> has no geometry"),
        (
            "<robot><link><visual><geometry>\n<cone/></geometry></visual></link></robot>",
            "line 2: has the shape `cone`, which is not read",
        ),
        (
            "<robot><link><visual><geometry>\n<box size=\"1 2\"/></geometry></visual></link></robot>",
            "line 2: <box> has 2 numbers instead of 3",
        ),
        (
            "<robot><link><visual><geometry><mesh filename=\"a.stl\"/></geometry></visual></link></robot>",
            "line 1: names another file, `a.stl`",
        ),
    ] {
        let error = read(text.as_bytes(), UrdfShapes::Visual, &mut Others::beside(None)).expect_err("a mistake");
        assert_eq!(error.to_string(), expected);
    }
}
