//! The gel at every few nodes of a chart, between which it is straight.

use std::ops::Range;

use glam::{DVec3, Vec3};

use crate::base::chart::{Chart, Rest};
use crate::base::grid::Rect;
use crate::base::view::View;

/// Nodes of a chart on a side of the cells of a [`Lattice`].
pub const CELL: usize = 4;

/// Two directions on the gel, side by side: a vector of eight numbers.
type Pair = [f32; 8];

/// The gel at every [`CELL`]th node of a chart.
#[derive(Debug)]
pub struct Lattice {
    /// Nodes in a row.
    pub columns: usize,
    /// The gel at each node.
    pub rests: Vec<Rest>,
    /// Slopes on the gel of slopes of 1 on the chart, along x and y.
    gradients: Vec<Pair>,
    /// The chart's own directions.
    tangents: Vec<Pair>,
    /// Of a mesh, how its normal turns along the chart's x and y, per mm; else empty.
    turns: Vec<Pair>,
}

/// Cells of a [`Lattice`], each by the number of its last node along x and along y.
pub struct Cells {
    /// Along x.
    pub across: Range<usize>,
    /// Along y.
    pub down: Range<usize>,
}

impl Cells {
    /// Those of a part of a chart.
    pub fn around(part: Rect, view: &View) -> Self {
        let [columns, rows] = Lattice::size(view);
        let cells = |first: usize, end: usize, count: usize| {
            // A node more on every side, for what lies between nodes of the part and others.
            if first < end {
                first.saturating_sub(1) / CELL + 1..((end + 1).div_ceil(CELL) + 1).min(count)
            } else {
                0..0
            }
        };
        Self { across: cells(part.x0, part.x1, columns), down: cells(part.y0, part.y1, rows) }
    }
}

impl Lattice {
    /// Nodes along x and y.
    fn size(view: &View) -> [usize; 2] {
        view.resolution_px.map(|px| px.div_ceil(CELL) + 1)
    }

    /// Of a chart with the nodes of `view`.
    pub fn new(chart: &Chart, view: &View) -> Self {
        let [columns, rows] = Self::size(view);
        let node = |at: usize| {
            let place = [at % columns, at / columns].map(|at| (at * CELL) as f64);
            chart.rest_with_gradients(view.point_mm(place))
        };
        let (rests, gradients): (Vec<Rest>, Vec<_>) = (0..columns * rows).map(node).unzip();
        let turn = |at: usize| {
            let (column, row) = (at % columns, at / columns);
            let slope = |low: usize, high: usize, pitch_mm: f64, apart: usize| {
                (rests[high].normal - rests[low].normal) / (apart as f64 * CELL as f64 * pitch_mm)
            };
            let (left, right) = (column.saturating_sub(1), (column + 1).min(columns - 1));
            let (above, below) = (row.saturating_sub(1), (row + 1).min(rows - 1));
            pair([
                slope(row * columns + left, row * columns + right, view.mm_per_px[0], right - left),
                slope(above * columns + column, below * columns + column, view.mm_per_px[1], below - above),
            ])
        };
        let turns = if chart.geodesics().is_some() { (0..columns * rows).map(turn).collect() } else { Vec::new() };
        let tangents = rests.iter().map(|rest| pair(rest.tangents)).collect();
        Self { columns, gradients: gradients.into_iter().map(pair).collect(), tangents, turns, rests }
    }

    /// Slopes on the gel of slopes of 1 on the chart, at a place of it, px: along x and y.
    #[inline(always)]
    pub fn gradients_at(&self, at: [f32; 2]) -> [Vec3; 2] {
        self.between(&self.gradients, at)
    }

    /// How the normals turn along the chart's x and y, per mm; of a mesh.
    #[inline(always)]
    pub fn turns_at(&self, at: [f32; 2]) -> Option<[Vec3; 2]> {
        if self.turns.is_empty() { None } else { Some(self.between(&self.turns, at)) }
    }

    /// The chart's own directions.
    pub fn tangents_at(&self, at: [f32; 2]) -> [Vec3; 2] {
        self.between(&self.tangents, at).map(Vec3::normalize_or_zero)
    }

    /// Between nodes, bilinear.
    #[inline(always)]
    fn between(&self, of: &[Pair], at: [f32; 2]) -> [Vec3; 2] {
        let rows = of.len() / self.columns;
        let [x, y] = at.map(|px| px.max(0.0) * (1.0 / CELL as f32));
        let (column, row) = ((x as usize).min(self.columns - 2), (y as usize).min(rows - 2));
        let (right, down) = (x - column as f32, y - row as f32);
        let first = row * self.columns + column;
        let [a, b, c, d] = [first, first + 1, first + self.columns, first + self.columns + 1].map(|node| of[node]);
        let between: Pair = std::array::from_fn(|k| {
            let (upper, lower) = (a[k] + right * (b[k] - a[k]), c[k] + right * (d[k] - c[k]));
            upper + down * (lower - upper)
        });
        let [x, y, z, _, u, v, w, _] = between;
        [Vec3::new(x, y, z), Vec3::new(u, v, w)]
    }
}

fn pair([a, b]: [DVec3; 2]) -> Pair {
    let [a, b] = [a.as_vec3(), b.as_vec3()];
    [a.x, a.y, a.z, 0.0, b.x, b.y, b.z, 0.0]
}
