//! What people write who know other programs: each guess is answered with what is meant here, and what is advised works.

use crate::support::{Folder, JOB, edited};

/// What is said of a command line that is wrong.
fn refusal_of(folder: &Folder, arguments: &str) -> String {
    let assert = folder.gelsim(arguments).assert().code(2);
    String::from_utf8_lossy(&assert.get_output().stderr).into_owned()
}

#[test]
fn flags_and_commands_of_other_programs_are_answered() {
    let folder = Folder::with_job(JOB);
    for (arguments, answer) in [
        ("generate job.toml --n 3", "'--samples'"),
        ("generate job.toml --num-samples 3", "'--samples'"),
        ("generate job.toml --force", "'--overwrite'"),
        ("generate job.toml --dry-run", "gelsim plan JOB.toml"),
        ("generate job.toml --resolution 64", "--set 'sensor.resolution_px=[320, 240]'"),
        ("generate job.toml --workers 2", "'--threads'"),
        ("generate job.toml --debug", "'--verbose'"),
        ("generate job.toml --gpu", "it runs on CPUs"),
        ("render job.toml", "gelsim generate JOB.toml"),
        ("list presets", "'sensors'"),
        ("list rung", "'levels'"),
        ("version", "gelsim --version"),
        ("generate job.toml --samples 1k", "write a whole number: 1000"),
        ("generate job.toml --samples 3.5", "write a whole number"),
        ("preview job.toml --out a.png --key abc", "write a whole number"),
    ] {
        let said = refusal_of(&folder, arguments);
        assert!(said.contains(answer), "{arguments}: {answer}\n{said}");
        assert!(!said.contains("invalid digit"), "{said}");
    }
    // Without the Python module the command says how to have it.
    let export = folder.gelsim("export out --to zarr --out z").env("PATH", folder.path("")).assert().code(2);
    let text = String::from_utf8_lossy(&export.get_output().stderr).into_owned();
    assert!(text.contains("pip install '.[export]'"), "{text}");
}

#[test]
fn short_flags_are_those_that_people_know() {
    let folder = Folder::with_job(JOB);
    folder.succeed("generate job.toml -n 2 -o short -j 1 -q");
    folder.succeed("generate job.toml --samples 2 --out long --threads 1 --quiet");
    assert_eq!(folder.lasting_files("short"), folder.lasting_files("long"));
    assert_eq!(folder.labels("short").len(), 2);
    let shown = folder.gelsim("plan job.toml -v").assert().success();
    assert!(!shown.get_output().stdout.is_empty());
}

/// What is written in the job in place of something, what is said of it, and what is to be written instead; none where the
/// answer is elsewhere.
const KEYS: [(&str, &str, &str, &str); 48] = [
    (
        "resolution_px",
        "background_image = \"rest.png\"\nresolution_px",
        "`background`",
        "background = \"rest.png\"\nresolution_px",
    ),
    ("resolution_px", "leds = 3\nresolution_px", "[[sensor.led]]", ""),
    (
        "resolution_px",
        "variation = 1.0\nresolution_px",
        "[sensor.unit] variation",
        "unit.variation = 1.0\nresolution_px",
    ),
    ("resolution_px", "noise = 1.0\nresolution_px", "under [camera]: read_noise_levels", ""),
    ("resolution_px", "type = \"digit\"\nresolution_px", "`preset`", "preset = \"digit\"\nresolution_px"),
    ("resolution_px", "preset = \"DIGIT\"\nresolution_px", "`digit`", "preset = \"digit\"\nresolution_px"),
    ("resolution_px = [48, 36]", "resolution_px = \"48x36\"", "`resolution_px = [48, 36]`", "resolution_px = [48, 36]"),
    ("seed = 7", "dir = \"x\"", "--out DIR", ""),
    ("seed = 7", "seed = \"random\"", "`seed = 7`", "seed = 7"),
    ("seed = 7", "n_samples = 3", "`samples`", "seed = 7"),
    ("samples = 8", "samples = \"8\"", "`samples = 8`", "samples = 8"),
    ("samples = 8", "samples = 3e1", "`samples = 30`", "samples = 30"),
    (
        "{ train = 0.5, val = 0.25, test = 0.25 }",
        "[0.5, 0.25, 0.25]",
        "`splits = { train = 0.5, val = 0.25, test = 0.25 }`",
        "{ train = 0.5, val = 0.25, test = 0.25 }",
    ),
    ("path = \"cube.obj\"", "mesh = \"cube.obj\"", "`path`", "path = \"cube.obj\""),
    ("path = \"cube.obj\"", "path = \"cube.obj\"\nunit = \"meters\"", "`m`", "path = \"cube.obj\"\nunit = \"mm\""),
    ("path = \"cube.obj\"", "path = \"*.fbx\"", ".glb, .obj, .ply or .stl", ""),
    ("path = \"cube.obj\"", "path = \"cube.obj\"\nsplit = \"test\"", "split_by = \"object\"", ""),
    ("weight = 2.0", "frequency = 2.0", "`weight`", "weight = 2.0"),
    ("\nyaw_deg", "\nyaw", "`yaw_deg`", "\nyaw_deg"),
    ("\ntilt_deg = {", "\nrx_deg = 1.0\ntilt_deg = {", "`roll_deg`", ""),
    ("y_mm = [-2.0, 2.0]", "y_mm = { min = -2.0, max = 2.0 }", "`y_mm = [-2, 2]`", "y_mm = [-2, 2]"),
    ("[pose]", "[randomize]\na = 1\n[pose]", "[sensor.unit] variation", ""),
    ("[pose]", "[randomization]\n[pose]", "[sensor.unit] variation", ""),
    ("[dataset]", "markers = true\n[dataset]", "[markers] with pitch_mm = 1.5", "markers.pitch_mm = 1.5\n[dataset]"),
    ("[output]", "[shear]\nx_mm = 0.2\nfriction = 0.5\n[output]", "{ coulomb = { coefficient = 0.5 } }", ""),
    ("no_contact = 0.25", "normal_force = 2.0", "`force_n`", ""),
    ("[output]", "[shear]\nforce = 2.0\n[output]", "under [indentation]: force_n", ""),
    ("no_contact = 0.25", "penetration = 1.0", "`depth_mm`", "no_contact = 0.25"),
    ("\"contact\"]", "\"heightmap\"]", "`surface`", "\"surface\"]"),
    ("\"contact\"]", "\"mask\"]", "`contact`", "\"contact\"]"),
    ("\"contact\"]", "\"force\"]", "`pressure`", "\"pressure\"]"),
    ("\"contact\"]", "\"contact\"]\ncontainer = \"hdf5\"", "gelsim-export", ""),
    ("\"contact\"]", "\"contact\"]\ncontainer = \"webdataset\"", "`tar`", "\"contact\"]\ncontainer = \"tar\""),
    ("[\"depth\", \"contact\"]", "\"all\"", "gelsim list layers", ""),
    (
        "[\"depth\", \"contact\"]",
        "\"normals, mask\"",
        "`layers = [\"normal\", \"contact\"]`",
        "[\"normal\", \"contact\"]",
    ),
    ("y_mm = [-2.0, 2.0]", "y_mm = [1.5]", "`y_mm = 1.5`", "y_mm = 1.5"),
    (
        "y_mm = [-2.0, 2.0]",
        "y_mm = [0.1, 0.2, 0.3]",
        "{ choice = [0.1, 0.2, 0.3] }",
        "y_mm = { choice = [0.1, 0.2, 0.3] }",
    ),
    (
        "y_mm = [-2.0, 2.0]",
        "y_mm = { uniform = { min = -1.0, max = 1.5 } }",
        "`uniform = [-1, 1.5]`",
        "y_mm = { uniform = [-1, 1.5] }",
    ),
    (
        "resolution_px = [48, 36]",
        "resolution_px = { width = 48, height = 36 }",
        "`resolution_px = [48, 36]`",
        "resolution_px = [48, 36]",
    ),
    ("resolution_px = [48, 36]", "resolution_px = [48.0, 36]", "write `48`", "resolution_px = [48, 36]"),
    ("resolution_px", "camera_resolution", "`resolution_px`", "resolution_px"),
    ("[pose]", "[lighting]\n[pose]", "[[sensor.led]]", ""),
    ("[pose]", "[gel]\nthickness_mm = 4.0\n[pose]", "gelpad_thickness_mm", ""),
    ("path = \"cube.obj\"", "path = [\"cube.obj\", \"cone.obj\"]", "one table for each file", ""),
    ("path = \"cube.obj\"", "path = \"cube.obj\"\nrotation = 90.0", "under [pose]: yaw_deg = 90.0", ""),
    ("name = \"small\"", "name = my-set", "`name = \"my-set\"`", "name = \"my-set\""),
    ("samples = 8", "samples: 8", "`samples = 8`", "samples = 8"),
    ("[\"depth\", \"contact\"]", "\"depth\"", "`layers = [\"depth\"]`", "[\"depth\"]"),
];

#[test]
fn keys_and_values_of_other_programs_are_answered_with_what_works_here() {
    let folder = Folder::new();
    image::RgbImage::from_pixel(48, 36, image::Rgb([90, 100, 110])).save(folder.path("rest.png")).expect("a picture");
    for (from, guess, answer, mended) in KEYS {
        folder.write("job.toml", edited(JOB, &[(from, guess)]));
        let said = refusal_of(&folder, "plan job.toml");
        assert!(said.contains(answer), "{guess}: {answer}\n{said}");
        assert_eq!(said.matches("error: ").count(), 1, "{said}");
        for word in ["invalid type", "array of length", "u64", "i64", "usize", "f64", "serde"] {
            assert!(!said.contains(word), "{word}: {said}");
        }
        if !mended.is_empty() {
            folder.write("job.toml", edited(JOB, &[(from, mended)]));
            folder.succeed("plan job.toml --samples 2 --quiet");
        }
    }
}

#[test]
fn a_sensor_by_its_name_alone_is_answered_with_its_table() {
    let without = edited(JOB, &[("[sensor]\nresolution_px = [48, 36]\n", "")]);
    let folder = Folder::with_job(&format!("sensor = \"digit\"\n{without}"));
    assert!(refusal_of(&folder, "plan job.toml").contains("[sensor] with preset = \"digit\""));
}

#[test]
fn other_languages_are_recognised() {
    let folder = Folder::new();
    for (text, language) in [
        ("dataset:\n  name: t\n  samples: 4\n", "YAML"),
        ("---\ndataset:\n  name: t\n", "YAML"),
        ("{ \"dataset\": { \"name\": \"t\" } }\n", "JSON"),
    ] {
        folder.write("job.toml", text);
        let said = refusal_of(&folder, "plan job.toml");
        assert!(said.contains(&format!("it looks like {language}")), "{text}\n{said}");
        assert_eq!(said.matches("error: ").count(), 1, "{said}");
    }
}

#[test]
fn what_can_be_chosen_is_listed_for_people_and_for_programs() {
    let folder = Folder::new();
    let shown = |arguments: &str| {
        let assert = folder.gelsim(arguments).assert().success();
        String::from_utf8_lossy(&assert.get_output().stdout).into_owned()
    };
    for (what, word) in [("levels", "standard"), ("layers", "surface"), ("sensors", "digit"), ("effects", "shadows")] {
        let text = shown(&format!("list {what}"));
        assert!(text.contains(word) && !text.contains("{\""), "{text}");
        let json: serde_json::Value = serde_json::from_str(&shown(&format!("list {what} --json"))).expect("JSON");
        assert!(json.to_string().contains(word), "{json}");
    }
    assert_eq!(shown("list rungs"), shown("list levels"));
}
