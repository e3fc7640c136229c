//! Which pixels of the camera's grid a coarser one consists of. A coarse pixel is one of the fine ones: taking means would
//! move edges and double the error.

use crate::core::base::grid::{Rect, Resolution};

/// The pixels of a coarse grid over an image.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Lattice {
    /// Fine pixels from one coarse pixel to the next: 1, 2 or 4.
    pub factor: usize,
    /// The fine column and row that the first coarse ones are.
    pub first: [usize; 2],
    /// Fine columns and rows.
    fine: [usize; 2],
}

impl Lattice {
    /// That of a resolution over an image of `fine` pixels.
    pub fn new(resolution: Resolution, fine: [usize; 2]) -> Self {
        let factor = resolution.factor();
        Self { factor, first: fine.map(|count| (factor / 2).min(count.saturating_sub(1))), fine }
    }

    /// The fine column (k = 0) or row that a coarse one is.
    pub fn fine(self, coarse: usize, k: usize) -> usize {
        self.first[k] + coarse * self.factor
    }

    /// Coarse columns and rows.
    pub fn size(self) -> [usize; 2] {
        [0, 1].map(|k| (self.fine[k] - 1 - self.first[k]) / self.factor + 1)
    }

    /// The coarse box around a fine one, and all that interpolating in it needs.
    pub fn box_around(self, rect: Rect) -> Rect {
        let size = self.size();
        let around = |k: usize, from: usize, to: usize| {
            let at = |x: usize| x.saturating_sub(self.first[k]) / self.factor;
            (at(from).saturating_sub(1), (at(to - 1) + 3).min(size[k]))
        };
        let ((x0, x1), (y0, y1)) = (around(0, rect.x0, rect.x1), around(1, rect.y0, rect.y1));
        Rect { x0, y0, x1, y1 }
    }

    /// The coarse pixels that are fine pixels of `rect`.
    pub fn inside(self, rect: Rect) -> Rect {
        let along = |k: usize, x: usize| x.saturating_sub(self.first[k]).div_ceil(self.factor);
        let ([x0, x1], [y0, y1]) = ([rect.x0, rect.x1].map(|x| along(0, x)), [rect.y0, rect.y1].map(|y| along(1, y)));
        Rect { x0, y0, x1: x1.max(x0), y1: y1.max(y0) }
    }

    /// The fine pixels that lie nearer to a coarse box (of a pixel at least) than to the pixels around it.
    pub fn covered_by(self, part: Rect) -> Rect {
        let half = self.factor / 2;
        let along = |k: usize, from: usize, to: usize| {
            (self.fine(from, k).saturating_sub(half), (self.fine(to - 1, k) + half + 1).min(self.fine[k]))
        };
        let ((x0, x1), (y0, y1)) = (along(0, part.x0, part.x1), along(1, part.y0, part.y1));
        Rect { x0, y0, x1, y1 }
    }
}
