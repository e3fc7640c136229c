//! Frictionless contact of a rigid object with the pad: pressure p and displacement w = G p such that w >= g, p >= 0 and
//! p (w - g) = 0 at every pixel, g the overlap.
//!
//! Conjugate gradients under bounds (Polonsky and Keer 1999), preconditioned with the inverse response. The plain method
//! needs the more iterations the softer the response differs over the frequencies, which for a thin incompressible
//! layer is without limit; the preconditioner, cut off below the contact's own size, brings that to 4 to 10.

use super::response::{Memory, Operator};
use super::walls::CutPixel;
use crate::base::grid::{Grid, Rect};
use crate::base::simd::simd_dispatch;

/// Multiple of the tolerance from which on pressures are near enough to their last values for pixels to stop giving way.
const NEARLY: f32 = 30.0;

/// What there is to solve.
pub struct ContactProblem<'a> {
    /// From pressure to displacement in the box, and roughly back; prepared for both.
    pub operator: &'a Operator<'a>,
    /// The largest G, mm: what a first guess of the pressure is scaled with.
    pub softest: f32,
    /// Overlap, mm, over the box.
    pub penetration: Grid<f32>,
    /// Pixels of the box that give way beside the pad's own displacement.
    pub cut: Vec<CutPixel>,
    /// Displacement of a pixel under its own pressure, mm.
    pub own: f32,
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
    /// w, and what pixels give way.
    pub displacement: Grid<f32>,
    /// w - g in the contact, 0 elsewhere.
    residual: Grid<f32>,
    /// Preconditioned residual, and the one before.
    step: Grid<f32>,
    last_step: Grid<f32>,
    /// Search direction. What it displaces takes the place of the step before the last.
    direction: Grid<f32>,
}

impl ContactProblem<'_> {
    /// A first guess of the pressure: what each pixel would need on a soft spring of its own.
    pub fn guess(&self, pressure: &mut Grid<f32>) {
        pressure.clone_from(&self.penetration);
        for value in &mut pressure.data {
            *value = value.max(0.0) / self.softest;
        }
        for pixel in &self.cut {
            pressure.row_mut(pixel.at[1])[pixel.at[0]] *= self.of_the_rest(pixel);
        }
    }

    /// The guess at a pixel that gives way, as a share of what it would be if it did not.
    fn of_the_rest(&self, pixel: &CutPixel) -> f32 {
        self.softest / (self.softest + pixel.compliance)
    }

    /// The displacement under a pressure, and what pixels give way.
    fn displace(&self, pressure: &Grid<f32>, memory: &mut Memory, displacement: &mut Grid<f32>) {
        self.operator.displace(pressure, memory, displacement);
        for pixel in &self.cut {
            let [x, y] = pixel.at;
            displacement.row_mut(y)[x] += pixel.compliance * pressure.at(x, y);
        }
    }

    /// Roughly the pressure under what is left of a displacement. Pixels that give way are made like the others before and
    /// after.
    fn undo(&self, residual: &mut Grid<f32>, memory: &mut Memory, step: &mut Grid<f32>) {
        let balance = |pixel: &CutPixel| 1.0 / (1.0 + pixel.compliance / self.own).sqrt();
        let index = |pixel: &CutPixel| pixel.at[1] * self.penetration.width + pixel.at[0];
        let kept: Vec<f32> = self.cut.iter().map(|pixel| residual.data[index(pixel)]).collect();
        self.cut.iter().for_each(|pixel| residual.data[index(pixel)] *= balance(pixel));
        self.operator.undo(residual, memory, step);
        for (pixel, kept) in self.cut.iter().zip(kept) {
            residual.data[index(pixel)] = kept;
            step.data[index(pixel)] *= balance(pixel);
        }
    }

    /// Takes those of the solver's cut pixels that lie in its box, part of their grid.
    pub fn place(&mut self, cut: &[CutPixel], part: Rect) {
        for pixel in cut.iter().filter(|pixel| part.holds(pixel.at)) {
            let at = [pixel.at[0] - part.x0, pixel.at[1] - part.y0];
            let mut pixel = *pixel;
            pixel.at = at;
            if pixel.stopped {
                self.penetration.row_mut(at[1])[at[0]] -= pixel.gives_way(0.0);
                pixel.compliance = 0.0;
            }
            self.cut.push(pixel);
        }
    }

    /// Betters a guess at pixels that a wall cuts: the share of the highest pressure beside them that an edge has.
    pub fn refine(&self, pressure: &mut Grid<f32>) {
        let guess = |pixel: &CutPixel| {
            let around = |at: usize, size: usize| at.saturating_sub(1)..(at + 2).min(size);
            let [x, y] = pixel.at;
            let rows = around(y, pressure.height).map(|y| &pressure.row(y)[around(x, pressure.width)]);
            let most = rows.flatten().fold(0.0_f32, |most, p| most.max(*p));
            most * pixel.share(self.own)
        };
        let guesses: Vec<f32> = self.cut.iter().map(guess).collect();
        for (pixel, guess) in self.cut.iter().zip(guesses).filter(|(pixel, _)| !pixel.stopped) {
            pressure.row_mut(pixel.at[1])[pixel.at[0]] = guess;
        }
    }

    /// Tells these which of them stopped.
    pub fn note_stopped(&self, cut: &mut [CutPixel], part: Rect) {
        let there = cut.iter_mut().filter(|pixel| part.holds(pixel.at));
        there.zip(&self.cut).for_each(|(pixel, own)| pixel.stopped = own.stopped);
    }

    /// Takes from a displacement what pixels give way under a pressure.
    pub fn take_back(&self, pressure: &Grid<f32>, displacement: &mut Grid<f32>) {
        for pixel in &self.cut {
            let [x, y] = pixel.at;
            displacement.row_mut(y)[x] -= pixel.compliance * pressure.at(x, y);
        }
    }

    /// Stops pixels that would give way by more than they can. Whether there were any.
    fn stop(&mut self, pressure: &Grid<f32>) -> bool {
        let mut any = false;
        for pixel in &mut self.cut {
            let [x, y] = pixel.at;
            if pixel.stop(pressure.at(x, y)) {
                self.penetration.row_mut(y)[x] -= pixel.gives_way(0.0);
                pixel.compliance = 0.0;
                any = true;
            }
        }
        any
    }

    /// Improves `pressure` until the conditions hold.
    pub fn solve(&mut self, pressure: &mut Grid<f32>, scratch: &mut Scratch, memory: &mut Memory) -> Outcome {
        let Scratch { displacement, residual, step, last_step, direction } = scratch;
        for grid in [&mut *residual, step, last_step, direction] {
            grid.reset(pressure.width, pressure.height);
        }
        self.displace(pressure, memory, displacement);
        let mut outcome = Outcome { iterations: 0, residual_mm: f32::INFINITY };
        let (mut last_product, mut keeps_direction) = (1.0, false);
        let mut free = Vec::<CutPixel>::new();
        loop {
            outcome.residual_mm = violation(pressure, displacement, &self.penetration, residual);
            if outcome.residual_mm <= NEARLY * self.tolerance_mm && self.stop(pressure) {
                self.displace(pressure, memory, displacement);
                outcome.residual_mm = violation(pressure, displacement, &self.penetration, residual);
                keeps_direction = false;
            }
            if outcome.residual_mm <= self.tolerance_mm || outcome.iterations == self.max_iterations {
                return outcome;
            }
            outcome.iterations += 1;
            std::mem::swap(step, last_step);
            self.undo(residual, memory, step);
            let product = dot(residual, step);
            // Polak and Ribiere's, from 0 up, so that a step that went wrong is forgotten.
            let share = ((product - dot(residual, last_step)) / last_product).max(0.0);
            let share = if share.is_finite() { share } else { 0.0 };
            turn(direction, step, pressure, if keeps_direction { share as f32 } else { 0.0 });
            last_product = product;
            let response = &mut *last_step;
            self.displace(direction, memory, response);
            let curvature = dot(direction, response);
            // No pixel may touch yet, as after a guess that missed all of them.
            let length = if curvature > 0.0 { (dot(residual, direction) / curvature) as f32 } else { 0.0 };
            free.clear();
            free.extend(self.cut.iter().copied().filter(|pixel| pressure.at(pixel.at[0], pixel.at[1]) <= 0.0));
            let changes = advance(pressure, direction, displacement, &self.penetration, length, 1.0 / self.softest);
            // A guess for a stiff pixel takes one that gives way far beyond the object: it would leave and join for ever.
            for pixel in &free {
                pressure.row_mut(pixel.at[1])[pixel.at[0]] *= self.of_the_rest(pixel);
            }
            if length == 0.0 && !changes.joined {
                return outcome;
            }
            keeps_direction = !changes.joined;
            if changes.joined || changes.left {
                self.displace(pressure, memory, displacement);
            } else {
                subtract(displacement, response, length);
            }
        }
    }
}

/// Writes w - g of the contact's pixels to `residual`, 0 elsewhere; the largest violation of the conditions.
fn violation(pressure: &Grid<f32>, displacement: &Grid<f32>, penetration: &Grid<f32>, residual: &mut Grid<f32>) -> f32 {
    // Floats from 0 up are ordered like their bits, and whole numbers are compared eight at a time; NaN comes out on top.
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

/// Scalar product. Eight partial sums per row, in f32, whatever the processor; rows are summed in f64, because the
/// squares of 300,000 small numbers do not fit the 24 bits of one sum.
fn dot(a: &Grid<f32>, b: &Grid<f32>) -> f64 {
    simd_dispatch(
        #[inline(always)]
        || {
            let mut total = 0.0;
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
            total
        },
    )
}

/// The next search direction, in the contact only; the step outside it is dropped.
fn turn(direction: &mut Grid<f32>, step: &mut Grid<f32>, pressure: &Grid<f32>, share: f32) {
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
    penetration: &Grid<f32>,
    length: f32,
    stiffness: f32,
) -> Changes {
    let (joined, left) = simd_dispatch(
        #[inline(always)]
        move || {
            let (mut joined, mut left) = (0_u32, 0_u32);
            let rows = direction.data.iter().zip(&displacement.data).zip(&penetration.data);
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
            (joined, left)
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
