//! Noise of the camera: of reading a pixel, the same for all, and of counting light, larger where there is more.
//!
//! The variance of a value v is read^2 + shot^2 v (Janesick 2007, "Photon transfer"), and its distribution is normal.
//! Values are independent, or correlated with their neighbours where demosaicing or compression smeared them. Valid
//! while a pixel counts more than some ten photons. The noise of a pixel is a pure function of key, channel, row and
//! column: a counter is mixed as in lowbias32 (Wellons 2018), its four bytes are added up (nearly a normal
//! distribution, by the central limit), and a polynomial bends the sum the rest of the way.

use crate::base::simd::simd_dispatch;

/// Noise that a camera adds to the light, as standard deviations, 1 = full scale.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Noise {
    /// Standard deviation of every value, however dark; 0 = none.
    pub read: f32,
    /// Standard deviation of a value at full scale, by counting light; it grows with the square root of the value, and
    /// is 0 below 0.
    pub shot: f32,
    /// Factors on the noise of red, green and blue.
    pub color: [f32; 3],
    /// Correlation of neighbours along rows and columns, 0 to [`MAX_CORRELATION`].
    pub correlation: f64,
    /// Key of the noise: another key gives other noise.
    pub key: u64,
}

/// Largest correlation of neighbours that three pixels in a row can give: 0.7, a little less than the root of a half.
pub const MAX_CORRELATION: f64 = 0.7;

impl Noise {
    /// Adds noise to entire pictures of `width` columns (at least 1), row-major red, green and blue. With `where_mask`,
    /// a mask of the same size, only where that is not 0.
    pub fn add_to_planes(&self, width: usize, planes: &mut [Vec<f32>; 3], where_mask: Option<&[u8]>) {
        let width = width.max(1);
        simd_dispatch(
            #[inline(always)]
            || {
                for ((channel, plane), factor) in (0_u64..).zip(planes.iter_mut()).zip(self.color) {
                    let (read, shot) =
                        (factor * factor * self.read * self.read, factor * factor * self.shot * self.shot);
                    let mut rows = NoiseRows::new(self, channel, width);
                    for (row, values) in plane.chunks_mut(width).enumerate() {
                        let mask = where_mask.map(|mask| &mask[row * width..][..values.len()]);
                        if mask.is_some_and(|mask| mask.iter().all(|touched| *touched == 0)) {
                            continue;
                        }
                        let noise = rows.noise_row(row as u64);
                        let add = |value: &mut f32, noise: f32| {
                            let light = if *value > 0.0 { *value } else { 0.0 };
                            *value += (read + shot * light).sqrt() * noise;
                        };
                        match mask {
                            None => values.iter_mut().zip(noise).for_each(|(value, noise)| add(value, *noise)),
                            Some(mask) => {
                                for ((value, noise), touched) in values.iter_mut().zip(noise).zip(mask) {
                                    add(value, if *touched == 0 { 0.0 } else { *noise });
                                }
                            }
                        }
                    }
                }
            },
        );
    }
}

/// Makes rows of noise of variance 1 in one channel: white, or correlated because each value has a share of its
/// neighbours.
struct NoiseRows {
    key: u64,
    channel: u64,
    /// Weight of each of the two neighbours against the value itself.
    neighbour: f32,
    /// The last three rows after mixing along x, and which they are.
    mixed: [(Option<u64>, Vec<f32>); 3],
    white: Vec<f32>,
    row: Vec<f32>,
}

impl NoiseRows {
    fn new(noise: &Noise, channel: u64, width: usize) -> Self {
        // With weights w, 1, w neighbours correlate by 2 w / (1 + 2 w^2).
        let correlation = noise.correlation.min(MAX_CORRELATION);
        let neighbour = match correlation > 0.0 {
            true => (1.0 - libm::sqrt(1.0 - 2.0 * correlation * correlation)) / (2.0 * correlation),
            false => 0.0,
        };
        Self {
            key: noise.key,
            channel,
            neighbour: neighbour as f32,
            mixed: [(); 3].map(|()| (None, Vec::new())),
            white: Vec::new(),
            row: vec![0.0; width],
        }
    }

    /// Returns the noise of a row of the picture.
    #[inline(always)]
    fn noise_row(&mut self, row: u64) -> &[f32] {
        let width = self.row.len();
        if self.neighbour == 0.0 {
            fill_white_noise(&mut self.row, row_keys(self.key, self.channel, row));
            return &self.row;
        }
        // Rows and columns of white noise begin one before those of the picture.
        for wanted in row..row + 3 {
            let (at, mixed) = &mut self.mixed[(wanted % 3) as usize];
            if *at != Some(wanted) {
                *at = Some(wanted);
                self.white.resize(width + 2, 0.0);
                fill_white_noise(&mut self.white, row_keys(self.key, self.channel, wanted));
                mixed.resize(width, 0.0);
                blend_neighbours([&self.white, &self.white[1..], &self.white[2..]], self.neighbour, mixed);
            }
        }
        let [above, here, below] = [0, 1, 2].map(|k| &self.mixed[((row + k) % 3) as usize].1[..]);
        blend_neighbours([above, here, below], self.neighbour, &mut self.row);
        &self.row
    }
}

/// Adds a share of both neighbours to the middle one; the variance is 1 if theirs is.
#[inline(always)]
fn blend_neighbours([before, here, after]: [&[f32]; 3], neighbour: f32, out: &mut [f32]) {
    let scale = 1.0 / (1.0 + 2.0 * neighbour * neighbour).sqrt();
    for (((out, before), here), after) in out.iter_mut().zip(before).zip(here).zip(after) {
        *out = (here + neighbour * (before + after)) * scale;
    }
}

/// Fills a row with white noise.
#[inline(always)]
fn fill_white_noise(values: &mut [f32], keys: [u32; 2]) {
    for (column, value) in (0_u32..).zip(values) {
        *value = normal_from_bits(hash_column(column, keys));
    }
}

/// Returns two keys of a row. Two rows share one of them now and then, but not both: they would share all their noise.
fn row_keys(key: u64, channel: u64, row: u64) -> [u32; 2] {
    let keys = splitmix64(splitmix64(key).wrapping_add((channel << 48) | row));
    [keys as u32, (keys >> 32) as u32]
}

/// Returns 64 bits that look random, another number for each number (the finaliser of SplitMix64; Steele, Lea, Flood
/// 2014).
pub(super) fn splitmix64(number: u64) -> u64 {
    let mut bits = number.wrapping_add(0x9e37_79b9_7f4a_7c15);
    bits = (bits ^ (bits >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    bits = (bits ^ (bits >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
    bits ^ (bits >> 31)
}

/// Returns 32 bits of a column that look random.
#[inline(always)]
fn hash_column(column: u32, keys: [u32; 2]) -> u32 {
    let mut bits = column.wrapping_add(keys[0]);
    bits = (bits ^ (bits >> 16)).wrapping_mul(0x7feb_352d) ^ keys[1];
    bits = (bits ^ (bits >> 15)).wrapping_mul(0x846c_a68b);
    bits ^ (bits >> 16)
}

/// Mean of the sum of four bytes; the sum is 0 to twice this.
const BYTE_SUM_MEAN: i32 = 510;

/// Makes a standard normal number (mean 0, variance 1) of 32 random bits: one of 1021 levels, 1/150 apart in the
/// middle, up to +-5.17.
#[inline(always)]
fn normal_from_bits(bits: u32) -> f32 {
    let pairs = (bits & 0x00ff_00ff) + ((bits >> 8) & 0x00ff_00ff);
    let sum = ((pairs + (pairs >> 16)) & 0xffff) as i32;
    let x = (sum - BYTE_SUM_MEAN) as f32 * (1.0 / BYTE_SUM_MEAN as f32);
    let square = x * x;
    // Fitted to the inverse of the normal distribution at the probability of each sum, and scaled to variance 1.
    x * (3.324_18 + square * (0.295_463_1 + square * (1.389_822_6 + square * (-3.174_336_7 + square * 3.339_703_3))))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::base::simd::scalar_only;

    const WIDTH: usize = 640;
    const HEIGHT: usize = 384;

    fn noise_of(read: f32, shot: f32, key: u64) -> Noise {
        Noise { read, shot, color: [1.0; 3], correlation: 0.0, key }
    }

    /// Noise alone: what is added to `light` everywhere.
    fn noise(read: f32, shot: f32, key: u64, light: f32) -> [Vec<f32>; 3] {
        let mut planes = [(); 3].map(|()| vec![light; WIDTH * HEIGHT]);
        noise_of(read, shot, key).add_to_planes(WIDTH, &mut planes, None);
        planes.map(|plane| plane.iter().map(|value| value - light).collect())
    }

    fn mean(values: impl Iterator<Item = f64>) -> f64 {
        let (sum, count) = values.fold((0.0, 0), |(sum, count), value| (sum + value, count + 1));
        sum / f64::from(count)
    }

    /// Correlation of `a` with `b` shifted by (`dx`, `dy`), of values and of their squares.
    fn correlation(a: &[f32], b: &[f32], dx: usize, dy: usize) -> [f64; 2] {
        let pairs = || {
            let places = (0..HEIGHT - dy).flat_map(move |y| (0..WIDTH - dx).map(move |x| y * WIDTH + x));
            places.map(|i| (f64::from(a[i]), f64::from(b[i + dy * WIDTH + dx])))
        };
        [mean(pairs().map(|(a, b)| a * b)), mean(pairs().map(|(a, b)| (a * a - 1.0) * (b * b - 1.0))) / 2.0]
    }

    #[test]
    fn every_level_has_the_place_that_the_normal_distribution_gives_it() {
        let mut ways = vec![1.0];
        for _ in 0..4 {
            let mut more = vec![0.0; ways.len() + 255];
            for (sum, ways) in ways.iter().enumerate() {
                more[sum..sum + 256].iter_mut().for_each(|more| *more += ways / 256.0);
            }
            ways = more;
        }
        let (mut below, mut moments) = (0.0, [0.0; 5]);
        for (sum, share) in (0_u32..).zip(ways) {
            let bits = (0..4).fold(0, |bits, k| (bits << 8) | sum.saturating_sub(255 * k).min(255));
            let level = f64::from(normal_from_bits(bits));
            for (power, moment) in (0..).zip(&mut moments) {
                *moment += share * level.powi(power);
            }
            // Above the middle, the distribution's own mirror image.
            let expected = 0.5 * libm::erfc(-level / std::f64::consts::SQRT_2);
            if level < 0.0 {
                let middle: f64 = below + share / 2.0;
                assert!((middle - expected).abs() < 4e-4, "{level}: {middle} {expected}");
                assert!(level < -4.5 || (middle / expected - 1.0).abs() < 0.25, "{level}: {middle} {expected}");
            }
            below += share;
        }
        let [one, mean, variance, skew, kurtosis] = moments;
        assert!((one - 1.0).abs() < 1e-12 && mean.abs() < 1e-6 && skew.abs() < 1e-6);
        assert!((variance - 1.0).abs() < 1e-5 && (kurtosis - 3.0).abs() < 0.001, "{variance} {kurtosis}");
        assert!(normal_from_bits(u32::MAX) > 5.1 && normal_from_bits(u32::MAX) == -normal_from_bits(0));
    }

    #[test]
    fn a_picture_of_noise_has_the_moments_of_the_normal_curve() {
        let planes = noise(1.0, 0.0, 3, 0.0);
        let all = || planes.iter().flatten().map(|value| f64::from(*value));
        assert!(mean(all()).abs() < 0.005, "{}", mean(all()));
        assert!((mean(all().map(|v| v * v)) - 1.0).abs() < 0.008);
        assert!((mean(all().map(|v| v.powi(4))) - 3.0).abs() < 0.06);
        assert!(all().fold(0.0, f64::max) > 4.3 && all().fold(0.0, f64::min) < -4.3);
    }

    #[test]
    fn variance_is_that_of_reading_plus_what_light_adds() {
        for (light, variance) in [(-0.5, 4e-4), (0.0, 4e-4), (0.25, 6e-4), (1.0, 12e-4)] {
            let planes = noise(0.02, libm::sqrtf(8e-4), 9, light);
            let found = mean(planes[1].iter().map(|value| f64::from(*value).powi(2)));
            assert!((found / variance - 1.0).abs() < 0.02, "{light}: {found} {variance}");
        }
        let mut still = [vec![0.3], vec![-2.0], vec![0.0]];
        noise_of(0.0, 0.0, 1).add_to_planes(1, &mut still, None);
        assert_eq!(still, [vec![0.3], vec![-2.0], vec![0.0]]);
    }

    #[test]
    fn neighbours_channels_and_samples_know_nothing_of_each_other() {
        let [first, second] = [noise(1.0, 0.0, 0, 0.0), noise(1.0, 0.0, 1, 0.0)];
        let [red, green, blue] = &first;
        let lags =
            [(1, 0), (2, 0), (3, 0), (4, 0), (8, 0), (16, 0), (64, 0), (256, 0), (0, 1), (0, 2), (0, 16), (1, 1)];
        let mut found: Vec<[f64; 2]> = lags.iter().map(|(dx, dy)| correlation(red, red, *dx, *dy)).collect();
        found.extend([correlation(red, green, 0, 0), correlation(green, blue, 0, 0), correlation(red, blue, 1, 0)]);
        found.extend((0..3).map(|channel| correlation(&first[channel], &second[channel], 0, 0)));
        found.extend([correlation(red, &second[0], 0, 1), correlation(red, &second[0], 1, 0)]);
        for (case, found) in found.iter().enumerate() {
            // Five standard errors of the fewest pairs.
            assert!(found.iter().all(|correlation| correlation.abs() < 0.014), "case {case}: {found:?}");
        }
    }

    #[test]
    fn correlated_noise_has_the_correlation_that_it_is_given_and_the_same_variance() {
        for wanted in [0.1, 0.4, 0.6, MAX_CORRELATION] {
            let mut planes = [(); 3].map(|()| vec![0.0; WIDTH * HEIGHT]);
            let noise = Noise { color: [2.0, 1.0, 0.5], correlation: wanted, ..noise_of(1.0, 0.0, 5) };
            noise.add_to_planes(WIDTH, &mut planes, None);
            for (plane, factor) in planes.iter().zip([2.0, 1.0, 0.5]) {
                let unit: Vec<f32> = plane.iter().map(|value| value / factor).collect();
                let variance = mean(unit.iter().map(|value| f64::from(*value).powi(2)));
                assert!((variance - 1.0).abs() < 0.03, "{wanted}: {variance}");
                let product = wanted * wanted;
                for (dx, dy, expected) in [(1, 0, wanted), (0, 1, wanted), (1, 1, product), (3, 0, 0.0), (0, 3, 0.0)] {
                    let [found, _] = correlation(&unit, &unit, dx, dy);
                    assert!((found - expected).abs() < 0.02, "{wanted}, {dx} {dy}: {found}");
                }
            }
        }
    }

    #[test]
    fn a_mask_decides_where_noise_is_added_and_not_which() {
        let speckle = Noise { correlation: 0.6, ..noise_of(0.1, 0.0, 8) };
        let mask: Vec<u8> = (0..40 * 30).map(|k| if k / 40 > 11 && k % 7 < 3 { 255 } else { 0 }).collect();
        let [mut everywhere, mut touched] = [(); 2].map(|()| [(); 3].map(|()| vec![0.5; 40 * 30]));
        speckle.add_to_planes(40, &mut everywhere, None);
        speckle.add_to_planes(40, &mut touched, Some(&mask));
        for (all, some) in everywhere.iter().zip(&touched) {
            for ((all, some), mask) in all.iter().zip(some).zip(&mask) {
                assert_eq!(some.to_bits(), if *mask == 0 { 0.5_f32 } else { *all }.to_bits());
            }
        }
    }

    #[test]
    fn rows_and_columns_have_a_flat_spectrum() {
        const SIZE: usize = 128;
        let cosines: [f64; SIZE] = std::array::from_fn(|k| libm::cos(std::f64::consts::TAU * k as f64 / SIZE as f64));
        let plane = &noise(1.0, 0.0, 77, 0.0)[0];
        for (stride, next) in [(1, WIDTH), (WIDTH, 1)] {
            let lines: Vec<usize> = if stride == 1 {
                (0..HEIGHT).flat_map(|y| (0..WIDTH / SIZE).map(move |k| y * next + k * SIZE)).collect()
            } else {
                (0..WIDTH).flat_map(|x| (0..HEIGHT / SIZE).map(move |k| x * next + k * SIZE * WIDTH)).collect()
            };
            for wave in 1..SIZE / 2 {
                let power = mean(lines.iter().map(|start| {
                    let (mut cosine, mut sine) = (0.0, 0.0);
                    for k in 0..SIZE {
                        let value = f64::from(plane[start + k * stride]);
                        cosine += value * cosines[wave * k % SIZE];
                        sine += value * cosines[(wave * k + SIZE / 4) % SIZE];
                    }
                    (cosine * cosine + sine * sine) / SIZE as f64
                }));
                // The standard error is 0.023.
                assert!((power - 1.0).abs() < 0.11, "stride {stride}, wave {wave}: {power}");
            }
        }
    }

    #[test]
    fn a_pixel_s_noise_depends_on_its_place_alone_and_on_no_processor() {
        let noise = noise_of(0.01, 0.02, 0x1234_5678_9abc_def0);
        let wide_view = {
            let mut planes = [(); 3].map(|()| vec![0.25; 61 * 7]);
            noise.add_to_planes(61, &mut planes, None);
            planes
        };
        let mut small_view = [(); 3].map(|()| vec![0.25; 5 * 4]);
        scalar_only(|| noise.add_to_planes(5, &mut small_view, None));
        for (channel, plane) in small_view.iter().enumerate() {
            for (i, value) in plane.iter().enumerate() {
                assert_eq!(value.to_bits(), wide_view[channel][i / 5 * 61 + i % 5].to_bits());
            }
        }
        // Pinned: a change here changes every dataset with noise.
        assert_eq!(wide_view[1][100].to_bits(), PINNED);
    }

    const PINNED: u32 = 0x3e82_2015;

    #[test]
    fn no_two_rows_of_many_samples_begin_alike() {
        let mut starts: Vec<[u32; 2]> = (0..200)
            .flat_map(|key| (0..3).flat_map(move |channel| (0..100).map(move |row| row_keys(key, channel, row))))
            .collect();
        starts.sort_unstable();
        starts.dedup();
        assert_eq!(starts.len(), 200 * 3 * 100);
    }

    #[test]
    fn extremes_give_finite_numbers() {
        for (width, size) in [(1, 1), (1, 640), (640, 640), (7, 10), (0, 0), (0, 3)] {
            for light in [0.0, -0.0, f32::MIN_POSITIVE, -1e30, 1e30] {
                let mut planes = [(); 3].map(|()| vec![light; size]);
                noise_of(1e3, 1e-30, u64::MAX).add_to_planes(width, &mut planes, None);
                assert!(planes.iter().flatten().all(|value| value.is_finite()));
            }
        }
    }
}
