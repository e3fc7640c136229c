//! Resampling between the camera's grid and one that is coarser by an integer factor ([`super::lattice`]).

use std::ops::Range;

use super::lattice::Lattice;
use crate::base::grid::{Grid, Rect};
use crate::base::simd::simd_dispatch;

/// Drop of the object around four pixels, in pixel sizes, below which it counts as round.
const ROUND_DROP: f32 = 0.5;

impl Lattice {
    /// Returns the penetration at the coarse pixels' centres: that of a fine pixel there, or the mean of those around
    /// the centre, in which only positive values count; where none is positive, the largest. So the result does not
    /// depend on how high the object was captured. `mm_per_px` is the size of a fine pixel.
    pub fn downsample(self, fine: &Grid<f32>, mm_per_px: [f64; 2]) -> Grid<f32> {
        let [width, height] = self.size();
        let between = self.fine_at_centre(0, 0).len() == 2 && self.fine_at_centre(0, 1).len() == 2;
        let step_mm = mm_per_px[0].min(mm_per_px[1]) as f32;
        // If a fine pixel lies at the centre, nothing is added.
        let per_step = if between { 1.0 / (ROUND_DROP * step_mm) } else { f32::INFINITY };
        self.map_centres(fine, Rect::whole(width, height), |inner, outer| {
            let [a, b, c, d] = inner.map(|g| if g > 0.0 { g } else { 0.0 });
            let mean = 0.25 * ((a + b) + (c + d));
            // The mean of four pixels is below a round object's top. The pixels around these tell by how much, unless
            // the object ends there.
            let [a, b, c, d] = outer.map(|g| if g > 0.0 { g } else { 0.0 });
            let lower = mean - 0.25 * ((a + b) + (c + d));
            let round = 1.0 - lower.abs() * per_step;
            let higher = 0.125 * lower * if round > 0.0 { round } else { 0.0 };
            let [a, b, c, d] = inner;
            let (most, other) = (if a > b { a } else { b }, if c > d { c } else { d });
            let most = if most > other { most } else { other };
            if most > 0.0 { mean + higher } else { most }
        })
    }

    /// Returns the values at the centres of the coarse pixels `part`.
    pub fn downsample_part(self, fine: &Grid<f32>, part: Rect) -> Grid<f32> {
        self.map_centres(fine, part, |[a, b, c, d], _| 0.25 * ((a + b) + (c + d)))
    }

    /// Applies `of` to the four fine pixels around the centre of each coarse pixel of `part` (the same ones repeated if
    /// there are fewer), and to the four beyond them along the diagonals (at the image's border, the nearest ones
    /// again).
    fn map_centres(self, fine: &Grid<f32>, part: Rect, of: impl Fn([f32; 4], [f32; 4]) -> f32) -> Grid<f32> {
        let mut coarse = Grid::new(part.width(), part.height());
        if coarse.data.is_empty() {
            return coarse;
        }
        for y in 0..part.height() {
            let rows = self.fine_at_centre(part.y0 + y, 1);
            let around = [rows.start.saturating_sub(1), rows.start, rows.end - 1, rows.end.min(fine.height - 1)];
            let rows = around.map(|row| fine.row(row));
            let out = coarse.row_mut(y);
            let value = |x: usize| {
                let columns = self.fine_at_centre(part.x0 + x, 0);
                let [left, right] = [columns.start.saturating_sub(1), columns.end.min(fine.width - 1)];
                let [first, last] = [columns.start, columns.end - 1];
                let [beyond_above, above, below, beyond_below] = rows;
                let outer = [beyond_above[left], beyond_above[right], beyond_below[left], beyond_below[right]];
                of([above[first], above[last], below[first], below[last]], outer)
            };
            let inside = if out.len() > 3 { 1..out.len() - 2 } else { 0..0 };
            (0..inside.start).chain(inside.end..out.len()).for_each(|x| out[x] = value(x));
            if inside.is_empty() {
                continue;
            }
            let (columns, out) = (self.fine_at_centre(part.x0 + inside.start, 0), &mut out[inside]);
            simd_dispatch(
                #[inline(always)]
                || match self.factor {
                    1 => map_row_centres::<1>(rows, columns.clone(), out, &of),
                    2 => map_row_centres::<2>(rows, columns.clone(), out, &of),
                    _ => map_row_centres::<4>(rows, columns.clone(), out, &of),
                },
            );
        }
        coarse
    }

    /// Interpolates at the fine pixels `rect`, into `out`. `values` are the coarse pixels `part`; outside, their border
    /// is continued.
    pub fn upsample(self, values: &Grid<f32>, part: Rect, rect: Rect, shape: Interpolation, out: &mut Grid<f32>) {
        let bases_down = self.interpolation_bases(1, shape);
        let slopes = (shape == Interpolation::Cubic).then(|| LimitedSlopes::new(values));
        // First along x in every coarse row, then along y: only the second step is done for all fine pixels.
        let mut rows = self.upsampled_rows_with(values, slopes.as_ref().map(|slopes| &slopes.x), part, rect, shape);
        let mut steep =
            slopes.as_ref().map(|LimitedSlopes { y, xy, .. }| self.upsampled_rows_with(y, Some(xy), part, rect, shape));
        out.reshape(rect.width(), rect.height());
        simd_dispatch(
            #[inline(always)]
            || {
                for y in 0..rect.height() {
                    let basis = bases_down[(rows.top + y) % self.factor];
                    let [here, next] = rows.rows_around(y).0;
                    let pairs = out.row_mut(y).iter_mut().zip(here.iter().zip(next));
                    let Some(steep) = &mut steep else {
                        pairs.for_each(|(value, (here, next))| *value = here + basis.next * (next - here));
                        continue;
                    };
                    let [leave, arrive] = steep.rows_around(y).0;
                    for ((value, (here, next)), (leave, arrive)) in pairs.zip(leave.iter().zip(arrive)) {
                        let straight = here + basis.next * (next - here);
                        *value = straight + (basis.leave * leave + basis.arrive * arrive);
                    }
                }
            },
        );
    }

    /// Interpolates linearly at the fine pixels `rect`, one row at a time; see [`Lattice::upsample`].
    pub fn upsampled_rows(self, values: &Grid<f32>, part: Rect, rect: Rect) -> UpsampledRows<'_> {
        self.upsampled_rows_with(values, None, part, rect, Interpolation::Linear)
    }

    fn upsampled_rows_with<'a>(
        self,
        values: &'a Grid<f32>,
        slopes: Option<&'a Grid<f32>>,
        part: Rect,
        rect: Rect,
        shape: Interpolation,
    ) -> UpsampledRows<'a> {
        let (left, columns) = self.coarse_around(0, rect.x0, rect.x1, part.x0, part.width());
        let (top, coarse) = self.coarse_around(1, rect.y0, rect.y1, part.y0, part.height());
        let widened = [0, 1].map(|_| vec![0.0; (columns.len() - 1) * self.factor]);
        UpsampledRows {
            values,
            slopes,
            bases: self.interpolation_bases(0, shape),
            line: vec![0.0; columns.len()],
            steepness: vec![0.0; columns.len()],
            columns,
            coarse,
            widened,
            widened_count: 0,
            inside: left..left + rect.width(),
            top,
            factor: self.factor,
            phase: self.half_pixel_phase(1),
        }
    }

    /// Returns the offset of the fine pixels from the coarse pixels' centres, in fine pixels: half a pixel or 0.
    fn half_pixel_phase(self, k: usize) -> f32 {
        if self.first_twice[k] % 2 == 0 { 0.0 } else { 0.5 }
    }

    /// Returns the basis for each fine pixel between two coarse ones along axis `k`.
    fn interpolation_bases(self, k: usize, shape: Interpolation) -> Vec<InterpolationBasis> {
        (0..self.factor)
            .map(|past| shape.basis_at((past as f32 + self.half_pixel_phase(k)) / self.factor as f32))
            .collect()
    }

    /// Finds, for the fine pixels `from..to` of a line along axis `k`, the coarse pixels that they lie between (counted
    /// from `start` and clamped to `count`). Also returns how many whole fine pixels the first of them is past a coarse
    /// one.
    fn coarse_around(self, k: usize, from: usize, to: usize, start: usize, count: usize) -> (usize, Vec<usize>) {
        let (first, past) = self.coarse_before(from, k);
        let past = past / 2;
        let steps = (past + to - from).div_ceil(self.factor);
        let inside = |k: usize| (first + k as isize - start as isize).clamp(0, count as isize - 1) as usize;
        (past, (0..=steps).map(inside).collect())
    }
}

/// Values on a coarse grid, interpolated along its rows, and between rows when needed. At most two rows are kept at a
/// time.
pub struct UpsampledRows<'a> {
    values: &'a Grid<f32>,
    /// Slopes along the rows; `None` for linear interpolation.
    slopes: Option<&'a Grid<f32>>,
    bases: Vec<InterpolationBasis>,
    /// The coarse columns and rows that the fine ones lie between.
    columns: Vec<usize>,
    coarse: Vec<usize>,
    line: Vec<f32>,
    steepness: Vec<f32>,
    widened: [Vec<f32>; 2],
    /// Number of coarse rows that were widened or skipped.
    widened_count: usize,
    inside: Range<usize>,
    /// Number of fine rows from the first coarse row to the first requested one.
    top: usize,
    factor: usize,
    phase: f32,
}

impl UpsampledRows<'_> {
    /// Returns the coarse rows above and below fine row `y`, and the share of the lower one. Rows must be requested
    /// from the top down.
    #[inline(always)]
    pub fn rows_around(&mut self, y: usize) -> ([&[f32]; 2], f32) {
        let (row, past) = ((self.top + y) / self.factor, (self.top + y) % self.factor);
        for number in self.widened_count.max(row)..row + 2 {
            self.widen_row(number);
        }
        self.widened_count = row + 2;
        let rows = self.widened.each_ref().map(|row| &row[self.inside.clone()]);
        (rows, (past as f32 + self.phase) / self.factor as f32)
    }

    #[inline(always)]
    fn widen_row(&mut self, number: usize) {
        self.widened.swap(0, 1);
        let row = self.coarse[number];
        gather_values(&mut self.line, self.values.row(row), &self.columns);
        if let Some(slopes) = self.slopes {
            gather_values(&mut self.steepness, slopes.row(row), &self.columns);
        }
        match self.factor {
            2 => interpolate_line::<2>(&self.line, &self.steepness, &self.bases, &mut self.widened[1]),
            _ => interpolate_line::<4>(&self.line, &self.steepness, &self.bases, &mut self.widened[1]),
        }
    }
}

/// Computes [`Lattice::map_centres`] for pixels within a row, from the one at the fine columns `centre` on; each must
/// have a neighbour on its right.
#[inline(always)]
fn map_row_centres<const N: usize>(
    rows: [&[f32]; 4],
    centre: Range<usize>,
    out: &mut [f32],
    of: &impl Fn([f32; 4], [f32; 4]) -> f32,
) {
    // Every `N`-th value from a column on is the first of a chunk.
    let count = out.len();
    let [left, first, last, right] = [centre.start - 1, centre.start, centre.end - 1, centre.end];
    let chunks = |row: usize, column: usize| &rows[row][column..][..count * N].as_chunks::<N>().0[..count];
    let inner = [chunks(1, first), chunks(1, last), chunks(2, first), chunks(2, last)];
    let outer = [chunks(0, left), chunks(0, right), chunks(3, left), chunks(3, right)];
    for x in 0..count {
        out[x] = of(inner.map(|chunks| chunks[x][0]), outer.map(|chunks| chunks[x][0]));
    }
}

/// Interpolates `N` values between neighbouring values of a line.
#[inline(always)]
fn interpolate_line<const N: usize>(line: &[f32], slopes: &[f32], bases: &[InterpolationBasis], out: &mut [f32]) {
    let mut own = [bases[0]; N];
    own.copy_from_slice(&bases[..N]);
    let (out, _) = out.as_chunks_mut::<N>();
    let count = out.len();
    let (here, next) = (&line[..count], &line[1..][..count]);
    let (leave, arrive) = (&slopes[..count], &slopes[1..][..count]);
    for x in 0..count {
        for (value, basis) in out[x].iter_mut().zip(&own) {
            *value = here[x] + basis.next * (next[x] - here[x]) + (basis.leave * leave[x] + basis.arrive * arrive[x]);
        }
    }
}

#[inline(always)]
fn gather_values(line: &mut [f32], from: &[f32], at: &[usize]) {
    for (value, at) in line.iter_mut().zip(at) {
        *value = from[*at];
    }
}

/// Slopes of an image at its pixels, per pixel: along x, along y, and the change of one along the other. Exchanging x
/// and y gives the same slopes.
struct LimitedSlopes {
    x: Grid<f32>,
    y: Grid<f32>,
    xy: Grid<f32>,
}

impl LimitedSlopes {
    fn new(values: &Grid<f32>) -> Self {
        let (width, height) = (values.width, values.height);
        let [mut x, mut y, mut xy] = [0; 3].map(|_| Grid::new(width, height));
        let around = |at: usize, size: usize| (at.saturating_sub(1), (at + 1).min(size - 1));
        simd_dispatch(
            #[inline(always)]
            || {
                for row in 0..height {
                    let here = values.row(row);
                    if let ([_, slopes @ .., _], [_, at @ .., _]) = (x.row_mut(row), here) {
                        let around = here.iter().zip(at).zip(&here[2..]);
                        for (slope, ((before, at), after)) in slopes.iter_mut().zip(around) {
                            *slope = limited_slope(at - before, after - at);
                        }
                    }
                    let (above, below) = around(row, height);
                    let rows = values.row(above).iter().zip(here).zip(values.row(below));
                    for (slope, ((before, at), after)) in y.row_mut(row).iter_mut().zip(rows) {
                        *slope = limited_slope(at - before, after - at);
                    }
                }
                for row in 0..height {
                    let (above, below) = around(row, height);
                    let (above, below, here) = (x.row(above), x.row(below), y.row(row));
                    if let [_, slopes @ .., _] = xy.row_mut(row) {
                        let across = here.iter().zip(&here[2..]).zip(above[1..].iter().zip(&below[1..]));
                        for (slope, ((left, right), (above, below))) in slopes.iter_mut().zip(across) {
                            *slope = limited_slope(0.5 * (right - left), 0.5 * (below - above));
                        }
                    }
                }
            },
        );
        Self { x, y, xy }
    }
}

/// Returns the mean of two slopes, limited to three times the smaller one; 0 where their signs differ.
#[inline(always)]
fn limited_slope(one: f32, other: f32) -> f32 {
    let most = 3.0 * one.abs().min(other.abs());
    // Not `clamp`: it may panic, which would keep the compiler from processing eight values at a time.
    let mean = (0.5 * (one + other)).max(-most).min(most);
    if one * other > 0.0 { mean } else { 0.0 }
}

/// How values between pixels are interpolated.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Interpolation {
    /// Smooth, with slopes limited so that a wall does not ring (Catmull and Rom, limited as by Fritsch and Carlson
    /// 1980).
    Cubic,
    /// Linear.
    Linear,
}

impl Interpolation {
    /// Returns the basis for a point at the share `t` of the way from one pixel to the next.
    fn basis_at(self, t: f32) -> InterpolationBasis {
        match self {
            Self::Cubic => InterpolationBasis {
                next: t * t * (3.0 - 2.0 * t),
                leave: t * (1.0 - t) * (1.0 - t),
                arrive: t * t * (t - 1.0),
            },
            Self::Linear => InterpolationBasis { next: t, leave: 0.0, arrive: 0.0 },
        }
    }
}

/// Weights of the next pixel, and of the slopes at this pixel and the next one.
#[derive(Clone, Copy)]
struct InterpolationBasis {
    next: f32,
    leave: f32,
    arrive: f32,
}
