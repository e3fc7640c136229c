//! Files that are on disk whole or not at all: written beside their place, brought to disk, renamed.

use crate::fail_point::Step;
use std::fs::{self, File, OpenOptions, TryLockError};
use std::io::{self, Write};
use std::os::unix::fs::MetadataExt;
use std::path::{Path, PathBuf};

use rustix::fs::{Mode, OFlags};
use rustix::io::Errno;
use rustix::process::{Pid, test_kill_process};

/// Makes a new file in place of what a killed run may have left there. Never opens what is there: it may be a link.
pub fn create_anew(path: &Path) -> io::Result<File> {
    match fs::remove_file(path) {
        Err(error) if error.kind() != io::ErrorKind::NotFound => Err(error),
        _ => OpenOptions::new().read(true).write(true).create_new(true).open(path),
    }
}

/// True if `path` itself, links not followed, is the open file.
pub fn same_file(file: &File, path: &Path) -> bool {
    match (file.metadata(), fs::symlink_metadata(path)) {
        (Ok(open), Ok(named)) => open.dev() == named.dev() && open.ino() == named.ino(),
        _ => false,
    }
}

/// Writes a file that a user asked for by its name: whole or not at all. What killed runs left of it goes.
pub fn write_output(path: &Path, bytes: &[u8]) -> io::Result<()> {
    sweep_beside(path)?;
    write_whole(path, bytes)
}

/// Writes a file so that it is there whole or not at all.
pub fn write_whole(path: &Path, bytes: &[u8]) -> io::Result<()> {
    replace(path, bytes, File::sync_all)?;
    sync_folder(path)
}

/// The same where nothing may be: what is there stays, and the error says so.
pub fn write_new(path: &Path, bytes: &[u8]) -> io::Result<()> {
    sweep_beside(path)?;
    write_beside(path, bytes, File::sync_all, rename_new)?;
    sync_folder(path)
}

/// The same without bringing it to disk, for one of many files; see [`sync_all_in`].
pub fn write_one_of_many(path: &Path, bytes: &[u8]) -> io::Result<()> {
    replace(path, bytes, |_| Ok(()))
}

fn replace(path: &Path, bytes: &[u8], sync: impl FnOnce(&File) -> io::Result<()>) -> io::Result<()> {
    write_beside(path, bytes, sync, |partial, path| fs::rename(partial, path))
}

/// Renames a file to a name that nothing has.
fn rename_new(partial: &Path, path: &Path) -> io::Result<()> {
    #[cfg(target_os = "linux")]
    {
        use rustix::fs::{CWD, RenameFlags, renameat_with};
        match renameat_with(CWD, partial, CWD, path, RenameFlags::NOREPLACE) {
            Err(Errno::INVAL | Errno::NOSYS | Errno::OPNOTSUPP) => {}
            renamed => return Ok(renamed?),
        }
    }
    match path.symlink_metadata() {
        Ok(_) => Err(io::ErrorKind::AlreadyExists.into()),
        Err(_) => fs::rename(partial, path),
    }
}

/// Writes a file beside its place, and has it `put` there.
fn write_beside(
    path: &Path,
    bytes: &[u8],
    sync: impl FnOnce(&File) -> io::Result<()>,
    put: impl FnOnce(&Path, &Path) -> io::Result<()>,
) -> io::Result<()> {
    let partial = partial_beside(path);
    let written = create_anew(&partial).and_then(|mut file| {
        hold(&file);
        Step::FileBegun.reached(path);
        file.write_all(bytes)?;
        sync(&file)?;
        Step::FileWritten.reached(path);
        Ok(())
    });
    if let Err(error) = written.and_then(|()| put(&partial, path)) {
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
    let partial = partial_beside(root);
    sweep_beside(root).and_then(|()| remove_any(&partial)).map_err(|error| (root.to_owned(), error))?;
    let mut write = || {
        let at = |error| (partial.clone(), error);
        fs::create_dir_all(&partial).map_err(at)?;
        let folder = File::open(&partial).map_err(at)?;
        hold(&folder);
        files.try_for_each(|(name, bytes)| {
            let path = partial.join(name);
            create_anew(&path).and_then(|mut file| file.write_all(&bytes)).map_err(|error| (path, error))
        })?;
        sync_all_in(&folder).map_err(at)
    };
    let put = || {
        put_folder(&partial, root)?;
        absent_is_fine(fs::remove_dir_all(&partial))?;
        sync_folder(root)
    };
    let written = write().and_then(|()| put().map_err(|error| (root.to_owned(), error)));
    if written.is_err() {
        let _ = fs::remove_dir_all(&partial);
    }
    written
}

/// Gives a folder the name `root`. What is there has the name `partial` then; at every instant one of the two has the name.
/// Where the file system cannot exchange them, what is there is `root`.replaced meanwhile.
pub fn put_folder(partial: &Path, root: &Path) -> io::Result<()> {
    #[cfg(target_os = "linux")]
    {
        use rustix::fs::{CWD, RenameFlags, renameat_with};
        match renameat_with(CWD, partial, CWD, root, RenameFlags::EXCHANGE) {
            Err(Errno::NOENT) if partial.exists() && root.symlink_metadata().is_err() => {}
            Err(Errno::INVAL | Errno::NOSYS | Errno::OPNOTSUPP) => {}
            exchanged => return Ok(exchanged?),
        }
    }
    put_folder_by_renames(partial, root)
}

fn put_folder_by_renames(partial: &Path, root: &Path) -> io::Result<()> {
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

/// The name beside `path` under which this process writes what will be there.
fn partial_beside(path: &Path) -> PathBuf {
    let name = path.file_name().map_or(String::from("file"), |name| name.to_string_lossy().into_owned());
    path.with_file_name(format!(".{name}.{}.partial", std::process::id()))
}

/// Removes what processes that were killed left in `folder` when they were to write files, or folders, with these names.
pub fn sweep(folder: &Path, is_name: impl Fn(&str) -> bool) -> io::Result<()> {
    let folder = if folder.as_os_str().is_empty() { Path::new(".") } else { folder };
    let abandoned = |name: &str| {
        let (name, process) = name.strip_prefix('.')?.strip_suffix(".partial")?.rsplit_once('.')?;
        let process = process.parse().ok().filter(|_| is_name(name))?;
        Some(process)
    };
    // It may not be there yet, or let nobody list it: nothing is swept then.
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

/// [`sweep`]s for what is to be at `path`.
fn sweep_beside(path: &Path) -> io::Result<()> {
    let name = path.file_name().map(|name| name.to_string_lossy().into_owned());
    sweep(path.parent().unwrap_or(Path::new("")), |found| Some(found) == name.as_deref())
}

/// True if what a process was writing will never be finished: no such process runs here, and none on another host that
/// shares the folder holds it.
fn is_abandoned(process: i32, path: &Path) -> bool {
    let dead = || Pid::from_raw(process).is_none_or(|process| test_kill_process(process) == Err(Errno::SRCH));
    let free = || {
        let opened = rustix::fs::open(path, OFlags::RDONLY | OFlags::NOFOLLOW | OFlags::NONBLOCK, Mode::empty());
        opened.is_ok_and(|file| !matches!(File::from(file).try_lock(), Err(TryLockError::WouldBlock)))
    };
    dead() && free()
}

/// Shows other hosts that a file or folder is being written, as long as it is open.
fn hold(file: &File) {
    // Where there are no locks, the process alone tells.
    let _ = file.try_lock();
}

/// Removes a file, or a folder with all that is in it; if it is there.
fn remove_any(path: &Path) -> io::Result<()> {
    let removed = match path.symlink_metadata() {
        Ok(there) if there.is_dir() => fs::remove_dir_all(path),
        _ => fs::remove_file(path),
    };
    absent_is_fine(removed)
}

/// The result, or success if what was to go is not there.
pub fn absent_is_fine(result: io::Result<()>) -> io::Result<()> {
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
        // The same of a folder, which a file may have the name of.
        fs::create_dir_all(path(&format!(".maps.{dead}.partial/within"))).expect("a folder");
        write_folder_whole(&path("maps"), [(String::from("a"), b"1".to_vec())].into_iter()).expect("written");
        assert!(!path(&format!(".maps.{dead}.partial")).exists() && path("maps/a").exists());
    }

    #[test]
    fn a_folder_takes_the_place_of_another_with_and_without_an_exchange() {
        for put in [put_folder, put_folder_by_renames] {
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
