//! What `augment` advises is done, and leads where it says.

use std::fs;

use super::layouts::{pack, png, undivided, write};
use super::{rows, with_table};
use crate::support::{Folder, edited};

/// A table of two images.
fn small(table: &str) -> Folder {
    let folder = Folder::new();
    write(&folder, &[("0.png", png(0)), ("1.png", png(1)), ("labels.csv", table.as_bytes().to_vec())]);
    folder.write("augment.toml", undivided());
    folder
}

/// `augment` refuses and says all of this; what it says.
fn refused(folder: &Folder, parts: &[&str]) -> String {
    let said = folder.fail("augment augment.toml --out larger", 2);
    for part in parts {
        assert!(said.contains(part), "{part}\n{said}");
    }
    said
}

#[test]
fn a_quote_that_nothing_closes_and_bytes_that_are_no_text_are_refused_with_their_place() {
    for (table, parts) in [
        ("file,note\n\"0.png,a\n1.png,b\n", ["labels.csv:2:1", "a quote is opened and never closed"]),
        ("file,note\n0.png,\"a\n1.png,b\n", ["labels.csv:2:7", "a quote is opened and never closed"]),
        ("file,note\n0.png,\"a\n1.png,\"b\"\n", ["labels.csv:2:7", "closed on line 3, where its cell does not end"]),
        ("file,note\n0.png,a\n1.png,b\0\n", ["labels.csv:3:8", "the table has a NUL byte"]),
        ("file,\0note\n0.png,a\n1.png,b\n", ["labels.csv:1:6", "the table has a NUL byte"]),
    ] {
        let folder = small(table);
        let said = refused(&folder, &parts);
        assert_eq!(said.matches("error: ").count(), 1, "{said}");
        // The quotes closed and the byte removed.
        let mended = table.replace("\"0.png,", "0.png,").replace("\"a\n", "\"a\"\n").replace('\0', "");
        write(&folder, &[("labels.csv", mended.into_bytes())]);
        folder.succeed("augment augment.toml --out larger --quiet");
    }
    let folder = small("");
    let utf16: Vec<u8> = "\u{feff}file\n0.png\n".encode_utf16().flat_map(u16::to_le_bytes).collect();
    for (bytes, part) in [
        (utf16, "UTF-16 text"),
        (b"file,who\n0.png,Andr\xe9\n".to_vec(), "labels.csv:2:11"),
        (Vec::new(), "the table is empty"),
        (b"file\n".to_vec(), "no row follows the names of the columns"),
        (b"PK\x03\x04rest".to_vec(), "a ZIP archive, no table"),
    ] {
        write(&folder, &[("labels.csv", bytes)]);
        assert!(refused(&folder, &[part]).contains("help: "));
    }
}

#[test]
fn a_quaternion_is_mended_by_its_parts_and_never_by_emptying_one() {
    let columns = "quaternion_x,quaternion_y,quaternion_z,quaternion_w";
    for (row, remedy, mended) in [
        ("0,0,,1", "write the parts that are not there (`quaternion_z`)", ["0,0,0,1", ",,,"]),
        ("0,0,0,0", "write the four parts of the turn (0, 0, 0, 1 for none)", ["0,0,0,1", ",,,"]),
    ] {
        let folder = small(&format!("file,{columns}\n0.png,{row}\n1.png,0,0,1,0\n"));
        let said = refused(&folder, &["a quaternion has four parts", remedy, "leave the cell empty in all four"]);
        assert!(!said.contains("without its unit"), "{said}");
        for mended in mended {
            let table = format!("file,{columns}\n0.png,{mended}\n1.png,0,0,1,0\n");
            write(&folder, &[("labels.csv", table.into_bytes())]);
            folder.succeed("augment augment.toml --out larger --overwrite --quiet");
        }
    }
    let folder = small("file,quaternion_x,quaternion_y,quaternion_z,w\n0.png,0,0,0,1\n1.png,0,0,1,0\n");
    refused(&folder, &["2 quaternions", "name it with input.columns.quaternion_w"]);
    folder.succeed("augment augment.toml --out larger --quiet --set input.columns.quaternion_w=\"w\"");
}

#[test]
fn one_cause_in_many_rows_is_one_message() {
    let many = |row: &dyn Fn(usize) -> String| (0..60).map(row).collect::<String>();
    let header = "file,depth_mm\n";
    for (table, parts) in [
        (
            header.to_owned() + &many(&|k| format!("{}.png,0.5 mm\n", k % 2)),
            [
                "60 values of `depth_mm` are no numbers: 0.png (0.5 mm), 1.png (0.5 mm), 0.png (0.5 mm) and 57 more",
                ":2:7",
            ],
        ),
        (
            header.to_owned() + &many(&|k| format!("{}.png,\"0,5\"\n", k % 2)),
            ["60 values of `depth_mm` are no numbers", "write numbers with a point: 1.5"],
        ),
        (
            header.to_owned() + &many(&|_| String::from("0.png,0.5,\n")),
            ["60 rows have not as many cells as there are columns (2): line 2 (3 cells), line 3 (3 cells)", ":2:1"],
        ),
        (
            header.to_owned() + &many(&|_| String::from(",0.5\n")),
            ["60 rows name no image: line 2, line 3, line 4 and 57 more", "name the image, or remove the row"],
        ),
        (
            header.to_owned() + &many(&|_| String::from("0.png,0.5\n")),
            ["59 images are in several rows: 0.png (lines 2 and 3)", "keep one of the two rows"],
        ),
        (
            header.to_owned() + &many(&|k| format!("C:\\set\\{k}.png,0.5\n")),
            ["60 images have absolute paths: C:\\set\\0.png", "write names like 0.png in the table"],
        ),
    ] {
        let folder = small(&table);
        let said = refused(&folder, &parts);
        assert!(said.matches("error: ").count() <= 2, "{said}");
    }
    let folder = small("");
    fs::remove_file(folder.path("real/labels.csv")).expect("a file");
    write(&folder, &[("labels.jsonl", b"[\n{\"file\":\"0.png\"},\n{\"file\":\"1.png\"}\n]\n".to_vec())]);
    refused(
        &folder,
        &["3 lines are no JSON objects: line 1, line 2, line 4", "write each object on a line of its own"],
    );
    write(&folder, &[("labels.jsonl", b"{\"file\":\"0.png\"}\n{\"file\":\"1.png\"}\n".to_vec())]);
    folder.succeed("augment augment.toml --out larger --quiet");
}

#[test]
fn names_of_images_that_are_nearly_right_are_told_as_they_are() {
    for (name, remedy, mended) in [
        ("0.PNG", "is \"0.png\" meant by \"0.PNG\"?", "0.png"),
        ("0", "is \"0.png\" meant by \"0\"?", "0.png"),
        ("/home/ann/set/img/a.png", "img/a.png is there: write names like img/a.png in the table", "img/a.png"),
        ("data/img/a.png", "img/a.png is there: write names like img/a.png in the table", "img/a.png"),
        ("7.png", "copy it there, or remove its row", "0.png"),
    ] {
        let folder = small(&format!("file\n{name}\n1.png\n"));
        write(&folder, &[("img/a.png", png(3))]);
        refused(&folder, &[remedy]);
        write(&folder, &[("labels.csv", format!("file\n{mended}\n1.png\n").into_bytes())]);
        folder.succeed("augment augment.toml --out larger --quiet");
    }
}

#[test]
fn inputs_of_other_kinds_are_named_with_a_way_to_one_that_is_read() {
    let info = br#"{"codebase_version":"v3.0"}"#.to_vec();
    let own = br#"{"exporter":1,"to":"lerobot","name":"presses"}"#.to_vec();
    type Case<'a> = (&'a [(&'a str, Vec<u8>)], &'a [&'a str]);
    let cases: [Case; 12] = [
        (
            &[("meta/info.json", info.clone()), ("meta/gelsim.json", own.clone()), ("meta/tasks.parquet", Vec::new())],
            &[
                "a LeRobot dataset, a copy that gelsim-export made of the dataset \"presses\"",
                "name the folder of that dataset",
            ],
        ),
        (
            &[("meta/info.json", info)],
            &["is a LeRobot dataset: its images are in Parquet or videos", "save its images as files"],
        ),
        (
            &[(".zattrs", br#"{"gelsim":{"name":"presses"}}"#.to_vec())],
            &["a Zarr store, a copy that gelsim-export made"],
        ),
        (&[("state.json", br#"{"_data_files":[]}"#.to_vec())], &["save_to_disk", "save its images as files"]),
        (
            &[("images/train/0.png", png(0)), ("labels/train/0.txt", b"0 .5 .5 .1 .1\n".to_vec())],
            &["in the form of YOLO", "export them as COCO"],
        ),
        (
            &[("JPEGImages/0.png", png(0)), ("Annotations/0.xml", b"<a/>".to_vec())],
            &["Pascal VOC", "export them as COCO"],
        ),
        (&[("data/train.parquet", b"PAR1".to_vec())], &["data/train.parquet", "save it as CSV or JSON Lines"]),
        (&[("a/0.npy", b"x".to_vec())], &["holds NumPy arrays, and no images", "save each image as PNG"]),
        (&[("press.mp4", b"x".to_vec())], &["holds videos", "ffmpeg"]),
        (&[("set.zip", b"x".to_vec())], &["holds archives", "unpack them"]),
        (&[("notes.md", b"x".to_vec())], &["no labels and no images are in", "a folder for each class"]),
        (&[("table.tsv", b"file\tclass\n".to_vec()), ("0.png", png(0))], &["table.tsv", "save it as CSV"]),
    ];
    for (files, parts) in cases {
        let folder = Folder::new();
        write(&folder, files);
        folder.write("augment.toml", undivided());
        refused(&folder, parts);
    }
    let folder = small("file\n0.png\n1.png\n");
    folder.write("set.zip", b"PK\x03\x04");
    for (path, parts) in [
        ("real/labels.csv", ["labels.csv is a file", "labels = \"labels.csv\""]),
        ("reel", ["reel does not exist", "did you mean real?"]),
        ("set.zip", ["set.zip is an archive", "unpack it"]),
    ] {
        let said = folder.fail(&format!("augment augment.toml --out larger --set input.path=\"{path}\""), 2);
        assert!(parts.iter().all(|part| said.contains(part)), "{said}");
    }
    for (key, parts) in [
        ("input.labels=\"lables.csv\"", ["lables.csv does not exist", "did you mean \"labels.csv\"?"]),
        ("input.labels=\"label\"", ["no tars are in", "\"folders\" for classes by folder"]),
        ("input.images=\"imgs\"", ["no folder imgs is in", "name the folder with the images"]),
        ("input.images=\"../real\"", ["../real is not in the folder", "name the folder above both"]),
    ] {
        let said = folder.fail(&format!("augment augment.toml --out larger --set {key}"), 2);
        assert!(parts.iter().all(|part| said.contains(part)), "{said}");
    }
}

#[test]
fn the_file_itself_is_found_by_a_name_like_it() {
    let folder = small("file\n0.png\n1.png\n");
    for (file, parts) in [
        ("augmnt.toml", ["cannot read it", "did you mean augment.toml?"]),
        ("augment", ["cannot read it", "did you mean augment.toml?"]),
        ("real", ["cannot read it", "name a file that ends in .toml"]),
    ] {
        let said = folder.fail(&format!("augment {file} --out larger"), 2);
        assert!(parts.iter().all(|part| said.contains(part)), "{said}");
    }
    folder.write("augment.toml", b"seed = 1 # caf\xe9\n");
    refused(&folder, &["it is not UTF-8 at line ", "a recipe is a text in UTF-8"]);
}

#[test]
fn a_name_that_no_object_has_is_mended_by_a_class_or_in_the_label() {
    let folder = with_table();
    let recipe = format!(
        "[input]\npath = \"real\"\nbackground = \"background.png\"\n[input.columns]\nobject = \"operator\"\n{}\
         [[object]]\npath = \"cube.obj\"\n[paired]\nmax_offset_px = 0\n",
        super::leds()
    );
    let mut text = folder.read("real/labels.csv");
    for number in 0..24 {
        text = text.replace(&format!("\"Ann, {number}\""), "ball");
    }
    folder.write("real/labels.csv", text);
    folder.write("augment.toml", &recipe);
    let said = refused(
        &folder,
        &["18 labels name `ball`, and no [[object]] is called so", "class = \"ball\" under its [[object]]"],
    );
    assert_eq!(said.matches("error: ").count(), 1, "{said}");
    folder.write("augment.toml", edited(&recipe, &[("path = \"cube.obj\"", "path = \"cube.obj\"\nclass = \"ball\"")]));
    let said = folder.succeed("augment augment.toml --out larger");
    assert!(said.contains("train: 18 real, 18 twin"), "{said}");
    // Several of one class.
    let both = "path = \"cube.obj\"\nclass = \"ball\"\n[[object]]\npath = \"cone.obj\"\nclass = \"ball\"";
    folder.write("augment.toml", edited(&recipe, &[("path = \"cube.obj\"", both)]));
    refused(&folder, &["18 labels name `ball`, and several [[object]]s are of this class", "`cube` or `cone`"]);

    // Depths in another unit, and labels that say nothing.
    folder.write("augment.toml", edited(&recipe, &[("path = \"cube.obj\"", "path = \"cube.obj\"\nclass = \"ball\"")]));
    let table = folder.read("real/labels.csv");
    let with_depths = |depth: &dyn Fn(usize) -> String| {
        let line = |(k, line): (usize, &str)| {
            let mut cells: Vec<String> = line.split(',').map(str::to_owned).collect();
            if k > 0 {
                cells[5] = depth(k);
            }
            cells.join(",") + "\n"
        };
        table.lines().enumerate().map(line).collect::<String>()
    };
    folder.write("real/labels.csv", with_depths(&|_| String::from("500")));
    let said = refused(&folder, &["18 depths are more than the pad's", "give depths in mm"]);
    assert_eq!(said.matches("error: ").count(), 1, "{said}");
    folder.write("real/labels.csv", with_depths(&|k| if k < 9 { String::new() } else { String::from("0.5") }));
    let said = folder.succeed("augment augment.toml --out some");
    assert!(
        said.contains("real samples get no simulated counterpart")
            && said.contains("fill `operator` and `depth_mm` in"),
        "{said}"
    );
    folder.write("real/labels.csv", with_depths(&|_| String::from("0.5")));
    let said = folder.succeed("augment augment.toml --out all");
    assert!(!said.contains("note: "), "{said}");
}

#[test]
fn a_total_that_is_too_small_names_one_that_is_not() {
    let folder = with_table();
    folder.write("augment.toml", edited(super::RECIPE, &[("synthetic_per_real = 0.5", "total = 50")]));
    refused(&folder, &["there are 60 samples without any synthetic one", "write more than 60"]);
    folder.succeed("augment augment.toml --out larger --quiet --set mixing.total=61");
    assert_eq!(rows(&folder.read("larger/labels.csv")).len(), 61);
}

#[test]
fn objects_that_a_split_needs_of_the_job_are_named() {
    let folder = with_table();
    let job = edited(super::JOB, &[("[[object]]\npath = \"cone.obj\"\nclass = \"pointed\"\n", "")]);
    folder.write("new.toml", &job);
    let more = "[output]\nsplit_by = \"object\"\nsplits = { train = 0.3, test = 0.7 }\n[[photometric]]";
    folder.write("augment.toml", edited(super::RECIPE, &[("[[photometric]]", more)]));
    refused(
        &folder,
        &[
            "the job draws no object that may be in the split `train`",
            "`cone` or `pointed`",
            "leave the split out of `splits`",
        ],
    );
    folder.write("new.toml", super::JOB);
    folder.succeed("augment augment.toml --out larger --quiet");
    folder.write("new.toml", &job);
    let other =
        edited(&folder.read("augment.toml"), &[("synthetic_per_real", "splits = [\"test\"]\nsynthetic_per_real")]);
    folder.write("augment.toml", other);
    folder.succeed("augment augment.toml --out other --quiet");
}

#[test]
fn files_of_tars_that_may_be_images_are_offered_and_no_others() {
    let folder = Folder::new();
    folder.write("augment.toml", undivided());
    fs::create_dir(folder.path("real")).expect("a folder");
    let pack = |files: &[(&str, Vec<u8>)]| {
        let mut tar = tar::Builder::new(fs::File::create(folder.path("real/a.tar")).expect("a file"));
        for (name, bytes) in files {
            let mut header = tar::Header::new_ustar();
            header.set_path(name).expect("a name");
            header.set_size(bytes.len() as u64);
            header.set_cksum();
            tar.append(&header, bytes.as_slice()).expect("written");
        }
        tar.finish().expect("written");
    };
    let label = || b"{}".to_vec();
    pack(&[("0.left.jpg", png(0)), ("0.right.png", png(1)), ("0.json", label())]);
    let said =
        refused(&folder, &["no file of the sample is its image", "image = \"left.jpg\" (`left.jpg` or `right.png`)"]);
    assert!(!said.contains("`json`"), "{said}");
    folder.succeed("augment augment.toml --out larger --quiet --set input.image=\"right.png\"");
    pack(&[("0.npy", label()), ("0.json", label())]);
    refused(
        &folder,
        &["no file of the sample is its image", "put the image into the tar as KEY.png or KEY.jpg", "`npy` or `json`"],
    );
    pack(&[("0.png", png(0)), ("0.json", b"[1]".to_vec())]);
    refused(&folder, &["0: json is no JSON object", "write labels as JSON objects"]);
    pack(&[("0.png", png(0)[..60].to_vec()), ("0.json", label())]);
    let said = refused(&folder, &["it is cut off", "write the tar anew without the sample"]);
    assert!(!said.contains("row"), "{said}");
    pack(&[("0.png", png(0)), ("0.json", br#"{"depth_mm":"deep"}"#.to_vec())]);
    refused(&folder, &["a.tar: 0: `depth_mm`: `deep` is no number", "or null"]);
}

#[test]
fn a_sample_that_is_not_healthy_ends_the_run_with_the_keys_that_keep_it_or_draw_it_again() {
    let folder = with_table();
    let solver = "gelpad = { elastic = { resolution = \"full\", max_iterations = 3, tolerance_um = 0.5 } }\n";
    let job = |on_unhealthy: &str| format!("{solver}{}on_unhealthy = \"{on_unhealthy}\"\n", super::JOB);
    folder.write("new.toml", job("fail"));
    folder.write("augment.toml", super::RECIPE);
    let said = folder.fail("augment augment.toml --out larger", 1);
    for part in
        ["of the job is not healthy: the contact is not solved", "on_unhealthy = \"keep\"", "nothing was written"]
    {
        assert!(said.contains(part), "{part}\n{said}");
    }
    folder.write("new.toml", job("keep"));
    folder.succeed("augment augment.toml --out larger --quiet");
}

#[test]
fn pictures_of_the_pad_that_cannot_be_read_are_named_with_what_is_read() {
    let folder = small("file\n0.png\n1.png\n");
    folder.write("untouched.jpg", super::layouts::picture(3, image::ImageFormat::Jpeg));
    folder.write("text.png", "no picture");
    for (name, parts) in [
        ("untouchd.jpg", vec!["cannot read the background", "did you mean untouched.jpg?"]),
        ("text.png", vec!["it is text", "PNG, JPEG, BMP, TIFF or WebP", "\"rendered\""]),
    ] {
        folder.write(
            "augment.toml",
            undivided().replace("path = \"real\"", &format!("path = \"real\"\nbackground = \"{name}\"")),
        );
        refused(&folder, &parts);
    }
    for name in ["untouched.jpg", "rendered"] {
        folder.write(
            "augment.toml",
            undivided().replace("path = \"real\"", &format!("path = \"real\"\nbackground = \"{name}\"")),
        );
        folder.succeed("augment augment.toml --out larger --quiet --overwrite");
    }
}

#[test]
fn numbers_that_only_python_writes_are_named_in_labels_of_every_layout() {
    let remedy = "write null in its place (Python: json.dumps(.., allow_nan=False) finds them)";
    let folder = small("");
    fs::remove_file(folder.path("real/labels.csv")).expect("a file");
    let rows = "{\"file\":\"0.png\",\"d\":NaN}\n{\"file\":\"1.png\",\"d\":0.5}\n";
    write(&folder, &[("labels.jsonl", rows.into())]);
    refused(&folder, &["`NaN` is no JSON", "labels.jsonl:1:21", remedy]);
    write(&folder, &[("labels.jsonl", rows.replace("0.5", "-Infinity").into())]);
    refused(&folder, &["2 labels have a number that is no JSON (`NaN` or `Infinity`): line 1, line 2", remedy]);
    write(&folder, &[("labels.jsonl", rows.replace("NaN", "null").into())]);
    folder.succeed("augment augment.toml --out larger --quiet");

    fs::remove_file(folder.path("real/labels.jsonl")).expect("a file");
    let coco = "{\"images\":[{\"id\":1,\"file_name\":\"0.png\"}],\n\"annotations\":[{\"id\":1,\"image_id\":1,\"bbox\":[NaN,0]}]}";
    write(&folder, &[("annotations.json", coco.into())]);
    refused(&folder, &["annotations.json: `NaN` is no JSON (line 2, column ", remedy]);

    let folder = Folder::new();
    folder.write("augment.toml", undivided());
    pack(&folder, "a.tar", &[("0.png", png(0)), ("0.json", b"{\"d\": -Infinity}".to_vec())]);
    refused(&folder, &["a.tar: 0: json: `-Infinity` is no JSON", remedy]);
}

#[test]
fn tars_of_sequences_and_grips_are_refused_with_the_container_that_is_read() {
    let folder = Folder::new();
    folder.write("augment.toml", undivided());
    for (keys, several) in [
        ("\"sequence\":{}", "sequences"),
        ("\"left\":{}", "grips"),
        ("\"sequence\":{},\"left\":{}", "sequences of grips"),
    ] {
        let label = format!("{{\"generator\":\"gelsim 0.3.0\",{keys}}}");
        pack(
            &folder,
            "a.tar",
            &[("0.f0000.tactile.png", png(0)), ("0.f0001.tactile.png", png(1)), ("0.json", label.into())],
        );
        for key in ["", " --set input.image=\"f0000.tactile.png\""] {
            let said = folder.fail(&format!("augment augment.toml --out larger{key}"), 2);
            assert!(said.contains(&format!("a.tar holds {several}, and augment takes single images")), "{said}");
            assert!(said.contains("container = \"folder\"") && !said.contains("f0001"), "{said}");
        }
    }
    // Of many pictures of others, only the first are named.
    let names: Vec<String> = (0..12).map(|k| format!("0.p{k}.png")).collect();
    let files: Vec<(&str, Vec<u8>)> = names.iter().map(|name| (name.as_str(), png(0))).collect();
    pack(&folder, "a.tar", &files);
    let said = refused(&folder, &["image = \"p0.png\" (`p0.png`, ", "or `p7.png`)"]);
    assert!(!said.contains("p8.png"), "{said}");
}

#[test]
fn samples_of_scaled_objects_get_no_counterpart_and_it_is_said_why() {
    let folder = super::with_folders();
    let table = "out/real/data/train-000000/metadata.jsonl";
    let text = folder.read(table);
    assert!(text.contains("\"scale\":1.0"), "{text}");
    folder.write(table, text.replace("\"scale\":1.0", "\"scale\":0.5"));
    let objects = "[[object]]\npath = \"cube.obj\"\n[[object]]\npath = \"cone.obj\"\nclass = \"pointed\"\n";
    folder.write(
        "augment.toml",
        format!(
            "[input]\npath = \"out/real\"\nbackground = \"rendered\"\n{}{objects}[paired]\nmax_offset_px = 0\n",
            super::leds()
        ),
    );
    let said = folder.succeed("augment augment.toml --out larger");
    for part in [
        "note: 6 of 18 real samples get no simulated counterpart: their objects are scaled (`object.scale`)",
        "train: 18 real, 12 twin",
    ] {
        assert!(said.contains(part), "{part}\n{said}");
    }
}
