//! Numbers that Python writes into JSON although JSON does not have them.

/// Common cause of many such mistakes, written after their number.
pub const NON_NUMBER_CAUSE: &str = "labels have a number that is no JSON (`NaN` or `Infinity`)";
/// What to do about such a number.
pub const NON_NUMBER_HELP: &str = "write null in its place (Python: json.dumps(.., allow_nan=False) finds them)";

/// Says what is wrong with such a number.
pub fn non_number_message(number: &str) -> String {
    format!("`{number}` is no JSON")
}

/// Returns the number at which a parser stopped with `error` if JSON does not have it.
pub fn find_non_number(text: &[u8], error: &serde_json::Error) -> Option<&'static str> {
    let line = text.split(|byte| *byte == b'\n').nth(error.line().checked_sub(1)?)?;
    // The parser stops at the first letter or at the sign before it. Its columns count from 1.
    let near = line.get(error.column().saturating_sub(2)..)?;
    let is_near = |number: &&str| {
        near.starts_with(number.as_bytes()) || near.get(1..).is_some_and(|rest| rest.starts_with(number.as_bytes()))
    };
    ["-Infinity", "Infinity", "NaN"].into_iter().find(is_near)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_that_only_python_writes_are_named_and_other_mistakes_are_not() {
        for (text, expected) in [
            ("{\"a\":NaN}", Some("NaN")),
            ("{\"a\": NaN}", Some("NaN")),
            ("{\"a\":1,\n \"b\":\n[0.5,Infinity]}", Some("Infinity")),
            ("[-Infinity]", Some("-Infinity")),
            ("NaN", Some("NaN")),
            ("{\"NaN\":nothing}", None),
            ("{\"a\":\"NaN\",}", None),
            ("{\"a\":-}", None),
            ("", None),
        ] {
            let error = serde_json::from_str::<serde_json::Value>(text).expect_err("no JSON");
            assert_eq!(find_non_number(text.as_bytes(), &error), expected, "{text}");
        }
    }
}
