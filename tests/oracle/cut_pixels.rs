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

/// What lies between two pixels.
struct Between {
    /// How much of a wall, 0 to 1.
    share: f64,
    /// Slope of the face before it; where it is shallow, as a share of half its depth.
    steepness: f64,
    /// By how much the face before it changes from pixel to pixel towards the wall, mm.
    change: f64,
}

/// The walls between pixels of a penetration.
struct Walls<'a> {
    fine: &'a Grid<f64>,
    pitch: f64,
}

impl Walls<'_> {
    fn below(&self, x: usize, y: usize) -> f64 {
        self.fine.at(x.min(self.fine.width - 1), y.min(self.fine.height - 1)).max(0.0)
    }

    /// What lies between two neighbours, from the one to the other.
    fn between(&self, from: [usize; 2], to: [usize; 2]) -> Between {
        let [upper, lower] =
            if self.below(from[0], from[1]) > self.below(to[0], to[1]) { [from, to] } else { [to, from] };
        let inwards = |steps: isize| {
            let at = |k: usize| upper[k].saturating_add_signed(steps * (upper[k] as isize - lower[k] as isize));
            self.below(at(0), at(1))
        };
        let ([before, earlier], [upper, lower]) =
            ([1, 2].map(inwards), [upper, lower].map(|at| self.below(at[0], at[1])));
        let ahead = (3.0 * (upper - before) + earlier).min(upper);
        let missing = if upper > 0.0 { 2.0 * (ahead - lower) / upper - 1.0 } else { 0.0 };
        let share = ((upper - lower) / (2.0 * self.pitch) - 1.0).max(missing).clamp(0.0, 1.0);
        let (last, inner) = (upper - before, before - earlier);
        let flat_mm = (0.5 * upper).min(self.pitch).max(f64::MIN_POSITIVE);
        let steepness = last.abs().max(inner.abs()) / flat_mm;
        Between {
            share,
            steepness,
            change: if last * inner > 0.0 { last.signum() * last.abs().min(inner.abs()) } else { 0.0 },
        }
    }

    /// The neighbours of a pixel, and what is between.
    fn around(&self, [x, y]: [usize; 2]) -> Vec<([usize; 2], Between)> {
        let all = [(x.wrapping_sub(1), y), (x + 1, y), (x, y.wrapping_sub(1)), (x, y + 1)];
        let inside = all.into_iter().filter(|(x, y)| *x < self.fine.width && *y < self.fine.height);
        inside.map(|(next_x, next_y)| ([next_x, next_y], self.between([x, y], [next_x, next_y]))).collect()
    }
}

/// How much compliance the pixels of a penetration have less, mm under pressure 1, as they end at a wall. `lags` is their response.
pub fn edges(fine: &Grid<f64>, pitch: f64, lags: &Grid<f64>) -> Vec<f64> {
    let walls = Walls { fine, pitch };
    let edge = |at: usize| {
        let at = [at % fine.width, at / fine.width];
        let ends =
            walls.around(at).into_iter().filter(|(next, _)| walls.below(next[0], next[1]) < walls.below(at[0], at[1]));
        let ends = ends.map(|(_, wall)| wall.share * (1.0 - wall.steepness).max(0.0));
        -0.1 * sharing(lags) * lags.at(0, 0) / 0.561 * ends.fold(0.0, f64::max)
    };
    (0..fine.data.len()).map(edge).collect()
}

/// How much of a pixel's pressure moves the next one, against a half-space.
fn sharing(lags: &Grid<f64>) -> f64 {
    (lags.at(1, 0) / lags.at(0, 0) / 0.284).clamp(0.0, 1.0)
}

/// The penetration on squares of `factor` pixels of `fine`, and which of them walls cut. `lags` is the response of these
/// squares; `pitch` is that of the fine grid.
pub fn cut(fine: &Grid<f64>, factor: usize, pitch: f64, lags: &Grid<f64>) -> (Grid<f64>, Vec<Cut>) {
    let (columns, rows) = (fine.width / factor, fine.height / factor);
    let (walls, own, sharing) = (Walls { fine, pitch }, lags.at(0, 0), sharing(lags));
    let below = |x: usize, y: usize| walls.below(x, y);
    let deepest = fine.data.iter().copied().fold(0.0, f64::max);
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
            let (mut inside, mut beside, mut above) = (0.0_f64, 0.0_f64, f64::NEG_INFINITY);
            for at in &all {
                for (next, wall) in walls.around(*at) {
                    if all.contains(&next) {
                        inside = inside.max(wall.share);
                    } else if wall.share > 0.0 && below(next[0], next[1]) > below(at[0], at[1]) {
                        let [higher, lower] = [next, *at].map(|at| below(at[0], at[1]));
                        (beside, above) =
                            (beside.max(wall.share), above.max(lower + (higher - lower) * (4.0 * wall.share).min(1.0)));
                    }
                }
            }
            let higher = ((above - most) / (above - least)).max(0.0);
            let (mut compliance, mut drop) = (0.0, 0.0);
            // The wall in the pixel, and the one beside it.
            for (top_mm, bottom_mm, steepest, weight) in
                [(most, least, inside, inside), (above, most, beside, (1.0 - inside) * beside * higher)]
            {
                if weight <= 0.0 {
                    continue;
                }
                let face =
                    |[x, y]: [usize; 2]| (2.0 * (below(x, y) - bottom_mm) / (top_mm - bottom_mm) - 0.5).clamp(0.0, 1.0);
                // Of an object larger by 0.18 of the coarse pixels: share, penetration; slopes along x and y, and how much they count.
                let larger = |at: [usize; 2]| {
                    let own = (face(at), below(at[0], at[1]));
                    let (mut beside, mut weights, mut depth, mut slopes) = ([0.0_f64; 2], 0.0, 0.0, [[0.0; 2]; 2]);
                    for (next, wall) in walls.around(at) {
                        let (k, upper) = (usize::from(next[0] == at[0]), below(next[0], next[1]));
                        if own.0 < 1.0 && upper > own.1 {
                            let rising = (2.0 - 0.5 * wall.steepness).clamp(0.0, 1.0);
                            let share = rising * face(next) * (wall.share / steepest).min(1.0);
                            beside[k] = beside[k].max(share);
                            weights += share;
                            depth += share * (upper + wall.change);
                            slopes[k][0] += share * wall.change * (at[k] as f64 - next[k] as f64);
                            slopes[k][1] += share;
                        }
                    }
                    let share = (0.18 * sharing * factor as f64 * beside[0].hypot(beside[1])).min(1.0);
                    if share <= own.0 {
                        return (own.0, own.1, slopes);
                    }
                    (share, (own.0 * own.1 + (share - own.0) * (depth / weights).max(own.1)) / share, slopes)
                };
                let count = all.len() as f64;
                let covered: f64 = all.iter().map(|at| face(*at)).sum();
                let parts: Vec<_> = all.iter().map(|at| (*at, larger(*at))).collect();
                let grown: f64 = parts.iter().map(|(_, part)| part.0).sum();
                if covered == count || grown == 0.0 {
                    continue;
                }
                let away = |at: usize, first: usize| at as f64 - (first as f64 + 0.5 * (factor as f64 - 1.0));
                let towards = |k: usize, first: usize| -> f64 {
                    parts.iter().map(|(at, part)| part.0 * away(at[k], first)).sum()
                };
                let (right, down) = (towards(0, left), towards(1, top));
                let mut goes_on = 0.0_f64;
                for (dx, dy) in (-1..=1).flat_map(|dy| (-1..=1).map(move |dx| (dx, dy))).filter(|step| *step != (0, 0))
                {
                    let cosine =
                        (dx as f64 * right + dy as f64 * down) / right.hypot(down) / (dx as f64).hypot(dy as f64);
                    let counts = ((cosine - 0.6) / 0.1).clamp(0.0, 1.0);
                    if counts > 0.0 {
                        let x = x.saturating_add_signed(dx).min(columns - 1) * factor + factor / 2;
                        let y = y.saturating_add_signed(dy).min(rows - 1) * factor + factor / 2;
                        for [h, v] in [[1, 1], [0, 1], [1, 0], [0, 0]] {
                            goes_on = goes_on.max(counts * face([x - h, y - v]));
                        }
                    }
                }
                goes_on *= (right.hypot(down) / (0.1 * factor as f64 * grown)).min(1.0);
                let c = (covered + goes_on * (grown - covered)) / count;
                if c == 0.0 {
                    continue;
                }
                let (edge, ridge) = (0.911 * (1.0 - c) / c, ((4.0 / c).ln() / PI - 0.539).max(0.0));
                compliance += weight * own / 0.561 * (ridge + goes_on * (edge - ridge));
                let heavy = |at: [usize; 2], share: f64| share * if central(at[0], at[1]) { 4.0 } else { 1.0 };
                let sum = |of: &dyn Fn([usize; 2], f64) -> f64| -> f64 {
                    parts.iter().map(|(at, part)| heavy(*at, part.0) * of(*at, part.1)).sum()
                };
                let weights = sum(&|_, _| 1.0);
                let mut face_mm = sum(&|_, g| g) / weights;
                for (k, first) in [left, top].into_iter().enumerate() {
                    let [slopes, counts] =
                        [0, 1].map(|which| parts.iter().map(|(_, part)| part.2[k][which]).sum::<f64>());
                    let slope = slopes / counts.max(1.0);
                    face_mm -= slope * sum(&|at, _| away(at[k], first)) / weights;
                }
                drop += weight * (face_mm.min(deepest) - plain.max(0.0));
            }
            if compliance == 0.0 && drop == 0.0 {
                data.push(plain);
                continue;
            }
            let penetration = plain.max(0.0) + drop;
            let most = (penetration - of(false, &|g, _| g) / all.len() as f64).max(0.0);
            cuts.push(Cut { at: data.len(), compliance, most });
            data.push(penetration);
        }
    }
    (Grid { width: columns, height: rows, data }, cuts)
}
