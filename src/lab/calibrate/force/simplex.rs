//! Searches for the least value of a function of few variables without its derivatives.

/// Most rounds of a search.
const MAX_ROUNDS: usize = 300;
/// Relative difference of values at which a search ends.
const TOLERANCE: f64 = 1e-10;

/// Searches for the place of the least value by the simplex of Nelder and Mead (1965), from a start and steps along
/// each variable. Values that are not numbers count as infinite.
pub(super) fn minimise(start: Vec<f64>, steps: &[f64], value: impl Fn(&[f64]) -> f64) -> Vec<f64> {
    let value = |at: &[f64]| Some(value(at)).filter(|value| !value.is_nan()).unwrap_or(f64::INFINITY);
    let count = start.len();
    let mut corners: Vec<(f64, Vec<f64>)> = vec![(value(&start), start.clone())];
    for k in 0..count {
        let mut at = start.clone();
        at[k] += steps[k];
        corners.push((value(&at), at));
    }
    for _ in 0..MAX_ROUNDS {
        corners.sort_by(|a, b| a.0.total_cmp(&b.0));
        let (best, worst, second) = (corners[0].0, corners[count].0, corners[count.saturating_sub(1)].0);
        let width = (0..count)
            .map(|k| corners.iter().map(|(_, at)| (at[k] - corners[0].1[k]).abs() / steps[k]).fold(0.0, f64::max))
            .fold(0.0, f64::max);
        if (worst - best <= TOLERANCE * best.abs() && width < 1e-2) || width < 1e-7 || !best.is_finite() {
            break;
        }
        let middle: Vec<f64> =
            (0..count).map(|k| corners[..count].iter().map(|(_, at)| at[k]).sum::<f64>() / count as f64).collect();
        let along = |factor: f64| -> (f64, Vec<f64>) {
            let at: Vec<f64> = (0..count).map(|k| middle[k] + factor * (corners[count].1[k] - middle[k])).collect();
            (value(&at), at)
        };
        let reflected = along(-1.0);
        let replaced = if reflected.0 < best {
            let expanded = along(-2.0);
            if expanded.0 < reflected.0 { expanded } else { reflected }
        } else if reflected.0 < second {
            reflected
        } else {
            let contracted = if reflected.0 < worst { along(-0.5) } else { along(0.5) };
            if contracted.0 < worst.min(reflected.0) {
                contracted
            } else {
                let best = corners[0].1.clone();
                for (at_value, at) in &mut corners[1..] {
                    for k in 0..count {
                        at[k] = 0.5 * (at[k] + best[k]);
                    }
                    *at_value = value(at);
                }
                continue;
            }
        };
        corners[count] = replaced;
    }
    corners.sort_by(|a, b| a.0.total_cmp(&b.0));
    corners.swap_remove(0).1
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_bottoms_of_a_bowl_and_of_a_curved_valley_are_found() {
        let bowl = minimise(vec![1.0], &[0.3], |x| (x[0] - 2.5) * (x[0] - 2.5) + 1.0);
        assert!((bowl[0] - 2.5).abs() < 1e-3, "{bowl:?}");
        let valley = |x: &[f64]| (1.0 - x[0]).powi(2) + 10.0 * (x[1] - x[0] * x[0]).powi(2);
        let found = minimise(vec![-0.5, 0.5], &[0.3, 0.3], valley);
        assert!((found[0] - 1.0).abs() < 1e-2 && (found[1] - 1.0).abs() < 2e-2, "{found:?}");
        assert_eq!(minimise(vec![1.0], &[0.3], |_| f64::NAN).len(), 1);
    }
}
