//! One sweep over the rows of a surface, away from an LED.

use std::ops::Range;

use super::max_f32;
use super::soften::{self, SmoothingRow};
use crate::base::view::SURFACE_BORDER;

/// Height of what stands before the LED where nothing does, mm.
const OPEN_MM: f32 = -1e30;
/// Six times the variance of a disc's shadow edge, in squares of the half width of its penumbra.
const SPREAD: f64 = 1.5;
/// Smallest such spread of any shadow: without it, a wall of pixels in steps casts dots.
const MIN_SPREAD: f32 = 3.0;
/// How far from a shadow's edge it is softened, in half widths of its penumbra: smoothing kernels have tails.
pub const TAIL: f64 = 1.25;

/// The rays of an LED over rows: steps lead from one row to the next, away from the LED.
#[derive(Clone, Copy, Debug)]
pub struct Rays {
    /// True if the LED is on the side of the last row.
    pub from_end: bool,
    /// Pixels by which a line shifts sideways in a step, -1 to 1.
    pub shear: f64,
    /// Rise of the lowest and the highest ray in a step, mm.
    pub rise_mm: [f32; 2],
    /// Pixels by which the outermost rays part from the middle one in a step.
    pub widening: f64,
}

impl Rays {
    /// Returns the pixels by which what blocks the LED is felt further aside in a step.
    pub fn fan_width(&self) -> f64 {
        TAIL * self.widening
    }
}

/// Scratch memory of a sweep, used again by the next one.
#[derive(Clone, Debug, Default)]
pub struct SweepScratch {
    low: Obstacles,
    high: Obstacles,
    fan: Obstacles,
    before: Obstacles,
    row: SmoothingRow,
}

/// What blocks one ray, for every line.
#[derive(Clone, Debug, Default)]
struct Obstacles {
    /// Its height over a plane that rises with the ray, mm.
    over_mm: Vec<f32>,
    /// The step at which it stands.
    step: Vec<f32>,
}

impl Obstacles {
    fn clear(&mut self, count: usize) {
        for (values, open) in [(&mut self.over_mm, OPEN_MM), (&mut self.step, 0.0)] {
            values.clear();
            values.resize(count, open);
        }
    }

    #[inline(always)]
    fn slice(&self, first: usize, count: usize) -> (&[f32], &[f32]) {
        (&self.over_mm[first..][..count], &self.step[first..][..count])
    }

    #[inline(always)]
    fn slice_mut(&mut self, first: usize, count: usize) -> (&mut [f32], &mut [f32]) {
        (&mut self.over_mm[first..][..count], &mut self.step[first..][..count])
    }

    /// Lets every line take over from its neighbours what is higher.
    #[inline(always)]
    fn take_higher_neighbours(&mut self, before: &mut Self) {
        let count = self.step.len();
        let Some(inner) = count.checked_sub(2).filter(|inner| *inner > 0) else { return };
        std::mem::swap(self, before);
        for values in [&mut self.over_mm, &mut self.step] {
            values.resize(count, 0.0);
        }
        for end in [0, count - 1] {
            (self.over_mm[end], self.step[end]) = (before.over_mm[end], before.step[end]);
        }
        let [(left, left_step), (own, own_step), (right, right_step)] =
            [0, 1, 2].map(|first| before.slice(first, inner));
        let (over, step) = self.slice_mut(1, inner);
        for x in 0..inner {
            let higher = left[x] > own[x];
            let (highest, stands) = if higher { (left[x], left_step[x]) } else { (own[x], own_step[x]) };
            let higher = right[x] > highest;
            over[x] = if higher { right[x] } else { highest };
            step[x] = if higher { right_step[x] } else { stands };
        }
    }
}

/// The lines of one sweep: of all lines that run towards the LED, one pixel apart, those that matter to the region.
struct SweepLines<'a> {
    rays: Rays,
    /// Columns and rows of the surface.
    size: [usize; 2],
    /// Columns whose hard shadows are computed: the region's, and those that soften them.
    across: Range<usize>,
    /// First of the region's columns among them, and how many there are.
    shown: [usize; 2],
    /// Number of the first line that is kept.
    first: isize,
    scratch: &'a mut SweepScratch,
}

/// Computes the share of the LED that the pixels in `columns` and `rows` see, and writes it to `shares`, row-major.
/// Columns and rows are counted on the surface, which is given by its heights, mm, and its size, and leave out its
/// border.
#[inline(always)]
pub fn sweep_shadows(
    rays: Rays,
    surface: (&[f32], [usize; 2]),
    columns: Range<usize>,
    rows: Range<usize>,
    scratch: &mut SweepScratch,
    shares: &mut [f32],
) {
    let (heights, size) = surface;
    let steps = if rays.from_end { size[1] - rows.start } else { rows.end };
    let mut lines = SweepLines::new(rays, size, columns, &rows, steps, scratch);
    let width = lines.shown[1];
    for step in 0..steps {
        let y = if rays.from_end { size[1] - 1 - step } else { step };
        let heights = &heights[y * size[0]..][..size[0]];
        let shown = rows.contains(&y);
        if shown {
            let shaded = match rays.shear == 0.0 {
                true => lines.shade_step::<true>(step, heights),
                false => lines.shade_step::<false>(step, heights),
            };
            let SweepLines { shown: [first, _], scratch, .. } = &mut lines;
            let shares = &mut shares[(y - rows.start) * width..][..width];
            // Shares of 1 everywhere stay so when they are softened.
            if shaded { scratch.row.soften(*first, shares) } else { shares.fill(1.0) }
        }
        if rays.shear == 0.0 {
            lines.add_obstacles::<true>(step, heights)
        } else {
            lines.add_obstacles::<false>(step, heights)
        }
        lines.widen_fan(step);
    }
}

impl<'a> SweepLines<'a> {
    fn new(
        rays: Rays,
        size: [usize; 2],
        columns: Range<usize>,
        rows: &Range<usize>,
        steps: usize,
        scratch: &'a mut SweepScratch,
    ) -> Self {
        let furthest = steps as f64;
        let reach = soften::smoothing_reach_px(soften::smoothing_levels(max_f32(
            (SPREAD * (rays.widening * furthest).powi(2)) as f32,
            MIN_SPREAD,
        )));
        let across = columns.start.saturating_sub(reach).max(SURFACE_BORDER)
            ..columns.end.saturating_add(reach).min(size[0] - SURFACE_BORDER);
        let shown = [columns.start - across.start, columns.len()];
        let mut lines = Self { rays, size, across, shown, first: 0, scratch };
        let aside = (rays.fan_width() * furthest) as usize + 1;
        let ends = [steps - rows.len(), steps - 1].map(|step| lines.line_shift(step).0);
        lines.first = lines.across.start as isize - 1 - ends[0].max(ends[1]) - aside as isize;
        let count = lines.across.len() + 1 + ends[0].abs_diff(ends[1]) + 2 * aside;
        let SweepScratch { low, high, fan, row, .. } = lines.scratch;
        for obstacles in [low, high, fan] {
            obstacles.clear(count);
        }
        row.resize(lines.across.len());
        lines
    }

    /// Returns where lines cross a step's row: line number n does so between columns n + whole and n + whole + 1, by
    /// `part` of the way.
    #[inline(always)]
    fn line_shift(&self, step: usize) -> (isize, f32) {
        let shift = self.rays.shear * step as f64;
        let whole = libm::floor(shift);
        (whole as isize, (shift - whole) as f32)
    }

    /// Computes hard shares of the LED that the pixels of this step's row see, and how soft they are to be. Returns
    /// false if all pixels see all of it.
    #[inline(always)]
    fn shade_step<const STRAIGHT: bool>(&mut self, step: usize, heights: &[f32]) -> bool {
        let (whole, part) = self.line_shift(step);
        let width = self.across.len();
        let around = &heights[self.across.start - 1..][..width + 2];
        let (left, heights, right) = (&around[..width], &around[1..][..width], &around[2..][..width]);
        let first = (self.across.start as isize - 1 - whole - self.first) as usize;
        let now = SweepStep::new(&self.rays, step);
        let SweepScratch { low, high, fan, row, .. } = &mut *self.scratch;
        let (low, low_step) = (&low.over_mm[first..][..width + 1], &low.step[first..][..width + 1]);
        let (high, high_step) = (&high.over_mm[first..][..width + 1], &high.step[first..][..width + 1]);
        let (fan, fan_step) = (&fan.over_mm[first..][..width + 1], &fan.step[first..][..width + 1]);
        let mixed = part * (1.0 - part);
        // Two loops: one with both results is too much for the compiler to vectorise.
        let shares = &mut row.shares[..width];
        let mut blocked = 0;
        for x in 0..width {
            let here = if STRAIGHT { heights[x] } else { lift_notch(left[x], heights[x], right[x], mixed) };
            let over_low = interpolate_lines::<STRAIGHT>(low, x, part) - (here + now.planes_mm[0]);
            blocked |= u32::from(over_low > 0.0);
        }
        if blocked == 0 {
            return false;
        }
        for x in 0..width {
            let here = if STRAIGHT { heights[x] } else { lift_notch(left[x], heights[x], right[x], mixed) };
            let over_low = interpolate_lines::<STRAIGHT>(low, x, part) - (here + now.planes_mm[0]);
            let over_high = interpolate_lines::<STRAIGHT>(high, x, part) - (here + now.planes_mm[1]);
            let steps =
                [interpolate_lines::<STRAIGHT>(low_step, x, part), interpolate_lines::<STRAIGHT>(high_step, x, part)];
            shares[x] = now.visible_share(over_low, over_high, steps);
        }
        let spread = &mut row.spread[..width];
        for x in 0..width {
            let here = if STRAIGHT { heights[x] } else { lift_notch(left[x], heights[x], right[x], mixed) };
            let over = interpolate_lines::<STRAIGHT>(fan, x, part) - (here + now.planes_mm[0]);
            let steps = now.step - interpolate_lines::<STRAIGHT>(fan_step, x, part);
            spread[x] = if over > 0.0 { max_f32(now.spread * steps * steps, MIN_SPREAD) } else { 0.0 };
        }
        // Where lines come in from the side, the outermost ones have met no obstacle yet: the pixel beside stands for
        // them.
        if width > 1 && self.rays.shear > 0.0 && self.across.start == SURFACE_BORDER {
            (shares[0], spread[0]) = (shares[1], spread[1]);
        } else if width > 1 && self.rays.shear < 0.0 && self.across.end + SURFACE_BORDER == self.size[0] {
            (shares[width - 1], spread[width - 1]) = (shares[width - 2], spread[width - 2]);
        }
        true
    }

    /// Adds this step's row to the obstacles.
    #[inline(always)]
    fn add_obstacles<const STRAIGHT: bool>(&mut self, step: usize, heights: &[f32]) {
        let (whole, part) = self.line_shift(step);
        let kept = self.scratch.low.step.len() as isize;
        let first = self.first.max(-whole);
        let end = (self.first + kept).min(self.size[0] as isize - 1 - whole);
        if first >= end {
            return;
        }
        let count = (end - first) as usize;
        let heights = &heights[(first + whole) as usize..][..count + 1];
        let first = (first - self.first) as usize;
        let now = SweepStep::new(&self.rays, step);
        let SweepScratch { low, high, fan, .. } = &mut *self.scratch;
        let [low_mm, high_mm] = now.planes_mm;
        for (obstacles, plane_mm) in [(low, low_mm), (high, high_mm), (fan, low_mm)] {
            let (over, stands) = obstacles.slice_mut(first, count);
            for x in 0..count {
                let height = if STRAIGHT { heights[x] } else { heights[x] * (1.0 - part) + heights[x + 1] * part };
                let (height, highest, stood) = (height + plane_mm, over[x], stands[x]);
                over[x] = max_f32(height, highest);
                stands[x] = if height > highest { now.step } else { stood };
            }
        }
    }

    /// Lets the obstacles of the fan reach aside as far as its rays do in a step.
    #[inline(always)]
    fn widen_fan(&mut self, step: usize) {
        let [before, after] = [step, step + 1].map(|step| (self.rays.fan_width() * step as f64) as usize);
        for _ in before..after {
            self.scratch.fan.take_higher_neighbours(&mut self.scratch.before);
        }
    }
}

/// Interpolates at column x between the line before it and the line after it; the one before has the weight `part`.
/// Where all lines are straight, the line after goes through the column.
#[inline(always)]
fn interpolate_lines<const STRAIGHT: bool>(of: &[f32], x: usize, part: f32) -> f32 {
    if STRAIGHT { of[x + 1] } else { of[x] * part + of[x + 1] * (1.0 - part) }
}

/// Returns a pixel's height in a notch after interpolation onto a line and back: a wall beside the notch must not shade
/// it.
#[inline(always)]
fn lift_notch(left: f32, here: f32, right: f32, mixed: f32) -> f32 {
    here + mixed * max_f32((left - here) + (right - here), 0.0)
}

/// One step of a sweep.
#[derive(Clone, Copy)]
struct SweepStep {
    step: f32,
    /// Heights, mm, by which the lowest and the highest ray have risen since the first step.
    planes_mm: [f32; 2],
    /// Difference of the two in a step, mm.
    range_mm: f32,
    /// Spread of a shadow one step behind its obstacle.
    spread: f32,
}

impl SweepStep {
    #[inline(always)]
    fn new(rays: &Rays, step: usize) -> Self {
        Self {
            step: step as f32,
            planes_mm: rays.rise_mm.map(|rise| rise * step as f32),
            range_mm: rays.rise_mm[1] - rays.rise_mm[0],
            spread: (SPREAD * rays.widening * rays.widening) as f32,
        }
    }

    /// Returns the share of the LED that is seen straight ahead. The obstacles of its lowest and its highest ray stand
    /// `over_low` and `over_high` over these rays, mm, at the steps `low` and `high`.
    #[inline(always)]
    fn visible_share(&self, over_low: f32, over_high: f32, [low, high]: [f32; 2]) -> f32 {
        let (low_steps, high_steps) = (self.step - low, self.step - high);
        // Both shares are fractions with positive denominators, which compare by products: one division is enough.
        let (above_low, above_high) = (self.range_mm * low_steps - over_low, -over_high);
        let by_high = above_high * low_steps < above_low * high_steps;
        let above = if by_high { above_high } else { above_low };
        let share = max_f32(above / (self.range_mm * if by_high { high_steps } else { low_steps }), 0.0);
        if over_low > 0.0 && share < 1.0 { share } else { 1.0 }
    }
}
