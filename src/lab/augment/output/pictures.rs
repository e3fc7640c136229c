//! Encodes derived pictures in the format that their names say: tars keep the names of their files.

use std::io::Cursor;
use std::path::Path;

use image::codecs::jpeg::JpegEncoder;
use image::{ExtendedColorType, ImageEncoder, ImageFormat, RgbImage};

use gelsim_core::camera::Image;
use gelsim_files::{image_file, png};

/// Quality of JPEG: its losses are below noise of one grey level.
const JPEG_QUALITY: u8 = 98;

/// Returns the format that the end of a name says; PNG if it says none.
fn format_from_name(name: &str) -> ImageFormat {
    let name = format!("KEY.{name}").to_ascii_lowercase();
    ImageFormat::from_path(Path::new(&name)).unwrap_or(ImageFormat::Png)
}

/// Returns true if a file's bytes are in the format that the end of its name says.
pub fn is_of_format(bytes: &[u8], name: &str) -> bool {
    let endings = format_from_name(name).extensions_str();
    image_file::detect_extension(bytes).is_some_and(|ending| endings.contains(&ending))
}

/// Encodes a picture in the format that the end of its name says.
pub fn encode_as(name: &str, image: &Image) -> Result<Vec<u8>, String> {
    let (width, height) = (image.width as u32, image.height as u32);
    let mut bytes = Cursor::new(Vec::new());
    let written = match format_from_name(name) {
        ImageFormat::Png => return Ok(png::encode_rgb(image.width, image.height, &image.rgb)),
        ImageFormat::Jpeg => JpegEncoder::new_with_quality(&mut bytes, JPEG_QUALITY).write_image(
            &image.rgb,
            width,
            height,
            ExtendedColorType::Rgb8,
        ),
        format => match RgbImage::from_raw(width, height, image.rgb.clone()) {
            Some(picture) => picture.write_to(&mut bytes, format),
            None => return Err(String::from("the picture has another size than it says")),
        },
    };
    written.map_err(|error| format!("cannot be written as a file that ends in {name}: {error}"))?;
    Ok(bytes.into_inner())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_picture_is_of_the_format_that_its_name_says() {
        let rgb: Vec<u8> = (0..32 * 24 * 3).map(|at| (at * 7 % 251) as u8 / 4 + 80).collect();
        let image = Image { width: 32, height: 24, rgb: rgb.clone(), saturated_px: 0, clipped_px: 0, finite: true };
        for (name, ending) in [
            ("png", "png"),
            ("tactile.png", "png"),
            ("jpg", "jpg"),
            ("rgb.JPEG", "jpg"),
            ("bmp", "bmp"),
            ("tif", "tif"),
            ("webp", "webp"),
            ("img", "png"),
        ] {
            let bytes = encode_as(name, &image).unwrap_or_else(|error| panic!("{name}: {error}"));
            assert!(is_of_format(&bytes, name) && image_file::detect_extension(&bytes) == Some(ending), "{name}");
            let read = image_file::decode_rgb(&bytes).unwrap_or_else(|error| panic!("{name}: {error}"));
            let errors = read.as_raw().iter().zip(&rgb).map(|(a, b)| a.abs_diff(*b));
            let most = errors.max().unwrap_or(0);
            assert!(most == 0 || ending == "jpg" && most <= 8, "{name}: {most}");
        }
        assert!(!is_of_format(&png::encode_rgb(1, 1, &[0; 3]), "jpg"));
    }
}
