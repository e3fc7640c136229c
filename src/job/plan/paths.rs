//! The files that a path or a pattern in a job names.

use std::cmp::Reverse;
use std::collections::BTreeMap;
use std::env;
use std::path::{Path, PathBuf};

use glob::Pattern;

use super::check::Check;
use crate::layout::Split;
use gelsim_files::diagnostic::{Diagnostic, Diagnostics};
use gelsim_files::input::{matching, may_be_file, meant};
use gelsim_files::mesh::{self, Format, HEIGHT_MAP, is_height_map};

/// What belongs where a path stands.
pub struct Kind {
    /// What messages call it.
    pub name: &'static str,
    /// Its key, for examples.
    pub key: &'static str,
    /// True of a file with a name that may be one.
    pub may_be: fn(&Path) -> bool,
    /// What it is, behind "belongs here"; empty where that is said elsewhere.
    pub what: &'static str,
}

/// Meshes and height maps.
pub const OBJECTS: Kind = Kind {
    name: "mesh",
    key: "path",
    may_be: |path| Format::from_path(path).is_some() || is_height_map(path),
    what: "",
};

/// Photographs of the untouched pad.
pub const BACKGROUNDS: Kind = Kind {
    name: "background",
    key: "background",
    may_be: |path| has_ending(path, &["png", "jpg", "jpeg", "bmp", "tif", "tiff", "webp"]),
    what: "a PNG of the untouched pad belongs here, or a JPEG, BMP, TIFF or WebP",
};

/// Grey values that are heights.
pub const HEIGHT_MAPS: Kind = Kind { name: "height map", key: "path", may_be: is_height_map, what: HEIGHT_MAP };

/// Places of pins.
pub const PINS: Kind = Kind {
    name: "table of pins",
    key: "file",
    may_be: |path| has_ending(path, &["csv"]),
    what: "a CSV file with the columns x_mm and y_mm belongs here",
};

/// What was measured on a sensor.
pub const CALIBRATIONS: Kind = Kind {
    name: "calibration",
    key: "calibration",
    may_be: |path| has_ending(path, &["json"]),
    what: "the table that `gelsim calibrate` wrote beside its sensor file belongs here",
};

/// The shape of a gel.
pub const GELS: Kind =
    Kind { name: "gel's mesh", key: "path", may_be: |path| Format::from_path(path).is_some(), what: "" };

fn has_ending(path: &Path, endings: &[&str]) -> bool {
    let ending = path.extension().map(|ending| ending.to_ascii_lowercase());
    endings.iter().any(|known| ending.as_deref() == Some(known.as_ref()))
}

/// The files that `written` names: itself if it exists, else as a pattern. After a mistake, how many it may stand for.
pub fn find(check: &mut Check<'_>, place: &str, written: &str, kind: &Kind) -> Result<Vec<PathBuf>, usize> {
    // Nobody knows; enough for every split.
    const MANY: usize = Split::ALL.len();
    let folder = check.document.folder(place);
    let path = folder.join(written);
    if path.exists() || !is_pattern(written) {
        if may_be_file(&path) {
            return no_text(&path).map_or(Ok(vec![path]), |odd| refuse_name(check, place, &odd));
        }
        let (what, cause) = match () {
            () if path.is_dir() => ("is a folder", "paths are folders"),
            () if path.exists() => ("is a pipe or a device, and no file", "paths are pipes or devices"),
            () => ("does not exist", "files do not exist"),
        };
        // Nobody reads a guess for each of thousands, which all have a folder to be looked through.
        let help = match said_of(check.problems, cause) < MOST_GUESSES {
            true => absent(check, place, written, kind),
            false => starts(check, place).to_owned(),
        };
        let shown = path.display().to_string();
        refuse(check, place, Diagnostic::new(format!("{shown} {what}")).help(help).of(shown, cause));
        return Err(if path.is_dir() { MANY } else { 1 });
    }
    if written.matches("**").count() > 1 {
        check.error(place, "more than one `**` in a pattern", "one `**` stands for any number of folders");
        return Err(MANY);
    }
    // Only what the user wrote is a pattern, not the folder that it starts from.
    let pattern = Path::new(&Pattern::escape(&folder.to_string_lossy())).join(written);
    let found = match glob::glob(&pattern.to_string_lossy()).map(matching) {
        Ok(Ok(found)) => found,
        Ok(Err(error)) => {
            check.error(place, error.to_string(), "name folders that can be read");
            return Err(MANY);
        }
        Err(error) => {
            let help = "`*`, `?` and `[abc]` stand for characters, `**` for folders, `[[]` for a bracket itself";
            check.error(place, format!("not a pattern: {}", error.msg), help);
            return Err(MANY);
        }
    };
    if let Some(odd) = found.iter().find_map(|path| no_text(path)).or_else(|| passed_over(&path)) {
        return refuse_name(check, place, &odd);
    }
    if found.is_empty() {
        let help = absent(check, place, written, kind);
        let shown = path.display().to_string();
        let problem = Diagnostic::new(format!("no file matches {shown}")).help(help);
        refuse(check, place, problem.of(shown, "patterns match no file"));
        return Err(MANY);
    }
    Ok(found)
}

/// Makes absolute the folders that are written in a list.
pub fn folders(check: &mut Check<'_>, place: &str, written: &mut [String]) {
    for (i, written) in written.iter_mut().enumerate() {
        let place = format!("{place}.{i}");
        let path = check.document.folder(&place).join(&*written);
        let absolute = std::path::absolute(&path).ok().and_then(|path| path.into_os_string().into_string().ok());
        match absolute.filter(|_| path.is_dir()) {
            Some(absolute) => *written = absolute,
            None => {
                let what = if path.exists() { "is no folder" } else { "does not exist" };
                let folder = check.document.folder(&place);
                let help = not_taken(written, None)
                    .or_else(|| no_folder(folder, Path::new(written)))
                    .unwrap_or_else(|| String::from("name a folder of packages, or that of a package"));
                let help = format!("{help}; {}", starts(check, &place));
                check.error(&place, format!("{} {what}", path.display()), help);
            }
        }
    }
}

/// Paths of which it is said what may have been meant.
const MOST_GUESSES: usize = 100;

/// Of how many paths the same was said.
fn said_of(problems: &Diagnostics, cause: &str) -> usize {
    let subjects = problems.iter().filter_map(|problem| problem.subjects.as_deref());
    subjects.filter(|subjects| subjects.cause == cause).map(|subjects| subjects.count).sum()
}

fn refuse(check: &mut Check<'_>, place: &str, problem: Diagnostic) {
    let place = check.document.place(place).unwrap_or(check.document.root.place);
    check.problems.push(problem.at(place));
}

fn is_pattern(written: &str) -> bool {
    written.contains(['*', '?', '['])
}

/// What to do about a path that names no file.
pub fn absent(check: &Check<'_>, place: &str, written: &str, kind: &Kind) -> String {
    help(check.document.folder(place), written, kind, starts(check, place))
}

/// The same where relative paths start as `starts` says, from `folder` on.
pub fn help(folder: &Path, written: &str, kind: &Kind, starts: &str) -> String {
    let Kind { key, may_be, what, .. } = kind;
    let path = Path::new(written);
    let after = if what.is_empty() { starts.to_owned() } else { format!("{starts}; {what}") };
    if let Some(help) = not_taken(written, Some(key)) {
        return help;
    }
    if folder.join(path).is_dir() {
        let inside = patterns(&folder.join(path), *may_be);
        let base = written.trim_end_matches('/');
        let named: Vec<String> =
            inside.iter().map(|pattern| format!("{key} = \"{}/{pattern}\"", Pattern::escape(base))).collect();
        return match named.is_empty() {
            true => format!("name a file: nothing in this folder can be one; {after}"),
            false => format!("what is in it: {}", named.join(", ")),
        };
    }
    if folder.join(path).exists() {
        return format!("write what comes out of it to a file, and name that; {after}");
    }
    if let Some(help) = no_folder(folder, path) {
        return format!("{help}; {after}");
    }
    if is_pattern(written) {
        let of_other = mesh::other_format(path).filter(|_| *key == "path").map(|help| format!("{help}; "));
        let above = path.parent().unwrap_or(Path::new(""));
        // A folder in the pattern is any of several.
        let there =
            if is_pattern(&above.to_string_lossy()) { Vec::new() } else { patterns(&folder.join(above), *may_be) };
        let there: Vec<String> =
            there.iter().map(|pattern| format!("{key} = \"{}\"", above.join(pattern).display())).collect();
        let there = if there.is_empty() { String::new() } else { format!("what is there: {}; ", there.join(", ")) };
        return format!("{}{there}{after}", of_other.unwrap_or_default());
    }
    match meant(&folder.join(path), may_be) {
        Some(name) => format!("did you mean {}? {after}", path.with_file_name(name).display()),
        None => after,
    }
}

/// Where relative paths start from that are written at `place`.
fn starts(check: &Check<'_>, place: &str) -> &'static str {
    let source = check.document.get(place).map_or(0, |node| node.place.source);
    match check.document.sources[source].name.starts_with("--") {
        true => "paths start from the current folder",
        false => "paths are relative to the file they stand in",
    }
}

/// The way out of what a shell, a browser or another system would have taken.
fn not_taken(written: &str, key: Option<&str>) -> Option<String> {
    if let Some(rest) = written.strip_prefix("file://") {
        return Some(format!("write the path alone: \"{rest}\""));
    }
    if written.contains("://") {
        return Some(String::from("nothing is downloaded: fetch it, and name the file"));
    }
    if written.starts_with('~') {
        let home = env::var("HOME").ok().filter(|_| written == "~" || written.starts_with("~/"));
        let instead = home.map_or(String::from("the folder itself"), |home| format!("\"{home}{}\"", &written[1..]));
        return Some(format!("~ stands for nothing here: write {instead}"));
    }
    if written.contains('$') {
        let instead = expanded(written).map_or(String::from("what it stands for"), |path| format!("\"{path}\""));
        return Some(format!("variables are not replaced here: write {instead}"));
    }
    if written.contains('\\') {
        return Some(format!("write / between folders: \"{}\"", written.replace('\\', "/")));
    }
    let choices = braces(written)?;
    let named: Vec<String> = choices.iter().map(|path| format!("\"{path}\"")).collect();
    Some(match key {
        Some("path") => {
            let tables: Vec<String> = named.iter().map(|path| format!("[[object]] path = {path}")).collect();
            format!("braces stand for nothing here: write a table for each, {}", tables.join(" and "))
        }
        _ => format!("braces stand for nothing here: write [{}]", named.join(", ")),
    })
}

/// The path with the variables of the environment in their places; none if one is not set.
fn expanded(written: &str) -> Option<String> {
    let (before, after) = written.split_once('$')?;
    let (name, rest) = match after.strip_prefix('{') {
        Some(braced) => braced.split_once('}')?,
        None => {
            let end = after.find(|c: char| !c.is_ascii_alphanumeric() && c != '_').unwrap_or(after.len());
            after.split_at(end)
        }
    };
    let value = env::var(name).ok().filter(|_| !name.is_empty())?;
    let rest = if rest.contains('$') { expanded(rest)? } else { rest.to_owned() };
    Some(format!("{before}{value}{rest}"))
}

/// What a shell makes of the first braces of a path, up to four of them.
fn braces(written: &str) -> Option<Vec<String>> {
    let (before, rest) = written.split_once('{')?;
    let (inside, after) = rest.split_once('}')?;
    inside.contains(',').then(|| inside.split(',').take(4).map(|choice| format!("{before}{choice}{after}")).collect())
}

/// The first folder of a path that is not there.
fn no_folder(folder: &Path, path: &Path) -> Option<String> {
    let above: Vec<&Path> = path.ancestors().skip(1).filter(|above| *above != Path::new("")).collect();
    let plain = |above: &&&Path| !is_pattern(&above.to_string_lossy());
    let missing = above.iter().rev().filter(plain).find(|above| !folder.join(above).exists())?;
    let missing = folder.join(missing);
    let beside = missing.parent().unwrap_or(Path::new("")).to_owned();
    let meant = meant(&missing, |name| beside.join(name).is_dir());
    let meant =
        meant.map_or(String::new(), |name| format!(", did you mean {}?", missing.with_file_name(name).display()));
    Some(format!("there is no folder {}{meant}", missing.display()))
}

/// Patterns of the files in a folder, or deeper where there is none, that may be what is wanted: those of most files first.
fn patterns(folder: &Path, may_be: fn(&Path) -> bool) -> Vec<String> {
    /// Entries that are looked at, and patterns that are named.
    const MOST: usize = 10_000;
    const NAMED: usize = 3;
    let folder = if folder == Path::new("") { Path::new(".") } else { folder };
    let endings = |folders: &[PathBuf]| {
        let mut counts: BTreeMap<String, usize> = BTreeMap::new();
        let mut inside = Vec::new();
        let entries = folders.iter().filter_map(|folder| folder.read_dir().ok()).flatten().flatten().take(MOST);
        for path in entries.map(|entry| entry.path()) {
            match path.extension().and_then(|ending| ending.to_str()) {
                _ if path.is_dir() => inside.push(path),
                Some(ending) if may_be(&path) => *counts.entry(ending.to_owned()).or_default() += 1,
                _ => {}
            }
        }
        let mut counts: Vec<(String, usize)> = counts.into_iter().collect();
        counts.sort_by_key(|(_, count)| Reverse(*count));
        (counts.into_iter().map(|(ending, _)| ending).take(NAMED).collect::<Vec<_>>(), inside)
    };
    let mut folders = vec![folder.to_owned()];
    for before in ["", "**/", "**/"] {
        let (found, inside) = endings(&folders);
        if !found.is_empty() {
            return found.into_iter().map(|ending| format!("{before}*.{ending}")).collect();
        }
        folders = inside;
    }
    Vec::new()
}

/// The path, if it is not UTF-8: no job can hold it, so that nobody could make the dataset again.
fn no_text(path: &Path) -> Option<PathBuf> {
    path.to_str().is_none().then(|| path.to_owned())
}

/// A file that the pattern's last part would match if its name were UTF-8; such names match no pattern.
fn passed_over(pattern: &Path) -> Option<PathBuf> {
    let last = Pattern::new(pattern.file_name()?.to_str()?).ok()?;
    let mut names = std::fs::read_dir(pattern.parent()?).ok()?.filter_map(|entry| Some(entry.ok()?.file_name()));
    let odd = names.find(|name| name.to_str().is_none() && last.matches(&name.to_string_lossy()))?;
    Some(pattern.with_file_name(odd))
}

fn refuse_name(check: &mut Check<'_>, place: &str, path: &Path) -> Result<Vec<PathBuf>, usize> {
    let message = format!("{} is not UTF-8, so that no job can hold it", path.display());
    check.error(place, message, "rename the file or its folders");
    Err(Split::ALL.len())
}
