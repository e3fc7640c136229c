//! What the program advises is done, and the result is looked at: images, depths, contacts, statuses. And what could pass for a
//! result without being one is said.

use std::fs;

use gelsim_files::npy;
use serde_json::Value;

use crate::support::{Folder, JOB, edited, gltf, json};

/// What a run says on standard error; it ends with this status.
fn messages_of(folder: &Folder, arguments: &str, status: i32) -> String {
    let assert = folder.gelsim(arguments).assert().code(status);
    String::from_utf8_lossy(&assert.get_output().stderr).into_owned()
}

/// A box between two corners, from vertex `from` on.
fn cuboid([x0, y0, z0]: [f64; 3], [x1, y1, z1]: [f64; 3], from: usize) -> String {
    let mut text = String::new();
    for z in [z0, z1] {
        for (x, y) in [(x0, y0), (x1, y0), (x1, y1), (x0, y1)] {
            text += &format!("v {x} {y} {z}\n");
        }
    }
    for quad in [[0, 3, 2, 1], [4, 5, 6, 7], [0, 1, 5, 4], [1, 2, 6, 5], [2, 3, 7, 6], [3, 0, 4, 7]] {
        let [a, b, c, d] = quad.map(|corner| corner + from + 1);
        text += &format!("f {a} {b} {c} {d}\n");
    }
    text
}

/// How many samples of the dataset touch the pad.
fn touching(folder: &Folder, name: &str) -> usize {
    let touches =
        |label: &&Value| label["contact"]["area_px"].as_f64().or(label["contact"]["area_mm2"].as_f64()) > Some(0.0);
    folder.labels(name).values().filter(touches).count()
}

/// The job of [`JOB`] with one object, and no sample without contact.
fn one_object(path: &str, more: &str) -> String {
    let rest = JOB.split_once("[pose]").expect("a pose").1;
    let head = JOB.split_once("[[object]]").expect("an object").0;
    let text = format!("{head}[[object]]\npath = \"{path}\"\n{more}\n[pose]{rest}");
    edited(&text, &[("no_contact = 0.25", "no_contact = 0.0")])
}

#[test]
fn an_object_larger_than_the_view_is_brought_into_it_by_what_plan_advises() {
    let folder = Folder::new();
    // A plate of 200 mm whose lowest part is a block at its corner.
    let plate = cuboid([0.0, 0.0, 0.0], [200.0, 200.0, 5.0], 0) + &cuboid([0.0, 0.0, -10.0], [6.0, 6.0, 0.0], 8);
    folder.write("plate.obj", plate);
    folder.write("job.toml", one_object("plate.obj", ""));
    let before = messages_of(&folder, "plan job.toml", 0);
    assert!(before.contains("0 of 8 samples that were tried touch the pad"), "{before}");
    assert!(before.contains("write anchor = \"contact\" under [pose]"), "{before}");
    // generate says it, too, and before it begins.
    assert!(messages_of(&folder, "generate job.toml --out missed", 0).starts_with("warning: 0 of 8"));
    assert_eq!(touching(&folder, "missed"), 0);
    folder.write("job.toml", edited(&one_object("plate.obj", ""), &[("[pose]\n", "[pose]\nanchor = \"contact\"\n")]));
    let after = messages_of(&folder, "generate job.toml --out met", 0);
    assert!(!after.contains("warning"), "{after}");
    assert_eq!(touching(&folder, "met"), 8);
}

#[test]
fn a_ring_around_the_view_is_placed_where_plan_advises() {
    let folder = Folder::new();
    // 60 mm across, with nothing in the middle; level, all of it touches first.
    let blocks = (0..48).map(|k| {
        let (sin, cos) = (std::f64::consts::TAU * f64::from(k) / 48.0).sin_cos();
        let [x, y] = [29.0 * cos, 29.0 * sin];
        cuboid([x - 1.5, y - 1.5, 0.0], [x + 1.5, y + 1.5, 4.0], 8 * k as usize)
    });
    folder.write("ring.obj", blocks.collect::<String>());
    let job = edited(
        &one_object("ring.obj", ""),
        &[
            ("tilt_deg = { uniform = [0.0, 8.0] }", "tilt_deg = 0.0"),
            ("x_mm = { normal = { mean = 0.0, std = 1.0, min = -3.0, max = 3.0 } }", "x_mm = 0.0"),
            ("y_mm = [-2.0, 2.0]", "y_mm = 0.0"),
        ],
    );
    folder.write("job.toml", job.as_str());
    let said = messages_of(&folder, "plan job.toml", 0);
    let (_, advice) = said.split_once("help: write x_mm = ").unwrap_or_else(|| panic!("{said}"));
    let (x, rest) = advice.split_once(" and y_mm = ").expect("two numbers");
    let y = rest.split_once(" under [pose]").expect("where").0;
    folder.write(
        "job.toml",
        edited(&job, &[("x_mm = 0.0", &format!("x_mm = {x}")), ("y_mm = 0.0", &format!("y_mm = {y}"))]),
    );
    folder.succeed("generate job.toml --out met --quiet");
    assert_eq!(touching(&folder, "met"), 8);
}

#[test]
fn a_mesh_in_another_unit_is_pressed_when_its_unit_is_written() {
    let folder = Folder::new();
    let metres: String = folder
        .read("cube.obj")
        .lines()
        .map(|line| match line.strip_prefix("v ") {
            Some(corner) => {
                let xyz = corner.split_whitespace().map(|word| word.parse::<f64>().expect("a number") / 1000.0);
                format!("v {}\n", xyz.map(|value| value.to_string()).collect::<Vec<_>>().join(" "))
            }
            None => format!("{line}\n"),
        })
        .collect();
    folder.write("metres.obj", metres);
    folder.write("job.toml", one_object("metres.obj", ""));
    for command in ["plan job.toml", "preview job.toml --out sheet.png --count 2", "generate job.toml --out small"] {
        let before = messages_of(&folder, command, 0);
        assert!(
            before.contains("look like metres (5 mm)") && before.contains("write unit = \"m\""),
            "{command}: {before}"
        );
    }
    folder.write("job.toml", one_object("metres.obj", "unit = \"m\""));
    folder.succeed("generate job.toml --out right --strict");
    assert_eq!(touching(&folder, "right"), 8);
}

#[test]
fn a_rim_without_thickness_is_said_by_every_command() {
    let folder = Folder::new();
    // A tube of one layer of triangles.
    let corner = |k: usize| (std::f64::consts::TAU * k as f64 / 60.0).sin_cos();
    let ring =
        |z: f64| (0..60).map(move |k| (corner(k), z)).map(|((y, x), z)| format!("v {} {} {z}\n", 5.0 * x, 5.0 * y));
    let mut text: String = ring(0.0).chain(ring(12.0)).collect();
    for k in 0..60 {
        let next = (k + 1) % 60;
        text += &format!("f {} {} {} {}\n", k + 1, next + 1, next + 61, k + 61);
    }
    fs::create_dir(folder.path("set")).expect("a folder");
    folder.write("set/tube.obj", text);
    folder
        .write("job.toml", edited(&one_object("set/tube.obj", ""), &[("[pose]\n", "[pose]\nanchor = \"contact\"\n")]));
    for command in ["plan job.toml", "generate job.toml --out out", "preview job.toml --out sheet.png --count 2"] {
        let said = messages_of(&folder, command, 0);
        assert!(said.contains("warning: ") && said.contains("narrower than two pixels"), "{command}: {said}");
    }
    for command in ["inspect set/tube.obj --strict", "inspect set --strict"] {
        let assert = folder.gelsim(command).assert().code(1);
        let output = assert.get_output();
        let both = [&output.stdout[..], &output.stderr[..]].concat();
        let said = String::from_utf8_lossy(&both).into_owned();
        assert!(said.contains("narrower than two pixels") || said.contains("slips between the pixels"), "{said}");
    }
}

#[test]
fn two_hundred_meshes_with_one_fault_are_one_message() {
    let folder = Folder::new();
    fs::create_dir(folder.path("set")).expect("a folder");
    for k in 0..200 {
        folder.write(&format!("set/{k:03}.obj"), cuboid([0.0; 3], [0.004, 0.005, 0.006], 0));
    }
    folder.write("job.toml", one_object("set/*.obj", ""));
    let said = messages_of(&folder, "plan job.toml", 0);
    assert!(said.contains("200 meshes look like another unit: set/000.obj (0.006 mm), set/001.obj (0.006 mm), set/002.obj (0.006 mm) and 197 more") || said.contains("and 197 more"), "{said}");
    assert!(said.matches("warning: ").count() <= 2, "{said}");
}

#[test]
fn what_needs_nothing_done_does_not_stop_a_strict_run() {
    let folder = Folder::new();
    // Triangles without area, and one twice.
    let mesh = cuboid([-2.5, -2.5, 0.0], [2.5, 2.5, 5.0], 0) + "f 1 1 2\nf 3 3 3\nf 1 4 3\nf 1 4 3\n";
    folder.write("flawed.obj", mesh);
    folder.write("job.toml", one_object("flawed.obj", ""));
    assert_eq!(messages_of(&folder, "plan job.toml --strict", 0), "");
    let all = messages_of(&folder, "plan job.toml --verbose", 0);
    assert!(all.contains("info: flawed.obj: dropped"), "{all}");
}

/// A ball of 4 mm, 1 mm deep, as a depth camera 10 mm over the pad sees it; in mm times `by`.
fn frame(by: f64) -> Vec<u8> {
    let value = |k: usize| {
        let (x, y) = ((k % 48) as f64 - 24.0, (k / 48) as f64 - 18.0);
        let deep = 1.0 - 0.0217 * (x * x + y * y);
        by * if deep > 0.0 { 10.0 - deep } else { 60.0 }
    };
    let values: Vec<f32> = (0..48 * 36).map(|k| value(k) as f32).collect();
    npy::encode(48, 36, &[&values])
}

const HERE: &str = "--sensor gelsight-2014 --set sensor.resolution_px=[48,36]";

#[test]
fn a_frame_in_another_unit_or_from_another_plane_is_pressed_as_deep_as_it_is_when_the_advice_is_followed() {
    let folder = Folder::new();
    fs::write(folder.path("mm.npy"), frame(1.0)).expect("a frame");
    fs::write(folder.path("m.npy"), frame(1e-3)).expect("a frame");
    let right = format!("render --depth mm.npy --depth-unit mm --plane-mm 10 {HERE} --out right");
    folder.succeed(&right);
    for (number, (wrong, advice, mended)) in [
        ("m.npy --depth-unit m --plane-mm 0.01", "--plane-mm 10", "m.npy --depth-unit m --plane-mm 10"),
        ("m.npy --depth-unit mm --plane-mm 10", "--depth-unit m", "m.npy --depth-unit m --plane-mm 10"),
        ("mm.npy --depth-unit m --plane-mm 10", "--depth-unit mm", "mm.npy --depth-unit mm --plane-mm 10"),
    ]
    .into_iter()
    .enumerate()
    {
        let out = format!("wrong-{number}");
        let refused = messages_of(&folder, &format!("render --depth {wrong} {HERE} --out {out}"), 2);
        assert!(refused.contains(advice), "{wrong}: {refused}");
        assert!(!folder.path(&out).exists());
        folder.succeed(&format!("render --depth {mended} {HERE} --out {out}"));
        let name = mended.split('.').next().expect("a stem");
        let depth = |file: &str| json(&folder, file)["contact"]["max_depth_mm"].as_f64();
        let [found, expected] = [depth(&format!("{out}/{name}.json")), depth("right/mm.json")];
        let [found, expected] = [found, expected].map(|depth| depth.expect("a depth"));
        assert!((found - 1.0).abs() < 1e-3 && (found - expected).abs() < 1e-5, "{wrong}: {found}");
    }
}

#[test]
fn a_stream_in_another_unit_is_told() {
    let folder = Folder::new();
    for (unit, bytes, status, advice) in
        [("mm", frame(1e-3), 1, "--depth-unit m"), ("m", [frame(1.0), frame(1.0)].concat(), 0, "--depth-unit mm")]
    {
        let mut command = folder.gelsim(&format!("render --stream --depth-unit {unit} --plane-mm 10 {HERE}"));
        let output = command.write_stdin(bytes).output().expect("it runs");
        let said = String::from_utf8_lossy(&output.stderr).into_owned();
        assert_eq!(output.status.code(), Some(status), "{said}");
        assert!(said.contains(advice), "{unit}: {said}");
        assert!(said.matches("nothing reaches the pad").count() <= 1, "{said}");
    }
}

#[test]
fn a_place_that_looks_like_an_address_is_refused() {
    let folder = Folder::with_job(JOB);
    let before = folder.files("");
    for (out, advice) in [
        ("s3:/b/x", "s3://b/x"),
        ("gs:/b/x", "gs://b/x"),
        ("file:/b/x", "file:///b/x"),
        ("~/x", "write it without quotes"),
    ] {
        for command in ["generate job.toml", "plan job.toml", "preview job.toml", "tradeoff job.toml"] {
            let said = messages_of(&folder, &format!("{command} --out {out}"), 2);
            assert!(said.contains(advice), "{command} {out}: {said}");
        }
    }
    assert_eq!(before, folder.files(""));
    // As the message says, a folder of that name.
    folder.succeed("generate job.toml --quiet --out ./s3:/b/x");
    assert!(folder.path("s3:/b/x/dataset.json").is_file());
}

#[test]
fn the_error_of_the_model_has_a_range() {
    let folder = Folder::new();
    // A box whose flat side fills the view but for a few pixels.
    folder.write("wall.obj", cuboid([-9.3, -30.0, 0.0], [30.0, 30.0, 5.0], 0));
    let job = one_object("wall.obj", "");
    let level = edited(
        &job,
        &[
            ("tilt_deg = { uniform = [0.0, 8.0] }", "tilt_deg = 0.0"),
            ("\nyaw_deg = [0.0, 360.0]", "\nyaw_deg = 0.0\nanchor = \"origin\""),
            ("x_mm = { normal = { mean = 0.0, std = 1.0, min = -3.0, max = 3.0 } }", "x_mm = 0.0"),
            ("y_mm = [-2.0, 2.0]", "y_mm = 0.0"),
            ("{ log_uniform = [0.3, 1.2] }", "[0.3, 0.5]"),
        ],
    );
    folder.write("job.toml", level);
    folder.succeed("generate job.toml --out out --quiet");
    for label in folder.labels("out").values() {
        let numerics = &label["numerics"];
        assert!(numerics["model_error_um"].is_null(), "{numerics}");
        let why = numerics["model_error_unknown"].as_str().expect("a reason");
        assert!(why.contains("wider beside the pad's thickness"), "{why}");
    }
    // A cone's is known, and no reason is given.
    folder.write("job.toml", one_object("cone.obj", ""));
    folder.succeed("generate job.toml --out cone --quiet");
    for label in folder.labels("cone").values() {
        let numerics = &label["numerics"];
        assert!(numerics["model_error_um"].as_f64().is_some_and(|um| um < 1000.0), "{numerics}");
        assert_eq!(numerics["model_error_unknown"], "", "{numerics}");
    }
}

#[test]
fn a_level_on_the_command_line_keeps_the_friction_of_a_frame() {
    let folder = Folder::new();
    fs::write(folder.path("mm.npy"), frame(1.0)).expect("a frame");
    let render = |more: &str, out: &str| {
        folder
            .gelsim(&format!("render --depth mm.npy --depth-unit mm --plane-mm 10 {HERE} {more} --out {out}"))
            .assert()
    };
    let stick = "--set gelpad.elastic.friction=\"stick\"";
    let force = |out: &str| json(&folder, &format!("{out}/mm.json"))["contact"]["force_n"].as_f64().expect("a force");
    render("--fidelity high", "slides").success();
    render(&format!("--fidelity high {stick}"), "sticks").success();
    assert!(force("sticks") > 1.02 * force("slides"), "{} {}", force("sticks"), force("slides"));
    let refused = render(&format!("--fidelity paper {stick}"), "none").code(2);
    let said = String::from_utf8_lossy(&refused.get_output().stderr).into_owned();
    assert!(said.contains("--set:1:") && said.contains("--fidelity"), "both places: {said}");
    assert!(!folder.path("none").exists());
}

/// An LED, whose other keys follow.
const LED: &str = "[[sensor.led]]\nname = \"a\"\nazimuth_deg = 90.0\nelevation_deg = 30.0\nintensity = 0.5\n";

#[test]
fn keys_that_change_nothing_are_said_and_have_an_effect_when_the_advice_is_followed() {
    let folder = Folder::new();
    let coulomb = "friction = { coulomb = { coefficient = 0.5 } }\n";
    for (more, notes, mended) in [
        (
            format!("[shear]\n{coulomb}"),
            ["`shear.friction` has no effect", "add x_mm = [-0.3, 0.3]"],
            format!("[shear]\nx_mm = [-0.3, 0.3]\n{coulomb}[markers]\npitch_mm = 1.5\n"),
        ),
        (
            String::from("[shear]\nx_mm = [-0.3, 0.3]\n"),
            ["`shear` has no effect", "add a [markers] table or the layer flow"],
            String::from("[shear]\nx_mm = [-0.3, 0.3]\n[markers]\npitch_mm = 1.5\n"),
        ),
        (
            String::from("[texture]\nscale_mm = 0.3\n"),
            ["`texture` has no effect", "add amplitude_mm = [0.01, 0.05]"],
            String::from("[texture]\namplitude_mm = [0.01, 0.05]\nscale_mm = 0.3\n"),
        ),
        (
            String::from("[sensor.window]\ndistance_mm = 60.0\n"),
            ["`sensor.window` has no effect", "choose optics = \"led\""],
            String::from("[optics.led]\n[sensor.window]\ndistance_mm = 60.0\n"),
        ),
        (
            String::from("[sensor.coat]\nalbedo = 0.4\n"),
            ["`sensor.coat` has no effect", "choose optics = \"led\""],
            String::from("[optics.led]\n[sensor.coat]\nalbedo = 0.4\n"),
        ),
        (
            format!("{LED}size_mm = [4.0, 1.0]\n"),
            ["`sensor.led.0.size_mm` has no effect", "choose optics = \"led\""],
            format!("[optics.led]\n{LED}size_mm = [4.0, 1.0]\n"),
        ),
        (
            format!("{LED}lobe = 2.0\n"),
            ["`sensor.led.0.lobe` has no effect", "choose optics = \"led\""],
            format!("[optics.led]\n{LED}lobe = 2.0\n"),
        ),
        (
            String::from("[sensor]\npreset = \"gelsight-series2\"\ndarkening = 0.2\n"),
            ["`sensor.darkening` has no effect", "leave it out"],
            String::from("[sensor]\npreset = \"gelsight-series2\"\n"),
        ),
        (
            String::from("[sensor]\npreset = \"gelsight-series2\"\ngrain = { height_um = 1.0, size_mm = 0.3 }\n"),
            ["`sensor.grain` has no effect", "leave it out"],
            String::from("[sensor]\npreset = \"gelsight-series2\"\n"),
        ),
        (
            String::from("[gelpad]\nrelaxation = [{ share = 0.2, time_s = 0.5 }]\n"),
            ["`relaxation` has no effect", "leave it out"],
            String::new(),
        ),
    ] {
        let job_with = |more: &str| match more.strip_prefix("[sensor]\n") {
            Some(keys) => {
                // As its view is.
                let size = ("resolution_px = [48, 36]", "resolution_px = [48, 40]");
                edited(&one_object("cube.obj", ""), &[("[sensor]\n", &format!("[sensor]\n{keys}")), size])
            }
            None => format!("{}\n{more}", one_object("cube.obj", "")),
        };
        folder.write("job.toml", job_with(&more));
        let before = messages_of(&folder, "plan job.toml", 0);
        assert!(before.contains("note: ") && notes.iter().all(|note| before.contains(note)), "{more}: {before}");
        folder.write("job.toml", job_with(&mended));
        assert_eq!(messages_of(&folder, "plan job.toml --strict", 0), "", "{mended}");
    }
}

#[test]
fn named_objects_go_to_the_split_that_they_name() {
    let folder = Folder::new();
    let job = edited(
        JOB,
        &[
            ("seed = 7", "seed = 7\nsplit_by = \"object\""),
            ("path = \"cube.obj\"", "path = \"cube.obj\"\nsplit = \"test\""),
        ],
    );
    let job =
        edited(&job, &[("splits = { train = 0.5, val = 0.25, test = 0.25 }", "splits = { train = 0.5, test = 0.5 }")]);
    folder.write("job.toml", job);
    folder.succeed("generate job.toml --quiet --out out");
    for label in folder.labels("out").values() {
        let expected = if label["object"]["id"] == "cube" { "test" } else { "train" };
        assert_eq!(label["split"], expected, "{label}");
    }
}

#[test]
fn images_are_read_by_their_bytes_wherever_one_is_read() {
    let folder = Folder::new();
    let picture = image::RgbImage::from_fn(48, 36, |x, y| image::Rgb([60 + x as u8, 80 + y as u8, 100]));
    for (name, format) in [
        ("a.jpg", image::ImageFormat::Jpeg),
        // As a browser or a converter may have named it.
        ("b.png", image::ImageFormat::Jpeg),
        ("c.bmp", image::ImageFormat::Bmp),
        ("d.tif", image::ImageFormat::Tiff),
        ("e.webp", image::ImageFormat::WebP),
        ("f.jpg", image::ImageFormat::Png),
    ] {
        let mut bytes = std::io::Cursor::new(Vec::new());
        image::DynamicImage::ImageRgb8(picture.clone()).write_to(&mut bytes, format).expect("encoded");
        fs::write(folder.path(name), bytes.into_inner()).expect("a file");
        folder.write(
            "job.toml",
            edited(JOB, &[("resolution_px =", &format!("background = \"{name}\"\nresolution_px ="))]),
        );
        folder.succeed(&format!("generate job.toml --quiet --samples 2 --out {name}-set"));
    }
    // A damaged one is said in plain words.
    let mut bytes = fs::read(folder.path("f.jpg")).expect("a file");
    let at = bytes.len() / 2;
    bytes[at] ^= 0x55;
    fs::write(folder.path("g.png"), bytes).expect("a file");
    fs::write(folder.path("h.png"), "version https://git-lfs.github.com/spec/v1\noid sha256:0\nsize 5\n")
        .expect("a file");
    for (name, words) in [("g.png", "the PNG is damaged"), ("h.png", "a pointer of Git LFS")] {
        folder.write(
            "job.toml",
            edited(JOB, &[("resolution_px =", &format!("background = \"{name}\"\nresolution_px ="))]),
        );
        let said = messages_of(&folder, "plan job.toml", 2);
        assert!(said.contains(words) && !said.contains("Png:") && !said.contains("Huffman"), "{said}");
    }
}

#[test]
fn what_is_in_a_folder_shard_or_in_its_place_is_named() {
    let folder = Folder::with_job(&edited(JOB, &[("[output]\n", "[output]\ncontainer = \"folder\"\n")]));
    folder.succeed("generate job.toml --quiet --out out");
    fs::write(folder.path("out/data/train-000000/.hidden"), "x").expect("a file");
    let verified = |status: i32| {
        let assert = folder.gelsim("verify out").assert().code(status);
        String::from_utf8_lossy(&assert.get_output().stdout).into_owned()
    };
    let shown = verified(1);
    assert!(shown.contains("data/train-000000/.hidden: belongs to no shard"), "{shown}");
    assert!(shown.contains("rm out/data/train-000000/.hidden"), "{shown}");
    fs::remove_file(folder.path("out/data/train-000000/.hidden")).expect("as advised");
    verified(0);
    // A link in place of the shard.
    fs::rename(folder.path("out/data/train-000000"), folder.path("elsewhere")).expect("moved");
    std::os::unix::fs::symlink(folder.path("elsewhere"), folder.path("out/data/train-000000")).expect("a link");
    let shown = verified(1);
    assert!(shown.contains("is a symbolic link") && !shown.contains("os error"), "{shown}");
    assert!(shown.contains("\n  rm out/data/train-000000\n"), "{shown}");
    fs::remove_file(folder.path("out/data/train-000000")).expect("as advised");
    folder.succeed("generate out/job.toml --quiet --out out");
    verified(0);
    assert!(folder.path("elsewhere").is_dir(), "what was linked stays");
}

#[test]
fn a_plan_whose_samples_are_all_rejected_ends_soon_and_says_so() {
    let folder = Folder::new();
    let job = edited(
        &one_object("cube.obj", ""),
        &[("layers = [", "on_unhealthy = \"reject\"\nlayers = ["), ("samples = 8\n", "samples = 100000\n")],
    );
    // A solver that may not iterate is never done.
    folder.write("job.toml", format!("gelpad = {{ elastic = {{ max_iterations = 1, tolerance_um = 0.01 }} }}\n{job}"));
    let plan = folder.gelsim("plan job.toml").assert().success();
    let said = String::from_utf8_lossy(&plan.get_output().stderr).into_owned();
    assert!(said.contains("warning: ") && said.contains("reject"), "{said}");
}

#[test]
fn sixty_frames_with_one_fault_are_one_message() {
    let folder = Folder::new();
    fs::create_dir(folder.path("frames")).expect("a folder");
    let mut values: Vec<f32> = vec![60.0; 48 * 36];
    values[100] = f32::NAN;
    for k in 0..60 {
        fs::write(folder.path(&format!("frames/{k:02}.npy")), npy::encode(48, 36, &[&values])).expect("a frame");
    }
    let said =
        messages_of(&folder, &format!("render --depth frames --depth-unit mm --plane-mm 10 {HERE} --out out"), 2);
    assert_eq!(said.matches("error: ").count(), 1, "{said}");
    assert!(said.contains("60") && said.contains("00.npy") && said.contains("57 more"), "{said}");
    assert!(said.contains("--background-value=nan"), "{said}");
}

#[test]
fn a_format_that_states_its_unit_is_believed() {
    let folder = Folder::new();
    for (name, length) in [("small.gltf", 0.005), ("tiny.gltf", 0.0004), ("large.gltf", 0.9)] {
        folder.write(name, gltf(length));
        folder.write("job.toml", one_object(name, ""));
        let said = messages_of(&folder, "plan job.toml", 0);
        assert!(!said.contains("look like") && !said.contains("write unit"), "{name}: {said}");
    }
    // The same numbers in a format that states none.
    folder.write("small.obj", cuboid([0.0; 3], [0.005; 3], 0));
    folder.write("job.toml", one_object("small.obj", ""));
    assert!(messages_of(&folder, "plan job.toml", 0).contains("write unit = \"m\""));
}
