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
use crate::base::grid::{Grid, Rect};
use crate::base::simd::simd_dispatch;
use crate::depth::Depth;

/// Slope of the object between two of the camera's pixels from which on there is a wall; from twice as much on it counts as a
/// whole one.
const WALL: f32 = 2.0;

/// How far an edge gives way, in pitches and 2 / E'.
const EDGE: f32 = 0.911;

/// Displacement of the middle of a pixel under its own pressure in pitches and 2 / E': of a square one, and of one that is
/// endless along one direction.
const SQUARE: f32 = 0.561;
const STRIP: f32 = 0.539;

/// Steps to the pixels around one.
const AROUND: [[isize; 2]; 8] = [[-1, -1], [0, -1], [1, -1], [-1, 0], [1, 0], [-1, 1], [0, 1], [1, 1]];

/// Cosine of the largest angle between two directions that count as one.
const TOWARDS: f32 = 0.64;

/// Weight of what is at a pixel's centre in its overlap.
const CENTRAL: f32 = 4.0;

/// A pixel of the solver's grid that a wall cuts.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct CutPixel {
    /// Column and row.
    pub at: [usize; 2],
    /// By how much it gives way under pressure 1 at Young's modulus 1, mm.
    pub compliance: f32,
    /// By how much at most, mm: then what is beside the wall is pressed, too, and the pixel as deep as the object on average.
    most_mm: f32,
    /// How much lower than the covered part the object is at the pixel's centre, mm.
    beside_mm: f32,
    /// The covered fraction of what is at its centre.
    centre_covered: f32,
    /// It gives way no more.
    pub stopped: bool,
}

impl CutPixel {
    /// How far below the overlap the pixel is under a pressure, mm.
    pub fn gives_way(&self, pressure: f32) -> f32 {
        if self.stopped { self.most_mm } else { self.compliance * pressure }
    }

    /// How much of what is at its centre is pressed under a pressure.
    pub fn pressed_centre(&self, pressure: f32) -> f32 {
        self.centre_covered + (1.0 - self.centre_covered) * self.pressed_beside(pressure)
    }

    /// How much of what is beside the wall is pressed: from 0, where the pixel just stops, to 1 at twice that pressure.
    fn pressed_beside(&self, pressure: f32) -> f32 {
        let past = self.compliance * pressure - self.most_mm;
        match self.stopped {
            // Of a wall of no height, too.
            true if past >= self.most_mm => 1.0,
            true => (past / self.most_mm).max(0.0),
            false => 0.0,
        }
    }

    /// How far below the overlap the pad is at a stopped pixel's centre, mm: as far as the object there, once that is pressed.
    pub fn settles(&self, pressure: f32) -> f32 {
        self.most_mm + self.pressed_beside(pressure) * (self.beside_mm - self.most_mm)
    }

    /// Its pressure as a share of the next pixel's, further from the wall: roughly, as beside the edge of a punch.
    pub fn share(&self, own: f32) -> f32 {
        let c = 1.0 / (1.0 + self.compliance * SQUARE / (EDGE * own));
        0.9 * c * (1.0 + c)
    }

    /// Stops if the pressure asks for it. Whether it does.
    pub fn stop(&mut self, pressure: f32) -> bool {
        let stops = !self.stopped && self.compliance * pressure > self.most_mm;
        self.stopped |= stops;
        stops
    }
}

/// The object on the solver's grid.
pub struct Thinned {
    /// The overlap, mm; where a wall leaves a part of a pixel but not its centre, that part's. Empty on the camera's own grid.
    pub penetration: Grid<f32>,
    /// The pixels that a wall cuts.
    pub cut: Vec<CutPixel>,
}

impl Thinned {
    /// Takes the depth map of a camera with pixels of this size to the grid `lattice`. `own` is the displacement of one of its
    /// pixels under pressure 1 on itself, mm.
    pub fn new(lattice: Lattice, depth: &Depth, mm_per_px: [f64; 2], own: f32) -> Self {
        if lattice.factor == 1 {
            return Self { penetration: Grid::default(), cut: Vec::new() };
        }
        let mut thinned = Self { penetration: lattice.thin_out(&depth.penetration, mm_per_px), cut: Vec::new() };
        if depth.touching.is_empty() {
            return thinned;
        }
        let cells = Cells { lattice, fine: &depth.penetration, step_mm: mm_per_px.map(|mm| WALL * mm as f32) };
        let around = lattice.box_around(depth.touching);
        let mut spans = [vec![0.0_f32; depth.penetration.width], vec![0.0_f32; depth.penetration.width]];
        for y in around.y0..around.y1 {
            cells.spans(y, around, &mut spans);
            for x in around.x0..around.x1 {
                if !cells.may_be_cut(x, &spans) {
                    continue;
                }
                if let Some((pixel, penetration)) = cells.cut([x, y], own / SQUARE) {
                    thinned.cut.push(pixel);
                    thinned.penetration.row_mut(y)[x] = penetration;
                }
            }
        }
        thinned
    }
}

/// The camera's pixels in each of the solver's; one that two of them share counts by half.
struct Cells<'a> {
    lattice: Lattice,
    fine: &'a Grid<f32>,
    /// Drop from one fine pixel to the next that is a wall, along x and y.
    step_mm: [f32; 2],
}

impl Cells<'_> {
    /// The highest and lowest overlap of fine columns in a row of pixels.
    fn spans(&self, y: usize, part: Rect, [high, low]: &mut [Vec<f32>; 2]) {
        let columns = self.lattice.holds(part.x0, 0).0.start..self.lattice.holds(part.x1 - 1, 0).0.end;
        let (rows, _) = self.lattice.holds(y, 1);
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

    /// The object may drop by a wall within the pixel, and presses there.
    fn may_be_cut(&self, x: usize, [high, low]: &[Vec<f32>; 2]) -> bool {
        let (columns, _) = self.lattice.holds(x, 0);
        let most = high[columns.clone()].iter().fold(f32::NEG_INFINITY, |most, g| most.max(*g));
        let least = low[columns].iter().fold(f32::INFINITY, |least, g| least.min(*g));
        most > 0.0 && most - least.max(0.0) > (0.5 * most).min(self.step_mm[0].min(self.step_mm[1]))
    }

    /// How far the object reaches below the undeformed pad, mm. What is above is not known of every object alike.
    fn below(&self, [x, y]: [usize; 2]) -> f32 {
        self.fine.at(x, y).max(0.0)
    }

    /// Whether there is a wall between a fine pixel and the next along axis `k`: from 0 to 1.
    fn wall(&self, at: [usize; 2], k: usize) -> f32 {
        let size = [self.fine.width, self.fine.height][k];
        let moved = |by: isize| {
            let mut to = at;
            to[k] = at[k].saturating_add_signed(by).min(size - 1);
            self.below(to)
        };
        let [here, next] = [moved(0), moved(1)];
        let steep = (here - next).abs() / self.step_mm[k] - 1.0;
        // A shallow press reaches its walls but a little way down: there is one where the object would go on by its slope and
        // bend before, and more than half of its depth is missing.
        let ([upper, lower], back) = if here > next { ([here, next], [-1, -2]) } else { ([next, here], [2, 3]) };
        let [before, earlier] = back.map(moved);
        let ahead = (3.0 * (upper - before) + earlier).min(upper);
        let ends = if upper > 0.0 { 2.0 * (ahead - lower) / upper - 1.0 } else { 0.0 };
        let wall = steep.max(ends);
        if wall > 0.0 { wall.min(1.0) } else { 0.0 }
    }

    /// How a wall cuts a pixel, if one does, and the overlap of what it leaves; `unit` is 2 / E' times the pitch.
    fn cut(&self, at: [usize; 2], unit: f32) -> Option<(CutPixel, f32)> {
        let [(columns, halves_x), (rows, halves_y)] = [0, 1].map(|k| self.lattice.holds(at[k], k));
        let (mut most, mut least, mut wall) = (f32::NEG_INFINITY, f32::INFINITY, 0.0_f32);
        for y in rows.clone() {
            for x in columns.clone() {
                let g = self.below([x, y]);
                (most, least) = (most.max(g), least.min(g));
                if x + 1 < columns.end {
                    wall = wall.max(self.wall([x, y], 0));
                }
                if y + 1 < rows.end {
                    wall = wall.max(self.wall([x, y], 1));
                }
            }
        }
        if wall == 0.0 {
            return None;
        }
        // What is above the middle of the drop is the object's face, the rest is beside the wall; in between, partly.
        let on_face = |g: f32| (2.0 * (g - least) / (most - least) - 0.5).clamp(0.0, 1.0);
        let [middle_x, middle_y] = [0, 1].map(|k| self.lattice.centre(at[k], k) as f32);
        let [central_x, central_y] = [0, 1].map(|k| self.lattice.at_centre(at[k], k));
        let border = |at: usize, of: &Range<usize>| at == of.start || at + 1 == of.end;
        let (mut whole, mut covered, mut mean, mut middle) = (0.0, 0.0, 0.0, [0.0; 2]);
        // Of the pixels at the centre, how many are on the face, and their overlap; then of all.
        let (mut central_face, mut centre, mut sums) = (0.0, 0.0, [0.0; 2]);
        for row in rows.clone() {
            let share_y = if halves_y && border(row, &rows) { 0.5 } else { 1.0 };
            for column in columns.clone() {
                let share = if halves_x && border(column, &columns) { 0.5 * share_y } else { share_y };
                let g = self.below([column, row]);
                let face = on_face(g);
                let central = central_x.contains(&column) && central_y.contains(&row);
                whole += share;
                mean += share * g;
                covered += share * face;
                middle[0] += share * face * (column as f32 - middle_x);
                middle[1] += share * face * (row as f32 - middle_y);
                let weight = share * face * if central { CENTRAL } else { 1.0 };
                sums = [sums[0] + weight * g, sums[1] + weight];
                if central {
                    centre += g;
                    central_face += face;
                }
            }
        }
        if covered == whole {
            return None;
        }
        let count = (central_x.len() * central_y.len()) as f32;
        centre /= count;
        let c = covered / whole;
        let goes_on = self.goes_on(at, middle, on_face);
        // A ridge no wider than the pixel is a rigid strip instead of an even pressure.
        let [edge, ridge] = [EDGE * (1.0 - c) / c, ((4.0 / c).ln() / PI - STRIP).max(0.0)];
        let compliance = wall * unit * (ridge + goes_on * (edge - ridge));
        // As deep as its covered part, that at the centre first. What is less than a wall, less of it.
        let beside_mm = wall * (sums[0] / sums[1] - centre);
        let penetration = centre + beside_mm;
        let most_mm = (penetration - mean / whole).max(0.0);
        let centre_covered = 1.0 - wall * (1.0 - central_face / count);
        let pixel = CutPixel { at, compliance, most_mm, beside_mm, centre_covered, stopped: false };
        Some((pixel, penetration))
    }

    /// How far the object's face goes on in the pixels beside one that lie where its covered part does: from 0 to 1.
    fn goes_on(&self, at: [usize; 2], middle: [f32; 2], on_face: impl Fn(f32) -> f32) -> f32 {
        let (size, length) = (self.lattice.size(), middle[0].hypot(middle[1]));
        let towards = |[dx, dy]: &[isize; 2]| {
            let along = *dx as f32 * middle[0] + *dy as f32 * middle[1];
            along > TOWARDS * length * (*dx as f32).hypot(*dy as f32)
        };
        let face = |step: [isize; 2]| {
            let next = [0, 1].map(|k| at[k].saturating_add_signed(step[k]).min(size[k] - 1));
            let [columns, rows] = [0, 1].map(|k| self.lattice.at_centre(next[k], k));
            let pixels = rows.flat_map(|row| columns.clone().map(move |column| [column, row]));
            pixels.map(|px| on_face(self.below(px))).fold(0.0, f32::max)
        };
        AROUND.into_iter().filter(towards).map(face).fold(0.0, f32::max)
    }
}
