//! Why the program ends with a status other than 0, and what it says about it.

use std::path::Path;

use crate::config::diagnostic::Report;
use crate::dataset::folder::Refused;

/// Why the program ends with a status other than 0.
#[derive(Debug)]
pub struct Failure {
    message: Message,
    /// Exit status: 1 failed while running, 2 something the user wrote is wrong, 130 or 143 stopped by a signal.
    pub status: u8,
}

#[derive(Debug)]
enum Message {
    /// All has been said.
    Said,
    Text(String),
    Report(Report),
}

impl Failure {
    /// Something failed while running.
    pub(super) fn running(message: impl Into<String>) -> Self {
        Self { message: Message::Text(format!("error: {}", message.into())), status: 1 }
    }

    /// A file could not be read or written.
    pub(super) fn at(path: &Path, error: &dyn std::fmt::Display) -> Self {
        Self::running(format!("{}: {error}", path.display()))
    }

    /// A signal stopped the work.
    pub(super) fn stopped(message: impl Into<String>, signal: usize) -> Self {
        Self { message: Message::Text(message.into()), status: (128 + signal) as u8 }
    }

    /// What is wrong has been said.
    pub(super) fn said(status: u8) -> Self {
        Self { message: Message::Said, status }
    }

    /// What is to be said, with colours if `styled`; none if all has been said.
    pub fn text(&self, styled: bool) -> Option<String> {
        match &self.message {
            Message::Said => None,
            Message::Text(text) => Some(text.clone()),
            Message::Report(report) => Some(report.render(styled)),
        }
    }
}

impl From<Refused> for Failure {
    fn from(refused: Refused) -> Self {
        match refused {
            Refused::Usage(report) => report.into(),
            Refused::Io(path, error) => Self::at(&path, &error),
        }
    }
}

impl From<Report> for Failure {
    fn from(report: Report) -> Self {
        Self { message: Message::Report(report), status: 2 }
    }
}
