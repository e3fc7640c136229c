//! Where the labels of a real dataset are: one table, tables in folders, or tars.

use std::fs;
use std::io;
use std::path::{Path, PathBuf};

use super::{Form, Unit};
use crate::files::input::may_be_file;
use crate::job::plan::check::Check;
use crate::lab::augment::config::Input;

/// Names of tables, the most usual first.
const TABLES: [&str; 4] = ["metadata.jsonl", "metadata.csv", "labels.csv", "labels.jsonl"];
/// Folders in folders that are looked into.
const DEEPEST: usize = 3;
/// Words that begin the name of a split's file or folder.
const SPLITS: [&str; 10] =
    ["train", "training", "val", "valid", "validation", "dev", "test", "testing", "eval", "evaluation"];

/// A set's folder and its units, still without samples.
pub struct Found {
    /// The folder.
    pub root: PathBuf,
    /// The units, in the order of their names.
    pub units: Vec<Unit>,
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
        let units = vec![unit(PathBuf::from(path.file_name()?))];
        return Some(Found { root, units });
    }
    if !path.is_dir() {
        let what = if path.exists() { "is no folder" } else { "does not exist" };
        let help = "name the folder with the images and their labels; paths are relative to the file they stand in";
        check.error("input.path", format!("{} {what}", path.display()), help);
        return None;
    }
    let below = |wanted: &dyn Fn(&str) -> bool| -> io::Result<Vec<PathBuf>> {
        let found = walk(&path, DEEPEST, wanted)?;
        Ok(found.into_iter().filter_map(|file| Some(file.strip_prefix(&path).ok()?.to_owned())).collect())
    };
    let tars = || below(&|name| ending(Path::new(name)) == "tar");
    let files = match &written.labels {
        Some(labels) if ["csv", "jsonl"].contains(&ending(Path::new(labels)).as_str()) => {
            if !may_be_file(&path.join(labels)) {
                let message = format!("{} does not exist", path.join(labels).display());
                check.error("input.labels", message, "name the table of labels, from the folder of input.path");
                return None;
            }
            Ok(vec![PathBuf::from(labels)])
        }
        Some(_) => tars(),
        None => match TABLES.iter().find(|name| may_be_file(&path.join(name))) {
            Some(name) => Ok(vec![PathBuf::from(name)]),
            None => match below(&|name| TABLES[..2].contains(&name)) {
                Ok(tables) if tables.is_empty() => tars(),
                tables => tables,
            },
        },
    };
    let files = match files {
        Ok(files) => files,
        Err(error) => {
            check.error("input.path", error.to_string(), "all folders in it are to be readable: samples may be there");
            return None;
        }
    };
    if files.is_empty() {
        let message = format!("no labels are in {}", path.display());
        let help = "a table (labels.csv, labels.jsonl, metadata.csv, metadata.jsonl, or input.labels = \"...\") or tars \
                    belong there";
        check.error("input.path", message, help);
        return None;
    }
    Some(Found { root: path, units: files.into_iter().map(unit).collect() })
}

fn unit(file: PathBuf) -> Unit {
    let form = match ending(&file).as_str() {
        "tar" => Form::Tar,
        "csv" => Form::Csv(Vec::new()),
        _ => Form::JsonLines,
    };
    let split = split(if form == Form::Tar { &file } else { file.parent().unwrap_or(Path::new("")) });
    Unit { file, form, reals: 0..0, split }
}

fn ending(path: &Path) -> String {
    path.extension().map(|ending| ending.to_string_lossy().to_ascii_lowercase()).unwrap_or_default()
}

/// The split that a file or folder is named for: its name, or that of the folder nearest to it, begins with a known word.
fn split(path: &Path) -> Option<String> {
    let names = path.iter().rev().map(|name| name.to_string_lossy());
    let word = |name: &str| name.split(|c: char| !c.is_ascii_alphabetic()).next().unwrap_or_default().to_owned();
    names.map(|name| word(&name)).find(|word| SPLITS.contains(&word.to_ascii_lowercase().as_str()))
}

/// Files below a folder whose names are wanted, sorted; hidden ones and links to folders are passed over.
fn walk(folder: &Path, deep: usize, wanted: &dyn Fn(&str) -> bool) -> io::Result<Vec<PathBuf>> {
    let named = |error: io::Error| io::Error::new(error.kind(), format!("{}: {error}", folder.display()));
    let mut entries = fs::read_dir(folder).and_then(|entries| entries.collect::<Result<Vec<_>, _>>()).map_err(named)?;
    entries.sort_by_key(fs::DirEntry::file_name);
    let (mut files, mut below) = (Vec::new(), Vec::new());
    for entry in entries {
        let name = entry.file_name();
        let (Some(name), kind) = (name.to_str(), entry.file_type().map_err(named)?) else { continue };
        match name.starts_with('.') {
            true => {}
            false if kind.is_dir() && deep > 0 => below.extend(walk(&entry.path(), deep - 1, wanted)?),
            false if !kind.is_dir() && wanted(name) => files.push(entry.path()),
            false => {}
        }
    }
    files.extend(below);
    Ok(files)
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
    }
}
