//! What presses on the pad beyond the captured window: its force, and the displacement that it causes in the window.
//!
//! The contact is solved on grids of square cells that become larger with the distance from the window: each grid reaches
//! further and is coarser than the one before, up to one that holds all of the object. From the widest inwards, each
//! grid's pressure outside the next one is taken as given, and its displacement off the overlap there; last comes the
//! window itself, which is so solved under the load beyond it instead of without.

use std::sync::{Arc, OnceLock};

use super::convolve::Lengths;
use super::kernel::kernel;
use super::layer::ElasticLayer;
use super::response::{Memory, Response};
use super::{BULGE, Elastic, Pad};
use crate::base::grid::{Grid, Rect, Resolution};
use crate::base::simd::simd_dispatch;
use crate::depth::beyond::{Area, Cells, Surroundings};
use crate::gelpad::total_contact::Beyond;

/// How far the first grid reaches beyond the window, thicknesses.
const FIRST: f64 = 4.0;

/// By what factor each further grid reaches further.
const FURTHER: f64 = 3.0;

/// Most cells along the contact in a grid.
const CELLS: f64 = 128.0;

/// Most cells along all that a grid could hold: the displacement is wanted up to the window, wherever the contact is.
const WIDEST: f64 = 256.0;

/// Cells along a grid and what it displaces, at most.
const MOST: usize = WIDEST as usize + 4 * BORDER + 8;

/// Cells around the contact, and around the next grid, where values between cells are needed.
const BORDER: usize = 2;

/// Sizes of cells from one to twice it.
const PER_OCTAVE: f64 = 4.0;

/// How many sizes there are: more than floating-point numbers of single precision have use for.
const SIZES: usize = 1024;

/// Largest violation of the contact conditions on these grids, as a share of the depth.
const TOLERANCE: f64 = 2e-3;

/// Distance beyond which the layer's response to a cell counts for nothing, thicknesses.
const REACH: f64 = 9.0;

/// Cells up to which the response is known well enough at their middles, thicknesses.
const FINE: f64 = 0.25;

/// What the grids beyond the window share from press to press, made when it is first needed.
#[derive(Default)]
pub(super) struct Grids {
    responses: OnceLock<Vec<OnceLock<Arc<Response>>>>,
    lengths: OnceLock<Arc<Lengths>>,
}

/// A grid, and what it lies around.
struct Level {
    inner: Area,
    /// Beyond this, a wider grid knows the pressure.
    outer: Area,
    cells: Cells,
    /// Number of the cells' size.
    size: usize,
}

/// Displacement at the middles of cells, mm.
struct Field {
    cells: Cells,
    values: Grid<f32>,
}

/// What is in `cell`, made where nobody has yet. It is made outside the cell: a process that is forked meanwhile has not the
/// thread that makes it, and would wait for it for ever.
fn shared<T>(cell: &OnceLock<T>, make: impl FnOnce() -> T) -> &T {
    cell.get().unwrap_or_else(|| {
        let made = make();
        cell.get_or_init(|| made)
    })
}

impl Pad {
    /// What presses beyond the window of a view, on the grid of which the displacement is given.
    pub fn beyond(&self, around: &Surroundings<'_>) -> Beyond {
        let window = Area::around(around.view(), self.margin_px);
        let (mut force, mut area_mm2, mut solved) = (0.0, 0.0, true);
        // Of the pad, and of an object that gives way.
        let (mut field, mut gives): (Option<Field>, Option<Field>) = (None, None);
        for Level { inner, outer, cells, size } in
            self.levels(window, around.below(BULGE * around.depth_mm())).iter().rev()
        {
            let mut penetration = around.penetration(cells);
            for field in field.iter().chain(&gives) {
                let given = field.at(cells.corner_mm, [cells.pitch_mm; 2], cells.count);
                penetration.data.iter_mut().zip(&given.data).for_each(|(g, w)| *g -= w);
            }
            let deepest = penetration.largest(|g| g);
            let pad = self.on_cells(*size, cells.pitch_mm, f64::from(deepest));
            let both = self.object().map(|object| pad.softened(object, [MOST; 2]));
            let solution = both.as_ref().unwrap_or(&pad).solve(&penetration, &mut [], Rect::default(), None);
            solved &= solution.converged;
            let whole = Rect::whole(penetration.width, penetration.height);
            let mut pressure = Grid::new(penetration.width, penetration.height);
            pressure.paste(&solution.pressure, solution.contact_box, whole);
            let area = cells.pitch_mm * cells.pitch_mm;
            for y in 0..pressure.height {
                for (x, p) in pressure.row_mut(y).iter_mut().enumerate() {
                    if *p > 0.0 {
                        let within = inner.share(cells, x, y);
                        // A wider grid counts what is beyond this one.
                        let own = (outer.share(cells, x, y) - within).max(0.0) * area;
                        force += f64::from(*p) * own;
                        area_mm2 += own;
                        *p *= (1.0 - within) as f32;
                    }
                }
            }
            field = Some(pad.displaced(&pad.response, (cells, &pressure), *inner).over(field));
            if let Some(object) = self.object() {
                let alone = pad.response.object_alone(object, [MOST; 2]);
                gives = Some(pad.displaced(&alone, (cells, &pressure), *inner).over(gives));
            }
        }
        let count = around.view().resolution_px.map(|px| px + 2 * self.margin_px);
        // Newtons from mm^2 of unit modulus: kPa mm^2 are mN.
        let force_n = Some(force * self.youngs_modulus_kpa * 1e-3);
        let in_window = |field: Option<Field>| {
            field.filter(|_| area_mm2 > 0.0).map(|field| field.at(window.min, self.mm_per_px, count))
        };
        let (displacement, object_gives) = (in_window(field), in_window(gives));
        Beyond { displacement, object_gives, force_n, area_mm2, solved }
    }

    /// The grids that it takes, from the window outwards.
    fn levels(&self, window: Area, touching: Area) -> Vec<Level> {
        let finest = self.mm_per_px[0].min(self.mm_per_px[1]);
        let (mut inner, mut reach) = (window, FIRST * self.layer.thickness_mm);
        let mut levels = Vec::new();
        loop {
            let outer = window.grown(reach);
            let part = outer.cut(touching);
            if !part.is_empty() {
                let wanted = (part.longest() / CELLS).max(outer.longest() / WIDEST);
                let size = (PER_OCTAVE * libm::log2(wanted / finest)).ceil().clamp(0.0, (SIZES - 1) as f64);
                let pitch_mm = finest * libm::exp2(size / PER_OCTAVE);
                levels.push(Level { inner, outer, cells: Cells::over(part, pitch_mm, BORDER), size: size as usize });
                inner = outer;
            }
            if outer.holds(touching) {
                if let Some(last) = levels.last_mut() {
                    last.outer = Area::EVERYWHERE;
                }
                return levels;
            }
            reach *= FURTHER;
        }
    }

    /// The same layer on a grid of cells.
    fn on_cells(&self, size: usize, pitch_mm: f64, deepest_mm: f64) -> Self {
        let Grids { responses, lengths } = &*self.grids;
        let responses = shared(responses, || (0..SIZES).map(|_| OnceLock::new()).collect());
        let lengths = shared(lengths, || Arc::new(Lengths::new(4 * MOST)));
        let own = shared(&responses[size], || {
            let kernel = response(self.layer, pitch_mm, 2 * MOST);
            Arc::new(Response::of(self.layer, [pitch_mm; 2], kernel, Arc::clone(lengths)))
        });
        let tolerance_um = self.elastic.tolerance_um.max(1e3 * TOLERANCE * deepest_mm);
        Self {
            elastic: Elastic { resolution: Resolution::Full, tolerance_um, ..self.elastic },
            margin_px: 0,
            mm_per_px: [pitch_mm; 2],
            coarse_mm_per_px: [pitch_mm; 2],
            response: Arc::clone(own),
            coarser: None,
            ..self.clone()
        }
    }

    /// The displacement under a pressure on `cells`, in cells over an area.
    fn displaced(&self, response: &Response, (cells, pressure): (&Cells, &Grid<f32>), over: Area) -> Field {
        let pitch = cells.pitch_mm;
        // Columns (or rows) of these cells that the target begins and ends with.
        let reach = |k: usize| {
            let low = ((over.min[k] - cells.corner_mm[k]) / pitch).floor() as i64 - BORDER as i64;
            let high = ((over.max[k] - cells.corner_mm[k]) / pitch).ceil() as i64 + BORDER as i64;
            (low.min(0), high.max(cells.count[k] as i64))
        };
        let reaches = [reach(0), reach(1)];
        let count = reaches.map(|(low, high)| (high - low) as usize);
        let [x0, y0] = reaches.map(|(low, _)| -low as usize);
        let source = Rect { x0, y0, x1: x0 + cells.count[0], y1: y0 + cells.count[1] };
        let operator = response.operator(source, Rect::whole(count[0], count[1]));
        let (mut memory, mut values) = (Memory::default(), Grid::default());
        operator.prepare(&mut memory);
        operator.displace(pressure, &mut memory, &mut values);
        let corner_mm = std::array::from_fn(|k| cells.corner_mm[k] + reaches[k].0 as f64 * pitch);
        Field { cells: Cells { corner_mm, pitch_mm: pitch, count }, values }
    }
}

impl Field {
    /// On top of that of wider grids.
    fn over(mut self, wider: Option<Self>) -> Self {
        if let Some(wider) = wider {
            let given = wider.at(self.cells.corner_mm, [self.cells.pitch_mm; 2], self.cells.count);
            self.values.data.iter_mut().zip(&given.data).for_each(|(own, given)| *own += given);
        }
        self
    }

    /// At the middles of pixels, the first of which begins at `corner_mm`: by cubics between cells (Catmull and Rom).
    fn at(&self, corner_mm: [f64; 2], mm_per_px: [f64; 2], count: [usize; 2]) -> Grid<f32> {
        let along = |k: usize| -> Vec<([usize; 4], [f32; 4])> {
            let last = self.cells.count[k] as i64 - 1;
            let weights = |at: usize| {
                let mm = corner_mm[k] + (at as f64 + 0.5) * mm_per_px[k] - self.cells.corner_mm[k];
                let position = mm / self.cells.pitch_mm - 0.5;
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

/// The layer's response to a cell. Coarse cells are put together from smaller ones. Pressure that is even over a cell
/// makes the response of wide contacts too stiff or too soft: the nearest cells get what is missing, so that the sum over
/// all cells and its second moment, of which such contacts feel nothing else, are the layer's.
fn response(layer: ElasticLayer, pitch_mm: f64, most: usize) -> Grid<f32> {
    let h = layer.thickness_mm;
    // An odd number, so that the middle of a cell is the middle of a smaller one.
    let parts = 2 * (0.5 * pitch_mm / (FINE * h)).min(1e9) as usize + 1;
    let fine = kernel(layer, [pitch_mm / parts as f64; 2], REACH * h, [most; 2]);
    if parts == 1 {
        return fine;
    }
    let coarse = |lag: usize| (lag + parts / 2) / parts;
    let [width, height] = [fine.width, fine.height].map(|lags| (coarse(lags - 1) + 1).max(2));
    let mut sums = Grid::<f64>::new(width, height);
    for y in 0..fine.height {
        for x in 0..fine.width {
            // A lag within half the middle cell is there on either side.
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
            second += whole * (x * x) as f64 * pitch_mm * pitch_mm;
        }
    }
    // G(q) = G(0) + bend q^2 + ..
    let bend = |s: f64| (layer.normal(s / h) - layer.normal(0.0)) / (s * s) * h * h;
    let bend = (4.0 * bend(0.02) - bend(0.04)) / 3.0;
    let beside = (-2.0 * bend - second) / (2.0 * pitch_mm * pitch_mm);
    sums.row_mut(0)[0] += layer.normal(0.0) - sum - 4.0 * beside;
    sums.row_mut(0)[1] += beside;
    sums.row_mut(1)[0] += beside;
    Grid { width, height, data: sums.data.iter().map(|value| *value as f32).collect() }
}
