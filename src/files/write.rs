//! Writes files that are either complete or absent: each is written beside its place, brought to disk, and renamed.

use crate::fail_point::Step;
use std::fs::{self, File, OpenOptions, TryLockError};
use std::io::{self, Write};
use std::os::unix::fs::MetadataExt;
use std::path::{Path, PathBuf};

use rustix::fs::{Mode, OFlags};
use rustix::io::Errno;
use rustix::process::{Pid, test_kill_process};

/// Creates a new file in place of what a killed run may have left there. It never opens what is there, since that may
/// be a link.
pub fn recreate_file(path: &Path) -> io::Result<File> {
    match fs::remove_file(path) {
        Err(error) if error.kind() != io::ErrorKind::NotFound => Err(error),
        _ => OpenOptions::new().read(true).write(true).create_new(true).open(path),
    }
}

/// Returns true if `path` itself, without following links, is the open file.
pub fn is_same_file(file: &File, path: &Path) -> bool {
    match (file.metadata(), fs::symlink_metadata(path)) {
        (Ok(open), Ok(named)) => open.dev() == named.dev() && open.ino() == named.ino(),
        _ => false,
    }
}

/// Writes a file that a user asked for by name: it is complete or absent afterwards. What killed runs left of it is
/// removed.
pub fn write_output(path: &Path, bytes: &[u8]) -> io::Result<()> {
    remove_partials_beside(path)?;
    write_atomically(path, bytes)
}

/// Writes a file, and replaces what is there, so that at every instant the old or the new one is there, complete.
pub fn write_atomically(path: &Path, bytes: &[u8]) -> io::Result<()> {
    replace_file(path, bytes, File::sync_all)?;
    sync_folder(path)
}

/// Writes a file where nothing may be, so that it is complete or absent. If something is there, it stays, and that is
/// the error.
pub fn write_new(path: &Path, bytes: &[u8]) -> io::Result<()> {
    remove_partials_beside(path)?;
    write_beside(path, bytes, File::sync_all, rename_without_replacing)?;
    sync_folder(path)
}

/// Writes a file as [`write_atomically`] does, but without bringing it to disk; for many files, see [`sync_all_in`].
pub fn write_without_sync(path: &Path, bytes: &[u8]) -> io::Result<()> {
    replace_file(path, bytes, |_| Ok(()))
}

fn replace_file(path: &Path, bytes: &[u8], sync: impl FnOnce(&File) -> io::Result<()>) -> io::Result<()> {
    write_beside(path, bytes, sync, |partial, path| fs::rename(partial, path))
}

/// Renames a file to a name that nothing has.
fn rename_without_replacing(partial: &Path, path: &Path) -> io::Result<()> {
    #[cfg(target_os = "linux")]
    {
        use rustix::fs::{CWD, RenameFlags, renameat_with};
        match renameat_with(CWD, partial, CWD, path, RenameFlags::NOREPLACE) {
            // These errors say that the file system cannot do it: fall through to a check and a rename.
            Err(Errno::INVAL | Errno::NOSYS | Errno::OPNOTSUPP) => {}
            renamed => return Ok(renamed?),
        }
    }
    match path.symlink_metadata() {
        Ok(_) => Err(io::ErrorKind::AlreadyExists.into()),
        Err(_) => fs::rename(partial, path),
    }
}

/// Writes a file beside its place and moves it there with `put`.
fn write_beside(
    path: &Path,
    bytes: &[u8],
    sync: impl FnOnce(&File) -> io::Result<()>,
    put: impl FnOnce(&Path, &Path) -> io::Result<()>,
) -> io::Result<()> {
    let partial = partial_path_beside(path);
    let written = recreate_file(&partial).and_then(|mut file| {
        lock_while_open(&file);
        Step::FileBegun.pause_if_requested(path);
        file.write_all(bytes)?;
        sync(&file)?;
        Step::FileWritten.pause_if_requested(path);
        Ok(())
    });
    if let Err(error) = written.and_then(|()| put(&partial, path)) {
        let _ = fs::remove_file(&partial);
        return Err(error);
    }
    Step::FileRenamed.pause_if_requested(path);
    Ok(())
}

/// A file that is written piece by piece beside its place, and gets its name when it is complete. Dropped before, it is
/// removed.
pub struct FileUnderWay {
    path: PathBuf,
    partial: PathBuf,
    file: File,
    is_complete: bool,
}

impl FileUnderWay {
    /// Begins the file at `path`. What killed runs left of it is removed.
    pub fn begin(path: &Path) -> io::Result<Self> {
        remove_partials_beside(path)?;
        let partial = partial_path_beside(path);
        let file = recreate_file(&partial)?;
        lock_while_open(&file);
        Step::FileBegun.pause_if_requested(path);
        Ok(Self { path: path.to_owned(), partial, file, is_complete: false })
    }

    /// Brings the file to disk and gives it its name, in place of what is there.
    pub fn complete(mut self) -> io::Result<()> {
        self.file.sync_all()?;
        Step::FileWritten.pause_if_requested(&self.path);
        fs::rename(&self.partial, &self.path)?;
        self.is_complete = true;
        Step::FileRenamed.pause_if_requested(&self.path);
        sync_folder(&self.path)
    }
}

impl Write for FileUnderWay {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        self.file.write(bytes)
    }

    fn flush(&mut self) -> io::Result<()> {
        self.file.flush()
    }
}

impl Drop for FileUnderWay {
    fn drop(&mut self) {
        if !self.is_complete {
            let _ = fs::remove_file(&self.partial);
        }
    }
}

/// Writes a folder, and replaces what is there, so that it is complete or absent. `files` gives names and contents;
/// there are no subfolders. The caller makes sure that what is there may be removed. The error names the path that it
/// is about.
pub fn write_folder_atomically(
    root: &Path,
    mut files: impl Iterator<Item = (String, Vec<u8>)>,
) -> Result<(), (PathBuf, io::Error)> {
    let partial = partial_path_beside(root);
    remove_partials_beside(root).and_then(|()| remove_any(&partial)).map_err(|error| (root.to_owned(), error))?;
    let mut write = || {
        let at = |error| (partial.clone(), error);
        fs::create_dir_all(&partial).map_err(at)?;
        let folder = File::open(&partial).map_err(at)?;
        lock_while_open(&folder);
        files.try_for_each(|(name, bytes)| {
            let path = partial.join(name);
            recreate_file(&path).and_then(|mut file| file.write_all(&bytes)).map_err(|error| (path, error))
        })?;
        sync_all_in(&folder).map_err(at)
    };
    let put = || {
        swap_folder(&partial, root)?;
        ignore_not_found(fs::remove_dir_all(&partial))?;
        sync_folder(root)
    };
    let written = write().and_then(|()| put().map_err(|error| (root.to_owned(), error)));
    if written.is_err() {
        let _ = fs::remove_dir_all(&partial);
    }
    written
}

/// Gives the folder `partial` the name `root`. What has that name gets the name `partial`; at every instant one of the
/// two has the name. If the file system cannot exchange them, the old one is called `root`.replaced for a moment.
pub fn swap_folder(partial: &Path, root: &Path) -> io::Result<()> {
    #[cfg(target_os = "linux")]
    {
        use rustix::fs::{CWD, RenameFlags, renameat_with};
        match renameat_with(CWD, partial, CWD, root, RenameFlags::EXCHANGE) {
            // There is no `root` yet, or the file system cannot exchange names: rename instead.
            Err(Errno::NOENT) if partial.exists() && root.symlink_metadata().is_err() => {}
            Err(Errno::INVAL | Errno::NOSYS | Errno::OPNOTSUPP) => {}
            exchanged => return Ok(exchanged?),
        }
    }
    swap_folder_by_renames(partial, root)
}

fn swap_folder_by_renames(partial: &Path, root: &Path) -> io::Result<()> {
    let mut aside = root.as_os_str().to_owned();
    aside.push(".replaced");
    let aside = PathBuf::from(aside);
    if root.symlink_metadata().is_err() {
        return fs::rename(partial, root);
    }
    partial.symlink_metadata()?;
    if aside.symlink_metadata().is_ok() {
        let what = format!("{} is there, perhaps of a run that was killed: move it away", aside.display());
        return Err(io::Error::new(io::ErrorKind::AlreadyExists, what));
    }
    fs::rename(root, &aside)?;
    fs::rename(partial, root)?;
    fs::rename(&aside, partial)
}

/// Returns the name beside `path` under which this process writes the file.
fn partial_path_beside(path: &Path) -> PathBuf {
    let name = path.file_name().map_or(String::from("file"), |name| name.to_string_lossy().into_owned());
    path.with_file_name(format!(".{name}.{}.partial", std::process::id()))
}

/// Removes the partial files and folders in `folder` that killed processes left, if they were to get names that
/// `is_name` accepts.
pub fn remove_abandoned_partials(folder: &Path, is_name: impl Fn(&str) -> bool) -> io::Result<()> {
    let folder = if folder.as_os_str().is_empty() { Path::new(".") } else { folder };
    let abandoned = |name: &str| {
        let (name, process) = name.strip_prefix('.')?.strip_suffix(".partial")?.rsplit_once('.')?;
        let process = process.parse().ok().filter(|_| is_name(name))?;
        Some(process)
    };
    // The folder may not exist yet, or may not be listed: then nothing is removed.
    for entry in fs::read_dir(folder).into_iter().flatten().flatten() {
        let path = entry.path();
        if let Some(process) = entry.file_name().to_str().and_then(abandoned)
            && is_abandoned(process, &path)
        {
            remove_any(&path)?;
        }
    }
    Ok(())
}

/// Removes what killed processes left of the file at `path`; see [`remove_abandoned_partials`].
fn remove_partials_beside(path: &Path) -> io::Result<()> {
    let name = path.file_name().map(|name| name.to_string_lossy().into_owned());
    remove_abandoned_partials(path.parent().unwrap_or(Path::new("")), |found| Some(found) == name.as_deref())
}

/// Returns true if nobody will finish a partial file: its process does not run here, and no process on another host
/// that shares the folder holds its lock.
fn is_abandoned(process: i32, path: &Path) -> bool {
    let dead = || Pid::from_raw(process).is_none_or(|process| test_kill_process(process) == Err(Errno::SRCH));
    let free = || {
        let opened = rustix::fs::open(path, OFlags::RDONLY | OFlags::NOFOLLOW | OFlags::NONBLOCK, Mode::empty());
        opened.is_ok_and(|file| !matches!(File::from(file).try_lock(), Err(TryLockError::WouldBlock)))
    };
    dead() && free()
}

/// Locks a file or folder as long as it is open, which tells other hosts that it is being written.
fn lock_while_open(file: &File) {
    // Where there are no locks, only the number of the process tells.
    let _ = file.try_lock();
}

/// Removes a file, or a folder with its content, if it exists.
fn remove_any(path: &Path) -> io::Result<()> {
    let removed = match path.symlink_metadata() {
        Ok(metadata) if metadata.is_dir() => fs::remove_dir_all(path),
        _ => fs::remove_file(path),
    };
    ignore_not_found(removed)
}

/// Turns the error that something does not exist into success.
pub fn ignore_not_found(result: io::Result<()>) -> io::Result<()> {
    match result {
        Err(error) if error.kind() != io::ErrorKind::NotFound => Err(error),
        _ => Ok(()),
    }
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

/// Brings a folder and all its files to disk in one call. A call for each file would take far longer.
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

#[cfg(test)]
mod tests {
    use super::*;

    /// The number of a process that has ended.
    fn dead() -> u32 {
        let mut child = std::process::Command::new("true").spawn().expect("a process");
        child.wait().expect("its end");
        child.id()
    }

    #[test]
    fn a_new_file_takes_no_place_that_is_taken_and_leaves_nothing_beside_it() {
        let folder = tempfile::tempdir().expect("a folder");
        let path = folder.path().join("job.toml");
        write_new(&path, b"mine").expect("written");
        let taken = write_new(&path, b"another").expect_err("it is there");
        assert_eq!(taken.kind(), io::ErrorKind::AlreadyExists);
        assert_eq!(fs::read(&path).expect("a file"), b"mine");
        // A link that leads nowhere is something, too.
        std::os::unix::fs::symlink("nowhere", folder.path().join("link")).expect("a link");
        write_new(&folder.path().join("link"), b"x").expect_err("it is there");
        assert_eq!(fs::read_dir(folder.path()).expect("a folder").count(), 2);
    }

    #[test]
    fn what_killed_runs_left_of_a_file_goes_and_nothing_else() {
        let folder = tempfile::tempdir().expect("a folder");
        let path = |name: &str| folder.path().join(name);
        let (dead, alive) = (dead(), std::os::unix::process::parent_id());
        let gone = format!(".report.html.{dead}.partial");
        let stay = [
            format!(".report.html.{alive}.partial"),
            format!(".other.html.{dead}.partial"),
            format!("report.html.{dead}.partial"),
            String::from(".report.html.partial"),
            String::from(".report.html.x.partial"),
            String::from(".report.html.-1.partial"),
        ];
        stay.iter().chain([&gone]).for_each(|name| fs::write(path(name), "left").expect("a file"));
        let held = File::create(path(&format!(".page.{dead}.partial"))).expect("a file");
        held.try_lock().expect("a lock");
        write_output(&path("report.html"), b"whole").expect("written");
        write_output(&path("page"), b"whole").expect("written");
        assert!(!path(&gone).exists());
        assert!(stay.iter().all(|name| path(name).exists()));
        assert!(path(&format!(".page.{dead}.partial")).exists(), "another host holds it");
        drop(held);
        write_output(&path("page"), b"whole").expect("written");
        assert!(!path(&format!(".page.{dead}.partial")).exists());
        // A folder may have the name of such a partial file; it goes, too.
        fs::create_dir_all(path(&format!(".maps.{dead}.partial/within"))).expect("a folder");
        write_folder_atomically(&path("maps"), [(String::from("a"), b"1".to_vec())].into_iter()).expect("written");
        assert!(!path(&format!(".maps.{dead}.partial")).exists() && path("maps/a").exists());
    }

    #[test]
    fn a_folder_takes_the_place_of_another_with_and_without_an_exchange() {
        for put in [swap_folder, swap_folder_by_renames] {
            let folder = tempfile::tempdir().expect("a folder");
            let path = |name: &str| folder.path().join(name);
            let make = |text: &str| {
                fs::create_dir(path(".out.partial")).expect("a folder");
                fs::write(path(".out.partial/text"), text).expect("a file");
            };
            let text = |name: &str| fs::read_to_string(path(name)).ok();
            make("first");
            put(&path(".out.partial"), &path("out")).expect("nothing is there");
            assert_eq!((text("out/text").as_deref(), text(".out.partial/text")), (Some("first"), None));
            make("second");
            put(&path(".out.partial"), &path("out")).expect("exchanged");
            let found = (text("out/text"), text(".out.partial/text"));
            assert_eq!((found.0.as_deref(), found.1.as_deref()), (Some("second"), Some("first")));
            assert!(put(&path("nowhere"), &path("out")).is_err());
            assert_eq!(text("out/text").as_deref(), Some("second"));
        }
    }
}
