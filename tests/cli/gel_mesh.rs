//! Sensors whose gel is a mesh and whose pins stand in a file, from job to dataset, and what is said of those that make no sense.

use std::collections::BTreeMap;
use std::fmt::Write;

use crate::support::{Folder, assert_same_files};

const JOB: &str = r#"
dataset = { name = "a", samples = 3, seed = 2 }
object = [{ path = "cube.obj" }]
indentation = { depth_mm = 0.6 }
pose = { from_tip_mm = [0.0, 5.0], around_deg = [0.0, 360.0] }
output.layers = ["depth", "contact"]

[sensor]
file = "sensors/own.toml"
"#;

const SENSOR: &str = r#"
name = "own"
resolution_px = [48, 36]
gelpad_thickness_mm = 2.0
shape = { mesh = { path = "gel.obj" } }
lens.pinhole = { fov_deg = 60.0, position_mm = [0.0, 0.0, -15.0], look_at_mm = [0.0, 0.0, 0.0] }
led = [{ name = "a", azimuth_deg = 0.0, elevation_deg = 10.0 }, { name = "b", position_mm = [3.0, 4.0, -9.0] }]
"#;

/// A dome of 9 mm as OBJ, its tip at a height. `keep` says of which ring and step there is a face.
fn dome(tip_mm: f64, keep: impl Fn(usize, usize) -> bool) -> String {
    const AROUND: usize = 24;
    const RINGS: usize = 9;
    let mut text = format!("v 0 0 {tip_mm}\n");
    for (ring, step) in (1..=RINGS).flat_map(|ring| (0..AROUND).map(move |step| (ring, step))) {
        let (sin, cos) = (std::f64::consts::FRAC_PI_2 * ring as f64 / RINGS as f64).sin_cos();
        let (y, x) = (std::f64::consts::TAU * step as f64 / AROUND as f64).sin_cos();
        writeln!(text, "v {} {} {}", 9.0 * sin * x, 9.0 * sin * y, tip_mm - 9.0 + 9.0 * cos).expect("written");
    }
    let vertex = |ring: usize, step: usize| if ring == 0 { 1 } else { 2 + (ring - 1) * AROUND + step % AROUND };
    for (ring, step) in (0..RINGS).flat_map(|ring| (0..AROUND).map(move |step| (ring, step))) {
        let [a, b, c, d] = [(0, 0), (1, 0), (1, 1), (0, 1)].map(|(r, s)| vertex(ring + r, step + s));
        if keep(ring, step) {
            writeln!(text, "f {a} {b} {c}").expect("written");
            if ring > 0 {
                writeln!(text, "f {a} {c} {d}").expect("written");
            }
        }
    }
    text
}

fn folder(gel: &str, sensor: &str) -> Folder {
    let folder = Folder::new();
    std::fs::create_dir(folder.path("sensors")).expect("made");
    folder.write("sensors/gel.obj", gel);
    folder.write("sensors/own.toml", sensor);
    folder.write("job.toml", JOB);
    folder
}

fn edited(text: &str, from: &str, to: &str) -> String {
    assert!(text.contains(from), "{from}");
    text.replace(from, to)
}

/// Its pictures and layers.
fn bytes(folder: &Folder, out: &str) -> BTreeMap<String, Vec<u8>> {
    let files = folder
        .samples(out)
        .into_iter()
        .flat_map(|(key, files)| files.into_iter().map(move |(name, bytes)| (format!("{key}.{name}"), bytes)));
    files.filter(|(name, _)| !name.ends_with(".json")).collect()
}

#[test]
fn a_gel_of_ones_own_goes_from_job_to_dataset_and_back() {
    let folder = folder(&dome(0.0, |_, _| true), SENSOR);
    folder.succeed("generate job.toml --out one --threads 1");
    folder.succeed("generate job.toml --out two --threads 2 --all-effects");
    assert_same_files(&bytes(&folder, "one"), &bytes(&folder, "two"));
    // The job that was written makes the same, from where it lies; and another mesh is another dataset.
    let written = folder.read("one/job.toml");
    assert!(written.contains("gel.obj") && written.contains("sha256"), "{written}");
    folder.succeed("generate one/job.toml --out three");
    assert_same_files(&bytes(&folder, "one"), &bytes(&folder, "three"));
    folder.succeed("verify one");
    folder.write("sensors/gel.obj", dome(0.0, |_, _| true).replace("v 0 0 0", "v 0 0 0.01"));
    let text = folder.fail("generate one/job.toml --out four", 2);
    assert!(text.contains("has changed: its SHA-256 is") && text.contains("restore the file"), "{text}");
    let text = folder.fail("generate job.toml --out one", 2);
    assert!(
        text.contains("holds a dataset of another job: gel.obj has changed")
            || text.contains("sensors/gel.obj has changed"),
        "{text}"
    );
    let labels = folder.labels("one");
    assert!(labels.values().any(|label| label["contact"]["force_n"].as_f64() > Some(0.05)), "{labels:?}");
}

#[test]
fn gels_that_make_no_sense_are_refused_with_a_way_out() {
    let whole = dome(0.0, |_, _| true);
    let twice = format!("{whole}v 30 0 -5\nv 31 0 -5\nv 30 1 -5\nf -3 -2 -1\n");
    let three = format!("{whole}v 20 0 20\nf 1 2 -1\nf 1 2 3\n");
    let closed = format!("{whole}f {}\n", (194..=217).rev().map(|v| v.to_string()).collect::<Vec<_>>().join(" "));
    for (gel, from, to, said, way_out) in [
        (whole.as_str(), "gel.obj", "no.obj", "cannot read the gel's mesh", "a mesh of the gel's outer surface"),
        ("v 0 0 0\n", "", "", "no triangle", "a mesh of the gel's outer surface"),
        (&dome(9.0, |_, _| true), "", "", "leaves the gel at z = 9.000 mm", "offset_mm = [0.0, 0.0, -9.0]"),
        (&dome(0.0, |ring, _| ring > 2), "", "", "the z axis does not leave the gel", "turn the mesh, or move it"),
        (&dome(0.0, |ring, step| ring != 3 || step > 4), "", "", "a hole of", "where the camera looks"),
        (&twice, "", "", "the surface is in 2 pieces", "delete what else"),
        (&three, "", "", "sheets or more meet", "one sheet"),
        (&whole, "\"gel.obj\"", "\"gel.obj\", unit = \"m\"", "18000.000 mm across", "with unit = \"mm\" it is 18 mm"),
        (
            &whole,
            "\"gel.obj\"",
            "\"gel.obj\", offset_mm = [0.0, 0.0, 2.0]",
            "leaves the gel at z = 2.000",
            "[0.0, 0.0, 0.0]",
        ),
        (&whole, "\"gel.obj\"", "\"gel.obj\", sha256 = \"00\"", "no SHA-256: that of the gel's mesh", "sha256sum"),
        (&whole, "-15.0]", "1.0]", "the camera stands in the gel, or outside", "2 mm thick"),
        (
            &whole,
            "look_at_mm = [0.0, 0.0, 0.0]",
            "look_at_mm = [0.0, 0.0, -40.0]",
            "the camera sees no gel",
            "turn the camera",
        ),
        (&whole, "-9.0]", "1.0]", "the LED is outside of the gel", "below 0 inside"),
    ] {
        let folder = folder(gel, &edited(SENSOR, from, to));
        let text = folder.fail("generate job.toml --out a", 2);
        assert!(text.contains(said) && text.contains(way_out), "{said}: {text}");
        assert!(text.contains("sensors/own.toml:"), "{said} has a place: {text}");
    }
    // A flat bottom is no part of the gel, and it does not matter which way the triangles turn.
    let plain = folder(&whole, SENSOR);
    plain.succeed("generate job.toml --out a");
    let turned = whole.lines().map(|line| match line.strip_prefix("f ") {
        Some(corners) => format!("f {}", corners.split(' ').rev().collect::<Vec<_>>().join(" ")),
        None => line.to_owned(),
    });
    let rewound = turned.collect::<Vec<_>>().join("\n");
    let forces = |folder: &Folder| {
        let force = |label: serde_json::Value| label["contact"]["force_n"].as_f64().expect("an elastic pad");
        folder.labels("a").into_values().map(force).collect::<Vec<_>>()
    };
    let other = folder(&closed, SENSOR);
    other.succeed("generate job.toml --out a");
    assert_same_files(&bytes(&plain, "a"), &bytes(&other, "a"));
    let other = folder(&rewound, SENSOR);
    other.succeed("generate job.toml --out a");
    for (a, b) in forces(&plain).into_iter().zip(forces(&other)) {
        assert!((a - b).abs() <= 5e-3 * a, "{a} {b}");
    }
}

#[test]
fn a_place_beyond_the_rim_of_a_mesh_is_refused() {
    let folder = folder(&dome(0.0, |_, _| true), SENSOR);
    folder.write("job.toml", edited(JOB, "from_tip_mm = [0.0, 5.0]", "from_tip_mm = [0.0, 15.0]"));
    let text = folder.fail("generate job.toml --out a", 2);
    assert!(text.contains("from_tip_mm may be 15, and the gel ends 14.1 mm from its tip at around_deg ="), "{text}");
}

#[test]
fn pins_stand_where_a_file_says() {
    let pinned = |pins: &str| {
        let lit = SENSOR.find("led =").expect("it has LEDs");
        format!("{}led = []\n[pins]\nlength_mm = 1.0\ndiameter_mm = 1.0\n{pins}\n", &SENSOR[..lit])
    };
    let file = "layout = { file = \"pins.csv\" }";
    let with = |pins: &str, table: &str| {
        let folder = folder(&dome(0.0, |_, _| true), &pinned(pins));
        folder.write("sensors/pins.csv", table);
        folder.write("job.toml", JOB.replace("\"depth\", ", "\"pins\", "));
        folder
    };
    // The same seven pins, counted and named.
    let mut table = String::from("name,x_mm,y_mm\nmiddle,0,0\n");
    for k in 0..6 {
        let (sin, cos) = libm::sincos(std::f64::consts::TAU * f64::from(k) / 6.0);
        writeln!(table, "pin {k},{},{}", 2.0 * cos, 2.0 * sin).expect("written");
    }
    let counted = with("count = 7\nspacing_mm = 2.0", "");
    counted.succeed("generate job.toml --out a");
    let named = with(file, &table);
    named.succeed("generate job.toml --out a");
    named.succeed("generate a/job.toml --out b");
    assert_same_files(&bytes(&named, "a"), &bytes(&named, "b"));
    let pictures = |folder: &Folder| {
        let files = bytes(folder, "a").into_iter().filter(|(name, _)| name.ends_with(".png"));
        files.map(|(_, picture)| picture).collect::<Vec<_>>()
    };
    assert_eq!(pictures(&counted), pictures(&named));
    for (pins, table, said) in [
        (file, "x_mm,y_mm\n0,0\n1, a\n", "pins.csv:3:3: `a` is no place of a pin in mm"),
        (file, "x_mm,y_mm\n0\n", "pins.csv:2:1: `` is no place of a pin in mm"),
        (file, "x,y\n0,0\n", "pins.csv:1:1: the first line names no columns x_mm and y_mm"),
        (file, "x_mm,y_mm\n", "the table has no pins"),
        (file, "", "the table of pins is empty"),
        (file, "x_mm,y_mm\n0,13\n0,15\n", "the outermost pins stand 15.0 mm from the tip, over the rim"),
        ("layout = { file = \"pins.csv\" }\ncount = 7", "x_mm,y_mm\n0,0\n", "`count` beside a layout from a file"),
        ("layout = { file = \"none.csv\" }", "", "cannot read the table of pins"),
        ("count = 7", "", "missing key `spacing_mm` in [sensor.pins]"),
    ] {
        let text = with(pins, table).fail("generate job.toml --out a", 2);
        assert!(text.contains(said), "{said}: {text}");
    }
}
