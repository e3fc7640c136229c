//! Opens files to be read. All files are opened here: only regular ones, and none larger than its kind may be.
//!
//! A device or a pipe could be read for ever, or never give a byte. A file that grows while it is read is cut off at
//! the same limit. A file that a user names may be a link to a regular one; a file of a dataset may not.

use std::collections::HashMap;
use std::fs::{File, OpenOptions};
use std::io::{self, Read};
use std::os::unix::fs::OpenOptionsExt;
use std::path::{Path, PathBuf};

use glob::{MatchOptions, Pattern, PatternError};
use rustix::fs::OFlags;
use rustix::io::Errno;
use walkdir::WalkDir;

use super::spelling::find_nearest_name;
use super::{foreign, watch};

/// Largest image or array, bytes.
pub const MAX_IMAGE_BYTES: u64 = 1 << 30;
/// Largest mesh, bytes.
pub const MAX_MESH_BYTES: u64 = 4 << 30;
/// Largest file that describes a dataset or a shard, bytes.
pub const MAX_METADATA_BYTES: u64 = 64 << 20;

/// Opens a regular file, or one that a link leads to, and returns its length in bytes, too.
pub fn open(path: &Path) -> io::Result<(File, u64)> {
    open_with(path, OFlags::empty())
}

/// Opens a regular file inside a dataset, where a link is refused, and returns its length in bytes, too.
pub fn open_without_links(path: &Path) -> io::Result<(File, u64)> {
    open_with(path, OFlags::NOFOLLOW)
}

fn open_with(path: &Path, flags: OFlags) -> io::Result<(File, u64)> {
    // Opening a pipe would otherwise wait for its other end.
    let flags = (flags | OFlags::NONBLOCK | OFlags::NOCTTY).bits() as i32;
    let opened = OpenOptions::new().read(true).custom_flags(flags).open(path);
    if opened.is_err() {
        watch::note_path(path);
    }
    let file = match opened {
        Err(error) if error.raw_os_error() == Some(Errno::LOOP.raw_os_error()) => {
            return Err(io::Error::other("it is a symbolic link, or one of a circle of them"));
        }
        // The path is a socket.
        Err(error) if error.raw_os_error() == Some(Errno::NXIO.raw_os_error()) => {
            return Err(io::Error::other("it is not a regular file"));
        }
        opened => opened?,
    };
    let metadata = file.metadata()?;
    watch::note_open_file(path, &metadata);
    if metadata.is_dir() {
        return Err(io::Error::other("it is a folder"));
    }
    if !metadata.is_file() {
        return Err(io::Error::other("it is not a regular file"));
    }
    Ok((file, metadata.len()))
}

/// Resolves the links of a path, as far as it exists. An empty one is the current folder.
fn canonicalize_existing(path: &Path) -> io::Result<PathBuf> {
    let path = std::path::absolute(if path == Path::new("") { Path::new(".") } else { path })?;
    match (path.canonicalize(), path.parent(), path.file_name()) {
        (Err(error), Some(folder), Some(name)) if error.kind() == io::ErrorKind::NotFound => {
            Ok(canonicalize_existing(folder)?.join(name))
        }
        (found, ..) => found,
    }
}

/// Returns true if both paths exist and lead to the same file or folder.
pub fn is_same_path(a: &Path, b: &Path) -> bool {
    matches!((a.canonicalize(), b.canonicalize()), (Ok(a), Ok(b)) if a == b)
}

/// How paths are written in a file of a folder. Links on the way are resolved, but not the last part: an object has the
/// name of its file or link.
pub struct RelativePaths {
    base: PathBuf,
    /// Folders that were resolved before: a job may name thousands of files in one.
    resolved: HashMap<PathBuf, PathBuf>,
}

impl RelativePaths {
    /// Paths as a file of `folder` has them.
    pub fn seen_from(folder: &Path) -> io::Result<Self> {
        Ok(Self { base: canonicalize_existing(folder)?, resolved: HashMap::new() })
    }

    /// Returns the path relative to the folder.
    pub fn make_relative(&mut self, path: &Path) -> io::Result<PathBuf> {
        let absolute = std::path::absolute(if path == Path::new("") { Path::new(".") } else { path })?;
        let path = match (absolute.parent(), absolute.file_name()) {
            (Some(folder), Some(name)) => match self.resolved.get(folder) {
                Some(resolved) => resolved.join(name),
                None => {
                    let resolved = canonicalize_existing(folder)?;
                    self.resolved.entry(folder.to_owned()).or_insert(resolved).join(name)
                }
            },
            _ => canonicalize_existing(&absolute)?,
        };
        Ok(pathdiff::diff_paths(&path, &self.base).unwrap_or(path))
    }
}

/// Suggests the name of a file that may have been meant by a missing one beside it: one with another case, with an
/// extension, or with a slip of the keys. Only files for which `wanted` is true are suggested.
pub fn suggest_file_name(missing: &Path, wanted: impl Fn(&Path) -> bool) -> Option<String> {
    /// In a folder with more entries a name is not searched for.
    const MAX_ENTRIES: usize = 10_000;
    let name = missing.file_name()?.to_str()?;
    let folder = missing.parent().filter(|folder| *folder != Path::new("")).unwrap_or(Path::new("."));
    let entries =
        folder.read_dir().ok()?.take(MAX_ENTRIES).filter_map(|entry| entry.ok()?.file_name().into_string().ok());
    // Of a link to nothing the name is there, and the file is not.
    let is_there = |found: &String| found != name && wanted(Path::new(found)) && folder.join(found).exists();
    let mut names: Vec<String> = entries.filter(is_there).collect();
    names.sort();
    let stem = |name: &str| Path::new(name).file_stem().unwrap_or_default().to_string_lossy().into_owned();
    let alike = names.iter().find(|found| found.eq_ignore_ascii_case(name));
    if let Some(alike) = alike.or_else(|| names.iter().find(|found| stem(found) == name)) {
        return Some(alike.clone());
    }
    // Names are compared without their extensions, which are long and alike.
    let stems: Vec<String> = names.iter().map(|found| stem(found)).collect();
    let nearest = find_nearest_name(&stem(name), stems.iter().map(String::as_str))?;
    stems.iter().position(|stem| stem == nearest).map(|at| names[at].clone())
}

/// Returns true for a regular file or a link to one. A path of which the system tells nothing counts as a file, too:
/// reading it then reports why, and it is not silently left out.
pub fn may_be_file(path: &Path) -> bool {
    watch::note_path(path);
    path.metadata().map_or_else(|error| !is_not_found(&error), |metadata| metadata.is_file())
}

fn is_not_found(error: &io::Error) -> bool {
    use io::ErrorKind::{InvalidFilename, NotADirectory, NotFound};
    matches!(error.kind(), NotFound | NotADirectory | InvalidFilename)
}

/// Returns the files that match a pattern, sorted, without the companion files of macOS (`._NAME`). Folders that may
/// not be read are passed over, as a shell does. Any other reason is an error, since files would be missing in silence.
pub fn find_matching_files(pattern: &str) -> Result<io::Result<Vec<PathBuf>>, PatternError> {
    Pattern::new(pattern)?;
    // At the end it stands for folders.
    if pattern.rsplit('/').next() == Some("**") {
        return Ok(Ok(Vec::new()));
    }
    let inside = |at: usize| Pattern::new(&pattern[at..]);
    let found = match find_any_folders(pattern) {
        None => collect_readable(glob::glob(pattern)?),
        Some(0) => find_below(Path::new(""), &inside(0)?),
        Some(at) => {
            let inside = inside(at)?;
            collect_readable(glob::glob(&pattern[..at])?)
                .and_then(|folders| folders.iter().map(|folder| find_below(folder, &inside)).collect())
                .map(|found: Vec<Vec<PathBuf>>| found.concat())
        }
    };
    Ok(found.map(|mut found| {
        found.retain(|path| !is_companion(path) && may_be_file(path));
        found.sort();
        found
    }))
}

/// Returns where the first `**` of a pattern begins.
fn find_any_folders(pattern: &str) -> Option<usize> {
    let mut start = 0;
    for part in pattern.split('/') {
        if part == "**" {
            return Some(start);
        }
        start += part.len() + 1;
    }
    None
}

fn is_companion(path: &Path) -> bool {
    path.file_name().is_some_and(|name| name.as_encoded_bytes().starts_with(b"._"))
}

fn collect_readable(paths: glob::Paths) -> io::Result<Vec<PathBuf>> {
    let is_readable = |path: &glob::GlobResult| match path {
        Err(error) => error.error().kind() != io::ErrorKind::PermissionDenied,
        Ok(_) => true,
    };
    paths.filter(is_readable).map(|path| path.map_err(io::Error::other)).collect()
}

/// Returns true for what a search passes over: a folder that may not be read, a link to nothing or to itself.
fn is_passed_over(error: &io::Error) -> bool {
    matches!(error.kind(), io::ErrorKind::PermissionDenied | io::ErrorKind::NotFound)
        || error.raw_os_error() == Some(Errno::LOOP.raw_os_error())
}

/// Returns what matches a pattern in a folder and the folders in it, also behind links. A link back to a folder on the
/// way to it is not followed: `glob` would go round until the path is too long.
fn find_below(folder: &Path, pattern: &Pattern) -> io::Result<Vec<PathBuf>> {
    let options = MatchOptions { require_literal_separator: true, ..MatchOptions::new() };
    let root = if folder == Path::new("") { Path::new(".") } else { folder };
    let mut found = Vec::new();
    for entry in WalkDir::new(root).min_depth(1).follow_links(true) {
        let entry = match entry {
            Ok(entry) => entry,
            Err(error) if error.io_error().is_none_or(is_passed_over) => continue,
            Err(error) => return Err(error.into()),
        };
        let inside = entry.path().strip_prefix(root).unwrap_or(entry.path());
        if pattern.matches_with(&inside.to_string_lossy(), options) {
            found.push(folder.join(inside));
        }
    }
    Ok(found)
}

/// Reads the file at `path`. It is an error if it is not a regular file or holds more than `most` bytes.
pub fn read(path: &Path, most: u64) -> io::Result<Vec<u8>> {
    read_open_file(open(path)?, most)
}

/// Reads the file at `path` if there is a regular one, else returns `None`. It is an error if the system denies access,
/// since the file may be there, or if it holds more than `most` bytes.
pub fn read_if_exists(path: &Path, most: u64) -> io::Result<Option<Vec<u8>>> {
    match read(path, most) {
        Err(error) if error.raw_os_error().is_none() || is_not_found(&error) => Ok(None),
        read => read.map(Some),
    }
}

/// Reads a file inside a dataset, where a link is refused. It is an error if it is not a regular file or holds more
/// than `most` bytes.
pub fn read_without_links(path: &Path, most: u64) -> io::Result<Vec<u8>> {
    read_open_file(open_without_links(path)?, most)
}

/// Reads an open file of known length. It is an error if it holds more than `most` bytes.
pub fn read_open_file((file, length): (File, u64), most: u64) -> io::Result<Vec<u8>> {
    let too_large = || io::Error::other(format!("it is larger than {} MB", most >> 20));
    if length > most {
        return Err(too_large());
    }
    let mut bytes = Vec::new();
    bytes.try_reserve_exact(length as usize)?;
    // One byte more than allowed, so that a file that has grown meanwhile is noticed.
    if file.take(most + 1).read_to_end(&mut bytes)? as u64 > most {
        return Err(too_large());
    }
    // Whatever file belongs there, it is none of these.
    match foreign::identify_placeholder(&bytes) {
        Some(foreign) => Err(io::Error::other(foreign)),
        None => Ok(bytes),
    }
}

#[cfg(test)]
mod tests {
    use std::fs;

    use super::*;

    #[test]
    fn a_pattern_finds_each_file_once_though_links_lead_in_circles() {
        let folder = tempfile::tempdir().unwrap();
        let at = |name: &str| folder.path().join(name);
        fs::create_dir_all(at("set/deep/er")).unwrap();
        fs::create_dir_all(at("other")).unwrap();
        for name in
            ["set/a.obj", "set/deep/b.obj", "set/deep/er/c.obj", "set/deep/er/._c.obj", "set/d.txt", "other/e.obj"]
        {
            fs::write(at(name), b"").unwrap();
        }
        let links = [(".", "set/self"), ("..", "set/deep/up"), ("er", "set/deep/er/er"), ("gone", "set/gone.obj")];
        for (to, link) in links.into_iter().chain([("../other", "set/linked")]) {
            std::os::unix::fs::symlink(to, at(link)).unwrap();
        }
        let find = |pattern: &str| {
            let pattern = format!("{}/{pattern}", Pattern::escape(folder.path().to_str().unwrap()));
            let found = find_matching_files(&pattern).unwrap().unwrap();
            let name = |path: &PathBuf| path.strip_prefix(folder.path()).unwrap().to_str().unwrap().to_owned();
            found.iter().map(name).collect::<Vec<_>>()
        };
        let all = ["set/a.obj", "set/deep/b.obj", "set/deep/er/c.obj", "set/linked/e.obj"];
        assert_eq!(find("set/**/*.obj"), all);
        assert_eq!(find("se?/**/*.obj"), all);
        assert_eq!(find("set/**/deep/**/*.obj"), all[1..3]);
        assert_eq!(find("set/**/er/c.obj"), all[2..3]);
        assert_eq!(find("set/*.obj"), all[..1]);
        assert_eq!(find("set/**"), [""; 0]);
        assert_eq!(find("none/**/*.obj"), [""; 0]);
        assert!(find_matching_files("a**/b").is_err());
    }

    #[test]
    fn a_file_is_read_up_to_the_limit_and_what_is_no_file_is_refused() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("two");
        fs::write(&path, b"ab").unwrap();
        assert_eq!(read(&path, 2).unwrap(), b"ab");
        assert_eq!(read(&path, 1).unwrap_err().to_string(), "it is larger than 0 MB");
        assert_eq!(read(folder.path(), 9).unwrap_err().to_string(), "it is a folder");
        assert_eq!(read(&folder.path().join("none"), 9).unwrap_err().kind(), io::ErrorKind::NotFound);
        assert_eq!(read(Path::new("/dev/zero"), 9).unwrap_err().to_string(), "it is not a regular file");
        let pipe = folder.path().join("pipe");
        assert!(std::process::Command::new("mkfifo").arg(&pipe).status().unwrap().success());
        let socket = folder.path().join("socket");
        let _listener = std::os::unix::net::UnixListener::bind(&socket).unwrap();
        for strange in [&pipe, &socket] {
            assert_eq!(read(strange, 9).unwrap_err().to_string(), "it is not a regular file");
        }
        assert!(may_be_file(&path));
        for other in [folder.path(), &folder.path().join("none"), &path.join("in it"), &pipe] {
            assert!(!may_be_file(other), "{}", other.display());
            assert!(read_if_exists(other, 9).unwrap().is_none(), "{}", other.display());
        }
        // A link is allowed for a user's file, but not inside a dataset.
        let link = folder.path().join("link");
        std::os::unix::fs::symlink(&path, &link).unwrap();
        assert_eq!(read(&link, 2).unwrap(), b"ab");
        assert!(read_without_links(&link, 2).unwrap_err().to_string().starts_with("it is a symbolic link"));
        assert_eq!(read_without_links(&path, 2).unwrap(), b"ab");
        for strange in [&pipe, &socket] {
            let link = folder.path().join("to");
            std::os::unix::fs::symlink(strange, &link).unwrap();
            assert!(read(&link, 9).is_err() && read_without_links(&link, 9).is_err());
            fs::remove_file(link).unwrap();
        }
    }
}
