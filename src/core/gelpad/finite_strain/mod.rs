//! The pad as rubber at finite strain (neo-Hookean, nearly incompressible), as a correction of the linear layer.
//!
//! The rubber is solved in a box around the contact, on a grid that is coarse beside the camera's (`press`). What it
//! adds to the linear layer under the same pressure is smooth but for walls, and is interpolated (`deformed`,
//! `moved_nodes`). On the camera's grid the press is then the linear layer's, on a pad that this difference has already
//! displaced: the contact, the surface and the pressure stay as sharp as the object is (`correction`).
//!
//! - `element`: the rubber itself, hexahedra with one pressure each;
//! - `layer`: the linear layer of the same elements, by Fourier transforms (`spectrum`), as the preconditioner;
//! - `contact`: contact on the surface, under an object with slopes (`height_map`);
//! - `anderson`: acceleration of the fixed point;
//! - `torus`: values between the nodes of a torus.

use super::Contact;
use super::elastic::placed::PlacedDisplacement;
use crate::base::grid::{Grid, Rect};
use crate::base::view::SURFACE_BORDER;
use crate::depth::Depth;

mod anderson;
mod contact;
mod correction;
mod deformed;
mod element;
mod height_map;
mod layer;
mod moved_nodes;
mod press;
pub mod settings;
mod spectrum;
#[cfg(test)]
mod tests;
mod torus;

pub use correction::WITHIN_TOLERANCE;
pub use settings::{FiniteStrain, StrainSettings};

/// Share of the edges' radius by which an object reaches into rubber that surely touches it.
const SURE_REACH: f32 = 0.1;

/// What rubber at finite strain adds to a linear layer under the same pressure.
#[derive(Clone, Debug)]
pub struct StrainCorrection {
    /// Displacement into the pad, mm.
    pub(super) displacement: PlacedDisplacement,
    /// Motion of the surface's points along x and y, mm.
    pub(super) motion: [PlacedDisplacement; 2],
    /// How far the object, whose edges were rounded for the solver, reaches into rubber at captured pixels beside walls,
    /// mm; 0 elsewhere.
    pub(super) reach_mm: Grid<f32>,
    /// Radius by which the object's edges were rounded, mm.
    pub opened_mm: f64,
    /// True if the surface sticks to the object: the tractions under it are part of the correction.
    pub sticks: bool,
    /// Share of the linear layer's expected error that the corrected one is expected to have.
    pub error_share: f64,
    /// Number of steps of the fixed point, with those of failed tries.
    pub iterations: u32,
    /// Largest change of the surface in the last step, um.
    pub residual_um: f64,
}

impl StrainCorrection {
    /// Lays the surface of a contact on edges that were rounded for the solver. The pressure under a rounded edge, and
    /// the one that the edge itself adds, may leave it deeper than the object beside the edge, though rubber would touch.
    /// `seen` is the surface's part of the captured window.
    pub(super) fn lay_on_edges(&self, depth: &Depth, seen: Rect, contact: &mut Contact) {
        for y in 0..seen.height() {
            let part = |grid: &Grid<f32>, x: usize| grid.at(seen.x0 + x, seen.y0 + y);
            let in_view = |at: usize, count: usize| at.checked_sub(SURFACE_BORDER).filter(|at| *at < count);
            for x in (0..seen.width()).filter(|x| part(&self.reach_mm, *x) > 0.0) {
                let w = &mut contact.surface.row_mut(y)[x];
                let gap_mm = *w - part(&depth.penetration, x);
                let share = self.touching_share(part(&self.reach_mm, x), gap_mm);
                *w -= share * gap_mm;
                let pixel = in_view(x, contact.mask.width).zip(in_view(y, contact.mask.height));
                if let Some((x, y)) = pixel.filter(|_| share > 0.5) {
                    contact.mask.row_mut(y)[x] = 255;
                }
            }
        }
    }

    /// Returns how surely rubber touches the object beside a wall, 0 to 1: by how far the object reaches into it, and by
    /// the gap that the linear layer leaves, mm. A rounded edge leaves gaps up to its radius.
    fn touching_share(&self, reach_mm: f32, gap_mm: f32) -> f32 {
        let radius_mm = self.opened_mm as f32;
        (reach_mm / (SURE_REACH * radius_mm)).min(1.0) * (2.0 - gap_mm / radius_mm).clamp(0.0, 1.0)
    }
}
