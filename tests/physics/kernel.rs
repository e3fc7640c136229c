//! The displacement around one pressed pixel against its definition, integrated in other ways than the code does.

use std::f64::consts::{PI, TAU};

use gelsim_core::gelpad::elastic::kernel::layer_kernel;
use gelsim_core::gelpad::elastic::layer::ElasticLayer;

use gelsim_oracle::pressed_pixel::pressed_pixel;

/// The same on the grid's frequencies only, summed over a torus of `size` px, each weighted by the pixel's share in it.
fn pressed_pixel_on_grid(layer: ElasticLayer, pitch: [f64; 2], lag: [usize; 2], size: usize) -> f64 {
    let frequency = |k: usize, n: usize| {
        let n = if 2 * n > size { n as f64 - size as f64 } else { n as f64 };
        TAU * n / (size as f64 * pitch[k])
    };
    let sinc = |angle: f64| if angle == 0.0 { 1.0 } else { angle.sin() / angle };
    let mut sum = 0.0;
    for n in 0..size {
        for m in 0..size {
            let (qx, qy) = (frequency(0, m), frequency(1, n));
            let share = sinc(qx * pitch[0] / 2.0) * sinc(qy * pitch[1] / 2.0);
            let phase = TAU * ((m * lag[0] + n * lag[1]) % size) as f64 / size as f64;
            sum += layer.normal_compliance(qx.hypot(qy)) * share * phase.cos();
        }
    }
    sum / (size * size) as f64
}

const RATIOS: [f64; 4] = [0.0, 0.3, 0.48, 0.4999];

#[test]
fn the_oracle_knows_the_half_space() {
    // Love's value at the middle of a square of side a on a half-space: 4 asinh(1) a (1 - nu^2) / (pi E).
    let layer = ElasticLayer { thickness_mm: 1e7, poisson_ratio: 0.3 };
    let expected = 4.0 * 1.0_f64.asinh() * 0.2 * (1.0 - 0.09) / PI;
    let found = pressed_pixel(layer, [0.2, 0.2], 0.0, 0.0);
    // The base takes away some side / thickness of it.
    assert!((found / expected - 1.0).abs() < 1e-6, "{found} {expected}");
}

#[test]
fn the_kernel_is_the_displacement_around_a_pressed_pixel() {
    let mut worst = 0.0_f64;
    for nu in RATIOS {
        for (h, pitch) in [
            (3.0, [0.03125, 0.03125]),
            (3.0, [0.125, 0.125]),
            (3.0, [0.2, 0.05]),
            (0.4, [0.125, 0.125]),
            (0.3, [0.1, 0.15]),
            (100.0, [0.1, 0.1]),
            (1000.0, [0.01, 0.02]),
        ] {
            let layer = ElasticLayer { thickness_mm: h, poisson_ratio: nu };
            let reach = 9.0 * h;
            let kernel = layer_kernel(layer, pitch, reach, [300, 200]);
            let middle = f64::from(kernel.at(0, 0));
            for lag in
                [[0, 0], [1, 0], [0, 1], [1, 1], [2, 5], [7, 3], [20, 0], [28, 29], [61, 2], [0, 180], [299, 199]]
            {
                let at = [lag[0] as f64 * pitch[0], lag[1] as f64 * pitch[1]];
                // From 6.3 thicknesses on the kernel also stands for its tail, which is cut off at 9.
                if lag[0] >= kernel.width || lag[1] >= kernel.height || at[0].hypot(at[1]) > 6.3 * h {
                    continue;
                }
                let expected = pressed_pixel(layer, pitch, at[0], at[1]);
                let error = (f64::from(kernel.at(lag[0], lag[1])) - expected).abs() / middle;
                worst = worst.max(error);
                // 2^-24 of rounding, and as much for tabulated curves and for means over a pixel.
                assert!(
                    error < 3e-7,
                    "nu {nu}, h {h}, {pitch:?}, lag {lag:?}: {expected} is off by {error} of {middle}"
                );
            }
        }
    }
    println!("kernel: worst error in space {worst:.2e} of the middle");
}

#[test]
fn far_away_on_a_thick_pad_the_kernel_keeps_its_digits() {
    let layer = ElasticLayer { thickness_mm: 1e5, poisson_ratio: 0.3 };
    for pitch in [[0.1, 0.1], [0.1, 0.3]] {
        let kernel = layer_kernel(layer, pitch, 1e5, [400, 400]);
        for lag in [[20, 0], [0, 28], [19, 21], [29, 0], [0, 63], [100, 3], [64, 90], [399, 399]] {
            let expected = pressed_pixel(layer, pitch, lag[0] as f64 * pitch[0], lag[1] as f64 * pitch[1]);
            let error = f64::from(kernel.at(lag[0], lag[1])) / expected - 1.0;
            // 2^-24, and what is left of the fourth order in pixel / distance where the closed form ends.
            assert!(error.abs() < 3e-7, "{pitch:?}, lag {lag:?}: {expected} is off by {error}");
        }
    }
}

#[test]
fn where_pixels_are_coarse_the_kernel_is_the_sum_over_the_grids_frequencies() {
    let mut worst = 0.0_f64;
    for nu in RATIOS {
        for (h, pitch) in [(3.0, [2.0, 2.0]), (0.05, [0.03125, 0.03125]), (0.05, [0.02, 0.05]), (1.0, [10.0, 10.0])] {
            let layer = ElasticLayer { thickness_mm: h, poisson_ratio: nu };
            let kernel = layer_kernel(layer, pitch, 9.0 * h, [300, 200]);
            let size = 128;
            let middle = f64::from(kernel.at(0, 0));
            for lag in [[0, 0], [1, 0], [0, 1], [2, 1], [3, 3], [0, 4], [8, 0]] {
                let at = (lag[0] as f64 * pitch[0]).hypot(lag[1] as f64 * pitch[1]);
                if lag[0] >= kernel.width || lag[1] >= kernel.height || at > 7.2 * h {
                    continue;
                }
                let expected = pressed_pixel_on_grid(layer, pitch, lag, size);
                let error = (f64::from(kernel.at(lag[0], lag[1])) - expected).abs() / middle;
                worst = worst.max(error);
                // The grid's highest frequency is a sharp end, whose echoes fall like 1 / lag^2 and go round the torus.
                let bound = if pitch[0] > 5.0 * h { 2e-3 } else { 2e-4 };
                assert!(error < bound, "nu {nu}, h {h}, {pitch:?}, lag {lag:?}: {expected} is off by {error}");
            }
        }
    }
    println!("kernel: worst error of sums over frequencies {worst:.2e} of the middle");
}

#[test]
fn all_lags_together_give_as_a_wide_plate_does() {
    for nu in RATIOS {
        for (h, pitch) in [(3.0, [0.125, 0.125]), (3.0, [0.2, 0.1]), (0.3, [0.125, 0.125]), (0.05, [0.03125, 0.0625])] {
            let layer = ElasticLayer { thickness_mm: h, poisson_ratio: nu };
            let kernel = layer_kernel(layer, pitch, 9.0 * h, [4000, 4000]);
            let (mut sum, mut size) = (0.0, 0.0);
            for y in 0..kernel.height {
                for x in 0..kernel.width {
                    let count = [1.0, 2.0][usize::from(x > 0)] * [1.0, 2.0][usize::from(y > 0)];
                    sum += count * f64::from(kernel.at(x, y));
                    size += count * f64::from(kernel.at(x, y)).abs();
                }
            }
            let error = (sum - layer.normal_compliance(0.0)) / size;
            // Where pixels are coarse, the tail that is cut off is missing.
            let bound = if pitch[1] > 0.5 * h { 6e-3 } else { 3e-5 };
            assert!(error.abs() < bound, "nu {nu}, h {h}, {pitch:?}: {sum} is off by {error} of {size}");
        }
    }
}

#[test]
fn a_kernel_ends_where_its_reach_does_and_fits_the_window() {
    let layer = ElasticLayer { thickness_mm: 3.0, poisson_ratio: 0.4999 };
    let kernel_to = |reach, most| layer_kernel(layer, [0.25, 0.5], reach, most);
    let cut = kernel_to(12.0, [1000, 1000]);
    assert_eq!([cut.width, cut.height], [49, 25]);
    let whole = kernel_to(27.0, [1000, 1000]);
    for y in 0..cut.height {
        for x in 0..cut.width {
            let away = (x as f64 * 0.25).hypot(y as f64 * 0.5);
            if away > 12.0 {
                assert_eq!(cut.at(x, y), 0.0);
            } else if away < 0.69 * 12.0 {
                assert_eq!(cut.at(x, y), whole.at(x, y), "at {x}, {y}");
            }
        }
    }
    let small = kernel_to(12.0, [7, 3]);
    assert_eq!([small.width, small.height], [7, 3]);
    assert!((0..3).all(|y| small.row(y) == &cut.row(y)[..7]));
}
