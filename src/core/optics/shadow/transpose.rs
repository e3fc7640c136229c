//! Images turned over their diagonal (transposed), so that a sweep along rows becomes one over rows.

use pulp::{Simd, WithSimd};

use crate::base::simd::{dispatch_kernel, transpose_8x8};

/// Transposes an image of `width` columns: `to` gets its columns as rows. Both hold the same number of values.
pub fn transpose(from: &[f32], width: usize, to: &mut [f32]) {
    dispatch_kernel(TransposeTask { from, width, to });
}

struct TransposeTask<'a> {
    from: &'a [f32],
    width: usize,
    to: &'a mut [f32],
}

/// Rows that are transposed at a time: what they become fills a cache line.
const ROWS: usize = 2 * BLOCK;
/// Rows and columns of a block.
const BLOCK: usize = 8;

impl WithSimd for TransposeTask<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) {
        let Self { from, width, to } = self;
        let height = from.len().checked_div(width).unwrap_or_default();
        let (whole_rows, whole_columns) = (height - height % ROWS, width - width % BLOCK);
        for y in (0..whole_rows).step_by(ROWS) {
            for x in (0..whole_columns).step_by(BLOCK) {
                for y in [y, y + BLOCK] {
                    let mut block = [[0.0; BLOCK]; BLOCK];
                    for (k, row) in block.iter_mut().enumerate() {
                        row.copy_from_slice(&from[(y + k) * width + x..][..BLOCK]);
                    }
                    for (k, column) in transpose_8x8(simd, &block).iter().enumerate() {
                        to[(x + k) * height + y..][..BLOCK].copy_from_slice(column);
                    }
                }
            }
        }
        for y in 0..height {
            for x in if y < whole_rows { whole_columns } else { 0 }..width {
                to[x * height + y] = from[y * width + x];
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn columns_become_rows_for_every_size() {
        for [width, height] in [[0, 0], [1, 1], [1, 9], [9, 1], [16, 16], [16, 48], [17, 35], [40, 7]] {
            let from: Vec<f32> = (0..width * height).map(|at| at as f32).collect();
            let mut to = vec![-1.0; from.len()];
            transpose(&from, width, &mut to);
            for at in 0..from.len() {
                assert_eq!(to[at], from[(at % height) * width + at / height], "{width} x {height}");
            }
        }
    }
}
