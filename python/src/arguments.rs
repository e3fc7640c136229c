//! What functions are given. A mistake names its argument and says what to give instead: Python's own words do not.

use std::ffi::OsString;
use std::path::PathBuf;

use pyo3::exceptions::{PyOverflowError, PyTypeError, PyUnicodeError};
use pyo3::prelude::*;
use pyo3::types::{PyByteArray, PyBytes, PyDict, PyString, PyTuple};

use crate::errors::{LONGEST_NAME, mistake};

/// Longest path that Linux takes, bytes.
const LONGEST_PATH: usize = 4096;

/// Items of a list between looks at signals: it may have as many as its author says.
const BLOCK: usize = 1 << 16;

/// An argument that may be left out.
pub type Given<'a, 'py> = Option<&'a Bound<'py, PyAny>>;

/// A whole number of 0 or more; `allowed` says which ones this argument takes, to whoever gave none.
pub fn whole(name: &str, given: Given<'_, '_>, allowed: &str) -> PyResult<Option<u64>> {
    let Some(given) = given else { return Ok(None) };
    let number = integer(name, given, "a whole number")?;
    match number.map(u64::try_from) {
        Some(Ok(number)) => Ok(Some(number)),
        _ => {
            let value = number.map_or_else(String::new, |number| format!("={number}"));
            Err(mistake(format!("{name}{value} is out of range"), allowed))
        }
    }
}

/// Any whole number; none if it is larger than any that counts something.
pub fn integer(name: &str, given: &Bound<'_, PyAny>, wanted: &str) -> PyResult<Option<i128>> {
    match given.extract() {
        Ok(number) => Ok(Some(number)),
        Err(error) if error.is_instance_of::<PyOverflowError>(given.py()) => Ok(None),
        Err(error) => Err(not(name, given, wanted, error)),
    }
}

/// Any number.
pub fn number(name: &str, given: &Bound<'_, PyAny>) -> PyResult<f64> {
    given.extract().map_err(|error| not(name, given, "a number", error))
}

/// True or false.
pub fn flag(name: &str, given: Given<'_, '_>) -> PyResult<bool> {
    let Some(given) = given else { return Ok(false) };
    given.extract().map_err(|error| not(name, given, "True or False", error))
}

/// A text.
pub fn text(name: &str, given: &Bound<'_, PyAny>) -> PyResult<String> {
    let text = given.cast::<PyString>().map_err(|error| not(name, given, "a text", error.into()))?;
    text.extract().map_err(|_| mistake(format!("{name} is not UTF-8"), "give text without halves of surrogates"))
}

/// A path: text, or what Python takes for a path.
pub fn path(name: &str, given: &Bound<'_, PyAny>) -> PyResult<PathBuf> {
    if given.is_instance_of::<PyString>() {
        let length = given.len()?;
        if length > LONGEST_PATH {
            return Err(mistake(format!("{name} has {length} characters"), "give the path of a file"));
        }
    }
    given.extract().map_err(|error| not(name, given, "a path: a text or a pathlib.Path", error))
}

/// Texts.
pub fn texts(name: &str, given: Given<'_, '_>) -> PyResult<Vec<String>> {
    let Some(given) = given else { return Ok(Vec::new()) };
    each(name, given, "a list of texts", |item| text(&format!("an item of {name}"), item))
}

/// The words of a command line.
pub fn words(name: &str, given: &Bound<'_, PyAny>) -> PyResult<Vec<OsString>> {
    let item = |item: &Bound<'_, PyAny>| {
        item.extract().map_err(|error| not(&format!("an item of {name}"), item, "a text", error))
    };
    each(name, given, "a list of texts", item)
}

/// The items of a list, or of what is as good as one: no more than its length, and no memory for them beforehand, as a
/// class of Python may say anything of either.
pub fn each<T>(
    name: &str,
    given: &Bound<'_, PyAny>,
    wanted: &str,
    item: impl Fn(&Bound<'_, PyAny>) -> PyResult<T>,
) -> PyResult<Vec<T>> {
    let wrong = |error| not(name, given, wanted, error);
    if given.is_instance_of::<PyString>() || given.is_instance_of::<PyBytes>() || given.is_instance_of::<PyByteArray>()
    {
        return Err(wrong(PyTypeError::new_err("its items are characters")));
    }
    let length = given.len().map_err(wrong)?;
    let mut items = Vec::new();
    for (number, found) in given.try_iter().map_err(wrong)?.take(length).enumerate() {
        items.push(item(&found?)?);
        if number % BLOCK == BLOCK - 1 {
            given.py().check_signals()?;
        }
    }
    Ok(items)
}

/// The text or path that somebody gave first to what takes no arguments, if it is as short as a name or a path.
pub fn first(given: &Bound<'_, PyTuple>, named: Option<&Bound<'_, PyDict>>) -> Option<String> {
    let by_name = || named?.values().get_item(0).ok();
    let path = given.get_item(0).ok().or_else(by_name)?.extract::<PathBuf>().ok()?;
    path.into_os_string().into_string().ok().filter(|text| !text.is_empty() && text.len() <= LONGEST_NAME)
}

/// What to raise where an argument could not be read: an error of the argument's own is passed on.
fn not(name: &str, given: &Bound<'_, PyAny>, wanted: &str, error: PyErr) -> PyErr {
    let py = given.py();
    if error.is_instance_of::<PyUnicodeError>(py) {
        return mistake(format!("{name} is not UTF-8"), "give text without halves of surrogates");
    }
    if !error.is_instance_of::<PyTypeError>(py) {
        return error;
    }
    let wrong = PyTypeError::new_err(format!("{name} is {}; give {wanted}", kind(given)));
    wrong.set_cause(py, Some(error));
    wrong
}

/// What something is, for messages.
pub fn kind(given: &Bound<'_, PyAny>) -> String {
    if given.is_none() {
        return String::from("None");
    }
    // A class may hide its name.
    given.get_type().name().map_or_else(|_| String::from("of another type"), |name| format!("of type {name}"))
}
