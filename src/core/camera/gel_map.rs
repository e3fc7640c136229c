//! Where the pixels of an image lie on a chart of a curved gel, and the chart's layers as the image shows them.

use std::sync::{Arc, OnceLock};

use glam::{DMat3, DQuat, DVec3, Mat3, Vec3};

use super::projection::Projection;
use crate::core::base::chart::{Chart, Latitude, Rest};
use crate::core::base::gel::{GelShape, Site};
use crate::core::base::grid::{Grid, Rect, bounding_box};
use crate::core::base::view::{SURFACE_BORDER, View};
use drawn::{Drawn, on_dome};
use lattice::{CELL, Cells, Lattice};

mod drawn;
mod lattice;

/// What a camera shows of an untouched gel, and what is the same of charts in every press.
#[derive(Debug)]
pub struct GelView {
    shape: GelShape,
    camera: Projection,
    /// The nodes of a chart; as many as the image has pixels.
    view: View,
    /// What the pixels show of the gel, row by row.
    sites: Vec<Option<Site>>,
    /// The part of the image outside of which no pixel shows any.
    part: Rect,
    /// Unit normals towards the inside of the gel; (0, 0, -1) where there is none.
    inwards: [Vec<f32>; 3],
    /// Of each latitude, of a dome or of a mesh's chart around its tip, once it is asked for.
    lattices: Vec<OnceLock<Arc<Lattice>>>,
}

impl GelView {
    /// Of a gel whose charts have the nodes of `view`.
    pub fn new(shape: GelShape, camera: Projection, view: View) -> Self {
        let [width, height] = view.resolution_px;
        let centre = |at: usize| [(at % width) as f64 + 0.5, (at / width) as f64 + 0.5];
        let sites: Vec<Option<Site>> = (0..width * height).map(|at| camera.site(&shape, centre(at))).collect();
        let seen = Grid { width, height, data: sites.iter().map(|site| u8::from(site.is_some())).collect() };
        let part = bounding_box(&seen, |seen| seen > 0);
        let inwards = [0, 1, 2].map(|k| {
            let normal = |site: &Option<Site>| site.map_or(DVec3::NEG_Z, |site| -site.normal);
            sites.iter().map(|site| normal(site)[k] as f32).collect()
        });
        let latitudes = shape.wall_mm().map_or(1, |_| Latitude::count(&shape));
        let lattices = (0..latitudes).map(|_| OnceLock::new()).collect();
        Self { shape, camera, view, sites, part, inwards, lattices }
    }

    /// What the image's pixels show of the gel, row by row.
    pub fn sites(&self) -> &[Option<Site>] {
        &self.sites
    }

    /// Unit normals of the untouched gel towards its inside, a plane per component; (0, 0, -1) where there is no gel.
    pub fn inwards(&self) -> [&[f32]; 3] {
        self.inwards.each_ref().map(|plane| &plane[..])
    }

    /// The gel over a chart, before the turn that this returns, too.
    fn lattice(&self, chart: &Chart) -> (Arc<Lattice>, DMat3) {
        let of = |chart: &Chart| Arc::new(Lattice::new(chart, &self.view));
        let known = |number: usize, chart: &Chart| Arc::clone(self.lattices[number].get_or_init(|| of(chart)));
        match (chart.geodesics(), self.shape.surface()) {
            (Some(geodesics), Some(surface)) if Arc::ptr_eq(surface.around_tip(), geodesics) => {
                (known(0, chart), DMat3::IDENTITY)
            }
            (Some(_), _) => (of(chart), DMat3::IDENTITY),
            (None, _) => {
                let number = chart.latitude().number();
                (known(number, &Chart::before_turn(&self.shape, number)), chart.turn())
            }
        }
    }
}

/// Where the pixels of an image lie on a chart.
#[derive(Clone, Debug)]
pub struct GelMap {
    gel: Arc<GelView>,
    chart: Chart,
    /// Column and row on the chart, in pixels of its view; no numbers where the image shows no gel, or one that is beyond
    /// the chart.
    at: Vec<[f32; 2]>,
    /// The part of the image outside of which there are none.
    part: Rect,
    lattice: OnceLock<(Arc<Lattice>, DMat3)>,
}

/// A pressed gel as the pixels of a part of the image show it, row by row.
pub struct PressedPart {
    /// Unit normals towards the inside of the gel, in the sensor's frame; (0, 0, -1) where there is no gel.
    pub normals: [Vec<f32>; 3],
    /// How far the gel is displaced, mm.
    pub down_mm: Vec<f32>,
}

impl GelMap {
    /// Of a chart. But for a dome's only a part is looked for: outside of it there is nothing to be shown.
    pub fn new(gel: &Arc<GelView>, chart: &Chart, part: Rect) -> Self {
        let lattice = OnceLock::new();
        let GelView { shape, camera, view, sites, .. } = &**gel;
        let over_mm = CELL as f64 * view.mm_per_px[0].max(view.mm_per_px[1]);
        let drawn = || {
            let (lattice, turn) = lattice.get_or_init(|| gel.lattice(chart));
            Drawn { camera, sites, lattice, turn: *turn }
        };
        let cells = Cells::around(part, view);
        let (at, part) = match (shape.wall_mm(), chart.geodesics()) {
            (None, None) => (on_dome(sites, chart, view), gel.part),
            (Some(wall_mm), _) => {
                let everywhere: Option<fn(DVec3, &Site) -> bool> = None;
                drawn().places(view, &cells, |_, rest| rest.below_mm <= wall_mm + over_mm, everywhere)
            }
            (None, Some(geodesics)) => {
                // Of two parts of a gel that one pixel looks through, it shows the nearer one.
                let shown = |point: DVec3, site: &Site| point.distance(site.point_mm) < 2.0 * over_mm;
                drawn().places(view, &cells, |at, _| geodesics.is_on_gel(at, over_mm), Some(shown))
            }
        };
        Self { gel: Arc::clone(gel), chart: chart.clone(), at, part, lattice }
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
        if part.is_empty() {
            return Rect::default();
        }
        let mut around = Rect::default();
        for y in self.part.y0..self.part.y1 {
            // No comparison is true of what is no number.
            let inside =
                |[x, y]: &[f32; 2]| *x >= left - 1.0 && *x <= right + 1.0 && *y >= top - 1.0 && *y <= bottom + 1.0;
            let row = self.row(y);
            if let (Some(first), Some(last)) = (row.iter().position(inside), row.iter().rposition(inside)) {
                let (x0, x1) = (self.part.x0 + first, self.part.x0 + last + 1);
                around = around.united(Rect { x0, y0: y, x1, y1: y + 1 });
            }
        }
        around
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
        self.gel.view.resolution_px
    }

    /// Unit normals of a pressed gel whose displacement on the chart is `surface`, nothing outside of `touched`, as the image shows
    /// them: towards the inside of the gel, in the sensor's frame; (0, 0, -1) where there is no gel.
    pub fn normals(&self, surface: &Grid<f32>, touched: Rect) -> Vec<[f32; 3]> {
        let [width, height] = self.size_px();
        let [x, y, z] = self.pressed(surface, touched, Rect::whole(width, height)).normals;
        x.into_iter().zip(y).zip(z).map(|((x, y), z)| [x, y, z]).collect()
    }

    /// Points of such a gel as the image shows them, in the sensor's frame, mm; 0, 0, 0 where there is no gel.
    pub fn points_mm(&self, surface: &Grid<f32>) -> Vec<[f32; 3]> {
        let down = self.plane(&surface.inner(SURFACE_BORDER));
        let point = |(site, down): (&Option<Site>, &f32)| {
            let pressed = |site: Site| site.point_mm - f64::from(*down) * site.normal;
            site.map_or([0.0; 3], |site| pressed(site).as_vec3().to_array())
        };
        self.gel.sites.iter().zip(&down.data).map(point).collect()
    }

    /// Such a gel as a part of the image shows it.
    pub fn pressed(&self, surface: &Grid<f32>, touched: Rect, part: Rect) -> PressedPart {
        let GelView { view, sites, inwards, .. } = &*self.gel;
        let slopes = Slopes::new(surface, touched, view);
        let (lattice, turn) = self.lattice.get_or_init(|| self.gel.lattice(&self.chart));
        let (turn, per_radius) = (turn.as_mat3(), (1.0 / self.chart.radius_mm()) as f32);
        let [width, _] = view.resolution_px;
        let mut normals = [(); 3].map(|()| Vec::with_capacity(part.area()));
        let mut down_mm = vec![0.0; part.area()];
        for (y, down_mm) in (part.y0..part.y1).zip(down_mm.chunks_exact_mut(part.width().max(1))) {
            let row = y * width + part.x0..y * width + part.x1;
            for (normals, inwards) in normals.iter_mut().zip(inwards) {
                normals.extend_from_slice(&inwards[row.clone()]);
            }
            let first = normals[0].len() - part.width();
            for (x, at) in self.at[row.clone()].iter().enumerate() {
                let Some([down, along_x, along_y]) = slopes.at(*at) else { continue };
                down_mm[x] = down;
                if along_x == 0.0 && along_y == 0.0 {
                    continue;
                }
                let [gradient_x, gradient_y] = lattice.gradients_at(*at);
                let gradient = turn * (along_x * gradient_x + along_y * gradient_y);
                let slope = match lattice.turns_at(*at) {
                    // What is pressed in along its normals is narrower, or wider, by how these turn.
                    Some(turns) => {
                        let [turn_x, turn_y] = turns.map(|turn| down * turn);
                        let column = |k: usize| Vec3::AXES[k] - turn_x * gradient_x[k] - turn_y * gradient_y[k];
                        let kept = Mat3::from_cols(column(0), column(1), column(2));
                        if kept.determinant() > 0.05 { kept.inverse() * gradient } else { gradient }
                    }
                    // A round gel has shrunk around its axis, on the ball along it, too.
                    None => {
                        let on_wall = sites[row.start + x].is_some_and(|site| site.below_mm > 0.0);
                        let along = if on_wall { Vec3::new(0.0, 0.0, gradient.z) } else { Vec3::ZERO };
                        along + (gradient - along) / (1.0 - down * per_radius).max(0.05)
                    }
                };
                // A dent leans the gel's inside towards where it is deeper.
                let rest = Vec3::from_array(normals.each_ref().map(|plane| plane[first + x]));
                let normal = (rest - slope).normalize();
                normals.iter_mut().zip(normal.to_array()).for_each(|(plane, value)| plane[first + x] = value);
            }
        }
        PressedPart { normals, down_mm }
    }

    /// Motions along the x and y of the chart as the image shows them, along the sensor's x and y as the smallest turn that takes z to
    /// the gel's normal takes them there; 0 where there is no gel, and beyond the chart.
    pub fn along_gel(&self, planes: &[Grid<f32>; 2]) -> Vec<[f32; 2]> {
        let (lattice, turn) = self.lattice.get_or_init(|| self.gel.lattice(&self.chart));
        let motion = |(site, at): (&Option<Site>, &[f32; 2])| {
            let site = site.as_ref().filter(|_| at[0].is_finite())?;
            let [x, y] = planes.each_ref().map(|plane| bilinear(plane, *at).map(f64::from));
            let (x, y) = (x?, y?);
            if x == 0.0 && y == 0.0 {
                return None;
            }
            let [along, down] = lattice.tangents_at(*at).map(|tangent| *turn * tangent.as_dvec3());
            let moved = x * along + y * down;
            let there = DQuat::from_rotation_arc(DVec3::Z, site.normal.normalize());
            Some([DVec3::X, DVec3::Y].map(|axis| (there * axis).dot(moved) as f32))
        };
        self.gel.sites.iter().zip(&self.at).map(|pair| motion(pair).unwrap_or_default()).collect()
    }

    /// Places on the chart of a row of the part that has any.
    fn row(&self, y: usize) -> &[[f32; 2]] {
        let row = y * self.gel.view.resolution_px[0];
        &self.at[row + self.part.x0..row + self.part.x1]
    }

    fn layer<T: Copy + Default>(&self, value: impl Fn([f32; 2]) -> T) -> Grid<T> {
        let [width, height] = self.size_px();
        let mut layer = Grid::new(width, height);
        for y in self.part.y0..self.part.y1 {
            for (to, at) in layer.row_mut(y)[self.part.x0..].iter_mut().zip(self.row(y)) {
                if at[0].is_finite() {
                    *to = value(*at);
                }
            }
        }
        layer
    }
}

/// Displacement and slopes of a pressed gel at the nodes of a chart.
struct Slopes {
    /// The nodes outside of which there are none.
    part: Rect,
    size: [usize; 2],
    /// Row by row: displacement, mm, its slopes along x and y, and nothing: a vector of four numbers.
    nodes: Vec<[f32; 4]>,
}

impl Slopes {
    /// Of a displacement, with its border, on the nodes of `view`; it is nothing outside of `touched`.
    fn new(surface: &Grid<f32>, touched: Rect, view: &View) -> Self {
        let size = view.resolution_px;
        let part = touched.grown(1, size[0], size[1]);
        let per_slope = view.mm_per_px.map(|pitch| (0.5 / pitch) as f32);
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

    /// Between the nodes around a place, the displacement, mm, and its slopes along x and y; `None` beyond the outermost nodes, and
    /// where they have none.
    #[inline(always)]
    fn at(&self, [x, y]: [f32; 2]) -> Option<[f32; 3]> {
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
        let node = |column: usize, row: usize| match part.holds([column, row]) {
            true => nodes[(row - part.y0) * part.width() + column - part.x0],
            false => [0.0; 4],
        };
        let (next, below) = ((column + 1).min(width - 1), (row + 1).min(height - 1));
        let (a, b, c, d) = (node(column, row), node(next, row), node(column, below), node(next, below));
        let between: [f32; 4] = std::array::from_fn(|k| {
            let (upper, lower) = (a[k] + right * (b[k] - a[k]), c[k] + right * (d[k] - c[k]));
            upper + down * (lower - upper)
        });
        let [down_mm, along_x, along_y, _] = between;
        Some([down_mm, along_x, along_y])
    }
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
