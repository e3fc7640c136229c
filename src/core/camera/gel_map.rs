//! Where the pixels of an image lie on a chart of a curved gel, and the chart's layers as the image shows them.

use std::ops::Range;
use std::sync::{Arc, OnceLock};

use glam::{DMat3, DQuat, DVec2, DVec3};

use super::projection::Projection;
use crate::core::base::chart::{Chart, Rest};
use crate::core::base::gel::{GelShape, Site};
use crate::core::base::grid::{Grid, Rect, bounding_box};
use crate::core::base::view::{SURFACE_BORDER, View};

/// Step of the table of [`angles`].
const STEP: f64 = 1.0 / 4096.0;

/// An angle over its sine, for 1 less its cosine in steps from 0 to 1.5.
fn angles() -> &'static [f64] {
    static TABLE: OnceLock<Vec<f64>> = OnceLock::new();
    TABLE.get_or_init(|| {
        let of = |step: usize| {
            let versine = step as f64 * STEP;
            let sin = libm::sqrt(versine * (2.0 - versine));
            if step == 0 { 1.0 } else { libm::atan2(sin, 1.0 - versine) / sin }
        };
        (0..=6144).map(of).collect()
    })
}

/// Where the pixels of an image lie on a chart.
#[derive(Clone, Debug)]
pub struct GelMap {
    view: View,
    chart: Chart,
    /// What the pixels show of the gel.
    sites: Arc<[Option<Site>]>,
    /// Column and row on the chart, in pixels of `view`; no numbers where the image shows no gel, or one that is beyond
    /// the chart.
    at: Vec<[f32; 2]>,
    lattice: OnceLock<Lattice>,
}

/// The gel at every [`CELL`]th node of a chart, between which it is straight.
#[derive(Clone, Debug)]
struct Lattice {
    columns: usize,
    rests: Vec<Rest>,
    /// Slopes on the gel of slopes of 1 on the chart, along x and y.
    gradients: Vec<[DVec3; 2]>,
    /// Of a mesh, how its normal turns along the chart's x and y, per mm; else empty.
    turns: Vec<[DVec3; 2]>,
}

impl GelMap {
    /// Of the points of a gel that the pixels of this camera show; `None` where one shows no gel. Of a capsule's chart only a part
    /// is looked for: outside of it there is nothing to be shown.
    pub fn new(
        shape: &GelShape,
        camera: &Projection,
        sites: Arc<[Option<Site>]>,
        chart: &Chart,
        view: &View,
        part: Rect,
    ) -> Self {
        let lattice = OnceLock::new();
        let over_mm = CELL as f64 * view.mm_per_px[0].max(view.mm_per_px[1]);
        let cells = Cells::around(part, view);
        let at = match (shape.wall_mm(), chart.geodesics()) {
            (None, None) => on_dome(&sites, chart, view),
            (Some(wall_mm), _) => {
                let lattice = lattice.get_or_init(|| Lattice::new(chart, view, &cells));
                let on_gel = |_: [f64; 2], rest: &Rest| rest.below_mm <= wall_mm + over_mm;
                drawn(camera, &sites, view, lattice, &cells, on_gel, |_, _| true)
            }
            (None, Some(geodesics)) => {
                let lattice = lattice.get_or_init(|| Lattice::new(chart, view, &Cells::all(view)));
                let on_gel = |at: [f64; 2], _: &Rest| geodesics.is_on_gel(at, over_mm);
                // Of two parts of a gel that one pixel looks through, it shows the nearer one.
                let shown = |point: DVec3, site: &Site| point.distance(site.point_mm) < 2.0 * over_mm;
                drawn(camera, &sites, view, lattice, &cells, on_gel, shown)
            }
        };
        Self { view: *view, chart: chart.clone(), sites, at, lattice }
    }

    /// A layer of the chart as the image shows it, bilinear: 0 where there is no gel, and beyond the chart.
    pub fn plane(&self, from: &Grid<f32>) -> Grid<f32> {
        self.layer(|at| bilinear(from, at).unwrap_or(0.0))
    }

    /// A mask of the chart as the image shows it: the nearest node's value, 0 where there is no gel.
    pub fn mask(&self, from: &Grid<u8>) -> Grid<u8> {
        self.layer(|[x, y]| match x >= 0.0 && y >= 0.0 {
            true if (x as usize) < from.width && (y as usize) < from.height => from.at(x as usize, y as usize),
            _ => 0,
        })
    }

    /// The smallest rectangle around the image's pixels that show a marked node.
    pub fn box_of(&self, mask: &Grid<u8>) -> Rect {
        bounding_box(&self.mask(mask), |value| value > 0)
    }

    /// The smallest rectangle around the image's pixels that show a part of the chart, or are next to one that does.
    pub fn around(&self, part: Rect) -> Rect {
        let [left, top, right, bottom] = [part.x0, part.y0, part.x1, part.y1].map(|side| side as f32);
        let shown = self.layer(|[x, y]| {
            let inside = x >= left - 1.0 && x <= right + 1.0 && y >= top - 1.0 && y <= bottom + 1.0;
            u8::from(inside)
        });
        if part.is_empty() { Rect::default() } else { bounding_box(&shown, |value| value > 0) }
    }

    /// Where a point of the chart is from the sensor's axis, mm.
    pub fn place_mm(&self, at: [f64; 2]) -> [f64; 2] {
        let DVec3 { x, y, .. } = self.chart.point_mm(at);
        [x, y]
    }

    /// A point of the gel in the sensor's frame, mm, where it is pressed in by `down_mm` at a point of the chart.
    pub fn pressed_point_mm(&self, at: [f64; 2], down_mm: f64) -> DVec3 {
        let Rest { point_mm, normal, .. } = self.chart.rest(at);
        point_mm - down_mm * normal
    }

    /// The image's size.
    pub fn size_px(&self) -> [usize; 2] {
        self.view.resolution_px
    }

    /// Unit normals of a pressed gel whose displacement on the chart is `surface`, as the image shows them: towards the inside of
    /// the gel, in the sensor's frame; (0, 0, -1) where there is no gel.
    pub fn normals(&self, surface: &Grid<f32>) -> Vec<[f32; 3]> {
        let slopes = Slopes::new(surface, &self.view);
        let normal = |index: usize| {
            self.pressed(&slopes, index).map_or([0.0, 0.0, -1.0], |(normal, _)| normal.as_vec3().to_array())
        };
        (0..self.at.len()).map(normal).collect()
    }

    /// Points of such a gel as the image shows them, in the sensor's frame, mm; 0, 0, 0 where there is no gel.
    pub fn points_mm(&self, surface: &Grid<f32>) -> Vec<[f32; 3]> {
        let down = self.plane(&surface.inner(SURFACE_BORDER));
        let point = |(site, down): (&Option<Site>, &f32)| {
            let pressed = |site: Site| site.point_mm - f64::from(*down) * site.normal;
            site.map_or([0.0; 3], |site| pressed(site).as_vec3().to_array())
        };
        self.sites.iter().zip(&down.data).map(point).collect()
    }

    /// The same at one pixel, and how far the gel is displaced there, mm; `None` where there is no gel.
    pub fn pressed(&self, slopes: &Slopes<'_>, index: usize) -> Option<(DVec3, f32)> {
        let site = self.sites[index]?;
        let at = self.at[index];
        let (Some([down, x, y]), true) = (slopes.at(at), at[0].is_finite()) else { return Some((-site.normal, 0.0)) };
        if x == 0.0 && y == 0.0 {
            return Some((-site.normal, down));
        }
        let lattice = self.lattice.get_or_init(|| Lattice::new(&self.chart, &self.view, &Cells::all(&self.view)));
        let [along_x, along_y] = lattice.gradients_at(at);
        let gradient = f64::from(x) * along_x + f64::from(y) * along_y;
        if !lattice.turns.is_empty() {
            // What is pressed in along its normals is narrower, or wider, by how these turn.
            let [turn_x, turn_y] = lattice.turns_at(at).map(|turn| f64::from(down) * turn);
            let column = |k: usize| DVec3::AXES[k] - turn_x * along_x[k] - turn_y * along_y[k];
            let kept = DMat3::from_cols(column(0), column(1), column(2));
            let slope = if kept.determinant() > 0.05 { kept.inverse() * gradient } else { gradient };
            return Some((-(site.normal + slope).normalize(), down));
        }
        // A gel that is pressed in has shrunk around its axis, on the ball along it, too.
        let shrunk = 1.0 - f64::from(down) / self.chart.radius_mm();
        let along = if site.below_mm > 0.0 { DVec3::new(0.0, 0.0, gradient.z) } else { DVec3::ZERO };
        let slope = along + (gradient - along) / shrunk.max(0.05);
        // A dent leans the gel's inside towards where it is deeper.
        Some((-(site.normal + slope).normalize(), down))
    }

    /// Motions along the x and y of the chart as the image shows them, along the sensor's x and y as the smallest turn that takes z to
    /// the gel's normal takes them there; 0 where there is no gel, and beyond the chart.
    pub fn along_gel(&self, planes: &[Grid<f32>; 2]) -> Vec<[f32; 2]> {
        let lattice = self.lattice.get_or_init(|| Lattice::new(&self.chart, &self.view, &Cells::all(&self.view)));
        let motion = |(site, at): (&Option<Site>, &[f32; 2])| {
            let site = site.as_ref().filter(|_| at[0].is_finite())?;
            let [x, y] = planes.each_ref().map(|plane| bilinear(plane, *at).map(f64::from));
            let (x, y) = (x?, y?);
            if x == 0.0 && y == 0.0 {
                return None;
            }
            let [along, down] = lattice.tangents_at(*at);
            let moved = x * along + y * down;
            let there = DQuat::from_rotation_arc(DVec3::Z, site.normal.normalize());
            Some([DVec3::X, DVec3::Y].map(|axis| (there * axis).dot(moved) as f32))
        };
        self.sites.iter().zip(&self.at).map(|pair| motion(pair).unwrap_or_default()).collect()
    }

    fn layer<T: Copy + Default>(&self, value: impl Fn([f32; 2]) -> T) -> Grid<T> {
        let [width, height] = self.view.resolution_px;
        let data = self.at.iter().map(|at| if at[0].is_finite() { value(*at) } else { T::default() }).collect();
        Grid { width, height, data }
    }
}

/// Displacement and slopes of a pressed gel on a chart.
pub struct Slopes<'a> {
    surface: &'a Grid<f32>,
    per_slope: [f32; 2],
}

impl<'a> Slopes<'a> {
    /// Of a displacement, with its border, on the nodes of `view`.
    pub fn new(surface: &'a Grid<f32>, view: &View) -> Self {
        Self { surface, per_slope: view.mm_per_px.map(|pitch| (0.5 / pitch) as f32) }
    }

    /// Between the nodes around a place, the displacement, mm, and its slopes along x and y; `None` beyond the outermost nodes.
    fn at(&self, [x, y]: [f32; 2]) -> Option<[f32; 3]> {
        let border = SURFACE_BORDER;
        let (width, height) = (self.surface.width - 2 * border, self.surface.height - 2 * border);
        let (x, y) = (x - 0.5, y - 0.5);
        let (last_x, last_y) = ((width - 1) as f32, (height - 1) as f32);
        if !(x >= -0.5 && y >= -0.5 && x <= last_x + 0.5 && y <= last_y + 0.5) {
            return None;
        }
        let (x, y) = (x.clamp(0.0, last_x), y.clamp(0.0, last_y));
        let (column, row) = (x as usize, y as usize);
        let (right, down) = (x - column as f32, y - row as f32);
        let node = |column: usize, row: usize| {
            let (column, row) = (column.min(width - 1), row.min(height - 1));
            let at = |x: usize, y: usize| self.surface.at(x, y);
            let (x, y) = (column + border, row + border);
            [
                at(x, y),
                (at(x + 1, y) - at(x - 1, y)) * self.per_slope[0],
                (at(x, y + 1) - at(x, y - 1)) * self.per_slope[1],
            ]
        };
        let between = |a: [f32; 3], b: [f32; 3], share: f32| std::array::from_fn(|k| a[k] + share * (b[k] - a[k]));
        let line = |row: usize| between(node(column, row), node(column + 1, row), right);
        Some(between(line(row), line(row + 1), down))
    }
}

/// Of each pixel of a dome's image.
fn on_dome(sites: &[Option<Site>], chart: &Chart, view: &View) -> Vec<[f32; 2]> {
    let per_mm: [f64; 2] = std::array::from_fn(|k| 1.0 / view.mm_per_px[k]);
    let middle = view.resolution_px.map(|px| px as f64 / 2.0);
    let back = chart.axes().transpose();
    let table = angles();
    let at = sites.iter().map(|site| {
        let Some(site) = site else { return [f32::NAN; 2] };
        let DVec3 { x, y, z } = back * site.normal;
        // What a look into a table does not know, beyond it.
        let place = (1.0 - z) / STEP;
        let at = match table.get(place as usize..place as usize + 2) {
            Some([here, next]) => {
                let per = chart.radius_mm() * (here + (place - libm::floor(place)) * (next - here));
                [per * x, per * y]
            }
            _ => chart.at(*site),
        };
        std::array::from_fn(|k| (at[k] * per_mm[k] + middle[k]) as f32)
    });
    at.collect()
}

/// Nodes of a chart on a side of the cells of a [`Lattice`].
const CELL: usize = 4;

/// Cells of a [`Lattice`], each by the number of its last node along x and along y.
struct Cells {
    across: Range<usize>,
    down: Range<usize>,
}

impl Cells {
    fn all(view: &View) -> Self {
        Self::around(Rect::whole(view.resolution_px[0], view.resolution_px[1]), view)
    }

    /// Those of a part of a chart.
    fn around(part: Rect, view: &View) -> Self {
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

    /// Of some cells of a chart: their nodes are known, and nobody asks for others.
    fn new(chart: &Chart, view: &View, cells: &Cells) -> Self {
        let [columns, rows] = Self::size(view);
        let known = |at: usize, cells: &Range<usize>| cells.start <= at + 1 && at < cells.end;
        let nowhere = || {
            let rest = Rest { normal: DVec3::Z, below_mm: 0.0, point_mm: DVec3::ZERO, tangents: [DVec3::ZERO; 2] };
            (rest, [DVec3::ZERO; 2])
        };
        let node = |at: usize| {
            let (column, row) = (at % columns, at / columns);
            match known(column, &cells.across) && known(row, &cells.down) {
                true => chart.rest_with_gradients(view.point_mm([column, row].map(|at| (at * CELL) as f64))),
                false => nowhere(),
            }
        };
        let (rests, gradients): (Vec<Rest>, Vec<_>) = (0..columns * rows).map(node).unzip();
        let turn = |at: usize| {
            let (column, row) = (at % columns, at / columns);
            let slope = |low: usize, high: usize, pitch_mm: f64, apart: usize| {
                (rests[high].normal - rests[low].normal) / (apart as f64 * CELL as f64 * pitch_mm)
            };
            let (left, right) = (column.saturating_sub(1), (column + 1).min(columns - 1));
            let (above, below) = (row.saturating_sub(1), (row + 1).min(rows - 1));
            [
                slope(row * columns + left, row * columns + right, view.mm_per_px[0], right - left),
                slope(above * columns + column, below * columns + column, view.mm_per_px[1], below - above),
            ]
        };
        let turns = if chart.geodesics().is_some() { (0..columns * rows).map(turn).collect() } else { Vec::new() };
        Self { columns, rests, gradients, turns }
    }

    /// Between its nodes, bilinear.
    fn gradients_at(&self, at: [f32; 2]) -> [DVec3; 2] {
        self.between(at, |node| self.gradients[node])
    }

    /// How the normals turn along the chart's x and y; of a mesh.
    fn turns_at(&self, at: [f32; 2]) -> [DVec3; 2] {
        self.between(at, |node| self.turns[node])
    }

    /// The same of the chart's own directions.
    fn tangents_at(&self, at: [f32; 2]) -> [DVec3; 2] {
        self.between(at, |node| self.rests[node].tangents).map(DVec3::normalize_or_zero)
    }

    fn between(&self, at: [f32; 2], of: impl Fn(usize) -> [DVec3; 2]) -> [DVec3; 2] {
        let rows = self.rests.len() / self.columns;
        let [x, y] = at.map(|px| f64::from(px.max(0.0)) / CELL as f64);
        let (column, row) = ((x as usize).min(self.columns - 2), (y as usize).min(rows - 2));
        let (right, down) = (x - column as f64, y - row as f64);
        let node = |dx: usize, dy: usize, k: usize| of((row + dy) * self.columns + column + dx)[k];
        [0, 1].map(|k| node(0, 0, k).lerp(node(1, 0, k), right).lerp(node(0, 1, k).lerp(node(1, 1, k), right), down))
    }
}

/// Of each pixel of the image of a capsule or a mesh: the chart is drawn into the image as triangles, on which places are linear.
/// Where it covers a part of the gel twice, the place nearer to its middle counts. Nodes count that are `on_gel`, and points of the
/// gel that are `shown` where a pixel shows another one.
fn drawn(
    camera: &Projection,
    sites: &[Option<Site>],
    view: &View,
    lattice: &Lattice,
    Cells { across, down }: &Cells,
    on_gel: impl Fn([f64; 2], &Rest) -> bool,
    shown: impl Fn(DVec3, &Site) -> bool,
) -> Vec<[f32; 2]> {
    let [width, height] = view.resolution_px;
    let columns = lattice.columns;
    let middle = view.resolution_px.map(|px| px as f64 / 2.0);
    let node = |column: usize, row: usize| {
        let place = [column, row].map(|at| (at * CELL) as f64);
        let rest = lattice.rests[row * columns + column];
        let px = camera.point_px(rest.point_mm).filter(|_| on_gel(view.point_mm(place), &rest))?;
        Some((DVec2::from_array(px), DVec2::from_array(place), rest.point_mm))
    };
    let mut at = vec![[f32::NAN; 2]; width * height];
    let mut away = vec![f32::INFINITY; width * height];
    let pitch = DVec2::from_array(view.mm_per_px);
    let mut draw = |corners: [(DVec2, DVec2, DVec3); 3]| {
        let [(a, ..), (b, ..), (c, ..)] = corners;
        let area = (b - a).perp_dot(c - a);
        if !(area.abs() > 1e-9 && area.abs() < 1e6) {
            return;
        }
        let (low, high) = (a.min(b).min(c), a.max(b).max(c));
        let span = |low: f64, high: f64, count: usize| {
            let first = libm::ceil(low - 0.5 - 1e-6).clamp(0.0, count as f64) as usize;
            first..libm::floor(high + 0.5 + 1e-6).clamp(0.0, count as f64) as usize
        };
        for y in span(low.y, high.y, height) {
            for x in span(low.x, high.x, width) {
                let p = DVec2::new(x as f64 + 0.5, y as f64 + 0.5);
                let shares = [(c - b).perp_dot(p - b), (a - c).perp_dot(p - c), (b - a).perp_dot(p - a)];
                let shares = shares.map(|share| share / area);
                if shares.iter().all(|share| *share >= -1e-6) {
                    let place: DVec2 = corners.iter().zip(shares).map(|((_, place, _), share)| share * *place).sum();
                    let point: DVec3 = corners.iter().zip(shares).map(|((.., point), share)| share * *point).sum();
                    let from_middle = ((place - DVec2::from_array(middle)) * pitch).length() as f32;
                    let index = y * width + x;
                    let shown = sites[index].as_ref().is_some_and(|site| shown(point, site));
                    if from_middle < away[index] && shown {
                        away[index] = from_middle;
                        at[index] = place.as_vec2().to_array();
                    }
                }
            }
        }
    };
    // Each node is a corner of four cells. Before the first cell of a row or column there is one node more.
    let in_row = |row: usize| (across.start.saturating_sub(1)..across.end).map(move |column| [column, row]);
    let places = (down.start.saturating_sub(1)..down.end).flat_map(in_row);
    let nodes: Vec<_> = places.map(|[column, row]| node(column, row)).collect();
    for row in 0..down.len() {
        for column in 0..across.len() {
            let corner = |dx: usize, dy: usize| nodes[(row + 1 - dy) * (across.len() + 1) + column + 1 - dx];
            if let [Some(a), Some(b), Some(c), Some(d)] = [corner(1, 1), corner(0, 1), corner(0, 0), corner(1, 0)] {
                draw([a, b, c]);
                draw([a, c, d]);
            }
        }
    }
    at
}

/// The value between the nodes around a place; the first node's centre is at (0.5, 0.5). `None` beyond the outermost
/// nodes.
pub fn bilinear(from: &Grid<f32>, [x, y]: [f32; 2]) -> Option<f32> {
    let (x, y) = (x - 0.5, y - 0.5);
    let (last_x, last_y) = ((from.width - 1) as f32, (from.height - 1) as f32);
    // Half a pixel beyond the outermost nodes is still theirs.
    if !(x >= -0.5 && y >= -0.5 && x <= last_x + 0.5 && y <= last_y + 0.5) {
        return None;
    }
    let (x, y) = (x.clamp(0.0, last_x), y.clamp(0.0, last_y));
    let (column, row) = (x as usize, y as usize);
    let (next, below) = ((column + 1).min(from.width - 1), (row + 1).min(from.height - 1));
    let (right, down) = (x - column as f32, y - row as f32);
    let line = |y: usize| from.at(column, y) + right * (from.at(next, y) - from.at(column, y));
    let (upper, lower) = (line(row), line(below));
    Some(upper + down * (lower - upper))
}
