//! Helps with text in messages: finds the name that was meant, lists alternatives, and shows hidden characters.

use std::borrow::Cow;
use std::path::Path;

/// Most bytes of a name that is compared: more than any known name, with slips, has.
const MAX_NAME_BYTES: usize = 200;

/// Finds the known name closest to what was written, if it is close enough to be a slip.
pub fn find_nearest_name<'a>(written: &str, known: impl IntoIterator<Item = &'a str>) -> Option<&'a str> {
    if written.len() > MAX_NAME_BYTES {
        return None;
    }
    known
        .into_iter()
        .filter(|name| name.len() <= MAX_NAME_BYTES)
        .map(|name| (strsim::damerau_levenshtein(written, name), name))
        // Allow a slip or two, more in a long word. Every other short word would be near, and all single letters are.
        .filter(|(distance, name)| {
            let longer = name.len().max(written.len());
            *distance <= if longer < 2 { 0 } else { longer.div_ceil(3).clamp(1, 3) }
        })
        .min_by_key(|(distance, _)| *distance)
        .map(|(_, name)| name)
}

/// Quotes a path for a shell.
pub fn quote_for_shell(path: &Path) -> String {
    let text = path.display().to_string();
    // A name that begins with a dash would be taken for a flag.
    let text = if text.starts_with('-') { format!("./{text}") } else { text };
    let plain = |letter: char| letter.is_ascii_alphanumeric() || "/._-+=:@%".contains(letter);
    match () {
        () if !text.is_empty() && text.chars().all(plain) => text,
        () if text.contains(is_hidden_char) => {
            let escaped = |letter: char| match letter {
                '\'' | '\\' => format!("\\{letter}"),
                '\n' => String::from("\\n"),
                hidden if is_hidden_char(hidden) => format!("\\u{:04x}", u32::from(hidden)),
                shown => shown.to_string(),
            };
            format!("$'{}'", text.chars().map(escaped).collect::<String>())
        }
        () => format!("'{}'", text.replace('\'', "'\\''")),
    }
}

/// Returns true for a character that controls a terminal, or that is not seen but turns or hides what stands around it.
pub fn is_hidden_char(c: char) -> bool {
    let turns = matches!(c, '\u{61c}' | '\u{200b}'..='\u{200f}' | '\u{202a}'..='\u{202e}' | '\u{2060}'..='\u{206f}' | '\u{feff}');
    turns || c.is_control()
}

/// Escapes the hidden characters of a text as JSON does. Line breaks and tabs stay.
pub fn escape_hidden_chars(text: &str) -> Cow<'_, str> {
    let hidden = |c: char| is_hidden_char(c) && c != '\n' && c != '\t';
    if !text.contains(hidden) {
        return Cow::Borrowed(text);
    }
    let mut shown = String::with_capacity(text.len());
    for c in text.chars() {
        match c {
            c if hidden(c) => shown += &format!("\\u{:04x}", u32::from(c)),
            c => shown.push(c),
        }
    }
    Cow::Owned(shown)
}

/// Removes the codes behind the system's error messages, which help nobody.
pub fn strip_os_error_codes(mut text: String) -> String {
    const BEFORE: &str = " (os error ";
    while let Some(start) = text.find(BEFORE) {
        let code = &text[start + BEFORE.len()..];
        let digits = code.bytes().take_while(u8::is_ascii_digit).count();
        if digits == 0 || !code[digits..].starts_with(')') {
            break;
        }
        text.replace_range(start..start + BEFORE.len() + digits + 1, "");
    }
    text
}

/// Joins names as in "`a`, `b` or `c`".
pub fn join_alternatives(names: &[&str]) -> String {
    let quoted: Vec<String> = names.iter().map(|name| format!("`{name}`")).collect();
    match quoted.split_last() {
        None => String::from("nothing"),
        Some((only, [])) => only.clone(),
        Some((last, rest)) => format!("{} or {last}", rest.join(", ")),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn paths_are_what_a_shell_takes() {
        for (path, word) in [
            ("out/my-set_1.0", "out/my-set_1.0"),
            ("a b", "'a b'"),
            ("it's", "'it'\\''s'"),
            ("-w", "./-w"),
            ("a\nb\u{200b}", "$'a\\nb\\u200b'"),
            ("", "''"),
        ] {
            assert_eq!(quote_for_shell(Path::new(path)), word);
        }
    }

    #[test]
    fn errors_of_the_system_are_said_without_their_codes() {
        let of = |text: &str| strip_os_error_codes(text.to_owned());
        assert_eq!(
            of("a: Permission denied (os error 13); b: File exists (os error 17)"),
            "a: Permission denied; b: File exists"
        );
        assert_eq!(of("(os error x) (os error 3"), "(os error x) (os error 3");
    }

    #[test]
    fn what_would_speak_to_a_terminal_is_shown() {
        let text = "a\u{1b}[31m \u{202e}gnp.exe\u{7f}\u{9b}\r\n\tb";
        assert_eq!(escape_hidden_chars(text), "a\\u001b[31m \\u202egnp.exe\\u007f\\u009b\\u000d\n\tb");
        assert!(matches!(escape_hidden_chars("Grüße, 触覚\n"), Cow::Borrowed(_)));
    }
}
