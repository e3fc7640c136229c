//! What `[[object]]` names: classes from folders, parts, scales, meshes that are left out, and what labels say of them.

use std::collections::{BTreeMap, BTreeSet};
use std::fs;
use std::os::unix::ffi::OsStrExt;

use serde_json::Value;

use crate::support::{Folder, JOB, archive, assert_same_files, edited};

/// The job with these tables for its objects.
fn job(objects: &str) -> String {
    let start = JOB.find("[[object]]").expect("objects");
    let end = JOB.find("[pose]").expect("a pose");
    format!("{}{objects}\n\n{}", &JOB[..start], &JOB[end..])
}

/// A folder with `from` copied to each of `to`.
fn copies(from: &str, to: &[&str]) -> Folder {
    let folder = Folder::new();
    for name in to {
        let path = folder.path(name);
        fs::create_dir_all(path.parent().expect("a folder")).expect("a folder");
        fs::copy(folder.path(from), path).expect("a copy");
    }
    folder
}

fn field<'a>(label: &'a Value, key: &str) -> &'a str {
    label["object"][key].as_str().unwrap_or_else(|| panic!("{key} in {label}"))
}

/// Class and path of each object, as the labels say.
fn classes(folder: &Folder, out: &str) -> BTreeMap<String, String> {
    folder.labels(out).values().map(|label| (field(label, "path").into(), field(label, "class").into())).collect()
}

#[test]
fn folders_name_classes_where_files_share_a_name_and_labels_give_paths() {
    let folder = copies("cube.obj", &["ycb/1_can/g/n.obj", "ycb/2_mug/g/n.obj"]);
    let text = job("[[object]]\npath = \"ycb/*/g/n.obj\"\n[[object]]\npath = \"cone.obj\"");
    folder.write("job.toml", &text);
    let said = folder.succeed("generate job.toml");
    assert!(said.contains("2 meshes are called `n`") && said.contains("class_from = \"stem\""), "{said}");
    let expected = [("cone.obj", "cone"), ("ycb/1_can/g/n.obj", "1_can"), ("ycb/2_mug/g/n.obj", "2_mug")];
    assert_eq!(classes(&folder, "out/small"), expected.map(|(path, class)| (path.into(), class.into())).into());

    for (from, expected) in [("stem", "n"), ("file", "n.obj")] {
        folder.write("job.toml", text.replacen("n.obj\"\n", &format!("n.obj\"\nclass_from = \"{from}\"\n"), 1));
        let said = folder.succeed(&format!("generate job.toml --out {from}"));
        assert!(!said.contains("are called"), "{said}");
        assert_eq!(classes(&folder, from)["ycb/1_can/g/n.obj"], expected);
    }
    folder.write("job.toml", text.replacen("n.obj\"\n", "n.obj\"\nclass_from = \"folder\"\n", 1));
    folder.succeed("generate job.toml --out folders");
    assert_eq!(classes(&folder, "folders")["ycb/2_mug/g/n.obj"], "2_mug");
}

#[test]
fn a_sample_is_made_again_whatever_its_object_is() {
    let folder = copies("cube.obj", &["m/a/n.obj", "m/b/n.obj"]);
    folder.write("two.obj", "o lid\nv 0 0 0\nv 5 0 0\nv 0 5 0\nf 1 2 3\no pot/x\nv 0 0 1\nv 5 0 1\nv 0 5 2\nf 4 5 6\n");
    folder.write(
        "job.toml",
        job("[[object]]\npath = \"m/*/n.obj\"\nscale = [0.5, 1.5]\n[[object]]\npath = \"two.obj\"\nparts = \"separate\""),
    );
    folder.succeed("generate job.toml");
    let labels = folder.labels("out/small");
    let seen: BTreeSet<&str> = labels.values().map(|label| field(label, "id")).collect();
    assert!(seen.is_subset(&["n", "n-2", "two/lid", "two/pot/x"].into()) && seen.len() > 1, "{seen:?}");
    for label in labels.values() {
        let scale = label["object"]["scale"].as_f64().expect("a scale");
        let is_scaled = field(label, "path").starts_with("m/");
        assert!(if is_scaled { (0.5..1.5).contains(&scale) && scale != 1.0 } else { scale == 1.0 }, "{label}");
    }
    for key in labels.keys() {
        folder.gelsim(&format!("reproduce out/small {key}")).assert().success();
    }
    folder.gelsim("verify out/small").assert().success();
}

/// A line of an OBJ, this many times as large.
fn scaled(line: &str, by: f64) -> String {
    let Some(numbers) = line.strip_prefix("v ") else { return format!("{line}\n") };
    let numbers = numbers.split(' ').map(|x| (by * x.parse::<f64>().expect("a number")).to_string());
    format!("v {}\n", numbers.collect::<Vec<_>>().join(" "))
}

#[test]
fn a_scale_is_the_same_as_a_larger_mesh() {
    let folder = Folder::new();
    let text: String = folder.read("cube.obj").lines().map(|line| scaled(line, 2.0)).collect();
    folder.write("twice.obj", text);
    let of = |object: &str, out: &str| {
        folder.write("job.toml", job(&format!("[[object]]\nclass = \"c\"\n{object}")));
        folder.succeed(&format!("generate job.toml --out {out}"));
        folder.samples(out)
    };
    let (scaled, large) = (of("path = \"cube.obj\"\nscale = 2.0", "scaled"), of("path = \"twice.obj\"", "large"));
    for (key, members) in &scaled {
        assert_eq!(members["depth.exr"], large[key]["depth.exr"], "{key}");
    }
}

#[test]
fn parts_are_objects_of_their_own_or_one_of_them_is() {
    let folder = Folder::new();
    folder.write("two.obj", "g a\nv 0 0 0\nv 5 0 0\nv 0 5 0\nf 1 2 3\ng b\nv 0 0 1\nv 5 0 1\nv 0 5 2\nf 4 5 6\n");
    folder.write("job.toml", job("[[object]]\npath = \"two.obj\"\npart = \"b\""));
    folder.succeed("generate job.toml");
    assert!(folder.labels("out/small").values().all(|label| field(label, "class") == "two/b"));
    folder.write("job.toml", job("[[object]]\npath = \"two.obj\"\npart = \"c\""));
    let error = folder.fail("generate job.toml --out no", 2);
    assert!(error.contains("two.obj has no part `c`") && error.contains("its parts: a, b"), "{error}");
    // Parts are different objects, though their file is one.
    let split = edited(
        &job("[[object]]\npath = \"two.obj\"\nparts = \"separate\""),
        &[(
            "splits = { train = 0.5, val = 0.25, test = 0.25 }",
            "split_by = \"object\"\nsplits = { train = 0.5, val = 0.5 }",
        )],
    );
    folder.write("job.toml", split);
    folder.succeed("generate job.toml --out split");
    let of_split = |split: &str| -> BTreeSet<String> {
        let labels = folder.labels("split");
        labels.values().filter(|label| label["split"] == split).map(|label| field(label, "class").into()).collect()
    };
    assert_eq!((of_split("train").len(), of_split("val").len()), (1, 1));
    assert_ne!(of_split("train"), of_split("val"));
}

#[test]
fn bad_meshes_are_a_mistake_unless_they_may_be_left_out() {
    let folder = copies("cube.obj", &["m/good.obj"]);
    folder.write("m/bad.obj", "v 0 0 0\nf 1 2 3\n");
    folder.write("job.toml", job("[[object]]\npath = \"m/*.obj\""));
    let error = folder.fail("generate job.toml", 2);
    assert!(error.contains("m/bad.obj:2: face refers to vertex 2") && error.contains("on_bad = \"skip\""), "{error}");
    folder.write("job.toml", job("[[object]]\npath = \"m/*.obj\"\non_bad = \"skip\""));
    let said = folder.succeed("generate job.toml");
    assert!(said.contains("left out: m/bad.obj:2: face refers"), "{said}");
    assert!(folder.labels("out/small").values().all(|label| field(label, "class") == "good"));
    folder.write("job.toml", job("[[object]]\npath = \"m/b*.obj\"\non_bad = \"skip\""));
    let error = folder.fail("generate job.toml --out none", 2);
    assert!(error.contains("all meshes are left out, the first because of m/bad.obj:2"), "{error}");
}

#[test]
fn a_robot_that_changed_is_not_rendered_as_if_it_had_not() {
    let folder = Folder::new();
    let robot = r#"<robot name="r"><link name="a"><visual><geometry><mesh filename="cube.obj"/></geometry></visual></link></robot>"#;
    folder.write("r.urdf", robot);
    folder.write("job.toml", job("[[object]]\npath = \"r.urdf\"\nunit = \"mm\""));
    folder.succeed("generate job.toml");
    folder.gelsim("reproduce out/small 0").assert().success();
    folder.write("cube.obj", folder.read("cube.obj") + "# changed\n");
    let error = folder.fail("reproduce out/small 0", 2);
    assert!(error.contains("r.urdf has changed: its SHA-256 is"), "{error}");
}

#[test]
fn init_writes_a_job_that_works_for_a_folder_of_meshes() {
    let folder = copies("cube.obj", &["meshes/a/n.obj", "meshes/b/n.obj", "meshes/c/n.obj"]);
    folder.write("meshes/c/n.obj", "v 0 0 0\n");
    for (sensor, _) in gelsim_files::sensor::PRESETS {
        let said = folder.succeed(&format!("init --sensor {sensor} --objects meshes {sensor}.toml"));
        assert!(said.contains(&format!("wrote {sensor}.toml")), "{said}");
        let job = folder.read(&format!("{sensor}.toml"));
        assert!(job.contains("path = \"meshes/*/n.obj\"") && job.contains("class_from = \"folder\""), "{job}");
        assert!(job.contains("on_bad = \"skip\""), "{job}");
        // A finger is pressed from all sides.
        assert_eq!(job.contains("from_tip_mm"), ["geltip", "allsight"].contains(&sensor), "{job}");
        folder
            .succeed(&format!("generate {sensor}.toml --samples 2 --set sensor.resolution_px=[48,64] --out {sensor}"));
    }
    folder.succeed("generate digit.toml --samples 8 --set sensor.resolution_px=[48,64] --out classes");
    let seen: BTreeSet<String> = classes(&folder, "classes").into_values().collect();
    assert_eq!(seen, ["a".into(), "b".into()].into());
    let again = folder.fail("init --objects meshes digit.toml", 2);
    assert!(again.contains("digit.toml exists already"), "{again}");
}

/// `cube.obj`, which is 5 mm long, with its coordinates times `by`.
fn cube(folder: &Folder, by: f64) -> String {
    folder.read("cube.obj").lines().map(|line| scaled(line, by)).collect()
}

#[test]
fn init_gives_each_mesh_the_size_that_it_has() {
    let folder = Folder::new();
    fs::create_dir_all(folder.path("mixed")).expect("a folder");
    fs::create_dir_all(folder.path("learned")).expect("a folder");
    folder.write("mixed/a.obj", folder.read("cube.obj"));
    folder.write("mixed/b[1].obj", cube(&folder, 0.001));
    // Centred, and its longest side is 1.
    for name in ["c", "d"] {
        let text = folder.read("cube.obj");
        let unit = text.lines().map(|line| match line.strip_prefix("v ") {
            Some(corner) => {
                let xyz: Vec<f64> = corner.split_whitespace().map(|word| word.parse().expect("a number")).collect();
                format!("v {} {} {}\n", xyz[0] / 5.0, xyz[1] / 5.0, xyz[2] / 5.0 - 0.5)
            }
            None => format!("{line}\n"),
        });
        folder.write(&format!("learned/{name}.obj"), unit.collect::<String>());
    }
    folder.succeed("init --objects mixed mixed.toml");
    let job = folder.read("mixed.toml");
    assert!(
        job.contains("path = \"mixed/a.obj\"\n\n") && job.contains("path = \"mixed/b[1].obj\"\nunit = \"m\""),
        "{job}"
    );
    let said = folder.succeed("init --objects learned learned.toml");
    assert!(folder.read("learned.toml").contains("length_mm = 15 "), "{}", folder.read("learned.toml"));
    assert!(!said.contains("warning"), "{said}");
    for name in ["mixed", "learned"] {
        folder.succeed(&format!(
            "generate {name}.toml --samples 4 --set sensor.resolution_px=[48,36] --out {name}-set --strict"
        ));
        for label in folder.labels(&format!("{name}-set")).values() {
            let force = label["contact"]["force_n"].as_f64();
            assert!(force.is_some_and(|force| force > 0.0), "{label}");
        }
    }
}

#[test]
fn init_guesses_units_and_refuses_what_holds_no_mesh() {
    let folder = Folder::new();
    fs::create_dir_all(folder.path("m s/deep")).expect("a folder");
    fs::create_dir_all(folder.path("empty")).expect("a folder");
    let text = folder.read("cube.obj");
    folder.write("m s/one.obj", text.lines().map(|line| scaled(line, 0.001)).collect::<String>());
    let assert = folder.gelsim("init --objects").arg("m s").assert().success();
    let text = String::from_utf8_lossy(&assert.get_output().stdout).into_owned();
    assert!(text.contains("path = \"m s/*.obj\"") && text.contains("unit = \"m\" "), "{text}");
    assert!(text.contains("name = \"m-s\""), "{text}");
    assert!(folder.fail("init --objects empty job.toml", 2).contains("there is no mesh in empty"));
    assert!(folder.fail("init --objects none job.toml", 2).contains("none does not exist"));
    folder.write("empty/bad.obj", "v 0 0 0\n");
    assert!(folder.fail("init --objects empty job.toml", 2).contains("no mesh in empty can be used"));
    assert!(!folder.path("job.toml").exists());
}

#[test]
fn a_job_finds_the_meshes_wherever_init_writes_it() {
    let folder = Folder::new();
    for inside in ["here/meshes", "there/deeper"] {
        fs::create_dir_all(folder.path(inside)).expect("a folder");
    }
    fs::write(folder.path("here/meshes/one.obj"), folder.read("cube.obj")).expect("a mesh");
    std::os::unix::fs::symlink("there/deeper", folder.path("link")).expect("a link");
    for (objects, job) in [
        ("here/meshes", "there/../job.toml"),
        ("here/meshes", "there/job.toml"),
        ("here/meshes", "link/job.toml"),
        ("here/../here/meshes", "job.toml"),
    ] {
        folder.succeed(&format!("init --objects {objects} {job}"));
        folder.succeed(&format!("plan {job} --samples 2"));
        fs::remove_file(folder.path(job)).expect("the job");
    }
    for (objects, job) in [("meshes", "../again.toml"), (".", "../../again.toml")] {
        let inside = if objects == "." { "here/meshes" } else { "here" };
        let mut command = folder.gelsim(&format!("init --objects {objects} {job}"));
        command.current_dir(folder.path(inside)).assert().success();
        folder.succeed("plan again.toml --samples 2");
        fs::remove_file(folder.path("again.toml")).expect("the job");
    }
    let odd = std::ffi::OsStr::from_bytes(b"here/meshes/b\xe4d.obj");
    fs::write(folder.path("").join(odd), folder.read("cube.obj")).expect("a mesh");
    assert!(folder.fail("init --objects here/meshes odd.toml", 2).contains("is not UTF-8, so that no job can hold it"));
}

/// A float32 array as an npy file, row by row.
fn npy(width: usize, values: &[f32]) -> Vec<u8> {
    let height = values.len() / width;
    let text = format!("{{'descr': '<f4', 'fortran_order': False, 'shape': ({height}, {width}), }}");
    let mut bytes = b"\x93NUMPY\x01\x00".to_vec();
    bytes.extend((text.len() as u16).to_le_bytes());
    bytes.extend(text.as_bytes());
    bytes.extend(values.iter().flat_map(|value| value.to_le_bytes()));
    bytes
}

/// The last values of an npy file of float32.
fn floats(npy: &[u8], count: usize) -> Vec<f32> {
    npy[npy.len() - 4 * count..].as_chunks::<4>().0.iter().map(|bytes| f32::from_le_bytes(*bytes)).collect()
}

/// One sample of 48 x 36 px of 0.1 mm, level and in the middle.
fn level(object: &str, layers: &str) -> String {
    let sensor = "[sensor]\nresolution_px = [48, 36]\nfield_of_view_mm = [4.8, 3.6]";
    let output = format!("[output]\ndepth_format = \"npy\"\nlayers = {layers}");
    format!(
        "[dataset]\nname = \"small\"\nsamples = 1\n{sensor}\n[[object]]\n{object}\n[indentation]\ndepth_mm = 0.3\n{output}\n"
    )
}

#[test]
fn a_height_map_is_pressed_upright_as_high_as_it_is_said_to_be() {
    let map: Vec<f32> = (0..16 * 12).map(|at| ((at % 16 + 2 * (at / 16)) % 11) as f32 / 10.0).collect();
    let folder = Folder::with_job(&level("path = \"map.npy\"\nmm_per_px = 0.1\nheight_mm = 0.25", "[\"depth\"]"));
    folder.write("map.npy", npy(16, &map));
    let said = folder.succeed("generate job.toml --quiet");
    assert_eq!(said, "");
    let sample = folder.samples("out/small").into_values().next().expect("a sample");
    let depth = floats(&sample["depth.npy"], 48 * 36);
    for (at, found) in depth.iter().enumerate() {
        let (column, row) = ((at % 48).wrapping_sub(16), (at / 48).wrapping_sub(12));
        let inside = column < 16 && row < 12;
        let expected = if inside { 0.3 - 0.25 * (1.0 - map[row * 16 + column]) } else { 0.0 };
        assert!((found - expected).abs() < 1e-5, "{at}: {found} instead of {expected}");
    }
    let label: Value = serde_json::from_slice(&sample["json"]).expect("JSON");
    assert_eq!(label["object"]["class"], "map");
    assert_eq!(label["object"]["mesh_sha256"], crate::support::sha256(&folder.read_bytes("map.npy")));
    // Of a rigid object nothing is said.
    assert!(label["object"]["material"].as_object().expect("a table").values().all(Value::is_null));
}

#[test]
fn an_object_has_its_own_softness_friction_and_texture() {
    let object = "path = \"cube.obj\"\nscale = 0.1\nyoungs_modulus_kpa = [100.0, 200.0]\nfriction = 0.25\n\
                  texture = { patterns = [\"knurled\"], amplitude_mm = 0.05 }";
    let text =
        format!("{}\n[gelpad.elastic.friction.coulomb]\ncoefficient = 0.9\n", level(object, "[\"depth\", \"gap\"]"));
    let folder = Folder::with_job(&text);
    folder.succeed("generate job.toml --quiet --strict");
    let sample = folder.samples("out/small").into_values().next().expect("a sample");
    let label: Value = serde_json::from_slice(&sample["json"]).expect("JSON");
    let material = &label["object"]["material"];
    let modulus = material["youngs_modulus_kpa"].as_f64().expect("a number");
    assert!((100.0..=200.0).contains(&modulus) && material["poisson_ratio"] == 0.48 && material["friction"] == 0.25);
    assert_eq!(label["texture"]["pattern"], "knurled");
    // In the shape that it takes the object is no deeper than the pad, and touches it.
    let (depth, gap) = (floats(&sample["depth.npy"], 48 * 36), floats(&sample["gap.npy"], 48 * 36));
    let deepest = depth.iter().copied().fold(0.0, f32::max);
    assert!(deepest < 0.28 && deepest > 0.05, "{deepest}");
    assert!(depth.iter().zip(&gap).any(|(depth, gap)| *depth > 0.0 && *gap == 0.0));
    folder.succeed("verify out/small");
}

#[test]
fn points_are_the_surface_in_the_sensors_frame() {
    let folder = Folder::with_job(&level("path = \"cube.obj\"\nscale = 0.1", "[\"surface\", \"points\"]"));
    folder.succeed("generate job.toml --quiet --set output.depth_format=\"exr\" --out exr");
    folder.succeed("generate job.toml --quiet");
    folder.succeed("verify out/small");
    let sample = |out: &str| folder.samples(out).into_values().next().expect("a sample");
    let (surface, points) = (sample("out/small")["surface.npy"].clone(), sample("out/small")["points.npy"].clone());
    assert_eq!(sample("exr")["points.npy"], points, "an array whatever the format of the others");
    let surface = floats(&surface, 48 * 36);
    assert!(surface.iter().any(|w| *w > 0.25));
    for (at, point) in floats(&points, 3 * 48 * 36).as_chunks::<3>().0.iter().enumerate() {
        let place = |at: usize, size: usize| 0.1 * (at as f32 + 0.5 - size as f32 / 2.0);
        let expected = [place(at % 48, 48), place(at / 48, 36), -surface[at]];
        assert!(point.iter().zip(expected).all(|(a, b)| (a - b).abs() < 1e-5), "{at}: {point:?}, {expected:?}");
    }
}

#[test]
fn points_of_a_gel_that_is_not_flat_lie_on_it() {
    let text = edited(
        &level("path = \"cube.obj\"", "[\"points\", \"surface\"]"),
        &[("resolution_px = [48, 36]\nfield_of_view_mm = [4.8, 3.6]", "preset = \"tactip\"\nresolution_px = [64, 64]")],
    );
    let folder = Folder::with_job(&text);
    folder.succeed("generate job.toml --quiet");
    let sample = folder.samples("out/small").into_values().next().expect("a sample");
    let (points, surface) = (floats(&sample["points.npy"], 3 * 64 * 64), floats(&sample["surface.npy"], 64 * 64));
    let mut seen = 0;
    for (point, down) in points.as_chunks::<3>().0.iter().zip(&surface).filter(|(point, _)| **point != [0.0; 3]) {
        let [x, y, z] = point.map(f64::from);
        let radius = (x * x + y * y + (z + 20.0) * (z + 20.0)).sqrt() + f64::from(*down);
        assert!((radius - 20.0).abs() < 1e-4, "{point:?}: {radius}");
        seen += 1;
    }
    assert!(seen > 1000 && surface.iter().any(|down| *down > 0.1), "{seen}");
}

#[test]
fn the_contact_is_measured_in_pixels_of_its_layer() {
    let text =
        format!("{}\n[camera]\ndistortion_k1 = 0.2\n", level("path = \"cube.obj\"\nscale = 0.05", "[\"contact\"]"));
    let folder =
        Folder::with_job(&edited(&text, &[("depth_mm = 0.3", "depth_mm = 0.3\n[pose]\nx_mm = 1.0\ny_mm = -0.6")]));
    folder.succeed("generate job.toml --quiet");
    let sample = folder.samples("out/small").into_values().next().expect("a sample");
    let label: Value = serde_json::from_slice(&sample["json"]).expect("JSON");
    let mask = image::load_from_memory(&sample["contact.png"]).expect("a picture").into_luma8();
    let touching: Vec<[f64; 2]> = mask
        .enumerate_pixels()
        .filter(|(_, _, value)| value.0[0] > 0)
        .map(|(x, y, _)| [f64::from(x) + 0.5, f64::from(y) + 0.5])
        .collect();
    let count = touching.len() as f64;
    let number = |key: &str| label["contact"][key].as_f64().expect("a number");
    for k in 0..2 {
        let mean = touching.iter().map(|at| at[k]).sum::<f64>() / count;
        let found = label["contact"]["centroid_px"][k].as_f64().expect("a number");
        assert!((found - mean).abs() < 1e-9, "{found} instead of {mean}");
    }
    let disc = |area: f64| (area / std::f64::consts::PI).sqrt();
    assert!((number("equivalent_radius_px") - disc(count)).abs() < 1e-9);
    assert!((number("equivalent_radius_mm") - disc(number("area_mm2"))).abs() < 1e-9);
}

#[test]
fn the_side_with_the_most_relief_is_pressed_and_said() {
    // Ridges on the side towards -z of a plate; the job turns another side to the pad.
    let map: Vec<f32> = (0..16 * 12).map(|at| if at % 16 / 2 % 2 == 0 { 1.0 } else { 0.0 }).collect();
    let object = "path = \"map.npy\"\nmm_per_px = 0.1\nheight_mm = 0.25";
    let folder = Folder::with_job(&format!("{}\n[pose]\nface = \"+z\"\n", level(object, "[\"depth\"]")));
    folder.write("map.npy", npy(16, &map));
    let said = folder.succeed("generate job.toml");
    assert!(said.contains("info: map.npy: its side +z, which [pose] presses, is flat"), "{said}");
    assert!(said.contains("or face = \"-z\"") && said.contains("face = \"auto\""), "{said}");
    let said = folder.succeed("generate job.toml --out auto --set pose.face=\"auto\"");
    assert!(!said.contains("is flat"), "{said}");
    folder.succeed("generate job.toml --out turned --quiet --set pose.face=\"-z\"");
    let depth = |out: &str| folder.samples(out).into_values().next().expect("a sample")["depth.npy"].clone();
    assert_eq!(depth("auto"), depth("turned"));
    let planned = folder.gelsim("plan job.toml --out none --set pose.face=\"auto\"").assert().success();
    let planned = String::from_utf8_lossy(&planned.get_output().stdout).into_owned();
    assert!(planned.contains("face = \"auto\" presses the sides with the most relief: -z of map"), "{planned}");
}

#[test]
fn an_object_that_is_never_in_view_is_noted() {
    let text = level("path = \"cube.obj\"\nscale = 0.1", "[\"depth\"]");
    let folder = Folder::with_job(&format!("{text}\n[pose]\nx_mm = [60.0, 70.0]\n"));
    let said = folder.succeed("generate job.toml");
    assert!(said.contains("cube.obj is never in view: [pose] places it at x_mm = 60 to 70"), "{said}");
    let said = folder.succeed("generate job.toml --overwrite --set pose.x_mm=[0.0,70.0]");
    assert!(!said.contains("never in view"), "{said}");
}

/// A robot with one link for each of these meshes, which are in mm.
fn robot(meshes: &[&str]) -> String {
    let link = |(i, name): (usize, &&str)| {
        format!(
            "<link name=\"l{i}\"><visual><geometry>\n<mesh filename=\"{name}\" scale=\"0.001 0.001 0.001\"/></geometry></visual></link>\n"
        )
    };
    format!("<robot name=\"r\">\n{}</robot>", meshes.iter().enumerate().map(link).collect::<String>())
}

/// A folder with a robot under `ws/robots/arm` that names a mesh of the package `my_meshes`, which lies elsewhere under another name.
fn robot_with_a_package() -> Folder {
    let folder = copies("cube.obj", &["opt/share/meshes_of_mine/m/cube.obj", "ws/robots/arm/none"]);
    folder.write("opt/share/meshes_of_mine/package.xml", "<package><name>my_meshes</name></package>");
    folder.write("ws/robots/arm/r.urdf", robot(&["package://my_meshes/m/cube.obj"]));
    folder
}

#[test]
fn a_package_is_found_where_the_job_the_flag_or_the_environment_says() {
    let folder = robot_with_a_package();
    let arm = "ws/robots/arm/r.urdf";
    folder.write("job.toml", job(&format!("[[object]]\npath = \"{arm}\"")));
    let error = folder.fail("generate job.toml", 2);
    let expected = "r.urdf:3: names the mesh `package://my_meshes/m/cube.obj`, and there is no package `my_meshes`";
    assert!(error.contains(expected) && error.contains("packages = [\"FOLDER\"]"), "{error}");
    let inspected = folder.gelsim(&format!("inspect {arm}")).assert().code(1);
    let text = String::from_utf8_lossy(&inspected.get_output().stdout).into_owned();
    assert!(text.contains("there is no package `my_meshes`") && text.contains("--packages FOLDER"), "{text}");

    folder.gelsim(&format!("inspect {arm} --packages opt/share")).assert().success();
    folder.gelsim(&format!("inspect {arm}")).env("ROS_PACKAGE_PATH", folder.path("opt")).assert().success();
    for packages in ["opt", "opt/share", "opt/share/meshes_of_mine"] {
        folder.write("job.toml", job(&format!("[[object]]\npath = \"{arm}\"\npackages = [\"{packages}\"]")));
        folder.succeed(&format!(
            "generate job.toml --quiet --out {}",
            packages.replacen("opt", "out", 1).replace('/', "-")
        ));
    }
    let lasting = |out: &str| {
        let mut files = folder.lasting_files(out);
        // Where the meshes are is in the job alone.
        files.remove("job.toml");
        files
    };
    assert_same_files(&lasting("out-share"), &lasting("out-share-meshes_of_mine"));
    folder.gelsim("reproduce out-share 0").assert().success();

    // What only the environment knew stands in the dataset's job.
    folder.write("job.toml", job(&format!("[[object]]\npath = \"{arm}\"")));
    let prefix = folder.path("prefix");
    fs::create_dir_all(prefix.join("share")).expect("a folder");
    fs::rename(folder.path("opt/share/meshes_of_mine"), prefix.join("share/my_meshes")).expect("moved");
    folder.gelsim("generate job.toml --quiet --out ament").env("AMENT_PREFIX_PATH", &prefix).assert().success();
    assert!(folder.read("ament/job.toml").contains("packages = [\"../prefix/share/my_meshes\"]"));
    folder.gelsim("reproduce ament 0").assert().success();
    assert_same_files(&lasting("ament"), &lasting("out-share"));

    folder.write("job.toml", job(&format!("[[object]]\npath = \"{arm}\"\npackages = [\"prefixes\", \"cube.obj\"]")));
    let error = folder.fail("generate job.toml", 2);
    assert!(error.contains("prefixes does not exist") && error.contains("cube.obj is no folder"), "{error}");
}

#[test]
fn a_robots_meshes_are_found_above_it_and_all_that_are_missing_are_named() {
    let folder = copies("cube.obj", &["robots/meshes/cube.obj", "robots/arm/urdf/none"]);
    folder.write("robots/arm/urdf/r.urdf", robot(&["meshes/cube.obj", "..\\..\\meshes\\cube.obj"]));
    folder.succeed("inspect robots/arm/urdf/r.urdf");
    folder.write("robots/arm/urdf/r.urdf", robot(&["meshes/cube.obj", "meshes/a.stl", "b.stl", "meshes/cub.obj"]));
    folder.write("job.toml", job("[[object]]\npath = \"robots/arm/urdf/r.urdf\""));
    let error = folder.fail("generate job.toml", 2);
    let expected = "r.urdf:5: names 3 meshes that are not there: `meshes/a.stl` (line 5), `b.stl` (line 7), `meshes/cub.obj` (line 9)";
    assert!(error.contains(expected), "{error}");
}

#[test]
fn a_robot_that_only_collides_is_pressed_as_the_message_says() {
    let folder = Folder::new();
    folder.write(
        "r.urdf",
        "<robot name=\"r\"><link name=\"a\"><collision><geometry><box size=\".01 .01 .01\"/></geometry></collision></link></robot>",
    );
    folder.write("job.toml", job("[[object]]\npath = \"r.urdf\""));
    let error = folder.fail("generate job.toml", 2);
    assert!(error.contains("r.urdf:1: has no visual shape, but 1 collision shape"), "{error}");
    assert!(
        error.contains("urdf = \"collision\" under [[object]] takes those (gelsim inspect: --urdf collision)"),
        "{error}"
    );
    folder.gelsim("inspect r.urdf --urdf collision").assert().success();
    folder.write("job.toml", job("[[object]]\npath = \"r.urdf\"\nurdf = \"collision\""));
    folder.succeed("generate job.toml --quiet");
    assert!(folder.labels("out/small").values().any(|label| label["contact"]["in_contact"] == true));
}

#[test]
fn a_mesh_that_is_named_as_another_format_or_counts_wrongly_is_read_with_a_word() {
    let folder = Folder::new();
    fs::copy(folder.path("cube.obj"), folder.path("cube.stl")).expect("a copy");
    let mut stl = [&[b' '; 80][..], &3_u32.to_le_bytes()].concat();
    for height in 0..4 {
        stl.extend([0; 12]);
        stl.extend([0.0, 0.0, height as f32, 5.0, 0.0, 0.0, 0.0, 5.0, 0.0].map(f32::to_le_bytes).as_flattened());
        stl.extend([0; 2]);
    }
    folder.write("count.stl", stl);
    folder.write("job.toml", job("[[object]]\npath = \"cube.stl\"\n[[object]]\npath = \"count.stl\""));
    let said = folder.succeed("generate job.toml");
    assert!(said.contains("note: cube.stl: is OBJ by its bytes, and read as that"), "{said}");
    assert!(said.contains("give it the ending .obj"), "{said}");
    assert!(said.contains("count.stl: says that it has 3 triangles and holds 4, which are read"), "{said}");
    let inspected = folder.gelsim("inspect cube.stl").assert().success();
    let text = String::from_utf8_lossy(&inspected.get_output().stdout).into_owned();
    assert!(text.contains("is OBJ by its bytes") && text.contains("OBJ, "), "{text}");
    fs::rename(folder.path("cube.stl"), folder.path("mended.obj")).expect("renamed");
    folder.gelsim("inspect mended.obj --strict").assert().success();
}

#[test]
fn what_stands_in_place_of_a_mesh_is_told_once_for_all() {
    let folder = copies("cube.obj", &["m/good.obj"]);
    for name in ["a", "b", "c", "d"] {
        folder.write(&format!("m/{name}.obj"), "version https://git-lfs.github.com/spec/v1\noid sha256:0\nsize 5\n");
    }
    folder.write("job.toml", job("[[object]]\npath = \"m/*.obj\""));
    let error = folder.fail("generate job.toml", 2);
    assert!(error.contains("4 files are each a pointer of Git LFS, not the file itself: m/a.obj"), "{error}");
    assert!(error.contains("git lfs pull") && error.matches("error: ").count() == 1, "{error}");
}

/// The help of the one mistake in a job with this path, and what it names in quotes behind `path = ` or alone.
fn way_out(folder: &Folder, written: &str) -> String {
    folder.write("job.toml", job(&format!("[[object]]\npath = '{written}'")));
    let error = folder.fail("generate job.toml", 2);
    assert_eq!(error.matches("error: ").count(), 1, "{error}");
    let help = error.lines().find_map(|line| line.trim_start().strip_prefix("= help: "));
    help.unwrap_or_else(|| panic!("no help in {error}")).to_owned()
}

/// Where a way out names a path in quotes, following it is a job that runs.
#[test]
fn the_way_out_of_a_path_that_names_nothing_works_when_it_is_followed() {
    let folder = copies("cube.obj", &["m/a.obj", "m/b.obj", "n/deep/a.obj"]);
    fs::create_dir_all(folder.path("empty")).expect("a folder");
    for (written, expected) in [
        ("m", "what is in it: path = \"m/*.obj\""),
        ("m/", "what is in it: path = \"m/*.obj\""),
        ("n", "what is in it: path = \"n/**/*.obj\""),
        ("m/*.stl", "what is there: path = \"m/*.obj\"; paths are relative to the file they stand in"),
        ("m/*.OBJ", "what is there: path = \"m/*.obj\""),
        ("m/*.fbx", "open it in Blender and export it as .glb, .obj, .ply or .stl; what is there: path = \"m/*.obj\""),
        ("m\\a.obj", "write / between folders: \"m/a.obj\""),
        ("m/{a,b}.obj", "write a table for each, [[object]] path = \"m/a.obj\" and [[object]] path = \"m/b.obj\""),
        ("m/*.{obj,stl}", "[[object]] path = \"m/*.obj\" and"),
        ("$HERE/m/a.obj", "variables are not replaced here: write what it stands for"),
        ("mm/a.obj", "there is no folder mm, did you mean m?"),
        ("meshes/../m/a.obj", "there is no folder meshes"),
        ("file://m/a.obj", "write the path alone: \"m/a.obj\""),
        ("https://a/b.obj", "nothing is downloaded: fetch it, and name the file"),
        ("m/aa.obj", "did you mean m/a.obj? paths are relative"),
        ("empty", "nothing in this folder can be one"),
    ] {
        let help = way_out(&folder, written);
        assert!(help.contains(expected), "{written}: {help}");
        let named = expected.split('"').nth(1).or_else(|| expected.strip_prefix("did you mean ")?.split('?').next());
        if let Some(named) = named {
            folder.write("job.toml", job(&format!("[[object]]\npath = \"{named}\"")));
            folder.succeed("plan job.toml --out none");
        }
    }
    let home = |path: &str| folder.path(path).to_string_lossy().into_owned();
    for (written, expected) in [("~/m/a.obj", home("m/a.obj")), ("${HERE}/m/a.obj", home("m/a.obj"))] {
        folder.write("job.toml", job(&format!("[[object]]\npath = \"{written}\"")));
        let mut command = folder.gelsim("generate job.toml");
        let assert = command.env("HOME", home("")).env("HERE", home("").trim_end_matches('/')).assert().code(2);
        let error = String::from_utf8_lossy(&assert.get_output().stderr).into_owned();
        assert!(error.replace("//", "/").contains(&format!("write \"{expected}\"")), "{written}: {error}");
    }
    let pipe = folder.path("pipe.obj");
    assert!(std::process::Command::new("mkfifo").arg(&pipe).status().expect("mkfifo").success());
    folder.write("job.toml", job("[[object]]\npath = \"pipe.obj\""));
    assert!(folder.fail("generate job.toml", 2).contains("pipe.obj is a pipe or a device, and no file"));
    // On the command line paths start from the current folder.
    folder.write("m/job.toml", job("[[object]]\npath = \"a.obj\""));
    let said = folder.fail("generate m/job.toml --set object.0.path=\"a.obj\"", 2);
    assert!(said.contains("paths start from the current folder"), "{said}");
    folder.succeed("generate m/job.toml --quiet --set object.0.path=\"m/a.obj\"");
}

#[test]
fn paths_that_name_nothing_are_told_together() {
    let folder = Folder::new();
    let many: String = (0..60).map(|i| format!("[[object]]\npath = \"none-{i}.obj\"\n")).collect();
    folder.write("job.toml", job(&many));
    let error = folder.fail("generate job.toml", 2);
    assert!(
        error.contains("60 files do not exist: none-0.obj (job.toml:") && error.contains(" and 40 more"),
        "{error}"
    );
    assert_eq!(error.matches("error: ").count(), 1, "{error}");
}

#[test]
fn a_height_map_may_be_in_an_archive_or_of_truths() {
    let map: Vec<f32> = (0..16 * 12).map(|at| ((at % 16 + 2 * (at / 16)) % 11) as f32 / 10.0).collect();
    let object =
        |name: &str| format!("path = \"{name}\"\nmm_per_px = 0.1\nheight_mm = 0.25\nclass = \"c\"\nlabel_path = \"p\"");
    let folder = Folder::new();
    folder.write("map.npy", npy(16, &map));
    folder.write("map.npz", archive(&[("heights.npy", &npy(16, &map)), ("K.npy", &npy(3, &[0.0; 9]))]));
    folder.write("two.npz", archive(&[("a.npy", &npy(16, &map)), ("b.npy", &npy(3, &[0.0; 9]))]));
    let depth = |name: &str| {
        folder.write("job.toml", level(&object(name), "[\"depth\"]"));
        folder.succeed(&format!("generate job.toml --quiet --out {name}.out"));
        folder.samples(&format!("{name}.out")).into_values().next().expect("a sample")["depth.npy"].clone()
    };
    assert_eq!(depth("map.npz"), depth("map.npy"));
    let steps: Vec<u8> = (0..16 * 12).map(|at| u8::from(at % 16 < 8)).collect();
    let head = b"{'descr': '|b1', 'fortran_order': False, 'shape': (12, 16), }\n";
    folder.write("truths.npy", [&b"\x93NUMPY\x01\x00"[..], &[head.len() as u8, 0], head, &steps].concat());
    folder.write("floats.npy", npy(16, &steps.iter().map(|step| f32::from(*step)).collect::<Vec<_>>()));
    assert_eq!(depth("truths.npy"), depth("floats.npy"));
    folder.write("job.toml", level(&object("two.npz"), "[\"depth\"]"));
    let error = folder.fail("generate job.toml", 2);
    assert!(error.contains("it holds 2 arrays, `a`, `b`, and none is called `height`"), "{error}");
    assert!(error.contains("numpy.save(\"map.npy\", numpy.load(\"FILE.npz\")[\"NAME\"])"), "{error}");
}

#[test]
fn feet_far_from_the_view_have_their_share_of_contact_and_force() {
    let folder = Folder::new();
    // Two cubes of 4 mm, 600 mm apart: the right one is pressed in view.
    let quads = [[1, 2, 4, 3], [5, 7, 8, 6], [1, 5, 6, 2], [3, 4, 8, 7], [1, 3, 7, 5], [2, 6, 8, 4]];
    let mut mesh = String::new();
    for foot in 0..2 {
        for k in 0..8 {
            let [x, y, z] = [k >> 2, k >> 1, k].map(|bit| 4 * (bit & 1));
            mesh += &format!("v {} {y} {z}\n", x + 600 * foot);
        }
        for corners in quads {
            mesh += &format!("f {}\n", corners.map(|k| (k + 8 * foot).to_string()).join(" "));
        }
    }
    folder.write("feet.obj", mesh);
    let (start, _) = JOB.split_once("[[object]]").expect("objects");
    let start = start.replace("samples = 8", "samples = 1");
    folder.write("job.toml", format!("{start}[[object]]\npath = \"feet.obj\"\nunit = \"mm\"\n"));
    for level in ["paper", "standard"] {
        let place = "--set pose.x_mm=-300.0 --set pose.y_mm=0.0 --set indentation.depth_mm=0.5";
        folder.succeed(&format!("generate job.toml --quiet --overwrite --out out --fidelity {level} {place}"));
        let labels = folder.labels("out");
        let contact = &labels.values().next().expect("a label")["contact"];
        let number = |key: &str| contact[key].as_f64().unwrap_or_else(|| panic!("{key} in {contact}"));
        assert!((number("in_view_fraction") - 0.5).abs() < 0.03, "{contact}");
        if level == "standard" {
            assert!((number("total_force_n") / number("force_n") - 2.0).abs() < 0.04, "{contact}");
        }
    }
}
