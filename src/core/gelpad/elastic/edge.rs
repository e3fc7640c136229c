//! Finds where the contact ends between the solver's pixels, from the solver's pressures and gaps.
//!
//! At a smooth edge, the last pixel in contact has a pressure p and the next one a gap c. With the pixel size h and E'
//! = E / (1 - nu^2), the edge lies at the share t = 1 / (1 + 0.563 E' c / (p h)) - 0.175 of the way from the one to the
//! other. The two numbers were fitted to a half-plane under a parabola; `tests/physics/mask.rs` checks them. The shift
//! is needed because a pixel's even pressure stands for its full width, so that the last pixel's centre may lie
//! outside.

use super::ContactSolution;
use super::lattice::Lattice;
use crate::base::grid::{Grid, Rect};
use crate::base::simd::simd_dispatch;

/// Slope of the object between two of the solver's pixels above which there is a wall. Where a wall lies, only the
/// object itself tells.
const WALL_SLOPE: f32 = 2.0;

/// A lower wall is one where a single step between the camera's pixels has this share of the total drop,
const STEP_SHARE: f32 = 0.75;

/// which is at least this steep.
const MIN_STEP_SLOPE: f32 = 0.3;

/// Weight of the gap against the pressure.
const GAP_WEIGHT: f32 = 0.563;

/// Distance of the edge from where pressure and gap balance, pixels.
const EDGE_SHIFT: f32 = 0.175;

/// Returns how far inside the contact each pixel of the solution's box lies, mm, at most about the distance to the next
/// pixel; below 0 outside. `coarse` is the penetration on the solver's grid, `fine` on the camera's; `stiffness` is E'
/// for Young's modulus 1. Above `highest`, the pad's highest point, the object does not count, because not every
/// capture reaches there.
pub fn distance_inside_mm(
    solution: &ContactSolution,
    coarse: &Grid<f32>,
    (fine, lattice): (&Grid<f32>, Lattice),
    mm_per_px: [f64; 2],
    stiffness: f32,
    highest: f32,
) -> Grid<f32> {
    let Rect { x0, y0, .. } = solution.contact_box;
    let pressure = &solution.pressure;
    let (width, height) = (pressure.width, pressure.height);
    let spacing = mm_per_px.map(|mm| mm as f32);
    let far = spacing[0].max(spacing[1]);
    let shift = EDGE_SHIFT * spacing[0].min(spacing[1]);
    let object = |[x, y]: [usize; 2]| coarse.at(x0 + x, y0 + y).max(highest);
    let gap = |at: [usize; 2]| {
        let w = solution.displacement.at(x0 + at[0] - solution.known_box.x0, y0 + at[1] - solution.known_box.y0);
        (w - object(at)).max(0.0)
    };
    let walled = |touching: [usize; 2], next: [usize; 2], k: usize| {
        let drop = object(touching) - object(next);
        if drop > WALL_SLOPE * spacing[k] {
            return true;
        }
        if drop < MIN_STEP_SLOPE * spacing[k] {
            return false;
        }
        // Along the camera's pixels from one centre to the other.
        let place = |[x, y]: [usize; 2]| [lattice.fine_at_centre(x0 + x, 0), lattice.fine_at_centre(y0 + y, 1)];
        let ([from, to], back) = ([place(touching), place(next)], next[k] < touching[k]);
        let (first, last) = if back { (from[k].end - 1, to[k].start) } else { (from[k].start, to[k].end - 1) };
        let object = |at: usize| match k {
            0 => fine.at(at, from[1].start).max(highest),
            _ => fine.at(from[0].start, at).max(highest),
        };
        let step = |at: usize| if back { object(at + 1) - object(at) } else { object(at) - object(at + 1) };
        (first.min(last)..first.max(last)).any(|at| step(at) > STEP_SHARE * drop)
    };
    // Position of the edge, as a share of the way from a pixel in contact to the next one, which is not.
    let share = |touching: [usize; 2], next: [usize; 2], k: usize| {
        if walled(touching, next, k) {
            return 1.0 + EDGE_SHIFT;
        }
        let spacing = spacing[k];
        1.0 / (1.0 + GAP_WEIGHT * stiffness * gap(next) / (pressure.at(touching[0], touching[1]) * spacing))
    };
    let mut inside = Grid::new(width, height);
    let mut at_edge = vec![0_u8; width];
    for y in 0..height {
        let rows = [y.saturating_sub(1), y, (y + 1).min(height - 1)].map(|y| pressure.row(y));
        let distances = inside.row_mut(y);
        simd_dispatch(
            #[inline(always)]
            || lay_out_row(rows, [far - shift, -far - shift], distances, &mut at_edge),
        );
        for x in (0..width).filter(|x| at_edge[*x] != 0) {
            let touches = rows[1][x] > 0.0;
            let (left, right) = (x.saturating_sub(1), (x + 1).min(width - 1));
            let beside = [rows[1][left], rows[1][right], rows[0][x], rows[2][x]].map(|p| p > 0.0);
            let places = [[left, y], [right, y], [x, y.saturating_sub(1)], [x, (y + 1).min(height - 1)]];
            let mut nearest = [f32::INFINITY; 2];
            for (k, (place, beside)) in places.into_iter().zip(beside).enumerate() {
                let way = match (touches, beside) {
                    (true, false) => share([x, y], place, k / 2),
                    (false, true) => (1.0 - share(place, [x, y], k / 2)).max(0.0),
                    _ => continue,
                };
                nearest[k / 2] = nearest[k / 2].min(way * spacing[k / 2]);
            }
            // Distance to a straight edge that cuts both axes.
            let [across_x, across_y] = nearest.map(|mm| 1.0 / (mm * mm));
            let mm = (1.0 / (across_x + across_y).sqrt()).min(far);
            distances[x] = if touches { mm } else { -mm } - shift;
        }
    }
    inside
}

/// Writes the distances of pixels far from an edge, inside and outside, and which pixels are at one: those with a neighbour
/// that touches where they do not, or the reverse.
#[inline(always)]
fn lay_out_row([above, here, below]: [&[f32]; 3], [inside, outside]: [f32; 2], to: &mut [f32], at_edge: &mut [u8]) {
    for (x, (to, at_edge)) in to.iter_mut().zip(&mut *at_edge).enumerate() {
        let touches = here[x] > 0.0;
        *to = if touches { inside } else { outside };
        *at_edge = u8::from((above[x] > 0.0) ^ touches) | u8::from((below[x] > 0.0) ^ touches);
    }
    let differ = |pair: &[f32]| u8::from((pair[0] > 0.0) ^ (pair[1] > 0.0));
    at_edge.iter_mut().zip(here.windows(2)).for_each(|(at_edge, pair)| *at_edge |= differ(pair));
    at_edge.iter_mut().skip(1).zip(here.windows(2)).for_each(|(at_edge, pair)| *at_edge |= differ(pair));
}
