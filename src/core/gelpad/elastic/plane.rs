//! Fourier transforms of a plane of vectors: a vector (x, y) is the complex number x + i y, so that a whole vector
//! field is one complex signal, and responses that mix its parts are products in the frequency domain.
//!
//! With a the angle of the wave vector, a response of `along` to the part along it and `across` to the part across it
//! takes a field z to (along + across) / 2 Z(q) + (along - across) / 2 exp(2 i a) conj Z(-q).

use pulp::{Simd, WithSimd};

use super::fft::{Fft, LANES, Signals};
use crate::base::grid::Grid;
use crate::base::simd::{dispatch, simd_dispatch};

/// Transforms on a torus of a fixed size.
#[derive(Clone, Debug)]
pub struct Plane {
    x: Fft,
    y: Fft,
}

/// A vector field or its spectrum, and memory for the transform from one to the other.
#[derive(Clone, Debug)]
pub struct Values {
    /// The field: eight columns at a time, row by row.
    columns: Signals,
    /// The spectrum: eight frequencies along y at a time, one after the other along x, in the order of [`Fft`].
    rows: Signals,
}

/// One complex factor for each frequency, in the order of [`Values`].
#[derive(Clone, Debug)]
pub struct Symbol {
    re: Vec<f32>,
    im: Vec<f32>,
}

/// A response to vectors.
#[derive(Clone, Debug)]
pub struct Response {
    /// (along + across) / 2.
    mean: Vec<f32>,
    /// (along - across) / 2 exp(2 i a).
    turn: Symbol,
    /// Where the opposite frequency stands.
    opposite: Vec<u32>,
}

/// A wave vector on a torus, rad/mm.
#[derive(Clone, Copy, Debug)]
pub struct Wave {
    /// Along x and y.
    pub q: [f64; 2],
    /// True along x or y where the frequency is the highest: it has no sign, so nothing odd in it can be told.
    pub highest: [bool; 2],
}

impl Wave {
    /// |q|.
    pub fn length(self) -> f64 {
        libm::sqrt(self.q[0] * self.q[0] + self.q[1] * self.q[1])
    }

    /// cos a and sin a, 0 where they cannot be told.
    pub fn direction(self) -> [f64; 2] {
        let length = self.length().max(f64::MIN_POSITIVE);
        [0, 1].map(|k| if self.highest[k] { 0.0 } else { self.q[k] / length })
    }

    /// cos 2a and sin 2a, 0 where they cannot be told.
    fn double_angle(self) -> [f64; 2] {
        let square = (self.q[0] * self.q[0] + self.q[1] * self.q[1]).max(f64::MIN_POSITIVE);
        let odd = if self.highest[0] || self.highest[1] { 0.0 } else { 2.0 * self.q[0] * self.q[1] };
        [(self.q[0] * self.q[0] - self.q[1] * self.q[1]) / square, odd / square]
    }
}

impl Plane {
    /// Of `size` values along x and y: lengths that [`super::fft::fast_length`] gives.
    pub fn new(size: [usize; 2]) -> Self {
        Self { x: Fft::new(size[0]), y: Fft::new(size[1]) }
    }

    /// Values along x and y.
    pub fn size(&self) -> [usize; 2] {
        [self.x.length(), self.y.length()]
    }

    /// A field of zeros.
    pub fn zeros(&self) -> Values {
        let mut columns = Signals::default();
        columns.resize(self.x.length() * self.y.length() / LANES);
        Values { rows: columns.clone(), columns }
    }

    /// Where the vector in column `x`, row `y` stands in a field.
    #[inline(always)]
    pub fn place(&self, x: usize, y: usize) -> usize {
        (x / LANES * self.y.length() + y) * LANES + x % LANES
    }

    /// From the field to its spectrum, not normalised.
    pub fn forward(&self, values: &mut Values) {
        dispatch(Transform::<true> { plane: self, values });
    }

    /// From the spectrum to the field, times the number of values.
    pub fn back(&self, values: &mut Values) {
        dispatch(Transform::<false> { plane: self, values });
    }

    /// What `value` gives (real and imaginary part) for each frequency of a torus whose values are `pitch_mm` apart.
    pub fn symbol(&self, pitch_mm: [f64; 2], value: impl Fn(Wave) -> [f64; 2]) -> Symbol {
        let count = self.x.length() * self.y.length();
        let mut symbol = Symbol { re: vec![0.0; count], im: vec![0.0; count] };
        for y in 0..self.y.length() {
            for x in 0..self.x.length() {
                let at = self.frequency(x, y);
                [symbol.re[at], symbol.im[at]] = value(self.wave(pitch_mm, x, y)).map(|part| part as f32);
            }
        }
        symbol
    }

    /// The response of which the fields under a unit vector along x and along y at the first place are known, divided
    /// by the number of values.
    pub fn response_to(&self, mut under_x: Values, mut under_y: Values) -> Response {
        self.forward(&mut under_x);
        self.forward(&mut under_y);
        let [width, height] = self.size();
        let count = width * height;
        let norm = 1.0 / count as f32;
        let (mut mean, mut opposite) = (vec![0.0; count], vec![0; count]);
        let mut turn = Symbol { re: Vec::with_capacity(count), im: Vec::with_capacity(count) };
        for y in 0..height {
            for x in 0..width {
                let (at, other) = (self.frequency(x, y), [(width - x) % width, (height - y) % height]);
                opposite[at] = self.frequency(other[0], other[1]) as u32;
            }
        }
        // The field under (1, 0) is mean + turn, that under (0, 1) is i mean - i turn.
        let (x, y) = (&under_x.rows, &under_y.rows);
        let of_x = x.re.iter().zip(&x.im);
        for ((mean, (x_re, x_im)), (y_re, y_im)) in mean.iter_mut().zip(of_x).zip(y.re.iter().zip(&y.im)) {
            *mean = 0.5 * norm * (x_re + y_im);
            turn.re.push(0.5 * norm * (x_re - y_im));
            turn.im.push(0.5 * norm * (x_im + y_re));
        }
        Response { mean, turn, opposite }
    }

    /// The factor that takes a pressure to a displacement along the wave, `value` times i: a quarter period ahead. It is
    /// the same for a wave and its mirror images.
    pub fn gradient(&self, pitch_mm: [f64; 2], value: impl Fn(Wave) -> f64) -> Symbol {
        let [width, height] = self.size();
        let parts = self.quarter(pitch_mm, value);
        let mut symbol = Symbol { re: vec![0.0; width * height], im: vec![0.0; width * height] };
        for y in 0..height {
            for x in 0..width {
                let at = self.frequency(x, y);
                let [cos, sin] = self.wave(pitch_mm, x, y).direction();
                let size = parts.at(x.min(width - x), y.min(height - y));
                // i (cos + i sin).
                (symbol.re[at], symbol.im[at]) = ((-sin * size) as f32, (cos * size) as f32);
            }
        }
        symbol
    }

    /// Values of the frequencies from 0 up along x and y.
    fn quarter<T: Copy + Default>(&self, pitch_mm: [f64; 2], value: impl Fn(Wave) -> T) -> Grid<T> {
        let [width, height] = self.size();
        let mut parts = Grid::new(width / 2 + 1, height / 2 + 1);
        for y in 0..parts.height {
            for x in 0..parts.width {
                parts.row_mut(y)[x] = value(self.wave(pitch_mm, x, y));
            }
        }
        parts
    }

    /// The response whose parts along and across a wave are `value`, the same for a wave and its mirror images.
    pub fn response(&self, pitch_mm: [f64; 2], value: impl Fn(Wave) -> [f64; 2]) -> Response {
        let [width, height] = self.size();
        let count = width * height;
        let parts = self.quarter(pitch_mm, value);
        let (mut mean, mut opposite) = (vec![0.0; count], vec![0; count]);
        let mut turn = Symbol { re: vec![0.0; count], im: vec![0.0; count] };
        for y in 0..height {
            for x in 0..width {
                let (at, other) = (self.frequency(x, y), [(width - x) % width, (height - y) % height]);
                let [along, across] = parts.at(x.min(width - x), y.min(height - y));
                let [re, im] = self.wave(pitch_mm, x, y).double_angle().map(|part| 0.5 * (along - across) * part);
                mean[at] = (0.5 * (along + across)) as f32;
                (turn.re[at], turn.im[at]) = (re as f32, im as f32);
                opposite[at] = self.frequency(other[0], other[1]) as u32;
            }
        }
        Response { mean, turn, opposite }
    }

    /// Where frequency `x`, `y` stands in a spectrum.
    fn frequency(&self, x: usize, y: usize) -> usize {
        let (column, row) = (self.x.place(x), self.y.place(y));
        (row / LANES * self.x.length() + column) * LANES + row % LANES
    }

    fn wave(&self, pitch_mm: [f64; 2], x: usize, y: usize) -> Wave {
        let size = self.size();
        let along = |k: usize, n: usize| {
            let signed = if 2 * n > size[k] { n as f64 - size[k] as f64 } else { n as f64 };
            std::f64::consts::TAU * signed / (size[k] as f64 * pitch_mm[k])
        };
        Wave { q: [along(0, x), along(1, y)], highest: [2 * x == size[0], 2 * y == size[1]] }
    }
}

impl Response {
    /// What undoes it on the whole torus, times the square of `norm`.
    pub fn inverse(&self, norm: f64) -> Self {
        let mut inverse = self.clone();
        let Symbol { re, im } = &mut inverse.turn;
        for ((mean, re), im) in inverse.mean.iter_mut().zip(re).zip(im) {
            let [m, a, b] = [*mean, *re, *im].map(f64::from);
            let scale = norm * norm / (m * m - a * a - b * b);
            (*mean, *re, *im) = ((m * scale) as f32, (-a * scale) as f32, (-b * scale) as f32);
        }
        inverse
    }
}

impl Values {
    /// Parts along x and y of the vectors, in the order of [`Plane::place`].
    pub fn vectors(&self) -> [&[f32]; 2] {
        [&self.columns.re, &self.columns.im]
    }

    /// The same, to be written.
    pub fn vectors_mut(&mut self) -> [&mut [f32]; 2] {
        [&mut self.columns.re, &mut self.columns.im]
    }

    /// Multiplies the spectrum.
    pub fn times(&mut self, symbol: &Symbol) {
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

    /// Adds another spectrum.
    pub fn add(&mut self, other: &Self) {
        for (sum, more) in [(&mut self.rows.re, &other.rows.re), (&mut self.rows.im, &other.rows.im)] {
            sum.iter_mut().zip(more).for_each(|(sum, value)| *sum += value);
        }
    }

    /// From the spectrum of tractions to that of the displacement into the pad that they cause: `symbol` is what takes a
    /// pressure to displacements along the surface, and this its transpose. The field is real: its x.
    pub fn sink(&mut self, symbol: &Symbol, response: &Response) {
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

    /// The spectrum of what `response` makes of it.
    pub fn respond(&mut self, response: &Response) {
        let before = self.rows.clone();
        let Signals { re, im } = &mut self.rows;
        let symbols = response.mean.iter().zip(response.turn.re.iter().zip(&response.turn.im));
        for (((re, im), (mean, (a, b))), there) in re.iter_mut().zip(im).zip(symbols).zip(&response.opposite) {
            let (other_re, other_im) = (before.re[*there as usize], -before.im[*there as usize]);
            *re = mean * *re + (a * other_re - b * other_im);
            *im = mean * *im + (a * other_im + b * other_re);
        }
    }
}

/// [`Plane::forward`] or [`Plane::back`] with vectors to be chosen.
struct Transform<'a, const FORWARD: bool> {
    plane: &'a Plane,
    values: &'a mut Values,
}

impl<const FORWARD: bool> WithSimd for Transform<'_, FORWARD> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) {
        let [width, height] = self.plane.size();
        let Values { columns, rows } = self.values;
        if FORWARD {
            for strip in 0..width / LANES {
                let (re, im) = strip_of(columns, strip, height);
                // Loads are small: most columns hold nothing, and so does their spectrum.
                if re.iter().chain(&*im).any(|value| *value != 0.0) {
                    self.plane.y.forward(simd, re, im);
                }
            }
            transpose(&columns.re, &mut rows.re, height, width);
            transpose(&columns.im, &mut rows.im, height, width);
        }
        for strip in 0..height / LANES {
            let (re, im) = strip_of(rows, strip, width);
            if FORWARD {
                self.plane.x.forward(simd, re, im);
            } else {
                self.plane.x.back(simd, re, im);
            }
        }
        if !FORWARD {
            transpose(&rows.re, &mut columns.re, width, height);
            transpose(&rows.im, &mut columns.im, width, height);
            for strip in 0..width / LANES {
                let (re, im) = strip_of(columns, strip, height);
                self.plane.y.back(simd, re, im);
            }
        }
    }
}

/// Eight signals of `len` values.
#[inline(always)]
fn strip_of(signals: &mut Signals, strip: usize, len: usize) -> (&mut [f32], &mut [f32]) {
    let start = strip * len * LANES;
    (&mut signals.re[start..][..len * LANES], &mut signals.im[start..][..len * LANES])
}

/// From strips of eight signals of `len` values to strips of eight signals of `count` values, across.
#[inline(always)]
fn transpose(from: &[f32], to: &mut [f32], len: usize, count: usize) {
    for strip in 0..count / LANES {
        for block in 0..len / LANES {
            let source = &from[(strip * len + block * LANES) * LANES..][..LANES * LANES];
            let target = &mut to[(block * count + strip * LANES) * LANES..][..LANES * LANES];
            for j in 0..LANES {
                for i in 0..LANES {
                    target[i * LANES + j] = source[j * LANES + i];
                }
            }
        }
    }
}
