//! What is said about a mistake: the file, line and column, the underlined words, the way out; and that nothing is
//! written. A job in these tests carries its own answers: `«` and `»` stand around what must be underlined.

use std::collections::BTreeSet;

use crate::advice::{Diagnostic, parse_report};
use crate::support::{Folder, JOB, edited};

/// The marked places of a text (line, column, words), and the text without its marks.
fn split_marks(text: &str) -> (Vec<(usize, usize, String)>, String) {
    let mut places = Vec::new();
    let mut plain = String::new();
    for (number, line) in text.lines().enumerate() {
        let mut rest = line;
        while let Some((before, after)) = rest.split_once('«') {
            let (words, after) = after.split_once('»').expect("a mark is closed on its line");
            plain += before;
            let column = plain.chars().rev().take_while(|c| *c != '\n').count() + 1;
            places.push((number + 1, column, words.to_owned()));
            plain += words;
            rest = after;
        }
        plain += rest;
        plain.push('\n');
    }
    (places, plain)
}

/// Names of everything in a folder.
fn listing(folder: &Folder) -> BTreeSet<String> {
    folder.files("").into_keys().collect()
}

/// Runs `gelsim generate job.toml FLAGS` in `folder` and expects status 2, nothing written, and of each expected
/// problem its words in title and help.
fn refused(folder: &Folder, flags: &str, expected: &[(&str, &str)]) -> Vec<Diagnostic> {
    let before = listing(folder);
    let arguments = format!("generate job.toml {flags}");
    let text = folder.fail(arguments.trim_end(), 2);
    assert_eq!(listing(folder), before, "nothing may be written");
    assert!(!folder.path("out").exists(), "not even an empty folder");
    let problems = parse_report(&text);
    let titles: Vec<&str> = problems.iter().map(|problem| problem.title.as_str()).collect();
    assert_eq!(problems.len(), expected.len(), "{titles:#?}\n{text}");
    for (problem, (title, help)) in problems.iter().zip(expected) {
        assert!(problem.title.contains(title), "{title:?} in the title of {problem:#?}");
        assert!(problem.help.contains(help), "{help:?} in the help of {problem:#?}");
    }
    problems
}

/// The same for a marked job: the problems are the marked places, in their order, each once, and no others.
fn refused_at_marks(folder: &Folder, marked: &str, flags: &str, expected: &[(&str, &str)]) {
    let (places, job) = split_marks(marked);
    folder.write("job.toml", job);
    let problems = refused(folder, flags, expected);
    assert_places(&problems, "job.toml", &places);
}

fn assert_places(problems: &[Diagnostic], file: &str, places: &[(usize, usize, String)]) {
    assert_eq!(problems.len(), places.len());
    for (problem, (line, column, words)) in problems.iter().zip(places) {
        assert_eq!(problem.place, format!("{file}:{line}:{column}"), "{problem:#?}");
        // Where nothing stands, one caret points at the gap.
        assert!(problem.underlined == *words || words.is_empty(), "{words:?} is underlined in {problem:#?}");
    }
}

/// An edit of [`JOB`] with marks in it, and the one problem it makes.
fn one_mistake(from: &str, to: &str, title: &str, help: &str) {
    one_mistake_in(&Folder::new(), from, to, title, help);
}

fn one_mistake_in(folder: &Folder, from: &str, to: &str, title: &str, help: &str) {
    refused_at_marks(folder, &edited(JOB, &[(from, to)]), "", &[(title, help)]);
}

#[test]
fn an_unknown_key_is_shown_with_the_nearest_known_one() {
    one_mistake("yaw_deg", "«yaw_dge»", "unknown key `yaw_dge`", "did you mean `yaw_deg`?");
    one_mistake("[output]", "[«ouptut»]", "unknown key `ouptut`", "did you mean `output`?");
    one_mistake("class = ", "«klass» = ", "unknown key `klass`", "did you mean `class`?");
    one_mistake("std = 1.0", "std = 1.0, «maxi» = 9.0", "unknown key `maxi`", "did you mean `max`?");
}

#[test]
fn an_unknown_key_that_is_like_no_other_is_shown_with_all_that_are_known() {
    one_mistake(
        "no_contact = 0.25",
        "«brightness» = 1",
        "unknown key `brightness`",
        "`depth_mm`, `force_n`, `at` or `no_contact`",
    );
}

#[test]
fn a_misspelt_key_that_is_needed_is_not_reported_as_missing_too() {
    one_mistake("samples = 8", "«sampels» = 8", "unknown key `sampels`", "did you mean `samples`?");
    one_mistake("depth_mm =", "«dept_mm» =", "unknown key `dept_mm`", "did you mean `depth_mm`?");
    one_mistake("[indentation]", "[«indentaton»]", "unknown key `indentaton`", "did you mean `indentation`?");
    one_mistake("path = \"cube.obj\"", "«pth» = \"cube.obj\"", "unknown key `pth`", "did you mean `path`?");
    one_mistake("train = 0.5", "«trian» = 0.5", "unknown key `trian`", "did you mean `train`?");
    let objects = JOB.replace("[[object]]", "[[«objects»]]").replacen("[[«objects»]]\npath = \"cone.obj\"", "[z]\n", 1);
    let objects = edited(&objects, &[("[z]\n\nclass = \"pointed\"\nweight = 2.0\n", "")]);
    refused_at_marks(&Folder::new(), &objects, "", &[("unknown key `objects`", "did you mean `object`?")]);
}

#[test]
fn a_value_of_the_wrong_type_is_refused_with_the_right_one() {
    one_mistake("samples = 8", "samples = «\"8\"»", "expected a whole number from 0 up, found the text \"8\"", "");
    one_mistake("samples = 8", "samples = «8.5»", "expected a whole number from 0 up, found 8.5", "");
    one_mistake("samples = 8", "samples = «-8»", "expected a whole number from 0 up, found -8", "");
    one_mistake("weight = 2.0", "weight = «[2.0]»", "expected a number, found a list", "");
    one_mistake("no_contact = 0.25", "no_contact = «2024-01-01»", "expected a number, found a date", "");
    one_mistake("[48, 36]", "«[48]»", "2, found 1 element", "");
    one_mistake("[48, 36]", "«[48, 36, 3]»", "3 elements, where 2 belong", "");
    one_mistake("\nyaw_deg = [0.0, 360.0]", "\nyaw_deg = «true»", "expected a number, [min, max], or a table", "");
    one_mistake("layers = [\"depth\", \"contact\"]", "layers = «\"depth\"»", "expected a list, found the text", "");
}

#[test]
fn a_table_and_a_list_of_tables_are_told_apart() {
    let one_object = edited(JOB, &[("[[object]]\npath = \"cone.obj\"\nclass = \"pointed\"\nweight = 2.0\n", "")]);
    let single = edited(&one_object, &[("[[object]]", "«[object]»")]);
    refused_at_marks(&Folder::new(), &single, "", &[("expected a list, found a table", "[[object]]")]);
    let double = edited(JOB, &[("[dataset]", "«[[dataset]]»")]);
    refused_at_marks(&Folder::new(), &double, "", &[("expected a table, found a list", "")]);
}

#[test]
fn every_wrong_element_of_a_list_is_reported() {
    let layers = edited(JOB, &[("[\"depth\", \"contact\"]", "[«\"dept\"», \"contact\", «\"nromal\"»]")]);
    let expected = [("unknown choice `dept`", "did you mean `depth`"), ("unknown choice `nromal`", "`normal`")];
    refused_at_marks(&Folder::new(), &layers, "", &expected);
    let pair = edited(JOB, &[("[48, 36]", "[«\"a\"», «\"b\"»]")]);
    refused_at_marks(&Folder::new(), &pair, "", &[("found the text \"a\"", ""), ("found the text \"b\"", "")]);
}

#[test]
fn a_wrong_unit_is_refused_with_the_units_there_are() {
    one_mistake("weight = 2.0", "unit = «\"miles\"»", "unknown choice `miles`", "one of `mm`, `cm`, `m` or `in`");
    one_mistake("weight = 2.0", "unit = «\"mmm\"»", "unknown choice `mmm`", "did you mean `mm`?");
}

#[test]
fn an_unknown_choice_is_refused_with_the_ones_there_are() {
    let start = "\n[dataset]";
    one_mistake(start, "\nfidelity = «\"papr\"»\n[dataset]", "unknown choice `papr`", "did you mean `paper`?");
    one_mistake(start, "\ngelpad = «\"men_blur\"»\n[dataset]", "unknown choice `men_blur`", "`mean_blur`");
    one_mistake(start, "\ngelpad = «\"elastik\"»\n[dataset]", "unknown choice `elastik`", "did you mean `elastic`?");
    one_mistake(start, "\n[gelpad.elastic]\nresolution = «\"double\"»\n[dataset]", "`double`", "`quarter`");
    one_mistake(start, "\n[gelpad.elastic]\n«tolerance_mm» = 1.0\n[dataset]", "`tolerance_mm`", "`tolerance_um`");
    one_mistake(start, "\n[gelpad.none]\n«passes» = 1\n[dataset]", "unknown key `passes`", "");
    one_mistake(start, "\n[optics.«fong»]\n[dataset]", "unknown choice `fong`", "did you mean `phong`?");
    one_mistake("seed = 7", "split_by = «\"objects\"»", "unknown choice `objects`", "did you mean `object`?");
    one_mistake("y_mm =", "face = «\"z\"»\ny_mm =", "unknown choice `z`", "`-z`");
    one_mistake("y_mm =", "anchor = «\"bottom\"»\ny_mm =", "unknown choice `bottom`", "`contact`");
}

#[test]
fn an_unknown_distribution_is_refused_with_the_ones_there_are() {
    let to = "«tilt_deg» = { unifrom = [0.0, 8.0] }";
    let title = "unknown distribution `unifrom`: one of `uniform`, `log_uniform`, `normal` or `choice`; did you mean `uniform`?";
    // Parsed by hand: the braces are underlined, not the key.
    let marked = edited(JOB, &[("tilt_deg = { uniform = [0.0, 8.0] }", to)]);
    let (_, job) = split_marks(&marked);
    let folder = Folder::with_job(&job);
    let problems = refused(&folder, "", &[(title, "")]);
    assert_eq!(problems[0].underlined, "{ unifrom = [0.0, 8.0] }");

    one_mistake("[0.0, 360.0]", "«{ uniform = [0.0, 1.0], choice = [2.0] }»", "only one distribution at a time", "");
    one_mistake("[0.0, 360.0]", "«{}»", "one of `uniform`, `log_uniform`, `normal` or `choice` belongs here", "");
    one_mistake("mean = 0.0, std = 1.0, ", "mean = 0.0, «sd» = 1.0, ", "unknown key `sd`", "did you mean `std`?");
}

#[test]
fn a_file_that_is_not_there_is_named() {
    let missing = |written: &str, help: &str| {
        let title = format!("{written} does not exist");
        one_mistake("\"cone.obj\"", &format!("«\"{written}\"»"), &title, help);
    };
    missing("cones.obj", "did you mean cone.obj? paths are relative to the file");
    for written in ["Cone.OBJ", "cone"] {
        missing(written, "did you mean cone.obj?");
    }
    missing("teapot.obj", "paths are relative to the file");
    one_mistake("\"cone.obj\"", "«\".\"»", "is a folder", "what is in it: path = \"./*.obj\"");
    one_mistake(
        "\"cone.obj\"",
        "«\"job.toml\"»",
        "is not named like a mesh: use .obj, .stl, .ply, .off, .glb, .gltf, .dae, .3mf or .urdf",
        "",
    );
}

#[test]
fn a_path_without_a_name_is_refused() {
    for written in ["", "  "] {
        one_mistake("\"cone.obj\"", &format!("«\"{written}\"»"), "the path is empty", "name a mesh");
    }
    one_mistake("[sensor]", "[sensor]\nbackground = «\"\"»", "the path is empty", "a PNG of the untouched pad");
}

#[test]
fn a_link_to_nothing_is_not_suggested_in_its_own_place() {
    let elsewhere = Folder::new();
    std::os::unix::fs::symlink("gone.obj", elsewhere.path("dangling.obj")).expect("a link");
    for (name, title) in [("dangling.obj", "is a link to what does not exist"), ("dangling.ob", "does not exist")] {
        let to = format!("«\"{}\"»", elsewhere.path(name).display());
        let folder = Folder::new();
        refused_at_marks(&folder, &edited(JOB, &[("\"cone.obj\"", &to)]), "", &[(title, "paths are relative")]);
        assert!(!folder.fail("generate job.toml", 2).contains("did you mean"));
    }
}

#[test]
fn each_place_of_a_mistake_that_is_made_often_is_named() {
    let tables: String = (0..12).map(|i| format!("[[object]]\npath = \"missing-{i}.obj\"\n")).collect();
    let folder = Folder::with_job(&format!("{JOB}{tables}"));
    let said = folder.fail("generate job.toml", 2);
    let first = 1 + JOB.lines().count();
    for i in 0..12 {
        assert!(said.contains(&format!("missing-{i}.obj (job.toml:{}:8)", first + 1 + 2 * i)), "{said}");
    }
    assert_eq!(said.matches("error: ").count(), 1, "{said}");
}

#[test]
fn a_pattern_without_a_match_is_refused() {
    one_mistake("\"cone.obj\"", "«\"meshes/*.stl\"»", "no file matches meshes/*.stl", "relative to the file");
    one_mistake("\"cone.obj\"", "«\"a***b\"»", "not a pattern", "stand for characters");
}

#[test]
fn a_pattern_finds_its_files_also_from_a_folder_whose_name_looks_like_one() {
    let folder = Folder::new();
    std::fs::create_dir(folder.path("set[1]")).expect("a folder");
    for mesh in ["cube.obj", "cone.obj"] {
        std::fs::copy(folder.path(mesh), folder.path(&format!("set[1]/{mesh}"))).expect("a copy");
    }
    folder.write("set[1]/job.toml", edited(JOB, &[("\"cube.obj\"", "\"c?[bn]e.obj\"")]));
    folder.succeed("generate set[1]/job.toml --quiet");
    let objects = crate::support::json(&folder, "out/small/dataset.json")["objects"].clone();
    let ids: Vec<&str> = objects.as_array().expect("a list").iter().filter_map(|o| o["id"].as_str()).collect();
    assert_eq!(ids, ["cone", "cube", "cone-2"]);
}

#[test]
fn a_job_without_an_object_is_refused() {
    let without = JOB.split("[[object]]").next().expect("a beginning").to_owned() + "[indentation]\ndepth_mm = 0.5\n";
    let (_, job) = split_marks(&without);
    let problems = refused(&Folder::with_job(&job), "", &[("the job has no object", "[[object]]")]);
    assert_eq!(problems[0].place, "job.toml:1:1");
    let empty = format!("object = «[]»\n{without}");
    refused_at_marks(&Folder::new(), &empty, "", &[("the list of objects is empty", "[[object]]")]);
}

#[test]
fn a_key_that_is_needed_is_missed_where_it_belongs() {
    one_mistake("[dataset]\nname = \"small\"\n", "[«dataset»]\n", "missing key `name` in [dataset]", "for example");
    one_mistake(
        "[dataset]\nname = \"small\"\nsamples = 8\n",
        "[«dataset»]\nname = \"small\"\n",
        "missing key `samples` in [dataset]",
        "for example",
    );
    one_mistake(
        "[indentation]\ndepth_mm = { log_uniform = [0.3, 1.2] }\n",
        "[«indentation»]\n",
        "missing key `depth_mm` in [indentation]",
        "for example",
    );
    one_mistake("[[object]]\npath = \"cone.obj\"\n", "«[[object]]»\n", "missing key `path` in [[object]]", "mesh file");
    let curve = "{ mean = 0.0, std = 1.0, min = -3.0, max = 3.0 }";
    one_mistake(curve, "«{ mean = 0.0, min = -3.0, max = 3.0 }»", "missing key `std`", "");
}

#[test]
fn an_empty_job_is_told_all_that_is_needed() {
    let folder = Folder::with_job("");
    let expected = [
        ("missing key `name` in [dataset]", "for example"),
        ("missing key `samples` in [dataset]", "for example"),
        ("missing key `depth_mm` in [indentation]", "for example"),
        ("the job has no object", "[[object]]"),
    ];
    let problems = refused(&folder, "", &expected);
    assert!(problems.iter().all(|problem| problem.place == "job.toml:1:1"), "{problems:#?}");
}

#[test]
fn a_negative_or_inverted_range_is_refused() {
    one_mistake(
        "\nyaw_deg = [0.0, 360.0]",
        "\nyaw_deg = «[360.0, 0.0]»",
        "inverted range: 360 is above 0",
        "smaller number first",
    );
    one_mistake(
        "{ log_uniform = [0.3, 1.2] }",
        "«[-0.5, 0.5]»",
        "depth_mm may be -0.5 to 0.5",
        "allowed: 0 to below 3 mm",
    );
    one_mistake("{ log_uniform = [0.3, 1.2] }", "«-0.5»", "depth_mm may be -0.5", "allowed: 0 to below 3 mm");
    let quantity = |to: &str, title: &str, help: &str| {
        let job = edited(JOB, &[("depth_mm = { log_uniform = [0.3, 1.2] }", to)]);
        refused_at_marks(&Folder::new(), &job, "", &[(title, help)]);
    };
    quantity("«depth_mm» = { log_uniform = [0.0, 1.2] }", "log_uniform from 0", "above 0");
    quantity("«depth_mm» = { choice = [] }", "a choice between no values", "at least one");
    quantity("«depth_mm» = { choice = [0.5, nan] }", "not a finite number", "ordinary number");
    quantity("depth_mm = «inf»", "not a finite number", "ordinary number");
    quantity("«depth_mm» = { normal = { mean = 1.0, std = -1.0 } }", "negative standard deviation -1", "write std = 1");
    quantity(
        "«depth_mm» = { normal = { mean = 1.0, std = 0.1 } }",
        "depth_mm may be any number",
        "a `min` and a `max`",
    );
    quantity(
        "«depth_mm» = { normal = { mean = 9.0, std = 0.1, min = 0.0, max = 1.0 } }",
        "leave 0.000 %",
        "widen the limits",
    );
}

#[test]
fn numbers_out_of_their_range_are_refused_with_the_range() {
    one_mistake("samples = 8", "samples = «0»", "samples = 0 is out of range", "allowed: 1 to 1000000000 samples");
    one_mistake("per_shard = 3", "per_shard = «0»", "samples_per_shard = 0 is out of range", "allowed: 1 to");
    one_mistake("[48, 36]", "[«0», 36]", "resolution_px = 0 is out of range", "allowed: 1 to 8192 px");
    one_mistake("[48, 36]", "[48, «8193»]", "resolution_px = 8193 is out of range", "allowed: 1 to 8192 px");
    one_mistake("seed = 7", "seed = «9007199254740992»", "seed = 9007199254740992", "allowed: 0 to 9007199254740991");
    one_mistake("seed = 7", "seed = «99999999999999999999»", "expected a whole number from 0 up", "");
    one_mistake("weight = 2.0", "weight = «-2.0»", "weight = -2 is out of range", "allowed: 0 to");
    one_mistake("weight = 2.0", "weight = «nan»", "weight = NaN is out of range", "allowed: 0 to");
    one_mistake("no_contact = 0.25", "no_contact = «1.5»", "no_contact = 1.5 is out of range", "allowed: 0 to 1");
    let more = |line: &str, title: &str, help: &str| {
        one_mistake("[[object]]\npath = \"cube.obj\"", &format!("{line}\n[[object]]\npath = \"cube.obj\""), title, help)
    };
    more("field_of_view_mm = [20.0, «0»]", "field_of_view_mm = 0 is out of range", "allowed: 0.001 to 10000 mm");
    more("gelpad_poisson_ratio = «0.5»", "gelpad_poisson_ratio = 0.5 is out of range", "allowed: 0 to 0.4999");
    more("[[sensor.led]]\ncolor = [0.0, «2.0», 0.0]", "color = 2 is out of range", "allowed: 0 to 1");
    more("[[sensor.led]]\npattern.red = «[1.0, 0.2]»", "2 coefficients", "write 1, 3 or 6 of them");
    more("[[sensor.led]]\npattern.red = [1.0, «-200.0», 0.0]", "red = -200 is out of range", "allowed: -100 to 100");
    more("[gelpad.mean_blur]\nkernel_px = «14»", "kernel_px must be odd", "write 13 or 15");
    more("[gelpad.mean_blur]\nkernel_px = «0»", "kernel_px = 0 is out of range", "allowed: 1 to 255");
    more("[gelpad.mean_blur]\nkernel_px = «300»", "kernel_px = 300 is out of range", "allowed: 1 to 255");
    more("[gelpad.gaussian]\nkernels_px = [5, «4»]", "kernels_px must be odd", "write 3 or 5");
    more("[gelpad.gaussian]\nkernels_px = «[1, 1, 1, 1, 1, 1, 1, 1, 1]»", "9 blurs are too many", "allowed: up to 8");
    more("[gelpad.gaussian]\nsmoothing_px = «0»", "smoothing_px = 0 is out of range", "allowed: 1 to 255");
    more("[gelpad.elastic]\ntolerance_um = «0.009»", "tolerance_um = 0.009 is out of range", "0.01 to 1000 um");
    more("[gelpad.elastic]\ntolerance_um = «nan»", "tolerance_um = NaN is out of range", "0.01 to 1000 um");
    more("[gelpad.elastic]\nmax_iterations = «0»", "max_iterations = 0 is out of range", "1 to 10000 iterations");
    more("[optics.phong]\nshininess = «-1.0»", "shininess = -1 is out of range", "allowed: 0 to 1000");
}

#[test]
fn several_objects_are_refused_where_there_can_be_none_or_only_one() {
    let scene = |count: &str| format!("[scene]\nobjects_per_sample = {count}\n\n[sensor]");
    let count = |count: &str, title: &str, help: &str| one_mistake("[sensor]", &scene(count), title, help);
    count("«0»", "objects_per_sample = 0 is out of range", "allowed: 1 to 32");
    count("«[1, 33]»", "objects_per_sample = [1, 33] is out of range", "allowed: 1 to 32");
    count("«[3, 1]»", "inverted range: 3 is above 1", "smaller number first");
    count("«1.5»", "expected a whole number such as 2, or a range of them such as [1, 3], found 1.5", "");
    count("[1, «2.5»]", "expected a whole number from 0 up, found 2.5", "");
    count("«-1»", "expected a whole number such as 2", "");
    count("«\"two\"»", "expected a whole number such as 2", "");
    let with = |from: &str, to: &str, title: &str, help: &str| {
        let job = edited(JOB, &[("[sensor]", &scene("[1, 2]")), (from, to)]);
        refused_at_marks(&Folder::new(), &job, "", &[(title, help)]);
        // A single object may have all that.
        let alone = edited(&job, &[("[1, 2]", "1")]).replace(['«', '»'], "");
        Folder::with_job(&alone).succeed("plan job.toml");
    };
    let own = |key: &str, title: &str, help: &str| {
        with("class = \"pointed\"", &format!("class = \"pointed\"\n{key}"), title, help);
    };
    own("youngs_modulus_kpa = «300.0»", "the objects of one press are one rigid body", "objects_per_sample = 1");
    own("«texture» = { amplitude_mm = 0.1 }", "one texture lies over all objects of a press", "for [texture]");
    with(
        "no_contact = 0.25",
        "no_contact = 0.25\nat = «\"axis\"»",
        "the depth is measured on the sensor's axis",
        "leave it out",
    );
    let constant = "x_mm = «1.0»\n";
    let job = edited(
        JOB,
        &[
            ("[sensor]", &scene("2")),
            ("x_mm = { normal = { mean = 0.0, std = 1.0, min = -3.0, max = 3.0 } }\n", constant),
            ("y_mm = [-2.0, 2.0]\n", ""),
        ],
    );
    let same = "all objects of a press would be at the same place";
    refused_at_marks(&Folder::new(), &job, "", &[(same, "spread them")]);
}

#[test]
fn the_largest_numbers_of_their_range_are_accepted() {
    let job = edited(JOB, &[("seed = 7", "seed = 9007199254740991"), ("samples = 8", "samples = 1")]);
    Folder::with_job(&job).succeed("generate job.toml --set sensor.resolution_px=[8192,1] --set sensor.field_of_view_mm=[1000,1] --set pose.yaw_deg=3600");
}

#[test]
fn a_name_that_is_no_folder_name_is_refused() {
    for name in ["", "a/b", "..", "a b"] {
        let to = format!("name = «\"{name}\"»");
        one_mistake("name = \"small\"", &to, "cannot be the name of a dataset", "letters, digits");
    }
}

#[test]
fn weights_that_sum_to_zero_are_refused() {
    let edits = [("\"cube.obj\"", "\"cube.obj\"\nweight = «0.0»"), ("weight = 2.0", "weight = 0")];
    let title = "the weights sum to zero: no object can be drawn";
    refused_at_marks(&Folder::new(), &edited(JOB, &edits), "", &[(title, "weight above 0")]);
}

#[test]
fn a_depth_beyond_the_pad_is_refused_with_the_thickness_that_counts() {
    one_mistake(
        "{ log_uniform = [0.3, 1.2] }",
        "«[0.3, 3.5]»",
        "depth_mm may be 0.3 to 3.5",
        "allowed: 0 to below 3 mm; usual is depth_mm = [0.15, 0.9]",
    );
    let thin = "resolution_px = [48, 36]\ngelpad_thickness_mm = 1.0";
    let edits = [("resolution_px = [48, 36]", thin), ("depth_mm =", "«depth_mm» =")];
    refused_at_marks(
        &Folder::new(),
        &edited(JOB, &edits),
        "",
        &[("depth_mm may be 0.3 to 1.2", "allowed: 0 to below 1 mm")],
    );
}

#[test]
fn nothing_is_said_about_the_depth_while_the_thickness_is_unknown() {
    let sensor = |line: &str, title: &str| {
        let edits = [("resolution_px = [48, 36]", line), ("{ log_uniform = [0.3, 1.2] }", "5.0")];
        refused_at_marks(&Folder::new(), &edited(JOB, &edits), "", &[(title, "")]);
    };
    sensor("gelpad_thickness_mm = «-3.0»", "gelpad_thickness_mm = -3 is out of range");
    sensor("gelpad_thickness_mm = «\"thick\"»", "expected a number");
    sensor("«gelpad_thicknes_mm» = 6.0", "unknown key `gelpad_thicknes_mm`");
    sensor("preset = «\"thick-one\"»", "no sensor preset is called `thick-one`");
    sensor("file = «\"thick-one.toml\"»", "cannot read the sensor file thick-one.toml");
}

#[test]
fn a_depth_that_presses_the_pad_flat_to_the_shell_is_refused() {
    let title = "and the gelpad is as thick as 3 mm";
    one_mistake("{ log_uniform = [0.3, 1.2] }", "«[0.3, 3.0]»", title, "allowed: 0 to below 3 mm");
    one_mistake("{ log_uniform = [0.3, 1.2] }", "«3.0»", title, "allowed: 0 to below 3 mm");
    let folder = Folder::with_job(JOB);
    folder.succeed("generate job.toml --quiet --samples 1 --set indentation.depth_mm=2.999");
}

#[test]
fn what_is_probably_not_meant_is_noted_and_refused_where_notes_count_as_errors() {
    let folder = Folder::with_job(JOB);
    for (set, words) in [
        ("indentation.depth_mm=[1e-5,5e-4]", "warning: indentation.depth_mm is at most 0.0005, less than a micrometre"),
        (
            "sensor.gelpad_youngs_modulus_kpa=0.145",
            "warning: sensor.gelpad_youngs_modulus_kpa may be 0.145, where gelpads have 1 to",
        ),
        ("sensor.gelpad_youngs_modulus_kpa=145000.0", "warning: sensor.gelpad_youngs_modulus_kpa may be 145000, where"),
        ("sensor.resolution_px=[36,48]", "warning: pixels are 0.556 x 0.312 mm: images are out of proportion"),
    ] {
        let said = folder.succeed(&format!("generate job.toml --overwrite --samples 1 --out out --set {set}"));
        assert_eq!(said.matches("warning: ").count() + said.matches("note: ").count(), 1, "{said}");
        assert!(said.contains(words), "{words} in {said}");
        for command in ["generate job.toml --out none", "plan job.toml --out none", "preview job.toml --out none.png"] {
            let text = folder.fail(&format!("{command} --strict --set {set}"), 2);
            assert!(text.contains(&words.replace("warning: ", "error: ")) && text.contains("--strict"), "{text}");
            assert!(!folder.path("none").exists() && !folder.path("none.png").exists(), "nothing may be written");
        }
    }
    folder.succeed("generate job.toml --strict --quiet --out out --overwrite");
    folder.write("metres.toml", edited(JOB, &[("path = \"cube.obj\"", "path = \"cube.obj\"\nunit = \"m\"")]));
    for command in ["generate", "plan", "preview"] {
        let out = if command == "preview" { "none.png" } else { "none" };
        let text = folder.fail(&format!("{command} metres.toml --strict --out {out}"), 2);
        assert!(text.contains("mm long under unit = \"m\"") && text.contains("look like millimetres"), "{text}");
    }
}

#[test]
fn samples_that_touch_nothing_are_counted_and_warned_of_before_the_run() {
    let folder = Folder::with_job(&edited(JOB, &[("y_mm = [-2.0, 2.0]", "y_mm = 40.0")]));
    let said = folder.succeed("generate job.toml --out away");
    assert!(said.contains("8 samples in 4 shards, 0 of 8 in contact"), "{said}");
    assert!(said.contains("warning: 2 meshes are never in view: [pose] places them at y_mm = 40"), "{said}");
    // One cause, one message.
    assert_eq!(said.matches("warning: ").count() + said.matches("note: ").count(), 1, "{said}");
    let said = folder.succeed("generate job.toml --out near --set pose.y_mm=0.0");
    assert!(!said.contains("touch nothing"), "{said}");
}

#[test]
fn a_press_beyond_linear_theory_is_noted_where_the_pad_is_elastic() {
    let folder = Folder::with_job(JOB);
    let said = |flags: &str| folder.succeed(&format!("generate job.toml --overwrite --samples 1 --out out {flags}"));
    let words = "note: indentation.depth_mm may be 1.6, over half of the pad's 3 mm";
    assert!(said("--set indentation.depth_mm=1.6").contains(words));
    assert!(!said("--set indentation.depth_mm=1.5").contains("note:"));
    assert!(!said("--set indentation.depth_mm=1.6 --fidelity paper").contains("note:"));
    assert_eq!(folder.labels("out")["000000000"]["numerics"]["beyond_theory"], true);
}

#[test]
fn a_bound_beside_a_gelpad_is_one_problem_at_the_gelpad() {
    let title = "`gelpad` leaves nothing to choose for `fidelity`";
    let help = "leave `gelpad` out, or name a level in `fidelity`";
    for bound in ["max_error_um = 5.0", "max_ms = 20"] {
        let name = format!("\nfidelity = {{ {bound} }}\ngelpad = «\"elastic\"»\n[dataset]");
        one_mistake("\n[dataset]", &name, title, help);
        let table = format!("\nfidelity = {{ {bound} }}\n[«gelpad».mean_blur]\npasses = 1\n[dataset]");
        one_mistake("\n[dataset]", &table, title, help);
    }
    let text = edited(JOB, &[("\n[dataset]", "\nfidelity = { max_ms = 20 }\ngelpad = \"elastic\"\n[dataset]")]);
    Folder::with_job(&text).succeed("generate job.toml --quiet --samples 1 --fidelity draft");
}

#[test]
fn a_bound_out_of_its_range_is_refused_with_the_range() {
    for value in ["0", "-1.0", "0.0009", "100001.0", "nan", "inf"] {
        let to = format!("\nfidelity = {{ max_error_um = «{value}» }}\n[dataset]");
        one_mistake("\n[dataset]", &to, "max_error_um = ", "allowed: 0.001 to 100000 um");
    }
    for value in ["0.0", "-1", "0.0009", "1000001", "nan", "-inf"] {
        let to = format!("\nfidelity = {{ max_ms = «{value}» }}\n[dataset]");
        one_mistake("\n[dataset]", &to, "max_ms = ", "allowed: 0.001 to 1000000 ms");
    }
}

#[test]
fn a_fidelity_of_the_wrong_form_is_refused() {
    let start = "\n[dataset]";
    let wrong = |value: &str, title: &str, help: &str| {
        one_mistake(start, &format!("\nfidelity = {value}\n[dataset]"), title, help);
    };
    wrong("«5»", "expected", "");
    wrong("{ max_error_um = «\"small\"» }", "expected a number, found the text \"small\"", "");
    wrong("{ max_error_um = «[1, 2]» }", "expected a number, found a list", "");
    wrong("{ «max_error» = 5 }", "unknown choice `max_error`", "did you mean `max_error_um`?");
    wrong("«\"stanard\"»", "unknown choice `stanard`", "did you mean `standard`?");
    wrong("«\"reverence\"»", "unknown choice `reverence`", "did you mean `reference`?");
    wrong("«{}»", "`max_error_um` or `max_ms` belongs here, found none", "");
    wrong("«{ max_error_um = 5, max_ms = 2 }»", "belongs here, found max_error_um and max_ms", "");
    wrong("«\"max_ms\"»", "`max_ms` needs a value", "write { max_ms = .. }");
    wrong("{ draft = «1» }", "`draft` takes no parameters", "");
}

#[test]
fn splits_that_do_not_sum_to_one_are_refused() {
    let splits = |to: &str, title: &str, help: &str| {
        let from = "splits = { train = 0.5, val = 0.25, test = 0.25 }";
        refused_at_marks(&Folder::new(), &edited(JOB, &[(from, to)]), "", &[(title, help)]);
    };
    splits(
        "«splits» = { train = 0.5, val = 0.25 }",
        "the splits sum to 0.75",
        "splits = { train = 0.5, val = 0.25, test = 0.25 }",
    );
    splits("«splits» = {}", "the splits sum to 0", "must sum to 1");
    // One mistake each: a wrong share explains a wrong sum.
    splits(
        "«splits» = { train = 1.5, val = 0.5 }",
        "the splits sum to 2",
        "splits = { train = 0.75, val = 0.25, test = 0 }",
    );
    splits("splits = { train = 0.5, «valid» = 0.5 }", "unknown key `valid`", "did you mean `val`?");
    splits("splits = { train = «nan» }", "train = NaN is out of range", "allowed: 0 to 1");
}

#[test]
fn more_splits_than_objects_are_refused_where_objects_are_split() {
    one_mistake("seed = 7", "split_by = «\"object\"»", "3 splits but 2 different object(s)", "add objects");
    // A twin is not another object.
    let twin = "\"cube.obj\"\n[[object]]\npath = \"twin.obj\"";
    let folder = Folder::new();
    std::fs::copy(folder.path("cube.obj"), folder.path("twin.obj")).expect("a copy");
    let edits = [("seed = 7", "split_by = «\"object\"»"), ("\"cube.obj\"", twin)];
    refused_at_marks(&folder, &edited(JOB, &edits), "", &[("3 splits but 2 different object(s)", "add objects")]);
    // What has its split is not free for another.
    let edits = [("seed = 7", "split_by = «\"object\"»"), ("\"cube.obj\"", "\"cube.obj\"\nsplit = \"train\"")];
    let told = "2 split(s) without an object, and 1 object(s) without a `split`";
    refused_at_marks(&Folder::new(), &edited(JOB, &edits), "", &[(told, "add objects")]);
    // With one that cannot be read there may be enough: only that one is reported.
    let edits =
        [("seed = 7", "split_by = \"object\""), ("\"cube.obj\"", "\"cube.obj\"\n[[object]]\npath = «\"no.obj\"»")];
    refused_at_marks(&Folder::new(), &edited(JOB, &edits), "", &[("no.obj does not exist", "")]);
}

#[test]
fn a_layer_that_the_model_cannot_give_is_refused() {
    for model in ["mean_blur", "gaussian", "none"] {
        let job = edited(
            JOB,
            &[("\"contact\"]", "\"pressure\"]"), ("[dataset]", &format!("gelpad = \"{model}\"\n[dataset]"))],
        );
        let folder = Folder::with_job(&job);
        let text = folder.fail("generate job.toml", 2);
        assert!(text.contains(&format!("the gelpad model `{model}` knows no pressure")), "{text}");
        assert!(text.contains("leave `pressure` out"), "{text}");
    }
    one_mistake("\"contact\"]", "«\"markers\"»]", "no printed markers", "leave `markers` out");
}

#[test]
fn a_slip_of_syntax_is_reported_alone() {
    one_mistake("samples = 8", "samples = «»", "not valid TOML", "");
    one_mistake("[sensor]\n", "[sensor«»\n", "not valid TOML", "");
    one_mistake("seed = 7", "seed = 7\n«seed» = 8", "duplicate key", "");
}

#[test]
fn a_mesh_that_cannot_be_read_is_named_with_its_line() {
    let folder = Folder::new();
    folder.write("broken.obj", "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 9\n");
    one_mistake_in(&folder, "\"cone.obj\"", "«\"broken.obj\"»", "broken.obj:4: ", "export it again");
    folder.write("empty.stl", "solid x\nendsolid x\n");
    one_mistake_in(&folder, "\"cone.obj\"", "«\"empty.stl\"»", "empty.stl: ", "export it again, with its faces");
}

#[test]
fn a_sensor_preset_that_does_not_exist_is_shown_with_the_nearest() {
    let title = "no sensor preset is called `gelsight-2015`";
    one_mistake("[sensor]", "[sensor]\npreset = «\"gelsight-2015\"»", title, "did you mean `gelsight-2014`?");
    one_mistake("[sensor]", "[sensor]\npreset = «\"nonsense\"»", "`nonsense`", "`tactip`, `geltip` or `allsight`");
    one_mistake("[sensor]", "[sensor]\npreset = «5»", "expected text in quotes, found 5", "");
}

#[test]
fn a_sensor_file_that_does_not_exist_is_refused() {
    one_mistake("[sensor]", "[sensor]\nfile = «\"mine.toml\"»", "cannot read the sensor file mine.toml", "relative to");
}

#[test]
fn preset_and_file_at_once_are_refused() {
    let folder = Folder::new();
    folder.write("mine.toml", "name = \"mine\"\n");
    let to = "[sensor]\npreset = \"digit\"\nfile = «\"mine.toml\"»";
    one_mistake_in(&folder, "[sensor]", to, "both `preset` and `file` name a sensor", "keep one");
}

#[test]
fn a_mistake_in_a_sensor_file_is_shown_in_that_file() {
    let in_sensor = |marked: &str, expected: &[(&str, &str)]| {
        let (places, text) = split_marks(marked);
        let folder = Folder::with_job(&edited(JOB, &[("[sensor]", "[sensor]\nfile = \"mine.toml\"")]));
        folder.write("mine.toml", text);
        assert_places(&refused(&folder, "", expected), "mine.toml", &places);
    };
    in_sensor(
        "name = \"mine\"\ngelpad_thickness_mm = «-1»\n",
        &[("gelpad_thickness_mm = -1", "allowed: 0.01 to 1000 mm")],
    );
    in_sensor("name = «5»\n«led_count» = 3\n", &[("expected text in quotes", ""), ("unknown key `led_count`", "")]);
    in_sensor("name = «»\n", &[("not valid TOML", "")]);
    in_sensor("preset = «\"digitt\"»\n", &[("no sensor preset is called `digitt`", "did you mean `digit`?")]);
    in_sensor("file = «\"other.toml\"»\n", &[("a sensor file cannot start from another one", "preset")]);
    in_sensor("background = «\"no.png\"»\n", &[("cannot read the background no.png", "PNG of the untouched pad")]);
}

#[test]
fn a_background_that_is_no_picture_is_refused() {
    let folder = Folder::new();
    folder.write("bad.png", "this is no picture");
    let to = "[sensor]\nbackground = «\"bad.png\"»";
    one_mistake_in(&folder, "[sensor]", to, "cannot read the background bad.png", "PNG of the untouched pad");
    one_mistake("[sensor]", "[sensor]\nbackground = «\"no.png\"»", "cannot read the background no.png", "PNG");
}

#[test]
fn a_file_with_another_content_than_the_job_says_is_refused() {
    let other = "0".repeat(64);
    let to = format!("sha256 = «\"{other}\"»");
    one_mistake("weight = 2.0", &to, "cone.obj has changed: its SHA-256 is ", "restore the file");
    one_mistake("weight = 2.0", "sha256 = «\"00\"»", "no SHA-256: that of cone.obj is ", "as sha256sum prints it");
    // Other programs write capitals.
    let folder = Folder::new();
    let hash = gelsim_files::hash::sha256(folder.read("cone.obj").as_bytes()).to_uppercase();
    folder.write("job.toml", edited(JOB, &[("weight = 2.0", &format!("sha256 = \"{hash}\""))]));
    folder.succeed("plan job.toml");
}

#[test]
fn a_mistake_on_the_command_line_is_shown_with_its_flag() {
    let at = |flags: &str, place: &str, underlined: &str, title: &str, help: &str| {
        let problems = refused(&Folder::with_job(JOB), flags, &[(title, help)]);
        assert_eq!((problems[0].place.as_str(), problems[0].underlined.as_str()), (place, underlined));
    };
    at("--set dataset.samples=0", "--set:1:17", "0", "samples = 0 is out of range", "allowed: 1 to");
    at("--set sensor.resolution_px=[0,36]", "--set:1:23", "0", "resolution_px = 0 is out of range", "1 to 8192");
    at("--set dataset.sede=1", "--set:1:1", "dataset.sede", "unknown key `sede`", "did you mean `seed`?");
    at("--set dataset.samples", "--set:1:1", "dataset.samples", "not an assignment: `dataset.samples`", "VALUE");
    at(
        "--set dataset.name=mine",
        "--set:1:1",
        "dataset.name=mine",
        "not an assignment",
        "write --set 'dataset.name = \"mine\"': text stands in quotes",
    );
    at("--set effects=True", "--set:1:1", "effects=True", "not an assignment", "write --set 'effects = true'");
    at("--set object=3", "--set:1:8", "3", "expected a list, found 3", "each is a table: write [[object]]");
    at("--set object.5.weight=1", "--set:1:1", "object.5.weight", "no such element; the list has 2", "");
    at("--set object.0.path=\"no.obj\"", "--set:1:15", "\"no.obj\"", "no.obj does not exist", "");
    at("--set dataset.name.x=1", "--set:1:1", "dataset.name.x", "expected text in quotes, found a table", "");
    at("--samples 0", "--samples:1:19", "0", "samples = 0 is out of range", "allowed: 1 to");
    at("--seed 9007199254740992", "--seed:1:16", "9007199254740992", "seed = 9007199254740992", "9007199254740991");
}

#[test]
fn an_override_repairs_what_the_job_has_wrong() {
    let folder = Folder::with_job(&edited(JOB, &[("samples = 8", "samples = 0")]));
    folder.succeed("generate job.toml --samples 1");
}

#[test]
fn many_mistakes_are_all_reported_at_once_in_the_order_of_the_file() {
    let marked = r#"
fidelity = «"papr"»
[dataset]
name = "small"
samples = «0»
seed = «-1»
«splits» = { train = 0.5, val = 0.25 }
«split_buy» = "object"
[sensor]
preset = «"digits"»
resolution_px = [«0», «9000»]
[[object]]
path = «"nothing.obj"»
unit = «"miles"»
[[object]]
path = «"none/*.stl"»
weight = «-1.0»
[pose]
yaw_deg = «[360.0, 0.0]»
x_mm = { normal = { mean = 0.0, «sd» = 1.0 } }
[indentation]
depth_mm = «"deep"»
no_contact = «nan»
[output]
layers = [«"dept"», "contact", «"presure"»]
«exra» = 1
"#;
    let expected = [
        ("unknown choice `papr`", "`paper`"),
        ("samples = 0 is out of range", "allowed: 1 to"),
        ("expected a whole number from 0 up, found -1", ""),
        ("the splits sum to 0.75", "must sum to 1"),
        ("unknown key `split_buy`", "`split_by`"),
        ("no sensor preset is called `digits`", "`digit`"),
        ("resolution_px = 0 is out of range", "1 to 8192"),
        ("resolution_px = 9000 is out of range", "1 to 8192"),
        ("nothing.obj does not exist", "relative"),
        ("unknown choice `miles`", "`mm`"),
        ("no file matches none/*.stl", "relative"),
        ("weight = -1 is out of range", "allowed: 0"),
        ("inverted range", "smaller number first"),
        ("unknown key `sd`", "`std`"),
        ("expected a number", ""),
        ("no_contact = NaN is out of range", "0 to 1"),
        ("unknown choice `dept`", "`depth`"),
        ("unknown choice `presure`", "`pressure`"),
        ("unknown key `exra`", "`exr`"),
    ];
    refused_at_marks(&Folder::new(), marked, "", &expected);
}

#[test]
fn mistakes_in_job_command_line_and_sensor_file_are_reported_together() {
    let folder = Folder::with_job(&edited(
        JOB,
        &[("samples = 8", "samples = 0"), ("[sensor]", "[sensor]\nfile = \"mine.toml\"")],
    ));
    folder.write("mine.toml", "gelpad_thickness_mm = 0\n");
    let expected = [("samples = 0", ""), ("no_contact = 2", ""), ("gelpad_thickness_mm = 0", "")];
    let problems = refused(&folder, "--set indentation.no_contact=2", &expected);
    let files: Vec<&str> = problems.iter().filter_map(|problem| problem.place.split(':').next()).collect();
    assert_eq!(files, ["job.toml", "--set", "mine.toml"]);
}

#[test]
fn a_job_that_is_no_text_or_not_there_is_refused() {
    let folder = Folder::new();
    let said = folder.fail("generate nothing.toml", 2);
    assert!(said.contains("nothing.toml: cannot read the job") && said.contains("gelsim init FILE.toml"), "{said}");
    folder.write("job.toml", JOB);
    assert!(folder.fail("generate jobs.toml", 2).contains("did you mean job.toml?"));
    folder.write("job.toml", b"name = \"\xff\"");
    assert!(folder.fail("generate job.toml", 2).contains("it is not UTF-8 at line 1, column 9"));
}

#[test]
fn a_command_line_that_makes_no_sense_ends_with_status_2_and_writes_nothing() {
    let folder = Folder::with_job(JOB);
    for (flags, words) in [
        ("--threads 0", "--threads 0 cannot work"),
        ("--threads 40000", "--threads 40000 are more than any machine has cores"),
        ("--threads x", "invalid value 'x'"),
        ("--shards 0..9", "--shards 0..9 reaches beyond the job's 4 shards"),
        ("--shards 2..2", "write A..B with A < B"),
        ("--shards 3", "write A..B with A < B"),
        ("--partition 2/2", "write I/N with I from 0 to N - 1"),
        ("--partition 0/0", "write I/N"),
        ("--shards 0..1 --partition 0/2", "cannot be used with"),
        ("--fidelity perfect", "possible values: paper"),
        ("--samples many", "invalid value 'many'"),
        ("--what", "unexpected argument '--what'"),
    ] {
        let text = folder.fail(&format!("generate job.toml {flags}"), 2);
        assert!(text.contains(words), "{words:?} in\n{text}");
        assert!(!folder.path("out").exists(), "nothing may be written: {flags}");
    }
}

#[test]
fn an_output_that_is_no_folder_is_refused() {
    let folder = Folder::with_job(JOB);
    let text = folder.fail("generate job.toml --out cube.obj", 2);
    assert!(text.contains("cube.obj is not a folder"), "{text}");
}

#[test]
fn a_quiet_run_prints_nothing_but_errors() {
    let folder = Folder::new();
    // Half of it NaN: worth a note.
    folder.write("cube.obj", "v 0 0 0\nv 5 0 0\nv 0 5 0\nv nan 0 0\nf 1 2 3\nf 1 2 4\n");
    folder.write("job.toml", JOB);
    let loud = folder.succeed("generate job.toml --out loud");
    assert!(
        loud.contains("warning: cube.obj: dropped 1 vertex that is not finite")
            && loud.contains("8 samples in 4 shards"),
        "{loud}"
    );
    folder.gelsim("generate job.toml --out quiet --quiet").assert().success().stdout("").stderr("");
    let error = folder.fail("generate job.toml --out quiet --quiet --samples 0", 2);
    assert!(error.contains("samples = 0 is out of range"), "{error}");
}

#[test]
fn standard_output_is_empty_but_for_results() {
    let folder = Folder::with_job(JOB);
    folder.gelsim("generate job.toml").assert().success().stdout("");
    folder.gelsim("preview job.toml --out sheet.png").assert().success().stdout("");
    let listed = folder.gelsim("list sensors").assert().success().stderr("");
    assert!(String::from_utf8_lossy(&listed.get_output().stdout).contains("gelsight-2014"));
}

#[test]
fn a_reader_that_stops_early_is_no_failure() {
    let folder = Folder::new();
    for arguments in [["schema", "job"], ["list", "objects"], ["completions", "bash"]] {
        let (reader, writer) = std::io::pipe().expect("a pipe");
        drop(reader);
        let mut command = std::process::Command::new(env!("CARGO_BIN_EXE_gelsim"));
        let output = command.args(arguments).current_dir(folder.path("")).stdout(writer).output().expect("it runs");
        assert!(output.status.success(), "{arguments:?}: {}", String::from_utf8_lossy(&output.stderr));
    }
}

#[test]
fn effects_out_of_range_are_refused_where_they_are_written() {
    let mistake = |table: &str, title: &str, help: &str| {
        one_mistake("[output]", &format!("{table}\n[output]"), title, help);
    };
    mistake("[texture]\namplitude_mm = «-0.1»", "amplitude_mm may be -0.1", "allowed: 0 to 10 mm");
    mistake("[texture]\nscale_mm = «0.0»", "scale_mm may be 0", "allowed: 0.001 to 1000 mm");
    mistake("[texture]\npatterns = «[]»", "no pattern to choose from", "patterns = [");
    mistake("[texture]\npatterns = [«\"knurl\"»]", "unknown choice `knurl`", "did you mean `knurled`?");
    mistake(
        "[texture]\npatterns = [{ image = { path = «\"no.png\"» } }]",
        "cannot read the height map no.png",
        "a grey PNG of 8 or 16 bits",
    );
    mistake("[shear]\nx_mm = «[0.0, 11.0]»", "x_mm may be 0 to 11", "allowed: -10 to 10 mm");
    mistake("[shear]\nfriction = { coulomb = { coefficient = «-1.0» } }", "coefficient = -1", "allowed: 0 to 10");
    mistake("[markers]\npitch_mm = «0.0»", "pitch_mm may be 0", "allowed: 0.05 to 1000 mm");
    mistake("[markers]\ncolor = [0.1, «2.0», 0.1]", "color = 2 is out of range", "allowed: 0 to 1");
    mistake("[camera]\ndistortion_k1 = «-0.5»", "folds the image over itself", "distortion_k1 = -0.26");
    mistake("[camera]\nexposure = «[0.0, 1.0]»", "exposure may be 0 to 1", "allowed: 0.01 to 100");
    mistake("[camera]\ndefocus_mm = «1.5»", "defocus_mm may be 1.5", "allowed: 0 to 1 mm");
    mistake("[camera]\n«vigneting» = 0.1", "unknown key `vigneting`", "did you mean `vignette`?");
    mistake("[sensor.grain]\nheight_um = «101.0»\nsize_mm = 0.1", "height_um = 101", "allowed: 0 to 100 um");
    mistake("[sensor.rest_shape.dome]\nradius_mm = «5.0»", "radius_mm = 5", "allowed: 12.5 to 1000000 mm");
    mistake("[sensor.rest_shape]\n«dom»= { radius_mm = 50.0 }", "unknown choice `dom`", "did you mean `dome`?");
    mistake("[camera]\nthreshold = «1.5»", "threshold = 1.5", "allowed: 0 to 1");
}

#[test]
fn gels_lenses_and_pins_that_make_no_sense_are_refused() {
    let mistake = |written: &str, title: &str, help: &str| {
        one_mistake("[sensor]", &format!("[sensor]\npreset = \"tactip\"\n{written}"), title, help);
    };
    mistake("shape.dome.radius_mm = «0.5»", "radius_mm = 0.5", "allowed: 1 to 1000000 mm");
    mistake("pins.spacing_mm = «4.0»", "the outermost pins stand 40.0 mm from the tip", "the gel ends after 31.4 mm");
    mistake("pins.length_mm = «25.0»", "longer than the gel's radius", "stay below 20 mm");
    mistake("pins.in_plane = «2.0»", "in_plane = 2", "allowed: 0 to 1");
    mistake("lens.fisheye.fov_deg = «400.0»", "fov_deg = 400", "allowed: 1 to 300 degrees");
    mistake("lens.fisheye.position_mm = «[0.0, 0.0, -3.0]»", "the camera stands in the gel", "11 mm thick");
    mistake("lens.fisheye.look_at_mm = «[0.06, 0.1, -62.0]»", "looks at itself", "look_at_mm = [0.0, 0.0, 0.0]");
    mistake(
        "lens.fisheye.k = «[-9.0, 0.0, 0.0, 0.0]»",
        "two directions in one place",
        "bring the coefficients towards 0",
    );
    mistake("«rest_shape».dome.radius_mm = 50.0", "`rest_shape` does not go with", "leave `rest_shape` out");
    one_mistake(
        "[sensor]",
        "[sensor]\n«pins» = { count = 7, spacing_mm = 1.0, length_mm = 1.0, diameter_mm = 0.5 }",
        "has no shape",
        "add [sensor.shape]",
    );
    mistake(
        "shape = { capsule = { radius_mm = 30.0, length_mm = «8.0» } }",
        "8 mm long, and its cap alone 30",
        "from the tip",
    );
    mistake(
        "shape = { capsule = { radius_mm = 2.0, length_mm = «80.0» } }",
        "40 times as long as its radius",
        "up to 20 times",
    );
    let finger = |written: &str, title: &str, help: &str| {
        one_mistake("[sensor]", &format!("[sensor]\npreset = \"geltip\"\n{written}"), title, help);
    };
    finger("lens.pinhole.position_mm = «[0.0, 9.5, -20.0]»", "the camera stands in the gel", "2.5 mm thick");
    finger(
        "led = [{ size_mm = «[6.0, 1.0]» }]",
        "`size_mm` does not go with a gel that has a shape",
        "leave `size_mm` out",
    );
    finger("«window» = { distance_mm = 8.0 }", "`window` does not go with a gel", "leave `window` out");
    finger("led = [{ position_mm = «[0.0, 0.0, 3.0]» }]", "the LED is outside of the gel", "below 0 inside");
    one_mistake(
        "[sensor]",
        "[sensor]\nled = [{ position_mm = «[0.0, 0.0, 3.0]» }]",
        "not on the camera's side of the pad",
        "z is 0 on the pad and below 0 on the camera's side",
    );
    one_mistake(
        "[sensor]",
        "[sensor]\nwindow.distance_mm = 2.0\nled = [{ position_mm = «[0.0, 9.0, -3.0]» }]",
        "the LED is 3 mm from the plane of the pad, beyond the window at 2 mm",
        "before the window",
    );
}

#[test]
fn places_on_a_gel_are_on_it() {
    let tilt = "tilt_deg = { uniform = [0.0, 8.0] }";
    one_mistake(tilt, "from_tip_mm = «3.0»", "and this one is flat", "write x_mm and y_mm");
    let folder = Folder::new();
    folder.write("a.obj", "v 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\nf 1 3 2\nf 1 2 4\nf 2 3 4\nf 1 4 3\n");
    let job = |pose: &str, more: &str| {
        format!(
            "dataset = {{ name = \"a\", samples = 1 }}\nsensor.preset = \"geltip\"\nobject = [{{ path = \"a.obj\" }}]\n\
             indentation.depth_mm = 0.5\n{more}\n[pose]\n{pose}\n"
        )
    };
    for (pose, more, said) in [
        ("from_tip_mm = [0.0, 80.0]", "", "the gel ends 56.6 mm from its tip"),
        ("from_tip_mm = -1.0", "", "from_tip_mm = -1"),
        ("around_deg = 5000.0", "", "around_deg = 5000"),
        ("from_tip_mm = 3.0", "shear.x_mm = 0.5", "shear that neither pins nor the layers `flow` and `traction` show"),
    ] {
        folder.write("job.toml", job(pose, more));
        let found = folder.fail("plan job.toml", 2);
        assert!(found.contains(said), "{pose} {more}: {found}");
    }
}

#[test]
fn roll_and_pitch_stand_in_place_of_the_tilt() {
    let tilt = "tilt_deg = { uniform = [0.0, 8.0] }";
    let both = format!("{tilt}\nroll_deg = «3.0»");
    one_mistake(tilt, &both, "`roll_deg` stands in place of `tilt_deg`", "write roll_deg and pitch_deg");
    one_mistake(tilt, "pitch_deg = «[0.0, 120.0]»", "pitch_deg may be 0 to 120", "allowed: -90 to 90 degrees");
}

#[test]
fn a_height_map_with_another_content_than_the_job_says_is_refused() {
    let folder = Folder::new();
    folder.write("skin.png", gelsim_files::png::encode_grey(2, 2, &[0, 60, 120, 180]));
    let to = "[texture]\npatterns = [{ image = { path = \"skin.png\", sha256 = «\"HASH\"» } }]\n[output]";
    let to = to.replace("HASH", &"0".repeat(64));
    one_mistake_in(&folder, "[output]", &to, "the height map skin.png has changed", "restore the file");
}

#[test]
fn a_decimal_comma_is_told() {
    let slip = "not valid TOML";
    one_mistake("no_contact = 0.25", "no_contact = 0«,»25", slip, "numbers have a decimal point: 0.25");
}

#[test]
fn backslashes_in_a_path_are_told() {
    let folder = Folder::new();
    let in_quotes = edited(JOB, &[("\"cone.obj\"", "\"C:\\meshes\\cone.obj\"")]);
    folder.write("job.toml", in_quotes);
    let error = folder.fail("generate job.toml", 2);
    assert!(error.contains("not valid TOML") && error.contains("write / between folders"), "{error}");
    let title = "meshes\\cone.obj does not exist";
    one_mistake("\"cone.obj\"", "«'meshes\\cone.obj'»", title, "write / between folders: \"meshes/cone.obj\"");
    // What the backslash begins is no slip of syntax.
    one_mistake("\"cone.obj\"", "«\"a\\new\\table.obj\"»", "does not exist", "write \"a/new/table.obj\"");
}

#[test]
fn json_in_place_of_a_job_is_told_once() {
    let folder = Folder::with_job("{\n  \"dataset\": {\"name\": \"a\"},\n  \"object\": []\n}\n");
    let error = folder.fail("generate job.toml", 2);
    assert!(
        error.contains("it looks like JSON") && error.contains("gelsim init writes a job to start from"),
        "{error}"
    );
    assert_eq!(error.matches("error").count(), 1, "{error}");
}

#[test]
fn a_file_of_another_kind_is_told_in_one_message() {
    let folder = Folder::with_job(JOB);
    folder.write("sensor.toml", "preset = \"digit\"\ngelpad_thickness_mm = 3.0\n");
    folder.write("recipe.toml", "[input]\npath = \"real\"\n[[photometric]]\ncopies = 2\n");
    for (command, told, help) in [
        ("generate sensor.toml", "sensor.toml is a sensor file, not a job", "[sensor]: file = \"..\""),
        ("plan recipe.toml", "recipe.toml is a recipe for gelsim augment, not a job", "gelsim augment runs it"),
        ("augment job.toml", "job.toml is a job, not a recipe", "gelsim generate runs jobs"),
        ("augment sensor.toml", "sensor.toml is a sensor file, not a recipe", "[sensor]: file = \"..\""),
    ] {
        let error = folder.fail(command, 2);
        assert!(error.contains(told) && error.contains(help), "{command}: {error}");
        assert_eq!(error.matches("error").count(), 1, "{command}: {error}");
    }
    let error = folder.fail("render --sensor job.toml --depth a.npy --plane-mm 1 --out o", 2);
    assert!(error.contains("job.toml is a job, not a sensor file") && error.contains("list sensors"), "{error}");
    // Where names of several kinds are mixed, each name is told that does not belong there.
    folder.write("mixed.toml", "resolution_px = [320, 240]\n[dataset]\nname = \"a\"\n");
    assert!(folder.fail("generate mixed.toml", 2).contains("unknown key `resolution_px`"));
}

#[test]
fn a_mesh_or_a_folder_in_place_of_a_job_is_told() {
    let folder = Folder::new();
    for command in ["generate cube.obj", "preview cube.obj --out sheet.png", "plan cube.obj"] {
        let error = folder.fail(command, 2);
        assert!(error.contains("cube.obj is a mesh, not a job"), "{error}");
        assert!(error.contains("gelsim init --objects . job.toml writes a job that presses it"), "{error}");
    }
    let error = folder.fail("generate .", 2);
    assert!(error.contains("it is a folder") && error.contains("name the job file, which ends in .toml"), "{error}");
}

#[test]
fn a_folder_that_is_not_there_is_named() {
    one_mistake("\"cone.obj\"", "«\"meshez/*.obj\"»", "no file matches meshez/*.obj", "there is no folder meshez");
    one_mistake("\"cone.obj\"", "«\"a/b/cone.obj\"»", "a/b/cone.obj does not exist", "there is no folder a;");
}

#[test]
fn keys_of_objects_that_make_no_sense_are_refused() {
    let mistake = |written: &str, title: &str, help: &str| one_mistake("weight = 2.0", written, title, help);
    mistake("scale = «0.0»", "scale may be 0", "allowed: 0.001 to 1000");
    mistake("scale = «[0.5, 2000.0]»", "scale may be 0.5 to 2000", "allowed: 0.001 to 1000");
    mistake("parts = «\"seperate\"»", "unknown choice `seperate`", "did you mean `separate`?");
    mistake("class_from = «\"path\"»", "unknown choice `path`", "one of");
    mistake("urdf = «\"colision\"»", "unknown choice `colision`", "did you mean `collision`?");
    mistake("on_bad = «\"ignore\"»", "unknown choice `ignore`", "did you mean `skip`?");
    mistake("part = «\"lid\"»", "cone.obj has no part `lid`", "");
}

#[test]
fn what_an_object_says_of_its_material_and_size_is_checked_where_it_stands() {
    let mistake = |written: &str, title: &str, help: &str| {
        one_mistake("weight = 2.0", &format!("weight = 2.0\n{written}"), title, help);
    };
    mistake("youngs_modulus_kpa = «0.0»", "youngs_modulus_kpa may be 0", "allowed: 0.1 to 1000000000 kPa");
    mistake("youngs_modulus_kpa = 50.0\npoisson_ratio = «0.6»", "poisson_ratio may be 0.6", "allowed: 0 to 0.5");
    mistake("poisson_ratio = «0.4»", "without youngs_modulus_kpa is rigid", "add youngs_modulus_kpa");
    mistake("friction = «0.4»", "nothing in this job uses the friction", "x_mm = [-0.4, 0.4] under [shear]");
    mistake("texture.amplitude_mm = «-1.0»", "amplitude_mm may be -1", "allowed: 0 to 10 mm");
    mistake("texture = { patterns = «[]» }", "no pattern to choose from", "patterns = [");
    mistake("mm_per_px = «0.1»", "mm_per_px is for height maps", "`unit` and `scale`");
    one_mistake(
        "weight = 2.0\n",
        "youngs_modulus_kpa = «90.0»\n[gelpad.gaussian]\n",
        "the gelpad model `gaussian` knows no pressure",
        "write gelpad = \"elastic\" in place of the model",
    );
    let folder = Folder::new();
    folder.write("map.png", "no picture");
    let map = |object: &str, title: &str, help: &str| {
        one_mistake_in(&folder, "[[object]]\npath = \"cone.obj\"", object, title, help);
    };
    map(
        "[[object]]\npath = «\"map.png\"»\nmm_per_px = 0.1\nheight_mm = 1.0",
        "map.png: is no height map",
        "a grey PNG of 8 or 16 bits",
    );
    map(
        "[[object]]\npath = \"map.png\"\nmm_per_px = «0.0»\nheight_mm = 1.0",
        "mm_per_px = 0 is out of range",
        "0.0001 to 100 mm",
    );
    map(
        "«[[object]]»\npath = \"map.png\"\nmm_per_px = 0.1",
        "missing key `height_mm` in [[object]]",
        "height_mm = 0.5",
    );
}
