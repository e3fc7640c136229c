//! Between the camera's grid and one that is coarser by a whole factor. A coarse pixel is one of the fine ones: taking
//! means would move edges and double the error.

use crate::core::base::grid::{Grid, Rect, Resolution};
use crate::core::base::simd::simd_dispatch;

/// Which fine pixels a coarse grid consists of.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Lattice {
    /// Fine pixels from one coarse pixel to the next: 1, 2 or 4.
    pub factor: usize,
}

impl Lattice {
    /// That of a resolution.
    pub fn new(resolution: Resolution) -> Self {
        Self { factor: resolution.factor() }
    }

    /// The fine pixel that the first coarse pixel is, in a line of `fine` pixels.
    fn first(self, fine: usize) -> usize {
        (self.factor / 2).min(fine.saturating_sub(1))
    }

    /// The fine pixel that a coarse one is, in a line of `fine` pixels.
    pub fn fine(self, coarse: usize, fine: usize) -> usize {
        self.first(fine) + coarse * self.factor
    }

    /// Coarse pixels in a line of `fine` pixels.
    pub fn count(self, fine: usize) -> usize {
        (fine - 1 - self.first(fine)) / self.factor + 1
    }

    /// Every `factor`-th pixel along x and y.
    pub fn thin_out(self, fine: &Grid<f32>, coarse: &mut Grid<f32>) {
        coarse.reset(self.count(fine.width), self.count(fine.height));
        let (left, top) = (self.first(fine.width), self.first(fine.height));
        let width = coarse.width;
        for (y, row) in coarse.data.chunks_exact_mut(width).enumerate() {
            let from = fine.row(top + y * self.factor);
            for (value, from) in row.iter_mut().zip(from[left..].iter().step_by(self.factor)) {
                *value = *from;
            }
        }
    }

    /// The coarse pixels that interpolating at the fine pixels `from..to` of a line of `fine` needs.
    pub fn around(self, from: usize, to: usize, fine: usize) -> (usize, usize) {
        let first = self.first(fine);
        let at = |x: usize| x.saturating_sub(first) / self.factor;
        (at(from).saturating_sub(1), (at(to - 1) + 3).min(self.count(fine)))
    }

    /// The coarse box around a fine one, and all that interpolating in it needs.
    pub fn box_around(self, rect: Rect, fine: [usize; 2]) -> Rect {
        let ((x0, x1), (y0, y1)) = (self.around(rect.x0, rect.x1, fine[0]), self.around(rect.y0, rect.y1, fine[1]));
        Rect { x0, y0, x1, y1 }
    }

    /// The coarse pixels that are fine pixels of `rect`.
    pub fn inside(self, rect: Rect, fine: [usize; 2]) -> Rect {
        let along = |x: usize, fine: usize| x.saturating_sub(self.first(fine)).div_ceil(self.factor);
        let (x, y) = ([rect.x0, rect.x1], [rect.y0, rect.y1]);
        let ([x0, x1], [y0, y1]) = (x.map(|x| along(x, fine[0])), y.map(|y| along(y, fine[1])));
        Rect { x0, y0, x1: x1.max(x0), y1: y1.max(y0) }
    }

    /// The fine pixels that lie nearer to a coarse box (of a pixel at least) than to the pixels around it.
    pub fn covered_by(self, part: Rect, fine: [usize; 2]) -> Rect {
        let along = |from: usize, to: usize, fine: usize| {
            let at = |x: usize| self.first(fine) + x * self.factor;
            (at(from).saturating_sub(self.factor / 2), (at(to - 1) + self.factor / 2 + 1).min(fine))
        };
        let ((x0, x1), (y0, y1)) = (along(part.x0, part.x1, fine[0]), along(part.y0, part.y1, fine[1]));
        Rect { x0, y0, x1, y1 }
    }

    /// Interpolates at the fine pixels `rect` of an image of size `fine`. `values` are the coarse pixels `part`; beyond
    /// them the outermost go on.
    pub fn enlarge(self, values: &Grid<f32>, part: Rect, rect: Rect, fine: [usize; 2], shape: Shape) -> Grid<f32> {
        let Self { factor } = self;
        let (left, columns) = self.coarse_around(rect.x0, rect.x1, fine[0], part.x0, part.width());
        let (top, rows) = self.coarse_around(rect.y0, rect.y1, fine[1], part.y0, part.height());
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

    /// For the fine pixels `from..to` of a line of `fine`: how many fine pixels the first of them is past a coarse one,
    /// and which coarse pixels, counted from `start` and kept within `count`, they lie between.
    fn coarse_around(self, from: usize, to: usize, fine: usize, start: usize, count: usize) -> (usize, Vec<usize>) {
        let ahead = from as isize - self.first(fine) as isize;
        let first = ahead.div_euclid(self.factor as isize);
        let past = ahead.rem_euclid(self.factor as isize) as usize;
        let steps = (past + to - from).div_ceil(self.factor);
        let inside = |k: usize| (first + k as isize - start as isize).clamp(0, count as isize - 1) as usize;
        (past, (0..=steps).map(inside).collect())
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
