//! A coarser grid than the camera's, and what varies slowly enough to be found there and interpolated.

use crate::base::grid::{Grid, Rect, Resolution};
use crate::base::simd::simd_dispatch;
use crate::base::view::SURFACE_BORDER;

/// Every pixel of a surface, or every second or fourth one.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Coarse {
    /// Pixels of the camera from one pixel of the grid to the next.
    pub factor: usize,
}

/// Something that varies over the view, on a grid that may be coarser than the camera's.
#[derive(Clone, Debug)]
pub struct Values {
    /// Pixels of the view from one value to the next: 1, 2, 4 or 8.
    pub factor: usize,
    /// Column and row of the view that the first value is for.
    pub first: [isize; 2],
    /// The values.
    pub values: Grid<f32>,
}

impl Coarse {
    /// The grid of a resolution.
    pub fn new(resolution: Resolution) -> Self {
        Self { factor: resolution.factor() }
    }

    /// The coarsest grid of every pixel, or every second, fourth or eighth, whose pixels are no further apart than
    /// `spacing_mm`, or hardly.
    pub fn spaced(spacing_mm: f64, mm_per_px: [f64; 2]) -> Self {
        let widest = mm_per_px[0].max(mm_per_px[1]);
        let fits = |factor: &usize| *factor as f64 * widest <= 1.1 * spacing_mm;
        Self { factor: [8, 4, 2].into_iter().find(fits).unwrap_or(1) }
    }

    /// The pixels of [`Coarse::thinned`].
    pub fn size(self, size: [usize; 2]) -> [usize; 2] {
        size.map(|size| {
            let count = size + 2 * SURFACE_BORDER;
            (count - 1 - self.first(count)) / self.factor + 1
        })
    }

    /// Column and row of the view of `size` on which the first pixel of [`Coarse::thinned`] lies: in its border, or in the
    /// view.
    pub fn start(self, size: [usize; 2]) -> [isize; 2] {
        size.map(|size| self.first(size + 2 * SURFACE_BORDER) as isize - SURFACE_BORDER as isize)
    }

    /// Distance between pixels.
    pub fn pitch(self, mm_per_px: [f64; 2]) -> [f64; 2] {
        mm_per_px.map(|pitch| pitch * self.factor as f64)
    }

    /// The first pixel that is kept, of `count`: such that about as many are left out at either end.
    fn first(self, count: usize) -> usize {
        ((count - 1) % self.factor) / 2
    }

    /// What is kept of a surface.
    pub fn thinned(self, surface: &Grid<f32>) -> Grid<f32> {
        let (left, top) = (self.first(surface.width), self.first(surface.height));
        let count = |first: usize, count: usize| (count - 1 - first) / self.factor + 1;
        let mut thinned = Grid::new(count(left, surface.width), count(top, surface.height));
        simd_dispatch(
            #[inline(always)]
            || {
                for y in 0..thinned.height {
                    let row = &surface.row(top + y * self.factor)[left..];
                    match self.factor {
                        1 => thin::<1>(row, thinned.row_mut(y)),
                        2 => thin::<2>(row, thinned.row_mut(y)),
                        4 => thin::<4>(row, thinned.row_mut(y)),
                        _ => thin::<8>(row, thinned.row_mut(y)),
                    }
                }
            },
        );
        thinned
    }

    /// Pixels of the grid that [`Coarse::thinned`] gives, less those in the border of the surface.
    pub fn view(self, size: [usize; 2]) -> [usize; 2] {
        self.size(size).map(|count| count.saturating_sub(2 * SURFACE_BORDER))
    }

    /// What of [`Coarse::view`] interpolation in `region` of a view of `size` needs; empty if there is nothing.
    pub fn part(self, size: [usize; 2], region: Rect) -> Rect {
        let view = self.view(size);
        if view.contains(&0) {
            return Rect::default();
        }
        let along = |k: usize, from: usize, to: usize| {
            let first = self.first(size[k] + 2 * SURFACE_BORDER);
            let coarse = |at: usize| (at + SURFACE_BORDER).saturating_sub(first) / self.factor;
            let (from, to) = (coarse(from).saturating_sub(SURFACE_BORDER), coarse(to));
            (from.min(view[k] - 1), to.max(from + 1).min(view[k]))
        };
        let ((x0, x1), (y0, y1)) = (along(0, region.x0, region.x1), along(1, region.y0, region.y1));
        Rect { x0, y0, x1: x1.max(x0 + 1), y1: y1.max(y0 + 1) }
    }

    /// Column and row of the view of `size` on which a pixel of [`Coarse::view`] lies.
    fn place(self, size: [usize; 2], pixel: [usize; 2]) -> [isize; 2] {
        let start = self.start(size);
        std::array::from_fn(|k| start[k] + ((pixel[k] + SURFACE_BORDER) * self.factor) as isize)
    }

    /// Values at the pixels of a part of [`Coarse::view`], to be interpolated.
    pub fn values(self, size: [usize; 2], part: Rect, values: Vec<f32>) -> Values {
        let values = Grid { width: part.width(), height: part.height(), data: values };
        Values { factor: self.factor, first: self.place(size, [part.x0, part.y0]), values }
    }
}

impl Values {
    /// The values at pixels in row `y` of the view, from column `x0` on; beyond the outermost values they go on. `line` is
    /// memory to work in.
    #[inline(always)]
    pub fn row(&self, y: usize, x0: usize, line: &mut Vec<f32>, out: &mut [f32]) {
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
        self.across(&line[..count], x0 as isize, out);
    }

    /// The values at pixels from column `x0` of the view on, along row `node` of the coarse grid itself.
    #[inline(always)]
    pub fn node_row(&self, node: usize, x0: isize, out: &mut [f32]) {
        self.across(self.values.row(node), x0, out);
    }

    /// Interpolates along x: from the first value on, in whole steps of the grid, to the last.
    #[inline(always)]
    fn across(&self, line: &[f32], x0: isize, out: &mut [f32]) {
        let offset = x0 - self.first[0];
        let before = (-offset).clamp(0, out.len() as isize) as usize;
        let (outside, inside) = out.split_at_mut(before);
        outside.fill(line[0]);
        let start = offset.max(0) as usize;
        match self.factor {
            1 => expand::<1>(line, start, inside),
            2 => expand::<2>(line, start, inside),
            4 => expand::<4>(line, start, inside),
            _ => expand::<8>(line, start, inside),
        }
    }
}

/// Every `F`th value.
#[inline(always)]
fn thin<const F: usize>(values: &[f32], out: &mut [f32]) {
    let (steps, rest) = values.as_chunks::<F>();
    for (out, step) in out.iter_mut().zip(steps) {
        *out = step[0];
    }
    if let (Some(last), [value, ..]) = (out.get_mut(steps.len()), rest) {
        *last = *value;
    }
}

/// Linear interpolation of values `F` pixels apart, from pixel `start` after the first value on.
#[inline(always)]
fn expand<const F: usize>(values: &[f32], start: usize, out: &mut [f32]) {
    let last = values.len() - 1;
    let between = |column: usize, phase: usize| {
        let (left, right) = (values[column.min(last)], values[(column + 1).min(last)]);
        left + (right - left) * (phase as f32 / F as f32)
    };
    // To where a value stands.
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
            let interpolated = Values { factor, first: [1, -2], values: values.clone() };
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
                    interpolated.row(y, x0, &mut Vec::new(), &mut row);
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
                let coarse = Coarse::new(resolution);
                let thinned = coarse.thinned(&surface);
                let (first, last) =
                    (thinned.at(0, 0) as usize % count, thinned.at(thinned.width - 1, 0) as usize % count);
                assert!(first.abs_diff(count - 1 - last) <= 1, "{count} {resolution:?}: {first} {last}");
                assert_eq!((last - first) / coarse.factor + 1, thinned.width);
            }
        }
    }
}
