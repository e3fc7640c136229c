//! The 2019 paper's elastomer: the depth map blurred by repeated means, around the contact.
//!
//! Source: Gomes, Wilson and Luo (2019), text: 5 passes of a 15x15 mean. Where the blurred surface lies deeper than the
//! object, the pad hangs free and the blur is its shape; where the object lies deeper, the pad touches it. That is the
//! larger of the two everywhere, so the surface has no step at the rim. Valid as a picture only: it cannot bulge,
//! knows no force, and is off by tens of micrometres beside the contact.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::{Contact, Numerics, SURFACE_BORDER, untouched};
use crate::depth::Depth;
use crate::grid::{Grid, Rect, bounding_box};

/// Parameters of the mean blur.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(default, deny_unknown_fields)]
pub struct MeanBlur {
    /// Width and height of the mean, px, odd, 1 to 255. The paper's: 15.
    pub kernel_px: u32,
    /// How often it is applied, 0 to 64. The paper's: 5.
    pub passes: u32,
}

impl Default for MeanBlur {
    fn default() -> Self {
        Self { kernel_px: 15, passes: 5 }
    }
}

impl MeanBlur {
    /// How far a value spreads, px.
    pub fn reach_px(self) -> usize {
        (self.kernel_px as usize / 2) * self.passes as usize
    }
}

const NUMERICS: Numerics = Numerics { converged: true, iterations: 0, residual_um: None, model_error_um: None };

/// Presses the object into the pad.
pub fn press(blur: &MeanBlur, depth: &Depth) -> Contact {
    let margin = depth.margin_px;
    let overlap = &depth.overlap;
    let (width, height) = (overlap.width - 2 * margin, overlap.height - 2 * margin);
    let touching = bounding_box(overlap, |mm| mm > 0.0);
    let mut contact = untouched(width, height, None, NUMERICS);
    let area = touching.grown(blur.reach_px(), overlap.width, overlap.height);
    let border = SURFACE_BORDER;
    let corner = margin - border;
    contact.region = area.seen_from(corner, corner, width + 2 * border, height + 2 * border);
    if contact.region.is_empty() {
        return contact;
    }
    let mut blurred = overlap.crop(area);
    pulp::Arch::new().dispatch(|| mean_blur(&mut blurred, blur.kernel_px as usize, blur.passes as usize));

    let region = contact.region;
    for y in region.y0..region.y1 {
        let columns = corner + region.x0 - area.x0..corner + region.x1 - area.x0;
        let hanging = &blurred.row(corner + y - area.y0)[columns];
        let object = &overlap.row(corner + y)[corner + region.x0..corner + region.x1];
        let surface = &mut contact.surface.row_mut(y)[region.x0..region.x1];
        for ((surface, hanging), object) in surface.iter_mut().zip(hanging).zip(object) {
            *surface = hanging.max(*object);
        }
    }
    let view = touching.seen_from(margin, margin, width, height);
    for y in view.y0..view.y1 {
        let surface = &contact.surface.row(y + border)[border..];
        let object = &overlap.row(y + margin)[margin..];
        let mask = &mut contact.mask.data[y * width..][..width];
        for x in view.x0..view.x1 {
            let touches = object[x] > 0.0 && surface[x] <= object[x];
            mask[x] = if touches { 255 } else { 0 };
        }
    }
    contact
}

/// Applies a `kernel` x `kernel` mean `passes` times, in place; beyond the image the depth is 0.
///
/// Means along rows and along columns commute, so all passes of one direction are done while a strip is in cache.
#[inline(always)]
pub fn mean_blur(image: &mut Grid<f32>, kernel: usize, passes: usize) {
    let (width, height) = (image.width, image.height);
    let mut sums = RunningSums::default();
    for row in image.data.chunks_exact_mut(width.max(1)) {
        sums.load(row.iter().copied(), width, 1, kernel);
        sums.repeat(kernel, passes);
        row.copy_from_slice(&sums.line[sums.start..][..width]);
    }
    for x in (0..width).step_by(STRIP) {
        let strip = STRIP.min(width - x);
        let columns = Rect { x0: x, y0: 0, x1: x + strip, y1: height };
        let rows = image.data.chunks_exact(width).flat_map(|row| &row[columns.x0..columns.x1]);
        sums.load(rows.copied(), height, strip, kernel);
        sums.repeat(kernel, passes);
        let lines = sums.line[sums.start..].chunks_exact(strip);
        for (row, line) in image.data.chunks_exact_mut(width).zip(lines) {
            row[columns.x0..columns.x1].copy_from_slice(line);
        }
    }
}

/// Columns that are summed at a time: a strip of 800 rows stays within the L2 cache.
const STRIP: usize = 32;

/// Means of `kernel` neighbours along a line of `count` cells of `stride` numbers each.
///
/// The sum of 15 is put together from sums of 8, 4, 2 and 1 neighbours (7 additions instead of 14). Unlike a sum that
/// runs along and subtracts what it leaves behind, this never drifts: what is 0 within reach stays exactly 0, and
/// nothing becomes negative.
#[derive(Default)]
struct RunningSums {
    line: Vec<f32>,
    power: Vec<f32>,
    next: Vec<f32>,
    total: Vec<f32>,
    start: usize,
    count: usize,
    stride: usize,
}

impl RunningSums {
    #[inline(always)]
    fn load(&mut self, values: impl Iterator<Item = f32>, count: usize, stride: usize, kernel: usize) {
        let halo = kernel / 2 * stride;
        (self.start, self.count, self.stride) = (halo, count, stride);
        self.line.clear();
        self.line.resize(halo, 0.0);
        self.line.extend(values);
        self.line.resize(count * stride + 2 * halo, 0.0);
        self.power.resize(self.line.len(), 0.0);
        self.next.resize(self.line.len(), 0.0);
        self.total.resize(count * stride, 0.0);
    }

    #[inline(always)]
    fn repeat(&mut self, kernel: usize, passes: usize) {
        let inner = self.count * self.stride;
        let share = 1.0 / kernel as f32;
        for _ in 0..passes {
            // power[i] = line[i] + its neighbours up to `size` cells on; total gathers the sizes that add up to kernel.
            let (mut size, mut gathered, mut valid) = (1, 0, self.line.len());
            self.power.copy_from_slice(&self.line);
            self.total.fill(0.0);
            loop {
                if kernel & size != 0 {
                    let from = gathered * self.stride;
                    for (total, power) in self.total.iter_mut().zip(&self.power[from..from + inner]) {
                        *total += power;
                    }
                    gathered += size;
                }
                if 2 * size > kernel {
                    break;
                }
                let shift = size * self.stride;
                valid -= shift;
                let pairs = self.power[..valid].iter().zip(&self.power[shift..shift + valid]);
                for (next, (here, ahead)) in self.next[..valid].iter_mut().zip(pairs) {
                    *next = here + ahead;
                }
                std::mem::swap(&mut self.power, &mut self.next);
                size *= 2;
            }
            for (line, total) in self.line[self.start..][..inner].iter_mut().zip(&self.total) {
                *line = total * share;
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Each mean as written: a double loop, 0 beyond the image, in f64.
    fn oracle(image: &Grid<f32>, kernel: usize, passes: usize) -> Vec<f64> {
        let half = (kernel / 2) as isize;
        let (width, height) = (image.width as isize, image.height as isize);
        let mut now: Vec<f64> = image.data.iter().map(|&v| f64::from(v)).collect();
        for _ in 0..passes {
            let before = now.clone();
            for y in 0..height {
                for x in 0..width {
                    let mut sum = 0.0;
                    for v in (y - half).max(0)..(y + half + 1).min(height) {
                        for u in (x - half).max(0)..(x + half + 1).min(width) {
                            sum += before[(v * width + u) as usize];
                        }
                    }
                    now[(y * width + x) as usize] = sum / (kernel * kernel) as f64;
                }
            }
        }
        now
    }

    #[test]
    fn sums_of_powers_of_two_agree_with_the_double_loop_for_every_kernel_and_size() {
        for (width, height) in [(1, 1), (1, 40), (37, 3), (70, 41), (33, 64)] {
            for (kernel, passes) in [(1, 3), (3, 2), (5, 1), (15, 5), (15, 1), (31, 2)] {
                let mut image = Grid::<f32>::new(width, height);
                for (i, value) in image.data.iter_mut().enumerate() {
                    // Mostly zeros with steep peaks: the hardest for sums that cancel.
                    *value = if i % 7 == 3 { ((i * 2_654_435_761) % 3001) as f32 * 1e-3 } else { 0.0 };
                }
                let expected = oracle(&image, kernel, passes);
                mean_blur(&mut image, kernel, passes);
                for (found, expected) in image.data.iter().zip(&expected) {
                    let error = (f64::from(*found) - expected).abs();
                    assert!(error <= 2e-6 * (1.0 + expected), "{width}x{height} k{kernel} p{passes}: {error}");
                    assert!(*found >= 0.0);
                }
            }
        }
    }

    #[test]
    fn the_surface_meets_the_object_without_a_step_and_never_lies_above_it() {
        let (size, margin) = (120, 36);
        let mut overlap = Grid::<f32>::new(size + 2 * margin, size + 2 * margin);
        for y in 0..overlap.height {
            for x in 0..overlap.width {
                let (dx, dy) = (x as f32 - 96.0, y as f32 - 96.0);
                overlap.row_mut(y)[x] = (1.0 - (dx * dx + dy * dy) / 900.0).max(0.0);
            }
        }
        let depth = Depth { overlap, margin_px: margin, over_thickness_px: 0 };
        let contact = press(&MeanBlur::default(), &depth);
        let mut largest_step = 0.0_f32;
        for y in 0..size {
            for x in 0..size {
                let surface = contact.surface.at(x + 1, y + 1);
                let object = depth.overlap.at(x + margin, y + margin);
                assert!(surface >= object);
                assert_eq!(contact.mask.at(x, y) == 255, object > 0.0 && surface == object);
                largest_step = largest_step.max((contact.surface.at(x + 2, y + 1) - surface).abs());
            }
        }
        // The object's own largest step is 2 * 30 / 900 mm per pixel.
        assert!(largest_step < 0.07, "{largest_step}");
    }
}
