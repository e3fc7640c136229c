//! Convolution of images with a kernel that is even in x and in y, by Fourier transforms on a padded torus.
//!
//! Columns are transformed first, sixteen at a time (two real columns make one complex signal). Then rows are processed
//! eight at a time while they are in cache: transformed, multiplied by the kernel's spectrum, and transformed back.

use pulp::Simd;

use super::fft::{Fft, LANES, Signals, fast_length};
use crate::base::grid::Grid;
use crate::base::simd::{TwoWidthKernel, Vectors, dispatch_two_widths, transpose_8x8};

/// Transforms of all lengths that a torus may have.
#[derive(Clone, Debug)]
pub struct FftPlans(Vec<Fft>);

impl FftPlans {
    /// Prepares transforms for up to `longest` values.
    pub fn new(longest: usize) -> Self {
        let end = fast_length(longest);
        let lengths = std::iter::successors(Some(fast_length(1)), |length| Some(fast_length(length + 1)));
        Self(lengths.take_while(|length| *length <= end).map(Fft::new).collect())
    }

    /// Returns the shortest transform for at least `len` values.
    fn plan_for(&self, len: usize) -> &Fft {
        &self.0[self.0.partition_point(|fft| fft.length() < len)]
    }
}

/// Memory that convolutions of any size share.
#[derive(Clone, Debug, Default)]
pub struct ConvolutionBuffers {
    pub(super) line: Signals,
    /// Spectrum along y, not yet along x: all columns for eight frequencies at a time.
    half_spectrum: Signals,
}

/// Position and sizes of a source image in a target image that contains it.
#[derive(Clone, Copy, Debug)]
pub struct ConvolutionShape {
    /// Width and height of the source, px.
    pub source: [usize; 2],
    /// Column and row of the target at which the source starts.
    pub offset: [usize; 2],
    /// Width and height of the target, px.
    pub target: [usize; 2],
}

impl ConvolutionShape {
    /// Returns the shape of a source and a target that are one box.
    pub fn within(size: [usize; 2]) -> Self {
        Self { source: size, offset: [0; 2], target: size }
    }
}

/// A kernel's spectrum on a torus: for eight frequencies along y at a time, all frequencies along x up to half the
/// torus.
#[derive(Clone, Debug, Default)]
pub struct KernelSpectrum(Vec<[f32; LANES]>);

impl KernelSpectrum {
    /// Takes the factor of each frequency, counted along x and y from 0 up, for a torus of `size` values.
    pub fn from_factors([width, height]: [usize; 2], factor: impl Fn([usize; 2]) -> f32) -> Self {
        let columns = width / 2 + 1;
        let norm = 0.5 / (width * height) as f32;
        let mut all = vec![[0.0; LANES]; (height / 2 + 1).div_ceil(LANES) * columns];
        for y in 0..=height / 2 {
            for x in 0..columns {
                all[y / LANES * columns + x][y % LANES] = norm * factor([x, y]);
            }
        }
        Self(all)
    }
}

/// Convolutions of one shape.
pub struct TorusConvolution<'a> {
    pub(super) shape: ConvolutionShape,
    pub(super) x: &'a Fft,
    pub(super) y: &'a Fft,
}

impl<'a> TorusConvolution<'a> {
    /// Makes a torus on which a kernel that reaches `reach` px along x and y does not overlap itself, with `spare` px
    /// more.
    pub fn new(plans: &'a FftPlans, shape: ConvolutionShape, reach: [usize; 2], spare: usize) -> Self {
        let length = |k: usize| {
            // Lags from source to target, ahead and behind. The kernel is even on the torus too: the longer lag must
            // not meet its own mirror image.
            let ahead = shape.target[k] - 1 - shape.offset[k];
            let behind = shape.offset[k] + shape.source[k] - 1;
            let longest = ahead.max(behind);
            plans.plan_for((longest + longest.min(reach[k]) + 1).max(shape.target[k]) + spare)
        };
        Self { shape, x: length(0), y: length(1) }
    }

    /// Returns width and height of the torus, px.
    pub fn size(&self) -> [usize; 2] {
        [self.x.length(), self.y.length()]
    }

    /// Returns the number of pixels of the torus.
    pub fn area(&self) -> usize {
        self.x.length() * self.y.length()
    }

    /// Returns the number of frequencies along x that are kept, from 0 up; the others are their mirror images.
    pub(super) fn column_count(&self) -> usize {
        self.x.length() / 2 + 1
    }

    /// Returns the number of blocks of eight frequencies along y that are kept.
    fn block_count(&self) -> usize {
        (self.y.length() / 2 + 1).div_ceil(LANES)
    }

    /// Computes the spectrum of an even kernel, given by its values at lags from 0 px up along x and y; beyond the last
    /// it is 0.
    pub fn set_spectrum(&self, kernel: &Grid<f32>, buffers: &mut ConvolutionBuffers, spectrum: &mut KernelSpectrum) {
        dispatch_two_widths(SpectrumKernel { torus: self, kernel, buffers, spectrum });
    }

    /// Computes `target = kernel * source`; the target is resized to the shape.
    pub fn convolve(
        &self,
        spectrum: &KernelSpectrum,
        source: &Grid<f32>,
        target: &mut Grid<f32>,
        buffers: &mut ConvolutionBuffers,
    ) {
        let [width, height] = self.shape.target;
        target.reshape(width, height);
        self.convolve_rows(spectrum, &source.data, &mut target.data, buffers);
    }

    /// Computes `target = kernel * source` for images that are stored row by row.
    pub fn convolve_rows(
        &self,
        spectrum: &KernelSpectrum,
        source: &[f32],
        target: &mut [f32],
        buffers: &mut ConvolutionBuffers,
    ) {
        dispatch_two_widths(ConvolveKernel { torus: self, spectrum, source, target, buffers });
    }

    /// Turns the spectrum of a convolution into that of an approximate inverse: its reciprocal, no larger than 1e5
    /// times that of `softest`, and `1 / plateau` below the frequency `cutoff` (rad/mm).
    pub fn invert_spectrum(
        &self,
        spectrum: &mut KernelSpectrum,
        mm_per_px: [f64; 2],
        cutoff: f64,
        plateau: f64,
        softest: f64,
    ) {
        let [step_x, step_y] = self.frequency_steps(mm_per_px).map(|step| step as f32);
        let norm = self.normalisation();
        let (stiffest, plateau) = (norm * (1e-5 * softest) as f32, norm * plateau.max(1e-5 * softest) as f32);
        let limit = (cutoff * cutoff) as f32;
        for (block, row) in spectrum.0.chunks_exact_mut(self.column_count()).enumerate() {
            for (x, lanes) in row.iter_mut().enumerate() {
                let qx = x as f32 * step_x;
                for (k, value) in lanes.iter_mut().enumerate() {
                    let qy = (block * LANES + k) as f32 * step_y;
                    let low = qx * qx + qy * qy < limit;
                    *value = norm * norm / if low { plateau } else { value.max(stiffest) };
                }
            }
        }
    }

    /// Adds a function of the distance from frequency 0, rad/mm, to a spectrum; from `end` on the function is 0.
    pub fn add_to_spectrum(
        &self,
        spectrum: &mut KernelSpectrum,
        mm_per_px: [f64; 2],
        end: f64,
        value: impl Fn(f64) -> f32,
    ) {
        let [step_x, step_y] = self.frequency_steps(mm_per_px);
        let norm = self.normalisation();
        let columns = self.column_count();
        let within = ((end / step_x) as usize + 1).min(columns);
        for y in (0..=self.y.length() / 2).take_while(|y| *y as f64 * step_y < end) {
            let qy = y as f64 * step_y;
            for (x, lanes) in spectrum.0[y / LANES * columns..][..within].iter_mut().enumerate() {
                let qx = x as f64 * step_x;
                lanes[y % LANES] += norm * value(libm::sqrt(qx * qx + qy * qy));
            }
        }
    }

    /// Multiplies a spectrum by a function of the phase step per pixel along x, and by that along y.
    pub fn scale_spectrum(&self, spectrum: &mut KernelSpectrum, factor: impl Fn(f64) -> f32) {
        let factors = |length: usize| -> Vec<f32> {
            (0..length).map(|n| factor(std::f64::consts::TAU * n as f64 / length as f64)).collect()
        };
        let (along_x, along_y) = (factors(self.x.length()), factors(self.y.length()));
        for (block, row) in spectrum.0.chunks_exact_mut(self.column_count()).enumerate() {
            for (lanes, x) in row.iter_mut().zip(&along_x) {
                for (value, y) in lanes.iter_mut().zip(along_y[block * LANES..].iter()) {
                    *value *= x * y;
                }
            }
        }
    }

    /// Returns the distance between frequencies along x and y, rad/mm.
    fn frequency_steps(&self, mm_per_px: [f64; 2]) -> [f64; 2] {
        let [width, height] = self.size();
        [(width, mm_per_px[0]), (height, mm_per_px[1])].map(|(len, mm)| std::f64::consts::TAU / (len as f64 * mm))
    }

    #[inline(always)]
    fn set_spectrum_with<S: Simd, W: Simd>(
        &self,
        vectors: Vectors<S, W>,
        kernel: &Grid<f32>,
        buffers: &mut ConvolutionBuffers,
        spectrum: &mut KernelSpectrum,
    ) {
        let [width, height] = self.size();
        let (columns, blocks) = (self.column_count(), self.block_count());
        let wide = columns.next_multiple_of(2 * LANES);
        // An even real signal has an even real spectrum: two of them make one complex signal without mixing.
        let ConvolutionBuffers { line, half_spectrum: half } = buffers;
        half.resize(blocks * wide);
        line.resize(height);
        for x in (0..columns).step_by(2 * LANES) {
            for y in 0..=height / 2 {
                let mut values = [0.0; 2 * LANES];
                let row = if y < kernel.height { kernel.row(y) } else { &[] };
                let rest = row.get(x..).unwrap_or_default();
                let count = rest.len().min(2 * LANES);
                values[..count].copy_from_slice(&rest[..count]);
                for y in [y, (height - y) % height] {
                    line.re[y * LANES..][..LANES].copy_from_slice(&values[..LANES]);
                    line.im[y * LANES..][..LANES].copy_from_slice(&values[LANES..]);
                }
            }
            self.y.forward(vectors, &mut line.re, &mut line.im);
            for block in 0..blocks {
                for (plane, x) in [(&line.re, x), (&line.im, x + LANES)] {
                    let mut rows = [[0.0; LANES]; LANES];
                    for (k, row) in rows.iter_mut().enumerate() {
                        *row = load_lanes(plane, self.y.frequency_index(block * LANES + k));
                    }
                    half.re[(block * wide + x) * LANES..][..LANES * LANES]
                        .copy_from_slice(transpose_8x8(vectors.eight, &rows).as_flattened());
                }
            }
        }
        spectrum.0.resize(blocks * columns, [0.0; LANES]);
        let norm = self.normalisation();
        line.resize(width);
        for first in (0..blocks).step_by(2) {
            let second = (first + 1).min(blocks - 1);
            for x in 0..columns {
                for x_there in [x, (width - x) % width] {
                    let (re, im) = (load_lanes(&half.re, first * wide + x), load_lanes(&half.re, second * wide + x));
                    line.re[x_there * LANES..][..LANES].copy_from_slice(&re);
                    line.im[x_there * LANES..][..LANES].copy_from_slice(&im);
                }
            }
            self.x.forward(vectors, &mut line.re, &mut line.im);
            for x in 0..columns {
                let at = self.x.frequency_index(x);
                for (plane, block) in [(&line.im, second), (&line.re, first)] {
                    let values = load_lanes(plane, at);
                    for (out, value) in spectrum.0[block * columns + x].iter_mut().zip(values) {
                        *out = value * norm;
                    }
                }
            }
        }
    }

    /// Returns the factor that compensates for transforms that are not normalised. It is halved because pairs of
    /// columns are not halved when they are separated.
    fn normalisation(&self) -> f32 {
        0.5 / (self.x.length() * self.y.length()) as f32
    }

    #[inline(always)]
    fn convolve_with<S: Simd, W: Simd>(
        &self,
        vectors: Vectors<S, W>,
        spectrum: &KernelSpectrum,
        source: &[f32],
        target: &mut [f32],
        buffers: &mut ConvolutionBuffers,
    ) {
        let width = self.x.length();
        self.transform_source(vectors, source, buffers);
        for (block, response) in spectrum.0.chunks_exact(self.column_count()).enumerate() {
            self.load_rows(block, buffers);
            let line = &mut buffers.line;
            self.x.forward(vectors, &mut line.re, &mut line.im);
            let (re, im) = (&mut line.re[..width * LANES], &mut line.im[..width * LANES]);
            for (x, response) in response.iter().enumerate() {
                let (here, there) = (self.x.frequency_index(x), self.x.mirror_index(x));
                scale_lanes(vectors.eight, [re, im], here, response);
                // The first and the middle frequency are their own mirror images, and must be scaled only once.
                if there != here {
                    scale_lanes(vectors.eight, [re, im], there, response);
                }
            }
            self.x.inverse(vectors, &mut line.re, &mut line.im);
            self.store_rows(block, buffers);
        }
        self.transform_to_target(vectors, target, buffers);
    }

    /// Returns the number of columns of source or target, whichever has more, in pairs of eight.
    fn wide(&self) -> usize {
        self.shape.source[0].max(self.shape.target[0]).next_multiple_of(2 * LANES)
    }

    /// Transforms the source along y; must be called before [`Self::load_rows`].
    #[inline(always)]
    pub(super) fn transform_source<S: Simd, W: Simd>(
        &self,
        vectors: Vectors<S, W>,
        source: &[f32],
        buffers: &mut ConvolutionBuffers,
    ) {
        let ConvolutionBuffers { line, half_spectrum: half } = buffers;
        half.resize(self.block_count() * self.wide());
        self.transform_columns(vectors, source, line, half);
        line.resize(self.x.length());
    }

    /// Loads eight frequencies along y of the source's columns, with zeros beside them.
    #[inline(always)]
    pub(super) fn load_rows(&self, block: usize, buffers: &mut ConvolutionBuffers) {
        let ConvolutionShape { source: [source_width, _], offset: [left, _], .. } = self.shape;
        let ConvolutionBuffers { line, half_spectrum: half } = buffers;
        let start = block * self.wide() * LANES;
        for (line, half) in [(&mut line.re, &half.re), (&mut line.im, &half.im)] {
            let line = &mut line[..self.x.length() * LANES];
            line[..left * LANES].fill(0.0);
            line[left * LANES..][..source_width * LANES].copy_from_slice(&half[start..][..source_width * LANES]);
            line[(left + source_width) * LANES..].fill(0.0);
        }
    }

    /// Stores the target's columns of eight frequencies along y.
    #[inline(always)]
    pub(super) fn store_rows(&self, block: usize, buffers: &mut ConvolutionBuffers) {
        let target_width = self.shape.target[0];
        let ConvolutionBuffers { line, half_spectrum: half } = buffers;
        let (wide, start) = (self.wide(), block * self.wide() * LANES);
        for (line, half) in [(&line.re, &mut half.re), (&line.im, &mut half.im)] {
            let (inside, beyond) = half[start..][..wide * LANES].split_at_mut(target_width * LANES);
            inside.copy_from_slice(&line[..inside.len()]);
            // Columns beyond the target share signals with those inside.
            beyond.fill(0.0);
        }
    }

    /// Transforms the target back along y.
    #[inline(always)]
    pub(super) fn transform_to_target<S: Simd, W: Simd>(
        &self,
        vectors: Vectors<S, W>,
        target: &mut [f32],
        buffers: &mut ConvolutionBuffers,
    ) {
        let ConvolutionBuffers { line, half_spectrum: half } = buffers;
        self.transform_columns_back(vectors, target, line, half);
    }

    /// Transforms the source's columns and keeps the frequencies from 0 to half the torus.
    #[inline(always)]
    fn transform_columns<S: Simd, W: Simd>(
        &self,
        vectors: Vectors<S, W>,
        source: &[f32],
        line: &mut Signals,
        half: &mut Signals,
    ) {
        let height = self.y.length();
        line.resize(height);
        let ConvolutionShape { source: [source_width, source_height], offset: [_, top], .. } = self.shape;
        let wide = self.wide();
        for x in (0..source_width).step_by(2 * LANES) {
            let (re, im) = (&mut line.re[..height * LANES], &mut line.im[..height * LANES]);
            let inside = top * LANES..(top + source_height) * LANES;
            for plane in [&mut *re, im] {
                plane[..inside.start].fill(0.0);
                plane[inside.end..].fill(0.0);
            }
            let planes = re[inside.clone()].as_chunks_mut().0.iter_mut().zip(im[inside].as_chunks_mut().0);
            let rows = planes.zip(source.chunks_exact(source_width));
            let mut bits = [0; 2 * LANES];
            if x + 2 * LANES <= source_width {
                for ((re, im), row) in rows {
                    put_values(&row[x..][..2 * LANES], [re, im], &mut bits);
                }
            } else {
                for ((re, im), row) in rows {
                    let mut values = [0.0; 2 * LANES];
                    values.iter_mut().zip(&row[x..]).for_each(|(value, from)| *value = *from);
                    put_values(&values, [re, im], &mut bits);
                }
            }
            // The spectrum of columns without any value is 0, without a transform.
            if bits == [0; 2 * LANES] {
                for plane in [&mut half.re, &mut half.im] {
                    for row in plane[..self.block_count() * wide * LANES].chunks_exact_mut(wide * LANES) {
                        row[x * LANES..][..2 * LANES * LANES].fill(0.0);
                    }
                }
                continue;
            }
            self.y.forward(vectors, &mut line.re, &mut line.im);
            for block in 0..self.block_count() {
                let mut first = [[[0.0; LANES]; LANES]; 2];
                let mut second = [[[0.0; LANES]; LANES]; 2];
                for k in 0..LANES {
                    let at = block * LANES + k;
                    let (here, there) = (self.y.frequency_index(at), self.y.mirror_index(at));
                    let (re, im) = (load_lanes(&line.re, here), load_lanes(&line.im, here));
                    let (re_there, im_there) = (load_lanes(&line.re, there), load_lanes(&line.im, there));
                    for j in 0..LANES {
                        first[0][k][j] = re[j] + re_there[j];
                        first[1][k][j] = im[j] - im_there[j];
                        second[0][k][j] = im[j] + im_there[j];
                        second[1][k][j] = re_there[j] - re[j];
                    }
                }
                let at = (block * wide + x) * LANES;
                let size = LANES * LANES;
                half.re[at..][..size].copy_from_slice(transpose_8x8(vectors.eight, &first[0]).as_flattened());
                half.im[at..][..size].copy_from_slice(transpose_8x8(vectors.eight, &first[1]).as_flattened());
                half.re[at + size..][..size].copy_from_slice(transpose_8x8(vectors.eight, &second[0]).as_flattened());
                half.im[at + size..][..size].copy_from_slice(transpose_8x8(vectors.eight, &second[1]).as_flattened());
            }
        }
    }

    /// Inverts [`Self::transform_columns`] for the target's columns.
    #[inline(always)]
    fn transform_columns_back<S: Simd, W: Simd>(
        &self,
        vectors: Vectors<S, W>,
        target: &mut [f32],
        line: &mut Signals,
        half: &Signals,
    ) {
        let height = self.y.length();
        line.resize(height);
        let [target_width, target_height] = self.shape.target;
        let wide = self.wide();
        for x in (0..target_width).step_by(2 * LANES) {
            for block in 0..self.block_count() {
                let at = block * wide + x;
                let (re, im) =
                    (load_transposed(vectors.eight, &half.re, at), load_transposed(vectors.eight, &half.im, at));
                let (re_next, im_next) = (
                    load_transposed(vectors.eight, &half.re, at + LANES),
                    load_transposed(vectors.eight, &half.im, at + LANES),
                );
                for k in 0..LANES.min(height / 2 + 1 - block * LANES) {
                    let frequency = block * LANES + k;
                    let (mut sums, mut differences) = ([[0.0; LANES]; 2], [[0.0; LANES]; 2]);
                    for j in 0..LANES {
                        sums[0][j] = re[k][j] + im_next[k][j];
                        sums[1][j] = re_next[k][j] + im[k][j];
                        differences[0][j] = re[k][j] - im_next[k][j];
                        differences[1][j] = re_next[k][j] - im[k][j];
                    }
                    let there = self.y.mirror_index(frequency) * LANES;
                    line.re[there..][..LANES].copy_from_slice(&sums[0]);
                    line.im[there..][..LANES].copy_from_slice(&differences[1]);
                    // Written last: frequencies that are their own mirror images have no imaginary part of their own.
                    let here = self.y.frequency_index(frequency) * LANES;
                    line.re[here..][..LANES].copy_from_slice(&differences[0]);
                    line.im[here..][..LANES].copy_from_slice(&sums[1]);
                }
            }
            self.y.inverse(vectors, &mut line.re, &mut line.im);
            let planes = line.re.as_chunks::<LANES>().0.iter().zip(line.im.as_chunks::<LANES>().0);
            for (row, (re, im)) in target.chunks_exact_mut(target_width).take(target_height).zip(planes) {
                let row = &mut row[x..];
                if row.len() >= 2 * LANES {
                    row[..LANES].copy_from_slice(re);
                    row[LANES..2 * LANES].copy_from_slice(im);
                } else {
                    row.iter_mut().zip(re.iter().chain(im)).for_each(|(value, from)| *value = *from);
                }
            }
        }
    }
}

/// Puts sixteen numbers, of which the second eight are imaginary parts, and collects their bits.
#[inline(always)]
fn put_values(values: &[f32], [re, im]: [&mut [f32; LANES]; 2], bits: &mut [u32; 2 * LANES]) {
    re.copy_from_slice(&values[..LANES]);
    im.copy_from_slice(&values[LANES..]);
    bits.iter_mut().zip(values).for_each(|(bits, value)| *bits |= value.to_bits());
}

/// A kernel for [`TorusConvolution::set_spectrum`] with any vector width.
struct SpectrumKernel<'a, 'b> {
    torus: &'a TorusConvolution<'b>,
    kernel: &'a Grid<f32>,
    buffers: &'a mut ConvolutionBuffers,
    spectrum: &'a mut KernelSpectrum,
}

impl TwoWidthKernel for SpectrumKernel<'_, '_> {
    type Output = ();

    #[inline(always)]
    fn run<S: Simd, W: Simd>(self, vectors: Vectors<S, W>) {
        self.torus.set_spectrum_with(vectors, self.kernel, self.buffers, self.spectrum);
    }
}

/// A kernel for [`TorusConvolution::convolve`] with any vector width.
struct ConvolveKernel<'a, 'b> {
    torus: &'a TorusConvolution<'b>,
    spectrum: &'a KernelSpectrum,
    source: &'a [f32],
    target: &'a mut [f32],
    buffers: &'a mut ConvolutionBuffers,
}

impl TwoWidthKernel for ConvolveKernel<'_, '_> {
    type Output = ();

    #[inline(always)]
    fn run<S: Simd, W: Simd>(self, vectors: Vectors<S, W>) {
        self.torus.convolve_with(vectors, self.spectrum, self.source, self.target, self.buffers);
    }
}

/// Returns value number `at` of eight signals.
#[inline(always)]
fn load_lanes(plane: &[f32], at: usize) -> [f32; LANES] {
    let mut values = [0.0; LANES];
    values.copy_from_slice(&plane[at * LANES..][..LANES]);
    values
}

/// Returns eight values of eight signals from number `at` on, signal by signal.
#[inline(always)]
fn load_transposed<S: Simd>(simd: S, plane: &[f32], at: usize) -> [[f32; LANES]; LANES] {
    let mut rows = [[0.0; LANES]; LANES];
    rows.as_flattened_mut().copy_from_slice(&plane[at * LANES..][..LANES * LANES]);
    transpose_8x8(simd, &rows)
}

/// Multiplies value number `at` of eight signals by real factors.
#[inline(always)]
fn scale_lanes<S: Simd>(simd: S, planes: [&mut [f32]; 2], at: usize, factors: &[f32; LANES]) {
    let factors = S::as_simd_f32s(factors).0;
    for plane in planes {
        let values = S::as_mut_simd_f32s(&mut plane[at * LANES..][..LANES]).0;
        for (value, factor) in values.iter_mut().zip(factors) {
            *value = simd.mul_f32s(*value, *factor);
        }
    }
}
