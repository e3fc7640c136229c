//! The surface between pixel centres, where it bends so much within a pixel that the light at the centre is not the
//! pixel's: at walls and edges, which would otherwise show saw-teeth.
//!
//! Such a pixel is sampled at [`SAMPLE_OFFSETS`]. At each offset the object is captured again. The pad's own surface is
//! interpolated between pixels, but not across a wall: only from pixels off the object, and from pixels on it whose
//! surface joins the sample's without a step. The optics average the light over the samples (not the heights, which
//! would round off the wall). The weight of the average grows from 0 to 1 while the slope changes by one to two
//! [`MIN_BEND`] per pixel.

use crate::base::grid::{Grid, Rect};
use crate::base::simd::simd_dispatch;
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
            let places = weights.sampled_positions();
            let size = [region.width(), region.height()].map(|px| px + 2 * SURFACE_BORDER);
            let sampled = SampleLayout::new(&places, size, &SAMPLE_OFFSETS);
            let pose = &indenter.pose;
            let there = depth::capture_samples(object, pose, view, region, &sampled, window);
            let centres = has_texture_or_drop.then(|| depth::capture_part(object, pose, view, region, window));
            let mut heights = there;
            simd_dispatch(
                #[inline(always)]
                || scene.interpolate_surface(region, &places, &mut heights, centres.as_ref()),
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
        let mut any = vec![false; height];
        let (mut pixels, mut ends) = (Vec::new(), Vec::new());
        simd_dispatch(
            #[inline(always)]
            || {
                let mut rows = [0; 3].map(|_| vec![0.0_f32; width]);
                for (y, any) in any.iter_mut().enumerate().take(part.y1).skip(part.y0) {
                    let row = &mut rows[0][part.x0..part.x1];
                    measure_bends(surface, part, per_px, y, row);
                    *any = row.iter().fold(false, |any, bend| any | (*bend > MIN_BEND));
                }
                if !any.contains(&true) {
                    return;
                }
                rows[0].fill(0.0);
                // The largest of three rows, then of three columns of the result.
                let (mut tallest, mut weights) = (vec![0.0_f32; width + 2], vec![0.0_f32; width]);
                for y in part.y0..part.y1 {
                    let (before, after) = (y.saturating_sub(1), (y + 1).min(height - 1));
                    if !(any[before] | any[y] | any[after]) {
                        ends.push(pixels.len());
                        continue;
                    }
                    for (row, y) in rows.iter_mut().zip([before, y, after]) {
                        match (part.y0..part.y1).contains(&y) {
                            true => measure_bends(surface, part, per_px, y, &mut row[part.x0..part.x1]),
                            false => row.fill(0.0),
                        }
                    }
                    let [before, here, after] = &rows;
                    let rows = before.iter().zip(here).zip(after);
                    for (tallest, ((before, here), after)) in tallest[1..].iter_mut().zip(rows) {
                        *tallest = before.max(*here).max(*after);
                    }
                    for (x, weight) in weights.iter_mut().enumerate() {
                        let most = tallest[x].max(tallest[x + 1]).max(tallest[x + 2]);
                        *weight = ((most - MIN_BEND) / MIN_BEND).clamp(0.0, 1.0);
                    }
                    let counts = weights.iter().enumerate().filter(|(_, weight)| **weight > 0.0);
                    pixels.extend(counts.map(|(x, weight)| (x as u32, *weight)));
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

    /// Returns the positions, in the region with its border, that are sampled: the pixels and their neighbours.
    fn sampled_positions(&self) -> Vec<[u32; 2]> {
        // In these coordinates, the neighbours of a pixel reach from its own position to twice the border beyond it.
        let [width, height] = [self.region.width(), self.region.height()];
        let (wide, reach) = (width + 2 * SURFACE_BORDER, 2 * SURFACE_BORDER);
        let mut places = Vec::new();
        let mut counts = vec![false; wide];
        for y in 0..height + 2 * SURFACE_BORDER {
            counts.fill(false);
            for row in y.saturating_sub(reach)..(y + 1).min(height) {
                self.row(row).iter().for_each(|(x, _)| counts[*x as usize..][..=reach].fill(true));
            }
            let counted = counts.iter().enumerate().filter(|(_, counts)| **counts);
            places.extend(counted.map(|(x, _)| [x as u32, y as u32]));
        }
        places
    }

    /// Combines the weights with the surface's heights at the sampled positions.
    fn into_subpixel(self, sampled: &SampleLayout, heights_mm: Vec<[f32; SAMPLES]>, view: &View) -> Subpixel {
        let mut pixels = Vec::with_capacity(self.pixels.len());
        for y in 0..self.region.height() {
            let numbers = |x: u32| [0, 1, 2].map(|dy| sampled.pixel_number(x as usize + 1, y + dy));
            let in_view = |(x, weight): &(u32, f32)| SampledPixel {
                x: self.region.x0 as u32 + x,
                weight: *weight,
                numbers: numbers(*x),
            };
            pixels.extend(self.row(y).iter().map(in_view));
        }
        let slope_per_mm = view.mm_per_px.map(|mm| (0.5 / mm) as f32);
        Subpixel { region: self.region, pixels, rows: self.rows, heights_mm, slope_per_mm }
    }
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
        *bend = if along_y > along_x { along_y } else { along_x };
    }
}

/// For each sample, on which side of the pixel its nearest neighbour lies, along the row and down: 0 before, 2 after.
const COLUMN_SIDES: [usize; SAMPLES] = sample_sides(0);
const ROW_SIDES: [usize; SAMPLES] = sample_sides(1);
/// Distance of each sample from the centre, along the row and down, as a share of the distance between pixels.
const OFFSET_SHARES: [[f32; SAMPLES]; 2] = [offset_shares(0), offset_shares(1)];

const fn sample_sides(k: usize) -> [usize; SAMPLES] {
    let mut side = [0; SAMPLES];
    let mut at = 0;
    while at < SAMPLES {
        side[at] = if SAMPLE_OFFSETS[at][k] < 0.0 { 0 } else { 2 };
        at += 1;
    }
    side
}

const fn offset_shares(k: usize) -> [f32; SAMPLES] {
    let mut away = [0.0; SAMPLES];
    let mut at = 0;
    while at < SAMPLES {
        away[at] = SAMPLE_OFFSETS[at][k].abs() as f32;
        at += 1;
    }
    away
}

impl SubpixelInput<'_> {
    /// Replaces the object's heights over the pad at the offsets of each position by the heights of the surface.
    /// `centres` has the object's heights at the pixel centres, if the depth map differs from them.
    #[inline(always)]
    fn interpolate_surface(
        &self,
        region: Rect,
        places: &[[u32; 2]],
        heights: &mut [[f32; SAMPLES]],
        centres: Option<&Grid<f32>>,
    ) {
        let Self { depth, contact, .. } = self;
        let surface = &contact.surface;
        // Offset from the grid of the surface to that of the depth map.
        let margin = depth.margin_px - SURFACE_BORDER;
        let around = |at: usize, size: usize| [at.saturating_sub(1), at, (at + 1).min(size - 1)];
        let per_step = 1.0 / (STEP_SLOPE * self.view.mm_per_px[0].max(self.view.mm_per_px[1]) as f32);
        for (place, heights) in places.iter().zip(heights) {
            let [x, y] = place.map(|at| at as usize);
            let [columns, rows] = [around(x + region.x0, surface.width), around(y + region.y0, surface.height)];
            // Heights of the pad's surface and of the object at the pixel and its eight neighbours.
            let (mut pads, mut objects) = ([[0.0; 3]; 3], [[0.0; 3]; 3]);
            for (row, y) in rows.into_iter().enumerate() {
                let (pad, object) = (surface.row(y), depth.penetration.row(y + margin));
                for (column, x) in columns.into_iter().enumerate() {
                    (pads[row][column], objects[row][column]) = (pad[x], object[x + margin]);
                }
            }
            // Texture and curvature are taken from the centre.
            let retouch = centres.map_or(0.0, |centres| objects[1][1] + centres.at(x, y));
            let penetration = heights.map(|height| retouch - height);
            let (mut all, mut joined, mut weights) = ([0.0; SAMPLES], [0.0; SAMPLES], [0.0; SAMPLES]);
            for beside in [[false, false], [true, false], [false, true], [true, true]] {
                let at = |k: usize, side: [usize; SAMPLES], sample: usize| if beside[k] { side[sample] } else { 1 };
                let (mut w, mut g) = ([0.0; SAMPLES], [0.0; SAMPLES]);
                for sample in 0..SAMPLES {
                    let (row, column) = (at(1, ROW_SIDES, sample), at(0, COLUMN_SIDES, sample));
                    (w[sample], g[sample]) = (pads[row][column], objects[row][column]);
                }
                for sample in 0..SAMPLES {
                    let share =
                        |k: usize| if beside[k] { OFFSET_SHARES[k][sample] } else { 1.0 - OFFSET_SHARES[k][sample] };
                    let weight = share(0) * share(1);
                    let (w, g) = (w[sample], g[sample]);
                    all[sample] += weight * w;
                    // A pixel counts if it is off the object, or if the object has no step between it and the sample.
                    let off = (w - g) * (1.0 / CLEAR_GAP_MM);
                    let level = 2.0 - (g - penetration[sample]).abs() * per_step;
                    let most = if off > level { off } else { level };
                    let weight = weight * most.clamp(0.0, 1.0);
                    joined[sample] += weight * w;
                    weights[sample] += weight;
                }
            }
            for sample in 0..SAMPLES {
                let pad = (joined[sample] + PLAIN_WEIGHT * all[sample]) / (weights[sample] + PLAIN_WEIGHT);
                heights[sample] = if penetration[sample] > pad { penetration[sample] } else { pad };
            }
        }
    }
}
