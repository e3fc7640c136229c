//! Where, between the solver's pixels, the contact ends.
//!
//! The solver's own pressures and gaps tell. Beside a smooth edge the last pixel in contact has a pressure p and the next
//! one a gap c; with the pitch h, the edge is at the share t = 1 / (1 + 0.563 E' c / (p h)) - 0.175 of the way from the one to
//! the other, two numbers that were fitted to a half-plane under a parabola and are held by `tests/physics/mask.rs`, with
//! E' = E / (1 - nu^2): a pixel of even pressure stands for its whole width, so that the last one may have its centre
//! outside.

use super::Solution;
use super::lattice::Lattice;
use crate::base::grid::{Grid, Rect};

/// Slope of the object between two pixels of the solver's from which on there is a wall: where it is, only the object itself
/// knows.
const WALL: f32 = 2.0;

/// A lower wall: one of the camera's pixels on the way has this share of the way's whole drop,
const STEP: f32 = 0.75;

/// which is as steep as this at least.
const LOWEST: f32 = 0.3;

/// Weight of the gap against the pressure.
const WEIGHT: f32 = 0.563;

/// How far the edge is from where pressure and gap balance, pixels.
const SHIFT: f32 = 0.175;

/// How far within the contact each pixel of the solution's box is, mm, up to about the way to the next pixel; below 0
/// outside. `coarse` is the overlap on the solver's grid, `fine` on the camera's; `stiffness` is E' of Young's modulus 1;
/// `highest` the pad's highest place, above which the object does not count: one may have captured it there, and another not.
pub fn inside_mm(
    solution: &Solution,
    coarse: &Grid<f32>,
    (fine, lattice): (&Grid<f32>, Lattice),
    mm_per_px: [f64; 2],
    stiffness: f32,
    highest: f32,
) -> Grid<f32> {
    let Rect { x0, y0, .. } = solution.contact_box;
    let pressure = &solution.pressure;
    let (width, height) = (pressure.width, pressure.height);
    let pitch = mm_per_px.map(|mm| mm as f32);
    let far = pitch[0].max(pitch[1]);
    let shift = SHIFT * pitch[0].min(pitch[1]);
    let object = |[x, y]: [usize; 2]| coarse.at(x0 + x, y0 + y).max(highest);
    let gap = |at: [usize; 2]| {
        let w = solution.displacement.at(x0 + at[0] - solution.seen.x0, y0 + at[1] - solution.seen.y0);
        (w - object(at)).max(0.0)
    };
    let walled = |touching: [usize; 2], next: [usize; 2], k: usize| {
        let drop = object(touching) - object(next);
        if drop > WALL * pitch[k] {
            return true;
        }
        if drop < LOWEST * pitch[k] {
            return false;
        }
        // Along the camera's pixels from the one centre to the other.
        let place = |[x, y]: [usize; 2]| [lattice.at_centre(x0 + x, 0), lattice.at_centre(y0 + y, 1)];
        let ([from, to], back) = ([place(touching), place(next)], next[k] < touching[k]);
        let (first, last) = if back { (from[k].end - 1, to[k].start) } else { (from[k].start, to[k].end - 1) };
        let object = |at: usize| match k {
            0 => fine.at(at, from[1].start).max(highest),
            _ => fine.at(from[0].start, at).max(highest),
        };
        let step = |at: usize| if back { object(at + 1) - object(at) } else { object(at) - object(at + 1) };
        (first.min(last)..first.max(last)).any(|at| step(at) > STEP * drop)
    };
    // Of the way from a pixel in contact to the next one, which is not.
    let share = |touching: [usize; 2], next: [usize; 2], k: usize| {
        if walled(touching, next, k) {
            return 1.0 + SHIFT;
        }
        let pitch = pitch[k];
        1.0 / (1.0 + WEIGHT * stiffness * gap(next) / (pressure.at(touching[0], touching[1]) * pitch))
    };
    let mut inside = Grid::new(width, height);
    for y in 0..height {
        let rows = [y.saturating_sub(1), y, (y + 1).min(height - 1)].map(|y| pressure.row(y));
        for x in 0..width {
            let touches = rows[1][x] > 0.0;
            let (left, right) = (x.saturating_sub(1), (x + 1).min(width - 1));
            let beside = [rows[1][left], rows[1][right], rows[0][x], rows[2][x]].map(|p| p > 0.0);
            let mut mm = far;
            if beside.iter().any(|beside| *beside != touches) {
                let places = [[left, y], [right, y], [x, y.saturating_sub(1)], [x, (y + 1).min(height - 1)]];
                let mut nearest = [f32::INFINITY; 2];
                for (k, (place, beside)) in places.into_iter().zip(beside).enumerate() {
                    let way = match (touches, beside) {
                        (true, false) => share([x, y], place, k / 2),
                        (false, true) => (1.0 - share(place, [x, y], k / 2)).max(0.0),
                        _ => continue,
                    };
                    nearest[k / 2] = nearest[k / 2].min(way * pitch[k / 2]);
                }
                // Of a straight edge that cuts both axes.
                let [across_x, across_y] = nearest.map(|mm| 1.0 / (mm * mm));
                mm = (1.0 / (across_x + across_y).sqrt()).min(far);
            }
            inside.data[y * width + x] = if touches { mm } else { -mm } - shift;
        }
    }
    inside
}
