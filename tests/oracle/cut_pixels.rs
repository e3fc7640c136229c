//! Pixels of a coarse grid that walls of the object cut, in f64, pixel by pixel. Both sides of the fine grid are multiples of the
//! factor.

use std::f64::consts::PI;

use gelsim_core::base::grid::Grid;

/// A pixel that a wall cuts.
pub struct Cut {
    /// Of the coarse grid.
    pub at: usize,
    /// mm under pressure 1.
    pub compliance: f64,
    /// By how much it gives way at most, mm.
    pub most: f64,
}

/// The penetration on squares of `factor` pixels of `fine`, and which of them walls cut. `own` is the displacement of a
/// coarse pixel under pressure 1 on itself, mm; `pitch` that of the fine grid.
pub fn cut(fine: &Grid<f64>, factor: usize, pitch: f64, own: f64) -> (Grid<f64>, Vec<Cut>) {
    let (columns, rows) = (fine.width / factor, fine.height / factor);
    let below = |x: usize, y: usize| fine.at(x.min(fine.width - 1), y.min(fine.height - 1)).max(0.0);
    // How much higher than the mean of the four pixels around a point a round object is at it.
    let rounder = |[x, y]: [usize; 2], mean: f64| {
        let inside = |at: usize, size: usize| at >= 2 && at + 1 < size;
        if mean <= 0.0 || !inside(x, fine.width) || !inside(y, fine.height) {
            return 0.0;
        }
        let corners = below(x - 2, y - 2) + below(x + 1, y - 2) + below(x - 2, y + 1) + below(x + 1, y + 1);
        let lower = mean - corners / 4.0;
        lower / 8.0 * (1.0 - lower.abs() / (0.5 * pitch)).max(0.0)
    };
    let (mut data, mut cuts) = (Vec::new(), Vec::new());
    for y in 0..rows {
        for x in 0..columns {
            let (left, top) = (x * factor, y * factor);
            let all: Vec<[usize; 2]> =
                (top..top + factor).flat_map(|y| (left..left + factor).map(move |x| [x, y])).collect();
            let central = |column: usize, row: usize| {
                let [h, v] = [(left + factor / 2, column), (top + factor / 2, row)];
                let [h, v] = [h, v].map(|(first, at)| at == first || at + 1 == first);
                h && v
            };
            let of = |central_only: bool, value: &dyn Fn(f64, [usize; 2]) -> f64| -> f64 {
                let some = all.iter().filter(|[x, y]| !central_only || central(*x, *y));
                some.map(|at| value(below(at[0], at[1]), *at)).sum()
            };
            let highest = all.iter().filter(|[x, y]| central(*x, *y)).map(|[x, y]| fine.at(*x, *y));
            let highest = highest.fold(f64::NEG_INFINITY, f64::max);
            let centre = of(true, &|g, _| g) / 4.0;
            let plain =
                if highest > 0.0 { centre + rounder([left, top].map(|at| at + factor / 2), centre) } else { highest };

            let most = all.iter().map(|[x, y]| below(*x, *y)).fold(0.0, f64::max);
            let least = all.iter().map(|[x, y]| below(*x, *y)).fold(f64::INFINITY, f64::min);
            let mut wall = 0.0_f64;
            for [column, row] in &all {
                for (dx, dy) in [(1, 0), (0, 1)] {
                    if column + dx == left + factor || row + dy == top + factor {
                        continue;
                    }
                    let along = |step: isize| {
                        let at = |at: usize, d: usize| at.saturating_add_signed(step * d as isize);
                        below(at(*column, dx), at(*row, dy))
                    };
                    let (here, next) = (along(0), along(1));
                    let [upper, lower, before, earlier] = match here > next {
                        true => [here, next, along(-1), along(-2)],
                        false => [next, here, along(2), along(3)],
                    };
                    let ahead = (3.0 * (upper - before) + earlier).min(upper);
                    let missing = 2.0 * (ahead - lower) / upper - 1.0;
                    wall = wall.max((upper - lower) / (2.0 * pitch) - 1.0).max(if upper > 0.0 { missing } else { 0.0 });
                }
            }
            let wall = wall.min(1.0);
            let face = |g: f64| (2.0 * (g - least) / (most - least) - 0.5).clamp(0.0, 1.0);
            let covered = of(false, &|g, _| face(g));
            let count = all.len() as f64;
            if most <= 0.0 || wall <= 0.0 || covered == count {
                data.push(plain);
                continue;
            }
            let c = covered / count;
            let away = |at: usize, first: usize| at as f64 - (first as f64 + 0.5 * (factor as f64 - 1.0));
            let right = of(false, &|g, [x, _]| face(g) * away(x, left));
            let down = of(false, &|g, [_, y]| face(g) * away(y, top));
            let mut goes_on = 0.0_f64;
            for (dx, dy) in (-1..=1).flat_map(|dy| (-1..=1).map(move |dx| (dx, dy))).filter(|step| *step != (0, 0)) {
                let cosine = (dx as f64 * right + dy as f64 * down) / right.hypot(down) / (dx as f64).hypot(dy as f64);
                if cosine > 0.64 {
                    let x = x.saturating_add_signed(dx).min(columns - 1) * factor + factor / 2;
                    let y = y.saturating_add_signed(dy).min(rows - 1) * factor + factor / 2;
                    for [h, v] in [[1, 1], [0, 1], [1, 0], [0, 0]] {
                        goes_on = goes_on.max(face(below(x - h, y - v)));
                    }
                }
            }
            let (edge, ridge) = (0.911 * (1.0 - c) / c, ((4.0 / c).ln() / PI - 0.539).max(0.0));
            let compliance = wall * own / 0.561 * (ridge + goes_on * (edge - ridge));
            let weight = |g: f64, at: [usize; 2]| face(g) * if central(at[0], at[1]) { 4.0 } else { 1.0 };
            let part = of(false, &|g, at| weight(g, at) * g) / of(false, &weight);
            let penetration = centre + wall * (part - centre);
            let most = (penetration - of(false, &|g, _| g) / count).max(0.0);
            cuts.push(Cut { at: data.len(), compliance, most });
            data.push(penetration);
        }
    }
    (Grid { width: columns, height: rows, data }, cuts)
}
