//! How a JPEG says that it is stored turned.

use std::io::Read;
use std::path::Path;

use gelsim_files::input;

/// Bytes of a file that are searched: cameras write the segment with the turn first, and it has at most 64 KB.
const MAX_BYTES: u64 = 128 << 10;
/// First bytes of a JPEG.
const JPEG: [u8; 2] = [0xff, 0xd8];

/// Returns the turn of an image file as EXIF numbers it, 2 to 8; `None` if it is upright, no JPEG or cannot be read.
pub fn find_turn_of_file(path: &Path) -> Option<u16> {
    let (mut file, _) = input::open(path).ok()?;
    let mut head = Vec::new();
    (&mut file).take(JPEG.len() as u64).read_to_end(&mut head).ok()?;
    if head != JPEG {
        return None;
    }
    file.take(MAX_BYTES).read_to_end(&mut head).ok()?;
    find_turn(&head)
}

/// Returns the turn of an image as EXIF numbers it, 2 to 8; `None` if it is upright or no JPEG.
pub fn find_turn(bytes: &[u8]) -> Option<u16> {
    let mut rest = bytes.strip_prefix(&JPEG)?;
    while let [0xff, marker, high, low, after @ ..] = rest {
        // The length counts its own two bytes. Behind the last header are pixels.
        let length = usize::from(u16::from_be_bytes([*high, *low])).checked_sub(2)?;
        let exif = after.strip_prefix(b"Exif\0\0").filter(|_| *marker == 0xe1);
        if *marker == 0xda || exif.is_some() {
            return exif.and_then(read_orientation).filter(|turn| (2..=8).contains(turn));
        }
        rest = after.get(length..)?;
    }
    None
}

/// Reads the tag of the orientation in a TIFF's first directory.
fn read_orientation(tiff: &[u8]) -> Option<u16> {
    const ORIENTATION: u16 = 0x0112;
    let [a, b, _, _, start @ ..] = tiff else { return None };
    let big_endian = match [*a, *b] {
        [b'M', b'M'] => true,
        [b'I', b'I'] => false,
        _ => return None,
    };
    let start: [u8; 4] = start.first_chunk().copied()?;
    let start = if big_endian { u32::from_be_bytes(start) } else { u32::from_le_bytes(start) };
    let number = |two: [u8; 2]| if big_endian { u16::from_be_bytes(two) } else { u16::from_le_bytes(two) };
    let [high, low, entries @ ..] = tiff.get(start as usize..)? else { return None };
    let mut entries = entries.chunks_exact(12).take(usize::from(number([*high, *low])));
    // An entry is its tag, type and count, and its value.
    entries.find_map(|entry| match entry {
        [a, b, _, _, _, _, _, _, high, low, ..] if number([*a, *b]) == ORIENTATION => Some(number([*high, *low])),
        _ => None,
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The beginning of a JPEG with a comment and an orientation.
    fn turned(big_endian: bool, turn: u16) -> Vec<u8> {
        let short = |value: u16| if big_endian { value.to_be_bytes() } else { value.to_le_bytes() };
        let long = |value: u32| if big_endian { value.to_be_bytes() } else { value.to_le_bytes() };
        let order: &[u8] = if big_endian { b"MM" } else { b"II" };
        let entry = |tag: u16, value: u16| [&short(tag)[..], &short(3), &long(1), &short(value), &[0, 0]].concat();
        let tiff =
            [order, &short(42), &long(8), &short(2), &entry(0x0100, 640), &entry(0x0112, turn), &long(0)].concat();
        let length = (tiff.len() as u16 + 8).to_be_bytes();
        [b"\xff\xd8\xff\xfe\0\x04hi\xff\xe1".as_slice(), &length, b"Exif\0\0", &tiff, b"\xff\xda\0\x02"].concat()
    }

    #[test]
    fn the_turn_of_a_jpeg_is_found_in_either_order_of_bytes_and_no_bytes_end_the_program() {
        for big_endian in [true, false] {
            let bytes = turned(big_endian, 6);
            assert_eq!(find_turn(&bytes), Some(6));
            for upright in [0, 1, 9] {
                assert_eq!(find_turn(&turned(big_endian, upright)), None);
            }
            // Cut anywhere, and with any byte changed.
            for at in 0..bytes.len() {
                let _ = find_turn(&bytes[..at]);
                for value in [0, 1, 0x7f, 0xff] {
                    let mut changed = bytes.clone();
                    changed[at] = value;
                    let _ = find_turn(&changed);
                }
            }
        }
        for bytes in [b"".as_slice(), b"\x89PNG", b"\xff\xd8", b"\xff\xd8\xff\xe1\0\0Exif\0\0"] {
            assert_eq!(find_turn(bytes), None);
        }
    }

    #[test]
    fn a_file_is_read_as_far_as_needed() {
        let folder = tempfile::tempdir().expect("a folder");
        let path = folder.path().join("a.jpg");
        assert_eq!(find_turn_of_file(&path), None);
        std::fs::write(&path, turned(true, 3)).expect("a file");
        assert_eq!(find_turn_of_file(&path), Some(3));
    }
}
