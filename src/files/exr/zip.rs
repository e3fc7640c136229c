//! ZIP blocks: what OpenEXR deflates, quickly.
//!
//! The format takes 16 rows at a time, sets the even bytes of all values before the odd ones, and tells the difference of
//! each to the one before. Odd bytes, the high ones of a half, hardly change; even ones do: each kind gets codes of its own.

use std::cell::RefCell;
use std::ops::Range;

use half::f16;
use half::slice::HalfFloatSliceExt;

use super::{Lines, Pixel};
use crate::deflate::{Codes, Finder, Histogram, Zlib};
use gelsim_core::base::simd::simd_dispatch;

/// Rows in a block, by the format.
pub const ROWS: usize = 16;
/// How the format tells that a byte is the one before.
const SAME: u8 = 128;

/// What a thread needs for a block; made anew each time, clearing its pages would take as long as the block.
#[derive(Default)]
struct Scratch {
    halves: Vec<f16>,
    ordered: Vec<u8>,
    filtered: Vec<u8>,
    finder: Finder,
    out: Vec<u8>,
}

thread_local! {
    static SCRATCH: RefCell<Scratch> = RefCell::default();
}

/// Gives `write` number and bytes of each block from the top.
pub fn blocks<E>(lines: &Lines, mut write: impl FnMut(usize, Vec<u8>) -> Result<(), E>) -> Result<(), E> {
    SCRATCH.with_borrow_mut(|scratch| {
        for (number, top) in (0..lines.height).step_by(ROWS).enumerate() {
            let rows = top..lines.height.min(top + ROWS);
            scratch.filter(lines, rows.clone());
            scratch.deflate();
            // By the format, a block that packing does not make smaller is stored as it is.
            let smaller = scratch.out.len() < scratch.filtered.len();
            write(number, if smaller { scratch.out.clone() } else { lines.pack(rows) })?;
        }
        Ok(())
    })
}

impl Scratch {
    /// Filters rows: the differences of the even bytes, and then of the odd ones.
    fn filter(&mut self, lines: &Lines, rows: Range<usize>) {
        let half = rows.len() * lines.width * lines.planes.len() * lines.pixel.bytes() / 2;
        self.ordered.resize(2 * half, 0);
        self.filtered.resize(2 * half, 0);
        self.halves.resize(lines.width, f16::ZERO);
        let (even, odd) = self.ordered.split_at_mut(half);
        let of_line = (lines.width * lines.pixel.bytes() / 2).max(1);
        let ordered = even.chunks_exact_mut(of_line).zip(odd.chunks_exact_mut(of_line));
        for (line, (even, odd)) in lines.of(rows).zip(ordered) {
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
                        *difference = pair[1].wrapping_sub(pair[0]).wrapping_add(SAME);
                    }
                },
            );
        }
    }

    /// Packs what was filtered last into `out`.
    fn deflate(&mut self) {
        let (even, odd) = self.filtered.split_at(self.filtered.len() / 2);
        let mut stream = Zlib::new(&mut self.out);
        for (bytes, last) in [(even, false), (odd, true)] {
            let found = self.finder.find(bytes);
            let mut histogram = Histogram::new();
            histogram.add(&found);
            let codes = Codes::of(&histogram);
            stream.begin(&codes, last);
            stream.write(&codes, &found);
            stream.end(&codes);
        }
        stream.finish();
    }
}
