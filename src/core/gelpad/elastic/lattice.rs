//! Which of the camera's pixels each pixel of a coarser grid consists of. The blocks are centred on the image, so that
//! the grid of a mirror image is the mirror image of the grid.

use std::ops::Range;

use crate::base::grid::{Rect, Resolution};

/// The coarse pixels over an image.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Lattice {
    /// Fine pixels per coarse pixel along an axis: 1, 2 or 4.
    pub factor: usize,
    /// Twice the fine column and row of the first coarse pixel's centre; odd if the centre lies between two fine
    /// pixels.
    pub first_twice: [isize; 2],
    /// Fine columns and rows.
    fine_size: [usize; 2],
}

impl Lattice {
    /// Makes the lattice of a resolution over an image of `fine` pixels.
    pub fn new(resolution: Resolution, fine: [usize; 2]) -> Self {
        let factor = resolution.factor();
        let across = |size: usize| (size / factor).max(1) * factor;
        let first_twice = fine.map(|size| size as isize - across(size) as isize + factor as isize - 1);
        Self { factor, first_twice, fine_size: fine }
    }

    /// Returns the fine column (k = 0) or row (k = 1) of a coarse pixel's centre, a multiple of one half.
    pub fn centre_px(self, coarse: usize, k: usize) -> f64 {
        0.5 * self.centre_twice(coarse, k) as f64
    }

    /// Returns twice the fine column or row of a coarse pixel's centre, a whole number.
    fn centre_twice(self, coarse: usize, k: usize) -> isize {
        self.first_twice[k] + (2 * coarse * self.factor) as isize
    }

    /// Returns the fine columns or rows from `from` / 2 to `to` / 2, each rounded down and kept within the image.
    fn fine_range(self, from: isize, to: isize, k: usize) -> Range<usize> {
        let inside = |twice: isize| twice.div_euclid(2).clamp(0, self.fine_size[k] as isize - 1) as usize;
        inside(from)..inside(to) + 1
    }

    /// Returns the fine columns or rows at a coarse pixel's centre: one, or the two beside it.
    pub fn fine_at_centre(self, coarse: usize, k: usize) -> Range<usize> {
        let twice = self.centre_twice(coarse, k);
        self.fine_range(twice, twice + 1, k)
    }

    /// Returns the fine columns or rows in a coarse pixel, and whether the first and last of them count by half.
    pub fn fine_within(self, coarse: usize, k: usize) -> (Range<usize>, bool) {
        let twice = self.centre_twice(coarse, k);
        let halves = twice % 2 == 0 && self.factor > 1;
        let reach = self.factor as isize - isize::from(!halves);
        (self.fine_range(twice - reach, twice + reach, k), halves)
    }

    /// Returns the number of coarse columns and rows.
    pub fn size(self) -> [usize; 2] {
        self.fine_size.map(|size| (size / self.factor).max(1))
    }

    /// Returns the last coarse pixel whose centre is not beyond a fine column or row (below 0 before the first one),
    /// and the distance from that centre in half fine pixels.
    pub fn coarse_before(self, fine: usize, k: usize) -> (isize, usize) {
        let (ahead, step) = (2 * fine as isize - self.first_twice[k], 2 * self.factor as isize);
        (ahead.div_euclid(step), ahead.rem_euclid(step) as usize)
    }

    /// Returns the coarse box around a fine one, with everything that interpolating in it needs.
    pub fn coarse_box_around(self, rect: Rect) -> Rect {
        let size = self.size();
        let around = |k: usize, from: usize, to: usize| {
            let at = |x: usize| self.coarse_before(x, k).0.max(0) as usize;
            (at(from).saturating_sub(1).min(size[k] - 1), (at(to - 1) + 3).min(size[k]))
        };
        let ((x0, x1), (y0, y1)) = (around(0, rect.x0, rect.x1), around(1, rect.y0, rect.y1));
        Rect { x0, y0, x1, y1 }
    }

    /// Returns the coarse pixels whose centres lie in `rect`.
    pub fn coarse_inside(self, rect: Rect) -> Rect {
        let size = self.size();
        // The first coarse pixel whose centre is not before the border between two fine pixels.
        let along = |k: usize, x: usize| {
            let (ahead, step) = (2 * x as isize - 1 - self.first_twice[k], 2 * self.factor as isize);
            (-(-ahead).div_euclid(step)).clamp(0, size[k] as isize) as usize
        };
        let ([x0, x1], [y0, y1]) = ([rect.x0, rect.x1].map(|x| along(0, x)), [rect.y0, rect.y1].map(|y| along(1, y)));
        Rect { x0, y0, x1: x1.max(x0), y1: y1.max(y0) }
    }

    /// Returns the fine pixels in a coarse box of at least one pixel.
    pub fn fine_box_of(self, part: Rect) -> Rect {
        let along =
            |k: usize, from: usize, to: usize| (self.fine_within(from, k).0.start, self.fine_within(to - 1, k).0.end);
        let ((x0, x1), (y0, y1)) = (along(0, part.x0, part.x1), along(1, part.y0, part.y1));
        Rect { x0, y0, x1, y1 }
    }
}
