//! The pixels of a coarse grid at which coefficients are computed, and the polynomials between them.

use std::ops::Range;

use pulp::{Simd, WithSimd};

use super::kernel::Kernel;
use super::response::{CalibrationResponse, INPUTS, OUTPUTS, TERM_DEGREES, TERM_FACTORS, TERMS};
use crate::base::grid::{Grid, Rect};
use crate::base::light::Light;
use crate::base::simd::{dispatch_kernel, largest_value};
use crate::base::view::SURFACE_BORDER;
use crate::base::view::View;
use crate::optics::coarse::{CoarseGrid, CoarseValues};
use crate::optics::led::Normals;

/// A part of a coarse grid, and where it is in the view.
pub struct Nodes<'a> {
    pub coarse: CoarseGrid,
    pub view: &'a View,
    /// Rectangle of the pixels of [`CoarseGrid::subsample`].
    pub part: Rect,
}

impl<'a> Nodes<'a> {
    /// Returns the nodes that the pixels of `region` lie between.
    pub fn around(region: Rect, coarse: CoarseGrid, view: &'a View) -> Self {
        let (size, start) = (coarse.subsampled_size(view.resolution_px), coarse.subsampled_origin(view.resolution_px));
        let node = |k: usize, at: usize| {
            (at as isize - start[k]).div_euclid(coarse.factor as isize).clamp(0, size[k] as isize - 1) as usize
        };
        let along = |k: usize, from: usize, to: usize| (node(k, from), (node(k, to - 1) + 2).min(size[k]));
        let ((x0, x1), (y0, y1)) = (along(0, region.x0, region.x1), along(1, region.y0, region.y1));
        Self { coarse, view, part: Rect { x0, y0, x1, y1 } }
    }

    /// Evaluates the network at each node: one plane per output, row-major. Without a surface, the pad is flat.
    /// `shares` are the fractions of each sector of the sky that are seen.
    pub fn evaluate_network(
        &self,
        response: &CalibrationResponse,
        kernel: &Kernel,
        surface: Option<&Grid<f32>>,
        shares: &[Option<CoarseValues>],
    ) -> Vec<Vec<f32>> {
        let inputs = self.gather_inputs(response, surface, shares);
        let mut outputs = vec![Vec::new(); OUTPUTS];
        kernel.run(&inputs, &mut outputs);
        outputs
    }

    /// Gathers the inputs of the network at each node: a plane each for displacement, place and hidden sky.
    fn gather_inputs(
        &self,
        response: &CalibrationResponse,
        surface: Option<&Grid<f32>>,
        shares: &[Option<CoarseValues>],
    ) -> [Vec<f32>; INPUTS] {
        let (size, factor) = (self.view.resolution_px, self.coarse.factor);
        let start = self.coarse.subsampled_origin(size);
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
                Some(Some(seen)) => self.fill_hidden_sky(seen, plane),
                _ => plane.resize(self.part.area(), 0.0),
            }
        }
        inputs
    }

    /// Fills in the fraction of a sector that is hidden at each node. It is not known in the surface's border: there it
    /// is that of the nearest node.
    fn fill_hidden_sky(&self, seen: &CoarseValues, plane: &mut Vec<f32>) {
        let size = self.view.resolution_px;
        let first =
            self.coarse.subsampled_origin(size).map(|start| start + (SURFACE_BORDER * self.coarse.factor) as isize);
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

/// Pixels of a row for which the degree of the terms that count is decided together.
const RUN_PX: usize = 64;
/// Change of a channel that may be left out with terms of higher degrees, as a fraction of full scale: a tenth of a
/// level.
const NEGLIGIBLE_CHANGE: f64 = 0.1 / 255.0;
/// The last term of each degree from 1 on, or one of the next degree: terms are added in pairs.
const LAST_TERM_BY_DEGREE: [usize; 4] = [2, 6, 10, 14];

/// Polynomials whose coefficients are linear between nodes, and constant outside the outermost ones.
pub struct InterpolatedPolynomials {
    /// One for each output.
    coefficients: Vec<CoarseValues>,
    steepest: f32,
    /// Squared length of (n_x, n_y) up to which terms of degrees 1, 2 and 3 are enough.
    degree_limits: [f32; 3],
}

/// Scratch memory for bands of rows: the coefficients at the pixels of a run along a row of nodes, and how much they
/// grow to the next row of nodes.
///
/// Those of a vector of pixels stand together. What one run needs fits into the nearest cache, where all rows of a band
/// find it; what an entire row needs would not.
#[derive(Default)]
pub struct BandScratch {
    line: Vec<f32>,
    step: Vec<f32>,
}

impl InterpolatedPolynomials {
    /// Makes polynomials of the outputs at the nodes.
    pub fn new(nodes: &Nodes<'_>, outputs: Vec<Vec<f32>>, steepest: f32) -> Self {
        let Nodes { coarse, view, part } = nodes;
        let start = coarse.subsampled_origin(view.resolution_px);
        let first = std::array::from_fn(|k| start[k] + ([part.x0, part.y0][k] * coarse.factor) as isize);
        let degree_limits = compute_degree_limits(&outputs);
        let values = |plane| CoarseValues {
            factor: coarse.factor,
            first,
            values: Grid { width: part.width(), height: part.height(), data: plane },
        };
        Self { coefficients: outputs.into_iter().map(values).collect(), steepest, degree_limits }
    }

    /// Returns the rows of the light's region from `row` on that lie between the same two rows of nodes.
    pub fn band_from(&self, region: Rect, row: usize) -> Range<usize> {
        let same = |other: &usize| self.node_above(region, *other).0 == self.node_above(region, row).0;
        row..(row + 1..region.height()).take_while(same).last().unwrap_or(row) + 1
    }

    /// Returns the row of nodes at or above row `row` of the light's region, and how far this is on the way to the next
    /// one, 0 to 1.
    fn node_above(&self, region: Rect, row: usize) -> (usize, f32) {
        let CoarseValues { factor, first, values } = &self.coefficients[0];
        let offset = (region.y0 + row) as isize - first[1];
        let offset = offset.clamp(0, ((values.height - 1) * factor) as isize) as usize;
        (offset / factor, (offset % factor) as f32 / *factor as f32)
    }

    /// Adds the polynomials at the normals of the rows of a [band](Self::band_from) of the light's region.
    pub fn add_band(&self, light: &mut Light, band: Range<usize>, normals: &[Normals], memory: &mut BandScratch) {
        dispatch_kernel(AddBand { polynomials: self, light, band, normals, memory });
    }

    /// Returns the degree up to which terms count at these normals.
    #[inline(always)]
    fn needed_degree(&self, nx: &[f32], ny: &[f32]) -> usize {
        let most = largest_value(nx.iter().zip(ny).map(|(x, y)| x * x + y * y));
        1 + self.degree_limits.iter().filter(|limit| most > **limit).count()
    }

    /// Computes the coefficients along a row of nodes at the run of `count` pixels from column `x0` of the view on, and
    /// how much they grow to the next row, if there is one.
    #[inline(always)]
    fn set_coefficient_lines<S: Simd>(&self, simd: S, node: usize, x0: usize, count: usize, memory: &mut BandScratch) {
        memory.line.resize(OUTPUTS * RUN_PX, 0.0);
        memory.step.resize(OUTPUTS * RUN_PX, 0.0);
        let (line, step) = (S::as_mut_simd_f32s(&mut memory.line).0, S::as_mut_simd_f32s(&mut memory.step).0);
        let CoarseValues { factor, first, values } = &self.coefficients[0];
        let next = (node + 1).min(values.height - 1);
        // From a node on, because interpolation goes in whole steps from node to node.
        let lead = (x0 as isize - first[0]).max(0) as usize % factor;
        let (x0, count) = (x0 as isize - lead as isize, (lead + count).next_multiple_of(*factor));
        // A run, and up to a step of the coarsest grid before it.
        let (mut above, mut below) = ([0.0; RUN_PX + 8], [0.0; RUN_PX + 8]);
        for (k, values) in self.coefficients.iter().enumerate() {
            values.interpolate_node_row(node, x0, &mut above[..count]);
            values.interpolate_node_row(next, x0, &mut below[..count]);
            let (above, below) = (&above[lead..][..RUN_PX], &below[lead..][..RUN_PX]);
            let (above, below) = (S::as_simd_f32s(above).0, S::as_simd_f32s(below).0);
            for (vector, (above, below)) in above.iter().zip(below).enumerate() {
                line[vector * OUTPUTS + k] = *above;
                step[vector * OUTPUTS + k] = simd.sub_f32s(*below, *above);
            }
        }
    }
}

/// Computes the squared length of (n_x, n_y) up to which the terms above degrees 1, 2 and 3 change no channel by more
/// than [`NEGLIGIBLE_CHANGE`], whichever of these coefficients belong to it.
fn compute_degree_limits(outputs: &[Vec<f32>]) -> [f32; 3] {
    let largest: Vec<f64> = outputs
        .iter()
        .map(|plane| f64::from(plane.iter().fold(0.0_f32, |largest, value| largest.max(value.abs()))))
        .collect();
    std::array::from_fn(|k| {
        let change_left_out = |length: f64| {
            let of = |channel: usize| -> f64 {
                let higher = (0..TERMS).filter(|m| TERM_DEGREES[*m] > k as i32 + 1);
                higher.map(|m| largest[channel * TERMS + m] * libm::pow(length, f64::from(TERM_DEGREES[m]))).sum()
            };
            (0..3).map(of).fold(0.0, f64::max)
        };
        let (mut low, mut high) = (0.0, 1.0);
        for _ in 0..30 {
            let middle = 0.5 * (low + high);
            if change_left_out(middle) <= NEGLIGIBLE_CHANGE { low = middle } else { high = middle }
        }
        (low * low) as f32
    })
}

/// The addition in explicit vectors, so that all terms at eight pixels and the sum of a channel stay in registers.
struct AddBand<'a> {
    polynomials: &'a InterpolatedPolynomials,
    light: &'a mut Light,
    band: Range<usize>,
    normals: &'a [Normals],
    memory: &'a mut BandScratch,
}

impl WithSimd for AddBand<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) {
        let Self { polynomials, light: Light { region, planes }, band, normals, memory } = self;
        let width = region.width();
        let (node, _) = polynomials.node_above(*region, band.start);
        for x0 in (0..width).step_by(RUN_PX) {
            let run = x0..(x0 + RUN_PX).min(width);
            polynomials.set_coefficient_lines(simd, node, region.x0 + x0, run.len(), memory);
            for (row, normals) in band.clone().zip(normals) {
                let (_, down) = polynomials.node_above(*region, row);
                let pixels = PixelRun {
                    normals: [&normals.x[run.clone()], &normals.y[run.clone()]],
                    steepest: polynomials.steepest,
                    memory,
                    row_fraction: down,
                    sums: planes.each_mut().map(|plane| &mut plane[row * width..][run.clone()]),
                };
                match polynomials.needed_degree(pixels.normals[0], pixels.normals[1]) {
                    1 => pixels.add_terms::<S, { LAST_TERM_BY_DEGREE[0] }>(simd),
                    2 => pixels.add_terms::<S, { LAST_TERM_BY_DEGREE[1] }>(simd),
                    3 => pixels.add_terms::<S, { LAST_TERM_BY_DEGREE[2] }>(simd),
                    _ => pixels.add_terms::<S, { LAST_TERM_BY_DEGREE[3] }>(simd),
                }
            }
        }
    }
}

/// A run of pixels of a row.
struct PixelRun<'a> {
    normals: [&'a [f32]; 2],
    steepest: f32,
    memory: &'a BandScratch,
    /// How far the row is on the way to the next row of nodes.
    row_fraction: f32,
    /// The light of each channel, to which terms are added.
    sums: [&'a mut [f32]; 3],
}

impl PixelRun<'_> {
    /// Adds the terms up to number `LAST`.
    #[inline(always)]
    fn add_terms<S: Simd, const LAST: usize>(self, simd: S) {
        let Self { normals: [nx, ny], steepest, memory, row_fraction: down, mut sums } = self;
        let down = simd.splat_f32s(down);
        let lines = S::as_simd_f32s(&memory.line).0.chunks_exact(OUTPUTS);
        let lines = lines.zip(S::as_simd_f32s(&memory.step).0.chunks_exact(OUTPUTS));
        for (start, (line, step)) in (0..nx.len()).step_by(S::F32_LANES).zip(lines) {
            let pixels = start..(start + S::F32_LANES).min(nx.len());
            // Entire vectors are loaded and stored as such: doing so with parts of vectors is slow on some processors.
            let load = |plane: &[f32]| match S::as_simd_f32s(&plane[pixels.clone()]) {
                ([whole], _) => *whole,
                (_, part) => simd.partial_load_f32s(part),
            };
            let coefficient = |k: usize| simd.add_f32s(line[k], simd.mul_f32s(step[k], down));
            let terms = simd_normal_terms::<S, LAST>(simd, [load(nx), load(ny)], steepest);
            for (channel, sums) in sums.iter_mut().enumerate() {
                let product = |m: usize| simd.mul_f32s(terms[m], coefficient(channel * TERMS + m));
                let mut sum = simd.add_f32s(load(sums), coefficient(channel * TERMS));
                for m in (1..LAST).step_by(2) {
                    sum = simd.add_f32s(sum, simd.add_f32s(product(m), product(m + 1)));
                }
                match S::as_mut_simd_f32s(&mut sums[pixels.clone()]) {
                    ([whole], _) => *whole = sum,
                    (_, part) => simd.partial_store_f32s(part, sum),
                }
            }
        }
    }
}

/// Computes the terms up to number `LAST` at normals, which are taken as no steeper than `steepest`.
#[inline(always)]
fn simd_normal_terms<S: Simd, const LAST: usize>(simd: S, [nx, ny]: [S::f32s; 2], steepest: f32) -> [S::f32s; TERMS] {
    let (one, steepest) = (simd.splat_f32s(1.0), simd.splat_f32s(steepest));
    let length = simd.sqrt_f32s(simd.add_f32s(simd.mul_f32s(nx, nx), simd.mul_f32s(ny, ny)));
    let is_steeper = simd.less_than_f32s(steepest, length);
    let kept = simd.select_f32s(is_steeper, simd.div_f32s(steepest, length), one);
    let mut terms = [one; TERMS];
    (terms[1], terms[2]) = (simd.mul_f32s(ny, kept), simd.mul_f32s(nx, kept));
    for (number, [a, b]) in (TERMS - TERM_FACTORS.len()..=LAST).zip(TERM_FACTORS) {
        terms[number] = simd.mul_f32s(terms[a], terms[b]);
    }
    terms
}
