//! Lock files. The operating system holds a lock and frees it when its process dies; the file names that process.

use std::fs::{self, File, OpenOptions, TryLockError};
use std::io::{self, Read, Seek, Write};
use std::os::unix::fs::{MetadataExt, OpenOptionsExt};
use std::path::{Path, PathBuf};

use rustix::fs::OFlags;
use rustix::io::Errno;

use gelsim_files::write::is_same_file;

/// The right to write something, held until it is dropped. The operating system frees it when the process dies.
pub struct Lock {
    path: PathBuf,
    file: File,
}

impl Lock {
    /// Takes the lock of the file at `path`. The inner error names the process that holds it.
    pub fn try_acquire(path: &Path) -> io::Result<Result<Self, String>> {
        loop {
            let file = open_lock(path)?;
            match file.try_lock() {
                Ok(()) => {}
                Err(TryLockError::WouldBlock) => {
                    let holder = read_holder(Some(file));
                    return Ok(Err(if holder.is_empty() { String::from("another process") } else { holder }));
                }
                Err(TryLockError::Error(error)) if is_unsupported(&error) => {}
                Err(TryLockError::Error(error)) => return Err(error),
            }
            // The holder may have removed the file between the open and the lock: try again with a new one.
            if let Some(lock) = Self::sign(file, path)? {
                return Ok(Ok(lock));
            }
        }
    }

    /// Takes the lock of the file at `path`, and waits while another process holds it.
    pub fn acquire(path: &Path) -> io::Result<Self> {
        loop {
            let file = open_lock(path)?;
            match file.lock() {
                Err(error) if !is_unsupported(&error) => return Err(error),
                _ => {}
            }
            if let Some(lock) = Self::sign(file, path)? {
                return Ok(lock);
            }
        }
    }

    /// Writes the holder into the locked file. Returns `None` if the file is no longer the one at `path`: a holder
    /// removes it when done, and a lock on a removed file protects nothing.
    fn sign(file: File, path: &Path) -> io::Result<Option<Self>> {
        if !is_same_file(&file, path) {
            return Ok(None);
        }
        let holder = format!("process {} on {}\n", std::process::id(), read_host_name());
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
        // A lock file that stays does no harm: the next run locks it again.
        let _ = fs::remove_file(&self.path);
    }
}

/// Returns the holder that a lock's file names. Anybody may have written the file, so the text is cut and its control
/// characters are escaped. It is empty if the file cannot be read.
pub fn read_holder(file: Option<File>) -> String {
    const MAX_CHARS: usize = 200;
    let mut bytes = Vec::new();
    // A file that cannot be read names nobody.
    let _ = file.map(|file| file.take(4 * MAX_CHARS as u64).read_to_end(&mut bytes));
    String::from_utf8_lossy(&bytes).trim().chars().take(MAX_CHARS).flat_map(char::escape_debug).collect()
}

/// Returns true if the file system has no locks, as some network folders. Only work can be lost then: a process that
/// finishes a shard checks that it still is the file that it began, and all would have written the same bytes.
fn is_unsupported(error: &io::Error) -> bool {
    error.kind() == io::ErrorKind::Unsupported || error.raw_os_error() == Some(Errno::NOLCK.raw_os_error())
}

/// Opens a lock file to be written. It must be a regular file without a second name, and is not opened through a link.
fn open_lock(path: &Path) -> io::Result<File> {
    let mut options = OpenOptions::new();
    options.read(true).write(true).create(true).truncate(false);
    // Opening a pipe would otherwise wait for its other end.
    options.custom_flags((OFlags::NOFOLLOW | OFlags::NONBLOCK).bits() as i32);
    let file = options.open(path)?;
    let meta = file.metadata()?;
    if meta.is_file() && meta.nlink() <= 1 {
        return Ok(file);
    }
    Err(io::Error::new(io::ErrorKind::InvalidInput, "not a plain file, or one with a second name; remove it"))
}

fn read_host_name() -> String {
    let system = rustix::system::uname();
    let name = system.nodename().to_string_lossy();
    if name.is_empty() { String::from("this host") } else { name.into_owned() }
}
