//! A file that changed between start and resume, or a dataset of another version: refused by name, nothing touched.

use std::fs;

use super::rig::{assert_like_undisturbed, assert_swept, with_undisturbed};
use crate::support::{Folder, JOB, assert_same_files, edited, made_by};

/// A job that reads a file of every kind.
fn with_files() -> Folder {
    let folder = Folder::new();
    let png = |name: &str, shade: u8| {
        let image = image::GrayImage::from_fn(24, 18, |x, y| image::Luma([shade + 5 * x as u8 + y as u8]));
        image.save(folder.path(name)).expect("a picture");
    };
    png("skin.png", 10);
    png("dome.png", 20);
    let pad = image::RgbImage::from_fn(48, 36, |x, _| image::Rgb([90 + x as u8, 100, 110]));
    pad.save(folder.path("pad.png")).expect("a picture");
    folder.write("mine.toml", "preset = \"digit\"\ngelpad_thickness_mm = 2.5\n");
    let sensor = "[sensor]\nfile = \"mine.toml\"\nbackground = \"pad.png\"\n\
        rest_shape = { height_map = { path = \"dome.png\", height_mm = 0.2 } }";
    let texture = "[texture]\npatterns = [{ image = { path = \"skin.png\" } }]\namplitude_mm = 0.03\n\n[pose]";
    folder.write("job.toml", edited(JOB, &[("[sensor]", sensor), ("[pose]", texture)]));
    folder.succeed("generate job.toml --quiet --out complete");
    folder
}

/// The file `name` is changed after a first part of the dataset was made. What is said contains `words`.
fn refused_after_change(folder: &Folder, name: &str, change: impl Fn(&mut Vec<u8>), words: &[&str]) {
    folder.succeed("generate job.toml --quiet --out out --shards 0..1");
    let before = folder.files("out");
    let original = fs::read(folder.path(name)).expect("a file");
    let mut other = original.clone();
    change(&mut other);
    folder.write(name, &other);
    let text = folder.fail("generate job.toml --out out", 2);
    assert!(text.contains("out holds a dataset of another job"), "{text}");
    for word in words.iter().chain(&[name, "--overwrite"]) {
        assert!(text.contains(word), "{word:?} in\n{text}");
    }
    assert_same_files(&before, &folder.files("out"));
    folder.write(name, original);
    folder.succeed("generate job.toml --quiet --out out");
    assert_like_undisturbed(folder, "out");
    fs::remove_dir_all(folder.path("out")).expect("a folder");
}

/// Another picture of the same size.
fn invert_picture(bytes: &mut Vec<u8>) {
    let mut picture = image::load_from_memory(bytes).expect("a picture");
    picture.invert();
    let mut png = std::io::Cursor::new(Vec::new());
    picture.write_to(&mut png, image::ImageFormat::Png).expect("a picture");
    *bytes = png.into_inner();
}

#[test]
fn a_mesh_that_changed_is_refused_by_name() {
    let comment = |bytes: &mut Vec<u8>| bytes.extend_from_slice(b"# touched\n");
    let folder = with_undisturbed(JOB);
    refused_after_change(&folder, "cube.obj", comment, &["cube.obj has changed: object.0.sha256 is \""]);
    refused_after_change(&folder, "cone.obj", comment, &["cone.obj has changed: object.1.sha256 is \""]);
}

#[test]
fn a_background_that_changed_is_refused_by_name() {
    let words = ["pad.png has changed: sensor.background_sha256 is \""];
    refused_after_change(&with_files(), "pad.png", invert_picture, &words);
}

#[test]
fn a_texture_image_that_changed_is_refused_by_name() {
    let words = ["skin.png has changed: texture.patterns.0.image.sha256 is \""];
    refused_after_change(&with_files(), "skin.png", invert_picture, &words);
}

#[test]
fn a_height_map_that_changed_is_refused_by_name() {
    let words = ["dome.png has changed: sensor.rest_shape.height_map.sha256 is \""];
    refused_after_change(&with_files(), "dome.png", invert_picture, &words);
}

#[test]
fn a_sensor_file_that_changed_is_refused_by_name_and_key() {
    let thicker = |bytes: &mut Vec<u8>| *bytes = b"preset = \"digit\"\ngelpad_thickness_mm = 2.75\n".to_vec();
    let words = ["sensor.gelpad_thickness_mm is 2.5 there and 2.75 here", "the sensor file is mine.toml"];
    refused_after_change(&with_files(), "mine.toml", thicker, &words);
}

#[test]
fn a_mesh_that_changed_is_refused_by_name_where_the_resolved_job_is_run() {
    let folder = with_undisturbed(JOB);
    folder.write("cube.obj", folder.read("cube.obj") + "# touched\n");
    let text = folder.fail("generate complete/job.toml --out complete", 2);
    assert!(text.contains("cube.obj has changed: its SHA-256 is "), "{text}");
}

#[test]
fn a_dataset_of_a_newer_version_is_refused_by_that_version() {
    let folder = with_undisturbed(JOB);
    made_by(&folder, "complete", "99.1.0");
    let job = folder.read("complete/job.toml");
    // A newer version may have keys that this one does not know, or not be TOML as we know it.
    for text in [job.clone(), format!("{job}\n[new.table]\nx = 1\n"), job.replace('=', ":=")] {
        folder.write("complete/job.toml", &text);
        let before = folder.files("complete");
        let text = folder.fail("generate job.toml --out complete", 2);
        assert!(text.contains("gelsim 99.1.0 made it, this is "), "{text}");
        assert_same_files(&before, &folder.files("complete"));
        assert_swept(&folder, "complete");
    }
}
