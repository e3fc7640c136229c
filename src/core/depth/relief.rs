//! A relief that can be cut into objects: a tile that repeats, and coarser versions of it.
//!
//! The levels have 1, 3/4, 1/2, 3/8, 1/4 .. of the tile's texels along a side. Each is half of the last but one, made
//! by a maximally flat half-band low-pass (Dubuc 1986). A sample uses the level whose texels are about as large as its
//! pixels, so that finer detail fades out. It is read as a quadratic B-spline, so that slopes are continuous at any
//! magnification.

use super::patterns;
use super::patterns::Procedural;
use crate::base::grid::Grid;
use std::fmt;

/// One pattern, ready to be cut. Heights are from 0 to 1, the highest of the tile.
pub struct Relief {
    /// Finest first; the last one is flat.
    levels: Vec<ReliefLevel>,
    /// The tile's size along x and y, in units of the pattern's scale.
    extent: [f64; 2],
}

/// The tile at one resolution.
pub struct ReliefLevel {
    /// Texels along a side.
    size: usize,
    /// Depth below the highest point, 0 to 1, as control points of a B-spline; with a border of one texel that repeats
    /// the other side.
    valleys: Grid<f32>,
}

/// Number of pixels that are looked up at a time.
pub const BLOCK_PX: usize = 64;
/// Smallest size of a texel, in pixels; below one because the B-spline smooths too.
const TEXEL_PX: f64 = 0.75;
/// Largest number of texels along a side of a tile made from a height map.
const MAX_TEXELS: usize = 1024;

impl fmt::Debug for Relief {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("Relief").finish_non_exhaustive()
    }
}

impl Relief {
    /// Makes the relief of a computed pattern.
    pub fn procedural(pattern: Procedural) -> Self {
        let tile = match pattern {
            Procedural::Noise => patterns::noise_tile(),
            Procedural::Brushed => patterns::brushed_tile(),
            Procedural::Knurled => patterns::knurled_tile(),
            Procedural::Woven => patterns::woven_tile(),
            Procedural::Dimples => patterns::dimples_tile(),
        };
        Self::new(to_valleys(tile.heights), tile.extent)
    }

    /// Makes a relief from a height map of any size and range, which repeats at its borders. Its width is the pattern's
    /// scale. The relief is flat if the map is constant or empty; NaN and infinities count as lowest.
    pub fn from_heights(heights: Grid<f32>) -> Self {
        let size = [heights.width.max(1), heights.height.max(1)];
        // Repeat the map along its shorter side until it is about square.
        let longest = size[0].max(size[1]);
        let copies = size.map(|side| (2 * longest + side) / (2 * side));
        let texels = longest.next_power_of_two().clamp(4, MAX_TEXELS);
        let extent = [copies[0] as f64, copies[1] as f64 * size[1] as f64 / size[0] as f64];
        let empty = heights.data.is_empty();
        let finest = if empty { Grid::new(4, 4) } else { resample_tile(&to_valleys(heights), texels, copies) };
        Self::new(finest, extent)
    }

    fn new(finest: Grid<f32>, extent: [f64; 2]) -> Self {
        let between = resample_tile(&finest, finest.width / 4 * 3, [1, 1]);
        let mut levels = Vec::new();
        let mut tiles = [finest, between];
        while tiles[0].width > 2 {
            for tile in &mut tiles {
                levels.push(ReliefLevel::new(tile));
                *tile = filter_tile(tile, &HALF_BAND, 2);
            }
        }
        // The coarsest level is the mean: patterns much finer than a pixel lower the surface evenly.
        let [mut last, _] = tiles;
        let mean = last.data.iter().sum::<f32>() / last.data.len() as f32;
        last.data.fill(mean);
        levels.push(ReliefLevel::new(&last));
        Self { levels, extent }
    }

    /// Returns the tile's size, mm, for a pattern's scale of `scale_mm`.
    pub(crate) fn tile_mm(&self, scale_mm: f64) -> [f64; 2] {
        self.extent.map(|length| length * scale_mm)
    }

    /// Returns the level for pixels of a size, mm: the finest whose texels are large enough, else the flat one.
    pub(crate) fn level_for(&self, scale_mm: f64, pixel_mm: f64) -> &ReliefLevel {
        let [width, height] = self.tile_mm(scale_mm);
        let fits = |level: &&ReliefLevel| width.min(height) >= TEXEL_PX * pixel_mm * level.size as f64;
        self.levels.iter().find(fits).unwrap_or(&self.levels[self.levels.len() - 1])
    }
}

impl ReliefLevel {
    fn new(tile: &Grid<f32>) -> Self {
        // The B-spline blurs; this sharpening compensates to first order. With control points from 0 to 1 the spline
        // stays in 0 to 1.
        let sharp = filter_tile(tile, &[-0.125, 1.25, -0.125], 1);
        let size = tile.width;
        let mut valleys = Grid::new(size + 2, size + 2);
        for y in 0..size + 2 {
            let from = sharp.row((y + size - 1) % size);
            for (x, value) in valleys.row_mut(y).iter_mut().enumerate() {
                *value = from[(x + size - 1) % size].clamp(0.0, 1.0);
            }
        }
        Self { size, valleys }
    }

    /// Fills `valleys` with the depths below the highest point, 0 to 1 (up to rounding), at points of a line. In
    /// `start` and `step` the tile's side is 2^32, so that wrapping arithmetic repeats the tile.
    #[inline(always)]
    pub(crate) fn valleys_along(&self, start: [u32; 2], step: [u32; 2], valleys: &mut [f32; BLOCK_PX]) {
        let width = self.valleys.width as u32;
        let half = 0x8000_0000 / self.size as u32;
        let mut corner = [0_u32; BLOCK_PX];
        let (mut across, mut down) = ([[0.0_f32; BLOCK_PX]; 3], [[0.0_f32; BLOCK_PX]; 3]);
        for k in 0..BLOCK_PX {
            let at = |axis: usize| start[axis].wrapping_add(step[axis].wrapping_mul(k as u32));
            let ((column, x), (row, y)) = (self.spline_taps(at(0), half), self.spline_taps(at(1), half));
            corner[k] = row * width + column;
            (across[0][k], across[1][k], across[2][k]) = x;
            (down[0][k], down[1][k], down[2][k]) = y;
        }
        let rows = [0, 1, 2].map(|row| &self.valleys.data[row * self.valleys.width..]);
        for k in 0..BLOCK_PX {
            let at = corner[k] as usize;
            let [top, middle, bottom] = rows.map(|row| &row[at..at + 3]);
            let column = |x: usize| down[0][k] * top[x] + down[1][k] * middle[x] + down[2][k] * bottom[x];
            valleys[k] = across[0][k] * column(0) + across[1][k] * column(1) + across[2][k] * column(2);
        }
    }

    /// Returns the depth below the highest point at one point, 0 to 1; see [`ReliefLevel::valleys_along`].
    pub(crate) fn valley_at(&self, place: [u32; 2]) -> f32 {
        let half = 0x8000_0000 / self.size as u32;
        let ((column, x), (row, y)) = (self.spline_taps(place[0], half), self.spline_taps(place[1], half));
        let line = |below: u32| {
            let texels = &self.valleys.row((row + below) as usize)[column as usize..];
            x.0 * texels[0] + x.1 * texels[1] + x.2 * texels[2]
        };
        y.0 * line(0) + y.1 * line(1) + y.2 * line(2)
    }

    /// Returns the first of three texels, in the grid with border, and the weights of a quadratic B-spline.
    #[inline(always)]
    fn spline_taps(&self, at: u32, half: u32) -> (u32, (f32, f32, f32)) {
        // The nearest texel, and the distance from its near edge.
        let texels = u64::from(at.wrapping_add(half)) * self.size as u64;
        let t = (texels as u32 >> 8) as i32 as f32 * (1.0 / 16_777_216.0);
        let s = 1.0 - t;
        ((texels >> 32) as u32, (0.5 * s * s, 0.5 + s * t, 0.5 * t * t))
    }
}

/// Converts a coordinate in tiles for `ReliefLevel::valleys_along`; 0 if it is not finite.
pub fn tile_coordinate(tiles: f64) -> u32 {
    ((tiles - tiles.floor()) * 4_294_967_296.0 + 0.5) as u64 as u32
}

/// Taps of the maximally flat half-band low-pass.
const HALF_BAND: [f32; 7] = [-0.03125, 0.0, 0.28125, 0.5, 0.28125, 0.0, -0.03125];

/// Filters a repeating tile along both axes and keeps every `step`-th texel.
fn filter_tile(tile: &Grid<f32>, taps: &[f32], step: usize) -> Grid<f32> {
    let (size, reach) = (tile.width, taps.len() / 2);
    let mut both = Grid::<f32>::new(size / step, size / step);
    // The repeating row, from `reach` texels before its start.
    let mut line = vec![0.0; size + 2 * reach];
    for y in 0..size / step {
        line.fill(0.0);
        for (tap, weight) in taps.iter().enumerate() {
            let from = tile.row((y * step + tap + 4 * size - reach) % size);
            for (value, from) in line[reach..].iter_mut().zip(from) {
                *value += weight * from;
            }
        }
        for x in 0..reach {
            line[x] = line[reach + (x + 4 * size - reach) % size];
            line[reach + size + x] = line[reach + x % size];
        }
        for (value, from) in both.row_mut(y).iter_mut().zip(line.windows(taps.len()).step_by(step)) {
            *value = taps.iter().zip(from).map(|(weight, from)| weight * from).sum();
        }
    }
    both
}

/// Converts heights of any range to depths below the highest, 0 to 1.
fn to_valleys(mut heights: Grid<f32>) -> Grid<f32> {
    let finite = || heights.data.iter().copied().filter(|height| height.is_finite()).map(f64::from);
    let (low, high) = (finite().fold(f64::INFINITY, f64::min), finite().fold(f64::NEG_INFINITY, f64::max));
    for value in &mut heights.data {
        let below = if value.is_finite() { high - f64::from(*value) } else { high - low };
        *value = if high > low { (below / (high - low)) as f32 } else { 0.0 };
    }
    heights
}

/// Resamples `copies` of a height map, side by side along x and y, to `texels` x `texels`.
fn resample_tile(heights: &Grid<f32>, texels: usize, copies: [usize; 2]) -> Grid<f32> {
    let columns = resample_weights(heights.width, texels, copies[0]);
    let rows = resample_weights(heights.height, texels, copies[1]);
    let mut across = Grid::<f64>::new(texels, heights.height);
    for y in 0..heights.height {
        let from = heights.row(y);
        for (value, parts) in across.row_mut(y).iter_mut().zip(&columns) {
            *value = parts.iter().map(|(x, share)| share * f64::from(from[*x])).sum();
        }
    }
    let mut tile = Grid::new(texels, texels);
    for (y, parts) in rows.iter().enumerate() {
        for x in 0..texels {
            let height: f64 = parts.iter().map(|(row, share)| share * across.at(x, *row)).sum();
            tile.row_mut(y)[x] = height as f32;
        }
    }
    tile
}

/// Returns for each of `to` values the indices and weights of the `from` values that it consists of. The `from` values
/// are repeated `copies` times; the weights are quadratic B-splines wide enough to leave out no value.
fn resample_weights(from: usize, to: usize, copies: usize) -> Vec<Vec<(usize, f64)>> {
    let spacing = (copies * from) as f64 / to as f64;
    let width = spacing.max(1.0);
    let parts = |index: usize| {
        let middle = index as f64 * spacing;
        let (first, last) = ((middle - 1.5 * width).floor() as i64, (middle + 1.5 * width).ceil() as i64);
        let weights = (first..=last).map(|at| {
            let distance = (at as f64 - middle).abs() / width;
            let far = (1.5 - distance).max(0.0);
            let weight = if distance < 0.5 { 0.75 - distance * distance } else { 0.5 * far * far };
            (at.rem_euclid(from as i64) as usize, weight)
        });
        let total: f64 = weights.clone().map(|(_, weight)| weight).sum();
        weights.map(|(at, weight)| (at, weight / total)).collect()
    };
    (0..to).map(parts).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::base::rng::random_stream;

    fn random(width: usize, height: usize) -> Grid<f32> {
        let mut random = random_stream(1, "relief", 0);
        Grid { width, height, data: (0..width * height).map(|_| random.uniform() as f32).collect() }
    }

    /// The quadratic B-spline, from its definition as a box convolved with itself twice.
    fn spline(x: f64) -> f64 {
        let cubed = |x: f64| x.max(0.0) * x.max(0.0) / 2.0;
        cubed(x + 1.5) - 3.0 * cubed(x + 0.5) + 3.0 * cubed(x - 0.5) - cubed(x - 1.5)
    }

    #[test]
    fn a_level_is_the_spline_of_its_control_points() {
        let (start, step) = ([0xf123_4567, 77], [0x0345_6789, 0xf876_5432]);
        for size in [2, 6, 8_usize] {
            let level = ReliefLevel::new(&random(size, size));
            let mut fast = [0.0; BLOCK_PX];
            level.valleys_along(start, step, &mut fast);
            let texel = |i: i64| i.rem_euclid(size as i64) as usize + 1;
            for (k, fast) in fast.iter().enumerate() {
                let [x, y] = [0, 1].map(|axis: usize| {
                    let at = start[axis].wrapping_add(step[axis].wrapping_mul(k as u32));
                    f64::from(at) * size as f64 / 4_294_967_296.0
                });
                let mut plain = 0.0;
                for j in -3..12 {
                    for i in -3..12 {
                        let weight = spline(x - i as f64) * spline(y - j as f64);
                        plain += weight * f64::from(level.valleys.at(texel(i), texel(j)));
                    }
                }
                assert!((f64::from(*fast) - plain).abs() < 1e-6, "{fast} for {plain} at {x}, {y}");
            }
        }
    }

    #[test]
    fn every_level_has_the_mean_of_the_finest_and_the_last_is_flat() {
        let relief = Relief::from_heights(random(64, 64));
        let mean = |level: &ReliefLevel| {
            let inner = level.valleys.inner(1);
            inner.data.iter().sum::<f32>() / inner.data.len() as f32
        };
        let finest = mean(&relief.levels[0]);
        let sizes: Vec<usize> = relief.levels.iter().map(|level| level.size).collect();
        assert_eq!(sizes, [64, 48, 32, 24, 16, 12, 8, 6, 4, 3, 2]);
        for level in &relief.levels {
            assert!((mean(level) - finest).abs() < 0.03, "{} at {}", mean(level), level.size);
        }
        let last = &relief.levels[10].valleys.data;
        assert!(last.iter().all(|value| *value == last[0]));
    }

    #[test]
    fn texels_are_about_as_large_as_pixels_and_never_finer_than_three_quarters() {
        let relief = Relief::from_heights(random(256, 256));
        for (scale_mm, texels) in
            [(256.0, 256), (191.0, 192), (193.0, 256), (100.0, 128), (90.0, 96), (1e9, 256), (3.0, 4)]
        {
            assert_eq!(relief.level_for(scale_mm, 1.0).size, texels);
        }
        for scale_mm in [1.0, 0.0, -1.0, f64::NAN, 1e-300] {
            assert_eq!(relief.level_for(scale_mm, 1.0).size, 2);
        }
    }

    #[test]
    fn height_maps_of_any_size_and_range_become_heights_from_0_to_1() {
        for (width, height) in [(0, 0), (1, 1), (1, 50), (50, 1), (3, 7), (100, 30)] {
            let mut heights = random(width, height);
            for value in &mut heights.data {
                *value = (*value - 0.5) * f32::MAX;
            }
            let relief = Relief::from_heights(heights);
            for level in &relief.levels {
                assert!(level.valleys.data.iter().all(|value| (0.0..=1.0).contains(value)), "{width} x {height}");
            }
            let [x, y] = relief.extent;
            assert!((0.6..1.6).contains(&(x / y)), "tiles are about square: {x} x {y}");
        }
        let holes = vec![5.0, f32::NAN, 5.0, f32::NEG_INFINITY, 4.0, 5.0, f32::INFINITY, 5.0];
        let holes = to_valleys(Grid { width: 4, height: 2, data: holes });
        assert_eq!(holes.data, [0.0, 1.0, 0.0, 1.0, 1.0, 0.0, 1.0, 0.0]);
        let flat = Relief::from_heights(Grid { width: 2, height: 2, data: vec![7.0; 4] });
        assert!(flat.levels[0].valleys.data.iter().all(|value| *value == 0.0));
    }
}
