//! Decodes float layers from any format in which they are written: the inverse of [`super::encode`].

use super::archive::SampleFiles;
use gelsim_core::base::grid::Grid;
use gelsim_files::exr::{self, ImagePlanes};
use gelsim_files::npy::{self, NumberArray};
use gelsim_job::layers::{DepthFormat, LayerCoding, OutputLayer};
use gelsim_job::steps::Steps;

/// Decodes a float layer. `steps` are those of the label.
pub fn decode_planes(
    layer: OutputLayer,
    coding: LayerCoding,
    bytes: &[u8],
    steps: &Steps,
) -> Result<ImagePlanes, String> {
    match coding {
        LayerCoding::Exr => exr::decode_planes(bytes),
        LayerCoding::Npy => split_channels(layer.channels(), npy::decode_numbers(bytes)?),
        LayerCoding::Png16(scale) => {
            let Grid { width, height, data } = steps.decode(scale, bytes)?;
            Ok(ImagePlanes { width, height, channels: vec![(layer.channels().concat(), data)] })
        }
        LayerCoding::Png | LayerCoding::Json => Err(String::from("no layer of floats")),
    }
}

/// Splits an array of rows and columns, with a third axis if there are several channels, into its channels.
fn split_channels(names: &[&str], NumberArray { shape, values }: NumberArray) -> Result<ImagePlanes, String> {
    let (height, width) = match *shape.as_slice() {
        [height, width] if names.len() == 1 => (height, width),
        [height, width, depth] if names.len() > 1 && depth == names.len() => (height, width),
        _ => return Err(format!("is of shape {shape:?}, not rows and columns of {} values", names.len())),
    };
    let plane = |k: usize| values.iter().skip(k).step_by(names.len()).map(|value| *value as f32).collect();
    let channels = names.iter().enumerate().map(|(k, name)| ((*name).to_owned(), plane(k))).collect();
    Ok(ImagePlanes { width, height, channels })
}

/// Decodes a float layer of a sample. `part` stands before its name in the file's name: the number of a frame, or a
/// finger, with a dot behind it. Returns `None` if the sample has no such layer.
pub fn decode_layer(
    files: &SampleFiles,
    part: &str,
    layer: OutputLayer,
    steps: &Steps,
) -> Result<Option<ImagePlanes>, String> {
    for format in DepthFormat::ALL {
        let suffix = format!("{part}{}", layer.file_suffix(format));
        let Some(bytes) = files.find_member(&suffix) else { continue };
        let read = decode_planes(layer, layer.coding_for(format), bytes, steps);
        let read = read.map_err(|reason| format!("{}.{suffix}: {reason}", files.key))?;
        let pixels = read.width * read.height;
        return match read.channels.iter().all(|(_, data)| data.len() == pixels) && pixels > 0 {
            true => Ok(Some(read)),
            false => Err(format!("{}.{suffix}: an image without pixels", files.key)),
        };
    }
    Ok(None)
}

#[cfg(test)]
mod tests {
    use super::*;
    use gelsim_files::exr::{Compression, Exr, Pixel};

    #[test]
    fn every_format_gives_the_same_planes() {
        let (width, height) = (5, 3);
        let plane = |k: usize| (0..width * height).map(|i| (i * 7 % 11 + k) as f32 * 0.125).collect::<Vec<f32>>();
        let planes_of: [Vec<f32>; 6] = std::array::from_fn(plane);
        let storage = Exr { pixel: Pixel::Float, compression: Compression::Zip };
        for layer in OutputLayer::ALL.into_iter().filter(|layer| !layer.channels().is_empty()) {
            let named: Vec<(&str, &[f32])> =
                layer.channels().iter().zip(&planes_of).map(|(name, plane)| (*name, plane.as_slice())).collect();
            let written: Vec<&[f32]> = named.iter().map(|(_, plane)| *plane).collect();
            let from_exr = exr::encode(width, height, &named, storage);
            let from_npy = npy::encode(width, height, &written);
            for (coding, bytes) in [(LayerCoding::Exr, from_exr), (LayerCoding::Npy, from_npy)] {
                let read =
                    decode_planes(layer, coding, &bytes, &Steps::default()).expect("what was written can be read");
                assert_eq!((read.width, read.height), (width, height));
                let read: Vec<(&str, &[f32])> =
                    read.channels.iter().map(|(name, plane)| (name.as_str(), plane.as_slice())).collect();
                assert_eq!(read, named, "{layer:?} {coding:?}");
            }
        }
        let three = npy::encode(width, height, &planes_of[..3].iter().map(Vec::as_slice).collect::<Vec<_>>());
        let refused = decode_planes(OutputLayer::Depth, LayerCoding::Npy, &three, &Steps::default()).err();
        assert_eq!(refused.as_deref(), Some("is of shape [3, 5, 3], not rows and columns of 1 values"));
        assert!(decode_planes(OutputLayer::Contact, LayerCoding::Png, b"", &Steps::default()).is_err());
    }
}
