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
        let width = width.max(1);
        let (mut sums, mut squares, mut steps) = ([0_u64; 3], 0_u64, 0_u64);
        let mut greys = vec![0_u16; width];
        for row in rgb.chunks_exact(3 * width) {
            let mut row_sums = [0_u32; 3];
            for (grey, pixel) in greys.iter_mut().zip(row.as_chunks().0) {
                let [red, green, blue] = *pixel;
                let levels = [u16::from(red), u16::from(green), u16::from(blue)];
                *grey = levels[0] + levels[1] + levels[2];
                for k in 0..3 {
                    row_sums[k] += u32::from(levels[k]);
                }
            }
            for k in 0..3 {
                sums[k] += u64::from(row_sums[k]);
            }
            squares += greys.iter().map(|grey| u64::from(u32::from(*grey) * u32::from(*grey))).sum::<u64>();
            let neighbours = greys.iter().zip(&greys[1..]);
            steps += u64::from(neighbours.map(|(a, b)| u32::from(a.abs_diff(*b))).sum::<u32>());
        }
        let grey: u64 = sums.iter().sum();
        let count = (rgb.len() / 3).max(1) as f64;
        let mean = grey as f64 / count;
        let between = (count - count / width as f64).max(1.0);
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
