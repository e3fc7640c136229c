//! Decodes PNG files that may come from anywhere.

use std::io::Cursor;

use image::codecs::png::PngDecoder;
use image::{ColorType, DynamicImage, ImageDecoder};

use crate::image_file::explain_image_error;
use crate::size_limits;
use gelsim_core::base::grid::Grid;

/// Decodes a grey image of heights: 0 for black, 1 for white. It is refused if it would unpack to far more than its
/// bytes.
pub fn decode_heights(bytes: &[u8]) -> Result<Grid<f32>, String> {
    let ([width, height], pixel) = read_header(bytes)?;
    size_limits::check_image_bytes([width, height], pixel.bytes_per_pixel() as usize + 4, bytes.len())?;
    let data = match decode(bytes)? {
        DynamicImage::ImageLuma8(grey) => grey.as_raw().iter().map(|value| f32::from(*value) / 255.0).collect(),
        DynamicImage::ImageLuma16(grey) => grey.as_raw().iter().map(|value| f32::from(*value) / 65535.0).collect(),
        _ => return Err(String::from("not a grey image")),
    };
    Ok(Grid { width, height, data })
}

/// Reads the width, height and kind of pixel from the header of an image.
pub fn read_header(bytes: &[u8]) -> Result<([usize; 2], ColorType), String> {
    let decoder = create_decoder(bytes)?;
    let (width, height) = decoder.dimensions();
    Ok(([width as usize, height as usize], decoder.color_type()))
}

/// Decodes the values of a 16-bit grey PNG.
pub fn decode_grey16(bytes: &[u8]) -> Result<Grid<u16>, String> {
    match decode(bytes)? {
        DynamicImage::ImageLuma16(grey) => {
            Ok(Grid { width: grey.width() as usize, height: grey.height() as usize, data: grey.into_raw() })
        }
        _ => Err(String::from("not a grey image of 16 bits")),
    }
}

/// Decodes lengths in mm that [`super::encode_steps`] encoded.
pub fn decode_steps(bytes: &[u8], mm_per_step: f64, zero: f64) -> Result<Grid<f32>, String> {
    let values = decode_grey16(bytes)?;
    let mm = |value: &u16| ((f64::from(*value) - zero) * mm_per_step) as f32;
    Ok(Grid { width: values.width, height: values.height, data: values.data.iter().map(mm).collect() })
}

/// Decodes an image with the pixels that it has.
pub fn decode(bytes: &[u8]) -> Result<DynamicImage, String> {
    DynamicImage::from_decoder(create_decoder(bytes)?).map_err(|error| explain_image_error(&error, "PNG"))
}

/// Makes a decoder. More than 8192 px on a side is refused before anything is unpacked.
fn create_decoder(bytes: &[u8]) -> Result<PngDecoder<Cursor<&[u8]>>, String> {
    if !palette_lengths(bytes).all(|length| length % 3 == 0 && length <= 3 * 256) {
        // The decoder would panic on such a palette.
        return Err(String::from("its palette has no whole number of colours, 256 at most"));
    }
    let mut limits = image::Limits::default();
    limits.max_image_width = Some(gelsim_core::base::view::MOST_PX as u32);
    limits.max_image_height = Some(gelsim_core::base::view::MOST_PX as u32);
    // This limit is for what stands beside the pixels, such as a compressed colour profile.
    limits.max_alloc = Some(1 << 24);
    PngDecoder::with_limits(Cursor::new(bytes), limits).map_err(|error| explain_image_error(&error, "PNG"))
}

/// Iterates over the lengths of the palettes in a PNG file, bytes.
fn palette_lengths(bytes: &[u8]) -> impl Iterator<Item = u64> {
    let mut rest = bytes.get(8..).unwrap_or_default();
    let chunks = std::iter::from_fn(move || {
        let (length, after) = rest.split_first_chunk::<4>()?;
        let (kind, after) = after.split_first_chunk::<4>()?;
        let length = u64::from(u32::from_be_bytes(*length));
        // Skip the content and the checksum.
        rest = after.get(usize::try_from(length + 4).ok()?..).unwrap_or_default();
        Some((*kind, length))
    });
    chunks.filter(|(kind, _)| kind == b"PLTE").map(|(_, length)| length)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn heights_are_a_grey_png_of_8_or_16_bits() {
        let png = |image: DynamicImage| {
            let mut bytes = std::io::Cursor::new(Vec::new());
            image.write_to(&mut bytes, image::ImageFormat::Png).expect("encoded");
            bytes.into_inner()
        };
        let grey = image::GrayImage::from_raw(2, 1, vec![0, 255]).expect("two pixels");
        let deep = image::ImageBuffer::<image::Luma<u16>, _>::from_raw(1, 2, vec![0, 13_107]).expect("two pixels");
        let read = decode_heights(&png(DynamicImage::ImageLuma8(grey)));
        assert_eq!(read, Ok(Grid { width: 2, height: 1, data: vec![0.0, 1.0] }));
        let read = decode_heights(&png(DynamicImage::ImageLuma16(deep)));
        assert_eq!(read, Ok(Grid { width: 1, height: 2, data: vec![0.0, 0.2] }));
        assert!(decode_heights(&png(DynamicImage::new_rgb8(2, 2))).is_err());
        assert!(decode_heights(b"no image").is_err());
    }

    #[test]
    fn a_palette_with_a_part_of_a_colour_is_refused_instead_of_bringing_the_decoder_down() {
        let path = concat!(env!("CARGO_MANIFEST_DIR"), "/../../tests/fuzz/regressions/png/part_of_a_colour");
        let bytes = std::fs::read(path).expect("a file of the repository");
        assert_eq!(palette_lengths(&bytes).collect::<Vec<_>>(), [23]);
        assert!(decode(&bytes).expect_err("refused").contains("palette"));
        assert_eq!(palette_lengths(b"").count() + palette_lengths(&[255; 40]).count(), 0);
    }

    #[test]
    fn another_kind_of_picture_has_no_16_bit_values() {
        assert!(decode_grey16(&crate::png::encode_grey(1, 1, &[7])).is_err());
        assert!(decode_grey16(b"").is_err());
    }
}
