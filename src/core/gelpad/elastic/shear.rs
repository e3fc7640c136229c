//! Tangential tractions under an object that holds the pad while it is pressed in ([`super::friction`]), or that is then moved
//! and twisted in the pad's plane.
//!
//! The contact and its pressure p are given; what tractions do to them in turn is [`super::friction`]'s. Full stick:
//! the surface follows the object wherever they touch (conjugate gradients, preconditioned with the inverse response).
//! Coulomb's law: |t| <= coefficient p, the tractions being those of least energy (Kalker 1990), by accelerated
//! projected gradients (Beck and Teboulle 2009) with restarts (O'Donoghue and Candes 2015); all of a motion in one step.

use serde::{Deserialize, Serialize};

use super::fft::fast_length;
use super::inplane::{Field, Load, Traction, layer_response};
use super::layer::ElasticLayer;
use super::plane::{Plane, Response, Symbol, Values};
use crate::core::base::grid::{Grid, Rect, bounding_box};

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
#[cfg_attr(feature = "datasets", derive(schemars::JsonSchema))]
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

/// A side of the torus has at most so many pixels.
const TORUS_PX: usize = 384;

/// Room around the contact, so that the torus's copies are not felt, thicknesses.
const ROOM: f64 = 4.0;

/// Share of the reach of what tractions displace over which it fades to 0.
const FADE: f64 = 0.3;

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

/// A displacement or a traction: its parts along x and y.
pub(super) type Vector = [f32; 2];

/// A contact ready for tractions. Vectors are lists with one entry for each pixel that touches.
pub(super) struct Grip {
    pub plane: Plane,
    pub values: Values,
    layer: ElasticLayer,
    response: Response,
    inverse: Response,
    /// Of a pixel to its own traction, once it was needed.
    own: Option<f32>,
    /// From pressure to displacement, once it was needed.
    push: Option<Symbol>,
    /// Pixels of the contact's box.
    pub size: [usize; 2],
    pub origin_mm: [f64; 2],
    pub mm_per_px: [f64; 2],
    /// Pixels of the pressure in one of these.
    factor: [usize; 2],
    pub points: Vec<Point>,
}

/// A pixel that touches.
pub(super) struct Point {
    pub pixel: [usize; 2],
    place_mm: [f64; 2],
    /// Over Young's modulus.
    pub pressure: f32,
    /// Where the object takes it, mm.
    wanted: [f32; 2],
}

impl Grip {
    /// For contacts in the part `part` of a pressure's pixels, the longer side of which is to have at most `most_px`.
    /// `room` thicknesses are left around them.
    pub fn new(layer: ElasticLayer, [from_mm, pitch_mm]: [[f64; 2]; 2], part: Rect, most_px: usize, room: f64) -> Self {
        let box_px = [part.width(), part.height()];
        let box_mm = [0, 1].map(|k| box_px[k] as f64 * pitch_mm[k]);
        let widest_px_mm = box_mm[0].max(box_mm[1]) / most_px as f64;
        let factor = pitch_mm.map(|pitch| (libm::ceil(widest_px_mm / pitch - 1e-9) as usize).max(1));
        let mm_per_px = [0, 1].map(|k| factor[k] as f64 * pitch_mm[k]);
        let size = [0, 1].map(|k| box_px[k].div_ceil(factor[k]));
        let torus = [0, 1].map(|k| {
            let room = (room * layer.thickness_mm / mm_per_px[k]).min(TORUS_PX as f64) as usize;
            fast_length((size[k] + room).min(TORUS_PX).max(2 * size[k]))
        });
        let plane = Plane::new(torus);
        let norm = 1.0 / (torus[0] * torus[1]) as f64;
        let torus_mm = [0, 1].map(|k| torus[k] as f64 * mm_per_px[k]);
        let response = plane.response(mm_per_px, |wave| layer_response(layer, wave, torus_mm).map(|part| part * norm));
        let first = [part.x0, part.y0];
        let origin_mm =
            std::array::from_fn(|k| from_mm[k] + (first[k] as f64 + 0.5 * (factor[k] - 1) as f64) * pitch_mm[k]);
        Self {
            values: plane.zeros(),
            inverse: response.inverse(norm),
            response,
            own: None,
            push: None,
            layer,
            plane,
            size,
            origin_mm,
            mm_per_px,
            factor,
            points: Vec::new(),
        }
    }

    /// The same on a torus of twice the box, on which no copy is felt within the box: the response is cut out of this one's.
    pub fn in_free_space(&mut self) -> Self {
        let plane = Plane::new(self.size.map(|size| fast_length(2 * size)));
        let torus = plane.size();
        let under = [[1.0, 0.0], [0.0, 1.0]].map(|unit: Vector| {
            let [x, y] = self.values.vectors_mut();
            x.fill(0.0);
            y.fill(0.0);
            let first = self.plane.place(0, 0);
            [x[first], y[first]] = unit;
            self.plane.forward(&mut self.values);
            self.values.respond(&self.response);
            self.plane.back(&mut self.values);
            let mut kernel = plane.zeros();
            let lags = |k: usize| {
                let (size, own, small) = (self.size[k], self.plane.size()[k], torus[k]);
                (0..size).map(|lag| (lag, lag)).chain((1..size).map(move |lag| (own - lag, small - lag)))
            };
            let from = self.values.vectors();
            for (to, from) in kernel.vectors_mut().into_iter().zip(from) {
                for (from_y, to_y) in lags(1) {
                    for (from_x, to_x) in lags(0) {
                        to[plane.place(to_x, to_y)] = from[self.plane.place(from_x, from_y)];
                    }
                }
            }
            kernel
        });
        let [under_x, under_y] = under;
        let norm = 1.0 / (torus[0] * torus[1]) as f64;
        let torus_mm = [0, 1].map(|k| torus[k] as f64 * self.mm_per_px[k]);
        let (layer, mm_per_px) = (self.layer, self.mm_per_px);
        let periodic = plane.response(mm_per_px, |wave| layer_response(layer, wave, torus_mm).map(|part| part * norm));
        Self {
            values: plane.zeros(),
            // Cut out, the response might have no inverse; roughly is enough.
            inverse: periodic.inverse(norm),
            response: plane.response_to(under_x, under_y),
            own: None,
            push: None,
            plane,
            points: Vec::new(),
            ..*self
        }
    }

    /// Notes where in its part `part` a pressure touches; nothing is wanted of these points yet.
    pub fn touch(&mut self, pressure: &Grid<f32>, part: Rect) {
        let pressure = thinned(pressure, part, self.factor);
        self.points.clear();
        for y in 0..pressure.height {
            for (x, p) in pressure.row(y).iter().enumerate().filter(|(_, p)| **p > 0.0) {
                let place_mm = [x, y].map(|at| at as f64);
                let place_mm = [0, 1].map(|k| self.origin_mm[k] + place_mm[k] * self.mm_per_px[k]);
                self.points.push(Point { pixel: [x, y], place_mm, pressure: *p, wanted: [0.0; 2] });
            }
        }
    }

    /// Wants every point to go `by` from its place.
    fn want(&mut self, by: impl Fn([f64; 2]) -> [f64; 2]) {
        for point in &mut self.points {
            point.wanted = by(point.place_mm).map(|mm| mm as f32);
        }
    }

    /// Wants every point to stay where it is under the pressure.
    pub fn want_rest(&mut self) {
        self.push_points();
        let moved = self.gathered();
        for (point, moved) in self.points.iter_mut().zip(moved) {
            point.wanted = moved.map(|mm| -mm);
        }
    }

    /// The values under the pressure of the points.
    fn push_points(&mut self) {
        let pressures: Vec<[f32; 2]> = self.points.iter().map(|point| [point.pressure, 0.0]).collect();
        self.scatter(&pressures);
        self.plane.forward(&mut self.values);
        self.values.times(push(&mut self.push, self.layer, &self.plane, self.mm_per_px));
        self.plane.back(&mut self.values);
    }

    /// From tractions to the displacement into the pad that they cause, the x of the values.
    fn sink_values(&mut self) {
        self.plane.forward(&mut self.values);
        self.values.sink(push(&mut self.push, self.layer, &self.plane, self.mm_per_px), &self.response);
        self.plane.back(&mut self.values);
    }

    /// Tractions that hold the points where they are wanted, as far as friction does, beginning with the ones given; the
    /// largest distance, mm, from that, and the share of the points that slip.
    pub fn hold(&mut self, friction: Friction, tractions: &mut Vec<[f32; 2]>, iterations: &mut u32) -> (f64, f64) {
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

    /// Notes every pixel of the box where a pressure touches, on the box's own pixels.
    pub fn touch_all(&mut self, pressure: &Grid<f32>) {
        self.touch(pressure, Rect::whole(pressure.width, pressure.height));
    }

    /// Displacement of a pixel under its own unit traction, mm.
    pub fn own_response(&mut self) -> f32 {
        if self.own.is_none() {
            let [x, y] = self.values.vectors_mut();
            x.fill(0.0);
            y.fill(0.0);
            let first = self.plane.place(0, 0);
            x[first] = 1.0;
            self.plane.forward(&mut self.values);
            self.values.respond(&self.response);
            self.plane.back(&mut self.values);
            self.own = Some(self.values.vectors()[0][first]);
        }
        self.own.unwrap_or_default()
    }

    /// Displacement, mm, of points that are all pulled alike, over the traction: about the softest that the contact can be.
    pub fn softest_response(&mut self) -> f64 {
        let even = vec![[1.0, 0.0]; self.points.len()];
        let moved = self.respond(&even, false);
        dot(&even, &moved) / even.len().max(1) as f64
    }

    /// Motion of the whole box under the pressure of the points.
    pub fn pushed(&mut self) -> Grid<Vector> {
        self.push_points();
        self.whole_box()
    }

    /// Motion of the whole box under tractions on its pixels.
    pub fn moved(&mut self, tractions: &Grid<Vector>) -> Grid<Vector> {
        self.scatter_box(tractions);
        self.plane.forward(&mut self.values);
        self.values.respond(&self.response);
        self.plane.back(&mut self.values);
        self.whole_box()
    }

    /// Pixels of `thicknesses`, or as far as the torus knows.
    pub fn reach(&self, thicknesses: f64) -> [usize; 2] {
        let torus = self.plane.size();
        [0, 1].map(|k| {
            let px = (thicknesses * self.layer.thickness_mm / self.mm_per_px[k]).min(torus[k] as f64) as usize;
            px.clamp(2, (torus[k] - self.size[k]) / 2 - 1)
        })
    }

    /// Displacement into the pad, mm, under tractions on the box's pixels, in the box and `reach` pixels around it, over the
    /// outer `FADE` of which it fades to 0.
    pub fn sunk(&mut self, tractions: &Grid<Vector>, reach: [usize; 2]) -> Grid<f32> {
        self.scatter_box(tractions);
        self.sink_values();
        let torus = self.plane.size();
        // Of a place along an axis, where it stands on the torus and how much of it is kept.
        let along = |k: usize| -> Vec<(usize, f32)> {
            let count = self.size[k] + 2 * reach[k];
            let kept = |at: usize| {
                let beyond = reach[k].saturating_sub(at).max((at + 1 + reach[k]).saturating_sub(count));
                let left = ((reach[k] as f64 - beyond as f64) / (FADE * reach[k] as f64)).clamp(0.0, 1.0);
                (left * left * (3.0 - 2.0 * left)) as f32
            };
            (0..count).map(|at| ((at + torus[k] - reach[k]) % torus[k], kept(at))).collect()
        };
        let (columns, rows) = (along(0), along(1));
        let mut down = Grid::new(columns.len(), rows.len());
        let [values, _] = self.values.vectors();
        for (y, (from, down_kept)) in rows.iter().enumerate() {
            for (value, (x, kept)) in down.row_mut(y).iter_mut().zip(&columns) {
                *value = values[self.plane.place(*x, *from)] * kept * down_kept;
            }
        }
        down
    }

    fn scatter_box(&mut self, vectors: &Grid<Vector>) {
        let [x, y] = self.values.vectors_mut();
        x.fill(0.0);
        y.fill(0.0);
        for row in 0..vectors.height {
            for (column, vector) in vectors.row(row).iter().enumerate() {
                let at = self.plane.place(column, row);
                [x[at], y[at]] = *vector;
            }
        }
    }

    fn whole_box(&self) -> Grid<Vector> {
        let [x, y] = self.values.vectors();
        let mut out = Grid::new(self.size[0], self.size[1]);
        for row in 0..out.height {
            for (column, vector) in out.row_mut(row).iter_mut().enumerate() {
                let at = self.plane.place(column, row);
                *vector = [x[at], y[at]];
            }
        }
        out
    }

    fn scatter(&mut self, vectors: &[[f32; 2]]) {
        let [x, y] = self.values.vectors_mut();
        x.fill(0.0);
        y.fill(0.0);
        for (point, vector) in self.points.iter().zip(vectors) {
            let at = self.plane.place(point.pixel[0], point.pixel[1]);
            [x[at], y[at]] = *vector;
        }
    }

    fn gathered(&self) -> Vec<[f32; 2]> {
        let [x, y] = self.values.vectors();
        let at = |point: &Point| self.plane.place(point.pixel[0], point.pixel[1]);
        self.points.iter().map(|point| [x[at(point)], y[at(point)]]).collect()
    }

    /// Displacements in the contact under tractions in it; or roughly the way back, with the inverse.
    pub fn respond(&mut self, vectors: &[[f32; 2]], back: bool) -> Vec<[f32; 2]> {
        self.scatter(vectors);
        self.plane.forward(&mut self.values);
        self.values.respond(if back { &self.inverse } else { &self.response });
        self.plane.back(&mut self.values);
        self.gathered()
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

/// Means over blocks of `factor` pixels of the part `part`, so that the force stays. A block touches if any pixel does,
/// which makes a contact wider by 2 % at most, and loses no thin part of it.
fn thinned(pressure: &Grid<f32>, part: Rect, factor: [usize; 2]) -> Grid<f32> {
    let mut out = Grid::new(part.width().div_ceil(factor[0]), part.height().div_ceil(factor[1]));
    let share = 1.0 / (factor[0] * factor[1]) as f32;
    for y in part.y0..part.y1 {
        let to = out.row_mut((y - part.y0) / factor[1]);
        for (x, p) in pressure.row(y)[part.x0..part.x1].iter().enumerate() {
            to[x / factor[0]] += share * p.max(0.0);
        }
    }
    out
}

/// The response to pressure, made when it is needed first.
fn push<'a>(known: &'a mut Option<Symbol>, layer: ElasticLayer, plane: &Plane, pitch_mm: [f64; 2]) -> &'a Symbol {
    known.get_or_insert_with(|| {
        let [width, height] = plane.size();
        let norm = 1.0 / (width * height) as f64;
        plane.gradient(pitch_mm, |wave| layer.coupling(wave.length()) * norm)
    })
}

pub(super) fn length([x, y]: [f32; 2]) -> f32 {
    (x * x + y * y).sqrt()
}

/// The nearest vector that is no longer than `limit`.
pub(super) fn held(vector: [f32; 2], limit: f32) -> [f32; 2] {
    let long = length(vector);
    if long > limit { vector.map(|part| part * (limit / long)) } else { vector }
}

pub(super) fn largest(vectors: &[[f32; 2]]) -> f64 {
    // A NaN must not pass for a small number.
    vectors
        .iter()
        .map(|v| length(*v))
        .fold(0.0, |most: f32, long| if long <= most || most.is_nan() { most } else { long })
        .into()
}

pub(super) fn dot(a: &[[f32; 2]], b: &[[f32; 2]]) -> f64 {
    a.iter().zip(b).map(|(a, b)| f64::from(a[0]) * f64::from(b[0]) + f64::from(a[1]) * f64::from(b[1])).sum()
}

pub(super) fn difference(a: &[[f32; 2]], b: &[[f32; 2]]) -> Vec<[f32; 2]> {
    sum(a, b, -1.0)
}

fn sum(a: &[[f32; 2]], b: &[[f32; 2]], share: f32) -> Vec<[f32; 2]> {
    a.iter().zip(b).map(|(a, b)| [a[0] + share * b[0], a[1] + share * b[1]]).collect()
}
