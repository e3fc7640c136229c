//! A contact's grid for tractions: computes, by Fourier transforms on a torus, how tractions and pressures on its
//! pixels displace the pad.

use super::convolve::{ConvolutionBuffers, ConvolutionShape};
use super::fft::fast_length;
use super::in_plane::layer_response;
use super::layer::ElasticLayer;
use super::plane_transform::{PlaneTransform, Symbol, VectorField, VectorResponse};
use super::vector_convolve::{FrequencyFactors, InPlane};
use crate::base::grid::{Grid, Rect};

/// Most pixels along a side of the torus.
const TORUS_PX: usize = 384;

/// Share of the reach over which the displacement by tractions fades to 0.
const FADE: f64 = 0.3;

/// A displacement or a traction: its components along x and y.
pub(super) type Vector = [f32; 2];

/// The grid of a contact, prepared for tractions. Vectors are lists with one entry for each pixel in contact.
#[derive(Clone)]
pub(super) struct TractionGrid {
    pub plane: PlaneTransform,
    pub values: VectorField,
    layer: ElasticLayer,
    response: VectorResponse,
    inverse: VectorResponse,
    /// Memory for responses in the contact's box; made when first needed.
    box_response: Option<BoxResponse>,
    /// Displacement of a pixel under its own unit traction; computed when first needed.
    own_response: Option<f32>,
    /// From pressure to displacement; computed when first needed.
    pressure_symbol: Option<Symbol>,
    /// Number of pixels of the contact's box along x and y.
    pub size: [usize; 2],
    pub origin_mm: [f64; 2],
    pub mm_per_px: [f64; 2],
    /// Number of the pressure's pixels in one pixel of this grid, along x and y.
    factor: [usize; 2],
    pub points: Vec<ContactPoint>,
}

/// Spectra of the response in the contact's box and of its inverse, and memory to apply them.
#[derive(Clone)]
struct BoxResponse {
    response: FrequencyFactors<3>,
    inverse: FrequencyFactors<3>,
    source: [Grid<f32>; 2],
    target: [Grid<f32>; 2],
    buffers: [ConvolutionBuffers; 2],
}

/// A pixel in contact.
#[derive(Clone)]
pub(super) struct ContactPoint {
    pub pixel: [usize; 2],
    pub place_mm: [f64; 2],
    /// Pressure over Young's modulus.
    pub pressure: f32,
    /// Displacement that the object requires, mm.
    pub target_mm: [f32; 2],
}

impl TractionGrid {
    /// Makes a grid for contacts in the part `part` of a pressure's pixels; its longer side has at most `most_px`
    /// pixels. `room` thicknesses are left free around it.
    pub fn new(
        layer: ElasticLayer,
        [from_mm, spacing_mm]: [[f64; 2]; 2],
        part: Rect,
        most_px: usize,
        room: f64,
    ) -> Self {
        let box_px = [part.width(), part.height()];
        let box_mm = [0, 1].map(|k| box_px[k] as f64 * spacing_mm[k]);
        let widest_px_mm = box_mm[0].max(box_mm[1]) / most_px as f64;
        let factor = spacing_mm.map(|spacing| (libm::ceil(widest_px_mm / spacing - 1e-9) as usize).max(1));
        let mm_per_px = [0, 1].map(|k| factor[k] as f64 * spacing_mm[k]);
        let size = [0, 1].map(|k| box_px[k].div_ceil(factor[k]));
        let torus = [0, 1].map(|k| {
            let room = (room * layer.thickness_mm / mm_per_px[k]).min(TORUS_PX as f64) as usize;
            // Never less than twice the contact, so that its nearest copy is at least one contact away.
            fast_length((size[k] + room).min(TORUS_PX).max(2 * size[k]))
        });
        let plane = PlaneTransform::new(torus);
        let norm = 1.0 / (torus[0] * torus[1]) as f64;
        let torus_mm = [0, 1].map(|k| torus[k] as f64 * mm_per_px[k]);
        let response =
            plane.make_response(mm_per_px, |wave| layer_response(layer, wave, torus_mm).map(|part| part * norm));
        let first = [part.x0, part.y0];
        let origin_mm =
            std::array::from_fn(|k| from_mm[k] + (first[k] as f64 + 0.5 * (factor[k] - 1) as f64) * spacing_mm[k]);
        Self {
            values: plane.zeros(),
            inverse: response.inverse(norm),
            response,
            box_response: None,
            own_response: None,
            pressure_symbol: None,
            layer,
            plane,
            size,
            origin_mm,
            mm_per_px,
            factor,
            points: Vec::new(),
        }
    }

    /// Returns the grid on a torus of twice the box, in which no copy has an influence. The response is cut out of this
    /// grid's.
    pub fn free_space_grid(&mut self) -> Self {
        let plane = PlaneTransform::new(self.size.map(|size| fast_length(2 * size)));
        let torus = plane.size();
        let under = [[1.0, 0.0], [0.0, 1.0]].map(|unit: Vector| {
            let [x, y] = self.values.vectors_mut();
            x.fill(0.0);
            y.fill(0.0);
            let first = self.plane.value_index(0, 0);
            [x[first], y[first]] = unit;
            self.plane.forward(&mut self.values);
            self.values.apply_response(&self.response);
            self.plane.inverse(&mut self.values);
            let mut kernel = plane.zeros();
            let lags = |k: usize| {
                let (size, own, small) = (self.size[k], self.plane.size()[k], torus[k]);
                (0..size).map(|lag| (lag, lag)).chain((1..size).map(move |lag| (own - lag, small - lag)))
            };
            let from = self.values.vectors();
            for (to, from) in kernel.vectors_mut().into_iter().zip(from) {
                for (from_y, to_y) in lags(1) {
                    for (from_x, to_x) in lags(0) {
                        to[plane.value_index(to_x, to_y)] = from[self.plane.value_index(from_x, from_y)];
                    }
                }
            }
            kernel
        });
        let [under_x, under_y] = under;
        let norm = 1.0 / (torus[0] * torus[1]) as f64;
        let torus_mm = [0, 1].map(|k| torus[k] as f64 * self.mm_per_px[k]);
        let (layer, mm_per_px) = (self.layer, self.mm_per_px);
        let periodic =
            plane.make_response(mm_per_px, |wave| layer_response(layer, wave, torus_mm).map(|part| part * norm));
        Self {
            values: plane.zeros(),
            // Cut out, the response might have no inverse; an approximate one is enough for preconditioning.
            inverse: periodic.inverse(norm),
            response: plane.response_from_kernels(under_x, under_y),
            box_response: None,
            own_response: None,
            pressure_symbol: None,
            plane,
            points: Vec::new(),
            ..*self
        }
    }

    /// Sets the points to the pixels where a pressure touches in its part `part`; their targets are 0.
    pub fn set_contact(&mut self, pressure: &Grid<f32>, part: Rect) {
        let pressure = downsample_pressure(pressure, part, self.factor);
        self.points.clear();
        for y in 0..pressure.height {
            for (x, p) in pressure.row(y).iter().enumerate().filter(|(_, p)| **p > 0.0) {
                let place_mm = [x, y].map(|at| at as f64);
                let place_mm = [0, 1].map(|k| self.origin_mm[k] + place_mm[k] * self.mm_per_px[k]);
                self.points.push(ContactPoint { pixel: [x, y], place_mm, pressure: *p, target_mm: [0.0; 2] });
            }
        }
    }

    /// Requires every point to be displaced by `by` of its position.
    pub fn set_targets(&mut self, by: impl Fn([f64; 2]) -> [f64; 2]) {
        for point in &mut self.points {
            point.target_mm = by(point.place_mm).map(|mm| mm as f32);
        }
    }

    /// Requires every point to stay where it is without the pressure.
    pub fn set_rest_targets(&mut self) {
        self.apply_pressure();
        let moved = self.gather_points();
        for (point, moved) in self.points.iter_mut().zip(moved) {
            point.target_mm = moved.map(|mm| -mm);
        }
    }

    /// Fills the values with the displacement under the pressure of the points.
    fn apply_pressure(&mut self) {
        let pressures: Vec<[f32; 2]> = self.points.iter().map(|point| [point.pressure, 0.0]).collect();
        self.scatter_points(&pressures);
        self.plane.forward(&mut self.values);
        self.values.multiply(pressure_symbol(&mut self.pressure_symbol, self.layer, &self.plane, self.mm_per_px));
        self.plane.inverse(&mut self.values);
    }

    /// Replaces tractions by the displacement into the pad that they cause, in the x component of the values.
    fn apply_normal_coupling(&mut self) {
        self.plane.forward(&mut self.values);
        self.values.apply_coupling(
            pressure_symbol(&mut self.pressure_symbol, self.layer, &self.plane, self.mm_per_px),
            &self.response,
        );
        self.plane.inverse(&mut self.values);
    }

    /// Sets the points to the pixels of the box where a pressure on the box's own pixels touches.
    pub fn set_whole_contact(&mut self, pressure: &Grid<f32>) {
        self.set_contact(pressure, Rect::whole(pressure.width, pressure.height));
    }

    /// Returns the displacement of a pixel under its own unit traction, mm.
    pub fn own_response(&mut self) -> f32 {
        if self.own_response.is_none() {
            let mut unit = Grid::new(self.size[0], self.size[1]);
            unit.data[0] = [1.0, 0.0];
            self.own_response = Some(self.motion_under_tractions(&unit).data[0][0]);
        }
        self.own_response.unwrap_or_default()
    }

    /// Returns the displacement, mm, of points under equal tractions, over that traction: about the largest compliance
    /// of the contact.
    pub fn largest_compliance(&mut self) -> f64 {
        let even = vec![[1.0, 0.0]; self.points.len()];
        let moved = self.apply_response(&even, false);
        dot(&even, &moved) / even.len().max(1) as f64
    }

    /// Computes the motion of the complete box under the pressure of the points.
    pub fn motion_under_pressure(&mut self) -> Grid<Vector> {
        self.apply_pressure();
        self.gather_box()
    }

    /// Computes the motion of the complete box under tractions on its pixels.
    pub fn motion_under_tractions(&mut self, tractions: &Grid<Vector>) -> Grid<Vector> {
        let [width, height] = self.size;
        let [x, y] = self.respond_in_box(false, |source| {
            for (at, vector) in tractions.data.iter().enumerate() {
                source.iter_mut().zip(vector).for_each(|(component, part)| component.data[at] = *part);
            }
        });
        Grid { width, height, data: x.data.iter().zip(&y.data).map(|(x, y)| [*x, *y]).collect() }
    }

    /// Returns the number of pixels in `thicknesses`, at most what the torus holds.
    pub fn reach_px(&self, thicknesses: f64) -> [usize; 2] {
        let torus = self.plane.size();
        [0, 1].map(|k| {
            let px = (thicknesses * self.layer.thickness_mm / self.mm_per_px[k]).min(torus[k] as f64) as usize;
            px.clamp(2, (torus[k] - self.size[k]) / 2 - 1)
        })
    }

    /// Computes the displacement into the pad, mm, under tractions on the box's pixels, in the box and `reach` pixels
    /// around it. Over the outer share `FADE` of the reach it fades to 0.
    pub fn normal_displacement(&mut self, tractions: &Grid<Vector>, reach: [usize; 2]) -> Grid<f32> {
        self.scatter_box(tractions);
        self.apply_normal_coupling();
        let torus = self.plane.size();
        // For each position along an axis: its index on the torus, and the factor by which it fades.
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
                *value = values[self.plane.value_index(*x, *from)] * kept * down_kept;
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
                let at = self.plane.value_index(column, row);
                [x[at], y[at]] = *vector;
            }
        }
    }

    fn gather_box(&self) -> Grid<Vector> {
        let [x, y] = self.values.vectors();
        let mut out = Grid::new(self.size[0], self.size[1]);
        for row in 0..out.height {
            for (column, vector) in out.row_mut(row).iter_mut().enumerate() {
                let at = self.plane.value_index(column, row);
                *vector = [x[at], y[at]];
            }
        }
        out
    }

    fn scatter_points(&mut self, vectors: &[[f32; 2]]) {
        let [x, y] = self.values.vectors_mut();
        x.fill(0.0);
        y.fill(0.0);
        for (point, vector) in self.points.iter().zip(vectors) {
            let at = self.plane.value_index(point.pixel[0], point.pixel[1]);
            [x[at], y[at]] = *vector;
        }
    }

    fn gather_points(&self) -> Vec<[f32; 2]> {
        let [x, y] = self.values.vectors();
        let at = |point: &ContactPoint| self.plane.value_index(point.pixel[0], point.pixel[1]);
        self.points.iter().map(|point| [x[at(point)], y[at(point)]]).collect()
    }

    /// Returns the displacements in the contact under tractions in it; with `back`, the approximate inverse.
    pub fn apply_response(&mut self, vectors: &[[f32; 2]], back: bool) -> Vec<[f32; 2]> {
        let points = std::mem::take(&mut self.points);
        let [x, y] = self.respond_in_box(back, |[to_x, to_y]| {
            for (point, [x, y]) in points.iter().zip(vectors) {
                let at = point.pixel[1] * to_x.width + point.pixel[0];
                (to_x.data[at], to_y.data[at]) = (*x, *y);
            }
        });
        let moved = points.iter().map(|ContactPoint { pixel: [column, row], .. }| {
            let at = row * x.width + column;
            [x.data[at], y.data[at]]
        });
        let moved = moved.collect();
        self.points = points;
        moved
    }

    /// Computes the response in the box, or its approximate inverse, to the vectors that `fill` writes into zeros.
    fn respond_in_box(&mut self, back: bool, fill: impl FnOnce(&mut [Grid<f32>; 2])) -> &[Grid<f32>; 2] {
        let known = self.box_response.get_or_insert_with(|| BoxResponse {
            response: FrequencyFactors::of_response(&self.plane, &self.response),
            inverse: FrequencyFactors::of_response(&self.plane, &self.inverse),
            source: Default::default(),
            target: Default::default(),
            buffers: Default::default(),
        });
        let BoxResponse { response, inverse, source, target, buffers } = known;
        source.iter_mut().for_each(|component| component.reset(self.size[0], self.size[1]));
        fill(source);
        target.iter_mut().for_each(|component| component.reshape(self.size[0], self.size[1]));
        let factors = if back { inverse } else { response };
        let ([from_x, from_y], [to_x, to_y]) = (&*source, &mut *target);
        self.plane.convolution(ConvolutionShape::within(self.size)).convolve_fields::<InPlane, 2, 3>(
            factors,
            [&from_x.data, &from_y.data],
            &mut [&mut to_x.data, &mut to_y.data],
            buffers,
        );
        target
    }
}

/// Averages blocks of `factor` pixels of the part `part`, so that the force stays the same. A block touches if any of
/// its pixels does. This makes a contact at most 2 % wider and loses no thin part of it.
fn downsample_pressure(pressure: &Grid<f32>, part: Rect, factor: [usize; 2]) -> Grid<f32> {
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

/// Returns the response to pressure; it is made at the first call.
fn pressure_symbol<'a>(
    known: &'a mut Option<Symbol>,
    layer: ElasticLayer,
    plane: &PlaneTransform,
    mm_per_px: [f64; 2],
) -> &'a Symbol {
    known.get_or_insert_with(|| {
        let [width, height] = plane.size();
        let norm = 1.0 / (width * height) as f64;
        plane.gradient_symbol(mm_per_px, |wave| layer.coupling_compliance(wave.length()) * norm)
    })
}

pub(super) fn vector_length([x, y]: [f32; 2]) -> f32 {
    (x * x + y * y).sqrt()
}

/// Returns the nearest vector that is no longer than `limit`.
pub(super) fn limit_length(vector: [f32; 2], limit: f32) -> [f32; 2] {
    let long = vector_length(vector);
    if long > limit { vector.map(|part| part * (limit / long)) } else { vector }
}

pub(super) fn largest_length(vectors: &[[f32; 2]]) -> f64 {
    // A NaN must count as large.
    vectors
        .iter()
        .map(|v| vector_length(*v))
        .fold(0.0, |most: f32, long| if long <= most || most.is_nan() { most } else { long })
        .into()
}

pub(super) fn dot(a: &[[f32; 2]], b: &[[f32; 2]]) -> f64 {
    a.iter().zip(b).map(|(a, b)| f64::from(a[0]) * f64::from(b[0]) + f64::from(a[1]) * f64::from(b[1])).sum()
}

pub(super) fn difference(a: &[[f32; 2]], b: &[[f32; 2]]) -> Vec<[f32; 2]> {
    add_scaled(a, b, -1.0)
}

pub(super) fn add_scaled(a: &[[f32; 2]], b: &[[f32; 2]], share: f32) -> Vec<[f32; 2]> {
    a.iter().zip(b).map(|(a, b)| [a[0] + share * b[0], a[1] + share * b[1]]).collect()
}
