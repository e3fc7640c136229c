//! From object to depth map: how far the object reaches below the undeformed pad, at every pixel centre.
//!
//! Orthographic and exact: the value at a pixel is the lowest point of the object's triangles on the line through the
//! pixel's centre. Rays would give the same (they are the oracle in the tests); rasterising the triangles that a
//! bounding-volume query finds above the window is 8 to 25 times quicker and leaves no hole.

use crate::base::grid::{Grid, Rect, bounding_box};
use crate::base::simd::{largest, simd_dispatch};
use crate::base::view::{SURFACE_BORDER, View};
use crate::effects::{Effect, EffectLog, Requirement};
use crate::mesh::clusters::Clusters;
use crate::pose::{Placement, Pose};

pub mod beyond;
mod blocks;
pub mod height_map;
pub mod indenter;
pub mod lines;
pub mod normals;
pub mod outline;
pub mod patterns;
pub mod places;
pub mod raster;
pub mod relief;
pub mod rest;
pub mod seen;
pub mod texture;
pub mod touch;

use height_map::HeightMap;
use indenter::{Indenter, Shape};
use raster::{Canvas, Projection, SAMPLES, Sampled};
use texture::{Texture, TexturePlacement};

/// The depth map of a press.
#[derive(Clone, Debug)]
pub struct Depth {
    /// mm below the undeformed pad surface, in the view and a margin around it. Where the object stays above, minus its
    /// height over the pad, but no less than minus [`Window::above_mm`]; that also where there is no object.
    pub penetration: Grid<f32>,
    /// Pixels around the view on every side.
    pub margin_px: usize,
    /// The smallest rectangle around all overlap, in `penetration`; empty if the object does not reach the pad.
    pub touching: Rect,
    /// The largest overlap in view, mm.
    pub deepest_mm: f32,
    /// Pixels in view where the object would go through the shell and was limited to the pad's thickness.
    pub over_thickness_px: u64,
}

/// What of an object a model of the gelpad has to know.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Window {
    /// Pixels around the view on every side.
    pub margin_px: usize,
    /// Height over the undeformed pad up to which the object counts, mm.
    pub above_mm: f64,
}

impl Depth {
    /// That of an object which stays above the pad.
    pub fn clear(view: &View) -> Self {
        let [width, height] = view.resolution_px;
        let penetration = Grid::new(width, height);
        Self { penetration, margin_px: 0, touching: Rect::default(), deepest_mm: 0.0, over_thickness_px: 0 }
    }

    /// Finds the touching rectangle and the largest overlap anew, after the overlap was changed.
    pub fn measure(&mut self) {
        self.touching = bounding_box(&self.penetration, |mm| mm > 0.0);
        let view =
            Rect::whole(self.penetration.width - 2 * self.margin_px, self.penetration.height - 2 * self.margin_px);
        self.deepest_mm = simd_dispatch(
            #[inline(always)]
            || {
                let row = |y| &self.penetration.row(y + self.margin_px)[self.margin_px..][..view.width()];
                (0..view.height()).fold(0.0, |deepest: f32, y| deepest.max(largest(row(y).iter().copied())))
            },
        );
    }

    /// How far the object reaches below the undeformed pad, mm, in the view: 0 where it does not.
    pub fn below_pad(&self) -> Grid<f32> {
        let [width, height] = [self.penetration.width, self.penetration.height].map(|px| px - 2 * self.margin_px);
        let mut data = Vec::with_capacity(width * height);
        for y in 0..height {
            let row = &self.penetration.row(y + self.margin_px)[self.margin_px..][..width];
            data.extend(row.iter().map(|mm| mm.max(0.0)));
        }
        Grid { width, height, data }
    }
}

/// The overlap of what is pressed with the undeformed pad: captured or given, its texture cut in, the pad's curvature
/// taken off. `drop_mm` is how far a curved pad lies below its highest point ([`rest::drop_mm`]).
pub fn penetration(
    indenter: &Indenter,
    texture: Option<&Texture>,
    drop_mm: Option<&Grid<f32>>,
    thickness_mm: f64,
    view: &View,
    window: Window,
    effects: &mut EffectLog,
) -> Depth {
    // Its lowest point is known: an object above the pad need not be looked at.
    let mut depth = match indenter.depth_mm > 0.0 || effects.everywhere() {
        true => captured(indenter, view, window, thickness_mm),
        false => Depth::clear(view),
    };

    effects.run(Effect::Texture, texture_required(texture, &depth), || {
        if let Some(Texture { relief, sample, laid }) = texture {
            let TexturePlacement { origin_mm, yaw_deg } =
                laid.unwrap_or_else(|| TexturePlacement::with(&indenter.pose));
            relief.cut(sample, origin_mm, yaw_deg, view, window.above_mm, &mut depth);
        }
    });

    let need = match drop_mm {
        None => Requirement::Absent("the pad is flat"),
        Some(_) => if_touching(&depth, "the pad is curved under the object"),
    };
    effects.run(Effect::RestShape, need, || {
        if let Some(drop_mm) = drop_mm {
            rest::lower(&mut depth, drop_mm, window.above_mm);
        }
    });
    depth
}

/// Whether a texture is to be cut into what was captured.
pub fn texture_required(texture: Option<&Texture>, depth: &Depth) -> Requirement {
    match texture {
        None => Requirement::Absent("the job has none"),
        Some(texture) if texture.sample.amplitude_mm == 0.0 => Requirement::Unneeded("its amplitude is 0"),
        Some(_) => if_touching(depth, "a textured object reaches into the pad"),
    }
}

fn if_touching(depth: &Depth, why: &'static str) -> Requirement {
    match depth.touching.is_empty() {
        true => Requirement::Unneeded("nothing reaches into the pad"),
        false => Requirement::Needed(why),
    }
}

/// What is pressed, seen in `view`; a height map has a view of its own.
pub fn captured(indenter: &Indenter, view: &View, window: Window, thickness_mm: f64) -> Depth {
    match &indenter.shape {
        Shape::Mesh(clusters) => capture(clusters, &indenter.pose.placement(), view, window, thickness_mm),
        Shape::HeightMap(map) => framed(map, window, thickness_mm),
        Shape::Seen(seen) => capture(&seen.near_gel, &indenter.pose.placement(), view, window, thickness_mm),
    }
}

/// Captures `object` at `placement` in `window`, limited to a pad of `thickness_mm`.
pub fn capture(object: &Clusters, placement: &Placement, view: &View, window: Window, thickness_mm: f64) -> Depth {
    let [width, height] = view.resolution_px;
    let margin_px = window.margin_px;
    let canvas = Canvas {
        width: width + 2 * margin_px,
        height: height + 2 * margin_px,
        margin: margin_px,
        ceiling: window.above_mm as f32,
    };
    let projection = Projection::new(placement, view, object.centre_mm());
    let mut penetration = Grid { width: canvas.width, height: canvas.height, data: Vec::new() };
    penetration.data.resize(canvas.width * canvas.height, canvas.ceiling);
    raster::raster(object, &projection, canvas, &mut penetration);
    limited(penetration, margin_px, thickness_mm)
}

/// Height over the pad, mm, of `object` at samples of pixels in `region` of the view and [`SURFACE_BORDER`] around it; the
/// window's height where there is no object.
pub fn capture_samples(
    object: &Clusters,
    pose: &Pose,
    view: &View,
    region: Rect,
    sampled: &Sampled,
    window: Window,
) -> Vec<[f32; SAMPLES]> {
    let (canvas, projection) = part(object, pose, view, region, window);
    let mut heights = vec![[canvas.ceiling; SAMPLES]; sampled.count];
    raster::raster_samples(object, &projection, canvas, sampled, &mut heights);
    heights
}

/// The same at the pixels' centres.
pub fn capture_part(object: &Clusters, pose: &Pose, view: &View, region: Rect, window: Window) -> Grid<f32> {
    let (canvas, projection) = part(object, pose, view, region, window);
    let Canvas { width, height, ceiling, .. } = canvas;
    let mut heights = Grid { width, height, data: vec![ceiling; width * height] };
    raster::raster(object, &projection, canvas, &mut heights);
    heights
}

/// The canvas of a part of the view with [`SURFACE_BORDER`] around it, and how it is seen.
fn part(object: &Clusters, pose: &Pose, view: &View, region: Rect, window: Window) -> (Canvas, Projection) {
    let [width, height] = [region.width(), region.height()].map(|px| px + 2 * SURFACE_BORDER);
    let canvas = Canvas { width, height, margin: SURFACE_BORDER, ceiling: window.above_mm as f32 };
    let projection = Projection::new(&pose.placement(), view, object.centre_mm());
    (canvas, projection.seen_from([region.x0 as f64, region.y0 as f64]))
}

/// A height map in `window`, limited to a pad of `thickness_mm`. Around the view, where nothing is known, its border
/// goes on: what the border cuts would else end there in a wall.
fn framed(map: &HeightMap, window: Window, thickness_mm: f64) -> Depth {
    let Grid { width, height, .. } = map.above_mm;
    let margin_px = window.margin_px;
    let ceiling = window.above_mm as f32;
    let mut penetration: Grid<f32> = Grid::new(width + 2 * margin_px, height + 2 * margin_px);
    for y in 0..penetration.height {
        let from = map.above_mm.row(y.saturating_sub(margin_px).min(height - 1));
        let row = penetration.row_mut(y);
        for (to, above) in row[margin_px..].iter_mut().zip(from) {
            *to = above.min(ceiling);
        }
        let (first, last) = (row[margin_px], row[margin_px + width - 1]);
        row[..margin_px].fill(first);
        row[margin_px + width..].fill(last);
    }
    limited(penetration, margin_px, thickness_mm)
}

/// A depth map from heights over the pad, limited to a pad of `thickness_mm`.
fn limited(heights: Grid<f32>, margin_px: usize, thickness_mm: f64) -> Depth {
    let mut penetration = heights;
    let (deepest_mm, over_thickness_px) = limit(&mut penetration, margin_px, thickness_mm as f32);
    let touching = bounding_box(&penetration, |mm| mm > 0.0);
    Depth { penetration, margin_px, touching, deepest_mm, over_thickness_px }
}

/// Turns heights over the pad into depths below it, cut at the pad's thickness. The largest depth in view, and how many
/// pixels in view were cut.
fn limit(heights: &mut Grid<f32>, margin_px: usize, thickness: f32) -> (f32, u64) {
    let [width, height] = [heights.width, heights.height].map(|px| px - 2 * margin_px);
    simd_dispatch(
        #[inline(always)]
        move || {
            let (mut deepest, mut cut) = (0.0_f32, 0);
            let columns = heights.width;
            for (y, row) in heights.data.chunks_exact_mut(columns).enumerate() {
                let in_view = (margin_px..margin_px + height).contains(&y);
                if in_view {
                    let view = &row[margin_px..margin_px + width];
                    cut += u64::from(view.iter().map(|above| u32::from(-above > thickness)).sum::<u32>());
                }
                for value in row.iter_mut() {
                    *value = (0.0 - *value).min(thickness);
                }
                if in_view {
                    deepest = deepest.max(largest(row[margin_px..margin_px + width].iter().copied()));
                }
            }
            (deepest, cut)
        },
    )
}
