//! Fourier transforms of a plane of vectors. A vector (x, y) is the complex number x + i y, so that a vector field is
//! one complex signal, and responses that mix its components are products in the frequency domain.
//!
//! Let a be the angle of the wave vector. A response of `along` to the component along it and `across` to the component
//! across it maps the spectrum Z(q) to (along + across) / 2 Z(q) + (along - across) / 2 exp(2 i a) conj Z(-q).

use pulp::Simd;

use super::convolve::{ConvolutionShape, TorusConvolution};
use super::fft::{Fft, LANES, Signals};
use crate::base::grid::Grid;
use crate::base::simd::{TwoWidthKernel, Vectors, dispatch_two_widths, simd_dispatch, transpose_8x8};

/// Transforms on a torus of a fixed size.
#[derive(Clone, Debug)]
pub struct PlaneTransform {
    x: Fft,
    y: Fft,
}

/// A vector field and its spectrum, with memory for both.
#[derive(Clone, Debug)]
pub struct VectorField {
    /// The field: eight columns at a time, row by row.
    columns: Signals,
    /// The spectrum: eight frequencies along y at a time, one after the other along x, in the order of [`Fft`].
    rows: Signals,
}

/// One complex factor for each frequency, in the order of [`VectorField`].
#[derive(Clone, Debug)]
pub struct Symbol {
    re: Vec<f32>,
    im: Vec<f32>,
}

/// A linear response to a vector field.
#[derive(Clone, Debug)]
pub struct VectorResponse {
    /// (along + across) / 2.
    mean: Vec<f32>,
    /// (along - across) / 2 exp(2 i a).
    deviatoric: Symbol,
    /// Index of the opposite frequency.
    opposite: Vec<u32>,
}

/// A wave vector on a torus, rad/mm.
#[derive(Clone, Copy, Debug)]
pub struct WaveVector {
    /// Frequency along x and y, rad/mm.
    pub q: [f64; 2],
    /// True along x or y where the frequency is the highest one: it has no sign, so odd functions of it are undefined.
    pub highest: [bool; 2],
}

impl WaveVector {
    /// Returns |q|, rad/mm.
    pub fn length(self) -> f64 {
        libm::sqrt(self.q[0] * self.q[0] + self.q[1] * self.q[1])
    }

    /// Returns cos a and sin a; 0 where they are undefined.
    pub fn direction(self) -> [f64; 2] {
        let length = self.length().max(f64::MIN_POSITIVE);
        [0, 1].map(|k| if self.highest[k] { 0.0 } else { self.q[k] / length })
    }

    /// Returns cos 2a and sin 2a; 0 where they are undefined.
    pub(super) fn double_angle(self) -> [f64; 2] {
        let square = (self.q[0] * self.q[0] + self.q[1] * self.q[1]).max(f64::MIN_POSITIVE);
        let odd = if self.highest[0] || self.highest[1] { 0.0 } else { 2.0 * self.q[0] * self.q[1] };
        [(self.q[0] * self.q[0] - self.q[1] * self.q[1]) / square, odd / square]
    }
}

impl PlaneTransform {
    /// Prepares transforms of `size` values along x and y, lengths returned by [`super::fft::fast_length`].
    pub fn new(size: [usize; 2]) -> Self {
        Self { x: Fft::new(size[0]), y: Fft::new(size[1]) }
    }

    /// Returns the number of values along x and y.
    pub fn size(&self) -> [usize; 2] {
        [self.x.length(), self.y.length()]
    }

    /// Returns convolutions of a shape on the torus.
    pub fn convolution(&self, shape: ConvolutionShape) -> TorusConvolution<'_> {
        TorusConvolution { shape, x: &self.x, y: &self.y }
    }

    /// Returns a field of zeros.
    pub fn zeros(&self) -> VectorField {
        let mut columns = Signals::default();
        columns.resize(self.x.length() * self.y.length() / LANES);
        VectorField { rows: columns.clone(), columns }
    }

    /// Returns the index of the vector in column `x`, row `y` of a field.
    #[inline(always)]
    pub fn value_index(&self, x: usize, y: usize) -> usize {
        (x / LANES * self.y.length() + y) * LANES + x % LANES
    }

    /// Transforms the field to its spectrum, not normalised.
    pub fn forward(&self, values: &mut VectorField) {
        dispatch_two_widths(TransformKernel::<true> { plane: self, values });
    }

    /// Transforms the spectrum to the field, multiplied by the number of values.
    pub fn inverse(&self, values: &mut VectorField) {
        dispatch_two_widths(TransformKernel::<false> { plane: self, values });
    }

    /// Makes a symbol from `value` (real and imaginary part) at each frequency of a torus whose values are
    /// `mm_per_value` apart.
    pub fn make_symbol(&self, mm_per_value: [f64; 2], value: impl Fn(WaveVector) -> [f64; 2]) -> Symbol {
        let count = self.x.length() * self.y.length();
        let mut symbol = Symbol { re: vec![0.0; count], im: vec![0.0; count] };
        for y in 0..self.y.length() {
            for x in 0..self.x.length() {
                let at = self.frequency_index(x, y);
                [symbol.re[at], symbol.im[at]] = value(self.wave_vector(mm_per_value, x, y)).map(|part| part as f32);
            }
        }
        symbol
    }

    /// Makes a response, divided by the number of values, from the fields under a unit vector along x and along y at
    /// the first position.
    pub fn response_from_kernels(&self, mut under_x: VectorField, mut under_y: VectorField) -> VectorResponse {
        self.forward(&mut under_x);
        self.forward(&mut under_y);
        let [width, height] = self.size();
        let count = width * height;
        let norm = 1.0 / count as f32;
        let (mut mean, mut opposite) = (vec![0.0; count], vec![0; count]);
        let mut deviatoric = Symbol { re: Vec::with_capacity(count), im: Vec::with_capacity(count) };
        for y in 0..height {
            for x in 0..width {
                let (at, other) = (self.frequency_index(x, y), [(width - x) % width, (height - y) % height]);
                opposite[at] = self.frequency_index(other[0], other[1]) as u32;
            }
        }
        // The spectrum under (1, 0) is mean + deviatoric, that under (0, 1) is i mean - i deviatoric.
        let (x, y) = (&under_x.rows, &under_y.rows);
        let of_x = x.re.iter().zip(&x.im);
        for ((mean, (x_re, x_im)), (y_re, y_im)) in mean.iter_mut().zip(of_x).zip(y.re.iter().zip(&y.im)) {
            *mean = 0.5 * norm * (x_re + y_im);
            deviatoric.re.push(0.5 * norm * (x_re - y_im));
            deviatoric.im.push(0.5 * norm * (x_im + y_re));
        }
        VectorResponse { mean, deviatoric, opposite }
    }

    /// Makes the symbol that takes a pressure to a displacement along the wave: `value` times i, a quarter period
    /// ahead. `value` must be the same for a wave and its mirror images.
    pub fn gradient_symbol(&self, mm_per_value: [f64; 2], value: impl Fn(WaveVector) -> f64) -> Symbol {
        let [width, height] = self.size();
        let parts = self.quarter_values(mm_per_value, value);
        let mut symbol = Symbol { re: vec![0.0; width * height], im: vec![0.0; width * height] };
        for y in 0..height {
            for x in 0..width {
                let at = self.frequency_index(x, y);
                let [cos, sin] = self.wave_vector(mm_per_value, x, y).direction();
                let size = parts.at(x.min(width - x), y.min(height - y));
                // i (cos + i sin).
                (symbol.re[at], symbol.im[at]) = ((-sin * size) as f32, (cos * size) as f32);
            }
        }
        symbol
    }

    /// Evaluates `value` at the frequencies from 0 up along x and y.
    fn quarter_values<T: Copy + Default>(&self, mm_per_value: [f64; 2], value: impl Fn(WaveVector) -> T) -> Grid<T> {
        let [width, height] = self.size();
        let mut parts = Grid::new(width / 2 + 1, height / 2 + 1);
        for y in 0..parts.height {
            for x in 0..parts.width {
                parts.row_mut(y)[x] = value(self.wave_vector(mm_per_value, x, y));
            }
        }
        parts
    }

    /// Makes the response whose parts along and across a wave are `value`, which must be the same for a wave and its
    /// mirror images.
    pub fn make_response(&self, mm_per_value: [f64; 2], value: impl Fn(WaveVector) -> [f64; 2]) -> VectorResponse {
        let [width, height] = self.size();
        let count = width * height;
        let parts = self.quarter_values(mm_per_value, value);
        let (mut mean, mut opposite) = (vec![0.0; count], vec![0; count]);
        let mut deviatoric = Symbol { re: vec![0.0; count], im: vec![0.0; count] };
        for y in 0..height {
            for x in 0..width {
                let (at, other) = (self.frequency_index(x, y), [(width - x) % width, (height - y) % height]);
                let [along, across] = parts.at(x.min(width - x), y.min(height - y));
                let [re, im] =
                    self.wave_vector(mm_per_value, x, y).double_angle().map(|part| 0.5 * (along - across) * part);
                mean[at] = (0.5 * (along + across)) as f32;
                (deviatoric.re[at], deviatoric.im[at]) = (re as f32, im as f32);
                opposite[at] = self.frequency_index(other[0], other[1]) as u32;
            }
        }
        VectorResponse { mean, deviatoric, opposite }
    }

    /// Returns the index of frequency `x`, `y` in a spectrum.
    pub(crate) fn frequency_index(&self, x: usize, y: usize) -> usize {
        let (column, row) = (self.x.frequency_index(x), self.y.frequency_index(y));
        (row / LANES * self.x.length() + column) * LANES + row % LANES
    }

    /// Returns the wave vector of frequency `x`, `y` of a torus whose values are `mm_per_value` apart.
    pub(super) fn wave_vector(&self, mm_per_value: [f64; 2], x: usize, y: usize) -> WaveVector {
        let size = self.size();
        let along = |k: usize, n: usize| {
            let signed = if 2 * n > size[k] { n as f64 - size[k] as f64 } else { n as f64 };
            std::f64::consts::TAU * signed / (size[k] as f64 * mm_per_value[k])
        };
        WaveVector { q: [along(0, x), along(1, y)], highest: [2 * x == size[0], 2 * y == size[1]] }
    }
}

impl VectorResponse {
    /// Returns what the components along x and along y do to themselves, and what each does to the other, at a frequency's
    /// [`PlaneTransform::frequency_index`].
    pub(super) fn components(&self, at: usize) -> [f32; 3] {
        let (mean, cos, sin) = (self.mean[at], self.deviatoric.re[at], self.deviatoric.im[at]);
        [mean + cos, mean - cos, sin]
    }

    /// Returns the inverse on the complete torus, times the square of `norm`.
    pub fn inverse(&self, norm: f64) -> Self {
        let mut inverse = self.clone();
        let Symbol { re, im } = &mut inverse.deviatoric;
        for ((mean, re), im) in inverse.mean.iter_mut().zip(re).zip(im) {
            let [m, a, b] = [*mean, *re, *im].map(f64::from);
            // The inverse of a symmetric 2 x 2 matrix with mean m and deviatoric part a + i b.
            let scale = norm * norm / (m * m - a * a - b * b);
            (*mean, *re, *im) = ((m * scale) as f32, (-a * scale) as f32, (-b * scale) as f32);
        }
        inverse
    }
}

impl VectorField {
    /// Returns the x and y components of the vectors, in the order of [`PlaneTransform::value_index`].
    pub fn vectors(&self) -> [&[f32]; 2] {
        [&self.columns.re, &self.columns.im]
    }

    /// Returns the x and y components of the vectors, mutable.
    pub fn vectors_mut(&mut self) -> [&mut [f32]; 2] {
        [&mut self.columns.re, &mut self.columns.im]
    }

    /// Returns real and imaginary parts of the spectrum, in the order of [`PlaneTransform::frequency_index`].
    pub(crate) fn spectrum(&self) -> [&[f32]; 2] {
        [&self.rows.re, &self.rows.im]
    }

    /// Returns real and imaginary parts of the spectrum, mutable.
    pub(crate) fn spectrum_mut(&mut self) -> [&mut [f32]; 2] {
        [&mut self.rows.re, &mut self.rows.im]
    }

    /// Multiplies the spectrum by a symbol.
    pub fn multiply(&mut self, symbol: &Symbol) {
        let Signals { re, im } = &mut self.rows;
        simd_dispatch(
            #[inline(always)]
            || {
                for ((re, im), (a, b)) in re.iter_mut().zip(&mut *im).zip(symbol.re.iter().zip(&symbol.im)) {
                    (*re, *im) = (*re * a - *im * b, *re * b + *im * a);
                }
            },
        );
    }

    /// Adds another field's spectrum.
    pub fn add(&mut self, other: &Self) {
        for (sum, more) in [(&mut self.rows.re, &other.rows.re), (&mut self.rows.im, &other.rows.im)] {
            sum.iter_mut().zip(more).for_each(|(sum, value)| *sum += value);
        }
    }

    /// Turns the spectrum of tractions into that of the displacement into the pad that they cause. `symbol` takes a
    /// pressure to displacements along the surface; this applies its transpose. The resulting field is real: its x
    /// component.
    pub fn apply_coupling(&mut self, symbol: &Symbol, response: &VectorResponse) {
        let before = self.rows.clone();
        let Signals { re, im } = &mut self.rows;
        let parts = symbol.re.iter().zip(&symbol.im).zip(&response.opposite);
        for ((re, im), ((a, b), there)) in re.iter_mut().zip(im).zip(parts) {
            let (other_re, other_im) = (before.re[*there as usize], -before.im[*there as usize]);
            (*re, *im) = (
                0.5 * (a * *re + b * *im - (a * other_re - b * other_im)),
                0.5 * (a * *im - b * *re - (a * other_im + b * other_re)),
            );
        }
    }

    /// Applies a response to the spectrum.
    pub fn apply_response(&mut self, response: &VectorResponse) {
        let before = self.rows.clone();
        let Signals { re, im } = &mut self.rows;
        let symbols = response.mean.iter().zip(response.deviatoric.re.iter().zip(&response.deviatoric.im));
        for (((re, im), (mean, (a, b))), there) in re.iter_mut().zip(im).zip(symbols).zip(&response.opposite) {
            let (other_re, other_im) = (before.re[*there as usize], -before.im[*there as usize]);
            *re = mean * *re + (a * other_re - b * other_im);
            *im = mean * *im + (a * other_im + b * other_re);
        }
    }
}

/// A kernel for [`PlaneTransform::forward`] or [`PlaneTransform::inverse`] with any vector width.
struct TransformKernel<'a, const FORWARD: bool> {
    plane: &'a PlaneTransform,
    values: &'a mut VectorField,
}

impl<const FORWARD: bool> TwoWidthKernel for TransformKernel<'_, FORWARD> {
    type Output = ();

    #[inline(always)]
    fn run<S: Simd, W: Simd>(self, vectors: Vectors<S, W>) {
        let [width, height] = self.plane.size();
        let VectorField { columns, rows } = self.values;
        if FORWARD {
            for strip in 0..width / LANES {
                let (re, im) = strip_of(columns, strip, height);
                // Loads are small: most columns are zero, and so is their spectrum.
                if re.iter().chain(&*im).any(|value| *value != 0.0) {
                    self.plane.y.forward(vectors, re, im);
                }
            }
            transpose(vectors.eight, &columns.re, &mut rows.re, height, width);
            transpose(vectors.eight, &columns.im, &mut rows.im, height, width);
        }
        for strip in 0..height / LANES {
            let (re, im) = strip_of(rows, strip, width);
            if FORWARD {
                self.plane.x.forward(vectors, re, im);
            } else {
                self.plane.x.inverse(vectors, re, im);
            }
        }
        if !FORWARD {
            transpose(vectors.eight, &rows.re, &mut columns.re, width, height);
            transpose(vectors.eight, &rows.im, &mut columns.im, width, height);
            for strip in 0..width / LANES {
                let (re, im) = strip_of(columns, strip, height);
                self.plane.y.inverse(vectors, re, im);
            }
        }
    }
}

/// Returns strip number `strip` of eight signals of `len` values.
#[inline(always)]
fn strip_of(signals: &mut Signals, strip: usize, len: usize) -> (&mut [f32], &mut [f32]) {
    let start = strip * len * LANES;
    (&mut signals.re[start..][..len * LANES], &mut signals.im[start..][..len * LANES])
}

/// Transposes strips of eight signals of `len` values into strips of eight signals of `count` values.
#[inline(always)]
fn transpose<S: Simd>(simd: S, from: &[f32], to: &mut [f32], len: usize, count: usize) {
    for strip in 0..count / LANES {
        for block in 0..len / LANES {
            let source = &from[(strip * len + block * LANES) * LANES..][..LANES * LANES];
            let target = &mut to[(block * count + strip * LANES) * LANES..][..LANES * LANES];
            let mut rows = [[0.0; LANES]; LANES];
            rows.as_flattened_mut().copy_from_slice(source);
            target.copy_from_slice(transpose_8x8(simd, &rows).as_flattened());
        }
    }
}
