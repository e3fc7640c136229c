//! Messages of a command on standard error: words for people, one JSON object a line for pipelines, or none. Errors are
//! always printed.

use clap::ValueEnum;
use serde_json::{Value, json};

use super::Failure;
use super::terminal::{self, print_as_is};
use gelsim_files::diagnostic::{Diagnostic, DisplayOptions, Report};
use gelsim_files::spelling::escape_hidden_chars;

/// Form of the messages on standard error.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, ValueEnum)]
pub(super) enum Format {
    /// Words, and a progress bar on a terminal.
    #[default]
    Text,
    /// One JSON object a line: note, warning, start, progress, done, error.
    Json,
}

/// Prints the messages of a command.
#[derive(Clone, Copy, Debug)]
pub(super) struct Log {
    /// Form of the messages.
    pub format: Format,
    /// Whether only errors are printed.
    pub quiet: bool,
}

impl Log {
    /// Creates a log in words, unless `quiet`.
    pub fn plain_text(quiet: bool) -> Self {
        Self { format: Format::Text, quiet }
    }

    /// Prints something that the user should know and that is no mistake.
    pub fn print_note(self, message: &str) {
        self.print_notes(&Diagnostic::note(message).into());
    }

    /// Prints the notes that are worth showing: those that the user can act on.
    pub fn print_notes(self, notes: &Report) {
        self.print_all_notes(&notes.worth_showing());
    }

    /// Prints all notes, also those that need no action.
    pub fn print_all_notes(self, notes: &Report) {
        if self.quiet {
            return;
        }
        match self.format {
            Format::Text => {
                notes.render_paragraphs(terminal::stderr_display()).for_each(|paragraph| print_as_is(&paragraph))
            }
            Format::Json => {
                for note in notes.problems() {
                    let fields =
                        json!({ "message": note.full_message(), "help": note.help, "place": notes.format_place(note) });
                    self.write_event(note.severity.name(), fields);
                }
            }
        }
    }

    /// Writes an event for pipelines: `fields` must be an object. Does nothing in words.
    pub fn write_event(self, name: &str, fields: Value) {
        if self.format == Format::Json && !self.quiet {
            print_as_is(&escape_hidden_chars(&format_event(name, fields)));
        }
    }

    /// Prints why the command failed, if the form is JSON. In words it returns the failure as it is: the program prints
    /// it at its end.
    pub fn report_failure(self, failure: Failure) -> Failure {
        match (self.format, failure.to_text(DisplayOptions::PLAIN)) {
            (Format::Json, Some(message)) => {
                let event = format_event("error", json!({ "status": failure.status, "message": message }));
                print_as_is(&escape_hidden_chars(&event));
                Failure::already_reported(failure.status)
            }
            _ => failure,
        }
    }
}

fn format_event(name: &str, fields: Value) -> String {
    let mut event = json!({ "event": name });
    if let (Some(event), Value::Object(fields)) = (event.as_object_mut(), fields) {
        event.extend(fields);
    }
    event.to_string()
}
