//! The page about a dataset: what it counts, that it stands alone, and what it says of what is damaged or missing.

use std::collections::BTreeMap;
use std::fs;

use roxmltree::{Document, Node, ParsingOptions};

use crate::support::{Folder, JOB, advised_arguments, closed_tags, edited, json};

/// Generates the job and writes its page; the page and what was said.
fn generate_page(folder: &Folder) -> (String, String) {
    folder.succeed("generate job.toml --quiet --out out");
    written(folder)
}

fn written(folder: &Folder) -> (String, String) {
    let said = folder.succeed("report out");
    (closed_tags(&folder.read("out/report.html")), said)
}

/// Parses the page, all of which must be well-formed, and checks that it loads nothing.
fn parsed(page: &str) -> Document<'_> {
    let options = ParsingOptions { allow_dtd: true, ..Default::default() };
    let document = Document::parse_with_options(page, options).expect("well-formed");
    for node in document.descendants() {
        assert!(!["script", "link", "iframe", "object"].contains(&node.tag_name().name()), "{node:?}");
        for attribute in node.attributes().filter(|attribute| ["src", "href"].contains(&attribute.name())) {
            // Another place of the page, or a picture in it.
            let value = attribute.value();
            let within = value.starts_with('#') && attribute.name() == "href";
            assert!(within || value.starts_with("data:image/png;base64,"), "{value}");
        }
    }
    assert!(!page.contains("url(") && !page.contains("@import"));
    // Pictures may spell anything.
    let plain: String = page.split("data:image/png;base64,").map(|part| part.trim_start_matches(is_base64)).collect();
    for nonsense in ["NaN", "inf,", "inf\"", ">inf", " inf"] {
        assert!(!plain.contains(nonsense), "{nonsense} in the page");
    }
    document
}

fn is_base64(c: char) -> bool {
    c.is_ascii_alphanumeric() || "+/=".contains(c)
}

fn text(node: Node) -> String {
    node.descendants().filter(|node| node.is_text()).filter_map(|node| node.text()).collect()
}

/// The rows of all tables, by the text of their first cell.
fn rows(document: &Document) -> BTreeMap<String, Vec<String>> {
    let rows = document.descendants().filter(|node| node.has_tag_name("tr")).map(|row| {
        let cells: Vec<String> = row.children().filter(Node::is_element).map(text).collect();
        (cells[0].clone(), cells[1..].to_vec())
    });
    rows.collect()
}

fn titles(document: &Document) -> Vec<String> {
    let figures = document.descendants().filter(|node| node.has_tag_name("svg"));
    let title = |svg: Node| svg.descendants().find(|node| node.attribute("font-weight") == Some("bold")).map(text);
    figures.filter_map(title).collect()
}

#[test]
fn the_page_counts_what_the_manifest_counts() {
    let folder = Folder::with_job(JOB);
    let (page, said) = generate_page(&folder);
    assert_eq!(said, "");
    let document = parsed(&page);
    let (rows, manifest) = (rows(&document), json(&folder, "out/dataset.json"));
    let split = |name: &str| manifest["splits"][name].to_string();
    let all = ["train", "val", "test"].map(split);
    assert_eq!(rows["all classes"], [&all[..], &[String::from("8"), String::from("100.0 %")]].concat());
    for class in manifest["classes"].as_array().expect("classes") {
        let name = class["name"].as_str().expect("a name");
        assert_eq!(rows[name][3], class["samples"].to_string(), "{name}");
        let splits: u64 = rows[name][..3].iter().map(|count| count.parse::<u64>().expect("a count")).sum();
        assert_eq!(splits.to_string(), rows[name][3]);
    }
    let labels = folder.labels("out");
    let touching = labels.values().filter(|label| label["contact"]["in_contact"] == true).count();
    assert_eq!(rows["in contact"][3], touching.to_string());
    assert_eq!(rows["fingerprint"], [manifest["fingerprint"].as_str().expect("text")]);
    let depths =
        labels.values().filter_map(|label| label["indentation_depth_mm"].as_f64()).filter(|depth| *depth > 0.0);
    let depths: Vec<f64> = depths.collect();
    let found = &rows["Indentation depth, mm"];
    assert_eq!(found[0], depths.len().to_string());
    let mean: f64 = found[3].parse().expect("a mean");
    assert!((mean - depths.iter().sum::<f64>() / depths.len() as f64).abs() < 0.005 * mean.max(0.1), "{found:?}");
    // Of all 8 samples a strip, and the tactile image large.
    assert_eq!(page.matches("data:image/png;base64,").count(), 16);
    assert!(page.contains("samples_per_shard = 3"), "the configuration");
}

#[test]
fn the_page_is_the_same_again_and_is_neither_a_stray_nor_left_behind() {
    let folder = Folder::with_job(JOB);
    generate_page(&folder);
    let page = folder.read("out/report.html");
    folder.succeed("report out --out elsewhere.html");
    assert_eq!(folder.read("elsewhere.html"), page);
    folder.gelsim("verify out").assert().success();
    let files = folder.files("out").len();
    folder.succeed("report out");
    assert_eq!((folder.read("out/report.html"), folder.files("out").len()), (page, files));
    folder.succeed("generate job.toml --quiet --out out --overwrite --seed 8");
    assert!(!folder.path("out/report.html").exists(), "it was about the other dataset");
}

#[test]
fn forces_that_no_model_knows_are_said_to_be_unknown() {
    let folder = Folder::with_job(&(String::from("gelpad = \"gaussian\"\n") + JOB));
    let (page, _) = generate_page(&folder);
    let document = parsed(&page);
    assert!(titles(&document).contains(&String::from("Normal force")));
    assert!(page.contains("the pad model knows none") && page.contains("the pad model is gaussian"));
    assert!(!rows(&document).contains_key("Normal force, N"));
}

#[test]
fn no_contact_equal_values_and_a_single_sample_make_no_empty_axes() {
    let edits = [("samples = 8", "samples = 1"), ("no_contact = 0.25", "no_contact = 1.0")];
    let lone = Folder::with_job(&edited(JOB, &edits));
    let (page, _) = generate_page(&lone);
    let document = parsed(&page);
    assert!(page.contains("no sample is in contact") && page.contains("no sample is pressed"));
    assert_eq!(rows(&document)["in contact"], ["0", "0", "0", "0", "0.0 %"]);
    let constant = ("depth_mm = { log_uniform = [0.3, 1.2] }", "depth_mm = 0.5");
    let (page, _) = generate_page(&Folder::with_job(&edited(JOB, &[constant, ("no_contact = 0.25", "")])));
    parsed(&page);
    assert!(page.contains("0.5 mm in all 8"));
}

#[test]
fn extras_are_shown_where_a_job_has_them() {
    let plain = Folder::with_job(JOB);
    let (page, _) = generate_page(&plain);
    assert!(!titles(&parsed(&page)).iter().any(|title| title.contains("Texture") || title.contains("markers")));
    let extras = "\n[texture]\namplitude_mm = [0.01, 0.05]\n[shear]\nx_mm = [-0.3, 0.3]\n[markers]\npitch_mm = 1.5\ndiameter_mm = 0.5\n";
    let folder = Folder::with_job(&(JOB.to_owned() + extras));
    let (page, _) = generate_page(&folder);
    let titles = titles(&parsed(&page));
    for title in ["Texture amplitude", "Shift in the pad's plane", "Shear force", "Mean motion of markers"] {
        assert!(titles.iter().any(|found| found == title), "{title} in {titles:?}");
    }
}

#[test]
fn what_is_damaged_or_missing_is_named_and_the_rest_is_shown() {
    let folder = Folder::with_job(JOB);
    folder.succeed("generate job.toml --quiet --out out");
    let tar = folder.path("out/data/train-000000.tar");
    let bytes = fs::read(&tar).expect("a tar");
    fs::write(&tar, &bytes[..bytes.len() / 2]).expect("cut");
    fs::remove_file(folder.path("out/stats/val-000000.json")).expect("a file");
    let (page, said) = written(&folder);
    for name in ["data/train-000000.tar: has ", "stats/val-000000.json: is missing or incomplete"] {
        assert!(said.contains(&format!("warning: {name}")) && page.contains(name), "{name} in {said}");
    }
    let left: u64 = rows(&parsed(&page))["all classes"][3].parse().expect("a count");
    assert!((5..8).contains(&left), "{left}");

    for name in ["data/train-000001.tar", "stats/train-000001.json", "data/test-000000.tar", "dataset.json"] {
        fs::remove_file(folder.path(&format!("out/{name}"))).expect("a file");
    }
    let (page, said) = written(&folder);
    assert!(said.contains("not complete: 1 of 4 shards are not there: train-000001\n"), "{said}");
    assert!(said.contains("data/test-000000.tar: is missing or cannot be read"), "{said}");
    parsed(&page);

    fs::remove_dir_all(folder.path("out/data")).expect("a folder");
    fs::remove_dir_all(folder.path("out/stats")).expect("a folder");
    let (page, said) = written(&folder);
    assert!(said.contains("4 of 4 shards are not there: train-000000 to test-000000"), "{said}");
    assert_eq!(rows(&parsed(&page))["all classes"], ["0", "0", "0", "0", "-"]);
}

#[test]
fn labels_that_are_broken_or_of_other_samples_are_named() {
    let folder = Folder::with_job(JOB);
    folder.succeed("generate job.toml --quiet --out out");
    let [train, val] = ["train-000000", "val-000000"].map(|name| folder.path(&format!("out/data/{name}.tar")));
    let mut bytes = fs::read(&train).expect("a tar");
    let at = bytes.windows(16).position(|window| window == b"\"schema_version\"").expect("a label");
    bytes[at] = b'!';
    fs::write(&train, bytes).expect("a file");
    fs::copy(folder.path("out/data/test-000000.tar"), &val).expect("a copy");
    let (page, said) = written(&folder);
    parsed(&page);
    assert!(said.contains("train-000000.tar: 00000000") && said.contains(".json: key must be a string"), "{said}");
    assert!(said.contains("val-000000.tar: has 2 samples where others belong"), "{said}");
}

#[test]
fn folders_and_names_that_will_not_do_are_refused_before_anything_is_written() {
    let folder = Folder::with_job(JOB);
    fs::create_dir(folder.path("empty")).expect("a folder");
    let text = folder.fail("report empty", 2);
    assert!(text.contains("empty is no dataset: there is no job.toml in it"), "{text}");
    assert!(!folder.path("empty/report.html").exists());
    folder.succeed("generate job.toml --quiet --out out");
    for name in ["out/dataset.json", "page", "out"] {
        let before = folder.files("out");
        let text = folder.fail(&format!("report out --out {name}"), 2);
        assert!(text.contains(".html"), "{text}");
        assert!(folder.files("out") == before);
    }
    folder.write("out/dataset.json", r#"{ "manifest_version": 99, "generator": { "version": "9.1.0" } }"#);
    let text = folder.fail("report out", 2);
    assert!(text.contains("dataset.json was written by gelsim 9.1.0"), "{text}");
    let text = folder.fail("report out --out missing/page.html", 2);
    assert!(text.contains("there is no folder missing") && text.contains("mkdir -p missing"), "{text}");
}

#[test]
fn the_page_goes_where_the_remedy_says() {
    let folder = Folder::with_job(JOB);
    folder.succeed("generate job.toml --quiet --out out");
    fs::create_dir(folder.path("d.html")).expect("a folder");
    let text = folder.fail("report out --out d.html", 2);
    assert!(text.contains("d.html is a folder"), "{text}");
    folder.succeed(&format!("report out {}", advised_arguments(&text, "name a file in it: ")));
    assert!(folder.path("d.html/report.html").is_file());
    let text = folder.fail("report out --out page.txt", 2);
    folder.succeed(&format!("report out {}", advised_arguments(&text, "name such a file: ")));
    assert!(folder.path("report.html").is_file());
    let text = folder.fail("report out --out s3://bucket/page.html", 2);
    assert!(text.contains("is in an object store"), "{text}");
}

#[test]
fn warnings_end_with_the_command_that_mends_or_says_more() {
    let folder = Folder::with_job(JOB);
    folder.succeed("generate job.toml --quiet --out out");
    fs::remove_file(folder.path("out/dataset.json")).expect("a file");
    let said = folder.succeed("report out");
    assert!(said.starts_with("warning: dataset.json: is missing or incomplete\n"), "{said}");
    folder.succeed(advised_arguments(&said, "fix it with gelsim "));
    assert_eq!(folder.succeed("report out"), "");

    for name in ["data/train-000001.tar", "stats/train-000001.json", "dataset.json"] {
        fs::remove_file(folder.path(&format!("out/{name}"))).expect("a file");
    }
    let said = folder.succeed("report out");
    assert!(said.contains("1 of 4 shards are not there: train-000001"), "{said}");
    folder.succeed(advised_arguments(&said, "fix it with gelsim "));
    assert_eq!(folder.succeed("report out"), "");

    // A tar alone is gone: nothing says that all shards are there.
    fs::remove_file(folder.path("out/data/train-000001.tar")).expect("a file");
    fs::remove_file(folder.path("out/dataset.json")).expect("a file");
    let said = folder.succeed("report out");
    assert!(!said.contains("all shards are there") && said.contains("train-000001.tar: is missing"), "{said}");
    let verify = advised_arguments(&said, "warning: gelsim ").split_once(" names").expect("what it does").0;
    let found = folder.gelsim(verify).assert().code(1);
    let found = String::from_utf8_lossy(&found.get_output().stdout).into_owned();
    folder.succeed(advised_arguments(&found, "  gelsim "));
    assert_eq!(folder.succeed("report out"), "");
}

#[test]
fn one_cause_in_many_files_is_one_warning() {
    let folder = Folder::with_job(&edited(JOB, &[("samples_per_shard = 3", "samples_per_shard = 1")]));
    folder.succeed("generate job.toml --quiet --out out");
    fs::remove_dir_all(folder.path("out/stats")).expect("a folder");
    let (page, said) = written(&folder);
    assert_eq!(said.lines().count(), 2, "{said}");
    let first = "warning: stats/train-000000.json, stats/train-000001.json, stats/train-000002.json and 5 more: each is missing";
    assert!(said.starts_with(first) && page.contains("and 5 more"), "{said}");
}

#[test]
fn names_are_written_as_they_are_and_the_depth_of_white_is_said() {
    let name = "[[object]]\npath = \"cube.obj\"\nclass = \"hex nut \u{7403}\"";
    let folder = Folder::with_job(&edited(JOB, &[("[[object]]\npath = \"cube.obj\"", name)]));
    let (page, _) = generate_page(&folder);
    let document = parsed(&page);
    let captions: Vec<String> =
        document.descendants().filter(|node| node.has_tag_name("figcaption")).map(text).collect();
    assert!(captions.iter().any(|caption| caption.contains("hex nut \u{7403} ")), "{captions:?}");
    assert!(page.contains("depth (black at 0, white at 1.") && page.contains("contact (white)"), "one scale");
}

#[test]
fn sequences_have_their_times_and_those_of_grippers_the_forces_of_both_fingers() {
    let press = ("[indentation]\ndepth_mm = { log_uniform = [0.3, 1.2] }\nno_contact = 0.25\n", "");
    let lift = "\n[gripper]\n[sequence]\nframe_rate_hz = 10.0\nfriction = { coefficient = 0.5 }\n\
                [[sequence.phase]]\nname = \"close\"\nduration_s = 0.3\nsqueeze_mm = 0.8\n\
                [[sequence.phase]]\nname = \"lift\"\nduration_s = 0.4\ny_mm = 1.0\n";
    let folder = Folder::with_job(&(edited(JOB, &[press]) + lift));
    folder.succeed("generate job.toml --quiet --out out --samples 2");
    let (page, _) = written(&folder);
    let document = parsed(&page);
    assert!(page.contains("above the left finger, below the right one"));
    assert!(page.contains("close 0.1, 0.2, 0.3 s; lift 0.4, 0.5, 0.7 s"), "times of frames");
    let titles = titles(&document);
    for title in ["Largest normal force", "Friction coefficient"] {
        assert!(titles.iter().any(|found| found == title), "{title} in {titles:?}");
    }
    assert_eq!(titles.iter().filter(|title| title.ends_with(", left")).count(), 2, "{titles:?}");
    assert_eq!(titles.iter().filter(|title| title.ends_with(", right")).count(), 2, "{titles:?}");
    assert!(page.contains("n 4 fingers") && page.contains("14 frames in all"));
}
