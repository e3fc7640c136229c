//! Recognises common slips of TOML syntax, and says how to fix each.

use toml::de::DeTable;

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

/// Suggests the fix of the syntax error at byte `at`. A line to write instead is TOML: each repair is parsed before it
/// is suggested.
pub fn suggest_fix(text: &str, at: usize) -> String {
    /// Longer lines are looked at by nobody.
    const LONGEST: usize = 2000;
    let at = (0..=at.min(text.len())).rev().find(|at| text.is_char_boundary(*at)).unwrap_or(0);
    let start = text[..at].rfind('\n').map_or(0, |end| end + 1);
    let here = text[start..].lines().next().unwrap_or_default().trim();
    // What is not closed is missed in the line below.
    let above = || text[..start].lines().rev().map(str::trim).find(|line| !line.is_empty());
    let line = if is_toml(here) { above().unwrap_or(here) } else { here };
    let known = if line.len() > LONGEST { None } else { explain_line(line).or_else(|| repair_line(line)) };
    known.unwrap_or_else(|| {
        String::from("a line is a [table], `key = value` or a # comment; text stands in \"..\", a list in [..]")
    })
}

/// Returns true if a line is TOML by itself.
fn is_toml(line: &str) -> bool {
    DeTable::parse(line).is_ok()
}

/// Explains a slip for which there is no line to write instead, or more than one.
fn explain_line(line: &str) -> Option<String> {
    if ["<<<<<<<", "=======", ">>>>>>>"].iter().any(|mark| line.starts_with(mark)) {
        return Some(String::from("Git left this mark of two versions: keep one of them, without the marks"));
    }
    if line.starts_with("- ") {
        return Some(String::from("a list stands in brackets, after its key: key = [1.0, 2.0]"));
    }
    let (key, value) = split_assignment(line)?;
    match value {
        "" => Some(format!("write a value behind `{key} =`, or leave the line out")),
        "None" | "null" | "nil" => Some(String::from("leave it out: a key that is not there has its default")),
        _ if value.contains('\\') && value.starts_with('"') => Some(format!(
            "in \"..\" a backslash begins an escape: write / between folders, {}",
            value.replace('\\', "/")
        )),
        _ => suggest_for_comma(value).or_else(|| split_second_key(&key, value)),
    }
}

/// Repairs a line in one of the ways in which lines are often wrong. Returns what to write, and why.
fn repair_line(line: &str) -> Option<String> {
    let typed: String = line.chars().map(plain_char).collect();
    let mut repairs: Vec<(String, &str)> =
        vec![(typed.clone(), "these characters look like those of TOML, and are others")];
    for mark in ["//", ";", "--", "%"] {
        repairs.extend(typed.strip_prefix(mark).map(|rest| (format!("# {}", rest.trim()), "a comment begins with #")));
    }
    repairs.push((typed.replacen(" //", " #", 1), "a comment begins with #"));
    if typed.starts_with('[') && !typed.contains('=') {
        let name = typed.split('#').next().unwrap_or_default().trim().trim_matches(['[', ']']).trim();
        let listed = typed.starts_with("[[") || typed.contains("]]");
        let header = if listed { format!("[[{name}]]") } else { format!("[{name}]") };
        repairs.push((header, "a header is closed as it is opened"));
    }
    if let Some((key, value)) = split_assignment(&typed) {
        repairs.extend(repair_value(value).into_iter().map(|(value, why)| (format!("{key} = {value}"), why)));
    }
    let (good, why) = repairs.into_iter().find(|(repaired, _)| repaired != line && is_toml(repaired))?;
    Some(if why.is_empty() { format!("write `{good}`") } else { format!("write `{good}`: {why}") })
}

/// Returns the plain character for one that a word processor or a web page puts in its place.
fn plain_char(typed: char) -> char {
    match typed {
        '\u{201c}' | '\u{201d}' | '\u{201e}' | '\u{ab}' | '\u{bb}' => '"',
        '\u{2018}' | '\u{2019}' | '\u{201a}' => '\'',
        '\u{2010}'..='\u{2015}' | '\u{2212}' => '-',
        '\u{a0}' | '\u{2000}'..='\u{200a}' | '\u{202f}' | '\u{3000}' => ' ',
        '\u{ff1d}' => '=',
        _ => typed,
    }
}

/// Splits a line that was meant as `key = value`, also if another sign or only a blank stands between them. A comment
/// is left out.
fn split_assignment(line: &str) -> Option<(String, &str)> {
    let signs = ["=>", "->", ":=", "==", "=", ":"];
    let found = signs.iter().filter_map(|sign| Some((line.find(sign)?, sign.len())));
    let sign = found.min_by_key(|(at, length)| (*at, std::cmp::Reverse(*length)));
    let (end, length) = sign.or_else(|| Some((line.find(char::is_whitespace)?, 0)))?;
    let key = line[..end].split_whitespace().collect::<Vec<_>>().join("_");
    let value = line[end + length..].split('#').next().unwrap_or_default().trim();
    let is_meant = sign.is_some() || is_toml(&format!("{key} = {value}"));
    (is_bare_key(&key) && is_meant).then_some((key, value))
}

/// Suggests two lines for two keys that stand in one.
fn split_second_key(key: &str, value: &str) -> Option<String> {
    let sign = value.find('=').filter(|_| !value.starts_with(['{', '[']))?;
    let before = value[..sign].trim_end();
    let start = before.rfind([' ', ',', ';', '\t'])? + 1;
    let first = format!("{key} = {}", before[..start].trim_end_matches([' ', ',', ';', '\t']));
    let second = &value[start..];
    (is_toml(&first) && is_toml(second)).then(|| format!("each key has a line of its own: `{first}`, then `{second}`"))
}

/// Lists what a value may have been meant as, likeliest first, with the reason.
fn repair_value(value: &str) -> Vec<(String, &'static str)> {
    let mut meant = vec![(value.to_owned(), "")];
    if let Some(rest) = value.strip_suffix([',', ';']) {
        meant.push((rest.trim().to_owned(), "nothing stands behind a value"));
    }
    let word = value.to_lowercase();
    match &*word {
        "true" | "yes" | "on" => meant.push((String::from("true"), "")),
        "false" | "no" | "off" => meant.push((String::from("false"), "")),
        _ => {}
    }
    meant.extend(repair_number(value));
    for between in ["..=", "..", " to ", "-"] {
        let ends = value.split_once(between).map(|(low, high)| [low, high].map(|end| read_number(end.trim())));
        if let Some([Some(low), Some(high)]) = ends {
            meant.push((format!("[{low}, {high}]"), "a range stands in brackets"));
        }
    }
    if let Some(inner) = value.strip_prefix('(').and_then(|rest| rest.strip_suffix(')')) {
        meant.push((format!("[{inner}]"), "a range or list stands in brackets"));
    }
    meant.push((format!("{value}{}", missing_brackets(value)), "what is opened is closed"));
    if value.starts_with(['{', '[']) {
        meant.push((value.replace(": ", " = ").replace(":", " = "), "a key and its value have = between them"));
        meant.push((value.replace(",,", ","), "one comma stands between two values"));
    }
    let text = value.trim_matches(['"', '\'']);
    let is_quoted = value.starts_with(['"', '\'']) || value.ends_with(['"', '\'']);
    let is_word = text.starts_with(|first: char| first.is_alphabetic() || matches!(first, '~' | '/' | '.'));
    if !text.contains(['"', '\'', '[', '{', '=', '\\']) && (is_quoted || is_word) {
        meant.push((format!("\"{text}\""), "text stands in quotes"));
    }
    meant
}

/// Reads a number as many write one. Returns it as TOML writes it.
fn read_number(text: &str) -> Option<String> {
    let digits = text.replace(['_', '\''], "");
    let is_number = digits.starts_with(|first: char| first.is_ascii_digit() || matches!(first, '+' | '-' | '.'));
    let number = digits.parse::<f64>().ok().filter(|number| is_number && number.is_finite())?;
    Some(match digits.parse::<i64>() {
        Ok(whole) => whole.to_string(),
        Err(_) => format!("{number:?}"),
    })
}

/// Repairs a number: `.5`, `5.`, `007`, `1'000`, `0.5 mm`, `50%`, `1/2`, `10*3`.
fn repair_number(value: &str) -> Option<(String, &'static str)> {
    if let Some(number) = read_number(value) {
        return Some((number, ""));
    }
    let is_part = |c: char| c.is_ascii_digit() || matches!(c, '+' | '-' | '.' | '_');
    let unit = value.find(|c: char| !is_part(c))?;
    let number = read_number(&value[..unit])?;
    let rest = value[unit..].trim();
    let behind = || read_number(rest[1..].trim())?.parse::<f64>().ok();
    let calculated = |by: &dyn Fn(f64, f64) -> f64| {
        let result = by(number.parse().ok()?, behind()?);
        let is_whole = result.fract() == 0.0 && result.abs() < 1e15 && !value.contains(['.', '/']);
        let said = if is_whole { format!("{result:.0}") } else { format!("{result:?}") };
        result.is_finite().then_some((said, "a job does not calculate"))
    };
    match rest.chars().next()? {
        '%' if rest.len() == 1 => Some((format!("{:?}", number.parse::<f64>().ok()? / 100.0), "a share is 0 to 1")),
        '/' => calculated(&|a, b| a / b),
        '*' => calculated(&|a, b| a * b),
        _ => {
            let is_unit = rest.chars().all(|c| c.is_alphabetic() || c == '\u{b0}');
            is_unit.then_some((number, "a number stands alone; its key has the unit"))
        }
    }
}

/// Returns the brackets that close what a value opens, outside of text in quotes.
fn missing_brackets(value: &str) -> String {
    let mut open = Vec::new();
    let mut quote = None;
    for c in value.chars() {
        match (quote, c) {
            (Some(begun), _) if begun == c => quote = None,
            (Some(_), _) => {}
            (None, '"' | '\'') => quote = Some(c),
            (None, '[') => open.push(']'),
            (None, '{') => open.push('}'),
            (None, ']' | '}') => drop(open.pop()),
            _ => {}
        }
    }
    open.into_iter().rev().collect()
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
    text.starts_with(|first: char| first.is_ascii_alphabetic() || first == '_')
        && text.chars().all(|c| c.is_ascii_alphanumeric() || matches!(c, '_' | '-' | '.'))
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

    /// Returns the fix for the first error in a text.
    fn fix_of(text: &str) -> String {
        let (_, errors) = DeTable::parse_recoverable(text);
        let at = errors.first().and_then(toml::de::Error::span).unwrap_or_else(|| panic!("{text} is TOML"));
        suggest_fix(text, at.start)
    }

    #[test]
    fn a_line_with_a_slip_is_written_as_it_was_meant() {
        for (slip, meant) in [
            ("a = 1,", "a = 1"),
            ("a = 1;", "a = 1"),
            ("a = my-set", "a = \"my-set\""),
            ("a = ~/my.obj", "a = \"~/my.obj\""),
            ("a = \"x", "a = \"x\""),
            ("a = x\"", "a = \"x\""),
            ("a = 'x\"", "a = \"x\""),
            ("a = \"\"x\"\"", "a = \"x\""),
            ("a = \u{201c}x\u{201d}", "a = \"x\""),
            ("a = \u{2212}0.5", "a = -0.5"),
            ("a\u{a0}= 1", "a = 1"),
            ("a = True", "a = true"),
            ("a = NO", "a = false"),
            ("a = .5", "a = 0.5"),
            ("a = 5.", "a = 5.0"),
            ("a = 007", "a = 7"),
            ("a = 1'000", "a = 1000"),
            ("a = 1_", "a = 1"),
            ("a = 0.5 mm # deep", "a = 0.5"),
            ("a = 30\u{b0}", "a = 30"),
            ("a = 50%", "a = 0.5"),
            ("a = 1/4", "a = 0.25"),
            ("a = 10*3", "a = 30"),
            ("a = 0.2..0.5", "a = [0.2, 0.5]"),
            ("a = 0.2-0.5", "a = [0.2, 0.5]"),
            ("a = 1 to 2", "a = [1, 2]"),
            ("a = (0.2, 0.5)", "a = [0.2, 0.5]"),
            ("a = [0.2, 0.5", "a = [0.2, 0.5]"),
            ("a = [1,,2]", "a = [1,2]"),
            ("a = { b = { c = 1 }", "a = { b = { c = 1 }}"),
            ("a = { b = { c = 1 }\n[d]\n", "a = { b = { c = 1 }}"),
            ("a = { b: 1 }", "a = { b = 1 }"),
            ("a: 1", "a = 1"),
            ("a := 1", "a = 1"),
            ("a == 1", "a = 1"),
            ("a -> 1", "a = 1"),
            ("a 1", "a = 1"),
            ("a b = 1", "a_b = 1"),
            ("[a", "[a]"),
            ("[[a]", "[[a]]"),
            ("[a]]", "[[a]]"),
            ("// why", "# why"),
            ("; why", "# why"),
            ("a = 1 // why", "a = 1 # why"),
        ] {
            let said = fix_of(slip);
            let written = said.strip_prefix("write `").and_then(|rest| rest.split('`').next());
            assert_eq!(written, Some(meant), "{slip}: {said}");
            assert!(is_toml(meant), "{meant}");
        }
    }

    #[test]
    fn a_slip_that_no_line_mends_is_explained() {
        for (slip, help) in [
            ("a = 0,5", "numbers have a decimal point: 0.5"),
            ("a = -1,25 # mm", "numbers have a decimal point: -1.25"),
            ("a = 3,000", "write 3000, or 3.000 with a decimal point"),
            ("a = 0.2, 1.5", "a range or list stands in brackets: [0.2, 1.5]"),
            ("a = 1.0,2.0", "a range or list stands in brackets: [1.0, 2.0]"),
            ("a = \"C:\\m\\c.stl\"", "write / between folders, \"C:/m/c.stl\""),
            ("a = None", "leave it out: a key that is not there has its default"),
            ("a =", "write a value behind `a =`, or leave the line out"),
            ("a = 1 b = 2", "`a = 1`, then `b = 2`"),
            ("a = \"x\", b = 2", "`a = \"x\"`, then `b = 2`"),
            ("a = [1]\n- 2", "a list stands in brackets, after its key: key = [1.0, 2.0]"),
            ("<<<<<<< HEAD", "keep one of them, without the marks"),
            ("end", "text stands in \"..\", a list in [..]"),
            ("a = [\n0.2 0.5\n]", "text stands in \"..\", a list in [..]"),
        ] {
            let said = fix_of(slip);
            assert!(said.ends_with(help), "{slip}: {said}");
        }
    }

    proptest::proptest! {
        #[test]
        fn whatever_is_written_is_answered(text in "[ab_=:\"'\\[\\]{}(),;#/. 01%\\-\\n\u{2212}\u{201c}]{0,40}", at in 0_usize..60) {
            let said = suggest_fix(&text, at);
            let written = said.strip_prefix("write `").and_then(|rest| rest.rsplit_once('`'));
            if let Some((line, _)) = written {
                proptest::prop_assert!(is_toml(line), "{said}");
            }
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
