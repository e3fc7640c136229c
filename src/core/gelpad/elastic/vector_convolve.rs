//! Convolution of vector fields with a response that mixes their components, by Fourier transforms on a torus.
//!
//! Each component is a real image of its own, transformed like those of [`super::convolve`]: half of the frequencies along
//! y are enough, and both components of eight frequencies are mixed and transformed back along x while they are in cache.
//! The response is the same in mirror images of the plane. So its spectrum is real, and is known from the frequencies of
//! a quarter: what one component does to itself is even along x and y, what it does to the other is odd along both.

use pulp::{Simd, WithSimd};

use super::convolve::{ConvolutionBuffers, TorusConvolution};
use super::fft::{LANES, Signals};
use super::plane_transform::{PlaneTransform, VectorResponse};
use crate::base::grid::Grid;
use crate::base::simd::dispatch_kernel;

/// The spectrum of a response to vectors: for eight frequencies along y at a time, all along x up to half the torus.
#[derive(Clone, Debug)]
pub struct VectorSpectrum {
    /// What x does to x, y to y, and each to the other.
    factors: Vec<[[f32; LANES]; 3]>,
}

impl VectorSpectrum {
    /// Takes the spectrum of a response to vectors on the torus of `plane`.
    pub fn new(plane: &PlaneTransform, response: &VectorResponse) -> Self {
        let [width, height] = plane.size();
        let columns = width / 2 + 1;
        let mut factors = vec![[[0.0; LANES]; 3]; (height / 2 + 1).div_ceil(LANES) * columns];
        for y in 0..=height / 2 {
            for (x, factors) in factors[y / LANES * columns..][..columns].iter_mut().enumerate() {
                // Columns of the source come in pairs, which are not halved when they are separated.
                let parts = response.components(plane.frequency_index(x, y)).map(|part| 0.5 * part);
                factors.iter_mut().zip(parts).for_each(|(lanes, part)| lanes[y % LANES] = part);
            }
        }
        Self { factors }
    }
}

impl TorusConvolution<'_> {
    /// Computes the response to the vectors whose components are `source`; `target` is resized to the shape.
    pub fn convolve_vectors(
        &self,
        spectrum: &VectorSpectrum,
        source: &[Grid<f32>; 2],
        target: &mut [Grid<f32>; 2],
        buffers: &mut [ConvolutionBuffers; 2],
    ) {
        let [width, height] = self.shape.target;
        target.iter_mut().for_each(|component| component.reshape(width, height));
        dispatch_kernel(VectorKernel { torus: self, spectrum, source, target, buffers });
    }
}

/// A kernel for [`TorusConvolution::convolve_vectors`] with any vector width.
struct VectorKernel<'a, 'b> {
    torus: &'a TorusConvolution<'b>,
    spectrum: &'a VectorSpectrum,
    source: &'a [Grid<f32>; 2],
    target: &'a mut [Grid<f32>; 2],
    buffers: &'a mut [ConvolutionBuffers; 2],
}

impl WithSimd for VectorKernel<'_, '_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) {
        let Self { torus, spectrum, source, target, buffers } = self;
        let (wide, width) = (torus.wide(), torus.size()[0]);
        for (source, buffers) in source.iter().zip(&mut *buffers) {
            torus.transform_source(simd, source, wide, buffers);
        }
        let [of_x, of_y] = &mut *buffers;
        for (block, factors) in spectrum.factors.chunks_exact(torus.column_count()).enumerate() {
            for buffers in [&mut *of_x, &mut *of_y] {
                torus.load_rows(block, wide, buffers);
                torus.x.forward(simd, &mut buffers.line.re, &mut buffers.line.im);
            }
            for (x, factors) in factors.iter().enumerate() {
                let (here, there) = (torus.x.frequency_index(x), torus.x.frequency_index((width - x) % width));
                mix_lanes(simd, [&mut of_x.line, &mut of_y.line], here, factors, 1.0);
                // The first and the middle frequency are their own mirror images.
                if there != here {
                    mix_lanes(simd, [&mut of_x.line, &mut of_y.line], there, factors, -1.0);
                }
            }
            for buffers in [&mut *of_x, &mut *of_y] {
                torus.x.inverse(simd, &mut buffers.line.re, &mut buffers.line.im);
                torus.store_rows(block, wide, buffers);
            }
        }
        for (target, buffers) in target.iter_mut().zip(&mut *buffers) {
            torus.transform_to_target(simd, target, wide, buffers);
        }
    }
}

/// Mixes the components of value number `at` of eight signals; `sign` is that of what each does to the other.
#[inline(always)]
fn mix_lanes<S: Simd>(simd: S, [x, y]: [&mut Signals; 2], at: usize, factors: &[[f32; LANES]; 3], sign: f32) {
    let [xx, yy, mixed] = [0, 1, 2].map(|k| S::as_simd_f32s(&factors[k]).0);
    let sign = simd.splat_f32s(sign);
    for (x, y) in [(&mut x.re, &mut y.re), (&mut x.im, &mut y.im)] {
        let x = S::as_mut_simd_f32s(&mut x[at * LANES..][..LANES]).0;
        let y = S::as_mut_simd_f32s(&mut y[at * LANES..][..LANES]).0;
        for k in 0..x.len() {
            let mixed = simd.mul_f32s(sign, mixed[k]);
            let next = simd.add_f32s(simd.mul_f32s(xx[k], x[k]), simd.mul_f32s(mixed, y[k]));
            y[k] = simd.add_f32s(simd.mul_f32s(yy[k], y[k]), simd.mul_f32s(mixed, x[k]));
            x[k] = next;
        }
    }
}
