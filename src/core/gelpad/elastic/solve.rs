//! Frictionless contact of a rigid object with the pad: finds pressure p and displacement w = G p such that w >= g, p
//! >= 0 and p (w - g) = 0 at every pixel, where g is the penetration.
//!
//! The method is conjugate gradients under bounds (Polonsky and Keer 1999), preconditioned with the inverse response.
//! Without the preconditioner, the number of iterations grows with the range of compliances over the frequencies, which
//! has no limit for a thin incompressible layer. The preconditioner, cut off below the contact's own size, reduces it
//! to 4 to 10.

use super::partial_pixels::PartialPixel;
use super::response::{Operator, OperatorBuffers};
use crate::base::grid::{Grid, Rect};
use crate::base::simd::{dot_in_eights, simd_dispatch};

/// Multiple of the tolerance below which pressures are close enough to their final values to stop pixels.
const NEAR_TOLERANCE: f32 = 30.0;

/// Number of pixels that join or leave in one step up to which their responses are added one by one. For more, computing
/// the displacement anew takes less time.
const MOST_SINGLE_RESPONSES: u32 = 24;

/// A contact problem in a box.
pub struct ContactProblem<'a> {
    /// Operator from pressure to displacement in the box and its approximate inverse; prepared for both.
    pub operator: &'a Operator<'a>,
    /// The largest G, mm; scales the first guess of the pressure.
    pub largest_compliance: f32,
    /// Penetration in the box, mm.
    pub penetration: Grid<f32>,
    /// Pixels of the box that are compliant in addition to the pad's own displacement.
    pub partial_pixels: Vec<PartialPixel>,
    /// Displacement of a pixel under its own pressure, mm.
    pub own_response: f32,
    /// Largest violation of the conditions that is accepted, mm.
    pub tolerance_mm: f32,
    /// Iterations after which the solver gives up.
    pub max_iterations: u32,
}

/// Result of the solver.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SolverOutcome {
    /// Number of iterations.
    pub iterations: u32,
    /// Largest penetration outside the contact, or distance inside it, mm.
    pub residual_mm: f32,
}

/// Memory of the solver, for boxes of any size.
#[derive(Clone, Debug, Default)]
pub struct SolverBuffers {
    /// w plus the compression of partial pixels.
    pub displacement: Grid<f32>,
    /// w - g in the contact, 0 elsewhere.
    residual: Grid<f32>,
    /// Preconditioned residual, and that of the last iteration.
    step: Grid<f32>,
    last_step: Grid<f32>,
    /// Search direction. Its response is stored in `last_step`, once that is no longer needed.
    direction: Grid<f32>,
}

impl ContactProblem<'_> {
    /// Makes a first guess of the pressure: what each pixel would need on a spring of the largest compliance.
    pub fn guess_pressure(&self, pressure: &mut Grid<f32>) {
        pressure.clone_from(&self.penetration);
        for value in &mut pressure.data {
            *value = value.max(0.0) / self.largest_compliance;
        }
        for pixel in &self.partial_pixels {
            pressure.row_mut(pixel.at[1])[pixel.at[0]] *= self.guess_share(pixel);
        }
    }

    /// Returns the guess at a compliant pixel as a share of the guess at a stiff one.
    fn guess_share(&self, pixel: &PartialPixel) -> f32 {
        self.largest_compliance / (self.largest_compliance + pixel.spring())
    }

    /// Computes the displacement under a pressure, including the compression of partial pixels.
    fn displace(&self, pressure: &Grid<f32>, memory: &mut OperatorBuffers, displacement: &mut Grid<f32>) {
        self.operator.displace(pressure, memory, displacement);
        for pixel in &self.partial_pixels {
            let [x, y] = pixel.at;
            displacement.row_mut(y)[x] += pixel.spring() * pressure.at(x, y);
        }
    }

    /// Adds the displacement under the pressures of few pixels, including the compression of partial pixels.
    fn add_responses(&self, pressures: &Grid<f32>, displacement: &mut Grid<f32>) {
        for y in 0..pressures.height {
            for (x, pressure) in pressures.row(y).iter().enumerate().filter(|(_, pressure)| **pressure != 0.0) {
                self.operator.add_pixel_response([x, y], *pressure, displacement);
            }
        }
        for pixel in &self.partial_pixels {
            let [x, y] = pixel.at;
            displacement.row_mut(y)[x] += pixel.spring() * pressures.at(x, y);
        }
    }

    /// Computes approximately the pressure under a residual. Compliant pixels are scaled before and after, so that they
    /// behave like the others.
    fn apply_inverse(&self, residual: &mut Grid<f32>, memory: &mut OperatorBuffers, step: &mut Grid<f32>) {
        let balance = |pixel: &PartialPixel| 1.0 / (1.0 + pixel.spring() / self.own_response).sqrt();
        let index = |pixel: &PartialPixel| pixel.at[1] * self.penetration.width + pixel.at[0];
        let kept: Vec<f32> = self.partial_pixels.iter().map(|pixel| residual.data[index(pixel)]).collect();
        self.partial_pixels.iter().for_each(|pixel| residual.data[index(pixel)] *= balance(pixel));
        self.operator.apply_inverse(residual, memory, step);
        for (pixel, kept) in self.partial_pixels.iter().zip(kept) {
            residual.data[index(pixel)] = kept;
            step.data[index(pixel)] *= balance(pixel);
        }
    }

    /// Adds the partial pixels that lie in the problem's box `part`, and takes stopped ones as rigid.
    pub fn take_partial_pixels(&mut self, cut: &[PartialPixel], part: Rect) {
        for pixel in cut.iter().filter(|pixel| part.contains(pixel.at)) {
            let at = [pixel.at[0] - part.x0, pixel.at[1] - part.y0];
            let mut pixel = *pixel;
            pixel.at = at;
            if pixel.is_stopped {
                self.penetration.row_mut(at[1])[at[0]] -= pixel.compression_mm(0.0);
            }
            self.partial_pixels.push(pixel);
        }
    }

    /// Improves a guess at pixels that a wall cuts: it becomes the share of the highest neighbouring pressure that an
    /// edge has.
    pub fn refine_guess(&self, pressure: &mut Grid<f32>) {
        let guess = |pixel: &PartialPixel| {
            let around = |at: usize, size: usize| at.saturating_sub(1)..(at + 2).min(size);
            let [x, y] = pixel.at;
            let rows = around(y, pressure.height).map(|y| &pressure.row(y)[around(x, pressure.width)]);
            let most = rows.flatten().fold(0.0_f32, |most, p| most.max(*p));
            most * pixel.pressure_share(self.own_response)
        };
        let guesses: Vec<f32> = self.partial_pixels.iter().map(guess).collect();
        for (pixel, guess) in self.partial_pixels.iter().zip(guesses).filter(|(pixel, _)| !pixel.is_stopped) {
            pressure.row_mut(pixel.at[1])[pixel.at[0]] = guess;
        }
    }

    /// Notes in `cut` which pixels of the box `part` have stopped.
    pub fn note_stopped_pixels(&self, cut: &mut [PartialPixel], part: Rect) {
        let there = cut.iter_mut().filter(|pixel| part.contains(pixel.at));
        there.zip(&self.partial_pixels).for_each(|(pixel, own)| pixel.take_state(own));
    }

    /// Subtracts the compression of partial pixels under a pressure from a displacement.
    pub fn subtract_compression(&self, pressure: &Grid<f32>, displacement: &mut Grid<f32>) {
        for pixel in &self.partial_pixels {
            let [x, y] = pixel.at;
            displacement.row_mut(y)[x] -= pixel.spring() * pressure.at(x, y);
        }
    }

    /// Stops pixels whose compression exceeds its limit, and frees stopped ones; returns true if there were any.
    fn stop_or_free_pixels(&mut self, pressure: &Grid<f32>) -> bool {
        let mut any = false;
        for pixel in &mut self.partial_pixels {
            let [x, y] = pixel.at;
            if let Some(deeper_mm) = pixel.stop_or_free(pressure.at(x, y)) {
                self.penetration.row_mut(y)[x] += deeper_mm;
                any = true;
            }
        }
        any
    }

    /// Iterates on `pressure` until the conditions hold.
    pub fn solve(
        &mut self,
        pressure: &mut Grid<f32>,
        scratch: &mut SolverBuffers,
        memory: &mut OperatorBuffers,
    ) -> SolverOutcome {
        let SolverBuffers { displacement, residual, step, last_step, direction } = scratch;
        for grid in [&mut *residual, step, last_step, direction] {
            grid.reset(pressure.width, pressure.height);
        }
        self.displace(pressure, memory, displacement);
        let mut outcome = SolverOutcome { iterations: 0, residual_mm: f32::INFINITY };
        let (mut last_product, mut keeps_direction) = (1.0, false);
        let mut free = Vec::<PartialPixel>::new();
        loop {
            outcome.residual_mm = measure_violation(pressure, displacement, &self.penetration, residual);
            if outcome.residual_mm <= NEAR_TOLERANCE * self.tolerance_mm && self.stop_or_free_pixels(pressure) {
                self.displace(pressure, memory, displacement);
                outcome.residual_mm = measure_violation(pressure, displacement, &self.penetration, residual);
                keeps_direction = false;
            }
            if outcome.residual_mm <= self.tolerance_mm || outcome.iterations == self.max_iterations {
                return outcome;
            }
            outcome.iterations += 1;
            std::mem::swap(step, last_step);
            self.apply_inverse(residual, memory, step);
            let product = dot(residual, step);
            // Polak-Ribiere, limited to positive values, so that a step that went wrong is forgotten.
            let share = ((product - dot(residual, last_step)) / last_product).max(0.0);
            let share = if share.is_finite() { share } else { 0.0 };
            update_direction(direction, step, pressure, if keeps_direction { share as f32 } else { 0.0 });
            last_product = product;
            let response = &mut *last_step;
            self.displace(direction, memory, response);
            let curvature = dot(direction, response);
            // After a guess that missed all pixels, no pixel may touch yet.
            let length = if curvature > 0.0 { (dot(residual, direction) / curvature) as f32 } else { 0.0 };
            free.clear();
            free.extend(
                self.partial_pixels.iter().copied().filter(|pixel| pressure.at(pixel.at[0], pixel.at[1]) <= 0.0),
            );
            let changes = advance_pressure(
                pressure,
                direction,
                displacement,
                &self.penetration,
                residual,
                length,
                1.0 / self.largest_compliance,
            );
            // Until the violation is measured again, the residual's memory holds how far joins and leaves are from the
            // step.
            let jumps = &mut *residual;
            // The guess for a stiff pixel would push a compliant one far beyond the object: it would leave and join for
            // ever.
            for pixel in &free {
                let [x, y] = pixel.at;
                let share = self.guess_share(pixel);
                pressure.row_mut(y)[x] *= share;
                jumps.row_mut(y)[x] *= share;
            }
            if length == 0.0 && changes.joined == 0 {
                return outcome;
            }
            keeps_direction = changes.joined == 0;
            if changes.joined + changes.left > MOST_SINGLE_RESPONSES {
                self.displace(pressure, memory, displacement);
            } else {
                subtract_scaled(displacement, response, length);
                if changes.joined + changes.left > 0 {
                    self.add_responses(jumps, displacement);
                }
            }
        }
    }
}

/// Writes w - g in the contact and 0 elsewhere to `residual`; returns the largest violation of the conditions.
fn measure_violation(
    pressure: &Grid<f32>,
    displacement: &Grid<f32>,
    penetration: &Grid<f32>,
    residual: &mut Grid<f32>,
) -> f32 {
    // Non-negative floats are ordered like their bits, and whole numbers are compared eight at a time; NaN is the
    // largest.
    let worst = simd_dispatch(
        #[inline(always)]
        || {
            let mut worst = 0;
            let rows = pressure.data.iter().zip(&displacement.data).zip(&penetration.data).zip(&mut residual.data);
            for (((p, w), g), r) in rows {
                let gap = w - g;
                let touches = *p > 0.0;
                *r = if touches { gap } else { 0.0 };
                let wrong = if touches { gap.abs() } else { (-gap).max(0.0) + gap * 0.0 };
                worst = wrong.to_bits().max(worst);
            }
            worst
        },
    );
    f32::from_bits(worst)
}

/// Computes the scalar product. Each row is summed in eight partial sums in f32, on every processor the same; rows are
/// summed in f64, because the squares of 300,000 small numbers exceed the 24 bits of a single sum.
fn dot(a: &Grid<f32>, b: &Grid<f32>) -> f64 {
    simd_dispatch(
        #[inline(always)]
        || {
            let mut total = 0.0;
            for (a, b) in a.data.chunks_exact(a.width).zip(b.data.chunks_exact(b.width)) {
                total += dot_in_eights(a, b);
            }
            total
        },
    )
}

/// Computes the next search direction, in the contact only; outside, the step is set to 0.
fn update_direction(direction: &mut Grid<f32>, step: &mut Grid<f32>, pressure: &Grid<f32>, share: f32) {
    simd_dispatch(
        #[inline(always)]
        move || {
            for ((t, z), p) in direction.data.iter_mut().zip(&mut step.data).zip(&pressure.data) {
                let touches = *p > 0.0;
                *z = if touches { *z } else { 0.0 };
                *t = if touches { *z + share * *t } else { 0.0 };
            }
        },
    );
}

/// Number of pixels that a step made join and leave the contact.
struct ContactChanges {
    joined: u32,
    left: u32,
}

/// Takes a step of `length` along `-direction`. Pixels whose pressure would become negative leave the contact; pixels
/// that penetrate join it. Writes to `jumps` how far the pressures of these are from the step, and 0 elsewhere.
fn advance_pressure(
    pressure: &mut Grid<f32>,
    direction: &Grid<f32>,
    displacement: &Grid<f32>,
    penetration: &Grid<f32>,
    jumps: &mut Grid<f32>,
    length: f32,
    stiffness: f32,
) -> ContactChanges {
    let (joined, left) = simd_dispatch(
        #[inline(always)]
        move || {
            let (mut joined, mut left) = (0_u32, 0_u32);
            let rows = direction.data.iter().zip(&displacement.data).zip(&penetration.data);
            for ((p, jump), ((t, w), g)) in pressure.data.iter_mut().zip(&mut jumps.data).zip(rows) {
                let touches = *p > 0.0;
                let moved = *p - length * t;
                let deep = g - w;
                let (leaves, joins) = (touches & (moved < 0.0), !touches & (deep > 0.0));
                let inside = if moved < 0.0 { 0.0 } else { moved };
                let outside = if joins { deep * stiffness } else { 0.0 };
                *p = if touches { inside } else { outside };
                *jump = if touches { inside - moved } else { outside };
                left += u32::from(leaves);
                joined += u32::from(joins);
            }
            (joined, left)
        },
    );
    ContactChanges { joined, left }
}

fn subtract_scaled(displacement: &mut Grid<f32>, response: &Grid<f32>, length: f32) {
    simd_dispatch(
        #[inline(always)]
        || {
            for (w, q) in displacement.data.iter_mut().zip(&response.data) {
                *w -= length * q;
            }
        },
    );
}
