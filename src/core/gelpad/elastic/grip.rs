//! A contact ready for tractions: what tractions and pressures on its pixels displace, by Fourier transforms on a torus.

use super::fft::fast_length;
use super::inplane::layer_response;
use super::layer::ElasticLayer;
use super::plane::{Plane, Response, Symbol, Values};
use crate::base::grid::{Grid, Rect};

/// A side of the torus has at most so many pixels.
const TORUS_PX: usize = 384;

/// Share of the reach of what tractions displace over which it fades to 0.
const FADE: f64 = 0.3;

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
    pub place_mm: [f64; 2],
    /// Over Young's modulus.
    pub pressure: f32,
    /// Where the object takes it, mm.
    pub wanted: [f32; 2],
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
    pub fn want(&mut self, by: impl Fn([f64; 2]) -> [f64; 2]) {
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

pub(super) fn sum(a: &[[f32; 2]], b: &[[f32; 2]], share: f32) -> Vec<[f32; 2]> {
    a.iter().zip(b).map(|(a, b)| [a[0] + share * b[0], a[1] + share * b[1]]).collect()
}
