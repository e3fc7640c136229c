//! Names of classes, where the job gives none: from the files' names, or from the folders that they are in.

use std::collections::{BTreeMap, BTreeSet};
use std::path::{Component, Path};

use super::meshes::File;
use crate::config::object::{ClassFrom, Object};
use gelsim_files::diagnostic::{Diagnostic, Diagnostics};

/// The class of each file, before its parts are told apart. Where files in different folders have one name, the folder by
/// which they differ names the class, with a note; unless the job says what does.
pub fn classes(objects: &[Object], files: &[File], notes: &mut Diagnostics) -> Vec<String> {
    let mut classes: Vec<String> = files.iter().map(|file| named(&objects[file.entry], file)).collect();
    let mut same: BTreeMap<String, Vec<usize>> = BTreeMap::new();
    for (i, file) in files.iter().enumerate() {
        let object = &objects[file.entry];
        if object.class.is_none() && object.class_from.is_none() {
            same.entry(classes[i].clone()).or_default().push(i);
        }
    }
    for (stem, files_of_stem) in same {
        let paths: Vec<&Path> = files_of_stem.iter().map(|&i| files[i].path.as_path()).collect();
        let Some(folders) = differing(&paths) else { continue };
        let different = folders.iter().collect::<BTreeSet<_>>().len();
        let message = format!(
            "{different} meshes are called `{stem}`: their classes are named after the folders by which they differ, the first \
             `{}`",
            folders[0]
        );
        let help = "class_from = \"folder\" under [[object]] says that it is meant, class_from = \"stem\" makes them one class";
        notes.push(Diagnostic::note(message).of(
            format!("`{stem}`"),
            "names stand for several meshes each, whose classes are named after the folders by which they differ",
        ).help(help));
        for (i, folder) in files_of_stem.into_iter().zip(folders) {
            classes[i] = folder;
        }
    }
    classes
}

fn named(object: &Object, file: &File) -> String {
    let written = object.path.as_deref().unwrap_or_default();
    match object.class_from.unwrap_or(ClassFrom::Stem) {
        ClassFrom::Stem => stem(&file.path.to_string_lossy()),
        ClassFrom::File => file.path.file_name().map_or_else(String::new, |name| name.to_string_lossy().into_owned()),
        ClassFrom::Folder => folder(written, file),
    }
}

/// The folder that the first wildcard of the pattern stands for; where that is the file itself, or there is none, the folder
/// that the file is in.
fn folder(written: &str, file: &File) -> String {
    // Before its first wildcard a pattern and what it finds are the same.
    let found = parts(Path::new(&file.label));
    let wild = parts(Path::new(written)).iter().position(|part| part.contains(['*', '?', '[']));
    if let Some(folder) = wild.and_then(|wild| found[..found.len().saturating_sub(1)].get(wild)) {
        return folder.clone();
    }
    let absolute = std::path::absolute(&file.path).unwrap_or_else(|_| file.path.clone());
    absolute.parent().and_then(|folder| parts(folder).pop()).unwrap_or_else(|| String::from("folder"))
}

fn parts(path: &Path) -> Vec<String> {
    let normal = path.components().filter(|part| !matches!(part, Component::CurDir));
    normal.map(|part| part.as_os_str().to_string_lossy().into_owned()).collect()
}

/// For each path the folder, counted from its end, by which all of them differ; where no single one does, all folders below
/// the first that they do not share. `None` if they are all in one folder.
fn differing(paths: &[&Path]) -> Option<Vec<String>> {
    let absolute = |path: &&Path| std::path::absolute(path).unwrap_or_else(|_| path.to_path_buf());
    let folders: Vec<Vec<String>> =
        paths.iter().map(absolute).map(|path| path.parent().map(parts).unwrap_or_default()).collect();
    let different: BTreeSet<&Vec<String>> = folders.iter().collect();
    if different.len() < 2 {
        return None;
    }
    let deepest = folders.iter().map(Vec::len).min().unwrap_or(0);
    for back in 1..=deepest {
        let at = |folder: &Vec<String>| folder[folder.len() - back].clone();
        if different.iter().map(|folder| at(folder)).collect::<BTreeSet<_>>().len() == different.len() {
            return Some(folders.iter().map(at).collect());
        }
    }
    let shared = (0..deepest).take_while(|&k| folders.iter().all(|folder| folder[k] == folders[0][k])).count();
    // One of them may be above the others: then its own name stands for it.
    let named = |folder: &Vec<String>| folder[shared.min(folder.len().saturating_sub(1))..].join("/");
    Some(folders.iter().map(named).collect())
}

/// An object's name before numbers tell equal ones apart: the stem of its file, and the part that it is.
pub fn name(path: &str, part: Option<&str>) -> String {
    let stem = stem(path);
    part.map_or(stem.clone(), |part| format!("{stem}/{part}"))
}

/// A mesh's name: that of its file, without folder and ending.
pub fn stem(path: &str) -> String {
    Path::new(path).file_stem().map_or(String::from("object"), |stem| stem.to_string_lossy().into_owned())
}

#[cfg(test)]
mod tests {
    use super::*;

    fn differ(paths: &[&str]) -> Option<Vec<String>> {
        differing(&paths.iter().map(Path::new).collect::<Vec<_>>())
    }

    #[test]
    fn the_folder_that_differs_is_found() {
        assert_eq!(differ(&["/y/1_a/g/n.stl", "/y/2_b/g/n.stl"]), Some(vec!["1_a".into(), "2_b".into()]));
        assert_eq!(differ(&["/y/a/n.stl", "/y/a/n.obj"]), None);
        assert_eq!(differ(&["/y/a/n.stl", "/y/a/n.obj", "/y/b/n.stl"]), Some(vec!["a".into(), "a".into(), "b".into()]));
        let crossed = differ(&["/y/a/u/n.stl", "/y/a/v/n.stl", "/y/b/u/n.stl"]);
        assert_eq!(crossed, Some(vec!["a/u".into(), "a/v".into(), "b/u".into()]));
        assert_eq!(differ(&["/y/n.stl", "/y/a/n.stl"]), Some(vec!["y".into(), "a".into()]));
    }

    #[test]
    fn a_folder_is_what_the_first_wildcard_stands_for() {
        let of = |written: &str, label: &str| {
            let path = Path::new("/job").join(label);
            folder(written, &File { entry: 0, path, label: label.into() })
        };
        assert_eq!(of("m/*/train/*.off", "m/chair/train/chair_1.off"), "chair");
        assert_eq!(of("./m/*/n.stl", "m/a/n.stl"), "a");
        assert_eq!(of("m/**/*.stl", "m/a/b/n.stl"), "a");
        assert_eq!(of("m/**/*.stl", "m/n.stl"), "m");
        assert_eq!(of("m/*.stl", "m/n.stl"), "m");
        assert_eq!(of("m/n.stl", "m/n.stl"), "m");
        assert_eq!(of("n.stl", "n.stl"), "job");
    }
}
