//! The steepest rises of a surface: they decide, before any shadow is computed, whether there can be one.

use super::max_f32;
use crate::base::grid::Grid;
use crate::base::simd::simd_dispatch;

/// The largest rises of a surface from a pixel to its neighbours, mm per mm; 0 where all neighbours are lower.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct SteepestSlopes {
    /// Towards +x.
    pub right: f32,
    /// Towards -x.
    pub left: f32,
    /// Towards +y.
    pub down: f32,
    /// Towards -y.
    pub up: f32,
    /// Largest absolute displacement, mm: it limits how exact the rises can be.
    pub largest_mm: f32,
    /// Highest point over the pad at rest, mm, 0 or more.
    pub highest_mm: f32,
    /// Highest point over the lowest one, mm; the pad at rest counts.
    pub span_mm: f32,
    /// Columns or rows, whichever are more.
    pub longest_px: usize,
}

impl SteepestSlopes {
    /// Measures `surface`, whose pixels are `mm_per_px` apart along x and y. All rises are 0 in an image without
    /// neighbours.
    pub fn new(surface: &Grid<f32>, mm_per_px: [f64; 2]) -> Self {
        let level = vec![0.0; surface.width];
        let [mut heights, mut along_x, mut along_y] = [Extremes::default(); 3];
        simd_dispatch(
            #[inline(always)]
            || {
                for y in 0..surface.height {
                    let row = surface.row(y);
                    heights.add_differences(row, &level);
                    along_x.add_differences(row.get(1..).unwrap_or_default(), row);
                    along_y.add_differences(surface.row((y + 1).min(surface.height - 1)), row);
                }
            },
        );
        let [[highest, lowest], [right, left], [down, up]] =
            [heights, along_x, along_y].map(Extremes::largest_differences);
        let [per_mm_x, per_mm_y] = mm_per_px.map(|pixel_mm| (1.0 / pixel_mm) as f32);
        Self {
            right: right * per_mm_x,
            left: left * per_mm_x,
            down: down * per_mm_y,
            up: up * per_mm_y,
            largest_mm: highest.max(lowest),
            highest_mm: highest,
            span_mm: highest + lowest,
            longest_px: surface.width.max(surface.height),
        }
    }
}

/// The largest differences of both signs, in sixteen lanes so that they are found side by side.
#[derive(Clone, Copy, Default)]
struct Extremes {
    most: [f32; 16],
    least: [f32; 16],
}

impl Extremes {
    /// Counts the differences `to - from`, value by value, as far as both go.
    #[inline(always)]
    fn add_differences(&mut self, to: &[f32], from: &[f32]) {
        let shared = to.len().min(from.len());
        let (to, to_rest) = to[..shared].as_chunks::<16>();
        let (from, from_rest) = from[..shared].as_chunks::<16>();
        for (to, from) in to.iter().zip(from) {
            for lane in 0..16 {
                self.record_difference(lane, to[lane] - from[lane]);
            }
        }
        for (lane, (to, from)) in to_rest.iter().zip(from_rest).enumerate() {
            self.record_difference(lane, to - from);
        }
    }

    #[inline(always)]
    fn record_difference(&mut self, lane: usize, rise: f32) {
        self.most[lane] = max_f32(rise, self.most[lane]);
        self.least[lane] = max_f32(-rise, self.least[lane]);
    }

    /// Returns the largest difference upwards and downwards, 0 or more.
    fn largest_differences(self) -> [f32; 2] {
        [self.most, self.least].map(|lanes| lanes.into_iter().fold(0.0, max_f32))
    }
}
