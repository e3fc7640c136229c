//! Median, quantiles, and the Pareto front of choices that no other choice beats.
//!
//! Quantiles are interpolated linearly between order statistics, as numpy does by default (Hyndman and Fan 1996,
//! type 7).

/// Median of `values`; of an even number the mean of the middle two. None without values, NaN if one is NaN.
pub fn median(values: &[f64]) -> Option<f64> {
    quantile(values, 0.5)
}

/// The value below which the fraction `q` (0 to 1, clamped) of `values` lies. None without values, NaN if there is one
/// among them or `q` is.
pub fn quantile(values: &[f64], q: f64) -> Option<f64> {
    if values.is_empty() {
        return None;
    }
    if q.is_nan() || values.iter().any(|value| value.is_nan()) {
        return Some(f64::NAN);
    }
    let mut values = values.to_vec();
    let position = (values.len() - 1) as f64 * q.clamp(0.0, 1.0);
    let (_, &mut low, above) = values.select_nth_unstable_by(position as usize, f64::total_cmp);
    let high = above.iter().copied().min_by(f64::total_cmp).unwrap_or(low);
    let fraction = position.fract();
    // The ends are returned as they are: infinities would give NaN.
    Some(if fraction == 0.0 || low == high { low } else { low + (high - low) * fraction })
}

/// For each (cost, error), true if it is on the Pareto front: no other is at most as large in both and smaller in one.
///
/// Equal points stay on the front together. Points with NaN are never on it and beat none.
pub fn pareto_front(points: &[(f64, f64)]) -> Vec<bool> {
    let beats = |a: &(f64, f64), b: &(f64, f64)| a.0 <= b.0 && a.1 <= b.1 && (a.0 < b.0 || a.1 < b.1);
    points
        .iter()
        .map(|point| !point.0.is_nan() && !point.1.is_nan() && !points.iter().any(|other| beats(other, point)))
        .collect()
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    #[test]
    fn quantiles_are_those_of_numpy() {
        // numpy.quantile([7, 1, 5, 2.5, 11], [0, 0.1, 0.5, 0.95, 1])
        let values = [7.0, 1.0, 5.0, 2.5, 11.0];
        for (q, expected) in [(0.0, 1.0), (0.1, 1.6), (0.5, 5.0), (0.95, 10.2), (1.0, 11.0)] {
            let found = quantile(&values, q).unwrap();
            assert!((found - expected).abs() < 1e-12, "{q}: {found} instead of {expected}");
        }
        assert_eq!(median(&[4.0, 1.0, 3.0, 2.0]), Some(2.5));
    }

    #[test]
    fn odd_values_have_a_quantile_too() {
        assert_eq!(quantile(&[], 0.5), None);
        assert_eq!(quantile(&[3.0], 0.95), Some(3.0));
        assert_eq!(quantile(&[3.0, 4.0], 2.0), Some(4.0));
        assert_eq!(median(&[f64::INFINITY, f64::INFINITY]), Some(f64::INFINITY));
        assert!(median(&[1.0, f64::NAN]).unwrap().is_nan());
        assert!(quantile(&[1.0, 2.0], f64::NAN).unwrap().is_nan());
    }

    #[test]
    fn ties_and_copies_on_the_front_are_told_apart() {
        let points = [(1.0, 5.0), (1.0, 4.0), (2.0, 4.0), (3.0, 1.0), (3.0, 1.0), (f64::NAN, 0.0), (4.0, 2.0)];
        assert_eq!(pareto_front(&points), [false, true, false, true, true, false, false]);
    }

    proptest! {
        /// Plain reference implementation: along the order of cost, a point is on the front if its error is the least
        /// so far.
        #[test]
        fn the_front_is_what_a_walk_along_the_cost_finds(points in prop::collection::vec((0u8..6, 0u8..6), 0..30)) {
            let points: Vec<(f64, f64)> = points.iter().map(|p| (p.0.into(), p.1.into())).collect();
            let on_front = pareto_front(&points);
            for (point, on_front) in points.iter().zip(on_front) {
                let least_before = points.iter().filter(|p| p.0 < point.0).map(|p| p.1).fold(f64::INFINITY, f64::min);
                let least_here = points.iter().filter(|p| p.0 == point.0).map(|p| p.1).fold(f64::INFINITY, f64::min);
                prop_assert_eq!(on_front, point.1 == least_here && point.1 < least_before);
            }
        }

        #[test]
        fn a_quantile_agrees_with_sorting(values in prop::collection::vec(-1e6f64..1e6, 1..60), q in 0.0f64..=1.0) {
            let mut sorted = values.clone();
            sorted.sort_by(f64::total_cmp);
            let at = q * (values.len() - 1) as f64;
            let (low, high) = (sorted[at.floor() as usize], sorted[at.ceil() as usize]);
            let expected = low * (1.0 - at.fract()) + high * at.fract();
            prop_assert!((quantile(&values, q).unwrap() - expected).abs() < 1e-9);
        }
    }
}
