//! Encodes PNG quickly: each row as its difference from the row above, in Huffman codes that fit the image.

use std::cell::RefCell;

use png::{BitDepth, ColorType};

use crate::deflate::{Histogram, HuffmanCodes, ZeroRuns, ZlibWriter};

/// In larger images, one row out of this many is counted for the codes.
const COUNTED_ROW_STEP: usize = 4;
/// Up to this many rows, every row is counted.
const MAX_FULLY_COUNTED_ROWS: usize = 64;
/// The number of PNG's filter that subtracts the row above.
const UP_FILTER: u8 = 2;

/// Buffers of a thread. They are kept, since clearing the pages of new ones would take as long as encoding an image.
#[derive(Default)]
struct Scratch {
    row: Vec<u8>,
    out: Vec<u8>,
}

thread_local! {
    static SCRATCH: RefCell<Scratch> = RefCell::default();
}

/// Encodes row-major pixels. Samples of two bytes have the high byte first.
pub fn encode([width, height]: [usize; 2], pixels: &[u8], color: ColorType, depth: BitDepth) -> Vec<u8> {
    let of_row = width * color.samples() * if depth == BitDepth::Sixteen { 2 } else { 1 };
    assert_eq!(pixels.len(), of_row * height, "{width}x{height} pixels");
    SCRATCH.with_borrow_mut(|scratch| {
        let Scratch { row, out } = scratch;
        row.resize(of_row + 1, UP_FILTER);
        row[0] = UP_FILTER;
        let step = if height <= MAX_FULLY_COUNTED_ROWS { 1 } else { COUNTED_ROW_STEP };
        let mut histogram = Histogram::new();
        for y in (0..height).step_by(step) {
            apply_up_filter(pixels, of_row, y, &mut row[1..]);
            histogram.count_tokens(&ZeroRuns(row));
        }

        let head =
            [&(width as u32).to_be_bytes()[..], &(height as u32).to_be_bytes(), &[depth as u8, color as u8, 0, 0, 0]];
        let mut bytes = Vec::from(*b"\x89PNG\r\n\x1a\n");
        append_chunk(&mut bytes, *b"IHDR", &head.concat());
        let codes = HuffmanCodes::from_estimate(&histogram);
        let mut stream = ZlibWriter::new(out);
        stream.begin_block(&codes, true);
        for y in 0..height {
            apply_up_filter(pixels, of_row, y, &mut row[1..]);
            stream.write(&codes, &ZeroRuns(row));
        }
        stream.end_block(&codes);
        stream.finish();
        bytes.reserve_exact(out.len() + 24);
        append_chunk(&mut bytes, *b"IDAT", out);
        append_chunk(&mut bytes, *b"IEND", &[]);
        bytes
    })
}

/// Writes the differences of row `y` from the row above to `out`.
fn apply_up_filter(pixels: &[u8], of_row: usize, y: usize, out: &mut [u8]) {
    let row = &pixels[y * of_row..][..of_row];
    match y.checked_sub(1) {
        None => out.copy_from_slice(row),
        Some(above) => {
            let above = &pixels[above * of_row..][..of_row];
            for ((out, here), above) in out.iter_mut().zip(row).zip(above) {
                *out = here.wrapping_sub(*above);
            }
        }
    }
}

/// Appends a chunk: length, kind, content, checksum.
fn append_chunk(bytes: &mut Vec<u8>, kind: [u8; 4], content: &[u8]) {
    bytes.extend((content.len() as u32).to_be_bytes());
    let from = bytes.len();
    bytes.extend(kind);
    bytes.extend(content);
    // The checksum covers the kind and the content.
    let sum = crc32fast::hash(&bytes[from..]);
    bytes.extend(sum.to_be_bytes());
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    /// What the `png` crate reads.
    fn decoded(bytes: &[u8]) -> (Vec<u8>, png::OutputInfo) {
        let mut reader = png::Decoder::new(std::io::Cursor::new(bytes)).read_info().expect("a PNG");
        let mut pixels = vec![0; reader.output_buffer_size().expect("a size")];
        let info = reader.next_frame(&mut pixels).expect("a picture");
        (pixels, info)
    }

    fn check(size: [usize; 2], pixels: &[u8], color: ColorType, depth: BitDepth) {
        let bytes = encode(size, pixels, color, depth);
        let (found, info) = decoded(&bytes);
        assert!(found == pixels, "{size:?} {color:?} {depth:?}");
        assert_eq!([info.width as usize, info.height as usize], size);
        assert_eq!((info.color_type, info.bit_depth), (color, depth));
        assert_eq!(encode(size, pixels, color, depth), bytes, "what a buffer held before changes nothing");
    }

    proptest! {
        #[test]
        fn any_picture_comes_back(
            width in 1..70_usize,
            height in 1..90_usize,
            kind in 0..6_usize,
            seed in any::<u64>(),
            form in 0..3_usize,
        ) {
            let (color, depth, bytes) = [
                (ColorType::Rgb, BitDepth::Eight, 3),
                (ColorType::Grayscale, BitDepth::Eight, 1),
                (ColorType::Grayscale, BitDepth::Sixteen, 2),
            ][form];
            let mut state = seed;
            let mut random = || {
                state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
                (state >> 56) as u8
            };
            let pixels: Vec<u8> = (0..width * height * bytes).map(|k| match kind {
                0 => 0,
                1 => 255,
                2 => random(),
                3 => random() & 1,
                4 => if random() == 0 { random() } else { 7 },
                _ => (k / 300) as u8,
            }).collect();
            check([width, height], &pixels, color, depth);
        }
    }

    #[test]
    fn a_large_picture_after_a_small_one_and_back() {
        for width in [4, 1000, 4] {
            let pixels: Vec<u8> = (0..width * 500 * 3).map(|k| (k * k / 977) as u8).collect();
            check([width, 500], &pixels, ColorType::Rgb, BitDepth::Eight);
        }
    }
}
