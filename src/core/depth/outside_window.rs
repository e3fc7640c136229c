//! The parts of an object outside the captured window: where it reaches into the pad there, and its penetration on any
//! grid of square cells.

use super::indenter::{Indenter, Shape};
use super::texture::{Texture, TexturePlacement};
use super::{CaptureWindow, capture_mesh};
use crate::base::grid::Grid;
use crate::base::view::{SURFACE_BORDER, View};
use crate::mesh::clusters::Clusters;
use crate::pose::{Placement, Pose};

/// Most patches into which the contact is divided, each of which takes a grid.
pub const MAX_PATCHES: usize = 1024;

/// A rectangle of the pad, mm from the centre of the view.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct RectMm {
    /// Smallest x and y.
    pub min: [f64; 2],
    /// Largest x and y.
    pub max: [f64; 2],
}

impl RectMm {
    /// The rectangle without any point.
    pub const EMPTY: Self = Self { min: [f64::INFINITY; 2], max: [f64::NEG_INFINITY; 2] };

    /// The complete plane.
    pub const EVERYWHERE: Self = Self { min: [f64::NEG_INFINITY; 2], max: [f64::INFINITY; 2] };

    /// Returns the view with `margin_px` pixels around it.
    pub fn around_view(view: &View, margin_px: usize) -> Self {
        let half = [0, 1].map(|k| (view.resolution_px[k] as f64 / 2.0 + margin_px as f64) * view.mm_per_px[k]);
        Self { min: half.map(|half| -half), max: half }
    }

    /// Returns true if the rectangle contains no point.
    pub fn is_empty(self) -> bool {
        (0..2).any(|k| self.min[k] > self.max[k])
    }

    /// Returns the length of the longer side, mm.
    pub fn longer_side_mm(self) -> f64 {
        (self.max[0] - self.min[0]).max(self.max[1] - self.min[1])
    }

    /// Returns the rectangle grown by `mm` on every side.
    pub fn grown(self, mm: f64) -> Self {
        Self { min: self.min.map(|low| low - mm), max: self.max.map(|high| high + mm) }
    }

    /// Returns the smallest rectangle around both.
    pub fn union(self, other: Self) -> Self {
        let min = std::array::from_fn(|k| self.min[k].min(other.min[k]));
        Self { min, max: std::array::from_fn(|k| self.max[k].max(other.max[k])) }
    }

    /// Returns the part that both rectangles have in common.
    pub fn intersection(self, other: Self) -> Self {
        let min = std::array::from_fn(|k| self.min[k].max(other.min[k]));
        Self { min, max: std::array::from_fn(|k| self.max[k].min(other.max[k])) }
    }

    /// Returns true if the rectangle contains all of another; an empty one is contained in any.
    pub fn contains(self, other: Self) -> bool {
        other.is_empty() || (0..2).all(|k| self.min[k] <= other.min[k] && other.max[k] <= self.max[k])
    }

    /// Returns the share of a cell that lies in the rectangle, 0 to 1.
    pub fn cell_share(self, cells: &CellGrid, x: usize, y: usize) -> f64 {
        let along = |k: usize, at: usize| {
            let low = cells.corner_mm[k] + at as f64 * cells.cell_size_mm;
            let inside = self.max[k].min(low + cells.cell_size_mm) - self.min[k].max(low);
            (inside / cells.cell_size_mm).clamp(0.0, 1.0)
        };
        along(0, x) * along(1, y)
    }

    fn add_point(&mut self, point: [f64; 2]) {
        for (k, at) in point.into_iter().enumerate() {
            self.min[k] = self.min[k].min(at);
            self.max[k] = self.max[k].max(at);
        }
    }
}

/// A grid of square cells on the pad.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct CellGrid {
    /// Corner of the first cell, mm from the centre of the view.
    pub corner_mm: [f64; 2],
    /// Size of a cell, mm.
    pub cell_size_mm: f64,
    /// Columns and rows.
    pub count: [usize; 2],
}

impl CellGrid {
    /// Makes a grid of cells over an area, centred on it, with `border` more cells on every side. The number of cells
    /// is the area's size in cells, rounded.
    pub fn covering(area: RectMm, cell_size_mm: f64, border: usize) -> Self {
        let count = [0, 1].map(|k| ((area.max[k] - area.min[k]) / cell_size_mm).round().max(1.0) as usize + 2 * border);
        let corner = |k: usize| 0.5 * (area.min[k] + area.max[k] - count[k] as f64 * cell_size_mm);
        Self { corner_mm: [corner(0), corner(1)], cell_size_mm, count }
    }

    fn centre_mm(&self) -> [f64; 2] {
        std::array::from_fn(|k| self.corner_mm[k] + 0.5 * self.count[k] as f64 * self.cell_size_mm)
    }
}

/// An object whose parts outside the window of a view can be captured.
#[derive(Clone, Copy, Debug)]
pub struct OutsideCapture<'a> {
    object: &'a Clusters,
    pose: &'a Pose,
    depth_mm: f64,
    texture: Option<&'a Texture>,
    drop_mm: Option<&'a Grid<f32>>,
    thickness_mm: f64,
    view: &'a View,
}

impl<'a> OutsideCapture<'a> {
    /// Prepares the capture of an object that reaches into the pad outside the view and `margin_px` around it. `None`
    /// if it does not, and for anything but a mesh, of which nothing is known there.
    pub fn new(
        indenter: &'a Indenter,
        texture: Option<&'a Texture>,
        drop_mm: Option<&'a Grid<f32>>,
        thickness_mm: f64,
        view: &'a View,
        margin_px: usize,
    ) -> Option<Self> {
        let Shape::Mesh(object) = &indenter.shape else { return None };
        // An object above the pad is not captured in view, either: corners of one that just rests on the pad may lie
        // below it by rounding.
        if indenter.depth_mm <= 0.0 {
            return None;
        }
        let window = RectMm::around_view(view, margin_px);
        let placement = indenter.pose.placement();
        let mut extent = RectMm::EMPTY;
        visit_extents_below(0.0, object, &placement, Some(window), |part| extent = extent.union(part));
        if window.contains(extent) {
            return None;
        }
        let Indenter { pose, depth_mm, .. } = indenter;
        Some(Self { object, pose, depth_mm: *depth_mm, texture, drop_mm, thickness_mm, view })
    }

    /// Returns rectangles around all of the object that lies lower than `above_mm` over the undeformed pad's highest
    /// point, each more than `gap_mm` from the others. Where there would be too many, the gap doubles until there are
    /// few enough.
    pub fn patches_below(&self, above_mm: f64, mut gap_mm: f64) -> Vec<RectMm> {
        let (mut patches, mut added): (Vec<RectMm>, Vec<RectMm>) = Default::default();
        visit_extents_below(above_mm, self.object, &self.pose.placement(), None, |part| {
            added.push(part);
            while let Some(mut patch) = added.pop() {
                let is_near = |patch: RectMm, other: &RectMm| !patch.grown(gap_mm).intersection(*other).is_empty();
                while let Some(near) = patches.iter().position(|other| is_near(patch, other)) {
                    patch = patch.union(patches.swap_remove(near));
                }
                patches.push(patch);
                if patches.len() > MAX_PATCHES {
                    gap_mm *= 2.0;
                    added.append(&mut patches);
                }
            }
        });
        patches
    }

    /// Returns how deep the object reaches below the undeformed pad, mm.
    pub fn depth_mm(&self) -> f64 {
        self.depth_mm
    }

    /// Returns the view.
    pub fn view(&self) -> &View {
        self.view
    }

    /// Returns the penetration at the cells' centres, computed as in the window: with the object's texture, on a pad
    /// that beyond the view is as high as at the view's border. Heights over the pad are known up to the pad's
    /// thickness.
    pub fn capture_penetration(&self, cells: &CellGrid) -> Grid<f32> {
        self.capture_cells(cells, self.thickness_mm)
    }

    /// Returns the penetration at the cells' centres where it is above 0. Elsewhere the height over the pad may be
    /// unknown.
    pub fn capture_depths(&self, cells: &CellGrid) -> Grid<f32> {
        // Without texture and curvature the capture can stop at the pad; either may move points from above the pad
        // below it.
        let smooth = self.texture.is_none() && self.drop_mm.is_none();
        self.capture_cells(cells, if smooth { 0.0 } else { self.thickness_mm })
    }

    fn capture_cells(&self, cells: &CellGrid, above_mm: f64) -> Grid<f32> {
        let Placement { rotation, translation_mm } = self.pose.placement();
        let middle = cells.centre_mm();
        let [x, y, z] = translation_mm;
        let origin_mm = [x - middle[0], y - middle[1]];
        let placement = Placement { rotation, translation_mm: [origin_mm[0], origin_mm[1], z] };
        let view = View { resolution_px: cells.count, mm_per_px: [cells.cell_size_mm; 2] };
        let mut depth =
            capture_mesh(self.object, &placement, &view, CaptureWindow { margin_px: 0, above_mm }, self.thickness_mm);
        if let Some(Texture { relief, sample, placement: texture_placement }) = self.texture {
            let TexturePlacement { origin_mm: [x, y], yaw_deg } =
                texture_placement.unwrap_or_else(|| TexturePlacement::at_pose(self.pose));
            relief.cut(sample, [x - middle[0], y - middle[1]], yaw_deg, &view, above_mm, &mut depth);
        }
        if let Some(drop) = self.drop_mm {
            self.subtract_drop(drop, cells, &mut depth.penetration);
        }
        depth.penetration
    }

    /// Subtracts how far a curved pad lies below its highest point.
    fn subtract_drop(&self, drop: &Grid<f32>, cells: &CellGrid, penetration: &mut Grid<f32>) {
        let floor = -self.thickness_mm as f32;
        let nearest = |k: usize, at: usize| {
            let mm = cells.corner_mm[k] + (at as f64 + 0.5) * cells.cell_size_mm;
            let px = mm / self.view.mm_per_px[k] + self.view.resolution_px[k] as f64 / 2.0 + SURFACE_BORDER as f64;
            (px.max(0.0) as usize).min([drop.width, drop.height][k] - 1)
        };
        let columns: Vec<usize> = (0..cells.count[0]).map(|x| nearest(0, x)).collect();
        for y in 0..cells.count[1] {
            let below = drop.row(nearest(1, y));
            for (penetration, column) in penetration.row_mut(y).iter_mut().zip(&columns) {
                *penetration = (*penetration - below[*column]).max(floor);
            }
        }
    }
}

/// Visits the smallest rectangle around what lies lower than `above_mm` over the undeformed pad of each triangle of an
/// object. With `out_of`, parts that lie completely within that area may be left out.
fn visit_extents_below(
    above_mm: f64,
    object: &Clusters,
    placement: &Placement,
    out_of: Option<RectMm>,
    mut visit: impl FnMut(RectMm),
) {
    let Placement { rotation, translation_mm } = placement;
    let centre = object.centre_mm();
    let mut offset: [f64; 3] =
        std::array::from_fn(|k| (0..3).map(|j| rotation[k][j] * centre[j]).sum::<f64>() + translation_mm[k]);
    offset[2] -= above_mm;
    let reach = |k: usize, min: [f32; 3], max: [f32; 3]| {
        let ends = |j: usize| (rotation[k][j] * f64::from(min[j]), rotation[k][j] * f64::from(max[j]));
        let sum = |pick: fn(f64, f64) -> f64| (0..3).map(|j| pick(ends(j).0, ends(j).1)).sum::<f64>() + offset[k];
        (sum(f64::min), sum(f64::max))
    };
    // A part counts if its box reaches below the height, and out of the area.
    let may_count = |min: [f32; 3], max: [f32; 3]| {
        let along = [0, 1].map(|k| reach(k, min, max));
        let own = RectMm { min: along.map(|(low, _)| low), max: along.map(|(_, high)| high) };
        reach(2, min, max).0 < 0.0 && out_of.is_none_or(|area| !area.contains(own))
    };
    object.query(may_count, |part| {
        let place = |at: u8| -> [f64; 3] {
            let vertex = [part.x, part.y, part.z].map(|along| f64::from(along[usize::from(at)]));
            std::array::from_fn(|k| (0..3).map(|j| rotation[k][j] * vertex[j]).sum::<f64>() + offset[k])
        };
        for corners in part.corners {
            let [a, b, c] = corners.map(place);
            let mut found = RectMm::EMPTY;
            for (from, to) in [(a, b), (b, c), (c, a)] {
                if from[2] < 0.0 {
                    found.add_point([from[0], from[1]]);
                }
                if (from[2] < 0.0) != (to[2] < 0.0) {
                    let share = from[2] / (from[2] - to[2]);
                    found.add_point([0, 1].map(|k| from[k] + share * (to[k] - from[k])));
                }
            }
            if !found.is_empty() {
                visit(found);
            }
        }
    });
}
