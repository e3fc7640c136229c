//! Presses a body of revolution into a layer, in steps, each solved by Newton's method.

use super::contact::ContactSurface;
use super::element::quadratic_shapes;
use super::layer::BondedLayer;
use super::profile::Profile;

/// Longest steps, thicknesses: without friction, and with sticking, where the path matters.
const LONGEST_STEPS: [f64; 2] = [0.027, 0.0167];

/// Iterations of Newton's method after which a step counts as too long.
const MAX_ITERATIONS: usize = 18;
/// Iterations below which the next step is made longer.
const QUICK_ITERATIONS: usize = 7;

/// A press that advances step by step.
pub struct PressSolver<'a> {
    layer: &'a BondedLayer,
    object: &'a Profile,
    surface: ContactSurface,
    thickness: f64,
    longest: f64,
    step: f64,
    state: Vec<f64>,
    depth: f64,
    before: Option<(Vec<f64>, f64)>,
    solves: usize,
}

impl<'a> PressSolver<'a> {
    /// Starts with an object that is about to touch a layer of this thickness, mm.
    pub fn new(layer: &'a BondedLayer, object: &'a Profile, thickness: f64, sticking: bool) -> Self {
        let longest = LONGEST_STEPS[usize::from(sticking)] * thickness;
        Self {
            layer,
            object,
            surface: ContactSurface::new(layer, thickness, sticking),
            thickness,
            longest,
            step: 0.0067 * thickness,
            state: layer.rest_state(),
            depth: 0.0,
            before: None,
            solves: 0,
        }
    }

    /// Solves for the state in balance at a depth by Newton's method from a guess. Returns it with the number of
    /// iterations; `None` if they do not converge.
    fn solve_at_depth(&mut self, mut state: Vec<f64>, depth: f64) -> Option<(Vec<f64>, usize)> {
        for iteration in 0..MAX_ITERATIONS {
            let mut system = self.layer.assemble_system(&state)?;
            self.surface.add_tractions(&mut system, self.layer, &state, self.object, depth);
            self.solves += 1;
            let mut change = system.forces;
            system.matrix.factorize()?.solve(&mut change);
            let largest = self.layer.largest_displacement(&change);
            if largest.is_nan() || largest > 0.67 * self.thickness {
                return None;
            }
            for (state, change) in state.iter_mut().zip(&change) {
                *state -= change;
            }
            if largest < 7e-7 * self.thickness {
                return Some((state, iteration));
            }
        }
        None
    }

    /// Depth that was reached, mm.
    pub fn depth(&self) -> f64 {
        self.depth
    }

    /// Number of systems of equations that were solved.
    pub fn solve_count(&self) -> usize {
        self.solves
    }

    /// Presses to a depth, mm. Returns false if no step is short enough to be solved; what was reached stays.
    pub fn press_to(&mut self, target: f64) -> bool {
        while self.depth < target - 1e-12 {
            let depth = (self.depth + self.step).min(target);
            // Extrapolating the last step gives a better start; if it fails, start from the last state.
            let ahead = self.before.as_ref().map(|(state, at)| {
                let by = (depth - self.depth) / (self.depth - at);
                self.state.iter().zip(state).map(|(now, then)| now + (now - then) * by).collect::<Vec<f64>>()
            });
            let found = ahead
                .and_then(|state| self.solve_at_depth(state, depth))
                .or_else(|| self.solve_at_depth(self.state.clone(), depth));
            let Some((state, iterations)) = found else {
                self.step /= 2.0;
                if self.step < 1.3e-4 * self.thickness {
                    return false;
                }
                continue;
            };
            self.before = Some((std::mem::replace(&mut self.state, state), self.depth));
            self.depth = depth;
            if iterations < QUICK_ITERATIONS {
                self.step = (1.5 * self.step).min(self.longest);
            }
            self.surface.update_anchors(self.layer, &self.state, self.object, depth);
        }
        true
    }

    /// Force along the axis over Young's modulus, mm^2.
    pub fn axial_force(&self) -> f64 {
        self.surface.axial_force(self.layer, &self.state, self.object, self.depth)
    }

    /// Radii of points of the surface from the axis outwards, and whether they touch the object.
    pub fn contact_states(&self) -> Vec<(f64, bool)> {
        self.surface.contact_states(self.layer, &self.state, self.object, self.depth)
    }

    /// Points of the deformed surface from the axis outwards: radius, depth below the layer's highest point at rest,
    /// and displacement outwards, all in mm.
    pub fn surface_line(&self) -> Vec<[f64; 3]> {
        let mut line = Vec::new();
        for column in 0..self.layer.mesh.columns {
            let nodes = self.layer.mesh.surface_nodes(column);
            for k in 0..8 {
                let (shape, _) = quadratic_shapes(-1.0 + k as f64 / 4.0);
                let mut at = [0.0, self.thickness, 0.0];
                for (node, shape) in nodes.into_iter().zip(shape) {
                    let (rest, moved) = (self.layer.mesh.nodes[node], self.layer.node_displacement(&self.state, node));
                    at[0] += shape * (rest[0] + moved[0]);
                    at[1] -= shape * (rest[1] + moved[1]);
                    at[2] += shape * moved[0];
                }
                line.push(at);
            }
        }
        line
    }
}
