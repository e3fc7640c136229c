//! The surface between pixel centres, where it bends so much within a pixel that the light of the centre is not the
//! pixel's: at walls and edges, which would else be drawn as saw-teeth.
//!
//! A pixel there is sampled at [`OFFSETS`]. At each the object is captured anew; the pad's own surface is interpolated
//! between pixels, but not across a wall: from those that are off the object, and from those on it that its surface joins
//! without a step. The optics average the light over the samples (not the heights, which would round the wall off), with a
//! weight that grows from 0 to 1 while the slope changes by one to two [`BEND`]s from pixel to pixel.

use std::ops::Range;

use crate::core::base::grid::{Grid, Rect, bounding_box};
use crate::core::base::simd::simd_dispatch;
use crate::core::base::view::{SURFACE_BORDER, View};
use crate::core::depth::indenter::{Indenter, Shape};
use crate::core::depth::raster::{SAMPLES, Sampled};
use crate::core::depth::{self, Depth, Window};
use crate::core::effects::{Effect, EffectLog, Requirement};
use crate::core::gelpad::{Contact, Pad};

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
    /// Weight of the samples against the centre, 0 to 1, in the region.
    pub weight: Grid<f32>,
    /// The surface at each offset, mm, in the region and [`SURFACE_BORDER`] around it; known where a pixel is sampled, and
    /// beside it, 0 elsewhere.
    pub surfaces: Vec<Grid<f32>>,
}

impl Subpixel {
    /// The weights along row `y` of the view within `part` of it, and in which of the part's columns; `None` if nothing is
    /// sampled there.
    pub fn row(&self, part: Rect, y: usize) -> Option<(Range<usize>, &[f32])> {
        let Rect { x0, y0, x1, y1 } = self.region;
        let (from, to) = (x0.max(part.x0), x1.min(part.x1));
        let inside = (y0..y1).contains(&y) && from < to;
        inside.then(|| (from - part.x0..to - part.x0, &self.weight.row(y - y0)[from - x0..to - x0]))
    }

    /// The same over a relief of the pad at rest, on the grid of [`Contact::surface`].
    pub fn over(&self, relief: &Grid<f32>) -> Self {
        let mut over = self.clone();
        let Rect { x0, y0, .. } = self.region;
        for surface in &mut over.surfaces {
            for y in 0..surface.height {
                let row = &relief.row(y0 + y)[x0..];
                surface.row_mut(y).iter_mut().zip(row).for_each(|(w, relief)| *w += relief);
            }
        }
        over
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
        (_, Pad::MeanBlur(_) | Pad::Gaussian(_)) => Some("the gelpad model blurs every edge"),
        (Shape::Mesh(_), Pad::None | Pad::Elastic(_)) => None,
    };
    let weight = match absent {
        None if !contact.region.is_empty() => effects.timed(Effect::Supersampling, || weights(contact, view)),
        _ => Grid::default(),
    };
    let region = bounding_box(&weight, |weight| weight > 0.0);
    let need = match absent {
        Some(why) => Requirement::Absent(why),
        None if region.is_empty() => Requirement::Unneeded("the surface bends little from pixel to pixel"),
        None => Requirement::Needed("the surface bends within pixels"),
    };
    let runs = effects.enable(Effect::Supersampling, need) && !region.is_empty();
    let Shape::Mesh(object) = &indenter.shape else { return None };
    runs.then(|| {
        effects.timed(Effect::Supersampling, || {
            let weight = weight.crop(region);
            let places = places(&weight);
            let size = [region.width(), region.height()].map(|px| px + 2 * SURFACE_BORDER);
            let sampled = Sampled::new(&places, size, &OFFSETS);
            let pose = &indenter.pose;
            let there = depth::capture_samples(object, pose, view, region, &sampled, window);
            let centres = retouched.then(|| depth::capture_part(object, pose, view, region, window));
            let surfaces = scene.surfaces(region, &places, &there, centres.as_ref());
            Subpixel { region, surfaces, weight }
        })
    })
}

/// How much the samples count at each pixel of the view: by the largest bend there or beside it.
fn weights(contact: &Contact, view: &View) -> Grid<f32> {
    let [width, height] = view.resolution_px;
    let surface = &contact.surface;
    let per_px = view.mm_per_px.map(|pitch| (1.0 / pitch) as f32);
    let mut bends: Grid<f32> = Grid::new(width, height);
    let part =
        contact.region.grown(1, surface.width, surface.height).seen_from(SURFACE_BORDER, SURFACE_BORDER, width, height);
    let mut any = vec![false; height];
    let mut weight = Grid::new(width, height);
    simd_dispatch(
        #[inline(always)]
        || {
            for (y, any) in any.iter_mut().enumerate().take(part.y1).skip(part.y0) {
                let row = |dy: usize| &surface.row(y + dy)[part.x0..part.x1 + 2 * SURFACE_BORDER];
                let (above, here, below) = (row(0), row(1), row(2));
                let row = &mut bends.row_mut(y)[part.x0..part.x1];
                let mut most = 0.0_f32;
                for (x, bend) in row.iter_mut().enumerate() {
                    let twice = 2.0 * here[x + 1];
                    let along_x = (here[x] + here[x + 2] - twice).abs() * per_px[0];
                    let along_y = (above[x + 1] + below[x + 1] - twice).abs() * per_px[1];
                    *bend = along_x.max(along_y);
                    most = if *bend > most { *bend } else { most };
                }
                *any = most > BEND;
            }
            // The largest of three rows, and of three columns of that.
            let mut tallest = vec![0.0_f32; width + 2];
            for y in part.y0..part.y1 {
                let (before, after) = (y.saturating_sub(1), (y + 1).min(height - 1));
                if !(any[before] | any[y] | any[after]) {
                    continue;
                }
                let rows = bends.row(before).iter().zip(bends.row(y)).zip(bends.row(after));
                for (tallest, ((before, here), after)) in tallest[1..].iter_mut().zip(rows) {
                    *tallest = before.max(*here).max(*after);
                }
                for (x, weight) in weight.row_mut(y).iter_mut().enumerate() {
                    let most = tallest[x].max(tallest[x + 1]).max(tallest[x + 2]);
                    *weight = ((most - BEND) / BEND).clamp(0.0, 1.0);
                }
            }
        },
    );
    weight
}

impl Scene<'_> {
    /// The surface at each offset from the pixels' centres: `there` is the object's height over the pad at the offsets of
    /// each place, `centres` at the centres themselves if it is other than in the depth map.
    fn surfaces(
        &self,
        region: Rect,
        places: &[[usize; 2]],
        there: &[[f32; SAMPLES]],
        centres: Option<&Grid<f32>>,
    ) -> Vec<Grid<f32>> {
        let Self { depth, contact, .. } = self;
        let surface = &contact.surface;
        // From the grid of the region to that of the surface, and on to that of the depth map.
        let margin = depth.margin_px - SURFACE_BORDER;
        let object = |x: usize, y: usize| depth.overlap.at(x + margin, y + margin);
        let around = |at: usize, size: usize| [at.saturating_sub(1), at, (at + 1).min(size - 1)];
        let step_mm = STEP * self.view.mm_per_px[0].max(self.view.mm_per_px[1]) as f32;
        let [width, height] = [region.width(), region.height()].map(|px| px + 2 * SURFACE_BORDER);
        // Each on its own: most of a grid's memory is never touched, and copies of one would be.
        let mut surfaces: Vec<Grid<f32>> = (0..SAMPLES).map(|_| Grid::new(width, height)).collect();
        for ([x, y], there) in places.iter().copied().zip(there) {
            let [columns, rows] = [around(x + region.x0, surface.width), around(y + region.y0, surface.height)];
            // Of the pixel and those around it: the pad's surface, and the object's.
            let pads = rows.map(|y| columns.map(|x| surface.at(x, y)));
            let objects = rows.map(|y| columns.map(|x| object(x, y)));
            // Texture and curvature are those of the centre.
            let retouch = centres.map_or(0.0, |centres| objects[1][1] + centres.at(x, y));
            for ((offset, there), surface) in OFFSETS.iter().zip(there).zip(&mut surfaces) {
                let overlap = retouch - there;
                let [u, v] = offset.map(|offset| offset.abs() as f32);
                let [across, down] = offset.map(|offset| if offset < 0.0 { 0 } else { 2 });
                let corners = [
                    ([1, 1], (1.0 - u) * (1.0 - v)),
                    ([across, 1], u * (1.0 - v)),
                    ([1, down], (1.0 - u) * v),
                    ([across, down], u * v),
                ];
                let (mut all, mut joined, mut weights) = (0.0, 0.0, 0.0);
                for ([x, y], weight) in corners {
                    let (w, g) = (pads[y][x], objects[y][x]);
                    all += weight * w;
                    let off = (w - g) / CLEAR_MM;
                    let level = 2.0 - (g - overlap).abs() / step_mm;
                    let weight = weight * off.max(level).clamp(0.0, 1.0);
                    joined += weight * w;
                    weights += weight;
                }
                let pad = (joined + LEAST * all) / (weights + LEAST);
                surface.row_mut(y)[x] = pad.max(overlap);
            }
        }
        surfaces
    }
}

/// The pixels of the region with its border that are sampled, or beside one that is.
fn places(weight: &Grid<f32>) -> Vec<[usize; 2]> {
    // What is sampled of a pixel's three rows and columns lies at its own place, and up to twice the border before it.
    let (wide, reach) = (weight.width + 2 * SURFACE_BORDER, 2 * SURFACE_BORDER);
    let mut places = Vec::new();
    let (mut of_rows, mut counts) = (vec![false; wide], vec![false; wide]);
    for y in 0..weight.height + 2 * SURFACE_BORDER {
        of_rows.fill(false);
        for row in y.saturating_sub(reach)..(y + 1).min(weight.height) {
            let row = weight.row(row);
            of_rows.iter_mut().zip(row).for_each(|(sampled, weight)| *sampled |= *weight > 0.0);
        }
        counts.copy_from_slice(&of_rows);
        for shift in 1..=reach {
            counts[shift..].iter_mut().zip(&of_rows).for_each(|(counts, sampled)| *counts |= *sampled);
        }
        places.extend(counts.iter().enumerate().filter(|(_, counts)| **counts).map(|(x, _)| [x, y]));
    }
    places
}
