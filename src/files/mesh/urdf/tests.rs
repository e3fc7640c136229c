use super::*;
use crate::mesh::tests::cube_obj;
use crate::mesh::{MeshReadOptions, load, load_parts, parse};
use std::fs;

fn read_text(text: &str) -> RawMesh {
    read(text.as_bytes(), UrdfShapes::Visual, &mut Resources::none()).unwrap_or_else(|error| panic!("{error}"))
}

fn visual(geometry: &str) -> String {
    format!("<robot><link name=\"a\"><visual><geometry>{geometry}</geometry></visual></link></robot>")
}

/// Volume inside closed triangles that face outwards.
fn volume(raw: &RawMesh) -> f64 {
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
        let (_, cleaned) = raw.into_mesh(1.0).unwrap();
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
        let loaded = load(&path, MeshReadOptions::default()).unwrap();
        assert_eq!((loaded.mesh.triangles.len(), loaded.mm_per_unit), (expected.triangles.len(), 1000.0));
        let apart = loaded.mesh.vertices.as_flattened().iter().zip(expected.vertices.as_flattened());
        assert!(apart.into_iter().all(|(a, b)| (a - b).abs() < 1e-5), "{name}");
        hashes.push(loaded.sha256);
    }
    fs::write(package.join("meshes/cube.obj"), [cube_obj(), b"# more\n".to_vec()].concat()).unwrap();
    assert!(!hashes.contains(&load(&path, MeshReadOptions::default()).unwrap().sha256));
    fs::write(package.join("urdf/a.fbx"), "Kaydara FBX Binary").unwrap();
    fs::write(package.join("meshes/bad.obj"), "v 0 0 0\nf 1 2 3\n").unwrap();
    for (name, expected, help) in [
        (
            "package://none/cube.obj",
            "names the mesh `package://none/cube.obj`, and there is no package `none`",
            "ROS_PACKAGE_PATH",
        ),
        ("http://a/cube.obj", "names the mesh `http://a/cube.obj`, which is on the web", "fetch it"),
        ("a.fbx", "names `a.fbx`: is not named like a mesh", "open it in Blender"),
        ("r.urdf", "names `r.urdf`: is no mesh, but a robot", "name a mesh there"),
        ("no.stl", "names the mesh `no.stl`, which is not there", "packages = [\"FOLDER\"] under [[object]]"),
        (
            "../meshes/cbe.obj",
            "names the mesh `../meshes/cbe.obj`, which is not there",
            "did you mean `../meshes/cube.obj`?",
        ),
        ("../meshes/bad.obj", "names `../meshes/bad.obj`: line 2: face refers to vertex 2", "export it again"),
        ("${dir}/a.stl", "is a xacro file, whose macros are not expanded", "xacro IN.xacro > OUT.urdf"),
        ("$(arg dir)/a.stl", "names `$(arg dir)/a.stl`, which has a macro", "xacro IN.xacro > OUT.urdf"),
    ] {
        write(name);
        let error = load(&path, MeshReadOptions::default()).unwrap_err();
        assert!(error.to_string().contains(&format!("r.urdf:1: {expected}")), "{error}");
        assert!(error.help().contains(help), "{name}: {}", error.help());
    }
}

#[test]
fn all_meshes_that_are_missing_are_named_with_their_lines() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("r.urdf");
    let link = |i: u32, name: &str| {
        format!("<link name=\"{i}\"><visual><geometry>\n<mesh filename=\"{name}\"/></geometry></visual></link>\n")
    };
    let names = ["a.stl", "cube.obj", "package://p/b.stl", "a.stl", "c.stl", "d.stl", "e.stl", "f.stl"];
    let links: String = (0..).zip(names).map(|(i, name)| link(i, name)).collect();
    fs::write(folder.path().join("cube.obj"), cube_obj()).unwrap();
    fs::write(&path, format!("<robot>\n{links}</robot>")).unwrap();
    let error = load(&path, MeshReadOptions::default()).unwrap_err();
    let expected = "r.urdf:3: names 6 meshes that are not there: `a.stl` (line 3), `package://p/b.stl` (line 7), `c.stl` \
                    (line 11), `d.stl` (line 13), `e.stl` (line 15) and 1 more";
    assert!(error.to_string().ends_with(expected), "{error}");
}

#[test]
fn a_package_may_be_where_the_user_says_and_the_hash_is_the_same() {
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| {
        let path = folder.path().join(name);
        fs::create_dir_all(path.parent().unwrap()).unwrap();
        path
    };
    fs::write(at("ros/src/arm_meshes/package.xml"), "<package><name>arm</name></package>").unwrap();
    fs::write(at("ros/src/arm_meshes/m/cube.obj"), cube_obj()).unwrap();
    let path = at("robots/r/r.urdf");
    let text = visual("<mesh filename=\"$(find arm)/m/cube.obj\"/>");
    fs::write(&path, &text).unwrap();
    assert!(load(&path, MeshReadOptions::default()).is_err());
    let given = [at("ros").to_string_lossy().into_owned()];
    let loaded = load(&path, MeshReadOptions { packages: &given, ..MeshReadOptions::default() }).unwrap();
    assert_eq!(loaded.packages, given);
    let beside = at("robots/arm/m/cube.obj");
    fs::write(&beside, cube_obj()).unwrap();
    let other = load(&path, MeshReadOptions::default()).unwrap();
    assert_eq!((other.sha256, other.packages.len()), (loaded.sha256, 0));
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
    let collision = load(&path, MeshReadOptions { urdf: UrdfShapes::Collision, ..1.0.into() }).unwrap();
    assert_eq!(collision.mesh.vertices[0].map(f32::abs), [4.5; 3]);
}

#[test]
fn errors_name_the_line() {
    for (text, expected) in [
        ("<a/>", "line 1: is no URDF: begins with <a>"),
        (
            "<robot xmlns:xacro=\"http://ros.org/wiki/xacro\">\n<xacro:if/></robot>",
            "line 2: is a xacro file, whose macros are not expanded",
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
        ("<robot>\n<link name=\"a\"/></robot>", "line 1: has no link with a shape"),
        ("<robot><link><collision/><collision/></link></robot>", "line 1: has no visual shape, but 2 collision shapes"),
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
        let error = read(text.as_bytes(), UrdfShapes::Visual, &mut Resources::none()).expect_err("a mistake");
        assert_eq!(error.to_string(), expected);
    }
}
