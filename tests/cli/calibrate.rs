//! `gelsim calibrate`: what it writes, what it refuses, what it says of presses that it never saw. The pictures are drawn,
//! not simulated: how well a sensor is recovered, the suite `calibration` tells.

use std::collections::BTreeMap;

use image::{Rgb, RgbImage};
use sha2::{Digest, Sha256};

use super::calibrated::{SIZE_PX, add_sensor, rest};
use crate::support::{Folder, assert_same_files, json};

/// Column, row and radius of circles.
pub const CIRCLES: [[f64; 3]; 7] = [
    [30.0, 25.0, 8.0],
    [60.5, 30.2, 7.0],
    [45.0, 50.0, 8.5],
    [70.0, 50.0, 7.5],
    [25.0, 45.0, 6.5],
    [50.0, 20.0, 9.0],
    [72.0, 22.0, 6.5],
];
pub const HEAD: &str = "file,centre_x_px,centre_y_px,radius_px,ball_radius_mm,mm_per_px\n";

/// A ball's dent: coloured by its slope, with a halo.
pub fn pressed([x, y, radius]: [f64; 3]) -> RgbImage {
    let mut picture = rest();
    for (column, row, pixel) in picture.enumerate_pixels_mut() {
        let (across, down) = ((f64::from(column) - x) / radius, (f64::from(row) - y) / radius);
        let fade = (-3.0 * (across.hypot(down) - 1.0).max(0.0)).exp();
        let [red, green, blue] = [60.0 * across, 60.0 * down, -40.0 * (across + down)].map(|change| change * fade);
        let [r, g, b] = pixel.0.map(f64::from);
        *pixel = Rgb([r + red, g + green, b + blue].map(|level| level.round().clamp(0.0, 255.0) as u8));
    }
    picture
}

fn row(name: &str, [x, y, radius]: [f64; 3]) -> String {
    format!("{name},{x},{y},{radius},4,0.2\n")
}

/// Good pictures 0.png to 6.png, rest.png, and a table of them.
pub fn good() -> Folder {
    let folder = Folder::new();
    let mut table = String::from(HEAD);
    for (k, circle) in CIRCLES.into_iter().enumerate() {
        pressed(circle).save(folder.path(&format!("{k}.png"))).expect("an image");
        table += &row(&format!("{k}.png"), circle);
    }
    rest().save(folder.path("rest.png")).expect("an image");
    folder.write("presses.csv", table);
    folder
}

/// Fails with status 2, and writes nothing.
pub fn refused(folder: &Folder, arguments: &str) -> String {
    let before = folder.files("");
    let said = folder.fail(arguments, 2);
    assert_same_files(&before, &folder.files(""));
    said
}

const CALIBRATE: &str = "calibrate presses.csv --background rest.png --out out/mine.toml";

/// Few steps in a pad of known geometry, where it is not the fit that counts.
const HURRIED: &str = "--steps 25 --thickness-mm 4 --contact-over-disc 0.95";

#[test]
fn every_mistake_in_table_and_pictures_is_said_at_once_with_its_line() {
    let folder = good();
    folder.write("3.png", "no picture");
    RgbImage::new(97, 72).save(folder.path("4.png")).expect("an image");
    let rows = [
        row("0.png", CIRCLES[0]),
        row("nowhere/1.png", CIRCLES[1]),
        String::from("2.png,,,,4,0.2\n"),
        row("3.png", CIRCLES[3]),
        row("4.png", CIRCLES[4]),
        String::from("5.png,50,20,9,,0.2\n"),
        String::from("6.png,72,22,6.5,4,0.21\n"),
        String::from("7.png,,,,,\n"),
    ];
    folder.write("presses.csv", format!("{HEAD}{}", rows.concat()));
    let said = refused(&folder, CALIBRATE);
    for (line, words) in [
        (3, "2 images do not exist: nowhere/1.png, 7.png"),
        (4, "2 images have no circle in the table: 2.png, 7.png"),
        (5, "cannot read 3.png"),
        (6, "4.png is 97x72 px, the background 96x72 px"),
        (7, "2 rows have no `ball_radius_mm`: 5.png, 7.png"),
        (8, "6.png: 0.21 mm per px, 0.2 in most rows"),
        (9, "7.png: no mm_per_px"),
    ] {
        let paragraph = said.split("\n\n").find(|paragraph| paragraph.contains(words));
        let paragraph = paragraph.unwrap_or_else(|| panic!("{words} is not in\n{said}"));
        let whole = paragraph.contains(&format!("presses.csv:{line}:1\n")) && paragraph.contains("help: ");
        assert!(whole, "{words}, line {line}:\n{paragraph}");
    }
    assert_eq!(said.matches("error: ").count(), 7, "{said}");
    // With another mistake in place of the size that cannot be compared.
    let unpaired = refused(&folder, &CALIBRATE.replace("rest.png", "none.png"));
    assert!(
        unpaired.contains("cannot read the background none.png") && unpaired.contains("presses.csv:9:1"),
        "{unpaired}"
    );
    assert_eq!(unpaired.matches("error: ").count(), 7, "{unpaired}");
    // What is looked for is not found on an untouched pad.
    rest().save(folder.path("2.png")).expect("an image");
    let said = refused(&folder, &format!("{CALIBRATE} --detect"));
    assert!(said.contains("2.png: no press is found in it") && said.contains("presses.csv:4:1"), "{said}");
}

#[test]
fn what_cannot_be_learnt_from_or_written_is_refused_before_the_work() {
    let folder = good();
    let table = folder.read("presses.csv");
    folder.write("few.csv", table.lines().take(5).map(|line| format!("{line}\n")).collect::<String>());
    folder.write("wrong.csv", table.replace("\n0.png,30,25", "\n0.png,80,60"));
    folder.write("metres.csv", table.replace(",0.2\n", ",1e-8\n"));
    std::fs::create_dir(folder.path("taken.toml")).expect("a folder");
    for (arguments, words) in [
        ("calibrate few.csv --background rest.png --out s.toml", "few.csv:5:1"),
        ("calibrate few.csv --background rest.png --out s.toml", "4 presses are too few to learn from"),
        ("calibrate none.csv --background rest.png --out s.toml", "cannot read the table of presses none.csv"),
        ("calibrate presses.csv --background none.png --out s.toml", "cannot read the background none.png"),
        ("calibrate presses.csv --background cube.obj --out s.toml", "cannot read the background cube.obj"),
        ("calibrate presses.csv --background rest.png --out mine", "mine is no name for a sensor file"),
        ("calibrate presses.csv --background rest.png --out mine.json", "it ends in .toml"),
        ("calibrate presses.csv --background rest.png --out taken.toml", "taken.toml is a folder"),
        ("calibrate presses.csv --background rest.png --out rest.png/mine.toml", "rest.png is no folder"),
        ("calibrate presses.csv --background rest.png --out s.toml --sensor gelsigt", "gelsigt"),
        ("calibrate presses.csv --background rest.png --out s.toml --thickness-mm 0", "from 0.01 to 1000"),
        (
            "calibrate presses.csv --background rest.png --out s.toml --contact-over-disc nan",
            "a number from 0.5 to 1.5",
        ),
        ("calibrate presses.csv --background rest.png --out s.toml --contact-over-disc 50", "a number from 0.5 to 1.5"),
        ("calibrate metres.csv --background rest.png --out s.toml", "the view would be 9.600e-7 x 7.200e-7 mm"),
        ("calibrate presses.csv --out s.toml", "--background"),
        ("calibrate --background rest.png --out s.toml", "PRESSES.csv"),
        ("calibrate presses.csv --background rest.png", "--out"),
        ("calibrate --evaluate presses.csv --out out", "--sensor"),
        ("calibrate presses.csv --evaluate presses.csv --sensor digit --out out", "cannot be used with"),
        ("calibrate --evaluate presses.csv --sensor digit --out rest.png", "rest.png is not a folder"),
        ("calibrate --evaluate presses.csv --sensor none.toml --out out", "none.toml"),
    ] {
        let said = refused(&folder, arguments);
        assert!(said.contains(words), "{arguments}:\n{said}");
    }
    // One circle of five is where nothing is.
    let five: String = folder.read("wrong.csv").lines().take(6).map(|line| format!("{line}\n")).collect();
    folder.write("wrong.csv", five);
    let said = refused(&folder, "calibrate wrong.csv --background rest.png --out s.toml --drop-bad");
    assert!(said.contains("of 5 presses 4 are usable, and 5 are needed") && said.contains("--drop-bad"), "{said}");
}

/// Runs the command on `threads` threads, and says what it wrote, on standard output and on standard error.
fn calibrated(folder: &Folder, threads: &str) -> (BTreeMap<String, Vec<u8>>, String, String) {
    let arguments = format!("{CALIBRATE} --detect --thickness-mm 4 --contact-over-disc 0.95 --steps 100");
    let assert = folder.gelsim(&arguments).env("RAYON_NUM_THREADS", threads).assert().success();
    let text = |bytes: &[u8]| String::from_utf8_lossy(bytes).into_owned();
    let output = assert.get_output();
    let written = folder.files("out");
    std::fs::remove_dir_all(folder.path("out")).expect("what was written");
    (written, text(&output.stdout), text(&output.stderr))
}

/// One test, because a fit takes seconds; two fits side by side.
#[test]
fn a_sensor_is_complete_the_same_each_time_and_makes_datasets() {
    let fit = |threads: &str| {
        let folder = good();
        // The first circle is left to be found, the last is wrong.
        let table = folder.read("presses.csv").replace("\n0.png,30,25,8,", "\n0.png,,,,");
        folder.write("presses.csv", table.replace("\n6.png,72,22,", "\n6.png,40,60,"));
        let made = calibrated(&folder, threads);
        (folder, made)
    };
    let ((folder, (files, shown, said)), (_, (again, shown_again, said_again))) = std::thread::scope(|scope| {
        let alone = scope.spawn(|| fit("1"));
        (fit("3"), alone.join().expect("a fit"))
    });
    assert_same_files(&files, &again);
    assert!((shown.as_str(), said.as_str()) == (shown_again.as_str(), said_again.as_str()), "{said}\n{said_again}");

    let names: Vec<&str> = files.keys().map(String::as_str).collect();
    assert_eq!(names, ["mine.background.png", "mine.calibration.json", "mine.html", "mine.toml"]);
    for line in ["presses", "gelpad thickness", "contact over visible disc", "cross-validated, contact"] {
        assert!(shown.lines().any(|shown| shown.starts_with(line)), "{line} is not in\n{shown}");
    }
    // Of a hurried fit a good press may look odd, too.
    let counted = (1..=2).any(|doubtful| shown.contains(&format!("7, {doubtful} of them doubtful, 0 left out\n")));
    assert!(counted && shown.contains("96x72 px, 0.2 mm per px"), "{shown}");
    assert!(said.contains("note: 0.png: circle found at ") && said.contains(" % sure\n"), "{said}");
    assert!(said.contains("warning: ") && said.contains("6.png"), "{said}");
    assert!(said.ends_with("-> out/mine.toml, out/mine.html\n"), "{said}");

    std::fs::create_dir(folder.path("out")).expect("a folder");
    files.iter().for_each(|(name, bytes)| folder.write(&format!("out/{name}"), bytes));
    let sensor: toml::Table = folder.read("out/mine.toml").parse().expect("TOML");
    assert_eq!((sensor["name"].as_str(), sensor["gelpad_thickness_mm"].as_float()), (Some("mine"), Some(4.0)));
    for (key, name) in [("background", "mine.background.png"), ("calibration", "mine.calibration.json")] {
        let hash: String = Sha256::digest(&files[name]).iter().map(|byte| format!("{byte:02x}")).collect();
        assert_eq!(sensor[key].as_str(), Some(name));
        assert_eq!(sensor[&format!("{key}_sha256")].as_str(), Some(hash.as_str()));
    }
    let table = json(&folder, "out/mine.calibration.json");
    assert_eq!((&table["calibration_version"], table["beyond"]["leds"].as_array().map(Vec::len)), (&2.into(), Some(3)));
    assert!(shown.contains("\ncalibrated range  ") && table["beyond"]["per_mm"].is_array(), "{shown}");
    let page = folder.read("out/mine.html");
    assert!(page.contains("6.png") && page.trim_end().ends_with("</html>"));

    folder.write(
        "job.toml",
        "dataset = { name = 'made', samples = 2 }\nsensor.file = 'out/mine.toml'\nindentation.depth_mm = 0.4\n\
         object = [{ path = 'cube.obj' }]\n",
    );
    folder.succeed("generate job.toml --quiet --out set");
    assert!(folder.labels("set").values().all(|label| label["optics_model"] == "calibrated"));
}

/// What speaks against the whole ends with status 1 and leaves nothing behind, unless it is asked for.
#[test]
fn a_hopeless_set_of_presses_is_no_sensor() {
    type Spoil = fn(&Folder);
    fn background(folder: &Folder, change: impl Fn(&mut [u8; 3])) {
        let mut picture = rest();
        picture.pixels_mut().for_each(|pixel| change(&mut pixel.0));
        picture.save(folder.path("rest.png")).expect("an image");
    }
    let cases: [(Spoil, &str, &str); 7] = [
        (
            |folder| background(folder, |pixel| pixel.reverse()),
            "red and blue of the background image are exchanged",
            "--match-background",
        ),
        (
            |folder| background(folder, |pixel| *pixel = pixel.map(|level| (0.7 * f64::from(level)).round() as u8)),
            "the background image is darker than the presses",
            "--match-background",
        ),
        (
            |folder| folder.write("presses.csv", folder.read("presses.csv").replace(",0.2\n", ",0.0002\n")),
            "`mm_per_px` looks like metres per pixel",
            "write `mm_per_px` in mm: 0.2 in place of 0.0002",
        ),
        (
            |folder| folder.write("presses.csv", folder.read("presses.csv").replace(",4,0.2\n", ",0.004,0.2\n")),
            "`ball_radius_mm` looks like metres",
            "4 in place of 0.004",
        ),
        (
            |folder| {
                let table = folder.read("presses.csv");
                folder.write("presses.csv", table.replace("centre_x_px,centre_y_px", "centre_y_px,centre_x_px"));
            },
            "exchange",
            "centre_x_px",
        ),
        (
            |folder| {
                let doubled = |circle: [f64; 3]| [circle[0], circle[1], 2.0 * circle[2]];
                let rows: String =
                    CIRCLES.iter().enumerate().map(|(k, circle)| row(&format!("{k}.png"), doubled(*circle))).collect();
                folder.write("presses.csv", format!("{HEAD}{rows}"));
            },
            "diameter",
            "radius",
        ),
        (
            |folder| (0..7).for_each(|k| rest().save(folder.path(&format!("{k}.png"))).expect("an image")),
            "show nothing that is not in the background",
            "name images of a ball",
        ),
    ];
    for (number, (spoil, what, advice)) in cases.into_iter().enumerate() {
        let folder = good();
        spoil(&folder);
        let before = folder.files("");
        let said = folder.fail(CALIBRATE, 1);
        assert!(said.contains("error: ") && said.contains(what) && said.contains(advice), "{number}: {said}");
        assert!(said.contains("nothing is written") && said.contains("--keep-anyway"), "{number}: {said}");
        assert_same_files(&before, &folder.files(""));
    }
}

/// Dots on a grid, printed on the pad: dark discs of 3 px radius every 12 px.
fn with_printed_dots(mut picture: RgbImage) -> RgbImage {
    for (x, y, pixel) in picture.enumerate_pixels_mut() {
        let off = |at: u32| (f64::from(at) % 12.0) - 6.0;
        if off(x).hypot(off(y)) < 2.2 {
            *pixel = Rgb([20, 22, 24]);
        }
    }
    picture
}

#[test]
fn printed_dots_are_masked_and_stand_in_the_sensor_file() {
    let folder = good();
    with_printed_dots(rest()).save(folder.path("rest.png")).expect("an image");
    for (k, circle) in CIRCLES.into_iter().enumerate() {
        with_printed_dots(pressed(circle)).save(folder.path(&format!("{k}.png"))).expect("an image");
    }
    let assert = folder.gelsim(&format!("{CALIBRATE} {HURRIED} --keep-anyway")).assert().success();
    let said = String::from_utf8_lossy(&assert.get_output().stderr).into_owned();
    assert!(said.contains("dots are printed on the pad"), "{said}");
    let sensor: toml::Table = folder.read("out/mine.toml").parse().expect("TOML");
    let pitch_mm = sensor["markers"]["pitch_mm"].as_float().expect("a number");
    assert!((pitch_mm - 12.0 * 0.2).abs() < 0.05, "{pitch_mm}");
    let written = image::open(folder.path("out/mine.background.png")).expect("a picture").into_rgb8();
    let off = written.iter().zip(rest().iter()).map(|(a, b)| a.abs_diff(*b)).max().expect("pixels");
    assert!(off < 12, "the background image is the pad without its print: {off}");
}

/// What `calibrate` says of a background is done by the flag that it names.
#[test]
fn a_background_in_another_order_and_darker_is_matched() {
    let folder = good();
    let mut picture = rest();
    picture.pixels_mut().for_each(|pixel| pixel.0 = [2, 1, 0].map(|k| (0.8 * f64::from(pixel.0[k])).round() as u8));
    picture.save(folder.path("rest.png")).expect("an image");
    folder.fail(CALIBRATE, 1);
    folder.gelsim(&format!("{CALIBRATE} --match-background {HURRIED} --keep-anyway")).assert().success();
    let written = image::open(folder.path("out/mine.background.png")).expect("a picture").into_rgb8();
    let off = written.iter().zip(rest().iter()).map(|(a, b)| a.abs_diff(*b)).max().expect("pixels");
    assert!(off <= 3, "{off} levels off the pad that the presses show");
}

#[test]
fn leds_alone_are_fitted_from_three_presses_and_render() {
    let folder = good();
    let rows = |count: usize| {
        let table = folder.read("presses.csv");
        table.lines().take(1 + count).map(|line| format!("{line}\n")).collect::<String>()
    };
    folder.write("two.csv", rows(2));
    folder.write("three.csv", rows(3));
    let said = refused(&folder, "calibrate --leds two.csv --background rest.png --out out/mine.toml");
    assert!(said.contains("2 presses are too few") && said.contains("give 3 at least"), "{said}");
    let arguments = "calibrate --leds three.csv --background rest.png --out out/mine.toml --thickness-mm 4 --surfaces labels \
                     --sensor gelsight-mini";
    // Drawn pictures change more than any LED could make of such slopes.
    let said = folder.fail(&format!("{arguments} --threads 2"), 1);
    assert!(said.contains("LEDs of an intensity of 30 and more") && said.contains("nothing is written"), "{said}");
    assert!(!folder.path("out").exists());
    let assert = folder.gelsim(&format!("{arguments} --threads 2 --keep-anyway")).assert().success();
    let shown = String::from_utf8_lossy(&assert.get_output().stdout).into_owned();
    for line in ["LED red", "LED green", "LED blue", "LEDs, left unexplained", "camera, read noise R G B"] {
        assert!(shown.lines().any(|shown| shown.starts_with(line)), "{line} is not in\n{shown}");
    }
    assert_eq!(folder.files("out").into_keys().collect::<Vec<_>>(), ["mine.background.png", "mine.toml"]);
    let sensor: toml::Table = folder.read("out/mine.toml").parse().expect("TOML");
    let leds = sensor["led"].as_array().expect("LEDs");
    let intensities = leds.iter().map(|led| led["intensity"].as_float().expect("a number"));
    assert!(leds.len() == 3 && intensities.sum::<f64>() > 0.0, "{sensor}");
    assert_eq!(sensor["stray_light"].as_array().map(Vec::len), Some(3));
    assert_eq!(sensor["gelpad_thickness_mm"].as_float(), Some(4.0));
    // These pictures are drawn without noise.
    assert_eq!(sensor["camera"]["read_noise_levels"].as_float(), Some(0.0));
    // The preset's belongs to the preset's LEDs.
    for key in ["calibration", "calibration_sha256", "light_residual"] {
        assert!(!sensor.contains_key(key), "{key} in {sensor}");
    }
    folder.write(
        "job.toml",
        "dataset = { name = 'made', samples = 2 }\nsensor.file = 'out/mine.toml'\nindentation.depth_mm = 0.4\n\
         object = [{ path = 'cube.obj' }]\n",
    );
    folder.succeed("generate job.toml --quiet --out set");
    assert!(folder.labels("set").values().all(|label| label["optics_model"] == "phong"));
}

#[test]
fn surfaces_are_complete_the_same_on_any_threads_and_nothing_else_is_lost() {
    let folder = good();
    let four: String = folder.read("presses.csv").lines().take(5).map(|line| format!("{line}\n")).collect();
    folder.write("presses.csv", four);
    let calibrate = "calibrate --leds presses.csv --background rest.png --out mine.toml --thickness-mm 4 --surfaces";
    folder.succeed(&format!("{calibrate} one --threads 1"));
    // In place of those before, of more presses.
    std::fs::create_dir(folder.path("three")).expect("a folder");
    for name in ["surfaces.json", "000000099.surface.npy"] {
        folder.write(&format!("three/{name}"), "from before");
    }
    folder.succeed(&format!("{calibrate} three --threads 3"));
    let files = folder.files("one");
    assert_same_files(&files, &folder.files("three"));
    let index = json(&folder, "one/surfaces.json");
    let presses = index["presses"].as_array().expect("presses");
    assert_eq!((presses.len(), files.len()), (4, 1 + 3 * 4));
    assert_eq!((index["mm_per_px"][0].as_f64(), index["gelpad_thickness_mm"].as_f64()), (Some(0.2), Some(4.0)));
    let layer = |number: usize| {
        let layer = &index["layers"][number];
        let shape: Vec<u64> = layer["shape"].as_array().expect("a shape").iter().filter_map(|n| n.as_u64()).collect();
        (layer["name"].as_str().expect("a name").to_owned(), layer["unit"].as_str().map(str::to_owned), shape)
    };
    assert_eq!(layer(0), (String::from("surface"), Some(String::from("mm")), vec![72, 96]));
    assert_eq!(layer(1), (String::from("normal"), None, vec![72, 96, 3]));
    assert_eq!(layer(2), (String::from("contact"), None, vec![72, 96]));
    for (k, (press, [x, y, radius])) in presses.iter().zip(CIRCLES).enumerate() {
        assert_eq!(press["image"], format!("{k}.png"));
        let named = |number: usize| &files[press["files"][number].as_str().expect("a name")];
        let (surface, normal) = (named(0), named(1));
        let (depth, width) = (press["depth_mm"].as_f64().expect("a depth"), 96.0);
        let value = |bytes: &[u8], at: usize| {
            let four = &bytes[128 + 4 * at..][..4];
            f64::from(f32::from_le_bytes(four.try_into().expect("four bytes")))
        };
        assert_eq!((surface.len(), normal.len()), (128 + 4 * 72 * 96, 128 + 12 * 72 * 96));
        let middle = (y.round() * width + x.round()) as usize;
        // Under the ball's lowest point the pad is as deep as the ball, and level.
        assert!(depth > 0.05 && (value(surface, middle) - depth).abs() < 0.02, "{k}: {depth}");
        assert!(value(normal, 3 * middle + 2) < -0.99, "{k}");
        let mask = image::load_from_memory(named(2)).expect("a picture").into_luma8();
        let touching = mask.pixels().filter(|pixel| pixel.0[0] == 255).count() as f64;
        let expected = std::f64::consts::PI * (0.95 * radius).powi(2);
        assert!((touching / expected - 1.0).abs() < 0.15, "{k}: {touching} of {expected}");
    }
    for (arguments, words) in [
        (format!("{calibrate} . --threads 2"), "is in the folder, and is no surface"),
        (format!("{calibrate} rest.png"), "rest.png is not a folder"),
        (format!("{calibrate} rest.png/labels"), "rest.png is no folder"),
        (calibrate.replace("mine.toml", "one/mine.toml") + " one", "would be among the surfaces"),
        (format!("{calibrate} one --threads 0"), "--threads 0 cannot work"),
        (format!("{calibrate} one --threads 5000"), "more than any machine has cores"),
    ] {
        let said = refused(&folder, &arguments);
        assert!(said.contains(words), "{arguments}:\n{said}");
    }
}

fn run_evaluate(folder: &Folder, more: &str) -> (String, String) {
    let arguments = format!("calibrate --evaluate presses.csv --sensor sensor.toml --out out{more}");
    let assert = folder.gelsim(&arguments).assert().success();
    let text = |bytes: &[u8]| String::from_utf8_lossy(bytes).into_owned();
    (text(&assert.get_output().stdout), text(&assert.get_output().stderr))
}

#[test]
fn presses_are_simulated_from_circle_and_ball_alone_and_held_against_their_images() {
    let folder = good();
    add_sensor(&folder);
    let (shown, said) = run_evaluate(&folder, "");
    assert!(
        said.contains("of what presses change around the contact unexplained") && said.ends_with("-> out\n"),
        "{said}"
    );
    let lines: Vec<&str> = shown.lines().collect();
    assert!(
        lines.len() == 11 && lines[10].starts_with("background alone ") && lines[1].trim_start().starts_with("MAE"),
        "{shown}"
    );
    let figures = |line: &str| -> Vec<f64> { line.split_whitespace().filter_map(|word| word.parse().ok()).collect() };
    for (k, line) in lines[2..9].iter().enumerate() {
        assert!(line.starts_with(&format!("{k}.png ")) && figures(line).len() == 6, "{line}");
    }
    assert!(lines[9].starts_with("mean of 7 "), "{shown}");
    // The mean of the contact's errors, to what is printed.
    let mean = lines[2..9].iter().map(|line| figures(line)[0]).sum::<f64>() / 7.0;
    assert!((figures(lines[9])[1] - mean).abs() < 0.02, "{shown}");
    let pictures = folder.files("out");
    assert_eq!(pictures.len(), 7);
    let picture = |bytes: &[u8]| image::load_from_memory(bytes).expect("a picture").into_rgb8();
    assert!(pictures.values().all(|bytes| picture(bytes).dimensions() == (SIZE_PX[0], SIZE_PX[1])));

    // Those of the user stay.
    let real = folder.read_bytes("0.png");
    for out in [".", "out/.."] {
        let said = folder.fail(&format!("calibrate --evaluate presses.csv --sensor sensor.toml --out {out}"), 2);
        assert!(said.contains("7 files would be written over: 0.png, 1.png, 2.png and 4 more"), "{said}");
        assert!(said.contains("choose another folder with --out") && folder.read_bytes("0.png") == real, "{said}");
    }

    // The images are not looked at: pictures of nothing change figures only.
    for k in 1..7 {
        rest().save(folder.path(&format!("{k}.png"))).expect("an image");
    }
    std::fs::remove_file(folder.path("0.png")).expect("a file");
    RgbImage::new(5, 5).save(folder.path("1.png")).expect("an image");
    let table = folder.read("presses.csv").replace("\n2.png,45,50,8.5,4,0.2\n", "\n2.png,45,50,8.5,4,0.3\n");
    folder.write("presses.csv", table);
    let said = folder.fail("calibrate --evaluate presses.csv --sensor sensor.toml --out out", 1);
    assert!(said.contains("5 images show nothing that is not in the background: 2.png"), "{said}");
    assert_same_files(&pictures, &folder.files("out"));
    let (shown, said) = run_evaluate(&folder, " --keep-anyway");
    assert_same_files(&pictures, &folder.files("out"));
    assert!(shown.contains("\nmean of 5 ") && shown.contains("\n0.png\n"), "{shown}");
    for line in [
        "warning: cannot read 0.png: it does not exist\n",
        "warning: 1.png is 5x5 px, the sensor 96x72 px\n",
        "warning: 2.png: 0.3 mm per px in the table, 0.200000 on the sensor, which counts\n",
    ] {
        assert!(said.contains(line), "{line}{said}");
    }
    // A circle no ball has, and one out of view.
    folder.write("presses.csv", format!("{HEAD}big.png,40,30,300,4,0.2\nfar.png,-900,-900,8,4,0.2\n"));
    let said = folder.fail("calibrate --evaluate presses.csv --sensor sensor.toml --out out", 2);
    assert!(said.contains("2 images do not exist: big.png, far.png"), "{said}");
    for name in ["big.png", "far.png"] {
        pressed(CIRCLES[0]).save(folder.path(name)).expect("an image");
    }
    let (shown, said) = run_evaluate(&folder, " --fidelity draft --keep-anyway");
    assert!(
        said.contains("big.png: its circle is too large for its ball") && shown.contains("mean of 2"),
        "{shown}{said}"
    );
    assert!(folder.path("out/big.png").is_file());
    let far = picture(&folder.files("out")["far.png"]);
    assert!(far == rest(), "nothing is in view");
}

#[test]
fn tables_that_cannot_be_simulated_are_refused_with_every_line() {
    let folder = good();
    add_sensor(&folder);
    let rows = "a/1.png,30,20,7,4,0.2\nb/1.png,30,20,7,4,0.2\n2.png,,,,4,0.2\n3.png,30,20,7,,0.2\n";
    folder.write("presses.csv", format!("{HEAD}{rows}"));
    let said = refused(&folder, "calibrate --evaluate presses.csv --sensor sensor.toml --out out");
    for (line, words) in
        [(3, "a second picture would be called 1.png"), (4, "2.png: no circle"), (5, "3.png: no ball_radius_mm")]
    {
        let paragraph = said.split("\n\n").find(|paragraph| paragraph.contains(words)).unwrap_or_default();
        assert!(paragraph.contains(&format!("presses.csv:{line}:1\n")), "{words}, line {line}:\n{said}");
    }
    assert_eq!(said.matches("error: ").count(), 3, "{said}");
    // Pictures end in .png, whatever the images do.
    folder.write("presses.csv", format!("{HEAD}a/1.png,30,20,7,4,0.2\n1.jpg,30,20,7,4,0.2\n"));
    let said = refused(&folder, "calibrate --evaluate presses.csv --sensor sensor.toml --out out");
    assert!(said.contains("a second picture would be called 1.png"), "{said}");
}
