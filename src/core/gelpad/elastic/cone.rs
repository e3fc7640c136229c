//! Coulomb's law as a convex problem: the tractions of least energy t U t / 2 - t a with |t| <= limit in every pixel.
//!
//! Conjugate gradients in the cone of directions that the limits leave, preconditioned with the inverse response. Where a
//! traction slips it may turn but not grow; turning it costs energy (the limit is a circle), and without that curvature in
//! step and preconditioner hundreds of iterations are needed instead of three to six.

use super::grip::{Grip, Vector, difference, dot, held, largest, length};

/// Iterations after which to give up.
const MOST_ITERATIONS: u32 = 300;

/// A traction this close to its limit is at it.
const AT_LIMIT: f32 = 1.0 - 1e-6;

/// What single precision leaves of a displacement, as a share of the largest.
const ROUNDING: f64 = 1e-5;

/// How tractions were found.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Solved {
    /// Steps taken.
    pub iterations: u32,
    /// How far, mm, a pixel alone would still go.
    pub residual_mm: f64,
    /// Whether that is within the tolerance, or within what single precision can tell.
    pub converged: bool,
}

/// Turns `tractions`, one for each point of `grip`, into those that take the points where they are `wanted`, mm, as far as
/// the `limits` let them; infinite limits stick.
pub(super) fn solve(
    grip: &mut Grip,
    limits: &[f32],
    wanted: &[Vector],
    tractions: &mut Vec<Vector>,
    tolerance_mm: f64,
) -> Solved {
    if limits.is_empty() {
        return Solved { converged: true, ..Solved::default() };
    }
    let own = grip.own_response();
    let tolerance_mm = tolerance_mm.max(ROUNDING * largest(wanted));
    tractions.iter_mut().zip(limits).for_each(|(t, limit)| *t = held(*t, *limit));
    let begun = tractions.iter().any(|t| *t != [0.0; 2]);
    let mut moved = if begun { grip.respond(tractions, false) } else { vec![[0.0; 2]; limits.len()] };
    let mut direction = vec![[0.0; 2]; limits.len()];
    let mut last: Option<(f64, Vec<Vector>)> = None;
    let mut softest: Option<f64> = None;
    let mut iterations = 0;
    loop {
        // Downhill: minus the slip.
        let left = difference(wanted, &moved);
        let alone = |((t, e), limit): ((&Vector, &Vector), &f32)| {
            let next = held([0, 1].map(|k| t[k] + e[k] / own), *limit);
            length([0, 1].map(|k| next[k] - t[k]))
        };
        let steps = tractions.iter().zip(&left).zip(limits).map(alone);
        // A NaN must not pass for a small number.
        let longest = steps.fold(0.0, |most: f32, step| if step <= most || most.is_nan() { most } else { step });
        let residual_mm = f64::from(own * longest);
        if residual_mm <= tolerance_mm || iterations == MOST_ITERATIONS {
            return Solved { iterations, residual_mm, converged: residual_mm <= tolerance_mm };
        }
        iterations += 1;
        let cone = Cone::new(tractions, &left, limits, own);
        let mut gradient = left.clone();
        cone.project(&mut gradient);
        let mut scaled = gradient.clone();
        cone.soften(&mut scaled);
        let mut step = grip.respond(&scaled, true);
        cone.soften(&mut step);
        cone.project(&mut step);
        let product = dot(&gradient, &step);
        // Not begun anew where the sets of what sticks and slips change.
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
        let response = grip.respond(&direction, false);
        let bent: f64 =
            direction.iter().zip(&cone.bend).map(|(d, bend)| f64::from(*bend) * f64::from(length(*d)).powi(2)).sum();
        let curvature = dot(&direction, &response) + bent;
        let along = (dot(&gradient, &direction) / curvature) as f32;
        if !along.is_finite() {
            return Solved { iterations, residual_mm, converged: false };
        }
        let mut clipped = false;
        let mut next: Vec<Vector> = Vec::with_capacity(limits.len());
        for ((t, d), limit) in tractions.iter().zip(&direction).zip(limits) {
            let ahead = [0, 1].map(|k| t[k] + along * d[k]);
            let inside = held(ahead, *limit);
            clipped |= inside != ahead;
            next.push(inside);
        }
        let mut next_moved = match clipped {
            true => grip.respond(&next, false),
            false => moved.iter().zip(&response).map(|(u, q)| [0, 1].map(|k| u[k] + along * q[k])).collect(),
        };
        last = Some((product, step));
        // A step that raised the energy (small coefficients, long steps) gives way to steepest descent.
        while rise(tractions, &next, &moved, &next_moved, &left) > 0.0 {
            let soft = softest.map_or_else(|| 1.1 * grip.softest_response(), |soft| 2.0 * soft);
            softest = Some(soft);
            if soft > 1e6 * f64::from(own) {
                // No step is short enough: what is left is rounding, unless it is much.
                let converged = residual_mm <= 10.0 * tolerance_mm.max(ROUNDING * largest(wanted));
                return Solved { iterations, residual_mm, converged };
            }
            let descend =
                |((t, e), limit): ((&Vector, &Vector), &f32)| held([0, 1].map(|k| t[k] + e[k] / soft as f32), *limit);
            next = tractions.iter().zip(&left).zip(limits).map(descend).collect();
            next_moved = grip.respond(&next, false);
            last = None;
        }
        (*tractions, moved) = (next, next_moved);
    }
}

/// By how much a step raises the energy.
fn rise(from: &[Vector], to: &[Vector], from_moved: &[Vector], to_moved: &[Vector], left: &[Vector]) -> f64 {
    let step = difference(to, from);
    // By so much rounding alone may raise it: of displacements, single precision leaves a share.
    let long: f64 = step.iter().map(|step| f64::from(length(*step))).sum();
    let noise = ROUNDING * long * largest(to_moved);
    let half: Vec<Vector> = from_moved
        .iter()
        .zip(to_moved)
        .zip(left)
        .map(|((a, b), e)| [0, 1].map(|k| 0.5 * (b[k] - a[k]) - e[k]))
        .collect();
    let rise = dot(&step, &half);
    if rise > noise { rise } else { 0.0 }
}

/// The directions that the limits leave.
struct Cone {
    /// Where a traction slips: its direction.
    slips: Vec<Option<Vector>>,
    /// What the circle's curvature adds to the response, mm.
    bend: Vec<f32>,
    /// What follows of that for the preconditioner.
    soft: Vec<f32>,
}

impl Cone {
    fn new(tractions: &[Vector], left: &[Vector], limits: &[f32], own: f32) -> Self {
        let count = limits.len();
        let (mut slips, mut bend, mut soft) = (vec![None; count], vec![0.0; count], vec![1.0; count]);
        for (k, ((t, e), limit)) in tractions.iter().zip(left).zip(limits).enumerate() {
            let size = length(*t);
            if size < limit * AT_LIMIT || size == 0.0 {
                continue;
            }
            let along = t.map(|part| part / size);
            if along[0] * e[0] + along[1] * e[1] > 0.0 {
                slips[k] = Some(along);
                bend[k] = length(*e) / limit;
                soft[k] = (own / (own + bend[k])).sqrt();
            }
        }
        Self { slips, bend, soft }
    }

    fn project(&self, vectors: &mut [Vector]) {
        for (v, slips) in vectors.iter_mut().zip(&self.slips) {
            if let Some([x, y]) = slips {
                let along = v[0] * x + v[1] * y;
                *v = [v[0] - along * x, v[1] - along * y];
            }
        }
    }

    fn soften(&self, vectors: &mut [Vector]) {
        for (v, soft) in vectors.iter_mut().zip(&self.soft) {
            *v = v.map(|part| part * soft);
        }
    }
}
