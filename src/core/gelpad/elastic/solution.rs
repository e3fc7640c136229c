//! What the solver found on its own grid, and what displaced the pad before it.

use super::friction::{Drag, Placed};
use super::lattice::Lattice;
use super::walls::CutPixel;
use crate::base::grid::{Grid, Rect};
use crate::base::simd::{largest, simd_dispatch};

/// Pressure and displacement on the solver's grid.
pub(super) struct Solution {
    pub contact_box: Rect,
    /// In `contact_box`, for Young's modulus 1.
    pub pressure: Grid<f32>,
    /// Where `displacement` is known.
    pub seen: Rect,
    /// mm.
    pub displacement: Grid<f32>,
    pub converged: bool,
    pub iterations: u32,
    pub residual_mm: f32,
}

/// What displaces the pad before the press.
#[derive(Clone, Copy, Debug, Default)]
pub struct Given<'a> {
    /// What loads beyond the window displace, mm, on the grid of the overlap.
    pub beyond: Option<&'a Grid<f32>>,
    /// What friction under the object displaces.
    pub drag: Option<&'a Drag>,
}

impl Given<'_> {
    pub(super) fn is_nothing(self) -> bool {
        self.beyond.is_none() && self.drag.is_none()
    }

    /// Adds it, times `factor`, to a grid whose first pixel is pixel `corner` of the solver's grid `lattice`.
    pub(super) fn add_to(
        self,
        target: &mut Grid<f32>,
        placed: Placed,
        lattice: Lattice,
        corner: [usize; 2],
        factor: f32,
    ) {
        if let Some(beyond) = self.beyond {
            let [x0, y0] = corner;
            let part = Rect { x0, y0, x1: x0 + target.width, y1: y0 + target.height };
            let there = lattice.thin_out_part(beyond, part);
            target.data.iter_mut().zip(&there.data).for_each(|(w, given)| *w += factor * given);
        }
        if let Some(drag) = self.drag {
            drag.add_to(target, placed, corner, factor);
        }
    }
}

impl Solution {
    /// Where walls cut pixels that give way no more, the displacement at their centres.
    pub fn settle(&mut self, penetration: &Grid<f32>, cut: &[CutPixel]) {
        let (part, seen) = (self.contact_box, self.seen);
        for pixel in cut.iter().filter(|pixel| pixel.stopped && part.holds(pixel.at) && seen.holds(pixel.at)) {
            let [x, y] = pixel.at;
            let pressure = self.pressure.at(x - part.x0, y - part.y0);
            if pressure > 0.0 {
                self.displacement.row_mut(y - seen.y0)[x - seen.x0] = penetration.at(x, y) - pixel.settles(pressure);
            }
        }
    }

    /// Notes the largest violation of the contact conditions, where pixels that a wall cuts may give way; where,
    /// outside the contact's box, the object reaches through the surface by more than `accepted`.
    pub fn check(&mut self, penetration: &Grid<f32>, cut: &[CutPixel], accepted: f32) -> Rect {
        let Rect { x0, x1, .. } = self.seen;
        let mut missed = Rect::default();
        let mut touching = vec![0.0; x1 - x0];
        let mut gives = vec![0.0; x1 - x0];
        // Row by row, as here.
        let mut cut = cut.iter().peekable();
        self.residual_mm = 0.0;
        for y in self.seen.y0..self.seen.y1 {
            let inside = (self.contact_box.y0..self.contact_box.y1).contains(&y);
            touching.fill(0.0);
            gives.fill(0.0);
            if inside {
                let row = self.pressure.row(y - self.contact_box.y0);
                touching[self.contact_box.x0 - x0..][..row.len()].copy_from_slice(row);
                while let Some(pixel) = cut.next_if(|pixel| pixel.at[1] <= y) {
                    let column = pixel.at[0].wrapping_sub(x0);
                    if pixel.at[1] == y && column < gives.len() {
                        gives[column] = pixel.gives_way(touching[column]);
                    }
                }
            }
            let (w, g) = (self.displacement.row(y - self.seen.y0), &penetration.row(y)[x0..x1]);
            let (worst, through) = simd_dispatch(
                #[inline(always)]
                || {
                    let gaps = || w.iter().zip(g).zip(&gives).map(|((w, g), gives)| w + gives - g);
                    let wrong = |(gap, p): (f32, &f32)| if *p > 0.0 { gap.abs() } else { -gap };
                    (largest(gaps().zip(&touching).map(wrong)), largest(gaps().map(|gap| -gap)))
                },
            );
            self.residual_mm = self.residual_mm.max(worst);
            if through > accepted {
                for (x, (w, g)) in (x0..x1).zip(w.iter().zip(g)) {
                    let boxed = inside && (self.contact_box.x0..self.contact_box.x1).contains(&x);
                    if !boxed && g - w > accepted {
                        missed = missed.united(Rect { x0: x, y0: y, x1: x + 1, y1: y + 1 });
                    }
                }
            }
        }
        missed
    }
}
