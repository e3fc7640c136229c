//! Coulomb friction as a convex problem: the tractions of least energy t U t / 2 - t a with |t| <= limit in every
//! pixel.
//!
//! The method is conjugate gradients in the cone of directions that the limits leave, preconditioned with the inverse
//! response. Where a traction slips it may rotate but not grow. Rotating it costs energy, because the limit is a
//! circle; if step and preconditioner ignore that curvature, hundreds of iterations are needed instead of three to six.

use super::traction_grid::{TractionGrid, Vector, difference, dot, largest_length, limit_length, vector_length};

/// Iterations after which the solver gives up.
const MAX_ITERATIONS: u32 = 300;

/// Most iterations for tractions that should be at their limits, once all points are within the tolerance.
const MAX_LIMIT_ITERATIONS: u32 = 30;

/// By how much a traction that slips may be below its limit, as a share of it. A point that cannot follow is within any
/// tolerance of displacement as soon as its limit is small, so that this needs a bound of its own.
const LIMIT_TOLERANCE: f32 = 1e-3;

/// Share of its limit from which on a traction is at the limit.
const LIMIT_SHARE: f32 = 1.0 - 1e-6;

/// Rounding error of displacements in single precision, as a share of the largest.
const ROUNDING: f64 = 1e-5;

/// Result of the traction solver.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct TractionOutcome {
    /// Steps taken.
    pub iterations: u32,
    /// How far a single pixel would still move, mm.
    pub residual_mm: f64,
    /// True if that is within the tolerance, or within rounding.
    pub converged: bool,
    /// Rounding error of the displacements, mm.
    pub rounding_mm: f64,
}

/// Returns the traction that brings a point closer to where it is wanted, by its own response alone: `left_mm` is the
/// distance that is left, `own_mm` the point's displacement by a unit of traction.
pub(super) fn limited_trial(traction: Vector, left_mm: Vector, limit: f32, own_mm: f32) -> (Vector, bool) {
    let trial = [0, 1].map(|k| traction[k] + left_mm[k] / own_mm);
    (limit_length(trial, limit), vector_length(trial) >= limit)
}

/// Turns `tractions`, one for each point of `grid`, into those that move the points to `wanted`, mm, as far as the
/// `limits` allow. Points with infinite limits stick.
pub(super) fn solve_tractions(
    grid: &mut TractionGrid,
    limits: &[f32],
    wanted: &[Vector],
    tractions: &mut Vec<Vector>,
    tolerance_mm: f64,
) -> TractionOutcome {
    if limits.is_empty() {
        return TractionOutcome { converged: true, ..TractionOutcome::default() };
    }
    let own = grid.own_response();
    let rounding_mm = ROUNDING * largest_length(wanted);
    let tolerance_mm = tolerance_mm.max(rounding_mm);
    tractions.iter_mut().zip(limits).for_each(|(t, limit)| *t = limit_length(*t, *limit));
    let begun = tractions.iter().any(|t| *t != [0.0; 2]);
    let mut moved = if begun { grid.apply_response(tractions, false) } else { vec![[0.0; 2]; limits.len()] };
    let mut direction = vec![[0.0; 2]; limits.len()];
    let mut last: Option<(f64, Vec<Vector>)> = None;
    let mut softest: Option<f64> = None;
    let (mut iterations, mut since_settled) = (0, 0);
    loop {
        // The remaining distance is the direction of descent.
        let left = difference(wanted, &moved);
        let (mut longest, mut short_of_limit) = (0.0_f32, false);
        for ((t, e), limit) in tractions.iter().zip(&left).zip(limits) {
            let (next, slips) = limited_trial(*t, *e, *limit, own);
            let step = vector_length([0, 1].map(|k| next[k] - t[k]));
            // A NaN must count as large.
            longest = if step <= longest || longest.is_nan() { longest } else { step };
            short_of_limit |= slips && step > LIMIT_TOLERANCE * limit;
        }
        let residual_mm = f64::from(own * longest);
        let outcome = |converged| TractionOutcome { iterations, residual_mm, converged, rounding_mm };
        if residual_mm <= tolerance_mm {
            if !short_of_limit || since_settled == MAX_LIMIT_ITERATIONS || iterations == MAX_ITERATIONS {
                return outcome(true);
            }
            since_settled += 1;
        } else if iterations == MAX_ITERATIONS {
            return outcome(false);
        }
        iterations += 1;
        let cone = TangentCone::new(tractions, &left, limits, own);
        let mut gradient = left.clone();
        cone.project(&mut gradient);
        let mut scaled = gradient.clone();
        cone.precondition(&mut scaled);
        let mut step = grid.apply_response(&scaled, true);
        cone.precondition(&mut step);
        cone.project(&mut step);
        let product = dot(&gradient, &step);
        // No restart where the sets of sticking and slipping points change.
        let share = last.as_ref().map_or(0.0, |(of_last, before)| {
            let share = (product - dot(&gradient, before)) / of_last;
            if share.is_finite() { share.max(0.0) as f32 } else { 0.0 }
        });
        for (d, z) in direction.iter_mut().zip(&step) {
            *d = [0, 1].map(|k| z[k] + share * d[k]);
        }
        cone.project(&mut direction);
        if dot(&gradient, &direction) <= 0.0 {
            direction.clone_from(&step);
        }
        let response = grid.apply_response(&direction, false);
        let bent: f64 = direction
            .iter()
            .zip(&cone.curvature)
            .map(|(d, bend)| f64::from(*bend) * f64::from(vector_length(*d)).powi(2))
            .sum();
        let curvature = dot(&direction, &response) + bent;
        let along = (dot(&gradient, &direction) / curvature) as f32;
        if !along.is_finite() {
            return TractionOutcome { iterations, residual_mm, converged: residual_mm <= tolerance_mm, rounding_mm };
        }
        let mut clipped = false;
        let mut next: Vec<Vector> = Vec::with_capacity(limits.len());
        for ((t, d), limit) in tractions.iter().zip(&direction).zip(limits) {
            let ahead = [0, 1].map(|k| t[k] + along * d[k]);
            let inside = limit_length(ahead, *limit);
            clipped |= inside != ahead;
            next.push(inside);
        }
        let mut next_moved = match clipped {
            true => grid.apply_response(&next, false),
            false => moved.iter().zip(&response).map(|(u, q)| [0, 1].map(|k| u[k] + along * q[k])).collect(),
        };
        last = Some((product, step));
        // If a step raised the energy (small coefficients, long steps), take a step of steepest descent instead.
        while energy_rise(tractions, &next, &moved, &next_moved, &left) > 0.0 {
            let soft = softest.map_or_else(|| 1.1 * grid.largest_compliance(), |soft| 2.0 * soft);
            softest = Some(soft);
            if soft > 1e6 * f64::from(own) {
                // No step is short enough: what remains is rounding, unless it is large.
                let converged = residual_mm <= 10.0 * tolerance_mm;
                return TractionOutcome { iterations, residual_mm, converged, rounding_mm };
            }
            let descend = |((t, e), limit): ((&Vector, &Vector), &f32)| {
                limit_length([0, 1].map(|k| t[k] + e[k] / soft as f32), *limit)
            };
            next = tractions.iter().zip(&left).zip(limits).map(descend).collect();
            next_moved = grid.apply_response(&next, false);
            last = None;
        }
        (*tractions, moved) = (next, next_moved);
    }
}

/// Returns by how much a step raises the energy; 0 if rounding alone explains the rise.
fn energy_rise(from: &[Vector], to: &[Vector], from_moved: &[Vector], to_moved: &[Vector], left: &[Vector]) -> f64 {
    let step = difference(to, from);
    // Rise that rounding alone can cause: single precision resolves displacements only to a share of the largest.
    let long: f64 = step.iter().map(|step| f64::from(vector_length(*step))).sum();
    let noise = ROUNDING * long * largest_length(to_moved);
    let half: Vec<Vector> = from_moved
        .iter()
        .zip(to_moved)
        .zip(left)
        .map(|((a, b), e)| [0, 1].map(|k| 0.5 * (b[k] - a[k]) - e[k]))
        .collect();
    let rise = dot(&step, &half);
    if rise > noise { rise } else { 0.0 }
}

/// The directions in which the limits allow the tractions to change.
struct TangentCone {
    /// Directions of the tractions that slip; `None` for those that stick.
    slip_directions: Vec<Option<Vector>>,
    /// Term that the curvature of the limit's circle adds to the response, mm.
    curvature: Vec<f32>,
    /// Corresponding scaling in the preconditioner.
    scaling: Vec<f32>,
}

impl TangentCone {
    fn new(tractions: &[Vector], left: &[Vector], limits: &[f32], own: f32) -> Self {
        let count = limits.len();
        let (mut slip_directions, mut curvature, mut scaling) = (vec![None; count], vec![0.0; count], vec![1.0; count]);
        for (k, ((t, e), limit)) in tractions.iter().zip(left).zip(limits).enumerate() {
            let size = vector_length(*t);
            if size < limit * LIMIT_SHARE || size == 0.0 {
                continue;
            }
            let along = t.map(|part| part / size);
            if along[0] * e[0] + along[1] * e[1] > 0.0 {
                slip_directions[k] = Some(along);
                curvature[k] = vector_length(*e) / limit;
                scaling[k] = (own / (own + curvature[k])).sqrt();
            }
        }
        Self { slip_directions, curvature, scaling }
    }

    fn project(&self, vectors: &mut [Vector]) {
        for (v, slips) in vectors.iter_mut().zip(&self.slip_directions) {
            if let Some([x, y]) = slips {
                let along = v[0] * x + v[1] * y;
                *v = [v[0] - along * x, v[1] - along * y];
            }
        }
    }

    fn precondition(&self, vectors: &mut [Vector]) {
        for (v, soft) in vectors.iter_mut().zip(&self.scaling) {
            *v = v.map(|part| part * soft);
        }
    }
}
