//! A job for the meshes of a folder: what `gelsim init --objects` writes.

use std::collections::{BTreeMap, BTreeSet};
use std::fmt::Write;
use std::path::{Path, PathBuf};

use glob::Pattern;

use super::{Inspection, inspect_set, set};
use crate::core::gelpad::USUAL_DEPTHS;
use crate::core::sensor::Sensor;
use crate::files::diagnostic::Severity;
use crate::files::diagnostic::{Report, user_error};
use crate::files::figures::{counted, figure};
use crate::files::mesh::{ENDINGS, Format, Reading};
use crate::job::config::object::Unit;
use crate::job::inspection::SensorPad;

/// Share of the view's sides by which objects are moved out of its middle.
const SHIFT: f64 = 0.1;
/// How far from the tip of a curved gel, in its radii.
const FROM_TIP: f64 = 1.5;

/// Meshes of one ending.
struct Group {
    /// The pattern that names them, below the folder.
    pattern: String,
    files: Vec<PathBuf>,
    format: Format,
}

/// The job, which presses every mesh of the folder with a sensor of this preset; paths in it start from the folder of `file`, or
/// from the current one.
///
/// # Errors
///
/// A folder that cannot be read, or that holds no mesh that can be used; an unknown preset.
pub fn of_folder(folder: &Path, preset: &str, file: Option<&Path>) -> Result<String, Report> {
    let unreadable = |reason: String| user_error(format!("{}: {reason}", folder.display()), "name a folder of meshes");
    if !folder.is_dir() {
        return Err(unreadable(String::from(if folder.exists() { "is no folder" } else { "does not exist" })));
    }
    let pad = SensorPad::preset(preset).ok_or_else(|| unreadable(format!("there is no sensor {preset}")))?;
    let (found, _) = set::meshes(folder).map_err(|error| unreadable(error.to_string()))?;
    let groups = groups(folder, found);
    if groups.is_empty() {
        let message = format!("there is no mesh in {}", folder.display());
        return Err(user_error(message, format!("meshes are files that end in {ENDINGS}")));
    }
    let from = relative(folder, file).ok_or_else(|| unreadable(String::from("its path is not UTF-8")))?;
    let name = std::path::absolute(folder).ok().and_then(|path| Some(path.file_name()?.to_string_lossy().into_owned()));
    let mut objects = String::new();
    let mut good = 0;
    for group in &groups {
        let inspected = inspect_set(&group.files, Reading::default(), &pad, || {});
        good += inspected.iter().filter(|mesh| mesh.mesh.is_some()).count();
        objects += &table(&from, group, &inspected, &pad);
    }
    if good == 0 {
        let message = format!("no mesh in {} can be used", folder.display());
        return Err(user_error(message, format!("gelsim inspect {} says why", folder.display())));
    }
    let [low, high] = USUAL_DEPTHS.map(|share| figure(share * pad.thickness_mm));
    let place = match Sensor::preset(preset) {
        // From all sides, as far as a camera inside sees well.
        Ok(Sensor { shape: Some(shape), pins: None, .. }) => format!(
            "from_tip_mm = [0.0, {}]                 # over the gel, along its curve\naround_deg = [0.0, 360.0]\n",
            figure(FROM_TIP * shape.radius_mm())
        ),
        _ => {
            let [x, y] = pad.field_of_view_mm.map(|mm| figure(SHIFT * mm));
            format!("x_mm = [-{x}, {x}]\ny_mm = [-{y}, {y}]\n")
        }
    };
    Ok(format!(
        "# {} in {}. Look first:  gelsim preview THIS-FILE --out sheet.png\n\
         # Every key: gelsim init my-job.toml\n\n\
         [dataset]\nname = \"{}\"\nsamples = {}\n\
         splits = {{ train = 0.8, val = 0.1, test = 0.1 }}\n\n\
         [sensor]\npreset = \"{preset}\"\n\n\
         {objects}\
         [pose]\n\
         face = \"any\"                              # any side of the object faces the pad; \"auto\": the one with relief\n\
         yaw_deg = [0.0, 360.0]\n\
         tilt_deg = [0.0, 5.0]\n\
         {place}\
         anchor = \"contact\"                        # the point that touches first stays in view\n\n\
         [indentation]\n\
         depth_mm = [{low}, {high}]                 # the pad is {} mm thick\n\n\
         [output]\nlayers = [\"depth\", \"contact\"]\n",
        counted(good, "mesh", "meshes"),
        printed(&from),
        dataset_name(name.as_deref().unwrap_or("objects")),
        (20 * good).clamp(200, 100_000),
        figure(pad.thickness_mm),
    ))
}

/// The meshes by their endings as written. Where two endings name the same objects, that of the first in the order of formats;
/// robots only where there is nothing else, since their meshes are there, too.
fn groups(folder: &Path, found: Vec<PathBuf>) -> Vec<Group> {
    let mut by_ending: BTreeMap<String, Vec<PathBuf>> = BTreeMap::new();
    for path in found {
        if let Some(ending) = path.extension().and_then(|ending| ending.to_str()) {
            by_ending.entry(ending.to_owned()).or_default().push(path);
        }
    }
    let mut groups: Vec<Group> = Vec::new();
    for format in Format::ALL {
        for (ending, files) in &by_ending {
            if Format::from_path(&files[0]) != Some(format) || (format == Format::Urdf && !groups.is_empty()) {
                continue;
            }
            let bare = |files: &[PathBuf]| files.iter().map(|path| path.with_extension("")).collect::<BTreeSet<_>>();
            if groups.iter().any(|group| bare(&group.files) == bare(files)) {
                continue;
            }
            let flat = files.iter().all(|path| path.parent() == Some(folder));
            let pattern = if flat { format!("*.{ending}") } else { format!("**/*.{ending}") };
            groups.push(Group { pattern, files: files.clone(), format });
        }
    }
    groups
}

/// The `[[object]]` of a group.
fn table(from: &str, group: &Group, inspected: &[Inspection], pad: &SensorPad) -> String {
    let path =
        if from.is_empty() { group.pattern.clone() } else { format!("{}/{}", Pattern::escape(from), group.pattern) };
    let mut text = format!("[[object]]\npath = {}\n", toml::Value::String(path));
    let facts: Vec<_> = inspected.iter().filter_map(|mesh| mesh.mesh.as_ref()).collect();
    let likely = |unit: Unit| {
        let is_it = |facts: &&&super::MeshFacts| {
            let found = Unit::likely(facts.mm_per_unit, facts.largest_mm(), pad.field_of_view_mm);
            found.is_some_and(|(likely, _)| likely == unit)
        };
        facts.iter().filter(is_it).count()
    };
    let guess = Unit::ALL.into_iter().max_by_key(|unit| likely(*unit)).filter(|unit| 2 * likely(*unit) > facts.len());
    if let Some(unit) = guess {
        let (count, all) = (likely(unit), facts.len());
        let of = if group.format.knows_its_unit() { ", against what the files say" } else { "" };
        let _ = writeln!(text, "unit = \"{}\"        # a guess from the sizes of {count} of {all}{of}", unit.name());
    }
    let stems: BTreeSet<_> = group.files.iter().filter_map(|path| path.file_stem()).collect();
    // Where few share theirs, the folders that tell those apart name their classes anyway.
    if 2 * stems.len() <= group.files.len() {
        text += "class_from = \"folder\"   # files share their names\n";
    }
    let bad = inspected.iter().filter(|mesh| mesh.severity == Some(Severity::Error) && mesh.mesh.is_none()).count();
    if bad > 0 {
        let _ = writeln!(text, "on_bad = \"skip\"         # {bad} of {} cannot be read", inspected.len());
    }
    text + "\n"
}

/// The folder as the job names it; `None` if it is not UTF-8.
fn relative(folder: &Path, file: Option<&Path>) -> Option<String> {
    if folder.is_absolute() {
        return folder.to_str().map(str::to_owned);
    }
    let base = file.and_then(Path::parent).unwrap_or(Path::new(""));
    let [folder, base] =
        [folder, base].map(|path| std::path::absolute(if path == Path::new("") { Path::new(".") } else { path }));
    let relative = pathdiff::diff_paths(folder.ok()?, base.ok()?)?;
    relative.to_str().map(str::to_owned)
}

fn printed(path: &str) -> String {
    if path.is_empty() { String::from("this folder") } else { path.escape_debug().to_string() }
}

/// A name that a dataset may have.
fn dataset_name(folder: &str) -> String {
    let allowed = |c: char| if c.is_ascii_alphanumeric() || matches!(c, '-' | '_' | '.') { c } else { '-' };
    let name: String = folder.chars().map(allowed).take(60).collect();
    let name = name.trim_start_matches(['.', '-']);
    if name.is_empty() { String::from("objects") } else { name.to_owned() }
}
