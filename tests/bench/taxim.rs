//! Time of Taxim's colours at 640x480, one thread, where nothing is flat: `cargo bench -p gelsim-bench --bench taxim`.

use std::hint::black_box;

use criterion::{Criterion, criterion_group, criterion_main};
use gelsim_core::base::simd::simd_dispatch;
use gelsim_core::optics::calibrated::taxim::{LookupScratch, TaximCalibration, TaximLookup};

const SIZE: [usize; 2] = [640, 480];
const BINS: usize = 125;

/// Slopes of waves that go through all directions, up to the steepness given.
fn waves(steepness: f64) -> [Vec<f32>; 2] {
    let [width, height] = SIZE;
    let slope = |turn: f64| {
        move |at: usize| {
            let (x, y) = ((at % width) as f64, (at / width) as f64);
            (steepness * (0.031 * x + 0.017 * y + turn).sin() * (0.023 * y - 0.011 * x + turn).cos() + 0.02) as f32
        }
    };
    [0.0, 1.3].map(|turn| (0..width * height).map(slope(turn)).collect())
}

fn colours(c: &mut Criterion) {
    let polynomials = || (0..BINS * BINS).map(|bin| [1e-5, 1e-5, 1e-5, 0.01, 0.01, bin as f32 / 500.0]).collect();
    let taxim = TaximCalibration { bins: BINS, resolution_px: SIZE, polynomials: [(); 3].map(|()| polynomials()) };
    let lookup = TaximLookup::new(&taxim, SIZE);
    let mut group = c.benchmark_group("taxim");
    let mut planes = [(); 3].map(|()| vec![0.0; SIZE[0] * SIZE[1]]);
    let mut scratch = LookupScratch::default();
    for (name, steepness) in [("gentle", 0.3), ("steep", 3.0)] {
        let [right, down] = waves(steepness);
        group.bench_function(name, |b| {
            b.iter(|| {
                let [red, green, blue] = &mut planes;
                simd_dispatch(
                    #[inline(always)]
                    || {
                        for y in 0..SIZE[1] {
                            let row = y * SIZE[0]..(y + 1) * SIZE[0];
                            let change = [&mut red[row.clone()], &mut green[row.clone()], &mut blue[row.clone()]];
                            lookup.compute_row_change(y, 0, [&right[row.clone()], &down[row]], &mut scratch, change);
                        }
                    },
                );
                black_box(&planes);
            });
        });
    }
    group.bench_function("ready", |b| b.iter(|| TaximLookup::new(black_box(&taxim), SIZE)));
    group.finish();
}

criterion_group!(benches, colours);
criterion_main!(benches);
