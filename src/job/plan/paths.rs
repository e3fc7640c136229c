//! Finds the files that a path or a pattern in a job names.

use std::cmp::Reverse;
use std::collections::BTreeMap;
use std::env;
use std::path::{Path, PathBuf};

use glob::Pattern;

use super::check::JobChecker;
use crate::layout::Split;
use gelsim_files::diagnostic::{Diagnostic, Diagnostics};
use gelsim_files::input::{find_matching_files, may_be_file, suggest_file_name};
use gelsim_files::mesh::{self, Format, HEIGHT_MAP_HELP, is_height_map};
use gelsim_files::watch;

/// A kind of file that a path may name.
pub struct FileKind {
    /// Its name in messages.
    pub name: &'static str,
    /// Its key, for examples in messages.
    pub key: &'static str,
    /// Returns true if a file with this name may be of the kind.
    pub may_be: fn(&Path) -> bool,
    /// What it is, to stand before "belongs here"; empty if that is said elsewhere.
    pub what: &'static str,
}

/// Meshes and height maps.
pub const OBJECTS: FileKind = FileKind {
    name: "mesh",
    key: "path",
    may_be: |path| Format::from_path(path).is_some() || is_height_map(path),
    what: "",
};

/// Photographs of the untouched pad.
pub const BACKGROUNDS: FileKind = FileKind {
    name: "background",
    key: "background",
    may_be: |path| has_ending(path, &["png", "jpg", "jpeg", "bmp", "tif", "tiff", "webp"]),
    what: "a PNG of the untouched pad belongs here, or a JPEG, BMP, TIFF or WebP",
};

/// Height maps.
pub const HEIGHT_MAPS: FileKind =
    FileKind { name: "height map", key: "path", may_be: is_height_map, what: HEIGHT_MAP_HELP };

/// Tables of pins.
pub const PINS: FileKind = FileKind {
    name: "table of pins",
    key: "file",
    may_be: |path| has_ending(path, &["csv"]),
    what: "a CSV file with the columns x_mm and y_mm belongs here",
};

/// Tables of printed dots.
pub const DOTS: FileKind = FileKind { name: "table of dots", ..PINS };

/// Calibration tables.
pub const CALIBRATIONS: FileKind = FileKind {
    name: "calibration",
    key: "calibration",
    may_be: |path| has_ending(path, &["json"]),
    what: "the table that `gelsim calibrate` wrote beside its sensor file belongs here",
};

/// Meshes of gels.
pub const GELS: FileKind =
    FileKind { name: "gel's mesh", key: "path", may_be: |path| Format::from_path(path).is_some(), what: "" };

fn has_ending(path: &Path, endings: &[&str]) -> bool {
    let ending = path.extension().map(|ending| ending.to_ascii_lowercase());
    endings.iter().any(|known| ending.as_deref() == Some(known.as_ref()))
}

/// Finds the files that `written` names: that path itself if it exists, else the files that match it as a pattern.
/// After an error, which is reported, returns how many files it may stand for.
pub fn find_files(
    check: &mut JobChecker<'_>,
    place: &str,
    written: &str,
    kind: &FileKind,
) -> Result<Vec<PathBuf>, usize> {
    // The real number is unknown; this is enough for every split.
    const MANY: usize = Split::ALL.len();
    if refuse_empty_path(check, place, written, kind) {
        return Err(1);
    }
    let folder = check.document.folder_of(place);
    let path = folder.join(written);
    if path.exists() || !is_pattern(written) {
        if may_be_file(&path) {
            return find_non_utf8_path(&path).map_or(Ok(vec![path]), |odd| refuse_non_utf8_name(check, place, &odd));
        }
        let (what, cause) = match () {
            () if path.is_dir() => ("is a folder", "paths are folders"),
            () if path.exists() => ("is a pipe or a device, and no file", "paths are pipes or devices"),
            () if path.is_symlink() => ("is a link to what does not exist", "paths are links to what does not exist"),
            () => ("does not exist", "files do not exist"),
        };
        // A suggestion means a search through a folder, and nobody reads thousands of them.
        let help = match count_reported(check.problems, cause) < MAX_GUESSES {
            true => suggest_for_missing(check, place, written, kind),
            false => describe_base_folder(check, place).to_owned(),
        };
        let shown = show_path(&path);
        report_at(check, place, Diagnostic::new(format!("{shown} {what}")).help(help).about(shown, cause));
        return Err(if path.is_dir() { MANY } else { 1 });
    }
    if written.matches("**").count() > 1 {
        check.report_error(place, "more than one `**` in a pattern", "one `**` stands for any number of folders");
        return Err(MANY);
    }
    // Only what the user wrote is a pattern, but not the folder that it starts from.
    let pattern = Path::new(&Pattern::escape(&folder.to_string_lossy())).join(written);
    let found = match find_matching_files(&pattern.to_string_lossy()) {
        Ok(Ok(found)) => found,
        Ok(Err(error)) => {
            check.report_error(place, error.to_string(), "name folders that can be read");
            return Err(MANY);
        }
        Err(error) => {
            let help = "`*`, `?` and `[abc]` stand for characters, `**` for folders, `[[]` for a bracket itself";
            check.report_error(place, format!("not a pattern: {}", error.msg), help);
            return Err(MANY);
        }
    };
    // A file that is added to a folder changes it.
    let base = path.ancestors().find(|above| !is_pattern(&above.to_string_lossy()));
    base.into_iter().chain(found.iter().filter_map(|path| path.parent())).for_each(watch::note_path);
    if let Some(odd) = found.iter().find_map(|path| find_non_utf8_path(path)).or_else(|| find_non_utf8_match(&path)) {
        return refuse_non_utf8_name(check, place, &odd);
    }
    if found.is_empty() {
        let help = suggest_for_missing(check, place, written, kind);
        let shown = show_path(&path);
        let problem = Diagnostic::new(format!("no file matches {shown}")).help(help);
        report_at(check, place, problem.about(shown, "patterns match no file"));
        return Err(MANY);
    }
    Ok(found)
}

/// Reports a path without a name, and returns true if it is one.
pub fn refuse_empty_path(check: &mut JobChecker<'_>, place: &str, written: &str, kind: &FileKind) -> bool {
    let is_empty = written.trim().is_empty();
    if is_empty {
        let FileKind { name, what, .. } = kind;
        let help = if what.is_empty() { format!("name a {name}") } else { (*what).to_owned() };
        check.report_error(place, "the path is empty", help);
    }
    is_empty
}

/// Makes a list of folders absolute. Errors are reported at `place`.
pub fn resolve_folders(check: &mut JobChecker<'_>, place: &str, written: &mut [String]) {
    for (i, written) in written.iter_mut().enumerate() {
        let place = format!("{place}.{i}");
        let path = check.document.folder_of(&place).join(&*written);
        watch::note_path(&path);
        let absolute = std::path::absolute(&path).ok().and_then(|path| path.into_os_string().into_string().ok());
        match absolute.filter(|_| path.is_dir()) {
            Some(absolute) => *written = absolute,
            None => {
                let what = if path.exists() { "is no folder" } else { "does not exist" };
                let folder = check.document.folder_of(&place);
                let help = suggest_for_foreign_path(written, None)
                    .or_else(|| describe_missing_folder(folder, Path::new(written)))
                    .unwrap_or_else(|| String::from("name a folder of packages, or that of a package"));
                let help = format!("{help}; {}", describe_base_folder(check, &place));
                check.report_error(&place, format!("{} {what}", path.display()), help);
            }
        }
    }
}

/// Returns a path for a message: a line break in it, which a backslash may have become, is written as such.
fn show_path(path: &Path) -> String {
    let shown = path.to_string_lossy();
    let parts = shown.chars().map(|c| if c.is_control() { c.escape_default().to_string() } else { c.to_string() });
    parts.collect()
}

/// Most paths for which a suggestion is made.
const MAX_GUESSES: usize = 100;

/// Returns for how many paths the same cause was reported.
fn count_reported(problems: &Diagnostics, cause: &str) -> usize {
    let subjects = problems.iter().filter_map(|problem| problem.subjects.as_deref());
    subjects.filter(|subjects| subjects.cause == cause).map(|subjects| subjects.count).sum()
}

fn report_at(check: &mut JobChecker<'_>, place: &str, problem: Diagnostic) {
    let place = check.document.place_of(place).unwrap_or(check.document.root.place);
    check.problems.push(problem.at(place));
}

fn is_pattern(written: &str) -> bool {
    written.contains(['*', '?', '['])
}

/// Suggests what to do about a path that names no file.
pub fn suggest_for_missing(check: &JobChecker<'_>, place: &str, written: &str, kind: &FileKind) -> String {
    suggest_path(check.document.folder_of(place), written, kind, describe_base_folder(check, place))
}

/// Suggests what to do about a path relative to `folder` that names no file. `starts` says, for the message, where
/// relative paths start.
pub fn suggest_path(folder: &Path, written: &str, kind: &FileKind, starts: &str) -> String {
    let FileKind { key, may_be, what, .. } = kind;
    let path = Path::new(written);
    let after = if what.is_empty() { starts.to_owned() } else { format!("{starts}; {what}") };
    if let Some(help) = suggest_for_foreign_path(written, Some(key)) {
        return help;
    }
    if folder.join(path).is_dir() {
        let inside = suggest_patterns(&folder.join(path), *may_be);
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
    if let Some(help) = describe_missing_folder(folder, path) {
        return format!("{help}; {after}");
    }
    if is_pattern(written) {
        let of_other = mesh::suggest_export(path).filter(|_| *key == "path").map(|help| format!("{help}; "));
        let above = path.parent().unwrap_or(Path::new(""));
        // If the folder itself is a pattern, there is no single folder to be looked through.
        let patterns = if is_pattern(&above.to_string_lossy()) {
            Vec::new()
        } else {
            suggest_patterns(&folder.join(above), *may_be)
        };
        let patterns: Vec<String> =
            patterns.iter().map(|pattern| format!("{key} = \"{}\"", above.join(pattern).display())).collect();
        let patterns =
            if patterns.is_empty() { String::new() } else { format!("what is there: {}; ", patterns.join(", ")) };
        return format!("{}{patterns}{after}", of_other.unwrap_or_default());
    }
    match suggest_file_name(&folder.join(path), may_be) {
        Some(name) => format!("did you mean {}? {after}", path.with_file_name(name).display()),
        None => after,
    }
}

/// Describes where relative paths at `place` start from.
fn describe_base_folder(check: &JobChecker<'_>, place: &str) -> &'static str {
    let source = check.document.get(place).map_or(0, |node| node.place.source);
    match check.document.sources[source].name.starts_with("--") {
        true => "paths start from the current folder",
        false => "paths are relative to the file they stand in",
    }
}

/// Suggests what to do about a path that only a shell, a browser or another system would understand.
fn suggest_for_foreign_path(written: &str, key: Option<&str>) -> Option<String> {
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
        let instead =
            expand_variables(written).map_or(String::from("what it stands for"), |path| format!("\"{path}\""));
        return Some(format!("variables are not replaced here: write {instead}"));
    }
    let escapes = [('\n', "/n"), ('\t', "/t"), ('\r', "/r"), ('\u{8}', "/b"), ('\u{c}', "/f"), ('\u{1b}', "/e")];
    if escapes.iter().any(|(escaped, _)| written.contains(*escaped)) {
        let plain =
            escapes.iter().fold(written.replace('\\', "/"), |path, (escaped, meant)| path.replace(*escaped, meant));
        return Some(format!(
            "a backslash in \"..\" begins an escape, such as \\n for a line break: write \"{plain}\""
        ));
    }
    if written.contains('\\') {
        return Some(format!("write / between folders: \"{}\"", written.replace('\\', "/")));
    }
    let choices = expand_braces(written)?;
    let named: Vec<String> = choices.iter().map(|path| format!("\"{path}\"")).collect();
    Some(match key {
        Some("path") => {
            let tables: Vec<String> = named.iter().map(|path| format!("[[object]] path = {path}")).collect();
            format!("braces stand for nothing here: write a table for each, {}", tables.join(" and "))
        }
        _ => format!("braces stand for nothing here: write [{}]", named.join(", ")),
    })
}

/// Replaces environment variables in a path. Returns `None` if one of them is not set.
fn expand_variables(written: &str) -> Option<String> {
    let (before, after) = written.split_once('$')?;
    let (name, rest) = match after.strip_prefix('{') {
        Some(braced) => braced.split_once('}')?,
        None => {
            let end = after.find(|c: char| !c.is_ascii_alphanumeric() && c != '_').unwrap_or(after.len());
            after.split_at(end)
        }
    };
    let value = env::var(name).ok().filter(|_| !name.is_empty())?;
    let rest = if rest.contains('$') { expand_variables(rest)? } else { rest.to_owned() };
    Some(format!("{before}{value}{rest}"))
}

/// Expands the first braces of a path as a shell does, up to four choices.
fn expand_braces(written: &str) -> Option<Vec<String>> {
    let (before, rest) = written.split_once('{')?;
    let (inside, after) = rest.split_once('}')?;
    inside.contains(',').then(|| inside.split(',').take(4).map(|choice| format!("{before}{choice}{after}")).collect())
}

/// Describes the first folder of a path that does not exist; `None` if all exist.
fn describe_missing_folder(folder: &Path, path: &Path) -> Option<String> {
    let above: Vec<&Path> = path.ancestors().skip(1).filter(|above| *above != Path::new("")).collect();
    let plain = |above: &&&Path| !is_pattern(&above.to_string_lossy());
    let missing = above.iter().rev().filter(plain).find(|above| !folder.join(above).exists())?;
    let missing = folder.join(missing);
    let beside = missing.parent().unwrap_or(Path::new("")).to_owned();
    let meant = suggest_file_name(&missing, |name| beside.join(name).is_dir());
    let meant =
        meant.map_or(String::new(), |name| format!(", did you mean {}?", missing.with_file_name(name).display()));
    Some(format!("there is no folder {}{meant}", missing.display()))
}

/// Suggests patterns for the files of the wanted kind in a folder, or deeper if there is none. Patterns with the most
/// files come first.
fn suggest_patterns(folder: &Path, may_be: fn(&Path) -> bool) -> Vec<String> {
    /// Most entries that are looked at.
    const MAX_ENTRIES: usize = 10_000;
    /// Most patterns that are suggested.
    const MAX_NAMED: usize = 3;
    let folder = if folder == Path::new("") { Path::new(".") } else { folder };
    let endings = |folders: &[PathBuf]| {
        let mut counts: BTreeMap<String, usize> = BTreeMap::new();
        let mut inside = Vec::new();
        let entries = folders.iter().filter_map(|folder| folder.read_dir().ok()).flatten().flatten().take(MAX_ENTRIES);
        for path in entries.map(|entry| entry.path()) {
            match path.extension().and_then(|ending| ending.to_str()) {
                _ if path.is_dir() => inside.push(path),
                Some(ending) if may_be(&path) => *counts.entry(ending.to_owned()).or_default() += 1,
                _ => {}
            }
        }
        let mut counts: Vec<(String, usize)> = counts.into_iter().collect();
        counts.sort_by_key(|(_, count)| Reverse(*count));
        (counts.into_iter().map(|(ending, _)| ending).take(MAX_NAMED).collect::<Vec<_>>(), inside)
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

/// Returns the path if it is not UTF-8. No job could hold it, so the dataset could not be made again.
fn find_non_utf8_path(path: &Path) -> Option<PathBuf> {
    path.to_str().is_none().then(|| path.to_owned())
}

/// Finds a file that the pattern's last part would match if its name were UTF-8. Patterns match no other names.
fn find_non_utf8_match(pattern: &Path) -> Option<PathBuf> {
    let last = Pattern::new(pattern.file_name()?.to_str()?).ok()?;
    let mut names = std::fs::read_dir(pattern.parent()?).ok()?.filter_map(|entry| Some(entry.ok()?.file_name()));
    let odd = names.find(|name| name.to_str().is_none() && last.matches(&name.to_string_lossy()))?;
    Some(pattern.with_file_name(odd))
}

fn refuse_non_utf8_name(check: &mut JobChecker<'_>, place: &str, path: &Path) -> Result<Vec<PathBuf>, usize> {
    let message = format!("{} is not UTF-8, so that no job can hold it", path.display());
    check.report_error(place, message, "rename the file or its folders");
    Err(Split::ALL.len())
}
