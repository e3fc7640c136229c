//! The surface between pixel centres, where it bends so much within a pixel that the light of the centre is not the
//! pixel's: at walls and edges, which would else be drawn as saw-teeth.
//!
//! A pixel there is sampled at [`OFFSETS`]. At each the object is captured anew; the pad's own surface is interpolated
//! between pixels, but not across a wall: from those that are off the object, and from those on it that its surface joins
//! without a step. The optics average the light over the samples (not the heights, which would round the wall off), with a
//! weight that grows from 0 to 1 while the slope changes by one to two [`BEND`]s from pixel to pixel.

use crate::base::grid::{Grid, Rect};
use crate::base::simd::simd_dispatch;
use crate::base::view::{SURFACE_BORDER, View};
use crate::depth::indenter::{Indenter, Shape};
use crate::depth::raster::{SAMPLES, Sampled};
use crate::depth::{self, Depth, Window};
use crate::effects::{Effect, EffectLog, Requirement};
use crate::gelpad::{Contact, Pad};

/// Change of the slope from one pixel to the next that is not sampled yet.
pub const BEND: f32 = 0.2;

/// Samples of a pixel, px from its centre: eight points that are the same in a mirror and after a quarter turn.
pub const OFFSETS: [[f64; 2]; SAMPLES] = [
    [0.375, 0.125],
    [-0.375, 0.125],
    [0.375, -0.125],
    [-0.375, -0.125],
    [0.125, 0.375],
    [-0.125, 0.375],
    [0.125, -0.375],
    [-0.125, -0.375],
];

/// Slope of the object's surface between two points from which on they join less; at twice as much there is a step.
const STEP: f32 = 2.0;

/// Gap over which a pixel is wholly off the object, mm.
const CLEAR_MM: f32 = 0.01;

/// Share of plain interpolation, for points that no pixel joins.
const LEAST: f32 = 1e-3;

/// Samples of a surface between pixel centres.
#[derive(Clone, Debug)]
pub struct Subpixel {
    /// The part of the view that holds all pixels that are sampled.
    pub region: Rect,
    /// Those pixels, row by row.
    pixels: Vec<SampledPixel>,
    /// Where each of the region's rows begins among them, and the last one ends.
    rows: Vec<usize>,
    /// The surface, mm, at each offset of them and of the pixels beside them, row by row.
    heights_mm: Vec<[f32; SAMPLES]>,
    /// From the difference of a pixel's neighbours, mm, to the slope, along the row and down.
    per_fall: [f32; 2],
}

/// A pixel that is sampled.
#[derive(Clone, Copy, Debug)]
pub struct SampledPixel {
    /// Column of the view.
    pub x: u32,
    /// Weight of the samples against the centre, over 0 to 1.
    pub weight: f32,
    /// The numbers of the pixel above, of this one and of the one below among the heights. Those beside it along the row come
    /// before and after it.
    numbers: [u32; 3],
}

impl Subpixel {
    /// The sampled pixels of row `y` of the view.
    pub fn row(&self, y: usize) -> &[SampledPixel] {
        match (self.region.y0..self.region.y1).contains(&y) {
            true => &self.pixels[self.rows[y - self.region.y0]..self.rows[y - self.region.y0 + 1]],
            false => &[],
        }
    }

    /// The surface at each offset of a pixel, mm.
    #[inline(always)]
    pub(crate) fn heights_mm(&self, pixel: &SampledPixel) -> [f32; SAMPLES] {
        self.heights_mm[pixel.numbers[1] as usize]
    }

    /// Its fall there, along the row and down.
    #[inline(always)]
    pub(crate) fn falls(&self, pixel: &SampledPixel) -> [[f32; SAMPLES]; 2] {
        let [above, here, below] = pixel.numbers.map(|number| number as usize);
        let [per_x, per_y] = self.per_fall;
        let fall = |before: usize, after: usize, per_fall: f32| {
            let (before, after) = (&self.heights_mm[before], &self.heights_mm[after]);
            std::array::from_fn(|sample| (before[sample] - after[sample]) * per_fall)
        };
        [fall(here - 1, here + 1, per_x), fall(above, below, per_y)]
    }

    /// The fall of a relief under a pixel in row `y` of the view, on the grid of [`Contact::surface`], and its height, mm.
    pub(crate) fn of_relief(&self, pixel: &SampledPixel, y: usize, relief: &Grid<f32>) -> ([f32; 2], f32) {
        let [x, y] = [pixel.x as usize, y].map(|at| at + SURFACE_BORDER);
        let fall_x = (relief.at(x - 1, y) - relief.at(x + 1, y)) * self.per_fall[0];
        let fall_y = (relief.at(x, y - 1) - relief.at(x, y + 1)) * self.per_fall[1];
        ([fall_x, fall_y], relief.at(x, y))
    }
}

/// What the pad under an indenter is sampled from.
pub struct Scene<'a> {
    /// The model of the gelpad.
    pub pad: &'a Pad,
    /// What is pressed.
    pub indenter: &'a Indenter,
    /// How much of it was captured.
    pub window: Window,
    /// The depth map.
    pub depth: &'a Depth,
    /// It is not of the object alone, but with texture or on a curved pad.
    pub retouched: bool,
    /// The pad under it.
    pub contact: &'a Contact,
    /// The view.
    pub view: &'a View,
    /// The optics average light over a pixel.
    pub averages: bool,
}

/// Samples the pad where it bends too much within a pixel.
pub fn sample(scene: &Scene<'_>, effects: &mut EffectLog) -> Option<Subpixel> {
    let Scene { pad, indenter, window, retouched, contact, view, averages, .. } = *scene;
    let absent = match (&indenter.shape, pad) {
        _ if !averages => Some("measured light is that of pixel centres"),
        (Shape::HeightMap(_), _) => Some("a height map has nothing between its pixels"),
        (Shape::Seen(_), _) => Some("a depth frame has nothing between its pixels"),
        (_, Pad::MeanBlur(_) | Pad::Gaussian(_)) => Some("the gelpad model blurs every edge"),
        (Shape::Mesh(_), Pad::None | Pad::Elastic(_)) => None,
    };
    let weights = match absent {
        None if !contact.region.is_empty() => effects.timed(Effect::Supersampling, || Weights::new(contact, view)),
        _ => Weights::default(),
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
        effects.timed(Effect::Supersampling, || {
            let places = weights.places();
            let size = [region.width(), region.height()].map(|px| px + 2 * SURFACE_BORDER);
            let sampled = Sampled::new(&places, size, &OFFSETS);
            let pose = &indenter.pose;
            let there = depth::capture_samples(object, pose, view, region, &sampled, window);
            let centres = retouched.then(|| depth::capture_part(object, pose, view, region, window));
            let mut heights = there;
            simd_dispatch(
                #[inline(always)]
                || scene.surfaces(region, &places, &mut heights, centres.as_ref()),
            );
            weights.sampled(&sampled, heights, view)
        })
    })
}

/// How much the samples count at the pixels where they do: by the largest bend there or beside it.
#[derive(Default)]
struct Weights {
    /// The part of the view that holds all of these pixels.
    region: Rect,
    /// Column in the region and weight of each, row by row.
    pixels: Vec<(u32, f32)>,
    /// Where each of the region's rows begins among them, and the last one ends.
    rows: Vec<usize>,
}

impl Weights {
    fn new(contact: &Contact, view: &View) -> Self {
        let [width, height] = view.resolution_px;
        let surface = &contact.surface;
        let per_px = view.mm_per_px.map(|pitch| (1.0 / pitch) as f32);
        let part = contact.region.grown(1, surface.width, surface.height);
        let part = part.seen_from(SURFACE_BORDER, SURFACE_BORDER, width, height);
        let mut any = vec![false; height];
        let (mut pixels, mut ends) = (Vec::new(), Vec::new());
        simd_dispatch(
            #[inline(always)]
            || {
                let mut rows = [0; 3].map(|_| vec![0.0_f32; width]);
                for (y, any) in any.iter_mut().enumerate().take(part.y1).skip(part.y0) {
                    let row = &mut rows[0][part.x0..part.x1];
                    bends(surface, part, per_px, y, row);
                    *any = row.iter().fold(false, |any, bend| any | (*bend > BEND));
                }
                if !any.contains(&true) {
                    return;
                }
                rows[0].fill(0.0);
                // The largest of three rows, and of three columns of that.
                let (mut tallest, mut weights) = (vec![0.0_f32; width + 2], vec![0.0_f32; width]);
                for y in part.y0..part.y1 {
                    let (before, after) = (y.saturating_sub(1), (y + 1).min(height - 1));
                    if !(any[before] | any[y] | any[after]) {
                        ends.push(pixels.len());
                        continue;
                    }
                    for (row, y) in rows.iter_mut().zip([before, y, after]) {
                        match (part.y0..part.y1).contains(&y) {
                            true => bends(surface, part, per_px, y, &mut row[part.x0..part.x1]),
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
                        *weight = ((most - BEND) / BEND).clamp(0.0, 1.0);
                    }
                    let counts = weights.iter().enumerate().filter(|(_, weight)| **weight > 0.0);
                    pixels.extend(counts.map(|(x, weight)| (x as u32, *weight)));
                    ends.push(pixels.len());
                }
            },
        );
        Self::within(part, pixels, &ends)
    }

    /// Of pixels with columns of the view, in rows of a part of it that end so.
    fn within(part: Rect, mut pixels: Vec<(u32, f32)>, ends: &[usize]) -> Self {
        let columns = pixels.iter().map(|(x, _)| *x);
        let Some((x0, x1)) = columns.clone().min().zip(columns.max()) else { return Self::default() };
        pixels.iter_mut().for_each(|(x, _)| *x -= x0);
        // Rows before the first pixel end at 0, those from the last one on where all do.
        let first = ends.partition_point(|end| *end == 0);
        let last = ends.partition_point(|end| *end < pixels.len());
        let rows = std::iter::once(0).chain(ends[first..=last].iter().copied()).collect();
        let region = Rect { x0: x0 as usize, y0: part.y0 + first, x1: x1 as usize + 1, y1: part.y0 + last + 1 };
        Self { region, pixels, rows }
    }

    /// Those of a row of the region.
    fn row(&self, y: usize) -> &[(u32, f32)] {
        &self.pixels[self.rows[y]..self.rows[y + 1]]
    }

    /// The pixels of the region with its border that are sampled, or beside one that is.
    fn places(&self) -> Vec<[u32; 2]> {
        // What is sampled of a pixel's three rows and columns lies at its own place, and up to twice the border before it.
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

    /// The surface's heights at these places.
    fn sampled(self, sampled: &Sampled, heights_mm: Vec<[f32; SAMPLES]>, view: &View) -> Subpixel {
        let mut pixels = Vec::with_capacity(self.pixels.len());
        for y in 0..self.region.height() {
            let numbers = |x: u32| [0, 1, 2].map(|dy| sampled.number(x as usize + 1, y + dy));
            let in_view = |(x, weight): &(u32, f32)| SampledPixel {
                x: self.region.x0 as u32 + x,
                weight: *weight,
                numbers: numbers(*x),
            };
            pixels.extend(self.row(y).iter().map(in_view));
        }
        let per_fall = view.mm_per_px.map(|pitch| (0.5 / pitch) as f32);
        Subpixel { region: self.region, pixels, rows: self.rows, heights_mm, per_fall }
    }
}

/// By how much the surface bends at the pixels of a row of a part of the view.
#[inline(always)]
fn bends(surface: &Grid<f32>, part: Rect, per_px: [f32; 2], y: usize, bends: &mut [f32]) {
    let window = |dx: usize, dy: usize| &surface.row(y + dy)[part.x0 + dx..][..bends.len()];
    let (left, here, right, above, below) = (window(0, 1), window(1, 1), window(2, 1), window(1, 0), window(1, 2));
    for (x, bend) in bends.iter_mut().enumerate() {
        let twice = 2.0 * here[x];
        let along_x = (left[x] + right[x] - twice).abs() * per_px[0];
        let along_y = (above[x] + below[x] - twice).abs() * per_px[1];
        *bend = if along_y > along_x { along_y } else { along_x };
    }
}

/// Of the pixels around one, that which lies on the side of each sample along the row, and down: the first or the last.
const ACROSS: [usize; SAMPLES] = side(0);
const DOWN: [usize; SAMPLES] = side(1);
/// How far each sample is from the centre along the row, and down, as a share of the way to the next pixel.
const AWAY: [[f32; SAMPLES]; 2] = [away(0), away(1)];

const fn side(k: usize) -> [usize; SAMPLES] {
    let mut side = [0; SAMPLES];
    let mut at = 0;
    while at < SAMPLES {
        side[at] = if OFFSETS[at][k] < 0.0 { 0 } else { 2 };
        at += 1;
    }
    side
}

const fn away(k: usize) -> [f32; SAMPLES] {
    let mut away = [0.0; SAMPLES];
    let mut at = 0;
    while at < SAMPLES {
        away[at] = OFFSETS[at][k].abs() as f32;
        at += 1;
    }
    away
}

impl Scene<'_> {
    /// From the object's height over the pad at the offsets of each place to the surface there: `centres` are those heights
    /// at the centres themselves, if that is other than in the depth map.
    #[inline(always)]
    fn surfaces(&self, region: Rect, places: &[[u32; 2]], heights: &mut [[f32; SAMPLES]], centres: Option<&Grid<f32>>) {
        let Self { depth, contact, .. } = self;
        let surface = &contact.surface;
        // From the grid of the region to that of the surface, and on to that of the depth map.
        let margin = depth.margin_px - SURFACE_BORDER;
        let around = |at: usize, size: usize| [at.saturating_sub(1), at, (at + 1).min(size - 1)];
        let per_step = 1.0 / (STEP * self.view.mm_per_px[0].max(self.view.mm_per_px[1]) as f32);
        for (place, heights) in places.iter().zip(heights) {
            let [x, y] = place.map(|at| at as usize);
            let [columns, rows] = [around(x + region.x0, surface.width), around(y + region.y0, surface.height)];
            // Of the pixel and those around it: the pad's surface, and the object's.
            let (mut pads, mut objects) = ([[0.0; 3]; 3], [[0.0; 3]; 3]);
            for (row, y) in rows.into_iter().enumerate() {
                let (pad, object) = (surface.row(y), depth.penetration.row(y + margin));
                for (column, x) in columns.into_iter().enumerate() {
                    (pads[row][column], objects[row][column]) = (pad[x], object[x + margin]);
                }
            }
            // Texture and curvature are those of the centre.
            let retouch = centres.map_or(0.0, |centres| objects[1][1] + centres.at(x, y));
            let penetration = heights.map(|height| retouch - height);
            let (mut all, mut joined, mut weights) = ([0.0; SAMPLES], [0.0; SAMPLES], [0.0; SAMPLES]);
            for beside in [[false, false], [true, false], [false, true], [true, true]] {
                let at = |k: usize, side: [usize; SAMPLES], sample: usize| if beside[k] { side[sample] } else { 1 };
                let (mut w, mut g) = ([0.0; SAMPLES], [0.0; SAMPLES]);
                for sample in 0..SAMPLES {
                    let (row, column) = (at(1, DOWN, sample), at(0, ACROSS, sample));
                    (w[sample], g[sample]) = (pads[row][column], objects[row][column]);
                }
                for sample in 0..SAMPLES {
                    let share = |k: usize| if beside[k] { AWAY[k][sample] } else { 1.0 - AWAY[k][sample] };
                    let weight = share(0) * share(1);
                    let (w, g) = (w[sample], g[sample]);
                    all[sample] += weight * w;
                    let off = (w - g) * (1.0 / CLEAR_MM);
                    let level = 2.0 - (g - penetration[sample]).abs() * per_step;
                    let most = if off > level { off } else { level };
                    let weight = weight * most.clamp(0.0, 1.0);
                    joined[sample] += weight * w;
                    weights[sample] += weight;
                }
            }
            for sample in 0..SAMPLES {
                let pad = (joined[sample] + LEAST * all[sample]) / (weights[sample] + LEAST);
                heights[sample] = if penetration[sample] > pad { penetration[sample] } else { pad };
            }
        }
    }
}
