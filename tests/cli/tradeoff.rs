//! `gelsim tradeoff`: what its files hold, that its figures are those of the samples themselves, and what it does with
//! odd jobs and wrong ones.

use std::collections::BTreeMap;
use std::fs;
use std::path::Path;

use gelsim_core::fidelity::Fidelity;
use gelsim_core::gelpad::Theory;
use gelsim_files::diagnostic::Diagnostics;
use gelsim_job::config::{self, Overrides};
use gelsim_job::plan::Plan;
use gelsim_job::sample::Sample;
use gelsim_job::sample::render;
use gelsim_lab::tradeoff::CORRECTED;
use serde_json::Value;

use crate::support::{Folder, JOB, edited, json, repository};

/// A job whose object is smooth: a sphere, always touching.
fn smooth() -> String {
    let sphere = repository().join("objects/sphere.obj");
    let cone = "\n[[object]]\npath = \"cone.obj\"\nclass = \"pointed\"\nweight = 2.0\n";
    let edits =
        [("no_contact = 0.25", ""), ("cube.obj", &sphere.to_string_lossy()), (cone, ""), ("[48, 36]", "[80, 60]")];
    edited(JOB, &edits)
}

/// The rows of a CSV by the names of its columns, in order.
fn rows(folder: &Folder, name: &str) -> Vec<BTreeMap<String, String>> {
    let text = folder.read(name);
    assert!(text.ends_with('\n') && !text.replace(CORRECTED, "").contains(['"', '\r', ' ']), "{text}");
    let mut lines = text.lines().map(|line| line.split(',').map(str::to_owned).collect::<Vec<_>>());
    let names = lines.next().expect("a line of names");
    let row = |values: Vec<String>| {
        assert_eq!(values.len(), names.len(), "{values:?}");
        names.iter().cloned().zip(values).collect()
    };
    lines.map(row).collect()
}

fn number(row: &BTreeMap<String, String>, column: &str) -> f64 {
    let text = row.get(column).unwrap_or_else(|| panic!("no column {column} in {row:?}"));
    let value = text.parse().unwrap_or_else(|_| panic!("{column} is {text:?}"));
    assert!(f64::is_finite(value), "{column} is {value}");
    value
}

/// The columns that the contract promises, but for the first and the last, and whether they are errors.
const FIGURES: [(&str, bool); 9] = [
    ("height_rms_um", true),
    ("height_max_um", true),
    ("normal_mean_deg", true),
    ("normal_p95_deg", true),
    ("image_mae", true),
    ("image_psnr_db", false),
    ("image_ssim", false),
    ("cpu_ms_median", false),
    ("cpu_ms_p95", false),
];

/// The names of the rows, in order.
fn row_names() -> Vec<&'static str> {
    let mut names = Fidelity::ALL.map(Fidelity::name).to_vec();
    names.insert(5, CORRECTED);
    names
}

/// One row per level in their order, every figure a number, the reference without numerical error, finite strain without
/// any; the rows.
fn check_rows(folder: &Folder, name: &str) -> Vec<BTreeMap<String, String>> {
    let rows = rows(folder, &format!("{name}/tradeoff.csv"));
    let names: Vec<&str> = rows.iter().map(|row| row["rung"].as_str()).collect();
    assert_eq!(names, row_names());
    let measured = rows.iter().any(|row| !row["total_height_max_um"].is_empty());
    for row in &rows {
        let reference = row["rung"] == "reference";
        for (column, is_error) in FIGURES {
            if column == "image_psnr_db" && row[column].is_empty() {
                assert_eq!(number(row, "image_mae"), 0.0, "only equal images have no PSNR: {row:?}");
                continue;
            }
            let value = number(row, column);
            assert!(value >= 0.0, "{column} is {value}");
            assert!(!reference || !is_error || row[column] == "0.0", "{column} of the reference is {value}");
        }
        assert!(!reference || row["image_psnr_db"].is_empty());
        assert!(!reference || row["image_ssim"] == "1.0");
        assert!(number(row, "cpu_ms_p95") >= number(row, "cpu_ms_median"));
        assert!(!measured || row["rung"] != "finite-strain" || row["total_rms_um"] == "0.0", "{row:?}");
        // On the front: no other row is as quick and as near and better in one.
        let deciding = if measured { "total_rms_um" } else { "height_rms_um" };
        let point = |row| (number(row, "cpu_ms_median"), number(row, deciding));
        let (ms, um) = point(row);
        let beaten = rows.iter().map(point).any(|(a, b)| a <= ms && b <= um && (a < ms || b < um));
        assert_eq!(row["pareto"], (!beaten).to_string(), "{row:?}");
    }
    let text = folder.read(&format!("{name}/tradeoff.json"));
    // NaN and infinity are null in JSON.
    let nulls = text.matches("null").count();
    let shares = ["contact_iou_mean", "contact_iou_worst"];
    let unknown =
        ["image_psnr_db", "area_error_percent", "force_error_percent", "light_error_levels"].into_iter().chain(shares);
    let known = unknown.map(|key| text.matches(&format!("\"{key}\": null")).count()).sum::<usize>();
    assert_eq!(nulls, known, "{text}");
    rows
}

#[test]
fn four_files_and_a_table_are_the_result() {
    let folder = Folder::with_job(&smooth());
    let assert = folder.gelsim("tradeoff job.toml --samples 2").assert().success();
    let output = assert.get_output();
    let said = String::from_utf8_lossy(&output.stderr);
    assert_eq!(said, "-> out/small-tradeoff\n", "messages on standard error");
    let names: Vec<String> = folder.files("out/small-tradeoff").into_keys().collect();
    assert_eq!(names, ["tradeoff.csv", "tradeoff.json", "tradeoff.png", "tradeoff.svg"]);
    let rows = check_rows(&folder, "out/small-tradeoff");

    let table = String::from_utf8(output.stdout.clone()).expect("UTF-8");
    assert!(table.starts_with("small: 2 samples; "), "{table}");
    for row in &rows {
        let cells = |line: &'_ str| -> Option<Vec<String>> {
            let cells = line.strip_prefix(&row["rung"])?.strip_prefix("  ")?;
            Some(cells.split_whitespace().map(str::to_owned).collect())
        };
        let (line, cells) = table.lines().find_map(|line| Some((line, cells(line)?))).expect("a line per level");
        assert_eq!(cells[0], format!("{:.2}", number(row, "total_rms_um")), "{line}");
        assert_eq!(cells[1], format!("{:.2}", number(row, "total_numerics_rms_um")), "{line}");
        assert_eq!(cells[4], format!("{:.3}", number(row, "height_rms_um")), "{line}");
        assert!(cells.contains(&format!("{:.2}", number(row, "cpu_ms_median"))), "{line}");
        assert_eq!(line.ends_with('*'), row["pareto"] == "true", "{line}");
    }
    let widest = table.lines().map(str::len).max();
    assert!(widest <= Some(160), "{widest:?} columns");
    assert!(table.lines().all(|line| !line.ends_with(' ')), "{table:?}");

    let svg = folder.read("out/small-tradeoff/tradeoff.svg");
    let document = roxmltree::Document::parse(&svg).expect("the SVG is XML");
    let texts: Vec<&str> = document.descendants().filter_map(|node| node.text()).collect();
    for word in row_names().into_iter().chain(["small", "sphere"]) {
        assert!(texts.iter().any(|text| text.contains(word)), "{word} in {texts:?}");
    }
    let png = image::open(folder.path("out/small-tradeoff/tradeoff.png")).expect("a PNG").into_rgb8();
    let first = png.get_pixel(0, 0);
    assert!(png.pixels().any(|pixel| pixel != first), "an empty picture");

    folder.gelsim("tradeoff job.toml --samples 1 --out quiet --quiet").assert().success().stderr("");
}

#[test]
fn errors_fall_from_level_to_level_of_linear_theory_on_a_smooth_object() {
    let folder = Folder::with_job(&smooth());
    folder.succeed("tradeoff job.toml --samples 4 --out out");
    let rows = check_rows(&folder, "out");
    for column in ["height_rms_um", "height_max_um", "normal_mean_deg", "normal_p95_deg", "image_mae"] {
        let errors: Vec<f64> = rows[..5].iter().map(|row| number(row, column)).collect();
        assert!(errors.is_sorted_by(|a, b| a > b), "{column}: {errors:?}");
    }
    for column in ["image_psnr_db", "image_ssim"] {
        let likeness: Vec<f64> = rows[..4].iter().map(|row| number(row, column)).collect();
        assert!(likeness.is_sorted_by(|a, b| a < b), "{column}: {likeness:?}");
    }
    // A blur knows no force; the others come nearer to the reference's.
    assert_eq!(rows[0]["force_error_percent"], "");
    let force: Vec<f64> = rows[1..5].iter().map(|row| number(row, "force_error_percent")).collect();
    assert!(force.is_sorted_by(|a, b| a > b) && force[3] == 0.0, "{force:?}");
}

#[test]
fn the_figures_are_those_of_the_samples_themselves() {
    let folder = Folder::with_job(&edited(JOB, &[("samples = 8", "samples = 4")]));
    folder.succeed("tradeoff job.toml --samples 4 --out out");
    let rows = check_rows(&folder, "out");
    let mut problems = Diagnostics::default();
    let written = config::read_job(&folder.path("job.toml"), &Overrides::default(), &mut problems).expect("a job");
    let plan = Plan::resolve(written, problems).unwrap_or_else(|report| panic!("{report}"));
    let samples = |level| (0..4).map(|index| render(&plan.with_fidelity(level), index)).collect::<Vec<Sample>>();
    let [exact, truth] = [Fidelity::Reference, Fidelity::FiniteStrain].map(samples);
    let without = json(&folder, "out/tradeoff.json")["without_truth"].clone();
    let without: Vec<u64> =
        without.as_array().expect("a list").iter().map(|one| one["sample"].as_u64().expect("a number")).collect();
    let all: Vec<u64> = (0..4).collect();
    let true_ones: Vec<u64> = all.iter().copied().filter(|index| !without.contains(index)).collect();
    assert!(truth.iter().any(|truth| truth.label.numerics.theory == Theory::FiniteStrain));
    for row in &rows[..4] {
        let level = Fidelity::ALL.into_iter().find(|level| level.name() == row["rung"]).expect("a level");
        let own = samples(level);
        let pairs = || own.iter().zip(&exact);
        let close = |found: f64, expected: f64| (found - expected).abs() <= 1e-9 * expected.max(1e-9);
        let heights = |exact: &[Sample], of: &[u64]| {
            let (mut squares, mut count, mut max) = (0.0, 0.0, 0.0_f64);
            for index in of {
                let [own, exact] = [&own, exact].map(|all: &[Sample]| all[*index as usize].impression.surface_mm());
                for (a, b) in own.into_iter().zip(exact) {
                    let um = 1e3 * (f64::from(a) - f64::from(b)).abs();
                    (squares, count, max) = (squares + um * um, count + 1.0, max.max(um));
                }
            }
            [f64::sqrt(squares / count), max]
        };
        for (exact, of, columns) in [
            (&exact, &all, ["height_rms_um", "height_max_um"]),
            (&truth, &true_ones, ["total_rms_um", "total_height_max_um"]),
        ] {
            for (column, um) in columns.into_iter().zip(heights(exact, of)) {
                assert!(close(number(row, column), um), "{column} is {um} in {row:?}");
            }
        }
        let model = exact.iter().filter_map(|exact| exact.label.numerics.model_error_um).sum::<f64>() / 4.0;
        assert!(model > 0.0 && close(number(row, "model_error_um"), model), "{row:?}");
        let light = own.iter().filter(|sample| sample.label.contact.in_contact);
        let light: Vec<f64> = light.filter_map(|sample| sample.label.numerics.light_error_levels).collect();
        let light = light.iter().sum::<f64>() / light.len() as f64;
        assert!(light > 0.0 && close(number(row, "light_error_levels"), light), "{row:?}");
        let levels = || {
            pairs().flat_map(|(own, exact)| {
                own.impression.image.rgb.iter().zip(&exact.impression.image.rgb).map(|(a, b)| f64::from(a.abs_diff(*b)))
            })
        };
        let count = levels().count() as f64;
        assert!(close(number(row, "image_mae"), levels().sum::<f64>() / count), "{row:?}");
        let mean_square = levels().map(|level| level * level).sum::<f64>() / count;
        assert!(close(number(row, "image_psnr_db"), 10.0 * (255.0 * 255.0 / mean_square).log10()), "{row:?}");
    }
}

#[test]
fn what_the_light_leaves_out_is_said_with_what_computes_it() {
    let folder = Folder::with_job(JOB);
    folder.succeed("tradeoff job.toml --samples 2 --out before");
    let before = json(&folder, "before/tradeoff.json");
    let rows = before["light"].as_array().expect("rows").clone();
    let levels: Vec<f64> = rows.iter().map(|row| row["levels"].as_f64().expect("a number")).collect();
    assert!(rows.len() == 4 && levels.is_sorted_by(|a, b| a >= b), "{rows:?}");
    // Every remedy together: only what no model computes is left.
    let more = "--set optics=\"led\" --set sensor.window.distance_mm=8 --set sensor.coat.albedo=0.4";
    folder.succeed(&format!("tradeoff job.toml --samples 2 --out after {more}"));
    let after = json(&folder, "after/tradeoff.json");
    let left = after["light"].as_array().expect("rows");
    assert_eq!(left.len(), 1, "{left:?}");
    let sum: f64 = levels.iter().map(|levels| levels * levels).sum::<f64>().sqrt();
    let remainder = left[0]["levels"].as_f64().expect("a number");
    assert!(left[0]["remedy"] == "" && remainder < 0.5 * sum, "{remainder} of {sum}");
}

#[test]
fn csv_and_json_say_the_same() {
    let folder = Folder::with_job(JOB);
    folder.succeed("tradeoff job.toml --samples 5 --out out");
    let rows = check_rows(&folder, "out");
    let json = json(&folder, "out/tradeoff.json");
    assert_eq!(json["job"], "small");
    assert_eq!(json["samples"].as_array().map(Vec::len), Some(5));
    let levels = json["rungs"].as_array().expect("rows");
    assert_eq!(levels.len(), rows.len());
    for (row, there) in rows.iter().zip(levels) {
        for (column, text) in row {
            // Stages are seconds in JSON.
            if let Some(seconds) = column.strip_suffix("_ms").and_then(|stage| there["seconds"][stage].as_f64()) {
                assert_eq!(text.parse().ok(), Some(1e3 * seconds), "{column}");
                continue;
            }
            let value = match column.strip_prefix("total_") {
                Some(figure) if !figure.ends_with("rms_um") => &there["total"][figure],
                _ => &there[column],
            };
            match value {
                Value::Null => assert_eq!(text, "", "{column}"),
                Value::Number(number) => assert_eq!(text.parse().ok(), number.as_f64(), "{column}"),
                Value::String(value) => assert_eq!(text, value, "{column}"),
                other => assert_eq!(*text, other.to_string(), "{column}"),
            }
        }
    }
    // Each object has all fidelity levels, and their samples are those of all.
    let objects = json["objects"].as_array().expect("objects");
    let names: Vec<&str> = objects.iter().filter_map(|object| object["object"].as_str()).collect();
    assert_eq!(names, ["cube", "cone"]);
    for object in objects {
        assert_eq!(object["rungs"].as_array().map(Vec::len), Some(rows.len()));
    }
    for k in 0..rows.len() {
        let max = |rows: &Value| rows[k]["height_max_um"].as_f64().expect("a number");
        let worst = objects.iter().map(|object| max(&object["rungs"])).fold(0.0, f64::max);
        assert_eq!(worst, max(&json["rungs"]), "the worst of all is the worst of one object");
    }
    for study in ["grids", "tolerances", "models", "left_out"] {
        assert!(json[study].as_array().is_some_and(|rows| !rows.is_empty()), "{study}");
    }
}

#[test]
fn samples_without_a_truth_are_counted_and_left_out_of_the_total_error() {
    // The second object is a plate that goes on beyond the captured window.
    let plate = "\n[[object]]\npath = \"cube.obj\"\nscale = 20.0\n\n[pose]";
    let wide = edited(&smooth(), &[("\n[pose]", plate)]);
    let folder = Folder::with_job(&wide);
    let table = printed(&folder, "tradeoff job.toml --out out");
    check_rows(&folder, "out");
    let json = json(&folder, "out/tradeoff.json");
    let without = json["without_truth"].as_array().expect("a list");
    let all = json["samples"].as_array().expect("a list").len();
    assert!(json["measured"] == true && !without.is_empty() && without.len() < all, "{without:?}");
    let line = format!("{} of {all} samples have no truth: ", without.len());
    assert!(table.contains(&line) && table.contains("the contact goes on beyond the captured window"), "{table}");

    // Finite strain knows no Coulomb friction: the theory's part of the error is what labels expect.
    let slips = "gelpad.elastic.friction={coulomb={coefficient=0.5}}";
    let table = printed(&folder, &format!("tradeoff job.toml -n 2 --set {slips} --out slips"));
    assert!(!table.contains("no truth") && table.contains("model"), "{table}");
    let rows = rows(&folder, "slips/tradeoff.csv");
    assert_eq!(rows.len(), 5);
    for row in rows {
        let together = number(&row, "height_rms_um").hypot(number(&row, "model_rms_um"));
        let total = number(&row, "total_rms_um");
        assert!((total - together).abs() < 1e-9 && row["total_height_max_um"].is_empty(), "{row:?}");
    }
}

/// The columns that hold no time.
fn errors(rows: Vec<BTreeMap<String, String>>) -> Vec<BTreeMap<String, String>> {
    let timeless = |row: BTreeMap<String, String>| {
        row.into_iter()
            .filter(|(name, _)| !name.contains("ms") || name.contains("rms"))
            .filter(|(name, _)| name != "pareto")
    };
    rows.into_iter().map(|row| timeless(row).collect()).collect()
}

#[test]
fn the_ladder_does_not_depend_on_what_the_job_chose_of_it() {
    let folder = Folder::with_job(JOB);
    let ladder = |number: &str, flags: &str| {
        folder.succeed(format!("tradeoff job.toml --samples 1 --out {number} {flags}").trim_end());
        errors(check_rows(&folder, number))
    };
    let plain = ladder("0", "");
    assert!(plain[0].contains_key("height_rms_um") && !plain[0].contains_key("cpu_ms_p95"));
    for (number, choice) in
        ["fidelity=\"paper\"", "fidelity={max_ms=0.001}", "gelpad=\"gaussian\"", "dataset.name=\"other\""]
            .into_iter()
            .enumerate()
    {
        assert_eq!(ladder(&format!("1{number}"), &format!("--set {choice}")), plain, "{choice}");
    }
    assert_ne!(ladder("2", "--seed 8"), plain, "another seed, other samples");
    assert_ne!(ladder("3", "--set indentation.depth_mm=0.8"), plain);
    let dark = ladder("4", "--set optics.phong.diffuse=0.1");
    assert_eq!(dark[1]["height_rms_um"], plain[1]["height_rms_um"]);
    assert_ne!(dark[1]["image_mae"], plain[1]["image_mae"], "the light that the job names");
}

#[test]
fn one_sample_is_enough_and_more_than_there_are_is_all_of_them() {
    let folder = Folder::with_job(&edited(JOB, &[("samples = 8", "samples = 4")]));
    folder.succeed("generate job.toml --quiet --out data");
    let depth_mm = |label: &Value| label["indentation_depth_mm"].as_f64().expect("a depth");
    let labels = folder.labels("data");
    let deepest = labels.values().max_by(|a, b| depth_mm(a).total_cmp(&depth_mm(b))).expect("samples");
    let deepest = deepest["index"].as_u64().expect("a number");
    for (count, expected) in [("1", vec![deepest]), ("4", (0..4).collect()), ("100000", (0..4).collect::<Vec<u64>>())] {
        folder.succeed(&format!("tradeoff job.toml --samples {count} --out out"));
        check_rows(&folder, "out");
        assert_eq!(json(&folder, "out/tradeoff.json")["samples"], serde_json::json!(expected));
    }
    let text = folder.fail("tradeoff job.toml --samples 0 --out none", 2);
    assert!(text.contains("write 1 or more"), "{text}");
    assert!(!folder.path("none").exists());
}

#[test]
fn a_job_that_touches_nothing_has_no_errors() {
    let folder = Folder::with_job(&edited(JOB, &[("no_contact = 0.25", "no_contact = 1.0")]));
    folder.succeed("tradeoff job.toml --samples 3 --out out");
    for row in check_rows(&folder, "out") {
        for (column, is_error) in FIGURES {
            assert!(!is_error || row[column] == "0.0", "{column} in {row:?}");
        }
        assert_eq!((row["image_psnr_db"].as_str(), row["image_ssim"].as_str()), ("", "1.0"));
        assert_eq!((row["area_error_percent"].as_str(), row["force_error_percent"].as_str()), ("", ""));
    }
}

#[test]
fn images_of_odd_sizes_are_compared_too() {
    let folder = Folder::with_job(JOB);
    for (number, size) in ["1,1", "2,1", "1,64", "7,5", "33,2"].into_iter().enumerate() {
        folder.succeed(&format!("tradeoff job.toml --samples 1 --out {number} --set sensor.resolution_px=[{size}]"));
        check_rows(&folder, &number.to_string());
    }
}

#[test]
fn a_folder_that_cannot_be_written_ends_with_status_1() {
    let folder = Folder::with_job(JOB);
    let text = folder.fail("tradeoff job.toml --samples 1 --out cube.obj/out", 1);
    assert!(text.starts_with("error: cube.obj/out: ") && text.contains("choose another folder with --out"), "{text}");
    let text = folder.fail("tradeoff job.toml --samples 1 --out s3://bucket/out", 2);
    assert!(text.contains("is in an object store") && !folder.path("s3:").exists(), "{text}");
    // A name that is taken by a folder.
    fs::create_dir_all(folder.path("out/tradeoff.json")).expect("a folder");
    let text = folder.fail("tradeoff job.toml --samples 1 --out out", 1);
    assert!(text.contains("error: out/tradeoff.json: "), "{text}");
    // What is no folder is the user's mistake, as for a dataset.
    let text = folder.fail("tradeoff job.toml --samples 1 --out cube.obj", 2);
    assert!(text.contains("error: cube.obj is not a folder"), "{text}");
}

#[test]
fn a_wrong_job_ends_with_status_2_and_writes_nothing() {
    let wrong = edited(JOB, &[("samples = 8", "samples = 0"), ("y_mm =", "y_m =")]);
    let folder = Folder::with_job(&wrong);
    let text = folder.fail("tradeoff job.toml", 2);
    assert!(text.contains("job.toml:4:11") && text.contains("unknown key `y_m`"), "both at once: {text}");
    let text = folder.fail("tradeoff job.toml --set dataset.samples=8 --set pose.y_m=1", 2);
    assert!(text.contains("unknown key `y_m`"), "{text}");
    assert!(folder.fail("tradeoff nothing.toml", 2).contains("nothing.toml: cannot read the job"));
    assert!(folder.fail("tradeoff job.toml --fidelity draft", 2).contains("unexpected argument '--fidelity'"));
    let text = folder.fail("tradeoff job.toml --finite-elements", 2);
    assert!(
        text.contains("unexpected argument '--finite-elements'") && text.contains("--fidelity finite-strain"),
        "{text}"
    );
    assert!(!folder.path("out").exists(), "nothing may be written");
}

#[test]
fn results_of_an_earlier_run_are_replaced_and_other_files_stay() {
    let folder = Folder::with_job(JOB);
    fs::create_dir(folder.path("out")).expect("a folder");
    folder.write("out/tradeoff.csv", "old");
    folder.write("out/notes.txt", "mine");
    folder.succeed("tradeoff job.toml --samples 1 --out out");
    check_rows(&folder, "out");
    assert_eq!(folder.read("out/notes.txt"), "mine");
    assert_eq!(folder.files("out").len(), 5);
    assert!(folder.files("out").into_keys().all(|name| !Path::new(&name).starts_with(".")));
}

/// Standard output of a run that succeeds.
fn printed(folder: &Folder, line: &str) -> String {
    let assert = folder.gelsim(line).assert().success();
    String::from_utf8(assert.get_output().stdout.clone()).expect("UTF-8")
}
