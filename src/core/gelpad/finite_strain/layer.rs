//! The linear layer of the same elements, as the preconditioner of the rubber's equations.
//!
//! Fourier transforms along x and y leave, for each wave, a chain of 3 x 3 blocks from the bottom up. The blocks are
//! real for the vector (ux, uy, -i uz). Pressures are eliminated: with a wave's volume change a . u, they are
//! p = (a . u + g) / (kappa V), where kappa is 1 / lambda and a little more for the waves that the elements cannot
//! resist.

use super::element::{ElementGrid, State};
use super::spectrum::{HalfSpectrum, RealTransform};
use crate::base::simd::simd_dispatch;

/// How soft the pressure of the shortest waves is made, per shear modulus: elements with one pressure have waves of
/// pressure that move nothing.
const STABILISATION: f64 = 0.1;

/// Spectra of x, y and z on one plane of nodes.
pub type PlaneSpectrum = [HalfSpectrum; 3];

/// A layer of elements, factorised for one grid and one Poisson ratio.
pub struct BoxLayer {
    pub grid: ElementGrid,
    pub transform: RealTransform,
    /// For each frequency the volume change under ux and uy, per height, and under uz.
    across: [Vec<f32>; 3],
    /// 1 / kappa.
    stiffness: Vec<f32>,
    /// Cosine and sine of the phase between nodes and the middle of elements.
    phase: [Vec<f32>; 2],
    /// Response of the volume under the surface, per frequency: along x and y.
    facets: [Vec<f32>; 2],
    /// Inverse pivots from the bottom plane up, nine numbers per frequency.
    pivots: Vec<Vec<f32>>,
    /// Blocks below the diagonal of the factor, nine numbers per frequency.
    lower: Vec<Vec<f32>>,
    forces: Vec<PlaneSpectrum>,
    volumes: Vec<HalfSpectrum>,
    top: PlaneSpectrum,
}

/// A 3 x 3 matrix.
pub type Matrix = [[f64; 3]; 3];

/// Returns the inverse of a matrix.
pub fn inverse(m: &Matrix) -> Matrix {
    let minor = |r: usize, c: usize| {
        let (r1, r2, c1, c2) = ((r + 1) % 3, (r + 2) % 3, (c + 1) % 3, (c + 2) % 3);
        m[r1][c1] * m[r2][c2] - m[r1][c2] * m[r2][c1]
    };
    let determinant: f64 = (0..3).map(|c| m[0][c] * minor(0, c)).sum();
    std::array::from_fn(|r| std::array::from_fn(|c| minor(c, r) / determinant))
}

/// Returns a b.
pub fn times(a: &Matrix, b: &Matrix) -> Matrix {
    std::array::from_fn(|r| std::array::from_fn(|c| (0..3).map(|k| a[r][k] * b[k][c]).sum()))
}

impl BoxLayer {
    /// Factorises the layer of a grid of elements.
    pub fn new(grid: ElementGrid, poisson_ratio: f64) -> Self {
        let transform = RealTransform::new(grid.size);
        let (count, layers) = (transform.frequencies(), grid.layers());
        let [dx, dy] = grid.spacing_mm;
        let lambda = 2.0 * poisson_ratio / (1.0 - 2.0 * poisson_ratio);
        let zeros = || vec![0.0_f32; count];
        let mut across = [zeros(), zeros(), zeros()];
        let (mut stiffness, mut phase, mut facets) = (zeros(), [zeros(), zeros()], [zeros(), zeros()]);
        let mut pivots = vec![vec![0.0_f32; 9 * count]; layers];
        let mut lower = pivots.clone();
        for at in 0..count {
            let ([tx, ty], _) = transform.angles(at);
            let [sx, sy] = [tx, ty].map(|t| libm::sin(0.5 * t));
            let [cx, cy] = [tx, ty].map(|t| libm::cos(0.5 * t));
            let along = [sx * cy * dy, cx * sy * dx];
            let up = cx * cy * dx * dy;
            let softening = STABILISATION * (sx * sx * sx * sx + sy * sy * sy * sy);
            let inverse_kappa = lambda / (1.0 + lambda * softening);
            (across[0][at], across[1][at], across[2][at]) = (along[0] as f32, along[1] as f32, up as f32);
            stiffness[at] = inverse_kappa as f32;
            (phase[0][at], phase[1][at]) = (libm::cos(0.5 * (tx + ty)) as f32, libm::sin(0.5 * (tx + ty)) as f32);
            // Stiffness and mass of linear elements along an axis.
            let bend = [4.0 * sx * sx / dx, 4.0 * sy * sy / dy];
            let mass = [dx * (2.0 + libm::cos(tx)) / 3.0, dy * (2.0 + libm::cos(ty)) / 3.0];
            let surface = [libm::sin(tx) * mass[1], libm::sin(ty) * mass[0]];
            (facets[0][at], facets[1][at]) = (surface[0] as f32, surface[1] as f32);
            let (plane, area) = (bend[0] * mass[1] + mass[0] * bend[1], mass[0] * mass[1]);
            let mut below: Option<Matrix> = None;
            let mut diagonal = vec![[[0.0; 3]; 3]; layers];
            let mut coupling = diagonal.clone();
            for (k, dz) in grid.heights_mm.iter().enumerate() {
                let own = plane * dz / 3.0 + area / dz;
                let other = plane * dz / 6.0 - area / dz;
                let weight = (inverse_kappa + 1.0) / (dx * dy * dz);
                let top = [along[0] * dz, along[1] * dz, up];
                let bottom = [along[0] * dz, along[1] * dz, -up];
                for r in 0..3 {
                    for c in 0..3 {
                        let same = if r == c { 1.0 } else { 0.0 };
                        diagonal[k][r][c] += same * own + weight * top[r] * top[c];
                        if k > 0 {
                            diagonal[k - 1][r][c] += same * own + weight * bottom[r] * bottom[c];
                            coupling[k][r][c] = same * other + weight * top[r] * bottom[c];
                        }
                    }
                }
            }
            for k in 0..2 {
                diagonal[layers - 1][k][2] -= surface[k];
                diagonal[layers - 1][2][k] -= surface[k];
            }
            for k in 0..layers {
                let mut pivot = diagonal[k];
                if let Some(below) = below {
                    let factor = times(&coupling[k], &below);
                    for r in 0..3 {
                        for c in 0..3 {
                            pivot[r][c] -= (0..3).map(|j| factor[r][j] * coupling[k][c][j]).sum::<f64>();
                            lower[k][(r * 3 + c) * count + at] = factor[r][c] as f32;
                        }
                    }
                }
                let inverted = inverse(&pivot);
                for r in 0..3 {
                    for c in 0..3 {
                        pivots[k][(r * 3 + c) * count + at] = inverted[r][c] as f32;
                    }
                }
                below = Some(inverted);
            }
        }
        let planes = || [0, 1, 2].map(|_| HalfSpectrum::zeros(count));
        Self {
            across,
            stiffness,
            phase,
            facets,
            pivots,
            lower,
            forces: (0..layers).map(|_| planes()).collect(),
            volumes: (0..layers).map(|_| HalfSpectrum::zeros(count)).collect(),
            top: planes(),
            grid,
            transform,
        }
    }

    /// Returns the compliance of the surface at a frequency, for (fx, fy, -i fz) and displacements alike.
    pub fn surface_compliance(&self, at: usize) -> Matrix {
        let (pivot, count) = (&self.pivots[self.grid.layers() - 1], self.transform.frequencies());
        std::array::from_fn(|r| std::array::from_fn(|c| f64::from(pivot[(r * 3 + c) * count + at])))
    }

    /// Returns the displacement of a state's surface, as (ux, uy, -i uz).
    pub fn surface_of(&mut self, state: &State) -> &PlaneSpectrum {
        let (plane, layers) = (self.grid.plane(), self.grid.layers());
        let surface = |c: usize| &state.displacement[c][(layers - 1) * plane..][..plane];
        let [x, y, z] = &mut self.top;
        self.transform.forward([surface(0), surface(1)], [x, y]);
        self.transform.forward_one(surface(2), z);
        times_minus_i(z);
        &self.top
    }

    /// Takes what a state lacks to the linear layer ([`ElementGrid::remainder`]) and eliminates up to the surface.
    /// Returns the displacement that the surface would have without forces on it, as (ux, uy, -i uz).
    pub fn eliminate(&mut self, state: &State, remainder: &State) -> &PlaneSpectrum {
        let (plane, layers) = (self.grid.plane(), self.grid.layers());
        let [dx, dy] = self.grid.spacing_mm;
        for k in 0..layers {
            let of = |c: usize| &remainder.displacement[c][k * plane..][..plane];
            let [x, y, z] = &mut self.forces[k];
            self.transform.forward([of(0), of(1)], [x, y]);
            let (volumes, pressures) = (&mut self.volumes[k], &remainder.pressure[k * plane..][..plane]);
            self.transform.forward([of(2), pressures], [z, volumes]);
            times_minus_i(z);
            // -i conj(phase) g.
            rotate(volumes, &self.phase, |[re, im], [cos, sin]| [im * cos - re * sin, -re * cos - im * sin]);
        }
        self.surface_of(state);
        let [x, y, z] = &self.top;
        let [force_x, force_y, force_z] = &mut self.forces[layers - 1];
        for (along, (force, moved)) in self.facets.iter().zip([(force_x, x), (force_y, y)]) {
            subtract_product(force, along, z, 1.0);
            subtract_product(force_z, along, moved, 1.0);
        }
        for k in 0..layers {
            let dz = self.grid.heights_mm[k];
            let scale = (1.0 / (dx * dy * dz)) as f32;
            let (below, here) = self.forces.split_at_mut(k);
            let weights = |c: usize| if c < 2 { scale * dz as f32 } else { scale };
            for c in 0..3 {
                condense(&mut here[0][c], &self.across[c], &self.stiffness, &self.volumes[k], weights(c));
                if let Some(below) = below.last_mut() {
                    let sign = if c == 2 { -1.0 } else { 1.0 };
                    condense(&mut below[c], &self.across[c], &self.stiffness, &self.volumes[k], sign * weights(c));
                }
            }
        }
        for k in 1..layers {
            let (below, here) = self.forces.split_at_mut(k);
            subtract_matrix::<false>(&mut here[0], &self.lower[k], &below[k - 1]);
        }
        multiply_matrix(&mut self.top, &self.pivots[layers - 1], &self.forces[layers - 1]);
        &self.top
    }

    /// Adds forces (fx, fy, -i fz) on the surface to what [`Self::eliminate`] left, and writes the state that the
    /// linear layer then has.
    pub fn substitute(&mut self, surface_force: &PlaneSpectrum, state: &mut State) {
        let (plane, layers) = (self.grid.plane(), self.grid.layers());
        let [dx, dy] = self.grid.spacing_mm;
        for (force, more) in self.forces[layers - 1].iter_mut().zip(surface_force) {
            force.re.iter_mut().zip(&more.re).for_each(|(sum, value)| *sum += value);
            force.im.iter_mut().zip(&more.im).for_each(|(sum, value)| *sum += value);
        }
        for k in (0..layers).rev() {
            multiply_matrix(&mut self.top, &self.pivots[k], &self.forces[k]);
            std::mem::swap(&mut self.top, &mut self.forces[k]);
            if k + 1 < layers {
                let (here, above) = self.forces.split_at_mut(k + 1);
                subtract_matrix::<true>(&mut here[k], &self.lower[k + 1], &above[0]);
            }
        }
        for k in 0..layers {
            let dz = self.grid.heights_mm[k] as f32;
            let scale = 1.0 / (dx * dy * self.grid.heights_mm[k]) as f32;
            let volumes = &mut self.volumes[k];
            for c in 0..3 {
                let factor = if c < 2 { dz } else { 1.0 };
                subtract_product(volumes, &self.across[c], &self.forces[k][c], -factor);
                if k > 0 {
                    let factor = if c < 2 { dz } else { -1.0 };
                    subtract_product(volumes, &self.across[c], &self.forces[k - 1][c], -factor);
                }
            }
            let HalfSpectrum { re, im } = volumes;
            for ((re, im), stiffness) in re.iter_mut().zip(im).zip(&self.stiffness) {
                (*re, *im) = (*re * stiffness * scale, *im * stiffness * scale);
            }
            // i phase p.
            rotate(volumes, &self.phase, |[re, im], [cos, sin]| [-re * sin - im * cos, re * cos - im * sin]);
        }
        for k in 0..layers {
            let State { displacement: [x, y, z], pressure, .. } = state;
            let part = k * plane..(k + 1) * plane;
            let [from_x, from_y, from_z] = &mut self.forces[k];
            times_i(from_z);
            self.transform.inverse([from_x, from_y], [&mut x[part.clone()], &mut y[part.clone()]]);
            self.transform.inverse([from_z, &self.volumes[k]], [&mut z[part.clone()], &mut pressure[part]]);
        }
    }
}

/// Multiplies by -i.
pub fn times_minus_i(spectrum: &mut HalfSpectrum) {
    std::mem::swap(&mut spectrum.re, &mut spectrum.im);
    spectrum.im.iter_mut().for_each(|value| *value = -*value);
}

/// Multiplies by i.
pub fn times_i(spectrum: &mut HalfSpectrum) {
    std::mem::swap(&mut spectrum.re, &mut spectrum.im);
    spectrum.re.iter_mut().for_each(|value| *value = -*value);
}

#[inline(always)]
fn rotate(spectrum: &mut HalfSpectrum, phase: &[Vec<f32>; 2], by: impl Fn([f32; 2], [f32; 2]) -> [f32; 2]) {
    let HalfSpectrum { re, im } = spectrum;
    for ((re, im), (cos, sin)) in re.iter_mut().zip(im).zip(phase[0].iter().zip(&phase[1])) {
        [*re, *im] = by([*re, *im], [*cos, *sin]);
    }
}

/// Subtracts `factor` times a real symbol times another spectrum.
fn subtract_product(sum: &mut HalfSpectrum, symbol: &[f32], of: &HalfSpectrum, factor: f32) {
    for (sum, of) in [(&mut sum.re, &of.re), (&mut sum.im, &of.im)] {
        simd_dispatch(
            #[inline(always)]
            || {
                for ((sum, symbol), value) in sum.iter_mut().zip(symbol).zip(of) {
                    *sum -= factor * symbol * value;
                }
            },
        );
    }
}

/// Subtracts the force of the volumes' remainders.
fn condense(force: &mut HalfSpectrum, across: &[f32], stiffness: &[f32], volumes: &HalfSpectrum, factor: f32) {
    for (force, volumes) in [(&mut force.re, &volumes.re), (&mut force.im, &volumes.im)] {
        simd_dispatch(
            #[inline(always)]
            || {
                for ((force, volume), (across, stiffness)) in
                    force.iter_mut().zip(volumes).zip(across.iter().zip(stiffness))
                {
                    *force -= factor * across * stiffness * volume;
                }
            },
        );
    }
}

/// Subtracts matrices (or their transposes) times vectors, one for each frequency.
fn subtract_matrix<const TRANSPOSED: bool>(sum: &mut PlaneSpectrum, matrices: &[f32], of: &PlaneSpectrum) {
    for (r, sum) in sum.iter_mut().enumerate() {
        let count = sum.re.len();
        let entry = |c: usize| &matrices[(if TRANSPOSED { c * 3 + r } else { r * 3 + c }) * count..][..count];
        let rows = [entry(0), entry(1), entry(2)];
        let parts =
            [(&mut sum.re, [&of[0].re, &of[1].re, &of[2].re]), (&mut sum.im, [&of[0].im, &of[1].im, &of[2].im])];
        for (sum, [a, b, c]) in parts {
            let (sum, a, b, c) = (&mut sum[..count], &a[..count], &b[..count], &c[..count]);
            simd_dispatch(
                #[inline(always)]
                || {
                    for at in 0..count {
                        sum[at] -= rows[0][at] * a[at] + rows[1][at] * b[at] + rows[2][at] * c[at];
                    }
                },
            );
        }
    }
}

/// Writes matrices times vectors, one for each frequency.
pub fn multiply_matrix(result: &mut PlaneSpectrum, matrices: &[f32], of: &PlaneSpectrum) {
    for (r, result) in result.iter_mut().enumerate() {
        let count = result.re.len();
        let entry = |c: usize| &matrices[(r * 3 + c) * count..][..count];
        let rows = [entry(0), entry(1), entry(2)];
        let parts =
            [(&mut result.re, [&of[0].re, &of[1].re, &of[2].re]), (&mut result.im, [&of[0].im, &of[1].im, &of[2].im])];
        for (result, [a, b, c]) in parts {
            let (result, a, b, c) = (&mut result[..count], &a[..count], &b[..count], &c[..count]);
            simd_dispatch(
                #[inline(always)]
                || {
                    for at in 0..count {
                        result[at] = rows[0][at] * a[at] + rows[1][at] * b[at] + rows[2][at] * c[at];
                    }
                },
            );
        }
    }
}
