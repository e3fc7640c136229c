//! An object on the solver's grid: its penetration, and the pixels that its walls cut.

use std::ops::Range;

use super::lattice::Lattice;
use super::partial_pixels::PartialPixel;
use super::pixel_block::{PixelBlock, Step, WallScale};
use super::wall_marks::WallMarks;
use crate::base::grid::{Grid, Rect};
use crate::base::simd::{larger, simd_dispatch, smaller};
use crate::depth::Depth;

/// How much stiffer a pixel is that ends at a wall, in pixel sizes times 2 / E', where only pixel centres tell of the wall.
const EDGE_STIFFENING: f32 = 0.1;

/// Distance of candidates in a row, in the solver's pixels, up to which they are tested together with what lies between.
const MARKED_TOGETHER: usize = 8;

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
        let scale = WallScale::new(lattice, depth, mm_per_px, kernel);
        if lattice.factor == 1 {
            let partial_pixels = find_edge_pixels(&depth.penetration, depth.touching, &scale);
            return Self { penetration: Grid::default(), partial_pixels };
        }
        let mut downsampled =
            Self { penetration: lattice.downsample(&depth.penetration, mm_per_px), partial_pixels: Vec::new() };
        if depth.touching.is_empty() {
            return downsampled;
        }
        let around = lattice.coarse_box_around(depth.touching);
        let mut candidates = WallCandidates::new(&depth.penetration, &scale, around);
        let mut marks = WallMarks::default();
        for y in around.y0..around.y1 {
            candidates.find_in_row(y);
            marks.clear(depth.penetration.width);
            for near in candidates.found.chunk_by(|x, next| next - x <= MARKED_TOGETHER) {
                let columns =
                    candidates.fine_around(near[0], 0).start..candidates.fine_around(near[near.len() - 1], 0).end;
                marks.mark(&depth.penetration, lattice.fine_within(y, 1).0, columns, scale.step_mm);
            }
            for &x in candidates.found.iter().filter(|x| marks.any(lattice.fine_within(**x, 0).0)) {
                let block = PixelBlock::new(&scale, &depth.penetration, &marks, [x, y]);
                if let Some((pixel, penetration)) = block.partial_pixel(downsampled.penetration.at(x, y)) {
                    downsampled.partial_pixels.push(pixel);
                    downsampled.penetration.row_mut(y)[x] = penetration;
                }
            }
        }
        downsampled
    }
}

/// Pixels of a row of the solver's grid that a wall may cut: a quick test.
struct WallCandidates<'a> {
    fine: &'a Grid<f32>,
    scale: &'a WallScale,
    around: Rect,
    /// The highest and the lowest penetration of each of the camera's columns within the row and a pixel around it, with
    /// one column more at either end.
    high: Vec<f32>,
    low: Vec<f32>,
    /// Above 0 where the object may drop by a wall between one of these columns and those after it, as many as a solver's
    /// pixel has with one on either side.
    drops: Vec<u8>,
    /// Columns of the solver's grid.
    found: Vec<usize>,
}

impl<'a> WallCandidates<'a> {
    fn new(fine: &'a Grid<f32>, scale: &'a WallScale, around: Rect) -> Self {
        let zeros = vec![0.0; fine.width + 2];
        Self { fine, scale, around, high: zeros.clone(), low: zeros, drops: Vec::new(), found: Vec::new() }
    }

    /// Returns the camera's columns or rows in one of the solver's pixels and the one on either side.
    fn fine_around(&self, coarse: usize, k: usize) -> Range<usize> {
        let (inside, _) = self.scale.lattice.fine_within(coarse, k);
        let size = [self.fine.width, self.fine.height][k];
        inside.start.saturating_sub(1)..(inside.end + 1).min(size)
    }

    /// Finds pixels in which the object may drop by a wall, or beside which it may, and presses there.
    fn find_in_row(&mut self, y: usize) {
        let lattice = self.scale.lattice;
        let (rows, width) = (self.fine_around(y, 1), self.fine.width);
        let first = lattice.fine_within(self.around.x0, 0).0;
        // All pixels have as many columns. Numbers of columns count from the one more at the left.
        let wide = first.len() + 2;
        let columns = first.start..lattice.fine_within(self.around.x1 - 1, 0).0.end + 2;
        let inside = columns.start.max(1)..columns.end.min(width + 1);
        let least_mm = self.scale.least_step_mm();
        self.drops.clear();
        self.drops.resize(columns.len() + 1 - wide, 0);
        let Self { fine, high, low, drops, .. } = self;
        simd_dispatch(
            #[inline(always)]
            move || {
                let row = |y: usize| &fine.row(y)[inside.start - 1..inside.end - 1];
                high[inside.clone()].copy_from_slice(row(rows.start));
                low[inside.clone()].copy_from_slice(row(rows.start));
                for y in rows.start + 1..rows.end {
                    let spans = high[inside.clone()].iter_mut().zip(&mut low[inside.clone()]);
                    for ((high, low), g) in spans.zip(row(y)) {
                        *high = larger(*g, *high);
                        *low = smaller(*g, *low);
                    }
                }
                for values in [&mut *high, &mut *low] {
                    (values[0], values[width + 1]) = (values[1], values[width]);
                }
                let spans = [&high[columns.clone()], &low[columns]];
                match wide {
                    4 => flag_drops::<4>(spans, least_mm, drops),
                    5 => flag_drops::<5>(spans, least_mm, drops),
                    6 => flag_drops::<6>(spans, least_mm, drops),
                    7 => flag_drops::<7>(spans, least_mm, drops),
                    _ => drops.fill(1),
                }
            },
        );
        let drops = self.drops.iter().step_by(lattice.factor);
        self.found.clear();
        self.found.extend((self.around.x0..self.around.x1).zip(drops).filter(|(_, drops)| **drops > 0).map(|(x, _)| x));
    }
}

/// Flags the columns with which `WIDE` columns begin where the object may drop by a wall.
#[inline(always)]
fn flag_drops<const WIDE: usize>([high, low]: [&[f32]; 2], least_mm: f32, drops: &mut [u8]) {
    let (high, low) = (&high[..drops.len() + WIDE - 1], &low[..drops.len() + WIDE - 1]);
    for (x, drops) in drops.iter_mut().enumerate() {
        let (mut most, mut least) = (high[x], low[x]);
        for k in 1..WIDE {
            most = larger(high[x + k], most);
            least = smaller(low[x + k], least);
        }
        *drops = u8::from((most > 0.0) & (most - larger(least, 0.0) > smaller(0.5 * most, least_mm)));
    }
}

/// Finds the pixels that end at a wall, on the camera's own grid, which does not tell where in the next pixel it is.
fn find_edge_pixels(fine: &Grid<f32>, touching: Rect, scale: &WallScale) -> Vec<PartialPixel> {
    let mut found = Vec::new();
    for y in touching.y0..touching.y1 {
        let rows = [y.saturating_sub(1), y, (y + 1).min(fine.height - 1)].map(|y| fine.row(y));
        for x in touching.x0..touching.x1 {
            let g = rows[1][x];
            let beside = [rows[1][x.saturating_sub(1)], rows[1][(x + 1).min(fine.width - 1)], rows[0][x], rows[2][x]];
            let drop = g - beside.into_iter().fold(g, f32::min).max(0.0);
            if drop <= (0.5 * g).min(scale.least_step_mm()) {
                continue;
            }
            let mut wall = 0.0_f32;
            for (n, _) in beside.into_iter().enumerate().filter(|(_, mm)| mm.max(0.0) < g) {
                // The first and the third lie before the pixel, and begin the pair.
                let first = [x - usize::from(n == 0), y - usize::from(n == 2)];
                let step = step_from(fine, first, n / 2, scale.step_mm[n / 2]);
                wall = wall.max(step.share * (1.0 - step.steepness).max(0.0));
            }
            if wall > 0.0 {
                found.push(PartialPixel::at_edge([x, y], -EDGE_STIFFENING * scale.sharing * wall * scale.unit));
            }
        }
    }
    found
}

/// Returns what lies between a pixel and the next one along axis `k`.
fn step_from(fine: &Grid<f32>, first: [usize; 2], k: usize, step_mm: f32) -> Step {
    let last = [fine.width, fine.height][k] - 1;
    let pressed_mm = |by: isize| {
        let mut at = first;
        at[k] = first[k].saturating_add_signed(by).min(last);
        fine.at(at[0], at[1]).max(0.0)
    };
    Step::between([-2, -1, 0, 1, 2, 3].map(pressed_mm), step_mm)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::base::grid::Resolution;
    use crate::base::rng::random_stream;

    #[test]
    fn candidates_are_the_pixels_with_a_drop_in_or_beside_them() {
        let mut random = random_stream(5, "walls", 0);
        let mut found_any = 0;
        for (width, height) in [(2, 3), (4, 4), (7, 5), (64, 9), (65, 12), (130, 11)] {
            for resolution in [Resolution::Half, Resolution::Quarter] {
                let lattice = Lattice::new(resolution, [width, height]);
                let mut penetration: Grid<f32> = Grid::new(width, height);
                // Mostly above the pad, with single pixels that stand out.
                for mm in &mut penetration.data {
                    let number = random.uniform() as f32;
                    *mm = if number < 0.95 { 0.03 * number - 0.025 } else { 0.3 };
                }
                let touching = Rect::whole(width, height);
                let depth = Depth { penetration, margin_px: 0, touching, deepest_mm: 0.0, over_thickness_px: 0 };
                let kernel = Grid { width: 1, height: 1, data: vec![1.0] };
                let scale = WallScale::new(lattice, &depth, [0.02, 0.03], &kernel);
                let around = lattice.coarse_box_around(touching);
                let mut candidates = WallCandidates::new(&depth.penetration, &scale, around);
                for y in around.y0..around.y1 {
                    candidates.find_in_row(y);
                    let drops = |x: &usize| {
                        let columns = candidates.fine_around(*x, 0);
                        let values =
                            || candidates.fine_around(y, 1).flat_map(|y| &depth.penetration.row(y)[columns.clone()]);
                        let most = values().copied().fold(f32::NEG_INFINITY, f32::max);
                        let least = values().copied().fold(f32::INFINITY, f32::min);
                        most > 0.0 && most - least.max(0.0) > (0.5 * most).min(scale.least_step_mm())
                    };
                    let expected: Vec<usize> = (around.x0..around.x1).filter(drops).collect();
                    // Fewer columns than one of the solver's pixels has are not tested quickly.
                    if width >= lattice.factor {
                        assert_eq!(candidates.found, expected, "{width} x {height}, {resolution:?}, row {y}");
                    }
                    found_any += expected.len();
                }
            }
        }
        assert!(found_any > 100);
    }
}
