//! Distances between two sets of images as sets, whatever they show: colours, edges and grain.
//!
//! Histograms are compared by the earth mover's distance (Rubner, Tomasi and Guibas 2000). In one dimension it is the
//! area between two cumulative distributions: how far values must be moved on average. Nothing is learned, and no
//! network is needed.

use image::{Rgb, RgbImage};
use serde::Serialize;

use super::spectrum::{OCTAVES, octave_bounds, octave_powers};

/// Bins of the histogram of slopes per grey level.
const BINS_PER_LEVEL: f64 = 8.0;
/// Number of bins: the steepest possible slope is 255 / sqrt(2) grey levels per pixel.
const SLOPE_BINS: usize = 1444;
/// Fraction of the pixels, those with the steepest slopes, that counts as edges.
const EDGE_FRACTION: f64 = 0.05;
/// Power that rounding to 8 bits adds to the mean of three channels, grey levels^2. It keeps ratios finite where an
/// image has no power.
const ROUNDING: f64 = 1.0 / 36.0;

/// Counts over a set of images.
#[derive(Clone, Debug)]
pub struct Tally {
    /// Number of images.
    pub images: u64,
    /// Number of pixels at each level, per channel.
    levels: [[u64; 256]; 3],
    /// Number of pixels in each bin of slopes.
    slopes: Vec<u64>,
    slope_sum: f64,
    /// For each octave the sum of the images' powers, and the number of images in it.
    powers: [(f64, u64); OCTAVES],
}

impl Default for Tally {
    fn default() -> Self {
        let slopes = vec![0; SLOPE_BINS];
        Self { images: 0, levels: [[0; 256]; 3], slopes, slope_sum: 0.0, powers: Default::default() }
    }
}

impl Tally {
    /// Counts one image.
    pub fn from_image(image: &RgbImage) -> Self {
        let mut tally = Self { images: 1, ..Self::default() };
        for Rgb(rgb) in image.pixels() {
            tally.levels.iter_mut().zip(rgb).for_each(|(levels, value)| levels[usize::from(*value)] += 1);
        }
        tally.count_slopes(image);
        for (sum, power) in tally.powers.iter_mut().zip(octave_powers(image)) {
            *sum = power.map_or((0.0, 0), |power| (power, 1));
        }
        tally
    }

    /// Counts the slopes of the grey image, by centred differences. The outermost pixels have none.
    fn count_slopes(&mut self, image: &RgbImage) {
        let width = image.width() as usize;
        let greys: Vec<i32> = image.pixels().map(|Rgb(rgb)| rgb.iter().map(|value| i32::from(*value)).sum()).collect();
        let rows: Vec<&[i32]> = greys.chunks_exact(width.max(1)).collect();
        for three in rows.windows(3) {
            let (above, row, below) = (three[0], three[1], three[2]);
            for x in 1..width.saturating_sub(1) {
                let (across, down) = (row[x + 1] - row[x - 1], below[x] - above[x]);
                // Centred differences span two pixels, and the greys are sums of three channels.
                let slope = f64::from(across * across + down * down).sqrt() / 6.0;
                self.slopes[(slope * BINS_PER_LEVEL) as usize] += 1;
                self.slope_sum += slope;
            }
        }
    }

    /// Adds the counts of another set.
    pub fn add(&mut self, other: &Self) {
        self.images += other.images;
        self.slope_sum += other.slope_sum;
        let levels = self.levels.as_flattened_mut().iter_mut().zip(other.levels.as_flattened());
        levels.chain(self.slopes.iter_mut().zip(&other.slopes)).for_each(|(sum, count)| *sum += count);
        for (sum, power) in self.powers.iter_mut().zip(other.powers) {
            *sum = (sum.0 + power.0, sum.1 + power.1);
        }
    }

    /// Mean slope, grey levels per pixel; NaN without pixels.
    fn mean_slope(&self) -> f64 {
        self.slope_sum / total_count(&self.slopes)
    }

    /// Mean of the steepest slopes, from their histogram.
    fn mean_edge_slope(&self) -> f64 {
        let wanted = EDGE_FRACTION * total_count(&self.slopes);
        let (mut left, mut sum) = (wanted, 0.0);
        for (bin, count) in self.slopes.iter().enumerate().rev() {
            let taken = left.min(*count as f64);
            sum += taken * (bin as f64 + 0.5) / BINS_PER_LEVEL;
            left -= taken;
        }
        sum / wanted
    }

    /// Mean power in an octave, grey levels^2; None if no image has it.
    fn octave_power(&self, number: usize) -> Option<f64> {
        let (sum, count) = self.powers[number];
        (count > 0).then(|| sum / count as f64 + ROUNDING)
    }
}

/// Distances of the simulated set from the real one. Ratios are simulated / real; None where the real value is 0 or
/// unknown.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Distances {
    /// Images in the real set.
    pub real_images: u64,
    /// Images in the simulated set.
    pub sim_images: u64,
    /// Red, green and blue.
    pub channels: [Channel; 3],
    /// Slopes of the grey image.
    pub slopes: Slopes,
    /// Power in each octave of frequency, the finest one first; without those that the images are too small for.
    pub octaves: Vec<Octave>,
    /// Root mean square of the octaves' logarithms.
    pub spectrum_rms: Option<f64>,
}

/// Levels of a channel.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Channel {
    /// Earth mover's distance of the histograms, grey levels.
    pub emd: f64,
    /// Mean of the simulated images less that of the real ones, grey levels.
    pub mean_shift: f64,
    /// Ratio of the standard deviations.
    pub deviation_ratio: Option<f64>,
}

/// Slopes of the grey image, grey levels per pixel.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Slopes {
    /// Earth mover's distance of the histograms, grey levels per pixel.
    pub emd: f64,
    /// Ratio of the means: edges and grain.
    pub mean_ratio: Option<f64>,
    /// Ratio of the means over the steepest twentieth of the pixels: edges.
    pub edge_ratio: Option<f64>,
}

/// Power in an octave of frequency.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Octave {
    /// Lower and upper frequency.
    pub cycles_per_px: [f64; 2],
    /// Decimal logarithm of simulated / real power density.
    pub log10_ratio: f64,
}

impl Distances {
    /// Compares two sets.
    pub fn between(real: &Tally, sim: &Tally) -> Self {
        let channels = std::array::from_fn(|channel| {
            let (real, sim) = (&real.levels[channel], &sim.levels[channel]);
            let [[real_mean, real_deviation], [sim_mean, sim_deviation]] = [real, sim].map(mean_and_deviation);
            Channel {
                emd: earth_movers_distance(real, sim),
                mean_shift: sim_mean - real_mean,
                deviation_ratio: ratio(sim_deviation, real_deviation),
            }
        });
        let slopes = Slopes {
            emd: earth_movers_distance(&real.slopes, &sim.slopes) / BINS_PER_LEVEL,
            mean_ratio: ratio(sim.mean_slope(), real.mean_slope()),
            edge_ratio: ratio(sim.mean_edge_slope(), real.mean_edge_slope()),
        };
        let octaves: Vec<Octave> = (0..OCTAVES)
            .filter_map(|number| {
                let log10_ratio = libm::log10(sim.octave_power(number)? / real.octave_power(number)?);
                Some(Octave { cycles_per_px: octave_bounds(number), log10_ratio })
            })
            .collect();
        let squares: f64 = octaves.iter().map(|octave| octave.log10_ratio * octave.log10_ratio).sum();
        let spectrum_rms = (!octaves.is_empty()).then(|| (squares / octaves.len() as f64).sqrt());
        Self { real_images: real.images, sim_images: sim.images, channels, slopes, octaves, spectrum_rms }
    }
}

fn ratio(sim: f64, real: f64) -> Option<f64> {
    (real > 0.0 && sim.is_finite()).then(|| sim / real)
}

fn total_count(counts: &[u64]) -> f64 {
    counts.iter().sum::<u64>() as f64
}

/// Mean and standard deviation of a histogram of levels; 0 without pixels.
fn mean_and_deviation(levels: &[u64; 256]) -> [f64; 2] {
    let total = total_count(levels).max(1.0);
    let moment = |of: &dyn Fn(f64) -> f64| {
        levels.iter().enumerate().map(|(level, count)| *count as f64 * of(level as f64)).sum::<f64>() / total
    };
    let mean = moment(&|level| level);
    [mean, moment(&|level| (level - mean) * (level - mean)).sqrt()]
}

/// Area between two cumulative distributions, bins; 0 if one of the histograms is empty.
fn earth_movers_distance(a: &[u64], b: &[u64]) -> f64 {
    let (all_a, all_b) = (total_count(a), total_count(b));
    if all_a == 0.0 || all_b == 0.0 {
        return 0.0;
    }
    let (mut below_a, mut below_b, mut area) = (0, 0, 0.0);
    for (a, b) in a.iter().zip(b) {
        below_a += a;
        below_b += b;
        area += (below_a as f64 / all_a - below_b as f64 / all_b).abs();
    }
    area
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;
    use rand::{RngExt, SeedableRng};
    use rand_chacha::ChaCha8Rng;

    use super::*;

    fn between(real: &RgbImage, sim: &RgbImage) -> Distances {
        Distances::between(&Tally::from_image(real), &Tally::from_image(sim))
    }

    /// A soft ramp with stripes, whose edges are `contrast` steep, and grain.
    fn picture(brighter: f64, contrast: f64, grain: f64) -> RgbImage {
        let mut rng = ChaCha8Rng::seed_from_u64(5);
        RgbImage::from_fn(200, 150, |x, y| {
            let stripe = 40.0 / (1.0 + (contrast * ((f64::from(x % 50) - 25.0).abs() - 12.0)).exp());
            let noise = grain * rng.random_range(-1.0..1.0);
            let level = 90.0 + stripe + 0.2 * f64::from(y) + noise;
            Rgb([level, level, level + brighter].map(|level| level.round() as u8))
        })
    }

    #[test]
    fn a_set_is_at_no_distance_from_itself_however_it_is_divided() {
        let (a, b) = (picture(0.0, 1.0, 3.0), picture(20.0, 0.5, 0.0));
        let mut both = Tally::from_image(&a);
        both.add(&Tally::from_image(&b));
        let mut twice = Tally::from_image(&b);
        [&a, &b, &a].into_iter().for_each(|image| twice.add(&Tally::from_image(image)));
        let distances = Distances::between(&both, &twice);
        let zero = [distances.channels[2].emd, distances.slopes.emd, distances.spectrum_rms.expect("octaves")];
        assert!(zero.iter().all(|distance| distance.abs() < 1e-9), "{distances:?}");
        let one = [distances.slopes.mean_ratio, distances.slopes.edge_ratio, distances.channels[0].deviation_ratio];
        assert!(one.iter().all(|ratio| ratio.is_some_and(|ratio| (ratio - 1.0).abs() < 1e-9)), "{distances:?}");
        assert_eq!((distances.real_images, distances.sim_images), (2, 4));
    }

    #[test]
    fn a_shift_of_one_channel_is_its_distance_with_its_sign() {
        let distances = between(&picture(0.0, 1.0, 2.0), &picture(-7.0, 1.0, 2.0));
        assert!(distances.channels[0].emd == 0.0 && distances.channels[0].mean_shift == 0.0);
        assert!(
            (distances.channels[2].emd - 7.0).abs() < 1e-9 && (distances.channels[2].mean_shift + 7.0).abs() < 1e-9
        );
    }

    #[test]
    fn softer_edges_and_missing_grain_are_told_apart() {
        let real = picture(0.0, 1.0, 3.0);
        let soft = between(&real, &picture(0.0, 0.3, 3.0));
        assert!(soft.slopes.edge_ratio.is_some_and(|ratio| ratio < 0.8), "{soft:?}");
        assert!(soft.octaves[0].log10_ratio.abs() < 0.1, "{soft:?}");
        let smooth = between(&real, &picture(0.0, 1.0, 0.0));
        assert!(smooth.octaves[0].log10_ratio < -1.0, "{smooth:?}");
        assert!(smooth.slopes.edge_ratio.is_some_and(|ratio| ratio > 0.8), "{smooth:?}");
    }

    #[test]
    fn images_without_any_contrast_have_no_ratios_and_no_infinities() {
        let flat = RgbImage::from_pixel(300, 200, Rgb([8, 8, 8]));
        let distances = between(&flat, &picture(0.0, 1.0, 6.0));
        assert_eq!((distances.slopes.mean_ratio, distances.channels[0].deviation_ratio), (None, None));
        assert!(distances.octaves.iter().all(|octave| octave.log10_ratio.is_finite()), "{distances:?}");
        let nothing = Distances::between(&Tally::default(), &Tally::default());
        assert_eq!((nothing.spectrum_rms, nothing.slopes.edge_ratio, nothing.channels[1].emd), (None, None, 0.0));
        let dot = RgbImage::new(1, 1);
        assert_eq!(between(&dot, &dot).slopes.mean_ratio, None);
    }

    #[test]
    fn the_steepest_step_there_can_be_is_counted() {
        let mut image = RgbImage::new(3, 3);
        image.put_pixel(2, 1, Rgb([255; 3]));
        image.put_pixel(1, 2, Rgb([255; 3]));
        let slope = 255.0 / 2.0_f64.sqrt();
        assert!((Tally::from_image(&image).mean_slope() - slope).abs() < 1e-9);
        assert!((Tally::from_image(&image).mean_edge_slope() - slope).abs() < 1.0 / BINS_PER_LEVEL);
    }

    proptest! {
        /// Plain reference implementation: sorted values, matched in order.
        #[test]
        fn the_distance_is_how_far_sorted_values_are_moved(
            a in prop::collection::vec(any::<u8>(), 40),
            b in prop::collection::vec(any::<u8>(), 40),
        ) {
            let counts = |values: &[u8]| {
                let mut counts = [0u64; 256];
                values.iter().for_each(|value| counts[usize::from(*value)] += 1);
                counts
            };
            let sorted = |mut values: Vec<u8>| {
                values.sort_unstable();
                values
            };
            let found = earth_movers_distance(&counts(&a), &counts(&b));
            let moved: u32 = sorted(a).iter().zip(sorted(b)).map(|(a, b)| u32::from(a.abs_diff(b))).sum();
            prop_assert!((found - f64::from(moved) / 40.0).abs() < 1e-9);
        }
    }
}
