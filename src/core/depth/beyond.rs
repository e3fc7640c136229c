//! What of an object lies beyond the window that was captured: where it reaches into the pad, and its overlap there on any
//! grid of square cells.

use super::indenter::{Indenter, Shape};
use super::texture::{Texture, TexturePlacement};
use super::{Window, capture};
use crate::base::grid::Grid;
use crate::base::view::{SURFACE_BORDER, View};
use crate::mesh::clusters::Clusters;
use crate::pose::{Placement, Pose};

/// A rectangle of the pad, mm from the middle of the view.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Area {
    /// Its lowest x and y.
    pub min: [f64; 2],
    /// Its highest x and y.
    pub max: [f64; 2],
}

impl Area {
    /// Without any point.
    pub const EMPTY: Self = Self { min: [f64::INFINITY; 2], max: [f64::NEG_INFINITY; 2] };

    /// The whole plane.
    pub const EVERYWHERE: Self = Self { min: [f64::NEG_INFINITY; 2], max: [f64::INFINITY; 2] };

    /// The view and so many pixels around it.
    pub fn around(view: &View, margin_px: usize) -> Self {
        let half = [0, 1].map(|k| (view.resolution_px[k] as f64 / 2.0 + margin_px as f64) * view.mm_per_px[k]);
        Self { min: half.map(|half| -half), max: half }
    }

    /// True without any point.
    pub fn is_empty(self) -> bool {
        (0..2).any(|k| self.min[k] > self.max[k])
    }

    /// Its longer side, mm.
    pub fn longest(self) -> f64 {
        (self.max[0] - self.min[0]).max(self.max[1] - self.min[1])
    }

    /// Larger by `mm` on every side.
    pub fn grown(self, mm: f64) -> Self {
        Self { min: self.min.map(|low| low - mm), max: self.max.map(|high| high + mm) }
    }

    /// What both have in common.
    pub fn cut(self, other: Self) -> Self {
        let min = std::array::from_fn(|k| self.min[k].max(other.min[k]));
        Self { min, max: std::array::from_fn(|k| self.max[k].min(other.max[k])) }
    }

    /// True if it holds all of another; of an empty one, too.
    pub fn holds(self, other: Self) -> bool {
        other.is_empty() || (0..2).all(|k| self.min[k] <= other.min[k] && other.max[k] <= self.max[k])
    }

    /// Share of a cell that lies in it.
    pub fn share(self, cells: &Cells, x: usize, y: usize) -> f64 {
        let along = |k: usize, at: usize| {
            let low = cells.corner_mm[k] + at as f64 * cells.pitch_mm;
            let inside = self.max[k].min(low + cells.pitch_mm) - self.min[k].max(low);
            (inside / cells.pitch_mm).clamp(0.0, 1.0)
        };
        along(0, x) * along(1, y)
    }

    fn add(&mut self, point: [f64; 2]) {
        for (k, at) in point.into_iter().enumerate() {
            self.min[k] = self.min[k].min(at);
            self.max[k] = self.max[k].max(at);
        }
    }
}

/// A grid of square cells on the pad.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Cells {
    /// Where the first cell begins, mm from the middle of the view.
    pub corner_mm: [f64; 2],
    /// Size of a cell, mm.
    pub pitch_mm: f64,
    /// Columns and rows.
    pub count: [usize; 2],
}

impl Cells {
    /// Cells over an area and `border` more on every side, as far beyond it on one side as on the other. The middles of
    /// as many lie in the area as fit it best.
    pub fn over(area: Area, pitch_mm: f64, border: usize) -> Self {
        let count = [0, 1].map(|k| ((area.max[k] - area.min[k]) / pitch_mm).round().max(1.0) as usize + 2 * border);
        let corner = |k: usize| 0.5 * (area.min[k] + area.max[k] - count[k] as f64 * pitch_mm);
        Self { corner_mm: [corner(0), corner(1)], pitch_mm, count }
    }

    fn middle_mm(&self) -> [f64; 2] {
        std::array::from_fn(|k| self.corner_mm[k] + 0.5 * self.count[k] as f64 * self.pitch_mm)
    }
}

/// What is pressed, to be looked at beyond the window of a view.
#[derive(Clone, Copy, Debug)]
pub struct Surroundings<'a> {
    object: &'a Clusters,
    pose: &'a Pose,
    depth_mm: f64,
    texture: Option<&'a Texture>,
    drop_mm: Option<&'a Grid<f32>>,
    thickness_mm: f64,
    view: &'a View,
}

impl<'a> Surroundings<'a> {
    /// Those of an object that reaches into the pad beyond `margin_px` around the view. `None` if it does not, and for a
    /// height map, of which nothing is known there.
    pub fn new(
        indenter: &'a Indenter,
        texture: Option<&'a Texture>,
        drop_mm: Option<&'a Grid<f32>>,
        thickness_mm: f64,
        view: &'a View,
        margin_px: usize,
    ) -> Option<Self> {
        let Shape::Mesh(object) = &indenter.shape else { return None };
        let window = Area::around(view, margin_px);
        let placement = indenter.pose.placement();
        if window.holds(below(0.0, object, &placement, Some(window))) {
            return None;
        }
        let Indenter { pose, depth_mm, .. } = indenter;
        Some(Self { object, pose, depth_mm: *depth_mm, texture, drop_mm, thickness_mm, view })
    }

    /// The smallest rectangle around all of the object that lies lower than `above_mm` over the undeformed pad's highest
    /// point.
    pub fn below(&self, above_mm: f64) -> Area {
        below(above_mm, self.object, &self.pose.placement(), None)
    }

    /// How deep it reaches below the undeformed pad, mm.
    pub fn depth_mm(&self) -> f64 {
        self.depth_mm
    }

    /// The view.
    pub fn view(&self) -> &View {
        self.view
    }

    /// The overlap at the cells' middles, as in the window: with its texture, on a pad that goes on beyond the view as high
    /// as it is at its border. The object is known up to a pad's thickness above it.
    pub fn penetration(&self, cells: &Cells) -> Grid<f32> {
        self.captured(cells, self.thickness_mm)
    }

    /// The same where it is above 0; where it is not, it is not known how far the object is above the pad.
    pub fn depths(&self, cells: &Cells) -> Grid<f32> {
        // Texture and a curved pad may take more of an object below the pad.
        let smooth = self.texture.is_none() && self.drop_mm.is_none();
        self.captured(cells, if smooth { 0.0 } else { self.thickness_mm })
    }

    fn captured(&self, cells: &Cells, above_mm: f64) -> Grid<f32> {
        let Placement { rotation, translation_mm } = self.pose.placement();
        let middle = cells.middle_mm();
        let [x, y, z] = translation_mm;
        let origin_mm = [x - middle[0], y - middle[1]];
        let placement = Placement { rotation, translation_mm: [origin_mm[0], origin_mm[1], z] };
        let view = View { resolution_px: cells.count, mm_per_px: [cells.pitch_mm; 2] };
        let mut depth = capture(self.object, &placement, &view, Window { margin_px: 0, above_mm }, self.thickness_mm);
        if let Some(Texture { relief, sample, laid }) = self.texture {
            let TexturePlacement { origin_mm: [x, y], yaw_deg } =
                laid.unwrap_or_else(|| TexturePlacement::with(self.pose));
            relief.cut(sample, [x - middle[0], y - middle[1]], yaw_deg, &view, above_mm, &mut depth);
        }
        if let Some(drop) = self.drop_mm {
            self.lower(drop, cells, &mut depth.penetration);
        }
        depth.penetration
    }

    /// Takes the overlap against a curved pad.
    fn lower(&self, drop: &Grid<f32>, cells: &Cells, penetration: &mut Grid<f32>) {
        let floor = -self.thickness_mm as f32;
        let nearest = |k: usize, at: usize| {
            let mm = cells.corner_mm[k] + (at as f64 + 0.5) * cells.pitch_mm;
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

/// The smallest rectangle around the parts of an object that lie lower than `above_mm` over the undeformed pad; where an area
/// is given, only parts that may reach out of it are looked at.
fn below(above_mm: f64, object: &Clusters, placement: &Placement, out_of: Option<Area>) -> Area {
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
    let may_count = |min: [f32; 3], max: [f32; 3]| {
        let along = [0, 1].map(|k| reach(k, min, max));
        let own = Area { min: along.map(|(low, _)| low), max: along.map(|(_, high)| high) };
        reach(2, min, max).0 < 0.0 && out_of.is_none_or(|area| !area.holds(own))
    };
    let mut found = Area::EMPTY;
    object.query(may_count, |part| {
        let place = |at: u8| -> [f64; 3] {
            let vertex = [part.x, part.y, part.z].map(|along| f64::from(along[usize::from(at)]));
            std::array::from_fn(|k| (0..3).map(|j| rotation[k][j] * vertex[j]).sum::<f64>() + offset[k])
        };
        for corners in part.corners {
            let [a, b, c] = corners.map(place);
            for (from, to) in [(a, b), (b, c), (c, a)] {
                if from[2] < 0.0 {
                    found.add([from[0], from[1]]);
                }
                if (from[2] < 0.0) != (to[2] < 0.0) {
                    let share = from[2] / (from[2] - to[2]);
                    found.add([0, 1].map(|k| from[k] + share * (to[k] - from[k])));
                }
            }
        }
    });
    found
}
