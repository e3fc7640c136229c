//! Tangential tractions under an object that holds the pad while it is pressed in ([`super::friction`]), or that is then moved
//! and twisted in the pad's plane.
//!
//! The contact and its pressure p are given; what tractions do to them in turn is [`super::friction`]'s. Full stick:
//! the surface follows the object wherever they touch (conjugate gradients, preconditioned with the inverse response).
//! Coulomb's law: |t| <= coefficient p, the tractions being those of least energy (Kalker 1990), by accelerated
//! projected gradients (Beck and Teboulle 2009) with restarts (O'Donoghue and Candes 2015); all of a motion in one step.

use serde::{Deserialize, Serialize};

use super::grip::{Grip, difference, dot, held, largest, length, sum};
use super::inplane::{Field, Load, Traction};
use super::layer::ElasticLayer;
use crate::base::grid::{Grid, bounding_box};

/// Motion of the object in the pad's plane after the press.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Motion {
    /// To the right and down in the image, mm.
    pub shift_mm: [f64; 2],
    /// From x towards y, clockwise in the image; small.
    pub twist_rad: f64,
    /// What it is twisted about, in the sensor's frame.
    pub about_mm: [f64; 2],
}

/// What holds the pad to the object.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
#[serde(rename_all = "snake_case", deny_unknown_fields)]
pub enum Friction {
    /// Nothing slips.
    #[default]
    Stick,
    /// Slips where the traction would be larger than a multiple of the pressure.
    Coulomb {
        /// That multiple, 0 to 10.
        coefficient: f64,
    },
}

impl Friction {
    /// Its coefficient; `None` where nothing slips.
    pub fn coefficient(self) -> Option<f64> {
        match self {
            Self::Stick => None,
            Self::Coulomb { coefficient } => Some(coefficient),
        }
    }
}

/// How tractions came about, and what they sum up to.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Outcome {
    /// Iterations, those of full stick, from which Coulomb's law begins, included.
    pub iterations: u32,
    /// Largest distance, over the contact, of the surface from where the object or the friction law wants it.
    pub residual_um: f64,
    /// Whether that is within 1 um.
    pub converged: bool,
    /// Share of the contact that slips, 0 to 1; 0 without contact.
    pub slipping: f64,
    /// Tangential force on the pad over Young's modulus, mm^2.
    pub force: [f64; 2],
    /// Twisting moment on the pad about the point of the motion over Young's modulus, mm^3.
    pub moment: f64,
}

/// Largest distance that is accepted, mm.
const TOLERANCE_MM: f64 = 1e-3;

/// Iterations of either method after which to give up.
const MOST_ITERATIONS: u32 = 200;

/// The longer side of the contact has at most so many pixels; half of that at least, if the pressure has.
const CONTACT_PX: usize = 96;

/// Room around the contact, so that the torus's copies are not felt, thicknesses.
const ROOM: f64 = 4.0;

/// A traction this close to its limit slips.
const SLIPS_FROM: f32 = 0.999;

/// The tractions that a motion needs or friction allows, on the pressure's own pixels or on a multiple of them. A
/// contact of a few pixels is as coarse as those are; without contact there are no tractions.
pub fn shear(layer: ElasticLayer, load: &Load, motion: Motion, friction: Friction) -> (Traction, Outcome) {
    shear_from(layer, load, motion, friction, None)
}

/// The same where the pressure alone would move the surface by `moved`, and friction holds it against that, too.
pub fn shear_from(
    layer: ElasticLayer,
    load: &Load,
    motion: Motion,
    friction: Friction,
    moved: Option<&Field>,
) -> (Traction, Outcome) {
    let part = bounding_box(&load.pressure, |p| p > 0.0);
    let mut outcome =
        Outcome { iterations: 0, residual_um: 0.0, converged: true, slipping: 0.0, force: [0.0; 2], moment: 0.0 };
    if part.is_empty() {
        return (Traction { mm_per_px: load.mm_per_px, origin_mm: load.origin_mm, ..Traction::default() }, outcome);
    }
    let mut grip = Grip::new(layer, [load.origin_mm, load.mm_per_px], part, CONTACT_PX, ROOM);
    grip.touch(&load.pressure, part);
    grip.want(|place_mm| {
        let wanted = motion.at(place_mm);
        moved.map_or(wanted, |field| {
            let by = field.at(place_mm);
            [0, 1].map(|k| wanted[k] - f64::from(by[k]))
        })
    });
    let mut tractions = vec![[0.0; 2]; grip.points.len()];
    let (residual_mm, slipping) = grip.hold(friction, &mut tractions, &mut outcome.iterations);
    outcome.slipping = slipping;
    outcome.residual_um = 1e3 * residual_mm;
    outcome.converged = residual_mm <= TOLERANCE_MM;
    let traction = grip.spread_out(&tractions);
    (outcome.force, outcome.moment) = grip.sums(&tractions, motion.about_mm);
    (traction, outcome)
}

impl Motion {
    /// How far it takes a point, mm.
    fn at(self, place_mm: [f64; 2]) -> [f64; 2] {
        let from = [0, 1].map(|k| place_mm[k] - self.about_mm[k]);
        let turned = [-self.twist_rad * from[1], self.twist_rad * from[0]];
        [0, 1].map(|k| self.shift_mm[k] + turned[k])
    }
}

impl Grip {
    /// Tractions that hold the points where they are wanted, as far as friction does, beginning with the ones given; the
    /// largest distance, mm, from that, and the share of the points that slip.
    pub(crate) fn hold(
        &mut self,
        friction: Friction,
        tractions: &mut Vec<[f32; 2]>,
        iterations: &mut u32,
    ) -> (f64, f64) {
        let limits: Vec<f32> = match friction {
            Friction::Stick => Vec::new(),
            Friction::Coulomb { coefficient } => {
                self.points.iter().map(|point| coefficient as f32 * point.pressure).collect()
            }
        };
        let slips = |(t, limit): &(&[f32; 2], &f32)| length(**t) >= SLIPS_FROM * **limit;
        // What slipped before will slip again: sticking is no way there.
        let begun = tractions.iter().any(|t| *t != [0.0; 2]);
        if !begun || !tractions.iter().zip(&limits).any(|pair| slips(&pair)) {
            let residual_mm = self.stick(tractions, iterations);
            if !tractions.iter().zip(&limits).any(|(t, limit)| length(*t) > *limit) {
                return (residual_mm, 0.0);
            }
        }
        let residual_mm = self.slip(tractions, &limits, iterations);
        let slipping = tractions.iter().zip(&limits).filter(slips).count();
        (residual_mm, slipping as f64 / limits.len() as f64)
    }

    /// Solves for tractions with which every point goes where it is wanted, beginning with the ones given; the largest
    /// distance that is left, mm.
    fn stick(&mut self, tractions: &mut [[f32; 2]], iterations: &mut u32) -> f64 {
        let mut left: Vec<[f32; 2]> = self.points.iter().map(|point| point.wanted).collect();
        if tractions.iter().any(|t| *t != [0.0; 2]) {
            left = difference(&left, &self.respond(tractions, false));
        }
        let mut direction = vec![[0.0; 2]; left.len()];
        let mut last_product = 0.0;
        loop {
            let residual = largest(&left);
            if residual <= TOLERANCE_MM || *iterations == MOST_ITERATIONS {
                return residual;
            }
            *iterations += 1;
            let step = self.respond(&left, true);
            let product = dot(&left, &step);
            let share = if last_product > 0.0 { (product / last_product) as f32 } else { 0.0 };
            last_product = product;
            for (d, z) in direction.iter_mut().zip(&step) {
                *d = [0, 1].map(|k| z[k] + share * d[k]);
            }
            let response = self.respond(&direction, false);
            let curvature = dot(&direction, &response);
            let along = if curvature > 0.0 { (product / curvature) as f32 } else { return residual };
            for (((t, d), r), u) in tractions.iter_mut().zip(&direction).zip(&mut left).zip(&response) {
                for k in 0..2 {
                    t[k] += along * d[k];
                    r[k] -= along * u[k];
                }
            }
        }
    }

    /// Turns tractions of full stick into those of least energy within `limits`; the largest distance, mm, by which the
    /// law is not met.
    fn slip(&mut self, tractions: &mut Vec<[f32; 2]>, limits: &[f32], iterations: &mut u32) -> f64 {
        let end = *iterations + MOST_ITERATIONS;
        for (t, limit) in tractions.iter_mut().zip(limits) {
            *t = held(*t, *limit);
        }
        let mut moved = self.respond(tractions, false);
        // How soft the contact is at most: the step must not be longer. It grows when it turns out too small.
        let mut softest = (dot(tractions, &moved) / dot(tractions, tractions)).max(0.0);
        if !softest.is_normal() {
            return self.unmet(tractions, &moved, limits, 1.0);
        }
        // Where the next step starts from: ahead of the last one, by momentum.
        let (mut ahead, mut ahead_moved) = (tractions.clone(), moved.clone());
        let mut momentum = 1.0_f64;
        loop {
            let residual = self.unmet(tractions, &moved, limits, softest as f32);
            if residual <= TOLERANCE_MM || *iterations >= end {
                return residual;
            }
            *iterations += 1;
            let next = self.projected(&ahead, &ahead_moved, limits, softest as f32);
            let next_moved = self.respond(&next, false);
            let (step, step_moved) = (difference(&next, &ahead), difference(&next_moved, &ahead_moved));
            let curvature = dot(&step, &step_moved) / dot(&step, &step).max(f64::MIN_POSITIVE);
            if curvature > 1.001 * softest {
                softest = 1.2 * curvature;
                continue;
            }
            let change = difference(&next, tractions);
            let change_moved = difference(&next_moved, &moved);
            // Momentum that leads uphill is dropped.
            let overshot = dot(&step, &change) < 0.0;
            let last = if overshot { 1.0 } else { momentum };
            momentum = 0.5 * (1.0 + libm::sqrt(1.0 + 4.0 * last * last));
            let share = if overshot { 0.0 } else { ((last - 1.0) / momentum) as f32 };
            (*tractions, moved) = (next, next_moved);
            ahead = sum(tractions, &change, share);
            ahead_moved = sum(&moved, &change_moved, share);
        }
    }

    /// One step downhill from `tractions`, which move the points by `moved`, and back within the limits.
    fn projected(&self, tractions: &[[f32; 2]], moved: &[[f32; 2]], limits: &[f32], softest: f32) -> Vec<[f32; 2]> {
        let points = self.points.iter().zip(limits);
        let all = tractions.iter().zip(moved).zip(points);
        all.map(|((t, u), (point, limit))| held([0, 1].map(|k| t[k] - (u[k] - point.wanted[k]) / softest), *limit))
            .collect()
    }

    /// How far a step would go, as a displacement, mm: nothing where the law is met.
    fn unmet(&self, tractions: &[[f32; 2]], moved: &[[f32; 2]], limits: &[f32], softest: f32) -> f64 {
        let next = self.projected(tractions, moved, limits, softest);
        f64::from(softest) * largest(&difference(&next, tractions))
    }

    fn spread_out(&self, tractions: &[[f32; 2]]) -> Traction {
        let [width, height] = self.size;
        let (mut x, mut y) = (Grid::new(width, height), Grid::new(width, height));
        for (point, t) in self.points.iter().zip(tractions) {
            let [column, row] = point.pixel;
            [x.row_mut(row)[column], y.row_mut(row)[column]] = *t;
        }
        Traction { x, y, origin_mm: self.origin_mm, mm_per_px: self.mm_per_px }
    }

    /// Force and moment.
    fn sums(&self, tractions: &[[f32; 2]], about_mm: [f64; 2]) -> ([f64; 2], f64) {
        let area = self.mm_per_px[0] * self.mm_per_px[1];
        let (mut force, mut moment) = ([0.0; 2], 0.0);
        for (point, t) in self.points.iter().zip(tractions) {
            let [fx, fy] = t.map(|part| area * f64::from(part));
            force = [force[0] + fx, force[1] + fy];
            moment += (point.place_mm[0] - about_mm[0]) * fy - (point.place_mm[1] - about_mm[1]) * fx;
        }
        (force, moment)
    }
}
