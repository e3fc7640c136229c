//! OpenEXR files of a sample: float layers with named channels.

use std::io::Cursor;

use exr::prelude::{
    AnyChannel, AnyChannels, Blocks, Encoding, FlatSamples, Image, Layer, LayerAttributes, LineOrder, ReadChannels, ReadLayers,
    SmallVec,
    WritableImage, f16,
};

use crate::config::output::{Compression, Exr, Pixel};
use crate::grid::Grid;

/// Encodes planes of `width * height` values, each with its channel's name.
pub fn encode(width: usize, height: usize, planes: &[(&str, &[f32])], storage: Exr) -> Vec<u8> {
    let channels: SmallVec<[AnyChannel<FlatSamples>; 4]> = planes
        .iter()
        .map(|(name, plane)| {
            let samples = match storage.pixel {
                Pixel::Float => FlatSamples::F32(plane.to_vec()),
                Pixel::Half => FlatSamples::F16(plane.iter().map(|value| f16::from_f32(*value)).collect()),
            };
            AnyChannel::new(*name, samples)
        })
        .collect();
    let compression = match storage.compression {
        Compression::None => exr::compression::Compression::Uncompressed,
        Compression::Rle => exr::compression::Compression::RLE,
        Compression::Zip => exr::compression::Compression::ZIP16,
    };
    let encoding = Encoding { compression, blocks: Blocks::ScanLines, line_order: LineOrder::Increasing };
    let layer = Layer::new((width, height), LayerAttributes::default(), encoding, AnyChannels::sort(channels));
    let mut bytes = Cursor::new(Vec::new());
    Image::from_layer(layer)
        .write()
        .non_parallel()
        .to_unbuffered(&mut bytes)
        .expect("writing to memory, with as many values as width and height say");
    bytes.into_inner()
}

/// Decodes the first channel of an image.
pub fn decode(bytes: &[u8]) -> Result<Grid<f32>, String> {
    let image = exr::prelude::read()
        .no_deep_data()
        .largest_resolution_level()
        .all_channels()
        .first_valid_layer()
        .all_attributes()
        .non_parallel()
        .from_buffered(Cursor::new(bytes))
        .map_err(|error| error.to_string())?;
    let layer = &image.layer_data;
    let channel = layer.channel_data.list.first().ok_or("an image without channels")?;
    let data = channel.sample_data.values_as_f32().collect();
    Ok(Grid { width: layer.size.width(), height: layer.size.height(), data })
}
