//! Noise of a real sensor: as its file states, or measured between its images.
//!
//! Two images of one sensor differ by their presses, which are smooth nearly everywhere, and by the noise of both. The
//! mask 1 -2 1 across and down removes what is smooth (Immerkaer 1996, "Fast noise variance estimation"), and the
//! median of the rest is robust against the rims of contacts. Noise is taken to be white and equal at every brightness;
//! noise that a compressing camera smears over neighbours is not counted.

use image::RgbImage;

use gelsim_files::sensor::camera::CameraDistribution;
use gelsim_files::sensor::quantity::Quantity;

/// Noise of a sensor, as standard deviations in grey levels.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct NoiseLevel {
    /// Read noise of every pixel.
    pub read_levels: f64,
    /// Shot noise of a white pixel.
    pub shot_levels: f64,
}

/// Root of the sum of the mask's squared weights.
const MASK_NORM: f64 = 6.0;

/// Median of the absolute value of a standard normal number.
const NORMAL_MEDIAN: f64 = 0.674_489_750_196_081_7;

/// Variance of rounding to integer levels.
const ROUNDING: f64 = 1.0 / 12.0;

impl NoiseLevel {
    /// Takes the noise from a sensor's `[camera]` table: the middle of each distribution. `None` if that is 0.
    pub fn from_camera(settings: &CameraDistribution) -> Option<Self> {
        let middle = |distribution: &Quantity| match distribution.support() {
            (min, max) if min.is_finite() && max.is_finite() => 0.5 * (min + max),
            _ => 0.0,
        };
        let [read_levels, shot_levels] = [&settings.read_noise_levels, &settings.shot_noise_levels].map(middle);
        (read_levels > 0.0 || shot_levels > 0.0).then_some(Self { read_levels, shot_levels })
    }

    /// Measures the noise between each image and the next: the median over pairs, root mean square over channels.
    /// `None` without two images of one size.
    pub fn from_images(images: &[RgbImage]) -> Option<Self> {
        let pairs = images.windows(2).filter(|pair| pair[0].dimensions() == pair[1].dimensions());
        let variances: Vec<[f64; 3]> = pairs.filter_map(|pair| pair_noise_variances(&pair[0], &pair[1])).collect();
        let channel = |k: usize| {
            let values: Vec<f64> = variances.iter().map(|variance| variance[k]).collect();
            super::statistics::median(&values)
        };
        let [red, green, blue] = [channel(0)?, channel(1)?, channel(2)?];
        let read_levels = libm::sqrt((red + green + blue) / 3.0);
        Some(Self { read_levels, shot_levels: 0.0 })
    }

    /// Returns the noise to add to an image that has `present` times this noise, so that it has `wanted` times this
    /// noise; 0 if it has as much.
    pub fn noise_to_add(&self, wanted: f64, present: f64) -> Self {
        let fraction = libm::sqrt((wanted * wanted - present * present).max(0.0));
        Self { read_levels: fraction * self.read_levels, shot_levels: fraction * self.shot_levels }
    }
}

/// Variance of one image's noise in each channel, without that of rounding, from two images. `None` if they are too
/// small.
fn pair_noise_variances(a: &RgbImage, b: &RgbImage) -> Option<[f64; 3]> {
    // The weights of the mask sum up to 16 in absolute value.
    const MAX_DIFFERENCE: usize = 16 * 255;
    let (width, height) = (a.width() as usize, a.height() as usize);
    let difference: Vec<i32> = a.as_raw().iter().zip(b.as_raw()).map(|(a, b)| i32::from(*a) - i32::from(*b)).collect();
    let variance = |channel: usize| {
        let at = |x: usize, y: usize| difference[3 * (y * width + x) + channel];
        let mut counts = vec![0_u64; MAX_DIFFERENCE + 1];
        for y in 1..height.saturating_sub(1) {
            let line = |x: usize| at(x, y - 1) - 2 * at(x, y) + at(x, y + 1);
            for x in 1..width.saturating_sub(1) {
                counts[(line(x - 1) - 2 * line(x) + line(x + 1)).unsigned_abs() as usize] += 1;
            }
        }
        let deviation = median_of_counts(&counts)? / (NORMAL_MEDIAN * MASK_NORM);
        // The difference has the noise of two images, and the rounding of both.
        Some((0.5 * deviation * deviation - ROUNDING).max(0.0))
    };
    Some([variance(0)?, variance(1)?, variance(2)?])
}

/// Median of sizes that were rounded to integers: the counts of each are spread evenly over the interval that rounds to
/// it.
fn median_of_counts(counts: &[u64]) -> Option<f64> {
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
