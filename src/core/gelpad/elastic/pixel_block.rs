//! One of the solver's pixels: how walls of the object cut it, seen on the camera's pixels in and around it.

use std::f32::consts::PI;
use std::ops::Range;

use super::lattice::Lattice;
use super::partial_pixels::{EDGE_COMPLIANCE, PartialPixel, SQUARE_COMPLIANCE};
use super::wall_marks::WallMarks;
use crate::base::grid::Grid;
use crate::base::simd::{larger, smaller};
use crate::depth::Depth;

/// Distance by which the edge of evenly pressed pixels acts inside of where it is, pixel sizes.
const EDGE_SHORTFALL: f32 = 0.18;

/// Like [`SQUARE_COMPLIANCE`], for a pixel that is endless in one direction.
const STRIP_COMPLIANCE: f32 = 0.539;

/// Displacement of the next pixel's centre as a share of the own, on a half-space.
const NEIGHBOUR_SHARE: f32 = 0.284;

/// Steps to the eight neighbours of a pixel.
const NEIGHBOURS: [[isize; 2]; 8] = [[-1, -1], [0, -1], [1, -1], [-1, 0], [1, 0], [-1, 1], [0, 1], [1, 1]];

/// Cosines of the angles between two directions from which on they begin to count as the same, and do in full.
const SAME_DIRECTION: [f32; 2] = [0.6, 0.7];

/// Distance of a face's middle from a pixel's centre, in the pixel's size, from which on it lies on one side.
const ASIDE: f32 = 0.1;

/// Weight of the value at a pixel's centre in its penetration.
const CENTRE_WEIGHT: f32 = 4.0;

/// Slope of the object between two of the camera's pixels above which there is a wall; from twice that slope on it is a
/// full one.
const WALL_SLOPE: f32 = 2.0;

/// Most of the camera's pixels along a side of the solver's.
const MOST_PX: usize = 5;

/// Camera's pixels around a block that its walls depend on: two before a pair that begins beside the block, and two
/// beyond a pair that ends beside it.
const AROUND_PX: usize = 3;

/// Pixels along a side of a patch.
const SIDE: usize = MOST_PX + 2 * AROUND_PX;

/// What all of the solver's pixels on an object have in common.
pub struct WallScale {
    /// Which of the camera's pixels each of the solver's consists of.
    pub lattice: Lattice,
    /// Drop from one of the camera's pixels to the next above which there is a wall, along x and y.
    pub step_mm: [f32; 2],
    /// 2 / E' times the solver's pixel size.
    pub unit: f32,
    /// The object's largest penetration, mm: no face is deeper.
    deepest_mm: f32,
    /// How much of a pixel's pressure moves the next one, 0 to 1: 1 on a thick pad. On one that is thinner than a pixel
    /// pressures do not rise at walls.
    pub sharing: f32,
}

impl WallScale {
    /// Describes an object on pixels of this size. `kernel` is the displacement around one of the solver's pixels under
    /// pressure 1, mm.
    pub fn new(lattice: Lattice, depth: &Depth, mm_per_px: [f64; 2], kernel: &Grid<f32>) -> Self {
        let own = kernel.at(0, 0);
        let beside = kernel.at(1.min(kernel.width - 1), 0) + kernel.at(0, 1.min(kernel.height - 1));
        Self {
            lattice,
            step_mm: mm_per_px.map(|mm| WALL_SLOPE * mm as f32),
            unit: own / SQUARE_COMPLIANCE,
            deepest_mm: depth.largest_penetration_mm(),
            sharing: (0.5 * beside / (NEIGHBOUR_SHARE * own)).clamp(0.0, 1.0),
        }
    }

    /// Returns the smallest drop that may be a wall.
    pub fn least_step_mm(&self) -> f32 {
        self.step_mm[0].min(self.step_mm[1])
    }
}

/// What lies between two of the camera's pixels.
pub struct Step {
    /// How much of a wall, 0 to 1.
    pub share: f32,
    /// Change of the face before it from pixel to pixel towards the wall, mm.
    change_mm: f32,
    /// Slope of the face before it; where it is shallow, as a share of half its depth.
    pub steepness: f32,
}

impl Step {
    /// Returns what lies between two pixels `here` and `next`, given two pixels before them and two beyond. All are
    /// penetrations, 0 above the undeformed pad.
    #[inline(always)]
    pub fn between([earlier, before, here, next, beyond, farther]: [f32; 6], step_mm: f32) -> Self {
        let steep = (here - next).abs() / step_mm - 1.0;
        // A shallow press reaches only a little way down a wall. There is a wall if the object would continue by its
        // slope and curvature, and more than half of its depth is missing.
        let falls = here > next;
        let (upper, lower) = if falls { (here, next) } else { (next, here) };
        let (before, earlier) = if falls { (before, earlier) } else { (beyond, farther) };
        let ahead = smaller(3.0 * (upper - before) + earlier, upper);
        let ends = if upper > 0.0 { 2.0 * (ahead - lower) / upper - 1.0 } else { 0.0 };
        let wall = larger(steep, ends);
        // A wall that leans may lower the last pixel: the smaller of two slopes counts.
        let (last, inner) = (upper - before, before - earlier);
        let change_mm = if last * inner <= 0.0 { 0.0 } else { last.signum() * smaller(last.abs(), inner.abs()) };
        let flat_mm = larger(smaller(0.5 * upper, 0.5 * step_mm), f32::MIN_POSITIVE);
        let steepness = larger(last.abs(), inner.abs()) / flat_mm;
        Self { share: if wall > 0.0 { smaller(wall, 1.0) } else { 0.0 }, change_mm, steepness }
    }
}

/// Returns the length of a vector.
#[inline(always)]
fn length([x, y]: [f32; 2]) -> f32 {
    let [x, y] = [x, y].map(f64::from);
    (x * x + y * y).sqrt() as f32
}

/// A wall in or beside a block.
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
    #[inline(always)]
    fn face_share(&self, g: f32) -> f32 {
        (2.0 * (g - self.least) / (self.most - self.least) - 0.5).clamp(0.0, 1.0)
    }
}

/// The part of a block on the object's face.
struct CoveredPart {
    /// mm under pressure 1 at Young's modulus 1.
    compliance: f32,
    /// Penetration of the face at the pixel's centre, mm.
    face_mm: f32,
    /// How many of the camera's pixels at the centre are on the face.
    central_face: f32,
}

/// How much of one of the camera's pixels lies on an object's face.
struct GrownFace {
    /// 0 to 1.
    share: f32,
    /// Penetration of that part, mm.
    depth_mm: f32,
    /// Along x and y: change of the face's penetration from one pixel to the next where it ends at walls, mm, times how
    /// much of them there is; and the latter.
    slopes_mm: [[f32; 2]; 2],
}

/// The camera's pixels in one of the solver's, and those around it.
pub struct PixelBlock<'a> {
    scale: &'a WallScale,
    /// Column and row of the solver's pixel.
    at: [usize; 2],
    /// Penetration, mm; 0 above the undeformed pad, as not every object is captured there. The image's border values are
    /// repeated beyond it.
    patch: [f32; SIDE * SIDE],
    /// Whether pairs along x and along y may have a wall between them, by the patch's column of their first pixel.
    marked: [[bool; SIDE]; 2],
    /// Columns and rows of the patch in the block, those at its centre, and where the centre is.
    block: [Range<usize>; 2],
    central: [Range<usize>; 2],
    middle: [f32; 2],
    /// True along x or y if the first and the last of the block's pixels are in it by half.
    halves: [bool; 2],
}

impl<'a> PixelBlock<'a> {
    /// Copies what lies in and around the solver's pixel `at`. Pairs without a mark have no wall between them.
    pub fn new(scale: &'a WallScale, fine: &Grid<f32>, marks: &WallMarks, at: [usize; 2]) -> Self {
        let lattice = scale.lattice;
        let [(columns, halves_x), (rows, halves_y)] = [0, 1].map(|k| lattice.fine_within(at[k], k));
        let corner = [&columns, &rows].map(|range| range.start as isize - AROUND_PX as isize);
        let inside = |at: usize, k: usize, size: usize| (corner[k] + at as isize).clamp(0, size as isize - 1) as usize;
        let wide = columns.len() + 2 * AROUND_PX;
        let mut patch = [0.0; SIDE * SIDE];
        for y in 0..rows.len() + 2 * AROUND_PX {
            let row = fine.row(inside(y, 1, fine.height));
            let to = &mut patch[y * SIDE..][..wide];
            match usize::try_from(corner[0]).ok().and_then(|start| row.get(start..start + wide)) {
                Some(row) => to.iter_mut().zip(row).for_each(|(to, g)| *to = larger(*g, 0.0)),
                None => to.iter_mut().enumerate().for_each(|(x, to)| *to = larger(row[inside(x, 0, fine.width)], 0.0)),
            }
        }
        let marked = [0, 1].map(|k| {
            let mut marked = [false; SIDE];
            for (x, marked) in marked.iter_mut().enumerate().take(wide) {
                let column = usize::try_from(corner[0] + x as isize).ok().filter(|column| *column < fine.width);
                *marked = column.is_some_and(|column| marks.is_marked(column, k));
            }
            marked
        });
        let relative = |k: usize, range: Range<usize>| {
            let moved = |at: usize| (at as isize - corner[k]) as usize;
            moved(range.start)..moved(range.end)
        };
        Self {
            scale,
            at,
            patch,
            marked,
            block: [relative(0, columns), relative(1, rows)],
            central: [0, 1].map(|k| relative(k, lattice.fine_at_centre(at[k], k))),
            middle: [0, 1].map(|k| (lattice.centre_px(at[k], k) - corner[k] as f64) as f32),
            halves: [halves_x, halves_y],
        }
    }

    /// Returns how walls in the pixel or beside it cut it, and the penetration of the covered part; `None` if no wall
    /// does. `plain_mm` is the penetration without walls.
    pub fn partial_pixel(&self, plain_mm: f32) -> Option<(PartialPixel, f32)> {
        let walls = self.find_walls();
        if walls.iter().all(|wall| wall.weight == 0.0) {
            return None;
        }
        let (mut whole, mut mean, mut centre) = (0.0, 0.0, 0.0);
        for y in self.block[1].clone() {
            for x in self.block[0].clone() {
                let (share, g) = (self.share_inside([x, y]), self.patch[y * SIDE + x]);
                (whole, mean) = (whole + share, mean + share * g);
                centre += if self.is_central([x, y]) { g } else { 0.0 };
            }
        }
        let count = (self.central[0].len() * self.central[1].len()) as f32;
        centre /= count;
        // Not every object is captured above the pad.
        let lower_mm = plain_mm.max(0.0);
        let (mut compliance, mut penetration, mut uncovered) = (0.0, lower_mm, 0.0);
        for wall in walls.iter().filter(|wall| wall.weight > 0.0) {
            if let Some(part) = self.covered_part(wall, whole) {
                compliance += wall.weight * part.compliance;
                // The face, weighted by how much of a wall there is.
                penetration += wall.weight * (part.face_mm - lower_mm);
                uncovered += wall.weight * (1.0 - part.central_face / count);
            }
        }
        if uncovered == 0.0 && compliance == 0.0 {
            return None;
        }
        let limit_mm = (penetration - mean / whole).max(0.0);
        Some((PartialPixel::cut(self.at, compliance, limit_mm, penetration - centre, 1.0 - uncovered), penetration))
    }

    /// Returns how much of a pixel lies in the block.
    #[inline(always)]
    fn share_inside(&self, at: [usize; 2]) -> f32 {
        let of = |k: usize| {
            let Range { start, end } = self.block[k];
            if self.halves[k] && (at[k] == start || at[k] + 1 == end) { 0.5 } else { 1.0 }
        };
        of(0) * of(1)
    }

    /// Returns true if a pixel lies at the block's centre.
    #[inline(always)]
    fn is_central(&self, [x, y]: [usize; 2]) -> bool {
        self.central[0].contains(&x) && self.central[1].contains(&y)
    }

    /// Returns what lies between a pixel and the next one along axis `k`.
    #[inline(always)]
    fn step_from(&self, pair: usize, k: usize) -> Step {
        let stride = [1, SIDE][k];
        let around = &self.patch[pair - 2 * stride..][..5 * stride + 1];
        Step::between([0, 1, 2, 3, 4, 5].map(|at| around[at * stride]), self.scale.step_mm[k])
    }

    /// Calls `visit` for the neighbours of a pixel along the axes that a wall may divide from it: each with its index in
    /// the patch, that of the pair's first pixel, and the axis.
    #[inline(always)]
    fn visit_neighbours(&self, [x, y]: [usize; 2], mut visit: impl FnMut(usize, usize, usize)) {
        let here = y * SIDE + x;
        if self.marked[0][x - 1] {
            visit(here - 1, here - 1, 0);
        }
        if self.marked[0][x] {
            visit(here + 1, here, 0);
        }
        if self.marked[1][x] {
            visit(here - SIDE, here - SIDE, 1);
            visit(here + SIDE, here, 1);
        }
    }

    /// Finds the wall in the block, and the wall beside it whose higher side is not the block's. Their weight is 0 where
    /// there is none.
    fn find_walls(&self) -> [WallDrop; 2] {
        let mut inside = WallDrop { most: f32::NEG_INFINITY, least: f32::INFINITY, share: 0.0, weight: 0.0 };
        let mut beside = WallDrop { most: f32::NEG_INFINITY, least: 0.0, share: 0.0, weight: 0.0 };
        for y in self.block[1].clone() {
            for x in self.block[0].clone() {
                let (here, g) = (y * SIDE + x, self.patch[y * SIDE + x]);
                (inside.most, inside.least) = (larger(inside.most, g), smaller(inside.least, g));
                self.visit_neighbours(
                    [x, y],
                    #[inline(always)]
                    |next, pair, k| {
                        let higher = self.patch[next];
                        let there = if k == 0 { next % SIDE } else { next / SIDE };
                        if !self.block[k].contains(&there) {
                            if higher > g {
                                let share = self.step_from(pair, k).share;
                                // The beginning of a wall changes nothing at once.
                                beside.most = larger(beside.most, g + (higher - g) * smaller(4.0 * share, 1.0));
                                beside.share = larger(beside.share, share);
                            }
                        } else if pair == here {
                            inside.share = larger(inside.share, self.step_from(pair, k).share);
                        }
                    },
                );
            }
        }
        // All of the pixel is on the lower side. Less counts, the higher the pixel reaches.
        beside.least = inside.most;
        let higher = (beside.most - beside.least) / (beside.most - inside.least);
        inside.weight = inside.share;
        beside.weight = (1.0 - inside.share) * beside.share * if higher > 0.0 { higher } else { 0.0 };
        [inside, beside]
    }

    /// Returns the part of the block that lies on the object's face, if a wall ends it; `None` if all of it or nothing
    /// does. `whole` is the number of the camera's pixels in the block.
    fn covered_part(&self, wall: &WallDrop, whole: f32) -> Option<CoveredPart> {
        let (mut covered, mut grown, mut towards, mut central_face) = (0.0, 0.0, [0.0; 2], 0.0);
        // Of the face: its penetration and place, weighted, and its slopes at walls.
        let (mut weights, mut face_mm, mut place, mut slopes) = (0.0, 0.0, [0.0; 2], [[0.0_f32; 2]; 2]);
        for y in self.block[1].clone() {
            for x in self.block[0].clone() {
                let (share, central) = (self.share_inside([x, y]), self.is_central([x, y]));
                let face = wall.face_share(self.patch[y * SIDE + x]);
                let more = self.grown_face([x, y], face, wall);
                covered += share * face;
                grown += share * more.share;
                central_face += if central { face } else { 0.0 };
                let weight = share * more.share * if central { CENTRE_WEIGHT } else { 1.0 };
                (weights, face_mm) = (weights + weight, face_mm + weight * more.depth_mm);
                for k in 0..2 {
                    let away = [x, y][k] as f32 - self.middle[k];
                    towards[k] += share * more.share * away;
                    place[k] += weight * away;
                    (0..2).for_each(|part| slopes[k][part] += more.slopes_mm[k][part]);
                }
            }
        }
        if covered == whole || grown == 0.0 {
            return None;
        }
        // The face of a ridge across the pixel's centre goes on nowhere.
        let aside = length(towards) / (ASIDE * self.scale.lattice.factor as f32 * grown);
        let goes_on = aside.min(1.0) * self.face_continuation(towards, wall);
        let c = (covered + goes_on * (grown - covered)) / whole;
        if c == 0.0 {
            return None;
        }
        // A ridge no wider than the pixel acts as a rigid strip instead of an even pressure.
        let ridge = (libm::logf(4.0 / c) / PI - STRIP_COMPLIANCE).max(0.0);
        let edge = EDGE_COMPLIANCE * (1.0 - c) / c;
        // The face is continued to the pixel's centre.
        let fall = |k: usize| slopes[k][0] / slopes[k][1].max(1.0) * place[k];
        Some(CoveredPart {
            compliance: self.scale.unit * (ridge + goes_on * (edge - ridge)),
            face_mm: ((face_mm - fall(0) - fall(1)) / weights).min(self.scale.deepest_mm),
            central_face,
        })
    }

    /// Returns how much of a pixel, of which the share `face` lies on an object's face, lies on a face that is larger by
    /// [`EDGE_SHORTFALL`].
    #[inline(always)]
    fn grown_face(&self, at: [usize; 2], face: f32, wall: &WallDrop) -> GrownFace {
        let here = at[1] * SIDE + at[0];
        let g = self.patch[here];
        let mut grown = GrownFace { share: face, depth_mm: g, slopes_mm: [[0.0; 2]; 2] };
        if face == 1.0 {
            return grown;
        }
        // The largest share along x and along y, and the depth, weighted.
        let (mut beside, mut weights, mut depth_mm) = ([0.0_f32; 2], 0.0, 0.0);
        self.visit_neighbours(
            at,
            #[inline(always)]
            |next, pair, k| {
                let upper = self.patch[next];
                if upper > g {
                    let step = self.step_from(pair, k);
                    // Pressures are not highest at the wall where the face before it is steep.
                    let rising = (2.0 - 0.5 * step.steepness).clamp(0.0, 1.0);
                    // In full where the wall is highest: where walls vanish, nothing may change at once.
                    let share = rising * wall.face_share(upper) * smaller(step.share / wall.share, 1.0);
                    beside[k] = larger(beside[k], share);
                    (weights, depth_mm) = (weights + share, depth_mm + share * (upper + step.change_mm));
                    let outwards = if next < here { 1.0 } else { -1.0 };
                    let [slopes, shares] = grown.slopes_mm[k];
                    grown.slopes_mm[k] = [slopes + share * step.change_mm * outwards, shares + share];
                }
            },
        );
        // Pixels along a wall askew are fewer than along a straight one, and have neighbours on both axes.
        let growth_px = EDGE_SHORTFALL * self.scale.sharing * self.scale.lattice.factor as f32;
        let share = (growth_px * length(beside)).min(1.0);
        if share > face {
            grown.depth_mm = (face * g + (share - face) * (depth_mm / weights).max(g)) / share;
            grown.share = share;
        }
        grown
    }

    /// Returns how far the object's face continues into the neighbours on the covered side of the block, 0 to 1.
    fn face_continuation(&self, middle: [f32; 2], wall: &WallDrop) -> f32 {
        let distance = length(middle);
        let mut most = 0.0;
        for step in NEIGHBOURS {
            let along = step[0] as f32 * middle[0] + step[1] as f32 * middle[1];
            let cosine = along / (distance * length(step.map(|px| px as f32)));
            let [begins, full] = SAME_DIRECTION;
            if cosine > begins {
                let towards = ((cosine - begins) / (full - begins)).min(1.0);
                most = larger(most, towards * self.face_in_neighbour(step, wall));
            }
        }
        most
    }

    /// Returns how much of the centre of a neighbour in the solver's grid lies on the object's face, 0 to 1.
    fn face_in_neighbour(&self, step: [isize; 2], wall: &WallDrop) -> f32 {
        let lattice = self.scale.lattice;
        let [columns, rows] = [0, 1].map(|k| {
            // The solver's grid ends with the image.
            let beyond = self.at[k].checked_add_signed(step[k]).is_none_or(|next| next >= lattice.size()[k]);
            let by = if beyond { 0 } else { step[k] * lattice.factor as isize };
            self.central[k].start.saturating_add_signed(by)..self.central[k].end.saturating_add_signed(by)
        });
        let mut face = 0.0;
        for y in rows {
            for x in columns.clone() {
                face = larger(face, wall.face_share(self.patch[y * SIDE + x]));
            }
        }
        face
    }
}
