//! Names classes if the job does not: after the files, or after the folders that they are in.

use std::collections::{BTreeMap, BTreeSet};
use std::path::{Component, Path, PathBuf};

use super::meshes::ObjectFile;
use crate::config::object::{ClassFrom, Object};
use gelsim_files::diagnostic::{Diagnostic, Diagnostics};

/// Returns the class of each file, before its parts are told apart. If files in different folders have the same name
/// and the job does not say otherwise, the folder by which they differ names the class, and there is a note.
pub fn name_classes(objects: &[Object], files: &[ObjectFile], notes: &mut Diagnostics) -> Vec<String> {
    let mut classes: Vec<String> = files.iter().map(|file| name_class(&objects[file.entry], file)).collect();
    let mut same: BTreeMap<String, Vec<usize>> = BTreeMap::new();
    for (i, file) in files.iter().enumerate() {
        let object = &objects[file.entry];
        if object.class.is_none() && object.class_from.is_none() {
            same.entry(classes[i].clone()).or_default().push(i);
        }
    }
    for (stem, files_of_stem) in same {
        let paths: Vec<&Path> = files_of_stem.iter().map(|&i| files[i].path.as_path()).collect();
        let Some(folders) = find_distinct_folders(&paths) else { continue };
        let different = folders.iter().collect::<BTreeSet<_>>().len();
        let message = format!(
            "{different} meshes are called `{stem}`: their classes are named after the folders by which they differ, the first \
             `{}`",
            folders[0]
        );
        let help = "class_from = \"folder\" under [[object]] says that it is meant, class_from = \"stem\" makes them one class";
        notes.push(Diagnostic::note(message).about(
            format!("`{stem}`"),
            "names stand for several meshes each, whose classes are named after the folders by which they differ",
        ).help(help));
        for (i, folder) in files_of_stem.into_iter().zip(folders) {
            classes[i] = folder;
        }
    }
    classes
}

fn name_class(object: &Object, file: &ObjectFile) -> String {
    let written = object.path.as_deref().unwrap_or_default();
    match object.class_from.unwrap_or(ClassFrom::Stem) {
        ClassFrom::Stem => file_stem(&file.path.to_string_lossy()),
        ClassFrom::File => file.path.file_name().map_or_else(String::new, |name| name.to_string_lossy().into_owned()),
        ClassFrom::Folder => find_class_folder(written, file),
    }
}

/// Returns the folder that the first wildcard of the pattern stands for. If that is the file itself, or there is no
/// wildcard, it is the folder that the file is in.
fn find_class_folder(written: &str, file: &ObjectFile) -> String {
    // A pattern and what it finds are the same up to the first wildcard.
    let found = split_path(Path::new(&file.label));
    let wild = split_path(Path::new(written)).iter().position(|part| part.contains(['*', '?', '[']));
    if let Some(folder) = wild.and_then(|wild| found[..found.len().saturating_sub(1)].get(wild)) {
        return folder.clone();
    }
    let absolute = std::path::absolute(&file.path).unwrap_or_else(|_| file.path.clone());
    absolute.parent().and_then(|folder| split_path(folder).pop()).unwrap_or_else(|| String::from("folder"))
}

/// Removes each `..` with the folder before it, so that one folder has one spelling.
fn remove_steps_back(path: &Path) -> PathBuf {
    let mut plain = PathBuf::new();
    for part in path.components() {
        match part {
            Component::ParentDir if plain.file_name().is_some() => drop(plain.pop()),
            part => plain.push(part),
        }
    }
    plain
}

fn split_path(path: &Path) -> Vec<String> {
    let normal = path.components().filter(|part| !matches!(part, Component::CurDir));
    normal.map(|part| part.as_os_str().to_string_lossy().into_owned()).collect()
}

/// Returns for each path the folder, counted from the end, by which all of them differ. If no single folder does, it is
/// the path below the folders that they share. Returns `None` if all are in one folder.
fn find_distinct_folders(paths: &[&Path]) -> Option<Vec<String>> {
    let absolute = |path: &&Path| remove_steps_back(&std::path::absolute(path).unwrap_or_else(|_| path.to_path_buf()));
    let folders: Vec<Vec<String>> =
        paths.iter().map(absolute).map(|path| path.parent().map(split_path).unwrap_or_default()).collect();
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
    // One of the folders may contain the others; its own name then stands for it.
    let named = |folder: &Vec<String>| folder[shared.min(folder.len().saturating_sub(1))..].join("/");
    Some(folders.iter().map(named).collect())
}

/// Returns an object's name: the stem of its file, with the part's name behind it. Numbers that tell equal names apart
/// are added later.
pub fn object_name(path: &str, part: Option<&str>) -> String {
    let stem = file_stem(path);
    part.map_or(stem.clone(), |part| format!("{stem}/{part}"))
}

/// Returns the name of a mesh: that of its file, without folder and extension.
pub fn file_stem(path: &str) -> String {
    Path::new(path).file_stem().map_or(String::from("object"), |stem| stem.to_string_lossy().into_owned())
}

#[cfg(test)]
mod tests {
    use super::*;

    fn differ(paths: &[&str]) -> Option<Vec<String>> {
        find_distinct_folders(&paths.iter().map(Path::new).collect::<Vec<_>>())
    }

    #[test]
    fn the_folder_that_differs_is_found() {
        assert_eq!(differ(&["/y/1_a/g/n.stl", "/y/2_b/g/n.stl"]), Some(vec!["1_a".into(), "2_b".into()]));
        assert_eq!(differ(&["/y/a/n.stl", "/y/a/n.obj"]), None);
        assert_eq!(differ(&["/y/a/n.stl", "/y/b/../a/n.stl"]), None);
        assert_eq!(differ(&["/y/a/n.stl", "/y/a/n.obj", "/y/b/n.stl"]), Some(vec!["a".into(), "a".into(), "b".into()]));
        let crossed = differ(&["/y/a/u/n.stl", "/y/a/v/n.stl", "/y/b/u/n.stl"]);
        assert_eq!(crossed, Some(vec!["a/u".into(), "a/v".into(), "b/u".into()]));
        assert_eq!(differ(&["/y/n.stl", "/y/a/n.stl"]), Some(vec!["y".into(), "a".into()]));
    }

    #[test]
    fn a_folder_is_what_the_first_wildcard_stands_for() {
        let of = |written: &str, label: &str| {
            let path = Path::new("/job").join(label);
            find_class_folder(written, &ObjectFile { entry: 0, path, label: label.into() })
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
