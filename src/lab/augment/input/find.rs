//! Where the labels of a real dataset are: one table, tables in folders, COCO annotations, tars, or the folders' own names.

use std::fs;
use std::io;
use std::path::{Path, PathBuf};

use super::names::{ending, is_split};
use super::{Form, Layout, Unit, coco, folders, unread};
use crate::config::Input;
use gelsim_files::image_file::is_named_like_one;
use gelsim_files::input::{may_be_file, meant};
use gelsim_files::spelling::one_of;
use gelsim_job::plan::check::Check;

/// Names of tables, the most usual first.
const TABLES: [&str; 4] = ["metadata.jsonl", "metadata.csv", "labels.csv", "labels.jsonl"];
/// What names the folders' names as labels.
const FOLDERS: &str = "folders";
/// Endings of files that may be a table under another name.
const TABLE_ENDINGS: [&str; 7] = ["csv", "jsonl", "tsv", "xlsx", "xls", "parquet", "arrow"];
/// Folders in folders that are looked into for tables and tars.
const DEEPEST: usize = 3;
/// The same for images, whose folders are labels.
const DEEPEST_IMAGE: usize = 12;
/// Tables that a message names.
const NAMED: usize = 3;
/// A set's folder and its units, still without samples.
pub struct Found {
    /// The folder.
    pub root: PathBuf,
    /// How it is laid out.
    pub layout: Layout,
    /// The units, in the order of their names.
    pub units: Vec<Unit>,
    /// All images, from the folder, of a set without a table; all other files that are no labels.
    pub files: folders::Files,
}

/// Finds the units of the set that `written` names. `None` after a mistake.
pub fn units(check: &mut Check<'_>, written: &Input) -> Option<Found> {
    let Some(path) = &written.path else {
        check.missing("input.path", "the folder of the real dataset");
        return None;
    };
    let path = check.document.folder("input.path").join(path);
    if ending(&path) == "tar" && path.is_file() {
        let root = path.parent().unwrap_or(Path::new("")).to_owned();
        let units = vec![unit(PathBuf::from(path.file_name()?), Form::Tar)];
        return Some(Found { root, layout: Layout::Tars, units, files: folders::Files::default() });
    }
    if !path.is_dir() {
        no_folder(check, &path);
        return None;
    }
    match in_folder(check, written, &path) {
        Ok(found) => found,
        Err(error) => {
            let help = "make all folders in it readable, and rename what has no UTF-8 name: samples may be there";
            check.error("input.path", error.to_string(), help);
            None
        }
    }
}

/// Says that there is no folder, and what was meant.
fn no_folder(check: &mut Check<'_>, path: &Path) {
    let shown = path.display();
    let (message, help) = match (path.exists(), ending(path).as_str()) {
        (true, "csv" | "jsonl" | "json") => {
            let folder = path.parent().unwrap_or(Path::new("")).display();
            let name = path.file_name().unwrap_or_default().to_string_lossy();
            let help = format!("name its folder and then the table: path = \"{folder}\", labels = \"{name}\"");
            (format!("{shown} is a file"), help)
        }
        (true, "zip" | "gz" | "tgz" | "bz2" | "xz" | "zst" | "7z" | "rar") => {
            (format!("{shown} is an archive"), String::from("unpack it, and name the folder with what was in it"))
        }
        (true, _) => {
            (format!("{shown} is no folder"), String::from("name the folder with the images and their labels"))
        }
        (false, _) => {
            let near =
                meant(path, |_| true).map(|near| format!("did you mean {}? ", path.with_file_name(near).display()));
            let near = near.unwrap_or_default();
            let help = format!("{near}paths are relative to the file they stand in");
            (format!("{shown} does not exist"), help)
        }
    };
    check.error("input.path", message, help);
}

/// Finds the units in a folder. An error if a part of it cannot be read.
fn in_folder(check: &mut Check<'_>, written: &Input, path: &Path) -> io::Result<Option<Found>> {
    let below = |deepest: usize, wanted: &dyn Fn(&str) -> bool| -> io::Result<Vec<PathBuf>> {
        let found = walk(path, deepest, wanted)?;
        Ok(found.into_iter().filter_map(|file| Some(file.strip_prefix(path).ok()?.to_owned())).collect())
    };
    let of_files = |layout: Layout, form: &Form, files: Vec<PathBuf>| {
        let units = files.into_iter().map(|file| unit(file, form.clone())).collect();
        Some(Found { root: path.to_owned(), layout, units, files: folders::Files::default() })
    };
    let of_tables = |files: Vec<PathBuf>| {
        let form = |file: &Path| if ending(file) == "csv" { Form::Csv(Vec::new()) } else { Form::JsonLines };
        let units = files.into_iter().map(|file| unit(file.clone(), form(&file))).collect();
        Some(Found { root: path.to_owned(), layout: Layout::Tables, units, files: folders::Files::default() })
    };
    let tars = || below(DEEPEST, &|name| ending(Path::new(name)) == "tar");
    if let Some(labels) = written.labels.as_deref().filter(|labels| *labels != FOLDERS || path.join(labels).is_file()) {
        return Ok(match ending(Path::new(labels)).as_str() {
            "csv" | "jsonl" if may_be_file(&path.join(labels)) => of_tables(vec![PathBuf::from(labels)]),
            "json" if may_be_file(&path.join(labels)) => {
                of_files(Layout::Coco, &Form::Coco, vec![PathBuf::from(labels)])
            }
            _ => {
                let tars = tars()?;
                if !tars.is_empty() && !["csv", "jsonl"].contains(&ending(Path::new(labels)).as_str()) {
                    return Ok(of_files(Layout::Tars, &Form::Tar, tars));
                }
                no_labels_file(check, path, labels);
                None
            }
        });
    }
    if written.labels.is_none() {
        if let Some(name) = TABLES.iter().find(|name| may_be_file(&path.join(name))) {
            return Ok(of_tables(vec![PathBuf::from(name)]));
        }
        if let Some((what, help)) = unread::recognise(path) {
            check.error("input.path", format!("{} is {what}", path.display()), help);
            return Ok(None);
        }
        let tables = below(DEEPEST, &|name| TABLES[..2].contains(&name))?;
        if !tables.is_empty() {
            return Ok(of_tables(tables));
        }
        let tars = tars()?;
        if !tars.is_empty() {
            return Ok(of_files(Layout::Tars, &Form::Tar, tars));
        }
        let coco = coco::files(path, below(DEEPEST, &|name| ending(Path::new(name)) == "json")?);
        if !coco.is_empty() {
            return Ok(of_files(Layout::Coco, &Form::Coco, coco));
        }
        if let Some((what, help)) = unread::recognise_annotations(path) {
            check.error("input.path", format!("{} has {what}", path.display()), help);
            return Ok(None);
        }
        let others = below(DEEPEST, &|name| {
            TABLE_ENDINGS.contains(&ending(Path::new(name)).as_str()) && name != folders::TABLE
        })?;
        if !others.is_empty() {
            other_tables(check, path, &others);
            return Ok(None);
        }
    }
    let files = below(DEEPEST_IMAGE, &|_| true)?;
    let (images, others) = files.into_iter().partition(|file| is_named_like_one(file));
    let files = folders::Files { images, others, links: links(path, DEEPEST_IMAGE)? };
    if files.images.is_empty() {
        let (message, help) = match unread::recognise_files(&files.others) {
            Some((what, help)) => (format!("{} holds {what}, and no images", path.display()), help),
            None => (
                format!("no labels and no images are in {}", path.display()),
                String::from(
                    "name the folder that has images in it with a table of labels (labels.csv, labels.jsonl, metadata.csv, \
                     metadata.jsonl), with COCO annotations, with a folder for each class, or that has WebDataset tars",
                ),
            ),
        };
        check.error("input.path", message, help);
        return Ok(None);
    }
    let table = unit(PathBuf::from(folders::TABLE), Form::Csv(Vec::new()));
    Ok(Some(Found {
        root: path.to_owned(),
        layout: Layout::ClassFolders(folders::FolderKind::default()),
        units: vec![table],
        files,
    }))
}

/// Says that the labels are not where the file says, and what was meant.
fn no_labels_file(check: &mut Check<'_>, root: &Path, labels: &str) {
    let path = root.join(labels);
    let kind = ending(&path);
    if path.is_file() {
        let message = format!("{} is no table that is read", path.display());
        let help = match kind.as_str() {
            "tsv" | "txt" => "save it as CSV: cells separated by commas, names of the columns in its first line",
            "parquet" | "arrow" | "xlsx" | "xls" => "save it as CSV or JSON Lines, and its images as files",
            _ => "name a table that ends in .csv or .jsonl, or COCO annotations that end in .json",
        };
        check.error("input.labels", message, help);
        return;
    }
    let near = meant(&path, |name| ["csv", "jsonl", "json"].contains(&ending(name).as_str()));
    let near =
        near.map(|near| format!("did you mean {:?}? ", Path::new(labels).with_file_name(near).display().to_string()));
    let near = near.unwrap_or_default();
    if ["csv", "jsonl"].contains(&kind.as_str()) || labels.contains('/') {
        let help = format!("{near}name the table of labels, from the folder of input.path");
        check.error("input.labels", format!("{} does not exist", path.display()), help);
    } else {
        let message = format!("no tars are in {}, and it has no file {labels:?}", root.display());
        let help = format!(
            "{near}name the table of labels (.csv, .jsonl), COCO annotations (.json), {FOLDERS:?} for classes by folder, or \
             of tars the end of the labels' names (json)"
        );
        check.error("input.labels", message, help);
    }
}

/// Says that there are tables, but none with a name that says it is the labels.
fn other_tables(check: &mut Check<'_>, root: &Path, others: &[PathBuf]) {
    let names: Vec<String> = others.iter().take(NAMED).map(|file| file.display().to_string()).collect();
    let more = if others.len() > NAMED { " and more" } else { "" };
    let shown: Vec<&str> = names.iter().map(String::as_str).collect();
    let message =
        format!("which table holds the labels of {} is not known: {}{more}", root.display(), shown.join(", "));
    let first = others.iter().find(|file| ["csv", "jsonl"].contains(&ending(file).as_str()));
    let by_folder = format!("labels = {FOLDERS:?} takes the names of the images' folders as classes");
    let help = match first {
        Some(first) => format!("name it under [input]: labels = {:?}; {by_folder}", first.display().to_string()),
        None => format!("save it as CSV or JSON Lines, and name it with input.labels; {by_folder}"),
    };
    check.error("input.path", message, format!("{help}; {} are found by themselves", one_of(&TABLES)));
}

fn unit(file: PathBuf, form: Form) -> Unit {
    let folder = file.parent().unwrap_or(Path::new("")).to_owned();
    let split = match form {
        Form::Tar => split(&file),
        // `annotations/instances_train2017.json`
        Form::Coco => split_in(&file.file_stem().unwrap_or_default().to_string_lossy()).or_else(|| split(&folder)),
        _ => split(&folder),
    };
    Unit { file, form, reals: 0..0, split, images: folder }
}

/// The split that a file or folder is named for: its name, or that of the folder nearest to it, begins with a known word.
fn split(path: &Path) -> Option<String> {
    let names = path.iter().rev().map(|name| name.to_string_lossy());
    let word = |name: &str| name.split(|c: char| !c.is_ascii_alphabetic()).next().unwrap_or_default().to_owned();
    names.map(|name| word(&name)).find(|word| is_split(word))
}

/// The first word of a name that is one of a split.
fn split_in(name: &str) -> Option<String> {
    name.split(|c: char| !c.is_ascii_alphabetic()).find(|word| is_split(word)).map(str::to_owned)
}

/// Files below a folder whose names are wanted, sorted; hidden ones and links to folders are passed over.
fn walk(folder: &Path, deep: usize, wanted: &dyn Fn(&str) -> bool) -> io::Result<Vec<PathBuf>> {
    let (mut files, mut below) = (Vec::new(), Vec::new());
    for (path, name, kind) in entries(folder)? {
        if kind.is_dir() && deep > 0 {
            below.extend(walk(&path, deep - 1, wanted)?);
        } else if !kind.is_dir() && wanted(&name) && !(kind.is_symlink() && path.is_dir()) {
            match path.to_str() {
                Some(_) => files.push(path),
                None => return Err(io::Error::other(format!("the name {path:?} is not UTF-8"))),
            }
        }
    }
    files.extend(below);
    Ok(files)
}

/// Links to folders below a folder, which [`walk`] passes over.
fn links(folder: &Path, deep: usize) -> io::Result<Vec<PathBuf>> {
    let mut found = Vec::new();
    for (path, _, kind) in entries(folder)? {
        if kind.is_dir() && deep > 0 {
            found.extend(links(&path, deep - 1)?);
        } else if kind.is_symlink() && path.is_dir() {
            found.push(path);
        }
    }
    Ok(found)
}

/// What is in a folder, sorted, without what is hidden: path, name, and what it is.
fn entries(folder: &Path) -> io::Result<Vec<(PathBuf, String, fs::FileType)>> {
    let named = |error: io::Error| io::Error::new(error.kind(), format!("{}: {error}", folder.display()));
    let mut entries = fs::read_dir(folder).and_then(|entries| entries.collect::<Result<Vec<_>, _>>()).map_err(named)?;
    entries.sort_by_key(fs::DirEntry::file_name);
    let mut found = Vec::new();
    for entry in entries {
        let (name, kind) = (entry.file_name().to_string_lossy().into_owned(), entry.file_type().map_err(named)?);
        if !name.starts_with('.') {
            found.push((entry.path(), name, kind));
        }
    }
    Ok(found)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_name_tells_its_split_by_its_first_word() {
        for (path, expected) in [
            ("data/train-000000.tar", Some("train")),
            ("test.tar", Some("test")),
            ("validation/part-3", Some("validation")),
            ("trains-000.tar", None),
            ("shard-000001.tar", None),
            ("", None),
        ] {
            assert_eq!(split(Path::new(path)).as_deref(), expected, "{path}");
        }
        for (file, expected) in [
            ("annotations/instances_train2017.json", Some("train")),
            ("valid/_annotations.coco.json", Some("valid")),
            ("annotations/instances.json", None),
        ] {
            assert_eq!(unit(PathBuf::from(file), Form::Coco).split.as_deref(), expected, "{file}");
        }
    }
}
