//! Measures the shift between a real press and its simulated counterpart: the one at which their changes correlate
//! best.
//!
//! A change is an image minus the background image, less what differs everywhere (`Drift`). The measure is the
//! normalised cross-correlation of the three channels together, over the part of the picture where the counterpart
//! shows a change (Lewis 1995, "Fast normalized cross-correlation"). A press that is brighter by a factor correlates
//! equally well. The search goes over blocks of pixels first, then pixel by pixel around the best blocks; a parabola
//! through the peak's neighbours gives the fraction of a pixel.

use image::RgbImage;

use super::change::{BlockChange, Drift};
use gelsim_core::base::grid::{Grid, Rect, bounding_box};
use gelsim_core::base::simd::simd_dispatch;

/// Change of red, green and blue, grey levels.
pub type ChangeMap = Grid<[f32; 3]>;

/// Change of a picture, as pixels and as blocks.
pub struct ChangePyramid {
    pixels: ChangeMap,
    blocks: ChangeMap,
    block_px: usize,
}

impl ChangePyramid {
    /// Computes what a press changes against the background image, less what differs everywhere, for searches up to
    /// `most_px`.
    pub fn new(image: &RgbImage, background: &RgbImage, most_px: usize) -> Self {
        let coarse_px = image.width().max(image.height()).div_ceil(80).max(1);
        let drift = Drift::estimate(image, background, coarse_px as usize);
        let block_px = most_px.div_ceil(SEARCH_BLOCKS).max(1);
        let of = |block_px| BlockChange::new(image, background, drift, block_px).levels;
        Self { pixels: of(1), blocks: of(block_px), block_px }
    }
}

/// Number of blocks that a search reaches to each side.
const SEARCH_BLOCKS: usize = 6;

/// Number of peaks among the blocks that are searched pixel by pixel.
const MAX_PEAKS: usize = 3;

/// Smallest change that counts as visible, grey levels.
const MIN_CHANGE_LEVELS: f32 = 2.0;

/// Shift with the highest correlation.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct CorrelationPeak {
    /// Shift of the real change to the right of the counterpart's and below it, px.
    pub offset_px: [f64; 2],
    /// Correlation at the nearest integer shift, -1 to 1.
    pub correlation: f64,
    /// Whether the peak lies at the edge of the search: the best shift may be larger.
    pub at_edge: bool,
}

/// Correlation of a real change with its counterpart's, without shift; 0 if the counterpart shows no change.
pub fn unshifted_correlation(real: &ChangePyramid, counterpart: &ChangePyramid) -> f64 {
    CorrelationSearch::new(&real.pixels, &counterpart.pixels, 0).map_or(0.0, |search| search.correlation_at([0, 0]))
}

/// Finds the shift up to `most_px` along x and along y; the pyramids must be made for it. `None` if the counterpart
/// shows no change.
pub fn find_shift(real: &ChangePyramid, counterpart: &ChangePyramid, most_px: usize) -> Option<CorrelationPeak> {
    let fine = CorrelationSearch::new(&real.pixels, &counterpart.pixels, most_px)?;
    let most = most_px as i32;
    let block = real.block_px as i32;
    let mut best = ([0, 0], f64::NEG_INFINITY);
    for start in find_start_shifts(real, counterpart, most_px) {
        let range = |k: usize| (start[k] - block).max(-most)..=(start[k] + block).min(most);
        for shift in range(1).flat_map(|y| range(0).map(move |x| [x, y])) {
            let found = fine.correlation_at(shift);
            // Of equal correlations the smaller shift wins, so that the order of the search does not matter.
            let nearer = (length_squared(shift), shift) < (length_squared(best.0), best.0);
            if found > best.1 || (found == best.1 && nearer) {
                best = (shift, found);
            }
        }
    }
    let (shift, correlation) = best;
    let offset_px = std::array::from_fn(|k| {
        let beside = |by: i32| {
            let mut shift = shift;
            shift[k] += by;
            fine.correlation_at(shift)
        };
        f64::from(shift[k]) + parabola_vertex(beside(-1), correlation, beside(1))
    });
    Some(CorrelationPeak { offset_px, correlation, at_edge: shift.iter().any(|by| by.abs() >= most) })
}

/// Finds peaks of the correlation among blocks, px: places that no neighbour exceeds, the highest ones first.
fn find_start_shifts(real: &ChangePyramid, counterpart: &ChangePyramid, most_px: usize) -> Vec<[i32; 2]> {
    let block = real.block_px;
    let reach = most_px.div_ceil(block) as i32;
    if block == 1 {
        // Blocks are pixels here, so there is no coarse search: start on a grid of every third shift, which together
        // cover all.
        let strides = || (1 - reach..=reach + 1).step_by(3);
        return strides().flat_map(|y| strides().map(move |x| [x, y])).collect();
    }
    let Some(coarse) = CorrelationSearch::new(&real.blocks, &counterpart.blocks, reach as usize) else {
        return vec![[0, 0]];
    };
    let side = 2 * reach as usize + 1;
    let mut map = Grid::<f64>::new(side, side);
    for (at, value) in map.data.iter_mut().enumerate() {
        *value = coarse.correlation_at([at % side, at / side].map(|at| at as i32 - reach));
    }
    let mut peaks = Vec::new();
    for (y, x) in (0..side).flat_map(|y| (0..side).map(move |x| (y, x))) {
        let here = map.at(x, y);
        let around = |at: usize| at.saturating_sub(1)..(at + 2).min(side);
        if around(y).all(|v| around(x).all(|u| map.at(u, v) <= here)) {
            peaks.push((here, [x, y].map(|at| (at as i32 - reach) * block as i32)));
        }
    }
    peaks.sort_by(|a, b| b.0.total_cmp(&a.0));
    peaks.into_iter().take(MAX_PEAKS).map(|(_, at)| at).collect()
}

fn length_squared([x, y]: [i32; 2]) -> i32 {
    x * x + y * y
}

/// Returns where a parabola through three values, one apart, is highest, relative to the middle one; at most half a
/// step.
fn parabola_vertex(before: f64, middle: f64, after: f64) -> f64 {
    let bend = before - 2.0 * middle + after;
    if bend < 0.0 { (0.5 * (before - after) / bend).clamp(-0.5, 0.5) } else { 0.0 }
}

/// Correlation as a function of the shift.
struct CorrelationSearch<'a> {
    real: &'a ChangeMap,
    counterpart: &'a ChangeMap,
    /// Part where the counterpart shows a change, with a margin.
    region: Rect,
}

impl<'a> CorrelationSearch<'a> {
    /// Restricts the search to where the counterpart shows a change; `None` if it shows none.
    fn new(real: &'a ChangeMap, counterpart: &'a ChangeMap, margin: usize) -> Option<Self> {
        let shows = |level: [f32; 3]| level.iter().any(|level| level.abs() >= MIN_CHANGE_LEVELS);
        let part = bounding_box(counterpart, shows).grown(margin.max(4), counterpart.width, counterpart.height);
        (!part.is_empty()).then_some(Self { real, counterpart, region: part })
    }

    /// Correlation of the real change, moved back by a shift, with the counterpart's; 0 if one of them is empty.
    fn correlation_at(&self, [right, down]: [i32; 2]) -> f64 {
        let Rect { x0, y0, x1, y1 } = self.region;
        let (width, height) = (self.real.width as i32, self.real.height as i32);
        let columns = (x0 as i32).max(-right)..(x1 as i32).min(width - right);
        let rows = (y0 as i32).max(-down)..(y1 as i32).min(height - down);
        if columns.is_empty() {
            return 0.0;
        }
        let mut sums = [0.0; 3];
        simd_dispatch(
            #[inline(always)]
            || {
                for y in rows.clone() {
                    let counterpart = &self.counterpart.row(y as usize)[columns.start as usize..][..columns.len()];
                    let real = &self.real.row((y + down) as usize)[(columns.start + right) as usize..][..columns.len()];
                    add_products(counterpart.as_flattened(), real.as_flattened(), &mut sums);
                }
            },
        );
        let [both, of_real, of_counterpart] = sums;
        let energy = libm::sqrt(of_real * of_counterpart);
        if energy > 0.0 { both / energy } else { 0.0 }
    }
}

/// Adds the sums over a line: counterpart times real, real squared, counterpart squared.
#[inline(always)]
fn add_products(counterpart: &[f32], real: &[f32], sums: &mut [f64; 3]) {
    // Eight sums side by side, in a fixed order that the compiler can vectorise. The sums of one line fit into f32.
    let mut lanes = [[0.0_f32; 8]; 3];
    let (counterparts, reals) = (counterpart.chunks_exact(8), real.chunks_exact(8));
    let rest = counterparts.remainder().iter().zip(reals.remainder());
    for (counterpart, real) in counterparts.zip(reals) {
        for i in 0..8 {
            lanes[0][i] += counterpart[i] * real[i];
            lanes[1][i] += real[i] * real[i];
            lanes[2][i] += counterpart[i] * counterpart[i];
        }
    }
    for (i, (counterpart, real)) in rest.enumerate() {
        lanes[0][i] += counterpart * real;
        lanes[1][i] += real * real;
        lanes[2][i] += counterpart * counterpart;
    }
    for (sum, lanes) in sums.iter_mut().zip(lanes) {
        *sum += lanes.iter().map(|lane| f64::from(*lane)).sum::<f64>();
    }
}

#[cfg(test)]
mod tests {
    use image::Rgb;

    use super::*;

    const SIZE: [u32; 2] = [120, 90];

    fn flat() -> RgbImage {
        RgbImage::from_pixel(SIZE[0], SIZE[1], Rgb([110, 120, 100]))
    }

    /// The background with a dent at a place: bright on one side, dark on the other, in other directions per channel.
    fn dent(at_px: [f64; 2], gains: [f64; 3]) -> RgbImage {
        let mut image = flat();
        for (x, y, pixel) in image.enumerate_pixels_mut() {
            let (dx, dy) = (f64::from(x) - at_px[0], f64::from(y) - at_px[1]);
            let falls = (-(dx * dx + 1.4 * dy * dy) / 90.0).exp();
            let slopes = [dx, 0.8 * dy - 0.4 * dx, -0.7 * dy - 0.3 * dx];
            for k in 0..3 {
                let level = f64::from(pixel.0[k]) + gains[k] * 9.0 * falls * slopes[k];
                pixel.0[k] = level.round().clamp(0.0, 255.0) as u8;
            }
        }
        image
    }

    /// Every shift, by the sum as written, in f64.
    fn exhaustive(real: &ChangeMap, counterpart: &ChangeMap, part: Rect, most: i32) -> ([i32; 2], f64) {
        let mut best = ([0, 0], f64::NEG_INFINITY);
        for (down, right) in (-most..=most).flat_map(|y| (-most..=most).map(move |x| (y, x))) {
            let mut sums = [0.0_f64; 3];
            for (y, x) in (part.y0..part.y1).flat_map(|y| (part.x0..part.x1).map(move |x| (y as i32, x as i32))) {
                let (u, v) = (x + right, y + down);
                if !(0..real.width as i32).contains(&u) || !(0..real.height as i32).contains(&v) {
                    continue;
                }
                for k in 0..3 {
                    let a = f64::from(real.at(u as usize, v as usize)[k]);
                    let b = f64::from(counterpart.at(x as usize, y as usize)[k]);
                    sums = [sums[0] + a * b, sums[1] + a * a, sums[2] + b * b];
                }
            }
            let found = sums[0] / (sums[1] * sums[2]).sqrt();
            if found > best.1 {
                best = ([right, down], found);
            }
        }
        best
    }

    #[test]
    fn the_search_finds_what_trying_every_shift_finds() {
        for (shift, most) in [([0.0, 0.0], 3), ([7.0, -4.0], 9), ([-11.0, 13.0], 16), ([2.0, 2.0], 2)] {
            let (real, counterpart) =
                (dent([60.0 + shift[0], 45.0 + shift[1]], [0.8, 1.0, 1.3]), dent([60.0, 45.0], [1.0; 3]));
            let real = ChangePyramid::new(&real, &flat(), most);
            let counterpart = ChangePyramid::new(&counterpart, &flat(), most);
            let found = find_shift(&real, &counterpart, most).expect("a dent shows");
            let part = CorrelationSearch::new(&real.pixels, &counterpart.pixels, most).expect("a dent shows").region;
            let (exact, correlation) = exhaustive(&real.pixels, &counterpart.pixels, part, most as i32);
            assert_eq!(found.offset_px.map(|px| px.round() as i32), exact, "{shift:?}");
            assert_eq!(exact.map(f64::from), shift);
            assert!((found.correlation - correlation).abs() < 1e-5 && correlation > 0.95, "{found:?} {correlation}");
            assert_eq!(found.at_edge, most == 2);
        }
    }

    #[test]
    fn shifts_by_parts_of_a_pixel_are_found_between_the_pixels() {
        for shift in [[0.3, -0.4], [3.4, -2.2], [-5.75, 0.5]] {
            let real = ChangePyramid::new(&dent([60.0 + shift[0], 45.0 + shift[1]], [1.0; 3]), &flat(), 10);
            let counterpart = ChangePyramid::new(&dent([60.0, 45.0], [1.0; 3]), &flat(), 10);
            let found = find_shift(&real, &counterpart, 10).expect("a dent shows").offset_px;
            for k in 0..2 {
                assert!((found[k] - shift[k]).abs() < 0.05, "{shift:?}: {found:?}");
            }
        }
    }

    #[test]
    fn a_dent_that_the_border_cuts_is_found_and_a_counterpart_without_any_is_not() {
        let real = ChangePyramid::new(&dent([8.0, 84.0], [1.0; 3]), &flat(), 12);
        let counterpart = ChangePyramid::new(&dent([3.0, 88.0], [1.0; 3]), &flat(), 12);
        let found = find_shift(&real, &counterpart, 12).expect("a dent shows");
        assert!((found.offset_px[0] - 5.0).abs() < 0.1 && (found.offset_px[1] + 4.0).abs() < 0.1, "{found:?}");
        let none = ChangePyramid::new(&flat(), &flat(), 12);
        assert_eq!(find_shift(&real, &none, 12), None);
        assert_eq!(unshifted_correlation(&real, &none), 0.0);
        let nothing = ChangePyramid::new(&flat(), &flat(), 12);
        assert_eq!(find_shift(&nothing, &counterpart, 12).expect("the counterpart shows").correlation, 0.0);
    }
}
