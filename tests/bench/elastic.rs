//! Time of the elastic pad, one thread: `cargo bench -p gelsim-bench --bench elastic`.
//!
//! `setup` computes the layer's response; `press` solves objects of all kinds on every pixel, every second and every
//! fourth; `convolution` compares the convolution that all of it is made of with one by a library.

#[path = "../../src/memory.rs"]
mod memory;
#[path = "../physics/rig.rs"]
#[allow(dead_code)]
mod rig;

use std::hint::black_box;
use std::time::Duration;

use criterion::{BenchmarkId, Criterion, criterion_group};
use gelsim_core::base::grid::Grid;
use gelsim_core::base::grid::Resolution;
use gelsim_core::gelpad::elastic::Elastic;
use gelsim_core::gelpad::elastic::convolve::{
    ConvolutionBuffers, ConvolutionShape, FftPlans, KernelSpectrum, TorusConvolution,
};
use gelsim_core::gelpad::elastic::kernel::layer_kernel;
use realfft::RealFftPlanner;
use rustfft::FftPlanner;
use rustfft::num_complex::Complex32;

use rig::{OBJECTS, RESOLUTIONS, Setup};

/// 20 x 15 mm.
const GRIDS: [[usize; 2]; 2] = [[320, 240], [640, 480]];

fn sensor(resolution_px: [usize; 2]) -> Setup {
    let pitch = 20.0 / resolution_px[0] as f64;
    Setup {
        resolution_px,
        mm_per_px: [pitch; 2],
        poisson_ratio: 0.4999,
        elastic: Elastic { max_iterations: 200, ..Elastic::default() },
        ..Setup::default()
    }
}

/// The tolerances of the rungs, um.
fn tolerance_um(resolution: Resolution) -> f64 {
    if resolution == Resolution::Quarter { 3.0 } else { 1.0 }
}

fn setup(c: &mut Criterion) {
    let mut group = c.benchmark_group("setup");
    group.sample_size(10);
    for grid in GRIDS {
        for resolution in RESOLUTIONS {
            let setup = sensor(grid).solved(resolution, tolerance_um(resolution));
            let id = BenchmarkId::new(format!("{resolution:?}").to_lowercase(), grid[0]);
            group.bench_function(id, |b| b.iter(|| black_box(setup).rig()));
        }
    }
    group.finish();
}

fn press(c: &mut Criterion) {
    let mut group = c.benchmark_group("press");
    // 72 of them: some minutes.
    group.sample_size(10).warm_up_time(Duration::from_millis(300)).measurement_time(Duration::from_secs(1));
    for grid in GRIDS {
        for resolution in RESOLUTIONS {
            let rig = sensor(grid).solved(resolution, tolerance_um(resolution)).rig();
            for (name, object) in OBJECTS {
                let depth = rig.depth(object);
                let kind = format!("{resolution:?}").to_lowercase();
                let id = BenchmarkId::new(format!("{}_{kind}", name.replace(' ', "_")), grid[0]);
                group.bench_function(id, |b| b.iter(|| rig.pad.press(black_box(&depth))));
            }
        }
    }
    group.finish();
}

/// The same convolution by real transforms along x and complex ones along y, each column gathered into a line.
struct Library {
    width: usize,
    height: usize,
    along_x: std::sync::Arc<dyn realfft::RealToComplex<f32>>,
    back_x: std::sync::Arc<dyn realfft::ComplexToReal<f32>>,
    along_y: std::sync::Arc<dyn rustfft::Fft<f32>>,
    back_y: std::sync::Arc<dyn rustfft::Fft<f32>>,
    spectrum: Vec<f32>,
    padded: Vec<f32>,
    half: Vec<Complex32>,
    turned: Vec<Complex32>,
}

impl Library {
    fn new(size: [usize; 2], kernel: &Grid<f32>) -> Self {
        let [width, height] = size;
        let (mut real, mut complex) = (RealFftPlanner::new(), FftPlanner::new());
        let columns = width / 2 + 1;
        let mut library = Self {
            width,
            height,
            along_x: real.plan_fft_forward(width),
            back_x: real.plan_fft_inverse(width),
            along_y: complex.plan_fft_forward(height),
            back_y: complex.plan_fft_inverse(height),
            spectrum: vec![1.0; columns * height],
            padded: vec![0.0; width * height],
            half: vec![Complex32::default(); columns * height],
            turned: vec![Complex32::default(); columns * height],
        };
        for y in 0..height {
            for x in 0..width {
                let (u, v) = (x.min(width - x), y.min(height - y));
                let known = u < kernel.width && v < kernel.height;
                library.padded[y * width + x] = if known { kernel.at(u, v) } else { 0.0 };
            }
        }
        library.forward(height);
        let norm = 1.0 / (width * height) as f32;
        library.spectrum = library.turned.iter().map(|value| value.re * norm).collect();
        library
    }

    /// Of the first `rows` rows; the others are 0.
    fn forward(&mut self, rows: usize) {
        let columns = self.width / 2 + 1;
        for (line, out) in self.padded.chunks_exact_mut(self.width).zip(self.half.chunks_exact_mut(columns)).take(rows)
        {
            self.along_x.process(line, out).expect("lengths agree");
        }
        self.half[rows * columns..].fill(Complex32::default());
        turn(&self.half, columns, &mut self.turned);
        self.along_y.process(&mut self.turned);
    }

    fn convolve(&mut self, source: &Grid<f32>, target: &mut Grid<f32>) {
        let columns = self.width / 2 + 1;
        for (line, row) in self.padded.chunks_exact_mut(self.width).zip(source.data.chunks_exact(source.width)) {
            line[..source.width].copy_from_slice(row);
            line[source.width..].fill(0.0);
        }
        self.forward(source.height);
        for (value, factor) in self.turned.iter_mut().zip(&self.spectrum) {
            *value *= *factor;
        }
        self.back_y.process(&mut self.turned);
        turn(&self.turned, self.height, &mut self.half);
        for (line, row) in self.half.chunks_exact_mut(columns).zip(target.data.chunks_exact_mut(source.width)) {
            line[0].im = 0.0;
            line[columns - 1].im = 0.0;
            self.back_x.process(line, &mut self.padded[..self.width]).expect("lengths agree");
            row.copy_from_slice(&self.padded[..row.len()]);
        }
    }
}

/// Rows become columns, in squares that stay in the cache.
fn turn(from: &[Complex32], width: usize, to: &mut [Complex32]) {
    const SQUARE: usize = 16;
    let height = from.len() / width;
    for top in (0..height).step_by(SQUARE) {
        for left in (0..width).step_by(SQUARE) {
            for y in top..(top + SQUARE).min(height) {
                for x in left..(left + SQUARE).min(width) {
                    to[x * height + y] = from[y * width + x];
                }
            }
        }
    }
}

fn convolution(c: &mut Criterion) {
    let mut group = c.benchmark_group("convolution");
    group.sample_size(20);
    for (width, height) in [(100, 96), (160, 154), (320, 240), (640, 480)] {
        let layer = sensor([640, 480]).layer();
        let kernel = layer_kernel(layer, [0.03125; 2], 18.0, [width, height]);
        let mut source = Grid::new(width, height);
        for (at, value) in source.data.iter_mut().enumerate() {
            *value = (at * 7919 % 1000) as f32;
        }
        let shape = ConvolutionShape { source: [width, height], offset: [0, 0], target: [width, height] };
        let lengths = FftPlans::new(2 * width);
        let torus = TorusConvolution::new(&lengths, shape, [kernel.width, kernel.height], 0);
        let (mut buffers, mut spectrum, mut found) =
            (ConvolutionBuffers::default(), KernelSpectrum::default(), Grid::default());
        torus.set_spectrum(&kernel, &mut buffers, &mut spectrum);
        torus.convolve(&spectrum, &source, &mut found, &mut buffers);
        let mut library = Library::new(torus.size(), &kernel);
        let mut expected = Grid::new(width, height);
        library.convolve(&source, &mut expected);
        let largest = expected.data.iter().fold(0.0_f32, |max, value| max.max(value.abs()));
        assert!(found.data.iter().zip(&expected.data).all(|(a, b)| (a - b).abs() < 1e-5 * largest), "they agree");
        group.bench_function(BenchmarkId::new("gelsim", width), |b| {
            b.iter(|| torus.convolve(&spectrum, black_box(&source), &mut found, &mut buffers));
        });
        group.bench_function(BenchmarkId::new("realfft", width), |b| {
            b.iter(|| library.convolve(black_box(&source), &mut expected));
        });
        group.bench_function(BenchmarkId::new("gelsim_spectrum", width), |b| {
            b.iter(|| torus.set_spectrum(black_box(&kernel), &mut buffers, &mut spectrum));
        });
    }
    group.finish();
}

criterion_group!(benches, convolution, setup, press);
fn main() {
    memory::keep_freed();
    benches();
    Criterion::default().configure_from_args().final_summary();
}
