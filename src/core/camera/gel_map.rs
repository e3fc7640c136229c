//! Where the pixels of an image lie on a chart of a curved gel, and the chart's layers as the image shows them.

use std::sync::{Arc, OnceLock};

use glam::{DMat3, DQuat, DVec3, Vec3};

use super::projection::Projection;
use crate::base::chart::{Chart, Latitude, Rest};
use crate::base::gel::{GelShape, Site};
use crate::base::grid::{Grid, Rect, bounding_box};
use crate::base::view::{SURFACE_BORDER, View};
use crate::depth::raster::SAMPLES;
use crate::gelpad::subpixel::{BEND, OFFSETS};
use crate::optics::skin::BentSkin;
use drawn::{Drawn, on_dome};
use lattice::{CELL, Cells, Lattice};
use skin_at::SkinAt;

mod drawn;
mod lattice;
mod skin_at;

/// What a camera shows of an untouched gel, and what is the same of charts in every press.
#[derive(Debug)]
pub struct GelView {
    shape: GelShape,
    camera: Projection,
    /// The nodes of a chart; as many as the image has pixels.
    view: View,
    /// What the pixels show of the gel, row by row.
    sites: Vec<Option<Site>>,
    /// The same in short, as it is asked for in every press.
    shows: Vec<Shows>,
    /// The part of the image outside of which no pixel shows any.
    part: Rect,
    /// Unit normals towards the inside of the gel; (0, 0, -1) where there is none.
    inwards: [Vec<f32>; 3],
    /// Of each latitude, of a dome or of a mesh's chart around its tip, once it is asked for.
    lattices: Vec<OnceLock<Arc<Lattice>>>,
}

/// What a pixel shows.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
enum Shows {
    /// No gel.
    #[default]
    Nothing,
    /// A wall: it is below the middle of a capsule's cap.
    Wall,
    /// Any other part of a gel.
    Gel,
}

impl Shows {
    fn new(site: &Option<Site>) -> Self {
        match site {
            None => Self::Nothing,
            Some(site) if site.below_mm > 0.0 => Self::Wall,
            Some(_) => Self::Gel,
        }
    }
}

impl GelView {
    /// Of a gel whose charts have the nodes of `view`.
    pub(crate) fn new(shape: GelShape, camera: Projection, view: View) -> Self {
        let [width, height] = view.resolution_px;
        let centre = |at: usize| [(at % width) as f64 + 0.5, (at / width) as f64 + 0.5];
        let sites: Vec<Option<Site>> = (0..width * height).map(|at| camera.site(&shape, centre(at))).collect();
        let seen = Grid { width, height, data: sites.iter().map(Shows::new).collect() };
        let part = bounding_box(&seen, |shows| shows != Shows::Nothing);
        let inwards = [0, 1, 2].map(|k| {
            let normal = |site: &Option<Site>| site.map_or(DVec3::NEG_Z, |site| -site.normal);
            sites.iter().map(|site| normal(site)[k] as f32).collect()
        });
        let latitudes = shape.wall_mm().map_or(1, |_| Latitude::count(&shape));
        let lattices = (0..latitudes).map(|_| OnceLock::new()).collect();
        Self { shape, camera, view, sites, shows: seen.data, part, inwards, lattices }
    }

    /// What the image's pixels show of the gel, row by row.
    pub(crate) fn sites(&self) -> &[Option<Site>] {
        &self.sites
    }

    /// Unit normals of the untouched gel towards its inside, a plane per component; (0, 0, -1) where there is no gel.
    pub(crate) fn inwards(&self) -> [&[f32]; 3] {
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
    pub(crate) fn new(gel: &Arc<GelView>, chart: &Chart, part: Rect) -> Self {
        let lattice = OnceLock::new();
        let GelView { shape, view, sites, .. } = &**gel;
        let over_mm = CELL as f64 * view.mm_per_px[0].max(view.mm_per_px[1]);
        let drawn = || {
            let (lattice, turn) = lattice.get_or_init(|| gel.lattice(chart));
            Drawn { gel, lattice, turn: *turn }
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
    pub(crate) fn plane(&self, from: &Grid<f32>) -> Grid<f32> {
        self.layer(|at| bilinear(from, at).unwrap_or(0.0))
    }

    /// A mask of the chart as the image shows it: the nearest node's value, 0 where there is no gel.
    pub(crate) fn mask(&self, from: &Grid<u8>) -> Grid<u8> {
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
    pub(crate) fn around(&self, part: Rect) -> Rect {
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
    pub(crate) fn pressed_point_mm(&self, at: [f64; 2], down_mm: f64) -> DVec3 {
        let Rest { point_mm, normal, .. } = self.chart.rest(at);
        point_mm - down_mm * normal
    }

    /// The image's size.
    pub(crate) fn size_px(&self) -> [usize; 2] {
        self.gel.view.resolution_px
    }

    /// Unit normals of a pressed gel whose displacement on the chart is `surface`, nothing outside of `touched`, as the image shows
    /// them: towards the inside of the gel, in the sensor's frame; (0, 0, -1) where there is no gel.
    pub(crate) fn normals(&self, surface: &Grid<f32>, touched: Rect) -> Vec<[f32; 3]> {
        let [width, height] = self.size_px();
        let [x, y, z] = self.pressed(&self.skin(surface, touched), Rect::whole(width, height)).normals;
        x.into_iter().zip(y).zip(z).map(|((x, y), z)| [x, y, z]).collect()
    }

    /// Points of such a gel as the image shows them, in the sensor's frame, mm; 0, 0, 0 where there is no gel.
    pub(crate) fn points_mm(&self, surface: &Grid<f32>) -> Vec<[f32; 3]> {
        let down = self.plane(&surface.inner(SURFACE_BORDER));
        let point = |(site, down): (&Option<Site>, &f32)| {
            let pressed = |site: Site| site.point_mm - f64::from(*down) * site.normal;
            site.map_or([0.0; 3], |site| pressed(site).as_vec3().to_array())
        };
        self.gel.sites.iter().zip(&down.data).map(point).collect()
    }

    /// Such a gel as a part of the image shows it.
    pub(crate) fn pressed(&self, skin: &SkinAt<'_>, part: Rect) -> PressedPart {
        let GelView { view, inwards, .. } = &*self.gel;
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
                let Some((normal, down)) = skin.at(*at, row.start + x) else { continue };
                down_mm[x] = down;
                normals.iter_mut().zip(normal.to_array()).for_each(|(plane, value)| plane[first + x] = value);
            }
        }
        PressedPart { normals, down_mm }
    }

    /// The pixels of a part within which such a gel bends, and its normals at [`OFFSETS`] from their centres; `pressed` is what the
    /// part shows, in which nothing is pressed but `within` another one.
    pub(crate) fn bent(&self, skin: &SkinAt<'_>, (part, within): (Rect, Rect), pressed: &PressedPart) -> Vec<BentSkin> {
        let width = self.gel.view.resolution_px[0];
        let (columns, rows) = (within.width(), within.height());
        let in_part = |x: usize, y: usize| (within.y0 + y - part.y0) * part.width() + within.x0 + x - part.x0;
        // How far a press has turned each pixel's normal, and by how much more or less that of the next one.
        let mut turned = Vec::with_capacity(within.area());
        for y in 0..rows {
            let (here, index) = (in_part(0, y), (within.y0 + y) * width + within.x0);
            turned.extend((0..columns).map(|x| {
                Vec3::from_array([0, 1, 2].map(|k| pressed.normals[k][here + x] - self.gel.inwards[k][index + x]))
            }));
        }
        let mut weight = Grid::new(columns, rows);
        for (x, y) in (0..rows).flat_map(|y| (0..columns).map(move |x| (x, y))) {
            for (dx, dy) in [(1, 0), (0, 1)] {
                if x + dx >= columns || y + dy >= rows {
                    continue;
                }
                let bend = (turned[(y + dy) * columns + x + dx] - turned[y * columns + x]).length_squared();
                if bend > BEND * BEND {
                    let most = ((bend.sqrt() - BEND) / BEND).min(1.0);
                    // Of both pixels, and those beside them.
                    let around = Rect { x0: x, y0: y, x1: x + dx + 1, y1: y + dy + 1 }.grown(1, columns, rows);
                    for y in around.y0..around.y1 {
                        let row = &mut weight.row_mut(y)[around.x0..around.x1];
                        row.iter_mut().for_each(|weight: &mut f32| *weight = weight.max(most));
                    }
                }
            }
        }
        let pixel = |(at, weight): (usize, &f32)| {
            let place = in_part(at % columns, at / columns);
            let [x, y] = [within.x0 + at % columns, within.y0 + at / columns];
            let index = y * width + x;
            let here = self.at[index];
            let (along, down) = (self.step(index, x, width, 1)?, self.step(index, y, self.size_px()[1], width)?);
            let rest = skin.rest(index);
            let mut normals = [[0.0; SAMPLES]; 3];
            for (sample, [right, below]) in OFFSETS.iter().map(|offset| offset.map(|px| px as f32)).enumerate() {
                let there = [0, 1].map(|k| here[k] + right * along[k] + below * down[k]);
                let normal = skin.at(there, index).map_or(rest, |(normal, _)| normal).to_array();
                normals.iter_mut().zip(normal).for_each(|(plane, value)| plane[sample] = value);
            }
            Some(BentSkin { at: place, weight: *weight, normals })
        };
        weight.data.iter().enumerate().filter(|(_, weight)| **weight > 0.0).filter_map(pixel).collect()
    }

    /// How far on the chart the next pixel is, along one axis of the image; `None` where the gel that is shown ends or is another part.
    fn step(&self, index: usize, at: usize, count: usize, stride: usize) -> Option<[f32; 2]> {
        /// Nodes.
        const FARTHEST: f32 = 16.0;
        let before = if at > 0 { index - stride } else { index };
        let after = if at + 1 < count { index + stride } else { index };
        let known = [before, index, after].map(|index| Some(self.at[index]).filter(|at| at[0].is_finite()));
        let (from, to, steps) = match known {
            [Some(before), Some(_), Some(after)] => (before, after, ((at > 0) as u8 + (at + 1 < count) as u8) as f32),
            [Some(before), Some(here), None] if at > 0 => (before, here, 1.0),
            [None, Some(here), Some(after)] if at + 1 < count => (here, after, 1.0),
            _ => return None,
        };
        let step = [0, 1].map(|k| (to[k] - from[k]) / steps.max(1.0));
        step.iter().all(|nodes| nodes.abs() < FARTHEST).then_some(step)
    }

    /// A layer of a part of the chart, `there`, as a part of the image shows it, bilinear, row by row; `beyond` elsewhere.
    pub(crate) fn layer_of_part(&self, from: &Grid<f32>, there: Rect, part: Rect, beyond: f32) -> Vec<f32> {
        let width = self.gel.view.resolution_px[0];
        let origin = [there.x0 as f32, there.y0 as f32];
        let pixels = (part.y0..part.y1).flat_map(|y| &self.at[y * width + part.x0..y * width + part.x1]);
        pixels.map(|at| bilinear(from, [at[0] - origin[0], at[1] - origin[1]]).unwrap_or(beyond)).collect()
    }

    /// A gel whose displacement on the chart is `surface`, nothing outside of `touched`, between the chart's nodes.
    pub(crate) fn skin(&self, surface: &Grid<f32>, touched: Rect) -> SkinAt<'_> {
        let (lattice, turn) = self.lattice.get_or_init(|| self.gel.lattice(&self.chart));
        SkinAt::new(&self.gel, self.chart.radius_mm(), (lattice, *turn), surface, touched)
    }

    /// Motions along the x and y of the chart as the image shows them, along the sensor's x and y as the smallest turn that takes z to
    /// the gel's normal takes them there; 0 where there is no gel, and beyond the chart.
    pub(crate) fn along_gel(&self, planes: &[Grid<f32>; 2]) -> Vec<[f32; 2]> {
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
