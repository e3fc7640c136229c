//! Writes a job for the meshes of a folder: `gelsim init --objects`.

use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};

use glob::Pattern;
use rayon::prelude::*;

use super::{Inspection, inspect_mesh, set};
use gelsim_core::gelpad::USUAL_DEPTHS;
use gelsim_core::sensor::Sensor;
use gelsim_files::diagnostic::{Diagnostic, Diagnostics, Report, Severity, user_error};
use gelsim_files::length::{Unit, is_plausible_length};
use gelsim_files::mesh::{ENDINGS, Format, MeshReadOptions};
use gelsim_files::number_format::{format_count, format_number};
use gelsim_files::spelling::quote_for_shell;
use gelsim_job::inspection::SensorPad;
use gelsim_job::inspection::findings::{self, FindingKind};

/// Share of the view's sides by which objects are moved from its middle at most.
const SHIFT: f64 = 0.1;
/// How far from the tip of a curved gel objects are pressed at most, radii of the gel.
const FROM_TIP: f64 = 1.5;

/// Meshes with one ending.
struct MeshGroup {
    /// Pattern that matches them, relative to the folder.
    pattern: String,
    files: Vec<PathBuf>,
    format: Format,
}

/// A job that was written for a folder.
#[derive(Debug)]
pub struct GeneratedJob {
    /// Text of the job.
    pub text: String,
    /// Notes on the meshes, read with the units that the job gives them.
    pub notes: Report,
}

/// Writes a job that presses each mesh of the folder with a sensor of this preset. Paths in it start from the folder of
/// `file`, or from the current one.
///
/// # Errors
///
/// A folder that cannot be read, or that holds no mesh that can be used; an unknown preset.
pub fn job_for_folder(folder: &Path, preset: &str, file: Option<&Path>) -> Result<GeneratedJob, Report> {
    let shown = folder.display();
    let unreadable = |reason: String| user_error(format!("{shown} {reason}"), "name a folder of meshes");
    if !folder.is_dir() {
        return Err(unreadable(String::from(if folder.exists() { "is no folder" } else { "does not exist" })));
    }
    let pad = SensorPad::from_preset(preset).ok_or_else(|| unreadable(format!("there is no sensor {preset}")))?;
    let (found, _) = set::find_meshes(folder).map_err(|error| unreadable(format!("cannot be read: {error}")))?;
    let groups = group_by_ending(folder, found);
    if groups.is_empty() {
        let message = format!("there is no mesh in {shown}");
        return Err(user_error(message, format!("meshes are files that end in {ENDINGS}")));
    }
    let from = relative_folder(folder, file)
        .ok_or_else(|| unreadable(String::from("has a path that is not UTF-8, which no job can name")))?;
    let name = std::path::absolute(folder).ok().and_then(|path| Some(path.file_name()?.to_string_lossy().into_owned()));
    let mut objects = String::new();
    let mut good = 0;
    let mut notes = Diagnostics::default();
    for group in &groups {
        let look = |path: &PathBuf| inspect_mesh(path, MeshReadOptions::default(), &pad);
        let inspected: Vec<Inspection> = group.files.par_iter().map(look).collect();
        good += inspected.iter().filter(|mesh| mesh.mesh.is_some()).count();
        let sizes = decide_sizes(group, &inspected, &pad);
        // Findings about the size are settled by the unit that the job states: look at the mesh again with it.
        let again = |(path, size): (&PathBuf, &SizeStatement)| match size {
            SizeStatement::In(unit) => Some(inspect_mesh(
                path,
                MeshReadOptions { mm_per_unit: Some(unit.mm_per_unit()), ..MeshReadOptions::default() },
                &pad,
            )),
            SizeStatement::AsItIs | SizeStatement::Long => None,
        };
        let again: Vec<Option<Inspection>> = group.files.par_iter().zip(&sizes).map(again).collect();
        for ((path, size), (first, again)) in group.files.iter().zip(&sizes).zip(inspected.iter().zip(&again)) {
            let of_size = |kind: FindingKind| matches!(size, SizeStatement::Long) && kind == FindingKind::Normalised;
            let found = again.as_ref().unwrap_or(first).findings.iter().filter(|finding| !of_size(finding.kind));
            notes.extend(found.map(|finding| {
                let said = finding.to_diagnostic(&path.display().to_string());
                // The job skips meshes that cannot be read, so an error in one is only a warning here.
                match finding.severity {
                    Severity::Error => Diagnostic { severity: Severity::Warning, ..said },
                    _ => said,
                }
            }));
        }
        objects += &format_object_tables(&from, folder, group, &inspected, &sizes, &pad);
    }
    if good == 0 {
        let message = format!("no mesh in {shown} can be used");
        return Err(user_error(message, format!("gelsim inspect {} says why", quote_for_shell(folder))));
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
        format_count(good, "mesh", "meshes"),
        escape_folder(&from),
        file.map_or(String::from("THIS-FILE"), quote_for_shell),
        file.map_or(String::from("sheet.png"), |file| quote_for_shell(&file.with_extension("png"))),
        dataset_name(name.as_deref().unwrap_or("objects")),
        (20 * good).clamp(200, 100_000),
        format_pose_lines(preset, &pad),
        format_depth_line(&pad),
        format_number(pad.thickness_mm),
    );
    Ok(GeneratedJob { text, notes: Report::new(&notes, &[]) })
}

/// Formats the usual range of positions on the pad of a preset, as lines of `[pose]`.
pub fn format_pose_lines(preset: &str, pad: &SensorPad) -> String {
    match gelsim_files::sensor::load_preset(preset) {
        // From all sides of the gel, as far from its tip as the camera inside sees well.
        Ok(Sensor { shape: Some(shape), pins: None, .. }) => format!(
            "from_tip_mm = [0.0, {}]                 # over the gel, along its curve\naround_deg = [0.0, 360.0]\n",
            format_number(FROM_TIP * shape.radius_mm())
        ),
        _ => {
            let [x, y] = pad.field_of_view_mm.map(|mm| format_number(SHIFT * mm));
            format!("x_mm = [-{x}, {x}]\ny_mm = [-{y}, {y}]\n")
        }
    }
}

/// Formats the usual depths of presses into a pad, as a line of `[indentation]`.
pub fn format_depth_line(pad: &SensorPad) -> String {
    let [low, high] = USUAL_DEPTHS.map(|share| format_number(share * pad.thickness_mm));
    format!("depth_mm = [{low}, {high}]")
}

/// What a job states about a mesh's size.
#[derive(Clone, Copy, Debug, PartialEq)]
enum SizeStatement {
    /// Nothing: its file states the size.
    AsItIs,
    /// The unit of its coordinates.
    In(Unit),
    /// Its length, because nothing else tells it.
    Long,
}

/// Decides what the job states about the size of each mesh of a group. One exporter writes one unit: the likely unit of
/// most files is taken for all, if all have a plausible size in it.
fn decide_sizes(group: &MeshGroup, inspected: &[Inspection], pad: &SensorPad) -> Vec<SizeStatement> {
    let own: Vec<SizeStatement> = inspected
        .iter()
        .map(|mesh| match mesh.mesh.as_ref() {
            Some(facts) if facts.size.is_normalised() => SizeStatement::Long,
            Some(facts) => {
                facts.size.guess_unit(pad).map_or(SizeStatement::AsItIs, |(unit, _)| SizeStatement::In(unit))
            }
            None => SizeStatement::AsItIs,
        })
        .collect();
    let facts = || inspected.iter().filter_map(|mesh| mesh.mesh.as_ref());
    let fits = |unit: Unit| {
        let length_mm = |facts: &super::MeshFacts| facts.largest_mm() / facts.mm_per_unit * unit.mm_per_unit();
        facts().all(|facts| is_plausible_length(length_mm(facts), pad.field_of_view_mm))
    };
    let in_it = |unit: &Unit| own.iter().filter(|size| **size == SizeStatement::In(*unit)).count();
    let most = Unit::ALL.into_iter().max_by_key(in_it);
    match most.filter(|unit| 2 * in_it(unit) > facts().count() && fits(*unit)) {
        Some(unit) => vec![SizeStatement::In(unit); group.files.len()],
        None => own,
    }
}

/// Groups meshes by their endings as written. If two endings name the same objects, the format that comes first is
/// taken. Robots are taken only if there is nothing else, because their meshes are in the folder, too.
fn group_by_ending(folder: &Path, found: Vec<PathBuf>) -> Vec<MeshGroup> {
    let mut by_ending: BTreeMap<String, Vec<PathBuf>> = BTreeMap::new();
    for path in found {
        if let Some(ending) = path.extension().and_then(|ending| ending.to_str()) {
            by_ending.entry(ending.to_owned()).or_default().push(path);
        }
    }
    let mut groups: Vec<MeshGroup> = Vec::new();
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
            groups.push(MeshGroup { pattern, files: files.clone(), format });
        }
    }
    groups
}

/// Formats the `[[object]]` tables of a group: one, or one per file if they need different statements about their size.
fn format_object_tables(
    from: &str,
    folder: &Path,
    group: &MeshGroup,
    inspected: &[Inspection],
    sizes: &[SizeStatement],
    pad: &SensorPad,
) -> String {
    let size = |size: SizeStatement, count: usize| {
        let of = if group.format.has_known_unit() { ", against what the file says" } else { "" };
        match size {
            SizeStatement::AsItIs => String::new(),
            SizeStatement::In(unit) if count == 1 => {
                format!("unit = \"{}\"               # a guess from its size{of}\n", unit.name())
            }
            SizeStatement::In(unit) => {
                format!("unit = \"{}\"               # a guess from the sizes of {count}{of}\n", unit.name())
            }
            SizeStatement::Long => format!(
                "length_mm = {}          # longest side, or [min, max]: nothing in the file says how large it is\n",
                format_number(findings::usual_length_mm(pad))
            ),
        }
    };
    let named = |name: &str, is_pattern: bool| {
        let before = if is_pattern { Pattern::escape(from) } else { from.to_owned() };
        let path = if from.is_empty() { name.to_owned() } else { format!("{before}/{name}") };
        format!("[[object]]\npath = {}\n", toml::Value::String(path))
    };
    let stems: BTreeSet<_> = group.files.iter().filter_map(|path| path.file_stem()).collect();
    // If few names are shared, the folders that tell those files apart name their classes anyway.
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
    let table = |(path, (_, of)): (&PathBuf, (&Inspection, &SizeStatement))| {
        let name = path.strip_prefix(folder).unwrap_or(path).to_string_lossy().replace('\\', "/");
        // No escape: characters of a pattern are taken literally if a file of that name exists.
        named(&name, false) + &size(*of, 1) + class + "\n"
    };
    each.map(table).collect()
}

/// Returns the folder as the job names it; `None` if it is not UTF-8.
fn relative_folder(folder: &Path, file: Option<&Path>) -> Option<String> {
    if folder.is_absolute() {
        return folder.to_str().map(str::to_owned);
    }
    let base = file.and_then(Path::parent).unwrap_or(Path::new(""));
    let [folder, base] =
        [folder, base].map(|path| std::path::absolute(if path == Path::new("") { Path::new(".") } else { path }));
    let relative = pathdiff::diff_paths(folder.ok()?, base.ok()?)?;
    relative.to_str().map(str::to_owned)
}

/// Returns the folder for a comment of the job.
fn escape_folder(path: &str) -> String {
    if path.is_empty() { String::from("this folder") } else { path.escape_debug().to_string() }
}

/// Returns a name that is valid for a dataset.
fn dataset_name(folder: &str) -> String {
    let allowed = |c: char| if c.is_ascii_alphanumeric() || matches!(c, '-' | '_' | '.') { c } else { '-' };
    let name: String = folder.chars().map(allowed).take(60).collect();
    let name = name.trim_start_matches(['.', '-']);
    if name.is_empty() { String::from("objects") } else { name.to_owned() }
}
