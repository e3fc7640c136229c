//! `gelsim render`: depth frames give what a mesh in the same place gives; what cannot be right is refused in words.

use std::io::{Read, Write};
use std::process::{Command, Stdio};
use std::thread;

use gelsim_core::base::grid::Grid;
use gelsim_core::depth::{self, CaptureWindow};
use gelsim_files::exr::{Compression, Exr, Pixel};
use gelsim_files::{exr, image_file, npy, png};
use gelsim_job::config::Overrides;
use gelsim_job::plan::Plan;
use gelsim_job::scene::Scene;
use serde_json::Value;

use crate::support::{Folder, JOB, archive, assert_same_files, edited, json};

const SIZE: [usize; 2] = [48, 36];
const PLANE_MM: f64 = 10.0;
/// What the frames of [`pressed`] need.
const HERE: &str = "--sensor gelsight-2014 --plane-mm 10 --out out";

/// The job of [`JOB`] with objects that stay within the view: around it a frame knows nothing.
fn job() -> String {
    let edits = [
        ("min = -3.0, max = 3.0", "min = -1.0, max = 1.0"),
        ("[-2.0, 2.0]", "[-1.0, 1.0]"),
        ("no_contact = 0.25", "no_contact = 0.0"),
        ("\"depth\", \"contact\"", "\"depth\", \"surface\", \"contact\", \"normal\""),
    ];
    edited(JOB, &edits)
}

/// What a depth camera sees in sample `index` of `plan`: distances in mm, 90 mm where nothing is.
fn depth_camera_image(plan: &Plan, index: u64) -> Grid<f64> {
    let scene = Scene::draw(plan, index, 0);
    let window = CaptureWindow { margin_px: 0, above_mm: 80.0 };
    let penetration =
        depth::capture_indenter(&scene.indenter(plan), plan.simulator.view(), window, plan.thickness_mm()).penetration;
    let data = penetration.data.iter().map(|mm| PLANE_MM - f64::from(*mm)).collect();
    Grid { width: penetration.width, height: penetration.height, data }
}

/// An npy file of such values.
fn array<const N: usize>(frame: &Grid<f64>, name: &str, is_fortran: bool, bytes: impl Fn(f64) -> [u8; N]) -> Vec<u8> {
    let order = if is_fortran { "True" } else { "False" };
    let shape = (frame.height, frame.width);
    let text = format!("{{'descr': '{name}', 'fortran_order': {order}, 'shape': {shape:?}, }}");
    let mut file = b"\x93NUMPY\x01\x00".to_vec();
    file.extend((text.len() as u16).to_le_bytes());
    file.extend(text.as_bytes());
    match is_fortran {
        false => frame.data.iter().for_each(|value| file.extend(bytes(*value))),
        true => {
            for x in 0..frame.width {
                (0..frame.height).for_each(|y| file.extend(bytes(frame.at(x, y))));
            }
        }
    }
    file
}

fn doubles(frame: &Grid<f64>) -> Vec<u8> {
    array(frame, "<f8", false, f64::to_le_bytes)
}

fn singles(frame: &Grid<f64>) -> Vec<u8> {
    array(frame, "<f4", false, |value| (value as f32).to_le_bytes())
}

fn scaled(frame: &Grid<f64>, by: f64) -> Grid<f64> {
    Grid { data: frame.data.iter().map(|value| value * by).collect(), ..frame.clone() }
}

/// A ball of 4 mm, `deep` mm in the pad, seen by parallel rays; 90 mm where nothing is.
fn ball(deep: f64) -> Grid<f64> {
    let pitch = [20.0 / SIZE[0] as f64, 15.0 / SIZE[1] as f64];
    let mut frame = Grid::new(SIZE[0], SIZE[1]);
    for y in 0..SIZE[1] {
        for x in 0..SIZE[0] {
            let at = |at: usize, k: usize| (at as f64 + 0.5 - SIZE[k] as f64 / 2.0) * pitch[k] - 0.3;
            let square = 16.0 - at(x, 0).powi(2) - at(y, 1).powi(2);
            frame.row_mut(y)[x] = if square > 0.0 { PLANE_MM + 4.0 - deep - square.sqrt() } else { 90.0 };
        }
    }
    frame
}

/// A folder with a ball half a millimetre deep in `frames/a.npy`, and another file of it per name.
fn pressed(files: &[(&str, Vec<u8>)]) -> Folder {
    let folder = Folder::new();
    std::fs::create_dir_all(folder.path("frames")).expect("a folder");
    folder.write("frames/a.npy", doubles(&ball(0.5)));
    files.iter().for_each(|(name, bytes)| folder.write(&format!("frames/{name}"), bytes));
    folder
}

fn picture(folder: &Folder, name: &str) -> Vec<u8> {
    let bytes = folder.read_bytes(name);
    image_file::decode_rgb(&bytes).unwrap_or_else(|error| panic!("{name}: {error}")).into_raw()
}

/// The largest difference of two images, levels.
fn largest_difference(a: &[u8], b: &[u8]) -> u8 {
    assert_eq!(a.len(), b.len());
    a.iter().zip(b).map(|(a, b)| a.abs_diff(*b)).max().unwrap_or_default()
}

#[test]
fn frames_of_our_own_capture_give_what_generate_gives() {
    for level in ["paper", "standard", "finite-strain"] {
        let folder = Folder::with_job(&job());
        folder.succeed(&format!("generate job.toml --quiet --out set --fidelity {level}"));
        let plan = Plan::load(&folder.path("job.toml"), &Overrides::default()).expect("a sound job");
        std::fs::create_dir_all(folder.path("frames")).expect("a folder");
        for index in 0..8 {
            folder.write(&format!("frames/{index:09}.npy"), doubles(&depth_camera_image(&plan, index)));
        }
        let said = folder.succeed(&format!(
            "render --depth frames --depth-unit mm {HERE} --fidelity {level} --layers depth,surface,contact,normal"
        ));
        assert_eq!(said, "8 frames, 8 in contact -> out\n");
        for (key, expected) in folder.samples("set") {
            let label: Value = serde_json::from_slice(&expected["json"]).expect("JSON");
            let supersampled = label["effects"]["supersampling"]["ran"] == true;
            for (suffix, bytes) in expected.iter().filter(|(suffix, _)| *suffix != "json") {
                let name = format!("out/{key}.{suffix}");
                if supersampled && suffix == "tactile.png" {
                    // A frame has nothing between its pixels: those that generate samples are other ones.
                    let expected = image_file::decode_rgb(bytes).expect("a picture").into_raw();
                    let pairs = || expected.iter().zip(picture(&folder, &name));
                    let differ = pairs().filter(|(a, b)| **a != *b).count();
                    assert!(differ * 4 < expected.len(), "{name}: {differ} values differ");
                    continue;
                }
                assert!(folder.read_bytes(&name) == *bytes, "{level} {key}.{suffix} differs from generate's");
            }
            let mut found = json(&folder, &format!("out/{key}.json"));
            // All of the contact is in view, but a frame cannot know that.
            for name in ["total_force_n", "in_view_fraction", "force_unknown"] {
                assert!(found["contact"][name] == Value::Null || name == "force_unknown", "{}", found["contact"]);
                found["contact"][name] = label["contact"][name].clone();
            }
            for part in ["contact", "sensor", "health", "fidelity"] {
                assert_eq!(found[part], label[part], "{level} {key} {part}");
            }
            assert_eq!((&found["object"]["id"], &found["object"]["mesh_sha256"]), (&Value::from(key), &"".into()));
            let depth = |label: &Value| label["indentation_depth_mm"].as_f64().expect("a number");
            assert!(depth(&found) <= depth(&label) + 1e-6 && depth(&found) > 0.5 * depth(&label));
        }
    }
}

#[test]
fn every_format_unit_and_order_gives_the_same_image() {
    let frame = ball(0.5);
    let single: Vec<f32> = frame.data.iter().map(|value| *value as f32).collect();
    let storage = Exr { pixel: Pixel::Float, compression: Compression::Zip };
    let folder = pressed(&[]);
    folder.succeed(&format!("render --depth frames/a.npy --depth-unit mm {HERE}"));
    let expected = picture(&folder, "out/a.tactile.png");
    let microns = frame.data.iter().map(|value| (value.min(60.0) * 1000.0).round() as u16).collect::<Vec<_>>();
    for (name, unit, bytes) in [
        ("f4.npy", "mm", singles(&frame)),
        ("fortran.npy", "mm", array(&frame, "<f4", true, |value| (value as f32).to_le_bytes())),
        ("big.npy", "mm", array(&frame, ">f8", true, f64::to_be_bytes)),
        ("metres.npy", "m", singles(&scaled(&frame, 1e-3))),
        ("microns.npy", "um", doubles(&scaled(&frame, 1e3))),
        ("picture.exr", "mm", exr::encode(48, 36, &[("Z", &single)], storage)),
        ("picture.png", "um", png::encode_grey16(48, 36, &microns)),
    ] {
        folder.write(name, bytes);
        folder.succeed(&format!("render --depth {name} --depth-unit {unit} {HERE} --quiet"));
        let stem = name.split('.').next().expect("a name");
        let found = picture(&folder, &format!("out/{stem}.tactile.png"));
        // Half a micrometre of the PNG's steps is a slope of a thousandth.
        assert!(largest_difference(&found, &expected) <= 1, "{name}: {} levels", largest_difference(&found, &expected));
    }
    assert!(expected.iter().max() > expected.iter().min());
}

#[test]
fn cameras_that_look_otherwise_are_put_right() {
    let frame = ball(0.5);
    let turned = |x: fn(usize) -> usize, y: fn(usize) -> usize| {
        let mut turned = frame.clone();
        for row in 0..36 {
            (0..48).for_each(|column| turned.row_mut(row)[column] = frame.at(x(column), y(row)));
        }
        doubles(&turned)
    };
    let folder = pressed(&[
        ("x.npy", turned(|x| 47 - x, |y| y)),
        ("xy.npy", turned(|x| 47 - x, |y| 35 - y)),
        // What belongs to a pixel is in the one before it, two rows further down.
        ("moved.npy", turned(|x| (x + 1).min(47), |y| y.saturating_sub(2))),
    ]);
    folder.succeed(&format!("render --depth frames/a.npy --depth-unit mm {HERE}"));
    for (name, options) in [("x", "--flip-x"), ("xy", "--flip-x --flip-y"), ("moved", "--pixel-offset=-1,2")] {
        folder.succeed(&format!("render --depth frames/{name}.npy --depth-unit mm {HERE} {options}"));
        let found = folder.read_bytes(&format!("out/{name}.tactile.png"));
        assert!(found == folder.read_bytes("out/a.tactile.png"), "{name}");
    }
}

#[test]
fn a_perspective_frame_shows_the_same_press_and_counts_what_it_could_not_see() {
    // 25 mm from the pad; the ball's rim hides what is behind it, far above the pad.
    let (width, height, fov) = (480, 360, 40.0_f64);
    let focal = height as f64 / 2.0 / (fov / 2.0).to_radians().tan();
    let mut frame = Grid::new(width, height);
    for row in 0..height {
        for column in 0..width {
            let ray = [(column as f64 + 0.5 - 240.0) / focal, (row as f64 + 0.5 - 180.0) / focal, 1.0];
            // The ball of [`ball`], 25 mm away instead of 10.
            let centre = [0.3, 0.3, 25.0 + 4.0 - 0.5];
            let dot = |a: [f64; 3], b: [f64; 3]| a.iter().zip(b).map(|(a, b)| a * b).sum::<f64>();
            let (square, along) = (dot(ray, ray), dot(ray, centre) / dot(ray, ray));
            let root = along * along - (dot(centre, centre) - 16.0) / square;
            frame.row_mut(row)[column] = if root < 0.0 { f64::INFINITY } else { along - root.sqrt() };
        }
    }
    let folder = pressed(&[("seen.npy", doubles(&frame))]);
    folder.succeed(&format!("render --depth frames/a.npy --depth-unit mm {HERE}"));
    let options = "--projection perspective --fov-y-deg 40 --set sensor.resolution_px=[48,36]";
    folder.succeed(
        &format!("render --depth frames/seen.npy --depth-unit mm {HERE} --plane-mm 25 {options}")
            .replace(" --plane-mm 10", ""),
    );
    let (found, expected) = (picture(&folder, "out/seen.tactile.png"), picture(&folder, "out/a.tactile.png"));
    assert!(largest_difference(&found, &expected) <= 1, "{} levels", largest_difference(&found, &expected));
    let [unseen, none] =
        ["seen", "a"].map(|name| json(&folder, &format!("out/{name}.json"))["health"]["unseen_px"].clone());
    assert_eq!((unseen, none), (0.into(), 0.into()), "beside a ball, rays reach the pad");
    // Nearly as far as the view is wide, the rays at its border pass it.
    let narrow = options.replace("40", "30");
    let near = format!(
        "render --depth frames/seen.npy --depth-unit mm --sensor gelsight-2014 --plane-mm 25 --out out {narrow}"
    );
    let said = folder.succeed(&near);
    assert!(said.contains("note: 1 of 1 frame: parts of the view were hidden"), "{said}");
    assert!(json(&folder, "out/seen.json")["health"]["unseen_px"].as_u64() > Some(100));
}

#[test]
fn what_cannot_be_right_is_refused_with_the_likely_fix_and_nothing_is_written() {
    let frame = ball(0.5);
    let holed =
        Grid { data: frame.data.iter().map(|mm| if *mm > 80.0 { f64::NAN } else { *mm }).collect(), ..frame.clone() };
    let small = Grid { width: 24, height: 72, data: frame.data.clone() };
    let away = scaled(&frame, 1.3);
    let folder = pressed(&[
        ("metres.npy", doubles(&scaled(&frame, 1e-3))),
        ("holed.npy", doubles(&holed)),
        ("small.npy", doubles(&small)),
        ("away.npy", doubles(&away)),
        ("grey.png", png::encode_grey(48, 36, &[7; 48 * 36])),
        ("cut.npy", doubles(&frame)[..1000].to_vec()),
    ]);
    std::fs::create_dir_all(folder.path("more")).expect("a folder");
    folder.write("more/a.npy", doubles(&frame));
    for (depth, options, words) in [
        ("frames/metres.npy", "", &["frames/metres.npy: all that is seen lies behind the pad", "--depth-unit m\n"][..]),
        ("frames/away.npy", "", &["the nearest point is 2.3", "is --plane-mm 10 right?"]),
        (
            "frames/holed.npy",
            "",
            &["pixels are no distances; the first is NaN in row 0, column 0", "--background-value=nan"],
        ),
        ("frames/a.npy frames/small.npy", "", &["small.npy: it has 24x72 px, and the view has 48x36"]),
        (
            "frames/grey.png frames/cut.npy",
            "",
            &["grey.png: not a grey image of 16 bits", "cut.npy: it says 36 x 48 values"],
        ),
        ("frames/a.npy more", "", &["would both be a.tactile.png"]),
        ("none.npy", "", &["none.npy does not exist"]),
        ("frames/a.npy", "--projection perspective", &["--fov-y-deg F"]),
        ("frames/a.npy", "--fov-y-deg 30", &["belongs to --projection perspective"]),
        ("frames/a.npy", "--max-depth-mm 4", &["--max-depth-mm 4 is not beyond --plane-mm 10"]),
        ("frames/a.npy", "--pixel-offset=1", &["two numbers"]),
        ("frames/a.npy", "--layers depth,colour", &["layers are depth, surface"]),
        ("frames/a.npy", "--threads 0", &["--threads is out of range"]),
        ("frames/a.npy", "--set sensor.gelpad_thickness_mm=-1", &["out of range"]),
        ("frames/a.npy", "--set fidelity={max_ms=4}", &["no fidelity level can be chosen by frames"]),
        ("frames/a.npy", "--set sensor.resolution_px=[24,18]", &["the frames have 48x36 px"]),
        ("frames/cut.npy none.npy", "--pixel-offset=1", &["two numbers", "cut.npy", "none.npy"]),
    ] {
        let said = folder.fail(format!("render --depth {depth} --depth-unit mm {HERE} {options}").trim_end(), 2);
        words.iter().for_each(|part| assert!(said.contains(part), "{depth} {options}: no {part:?} in\n{said}"));
        assert!(!folder.path("out").exists(), "{depth} {options}");
    }
    // An array in an archive is the frame that it is by itself.
    folder.write("one.npz", archive(&[("arr_0.npy", &doubles(&frame))]));
    folder.write("two.npz", archive(&[("left.npy", &doubles(&frame)), ("right.npy", &doubles(&frame))]));
    let said = folder.fail(&format!("render --depth two.npz --depth-unit mm {HERE}"), 2);
    assert!(said.contains("two.npz: it holds 2 arrays, `left`, `right`") && said.contains("FILE.npz/left"), "{said}");
    let said = folder.fail(&format!("render --depth two.npz/middle --depth-unit mm {HERE}"), 2);
    assert!(said.contains("it has no array `middle`, but `left`, `right`"), "{said}");
    folder.succeed(&format!("render --depth one.npz two.npz/left frames/a.npy --depth-unit mm {HERE} --quiet"));
    let image = |name: &str| folder.read_bytes(&format!("out/{name}.tactile.png"));
    assert!(image("one") == image("a") && image("two") == image("a"));
    std::fs::remove_dir_all(folder.path("out")).expect("a folder");
    let millimetres = format!("render --depth frames/a.npy --depth-unit m {HERE}");
    assert!(folder.fail(&millimetres, 2).contains("the values look like millimetres: --depth-unit mm"));
    folder.succeed(&format!("render --depth frames/away.npy --depth-unit mm {HERE} --no-contact-ok"));
    assert_eq!(json(&folder, "out/away.json")["contact"]["in_contact"], false);
    folder.succeed(&format!("render --depth frames/holed.npy --depth-unit mm {HERE} --background-value=nan"));
    folder.succeed(&format!("render --depth frames/a.npy --depth-unit mm {HERE} --quiet"));
    assert!(folder.read_bytes("out/holed.tactile.png") == folder.read_bytes("out/a.tactile.png"));
}

#[test]
fn a_later_run_replaces_an_earlier_ones_files_and_never_a_frame() {
    let folder = pressed(&[]);
    let render = |out: &str, options: &str| {
        format!(
            "render --depth frames/a.npy --depth-unit mm --sensor gelsight-2014 --plane-mm 10 --out {out} {options}"
        )
    };
    folder.succeed(&render("out", "--layers normal,contact"));
    folder.succeed(&render("out", "--layers depth --fidelity paper"));
    let names: Vec<String> = folder.files("out").into_keys().collect();
    assert_eq!(names, ["a.depth.exr", "a.json", "a.tactile.png"]);
    let once = folder.files("out");
    folder.succeed(&render("out", "--layers depth --fidelity paper --threads 1"));
    assert_same_files(&folder.files("out"), &once);
    // A file that no run made stays, whatever its name.
    std::fs::create_dir(folder.path("kept")).expect("a folder");
    folder.write("kept/a.normal.npy", "mine");
    folder.succeed(&render("kept", "--layers depth --fidelity paper"));
    assert_eq!(folder.read("kept/a.normal.npy"), "mine");
    // Its own depth layer would be called like the frame.
    folder.write("frames/a.depth.npy", doubles(&ball(0.5)));
    let own = "render --depth frames/a.depth.npy --depth-unit mm --sensor gelsight-2014 --plane-mm 10 --out frames";
    let said = folder.fail(&format!("{own} --set output.depth_format=\"npy\""), 2);
    assert!(said.contains("a.depth.npy would be written over"), "{said}");
    folder.succeed(own);
    assert!(folder.path("frames/a.depth.npy").exists() && folder.path("frames/a.depth.exr").exists());
}

#[test]
fn poses_go_into_labels_and_move_markers() {
    let folder = pressed(&[("b.npy", doubles(&ball(0.5)))]);
    folder.write(
        "poses.csv",
        "file,id,class,x_mm,y_mm,z_mm,shear_x_mm,twist_deg,quaternion_x,quaternion_y,quaternion_z,quaternion_w\n\
         b.npy,marble,ball,0.3,0.3,3.5,0.2,,0,0,0.6,0.8\na,,cube,,,,,,,,,\n",
    );
    let markers = "--set markers.pitch_mm=1.5";
    let options = "--layers markers --poses poses.csv";
    let frames = "render --depth frames --depth-unit mm";
    folder.succeed(&format!("{frames} {HERE} {options} {markers}"));
    let [still, moved] = ["a", "b"].map(|name| json(&folder, &format!("out/{name}.json")));
    assert_eq!((&still["object"]["id"], &still["object"]["class_index"]), (&"a".into(), &1.into()));
    assert_eq!((&moved["object"]["id"], &moved["object"]["class"]), (&"marble".into(), &"ball".into()));
    assert_eq!(moved["object"]["class_index"], 0);
    let near = |value: &Value, expected: f64| assert!((value.as_f64().expect("a number") - expected).abs() < 1e-12);
    near(&moved["pose"]["translation_mm"][2], 3.5);
    near(&moved["pose"]["yaw_deg"], 2.0 * 0.6_f64.atan2(0.8).to_degrees());
    near(&moved["pose"]["quaternion_xyzw"][2], 0.6);
    near(&moved["shear"]["shift_mm"][0], 0.2);
    near(&moved["shear"]["about_mm"][1], 0.3);
    assert!(moved["shear"]["force_n"][0].as_f64() > Some(0.0), "{}", moved["shear"]);
    let motion = |label: &Value| label["markers"]["max_motion_px"].as_f64().expect("a number");
    assert!(motion(&moved) > motion(&still) + 0.1, "{} {}", motion(&moved), motion(&still));
    folder.write("poses.csv", "file,clas\na,1\n");
    let said = folder.fail(&format!("{frames} {HERE} {options}"), 2);
    for part in ["unknown column `clas`", "is `class` meant?", "poses.csv:1:6", "no row is about the frame `b`"] {
        assert!(said.contains(part), "{part}: {said}");
    }
}

/// No frame becomes one of the first class because nobody named its own.
#[test]
fn a_frame_without_a_class_among_others_with_one_is_told_with_its_cell() {
    let folder = pressed(&[("b.npy", doubles(&ball(0.5)))]);
    let render = format!("render --depth frames --depth-unit mm {HERE} --poses poses.csv");
    folder.write("poses.csv", "file,id,class\nb.npy,marble,ball\na,die,\n");
    let said = folder.fail(&render, 2);
    for part in ["`class` is empty, and other rows name theirs", "poses.csv:3:7", "name a class in every row"] {
        assert!(said.contains(part), "{part}: {said}");
    }
    assert!(!folder.path("out").exists());
    folder.write("poses.csv", "file,id,class\nb.npy,marble,\na,die,\n");
    folder.succeed(&render);
    for name in ["a", "b"] {
        let object = &json(&folder, &format!("out/{name}.json"))["object"];
        assert_eq!((&object["class"], &object["class_index"]), (&"".into(), &0.into()));
    }
}

const STREAM: &str = "render --stream --depth-unit mm --sensor gelsight-2014 --plane-mm 10";

#[test]
fn a_stream_gives_the_images_that_files_give() {
    let frames: Vec<Grid<f64>> = [0.2, 0.5, -0.3, 0.9].map(ball).to_vec();
    let folder = Folder::new();
    std::fs::create_dir_all(folder.path("frames")).expect("a folder");
    for (number, frame) in frames.iter().enumerate() {
        folder.write(&format!("frames/{number}.npy"), singles(frame));
    }
    folder.succeed(&format!("render --depth frames --depth-unit mm {HERE}"));
    let input: Vec<u8> = frames.iter().flat_map(singles).collect();
    let output = folder.gelsim(STREAM).write_stdin(input.clone()).assert().success().stderr("4 frames\n");
    let images: Vec<&[u8]> = output.get_output().stdout.chunks(128 + 48 * 36 * 3).collect();
    assert_eq!(images.len(), 4);
    for (number, image) in images.into_iter().enumerate() {
        let (shape, length) = npy::read_announced_shape(&image[..128]).expect("a header");
        assert_eq!((shape.as_slice(), length), ([36, 48, 3].as_slice(), image.len() - 128));
        assert_eq!(&image[128..], picture(&folder, &format!("out/{number}.tactile.png")), "{number}");
    }
    folder.gelsim(STREAM).write_stdin("").assert().success().stdout("").stderr("0 frames\n");
    let one = singles(&frames[0]).len();
    for (bytes, words) in [
        (input[..one + 700].to_vec(), "error: frame 1: the input ends within it, after 700 bytes\n"),
        ([&input[..one], b"more"].concat(), "error: frame 1: the input ends within it, after 4 bytes\n"),
        ([&input[..one], b"more than that"].concat(), "error: frame 1: no npy file begins where it should\n"),
        ([&input[..one], &singles(&Grid { width: 36, height: 48, ..frames[0].clone() })].concat(), "it has 36x48 px"),
        ([&input[..one], &singles(&scaled(&frames[0], f64::NAN))].concat(), "frame 1: 1728 pixels are no distances"),
        (
            [&input[..one], &singles(&scaled(&frames[0], 1e-3))].concat(),
            "the values look like metres: --depth-unit m\n",
        ),
    ] {
        let output = folder.gelsim(STREAM).write_stdin(bytes).assert().code(1);
        let said = String::from_utf8_lossy(&output.get_output().stderr).into_owned();
        assert!(said.contains(words), "{said}");
        assert_eq!(output.get_output().stdout.len(), 128 + 48 * 36 * 3, "what was right before it stays");
    }
    folder.fail(&STREAM.replace("gelsight-2014", "nosight"), 2);
    folder.fail(&format!("{STREAM} --out out"), 2);
}

/// Resident memory of a process, bytes.
fn resident(process: u32) -> u64 {
    let status = std::fs::read_to_string(format!("/proc/{process}/status")).expect("a running process");
    let line = status.lines().find_map(|line| line.strip_prefix("VmRSS:")).expect("its memory");
    1024 * line.trim().trim_end_matches(" kB").parse::<u64>().expect("kB")
}

#[test]
#[cfg(target_os = "linux")]
fn a_stream_of_thousands_of_frames_keeps_none_of_them() {
    const FRAMES: usize = 3000;
    const WARM: usize = 100;
    let small = ball(0.5);
    let mut large = Grid::new(2 * SIZE[0], 2 * SIZE[1]);
    for y in 0..large.height {
        (0..large.width).for_each(|x| large.row_mut(y)[x] = small.at(x / 2, y / 2));
    }
    let frame = doubles(&large);
    let mut command = Command::new(env!("CARGO_BIN_EXE_gelsim"));
    command.args(STREAM.split(' ')).args(["--fidelity", "draft", "--quiet"]);
    let mut process = command.stdin(Stdio::piped()).stdout(Stdio::piped()).spawn().expect("the command starts");
    let (mut input, mut output) = (process.stdin.take().expect("a pipe"), process.stdout.take().expect("a pipe"));
    let length = frame.len() as u64;
    let feeder = thread::spawn(move || (0..FRAMES).try_for_each(|_| input.write_all(&frame)).map(|()| input));
    let mut image = vec![0; 128 + large.data.len() * 3];
    let mut read = |count: usize| {
        (0..count).for_each(|_| output.read_exact(&mut image).expect("an image"));
        resident(process.id())
    };
    let warm = read(WARM);
    let end = read(FRAMES - WARM);
    drop(feeder.join().expect("no panic").expect("all was taken"));
    assert!(process.wait().expect("it ends").success());
    assert!(end < warm + length, "{warm} bytes after {WARM} frames, {end} after {FRAMES}; a frame has {length}");
}
