//! Discrete Fourier transforms in f64 by their definition, taken apart at the prime factors of the length.

use std::f64::consts::TAU;

use nalgebra::Complex;

/// A transform of one length, or its way back without the division by the length.
pub struct Fourier {
    roots: Vec<Complex<f64>>,
}

impl Fourier {
    pub fn new(len: usize, inverse: bool) -> Self {
        let sign = if inverse { 1.0 } else { -1.0 };
        let root = |k: usize| Complex::from_polar(1.0, sign * TAU * k as f64 / len as f64);
        Self { roots: (0..len).map(root).collect() }
    }

    pub fn run(&self, values: &mut [Complex<f64>]) {
        let len = self.roots.len();
        assert_eq!(values.len(), len);
        // Stockham's order: `stride` transforms of length `rest` are left, and go from one buffer to the other.
        let (mut from, mut to) = (values.to_vec(), values.to_vec());
        let (mut rest, mut stride) = (len, 1);
        while let Some(factor) = (2..=rest).find(|factor| rest.is_multiple_of(*factor)) {
            let part = rest / factor;
            for k in 0..part {
                for t in 0..factor {
                    let turn = self.roots[k * t * stride % len];
                    let out = &mut to[stride * (factor * k + t)..][..stride];
                    out.fill(Complex::default());
                    for r in 0..factor {
                        let root = turn * self.roots[r * t % factor * (len / factor)];
                        let terms = &from[stride * (k + part * r)..][..stride];
                        out.iter_mut().zip(terms).for_each(|(sum, term)| *sum += term * root);
                    }
                }
            }
            std::mem::swap(&mut from, &mut to);
            (rest, stride) = (part, stride * factor);
        }
        values.copy_from_slice(&from);
    }
}
