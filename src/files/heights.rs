//! Height maps that a job names: grey PNG, NumPy array, or EXR picture, told apart by how they begin.
//!
//! Heights are shares, 0 for the lowest and 1 for the highest. Whole numbers are scaled by the largest that their type
//! holds; floats must lie in that range as they are.

use super::{exr, npy, png};
use crate::core::base::grid::Grid;

/// Reads a height map of 1 to 8192 px on a side. Every value is from 0 to 1.
pub fn decode(bytes: &[u8]) -> Result<Grid<f32>, String> {
    let heights = match bytes {
        [0x89, b'P', b'N', b'G', ..] => png::decode_heights(bytes),
        [0x93, b'N', b'U', b'M', b'P', b'Y', ..] => npy::decode(bytes).map(scaled),
        [0x76, 0x2f, 0x31, 0x01, ..] => exr::decode_single(bytes),
        _ => Err(String::from("it begins neither like a PNG nor like an npy or an EXR file")),
    }?;
    crate::core::base::view::sides([heights.width, heights.height])?;
    match heights.data.iter().position(|height| !(0.0..=1.0).contains(height)) {
        None => Ok(heights),
        Some(at) => {
            let (row, column, value) = (at / heights.width, at % heights.width, heights.data[at]);
            Err(format!("{value} in row {row}, column {column} is not from 0 to 1: scale the heights"))
        }
    }
}

fn scaled(array: npy::Array) -> Grid<f32> {
    let npy::Array { mut values, most } = array;
    if let Some(most) = most {
        values.data.iter_mut().for_each(|value| *value /= most);
    }
    values
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::files::exr::{Compression, Exr, Pixel};

    fn npy(descr: &str, data: &[u8]) -> Vec<u8> {
        let text = format!("{{'descr': '{descr}', 'fortran_order': False, 'shape': (1, 2), }}");
        let mut bytes = b"\x93NUMPY\x01\x00".to_vec();
        bytes.extend((text.len() as u16).to_le_bytes());
        bytes.extend(text.as_bytes());
        bytes.extend(data);
        bytes
    }

    #[test]
    fn the_same_heights_in_every_format_are_the_same() {
        let expected = Ok(Grid { width: 2, height: 1, data: vec![0.2, 1.0] });
        assert_eq!(decode(&png::encode_grey(2, 1, &[51, 255])), expected);
        assert_eq!(decode(&npy("|u1", &[51, 255])), expected);
        assert_eq!(decode(&npy("<u2", [13_107_u16, 65_535].map(u16::to_le_bytes).as_flattened())), expected);
        assert_eq!(decode(&npy("<f4", [0.2_f32, 1.0].map(f32::to_le_bytes).as_flattened())), expected);
        assert_eq!(decode(&npy(">f8", [0.2_f64, 1.0].map(f64::to_be_bytes).as_flattened())), expected);
        let storage = Exr { pixel: Pixel::Float, compression: Compression::Zip };
        assert_eq!(decode(&exr::encode(2, 1, &[("Y", &[0.2, 1.0])], storage)), expected);
    }

    #[test]
    fn floats_beyond_0_to_1_are_refused_and_not_clamped() {
        for bad in [-0.001_f32, 1.001, f32::NAN, f32::INFINITY] {
            let refused = decode(&npy("<f4", [0.5, bad].map(f32::to_le_bytes).as_flattened())).unwrap_err();
            assert_eq!(refused, format!("{bad} in row 0, column 1 is not from 0 to 1: scale the heights"));
        }
        let storage = Exr { pixel: Pixel::Half, compression: Compression::None };
        assert!(decode(&exr::encode(1, 1, &[("Y", &[2.0])], storage)).is_err());
        let two = exr::encode(1, 1, &[("A", &[0.5]), ("Y", &[0.5])], storage);
        assert_eq!(decode(&two), Err(String::from("it has 2 channels instead of one")));
        assert!(decode(b"P5 1 1 255 0").is_err());
    }
}
