//! Tangential tractions under an object that holds the pad while it is pressed in ([`super::friction`]), or that is
//! moved and twisted in the pad's plane afterwards.
//!
//! The contact and its pressure p are given; the effect of tractions on these is computed in [`super::friction`]. With
//! full stick, the surface follows the object wherever they touch (conjugate gradients, preconditioned with the inverse
//! response). With Coulomb friction, |t| <= coefficient p, and the tractions are those of least energy (Kalker 1990),
//! found by accelerated projected gradients (Beck and Teboulle 2009) with restarts (O'Donoghue and Candes 2015). A
//! motion is applied in one step.

use serde::{Deserialize, Serialize};

use super::in_plane::{DisplacementField, Load, TractionField};
use super::layer::ElasticLayer;
use super::traction_grid::{TractionGrid, add_scaled, difference, dot, largest_length, limit_length, vector_length};
use crate::base::grid::{Grid, bounding_box};

/// Motion of the object in the pad's plane after the press.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Motion {
    /// Translation to the right and down in the image, mm.
    pub shift_mm: [f64; 2],
    /// Rotation from x towards y, clockwise in the image, rad; small.
    pub twist_rad: f64,
    /// Centre of the rotation, in the sensor's frame, mm.
    pub about_mm: [f64; 2],
}

/// Friction between pad and object.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
#[serde(rename_all = "snake_case", deny_unknown_fields)]
pub enum Friction {
    /// Nothing slips.
    #[default]
    Stick,
    /// Slips where the traction would be larger than a multiple of the pressure.
    Coulomb {
        /// Coefficient of friction: that multiple, 0 to 10.
        coefficient: f64,
    },
}

impl Friction {
    /// Returns the coefficient of friction; `None` if nothing slips.
    pub fn coefficient(self) -> Option<f64> {
        match self {
            Self::Stick => None,
            Self::Coulomb { coefficient } => Some(coefficient),
        }
    }
}

/// Result of the traction solver.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ShearOutcome {
    /// Iterations, including those for full stick, from which the solution with Coulomb friction starts.
    pub iterations: u32,
    /// Largest distance in the contact between the surface and where the object or the friction model requires it, um.
    pub residual_um: f64,
    /// True if that is within 1 um.
    pub converged: bool,
    /// Share of the contact that slips, 0 to 1; 0 without contact.
    pub slipping: f64,
    /// Tangential force on the pad over Young's modulus, mm^2.
    pub force: [f64; 2],
    /// Twisting moment on the pad about the centre of the motion's rotation, over Young's modulus, mm^3.
    pub moment: f64,
}

/// Largest distance that is accepted, mm.
const TOLERANCE_MM: f64 = 1e-3;

/// Iterations of either method after which the solver gives up.
const MAX_ITERATIONS: u32 = 200;

/// Most pixels along the longer side of the contact; at least half as many are used if the pressure has them.
const CONTACT_PX: usize = 96;

/// Room around the contact, in thicknesses, so that its copies on the torus have no influence.
const ROOM: f64 = 4.0;

/// Share of its limit from which on a traction counts as slipping.
const SLIPS_FROM: f32 = 0.999;

/// Solves for the tractions that a motion needs, or that friction allows, on the pressure's own pixels or on blocks of
/// them. A contact of a few pixels is resolved no finer than these. Without contact there are no tractions.
pub fn solve_shear(
    layer: ElasticLayer,
    load: &Load,
    motion: Motion,
    friction: Friction,
) -> (TractionField, ShearOutcome) {
    let (tractions, _, outcome) = solve_shear_from(layer, load, motion, friction, None);
    (tractions, outcome)
}

/// Solves like [`solve_shear`], where the pressure alone would move the surface by `moved` and friction resists that
/// motion too. Also returns the pressure on the pixels of the tractions.
pub fn solve_shear_from(
    layer: ElasticLayer,
    load: &Load,
    motion: Motion,
    friction: Friction,
    moved: Option<&DisplacementField>,
) -> (TractionField, Grid<f32>, ShearOutcome) {
    let part = bounding_box(&load.pressure, |p| p > 0.0);
    let mut outcome =
        ShearOutcome { iterations: 0, residual_um: 0.0, converged: true, slipping: 0.0, force: [0.0; 2], moment: 0.0 };
    if part.is_empty() {
        return (
            TractionField { mm_per_px: load.mm_per_px, origin_mm: load.origin_mm, ..TractionField::default() },
            Grid::default(),
            outcome,
        );
    }
    let mut grid = TractionGrid::new(layer, [load.origin_mm, load.mm_per_px], part, CONTACT_PX, ROOM);
    grid.set_contact(&load.pressure, part);
    grid.set_targets(|place_mm| {
        let wanted = motion.displacement_at(place_mm);
        moved.map_or(wanted, |field| {
            let by = field.at(place_mm);
            [0, 1].map(|k| wanted[k] - f64::from(by[k]))
        })
    });
    let mut tractions = vec![[0.0; 2]; grid.points.len()];
    let (residual_mm, slipping) = grid.solve_tractions(friction, &mut tractions, &mut outcome.iterations);
    outcome.slipping = slipping;
    outcome.residual_um = 1e3 * residual_mm;
    outcome.converged = residual_mm <= TOLERANCE_MM;
    let traction = grid.to_traction_field(&tractions);
    (outcome.force, outcome.moment) = grid.force_and_moment(&tractions, motion.about_mm);
    (traction, grid.pressure(), outcome)
}

impl Motion {
    /// Returns the displacement of a point, mm.
    fn displacement_at(self, place_mm: [f64; 2]) -> [f64; 2] {
        let from = [0, 1].map(|k| place_mm[k] - self.about_mm[k]);
        let turned = [-self.twist_rad * from[1], self.twist_rad * from[0]];
        [0, 1].map(|k| self.shift_mm[k] + turned[k])
    }
}

impl TractionGrid {
    /// Improves the given tractions until they hold the points at their targets, as far as friction allows. Returns the
    /// largest violation, mm, and the share of the points that slip.
    pub(crate) fn solve_tractions(
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
        let slips = |(t, limit): &(&[f32; 2], &f32)| vector_length(**t) >= SLIPS_FROM * **limit;
        // Points that slipped before will slip again: a solution with full stick would be a detour.
        let begun = tractions.iter().any(|t| *t != [0.0; 2]);
        if !begun || !tractions.iter().zip(&limits).any(|pair| slips(&pair)) {
            let residual_mm = self.solve_stick(tractions, iterations);
            if !tractions.iter().zip(&limits).any(|(t, limit)| vector_length(*t) > *limit) {
                return (residual_mm, 0.0);
            }
        }
        let residual_mm = self.solve_slip(tractions, &limits, iterations);
        let slipping = tractions.iter().zip(&limits).filter(slips).count();
        (residual_mm, slipping as f64 / limits.len() as f64)
    }

    /// Improves the given tractions until every point is at its target. Returns the largest remaining distance, mm.
    fn solve_stick(&mut self, tractions: &mut [[f32; 2]], iterations: &mut u32) -> f64 {
        let mut left: Vec<[f32; 2]> = self.points.iter().map(|point| point.target_mm).collect();
        if tractions.iter().any(|t| *t != [0.0; 2]) {
            left = difference(&left, &self.apply_response(tractions, false));
        }
        let mut direction = vec![[0.0; 2]; left.len()];
        let mut last_product = 0.0;
        loop {
            let residual = largest_length(&left);
            if residual <= TOLERANCE_MM || *iterations == MAX_ITERATIONS {
                return residual;
            }
            *iterations += 1;
            let step = self.apply_response(&left, true);
            let product = dot(&left, &step);
            let share = if last_product > 0.0 { (product / last_product) as f32 } else { 0.0 };
            last_product = product;
            for (d, z) in direction.iter_mut().zip(&step) {
                *d = [0, 1].map(|k| z[k] + share * d[k]);
            }
            let response = self.apply_response(&direction, false);
            let curvature = dot(&direction, &response);
            // Without positive curvature only rounding is left: no step would help.
            let along = if curvature > 0.0 { (product / curvature) as f32 } else { return residual };
            for (((t, d), r), u) in tractions.iter_mut().zip(&direction).zip(&mut left).zip(&response) {
                for k in 0..2 {
                    t[k] += along * d[k];
                    r[k] -= along * u[k];
                }
            }
        }
    }

    /// Turns tractions of full stick into those of least energy within `limits`. Returns the largest violation of the
    /// friction model, mm.
    fn solve_slip(&mut self, tractions: &mut Vec<[f32; 2]>, limits: &[f32], iterations: &mut u32) -> f64 {
        let end = *iterations + MAX_ITERATIONS;
        for (t, limit) in tractions.iter_mut().zip(limits) {
            *t = limit_length(*t, *limit);
        }
        let mut moved = self.apply_response(tractions, false);
        // An estimate of the contact's largest compliance, which bounds the step length. It grows when it turns out too
        // small.
        let mut softest = (dot(tractions, &moved) / dot(tractions, tractions)).max(0.0);
        // Tractions of 0 give no scale for a step.
        if !softest.is_normal() {
            return self.measure_violation(tractions, &moved, limits, 1.0);
        }
        // The next step starts from a point ahead of the last one, by momentum.
        let (mut ahead, mut ahead_moved) = (tractions.clone(), moved.clone());
        let mut momentum = 1.0_f64;
        loop {
            let residual = self.measure_violation(tractions, &moved, limits, softest as f32);
            if residual <= TOLERANCE_MM || *iterations >= end {
                return residual;
            }
            *iterations += 1;
            let next = self.project_step(&ahead, &ahead_moved, limits, softest as f32);
            let next_moved = self.apply_response(&next, false);
            let (step, step_moved) = (difference(&next, &ahead), difference(&next_moved, &ahead_moved));
            let curvature = dot(&step, &step_moved) / dot(&step, &step).max(f64::MIN_POSITIVE);
            if curvature > 1.001 * softest {
                softest = 1.2 * curvature;
                continue;
            }
            let change = difference(&next, tractions);
            let change_moved = difference(&next_moved, &moved);
            // Momentum that leads uphill is dropped (restart).
            let overshot = dot(&step, &change) < 0.0;
            let last = if overshot { 1.0 } else { momentum };
            momentum = 0.5 * (1.0 + libm::sqrt(1.0 + 4.0 * last * last));
            let share = if overshot { 0.0 } else { ((last - 1.0) / momentum) as f32 };
            (*tractions, moved) = (next, next_moved);
            ahead = add_scaled(tractions, &change, share);
            ahead_moved = add_scaled(&moved, &change_moved, share);
        }
    }

    /// Takes one step downhill from `tractions`, which move the points by `moved`, and limits the result.
    fn project_step(&self, tractions: &[[f32; 2]], moved: &[[f32; 2]], limits: &[f32], softest: f32) -> Vec<[f32; 2]> {
        let points = self.points.iter().zip(limits);
        let all = tractions.iter().zip(moved).zip(points);
        all.map(|((t, u), (point, limit))| {
            limit_length([0, 1].map(|k| t[k] - (u[k] - point.target_mm[k]) / softest), *limit)
        })
        .collect()
    }

    /// Returns how far a step would go, as a displacement, mm: 0 where the friction conditions hold.
    fn measure_violation(&self, tractions: &[[f32; 2]], moved: &[[f32; 2]], limits: &[f32], softest: f32) -> f64 {
        let next = self.project_step(tractions, moved, limits, softest);
        f64::from(softest) * largest_length(&difference(&next, tractions))
    }

    fn pressure(&self) -> Grid<f32> {
        let mut pressure = Grid::new(self.size[0], self.size[1]);
        for point in &self.points {
            let [column, row] = point.pixel;
            pressure.row_mut(row)[column] = point.pressure;
        }
        pressure
    }

    fn to_traction_field(&self, tractions: &[[f32; 2]]) -> TractionField {
        let [width, height] = self.size;
        let (mut x, mut y) = (Grid::new(width, height), Grid::new(width, height));
        for (point, t) in self.points.iter().zip(tractions) {
            let [column, row] = point.pixel;
            [x.row_mut(row)[column], y.row_mut(row)[column]] = *t;
        }
        TractionField { x, y, origin_mm: self.origin_mm, mm_per_px: self.mm_per_px }
    }

    /// Returns force and moment of the tractions, over Young's modulus.
    fn force_and_moment(&self, tractions: &[[f32; 2]], about_mm: [f64; 2]) -> ([f64; 2], f64) {
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
