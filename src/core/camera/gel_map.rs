//! Where the pixels of an image lie on a chart of a curved gel, and the layers of the chart as the image shows them.

use std::sync::Arc;

use glam::{DMat3, DQuat, DVec3, Vec3};
use once_cell::race::OnceBox;

use super::projection::Projection;
use crate::base::chart::{Chart, Latitude, SurfaceFrame};
use crate::base::gel::{GelShape, Site};
use crate::base::grid::{Grid, Rect, bounding_box};
use crate::base::view::{SURFACE_BORDER, View};
use crate::depth::raster::SAMPLES;
use crate::gelpad::subpixel::{MIN_BEND, SAMPLE_OFFSETS};
use crate::optics::skin::BentSkin;
use chart_rasteriser::{ChartRasteriser, locate_dome_pixels};
use lattice::{CellRange, Lattice, NODES_PER_CELL};
use skin_interpolator::SkinInterpolator;

mod chart_rasteriser;
mod lattice;
mod skin_interpolator;

/// What a camera sees of an untouched gel, and what charts have in common in every press.
#[derive(Debug)]
pub struct GelView {
    shape: GelShape,
    camera: Projection,
    /// The nodes of a chart: as many as the image has pixels.
    view: View,
    /// The point of the gel that each pixel shows, row by row; `None` where it shows no gel.
    sites: Vec<Option<Site>>,
    /// What each pixel shows, without the point: every press reads it.
    contents: Vec<PixelContent>,
    /// The part of the image outside which no pixel shows any gel.
    part: Rect,
    /// Unit normals towards the inside of the gel, a plane per component; (0, 0, -1) where there is no gel.
    inward_normals: [Vec<f32>; 3],
    /// The gel over charts, computed on first use: one for each latitude of a capsule, one for a dome, and for a mesh
    /// that of the chart around its tip.
    lattices: Vec<OnceBox<Arc<Lattice>>>,
}

/// What a pixel shows.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
enum PixelContent {
    /// No gel.
    #[default]
    Nothing,
    /// A wall: below the middle of the ball that ends a capsule.
    Wall,
    /// Any other part of a gel.
    Gel,
}

impl PixelContent {
    fn new(site: &Option<Site>) -> Self {
        match site {
            None => Self::Nothing,
            Some(site) if site.below_mm > 0.0 => Self::Wall,
            Some(_) => Self::Gel,
        }
    }
}

impl GelView {
    /// Prepares the image of a gel whose charts have the nodes of `view`.
    pub(crate) fn new(shape: GelShape, camera: Projection, view: View) -> Self {
        let [width, height] = view.resolution_px;
        let centre = |at: usize| [(at % width) as f64 + 0.5, (at / width) as f64 + 0.5];
        let sites: Vec<Option<Site>> = (0..width * height).map(|at| camera.site(&shape, centre(at))).collect();
        let seen = Grid { width, height, data: sites.iter().map(PixelContent::new).collect() };
        let part = bounding_box(&seen, |shows| shows != PixelContent::Nothing);
        let inward_normals = [0, 1, 2].map(|k| {
            let normal = |site: &Option<Site>| site.map_or(DVec3::NEG_Z, |site| -site.normal);
            sites.iter().map(|site| normal(site)[k] as f32).collect()
        });
        let latitudes = shape.wall_mm().map_or(1, |_| Latitude::count_on(&shape));
        let lattices = (0..latitudes).map(|_| OnceBox::new()).collect();
        Self { shape, camera, view, sites, contents: seen.data, part, inward_normals, lattices }
    }

    /// Returns the point of the gel that each pixel shows, row by row; `None` where it shows no gel.
    pub(crate) fn pixel_sites(&self) -> &[Option<Site>] {
        &self.sites
    }

    /// Returns the unit normals of the untouched gel towards its inside, a plane per component; (0, 0, -1) where there
    /// is no gel.
    pub(crate) fn inward_normals(&self) -> [&[f32]; 3] {
        self.inward_normals.each_ref().map(|plane| &plane[..])
    }

    /// Returns the gel over a chart before a rotation, and that rotation: charts that differ by it alone share one
    /// lattice.
    fn chart_lattice(&self, chart: &Chart) -> (Arc<Lattice>, DMat3) {
        let of = |chart: &Chart| Arc::new(Lattice::new(chart, &self.view));
        let known =
            |number: usize, chart: &Chart| Arc::clone(self.lattices[number].get_or_init(|| Box::new(of(chart))));
        match (chart.geodesics(), self.shape.surface()) {
            (Some(geodesics), Some(surface)) if Arc::ptr_eq(surface.tip_chart(), geodesics) => {
                (known(0, chart), DMat3::IDENTITY)
            }
            (Some(_), _) => (of(chart), DMat3::IDENTITY),
            (None, _) => {
                let number = chart.latitude().index();
                (known(number, &Chart::before_rotation(&self.shape, number)), chart.base_rotation())
            }
        }
    }
}

/// Where the pixels of an image lie on a chart, and what they show of it.
#[derive(Clone, Debug)]
pub struct GelMap {
    gel: Arc<GelView>,
    chart: Chart,
    /// Column and row on the chart, in pixels of its view; NaN where the image shows no gel, or a part of it outside
    /// the chart.
    chart_px: Vec<[f32; 2]>,
    /// The part of the image outside which all are NaN.
    part: Rect,
    /// The gel over the chart before a rotation, and that rotation; computed on first use.
    lattice: OnceBox<(Arc<Lattice>, DMat3)>,
}

/// A pressed gel as the pixels of a part of the image show it, row by row.
pub struct PressedPart {
    /// Unit normals towards the inside of the gel, in the sensor's frame; (0, 0, -1) where there is no gel.
    pub normals: [Vec<f32>; 3],
    /// How far the gel is pressed in, mm.
    pub displacement_mm: Vec<f32>,
}

impl GelMap {
    /// Locates the pixels of an image on a chart. Except for the chart of a dome, only its part `part` is located;
    /// nothing is shown outside it.
    pub(crate) fn new(gel: &Arc<GelView>, chart: &Chart, part: Rect) -> Self {
        let lattice = OnceBox::new();
        let GelView { shape, view, sites, .. } = &**gel;
        let over_mm = NODES_PER_CELL as f64 * view.mm_per_px[0].max(view.mm_per_px[1]);
        let rasteriser = || {
            let (lattice, turn) = lattice.get_or_init(|| Box::new(gel.chart_lattice(chart)));
            ChartRasteriser { gel, lattice, turn: *turn }
        };
        let cells = CellRange::around(part, view);
        let (chart_px, part) = match (shape.wall_mm(), chart.geodesics()) {
            (None, None) => (locate_dome_pixels(sites, chart, view), gel.part),
            (Some(wall_mm), _) => {
                let everywhere: Option<fn(DVec3, &Site) -> bool> = None;
                rasteriser().locate_pixels(view, &cells, |_, rest| rest.below_mm <= wall_mm + over_mm, everywhere)
            }
            (None, Some(geodesics)) => {
                // Where a pixel looks through two parts of the gel, it shows the nearer one: points of the other part
                // are left out.
                let shown = |point: DVec3, site: &Site| point.distance(site.point_mm) < 2.0 * over_mm;
                rasteriser().locate_pixels(view, &cells, |at, _| geodesics.is_on_gel(at, over_mm), Some(shown))
            }
        };
        Self { gel: Arc::clone(gel), chart: chart.clone(), chart_px, part, lattice }
    }

    /// Returns a layer of the chart as the image shows it, bilinear; 0 where there is no gel, and outside the chart.
    pub(crate) fn warp_plane(&self, from: &Grid<f32>) -> Grid<f32> {
        self.map_pixels(|at| interpolate_bilinear(from, at).unwrap_or(0.0))
    }

    /// Returns a mask of the chart as the image shows it: the nearest node's value, 0 where there is no gel.
    pub(crate) fn warp_mask(&self, from: &Grid<u8>) -> Grid<u8> {
        self.map_pixels(|[x, y]| match x >= 0.0 && y >= 0.0 {
            true if (x as usize) < from.width && (y as usize) < from.height => from.at(x as usize, y as usize),
            _ => 0,
        })
    }

    /// Returns the smallest rectangle around the image's pixels that show a marked node.
    pub fn box_of(&self, mask: &Grid<u8>) -> Rect {
        bounding_box(&self.warp_mask(mask), |value| value > 0)
    }

    /// Returns the smallest rectangle around the image's pixels that show a part of the chart or are next to one that
    /// does.
    pub(crate) fn image_rect_of(&self, part: Rect) -> Rect {
        let [left, top, right, bottom] = [part.x0, part.y0, part.x1, part.y1].map(|side| side as f32);
        if part.is_empty() {
            return Rect::default();
        }
        let mut around = Rect::default();
        for y in self.part.y0..self.part.y1 {
            // Comparisons with NaN are false, so pixels without gel are not inside.
            let inside =
                |[x, y]: &[f32; 2]| *x >= left - 1.0 && *x <= right + 1.0 && *y >= top - 1.0 && *y <= bottom + 1.0;
            let row = self.chart_row(y);
            if let (Some(first), Some(last)) = (row.iter().position(inside), row.iter().rposition(inside)) {
                let (x0, x1) = (self.part.x0 + first, self.part.x0 + last + 1);
                around = around.union(Rect { x0, y0: y, x1, y1: y + 1 });
            }
        }
        around
    }

    /// Returns how far a point of the chart is from the sensor's axis along x and y, mm.
    pub fn place_mm(&self, at: [f64; 2]) -> [f64; 2] {
        let DVec3 { x, y, .. } = self.chart.point_mm(at);
        [x, y]
    }

    /// Returns the point of the gel at a point of the chart, pressed in by `down_mm`, in the sensor's frame, mm.
    pub(crate) fn pressed_point_mm(&self, at: [f64; 2], down_mm: f64) -> DVec3 {
        let SurfaceFrame { point_mm, normal, .. } = self.chart.surface_frame(at);
        point_mm - down_mm * normal
    }

    /// Returns the width and height of the image, px.
    pub(crate) fn size_px(&self) -> [usize; 2] {
        self.gel.view.resolution_px
    }

    /// Computes the unit normals of a pressed gel as the image shows them: towards the inside of the gel, in the
    /// sensor's frame; (0, 0, -1) where there is no gel.
    ///
    /// `surface` is the gel's displacement on the chart, which is 0 outside `touched`.
    pub(crate) fn normals(&self, surface: &Grid<f32>, touched: Rect) -> Vec<[f32; 3]> {
        let [width, height] = self.size_px();
        let [x, y, z] =
            self.compute_pressed_part(&self.skin_interpolator(surface, touched), Rect::whole(width, height)).normals;
        x.into_iter().zip(y).zip(z).map(|((x, y), z)| [x, y, z]).collect()
    }

    /// Computes the points of a pressed gel as the image shows them, in the sensor's frame, mm; (0, 0, 0) where there
    /// is no gel. `surface` is the gel's displacement on the chart.
    pub(crate) fn points_mm(&self, surface: &Grid<f32>) -> Vec<[f32; 3]> {
        let down = self.warp_plane(&surface.inner(SURFACE_BORDER));
        let point = |(site, down): (&Option<Site>, &f32)| {
            let pressed = |site: Site| site.point_mm - f64::from(*down) * site.normal;
            site.map_or([0.0; 3], |site| pressed(site).as_vec3().to_array())
        };
        self.gel.sites.iter().zip(&down.data).map(point).collect()
    }

    /// Computes normals and displacement of a pressed gel on a part of the image.
    pub(crate) fn compute_pressed_part(&self, skin: &SkinInterpolator<'_>, part: Rect) -> PressedPart {
        let GelView { view, inward_normals, .. } = &*self.gel;
        let [width, _] = view.resolution_px;
        let mut normals = [(); 3].map(|()| Vec::with_capacity(part.area()));
        let mut displacement_mm = vec![0.0; part.area()];
        for (y, displacement_mm) in (part.y0..part.y1).zip(displacement_mm.chunks_exact_mut(part.width().max(1))) {
            let row = y * width + part.x0..y * width + part.x1;
            for (normals, inward) in normals.iter_mut().zip(inward_normals) {
                normals.extend_from_slice(&inward[row.clone()]);
            }
            let first = normals[0].len() - part.width();
            for (x, at) in self.chart_px[row.clone()].iter().enumerate() {
                let Some((normal, down)) = skin.normal_and_displacement_at(*at, row.start + x) else { continue };
                displacement_mm[x] = down;
                normals.iter_mut().zip(normal.to_array()).for_each(|(plane, value)| plane[first + x] = value);
            }
        }
        PressedPart { normals, displacement_mm }
    }

    /// Finds the pixels within which a pressed gel bends, and its normals at [`SAMPLE_OFFSETS`] from their centres.
    ///
    /// `pressed` is what `part` of the image shows; only `within`, a part of that, is pressed in.
    pub(crate) fn find_bent_pixels(
        &self,
        skin: &SkinInterpolator<'_>,
        (part, within): (Rect, Rect),
        pressed: &PressedPart,
    ) -> Vec<BentSkin> {
        let width = self.gel.view.resolution_px[0];
        let (columns, rows) = (within.width(), within.height());
        let in_part = |x: usize, y: usize| (within.y0 + y - part.y0) * part.width() + within.x0 + x - part.x0;
        // How far a press has turned the normal of each pixel. A pixel bends where the next one's has turned by more or
        // by less.
        let mut turned = Vec::with_capacity(within.area());
        for y in 0..rows {
            let (here, index) = (in_part(0, y), (within.y0 + y) * width + within.x0);
            turned.extend((0..columns).map(|x| {
                Vec3::from_array(
                    [0, 1, 2].map(|k| pressed.normals[k][here + x] - self.gel.inward_normals[k][index + x]),
                )
            }));
        }
        let mut weight = Grid::new(columns, rows);
        for (x, y) in (0..rows).flat_map(|y| (0..columns).map(move |x| (x, y))) {
            for (dx, dy) in [(1, 0), (0, 1)] {
                if x + dx >= columns || y + dy >= rows {
                    continue;
                }
                let bend = (turned[(y + dy) * columns + x + dx] - turned[y * columns + x]).length_squared();
                if bend > MIN_BEND * MIN_BEND {
                    let most = ((bend.sqrt() - MIN_BEND) / MIN_BEND).min(1.0);
                    // Both pixels and those beside them are sampled.
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
            let here = self.chart_px[index];
            let (along, down) = (
                self.chart_step_per_pixel(index, x, width, 1)?,
                self.chart_step_per_pixel(index, y, self.size_px()[1], width)?,
            );
            let rest = skin.rest_normal(index);
            let mut normals = [[0.0; SAMPLES]; 3];
            for (sample, [right, below]) in SAMPLE_OFFSETS.iter().map(|offset| offset.map(|px| px as f32)).enumerate() {
                let sample_px = [0, 1].map(|k| here[k] + right * along[k] + below * down[k]);
                let normal =
                    skin.normal_and_displacement_at(sample_px, index).map_or(rest, |(normal, _)| normal).to_array();
                normals.iter_mut().zip(normal).for_each(|(plane, value)| plane[sample] = value);
            }
            Some(BentSkin { index: place, weight: *weight, normals })
        };
        weight.data.iter().enumerate().filter(|(_, weight)| **weight > 0.0).filter_map(pixel).collect()
    }

    /// Returns how far apart neighbouring pixels are on the chart, along one axis of the image; `None` where the gel
    /// that is shown ends or where the next pixel shows another part of it.
    fn chart_step_per_pixel(&self, index: usize, at: usize, count: usize, stride: usize) -> Option<[f32; 2]> {
        /// Nodes; a larger step leads to another part of the gel.
        const FARTHEST: f32 = 16.0;
        let before = if at > 0 { index - stride } else { index };
        let after = if at + 1 < count { index + stride } else { index };
        let known = [before, index, after].map(|index| Some(self.chart_px[index]).filter(|at| at[0].is_finite()));
        let (from, to, steps) = match known {
            [Some(before), Some(_), Some(after)] => (before, after, ((at > 0) as u8 + (at + 1 < count) as u8) as f32),
            [Some(before), Some(here), None] if at > 0 => (before, here, 1.0),
            [None, Some(here), Some(after)] if at + 1 < count => (here, after, 1.0),
            _ => return None,
        };
        let step = [0, 1].map(|k| (to[k] - from[k]) / steps.max(1.0));
        step.iter().all(|nodes| nodes.abs() < FARTHEST).then_some(step)
    }

    /// Returns a layer of the part `source` of the chart as a part of the image shows it, bilinear, row by row;
    /// `outside` where that shows nothing of `source`.
    pub(crate) fn warp_part(&self, from: &Grid<f32>, source: Rect, part: Rect, outside: f32) -> Vec<f32> {
        let width = self.gel.view.resolution_px[0];
        let origin = [source.x0 as f32, source.y0 as f32];
        let pixels = (part.y0..part.y1).flat_map(|y| &self.chart_px[y * width + part.x0..y * width + part.x1]);
        pixels.map(|at| interpolate_bilinear(from, [at[0] - origin[0], at[1] - origin[1]]).unwrap_or(outside)).collect()
    }

    /// Prepares the interpolation of a pressed gel between the chart's nodes. `surface` is its displacement on the
    /// chart, which is 0 outside `touched`.
    pub(crate) fn skin_interpolator(&self, surface: &Grid<f32>, touched: Rect) -> SkinInterpolator<'_> {
        let (lattice, turn) = self.lattice.get_or_init(|| Box::new(self.gel.chart_lattice(&self.chart)));
        SkinInterpolator::new(&self.gel, self.chart.radius_mm(), (lattice, *turn), surface, touched)
    }

    /// Returns motions along the x and y of the chart as the image shows them; 0 where there is no gel, and outside the
    /// chart.
    ///
    /// They are along the sensor's x and y, taken to each point by the smallest rotation that takes z to the gel's
    /// normal.
    pub(crate) fn warp_motion(&self, planes: &[Grid<f32>; 2]) -> Vec<[f32; 2]> {
        let (lattice, turn) = self.lattice.get_or_init(|| Box::new(self.gel.chart_lattice(&self.chart)));
        let motion = |(site, at): (&Option<Site>, &[f32; 2])| {
            let site = site.as_ref().filter(|_| at[0].is_finite())?;
            let [x, y] = planes.each_ref().map(|plane| interpolate_bilinear(plane, *at).map(f64::from));
            let (x, y) = (x?, y?);
            if x == 0.0 && y == 0.0 {
                return None;
            }
            let [along, down] = lattice.tangents_at(*at).map(|tangent| *turn * tangent.as_dvec3());
            let moved = x * along + y * down;
            let tilt = DQuat::from_rotation_arc(DVec3::Z, site.normal.normalize());
            Some([DVec3::X, DVec3::Y].map(|axis| (tilt * axis).dot(moved) as f32))
        };
        self.gel.sites.iter().zip(&self.chart_px).map(|pair| motion(pair).unwrap_or_default()).collect()
    }

    /// Returns the places on the chart of row `y` of the image, in the columns of `part`.
    fn chart_row(&self, y: usize) -> &[[f32; 2]] {
        let row = y * self.gel.view.resolution_px[0];
        &self.chart_px[row + self.part.x0..row + self.part.x1]
    }

    /// Makes a layer of the image from the place of each pixel on the chart; pixels without a place have the default
    /// value.
    fn map_pixels<T: Copy + Default>(&self, value: impl Fn([f32; 2]) -> T) -> Grid<T> {
        let [width, height] = self.size_px();
        let mut layer = Grid::new(width, height);
        for y in self.part.y0..self.part.y1 {
            for (to, at) in layer.row_mut(y)[self.part.x0..].iter_mut().zip(self.chart_row(y)) {
                if at[0].is_finite() {
                    *to = value(*at);
                }
            }
        }
        layer
    }
}

/// Interpolates between the nodes around a place, bilinear; the first node's centre is at (0.5, 0.5). Returns `None`
/// more than half a pixel outside the outermost nodes.
pub fn interpolate_bilinear(from: &Grid<f32>, [x, y]: [f32; 2]) -> Option<f32> {
    let (x, y) = (x - 0.5, y - 0.5);
    let (last_x, last_y) = ((from.width - 1) as f32, (from.height - 1) as f32);
    // Half a pixel outside the outermost nodes still belongs to them.
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
