//! Which pixels of the camera's grid a coarser one consists of: squares of them, in the middle of the image, so that the grid
//! of a mirror image is the mirror image's grid.

use std::ops::Range;

use crate::base::grid::{Rect, Resolution};

/// The pixels of a coarse grid over an image.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Lattice {
    /// Fine pixels from one coarse pixel to the next: 1, 2 or 4.
    pub factor: usize,
    /// Twice the fine column and row of the first coarse pixel's centre: odd if that is between two.
    pub first_twice: [isize; 2],
    /// Fine columns and rows.
    fine: [usize; 2],
}

impl Lattice {
    /// That of a resolution over an image of `fine` pixels.
    pub fn new(resolution: Resolution, fine: [usize; 2]) -> Self {
        let factor = resolution.factor();
        let across = |size: usize| (size / factor).max(1) * factor;
        let first_twice = fine.map(|size| size as isize - across(size) as isize + factor as isize - 1);
        Self { factor, first_twice, fine }
    }

    /// The fine column (k = 0) or row of a coarse pixel's centre, a whole number or one and a half.
    pub fn centre(self, coarse: usize, k: usize) -> f64 {
        0.5 * self.centre_twice(coarse, k) as f64
    }

    /// Twice that, a whole number.
    fn centre_twice(self, coarse: usize, k: usize) -> isize {
        self.first_twice[k] + (2 * coarse * self.factor) as isize
    }

    /// The fine columns or rows from half of one number to half of another, each rounded down.
    fn halved(self, from: isize, to: isize, k: usize) -> Range<usize> {
        let inside = |twice: isize| twice.div_euclid(2).clamp(0, self.fine[k] as isize - 1) as usize;
        inside(from)..inside(to) + 1
    }

    /// The fine columns or rows at that centre: one, or the two beside it.
    pub fn at_centre(self, coarse: usize, k: usize) -> Range<usize> {
        let twice = self.centre_twice(coarse, k);
        self.halved(twice, twice + 1, k)
    }

    /// The fine columns or rows that a coarse pixel holds, and whether the first and last count by half.
    pub fn holds(self, coarse: usize, k: usize) -> (Range<usize>, bool) {
        let twice = self.centre_twice(coarse, k);
        let halves = twice % 2 == 0 && self.factor > 1;
        let reach = self.factor as isize - isize::from(!halves);
        (self.halved(twice - reach, twice + reach, k), halves)
    }

    /// Coarse columns and rows.
    pub fn size(self) -> [usize; 2] {
        self.fine.map(|size| (size / self.factor).max(1))
    }

    /// The coarse pixel whose centre is at a fine column or row or last before it, below 0 before the first, and how far that
    /// is past it, in half pixels.
    pub fn before(self, fine: usize, k: usize) -> (isize, usize) {
        let (ahead, pitch) = (2 * fine as isize - self.first_twice[k], 2 * self.factor as isize);
        (ahead.div_euclid(pitch), ahead.rem_euclid(pitch) as usize)
    }

    /// The coarse box around a fine one, and all that interpolating in it needs.
    pub fn box_around(self, rect: Rect) -> Rect {
        let size = self.size();
        let around = |k: usize, from: usize, to: usize| {
            let at = |x: usize| self.before(x, k).0.max(0) as usize;
            (at(from).saturating_sub(1).min(size[k] - 1), (at(to - 1) + 3).min(size[k]))
        };
        let ((x0, x1), (y0, y1)) = (around(0, rect.x0, rect.x1), around(1, rect.y0, rect.y1));
        Rect { x0, y0, x1, y1 }
    }

    /// The coarse pixels whose centres lie in `rect`.
    pub fn inside(self, rect: Rect) -> Rect {
        let size = self.size();
        // The first whose centre is not before the border between two fine pixels.
        let along = |k: usize, x: usize| {
            let (ahead, pitch) = (2 * x as isize - 1 - self.first_twice[k], 2 * self.factor as isize);
            (-(-ahead).div_euclid(pitch)).clamp(0, size[k] as isize) as usize
        };
        let ([x0, x1], [y0, y1]) = ([rect.x0, rect.x1].map(|x| along(0, x)), [rect.y0, rect.y1].map(|y| along(1, y)));
        Rect { x0, y0, x1: x1.max(x0), y1: y1.max(y0) }
    }

    /// The fine pixels that a coarse box (of a pixel at least) holds.
    pub fn covered_by(self, part: Rect) -> Rect {
        let along = |k: usize, from: usize, to: usize| (self.holds(from, k).0.start, self.holds(to - 1, k).0.end);
        let ((x0, x1), (y0, y1)) = (along(0, part.x0, part.x1), along(1, part.y0, part.y1));
        Rect { x0, y0, x1, y1 }
    }
}
