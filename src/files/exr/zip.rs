//! Writes the ZIP blocks of OpenEXR files.
//!
//! The format takes 16 rows at a time, puts the even bytes of all values before the odd ones, and stores the difference
//! of each byte from the one before. Odd bytes, the high ones of a half, hardly change, and even ones do: each kind
//! gets Huffman codes of its own.

use std::cell::RefCell;
use std::ops::Range;

use half::f16;
use half::slice::HalfFloatSliceExt;

use super::{Pixel, ScanLines};
use crate::deflate::{Histogram, HuffmanCodes, MatchFinder, ZlibWriter};
use gelsim_core::base::simd::simd_dispatch;

/// Rows in a block, by the format.
pub const ROWS_PER_BLOCK: usize = 16;
/// Offset that the format adds to a difference: an equal byte is stored as this.
const DELTA_BIAS: u8 = 128;

/// Buffers of a thread. They are kept, since clearing the pages of new ones would take as long as packing a block.
#[derive(Default)]
struct Scratch {
    halves: Vec<f16>,
    ordered: Vec<u8>,
    filtered: Vec<u8>,
    finder: MatchFinder,
    out: Vec<u8>,
}

thread_local! {
    static SCRATCH: RefCell<Scratch> = RefCell::default();
}

/// Calls `write` with the number and the bytes of each block, from the top.
pub fn write_blocks<E>(lines: &ScanLines, mut write: impl FnMut(usize, Vec<u8>) -> Result<(), E>) -> Result<(), E> {
    SCRATCH.with_borrow_mut(|scratch| {
        for (number, top) in (0..lines.height).step_by(ROWS_PER_BLOCK).enumerate() {
            let rows = top..lines.height.min(top + ROWS_PER_BLOCK);
            scratch.filter_rows(lines, rows.clone());
            scratch.deflate();
            // By the format, a block that packing does not make smaller is stored unpacked.
            let smaller = scratch.out.len() < scratch.filtered.len();
            write(number, if smaller { scratch.out.clone() } else { lines.pack_rows(rows) })?;
        }
        Ok(())
    })
}

impl Scratch {
    /// Reorders and filters rows: first the differences of the even bytes, then those of the odd ones.
    fn filter_rows(&mut self, lines: &ScanLines, rows: Range<usize>) {
        let half = rows.len() * lines.width * lines.planes.len() * lines.pixel.bytes_per_value() / 2;
        self.ordered.resize(2 * half, 0);
        self.filtered.resize(2 * half, 0);
        self.halves.resize(lines.width, f16::ZERO);
        let (even, odd) = self.ordered.split_at_mut(half);
        let of_line = (lines.width * lines.pixel.bytes_per_value() / 2).max(1);
        let ordered = even.chunks_exact_mut(of_line).zip(odd.chunks_exact_mut(of_line));
        for (line, (even, odd)) in lines.iter_lines(rows).zip(ordered) {
            match lines.pixel {
                Pixel::Half => {
                    self.halves.convert_from_f32_slice(line);
                    let halves = self.halves.as_slice();
                    simd_dispatch(
                        #[inline(always)]
                        move || {
                            for ((even, odd), half) in even.iter_mut().zip(odd).zip(halves) {
                                [*even, *odd] = half.to_le_bytes();
                            }
                        },
                    );
                }
                Pixel::Float => {
                    let pairs = even.as_chunks_mut::<2>().0.iter_mut().zip(odd.as_chunks_mut::<2>().0);
                    for ((even, odd), value) in pairs.zip(line) {
                        [even[0], odd[0], even[1], odd[1]] = value.to_le_bytes();
                    }
                }
            }
        }
        let (ordered, filtered) = (self.ordered.as_slice(), self.filtered.as_mut_slice());
        if let ([first, ..], [difference, rest @ ..]) = (ordered, filtered) {
            *difference = *first;
            simd_dispatch(
                #[inline(always)]
                move || {
                    for (difference, pair) in rest.iter_mut().zip(ordered.windows(2)) {
                        *difference = pair[1].wrapping_sub(pair[0]).wrapping_add(DELTA_BIAS);
                    }
                },
            );
        }
    }

    /// Packs the rows that were filtered last into `out`.
    fn deflate(&mut self) {
        let (even, odd) = self.filtered.split_at(self.filtered.len() / 2);
        let mut stream = ZlibWriter::new(&mut self.out);
        for (bytes, last) in [(even, false), (odd, true)] {
            let found = self.finder.find_matches(bytes);
            let mut histogram = Histogram::new();
            histogram.count_tokens(&found);
            let codes = HuffmanCodes::from_histogram(&histogram);
            stream.begin_block(&codes, last);
            stream.write(&codes, &found);
            stream.end_block(&codes);
        }
        stream.finish();
    }
}
