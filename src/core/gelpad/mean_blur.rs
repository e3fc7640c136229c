//! The elastomer model of the 2019 paper: the depth map blurred by repeated means, around the contact.
//!
//! Source: Gomes, Wilson and Luo (2019), text: 5 passes of a 15x15 mean. Where the blurred surface lies deeper than the
//! object, the pad hangs free and has the shape of the blur; where the object lies deeper, the pad touches it. The
//! surface is the deeper of the two everywhere, so it has no step where the object has none (at a vertical wall, a step
//! of half its height remains). The model is good for images only: the pad cannot bulge, there is no force, and beside
//! the contact the surface is off by tens of micrometres.

use serde::{Deserialize, Serialize};

use super::{Contact, Numerics, no_contact};
use crate::base::grid::{Grid, Rect};
use crate::base::simd::simd_dispatch;
use crate::base::view::SURFACE_BORDER;
use crate::depth::Depth;

/// Parameters of the mean blur.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
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
    /// Returns how far a value spreads, px.
    pub fn reach_px(self) -> usize {
        (self.kernel_px as usize / 2) * self.passes as usize
    }
}

/// Presses the object into the pad.
pub fn press(blur: &MeanBlur, depth: &Depth) -> Contact {
    let margin = depth.margin_px;
    let penetration = &depth.penetration;
    let (width, height) = (penetration.width - 2 * margin, penetration.height - 2 * margin);
    let touching = depth.touching;
    let mut contact = no_contact(width, height, None, Numerics::DIRECT);
    let area = touching.grown(blur.reach_px(), penetration.width, penetration.height);
    let corner = margin.saturating_sub(SURFACE_BORDER);
    contact.region = area.in_window(corner, corner, contact.surface.width, contact.surface.height);
    if contact.region.is_empty() {
        return contact;
    }
    simd_dispatch(
        #[inline(always)]
        || {
            let blurred = mean_blur(penetration, area, blur.kernel_px as usize, blur.passes as usize);
            merge_with_object(&blurred, area, depth, &mut contact);
        },
    );
    contact
}

/// Where the pad hangs this close to the object, it touches it, mm. The blur of a plane is the plane itself: without a
/// gap, rounding would decide.
const CONTACT_GAP_MM: f32 = 1e-3;

/// Takes the deeper of the hanging pad and the object as the surface. They touch where the pad is at most the contact
/// gap deeper than the object.
#[inline(always)]
fn merge_with_object(blurred: &Grid<f32>, area: Rect, depth: &Depth, contact: &mut Contact) {
    let region = contact.region;
    let corner = depth.margin_px - SURFACE_BORDER;
    for y in region.y0..region.y1 {
        let columns = corner + region.x0 - area.x0..corner + region.x1 - area.x0;
        let hanging = &blurred.row(corner + y - area.y0)[columns];
        let object = &depth.penetration.row(corner + y)[corner + region.x0..corner + region.x1];
        let surface = &mut contact.surface.row_mut(y)[region.x0..region.x1];
        let mut not_finite = 0_u32;
        for ((surface, hanging), object) in surface.iter_mut().zip(hanging).zip(object) {
            *surface = if hanging > object { *hanging } else { *object };
            // x * 0.0 != 0.0 holds for NaN and infinities only, and vectorises.
            not_finite += u32::from(*surface * 0.0 != 0.0);
        }
        contact.finite &= not_finite == 0;
    }
    let (width, height) = (contact.mask.width, contact.mask.height);
    let view = depth.touching.in_window(depth.margin_px, depth.margin_px, width, height);
    for y in view.y0..view.y1 {
        let surface = &contact.surface.row(y + SURFACE_BORDER)[SURFACE_BORDER + view.x0..SURFACE_BORDER + view.x1];
        let object = &depth.penetration.row(y + depth.margin_px)[depth.margin_px + view.x0..depth.margin_px + view.x1];
        let mask = &mut contact.mask.row_mut(y)[view.x0..view.x1];
        for ((mask, surface), object) in mask.iter_mut().zip(surface).zip(object) {
            *mask = if (*object > 0.0) & (surface - object <= CONTACT_GAP_MM) { 255 } else { 0 };
        }
    }
}

/// Returns a part of an image after `passes` means of `kernel` x `kernel`; outside the part the depth is 0.
///
/// Means along rows and along columns commute, so all passes along one direction are done while a line is in cache.
#[inline(always)]
pub fn mean_blur(image: &Grid<f32>, part: Rect, kernel: usize, passes: usize) -> Grid<f32> {
    let (width, height) = (part.width(), part.height());
    let mut blurred = Grid { width, height, data: Vec::with_capacity(width * height) };
    let mut row_means = LineMeans::new(kernel, width, 1);
    for y in part.y0..part.y1 {
        let row = &image.row(y)[part.x0..part.x1];
        // Rows above, below and between contacts stay 0.
        if row.iter().all(|value| *value == 0.0) {
            blurred.data.extend_from_slice(row);
            continue;
        }
        row_means.line_mut().copy_from_slice(row);
        row_means.apply_means(passes);
        blurred.data.extend_from_slice(row_means.line_mut());
    }
    let mut column_means = LineMeans::new(kernel, height, STRIP_COLUMNS.min(width));
    for x in (0..width).step_by(STRIP_COLUMNS) {
        let strip = STRIP_COLUMNS.min(width - x);
        // The last strip may be narrower.
        if strip < column_means.stride {
            column_means = LineMeans::new(kernel, height, strip);
        }
        for (cells, row) in column_means.line_mut().chunks_exact_mut(strip).zip(blurred.data.chunks_exact(width)) {
            cells.copy_from_slice(&row[x..x + strip]);
        }
        column_means.apply_means(passes);
        for (cells, row) in column_means.line_mut().chunks_exact(strip).zip(blurred.data.chunks_exact_mut(width)) {
            row[x..x + strip].copy_from_slice(cells);
        }
    }
    blurred
}

/// Number of columns that are averaged at a time: a strip of 600 rows and its sums stays within the L2 cache.
const STRIP_COLUMNS: usize = 16;

/// Computes means of `kernel` neighbours along a line of `count` cells of `stride` numbers each; outside the line there
/// are zeros.
///
/// The sum of 15 neighbours is built from the sums of 8, 4, 2 and 1. Unlike a running sum that subtracts the values it
/// leaves behind, this never drifts: a value whose neighbours are 0 stays exactly 0, no value becomes negative, and
/// every step is the same for many cells at once.
struct LineMeans {
    kernel: usize,
    stride: usize,
    start: usize,
    /// Numbers in the line, without the zeros around it.
    size: usize,
    /// sums[k][i] is the sum of 2^k cells from i on; sums[0] is the line itself between zeros.
    sums: Vec<Vec<f32>>,
    /// The next line, between zeros too.
    next: Vec<f32>,
}

impl LineMeans {
    fn new(kernel: usize, count: usize, stride: usize) -> Self {
        let start = kernel / 2 * stride;
        let size = count * stride;
        let levels = kernel.ilog2() as usize + 1;
        let line = vec![0.0; size + 2 * start];
        Self { kernel, stride, start, size, next: line.clone(), sums: vec![line; levels] }
    }

    #[inline(always)]
    fn line_mut(&mut self) -> &mut [f32] {
        &mut self.sums[0][self.start..][..self.size]
    }

    #[inline(always)]
    fn apply_means(&mut self, passes: usize) {
        for _ in 0..passes {
            for level in 1..self.sums.len() {
                let shift = self.stride << (level - 1);
                let (lower, upper) = self.sums.split_at_mut(level);
                // Sums of 2^level cells are complete up to this distance from the end.
                let whole = upper[0].len() - (self.stride << level) + self.stride;
                let pairs = lower[level - 1][..whole].iter().zip(&lower[level - 1][shift..][..whole]);
                for (sum, (here, ahead)) in upper[0][..whole].iter_mut().zip(pairs) {
                    *sum = here + ahead;
                }
            }
            self.combine_sums();
        }
    }

    /// Adds the sums whose sizes are the kernel's binary digits, and makes the means the new line.
    #[inline(always)]
    fn combine_sums(&mut self) {
        let mut terms: [&[f32]; MAX_LEVELS] = [&[]; MAX_LEVELS];
        let (mut count, mut offset) = (0, 0);
        for level in (0..self.sums.len()).rev().filter(|level| self.kernel >> level & 1 == 1) {
            terms[count] = &self.sums[level][offset * self.stride..][..self.size];
            offset += 1 << level;
            count += 1;
        }
        let out = &mut self.next[self.start..][..self.size];
        let share = 1.0 / self.kernel as f32;
        match count {
            1 => add_terms::<1>(&terms, share, out),
            2 => add_terms::<2>(&terms, share, out),
            3 => add_terms::<3>(&terms, share, out),
            4 => add_terms::<4>(&terms, share, out),
            5 => add_terms::<5>(&terms, share, out),
            6 => add_terms::<6>(&terms, share, out),
            7 => add_terms::<7>(&terms, share, out),
            _ => add_terms::<MAX_LEVELS>(&terms, share, out),
        }
        std::mem::swap(&mut self.sums[0], &mut self.next);
    }
}

/// Number of binary digits of the largest kernel, 255.
const MAX_LEVELS: usize = 8;

/// Sets `out` to `share` times the sum of the first `N` terms.
#[inline(always)]
fn add_terms<const N: usize>(terms: &[&[f32]; MAX_LEVELS], share: f32, out: &mut [f32]) {
    let terms: [&[f32]; N] = std::array::from_fn(|k| &terms[k][..out.len()]);
    for (i, out) in out.iter_mut().enumerate() {
        let mut sum = terms[0][i];
        for term in &terms[1..] {
            sum += term[i];
        }
        *out = sum * share;
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::base::grid::bounding_box;

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
                let blurred = mean_blur(&image, Rect::whole(width, height), kernel, passes);
                for (found, expected) in blurred.data.iter().zip(&expected) {
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
        let mut penetration = Grid::<f32>::new(size + 2 * margin, size + 2 * margin);
        for y in 0..penetration.height {
            for x in 0..penetration.width {
                let (dx, dy) = (x as f32 - 96.0, y as f32 - 96.0);
                penetration.row_mut(y)[x] = (1.0 - (dx * dx + dy * dy) / 900.0).max(0.0);
            }
        }
        let touching = bounding_box(&penetration, |mm| mm > 0.0);
        let depth = Depth { penetration, margin_px: margin, touching, deepest_mm: 1.0, over_thickness_px: 0 };
        let contact = press(&MeanBlur::default(), &depth);
        let mut largest_step = 0.0_f32;
        for y in 0..size {
            for x in 0..size {
                let surface = contact.surface.at(x + 1, y + 1);
                let object = depth.penetration.at(x + margin, y + margin);
                assert!(surface >= object);
                assert_eq!(contact.mask.at(x, y) == 255, object > 0.0 && surface - object <= CONTACT_GAP_MM);
                largest_step = largest_step.max((contact.surface.at(x + 2, y + 1) - surface).abs());
            }
        }
        // The object's own largest step is 2 * 30 / 900 mm per pixel.
        assert!(largest_step < 0.07, "{largest_step}");
    }
}
