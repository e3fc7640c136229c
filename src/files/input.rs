//! Files that a user names, read whole: only regular ones, and none larger than what belongs there may be.
//!
//! A device or a pipe would be read for ever or never; what grows while it is read is cut off at the same limit.

use std::fs::{self, File};
use std::io::{self, Read};
use std::path::Path;

/// Largest image or array, bytes.
pub const MOST_IMAGE_BYTES: u64 = 1 << 30;
/// Largest mesh, bytes.
pub const MOST_MESH_BYTES: u64 = 4 << 30;

/// The bytes of the file at `path`; an error if it is not a regular file or holds more than `most` bytes.
pub fn read(path: &Path, most: u64) -> io::Result<Vec<u8>> {
    let there = fs::metadata(path)?;
    if there.is_dir() {
        return Err(io::Error::other("it is a folder"));
    }
    if !there.is_file() {
        return Err(io::Error::other("it is not a regular file"));
    }
    let too_large = || io::Error::other(format!("it is larger than {} MB", most >> 20));
    if there.len() > most {
        return Err(too_large());
    }
    let mut bytes = Vec::new();
    bytes.try_reserve_exact(there.len() as usize)?;
    if File::open(path)?.take(most + 1).read_to_end(&mut bytes)? as u64 > most {
        return Err(too_large());
    }
    Ok(bytes)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_file_is_read_up_to_the_limit_and_what_is_no_file_is_refused() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("two");
        fs::write(&path, b"ab").unwrap();
        assert_eq!(read(&path, 2).unwrap(), b"ab");
        assert_eq!(read(&path, 1).unwrap_err().to_string(), "it is larger than 0 MB");
        assert_eq!(read(folder.path(), 9).unwrap_err().to_string(), "it is a folder");
        assert_eq!(read(&folder.path().join("none"), 9).unwrap_err().kind(), io::ErrorKind::NotFound);
        if cfg!(unix) {
            assert_eq!(read(Path::new("/dev/zero"), 9).unwrap_err().to_string(), "it is not a regular file");
        }
    }
}
