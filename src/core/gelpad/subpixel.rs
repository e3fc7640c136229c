//! The surface between pixel centres, where it bends so much within a pixel that the light at the centre is not the
//! pixel's: at walls and edges, which would otherwise show saw-teeth.
//!
//! Such a pixel is sampled at [`SAMPLE_OFFSETS`]. At each offset the object is captured again. The pad's own surface is
//! interpolated between pixels, but not across a wall: only from pixels off the object, and from pixels on it whose
//! surface joins the sample's without a step. The optics average the light over the samples (not the heights, which
//! would round off the wall). The weight of the average grows from 0 to 1 while the slope changes by one to two
//! [`MIN_BEND`] per pixel.

use std::ops::Range;

use crate::base::grid::{Grid, Rect};
use crate::base::simd::{larger, simd_dispatch};
use crate::base::view::{SURFACE_BORDER, View};
use crate::depth::indenter::{Indenter, Shape};
use crate::depth::raster::{SAMPLES, SampleLayout};
use crate::depth::{self, CaptureWindow, Depth};
use crate::effects::{Effect, EffectLog, Requirement};
use crate::gelpad::{Contact, Pad};

/// Largest change of the slope from one pixel to the next that needs no sampling.
pub const MIN_BEND: f32 = 0.2;

/// Positions of a pixel's samples, px from its centre: eight points that map to themselves under mirroring and quarter
/// turns.
pub const SAMPLE_OFFSETS: [[f64; 2]; SAMPLES] = [
    [0.375, 0.125],
    [-0.375, 0.125],
    [0.375, -0.125],
    [-0.375, -0.125],
    [0.125, 0.375],
    [-0.125, 0.375],
    [0.125, -0.375],
    [-0.125, -0.375],
];

/// Slope of the object's surface between two points above which they join less; from twice this slope on there is a
/// step.
const STEP_SLOPE: f32 = 2.0;

/// Gap above which a pixel is completely off the object, mm.
const CLEAR_GAP_MM: f32 = 0.01;

/// Weight of plain interpolation, for points that no pixel joins.
const PLAIN_WEIGHT: f32 = 1e-3;

/// Columns that are looked at together where most weights are 0.
const SCANNED_PX: usize = 32;

/// Samples of a surface between pixel centres.
#[derive(Clone, Debug)]
pub struct Subpixel {
    /// The smallest part of the view that contains all sampled pixels.
    pub region: Rect,
    /// The sampled pixels, row by row.
    pixels: Vec<SampledPixel>,
    /// Index in `pixels` where each of the region's rows begins, and the end of the last one.
    rows: Vec<usize>,
    /// Heights of the surface, mm, at each offset of the sampled pixels and of their neighbours, row by row.
    heights_mm: Vec<[f32; SAMPLES]>,
    /// Factor from the difference of a pixel's neighbours, mm, to the slope, along the row and down.
    slope_per_mm: [f32; 2],
}

/// A pixel that is sampled.
#[derive(Clone, Copy, Debug)]
pub struct SampledPixel {
    /// Column of the view.
    pub x: u32,
    /// Weight of the samples against the centre, above 0, at most 1.
    pub weight: f32,
    /// Indices in `heights_mm` of the pixel above, this one and the one below. The neighbours along the row come
    /// directly before and after this one.
    numbers: [u32; 3],
}

impl Subpixel {
    /// Returns the sampled pixels of row `y` of the view.
    pub fn row(&self, y: usize) -> &[SampledPixel] {
        match (self.region.y0..self.region.y1).contains(&y) {
            true => &self.pixels[self.rows[y - self.region.y0]..self.rows[y - self.region.y0 + 1]],
            false => &[],
        }
    }

    /// Returns the surface's slopes at each offset of a pixel, along the row and down; positive where it falls.
    #[inline(always)]
    pub(crate) fn sample_slopes(&self, pixel: &SampledPixel) -> [[f32; SAMPLES]; 2] {
        let [above, here, below] = pixel.numbers.map(|number| number as usize);
        let [per_x, per_y] = self.slope_per_mm;
        let fall = |before: usize, after: usize, per_fall: f32| {
            let (before, after) = (&self.heights_mm[before], &self.heights_mm[after]);
            std::array::from_fn(|sample| (before[sample] - after[sample]) * per_fall)
        };
        [fall(here - 1, here + 1, per_x), fall(above, below, per_y)]
    }

    /// Returns the slopes of a relief under a pixel in row `y` of the view, positive where it falls. The relief is on the
    /// grid of [`Contact::surface`].
    pub(crate) fn relief_slope(&self, pixel: &SampledPixel, y: usize, relief: &Grid<f32>) -> [f32; 2] {
        let [x, y] = [pixel.x as usize, y].map(|at| at + SURFACE_BORDER);
        let fall_x = (relief.at(x - 1, y) - relief.at(x + 1, y)) * self.slope_per_mm[0];
        let fall_y = (relief.at(x, y - 1) - relief.at(x, y + 1)) * self.slope_per_mm[1];
        [fall_x, fall_y]
    }
}

/// Inputs of the sampling between pixel centres.
pub struct SubpixelInput<'a> {
    /// The model of the gelpad.
    pub pad: &'a Pad,
    /// The object.
    pub indenter: &'a Indenter,
    /// The window in which the object was captured.
    pub window: CaptureWindow,
    /// The depth map.
    pub depth: &'a Depth,
    /// True if the depth map differs from the bare object, by a texture or a curved pad.
    pub has_texture_or_drop: bool,
    /// The pad under the object.
    pub contact: &'a Contact,
    /// The view.
    pub view: &'a View,
    /// True if the optics average light over a pixel.
    pub averages_light: bool,
}

/// Samples the pad where it bends too much within a pixel; `None` if it does so nowhere.
pub fn sample_subpixels(scene: &SubpixelInput<'_>, effects: &mut EffectLog) -> Option<Subpixel> {
    let SubpixelInput { pad, indenter, window, has_texture_or_drop, contact, view, averages_light, .. } = *scene;
    let absent = match (&indenter.shape, pad) {
        _ if !averages_light => Some("measured light is that of pixel centres"),
        (Shape::HeightMap(_), _) => Some("a height map has nothing between its pixels"),
        (Shape::Seen(_), _) => Some("a depth frame has nothing between its pixels"),
        (_, Pad::MeanBlur(_) | Pad::Gaussian(_)) => Some("the gelpad model blurs every edge"),
        (Shape::Mesh(_), Pad::None | Pad::Elastic(_)) => None,
    };
    let weights = match absent {
        // A dent that is left is smooth.
        None if !contact.region.is_empty() && !scene.depth.touching.is_empty() => {
            effects.run_timed(Effect::Supersampling, || SampleWeights::new(contact, view))
        }
        _ => SampleWeights::default(),
    };
    let region = weights.region;
    let need = match absent {
        Some(why) => Requirement::Absent(why),
        None if region.is_empty() => Requirement::Unneeded("the surface bends little from pixel to pixel"),
        None => Requirement::Needed("the surface bends within pixels"),
    };
    let runs = effects.enable(Effect::Supersampling, need) && !region.is_empty();
    let Shape::Mesh(object) = &indenter.shape else { return None };
    runs.then(|| {
        effects.run_timed(Effect::Supersampling, || {
            let sampled = weights.lay_out_samples();
            let pose = &indenter.pose;
            let mut heights = depth::capture_samples(object, pose, view, region, &sampled, window);
            let centres = has_texture_or_drop.then(|| depth::capture_part(object, pose, view, region, window));
            simd_dispatch(
                #[inline(always)]
                || scene.interpolate_surface(region, &sampled, &mut heights, centres.as_ref()),
            );
            weights.into_subpixel(&sampled, heights, view)
        })
    })
}

/// The weight of the samples, for all pixels with a weight above 0: it depends on the largest bend at the pixel or
/// beside it.
#[derive(Default)]
struct SampleWeights {
    /// The smallest part of the view that contains all of these pixels.
    region: Rect,
    /// Column in the region and weight of each pixel, row by row.
    pixels: Vec<(u32, f32)>,
    /// Index in `pixels` where each of the region's rows begins, and the end of the last one.
    rows: Vec<usize>,
}

impl SampleWeights {
    fn new(contact: &Contact, view: &View) -> Self {
        let [width, height] = view.resolution_px;
        let surface = &contact.surface;
        let per_px = view.mm_per_px.map(|mm| (1.0 / mm) as f32);
        let part = contact.region.grown(1, surface.width, surface.height);
        let part = part.in_window(SURFACE_BORDER, SURFACE_BORDER, width, height);
        let (mut pixels, mut ends) = (Vec::new(), Vec::new());
        // The columns with a weight.
        let columns = part.x0.saturating_sub(1)..(part.x1 + 1).min(width);
        simd_dispatch(
            #[inline(always)]
            || {
                // The bends of a row and its neighbours, each with a column more at either end, and whether one is large.
                let mut bends = [0; 3].map(|_| vec![0.0_f32; width + 2]);
                let mut any = [false; 3];
                let (mut tallest, mut weights) = (vec![0.0_f32; width + 2], vec![0.0_f32; width]);
                for next in part.y0..part.y1 + 1 {
                    let row = &mut bends[next % 3][1 + part.x0..1 + part.x1];
                    if next < part.y1 {
                        measure_bends(surface, part, per_px, next, row);
                    } else {
                        row.fill(0.0);
                    }
                    any[next % 3] = row.iter().fold(false, |any, bend| any | (*bend > MIN_BEND));
                    if next == part.y0 {
                        continue;
                    }
                    if any == [false; 3] {
                        ends.push(pixels.len());
                        continue;
                    }
                    // The largest of three rows, then of three columns of the result.
                    let [first, second, third] = &bends;
                    let rows = first.iter().zip(second).zip(third);
                    for (tallest, ((first, second), third)) in tallest.iter_mut().zip(rows) {
                        *tallest = larger(larger(*first, *second), *third);
                    }
                    let around = tallest[columns.start..].iter().zip(&tallest[columns.start + 1..]);
                    let around = around.zip(&tallest[columns.start + 2..]);
                    for (weight, ((before, here), after)) in weights[columns.clone()].iter_mut().zip(around) {
                        let most = larger(larger(*before, *here), *after);
                        *weight = ((most - MIN_BEND) / MIN_BEND).clamp(0.0, 1.0);
                    }
                    for from in columns.clone().step_by(SCANNED_PX) {
                        let weights = &weights[from..columns.end.min(from + SCANNED_PX)];
                        if weights.iter().fold(0, |bits, weight| bits | weight.to_bits()) != 0 {
                            let counts = weights.iter().enumerate().filter(|(_, weight)| **weight > 0.0);
                            pixels.extend(counts.map(|(x, weight)| ((from + x) as u32, *weight)));
                        }
                    }
                    ends.push(pixels.len());
                }
            },
        );
        Self::from_rows(part, pixels, &ends)
    }

    /// Makes the weights from pixels with columns of the view; `ends` has the end of each row of `part` in `pixels`.
    fn from_rows(part: Rect, mut pixels: Vec<(u32, f32)>, ends: &[usize]) -> Self {
        let columns = pixels.iter().map(|(x, _)| *x);
        let Some((x0, x1)) = columns.clone().min().zip(columns.max()) else { return Self::default() };
        pixels.iter_mut().for_each(|(x, _)| *x -= x0);
        // Rows before the first pixel end at 0; rows after the last one end at the total.
        let first = ends.partition_point(|end| *end == 0);
        let last = ends.partition_point(|end| *end < pixels.len());
        let rows = std::iter::once(0).chain(ends[first..=last].iter().copied()).collect();
        let region = Rect { x0: x0 as usize, y0: part.y0 + first, x1: x1 as usize + 1, y1: part.y0 + last + 1 };
        Self { region, pixels, rows }
    }

    /// Returns the weights in a row of the region.
    fn row(&self, y: usize) -> &[(u32, f32)] {
        &self.pixels[self.rows[y]..self.rows[y + 1]]
    }

    /// Lays out the samples of the pixels and their neighbours, on the region with its border.
    fn lay_out_samples(&self) -> SampleLayout {
        // In these coordinates, the neighbours of a pixel reach from its own position to twice the border beyond it.
        let reach = 2 * SURFACE_BORDER;
        let [wide, high] = [self.region.width() + reach, self.region.height() + reach];
        let mut layout = SampleLayout::new([wide, high], &SAMPLE_OFFSETS);
        // For each row of pixels that reaches the current one, and for all of them, one bit for each column.
        let words = wide.div_ceil(64);
        let mut reached = vec![0_u64; words * (reach + 1)];
        let mut sampled = vec![0_u64; words];
        for y in 0..high {
            let row = &mut reached[y % (reach + 1) * words..][..words];
            row.fill(0);
            if y < self.region.height() {
                for (x, _) in self.row(y) {
                    let bits = ((1_u128 << (reach + 1)) - 1) << (x % 64);
                    let word = *x as usize / 64;
                    row[word] |= bits as u64;
                    if let Some(next) = row.get_mut(word + 1) {
                        *next |= (bits >> 64) as u64;
                    }
                }
            }
            sampled.fill(0);
            for row in reached.chunks_exact(words) {
                sampled.iter_mut().zip(row).for_each(|(sampled, bits)| *sampled |= bits);
            }
            layout.push_row(runs_of_ones(&sampled));
        }
        layout
    }

    /// Combines the weights with the surface's heights at the sampled positions.
    fn into_subpixel(self, sampled: &SampleLayout, heights_mm: Vec<[f32; SAMPLES]>, view: &View) -> Subpixel {
        let mut pixels = Vec::with_capacity(self.pixels.len());
        for y in 0..self.region.height() {
            // The runs that are not yet behind, of the rows above, here and below.
            let mut runs = [0, 1, 2].map(|dy| sampled.row(y + dy));
            for (x, weight) in self.row(y) {
                let column = *x as usize + SURFACE_BORDER;
                let numbers = runs.each_mut().map(|runs| {
                    while runs[0].columns.end <= column {
                        *runs = &runs[1..];
                    }
                    (runs[0].first + column - runs[0].columns.start) as u32
                });
                pixels.push(SampledPixel { x: self.region.x0 as u32 + x, weight: *weight, numbers });
            }
        }
        let slope_per_mm = view.mm_per_px.map(|mm| (0.5 / mm) as f32);
        Subpixel { region: self.region, pixels, rows: self.rows, heights_mm, slope_per_mm }
    }
}

/// Returns where the ones among bits are, the lowest bit of the first word first.
fn runs_of_ones(words: &[u64]) -> impl Iterator<Item = Range<usize>> {
    let end = 64 * words.len();
    let next = move |from: usize, inverted: u64| {
        let mut kept = !0_u64 << (from % 64);
        for (word, bits) in words.iter().enumerate().skip(from / 64) {
            let left = (bits ^ inverted) & kept;
            if left != 0 {
                return 64 * word + left.trailing_zeros() as usize;
            }
            kept = !0;
        }
        end
    };
    let mut at = 0;
    std::iter::from_fn(move || {
        let start = next(at, 0);
        at = next(start, !0);
        (start < end).then_some(start..at)
    })
}

/// Measures by how much the slope changes at the pixels of a row of a part of the view.
#[inline(always)]
fn measure_bends(surface: &Grid<f32>, part: Rect, per_px: [f32; 2], y: usize, bends: &mut [f32]) {
    let window = |dx: usize, dy: usize| &surface.row(y + dy)[part.x0 + dx..][..bends.len()];
    let (left, here, right, above, below) = (window(0, 1), window(1, 1), window(2, 1), window(1, 0), window(1, 2));
    for (x, bend) in bends.iter_mut().enumerate() {
        let twice = 2.0 * here[x];
        let along_x = (left[x] + right[x] - twice).abs() * per_px[0];
        let along_y = (above[x] + below[x] - twice).abs() * per_px[1];
        *bend = larger(along_y, along_x);
    }
}

/// For each sample, whether its nearest neighbour lies before the pixel, along the row and down.
const BEFORE: [[bool; SAMPLES]; 2] = [lies_before(0), lies_before(1)];
/// Weight of a pixel and of each sample's nearest neighbours along the row, down and across, in linear interpolation.
const CORNER_WEIGHTS: [[f32; SAMPLES]; 4] = [
    corner_weights([false, false]),
    corner_weights([true, false]),
    corner_weights([false, true]),
    corner_weights([true; 2]),
];

const fn lies_before(k: usize) -> [bool; SAMPLES] {
    let mut before = [false; SAMPLES];
    let mut at = 0;
    while at < SAMPLES {
        before[at] = SAMPLE_OFFSETS[at][k] < 0.0;
        at += 1;
    }
    before
}

const fn corner_weights(beside: [bool; 2]) -> [f32; SAMPLES] {
    let mut weights = [1.0; SAMPLES];
    let mut at = 0;
    while at < 2 * SAMPLES {
        let away = SAMPLE_OFFSETS[at / 2][at % 2].abs() as f32;
        weights[at / 2] *= if beside[at % 2] { away } else { 1.0 - away };
        at += 1;
    }
    weights
}

/// Returns for each sample one of two numbers: the first if its nearest neighbour lies before the pixel along axis `k`.
#[inline(always)]
fn by_side(k: usize, [before, behind]: [f32; 2]) -> [f32; SAMPLES] {
    let mut values = [behind; SAMPLES];
    for sample in 0..SAMPLES {
        values[sample] = if BEFORE[k][sample] { before } else { behind };
    }
    values
}

/// Returns for each sample the values of a pixel and of its nearest neighbours: along the row, down and across.
#[inline(always)]
fn values_around([above, here, below]: [[f32; 3]; 3]) -> [[f32; SAMPLES]; 4] {
    let (across_above, across_below) = (by_side(0, [above[0], above[2]]), by_side(0, [below[0], below[2]]));
    let mut across = across_below;
    for sample in 0..SAMPLES {
        across[sample] = if BEFORE[1][sample] { across_above[sample] } else { across_below[sample] };
    }
    [[here[1]; SAMPLES], by_side(0, [here[0], here[2]]), by_side(1, [above[1], below[1]]), across]
}

impl SubpixelInput<'_> {
    /// Replaces the object's heights over the pad at the offsets of each position by the heights of the surface.
    /// `centres` has the object's heights at the pixel centres, if the depth map differs from them.
    #[inline(always)]
    fn interpolate_surface(
        &self,
        region: Rect,
        sampled: &SampleLayout,
        heights: &mut [[f32; SAMPLES]],
        centres: Option<&Grid<f32>>,
    ) {
        let Self { depth, contact, .. } = self;
        let surface = &contact.surface;
        // Offset from the grid of the surface to that of the depth map.
        let margin = depth.margin_px - SURFACE_BORDER;
        let around = |at: usize, size: usize| [at.saturating_sub(1), at, (at + 1).min(size - 1)];
        let per_step = 1.0 / (STEP_SLOPE * self.view.mm_per_px[0].max(self.view.mm_per_px[1]) as f32);
        for run in sampled.runs() {
            let [above, here, below] = around(run.y + region.y0, surface.height);
            let pad_rows = [surface.row(above), surface.row(here), surface.row(below)];
            let object_row = |y: usize| &depth.penetration.row(y + margin)[margin..];
            let object_rows = [object_row(above), object_row(here), object_row(below)];
            for (x, heights) in run.columns.clone().zip(&mut heights[run.numbers()]) {
                let columns = around(x + region.x0, surface.width);
                // Heights of the pad's surface and of the object at the pixel and its eight neighbours.
                let (mut pads, mut objects) = ([[0.0; 3]; 3], [[0.0; 3]; 3]);
                for row in 0..3 {
                    for column in 0..3 {
                        pads[row][column] = pad_rows[row][columns[column]];
                        objects[row][column] = object_rows[row][columns[column]];
                    }
                }
                // Texture and curvature are taken from the centre.
                let retouch = centres.map_or(0.0, |centres| objects[1][1] + centres.at(x, run.y));
                let mut penetration = [0.0; SAMPLES];
                for sample in 0..SAMPLES {
                    penetration[sample] = retouch - heights[sample];
                }
                let (pads, objects) = (values_around(pads), values_around(objects));
                let (mut all, mut joined, mut weights) = ([0.0; SAMPLES], [0.0; SAMPLES], [0.0; SAMPLES]);
                for corner in 0..4 {
                    let (w, g) = (&pads[corner], &objects[corner]);
                    for sample in 0..SAMPLES {
                        let weight = CORNER_WEIGHTS[corner][sample];
                        all[sample] += weight * w[sample];
                        // A pixel counts if it is off the object, or if the object has no step between it and the
                        // sample.
                        let off = (w[sample] - g[sample]) * (1.0 / CLEAR_GAP_MM);
                        let level = 2.0 - (g[sample] - penetration[sample]).abs() * per_step;
                        let weight = weight * larger(off, level).clamp(0.0, 1.0);
                        joined[sample] += weight * w[sample];
                        weights[sample] += weight;
                    }
                }
                for sample in 0..SAMPLES {
                    let pad = (joined[sample] + PLAIN_WEIGHT * all[sample]) / (weights[sample] + PLAIN_WEIGHT);
                    heights[sample] = larger(penetration[sample], pad);
                }
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::runs_of_ones;

    proptest! {
        #[test]
        fn runs_of_ones_are_the_ones(words in proptest::collection::vec(prop_oneof![any::<u64>(), Just(0), Just(!0)], 0..4)) {
            let mut ones = vec![0_u64; words.len()];
            let mut end = None;
            for run in runs_of_ones(&words) {
                prop_assert!(run.start < run.end && end.is_none_or(|end| end < run.start), "{run:?} after {end:?}");
                run.clone().for_each(|at| ones[at / 64] |= 1 << (at % 64));
                end = Some(run.end);
            }
            prop_assert_eq!(ones, words);
        }
    }
}
