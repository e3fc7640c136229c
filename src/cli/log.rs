//! How a command says on standard error what it does: in words for people, as one JSON object a line for pipelines, or
//! not at all. Errors are always said.

use clap::ValueEnum;
use serde_json::{Value, json};

use super::Failure;
use super::terminal::{self, say, say_shown};
use gelsim_files::diagnostic::{Diagnostic, Display, Report};

/// Form of the messages on standard error.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, ValueEnum)]
pub(super) enum Format {
    /// Words, and a progress bar on a terminal.
    #[default]
    Text,
    /// One JSON object a line: note, warning, start, progress, done, error.
    Json,
}

/// Who listens, and in which form.
#[derive(Clone, Copy, Debug)]
pub(super) struct Log {
    /// Form of what is said.
    pub format: Format,
    /// Only errors are.
    pub quiet: bool,
}

impl Log {
    /// In words, unless `quiet`.
    pub fn text(quiet: bool) -> Self {
        Self { format: Format::Text, quiet }
    }

    /// Something the user should know that is no mistake.
    pub fn note(self, message: &str) {
        self.notes(&Diagnostic::note(message).into());
    }

    /// What the user should act on that is no mistake, and what can be had otherwise.
    pub fn notes(self, notes: &Report) {
        self.all_notes(&notes.worth_showing());
    }

    /// The same, and what needs nothing done.
    pub fn all_notes(self, notes: &Report) {
        if self.quiet {
            return;
        }
        match self.format {
            Format::Text => notes.paragraphs(terminal::errors()).for_each(|paragraph| say_shown(&paragraph)),
            Format::Json => {
                for note in notes.problems() {
                    let fields = json!({ "message": note.text(), "help": note.help, "place": notes.place(note) });
                    self.event(note.severity.name(), fields);
                }
            }
        }
    }

    /// Something that happened, for pipelines: `fields` are an object.
    pub fn event(self, name: &str, fields: Value) {
        if self.format == Format::Json && !self.quiet {
            say(&line(name, fields));
        }
    }

    /// Says why the command failed, where the form is not the one in which the program itself says it.
    pub fn failed(self, failure: Failure) -> Failure {
        match (self.format, failure.text(Display::PLAIN)) {
            (Format::Json, Some(message)) => {
                say(&line("error", json!({ "status": failure.status, "message": message })));
                Failure::reported(failure.status)
            }
            _ => failure,
        }
    }
}

fn line(name: &str, fields: Value) -> String {
    let mut event = json!({ "event": name });
    if let (Some(event), Value::Object(fields)) = (event.as_object_mut(), fields) {
        event.extend(fields);
    }
    event.to_string()
}
