//! Where the images are that labels name: paths from a folder, inside the set's; and what to do about those that are missing.

use std::fs;
use std::path::{Component, Path, PathBuf};

use super::{Draft, Layout, Real};
use gelsim_files::image_file::{NAMES, is_named_like_one};
use gelsim_files::input::meant;
use gelsim_job::plan::check::Check;

/// Folders in folders that are looked into for images that are missing.
const DEEPEST: usize = 4;
/// Folders that are looked into at most.
const MOST_FOLDERS: usize = 2000;

/// The path from the set's folder of what a label names from `folder`, without steps back; `None` if it leads out of the
/// set's folder.
pub fn inside(folder: &Path, name: &str) -> Option<PathBuf> {
    if is_absolute(name) {
        return None;
    }
    let mut path = PathBuf::new();
    for step in folder.components().chain(Path::new(name).components()) {
        match step {
            Component::Normal(step) => path.push(step),
            Component::CurDir => {}
            Component::ParentDir if path.pop() => {}
            _ => return None,
        }
    }
    Some(path)
}

/// True of a path that begins at the root of a system, also of another one: `/data`, `C:/data`.
pub fn is_absolute(name: &str) -> bool {
    let mut chars = name.chars();
    let drive = chars.next().is_some_and(|c| c.is_ascii_alphabetic()) && chars.next() == Some(':');
    name.starts_with('/') || drive && matches!(chars.next(), Some('/' | '\\') | None)
}

/// A path as a label has it, with `/` between folders: one that was written on Windows has `\`, unless a file is called so.
pub fn with_slashes(folder: &Path, written: &str) -> String {
    if written.contains('\\') && !folder.join(written).exists() {
        written.replace('\\', "/")
    } else {
        written.to_owned()
    }
}

/// The folder that the images' names in a table start from, from the set's: what `input.images` says, else the table's.
/// `None` after a mistake.
pub(super) fn folder(check: &mut Check<'_>, draft: &Draft<'_>, unit: usize) -> Option<PathBuf> {
    let of_table = draft.units[unit].folder().to_owned();
    let Some(written) = &draft.written.images else { return Some(of_table) };
    let mut candidates = [inside(Path::new(""), written), inside(&of_table, written)];
    if draft.units.len() > 1 {
        // Each of several tables has a folder of its own.
        candidates.reverse();
    }
    if candidates.iter().all(Option::is_none) {
        let help = "name the folder above both with input.path, and the table and the images from there";
        check.error("input.images", format!("{written} is not in the folder of input.path"), help);
        return None;
    }
    let found = candidates.into_iter().flatten().find(|folder| draft.root.join(folder).is_dir());
    if found.is_none() {
        let near = meant(&draft.root.join(written), |_| true)
            .map(|near| format!("did you mean {near:?}? "))
            .unwrap_or_default();
        let help = format!("{near}name the folder with the images, from the folder of input.path or of the table");
        check.error("input.images", format!("no folder {written} is in {}", draft.root.display()), help);
    }
    found
}

/// What is wrong with an image.
pub struct Unreadable {
    /// A sentence about it.
    pub message: String,
    /// What is true of many such, behind their number.
    pub cause: String,
}

/// What is wrong with an image that could not be read for `reason`.
pub(super) fn unreadable(draft: &Draft<'_>, real: &Real, reason: &str) -> Unreadable {
    if is_missing(draft, real) {
        Unreadable {
            message: format!("cannot read the image {}: it is not there", real.key),
            cause: String::from("images are not there"),
        }
    } else {
        Unreadable {
            message: format!("cannot read the image {}: {reason}", real.key),
            cause: format!("images cannot be read ({reason})"),
        }
    }
}

fn is_missing(draft: &Draft<'_>, real: &Real) -> bool {
    draft.layout != Layout::Tars && !draft.root.join(&real.path).exists()
}

/// What to do about it.
pub(super) fn help(draft: &Draft<'_>, real: &Real) -> String {
    let without = match draft.layout {
        Layout::Tables => "remove its row",
        Layout::Tars => "write the tar anew without the sample",
        Layout::Coco => "take it and its annotations out",
        Layout::ClassFolders(_) => "remove the file",
    };
    match draft.layout {
        _ if is_missing(draft, real) => {
            elsewhere(draft, real).unwrap_or_else(|| format!("copy it there, or {without}"))
        }
        Layout::Tars => {
            let suffix = draft.image.as_deref().unwrap_or_default();
            format!("put a sound image ({NAMES}) into the tar as the file that ends in {suffix}, or {without}")
        }
        _ => format!("put a sound image there ({NAMES}), or {without}"),
    }
}

/// Where an image is that is not where its label says: what to write in place of what was written.
pub(super) fn elsewhere(draft: &Draft<'_>, real: &Real) -> Option<String> {
    let of_images = &draft.units[real.unit].images;
    let name = real.image.rsplit(['/', '\\']).next().filter(|name| !name.is_empty())?;
    if let Some(path) = inside(of_images, &real.image)
        && let Some(near) = meant(&draft.root.join(path), is_named_like_one)
        && !differ_in_digits(&near, name)
    {
        return Some(format!("is {near:?} meant by {name:?}? write it as the file is called"));
    }
    let folders = folders(draft.root, DEEPEST, &mut 0);
    let from_root = |path: &Path| path.strip_prefix(draft.root).unwrap_or(path).display().to_string();
    let holds = |part: &str| folders.iter().find(|folder| folder.join(part).is_file());
    if let Some(found) = (!is_absolute(&real.image)).then(|| holds(&real.image)).flatten() {
        let found = from_root(found);
        let found = if found.is_empty() { "." } else { &found };
        return Some(format!("they are in {found}: say so under [input]: images = {found:?}"));
    }
    // Of `/home/ann/set/img/00.png` there may be `img/00.png`.
    let steps: Vec<&str> = real.image.split(['/', '\\']).filter(|step| !step.is_empty()).collect();
    for first in 1..steps.len() {
        let part = steps[first..].join("/");
        let Some(found) = holds(&part) else { continue };
        let found = from_root(&found.join(&part));
        let there = match Path::new(&found).strip_prefix(of_images) {
            Ok(rest) => format!("write names like {} in the table", rest.display()),
            Err(_) => {
                let folder = Path::new(&found).parent().unwrap_or(Path::new("")).display().to_string();
                format!("write names like {name} in the table, and images = {folder:?} under [input]")
            }
        };
        return Some(format!("{found} is there: {there}"));
    }
    None
}

/// True of two names that differ in digits only: another image of the same series is not meant.
fn differ_in_digits(a: &str, b: &str) -> bool {
    let digits = |name: &str| name.chars().filter(char::is_ascii_digit).collect::<String>();
    digits(a) != digits(b)
}

/// A folder and those in it, without what is hidden.
fn folders(folder: &Path, deep: usize, asked: &mut usize) -> Vec<PathBuf> {
    let mut found = vec![folder.to_owned()];
    *asked += 1;
    if deep == 0 || *asked > MOST_FOLDERS {
        return found;
    }
    let Ok(entries) = fs::read_dir(folder) else { return found };
    let is_shown = |path: &PathBuf| !path.file_name().is_some_and(|name| name.to_string_lossy().starts_with('.'));
    let mut below: Vec<PathBuf> = entries
        .filter_map(|entry| entry.ok())
        .filter(|entry| entry.file_type().is_ok_and(|kind| kind.is_dir()))
        .map(|entry| entry.path())
        .filter(is_shown)
        .collect();
    below.sort();
    for path in below {
        found.extend(folders(&path, deep - 1, asked));
    }
    found
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_path_is_followed_inside_the_folder_and_not_out_of_it() {
        for (folder, name, expected) in [
            ("", "img/0.png", Some("img/0.png")),
            ("annotations", "../img/./0.png", Some("img/0.png")),
            ("annotations", "0.png", Some("annotations/0.png")),
            ("annotations", "../../0.png", None),
            ("", "/img/0.png", None),
            ("", "C:/img/0.png", None),
            ("", "c:\\img\\0.png", None),
            ("", "c:0.png", Some("c:0.png")),
        ] {
            assert_eq!(inside(Path::new(folder), name), expected.map(PathBuf::from), "{folder} {name}");
        }
    }
}
