//! One depth frame as a camera left it: NumPy array, EXR picture or 16-bit grey PNG, told apart by how it begins.
//!
//! Values are taken as they are, in double precision: a distance of 10 m in float32 has steps of a micrometre already,
//! and nothing is to be added to that.

use std::path::Path;

use crate::core::base::grid::Grid;
use crate::files::input;
use crate::files::{exr, npy, png, unpack};
use crate::job::steps;

/// Ends of the names of files that can be read.
pub const ENDINGS: [&str; 3] = ["npy", "exr", "png"];

/// Reads the frame in the file at `path`. On failure, what is wrong with it.
pub fn file(path: &Path) -> Result<Grid<f64>, String> {
    decode(&input::read(path, input::MOST_IMAGE_BYTES).map_err(|error| error.to_string())?)
}

/// Decodes a frame of 1 to 8192 px on a side; values are in the camera's unit, and may be anything.
pub fn decode(bytes: &[u8]) -> Result<Grid<f64>, String> {
    match bytes {
        [0x93, b'N', b'U', b'M', b'P', b'Y', ..] => array(bytes),
        [0x76, 0x2f, 0x31, 0x01, ..] => channel(bytes),
        [0x89, b'P', b'N', b'G', ..] => grey(bytes),
        _ => Err(String::from("it begins neither like an npy nor like an EXR or a PNG file")),
    }
}

/// Rows and columns; a third axis of size 1 is none.
fn array(bytes: &[u8]) -> Result<Grid<f64>, String> {
    let npy::Numbers { shape, values } = npy::decode_numbers(bytes)?;
    let [width, height] = size(&shape)?;
    Ok(Grid { width, height, data: values })
}

/// Width and height of the frame in an array of this shape.
pub fn size(shape: &[usize]) -> Result<[usize; 2], String> {
    let &([height, width] | [height, width, 1]) = shape else {
        return Err(format!(
            "its array is of shape {shape:?}; a depth frame has rows and columns: (H, W) or (H, W, 1)"
        ));
    };
    crate::core::base::view::sides([width, height])?;
    Ok([width, height])
}

/// The channel Z, or the only one.
fn channel(bytes: &[u8]) -> Result<Grid<f64>, String> {
    let (size, names) = exr::header(bytes)?;
    let Some(at) = names.iter().position(|name| name == "Z").or((names.len() == 1).then_some(0)) else {
        return Err(format!("none of its channels ({}) is called Z, and there are several", names.join(", ")));
    };
    // A sample of up to 4 bytes, and the same as f32 and as f64.
    unpack::check(size, 16 * names.len(), bytes.len())?;
    let exr::Planes { width, height, channels } = exr::planes(bytes)?;
    match channels.into_iter().nth(at) {
        Some((_, data)) if data.len() == width * height => {
            Ok(Grid { width, height, data: data.into_iter().map(f64::from).collect() })
        }
        _ => Err(String::from("an image without pixels")),
    }
}

fn grey(bytes: &[u8]) -> Result<Grid<f64>, String> {
    let (size, pixel) = png::header(bytes)?;
    unpack::check(size, pixel.bytes_per_pixel() as usize + 8, bytes.len())?;
    let Grid { width, height, data } = steps::values(bytes)?;
    Ok(Grid { width, height, data: data.into_iter().map(f64::from).collect() })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::files::exr::{Compression, Exr, Pixel};

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
        assert_eq!(decode(&npy("<f8", "False", "(2, 3)", doubles.as_flattened())), expected);
        assert_eq!(decode(&npy("<f8", "False", "(2, 3, 1)", doubles.as_flattened())), expected);
        assert_eq!(decode(&npy("<f4", "True", "(2, 3)", columns.as_flattened())), expected);
        let storage = Exr { pixel: Pixel::Float, compression: Compression::Zip };
        assert_eq!(decode(&exr::encode(3, 2, &[("depth", &singles)], storage)), expected);
        assert_eq!(decode(&exr::encode(3, 2, &[("A", &[1.0; 6]), ("Z", &singles)], storage)), expected);
        assert_eq!(decode(&png::encode_grey16(3, 2, &values.map(|value| value as u16))), expected);
    }

    #[test]
    fn double_precision_is_kept_and_what_is_no_frame_is_refused_in_words() {
        let ten_metres = 10_000.000_123_f64;
        let read = decode(&npy("<f8", "False", "(1, 1)", &ten_metres.to_le_bytes()));
        assert_eq!(read.map(|grid| grid.data), Ok(vec![ten_metres]));
        let refused = decode(&npy("<f4", "False", "(1, 1, 3)", &[0; 12])).unwrap_err();
        assert!(refused.contains("[1, 1, 3]") && refused.contains("(H, W)"), "{refused}");
        let storage = Exr { pixel: Pixel::Float, compression: Compression::None };
        let refused = decode(&exr::encode(1, 1, &[("R", &[0.0]), ("Y", &[0.0])], storage)).unwrap_err();
        assert!(refused.contains("R, Y"), "{refused}");
        assert!(decode(&png::encode_grey(1, 1, &[7])).unwrap_err().contains("16"));
        assert!(decode(&npy("<f4", "False", "(0, 4)", &[])).unwrap_err().contains("4x0 px"));
        assert!(decode(b"P5 1 1 255 0").is_err());
    }
}
