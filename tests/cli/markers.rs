//! Printed dots as their owners know them: counted, shifted, with some missing, or measured one by one in a file.

use std::fmt::Write;

use image::RgbImage;

use crate::support::{Folder, JOB, assert_same_files, edited};

/// `JOB` on a sensor of its own, with a print that is sheared.
fn job(markers: &str) -> String {
    let tables = format!("[shear]\nx_mm = [-0.3, 0.3]\n[markers]\n{markers}\n[output]");
    edited(JOB, &[("[output]", tables.as_str()), ("\"contact\"]", "\"contact\", \"markers\", \"reference\"]")])
}

/// A table of these dots.
fn table(places: impl IntoIterator<Item = [f64; 2]>) -> String {
    places.into_iter().fold(String::from("x_mm,y_mm\n"), |mut text, [x, y]| {
        writeln!(text, "{x},{y}").expect("written");
        text
    })
}

/// An irregular pattern in the view of 20 x 15 mm, as no grid makes it.
fn irregular() -> String {
    let at = |k: u32| [f64::from(k * 37 % 190) / 10.0 - 9.5, f64::from(k * 53 % 140) / 10.0 - 7.0];
    table((0..60).map(at))
}

#[test]
fn a_file_with_the_places_of_a_grid_makes_the_bytes_of_that_grid() {
    let (columns, rows) = (-7..=7, -5..=5);
    let places = rows.flat_map(|row| columns.clone().map(move |column| [column, row].map(|k| f64::from(k) * 1.5)));
    let grids = [
        "pitch_mm = 1.5\njitter_mm = 0.0",
        "pitch_mm = 1.5\npitch_y_mm = 1.5\njitter_mm = 0.0\nrows = 11\ncolumns = 15",
        "file = \"dots.csv\"",
    ];
    let made = grids.map(|markers| {
        let folder = Folder::with_job(&job(markers));
        folder.write("dots.csv", table(places.clone()));
        folder.succeed("generate job.toml --quiet --out a");
        folder.files("a/data")
    });
    assert_same_files(&made[0], &made[1]);
    assert_same_files(&made[0], &made[2]);
    // The jitter of a counted grid is that of the grid that covers the view, too.
    let jittered = ["", "rows = 11\ncolumns = 15"].map(|markers| {
        let folder = Folder::with_job(&job(&format!("jitter_mm = [0.1, 0.3]\n{markers}")));
        folder.succeed("generate job.toml --quiet --out a");
        folder.files("a/data")
    });
    assert_same_files(&jittered[0], &jittered[1]);
    assert!(jittered[0] != made[0]);
}

#[test]
fn dots_darken_the_pad_where_they_are_said_to_be_and_nowhere_else() {
    let untouched = |markers: &str| {
        let sized =
            [("[48, 36]", "[200, 150]"), ("samples = 8", "samples = 1"), ("no_contact = 0.25", "no_contact = 1.0")];
        let folder = Folder::with_job(&edited(&job(&format!("jitter_mm = 0.0\nedge_mm = 0.0\n{markers}")), &sized));
        folder.write("dots.csv", "name,x_mm,diameter_mm,y_mm\na,-3.05,1.2,2\nb,4.5,,-1.25\nc,-12,0.5,0\n");
        folder.succeed("generate job.toml --quiet --out a");
        let files = folder.samples("a").into_values().next().expect("a sample");
        let image = image::load_from_memory(&files["tactile.png"]).expect("a picture").to_rgb8();
        let positions: serde_json::Value = serde_json::from_slice(&files["markers.json"]).expect("JSON");
        let rest: Vec<[f64; 2]> = serde_json::from_value(positions["rest_px"].clone()).expect("places");
        (image, rest)
    };
    let (plain, none): (RgbImage, _) = untouched("diameter_mm = 0.0");
    assert!(none.is_empty());
    let grid = |columns: &[f64], rows: &[f64]| {
        rows.iter().flat_map(|y| columns.iter().map(|x| ([*x, *y], 0.8))).collect::<Vec<_>>()
    };
    let mut with_gaps = grid(&[-2.0, 0.0, 2.0, 4.0], &[-3.5, -0.5, 2.5]);
    with_gaps.remove(11);
    with_gaps.remove(1);
    let shifted = grid(&[-9.5, -5.5, -1.5, 2.5, 6.5], &[-6.75, -3.75, -0.75, 2.25, 5.25]);
    for (markers, dots) in [
        (
            "rows = 3\ncolumns = 4\npitch_mm = 2.0\npitch_y_mm = 3.0\noffset_mm = [1.0, -0.5]\nmissing = [[2, 3], [0, 1]]\n\
             diameter_mm = 0.8",
            with_gaps,
        ),
        ("pitch_mm = 4.0\npitch_y_mm = 3.0\noffset_mm = [10.5, 5.25]\ndiameter_mm = 0.8", shifted),
        ("file = \"dots.csv\"\ndiameter_mm = 0.6", vec![([-3.05, 2.0], 1.2), ([4.5, -1.25], 0.6)]),
        ("file = \"dots.csv\"\noffset_mm = [0.5, -1.0]", vec![([-2.55, 1.0], 1.2), ([5.0, -2.25], 0.4)]),
    ] {
        let (image, rest_px) = untouched(markers);
        let expected: Vec<[f64; 2]> = dots.iter().map(|([x, y], _)| [10.0 * x + 100.0, 10.0 * y + 75.0]).collect();
        let is_near = |a: &[f64; 2], b: &[f64; 2]| (0..2).all(|k| (a[k] - b[k]).abs() < 1e-9);
        assert_eq!(rest_px.len(), expected.len(), "{markers}");
        assert!(rest_px.iter().all(|at| expected.iter().any(|other| is_near(at, other))), "{markers}: {rest_px:?}");
        for (x, y, pixel) in image.enumerate_pixels() {
            let at = [f64::from(x) / 10.0 - 9.95, f64::from(y) / 10.0 - 7.45];
            let inside =
                |([x, y], diameter_mm): &([f64; 2], f64)| diameter_mm / 2.0 - libm::hypot(at[0] - x, at[1] - y);
            let depth_mm = dots.iter().map(inside).fold(f64::NEG_INFINITY, f64::max);
            let [seen, bare] = [pixel, plain.get_pixel(x, y)].map(|pixel| pixel.0.map(f64::from));
            for k in 0..3 {
                assert!(depth_mm < 0.1 || seen[k] < 0.2 * bare[k], "{markers}: dark at {at:?}");
                assert!(depth_mm > -0.1 || seen[k] == bare[k], "{markers}: bare at {at:?}");
            }
        }
    }
}

#[test]
fn a_dataset_of_measured_dots_is_made_again_from_its_own_job_and_a_changed_file_is_refused() {
    let one = job("file = \"dots.csv\"\njitter_mm = [0.0, 0.1]\ndiameter_mm = [0.3, 0.6]");
    let grip = edited(
        &job("file = \"dots.csv\""),
        &[
            ("[shear]\nx_mm = [-0.3, 0.3]\n", ""),
            (
                "[output]",
                "[gripper]\nforce_n = 1.0\nright = { resolution_px = [48, 36], markers = { file = \"dots.csv\" } }\n[output]",
            ),
            ("[indentation]\ndepth_mm = { log_uniform = [0.3, 1.2] }\nno_contact = 0.25\n", ""),
            ("[pose]\nyaw_deg = [0.0, 360.0]\ntilt_deg = { uniform = [0.0, 8.0] }\n", "[pose]\n"),
        ],
    );
    let presets = edited(&one, &[("[sensor]", "[sensor]\npreset = [\"digit\", \"gelsight-mini\"]")]);
    for job in [one, grip, presets] {
        let folder = Folder::with_job(&job);
        folder.write("dots.csv", irregular());
        folder.succeed("generate job.toml --quiet --out a");
        folder.succeed("generate job.toml --quiet --out all --all-effects --threads 2");
        let images = |name: &str| {
            let samples = folder.samples(name).into_iter();
            let kept = |files: std::collections::BTreeMap<String, Vec<u8>>| {
                files.into_iter().filter(|(name, _)| name.ends_with("png") || name.ends_with("markers.json"))
            };
            samples.map(|(key, files)| (key, kept(files).collect::<Vec<_>>())).collect::<Vec<_>>()
        };
        assert_eq!(images("a"), images("all"), "skipping equals running");
        std::fs::create_dir(folder.path("elsewhere")).expect("made");
        folder
            .gelsim("generate ../a/job.toml --quiet --out ../b")
            .current_dir(folder.path("elsewhere"))
            .assert()
            .success();
        assert_same_files(&folder.lasting_files("a"), &folder.lasting_files("b"));
        folder.write("dots.csv", irregular() + "0.05,0.05\n");
        let said = folder.fail("generate a/job.toml --quiet --out c", 2);
        assert!(said.contains("the table of dots") && said.contains("has changed: its SHA-256 is"), "{said}");
        let said = folder.fail("generate job.toml --quiet --out a", 2);
        assert!(said.contains("holds a dataset of another job"), "{said}");
        folder.succeed("generate job.toml --quiet --out d");
        assert!(folder.files("d/data") != folder.files("a/data"));
    }
}

#[test]
fn a_job_replaces_the_grid_or_the_file_of_its_sensor_file() {
    let folder = Folder::new();
    std::fs::create_dir(folder.path("sensors")).expect("made");
    folder.write("sensors/dots.csv", irregular());
    folder.write("other.csv", table([[1.0, 2.0], [3.0, -4.0]]));
    let settled = |sensor: &str, markers: &str| {
        folder.write("sensors/own.toml", format!("preset = \"digit\"\n[markers]\n{sensor}\n"));
        folder.write("job.toml", edited(&job(markers), &[("[sensor]", "[sensor]\nfile = \"sensors/own.toml\"")]));
        folder.succeed("generate job.toml --quiet --out a --overwrite");
        let job: toml::Table = folder.read("a/job.toml").parse().expect("TOML");
        job["markers"].as_table().expect("a table").clone()
    };
    let file = |markers: &toml::Table| markers.get("file").map(|file| file.as_str().expect("a path").to_owned());
    let found = settled("file = \"dots.csv\"\ncolor = [0.3, 0.3, 0.3]", "");
    assert_eq!(file(&found).as_deref(), Some("../sensors/dots.csv"));
    let found = settled("rows = 3\ncolumns = 4\npitch_mm = 2.0\noffset_mm = [1.0, 1.0]", "file = \"other.csv\"");
    assert_eq!(file(&found).as_deref(), Some("../other.csv"));
    assert!(["rows", "columns", "pitch_mm", "offset_mm"].iter().all(|key| !found.contains_key(*key)), "{found:?}");
    assert_eq!(found["jitter_mm"].as_float(), Some(0.0), "measured places are not off by chance");
    let found = settled("file = \"dots.csv\"", "pitch_mm = 2.0");
    assert_eq!((file(&found), found["pitch_mm"].as_float()), (None, Some(2.0)));
    assert!(!found.contains_key("file_sha256"), "{found:?}");
}

#[test]
fn markers_that_contradict_themselves_and_tables_that_make_no_sense_are_refused_at_once() {
    let refused = |markers: &str, dots: &str, expected: &[&str]| {
        let folder = Folder::with_job(&job(markers));
        folder.write("dots.csv", dots);
        let said = folder.fail("generate job.toml --out a", 2);
        for words in expected {
            assert!(said.contains(words), "{words} is not in\n{said}");
        }
        assert!(!folder.path("a").exists());
    };
    let file = "file = \"dots.csv\"";
    let both = "file = \"dots.csv\"\npitch_mm = 1.5\npitch_y_mm = 1.0\nrows = 3\ncolumns = 4\nmissing = [[0, 0]]";
    let beside = ["pitch_mm", "pitch_y_mm", "rows", "columns", "missing"]
        .map(|name| format!("`{name}` describes a grid, and `file` names the places of the dots"));
    refused(both, "x_mm,y_mm\n0,0\n", &beside.each_ref().map(String::as_str));
    refused("rows = 3", "", &["`rows` without `columns`", "write columns = 7"]);
    refused("columns = 3", "", &["`columns` without `rows`"]);
    refused("missing = [[0, 0]]", "", &["`missing` names rows and columns, and the grid counts none"]);
    refused(
        "rows = 3\ncolumns = 4\nmissing = [[3, 0], [0, 1], [0, 4], [0, 1]]",
        "",
        &["no dot in row 3, column 0", "no dot in row 0, column 4", "row 0, column 1 is missing twice", "up to [2, 3]"],
    );
    refused("rows = 0\ncolumns = 2000", "", &["rows = 0 is out of range", "columns = 2000 is out of range"]);
    refused("rows = 1000\ncolumns = 1000", "", &["1000 rows of 1000 dots are 1000000", "allowed: up to 200000 dots"]);
    refused("pitch_y_mm = 0.01", "", &["pitch_y_mm may be 0.01"]);
    refused(
        "pitch_mm = 5.0\npitch_y_mm = 0.05\ndiameter_mm = 2.0",
        "",
        &["write diameter_mm = 0.95 or less", "pitch_y_mm"],
    );
    refused("offset_mm = [0.0, 2000.0]", "", &["offset_mm", "is out of range", "job.toml:"]);
    let first_line = "the first line is x_mm,y_mm, or x_mm,y_mm,diameter_mm";
    for (table, expected) in [
        (
            "x_mm,y_mm,diameter_mm\n0, a,1\n1,nan,\n2,2,-0.5\n3,3,0\n4\n5,inf,101\n",
            &[
                "dots.csv:2:3: `a` is no place of a dot in mm",
                "dots.csv:3:3: `nan` is no place",
                "dots.csv:4:5: `-0.5` is no diameter of a dot: above 0, up to 100 mm",
                "dots.csv:5:5: `0` is no diameter",
                "dots.csv:6:",
                "dots.csv:7:3: `inf` is no place",
                "dots.csv:7:7: `101` is no diameter",
                first_line,
            ] as &[&str],
        ),
        (
            "x_mm,y_mm\n1,2\n0,-0\n-0,0\n3,4\n1.0,2e0\n",
            &[
                "dots.csv:4:1: the dot at [0.0, 0.0] mm is on line 3, too: leave one of them out",
                "dots.csv:6:1: the dot at [1.0, 2.0] mm is on line 2, too",
            ],
        ),
        ("x,y\n1,2\n", &["dots.csv:1:1: the first line names no columns x_mm and y_mm", first_line]),
        ("x_mm;y_mm\n1;2\n", &["its cells are separated by `;`"]),
        ("x_mm,y_mm\n", &["the table has no dots"]),
        ("", &["the table of dots is empty"]),
    ] {
        refused(file, table, expected);
    }
    let many = table((0..10_001).map(|k| [f64::from(k % 100) / 10.0, f64::from(k / 100) / 10.0]));
    refused(file, &many, &["dots.csv:10002:1: more than 10000 dots: leave out this row and those below it"]);
    let wrong = "x_mm,y_mm\n".to_owned() + &"a,b\n".repeat(20);
    refused(file, &wrong, &["dots.csv:5:3", "32 more mistakes of these kinds"]);
    let broad = table((0..400).map(|k| [f64::from(k % 20) / 10.0, f64::from(k / 20) / 10.0]));
    refused(
        "file = \"dots.csv\"\ndiameter_mm = 20.0",
        &broad,
        &["cover the view 536 times", "allowed: up to 400 times"],
    );
    refused(
        "file = \"none.csv\"",
        "",
        &["cannot read the table of dots", "a CSV file with the columns x_mm and y_mm belongs here"],
    );
    refused(
        "file = \"dots.csv\"\nfile_sha256 = \"00\"",
        "x_mm,y_mm\n0,0\n",
        &["no SHA-256: that of the table of dots dots.csv is"],
    );
}

#[test]
fn dots_out_of_view_and_a_diameter_that_no_dot_takes_are_told() {
    let folder = Folder::with_job(&job("file = \"dots.csv\""));
    let said = |dots: &str, more: &str| {
        folder.write("dots.csv", dots);
        folder.succeed(&format!("plan job.toml --samples 1{more}"))
    };
    let note = "no printed dot is in the view";
    assert!(said("x_mm,y_mm\n11,0\n0,-8\n", "").contains(note));
    assert!(!said("x_mm,y_mm\n11,0\n0,-7\n", "").contains(note));
    let grid = "--set markers={rows=2,columns=2,offset_mm=[30,0]}";
    assert!(folder.succeed(&format!("plan job.toml --samples 1 {grid}")).contains(note));
    let unused = "`markers.diameter_mm` has no effect: the file has a diameter for every dot";
    assert!(said("x_mm,y_mm,diameter_mm\n0,0,1\n1,1,1\n", " --set markers.diameter_mm=0.5").contains(unused));
    assert!(!said("x_mm,y_mm,diameter_mm\n0,0,1\n1,1,\n", " --set markers.diameter_mm=0.5").contains(unused));
    assert!(!said("x_mm,y_mm,diameter_mm\n0,0,1\n1,1,1\n", " --set markers.diameter_mm=0.0").contains(unused));
}

#[test]
fn a_dataset_with_measured_dots_is_that_of_its_own_job() {
    let folder = Folder::with_job(&job("file = \"dots.csv\""));
    folder.write("dots.csv", "x_mm,y_mm\n0,0\n1,1\n");
    folder.succeed("generate job.toml --quiet --out out");
    folder.succeed("verify out");
    folder.succeed("finalize out");
    folder.succeed("verify out");
}
