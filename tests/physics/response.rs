//! The layer's response in two parts, near and far field, against that in one.

use std::sync::Arc;

use gelsim_core::base::grid::{Grid, Rect};
use gelsim_core::base::simd;
use gelsim_core::gelpad::elastic::convolve::FftPlans;
use gelsim_core::gelpad::elastic::layer::ElasticLayer;
use gelsim_core::gelpad::elastic::response::{Operator, OperatorBuffers, PressureResponse};

use gelsim_oracle::shapes::Random;

/// Thickness, mm, Poisson ratio, pixels, mm; the grids of all levels at 640x480 and 320x240, and pixels that are not square.
const CASES: [(f64, f64, [f64; 2]); 9] = [
    (3.0, 0.4999, [0.03125; 2]),
    (3.0, 0.48, [0.0625; 2]),
    (3.0, 0.4999, [0.125; 2]),
    (1.5, 0.48, [0.03125; 2]),
    (1.5, 0.0, [0.0625; 2]),
    (1.5, 0.4999, [0.125; 2]),
    (4.0, 0.3, [0.05, 0.07]),
    (4.0, 0.4999, [0.25; 2]),
    (0.5, 0.48, [0.03; 2]),
];

/// Pressures of all kinds on a box.
fn pressures(width: usize, height: usize, random: &mut Random) -> [(&'static str, Grid<f32>); 5] {
    let mut of = |value: &mut dyn FnMut(usize, usize, f64) -> f64| {
        let mut grid = Grid::new(width, height);
        for y in 0..height {
            for (x, p) in grid.row_mut(y).iter_mut().enumerate() {
                *p = value(x, y, random.within(0.0, 1.0)) as f32;
            }
        }
        grid
    };
    [
        ("noise", of(&mut |_, _, random| random)),
        ("stripes", of(&mut |x, _, _| (x % 2) as f64)),
        ("a plate", of(&mut |_, _, _| 1.0)),
        ("a pixel", of(&mut |x, y, _| f64::from(u8::from([x, y] == [width / 3, height / 2])))),
        ("a corner", of(&mut |x, y, _| f64::from(u8::from(x == 0 && y == 0)))),
    ]
}

fn displaced(operator: &Operator<'_>, pressure: &Grid<f32>) -> Grid<f32> {
    let (mut memory, mut displacement) = (OperatorBuffers::default(), Grid::default());
    operator.prepare(&mut memory);
    operator.displace(pressure, &mut memory, &mut displacement);
    displacement
}

fn largest(values: impl Iterator<Item = f32>) -> f64 {
    f64::from(values.fold(0.0_f32, |most, value| most.max(value.abs())))
}

#[test]
fn near_and_far_field_are_the_whole_response() {
    let mut random = Random(7);
    let mut worst = 0.0_f64;
    for (thickness_mm, poisson_ratio, mm_per_px) in CASES {
        let layer = ElasticLayer { thickness_mm, poisson_ratio };
        let window = [330, 270];
        let in_parts = PressureResponse::new(layer, mm_per_px, 7.0 * thickness_mm, window, 1.0);
        let lengths = Arc::new(FftPlans::new(2 * window[0] + 16));
        let in_one = PressureResponse::from_kernel(layer, mm_per_px, in_parts.kernel().clone(), lengths);
        let targets = [Rect { x0: 71, y0: 45, x1: 200, y1: 150 }, Rect { x0: 3, y0: 0, x1: 327, y1: 270 }];
        let source = Rect { x0: 85, y0: 50, x1: 190, y1: 147 };
        for (source, target) in [(targets[0], targets[0]), (source, targets[0]), (source, targets[1])] {
            let operators = [&in_parts, &in_one].map(|response| response.operator(source, target));
            for (kind, pressure) in pressures(source.width(), source.height(), &mut random) {
                let [found, expected] = operators.each_ref().map(|operator| displaced(operator, &pressure));
                let narrow = simd::scalar_only(|| displaced(&operators[0], &pressure));
                assert_eq!(found, narrow, "wide vectors change bits");
                assert_ne!(found, expected, "h {thickness_mm}, {mm_per_px:?}: in one part");
                let error = largest(found.data.iter().zip(&expected.data).map(|(found, value)| found - value));
                let share = error / largest(expected.data.iter().copied());
                assert!(
                    share < 2e-4,
                    "h {thickness_mm}, nu {poisson_ratio}, {mm_per_px:?}, {kind}, {source:?}: {share:.1e}"
                );
                worst = worst.max(share);
            }
        }
    }
    println!("response: near and far field differ from the whole by up to {worst:.1e} of the largest displacement");
}

#[test]
fn pixels_too_coarse_or_too_long_and_tight_tolerances_take_the_whole_response() {
    let window = [200, 160];
    let whole = Rect::whole(60, 50);
    let pressure = pressures(60, 50, &mut Random(8))[0].1.clone();
    let cases = [(0.2, [0.05; 2], 1.0), (3.0, [0.02, 0.2], 1.0), (1e-3, [0.05; 2], 1.0), (3.0, [0.05; 2], 0.05)];
    for (thickness_mm, mm_per_px, tolerance_um) in cases {
        let layer = ElasticLayer { thickness_mm, poisson_ratio: 0.48 };
        let response = PressureResponse::new(layer, mm_per_px, 7.0 * thickness_mm, window, tolerance_um);
        let lengths = Arc::new(FftPlans::new(2 * window[0] + 16));
        let in_one = PressureResponse::from_kernel(layer, mm_per_px, response.kernel().clone(), lengths);
        let [found, expected] = [&response, &in_one].map(|one| displaced(&one.operator(whole, whole), &pressure));
        assert_eq!(found, expected, "h {thickness_mm}, {mm_per_px:?}");
        assert!(found.data.iter().all(|w| w.is_finite()));
    }
}

#[test]
fn undoing_a_displacement_gives_about_the_pressure() {
    let layer = ElasticLayer { thickness_mm: 3.0, poisson_ratio: 0.3 };
    let response = PressureResponse::new(layer, [0.0625; 2], 21.0, [330, 270], 1.0);
    let whole = Rect::whole(130, 110);
    let operator = response.operator(whole, whole);
    let mut memory = OperatorBuffers::default();
    operator.prepare(&mut memory);
    // Nothing is cut off.
    operator.prepare_inverse(0.0, &mut memory);
    let pressure = Grid {
        width: 130,
        height: 110,
        data: (0..130 * 110)
            .map(|at| {
                let (x, y) = ((at % 130) as f32 - 64.0, (at / 130) as f32 - 55.0);
                (1.0 - (x * x + y * y) / 900.0).max(0.0)
            })
            .collect(),
    };
    let (mut displacement, mut back) = (Grid::default(), Grid::default());
    operator.displace(&pressure, &mut memory, &mut displacement);
    operator.apply_inverse(&displacement, &mut memory, &mut back);
    let error = largest(back.data.iter().zip(&pressure.data).map(|(found, p)| found - p));
    println!("response: a pressure comes back within {error:.2} of its largest");
    assert!(error < 0.3, "{error}");
}
