//! How strong a real sensor's noise is: as its file says, or measured between its own images.
//!
//! Two images of one sensor differ by their presses, which are smooth nearly everywhere, and by the noise of both. The
//! mask 1 -2 1 across and down takes off what is smooth (Immerkaer 1996, "Fast noise variance estimation"); the median
//! of what is left does not mind the rims of contacts. Noise is taken to be white and the same at every brightness: of a
//! camera that compresses its pictures, what it smears over neighbours is not counted.

use image::RgbImage;

use gelsim_files::sensor::camera::CameraDistribution;
use gelsim_files::sensor::quantity::Quantity;

/// Noise of a sensor, as standard deviations in grey levels.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct NoiseLevel {
    /// Of every pixel.
    pub read_levels: f64,
    /// Of a white pixel, by counting light.
    pub shot_levels: f64,
}

/// Root of the sum of the mask's squared weights.
const MASK_NORM: f64 = 6.0;

/// Median of the size of a standard normal number.
const NORMAL_MEDIAN: f64 = 0.674_489_750_196_081_7;

/// Variance of rounding to whole levels.
const ROUNDING: f64 = 1.0 / 12.0;

impl NoiseLevel {
    /// What a sensor's `[camera]` table says: the middle of each distribution. `None` if that is nothing.
    pub fn from_camera(settings: &CameraDistribution) -> Option<Self> {
        let middle = |distribution: &Quantity| match distribution.support() {
            (min, max) if min.is_finite() && max.is_finite() => 0.5 * (min + max),
            _ => 0.0,
        };
        let [read_levels, shot_levels] = [&settings.read_noise_levels, &settings.shot_noise_levels].map(middle);
        (read_levels > 0.0 || shot_levels > 0.0).then_some(Self { read_levels, shot_levels })
    }

    /// Measured between each image and the next; the root mean square over channels of the median over pairs. `None`
    /// without two images of one size.
    pub fn from_images(images: &[RgbImage]) -> Option<Self> {
        let pairs = images.windows(2).filter(|pair| pair[0].dimensions() == pair[1].dimensions());
        let variances: Vec<[f64; 3]> = pairs.filter_map(|pair| variances(&pair[0], &pair[1])).collect();
        let channel = |k: usize| {
            let values: Vec<f64> = variances.iter().map(|variance| variance[k]).collect();
            gelsim_lab::metrics::statistics::median(&values)
        };
        let [red, green, blue] = [channel(0)?, channel(1)?, channel(2)?];
        let read_levels = libm::sqrt((red + green + blue) / 3.0);
        Some(Self { read_levels, shot_levels: 0.0 })
    }

    /// What has to be added to an image that has `present` times this noise so that it has `wanted` times this noise;
    /// none if it has as much.
    pub fn missing(&self, wanted: f64, present: f64) -> Self {
        let fraction = libm::sqrt((wanted * wanted - present * present).max(0.0));
        Self { read_levels: fraction * self.read_levels, shot_levels: fraction * self.shot_levels }
    }
}

/// Variance of one image's noise in each channel, without rounding's, from two. `None` if they are too small.
fn variances(a: &RgbImage, b: &RgbImage) -> Option<[f64; 3]> {
    // 16 times the largest difference.
    const MOST: usize = 16 * 255;
    let (width, height) = (a.width() as usize, a.height() as usize);
    let difference: Vec<i32> = a.as_raw().iter().zip(b.as_raw()).map(|(a, b)| i32::from(*a) - i32::from(*b)).collect();
    let variance = |channel: usize| {
        let at = |x: usize, y: usize| difference[3 * (y * width + x) + channel];
        let mut counts = vec![0_u64; MOST + 1];
        for y in 1..height.saturating_sub(1) {
            let line = |x: usize| at(x, y - 1) - 2 * at(x, y) + at(x, y + 1);
            for x in 1..width.saturating_sub(1) {
                counts[(line(x - 1) - 2 * line(x) + line(x + 1)).unsigned_abs() as usize] += 1;
            }
        }
        let deviation = median(&counts)? / (NORMAL_MEDIAN * MASK_NORM);
        // Two images' noise, and the rounding of both.
        Some((0.5 * deviation * deviation - ROUNDING).max(0.0))
    };
    Some([variance(0)?, variance(1)?, variance(2)?])
}

/// Median of sizes that were rounded to whole numbers: each is spread evenly over what rounds to it.
fn median(counts: &[u64]) -> Option<f64> {
    let total: u64 = counts.iter().sum();
    let half = 0.5 * total as f64;
    let mut below = 0.0;
    for (size, count) in counts.iter().enumerate().filter(|(_, count)| **count > 0) {
        let (start, width) = if size == 0 { (0.0, 0.5) } else { (size as f64 - 0.5, 1.0) };
        let count = *count as f64;
        if below + count >= half {
            return Some(start + width * (half - below) / count);
        }
        below += count;
    }
    None
}
