//! Numbers as messages and pages write them: counts with their nouns, measures with three significant digits.

/// `1 hole`, `2 holes`.
pub fn counted(count: usize, one: &str, many: &str) -> String {
    format!("{count} {}", if count == 1 { one } else { many })
}

/// Three significant digits, more before the point where there are more, and no zeros at the end: 0.0313, 20, 1250.
pub fn figure(value: f64) -> String {
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

/// A share of one in percent, with one decimal.
pub fn percent(share: f64) -> String {
    format!("{:.1} %", 100.0 * share)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn figures_have_three_digits_and_no_idle_zeros() {
        let figures = [20.0, 0.031_26, -1.5, 1250.4, 999_999.0, 1e7, 1e-5, 0.000_15, 0.0, 14.96, f64::INFINITY];
        let texts = figures.map(figure);
        let expected = ["20", "0.0313", "-1.5", "1250", "999999", "1.00e7", "1.00e-5", "0.00015", "0", "15", "inf"];
        assert_eq!(texts, expected);
    }
}
