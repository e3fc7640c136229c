//! Sizes that an image file or an archive may claim, checked before memory is taken for it.
//!
//! A few bytes of a compressed file can stand for gigabytes. Pictures do not compress that well: what would unpack to
//! much more than its file is refused, unless it is small anyway.

use gelsim_core::base::view::sides;

/// Bytes that any file may unpack to.
const FREE_BYTES: usize = 96 << 20;
/// Bytes that each byte of a larger file may unpack to: twenty times what was seen of photographs and height maps.
const MOST_TIMES: usize = 100;

/// Refuses an image of so many columns and rows that takes `bytes_per_px` while it is read from `file` bytes.
pub fn check(size: [usize; 2], bytes_per_px: usize, file: usize) -> Result<(), String> {
    sides(size)?;
    bytes(bytes_per_px.saturating_mul(size[0] * size[1]), file)
}

/// Refuses what takes `unpacked` bytes while it is read from `file` bytes.
pub fn bytes(unpacked: usize, file: usize) -> Result<(), String> {
    if unpacked > FREE_BYTES.max(file.saturating_mul(MOST_TIMES)) {
        return Err(format!(
            "its {} kB would unpack to {} MB: save it in a smaller size, or less packed",
            file.div_ceil(1 << 10),
            unpacked >> 20
        ));
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_small_file_may_be_a_small_picture_and_a_large_one_a_large_picture() {
        assert_eq!(check([8192, 1], 4, 1), Ok(()));
        assert_eq!(check([8192, 8192], 3, 3 << 20), Ok(()));
        assert_eq!(
            check([8192, 8192], 3, 1 << 10),
            Err(String::from("its 1 kB would unpack to 192 MB: save it in a smaller size, or less packed"))
        );
        assert!(check([4, 4], usize::MAX, 1).is_err());
        assert!(check([8193, 1], 1, 1 << 20).is_err());
        assert!(check([1, 0], 1, 1).is_err());
    }
}
