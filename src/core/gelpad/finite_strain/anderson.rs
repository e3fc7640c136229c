//! Anderson's acceleration of a fixed point (Anderson 1965; Walker and Ni 2011): the next state is the one whose
//! residual would be least if the iteration were linear between the last ones.

use super::element::State;
use crate::base::simd::{dot_in_eights, simd_dispatch};

/// Number of differences that are kept.
const KEPT: usize = 12;

/// Share of the largest diagonal that is added to the equations, so that differences which hardly differ do no harm.
const REGULARISATION: f64 = 1e-7;

/// Pressure counts as a displacement of this many thicknesses per shear modulus.
const PRESSURE_WEIGHT: f64 = 0.1;

/// Displacements of the contact's finer grid count less: there are more of them.
const SURFACE_WEIGHT: f64 = 0.1;

/// The last differences of states and residuals.
pub struct Anderson {
    thickness_mm: f64,
    residuals: Vec<State>,
    images: Vec<State>,
    /// Products of the residuals' differences with one another.
    products: Vec<Vec<f64>>,
    last: Option<(State, State)>,
}

impl Anderson {
    pub fn new(thickness_mm: f64) -> Self {
        Self { thickness_mm, residuals: Vec::new(), images: Vec::new(), products: Vec::new(), last: None }
    }

    /// Forgets the last state, so that no difference is taken across a jump of the load.
    pub fn jump(&mut self) {
        self.last = None;
    }

    /// Forgets everything.
    pub fn forget(&mut self) {
        *self = Self::new(self.thickness_mm);
    }

    fn product(&self, a: &State, b: &State) -> f64 {
        let weight = (PRESSURE_WEIGHT * self.thickness_mm).powi(2);
        let moved: f64 = (0..3).map(|c| dot(&a.displacement[c], &b.displacement[c])).sum();
        let surface: f64 = (0..3).map(|c| dot(&a.surface[c], &b.surface[c])).sum();
        moved + SURFACE_WEIGHT * surface + weight * dot(&a.pressure, &b.pressure)
    }

    /// Returns the state to go on from, given a state and the one that the iteration makes of it.
    pub fn next(&mut self, state: &State, image: State) -> State {
        let residual = subtract(&image, state);
        if let Some((last_residual, last_image)) = self.last.take() {
            if self.residuals.len() == KEPT {
                self.residuals.remove(0);
                self.images.remove(0);
                self.products.remove(0);
                self.products.iter_mut().for_each(|row| {
                    row.remove(0);
                });
            }
            let change = subtract(&residual, &last_residual);
            let mut row: Vec<f64> = self.residuals.iter().map(|other| self.product(&change, other)).collect();
            row.push(self.product(&change, &change));
            for (products, value) in self.products.iter_mut().zip(&row) {
                products.push(*value);
            }
            self.products.push(row);
            self.residuals.push(change);
            self.images.push(subtract(&image, &last_image));
        }
        let right: Vec<f64> = self.residuals.iter().map(|change| self.product(change, &residual)).collect();
        self.last = Some((residual, image.clone()));
        let mut next = image;
        if let Some(shares) = solve_scaled(&self.products, &right) {
            for (share, image) in shares.iter().zip(&self.images) {
                add_scaled(&mut next, image, -*share as f32);
            }
        }
        next
    }
}

/// Solves symmetric equations whose rows are scaled to a diagonal of 1; `None` without any, or if they are singular.
fn solve_scaled(products: &[Vec<f64>], right: &[f64]) -> Option<Vec<f64>> {
    let n = right.len();
    let scale: Vec<f64> = (0..n).map(|k| 1.0 / libm::sqrt(products[k][k])).collect();
    if n == 0 || scale.iter().any(|scale| !scale.is_finite()) {
        return None;
    }
    // Cholesky's factors.
    let mut lower = vec![vec![0.0; n]; n];
    for i in 0..n {
        for j in 0..=i {
            let more = if i == j { REGULARISATION } else { 0.0 };
            let mut value = products[i][j] * scale[i] * scale[j] + more;
            value -= lower[i].iter().zip(&lower[j]).take(j).map(|(a, b)| a * b).sum::<f64>();
            if i == j && value <= 0.0 {
                return None;
            }
            lower[i][j] = if i == j { libm::sqrt(value) } else { value / lower[j][j] };
        }
    }
    let mut x: Vec<f64> = right.iter().zip(&scale).map(|(right, scale)| right * scale).collect();
    for i in 0..n {
        let sum: f64 = (0..i).map(|k| lower[i][k] * x[k]).sum();
        x[i] = (x[i] - sum) / lower[i][i];
    }
    for i in (0..n).rev() {
        let sum: f64 = (i + 1..n).map(|k| lower[k][i] * x[k]).sum();
        x[i] = (x[i] - sum) / lower[i][i];
    }
    Some(x.iter().zip(&scale).map(|(x, scale)| x * scale).collect())
}

fn parts(state: &State) -> [&[f32]; 7] {
    let State { displacement: [x, y, z], pressure, surface: [a, b, c] } = state;
    [x, y, z, pressure, a, b, c]
}

fn parts_mut(state: &mut State) -> [&mut [f32]; 7] {
    let State { displacement: [x, y, z], pressure, surface: [a, b, c] } = state;
    [x, y, z, pressure, a, b, c]
}

/// Returns a - b.
pub fn subtract(a: &State, b: &State) -> State {
    let mut difference = a.clone();
    add_scaled(&mut difference, b, -1.0);
    difference
}

/// Adds `factor` times another state.
pub fn add_scaled(sum: &mut State, other: &State, factor: f32) {
    for (sum, other) in parts_mut(sum).into_iter().zip(parts(other)) {
        simd_dispatch(
            #[inline(always)]
            move || sum.iter_mut().zip(other).for_each(|(sum, value)| *sum += factor * value),
        );
    }
}

fn dot(a: &[f32], b: &[f32]) -> f64 {
    simd_dispatch(
        #[inline(always)]
        || a.chunks(4096).zip(b.chunks(4096)).map(|(a, b)| dot_in_eights(a, b)).sum(),
    )
}
