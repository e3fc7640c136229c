//! Finds the files that hold depth frames, and names what is rendered from them.

use std::collections::HashMap;
use std::ffi::OsStr;
use std::fs;
use std::path::{Path, PathBuf};

use super::message::FrameMessage;
use super::read::{self, FRAME_EXTENSIONS, split_archive_path};
use crate::logs::is_log;
use gelsim_core::base::grid::Grid;
use gelsim_files::diagnostic::{Diagnostic, Diagnostics};
use gelsim_files::input::{find_matching_files, may_be_file, suggest_file_name};

/// Where a frame is.
#[derive(Clone, Debug)]
pub struct FrameSource {
    /// Path of its file; for a message of a log a name that tells it: the log, the topic and the time.
    pub path: PathBuf,
    /// Name of the results.
    pub stem: String,
    /// The message that holds it, if it is in a log.
    pub message: Option<FrameMessage>,
}

impl FrameSource {
    /// Reads the frame. The error says what is wrong with it.
    pub fn read(&self) -> Result<Grid<f64>, String> {
        self.message.as_ref().map_or_else(|| read::read_frame(&self.path), FrameMessage::read)
    }
}

/// Finds the files that `written` names, in that order; those of a folder or a pattern are sorted by name. A log is one
/// of them ([`super::log_frames`] finds its frames). Errors go to `problems`.
pub fn find_frames(written: &[PathBuf], problems: &mut Diagnostics) -> Vec<FrameSource> {
    let mut sources: Vec<FrameSource> = Vec::new();
    let mut taken: HashMap<String, usize> = HashMap::new();
    let paths: Vec<PathBuf> = written.iter().flat_map(|written| list_frame_files(written, problems)).collect();
    for path in paths {
        // Logs of the same name have other frames.
        let stem = if is_log(&path) { path.to_str().map(str::to_owned) } else { frame_stem(&path) };
        let Some(stem) = stem else {
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
            None => sources.push(FrameSource { path, stem, message: None }),
        }
    }
    sources
}

/// Returns the name of a frame: that of its file without folder and extension, and without a `.depth` before the
/// extension. For an array in an archive it is that of the archive. Returns `None` if the name is not UTF-8.
pub fn frame_stem(path: &Path) -> Option<String> {
    let path = split_archive_path(path).map_or(path, |(archive, _)| archive);
    let stem = path.file_stem()?.to_str()?;
    Some(stem.strip_suffix(".depth").filter(|rest| !rest.is_empty()).unwrap_or(stem).to_owned())
}

/// Returns true if a file's extension is that of a frame.
fn is_frame(path: &Path) -> bool {
    FRAME_EXTENSIONS.into_iter().any(|known| path.extension() == Some(OsStr::new(known)))
}

/// Lists the files that a path names: a file itself, an array in it, the frames in a folder, or the files that match a
/// pattern.
fn list_frame_files(written: &Path, problems: &mut Diagnostics) -> Vec<PathBuf> {
    if let Some((archives, array)) = split_archive_path(written) {
        return list_frame_files(archives, problems).into_iter().map(|archive| archive.join(array)).collect();
    }
    let mut wrong = |message: String, help: String| {
        problems.push(Diagnostic::new(message).help(help));
        Vec::new()
    };
    let shown = written.display();
    if is_log(written) && written.exists() {
        return vec![written.to_owned()];
    }
    if written.is_dir() {
        let entries = fs::read_dir(written).and_then(|entries| entries.collect::<Result<Vec<_>, _>>());
        let entries = match entries {
            Ok(entries) => entries.into_iter().map(|entry| entry.path()),
            Err(error) => return wrong(format!("{shown}: {error}"), String::from("name a folder that can be read")),
        };
        let mut found: Vec<PathBuf> = entries.filter(|path| is_frame(path) && may_be_file(path)).collect();
        found.sort();
        return match found.is_empty() {
            true => wrong(
                format!("{shown} holds no depth frame"),
                format!("these are .{}; a bag of ROS 2 has a metadata.yaml", FRAME_EXTENSIONS.join(", .")),
            ),
            false => found,
        };
    }
    let pattern = written.to_str().filter(|text| text.contains(['*', '?', '[']) && !written.exists());
    let Some(pattern) = pattern else {
        return if written.exists() {
            vec![written.to_owned()]
        } else {
            let meant = suggest_file_name(written, is_frame).map(|name| written.with_file_name(name));
            let meant = meant.map_or(String::new(), |path| format!("did you mean {}? ", path.display()));
            wrong(
                format!("{shown} does not exist"),
                format!("{meant}name files, folders or patterns of names; paths start from the current folder"),
            )
        };
    };
    match find_matching_files(pattern) {
        Err(error) => wrong(
            format!("{shown} is no pattern: {}", error.msg),
            String::from("`*`, `?` and `[abc]` stand for characters"),
        ),
        Ok(Err(error)) => wrong(error.to_string(), String::from("name folders that can be read")),
        Ok(Ok(found)) if found.is_empty() => {
            wrong(format!("no file matches {shown}"), String::from("paths start from the current folder"))
        }
        Ok(Ok(found)) => found,
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
        let stems = |sources: &[FrameSource]| sources.iter().map(|source| source.stem.clone()).collect::<Vec<_>>();
        assert_eq!(stems(&find_frames(&[folder.path().to_owned()], &mut problems)), ["a", "b", "c"]);
        assert_eq!(stems(&find_frames(&[at("c.png"), at("?.npy")], &mut problems)), ["c", "b"]);
        fs::write(at("more/d.npz"), b"").expect("a file");
        assert_eq!(stems(&find_frames(&[at("more/*.npz/left")], &mut problems)), ["d"]);
        assert_eq!(find_frames(&[at("more/d.npz/left")], &mut problems)[0].path, at("more/d.npz/left"));
        assert!(problems.is_empty());
        find_frames(&[at("b.npy"), at("more"), at("none"), at("*.tif"), at("d.npz/left"), at("c")], &mut problems);
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
