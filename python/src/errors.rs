//! The command's two kinds of failure as Python's exceptions, in the command's words.

use std::any::Any;

use gelsim_core::fidelity::Fidelity;
use gelsim_dataset::generate;
use gelsim_files::diagnostic::user_error;
use gelsim_files::diagnostic::{Display, Report};
use gelsim_files::spelling::one_of;
use gelsim_job::config::of_choice;
use pyo3::create_exception;
use pyo3::exceptions::{PyRuntimeError, PyValueError};
use pyo3::prelude::*;

use crate::arguments::text;

/// Longer than every name there is.
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

/// What the command would print of mistakes.
pub fn usage(report: &Report) -> PyErr {
    UsageError::new_err(report.render(Display::PLAIN))
}

/// One mistake in what a function was given, and the way out.
pub fn mistake(message: impl Into<String>, help: impl Into<String>) -> PyErr {
    usage(&user_error(message, help))
}

/// What a user calls by its name; `what` it is, for the message if there is none.
pub fn named<T>(what: &str, name: &str, known: impl IntoIterator<Item = (&'static str, T)>) -> PyResult<T> {
    let mut names = Vec::new();
    for (candidate, value) in known {
        if candidate == name {
            return Ok(value);
        }
        names.push(candidate);
    }
    // Whoever gives a file's text in place of its name shall not read it again.
    if name.chars().nth(LONGEST_NAME).is_some() {
        let help = format!("one of {}", one_of(&names));
        return Err(mistake(format!("no {what} has a name of {} bytes", name.len()), help));
    }
    Err(mistake(format!("no {what} is called `{name}`"), of_choice(name, &names)))
}

/// A fidelity level by its name.
pub fn fidelity_level(given: &Bound<'_, PyAny>) -> PyResult<Fidelity> {
    named("fidelity level", &text("fidelity", given)?, Fidelity::ALL.map(|level| (level.name(), level)))
}

/// Something failed while running.
pub fn running(message: impl Into<String>) -> PyErr {
    RunError::new_err(message.into())
}

/// What is no mistake, but should be known, as Python's warnings.
pub fn warn(py: Python<'_>, notes: &Report) -> PyResult<()> {
    if notes.is_empty() {
        return Ok(());
    }
    let warn = py.import("warnings")?.getattr("warn")?;
    notes.texts().into_iter().try_for_each(|note| warn.call1((note,)).map(drop))
}

/// A panic while something was rendered: a bug, but no reason to end Python.
pub fn panicked(what: &str, panic: &(dyn Any + Send)) -> PyErr {
    running(format!("{what} brought gelsim down, which is a bug: {}", generate::said(panic)))
}
