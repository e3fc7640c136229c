//! A grid coarser than the camera's, and values that vary slowly enough to be computed there and interpolated.

use crate::base::grid::{Grid, Rect, Resolution};
use crate::base::simd::simd_dispatch;
use crate::base::view::SURFACE_BORDER;

/// A grid of every pixel of a surface, or of every second, fourth or eighth one.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct CoarseGrid {
    /// Pixels of the camera from one pixel of the grid to the next.
    pub factor: usize,
}

/// Values over the view, on a grid that may be coarser than the camera's.
#[derive(Clone, Debug)]
pub struct CoarseValues {
    /// Pixels of the view from one value to the next: 1, 2, 4 or 8.
    pub factor: usize,
    /// Column and row of the view that the first value is for.
    pub first: [isize; 2],
    /// The values.
    pub values: Grid<f32>,
}

impl CoarseGrid {
    /// Returns the grid of a resolution.
    pub fn new(resolution: Resolution) -> Self {
        Self { factor: resolution.factor() }
    }

    /// Returns the coarsest grid of every pixel, or every second, fourth or eighth, whose pixels are no further apart
    /// than `spacing_mm` and a tenth of it.
    pub fn with_spacing(spacing_mm: f64, mm_per_px: [f64; 2]) -> Self {
        let widest = mm_per_px[0].max(mm_per_px[1]);
        let fits = |factor: &usize| *factor as f64 * widest <= 1.1 * spacing_mm;
        Self { factor: [8, 4, 2].into_iter().find(fits).unwrap_or(1) }
    }

    /// Returns the columns and rows of [`CoarseGrid::subsample`] for the surface of a view of `size`.
    pub fn subsampled_size(self, size: [usize; 2]) -> [usize; 2] {
        size.map(|size| {
            let count = size + 2 * SURFACE_BORDER;
            (count - 1 - self.first_kept(count)) / self.factor + 1
        })
    }

    /// Returns the column and row of the view of `size` on which the first pixel of [`CoarseGrid::subsample`] lies: in
    /// the surface's border (below 0), or in the view.
    pub fn subsampled_origin(self, size: [usize; 2]) -> [isize; 2] {
        size.map(|size| self.first_kept(size + 2 * SURFACE_BORDER) as isize - SURFACE_BORDER as isize)
    }

    /// Returns the distance between pixels, mm.
    pub fn pixel_size_mm(self, mm_per_px: [f64; 2]) -> [f64; 2] {
        mm_per_px.map(|pixel_mm| pixel_mm * self.factor as f64)
    }

    /// Returns the first pixel that is kept, of `count`: about as many are left out at either end.
    fn first_kept(self, count: usize) -> usize {
        ((count - 1) % self.factor) / 2
    }

    /// Returns the pixels of a surface that the grid keeps.
    pub fn subsample(self, surface: &Grid<f32>) -> Grid<f32> {
        let (left, top) = (self.first_kept(surface.width), self.first_kept(surface.height));
        let count = |first: usize, count: usize| (count - 1 - first) / self.factor + 1;
        let mut subsampled = Grid::new(count(left, surface.width), count(top, surface.height));
        simd_dispatch(
            #[inline(always)]
            || {
                for y in 0..subsampled.height {
                    let row = &surface.row(top + y * self.factor)[left..];
                    match self.factor {
                        1 => subsample_line::<1>(row, subsampled.row_mut(y)),
                        2 => subsample_line::<2>(row, subsampled.row_mut(y)),
                        4 => subsample_line::<4>(row, subsampled.row_mut(y)),
                        _ => subsample_line::<8>(row, subsampled.row_mut(y)),
                    }
                }
            },
        );
        subsampled
    }

    /// Returns the columns and rows of [`CoarseGrid::subsample`] without the border of the surface.
    pub fn inner_size(self, size: [usize; 2]) -> [usize; 2] {
        self.subsampled_size(size).map(|count| count.saturating_sub(2 * SURFACE_BORDER))
    }

    /// Returns the part of the grid without its border ([`CoarseGrid::inner_size`]) that interpolation in `region` of a
    /// view of `size` needs; an empty rectangle if the grid has no such pixels.
    pub fn part_for_region(self, size: [usize; 2], region: Rect) -> Rect {
        let view = self.inner_size(size);
        if view.contains(&0) {
            return Rect::default();
        }
        let along = |k: usize, from: usize, to: usize| {
            let first = self.first_kept(size[k] + 2 * SURFACE_BORDER);
            let coarse = |at: usize| (at + SURFACE_BORDER).saturating_sub(first) / self.factor;
            let (from, to) = (coarse(from).saturating_sub(SURFACE_BORDER), coarse(to));
            (from.min(view[k] - 1), to.max(from + 1).min(view[k]))
        };
        let ((x0, x1), (y0, y1)) = (along(0, region.x0, region.x1), along(1, region.y0, region.y1));
        Rect { x0, y0, x1: x1.max(x0 + 1), y1: y1.max(y0 + 1) }
    }

    /// Returns the column and row of the view of `size` on which a pixel of the grid without its border lies.
    fn view_position(self, size: [usize; 2], pixel: [usize; 2]) -> [isize; 2] {
        let start = self.subsampled_origin(size);
        std::array::from_fn(|k| start[k] + ((pixel[k] + SURFACE_BORDER) * self.factor) as isize)
    }

    /// Makes values to be interpolated, from those at the pixels of a part of the grid without its border.
    pub fn place_values(self, size: [usize; 2], part: Rect, values: Vec<f32>) -> CoarseValues {
        let values = Grid { width: part.width(), height: part.height(), data: values };
        CoarseValues { factor: self.factor, first: self.view_position(size, [part.x0, part.y0]), values }
    }
}

impl CoarseValues {
    /// Computes the values at pixels in row `y` of the view, from column `x0` on. Outside the outermost values they are
    /// constant. `line` is scratch memory.
    #[inline(always)]
    pub fn interpolate_row(&self, y: usize, x0: usize, line: &mut Vec<f32>, out: &mut [f32]) {
        let Self { factor, first, values } = self;
        let (count, factor) = (values.width, *factor);
        // Along y: between two rows of values.
        let at = (y as isize - first[1]).clamp(0, ((values.height - 1) * factor) as isize) as usize;
        let (row, down) = (at / factor, (at % factor) as f32 / factor as f32);
        let (above, below) = (values.row(row), values.row((row + 1).min(values.height - 1)));
        line.resize(count, 0.0);
        for ((value, above), below) in line.iter_mut().zip(above).zip(below) {
            *value = above + (below - above) * down;
        }
        self.interpolate_along_x(&line[..count], x0 as isize, out);
    }

    /// Computes the values at pixels from column `x0` of the view on, along row `node` of the coarse grid itself.
    #[inline(always)]
    pub fn interpolate_node_row(&self, node: usize, x0: isize, out: &mut [f32]) {
        self.interpolate_along_x(self.values.row(node), x0, out);
    }

    /// Interpolates along x, from column `x0` of the view on; outside the outermost values the result is constant.
    #[inline(always)]
    fn interpolate_along_x(&self, line: &[f32], x0: isize, out: &mut [f32]) {
        let offset = x0 - self.first[0];
        let before = (-offset).clamp(0, out.len() as isize) as usize;
        let (outside, inside) = out.split_at_mut(before);
        outside.fill(line[0]);
        let start = offset.max(0) as usize;
        match self.factor {
            1 => upsample_line::<1>(line, start, inside),
            2 => upsample_line::<2>(line, start, inside),
            4 => upsample_line::<4>(line, start, inside),
            _ => upsample_line::<8>(line, start, inside),
        }
    }
}

/// Copies every `F`th value.
#[inline(always)]
fn subsample_line<const F: usize>(values: &[f32], out: &mut [f32]) {
    let (steps, rest) = values.as_chunks::<F>();
    for (out, step) in out.iter_mut().zip(steps) {
        *out = step[0];
    }
    if let (Some(last), [value, ..]) = (out.get_mut(steps.len()), rest) {
        *last = *value;
    }
}

/// Interpolates linearly between values that are `F` pixels apart, from pixel `start` after the first value on.
#[inline(always)]
fn upsample_line<const F: usize>(values: &[f32], start: usize, out: &mut [f32]) {
    let last = values.len() - 1;
    let between = |column: usize, phase: usize| {
        let (left, right) = (values[column.min(last)], values[(column + 1).min(last)]);
        left + (right - left) * (phase as f32 / F as f32)
    };
    // Up to the next pixel on which a value stands; from there on, steps are entire.
    let lead = ((F - start % F) % F).min(out.len());
    let (head, body) = out.split_at_mut(lead);
    for (x, share) in head.iter_mut().enumerate() {
        *share = between((start + x) / F, (start + x) % F);
    }
    let column = (start + lead) / F;
    let pairs = last.saturating_sub(column).min(body.len() / F);
    let (body, tail) = body.split_at_mut(pairs * F);
    if pairs > 0 {
        let (left, right) = (&values[column..][..pairs], &values[column + 1..][..pairs]);
        for (step, (left, right)) in body.as_chunks_mut::<F>().0.iter_mut().zip(left.iter().zip(right)) {
            for (phase, share) in step.iter_mut().enumerate() {
                *share = left + (right - left) * (phase as f32 / F as f32);
            }
        }
    }
    for (x, share) in tail.iter_mut().enumerate() {
        *share = between(column + pairs + x / F, x % F);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn values_are_interpolated_between_the_values_and_go_on_beyond_them() {
        let values = Grid { width: 3, height: 2, data: vec![0.0, 0.4, 1.0, 0.2, 0.6, 0.0] };
        for factor in [1, 2, 4] {
            let interpolated = CoarseValues { factor, first: [1, -2], values: values.clone() };
            let bilinear = |x: usize, y: usize| {
                let place = |at: isize, count: usize| {
                    let at = (at as f64 / factor as f64).clamp(0.0, count as f64 - 1.0);
                    let whole = (at as usize).min(count - 2);
                    (whole, at - whole as f64)
                };
                let ((column, u), (row, v)) = (place(x as isize - 1, 3), place(y as isize + 2, 2));
                let at = |dx: usize, dy: usize| f64::from(values.at(column + dx, row + dy));
                let (above, below) = (at(0, 0) * (1.0 - u) + at(1, 0) * u, at(0, 1) * (1.0 - u) + at(1, 1) * u);
                above * (1.0 - v) + below * v
            };
            for (x0, y) in [(0, 0), (0, 1), (3, 0), (5, 3), (11, 9)] {
                for count in [1, 2, 3, 7, 16] {
                    let mut row = vec![f32::NAN; count];
                    interpolated.interpolate_row(y, x0, &mut Vec::new(), &mut row);
                    for (k, share) in row.iter().enumerate() {
                        let expected = bilinear(x0 + k, y);
                        assert!((f64::from(*share) - expected).abs() < 1e-6, "{factor} {x0} {y} {k}: {share}");
                    }
                }
            }
        }
    }

    #[test]
    fn a_thinned_surface_keeps_whole_pixels_and_as_many_at_either_end() {
        for count in 3..40 {
            let surface = Grid { width: count, height: count, data: (0..count * count).map(|k| k as f32).collect() };
            for resolution in [Resolution::Full, Resolution::Half, Resolution::Quarter] {
                let coarse = CoarseGrid::new(resolution);
                let subsampled = coarse.subsample(&surface);
                let (first, last) =
                    (subsampled.at(0, 0) as usize % count, subsampled.at(subsampled.width - 1, 0) as usize % count);
                assert!(first.abs_diff(count - 1 - last) <= 1, "{count} {resolution:?}: {first} {last}");
                assert_eq!((last - first) / coarse.factor + 1, subsampled.width);
            }
        }
    }
}
