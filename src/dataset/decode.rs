//! Float layers read back, whatever format they were written in: the inverse of [`super::encode`].

use super::archive::Files;
use gelsim_core::base::grid::Grid;
use gelsim_files::exr::{self, Planes};
use gelsim_files::npy::{self, Numbers};
use gelsim_job::layers::{Coding, DepthFormat, OutputLayer};
use gelsim_job::steps::Steps;

/// Decodes a float layer; `steps` are the label's.
pub fn planes(layer: OutputLayer, coding: Coding, bytes: &[u8], steps: &Steps) -> Result<Planes, String> {
    match coding {
        Coding::Exr => exr::planes(bytes),
        Coding::Npy => array(layer.channels(), npy::decode_numbers(bytes)?),
        Coding::Png16(scale) => {
            let Grid { width, height, data } = steps.decode(scale, bytes)?;
            Ok(Planes { width, height, channels: vec![(layer.channels().concat(), data)] })
        }
        Coding::Png | Coding::Json => Err(String::from("no layer of floats")),
    }
}

/// An array of rows and columns, with a third axis if there are several channels.
fn array(names: &[&str], Numbers { shape, values }: Numbers) -> Result<Planes, String> {
    let (height, width) = match *shape.as_slice() {
        [height, width] if names.len() == 1 => (height, width),
        [height, width, depth] if names.len() > 1 && depth == names.len() => (height, width),
        _ => return Err(format!("is of shape {shape:?}, not rows and columns of {} values", names.len())),
    };
    let plane = |k: usize| values.iter().skip(k).step_by(names.len()).map(|value| *value as f32).collect();
    let channels = names.iter().enumerate().map(|(k, name)| ((*name).to_owned(), plane(k))).collect();
    Ok(Planes { width, height, channels })
}

/// A float layer of a sample; `part` stands before its name, as a frame's number or a finger's name with a point behind it
/// do. `None` if it was written without it.
pub fn layer(files: &Files, part: &str, layer: OutputLayer, steps: &Steps) -> Result<Option<Planes>, String> {
    for format in DepthFormat::ALL {
        let suffix = format!("{part}{}", layer.suffix(format));
        let Some(bytes) = files.member(&suffix) else { continue };
        let read = planes(layer, layer.coding(format), bytes, steps);
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
            for (coding, bytes) in [(Coding::Exr, from_exr), (Coding::Npy, from_npy)] {
                let read = planes(layer, coding, &bytes, &Steps::default()).expect("what was written can be read");
                assert_eq!((read.width, read.height), (width, height));
                let read: Vec<(&str, &[f32])> =
                    read.channels.iter().map(|(name, plane)| (name.as_str(), plane.as_slice())).collect();
                assert_eq!(read, named, "{layer:?} {coding:?}");
            }
        }
        let three = npy::encode(width, height, &planes_of[..3].iter().map(Vec::as_slice).collect::<Vec<_>>());
        let refused = planes(OutputLayer::Depth, Coding::Npy, &three, &Steps::default()).err();
        assert_eq!(refused.as_deref(), Some("is of shape [3, 5, 3], not rows and columns of 1 values"));
        assert!(planes(OutputLayer::Contact, Coding::Png, b"", &Steps::default()).is_err());
    }
}
