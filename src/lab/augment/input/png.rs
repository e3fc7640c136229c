//! What the first and the last bytes of a PNG tell: its size, and whether it is complete. Its pixels are unpacked later.

use std::io::{Read, Seek, SeekFrom};
use std::path::Path;

use crate::files::input;

/// Signature, length and kind of the first chunk, width, height.
const HEAD: usize = 24;
/// The last chunk is as long as 12 bytes; some programs put a few more behind it.
const TAIL: u64 = 64;

/// Columns and rows of the image in a file.
pub fn size_of_file(path: &Path) -> Result<[usize; 2], String> {
    let (mut file, length) = input::open(path).map_err(|error| error.to_string())?;
    let (mut head, mut tail) = (Vec::new(), Vec::new());
    let read = (&mut file).take(HEAD as u64).read_to_end(&mut head).and_then(|_| {
        file.seek(SeekFrom::Start(length.saturating_sub(TAIL)))?;
        file.take(TAIL).read_to_end(&mut tail)
    });
    read.map_err(|error| error.to_string())?;
    size(&head, &tail)
}

/// Columns and rows of an image in memory.
pub fn size_of_bytes(bytes: &[u8]) -> Result<[usize; 2], String> {
    size(bytes, &bytes[bytes.len().saturating_sub(TAIL as usize)..])
}

fn size(head: &[u8], tail: &[u8]) -> Result<[usize; 2], String> {
    let Some(head) = head.first_chunk::<HEAD>().filter(|head| head.starts_with(b"\x89PNG\r\n\x1a\n")) else {
        return Err(String::from("it is no PNG"));
    };
    if !tail.windows(4).any(|window| window == b"IEND") {
        return Err(String::from("it is cut off"));
    }
    let number = |at: usize| u32::from_be_bytes([head[at], head[at + 1], head[at + 2], head[at + 3]]) as usize;
    let size = [number(16), number(20)];
    crate::core::base::view::sides(size)?;
    Ok(size)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::files::png::encode_rgb;

    #[test]
    fn a_valid_png_has_its_size_and_a_cut_one_is_told() {
        let valid = encode_rgb(7, 3, &[9; 63]);
        assert_eq!(size_of_bytes(&valid), Ok([7, 3]));
        assert_eq!(size_of_bytes(&valid[..valid.len() - 8]), Err(String::from("it is cut off")));
        assert_eq!(size_of_bytes(b"GIF89a"), Err(String::from("it is no PNG")));
        let folder = tempfile::tempdir().expect("a folder");
        std::fs::write(folder.path().join("a.png"), &valid).expect("a file");
        assert_eq!(size_of_file(&folder.path().join("a.png")), Ok([7, 3]));
        assert!(size_of_file(folder.path()).is_err() && size_of_file(&folder.path().join("b.png")).is_err());
    }
}
