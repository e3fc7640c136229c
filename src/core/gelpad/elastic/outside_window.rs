//! The contact outside the captured window: its force, and the displacement that it causes in the window.
//!
//! The contact is solved on grids of square cells that get larger with the distance from the window. Each grid reaches
//! further and is coarser than the one before; the last one contains all of the contact. From the widest grid inwards,
//! each grid's pressure outside the next one is taken as given, and its displacement is subtracted from the penetration
//! there. The window itself comes last; it is then solved under the load outside instead of without it.
//!
//! Contact so far away that it displaces nothing in the window has grids of its own.

use std::sync::Arc;

use once_cell::race::OnceBox;

use super::convolve::FftPlans;
use super::kernel::layer_kernel;
use super::layer::ElasticLayer;
use super::response::{OperatorBuffers, PressureResponse};
use super::{BULGE_SHARE, Elastic, ElasticPad};
use crate::base::grid::{Grid, Rect, Resolution};
use crate::base::simd::simd_dispatch;
use crate::depth::outside_window::{CellGrid, OutsideCapture, RectMm};
use crate::gelpad::total_contact::OutsideWindow;

/// Reach of the first grid around the window, thicknesses.
const FIRST_REACH: f64 = 4.0;

/// Factor from the reach of one grid to that of the next.
const REACH_FACTOR: f64 = 3.0;

/// Most cells along the contact in a grid.
const MAX_CONTACT_CELLS: f64 = 128.0;

/// Most cells along everything that a grid could contain: the displacement is needed up to the window, wherever the
/// contact is.
const MAX_GRID_CELLS: f64 = 256.0;

/// Most cells along a grid and the area that it displaces.
const MAX_CELLS: usize = MAX_GRID_CELLS as usize + 4 * BORDER_CELLS + 8;

/// Cells around the contact and around the next grid, for interpolating between cells.
const BORDER_CELLS: usize = 2;

/// Number of cell sizes per factor of two.
const SIZES_PER_OCTAVE: f64 = 4.0;

/// Number of cell sizes; more than single precision can make use of.
const SIZE_COUNT: usize = 1024;

/// Largest violation of the contact conditions on these grids, as a share of the depth.
const TOLERANCE_SHARE: f64 = 2e-3;

/// Distance beyond which the layer's response to a cell is negligible, thicknesses.
const REACH: f64 = 9.0;

/// Largest cell whose response at the cells' centres is accurate enough, thicknesses.
const FINE_CELL: f64 = 0.25;

/// What the grids share from press to press; made when first needed.
#[derive(Default)]
pub(super) struct OutsideGrids {
    responses: OnceBox<Vec<OnceBox<Arc<PressureResponse>>>>,
    plans: OnceBox<Arc<FftPlans>>,
}

/// One grid, and the rectangles between which it is used.
struct GridLevel {
    inner: RectMm,
    /// Outside this rectangle, a wider grid determines the pressure.
    outer: RectMm,
    /// True if the pressure displaces nothing elsewhere.
    is_far: bool,
    cells: CellGrid,
    /// Index of the cells' size.
    size_number: usize,
}

/// Displacement at the centres of cells, mm.
struct CellField {
    cells: CellGrid,
    values: Grid<f32>,
}

impl ElasticPad {
    /// Solves for the contact outside the window of a view. The displacement is given on the window's grid.
    pub fn solve_outside_window(&self, around: &OutsideCapture<'_>) -> OutsideWindow {
        let window = RectMm::around_view(around.view(), self.margin_px);
        let (mut force, mut area_mm2, mut converged) = (0.0, 0.0, true);
        // Displacements of the pad and of a deformable object.
        let (mut field, mut object_field): (Option<CellField>, Option<CellField>) = (None, None);
        let [near, far] = self.divide_contact(around, window);
        let levels = self.grid_levels(window, near.into_iter().fold(RectMm::EMPTY, RectMm::union));
        let far = far.into_iter().map(|patch| self.grid_of_patch(window, patch));
        for GridLevel { inner, outer, is_far, cells, size_number } in far.chain(levels.into_iter().rev()) {
            let mut penetration = around.capture_penetration(&cells);
            for field in field.iter().chain(&object_field) {
                let given = field.sample_pixels(cells.corner_mm, [cells.cell_size_mm; 2], cells.count);
                penetration.data.iter_mut().zip(&given.data).for_each(|(g, w)| *g -= w);
            }
            let deepest = penetration.largest(|g| g);
            let pad = self.with_cell_grid(size_number, cells.cell_size_mm, f64::from(deepest));
            let both = self.object_compliance().map(|object| pad.with_object(object, [MAX_CELLS; 2]));
            let solution = both.as_ref().unwrap_or(&pad).solve_contact(&penetration, &mut [], Rect::default(), None);
            converged &= solution.converged;
            let whole = Rect::whole(penetration.width, penetration.height);
            let mut pressure = Grid::new(penetration.width, penetration.height);
            pressure.paste(&solution.pressure, solution.contact_box, whole);
            let area = cells.cell_size_mm * cells.cell_size_mm;
            for y in 0..pressure.height {
                for (x, p) in pressure.row_mut(y).iter_mut().enumerate() {
                    if *p > 0.0 {
                        let within = inner.cell_share(&cells, x, y);
                        // A wider grid counts the contact outside of this one.
                        let own = (outer.cell_share(&cells, x, y) - within).max(0.0) * area;
                        force += f64::from(*p) * own;
                        area_mm2 += own;
                        *p *= (1.0 - within) as f32;
                    }
                }
            }
            if is_far {
                continue;
            }
            field = Some(pad.displace_cells(&pad.response, (&cells, &pressure), inner).add_wider(field));
            if let Some(object) = self.object_compliance() {
                let alone = pad.response.object_alone(object, [MAX_CELLS; 2]);
                object_field = Some(pad.displace_cells(&alone, (&cells, &pressure), inner).add_wider(object_field));
            }
        }
        let count = around.view().resolution_px.map(|px| px + 2 * self.margin_px);
        // kPa mm^2 are mN.
        let force_n = Some(force * self.youngs_modulus_kpa * 1e-3);
        let in_window = |field: Option<CellField>| {
            field.filter(|_| area_mm2 > 0.0).map(|field| field.sample_pixels(window.min, self.mm_per_px, count))
        };
        let (displacement, object_displacement) = (in_window(field), in_window(object_field));
        OutsideWindow { displacement, object_displacement, force_n, area_mm2, converged }
    }

    /// Divides the contact into patches that reach each other and the window, and those that displace nothing but
    /// themselves.
    fn divide_contact(&self, around: &OutsideCapture<'_>, window: RectMm) -> [Vec<RectMm>; 2] {
        // An elastic object carries displacements further than the pad.
        let reach = if self.object_compliance().is_some() { f64::INFINITY } else { REACH * self.layer.thickness_mm };
        let mut near = Vec::new();
        let mut far = around.patches_below(BULGE_SHARE * around.depth_mm(), reach);
        let mut area = window;
        // The grids of what is near contain the window and a rectangle around all of it.
        while let Some(k) = far.iter().position(|patch| !patch.grown(reach).intersection(area).is_empty()) {
            near.push(far.swap_remove(k));
            area = near.iter().copied().fold(window, RectMm::union);
        }
        [near, far]
    }

    /// Returns the grid of a patch of contact that displaces nothing elsewhere.
    fn grid_of_patch(&self, window: RectMm, patch: RectMm) -> GridLevel {
        let (size_number, cell_size_mm) = self.choose_cell_size(patch.longer_side_mm() / MAX_CONTACT_CELLS);
        let cells = CellGrid::covering(patch, cell_size_mm, BORDER_CELLS);
        GridLevel { inner: window, outer: RectMm::EVERYWHERE, is_far: true, cells, size_number }
    }

    /// Returns the number of the next larger cell size, and that size, mm.
    fn choose_cell_size(&self, wanted_mm: f64) -> (usize, f64) {
        let finest = self.mm_per_px[0].min(self.mm_per_px[1]);
        let size = (SIZES_PER_OCTAVE * libm::log2(wanted_mm / finest)).ceil().clamp(0.0, (SIZE_COUNT - 1) as f64);
        (size as usize, finest * libm::exp2(size / SIZES_PER_OCTAVE))
    }

    /// Returns the grids that are needed, from the window outwards.
    fn grid_levels(&self, window: RectMm, touching: RectMm) -> Vec<GridLevel> {
        let (mut inner, mut reach) = (window, FIRST_REACH * self.layer.thickness_mm);
        let mut levels = Vec::new();
        loop {
            let outer = window.grown(reach);
            let part = outer.intersection(touching);
            if !part.is_empty() {
                let wanted = (part.longer_side_mm() / MAX_CONTACT_CELLS).max(outer.longer_side_mm() / MAX_GRID_CELLS);
                let (size_number, cell_size_mm) = self.choose_cell_size(wanted);
                levels.push(GridLevel {
                    inner,
                    outer,
                    is_far: false,
                    cells: CellGrid::covering(part, cell_size_mm, BORDER_CELLS),
                    size_number,
                });
                inner = outer;
            }
            if outer.contains(touching) {
                if let Some(last) = levels.last_mut() {
                    // No wider grid follows, so this one counts everything outside.
                    last.outer = RectMm::EVERYWHERE;
                }
                return levels;
            }
            reach *= REACH_FACTOR;
        }
    }

    /// Returns the same layer on a grid of cells.
    fn with_cell_grid(&self, size_number: usize, cell_size_mm: f64, deepest_mm: f64) -> Self {
        let OutsideGrids { responses, plans } = &*self.outside_grids;
        let responses = responses.get_or_init(|| Box::new((0..SIZE_COUNT).map(|_| OnceBox::new()).collect()));
        let plans = plans.get_or_init(|| Box::new(Arc::new(FftPlans::new(4 * MAX_CELLS))));
        let own = responses[size_number].get_or_init(|| {
            let kernel = cell_kernel(self.layer, cell_size_mm, 2 * MAX_CELLS);
            let plans = Arc::clone(plans);
            Box::new(Arc::new(PressureResponse::from_kernel(self.layer, [cell_size_mm; 2], kernel, plans)))
        });
        let tolerance_um = self.elastic.tolerance_um.max(1e3 * TOLERANCE_SHARE * deepest_mm);
        Self {
            elastic: Elastic { resolution: Resolution::Full, tolerance_um, ..self.elastic },
            margin_px: 0,
            mm_per_px: [cell_size_mm; 2],
            coarse_mm_per_px: [cell_size_mm; 2],
            response: Arc::clone(own),
            coarser: None,
            ..self.clone()
        }
    }

    /// Computes the displacement under a pressure on `cells`, in cells that cover the rectangle `over`.
    fn displace_cells(
        &self,
        response: &PressureResponse,
        (cells, pressure): (&CellGrid, &Grid<f32>),
        over: RectMm,
    ) -> CellField {
        let size_mm = cells.cell_size_mm;
        // The cells of this size with which the target begins and ends, in columns (or rows).
        let reach = |k: usize| {
            let low = ((over.min[k] - cells.corner_mm[k]) / size_mm).floor() as i64 - BORDER_CELLS as i64;
            let high = ((over.max[k] - cells.corner_mm[k]) / size_mm).ceil() as i64 + BORDER_CELLS as i64;
            (low.min(0), high.max(cells.count[k] as i64))
        };
        let reaches = [reach(0), reach(1)];
        let count = reaches.map(|(low, high)| (high - low) as usize);
        let [x0, y0] = reaches.map(|(low, _)| -low as usize);
        let source = Rect { x0, y0, x1: x0 + cells.count[0], y1: y0 + cells.count[1] };
        let operator = response.operator(source, Rect::whole(count[0], count[1]));
        let (mut memory, mut values) = (OperatorBuffers::default(), Grid::default());
        operator.prepare(&mut memory);
        operator.displace(pressure, &mut memory, &mut values);
        let corner_mm = std::array::from_fn(|k| cells.corner_mm[k] + reaches[k].0 as f64 * size_mm);
        CellField { cells: CellGrid { corner_mm, cell_size_mm: size_mm, count }, values }
    }
}

impl CellField {
    /// Adds the field of wider grids.
    fn add_wider(mut self, wider: Option<Self>) -> Self {
        if let Some(wider) = wider {
            let given = wider.sample_pixels(self.cells.corner_mm, [self.cells.cell_size_mm; 2], self.cells.count);
            self.values.data.iter_mut().zip(&given.data).for_each(|(own, given)| *own += given);
        }
        self
    }

    /// Interpolates at the centres of pixels, the first of which begins at `corner_mm`, by cubics between cells
    /// (Catmull and Rom).
    fn sample_pixels(&self, corner_mm: [f64; 2], mm_per_px: [f64; 2], count: [usize; 2]) -> Grid<f32> {
        let along = |k: usize| -> Vec<([usize; 4], [f32; 4])> {
            let last = self.cells.count[k] as i64 - 1;
            let weights = |at: usize| {
                let mm = corner_mm[k] + (at as f64 + 0.5) * mm_per_px[k] - self.cells.corner_mm[k];
                let position = mm / self.cells.cell_size_mm - 0.5;
                let first = position.floor();
                let t = position - first;
                let from = std::array::from_fn(|n| (first as i64 + n as i64 - 1).clamp(0, last) as usize);
                let ends = [t * (t * (1.0 - 0.5 * t) - 0.5), 0.5 * t * t * (t - 1.0)];
                let inner = [1.0 + t * t * (1.5 * t - 2.5), t * (0.5 + t * (2.0 - 1.5 * t))];
                (from, [ends[0], inner[0], inner[1], ends[1]].map(|weight| weight as f32))
            };
            (0..count[k]).map(weights).collect()
        };
        let (columns, rows) = (along(0), along(1));
        let mut widened: Grid<f32> = Grid::new(count[0], self.values.height);
        let mut out: Grid<f32> = Grid::new(count[0], count[1]);
        simd_dispatch(
            #[inline(always)]
            || {
                for y in 0..self.values.height {
                    let row = self.values.row(y);
                    for (value, (from, weights)) in widened.row_mut(y).iter_mut().zip(&columns) {
                        *value = (0..4).map(|n| weights[n] * row[from[n]]).sum();
                    }
                }
                for (y, (from, weights)) in rows.iter().enumerate() {
                    let [a, b, c, d] = from.map(|row| widened.row(row));
                    for (x, value) in out.row_mut(y).iter_mut().enumerate() {
                        *value = weights[0] * a[x] + weights[1] * b[x] + weights[2] * c[x] + weights[3] * d[x];
                    }
                }
            },
        );
        out
    }
}

/// Computes the layer's response to a cell; coarse cells are composed of smaller ones. Even pressure over a cell makes
/// the response of wide contacts too stiff or too soft. Therefore the nearest cells are corrected so that the sum over
/// all cells and its second moment are the layer's; wide contacts depend on nothing else.
fn cell_kernel(layer: ElasticLayer, cell_size_mm: f64, most: usize) -> Grid<f32> {
    let h = layer.thickness_mm;
    // An odd number, so that the centre of a cell is the centre of a smaller one.
    let parts = 2 * (0.5 * cell_size_mm / (FINE_CELL * h)).min(1e9) as usize + 1;
    let fine = layer_kernel(layer, [cell_size_mm / parts as f64; 2], REACH * h, [most; 2]);
    if parts == 1 {
        return fine;
    }
    let coarse = |lag: usize| (lag + parts / 2) / parts;
    let [width, height] = [fine.width, fine.height].map(|lags| (coarse(lags - 1) + 1).max(2));
    let mut sums = Grid::<f64>::new(width, height);
    for y in 0..fine.height {
        for x in 0..fine.width {
            // A lag within the middle cell occurs on either side.
            let twice = |lag: usize| if lag > 0 && coarse(lag) == 0 { 2.0 } else { 1.0 };
            sums.row_mut(coarse(y))[coarse(x)] += f64::from(fine.at(x, y)) * twice(x) * twice(y);
        }
    }
    let (mut sum, mut second) = (0.0, 0.0);
    for y in 0..height {
        for x in 0..width {
            let mirrored = |lag: usize| if lag == 0 { 1.0 } else { 2.0 };
            let whole = sums.at(x, y) * mirrored(x) * mirrored(y);
            sum += whole;
            second += whole * (x * x) as f64 * cell_size_mm * cell_size_mm;
        }
    }
    // G(q) = G(0) + bend q^2 + ..
    let bend = |s: f64| (layer.normal_compliance(s / h) - layer.normal_compliance(0.0)) / (s * s) * h * h;
    let bend = (4.0 * bend(0.02) - bend(0.04)) / 3.0;
    let beside = (-2.0 * bend - second) / (2.0 * cell_size_mm * cell_size_mm);
    sums.row_mut(0)[0] += layer.normal_compliance(0.0) - sum - 4.0 * beside;
    sums.row_mut(0)[1] += beside;
    sums.row_mut(1)[0] += beside;
    Grid { width, height, data: sums.data.iter().map(|value| *value as f32).collect() }
}
