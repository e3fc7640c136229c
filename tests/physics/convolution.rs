//! Fourier transforms and convolutions against plain ones in f64 and against sums written out.

use std::f64::consts::TAU;

use gelsim_core::base::grid::Grid;
use gelsim_core::base::simd::{self, TwoWidthKernel, VectorWidth, Vectors};
use gelsim_core::gelpad::elastic::convolve::{
    ConvolutionBuffers, ConvolutionShape, FftPlans, KernelSpectrum, TorusConvolution,
};
use gelsim_core::gelpad::elastic::fft::{Fft, LANES, Signals, fast_length};
use nalgebra::Complex;
use pulp::{Arch, Scalar, Simd};

use gelsim_oracle::fourier::Fourier;
use gelsim_oracle::shapes::Random;

/// A transform, or its way back, with vectors to be chosen.
struct Run<'a> {
    fft: &'a Fft,
    signals: &'a mut Signals,
    forward: bool,
}

impl TwoWidthKernel for Run<'_> {
    type Output = ();

    #[inline(always)]
    fn run<S: Simd, W: Simd>(self, vectors: Vectors<S, W>) {
        let Signals { re, im } = self.signals;
        if self.forward { self.fft.forward(vectors, re, im) } else { self.fft.inverse(vectors, re, im) }
    }
}

fn noise(len: usize, random: &mut Random) -> Signals {
    let mut signals = Signals::default();
    signals.resize(len);
    for value in signals.re.iter_mut().chain(&mut signals.im) {
        *value = random.within(-1.0, 1.0) as f32;
    }
    signals
}

/// The transform of one of the eight signals in f64.
fn transformed(plain: &Fourier, signals: &Signals, lane: usize) -> Vec<Complex<f64>> {
    let values = signals.re.iter().zip(&signals.im).skip(lane).step_by(LANES);
    let mut values: Vec<Complex<f64>> = values.map(|(re, im)| Complex::new((*re).into(), (*im).into())).collect();
    plain.run(&mut values);
    values
}

/// Every length that the code chooses up to 2048, and some that only the transform itself allows.
fn lengths() -> Vec<usize> {
    let chosen = std::iter::successors(Some(fast_length(1)), |length| Some(fast_length(length + 1)));
    [1, 2, 3, 4, 5, 6, 9, 10, 15, 25, 27, 30, 81, 125, 375]
        .into_iter()
        .chain(chosen.take_while(|length| *length <= 2048))
        .collect()
}

#[test]
fn chosen_lengths_are_the_next_smooth_multiples_of_16() {
    let smooth = |n: usize| [2, 3, 5].iter().fold(n, |n, p| (0..20).fold(n, |n, _| if n % p == 0 { n / p } else { n }));
    for n in 0..3000 {
        let plain = (n.max(1)..).find(|length| length % 16 == 0 && smooth(*length) == 1);
        assert_eq!(Some(fast_length(n)), plain);
    }
}

#[test]
fn transforms_agree_with_plain_ones_in_f64_at_every_length() {
    let mut random = Random(1);
    let mut worst = 0.0_f64;
    for len in lengths() {
        let (fft, plain) = (Fft::new(len), Fourier::new(len, false));
        let before = noise(len, &mut random);
        let mut signals = before.clone();
        simd::dispatch_two_widths(Run { fft: &fft, signals: &mut signals, forward: true });
        // Rounding adds up like a random walk over the stages; the root of the length is the size of a spectrum of noise.
        let bound = 4.0 * f64::from(f32::EPSILON) * (len as f64).sqrt();
        let mut places: Vec<usize> = (0..len).map(|k| fft.frequency_index(k)).collect();
        for lane in 0..LANES {
            for (k, expected) in transformed(&plain, &before, lane).into_iter().enumerate() {
                let at = places[k] * LANES + lane;
                let error = (Complex::<f64>::new(signals.re[at].into(), signals.im[at].into()) - expected).norm();
                assert!(error < bound, "length {len}, frequency {k}, signal {lane}: {error}");
                worst = worst.max(error / (len as f64).sqrt());
            }
        }
        simd::dispatch_two_widths(Run { fft: &fft, signals: &mut signals, forward: false });
        for (found, value) in signals.re.iter().zip(&before.re).chain(signals.im.iter().zip(&before.im)) {
            let error = f64::from(found / len as f32 - value).abs();
            assert!(error < 2e-6, "length {len}: there and back is off by {error}");
        }
        places.sort_unstable();
        assert!(places.into_iter().eq(0..len), "length {len}: every frequency has a place of its own");
    }
    println!("fft: worst error of a transform of noise over the root of its length: {worst:.2e}");
}

#[test]
fn vectors_of_sixteen_eight_and_one_give_the_same_bits() {
    assert!(!matches!(Arch::new(), Arch::Scalar), "this machine has no wide vectors to compare with");
    let bits = |signals: &Signals| signals.re.iter().chain(&signals.im).map(|v| v.to_bits()).collect::<Vec<_>>();
    let mut random = Random(2);
    for len in lengths() {
        let fft = Fft::new(len);
        let mut wide = noise(len, &mut random);
        let (mut eight, mut narrow) = (wide.clone(), wide.clone());
        for forward in [true, false] {
            simd::dispatch_two_widths(Run { fft: &fft, signals: &mut wide, forward });
            simd::with_width_limit(VectorWidth::Eight, || {
                simd::dispatch_two_widths(Run { fft: &fft, signals: &mut eight, forward })
            });
            Run { fft: &fft, signals: &mut narrow, forward }.run(Vectors { eight: Scalar, widest: Scalar });
            assert!(bits(&wide) == bits(&narrow), "length {len}, forward {forward}");
            assert!(bits(&eight) == bits(&narrow), "length {len}, forward {forward}, by AVX2");
        }
    }
}

fn image(width: usize, height: usize, random: &mut Random) -> Grid<f32> {
    let mut grid = Grid::new(width, height);
    grid.data.iter_mut().for_each(|value| *value = random.within(-1.0, 1.0) as f32);
    grid
}

/// `kernel * source` at one pixel of the target.
fn sum_at(kernel: &Grid<f32>, source: &Grid<f32>, offset: [usize; 2], x: usize, y: usize) -> f64 {
    let mut sum = 0.0;
    for v in 0..source.height {
        let lag_y = (v + offset[1]).abs_diff(y);
        for u in 0..source.width {
            let lag_x = (u + offset[0]).abs_diff(x);
            if lag_x < kernel.width && lag_y < kernel.height {
                sum += f64::from(kernel.at(lag_x, lag_y)) * f64::from(source.at(u, v));
            }
        }
    }
    sum
}

/// Convolves noise with noise and compares `checks` pixels, all if there are fewer.
fn check(shape: ConvolutionShape, kernel: [usize; 2], checks: usize, random: &mut Random) {
    let ConvolutionShape { source: [width, height], offset, target } = shape;
    let (kernel, source) = (image(kernel[0], kernel[1], random), image(width, height, random));
    let lengths = FftPlans::new(2 * target[0].max(target[1]));
    let torus = TorusConvolution::new(&lengths, shape, [kernel.width, kernel.height], 0);
    let (mut buffers, mut spectrum) = (ConvolutionBuffers::default(), KernelSpectrum::default());
    let mut run = || {
        let mut found = Grid::default();
        torus.set_spectrum(&kernel, &mut buffers, &mut spectrum);
        torus.convolve(&spectrum, &source, &mut found, &mut buffers);
        found
    };
    let found = run();
    let narrow = simd::scalar_only(&mut run);
    let bits = |grid: &Grid<f32>| grid.data.iter().map(|value| value.to_bits()).collect::<Vec<_>>();
    assert!(bits(&found) == bits(&narrow), "{shape:?}: wide vectors change bits");
    assert_eq!([found.width, found.height], target);
    // Rounding by 2^-24 in each of some ten stages is spread over the torus: no pixel is off by more than a few times
    // that of the largest sum there could be, the product of both root sums of squares.
    let norm = |grid: &Grid<f32>| grid.data.iter().map(|v| f64::from(v * v)).sum::<f64>().sqrt();
    let bound = 2.0_f64.powi(-22) * 2.0 * norm(&kernel) * norm(&source);
    let count = target[0] * target[1];
    for check in 0..count.min(checks) {
        // Corners first.
        let at = match check {
            0 => 0,
            1 => target[0] - 1,
            2 => count - target[0],
            3 => count - 1,
            _ if count <= checks => check,
            _ => random.below(count),
        };
        let (x, y) = (at % target[0], at / target[0]);
        let sum = sum_at(&kernel, &source, offset, x, y);
        let error = (f64::from(found.at(x, y)) - sum).abs();
        assert!(
            error < bound,
            "{shape:?}, kernel {} x {}, at {x}, {y}: {sum} is off by {error}, {bound}",
            kernel.width,
            kernel.height
        );
    }
}

#[test]
fn convolutions_of_any_shape_agree_with_sums_written_out() {
    let mut random = Random(3);
    for round in 0..250 {
        let mut shape = ConvolutionShape { source: [1; 2], offset: [0; 2], target: [1; 2] };
        let mut kernel = [1; 2];
        for (k, reach) in kernel.iter_mut().enumerate() {
            shape.target[k] = 1 + random.below(40);
            shape.source[k] = 1 + random.below(shape.target[k]);
            // Against the first border, the last, or anywhere.
            let room = shape.target[k] - shape.source[k];
            shape.offset[k] = [0, room, random.below(room + 1)][round % 3];
            // A kernel that ends within the target, or reaches beyond it; never more than a pad's, which is its window.
            *reach = 1 + random.below(if round % 2 == 0 { shape.target[k] } else { 60 });
        }
        check(shape, kernel, usize::MAX, &mut random);
    }
}

#[test]
fn large_convolutions_agree_with_sums_written_out() {
    let mut random = Random(4);
    // Pieces of the window of a camera: a contact in the middle, against both borders, one pixel, one line, all.
    for (source, offset, target) in [
        ([151, 149], [240, 170], [642, 482]),
        ([97, 33], [0, 449], [642, 482]),
        ([33, 97], [609, 0], [642, 482]),
        ([1, 1], [640, 3], [641, 17]),
        ([900, 3], [24, 0], [930, 5]),
        ([487, 367], [0, 0], [487, 367]),
    ] {
        let kernel = [random.below(target[0]) + 1, random.below(target[1]) + 1];
        for kernel in [kernel, target] {
            check(ConvolutionShape { source, offset, target }, kernel, 60, &mut random);
        }
    }
}

#[test]
fn the_roughly_inverse_spectrum_undoes_a_convolution_but_for_its_cutoff() {
    // A response without small values is undone exactly where nothing is cut off.
    let kernel = Grid { width: 2, height: 1, data: vec![1.0, 0.2] };
    let lengths = FftPlans::new(96);
    let shape = ConvolutionShape { source: [48, 40], offset: [0; 2], target: [48, 40] };
    let torus = TorusConvolution::new(&lengths, shape, [48, 40], 0);
    let (mut buffers, mut spectrum, mut inverse) =
        (ConvolutionBuffers::default(), KernelSpectrum::default(), KernelSpectrum::default());
    torus.set_spectrum(&kernel, &mut buffers, &mut spectrum);
    inverse.clone_from(&spectrum);
    torus.invert_spectrum(&mut inverse, [0.1, 0.1], 0.0, 1.0, 1.4);
    let mut source = Grid::new(48, 40);
    source.row_mut(20)[24] = 1.0;
    let (mut there, mut back) = (Grid::default(), Grid::default());
    torus.convolve(&spectrum, &source, &mut there, &mut buffers);
    torus.convolve(&inverse, &there, &mut back, &mut buffers);
    for (found, value) in back.data.iter().zip(&source.data) {
        assert!((found - value).abs() < 1e-6, "{found} instead of {value}");
    }
    // With everything cut off it is a factor.
    inverse.clone_from(&spectrum);
    torus.invert_spectrum(&mut inverse, [0.1, 0.1], 1e3, 4.0, 1.4);
    torus.convolve(&inverse, &source, &mut back, &mut buffers);
    for (found, value) in back.data.iter().zip(&source.data) {
        assert!((found - value / 4.0).abs() < 1e-6, "{found} instead of a quarter of {value}");
    }
}

#[test]
fn transforms_are_the_sums_that_define_them() {
    for len in 1..=60_usize {
        let values: Vec<Complex<f64>> =
            (0..len).map(|k| Complex::new((k * k) as f64 % 7.0 - 3.0, (5 * k) as f64 % 11.0 - 5.0)).collect();
        for (inverse, sign) in [(false, -1.0), (true, 1.0)] {
            let mut found = values.clone();
            Fourier::new(len, inverse).run(&mut found);
            for (k, found) in found.iter().enumerate() {
                let term = |(n, value): (usize, &Complex<f64>)| {
                    value * Complex::from_polar(1.0, sign * TAU * (k * n) as f64 / len as f64)
                };
                let sum: Complex<f64> = values.iter().enumerate().map(term).sum();
                assert!((found - sum).norm() < 1e-11 * len as f64, "length {len}, frequency {k}: {found}, {sum}");
            }
        }
    }
}
