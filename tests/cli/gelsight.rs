//! `gelsim calibrate --gelsight`: a calibration of six lamps as GelSight publishes them, made up here, becomes a sensor file.

use gelsim::SensorExt;
use std::fmt::Write as _;

use gelsim::Sensor;
use gelsim_files::png::encode_grey16;

use crate::support::{Folder, JOB, assert_same_files, edited};

const WIDTH: f64 = 64.0;
const HEIGHT: f64 = 48.0;
/// Width and height of a lamp's flat field.
const TILE: [usize; 2] = [16, 12];

/// `quadfit`: a factor for a term of the place (x^2, x y, y^2, x, y, 1) and a column.
fn factor(row: usize, column: usize) -> f64 {
    0.01 * ((7 * row + 3 * column) % 11) as f64 - 0.04 + if row == 5 && column % 10 == 9 { 0.5 } else { 0.0 }
}

fn scale(lamp: usize) -> f64 {
    0.3 + 0.05 * lamp as f64
}

/// The flat field of a lamp at a place from -1 to 1: of third degree, which the fit meets exactly.
fn flat_field(lamp: usize, x: f64, y: f64) -> f64 {
    scale(lamp) * (1.0 - 0.3 * x * x - 0.1 * y * y * y + 0.02 * lamp as f64 * x * y)
}

/// Six directions, 60 degrees apart, in another order than around the image.
const AZIMUTHS: [f64; 6] = [-120.0, 0.0, 120.0, -60.0, 60.0, 180.0];

fn yaml() -> String {
    let list = |numbers: Vec<f64>| numbers.iter().map(f64::to_string).collect::<Vec<_>>().join(", ");
    let directions: Vec<f64> = AZIMUTHS
        .into_iter()
        .flat_map(|degrees: f64| [0.4 * degrees.to_radians().cos(), 0.4 * degrees.to_radians().sin(), 0.5])
        .collect();
    let linfit = list([vec![0.1; 18], vec![-0.1; 18], directions].concat());
    let quadfit = list((0..6).flat_map(|row| (0..60).map(move |column| factor(row, column))).collect());
    // A list may go on over lines.
    let quadfit = quadfit.replacen(", ", ",\n        ", 20);
    let scales = list((0..6).map(scale).collect());
    let mut text = String::from("# made up\ncreatedon: 2026-01-01 10:00:00\nnL: 6\n");
    write!(text, "width: {WIDTH}\nheight: {HEIGHT}\nmmperpixel: 0.1\nparameters: \n    modelsize: 2\n").expect("text");
    write!(text, "linfit: \n    rows: 3\n    cols: 18\n    values: [{linfit}]\n").expect("text");
    write!(text, "quadfit: \n    rows: 6\n    cols: 60\n    values: [{quadfit}]\n").expect("text");
    let [width, height] = TILE;
    write!(text, "flatfield: \n    modelfile: flat.png\n    modelsize: ({width}, {height})\n    nL: 6\n")
        .expect("text");
    write!(text, "    scale: [{scales}]\n    size: ({WIDTH}, {HEIGHT})\ntargetscans: \n  - a142d428\n").expect("text");
    text
}

fn tiles() -> Vec<u8> {
    let [width, height] = TILE;
    let mut values = Vec::new();
    for row in 0..2 * height {
        for column in 0..3 * width {
            let lamp = row / height * 3 + column / width;
            let unit = |at: usize, count: usize| 2.0 * ((at % count) as f64 + 0.5) / count as f64 - 1.0;
            let value = flat_field(lamp, unit(column, width), unit(row, height));
            values.push((65535.0 * value).round() as u16);
        }
    }
    encode_grey16(3 * width, 2 * height, &values)
}

fn device() -> Folder {
    let folder = Folder::with_job(JOB);
    folder.write("device.yaml", yaml());
    folder.write("flat.png", tiles());
    folder
}

#[test]
fn a_published_calibration_becomes_a_sensor_file() {
    let folder = device();
    let run = folder.gelsim("calibrate --gelsight device.yaml --out made/mine.toml").assert().success();
    let said = String::from_utf8_lossy(&run.get_output().stdout).into_owned();
    let left = "flat field of lamp F                 0.00 grey levels RMS left by the polynomial, 0.0 at most";
    assert!(said.contains(left), "{said}");
    let sensor = Sensor::load(folder.path("made/mine.toml")).expect("a sensor");
    assert_eq!((sensor.name.as_str(), sensor.resolution_px, sensor.field_of_view_mm), ("mine", [16, 12], [6.4, 4.8]));
    assert_eq!(sensor.lamps.len(), 6);
    for (k, lamp) in sensor.lamps.iter().enumerate() {
        assert_eq!(lamp.name, ["A", "B", "C", "D", "E", "F"][k]);
        for (m, found) in lamp.quadratic.iter().enumerate() {
            // Ours are of 1, y, y^2, x, x y and x^2.
            let expected = [5, 4, 2, 3, 1, 0].map(|row| factor(row, 10 * k + m));
            assert!(found.iter().zip(expected).all(|(a, b)| (a - b).abs() < 1e-12), "{k} {m}: {found:?} {expected:?}");
        }
        // Of 1, y, y^2, y^3, y^4, x, x y, ..
        let mut expected = [0.0; 15];
        (expected[0], expected[3], expected[6], expected[9]) = (1.0, -0.1, 0.02 * k as f64, -0.3);
        let off = lamp.flat_field.iter().zip(expected).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max);
        assert!(off < 1e-3, "{k}: {:?}", lamp.flat_field);
    }
    // -120 and -60 degrees are the pair above; clockwise after it 0 and 60, then 120 and 180.
    let [red, green, blue] = [[0.5, 0.0, 0.0], [0.0, 0.5, 0.0], [0.0, 0.0, 0.5]];
    let colors: Vec<[f64; 3]> = sensor.lamps.iter().map(|lamp| lamp.color).collect();
    assert_eq!(colors, [red, green, blue, red, green, blue]);
}

#[test]
fn a_dataset_of_it_has_the_grey_images_in_every_format() {
    let folder = device();
    folder.succeed("calibrate --gelsight device.yaml --out mine.toml --thickness-mm 2.5");
    let layers = ("[\"depth\", \"contact\"]", "[\"lamps\", \"depth\"]");
    folder.write("job.toml", edited(JOB, &[layers, ("[sensor]", "[sensor]\nfile = \"mine.toml\"")]));
    for (format, ending) in [("exr", "exr"), ("npy", "npy"), ("png16", "exr")] {
        folder.succeed(&format!(
            "generate job.toml --quiet --samples 2 --set output.depth_format=\"{format}\" --out {format}"
        ));
        folder.succeed(&format!("verify {format}"));
        let samples = folder.samples(format);
        assert!(samples.values().all(|sample| sample.contains_key(&format!("lamps.{ending}"))), "{format}");
    }
    let label = &folder.labels("exr")["000000000"];
    assert_eq!(label["optics_model"], "lamps");
    assert_eq!(label["sensor"]["gelpad_thickness_mm"], 2.5);
    let planes = crate::support::exr_planes(&folder.samples("exr")["000000000"]["lamps.exr"]);
    assert_eq!(planes.iter().map(|(name, _)| name.as_str()).collect::<Vec<_>>(), ["A", "B", "C", "D", "E", "F"]);
    folder.succeed("generate exr/job.toml --quiet --out again");
    assert_same_files(&folder.lasting_files("exr"), &folder.lasting_files("again"));
}

#[test]
fn without_its_image_the_flat_field_is_even() {
    let folder = device();
    std::fs::remove_file(folder.path("flat.png")).expect("it is there");
    let said = folder.succeed("calibrate --gelsight device.yaml --out mine.toml");
    assert!(said.contains("warning: flat.png is missing: the flat field is taken as even"), "{said}");
    let sensor = Sensor::load(folder.path("mine.toml")).expect("a sensor");
    assert!(sensor.lamps.iter().all(|lamp| lamp.flat_field[0] == 1.0 && lamp.flat_field[1..] == [0.0; 14]));
}

/// Fails with status 2, and writes nothing.
fn refused(folder: &Folder, arguments: &str) -> String {
    let before = folder.files("");
    let said = folder.fail(arguments, 2);
    assert_same_files(&before, &folder.files(""));
    said
}

#[test]
fn every_mistake_in_a_calibration_is_named_with_its_line() {
    let folder = device();
    let broken = yaml()
        .replace("nL: 6\nwidth", "nL: 5\nwidth")
        .replace("width: 64", "width: -64")
        .replace("mmperpixel: 0.1\n", "")
        .replace("cols: 60", "cols: 66")
        .replace("rows: 3", "rows: 4")
        .replace("(16, 12)", "(16, 12, 12)")
        .replace("[0.3, ", "[none, ");
    folder.write("broken.yaml", broken);
    let said = refused(&folder, "calibrate --gelsight broken.yaml --out mine.toml");
    for mistake in [
        "`nL` is 5\n --> broken.yaml:3:1",
        "`width` is -64\n --> broken.yaml:4:1",
        "missing key `mmperpixel`",
        "`linfit` has 4 rows\n --> broken.yaml:9:5",
        "`quadfit` has 66 columns",
        "`modelsize` holds 3 numbers",
        "`scale` holds none",
    ] {
        assert!(said.contains(mistake), "{mistake} in\n{said}");
    }
    for wrong in ["not a PNG", ""] {
        folder.write("flat.png", wrong);
        let said = refused(&folder, "calibrate --gelsight device.yaml --out mine.toml");
        assert!(said.contains("flat.png: ") && said.contains("device.yaml:"), "{said}");
    }
    folder.write("flat.png", encode_grey16(48, 20, &[30_000; 48 * 20]));
    let said = refused(&folder, "calibrate --gelsight device.yaml --out mine.toml");
    assert!(said.contains("48 x 20 px, not 48 x 24 px: 3 x 2 tiles of `modelsize`"), "{said}");
    for text in ["", ":", "a:\n- b", "quadfit:\n    rows: [", "\u{feff}nL: 6"] {
        folder.write("broken.yaml", text);
        assert!(refused(&folder, "calibrate --gelsight broken.yaml --out mine.toml").contains("keys are missing: "));
    }
    assert!(refused(&folder, "calibrate --gelsight none.yaml --out mine.toml").contains("No such file"));
}

#[test]
fn lamps_are_refused_where_there_are_none_or_too_few() {
    let folder = Folder::with_job(JOB);
    let said = refused(&folder, "generate job.toml --set output.layers=[\"lamps\"]");
    assert!(said.contains("no lamps that were measured one by one"), "{said}");
    let said = refused(&folder, "generate job.toml --set optics=\"lamps\"");
    assert!(said.contains("this sensor has no lamps") && said.contains("gelsight-series2"), "{said}");
    let said = refused(&folder, "generate job.toml --set sensor.preset=\"gelsight-series2\" --set optics=\"phong\"");
    assert!(said.contains("this sensor has lamps and no LED"), "{said}");
    let said = refused(&folder, "generate job.toml --set sensor.preset=[\"digit\",\"gelsight-series2\"]");
    assert!(said.contains("of `digit` and `gelsight-series2` one has lamps, the other LEDs"), "{said}");
    let made = device();
    made.succeed("calibrate --gelsight device.yaml --out mine.toml");
    let text = made.read("mine.toml");
    let (five, _) = text.rsplit_once("[[lamp]]").expect("six lamps");
    let five = five.replacen("0.5, 0.0, 0.0", "1.5, nan, 0.0", 1);
    made.write("mine.toml", five);
    let edits = [("[sensor]", "[sensor]\nfile = \"mine.toml\"")];
    made.write("job.toml", edited(JOB, &edits));
    let said = refused(&made, "generate job.toml");
    for mistake in ["the sensor has 5 lamps", "color = 1.5 is out of range", "color = NaN is out of range"] {
        assert!(said.contains(mistake), "{mistake} in\n{said}");
    }
}
