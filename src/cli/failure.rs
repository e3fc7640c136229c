//! Why the program ends with a status other than 0, and what it says about it.

use std::io;
use std::path::Path;

use super::terminal::fold;
use gelsim_dataset::refused::Refused;
use gelsim_files::diagnostic::{Diagnostic, Display, Report};
use gelsim_files::spelling::{visible, without_codes};
use gelsim_files::store::{self, StoreError};

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
    Reported,
    Text(String),
    Report(Report),
}

impl Failure {
    /// Something failed while running.
    pub(super) fn running(message: impl Into<String>) -> Self {
        Self { message: Message::Report(Report::message(message)), status: 1 }
    }

    /// The same, and what to do about it or what is left.
    pub(super) fn running_with(message: impl Into<String>, help: impl Into<String>) -> Self {
        Self { message: Message::Report(Diagnostic::new(message).help(help).into()), status: 1 }
    }

    /// A file could not be read or written.
    pub(super) fn from_path(path: &Path, error: &dyn std::fmt::Display) -> Self {
        Self::running(format!("{}: {error}", path.display()))
    }

    /// The system denied something: what, what to do about it where the error tells, and what is left.
    pub(super) fn denied(what: &str, error: &io::Error, left: &str) -> Self {
        Self::running_with(what, format!("{}{left}", way_out(error)))
    }

    /// A signal stopped the work.
    pub(super) fn stopped(message: impl Into<String>, signal: usize) -> Self {
        Self { message: Message::Text(message.into()), status: (128 + signal) as u8 }
    }

    /// What is wrong has been said.
    pub(super) fn reported(status: u8) -> Self {
        Self { message: Message::Reported, status }
    }

    /// What is to be said; none if all has been said.
    pub fn text(&self, display: Display) -> Option<String> {
        match &self.message {
            Message::Reported => None,
            Message::Text(text) => Some(fold(&visible(&without_codes(text.clone())), display.columns).into_owned()),
            Message::Report(report) => Some(report.render(display)),
        }
    }
}

impl From<Refused> for Failure {
    fn from(refused: Refused) -> Self {
        match refused {
            Refused::Usage(report) => report.into(),
            Refused::Io(path, error) => {
                match store::said(&error).map_or("", StoreError::way_out).trim_end_matches("; ") {
                    "" => Self::from_path(&path, &error),
                    way_out => Self::running_with(format!("{}: {error}", path.display()), way_out),
                }
            }
        }
    }
}

impl From<Report> for Failure {
    fn from(report: Report) -> Self {
        Self { message: Message::Report(report), status: 2 }
    }
}

fn way_out(error: &io::Error) -> &'static str {
    if let Some(said) = store::said(error) {
        return said.way_out();
    }
    use io::ErrorKind::{FileTooLarge, PermissionDenied, QuotaExceeded, ReadOnlyFilesystem, StorageFull, WouldBlock};
    let no_pool = error.get_ref().is_some_and(|inner| inner.is::<rayon::ThreadPoolBuildError>());
    let too_many_files = Some(rustix::io::Errno::MFILE.raw_os_error());
    match error.kind() {
        StorageFull | QuotaExceeded => "make room there; ",
        FileTooLarge => "raise the limit of a file's size (ulimit -f), or write smaller shards; ",
        PermissionDenied | ReadOnlyFilesystem => "make the folder writable, or choose another one with --out; ",
        // What the system says when it has no thread to give.
        kind if kind == WouldBlock || no_pool => {
            "raise the limit of processes or of memory (ulimit -u, -v), or use fewer --threads; "
        }
        _ if error.raw_os_error() == too_many_files => {
            "raise the limit of open files (ulimit -n), or use fewer --threads; "
        }
        _ => "",
    }
}
