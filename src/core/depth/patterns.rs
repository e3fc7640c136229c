//! The patterns of textures as height maps: one tile for each, which repeats without a seam. Heights can have any
//! range; lengths are in units of the pattern's scale.
//!
//! Knurls, weaves and dimples are plain geometry. The noise is a random lattice refined by corner cutting (Chaikin
//! 1974), with finer noise added at every step (Fournier, Fussell and Carpenter 1982). Brushed metal is the lower
//! envelope of many scratches.

use std::f64::consts::PI;

use crate::base::grid::Grid;
use crate::base::rng::{RandomStream, random_stream};

/// Texels along a side of a random tile.
const RANDOM_TILE_TEXELS: usize = 1024;
/// Texels along a side of the other tiles, which show a few periods.
const REGULAR_TILE_TEXELS: usize = 512;

/// Patterns that are computed, not loaded.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Procedural {
    /// Roughness without direction, as of cast metal.
    Noise,
    /// Scratches along x, as of brushed metal.
    Brushed,
    /// Pyramids between crossing grooves, as of a knurled grip.
    Knurled,
    /// A plain weave.
    Woven,
    /// Spherical dents on a hexagonal grid.
    Dimples,
}

/// A height map that repeats without a seam.
pub struct PatternTile {
    /// Square, with a power of two texels per side. Texel (i, j) is the height at the point (i, j) itself.
    pub heights: Grid<f32>,
    /// The tile's size along x and y, in units of the pattern's scale.
    pub extent: [f64; 2],
}

impl PatternTile {
    /// Makes a tile by calling `height` at every texel with x and y in units of the scale.
    fn new(extent: [f64; 2], height: impl Fn(f64, f64) -> f64) -> Self {
        let [dx, dy] = extent.map(|length| length / REGULAR_TILE_TEXELS as f64);
        let mut heights = Grid::new(REGULAR_TILE_TEXELS, REGULAR_TILE_TEXELS);
        for j in 0..REGULAR_TILE_TEXELS {
            for (i, value) in heights.row_mut(j).iter_mut().enumerate() {
                *value = height(i as f64 * dx, j as f64 * dy) as f32;
            }
        }
        Self { heights, extent }
    }
}

/// Makes roughness without direction, as of cast metal or sandpaper. The scale is the size of the largest bumps.
pub fn noise_tile() -> PatternTile {
    /// Ratio of heights between bumps of one size and those of twice the size.
    const GAIN: f32 = 0.6;
    let mut random = random_stream(0, "relief", 0);
    let mut white = |size: usize, height: f32| -> Vec<f32> {
        (0..size * size).map(|_| height * (random.uniform() as f32 - 0.5)).collect()
    };
    // A bump is two lattice points wide.
    let mut size = 32;
    let extent = [size as f64 / 2.0; 2];
    let mut heights = Grid { width: size, height: size, data: white(size, 1.0) };
    let mut gain = 1.0;
    while size < RANDOM_TILE_TEXELS {
        heights = refine_lattice(&heights);
        size *= 2;
        gain *= GAIN;
        for (value, finer) in heights.data.iter_mut().zip(white(size, gain)) {
            *value += finer;
        }
    }
    compress_extremes(&mut heights);
    PatternTile { heights, extent }
}

/// Compresses heights far from the mean: rare extremes would use up the range.
fn compress_extremes(heights: &mut Grid<f32>) {
    let count = heights.data.len() as f64;
    let mean = heights.data.iter().map(|value| f64::from(*value)).sum::<f64>() / count;
    let squares = heights.data.iter().map(|value| (f64::from(*value) - mean) * (f64::from(*value) - mean)).sum::<f64>();
    let spread = (squares / count).sqrt();
    for value in &mut heights.data {
        let deviation = (f64::from(*value) - mean) / (2.0 * spread);
        *value = (deviation / (1.0 + deviation * deviation).sqrt()) as f32;
    }
}

/// Refines a periodic lattice to twice as many points on the quadratic B-spline that it controls.
fn refine_lattice(coarse: &Grid<f32>) -> Grid<f32> {
    let size = coarse.width;
    let mut fine = Grid::new(2 * size, 2 * size);
    for y in 0..2 * size {
        let near = coarse.row(y / 2);
        let far = coarse.row((y / 2 + size - 1 + 2 * (y % 2)) % size);
        let column = |x: usize| 0.75 * near[x] + 0.25 * far[x];
        for (x, pair) in fine.row_mut(y).chunks_exact_mut(2).enumerate() {
            let (left, here, right) = (column((x + size - 1) % size), column(x), column((x + 1) % size));
            pair[0] = 0.75 * here + 0.25 * left;
            pair[1] = 0.75 * here + 0.25 * right;
        }
    }
    fine
}

/// Makes brushed metal: scratches along x, of many lengths, widths and depths. The scale is the distance between lines.
pub fn brushed_tile() -> PatternTile {
    /// Size of the tile in lines. Scratches are long along x, so texels may be, too.
    const EXTENT: [f64; 2] = [256.0, 64.0];
    const SCRATCHES: usize = 6000;
    let mut random = random_stream(0, "relief", 1);
    let mut heights = Grid::new(RANDOM_TILE_TEXELS, RANDOM_TILE_TEXELS);
    for number in 0..SCRATCHES {
        // Evenly spread across the tile, so that there are no bare strips.
        let y = (number as f64 + random.uniform()) / SCRATCHES as f64;
        Scratch::draw(&mut random, y * RANDOM_TILE_TEXELS as f64, RANDOM_TILE_TEXELS as f64 / EXTENT[1])
            .cut_into(&mut heights);
    }
    compress_extremes(&mut heights);
    PatternTile { heights, extent: EXTENT }
}

/// A groove along x; lengths are in texels.
struct Scratch {
    x: f64,
    y: f64,
    length: f64,
    half_width: f64,
    depth: f64,
}

impl Scratch {
    fn draw(random: &mut RandomStream, y: f64, rows_per_line: f64) -> Self {
        let mut between = |low: f64, high: f64| low + (high - low) * random.uniform();
        // Log-uniform: narrow scratches are as frequent per octave as wide ones.
        let share = libm::exp(between(libm::log(0.12), libm::log(0.8)));
        Self {
            x: between(0.0, RANDOM_TILE_TEXELS as f64),
            y,
            length: libm::exp(between(libm::log(30.0), libm::log(500.0))),
            half_width: rows_per_line * share,
            depth: libm::sqrt(share) * between(0.1, 1.0),
        }
    }

    /// Lowers the heights by the groove, which fades out towards its ends.
    fn cut_into(&self, heights: &mut Grid<f32>) {
        let size = heights.width as i64;
        let columns = self.x as i64..(self.x + self.length) as i64;
        for row in (self.y - self.half_width).ceil() as i64..=(self.y + self.half_width).floor() as i64 {
            let across = (row as f64 - self.y) / self.half_width;
            let deepest = (self.depth * (1.0 - across * across)) as f32;
            let line = heights.row_mut((row & (size - 1)) as usize);
            for column in columns.clone() {
                let along = ((column as f64 - self.x) * (2.0 / self.length) - 1.0) as f32;
                let fade = 1.0 - along * along;
                line[(column & (size - 1)) as usize] -= deepest * fade * fade;
            }
        }
    }
}

/// Makes a diamond knurl: two sets of V grooves that cross at 60 degrees and leave pyramids. The scale is the distance
/// between grooves.
pub fn knurled_tile() -> PatternTile {
    /// The tops of the pyramids are cut off at this height.
    const TOP: f64 = 0.9;
    let rows = libm::sqrt(3.0) / 2.0;
    let flank = |across: f64| 2.0 * (across - across.round()).abs();
    PatternTile::new([4.0, 4.0 / rows], |x, y| flank(rows * y - x / 2.0).min(flank(rows * y + x / 2.0)).min(TOP))
}

/// Makes a plain weave: yarns of round section along x and along y, alternately over and under each other. The scale is
/// the distance between yarns.
pub fn woven_tile() -> PatternTile {
    /// Half the width of a yarn.
    const HALF_WIDTH: f64 = 0.46;
    /// Amplitudes of a yarn's centre line, and of the lines that its twist leaves, in units of half the yarn's height.
    const WAVE: f64 = 0.6;
    const TWIST: f64 = 0.06;
    let yarn = |across: f64, along: f64| {
        let number = across.floor();
        let from_middle = (across - number - 0.5) / HALF_WIDTH;
        let round = (1.0 - from_middle * from_middle).max(0.0).sqrt();
        // The centre of a crossing is at half-integers; neighbouring yarns go opposite ways.
        let wave = libm::sin(PI * (along + number));
        let twist = libm::cos(2.0 * PI * (5.0 * along + from_middle));
        round + WAVE * wave + TWIST * round * twist
    };
    PatternTile::new([4.0, 4.0], |x, y| yarn(x, y).max(yarn(y, x + 1.0)))
}

/// Makes spherical dents on a hexagonal grid. The scale is the distance between dents.
pub fn dimples_tile() -> PatternTile {
    /// Radius of a dent.
    const RADIUS: f64 = 0.42;
    let rows = libm::sqrt(3.0) / 2.0;
    PatternTile::new([4.0, 4.0 * rows], |x, y| {
        // The hexagonal grid is made of two rectangular ones.
        let square = |shift: f64| {
            let dx = x + shift - (x + shift).round();
            let dy = y / (2.0 * rows) + shift - (y / (2.0 * rows) + shift).round();
            dx * dx + dy * dy * 4.0 * rows * rows
        };
        (square(0.0).min(square(0.5)) / (RADIUS * RADIUS)).min(1.0)
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn no_tile_has_a_seam() {
        for tile in [noise_tile(), brushed_tile(), knurled_tile(), woven_tile(), dimples_tile()] {
            let Grid { width, height, .. } = tile.heights;
            assert!(width == height && width.is_power_of_two());
            // The roughest neighbours within the tile are rougher than the average of those across its border.
            let step = |a: [usize; 2], b: [usize; 2]| {
                f64::from((tile.heights.at(a[0], a[1]) - tile.heights.at(b[0], b[1])).abs())
            };
            let columns = |x: usize| (0..height).map(|y| step([x, y], [(x + 1) % width, y])).sum::<f64>();
            let rows = |y: usize| (0..width).map(|x| step([x, y], [x, (y + 1) % height])).sum::<f64>();
            let roughest = |lines: &dyn Fn(usize) -> f64| (0..width - 1).map(lines).fold(0.0, f64::max);
            assert!(columns(width - 1) <= roughest(&columns) * 1.001, "{:?}", tile.extent);
            assert!(rows(height - 1) <= roughest(&rows) * 1.001, "{:?}", tile.extent);
        }
    }

    #[test]
    fn refining_keeps_straight_slopes() {
        let ramp = |x: usize| if x < 8 { x as f32 } else { 16.0 - x as f32 };
        let mut coarse = Grid::new(16, 16);
        for y in 0..16 {
            for x in 0..16 {
                coarse.row_mut(y)[x] = ramp(x) + 10.0 * ramp(y);
            }
        }
        let fine = refine_lattice(&coarse);
        for y in 4..12 {
            for x in 4..12 {
                let expected = (x as f32 / 2.0 - 0.25) + 10.0 * (y as f32 / 2.0 - 0.25);
                assert!((fine.at(x, y) - expected).abs() < 1e-5, "{} at {x}, {y}", fine.at(x, y));
            }
        }
    }
}
