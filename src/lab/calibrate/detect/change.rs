//! What a press changes in the picture of the pad: image minus background image, less the camera's drift between the
//! two, as means over square blocks of pixels.

use image::RgbImage;

use crate::metrics::statistics::median;
use crate::presses::Circle;
use gelsim_core::base::grid::Grid;

/// Number of blocks along the longer side of the coarse grid.
const COARSE_BLOCKS: usize = 80;

/// Change of each channel, grey levels, on a grid of blocks.
pub struct BlockChange {
    /// Side of a block, px.
    pub block_px: usize,
    /// Change of red, green and blue in each block.
    pub levels: Grid<[f32; 3]>,
    /// Drift that was removed.
    pub drift: Drift,
}

/// Difference that is everywhere, per channel: an offset, and a gain on the background's level.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Drift {
    offset: [f64; 3],
    gain: [f64; 3],
}

impl Drift {
    /// Estimates the drift on blocks large enough to average noise. A line is fitted to the half of the picture that it
    /// fits best (least trimmed squares, Rousseeuw 1984): the press is in the other half.
    pub fn estimate(image: &RgbImage, background: &RgbImage, block_px: usize) -> Self {
        let (image, background) = (block_means(image, block_px), block_means(background, block_px));
        let mut drift = Self::default();
        for channel in 0..3 {
            let points = image.data.iter().zip(&background.data);
            let points: Vec<(f64, f64)> =
                points.map(|(a, b)| (f64::from(b[channel]), f64::from(a[channel] - b[channel]))).collect();
            (drift.offset[channel], drift.gain[channel]) = fit_trimmed_line(points);
        }
        drift
    }
}

/// Returns offset and slope of the line through the best half of `points`. The slope is drawn towards 0, so that a
/// background of a single colour has none.
fn fit_trimmed_line(mut points: Vec<(f64, f64)>) -> (f64, f64) {
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

impl BlockChange {
    /// Computes the change on coarse blocks, from an image and the background image of the same size.
    pub fn on_coarse_blocks(image: &RgbImage, background: &RgbImage) -> Self {
        let block_px = coarse_block_px(image);
        Self::new(image, background, Drift::estimate(image, background, block_px), block_px)
    }

    /// Computes the change on blocks of `block_px`, with a known drift.
    pub fn new(image: &RgbImage, background: &RgbImage, drift: Drift, block_px: usize) -> Self {
        let (mut levels, rest) = (block_means(image, block_px), block_means(background, block_px));
        for (level, rest) in levels.data.iter_mut().zip(&rest.data) {
            for channel in 0..3 {
                let drifted = drift.offset[channel] + (1.0 + drift.gain[channel]) * f64::from(rest[channel]);
                level[channel] -= drifted as f32;
            }
        }
        Self { block_px, levels, drift }
    }

    /// Typical size of the change where nothing was pressed: the median over the blocks, grey levels; at least 0.25, as
    /// in a picture without noise.
    pub fn typical_size(&self) -> f64 {
        let sizes: Vec<f64> = self.levels.data.iter().map(|level| change_energy(*level).sqrt()).collect();
        median(&sizes).unwrap_or(0.0).max(0.25)
    }

    /// Smooths the change with a kernel of about one block.
    pub fn smooth(mut self) -> Self {
        for _ in 0..2 {
            self.levels = transpose(&average_along_rows(&transpose(&average_along_rows(&self.levels))));
        }
        self
    }

    /// Interpolates the change at column `x`, row `y` in blocks; None outside the centres of the outermost blocks.
    pub fn sample_at(&self, x: f64, y: f64) -> Option<[f32; 3]> {
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

    /// Converts a circle of the image to this grid.
    pub fn to_blocks(&self, circle: Circle) -> Circle {
        let block = self.block_px as f64;
        Circle { centre_px: circle.centre_px.map(|at| (at + 0.5) / block - 0.5), radius_px: circle.radius_px / block }
    }

    /// Converts a circle of this grid to the image.
    pub fn to_pixels(&self, circle: Circle) -> Circle {
        let block = self.block_px as f64;
        Circle { centre_px: circle.centre_px.map(|at| (at + 0.5) * block - 0.5), radius_px: circle.radius_px * block }
    }
}

/// Squared size of a change, summed over channels.
pub fn change_energy(level: [f32; 3]) -> f64 {
    level.iter().map(|level| f64::from(*level) * f64::from(*level)).sum()
}

/// Side of the blocks of which 80 make the longer side of an image, px.
pub fn coarse_block_px(image: &RgbImage) -> usize {
    (image.width().max(image.height()) as usize).div_ceil(COARSE_BLOCKS).max(1)
}

/// Means over square blocks of side `block_px`; those at the right and lower border may have fewer pixels.
pub fn block_means(image: &RgbImage, block_px: usize) -> Grid<[f32; 3]> {
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

/// Averages each value with its neighbours in the row, with weights 1 : 2 : 1.
fn average_along_rows(grid: &Grid<[f32; 3]>) -> Grid<[f32; 3]> {
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

/// Exchanges rows and columns.
fn transpose(grid: &Grid<[f32; 3]>) -> Grid<[f32; 3]> {
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
        let means = block_means(&image, 2);
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
        let change = BlockChange::new(&image, &background, Drift::estimate(&image, &background, 3), 3);
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
        let change = BlockChange { block_px: 4, levels: Grid::new(1, 1), drift: Drift::default() };
        let circle = Circle { centre_px: [1.5, 5.5], radius_px: 8.0 };
        assert_eq!(change.to_blocks(circle), Circle { centre_px: [0.0, 1.0], radius_px: 2.0 });
        assert_eq!(change.to_pixels(change.to_blocks(circle)), circle);
    }
}
