//! Between the camera's grid and one that is coarser by a whole factor ([`super::lattice`]).

use std::ops::Range;

use super::lattice::Lattice;
use crate::base::grid::{Grid, Rect};
use crate::base::simd::simd_dispatch;

/// How much lower the object may be around four pixels, in their size, to be taken for round.
const ROUND: f32 = 0.5;

impl Lattice {
    /// The overlap at the coarse pixels' centres: a fine pixel's, or what is between those around, of which only what is below
    /// the pad's plane counts; where all are above it, the lowest. How high the object was captured does not matter.
    /// `mm_per_px` is the size of a fine pixel.
    pub fn thin_out(self, fine: &Grid<f32>, mm_per_px: [f64; 2]) -> Grid<f32> {
        let [width, height] = self.size();
        let between = self.at_centre(0, 0).len() == 2 && self.at_centre(0, 1).len() == 2;
        let step_mm = mm_per_px[0].min(mm_per_px[1]) as f32;
        // At a fine pixel's own place nothing is added.
        let per_step = if between { 1.0 / (ROUND * step_mm) } else { f32::INFINITY };
        self.centres(fine, Rect::whole(width, height), |inner, outer| {
            let [a, b, c, d] = inner.map(|g| if g > 0.0 { g } else { 0.0 });
            let mean = 0.25 * ((a + b) + (c + d));
            // A mean of four is below a round object's top. Those around them tell by how much, unless the object ends there.
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

    /// What is at the centres of the coarse pixels `part`.
    pub fn thin_out_part(self, fine: &Grid<f32>, part: Rect) -> Grid<f32> {
        self.centres(fine, part, |[a, b, c, d], _| 0.25 * ((a + b) + (c + d)))
    }

    /// A function of the four fine pixels around the centre of each coarse pixel of `part`, the same ones more than once if there
    /// are fewer, and of the four beyond them along the diagonals: of the nearest ones again at the image's border.
    fn centres(self, fine: &Grid<f32>, part: Rect, of: impl Fn([f32; 4], [f32; 4]) -> f32) -> Grid<f32> {
        let mut coarse = Grid::new(part.width(), part.height());
        if coarse.data.is_empty() {
            return coarse;
        }
        for y in 0..part.height() {
            let rows = self.at_centre(part.y0 + y, 1);
            let around = [rows.start.saturating_sub(1), rows.start, rows.end - 1, rows.end.min(fine.height - 1)];
            let rows = around.map(|row| fine.row(row));
            let out = coarse.row_mut(y);
            let value = |x: usize| {
                let columns = self.at_centre(part.x0 + x, 0);
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
            let (columns, out) = (self.at_centre(part.x0 + inside.start, 0), &mut out[inside]);
            simd_dispatch(
                #[inline(always)]
                || match self.factor {
                    1 => centres_of_row::<1>(rows, columns.clone(), out, &of),
                    2 => centres_of_row::<2>(rows, columns.clone(), out, &of),
                    _ => centres_of_row::<4>(rows, columns.clone(), out, &of),
                },
            );
        }
        coarse
    }

    /// Interpolates at the fine pixels `rect`, into `out`. `values` are the coarse pixels `part`; beyond
    /// them the outermost go on.
    pub fn enlarge(self, values: &Grid<f32>, part: Rect, rect: Rect, shape: Shape, out: &mut Grid<f32>) {
        let bases_down = self.bases(1, shape);
        let slopes = (shape == Shape::Cubic).then(|| Slopes::new(values));
        // First along x in every coarse row, then along y: the second is what is done for all fine pixels.
        let mut rows = self.rows_by(values, slopes.as_ref().map(|slopes| &slopes.x), part, rect, shape);
        let mut steep = slopes.as_ref().map(|Slopes { y, xy, .. }| self.rows_by(y, Some(xy), part, rect, shape));
        out.reshape(rect.width(), rect.height());
        simd_dispatch(
            #[inline(always)]
            || {
                for y in 0..rect.height() {
                    let basis = bases_down[(rows.top + y) % self.factor];
                    let [here, next] = rows.around(y).0;
                    let pairs = out.row_mut(y).iter_mut().zip(here.iter().zip(next));
                    let Some(steep) = &mut steep else {
                        pairs.for_each(|(value, (here, next))| *value = here + basis.next * (next - here));
                        continue;
                    };
                    let [leave, arrive] = steep.around(y).0;
                    for ((value, (here, next)), (leave, arrive)) in pairs.zip(leave.iter().zip(arrive)) {
                        let straight = here + basis.next * (next - here);
                        *value = straight + (basis.leave * leave + basis.arrive * arrive);
                    }
                }
            },
        );
    }

    /// The same along straight lines, a row at a time.
    pub fn rows(self, values: &Grid<f32>, part: Rect, rect: Rect) -> Rows<'_> {
        self.rows_by(values, None, part, rect, Shape::Linear)
    }

    fn rows_by<'a>(
        self,
        values: &'a Grid<f32>,
        slopes: Option<&'a Grid<f32>>,
        part: Rect,
        rect: Rect,
        shape: Shape,
    ) -> Rows<'a> {
        let (left, columns) = self.coarse_around(0, rect.x0, rect.x1, part.x0, part.width());
        let (top, coarse) = self.coarse_around(1, rect.y0, rect.y1, part.y0, part.height());
        let widened = [0, 1].map(|_| vec![0.0; (columns.len() - 1) * self.factor]);
        Rows {
            values,
            slopes,
            bases: self.bases(0, shape),
            line: vec![0.0; columns.len()],
            steepness: vec![0.0; columns.len()],
            columns,
            coarse,
            widened,
            done: 0,
            inside: left..left + rect.width(),
            top,
            factor: self.factor,
            phase: self.phase(1),
        }
    }

    /// How far fine pixels are past where they would be if one were at a coarse pixel's centre: half a pixel or nothing.
    fn phase(self, k: usize) -> f32 {
        if self.first_twice[k] % 2 == 0 { 0.0 } else { 0.5 }
    }

    /// Of each fine pixel between two coarse ones along axis `k`.
    fn bases(self, k: usize, shape: Shape) -> Vec<Basis> {
        (0..self.factor).map(|past| shape.basis((past as f32 + self.phase(k)) / self.factor as f32)).collect()
    }

    /// For the fine pixels `from..to` of a line along axis `k`: how many whole fine pixels the first of them is past a
    /// coarse one, and which coarse pixels, counted from `start` and kept within `count`, they lie between.
    fn coarse_around(self, k: usize, from: usize, to: usize, start: usize, count: usize) -> (usize, Vec<usize>) {
        let (first, past) = self.before(from, k);
        let past = past / 2;
        let steps = (past + to - from).div_ceil(self.factor);
        let inside = |k: usize| (first + k as isize - start as isize).clamp(0, count as isize - 1) as usize;
        (past, (0..=steps).map(inside).collect())
    }
}

/// Values on a coarse grid, interpolated along its rows and, when they are asked for, between them. No more than two rows are
/// kept at a time.
pub struct Rows<'a> {
    values: &'a Grid<f32>,
    /// Slopes along the rows, 0 without them.
    slopes: Option<&'a Grid<f32>>,
    bases: Vec<Basis>,
    /// The coarse columns and rows that the fine ones lie between.
    columns: Vec<usize>,
    coarse: Vec<usize>,
    line: Vec<f32>,
    steepness: Vec<f32>,
    widened: [Vec<f32>; 2],
    /// How many of the coarse rows were widened, or passed over.
    done: usize,
    inside: Range<usize>,
    /// Fine rows from the first coarse one to the first that there is.
    top: usize,
    factor: usize,
    phase: f32,
}

impl Rows<'_> {
    /// The coarse rows above and below fine row `y`, and the share of the lower one. Rows are asked for from the top down.
    #[inline(always)]
    pub fn around(&mut self, y: usize) -> ([&[f32]; 2], f32) {
        let (row, past) = ((self.top + y) / self.factor, (self.top + y) % self.factor);
        for number in self.done.max(row)..row + 2 {
            self.widen(number);
        }
        self.done = row + 2;
        let rows = self.widened.each_ref().map(|row| &row[self.inside.clone()]);
        (rows, (past as f32 + self.phase) / self.factor as f32)
    }

    #[inline(always)]
    fn widen(&mut self, number: usize) {
        self.widened.swap(0, 1);
        let row = self.coarse[number];
        gather(&mut self.line, self.values.row(row), &self.columns);
        if let Some(slopes) = self.slopes {
            gather(&mut self.steepness, slopes.row(row), &self.columns);
        }
        match self.factor {
            2 => interleave::<2>(&self.line, &self.steepness, &self.bases, &mut self.widened[1]),
            _ => interleave::<4>(&self.line, &self.steepness, &self.bases, &mut self.widened[1]),
        }
    }
}

/// [`Lattice::centres`] of pixels within a row, from the one at the fine columns `centre` on, each with a pixel on its right.
#[inline(always)]
fn centres_of_row<const N: usize>(
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

/// `N` values between each two of a line.
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
                    if let ([_, slopes @ .., _], [_, at @ .., _]) = (x.row_mut(row), here) {
                        let around = here.iter().zip(at).zip(&here[2..]);
                        for (slope, ((before, at), after)) in slopes.iter_mut().zip(around) {
                            *slope = limited(at - before, after - at);
                        }
                    }
                    let (above, below) = around(row, height);
                    let rows = values.row(above).iter().zip(here).zip(values.row(below));
                    for (slope, ((before, at), after)) in y.row_mut(row).iter_mut().zip(rows) {
                        *slope = limited(at - before, after - at);
                    }
                }
                for row in 0..height {
                    let (above, below) = around(row, height);
                    let (above, below, here) = (x.row(above), x.row(below), y.row(row));
                    if let [_, slopes @ .., _] = xy.row_mut(row) {
                        let across = here.iter().zip(&here[2..]).zip(above[1..].iter().zip(&below[1..]));
                        for (slope, ((left, right), (above, below))) in slopes.iter_mut().zip(across) {
                            *slope = limited(0.5 * (right - left), 0.5 * (below - above));
                        }
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
    // Not `clamp`, which may panic, so that the compiler would not take eight at a time.
    let mean = (0.5 * (one + other)).max(-most).min(most);
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
