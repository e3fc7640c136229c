//! Displacements on grids of their own, which are interpolated to the solver's.

use crate::base::cubic::catmull_rom;
use crate::base::grid::Grid;
use crate::base::simd::simd_dispatch;

/// Position of a grid's pixels in the sensor's frame.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct GridPlacement {
    /// Centre of the first pixel, mm.
    pub origin_mm: [f64; 2],
    /// Pixel size.
    pub mm_per_px: [f64; 2],
}

/// A displacement into the pad on a grid of its own.
#[derive(Clone, Debug)]
pub struct PlacedDisplacement {
    /// Displacement, mm. Beyond the grid, and within a pixel of its border, it counts as 0.
    pub values_mm: Grid<f32>,
    /// Where the grid lies.
    pub placement: GridPlacement,
}

/// The first of the four values around a point, and their weights.
struct CubicTaps {
    first: usize,
    shares: [f32; 4],
}

impl GridPlacement {
    fn pixel_centre_mm(self, k: usize, at: usize) -> f64 {
        self.origin_mm[k] + at as f64 * self.mm_per_px[k]
    }

    /// Returns where a pixel of another grid lies along an axis, pixels from this grid's first.
    pub fn place_of(self, other: Self, k: usize, at: usize) -> f64 {
        (other.pixel_centre_mm(k, at) - self.origin_mm[k]) / self.mm_per_px[k]
    }
}

impl PlacedDisplacement {
    /// Returns the largest absolute displacement, mm.
    pub fn largest_mm(&self) -> f64 {
        f64::from(self.values_mm.largest(f32::abs))
    }

    /// Adds the displacement, times `factor`, to a grid whose first pixel is pixel `corner` of `placed`; cubic
    /// interpolation (Catmull and Rom 1974).
    pub fn add_to(&self, target: &mut Grid<f32>, placed: GridPlacement, corner: [usize; 2], factor: f32) {
        let (x, columns) = self.line_taps(0, placed, corner[0], target.width);
        let (y, rows) = self.line_taps(1, placed, corner[1], target.height);
        if columns.is_empty() {
            return;
        }
        let mut wide = Grid::<f32>::new(columns.len(), self.values_mm.height);
        for row in 0..self.values_mm.height {
            let from = self.values_mm.row(row);
            for (to, taps) in wide.row_mut(row).iter_mut().zip(&columns) {
                let four = &from[taps.first..taps.first + 4];
                *to = four.iter().zip(taps.shares).map(|(value, share)| value * share).sum();
            }
        }
        for (k, taps) in rows.iter().enumerate() {
            let [a, b, c, d] = [0, 1, 2, 3].map(|line| wide.row(taps.first + line));
            let [p, q, r, s] = taps.shares.map(|share| factor * share);
            let to = &mut target.row_mut(y + k)[x..x + columns.len()];
            simd_dispatch(
                #[inline(always)]
                || {
                    for ((((to, a), b), c), d) in to.iter_mut().zip(a).zip(b).zip(c).zip(d) {
                        *to += a * p + b * q + c * r + d * s;
                    }
                },
            );
        }
    }

    /// Returns the first pixel of a line that the displacement reaches, and the taps for each pixel from there on.
    fn line_taps(&self, k: usize, placed: GridPlacement, corner: usize, count: usize) -> (usize, Vec<CubicTaps>) {
        let values = [self.values_mm.width, self.values_mm.height][k];
        let place = |at: usize| self.placement.place_of(placed, k, corner + at);
        let within = |at: &usize| (1.0..(values - 2) as f64).contains(&place(*at));
        let Some(first) = (0..count).find(within) else { return (0, Vec::new()) };
        let taps = (first..count).take_while(within).map(|at| {
            let place = place(at);
            let left = (place as usize).clamp(1, values - 3);
            let shares = catmull_rom((place - left as f64) as f32);
            CubicTaps { first: left - 1, shares }
        });
        (first, taps.collect())
    }
}
