//! Walls of the object between the pixels of the solver's grid.
//!
//! Only a part of a pixel that a wall cuts is pressed. If the position of its centre decided, a wall that runs askew to
//! a coarse grid would be a staircase, and the pad beside it would show saw-teeth. So a pixel of which the fraction c
//! is covered counts as pressed, but compliant: under its pressure p it stays a p (1 - c) / c short of the object, as
//! if on a spring. With a = 0.911 (2 / E') times the pixel size, the pad beside a rigid flat punch moves as much as the
//! punch's edge for any c, to within 0.0065 of a pixel (fitted to Sadowsky's closed form; `tests/physics/walls.rs`).

use std::f32::consts::PI;
use std::ops::Range;

use super::lattice::Lattice;
use crate::base::grid::{Grid, Rect};
use crate::base::simd::simd_dispatch;
use crate::depth::Depth;

/// Slope of the object between two of the camera's pixels above which there is a wall; from twice that slope on it is a
/// full one.
const WALL_SLOPE: f32 = 2.0;

/// Compliance of an edge, in pixel sizes times 2 / E'.
const EDGE_COMPLIANCE: f32 = 0.911;

/// Displacement of a pixel's centre under its own pressure, in pixel sizes times 2 / E': for a square pixel, and for
/// one that is endless in one direction.
const SQUARE_COMPLIANCE: f32 = 0.561;
const STRIP_COMPLIANCE: f32 = 0.539;

/// Steps to the eight neighbours of a pixel.
const NEIGHBOURS: [[isize; 2]; 8] = [[-1, -1], [0, -1], [1, -1], [-1, 0], [1, 0], [-1, 1], [0, 1], [1, 1]];

/// Cosine of the largest angle between two directions that count as the same.
const MIN_COSINE: f32 = 0.64;

/// Weight of the value at a pixel's centre in its penetration.
const CENTRE_WEIGHT: f32 = 4.0;

/// A pixel of the solver's grid that a wall cuts.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PartialPixel {
    /// Column and row.
    pub at: [usize; 2],
    /// Compression under pressure 1 at Young's modulus 1, mm.
    pub compliance: f32,
    /// Largest compression, mm: then the part beside the wall is pressed too, and the pixel is as deep as the object on
    /// average.
    max_compression_mm: f32,
    /// How much lower than the covered part the object is at the pixel's centre, mm.
    centre_drop_mm: f32,
    /// The covered share of what lies at the pixel's centre, 0 to 1.
    centre_covered: f32,
    /// True if the largest compression was reached; it then stays constant.
    pub is_stopped: bool,
}

impl PartialPixel {
    /// Returns how far below the penetration the pixel is under a pressure, mm.
    pub fn compression_mm(&self, pressure: f32) -> f32 {
        if self.is_stopped { self.max_compression_mm } else { self.compliance * pressure }
    }

    /// Returns the share of what lies at the pixel's centre that is pressed under a pressure.
    pub fn pressed_centre_share(&self, pressure: f32) -> f32 {
        self.centre_covered + (1.0 - self.centre_covered) * self.pressed_beside_share(pressure)
    }

    /// Returns the share of the part beside the wall that is pressed: 0 where the pixel just stops, 1 from twice that
    /// pressure on.
    fn pressed_beside_share(&self, pressure: f32) -> f32 {
        let past = self.compliance * pressure - self.max_compression_mm;
        match self.is_stopped {
            // Also holds for a wall without height.
            true if past >= self.max_compression_mm => 1.0,
            true => (past / self.max_compression_mm).max(0.0),
            false => 0.0,
        }
    }

    /// Returns how far below the penetration the pad is at a stopped pixel's centre, mm: as far as the object there,
    /// once that part is pressed.
    pub fn settled_mm(&self, pressure: f32) -> f32 {
        self.max_compression_mm + self.pressed_beside_share(pressure) * (self.centre_drop_mm - self.max_compression_mm)
    }

    /// Estimates the pixel's pressure as a share of the next pixel's, farther from the wall: roughly that at the edge
    /// of a punch.
    pub fn pressure_share(&self, own: f32) -> f32 {
        let c = 1.0 / (1.0 + self.compliance * SQUARE_COMPLIANCE / (EDGE_COMPLIANCE * own));
        0.9 * c * (1.0 + c)
    }

    /// Stops the compression if the pressure exceeds its limit; returns true if it was stopped now.
    pub fn stop_at_limit(&mut self, pressure: f32) -> bool {
        let stops = !self.is_stopped && self.compliance * pressure > self.max_compression_mm;
        self.is_stopped |= stops;
        stops
    }
}

/// The object on the solver's grid.
pub struct DownsampledObject {
    /// Penetration, mm; where a wall leaves out a pixel's centre but not all of the pixel, that of the covered part.
    /// Empty on the camera's own grid.
    pub penetration: Grid<f32>,
    /// The pixels that a wall cuts.
    pub partial_pixels: Vec<PartialPixel>,
}

impl DownsampledObject {
    /// Downsamples a depth map with pixels of this size to the grid `lattice`. `own` is the displacement of one of the
    /// lattice's pixels under pressure 1 on itself, mm.
    pub fn new(lattice: Lattice, depth: &Depth, mm_per_px: [f64; 2], own: f32) -> Self {
        if lattice.factor == 1 {
            return Self { penetration: Grid::default(), partial_pixels: Vec::new() };
        }
        let mut downsampled =
            Self { penetration: lattice.downsample(&depth.penetration, mm_per_px), partial_pixels: Vec::new() };
        if depth.touching.is_empty() {
            return downsampled;
        }
        let cells =
            PixelBlocks { lattice, fine: &depth.penetration, step_mm: mm_per_px.map(|mm| WALL_SLOPE * mm as f32) };
        let around = lattice.coarse_box_around(depth.touching);
        let mut spans = [vec![0.0_f32; depth.penetration.width], vec![0.0_f32; depth.penetration.width]];
        for y in around.y0..around.y1 {
            cells.column_extremes(y, around, &mut spans);
            for x in around.x0..around.x1 {
                if !cells.may_be_partial(x, &spans) {
                    continue;
                }
                if let Some((pixel, penetration)) = cells.partial_pixel([x, y], own / SQUARE_COMPLIANCE) {
                    downsampled.partial_pixels.push(pixel);
                    downsampled.penetration.row_mut(y)[x] = penetration;
                }
            }
        }
        downsampled
    }
}

/// The camera's pixels in each of the solver's pixels; a pixel that two of them share counts by half.
struct PixelBlocks<'a> {
    lattice: Lattice,
    fine: &'a Grid<f32>,
    /// Drop from one fine pixel to the next above which there is a wall, along x and y.
    step_mm: [f32; 2],
}

impl PixelBlocks<'_> {
    /// Finds the highest and the lowest penetration of each fine column within a row of coarse pixels.
    fn column_extremes(&self, y: usize, part: Rect, [high, low]: &mut [Vec<f32>; 2]) {
        let columns = self.lattice.fine_within(part.x0, 0).0.start..self.lattice.fine_within(part.x1 - 1, 0).0.end;
        let (rows, _) = self.lattice.fine_within(y, 1);
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

    /// Returns true if the object may drop by a wall within the pixel and presses there. A quick test.
    fn may_be_partial(&self, x: usize, [high, low]: &[Vec<f32>; 2]) -> bool {
        let (columns, _) = self.lattice.fine_within(x, 0);
        let most = high[columns.clone()].iter().fold(f32::NEG_INFINITY, |most, g| most.max(*g));
        let least = low[columns].iter().fold(f32::INFINITY, |least, g| least.min(*g));
        most > 0.0 && most - least.max(0.0) > (0.5 * most).min(self.step_mm[0].min(self.step_mm[1]))
    }

    /// Returns how far the object reaches below the undeformed pad, mm; 0 above it, as not every object is captured
    /// there.
    fn penetration_at(&self, [x, y]: [usize; 2]) -> f32 {
        self.fine.at(x, y).max(0.0)
    }

    /// Returns how much of a wall, 0 to 1, lies between a fine pixel and the next one along axis `k`.
    fn wall_share(&self, at: [usize; 2], k: usize) -> f32 {
        let size = [self.fine.width, self.fine.height][k];
        let moved = |by: isize| {
            let mut to = at;
            to[k] = at[k].saturating_add_signed(by).min(size - 1);
            self.penetration_at(to)
        };
        let [here, next] = [moved(0), moved(1)];
        let steep = (here - next).abs() / self.step_mm[k] - 1.0;
        // A shallow press reaches only a little way down a wall. There is a wall if the object would continue by its
        // slope and curvature, and more than half of its depth is missing.
        let ([upper, lower], back) = if here > next { ([here, next], [-1, -2]) } else { ([next, here], [2, 3]) };
        let [before, earlier] = back.map(moved);
        let ahead = (3.0 * (upper - before) + earlier).min(upper);
        let ends = if upper > 0.0 { 2.0 * (ahead - lower) / upper - 1.0 } else { 0.0 };
        let wall = steep.max(ends);
        if wall > 0.0 { wall.min(1.0) } else { 0.0 }
    }

    /// Returns how a wall cuts a pixel, and the penetration of the covered part; `None` if no wall does. `unit` is 2 /
    /// E' times the pixel size.
    fn partial_pixel(&self, at: [usize; 2], unit: f32) -> Option<(PartialPixel, f32)> {
        let [(columns, halves_x), (rows, halves_y)] = [0, 1].map(|k| self.lattice.fine_within(at[k], k));
        let (mut most, mut least, mut wall) = (f32::NEG_INFINITY, f32::INFINITY, 0.0_f32);
        for y in rows.clone() {
            for x in columns.clone() {
                let g = self.penetration_at([x, y]);
                (most, least) = (most.max(g), least.min(g));
                if x + 1 < columns.end {
                    wall = wall.max(self.wall_share([x, y], 0));
                }
                if y + 1 < rows.end {
                    wall = wall.max(self.wall_share([x, y], 1));
                }
            }
        }
        if wall == 0.0 {
            return None;
        }
        // Above the middle of the drop is the object's face, below it the part beside the wall; near the middle it is a
        // mixture.
        let on_face = |g: f32| (2.0 * (g - least) / (most - least) - 0.5).clamp(0.0, 1.0);
        let [middle_x, middle_y] = [0, 1].map(|k| self.lattice.centre_px(at[k], k) as f32);
        let [central_x, central_y] = [0, 1].map(|k| self.lattice.fine_at_centre(at[k], k));
        let border = |at: usize, of: &Range<usize>| at == of.start || at + 1 == of.end;
        let (mut whole, mut covered, mut mean, mut middle) = (0.0, 0.0, 0.0, [0.0; 2]);
        // For the pixels at the centre: how many are on the face, and their penetration; then for all pixels.
        let (mut central_face, mut centre, mut sums) = (0.0, 0.0, [0.0; 2]);
        for row in rows.clone() {
            let share_y = if halves_y && border(row, &rows) { 0.5 } else { 1.0 };
            for column in columns.clone() {
                let share = if halves_x && border(column, &columns) { 0.5 * share_y } else { share_y };
                let g = self.penetration_at([column, row]);
                let face = on_face(g);
                let central = central_x.contains(&column) && central_y.contains(&row);
                whole += share;
                mean += share * g;
                covered += share * face;
                middle[0] += share * face * (column as f32 - middle_x);
                middle[1] += share * face * (row as f32 - middle_y);
                let weight = share * face * if central { CENTRE_WEIGHT } else { 1.0 };
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
        let goes_on = self.face_continuation(at, middle, on_face);
        // A ridge no wider than the pixel acts as a rigid strip instead of an even pressure.
        let [edge, ridge] = [EDGE_COMPLIANCE * (1.0 - c) / c, ((4.0 / c).ln() / PI - STRIP_COMPLIANCE).max(0.0)];
        let compliance = wall * unit * (ridge + goes_on * (edge - ridge));
        // As deep as the covered part, mainly that at the centre; weighted by how much of a wall there is.
        let centre_drop_mm = wall * (sums[0] / sums[1] - centre);
        let penetration = centre + centre_drop_mm;
        let max_compression_mm = (penetration - mean / whole).max(0.0);
        let centre_covered = 1.0 - wall * (1.0 - central_face / count);
        let pixel =
            PartialPixel { at, compliance, max_compression_mm, centre_drop_mm, centre_covered, is_stopped: false };
        Some((pixel, penetration))
    }

    /// Returns how far the object's face continues into the neighbours on the covered side of a pixel, 0 to 1.
    fn face_continuation(&self, at: [usize; 2], middle: [f32; 2], on_face: impl Fn(f32) -> f32) -> f32 {
        let (size, length) = (self.lattice.size(), middle[0].hypot(middle[1]));
        let towards = |[dx, dy]: &[isize; 2]| {
            let along = *dx as f32 * middle[0] + *dy as f32 * middle[1];
            along > MIN_COSINE * length * (*dx as f32).hypot(*dy as f32)
        };
        let face = |step: [isize; 2]| {
            let next = [0, 1].map(|k| at[k].saturating_add_signed(step[k]).min(size[k] - 1));
            let [columns, rows] = [0, 1].map(|k| self.lattice.fine_at_centre(next[k], k));
            let pixels = rows.flat_map(|row| columns.clone().map(move |column| [column, row]));
            pixels.map(|px| on_face(self.penetration_at(px))).fold(0.0, f32::max)
        };
        NEIGHBOURS.into_iter().filter(towards).map(face).fold(0.0, f32::max)
    }
}
