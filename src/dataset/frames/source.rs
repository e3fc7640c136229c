//! The files that hold depth frames, and the names of what is rendered from them.

use std::collections::HashMap;
use std::ffi::OsStr;
use std::fs;
use std::path::{Path, PathBuf};

use super::read::{ENDINGS, in_archive};
use gelsim_files::diagnostic::{Diagnostic, Diagnostics};
use gelsim_files::input::{matching, may_be_file, meant};

/// A frame's file.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Source {
    /// Where it is.
    pub path: PathBuf,
    /// What its results are called.
    pub stem: String,
}

/// The files that `written` names, in the order in which they are named; those of a folder or a pattern by their names.
/// Mistakes go to `problems`.
pub fn find(written: &[PathBuf], problems: &mut Diagnostics) -> Vec<Source> {
    let mut sources: Vec<Source> = Vec::new();
    let mut taken: HashMap<String, usize> = HashMap::new();
    let paths: Vec<PathBuf> = written.iter().flat_map(|written| files(written, problems)).collect();
    for path in paths {
        let Some(stem) = stem(&path) else {
            problems.push(Diagnostic::new(format!("{}: its name is not UTF-8", path.display())).help("rename it"));
            continue;
        };
        match taken.insert(stem.clone(), sources.len()) {
            Some(first) => {
                let first = sources[first].path.display();
                let problem =
                    Diagnostic::new(format!("{} and {first} would both be {stem}.tactile.png", path.display()));
                problems.push(problem.help("rename one of them, or render them into two folders"));
            }
            None => sources.push(Source { path, stem }),
        }
    }
    sources
}

/// The name of a frame: its file's without folder and ending, and without a `.depth` before that. Of an array in an archive that
/// of the archive.
pub fn stem(path: &Path) -> Option<String> {
    let path = in_archive(path).map_or(path, |(archive, _)| archive);
    let stem = path.file_stem()?.to_str()?;
    Some(stem.strip_suffix(".depth").filter(|rest| !rest.is_empty()).unwrap_or(stem).to_owned())
}

/// True of a file that is named like a frame.
fn is_frame(path: &Path) -> bool {
    ENDINGS.into_iter().any(|known| path.extension() == Some(OsStr::new(known)))
}

/// A file itself, an array in it, the frames in a folder, or what matches a pattern.
fn files(written: &Path, problems: &mut Diagnostics) -> Vec<PathBuf> {
    if let Some((archives, array)) = in_archive(written) {
        return files(archives, problems).into_iter().map(|archive| archive.join(array)).collect();
    }
    let mut wrong = |message: String, help: String| {
        problems.push(Diagnostic::new(message).help(help));
        Vec::new()
    };
    let shown = written.display();
    if written.is_dir() {
        let entries = fs::read_dir(written).and_then(|entries| entries.collect::<Result<Vec<_>, _>>());
        let entries = match entries {
            Ok(entries) => entries.into_iter().map(|entry| entry.path()),
            Err(error) => return wrong(format!("{shown}: {error}"), String::from("name a folder that can be read")),
        };
        let mut found: Vec<PathBuf> = entries.filter(|path| is_frame(path) && may_be_file(path)).collect();
        found.sort();
        return match found.is_empty() {
            true => wrong(format!("{shown} holds no depth frame"), format!("these are .{}", ENDINGS.join(", ."))),
            false => found,
        };
    }
    let pattern = written.to_str().filter(|text| text.contains(['*', '?', '[']) && !written.exists());
    let Some(pattern) = pattern else {
        return if written.exists() {
            vec![written.to_owned()]
        } else {
            let meant = meant(written, is_frame).map(|name| written.with_file_name(name));
            let meant = meant.map_or(String::new(), |path| format!("did you mean {}? ", path.display()));
            wrong(
                format!("{shown} does not exist"),
                format!("{meant}name files, folders or patterns of names; paths start from the current folder"),
            )
        };
    };
    match glob::glob(pattern) {
        Err(error) => wrong(
            format!("{shown} is no pattern: {}", error.msg),
            String::from("`*`, `?` and `[abc]` stand for characters"),
        ),
        Ok(paths) => match matching(paths) {
            Err(error) => wrong(error.to_string(), String::from("name folders that can be read")),
            Ok(found) if found.is_empty() => {
                wrong(format!("no file matches {shown}"), String::from("paths start from the current folder"))
            }
            Ok(found) => found,
        },
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use gelsim_files::diagnostic::Report;

    #[test]
    fn files_folders_and_patterns_are_taken_in_order_and_no_name_twice() {
        let folder = tempfile::tempdir().expect("a folder");
        let at = |name: &str| folder.path().join(name);
        fs::create_dir_all(at("more")).expect("a folder");
        for name in ["b.npy", "a.depth.exr", "c.png", "notes.txt", "more/b.npy"] {
            fs::write(at(name), b"").expect("a file");
        }
        let mut problems = Diagnostics::default();
        let stems = |sources: &[Source]| sources.iter().map(|source| source.stem.clone()).collect::<Vec<_>>();
        assert_eq!(stems(&find(&[folder.path().to_owned()], &mut problems)), ["a", "b", "c"]);
        assert_eq!(stems(&find(&[at("c.png"), at("?.npy")], &mut problems)), ["c", "b"]);
        fs::write(at("more/d.npz"), b"").expect("a file");
        assert_eq!(stems(&find(&[at("more/*.npz/left")], &mut problems)), ["d"]);
        assert_eq!(find(&[at("more/d.npz/left")], &mut problems)[0].path, at("more/d.npz/left"));
        assert!(problems.is_empty());
        find(&[at("b.npy"), at("more"), at("none"), at("*.tif"), at("d.npz/left"), at("c")], &mut problems);
        let said = Report::new(&problems, &[]).to_string();
        let meant = format!("did you mean {}?", at("c.png").display());
        for part in [
            "would both be b.tactile.png",
            "none does not exist",
            "no file matches",
            "d.npz does not exist",
            meant.as_str(),
        ] {
            assert!(said.contains(part), "{part}: {said}");
        }
    }
}
