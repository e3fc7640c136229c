//! The rubber layer under an object: load steps, each a fixed point of the linear layer with what rubber adds.
//!
//! A step takes the state, computes what its forces lack to the linear layer's, solves the contact on the displacement
//! that this leaves the surface, and solves the linear layer under the contact's forces. Anderson's acceleration makes
//! that converge in some ten steps, whatever the grid.

use super::anderson::{Anderson, add_scaled, subtract};
use super::contact::{ContactGrid, ContactGuess, Field, REFINEMENT};
use super::element::{ElementGrid, State};
use super::height_map::HeightMap;
use super::layer::BoxLayer;
use crate::base::grid::Rect;
use crate::gelpad::elastic::layer::ElasticLayer;

/// The solver for one box, with its memory.
pub struct RubberSolver {
    pad: ElasticLayer,
    layer: BoxLayer,
    contact: ContactGrid,
}

/// A press that was solved for.
pub struct RubberPress {
    /// Displacement of the surface's nodes on the contact's grid along x, y and z (up), mm.
    pub surface: Field,
    /// Force on each node over the shear modulus, mm^2.
    pub force: Field,
    /// Steps of the fixed point, all load steps together.
    pub iterations: u32,
    /// Largest change of the surface in the last step, mm.
    pub residual_mm: f64,
    /// True if that is within the tolerance.
    pub converged: bool,
}

/// How a press is solved.
#[derive(Clone, Copy, Debug)]
pub struct PressOptions {
    /// The nodes that may touch the object.
    pub region: Rect,
    /// Side of a square as large as the contact, mm.
    pub contact_mm: f64,
    /// Largest change of the surface in the last step, mm.
    pub tolerance_mm: f64,
    /// Most steps, all load steps together.
    pub max_iterations: u32,
    /// Largest load step, mm, of presses deeper than `one_step_mm`. Where a step fails, halves of it are tried.
    pub load_step_mm: f64,
    pub one_step_mm: f64,
}

/// Power of the layers' grading: the highest elements are the thinnest.
const GRADING: f64 = 1.5;

/// Smallest load step, as a share of the thickness.
const SMALLEST_STEP: f64 = 0.06;

/// Change of the surface that is accepted before the last load step, mm.
const INTERMEDIATE_MM: f64 = 0.02;

/// Steps of the fixed point without progress after which a load step has failed.
const PATIENCE: u32 = 20;

/// Steps without progress from which on the contact is linearised between the last place and the new one, and those
/// after which it gets closer to the last.
const FREE_WAIT: u32 = 2;
const LONG_WAIT: u32 = 8;

/// An object at one depth.
struct LoadStep<'a> {
    object: &'a HeightMap,
    /// How far it still is above its final place.
    lifted_mm: f32,
    tolerance_mm: f64,
}

/// A converged load step.
#[derive(Clone)]
struct Level {
    depth_mm: f64,
    state: State,
    surface: Field,
    pressure: Vec<f32>,
}

impl RubberSolver {
    /// Prepares a box of `size` nodes `spacing_mm` apart and `layers` elements high.
    pub fn new(pad: ElasticLayer, size: [usize; 2], spacing_mm: [f64; 2], layers: usize) -> Self {
        let height = |k: usize| pad.thickness_mm * (1.0 - libm::pow(1.0 - k as f64 / layers as f64, GRADING));
        let heights_mm = (0..layers).map(|k| height(k + 1) - height(k)).collect();
        let layer = BoxLayer::new(ElementGrid { size, spacing_mm, heights_mm }, pad.poisson_ratio);
        let contact = ContactGrid::new(&layer, pad);
        Self { pad, layer, contact }
    }

    /// Returns the number of nodes of the contact's grid along x and y.
    pub fn contact_size(&self) -> [usize; 2] {
        self.layer.grid.size.map(|size| size * REFINEMENT)
    }

    /// Returns the distance between nodes of the contact's grid, mm.
    pub fn contact_spacing_mm(&self) -> [f64; 2] {
        self.contact.spacing_mm
    }

    /// Returns the surface on the contact's grid, for work on a solution.
    pub fn contact_grid(&mut self) -> &mut ContactGrid {
        &mut self.contact
    }

    /// Presses an object in, as deep as its height map reaches.
    pub fn press(&mut self, object: &HeightMap, options: &PressOptions) -> RubberPress {
        let deepest = f64::from(object.heights_mm().largest(|height| height));
        self.contact.prepare_inverse(self.pad, options.contact_mm);
        let mut reached = Level {
            depth_mm: 0.0,
            state: self.layer.grid.rest(),
            surface: self.contact.zeros(),
            pressure: vec![0.0; self.contact.nodes()],
        };
        let mut before: Option<Level> = None;
        let thickness_mm = self.pad.thickness_mm;
        let mut step = if deepest <= options.one_step_mm { deepest } else { options.load_step_mm };
        let mut press = RubberPress {
            surface: self.contact.zeros(),
            force: self.contact.zeros(),
            iterations: 0,
            residual_mm: f64::INFINITY,
            converged: false,
        };
        let mut acceleration = Anderson::new(self.pad.thickness_mm);
        while reached.depth_mm < deepest {
            let left = deepest - reached.depth_mm;
            let depth_mm = if left < 1.2 * step { deepest } else { reached.depth_mm + step };
            let mut next = Level { depth_mm, ..reached.clone() };
            if let Some(before) = before.as_ref().filter(|before| before.depth_mm > 0.0) {
                // Straight on from the last two load steps.
                let ahead = (depth_mm - reached.depth_mm) / (reached.depth_mm - before.depth_mm);
                add_scaled(&mut next.state, &subtract(&reached.state, &before.state), ahead as f32);
                for c in 0..3 {
                    for ((to, now), then) in next.surface[c].iter_mut().zip(&reached.surface[c]).zip(&before.surface[c])
                    {
                        *to += ahead as f32 * (now - then);
                    }
                }
            }
            acceleration.jump();
            let is_last = depth_mm == deepest;
            let tolerance_mm = if is_last { options.tolerance_mm } else { options.tolerance_mm.max(INTERMEDIATE_MM) };
            let load = LoadStep { object, lifted_mm: (deepest - depth_mm) as f32, tolerance_mm };
            let solved = self.solve_step(&load, options, &mut next, &mut press, &mut acceleration);
            if solved {
                before = Some(std::mem::replace(&mut reached, next));
            } else {
                acceleration.forget();
                step *= 0.5;
                if step < SMALLEST_STEP * thickness_mm || press.iterations >= options.max_iterations {
                    return press;
                }
            }
        }
        press.converged = true;
        press.surface = reached.surface;
        press
    }

    /// Iterates at one depth; returns whether it converged.
    fn solve_step(
        &mut self,
        load: &LoadStep<'_>,
        options: &PressOptions,
        level: &mut Level,
        press: &mut RubberPress,
        acceleration: &mut Anderson,
    ) -> bool {
        let mut remainder = self.layer.grid.rest();
        let mut image = self.layer.grid.rest();
        let mut free = self.contact.zeros();
        let (mut best, mut waited, mut last) = (f64::INFINITY, 0, f64::INFINITY);
        while press.iterations < options.max_iterations {
            press.iterations += 1;
            let smallest = self.layer.grid.remainder(&level.state, &mut remainder);
            if !(smallest > 0.0) {
                return false;
            }
            let surface = self.layer.eliminate(&level.state, &remainder);
            self.contact.refine(surface, &mut free);
            let old = level.surface.clone();
            // No closer than the step's own change is worth.
            let closeness = (0.1 * load.tolerance_mm).max((0.03 * last).min(0.01 * self.pad.thickness_mm));
            let guess =
                ContactGuess { surface: &mut level.surface, force: &mut press.force, pressure: &mut level.pressure };
            self.contact.solve(load.object, load.lifted_mm, options.region, &free, guess, closeness as f32);
            let force = self.contact.coarsen(&press.force);
            self.layer.substitute(force, &mut image);
            let plane = self.layer.grid.plane();
            let top = image.pressure.len() - plane;
            let mut change = 0.0_f32;
            for c in 0..3 {
                let pairs = [
                    (&image.displacement[c][top..], &level.state.displacement[c][top..]),
                    (&level.surface[c][..], &old[c][..]),
                ];
                for (now, then) in pairs {
                    change = now.iter().zip(then).fold(change, |most, (a, b)| most.max((a - b).abs()));
                }
            }
            last = f64::from(change);
            press.residual_mm = last;
            if !last.is_finite() || last > self.pad.thickness_mm {
                return false;
            }
            if last <= load.tolerance_mm {
                std::mem::swap(&mut level.state, &mut image);
                return true;
            }
            if last < 0.7 * best {
                (best, waited) = (last, 0);
            } else {
                waited += 1;
                if waited > PATIENCE {
                    return false;
                }
            }
            // At a sharp edge nodes may hop from one side to the other and back. Where the contact is linearised, they
            // then go only a part of the way.
            let share = if waited < FREE_WAIT { 1.0 } else { 0.5_f32.powi(1 + (waited / LONG_WAIT) as i32) };
            if share < 1.0 {
                for (now, then) in level.surface.iter_mut().zip(&old) {
                    now.iter_mut().zip(then).for_each(|(now, then)| *now = then + share * (*now - then));
                }
            }
            let next = acceleration.next(&level.state, image.clone());
            // A step that would move anything by a third of the pad is cut.
            let moved = (0..3)
                .flat_map(|c| next.displacement[c].iter().zip(&level.state.displacement[c]))
                .fold(0.0_f32, |most, (a, b)| most.max((a - b).abs()));
            let most = self.pad.thickness_mm as f32 / 3.0;
            if moved > most {
                let change = subtract(&next, &level.state);
                add_scaled(&mut level.state, &change, most / moved);
            } else {
                level.state = next;
            }
        }
        false
    }
}
