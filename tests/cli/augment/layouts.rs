//! Layouts beside the table with its images: class folders, COCO, images elsewhere, tables of Windows, and images of every
//! format. Each output has its input's layout, its real images bit for bit, and is read again.

use std::collections::{BTreeMap, BTreeSet};
use std::fs;
use std::io::Cursor;

use image::{ImageFormat, RgbImage};
use serde_json::{Value, json};

use super::{in_tars, label, rows, sources};
use crate::support::{Folder, edited, members};

pub const RECIPE: &str = "seed = 7\n[input]\npath = \"real\"\n[[photometric]]\ncopies = 2\nexposure_ev = [-0.5, 0.5]\nsplits = [\"train\"]\n";

/// A picture of 16 x 12 px that no other number has.
pub fn picture(number: u8, format: ImageFormat) -> Vec<u8> {
    let rgb = RgbImage::from_fn(16, 12, |x, y| image::Rgb([90 + number, 60 + 4 * x as u8, 50 + 5 * y as u8]));
    let mut bytes = Cursor::new(Vec::new());
    rgb.write_to(&mut bytes, format).expect("encoded");
    bytes.into_inner()
}

/// Writes files below `real`, with the folders that they need.
pub fn write(folder: &Folder, files: &[(&str, Vec<u8>)]) {
    for (name, bytes) in files {
        let path = folder.path("real").join(name);
        fs::create_dir_all(path.parent().expect("a folder")).expect("a folder");
        fs::write(path, bytes).expect("a file");
    }
}

pub fn png(number: u8) -> Vec<u8> {
    picture(number, ImageFormat::Png)
}

/// Writes a tar below `real`. Names that end in `/` are folders.
pub fn pack(folder: &Folder, tar: &str, files: &[(&str, Vec<u8>)]) {
    fs::create_dir_all(folder.path("real")).expect("a folder");
    let mut builder = tar::Builder::new(fs::File::create(folder.path("real").join(tar)).expect("a file"));
    for (name, bytes) in files {
        let kind = if name.ends_with('/') { tar::EntryType::Directory } else { tar::EntryType::Regular };
        let mut header = tar::Header::new_gnu();
        // The crate would leave a `./` out.
        header.as_gnu_mut().expect("GNU's").name[..name.len()].copy_from_slice(name.as_bytes());
        header.set_entry_type(kind);
        header.set_size(bytes.len() as u64);
        header.set_cksum();
        builder.append(&header, bytes.as_slice()).expect("written");
    }
    builder.finish().expect("written");
}

/// The recipe without splits.
pub fn undivided() -> String {
    RECIPE.replace("splits = [\"train\"]\n", "")
}

/// Each real image is in the output as it was, each copy is a PNG that is called so, and all else describes the output.
fn assert_images(folder: &Folder, out: &str, copies: usize) -> BTreeSet<String> {
    let (before, after) = (folder.files("real"), folder.files(out));
    let is_image =
        |name: &str| ["png", "jpg", "JPG", "bmp", "tif", "webp"].iter().any(|end| name.ends_with(&format!(".{end}")));
    for (name, bytes) in before.iter().filter(|(name, _)| is_image(name)) {
        assert!(after[name] == *bytes, "{name}");
    }
    let made: BTreeSet<String> =
        after.keys().filter(|name| is_image(name) && !before.contains_key(*name)).cloned().collect();
    for name in &made {
        assert!(name.ends_with(".png") && after[name].starts_with(b"\x89PNG"), "{name}");
    }
    assert_eq!(made.len(), copies, "{made:?}");
    let mut check = std::process::Command::new("sha256sum");
    check.args(["--quiet", "-c", "files.sha256"]).current_dir(folder.path(out));
    assert!(check.status().expect("sha256sum").success());
    made
}

#[test]
fn a_folder_for_each_class_stays_one_and_a_table_says_where_images_come_from() {
    let folder = Folder::new();
    write(
        &folder,
        &[("ball/0.png", png(0)), ("ball/1.png", png(1)), ("cube/0.png", png(2)), ("background.png", png(9))],
    );
    folder.write(
        "augment.toml",
        undivided().replace("path = \"real\"", "path = \"real\"\nbackground = \"background.png\""),
    );
    let said = folder.succeed("augment augment.toml --out larger");
    // The background is no sample, and nobody is told so.
    assert!(said.starts_with("9 samples: 3 real, 6 photometric; "), "{said}");
    fs::remove_file(folder.path("real/background.png")).expect("a file");
    let made = assert_images(&folder, "larger", 6);
    assert!(made.contains("cube/0-photometric-0-1.png"), "{made:?}");
    let rows = rows(&folder.read("larger/augment.csv"));
    assert_eq!(rows.len(), 9);
    let files: BTreeSet<&str> = rows.iter().map(|row| row["file_name"].as_str()).collect();
    for row in &rows {
        assert!(row["file_name"].starts_with(&format!("{}/", row["class"])), "{row:?}");
        assert!(row["source"] == "real" || files.contains(row["source_key"].as_str()), "{row:?}");
        assert!(folder.path(&format!("larger/{}", row["file_name"])).is_file());
    }
    let card = folder.read("larger/README.md");
    assert!(card.starts_with("---\nconfigs:\n") && card.contains("\"*/**\""), "{card}");
    // An output is not taken for a real set again.
    let said = folder
        .fail("augment augment.toml --out again --set input.path=\"larger\" --set input.background=\"rendered\"", 2);
    assert!(said.contains("is an output of gelsim augment already"), "{said}");
}

#[test]
fn folders_of_splits_and_classes_are_both_and_new_splits_move_images_without_losing_one() {
    let folder = Folder::new();
    write(
        &folder,
        &[
            ("train/ball/0.png", png(0)),
            ("train/cube/0.png", png(1)),
            ("test/ball/0.png", png(2)),
            ("test/cube/0.jpg", picture(3, ImageFormat::Jpeg)),
        ],
    );
    folder.write("augment.toml", RECIPE);
    let said = folder.succeed("augment augment.toml --out larger");
    assert!(said.ends_with("\n  test: 2 real\n  train: 2 real, 4 photometric\n"), "{said}");
    let made = assert_images(&folder, "larger", 4);
    assert!(made.iter().all(|name| name.starts_with("train/")), "{made:?}");
    let card = folder.read("larger/README.md");
    assert!(card.contains("- split: test\n    path:\n    - \"test/**\""), "{card}");

    folder.write("augment.toml", format!("{RECIPE}[output]\nsplits = {{ train = 0.5, val = 0.5 }}\n"));
    folder.succeed("augment augment.toml --out anew --quiet");
    let rows = rows(&folder.read("anew/augment.csv"));
    let of = sources(rows.iter().map(|row| row["source"].as_str()));
    assert_eq!((of["real"], of["photometric"]), (4, 4));
    let mut contents = BTreeSet::new();
    for row in &rows {
        let file = &row["file_name"];
        assert!(file.starts_with(&format!("{}/{}/", row["split"], row["class"])), "{file}");
        let bytes = folder.read_bytes(&format!("anew/{file}"));
        if row["source"] == "real" {
            assert!(contents.insert(bytes));
        } else {
            // The real image's name in this output.
            assert!(rows.iter().any(|real| real["file_name"] == row["source_key"] && real["split"] == row["split"]));
        }
    }
    let expected: BTreeSet<Vec<u8>> = folder.files("real").into_values().collect();
    assert!(contents == expected);
}

#[test]
fn synthetic_samples_go_to_the_folder_of_their_class() {
    let folder = Folder::new();
    folder.write("new.toml", super::JOB);
    write(&folder, &[("train/cube/0.png", png(0)), ("train/cube/1.png", png(1)), ("test/cube/0.png", png(2))]);
    folder.write("augment.toml", "[input]\npath = \"real\"\n[mixing]\njob = \"new.toml\"\nsynthetic_per_real = 3.0\n");
    let said = folder.succeed("augment augment.toml --out larger");
    assert!(said.contains("note: the class \"pointed\" of the job is new in the set, and becomes a folder"), "{said}");
    let rows = rows(&folder.read("larger/augment.csv"));
    let synthetic: Vec<_> = rows.iter().filter(|row| row["source"] == "synthetic").collect();
    assert_eq!(synthetic.len(), 6);
    for row in &synthetic {
        let file = &row["file_name"];
        assert!(file.starts_with(&format!("train/{}/synthetic-", row["class"])), "{row:?}");
        assert!(folder.read_bytes(&format!("larger/{file}")).starts_with(b"\x89PNG"));
    }
    // The way out that is printed: the object is one of the set's.
    folder.write("new.toml", super::JOB.replace("class = \"pointed\"", "class = \"cube\""));
    let said = folder.succeed("augment augment.toml --out other");
    assert!(!said.contains("note: "), "{said}");
    // Real images are of one sensor.
    folder.write("new.toml", format!("{}\n[sensors]\ncount = 2\n", super::JOB));
    let said = folder.fail("augment augment.toml --out sensors", 2);
    assert!(said.contains("[mixing] adds samples of one sensor, and this job has several"), "{said}");
}

#[test]
fn folders_that_are_not_plainly_classes_are_asked_about_and_what_is_left_out_is_said() {
    let folder = Folder::new();
    write(&folder, &[("ball/day1/0.png", png(0)), ("ball/day2/0.png", png(1)), ("cube/day1/0.png", png(2))]);
    folder.write("augment.toml", undivided());
    let said = folder.fail("augment augment.toml --out larger", 2);
    assert!(
        said.contains("which of the folders of ball/day1/0.png is its class") && said.contains("labels = \"folders\""),
        "{said}"
    );
    folder.succeed("augment augment.toml --out larger --quiet --set input.labels=\"folders\"");
    assert_images(&folder, "larger", 6);
    assert!(rows(&folder.read("larger/augment.csv")).iter().all(|row| row["file_name"].starts_with(&row["class"])));

    fs::remove_dir_all(folder.path("real")).expect("a folder");
    write(&folder, &[("train/ball/0.png", png(0)), ("odd/1.png", png(1))]);
    let said = folder.fail("augment augment.toml --out none", 2);
    assert!(said.contains("folders lie differently: ") && said.contains("labels = \"folders\""), "{said}");

    fs::remove_dir_all(folder.path("real")).expect("a folder");
    let more: [(&str, Vec<u8>); 6] = [
        ("ball/0.png", png(0)),
        ("overview.png", png(1)),
        ("ball/0.json", b"{}".to_vec()),
        ("cube/0.gif", b"GIF89a".to_vec()),
        ("cube/1.png", png(2)),
        ("README.txt", b"a note".to_vec()),
    ];
    write(&folder, &more);
    std::os::unix::fs::symlink(folder.path("real/ball"), folder.path("real/linked")).expect("a link");
    let said = folder.succeed("augment augment.toml --out notes");
    for part in [
        "note: overview.png is in no folder of a class, and is left out",
        "note: ball/0.json belongs to an image by its name, and is not in the output",
        "warning: cube/0.gif is a picture that is not read, and is left out",
        "warning: linked is a link to a folder, and is left out",
    ] {
        assert!(said.contains(part), "{part}\n{said}");
    }
    assert!(!said.contains("README"), "{said}");
    assert_eq!(rows(&folder.read("notes/augment.csv")).len(), 6);
}

#[test]
fn images_in_one_folder_without_any_label_are_a_set_too() {
    let folder = Folder::new();
    write(&folder, &[("a.png", png(0)), ("b.JPG", picture(1, ImageFormat::Jpeg))]);
    folder.write("augment.toml", undivided());
    folder.succeed("augment augment.toml --out larger --quiet");
    let made = assert_images(&folder, "larger", 4);
    assert!(made.contains("b-photometric-0-1.png"), "{made:?}");
    let card = folder.read("larger/README.md");
    assert!(card.contains("\"*.JPG\"") && card.contains("\"*.png\""), "{card}");
}

#[test]
fn a_table_under_another_name_is_not_passed_over_for_folders() {
    let folder = Folder::new();
    write(
        &folder,
        &[
            (
                "annotations/probe_data.csv",
                b"img_name,x_mm,penetration_depth_mm\n00.png,0,0.5\n01.png,1,0.5\n".to_vec(),
            ),
            ("probe_images/00.png", png(0)),
            ("probe_images/01.png", png(1)),
            ("blank_images/blank.png", png(2)),
        ],
    );
    folder.write("augment.toml", undivided());
    // Each message is followed to the next.
    let steps = [
        ("which table holds the labels of ", "labels = \"annotations/probe_data.csv\""),
        ("no column names the image", "input.image = \"...\""),
        ("2 images are not there: 00.png, 01.png", "images = \"probe_images\""),
    ];
    let answers = ["labels = \"annotations/probe_data.csv\"", "image = \"img_name\"", "images = \"probe_images\""];
    let mut keys = String::from("path = \"real\"\n");
    for ((message, remedy), answer) in steps.iter().zip(answers) {
        let said = folder.fail("augment augment.toml --out larger", 2);
        assert!(said.contains(message) && said.contains(remedy), "{message}\n{said}");
        keys += &format!("{answer}\n");
        folder.write("augment.toml", undivided().replace("path = \"real\"\n", &keys));
    }
    folder.succeed("augment augment.toml --out larger --quiet");
    let files = folder.files("larger");
    assert!(files["probe_images/00.png"] == png(0) && files.contains_key("probe_images/00-photometric-0-0.png"));
    assert!(!files.contains_key("blank_images/blank.png"));
    let rows = rows(&folder.read("larger/annotations/probe_data.csv"));
    assert_eq!(
        rows.iter().map(|row| row["img_name"].as_str()).take(2).collect::<Vec<_>>(),
        ["00.png", "00-photometric-0-0.png"]
    );
    // The output is read with the same keys.
    let again = keys.replace("\"real\"", "\"larger\"");
    folder.write("again.toml", undivided().replace("path = \"real\"\n", &again) + "[output]\nprefix = \"second_\"\n");
    let said = folder.fail("augment again.toml --out second", 2);
    assert!(said.contains("would be the name of two samples"), "{said}");
    let more = "[output]\nprefix = \"second_\"\nsplits = { train = 0.5, test = 0.5 }\n";
    folder.write("again.toml", format!("[input]\n{again}{more}"));
    folder.succeed("augment again.toml --out second --quiet");
    assert_eq!(super::rows(&folder.read("second/annotations/probe_data.csv")).len(), 6);
}

#[test]
fn images_are_named_from_the_table_with_steps_back_and_from_the_inputs_folder() {
    for (table, image, keys) in [
        ("tables/labels.csv", "../img/0.png", "labels = \"tables/labels.csv\""),
        ("tables/labels.csv", "img/0.png", "labels = \"tables/labels.csv\"\nimages = \".\""),
        ("labels.csv", "0.png", "images = \"img\""),
        ("labels.csv", "./img/0.png", ""),
        ("train/metadata.csv", "0.png", "images = \"img\""),
    ] {
        let folder = Folder::new();
        let of_images = if table.starts_with("train") { "train/img/0.png" } else { "img/0.png" };
        write(&folder, &[(of_images, png(0)), (table, format!("file_name,d\n{image},1\n").into_bytes())]);
        folder.write("augment.toml", undivided().replace("path = \"real\"", &format!("path = \"real\"\n{keys}")));
        folder.succeed("augment augment.toml --out larger --quiet");
        assert_images(&folder, "larger", 2);
        let rows = rows(&folder.read(&format!("larger/{table}")));
        assert_eq!(rows[1]["file_name"], image.replace(".png", "-photometric-0-0.png"), "{table}");
    }
}

#[test]
fn a_table_that_was_written_on_windows_is_read_and_keeps_its_backslashes() {
    let folder = Folder::new();
    let table =
        "file_name,depth_file,object\r\nimg\\00.png,depth\\00.npy,cube\r\n.\\img\\01.png,depth\\01.npy,ball\r\n";
    let files = [
        ("img/00.png", png(0)),
        ("img/01.png", png(1)),
        ("depth/00.npy", b"d0".to_vec()),
        ("depth/01.npy", b"d1".to_vec()),
        ("labels.csv", table.as_bytes().to_vec()),
    ];
    write(&folder, &files);
    folder.write("augment.toml", undivided());
    folder.succeed("augment augment.toml --out larger --quiet");
    assert_images(&folder, "larger", 4);
    assert_eq!(folder.read("larger/depth/01.npy"), "d1");
    let rows = rows(&folder.read("larger/labels.csv"));
    let names: Vec<&str> = rows.iter().map(|row| row["file_name"].as_str()).collect();
    assert_eq!(names[..3], ["img\\00.png", "img\\00-photometric-0-0.png", "img\\00-photometric-0-1.png"]);
    assert_eq!(rows[1]["source_key"], "img\\00.png");
    assert_eq!(names[3], ".\\img\\01.png");
    // A name with a backslash in it is a name where a file is called so.
    write(&folder, &[("img\\00.png", png(5))]);
    folder.succeed("augment augment.toml --out literal --quiet");
    assert!(folder.read_bytes("literal/img\\00.png") == png(5));
}

/// COCO annotations of three images in two categories.
fn coco(prefix: &str) -> Value {
    json!({
        "info": { "year": 2024, "version": 1.50 },
        "images": [
            { "id": 1, "file_name": format!("{prefix}0.png"), "width": 16, "height": 12, "license": 3 },
            { "id": 5, "file_name": format!("{prefix}1.jpg"), "width": 16, "height": 12 },
            { "id": 7, "file_name": format!("{prefix}2.png") },
        ],
        "annotations": [
            { "id": 10, "image_id": 1, "category_id": 1, "bbox": [1.5, 2.25, 3.0, 4], "area": 12.0, "iscrowd": 0,
              "segmentation": [[1.5, 2.25, 4.5, 2.25, 4.5, 6.25]] },
            { "id": 11, "image_id": 5, "category_id": 2, "bbox": [0, 0, 2, 2] },
            { "id": 12, "image_id": 5, "category_id": 1, "bbox": [4, 4, 2, 2] },
        ],
        "categories": [{ "id": 1, "name": "bolt" }, { "id": 2, "name": "nut" }],
    })
}

fn list<'a>(coco: &'a Value, name: &str) -> &'a [Value] {
    coco[name].as_array().expect("a list")
}

/// Ids are unique, every annotation has its image, every image its file and the boxes of the one that it comes from.
fn assert_coco(folder: &Folder, json: &str, images: &str, counts: [usize; 2]) -> Value {
    let coco: Value = serde_json::from_str(&folder.read(json)).expect("JSON");
    let ids =
        |name: &str| list(&coco, name).iter().map(|one| one["id"].as_u64().expect("an id")).collect::<BTreeSet<_>>();
    assert_eq!([ids("images").len(), ids("annotations").len()], counts, "{json}");
    assert_eq!([list(&coco, "images").len(), list(&coco, "annotations").len()], counts);
    let mut boxes: BTreeMap<u64, Vec<String>> = BTreeMap::new();
    for annotation in list(&coco, "annotations") {
        let mut kept = annotation.clone();
        let of = kept["image_id"].as_u64().expect("an id");
        for key in ["id", "image_id"] {
            kept.as_object_mut().expect("an object").shift_remove(key);
        }
        boxes.entry(of).or_default().push(kept.to_string());
    }
    assert!(boxes.keys().all(|id| ids("images").contains(id)));
    let by_key: BTreeMap<&str, u64> = list(&coco, "images")
        .iter()
        .filter(|image| image["source"] == "real")
        .map(|image| (image["file_name"].as_str().expect("text"), image["id"].as_u64().expect("an id")))
        .collect();
    for image in list(&coco, "images") {
        let file = format!("{images}/{}", image["file_name"].as_str().expect("text"));
        assert!(folder.path(&file).is_file(), "{file}");
        if image["source"] == "photometric" {
            let key = image["source_key"].as_str().expect("text");
            let key = key.rsplit('/').next().expect("a name");
            let (_, real) = by_key.iter().find(|(name, _)| name.ends_with(key)).expect("its real image");
            assert_eq!(boxes.get(real), boxes.get(&image["id"].as_u64().expect("an id")), "{image}");
        }
    }
    coco
}

#[test]
fn coco_annotations_are_carried_to_the_copies_and_ids_stay_unique() {
    let folder = Folder::new();
    let before = coco("");
    let files = [
        ("annotations.json", before.to_string().into_bytes()),
        ("images/0.png", png(0)),
        ("images/1.jpg", picture(1, ImageFormat::Jpeg)),
        ("images/2.png", png(2)),
    ];
    write(&folder, &files);
    folder.write("augment.toml", undivided());
    folder.succeed("augment augment.toml --out larger --quiet");
    assert_images(&folder, "larger", 6);
    let after = assert_coco(&folder, "larger/annotations.json", "larger/images", [9, 9]);
    assert_eq!((&after["info"], &after["categories"]), (&before["info"], &before["categories"]));
    for (name, own) in [("images", true), ("annotations", false)] {
        for one in list(&before, name) {
            let mut one = one.clone();
            if own {
                for (key, value) in [("source", "real"), ("source_key", ""), ("augmentation", "")] {
                    one[key] = Value::from(value);
                }
            }
            assert!(list(&after, name).contains(&one), "{one}");
        }
    }
    // An image with one category is of that class.
    let summary: Value = serde_json::from_str(&folder.read("larger/augment.json")).expect("JSON");
    assert_eq!((&summary["classes"]["bolt"]["real"], &summary["classes"]["nut"]), (&Value::from(1), &Value::Null));
    // Read again, it is a set of nine images.
    folder.write(
        "again.toml",
        "[input]\npath = \"larger\"\n[output]\nprefix = \"b_\"\nsplits = { train = 0.5, test = 0.5 }\n",
    );
    folder.succeed("augment again.toml --out again --quiet");
    let parts: usize = ["train", "test"]
        .iter()
        .map(|split| {
            let coco: Value =
                serde_json::from_str(&folder.read(&format!("again/{split}/annotations.json"))).expect("JSON");
            for image in list(&coco, "images") {
                let name = image["file_name"].as_str().expect("text");
                assert!(folder.path(&format!("again/{split}/{name}")).is_file(), "{name}");
            }
            list(&coco, "images").len()
        })
        .sum();
    assert_eq!(parts, 9);
    // New samples would have no boxes.
    folder.write("new.toml", super::JOB);
    folder.write("augment.toml", format!("{}[mixing]\njob = \"new.toml\"\n", undivided()));
    let said = folder.fail("augment augment.toml --out none", 2);
    assert!(said.contains("a new sample has no boxes") && said.contains("leave [mixing] out"), "{said}");
}

#[test]
fn coco_of_splits_lies_as_roboflow_and_as_coco_itself_have_it() {
    for (jsons, images) in [
        (["train/_annotations.coco.json", "valid/_annotations.coco.json"], ["train", "valid"]),
        (["annotations/instances_train2017.json", "annotations/instances_val2017.json"], ["train2017", "val2017"]),
        (["annotations/instances_train.json", "annotations/instances_val.json"], ["images/train", "images/val"]),
    ] {
        let folder = Folder::new();
        for (k, (json, images)) in jsons.iter().zip(&images).enumerate() {
            let prefix = ["a", "b"][k];
            let names = ["0.png", "1.jpg", "2.png"].map(|name| format!("{images}/{prefix}{name}"));
            let mut files: Vec<(&str, Vec<u8>)> = names.iter().map(|name| (name.as_str(), png(k as u8))).collect();
            files.push((json, coco(prefix).to_string().into_bytes()));
            write(&folder, &files);
        }
        folder.write("augment.toml", RECIPE);
        let said = folder.succeed("augment augment.toml --out larger");
        assert!(said.contains("  train: 3 real, 6 photometric\n"), "{said}");
        let outs = images.map(|images| format!("larger/{images}"));
        assert_coco(&folder, &format!("larger/{}", jsons[0]), &outs[0], [9, 9]);
        assert_coco(&folder, &format!("larger/{}", jsons[1]), &outs[1], [3, 3]);
        assert_images(&folder, "larger", 6);
    }
}

#[test]
fn mistakes_in_coco_annotations_are_named() {
    let folder = Folder::new();
    let write_with = |change: &dyn Fn(&mut Value)| {
        let mut whole = coco("");
        change(&mut whole);
        write(&folder, &[("0.png", png(0)), ("1.jpg", png(1)), ("2.png", png(2))]);
        write(&folder, &[("annotations.json", whole.to_string().into_bytes())]);
        folder.write(
            "augment.toml",
            undivided().replace("path = \"real\"", "path = \"real\"\nlabels = \"annotations.json\""),
        );
    };
    type Case<'a> = (&'a dyn Fn(&mut Value), &'a [&'a str]);
    let cases: [Case; 5] = [
        (
            &|coco| coco["images"][1]["id"] = json!(1),
            &["the image 1.jpg has no id of its own", "give each image another id"],
        ),
        (
            &|coco| coco["images"][0]["width"] = json!(640),
            &["0.png is 16x12 px, and its annotations are for 640x12 px", "fix width and height"],
        ),
        (&|coco| coco["images"][0]["file_name"] = json!("/home/ann/0.png"), &["is not in the folder", "input.images"]),
        (
            &|coco| coco["images"][0]["file_name"] = json!("none.png"),
            &["none.png: it is not there", "take it and its annotations out"],
        ),
        (&|coco| *coco = json!([{ "file": "0.png" }]), &["holds no COCO annotations", "in a file that ends in .jsonl"]),
    ];
    for (change, parts) in cases {
        write_with(change);
        let said = folder.fail("augment augment.toml --out larger", 2);
        assert!(parts.iter().all(|part| said.contains(part)), "{parts:?}\n{said}");
    }
    write_with(&|coco| coco["annotations"][0]["image_id"] = json!(99));
    let said = folder.succeed("augment augment.toml --out larger");
    assert!(
        said.contains("warning: the annotation 10 of ") && said.contains("is of no image, and is left out"),
        "{said}"
    );
    // The same images in two files: which one is meant is for the user to say.
    fs::remove_file(folder.path("real/annotations.json")).expect("a file");
    write(
        &folder,
        &[
            ("instances_all.json", coco("").to_string().into()),
            ("person_keypoints_all.json", coco("").to_string().into()),
        ],
    );
    folder.write("augment.toml", undivided());
    let said = folder.fail("augment augment.toml --out twice", 2);
    assert!(said.contains("3 images are there twice, or in two files,"), "{said}");
    folder.succeed("augment augment.toml --out once --quiet --set input.labels=\"instances_all.json\"");
    assert!(!folder.path("once/person_keypoints_all.json").exists());
}

const FORMATS: [(&str, ImageFormat); 5] = [
    ("0.png", ImageFormat::Png),
    ("1.jpg", ImageFormat::Jpeg),
    ("2.bmp", ImageFormat::Bmp),
    ("3.tif", ImageFormat::Tiff),
    ("4.webp", ImageFormat::WebP),
];

#[test]
fn images_of_every_format_are_read_in_tables_by_their_bytes_and_stay_as_they_are() {
    let folder = Folder::new();
    let mut files: Vec<(&str, Vec<u8>)> = FORMATS.iter().map(|(name, format)| (*name, picture(0, *format))).collect();
    files.push(("really_a_jpeg.png", picture(5, ImageFormat::Jpeg)));
    let rows_of: String = files.iter().map(|(name, _)| format!("{name},ball\n")).collect();
    files.push(("labels.csv", format!("file,class\n{rows_of}").into_bytes()));
    write(&folder, &files);
    folder.write("background.jpg", picture(1, ImageFormat::Jpeg));
    let recipe = undivided().replace("path = \"real\"", "path = \"real\"\nbackground = \"background.jpg\"");
    folder.write("augment.toml", recipe.replace("copies = 2", "copies = 2\nbackground = [\"background.jpg\"]"));
    folder.succeed("augment augment.toml --out larger --quiet");
    let made = assert_images(&folder, "larger", 12);
    assert!(made.contains("1-photometric-0-0.png") && made.contains("really_a_jpeg-photometric-0-0.png"), "{made:?}");
    // The page shows them all.
    assert_eq!(folder.read("larger/report.html").matches("alt=\"real\"").count(), 6);
    // Two formats of one name would have copies of one name.
    write(&folder, &[("0.jpg", png(0)), ("labels.csv", format!("file,class\n{rows_of}0.jpg,ball\n").into_bytes())]);
    let said = folder.fail("augment augment.toml --out twice", 2);
    assert!(said.contains("0.jpg would be the name of two samples"), "{said}");
}

#[test]
fn tars_keep_the_endings_of_their_images_and_what_is_made_is_of_that_format() {
    for (suffix, format) in [
        ("jpg", ImageFormat::Jpeg),
        ("png", ImageFormat::Png),
        ("tactile.webp", ImageFormat::WebP),
        ("rgb.bmp", ImageFormat::Bmp),
    ] {
        let folder = Folder::new();
        folder.write("new.toml", super::JOB);
        fs::create_dir(folder.path("real")).expect("a folder");
        let mut tar = tar::Builder::new(fs::File::create(folder.path("real/shard-000.tar")).expect("a file"));
        for number in 0..3_u8 {
            for (end, bytes) in [(suffix, picture(number, format)), ("json", br#"{"class":"cube"}"#.to_vec())] {
                let mut header = tar::Header::new_ustar();
                header.set_path(format!("{number}.{end}")).expect("a name");
                header.set_size(bytes.len() as u64);
                header.set_cksum();
                tar.append(&header, bytes.as_slice()).expect("written");
            }
        }
        tar.finish().expect("written");
        folder.write(
            "augment.toml",
            format!("{}[[photometric]]\n[mixing]\njob = \"new.toml\"\nsynthetic_per_real = 1.0\n", undivided()),
        );
        folder.succeed("augment augment.toml --out larger --quiet");
        let samples = in_tars(&folder, "larger");
        assert_eq!(samples.len(), 3 * (1 + 2 + 1 + 1), "{suffix}");
        for (key, (_, files)) in &samples {
            assert_eq!(files.keys().collect::<Vec<_>>(), [suffix.min("json"), suffix.max("json")], "{key}");
            assert_eq!(image::guess_format(&files[suffix]).expect("a picture"), format, "{key}");
            match label(files)["source"].as_str() {
                Some("real") => assert!(files[suffix] == picture(key.parse().expect("a number"), format), "{key}"),
                // Nothing was changed: the bytes are the real ones, whatever the format loses.
                Some("photometric") if key.contains("-1-0") => {
                    let real = &label(files)["source_key"];
                    assert!(files[suffix] == samples[real.as_str().expect("text")].1[suffix], "{key}");
                }
                _ => {}
            }
        }
    }
}

#[test]
fn what_is_no_picture_or_damaged_is_said_once_in_plain_words_with_the_first_places() {
    let folder = Folder::new();
    let mut wrong_crc = png(0);
    // The four bytes before those of the last chunk.
    let at = wrong_crc.len() - 13;
    wrong_crc[at] ^= 0x55;
    let rows: String = (0..120).map(|k| format!("{k:03}.png,0.5\n")).collect();
    let pointer = b"version https://git-lfs.github.com/spec/v1\noid sha256:0\nsize 5\n".to_vec();
    for number in 0..120 {
        write(&folder, &[(&format!("{number:03}.png"), if number < 2 { png(0) } else { pointer.clone() })]);
    }
    write(&folder, &[("labels.csv", format!("file,depth_mm\n{rows}").into_bytes())]);
    folder.write("augment.toml", undivided());
    let said = folder.fail("augment augment.toml --out larger", 2);
    assert_eq!(said.matches("error: ").count(), 1, "{said}");
    for part in [
        "118 images cannot be read (it is a pointer of Git LFS, not the file itself: fetch the file itself",
        "002.png, 003.png, 004.png and 115 more",
        "real/labels.csv:4:1",
    ] {
        assert!(said.contains(part), "{part}\n{said}");
    }
    write(&folder, &[("labels.csv", b"file\n000.png\n001.png\n".to_vec()), ("001.png", wrong_crc)]);
    let said = folder.fail("augment augment.toml --out larger", 1);
    assert!(
        said.contains("001.png: the PNG is damaged: a checksum in it is wrong") && said.contains("nothing was written"),
        "{said}"
    );
    assert!(!said.contains("Crc") && !said.contains('{'), "{said}");
}

#[test]
fn tars_have_samples_in_folders_whatever_dots_are_in_their_names() {
    for (prefix, key) in [("./", ""), ("v1.0/", "v1.0/"), ("./v1.0/", "v1.0/"), ("a/.x/", "a/.x/")] {
        let folder = Folder::new();
        // What `tar -C folder -cf train.tar .` writes, on a Mac with one more file for each.
        let names = ["", "._000.png", "000.png", "000.json"].map(|name| format!("{prefix}{name}"));
        let contents = [Vec::new(), b"x".to_vec(), png(0), br#"{"class":"cube"}"#.to_vec()];
        let files: Vec<(&str, Vec<u8>)> = names.iter().map(String::as_str).zip(contents).collect();
        pack(&folder, "train.tar", &files);
        folder.write("augment.toml", undivided());
        folder.succeed("augment augment.toml --out larger --quiet");
        let written: Vec<String> =
            members(&folder.path("larger/train.tar")).into_iter().map(|member| member.name).collect();
        let expected = ["", "-photometric-0-0", "-photometric-0-1"]
            .iter()
            .flat_map(|tag| ["png", "json"].map(|end| format!("{key}000{tag}.{end}")));
        assert_eq!(written, expected.collect::<Vec<String>>(), "{prefix}");
    }
}

#[test]
fn tars_that_a_number_or_the_index_tells_of_and_that_are_not_there_are_named() {
    let folder = Folder::new();
    folder.write("augment.toml", undivided());
    let fill = |tar: &str, number: u8| {
        let key = number.to_string();
        pack(&folder, tar, &[(&format!("{key}.png"), png(number)), (&format!("{key}.json"), b"{}".to_vec())]);
    };
    let said = || folder.succeed("augment augment.toml --out larger --overwrite");
    // Days are no series.
    for (number, tar) in ["train-007.tar", "train-008.tar", "day-20260101.tar", "day-20260401.tar"].iter().enumerate() {
        fill(tar, number as u8);
    }
    assert!(!said().contains("missing"), "{}", said());
    fill("train-010.tar", 9);
    assert!(said().contains("warning: real/train-009.tar is missing"), "{}", said());
    let index =
        r#"{"shardlist": [{"url": "train-007.tar"}, {"url": "train-011.tar"}, {"url": "https://host/train-012.tar"}]}"#;
    folder.write("real/wids.json", index);
    assert!(said().contains("2 tars are missing in real: train-009.tar, train-011.tar"), "{}", said());
    // What is named is what is meant.
    folder.write("augment.toml", undivided().replace("\"real\"", "\"real/train-007.tar\""));
    assert!(!said().contains("missing"), "{}", said());
}

#[test]
fn new_samples_have_the_class_numbers_of_the_set_and_keys_of_their_own() {
    for folder in [super::with_tars(), super::with_folders()] {
        // In a dataset of this job, the classes would be 0 (anvil) and 1 (cube).
        folder.write("new.toml", edited(super::JOB, &[("class = \"pointed\"", "class = \"anvil\"")]));
        folder.write("augment.toml", edited(super::RECIPE, &[("\"real\"", "\"out/real\"")]));
        folder.succeed("augment augment.toml --out larger --quiet");
        let mut labels: Vec<Value> =
            in_tars(&folder, "larger").values().map(|(_, files)| Value::Object(label(files))).collect();
        for (_, rows) in folder.files("larger").iter().filter(|(name, _)| name.ends_with("metadata.jsonl")) {
            let rows = String::from_utf8_lossy(rows);
            labels.extend(rows.lines().map(|row| serde_json::from_str::<Value>(row).expect("JSON")));
        }
        let (mut classes, mut keys) = (BTreeSet::new(), BTreeSet::new());
        for label in &labels {
            let objects = label["objects"].as_array().into_iter().flatten().chain([&label["object"]]);
            for object in objects {
                let class = object["class"].as_str().expect("text");
                let number = ["cube", "pointed", "anvil"].iter().position(|known| *known == class).expect("known");
                assert_eq!(object["class_index"], number as u64, "{label}");
                classes.insert(class);
            }
            if label["source"] == "real" || label["source"] == "synthetic" {
                assert!(keys.insert(label["key"].as_str().expect("text")), "{label}");
            }
        }
        assert_eq!((classes.len(), keys.len()), (3, 24 + 9));
    }
}

#[test]
fn the_columns_of_an_imagefolder_in_csv_are_text_in_every_split() {
    let folder = Folder::new();
    for split in ["train", "test"] {
        let table = b"file_name,class\n0.png,cube\n".to_vec();
        write(&folder, &[(&format!("{split}/0.png"), png(0)), (&format!("{split}/metadata.csv"), table)]);
    }
    folder.write("new.toml", super::JOB);
    folder.write("augment.toml", format!("{RECIPE}[mixing]\njob = \"new.toml\"\n"));
    folder.succeed("augment augment.toml --out larger --quiet");
    for (split, count) in [("train", 4), ("test", 1)] {
        let rows = rows(&folder.read(&format!("larger/{split}/metadata.csv")));
        assert_eq!(rows.len(), count);
        for row in rows {
            let real = format!("{split}/0.png");
            let key = if row["source"] == "synthetic" { &row["file_name"] } else { &real };
            assert_eq!(row["source_key"], *key, "{row:?}");
            assert_eq!(row["augmentation"] == "{}", row["source"] == "real", "{row:?}");
            serde_json::from_str::<Value>(&row["augmentation"]).expect("JSON");
        }
    }
}

#[test]
fn images_that_are_stored_turned_are_told() {
    let jpeg = picture(1, ImageFormat::Jpeg);
    // EXIF with one entry: the orientation 6.
    let exif = b"\xff\xe1\0\x22Exif\0\0MM\0\x2a\0\0\0\x08\0\x01\x01\x12\0\x03\0\0\0\x01\0\x06\0\0\0\0\0\0";
    let turned = [&jpeg[..2], exif, &jpeg[2..]].concat();
    let folder = Folder::new();
    write(&folder, &[("ball/0.jpg", turned.clone()), ("ball/1.jpg", jpeg)]);
    folder.write("augment.toml", undivided());
    let said = folder.succeed("augment augment.toml --out larger");
    assert!(said.contains("warning: ball/0.jpg is stored turned (EXIF orientation 6)"), "{said}");
    assert!(said.contains("mogrify -auto-orient") && !said.contains("1.jpg"), "{said}");
    let folder = Folder::new();
    pack(&folder, "train.tar", &[("0.jpg", turned)]);
    folder.write("augment.toml", undivided());
    let said = folder.succeed("augment augment.toml --out larger");
    assert!(said.contains("train.tar: 0 is stored turned (EXIF orientation 6)"), "{said}");
}

#[test]
fn new_samples_without_a_label_are_told_with_the_columns_that_may_be_one() {
    let recipe = "[input]\npath = \"real\"\n[mixing]\njob = \"new.toml\"\n";
    let folder = Folder::new();
    folder.write("new.toml", super::JOB);
    folder.write("augment.toml", recipe);
    write(&folder, &[("0.png", png(0)), ("labels.csv", b"file,split,cls\n0.png,train,a\n".to_vec())]);
    let said = folder.succeed("augment augment.toml --out larger");
    assert!(said.contains("warning: new samples get no label: none of `cls` is known as object, class,"), "{said}");
    assert!(said.contains("input.columns.class = \"cls\""), "{said}");
    let said = folder.succeed("augment augment.toml --out named --set input.columns.class=\"cls\"");
    assert!(!said.contains("warning: new samples"), "{said}");

    let folder = Folder::new();
    folder.write("new.toml", super::JOB);
    folder.write("augment.toml", recipe);
    pack(&folder, "train.tar", &[("0.png", png(0)), ("0.cls", b"1".to_vec())]);
    let said = folder.succeed("augment augment.toml --out larger");
    assert!(said.contains("warning: new samples get no label and no file that ends in `cls`: no `json`"), "{said}");
    // Images alone have no label that could be missing.
    let folder = Folder::new();
    folder.write("new.toml", super::JOB);
    folder.write("augment.toml", recipe);
    write(&folder, &[("0.png", png(0)), ("1.png", png(1))]);
    let said = folder.succeed("augment augment.toml --out larger");
    assert!(!said.contains("warning: new samples"), "{said}");
}
