//! Power of an image in octaves of spatial frequency: how coarse or fine its structure is.
//!
//! The periodogram of the grey image (mean of the channels, less its weighted mean) under a Hann window (Welch 1967),
//! divided by the window's power, so that it does not depend on the image's size. Valid for frequencies that the image
//! holds at least once.

use std::f64::consts::TAU;

use image::{Rgb, RgbImage};
use pulp::Simd;

use gelsim_core::base::grid::Grid;
use gelsim_core::base::simd::{TwoWidthKernel, Vectors, dispatch_two_widths};
use gelsim_core::gelpad::elastic::fft::{Fft, LANES, Signals, fast_length};

/// Number of octaves of frequency, the finest one first.
pub const OCTAVES: usize = 6;

/// Lower and upper frequency of an octave, cycles per pixel. The first one is 0.25 to 0.5. Finer structure, which only
/// diagonals can have, is in none.
pub fn octave_bounds(number: usize) -> [f64; 2] {
    let upper = 0.5 / (1_u64 << number) as f64;
    [0.5 * upper, upper]
}

/// Mean power density in each octave, grey levels^2 per (cycle/px)^2: white noise of standard deviation s has s^2 in
/// all. None where the shorter side holds no cycle of the octave.
pub fn octave_powers(image: &RgbImage) -> [Option<f64>; OCTAVES] {
    let (width, height) = (image.width() as usize, image.height() as usize);
    let (windowed, window_power) = apply_window(image);
    let power = power_spectrum(windowed);
    let (mut sums, mut counts) = ([0.0; OCTAVES], [0_u64; OCTAVES]);
    for y in 0..power.height {
        let fy = bin_frequency(y, power.height);
        for (x, value) in power.row(y).iter().enumerate() {
            let fx = bin_frequency(x, power.width);
            if let Some(number) = octave_of_square(fx * fx + fy * fy) {
                sums[number] += f64::from(*value);
                counts[number] += 1;
            }
        }
    }
    std::array::from_fn(|number| {
        let held = octave_bounds(number)[0] * width.min(height) as f64 >= 1.0 && counts[number] > 0;
        held.then(|| sums[number] / (counts[number] as f64 * window_power))
    })
}

/// Frequency of value number `k` of `length`, cycles per pixel.
fn bin_frequency(k: usize, length: usize) -> f64 {
    k.min(length - k) as f64 / length as f64
}

/// Octave of a squared frequency; None outside all octaves.
fn octave_of_square(square: f64) -> Option<usize> {
    (0..OCTAVES).find(|number| {
        let [lower, upper] = octave_bounds(*number);
        square <= upper * upper && (square > lower * lower)
    })
}

/// Returns the image times its window, padded with zeros to lengths that the transform takes; and the sum of the
/// window's squares.
fn apply_window(image: &RgbImage) -> (Grid<f32>, f64) {
    let (width, height) = (image.width() as usize, image.height() as usize);
    let hann = |length: usize| -> Vec<f64> {
        (0..length).map(|k| 0.5 - 0.5 * libm::cos(TAU * (k as f64 + 0.5) / length as f64)).collect()
    };
    let (across, down) = (hann(width), hann(height));
    let greys: Vec<f64> = image.pixels().map(|Rgb(rgb)| rgb.iter().map(|v| f64::from(*v)).sum::<f64>() / 3.0).collect();
    let (mut weights, mut squares, mut sum) = (0.0, 0.0, 0.0);
    for (y, down) in down.iter().enumerate() {
        for (x, across) in across.iter().enumerate() {
            let weight = across * down;
            weights += weight;
            squares += weight * weight;
            sum += weight * greys[y * width + x];
        }
    }
    let mean = sum / weights;
    let mut result = Grid::new(fast_length(width), fast_length(height));
    for (y, down) in down.iter().enumerate() {
        let greys = &greys[y * width..][..width];
        for ((value, grey), across) in result.row_mut(y).iter_mut().zip(greys).zip(&across) {
            *value = (across * down * (grey - mean)) as f32;
        }
    }
    (result, squares)
}

/// Computes the squared magnitudes of an image's frequencies.
fn power_spectrum(image: Grid<f32>) -> Grid<f32> {
    let zeros = Grid::new(image.width, image.height);
    let [re, im] = transform_rows(transform_rows([image, zeros]));
    let square = |(re, im): (&f32, &f32)| re * re + im * im;
    Grid { width: re.width, height: re.height, data: re.data.iter().zip(&im.data).map(square).collect() }
}

/// Transforms every row of a complex image and exchanges rows with columns: applied twice, it transforms both axes.
/// Width and height must be fast lengths.
fn transform_rows(image: [Grid<f32>; 2]) -> [Grid<f32>; 2] {
    let (width, height) = (image[0].width, image[0].height);
    let mut turned = [Grid::new(height, width), Grid::new(height, width)];
    dispatch_two_widths(RowTransform { fft: Fft::new(width), image: &image, transposed: &mut turned });
    turned
}

struct RowTransform<'a> {
    fft: Fft,
    image: &'a [Grid<f32>; 2],
    transposed: &'a mut [Grid<f32>; 2],
}

impl TwoWidthKernel for RowTransform<'_> {
    type Output = ();

    #[inline(always)]
    fn run<S: Simd, W: Simd>(self, vectors: Vectors<S, W>) {
        let Self { fft, image: [re, im], transposed: turned } = self;
        let mut line = Signals::default();
        line.resize(re.width);
        // Rows that the transform takes at once are interleaved: one row per lane.
        for y in (0..re.height).step_by(LANES) {
            for x in 0..re.width {
                for lane in 0..LANES {
                    line.re[x * LANES + lane] = re.at(x, y + lane);
                    line.im[x * LANES + lane] = im.at(x, y + lane);
                }
            }
            fft.forward(vectors, &mut line.re, &mut line.im);
            for (turned, line) in turned.iter_mut().zip([&line.re, &line.im]) {
                for x in 0..re.width {
                    turned.row_mut(x)[y..y + LANES].copy_from_slice(&line[fft.frequency_index(x) * LANES..][..LANES]);
                }
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use rand::{RngExt, SeedableRng};
    use rand_chacha::ChaCha8Rng;

    use super::*;

    /// Plain reference implementation: every frequency of the padded image summed on its own.
    fn plain(image: &RgbImage) -> [Option<f64>; OCTAVES] {
        let (windowed, window_power) = apply_window(image);
        let (width, height) = (windowed.width, windowed.height);
        let (mut sums, mut counts) = ([0.0; OCTAVES], [0_u64; OCTAVES]);
        for (k, l) in (0..height).flat_map(|l| (0..width).map(move |k| (k, l))) {
            let (mut re, mut im) = (0.0, 0.0);
            for (at, value) in windowed.data.iter().enumerate() {
                let turns = (at % width * k) as f64 / width as f64 + (at / width * l) as f64 / height as f64;
                re += f64::from(*value) * (TAU * turns).cos();
                im -= f64::from(*value) * (TAU * turns).sin();
            }
            let fold = |k: usize, length: usize| if 2 * k > length { k as f64 - length as f64 } else { k as f64 };
            let f = (fold(k, width) / width as f64).hypot(fold(l, height) / height as f64);
            // Octave 0 is 0.25 to 0.5.
            let number = (0.5 / f).log2().floor();
            if (0.0..OCTAVES as f64).contains(&number) {
                sums[number as usize] += re * re + im * im;
                counts[number as usize] += 1;
            }
        }
        std::array::from_fn(|number| {
            let held = octave_bounds(number)[0] * f64::from(image.width().min(image.height())) >= 1.0;
            held.then(|| sums[number] / (counts[number] as f64 * window_power))
        })
    }

    fn noise(width: u32, height: u32, most: i32) -> RgbImage {
        let mut rng = ChaCha8Rng::seed_from_u64(7);
        RgbImage::from_fn(width, height, |_, _| Rgb([(128 + rng.random_range(-most..=most)) as u8; 3]))
    }

    #[test]
    fn octaves_agree_with_plain_sums() {
        // 37 px are padded to 48, 18 px to 32.
        let image = noise(37, 18, 60);
        let (found, expected) = (octave_powers(&image), plain(&image));
        for (found, expected) in found.iter().zip(expected) {
            match (found, expected) {
                (None, None) => {}
                (Some(found), Some(expected)) => assert!((found / expected - 1.0).abs() < 1e-4, "{found} {expected}"),
                other => panic!("{other:?}"),
            }
        }
        assert_eq!(found.iter().flatten().count(), 3, "{found:?}");
    }

    #[test]
    fn white_noise_has_its_variance_in_every_octave_whatever_the_size() {
        for (width, height) in [(320, 240), (150, 401)] {
            let variance = (21.0 * 21.0 - 1.0) / 12.0;
            for (number, power) in octave_powers(&noise(width, height, 10)).into_iter().enumerate() {
                // The coarsest octaves hold a few hundred frequencies.
                let power = power.expect("large enough");
                let bearable = 0.02 * f64::from(1 << number);
                assert!((power / variance - 1.0).abs() < bearable, "{number}: {power} {variance}");
            }
        }
    }

    #[test]
    fn waves_are_found_in_their_octave_and_flat_images_have_no_power() {
        for (number, period) in [(0, 3.0), (1, 6.0), (2, 12.0), (3, 23.0), (4, 48.0)] {
            let wave = |x: u32, y: u32| (TAU * (0.8 * f64::from(x) + 0.6 * f64::from(y)) / period).sin();
            let image = RgbImage::from_fn(200, 170, |x, y| Rgb([(128.0 + 90.0 * wave(x, y)).round() as u8; 3]));
            let powers = octave_powers(&image).map(Option::unwrap_or_default);
            let most = powers.iter().copied().fold(0.0, f64::max);
            assert_eq!(powers[number], most, "{powers:?}");
            // The window smears the longest wave a little.
            assert!(powers.iter().enumerate().all(|(k, power)| k == number || *power < 0.1 * most), "{powers:?}");
        }
        let flat = octave_powers(&RgbImage::from_pixel(300, 300, Rgb([90, 100, 110])));
        assert!(flat.iter().all(|power| power.is_some_and(|power| power < 1e-6)), "{flat:?}");
        assert_eq!(octave_powers(&RgbImage::new(1, 1)), [None; OCTAVES]);
        assert_eq!(octave_powers(&RgbImage::new(0, 0)), [None; OCTAVES]);
    }
}
