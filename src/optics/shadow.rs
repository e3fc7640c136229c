//! Shadows that low LEDs cast on the pad's surface: which share of an LED each pixel sees.
//!
//! With w the displacement and d the distance towards the LED, the horizon's slope is the largest (w(d) - w(0)) / d. The
//! LED spans a range of elevations; the share of it that is seen falls linearly from 1 to 0 as the horizon climbs from
//! its lowest ray to its highest. A sweep away from the LED carries, on lines one pixel apart, the ceilings below which
//! these two rays are blocked, and how far off what blocks them stands (horizon sweeps: Max 1988; Timonen and Westerholm
//! 2010). The horizon is the steeper of those two obstacles: exact at both ends of a penumbra and behind a single
//! obstacle; where penumbras overlap the share can be too large, and jump. Heights between pixels are linear.

use crate::gelpad::SURFACE_BORDER;
use crate::grid::{Grid, Rect};
use crate::scene::pose::sin_cos_deg;
use crate::simd::wide;

/// The lowest ray: an LED's part below it is taken to stand at it, so that no shadow is endless.
const LOWEST_DEG: f64 = 0.5;
/// The highest ray: a steeper one casts no shadow that is seen.
const HIGHEST_DEG: f64 = 89.9;
/// The smallest LED: without any penumbra, shares would jump.
const SMALLEST_DEG: f64 = 0.1;
/// The ceiling, mm, where nothing stands before the LED.
const OPEN_MM: f32 = -1e30;
/// Columns that are transposed at a time for a sweep along rows.
const STRIP: usize = 16;

/// Whether an LED is nearer along rows or along columns, counted in pixels.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Sweep {
    /// From one row to the next.
    OverRows,
    /// From one column to the next.
    OverColumns,
}

/// Casts one LED's shadows. Steps lead from one row (or column) to the next, away from the LED.
#[derive(Clone, Debug)]
pub struct Caster {
    sweep: Sweep,
    /// True if the LED is on the side of the last row or column.
    from_end: bool,
    /// Pixels by which a line shifts sideways in a step, -1 to 1.
    shear: f64,
    /// Rise of the lowest and the highest ray in a step, mm.
    rise_mm: [f32; 2],
    mm_per_px: [f64; 2],
}

/// Memory of a sweep, to be used again.
#[derive(Clone, Debug, Default)]
pub struct Scratch {
    /// What blocks the lowest and the highest ray.
    obstacles: [Obstacles; 2],
    /// A strip of the surface and of the shares, transposed.
    strip: [Vec<f32>; 2],
}

/// What blocks one ray, for every line.
#[derive(Clone, Debug, Default)]
struct Obstacles {
    /// Height below which the ray is blocked, mm.
    ceiling_mm: Vec<f32>,
    /// How far off the obstacle stands, steps.
    steps: Vec<f32>,
}

/// The largest rises of a surface from a pixel to its neighbours, mm per mm; 0 where all neighbours are lower.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Steepest {
    /// Towards +x.
    pub right: f32,
    /// Towards -x.
    pub left: f32,
    /// Towards +y.
    pub down: f32,
    /// Towards -y.
    pub up: f32,
    /// Largest absolute displacement, mm: how exact the rises can be.
    pub largest_mm: f32,
}

impl Steepest {
    /// Of `surface`, whose pixels are `mm_per_px` apart along x and y. All 0 for an image without neighbours.
    pub fn of(surface: &Grid<f32>, mm_per_px: [f64; 2]) -> Self {
        let level = vec![0.0; surface.width];
        let [mut heights, mut along_x, mut along_y] = [Extremes::default(); 3];
        wide(
            #[inline(always)]
            || {
                for y in 0..surface.height {
                    let row = surface.row(y);
                    heights.add(row, &level);
                    along_x.add(row.get(1..).unwrap_or_default(), row);
                    along_y.add(surface.row((y + 1).min(surface.height - 1)), row);
                }
            },
        );
        let [[highest, lowest], [right, left], [down, up]] = [heights, along_x, along_y].map(Extremes::ends);
        let [per_mm_x, per_mm_y] = mm_per_px.map(|pitch| (1.0 / pitch) as f32);
        Self {
            right: right * per_mm_x,
            left: left * per_mm_x,
            down: down * per_mm_y,
            up: up * per_mm_y,
            largest_mm: highest.max(lowest),
        }
    }
}

/// The largest differences of both signs, kept apart for every sixteenth so that they are found side by side.
#[derive(Clone, Copy, Default)]
struct Extremes {
    most: [f32; 16],
    least: [f32; 16],
}

impl Extremes {
    /// Counts `to - from`, value by value, as far as both go.
    #[inline(always)]
    fn add(&mut self, to: &[f32], from: &[f32]) {
        let shared = to.len().min(from.len());
        let (to, to_rest) = to[..shared].as_chunks::<16>();
        let (from, from_rest) = from[..shared].as_chunks::<16>();
        for (to, from) in to.iter().zip(from) {
            for lane in 0..16 {
                self.count(lane, to[lane] - from[lane]);
            }
        }
        for (lane, (to, from)) in to_rest.iter().zip(from_rest).enumerate() {
            self.count(lane, to - from);
        }
    }

    #[inline(always)]
    fn count(&mut self, lane: usize, rise: f32) {
        self.most[lane] = larger(rise, self.most[lane]);
        self.least[lane] = larger(-rise, self.least[lane]);
    }

    /// The largest difference upwards and downwards, 0 or more.
    fn ends(self) -> [f32; 2] {
        [self.most, self.least].map(|lanes| lanes.into_iter().fold(0.0, larger))
    }
}

/// The larger one; the second if one is NaN. One instruction, unlike `f32::max`.
#[inline(always)]
fn larger(a: f32, b: f32) -> f32 {
    if a > b { a } else { b }
}

impl Caster {
    /// An LED towards `azimuth_deg` (from +x towards +y), `elevation_deg` over the pad, seen from it under an angle of
    /// `angular_size_deg`. What of it lies below 0.5 or above 89.9 degrees is moved there; an LED smaller than 0.1
    /// degrees is taken to be that large.
    pub fn new(azimuth_deg: f64, elevation_deg: f64, angular_size_deg: f64, mm_per_px: [f64; 2]) -> Self {
        let (sin, cos) = sin_cos_deg(azimuth_deg);
        let half_deg = 0.5 * angular_size_deg.max(SMALLEST_DEG);
        let lowest_deg = (elevation_deg - half_deg).clamp(LOWEST_DEG, HIGHEST_DEG - SMALLEST_DEG);
        let highest_deg = (elevation_deg + half_deg).max(lowest_deg + SMALLEST_DEG).min(HIGHEST_DEG);
        let slopes = [lowest_deg, highest_deg].map(|elevation| libm::tan(elevation.to_radians()));

        // Pixels towards the LED for every mm of the way.
        let [right, down] = [cos / mm_per_px[0], sin / mm_per_px[1]];
        let (sweep, ahead, sideways) =
            if down.abs() >= right.abs() { (Sweep::OverRows, down, right) } else { (Sweep::OverColumns, right, down) };
        Self {
            sweep,
            from_end: ahead > 0.0,
            shear: -sideways / ahead.abs(),
            rise_mm: slopes.map(|slope| (slope / ahead.abs()) as f32),
            mm_per_px,
        }
    }

    /// False only where [`Caster::visible`] is 1 everywhere: no slope towards the LED is as steep as its lowest ray.
    pub fn casts(&self, steepest: &Steepest) -> bool {
        let Steepest { right, left, down, up, largest_mm } = *steepest;
        let (x, y) = ([left, right], [up, down]);
        let (ahead, sideways, pitch) = match self.sweep {
            Sweep::OverRows => (y, x, self.mm_per_px),
            Sweep::OverColumns => (x, y, [self.mm_per_px[1], self.mm_per_px[0]]),
        };
        let [backward, forward] = sideways.map(|rise| f64::from(rise) * pitch[0]);
        let towards_led = f64::from(ahead[usize::from(self.from_end)]) * pitch[1];
        // Lines shift away from the LED, so towards it they lead the other way.
        let aside = self.shear.abs() * if self.shear < 0.0 { forward } else { backward };
        let lowest = f64::from(self.rise_mm[0]);
        let rounding = 1e-6 * (f64::from(largest_mm) + lowest);
        towards_led + aside + rounding > lowest
    }

    /// How far, along x and y, from what casts it a shadow can fall, px, on a surface whose highest point is `highest_mm`
    /// over its lowest. Interpolation can carry a trace of it one pixel further.
    pub fn shadow_px(&self, highest_mm: f32) -> [f64; 2] {
        let steps = f64::from(highest_mm.max(0.0)) / f64::from(self.rise_mm[0]);
        let (ahead, sideways) = (if self.from_end { -steps } else { steps }, self.shear * steps);
        match self.sweep {
            Sweep::OverRows => [sideways, ahead],
            Sweep::OverColumns => [ahead, sideways],
        }
    }

    /// The share of the LED, 0 to 1, that each pixel of `region` sees, row-major. `region` is a rectangle of the view;
    /// `surface` holds displacements in mm of the view and [`SURFACE_BORDER`] around it. All of it casts shadows, and
    /// nothing beyond it does, whatever stands at its border.
    pub fn visible(&self, surface: &Grid<f32>, region: Rect, visible: &mut Vec<f32>, scratch: &mut Scratch) {
        visible.resize(region.area(), 1.0);
        if region.is_empty() {
            return;
        }
        let Rect { x0, y0, x1, y1 } = region;
        let columns = [x0 + SURFACE_BORDER, x1 + SURFACE_BORDER];
        let rows = [y0 + SURFACE_BORDER, y1 + SURFACE_BORDER];
        let Scratch { obstacles, strip } = scratch;
        wide(
            #[inline(always)]
            || match self.sweep {
                Sweep::OverRows => {
                    let mut lines = Lines::new(self, [surface.width, surface.height], columns, rows, obstacles);
                    sweep_rows(&mut lines, surface, visible);
                }
                Sweep::OverColumns => {
                    let mut lines = Lines::new(self, [surface.height, surface.width], rows, columns, obstacles);
                    sweep_columns(&mut lines, surface, visible, strip);
                }
            },
        );
    }
}

#[inline(always)]
fn sweep_rows(lines: &mut Lines, surface: &Grid<f32>, visible: &mut [f32]) {
    let width = lines.width();
    for step in 0..lines.steps {
        let y = lines.place(step);
        let heights = surface.row(y);
        if let Some(row) = lines.shown(y) {
            lines.shade(step, heights, &mut visible[row * width..][..width]);
        }
        lines.advance(step, heights);
    }
}

/// The same on a transposed image, a strip at a time.
#[inline(always)]
fn sweep_columns(lines: &mut Lines, surface: &Grid<f32>, visible: &mut [f32], strip: &mut [Vec<f32>; 2]) {
    let (height, shown_width, shown_height) = (surface.height, lines.ahead[1] - lines.ahead[0], lines.width());
    let [heights, shares] = strip;
    heights.resize(STRIP * height, 0.0);
    shares.resize(STRIP * shown_height, 0.0);
    let mut step = 0;
    while step < lines.steps {
        let count = STRIP.min(lines.steps - step);
        let (a, b) = (lines.place(step), lines.place(step + count - 1));
        let first = a.min(b);
        transpose(&surface.data[first..], surface.width, heights, height, [count, height]);
        let mut filled: Option<[usize; 2]> = None;
        for step in step..step + count {
            let x = lines.place(step);
            let column = &heights[(x - first) * height..][..height];
            if let Some(shown) = lines.shown(x) {
                lines.shade(step, column, &mut shares[(x - first) * shown_height..][..shown_height]);
                let [from, to] = filled.unwrap_or([shown, shown + 1]);
                filled = Some([from.min(shown), to.max(shown + 1)]);
            }
            lines.advance(step, column);
        }
        if let Some([from, to]) = filled {
            let skipped = from + lines.ahead[0] - first;
            let shares = &shares[skipped * shown_height..];
            transpose(shares, shown_height, &mut visible[from..], shown_width, [shown_height, to - from]);
        }
        step += count;
    }
}

/// Copies `size[0]` columns and `size[1]` rows of `from` to as many rows and columns of `to`; a row begins every
/// `from_pitch` and `to_pitch` values.
#[inline(always)]
fn transpose(from: &[f32], from_pitch: usize, to: &mut [f32], to_pitch: usize, size: [usize; 2]) {
    // Whole blocks fit into registers and the L1 cache.
    let whole = size.map(|length| length - length % STRIP);
    for y in (0..whole[1]).step_by(STRIP) {
        for x in (0..whole[0]).step_by(STRIP) {
            let mut block = [[0.0; STRIP]; STRIP];
            for (k, row) in block.iter_mut().enumerate() {
                row.copy_from_slice(&from[(y + k) * from_pitch + x..][..STRIP]);
            }
            for k in 0..STRIP {
                let column: [f32; STRIP] = std::array::from_fn(
                    #[inline(always)]
                    |y| block[y][k],
                );
                to[(x + k) * to_pitch + y..][..STRIP].copy_from_slice(&column);
            }
        }
    }
    for y in 0..size[1] {
        let first = if y < whole[1] { whole[0] } else { 0 };
        for x in first..size[0] {
            to[x * to_pitch + y] = from[y * from_pitch + x];
        }
    }
}

/// The lines of one sweep: of all that run towards the LED, one pixel apart, those through the region. Described for a
/// sweep over rows.
struct Lines<'a> {
    shear: f64,
    rise_mm: [f32; 2],
    from_end: bool,
    /// Columns and rows of the surface.
    size: [usize; 2],
    /// First column of the region and one past its last.
    across: [usize; 2],
    /// First row of the region and one past its last.
    ahead: [usize; 2],
    /// Rows from the LED's side to the far end of the region.
    steps: usize,
    /// Number of the first line that is kept.
    first: isize,
    /// For every line, as seen from the row that comes next.
    obstacles: &'a mut [Obstacles; 2],
}

impl<'a> Lines<'a> {
    fn new(
        caster: &Caster,
        size: [usize; 2],
        across: [usize; 2],
        ahead: [usize; 2],
        obstacles: &'a mut [Obstacles; 2],
    ) -> Self {
        let steps = if caster.from_end { size[1] - ahead[0] } else { ahead[1] };
        let Caster { shear, rise_mm, from_end, .. } = *caster;
        let mut lines = Self { shear, rise_mm, from_end, size, across, ahead, steps, first: 0, obstacles };
        let ends = [steps + ahead[0] - ahead[1], steps - 1].map(|step| lines.shift(step).0);
        lines.first = across[0] as isize - 1 - ends[0].max(ends[1]);
        let count = across[1] - across[0] + 1 + ends[0].abs_diff(ends[1]);
        for Obstacles { ceiling_mm, steps } in lines.obstacles.iter_mut() {
            for (values, open) in [(ceiling_mm, OPEN_MM), (steps, 1.0)] {
                values.clear();
                values.resize(count, open);
            }
        }
        lines
    }

    /// Columns of the region.
    #[inline(always)]
    fn width(&self) -> usize {
        self.across[1] - self.across[0]
    }

    /// The row of a step.
    #[inline(always)]
    fn place(&self, step: usize) -> usize {
        if self.from_end { self.size[1] - 1 - step } else { step }
    }

    /// Which of the region's rows it is, if it is one.
    #[inline(always)]
    fn shown(&self, row: usize) -> Option<usize> {
        (self.ahead[0]..self.ahead[1]).contains(&row).then(|| row - self.ahead[0])
    }

    /// Line number n crosses a step's row between columns n + whole and n + whole + 1, by `part` of the way.
    #[inline(always)]
    fn shift(&self, step: usize) -> (isize, f32) {
        let shift = self.shear * step as f64;
        let whole = libm::floor(shift);
        (whole as isize, (shift - whole) as f32)
    }

    /// Shares of the LED that the region's pixels of this step's row see.
    #[inline(always)]
    fn shade(&self, step: usize, heights: &[f32], shares: &mut [f32]) {
        let (whole, part) = self.shift(step);
        let width = shares.len();
        let [left, heights, right] = [0, 1, 2].map(|by| &heights[self.across[0] + by - 1..][..width]);
        let first = (self.across[0] as isize - 1 - whole - self.first) as usize;
        let [low, high] = self
            .obstacles
            .each_ref()
            .map(|Obstacles { ceiling_mm, steps }| (&ceiling_mm[first..][..width + 1], &steps[first..][..width + 1]));
        let range = self.rise_mm[1] - self.rise_mm[0];
        // Heights on a line and back are lifted in a notch: a wall beside a pixel must not shade it.
        let mixed = part * (1.0 - part);
        for x in 0..width {
            let here = heights[x] + mixed * larger((left[x] - heights[x]) + (right[x] - heights[x]), 0.0);
            let between = |of: &[f32]| of[x] * part + of[x + 1] * (1.0 - part);
            let over_low = between(low.0) - here;
            let over_high = between(high.0) - here;
            // Shares over either obstacle as fractions with positive denominators, so that one division is enough.
            let (low_steps, high_steps) = (between(low.1), between(high.1));
            let (above_low, above_high) = (range * low_steps - over_low, -over_high);
            let by_high = above_high * low_steps < above_low * high_steps;
            let above = if by_high { above_high } else { above_low };
            let share = larger(above / (range * if by_high { high_steps } else { low_steps }), 0.0);
            shares[x] = if over_low > 0.0 && share < 1.0 { share } else { 1.0 };
        }
        // Where lines come in from the side the outermost ones know of nothing.
        if width > 1 && self.shear > 0.0 && self.across[0] == SURFACE_BORDER {
            shares[0] = shares[1];
        } else if width > 1 && self.shear < 0.0 && self.across[1] + SURFACE_BORDER == self.size[0] {
            shares[width - 1] = shares[width - 2];
        }
    }

    /// Adds this step's row to the obstacles and goes on to the next row.
    #[inline(always)]
    fn advance(&mut self, step: usize, heights: &[f32]) {
        let (whole, part) = self.shift(step);
        let kept = self.obstacles[0].steps.len() as isize;
        let first = self.first.max(-whole);
        let end = (self.first + kept).min(self.size[0] as isize - 1 - whole);
        if first >= end {
            return;
        }
        let count = (end - first) as usize;
        let heights = &heights[(first + whole) as usize..][..count + 1];
        for (Obstacles { ceiling_mm, steps }, rise_mm) in self.obstacles.iter_mut().zip(self.rise_mm) {
            let ceiling_mm = &mut ceiling_mm[(first - self.first) as usize..][..count];
            let steps = &mut steps[(first - self.first) as usize..][..count];
            for x in 0..count {
                let height = heights[x] * (1.0 - part) + heights[x + 1] * part;
                let higher = height > ceiling_mm[x];
                ceiling_mm[x] = if higher { height } else { ceiling_mm[x] } - rise_mm;
                steps[x] = if higher { 0.0 } else { steps[x] } + 1.0;
            }
        }
    }
}
