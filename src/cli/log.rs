//! How a command says on standard error what it does: in words for people, as one JSON object a line for pipelines, or
//! not at all. Errors are always said.

use std::io::Write;

use clap::ValueEnum;
use serde_json::{Value, json};

use super::Failure;
use crate::files::spelling::visible;

/// Form of the messages on standard error.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, ValueEnum)]
pub(super) enum Format {
    /// Words, and a progress bar on a terminal.
    #[default]
    Text,
    /// One JSON object a line: note, start, progress, done, error.
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
        match self.format {
            _ if self.quiet => {}
            Format::Text => say(&format!("note: {message}")),
            Format::Json => self.event("note", json!({ "message": message })),
        }
    }

    /// The same of several.
    pub fn notes(self, messages: &[String]) {
        messages.iter().for_each(|message| self.note(message));
    }

    /// Something that happened, for pipelines: `fields` are an object.
    pub fn event(self, name: &str, fields: Value) {
        if self.format == Format::Json && !self.quiet {
            say(&line(name, fields));
        }
    }

    /// Says why the command failed, where the form is not the one in which the program itself says it.
    pub fn failed(self, failure: Failure) -> Failure {
        match (self.format, failure.text(false)) {
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

/// Says something on standard error. If nobody can hear it, that is no failure of the work.
pub fn say(text: &str) {
    let _ = writeln!(std::io::stderr().lock(), "{}", visible(text));
}
