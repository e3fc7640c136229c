//! Locates the pixels of an image on a chart: those of a dome by a formula, those of other gels by drawing the chart
//! into the image.

use glam::{DMat3, DVec2, DVec3};
use once_cell::race::OnceBox;

use super::lattice::{CellRange, Lattice, NODES_PER_CELL};
use super::{GelView, PixelContent};
use crate::base::chart::{Chart, SurfaceFrame};
use crate::base::gel::Site;
use crate::base::grid::Rect;
use crate::base::view::View;

/// Step of [`angle_over_sine_table`].
const STEP: f64 = 1.0 / 4096.0;

/// Returns a table of angles over their sines, by 1 less their cosine in steps from 0 to 1.5.
fn angle_over_sine_table() -> &'static [f64] {
    static TABLE: OnceBox<Vec<f64>> = OnceBox::new();
    TABLE.get_or_init(|| {
        let of = |step: usize| {
            let versine = step as f64 * STEP;
            let sin = libm::sqrt(versine * (2.0 - versine));
            if step == 0 { 1.0 } else { libm::atan2(sin, 1.0 - versine) / sin }
        };
        Box::new((0..=6144).map(of).collect())
    })
}

/// Locates the pixels of a dome's image: column and row on `chart`, NaN where a pixel shows no gel.
pub fn locate_dome_pixels(sites: &[Option<Site>], chart: &Chart, view: &View) -> Vec<[f32; 2]> {
    let per_mm: [f64; 2] = std::array::from_fn(|k| 1.0 / view.mm_per_px[k]);
    let middle = view.resolution_px.map(|px| px as f64 / 2.0);
    let to_chart_axes = chart.axes().transpose();
    let table = angle_over_sine_table();
    let at = sites.iter().map(|site| {
        let Some(site) = site else { return [f32::NAN; 2] };
        let DVec3 { x, y, z } = to_chart_axes * site.normal;
        // The table has no entries beyond 1.5; such places are computed.
        let place = (1.0 - z) / STEP;
        let at = match table.get(place as usize..place as usize + 2) {
            Some([here, next]) => {
                let per = chart.radius_mm() * (here + (place - libm::floor(place)) * (next - here));
                [per * x, per * y]
            }
            _ => chart.locate_site(*site),
        };
        std::array::from_fn(|k| (at[k] * per_mm[k] + middle[k]) as f32)
    });
    at.collect()
}

/// A chart of a capsule or of a mesh, to be drawn into an image.
pub struct ChartRasteriser<'a> {
    /// The gel, and the camera that sees it.
    pub gel: &'a GelView,
    /// The nodes of the chart before its rotation.
    pub lattice: &'a Lattice,
    /// The rotation that takes the sensor's axes to those of the chart.
    pub turn: DMat3,
}

impl ChartRasteriser<'_> {
    /// Locates the pixels of an image: column and row on the chart, NaN where a pixel shows none of these cells. Also
    /// returns the part of the image outside which all are NaN.
    ///
    /// The chart is drawn as triangles, on which places are linear. Where it covers a part of the gel twice, the place
    /// nearer to its middle counts. Only nodes that are `on_gel` are drawn. `shown` decides whether a point of the gel
    /// counts at a pixel that shows another point; without it, every one does.
    pub fn locate_pixels(
        &self,
        view: &View,
        CellRange { across, down }: &CellRange,
        on_gel: impl Fn([f64; 2], &SurfaceFrame) -> bool,
        shown: Option<impl Fn(DVec3, &Site) -> bool>,
    ) -> (Vec<[f32; 2]>, Rect) {
        let [width, height] = view.resolution_px;
        let node = |[column, row]: [usize; 2]| {
            let place = [column, row].map(|at| (at * NODES_PER_CELL) as f64);
            let rest = &self.lattice.rests[row * self.lattice.columns + column];
            if !on_gel(view.point_mm(place), rest) {
                return None;
            }
            let point = self.turn * rest.point_mm;
            Some((DVec2::from_array(self.gel.camera.point_px(point)?), DVec2::from_array(place), point))
        };
        // A cell is named by its last node, so there is one node more before the first cell of a row or of a column.
        let in_row = |row: usize| (across.start.saturating_sub(1)..across.end).map(move |column| [column, row]);
        let nodes: Vec<_> = (down.start.saturating_sub(1)..down.end).flat_map(in_row).map(node).collect();
        let mut image = ChartImage {
            sites: &self.gel.sites,
            contents: &self.gel.contents,
            size: [width, height],
            middle: DVec2::from_array(view.resolution_px.map(|px| px as f64 / 2.0)),
            pixel_size_mm: DVec2::from_array(view.mm_per_px),
            chart_px: vec![[f32::NAN; 2]; width * height],
            distance_mm: vec![f32::INFINITY; width * height],
            part: Rect::default(),
        };
        for row in 0..down.len() {
            for column in 0..across.len() {
                let corner = |dx: usize, dy: usize| nodes[(row + 1 - dy) * (across.len() + 1) + column + 1 - dx];
                if let [Some(a), Some(b), Some(c), Some(d)] = [corner(1, 1), corner(0, 1), corner(0, 0), corner(1, 0)] {
                    image.draw_triangle([a, b, c], shown.as_ref());
                    image.draw_triangle([a, c, d], shown.as_ref());
                }
            }
        }
        (image.chart_px, image.part)
    }
}

/// An image into which a chart is drawn.
struct ChartImage<'a> {
    sites: &'a [Option<Site>],
    contents: &'a [PixelContent],
    size: [usize; 2],
    /// Middle of the chart, in its pixels.
    middle: DVec2,
    pixel_size_mm: DVec2,
    chart_px: Vec<[f32; 2]>,
    /// How far the place of each pixel is from the chart's middle, mm.
    distance_mm: Vec<f32>,
    part: Rect,
}

impl ChartImage<'_> {
    /// Draws a triangle; each corner is known in the image, on the chart and in space.
    fn draw_triangle<F: Fn(DVec3, &Site) -> bool>(&mut self, corners: [(DVec2, DVec2, DVec3); 3], shown: Option<&F>) {
        let [width, height] = self.size;
        let [(a, on_chart, point), (b, ..), (c, ..)] = corners;
        let (along, down) = (b - a, c - a);
        let area = along.perp_dot(down);
        // A triangle that is seen edge-on has no inside; one that is larger than any image, or NaN, is not drawn
        // either.
        if !(area.abs() > 1e-9 && area.abs() < 1e6) {
            return;
        }
        let (low, high) = (a.min(b).min(c), a.max(b).max(c));
        let span = |low: f64, high: f64, count: usize| {
            let [low, high] = [low - 0.5 - 1e-6, high + 0.5 + 1e-6].map(|px| px.clamp(0.0, count as f64));
            // Rounds up without a call of `ceil`.
            let first = low as usize;
            first + usize::from((first as f64) < low)..high as usize
        };
        let (columns, rows) = (span(low.x, high.x, width), span(low.y, high.y, height));
        if columns.is_empty() || rows.is_empty() {
            return;
        }
        let (along, down) = (along / area, down / area);
        let chart = [corners[1].1 - on_chart, corners[2].1 - on_chart];
        let space = [corners[1].2 - point, corners[2].2 - point];
        for y in rows.clone() {
            for x in columns.clone() {
                let from = DVec2::new(x as f64 + 0.5, y as f64 + 0.5) - a;
                // Weights of the second and of the third corner.
                let (second, third) = (from.perp_dot(down), along.perp_dot(from));
                // The tolerance leaves no gap between neighbouring triangles.
                if !(second >= -1e-6 && third >= -1e-6 && second + third <= 1.0 + 1e-6) {
                    continue;
                }
                let index = y * width + x;
                let place = on_chart + second * chart[0] + third * chart[1];
                let from_middle = ((place - self.middle) * self.pixel_size_mm).length() as f32;
                let nearer = from_middle < self.distance_mm[index];
                if !nearer || self.contents[index] == PixelContent::Nothing {
                    continue;
                }
                let is_shown = |shown: &F| {
                    let point = point + second * space[0] + third * space[1];
                    self.sites[index].as_ref().is_some_and(|site| shown(point, site))
                };
                if shown.is_none_or(is_shown) {
                    self.distance_mm[index] = from_middle;
                    self.chart_px[index] = place.as_vec2().to_array();
                }
            }
        }
        let drawn = Rect { x0: columns.start, y0: rows.start, x1: columns.end, y1: rows.end };
        self.part = self.part.union(drawn);
    }
}
