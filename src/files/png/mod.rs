//! Encodes the PNG files of a sample: 8-bit RGB, 8-bit grey and 16-bit grey. Reads PNG files, too.

use png::{BitDepth, ColorType};
#[cfg(feature = "formats")]
use png::{Compression, Encoder, Filter};

use encode::encode;

use gelsim_core::camera::Image;

#[cfg(feature = "formats")]
mod decode;
mod encode;

#[cfg(feature = "formats")]
pub use decode::{decode, decode_grey16, decode_heights, decode_steps, read_header};

/// Encodes row-major 8-bit RGB.
pub fn encode_rgb(width: usize, height: usize, rgb: &[u8]) -> Vec<u8> {
    encode([width, height], rgb, ColorType::Rgb, BitDepth::Eight)
}

/// Encodes row-major 8-bit grey.
pub fn encode_grey(width: usize, height: usize, grey: &[u8]) -> Vec<u8> {
    encode([width, height], grey, ColorType::Grayscale, BitDepth::Eight)
}

/// Encodes row-major 16-bit grey.
pub fn encode_grey16(width: usize, height: usize, grey: &[u16]) -> Vec<u8> {
    let bytes: Vec<u8> = grey.iter().flat_map(|value| value.to_be_bytes()).collect();
    encode([width, height], &bytes, ColorType::Grayscale, BitDepth::Sixteen)
}

/// Encodes row-major lengths in mm as 16-bit grey in whole steps, of which `zero` stands for 0 mm. The largest error is
/// half a step. Lengths beyond become the first or last step; the first step is 1 if `zero` is above 0. What is not
/// finite becomes 0.
pub fn encode_steps(width: usize, height: usize, lengths_mm: &[f32], mm_per_step: f64, zero: f64) -> Vec<u8> {
    let lowest = i32::from(zero > 0.0);
    let step = |mm: f32| match mm.is_finite() {
        // Round to the nearest step. The cast truncates towards 0, but what is below the lowest step is clamped anyway.
        true => ((f64::from(mm) / mm_per_step + zero + 0.5) as i32).clamp(lowest, i32::from(u16::MAX)) as u16,
        false => 0,
    };
    let values: Vec<u16> = lengths_mm.iter().map(|mm| step(*mm)).collect();
    encode_grey16(width, height, &values)
}

/// Encodes an image for people to look at: slowly, and as small as possible.
#[cfg(feature = "formats")]
pub fn encode_small(picture: &image::RgbImage) -> Vec<u8> {
    let mut bytes = Vec::new();
    let mut encoder = Encoder::new(&mut bytes, picture.width(), picture.height());
    encoder.set_color(ColorType::Rgb);
    encoder.set_depth(BitDepth::Eight);
    encoder.set_compression(Compression::High);
    encoder.set_filter(Filter::Adaptive);
    let written = encoder.write_header().and_then(|mut writer| writer.write_image_data(picture));
    written.expect("writing to memory, with as many bytes as width and height say");
    bytes
}

/// Encodes an image of a simulator with the same bytes as in a dataset.
pub fn encode_image(image: &Image) -> Vec<u8> {
    encode_rgb(image.width, image.height, &image.rgb)
}
