//! The files that a path or a pattern in a job names.

use std::path::{Path, PathBuf};

use glob::Pattern;

use super::check::Check;
use crate::files::input::{matching, may_be_file, meant};
use crate::files::mesh::{Format, is_height_map};
use crate::job::layout::Split;

/// The files that `written` names: itself if it exists, else as a pattern; `help` is for who names none. After a mistake,
/// how many it may stand for.
pub fn find(check: &mut Check<'_>, place: &str, written: &str, help: &str) -> Result<Vec<PathBuf>, usize> {
    // Nobody knows; enough for every split.
    const MANY: usize = Split::ALL.len();
    let folder = check.document.folder(place);
    let path = folder.join(written);
    let is_pattern = written.contains(['*', '?', '[']);
    if path.exists() || !is_pattern {
        if may_be_file(&path) {
            return no_text(&path).map_or(Ok(vec![path]), |odd| refuse_name(check, place, &odd));
        }
        let what = if path.is_dir() { "is a folder" } else { "does not exist" };
        check.error(place, format!("{} {what}", path.display()), why_not(folder, written, help));
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
            check.error(place, format!("not a pattern: {}", error.msg), "`*`, `?` and `[abc]` stand for characters");
            return Err(MANY);
        }
    };
    if let Some(odd) = found.iter().find_map(|path| no_text(path)).or_else(|| passed_over(&path)) {
        return refuse_name(check, place, &odd);
    }
    if found.is_empty() {
        check.error(
            place,
            format!("no file matches {}", path.display()),
            why_not(folder, written, "paths are relative to the file they stand in"),
        );
        return Err(MANY);
    }
    Ok(found)
}

/// Why there is nothing under a path: backslashes between its folders, or the first folder that is not there; else `help`.
fn why_not(folder: &Path, written: &str, help: &str) -> String {
    if written.contains('\\') {
        return format!("write / between folders: \"{}\"", written.replace('\\', "/"));
    }
    let above: Vec<&Path> = Path::new(written).ancestors().skip(1).filter(|above| *above != Path::new("")).collect();
    let plain = |above: &&&Path| !above.to_string_lossy().contains(['*', '?', '[']);
    match above.iter().rev().filter(plain).find(|above| !folder.join(above).exists()) {
        Some(missing) => format!("there is no folder {}; {help}", folder.join(missing).display()),
        None => match meant(&folder.join(written), |path| Format::from_path(path).is_some() || is_height_map(path)) {
            Some(name) => format!("did you mean {}? {help}", Path::new(written).with_file_name(name).display()),
            None => help.to_owned(),
        },
    }
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
