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

    /// Takes the displacement from a frame whose origin is at `frame_mm`, and whose axes are rotated by `angle_rad`, to
    /// the frame in which they are.
    pub fn in_turned_frame(&self, frame_mm: [f64; 2], angle_rad: f64) -> Self {
        let Self { values_mm, placement: GridPlacement { origin_mm, mm_per_px } } = self;
        let with_origin =
            |values_mm, origin_mm| Self { values_mm, placement: GridPlacement { origin_mm, mm_per_px: *mm_per_px } };
        if angle_rad == 0.0 {
            return with_origin(values_mm.clone(), [0, 1].map(|k| origin_mm[k] + frame_mm[k]));
        }
        let (sin, cos) = libm::sincos(angle_rad);
        let size = [values_mm.width, values_mm.height];
        let out = |[x, y]: [f64; 2]| [frame_mm[0] + cos * x - sin * y, frame_mm[1] + sin * x + cos * y];
        let far = [0, 1].map(|k| origin_mm[k] + (size[k] - 1) as f64 * mm_per_px[k]);
        let corners = [[0, 0], [0, 1], [1, 0], [1, 1]]
            .map(|ends: [usize; 2]| out([0, 1].map(|k| if ends[k] == 0 { origin_mm[k] } else { far[k] })));
        let low = [0, 1].map(|k| corners.iter().map(|corner| corner[k]).fold(f64::INFINITY, f64::min));
        let high = [0, 1].map(|k| corners.iter().map(|corner| corner[k]).fold(f64::NEG_INFINITY, f64::max));
        let count = |k: usize| libm::ceil((high[k] - low[k]) / mm_per_px[k]) as usize + 4;
        // Room for the border that cubic interpolation needs on each side.
        let first = [0, 1].map(|k| low[k] - 1.5 * mm_per_px[k]);
        let mut turned = Grid::new(count(0), count(1));
        for y in 0..turned.height {
            for (x, value) in turned.row_mut(y).iter_mut().enumerate() {
                let [dx, dy] = [x, y].map(|at| at as f64);
                let [dx, dy] = [first[0] + dx * mm_per_px[0] - frame_mm[0], first[1] + dy * mm_per_px[1] - frame_mm[1]];
                let there = [cos * dx + sin * dy, cos * dy - sin * dx];
                let place: [f64; 2] = std::array::from_fn(|k| (there[k] - origin_mm[k]) / mm_per_px[k]);
                if (0..2).all(|k| (1.0..(size[k] - 2) as f64).contains(&place[k])) {
                    let left = place.map(|at| at as usize);
                    let [along, across] = [0, 1].map(|k| catmull_rom((place[k] - left[k] as f64) as f32));
                    *value = (0..4)
                        .map(|row| {
                            let four = &values_mm.row(left[1] + row - 1)[left[0] - 1..left[0] + 3];
                            across[row] * four.iter().zip(along).map(|(value, share)| value * share).sum::<f32>()
                        })
                        .sum();
                }
            }
        }
        with_origin(turned, first)
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

/// Interpolates bilinearly; outside the grid its border is continued. Where values differ by more than `jump`, returns
/// the nearest value.
pub(crate) fn interpolate_bilinear(grid: &Grid<f32>, at: [f64; 2], jump: f32) -> f32 {
    let axis = |k: usize, count: usize| {
        let at = at[k].clamp(0.0, (count - 1) as f64);
        let first = (at as usize).min(count.saturating_sub(2));
        (first, (at - first as f64) as f32)
    };
    let ((x, t), (y, s)) = (axis(0, grid.width), axis(1, grid.height));
    let corners = [(x, y), (x + 1, y), (x, y + 1), (x + 1, y + 1)];
    let value = |(x, y): (usize, usize)| grid.at(x.min(grid.width - 1), y.min(grid.height - 1));
    let values = corners.map(value);
    let [lowest, highest] = [f32::min, f32::max].map(|of| values.into_iter().fold(values[0], of));
    if highest.is_infinite() || highest - lowest > jump {
        return value((x + usize::from(t > 0.5), y + usize::from(s > 0.5)));
    }
    let line = |y: usize| grid.at(x, y) + t * (grid.at((x + 1).min(grid.width - 1), y) - grid.at(x, y));
    let (upper, lower) = (line(y), line((y + 1).min(grid.height - 1)));
    upper + s * (lower - upper)
}
