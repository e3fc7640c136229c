//! Marks where an object may drop by a wall between two of the camera's pixels.
//!
//! This is a quick test of many pairs of pixels at once, before the exact one of
//! [`Step::between`](super::pixel_block::Step::between): that is above 0 for marked pairs alone. Most pixels at the border of
//! a contact, where the object merely ends its touch, have no mark.

use std::ops::Range;

use crate::base::grid::Grid;
use crate::base::simd::{larger, simd_dispatch};

/// Pixels that the test reads before a pair's first pixel, and from it on.
const BEFORE: usize = 2;
const FROM: usize = 4;

/// Marks of one row of blocks; memory for any of them.
#[derive(Default)]
pub struct WallMarks {
    /// Above 0 in the column of a pair's first pixel, for pairs along x, and in a pair's column, for pairs along y.
    along_x: Vec<u32>,
    along_y: Vec<u32>,
    /// A row with its end values repeated beyond both ends.
    padded: Vec<f32>,
}

impl WallMarks {
    /// Removes all marks; there are `width` columns.
    pub fn clear(&mut self, width: usize) {
        for marks in [&mut self.along_x, &mut self.along_y] {
            marks.clear();
            marks.resize(width, 0);
        }
    }

    /// Marks the pairs with a pixel in `rows`, between `columns`. Larger steps than `step_mm` are walls whatever surrounds
    /// them, along x and y.
    pub fn mark(&mut self, fine: &Grid<f32>, rows: Range<usize>, columns: Range<usize>, step_mm: [f32; 2]) {
        let Self { along_x, along_y, padded } = self;
        let (count, last) = (columns.len(), fine.height - 1);
        let (along_x, along_y) = (&mut along_x[columns.clone()], &mut along_y[columns.clone()]);
        for y in rows.clone() {
            padded.clear();
            let row = fine.row(y);
            let (start, end) = (columns.start as isize - BEFORE as isize, (columns.end + FROM) as isize);
            let inside = start.max(0) as usize..(end as usize).min(row.len());
            padded.resize((-start).max(0) as usize, row[0]);
            padded.extend_from_slice(&row[inside]);
            padded.resize(count + BEFORE + FROM, row[row.len() - 1]);
            let at: [&[f32]; BEFORE + FROM] = std::array::from_fn(|k| &padded[k..][..count]);
            mark_pairs(at, along_x, step_mm[0]);
        }
        for y in rows.start.saturating_sub(1)..rows.end.min(last) {
            let at: [&[f32]; BEFORE + FROM] =
                std::array::from_fn(|k| &fine.row((y + k).saturating_sub(BEFORE).min(last))[columns.clone()]);
            mark_pairs(at, along_y, step_mm[1]);
        }
    }

    /// Returns true if a pair along axis `k` is marked whose first pixel is in this column.
    pub fn is_marked(&self, column: usize, k: usize) -> bool {
        [&self.along_x, &self.along_y][k][column] > 0
    }

    /// Returns true if a pair with a pixel in these columns is marked.
    pub fn any(&self, columns: Range<usize>) -> bool {
        let before = columns.start.saturating_sub(1)..columns.end;
        self.along_x[before].iter().chain(&self.along_y[columns]).any(|mark| *mark > 0)
    }
}

/// Marks pairs of pixels, given two pixels before each pair, the pair, and two pixels beyond it.
fn mark_pairs(
    [earlier, before, here, next, beyond, farther]: [&[f32]; BEFORE + FROM],
    marks: &mut [u32],
    step_mm: f32,
) {
    simd_dispatch(
        #[inline(always)]
        move || {
            let pairs = here.iter().zip(next).zip(before.iter().zip(earlier)).zip(beyond.iter().zip(farther));
            for (mark, (((here, next), (before, earlier)), (beyond, farther))) in marks.iter_mut().zip(pairs) {
                let (here, next) = (larger(*here, 0.0), larger(*next, 0.0));
                let falls = here > next;
                let (upper, lower) = if falls { (here, next) } else { (next, here) };
                let inner = larger(if falls { *before } else { *beyond }, 0.0);
                let innermost = larger(if falls { *earlier } else { *farther }, 0.0);
                // The object if it went on by its slope and curvature.
                let ahead = 3.0 * (upper - inner) + innermost;
                let ahead = if ahead < upper { ahead } else { upper };
                *mark |= u32::from((upper - lower > step_mm) | (2.0 * (ahead - lower) > upper));
            }
        },
    );
}
