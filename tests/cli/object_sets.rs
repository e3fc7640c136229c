//! Sets of objects as they lie on disk: `gelsim init --objects` takes one mesh of each object, in the right unit and
//! with a name that means something, and the lines of the docs do the same. The sets are small stand-ins.

use std::collections::BTreeSet;
use std::fs;

use toml::{Table, Value};

use crate::support::{Folder, JOB, gltf, repository};

/// Some files of a stand-in.
fn write(folder: &Folder, name: &str, content: impl AsRef<[u8]>) {
    fs::create_dir_all(folder.path(name).parent().expect("a folder")).expect("a folder");
    folder.write(name, content);
}

/// Vertices of a bundled mesh, so many times as large, and its faces.
fn scaled(mesh: &str, by: f64) -> (Vec<[f64; 3]>, Vec<Vec<usize>>) {
    let text = fs::read_to_string(repository().join("objects").join(format!("{mesh}.obj"))).expect("a bundled mesh");
    let rows = |letter: &'static str| text.lines().filter_map(move |line| line.strip_prefix(letter));
    let vertex = |row: &str| {
        let xyz: Vec<f64> = row.split_whitespace().map(|word| by * word.parse::<f64>().expect("a number")).collect();
        [xyz[0], xyz[1], xyz[2]]
    };
    let corner = |word: &str| word.split('/').next().and_then(|number| number.parse().ok()).expect("a vertex");
    let face = |row: &str| row.split_whitespace().map(corner).collect();
    (rows("v ").map(vertex).collect(), rows("f ").map(face).collect())
}

fn obj(mesh: &str, by: f64) -> String {
    let (vertices, faces) = scaled(mesh, by);
    let vertices = vertices.iter().map(|[x, y, z]| format!("v {x} {y} {z}\n"));
    let names = |face: &Vec<usize>| face.iter().map(usize::to_string).collect::<Vec<_>>().join(" ");
    let faces = faces.iter().map(|face| format!("f {}\n", names(face)));
    format!("mtllib textured.mtl\n{}", vertices.chain(faces).collect::<String>())
}

fn ply(mesh: &str, by: f64) -> String {
    let (vertices, faces) = scaled(mesh, by);
    let mut text = format!(
        "ply\nformat ascii 1.0\nelement vertex {}\nproperty float x\nproperty float y\nproperty float z\n\
         element face {}\nproperty list uchar int vertex_indices\nend_header\n",
        vertices.len(),
        faces.len()
    );
    vertices.iter().for_each(|[x, y, z]| text += &format!("{x} {y} {z}\n"));
    for face in &faces {
        let names: Vec<String> = face.iter().map(|corner| (corner - 1).to_string()).collect();
        text += &format!("{} {}\n", face.len(), names.join(" "));
    }
    text
}

fn stl(mesh: &str, by: f64) -> String {
    let (vertices, faces) = scaled(mesh, by);
    let corner = |at: &usize| vertices[at - 1].map(|x| x.to_string()).join(" ");
    let facet = |face: &Vec<usize>| {
        let corners: String = face[..3].iter().map(|at| format!("vertex {}\n", corner(at))).collect();
        format!("facet normal 0 0 0\nouter loop\n{corners}endloop\nendfacet\n")
    };
    format!("solid {mesh}\n{}endsolid\n", faces.iter().map(facet).collect::<String>())
}

fn glb(length: f32) -> Vec<u8> {
    let mut json = gltf(length).into_bytes();
    json.resize(json.len().next_multiple_of(4), b' ');
    let size = |bytes: usize| (bytes as u32).to_le_bytes();
    [&b"glTF\x02\0\0\0"[..], &size(20 + json.len()), &size(json.len()), b"JSON", &json].concat()
}

const COMPANION: &[u8] = b"\0\x05\x16\x07\0\x02\0\0Mac OS X";

/// Metres, from objects of a few mm as if they were ten times as large.
const METRES: f64 = 0.01;

/// Writes a stand-in of a set, and returns the classes that its objects should have.
fn stand_in(folder: &Folder, set: &str) -> Vec<String> {
    let names = |names: &[&str]| names.iter().map(|name| (*name).to_owned()).collect();
    match set {
        "YCB" => {
            for (object, mesh) in [("002_master_chef_can", "cylinder"), ("025_mug", "torus"), ("072-a_toy", "gear")] {
                for form in ["google_16k", "poisson", "tsdf"] {
                    // Each way of reconstruction gives another size.
                    let by = METRES * [1.0, 1.1][usize::from(form == "tsdf")];
                    let file = |name: &str| format!("ycb/{object}/{form}/{name}");
                    write(folder, &file("textured.obj"), obj(mesh, by));
                    write(folder, &file("nontextured.ply"), ply(mesh, by));
                    write(folder, &file("nontextured.stl"), stl(mesh, by));
                    write(folder, &file("textured.mtl"), "newmtl material_0\nmap_Kd texture_map.png\n");
                    write(folder, &file("texture_map.png"), b"\x89PNG\r\n\x1a\n");
                    write(folder, &file("kinbody.xml"), "<KinBody/>");
                    write(folder, &file("._textured.obj"), COMPANION);
                }
            }
            write(folder, "ycb/README.md", "# YCB");
            names(&["002_master_chef_can", "025_mug", "072-a_toy"])
        }
        "YCB-V and other sets of BOP" => {
            for (number, mesh) in [(1, "cylinder"), (2, "torus"), (3, "gear")] {
                for models in ["models", "models_eval", "models_fine"] {
                    let by = if models == "models_eval" { 9.97 } else { 10.0 };
                    write(folder, &format!("ycbv/{models}/obj_00000{number}.ply"), ply(mesh, by));
                }
                write(folder, &format!("ycbv/models/obj_00000{number}.png"), b"\x89PNG\r\n\x1a\n");
            }
            write(folder, "ycbv/models/models_info.json", "{}");
            names(&["obj_000001", "obj_000002", "obj_000003"])
        }
        "Google Scanned Objects" => {
            for (object, mesh) in [("ACE_Coffee_Mug_Kristen_16_oz_cup", "torus"), ("Weisshai_Great_White_Shark", "key")]
            {
                let file = |name: &str| format!("gso/{object}/{name}");
                write(folder, &file("meshes/model.obj"), obj(mesh, METRES));
                write(folder, &file("meshes/model.mtl"), "newmtl material_0\n");
                write(folder, &file("materials/textures/texture.png"), b"\x89PNG\r\n\x1a\n");
                write(folder, &file("model.sdf"), "<sdf version='1.6'/>");
                write(folder, &file("model.config"), "<model/>");
                write(folder, &file("metadata.pbtxt"), "name: \"a\"\n");
                write(folder, &file("thumbnails/0.jpg"), b"\xff\xd8\xff");
            }
            names(&["ACE_Coffee_Mug_Kristen_16_oz_cup", "Weisshai_Great_White_Shark"])
        }
        "ABC" => {
            let stem = |number: usize| format!("{number:08}_{:024x}_trimesh_000", 7 * number + 1);
            for number in 0..20 {
                let by = 0.004 * 1.8_f64.powi(number as i32);
                let file = format!("abc/abc_{:04}_obj_v00/{number:08}/{}.obj", number / 10, stem(number));
                write(folder, &file, obj("cube", by));
                write(folder, &file.replace("obj", "stl2").replace(".stl2", ".stl"), stl("cube", by));
            }
            (0..20).map(stem).collect()
        }
        "Objaverse 1.0" => {
            let uids =
                ["08f2e59000fb4aeaa73593c7390c085d", "1140ecf7554d4414bb4ec5692a797aea", "138c9d2de9e64df980aa7f26"];
            for (at, (uid, length)) in uids.iter().zip([0.05, 1.7, 250.0]).enumerate() {
                write(folder, &format!("hf-objaverse-v1/glbs/000-{at:03}/{uid}.glb"), glb(length));
            }
            write(folder, "hf-objaverse-v1/object-paths.json.gz", b"\x1f\x8b");
            names(&uids)
        }
        "EGAD" => {
            for (name, mesh) in [("A0", "sphere"), ("B3", "gear"), ("G6", "bolt")] {
                write(folder, &format!("egad_eval_set/{name}.obj"), obj(mesh, 6.0));
                write(folder, &format!("egad_eval_set/._{name}.obj"), COMPANION);
            }
            names(&["A0", "B3", "G6"])
        }
        "Dex-Net" => {
            for (name, mesh) in [("3dnet/mug", "torus"), ("3dnet/bolt", "bolt"), ("kit/Amicelli", "brick")] {
                write(folder, &format!("dexnet/{name}.obj"), obj(mesh, METRES));
                write(folder, &format!("dexnet/{name}.sdf"), "100 100 100\n");
            }
            names(&["Amicelli", "bolt", "mug"])
        }
        _ => panic!("there is no stand-in of {set}"),
    }
}

/// The rows of the table of sets in the docs: the set, and the `[[object]]` that presses it.
fn documented() -> Vec<(String, String)> {
    let page = fs::read_to_string(repository().join("docs/reference/objects.md")).expect("the page");
    let section = page.split("## Sets of objects").nth(1).expect("the section").split("\n## ").next().expect("a text");
    let rows = section.lines().filter(|line| line.starts_with('|') && line.contains("path = "));
    let row = |line: &str| {
        let cells: Vec<&str> = line.split('|').map(str::trim).collect();
        let keys: Vec<&str> = cells[3].split('`').skip(1).step_by(2).collect();
        (cells[1].to_owned(), format!("[[object]]\n{}\n", keys.join("\n")))
    };
    rows.map(row).collect()
}

fn objects(job: &str) -> Vec<Table> {
    let job: Table = job.parse().expect("TOML");
    let table = |object: &Value| object.as_table().expect("a table").clone();
    job["object"].as_array().expect("objects").iter().map(table).collect()
}

/// The classes that a dataset of the job has; `plan` must have no error and no warning.
fn classes(folder: &Folder, job: &str, samples: usize) -> BTreeSet<String> {
    let said = folder.succeed(&format!("plan {job} --set sensor.resolution_px=[48,36]"));
    assert!(!said.contains("warning") && !said.contains("error"), "{said}");
    let out = job.replace(".toml", "");
    folder.succeed(&format!(
        "generate {job} --quiet --samples {samples} --set sensor.resolution_px=[48,36] --fidelity draft --out {out}"
    ));
    let labels = folder.labels(&out);
    for label in labels.values() {
        assert!(label["contact"]["force_n"].as_f64().is_some_and(|force| force > 0.0), "{label}");
    }
    labels.values().map(|label| label["object"]["class"].as_str().expect("a class").to_owned()).collect()
}

#[test]
fn init_and_the_docs_take_one_mesh_of_each_object_of_a_set() {
    let sets = documented();
    assert_eq!(sets.len(), 7, "{sets:?}");
    for (set, documented) in &sets {
        let folder = Folder::new();
        let expected: BTreeSet<String> = stand_in(&folder, set).into_iter().collect();
        let root = expected_root(documented);
        let said = folder.succeed(&format!("init --objects {root} job.toml"));
        assert!(!said.contains("warning"), "{set}: {said}");
        let job = folder.read("job.toml");
        let [written, documented] = [objects(&job), objects(documented)];
        let [written, documented] = [&written[..], &documented[..]].map(|objects| {
            let [object] = objects else { panic!("{set}: {job}") };
            object.clone()
        });
        assert_eq!(written["path"], documented["path"], "{set}");
        // The docs skip files that some copies of a set have, and this one has not.
        let keys = |object: &Table| object.keys().filter(|key| *key != "on_bad").cloned().collect::<BTreeSet<_>>();
        assert_eq!(keys(&written), keys(&documented), "{set}: {job}");
        for key in ["unit", "class_from"] {
            assert_eq!(written.get(key), documented.get(key), "{set}: {key}");
        }
        let count = 2 * expected.len();
        assert_eq!(classes(&folder, "job.toml", count), expected, "{set}: {job}");
        let start = job.find("[[object]]").expect("objects");
        let end = job.find("[pose]").expect("a pose");
        folder.write("docs.toml", format!("{}[[object]]\n{documented}\n{}", &job[..start], &job[end..]));
        assert_eq!(classes(&folder, "docs.toml", count), expected, "{set}: {documented}");
    }
}

/// The folder that a set lies in.
fn expected_root(object: &str) -> &str {
    object.split('"').nth(1).and_then(|path| path.split('/').next()).expect("a path")
}

#[test]
fn an_object_that_lacks_the_usual_form_is_pressed_in_another() {
    let folder = Folder::new();
    stand_in(&folder, "YCB");
    fs::remove_dir_all(folder.path("ycb/025_mug/google_16k")).expect("a folder");
    let said = folder.succeed("init --objects ycb job.toml");
    // Eight folders of three meshes each, of which three are taken.
    assert!(said.contains("21 meshes are left out, such as 002_master_chef_can/google_16k/nontextured.ply"), "{said}");
    let job = folder.read("job.toml");
    let tables = objects(&job);
    let paths: Vec<&str> = tables.iter().filter_map(|object| object["path"].as_str()).collect();
    assert_eq!(paths, ["ycb/*/google_16k/textured.obj", "ycb/025_mug/poisson/textured.obj"], "{job}");
    let expected = ["002_master_chef_can", "025_mug", "072-a_toy"].map(str::to_owned);
    assert_eq!(classes(&folder, "job.toml", 6), expected.into());
}

#[test]
fn meshes_of_the_same_name_that_differ_are_all_pressed_and_collision_shapes_are_not() {
    let folder = Folder::new();
    for (class, mesh) in [("round", "cylinder"), ("square", "cube")] {
        for number in 1..4 {
            write(&folder, &format!("mine/{class}/00{number}.stl"), stl(mesh, f64::from(number)));
        }
        write(&folder, &format!("mine/{class}/collision/001.stl"), stl("cone", 1.0));
        write(&folder, &format!("mine/{class}/001_vhacd.obj"), obj("cone", 1.0));
    }
    let said = folder.succeed("init --objects mine job.toml");
    assert!(said.contains("4 meshes are left out"), "{said}");
    assert!(said.contains("such as round/001_vhacd.obj"), "{said}");
    let job = folder.read("job.toml");
    let [object] = &objects(&job)[..] else { panic!("{job}") };
    assert_eq!(object["path"].as_str(), Some("mine/*/*.stl"), "{job}");
    assert_eq!(classes(&folder, "job.toml", 12), ["round", "square"].map(str::to_owned).into());
    // Where there is nothing else, they are what is meant.
    write(&folder, "only/a_vhacd.obj", obj("cone", 1.0));
    folder.succeed("init --objects only only.toml");
    assert!(folder.read("only.toml").contains("path = \"only/*.obj\""), "{}", folder.read("only.toml"));
}

#[test]
fn one_object_that_is_too_large_for_the_sensor_does_not_change_the_unit_of_a_set() {
    let folder = Folder::new();
    // The spatula of YCB is 35 cm long.
    for (name, length) in [("fork", 0.2), ("pear", 0.1), ("spatula", 0.35), ("shelf", 0.7)] {
        write(&folder, &format!("m/{name}.obj"), obj("cube", length / 5.0));
    }
    folder.succeed("init --sensor digit --objects m job.toml");
    let job = folder.read("job.toml");
    let [object] = &objects(&job)[..] else { panic!("{job}") };
    assert_eq!(object["unit"].as_str(), Some("m"), "{job}");
}

#[test]
fn usd_is_refused_with_a_way_out() {
    let folder = Folder::new();
    for (name, content) in [
        ("a.usd", &b"#usda 1.0\n"[..]),
        ("a.usda", b"#usda 1.0\n"),
        ("a.usdc", b"PXR-USDC\0\0"),
        ("a.usdz", b"PK\x03\x04"),
        ("renamed.obj", b"PXR-USDC\0\0"),
    ] {
        folder.write(name, content);
        folder.write("job.toml", JOB.replace("cube.obj", name));
        let said = folder.fail("plan job.toml", 2);
        assert!(said.contains(name) && said.contains("open it in Blender") && said.contains("usd_import"), "{said}");
    }
}
