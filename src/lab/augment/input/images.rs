//! Resolves the image files that labels name, which must be inside the set's folder, and suggests what to do about
//! missing ones.

use std::fs;
use std::path::{Component, Path, PathBuf};

use rayon::prelude::*;

use super::{DatasetDraft, InputLayout, RealSample, exif};
use gelsim_files::diagnostic::Diagnostic;
use gelsim_files::image_file::{FORMAT_NAMES, has_image_extension};
use gelsim_files::input::suggest_file_name;
use gelsim_job::plan::check::JobChecker;

/// Depth of folders that are searched for missing images.
const DEEPEST: usize = 4;
/// Most folders that are searched.
const MAX_FOLDERS: usize = 2000;

/// Resolves `name` from `folder` to a path relative to the set's folder, without `..`. `None` if it leads out of the
/// set's folder.
pub fn path_inside(folder: &Path, name: &str) -> Option<PathBuf> {
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

/// Returns true for an absolute path of any system: `/data`, `C:/data`.
pub fn is_absolute(name: &str) -> bool {
    let mut chars = name.chars();
    let drive = chars.next().is_some_and(|c| c.is_ascii_alphabetic()) && chars.next() == Some(':');
    name.starts_with('/') || drive && matches!(chars.next(), Some('/' | '\\') | None)
}

/// Returns a path of a label with `/` between folders. Labels written on Windows have `\`, unless a file really has
/// that name.
pub fn with_slashes(folder: &Path, written: &str) -> String {
    if written.contains('\\') && !folder.join(written).exists() {
        written.replace('\\', "/")
    } else {
        written.to_owned()
    }
}

/// Finds the folder, relative to the set's, from which a table's image names start: that of `input.images`, else the
/// table's. `None` after a mistake.
pub(super) fn find_image_folder(check: &mut JobChecker<'_>, draft: &DatasetDraft<'_>, unit: usize) -> Option<PathBuf> {
    let of_table = draft.units[unit].folder().to_owned();
    let Some(written) = &draft.written.images else { return Some(of_table) };
    let mut candidates = [path_inside(Path::new(""), written), path_inside(&of_table, written)];
    if draft.units.len() > 1 {
        // With several tables, each probably has an images folder of its own: try that first.
        candidates.reverse();
    }
    if candidates.iter().all(Option::is_none) {
        let help = "name the folder above both with input.path, and the table and the images from there";
        check.report_error("input.images", format!("{written} is not in the folder of input.path"), help);
        return None;
    }
    let found = candidates.into_iter().flatten().find(|folder| draft.root.join(folder).is_dir());
    if found.is_none() {
        let near = suggest_file_name(&draft.root.join(written), |_| true)
            .map(|near| format!("did you mean {near:?}? "))
            .unwrap_or_default();
        let help = format!("{near}name the folder with the images, from the folder of input.path or of the table");
        check.report_error("input.images", format!("no folder {written} is in {}", draft.root.display()), help);
    }
    found
}

/// Warns of each image file that is stored turned.
pub(super) fn warn_of_turned_files(draft: &mut DatasetDraft<'_>) {
    let root = draft.root;
    let turns: Vec<Option<u16>> =
        draft.reals.par_iter().map(|real| exif::find_turn_of_file(&root.join(&real.path))).collect();
    for (real, turn) in draft.reals.iter().zip(turns) {
        draft.notes.extend(turn.map(|turn| warn_of_turn(&real.key, turn)));
    }
}

/// Warns of an image that is stored turned: copies of it are PNG, which do not say so.
pub(super) fn warn_of_turn(image: &str, turn: u16) -> Diagnostic {
    Diagnostic::warning(format!(
        "{image} is stored turned (EXIF orientation {turn}), and copies of it are not turned back"
    ))
    .about(image, "images are stored turned (EXIF orientation), and copies of them are not turned back")
    .help("save it upright, for example with `mogrify -auto-orient`")
}

/// Why an image cannot be used.
pub struct UnreadableImage {
    /// Message about the image.
    pub message: String,
    /// Common cause of many such images, written after their number.
    pub cause: String,
}

/// Explains why an image could not be read, with `reason` from the decoder.
pub(super) fn explain_unreadable(draft: &DatasetDraft<'_>, real: &RealSample, reason: &str) -> UnreadableImage {
    if is_missing(draft, real) {
        UnreadableImage {
            message: format!("cannot read the image {}: it is not there", real.key),
            cause: String::from("images are not there"),
        }
    } else {
        UnreadableImage {
            message: format!("cannot read the image {}: {reason}", real.key),
            cause: format!("images cannot be read ({reason})"),
        }
    }
}

fn is_missing(draft: &DatasetDraft<'_>, real: &RealSample) -> bool {
    draft.layout != InputLayout::Tars && !draft.root.join(&real.path).try_exists().unwrap_or(true)
}

/// Returns what to do about an image that could not be read.
pub(super) fn help_for_image(draft: &DatasetDraft<'_>, real: &RealSample) -> String {
    let without = match draft.layout {
        InputLayout::Tables => "remove its row",
        InputLayout::Tars => "write the tar anew without the sample",
        InputLayout::Coco => "take it and its annotations out",
        InputLayout::ClassFolders(_) => "remove the file",
    };
    match draft.layout {
        _ if is_missing(draft, real) => {
            find_elsewhere(draft, real).unwrap_or_else(|| format!("copy it there, or {without}"))
        }
        InputLayout::Tars => {
            let suffix = draft.image_column.as_deref().unwrap_or_default();
            format!("put a valid image ({FORMAT_NAMES}) into the tar as the file that ends in {suffix}, or {without}")
        }
        _ => format!("put a valid image there ({FORMAT_NAMES}), or {without}"),
    }
}

/// Finds an image that is not where its label says, and returns what to write instead.
pub(super) fn find_elsewhere(draft: &DatasetDraft<'_>, real: &RealSample) -> Option<String> {
    let of_images = &draft.units[real.unit].images;
    let name = real.image.rsplit(['/', '\\']).next().filter(|name| !name.is_empty())?;
    if let Some(path) = path_inside(of_images, &real.image)
        && let Some(near) = suggest_file_name(&draft.root.join(path), has_image_extension)
        && !differ_in_digits(&near, name)
    {
        return Some(format!("is {near:?} meant by {name:?}? write it as the file is called"));
    }
    let folders = list_folders(draft.root, DEEPEST, &mut 0);
    let from_root = |path: &Path| path.strip_prefix(draft.root).unwrap_or(path).display().to_string();
    let holds = |part: &str| folders.iter().find(|folder| folder.join(part).is_file());
    if let Some(found) = (!is_absolute(&real.image)).then(|| holds(&real.image)).flatten() {
        let found = from_root(found);
        let found = if found.is_empty() { "." } else { &found };
        return Some(format!("they are in {found}: say so under [input]: images = {found:?}"));
    }
    // For `/home/ann/set/img/00.png`, `img/00.png` may exist here.
    let steps: Vec<&str> = real.image.split(['/', '\\']).filter(|step| !step.is_empty()).collect();
    for first in 1..steps.len() {
        let part = steps[first..].join("/");
        let Some(found) = holds(&part) else { continue };
        let found = from_root(&found.join(&part));
        let advice = match Path::new(&found).strip_prefix(of_images) {
            Ok(rest) => format!("write names like {} in the table", rest.display()),
            Err(_) => {
                let folder = Path::new(&found).parent().unwrap_or(Path::new("")).display().to_string();
                format!("write names like {name} in the table, and images = {folder:?} under [input]")
            }
        };
        return Some(format!("{found} is there: {advice}"));
    }
    None
}

/// Returns true if two names have different digits: they are different images of a series, not one misspelt name.
fn differ_in_digits(a: &str, b: &str) -> bool {
    let digits = |name: &str| name.chars().filter(char::is_ascii_digit).collect::<String>();
    digits(a) != digits(b)
}

/// Lists a folder and the folders in it, without hidden ones.
fn list_folders(folder: &Path, deep: usize, asked: &mut usize) -> Vec<PathBuf> {
    let mut found = vec![folder.to_owned()];
    *asked += 1;
    if deep == 0 || *asked > MAX_FOLDERS {
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
        found.extend(list_folders(&path, deep - 1, asked));
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
            assert_eq!(path_inside(Path::new(folder), name), expected.map(PathBuf::from), "{folder} {name}");
        }
    }
}
