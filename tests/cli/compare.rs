//! `gelsim compare`: what pairs with what, what is refused, what is written.

use std::fs;

use image::{Rgb, RgbImage};

use crate::support::{Folder, JOB, json};

/// A dent of `radius` px, `blue` levels bluer.
fn picture(size: [u32; 2], radius: f64, blue: u8) -> RgbImage {
    RgbImage::from_fn(size[0], size[1], |x, y| {
        let (dx, dy) = (f64::from(x) - 30.0, f64::from(y) - 20.0);
        let dent = if dx.hypot(dy) <= radius { 2.0 * dx } else { 0.0 };
        Rgb([(100.0 + dent) as u8, 80 + (y / 2) as u8, 90 + blue])
    })
}

fn save(folder: &Folder, name: &str, picture: &RgbImage) {
    let path = folder.path(name);
    fs::create_dir_all(path.parent().expect("a folder")).expect("a folder");
    picture.save(path).expect("an image");
}

/// Two real images with a table, one without contact, and their flat counterparts, 3 and 5 levels bluer.
fn pairs() -> Folder {
    let folder = Folder::new();
    for (name, radius, blue) in [("1", 12.0, 3), ("2", 9.0, 5)] {
        save(&folder, &format!("real/images/{name}.png"), &picture([64, 48], radius, 0));
        save(&folder, &format!("sim/{name}.png"), &picture([64, 48], radius, blue));
    }
    let table = "file,centre_x_px,centre_y_px,radius_px\nimages/1.png,30,20,12\nimages/2.png,,,\n";
    folder.write("real/annotations.csv", table);
    folder
}

fn run(folder: &Folder, arguments: &str) -> (String, String) {
    let assert = folder.gelsim(arguments).assert().success();
    let text = |bytes: &[u8]| String::from_utf8_lossy(bytes).into_owned();
    (text(&assert.get_output().stdout), text(&assert.get_output().stderr))
}

#[test]
fn pairs_are_scored_each_and_in_the_mean() {
    let folder = pairs();
    let (shown, said) = run(&folder, "compare real sim --out out");
    assert_eq!(said, "-> out\n");
    let csv = folder.read("out/compare.csv");
    let rows: Vec<Vec<&str>> = csv.lines().map(|line| line.split(',').collect()).collect();
    assert_eq!(rows[0], ["sensor", "file", "mae", "psnr_db", "ssim", "contact_mae", "contact_psnr_db", "contact_ssim"]);
    assert_eq!((rows.len(), rows[1][..2].to_vec()), (3, vec!["real", "images/1.png"]));
    let number = |row: usize, column: usize| rows[row][column].parse::<f64>().expect("a number");
    // A third of the values differs.
    assert!((number(1, 2) - 1.0).abs() < 1e-12 && (number(2, 2) - 5.0 / 3.0).abs() < 1e-12);
    assert!((number(1, 5) - 1.0).abs() < 1e-12 && number(1, 7) < 1.0, "{csv}");
    assert_eq!(rows[2][5..], ["", "", ""]);
    let result = json(&folder, "out/compare.json");
    assert_eq!(result["total"]["images"], 2);
    assert_eq!((&result["total"]["contacts"], &result["dilate"]), (&1.into(), &1.3.into()));
    let shift = result["sensors"][0]["distances"]["channels"][2]["mean_shift"].as_f64().expect("a number");
    assert!((shift - 4.0).abs() < 1e-12);
    assert_eq!(result["sensors"][0]["verdict"], "blue 4.0 levels too bright");
    for part in ["1.333", "real: simulated against real: blue 4.0 levels too bright", "total"] {
        assert!(shown.contains(part), "{part}\n{shown}");
    }
    assert!(!shown.contains("other presses"), "{shown}");
    assert!(!shown.contains("images/1.png"));
    assert!(run(&folder, "compare real sim --per-image").0.contains("images/1.png"));
    let sheet = image::open(folder.path("out/compare.png")).expect("a picture").into_rgb8();
    // Two rows: the better one first; blue differs by 3 levels, times 4 around grey, in its third panel.
    assert!(sheet.width() > 3 * 64 && sheet.height() > 2 * 48);
    assert!(sheet.pixels().any(|pixel| pixel.0 == [128, 128, 140]), "four times 3 levels");
    assert!(sheet.pixels().any(|pixel| pixel.0 == [128, 128, 148]), "four times 5 levels");
}

#[test]
fn a_larger_dilation_takes_in_more_of_the_image() {
    let folder = pairs();
    // Different in a ring that starts a radius and a half from the centre.
    let real = picture([64, 48], 12.0, 0);
    let mut sim = real.clone();
    for (x, y, pixel) in sim.enumerate_pixels_mut() {
        if (f64::from(x) - 30.0).hypot(f64::from(y) - 20.0) > 18.0 {
            pixel.0[0] = 0;
        }
    }
    save(&folder, "sim/1.png", &sim);
    let contact = |dilate: &str| {
        run(&folder, &format!("compare real sim --out out --dilate {dilate}"));
        json(&folder, "out/compare.json")["images"][0]["contact"]["mae"].as_f64().expect("a number")
    };
    assert_eq!(contact("1.5"), 0.0);
    assert!(contact("1.6") > 0.0);
    for bad in ["0", "-1", "nan", "inf", "x"] {
        folder.fail(&format!("compare real sim --dilate={bad}"), 2);
    }
}

#[test]
fn images_pair_by_path_then_by_name_then_without_ending_and_those_left_over_are_named() {
    let folder = Folder::new();
    let plain = picture([64, 48], 0.0, 0);
    // a/images/7.png pairs by its path, so that a/7.png is left, and a/7.bmp; a/8.png and b/1.png pair by their names, a/6.bmp by
    // its name without ending.
    for name in ["a/images/7.png", "a/7.bmp", "a/8.png", "a/6.bmp", "a/images/9.png", "b/1.png", "c/1.png"] {
        save(&folder, &format!("real/{name}"), &plain);
    }
    for name in ["a/images/7.png", "a/7.png", "a/images/8.png", "a/6.png", "b/images/1.png", "d/5.png"] {
        save(&folder, &format!("sim/{name}"), &plain);
    }
    let (_, said) = run(&folder, "compare real sim --out out");
    let csv = folder.read("out/compare.csv");
    let names: Vec<String> =
        csv.lines().skip(1).map(|line| line.split(',').take(2).collect::<Vec<_>>().join(" ")).collect();
    assert_eq!(names, ["a 6.bmp", "a 8.png", "a images/7.png", "b 1.png"]);
    for line in [
        "warning: a: 2 real images have no counterpart: 7.bmp, images/9.png\n",
        "warning: a: 1 simulated image has no counterpart: 7.png\n",
        "warning: c: 1 real image has no counterpart: 1.png\n",
        "warning: d: 1 simulated image has no counterpart: 5.png\n",
    ] {
        assert!(said.contains(line), "{line}{said}");
    }
    // PSNR of equal images is not known, and no number that JSON lacks is written.
    assert!(csv.contains("a,8.png,0.0,,1.0,,,"), "{csv}");
}

#[test]
fn sets_without_pairs_are_compared_as_sets() {
    let folder = pairs();
    folder.write("job.toml", JOB);
    folder.succeed("generate job.toml --out set --quiet");
    run(&folder, "compare real sim --out out");
    let (shown, said) = run(&folder, "compare real set --out out");
    assert!(shown.starts_with("no two images belong together") && said == "-> out\n", "{shown}{said}");
    assert!(!folder.path("out/compare.png").exists(), "that of the comparison before");
    // The scenes differ, which is not the simulator's fault.
    assert!(!shown.contains(" too ") && !folder.read("out/compare.json").contains(" too "), "{shown}");
    for words in [
        "all: 2 real images against 8 simulated ones of other presses.",
        "no measure of the simulator",
        "gelsim calibrate --evaluate real/annotations.csv",
    ] {
        assert!(shown.contains(words), "{words} is not in\n{shown}");
    }
    let result = json(&folder, "out/compare.json");
    let distances = &result["sensors"][0]["distances"];
    assert_eq!((&distances["real_images"], &distances["sim_images"]), (&2.into(), &8.into()));
    assert_eq!((&result["total"], result["sensors"][0]["sensor"].as_str()), (&serde_json::Value::Null, Some("all")));
    assert_eq!(folder.read("out/compare.csv").lines().count(), 1);
    // A dataset and its own images, unpacked, look alike.
    for (key, members) in folder.samples("set") {
        let name = format!("unpacked/{key}.png");
        fs::create_dir_all(folder.path("unpacked")).expect("a folder");
        folder.write(&name, &members["tactile.png"]);
    }
    let (shown, _) = run(&folder, "compare set unpacked");
    assert!(shown.contains("all: simulated against real: no difference"), "{shown}");
}

#[test]
fn a_shard_that_lacks_samples_is_refused_and_not_taken_for_a_choice() {
    let folder = pairs();
    folder.write("job.toml", crate::support::JOB);
    folder.succeed("generate job.toml --quiet --out set");
    let shard = folder.read_bytes("set/data/train-000000.tar");
    folder.write("set/data/train-000000.tar", "");
    let said = folder.fail("compare real set", 2);
    assert!(said.contains("train-000000.tar: 0 samples are in it, and 3 belong there"), "{said}");
    assert!(said.contains("`gelsim verify set`"), "{said}");
    folder.write("set/data/train-000000.tar", shard);
    run(&folder, "compare real set");
}

#[test]
fn what_is_wrong_with_folders_and_images_is_said_at_once() {
    let folder = pairs();
    let said = folder.fail("compare none sim2", 2);
    assert!(said.contains("none does not exist") && said.contains("sim2 does not exist"), "{said}");
    fs::create_dir(folder.path("empty")).expect("a folder");
    assert!(folder.fail("compare empty sim", 2).contains("empty: no images in it"));
    assert!(folder.fail("compare real cube.obj", 2).contains("cube.obj is no folder"));
    assert!(folder.fail("compare real sim --out cube.obj", 2).contains("cube.obj is not a folder"));
    for side in ["real", "./sim"] {
        let said = folder.fail(&format!("compare real sim --out {side}"), 2);
        assert!(said.contains("the results would lie among the images"), "{said}");
    }
    save(&folder, "sim/1.png", &picture([64, 47], 9.0, 0));
    folder.write("sim/2.png", "no image");
    let said = folder.fail("compare real sim --out out", 2);
    assert!(said.contains("real/images/1.png is 64x48 px, and sim/1.png is 64x47 px"), "{said}");
    assert!(said.contains("real/annotations.csv:2:1") && said.contains("sim/2.png: "), "{said}");
    assert!(!folder.path("out").exists());
    // Listed, and not there.
    folder.write("real/annotations.csv", "file\nimages/1.png\nimages/2.png\nimages/3.png\n");
    save(&folder, "sim/1.png", &picture([64, 48], 9.0, 0));
    for name in ["2", "3"] {
        save(&folder, &format!("sim/{name}.png"), &picture([64, 48], 9.0, 0));
    }
    let said = folder.fail("compare real sim", 2);
    assert!(said.contains("real/annotations.csv:4:1") && said.contains("images/3.png"), "{said}");
    folder.write("real/annotations.csv", "file,radius_px\nimages/1.png,x\n");
    assert!(folder.fail("compare real sim", 2).contains("real/annotations.csv:2:14"));
    let deep = image::ImageBuffer::<Rgb<u16>, _>::from_pixel(64, 48, Rgb([9_u16; 3]));
    deep.save(folder.path("sim/1.png")).expect("an image");
    folder.write("real/annotations.csv", "file\nimages/1.png\n");
    assert!(folder.fail("compare real sim", 2).contains("more than 8 bits"));
}
