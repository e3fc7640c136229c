//! In-plane motion of the pad's surface under pressures and tractions, as printed markers show it.
//!
//! With q the wave vector: u = i C p along q under pressure, H along and T across it under tractions
//! ([`super::layer`]), on a coarse grid: displacements are smooth on the scale of the pad and of the contact. Loads are
//! spread over the grid's hat functions, whose own transform is divided out, so that a load may lie anywhere.
//! Linear and for small strain, as the whole layer; the torus leaves six thicknesses around view and load. What is less
//! than four values of the grid wide is blurred.

use super::fft::fast_length;
use super::layer::ElasticLayer;
use super::plane::{Plane, Response, Symbol, Values, Wave};
use crate::base::cubic::catmull_rom;
use crate::base::grid::{Grid, Rect, bounding_box};
use crate::base::simd::simd_dispatch;
use crate::base::view::View;

/// Pressure on a regular grid.
#[derive(Clone, Debug, PartialEq)]
pub struct Load {
    /// Pressure over Young's modulus, positive towards the camera, 0 without contact; may be empty.
    pub pressure: Grid<f32>,
    /// Centre of the first pixel in the sensor's frame.
    pub origin_mm: [f64; 2],
    /// Distance between pixels, above 0.
    pub mm_per_px: [f64; 2],
}

/// Tangential tractions on a regular grid.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Traction {
    /// What pulls the surface to the right, over Young's modulus.
    pub x: Grid<f32>,
    /// What pulls it down in the image; as large as `x`.
    pub y: Grid<f32>,
    /// Centre of the first pixel in the sensor's frame.
    pub origin_mm: [f64; 2],
    /// Distance between pixels, above 0.
    pub mm_per_px: [f64; 2],
}

/// In-plane displacement over the view and a little beyond.
#[derive(Clone, Debug, PartialEq)]
pub struct Field {
    /// To the right, mm.
    pub x: Grid<f32>,
    /// Down in the image, mm.
    pub y: Grid<f32>,
    /// Where the first value stands in the sensor's frame.
    pub origin_mm: [f64; 2],
    /// Distance between values.
    pub pitch_mm: f64,
}

/// The layer made ready for a view.
#[derive(Clone, Debug)]
pub struct InPlane {
    plane: Plane,
    pitch_mm: f64,
    /// Of the torus's first value.
    origin_mm: [f64; 2],
    /// The part of the torus that is handed out.
    seen: Rect,
    under_pressure: Symbol,
    under_traction: Response,
}

/// Values along the longer side of the view and the load around it.
const FINENESS: f64 = 240.0;

/// The same where the pad is too thin for that.
const FINEST: f64 = 320.0;

/// Room around view and load, so that the torus's copies are not felt, thicknesses.
const ROOM: f64 = 6.0;

/// How far a load may go beyond the view, thicknesses.
const MARGIN: f64 = 1.5;

/// Values known beyond the view, so that it can be interpolated up to its border.
const BORDER: f64 = 2.0;

impl InPlane {
    /// For a view of `field_of_view_mm` whose pixels are `mm_per_px` apart, all above 0.
    ///
    /// Loads count up to 1.5 thicknesses beyond the view (half its longer side where the pad is thicker than that, 16
    /// pixels where it is thinner); what lies much further out is left out.
    pub fn new(layer: ElasticLayer, field_of_view_mm: [f64; 2], mm_per_px: [f64; 2]) -> Self {
        let h = layer.thickness_mm;
        let longest = field_of_view_mm[0].max(field_of_view_mm[1]);
        let pixel = mm_per_px[0].max(mm_per_px[1]);
        let margin = (MARGIN * h).min(0.5 * longest).max(16.0 * pixel);
        let span = longest + 2.0 * margin;
        let pitch_mm = (span / FINENESS).min(h / 8.0).max(span / FINEST).max(mm_per_px[0].min(mm_per_px[1]));
        let room = (ROOM * h).min(2.0 * span);
        let size =
            field_of_view_mm.map(|view| fast_length(libm::ceil((view + 2.0 * margin + room) / pitch_mm) as usize));
        let plane = Plane::new(size);
        let origin_mm = size.map(|count| -0.5 * (count - 1) as f64 * pitch_mm);
        // The torus is wider than the view by more than the border: nothing is cut off here.
        let first: [usize; 2] = std::array::from_fn(|k| {
            let start = -0.5 * field_of_view_mm[k] - BORDER * pitch_mm;
            libm::floor((start - origin_mm[k]) / pitch_mm).max(0.0) as usize
        });
        let seen = Rect { x0: first[0], y0: first[1], x1: size[0] - first[0], y1: size[1] - first[1] };
        let norm = 1.0 / (size[0] * size[1]) as f64;
        let spreading = |wave: Wave| norm / (hat(wave.q[0] * pitch_mm) * hat(wave.q[1] * pitch_mm));
        let under_pressure = plane.gradient([pitch_mm; 2], |wave| layer.coupling(wave.length()) * spreading(wave));
        let under_traction = plane.response([pitch_mm; 2], |wave| {
            layer_response(layer, wave, size.map(|count| count as f64 * pitch_mm)).map(|part| part * spreading(wave))
        });
        Self { plane, pitch_mm, origin_mm, seen, under_pressure, under_traction }
    }

    /// Displacement under a pressure.
    pub fn under_pressure(&self, load: &Load) -> Field {
        let mut values = self.plane.zeros();
        self.spread(&load.pressure, load.origin_mm, load.mm_per_px, values.vectors_mut()[0]);
        self.plane.forward(&mut values);
        values.times(&self.under_pressure);
        self.plane.back(&mut values);
        self.crop(&values)
    }

    /// Displacement under tractions.
    pub fn under_traction(&self, traction: &Traction) -> Field {
        let mut values = self.plane.zeros();
        for (part, to) in [&traction.x, &traction.y].into_iter().zip(values.vectors_mut()) {
            self.spread(part, traction.origin_mm, traction.mm_per_px, to);
        }
        self.plane.forward(&mut values);
        values.respond(&self.under_traction);
        self.plane.back(&mut values);
        self.crop(&values)
    }

    /// Displacement under a pressure, and under forces over Young's modulus, mm^2, each at a place in the sensor's frame. Forces
    /// beyond the torus are left out.
    pub(crate) fn under(&self, load: &Load, forces: impl Iterator<Item = ([f64; 2], [f64; 2])>) -> Field {
        let mut pressed = self.plane.zeros();
        self.spread(&load.pressure, load.origin_mm, load.mm_per_px, pressed.vectors_mut()[0]);
        self.plane.forward(&mut pressed);
        pressed.times(&self.under_pressure);
        let mut values = self.plane.zeros();
        let [width, height] = self.plane.size();
        let [x, y] = values.vectors_mut();
        let area = self.pitch_mm * self.pitch_mm;
        for (place_mm, force) in forces {
            let place: [f64; 2] = std::array::from_fn(|k| (place_mm[k] - self.origin_mm[k]) / self.pitch_mm);
            if !(0.0..(width - 1) as f64).contains(&place[0]) || !(0.0..(height - 1) as f64).contains(&place[1]) {
                continue;
            }
            let first = place.map(|at| at as usize);
            let [t, s] = [0, 1].map(|k| place[k] - first[k] as f64);
            for (row, down) in [(0, 1.0 - s), (1, s)] {
                for (column, along) in [(0, 1.0 - t), (1, t)] {
                    let at = self.plane.place(first[0] + column, first[1] + row);
                    let share = down * along / area;
                    x[at] += (share * force[0]) as f32;
                    y[at] += (share * force[1]) as f32;
                }
            }
        }
        self.plane.forward(&mut values);
        values.respond(&self.under_traction);
        values.add(&pressed);
        self.plane.back(&mut values);
        self.crop(&values)
    }

    /// Distance between the values, mm.
    pub(crate) fn pitch_mm(&self) -> f64 {
        self.pitch_mm
    }

    /// Shares a load out to the hat functions of the torus: force and first moment stay.
    fn spread(&self, load: &Grid<f32>, origin_mm: [f64; 2], mm_per_px: [f64; 2], to: &mut [f32]) {
        let part = bounding_box(load, |value| value != 0.0);
        if part.is_empty() {
            return;
        }
        let [width, height] = self.plane.size();
        // Of a pixel, the first value that gets something, and what it and the next ones get.
        let shares = |k: usize, pixel: usize, count: usize| {
            let middle = (origin_mm[k] - self.origin_mm[k] + pixel as f64 * mm_per_px[k]) / self.pitch_mm;
            let half = 0.5 * mm_per_px[k] / self.pitch_mm;
            let first = libm::ceil((middle - half - 1.0).clamp(0.0, count as f64)) as usize;
            let end = libm::ceil((middle + half + 1.0).clamp(0.0, count as f64)) as usize;
            let below = move |value: usize, edge: f64| hat_integral(edge - value as f64);
            (first..end).map(move |value| (value, (below(value, middle + half) - below(value, middle - half)) as f32))
        };
        // First along y, where whole rows are added, then along x in what few rows there are.
        let columns = part.width();
        let mut rows = vec![0.0; height * columns];
        let mut touched = (height, 0);
        for y in part.y0..part.y1 {
            let from = &load.row(y)[part.x0..part.x1];
            for (value, share) in shares(1, y, height) {
                let row = &mut rows[value * columns..][..columns];
                touched = (touched.0.min(value), touched.1.max(value + 1));
                simd_dispatch(
                    #[inline(always)]
                    || {
                        for (sum, value) in row.iter_mut().zip(from) {
                            *sum += share * value;
                        }
                    },
                );
            }
        }
        for x in part.x0..part.x1 {
            for (value, share) in shares(0, x, width) {
                for y in touched.0..touched.1 {
                    to[self.plane.place(value, y)] += share * rows[y * columns + x - part.x0];
                }
            }
        }
    }

    fn crop(&self, values: &Values) -> Field {
        let Rect { x0, y0, .. } = self.seen;
        let [x, y] = values.vectors().map(|from| {
            let mut part = Grid::new(self.seen.width(), self.seen.height());
            for row in 0..part.height {
                for (column, value) in part.row_mut(row).iter_mut().enumerate() {
                    *value = from[self.plane.place(x0 + column, y0 + row)];
                }
            }
            part
        });
        let origin_mm = [self.origin_mm[0] + x0 as f64 * self.pitch_mm, self.origin_mm[1] + y0 as f64 * self.pitch_mm];
        Field { x, y, origin_mm, pitch_mm: self.pitch_mm }
    }
}

impl Field {
    /// Displacement at a point, mm, by cubics (Catmull and Rom 1974); beyond the border, that at the border.
    pub fn at(&self, point_mm: [f64; 2]) -> [f32; 2] {
        let (x, along) = self.position(0, point_mm[0], self.x.width);
        let (y, down) = self.position(1, point_mm[1], self.x.height);
        [&self.x, &self.y].map(|part| {
            let mut sum = 0.0;
            for (k, share) in down.iter().enumerate() {
                let row = &part.row(y + k)[x..x + 4];
                let line: f32 = row.iter().zip(along).map(|(value, share)| value * share).sum();
                sum += share * line;
            }
            sum
        })
    }

    /// Displacement at the pixels' centres of a view, mm: along x, then along y.
    pub(crate) fn in_view(&self, view: &View) -> [Grid<f32>; 2] {
        let [width, height] = view.resolution_px;
        let columns: Vec<_> =
            (0..width).map(|x| self.position(0, view.point_mm([x as f64 + 0.5, 0.0])[0], self.x.width)).collect();
        let rows: Vec<_> =
            (0..height).map(|y| self.position(1, view.point_mm([0.0, y as f64 + 0.5])[1], self.y.height)).collect();
        [&self.x, &self.y].map(|part| {
            // First along x, in what rows there are, then along y.
            let mut wide = Grid::<f32>::new(width, part.height);
            for y in 0..part.height {
                let from = part.row(y);
                for (value, (first, shares)) in wide.row_mut(y).iter_mut().zip(&columns) {
                    *value = from[*first..first + 4].iter().zip(shares).map(|(value, share)| value * share).sum();
                }
            }
            let mut out = Grid::<f32>::new(width, height);
            simd_dispatch(
                #[inline(always)]
                || {
                    for (y, (first, [p, q, r, s])) in rows.iter().enumerate() {
                        let [a, b, c, d] = [0, 1, 2, 3].map(|line| wide.row(first + line));
                        for ((((to, a), b), c), d) in out.row_mut(y).iter_mut().zip(a).zip(b).zip(c).zip(d) {
                            *to = a * p + b * q + c * r + d * s;
                        }
                    }
                },
            );
            out
        })
    }

    /// The first of the four values around a coordinate, and their shares.
    fn position(&self, k: usize, mm: f64, count: usize) -> (usize, [f32; 4]) {
        let place = ((mm - self.origin_mm[k]) / self.pitch_mm).clamp(1.0, (count - 2) as f64);
        let first = (place as usize).clamp(1, count - 3);
        (first - 1, catmull_rom((place - first as f64) as f32))
    }

    /// Adds another field of the same [`InPlane`].
    pub fn add(&mut self, other: &Self) {
        for (part, more) in [(&mut self.x, &other.x), (&mut self.y, &other.y)] {
            part.data.iter_mut().zip(&more.data).for_each(|(sum, value)| *sum += value);
        }
    }
}

/// Response along and across a wave on a torus of `size_mm`.
pub(super) fn layer_response(layer: ElasticLayer, wave: Wave, size_mm: [f64; 2]) -> [f64; 2] {
    let q = wave.length();
    let wide = size_mm[0].min(size_mm[1]) >= 4.0 * layer.thickness_mm;
    if q > 0.0 || wide {
        return [layer.tangential(q), layer.transverse(q)];
    }
    // On a torus that is narrow against the pad, the lowest frequency stands for all those around it.
    const POINTS: usize = 16;
    let frequency = |k: usize, n: usize| std::f64::consts::TAU / size_mm[k] * ((n as f64 + 0.5) / POINTS as f64 - 0.5);
    let mut sum = 0.0;
    for y in 0..POINTS {
        for x in 0..POINTS {
            let q = Wave { q: [frequency(0, x), frequency(1, y)], highest: [false; 2] }.length();
            sum += 0.5 * (layer.tangential(q) + layer.transverse(q)) / (POINTS * POINTS) as f64;
        }
    }
    [sum; 2]
}

/// The transform of a hat function: `angle` radians per value.
fn hat(angle: f64) -> f64 {
    let half = 0.5 * angle;
    let share = if half == 0.0 { 1.0 } else { libm::sin(half) / half };
    share * share
}

/// The integral of a hat function of height 1 over [-1, 1], from minus infinity.
fn hat_integral(to: f64) -> f64 {
    let t = to.clamp(-1.0, 1.0);
    if t < 0.0 { 0.5 * (1.0 + t) * (1.0 + t) } else { 1.0 - 0.5 * (1.0 - t) * (1.0 - t) }
}
