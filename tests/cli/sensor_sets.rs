//! The same presses under several sensors: each dataset is the one that its own job would give, pairs are the same press, nothing
//! depends on threads, division or what was there before, and what is said of mistakes.

use std::collections::BTreeMap;
use std::fs;

use serde_json::Value;

use crate::support::{Folder, JOB, assert_same_files, edited};

/// Two units each of two flat sensors of one size, and one of a third; what is drawn of a sensor differs.
const SENSORS: &str = "
[sensors]
from = [\"gelsight-mini\", \"gelsight-2017\"]
count = 2

[sensor.unit]
gelpad_thickness = 0.0
gelpad_youngs_modulus = 0.0

[camera]
read_noise_levels = 2.0

[texture]
patterns = [\"knurled\"]
amplitude_mm = [0.0, 0.05]

[shear]
x_mm = [-0.2, 0.2]
";

fn job() -> String {
    edited(
        &format!("{JOB}{SENSORS}"),
        &[
            ("resolution_px = [48, 36]", "resolution_px = [48, 36]\nfield_of_view_mm = [16.0, 12.0]"),
            ("layers = [\"depth\", \"contact\"]", "layers = [\"depth\", \"contact\", \"flow\"]"),
        ],
    )
}

fn folders(folder: &Folder, root: &str) -> Vec<String> {
    let set: Value = serde_json::from_str(&folder.read(&format!("{root}/sensors.json"))).expect("JSON");
    let sensors = set["sensors"].as_array().expect("a list");
    sensors.iter().map(|entry| entry["folder"].as_str().expect("a name").to_owned()).collect()
}

/// The files of a set that must be the same however it was made.
fn lasting(folder: &Folder, root: &str) -> BTreeMap<String, Vec<u8>> {
    let mut files = folder.files(root);
    files.retain(|name, _| !name.contains("/stats/"));
    files
}

/// Each dataset of the set, generated again from its own job.toml, has the same shards.
fn assert_each_is_its_own_jobs(folder: &Folder, root: &str) {
    for name in folders(folder, root) {
        folder.succeed(&format!("generate {root}/{name}/job.toml --quiet --out alone-{name}"));
        assert_same_files(&folder.files(&format!("{root}/{name}/data")), &folder.files(&format!("alone-{name}/data")));
    }
}

#[test]
fn each_dataset_is_that_of_its_own_job_and_a_sample_is_one_press() {
    let folder = Folder::with_job(&job());
    let said = folder.succeed("generate job.toml --out set --threads 3");
    assert!(said.contains("32 samples of 4 sensors in 16 shards"), "{said}");
    let names = folders(&folder, "set");
    assert_eq!(names, ["gelsight-mini-0000", "gelsight-mini-0001", "gelsight-2017-0000", "gelsight-2017-0001"]);
    assert_each_is_its_own_jobs(&folder, "set");
    let labels = names.iter().map(|name| folder.labels(&format!("set/{name}"))).collect::<Vec<_>>();
    for (key, first) in &labels[0] {
        for other in &labels[1..] {
            for part in ["object", "pose", "indentation_depth_mm", "texture", "split", "seed"] {
                assert_eq!(first[part], other[key][part], "{part} of {key}");
            }
        }
        // Units have the pad of their kind, and a light of their own.
        assert_eq!(labels[0][key]["contact"], labels[1][key]["contact"]);
        assert_ne!(labels[0][key]["sensor"], labels[1][key]["sensor"]);
    }
    let pictures = names.iter().map(|name| folder.samples(&format!("set/{name}"))).collect::<Vec<_>>();
    for (key, files) in &pictures[0] {
        assert_eq!(files["depth.exr"], pictures[1][key]["depth.exr"]);
        assert_ne!(files["tactile.png"], pictures[1][key]["tactile.png"]);
    }
}

#[test]
fn curved_sensors_sequences_and_presses_by_force_are_those_of_their_own_jobs() {
    let small = "samples = 3\nseed = 7\nsamples_per_shard = 2";
    let few = edited(JOB, &[("samples = 8\nseed = 7\nsamples_per_shard = 3", small)]);
    let force = edited(&few, &[("depth_mm = { log_uniform = [0.3, 1.2] }\nno_contact = 0.25", "force_n = [0.2, 1.0]")]);
    let slide = edited(
        &few,
        &[(
            "[indentation]\ndepth_mm = { log_uniform = [0.3, 1.2] }\nno_contact = 0.25",
            "[sequence]\nframe_rate_hz = 10.0\n[[sequence.phase]]\nname = \"press\"\nduration_s = 0.2\ndepth_mm = 0.5",
        )],
    );
    for (text, from) in
        [(&few, r#""tactip", "geltip", "digit""#), (&force, r#""digit", "digit""#), (&slide, r#""digit", "digit""#)]
    {
        let folder = Folder::with_job(&format!("{text}[sensors]\nfrom = [{from}]\n"));
        folder.succeed("generate job.toml --quiet --out set");
        assert_each_is_its_own_jobs(&folder, "set");
    }
}

#[test]
fn nothing_depends_on_threads_or_division_and_a_set_goes_on_where_it_stopped() {
    let folder = Folder::with_job(&job());
    folder.succeed("generate job.toml --quiet --out one --threads 1");
    folder.succeed("generate job.toml --quiet --out four --threads 4");
    for part in [1, 0] {
        folder.succeed(&format!("generate job.toml --quiet --out parts --partition {part}/2"));
    }
    let finalized = folder.stdout_of("finalize parts");
    assert_eq!(finalized.matches(": finalized").count(), 4, "{finalized}");
    let whole = lasting(&folder, "one");
    assert_same_files(&whole, &lasting(&folder, "four"));
    assert_same_files(&whole, &lasting(&folder, "parts"));
    // One shard of one sensor is lost, another one damaged.
    fs::remove_file(folder.path("four/gelsight-mini-0001/stats/train-000001.json")).expect("it was there");
    folder.write("four/gelsight-2017-0000/data/val-000000.tar", "no tar");
    assert!(folder.stdout_of("verify four").contains("four/gelsight-2017-0001: 8 samples in 4 shards"));
    folder.gelsim("verify four").assert().code(1);
    let said = folder.succeed("generate job.toml --out four");
    assert!(said.contains("in 2 shards") && said.contains("14 shards were there already"), "{said}");
    assert!(said.contains("gelsight-2017-0000/val-000000"), "{said}");
    assert_same_files(&whole, &lasting(&folder, "four"));
    folder.gelsim("verify four").assert().success();
}

#[test]
fn a_set_grows_by_units_sensors_and_samples() {
    let folder = Folder::with_job(&job());
    folder.succeed("generate job.toml --quiet --out set");
    let before = folder.files("set");
    let more = edited(&job(), &[("count = 2", "count = 3"), ("from = [", "from = [\"digit\", ")]);
    folder.write("more.toml", &more);
    let said = folder.succeed("generate more.toml --out set");
    assert!(said.contains("16 shards were there already"), "{said}");
    let after = folder.files("set");
    let data = |name: &&String| name.contains("/data/");
    assert!(before.keys().filter(data).all(|name| before[name] == after[name]));
    folder.succeed("generate more.toml --quiet --out set --samples 10");
    folder.gelsim("verify set").assert().success();
    // Fewer sensors are another set.
    let said = folder.fail("generate job.toml --out set", 2);
    assert!(said.contains("holds a set with 5 folders that this job has not, the first digit-0000"), "{said}");
    folder.succeed("generate job.toml --quiet --out set --overwrite");
    assert_same_files(&before.into_iter().filter(|(name, _)| data(&name)).collect(), &{
        let mut files = folder.files("set");
        files.retain(|name, _| data(&name));
        files
    });
    folder.gelsim("verify set").assert().success();
}

#[test]
fn unpaired_sensors_feel_presses_of_their_own() {
    // One pad, so that contacts could be shared if presses were the same.
    let pad = "[sensor.unit]\ngelpad_thickness = 0.0\ngelpad_youngs_modulus = 0.0\n";
    let folder = Folder::with_job(&format!("{JOB}[sensors]\ncount = 2\npaired = false\n{pad}"));
    folder.succeed("generate job.toml --quiet --out set");
    let names = folders(&folder, "set");
    let [one, other] = [0, 1].map(|k| folder.labels(&format!("set/{}", names[k])));
    assert!(one.keys().all(|key| one[key]["pose"] != other[key]["pose"]));
    assert_each_is_its_own_jobs(&folder, "set");
}

#[test]
fn what_is_done_with_all_datasets_of_a_set_is_done_also_behind_one_that_is_none() {
    let folder = Folder::with_job(&job());
    folder.succeed("generate job.toml --quiet --out set");
    let names = folders(&folder, "set");
    for name in &names[..2] {
        fs::remove_file(folder.path(&format!("set/{name}/job.toml"))).expect("a job");
    }
    let output = folder.gelsim("verify set").output().expect("it runs");
    let [said, wrong] = [output.stdout, output.stderr].map(|text| String::from_utf8(text).expect("UTF-8"));
    assert_eq!(output.status.code(), Some(1), "{wrong}");
    for (k, name) in names.iter().enumerate() {
        assert_eq!(wrong.contains(&format!("set/{name} is no dataset")), k < 2, "{wrong}");
        assert_eq!(said.contains(&format!("set/{name}: 8 samples")), k >= 2, "{said}");
    }
    let output = folder.gelsim("report set").output().expect("it runs");
    let wrong = String::from_utf8(output.stderr).expect("UTF-8");
    assert_eq!((output.status.code(), &*output.stdout), (Some(1), &b"set/report.html\n"[..]), "{wrong}");
    let page = folder.read("set/report.html");
    for (k, name) in names.iter().enumerate() {
        assert_eq!(wrong.contains(&format!("set/{name} is no dataset")), k < 2, "{wrong}");
        assert_eq!(page.contains(&format!("href=\"{name}/report.html\"")), k >= 2);
    }
}

#[test]
fn a_set_that_is_refused_stays_as_it_is() {
    let folder = with_presses(PRESSES);
    folder.succeed("generate job.toml --quiet --out set");
    let before = folder.files("set");
    let another = edited(&folder.read("job.toml"), &[("from = [", "from = [\"digit\", "), ("seed = 7", "seed = 8")]);
    folder.write("another.toml", another);
    let said = folder.fail("generate another.toml --out set", 2);
    assert!(said.contains("set/gelsight-mini-0000 holds a dataset of another job"), "{said}");
    let without = edited(&folder.read("job.toml"), &[("calibration = \"jobs/presses.toml\"\n", "")]);
    folder.write("without.toml", without);
    let said = folder.fail("generate without.toml --out set", 2);
    assert!(said.contains("holds a set with a folder that this job has not: calibration"), "{said}");
    assert_same_files(&before, &folder.files("set"));
    folder.succeed("generate without.toml --quiet --out set --overwrite");
    assert!(!folder.path("set/calibration").exists());
    folder.gelsim("verify set").assert().success();
}

#[test]
fn what_is_lost_of_a_set_is_made_again_as_the_message_says() {
    let folder = with_presses(PRESSES);
    let remedy = "gelsim generate JOB.toml --out set makes it again";
    folder.succeed("generate job.toml --quiet --out set --partition 1/2");
    for command in ["finalize set", "verify set/calibration"] {
        let output = folder.gelsim(command).output().expect("it runs");
        let wrong = String::from_utf8(output.stderr).expect("UTF-8");
        assert_eq!(output.status.code(), Some(if command == "finalize set" { 1 } else { 2 }), "{wrong}");
        assert!(wrong.contains("set/calibration is no dataset") && wrong.contains(remedy), "{wrong}");
    }
    folder.succeed("generate job.toml --quiet --out set");
    let whole = lasting(&folder, "set");
    for lost in
        ["sensors.json", "calibration/sensors.json", "calibration/gelsight-mini-0000", "gelsight-2017-0001/job.toml"]
    {
        let path = folder.path(&format!("set/{lost}"));
        if path.is_dir() { fs::remove_dir_all(path) } else { fs::remove_file(path) }.expect("it was there");
        let output = folder.gelsim("verify set").output().expect("it runs");
        let wrong = String::from_utf8(output.stderr).expect("UTF-8");
        assert!(!output.status.success(), "{lost}");
        let way_out = if lost == "sensors.json" { "gelsim generate JOB.toml --out` that folder" } else { remedy };
        assert!(wrong.contains(way_out), "{lost}: {wrong}");
        folder.succeed("generate job.toml --quiet --out set");
        assert_same_files(&whole, &lasting(&folder, "set"));
        folder.gelsim("verify set").assert().success();
    }
}

#[test]
fn folders_of_datasets_and_of_others_are_no_sets() {
    let folder = Folder::with_job(&job());
    folder.write("small.toml", JOB);
    folder.succeed("generate small.toml --quiet --out small");
    let said = folder.fail("generate job.toml --out small", 2);
    assert!(said.contains("small holds a dataset of one sensor"), "{said}");
    fs::create_dir(folder.path("mine")).expect("a folder");
    folder.write("mine/notes.txt", "notes");
    let said = folder.fail("generate job.toml --out mine", 2);
    assert!(said.contains("mine is not empty and holds no set of gelsim"), "{said}");
    folder.succeed("generate job.toml --quiet --out set");
    let said = folder.fail("generate small.toml --out set", 2);
    assert!(said.contains("set is not empty and holds no dataset of gelsim"), "{said}");
    for command in ["preview set --out sheet.png", "reproduce set 0"] {
        let said = folder.fail(command, 2);
        assert!(said.contains("set is a set of 4 sensors, each a dataset"), "{said}");
        assert!(said.contains("such as set/gelsight-mini-0000"), "{said}");
    }
    folder.write("set/sensors.json", r#"{ "set_version": 99, "generator": "9.1.0", "sensors": [] }"#);
    let said = folder.fail("generate job.toml --out set", 2);
    assert!(said.contains("was written by gelsim 9.1.0, which is newer than this one"), "{said}");
}

#[test]
fn mistakes_are_found_before_anything_is_made() {
    let with = |sensors: &str| format!("{JOB}\n{sensors}\n");
    let cases = [
        ("[sensors]", "[sensors] names no sensors"),
        ("[sensors]\nfrom = []", "the list of sensors is empty"),
        ("[sensors]\ncount = 0", "count = 0 is out of range"),
        ("[sensors]\ncount = 1001", "count = 1001 is out of range"),
        ("[sensors]\nfrom = [\"digits\"]", "no sensor preset is called `digits`"),
        ("[sensors]\nfrom = [\"gone.toml\"]", "cannot read the sensor file gone.toml"),
        ("[sensors]\nfrom = \"digit\"", "expected a list"),
        ("[sensors]\nfrom = [3]", "expected text in quotes"),
    ];
    for (sensors, expected) in cases {
        let folder = Folder::with_job(&with(sensors));
        let said = folder.fail("generate job.toml --out set", 2);
        assert!(said.contains(expected) && said.matches("error:").count() == 1, "{sensors}: {said}");
        assert!(!folder.path("set").exists());
    }
    let others = [
        ("resolution_px = [48, 36]", "preset = \"digit\"", "both `sensor.preset` and `sensors.from` name the sensor"),
        ("[output]", "[output]\non_unhealthy = \"reject\"", "samples that one sensor draws again are no pairs"),
    ];
    for (from, to, expected) in others {
        let text = edited(&with("[sensors]\nfrom = [\"digit\"]\ncount = 2"), &[(from, to)]);
        let folder = Folder::with_job(&text);
        let said = folder.fail("generate job.toml --out set", 2);
        assert!(said.contains(expected), "{said}");
    }
    // Mistakes of several sensors, and of the job itself, come together and once.
    let several = with("[sensors]\nfrom = [\"digit\", \"gone.toml\", \"nope\"]");
    let folder = Folder::with_job(&edited(&several, &[("no_contact = 0.25", "no_contact = 2.5")]));
    let said = folder.fail("generate job.toml --out set", 2);
    assert_eq!(said.matches("error:").count(), 3, "{said}");
}

#[test]
fn commands_for_one_sensor_say_which_one_they_show() {
    let folder = Folder::with_job(&job());
    let said = folder.succeed("preview job.toml --out sheet.png --count 2");
    assert!(said.contains("the job has 4 sensors; this shows gelsight-mini"), "{said}");
    let plan = folder.stdout_of("plan job.toml --quiet");
    assert!(plan.contains("all    4 sensors: 32 samples"), "{plan}");
}

/// Presses for calibration: six of a cone and of a cube, in turn.
const PRESSES: &str = "
[dataset]
samples = 6
object_order = \"in_turn\"

[[object]]
path = \"../cone.obj\"

[[object]]
path = \"../cube.obj\"

[indentation]
depth_mm = 0.5

[output]
layers = [\"reference\"]
";

/// The job with calibration presses in a file of another folder.
fn with_presses(presses: &str) -> Folder {
    let folder = Folder::with_job(&job().replace("[sensors]\n", "[sensors]\ncalibration = \"jobs/presses.toml\"\n"));
    fs::create_dir(folder.path("jobs")).expect("a folder");
    folder.write("jobs/presses.toml", presses);
    folder
}

#[test]
fn calibration_presses_are_made_under_the_same_units_and_kept_apart() {
    let folder = with_presses(PRESSES);
    let plan = folder.stdout_of("plan job.toml --quiet");
    assert!(plan.contains("and 6 calibration presses of each"), "{plan}");
    folder.succeed("generate job.toml --quiet --out set");
    let names = folders(&folder, "set");
    assert_eq!(folders(&folder, "set/calibration"), names);
    for name in &names {
        let (samples, presses) =
            (folder.labels(&format!("set/{name}")), folder.labels(&format!("set/calibration/{name}")));
        assert_eq!((samples.len(), presses.len()), (8, 6));
        let sensor = |labels: &BTreeMap<String, Value>| labels.values().next().expect("a label")["sensor"].clone();
        assert_eq!(sensor(&samples), sensor(&presses), "{name}");
    }
    let said = folder.stdout_of("verify set");
    assert_eq!(said.matches("valid and complete").count(), 8, "{said}");
    // The set itself is the same as without them, and divided runs make them once.
    fs::write(folder.path("plain.toml"), job()).expect("a job");
    folder.succeed("generate plain.toml --quiet --out plain");
    let mut set = lasting(&folder, "set");
    set.retain(|name, _| !name.starts_with("calibration/") && name != "sensors.json" && name != "README.md");
    let mut plain = lasting(&folder, "plain");
    plain.retain(|name, _| name != "sensors.json" && name != "README.md");
    assert_same_files(&set, &plain);
    for part in [1, 0] {
        folder.succeed(&format!("generate job.toml --quiet --out parts --partition {part}/2"));
    }
    assert_same_files(&lasting(&folder, "set"), &lasting(&folder, "parts"));
    // They can be added later.
    folder.succeed("generate job.toml --quiet --out plain");
    assert_same_files(&lasting(&folder, "set"), &lasting(&folder, "plain"));
    assert_each_is_its_own_jobs(&folder, "set/calibration");
}

#[test]
fn mistakes_in_the_calibration_presses_are_told_with_their_file() {
    let cases = [
        (
            "[indentation]",
            "[sensor]\npreset = \"digit\"\n[indentation]",
            "the calibration presses have `sensor` of their own",
        ),
        ("depth_mm = 0.5", "depth_mm = -0.5", "depth_mm"),
        ("cone.obj", "gone.obj", "gone.obj"),
        ("depth_mm = 0.5", "depth_mm = ", "presses.toml"),
    ];
    for (from, to, expected) in cases {
        let folder = with_presses(&edited(PRESSES, &[(from, to)]));
        let said = folder.fail("generate job.toml --out set", 2);
        assert!(said.contains(expected) && said.contains("presses.toml:"), "{said}");
        assert!(!folder.path("set").exists());
    }
    let folder = Folder::with_job(&job().replace("[sensors]\n", "[sensors]\ncalibration = \"presses.toml\"\n"));
    let said = folder.fail("generate job.toml --out set", 2);
    assert!(said.contains("cannot read the job of the calibration presses") && said.contains("presses.toml"), "{said}");
}

#[test]
fn a_side_that_pads_do_not_agree_on_is_refused() {
    // A block with fine ridges on one side, within every pad, and tall steps on the other, of which a thin pad sees little.
    let ridge = |x: f64, low: f64, high: f64, wide: f64, first: usize| {
        let corner = |k: usize| {
            [
                x + if k & 1 == 1 { wide } else { -wide },
                if k & 2 == 2 { 5.0 } else { -5.0 },
                if k & 4 == 4 { high } else { low },
            ]
        };
        let vertices: String = (0..8).map(corner).map(|[x, y, z]| format!("v {x} {y} {z}\n")).collect();
        let quads = [[0, 2, 3, 1], [4, 5, 7, 6], [0, 1, 5, 4], [2, 6, 7, 3], [0, 4, 6, 2], [1, 3, 7, 5]];
        let faces: String =
            quads.map(|quad| format!("f {}\n", quad.map(|k| (first + k + 1).to_string()).join(" "))).concat();
        vertices + &faces
    };
    let mut text = ridge(0.0, -2.0, 2.0, 6.0, 0);
    for k in 0..5 {
        text += &ridge(-4.0 + 2.0 * f64::from(k), 2.0, 2.35, 0.5, 8 * (k as usize + 1));
    }
    for (k, low) in [(5, -2.5), (6, -3.0), (7, -3.5), (8, -4.0), (9, -4.5)] {
        text += &ridge(-4.0 + 2.0 * f64::from(k - 5), low, -2.0, 0.9, 8 * (k as usize + 1));
    }
    let folder = Folder::with_job(&edited(
        &job(),
        &[
            ("path = \"cube.obj\"", "path = \"stepped.obj\""),
            ("[pose]", "[pose]\nface = \"auto\""),
            ("depth_mm = { log_uniform = [0.3, 1.2] }", "depth_mm = 0.1"),
            ("from = [\"gelsight-mini\", \"gelsight-2017\"]", "from = [\"gelsight-mini\", \"thin.toml\"]"),
        ],
    ));
    folder.write("stepped.obj", &text);
    folder.write("thin.toml", "preset = \"gelsight-mini\"\nname = \"thin\"\ngelpad_thickness_mm = 0.5\n");
    let said = folder.fail("generate job.toml --out set", 2);
    assert!(said.contains("presses another side of stepped.obj into thin than into gelsight-mini"), "{said}");
}

#[test]
fn a_set_has_a_card_and_a_page_that_lead_to_its_datasets() {
    let folder = with_presses(PRESSES);
    folder.succeed("generate job.toml --quiet --out set");
    let card = folder.read("set/README.md");
    let said = ["pretty_name: \"small\"", "# small\n", "4 tactile sensors", "the same press under every sensor"];
    for text in said.into_iter().chain(["| gelsight-2017-0001 |", "`calibration/` has", "gelsim.load(\".\").pairs()"]) {
        assert!(card.contains(text), "{text}: {card}");
    }
    assert_eq!(folder.stdout_of("report set"), "set/report.html\n");
    let page = folder.read("set/report.html");
    for name in folders(&folder, "set") {
        for each in [name.clone(), format!("calibration/{name}")] {
            assert!(page.contains(&format!("href=\"{each}/report.html\"")), "{each}");
            assert!(folder.path(&format!("set/{each}/report.html")).exists(), "{each}");
        }
    }
    // A page elsewhere leads to the same pages, whose links start from its own folder.
    fs::create_dir(folder.path("pages")).expect("a folder");
    assert_eq!(folder.stdout_of("report set --out pages/set.html"), "pages/set.html\n");
    let name = &folders(&folder, "set")[0];
    assert!(folder.read("pages/set.html").contains(&format!("href=\"../set/{name}/report.html\"")));
    // The same command goes on, and writes a card that was lost.
    fs::remove_file(folder.path("set/README.md")).expect("the card");
    folder.succeed("generate job.toml --quiet --out set");
    assert_eq!(folder.read("set/README.md"), card);
}
