//! Walls of the object between the pixels of the solver's grid.
//!
//! A pixel that a wall cuts is pressed by a part of its area only. Taken as pressed or not by where its centre is, a wall that
//! runs askew to a coarse grid is a staircase, and the pad beside it has saw-teeth. So a pixel of which the fraction c is
//! covered counts as pressed, but gives way: under its pressure p it is a p (1 - c) / c short of the object, as if on a spring.
//! With a = 0.911 (2 / E') times the pitch the pad beside a rigid flat punch moves as much as the punch's edge, whatever c,
//! within 0.0065 of a pixel (fitted to Sadowsky's closed form; `tests/physics/walls.rs`).

use std::f32::consts::PI;
use std::ops::Range;

use super::lattice::Lattice;
use crate::core::base::grid::{Grid, Rect};
use crate::core::base::simd::simd_dispatch;
use crate::core::depth::Depth;

/// Slope of the object between two of the camera's pixels from which on there is a wall; from twice as much on it counts as a
/// whole one.
const WALL: f32 = 2.0;

/// How far an edge gives way, in pitches and 2 / E'.
const EDGE: f32 = 0.911;

/// Drop of the pad's surface from a wall to the pixel's border beyond it under pressure 1 on the pixel, in pitches and 2 / E':
/// that much times sqrt(1 - c) / c. Fitted as the other, within 3 %.
const DROP: f32 = 1.07;

/// Displacement of the middle of a pixel under its own pressure in pitches and 2 / E': of a square one, and of one that is
/// endless along one direction.
const SQUARE: f32 = 0.561;
const STRIP: f32 = 0.539;

/// A pixel of the solver's grid that a wall cuts.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct CutPixel {
    /// Column and row.
    pub at: [usize; 2],
    /// By how much it gives way under pressure 1 at Young's modulus 1, mm.
    pub compliance: f32,
    /// The pressure from which on what is beside the wall is pressed, too.
    most: f32,
    /// How much lower than the covered part the object is at the pixel's centre, mm: 0 if that is covered.
    beside_mm: f32,
    /// What is beside the wall is pressed, too: a pixel like any other, as deep as the object at its centre.
    pub stopped: bool,
}

impl CutPixel {
    /// How far below the overlap the pixel may be under a pressure, mm.
    pub fn gives_way(&self, pressure: f32) -> f32 {
        if self.stopped { self.beside_mm } else { self.compliance * pressure }
    }

    /// Whether it is pressed beside its centre only.
    pub fn is_beside(&self) -> bool {
        self.beside_mm > 0.0 && !self.stopped
    }

    /// Its pressure as a share of the next pixel's, further from the wall: roughly, as beside the edge of a punch.
    pub fn share(&self, own: f32) -> f32 {
        let c = 1.0 / (1.0 + self.compliance * SQUARE / (EDGE * own));
        0.9 * c * (1.0 + c)
    }

    /// Stops if the pressure asks for it. Whether it does.
    pub fn stop(&mut self, pressure: f32) -> bool {
        let stops = !self.stopped && pressure > self.most;
        self.stopped |= stops;
        stops
    }
}

/// The object on the solver's grid.
#[derive(Clone, Debug, Default)]
pub struct Thinned {
    /// The overlap, mm; where a wall leaves a part of a pixel but not its centre, that part's. Empty on the camera's own grid.
    pub overlap: Grid<f32>,
    /// The pixels that a wall cuts.
    pub cut: Vec<CutPixel>,
}

impl Thinned {
    /// Takes the depth map of a camera with pixels of this size to the grid `lattice`. `own` is the displacement of one of its
    /// pixels under pressure 1 on itself, mm.
    pub fn take(&mut self, lattice: Lattice, depth: &Depth, mm_per_px: [f64; 2], own: f32) {
        self.cut.clear();
        if lattice.factor == 1 {
            self.overlap.reset(0, 0);
            return;
        }
        lattice.thin_out(&depth.overlap, &mut self.overlap);
        if depth.touching.is_empty() {
            return;
        }
        let cells = Cells { lattice, fine: &depth.overlap, step_mm: mm_per_px.map(|mm| WALL * mm as f32) };
        let around = lattice.box_around(depth.touching);
        let mut spans = [vec![0.0_f32; depth.overlap.width], vec![0.0_f32; depth.overlap.width]];
        for y in around.y0..around.y1 {
            cells.spans(y, around, &mut spans);
            for x in around.x0..around.x1 {
                if !cells.may_be_cut(x, &spans) {
                    continue;
                }
                if let Some((pixel, overlap)) = cells.cut([x, y], own / SQUARE) {
                    self.cut.push(pixel);
                    self.overlap.row_mut(y)[x] = overlap;
                }
            }
        }
    }
}

/// The camera's pixels in each of the solver's: those around its centre up to half-way to the next, which count by half.
struct Cells<'a> {
    lattice: Lattice,
    fine: &'a Grid<f32>,
    /// Drop from one fine pixel to the next that is a wall, along x and y.
    step_mm: [f32; 2],
}

impl Cells<'_> {
    /// Fine columns (k = 0) or rows in a pixel.
    fn along(&self, coarse: usize, k: usize) -> Range<usize> {
        let half = self.lattice.factor / 2;
        let middle = self.lattice.fine(coarse, k);
        let count = if k == 0 { self.fine.width } else { self.fine.height };
        middle.saturating_sub(half)..(middle + half + 1).min(count)
    }

    /// The highest and lowest overlap of fine columns in a row of pixels.
    fn spans(&self, y: usize, part: Rect, [high, low]: &mut [Vec<f32>; 2]) {
        let columns = self.along(part.x0, 0).start..self.along(part.x1 - 1, 0).end;
        let rows = self.along(y, 1);
        let first = &self.fine.row(rows.start)[columns.clone()];
        let (high, low) = (&mut high[columns.clone()], &mut low[columns.clone()]);
        high.copy_from_slice(first);
        low.copy_from_slice(first);
        simd_dispatch(
            #[inline(always)]
            || {
                for row in rows.start + 1..rows.end {
                    let row = &self.fine.row(row)[columns.clone()];
                    for ((high, low), g) in high.iter_mut().zip(&mut *low).zip(row) {
                        *high = if *g > *high { *g } else { *high };
                        *low = if *g < *low { *g } else { *low };
                    }
                }
            },
        );
    }

    /// The object drops by a wall somewhere within the pixel, and presses there.
    fn may_be_cut(&self, x: usize, [high, low]: &[Vec<f32>; 2]) -> bool {
        let columns = self.along(x, 0);
        let most = high[columns.clone()].iter().fold(f32::NEG_INFINITY, |most, g| most.max(*g));
        let least = low[columns].iter().fold(f32::INFINITY, |least, g| least.min(*g));
        most > 0.0 && most - least.max(0.0) > self.step_mm[0].min(self.step_mm[1])
    }

    /// How far the object reaches below the undeformed pad, mm. What is above is not known of every object alike.
    fn below(&self, [x, y]: [usize; 2]) -> f32 {
        self.fine.at(x, y).max(0.0)
    }

    /// How a wall cuts a pixel, if one does, and the overlap of what it leaves; `unit` is 2 / E' times the pitch.
    fn cut(&self, at: [usize; 2], unit: f32) -> Option<(CutPixel, f32)> {
        let [columns, rows] = [0, 1].map(|k| self.along(at[k], k));
        let (mut most, mut least, mut steepest) = (f32::NEG_INFINITY, f32::INFINITY, 0.0_f32);
        for y in rows.clone() {
            for x in columns.clone() {
                let g = self.below([x, y]);
                (most, least) = (most.max(g), least.min(g));
                if x + 1 < columns.end {
                    steepest = steepest.max((g - self.below([x + 1, y])).abs() / self.step_mm[0]);
                }
                if y + 1 < rows.end {
                    steepest = steepest.max((g - self.below([x, y + 1])).abs() / self.step_mm[1]);
                }
            }
        }
        let wall = (steepest - 1.0).clamp(0.0, 1.0);
        if wall == 0.0 {
            return None;
        }
        // What is above the middle of the drop is the object's face, the rest is beside the wall.
        let face = 0.5 * (most + least);
        let [x, y] = [0, 1].map(|k| self.lattice.fine(at[k], k));
        let half = self.lattice.factor / 2;
        let share = |a: usize, b: usize| if a.abs_diff(b) == half { 0.5 } else { 1.0 };
        let (mut whole, mut covered, mut sum, mut middle) = (0.0, 0.0, 0.0, [0.0; 2]);
        for row in rows {
            for column in columns.clone() {
                let (share, g) = (share(column, x) * share(row, y), self.below([column, row]));
                whole += share;
                if g > face {
                    covered += share;
                    sum += share * g;
                    middle[0] += share * (column as f32 - x as f32);
                    middle[1] += share * (row as f32 - y as f32);
                }
            }
        }
        if covered == whole {
            return None;
        }
        let c = covered / whole;
        // Beyond the covered part's sides and corner, the next pixels' centres.
        let next = |at: usize, middle: f32, size: usize| match middle < 0.0 {
            true => at.saturating_sub(self.lattice.factor),
            false => (at + self.lattice.factor).min(size - 1),
        };
        let (beside, below) = (next(x, middle[0], self.fine.width), next(y, middle[1], self.fine.height));
        let goes_on = [[beside, y], [x, below], [beside, below]].into_iter().any(|next| self.below(next) > face);
        let gives = match goes_on {
            true => EDGE * (1.0 - c) / c,
            // A ridge no wider than the pixel: a rigid strip instead of an even pressure.
            false => ((4.0 / c).ln() / PI - STRIP).max(0.0),
        };
        let (centre, drop) = (self.below([x, y]), DROP * (1.0 - c).max(0.25).sqrt() / c);
        // What is less than a wall, less of it.
        let beside_mm = if centre > face { 0.0 } else { wall * (sum / covered - centre) };
        let overlap = centre + beside_mm;
        let pixel = CutPixel {
            at,
            compliance: wall * unit * gives,
            // The pad stays below its rest beside a wall, and so clear of what does.
            most: if least > 0.0 { (overlap - least) / (unit * drop) } else { f32::INFINITY },
            beside_mm,
            stopped: false,
        };
        Some((pixel, overlap))
    }
}
