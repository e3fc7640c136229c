//! Fourier transforms of real fields on a torus, as half spectra whose frequencies lie side by side, so that work on
//! each frequency is work on eight neighbours.
//!
//! Two real fields are one complex signal A + i B. With Z its spectrum, that of A is (Z(q) + conj Z(-q)) / 2 and that
//! of B (Z(q) - conj Z(-q)) / 2i. Frequencies from 0 up along x and all along y are kept.

use crate::gelpad::elastic::convolve::{ConvolutionShape, TorusConvolution};
use crate::gelpad::elastic::plane_transform::{PlaneTransform, VectorField};

/// The half spectrum of a real field.
#[derive(Clone, Debug, Default)]
pub struct HalfSpectrum {
    pub re: Vec<f32>,
    pub im: Vec<f32>,
}

impl HalfSpectrum {
    pub fn zeros(len: usize) -> Self {
        Self { re: vec![0.0; len], im: vec![0.0; len] }
    }

    /// Sets every value to 0.
    pub fn clear(&mut self) {
        self.re.fill(0.0);
        self.im.fill(0.0);
    }
}

/// Transforms of real fields of a fixed size.
pub struct RealTransform {
    plane: PlaneTransform,
    /// Number of each kept frequency along x and y, in the order of the complex spectrum: neighbours in memory stay
    /// neighbours.
    numbers: Vec<[usize; 2]>,
    /// Where each kept frequency and its opposite stand in the complex spectrum.
    places: Vec<[u32; 2]>,
    buffer: VectorField,
}

impl RealTransform {
    /// Prepares transforms of fields of `size` values along x and y, lengths of `fast_length`.
    pub fn new(size: [usize; 2]) -> Self {
        let plane = PlaneTransform::new(size);
        let [width, height] = size;
        let mut numbers: Vec<[usize; 2]> = (0..height).flat_map(|y| (0..=width / 2).map(move |x| [x, y])).collect();
        numbers.sort_by_key(|[x, y]| plane.frequency_index(*x, *y));
        let place = |[x, y]: &[usize; 2]| {
            let opposite = [(width - x) % width, (height - y) % height];
            [plane.frequency_index(*x, *y) as u32, plane.frequency_index(opposite[0], opposite[1]) as u32]
        };
        let places = numbers.iter().map(place).collect();
        let buffer = plane.zeros();
        Self { plane, numbers, places, buffer }
    }

    /// Returns the number of values along x and y.
    pub fn size(&self) -> [usize; 2] {
        self.plane.size()
    }

    /// Returns convolutions on the torus within a box of `size` values.
    pub fn convolution(&self, size: [usize; 2]) -> TorusConvolution<'_> {
        self.plane.convolution(ConvolutionShape::within(size))
    }

    /// Returns the number of kept frequencies.
    pub fn frequencies(&self) -> usize {
        self.places.len()
    }

    /// Returns the angle per value along x and y of a kept frequency, rad; it is negative for the upper half along y.
    /// The second pair is true where the frequency is the highest one, which has no sign.
    pub fn angles(&self, at: usize) -> ([f64; 2], [bool; 2]) {
        self.angles_of(self.numbers[at])
    }

    /// Returns the angles of the frequency with these numbers along x and y; see [`Self::angles`].
    pub fn angles_of(&self, [x, y]: [usize; 2]) -> ([f64; 2], [bool; 2]) {
        let [width, height] = self.size();
        let signed = if 2 * y > height { y as f64 - height as f64 } else { y as f64 };
        let turn = std::f64::consts::TAU;
        ([turn * x as f64 / width as f64, turn * signed / height as f64], [2 * x == width, 2 * y == height])
    }

    /// Transforms two real fields, each row by row.
    pub fn forward(&mut self, fields: [&[f32]; 2], spectra: [&mut HalfSpectrum; 2]) {
        let [width, height] = self.size();
        for (field, to) in fields.into_iter().zip(self.buffer.vectors_mut()) {
            to_strips(field, to, [width, height]);
        }
        self.plane.forward(&mut self.buffer);
        let [re, im] = self.buffer.spectrum();
        let [a, b] = spectra;
        for ((((place, a_re), a_im), b_re), b_im) in
            self.places.iter().zip(&mut a.re).zip(&mut a.im).zip(&mut b.re).zip(&mut b.im)
        {
            let [here, there] = place.map(|at| at as usize);
            let (z, w) = ([re[here], im[here]], [re[there], -im[there]]);
            (*a_re, *a_im) = (0.5 * (z[0] + w[0]), 0.5 * (z[1] + w[1]));
            (*b_re, *b_im) = (0.5 * (z[1] - w[1]), -0.5 * (z[0] - w[0]));
        }
    }

    /// Inverts [`Self::forward`], normalised.
    pub fn inverse(&mut self, spectra: [&HalfSpectrum; 2], fields: [&mut [f32]; 2]) {
        let [width, height] = self.size();
        let norm = 1.0 / (width * height) as f32;
        let [re, im] = self.buffer.spectrum_mut();
        let [a, b] = spectra;
        for ((((place, a_re), a_im), b_re), b_im) in self.places.iter().zip(&a.re).zip(&a.im).zip(&b.re).zip(&b.im) {
            let [here, there] = place.map(|at| at as usize);
            (re[there], im[there]) = (norm * (a_re + b_im), norm * (b_re - a_im));
            (re[here], im[here]) = (norm * (a_re - b_im), norm * (a_im + b_re));
        }
        self.plane.inverse(&mut self.buffer);
        for (field, from) in fields.into_iter().zip(self.buffer.vectors()) {
            from_strips(from, field, [width, height]);
        }
    }

    /// Transforms one real field.
    pub fn forward_one(&mut self, field: &[f32], spectrum: &mut HalfSpectrum) {
        let [width, height] = self.size();
        let [re, im] = self.buffer.vectors_mut();
        to_strips(field, re, [width, height]);
        im.fill(0.0);
        self.plane.forward(&mut self.buffer);
        let [re, im] = self.buffer.spectrum();
        for ((place, to_re), to_im) in self.places.iter().zip(&mut spectrum.re).zip(&mut spectrum.im) {
            let here = place[0] as usize;
            (*to_re, *to_im) = (re[here], im[here]);
        }
    }

    /// Inverts [`Self::forward_one`], normalised.
    pub fn inverse_one(&mut self, spectrum: &HalfSpectrum, field: &mut [f32]) {
        let [width, height] = self.size();
        let norm = 1.0 / (width * height) as f32;
        let [re, im] = self.buffer.spectrum_mut();
        for ((place, from_re), from_im) in self.places.iter().zip(&spectrum.re).zip(&spectrum.im) {
            let [here, there] = place.map(|at| at as usize);
            (re[there], im[there]) = (norm * from_re, -norm * from_im);
            (re[here], im[here]) = (norm * from_re, norm * from_im);
        }
        self.plane.inverse(&mut self.buffer);
        from_strips(self.buffer.vectors()[0], field, [width, height]);
    }

    /// Returns the place of the frequency with these numbers along x and y.
    pub fn place_of(&self, numbers: [usize; 2]) -> usize {
        let order = |[x, y]: [usize; 2]| self.plane.frequency_index(x, y);
        let wanted = order(numbers);
        self.numbers.partition_point(|numbers| order(*numbers) < wanted)
    }

    /// Returns, for each kept frequency of a coarser grid over the same torus, its numbers along x and y in this one;
    /// `None` for the coarser grid's highest frequencies, which have no sign.
    pub fn numbers_of_coarser(&self, coarse: &Self) -> Vec<Option<[usize; 2]>> {
        let ([_, height], [coarse_width, coarse_height]) = (self.size(), coarse.size());
        let numbers = |[x, y]: &[usize; 2]| {
            if 2 * x == coarse_width || 2 * y == coarse_height {
                return None;
            }
            Some([*x, if 2 * y > coarse_height { y + height - coarse_height } else { *y }])
        };
        coarse.numbers.iter().map(numbers).collect()
    }
}

/// Copies a row-major field into strips of eight columns.
fn to_strips(field: &[f32], strips: &mut [f32], [width, height]: [usize; 2]) {
    for (y, row) in field.chunks_exact(width).enumerate() {
        for (strip, eight) in row.as_chunks::<8>().0.iter().enumerate() {
            strips[(strip * height + y) * 8..][..8].copy_from_slice(eight);
        }
    }
}

fn from_strips(strips: &[f32], field: &mut [f32], [width, height]: [usize; 2]) {
    for (y, row) in field.chunks_exact_mut(width).enumerate() {
        for (strip, eight) in row.as_chunks_mut::<8>().0.iter_mut().enumerate() {
            eight.copy_from_slice(&strips[(strip * height + y) * 8..][..8]);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn two_fields_come_back_and_a_wave_is_one_frequency() {
        let (width, height) = (32, 48);
        let mut transform = RealTransform::new([width, height]);
        let value = |k: usize| move |at: usize| ((at * at * (k + 3) + 7 * at) % 101) as f32 - 50.0;
        let fields: [Vec<f32>; 2] = [0, 1].map(|k| (0..width * height).map(value(k)).collect());
        let mut spectra = [0, 1].map(|_| HalfSpectrum::zeros(transform.frequencies()));
        let [a, b] = &mut spectra;
        transform.forward([&fields[0], &fields[1]], [a, b]);
        let mut back = [0, 1].map(|_| vec![0.0; width * height]);
        let [p, q] = &mut back;
        transform.inverse([&spectra[0], &spectra[1]], [p, q]);
        let mut alone = HalfSpectrum::zeros(transform.frequencies());
        transform.forward_one(&fields[1], &mut alone);
        for (a, b) in alone.re.iter().chain(&alone.im).zip(spectra[1].re.iter().chain(&spectra[1].im)) {
            assert!((a - b).abs() < 0.05, "{a} {b}");
        }
        let mut one = vec![0.0; width * height];
        transform.inverse_one(&alone, &mut one);
        for (now, then) in back.iter().flatten().chain(&one).zip(fields.iter().flatten().chain(&fields[1])) {
            assert!((now - then).abs() < 1e-3, "{now} {then}");
        }
        let at = transform.place_of([3, height - 5]);
        let (angles, _) = transform.angles(at);
        let wave: Vec<f32> = (0..width * height)
            .map(|at| (angles[0] * (at % width) as f64 + angles[1] * (at / width) as f64).cos() as f32)
            .collect();
        transform.forward_one(&wave, &mut alone);
        for (k, (re, im)) in alone.re.iter().zip(&alone.im).enumerate() {
            let expected = if k == at { 0.5 * (width * height) as f32 } else { 0.0 };
            assert!((re - expected).abs() < 1e-2 && im.abs() < 1e-2, "{k} {re} {im}");
        }
    }
}
