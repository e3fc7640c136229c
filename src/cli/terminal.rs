//! What standard output and standard error show: colours where the user's terminal has and wants them, lines folded between
//! words where a terminal ends them.

use std::borrow::Cow;
use std::io::{self, IsTerminal, Write};

use anstream::{AutoStream, ColorChoice};
use terminal_size::{Height, Width, terminal_size_of};

use gelsim_files::diagnostic::Display;
use gelsim_files::spelling::visible;

/// Columns of a terminal that does not say how many it has.
const USUAL_COLUMNS: usize = 80;

/// How standard output is shown.
pub(super) fn output() -> Display {
    let stream = io::stdout();
    Display { is_styled: false, columns: stream.is_terminal().then(|| width(terminal_size_of(&stream))) }
}

/// Columns of standard output, where that is a terminal.
pub(super) fn columns() -> Option<usize> {
    output().columns
}

/// How standard error is shown: NO_COLOR, CLICOLOR, CLICOLOR_FORCE and TERM are heeded, as in help.
pub(super) fn errors() -> Display {
    let stream = io::stderr();
    let is_styled = !matches!(AutoStream::choice(&stream), ColorChoice::Never);
    Display { is_styled, columns: stream.is_terminal().then(|| width(terminal_size_of(&stream))) }
}

/// True if standard error is a terminal on which a line can be drawn over.
pub(super) fn is_drawn_on() -> bool {
    io::stderr().is_terminal() && std::env::var_os("TERM").is_none_or(|name| name != "dumb")
}

fn width(size: Option<(Width, Height)>) -> usize {
    match size {
        Some((Width(0), _)) | None => USUAL_COLUMNS,
        Some((Width(columns), _)) => usize::from(columns),
    }
}

/// Prints what clap has to say: help, or what is wrong with a command line.
pub(super) fn show(text: &clap::builder::StyledStr, is_error: bool) -> io::Result<()> {
    let Display { columns, .. } = if is_error { errors() } else { output() };
    let styled = fold(&text.ansi().to_string(), columns).into_owned();
    // Colours go where the stream has none.
    if is_error {
        anstream::stderr().write_all(styled.as_bytes())
    } else {
        let mut stream = anstream::stdout();
        stream.write_all(styled.as_bytes()).and_then(|()| stream.flush())
    }
}

/// Says something on standard error. If nobody can hear it, that is no failure of the work.
pub fn say(text: &str) {
    say_shown(&fold(&visible(text), errors().columns));
}

/// Says text on standard error as it is: with colours, folded.
pub(super) fn say_shown(text: &str) {
    let _ = writeln!(io::stderr().lock(), "{text}");
}

/// Folds lines longer than so many columns between their words. What follows stands below the last column of the line, if it
/// is a row of a table, else a little further in than the line.
pub(super) fn fold(text: &str, columns: Option<usize>) -> Cow<'_, str> {
    let is_long = |line: &str, columns: usize| textwrap::core::display_width(line) > columns;
    match columns {
        Some(columns) if text.lines().any(|line| is_long(line, columns)) => {
            let folded = text
                .split('\n')
                .map(|line| if is_long(line, columns) { fold_line(line, columns) } else { line.to_owned() });
            Cow::Owned(folded.collect::<Vec<_>>().join("\n"))
        }
        _ => Cow::Borrowed(text),
    }
}

fn fold_line(line: &str, columns: usize) -> String {
    let indent = line.len() - line.trim_start().len();
    let column = last_column(line, 3 * columns / 5).unwrap_or(indent + 2);
    let below = " ".repeat(column);
    textwrap::fill(line, textwrap::Options::new(columns).subsequent_indent(&below).break_words(false))
}

/// Where the last column of a row of a table begins, if that is before `most`: after two spaces or more.
fn last_column(line: &str, most: usize) -> Option<usize> {
    let mut spaces = 0;
    let mut found = None;
    for (column, c) in line.chars().enumerate().take(most) {
        if c == ' ' {
            spaces += 1;
        } else {
            if spaces >= 2 && spaces < column {
                found = Some(column);
            }
            spaces = 0;
        }
    }
    found
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn rows_are_folded_below_their_last_column_and_sentences_a_little_further_in() {
        let row = "noise            0 / 132       -  the camera has none that anybody could see";
        assert_eq!(
            fold(row, Some(60)),
            "noise            0 / 132       -  the camera has none that\n                                  anybody could see"
        );
        assert_eq!(fold("  one two three four", Some(12)), "  one two\n    three\n    four");
        assert_eq!(fold("a/path/that/has/no/space", Some(12)), "a/path/that/has/no/space");
        assert!(matches!(fold(row, None), Cow::Borrowed(_)) && matches!(fold(row, Some(80)), Cow::Borrowed(_)));
    }
}
