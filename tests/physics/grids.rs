//! What the size of the pixels costs: coarse grids against one that is much finer.

use gelsim_core::base::grid::Grid;
use gelsim_core::base::grid::Resolution;

use super::rig::{NOTHING, Rig, Setup};

/// Distance from the edge of the part that touches, mm, positive outside, and the penetration.
type Object = (&'static str, fn(f64, f64) -> f64, fn(f64, f64) -> f64);

const OBJECTS: [Object; 3] = [
    // The contact's radius is 1.306 mm on the finest grid.
    (
        "sphere",
        |x, y| x.hypot(y) - 1.31,
        |x, y| if x.hypot(y) < 2.35 { (2.35_f64.powi(2) - x * x - y * y).sqrt() - 1.35 } else { NOTHING },
    ),
    ("square", |x, y| outside(x, y, [1.5, 1.5]), |x, y| if outside(x, y, [1.5, 1.5]) < 0.0 { 0.5 } else { NOTHING }),
    ("line", |x, y| outside(x, y, [1.5, 0.25]), |x, y| if outside(x, y, [1.5, 0.25]) < 0.0 { 0.5 } else { NOTHING }),
];

/// Distance from a rectangle turned by 0.25, negative inside.
fn outside(x: f64, y: f64, half: [f64; 2]) -> f64 {
    let (sin, cos) = 0.25_f64.sin_cos();
    let [u, v] = [(x * cos + y * sin).abs() - half[0], (y * cos - x * sin).abs() - half[1]];
    if u.max(v) <= 0.0 { u.max(v) } else { u.max(0.0).hypot(v.max(0.0)) }
}

/// A view of 10 mm.
fn rig(size: usize, resolution: Resolution) -> Rig {
    let setup = Setup {
        resolution_px: [size; 2],
        mm_per_px: [10.0 / size as f64; 2],
        poisson_ratio: 0.4999,
        ..Setup::default()
    };
    setup.solved(resolution, 0.05).rig()
}

/// The value at a corner between four pixels, from the sixteen around it (cubic).
fn between(fine: &Grid<f32>, x: usize, y: usize) -> f64 {
    const WEIGHT: [f64; 4] = [-1.0 / 16.0, 9.0 / 16.0, 9.0 / 16.0, -1.0 / 16.0];
    let row = |j: usize| (0..4).map(|i| WEIGHT[i] * f64::from(fine.at(x + i - 2, y + j - 2))).sum::<f64>();
    (0..4).map(|j| WEIGHT[j] * row(j)).sum()
}

/// Nearer to a sharp edge than one pixel of the coarsest grid, 0.125 mm, the error is that of the edge's place: 100 um for
/// single pixels, on every grid.
const NEAREST: f64 = 0.125;

/// Root mean square and largest error, um, up to 2 mm outside the contact.
fn ring(coarse: &Grid<f32>, fine: &Grid<f32>, edge: fn(f64, f64) -> f64) -> [f64; 2] {
    let (size, factor) = (coarse.width - 2, (fine.width - 2) / (coarse.width - 2));
    let place = |at: usize| (at as f64 + 0.5 - size as f64 / 2.0) * 10.0 / size as f64;
    let (mut sum, mut count, mut worst) = (0.0, 0, 0.0_f64);
    for y in 1..size - 1 {
        for x in 1..size - 1 {
            if (NEAREST..2.0).contains(&edge(place(x), place(y))) {
                // The middle of a coarse pixel is a corner between fine ones.
                let at = |k: usize| k * factor + factor / 2 + 1;
                let error = 1e3 * (f64::from(coarse.at(x + 1, y + 1)) - between(fine, at(x), at(y)));
                sum += error * error;
                count += 1;
                worst = worst.max(error.abs());
            }
        }
    }
    assert!(count > 100, "{count} pixels");
    [(sum / f64::from(count)).sqrt(), worst]
}

#[test]
fn finer_pixels_converge_to_one_surface() {
    let finest = rig(640, Resolution::Full);
    // Pixels as on grids of 160, 320 and 640 px over 20 mm; root mean square in um, at most.
    for ((name, edge, object), bounds) in OBJECTS.into_iter().zip([[0.4, 0.2, 0.06], [4.0, 2.5, 1.0], [6.0, 2.0, 1.0]])
    {
        let fine = finest.press(object);
        assert!(fine.numerics.converged, "{name}: {:?}", fine.numerics);
        let touching = fine.mask.data.iter().filter(|value| **value == 255).count();
        println!("grid, {name}: {} mm^2 touch", touching as f64 * (10.0_f64 / 640.0).powi(2));
        for (size, bound) in [80, 160, 320].into_iter().zip(bounds) {
            let contact = rig(size, Resolution::Full).press(object);
            let [mean, worst] = ring(&contact.surface, &fine.surface, edge);
            println!("grid, {name}, {} px over 20 mm: {mean:.3} um, at most {worst:.2}", 2 * size);
            assert!(mean < bound, "{name}, {} px: {mean} um", 2 * size);
        }
        for resolution in [Resolution::Half, Resolution::Quarter] {
            let contact = rig(320, resolution).press(object);
            let [mean, worst] = ring(&contact.surface, &fine.surface, edge);
            println!("grid, {name}, {resolution:?} of 640 px over 20 mm: {mean:.3} um, at most {worst:.2}");
        }
    }
}
