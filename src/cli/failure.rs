//! Why the program ends with a status other than 0, and what it says about it.

use std::io;
use std::path::Path;

use super::terminal::{self, fold_lines};
use gelsim_dataset::dataset_error::DatasetError;
use gelsim_files::diagnostic::{Diagnostic, DisplayOptions, Report};
use gelsim_files::spelling::{escape_hidden_chars, strip_os_error_codes};
use gelsim_files::store::{self, StoreError};
use gelsim_job::plan::Plan;

/// Why the program ends with a status other than 0.
#[derive(Debug)]
pub struct Failure {
    message: Message,
    /// Exit status: 1 failed while running, 2 something the user wrote is wrong, 130 or 143 stopped by a signal.
    pub status: u8,
}

#[derive(Debug)]
enum Message {
    /// The reasons were printed already.
    Reported,
    Text(String),
    Report(Report),
}

impl Failure {
    /// Returns the failure of something that went wrong while running.
    pub(super) fn runtime(message: impl Into<String>) -> Self {
        Self { message: Message::Report(Report::from_message(message)), status: 1 }
    }

    /// Returns the failure of something that went wrong while running, with what to do about it or what is left.
    pub(super) fn runtime_with_help(message: impl Into<String>, help: impl Into<String>) -> Self {
        Self { message: Message::Report(Diagnostic::new(message).help(help).into()), status: 1 }
    }

    /// Returns the failure of a file that could not be read or written.
    pub(super) fn from_path(path: &Path, error: &dyn std::fmt::Display) -> Self {
        Self::runtime(format!("{}: {error}", path.display()))
    }

    /// Returns the failure of a plan of which a mesh could not be read again.
    pub(super) fn check_meshes(plan: &Plan) -> Result<(), Self> {
        plan.find_mesh_failure().map_or(Ok(()), |(path, error)| Err(Self::from_path(&path, &error)))
    }

    /// Returns the failure of something that the system refused: `what` it was, the remedy if `error` tells one, and
    /// what is `left` of the work.
    pub(super) fn access_denied(what: &str, error: &io::Error, left: &str) -> Self {
        Self::runtime_with_help(what, format!("{}{left}", suggest_remedy(error)))
    }

    /// Returns the failure of work that a signal stopped.
    pub(super) fn stopped_by_signal(message: impl Into<String>, signal: usize) -> Self {
        Self { message: Message::Text(message.into()), status: (128 + signal) as u8 }
    }

    /// Returns a failure whose reasons were printed already.
    pub(super) fn already_reported(status: u8) -> Self {
        Self { message: Message::Reported, status }
    }

    /// Prints the failure on standard error, unless its reasons were printed already.
    pub(super) fn print(&self) {
        if let Some(message) = self.to_text(terminal::stderr_display()) {
            terminal::print_as_is(&message);
        }
    }

    /// Returns the text to print; `None` if the reasons were printed already.
    pub fn to_text(&self, display: DisplayOptions) -> Option<String> {
        match &self.message {
            Message::Reported => None,
            Message::Text(text) => Some(
                fold_lines(&escape_hidden_chars(&strip_os_error_codes(text.clone())), display.columns).into_owned(),
            ),
            Message::Report(report) => Some(report.render(display)),
        }
    }
}

impl From<DatasetError> for Failure {
    fn from(refused: DatasetError) -> Self {
        match refused {
            DatasetError::Usage(report) => report.into(),
            DatasetError::Io(path, error) => {
                match store::find_store_error(&error).map_or("", StoreError::help).trim_end_matches("; ") {
                    "" => Self::from_path(&path, &error),
                    way_out => Self::runtime_with_help(format!("{}: {error}", path.display()), way_out),
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

/// Returns the remedy for an error of the system, with a final `; `; empty if none is known.
fn suggest_remedy(error: &io::Error) -> &'static str {
    if let Some(said) = store::find_store_error(error) {
        return said.help();
    }
    use io::ErrorKind::{FileTooLarge, PermissionDenied, QuotaExceeded, ReadOnlyFilesystem, StorageFull, WouldBlock};
    let no_pool = error.get_ref().is_some_and(|inner| inner.is::<rayon::ThreadPoolBuildError>());
    let too_many_files = Some(rustix::io::Errno::MFILE.raw_os_error());
    match error.kind() {
        StorageFull | QuotaExceeded => "make room there; ",
        FileTooLarge => "raise the limit of a file's size (ulimit -f), or write smaller shards; ",
        PermissionDenied | ReadOnlyFilesystem => "make the folder writable, or choose another one with --out; ",
        // The system reports a lack of threads as WouldBlock.
        kind if kind == WouldBlock || no_pool => {
            "raise the limit of processes or of memory (ulimit -u, -v), or use fewer --threads; "
        }
        _ if error.raw_os_error() == too_many_files => {
            "raise the limit of open files (ulimit -n), or use fewer --threads; "
        }
        _ => "",
    }
}
