//! The layer's response to pressures on a grid, split into a near and a far field.
//!
//! The near field is sharp and ends after some pixels: its convolutions need only that much room around the contact.
//! The far field is smooth: pressures are spread to nodes some pixels apart, and displacements are interpolated from
//! the nodes, both by cubic B-splines. Together they take half the time of one convolution with the full response on
//! twice the room.
//!
//! The far field of a pressed point is c erf(r / s) / r plus the shell's correction; c / r is the half-space's
//! response. It is the potential of a Gaussian of width s, whose spectrum ends before that of the nodes does.

use std::f64::consts::{PI, TAU};
use std::sync::Arc;

use super::convolve::{ConvolutionBuffers, ConvolutionShape, FftPlans, KernelSpectrum, TorusConvolution};
use super::kernel::{CorrectionCurve, half_space_kernel, kernel_with_curve, lag_counts};
use super::layer::ElasticLayer;
use crate::base::grid::{Grid, Rect};
use crate::base::simd::simd_dispatch;

/// Width s of the Gaussian, in node spacings.
const GAUSSIAN_WIDTH: f64 = 2.5;

/// Distance at which the near field ends, in units of s. What remains of it there is moved to the far field, as a
/// parabola.
const NEAR_FIELD_END: f64 = 2.0;

/// Most pixels between nodes.
const MAX_NODE_STEP: usize = 8;

/// Largest node spacing, thicknesses: on it the shell's correction is smooth.
const MAX_NODE_SPACING: f64 = 0.2;

/// Smallest tolerance for which near and far field are used, um: they differ from the full response by up to 1e-4 of
/// the displacement, some 0.05 um.
const FIELDS_FROM_UM: f64 = 0.3;

/// Largest ratio of a pixel's sides for which nodes are used.
const MAX_ASPECT_RATIO: f64 = 1.5;

/// Number of nodes over which values divided by the splines' spectrum decay.
const TAIL_NODES: usize = 8;

/// Largest size of the near field's torus, as a share of the full response's, for which the split pays.
const MAX_NEAR_SHARE: f64 = 0.6;

/// Number of nodes around a pixel along an axis: a cubic spline is four nodes wide.
const TAPS: usize = 4;

/// Pixels beside each other whose sums are kept in registers while they are spread.
const SPREAD_PX: usize = 32;

/// The response on a grid, shared by all presses.
pub struct PressureResponse {
    layer: ElasticLayer,
    mm_per_px: [f64; 2],
    largest_compliance: f64,
    /// The response of an object on the layer times frequency; 0 if the object is rigid.
    object_compliance: f64,
    /// The full response, not split.
    full_kernel: Grid<f32>,
    plans: Arc<FftPlans>,
    fields: Option<NearFarFields>,
}

/// The near and the far field.
struct NearFarFields {
    near: Grid<f32>,
    far: Grid<f32>,
    /// Pixels between nodes.
    step: usize,
    /// For each pixel between two nodes, its weights in the four nodes around it.
    shares: Vec<[f32; TAPS]>,
    /// The far field's spectrum, mm, at multiples of `per_value`; 0 beyond them.
    spectrum: Vec<f32>,
    /// Distance between the spectrum's frequencies, rad/mm.
    per_value: f64,
}

impl PressureResponse {
    /// Computes the response for pixels of this size, up to the distance `reach_mm`, in windows of up to `window`
    /// pixels, for contacts that are solved to `tolerance_um`.
    pub fn new(layer: ElasticLayer, mm_per_px: [f64; 2], reach_mm: f64, window: [usize; 2], tolerance_um: f64) -> Self {
        Self::with_curve(&CorrectionCurve::new(layer), mm_per_px, reach_mm, window, tolerance_um)
    }

    /// Computes the response like [`Self::new`], from a known correction curve.
    pub(super) fn with_curve(
        curve: &CorrectionCurve,
        mm_per_px: [f64; 2],
        reach_mm: f64,
        window: [usize; 2],
        tolerance_um: f64,
    ) -> Self {
        let layer = curve.layer;
        let size = lag_counts(layer, mm_per_px, reach_mm, window);
        let mut steps = (1..=MAX_NODE_STEP.ilog2()).rev().map(|octave| 1 << octave);
        let step = steps
            .find(|step| tolerance_um >= FIELDS_FROM_UM && NearFarFields::is_suitable(layer, mm_per_px, *step, size));
        // Outside the window, the far field continues until values divided by the splines' spectrum have decayed.
        let most = window.map(|size| size + step.map_or(0, |step| (TAPS + 2 * TAIL_NODES) * step));
        let wide = kernel_with_curve(curve, mm_per_px, reach_mm, window, most);
        let fields = step.map(|step| NearFarFields::new(curve, mm_per_px, step, &wide));
        let full_kernel = wide.crop(Rect::whole(size[0], size[1]));
        // A coarser grid may have one pixel more than counted here, depending on how it was made.
        let plans = Arc::new(FftPlans::new(2 * window[0].max(window[1]) + 16));
        Self { fields, ..Self::from_kernel(layer, mm_per_px, full_kernel, plans) }
    }

    /// Makes a response, not split, from a known kernel.
    pub fn from_kernel(layer: ElasticLayer, mm_per_px: [f64; 2], full_kernel: Grid<f32>, plans: Arc<FftPlans>) -> Self {
        Self {
            layer,
            mm_per_px,
            largest_compliance: layer.largest_compliance(),
            object_compliance: 0.0,
            full_kernel,
            plans,
            fields: None,
        }
    }

    /// Returns the response of an object that deforms like a half-space, at up to `most` lags, not split; `beside` is
    /// added to it.
    pub(super) fn with_object_kernel(
        &self,
        object_compliance: f64,
        most: [usize; 2],
        beside: Option<&Grid<f32>>,
    ) -> Self {
        let Self { layer, mm_per_px, plans, .. } = self;
        let mut full_kernel = half_space_kernel(object_compliance, *mm_per_px, most);
        if let Some(beside) = beside {
            for y in 0..full_kernel.height.min(beside.height) {
                full_kernel.row_mut(y).iter_mut().zip(beside.row(y)).for_each(|(sum, layer)| *sum += layer);
            }
        }
        // The longest wave on the grid.
        let longest_mm = (0..2).map(|k| 2.0 * most[k] as f64 * mm_per_px[k]).fold(0.0, f64::max);
        let largest_compliance = self.largest_compliance + object_compliance * longest_mm / TAU;
        let plans = Arc::clone(plans);
        Self {
            layer: *layer,
            mm_per_px: *mm_per_px,
            largest_compliance,
            object_compliance,
            full_kernel,
            plans,
            fields: None,
        }
    }

    /// Returns the displacement around one pressed pixel, mm, for Young's modulus 1: lags from 0 up along x and y, 0
    /// beyond the last.
    pub fn kernel(&self) -> &Grid<f32> {
        &self.full_kernel
    }

    /// Returns the largest response over all frequencies, mm.
    pub fn largest_compliance(&self) -> f64 {
        self.largest_compliance
    }

    /// Returns the operator from pressures in `source` to displacements in `target`, which contains it.
    pub fn operator(&self, source: Rect, target: Rect) -> Operator<'_> {
        let shape = |target: Rect| ConvolutionShape {
            source: [source.width(), source.height()],
            offset: [source.x0 - target.x0, source.y0 - target.y0],
            target: [target.width(), target.height()],
        };
        let whole =
            TorusConvolution::new(&self.plans, shape(target), [self.full_kernel.width, self.full_kernel.height], 0);
        let all = Rect::whole(target.width(), target.height());
        let in_fields = self.fields.as_ref().and_then(|fields| {
            let reach = [fields.near.width, fields.near.height];
            let sharp = Rect {
                x0: target.x0.max(source.x0.saturating_sub(reach[0])),
                y0: target.y0.max(source.y0.saturating_sub(reach[1])),
                x1: target.x1.min(source.x1 + reach[0]),
                y1: target.y1.min(source.y1 + reach[1]),
            };
            let near = TorusConvolution::new(&self.plans, shape(sharp), reach, 0);
            let worth = (near.area() as f64) < MAX_NEAR_SHARE * whole.area() as f64;
            worth.then(|| {
                let far = FarOperator::new(fields, &self.plans, shape(target));
                (near, sharp.in_window(target.x0, target.y0, all.x1, all.y1), far)
            })
        });
        match in_fields {
            Some((near, sharp, far)) => {
                Operator { response: self, near, near_rect: sharp, target: all, far: Some(far) }
            }
            None => Operator { response: self, near: whole, near_rect: all, target: all, far: None },
        }
    }
}

impl NearFarFields {
    /// Returns true if nodes `step` pixels apart are useful.
    fn is_suitable(layer: ElasticLayer, [dx, dy]: [f64; 2], step: usize, [width, height]: [usize; 2]) -> bool {
        let spacing_mm = step as f64 * dx.max(dy);
        let reach = NEAR_FIELD_END * GAUSSIAN_WIDTH * spacing_mm;
        let longest = (width as f64 * dx).min(height as f64 * dy);
        dx.max(dy) <= MAX_ASPECT_RATIO * dx.min(dy)
            && spacing_mm <= MAX_NODE_SPACING * layer.thickness_mm
            && 2.0 * reach <= longest
    }

    fn new(curve: &CorrectionCurve, mm_per_px: [f64; 2], step: usize, whole: &Grid<f32>) -> Self {
        let layer = curve.layer;
        let [dx, dy] = mm_per_px;
        let width_mm = GAUSSIAN_WIDTH * step as f64 * dx.max(dy);
        let end_mm = NEAR_FIELD_END * width_mm;
        let (h, half_space) = (layer.thickness_mm, layer.half_space_compliance());
        let distance_mm = |x: usize, y: usize| libm::hypot(x as f64 * dx, y as f64 * dy);
        // erfc(r / s) / r at the end of the near field, and its slope: a parabola continues it to the centre.
        let gauss = 2.0 / (libm::sqrt(PI) * width_mm);
        let end = libm::erfc(NEAR_FIELD_END) / end_mm;
        let slope = -(gauss * libm::exp(-NEAR_FIELD_END * NEAR_FIELD_END) + end) / end_mm;
        let smooth = |r: f64| {
            let blurred = if r > 0.0 { libm::erf(r / width_mm) / r } else { gauss };
            let left = end + slope * (r * r - end_mm * end_mm) / (2.0 * end_mm);
            dx * dy * (half_space / TAU * (blurred + left) + curve.value_at(r / h) / h)
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
        // From there on erfc is 0 in single precision.
        let values = (8.0 / width_mm / per_value) as usize;
        let spectrum = (0..values).map(|k| {
            let q = k as f64 * per_value;
            let sharp = if k == 0 { width_mm / libm::sqrt(PI) } else { libm::erf(0.5 * q * width_mm) / q };
            (layer.normal_compliance(q) - half_space * sharp) as f32
        });
        let shares = (0..step).map(|past| {
            let t = past as f64 / step as f64;
            let u = 1.0 - t;
            let middle = |t: f64| (3.0 * t * t * t - 6.0 * t * t + 4.0) / 6.0;
            [u * u * u / 6.0, middle(t), middle(u), t * t * t / 6.0].map(|share| share as f32)
        });
        Self { near, far, step, shares: shares.collect(), spectrum: spectrum.collect(), per_value }
    }

    /// Returns the far field's spectrum at a frequency, mm.
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
    response: &'a PressureResponse,
    /// Convolutions with the near field, or with the full response if there is no far field.
    near: TorusConvolution<'a>,
    /// The part of the target that the near field reaches.
    near_rect: Rect,
    target: Rect,
    far: Option<FarOperator<'a>>,
}

/// Memory for operators of any size.
#[derive(Default)]
pub struct OperatorBuffers {
    buffers: ConvolutionBuffers,
    near: KernelSpectrum,
    far: KernelSpectrum,
    inverse: KernelSpectrum,
    near_displacement: Grid<f32>,
    rows: Grid<f32>,
    spread: Grid<f32>,
    nodes: Grid<f32>,
}

impl Operator<'_> {
    /// Computes the spectra; must be called before [`Self::displace`].
    pub fn prepare(&self, memory: &mut OperatorBuffers) {
        let OperatorBuffers { buffers, near, far, .. } = memory;
        let fields = self.response.fields.as_ref().filter(|_| self.far.is_some());
        self.near.set_spectrum(fields.map_or(&self.response.full_kernel, |fields| &fields.near), buffers, near);
        if let Some(operator) = &self.far {
            operator.torus.set_spectrum(&operator.fields.far, buffers, far);
            operator.torus.scale_spectrum(far, |angle| {
                // A spline's spectrum is sinc^4. It occurs twice: pressures are spread by splines, displacements
                // interpolated by them.
                let half = 0.5 * angle.min(TAU - angle);
                let sinc = if half > 0.0 { libm::sin(half) / half } else { 1.0 };
                libm::pow(sinc, -8.0) as f32
            });
        }
    }

    /// Computes the inverse's spectrum for [`Self::apply_inverse`], after [`Self::prepare`]. Below the frequency
    /// `cutoff`, rad/mm, the response counts as constant.
    pub fn prepare_inverse(&self, cutoff: f64, memory: &mut OperatorBuffers) {
        let PressureResponse { layer, mm_per_px, largest_compliance, object_compliance, .. } = self.response;
        let OperatorBuffers { near, inverse, .. } = memory;
        inverse.clone_from(near);
        if let Some(FarOperator { fields, .. }) = &self.far {
            let end = fields.per_value * fields.spectrum.len() as f64;
            self.near.add_to_spectrum(inverse, *mm_per_px, end, |q| fields.spectrum_at(q));
        }
        self.near.invert_spectrum(
            inverse,
            *mm_per_px,
            cutoff,
            layer.normal_compliance(cutoff) + object_compliance / cutoff,
            *largest_compliance,
        );
    }

    /// Computes the displacement under `pressure`.
    pub fn displace(&self, pressure: &Grid<f32>, memory: &mut OperatorBuffers, displacement: &mut Grid<f32>) {
        let OperatorBuffers { buffers, near, far, near_displacement, rows, spread, nodes, .. } = memory;
        if self.near_rect == self.target {
            self.near.convolve(near, pressure, displacement, buffers);
        } else {
            self.near.convolve(near, pressure, near_displacement, buffers);
            displacement.reset(self.target.width(), self.target.height());
            displacement.paste(near_displacement, self.near_rect, self.target);
        }
        if let Some(operator) = &self.far {
            operator.spread_to_nodes(pressure, rows, spread);
            operator.torus.convolve(far, spread, nodes, buffers);
            operator.add_from_nodes(nodes, rows, displacement);
        }
    }

    /// Adds the displacement under the pressure of one pixel; source and target must be the same box.
    pub fn add_pixel_response(&self, [x, y]: [usize; 2], pressure: f32, displacement: &mut Grid<f32>) {
        let kernel = &self.response.full_kernel;
        let reached = (y + 1).saturating_sub(kernel.height)..(y + kernel.height).min(displacement.height);
        simd_dispatch(
            #[inline(always)]
            || {
                for row in reached {
                    let lags = kernel.row(row.abs_diff(y));
                    let (before, behind) = displacement.row_mut(row).split_at_mut(x);
                    before.iter_mut().rev().zip(&lags[1..]).for_each(|(w, lag)| *w += pressure * lag);
                    behind.iter_mut().zip(lags).for_each(|(w, lag)| *w += pressure * lag);
                }
            },
        );
    }

    /// Computes approximately the pressure under a displacement; source and target must be the same box.
    pub fn apply_inverse(&self, displacement: &Grid<f32>, memory: &mut OperatorBuffers, pressure: &mut Grid<f32>) {
        self.near.convolve(&memory.inverse, displacement, pressure, &mut memory.buffers);
    }
}

/// The far field from one box to another. Node `j` lies at pixel `step (j - 1)` of the target.
struct FarOperator<'a> {
    fields: &'a NearFarFields,
    torus: TorusConvolution<'a>,
    /// Number of pixels from the second node that the source's first pixel contributes to, to that pixel.
    first_offset: [usize; 2],
    /// Number of nodes that the source contributes to.
    node_counts: [usize; 2],
}

impl<'a> FarOperator<'a> {
    fn new(fields: &'a NearFarFields, plans: &'a FftPlans, shape: ConvolutionShape) -> Self {
        let ConvolutionShape { source, offset, target } = shape;
        let first = offset.map(|px| px / fields.step);
        let past = offset.map(|px| px % fields.step);
        let nodes = |px: usize| (px - 1) / fields.step + TAPS;
        let count = [0, 1].map(|k| nodes(past[k] + source[k]));
        let shape = ConvolutionShape { source: count, offset: first, target: target.map(nodes) };
        let torus = TorusConvolution::new(plans, shape, [fields.far.width, fields.far.height], 2 * TAIL_NODES);
        Self { fields, torus, first_offset: past, node_counts: count }
    }

    /// Spreads pressures to nodes.
    fn spread_to_nodes(&self, pressure: &Grid<f32>, rows: &mut Grid<f32>, nodes: &mut Grid<f32>) {
        match self.fields.step {
            2 => self.spread_with_step::<2>(pressure, rows, nodes),
            4 => self.spread_with_step::<4>(pressure, rows, nodes),
            _ => self.spread_with_step::<8>(pressure, rows, nodes),
        }
    }

    fn spread_with_step<const STEP: usize>(&self, pressure: &Grid<f32>, rows: &mut Grid<f32>, nodes: &mut Grid<f32>) {
        let shares: [[f32; TAPS]; STEP] = std::array::from_fn(|past| self.fields.shares[past]);
        let [left, top] = self.first_offset;
        let [width, height] = self.node_counts;
        // First along y, into rows that are divided into steps; then along x. Sums are complete before they are stored.
        rows.reset((width + 1 - TAPS) * STEP, height);
        nodes.reset(width, height);
        simd_dispatch(
            #[inline(always)]
            || {
                for node in 0..height {
                    let first = (node + 1).saturating_sub(TAPS) * STEP;
                    let reached = first.max(top)..((node + 1) * STEP).min(top + pressure.height);
                    let to = &mut rows.data[node * rows.width..][left..left + pressure.width];
                    let (to, to_rest) = to.as_chunks_mut::<SPREAD_PX>();
                    let whole_px = to.len() * SPREAD_PX;
                    for (part, to) in to.iter_mut().enumerate() {
                        let mut sums = [0.0; SPREAD_PX];
                        for at in reached.clone() {
                            let share = shares[at % STEP][node - at / STEP];
                            let from = &pressure.data[(at - top) * pressure.width + part * SPREAD_PX..][..SPREAD_PX];
                            sums.iter_mut().zip(from).for_each(|(sum, p)| *sum += share * p);
                        }
                        *to = sums;
                    }
                    for at in reached {
                        let share = shares[at % STEP][node - at / STEP];
                        let from = &pressure.row(at - top)[whole_px..];
                        to_rest.iter_mut().zip(from).for_each(|(sum, p)| *sum += share * p);
                    }
                }
                for y in 0..height {
                    let to = &mut nodes.data[y * width..][..width];
                    let groups = rows.data[y * rows.width..][..rows.width].as_chunks::<STEP>().0;
                    // What the pixels so far contribute to the next nodes.
                    let mut so_far = [0.0; TAPS];
                    for (node, px) in to.iter_mut().zip(groups) {
                        let mut sums = [0.0; TAPS];
                        for (p, shares) in px.iter().zip(&shares) {
                            sums.iter_mut().zip(shares).for_each(|(sum, share)| *sum += share * p);
                        }
                        *node = so_far[0] + sums[0];
                        so_far = [so_far[1] + sums[1], so_far[2] + sums[2], so_far[3] + sums[3], 0.0];
                    }
                    to[groups.len()..].copy_from_slice(&so_far[..TAPS - 1]);
                }
            },
        );
    }

    /// Adds the displacement interpolated from nodes of the target.
    fn add_from_nodes(&self, nodes: &Grid<f32>, rows: &mut Grid<f32>, displacement: &mut Grid<f32>) {
        match self.fields.step {
            2 => self.add_with_step::<2>(nodes, rows, displacement),
            4 => self.add_with_step::<4>(nodes, rows, displacement),
            _ => self.add_with_step::<8>(nodes, rows, displacement),
        }
    }

    fn add_with_step<const STEP: usize>(&self, nodes: &Grid<f32>, rows: &mut Grid<f32>, displacement: &mut Grid<f32>) {
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
