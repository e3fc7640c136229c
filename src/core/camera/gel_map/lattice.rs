//! A chart's gel at every few nodes, with interpolation between them.

use std::ops::Range;

use glam::{DVec3, Vec3};

use crate::base::chart::{Chart, SurfaceFrame};
use crate::base::grid::Rect;
use crate::base::view::View;

/// Chart nodes along a side of a cell of a [`Lattice`].
pub const NODES_PER_CELL: usize = 4;

/// Two directions on the gel, side by side in a vector of eight numbers.
type Pair = [f32; 8];

/// The gel at every [`NODES_PER_CELL`]th node of a chart.
#[derive(Debug)]
pub struct Lattice {
    /// Nodes in a row.
    pub columns: usize,
    /// The gel at each node.
    pub rests: Vec<SurfaceFrame>,
    /// Slopes on the gel for a slope of 1 along x and along y of the chart.
    gradients: Vec<Pair>,
    /// The directions of the chart's x and y on the gel.
    tangents: Vec<Pair>,
    /// How the normal turns along the chart's x and y, per mm; empty unless the gel is a mesh.
    normal_derivatives: Vec<Pair>,
}

/// Cells of a [`Lattice`], each named by the number of its last node along x and along y.
pub struct CellRange {
    /// Along x.
    pub across: Range<usize>,
    /// Along y.
    pub down: Range<usize>,
}

impl CellRange {
    /// Returns the cells that cover a part of a chart.
    pub fn around(part: Rect, view: &View) -> Self {
        let [columns, rows] = Lattice::node_counts(view);
        let cells = |first: usize, end: usize, count: usize| {
            // One node more on every side, for what lies between a node of the part and one outside it.
            if first < end {
                first.saturating_sub(1) / NODES_PER_CELL + 1..((end + 1).div_ceil(NODES_PER_CELL) + 1).min(count)
            } else {
                0..0
            }
        };
        Self { across: cells(part.x0, part.x1, columns), down: cells(part.y0, part.y1, rows) }
    }
}

impl Lattice {
    /// Returns the number of nodes along x and y.
    fn node_counts(view: &View) -> [usize; 2] {
        view.resolution_px.map(|px| px.div_ceil(NODES_PER_CELL) + 1)
    }

    /// Computes the lattice of a chart with the nodes of `view`.
    pub fn new(chart: &Chart, view: &View) -> Self {
        let [columns, rows] = Self::node_counts(view);
        let node = |at: usize| {
            let place = [at % columns, at / columns].map(|at| (at * NODES_PER_CELL) as f64);
            chart.frame_and_gradients(view.point_mm(place))
        };
        let (rests, gradients): (Vec<SurfaceFrame>, Vec<_>) = (0..columns * rows).map(node).unzip();
        let turn = |at: usize| {
            let (column, row) = (at % columns, at / columns);
            let slope = |low: usize, high: usize, pixel_mm: f64, apart: usize| {
                (rests[high].normal - rests[low].normal) / (apart as f64 * NODES_PER_CELL as f64 * pixel_mm)
            };
            let (left, right) = (column.saturating_sub(1), (column + 1).min(columns - 1));
            let (above, below) = (row.saturating_sub(1), (row + 1).min(rows - 1));
            pack_pair([
                slope(row * columns + left, row * columns + right, view.mm_per_px[0], right - left),
                slope(above * columns + column, below * columns + column, view.mm_per_px[1], below - above),
            ])
        };
        let normal_derivatives =
            if chart.geodesics().is_some() { (0..columns * rows).map(turn).collect() } else { Vec::new() };
        let tangents = rests.iter().map(|rest| pack_pair(rest.tangents)).collect();
        Self { columns, gradients: gradients.into_iter().map(pack_pair).collect(), tangents, normal_derivatives, rests }
    }

    /// Returns the slopes on the gel for a slope of 1 along x and along y of the chart, at a place on it, px.
    #[inline(always)]
    pub fn gradients_at(&self, at: [f32; 2]) -> [Vec3; 2] {
        self.interpolate(&self.gradients, at)
    }

    /// Returns how the normal turns along the chart's x and y, per mm; `None` unless the gel is a mesh.
    #[inline(always)]
    pub fn normal_derivatives_at(&self, at: [f32; 2]) -> Option<[Vec3; 2]> {
        if self.normal_derivatives.is_empty() { None } else { Some(self.interpolate(&self.normal_derivatives, at)) }
    }

    /// Returns the directions of the chart's x and y on the gel, unit vectors.
    pub fn tangents_at(&self, at: [f32; 2]) -> [Vec3; 2] {
        self.interpolate(&self.tangents, at).map(Vec3::normalize_or_zero)
    }

    /// Interpolates between nodes, bilinear.
    #[inline(always)]
    fn interpolate(&self, of: &[Pair], at: [f32; 2]) -> [Vec3; 2] {
        let rows = of.len() / self.columns;
        let [x, y] = at.map(|px| px.max(0.0) * (1.0 / NODES_PER_CELL as f32));
        let (column, row) = ((x as usize).min(self.columns - 2), (y as usize).min(rows - 2));
        let (right, down) = (x - column as f32, y - row as f32);
        let first = row * self.columns + column;
        let [a, b, c, d] = [first, first + 1, first + self.columns, first + self.columns + 1].map(|node| of[node]);
        let interpolated: Pair = std::array::from_fn(|k| {
            let (upper, lower) = (a[k] + right * (b[k] - a[k]), c[k] + right * (d[k] - c[k]));
            upper + down * (lower - upper)
        });
        let [x, y, z, _, u, v, w, _] = interpolated;
        [Vec3::new(x, y, z), Vec3::new(u, v, w)]
    }
}

fn pack_pair([a, b]: [DVec3; 2]) -> Pair {
    let [a, b] = [a.as_vec3(), b.as_vec3()];
    [a.x, a.y, a.z, 0.0, b.x, b.y, b.z, 0.0]
}
