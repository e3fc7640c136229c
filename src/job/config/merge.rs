//! Merges assignments of the command line over a document, and the sensor that it names under its `[sensor]`.

use std::io;
use std::path::Path;

use serde::de::DeserializeOwned;

use gelsim_files::diagnostic::{Diagnostic, Diagnostics};
use gelsim_files::foreign::decode_text;
use gelsim_files::input;
use gelsim_files::sensor;
use gelsim_files::source::SourceSpan;

use super::document::{self, Document, TomlNode, TomlValue};
use super::file_kind::FileKind;
use super::sensors::Sensors;
use super::{guesses, random, reader};

/// A file with a `[sensor]` table that was read and merged, and the places of its keys.
pub struct MergedDocument<T> {
    /// The value, with defaults for what is not written or not readable.
    pub value: T,
    /// All its sources and the merged tree.
    pub document: Document,
    /// Whether the text is not TOML, or another kind of file; then nothing else is reported about it.
    pub broken: bool,
    /// Whether the sensor file or preset that it names could be read.
    pub sensor_known: bool,
    /// The same file with each of its other presets, if it names several.
    pub other_presets: Vec<(T, Document)>,
    /// The same file with the sensor of a gripper's right finger, if there is one.
    pub right_finger: Option<(T, Document)>,
    /// The presets, if it names several.
    pub presets: Option<random::SensorPresets>,
    /// The same file with each further sensor of `[sensors]`.
    pub further_sensors: Vec<Self>,
    /// The calibration presses of `[sensors]`, as a job with the same sensors.
    pub calibration: Option<Box<Self>>,
}

/// Reads `text` as a `T`, which is a file of this `kind`. The assignments `set` (flag and assignment each) are merged
/// over it, and the sensor that it names is merged under its `[sensor]`, `[markers]` and `[camera]`. Errors of form are
/// added to `problems`.
pub fn read_merged<T: DeserializeOwned + Default>(
    kind: FileKind,
    name: &str,
    text: String,
    folder: &Path,
    set: &[(String, String)],
    problems: &mut Diagnostics,
) -> MergedDocument<T> {
    let document = Document::parse(name, text, folder, problems);
    if problems.is_empty() {
        problems.extend(kind.explain_other(&document.root, name));
    }
    if !problems.is_empty() {
        return MergedDocument {
            value: T::default(),
            document,
            broken: true,
            sensor_known: false,
            other_presets: Vec::new(),
            right_finger: None,
            presets: None,
            further_sensors: Vec::new(),
            calibration: None,
        };
    }
    merge_document(document, set, problems)
}

pub(super) fn merge_document<T: DeserializeOwned + Default>(
    mut document: Document,
    set: &[(String, String)],
    problems: &mut Diagnostics,
) -> MergedDocument<T> {
    for (flag, assignment) in set {
        apply_override(&mut document, flag, assignment, problems);
    }
    let calibration = Sensors::take_calibration(&mut document, problems).map(|own| {
        let merged = merge_document(own, &[], problems);
        // Documents of one job know all texts read so far, since places refer to texts by their index.
        document.sources.clone_from(&merged.document.sources);
        Box::new(merged)
    });
    let mut further = Vec::new();
    for mut own in Sensors::split_document(&mut document, problems) {
        own.sources.clone_from(&document.sources);
        let (value, sensor_known) = read_with_sensor(&mut own, problems);
        document.sources.clone_from(&own.sources);
        further.push(MergedDocument {
            value,
            document: own,
            broken: false,
            sensor_known,
            other_presets: Vec::new(),
            right_finger: None,
            presets: None,
            further_sensors: Vec::new(),
            calibration: None,
        });
    }
    let right = split_right_finger(&mut document);
    let several = random::SensorPresets::take_from(&mut document, problems).unwrap_or_default();
    let (value, sensor_known) = read_with_sensor(&mut document, problems);
    let right = right.map(|mut right| {
        // Both documents must know all texts, since places refer to texts by their index.
        right.sources.clone_from(&document.sources);
        let (value, _) = read_with_sensor(&mut right, problems);
        document.sources.clone_from(&right.sources);
        (value, right)
    });
    let mut others = Vec::new();
    let mut presets = None;
    if several.len() > 1 {
        for (of_preset, mut other) in several {
            // All documents must know all texts, since places refer to texts by their index.
            other.sources.clone_from(&document.sources);
            if presets.is_some() {
                let (value, _) = read_with_sensor(&mut other, problems);
                document.sources.clone_from(&other.sources);
                others.push((value, other));
            }
            presets = Some(of_preset);
        }
    }
    MergedDocument {
        value,
        document,
        broken: false,
        sensor_known,
        other_presets: others,
        right_finger: right,
        presets,
        further_sensors: further,
        calibration,
    }
}

/// Splits off the document of the right finger, if a gripper has a sensor for it. Its `[sensor]` is the table
/// `gripper.right`; the job's own markers and camera are not part of it. An empty table stays in the document itself.
fn split_right_finger(document: &mut Document) -> Option<Document> {
    let finger = document.get("gripper.right").filter(|node| matches!(node.value, TomlValue::Table(_)))?.clone();
    let mut right = document.clone();
    ["gripper", "sensor", "markers", "camera"].into_iter().for_each(|name| right.remove(name));
    let place = finger.place;
    let path = |keys: &[&str]| keys.iter().map(|key| (*key).to_owned()).collect::<Vec<_>>();
    right.set(&path(&["sensor"]), place, finger).expect("a document is a table");
    let empty = TomlNode { place, value: TomlValue::Table(Vec::new()) };
    document.set(&path(&["gripper", "right"]), place, empty).expect("it is there");
    Some(right)
}

/// Reads a document over the sensor that it names. The second value is false if that sensor cannot be read.
fn read_with_sensor<T: DeserializeOwned + Default>(document: &mut Document, problems: &mut Diagnostics) -> (T, bool) {
    move_relaxation(document, problems);
    let sensor_known = merge_sensor_below(document, problems);
    for table in ["markers", "camera"] {
        document.move_table_up("sensor", table);
    }
    let (random, plain) = random::take_distributions(document, problems);
    document.random = random;
    let value = reader::read_node(plain.as_ref().unwrap_or(&document.root), problems).unwrap_or_default();
    (value, sensor_known)
}

/// Moves `[gelpad] relaxation`, which is a short form of `[sensor] gelpad_relaxation`, to its place.
fn move_relaxation(document: &mut Document, problems: &mut Diagnostics) {
    let both = document.get("sensor.gelpad_relaxation").is_some();
    let Some(place) = document.move_key(["gelpad", "relaxation"], ["sensor", "gelpad_relaxation"]) else { return };
    if both {
        let problem = Diagnostic::new("the relaxation of the gelpad is given twice")
            .at(place)
            .help("keep one of `[gelpad] relaxation` and `[sensor] gelpad_relaxation`: they are the same");
        problems.push(problem);
    }
}

fn apply_override(document: &mut Document, flag: &str, assignment: &str, problems: &mut Diagnostics) {
    let source = document.sources.len();
    let mut found = Diagnostics::default();
    let tree = document.add_source(flag, assignment.to_owned(), Path::new(""), &mut found);
    let key = assignment.split('=').next().unwrap_or_default();
    let key_place = SourceSpan { source, start: 0, end: key.trim_end().len() };
    let mut path: Vec<String> = Vec::new();
    let mut node: &TomlNode = &tree;
    // A dotted key is parsed to nested tables of one key each, which give the path. There are as many steps as the key
    // has dots outside quotes; this keeps an inline table as the value from being taken for more path.
    let steps = count_dotted_steps(key);
    while path.len() < steps
        && let TomlValue::Table(entries) = &node.value
        && let [entry] = entries.as_slice()
    {
        path.push(entry.key.clone());
        node = &entry.node;
    }
    if !found.is_empty() || path.len() != steps {
        let problem = Diagnostic::new(format!("not an assignment: `{assignment}`"))
            .at(SourceSpan { source, start: 0, end: assignment.len() })
            .help(suggest_assignment(flag, assignment, &found));
        problems.push(problem);
        return;
    }
    let node = node.clone();
    if let Err(reason) = document.set(&path, key_place, node) {
        problems.push(Diagnostic::new(reason).at(key_place));
    }
}

/// Says how to mend an assignment whose text has these errors.
fn suggest_assignment(flag: &str, assignment: &str, found: &Diagnostics) -> String {
    let Some(help) = found.iter().find_map(|problem| problem.help.clone()).filter(|_| assignment.contains('=')) else {
        return String::from(
            "write dotted.path=VALUE with a TOML value, for example --set 'sensor.resolution_px=[320, 240]' or --set 'dataset.name=\"mine\"'",
        );
    };
    // A shell takes quotes away that do not stand within others.
    match help.strip_prefix("write `").and_then(|line| line.split_once('`')) {
        Some((line, rest)) if flag.starts_with("--") && !line.contains('\'') => format!("write {flag} '{line}'{rest}"),
        _ => help,
    }
}

fn count_dotted_steps(key: &str) -> usize {
    let mut quote = None;
    1 + key
        .chars()
        .filter(|&c| {
            match (quote, c) {
                (None, '"' | '\'') => quote = Some(c),
                (Some(open), c) if open == c => quote = None,
                _ => {}
            }
            c == '.' && quote.is_none()
        })
        .count()
}

/// Suggests what to do if the sensor file called `written` cannot be read.
fn suggest_sensor_file(path: &Path, written: &str, error: &io::Error, is_flag: bool) -> String {
    let preset = |name: &str| if is_flag { format!("--sensor {name}") } else { format!("preset = \"{name}\"") };
    let names = sensor::PRESETS.map(|(name, _)| name);
    let is_name = !written.contains(['/', '\\']) && !written.ends_with(".toml");
    let same_names = |path: &Path| path.extension().is_some_and(|ending| ending == "toml");
    match (guesses::guess_choice(written, &names).filter(|_| is_name), error.kind()) {
        (Some(name), _) => format!("did you mean the preset? {}", preset(name)),
        (None, io::ErrorKind::NotFound) => match input::suggest_file_name(path, same_names) {
            Some(near) => format!("did you mean {}?", Path::new(written).with_file_name(near).display()),
            None if is_flag => {
                String::from("paths start from the current folder; gelsim list sensors shows the presets")
            }
            None => String::from("a path is relative to the file it stands in; gelsim list sensors shows the presets"),
        },
        _ if path.is_dir() => String::from("name the sensor file in it, which ends in .toml"),
        _ => String::from("a sensor file is a text in UTF-8, such as gelsim calibrate writes: save it so"),
    }
}

/// Merges the sensor file and the preset that the job names under its `[sensor]` table. Returns false if one cannot be
/// read.
fn merge_sensor_below(document: &mut Document, problems: &mut Diagnostics) -> bool {
    let mut known = true;
    let preset_key = document.get("sensor.preset").cloned();
    if let Some(file) = document.get("sensor.file").cloned()
        && let Some(written) = file.as_str()
    {
        if preset_key.is_some() {
            let problem = Diagnostic::new("both `preset` and `file` name a sensor")
                .at(file.place)
                .help("keep one; a sensor file may itself start with `preset = \"...\"`");
            problems.push(problem);
        }
        let path = document.folder_of("sensor.file").join(written);
        let text =
            input::read(&path, document::MAX_READ_BYTES).and_then(|bytes| decode_text(bytes).map_err(io::Error::other));
        match text {
            Ok(text) => {
                let folder = path.parent().unwrap_or(Path::new("")).to_owned();
                let mut found = Diagnostics::default();
                let name = path.display().to_string();
                let tree = document.add_source(&name, text, &folder, &mut found);
                if found.is_empty() {
                    found.extend(FileKind::Sensor.explain_other(&tree, &name).map(|other| other.at(file.place)));
                }
                known = found.is_empty();
                problems.extend(found);
                if let Some(second) = tree.child("file") {
                    let problem = Diagnostic::new("a sensor file cannot start from another one")
                        .at(second.place)
                        .help("it may start from a preset: preset = \"...\"");
                    problems.push(problem);
                }
                if known {
                    document.merge_table_below("sensor", tree);
                }
            }
            Err(error) => {
                known = false;
                let is_flag = document.sources.first().is_some_and(|source| source.name == "--sensor");
                let message = format!("cannot read the sensor file {}: {error}", path.display());
                let help = suggest_sensor_file(&path, written, &error, is_flag);
                problems.push(Diagnostic::new(message).at(file.place).help(help));
            }
        }
    }
    let Some(preset) = document.get("sensor.preset").cloned() else { return known };
    let Some(name) = preset.as_str() else { return false };
    let names = sensor::PRESETS.map(|(name, _)| name);
    match sensor::PRESETS.iter().find(|(known, _)| *known == name) {
        Some((_, text)) => {
            let label = format!("preset {name}");
            let tree = document.add_source(&label, (*text).to_owned(), Path::new(""), problems);
            document.merge_table_below("sensor", tree);
            known
        }
        None => {
            let help = guesses::suggest_choice(name, &names);
            problems.push(Diagnostic::new(format!("no sensor preset is called `{name}`")).at(preset.place).help(help));
            false
        }
    }
}
