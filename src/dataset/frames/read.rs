//! Reads a depth frame as a camera wrote it: a NumPy array (alone or in an archive), an EXR image or a 16-bit grey PNG,
//! told apart by their first bytes.
//!
//! Values are kept in double precision, since a distance of 10 m in float32 already has steps of a micrometre and
//! should not lose more.

use std::path::Path;

use gelsim_core::base::grid::Grid;
use gelsim_files::input;
use gelsim_files::npz::Npz;
use gelsim_files::{exr, foreign, npy, png, size_limits};

/// File extensions of frames that can be read.
pub const FRAME_EXTENSIONS: [&str; 4] = ["npy", "npz", "exr", "png"];

/// Splits a path such as `frame.npz/left` into the archive and the name of the array in it. Returns `None` for any
/// other path.
pub fn split_archive_path(path: &Path) -> Option<(&Path, &str)> {
    let archive = path.parent()?;
    let is_archive = archive.extension().is_some_and(|ending| ending.eq_ignore_ascii_case("npz")) && !archive.is_dir();
    Some((archive, path.file_name()?.to_str()?)).filter(|_| is_archive)
}

/// Reads the frame in the file at `path`, or in an archive there. The error says what is wrong with it.
pub fn read_frame(path: &Path) -> Result<Grid<f64>, String> {
    if let Some((archive, name)) = split_archive_path(path) {
        return read_named_array(&Npz::read(archive)?, name);
    }
    decode_frame(&input::read(path, input::MAX_IMAGE_BYTES).map_err(|error| error.to_string())?)
}

/// Decodes a frame of 1 to 8192 px on a side. Values are in the camera's unit and may be anything.
pub fn decode_frame(bytes: &[u8]) -> Result<Grid<f64>, String> {
    match bytes {
        [0x93, b'N', b'U', b'M', b'P', b'Y', ..] => decode_array(bytes),
        [0x76, 0x2f, 0x31, 0x01, ..] => decode_exr_depth(bytes),
        [0x89, b'P', b'N', b'G', ..] => decode_grey_depth(bytes),
        [b'P', b'K', 3, 4, ..] => extract_array(bytes),
        _ => Err(match foreign::identify_foreign_binary(bytes) {
            Some(foreign) => foreign.to_string(),
            None => String::from("it begins neither like an npy or npz nor like an EXR or a PNG file"),
        }),
    }
}

/// Extracts the array in an archive that is the frame.
fn extract_array(bytes: &[u8]) -> Result<Grid<f64>, String> {
    let archive = Npz::open(bytes.to_vec())?;
    let name = archive
        .find_default_array(&["depth", "z", "depth_map", "distance", "distance_to_image_plane"])
        .map_err(|reason| {
            let first = archive.names().next().unwrap_or("NAME").escape_debug();
            format!("{reason}: name the one that is meant behind the file, such as FILE.npz/{first}")
        })?;
    read_named_array(&archive, name)
}

fn read_named_array(archive: &Npz, name: &str) -> Result<Grid<f64>, String> {
    to_grid(archive.read_array(name)?).map_err(|reason| format!("array `{}`: {reason}", name.escape_debug()))
}

/// Decodes an array of rows and columns; a third axis of size 1 is ignored.
fn decode_array(bytes: &[u8]) -> Result<Grid<f64>, String> {
    to_grid(npy::decode_numbers(bytes)?)
}

fn to_grid(npy::NumberArray { shape, values }: npy::NumberArray) -> Result<Grid<f64>, String> {
    let [width, height] = frame_size(&shape)?;
    Ok(Grid { width, height, data: values })
}

/// Returns the width and height of a frame in an array of this shape. The error says which shapes are frames.
pub fn frame_size(shape: &[usize]) -> Result<[usize; 2], String> {
    let Some([width, height]) = npy::plane_size(shape) else {
        let many = match shape {
            [_, _, _] => {
                "; of several frames in one array each is a file of its own: numpy.save(f\"{i:05}.npy\", array[i])"
            }
            _ => "",
        };
        return Err(format!(
            "its array is of shape {shape:?}; a depth frame has rows and columns: (H, W) or (H, W, 1){many}"
        ));
    };
    gelsim_core::base::view::check_image_size([width, height])?;
    Ok([width, height])
}

/// Decodes the channel Z of an EXR image, or its only channel.
fn decode_exr_depth(bytes: &[u8]) -> Result<Grid<f64>, String> {
    let (size, names) = exr::read_header(bytes)?;
    let Some(at) = names.iter().position(|name| name == "Z").or((names.len() == 1).then_some(0)) else {
        return Err(format!("none of its channels ({}) is called Z, and there are several", names.join(", ")));
    };
    // A sample takes up to 4 bytes, and the same again as f32 and as f64.
    size_limits::check_image_bytes(size, 16 * names.len(), bytes.len())?;
    let exr::ImagePlanes { width, height, channels } = exr::decode_planes(bytes)?;
    match channels.into_iter().nth(at) {
        Some((_, data)) if data.len() == width * height => {
            Ok(Grid { width, height, data: data.into_iter().map(f64::from).collect() })
        }
        _ => Err(String::from("an image without pixels")),
    }
}

fn decode_grey_depth(bytes: &[u8]) -> Result<Grid<f64>, String> {
    let (size, pixel) = png::read_header(bytes)?;
    size_limits::check_image_bytes(size, pixel.bytes_per_pixel() as usize + 8, bytes.len())?;
    let Grid { width, height, data } = png::decode_grey16(bytes)?;
    Ok(Grid { width, height, data: data.into_iter().map(f64::from).collect() })
}

#[cfg(test)]
mod tests {
    use super::*;
    use gelsim_files::exr::{Compression, Exr, Pixel};
    use gelsim_files::zip::encode_stored;

    fn npy(descr: &str, is_fortran: &str, shape: &str, data: &[u8]) -> Vec<u8> {
        let text = format!("{{'descr': '{descr}', 'fortran_order': {is_fortran}, 'shape': {shape}, }}");
        let mut bytes = b"\x93NUMPY\x01\x00".to_vec();
        bytes.extend((text.len() as u16).to_le_bytes());
        bytes.extend(text.as_bytes());
        bytes.extend(data);
        bytes
    }

    #[test]
    fn the_same_frame_in_every_format_is_the_same() {
        let values = [9000.0, 9250.0, 10000.0, 11000.0, 65535.0, 0.0];
        let expected = Ok(Grid { width: 3, height: 2, data: values.to_vec() });
        let singles = values.map(|value| value as f32);
        let doubles = values.map(f64::to_le_bytes);
        let columns = [0, 3, 1, 4, 2, 5].map(|at| singles[at].to_le_bytes());
        assert_eq!(decode_frame(&npy("<f8", "False", "(2, 3)", doubles.as_flattened())), expected);
        assert_eq!(decode_frame(&npy("<f8", "False", "(2, 3, 1)", doubles.as_flattened())), expected);
        assert_eq!(decode_frame(&npy("<f4", "True", "(2, 3)", columns.as_flattened())), expected);
        let storage = Exr { pixel: Pixel::Float, compression: Compression::Zip };
        assert_eq!(decode_frame(&exr::encode(3, 2, &[("depth", &singles)], storage)), expected);
        assert_eq!(decode_frame(&exr::encode(3, 2, &[("A", &[1.0; 6]), ("Z", &singles)], storage)), expected);
        assert_eq!(decode_frame(&png::encode_grey16(3, 2, &values.map(|value| value as u16))), expected);
    }

    #[test]
    fn double_precision_is_kept_and_what_is_no_frame_is_refused_in_words() {
        let ten_metres = 10_000.000_123_f64;
        let read = decode_frame(&npy("<f8", "False", "(1, 1)", &ten_metres.to_le_bytes()));
        assert_eq!(read.map(|grid| grid.data), Ok(vec![ten_metres]));
        let refused = decode_frame(&npy("<f4", "False", "(2, 1, 3)", &[0; 24])).unwrap_err();
        assert!(refused.contains("[2, 1, 3]") && refused.contains("(H, W)"), "{refused}");
        assert!(refused.contains("numpy.save(f\"{i:05}.npy\", array[i])"), "{refused}");
        let storage = Exr { pixel: Pixel::Float, compression: Compression::None };
        let refused = decode_frame(&exr::encode(1, 1, &[("R", &[0.0]), ("Y", &[0.0])], storage)).unwrap_err();
        assert!(refused.contains("R, Y"), "{refused}");
        assert!(decode_frame(&png::encode_grey(1, 1, &[7])).unwrap_err().contains("16"));
        assert!(decode_frame(&npy("<f4", "False", "(0, 4)", &[])).unwrap_err().contains("4x0 px"));
        for (bytes, reason) in [
            (&b"P5 1 1 255 0"[..], "it is text"),
            (b"\xff\xd8\xff\xe0", "it is a JPEG picture"),
            (b"\x01\x02", "it begins neither like an npy or npz nor like an EXR or a PNG file"),
        ] {
            assert!(decode_frame(bytes).unwrap_err().starts_with(reason), "{reason}");
        }
        assert!(decode_frame(&npy("|b1", "False", "(1, 1)", &[1])).unwrap_err().contains("float16"));
    }

    #[test]
    fn the_frame_in_an_archive_is_its_only_array_or_the_one_that_is_called_depth_or_named() {
        let frame =
            npy("<f8", "False", "(2, 3)", [1.0, 2.0, 3.0, 4.0, 5.0, 6.0_f64].map(f64::to_le_bytes).as_flattened());
        let other = npy("<f8", "False", "(1, 1)", &0.0_f64.to_le_bytes());
        let expected = decode_frame(&frame);
        assert_eq!(decode_frame(&encode_stored(&[("arr_0.npy", &frame)])), expected);
        assert_eq!(decode_frame(&encode_stored(&[("rgb.npy", &other), ("Depth.npy", &frame)])), expected);
        assert_eq!(decode_frame(&encode_stored(&[("rgb.npy", &other), ("Z.npy", &frame)])), expected);
        let several = encode_stored(&[("left.npy", &frame), ("right.npy", &other)]);
        let refused = decode_frame(&several).unwrap_err();
        assert!(refused.starts_with("it holds 2 arrays, `left`, `right`, and none is called `depth`"), "{refused}");
        assert!(refused.ends_with("such as FILE.npz/left"), "{refused}");
        let folder = tempfile::tempdir().expect("a folder");
        let path = folder.path().join("FILE.npz");
        std::fs::write(&path, several).expect("a file");
        assert_eq!(read_frame(&path.join("left")), expected);
        assert!(read_frame(&path.join("none")).unwrap_err().contains("it has no array `none`, but `left`, `right`"));
        assert!(decode_frame(&encode_stored(&[])).unwrap_err().starts_with("it is an empty ZIP archive"));
    }
}
