//! The two kinds of failure of the command as Python exceptions, with the command's messages.

use std::any::Any;

use gelsim_core::fidelity::Fidelity;
use gelsim_dataset::generate;
use gelsim_files::diagnostic::user_error;
use gelsim_files::diagnostic::{DisplayOptions, Report};
use gelsim_files::spelling::join_alternatives;
use gelsim_job::config::suggest_choice;
use pyo3::create_exception;
use pyo3::exceptions::{PyRuntimeError, PyValueError};
use pyo3::prelude::*;

use crate::arguments::extract_text;

/// Length that no name of anything known reaches, characters.
pub const LONGEST_NAME: usize = 200;

create_exception!(
    gelsim,
    UsageError,
    PyValueError,
    "Something that the user wrote is wrong: all mistakes at once, as the command says them with exit status 2."
);
create_exception!(
    gelsim,
    RunError,
    PyRuntimeError,
    "Something failed while running, as the command says it with exit status 1."
);

/// Returns the UsageError with the text that the command would print.
pub fn usage_error(report: &Report) -> PyErr {
    UsageError::new_err(report.render(DisplayOptions::PLAIN))
}

/// Returns the UsageError for one mistake in an argument, with what to do instead.
pub fn mistake_error(message: impl Into<String>, help: impl Into<String>) -> PyErr {
    usage_error(&user_error(message, help))
}

/// Returns the value of a name. An unknown one raises UsageError with the nearest names; `what` says what is looked
/// for.
pub fn find_by_name<T>(what: &str, name: &str, known: impl IntoIterator<Item = (&'static str, T)>) -> PyResult<T> {
    let mut names = Vec::new();
    for (candidate, value) in known {
        if candidate == name {
            return Ok(value);
        }
        names.push(candidate);
    }
    // A file's text in place of its name would fill the message.
    if name.chars().nth(LONGEST_NAME).is_some() {
        let help = format!("one of {}", join_alternatives(&names));
        return Err(mistake_error(format!("no {what} has a name of {} bytes", name.len()), help));
    }
    Err(mistake_error(format!("no {what} is called `{name}`"), suggest_choice(name, &names)))
}

/// Reads a fidelity level by its name.
pub fn fidelity_level(given: &Bound<'_, PyAny>) -> PyResult<Fidelity> {
    find_by_name("fidelity level", &extract_text("fidelity", given)?, Fidelity::ALL.map(|level| (level.name(), level)))
}

/// Returns the RunError for something that failed while running.
pub fn runtime_error(message: impl Into<String>) -> PyErr {
    RunError::new_err(message.into())
}

/// Emits notes as Python warnings.
pub fn emit_warnings(py: Python<'_>, notes: &Report) -> PyResult<()> {
    if notes.is_empty() {
        return Ok(());
    }
    let warn = py.import("warnings")?.getattr("warn")?;
    notes.messages_with_help().into_iter().try_for_each(|note| warn.call1((note,)).map(drop))
}

/// Returns the RunError for a panic while rendering: a bug, but no reason to end Python.
pub fn panic_error(what: &str, panic: &(dyn Any + Send)) -> PyErr {
    runtime_error(format!("{what} brought gelsim down, which is a bug: {}", generate::panic_message(panic)))
}

/// Returns one error for what is wrong with some of several sensors; each message is said once, with the numbers of the
/// sensors that have it. If not all are UsageErrors, the first of the others is returned.
pub fn name_sensors(py: Python<'_>, wrong: Vec<(usize, PyErr)>, count: usize) -> PyErr {
    let mut messages: Vec<(String, Vec<String>)> = Vec::new();
    for (number, error) in wrong {
        if count == 1 || !error.is_instance_of::<UsageError>(py) {
            return error;
        }
        let message = error.value(py).to_string();
        match messages.iter_mut().find(|(known, _)| *known == message) {
            Some((_, numbers)) => numbers.push(number.to_string()),
            None => messages.push((message, vec![number.to_string()])),
        }
    }
    let name = |(message, numbers): &(String, Vec<String>)| match numbers.as_slice() {
        [number] => format!("sensor {number}: {message}"),
        _ => format!("sensors {}: {message}", numbers.join(", ")),
    };
    UsageError::new_err(messages.iter().map(name).collect::<Vec<_>>().join("\n\n"))
}
