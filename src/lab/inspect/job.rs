//! Writes a job for the meshes of a folder: `gelsim init --objects`.

use std::collections::{BTreeMap, BTreeSet};
use std::path::Path;

use glob::{MatchOptions, Pattern};
use rayon::prelude::*;

use super::choose::{MeshOfSet, choose_by_name, drop_copies};
use super::{Inspection, MeshFacts, inspect_mesh, set};
use gelsim_core::gelpad::USUAL_DEPTHS;
use gelsim_core::sensor::Sensor;
use gelsim_files::diagnostic::{Diagnostic, Diagnostics, Report, Severity, user_error};
use gelsim_files::input::RelativePaths;
use gelsim_files::length::{Unit, is_plausible_length};
use gelsim_files::mesh::{ENDINGS, Format, MeshReadOptions};
use gelsim_files::number_format::{format_count, format_number};
use gelsim_files::spelling::quote_for_shell;
use gelsim_job::inspection::SensorPad;
use gelsim_job::inspection::findings;

/// Share of the view's sides by which objects are moved from its middle at most.
const SHIFT: f64 = 0.1;
/// How far from the tip of a curved gel objects are pressed at most, radii of the gel.
const FROM_TIP: f64 = 1.5;

/// Files that a job names one by one at most, if no one size or unit fits all of them.
const MAX_TABLES: usize = 16;

/// Meshes with one ending.
struct MeshGroup {
    /// Pattern that matches them and no others, relative to the folder, if there is one.
    pattern: Option<String>,
    format: Format,
    meshes: Vec<(MeshOfSet, Inspection)>,
}

impl MeshGroup {
    /// Facts about the meshes that can be read.
    fn facts(&self) -> impl Iterator<Item = &MeshFacts> {
        self.meshes.iter().filter_map(|(_, inspection)| inspection.mesh.as_ref())
    }
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
    if let Some(odd) = found.iter().find(|path| path.to_str().is_none()) {
        let message = format!("{} is not UTF-8, so that no job can hold it", odd.display());
        return Err(user_error(message, "rename the file or its folders"));
    }
    let found: Vec<MeshOfSet> = found.into_iter().filter_map(|path| MeshOfSet::new(folder, path)).collect();
    if found.is_empty() {
        let message = format!("there is no mesh in {shown}");
        return Err(user_error(message, format!("meshes are files that end in {ENDINGS}")));
    }
    let from = relative_folder(folder, file)
        .ok_or_else(|| unreadable(String::from("has a path that is not UTF-8, which no job can name")))?;
    let name = std::path::absolute(folder).ok().and_then(|path| Some(path.file_name()?.to_string_lossy().into_owned()));
    let look = |mesh: MeshOfSet| {
        let inspection = inspect_mesh(&mesh.path, MeshReadOptions::default(), &pad);
        (mesh, inspection)
    };
    let inspected = choose_by_name(found.clone()).into_par_iter().map(look).collect();
    let groups = group_meshes(&found, drop_copies(inspected));
    let mut objects = String::new();
    let mut notes = Diagnostics::default();
    let taken: usize = groups.iter().map(|group| group.meshes.len()).sum();
    if taken < found.len() {
        notes.push(note_left_out(&found, &groups, found.len() - taken));
    }
    let good = groups.iter().flat_map(MeshGroup::facts).count();
    for group in &groups {
        let sizes = decide_sizes(group, &pad);
        // Findings about the size are settled by what the job states: look at the mesh again with it.
        let again = |((mesh, first), size): (&(MeshOfSet, Inspection), &SizeStatement)| {
            let mm_per_unit = match size {
                SizeStatement::AsItIs => return None,
                SizeStatement::In(unit) => unit.mm_per_unit(),
                SizeStatement::Long(_) => {
                    let facts = first.mesh.as_ref()?;
                    findings::usual_length_mm(&pad) / facts.largest_mm() * facts.mm_per_unit
                }
            };
            let reading = MeshReadOptions { mm_per_unit: Some(mm_per_unit), ..MeshReadOptions::default() };
            Some(inspect_mesh(&mesh.path, reading, &pad))
        };
        let again: Vec<Option<Inspection>> = group.meshes.par_iter().zip(&sizes).map(again).collect();
        for ((mesh, first), again) in group.meshes.iter().zip(&again) {
            notes.extend(again.as_ref().unwrap_or(first).findings.iter().map(|finding| {
                let said = finding.to_diagnostic(&mesh.path.display().to_string());
                // The job skips meshes that cannot be read, so an error in one is only a warning here.
                match finding.severity {
                    Severity::Error => Diagnostic { severity: Severity::Warning, ..said },
                    _ => said,
                }
            }));
        }
        objects += &format_object_tables(&from, group, &sizes, &pad);
    }
    if good == 0 {
        let message = format!("no mesh in {shown} can be used");
        return Err(user_error(message, format!("gelsim inspect {} says why", quote_for_shell(folder))));
    }
    let text = format!(
        "# {} in {}. Look first:  gelsim preview {} --out {}\n\
         # The job that gelsim init prints explains more keys.\n\n\
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

/// Says which meshes the job leaves out because it takes others of the same objects.
fn note_left_out(found: &[MeshOfSet], groups: &[MeshGroup], count: usize) -> Diagnostic {
    let taken: BTreeSet<&str> =
        groups.iter().flat_map(|group| &group.meshes).map(|(mesh, _)| mesh.relative.as_str()).collect();
    let first = found.iter().find(|mesh| !taken.contains(mesh.relative.as_str())).map_or("", |mesh| &mesh.relative);
    let left = format_count(count, "mesh is left out", "meshes are left out");
    let message = format!("{left}, such as {first}: other forms of objects of which one is taken");
    Diagnostic::note(message).help("if you want other ones, change `path` under [[object]]")
}

/// What a job states about a mesh's size.
#[derive(Clone, Copy, Debug, PartialEq)]
enum SizeStatement {
    /// Nothing: its file states the size.
    AsItIs,
    /// The unit of its coordinates.
    In(Unit),
    /// Its length, because nothing else tells it, for this reason.
    Long(&'static str),
}

const NORMALISED: SizeStatement = SizeStatement::Long("nothing in the file says how large it is");
const NO_COMMON_UNIT: SizeStatement = SizeStatement::Long("no one unit fits the sizes of all files");

/// Decides what the job states about the size of each mesh of a group. One exporter writes one unit: what fits most
/// files is taken for all, unless others contradict it. If there are many and nothing fits, the job sets their length.
fn decide_sizes(group: &MeshGroup, pad: &SensorPad) -> Vec<SizeStatement> {
    let guess = |facts: &MeshFacts| match facts.size.guess_unit(pad) {
        _ if facts.size.is_normalised() => NORMALISED,
        Some((unit, _)) => SizeStatement::In(unit),
        None => SizeStatement::AsItIs,
    };
    let own = || group.meshes.iter().map(|(_, found)| found.mesh.as_ref().map_or(SizeStatement::AsItIs, guess));
    let for_all = |size: SizeStatement| vec![size; group.meshes.len()];
    let count = group.facts().count();
    let is_plausible = |mm: f64| is_plausible_length(mm, pad.field_of_view_mm);
    // glTF says metres, but models that were made to be looked at have any size.
    let strange = group.facts().filter(|facts| !is_plausible(facts.largest_mm())).count();
    if group.format == Format::Gltf && count > 1 && 2 * strange > count {
        return for_all(NO_COMMON_UNIT);
    }
    let contradicts = |facts: &MeshFacts, size: SizeStatement| {
        let mm = match size {
            SizeStatement::AsItIs => facts.largest_mm(),
            SizeStatement::In(unit) => facts.largest_mm() / facts.mm_per_unit * unit.mm_per_unit(),
            SizeStatement::Long(_) => return !facts.size.is_normalised(),
        };
        // An object may be somewhat too large or small for the sensor, if its file does not fit better without.
        !is_plausible(mm) && (is_plausible(facts.largest_mm()) || !(is_plausible(mm / 10.0) || is_plausible(10.0 * mm)))
    };
    let often = |size: SizeStatement| group.facts().filter(|facts| guess(facts) == size).count();
    let all = Unit::ALL.into_iter().map(SizeStatement::In).chain([SizeStatement::AsItIs, NORMALISED]);
    let Some(usual) = all.max_by_key(|size| often(*size)).filter(|size| 2 * often(*size) > count) else {
        return if count > MAX_TABLES { for_all(NO_COMMON_UNIT) } else { own().collect() };
    };
    let against = group.facts().filter(|facts| contradicts(facts, usual)).count();
    match (against, count > MAX_TABLES) {
        (0, _) => for_all(usual),
        // A few broken files do not decide for all.
        (_, true) if 20 * against <= count => for_all(usual),
        (_, true) => for_all(NO_COMMON_UNIT),
        (_, false) => own().collect(),
    }
}

/// Groups meshes by their endings as written, and by their paths in the folders of their objects if these recur.
fn group_meshes(found: &[MeshOfSet], meshes: Vec<(MeshOfSet, Inspection)>) -> Vec<MeshGroup> {
    let mut groups: BTreeMap<(Format, String), Vec<(MeshOfSet, Inspection)>> = BTreeMap::new();
    for (mesh, inspection) in meshes {
        let ending = mesh.relative.rsplit('.').next().unwrap_or_default();
        let kind = mesh.object_folder().map_or_else(|| format!(".{ending}"), |(_, rest)| rest.to_owned());
        groups.entry((mesh.format, kind)).or_default().push((mesh, inspection));
    }
    let group =
        |((format, _), meshes): (_, Vec<_>)| MeshGroup { pattern: find_pattern(found, &meshes), format, meshes };
    groups.into_iter().map(group).collect()
}

/// Finds a pattern that matches these meshes and no other that was found. Names that all share stand in it as they are.
fn find_pattern(found: &[MeshOfSet], meshes: &[(MeshOfSet, Inspection)]) -> Option<String> {
    let first = &meshes[0].0;
    if first.object_folder().is_some() && meshes.len() == 1 {
        return None;
    }
    let ending = first.relative.rsplit('.').next().unwrap_or_default();
    let paths: Vec<Vec<&str>> = meshes.iter().map(|(mesh, _)| mesh.relative.split('/').collect()).collect();
    let depth = paths[0].len();
    let part = |at: usize| match paths.iter().all(|path| path[at] == paths[0][at]) {
        true if at + 1 < depth || paths.len() > 1 => Pattern::escape(paths[0][at]),
        _ if at + 1 < depth => String::from("*"),
        _ => format!("*.{ending}"),
    };
    let is_even = paths.iter().all(|path| path.len() == depth);
    let by_folder = is_even.then(|| (0..depth).map(part).collect::<Vec<_>>().join("/"));
    let options = MatchOptions { require_literal_separator: true, ..MatchOptions::new() };
    by_folder.into_iter().chain([format!("**/*.{ending}")]).find(|text| {
        let matches =
            |pattern: Pattern| found.iter().filter(|mesh| pattern.matches_with(&mesh.relative, options)).count();
        Pattern::new(text).is_ok_and(|pattern| matches(pattern) == meshes.len())
    })
}

/// Formats the `[[object]]` tables of a group: one, or one per file if they need different statements about their size
/// or no pattern names them.
fn format_object_tables(from: &str, group: &MeshGroup, sizes: &[SizeStatement], pad: &SensorPad) -> String {
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
            SizeStatement::Long(why) => format!(
                "length_mm = {}          # longest side, or [min, max]: {why}\n",
                format_number(findings::usual_length_mm(pad))
            ),
        }
    };
    let named = |name: &str, is_pattern: bool| {
        let before = if is_pattern { Pattern::escape(from) } else { from.to_owned() };
        let path = if from.is_empty() { name.to_owned() } else { format!("{before}/{name}") };
        format!("[[object]]\npath = {}\n", toml::Value::String(path))
    };
    let stems: BTreeSet<_> = group.meshes.iter().map(|(mesh, _)| mesh.stem()).collect();
    // If few names are shared, the folders that tell those files apart name their classes anyway.
    let class = if 2 * stems.len() <= group.meshes.len() {
        "class_from = \"folder\"   # files share their names\n"
    } else {
        ""
    };
    let good = group.facts().count();
    if let Some(pattern) = group.pattern.as_ref().filter(|_| sizes.iter().all(|other| *other == sizes[0])) {
        let skip = match group.meshes.len() - good {
            0 => String::new(),
            bad => format!("on_bad = \"skip\"         # {bad} of {} cannot be read\n", group.meshes.len()),
        };
        return named(pattern, true) + &size(sizes[0], good) + class + &skip + "\n";
    }
    let each = group.meshes.iter().zip(sizes).filter(|((_, found), _)| found.mesh.is_some());
    let table = |((mesh, _), of): (&(MeshOfSet, Inspection), &SizeStatement)| {
        let class = match mesh.object_folder() {
            Some((object, _)) => format!("class = {}\n", toml::Value::String(object.to_owned())),
            None => class.to_owned(),
        };
        // No escape: characters of a pattern are taken literally if a file of that name exists.
        named(&mesh.relative, false) + &size(*of, 1) + &class + "\n"
    };
    each.map(table).collect()
}

/// Returns the folder as the job names it; `None` if it is not UTF-8.
fn relative_folder(folder: &Path, file: Option<&Path>) -> Option<String> {
    if folder.is_absolute() {
        return folder.to_str().map(str::to_owned);
    }
    let base = file.and_then(Path::parent).unwrap_or(Path::new(""));
    let relative = RelativePaths::seen_from(base).and_then(|mut paths| paths.make_relative(folder));
    let relative = relative.unwrap_or_else(|_| folder.to_owned());
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
