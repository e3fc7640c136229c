//! Odd names of meshes, classes and datasets: as they are in JSON, harmless in tars and cards, never a way out of the
//! output folder.

use std::collections::BTreeSet;
use std::ffi::OsStr;
use std::fs;
use std::os::unix::ffi::OsStrExt;

use super::rig::with_undisturbed;
use crate::support::{Folder, JOB, assert_same_files, edited, json, members};

/// 255 bytes together with the ending.
fn longest() -> String {
    "ü".repeat(125) + "x"
}

fn odd_stems() -> Vec<String> {
    let odd = [
        "a b",
        " ",
        "ümläut",
        "new\nline",
        "tab\tcr\r",
        "quo\"te's",
        "back\\slash",
        "-rf",
        "--out",
        "# hash: colon, - dash",
        "[br]",
        "{x}",
        "*",
        "?",
        "a|b`c<d>&amp;",
        "%00%2e",
        "\u{1b}[31mred",
        "\u{202e}rtl",
        "line\u{2028}separator",
        "💥",
        "CON",
        "README",
        "train-000000",
        "...",
        "trailing.",
        ".hidden",
        "$(touch pwned)",
        "; touch pwned",
        "~",
    ];
    odd.into_iter().map(String::from).chain([longest()]).collect()
}

/// A job in which each of these meshes and classes has one sample.
fn job(objects: &[(String, Option<String>)]) -> String {
    let mut job: toml::Table = JOB.parse().expect("TOML");
    let dataset = job["dataset"].as_table_mut().expect("a table");
    dataset.insert("samples".into(), toml::Value::Integer(objects.len() as i64));
    dataset.insert("object_order".into(), "in_turn".into());
    dataset["splits"] = toml::Table::from_iter([("train".to_owned(), 1.0.into())]).into();
    let entries = objects.iter().map(|(path, class)| {
        let class = class.iter().map(|class| (String::from("class"), class.clone().into()));
        toml::Value::from(toml::Table::from_iter(class.chain([(String::from("path"), path.clone().into())])))
    });
    job.insert("object".into(), toml::Value::Array(entries.collect()));
    job.to_string()
}

/// The dataset `out` holds these classes, each in one label; nothing in its files was led astray by them.
fn assert_safe(folder: &Folder, classes: &[String]) {
    let expected: BTreeSet<&str> = classes.iter().map(String::as_str).collect();
    let manifest = json(folder, "out/dataset.json");
    let listed = manifest["classes"].as_array().expect("a list").iter().map(|class| class["name"].as_str());
    assert_eq!(listed.map(|name| name.expect("a name")).collect::<BTreeSet<_>>(), expected);
    let labels = folder.labels("out");
    let labelled: BTreeSet<&str> = labels.values().map(|label| label["object"]["class"].as_str().unwrap()).collect();
    assert_eq!(labelled, expected);
    for (file, _) in folder.files("out/data") {
        for member in members(&folder.path(&format!("out/data/{file}"))) {
            let (key, suffix) = member.name.split_once('.').expect("a suffix");
            assert!(key.bytes().all(|byte| byte.is_ascii_digit()), "{}", member.name);
            assert!(["tactile.png", "depth.exr", "contact.png", "json"].contains(&suffix), "{}", member.name);
        }
    }
    let wids = json(folder, "out/wids.json");
    let shards = wids["shardlist"].as_array().expect("a list");
    assert!(shards.iter().all(|shard| folder.path("out").join(shard["url"].as_str().expect("a path")).is_file()));
    assert_card(&folder.read("out/README.md"), classes.len());
}

/// The card's front matter is of keys only, its table of classes has a row for each, of two cells.
fn assert_card(card: &str, classes: usize) {
    let (front, body) = card.strip_prefix("---\n").and_then(|card| card.split_once("\n---\n")).expect("front matter");
    for line in front.lines() {
        let key = line.trim_start_matches([' ', '-', '{']).split(':').next().unwrap_or_default();
        let plain = |c: char| c.is_ascii_alphanumeric() || matches!(c, '_' | '.');
        assert!(key.chars().all(plain), "{line:?}");
    }
    let table = body.split_once("| class | samples |\n|---|---|\n").expect("a table").1;
    let rows: Vec<&str> = table.split('\n').take_while(|line| !line.is_empty()).collect();
    assert_eq!(rows.len(), classes, "{rows:#?}");
    for row in rows {
        let cells = row.replace("\\\\", "").replace("\\|", "").matches('|').count();
        assert_eq!(cells, 3, "{row:?}");
        assert!(!row.contains(|c: char| c.is_control()) && !row.replace("\\<", "").contains('<'), "{row:?}");
    }
}

/// All that is beside the dataset.
fn listing(folder: &Folder) -> BTreeSet<String> {
    folder.files("").into_keys().filter(|name| !name.starts_with("out/")).collect()
}

#[test]
fn meshes_of_odd_names_are_objects_of_these_names() {
    let folder = Folder::new();
    let stems = odd_stems();
    let objects: Vec<(String, Option<String>)> = stems.iter().map(|stem| (format!("{stem}.obj"), None)).collect();
    for (path, _) in &objects {
        fs::copy(folder.path("cube.obj"), folder.path(path)).unwrap_or_else(|error| panic!("{path:?}: {error}"));
    }
    folder.write("job.toml", job(&objects));
    let before = listing(&folder);
    folder.succeed("generate job.toml --quiet --out out --shards 0..1");
    folder.succeed("generate job.toml --quiet --out out");
    assert_eq!(listing(&folder), before);
    assert_safe(&folder, &stems);
    let labels = folder.labels("out");
    let ids: BTreeSet<String> = labels.values().map(|label| label["object"]["id"].as_str().unwrap().into()).collect();
    assert_eq!(ids, stems.iter().cloned().collect());
    // What the dataset says about its job finds all of them again.
    folder.succeed("generate out/job.toml --quiet --out again");
    assert_same_files(&folder.files("out/data"), &folder.files("again/data"));
    // A pattern finds them too, and the two that are there anyway; `*.obj` would be the mesh of that name.
    folder.write("all.toml", job(&[(String::from("*.ob[j]"), None)]));
    folder.succeed(&format!("generate all.toml --quiet --out all --samples {}", stems.len() + 2));
    let count = json(&folder, "all/dataset.json")["objects"].as_array().expect("a list").len();
    assert_eq!(count, stems.len() + 2);
    println!("{} odd names of meshes", stems.len());
}

#[test]
fn classes_of_odd_names_stay_words_in_labels() {
    let mut classes = odd_stems();
    let ways_out =
        ["../../escape", "/etc/passwd", "..", ".", "---", "a\0b", "data/train-000000.tar", "null", "<script>"];
    classes.extend(ways_out.map(String::from));
    classes.push("y".repeat(255));
    let objects: Vec<_> = classes.iter().map(|class| (String::from("cube.obj"), Some(class.clone()))).collect();
    // The sensor's name is in the card too.
    let sensor = toml::Value::from("an `odd`\n---\n| name |\u{85}").to_string();
    let folder = Folder::with_job(&edited(&job(&objects), &[("[sensor]\n", &format!("[sensor]\nname = {sensor}\n"))]));
    let before = listing(&folder);
    folder.succeed("generate job.toml --quiet --out out");
    folder.succeed("generate job.toml --quiet --out out");
    assert_eq!(listing(&folder), before);
    assert_safe(&folder, &classes);
    assert!(folder.read("out/README.md").contains("presses on a `an 'odd' --- | name | ` tactile sensor ("));
    println!("{} odd names of classes", classes.len());
}

#[test]
fn names_of_meshes_that_are_not_utf_8_are_refused() {
    let folder = with_undisturbed(JOB);
    let odd = OsStr::from_bytes(b"b\xffd.obj");
    fs::create_dir(folder.path("meshes")).expect("a folder");
    for name in [odd, OsStr::new("good.obj")] {
        fs::copy(folder.path("cube.obj"), folder.path("meshes").join(name)).expect("a mesh");
    }
    // A pattern must not pass it over in silence.
    folder.write("job.toml", edited(JOB, &[("\"cube.obj\"", "\"meshes/*.obj\"")]));
    let text = folder.fail("generate job.toml --out out", 2);
    assert!(text.contains("is not UTF-8, so that no job can hold it") && text.contains("meshes/b"), "{text}");
    fs::remove_file(folder.path("meshes").join(odd)).expect("a mesh");
    folder.succeed("generate job.toml --quiet --out out");
    // Nor may the job be in such a folder, whose meshes are named by their full paths.
    let home = folder.path("").join(OsStr::from_bytes(b"h\xff"));
    fs::create_dir(&home).expect("a folder");
    for name in ["job.toml", "cone.obj"] {
        fs::copy(folder.path(name), home.join(name)).expect("a file");
    }
    let mut command = folder.gelsim("generate");
    let output = command.arg(home.join("job.toml")).args(["--out", "other"]).output().expect("it runs");
    assert_eq!(output.status.code(), Some(2));
    assert!(String::from_utf8_lossy(&output.stderr).contains("is not UTF-8, so that no job can hold it"));
    assert!(!folder.path("other").exists());
}

#[test]
fn names_of_datasets_are_plain_or_refused() {
    let folder = Folder::with_job(JOB);
    let before = listing(&folder);
    let long = "x".repeat(101);
    let ways_out = ["..", ".", "../x", "/tmp/x", "a/b", "a\nb", "a\0b", "", "ä", "a b", ".hidden", "💥", "a:b", &long];
    for name in ways_out {
        folder.write("odd.toml", job_called(name));
        let text = folder.fail("generate odd.toml", 2);
        assert!(text.contains("cannot be the name of a dataset"), "{name:?}: {text}");
    }
    fs::remove_file(folder.path("odd.toml")).expect("a job");
    assert_eq!(listing(&folder), before, "nothing was written");
    let long = "x".repeat(100);
    for name in ["README.md", "CON", "-lead", "--", "trailing.", "1.0", "null", "---", "job.toml", &long] {
        folder.write("job.toml", job_called(name));
        folder.succeed("generate job.toml --quiet");
        let card = folder.read(&format!("out/{name}/README.md"));
        assert!(card.contains(&format!("\npretty_name: \"{name}\"\n")), "{card}");
        assert_eq!(json(&folder, &format!("out/{name}/dataset.json"))["name"], name);
    }
    assert_eq!(listing(&folder), before, "only in out/");
}

fn job_called(name: &str) -> String {
    edited(JOB, &[("\"small\"", &toml::Value::from(name).to_string())])
}
