//! Size and place of the marked pixels of a mask.

use super::grid::{Grid, Rect, bounding_box};
use super::simd::simd_dispatch;

/// Size and place of marked pixels.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct MaskExtent {
    /// Number of pixels.
    pub pixels: u64,
    /// Mean position, px: the centre of the first pixel is at (0.5, 0.5). It is 0 without pixels.
    pub centroid_px: [f64; 2],
    /// The smallest box around them.
    pub bbox: Rect,
}

impl MaskExtent {
    /// Measures the marked pixels of a mask.
    pub fn from_mask(mask: &Grid<u8>) -> Self {
        let bbox = bounding_box(mask, |value| value > 0);
        let (mut pixels, mut sum_x, mut sum_y) = (0_u64, 0_u64, 0_u64);
        simd_dispatch(
            #[inline(always)]
            || {
                for y in bbox.y0..bbox.y1 {
                    // The sums of a row fit 32 bits, of which a vector holds eight.
                    let (mut in_row, mut columns) = (0_u32, 0_u32);
                    for (x, value) in mask.row(y)[bbox.x0..bbox.x1].iter().enumerate() {
                        let touches = u32::from(*value > 0);
                        in_row += touches;
                        columns += touches * x as u32;
                    }
                    pixels += u64::from(in_row);
                    sum_x += u64::from(columns) + u64::from(in_row) * bbox.x0 as u64;
                    sum_y += u64::from(in_row) * y as u64;
                }
            },
        );
        let centre = |sum: u64| if pixels == 0 { 0.0 } else { sum as f64 / pixels as f64 + 0.5 };
        Self { pixels, centroid_px: [centre(sum_x), centre(sum_y)], bbox }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_extent_agrees_with_a_plain_sum() {
        for (width, height) in [(1, 1), (3, 2), (17, 23), (70, 5)] {
            let marked = |x: usize, y: usize| x * 7 % 5 < 2 && y != 1;
            let mut mask = Grid::new(width, height);
            let (mut count, mut sums) = (0, [0.0; 2]);
            for y in 0..height {
                for x in (0..width).filter(|x| marked(*x, y)) {
                    mask.row_mut(y)[x] = 255;
                    count += 1;
                    sums = [sums[0] + x as f64 + 0.5, sums[1] + y as f64 + 0.5];
                }
            }
            let found = MaskExtent::from_mask(&mask);
            assert_eq!(found.pixels, count, "{width} x {height}");
            for (mean, sum) in found.centroid_px.into_iter().zip(sums) {
                assert!((mean * count as f64 - sum).abs() <= 1e-9 * sum, "{found:?}");
            }
            assert_eq!(found.bbox, bounding_box(&mask, |value| value > 0));
        }
        let none = MaskExtent { pixels: 0, centroid_px: [0.0; 2], bbox: Rect::default() };
        assert_eq!(MaskExtent::from_mask(&Grid::new(4, 3)), none);
    }
}
