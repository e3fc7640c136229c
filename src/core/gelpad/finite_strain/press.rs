//! The rubber layer under an object: load steps, each a fixed point of the linear layer with what rubber adds.
//!
//! A step takes the state, computes what its forces lack to the linear layer's, solves the contact on the displacement
//! that this leaves the surface, and solves the linear layer under the contact's forces. Anderson's acceleration of all
//! of it, with the places where the contact is linearised, makes that converge in some ten steps, whatever the grid.

use super::anderson::{Anderson, add_scaled, subtract};
use super::contact::{ContactGrid, ContactGuess, Field, REFINEMENT, paste_part, take_part};
use super::element::{ElementGrid, State};
use super::height_map::HeightMap;
use super::layer::BoxLayer;
use crate::base::grid::Rect;
use crate::base::simd::simd_dispatch;
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
    /// Steps without progress after which a load step has failed.
    pub patience: u32,
    /// Largest load step, mm. Where a step fails, halves of it are tried.
    pub load_step_mm: f64,
    /// True if points of the surface stay where they first touch the object.
    pub stick: bool,
}

/// Power of the layers' grading: the highest elements are the thinnest.
const GRADING: f64 = 1.5;

/// Smallest load step, as a share of the thickness.
const SMALLEST_STEP: f64 = 0.06;

/// Change of the surface that is accepted before the last load step, mm: where points slide, and where they stay where
/// that load step leaves them.
const INTERMEDIATE_MM: [f64; 2] = [0.02, 0.003];

/// Change of the surface that is accepted where steps get no smaller, tolerances: beside walls, nodes at the contact's
/// edge may come and go for ever, and an object with rounder edges would be solved for in its place, tens of micrometres
/// away.
const STALLED_SHARE: f64 = 4.0;

/// An object at one depth.
struct LoadStep<'a> {
    object: &'a HeightMap,
    /// How far it still is above its final place.
    lifted_mm: f32,
    tolerance_mm: f64,
    /// Where points stay that touch; `None` if they slide.
    anchors: Option<&'a [Vec<f32>; 2]>,
}

/// A converged load step.
#[derive(Clone)]
struct Level {
    depth_mm: f64,
    state: State,
    /// All of the surface on the contact's grid, of which the state has the nodes that may touch.
    surface: Field,
    /// Size of the nodes' force; 0 where they stick.
    pressure: Vec<f32>,
    force: Field,
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
            state: State { surface: [0, 1, 2].map(|_| vec![0.0; options.region.area()]), ..self.layer.grid.rest() },
            surface: self.contact.zeros(),
            pressure: vec![0.0; self.contact.nodes()],
            force: self.contact.zeros(),
        };
        let mut anchors = options.stick.then(|| [0, 1].map(|_| vec![0.0; self.contact.nodes()]));
        let mut before: Option<Level> = None;
        let thickness_mm = self.pad.thickness_mm;
        let mut step = options.load_step_mm.min(deepest);
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
            }
            acceleration.jump();
            let is_last = depth_mm == deepest;
            let intermediate_mm = INTERMEDIATE_MM[usize::from(options.stick)];
            let tolerance_mm = if is_last { options.tolerance_mm } else { options.tolerance_mm.max(intermediate_mm) };
            let lifted_mm = (deepest - depth_mm) as f32;
            if let Some(anchors) = &mut anchors {
                self.set_anchors(anchors, object, [&reached, before.as_ref().unwrap_or(&reached)], (depth_mm, deepest));
            }
            let load = LoadStep { object, lifted_mm, tolerance_mm, anchors: anchors.as_ref() };
            let solved = self.solve_step(&load, options, (&reached, &mut next), &mut press, &mut acceleration);
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
        (press.surface, press.force) = (reached.surface, reached.force);
        press
    }

    /// Sets where points that do not touch yet will stay if they touch in the next load step: where they are when they
    /// first touch.
    ///
    /// As the contact's edge comes nearer, a point's gap falls like the power 3/2 of the distance to it. The last two
    /// load steps say when it will be 0, and how the point moves until then.
    fn set_anchors(
        &self,
        anchors: &mut [Vec<f32>; 2],
        object: &HeightMap,
        [now, before]: [&Level; 2],
        (depth_mm, deepest_mm): (f64, f64),
    ) {
        let [width, _] = self.contact_size();
        let per_mm = self.contact.spacing_mm.map(|mm| (1.0 / mm) as f32);
        let gap = |level: &Level, at: usize| {
            let [x, y, z] = [0, 1, 2].map(|c| level.surface[c][at]);
            let place = [(at % width) as f32 + x * per_mm[0], (at / width) as f32 + y * per_mm[1]];
            ((deepest_mm - level.depth_mm) as f32 - object.at(place).height_mm - z).max(0.0)
        };
        let passed = now.depth_mm - before.depth_mm;
        let ahead = if passed > 0.0 { ((depth_mm - now.depth_mm) / passed) as f32 } else { 0.0 };
        for at in (0..now.force[2].len()).filter(|at| now.force[2][*at] >= 0.0) {
            let [wide, narrow] = [before, now].map(|level| libm::powf(gap(level, at), 2.0 / 3.0));
            // In shares of the next load step.
            let until = if wide > narrow { (narrow / (ahead * (wide - narrow))).min(1.0) } else { 0.5 };
            for (c, anchors) in anchors.iter_mut().enumerate() {
                let (now, before) = (now.surface[c][at], before.surface[c][at]);
                anchors[at] = now + until * ahead * (now - before);
            }
        }
    }

    /// Iterates at one depth, from a guess made of the last one reached; returns whether it converged.
    fn solve_step(
        &mut self,
        load: &LoadStep<'_>,
        options: &PressOptions,
        (reached, level): (&Level, &mut Level),
        press: &mut RubberPress,
        acceleration: &mut Anderson,
    ) -> bool {
        let mut remainder = self.layer.grid.rest();
        let mut image = self.layer.grid.rest();
        let [mut free, mut box_surface] = [0, 1].map(|_| self.contact.zeros());
        let width = self.contact_size()[0];
        let (mut best, mut waited, mut last) = (f64::INFINITY, 0, level.depth_mm);
        // A step that goes too far is halved, once: most that fail do so at their first steps, and converge from there.
        let mut trusted = Some(reached.state.clone());
        while press.iterations < options.max_iterations {
            press.iterations += 1;
            let smallest = self.layer.grid.remainder(&level.state, &mut remainder);
            if smallest <= 0.0 {
                let Some(trusted) = trusted.take() else { return false };
                go_half_way_back(&mut level.state, &trusted);
                continue;
            }
            if load.anchors.is_none() {
                let surface = self.layer.surface_of(&level.state);
                self.contact.refine(surface, &mut box_surface);
            }
            let surface = self.layer.eliminate(&level.state, &remainder);
            self.contact.refine(surface, &mut free);
            for (whole, part) in level.surface.iter_mut().zip(&level.state.surface) {
                paste_part(part, whole, width, options.region);
            }
            // No closer than the step's own change is worth; the first changes the surface by as much as it is deep.
            let closeness = (0.1 * load.tolerance_mm).max(0.03 * last);
            let Level { surface, force, pressure, .. } = &mut *level;
            let guess = ContactGuess { surface, force, pressure };
            let place = (load.object, load.lifted_mm, options.region);
            match load.anchors {
                None => self.contact.solve(place, [&free, &box_surface], guess, closeness as f32),
                Some(anchors) => self.contact.solve_sticking(place, &free, anchors, guess, closeness as f32),
            }
            for (whole, part) in level.surface.iter().zip(&mut image.surface) {
                *part = take_part(whole, width, options.region);
            }
            let force = self.contact.coarsen(&level.force);
            self.layer.substitute(force, &mut image);
            let plane = self.layer.grid.plane();
            let top = image.pressure.len() - plane;
            let tops = image.displacement.iter().zip(&level.state.displacement);
            let change = tops
                .map(|(now, then)| largest_difference(&now[top..], &then[top..]))
                .chain(image.surface.iter().zip(&level.state.surface).map(|(now, then)| largest_difference(now, then)))
                .fold(0.0, f32::max);
            last = f64::from(change);
            press.residual_mm = last;
            if !last.is_finite() {
                return false;
            }
            if last > self.pad.thickness_mm {
                let Some(trusted) = trusted.take() else { return false };
                go_half_way_back(&mut level.state, &trusted);
                continue;
            }
            let stalled = if waited == options.patience { STALLED_SHARE * options.tolerance_mm } else { 0.0 };
            if last <= load.tolerance_mm.max(stalled) {
                std::mem::swap(&mut level.state, &mut image);
                self.smooth_surface(load, level, &free);
                return true;
            }
            if last < 0.7 * best {
                (best, waited) = (last, 0);
            } else {
                waited += 1;
                if waited > options.patience {
                    return false;
                }
            }
            let mut next = acceleration.next(&level.state, image.clone());
            // A step that would move anything by a third of the pad is cut.
            let moved = next.displacement.iter().zip(&level.state.displacement);
            let moved = moved.map(|(now, then)| largest_difference(now, then)).fold(0.0, f32::max);
            let most = self.pad.thickness_mm as f32 / 3.0;
            if moved > most {
                let change = subtract(&next, &level.state);
                add_scaled(&mut next, &change, most / moved - 1.0);
            }
            trusted = Some(std::mem::replace(&mut level.state, next));
        }
        false
    }

    /// Takes the box's shortest waves from a solution's surface. Nodes that touch stay on the object: they move along it,
    /// or not at all where they stick.
    fn smooth_surface(&self, load: &LoadStep<'_>, level: &mut Level, free: &Field) {
        let [x, y, z] = self.contact.smoothing(free);
        let width = self.contact_size()[0];
        let per_mm = self.contact.spacing_mm.map(|mm| (1.0 / mm) as f32);
        for at in 0..level.pressure.len() {
            let mut change = [x[at], y[at], z[at]];
            let touches = level.force.iter().any(|force| force[at] != 0.0);
            if touches && load.anchors.is_some() {
                continue;
            }
            if touches {
                let place = [(at % width) as f32, (at / width) as f32];
                let normal = load.object.at([0, 1].map(|c| place[c] + level.surface[c][at] * per_mm[c])).normal();
                let away: f32 = (0..3).map(|c| normal[c] * change[c]).sum();
                change = [0, 1, 2].map(|c| change[c] - away * normal[c]);
            }
            for (surface, change) in level.surface.iter_mut().zip(change) {
                surface[at] += change;
            }
        }
    }
}

/// Takes a state half-way back to an earlier one.
fn go_half_way_back(state: &mut State, earlier: &State) {
    let back = subtract(earlier, state);
    add_scaled(state, &back, 0.5);
}

/// Returns the largest difference between numbers; infinite if one is NaN.
fn largest_difference(a: &[f32], b: &[f32]) -> f32 {
    // Non-negative floats are ordered like their bits, and whole numbers are compared eight at a time; NaN is the largest.
    let largest = simd_dispatch(
        #[inline(always)]
        move || {
            let mut largest = 0;
            for (a, b) in a.iter().zip(b) {
                largest = (a - b).abs().to_bits().max(largest);
            }
            largest
        },
    );
    let largest = f32::from_bits(largest);
    if largest.is_nan() { f32::INFINITY } else { largest }
}
