//! Float layers read back, whatever format they were written in: the inverse of [`super::encode`].

use super::archive::Files;
use super::exr::{self, Planes};
use super::npy::{self, Numbers};
use super::png16::Steps;
use crate::config::output::{Coding, DepthFormat, Layer};
use crate::grid::Grid;

/// Names of a float layer's channels, in alphabetical order; none for the other layers.
pub fn channels(layer: Layer) -> &'static [&'static str] {
    match layer {
        Layer::Depth | Layer::Surface => &["Z"],
        Layer::Normal => &["X", "Y", "Z"],
        Layer::Pressure => &["P"],
        Layer::Contact | Layer::Markers | Layer::Reference => &[],
    }
}

/// Decodes a float layer; `steps` are the label's.
pub fn planes(layer: Layer, coding: Coding, bytes: &[u8], steps: &Steps) -> Result<Planes, String> {
    match coding {
        Coding::Exr => exr::planes(bytes),
        Coding::Npy => array(channels(layer), npy::decode_numbers(bytes)?),
        Coding::Png16 => {
            let Grid { width, height, data } = steps.decode(layer, bytes)?;
            Ok(Planes { width, height, channels: vec![(channels(layer).concat(), data)] })
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

/// The depth map of a sample, mm; `None` if it was written without it.
pub fn depth_mm(files: &Files, steps: &Steps) -> Result<Option<Grid<f32>>, String> {
    for format in DepthFormat::ALL {
        let suffix = Layer::Depth.suffix(format);
        let Some(bytes) = files.member(&suffix) else { continue };
        let planes = planes(Layer::Depth, Layer::Depth.coding(format), bytes, steps);
        let Planes { width, height, channels } =
            planes.map_err(|reason| format!("{}.{suffix}: {reason}", files.key))?;
        return match channels.into_iter().next() {
            Some((_, data)) if data.len() == width * height && !data.is_empty() => {
                Ok(Some(Grid { width, height, data }))
            }
            _ => Err(format!("{}.{suffix}: an image without pixels", files.key)),
        };
    }
    Ok(None)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::config::output::{Compression, Exr, Pixel};

    #[test]
    fn every_format_gives_the_same_planes() {
        let (width, height) = (5, 3);
        let plane = |k: usize| (0..width * height).map(|i| (i * 7 % 11 + k) as f32 * 0.125).collect::<Vec<f32>>();
        let planes_of = [plane(0), plane(1), plane(2)];
        let storage = Exr { pixel: Pixel::Float, compression: Compression::Zip };
        for layer in [Layer::Depth, Layer::Surface, Layer::Normal, Layer::Pressure] {
            let named: Vec<(&str, &[f32])> =
                channels(layer).iter().zip(&planes_of).map(|(name, plane)| (*name, plane.as_slice())).collect();
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
        let three = npy::encode(width, height, &planes_of.each_ref().map(Vec::as_slice));
        let refused = planes(Layer::Depth, Coding::Npy, &three, &Steps::default()).err();
        assert_eq!(refused.as_deref(), Some("is of shape [3, 5, 3], not rows and columns of 1 values"));
        assert!(planes(Layer::Contact, Coding::Png, b"", &Steps::default()).is_err());
    }
}
