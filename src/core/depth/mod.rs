//! From object to depth map: how far the object reaches below the undeformed pad, at every pixel centre.
//!
//! The capture is orthographic and exact: the value at a pixel is the lowest point of the object's triangles on the
//! line through the pixel's centre. Rays would give the same values (the tests compare with them). Rasterising the
//! triangles that a bounding-volume query finds near the window is 8 to 25 times faster and leaves no holes.

use crate::base::grid::{Grid, Rect, bounding_box};
use crate::base::simd::{larger, largest_value, simd_dispatch};
use crate::base::view::{SURFACE_BORDER, View};
use crate::effects::{Effect, EffectLog, Requirement};
use crate::mesh::clusters::Clusters;
use crate::pose::{Placement, Pose};

pub mod chart_grid;
pub mod deepest_point;
pub mod height_map;
pub mod indenter;
mod node_blocks;
pub mod normal_capture;
pub mod normal_lines;
pub mod outline;
pub mod outside_window;
pub mod patterns;
pub mod raster;
pub mod relief;
pub mod rest_surface;
pub mod seen_surface;
pub mod texture;
pub mod thinness;

use height_map::HeightMap;
use indenter::{Indenter, Shape};
use raster::{Canvas, OrthographicProjection, SAMPLES, SampleLayout};
use texture::{Texture, TexturePlacement};

/// The depth map of a press.
#[derive(Clone, Debug)]
pub struct Depth {
    /// Penetration: mm below the undeformed pad surface, in the view and a margin around it. Where the object stays
    /// above, minus its height over the pad, but at least minus [`CaptureWindow::above_mm`]; the same value where there
    /// is no object.
    pub penetration: Grid<f32>,
    /// Pixels around the view on every side.
    pub margin_px: usize,
    /// The smallest rectangle around all positive penetration, in `penetration`; empty if the object does not reach the
    /// pad.
    pub touching: Rect,
    /// The largest penetration in view, mm.
    pub deepest_mm: f32,
    /// Pixels in view where the object would go through the pad and was limited to the pad's thickness.
    pub over_thickness_px: u64,
}

/// The part of an object that a gelpad model needs to know.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct CaptureWindow {
    /// Pixels around the view on every side.
    pub margin_px: usize,
    /// Height over the undeformed pad up to which the object counts, mm.
    pub above_mm: f64,
}

impl Depth {
    /// Makes the depth map of an object that stays above the pad.
    pub fn no_contact(view: &View) -> Self {
        let [width, height] = view.resolution_px;
        let penetration = Grid::new(width, height);
        Self { penetration, margin_px: 0, touching: Rect::default(), deepest_mm: 0.0, over_thickness_px: 0 }
    }

    /// Computes `touching` and `deepest_mm` again after the penetration has changed.
    pub fn measure(&mut self) {
        self.touching = bounding_box(&self.penetration, |mm| mm > 0.0);
        let view =
            Rect::whole(self.penetration.width - 2 * self.margin_px, self.penetration.height - 2 * self.margin_px);
        self.deepest_mm = simd_dispatch(
            #[inline(always)]
            || {
                let row = |y| &self.penetration.row(y + self.margin_px)[self.margin_px..][..view.width()];
                (0..view.height()).fold(0.0, |deepest: f32, y| deepest.max(largest_value(row(y).iter().copied())))
            },
        );
    }

    /// Returns the largest penetration in the view and its margin, mm; 0 without contact.
    pub(crate) fn largest_penetration_mm(&self) -> f32 {
        self.penetration.largest_in(self.touching)
    }

    /// Returns how far the object reaches below the undeformed pad, mm, in the view: 0 where it does not.
    pub fn below_pad(&self) -> Grid<f32> {
        let [width, height] = [self.penetration.width, self.penetration.height].map(|px| px - 2 * self.margin_px);
        let mut data = Vec::with_capacity(width * height);
        simd_dispatch(
            #[inline(always)]
            || {
                for y in 0..height {
                    let row = &self.penetration.row(y + self.margin_px)[self.margin_px..][..width];
                    data.extend(row.iter().map(|mm| larger(*mm, 0.0)));
                }
            },
        );
        Grid { width, height, data }
    }
}

/// Computes the penetration of the object into the undeformed pad: captures the object, cuts in its texture and
/// subtracts the pad's curvature. `drop_mm` is how far a curved pad lies below its highest point
/// ([`rest_surface::rest_drop_mm`]).
pub fn capture_penetration(
    indenter: &Indenter,
    texture: Option<&Texture>,
    drop_mm: Option<&Grid<f32>>,
    thickness_mm: f64,
    view: &View,
    window: CaptureWindow,
    effects: &mut EffectLog,
) -> Depth {
    // The depth of its lowest point is known: an object above the pad needs no capture.
    let mut depth = match indenter.depth_mm > 0.0 || effects.runs_everywhere() {
        true => capture_indenter(indenter, view, window, thickness_mm),
        false => Depth::no_contact(view),
    };

    effects.run(Effect::Texture, texture_required(texture, &depth), || {
        if let Some(Texture { relief, sample, placement }) = texture {
            let TexturePlacement { origin_mm, yaw_deg } =
                placement.unwrap_or_else(|| TexturePlacement::at_pose(&indenter.pose));
            relief.cut(sample, origin_mm, yaw_deg, view, window.above_mm, &mut depth);
        }
    });

    let need = match drop_mm {
        None => Requirement::Absent("the pad is flat"),
        Some(_) => needed_if_touching(&depth, "the pad is curved under the object"),
    };
    effects.run(Effect::RestShape, need, || {
        if let Some(drop_mm) = drop_mm {
            rest_surface::subtract_drop(&mut depth, drop_mm, window.above_mm);
        }
    });
    depth
}

/// Decides whether a texture must be cut into what was captured.
pub fn texture_required(texture: Option<&Texture>, depth: &Depth) -> Requirement {
    match texture {
        None => Requirement::Absent("the job has none"),
        Some(texture) if texture.sample.amplitude_mm == 0.0 => Requirement::Unneeded("its amplitude is 0"),
        Some(_) => needed_if_touching(depth, "a textured object reaches into the pad"),
    }
}

fn needed_if_touching(depth: &Depth, why: &'static str) -> Requirement {
    match depth.touching.is_empty() {
        true => Requirement::Unneeded("nothing reaches into the pad"),
        false => Requirement::Needed(why),
    }
}

/// Captures the object in `view`; a height map already has a view of its own.
pub fn capture_indenter(indenter: &Indenter, view: &View, window: CaptureWindow, thickness_mm: f64) -> Depth {
    match &indenter.shape {
        Shape::Mesh(clusters) => capture_mesh(clusters, &indenter.pose.placement(), view, window, thickness_mm),
        Shape::HeightMap(map) => capture_height_map(map, window, thickness_mm),
        Shape::Seen(seen) => capture_mesh(&seen.near_gel, &indenter.pose.placement(), view, window, thickness_mm),
    }
}

/// Captures `object` at `placement` in `window`; depths are limited to `thickness_mm`.
pub fn capture_mesh(
    object: &Clusters,
    placement: &Placement,
    view: &View,
    window: CaptureWindow,
    thickness_mm: f64,
) -> Depth {
    let [width, height] = view.resolution_px;
    let margin_px = window.margin_px;
    let canvas = Canvas {
        width: width + 2 * margin_px,
        height: height + 2 * margin_px,
        margin: margin_px,
        ceiling: window.above_mm as f32,
    };
    let projection = OrthographicProjection::new(placement, view, object.centre_mm());
    let mut penetration = Grid { width: canvas.width, height: canvas.height, data: Vec::new() };
    penetration.data.resize(canvas.width * canvas.height, canvas.ceiling);
    raster::rasterise(object, &projection, canvas, &mut penetration);
    limit_to_thickness(penetration, margin_px, thickness_mm)
}

/// Returns the height over the pad, mm, of `object` at samples of pixels in `region` of the view and [`SURFACE_BORDER`]
/// around it; the window's height where there is no object.
pub fn capture_samples(
    object: &Clusters,
    pose: &Pose,
    view: &View,
    region: Rect,
    sampled: &SampleLayout,
    window: CaptureWindow,
) -> Vec<[f32; SAMPLES]> {
    let (canvas, projection) = part_canvas(object, pose, view, region, window);
    let mut heights = vec![[canvas.ceiling; SAMPLES]; sampled.pixel_count()];
    raster::rasterise_samples(object, &projection, canvas, sampled, &mut heights);
    heights
}

/// Returns the height over the pad, mm, of `object` at the centres of the pixels in `region` of the view and
/// [`SURFACE_BORDER`] around it; the window's height where there is no object.
pub fn capture_part(object: &Clusters, pose: &Pose, view: &View, region: Rect, window: CaptureWindow) -> Grid<f32> {
    let (canvas, projection) = part_canvas(object, pose, view, region, window);
    let Canvas { width, height, ceiling, .. } = canvas;
    let mut heights = Grid { width, height, data: vec![ceiling; width * height] };
    raster::rasterise(object, &projection, canvas, &mut heights);
    heights
}

/// Returns the canvas of a part of the view with [`SURFACE_BORDER`] around it, and the projection onto it.
fn part_canvas(
    object: &Clusters,
    pose: &Pose,
    view: &View,
    region: Rect,
    window: CaptureWindow,
) -> (Canvas, OrthographicProjection) {
    let [width, height] = [region.width(), region.height()].map(|px| px + 2 * SURFACE_BORDER);
    let canvas = Canvas { width, height, margin: SURFACE_BORDER, ceiling: window.above_mm as f32 };
    let projection = OrthographicProjection::new(&pose.placement(), view, object.centre_mm());
    (canvas, projection.with_corner_at([region.x0 as f64, region.y0 as f64]))
}

/// Captures a height map in `window`; depths are limited to `thickness_mm`. Around the view nothing is known, so the
/// border values are continued: otherwise an object that the border cuts would end there in a wall.
fn capture_height_map(map: &HeightMap, window: CaptureWindow, thickness_mm: f64) -> Depth {
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
    limit_to_thickness(penetration, margin_px, thickness_mm)
}

/// Makes a depth map from heights over the pad; depths are limited to `thickness_mm`.
fn limit_to_thickness(heights: Grid<f32>, margin_px: usize, thickness_mm: f64) -> Depth {
    let mut penetration = heights;
    let (deepest_mm, over_thickness_px) = limit_heights(&mut penetration, margin_px, thickness_mm as f32);
    let touching = bounding_box(&penetration, |mm| mm > 0.0);
    Depth { penetration, margin_px, touching, deepest_mm, over_thickness_px }
}

/// Turns heights over the pad into depths below it, limited to the pad's thickness. Returns the largest depth in view,
/// and how many pixels in view were limited.
fn limit_heights(heights: &mut Grid<f32>, margin_px: usize, thickness: f32) -> (f32, u64) {
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
                    // 0.0 - x instead of -x, so that 0 stays +0.0.
                    *value = (0.0 - *value).min(thickness);
                }
                if in_view {
                    deepest = deepest.max(largest_value(row[margin_px..margin_px + width].iter().copied()));
                }
            }
            (deepest, cut)
        },
    )
}
