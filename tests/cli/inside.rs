//! `gelsim render` and `gelsim augment` with sensors whose gel has a shape: frames of a camera inside it.

use gelsim::SensorExt;
use gelsim::{Fidelity, Sensor};
use gelsim_core::camera::projection::Projection;
use gelsim_files::npy;
use gelsim_job::config::Overrides;
use gelsim_job::plan::Plan;
use glam::DVec3;
use serde_json::Value;

use crate::support::{Folder, json};

const SIZE: [usize; 2] = [96, 72];

/// What the lens of a sensor sees of a ball of 4 mm around a point, mm; 90 mm where nothing is.
fn ball(sensor: &Sensor, middle: DVec3) -> Vec<f32> {
    let [width, height] = SIZE;
    let looks = Projection::new(&sensor.lens, SIZE, [1.0; 2]);
    let pixel = |at: usize| {
        let (from, direction) = looks.ray_at([(at % width) as f64 + 0.5, (at / width) as f64 + 0.5]);
        let direction = direction.normalize();
        let to = middle - from;
        let half_chord = 16.0 - (to - direction * to.dot(direction)).length_squared();
        let mm = (to.dot(direction) - half_chord.max(0.0).sqrt()) * direction.dot(looks.optical_axis());
        if half_chord > 0.0 { mm as f32 } else { 90.0 }
    };
    (0..width * height).map(pixel).collect()
}

fn array(values: &[f32]) -> Vec<u8> {
    npy::encode(SIZE[0], SIZE[1], &[values])
}

/// A folder with frames of a ball that comes out of the tip of a GelTip: 0.8 mm deep, 0.4 mm deep, and above it.
fn frames() -> Folder {
    let folder = Folder::new();
    std::fs::create_dir_all(folder.path("frames")).expect("a folder");
    let sensor = Sensor::preset("geltip").expect("a preset");
    for (name, deep) in [("a", 0.8), ("b", 0.4), ("c", -0.5)] {
        let middle = DVec3::new(0.3, -0.2, 4.0 - deep);
        folder.write(&format!("frames/{name}.npy"), array(&ball(&sensor, middle)));
    }
    folder
}

const HERE: &str = "--depth-unit mm --max-depth-mm 80 --sensor geltip --set camera.read_noise_levels=0.0";

#[test]
fn frames_of_a_ball_give_what_generate_gives_of_it() {
    let folder = frames();
    let said = folder.succeed(&format!("render --depth frames {HERE} --layers depth,contact --out out"));
    assert_eq!(said, "3 frames, 2 in contact -> out\n");
    std::fs::copy(crate::support::repository().join("objects/sphere.obj"), folder.path("sphere.obj")).expect("a mesh");
    folder.write(
        "job.toml",
        "[dataset]\nname = \"own\"\nsamples = 1\nseed = 1\n[sensor]\npreset = \"geltip\"\nresolution_px = [96, 72]\n\
         [[object]]\npath = \"sphere.obj\"\n[pose]\nx_mm = 0.3\ny_mm = -0.2\n[indentation]\ndepth_mm = 0.8\n\
         [camera]\nread_noise_levels = 0.0\n",
    );
    folder.succeed("generate job.toml --quiet --out set");
    let (_, own) = folder.labels("set").pop_first().expect("a sample");
    let label = json(&folder, "out/a.json");
    let number = |label: &Value, path: &str| label.pointer(path).and_then(Value::as_f64).expect(path);
    // The bundled ball has facets, and the pixels are 1 mm wide.
    let share = number(&label, "/contact/force_n") / number(&own, "/contact/force_n");
    assert!((0.85..1.02).contains(&share), "{share}");
    assert!((number(&label, "/indentation_depth_mm") - 0.8).abs() < 0.05, "{label}");
    assert_eq!((&label["contact"]["total_force_n"], &label["health"]["unseen_px"]), (&Value::Null, &0.into()));
    assert!(number(&label, "/contact/force_vector_n/2") < 0.0);
    let free = json(&folder, "out/c.json");
    assert!(free["contact"]["in_contact"] == false && free["contact"]["force_n"] == 0.0, "{free}");

    // The same from a pipe, byte for byte.
    let stream: Vec<u8> =
        ["a", "b", "c"].iter().flat_map(|name| folder.read_bytes(&format!("frames/{name}.npy"))).collect();
    let run = folder.gelsim(&format!("render --stream {HERE}")).write_stdin(stream).output().expect("a run");
    assert!(run.status.success(), "{}", String::from_utf8_lossy(&run.stderr));
    let length = 128 + 3 * SIZE[0] * SIZE[1];
    for (name, image) in ["a", "b", "c"].iter().zip(run.stdout.chunks(length)) {
        let written = gelsim_files::image_file::decode_rgb(&folder.read_bytes(&format!("out/{name}.tactile.png")))
            .expect("a PNG");
        assert!(image[128..] == *written.as_raw(), "{name}");
    }
}

#[test]
fn what_the_lens_says_is_not_said_again_and_a_flat_pad_needs_its_plane() {
    let folder = frames();
    for (flags, said) in [
        ("--plane-mm 45", "this sensor's gel has a shape"),
        ("--projection orthographic", "--projection orthographic is for flat pads"),
        ("--fov-y-deg 40", "--fov-y-deg belongs to --projection perspective"),
        ("--projection perspective --fov-y-deg 175", "--fov-y-deg 175 is out of range"),
        (
            "--set texture.amplitude_mm=0.1 --set texture.scale_mm=1.0 --sequence 0.3 --poses p.csv",
            "texture in a sequence",
        ),
        ("--set fidelity=\"paper\"", "a pad that is not elastic"),
    ] {
        folder.write("p.csv", "file,x_mm,y_mm,z_mm\na,0,0,0\nb,0,0,1\nc,0,0,2\n");
        let found = folder.fail(&format!("render --depth frames {HERE} --out out {flags}"), 2);
        assert!(found.contains(said), "{flags}: {found}");
    }
    let found = folder.fail("render --depth frames --depth-unit mm --sensor digit --out out", 2);
    assert!(found.contains("--plane-mm is needed"), "{found}");
    // Of a lens with parallel rays the plane is at the tip.
    let found = folder.fail(&format!("render --depth frames {HERE} --set sensor.lens=\"orthographic\" --out out"), 2);
    assert!(found.contains("--plane-mm is needed"), "{found}");
}

#[test]
fn frames_that_cannot_be_right_are_named_with_the_likely_fix() {
    let folder = frames();
    let sensor = Sensor::preset("geltip").expect("a preset");
    let good = ball(&sensor, DVec3::new(0.0, 0.0, 3.2));
    let edited = |at: usize, value: f32| {
        let mut frame = good.clone();
        frame[at] = value;
        array(&frame)
    };
    for (name, bytes, first, said) in [
        ("nan", edited(97, f32::NAN), "", "bad/nan.npy: 1 pixel is no distance: NaN in row 1, column 1"),
        ("zero", edited(1, 0.0), "", "bad/zero.npy: 1 pixel is no distance: 0 in row 0, column 1"),
        ("behind", edited(0, -2.0), "", "bad/behind.npy: 1 pixel is no distance: behind the camera in row 0, column 0"),
        (
            "metres",
            array(&good.iter().map(|mm| mm / 1000.0).collect::<Vec<_>>()),
            "",
            "the values look like metres: --depth-unit m",
        ),
        (
            "other",
            npy::encode(4, 3, &[&[50.0; 12]]),
            "frames/a.npy ",
            "other.npy: it has 4x3 px, and the first frame has 96x72",
        ),
        ("far", array(&[90.0; 96 * 72]), "", "nothing is seen in any frame"),
        ("beyond", array(&good.iter().map(|mm| mm + 3.0).collect::<Vec<_>>()), "", "nothing reaches the gel"),
    ] {
        std::fs::create_dir_all(folder.path("bad")).expect("a folder");
        folder.write(&format!("bad/{name}.npy"), bytes);
        let found = folder.fail(&format!("render --depth {first}bad/{name}.npy {HERE} --out out"), 2);
        assert!(found.contains(said), "{name}: {found}");
    }
    // A lens that looks to its side: there an axis says nothing.
    let wide = "--set sensor.lens={fisheye={fov_deg=200.0,position_mm=[0.0,0.0,-20.0],look_at_mm=[0.0,0.0,0.0]}}";
    let found = folder.fail(&format!("render --depth frames {HERE} {wide} --out out"), 2);
    assert!(
        found.contains("where distances along the axis say nothing") && found.contains("--depth-along ray"),
        "{found}"
    );
}

#[test]
fn a_real_set_of_a_finger_is_enlarged_in_its_own_light() {
    let folder = Folder::new();
    std::fs::copy(crate::support::repository().join("objects/sphere.obj"), folder.path("sphere.obj")).expect("a mesh");
    folder.write(
        "job.toml",
        "[dataset]\nname = \"real\"\nsamples = 3\nseed = 1\n[sensor]\npreset = \"geltip\"\nresolution_px = [96, 72]\n\
         [[object]]\npath = \"sphere.obj\"\n[pose]\nfrom_tip_mm = [0.0, 10.0]\n[indentation]\ndepth_mm = 0.8\n\
         [output]\nlayers = [\"reference\"]\n",
    );
    folder.succeed("generate job.toml --quiet --out real");
    let (_, first) = folder.samples("real").pop_first().expect("a sample");
    folder.write("background.png", &first["reference.png"]);
    let recipe = |photometric: &str, rest: &str| {
        format!(
            "seed = 7\n[input]\npath = \"real\"\nbackground = \"background.png\"\n[sensor]\npreset = \"geltip\"\n\
             [[photometric]]\n{photometric}\n{rest}\n"
        )
    };
    // What the sensor renders is what its samples have for a background: nothing changes.
    let mixing = "[mixing]\njob = \"job.toml\"\nsynthetic_per_real = 1.0";
    folder.write("augment.toml", recipe("background = [\"rendered\"]", mixing));
    folder.succeed("augment augment.toml --quiet --out larger");
    let (mut copies, mut synthetic) = (0, 0);
    let larger: Vec<(String, Vec<u8>)> = folder
        .files("larger")
        .into_keys()
        .filter(|name| name.ends_with(".tar"))
        .flat_map(|name| crate::support::members(&folder.path(&format!("larger/{name}"))))
        .filter(|member| member.name.ends_with(".tactile.png"))
        .map(|member| (member.name, member.bytes))
        .collect();
    let pixels = |bytes: &[u8]| gelsim_files::image_file::decode_rgb(bytes).expect("a PNG").into_raw();
    for (name, bytes) in &larger {
        synthetic += u32::from(name.starts_with("synthetic"));
        if let Some((key, _)) = name.split_once("-photometric") {
            let (_, real) =
                larger.iter().find(|(name, _)| *name == format!("{key}.tactile.png")).expect("its real sample");
            assert!(pixels(bytes) == pixels(real), "{name}");
            copies += 1;
        }
    }
    assert_eq!((copies, synthetic), (3, 3));
    for (photometric, rest, said) in [
        ("markers = { pitch_mm = 1.0 }", "", "print on a gel that has a shape"),
        ("copies = 1", "[paired]\n[[object]]\npath = \"sphere.obj\"", "simulated counterparts are for flat pads"),
    ] {
        folder.write("augment.toml", recipe(photometric, rest));
        let found = folder.fail("augment augment.toml --quiet --out other", 2);
        assert!(found.contains(said), "{said}: {found}");
    }
}

#[test]
fn calibrate_says_what_to_do_for_a_gel_that_has_a_shape() {
    let folder = Folder::new();
    folder.write("presses.csv", "file,centre_x_px,centre_y_px,radius_px,ball_radius_mm,mm_per_px\n");
    for command in [
        "calibrate presses.csv --background b.png --sensor geltip --out own.toml",
        "calibrate --leds presses.csv --background b.png --sensor geltip --out own.toml",
        "calibrate --evaluate presses.csv --sensor geltip --out out",
    ] {
        let said = folder.fail(command, 2);
        for part in ["balls are calibrated on flat pads", "[[led]] table", "gelsim compare"] {
            assert!(said.contains(part), "{command}: {part}: {said}");
        }
    }
}

#[test]
fn plans_of_frames_keep_the_size_of_the_frames() {
    let overrides = Overrides { fidelity: Some(Fidelity::Draft), ..Overrides::default() };
    let frames = gelsim_job::plan::frames::FrameSettings {
        sensor: "allsight",
        resolution_px: [40, 60],
        layers: &[],
        classes: &[],
        moved: false,
        sequence: false,
        overrides: &overrides,
    };
    let plan: Plan = frames.resolve_plan().unwrap_or_else(|report| panic!("{report}"));
    assert_eq!(plan.simulator.sensor().resolution_px, [40, 60]);
}
