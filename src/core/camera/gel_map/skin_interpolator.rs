//! Displacement and normals of a pressed gel between the nodes of its chart.

use glam::{DMat3, Mat3, Vec3};

use super::lattice::Lattice;
use super::{GelView, PixelContent};
use crate::base::grid::{Grid, Rect};
use crate::base::view::{SURFACE_BORDER, View};

/// A pressed gel between the nodes of its chart.
pub struct SkinInterpolator<'a> {
    gel: &'a GelView,
    slopes: SlopeGrid,
    lattice: &'a Lattice,
    turn: Mat3,
    per_radius: f32,
}

impl<'a> SkinInterpolator<'a> {
    /// Prepares a gel with the displacement `surface` on a chart, which is 0 outside `touched`. The lattice is that of
    /// the chart before its rotation `turn`.
    pub fn new(
        gel: &'a GelView,
        radius_mm: f64,
        (lattice, turn): (&'a Lattice, DMat3),
        surface: &Grid<f32>,
        touched: Rect,
    ) -> Self {
        let slopes = SlopeGrid::new(surface, touched, &gel.view);
        Self { gel, slopes, lattice, turn: turn.as_mat3(), per_radius: (1.0 / radius_mm) as f32 }
    }

    /// Returns the untouched gel's normal at the pixel `index`, towards its inside.
    #[inline(always)]
    pub fn rest_normal(&self, index: usize) -> Vec3 {
        Vec3::from_array(self.gel.inward_normals.each_ref().map(|plane| plane[index]))
    }

    /// Returns the normal at a place of the chart that the pixel `index` shows, and how far the gel is pressed in
    /// there, mm; `None` where it is not.
    #[inline(always)]
    pub fn normal_and_displacement_at(&self, at: [f32; 2], index: usize) -> Option<(Vec3, f32)> {
        let [down, along_x, along_y] = self.slopes.interpolate(at)?;
        let rest = self.rest_normal(index);
        if along_x == 0.0 && along_y == 0.0 {
            return Some((rest, down));
        }
        let [gradient_x, gradient_y] = self.lattice.gradients_at(at);
        let gradient = self.turn * (along_x * gradient_x + along_y * gradient_y);
        let slope = match self.lattice.normal_derivatives_at(at) {
            // A mesh that is pressed in along its normals becomes narrower or wider by how these turn, and its slopes
            // change with it. Slopes are kept as they are where it would nearly fold.
            Some(turns) => {
                let [turn_x, turn_y] = turns.map(|turn| down * turn);
                let column = |k: usize| Vec3::AXES[k] - turn_x * gradient_x[k] - turn_y * gradient_y[k];
                let kept = Mat3::from_cols(column(0), column(1), column(2));
                if kept.determinant() > 0.05 { kept.inverse() * gradient } else { gradient }
            }
            // A round gel shrinks around its axis when it is pressed in; on the ball also along the axis.
            None => {
                let on_wall = self.gel.contents[index] == PixelContent::Wall;
                let along = if on_wall { Vec3::new(0.0, 0.0, gradient.z) } else { Vec3::ZERO };
                along + (gradient - along) / (1.0 - down * self.per_radius).max(0.05)
            }
        };
        // The inward normal leans away from where the dent is deeper.
        Some(((rest - slope).normalize(), down))
    }
}

/// Displacement and slopes of a pressed gel at the nodes of a chart.
struct SlopeGrid {
    /// The nodes outside which both are 0.
    part: Rect,
    size: [usize; 2],
    /// Row by row: displacement, mm, its slopes along x and y, and a 0 that fills a vector of four numbers.
    nodes: Vec<[f32; 4]>,
}

impl SlopeGrid {
    /// Computes the slopes of a displacement, given with its border on the nodes of `view`; it is 0 outside `touched`.
    fn new(surface: &Grid<f32>, touched: Rect, view: &View) -> Self {
        let size = view.resolution_px;
        let part = touched.grown(1, size[0], size[1]);
        let per_slope = view.mm_per_px.map(|pixel_mm| (0.5 / pixel_mm) as f32);
        let mut nodes = Vec::with_capacity(part.area());
        for y in part.y0..part.y1 {
            let row = |dy: usize| &surface.row(y + dy)[part.x0..part.x1 + 2 * SURFACE_BORDER];
            let (above, here, below) = (row(0), row(1), row(2));
            nodes.extend((0..part.width()).map(|x| {
                let slopes = [(here[x + 2] - here[x]) * per_slope[0], (below[x + 1] - above[x + 1]) * per_slope[1]];
                [here[x + 1], slopes[0], slopes[1], 0.0]
            }));
        }
        Self { part, size, nodes }
    }

    /// Interpolates the displacement, mm, and its slopes along x and y between the nodes around a place; `None` outside
    /// the outermost nodes, and where the gel is not pressed in.
    #[inline(always)]
    fn interpolate(&self, [x, y]: [f32; 2]) -> Option<[f32; 3]> {
        let Self { part, size: [width, height], nodes } = self;
        let (x, y) = (x - 0.5, y - 0.5);
        let (last_x, last_y) = ((width - 1) as f32, (height - 1) as f32);
        if !(x >= -0.5 && y >= -0.5 && x <= last_x + 0.5 && y <= last_y + 0.5) {
            return None;
        }
        let (x, y) = (x.clamp(0.0, last_x), y.clamp(0.0, last_y));
        let (column, row) = (x as usize, y as usize);
        if column + 1 < part.x0 || column >= part.x1 || row + 1 < part.y0 || row >= part.y1 {
            return None;
        }
        let (right, down) = (x - column as f32, y - row as f32);
        let node = |column: usize, row: usize| {
            if part.contains([column, row]) {
                nodes[(row - part.y0) * part.width() + column - part.x0]
            } else {
                [0.0; 4]
            }
        };
        let (next, below) = ((column + 1).min(width - 1), (row + 1).min(height - 1));
        let (a, b, c, d) = (node(column, row), node(next, row), node(column, below), node(next, below));
        let interpolated: [f32; 4] = std::array::from_fn(|k| {
            let (upper, lower) = (a[k] + right * (b[k] - a[k]), c[k] + right * (d[k] - c[k]));
            upper + down * (lower - upper)
        });
        let [down_mm, along_x, along_y, _] = interpolated;
        Some([down_mm, along_x, along_y])
    }
}
