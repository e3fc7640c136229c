//! Convolution of vector fields with responses that mix their components, by Fourier transforms on a torus.
//!
//! Each component is a real image of its own, transformed like those of [`super::convolve`]: half of the frequencies along
//! y are enough, and all components of eight frequencies are mixed and transformed back along x while they are in cache.
//! The responses are the same in mirror images of the plane. So a quarter of the frequencies tells all: what has one
//! factor x or y is odd along that axis.

use pulp::Simd;

use super::convolve::{ConvolutionBuffers, TorusConvolution};
use super::fft::LANES;
use super::plane_transform::{PlaneTransform, VectorResponse};
use crate::base::simd::{TwoWidthKernel, Vectors, dispatch_two_widths};

/// `K` factors at each frequency of a quarter of a torus: for eight frequencies along y at a time, all along x up to half
/// the torus.
#[derive(Clone, Debug)]
pub struct FrequencyFactors<const K: usize>(Vec<[[f32; LANES]; K]>);

impl<const K: usize> FrequencyFactors<K> {
    /// Takes the factors of each frequency, counted along x and y from 0 up, for a torus of `size` values. They are
    /// those of a transform and its inverse that are not normalised, times the number of values.
    pub fn new([width, height]: [usize; 2], mut factors: impl FnMut([usize; 2]) -> [f32; K]) -> Self {
        let columns = width / 2 + 1;
        let mut all = vec![[[0.0; LANES]; K]; (height / 2 + 1).div_ceil(LANES) * columns];
        for y in 0..=height / 2 {
            for (x, here) in all[y / LANES * columns..][..columns].iter_mut().enumerate() {
                // Columns of the source come in pairs, which are not halved when they are separated.
                let parts = factors([x, y]).map(|part| 0.5 * part);
                here.iter_mut().zip(parts).for_each(|(lanes, part)| lanes[y % LANES] = part);
            }
        }
        Self(all)
    }
}

/// A response to `N` real fields, with `K` factors at each frequency.
pub trait Mixing<const N: usize, const K: usize> {
    /// Mixes the real and imaginary parts of a frequency's components; `mirrored` at the mirror image along x of the
    /// frequency that the factors are for.
    fn mix<S: Simd>(simd: S, from: [[S::f32s; 2]; N], factors: [S::f32s; K], mirrored: bool) -> [[S::f32s; 2]; N];
}

/// Vectors in the plane, with what x does to x, y to y, and each to the other.
pub struct InPlane;

impl Mixing<2, 3> for InPlane {
    #[inline(always)]
    fn mix<S: Simd>(
        simd: S,
        [x, y]: [[S::f32s; 2]; 2],
        [xx, yy, xy]: [S::f32s; 3],
        mirrored: bool,
    ) -> [[S::f32s; 2]; 2] {
        let xy = if mirrored { simd.neg_f32s(xy) } else { xy };
        let mut to = [x, y];
        for k in 0..2 {
            to[0][k] = simd.add_f32s(simd.mul_f32s(xx, x[k]), simd.mul_f32s(xy, y[k]));
            to[1][k] = simd.add_f32s(simd.mul_f32s(xy, x[k]), simd.mul_f32s(yy, y[k]));
        }
        to
    }
}

/// Vectors in the plane under others, with the factors of [`InPlane`], and under a pressure: its gradient times the factors
/// x and y. The third result means nothing.
pub struct InPlaneUnderPressure;

impl Mixing<3, 5> for InPlaneUnderPressure {
    #[inline(always)]
    fn mix<S: Simd>(simd: S, from: [[S::f32s; 2]; 3], factors: [S::f32s; 5], mirrored: bool) -> [[S::f32s; 2]; 3] {
        let [x, y, pressure] = from;
        let [xx, yy, xy, down_x, down_y] = factors;
        let [mut x, mut y] = InPlane::mix(simd, [x, y], [xx, yy, xy], mirrored);
        let down_x = if mirrored { simd.neg_f32s(down_x) } else { down_x };
        // A quarter period ahead of the pressure.
        let ahead = [simd.neg_f32s(pressure[1]), pressure[0]];
        for k in 0..2 {
            x[k] = simd.add_f32s(x[k], simd.mul_f32s(down_x, ahead[k]));
            y[k] = simd.add_f32s(y[k], simd.mul_f32s(down_y, ahead[k]));
        }
        [x, y, pressure]
    }
}

/// Vectors in space, with xx, xy, xz, yy, yz and zz: forces (fx, fy, -i fz) give displacements (ux, uy, -i uz).
pub struct InSpace;

impl Mixing<3, 6> for InSpace {
    #[inline(always)]
    fn mix<S: Simd>(simd: S, from: [[S::f32s; 2]; 3], factors: [S::f32s; 6], mirrored: bool) -> [[S::f32s; 2]; 3] {
        let [[x_re, x_im], [y_re, y_im], [z_re, z_im]] = from;
        let [xx, xy, xz, yy, yz, zz] = factors;
        let [xy, xz] = if mirrored { [simd.neg_f32s(xy), simd.neg_f32s(xz)] } else { [xy, xz] };
        // -i z, of the forces and of the displacement.
        let (re, im) = ([x_re, y_re, z_im], [x_im, y_im, simd.neg_f32s(z_re)]);
        let down_im = dot(simd, [xz, yz, zz], im);
        [
            [dot(simd, [xx, xy, xz], re), dot(simd, [xx, xy, xz], im)],
            [dot(simd, [xy, yy, yz], re), dot(simd, [xy, yy, yz], im)],
            [simd.neg_f32s(down_im), dot(simd, [xz, yz, zz], re)],
        ]
    }
}

#[inline(always)]
fn dot<S: Simd>(simd: S, a: [S::f32s; 3], b: [S::f32s; 3]) -> S::f32s {
    let first = simd.add_f32s(simd.mul_f32s(a[0], b[0]), simd.mul_f32s(a[1], b[1]));
    simd.add_f32s(first, simd.mul_f32s(a[2], b[2]))
}

impl FrequencyFactors<3> {
    /// Takes the factors of a response to vectors on the torus of `plane`, which is divided by the number of its values.
    pub fn of_response(plane: &PlaneTransform, response: &VectorResponse) -> Self {
        Self::new(plane.size(), |[x, y]| response.components(plane.frequency_index(x, y)))
    }
}

impl TorusConvolution<'_> {
    /// Computes the first components of the response `M` to the fields `source`, row by row; `target` is written in full.
    pub fn convolve_fields<M: Mixing<N, K>, const N: usize, const K: usize>(
        &self,
        factors: &FrequencyFactors<K>,
        source: [&[f32]; N],
        target: &mut [&mut [f32]],
        buffers: &mut [ConvolutionBuffers; N],
    ) {
        let kernel =
            FieldsKernel { torus: self, factors, source, target, buffers, mixing: std::marker::PhantomData::<M> };
        dispatch_two_widths(kernel);
    }
}

/// A kernel for [`TorusConvolution::convolve_fields`] with any vector width.
struct FieldsKernel<'a, 'b, 'c, M, const N: usize, const K: usize> {
    torus: &'a TorusConvolution<'b>,
    factors: &'a FrequencyFactors<K>,
    source: [&'a [f32]; N],
    target: &'a mut [&'c mut [f32]],
    buffers: &'a mut [ConvolutionBuffers; N],
    mixing: std::marker::PhantomData<M>,
}

impl<M: Mixing<N, K>, const N: usize, const K: usize> TwoWidthKernel for FieldsKernel<'_, '_, '_, M, N, K> {
    type Output = ();

    #[inline(always)]
    fn run<S: Simd, W: Simd>(self, vectors: Vectors<S, W>) {
        let Self { torus, factors, source, target, buffers, .. } = self;
        for (source, buffers) in source.into_iter().zip(&mut *buffers) {
            torus.transform_source(vectors, source, buffers);
        }
        for (block, factors) in factors.0.chunks_exact(torus.column_count()).enumerate() {
            for buffers in &mut *buffers {
                torus.load_rows(block, buffers);
                torus.x.forward(vectors, &mut buffers.line.re, &mut buffers.line.im);
            }
            for (x, factors) in factors.iter().enumerate() {
                let (here, there) = (torus.x.frequency_index(x), torus.x.mirror_index(x));
                mix_lanes::<S, M, N, K>(vectors.eight, buffers, here, factors, false);
                // The first and the middle frequency are their own mirror images.
                if there != here {
                    mix_lanes::<S, M, N, K>(vectors.eight, buffers, there, factors, true);
                }
            }
            for buffers in &mut buffers[..target.len()] {
                torus.x.inverse(vectors, &mut buffers.line.re, &mut buffers.line.im);
                torus.store_rows(block, buffers);
            }
        }
        for (target, buffers) in target.iter_mut().zip(&mut *buffers) {
            torus.transform_to_target(vectors, target, buffers);
        }
    }
}

/// Mixes the components of value number `at` of eight signals.
#[inline(always)]
fn mix_lanes<S: Simd, M: Mixing<N, K>, const N: usize, const K: usize>(
    simd: S,
    buffers: &mut [ConvolutionBuffers; N],
    at: usize,
    factors: &[[f32; LANES]; K],
    mirrored: bool,
) {
    // Vectors may hold fewer than the eight signals.
    let parts = LANES / S::F32_LANES;
    for part in 0..parts {
        let index = at * parts + part;
        let mut here = [simd.splat_f32s(0.0); K];
        for (here, factors) in here.iter_mut().zip(factors) {
            *here = S::as_simd_f32s(factors).0[part];
        }
        let mut from = [[simd.splat_f32s(0.0); 2]; N];
        for ([re, im], ConvolutionBuffers { line, .. }) in from.iter_mut().zip(&*buffers) {
            (*re, *im) = (S::as_simd_f32s(&line.re).0[index], S::as_simd_f32s(&line.im).0[index]);
        }
        let to = M::mix(simd, from, here, mirrored);
        for (ConvolutionBuffers { line, .. }, [re, im]) in buffers.iter_mut().zip(to) {
            S::as_mut_simd_f32s(&mut line.re).0[index] = re;
            S::as_mut_simd_f32s(&mut line.im).0[index] = im;
        }
    }
}
