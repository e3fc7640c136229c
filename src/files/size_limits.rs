//! Checks the sizes that an image file or an archive claims, before memory is taken for it.
//!
//! A few bytes of a compressed file can stand for gigabytes. Images do not compress that well: a file that would unpack
//! to much more than its own size is refused, unless it is small anyway.

use gelsim_core::base::view::check_image_size;

/// Bytes to which any file may unpack.
const FREE_BYTES: usize = 96 << 20;
/// Bytes to which each byte of a larger file may unpack: twenty times the most that was seen in photographs and height
/// maps.
const MAX_RATIO: usize = 100;

/// Refuses an image of these columns and rows that takes `bytes_per_px` bytes per pixel while it is read from `file`
/// bytes.
pub fn check_image_bytes(size: [usize; 2], bytes_per_px: usize, file: usize) -> Result<(), String> {
    check_image_size(size)?;
    check_unpacked_bytes(bytes_per_px.saturating_mul(size[0] * size[1]), file)
}

/// Refuses content that takes `unpacked` bytes while it is read from `file` bytes.
pub fn check_unpacked_bytes(unpacked: usize, file: usize) -> Result<(), String> {
    if unpacked > FREE_BYTES.max(file.saturating_mul(MAX_RATIO)) {
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
        assert_eq!(check_image_bytes([8192, 1], 4, 1), Ok(()));
        assert_eq!(check_image_bytes([8192, 8192], 3, 3 << 20), Ok(()));
        assert_eq!(
            check_image_bytes([8192, 8192], 3, 1 << 10),
            Err(String::from("its 1 kB would unpack to 192 MB: save it in a smaller size, or less packed"))
        );
        assert!(check_image_bytes([4, 4], usize::MAX, 1).is_err());
        assert!(check_image_bytes([8193, 1], 1, 1 << 20).is_err());
        assert!(check_image_bytes([1, 0], 1, 1).is_err());
    }
}
