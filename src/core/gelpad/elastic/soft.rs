//! Objects that are not rigid: pad and object share the overlap by their compliance.
//!
//! Under pressure p of frequency q an object gives way like a half-space, v = 2 (1 - nu^2) / (E q) p (Johnson 1985, section
//! 3.2), and the contact's pressure is the one under which w + v >= g, w being the pad's displacement. That is solved for with
//! both responses in one. To the pad it is the same as a rigid object of the shape g - v that the object takes: all that
//! comes after the shape is a press of that one, and friction acts on it.

use serde::{Deserialize, Serialize};

use super::resample::Shape;
use super::response::{Memory, Response};
use super::shear::Friction;
use super::walls::Thinned;
use super::{Elastic, Given, Pad};
use crate::base::grid::{Grid, Rect};
use crate::depth::{Depth, Window};
use crate::gelpad::total_contact::Beyond;

/// What an object is made of that is not rigid.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
pub struct ElasticObject {
    /// Young's modulus, kPa, above 0.
    pub youngs_modulus_kpa: f64,
    /// Poisson ratio, 0 to 0.5.
    pub poisson_ratio: f64,
}

impl ElasticObject {
    /// What a displacement is times frequency, under pressure 1 in units of a pad's Young's modulus.
    fn half_space(self, pad_youngs_modulus_kpa: f64) -> f64 {
        2.0 * (1.0 - self.poisson_ratio * self.poisson_ratio) * pad_youngs_modulus_kpa / self.youngs_modulus_kpa
    }
}

/// An object in the shape that it takes under its load.
pub struct Yielded {
    /// Its depth map.
    pub depth: Depth,
    /// The shape was solved for within the tolerance.
    pub solved: bool,
}

impl Pad {
    /// The same pad under an object of its own material. Friction is the object's where there is any.
    pub fn under(&self, friction: Option<Friction>, soft: Option<ElasticObject>) -> Self {
        let friction = self.elastic.friction.map(|held| friction.unwrap_or(held));
        let elastic = Elastic { friction, ..self.elastic };
        Self { elastic, object: soft.map(|soft| soft.half_space(self.youngs_modulus_kpa)), ..self.clone() }
    }

    /// How an object gives way: what its displacement is times frequency, under pressure 1 at Young's modulus 1; none if it is
    /// rigid.
    pub(super) fn object(&self) -> Option<f64> {
        self.object
    }

    /// The shape that the object takes, captured in `window`; `None` if it keeps its own.
    pub fn yielded(&self, depth: &Depth, beyond: Option<&Beyond>, window: Window) -> Option<Yielded> {
        let half_space = self.object?;
        if depth.touching.is_empty() && beyond.is_none_or(|beyond| beyond.object_gives.is_none()) {
            return None;
        }
        let mut depth = depth.clone();
        if let Some(gives) = beyond.and_then(|beyond| beyond.object_gives.as_ref()) {
            lower(&mut depth, gives, window);
        }
        let solved = self.shape(&mut depth, half_space, beyond, window);
        depth.measure();
        Some(Yielded { depth, solved })
    }

    fn shape(&self, depth: &mut Depth, half_space: f64, beyond: Option<&Beyond>, window: Window) -> bool {
        let lattice = self.lattice(depth);
        let [width, height] = lattice.size();
        // A coarser grid may have a pixel more.
        let both = self.softened(half_space, [width + 2, height + 2]);
        let Thinned { mut penetration, mut cut } = both.thinned(depth, lattice);
        if lattice.factor == 1 {
            penetration.clone_from(&depth.penetration);
        }
        let beyond = beyond.and_then(|beyond| beyond.displacement.as_ref());
        Given { beyond, drag: None }.add_to(&mut penetration, self.placed(depth, lattice), lattice, [0; 2], -1.0);
        let solution = both.solve(&penetration, &mut cut, Rect::default(), None);
        if !solution.contact_box.is_empty() {
            let alone = self.response.object_alone(half_space, [width, height]);
            let whole = Rect::whole(width, height);
            let operator = alone.operator(solution.contact_box, whole);
            let (mut memory, mut gives) = (Memory::default(), Grid::default());
            operator.prepare(&mut memory);
            operator.displace(&solution.pressure, &mut memory, &mut gives);
            if lattice.factor > 1 {
                let fine = Rect::whole(depth.penetration.width, depth.penetration.height);
                let coarse = std::mem::take(&mut gives);
                lattice.enlarge(&coarse, whole, fine, Shape::Cubic, &mut gives);
            }
            lower(depth, &gives, window);
        }
        solution.converged
    }

    /// The pad with an object that gives way on top, as one body; on grids of up to so many pixels.
    pub(super) fn softened(&self, half_space: f64, most: [usize; 2]) -> Self {
        let coarser = self.coarser.as_ref().map(|coarser| Box::new(coarser.softened(half_space, most)));
        // What is left wrong is the pad's share of it.
        let share = self.layer.half_space() / (self.layer.half_space() + half_space);
        let elastic = Elastic { tolerance_um: self.elastic.tolerance_um * share, ..self.elastic };
        Self { elastic, response: self.response.softened(half_space, most).into(), coarser, ..self.clone() }
    }
}

/// Takes off what an object gives. What was not captured stays so.
fn lower(depth: &mut Depth, gives: &Grid<f32>, window: Window) {
    let ceiling = 0.0 - window.above_mm as f32;
    for (penetration, gives) in depth.penetration.data.iter_mut().zip(&gives.data) {
        *penetration = (*penetration - gives).max(ceiling);
    }
}

impl Response {
    /// That of an object alone, which gives way like a half-space.
    pub(super) fn object_alone(&self, half_space: f64, most: [usize; 2]) -> Self {
        self.and_object(half_space, most, None)
    }

    /// This and that of an object, in one.
    pub(super) fn softened(&self, half_space: f64, most: [usize; 2]) -> Self {
        self.and_object(half_space, most, Some(self.kernel()))
    }
}
