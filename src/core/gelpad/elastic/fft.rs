//! Complex Fourier transforms of eight signals at a time, in place.
//!
//! The values of the eight signals are interleaved, so that every step is plain arithmetic on neighbours and gives the
//! same bits on every processor. FFT libraries use fused instructions where they exist, which round differently.
//! Algorithm: decimation in frequency forward, which leaves the spectrum in permuted order, and decimation in time
//! backward (Cooley and Tukey 1965; Van Loan 1992, chapter 1), with radices 5, 3, 2 and 4.

use std::f64::consts::TAU;

use pulp::{Simd, WithSimd};

use crate::base::simd::{Vectors, call_kernel};

/// Number of signals that are transformed together.
pub const LANES: usize = 8;

/// Values of [`LANES`] complex signals: the first value of each, the second of each, and so on.
#[derive(Clone, Debug, Default)]
pub struct Signals {
    /// Real parts.
    pub re: Vec<f32>,
    /// Imaginary parts.
    pub im: Vec<f32>,
}

impl Signals {
    /// Resizes each signal to `len` values; their contents are unspecified.
    pub fn resize(&mut self, len: usize) {
        self.re.resize(len * LANES, 0.0);
        self.im.resize(len * LANES, 0.0);
    }
}

/// The transform of one length.
#[derive(Clone, Debug)]
pub struct Fft {
    len: usize,
    stages: Vec<FftStage>,
    /// Number of stages that run over all values. The others run over one piece at a time, which stays in the L1 cache.
    wide_stages: usize,
    /// Position of each frequency after [`Fft::forward`].
    positions: Vec<usize>,
}

/// One pass: butterflies over blocks of `radix * rest` values.
#[derive(Clone, Debug)]
struct FftStage {
    radix: usize,
    rest: usize,
    /// For each butterfly of a block: cosine and minus sine of its `radix - 1` rotations.
    twiddles: Vec<[[f32; 2]; 4]>,
}

/// Number of values per signal that fit in the L1 cache: 384 * 8 lanes * 8 bytes = 24 KiB.
const CACHED_VALUES: usize = 384;

impl Fft {
    /// Prepares the transform of `len` values; `len` must have no prime factor above 5.
    pub fn new(len: usize) -> Self {
        let mut stages = Vec::new();
        let mut left = len;
        while left > 1 {
            // One stage of radix 2 if the power of two is odd; the others are radix 4, which needs fewer operations.
            let fours = left.trailing_zeros().is_multiple_of(2);
            let radix = [5, 3].into_iter().find(|radix| left.is_multiple_of(*radix));
            let radix = radix.unwrap_or(if fours { 4 } else { 2 });
            assert!(left.is_multiple_of(radix), "lengths are products of 2, 3 and 5");
            let rest = left / radix;
            let turn = |at: usize, k: usize| {
                let angle = TAU * (at * k) as f64 / left as f64;
                [libm::cos(angle) as f32, -libm::sin(angle) as f32]
            };
            let twiddles = (0..rest).map(|at| std::array::from_fn(|k| turn(at, k + 1))).collect();
            stages.push(FftStage { radix, rest, twiddles });
            left = rest;
        }
        let wide_stages = stages.iter().filter(|stage| stage.radix * stage.rest > CACHED_VALUES).count();
        let place = (0..len).map(|frequency| {
            let digit = |(place, frequency): (usize, usize), stage: &FftStage| {
                (place + frequency % stage.radix * stage.rest, frequency / stage.radix)
            };
            stages.iter().fold((0, frequency), digit).0
        });
        Self { len, wide_stages, positions: place.collect(), stages }
    }

    /// Returns the number of values.
    pub fn length(&self) -> usize {
        self.len
    }

    /// Returns the position of frequency number `k` after [`Fft::forward`].
    #[inline(always)]
    pub fn frequency_index(&self, k: usize) -> usize {
        self.positions[k]
    }

    /// Returns the position of the mirror image of frequency number `k` after [`Fft::forward`].
    #[inline(always)]
    pub fn mirror_index(&self, k: usize) -> usize {
        // A branch instead of a remainder, as divisions are slow.
        self.positions[if k == 0 { 0 } else { self.len - k }]
    }

    /// Transforms `re + i im` in place, not normalised; frequencies end at their [`Fft::frequency_index`].
    #[inline(always)]
    pub fn forward<S: Simd, W: Simd>(&self, vectors: Vectors<S, W>, re: &mut [f32], im: &mut [f32]) {
        let size = self.len * LANES;
        let (re, im) = (&mut re[..size], &mut im[..size]);
        let (wide, narrow) = self.stages.split_at(self.wide_stages);
        for stage in wide {
            stage.run::<S, W, true>(vectors, re, im);
        }
        let piece = narrow.first().map_or(re.len(), FftStage::block_len);
        for (re, im) in re.chunks_exact_mut(piece).zip(im.chunks_exact_mut(piece)) {
            for stage in narrow {
                stage.run::<S, W, true>(vectors, re, im);
            }
        }
    }

    /// Inverts [`Fft::forward`]; the result is multiplied by [`Fft::length`].
    #[inline(always)]
    pub fn inverse<S: Simd, W: Simd>(&self, vectors: Vectors<S, W>, re: &mut [f32], im: &mut [f32]) {
        let size = self.len * LANES;
        // With real and imaginary parts exchanged, the forward transform is the inverse one.
        let (re, im) = (&mut im[..size], &mut re[..size]);
        let (wide, narrow) = self.stages.split_at(self.wide_stages);
        let piece = narrow.first().map_or(re.len(), FftStage::block_len);
        for (re, im) in re.chunks_exact_mut(piece).zip(im.chunks_exact_mut(piece)) {
            for stage in narrow.iter().rev() {
                stage.run::<S, W, false>(vectors, re, im);
            }
        }
        for stage in wide.iter().rev() {
            stage.run::<S, W, false>(vectors, re, im);
        }
    }
}

impl FftStage {
    /// Returns the number of values of all signals in a block.
    #[inline(always)]
    fn block_len(&self) -> usize {
        self.radix * self.rest * LANES
    }

    /// Runs over all blocks. Twiddle factors are applied after the butterfly if forward, otherwise before it.
    #[inline(always)]
    fn run<S: Simd, W: Simd, const FORWARD: bool>(&self, vectors: Vectors<S, W>, re: &mut [f32], im: &mut [f32]) {
        let kernel = StageKernel::<FORWARD> { stage: self, re, im };
        // Sixteen numbers are two neighbouring butterflies of the eight signals.
        if self.rest.is_multiple_of(2) {
            call_kernel(vectors.widest, kernel);
        } else {
            call_kernel(vectors.eight, kernel);
        }
    }
}

/// A kernel for [`FftStage::run`] with any vector width.
struct StageKernel<'a, const FORWARD: bool> {
    stage: &'a FftStage,
    re: &'a mut [f32],
    im: &'a mut [f32],
}

impl<const FORWARD: bool> WithSimd for StageKernel<'_, FORWARD> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) {
        let size = self.stage.block_len() / S::F32_LANES;
        let (re, im) = (S::as_mut_simd_f32s(self.re).0, S::as_mut_simd_f32s(self.im).0);
        for (re, im) in re.chunks_exact_mut(size).zip(im.chunks_exact_mut(size)) {
            match self.stage.radix {
                2 => transform_block::<S, FORWARD, 2>(simd, re, im, &self.stage.twiddles),
                3 => transform_block::<S, FORWARD, 3>(simd, re, im, &self.stage.twiddles),
                4 => transform_block::<S, FORWARD, 4>(simd, re, im, &self.stage.twiddles),
                _ => transform_block::<S, FORWARD, 5>(simd, re, im, &self.stage.twiddles),
            }
        }
    }
}

#[inline(always)]
fn transform_block<S: Simd, const FORWARD: bool, const R: usize>(
    simd: S,
    re: &mut [S::f32s],
    im: &mut [S::f32s],
    twiddles: &[[[f32; 2]; 4]],
) {
    // A vector holds the eight signals of one or two values, or a part of one.
    let part = twiddles.len() * LANES / S::F32_LANES;
    let (mut re, mut im) = (split_block::<_, R>(re, part), split_block::<_, R>(im, part));
    // In the last stage all twiddle factors are 1.
    let turned = twiddles.len() > 1;
    let per_vector = (S::F32_LANES / LANES).max(1);
    for at in 0..part {
        let mut values = [Complex::<S> { re: re[0][at], im: im[0][at] }; R];
        for (value, (re, im)) in values.iter_mut().zip(re.iter().zip(&im)) {
            *value = Complex { re: re[at], im: im[at] };
        }
        let turns = &twiddles[at * S::F32_LANES / LANES..][..per_vector];
        if turned && !FORWARD {
            apply_twiddles(simd, &mut values, turns);
        }
        values = butterfly::<S, R>(simd, values);
        if turned && FORWARD {
            apply_twiddles(simd, &mut values, turns);
        }
        for (value, (re, im)) in values.iter().zip(re.iter_mut().zip(&mut im)) {
            re[at] = value.re;
            im[at] = value.im;
        }
    }
}

/// Splits a block into `R` parts of `part` vectors. Closures that take parts from an iterator are not always inlined.
#[inline(always)]
fn split_block<T, const R: usize>(mut block: &mut [T], part: usize) -> [&mut [T]; R] {
    let mut parts = std::array::from_fn(|_| <&mut [T]>::default());
    for split in &mut parts {
        (*split, block) = block.split_at_mut(part);
    }
    parts
}

/// Multiplies all values but the first by their twiddle factors: those of the first butterfly, and, in the upper half of
/// vectors that hold two, those of the second.
#[inline(always)]
fn apply_twiddles<S: Simd, const R: usize>(simd: S, values: &mut [Complex<S>; R], twiddles: &[[[f32; 2]; 4]]) {
    let upper = simd.less_than_f32s(simd.splat_f32s(LANES as f32 - 0.5), lane_numbers::<S>());
    for (k, value) in values[1..].iter_mut().enumerate() {
        let [cos, sin] = twiddles[0][k];
        let mut turn = Complex::<S> { re: simd.splat_f32s(cos), im: simd.splat_f32s(sin) };
        if let [_, next] = twiddles {
            turn.re = simd.select_f32s(upper, simd.splat_f32s(next[k][0]), turn.re);
            turn.im = simd.select_f32s(upper, simd.splat_f32s(next[k][1]), turn.im);
        }
        *value = value.times(simd, turn);
    }
}

/// Returns the numbers of a vector's lanes.
#[inline(always)]
fn lane_numbers<S: Simd>() -> S::f32s {
    const NUMBERS: [f32; 16] = [0.0, 1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 7.0, 8.0, 9.0, 10.0, 11.0, 12.0, 13.0, 14.0, 15.0];
    S::as_simd_f32s(&NUMBERS).0[0]
}

/// Complex numbers, one per lane.
struct Complex<S: Simd> {
    re: S::f32s,
    im: S::f32s,
}

impl<S: Simd> Clone for Complex<S> {
    #[inline(always)]
    fn clone(&self) -> Self {
        *self
    }
}

impl<S: Simd> Copy for Complex<S> {}

/// Returns `a p + b q`. As a closure it would not always be inlined, and its vectors would go through memory.
#[inline(always)]
fn weighted_sum<S: Simd>(simd: S, [a, b]: [f32; 2], [p, q]: [Complex<S>; 2]) -> Complex<S> {
    p.scaled_by(simd, a).plus(simd, q.scaled_by(simd, b))
}

/// Computes the transform of `R` values.
#[inline(always)]
fn butterfly<S: Simd, const R: usize>(simd: S, x: [Complex<S>; R]) -> [Complex<S>; R] {
    let mut y = x;
    match R {
        2 => {
            y[0] = x[0].plus(simd, x[1]);
            y[1] = x[0].minus(simd, x[1]);
        }
        3 => {
            let sum = x[1].plus(simd, x[2]);
            let across = x[1].minus(simd, x[2]).scaled_by(simd, SIN_3).times_minus_i(simd);
            let middle = x[0].plus(simd, sum.scaled_by(simd, -0.5));
            y[0] = x[0].plus(simd, sum);
            y[1] = middle.plus(simd, across);
            y[2] = middle.minus(simd, across);
        }
        4 => {
            let (even, odd) = (x[0].plus(simd, x[2]), x[1].plus(simd, x[3]));
            let (left, right) = (x[0].minus(simd, x[2]), x[1].minus(simd, x[3]).times_minus_i(simd));
            y[0] = even.plus(simd, odd);
            y[1] = left.plus(simd, right);
            y[2] = even.minus(simd, odd);
            y[3] = left.minus(simd, right);
        }
        _ => {
            let (near, far) = (x[1].plus(simd, x[4]), x[2].plus(simd, x[3]));
            let near_across = x[1].minus(simd, x[4]).times_minus_i(simd);
            let far_across = x[2].minus(simd, x[3]).times_minus_i(simd);
            let first = x[0].plus(simd, weighted_sum(simd, [COS_5[0], COS_5[1]], [near, far]));
            let second = x[0].plus(simd, weighted_sum(simd, [COS_5[1], COS_5[0]], [near, far]));
            let first_across = weighted_sum(simd, [SIN_5[0], SIN_5[1]], [near_across, far_across]);
            let second_across = weighted_sum(simd, [SIN_5[1], -SIN_5[0]], [near_across, far_across]);
            y[0] = x[0].plus(simd, near).plus(simd, far);
            y[1] = first.plus(simd, first_across);
            y[2] = second.plus(simd, second_across);
            y[3] = second.minus(simd, second_across);
            y[4] = first.minus(simd, first_across);
        }
    }
    y
}

/// sin(2 pi / 3).
const SIN_3: f32 = 0.866_025_4;
/// cos(2 pi / 5) and cos(4 pi / 5).
const COS_5: [f32; 2] = [0.309_017, -0.809_017];
/// sin(2 pi / 5) and sin(4 pi / 5).
const SIN_5: [f32; 2] = [0.951_056_5, 0.587_785_25];

impl<S: Simd> Complex<S> {
    #[inline(always)]
    fn plus(self, simd: S, other: Self) -> Self {
        Self { re: simd.add_f32s(self.re, other.re), im: simd.add_f32s(self.im, other.im) }
    }

    #[inline(always)]
    fn minus(self, simd: S, other: Self) -> Self {
        Self { re: simd.sub_f32s(self.re, other.re), im: simd.sub_f32s(self.im, other.im) }
    }

    #[inline(always)]
    fn scaled_by(self, simd: S, by: f32) -> Self {
        let by = simd.splat_f32s(by);
        Self { re: simd.mul_f32s(self.re, by), im: simd.mul_f32s(self.im, by) }
    }

    /// Multiplies by -i.
    #[inline(always)]
    fn times_minus_i(self, simd: S) -> Self {
        // `neg_f32s` is this, but is not always inlined.
        Self { re: self.im, im: simd.xor_f32s(simd.splat_f32s(-0.0), self.re) }
    }

    #[inline(always)]
    fn times(self, simd: S, other: Self) -> Self {
        let product = |a, b| simd.mul_f32s(a, b);
        Self {
            re: simd.sub_f32s(product(self.re, other.re), product(self.im, other.im)),
            im: simd.add_f32s(product(self.re, other.im), product(self.im, other.re)),
        }
    }
}

/// Returns the smallest length from `n` up that the transform accepts and that is a multiple of 16.
pub fn fast_length(n: usize) -> usize {
    let smooth = |mut n: usize| {
        for prime in [2, 3, 5] {
            while n.is_multiple_of(prime) {
                n /= prime;
            }
        }
        n == 1
    };
    (n.max(1).div_ceil(16)..).map(|sixteens| sixteens * 16).find(|n| smooth(*n)).unwrap_or(n)
}
