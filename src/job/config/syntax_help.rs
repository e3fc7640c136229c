//! Recognises common slips of TOML syntax, and says how to fix each.

/// Recognises a text in another format, JSON or YAML. Returns the format's name and what to do, or `None`.
pub fn detect_other_format(text: &str) -> Option<(&'static str, &'static str)> {
    if is_json(text) {
        return Some((
            "JSON",
            "TOML belongs here: `{\"dataset\": {\"samples\": 10}}` reads [dataset] and samples = 10; gelsim init writes a job to start from",
        ));
    }
    if is_yaml(text) {
        return Some((
            "YAML",
            "TOML belongs here: `dataset:` reads [dataset], `samples: 10` reads samples = 10; gelsim init writes a job to start from",
        ));
    }
    None
}

/// Suggests the fix of the syntax error at byte `at`, if it is a common one.
pub fn suggest_fix(text: &str, at: usize) -> Option<String> {
    let at = (0..=at.min(text.len())).rev().find(|at| text.is_char_boundary(*at)).unwrap_or(0);
    let start = text[..at].rfind('\n').map_or(0, |end| end + 1);
    let line = text[start..].lines().next().unwrap_or_default();
    let value = line.split_once('=').map_or(line, |(_, value)| value);
    if let Some(help) = suggest_for_comma(value) {
        return Some(help);
    }
    if let Some((key, bare)) = line.split_once('=') {
        let (key, bare) = (key.trim(), bare.split('#').next().unwrap_or_default().trim());
        let is_word = |text: &str| text.starts_with(char::is_alphabetic) && !text.contains(['"', '\'', '[', '{', '=']);
        if let Some(rest) = bare.strip_suffix([',', ';']) {
            return Some(format!("write `{key} = {}`, without the {}", rest.trim(), &bare[rest.len()..]));
        }
        if is_word(bare) && !["true", "false", "inf", "nan"].contains(&bare) {
            return Some(match bare {
                "True" | "False" => format!("write `{key} = {}`", bare.to_lowercase()),
                "None" | "null" | "nil" => String::from("leave it out: a key that is not there has its default"),
                _ => format!("write `{key} = {bare:?}`: text stands in quotes"),
            });
        }
    } else if let Some((key, value)) = line.split_once(':').filter(|(key, _)| is_bare_key(key)) {
        return Some(format!("write `{} = {}`", key.trim(), value.trim().trim_end_matches(',')));
    }
    if value.contains('\\') && value.contains('"') {
        return Some(format!(
            "in \"..\" a backslash begins an escape: write / between folders, {}",
            value.trim().replace('\\', "/")
        ));
    }
    None
}

/// Finds the line, counted from 1, of the key or table that a later one at byte `at` duplicates.
pub fn find_first_duplicate(text: &str, at: usize) -> Option<usize> {
    let key = |line: &str| {
        let line = line.trim_start();
        match line.starts_with('[') {
            true => line.trim_end().to_owned(),
            false => line.split('=').next().unwrap_or_default().trim().to_owned(),
        }
    };
    let at = (0..=at.min(text.len())).rev().find(|at| text.is_char_boundary(*at))?;
    let start = text[..at].rfind('\n').map_or(0, |end| end + 1);
    let doubled = key(text[start..].lines().next()?);
    let before: Vec<&str> = text[..start].lines().collect();
    before.iter().rposition(|line| key(line) == doubled).map(|line| line + 1)
}

/// Returns true for a text that begins as JSON does and TOML cannot.
fn is_json(text: &str) -> bool {
    text.trim_start_matches('\u{feff}').trim_start().starts_with('{')
}

/// Returns true for a text whose first line has a key as YAML writes it.
fn is_yaml(text: &str) -> bool {
    let is_said = |line: &&str| !line.is_empty() && !line.starts_with('#') && *line != "---";
    let first = text.trim_start_matches('\u{feff}').lines().map(str::trim_end).find(is_said).unwrap_or_default();
    let (key, rest) = first.split_once(':').unwrap_or_default();
    let is_key = !key.is_empty() && key.chars().all(|c| c.is_alphanumeric() || matches!(c, '_' | '-'));
    is_key && (rest.is_empty() || rest.starts_with(' ')) && !first.contains('=')
}

/// Returns true for a text that may be a bare key.
fn is_bare_key(text: &str) -> bool {
    let text = text.trim();
    !text.is_empty() && text.chars().all(|c| c.is_ascii_alphanumeric() || matches!(c, '_' | '-' | '.'))
}

/// Suggests what `0,5`, `3,000` or `0.2, 1.0` without brackets should be. Returns `None` if there is no such comma.
fn suggest_for_comma(value: &str) -> Option<String> {
    let value = value.split('#').next().unwrap_or_default().trim();
    if value.starts_with(['[', '{', '"', '\'']) {
        return None;
    }
    let parts: Vec<&str> = value.split(',').map(str::trim).collect();
    let is_number = |part: &&str| part.parse::<f64>().is_ok_and(f64::is_finite);
    if parts.len() < 2 || !parts.iter().all(is_number) {
        return None;
    }
    let digits = |part: &str| part.trim_start_matches(['-', '+']).chars().all(|c| c.is_ascii_digit());
    let (list, joined) = (parts.join(", "), parts.concat());
    let tight = !value.contains(' ') && parts.iter().all(|part| digits(part));
    Some(match parts[1..].iter().all(|part| part.len() == 3) {
        true if tight => format!("write {joined}, or {} with a decimal point", parts.join(".")),
        _ if tight && parts.len() == 2 => format!("numbers have a decimal point: {}", parts.join(".")),
        _ => format!("a range or list stands in brackets: [{list}]"),
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn slips_are_known_by_their_line() {
        let of = |text: &str| suggest_fix(text, text.find('=').map_or(0, |at| at + 2)).unwrap_or_default();
        assert_eq!(of("a = 0,5"), "numbers have a decimal point: 0.5");
        assert_eq!(of("a = -1,25 # mm"), "numbers have a decimal point: -1.25");
        assert_eq!(of("samples = 3,000"), "write 3000, or 3.000 with a decimal point");
        assert_eq!(of("a = 0.2, 1.5"), "a range or list stands in brackets: [0.2, 1.5]");
        assert_eq!(of("a = 1.0,2.0"), "a range or list stands in brackets: [1.0, 2.0]");
        assert!(of("a = \"C:\\m\\c.stl\"").ends_with("write / between folders, \"C:/m/c.stl\""));
        assert_eq!(of("a = 1,"), "write `a = 1`, without the ,");
        assert_eq!(of("name = my-set"), "write `name = \"my-set\"`: text stands in quotes");
        assert_eq!(of("a = True"), "write `a = true`");
        assert_eq!(suggest_fix("samples: 4", 7).unwrap_or_default(), "write `samples = 4`");
        for other in ["a = [0,5]", "a = 1", ""] {
            assert_eq!(of(other), "", "{other}");
        }
    }

    #[test]
    fn other_formats_are_known_by_their_first_line() {
        let of = |text: &str| detect_other_format(text).map_or("", |(name, _)| name);
        assert_eq!(of("{\n\"a\": 1}"), "JSON");
        for yaml in ["dataset:\n  name: x\n", "# a job\n---\nfidelity: high\n", "- a: 1\n"] {
            assert_eq!(of(yaml), if yaml.starts_with('-') { "" } else { "YAML" }, "{yaml}");
        }
        for toml in ["a = 1\n", "[dataset]\nname = \"a: b\"\n", "# only: a comment\n", ""] {
            assert_eq!(of(toml), "", "{toml}");
        }
    }

    #[test]
    fn a_double_is_told_where_the_first_stands() {
        let text = "[a]\nx = 1\ny = 2\nx = 3\n[a]\n";
        assert_eq!(find_first_duplicate(text, text.find("x = 3").expect("it is there")), Some(2));
        assert_eq!(find_first_duplicate(text, text.rfind("[a]").expect("it is there")), Some(1));
    }
}
