//! Statistics of an image that show what augmentation changes in a set.

/// Statistics of an image, in grey levels.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct ImageStats {
    /// Mean of red, green and blue.
    pub mean: [f64; 3],
    /// Standard deviation over the image of the mean of the channels.
    pub contrast: f64,
    /// Mean difference of neighbours in a row.
    pub sharpness: f64,
}

impl ImageStats {
    /// Computes the statistics of an image with rows of `width` pixels.
    pub fn from_rgb(width: usize, rgb: &[u8]) -> Self {
        let (mut sums, mut grey, mut squares, mut steps) = ([0_u64; 3], 0_u64, 0_u64, 0_u64);
        for row in rgb.chunks_exact(3 * width.max(1)) {
            let mut before = None;
            for pixel in row.chunks_exact(3) {
                let three: u64 = pixel.iter().map(|level| u64::from(*level)).sum();
                sums.iter_mut().zip(pixel).for_each(|(sum, level)| *sum += u64::from(*level));
                grey += three;
                squares += three * three;
                steps += before.map_or(0, |before: u64| before.abs_diff(three));
                before = Some(three);
            }
        }
        let count = (rgb.len() / 3).max(1) as f64;
        let mean = grey as f64 / count;
        let between = (count - count / width.max(1) as f64).max(1.0);
        Self {
            mean: sums.map(|sum| sum as f64 / count),
            contrast: (squares as f64 / count - mean * mean).max(0.0).sqrt() / 3.0,
            sharpness: steps as f64 / between / 3.0,
        }
    }

    /// Adds the values of another image, to sum over images.
    pub fn add(&mut self, other: &Self) {
        self.mean.iter_mut().zip(other.mean).for_each(|(sum, more)| *sum += more);
        self.contrast += other.contrast;
        self.sharpness += other.sharpness;
    }

    /// Means over the `count` images that were summed, in the order of [`IMAGE_STAT_NAMES`].
    pub fn mean_values(&self, count: u64) -> [f64; 5] {
        let [red, green, blue] = self.mean;
        [red, green, blue, self.contrast, self.sharpness].map(|sum| sum / count.max(1) as f64)
    }
}

/// Names of the statistics.
pub const IMAGE_STAT_NAMES: [&str; 5] = ["mean_red", "mean_green", "mean_blue", "contrast", "sharpness"];

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn statistics_are_those_of_an_image_counted_by_hand() {
        // Two rows of three pixels: 0, 30, 60 in every channel of each row.
        let rgb: Vec<u8> = [0, 30, 60, 0, 30, 60].iter().flat_map(|level| [*level; 3]).collect();
        let image_stats = ImageStats::from_rgb(3, &rgb);
        assert_eq!(image_stats.mean, [30.0; 3]);
        assert!((image_stats.contrast - 600.0_f64.sqrt()).abs() < 1e-9, "{}", image_stats.contrast);
        assert_eq!(image_stats.sharpness, 30.0);
    }
}
