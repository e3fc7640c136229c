//! Slips of syntax that many people make, and the way out of each.

/// The way out of the slip of syntax that was found at byte `at`, if it is one of those.
pub fn help(text: &str, at: usize) -> Option<&'static str> {
    if is_json(text) {
        return Some("this looks like JSON; a job is TOML: gelsim init writes one to start from");
    }
    let at = (0..=at.min(text.len())).rev().find(|at| text.is_char_boundary(*at)).unwrap_or(0);
    let start = text[..at].rfind('\n').map_or(0, |end| end + 1);
    let line = text[start..].lines().next().unwrap_or_default();
    let value = line.split_once('=').map_or(line, |(_, value)| value);
    if has_decimal_comma(value) {
        return Some("numbers have a decimal point: 0.5");
    }
    if value.contains('\\') && value.contains('"') {
        return Some(
            "in \"..\" a backslash begins an escape: write / between folders, or put the path in single quotes",
        );
    }
    None
}

/// True of a text that begins as JSON does and TOML does not.
pub fn is_json(text: &str) -> bool {
    text.trim_start_matches('\u{feff}').trim_start().starts_with('{')
}

/// `0,5`, and no list.
fn has_decimal_comma(value: &str) -> bool {
    let value = value.split('#').next().unwrap_or_default().trim();
    let is_number = |part: &str| !part.is_empty() && part.chars().all(|c| c.is_ascii_digit());
    value
        .strip_prefix(['-', '+'])
        .unwrap_or(value)
        .split_once(',')
        .is_some_and(|(whole, rest)| is_number(whole) && is_number(rest))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn slips_are_known_by_their_line() {
        let of = |text: &str| help(text, text.find('=').map_or(0, |at| at + 2)).unwrap_or_default();
        assert!(of("a = 0,5").contains("decimal point") && of("a = -1,25 # mm").contains("decimal point"));
        assert!(of("{\n\"a\": 1}").contains("JSON"));
        assert!(of("a = \"C:\\m\\c.stl\"").contains("backslash"));
        for other in ["a = [0,5]", "a = 1,", "a = x", "", "a = 1.0,2.0"] {
            assert_eq!(of(other), "", "{other}");
        }
    }
}
