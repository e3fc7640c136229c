//! Text in messages: names that somebody may have meant, what there is to choose from, characters that are not seen.

use std::borrow::Cow;
use std::path::Path;

/// Longer than every name there is, slips included, bytes.
const LONGEST_NAME: usize = 200;

/// The known name closest to what was written, if it is close enough to be a slip.
pub fn nearest<'a>(written: &str, known: impl IntoIterator<Item = &'a str>) -> Option<&'a str> {
    if written.len() > LONGEST_NAME {
        return None;
    }
    known
        .into_iter()
        .filter(|name| name.len() <= LONGEST_NAME)
        .map(|name| (strsim::damerau_levenshtein(written, name), name))
        // A slip or two, more in a long word: of short words every other one is near, of single letters all are.
        .filter(|(distance, name)| {
            let longer = name.len().max(written.len());
            *distance <= if longer < 2 { 0 } else { longer.div_ceil(3).clamp(1, 3) }
        })
        .min_by_key(|(distance, _)| *distance)
        .map(|(_, name)| name)
}

/// A path as a shell takes it.
pub fn shell_word(path: &Path) -> String {
    let text = path.display().to_string();
    // A name that begins so would be a flag.
    let text = if text.starts_with('-') { format!("./{text}") } else { text };
    let plain = |letter: char| letter.is_ascii_alphanumeric() || "/._-+=:@%".contains(letter);
    match () {
        () if !text.is_empty() && text.chars().all(plain) => text,
        () if text.contains(is_hidden) => {
            let escaped = |letter: char| match letter {
                '\'' | '\\' => format!("\\{letter}"),
                '\n' => String::from("\\n"),
                hidden if is_hidden(hidden) => format!("\\u{:04x}", u32::from(hidden)),
                shown => shown.to_string(),
            };
            format!("$'{}'", text.chars().map(escaped).collect::<String>())
        }
        () => format!("'{}'", text.replace('\'', "'\\''")),
    }
}

/// True of a character that speaks to a terminal, or is not seen but turns or hides what stands around it.
pub fn is_hidden(c: char) -> bool {
    let turns = matches!(c, '\u{61c}' | '\u{200b}'..='\u{200f}' | '\u{202a}'..='\u{202e}' | '\u{2060}'..='\u{206f}' | '\u{feff}');
    turns || c.is_control()
}

/// The text with its hidden characters shown as JSON writes them; lines and tabs stay.
pub fn visible(text: &str) -> Cow<'_, str> {
    let hidden = |c: char| is_hidden(c) && c != '\n' && c != '\t';
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

/// What the system says of errors without the codes behind it, which help nobody.
pub fn without_codes(mut text: String) -> String {
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

/// `a`, `b` or `c`.
pub fn one_of(names: &[&str]) -> String {
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
            assert_eq!(shell_word(Path::new(path)), word);
        }
    }

    #[test]
    fn errors_of_the_system_are_said_without_their_codes() {
        let of = |text: &str| without_codes(text.to_owned());
        assert_eq!(
            of("a: Permission denied (os error 13); b: File exists (os error 17)"),
            "a: Permission denied; b: File exists"
        );
        assert_eq!(of("(os error x) (os error 3"), "(os error x) (os error 3");
    }

    #[test]
    fn what_would_speak_to_a_terminal_is_shown() {
        let text = "a\u{1b}[31m \u{202e}gnp.exe\u{7f}\u{9b}\r\n\tb";
        assert_eq!(visible(text), "a\\u001b[31m \\u202egnp.exe\\u007f\\u009b\\u000d\n\tb");
        assert!(matches!(visible("Grüße, 触覚\n"), Cow::Borrowed(_)));
    }
}
