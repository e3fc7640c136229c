//! Lock files: held by the operating system, which frees them when a process dies, and naming who writes.

use std::fs::{self, File, OpenOptions, TryLockError};
use std::io::{self, Read, Seek, Write};
use std::os::unix::fs::{MetadataExt, OpenOptionsExt};
use std::path::{Path, PathBuf};

use rustix::fs::OFlags;
use rustix::io::Errno;

use gelsim_files::write::same_file;

/// The right to write something, held until dropped. The operating system frees it when a process dies.
pub struct Lock {
    path: PathBuf,
    file: File,
}

impl Lock {
    /// Takes the lock that the file at `path` stands for, or says who has it.
    pub fn take(path: &Path) -> io::Result<Result<Self, String>> {
        loop {
            let file = open_lock(path)?;
            match file.try_lock() {
                Ok(()) => {}
                Err(TryLockError::WouldBlock) => {
                    let holder = holder(Some(file));
                    return Ok(Err(if holder.is_empty() { String::from("another process") } else { holder }));
                }
                Err(TryLockError::Error(error)) if knows_no_locks(&error) => {}
                Err(TryLockError::Error(error)) => return Err(error),
            }
            if let Some(lock) = Self::signed(file, path)? {
                return Ok(Ok(lock));
            }
        }
    }

    /// Takes the lock, and waits while another process has it.
    pub fn wait(path: &Path) -> io::Result<Self> {
        loop {
            let file = open_lock(path)?;
            match file.lock() {
                Err(error) if !knows_no_locks(&error) => return Err(error),
                _ => {}
            }
            if let Some(lock) = Self::signed(file, path)? {
                return Ok(lock);
            }
        }
    }

    /// Writes into the locked file who holds it. `None` if the file is no longer the one at `path`: whoever finishes
    /// removes it, and a lock on a removed file protects nothing.
    fn signed(file: File, path: &Path) -> io::Result<Option<Self>> {
        if !same_file(&file, path) {
            return Ok(None);
        }
        let holder = format!("process {} on {}\n", std::process::id(), host());
        let lock = Self { path: path.to_owned(), file };
        let mut file = &lock.file;
        file.set_len(0)?;
        file.rewind()?;
        file.write_all(holder.as_bytes())?;
        Ok(Some(lock))
    }
}

impl Drop for Lock {
    fn drop(&mut self) {
        // Nothing depends on it: a lock file that stays is locked anew by the next run.
        let _ = fs::remove_file(&self.path);
    }
}

/// Who holds a lock, as its file says: anybody may have written it, so that it is cut, and nothing in it speaks to a
/// terminal.
pub fn holder(file: Option<File>) -> String {
    const MOST: usize = 200;
    let mut bytes = Vec::new();
    // Unreadable, it names nobody.
    let _ = file.map(|file| file.take(4 * MOST as u64).read_to_end(&mut bytes));
    String::from_utf8_lossy(&bytes).trim().chars().take(MOST).flat_map(char::escape_debug).collect()
}

/// True if it is the file system that has no locks, as some network folders. Nothing is then lost but work: who finishes a
/// shard looks whether it still is the file that was begun, and both would have written the same bytes.
fn knows_no_locks(error: &io::Error) -> bool {
    error.kind() == io::ErrorKind::Unsupported || error.raw_os_error() == Some(Errno::NOLCK.raw_os_error())
}

/// Opens a lock file, which is about to be written: only a plain file that has no other name, and not through a link.
fn open_lock(path: &Path) -> io::Result<File> {
    let mut options = OpenOptions::new();
    options.read(true).write(true).create(true).truncate(false);
    // Without waiting for the other end, should it be a pipe.
    options.custom_flags((OFlags::NOFOLLOW | OFlags::NONBLOCK).bits() as i32);
    let file = options.open(path)?;
    let meta = file.metadata()?;
    if meta.is_file() && meta.nlink() <= 1 {
        return Ok(file);
    }
    Err(io::Error::new(io::ErrorKind::InvalidInput, "not a plain file, or one with a second name; remove it"))
}

fn host() -> String {
    let name = fs::read_to_string("/proc/sys/kernel/hostname").unwrap_or_default();
    let name = name.trim();
    if name.is_empty() { String::from("this host") } else { name.to_owned() }
}
