//! Files that are on disk whole or not at all: written beside their place, brought to disk, renamed.

use crate::files::fail_point::Step;
use std::fs::{self, File, OpenOptions};
use std::io::{self, Write};
use std::os::unix::fs::MetadataExt;
use std::path::{Path, PathBuf};

/// Makes a new file in place of what a killed run may have left there. Never opens what is there: it may be a link.
pub fn create_anew(path: &Path) -> io::Result<File> {
    match fs::remove_file(path) {
        Err(error) if error.kind() != io::ErrorKind::NotFound => Err(error),
        _ => OpenOptions::new().write(true).create_new(true).open(path),
    }
}

/// True if `path` itself, links not followed, is the open file.
pub fn same_file(file: &File, path: &Path) -> bool {
    match (file.metadata(), fs::symlink_metadata(path)) {
        (Ok(open), Ok(named)) => open.dev() == named.dev() && open.ino() == named.ino(),
        _ => false,
    }
}

/// Writes a file so that it is there whole or not at all.
pub fn write_whole(path: &Path, bytes: &[u8]) -> io::Result<()> {
    replace(path, bytes, File::sync_all)?;
    sync_folder(path)
}

/// The same without bringing it to disk, for one of many files; see [`sync_all_in`].
pub fn write_one_of_many(path: &Path, bytes: &[u8]) -> io::Result<()> {
    replace(path, bytes, |_| Ok(()))
}

fn replace(path: &Path, bytes: &[u8], sync: impl FnOnce(&File) -> io::Result<()>) -> io::Result<()> {
    let name = path.file_name().map_or(String::from("file"), |name| name.to_string_lossy().into_owned());
    let partial = path.with_file_name(format!(".{name}.{}.partial", std::process::id()));
    let written = create_anew(&partial).and_then(|mut file| {
        Step::FileBegun.reached(path);
        file.write_all(bytes)?;
        sync(&file)?;
        Step::FileWritten.reached(path);
        Ok(())
    });
    if let Err(error) = written.and_then(|()| fs::rename(&partial, path)) {
        let _ = fs::remove_file(&partial);
        return Err(error);
    }
    Step::FileRenamed.reached(path);
    Ok(())
}

/// Writes a folder so that it is there whole or not at all, in place of what is there: files by name, none in folders of its
/// own. Who calls this has made sure that what is there may go. On failure the path that it is about.
pub fn write_folder_whole(
    root: &Path,
    mut files: impl Iterator<Item = (String, Vec<u8>)>,
) -> Result<(), (PathBuf, io::Error)> {
    let name = root.file_name().map_or(String::from("folder"), |name| name.to_string_lossy().into_owned());
    let beside = |end: &str| root.with_file_name(format!(".{name}.{}.{end}", std::process::id()));
    let (partial, aside) = (beside("partial"), beside("replaced.partial"));
    let absent_is_fine = |result: io::Result<()>| match result {
        Err(error) if error.kind() != io::ErrorKind::NotFound => Err(error),
        _ => Ok(()),
    };
    let mut write = |partial: &Path| {
        let at = |error| (partial.to_owned(), error);
        absent_is_fine(fs::remove_dir_all(partial)).and_then(|()| fs::create_dir_all(partial)).map_err(at)?;
        files.try_for_each(|(name, bytes)| {
            let path = partial.join(name);
            create_anew(&path).and_then(|mut file| file.write_all(&bytes)).map_err(|error| (path, error))
        })?;
        File::open(partial).and_then(|folder| sync_all_in(&folder)).map_err(at)
    };
    let swap = || {
        absent_is_fine(fs::rename(root, &aside))?;
        fs::rename(&partial, root)?;
        absent_is_fine(fs::remove_dir_all(&aside))?;
        sync_folder(root)
    };
    let written = write(&partial).and_then(|()| swap().map_err(|error| (root.to_owned(), error)));
    if written.is_err() {
        let _ = fs::remove_dir_all(&partial);
    }
    written
}

/// Makes a rename in the folder of `path` survive a power cut.
pub fn sync_folder(path: &Path) -> io::Result<()> {
    match path.parent() {
        // A bare name is in the current folder.
        Some(folder) if folder.as_os_str().is_empty() => sync_folder(&Path::new(".").join(path)),
        Some(folder) if cfg!(unix) => File::open(folder)?.sync_all(),
        _ => Ok(()),
    }
}

/// Brings a folder and all its files to disk: one call, where as many as there are files would take far longer.
pub fn sync_all_in(folder: &File) -> io::Result<()> {
    #[cfg(target_os = "linux")]
    rustix::fs::syncfs(folder)?;
    #[cfg(not(target_os = "linux"))]
    {
        rustix::fs::sync();
        folder.sync_all()?;
    }
    Ok(())
}
