//! Walls of the object between the pixels of the solver's grid.
//!
//! Only a part of a pixel that a wall cuts is pressed. If the position of its centre decided, a wall that runs askew to
//! a coarse grid would be a staircase, and the pad beside it would show saw-teeth. So a pixel of which the fraction c
//! is covered counts as pressed, but compliant: under its pressure p it stays a p (1 - c) / c short of the object, as
//! if on a spring, with a = 0.911 (2 / E') times the pixel size. Pressures that are even in each pixel act as if the
//! object ended 0.18 pixels before its wall, whichever way that runs. So c is that of an object larger by 0.18 pixels,
//! whose face goes on as it ends at the wall. Then the pad beside a rigid flat punch moves as much as the punch's edge
//! to within 0.013 of a pixel (Sadowsky's closed form; `tests/physics/walls.rs`).
//!
//! On the camera's own grid only the centres of pixels are known. There a pixel is stiffer that ends a flat face at a
//! wall, because its pressure is highest at the wall and moves its centre less than an even one would. Edges are right to
//! within 0.06 of a pixel, apart from the half pixel by which the wall is not known. A rounded edge, whose pressure is
//! not highest at the wall, stays as it is.

use std::f32::consts::PI;
use std::ops::Range;

use super::lattice::Lattice;
use super::wall_marks::WallMarks;
use crate::base::grid::{Grid, Rect};
use crate::base::simd::simd_dispatch;
use crate::depth::Depth;

/// Slope of the object between two of the camera's pixels above which there is a wall; from twice that slope on it is a
/// full one.
const WALL_SLOPE: f32 = 2.0;

/// Compliance of an edge, in pixel sizes times 2 / E'.
const EDGE_COMPLIANCE: f32 = 0.911;

/// Distance by which the edge of evenly pressed pixels acts inside of where it is, pixel sizes.
const EDGE_SHORTFALL: f32 = 0.18;

/// How much stiffer a pixel is that ends at a wall, in pixel sizes times 2 / E', where only pixel centres tell of the wall.
const EDGE_STIFFENING: f32 = 0.1;

/// Displacement of a pixel's centre under its own pressure, in pixel sizes times 2 / E': for a square pixel, and for
/// one that is endless in one direction.
const SQUARE_COMPLIANCE: f32 = 0.561;
const STRIP_COMPLIANCE: f32 = 0.539;

/// Displacement of the next pixel's centre as a share of the own, on a half-space.
const NEIGHBOUR_SHARE: f32 = 0.284;

/// Steps to the eight neighbours of a pixel.
const NEIGHBOURS: [[isize; 2]; 8] = [[-1, -1], [0, -1], [1, -1], [-1, 0], [1, 0], [-1, 1], [0, 1], [1, 1]];

/// Cosines of the angles between two directions from which on they begin to count as the same, and do in full.
const SAME_DIRECTION: [f32; 2] = [0.6, 0.7];

/// Compression, as a share of the wall's height, from which on the part beside a wall is pressed in full.
const PRESSED_BESIDE: f32 = 0.25;

/// A stopped pixel is freed where its pressure would compress it by less than this share of the limit.
const FREED_BELOW: f32 = 0.98;

/// Number of stops and frees after which a pixel is not freed again: rounding could go on for ever.
const MOST_CHANGES: u8 = 6;

/// Distance of a face's middle from a pixel's centre, in the pixel's size, from which on it lies on one side.
const ASIDE: f32 = 0.1;

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
    /// True if the largest compression is reached; it then stays constant.
    pub is_stopped: bool,
    /// Stops and frees that are left of [`MOST_CHANGES`].
    changes_left: u8,
}

impl PartialPixel {
    /// Makes a pixel that is covered whole and ends at a wall.
    fn at_edge(at: [usize; 2], compliance: f32) -> Self {
        Self {
            at,
            compliance,
            max_compression_mm: 0.0,
            centre_drop_mm: 0.0,
            centre_covered: 1.0,
            is_stopped: false,
            changes_left: MOST_CHANGES,
        }
    }

    /// Returns how far below the penetration the pixel is under a pressure, mm.
    pub fn compression_mm(&self, pressure: f32) -> f32 {
        if self.is_stopped { self.max_compression_mm } else { self.compliance * pressure }
    }

    /// Returns the share of what lies at the pixel's centre that is pressed under a pressure.
    pub fn pressed_centre_share(&self, pressure: f32) -> f32 {
        self.centre_covered + (1.0 - self.centre_covered) * self.pressed_beside_share(pressure)
    }

    /// Returns the share of the part beside the wall that is pressed: 0 where the pixel just stops, 1 where its pressure
    /// would compress it by a part of the wall's height more.
    fn pressed_beside_share(&self, pressure: f32) -> f32 {
        let past = self.compliance * pressure - self.max_compression_mm;
        let height_mm = self.max_compression_mm.max(PRESSED_BESIDE * self.centre_drop_mm.abs());
        match self.is_stopped {
            // Also holds for a wall without height.
            true if past >= height_mm => 1.0,
            true => (past / height_mm).max(0.0),
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

    /// Returns the compression under pressure 1 that is not at its limit, mm.
    pub fn spring(&self) -> f32 {
        if self.is_stopped { 0.0 } else { self.compliance }
    }

    /// Takes over whether the same pixel of another box is stopped.
    pub fn take_state(&mut self, other: &Self) {
        (self.is_stopped, self.changes_left) = (other.is_stopped, other.changes_left);
    }

    /// Stops the compression where the pressure exceeds its limit, and frees it again where the pressure is below; returns
    /// by how much the penetration changes, mm, if it does.
    pub fn stop_or_free(&mut self, pressure: f32) -> Option<f32> {
        let wanted = self.compliance * pressure;
        let changes = match self.is_stopped {
            // A little less, as pressures are known within the tolerance.
            true => wanted < FREED_BELOW * self.max_compression_mm && self.changes_left > 0,
            false => wanted > self.max_compression_mm,
        };
        if !changes {
            return None;
        }
        self.is_stopped ^= true;
        self.changes_left = self.changes_left.saturating_sub(1);
        Some(if self.is_stopped { -self.max_compression_mm } else { self.max_compression_mm })
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
    /// Downsamples a depth map with pixels of this size to the grid `lattice`. `kernel` is the displacement around one of
    /// the lattice's pixels under pressure 1, mm.
    pub fn new(lattice: Lattice, depth: &Depth, mm_per_px: [f64; 2], kernel: &Grid<f32>) -> Self {
        let own = kernel.at(0, 0);
        let beside = kernel.at(1.min(kernel.width - 1), 0) + kernel.at(0, 1.min(kernel.height - 1));
        let cells = PixelBlocks {
            lattice,
            fine: &depth.penetration,
            step_mm: mm_per_px.map(|mm| WALL_SLOPE * mm as f32),
            unit: own / SQUARE_COMPLIANCE,
            deepest_mm: depth.penetration.largest(|g| g),
            sharing: (0.5 * beside / (NEIGHBOUR_SHARE * own)).clamp(0.0, 1.0),
        };
        if lattice.factor == 1 {
            return Self { penetration: Grid::default(), partial_pixels: cells.edge_pixels(depth.touching) };
        }
        let mut downsampled =
            Self { penetration: lattice.downsample(&depth.penetration, mm_per_px), partial_pixels: Vec::new() };
        if depth.touching.is_empty() {
            return downsampled;
        }
        let around = lattice.coarse_box_around(depth.touching);
        let mut spans = [vec![0.0_f32; depth.penetration.width], vec![0.0_f32; depth.penetration.width]];
        let (mut steep, mut marks) = (Vec::new(), WallMarks::default());
        for y in around.y0..around.y1 {
            cells.column_extremes(y, around, &mut spans);
            steep.clear();
            steep.extend((around.x0..around.x1).filter(|x| cells.may_be_partial(*x, &spans)));
            let [Some(first), Some(last)] = [steep.first(), steep.last()] else { continue };
            let columns = cells.around(*first, 0).start..cells.around(*last, 0).end;
            marks.mark(cells.fine, lattice.fine_within(y, 1).0, columns, cells.step_mm);
            for &x in steep.iter().filter(|x| marks.any(lattice.fine_within(**x, 0).0)) {
                if let Some((pixel, penetration)) =
                    cells.partial_pixel([x, y], &marks, downsampled.penetration.at(x, y))
                {
                    downsampled.partial_pixels.push(pixel);
                    downsampled.penetration.row_mut(y)[x] = penetration;
                }
            }
        }
        downsampled
    }
}

/// A wall in or beside one of the solver's pixels.
struct WallDrop {
    /// Penetration over and under the wall, mm.
    most: f32,
    least: f32,
    /// How much of a wall it is where it is steepest, 0 to 1.
    share: f32,
    /// How much it counts in the pixel, 0 to 1.
    weight: f32,
}

impl WallDrop {
    /// Returns how much of what is as deep as `g` lies on the object's face, 0 to 1. Above the middle of the drop is the
    /// face, below it the part beside the wall; near the middle it is a mixture.
    fn face_share(&self, g: f32) -> f32 {
        (2.0 * (g - self.least) / (self.most - self.least) - 0.5).clamp(0.0, 1.0)
    }
}

/// One of the fine pixels in one of the solver's.
struct BlockPixel {
    at: [usize; 2],
    /// How much of it is in the solver's pixel.
    share: f32,
    /// Whether it lies at the solver's pixel's centre.
    central: bool,
}

/// The part of a solver's pixel on the object's face.
struct CoveredPart {
    /// mm under pressure 1 at Young's modulus 1.
    compliance: f32,
    /// Penetration of the face at the pixel's centre, mm.
    face_mm: f32,
    /// How many of the fine pixels at the centre are on the face.
    central_face: f32,
}

/// What lies between two fine pixels.
struct Step {
    /// How much of a wall, 0 to 1.
    share: f32,
    /// Change of the face before it from pixel to pixel towards the wall, mm.
    change_mm: f32,
    /// Slope of the face before it; where it is shallow, as a share of half its depth.
    steepness: f32,
}

/// How much of a fine pixel lies on an object's face.
struct GrownFace {
    /// 0 to 1.
    share: f32,
    /// Penetration of that part, mm.
    depth_mm: f32,
    /// Along x and y: change of the face's penetration from one pixel to the next where it ends at walls, mm, times how
    /// much of them there is; and the latter.
    slopes_mm: [[f32; 2]; 2],
}

/// The camera's pixels in each of the solver's pixels; a pixel that two of them share counts by half.
struct PixelBlocks<'a> {
    lattice: Lattice,
    fine: &'a Grid<f32>,
    /// Drop from one fine pixel to the next above which there is a wall, along x and y.
    step_mm: [f32; 2],
    /// 2 / E' times the solver's pixel size.
    unit: f32,
    /// The object's largest penetration, mm: no face is deeper.
    deepest_mm: f32,
    /// How much of a pixel's pressure moves the next one, 0 to 1: 1 on a thick pad. On one that is thinner than a pixel
    /// pressures do not rise at walls.
    sharing: f32,
}

impl PixelBlocks<'_> {
    /// Finds the highest and the lowest penetration of each fine column within a row of coarse pixels and a fine pixel
    /// around it.
    fn column_extremes(&self, y: usize, part: Rect, [high, low]: &mut [Vec<f32>; 2]) {
        let columns = self.around(part.x0, 0).start..self.around(part.x1 - 1, 0).end;
        let rows = self.around(y, 1);
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

    /// Returns the fine columns or rows in a coarse pixel and the one on either side.
    fn around(&self, coarse: usize, k: usize) -> Range<usize> {
        let (inside, _) = self.lattice.fine_within(coarse, k);
        let size = [self.fine.width, self.fine.height][k];
        inside.start.saturating_sub(1)..(inside.end + 1).min(size)
    }

    /// Returns true if the object may drop by a wall within the pixel or beside it and presses there. A quick test.
    fn may_be_partial(&self, x: usize, [high, low]: &[Vec<f32>; 2]) -> bool {
        let columns = self.around(x, 0);
        // Comparisons, as `max` and `min` take five instructions more to know of NaN, which does not occur here.
        let most = high[columns.clone()].iter().fold(f32::NEG_INFINITY, |most, g| if *g > most { *g } else { most });
        let least = low[columns].iter().fold(f32::INFINITY, |least, g| if *g < least { *g } else { least });
        most > 0.0 && most - least.max(0.0) > (0.5 * most).min(self.step_mm[0].min(self.step_mm[1]))
    }

    /// Returns how far the object reaches below the undeformed pad, mm; 0 above it, as not every object is captured
    /// there.
    fn penetration_at(&self, [x, y]: [usize; 2]) -> f32 {
        self.fine.at(x, y).max(0.0)
    }

    /// Returns what lies between a fine pixel and the next one along axis `k`.
    fn wall_between(&self, at: [usize; 2], k: usize) -> Step {
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
        // A wall that leans may lower the last pixel: the smaller of two slopes counts.
        let (last, inner) = (upper - before, before - earlier);
        let change_mm = if last * inner <= 0.0 { 0.0 } else { last.signum() * last.abs().min(inner.abs()) };
        let flat_mm = (0.5 * upper).min(0.5 * self.step_mm[k]).max(f32::MIN_POSITIVE);
        let steepness = last.abs().max(inner.abs()) / flat_mm;
        Step { share: if wall > 0.0 { wall.min(1.0) } else { 0.0 }, change_mm, steepness }
    }

    /// Finds the pixels that end at a wall, on the camera's own grid, which does not tell where in the next pixel it is.
    fn edge_pixels(&self, touching: Rect) -> Vec<PartialPixel> {
        let mut found = Vec::new();
        let size = [self.fine.width, self.fine.height];
        for y in touching.y0..touching.y1 {
            let rows = [y.saturating_sub(1), y, (y + 1).min(size[1] - 1)].map(|y| self.fine.row(y));
            for x in touching.x0..touching.x1 {
                let g = rows[1][x];
                let beside = [rows[1][x.saturating_sub(1)], rows[1][(x + 1).min(size[0] - 1)], rows[0][x], rows[2][x]];
                let drop = g - beside.into_iter().fold(g, f32::min).max(0.0);
                if drop <= (0.5 * g).min(self.step_mm[0].min(self.step_mm[1])) {
                    continue;
                }
                let walls = self.neighbours([x, y]).filter(|(next, ..)| self.penetration_at(*next) < g);
                let ends = walls.map(|(_, pair, k)| {
                    let step = self.wall_between(pair, k);
                    step.share * (1.0 - step.steepness).max(0.0)
                });
                let wall = ends.fold(0.0, f32::max);
                if wall > 0.0 {
                    found.push(PartialPixel::at_edge([x, y], -EDGE_STIFFENING * self.sharing * wall * self.unit));
                }
            }
        }
        found
    }

    /// Finds the wall in a pixel, and the wall beside it whose higher side is not the pixel's. Their weight is 0 where there
    /// is none. Pairs of pixels without a mark have none.
    fn find_walls(&self, block: &[Range<usize>; 2], marks: &WallMarks) -> [WallDrop; 2] {
        let mut inside = WallDrop { most: f32::NEG_INFINITY, least: f32::INFINITY, share: 0.0, weight: 0.0 };
        let mut beside = WallDrop { most: f32::NEG_INFINITY, least: 0.0, share: 0.0, weight: 0.0 };
        for y in block[1].clone() {
            for x in block[0].clone() {
                let g = self.penetration_at([x, y]);
                (inside.most, inside.least) = (inside.most.max(g), inside.least.min(g));
                for (next, pair, k) in self.neighbours([x, y]).filter(|(_, pair, k)| marks.is_marked(pair[0], *k)) {
                    let higher = self.penetration_at(next);
                    if !block[k].contains(&next[k]) {
                        if higher > g {
                            let share = self.wall_between(pair, k).share;
                            // The beginning of a wall changes nothing at once.
                            beside.most = beside.most.max(g + (higher - g) * (4.0 * share).min(1.0));
                            beside.share = beside.share.max(share);
                        }
                    } else if pair == [x, y] {
                        inside.share = inside.share.max(self.wall_between(pair, k).share);
                    }
                }
            }
        }
        // All of the pixel is on the lower side. Less counts, the higher the pixel reaches.
        beside.least = inside.most;
        let higher = (beside.most - beside.least) / (beside.most - inside.least);
        inside.weight = inside.share;
        beside.weight = (1.0 - inside.share) * beside.share * if higher > 0.0 { higher } else { 0.0 };
        [inside, beside]
    }

    /// Returns how walls in a pixel or beside it cut the pixel, and the penetration of the covered part; `None` if no wall
    /// does. `plain_mm` is the penetration without walls.
    fn partial_pixel(&self, at: [usize; 2], marks: &WallMarks, plain_mm: f32) -> Option<(PartialPixel, f32)> {
        let [(columns, halves_x), (rows, halves_y)] = [0, 1].map(|k| self.lattice.fine_within(at[k], k));
        let block = [columns, rows];
        let walls = self.find_walls(&block, marks);
        if walls.iter().all(|wall| wall.weight == 0.0) {
            return None;
        }
        let central = [0, 1].map(|k| self.lattice.fine_at_centre(at[k], k));
        let (mut whole, mut mean, mut centre) = (0.0, 0.0, 0.0);
        let border = |at: usize, of: &Range<usize>| at == of.start || at + 1 == of.end;
        let mut pixels = Vec::with_capacity(block[0].len() * block[1].len());
        for y in block[1].clone() {
            let share_y = if halves_y && border(y, &block[1]) { 0.5 } else { 1.0 };
            for x in block[0].clone() {
                let share = if halves_x && border(x, &block[0]) { 0.5 * share_y } else { share_y };
                let (g, central) = (self.penetration_at([x, y]), central[0].contains(&x) && central[1].contains(&y));
                (whole, mean) = (whole + share, mean + share * g);
                centre += if central { g } else { 0.0 };
                pixels.push(BlockPixel { at: [x, y], share, central });
            }
        }
        let count = (central[0].len() * central[1].len()) as f32;
        centre /= count;
        // Not every object is captured above the pad.
        let lower_mm = plain_mm.max(0.0);
        let (mut compliance, mut penetration, mut uncovered) = (0.0, lower_mm, 0.0);
        for wall in walls.iter().filter(|wall| wall.weight > 0.0) {
            if let Some(part) = self.covered_part(at, wall, &pixels, whole) {
                compliance += wall.weight * part.compliance;
                // The face, weighted by how much of a wall there is.
                penetration += wall.weight * (part.face_mm - lower_mm);
                uncovered += wall.weight * (1.0 - part.central_face / count);
            }
        }
        if uncovered == 0.0 && compliance == 0.0 {
            return None;
        }
        let pixel = PartialPixel {
            at,
            compliance,
            max_compression_mm: (penetration - mean / whole).max(0.0),
            centre_drop_mm: penetration - centre,
            centre_covered: 1.0 - uncovered,
            is_stopped: false,
            changes_left: MOST_CHANGES,
        };
        Some((pixel, penetration))
    }

    /// Returns the part of a pixel that lies on the object's face, if a wall ends it; `None` if all of it or nothing does.
    fn covered_part(&self, at: [usize; 2], wall: &WallDrop, pixels: &[BlockPixel], whole: f32) -> Option<CoveredPart> {
        let middle = [0, 1].map(|k| self.lattice.centre_px(at[k], k) as f32);
        let (mut covered, mut grown, mut towards, mut central_face) = (0.0, 0.0, [0.0; 2], 0.0);
        // Of the face: its penetration and place, weighted, and its slopes at walls.
        let (mut weights, mut face_mm, mut place, mut slopes) = (0.0, 0.0, [0.0; 2], [[0.0_f32; 2]; 2]);
        for BlockPixel { at, share, central } in pixels {
            let face = wall.face_share(self.penetration_at(*at));
            let more = self.grown_face(*at, face, wall);
            covered += share * face;
            grown += share * more.share;
            central_face += if *central { face } else { 0.0 };
            let weight = share * more.share * if *central { CENTRE_WEIGHT } else { 1.0 };
            (weights, face_mm) = (weights + weight, face_mm + weight * more.depth_mm);
            for k in 0..2 {
                let away = at[k] as f32 - middle[k];
                towards[k] += share * more.share * away;
                place[k] += weight * away;
                (0..2).for_each(|part| slopes[k][part] += more.slopes_mm[k][part]);
            }
        }
        if covered == whole || grown == 0.0 {
            return None;
        }
        // The face of a ridge across the pixel's centre goes on nowhere.
        let aside = towards[0].hypot(towards[1]) / (ASIDE * self.lattice.factor as f32 * grown);
        let goes_on = aside.min(1.0) * self.face_continuation(at, towards, |g| wall.face_share(g));
        let c = (covered + goes_on * (grown - covered)) / whole;
        if c == 0.0 {
            return None;
        }
        // A ridge no wider than the pixel acts as a rigid strip instead of an even pressure.
        let [edge, ridge] = [EDGE_COMPLIANCE * (1.0 - c) / c, ((4.0 / c).ln() / PI - STRIP_COMPLIANCE).max(0.0)];
        // The face is continued to the pixel's centre.
        let fall = |k: usize| slopes[k][0] / slopes[k][1].max(1.0) * place[k];
        Some(CoveredPart {
            compliance: self.unit * (ridge + goes_on * (edge - ridge)),
            face_mm: ((face_mm - fall(0) - fall(1)) / weights).min(self.deepest_mm),
            central_face,
        })
    }

    /// Returns the neighbours of a fine pixel along the axes: each with the first pixel of the pair and the axis.
    fn neighbours(&self, [x, y]: [usize; 2]) -> impl Iterator<Item = ([usize; 2], [usize; 2], usize)> {
        let [right, below] = [x + 1 < self.fine.width, y + 1 < self.fine.height];
        [
            (x > 0).then(|| ([x - 1, y], [x - 1, y], 0)),
            right.then_some(([x + 1, y], [x, y], 0)),
            (y > 0).then(|| ([x, y - 1], [x, y - 1], 1)),
            below.then_some(([x, y + 1], [x, y], 1)),
        ]
        .into_iter()
        .flatten()
    }

    /// Returns how much of a fine pixel, of which the share `face` lies on an object's face, lies on a face that is larger
    /// by [`EDGE_SHORTFALL`].
    fn grown_face(&self, at: [usize; 2], face: f32, wall: &WallDrop) -> GrownFace {
        let g = self.penetration_at(at);
        let mut grown = GrownFace { share: face, depth_mm: g, slopes_mm: [[0.0; 2]; 2] };
        if face == 1.0 {
            return grown;
        }
        // The largest share along x and along y, and the depth, weighted.
        let (mut beside, mut weights, mut depth_mm) = ([0.0_f32; 2], 0.0, 0.0);
        for (next, pair, k) in self.neighbours(at) {
            let upper = self.penetration_at(next);
            if upper > g {
                let step = self.wall_between(pair, k);
                // Pressures are not highest at the wall where the face before it is steep.
                let rising = (2.0 - 0.5 * step.steepness).clamp(0.0, 1.0);
                // In full where the wall is highest: where walls vanish, nothing may change at once.
                let share = rising * wall.face_share(upper) * (step.share / wall.share).min(1.0);
                beside[k] = beside[k].max(share);
                (weights, depth_mm) = (weights + share, depth_mm + share * (upper + step.change_mm));
                let outwards = at[k] as f32 - next[k] as f32;
                let [slopes, shares] = grown.slopes_mm[k];
                grown.slopes_mm[k] = [slopes + share * step.change_mm * outwards, shares + share];
            }
        }
        // Pixels along a wall askew are fewer than along a straight one, and have neighbours on both axes.
        let growth_px = EDGE_SHORTFALL * self.sharing * self.lattice.factor as f32;
        let share = (growth_px * beside[0].hypot(beside[1])).min(1.0);
        if share > face {
            grown.depth_mm = (face * g + (share - face) * (depth_mm / weights).max(g)) / share;
            grown.share = share;
        }
        grown
    }

    /// Returns how far the object's face continues into the neighbours on the covered side of a pixel, 0 to 1.
    fn face_continuation(&self, at: [usize; 2], middle: [f32; 2], on_face: impl Fn(f32) -> f32) -> f32 {
        let (size, length) = (self.lattice.size(), middle[0].hypot(middle[1]));
        let towards = |[dx, dy]: [isize; 2]| {
            let along = dx as f32 * middle[0] + dy as f32 * middle[1];
            let cosine = along / (length * (dx as f32).hypot(dy as f32));
            let [begins, full] = SAME_DIRECTION;
            if cosine > begins { ((cosine - begins) / (full - begins)).min(1.0) } else { 0.0 }
        };
        let face = |step: [isize; 2]| {
            let next = [0, 1].map(|k| at[k].saturating_add_signed(step[k]).min(size[k] - 1));
            let [columns, rows] = [0, 1].map(|k| self.lattice.fine_at_centre(next[k], k));
            let pixels = rows.flat_map(|row| columns.clone().map(move |column| [column, row]));
            pixels.map(|px| on_face(self.penetration_at(px))).fold(0.0, f32::max)
        };
        NEIGHBOURS.into_iter().map(|step| towards(step) * face(step)).fold(0.0, f32::max)
    }
}
