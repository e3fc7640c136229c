//! `gelsim augment` on "real" sets that gelsim made: a sensor with other light and noise, in each of the three layouts.

use std::collections::{BTreeMap, BTreeSet};
use std::fs;
use std::path::Path;

use serde_json::{Map, Value};

use crate::support::{Folder, assert_same_files, closed_tags, edited, members};

mod layouts;
mod remedies;
mod splits;

/// The "real" sensor: other LEDs, another pad, noise.
const REAL: &str = r#"
[dataset]
name = "real"
samples = 24
seed = 3
samples_per_shard = 6
splits = { train = 0.75, test = 0.25 }

[sensor]
resolution_px = [48, 36]
[[sensor.led]]
azimuth_deg = 20.0
elevation_deg = 40.0
color = [0.9, 0.3, 0.2]
intensity = 0.8
[[sensor.led]]
azimuth_deg = 200.0
elevation_deg = 40.0
color = [0.2, 0.4, 0.9]
intensity = 0.7

[[object]]
path = "cube.obj"
weight = 3.0

[[object]]
path = "cone.obj"
class = "pointed"

[pose]
yaw_deg = [0.0, 90.0]
x_mm = [-3.0, 0.0]
y_mm = [-2.0, 2.0]
anchor = "origin"

[indentation]
depth_mm = [0.3, 0.7]

[camera]
read_noise_levels = 1.5

[output]
layers = ["depth", "reference"]
"#;

/// The job of new samples.
const JOB: &str = r#"
[dataset]
name = "new"
samples = 1
seed = 9

[sensor]
resolution_px = [640, 480]

[[object]]
path = "cube.obj"

[[object]]
path = "cone.obj"
class = "pointed"

[pose]
yaw_deg = [0.0, 90.0]
x_mm = [-6.0, 6.0]
y_mm = [-4.0, 4.0]

[indentation]
depth_mm = [0.2, 1.2]

[output]
layers = ["depth", "contact"]
"#;

const RECIPE: &str = r#"
seed = 7
[input]
path = "real"
[[photometric]]
copies = 2
exposure_ev = [-0.5, 0.5]
[mixing]
job = "new.toml"
synthetic_per_real = 0.5
"#;

/// A folder with the "real" set as tars (`out/real`), or as folders, or as a table with images (`real`).
fn with_tars() -> Folder {
    let folder = Folder::with_job(REAL);
    folder.write("new.toml", JOB);
    folder.succeed("generate job.toml --quiet");
    folder
}

fn with_folders() -> Folder {
    let folder = Folder::with_job(&edited(REAL, &[("[output]\n", "[output]\ncontainer = \"folder\"\n")]));
    folder.write("new.toml", JOB);
    folder.succeed("generate job.toml --quiet");
    folder
}

/// The same samples as images and labels.csv: a few of the labels' keys, and a column of the user's own.
fn with_table() -> Folder {
    let folder = with_tars();
    fs::create_dir_all(folder.path("real/images")).expect("a folder");
    let mut rows = String::from("file,operator,object,class,split,depth_mm,x_mm,y_mm,yaw_deg\n");
    for (key, members) in folder.samples("out/real") {
        let label: Value = serde_json::from_slice(&members["json"]).expect("JSON");
        folder.write(&format!("real/images/{key}.png"), &members["tactile.png"]);
        folder.write("real/background.png", &members["reference.png"]);
        let [x, y] = [0, 1].map(|k| label["pose"]["translation_mm"][k].as_f64().expect("a number"));
        rows += &format!(
            "images/{key}.png,\"Ann, {}\",{},{},{},{},{x},{y},{}\n",
            label["index"],
            label["object"]["id"].as_str().expect("text"),
            label["object"]["class"].as_str().expect("text"),
            label["split"].as_str().expect("text"),
            label["indentation_depth_mm"],
            label["pose"]["yaw_deg"],
        );
    }
    folder.write("real/labels.csv", rows);
    folder
}

/// The rows of a table in CSV by their columns.
fn rows(text: &str) -> Vec<BTreeMap<String, String>> {
    let mut reader = csv::Reader::from_reader(text.as_bytes());
    let names: Vec<String> = reader.headers().expect("a header").iter().map(str::to_owned).collect();
    let row = |record: csv::Result<csv::StringRecord>| {
        names.iter().cloned().zip(record.expect("a row").iter().map(str::to_owned)).collect()
    };
    reader.records().map(row).collect()
}

/// Labels and files of every sample in tars, by key, with the tar.
fn in_tars(folder: &Folder, root: &str) -> BTreeMap<String, (String, BTreeMap<String, Vec<u8>>)> {
    let mut samples: BTreeMap<String, (String, BTreeMap<String, Vec<u8>>)> = BTreeMap::new();
    for name in folder.files(root).into_keys().filter(|name| name.ends_with(".tar")) {
        for member in members(&folder.path(&format!("{root}/{name}"))) {
            let (key, suffix) = member.name.split_once('.').expect("a suffix");
            let sample = samples.entry(key.to_owned()).or_insert_with(|| (name.clone(), BTreeMap::new()));
            sample.1.insert(suffix.to_owned(), member.bytes);
        }
    }
    samples
}

fn label(members: &BTreeMap<String, Vec<u8>>) -> Map<String, Value> {
    serde_json::from_slice(&members["json"]).expect("JSON")
}

fn sources<'a>(labels: impl Iterator<Item = &'a str>) -> BTreeMap<String, usize> {
    let mut counts = BTreeMap::new();
    labels.for_each(|source| *counts.entry(source.to_owned()).or_default() += 1);
    counts
}

fn counts(all: [(&str, usize); 3]) -> BTreeMap<String, usize> {
    all.map(|(name, count)| (name.to_owned(), count)).into()
}

#[test]
fn a_table_keeps_its_rows_and_images_and_every_new_row_is_traced() {
    let folder = with_table();
    folder.write("augment.toml", RECIPE);
    folder.succeed("augment augment.toml --out larger --quiet");
    let before = rows(&folder.read("real/labels.csv"));
    let after = rows(&folder.read("larger/labels.csv"));
    assert_eq!(
        sources(after.iter().map(|row| row["source"].as_str())),
        counts([("real", 24), ("photometric", 36), ("synthetic", 9)])
    );
    let reals: Vec<_> = after.iter().filter(|row| row["source"] == "real").collect();
    for (was, is) in before.iter().zip(&reals) {
        assert!(was.iter().all(|(column, value)| is[column] == *value), "{was:?}\n{is:?}");
        assert_eq!((is["source_key"].as_str(), is["augmentation"].as_str()), (was["file"].as_str(), "{}"));
        let name = &was["file"];
        assert_eq!(folder.read_bytes(&format!("larger/{name}")), folder.read_bytes(&format!("real/{name}")));
    }
    let of_real: BTreeMap<&str, _> = reals.iter().map(|row| (row["file"].as_str(), row)).collect();
    for row in &after {
        let image = folder.read_bytes(&format!("larger/{}", row["file"]));
        assert!(image.starts_with(b"\x89PNG"), "{}", row["file"]);
        match row["source"].as_str() {
            "photometric" => {
                let real = of_real[row["source_key"].as_str()];
                for column in ["operator", "object", "class", "split", "depth_mm", "x_mm", "y_mm", "yaw_deg"] {
                    assert_eq!(row[column], real[column], "{column}");
                }
                let done: Value = serde_json::from_str(&row["augmentation"]).expect("JSON");
                assert!(done["exposure_ev"].as_f64().expect("a number").abs() <= 0.5);
            }
            "synthetic" => {
                assert_eq!((row["operator"].as_str(), row["source_key"].as_str()), ("", row["file"].as_str()));
                assert!(["cube", "pointed"].contains(&row["class"].as_str()), "{row:?}");
                let depth: f64 = row["depth_mm"].parse().expect("a number");
                assert!((0.2..=1.2).contains(&depth));
                let x: f64 = row["x_mm"].parse().expect("a number");
                assert!(x.abs() <= 6.0);
            }
            _ => {}
        }
    }
    // Half as many synthetic samples as real ones, for training alone.
    let of = |split: &str, source: &str| after.iter().filter(|r| r["split"] == split && r["source"] == source).count();
    assert_eq!([of("train", "synthetic"), of("test", "synthetic")], [9, 0]);
    let summary: Value = serde_json::from_str(&folder.read("larger/augment.json")).expect("JSON");
    assert_eq!((&summary["samples"], &summary["sources"]["photometric"]), (&Value::from(69), &Value::from(36)));
    let options = roxmltree::ParsingOptions { allow_dtd: true, ..Default::default() };
    let page = folder.read("larger/report.html");
    roxmltree::Document::parse_with_options(&closed_tags(&page), options).expect("well-formed");
    assert!(page.contains("<td>photometric</td>") || page.contains("photometric</span>"), "{page}");
}

#[test]
fn the_bytes_depend_on_the_seed_and_not_on_the_threads() {
    let folder = with_table();
    folder.write("augment.toml", format!("{RECIPE}[output]\npath = \"one\"\n"));
    folder.succeed("augment augment.toml --threads 1 --quiet");
    folder.succeed("augment augment.toml --out four --threads 4 --quiet");
    folder.succeed("augment augment.toml --out other --seed 8 --quiet");
    assert_same_files(&folder.files("one"), &folder.files("four"));
    assert_ne!(folder.read("one/labels.csv"), folder.read("other/labels.csv"));
    let mut check = std::process::Command::new("sha256sum");
    check.args(["--quiet", "-c", "files.sha256"]).current_dir(folder.path("one"));
    assert!(check.status().expect("sha256sum").success());
}

#[test]
fn tars_stay_tars_with_every_file_of_a_real_sample_as_it_was() {
    let folder = with_tars();
    folder.write("augment.toml", edited(RECIPE, &[("\"real\"", "\"out/real\"")]));
    folder.succeed("augment augment.toml --out larger --quiet");
    let (before, after) = (in_tars(&folder, "out/real"), in_tars(&folder, "larger"));
    let labels: BTreeMap<&String, Map<String, Value>> = after.iter().map(|(key, (_, m))| (key, label(m))).collect();
    assert_eq!(
        sources(labels.values().map(|label| label["source"].as_str().expect("text"))),
        counts([("real", 24), ("photometric", 36), ("synthetic", 9)])
    );
    for (key, (tar, files)) in &before {
        let (there, now) = &after[key];
        assert_eq!(tar, there);
        assert_eq!(files.keys().collect::<Vec<_>>(), now.keys().collect::<Vec<_>>());
        for (suffix, bytes) in files.iter().filter(|(suffix, _)| *suffix != "json") {
            assert!(*bytes == now[suffix], "{key}.{suffix}");
        }
        let text = String::from_utf8(files["json"].clone()).expect("UTF-8");
        let expected =
            format!("{},\"source\":\"real\",\"source_key\":\"\",\"augmentation\":\"\"}}", &text[..text.len() - 1]);
        assert_eq!(String::from_utf8_lossy(&now["json"]), expected);
    }
    let keys: Vec<&String> = labels.values().next().expect("a label").keys().collect();
    for (key, label) in &labels {
        assert_eq!(label.keys().collect::<Vec<_>>(), keys, "{key}");
        let (tar, files) = &after[*key];
        let split = label["split"].as_str().expect("text");
        assert!(tar.starts_with(&format!("data/{split}-")), "{key} in {tar} is of {split}");
        if label["source"] == "synthetic" {
            assert_eq!(files.keys().collect::<Vec<_>>(), ["depth.exr", "json", "tactile.png"]);
            assert_eq!((label["key"].as_str(), &label["sensor"]["width_px"]), (Some(key.as_str()), &Value::from(48)));
        }
        if label["source"] == "photometric" {
            let real = &after[label["source_key"].as_str().expect("text")];
            assert_eq!(real.0, *tar);
            assert_eq!(real.1["depth.exr"], files["depth.exr"]);
        }
    }
}

#[test]
fn an_imagefolder_stays_one_with_the_files_that_its_rows_name() {
    let folder = with_folders();
    folder.write("augment.toml", edited(RECIPE, &[("\"real\"", "\"out/real\"")]));
    folder.succeed("augment augment.toml --out larger --quiet");
    let (before, after) = (folder.files("out/real/data"), folder.files("larger/data"));
    for (name, bytes) in &before {
        let kept = name.ends_with("tactile.png") || name.ends_with("depth.exr") || name.ends_with("reference.png");
        assert!(!kept || after[name] == *bytes, "{name}");
    }
    let mut all = Vec::new();
    for (name, bytes) in after.iter().filter(|(name, _)| name.ends_with("metadata.jsonl")) {
        let unit = Path::new(name).parent().expect("a folder").to_str().expect("UTF-8");
        for line in String::from_utf8_lossy(bytes).lines() {
            let row: Map<String, Value> = serde_json::from_str(line).expect("JSON");
            assert!(unit.starts_with(row["split"].as_str().expect("text")), "{unit}: {line}");
            let image = format!("{unit}/{}", row["file_name"].as_str().expect("text"));
            assert!(after[&image].starts_with(b"\x89PNG"), "{image}");
            let depth = row["depth_path"].as_str().expect("text");
            assert!(after.contains_key(depth.strip_prefix("data/").expect("from the root")), "{depth}");
            all.push(row);
        }
    }
    assert_eq!(
        sources(all.iter().map(|row| row["source"].as_str().expect("text"))),
        counts([("real", 24), ("photometric", 36), ("synthetic", 9)])
    );
    assert!(all.iter().all(|row| row.keys().eq(all[0].keys())));
    let card = folder.read("larger/README.md");
    assert!(card.contains("split: train") && card.contains("data/train-000000/**"), "{card}");
}

#[test]
fn nested_labels_are_filled_where_they_nest_and_new_splits_of_an_imagefolder_are_folders() {
    let folder = with_tars();
    fs::create_dir(folder.path("real")).expect("a folder");
    let mut table = String::new();
    for (key, members) in folder.samples("out/real") {
        let label: Value = serde_json::from_slice(&members["json"]).expect("JSON");
        folder.write(&format!("real/{key}.png"), &members["tactile.png"]);
        let at = &label["pose"]["translation_mm"];
        table += &format!(
            "{{\"file_name\": \"{key}.png\", \"press\": {{\"depth\": {}, \"at_mm\": [{}, {}]}}, \"class\": {}, \"tags\": [\"a\"]}}\n",
            label["indentation_depth_mm"], at[0], at[1], label["object"]["class"]
        );
    }
    folder.write("real/metadata.jsonl", &table);
    let columns = "columns = { depth_mm = \"press.depth\", x_mm = \"press.at_mm.0\", y_mm = \"press.at_mm.1\" }\n\
                   [output]\nsplits = { train = 0.75, test = 0.25 }\n[[photometric]]";
    folder.write("augment.toml", edited(RECIPE, &[("[[photometric]]", columns)]));
    folder.succeed("augment augment.toml --out larger --quiet");
    let mut reals = 0;
    for split in ["train", "test"] {
        for line in folder.read(&format!("larger/{split}/metadata.jsonl")).lines() {
            let row: Map<String, Value> = serde_json::from_str(line).expect("JSON");
            let image = format!("larger/{split}/{}", row["file_name"].as_str().expect("text"));
            assert!(folder.read_bytes(&image).starts_with(b"\x89PNG"), "{image}");
            match row["source"].as_str() {
                Some("real") => {
                    reals += 1;
                    let (text, _) = line.split_once(",\"source\"").expect("a trace");
                    assert!(table.contains(&format!("{text}}}\n")), "{line}");
                }
                Some("synthetic") => {
                    assert!(row["tags"].is_null() && row["press"]["depth"].is_f64(), "{line}");
                    let at: Vec<f64> = serde_json::from_value(row["press"]["at_mm"].clone()).expect("two numbers");
                    assert!(at.len() == 2 && at[0].abs() <= 6.0 && at[1].abs() <= 4.0, "{line}");
                }
                _ => assert_eq!(row["tags"][0], "a"),
            }
        }
    }
    assert_eq!(reals, 24);
    let card = folder.read("larger/README.md");
    assert!(card.contains("- split: test") && card.contains("\"test/**\""), "{card}");
}

#[test]
fn new_splits_keep_groups_together_with_all_that_is_made_of_them() {
    let folder = with_table();
    let text = folder.read("real/labels.csv");
    let mut lines = text.lines().enumerate().map(|(k, line)| match k {
        0 => format!("{line},session\n"),
        _ => format!("{line},s{}\n", k % 8),
    });
    folder.write("real/labels.csv", lines.by_ref().collect::<String>());
    let more =
        "columns.group = \"session\"\n[output]\nsplits = { train = 0.5, val = 0.25, test = 0.25 }\n[[photometric]]";
    folder.write("augment.toml", edited(RECIPE, &[("[[photometric]]", more)]));
    folder.succeed("augment augment.toml --out larger --quiet");
    let after = rows(&folder.read("larger/labels.csv"));
    let mut of_session: BTreeMap<&str, BTreeSet<&str>> = BTreeMap::new();
    let of_file: BTreeMap<&str, &str> = after.iter().map(|row| (row["file"].as_str(), row["split"].as_str())).collect();
    for row in after.iter().filter(|row| row["source"] != "synthetic") {
        of_session.entry(&row["session"]).or_default().insert(&row["split"]);
        if row["source"] != "real" {
            assert_eq!(of_file[row["source_key"].as_str()], row["split"]);
        }
    }
    assert_eq!(of_session.len(), 8);
    assert!(of_session.values().all(|splits| splits.len() == 1), "{of_session:?}");
    let reals = |split: &str| after.iter().filter(|r| r["source"] == "real" && r["split"] == split).count();
    assert_eq!(["train", "val", "test"].map(reals), [12, 6, 6]);
}

#[test]
fn new_splits_of_tars_are_tars_of_their_own() {
    let folder = with_tars();
    let more = "[output]\nsplits = { train = 0.5, val = 0.5 }\n[[photometric]]";
    folder.write("augment.toml", edited(RECIPE, &[("\"real\"", "\"out/real\""), ("[[photometric]]", more)]));
    folder.succeed("augment augment.toml --out larger --quiet");
    let after = in_tars(&folder, "larger");
    let mut reals = BTreeMap::new();
    for (key, (tar, files)) in &after {
        let label = label(files);
        assert!(tar.starts_with(&format!("data/{}-", label["split"].as_str().expect("text"))), "{key} in {tar}");
        if label["source"] == "real" {
            *reals.entry(label["split"].as_str().expect("text").to_owned()).or_insert(0) += 1;
        } else if label["source"] == "photometric" {
            assert_eq!(after[label["source_key"].as_str().expect("text")].0, *tar);
        }
    }
    assert_eq!(reals, [(String::from("train"), 12), (String::from("val"), 12)].into());
}

#[test]
fn objects_that_are_kept_together_stay_so_with_synthetic_ones() {
    let folder = with_table();
    let more = "[output]\nsplits = { train = 0.5, test = 0.5 }\nsplit_by = \"object\"\n[[photometric]]";
    folder.write("augment.toml", edited(RECIPE, &[("[[photometric]]", more)]));
    folder.succeed("augment augment.toml --out larger --quiet");
    let mut of_object: BTreeMap<String, BTreeSet<String>> = BTreeMap::new();
    for row in rows(&folder.read("larger/labels.csv")) {
        of_object.entry(row["object"].clone()).or_default().insert(row["split"].clone());
    }
    assert_eq!(of_object.len(), 2);
    assert!(of_object.values().all(|splits| splits.len() == 1), "{of_object:?}");
}

#[test]
fn mixing_toward_classes_evens_them_out_and_toward_coverage_fills_what_is_empty() {
    let folder = with_table();
    let mixed = |toward: &str, out: &str| {
        let ratio = format!("synthetic_per_real = 4.0\nsplits = [\"train\", \"test\"]\ntoward = \"{toward}\"");
        folder.write("augment.toml", edited(RECIPE, &[("synthetic_per_real = 0.5", &ratio)]));
        folder.succeed(&format!("augment augment.toml --out {out} --quiet"));
        let summary: Value = serde_json::from_str(&folder.read(&format!("{out}/augment.json"))).expect("JSON");
        (rows(&folder.read(&format!("{out}/labels.csv"))), summary["mixing"].clone())
    };
    let count = |rows: &[BTreeMap<String, String>], class: &str, sources: &[&str]| {
        rows.iter().filter(|row| row["class"] == class && sources.contains(&row["source"].as_str())).count()
    };
    let both = ["real", "synthetic"];
    let (drawn, as_drawn) = mixed("as_drawn", "drawn");
    let reals = ["cube", "pointed"].map(|class| count(&drawn, class, &["real"]));
    assert!(reals[0] > reals[1] + 4, "{reals:?}");
    let (even, _) = mixed("classes", "even");
    let [cubes, cones] = ["cube", "pointed"].map(|class| count(&even, class, &both));
    assert!(cubes.abs_diff(cones) <= 2, "{cubes} {cones}");
    let (_, covered) = mixed("coverage", "covered");
    let share = |mixing: &Value, key: &str| mixing[key].as_f64().expect("a number");
    assert_eq!(share(&as_drawn, "coverage_before"), share(&covered, "coverage_before"));
    assert!(share(&covered, "coverage_before") < 0.3, "{covered}");
    let [drawn, filled] = [&as_drawn, &covered].map(|mixing| share(mixing, "coverage_after"));
    assert!(filled > 0.9 && filled > drawn + 0.1, "{drawn} {filled}");
}

#[test]
fn a_total_counts_everything_and_what_is_too_small_is_refused() {
    let folder = with_table();
    folder.write("augment.toml", edited(RECIPE, &[("synthetic_per_real = 0.5", "total = 100")]));
    folder.succeed("augment augment.toml --out larger --quiet");
    assert_eq!(rows(&folder.read("larger/labels.csv")).len(), 100);
    let text = folder.fail("augment augment.toml --out none --set mixing.total=50", 2);
    assert!(text.contains("there are 60 samples without any synthetic one"), "{text}");
    assert!(!folder.path("none").exists());
}

#[test]
fn every_mistake_in_file_and_labels_is_said_at_once_with_its_line_and_nothing_is_written() {
    let folder = with_table();
    let text = folder.read("real/labels.csv");
    let mut lines: Vec<String> = text.lines().map(str::to_owned).collect();
    lines[2] = lines[2].replace("images/000000001.png", "images/none.png");
    lines[4] = lines[3].clone();
    let depth = lines[6].rsplit(',').nth(3).expect("a depth").to_owned();
    lines[6] = lines[6].replace(&depth, "deep");
    lines[8] += ",more";
    folder.write("real/labels.csv", lines.join("\n"));
    folder.write("real/images/000000008.png", &folder.read_bytes("real/images/000000008.png")[..90]);
    let other = gelsim_files::png::encode_rgb(20, 10, &[7; 600]);
    folder.write("real/images/000000009.png", other);
    let wrong = edited(
        RECIPE,
        &[
            ("path = \"real\"", "path = \"real\"\ncolumns.class = \"clas\""),
            ("copies = 2", "copys = 2"),
            ("0.5\n", "-1.0\n"),
        ],
    );
    folder.write("augment.toml", wrong);
    let said = folder.fail("augment augment.toml --out larger", 2);
    for part in [
        "unknown key `copys`",
        "synthetic_per_real = -1 is out of range",
        "no column is called `clas`",
        "did you mean `class`?",
        "real/labels.csv:3:1",
        "cannot read the image images/none.png",
        "the image images/000000002.png is on line 4, too",
        "real/labels.csv:7:",
        "`depth_mm`: `deep` is no number",
        "the row has 10 cells, and there are 9 columns",
        "cannot read the image images/000000008.png: it is cut off",
        "images/000000009.png is 20x10 px, the first image 48x36 px",
    ] {
        assert!(said.contains(part), "{part}\n{said}");
    }
    let left: Vec<_> = folder.files("").into_keys().filter(|name| name.contains("larger")).collect();
    assert!(left.is_empty(), "{left:?}");
}

#[test]
fn an_output_is_replaced_only_when_asked_and_never_with_what_is_not_its_own() {
    let folder = with_table();
    folder.write("augment.toml", RECIPE);
    folder.succeed("augment augment.toml --out larger --quiet");
    let first = folder.files("larger");
    let text = folder.fail("augment augment.toml --out larger", 2);
    assert!(text.contains("--overwrite"), "{text}");
    folder.succeed("augment augment.toml --out larger --overwrite --quiet --seed 8");
    assert_ne!(first["labels.csv"], folder.files("larger")["labels.csv"]);
    folder.write("larger/notes.txt", "mine");
    let text = folder.fail("augment augment.toml --out larger --overwrite", 2);
    assert!(text.contains("notes.txt is in the output"), "{text}");
    assert_eq!(folder.read("larger/notes.txt"), "mine");
    for out in ["real", "real/larger", "real/new/larger", "."] {
        let text = folder.fail(&format!("augment augment.toml --out {out}"), 2);
        assert!(text.contains("error: "), "{text}");
    }
    assert!(!folder.path("real/larger").exists() && !folder.path("real/new").exists());
}

#[test]
fn labels_that_have_the_columns_already_need_a_prefix() {
    let folder = with_table();
    folder.write("augment.toml", RECIPE);
    folder.write("real/labels.csv", folder.read("real/labels.csv").replace("operator", "source"));
    let text = folder.fail("augment augment.toml --out larger", 2);
    assert!(text.contains("the labels have a column `source` already"), "{text}");
    folder.succeed("augment augment.toml --out larger --quiet --set output.prefix=\"gelsim_\"");
    let after = rows(&folder.read("larger/labels.csv"));
    assert!(after.iter().filter(|row| row["gelsim_source"] == "real").all(|row| row["source"].starts_with("Ann, ")));
}

#[test]
fn an_image_that_cannot_be_unpacked_ends_the_run_and_nothing_is_left_of_it() {
    let folder = with_table();
    folder.write("augment.toml", RECIPE);
    let mut image = folder.read_bytes("real/images/000000011.png");
    let middle = image.len() / 2;
    image[middle..middle + 20].fill(0x55);
    folder.write("real/images/000000011.png", image);
    let text = folder.fail("augment augment.toml --out larger", 1);
    assert!(text.contains("real/images/000000011.png: ") && text.contains("nothing was written"), "{text}");
    assert!(text.contains("put a valid image there, or remove it from the set"), "{text}");
    let left: Vec<_> = folder.files("").into_keys().filter(|name| name.contains("larger")).collect();
    assert!(left.is_empty(), "{left:?}");
}

/// The LEDs of the "real" sensor, as a recipe has them.
fn leds() -> &'static str {
    let from = REAL.find("[[sensor.led]]").expect("lamps");
    &REAL[from..REAL.find("[[object]]").expect("objects")]
}

#[test]
fn counterparts_are_made_of_samples_whose_object_is_known_and_lie_where_the_image_is_not_where_a_wrong_label_says() {
    let folder = with_table();
    let objects = "[[object]]\npath = \"cube.obj\"\n[[object]]\npath = \"cone.obj\"\n";
    let recipe = format!(
        "[input]\npath = \"real\"\nbackground = \"background.png\"\n{}{objects}[paired]\n[pose]\nanchor = \"origin\"\n",
        leds()
    );
    folder.write("augment.toml", recipe);
    let offset = |out: &str| {
        folder.succeed(&format!("augment augment.toml --out {out} --quiet"));
        let summary: Value = serde_json::from_str(&folder.read(&format!("{out}/augment.json"))).expect("JSON");
        assert_eq!((&summary["sources"]["twin"], &summary["sources"]["real"]), (&Value::from(18), &Value::from(24)));
        let x = summary["twins"]["median_offset_px"][0].as_f64().expect("a number");
        (x, rows(&folder.read(&format!("{out}/labels.csv"))))
    };
    let (right, rows_right) = offset("right");
    assert!(right.abs() < 0.5, "{right}");
    for row in rows_right.iter().filter(|row| row["source"] == "twin") {
        let done: Value = serde_json::from_str(&row["augmentation"]).expect("JSON");
        let moved = done["position_mm"][0].as_f64().expect("mm") - row["x_mm"].parse::<f64>().expect("mm");
        // 20 mm are 48 px.
        let offset = done["offset_px"][0].as_f64().expect("px");
        assert!((moved - offset * 20.0 / 48.0).abs() < 1e-9, "{done}");
        assert_eq!(row["file"], row["source_key"].replace(".png", "-twin.png"));
        assert!(folder.path(&format!("right/{}", row["file"])).is_file());
    }
    // Labels that say 2 px too far to the right.
    let shifted: String = folder
        .read("real/labels.csv")
        .lines()
        .enumerate()
        .map(|(k, line)| {
            let mut cells: Vec<String> = line.rsplitn(4, ',').map(str::to_owned).collect();
            if k > 0 {
                cells[2] = (cells[2].parse::<f64>().expect("mm") + 2.0 * 20.0 / 48.0).to_string();
            }
            cells.reverse();
            cells.join(",") + "\n"
        })
        .collect();
    folder.write("real/labels.csv", shifted);
    let (wrong, _) = offset("wrong");
    assert!((wrong - right + 2.0).abs() < 0.5, "{right} {wrong}");

    // A name that no object has, with its line.
    folder.write("real/labels.csv", folder.read("real/labels.csv").replacen(",cube,cube,", ",cubes,cube,", 1));
    let text = folder.fail("augment augment.toml --out none", 2);
    assert!(text.contains("no [[object]] is called `cubes`") && text.contains("did you mean `cube`?"), "{text}");
    assert!(text.contains("real/labels.csv:"), "{text}");
}

#[test]
fn a_quaternion_in_the_labels_turns_a_counterpart_whatever_side_faces_the_pad() {
    let any_side = [
        ("yaw_deg = [0.0, 90.0]", "face = \"any\"\nyaw_deg = [0.0, 360.0]\ntilt_deg = [0.0, 20.0]"),
        ("read_noise_levels = 1.5", "read_noise_levels = 0.0"),
    ];
    let folder = Folder::with_job(&edited(REAL, &any_side));
    folder.succeed("generate job.toml --quiet");
    let objects = "[[object]]\npath = \"cube.obj\"\n[[object]]\npath = \"cone.obj\"\n";
    folder.write(
        "augment.toml",
        format!("[input]\npath = \"out/real\"\nbackground = \"rendered\"\n{}{objects}[paired]\n", leds()),
    );
    folder.succeed("augment augment.toml --out larger --quiet");
    let mut counterparts = 0;
    for (_, members) in folder.samples("larger") {
        let label: Value = serde_json::from_slice(&members["json"]).expect("JSON");
        if label["source"] == "twin" {
            let done: Value = serde_json::from_str(label["augmentation"].as_str().expect("text")).expect("JSON");
            assert!(done["correlation"].as_f64().expect("a number") > 0.99, "{label}");
            counterparts += 1;
        }
    }
    assert_eq!(counterparts, 18);

    // Without one part the rotation is not known.
    folder.write("augment.toml", folder.read("augment.toml") + "[input.columns]\nquaternion_w = \"health.reason\"\n");
    let text = folder.fail("augment augment.toml --out none", 2);
    assert!(text.contains("24 quaternions (`pose.quaternion_xyzw.0` and others) lack a part"), "{text}");
    assert!(text.contains("write the parts that are not there (`health.reason`)"), "{text}");
}

#[test]
fn a_signal_ends_the_run_and_nothing_is_left_of_it() {
    let folder = with_table();
    folder.write("augment.toml", edited(RECIPE, &[("copies = 2", "copies = 1000")]));
    let mut child = folder.spawn("augment augment.toml --out larger --quiet");
    while !folder.path(".larger.partial").exists() {
        assert!(child.try_wait().expect("a child").is_none(), "ended before it was stopped");
        std::thread::sleep(std::time::Duration::from_millis(1));
    }
    let id = child.id().to_string();
    assert!(std::process::Command::new("kill").args(["-INT", &id]).status().expect("kill").success());
    assert_eq!(child.wait().expect("a child").code(), Some(130));
    let left: Vec<_> = folder.files("").into_keys().filter(|name| name.contains("larger")).collect();
    assert!(left.is_empty(), "{left:?}");
}

#[test]
fn a_set_of_sensors_is_refused_and_another_sensor_is_warned_of() {
    let folder = with_tars();
    folder.write("set.toml", format!("{REAL}[sensors]\ncount = 2\n"));
    folder.succeed("generate set.toml --quiet --out set");
    folder.write("augment.toml", edited(RECIPE, &[("path = \"real\"", "path = \"set\"")]));
    let said = folder.fail("augment augment.toml --out larger", 2);
    assert!(said.contains("set is a set of 2 sensors") && said.contains("path = \"set/gelsight-2014-0000\""), "{said}");
    folder.write("augment.toml", edited(RECIPE, &[("path = \"real\"", "path = \"out/real\"")]));
    let words = "the labels are of the sensor `gelsight-2014`, and new samples would be of `another`";
    assert!(!folder.succeed("augment augment.toml --out larger").contains("the labels are of the sensor"));
    folder.write("new.toml", edited(JOB, &[("[sensor]\n", "[sensor]\nname = \"another\"\n")]));
    assert!(folder.succeed("augment augment.toml --out another").contains(words));
}
