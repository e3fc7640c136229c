//! Reads height maps that a job names: a grey PNG, a NumPy array (alone or in an archive) or an EXR image, told apart
//! by their first bytes.
//!
//! Heights are fractions, 0 for the lowest and 1 for the highest. Whole numbers are scaled by the largest that their
//! type holds; floats must lie in that range already.

use super::npz::Npz;
use super::{exr, foreign, npy, png};
use gelsim_core::base::grid::Grid;

/// Reads a height map of 1 to 8192 px on a side. Every value is from 0 to 1. The error is a reason with what to do.
pub fn decode_height_map(bytes: &[u8]) -> Result<Grid<f32>, String> {
    let heights = match bytes {
        [0x89, b'P', b'N', b'G', ..] => png::decode_heights(bytes),
        [0x93, b'N', b'U', b'M', b'P', b'Y', ..] => npy::decode_height_array(bytes).map(scale_to_unit_range),
        [0x76, 0x2f, 0x31, 0x01, ..] => exr::decode_single_channel(bytes),
        [b'P', b'K', 3, 4, ..] => extract_array(bytes).map(scale_to_unit_range),
        _ => Err(match foreign::identify_foreign_binary(bytes) {
            Some(foreign) => foreign.to_string(),
            None => String::from("it begins neither like a PNG nor like an npy, npz or EXR file"),
        }),
    }?;
    gelsim_core::base::view::check_image_size([heights.width, heights.height])?;
    match heights.data.iter().position(|height| !(0.0..=1.0).contains(height)) {
        None => Ok(heights),
        Some(at) => {
            let (row, column, value) = (at / heights.width, at % heights.width, heights.data[at]);
            Err(match value.is_finite() {
                true => format!(
                    "{value} in row {row}, column {column} is not from 0 to 1: scale the heights, such as h = (h - h.min()) / \
                     (h.max() - h.min()), and say how high that is"
                ),
                false => format!(
                    "{value} in row {row}, column {column} is no height: fill it, such as h = numpy.nan_to_num(h, posinf=0, \
                     neginf=0)"
                ),
            })
        }
    }
}

/// Extracts the array of heights from an archive of arrays.
fn extract_array(bytes: &[u8]) -> Result<npy::HeightArray, String> {
    /// Names that people give to the array.
    const USUAL_NAMES: [&str; 8] = ["height", "heights", "height_map", "heightmap", "depth", "z", "map", "arr_0"];
    let archive = Npz::open(bytes.to_vec())?;
    let name = archive.find_default_array(&USUAL_NAMES).map_err(|reason| {
        format!(
            "{reason}: save the one that is meant alone, numpy.save(\"map.npy\", numpy.load(\"FILE.npz\")[\"NAME\"])"
        )
    })?;
    npy::decode_height_array(&archive.unpack_file(name)?)
        .map_err(|reason| format!("array `{}`: {reason}", name.escape_debug()))
}

fn scale_to_unit_range(array: npy::HeightArray) -> Grid<f32> {
    let npy::HeightArray { mut values, max_value: most } = array;
    if let Some(most) = most {
        values.data.iter_mut().for_each(|value| *value /= most);
    }
    values
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::exr::{Compression, Exr, Pixel};
    use crate::zip::encode_stored;

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
        assert_eq!(decode_height_map(&png::encode_grey(2, 1, &[51, 255])), expected);
        assert_eq!(decode_height_map(&npy("|u1", &[51, 255])), expected);
        let npz = |members: &[&str]| {
            let (file, other) = (npy("|u1", &[51, 255]), npy("|u1", &[0, 0]));
            let bytes = |name: &str| if name.starts_with("other") { &other[..] } else { &file[..] };
            encode_stored(&members.iter().map(|name| (*name, bytes(name))).collect::<Vec<_>>())
        };
        assert_eq!(decode_height_map(&npz(&["any.npy"])), expected);
        assert_eq!(decode_height_map(&npz(&["other.npy", "Heights.npy"])), expected);
        let several = decode_height_map(&npz(&["other.npy", "a.npy"])).unwrap_err();
        assert!(several.starts_with("it holds 2 arrays, `other`, `a`, and none is called `height`: save"), "{several}");
        assert_eq!(decode_height_map(&npy("<u2", [13_107_u16, 65_535].map(u16::to_le_bytes).as_flattened())), expected);
        assert_eq!(decode_height_map(&npy("<f4", [0.2_f32, 1.0].map(f32::to_le_bytes).as_flattened())), expected);
        assert_eq!(decode_height_map(&npy(">f8", [0.2_f64, 1.0].map(f64::to_be_bytes).as_flattened())), expected);
        let storage = Exr { pixel: Pixel::Float, compression: Compression::Zip };
        assert_eq!(decode_height_map(&exr::encode(2, 1, &[("Y", &[0.2, 1.0])], storage)), expected);
    }

    #[test]
    fn floats_beyond_0_to_1_are_refused_and_not_clamped() {
        for bad in [-0.001_f32, 1.001, f32::NAN, f32::INFINITY] {
            let refused = decode_height_map(&npy("<f4", [0.5, bad].map(f32::to_le_bytes).as_flattened())).unwrap_err();
            let expected = match bad.is_finite() {
                true => "is not from 0 to 1: scale the heights, such as h = (h - h.min())",
                false => "is no height: fill it, such as h = numpy.nan_to_num(h",
            };
            assert!(refused.starts_with(&format!("{bad} in row 0, column 1 {expected}")), "{refused}");
        }
        let storage = Exr { pixel: Pixel::Half, compression: Compression::None };
        assert!(decode_height_map(&exr::encode(1, 1, &[("Y", &[2.0])], storage)).is_err());
        let two = exr::encode(1, 1, &[("A", &[0.5]), ("Y", &[0.5])], storage);
        assert!(decode_height_map(&two).unwrap_err().starts_with("it has 2 channels instead of one: save the one"));
        for (bytes, reason) in [
            (&b"P5 1 1 255 0"[..], "it is text"),
            (b"\xff\xd8\xff\xe0", "it is a JPEG picture"),
            (b"", "it is empty"),
            (b"\x01\x02", "it begins neither like a PNG nor like an npy, npz or EXR file"),
        ] {
            assert!(decode_height_map(bytes).unwrap_err().starts_with(reason), "{reason}");
        }
    }
}
