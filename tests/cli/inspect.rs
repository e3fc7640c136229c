//! `gelsim inspect`: what it prints, what `--json` holds, and how it ends.

use serde_json::Value;

use crate::support::{Folder, repository};

/// A mug of 9 cm whose coordinates are metres.
fn mug(folder: &Folder) {
    let around = |i: u32| (std::f64::consts::TAU * f64::from(i) / 12.0).sin_cos();
    let ring =
        |z: f64| (0..12).map(move |i| (around(i), z)).map(|((y, x), z)| format!("v {} {} {z}\n", 0.04 * x, 0.04 * y));
    let mut text: String = ring(0.0).chain(ring(0.09)).collect();
    text += "v 0 0 0\n";
    for i in 0..12 {
        let next = (i + 1) % 12;
        text += &format!("f {} {} {} {}\nf {} {} 25\n", i + 1, next + 1, next + 13, i + 13, next + 1, i + 1);
    }
    folder.write("mug.obj", text);
}

fn stdout(folder: &Folder, arguments: &str, status: i32) -> (String, String) {
    let assert = folder.gelsim(arguments).assert().code(status);
    let [out, err] = [&assert.get_output().stdout, &assert.get_output().stderr];
    (String::from_utf8_lossy(out).into_owned(), String::from_utf8_lossy(err).into_owned())
}

#[test]
fn a_sound_mesh_gets_a_block_with_its_figures_and_nothing_to_note() {
    let folder = Folder::new();
    let (text, err) = stdout(&folder, "inspect cube.obj", 0);
    assert_eq!(err, "");
    for line in [
        "against gelsight-2014: 640 x 480 px on 20 x 15 mm, 0.0312 mm/px, pad 3 mm thick",
        "cube.obj",
        "  size     5 x 5 x 5 mm around (0, 0, 2.5), unit \"mm\"",
        "  as unit  mm: 5 mm, cm: 50 mm, m: 5000 mm (unlikely), in: 127 mm",
        "  mesh     12 triangles, 8 vertices (in the file 12 and 8)",
        "  surface  1 part, 1 closed, 0 holes",
        "  ok       nothing to act on",
    ] {
        assert!(text.lines().any(|printed| printed == line), "{line}\n{text}");
    }
    assert!(text.lines().any(|line| line.starts_with("  -z* ") && line.contains("160 x 160")), "{text}");
    let (mini, _) = stdout(&folder, "inspect cube.obj --sensor gelsight-mini", 0);
    assert!(mini.starts_with("against gelsight-mini: 320 x 240 px on 18.6 x 14.3 mm"), "{mini}");
}

#[test]
fn a_mug_in_metres_is_warned_of_and_strict_ends_with_1() {
    let folder = Folder::new();
    mug(&folder);
    let (text, err) = stdout(&folder, "inspect mug.obj", 0);
    assert!(text.contains("warning  0.09 mm long") && text.contains("look like metres (90 mm)"), "{text}");
    assert!(text.contains("-> if they are, write unit = \"m\" under [[object]] (here: --unit m)"), "{text}");
    assert_eq!(err, "");
    let (_, err) = stdout(&folder, "inspect mug.obj --strict", 1);
    assert_eq!(err, "error: errors or warnings in 1 of 1 mesh\n");
    let (text, _) = stdout(&folder, "inspect mug.obj --strict --unit m", 0);
    assert!(text.contains("1 hole with 12 open edges") && !text.contains("warning"), "{text}");
}

#[test]
fn a_file_that_cannot_be_used_does_not_keep_the_others_from_being_inspected() {
    let folder = Folder::new();
    folder.write("bad.obj", "v 0 0 0\nf 1 2 3\n");
    folder.write("notes.txt", "a mug\n");
    folder.write("a b\n.stl", "solid\nendsolid\n");
    let assert = folder.gelsim("inspect bad.obj no.stl cube.obj notes.txt").arg("a b\n.stl").assert().code(1);
    let text = String::from_utf8_lossy(&assert.get_output().stdout);
    for line in [
        "  error    line 2: face refers to vertex 2, but the file has 1 so far",
        "  error    cannot be read: No such file or directory",
        "  error    is not named like a mesh: use .obj, .stl, .ply, .off, .glb, .gltf, .dae, .3mf or .urdf",
        "a b\\n.stl",
        "  error    no triangle",
        "  ok       nothing to act on",
        "5 meshes: 1 ok, 0 with notes, 0 with warnings, 4 with errors",
    ] {
        assert!(text.lines().any(|printed| printed == line), "{line}\n{text}");
    }
    assert_eq!(String::from_utf8_lossy(&assert.get_output().stderr), "error: errors in 4 of 5 meshes\n");
}

#[test]
fn json_holds_the_same_for_tools() {
    let folder = Folder::new();
    mug(&folder);
    let (text, _) = stdout(&folder, "inspect cube.obj mug.obj no.stl --json", 1);
    let report: Value = serde_json::from_str(&text).expect("one JSON value");
    assert_eq!(report["pad"]["sensor"], "gelsight-2014");
    assert_eq!(report["pad"]["resolution_px"], serde_json::json!([640, 480]));
    let [cube, mug, missing] = [0, 1, 2].map(|k| &report["meshes"][k]);
    assert_eq!((&cube["file"], &cube["severity"]), (&Value::from("cube.obj"), &Value::from("ok")));
    assert_eq!(cube["mesh"]["size_mm"], serde_json::json!([5.0, 5.0, 5.0]));
    assert_eq!(cube["mesh"]["given"]["format"], "obj");
    assert_eq!(cube["mesh"]["sha256"].as_str().map(str::len), Some(64));
    let sides: Vec<&Value> =
        cube["mesh"]["sides"].as_array().expect("sides").iter().map(|side| &side["face"]).collect();
    assert_eq!(sides, ["-x", "+x", "-y", "+y", "-z", "+z"]);
    assert_eq!(cube["mesh"]["sides"][0]["anchor"], "bounds");
    // Lengths are floats for every reader, whole or not.
    assert!(text.contains("\"size_mm\":[5.0,5.0,5.0]"), "{text}");
    assert_eq!((&mug["severity"], &mug["findings"][0]["kind"]), (&Value::from("warning"), &Value::from("unit")));
    let metres = &mug["mesh"]["readings"][2];
    assert_eq!((&metres["unit"], &metres["plausible"]), (&Value::from("m"), &Value::from(true)));
    assert_eq!((&missing["mesh"], &missing["findings"][0]["severity"]), (&Value::Null, &Value::from("error")));
}

#[test]
fn the_side_that_auto_takes_is_the_one_that_a_job_presses() {
    let folder = Folder::new();
    for (mesh, face) in [("sphere", "-z"), ("gear", "-z"), ("key", "-z"), ("coin", "-z")] {
        let bundled = repository().join("objects").join(format!("{mesh}.obj"));
        // Turned over and on its side, too: x to y, y to z, z to x.
        let text = std::fs::read_to_string(bundled).expect("a bundled mesh");
        let turned = |line: &str| match line.strip_prefix("v ").map(|rest| rest.split(' ').collect::<Vec<_>>()) {
            Some(v) => format!("v {} {} {}\n", v[2], v[0], v[1]),
            None => format!("{line}\n"),
        };
        folder.write("turned.obj", text.lines().map(turned).collect::<String>());
        folder.write("plain.obj", text);
        for name in ["plain", "turned"] {
            let (json, _) = stdout(&folder, &format!("inspect {name}.obj --json --sensor gelsight-mini"), 0);
            let report: Value = serde_json::from_str(&json).expect("JSON");
            let auto = report["meshes"][0]["mesh"]["auto_face"].as_str().expect("a side").to_owned();
            let job = format!(
                "dataset = {{ name = \"auto\", samples = 1 }}\nsensor = {{ preset = \"gelsight-mini\", resolution_px = [48, 36] }}\npose.face = \"auto\"\n\
                 indentation.depth_mm = 0.2\nobject = [{{ path = \"{name}.obj\" }}]\n"
            );
            folder.write("auto.toml", job);
            let (said, _) = stdout(&folder, "plan auto.toml --quiet", 0);
            assert!(
                said.contains(&format!("presses the sides with the most relief: {auto} of {name}")),
                "{auto}: {said}"
            );
            let (table, _) = stdout(&folder, &format!("inspect {name}.obj --sensor gelsight-mini"), 0);
            let marked: Vec<&str> =
                table.lines().filter(|line| line.trim_start().starts_with(&format!("{auto}* "))).collect();
            assert!(marked.len() == 1 && table.contains("* face = \"auto\" presses this side"), "{table}");
            assert!(name == "turned" || auto == face, "{mesh}: {auto}");
        }
    }
}

#[test]
fn a_wrong_command_line_ends_with_2() {
    let folder = Folder::new();
    for arguments in ["inspect", "inspect cube.obj --unit foot", "inspect cube.obj --sensor digits"] {
        let text = folder.fail(arguments, 2);
        assert!(text.contains("error: "), "{text}");
    }
    assert!(folder.fail("inspect cube.obj --sensor digits", 2).contains("gelsight-2014"));
}

#[test]
fn the_bundled_meshes_have_nothing_to_note() {
    let folder = Folder::new();
    let mut command = folder.gelsim("inspect");
    for mesh in ["bolt", "gear", "key", "sphere", "thin_ridge", "washer"] {
        command.arg(repository().join("objects").join(format!("{mesh}.obj")));
    }
    let assert = command.assert().success();
    let text = String::from_utf8_lossy(&assert.get_output().stdout).into_owned();
    assert!(text.ends_with("6 meshes: 6 ok, 0 with notes, 0 with warnings, 0 with errors\n"), "{text}");
}

#[test]
fn a_folder_gets_a_table_with_the_worst_first() {
    let folder = Folder::new();
    std::fs::create_dir_all(folder.path("set/deeper")).expect("a folder");
    mug(&folder);
    for (from, to) in [("cube.obj", "set/cube.obj"), ("cone.obj", "set/deeper/cone.obj"), ("mug.obj", "set/mug.obj")] {
        std::fs::copy(folder.path(from), folder.path(to)).expect("a copy");
    }
    folder.write("set/bad.stl", "solid\nendsolid\n");
    folder.write("set/readme.txt", "no mesh");
    let (text, err) = stdout(&folder, "inspect set", 1);
    assert_eq!(err, "error: errors in 1 of 4 meshes\n");
    let (table, findings) = text.split_once("\n\nerror: ").expect("findings below the table");
    assert!(findings.starts_with("set/bad.stl: no triangle") && findings.contains("= help: "), "{findings}");
    assert!(findings.contains("warning: set/mug.obj: 0.09 mm long") && findings.contains("unit = \"m\""), "{findings}");
    let rows: Vec<&str> = table.lines().filter(|line| line.contains("set/")).collect();
    let names = ["set/bad.stl", "set/mug.obj", "set/cube.obj", "set/deeper/cone.obj"];
    assert_eq!(rows.len(), names.len(), "{text}");
    assert!(rows.iter().zip(names).all(|(row, name)| row.contains(name)), "{text}");
    assert!(rows[0].starts_with("error ") && rows[0].ends_with("set/bad.stl: no triangle"), "{text}");
    assert!(rows[1].starts_with("warning") && rows[1].contains(" no     m "), "{text}");
    assert!(rows[2].starts_with("ok ") && rows[2].contains("5 x 5 x 5        12 yes    mm "), "{text}");
    assert!(text.contains("4 meshes: ") && text.contains("units: mm 2, m 1"), "{text}");

    let (of_pattern, _) = stdout(&folder, "inspect set/*.obj", 0);
    assert!(of_pattern.contains("\n2 meshes: "), "{of_pattern}");
    std::fs::create_dir_all(folder.path("empty")).expect("a folder");
    assert!(folder.fail("inspect empty", 2).contains("there is no mesh in empty"));
}
