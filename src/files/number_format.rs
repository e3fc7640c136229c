//! Formats numbers for messages and pages: counts with their nouns, measures with three significant digits.

/// Formats a count with its noun: `1 hole`, `2 holes`.
pub fn format_count(count: usize, one: &str, many: &str) -> String {
    format!("{count} {}", if count == 1 { one } else { many })
}

/// Formats a number with three significant digits, or all digits before the point if there are more, without zeros at
/// the end: 0.0313, 20, 1250.
pub fn format_number(value: f64) -> String {
    if value == 0.0 {
        return String::from("0");
    }
    let magnitude = libm::floor(libm::log10(value.abs()));
    if !(-4.0..7.0).contains(&magnitude) {
        return format!("{value:.2e}");
    }
    let text = format!("{value:.*}", (2.0 - magnitude).max(0.0) as usize);
    if text.contains('.') { text.trim_end_matches('0').trim_end_matches('.').to_owned() } else { text }
}

/// Rounds a bound of a range to few digits, towards the allowed side.
pub fn round_bound(bound: f64, is_upper: bool) -> f64 {
    if bound.fract() == 0.0 || !bound.is_finite() || format!("{bound}").len() <= 8 {
        return bound;
    }
    let digits = libm::pow(10.0, 3.0 - libm::floor(libm::log10(bound.abs())));
    let scaled = bound * digits;
    (if is_upper { scaled.floor() } else { scaled.ceil() }) / digits
}

/// Formats a fraction as a percentage with one decimal.
pub fn format_percent(share: f64) -> String {
    format!("{:.1} %", 100.0 * share)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn figures_have_three_digits_and_no_idle_zeros() {
        let figures = [20.0, 0.031_26, -1.5, 1250.4, 999_999.0, 1e7, 1e-5, 0.000_15, 0.0, 14.96, f64::INFINITY];
        let texts = figures.map(format_number);
        let expected = ["20", "0.0313", "-1.5", "1250", "999999", "1.00e7", "1.00e-5", "0.00015", "0", "15", "inf"];
        assert_eq!(texts, expected);
    }

    #[test]
    fn bounds_in_few_digits_are_allowed() {
        assert_eq!(round_bound(0.060_000_000_000_000_05, true), 0.06);
        assert_eq!(round_bound(229.7, true), 229.7);
        assert_eq!(round_bound(1.0 / 3.0, true), 0.3333);
        assert_eq!(round_bound(1.0 / 3.0, false), 0.3334);
        assert_eq!(round_bound(-1.0 / 3.0, true), -0.3334);
    }
}
