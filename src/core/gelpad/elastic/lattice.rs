//! Which points of the camera's grid a coarser one consists of.
//!
//! A coarse pixel is one of the fine ones: taking means would move edges and double the error. Which one is the object's
//! to say: the middle of its deepest part is one of them, or the one half a coarse pixel on. So a mirrored scene is solved
//! as the scene is, and one that is moved by whole pixels as well. If that middle lies half-way between two fine pixels, as
//! under an object that is its own mirror image, so do the coarse ones.

use std::cmp::Ordering;

use crate::core::base::grid::{Grid, Rect, Resolution};
use crate::core::base::simd::simd_dispatch;

/// Where an object counts as deep, as a share of its largest overlap.
const DEEP: f32 = 0.9;

/// How near to half-way between two pixels is taken for it, px: so far rounding moves the middle of a symmetric object.
const HALF_WAY: f64 = 1e-3;

/// By how much of the overlap's volume one grid must be better than another.
const BETTER: f64 = 1e-4;

/// The points of a coarse grid.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Lattice {
    /// Fine pixels from one coarse pixel to the next: 1, 2 or 4.
    pub factor: usize,
    /// Along x and y.
    pub(super) axes: [Axis; 2],
}

/// The points of a coarse grid along one axis.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Axis {
    factor: usize,
    /// The fine pixel that the first coarse one is, less than the factor.
    pub(super) first: usize,
    /// Coarse pixels lie half-way between that fine pixel and the next.
    pub(super) between: bool,
    /// The fine pixel at, or just before, the middle of the object's deepest part.
    middle: usize,
}

impl Lattice {
    /// One that knows no object.
    pub fn fixed(resolution: Resolution) -> Self {
        let factor = resolution.factor();
        Self { factor, axes: [Axis { factor, first: factor / 2, between: false, middle: 0 }; 2] }
    }

    /// That of an object whose overlap is above 0 within `touching` only, of four the one on which the overlap's volume is
    /// nearest to what it is. Neighbours that differ by more than `wall_mm` have a wall between them.
    pub fn under(resolution: Resolution, overlap: &Grid<f32>, touching: Rect, wall_mm: f32) -> Self {
        if resolution == Resolution::Full || touching.is_empty() {
            return Self::fixed(resolution);
        }
        let Rect { x0, y0, x1, y1 } = touching;
        let (mut deepest, mut count, mut sums) = (0.0_f32, 0, [0; 2]);
        simd_dispatch(
            #[inline(always)]
            || {
                for y in y0..y1 {
                    let mut lanes = [0.0_f32; 8];
                    let (eights, rest) = overlap.row(y)[x0..x1].as_chunks::<8>();
                    for eight in eights.iter().map(|eight| &eight[..]).chain([rest]) {
                        for (lane, g) in lanes.iter_mut().zip(eight) {
                            *lane = if *g > *lane { *g } else { *lane };
                        }
                    }
                    deepest = lanes.iter().fold(deepest, |deepest, g| deepest.max(*g));
                }
                for y in y0..y1 {
                    let (mut here, mut along) = (0_u32, 0_u32);
                    for (x, g) in (0_u32..).zip(&overlap.row(y)[x0..x1]) {
                        let deep = u32::from(*g >= DEEP * deepest);
                        here += deep;
                        along += deep * x;
                    }
                    count += u64::from(here);
                    sums[0] += u64::from(along);
                    sums[1] += u64::from(here) * (y - y0) as u64;
                }
            },
        );
        let middle = |k: usize, from: usize| from as f64 + sums[k] as f64 / count.max(1) as f64;
        let factor = resolution.factor();
        let (along_x, along_y) = (Axis::at(factor, middle(0, x0)), Axis::at(factor, middle(1, y0)));
        let around = touching.grown(1, overlap.width, overlap.height);
        let volume = |of: &Grid<f32>, rect: Rect| -> f64 {
            let row = |y: usize| of.row(y)[rect.x0..rect.x1].iter().map(|g| f64::from(g.max(0.0))).sum::<f64>();
            (rect.y0..rect.y1).map(row).sum()
        };
        let exact = volume(overlap, around);
        let mut scratch = Grid::default();
        let (mut best, mut least) = (Self { factor, axes: [along_x[0], along_y[0]] }, f64::INFINITY);
        for axes in [[0, 0], [1, 0], [0, 1], [1, 1]].map(|[x, y]| [along_x[x], along_y[y]]) {
            let lattice = Self { factor, axes };
            lattice.thin_out_part(overlap, lattice.inside(around), &mut scratch, wall_mm);
            let found = volume(&scratch, Rect::whole(scratch.width, scratch.height)) * (factor * factor) as f64;
            let missed = (found - exact).abs() / exact;
            // The same to rounding is no better.
            if missed < least - BETTER && (found > 0.0 || least == f64::INFINITY) {
                (best, least) = (lattice, missed);
            }
        }
        best
    }

    /// Where a coarse pixel's centre is along axis `k`, in fine pixels from the first one's centre.
    pub fn place(self, coarse: usize, k: usize) -> f64 {
        let Axis { first, between, .. } = self.axes[k];
        (first + coarse * self.factor) as f64 + if between { 0.5 } else { 0.0 }
    }

    /// Coarse pixels along the sides of an image of `fine` pixels.
    pub fn size(self, fine: [usize; 2]) -> [usize; 2] {
        std::array::from_fn(|k| self.axes[k].count(fine[k]))
    }

    /// The coarse box around a fine one, and all that interpolating in it needs.
    pub fn box_around(self, rect: Rect, fine: [usize; 2]) -> Rect {
        let [x, y] = self.axes;
        let ((x0, x1), (y0, y1)) = (x.around(rect.x0, rect.x1, fine[0]), y.around(rect.y0, rect.y1, fine[1]));
        Rect { x0, y0, x1, y1 }
    }

    /// The coarse pixels that lie on or between fine pixels of `rect`.
    pub fn inside(self, rect: Rect) -> Rect {
        let [x, y] = self.axes;
        let ((x0, x1), (y0, y1)) = (x.inside(rect.x0, rect.x1), y.inside(rect.y0, rect.y1));
        Rect { x0, y0, x1, y1 }
    }

    /// The fine pixels that lie nearer to a coarse box (of a pixel at least) than to the pixels around it.
    pub fn covered_by(self, part: Rect, fine: [usize; 2]) -> Rect {
        let [x, y] = self.axes;
        let ((x0, x1), (y0, y1)) = (x.covered_by(part.x0, part.x1, fine[0]), y.covered_by(part.y0, part.y1, fine[1]));
        Rect { x0, y0, x1, y1 }
    }
}

impl Axis {
    /// The two that are laid by an object whose deepest part has its middle at the fine pixel `middle`, the better one for a
    /// tip first. Either is mirrored as the object is.
    fn at(factor: usize, middle: f64) -> [Self; 2] {
        let below = middle.floor();
        let between = (middle - below - 0.5).abs() <= HALF_WAY;
        let nearest = if between { below } else { (middle + 0.5).floor() } as usize;
        [0, factor / 2].map(|by| Self { factor, first: (nearest + by) % factor, between, middle: nearest })
    }

    /// The fine pixels that a coarse one beside a wall may be, the one at `at` or after it: the nearer to the middle, so that a
    /// wall is no further from where it is on one side than on the other.
    pub(super) fn towards_middle(self, at: usize) -> [usize; 2] {
        match (self.between, at.cmp(&self.middle)) {
            (false, _) | (true, Ordering::Greater) => [at; 2],
            (true, Ordering::Less) => [at + 1; 2],
            (true, Ordering::Equal) => [at, at + 1],
        }
    }

    /// The first fine pixel that is not before the first coarse one.
    pub(super) fn next(self) -> usize {
        self.first + usize::from(self.between)
    }

    /// Coarse pixels in a line of `fine` pixels.
    pub(super) fn count(self, fine: usize) -> usize {
        (fine.saturating_sub(1 + self.next())) / self.factor + 1
    }

    /// The coarse pixels that interpolating at the fine pixels `from..to` of a line of `fine` needs.
    fn around(self, from: usize, to: usize, fine: usize) -> (usize, usize) {
        let at = |x: usize| x.saturating_sub(self.next()) / self.factor;
        (at(from).saturating_sub(1), (at(to - 1) + 3).min(self.count(fine)))
    }

    fn inside(self, from: usize, to: usize) -> (usize, usize) {
        let along = |x: usize| x.saturating_sub(self.first).div_ceil(self.factor);
        let (from, to) = (along(from), along(to.saturating_sub(usize::from(self.between))));
        (from, to.max(from))
    }

    fn covered_by(self, from: usize, to: usize, fine: usize) -> (usize, usize) {
        let (half, at) = (self.factor / 2, |x: usize| self.first + x * self.factor);
        ((at(from) + usize::from(self.between)).saturating_sub(half), (at(to - 1) + half + 1).min(fine))
    }
}
