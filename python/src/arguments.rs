//! Reads the arguments of functions. An error names the argument and says what to give instead, which Python's own
//! errors do not.

use std::ffi::OsString;
use std::path::PathBuf;

use pyo3::exceptions::{PyOverflowError, PyTypeError, PyUnicodeError};
use pyo3::prelude::*;
use pyo3::types::{PyBool, PyByteArray, PyBytes, PyDict, PyFloat, PyInt, PyList, PyString, PyTuple};

use crate::errors::{LONGEST_NAME, mistake_error};

/// Length of the longest path that Linux accepts, bytes.
const LONGEST_PATH: usize = 4096;

/// Number of items of a list after which signals are checked: a list of a user's class may claim any length.
const BLOCK: usize = 1 << 16;

/// Deepest nesting of lists and dicts in a value of a job.
const DEEPEST_VALUE: usize = 32;

/// Most items of a list in a job.
const MAX_ITEMS: usize = 1 << 20;

/// An argument that the caller may leave out.
pub type OptionalArgument<'a, 'py> = Option<&'a Bound<'py, PyAny>>;

/// Reads an integer from 0 up; `None` if it was left out. `allowed` is the help for a number out of range.
pub fn extract_whole_number(name: &str, given: OptionalArgument<'_, '_>, allowed: &str) -> PyResult<Option<u64>> {
    let Some(given) = given else { return Ok(None) };
    let number = extract_integer(name, given, "a whole number")?;
    match number.map(u64::try_from) {
        Some(Ok(number)) => Ok(Some(number)),
        _ => {
            let value = number.map_or_else(String::new, |number| format!("={number}"));
            Err(mistake_error(format!("{name}{value} is out of range"), allowed))
        }
    }
}

/// Reads an integer; `None` if it is too large for any count.
pub fn extract_integer(name: &str, given: &Bound<'_, PyAny>, wanted: &str) -> PyResult<Option<i128>> {
    match given.extract() {
        Ok(number) => Ok(Some(number)),
        Err(error) if error.is_instance_of::<PyOverflowError>(given.py()) => Ok(None),
        Err(error) => Err(type_error(name, given, wanted, error)),
    }
}

/// Reads a number.
pub fn extract_number(name: &str, given: &Bound<'_, PyAny>) -> PyResult<f64> {
    given.extract().map_err(|error: PyErr| match error.is_instance_of::<PyOverflowError>(given.py()) {
        true => mistake_error(format!("{name} is too large"), "give a number below 1e308"),
        false => type_error(name, given, "a number", error),
    })
}

/// Reads True or False; false if it was left out.
pub fn extract_flag(name: &str, given: OptionalArgument<'_, '_>) -> PyResult<bool> {
    let Some(given) = given else { return Ok(false) };
    given.extract().map_err(|error| type_error(name, given, "True or False", error))
}

/// Reads a text.
pub fn extract_text(name: &str, given: &Bound<'_, PyAny>) -> PyResult<String> {
    let text = given.cast::<PyString>().map_err(|error| type_error(name, given, "a text", error.into()))?;
    text.extract().map_err(|_| mistake_error(format!("{name} is not UTF-8"), "give text without halves of surrogates"))
}

/// Reads a path: text, or an object that Python accepts as a path.
pub fn extract_path(name: &str, given: &Bound<'_, PyAny>) -> PyResult<PathBuf> {
    if given.is_instance_of::<PyString>() {
        let length = given.len()?;
        if length > LONGEST_PATH {
            return Err(mistake_error(format!("{name} has {length} characters"), "give the path of a file"));
        }
    }
    given.extract().map_err(|error| type_error(name, given, "a path: a text or a pathlib.Path", error))
}

/// Reads a list of texts; empty if it was left out.
pub fn extract_texts(name: &str, given: OptionalArgument<'_, '_>) -> PyResult<Vec<String>> {
    let Some(given) = given else { return Ok(Vec::new()) };
    extract_each(name, given, "a list of texts", |item| extract_text(&format!("an item of {name}"), item))
}

/// Reads what `--set` takes: a list of assignments as text, or a mapping of dotted keys to Python values. Empty if it
/// was left out.
pub fn extract_assignments(name: &str, given: OptionalArgument<'_, '_>) -> PyResult<Vec<String>> {
    let Some(given) = given else { return Ok(Vec::new()) };
    let Some(entries) = mapping_entries(given)? else {
        let wanted = "a dict of keys and values, or a list of texts";
        return extract_each(name, given, wanted, |item| extract_text(&format!("an item of {name}"), item));
    };
    extract_each(name, &entries, "a dict", |item| {
        let (key, value) = item.extract::<(Bound<'_, PyAny>, Bound<'_, PyAny>)>()?;
        let key = extract_text(&format!("a key of {name}"), &key)?;
        if key.contains(['=', '\n', '#']) {
            let help = "keys are dotted, such as \"camera.exposure\"; the value stands behind the colon";
            return Err(mistake_error(format!("{name} has no such key: {}", shorten_name(&key)), help));
        }
        let mut assignment = format!("{key} = ");
        write_toml(&format!("{name}[{:?}]", shorten_name(&key)), &value, 0, &mut assignment)?;
        Ok(assignment)
    })
}

/// Returns the keys and values of a mapping; `None` if it is no mapping. Does not use pyo3's own cast, which prints
/// exceptions that the object raises.
fn mapping_entries<'py>(given: &Bound<'py, PyAny>) -> PyResult<Option<Bound<'py, PyAny>>> {
    let is_list = given.is_instance_of::<PyList>() || given.is_instance_of::<PyTuple>();
    let is_mapping = || given.is_instance(&given.py().import("collections.abc")?.getattr("Mapping")?);
    match given.is_instance_of::<PyDict>() || (!is_list && is_mapping()?) {
        true => given.call_method0("items").map(Some),
        false => Ok(None),
    }
}

/// Returns a name short enough for a message.
fn shorten_name(text: &str) -> String {
    text.chars().take(LONGEST_NAME).collect()
}

/// Appends a Python value as TOML; `name` is what messages call it, `depth` how deep it is nested.
pub fn write_toml(name: &str, value: &Bound<'_, PyAny>, depth: usize, toml: &mut String) -> PyResult<()> {
    if depth == DEEPEST_VALUE {
        return Err(mistake_error(
            format!("{name} holds lists in lists without end"),
            "give what a job can have there",
        ));
    }
    if value.is_none() {
        return Err(mistake_error(format!("{name} is None"), "leave the key out: what is left out has its default"));
    }
    if let Ok(flag) = value.cast::<PyBool>() {
        toml.push_str(if flag.is_true() { "true" } else { "false" });
    } else if value.is_instance_of::<PyInt>() {
        let number = extract_integer(name, value, "a number")?.and_then(|number| i64::try_from(number).ok());
        let number =
            number.ok_or_else(|| mistake_error(format!("{name} is out of range"), "no number of a job is so large"))?;
        toml.push_str(&number.to_string());
    } else if value.is_instance_of::<PyFloat>() {
        let number = extract_number(name, value)?;
        toml.push_str(&if number.is_nan() { String::from("nan") } else { format!("{number:?}") });
    } else if value.is_instance_of::<PyString>() {
        let text = extract_text(name, value)?;
        if text.len() > LONGEST_PATH {
            return Err(mistake_error(format!("{name} is a text of {} bytes", text.len()), "give a name or a path"));
        }
        write_toml_text(&text, toml);
    } else if let Some(entries) = mapping_entries(value)? {
        toml.push_str("{ ");
        let entries = extract_each(name, &entries, "a dict", |item| {
            let (key, value) = item.extract::<(Bound<'_, PyAny>, Bound<'_, PyAny>)>()?;
            let mut entry = String::new();
            write_toml_text(&extract_text(&format!("a key of {name}"), &key)?, &mut entry);
            entry.push_str(" = ");
            write_toml(name, &value, depth + 1, &mut entry)?;
            Ok(entry)
        })?;
        toml.push_str(&entries.join(", "));
        toml.push_str(" }");
    } else if value.hasattr("__fspath__")? {
        let path = extract_path(name, value)?.into_os_string().into_string();
        let path = path.map_err(|_| mistake_error(format!("{name} is not UTF-8"), "rename the file or its folder"))?;
        write_toml_text(&path, toml);
    } else if value.hasattr("tolist")? {
        // Numbers and arrays of numpy become numbers and lists of Python.
        write_toml(name, &value.call_method0("tolist")?, depth + 1, toml)?;
    } else {
        if value.len().is_ok_and(|length| length > MAX_ITEMS) {
            return Err(mistake_error(
                format!("{name} is too long"),
                format!("no list of a job has more than {MAX_ITEMS} items"),
            ));
        }
        let entries = extract_each(name, value, "a bool, a number, a text, a list or a dict", |item| {
            let mut entry = String::new();
            write_toml(name, item, depth + 1, &mut entry)?;
            Ok(entry)
        })?;
        toml.push('[');
        toml.push_str(&entries.join(", "));
        toml.push(']');
    }
    Ok(())
}

/// Appends a text as a basic string of TOML.
fn write_toml_text(text: &str, toml: &mut String) {
    toml.push('"');
    for c in text.chars() {
        match c {
            '"' | '\\' => toml.extend(['\\', c]),
            c if c.is_control() => toml.push_str(&format!("\\u{:04X}", u32::from(c))),
            c => toml.push(c),
        }
    }
    toml.push('"');
}

/// Reads the words of a command line.
pub fn extract_words(name: &str, given: &Bound<'_, PyAny>) -> PyResult<Vec<OsString>> {
    let item = |item: &Bound<'_, PyAny>| {
        item.extract().map_err(|error| type_error(&format!("an item of {name}"), item, "a text", error))
    };
    extract_each(name, given, "a list of texts", item)
}

/// Reads the items of a list, or of an object that behaves as one. A class of Python may report any length and yield
/// any number of items: at most its length is read, and no memory is reserved for it beforehand.
pub fn extract_each<T>(
    name: &str,
    given: &Bound<'_, PyAny>,
    wanted: &str,
    item: impl Fn(&Bound<'_, PyAny>) -> PyResult<T>,
) -> PyResult<Vec<T>> {
    let wrong = |error| type_error(name, given, wanted, error);
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

/// Returns the first text or path that was given to a class that takes no arguments, to name it in the error; `None` if
/// there is none, or if it is too long to be a name or a path.
pub fn first_text(given: &Bound<'_, PyTuple>, named: Option<&Bound<'_, PyDict>>) -> Option<String> {
    let by_name = || named?.values().get_item(0).ok();
    let path = given.get_item(0).ok().or_else(by_name)?.extract::<PathBuf>().ok()?;
    path.into_os_string().into_string().ok().filter(|text| !text.is_empty() && text.len() <= LONGEST_NAME)
}

/// Returns the error for an argument that could not be read. An error that the argument itself raised is passed on.
fn type_error(name: &str, given: &Bound<'_, PyAny>, wanted: &str, error: PyErr) -> PyErr {
    let py = given.py();
    if error.is_instance_of::<PyUnicodeError>(py) {
        return mistake_error(format!("{name} is not UTF-8"), "give text without halves of surrogates");
    }
    if !error.is_instance_of::<PyTypeError>(py) {
        return error;
    }
    let wrong = PyTypeError::new_err(format!("{name} is {}; give {wanted}", describe_type(given)));
    wrong.set_cause(py, Some(error));
    wrong
}

/// Describes the type of a value for messages.
pub fn describe_type(given: &Bound<'_, PyAny>) -> String {
    if given.is_none() {
        return String::from("None");
    }
    // A class may hide its name.
    given.get_type().name().map_or_else(|_| String::from("of another type"), |name| format!("of type {name}"))
}
