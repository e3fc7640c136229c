//! Finds the labels of a real dataset: one table, tables in folders, COCO annotations, tars, or the folders' own names.

use std::fs;
use std::io;
use std::path::{Path, PathBuf};

use super::names::{is_split, lowercase_ending};
use super::{InputLayout, InputUnit, LabelFormat, coco, folders, unread};
use crate::config::Input;
use gelsim_dataset::sensor_set::SensorSet;
use gelsim_files::image_file::has_image_extension;
use gelsim_files::input::{may_be_file, suggest_file_name};
use gelsim_files::spelling::join_alternatives;
use gelsim_job::plan::check::JobChecker;

/// Names of tables, the most usual first.
const TABLE_NAMES: [&str; 4] = ["metadata.jsonl", "metadata.csv", "labels.csv", "labels.jsonl"];
/// Value of `input.labels` that takes the folders' names as labels.
const FOLDERS: &str = "folders";
/// Endings of files that may be a table under another name.
const TABLE_ENDINGS: [&str; 7] = ["csv", "jsonl", "tsv", "xlsx", "xls", "parquet", "arrow"];
/// Depth of folders that are searched for tables and tars.
const MAX_FOLDER_LEVELS: usize = 3;
/// Depth of folders that are searched for images whose folders are labels.
const MAX_IMAGE_FOLDER_LEVELS: usize = 12;
/// Most tables that a message names.
const MAX_NAMED: usize = 3;
/// The folder of a set and its units, still without samples.
pub struct FoundDataset {
    /// Folder of the set.
    pub root: PathBuf,
    /// Layout of the set.
    pub layout: InputLayout,
    /// Units, in the order of their names.
    pub units: Vec<InputUnit>,
    /// For a set without a table: all images, and all other files that are no labels, relative to the folder.
    pub files: folders::FolderFiles,
}

/// Finds the units of the set that `written` names. `None` after a mistake.
pub fn find_units(check: &mut JobChecker<'_>, written: &Input) -> Option<FoundDataset> {
    let Some(path) = &written.path else {
        check.report_missing("input.path", "the folder of the real dataset");
        return None;
    };
    let path = check.document.folder_of("input.path").join(path);
    if lowercase_ending(&path) == "tar" && path.is_file() {
        let root = path.parent().unwrap_or(Path::new("")).to_owned();
        let units = vec![new_unit(PathBuf::from(path.file_name()?), LabelFormat::Tar)];
        return Some(FoundDataset { root, layout: InputLayout::Tars, units, files: folders::FolderFiles::default() });
    }
    if !path.is_dir() {
        report_missing_folder(check, &path);
        return None;
    }
    if let Ok(Some(set)) = SensorSet::find(&path) {
        let message = format!("{} is a set of {} sensors", path.display(), set.sensors.len());
        let first = path.join(&set.sensors[0].folder);
        let help = format!("name the folder of one of them: path = \"{}\"", first.display());
        check.report_error("input.path", message, help);
        return None;
    }
    match find_units_in_folder(check, written, &path) {
        Ok(found) => found,
        Err(error) => {
            let help = "make all folders in it readable, and rename what has no UTF-8 name: samples may be there";
            check.report_error("input.path", error.to_string(), help);
            None
        }
    }
}

/// Reports that the folder does not exist, and which one may be meant.
fn report_missing_folder(check: &mut JobChecker<'_>, path: &Path) {
    let shown = path.display();
    let (message, help) = match (path.exists(), lowercase_ending(path).as_str()) {
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
            let near = suggest_file_name(path, |_| true)
                .map(|near| format!("did you mean {}? ", path.with_file_name(near).display()));
            let near = near.unwrap_or_default();
            let help = format!("{near}paths are relative to the file they stand in");
            (format!("{shown} does not exist"), help)
        }
    };
    check.report_error("input.path", message, help);
}

/// Finds the units in a folder. Fails if a part of it cannot be read.
fn find_units_in_folder(check: &mut JobChecker<'_>, written: &Input, path: &Path) -> io::Result<Option<FoundDataset>> {
    let below = |deepest: usize, wanted: &dyn Fn(&str) -> bool| -> io::Result<Vec<PathBuf>> {
        let found = walk_files(path, deepest, wanted)?;
        Ok(found.into_iter().filter_map(|file| Some(file.strip_prefix(path).ok()?.to_owned())).collect())
    };
    let of_files = |layout: InputLayout, form: &LabelFormat, files: Vec<PathBuf>| {
        let units = files.into_iter().map(|file| new_unit(file, form.clone())).collect();
        Some(FoundDataset { root: path.to_owned(), layout, units, files: folders::FolderFiles::default() })
    };
    let of_tables = |files: Vec<PathBuf>| {
        let form = |file: &Path| {
            if lowercase_ending(file) == "csv" { LabelFormat::Csv(Vec::new()) } else { LabelFormat::JsonLines }
        };
        let units = files.into_iter().map(|file| new_unit(file.clone(), form(&file))).collect();
        Some(FoundDataset {
            root: path.to_owned(),
            layout: InputLayout::Tables,
            units,
            files: folders::FolderFiles::default(),
        })
    };
    let tars = || below(MAX_FOLDER_LEVELS, &|name| lowercase_ending(Path::new(name)) == "tar");
    if let Some(labels) = written.labels.as_deref().filter(|labels| *labels != FOLDERS || path.join(labels).is_file()) {
        return Ok(match lowercase_ending(Path::new(labels)).as_str() {
            "csv" | "jsonl" if may_be_file(&path.join(labels)) => of_tables(vec![PathBuf::from(labels)]),
            "json" if may_be_file(&path.join(labels)) => {
                of_files(InputLayout::Coco, &LabelFormat::Coco, vec![PathBuf::from(labels)])
            }
            _ => {
                let tars = tars()?;
                if !tars.is_empty() && !["csv", "jsonl"].contains(&lowercase_ending(Path::new(labels)).as_str()) {
                    return Ok(of_files(InputLayout::Tars, &LabelFormat::Tar, tars));
                }
                report_missing_labels(check, path, labels);
                None
            }
        });
    }
    if written.labels.is_none() {
        if let Some(name) = TABLE_NAMES.iter().find(|name| may_be_file(&path.join(name))) {
            return Ok(of_tables(vec![PathBuf::from(name)]));
        }
        if let Some((what, help)) = unread::recognise_dataset(path) {
            check.report_error("input.path", format!("{} is {what}", path.display()), help);
            return Ok(None);
        }
        let tables = below(MAX_FOLDER_LEVELS, &|name| TABLE_NAMES[..2].contains(&name))?;
        if !tables.is_empty() {
            return Ok(of_tables(tables));
        }
        let tars = tars()?;
        if !tars.is_empty() {
            return Ok(of_files(InputLayout::Tars, &LabelFormat::Tar, tars));
        }
        let coco = coco::find_annotation_files(
            path,
            below(MAX_FOLDER_LEVELS, &|name| lowercase_ending(Path::new(name)) == "json")?,
        );
        if !coco.is_empty() {
            return Ok(of_files(InputLayout::Coco, &LabelFormat::Coco, coco));
        }
        if let Some((what, help)) = unread::recognise_annotations(path) {
            check.report_error("input.path", format!("{} has {what}", path.display()), help);
            return Ok(None);
        }
        let others = below(MAX_FOLDER_LEVELS, &|name| {
            TABLE_ENDINGS.contains(&lowercase_ending(Path::new(name)).as_str()) && name != folders::TABLE_NAME
        })?;
        if !others.is_empty() {
            report_unknown_tables(check, path, &others);
            return Ok(None);
        }
    }
    let files = below(MAX_IMAGE_FOLDER_LEVELS, &|_| true)?;
    let (images, others) = files.into_iter().partition(|file| has_image_extension(file));
    let files = folders::FolderFiles { images, others, links: find_folder_links(path, MAX_IMAGE_FOLDER_LEVELS)? };
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
        check.report_error("input.path", message, help);
        return Ok(None);
    }
    let table = new_unit(PathBuf::from(folders::TABLE_NAME), LabelFormat::Csv(Vec::new()));
    Ok(Some(FoundDataset {
        root: path.to_owned(),
        layout: InputLayout::ClassFolders(folders::FolderKind::default()),
        units: vec![table],
        files,
    }))
}

/// Reports that the labels are not where the file says, and which may be meant.
fn report_missing_labels(check: &mut JobChecker<'_>, root: &Path, labels: &str) {
    let path = root.join(labels);
    let kind = lowercase_ending(&path);
    if path.is_file() {
        let message = format!("{} is no table that is read", path.display());
        let help = match kind.as_str() {
            "tsv" | "txt" => "save it as CSV: cells separated by commas, names of the columns in its first line",
            "parquet" | "arrow" | "xlsx" | "xls" => "save it as CSV or JSON Lines, and its images as files",
            _ => "name a table that ends in .csv or .jsonl, or COCO annotations that end in .json",
        };
        check.report_error("input.labels", message, help);
        return;
    }
    let near = suggest_file_name(&path, |name| ["csv", "jsonl", "json"].contains(&lowercase_ending(name).as_str()));
    let near =
        near.map(|near| format!("did you mean {:?}? ", Path::new(labels).with_file_name(near).display().to_string()));
    let near = near.unwrap_or_default();
    if ["csv", "jsonl"].contains(&kind.as_str()) || labels.contains('/') {
        let help = format!("{near}name the table of labels, from the folder of input.path");
        check.report_error("input.labels", format!("{} does not exist", path.display()), help);
    } else {
        let message = format!("no tars are in {}, and it has no file {labels:?}", root.display());
        let help = format!(
            "{near}name the table of labels (.csv, .jsonl), COCO annotations (.json), {FOLDERS:?} for classes by folder, or \
             of tars the end of the labels' names (json)"
        );
        check.report_error("input.labels", message, help);
    }
}

/// Reports that there are tables, but none whose name says that it holds the labels.
fn report_unknown_tables(check: &mut JobChecker<'_>, root: &Path, others: &[PathBuf]) {
    let names: Vec<String> = others.iter().take(MAX_NAMED).map(|file| file.display().to_string()).collect();
    let more = if others.len() > MAX_NAMED { " and more" } else { "" };
    let shown: Vec<&str> = names.iter().map(String::as_str).collect();
    let message =
        format!("which table holds the labels of {} is not known: {}{more}", root.display(), shown.join(", "));
    let first = others.iter().find(|file| ["csv", "jsonl"].contains(&lowercase_ending(file).as_str()));
    let by_folder = format!("labels = {FOLDERS:?} takes the names of the images' folders as classes");
    let help = match first {
        Some(first) => format!("name it under [input]: labels = {:?}; {by_folder}", first.display().to_string()),
        None => format!("save it as CSV or JSON Lines, and name it with input.labels; {by_folder}"),
    };
    check.report_error(
        "input.path",
        message,
        format!("{help}; {} are found by themselves", join_alternatives(&TABLE_NAMES)),
    );
}

/// Creates a unit, with the split that its name tells.
fn new_unit(file: PathBuf, form: LabelFormat) -> InputUnit {
    let folder = file.parent().unwrap_or(Path::new("")).to_owned();
    let split = match form {
        LabelFormat::Tar => split_from_path(&file),
        // `annotations/instances_train2017.json`
        LabelFormat::Coco => split_from_name(&file.file_stem().unwrap_or_default().to_string_lossy())
            .or_else(|| split_from_path(&folder)),
        _ => split_from_path(&folder),
    };
    InputUnit { file, form, reals: 0..0, split, images: folder }
}

/// Returns the split that a file or folder is named after: the first word of its name, or of the nearest folder above.
fn split_from_path(path: &Path) -> Option<String> {
    let names = path.iter().rev().map(|name| name.to_string_lossy());
    let word = |name: &str| name.split(|c: char| !c.is_ascii_alphabetic()).next().unwrap_or_default().to_owned();
    names.map(|name| word(&name)).find(|word| is_split(word))
}

/// Returns the first word of a name that is a split's.
fn split_from_name(name: &str) -> Option<String> {
    name.split(|c: char| !c.is_ascii_alphabetic()).find(|word| is_split(word)).map(str::to_owned)
}

/// Lists the files below a folder whose names are `wanted`, sorted. Skips hidden files and links to folders.
fn walk_files(folder: &Path, deep: usize, wanted: &dyn Fn(&str) -> bool) -> io::Result<Vec<PathBuf>> {
    let (mut files, mut below) = (Vec::new(), Vec::new());
    for (path, name, kind) in list_entries(folder)? {
        if kind.is_dir() && deep > 0 {
            below.extend(walk_files(&path, deep - 1, wanted)?);
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

/// Lists the links to folders below a folder, which [`walk_files`] skips.
fn find_folder_links(folder: &Path, deep: usize) -> io::Result<Vec<PathBuf>> {
    let mut found = Vec::new();
    for (path, _, kind) in list_entries(folder)? {
        if kind.is_dir() && deep > 0 {
            found.extend(find_folder_links(&path, deep - 1)?);
        } else if kind.is_symlink() && path.is_dir() {
            found.push(path);
        }
    }
    Ok(found)
}

/// Lists a folder, sorted, without hidden entries: path, name and kind of each.
fn list_entries(folder: &Path) -> io::Result<Vec<(PathBuf, String, fs::FileType)>> {
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
            assert_eq!(split_from_path(Path::new(path)).as_deref(), expected, "{path}");
        }
        for (file, expected) in [
            ("annotations/instances_train2017.json", Some("train")),
            ("valid/_annotations.coco.json", Some("valid")),
            ("annotations/instances.json", None),
        ] {
            assert_eq!(new_unit(PathBuf::from(file), LabelFormat::Coco).split.as_deref(), expected, "{file}");
        }
    }
}
