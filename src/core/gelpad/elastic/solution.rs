//! The solver's result on its own grid, and the displacements that act on the pad besides the press.

use super::friction::FrictionDisplacement;
use super::lattice::Lattice;
use super::partial_pixels::PartialPixel;
use super::placed::{GridPlacement, PlacedDisplacement};
use crate::base::grid::{Grid, Rect};
use crate::base::simd::{largest_value, simd_dispatch};
use crate::gelpad::finite_strain::StrainCorrection;

/// Pressure and displacement on the solver's grid.
pub(super) struct ContactSolution {
    pub contact_box: Rect,
    /// In `contact_box`, for Young's modulus 1.
    pub pressure: Grid<f32>,
    /// The box in which `displacement` is known.
    pub known_box: Rect,
    /// Displacement, mm.
    pub displacement: Grid<f32>,
    pub converged: bool,
    pub iterations: u32,
    pub residual_mm: f32,
}

/// Displacements of the pad that do not come from the pressure being solved for.
#[derive(Clone, Copy, Debug, Default)]
pub struct PriorDisplacement<'a> {
    /// Displacement by loads outside the window, mm, on the grid of the penetration.
    pub outside: Option<&'a Grid<f32>>,
    /// Displacement by friction under the object.
    pub friction: Option<&'a FrictionDisplacement>,
    /// Displacement by loads that the pad remembers.
    pub remembered: Option<&'a PlacedDisplacement>,
    /// The difference between rubber and a linear layer.
    pub strain: Option<&'a StrainCorrection>,
}

impl PriorDisplacement<'_> {
    pub(super) fn is_empty(self) -> bool {
        self.outside.is_none() && self.friction.is_none() && self.remembered.is_none() && self.strain.is_none()
    }

    /// Adds the displacements, times `factor`, to a grid whose first pixel is pixel `corner` of the solver's grid
    /// `lattice`.
    pub(super) fn add_to(
        self,
        target: &mut Grid<f32>,
        placed: GridPlacement,
        lattice: Lattice,
        corner: [usize; 2],
        factor: f32,
    ) {
        if let Some(outside) = self.outside {
            let [x0, y0] = corner;
            let part = Rect { x0, y0, x1: x0 + target.width, y1: y0 + target.height };
            let there = lattice.downsample_part(outside, part);
            target.data.iter_mut().zip(&there.data).for_each(|(w, value)| *w += factor * value);
        }
        if let Some(drag) = self.friction {
            drag.field.add_to(target, placed, corner, factor);
        }
        if let Some(remembered) = self.remembered {
            remembered.add_to(target, placed, corner, factor);
        }
        if let Some(strain) = self.strain {
            strain.displacement.add_to(target, placed, corner, factor);
        }
    }
}

impl ContactSolution {
    /// Sets the displacement at the centres of stopped pixels, whose compression has reached its limit.
    pub fn settle_stopped_pixels(&mut self, penetration: &Grid<f32>, cut: &[PartialPixel]) {
        let (part, seen) = (self.contact_box, self.known_box);
        for pixel in cut.iter().filter(|pixel| pixel.is_stopped && part.contains(pixel.at) && seen.contains(pixel.at)) {
            let [x, y] = pixel.at;
            let pressure = self.pressure.at(x - part.x0, y - part.y0);
            if pressure > 0.0 {
                self.displacement.row_mut(y - seen.y0)[x - seen.x0] = penetration.at(x, y) - pixel.settled_mm(pressure);
            }
        }
    }

    /// Measures the largest violation of the contact conditions; partial pixels may be compressed. Returns the box of
    /// pixels where, outside the contact's box, the object reaches through the surface by more than `accepted`.
    pub fn check_conditions(&mut self, penetration: &Grid<f32>, cut: &[PartialPixel], accepted: f32) -> Rect {
        let Rect { x0, x1, .. } = self.known_box;
        let mut missed = Rect::default();
        let mut touching = vec![0.0; x1 - x0];
        let mut gives = vec![0.0; x1 - x0];
        // These pixels are sorted by rows, so one pass over them is enough.
        let mut cut = cut.iter().peekable();
        self.residual_mm = 0.0;
        for y in self.known_box.y0..self.known_box.y1 {
            let inside = (self.contact_box.y0..self.contact_box.y1).contains(&y);
            touching.fill(0.0);
            gives.fill(0.0);
            if inside {
                let row = self.pressure.row(y - self.contact_box.y0);
                touching[self.contact_box.x0 - x0..][..row.len()].copy_from_slice(row);
                while let Some(pixel) = cut.next_if(|pixel| pixel.at[1] <= y) {
                    let column = pixel.at[0].wrapping_sub(x0);
                    if pixel.at[1] == y && column < gives.len() {
                        gives[column] = pixel.compression_mm(touching[column]);
                    }
                }
            }
            let (w, g) = (self.displacement.row(y - self.known_box.y0), &penetration.row(y)[x0..x1]);
            let (worst, through) = simd_dispatch(
                #[inline(always)]
                || {
                    let gaps = || w.iter().zip(g).zip(&gives).map(|((w, g), gives)| w + gives - g);
                    let wrong = |(gap, p): (f32, &f32)| if *p > 0.0 { gap.abs() } else { -gap };
                    (largest_value(gaps().zip(&touching).map(wrong)), largest_value(gaps().map(|gap| -gap)))
                },
            );
            self.residual_mm = self.residual_mm.max(worst);
            if through > accepted {
                for (x, (w, g)) in (x0..x1).zip(w.iter().zip(g)) {
                    let boxed = inside && (self.contact_box.x0..self.contact_box.x1).contains(&x);
                    if !boxed && g - w > accepted {
                        missed = missed.union(Rect { x0: x, y0: y, x1: x + 1, y1: y + 1 });
                    }
                }
            }
        }
        missed
    }
}
