//! Pictures that a user has: PNG, JPEG, BMP, TIFF or WebP, told by how they begin, whatever their names end in.

use std::io::{Cursor, Read, Seek, SeekFrom};
use std::path::Path;

use image::error::ImageError;
use image::{ColorType, DynamicImage, ImageDecoder, ImageFormat, ImageReader, RgbImage};

use super::{foreign, input, png, unpack};
use gelsim_core::base::view::{MOST_PX, sides};

/// Formats that are read, how their files begin, and the endings of their names.
const FORMATS: [(ImageFormat, &str, &[&str]); 5] = [
    (ImageFormat::Png, "PNG", &["png"]),
    (ImageFormat::Jpeg, "JPEG", &["jpg", "jpeg", "jpe"]),
    (ImageFormat::Bmp, "BMP", &["bmp"]),
    (ImageFormat::Tiff, "TIFF", &["tif", "tiff"]),
    (ImageFormat::WebP, "WebP", &["webp"]),
];

/// As messages name them.
pub const NAMES: &str = "PNG, JPEG, BMP, TIFF or WebP";

/// Bytes of a file that tell its format.
const HEAD: usize = 64;

/// True if a file is named like a picture.
pub fn is_named_like_one(path: &Path) -> bool {
    let ending = path.extension().and_then(|ending| ending.to_str()).map(str::to_ascii_lowercase);
    ending.is_some_and(|ending| FORMATS.iter().any(|(_, _, endings)| endings.contains(&ending.as_str())))
}

/// The format of a file that begins so; an error says what it is instead.
fn format(bytes: &[u8]) -> Result<(ImageFormat, &'static str), String> {
    let format = match bytes {
        [0x89, b'P', b'N', b'G', b'\r', b'\n', 0x1a, b'\n', ..] => ImageFormat::Png,
        [0xff, 0xd8, 0xff, ..] => ImageFormat::Jpeg,
        [b'B', b'M', _, _, _, _, 0, 0, 0, 0, ..] => ImageFormat::Bmp,
        [b'I', b'I', 42, 0, ..] | [b'M', b'M', 0, 42, ..] => ImageFormat::Tiff,
        [b'R', b'I', b'F', b'F', _, _, _, _, b'W', b'E', b'B', b'P', ..] => ImageFormat::WebP,
        _ => {
            return Err(match foreign::recognise_in_binary(bytes) {
                Some(foreign) => foreign.to_string(),
                None => format!("it does not begin like a picture ({NAMES})"),
            });
        }
    };
    let (_, name, _) = FORMATS.iter().find(|(known, ..)| *known == format).expect("one of them");
    Ok((format, name))
}

/// The ending that the format of these bytes has in names of files, without a point.
pub fn ending(bytes: &[u8]) -> Option<&'static str> {
    let (found, _) = format(bytes).ok()?;
    FORMATS.iter().find(|(format, ..)| *format == found).map(|(_, _, endings)| endings[0])
}

/// Decodes a picture of 1 to 8192 px on a side as it is. Refused if it would unpack to far more than its bytes.
pub fn decode(bytes: &[u8]) -> Result<DynamicImage, String> {
    let (format, name) = format(bytes)?;
    let (size, pixel) = header_of(bytes, format, name)?;
    unpack::check(size, pixel.bytes_per_pixel() as usize + 3, bytes.len())?;
    match format {
        ImageFormat::Png => png::decode(bytes),
        _ => reader(bytes, format).decode().map_err(|error| said(&error, name)),
    }
}

/// Decodes a picture to 8-bit RGB.
pub fn decode_rgb(bytes: &[u8]) -> Result<RgbImage, String> {
    decode(bytes).map(DynamicImage::into_rgb8)
}

/// Width, height and kind of pixel that a picture says it has.
pub fn header(bytes: &[u8]) -> Result<([usize; 2], ColorType), String> {
    let (format, name) = format(bytes)?;
    header_of(bytes, format, name)
}

fn header_of(bytes: &[u8], format: ImageFormat, name: &str) -> Result<([usize; 2], ColorType), String> {
    if format == ImageFormat::Png {
        return png::header(bytes);
    }
    let decoder = reader(bytes, format).into_decoder().map_err(|error| said(&error, name))?;
    let (width, height) = decoder.dimensions();
    let size = [width as usize, height as usize];
    sides(size)?;
    Ok((size, decoder.color_type()))
}

fn reader(bytes: &[u8], format: ImageFormat) -> ImageReader<Cursor<&[u8]>> {
    let mut reader = ImageReader::with_format(Cursor::new(bytes), format);
    let mut limits = image::Limits::default();
    limits.max_image_width = Some(MOST_PX as u32);
    limits.max_image_height = Some(MOST_PX as u32);
    limits.max_alloc = Some(1 << 30);
    reader.limits(limits);
    reader
}

/// Columns and rows of the picture in a file, and whether the file is complete as far as its ends tell. Its pixels are unpacked
/// later.
pub fn size_of_file(path: &Path) -> Result<[usize; 2], String> {
    let (mut file, length) = input::open(path).map_err(|error| error.to_string())?;
    let mut head = Vec::new();
    (&mut file).take(HEAD as u64).read_to_end(&mut head).map_err(|error| error.to_string())?;
    let (format, _) = format(&head)?;
    let mut tail = Vec::new();
    let ends = file
        .seek(SeekFrom::Start(length.saturating_sub(TAIL)))
        .and_then(|_| (&mut file).take(TAIL).read_to_end(&mut tail));
    ends.map_err(|error| error.to_string())?;
    match format {
        ImageFormat::Png => png_size(&head, &tail),
        // Where the size stands is not known beforehand.
        _ => size_of_bytes(&input::read(path, input::MOST_IMAGE_BYTES).map_err(|error| error.to_string())?),
    }
}

/// The same of a picture in memory.
pub fn size_of_bytes(bytes: &[u8]) -> Result<[usize; 2], String> {
    let (format, name) = format(bytes)?;
    let tail = &bytes[bytes.len().saturating_sub(TAIL as usize)..];
    match format {
        ImageFormat::Png => png_size(bytes, tail),
        ImageFormat::Jpeg if !tail.windows(2).any(|window| window == [0xff, 0xd9]) => {
            Err(String::from("it is cut off"))
        }
        _ => header_of(bytes, format, name).map(|(size, _)| size),
    }
}

/// The last chunk of a PNG is as long as 12 bytes, a JPEG's end marker 2; some programs put a few more behind it.
const TAIL: u64 = 64;

fn png_size(head: &[u8], tail: &[u8]) -> Result<[usize; 2], String> {
    if head.len() < 24 || !tail.windows(4).any(|window| window == b"IEND") {
        return Err(String::from("it is cut off"));
    }
    let number = |at: usize| u32::from_be_bytes([head[at], head[at + 1], head[at + 2], head[at + 3]]) as usize;
    let size = [number(16), number(20)];
    sides(size)?;
    Ok(size)
}

/// What an image library says, in a user's words.
pub(super) fn said(error: &ImageError, name: &str) -> String {
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
        // Why is said in the library's own terms, which help nobody.
        _ => format!("the {name} is damaged"),
    }
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
    fn every_format_is_read_by_its_bytes() {
        for (format, name, endings) in FORMATS {
            let bytes = encoded(format);
            assert_eq!(ending(&bytes), Some(endings[0]));
            assert_eq!(header(&bytes).map(|(size, _)| size), Ok([24, 16]), "{name}");
            assert_eq!(size_of_bytes(&bytes), Ok([24, 16]), "{name}");
            let read = decode_rgb(&bytes).unwrap_or_else(|error| panic!("{name}: {error}"));
            let [red, green, blue] = read.get_pixel(10, 8).0;
            assert!(
                red.abs_diff(100) < 9 && green.abs_diff(120) < 9 && blue.abs_diff(90) < 9,
                "{name}: {red} {green} {blue}"
            );
            // Its name says another format.
            let folder = tempfile::tempdir().expect("a folder");
            let path = folder.path().join("picture.gif");
            std::fs::write(&path, &bytes).expect("a file");
            assert_eq!(size_of_file(&path), Ok([24, 16]), "{name}");
        }
    }

    #[test]
    fn what_is_cut_damaged_or_no_picture_is_told_in_plain_words() {
        for (format, name, _) in FORMATS {
            let bytes = encoded(format);
            let cut = decode_rgb(&bytes[..bytes.len() / 2]);
            // JPEG and TIFF of one strip show what is there; none may bring the program down.
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
}
