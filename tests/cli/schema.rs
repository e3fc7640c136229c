//! What is committed agrees with the program: schemas, bundled jobs, sensors and meshes, the examples of the help.
//!
//! `UPDATE=1 cargo test --test program cli::schema` writes the schemas anew.

use std::fs;
use std::path::{Path, PathBuf};

use clap::CommandFactory;
use gelsim_cli::Arguments;
use gelsim_core::fidelity::Fidelity;
use gelsim_core::gelpad::Model;
use gelsim_files::diagnostic::{Diagnostics, Report};
use gelsim_files::sensor;
use gelsim_job::config::{self, Overrides};

use crate::support::{Folder, repository};

fn stdout(arguments: &str) -> String {
    let assert = Folder::new().gelsim(arguments).assert().success();
    String::from_utf8(assert.get_output().stdout.clone()).expect("UTF-8")
}

fn files(folder: &str, ending: &str) -> Vec<PathBuf> {
    let entries = fs::read_dir(repository().join(folder)).expect("a folder");
    let mut found: Vec<PathBuf> = entries.map(|entry| entry.expect("an entry").path()).collect();
    found.retain(|path| path.extension().is_some_and(|extension| extension == ending));
    found.sort();
    assert!(!found.is_empty(), "{folder} holds no .{ending}");
    found
}

#[test]
fn the_committed_schemas_are_what_the_program_prints() {
    for format in ["job", "label", "sequence", "grip", "grip-sequence", "sensor", "augment"] {
        let printed = stdout(&format!("schema {format}"));
        let path = repository().join("docs/schema").join(format!("{format}.json"));
        if std::env::var_os("UPDATE").is_some() {
            fs::create_dir_all(path.parent().expect("a folder")).expect("docs/schema");
            fs::write(&path, &printed).expect("a schema");
        }
        let committed = fs::read_to_string(&path).unwrap_or_default();
        assert!(
            committed == printed,
            "docs/schema/{format}.json is out of date: UPDATE=1 cargo test --test program cli::schema"
        );
        let schema: serde_json::Value = serde_json::from_str(&printed).expect("JSON");
        assert!(schema["properties"].is_object() && schema["$schema"].is_string(), "{format}");
    }
}

#[test]
fn every_key_in_a_schema_is_described() {
    fn check(schema: &serde_json::Value, path: &str) {
        for (key, property) in schema["properties"].as_object().into_iter().flatten() {
            assert!(property["description"].is_string(), "{path}.{key} has no description");
        }
        for (name, definition) in schema["$defs"].as_object().into_iter().flatten() {
            check(definition, &format!("{path}/{name}"));
        }
    }
    for format in ["job", "label", "sequence", "grip", "grip-sequence", "sensor", "augment"] {
        check(&serde_json::from_str(&stdout(&format!("schema {format}"))).expect("JSON"), format);
    }
}

fn assert_no_problems_of_form(path: &Path) {
    let mut problems = Diagnostics::default();
    let written = config::read_job(path, &Overrides::default(), &mut problems).expect("a job");
    assert!(problems.is_empty(), "{}", Report::new(&problems, &written.document.sources));
}

#[test]
fn the_bundled_jobs_have_no_mistakes_of_form() {
    for path in files("configs", "toml") {
        // What augments a dataset is no job; tests/python runs it.
        if !path.ends_with("augment.toml") {
            assert_no_problems_of_form(&path);
        }
    }
}

#[test]
fn the_job_that_init_writes_runs_as_it_stands() {
    let folder = Folder::new();
    std::fs::create_dir(folder.path("jobs here")).expect("a folder");
    let assert = folder.gelsim("init").arg("jobs here/mine.toml").assert().success();
    let said = String::from_utf8_lossy(&assert.get_output().stderr).into_owned();
    assert!(said.contains("and jobs here/my-object.obj, a peg to press"), "{said}");
    assert_no_problems_of_form(&folder.path("jobs here/mine.toml"));
    assert_eq!(stdout("init"), folder.read("jobs here/mine.toml"));
    // The command that it prints, as a shell takes it.
    let next = said.split_once("next: gelsim ").expect("what is next").1.trim();
    assert_eq!(next, "preview 'jobs here/mine.toml' --out 'jobs here/mine.png'");
    let quoted = next.trim_start_matches("preview ").split('\'').enumerate().flat_map(|(at, part)| match at % 2 {
        1 => vec![part],
        _ => part.split_whitespace().collect(),
    });
    folder.gelsim("preview").args(quoted).assert().success();
    assert!(folder.path("jobs here/mine.png").is_file());

    // A mesh of the user's own stays.
    folder.write("my-object.obj", folder.read("cube.obj"));
    for (sensor, _) in gelsim_files::sensor::PRESETS {
        let job = format!("{sensor}.toml");
        folder.succeed(&format!("init --sensor {sensor} {job}"));
        assert_eq!(folder.read("my-object.obj"), folder.read("cube.obj"));
        let written = folder.read(&job);
        assert!(written.contains(&format!("\n[sensor]\npreset = \"{sensor}\"\n")), "{written}");
        let preset = gelsim_files::sensor::load_preset(sensor).expect("a preset");
        let [width, height] = preset.resolution_px;
        assert!(written.contains(&format!("\n# resolution_px = [{width}, {height}] ")), "{written}");
        assert_eq!(
            written.contains("[markers]"),
            preset.shape.is_none(),
            "curved gels have no printed dots: {written}"
        );
        let plan = folder.gelsim(&format!("plan {job} --strict --samples 4")).assert().success();
        let shown = String::from_utf8_lossy(&plan.get_output().stdout).into_owned();
        assert!(!shown.contains(", 0 in contact"), "{shown}");
    }
}

#[test]
fn every_default_that_init_shows_is_the_default() {
    // With the comment signs gone from lines that hold a key, nothing may change but keys without a default.
    let template = stdout("init");
    let key = |line: &str| {
        line.split_once(" = ").is_some_and(|(key, _)| key.chars().all(|c| c.is_ascii_lowercase() || c == '_'))
    };
    let open: Vec<String> = template
        .lines()
        .filter(|line| !line.contains("background") && !line.contains("class = ") && *line != "# [sensor]")
        .map(|line| line.strip_prefix("# ").filter(|rest| key(rest)).unwrap_or(line).to_owned())
        .collect();
    let text = open.join("\n").replace("\npreset", "\n[sensor]\npreset");
    let read = |text: &str| {
        let mut problems = Diagnostics::default();
        let written =
            config::read_job_text("init", text.to_owned(), Path::new(""), &Overrides::default(), &mut problems);
        assert!(problems.is_empty(), "{}", Report::new(&problems, &written.document.sources));
        let mut job = toml::Table::try_from(&written.job).expect("a table");
        let level = job.remove("fidelity").map_or(Fidelity::default().name().into(), |level| level);
        assert_eq!(level.as_str(), Some(Fidelity::default().name()), "the level that init shows");
        let sensor = job["sensor"].as_table_mut().expect("a table");
        sensor.remove("preset");
        job
    };
    assert_ne!(text, template);
    assert_eq!(read(&text), read(&template));
}

#[test]
fn init_does_not_replace_a_file() {
    let folder = Folder::with_job("mine");
    let text = folder.fail("init job.toml", 2);
    assert!(text.contains("job.toml exists already"), "{text}");
    assert_eq!(folder.read("job.toml"), "mine");
}

#[test]
fn the_sensor_presets_are_the_bundled_sensor_files() {
    let mut names: Vec<&str> = sensor::PRESETS.iter().map(|(name, _)| *name).collect();
    names.sort_unstable();
    let bundled = files("configs/sensors", "toml");
    let stems: Vec<_> = bundled.iter().filter_map(|path| path.file_stem()?.to_str()).collect();
    assert_eq!(names, stems);
    let listed = stdout("list sensors");
    for path in &bundled {
        let text = fs::read_to_string(path).expect("a sensor file");
        let read: sensor::Sensor = toml::from_str(&text).unwrap_or_else(|error| panic!("{}: {error}", path.display()));
        assert!(listed.lines().any(|line| line.split(' ').next() == Some(&read.name)), "{} in\n{listed}", read.name);
        let folder = Folder::with_job(crate::support::JOB);
        folder.succeed(&format!("generate job.toml --quiet --samples 1 --set sensor.preset=\"{}\"", read.name));
    }
}

#[test]
fn list_names_exactly_the_bundled_meshes() {
    let listed = stdout("list objects");
    let bundled = files("objects", "obj");
    let names: Vec<String> =
        bundled.iter().map(|path| format!("objects/{}", path.file_name().expect("a name").to_string_lossy())).collect();
    assert_eq!(listed.lines().collect::<Vec<_>>(), names);
}

#[test]
fn list_names_the_effects_of_the_labels() {
    let schema: serde_json::Value = serde_json::from_str(&stdout("schema label")).expect("JSON");
    let effects = schema["$defs"]["Effects"]["properties"].as_object().expect("effects");
    let listed = stdout("list effects");
    let names: Vec<&str> = listed.lines().filter_map(|line| line.split(' ').next()).collect();
    assert_eq!(names, effects.keys().collect::<Vec<_>>());
}

#[test]
fn the_schema_takes_every_level_bound_and_model_that_the_program_takes_and_no_other() {
    let schema: serde_json::Value = serde_json::from_str(&stdout("schema job")).expect("JSON");
    let property = |key: &str| schema["properties"][key]["anyOf"][0]["$ref"].as_str().expect("a definition").to_owned();
    let forms = |key: &str| {
        let definition = schema.pointer(property(key).trim_start_matches('#')).expect("a definition");
        definition["oneOf"].as_array().expect("a choice").clone()
    };
    let fidelity = forms("fidelity");
    let names: Vec<&str> = fidelity.iter().filter_map(|form| form["const"].as_str()).collect();
    assert_eq!(names, Fidelity::ALL.map(Fidelity::name));
    let bounds: Vec<&serde_json::Value> = fidelity.iter().filter(|form| form["type"] == "object").collect();
    for (form, key) in bounds.iter().zip(["max_error_um", "max_ms"]) {
        assert_eq!(form["properties"][key]["type"], "number", "{form}");
        assert_eq!(form["required"], serde_json::json!([key]));
        assert_eq!(form["additionalProperties"], false);
    }
    assert_eq!(names.len() + bounds.len(), fidelity.len());
    assert_eq!(bounds.len(), 2);
    assert!(fidelity.iter().all(|form| form["description"].as_str().is_some_and(|text| !text.contains("[`"))));

    let models = serde_json::to_string(&forms("gelpad")).expect("JSON");
    for model in ["none", "mean_blur", "gaussian", "elastic", "finite_strain"] {
        assert!(models.contains(&format!("\"{model}\"")), "{model} in {models}");
        let read: Model = serde_json::from_value(serde_json::json!({ model: {} })).expect("defaults for every key");
        assert_eq!(read.name(), model);
    }
}

#[test]
fn the_help_of_every_subcommand_has_an_example_that_names_it() {
    let arguments = Arguments::command();
    let names: Vec<&str> = arguments.get_subcommands().map(|command| command.get_name()).collect();
    assert!(names.contains(&"generate") && names.contains(&"preview"), "{names:?}");
    for name in names {
        let help = stdout(&format!("{name} --help"));
        let example = help.split_once("Example:\n").unwrap_or_else(|| panic!("no example in\n{help}")).1;
        assert!(example.contains(&format!("gelsim {name}")), "{example}");
    }
}

#[test]
fn there_is_a_completion_script_for_every_shell() {
    for shell in ["bash", "zsh", "fish", "elvish", "powershell"] {
        assert!(stdout(&format!("completions {shell}")).contains("gelsim"), "{shell}");
    }
}
