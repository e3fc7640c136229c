//! Objects that are not rigid: pad and object share the penetration by their compliances.
//!
//! Under a pressure p of frequency q an object deforms like a half-space, v = 2 (1 - nu^2) / (E q) p (Johnson 1985,
//! section 3.2). The contact's pressure is the one under which w + v >= g, w being the pad's displacement; it is solved
//! for with both responses added. For the pad this equals a rigid object of the deformed shape g - v. Everything after
//! finding that shape is a press of this rigid object, including friction.

use serde::{Deserialize, Serialize};

use super::downsampled_object::DownsampledObject;
use super::resample::Interpolation;
use super::response::{OperatorBuffers, PressureResponse};
use super::shear::Friction;
use super::{Elastic, ElasticPad, PriorDisplacement};
use crate::base::grid::{Grid, Rect};
use crate::depth::{CaptureWindow, Depth};
use crate::gelpad::finite_strain::StrainSettings;
use crate::gelpad::total_contact::OutsideWindow;

/// Material of an object that is not rigid.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
pub struct ElasticObject {
    /// Young's modulus, kPa, above 0.
    pub youngs_modulus_kpa: f64,
    /// Poisson ratio, 0 to 0.5.
    pub poisson_ratio: f64,
}

impl ElasticObject {
    /// Returns displacement times frequency under pressure 1, in units of a pad's Young's modulus.
    fn half_space_compliance(self, pad_youngs_modulus_kpa: f64) -> f64 {
        2.0 * (1.0 - self.poisson_ratio * self.poisson_ratio) * pad_youngs_modulus_kpa / self.youngs_modulus_kpa
    }
}

/// An object in the shape that it takes under its load.
pub struct DeformedObject {
    /// Depth map of the deformed object.
    pub depth: Depth,
    /// True if the shape was solved for within the tolerance.
    pub converged: bool,
}

impl ElasticPad {
    /// Returns the pad under an object of its own material. The object's friction replaces the pad's, if the pad has
    /// any.
    pub fn with_object_material(&self, friction: Option<Friction>, soft: Option<ElasticObject>) -> Self {
        let friction = self.elastic.friction.map(|held| friction.unwrap_or(held));
        let elastic = Elastic { friction, ..self.elastic };
        let strain = self.strain.map(|strain| StrainSettings { stick: friction == Some(Friction::Stick), ..strain });
        Self {
            elastic,
            strain,
            object_compliance: soft.map(|soft| soft.half_space_compliance(self.youngs_modulus_kpa)),
            ..self.clone()
        }
    }

    /// Returns the object's displacement times frequency under pressure 1, for Young's modulus 1; `None` if it is
    /// rigid.
    pub(super) fn object_compliance(&self) -> Option<f64> {
        self.object_compliance
    }

    /// Solves for the shape that the object takes, captured in `window`; `None` if it keeps its shape.
    pub fn deform_object(
        &self,
        depth: &Depth,
        outside: Option<&OutsideWindow>,
        window: CaptureWindow,
    ) -> Option<DeformedObject> {
        let half_space = self.object_compliance?;
        if depth.touching.is_empty() && outside.is_none_or(|outside| outside.object_displacement.is_none()) {
            return None;
        }
        let mut depth = depth.clone();
        if let Some(displacement) = outside.and_then(|outside| outside.object_displacement.as_ref()) {
            subtract_object_displacement(&mut depth, displacement, window);
        }
        let converged = self.solve_object_shape(&mut depth, half_space, outside, window);
        depth.measure();
        Some(DeformedObject { depth, converged })
    }

    fn solve_object_shape(
        &self,
        depth: &mut Depth,
        half_space: f64,
        outside: Option<&OutsideWindow>,
        window: CaptureWindow,
    ) -> bool {
        let lattice = self.solver_lattice(depth);
        let [width, height] = lattice.size();
        // A coarser grid may have one pixel more.
        let both = self.with_object(half_space, [width + 2, height + 2]);
        let DownsampledObject { mut penetration, partial_pixels: mut cut } = both.downsample_object(depth, lattice);
        if lattice.factor == 1 {
            penetration.clone_from(&depth.penetration);
        }
        let outside = outside.and_then(|outside| outside.displacement.as_ref());
        PriorDisplacement { outside, ..PriorDisplacement::default() }.add_to(
            &mut penetration,
            self.grid_placement(depth, lattice),
            lattice,
            [0; 2],
            -1.0,
        );
        let solution = both.solve_contact(&penetration, &mut cut, Rect::default(), None);
        if !solution.contact_box.is_empty() {
            let alone = self.response.object_alone(half_space, [width, height]);
            let whole = Rect::whole(width, height);
            let operator = alone.operator(solution.contact_box, whole);
            let (mut memory, mut displacement) = (OperatorBuffers::default(), Grid::default());
            operator.prepare(&mut memory);
            operator.displace(&solution.pressure, &mut memory, &mut displacement);
            if lattice.factor > 1 {
                let fine = Rect::whole(depth.penetration.width, depth.penetration.height);
                let coarse = std::mem::take(&mut displacement);
                lattice.upsample(&coarse, whole, fine, Interpolation::Cubic, &mut displacement);
            } else {
                // Where a pixel is stiffer, so is the object.
                let share = alone.kernel().at(0, 0) / both.response.kernel().at(0, 0);
                let Rect { x0, y0, .. } = solution.contact_box;
                for edge in cut.iter().filter(|edge| solution.contact_box.contains(edge.at)) {
                    let [x, y] = edge.at;
                    displacement.row_mut(y)[x] += share * edge.compliance * solution.pressure.at(x - x0, y - y0);
                }
            }
            subtract_object_displacement(depth, &displacement, window);
        }
        solution.converged
    }

    /// Returns the pad and a deformable object on top as one body, on grids of up to `most` pixels.
    pub(super) fn with_object(&self, half_space: f64, most: [usize; 2]) -> Self {
        let coarser = self.coarser.as_ref().map(|coarser| Box::new(coarser.with_object(half_space, most)));
        // The pad takes only its share of the remaining error.
        let share = self.layer.half_space_compliance() / (self.layer.half_space_compliance() + half_space);
        let elastic = Elastic { tolerance_um: self.elastic.tolerance_um * share, ..self.elastic };
        Self { elastic, response: self.response.with_object(half_space, most).into(), coarser, ..self.clone() }
    }
}

/// Subtracts the object's own displacement. Values at the capture's limit, where there is no object, stay at it.
fn subtract_object_displacement(depth: &mut Depth, displacement: &Grid<f32>, window: CaptureWindow) {
    let ceiling = 0.0 - window.above_mm as f32;
    for (penetration, displacement) in depth.penetration.data.iter_mut().zip(&displacement.data) {
        *penetration = (*penetration - displacement).max(ceiling);
    }
}

impl PressureResponse {
    /// Returns the response of an object alone, which deforms like a half-space.
    pub(super) fn object_alone(&self, half_space: f64, most: [usize; 2]) -> Self {
        self.with_object_kernel(half_space, most, None)
    }

    /// Returns the sum of this response and an object's.
    pub(super) fn with_object(&self, half_space: f64, most: [usize; 2]) -> Self {
        self.with_object_kernel(half_space, most, Some(self.kernel()))
    }
}
