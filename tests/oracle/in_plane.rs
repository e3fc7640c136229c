//! In-plane displacement of a bonded layer by plain Fourier sums in f64, and tractions by plain gradients.

use std::f64::consts::TAU;

use gelsim_core::base::grid::Grid;
use gelsim_core::gelpad::elastic::fft::fast_length;
use gelsim_core::gelpad::elastic::layer::ElasticLayer;
use nalgebra::Complex;

use super::fourier::Fourier;

/// Transforms rows, then columns.
fn transform(values: &mut [Complex<f64>], width: usize, inverse: bool) {
    let height = values.len() / width;
    let (rows, columns) = (Fourier::new(width, inverse), Fourier::new(height, inverse));
    values.chunks_exact_mut(width).for_each(|row| rows.run(row));
    let mut column = vec![Complex::default(); height];
    for x in 0..width {
        (0..height).for_each(|y| column[y] = values[y * width + x]);
        columns.run(&mut column);
        (0..height).for_each(|y| values[y * width + x] = column[y]);
    }
}

/// Displacement at the pixels of a pressure and of tractions along x and y, from the layer's responses part by part, on
/// a torus with `room_mm` beyond the load.
pub fn displacement_by_fourier_sums(
    layer: ElasticLayer,
    load: [&Grid<f32>; 3],
    mm_per_px: [f64; 2],
    room_mm: f64,
) -> [Grid<f64>; 2] {
    let Grid { width, height, .. } = *load[0];
    let long = |count: usize, pitch: f64| fast_length((count as f64 + room_mm / pitch) as usize);
    let size = [long(width, mm_per_px[0]), long(height, mm_per_px[1])];
    let spectra = load.map(|part| {
        let mut spectrum = vec![Complex::default(); size[0] * size[1]];
        if part.data.iter().all(|value| *value == 0.0) {
            return spectrum;
        }
        for y in 0..height {
            (0..width).for_each(|x| spectrum[y * size[0] + x].re = f64::from(part.at(x, y)));
        }
        transform(&mut spectrum, size[0], false);
        spectrum
    });
    let pulled = spectra[1..].iter().flatten().any(|value| *value != Complex::default());
    let i = Complex::new(0.0, 1.0);
    // The displacements are real: both come back from one transform, along x as its real part, along y as its imaginary.
    let mut values = vec![Complex::default(); size[0] * size[1]];
    for y in 0..size[1] {
        for x in 0..size[0] {
            let frequency = |n: usize, k: usize| {
                let signed = if 2 * n > size[k] { n as f64 - size[k] as f64 } else { n as f64 };
                TAU * signed / (size[k] as f64 * mm_per_px[k])
            };
            let q = [frequency(x, 0), frequency(y, 1)];
            let length = q[0].hypot(q[1]);
            let unit = q.map(|part| if length > 0.0 { part / length } else { 0.0 });
            let highest = [2 * x == size[0], 2 * y == size[1]];
            let coupling = layer.coupling_compliance(length);
            let (along, across) = if pulled {
                (layer.tangential_compliance(length), layer.transverse_compliance(length))
            } else {
                (0.0, 0.0)
            };
            let at = y * size[0] + x;
            let [u, v] = [0, 1].map(|axis| {
                let coupling = if highest[axis] { 0.0 } else { unit[axis] * coupling };
                let own =
                    if length > 0.0 { along * unit[axis].powi(2) + across * unit[1 - axis].powi(2) } else { across };
                let cross = if highest[0] || highest[1] { 0.0 } else { (along - across) * unit[0] * unit[1] };
                let [p, t, t_cross] = [spectra[0][at], spectra[1 + axis][at], spectra[2 - axis][at]];
                p * i * coupling + t * own + t_cross * cross
            });
            values[at] = (u + i * v) / (size[0] * size[1]) as f64;
        }
    }
    transform(&mut values, size[0], true);
    let mut grids = [0, 1].map(|_| Grid::new(width, height));
    for y in 0..height {
        for x in 0..width {
            let value = values[y * size[0] + x];
            grids[0].row_mut(y)[x] = value.re;
            grids[1].row_mut(y)[x] = value.im;
        }
    }
    grids
}

/// Tractions of the least energy within limits, by plain projected gradients, step after step. Entries 2k and 2k + 1 are
/// the parts of pixel k.
pub fn least_energy_within_limits(matrix: &[Vec<f64>], wanted: &[f64], limits: &[f64]) -> Vec<f64> {
    let most = matrix.iter().map(|row| row.iter().map(|value| value.abs()).sum::<f64>()).fold(0.0, f64::max);
    let mut t = vec![0.0; wanted.len()];
    for _ in 0..20_000 {
        let moved: Vec<f64> = matrix.iter().map(|row| row.iter().zip(&t).map(|(a, b)| a * b).sum()).collect();
        for (k, limit) in limits.iter().enumerate() {
            let [x, y] = [2 * k, 2 * k + 1].map(|at| t[at] - (moved[at] - wanted[at]) / most);
            let scale = (limit / x.hypot(y)).min(1.0);
            (t[2 * k], t[2 * k + 1]) = (scale * x, scale * y);
        }
    }
    t
}
