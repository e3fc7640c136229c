//! Complex Fourier transforms of eight signals at a time, in place.
//!
//! The eight signals' values stand side by side, so that every step is plain arithmetic on neighbours and the bits are
//! the same on every processor; libraries pick fused instructions that round differently where there are any.
//! Algorithm: decimation in frequency forward, which leaves the spectrum in another order, and decimation in time
//! back (Cooley and Tukey 1965; Van Loan 1992, chapter 1), radices 5, 3, 2 and 4.

use std::f64::consts::TAU;

use pulp::Simd;

/// Signals that are transformed together.
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
    /// Makes room for `len` values of each signal; what they are is left open.
    pub fn resize(&mut self, len: usize) {
        self.re.resize(len * LANES, 0.0);
        self.im.resize(len * LANES, 0.0);
    }
}

/// The transform of one length.
#[derive(Clone, Debug)]
pub struct Fft {
    len: usize,
    stages: Vec<Stage>,
    /// Stages that run over the whole before the rest runs over one piece at a time, which stays in the L1 cache.
    wide_stages: usize,
    /// Where each frequency stands after [`Fft::forward`].
    place: Vec<usize>,
}

/// One pass: butterflies over blocks of `radix * rest` values.
#[derive(Clone, Debug)]
struct Stage {
    radix: usize,
    rest: usize,
    /// For each butterfly of a block: cosine and minus sine of its `radix - 1` turns.
    turns: Vec<[[f32; 2]; 4]>,
}

/// Values per signal that are small enough to stay in the L1 cache: 384 * 8 lanes * 8 bytes = 24 KiB.
const PIECE: usize = 384;

impl Fft {
    /// The transform of `len` values, which may have no prime factor above 5.
    pub fn new(len: usize) -> Self {
        let mut stages = Vec::new();
        let mut left = len;
        while left > 1 {
            let fours = left.trailing_zeros().is_multiple_of(2);
            let radix = [5, 3].into_iter().find(|radix| left.is_multiple_of(*radix));
            let radix = radix.unwrap_or(if fours { 4 } else { 2 });
            assert!(left.is_multiple_of(radix), "lengths are products of 2, 3 and 5");
            let rest = left / radix;
            let turn = |at: usize, k: usize| {
                let angle = TAU * (at * k) as f64 / left as f64;
                [libm::cos(angle) as f32, -libm::sin(angle) as f32]
            };
            let turns = (0..rest).map(|at| std::array::from_fn(|k| turn(at, k + 1))).collect();
            stages.push(Stage { radix, rest, turns });
            left = rest;
        }
        let wide_stages = stages.iter().filter(|stage| stage.radix * stage.rest > PIECE).count();
        let place = (0..len).map(|frequency| {
            let digit = |(place, frequency): (usize, usize), stage: &Stage| {
                (place + frequency % stage.radix * stage.rest, frequency / stage.radix)
            };
            stages.iter().fold((0, frequency), digit).0
        });
        Self { len, wide_stages, place: place.collect(), stages }
    }

    /// Number of values.
    pub fn length(&self) -> usize {
        self.len
    }

    /// Where frequency number `k` stands after [`Fft::forward`].
    #[inline(always)]
    pub fn place(&self, k: usize) -> usize {
        self.place[k]
    }

    /// Transforms `re + i im` in place, not normalised, and leaves the frequencies at their [`Fft::place`]s.
    #[inline(always)]
    pub fn forward<S: Simd>(&self, simd: S, re: &mut [f32], im: &mut [f32]) {
        let size = self.len * LANES;
        let (re, im) = (S::as_mut_simd_f32s(&mut re[..size]).0, S::as_mut_simd_f32s(&mut im[..size]).0);
        let (wide, narrow) = self.stages.split_at(self.wide_stages);
        for stage in wide {
            stage.run::<S, true>(simd, re, im);
        }
        let piece = narrow.first().map_or(re.len(), |stage| stage.size::<S>());
        for (re, im) in re.chunks_exact_mut(piece).zip(im.chunks_exact_mut(piece)) {
            for stage in narrow {
                stage.run::<S, true>(simd, re, im);
            }
        }
    }

    /// The way back of [`Fft::forward`], times [`Fft::length`].
    #[inline(always)]
    pub fn back<S: Simd>(&self, simd: S, re: &mut [f32], im: &mut [f32]) {
        let size = self.len * LANES;
        // With real and imaginary parts exchanged, forward is back.
        let (re, im) = (S::as_mut_simd_f32s(&mut im[..size]).0, S::as_mut_simd_f32s(&mut re[..size]).0);
        let (wide, narrow) = self.stages.split_at(self.wide_stages);
        let piece = narrow.first().map_or(re.len(), |stage| stage.size::<S>());
        for (re, im) in re.chunks_exact_mut(piece).zip(im.chunks_exact_mut(piece)) {
            for stage in narrow.iter().rev() {
                stage.run::<S, false>(simd, re, im);
            }
        }
        for stage in wide.iter().rev() {
            stage.run::<S, false>(simd, re, im);
        }
    }
}

impl Stage {
    /// Vectors in a block.
    #[inline(always)]
    fn size<S: Simd>(&self) -> usize {
        self.radix * self.rest * LANES / S::F32_LANES
    }

    /// Runs over all blocks; forward the turns come after the butterfly, otherwise before it.
    #[inline(always)]
    fn run<S: Simd, const FORWARD: bool>(&self, simd: S, re: &mut [S::f32s], im: &mut [S::f32s]) {
        let size = self.size::<S>();
        for (re, im) in re.chunks_exact_mut(size).zip(im.chunks_exact_mut(size)) {
            match self.radix {
                2 => block::<S, FORWARD, 2>(simd, re, im, &self.turns),
                3 => block::<S, FORWARD, 3>(simd, re, im, &self.turns),
                4 => block::<S, FORWARD, 4>(simd, re, im, &self.turns),
                _ => block::<S, FORWARD, 5>(simd, re, im, &self.turns),
            }
        }
    }
}

#[inline(always)]
fn block<S: Simd, const FORWARD: bool, const R: usize>(
    simd: S,
    re: &mut [S::f32s],
    im: &mut [S::f32s],
    turns: &[[[f32; 2]; 4]],
) {
    // Vectors may be narrower than the eight signals; then there are more of them per value.
    let per_value = LANES / S::F32_LANES;
    let part = turns.len() * per_value;
    let (mut re, mut im) = (re.chunks_exact_mut(part), im.chunks_exact_mut(part));
    let mut re: [&mut [S::f32s]; R] = std::array::from_fn(|_| re.next().expect("R parts"));
    let mut im: [&mut [S::f32s]; R] = std::array::from_fn(|_| im.next().expect("R parts"));
    for at in 0..part {
        let mut values = [Complex::<S> { re: re[0][at], im: im[0][at] }; R];
        for (value, (re, im)) in values.iter_mut().zip(re.iter().zip(&im)) {
            *value = Complex { re: re[at], im: im[at] };
        }
        // The last block's only turns are by 0.
        let turned = part > per_value;
        if turned && !FORWARD {
            turn(simd, &mut values, &turns[at / per_value]);
        }
        values = butterfly::<S, R>(simd, values);
        if turned && FORWARD {
            turn(simd, &mut values, &turns[at / per_value]);
        }
        for (value, (re, im)) in values.iter().zip(re.iter_mut().zip(&mut im)) {
            re[at] = value.re;
            im[at] = value.im;
        }
    }
}

/// Turns all values but the first.
#[inline(always)]
fn turn<S: Simd, const R: usize>(simd: S, values: &mut [Complex<S>; R], turns: &[[f32; 2]; 4]) {
    for (value, [cos, sin]) in values[1..].iter_mut().zip(turns) {
        *value = value.times(simd, Complex { re: simd.splat_f32s(*cos), im: simd.splat_f32s(*sin) });
    }
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

/// The transform of `R` values.
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
            let across = x[1].minus(simd, x[2]).scaled(simd, SIN_3).quarter_turned(simd);
            let middle = x[0].plus(simd, sum.scaled(simd, -0.5));
            y[0] = x[0].plus(simd, sum);
            y[1] = middle.plus(simd, across);
            y[2] = middle.minus(simd, across);
        }
        4 => {
            let (even, odd) = (x[0].plus(simd, x[2]), x[1].plus(simd, x[3]));
            let (left, right) = (x[0].minus(simd, x[2]), x[1].minus(simd, x[3]).quarter_turned(simd));
            y[0] = even.plus(simd, odd);
            y[1] = left.plus(simd, right);
            y[2] = even.minus(simd, odd);
            y[3] = left.minus(simd, right);
        }
        _ => {
            let (near, far) = (x[1].plus(simd, x[4]), x[2].plus(simd, x[3]));
            let near_across = x[1].minus(simd, x[4]).quarter_turned(simd);
            let far_across = x[2].minus(simd, x[3]).quarter_turned(simd);
            let mix = |a: f32, b: f32, p: Complex<S>, q: Complex<S>| p.scaled(simd, a).plus(simd, q.scaled(simd, b));
            let first = x[0].plus(simd, mix(COS_5[0], COS_5[1], near, far));
            let second = x[0].plus(simd, mix(COS_5[1], COS_5[0], near, far));
            let first_across = mix(SIN_5[0], SIN_5[1], near_across, far_across);
            let second_across = mix(SIN_5[1], -SIN_5[0], near_across, far_across);
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
    fn scaled(self, simd: S, by: f32) -> Self {
        let by = simd.splat_f32s(by);
        Self { re: simd.mul_f32s(self.re, by), im: simd.mul_f32s(self.im, by) }
    }

    /// Times -i.
    #[inline(always)]
    fn quarter_turned(self, simd: S) -> Self {
        Self { re: self.im, im: simd.neg_f32s(self.re) }
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

/// The smallest length from `n` up that the transform takes and that is a multiple of 16.
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
