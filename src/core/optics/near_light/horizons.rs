//! How high the surface stands around each point, in some azimuths: the shadows of all near LEDs, and how much of the
//! light of its surroundings a point receives.
//!
//! With w the displacement and d the distance, the horizon's slope in an azimuth is the largest (w(d) - w(0)) / d
//! (horizon mapping: Max 1988). It is taken at steps of a pixel of the grid, and of a share of the distance further
//! off, there at the nearest pixel. Between two azimuths it is linear. Beyond the grid the surface goes on as at its border.

use crate::base::angle::sin_cos_deg;
use crate::base::grid::{Grid, Rect};
use crate::base::simd::simd_dispatch;
use crate::base::view::SURFACE_BORDER;

/// Steps grow to this share of the distance.
const STEP_SHARE: f64 = 0.12;
/// Steps, pixels, up to which heights between pixels are interpolated. Further off the nearest pixel is taken, a few
/// degrees aside at most.
const INTERPOLATED_PX: f64 = 4.5;

/// Columns and rows of the blocks in which the surface is searched.
pub(crate) const BLOCK: usize = 16;
// Windows and lanes are combined by halves of it.
const _: () = assert!(BLOCK == 16);

/// One more, to interpolate.
const WIDER: usize = BLOCK + 1;

/// Returns the values of a row from column `x` on.
#[inline(always)]
fn read<const COUNT: usize>(row: &[f32], x: usize) -> &[f32; COUNT] {
    row[x..].first_chunk().expect("the surface is wide enough")
}

/// A step in an azimuth.
struct Step {
    /// Its end, whole pixels along x and y.
    whole_px: [isize; 2],
    /// Where between that pixel and the next ones it ends; `None` for the pixel itself.
    between: Option<[f32; 2]>,
    /// Inverse of its length, 1/mm.
    per_mm: f32,
    /// What rises by less at its end is not seen, mm.
    rise_mm: f32,
}

impl Step {
    fn new(distance_mm: f64, (sin, cos): (f64, f64), pixel_mm: [f64; 2], flattest: f32) -> Self {
        let offset = [cos * distance_mm / pixel_mm[0], sin * distance_mm / pixel_mm[1]];
        let interpolated = libm::hypot(offset[0], offset[1]) < INTERPOLATED_PX;
        let whole = offset.map(|px| libm::floor(if interpolated { px } else { px + 0.5 }));
        let between = interpolated.then(|| std::array::from_fn(|k| (offset[k] - whole[k]) as f32));
        let length_mm =
            if interpolated { distance_mm } else { libm::hypot(whole[0] * pixel_mm[0], whole[1] * pixel_mm[1]) };
        Self {
            whole_px: whole.map(|px| px as isize),
            between,
            per_mm: (1.0 / length_mm) as f32,
            rise_mm: flattest * (0.9 * length_mm.min(distance_mm)) as f32,
        }
    }
}

/// Takes the steeper of each slope of a block's row and another.
#[inline(always)]
fn take_steeper(slopes: &mut [f32], others: [f32; BLOCK]) {
    let slopes: &mut [f32; BLOCK] = slopes.first_chunk_mut().expect("planes hold entire blocks");
    // A comparison and a choice would become a store of single lanes, which is slow; so would a sum in the same loop.
    for (slope, other) in slopes.iter_mut().zip(others) {
        *slope = slope.max(other);
    }
}

/// The horizons of the points of a part of a grid.
#[derive(Debug)]
pub(crate) struct Horizons {
    /// Slopes, a plane for each azimuth, from +x towards +y; none is below the flattest one that was asked for.
    planes: Vec<Vec<f32>>,
    /// The steepest of each point's slopes.
    highest: Vec<f32>,
    /// Columns of a plane: those of the part, rounded up to entire blocks.
    stride: usize,
    /// The part of the grid.
    pub part: Rect,
    /// The slope under which nothing was looked for.
    pub flattest: f32,
}

impl Horizons {
    /// Finds the horizons of `part`, counted without the border of `surface`; pixels of that grid are `pixel_mm` apart.
    /// What rises less than `flattest` is not looked for.
    pub fn new(surface: &Grid<f32>, part: Rect, pixel_mm: [f64; 2], azimuths: usize, flattest: f32) -> Self {
        let (highest_mm, lowest_mm) = (surface.largest(|mm| mm), -surface.largest(|mm| -mm));
        let distances_mm = step_distances_mm(pixel_mm, f64::from((highest_mm - lowest_mm) / flattest));
        let furthest = distances_mm.last().copied().unwrap_or_default();
        // Beyond the surface there is nothing to be seen.
        let size = [surface.width, surface.height];
        let margin: [usize; 2] = std::array::from_fn(|k| ((furthest / pixel_mm[k]) as usize + 2).min(size[k] + 2));
        let [columns, rows] = [part.width(), part.height()].map(|size| size.div_ceil(BLOCK));
        let around = surface_around(surface, part, [columns * BLOCK, rows * BLOCK], margin);
        let highest_around = simd_dispatch(
            #[inline(always)]
            || highest_in_windows(&around),
        );
        let (stride, area) = (columns * BLOCK, columns * BLOCK * rows * BLOCK);
        let block = |number: usize| [number % columns * BLOCK, number / columns * BLOCK];
        let lowest_in_block = |number: usize| {
            let [x0, y0] = block(number);
            let rows = (y0..y0 + BLOCK).map(|y| read::<BLOCK>(around.row(y + margin[1]), x0 + margin[0]));
            rows.flatten().copied().fold(f32::MAX, f32::min)
        };
        let lowest: Vec<f32> = (0..columns * rows).map(lowest_in_block).collect();
        let mut planes = vec![vec![flattest; area]; azimuths];
        let mut highest = vec![flattest; area];
        simd_dispatch(
            #[inline(always)]
            || {
                for (azimuth, plane) in planes.iter_mut().enumerate() {
                    let direction = sin_cos_deg(360.0 * azimuth as f64 / azimuths as f64);
                    let on_surface = |step: &Step| (0..2).all(|k| step.whole_px[k].unsigned_abs() < margin[k]);
                    let steps = distances_mm.iter().map(|mm| Step::new(*mm, direction, pixel_mm, flattest));
                    let steps: Vec<Step> = steps.take_while(on_surface).collect();
                    for (number, lowest) in lowest.iter().enumerate() {
                        let [x0, y0] = block(number);
                        for step in &steps {
                            let rise_mm = step.rise_mm + lowest;
                            if highest_mm <= rise_mm {
                                break;
                            }
                            let [left, top] = [x0 + margin[0], y0 + margin[1]].map(|at| at as isize);
                            let [left, top] = [left + step.whole_px[0], top + step.whole_px[1]].map(|at| at as usize);
                            // One column and one row more than a block are read.
                            if highest_around.at(left, top) <= rise_mm {
                                continue;
                            }
                            let per_mm = step.per_mm;
                            for y in 0..BLOCK {
                                let here = read::<BLOCK>(around.row(y0 + y + margin[1]), x0 + margin[0]);
                                let slopes = &mut plane[(y0 + y) * stride + x0..];
                                // By loops: what a closure gives to `array::from_fn` is not always inlined.
                                let mut steeper = [0.0; BLOCK];
                                if let Some([u, v]) = step.between {
                                    let above = read::<WIDER>(around.row(top + y), left);
                                    let below = read::<WIDER>(around.row(top + y + 1), left);
                                    for x in 0..BLOCK {
                                        let upper = above[x] + (above[x + 1] - above[x]) * u;
                                        let lower = below[x] + (below[x + 1] - below[x]) * u;
                                        steeper[x] = (upper + (lower - upper) * v - here[x]) * per_mm;
                                    }
                                } else {
                                    let there = read::<BLOCK>(around.row(top + y), left);
                                    for x in 0..BLOCK {
                                        steeper[x] = (there[x] - here[x]) * per_mm;
                                    }
                                }
                                take_steeper(slopes, steeper);
                            }
                        }
                    }
                    for (highest, slope) in highest.iter_mut().zip(&*plane) {
                        *highest = highest.max(*slope);
                    }
                }
            },
        );
        Self { planes, highest, stride, part, flattest }
    }

    /// Returns the steepest slopes along a row of the part.
    #[inline(always)]
    pub fn highest_row(&self, y: usize) -> &[f32] {
        &self.highest[y * self.stride..][..self.part.width()]
    }

    /// Returns the number of azimuths.
    pub fn azimuths(&self) -> usize {
        self.planes.len()
    }

    /// Returns the slopes in an azimuth at the points of a row from column `first` on, which begins a block.
    #[inline(always)]
    pub fn block_row(&self, azimuth: usize, first: usize, y: usize) -> &[f32; BLOCK] {
        read(&self.planes[azimuth], y * self.stride + first)
    }

    /// Computes the mean of a function of the slope over all azimuths, at each point of the part, row-major.
    pub fn mean_over_azimuths(&self, of: impl Fn(f32) -> f32 + Copy) -> Vec<f32> {
        let mut mean = vec![0.0; self.part.area()];
        let share = 1.0 / self.planes.len() as f32;
        let width = self.part.width().max(1);
        simd_dispatch(
            #[inline(always)]
            || {
                for plane in &self.planes {
                    for (mean, slopes) in mean.chunks_exact_mut(width).zip(plane.chunks_exact(self.stride.max(1))) {
                        for (mean, slope) in mean.iter_mut().zip(slopes) {
                            *mean += of(*slope) * share;
                        }
                    }
                }
            },
        );
        mean
    }
}

/// Returns, for each pixel of a surface, the highest point of the window of one more than a block that begins there.
#[inline(always)]
fn highest_in_windows(surface: &Grid<f32>) -> Grid<f32> {
    let (mut highest, width) = (surface.clone(), surface.width);
    let mut before = Vec::with_capacity(width);
    // Windows of 2, 4, 8, 16 and 17 pixels along a row, then along a column.
    for shift in [1, 2, 4, 8, WIDER - BLOCK] {
        for y in 0..highest.height {
            let row = highest.row_mut(y);
            before.clear();
            before.extend_from_slice(row);
            row.iter_mut().zip(before.iter().skip(shift)).for_each(|(height, other)| *height = height.max(*other));
        }
    }
    for shift in [1, 2, 4, 8, WIDER - BLOCK] {
        for y in 0..highest.height.saturating_sub(shift) {
            let (rows, below) = highest.data.split_at_mut((y + shift) * width);
            let row = &mut rows[y * width..][..width];
            row.iter_mut().zip(below).for_each(|(height, other)| *height = height.max(*other));
        }
    }
    highest
}

/// Returns the distances at which the surface is looked at.
fn step_distances_mm(pixel_mm: [f64; 2], reach_mm: f64) -> Vec<f64> {
    let pixel_mm = 0.5 * (pixel_mm[0] + pixel_mm[1]);
    let next = |at: &f64| Some(at + pixel_mm.max(STEP_SHARE * at));
    std::iter::successors(Some(pixel_mm), next).take_while(|at| *at <= reach_mm.max(pixel_mm)).collect()
}

/// Returns the surface from the first pixel of a part on, `size` pixels of it and so many around them.
fn surface_around(surface: &Grid<f32>, part: Rect, size: [usize; 2], margin: [usize; 2]) -> Grid<f32> {
    // One pixel more, between which and its neighbour a weight of 0 may point.
    let mut around = Grid::new(size[0] + 2 * margin[0] + 1, size[1] + 2 * margin[1] + 1);
    let on_surface = |at: usize, start: usize, margin: usize, count: usize| {
        (at + start + SURFACE_BORDER).saturating_sub(margin).min(count - 1)
    };
    for y in 0..around.height {
        let from = surface.row(on_surface(y, part.y0, margin[1], surface.height));
        for (x, height) in around.row_mut(y).iter_mut().enumerate() {
            *height = from[on_surface(x, part.x0, margin[0], surface.width)];
        }
    }
    around
}

/// Returns the angle from +x towards +y in turns, 0 to 1, to 2e-5 turns; 0 for no direction.
#[inline(always)]
pub(crate) fn turns_from_x(x: f32, y: f32) -> f32 {
    let (across, down) = (x.abs(), y.abs());
    let (small, large) = if across < down { (across, down) } else { (down, across) };
    let t = small / if large > 0.0 { large } else { 1.0 };
    let square = t * t;
    // A polynomial for the arc tangent from 0 to 1, after Hastings (1955), over a whole turn.
    let eighth = t
        * (0.159_130_4
            + square * (-0.052_566_5 + square * (0.028_669_6 + square * (-0.013_550_4 + square * 0.003_316_9))));
    let quarter = if across < down { 0.25 - eighth } else { eighth };
    let half = if x < 0.0 { 0.5 - quarter } else { quarter };
    if y < 0.0 { 1.0 - half } else { half }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn angles_are_those_of_the_arc_tangent() {
        for k in 0..7200 {
            let angle = f64::from(k) / 7200.0 * std::f64::consts::TAU;
            let turns = f64::from(turns_from_x(angle.cos() as f32 * 3.0, angle.sin() as f32 * 3.0));
            assert!((turns - f64::from(k) / 7200.0).abs() < 3e-5, "{k}: {turns}");
        }
        assert_eq!(turns_from_x(0.0, 0.0), 0.0);
    }

    /// The slope of the horizon at a point of the part in a direction of the pad.
    fn slope_towards(horizons: &Horizons, [column, row]: [usize; 2], [x, y]: [f32; 2]) -> f32 {
        let count = horizons.azimuths();
        let turn = turns_from_x(x, y) * count as f32;
        let at = |azimuth: usize| horizons.block_row(azimuth % count, column - column % BLOCK, row)[column % BLOCK];
        let (before, after) = (at(turn as usize), at(turn as usize + 1));
        before + (after - before) * turn.fract()
    }

    /// A wall along y, `height` high, from `from` mm on.
    fn wall(size: usize, pixel_mm: f64, from_mm: f64, height: f32) -> Grid<f32> {
        let at = |k: usize| (k % size) as f64 * pixel_mm;
        Grid {
            width: size,
            height: size,
            data: (0..size * size).map(|k| if at(k) >= from_mm { height } else { 0.0 }).collect(),
        }
    }

    #[test]
    fn the_horizon_before_a_wall_is_that_of_its_edge() {
        let (size, pixel_mm) = (64, 0.1);
        let surface = wall(size, pixel_mm, 4.0, 0.8);
        let part = Rect { x0: 0, y0: 0, x1: size - 2, y1: size - 2 };
        let horizons = Horizons::new(&surface, part, [pixel_mm; 2], 16, 0.1);
        for x in 5..35 {
            let before = 4.0 - (x + SURFACE_BORDER) as f64 * pixel_mm;
            let at = [x, 30];
            for degrees in [0.0_f64, 11.25, 30.0, 45.0] {
                let direction = [degrees.to_radians().cos(), degrees.to_radians().sin()];
                let exact = 0.8 * direction[0] / before;
                let found = f64::from(slope_towards(&horizons, at, direction.map(|v| v as f32)));
                // Steps are a pixel or 12 % of the distance; azimuths between those computed are interpolated.
                let allowed = exact * (0.09 + 1.2 * pixel_mm / before);
                assert!((found - exact).abs() < allowed, "{before} mm, {degrees}: {found}, not {exact}");
            }
            assert_eq!(slope_towards(&horizons, at, [-1.0, 0.0]), 0.1, "nothing stands behind it");
            let (steepest, across) = (horizons.highest_row(30)[x], slope_towards(&horizons, at, [1.0, 0.0]));
            assert!((across..1.03 * across).contains(&steepest), "{steepest}, {across}");
        }
    }

    #[test]
    fn a_part_has_the_horizons_of_the_whole_and_what_is_flatter_is_not_seen() {
        let surface = wall(40, 0.1, 2.0, 0.5);
        let whole = Rect { x0: 0, y0: 0, x1: 38, y1: 38 };
        let part = Rect { x0: 7, y0: 11, x1: 24, y1: 20 };
        let [all, some] = [whole, part].map(|part| Horizons::new(&surface, part, [0.1, 0.1], 8, 0.4));
        for y in 0..part.height() {
            for x in 0..part.width() {
                for direction in [[1.0, 0.0], [0.7, 0.7], [0.0, -1.0]] {
                    let of_all = slope_towards(&all, [x + part.x0, y + part.y0], direction);
                    assert_eq!(of_all, slope_towards(&some, [x, y], direction));
                }
            }
        }
        assert_eq!(all.highest_row(20)[5], 0.4, "the wall is 1.4 mm away");
        assert!(all.highest_row(20)[9] > 0.45, "the wall is 1 mm away");
        let tiny = Horizons::new(&Grid::new(3, 3), Rect { x0: 0, y0: 0, x1: 1, y1: 1 }, [5.0, 0.01], 16, 0.2);
        assert_eq!(tiny.highest_row(0), [0.2]);
    }
}
