//! `gelsim calibrate` of the calibration folders of gs_sdk and py3DCal, and of pixels that are not square. The folders
//! are written here as those programs write them; each must give what the same presses give as a table.

use image::{Rgb, RgbImage};

use super::calibrate::{CIRCLES, HEAD, good, pressed, refused};
use super::calibrated::rest;
use crate::support::{Folder, archive, assert_same_files};

/// The npy file of float64 values, as NumPy writes it.
fn npy(shape: &str, values: &[f64]) -> Vec<u8> {
    let header = format!("{:<117}\n", format!("{{'descr': '<f8', 'fortran_order': False, 'shape': ({shape}), }}"));
    let mut bytes = [b"\x93NUMPY\x01\x00\x76\x00".as_slice(), header.as_bytes()].concat();
    values.iter().for_each(|value| bytes.extend(value.to_le_bytes()));
    bytes
}

fn label([x, y, radius]: [f64; 3]) -> Vec<u8> {
    archive(&[("center.npy", &npy("2,", &[x, y])), ("radius.npy", &npy("", &[radius]))])
}

fn save(folder: &Folder, name: &str, image: &RgbImage) {
    let path = folder.path(name);
    std::fs::create_dir_all(path.parent().expect("a folder")).expect("a folder");
    image.save(path).expect("an image");
}

/// The first rows of presses.csv alone.
fn cut(folder: &Folder, presses: usize) {
    let table = folder.read("presses.csv");
    folder.write("presses.csv", table.lines().take(1 + presses).map(|line| format!("{line}\n")).collect::<String>());
}

/// Presses of `good` as gs_sdk's folder `data`, and as presses.csv: balls of 8 mm diameter, pixels of 0.2 mm.
fn gs_sdk(presses: usize) -> Folder {
    let folder = good();
    cut(&folder, presses);
    let mut catalog = String::from("experiment_reldir,diameter(mm)\n");
    for (k, circle) in CIRCLES.into_iter().enumerate().take(presses) {
        save(&folder, &format!("data/8.000mm/{k}/gelsight.png"), &pressed(circle));
        folder.write(&format!("data/8.000mm/{k}/label.npz"), label(circle));
        catalog += &format!("8.000mm/{k},8.0\n");
    }
    // `numpy.savez(file, center=[60.5, 30.2], radius=7)` by NumPy 2: that of the second press.
    folder.write("data/8.000mm/1/label.npz", include_bytes!("gs_sdk_label.npz"));
    folder.write("data/catalog.csv", catalog);
    save(&folder, "data/background.png", &rest());
    folder
}

/// Presses of a probe of 1.6 mm radius, all as wide as it, as py3DCal's folder `data`, two frames of each, and as
/// presses.csv.
fn py3dcal(presses: usize) -> Folder {
    let folder = good();
    let mut table = String::from(HEAD);
    let mut annotations = String::from("img_name,x_mm,y_mm,penetration_depth_mm,x_px,y_px\n");
    for (k, [x, y, _]) in CIRCLES.into_iter().enumerate().take(presses) {
        for frame in [2 * k, 2 * k + 1] {
            let name = format!("{frame}_X{k}.0Y0.0Z3.0.png");
            save(&folder, &format!("data/probe_images/{name}"), &pressed([x, y, 8.0]));
            annotations += &format!("{name},{k}.0,0.0,3.0,{x},{y}\n");
        }
        table += &format!("data/probe_images/{}_X{k}.0Y0.0Z3.0.png,{x},{y},8,1.6,0.2\n", 2 * k);
    }
    std::fs::create_dir(folder.path("data/annotations")).expect("a folder");
    folder.write("data/annotations/annotations.csv", annotations);
    folder.write("data/annotations/metadata.json", "{\n    \"px_per_mm\": 5.0,\n    \"probe_radius_mm\": 1.6\n}");
    save(&folder, "data/blank_images/blank.png", &rest());
    folder.write("presses.csv", table);
    folder
}

const LEDS: &str = "--leds --thickness-mm 4 --keep-anyway";

/// Calibrates, and returns what was said.
fn calibrate(folder: &Folder, presses: &str, out: &str) -> String {
    let assert = folder.gelsim(&format!("calibrate {presses} --out {out}/mine.toml")).assert().success();
    String::from_utf8_lossy(&assert.get_output().stderr).into_owned()
}

#[test]
fn a_folder_of_gs_sdk_gives_the_sensor_of_the_same_presses_as_a_table() {
    let folder = gs_sdk(4);
    calibrate(&folder, &format!("presses.csv --background rest.png {LEDS}"), "table");
    calibrate(&folder, &format!("data --mm-per-px 0.2 {LEDS}"), "folder");
    assert_same_files(&folder.files("table"), &folder.files("folder"));
    // Its configuration beside the catalogue tells the pixel's size.
    folder.write("data/gsmini.yaml", "device_name: \"GelSight Mini\"\nppmm: 0.2 # mm per pixel\nimgh: 72\nimgw: 96\n");
    calibrate(&folder, &format!("data {LEDS}"), "configured");
    assert_same_files(&folder.files("table"), &folder.files("configured"));
    // Another background than the folder's.
    std::fs::remove_file(folder.path("data/background.png")).expect("a file");
    calibrate(&folder, &format!("data --background rest.png {LEDS}"), "named");
    assert_same_files(&folder.files("table"), &folder.files("named"));

    // Each image is called gelsight.png, each picture as its folder.
    let evaluate = "--sensor table/mine.toml --keep-anyway --out";
    let of_table = folder.gelsim(&format!("calibrate --evaluate presses.csv {evaluate} a")).assert().success();
    let of_folder = folder.gelsim(&format!("calibrate --evaluate data {evaluate} b")).assert().success();
    let mean = |output: &[u8]| {
        let text = String::from_utf8_lossy(output).into_owned();
        let mean = text.lines().find(|line| line.starts_with("mean of 4 ")).expect("a mean");
        // Names of files decide how wide the first column is.
        mean.split_whitespace().map(str::to_owned).collect::<Vec<_>>()
    };
    assert_eq!(mean(&of_table.get_output().stdout), mean(&of_folder.get_output().stdout));
    let (table, pictures) = (folder.files("a"), folder.files("b"));
    assert_eq!((pictures.len(), &pictures["8.000mm_3.png"]), (4, &table["3.png"]));
}

#[test]
fn a_folder_of_py3dcal_gives_the_sensor_of_the_same_presses_as_a_table() {
    let folder = py3dcal(4);
    calibrate(&folder, &format!("presses.csv --background rest.png {LEDS}"), "table");
    let said = calibrate(&folder, &format!("data {LEDS}"), "folder");
    assert!(said.contains("annotations.csv: 4 images of places that earlier rows have are left out"), "{said}");
    assert_same_files(&folder.files("table"), &folder.files("folder"));

    // A probe that is not in by its radius makes a smaller disc, which is not recorded.
    let annotations = folder.read("data/annotations/annotations.csv");
    folder.write("data/annotations/annotations.csv", annotations.replace(",3.0,60.5,30.2", ",-1.5,60.5,30.2"));
    let said = refused(&folder, "calibrate data --out s.toml");
    assert!(said.contains("probe_images/2_X1.0Y0.0Z3.0.png: no circle") && said.contains(":4:1"), "{said}");
    assert!(said.contains("leave out rows of less depth") && said.contains("add --detect"), "{said}");
    let said = calibrate(&folder, &format!("data --detect {LEDS}"), "detected");
    assert!(said.contains("2_X1.0Y0.0Z3.0.png: circle found at "), "{said}");

    // Before it is annotated, probe and pixel come from the command line, and the discs are looked for.
    let first_four = |row: &str| row.split(',').take(4).collect::<Vec<_>>().join(",") + "\n";
    folder.write("data/annotations/probe_data.csv", annotations.lines().map(first_four).collect::<String>());
    for name in ["annotations.csv", "metadata.json"] {
        std::fs::remove_file(folder.path(&format!("data/annotations/{name}"))).expect("a file");
    }
    let said = refused(&folder, "calibrate data --detect --out s.toml");
    for flag in ["`probe_radius_mm` is missing", "give --ball-radius-mm", "`px_per_mm` is missing", "give --mm-per-px"]
    {
        assert!(said.contains(flag), "{flag}: {said}");
    }
    let given = "data --mm-per-px 0.2 --ball-radius-mm 1.6";
    let said = refused(&folder, &format!("calibrate {given} --out s.toml"));
    assert!(said.contains("4 images have no circle in the table") && said.contains("annotate the folder"), "{said}");
    calibrate(&folder, &format!("{given} --detect {LEDS}"), "probed");
}

#[test]
fn what_a_folder_lacks_is_said_at_once() {
    let folder = gs_sdk(7);
    let catalog = folder.read("data/catalog.csv").replace("8.000mm/2,8.0", "8.000mm/2,0").replace("8.000mm/3,", ",");
    folder.write("data/catalog.csv", catalog.replace("8.000mm/5,", "8.000mm/4,"));
    folder.write("data/8.000mm/0/label.npz", label([30.0, f64::NAN, 8.0]));
    folder.write("data/8.000mm/6/label.npz", "no archive");
    std::fs::remove_file(folder.path("data/background.png")).expect("a file");
    let said = refused(&folder, "calibrate data --ball-radius-mm 4 --out s.toml");
    for words in [
        "data: nothing says how wide a pixel is",
        "give --mm-per-px with `ppmm`",
        "--ball-radius-mm is given",
        "data/background.png is missing",
        "data/8.000mm/0/label.npz",
        "data/catalog.csv:2:1",
        "`diameter(mm)`: `0` is not a number above 0",
        "data/catalog.csv:4:11",
        "`experiment_reldir` is empty",
        "data/catalog.csv:5:1",
        "`8.000mm/4/gelsight.png` is on line 6, too",
        "data/catalog.csv:7:1",
    ] {
        assert!(said.contains(words), "{words} is not in\n{said}");
    }

    // What is not labelled yet is looked for.
    let folder = gs_sdk(7);
    std::fs::remove_file(folder.path("data/8.000mm/4/label.npz")).expect("a file");
    let said = refused(&folder, "calibrate data --mm-per-px 0.2 --out s.toml");
    assert!(said.contains("8.000mm/4/gelsight.png: no circle") && said.contains("label.npz is missing"), "{said}");
    std::fs::remove_file(folder.path("data/8.000mm/3/gelsight.png")).expect("a file");
    let said = refused(&folder, "calibrate data --mm-per-px 0.2 --detect --out s.toml");
    assert!(said.contains("cannot read data/8.000mm/3/gelsight.png: it does not exist"), "{said}");

    let folder = py3dcal(7);
    folder.write("data/annotations/metadata.json", "{\"px_per_mm\": -5.0}");
    folder.write("data/annotations/annotations.csv", "img_name,x_mm,y_mm,x_px\n0.png,0,0,1\n");
    std::fs::remove_file(folder.path("data/blank_images/blank.png")).expect("a file");
    let said = refused(&folder, "calibrate data --out s.toml");
    for words in [
        "data/annotations/metadata.json: `probe_radius_mm` is missing",
        "`px_per_mm` is no number above 0",
        "blank_images/blank.png is missing",
        "no column is called `penetration_depth_mm`",
        "no column is called `y_px`",
    ] {
        assert!(said.contains(words), "{words} is not in\n{said}");
    }
    folder.write("data/annotations/metadata.json", "{");
    std::fs::remove_file(folder.path("data/annotations/annotations.csv")).expect("a file");
    let said = refused(&folder, "calibrate data --out s.toml");
    for words in
        ["cannot read data/annotations/annotations.csv", "cannot read data/annotations/metadata.json", "blank.png is"]
    {
        assert!(said.contains(words), "{words} is not in\n{said}");
    }
    folder.write("data/catalog.csv", "");
    let said = refused(&folder, "calibrate data --out s.toml");
    assert!(said.contains("data has files of gs_sdk (catalog.csv) and of py3DCal (annotations)"), "{said}");

    let folder = good();
    std::fs::create_dir(folder.path("data")).expect("a folder");
    for (arguments, words) in [
        ("calibrate data --out s.toml", "data is no folder of gs_sdk (catalog.csv) or py3DCal (annotations)"),
        ("calibrate presses.csv --background rest.png --mm-per-px 0.2 --out s.toml", "--mm-per-px is for folders"),
        ("calibrate data --mm-per-px 0 --out s.toml", "write a number from 0.000001 to 1000"),
        ("calibrate presses.csv --out s.toml", "presses.csv: no background image"),
    ] {
        let said = refused(&folder, arguments);
        assert!(said.contains(words), "{arguments}:\n{said}");
    }
}

/// Sees a picture of 96x72 px in 96x60 px, 1.2 times as high as wide, as a camera would.
fn squeezed(picture: &dyn Fn(f64) -> RgbImage) -> RgbImage {
    let mut seen = RgbImage::new(96, 60);
    for row in 0..60 {
        let line = picture(1.2 * (f64::from(row) + 0.5) - 0.5);
        (0..96).for_each(|x| *seen.get_pixel_mut(x, row) = *line.get_pixel(x, 0));
    }
    seen
}

/// One row of the press, whose row number need not be whole.
fn line_of([x, y, radius]: [f64; 3], row: f64) -> RgbImage {
    RgbImage::from_fn(96, 1, |column, _| {
        let (across, down) = ((f64::from(column) - x) / radius, (row - y) / radius);
        let fade = (-3.0 * (across.hypot(down) - 1.0).max(0.0)).exp();
        let [red, green, blue] = [60.0 * across, 60.0 * down, -40.0 * (across + down)].map(|change| change * fade);
        let [r, g, b] = [100.0 + f64::from(column / 4), 110.0 + row / 4.0, 120.0];
        Rgb([r + red, g + green, b + blue].map(|level| level.round().clamp(0.0, 255.0) as u8))
    })
}

#[test]
fn pixels_that_are_not_square_are_resampled() {
    let folder = good();
    cut(&folder, 4);
    let mut table = String::from("file,centre_x_px,centre_y_px,radius_px,ball_radius_mm,mm_per_px_x,mm_per_px_y\n");
    for (k, [x, y, radius]) in CIRCLES.into_iter().enumerate().take(4) {
        save(&folder, &format!("squeezed/{k}.png"), &squeezed(&|row| line_of([x, y, radius], row)));
        table += &format!("squeezed/{k}.png,{x},{},{radius},4,0.2,0.24\n", (y + 0.5) / 1.2 - 0.5);
    }
    save(&folder, "squeezed/rest.png", &squeezed(&|row| line_of([1e6, 0.0, 1.0], row)));
    folder.write("squeezed.csv", &table);
    let said = calibrate(&folder, &format!("squeezed.csv --background squeezed/rest.png {LEDS}"), "squeezed-leds");
    assert!(said.contains("images are resampled from 96x60 px to 96x72 px of 0.2 mm"), "{said}");
    calibrate(&folder, &format!("presses.csv --background rest.png {LEDS}"), "square-leds");
    let sensor = |name: &str| folder.read(&format!("{name}/mine.toml")).parse::<toml::Table>().expect("TOML");
    let (made, expected) = (sensor("squeezed-leds"), sensor("square-leds"));
    for key in ["resolution_px", "field_of_view_mm", "gelpad_thickness_mm"] {
        assert_eq!(made[key], expected[key], "{key}");
    }
    let intensities = |sensor: &toml::Table| -> Vec<f64> {
        let leds = sensor["led"].as_array().expect("LEDs");
        leds.iter().map(|led| led["intensity"].as_float().expect("a number")).collect()
    };
    for (made, expected) in intensities(&made).into_iter().zip(intensities(&expected)) {
        assert!((made / expected - 1.0).abs() < 0.05, "{made} in place of {expected}");
    }
    let picture = |name: &str| image::open(folder.path(name)).expect("a picture").into_rgb8();
    let background = picture("squeezed-leds/mine.background.png");
    let off = background.iter().zip(rest().iter()).map(|(a, b)| a.abs_diff(*b)).max();
    assert!(background.dimensions() == (96, 72) && off.is_some_and(|off| off <= 1), "{off:?}");

    // Seen in such pixels, presses are as far from a sensor as they are in square ones.
    let mean = |table: &str| -> f64 {
        let arguments = format!("calibrate --evaluate {table} --sensor square-leds/mine.toml --out out --keep-anyway");
        let shown = folder.stdout_of(&arguments);
        let line = shown.lines().find(|line| line.starts_with("mean of 4 ")).expect("a mean");
        line.split_whitespace().nth(3).and_then(|word| word.parse().ok()).expect("a number")
    };
    let (square, not_square) = (mean("presses.csv"), mean("squeezed.csv"));
    assert!((square - not_square).abs() < 0.3, "{square} and {not_square}");

    for (from, to, words) in [
        (",0.24\n", ",\n", "4 rows have half the size of a pixel"),
        (",0.24\n", ",2.4\n", "pixels of 0.2 x 2.4 mm are more than 4 times as long as wide"),
        (",mm_per_px_y\n", ",mm_per_px\n", "the size of a pixel is neither one column nor two"),
    ] {
        folder.write("squeezed.csv", table.replace(from, to));
        let said = refused(&folder, "calibrate squeezed.csv --background squeezed/rest.png --out s.toml");
        assert!(said.contains(words), "{words} is not in\n{said}");
    }
}
