//! Images in a user's formats: PNG, JPEG, BMP, TIFF or WebP. They are read as what their first bytes say, and written
//! as what their names say.

use std::io::{Cursor, Read, Seek, SeekFrom};
use std::path::Path;

use image::codecs::jpeg::JpegEncoder;
use image::error::ImageError;
use image::{
    ColorType, DynamicImage, ExtendedColorType, ImageDecoder, ImageEncoder, ImageFormat, ImageReader, RgbImage,
};

use super::{foreign, input, png, size_limits};
use gelsim_core::base::view::{MOST_PX, check_image_size};
use gelsim_core::camera::Image;

/// The formats that are read, their names, and the extensions of their files.
const FORMATS: [(ImageFormat, &str, &[&str]); 5] = [
    (ImageFormat::Png, "PNG", &["png"]),
    (ImageFormat::Jpeg, "JPEG", &["jpg", "jpeg", "jpe"]),
    (ImageFormat::Bmp, "BMP", &["bmp"]),
    (ImageFormat::Tiff, "TIFF", &["tif", "tiff"]),
    (ImageFormat::WebP, "WebP", &["webp"]),
];

/// The names of the formats as messages list them.
pub const FORMAT_NAMES: &str = "PNG, JPEG, BMP, TIFF or WebP";

/// Number of first bytes that tell the format of a file.
const HEAD_BYTES: usize = 64;

/// Returns true if a file's extension is that of an image.
pub fn has_image_extension(path: &Path) -> bool {
    let ending = path.extension().and_then(|ending| ending.to_str()).map(str::to_ascii_lowercase);
    ending.is_some_and(|ending| FORMATS.iter().any(|(_, _, endings)| endings.contains(&ending.as_str())))
}

/// Detects the format by the first bytes. The error says what the file is instead.
fn detect_format(bytes: &[u8]) -> Result<(ImageFormat, &'static str), String> {
    let format = match bytes {
        [0x89, b'P', b'N', b'G', b'\r', b'\n', 0x1a, b'\n', ..] => ImageFormat::Png,
        [0xff, 0xd8, 0xff, ..] => ImageFormat::Jpeg,
        [b'B', b'M', _, _, _, _, 0, 0, 0, 0, ..] => ImageFormat::Bmp,
        [b'I', b'I', 42, 0, ..] | [b'M', b'M', 0, 42, ..] => ImageFormat::Tiff,
        [b'R', b'I', b'F', b'F', _, _, _, _, b'W', b'E', b'B', b'P', ..] => ImageFormat::WebP,
        _ => {
            return Err(match foreign::identify_foreign_binary(bytes) {
                Some(foreign) => foreign.to_string(),
                None => format!("it does not begin like a picture ({FORMAT_NAMES})"),
            });
        }
    };
    let (_, name, _) = FORMATS.iter().find(|(known, ..)| *known == format).expect("one of them");
    Ok((format, name))
}

/// Returns the usual file extension of the format of these bytes, without a dot; `None` if they are no image.
pub fn detect_extension(bytes: &[u8]) -> Option<&'static str> {
    let (found, _) = detect_format(bytes).ok()?;
    FORMATS.iter().find(|(format, ..)| *format == found).map(|(_, _, endings)| endings[0])
}

/// Decodes an image of 1 to 8192 px on a side with the pixels that it has. It is refused if it would unpack to far more
/// than its bytes.
pub fn decode_image(bytes: &[u8]) -> Result<DynamicImage, String> {
    let (format, name) = detect_format(bytes)?;
    let (size, pixel) = read_header_as(bytes, format, name)?;
    size_limits::check_image_bytes(size, pixel.bytes_per_pixel() as usize + 3, bytes.len())?;
    match format {
        ImageFormat::Png => png::decode(bytes),
        // The decoder would make the rows that are missing up.
        ImageFormat::Jpeg if !has_jpeg_end(bytes) => Err(String::from("it is cut off")),
        _ => create_reader(bytes, format).decode().map_err(|error| explain_image_error(&error, name)),
    }
}

/// Decodes an image to 8-bit RGB.
pub fn decode_rgb(bytes: &[u8]) -> Result<RgbImage, String> {
    decode_image(bytes).map(DynamicImage::into_rgb8)
}

/// Reads the width, height and kind of pixel from the header of an image.
pub fn read_header(bytes: &[u8]) -> Result<([usize; 2], ColorType), String> {
    let (format, name) = detect_format(bytes)?;
    read_header_as(bytes, format, name)
}

fn read_header_as(bytes: &[u8], format: ImageFormat, name: &str) -> Result<([usize; 2], ColorType), String> {
    if format == ImageFormat::Png {
        return png::read_header(bytes);
    }
    let decoder = create_reader(bytes, format).into_decoder().map_err(|error| explain_image_error(&error, name))?;
    let (width, height) = decoder.dimensions();
    let size = [width as usize, height as usize];
    check_image_size(size)?;
    Ok((size, decoder.color_type()))
}

fn create_reader(bytes: &[u8], format: ImageFormat) -> ImageReader<Cursor<&[u8]>> {
    let mut reader = ImageReader::with_format(Cursor::new(bytes), format);
    let mut limits = image::Limits::default();
    limits.max_image_width = Some(MOST_PX as u32);
    limits.max_image_height = Some(MOST_PX as u32);
    limits.max_alloc = Some(1 << 30);
    reader.limits(limits);
    reader
}

/// Reads the columns and rows of an image file, and checks its end to see whether it is complete. Pixels are not
/// unpacked.
pub fn read_size_of_file(path: &Path) -> Result<[usize; 2], String> {
    let (mut file, length) = input::open(path).map_err(|error| error.to_string())?;
    let mut head = Vec::new();
    (&mut file).take(HEAD_BYTES as u64).read_to_end(&mut head).map_err(|error| error.to_string())?;
    let (format, _) = detect_format(&head)?;
    let mut tail = Vec::new();
    let ends = file
        .seek(SeekFrom::Start(length.saturating_sub(TAIL_BYTES)))
        .and_then(|_| (&mut file).take(TAIL_BYTES).read_to_end(&mut tail));
    ends.map_err(|error| error.to_string())?;
    match format {
        ImageFormat::Png => read_png_size(&head, &tail),
        // The place of the size in the file is not known beforehand, so all of it is read.
        _ => read_size_of_bytes(&input::read(path, input::MAX_IMAGE_BYTES).map_err(|error| error.to_string())?),
    }
}

/// Reads the columns and rows of an image in memory, and checks its end to see whether it is complete. Pixels are not
/// unpacked.
pub fn read_size_of_bytes(bytes: &[u8]) -> Result<[usize; 2], String> {
    let (format, name) = detect_format(bytes)?;
    match format {
        ImageFormat::Png => read_png_size(bytes, &bytes[bytes.len().saturating_sub(TAIL_BYTES as usize)..]),
        ImageFormat::Jpeg if !has_jpeg_end(bytes) => Err(String::from("it is cut off")),
        _ => read_header_as(bytes, format, name).map(|(size, _)| size),
    }
}

/// Returns true if a JPEG has an end behind the beginning of its pixels. The small picture in its header has one, too.
fn has_jpeg_end(bytes: &[u8]) -> bool {
    let mut rest = bytes.get(2..).unwrap_or_default();
    while let [0xff, marker, after @ ..] = rest {
        rest = match (marker, after) {
            (0xda, _) => break,
            (0xff, _) => &rest[1..],
            (0x01 | 0xd0..=0xd7, _) => after,
            (_, [high, low, ..]) => after.get(usize::from(u16::from_be_bytes([*high, *low]))..).unwrap_or_default(),
            _ => return false,
        };
    }
    rest.windows(2).any(|pair| pair == [0xff, 0xd9])
}

/// Bytes of the end of a PNG that are searched: its last chunk has 12, and some programs put a few more behind it.
const TAIL_BYTES: u64 = 64;

fn read_png_size(head: &[u8], tail: &[u8]) -> Result<[usize; 2], String> {
    if head.len() < 24 || !tail.windows(4).any(|window| window == b"IEND") {
        return Err(String::from("it is cut off"));
    }
    // The header chunk comes first by the format: width at byte 16, height at byte 20.
    let number = |at: usize| u32::from_be_bytes([head[at], head[at + 1], head[at + 2], head[at + 3]]) as usize;
    let size = [number(16), number(20)];
    check_image_size(size)?;
    Ok(size)
}

/// Says in a user's words what an image library reports.
pub(super) fn explain_image_error(error: &ImageError, name: &str) -> String {
    let text = error.to_string();
    match error {
        _ if text.contains("CRC") || text.contains("checksum") || text.contains("Checksum") => {
            format!("the {name} is damaged: a checksum in it is wrong")
        }
        ImageError::Limits(_) => format!("it is larger than {MOST_PX} px on a side"),
        ImageError::IoError(error) if error.kind() == std::io::ErrorKind::UnexpectedEof => {
            String::from("it is cut off")
        }
        ImageError::Unsupported(_) => format!("it is a kind of {name} that is not read: save it as PNG"),
        _ if text.contains("end of file") || text.contains("unexpected EOF") || text.contains("Unexpected EOF") => {
            String::from("it is cut off")
        }
        // The library gives the reason in its own terms, which help nobody.
        _ => format!("the {name} is damaged"),
    }
}

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
    detect_extension(bytes).is_some_and(|ending| endings.contains(&ending))
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

    fn encoded(format: ImageFormat) -> Vec<u8> {
        let picture = RgbImage::from_fn(24, 16, |x, y| image::Rgb([(x * 10) as u8, (y * 15) as u8, 90]));
        let mut bytes = Cursor::new(Vec::new());
        DynamicImage::ImageRgb8(picture).write_to(&mut bytes, format).expect("encoded");
        bytes.into_inner()
    }

    #[test]
    fn a_jpeg_without_its_end_is_refused_though_the_picture_in_its_header_has_one() {
        let whole = encoded(ImageFormat::Jpeg);
        // A comment with an end in it, as a small picture in a header has, and what some programs write behind the end.
        let header = [&whole[..2], b"\xff\xfe\x00\x06\xff\xd9\xff\xd9", &whole[2..]].concat();
        let followed = [&header[..], &[7; 200]].concat();
        for bytes in [&whole, &header, &followed] {
            assert_eq!(decode_rgb(bytes).map(|picture| picture.dimensions()), Ok((24, 16)));
            assert_eq!(read_size_of_bytes(bytes), Ok([24, 16]));
        }
        for bytes in [&whole, &header] {
            for kept in [bytes.len() - 2, bytes.len() - 20] {
                let cut = &bytes[..kept];
                assert_eq!(decode_rgb(cut).map(|_| ()), Err(String::from("it is cut off")));
                assert_eq!(read_size_of_bytes(cut), Err(String::from("it is cut off")));
            }
        }
    }

    #[test]
    fn every_format_is_read_by_its_bytes() {
        for (format, name, endings) in FORMATS {
            let bytes = encoded(format);
            assert_eq!(detect_extension(&bytes), Some(endings[0]));
            assert_eq!(read_header(&bytes).map(|(size, _)| size), Ok([24, 16]), "{name}");
            assert_eq!(read_size_of_bytes(&bytes), Ok([24, 16]), "{name}");
            let read = decode_rgb(&bytes).unwrap_or_else(|error| panic!("{name}: {error}"));
            let [red, green, blue] = read.get_pixel(10, 8).0;
            assert!(
                red.abs_diff(100) < 9 && green.abs_diff(120) < 9 && blue.abs_diff(90) < 9,
                "{name}: {red} {green} {blue}"
            );
            // The name says another format.
            let folder = tempfile::tempdir().expect("a folder");
            let path = folder.path().join("picture.gif");
            std::fs::write(&path, &bytes).expect("a file");
            assert_eq!(read_size_of_file(&path), Ok([24, 16]), "{name}");
        }
    }

    #[test]
    fn what_is_cut_damaged_or_no_picture_is_told_in_plain_words() {
        for (format, name, _) in FORMATS {
            let bytes = encoded(format);
            let cut = decode_rgb(&bytes[..bytes.len() / 2]);
            // A JPEG or a TIFF of one strip that is cut off shows what is there; none may end the program.
            if let Err(reason) = cut {
                assert!(!reason.contains(['{', '}']) && !reason.contains("Error"), "{name}: {reason}");
            }
        }
        let mut png = encoded(ImageFormat::Png);
        let at = png.windows(4).position(|window| window == b"IDAT").expect("pixels") + 8;
        png[at] ^= 0x55;
        assert!(decode_rgb(&png).is_err_and(|said| said.starts_with("the PNG is damaged")));
        for (bytes, reason) in [
            (b"".as_slice(), "it is empty"),
            (b"GIF89a", "it is a GIF picture: save it as PNG"),
            (b"version https://git-lfs.github.com/spec/v1\n", "it is a pointer of Git LFS"),
            (b"Not Found\n", "it is text"),
            (b"\x01\x02\x03\x04\x05", "it does not begin like a picture"),
        ] {
            let said = decode_rgb(bytes).expect_err("no picture");
            assert!(said.starts_with(reason), "{said}");
        }
    }

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
            assert!(is_of_format(&bytes, name) && detect_extension(&bytes) == Some(ending), "{name}");
            let read = decode_rgb(&bytes).unwrap_or_else(|error| panic!("{name}: {error}"));
            let errors = read.as_raw().iter().zip(&rgb).map(|(a, b)| a.abs_diff(*b));
            let most = errors.max().unwrap_or(0);
            assert!(most == 0 || ending == "jpg" && most <= 8, "{name}: {most}");
        }
        assert!(!is_of_format(&png::encode_rgb(1, 1, &[0; 3]), "jpg"));
    }
}
