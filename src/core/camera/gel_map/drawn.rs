//! Where the pixels of an image lie on a chart: of a dome by a formula, of other gels by drawing the chart into the image.

use std::sync::OnceLock;

use glam::{DMat3, DVec2, DVec3};

use super::lattice::{CELL, Cells, Lattice};
use super::{GelView, Shows};
use crate::base::chart::{Chart, Rest};
use crate::base::gel::Site;
use crate::base::grid::Rect;
use crate::base::view::View;

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

/// Of each pixel of a dome's image.
pub fn on_dome(sites: &[Option<Site>], chart: &Chart, view: &View) -> Vec<[f32; 2]> {
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

/// A chart of a capsule or a mesh that is drawn into an image.
pub struct Drawn<'a> {
    /// The gel, and the camera that sees it.
    pub gel: &'a GelView,
    /// The nodes of the chart, before it is turned.
    pub lattice: &'a Lattice,
    /// From the sensor's axes before the turn to those after it.
    pub turn: DMat3,
}

impl Drawn<'_> {
    /// Column and row on the chart of each pixel, no numbers where it shows none of these cells; and the part of the image
    /// outside of which none does. The chart is drawn as triangles, on which places are linear. Where it covers a part of the gel
    /// twice, the place nearer to its middle counts. Nodes count that are `on_gel`, and points of the gel that are `shown` where a
    /// pixel shows another one.
    pub fn places(
        &self,
        view: &View,
        Cells { across, down }: &Cells,
        on_gel: impl Fn([f64; 2], &Rest) -> bool,
        shown: Option<impl Fn(DVec3, &Site) -> bool>,
    ) -> (Vec<[f32; 2]>, Rect) {
        let [width, height] = view.resolution_px;
        let node = |[column, row]: [usize; 2]| {
            let place = [column, row].map(|at| (at * CELL) as f64);
            let rest = &self.lattice.rests[row * self.lattice.columns + column];
            if !on_gel(view.point_mm(place), rest) {
                return None;
            }
            let point = self.turn * rest.point_mm;
            Some((DVec2::from_array(self.gel.camera.point_px(point)?), DVec2::from_array(place), point))
        };
        // Each node is a corner of four cells. Before the first cell of a row or column there is one node more.
        let in_row = |row: usize| (across.start.saturating_sub(1)..across.end).map(move |column| [column, row]);
        let nodes: Vec<_> = (down.start.saturating_sub(1)..down.end).flat_map(in_row).map(node).collect();
        let mut image = Image {
            sites: &self.gel.sites,
            shows: &self.gel.shows,
            size: [width, height],
            middle: DVec2::from_array(view.resolution_px.map(|px| px as f64 / 2.0)),
            pitch: DVec2::from_array(view.mm_per_px),
            at: vec![[f32::NAN; 2]; width * height],
            away: vec![f32::INFINITY; width * height],
            part: Rect::default(),
        };
        for row in 0..down.len() {
            for column in 0..across.len() {
                let corner = |dx: usize, dy: usize| nodes[(row + 1 - dy) * (across.len() + 1) + column + 1 - dx];
                if let [Some(a), Some(b), Some(c), Some(d)] = [corner(1, 1), corner(0, 1), corner(0, 0), corner(1, 0)] {
                    image.draw([a, b, c], shown.as_ref());
                    image.draw([a, c, d], shown.as_ref());
                }
            }
        }
        (image.at, image.part)
    }
}

/// An image into which a chart is drawn.
struct Image<'a> {
    sites: &'a [Option<Site>],
    shows: &'a [Shows],
    size: [usize; 2],
    /// Of the chart.
    middle: DVec2,
    pitch: DVec2,
    at: Vec<[f32; 2]>,
    /// How far each pixel's place is from the chart's middle, mm.
    away: Vec<f32>,
    part: Rect,
}

impl Image<'_> {
    /// Draws a triangle, of which each corner is known in the image, on the chart and in space.
    fn draw<F: Fn(DVec3, &Site) -> bool>(&mut self, corners: [(DVec2, DVec2, DVec3); 3], shown: Option<&F>) {
        let [width, height] = self.size;
        let [(a, on_chart, point), (b, ..), (c, ..)] = corners;
        let (along, down) = (b - a, c - a);
        let area = along.perp_dot(down);
        if !(area.abs() > 1e-9 && area.abs() < 1e6) {
            return;
        }
        let (low, high) = (a.min(b).min(c), a.max(b).max(c));
        let span = |low: f64, high: f64, count: usize| {
            let [low, high] = [low - 0.5 - 1e-6, high + 0.5 + 1e-6].map(|px| px.clamp(0.0, count as f64));
            // Rounded up without a call.
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
                // Shares of the second and third corner.
                let (second, third) = (from.perp_dot(down), along.perp_dot(from));
                if !(second >= -1e-6 && third >= -1e-6 && second + third <= 1.0 + 1e-6) {
                    continue;
                }
                let index = y * width + x;
                let place = on_chart + second * chart[0] + third * chart[1];
                let from_middle = ((place - self.middle) * self.pitch).length() as f32;
                let nearer = from_middle < self.away[index];
                if !nearer || self.shows[index] == Shows::Nothing {
                    continue;
                }
                let is_shown = |shown: &F| {
                    let point = point + second * space[0] + third * space[1];
                    self.sites[index].as_ref().is_some_and(|site| shown(point, site))
                };
                if shown.is_none_or(is_shown) {
                    self.away[index] = from_middle;
                    self.at[index] = place.as_vec2().to_array();
                }
            }
        }
        let drawn = Rect { x0: columns.start, y0: rows.start, x1: columns.end, y1: rows.end };
        self.part = self.part.united(drawn);
    }
}
