//! In-plane motion of the pad's surface under pressures and tractions, as printed markers show it.
//!
//! With q the wave vector, displacements are u = i C p along q under pressure, and H along and T across q under
//! tractions ([`super::layer`]). They are computed on a coarse grid, because they are smooth on the scale of the pad
//! and of the contact. Loads are spread over the grid's hat functions, whose own transform is divided out, so that a
//! load may lie anywhere. The model is linear and for small strain, like the layer. The torus leaves six thicknesses
//! around view and load. Details narrower than four values of the grid are blurred.

use super::convolve::ConvolutionShape;
use super::fft::fast_length;
use super::layer::ElasticLayer;
use super::placed::{GridPlacement, PlacedDisplacement};
use super::plane_transform::{PlaneTransform, WaveVector};
use super::vector_convolve::{FrequencyFactors, InPlaneUnderPressure};
use crate::base::cubic::catmull_rom;
use crate::base::grid::{Grid, Rect, bounding_box};
use crate::base::simd::simd_dispatch;
use crate::base::view::View;

/// Pressure on a regular grid.
#[derive(Clone, Debug, PartialEq)]
pub struct Load {
    /// Pressure over Young's modulus, positive towards the camera, 0 without contact; may be empty.
    pub pressure: Grid<f32>,
    /// Centre of the first pixel in the sensor's frame, mm.
    pub origin_mm: [f64; 2],
    /// Distance between pixels, mm, above 0.
    pub mm_per_px: [f64; 2],
}

impl Load {
    /// Returns the corners of the part that presses, in the sensor's frame, mm.
    pub(crate) fn corners_mm(&self) -> [[f64; 2]; 4] {
        let Rect { x0, y0, x1, y1 } = bounding_box(&self.pressure, |p| p > 0.0);
        let at = |px: [usize; 2]| [0, 1].map(|k| self.origin_mm[k] + (px[k] as f64 - 0.5) * self.mm_per_px[k]);
        [[x0, y0], [x1, y0], [x0, y1], [x1, y1]].map(at)
    }
}

/// Tangential tractions on a regular grid.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct TractionField {
    /// Traction on the surface to the right, over Young's modulus.
    pub x: Grid<f32>,
    /// Traction on the surface down in the image, over Young's modulus; as large as `x`.
    pub y: Grid<f32>,
    /// Centre of the first pixel in the sensor's frame, mm.
    pub origin_mm: [f64; 2],
    /// Distance between pixels, mm, above 0.
    pub mm_per_px: [f64; 2],
}

/// In-plane displacement over the view and a little around it.
#[derive(Clone, Debug, PartialEq)]
pub struct DisplacementField {
    /// To the right, mm.
    pub x: Grid<f32>,
    /// Down in the image, mm.
    pub y: Grid<f32>,
    /// Position of the first value in the sensor's frame, mm.
    pub origin_mm: [f64; 2],
    /// Distance between values, mm.
    pub spacing_mm: f64,
}

/// The in-plane response of a layer, prepared for a view.
#[derive(Clone, Debug)]
pub struct InPlaneResponse {
    plane: PlaneTransform,
    spacing_mm: f64,
    /// Position of the torus's first value, mm.
    origin_mm: [f64; 2],
    /// The part of the torus that results cover.
    view_rect: Rect,
    factors: FrequencyFactors<5>,
}

/// Number of values along the longer side of the view and the load around it.
const VALUES_PER_SIDE: f64 = 240.0;

/// Largest number of values per side, where a thin pad would need more.
const MAX_VALUES_PER_SIDE: f64 = 320.0;

/// Room around view and load, in thicknesses, so that the torus's copies have no influence.
const ROOM: f64 = 6.0;

/// How far a load may extend around the view, thicknesses.
const MARGIN: f64 = 1.5;

/// Number of values outside the view, so that interpolation reaches up to its border.
const BORDER: f64 = 2.0;

impl InPlaneResponse {
    /// Prepares a view of `field_of_view_mm` whose pixels are `mm_per_px` apart, all above 0.
    ///
    /// Loads count up to 1.5 thicknesses around the view (half its longer side where the pad is thicker than that, 16
    /// pixels where it is thinner); loads much farther out are left out.
    pub fn new(layer: ElasticLayer, field_of_view_mm: [f64; 2], mm_per_px: [f64; 2]) -> Self {
        let h = layer.thickness_mm;
        let longest = field_of_view_mm[0].max(field_of_view_mm[1]);
        let pixel = mm_per_px[0].max(mm_per_px[1]);
        let margin = (MARGIN * h).min(0.5 * longest).max(16.0 * pixel);
        let span = longest + 2.0 * margin;
        let spacing_mm =
            (span / VALUES_PER_SIDE).min(h / 8.0).max(span / MAX_VALUES_PER_SIDE).max(mm_per_px[0].min(mm_per_px[1]));
        let room = (ROOM * h).min(2.0 * span);
        let size =
            field_of_view_mm.map(|view| fast_length(libm::ceil((view + 2.0 * margin + room) / spacing_mm) as usize));
        let plane = PlaneTransform::new(size);
        let origin_mm = size.map(|count| -0.5 * (count - 1) as f64 * spacing_mm);
        // The torus is wider than the view by more than the border: nothing is cut off here.
        let first: [usize; 2] = std::array::from_fn(|k| {
            let start = -0.5 * field_of_view_mm[k] - BORDER * spacing_mm;
            libm::floor((start - origin_mm[k]) / spacing_mm).max(0.0) as usize
        });
        let view_rect = Rect { x0: first[0], y0: first[1], x1: size[0] - first[0], y1: size[1] - first[1] };
        let norm = 1.0 / (size[0] * size[1]) as f64;
        let spreading =
            |wave: WaveVector| norm / (hat_transform(wave.q[0] * spacing_mm) * hat_transform(wave.q[1] * spacing_mm));
        let torus_mm = size.map(|count| count as f64 * spacing_mm);
        let factors = FrequencyFactors::new(size, |[x, y]| {
            let wave = plane.wave_vector([spacing_mm; 2], x, y);
            let share = spreading(wave);
            let down = layer.coupling_compliance(wave.length()) * share;
            let [along, across] = layer_response(layer, wave, torus_mm).map(|part| part * share);
            let [cos, sin] = wave.double_angle().map(|part| 0.5 * (along - across) * part);
            let [mean, [x, y]] = [[0.5 * (along + across); 2], wave.direction()];
            [mean[0] + cos, mean[0] - cos, sin, x * down, y * down].map(|factor| factor as f32)
        });
        Self { plane, spacing_mm, origin_mm, view_rect, factors }
    }

    /// Computes the displacement under a pressure.
    pub fn under_pressure(&self, load: &Load) -> DisplacementField {
        self.under_load_and_forces(Some(load), std::iter::empty())
    }

    /// Computes the displacement under tractions.
    pub fn under_traction(&self, traction: &TractionField) -> DisplacementField {
        let mut loads = self.zeros();
        for (part, to) in [&traction.x, &traction.y].into_iter().zip(&mut loads) {
            self.spread_to_torus(part, traction.origin_mm, traction.mm_per_px, to);
        }
        self.displace_view(&loads)
    }

    /// Computes the displacement under a pressure and under forces over Young's modulus, mm^2, along x and y and into
    /// the pad, each at a point of the sensor's frame. Forces outside the torus are left out.
    pub(crate) fn under_load_and_forces(
        &self,
        load: Option<&Load>,
        forces: impl Iterator<Item = ([f64; 2], [f64; 3])>,
    ) -> DisplacementField {
        let mut loads = self.zeros();
        if let Some(load) = load {
            self.spread_to_torus(&load.pressure, load.origin_mm, load.mm_per_px, &mut loads[2]);
        }
        let [width, height] = self.plane.size();
        let [x, y, down_into] = loads.each_mut().map(|part| &mut part.data);
        let area = self.spacing_mm * self.spacing_mm;
        for (place_mm, force) in forces {
            let place: [f64; 2] = std::array::from_fn(|k| (place_mm[k] - self.origin_mm[k]) / self.spacing_mm);
            if !(0.0..(width - 1) as f64).contains(&place[0]) || !(0.0..(height - 1) as f64).contains(&place[1]) {
                continue;
            }
            let first = place.map(|at| at as usize);
            let [t, s] = [0, 1].map(|k| place[k] - first[k] as f64);
            for (row, down) in [(0, 1.0 - s), (1, s)] {
                for (column, along) in [(0, 1.0 - t), (1, t)] {
                    let at = (first[1] + row) * width + first[0] + column;
                    let share = down * along / area;
                    x[at] += (share * force[0]) as f32;
                    y[at] += (share * force[1]) as f32;
                    if force[2] != 0.0 {
                        down_into[at] += (share * force[2]) as f32;
                    }
                }
            }
        }
        self.displace_view(&loads)
    }

    /// Returns tractions along x and y and a pressure of 0 on the torus.
    fn zeros(&self) -> [Grid<f32>; 3] {
        let [width, height] = self.plane.size();
        [0; 3].map(|_| Grid::new(width, height))
    }

    /// Computes the displacement in view under tractions along x and y and a pressure on the torus.
    fn displace_view(&self, loads: &[Grid<f32>; 3]) -> DisplacementField {
        let view = self.view_rect;
        let loaded = loads.iter().map(|part| bounding_box(part, |value| value != 0.0));
        let loaded = loaded.filter(|part| !part.is_empty()).reduce(Rect::union);
        let mut parts = [0; 2].map(|_| Grid::new(view.width(), view.height()));
        if let Some(loaded) = loaded {
            let around = loaded.union(view);
            let shape = ConvolutionShape {
                source: [loaded.width(), loaded.height()],
                offset: [loaded.x0 - around.x0, loaded.y0 - around.y0],
                target: [around.width(), around.height()],
            };
            let loads = loads.each_ref().map(|part| part.crop(loaded));
            let mut moved = [0; 2].map(|_| Grid::new(around.width(), around.height()));
            let [x, y] = &mut moved;
            self.plane.convolution(shape).convolve_fields::<InPlaneUnderPressure, 3, 5>(
                &self.factors,
                loads.each_ref().map(|part| &part.data[..]),
                &mut [&mut x.data, &mut y.data],
                &mut Default::default(),
            );
            parts = moved.map(|part| part.crop(view.in_window(around.x0, around.y0, around.width(), around.height())));
        }
        let [x, y] = parts;
        let origin_mm = [
            self.origin_mm[0] + view.x0 as f64 * self.spacing_mm,
            self.origin_mm[1] + view.y0 as f64 * self.spacing_mm,
        ];
        DisplacementField { x, y, origin_mm, spacing_mm: self.spacing_mm }
    }

    /// Returns the distance between the values, mm.
    pub(crate) fn spacing_mm(&self) -> f64 {
        self.spacing_mm
    }

    /// Distributes a load over the hat functions of the torus; force and first moment are preserved.
    fn spread_to_torus(&self, load: &Grid<f32>, origin_mm: [f64; 2], mm_per_px: [f64; 2], to: &mut Grid<f32>) {
        let part = bounding_box(load, |value| value != 0.0);
        if part.is_empty() {
            return;
        }
        let [width, height] = self.plane.size();
        // The values that a pixel contributes to, and the share of each.
        let shares = |k: usize, pixel: usize, count: usize| {
            let middle = (origin_mm[k] - self.origin_mm[k] + pixel as f64 * mm_per_px[k]) / self.spacing_mm;
            let half = 0.5 * mm_per_px[k] / self.spacing_mm;
            let first = libm::ceil((middle - half - 1.0).clamp(0.0, count as f64)) as usize;
            let end = libm::ceil((middle + half + 1.0).clamp(0.0, count as f64)) as usize;
            let below = move |value: usize, edge: f64| hat_integral(edge - value as f64);
            (first..end).map(move |value| (value, (below(value, middle + half) - below(value, middle - half)) as f32))
        };
        let along_x: Vec<Vec<_>> = (part.x0..part.x1).map(|x| shares(0, x, width).collect()).collect();
        // First along y, where complete rows are added, then along x in the few rows of the torus.
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
        for y in touched.0..touched.1 {
            let (from, to) = (&rows[y * columns..][..columns], to.row_mut(y));
            for (x, from) in from.iter().enumerate() {
                for (value, share) in &along_x[x] {
                    to[*value] += share * from;
                }
            }
        }
    }
}

impl DisplacementField {
    /// Returns the displacement at a point, mm, by cubic interpolation (Catmull and Rom 1974); outside the field, that
    /// at its border.
    pub fn at(&self, point_mm: [f64; 2]) -> [f32; 2] {
        let (x, along) = self.cubic_taps(0, point_mm[0], self.x.width);
        let (y, down) = self.cubic_taps(1, point_mm[1], self.x.height);
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

    /// Returns the displacement at the pixel centres of a view, mm: along x, then along y.
    pub(crate) fn sample_view(&self, view: &View) -> [Grid<f32>; 2] {
        let [width, height] = view.resolution_px;
        let columns: Vec<_> =
            (0..width).map(|x| self.cubic_taps(0, view.point_mm([x as f64 + 0.5, 0.0])[0], self.x.width)).collect();
        let rows: Vec<_> =
            (0..height).map(|y| self.cubic_taps(1, view.point_mm([0.0, y as f64 + 0.5])[1], self.y.height)).collect();
        [&self.x, &self.y].map(|part| {
            // First along x in the few rows of the field, then along y.
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

    /// Returns the first of the four values around a coordinate, and their weights.
    fn cubic_taps(&self, k: usize, mm: f64, count: usize) -> (usize, [f32; 4]) {
        let place = ((mm - self.origin_mm[k]) / self.spacing_mm).clamp(1.0, (count - 2) as f64);
        let first = (place as usize).clamp(1, count - 3);
        (first - 1, catmull_rom((place - first as f64) as f32))
    }

    /// Adds displacements along x and y that are on grids of their own.
    pub(crate) fn add_placed(&mut self, x: &PlacedDisplacement, y: &PlacedDisplacement) {
        let placed = GridPlacement { origin_mm: self.origin_mm, mm_per_px: [self.spacing_mm; 2] };
        for (part, more) in [(&mut self.x, x), (&mut self.y, y)] {
            more.add_to(part, placed, [0; 2], 1.0);
        }
    }

    /// Adds another field of the same [`InPlaneResponse`].
    pub fn add(&mut self, other: &Self) {
        for (part, more) in [(&mut self.x, &other.x), (&mut self.y, &other.y)] {
            part.data.iter_mut().zip(&more.data).for_each(|(sum, value)| *sum += value);
        }
    }

    /// Subtracts another field of the same [`InPlaneResponse`].
    pub(crate) fn subtract(&mut self, other: &Self) {
        for (part, less) in [(&mut self.x, &other.x), (&mut self.y, &other.y)] {
            part.data.iter_mut().zip(&less.data).for_each(|(rest, value)| *rest -= value);
        }
    }
}

/// Returns the response along and across a wave on a torus of `size_mm`.
pub(super) fn layer_response(layer: ElasticLayer, wave: WaveVector, size_mm: [f64; 2]) -> [f64; 2] {
    let q = wave.length();
    let wide = size_mm[0].min(size_mm[1]) >= 4.0 * layer.thickness_mm;
    if q > 0.0 || wide {
        return [layer.tangential_compliance(q), layer.transverse_compliance(q)];
    }
    // On a torus that is narrow compared to the pad, the lowest frequency stands for all those around it: average over
    // them.
    const POINTS: usize = 16;
    let frequency = |k: usize, n: usize| std::f64::consts::TAU / size_mm[k] * ((n as f64 + 0.5) / POINTS as f64 - 0.5);
    let mut sum = 0.0;
    for y in 0..POINTS {
        for x in 0..POINTS {
            let q = WaveVector { q: [frequency(0, x), frequency(1, y)], highest: [false; 2] }.length();
            sum += 0.5 * (layer.tangential_compliance(q) + layer.transverse_compliance(q)) / (POINTS * POINTS) as f64;
        }
    }
    [sum; 2]
}

/// Returns the transform of a hat function; `angle` is radians per value.
fn hat_transform(angle: f64) -> f64 {
    let half = 0.5 * angle;
    let share = if half == 0.0 { 1.0 } else { libm::sin(half) / half };
    share * share
}

/// Returns the integral of a hat function of height 1 over [-1, 1], from minus infinity to `to`.
fn hat_integral(to: f64) -> f64 {
    let t = to.clamp(-1.0, 1.0);
    if t < 0.0 { 0.5 * (1.0 + t) * (1.0 + t) } else { 1.0 - 0.5 * (1.0 - t) * (1.0 - t) }
}
