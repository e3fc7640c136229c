//! A job for the meshes of a folder: what `gelsim init --objects` writes.

use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};

use glob::Pattern;
use rayon::prelude::*;

use super::{Inspection, inspect, set};
use gelsim_core::gelpad::USUAL_DEPTHS;
use gelsim_core::sensor::Sensor;
use gelsim_files::diagnostic::{Diagnostic, Diagnostics, Report, Severity, user_error};
use gelsim_files::figures::{counted, figure};
use gelsim_files::length::{Unit, is_plausible};
use gelsim_files::mesh::{ENDINGS, Format, Reading};
use gelsim_files::spelling::shell_word;
use gelsim_job::inspection::SensorPad;
use gelsim_job::inspection::findings::{self, Kind};

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

/// A job, and what there is to know of its meshes.
#[derive(Debug)]
pub struct Written {
    /// The job.
    pub text: String,
    /// What is to be acted on, with the units that the job gives them.
    pub notes: Report,
}

/// The job, which presses every mesh of the folder with a sensor of this preset; paths in it start from the folder of `file`, or
/// from the current one.
///
/// # Errors
///
/// A folder that cannot be read, or that holds no mesh that can be used; an unknown preset.
pub fn of_folder(folder: &Path, preset: &str, file: Option<&Path>) -> Result<Written, Report> {
    let shown = folder.display();
    let unreadable = |reason: String| user_error(format!("{shown} {reason}"), "name a folder of meshes");
    if !folder.is_dir() {
        return Err(unreadable(String::from(if folder.exists() { "is no folder" } else { "does not exist" })));
    }
    let pad = SensorPad::preset(preset).ok_or_else(|| unreadable(format!("there is no sensor {preset}")))?;
    let (found, _) = set::meshes(folder).map_err(|error| unreadable(format!("cannot be read: {error}")))?;
    let groups = groups(folder, found);
    if groups.is_empty() {
        let message = format!("there is no mesh in {shown}");
        return Err(user_error(message, format!("meshes are files that end in {ENDINGS}")));
    }
    let from = relative(folder, file)
        .ok_or_else(|| unreadable(String::from("has a path that is not UTF-8, which no job can name")))?;
    let name = std::path::absolute(folder).ok().and_then(|path| Some(path.file_name()?.to_string_lossy().into_owned()));
    let mut objects = String::new();
    let mut good = 0;
    let mut notes = Diagnostics::default();
    for group in &groups {
        let look = |path: &PathBuf| inspect(path, Reading::default(), &pad);
        let inspected: Vec<Inspection> = group.files.par_iter().map(look).collect();
        good += inspected.iter().filter(|mesh| mesh.mesh.is_some()).count();
        let sizes = sizes(group, &inspected, &pad);
        // What is of the size is answered by the unit that the job gives it.
        let again = |(path, size): (&PathBuf, &Size)| match size {
            Size::In(unit) => Some(inspect(path, Reading { mm_per_unit: Some(unit.mm()), ..Reading::default() }, &pad)),
            Size::AsItIs | Size::Long => None,
        };
        let again: Vec<Option<Inspection>> = group.files.par_iter().zip(&sizes).map(again).collect();
        for ((path, size), (first, again)) in group.files.iter().zip(&sizes).zip(inspected.iter().zip(&again)) {
            let of_size = |kind: Kind| matches!(size, Size::Long) && kind == Kind::Normalised;
            let found = again.as_ref().unwrap_or(first).findings.iter().filter(|finding| !of_size(finding.kind));
            notes.extend(found.map(|finding| {
                let said = finding.diagnostic(&path.display().to_string());
                // The job leaves it out.
                match finding.severity {
                    Severity::Error => Diagnostic { severity: Severity::Warning, ..said },
                    _ => said,
                }
            }));
        }
        objects += &tables(&from, folder, group, &inspected, &sizes, &pad);
    }
    if good == 0 {
        let message = format!("no mesh in {shown} can be used");
        return Err(user_error(message, format!("gelsim inspect {} says why", shell_word(folder))));
    }
    let text = format!(
        "# {} in {}. Look first:  gelsim preview {} --out {}\n\
         # Every key is explained in the job that gelsim init prints.\n\n\
         [dataset]\nname = \"{}\"\nsamples = {}\n\
         splits = {{ train = 0.8, val = 0.1, test = 0.1 }}\n\
         # split_by = \"object\"                     # whole objects in one split: test objects are unseen in training\n\n\
         [sensor]\npreset = \"{preset}\"\n\n\
         {objects}\
         [pose]\n\
         face = \"any\"                              # any side of the object faces the pad; \"auto\": the one with relief\n\
         yaw_deg = [0.0, 360.0]\n\
         tilt_deg = [0.0, 5.0]\n\
         {}\
         anchor = \"contact\"                        # the point that touches first stays in view\n\n\
         [indentation]\n\
         {}                 # the pad is {} mm thick\n\n\
         [output]\nlayers = [\"depth\", \"contact\"]\n",
        counted(good, "mesh", "meshes"),
        printed(&from),
        file.map_or(String::from("THIS-FILE"), shell_word),
        file.map_or(String::from("sheet.png"), |file| shell_word(&file.with_extension("png"))),
        dataset_name(name.as_deref().unwrap_or("objects")),
        (20 * good).clamp(200, 100_000),
        places(preset, &pad),
        depths(&pad),
        figure(pad.thickness_mm),
    );
    Ok(Written { text, notes: Report::new(&notes, &[]) })
}

/// Where presses usually are on the pad of a preset, as lines of `[pose]`.
pub fn places(preset: &str, pad: &SensorPad) -> String {
    match gelsim_files::sensor::preset(preset) {
        // From all sides, as far as a camera inside sees well.
        Ok(Sensor { shape: Some(shape), pins: None, .. }) => format!(
            "from_tip_mm = [0.0, {}]                 # over the gel, along its curve\naround_deg = [0.0, 360.0]\n",
            figure(FROM_TIP * shape.radius_mm())
        ),
        _ => {
            let [x, y] = pad.field_of_view_mm.map(|mm| figure(SHIFT * mm));
            format!("x_mm = [-{x}, {x}]\ny_mm = [-{y}, {y}]\n")
        }
    }
}

/// How deep presses usually go into a pad, as a line of `[indentation]`.
pub fn depths(pad: &SensorPad) -> String {
    let [low, high] = USUAL_DEPTHS.map(|share| figure(share * pad.thickness_mm));
    format!("depth_mm = [{low}, {high}]")
}

/// What a job says of a mesh's size.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Size {
    /// Nothing: it is as large as its file says.
    AsItIs,
    /// That its coordinates are in a unit.
    In(Unit),
    /// How long it is, because nothing else says so.
    Long,
}

/// What the job says of the size of each mesh of a group. Files of one exporter are in one unit: the likely unit of most of them is
/// that of all, if it makes all of them as large as what is pressed.
fn sizes(group: &Group, inspected: &[Inspection], pad: &SensorPad) -> Vec<Size> {
    let own: Vec<Size> = inspected
        .iter()
        .map(|mesh| match mesh.mesh.as_ref() {
            Some(facts) if facts.size.is_normalised() => Size::Long,
            Some(facts) => facts.size.likely_unit(pad).map_or(Size::AsItIs, |(unit, _)| Size::In(unit)),
            None => Size::AsItIs,
        })
        .collect();
    let facts = || inspected.iter().filter_map(|mesh| mesh.mesh.as_ref());
    let fits = |unit: Unit| {
        let length_mm = |facts: &super::MeshFacts| facts.largest_mm() / facts.mm_per_unit * unit.mm();
        facts().all(|facts| is_plausible(length_mm(facts), pad.field_of_view_mm))
    };
    let in_it = |unit: &Unit| own.iter().filter(|size| **size == Size::In(*unit)).count();
    let most = Unit::ALL.into_iter().max_by_key(in_it);
    match most.filter(|unit| 2 * in_it(unit) > facts().count() && fits(*unit)) {
        Some(unit) => vec![Size::In(unit); group.files.len()],
        None => own,
    }
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

/// The `[[object]]` of a group: one, or one for each file where they differ in what is to be said of their size.
fn tables(
    from: &str,
    folder: &Path,
    group: &Group,
    inspected: &[Inspection],
    sizes: &[Size],
    pad: &SensorPad,
) -> String {
    let size = |size: Size, count: usize| {
        let of = if group.format.knows_its_unit() { ", against what the file says" } else { "" };
        match size {
            Size::AsItIs => String::new(),
            Size::In(unit) if count == 1 => {
                format!("unit = \"{}\"               # a guess from its size{of}\n", unit.name())
            }
            Size::In(unit) => {
                format!("unit = \"{}\"               # a guess from the sizes of {count}{of}\n", unit.name())
            }
            Size::Long => format!(
                "length_mm = {}          # longest side, or [min, max]: nothing in the file says how large it is\n",
                figure(findings::usual_mm(pad))
            ),
        }
    };
    let named = |name: &str, is_pattern: bool| {
        let before = if is_pattern { Pattern::escape(from) } else { from.to_owned() };
        let path = if from.is_empty() { name.to_owned() } else { format!("{before}/{name}") };
        format!("[[object]]\npath = {}\n", toml::Value::String(path))
    };
    let stems: BTreeSet<_> = group.files.iter().filter_map(|path| path.file_stem()).collect();
    // Where few share theirs, the folders that tell those apart name their classes anyway.
    let class =
        if 2 * stems.len() <= group.files.len() { "class_from = \"folder\"   # files share their names\n" } else { "" };
    let is_bad = |mesh: &Inspection| mesh.mesh.is_none();
    if sizes.iter().all(|other| *other == sizes[0]) {
        let bad = inspected.iter().filter(|mesh| is_bad(mesh)).count();
        let skip = match bad {
            0 => String::new(),
            _ => format!("on_bad = \"skip\"         # {bad} of {} cannot be read\n", inspected.len()),
        };
        return named(&group.pattern, true) + &size(sizes[0], inspected.len() - bad) + class + &skip + "\n";
    }
    let each = group.files.iter().zip(inspected.iter().zip(sizes)).filter(|(_, (mesh, _))| !is_bad(mesh));
    let table = |(path, (_, of)): (&PathBuf, (&Inspection, &Size))| {
        let name = path.strip_prefix(folder).unwrap_or(path).to_string_lossy().replace('\\', "/");
        // What stands for other characters in a pattern stands for itself where a file of that name is there.
        named(&name, false) + &size(*of, 1) + class + "\n"
    };
    each.map(table).collect()
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
