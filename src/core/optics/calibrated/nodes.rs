//! The pixels of a coarse grid at which coefficients are found, and the polynomials between them.

use super::kernel::Kernel;
use super::response::{DEGREES, FACTORS, INPUTS, OUTPUTS, Response, TERMS};
use crate::core::base::grid::{Grid, Rect};
use crate::core::base::light::Light;
use crate::core::base::simd::simd_dispatch;
use crate::core::base::view::SURFACE_BORDER;
use crate::core::base::view::View;
use crate::core::optics::coarse::{Coarse, Values};
use crate::core::optics::led::Normals;

/// A part of a coarse grid, and where it is in the view.
pub struct Nodes<'a> {
    pub coarse: Coarse,
    pub view: &'a View,
    /// Of the pixels of [`Coarse::thinned`].
    pub part: Rect,
}

impl<'a> Nodes<'a> {
    /// Those that pixels of `region` lie between.
    pub fn around(region: Rect, coarse: Coarse, view: &'a View) -> Self {
        let (size, start) = (coarse.size(view.resolution_px), coarse.start(view.resolution_px));
        let node = |k: usize, at: usize| {
            (at as isize - start[k]).div_euclid(coarse.factor as isize).clamp(0, size[k] as isize - 1) as usize
        };
        let along = |k: usize, from: usize, to: usize| (node(k, from), (node(k, to - 1) + 2).min(size[k]));
        let ((x0, x1), (y0, y1)) = (along(0, region.x0, region.x1), along(1, region.y0, region.y1));
        Self { coarse, view, part: Rect { x0, y0, x1, y1 } }
    }

    /// What the network gives at each node, one plane per output, row-major. Without a surface, of a flat pad; `shares` are
    /// those of the sky that are seen.
    pub fn outputs(
        &self,
        response: &Response,
        kernel: &Kernel,
        surface: Option<&Grid<f32>>,
        shares: &[Option<Values>],
    ) -> Vec<Vec<f32>> {
        let inputs = self.inputs(response, surface, shares);
        let mut outputs = vec![Vec::new(); OUTPUTS];
        simd_dispatch(
            #[inline(always)]
            || kernel.run(&inputs, &mut outputs),
        );
        outputs
    }

    fn inputs(
        &self,
        response: &Response,
        surface: Option<&Grid<f32>>,
        shares: &[Option<Values>],
    ) -> [Vec<f32>; INPUTS] {
        let (size, factor) = (self.view.resolution_px, self.coarse.factor);
        let start = self.coarse.start(size);
        let mut inputs: [Vec<f32>; INPUTS] = std::array::from_fn(|_| Vec::with_capacity(self.part.area()));
        let [low, high] = response.heights_mm;
        let [heights, xs, ys, sky @ ..] = &mut inputs;
        let place = |k: usize, node: usize| start[k] + (node * factor) as isize;
        for row in self.part.y0..self.part.y1 {
            for column in self.part.x0..self.part.x1 {
                let [x, y] = [place(0, column), place(1, row)];
                let [x_mm, y_mm] = self.view.point_mm([x as f64 + 0.5, y as f64 + 0.5]);
                xs.push(x_mm as f32 / response.place_mm);
                ys.push(y_mm as f32 / response.place_mm);
                let border = SURFACE_BORDER as isize;
                let w = surface.map_or(0.0, |surface| surface.at((x + border) as usize, (y + border) as usize));
                heights.push(w.clamp(low, high) / response.height_mm);
            }
        }
        for (k, plane) in sky.iter_mut().enumerate() {
            match shares.get(k) {
                Some(Some(seen)) => self.hidden(seen, plane),
                _ => plane.resize(self.part.area(), 0.0),
            }
        }
        inputs
    }

    /// Shares that are hidden. They are not known in the surface's border: there they are those of the nearest node.
    fn hidden(&self, seen: &Values, plane: &mut Vec<f32>) {
        let size = self.view.resolution_px;
        let first = self.coarse.start(size).map(|start| start + (SURFACE_BORDER * self.coarse.factor) as isize);
        // Columns and rows of the grid that `seen` leaves out.
        let skipped: [usize; 2] = std::array::from_fn(|k| {
            ((seen.first[k] - first[k]) / self.coarse.factor as isize) as usize + SURFACE_BORDER
        });
        let at = |node: usize, k: usize, count: usize| node.saturating_sub(skipped[k]).min(count - 1);
        for row in self.part.y0..self.part.y1 {
            let seen_row = seen.values.row(at(row, 1, seen.values.height));
            let columns = self.part.x0..self.part.x1;
            plane.extend(columns.map(|column| 1.0 - seen_row[at(column, 0, seen.values.width)]));
        }
    }
}

/// Pixels of a row for which is decided together up to which degree terms count.
const RUN_PX: usize = 64;
/// Change of a channel that may be left out with terms of higher degrees, as a share of full scale: a tenth of a level.
const LEFT_OUT: f64 = 0.1 / 255.0;
/// The last term up to each degree from 1, or one of the next degree: terms are added in pairs.
const LAST: [usize; 4] = [2, 6, 10, 14];

/// Polynomials whose coefficients are linear between nodes, and go on beyond the outermost ones.
pub struct Between {
    /// One for each output.
    coefficients: Vec<Values>,
    steepest: f32,
    /// Squared length of (n_x, n_y) up to which terms of degrees 1, 2 and 3 are enough.
    enough: [f32; 3],
}

/// Memory for rows of the view.
#[derive(Default)]
pub struct Rows {
    /// Of the row that is added next.
    pub normals: Normals,
    terms: [Vec<f32>; TERMS],
    /// The row of nodes at or above that row.
    node: Option<usize>,
    /// Each coefficient along it, at all pixels of the region, and how much it grows to the next row of nodes.
    line: Vec<f32>,
    step: Vec<f32>,
}

impl Between {
    /// From outputs at the nodes.
    pub fn new(nodes: &Nodes<'_>, outputs: Vec<Vec<f32>>, steepest: f32) -> Self {
        let Nodes { coarse, view, part } = nodes;
        let start = coarse.start(view.resolution_px);
        let first = std::array::from_fn(|k| start[k] + ([part.x0, part.y0][k] * coarse.factor) as isize);
        let enough = enough(&outputs);
        let values = |plane| Values {
            factor: coarse.factor,
            first,
            values: Grid { width: part.width(), height: part.height(), data: plane },
        };
        Self { coefficients: outputs.into_iter().map(values).collect(), steepest, enough }
    }

    /// Adds the polynomials at the normals of row `row` of the light's region.
    #[inline(always)]
    pub fn add_row(&self, light: &mut Light, row: usize, rows: &mut Rows) {
        let (region, width) = (light.region, light.region.width());
        let Values { factor, first, values } = &self.coefficients[0];
        let offset = (region.y0 + row) as isize - first[1];
        let offset = offset.clamp(0, ((values.height - 1) * factor) as isize) as usize;
        let (node, down) = (offset / factor, (offset % factor) as f32 / *factor as f32);
        if rows.node != Some(node) {
            self.set_lines(node, region, rows);
        }
        let mut planes = light.planes.each_mut().map(|plane| &mut plane[row * width..][..width]);
        for x0 in (0..width).step_by(RUN_PX) {
            let run = x0..(x0 + RUN_PX).min(width);
            let (nx, ny) = (&rows.normals.x[run.clone()], &rows.normals.y[run.clone()]);
            let last = LAST[self.degree(nx, ny) - 1];
            set_terms(nx, ny, self.steepest, &mut rows.terms[..=last]);
            for (channel, plane) in planes.iter_mut().enumerate() {
                let plane = &mut plane[run.clone()];
                let coefficient = |m: usize| {
                    let first = (channel * TERMS + m) * width + x0;
                    (&rows.line[first..][..run.len()], &rows.step[first..][..run.len()])
                };
                add_line(plane, coefficient(0), down);
                for m in (1..last).step_by(2) {
                    let terms = [&rows.terms[m][..], &rows.terms[m + 1][..]];
                    add_products(plane, terms, [coefficient(m), coefficient(m + 1)], down);
                }
            }
        }
    }

    /// The degree of the terms that count at these normals.
    #[inline(always)]
    fn degree(&self, nx: &[f32], ny: &[f32]) -> usize {
        // Floats from 0 up are ordered like their bits, and eight whole numbers are compared at a time.
        let mut most = 0;
        for (x, y) in nx.iter().zip(ny) {
            most = most.max((x * x + y * y).to_bits());
        }
        let beyond = |enough: &&f32| most > enough.to_bits();
        1 + self.enough.iter().filter(beyond).count()
    }

    /// The coefficients along a row of nodes, and the steps to the next one, if there is one.
    #[inline(always)]
    fn set_lines(&self, node: usize, region: Rect, rows: &mut Rows) {
        let width = region.width();
        rows.node = Some(node);
        rows.line.resize(OUTPUTS * width, 0.0);
        rows.step.resize(OUTPUTS * width, 0.0);
        let lines = rows.line.chunks_exact_mut(width).zip(rows.step.chunks_exact_mut(width));
        for (values, (line, step)) in self.coefficients.iter().zip(lines) {
            values.node_row(node, region.x0, line);
            values.node_row((node + 1).min(values.values.height - 1), region.x0, step);
            for (step, here) in step.iter_mut().zip(&*line) {
                *step -= here;
            }
        }
    }
}

/// Squared length of (n_x, n_y) up to which the terms beyond degrees 1, 2 and 3 change no channel by more than
/// [`LEFT_OUT`], whatever of these coefficients belongs to it.
fn enough(outputs: &[Vec<f32>]) -> [f32; 3] {
    let largest: Vec<f64> = outputs
        .iter()
        .map(|plane| f64::from(plane.iter().fold(0.0_f32, |largest, value| largest.max(value.abs()))))
        .collect();
    std::array::from_fn(|k| {
        let beyond = |length: f64| {
            let of = |channel: usize| -> f64 {
                let higher = (0..TERMS).filter(|m| DEGREES[*m] > k as i32 + 1);
                higher.map(|m| largest[channel * TERMS + m] * libm::pow(length, f64::from(DEGREES[m]))).sum()
            };
            (0..3).map(of).fold(0.0, f64::max)
        };
        let (mut low, mut high) = (0.0, 1.0);
        for _ in 0..30 {
            let middle = 0.5 * (low + high);
            if beyond(middle) <= LEFT_OUT { low = middle } else { high = middle }
        }
        (low * low) as f32
    })
}

/// Adds a line and a share of the step to the next.
#[inline(always)]
fn add_line(sums: &mut [f32], (line, step): (&[f32], &[f32]), share: f32) {
    for ((sum, line), step) in sums.iter_mut().zip(line).zip(step) {
        *sum += line + step * share;
    }
}

/// Adds two terms times their coefficients. Two at once halve the stores; more pointers than these, and the compiler would
/// not check that they lie apart, and take one number at a time.
#[inline(always)]
fn add_products(sums: &mut [f32], terms: [&[f32]; 2], [a, b]: [(&[f32], &[f32]); 2], share: f32) {
    let count = sums.len();
    let (terms_a, terms_b) = (&terms[0][..count], &terms[1][..count]);
    let ((line_a, step_a), (line_b, step_b)) = ((&a.0[..count], &a.1[..count]), (&b.0[..count], &b.1[..count]));
    for k in 0..count {
        let first = terms_a[k] * (line_a[k] + step_a[k] * share);
        sums[k] += first + terms_b[k] * (line_b[k] + step_b[k] * share);
    }
}

/// The first terms at normals no steeper than `steepest`; the constant one is left out.
#[inline(always)]
fn set_terms(nx: &[f32], ny: &[f32], steepest: f32, terms: &mut [Vec<f32>]) {
    let count = nx.len();
    for plane in terms.iter_mut() {
        plane.resize(RUN_PX, 0.0);
    }
    let [_, y, x, higher @ ..] = terms else { return };
    let (nx, ny, x, y) = (&nx[..count], &ny[..count], &mut x[..count], &mut y[..count]);
    for k in 0..count {
        let length = (nx[k] * nx[k] + ny[k] * ny[k]).sqrt();
        let kept = if length > steepest { steepest / length } else { 1.0 };
        (x[k], y[k]) = (nx[k] * kept, ny[k] * kept);
    }
    let first = TERMS - FACTORS.len();
    for (number, [a, b]) in (first..first + higher.len()).zip(FACTORS) {
        let (known, new) = terms.split_at_mut(number);
        for ((product, a), b) in new[0].iter_mut().zip(&known[a]).zip(&known[b]) {
            *product = a * b;
        }
    }
}
