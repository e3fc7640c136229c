//! Fits a disc to the change as a press of a ball makes it: a smooth function of place inside the disc, and a fading
//! halo around it. The best disc leaves the least of the change unexplained.

use super::change::{BlockChange, change_energy};
use crate::presses::Circle;

/// Radius up to which the halo counts, in radii of the disc.
pub(super) const HALO_REACH: f64 = 1.8;

/// Part of the change that a disc explains.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct ExplainedChange {
    /// Explained by polynomials inside and by the halo around, grey levels squared.
    pub explained: f64,
    /// Total within [`HALO_REACH`], grey levels squared.
    pub total: f64,
}

/// Normal equations of least squares with `N` functions, for three channels at once.
struct NormalEquations<const N: usize> {
    gram: [[f64; N]; N],
    product: [[f64; N]; 3],
}

impl<const N: usize> NormalEquations<N> {
    fn new() -> Self {
        Self { gram: [[0.0; N]; N], product: [[0.0; N]; 3] }
    }

    #[inline(always)]
    fn add(&mut self, weight: f64, functions: [f64; N], level: [f64; 3]) {
        for i in 0..N {
            let weighted = weight * functions[i];
            for (sum, function) in self.gram[i].iter_mut().zip(&functions[..=i]) {
                *sum += weighted * function;
            }
            for (product, level) in self.product.iter_mut().zip(level) {
                product[i] += weighted * level;
            }
        }
    }

    /// Squared length of what the functions explain, by Cholesky's decomposition. Skips a function that is a
    /// combination of the others.
    fn explained_energy(mut self) -> f64 {
        let mut sum = 0.0;
        for i in 0..N {
            let least = 1e-9 * self.gram[i][i];
            for j in 0..i {
                let inner: f64 = (0..j).map(|k| self.gram[i][k] * self.gram[j][k]).sum();
                self.gram[i][j] = if self.gram[j][j] > 0.0 { (self.gram[i][j] - inner) / self.gram[j][j] } else { 0.0 };
            }
            let inner: f64 = (0..i).map(|k| self.gram[i][k] * self.gram[i][k]).sum();
            let left = self.gram[i][i] - inner;
            self.gram[i][i] = if left > least { left.sqrt() } else { 0.0 };
            for product in &mut self.product {
                let inner: f64 = (0..i).map(|k| self.gram[i][k] * product[k]).sum();
                product[i] = if left > least { (product[i] - inner) / self.gram[i][i] } else { 0.0 };
                sum += product[i] * product[i];
            }
        }
        sum
    }
}

/// Measures how much of the change a disc, in blocks, explains.
pub(super) fn explain_change(change: &BlockChange, circle: Circle) -> ExplainedChange {
    let Circle { centre_px: [cx, cy], radius_px: radius } = circle;
    let levels = &change.levels;
    let span = |centre: f64, size: usize| {
        let (first, last) = (centre - HALO_REACH * radius, centre + HALO_REACH * radius);
        (first.ceil().max(0.0) as usize, (last.floor() + 1.0).clamp(0.0, size as f64) as usize)
    };
    let ((x0, x1), (y0, y1)) = (span(cx, levels.width), span(cy, levels.height));
    let (mut inside, mut around, mut total) = (NormalEquations::<6>::new(), NormalEquations::<3>::new(), 0.0);
    for y in y0..y1 {
        let v = (y as f64 - cy) / radius;
        for x in x0..x1 {
            let u = (x as f64 - cx) / radius;
            let rho = (u * u + v * v).sqrt();
            // Soft rims as wide as a block make the sums continuous in centre and radius, so that the search can climb.
            let seen = ((HALO_REACH - rho) * radius + 0.5).clamp(0.0, 1.0);
            if seen == 0.0 {
                continue;
            }
            let fraction = ((1.0 - rho) * radius + 0.5).clamp(0.0, 1.0);
            let level = levels.at(x, y);
            total += seen * change_energy(level);
            let level = level.map(f64::from);
            if fraction > 0.0 {
                inside.add(fraction, [1.0, u, v, u * u, u * v, v * v], level);
            }
            if fraction < 1.0 {
                let fading = 1.0 / (rho * rho);
                around.add(seen - fraction, [fading, fading * u / rho, fading * v / rho], level);
            }
        }
    }
    ExplainedChange { explained: inside.explained_energy() + around.explained_energy(), total }
}

/// Searches near `start` for the circle with the highest score: steps of `reach` in column, row and radius, halved
/// whenever none improves, down to `finest`.
pub(super) fn climb_hill(start: Circle, reach: f64, finest: f64, score: impl Fn(Circle) -> f64) -> (Circle, f64) {
    let (mut best, mut highest, mut step) = (start, score(start), reach);
    while step > finest {
        let before = highest;
        for axis in 0..3 {
            for sign in [-1.0, 1.0] {
                let mut next = best;
                let value = if axis < 2 { &mut next.centre_px[axis] } else { &mut next.radius_px };
                *value += sign * step;
                let reached = if next.radius_px > 1.0 { score(next) } else { f64::NEG_INFINITY };
                if reached > highest {
                    (best, highest) = (next, reached);
                    break;
                }
            }
        }
        if highest <= before {
            step /= 2.0;
        }
    }
    (best, highest)
}

#[cfg(test)]
mod tests {
    use super::super::change::Drift;
    use super::*;
    use gelsim_core::base::grid::Grid;

    #[test]
    fn climbing_finds_the_top_of_a_slanted_ridge() {
        let hill = |circle: Circle| {
            let ([x, y], r) = (circle.centre_px, circle.radius_px);
            -(x - 5.0).powi(2) - (y + x - 9.0).powi(2) - (r - 3.0 - 0.5 * x + 2.5).powi(2)
        };
        let (top, height) = climb_hill(Circle { centre_px: [0.0, 0.0], radius_px: 9.0 }, 2.0, 1e-4, hill);
        assert!(height > -1e-6, "{top:?}");
        assert!((top.centre_px[0] - 5.0).abs() < 1e-3 && (top.radius_px - 3.0).abs() < 1e-3, "{top:?}");
    }

    #[test]
    fn a_change_of_the_model_is_explained_whole_and_another_is_not() {
        let circle = Circle { centre_px: [20.0, 22.0], radius_px: 9.0 };
        let mut change = BlockChange { block_px: 1, levels: Grid::new(48, 48), drift: Drift::default() };
        for y in 0..48 {
            for x in 0..48 {
                let (u, v) = ((x as f32 - 20.0) / 9.0, (y as f32 - 22.0) / 9.0);
                if u * u + v * v <= 1.0 {
                    change.levels.row_mut(y)[x] = [40.0 * u + 5.0, 3.0 - 20.0 * v, 10.0 * u * v];
                }
            }
        }
        let right = explain_change(&change, circle);
        assert!(right.explained > 0.87 * right.total && right.explained <= right.total, "{right:?}");
        for (dx, dr) in [(3.0, 0.0), (0.0, 3.0), (0.0, -3.0)] {
            let wrong =
                Circle { centre_px: [circle.centre_px[0] + dx, circle.centre_px[1]], radius_px: circle.radius_px + dr };
            assert!(explain_change(&change, wrong).explained < 0.95 * right.explained, "{dx} {dr}");
        }
        let nowhere = explain_change(&change, Circle { centre_px: [-90.0, 20.0], radius_px: 9.0 });
        assert_eq!((nowhere.explained, nowhere.total), (0.0, 0.0));
    }
}
