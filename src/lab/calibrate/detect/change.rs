//! What a press changed in the picture of the pad: image minus background image, less the drift of the camera between
//! the two, as means of square blocks of pixels.

use image::RgbImage;

use crate::metrics::statistics::median;
use crate::presses::Circle;
use gelsim_core::base::grid::Grid;

/// Blocks along the longer side of the coarse grid.
const COARSE: usize = 80;

/// Change of each channel, grey levels, on a grid of blocks.
pub struct Change {
    /// Pixels in the side of a block.
    pub block_px: usize,
    /// Red, green and blue at each block.
    pub levels: Grid<[f32; 3]>,
    /// What was taken off.
    pub drift: Drift,
}

/// What differs everywhere, per channel: an offset, and a gain on the background's level.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Drift {
    offset: [f64; 3],
    gain: [f64; 3],
}

impl Drift {
    /// Found on blocks large enough to average noise. A line is fitted to the half of the picture that it fits best
    /// (least trimmed squares, Rousseeuw 1984): the press is in the other half.
    pub fn between(image: &RgbImage, background: &RgbImage, block_px: usize) -> Self {
        let (image, background) = (means(image, block_px), means(background, block_px));
        let mut drift = Self::default();
        for channel in 0..3 {
            let points = image.data.iter().zip(&background.data);
            let points: Vec<(f64, f64)> =
                points.map(|(a, b)| (f64::from(b[channel]), f64::from(a[channel] - b[channel]))).collect();
            (drift.offset[channel], drift.gain[channel]) = trimmed_line(points);
        }
        drift
    }
}

/// Offset and slope of the line through the best half of `points`. The slope is drawn to 0, so that a background of one
/// colour has none.
fn trimmed_line(mut points: Vec<(f64, f64)>) -> (f64, f64) {
    let values: Vec<f64> = points.iter().map(|point| point.1).collect();
    let (mut offset, mut slope) = (median(&values).unwrap_or(0.0), 0.0);
    let half = points.len().div_ceil(2);
    for _ in 0..8 {
        let residual = |point: &(f64, f64)| (point.1 - offset - slope * point.0).abs();
        points.sort_by(|a, b| residual(a).total_cmp(&residual(b)));
        let kept = &points[..half];
        let mean = |value: fn(&(f64, f64)) -> f64| kept.iter().map(value).sum::<f64>() / half as f64;
        let (x, y) = (mean(|point| point.0), mean(|point| point.1));
        let (mut xx, mut xy) = (half as f64, 0.0);
        for point in kept {
            xx += (point.0 - x) * (point.0 - x);
            xy += (point.0 - x) * (point.1 - y);
        }
        slope = xy / xx;
        offset = y - slope * x;
    }
    (offset, slope)
}

impl Change {
    /// On blocks of which 80 make the longer side, from an image and the background image of the same size.
    pub fn coarse(image: &RgbImage, background: &RgbImage) -> Self {
        let block_px = block_px(image);
        Self::new(image, background, Drift::between(image, background, block_px), block_px)
    }

    /// The same on blocks of `block_px`, with known drift.
    pub fn new(image: &RgbImage, background: &RgbImage, drift: Drift, block_px: usize) -> Self {
        let (mut levels, rest) = (means(image, block_px), means(background, block_px));
        for (level, rest) in levels.data.iter_mut().zip(&rest.data) {
            for channel in 0..3 {
                let drifted = drift.offset[channel] + (1.0 + drift.gain[channel]) * f64::from(rest[channel]);
                level[channel] -= drifted as f32;
            }
        }
        Self { block_px, levels, drift }
    }

    /// Size of a typical change where there is no press: the median over the blocks, grey levels; at
    /// least that of a picture without noise, 0.25.
    pub fn usual(&self) -> f64 {
        let sizes: Vec<f64> = self.levels.data.iter().map(|level| energy(*level).sqrt()).collect();
        median(&sizes).unwrap_or(0.0).max(0.25)
    }

    /// The change under a smooth kernel of about one block.
    pub fn smoothed(mut self) -> Self {
        for _ in 0..2 {
            self.levels = turned(&averaged(&turned(&averaged(&self.levels))));
        }
        self
    }

    /// The change at column `x`, row `y` in blocks, bilinear; None beyond the centres of the outer blocks.
    pub fn sample(&self, x: f64, y: f64) -> Option<[f32; 3]> {
        let Grid { width, height, .. } = self.levels;
        if !(x >= 0.0 && y >= 0.0 && x <= width as f64 - 1.0 && y <= height as f64 - 1.0) {
            return None;
        }
        let (x0, y0) = (x as usize, y as usize);
        let (x1, y1) = ((x0 + 1).min(width - 1), (y0 + 1).min(height - 1));
        let (u, v) = ((x - x0 as f64) as f32, (y - y0 as f64) as f32);
        let [a, b, c, d] = [(x0, y0), (x1, y0), (x0, y1), (x1, y1)].map(|(x, y)| self.levels.at(x, y));
        Some(std::array::from_fn(|k| (a[k] * (1.0 - u) + b[k] * u) * (1.0 - v) + (c[k] * (1.0 - u) + d[k] * u) * v))
    }

    /// A circle of the image on this grid.
    pub fn to_blocks(&self, circle: Circle) -> Circle {
        let block = self.block_px as f64;
        Circle { centre_px: circle.centre_px.map(|at| (at + 0.5) / block - 0.5), radius_px: circle.radius_px / block }
    }

    /// A circle of this grid on the image.
    pub fn to_pixels(&self, circle: Circle) -> Circle {
        let block = self.block_px as f64;
        Circle { centre_px: circle.centre_px.map(|at| (at + 0.5) * block - 0.5), radius_px: circle.radius_px * block }
    }
}

/// Squared size of a change.
pub fn energy(level: [f32; 3]) -> f64 {
    level.iter().map(|level| f64::from(*level) * f64::from(*level)).sum()
}

/// Pixels in the side of a block of which 80 make the longer side of an image.
pub fn block_px(image: &RgbImage) -> usize {
    (image.width().max(image.height()) as usize).div_ceil(COARSE).max(1)
}

/// Means of blocks of `block_px` squared; those at the right and lower border may be of fewer pixels.
pub fn means(image: &RgbImage, block_px: usize) -> Grid<[f32; 3]> {
    let (width, height) = (image.width() as usize, image.height() as usize);
    let mut means = Grid::<[f32; 3]>::new(width.div_ceil(block_px), height.div_ceil(block_px));
    let row_bytes = 3 * width;
    let mut sums = vec![[0_u32; 3]; means.width];
    for (row, rows) in image.as_raw().chunks(row_bytes.max(1) * block_px).enumerate() {
        sums.fill([0; 3]);
        for line in rows.chunks_exact(row_bytes) {
            for (sum, block) in sums.iter_mut().zip(line.chunks(3 * block_px)) {
                for pixel in block.chunks_exact(3) {
                    (0..3).for_each(|k| sum[k] += u32::from(pixel[k]));
                }
            }
        }
        let tall = rows.len() / row_bytes;
        for (x, (mean, sum)) in means.row_mut(row).iter_mut().zip(&sums).enumerate() {
            let count = tall * block_px.min(width - x * block_px);
            *mean = sum.map(|sum| sum as f32 / count as f32);
        }
    }
    means
}

/// Each value averaged with its neighbours in the row, weights 1 : 2 : 1.
fn averaged(grid: &Grid<[f32; 3]>) -> Grid<[f32; 3]> {
    let mut out = Grid::new(grid.width, grid.height);
    for y in 0..grid.height {
        let row = grid.row(y);
        for (x, value) in out.row_mut(y).iter_mut().enumerate() {
            let (left, here, right) = (row[x.saturating_sub(1)], row[x], row[(x + 1).min(grid.width - 1)]);
            *value = std::array::from_fn(|k| 0.25 * (left[k] + right[k]) + 0.5 * here[k]);
        }
    }
    out
}

/// Columns as rows.
fn turned(grid: &Grid<[f32; 3]>) -> Grid<[f32; 3]> {
    let mut out = Grid::new(grid.height, grid.width);
    for y in 0..grid.height {
        for (x, value) in grid.row(y).iter().enumerate() {
            out.data[x * grid.height + y] = *value;
        }
    }
    out
}

#[cfg(test)]
mod tests {
    use image::Rgb;

    use super::*;

    #[test]
    fn blocks_are_means_also_at_the_border() {
        let image = RgbImage::from_fn(5, 3, |x, y| Rgb([(10 * x + y) as u8, 7, 255]));
        let means = means(&image, 2);
        assert_eq!((means.width, means.height), (3, 2));
        assert_eq!(means.at(0, 0), [5.5, 7.0, 255.0]);
        assert_eq!(means.at(2, 0), [40.5, 7.0, 255.0]);
        assert_eq!(means.at(2, 1), [42.0, 7.0, 255.0]);
    }

    #[test]
    fn drift_is_found_under_a_press_of_a_third_of_the_picture() {
        let background = RgbImage::from_fn(90, 60, |x, y| Rgb([(40 + x) as u8, (60 + y) as u8, 128]));
        let image = RgbImage::from_fn(90, 60, |x, y| {
            let Rgb([red, green, blue]) = *background.get_pixel(x, y);
            let pressed = if x < 30 { 50 } else { 0 };
            Rgb([(f64::from(red) * 1.1 - 3.0).round() as u8 + pressed, green + 4, blue - 6])
        });
        let change = Change::new(&image, &background, Drift::between(&image, &background, 3), 3);
        for y in 0..20 {
            for x in 0..30 {
                let expected = if x < 10 { 50.0 } else { 0.0 };
                let [red, green, blue] = change.levels.at(x, y);
                assert!((red - expected).abs() < 0.6 && green.abs() < 0.1 && blue.abs() < 0.1, "{red} {green} {blue}");
            }
        }
    }

    #[test]
    fn circles_go_to_blocks_and_back() {
        let change = Change { block_px: 4, levels: Grid::new(1, 1), drift: Drift::default() };
        let circle = Circle { centre_px: [1.5, 5.5], radius_px: 8.0 };
        assert_eq!(change.to_blocks(circle), Circle { centre_px: [0.0, 1.0], radius_px: 2.0 });
        assert_eq!(change.to_pixels(change.to_blocks(circle)), circle);
    }
}
