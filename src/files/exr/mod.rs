//! Writes and reads OpenEXR files: float layers with named channels.
//!
//! The `exr` crate does the file structure and all compressions but ZIP. ZIP blocks are packed here, since the crate's
//! fixed level of deflate would take longer than the rest of a sample.

use std::io::Cursor;
use std::ops::Range;

use exr::block::UncompressedBlock;
use exr::block::chunk::{Chunk, CompressedBlock, CompressedScanLineBlock};
use exr::block::writer::ChunksWriter;
use exr::meta::header::Header;
use exr::meta::{BlockDescription, MetaData};
use exr::prelude::{ChannelDescription, LineOrder, ReadChannels, ReadLayers, SampleType, SmallVec, Text, Vec2};
use half::f16;
use half::slice::HalfFloatSliceExt;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::size_limits;
use gelsim_core::base::grid::Grid;

mod zip;

/// Storage of EXR layers.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(default, deny_unknown_fields)]
pub struct Exr {
    /// Precision of a pixel.
    pub pixel: Pixel,
    /// Lossless compression.
    pub compression: Compression,
}

/// Precision of an EXR pixel.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum Pixel {
    /// 16 bits: at most 1 um of rounding below 4 mm.
    #[default]
    Half,
    /// 32 bits: every bit kept.
    Float,
}

impl Pixel {
    /// Returns the number of bytes per value.
    pub fn bytes_per_value(self) -> usize {
        match self {
            Self::Half => 2,
            Self::Float => 4,
        }
    }
}

/// Compression of an EXR file.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum Compression {
    /// No compression.
    None,
    /// Run lengths.
    Rle,
    /// Deflate over 16 rows: smallest, and as quick.
    #[default]
    Zip,
}

/// Encodes planes of `width * height` values, each with the name of its channel. The names must be in alphabetical
/// order.
pub fn encode(width: usize, height: usize, planes: &[(&str, &[f32])], storage: Exr) -> Vec<u8> {
    let sample_type = match storage.pixel {
        Pixel::Half => SampleType::F16,
        Pixel::Float => SampleType::F32,
    };
    let channels: SmallVec<[ChannelDescription; 5]> =
        planes.iter().map(|(name, _)| ChannelDescription::new(Text::from(*name), sample_type, false)).collect();
    let compression = match storage.compression {
        Compression::None => exr::compression::Compression::Uncompressed,
        Compression::Rle => exr::compression::Compression::RLE,
        Compression::Zip => exr::compression::Compression::ZIP16,
    };
    let header = Header::new(Text::from("layer"), (width, height), channels).with_encoding(
        compression,
        BlockDescription::ScanLines,
        LineOrder::Increasing,
    );
    let mut bytes = Cursor::new(Vec::new());
    let lines = ScanLines { width, height, planes, pixel: storage.pixel };
    exr::block::write(&mut bytes, SmallVec::from_elem(header, 1), false, |meta, writer| {
        if storage.compression == Compression::Zip {
            return zip::write_blocks(&lines, |number, compressed_pixels_le| {
                let y_coordinate = (number * zip::ROWS_PER_BLOCK) as i32;
                let block = CompressedScanLineBlock { y_coordinate, compressed_pixels_le };
                let compressed_block = CompressedBlock::ScanLine(block);
                writer.write_chunk(number, Chunk { layer_index: 0, compressed_block })
            });
        }
        let blocks = meta.collect_ordered_blocks(|index| UncompressedBlock {
            index,
            data: lines.pack_rows(index.pixel_position.y()..index.pixel_position.y() + index.pixel_size.height()),
        });
        let mut compressor = writer.sequential_blocks_compressor(&meta);
        for (number, block) in blocks {
            compressor.compress_block(number, block)?;
        }
        Ok(())
    })
    .expect("writing to memory, with as many values as width and height say");
    bytes.into_inner()
}

/// Values in the order of the format: row by row, and in each row channel by channel.
struct ScanLines<'a> {
    width: usize,
    height: usize,
    planes: &'a [(&'a str, &'a [f32])],
    pixel: Pixel,
}

impl ScanLines<'_> {
    /// Iterates over the lines of some rows: for each row one line per channel.
    fn iter_lines(&self, rows: Range<usize>) -> impl Iterator<Item = &[f32]> {
        rows.flat_map(move |y| self.planes.iter().map(move |(_, plane)| &plane[y * self.width..][..self.width]))
    }

    /// Returns the bytes of some rows, little endian.
    fn pack_rows(&self, rows: Range<usize>) -> Vec<u8> {
        let mut bytes = Vec::with_capacity(rows.len() * self.width * self.planes.len() * self.pixel.bytes_per_value());
        let mut halves = vec![f16::ZERO; self.width];
        for line in self.iter_lines(rows) {
            match self.pixel {
                Pixel::Half => {
                    halves.convert_from_f32_slice(line);
                    bytes.extend(halves.iter().flat_map(|value| value.to_le_bytes()));
                }
                Pixel::Float => bytes.extend(line.iter().flat_map(|value| value.to_le_bytes())),
            }
        }
        bytes
    }
}

/// The channels of an image.
pub struct ImagePlanes {
    /// Columns.
    pub width: usize,
    /// Rows.
    pub height: usize,
    /// Name and values, row by row, of each channel, in alphabetical order.
    pub channels: Vec<(String, Vec<f32>)>,
}

/// Decodes the first channel of an image, in alphabetical order.
pub fn decode_first_channel(bytes: &[u8]) -> Result<Grid<f32>, String> {
    let ImagePlanes { width, height, channels } = decode_planes(bytes)?;
    let (_, data) = channels.into_iter().next().ok_or("an image without channels")?;
    Ok(Grid { width, height, data })
}

/// Decodes an image of one channel that may come from anywhere. It is refused if it would unpack to far more than its
/// bytes.
pub fn decode_single_channel(bytes: &[u8]) -> Result<Grid<f32>, String> {
    let (size, names) = read_header(bytes)?;
    if names.len() != 1 {
        return Err(format!("it has {} channels instead of one: save the one that is meant alone", names.len()));
    }
    // A sample takes up to 4 bytes, and the same again as f32.
    size_limits::check_image_bytes(size, 8, bytes.len())?;
    decode_first_channel(bytes)
}

/// Decodes all channels of an image.
pub fn decode_planes(bytes: &[u8]) -> Result<ImagePlanes, String> {
    read_header(bytes)?;
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
    let values = |channel: &exr::prelude::AnyChannel<_>| {
        let data: &exr::prelude::FlatSamples = &channel.sample_data;
        (channel.name.to_string(), data.values_as_f32().collect())
    };
    let channels = layer.channel_data.list.iter().map(values).collect();
    Ok(ImagePlanes { width: layer.size.width(), height: layer.size.height(), channels })
}

/// Most bytes of a header. Its attributes take fifty times as much memory.
const MAX_HEADER_BYTES: usize = 1 << 20;
/// Largest side of a tile that is larger than its image, px. Memory is taken for the complete tile.
const MAX_TILE_PX: usize = 1024;
/// Most channels that an image may have.
const MAX_CHANNELS: usize = 6;

/// Reads the width, height and channel names from the header of an image. Refuses what [`decode_planes`] does not read:
/// more than one part, deep or subsampled data, more than 6 channels or 8192 px on a side, tiles far larger than the
/// image, and compression by B44 (the crate's arithmetic overflows on damaged blocks).
pub fn read_header(bytes: &[u8]) -> Result<([usize; 2], Vec<String>), String> {
    // No more than the largest header is read, so a longer one is an error.
    let start = &bytes[..bytes.len().min(MAX_HEADER_BYTES)];
    let meta = MetaData::read_from_buffered(Cursor::new(start), false).map_err(|error| error.to_string())?;
    let [header] = meta.headers.as_slice() else {
        return Err(format!("it has {} parts instead of one: save the one that is meant alone", meta.headers.len()));
    };
    let Vec2(width, height) = header.layer_size;
    let channels = &header.channels.list;
    if header.deep || channels.iter().any(|channel| channel.sampling != Vec2(1, 1)) {
        return Err(String::from("it has deep or subsampled data: save it flat, with all channels of one size"));
    }
    if matches!(header.compression, exr::compression::Compression::B44 | exr::compression::Compression::B44A) {
        return Err(String::from("it is compressed by B44: store it with ZIP"));
    }
    if channels.len() > MAX_CHANNELS {
        return Err(format!("it has {} channels; the most is {MAX_CHANNELS}", channels.len()));
    }
    if let BlockDescription::Tiles(tiles) = header.blocks
        && (tiles.tile_size.0 > width.max(MAX_TILE_PX) || tiles.tile_size.1 > height.max(MAX_TILE_PX))
    {
        return Err(String::from("its tiles are far larger than the image: save it in scan lines"));
    }
    gelsim_core::base::view::check_image_size([width, height])?;
    Ok(([width, height], channels.iter().map(|channel| channel.name.to_string()).collect()))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_storage_gives_back_what_went_in() {
        let (width, height) = (37, 41);
        let noisy: Vec<f32> = (0..width * height).map(|i| ((i * 2_654_435_761) % 4001) as f32 * 1e-3).collect();
        let blank = vec![0.0; width * height];
        let mut patch = blank.clone();
        patch[20 * width + 5] = 1.25;
        for plane in [noisy, blank, patch] {
            for pixel in [Pixel::Half, Pixel::Float] {
                for compression in [Compression::None, Compression::Rle, Compression::Zip] {
                    let bytes = encode(width, height, &[("Z", &plane)], Exr { pixel, compression });
                    let read = decode_first_channel(&bytes).expect("what was written can be read");
                    assert_eq!((read.width, read.height), (width, height));
                    // A half has 11 significant bits: below 4 mm that is at most 1 um of rounding.
                    let tolerance = if pixel == Pixel::Half { 1.0e-3 } else { 0.0 };
                    for (read, written) in read.data.iter().zip(&plane) {
                        assert!((read - written).abs() <= tolerance, "{pixel:?} {compression:?}: {read} {written}");
                    }
                }
            }
        }
    }

    #[test]
    fn planes_of_any_size_come_back() {
        let sizes = [(1, 1), (1, 16), (16, 1), (3, 17), (65, 33), (128, 48)];
        for ((width, height), count) in sizes.into_iter().flat_map(|size| [1, 2, 3].map(|count| (size, count))) {
            // Slopes, which repeat, and whole numbers, which do not; both precisions hold them exactly.
            let plane = |k: usize| -> Vec<f32> {
                (0..width * height).map(|at| [at % width, at / width * 3, (at * 7919) % 251][k] as f32).collect()
            };
            let planes: Vec<Vec<f32>> = (0..count).map(plane).collect();
            let named: Vec<(&str, &[f32])> =
                ["X", "Y", "Z"].into_iter().zip(planes.iter().map(Vec::as_slice)).collect();
            for pixel in [Pixel::Half, Pixel::Float] {
                let bytes = encode(width, height, &named, Exr { pixel, ..Exr::default() });
                let read = super::decode_planes(&bytes).expect("what was written can be read");
                assert_eq!((read.width, read.height), (width, height));
                assert!(
                    read.channels.iter().map(|(_, values)| values).eq(&planes),
                    "{width}x{height} {count} {pixel:?}"
                );
            }
        }
    }
}
