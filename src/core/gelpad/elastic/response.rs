//! The layer's response to pressures on a grid, as a near and a far field.
//!
//! The near field is sharp and ends after some pixels: its convolutions need no more room than that around the contact.
//! The far field is smooth: pressures are spread to nodes some pixels apart and its displacements interpolated from them,
//! by cubic B-splines. Together they take half the time of one convolution with the whole response on twice the room.
//!
//! The far field of a pressed point is c erf(r / s) / r, and all that the shell takes away; c / r is a half-space's. It is
//! the potential of a Gaussian of width s, whose spectrum ends before that of the nodes does.

use std::f64::consts::{PI, TAU};
use std::sync::Arc;

use super::convolve::{Buffers, Lengths, Shape, Spectrum, Torus};
use super::kernel::{Curve, half_space, kernel_by, lags};
use super::layer::ElasticLayer;
use crate::base::grid::{Grid, Rect};
use crate::base::simd::simd_dispatch;

/// Width s of the Gaussian, in distances between nodes.
const WIDTH: f64 = 2.5;

/// Distance at which the near field ends, s. What it still is there is left to the far field, by a parabola.
const END: f64 = 2.0;

/// Most pixels between nodes.
const MOST_STEP: usize = 8;

/// Largest distance between nodes, thicknesses: what the shell takes away is smooth on them.
const SMOOTH: f64 = 0.2;

/// Tolerance from which on the fields are near enough to the whole response, um: they differ by up to 1e-4 of the
/// displacement, some 0.05 um.
const ENOUGH_UM: f64 = 0.3;

/// Longer over shorter side of a pixel, up to which pixels are square enough for nodes.
const SQUARE: f64 = 1.5;

/// Nodes over which what is divided by the splines' spectrum dies away.
const TAIL: usize = 8;

/// Share of the whole response's torus that the near field's may take, or parts are not worth it.
const WORTH: f64 = 0.6;

/// Nodes that a pixel lies among along an axis: a cubic spline is four wide.
const TAPS: usize = 4;

/// The response on a grid: what all presses share.
pub struct Response {
    layer: ElasticLayer,
    mm_per_px: [f64; 2],
    softest: f64,
    /// What an object on the layer adds to its response, times frequency; 0 if it is rigid.
    object: f64,
    /// Near and far field in one.
    whole: Grid<f32>,
    lengths: Arc<Lengths>,
    fields: Option<Fields>,
}

/// Its two parts.
struct Fields {
    near: Grid<f32>,
    far: Grid<f32>,
    /// Pixels between nodes.
    step: usize,
    /// Of each pixel between nodes, its share in the four around it.
    shares: Vec<[f32; TAPS]>,
    /// The far field's spectrum, mm, at multiples of a frequency; 0 beyond them.
    spectrum: Vec<f32>,
    /// That frequency, rad/mm.
    per_value: f64,
}

impl Response {
    /// Of pixels of this size, as far as `reach_mm`, in windows of up to `window` pixels; for contacts that are solved to
    /// `tolerance_um`.
    pub fn new(layer: ElasticLayer, mm_per_px: [f64; 2], reach_mm: f64, window: [usize; 2], tolerance_um: f64) -> Self {
        Self::by(&Curve::new(layer), mm_per_px, reach_mm, window, tolerance_um)
    }

    /// The same of a curve that is known.
    pub(super) fn by(curve: &Curve, mm_per_px: [f64; 2], reach_mm: f64, window: [usize; 2], tolerance_um: f64) -> Self {
        let layer = curve.layer;
        let size = lags(layer, mm_per_px, reach_mm, window);
        let mut steps = (1..=MOST_STEP.ilog2()).rev().map(|octave| 1 << octave);
        let step = steps.find(|step| tolerance_um >= ENOUGH_UM && Fields::suit(layer, mm_per_px, *step, size));
        // Beyond the window, the far field goes on until what is divided out of its spectrum has died away.
        let most = window.map(|size| size + step.map_or(0, |step| (TAPS + 2 * TAIL) * step));
        let wide = kernel_by(curve, mm_per_px, reach_mm, window, most);
        let fields = step.map(|step| Fields::new(curve, mm_per_px, step, &wide));
        let whole = wide.crop(Rect::whole(size[0], size[1]));
        // A coarser grid may have a pixel more than counted here, depending on how it is come by.
        let lengths = Arc::new(Lengths::new(2 * window[0].max(window[1]) + 16));
        Self { layer, mm_per_px, softest: layer.softest(), object: 0.0, whole, lengths, fields }
    }

    /// The same from a response that is known, in one part.
    pub fn of(layer: ElasticLayer, mm_per_px: [f64; 2], whole: Grid<f32>, lengths: Arc<Lengths>) -> Self {
        Self { layer, mm_per_px, softest: layer.softest(), object: 0.0, whole, lengths, fields: None }
    }

    /// That of an object which gives way like a half-space, at up to `most` lags, in one part; and `beside` that.
    pub(super) fn and_object(&self, object: f64, most: [usize; 2], beside: Option<&Grid<f32>>) -> Self {
        let Self { layer, mm_per_px, lengths, .. } = self;
        let mut whole = half_space(object, *mm_per_px, most);
        if let Some(beside) = beside {
            for y in 0..whole.height.min(beside.height) {
                whole.row_mut(y).iter_mut().zip(beside.row(y)).for_each(|(sum, layer)| *sum += layer);
            }
        }
        // The longest wave that the grid holds.
        let longest_mm = (0..2).map(|k| 2.0 * most[k] as f64 * mm_per_px[k]).fold(0.0, f64::max);
        let softest = self.softest + object * longest_mm / TAU;
        let lengths = Arc::clone(lengths);
        Self { layer: *layer, mm_per_px: *mm_per_px, softest, object, whole, lengths, fields: None }
    }

    /// Displacement around one pressed pixel, mm, for Young's modulus 1: lags from 0 up along x and y, 0 beyond the last.
    pub fn kernel(&self) -> &Grid<f32> {
        &self.whole
    }

    /// The largest response over all frequencies, mm.
    pub fn softest(&self) -> f64 {
        self.softest
    }

    /// From pressures in `source` to displacements in `target`, which contains it.
    pub fn operator(&self, source: Rect, target: Rect) -> Operator<'_> {
        let shape = |target: Rect| Shape {
            source: [source.width(), source.height()],
            offset: [source.x0 - target.x0, source.y0 - target.y0],
            target: [target.width(), target.height()],
        };
        let whole = Torus::new(&self.lengths, shape(target), [self.whole.width, self.whole.height], 0);
        let all = Rect::whole(target.width(), target.height());
        let in_fields = self.fields.as_ref().and_then(|fields| {
            let reach = [fields.near.width, fields.near.height];
            let sharp = Rect {
                x0: target.x0.max(source.x0.saturating_sub(reach[0])),
                y0: target.y0.max(source.y0.saturating_sub(reach[1])),
                x1: target.x1.min(source.x1 + reach[0]),
                y1: target.y1.min(source.y1 + reach[1]),
            };
            let near = Torus::new(&self.lengths, shape(sharp), reach, 0);
            let worth = (near.area() as f64) < WORTH * whole.area() as f64;
            worth.then(|| {
                let far = FarOperator::new(fields, &self.lengths, shape(target));
                (near, sharp.seen_from(target.x0, target.y0, all.x1, all.y1), far)
            })
        });
        match in_fields {
            Some((near, sharp, far)) => Operator { response: self, near, sharp, target: all, far: Some(far) },
            None => Operator { response: self, near: whole, sharp: all, target: all, far: None },
        }
    }
}

impl Fields {
    /// Whether nodes so many pixels apart are of use.
    fn suit(layer: ElasticLayer, [dx, dy]: [f64; 2], step: usize, [width, height]: [usize; 2]) -> bool {
        let pitch_mm = step as f64 * dx.max(dy);
        let reach = END * WIDTH * pitch_mm;
        let longest = (width as f64 * dx).min(height as f64 * dy);
        dx.max(dy) <= SQUARE * dx.min(dy) && pitch_mm <= SMOOTH * layer.thickness_mm && 2.0 * reach <= longest
    }

    fn new(curve: &Curve, mm_per_px: [f64; 2], step: usize, whole: &Grid<f32>) -> Self {
        let layer = curve.layer;
        let [dx, dy] = mm_per_px;
        let width_mm = WIDTH * step as f64 * dx.max(dy);
        let end_mm = END * width_mm;
        let (h, half_space) = (layer.thickness_mm, layer.half_space());
        let distance_mm = |x: usize, y: usize| libm::hypot(x as f64 * dx, y as f64 * dy);
        // erfc(r / s) / r where it ends, and its slope: a parabola goes on from there to the middle.
        let gauss = 2.0 / (libm::sqrt(PI) * width_mm);
        let end = libm::erfc(END) / end_mm;
        let slope = -(gauss * libm::exp(-END * END) + end) / end_mm;
        let smooth = |r: f64| {
            let blurred = if r > 0.0 { libm::erf(r / width_mm) / r } else { gauss };
            let left = end + slope * (r * r - end_mm * end_mm) / (2.0 * end_mm);
            dx * dy * (half_space / TAU * (blurred + left) + curve.at(r / h) / h)
        };
        let reach = mm_per_px.map(|mm| (end_mm / mm) as usize + 1);
        let mut near = Grid::new(reach[0], reach[1]);
        for y in 0..reach[1] {
            for (x, value) in near.row_mut(y).iter_mut().enumerate() {
                let r = distance_mm(x, y);
                *value = if r <= end_mm { (f64::from(whole.at(x, y)) - smooth(r)) as f32 } else { 0.0 };
            }
        }
        let mut far = Grid::new(whole.width.div_ceil(step), whole.height.div_ceil(step));
        for y in 0..far.height {
            for (x, value) in far.row_mut(y).iter_mut().enumerate() {
                let r = distance_mm(x * step, y * step);
                *value = if r <= end_mm { smooth(r) as f32 } else { whole.at(x * step, y * step) };
            }
        }
        let per_value = 0.08 / h;
        // erfc ends there in single precision.
        let values = (8.0 / width_mm / per_value) as usize;
        let spectrum = (0..values).map(|k| {
            let q = k as f64 * per_value;
            let sharp = if k == 0 { width_mm / libm::sqrt(PI) } else { libm::erf(0.5 * q * width_mm) / q };
            (layer.normal(q) - half_space * sharp) as f32
        });
        let shares = (0..step).map(|past| {
            let t = past as f64 / step as f64;
            let u = 1.0 - t;
            let middle = |t: f64| (3.0 * t * t * t - 6.0 * t * t + 4.0) / 6.0;
            [u * u * u / 6.0, middle(t), middle(u), t * t * t / 6.0].map(|share| share as f32)
        });
        Self { near, far, step, shares: shares.collect(), spectrum: spectrum.collect(), per_value }
    }

    /// The far field's spectrum at a frequency, mm.
    fn spectrum_at(&self, q: f64) -> f32 {
        let at = q / self.per_value;
        let below = at as usize;
        match self.spectrum.get(below..below + 2) {
            Some([a, b]) => a + (at - below as f64) as f32 * (b - a),
            _ => 0.0,
        }
    }
}

/// The response from one box to another.
pub struct Operator<'a> {
    response: &'a Response,
    /// Convolutions with the near field, or with the whole response if there is no far field.
    near: Torus<'a>,
    /// Where in the target the near field reaches.
    sharp: Rect,
    target: Rect,
    far: Option<FarOperator<'a>>,
}

/// Memory of operators of any size.
#[derive(Default)]
pub struct Memory {
    buffers: Buffers,
    near: Spectrum,
    far: Spectrum,
    inverse: Spectrum,
    there: Grid<f32>,
    rows: Grid<f32>,
    spread: Grid<f32>,
    nodes: Grid<f32>,
}

impl Operator<'_> {
    /// To be called before [`Self::displace`].
    pub fn prepare(&self, memory: &mut Memory) {
        let Memory { buffers, near, far, .. } = memory;
        let fields = self.response.fields.as_ref().filter(|_| self.far.is_some());
        self.near.set_spectrum(fields.map_or(&self.response.whole, |fields| &fields.near), buffers, near);
        if let Some(operator) = &self.far {
            operator.torus.set_spectrum(&operator.fields.far, buffers, far);
            operator.torus.scale(far, |angle| {
                // sinc^4 is a spline's own spectrum; pressures are spread by them and displacements interpolated.
                let half = 0.5 * angle.min(TAU - angle);
                let sinc = if half > 0.0 { libm::sin(half) / half } else { 1.0 };
                libm::pow(sinc, -8.0) as f32
            });
        }
    }

    /// Gets ready for [`Self::undo`], after [`Self::prepare`]: below the frequency `cutoff`, rad/mm, the response is taken
    /// for what it is there.
    pub fn prepare_undo(&self, cutoff: f64, memory: &mut Memory) {
        let Response { layer, mm_per_px, softest, object, .. } = self.response;
        let Memory { near, inverse, .. } = memory;
        inverse.clone_from(near);
        if let Some(FarOperator { fields, .. }) = &self.far {
            let end = fields.per_value * fields.spectrum.len() as f64;
            self.near.add(inverse, *mm_per_px, end, |q| fields.spectrum_at(q));
        }
        self.near.invert(inverse, *mm_per_px, cutoff, layer.normal(cutoff) + object / cutoff, *softest);
    }

    /// The displacement under `pressure`.
    pub fn displace(&self, pressure: &Grid<f32>, memory: &mut Memory, displacement: &mut Grid<f32>) {
        let Memory { buffers, near, far, there, rows, spread, nodes, .. } = memory;
        if self.sharp == self.target {
            self.near.convolve(near, pressure, displacement, buffers);
        } else {
            self.near.convolve(near, pressure, there, buffers);
            displacement.reset(self.target.width(), self.target.height());
            displacement.paste(there, self.sharp, self.target);
        }
        if let Some(operator) = &self.far {
            operator.spread(pressure, rows, spread);
            operator.torus.convolve(far, spread, nodes, buffers);
            operator.add(nodes, rows, displacement);
        }
    }

    /// Roughly the pressure under a displacement, of a source that is the target.
    pub fn undo(&self, displacement: &Grid<f32>, memory: &mut Memory, pressure: &mut Grid<f32>) {
        self.near.convolve(&memory.inverse, displacement, pressure, &mut memory.buffers);
    }
}

/// The far field from one box to another. Node number `j` is pixel `step (j - 1)` of the target.
struct FarOperator<'a> {
    fields: &'a Fields,
    torus: Torus<'a>,
    /// Pixels from the second node that the source's first pixel has a share in to that pixel.
    past: [usize; 2],
    /// Nodes that the source has a share in.
    count: [usize; 2],
}

impl<'a> FarOperator<'a> {
    fn new(fields: &'a Fields, lengths: &'a Lengths, shape: Shape) -> Self {
        let Shape { source, offset, target } = shape;
        let first = offset.map(|px| px / fields.step);
        let past = offset.map(|px| px % fields.step);
        let nodes = |px: usize| (px - 1) / fields.step + TAPS;
        let count = [0, 1].map(|k| nodes(past[k] + source[k]));
        let shape = Shape { source: count, offset: first, target: target.map(nodes) };
        let torus = Torus::new(lengths, shape, [fields.far.width, fields.far.height], 2 * TAIL);
        Self { fields, torus, past, count }
    }

    /// Spreads pressures to nodes.
    fn spread(&self, pressure: &Grid<f32>, rows: &mut Grid<f32>, nodes: &mut Grid<f32>) {
        match self.fields.step {
            2 => self.spread_by::<2>(pressure, rows, nodes),
            4 => self.spread_by::<4>(pressure, rows, nodes),
            _ => self.spread_by::<8>(pressure, rows, nodes),
        }
    }

    fn spread_by<const STEP: usize>(&self, pressure: &Grid<f32>, rows: &mut Grid<f32>, nodes: &mut Grid<f32>) {
        let shares: [[f32; TAPS]; STEP] = std::array::from_fn(|past| self.fields.shares[past]);
        let [left, top] = self.past;
        let [width, height] = self.count;
        // Each in the pixels of the step that it belongs to.
        rows.reset((width + 1 - TAPS) * STEP, height);
        nodes.reset(width, height);
        simd_dispatch(
            #[inline(always)]
            || {
                for y in 0..pressure.height {
                    let from = pressure.row(y);
                    let at = top + y;
                    for (tap, share) in shares[at % STEP].iter().enumerate() {
                        let to = &mut rows.row_mut(at / STEP + tap)[left..left + pressure.width];
                        to.iter_mut().zip(from).for_each(|(sum, p)| *sum += share * p);
                    }
                }
                for y in 0..height {
                    let to = &mut nodes.data[y * width..][..width];
                    for (first, px) in
                        rows.data[y * rows.width..][..rows.width].as_chunks::<STEP>().0.iter().enumerate()
                    {
                        let mut sums = [0.0; TAPS];
                        for (p, shares) in px.iter().zip(&shares) {
                            sums.iter_mut().zip(shares).for_each(|(sum, share)| *sum += share * p);
                        }
                        to[first..first + TAPS].iter_mut().zip(sums).for_each(|(node, sum)| *node += sum);
                    }
                }
            },
        );
    }

    /// Adds what nodes of the target say.
    fn add(&self, nodes: &Grid<f32>, rows: &mut Grid<f32>, displacement: &mut Grid<f32>) {
        match self.fields.step {
            2 => self.add_by::<2>(nodes, rows, displacement),
            4 => self.add_by::<4>(nodes, rows, displacement),
            _ => self.add_by::<8>(nodes, rows, displacement),
        }
    }

    fn add_by<const STEP: usize>(&self, nodes: &Grid<f32>, rows: &mut Grid<f32>, displacement: &mut Grid<f32>) {
        let shares: [[f32; TAPS]; STEP] = std::array::from_fn(|past| self.fields.shares[past]);
        rows.reshape((nodes.width + 1 - TAPS) * STEP, nodes.height);
        let wide = rows.width;
        simd_dispatch(
            #[inline(always)]
            || {
                for y in 0..nodes.height {
                    let from = &nodes.data[y * nodes.width..][..nodes.width];
                    let to = rows.data[y * wide..][..wide].as_chunks_mut::<STEP>().0;
                    for (px, four) in to.iter_mut().zip(from.windows(TAPS)) {
                        for (value, [a, b, c, d]) in px.iter_mut().zip(&shares) {
                            *value = (a * four[0] + b * four[1]) + (c * four[2] + d * four[3]);
                        }
                    }
                }
                for y in 0..displacement.height {
                    let [a, b, c, d] = shares[y % STEP];
                    let row = |tap: usize| &rows.data[(y / STEP + tap) * wide..][..displacement.width];
                    let four = row(0).iter().zip(row(1)).zip(row(2).iter().zip(row(3)));
                    let to = &mut displacement.data[y * displacement.width..][..displacement.width];
                    for (w, ((p, q), (r, s))) in to.iter_mut().zip(four) {
                        *w += (a * p + b * q) + (c * r + d * s);
                    }
                }
            },
        );
    }
}
