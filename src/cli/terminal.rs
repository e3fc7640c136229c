//! How text is shown on standard output and standard error: colours where the user's terminal has and wants them, long
//! lines folded between words.

use std::borrow::Cow;
use std::io::{self, IsTerminal, Write};

use anstream::{AutoStream, ColorChoice};
use terminal_size::{Height, Width, terminal_size_of};

use gelsim_files::diagnostic::{DisplayOptions, wrap_options};
use gelsim_files::spelling::escape_hidden_chars;

/// Columns assumed of a terminal that does not say how many it has.
const USUAL_COLUMNS: usize = 80;

/// Returns how to show text on standard output.
pub(super) fn stdout_display() -> DisplayOptions {
    let stream = io::stdout();
    DisplayOptions {
        is_styled: false,
        columns: stream.is_terminal().then(|| terminal_width(terminal_size_of(&stream))),
    }
}

/// Returns the columns of standard output; `None` if it is no terminal.
pub(super) fn stdout_columns() -> Option<usize> {
    stdout_display().columns
}

/// Returns how to show text on standard error. NO_COLOR, CLICOLOR, CLICOLOR_FORCE and TERM are heeded, as in help.
pub(super) fn stderr_display() -> DisplayOptions {
    let stream = io::stderr();
    let is_styled = !matches!(AutoStream::choice(&stream), ColorChoice::Never);
    DisplayOptions { is_styled, columns: stream.is_terminal().then(|| terminal_width(terminal_size_of(&stream))) }
}

/// Returns true if standard error is a terminal whose lines can be redrawn.
pub(super) fn can_redraw_stderr() -> bool {
    io::stderr().is_terminal() && std::env::var_os("TERM").is_none_or(|name| name != "dumb")
}

fn terminal_width(size: Option<(Width, Height)>) -> usize {
    match size {
        Some((Width(0), _)) | None => USUAL_COLUMNS,
        Some((Width(columns), _)) => usize::from(columns),
    }
}

/// Prints a text of clap's: help, or what is wrong with a command line.
pub(super) fn print_styled(text: &clap::builder::StyledStr, is_error: bool) -> io::Result<()> {
    let DisplayOptions { columns, .. } = if is_error { stderr_display() } else { stdout_display() };
    let styled = fold_lines(&text.ansi().to_string(), columns).into_owned();
    // The streams of anstream remove colours where the user has or wants none.
    if is_error {
        anstream::stderr().write_all(styled.as_bytes())
    } else {
        let mut stream = anstream::stdout();
        stream.write_all(styled.as_bytes()).and_then(|()| stream.flush())
    }
}

/// Prints text on standard error. If nobody can read it, the work does not fail.
pub fn print_to_stderr(text: &str) {
    print_as_is(&fold_lines(&escape_hidden_chars(text), stderr_display().columns));
}

/// Prints text on standard error as it is: already folded, perhaps with colours.
pub(super) fn print_as_is(text: &str) {
    let _ = writeln!(io::stderr().lock(), "{text}");
}

/// Folds lines longer than `columns` between their words. In a row of a table the folded text stands below the last
/// column, else a little further in than the line.
pub(super) fn fold_lines(text: &str, columns: Option<usize>) -> Cow<'_, str> {
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
    // A last column further right would leave too little room for the folded text.
    let column = last_column_start(line, 3 * columns / 5).unwrap_or(indent + 2);
    let below = " ".repeat(column);
    textwrap::fill(line, wrap_options(columns).subsequent_indent(&below))
}

/// Returns where the last column of a table's row begins, if that is before `most`: after two spaces or more.
fn last_column_start(line: &str, most: usize) -> Option<usize> {
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
            fold_lines(row, Some(60)),
            "noise            0 / 132       -  the camera has none that\n                                  anybody could see"
        );
        assert_eq!(fold_lines("  one two three four", Some(12)), "  one two\n    three\n    four");
        assert_eq!(fold_lines("a/path/that/has/no/space", Some(12)), "a/path/that/has/no/space");
        assert_eq!(
            fold_lines("preview my-job.toml", Some(12)),
            "preview\n  my-job.toml",
            "a file's name stays in one piece"
        );
        assert!(
            matches!(fold_lines(row, None), Cow::Borrowed(_)) && matches!(fold_lines(row, Some(80)), Cow::Borrowed(_))
        );
    }
}
