use super::*;
use crate::mesh::tests::{CORNERS, cube_buffer, cube_gltf, glb};
use crate::mesh::{Format, MeshReadOptions, load, load_parts, parse};
use std::fs;

fn read_glb(json: &str, binary: &[u8]) -> RawMesh {
    read(&glb(json, binary), &mut Resources::none()).unwrap_or_else(|error| panic!("{error}"))
}

fn failure(json: &str, binary: &[u8]) -> String {
    let error = read(&glb(json, binary), &mut Resources::none()).expect_err("a mistake");
    error.to_string()
}

/// `cube_gltf` with a piece of it replaced.
fn edited(from: &str, to: &str) -> String {
    let json = cube_gltf("");
    assert_eq!(json.matches(from).count(), 1, "{from}");
    json.replace(from, to)
}

#[test]
fn nodes_move_what_is_in_them() {
    let nodes = r#""nodes":[{"children":[1],"translation":[10,0,0],"scale":[2,2,2]},
        {"name":"cube","mesh":0,"rotation":[0,0,0.7071067811865476,0.7071067811865476]}]"#;
    let raw = read_glb(&edited(r#""nodes":[{"name":"cube","mesh":0}]"#, nodes), &cube_buffer());
    let [x, y, z] = CORNERS[1].map(f64::from);
    // A quarter turn about z, doubled, then moved.
    let expected = [10.0 - 2.0 * y, 2.0 * x, 2.0 * z];
    let found = raw.vertices[1];
    assert!((0..3).all(|k| (found[k] - expected[k]).abs() < 1e-12), "{found:?} {expected:?}");
    assert_eq!(raw.mm_per_unit, Some(1000.0));
}

#[test]
fn a_matrix_stands_column_by_column() {
    let node = r#""nodes":[{"name":"cube","mesh":0,"matrix":[0,1,0,0, -1,0,0,0, 0,0,1,0, 5,6,7,1]}]"#;
    let raw = read_glb(&edited(r#""nodes":[{"name":"cube","mesh":0}]"#, node), &cube_buffer());
    let [x, y, z] = CORNERS[6].map(f64::from);
    assert_eq!(raw.vertices[6], [5.0 - y, 6.0 + x, 7.0 + z]);
}

#[test]
fn a_mirrored_node_keeps_its_front_outside() {
    let node = r#""nodes":[{"name":"cube","mesh":0,"scale":[-1,1,1]}]"#;
    let raw = read_glb(&edited(r#""nodes":[{"name":"cube","mesh":0}]"#, node), &cube_buffer());
    let volume: f64 = raw
        .triangles
        .iter()
        .map(|t| {
            let [a, b, c] = t.map(|i| DVec3::from_array(raw.vertices[i as usize]));
            a.dot(b.cross(c)) / 6.0
        })
        .sum();
    assert!((volume - 64.0).abs() < 1e-9, "{volume}");
}

#[test]
fn strips_and_fans_are_cut_and_lines_passed_over() {
    let points: Vec<u8> = [[0.0f32, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [1.0, 1.0, 0.0]]
        .as_flattened()
        .iter()
        .flat_map(|x| x.to_le_bytes())
        .collect();
    let of_mode = |mode: u32| {
        let json = format!(
            r#"{{"asset":{{"version":"2.0"}},"nodes":[{{"mesh":0}}],
            "meshes":[{{"primitives":[{{"attributes":{{"POSITION":0}},"mode":{mode}}}]}}],
            "accessors":[{{"bufferView":0,"componentType":5126,"count":4,"type":"VEC3"}}],
            "bufferViews":[{{"buffer":0,"byteLength":48}}],"buffers":[{{"byteLength":48}}]}}"#
        );
        read(&glb(&json, &points), &mut Resources::none()).map(|raw| raw.triangles).map_err(|error| error.to_string())
    };
    assert_eq!(of_mode(4), Ok(vec![[0, 1, 2]]));
    assert_eq!(of_mode(5), Ok(vec![[0, 1, 2], [2, 1, 3]]));
    assert_eq!(of_mode(6), Ok(vec![[0, 1, 2], [0, 2, 3]]));
    assert_eq!(of_mode(1), Ok(vec![]));
    assert_eq!(of_mode(7), Err("a primitive has mode 7, but the last is 6".into()));
}

#[test]
fn quantized_points_are_read() {
    let points: Vec<u8> =
        [[0i16, 0, 0], [32767, 0, 0], [0, -32768, 0]].as_flattened().iter().flat_map(|x| x.to_le_bytes()).collect();
    let json = r#"{"asset":{"version":"2.0"},"extensionsRequired":["KHR_mesh_quantization"],"nodes":[{"mesh":0}],
        "meshes":[{"primitives":[{"attributes":{"POSITION":0}}]}],
        "accessors":[{"bufferView":0,"componentType":5122,"normalized":true,"count":3,"type":"VEC3"}],
        "bufferViews":[{"buffer":0,"byteLength":18}],"buffers":[{"byteLength":18}]}"#;
    assert_eq!(read_glb(json, &points).vertices, [[0.0; 3], [1.0, 0.0, 0.0], [0.0, -1.0, 0.0]]);
}

#[test]
fn the_hash_covers_the_buffer_beside() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.gltf");
    let buffer = folder.path().join("a b.bin");
    fs::write(&path, cube_gltf("\"uri\":\"a%20b.bin\",")).unwrap();
    let missing = load(&path, MeshReadOptions::default()).unwrap_err();
    assert!(missing.to_string().ends_with("a.gltf: names the buffer `a b.bin`, which is not there"), "{missing}");
    assert!(missing.help().contains("export one .glb"), "{}", missing.help());
    let two = cube_gltf("\"uri\":\"a%20b.bin\",")
        .replace("\"buffers\":[", "\"buffers\":[{\"uri\":\"c.bin\",\"byteLength\":1},");
    fs::write(folder.path().join("two.gltf"), two).unwrap();
    let missing = load(&folder.path().join("two.gltf"), MeshReadOptions::default()).unwrap_err().to_string();
    assert!(missing.ends_with("names 2 buffers that are not there: `c.bin`, `a b.bin`"), "{missing}");
    fs::write(&buffer, cube_buffer()).unwrap();
    let first = load(&path, 2.0).unwrap();
    assert_eq!(first.mesh, parse(&glb(&cube_gltf(""), &cube_buffer()), Format::Gltf, 2.0).unwrap().0);
    let mut longer = cube_buffer();
    longer.push(0);
    fs::write(&buffer, longer).unwrap();
    let second = load(&path, 2.0).unwrap();
    assert_eq!(first.mesh, second.mesh);
    assert_ne!(first.sha256, second.sha256);
}

#[test]
fn nodes_are_parts() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.glb");
    let json = edited(
        r#""nodes":[{"name":"cube","mesh":0}]"#,
        r#""nodes":[{"name":"cube","mesh":0},{"name":"cube","mesh":0}]"#,
    );
    fs::write(&path, glb(&json.replace("\"nodes\":[0]", "\"nodes\":[0,1,0]"), &cube_buffer())).unwrap();
    let parts = load_parts(&path, 1.0).unwrap();
    let names: Vec<&str> = parts.iter().map(|(name, _)| name.as_str()).collect();
    assert_eq!(names, ["cube", "cube-2"]);
    assert_eq!(parts[0].1.mesh, parts[1].1.mesh);
}

#[test]
fn what_is_not_read_is_said() {
    let json = cube_gltf("");
    let with = |piece: &str| json.replacen('{', &format!("{{{piece},"), 1);
    for (json, expected) in [
        (
            with(r#""extensionsRequired":["KHR_draco_mesh_compression"]"#),
            "requires the extension KHR_draco_mesh_compression, which is not read",
        ),
        (json.replace("2.0", "1.0"), "is glTF 1.0, of which 2.0 is read"),
        (json.replace("\"mesh\":0}", "\"mesh\":0,\"skin\":0}"), "node 0 has a skin, whose pose is not read"),
        (json.replace("\"mesh\":0}", "\"mesh\":1}"), "node 0 refers to mesh 1, but there are 1"),
        (json.replace("\"mesh\":0}", "\"mesh\":0,\"children\":[0]}"), "node 0 is the child of two nodes, or of itself"),
        (json.replace("\"nodes\":[0]", "\"nodes\":[7]"), "refers to node 7, but has 1"),
        (
            json.replace("\"count\":36", "\"count\":999999999"),
            "says 999999999 elements in accessor 1 but has room for 36",
        ),
        (json.replace("\"byteLength\":168", "\"byteLength\":169"), "says 169 bytes in buffer 0 but has room for 168"),
        (json.replace("\"count\":8", "\"count\":7"), "face refers to vertex 7, but the file has 7 in this primitive"),
        (json.replace("VEC3", "VEC2"), "accessor 0 is `VEC2`, not VEC3"),
        (json.replace("\"byteLength\":168", "\"uri\":\"x.bin\",\"byteLength\":168"), "names another file, `x.bin`"),
        (
            json.replace("\"byteLength\":168", "\"uri\":\"http://a/x.bin\",\"byteLength\":168"),
            "names the buffer `http://a/x.bin`, which is on the web",
        ),
    ] {
        assert_eq!(failure(&json, &cube_buffer()), expected);
    }
    let error = read(b"{\n\"asset\": 5}", &mut Resources::none()).err().unwrap().to_string();
    assert!(error.starts_with("line 2: is not glTF: "), "{error}");
}
