//! Frictionless contact of a rigid object with the pad: pressure p and displacement w = G p such that w >= g, p >= 0 and
//! p (w - g) = 0 at every pixel, g the overlap.
//!
//! Conjugate gradients under bounds (Polonsky and Keer 1999), preconditioned with the inverse response. The plain method
//! needs the more iterations the softer the response differs over the frequencies, which for a thin incompressible
//! layer is without limit; the preconditioner, cut off below the contact's own size, brings that to 4 to 10.

use super::response::{Memory, Operator};
use crate::core::base::grid::Grid;
use crate::core::base::simd::simd_dispatch;

/// What there is to solve.
pub struct ContactProblem<'a> {
    /// From pressure to displacement in the box, and roughly back; prepared for both.
    pub operator: &'a Operator<'a>,
    /// The largest G, mm: what a first guess of the pressure is scaled with.
    pub softest: f32,
    /// Overlap, mm, over the box.
    pub overlap: &'a Grid<f32>,
    /// Largest violation of the conditions that is accepted, mm.
    pub tolerance_mm: f32,
    /// Iterations after which to give up.
    pub max_iterations: u32,
}

/// How a solution came about.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Outcome {
    /// Iterations.
    pub iterations: u32,
    /// Largest penetration outside and distance inside the contact, mm.
    pub residual_mm: f32,
}

/// Memory of the solver, for boxes of any size.
#[derive(Clone, Debug, Default)]
pub struct Scratch {
    /// w.
    pub displacement: Grid<f32>,
    /// w - g in the contact, 0 elsewhere.
    residual: Grid<f32>,
    /// Preconditioned residual, and the one before.
    step: Grid<f32>,
    last_step: Grid<f32>,
    /// Search direction and its displacement.
    direction: Grid<f32>,
    response: Grid<f32>,
}

impl ContactProblem<'_> {
    /// A first guess of the pressure: what each pixel would need on a soft spring of its own.
    pub fn guess(&self, pressure: &mut Grid<f32>) {
        pressure.clone_from(self.overlap);
        for value in &mut pressure.data {
            *value = value.max(0.0) / self.softest;
        }
    }

    /// Improves `pressure` until the conditions hold.
    pub fn solve(&self, pressure: &mut Grid<f32>, scratch: &mut Scratch, memory: &mut Memory) -> Outcome {
        let Scratch { displacement, residual, step, last_step, direction, response } = scratch;
        for grid in [&mut *residual, step, last_step, direction, response] {
            grid.reset(pressure.width, pressure.height);
        }
        self.operator.displace(pressure, memory, displacement);
        let mut outcome = Outcome { iterations: 0, residual_mm: f32::INFINITY };
        let (mut last_product, mut keeps_direction) = (1.0, false);
        loop {
            outcome.residual_mm = violation(pressure, displacement, self.overlap, residual);
            if outcome.residual_mm <= self.tolerance_mm || outcome.iterations == self.max_iterations {
                return outcome;
            }
            outcome.iterations += 1;
            std::mem::swap(step, last_step);
            self.operator.undo(residual, memory, step);
            let product = dot(residual, step);
            // Polak and Ribiere's, from 0 up, so that a step that went wrong is forgotten.
            let share = ((product - dot(residual, last_step)) / last_product).max(0.0);
            let share = if share.is_finite() { share } else { 0.0 };
            turn(direction, step, pressure, if keeps_direction { share as f32 } else { 0.0 });
            last_product = product;
            self.operator.displace(direction, memory, response);
            let curvature = dot(direction, response);
            // No pixel may touch yet, as after a guess that missed all of them.
            let length = if curvature > 0.0 { (dot(residual, direction) / curvature) as f32 } else { 0.0 };
            let changes = advance(pressure, direction, displacement, self.overlap, length, 1.0 / self.softest);
            if length == 0.0 && !changes.joined {
                return outcome;
            }
            keeps_direction = !changes.joined;
            if changes.joined || changes.left {
                self.operator.displace(pressure, memory, displacement);
            } else {
                subtract(displacement, response, length);
            }
        }
    }
}

/// Writes w - g of the contact's pixels to `residual`, 0 elsewhere; the largest violation of the conditions.
fn violation(pressure: &Grid<f32>, displacement: &Grid<f32>, overlap: &Grid<f32>, residual: &mut Grid<f32>) -> f32 {
    // Floats from 0 up are ordered like their bits, and whole numbers are compared eight at a time; NaN comes out on top.
    let mut worst = 0;
    simd_dispatch(
        #[inline(always)]
        || {
            let rows = pressure.data.iter().zip(&displacement.data).zip(&overlap.data).zip(&mut residual.data);
            for (((p, w), g), r) in rows {
                let gap = w - g;
                let touches = *p > 0.0;
                *r = if touches { gap } else { 0.0 };
                let wrong = if touches { gap.abs() } else { (-gap).max(0.0) + gap * 0.0 };
                worst = wrong.to_bits().max(worst);
            }
        },
    );
    f32::from_bits(worst)
}

/// Scalar product. Eight partial sums per row, in f32, whatever the processor; rows are summed in f64, because the
/// squares of 300,000 small numbers do not fit the 24 bits of one sum.
fn dot(a: &Grid<f32>, b: &Grid<f32>) -> f64 {
    let mut total = 0.0;
    simd_dispatch(
        #[inline(always)]
        || {
            for (a, b) in a.data.chunks_exact(a.width).zip(b.data.chunks_exact(b.width)) {
                let mut sums = [0.0_f32; 8];
                let (a, a_rest) = a.as_chunks::<8>();
                let (b, b_rest) = b.as_chunks::<8>();
                for (a, b) in a.iter().zip(b) {
                    for k in 0..8 {
                        sums[k] += a[k] * b[k];
                    }
                }
                for (sum, (a, b)) in sums.iter_mut().zip(a_rest.iter().zip(b_rest)) {
                    *sum += a * b;
                }
                total += sums.iter().map(|sum| f64::from(*sum)).sum::<f64>();
            }
        },
    );
    total
}

/// The next search direction, in the contact only; the step outside it is dropped.
fn turn(direction: &mut Grid<f32>, step: &mut Grid<f32>, pressure: &Grid<f32>, share: f32) {
    simd_dispatch(
        #[inline(always)]
        || {
            for ((t, z), p) in direction.data.iter_mut().zip(&mut step.data).zip(&pressure.data) {
                let touches = *p > 0.0;
                *z = if touches { *z } else { 0.0 };
                *t = if touches { *z + share * *t } else { 0.0 };
            }
        },
    );
}

/// Which pixels changed sides.
struct Changes {
    joined: bool,
    left: bool,
}

/// Goes `length` along `-direction`; pressures that would be negative leave the contact, pixels that penetrate join it.
fn advance(
    pressure: &mut Grid<f32>,
    direction: &Grid<f32>,
    displacement: &Grid<f32>,
    overlap: &Grid<f32>,
    length: f32,
    stiffness: f32,
) -> Changes {
    let (mut joined, mut left) = (0_u32, 0_u32);
    simd_dispatch(
        #[inline(always)]
        || {
            let rows = direction.data.iter().zip(&displacement.data).zip(&overlap.data);
            for (p, ((t, w), g)) in pressure.data.iter_mut().zip(rows) {
                let touches = *p > 0.0;
                let moved = *p - length * t;
                let deep = g - w;
                let (leaves, joins) = (touches & (moved < 0.0), !touches & (deep > 0.0));
                let inside = if moved < 0.0 { 0.0 } else { moved };
                let outside = if joins { deep * stiffness } else { 0.0 };
                *p = if touches { inside } else { outside };
                left |= u32::from(leaves);
                joined |= u32::from(joins);
            }
        },
    );
    Changes { joined: joined > 0, left: left > 0 }
}

fn subtract(displacement: &mut Grid<f32>, response: &Grid<f32>, length: f32) {
    simd_dispatch(
        #[inline(always)]
        || {
            for (w, q) in displacement.data.iter_mut().zip(&response.data) {
                *w -= length * q;
            }
        },
    );
}
