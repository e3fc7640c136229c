//! A press of a body of revolution into a layer: Newton's method, step by step.

use super::contact::Surface;
use super::element::quadratic;
use super::layer::Layer;
use super::profile::Profile;

/// Longest steps, thicknesses: without friction, and sticking, where the path matters.
const STEPS: [f64; 2] = [0.027, 0.0167];

/// Iterations of Newton's method until a step is called too long.
const ITERATIONS: usize = 18;
/// Iterations below which the next step may be longer.
const QUICK: usize = 7;

/// A press, step by step.
pub struct Press<'a> {
    layer: &'a Layer,
    object: &'a Profile,
    surface: Surface,
    thickness: f64,
    longest: f64,
    step: f64,
    state: Vec<f64>,
    depth: f64,
    before: Option<(Vec<f64>, f64)>,
    solves: usize,
}

impl<'a> Press<'a> {
    /// An object that is about to touch a layer of this thickness.
    pub fn new(layer: &'a Layer, object: &'a Profile, thickness: f64, sticking: bool) -> Self {
        let longest = STEPS[usize::from(sticking)] * thickness;
        Self {
            layer,
            object,
            surface: Surface::new(layer, thickness, sticking),
            thickness,
            longest,
            step: 0.0067 * thickness,
            state: layer.rest(),
            depth: 0.0,
            before: None,
            solves: 0,
        }
    }

    /// Newton's method: the state in balance at a depth, from a guess, and the iterations that it took.
    fn solve(&mut self, mut state: Vec<f64>, depth: f64) -> Option<(Vec<f64>, usize)> {
        for iteration in 0..ITERATIONS {
            let mut system = self.layer.system(&state)?;
            self.surface.add(&mut system, self.layer, &state, self.object, depth);
            self.solves += 1;
            let mut change = system.forces;
            system.matrix.factor()?.solve(&mut change);
            let largest = self.layer.largest(&change);
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

    /// How deep the object is by now, mm.
    pub fn depth(&self) -> f64 {
        self.depth
    }

    /// How many systems of equations were solved.
    pub fn solves(&self) -> usize {
        self.solves
    }

    /// Presses to a depth; false where no step is short enough to be solved. What was reached stays.
    pub fn to(&mut self, target: f64) -> bool {
        while self.depth < target - 1e-12 {
            let depth = (self.depth + self.step).min(target);
            let ahead = self.before.as_ref().map(|(state, at)| {
                let by = (depth - self.depth) / (self.depth - at);
                self.state.iter().zip(state).map(|(now, then)| now + (now - then) * by).collect::<Vec<f64>>()
            });
            let found =
                ahead.and_then(|state| self.solve(state, depth)).or_else(|| self.solve(self.state.clone(), depth));
            let Some((state, iterations)) = found else {
                self.step /= 2.0;
                if self.step < 1.3e-4 * self.thickness {
                    return false;
                }
                continue;
            };
            self.before = Some((std::mem::replace(&mut self.state, state), self.depth));
            self.depth = depth;
            if iterations < QUICK {
                self.step = (1.5 * self.step).min(self.longest);
            }
            self.surface.hold(self.layer, &self.state, self.object, depth);
        }
        true
    }

    /// Force along the axis over Young's modulus, mm^2.
    pub fn force(&self) -> f64 {
        self.surface.force(self.layer, &self.state, self.object, self.depth)
    }

    /// Radii of points of the surface from the axis outwards, and whether they touch the object.
    pub fn touching(&self) -> Vec<(f64, bool)> {
        self.surface.touching(self.layer, &self.state, self.object, self.depth)
    }

    /// Points of the deformed surface from the axis outwards: radius, depth below the highest point of the layer at
    /// rest, and how far they moved outwards, mm.
    pub fn line(&self) -> Vec<[f64; 3]> {
        let mut line = Vec::new();
        for column in 0..self.layer.mesh.columns {
            let nodes = self.layer.mesh.surface(column);
            for k in 0..8 {
                let (shape, _) = quadratic(-1.0 + k as f64 / 4.0);
                let mut at = [0.0, self.thickness, 0.0];
                for (node, shape) in nodes.into_iter().zip(shape) {
                    let (rest, moved) = (self.layer.mesh.nodes[node], self.layer.displacement(&self.state, node));
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
