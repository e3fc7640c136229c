//! Between the camera's grid and one that is coarser by a whole factor ([`super::lattice`]).

use std::ops::Range;

use super::lattice::Lattice;
use crate::core::base::grid::{Grid, Rect};
use crate::core::base::simd::simd_dispatch;

impl Lattice {
    /// Every `factor`-th pixel along x and y.
    pub fn thin_out(self, fine: &Grid<f32>, coarse: &mut Grid<f32>) {
        let [width, height] = self.size();
        self.thin_out_part(fine, Rect::whole(width, height), coarse);
    }

    /// The same for the coarse pixels `part` alone.
    pub fn thin_out_part(self, fine: &Grid<f32>, part: Rect, coarse: &mut Grid<f32>) {
        coarse.reshape(part.width(), part.height());
        for y in 0..part.height() {
            let from = fine.row(self.fine(part.y0 + y, 1))[self.fine(part.x0, 0)..].iter().step_by(self.factor);
            coarse.row_mut(y).iter_mut().zip(from).for_each(|(value, from)| *value = *from);
        }
    }

    /// Interpolates at the fine pixels `rect`. `values` are the coarse pixels `part`; beyond
    /// them the outermost go on.
    pub fn enlarge(self, values: &Grid<f32>, part: Rect, rect: Rect, shape: Shape) -> Grid<f32> {
        let factor = self.factor;
        let (left, columns) = self.coarse_around(0, rect.x0, rect.x1, part.x0, part.width());
        let (top, rows) = self.coarse_around(1, rect.y0, rect.y1, part.y0, part.height());
        let (steps, lines) = (columns.len() - 1, rows.len());
        let bases: Vec<Basis> = (0..factor).map(|phase| shape.basis(phase as f32 / factor as f32)).collect();
        let slopes = (shape == Shape::Cubic).then(|| Slopes::new(values));
        let (mut line, mut steepness) = (vec![0.0; steps + 1], vec![0.0; steps + 1]);
        // First along x in every coarse row, then along y: the second is what is done for all fine pixels.
        let mut widened = Grid::<f32>::new(steps * factor, lines);
        let mut widened_slopes = Grid::<f32>::new(steps * factor, if slopes.is_some() { lines } else { 0 });
        let mut out = Grid::new(rect.width(), rect.height());
        simd_dispatch(
            #[inline(always)]
            || {
                let mut widen = |values: &Grid<f32>, along: Option<&Grid<f32>>, widened: &mut Grid<f32>| {
                    for (y, row) in rows.iter().enumerate() {
                        gather(&mut line, values.row(*row), &columns);
                        if let Some(along) = along {
                            gather(&mut steepness, along.row(*row), &columns);
                        }
                        match factor {
                            2 => interleave::<2>(&line, &steepness, &bases, widened.row_mut(y)),
                            _ => interleave::<4>(&line, &steepness, &bases, widened.row_mut(y)),
                        }
                    }
                };
                widen(values, slopes.as_ref().map(|slopes| &slopes.x), &mut widened);
                if let Some(slopes) = &slopes {
                    widen(&slopes.y, Some(&slopes.xy), &mut widened_slopes);
                }
                for y in 0..rect.height() {
                    let (row, basis) = ((top + y) / factor, bases[(top + y) % factor]);
                    let inside = left..left + rect.width();
                    let (here, next) = (&widened.row(row)[inside.clone()], &widened.row(row + 1)[inside.clone()]);
                    let out = out.row_mut(y);
                    for ((value, here), next) in out.iter_mut().zip(here).zip(next) {
                        *value = here + basis.next * (next - here);
                    }
                    if slopes.is_some() {
                        let leave = &widened_slopes.row(row)[inside.clone()];
                        let arrive = &widened_slopes.row(row + 1)[inside];
                        for ((value, leave), arrive) in out.iter_mut().zip(leave).zip(arrive) {
                            *value += basis.leave * leave + basis.arrive * arrive;
                        }
                    }
                }
            },
        );
        out
    }

    /// The same along straight lines, a row at a time.
    pub fn rows(self, values: &Grid<f32>, part: Rect, rect: Rect) -> Rows {
        let (left, columns) = self.coarse_around(0, rect.x0, rect.x1, part.x0, part.width());
        let (top, rows) = self.coarse_around(1, rect.y0, rect.y1, part.y0, part.height());
        let bases: Vec<Basis> =
            (0..self.factor).map(|past| Shape::Linear.basis(past as f32 / self.factor as f32)).collect();
        let (mut line, level) = (vec![0.0; columns.len()], vec![0.0; columns.len()]);
        let mut widened = Grid::new((columns.len() - 1) * self.factor, rows.len());
        simd_dispatch(
            #[inline(always)]
            || {
                for (y, row) in rows.iter().enumerate() {
                    gather(&mut line, values.row(*row), &columns);
                    match self.factor {
                        2 => interleave::<2>(&line, &level, &bases, widened.row_mut(y)),
                        _ => interleave::<4>(&line, &level, &bases, widened.row_mut(y)),
                    }
                }
            },
        );
        Rows { widened, inside: left..left + rect.width(), top, factor: self.factor }
    }

    /// For the fine pixels `from..to` of a line along axis `k`: how many fine pixels the first of them is past a coarse one,
    /// and which coarse pixels, counted from `start` and kept within `count`, they lie between.
    fn coarse_around(self, k: usize, from: usize, to: usize, start: usize, count: usize) -> (usize, Vec<usize>) {
        let ahead = from as isize - self.first[k] as isize;
        let first = ahead.div_euclid(self.factor as isize);
        let past = ahead.rem_euclid(self.factor as isize) as usize;
        let steps = (past + to - from).div_ceil(self.factor);
        let inside = |k: usize| (first + k as isize - start as isize).clamp(0, count as isize - 1) as usize;
        (past, (0..=steps).map(inside).collect())
    }
}

/// Values on a coarse grid, interpolated along its rows and, when they are asked for, between them.
pub struct Rows {
    widened: Grid<f32>,
    inside: Range<usize>,
    /// Fine rows from the first coarse one to the first that there is.
    top: usize,
    factor: usize,
}

impl Rows {
    /// The coarse rows above and below fine row `y`, and the share of the lower one.
    #[inline(always)]
    pub fn around(&self, y: usize) -> ([&[f32]; 2], f32) {
        let (row, past) = ((self.top + y) / self.factor, (self.top + y) % self.factor);
        let rows = [row, row + 1].map(|row| &self.widened.row(row)[self.inside.clone()]);
        (rows, past as f32 / self.factor as f32)
    }
}

/// `N` values between each two of a line, the first of the two among them.
#[inline(always)]
fn interleave<const N: usize>(line: &[f32], slopes: &[f32], bases: &[Basis], out: &mut [f32]) {
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
fn gather(line: &mut [f32], from: &[f32], at: &[usize]) {
    for (value, at) in line.iter_mut().zip(at) {
        *value = from[*at];
    }
}

/// Slopes of an image at its pixels, per pixel: along x, along y, and how the one changes along the other. The same for
/// the image with x and y exchanged.
struct Slopes {
    x: Grid<f32>,
    y: Grid<f32>,
    xy: Grid<f32>,
}

impl Slopes {
    fn new(values: &Grid<f32>) -> Self {
        let (width, height) = (values.width, values.height);
        let [mut x, mut y, mut xy] = [0; 3].map(|_| Grid::new(width, height));
        let around = |at: usize, size: usize| (at.saturating_sub(1), (at + 1).min(size - 1));
        simd_dispatch(
            #[inline(always)]
            || {
                for row in 0..height {
                    let here = values.row(row);
                    for column in 1..width.saturating_sub(1) {
                        let (before, at, after) = (here[column - 1], here[column], here[column + 1]);
                        x.data[row * width + column] = limited(at - before, after - at);
                    }
                    let (above, below) = around(row, height);
                    let rows = values.row(above).iter().zip(here).zip(values.row(below));
                    for (slope, ((before, at), after)) in y.row_mut(row).iter_mut().zip(rows) {
                        *slope = limited(at - before, after - at);
                    }
                }
                for row in 0..height {
                    let (above, below) = around(row, height);
                    for column in 1..width.saturating_sub(1) {
                        let along_x = 0.5 * (y.at(column + 1, row) - y.at(column - 1, row));
                        let along_y = 0.5 * (x.at(column, below) - x.at(column, above));
                        xy.data[row * width + column] = limited(along_x, along_y);
                    }
                }
            },
        );
        Self { x, y, xy }
    }
}

/// The mean of two slopes, no more than three times the smaller and 0 where they disagree.
#[inline(always)]
fn limited(one: f32, other: f32) -> f32 {
    let most = 3.0 * one.abs().min(other.abs());
    let mean = (0.5 * (one + other)).clamp(-most, most);
    if one * other > 0.0 { mean } else { 0.0 }
}

/// How values between pixels come about.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Shape {
    /// Smooth, with slopes limited so that a wall does not ring (Catmull and Rom's, limited
    /// as by Fritsch and Carlson 1980).
    Cubic,
    /// Straight.
    Linear,
}

impl Shape {
    /// For a point that is `t` of the way from one pixel to the next.
    fn basis(self, t: f32) -> Basis {
        match self {
            Self::Cubic => {
                Basis { next: t * t * (3.0 - 2.0 * t), leave: t * (1.0 - t) * (1.0 - t), arrive: t * t * (t - 1.0) }
            }
            Self::Linear => Basis { next: t, leave: 0.0, arrive: 0.0 },
        }
    }
}

/// Shares of the next pixel, and of the slopes at this and at the next one.
#[derive(Clone, Copy)]
struct Basis {
    next: f32,
    leave: f32,
    arrive: f32,
}
