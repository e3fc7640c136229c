//! Differences between two 8-bit RGB images: mean absolute error, PSNR, SSIM; over all pixels or over a mask.
//!
//! SSIM is that of Wang, Bovik, Sheikh and Simoncelli 2004 (Gaussian windows of sigma 1.5 px), with the choices of
//! scikit-image's `structural_similarity(a, b, channel_axis=2, gaussian_weights=True, sigma=1.5,
//! use_sample_covariance=False, data_range=255)`. Images are row-major, three bytes a pixel.

use gelsim_core::base::grid::{Grid, Rect};
use gelsim_core::base::simd;

/// Largest grey level.
const RANGE: f64 = 255.0;
const CHANNELS: usize = 3;
/// Reach of the Gaussian windows: 3.5 sigma, rounded.
const RADIUS: usize = 5;
const WINDOW: usize = 2 * RADIUS + 1;
/// SSIM's constants (K1 L)^2 and (K2 L)^2, which keep the quotients of flat areas finite.
const C1: f64 = (0.01 * RANGE) * (0.01 * RANGE);
const C2: f64 = (0.03 * RANGE) * (0.03 * RANGE);
/// Number of fields that are filtered: both images, the sum of their squares, their product.
const FIELDS: usize = 4;

/// Mean absolute difference over pixels and channels, grey levels (0 to 255); 0 for images without pixels.
///
/// # Panics
///
/// If the sizes differ.
pub fn mae(a: &[u8], b: &[u8]) -> f64 {
    assert_eq!(a.len(), b.len(), "images of two sizes");
    let sum: u64 = a.iter().zip(b).map(|(a, b)| u64::from(a.abs_diff(*b))).sum();
    sum as f64 / a.len().max(1) as f64
}

/// Peak signal-to-noise ratio, dB, for a range of 255 grey levels; None for identical images.
///
/// # Panics
///
/// If the sizes differ.
pub fn psnr_db(a: &[u8], b: &[u8]) -> Option<f64> {
    assert_eq!(a.len(), b.len(), "images of two sizes");
    let sum: u64 = a.iter().zip(b).map(|(a, b)| u64::from(a.abs_diff(*b)).pow(2)).sum();
    (sum > 0).then(|| 10.0 * libm::log10(RANGE * RANGE * a.len() as f64 / sum as f64))
}

/// Mean structural similarity, 1 for identical images.
///
/// The mean leaves out 5 pixels at every side, whose windows reach over the border; a side that is less than 11
/// pixels long (scikit-image refuses those) is used in full. 1 for images without pixels.
///
/// # Panics
///
/// If a size is not `width * height` pixels.
pub fn ssim(a: &[u8], b: &[u8], width: usize, height: usize) -> f64 {
    ssim_mean(&ssim_map(a, b, width, height))
}

/// Mean structural similarity as [`ssim`] has it, from the images' [`ssim_map`].
pub fn ssim_mean(map: &Grid<f64>) -> f64 {
    let span = |size: usize| if size >= WINDOW { (RADIUS, size - RADIUS) } else { (0, size) };
    let ((x0, x1), (y0, y1)) = (span(map.width), span(map.height));
    let counted = map.crop(Rect { x0, y0, x1, y1 }).data;
    if counted.is_empty() { 1.0 } else { counted.iter().sum::<f64>() / counted.len() as f64 }
}

/// The pixels of an RGB image under the non-zero pixels of `mask`, in order: what [`mae`] and [`psnr_db`] compare
/// over a region.
///
/// # Panics
///
/// If `image` is not of the mask's size.
pub fn masked_pixels(image: &[u8], mask: &Grid<u8>) -> Vec<u8> {
    assert_eq!(image.len(), mask.data.len() * CHANNELS, "image and mask of two sizes");
    image
        .chunks_exact(CHANNELS)
        .zip(&mask.data)
        .filter(|(_, mask)| **mask > 0)
        .flat_map(|(rgb, _)| rgb)
        .copied()
        .collect()
}

/// Mean of `map` over the non-zero pixels of `mask`: SSIM over a region, if `map` is an [`ssim_map`]. None without
/// any.
///
/// # Panics
///
/// If the sizes differ.
pub fn masked_mean(map: &Grid<f64>, mask: &Grid<u8>) -> Option<f64> {
    assert_eq!([map.width, map.height], [mask.width, mask.height], "map and mask of two sizes");
    let counted = map.data.iter().zip(&mask.data).filter(|(_, mask)| **mask > 0);
    let (sum, count) = counted.fold((0.0, 0u64), |(sum, count), (value, _)| (sum + value, count + 1));
    (count > 0).then(|| sum / count as f64)
}

/// Pixels in both of two masks over those in either. None without any.
///
/// # Panics
///
/// If the sizes differ.
pub fn mask_iou(a: &Grid<u8>, b: &Grid<u8>) -> Option<f64> {
    assert_eq!([a.width, a.height], [b.width, b.height], "masks of two sizes");
    let (mut both, mut either) = (0_u64, 0_u64);
    for (a, b) in a.data.iter().zip(&b.data) {
        both += u64::from((*a > 0) & (*b > 0));
        either += u64::from((*a > 0) | (*b > 0));
    }
    (either > 0).then(|| both as f64 / either as f64)
}

/// Structural similarity around every pixel, the mean of the three channels'. At the borders the images are
/// continued by their mirror images (the edge's pixels twice).
///
/// # Panics
///
/// If a size is not `width * height` pixels.
pub fn ssim_map(a: &[u8], b: &[u8], width: usize, height: usize) -> Grid<f64> {
    assert_eq!(a.len(), width * height * CHANNELS, "first image of another size");
    assert_eq!(b.len(), width * height * CHANNELS, "second image of another size");
    let mut map = Grid::new(width, height);
    if map.data.is_empty() {
        return map;
    }
    let weights = gaussian_weights();
    let samples = width * CHANNELS;
    let columns: Vec<usize> = (0..width + 2 * RADIUS).map(|x| mirror_index(x, width)).collect();
    let mut padded = SsimFields::new(columns.len() * CHANNELS);
    // Rows that are filtered along themselves. A window needs 11 neighbouring rows, mirrored ones included, so a row's
    // number modulo 11 finds its place.
    let mut ring: Vec<SsimFields> = (0..WINDOW).map(|_| SsimFields::new(samples)).collect();
    let mut means = SsimFields::new(samples);
    let mut done = 0;
    simd::simd_dispatch(
        #[inline(always)]
        || {
            for y in 0..height {
                while done < height.min(y + RADIUS + 1) {
                    let row = done * samples..(done + 1) * samples;
                    padded.fill_row(&a[row.clone()], &b[row], &columns);
                    ring[done % WINDOW].filter_along(&padded, &weights);
                    done += 1;
                }
                let rows: [&SsimFields; WINDOW] =
                    std::array::from_fn(|tap| &ring[mirror_index(y + tap, height) % WINDOW]);
                means.filter_across(&rows, &weights);
                means.write_ssim(map.row_mut(y));
            }
        },
    );
    map
}

/// One row of the four fields, channels interleaved.
struct SsimFields([Vec<f64>; FIELDS]);

impl SsimFields {
    fn new(samples: usize) -> Self {
        Self(std::array::from_fn(|_| vec![0.0; samples]))
    }

    /// Fills the fields from a row of both images, taken at `columns`.
    #[inline(always)]
    fn fill_row(&mut self, a: &[u8], b: &[u8], columns: &[usize]) {
        let [first, second, squares, product] = &mut self.0;
        for (at, column) in columns.iter().enumerate() {
            for channel in 0..CHANNELS {
                let (from, to) = (column * CHANNELS + channel, at * CHANNELS + channel);
                let (a, b) = (f64::from(a[from]), f64::from(b[from]));
                (first[to], second[to], squares[to], product[to]) = (a, b, a * a + b * b, a * b);
            }
        }
    }

    /// Computes weighted means along a row that is continued by [`RADIUS`] pixels at both ends.
    #[inline(always)]
    fn filter_along(&mut self, padded: &Self, weights: &[f64; RADIUS + 1]) {
        for (out, padded) in self.0.iter_mut().zip(&padded.0) {
            let taps: [&[f64]; WINDOW] = std::array::from_fn(|tap| &padded[tap * CHANNELS..][..out.len()]);
            add_weighted_rows(out, &taps, weights);
        }
    }

    /// Computes weighted means of rows, sample by sample.
    #[inline(always)]
    fn filter_across(&mut self, rows: &[&Self; WINDOW], weights: &[f64; RADIUS + 1]) {
        for (field, out) in self.0.iter_mut().enumerate() {
            let taps: [&[f64]; WINDOW] = std::array::from_fn(|tap| &rows[tap].0[field][..out.len()]);
            add_weighted_rows(out, &taps, weights);
        }
    }

    /// Writes the structural similarity of each pixel from the windows' means.
    #[inline(always)]
    fn write_ssim(&self, out: &mut [f64]) {
        let [first, second, squares, product] = &self.0;
        for (x, out) in out.iter_mut().enumerate() {
            let mut sum = 0.0;
            for i in x * CHANNELS..(x + 1) * CHANNELS {
                let (a, b) = (first[i], second[i]);
                let (means, mean_squares) = (a * b, a * a + b * b);
                let (covariance, variances) = (product[i] - means, squares[i] - mean_squares);
                sum += (2.0 * means + C1) * (2.0 * covariance + C2) / ((mean_squares + C1) * (variances + C2));
            }
            *out = sum / CHANNELS as f64;
        }
    }
}

/// Computes weighted means of eleven rows of samples: the outermost pair has the first weight, the middle row the last.
#[inline(always)]
fn add_weighted_rows(out: &mut [f64], taps: &[&[f64]; WINDOW], weights: &[f64; RADIUS + 1]) {
    for (i, out) in out.iter_mut().enumerate() {
        let mut sum = weights[RADIUS] * taps[RADIUS][i];
        for (pair, weight) in weights[..RADIUS].iter().enumerate() {
            sum += weight * (taps[pair][i] + taps[WINDOW - 1 - pair][i]);
        }
        *out = sum;
    }
}

/// Returns half of the window's weights, from its rim to its middle.
fn gaussian_weights() -> [f64; RADIUS + 1] {
    let weights: [f64; RADIUS + 1] = std::array::from_fn(|i| {
        let distance = (RADIUS - i) as f64 / 1.5;
        libm::exp(-0.5 * distance * distance)
    });
    let sum = 2.0 * weights.iter().sum::<f64>() - weights[RADIUS];
    weights.map(|weight| weight / sum)
}

/// Returns the pixel shown at `at - RADIUS` if `size` pixels are continued by mirror images at both edges.
#[inline(always)]
fn mirror_index(at: usize, size: usize) -> usize {
    let period = 2 * size;
    // Small images are mirrored more than once; the second term keeps the difference from going below 0.
    let folded = (at + period * RADIUS - RADIUS) % period;
    folded.min(period - 1 - folded)
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    /// Two images by formula; the Python one stands at [`EXPECTED`].
    fn pair(width: usize, height: usize) -> [Vec<u8>; 2] {
        let a = |x: usize, y: usize, c: usize| (x * 7 + y * 13 + c * 50 + (x * y) % 31) % 256;
        let b = |x: usize, y: usize, c: usize| (a(x, y, c) + (x * 5 + y * 3 + c * 11) % 41).saturating_sub(20).min(255);
        [image(width, height, a), image(width, height, b)]
    }

    fn smooth_pair(width: usize, height: usize) -> [Vec<u8>; 2] {
        let a = |x: usize, y: usize, c: usize| 40 + x * 150 / width + y * 60 / height + c;
        let b = |x: usize, y: usize, c: usize| a(x, y, c) + (x / 8 + y / 8) % 2 * 3;
        [image(width, height, a), image(width, height, b)]
    }

    fn image(width: usize, height: usize, level: impl Fn(usize, usize, usize) -> usize) -> Vec<u8> {
        let samples = (0..height).flat_map(|y| (0..width).flat_map(move |x| (0..3).map(move |c| (x, y, c))));
        samples.map(|(x, y, c)| level(x, y, c) as u8).collect()
    }

    type Pair = fn(usize, usize) -> [Vec<u8>; 2];

    /// (images, width, height, MAE, PSNR, SSIM) of scikit-image 0.26.0:
    ///
    /// ```python
    /// x, y, c = np.meshgrid(np.arange(w), np.arange(h), np.arange(3), indexing="xy")
    /// a = (x * 7 + y * 13 + c * 50 + (x * y) % 31) % 256                        # pair
    /// b = np.clip(a + (x * 5 + y * 3 + c * 11) % 41 - 20, 0, 255)
    /// a = 40 + (x * 150) // w + (y * 60) // h + c                               # smooth_pair
    /// b = a + (x // 8 + y // 8) % 2 * 3
    /// mae = np.abs(a.astype(float) - b).mean()
    /// a, b = a.astype(np.uint8), b.astype(np.uint8)
    /// psnr = peak_signal_noise_ratio(a, b, data_range=255)
    /// ssim = structural_similarity(a, b, channel_axis=2, gaussian_weights=True, sigma=1.5,
    ///                              use_sample_covariance=False, data_range=255)
    /// ```
    const EXPECTED: [(Pair, usize, usize, f64, f64, f64); 8] = [
        (pair, 48, 32, 9.94704861, 26.86145805, 0.93643948),
        (pair, 11, 11, 9.89531680, 26.91456315, 0.90561915),
        (pair, 33, 12, 9.92592593, 26.88492711, 0.94924081),
        (pair, 97, 61, 9.94479184, 26.85978119, 0.93547607),
        (smooth_pair, 48, 32, 1.50000000, 41.59867847, 0.98702950),
        (smooth_pair, 11, 11, 1.19008264, 42.60381984, 0.99932810),
        (smooth_pair, 33, 12, 1.48484848, 41.64276966, 0.99461566),
        (smooth_pair, 97, 61, 1.49923948, 41.60088096, 0.98012105),
    ];

    #[test]
    fn all_three_agree_with_scikit_image() {
        for (images, width, height, expected_mae, expected_psnr, expected_ssim) in EXPECTED {
            let [a, b] = images(width, height);
            let found = [mae(&a, &b), psnr_db(&a, &b).unwrap(), ssim(&a, &b, width, height)];
            for (found, expected) in found.iter().zip([expected_mae, expected_psnr, expected_ssim]) {
                assert!((found - expected).abs() < 1e-7, "{width} x {height}: {found} instead of {expected}");
            }
        }
    }

    #[test]
    fn the_map_agrees_with_scikit_image_up_to_the_corners() {
        // With full=True, the second result at [y, x], its mean over the channels.
        let [a, b] = pair(48, 32);
        let map = ssim_map(&a, &b, 48, 32);
        for (x, y, expected) in [(0, 0, 0.89568694), (47, 0, 0.87531189), (3, 30, 0.92324370), (20, 15, 0.90664075)] {
            assert!((map.at(x, y) - expected).abs() < 1e-7, "({x}, {y}): {} instead of {expected}", map.at(x, y));
        }
    }

    #[test]
    fn identical_images_are_as_near_as_can_be() {
        let [a, _] = pair(20, 13);
        assert_eq!((mae(&a, &a), psnr_db(&a, &a)), (0.0, None));
        assert!((ssim(&a, &a, 20, 13) - 1.0).abs() < 1e-12);
        assert_eq!((mae(&[], &[]), psnr_db(&[], &[]), ssim(&[], &[], 0, 7)), (0.0, None, 1.0));
    }

    #[test]
    fn a_mask_leaves_out_what_is_not_under_it() {
        let [a, mut b] = pair(20, 13);
        let mut mask = Grid::new(20, 13);
        mask.row_mut(4)[6..9].fill(255);
        b.copy_from_slice(&a);
        b[(4 * 20 + 8) * 3] ^= 1;
        b[0] ^= 255;
        assert_eq!(mae(&masked_pixels(&a, &mask), &masked_pixels(&b, &mask)), 1.0 / 9.0);
        let mut map = Grid::new(20, 13);
        map.row_mut(4)[5..9].copy_from_slice(&[8.0, 1.0, 2.0, 6.0]);
        assert_eq!(masked_mean(&map, &mask), Some(3.0));
        assert_eq!(masked_mean(&map, &Grid::new(20, 13)), None);
    }

    proptest! {
        #[test]
        fn images_of_any_size_have_a_similarity_of_at_most_one(
            width in 1usize..16,
            height in 1usize..16,
            noise in prop::collection::vec(any::<u8>(), 2 * 15 * 15 * 3),
        ) {
            let (a, b) = noise.split_at(15 * 15 * 3);
            let (a, b) = (&a[..width * height * 3], &b[..width * height * 3]);
            let map = ssim_map(a, b, width, height);
            prop_assert!(map.data.iter().all(|s| (-1.0..=1.0 + 1e-9).contains(s)));
            prop_assert!((ssim(a, b, width, height) - ssim(b, a, width, height)).abs() < 1e-12);
        }

        /// Plain reference implementation: every window summed on its own, in two dimensions, mirrored by walking.
        #[test]
        fn the_map_agrees_with_plain_windows(
            width in 1usize..9,
            height in 1usize..14,
            noise in prop::collection::vec(any::<u8>(), 2 * 8 * 13 * 3),
        ) {
            let (a, b) = noise.split_at(8 * 13 * 3);
            let map = ssim_map(&a[..width * height * 3], &b[..width * height * 3], width, height);
            let walk = |at: usize, by: i32, size: usize| {
                let (mut at, mut step) = (at, by.signum());
                for _ in 0..by.abs() {
                    match at as i32 + step {
                        next if (0..size as i32).contains(&next) => at = next as usize,
                        _ => step = -step,
                    }
                }
                at
            };
            for (i, found) in map.data.iter().enumerate() {
                let mut expected = 0.0;
                for channel in 0..3 {
                    let (mut weights, mut sums) = (0.0, [0.0; 5]);
                    for (dx, dy) in (-5..=5).flat_map(|dy| (-5..=5).map(move |dx| (dx, dy))) {
                        let from = walk(i / width, dy, height) * width + walk(i % width, dx, width);
                        let (a, b) = (f64::from(a[from * 3 + channel]), f64::from(b[from * 3 + channel]));
                        let weight = (-f64::from(dx * dx + dy * dy) / 4.5).exp();
                        weights += weight;
                        for (sum, value) in sums.iter_mut().zip([a, b, a * a, b * b, a * b]) {
                            *sum += weight * value;
                        }
                    }
                    let [a, b, aa, bb, ab] = sums.map(|sum| sum / weights);
                    let (va, vb, cov) = (aa - a * a, bb - b * b, ab - a * b);
                    expected += (2.0 * a * b + 6.5025) * (2.0 * cov + 58.5225)
                        / ((a * a + b * b + 6.5025) * (va + vb + 58.5225)) / 3.0;
                }
                prop_assert!((found - expected).abs() < 1e-9, "{i}: {found} {expected}");
            }
        }
    }
}
