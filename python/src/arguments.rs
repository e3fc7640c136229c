//! What functions are given. A mistake names its argument and says what to give instead: Python's own words do not.

use std::ffi::OsString;
use std::path::PathBuf;

use pyo3::exceptions::{PyOverflowError, PyTypeError, PyUnicodeError};
use pyo3::prelude::*;
use pyo3::types::{PyBool, PyByteArray, PyBytes, PyDict, PyFloat, PyInt, PyList, PyString, PyTuple};

use crate::errors::{LONGEST_NAME, mistake};

/// Longest path that Linux takes, bytes.
const LONGEST_PATH: usize = 4096;

/// Items of a list between looks at signals: it may have as many as its author says.
const BLOCK: usize = 1 << 16;

/// Lists and dicts within each other in a value of a job.
const DEEPEST_VALUE: usize = 32;

/// Items of a list in a job.
const MOST_ITEMS: usize = 1 << 20;

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

/// What `--set` takes: assignments as texts, or a mapping of dotted keys to values of Python.
pub fn assignments(name: &str, given: Given<'_, '_>) -> PyResult<Vec<String>> {
    let Some(given) = given else { return Ok(Vec::new()) };
    let Some(entries) = entries(given)? else {
        let wanted = "a dict of keys and values, or a list of texts";
        return each(name, given, wanted, |item| text(&format!("an item of {name}"), item));
    };
    each(name, &entries, "a dict", |item| {
        let (key, value) = item.extract::<(Bound<'_, PyAny>, Bound<'_, PyAny>)>()?;
        let key = text(&format!("a key of {name}"), &key)?;
        if key.contains(['=', '\n', '#']) {
            let help = "keys are dotted, such as \"camera.exposure\"; the value stands behind the colon";
            return Err(mistake(format!("{name} has no such key: {}", shortened(&key)), help));
        }
        let mut assignment = format!("{key} = ");
        write_toml(&format!("{name}[{:?}]", shortened(&key)), &value, 0, &mut assignment)?;
        Ok(assignment)
    })
}

/// The keys and values of a mapping; none of what is no mapping. pyo3's own cast prints what an object raises when it is asked.
fn entries<'py>(given: &Bound<'py, PyAny>) -> PyResult<Option<Bound<'py, PyAny>>> {
    let is_list = given.is_instance_of::<PyList>() || given.is_instance_of::<PyTuple>();
    let is_mapping = || given.is_instance(&given.py().import("collections.abc")?.getattr("Mapping")?);
    match given.is_instance_of::<PyDict>() || (!is_list && is_mapping()?) {
        true => given.call_method0("items").map(Some),
        false => Ok(None),
    }
}

/// A name as messages show it.
fn shortened(text: &str) -> String {
    text.chars().take(LONGEST_NAME).collect()
}

/// A value of Python as TOML; `name` is what messages call it.
pub fn write_toml(name: &str, value: &Bound<'_, PyAny>, depth: usize, toml: &mut String) -> PyResult<()> {
    if depth == DEEPEST_VALUE {
        return Err(mistake(format!("{name} holds lists in lists without end"), "give what a job can have there"));
    }
    if value.is_none() {
        return Err(mistake(format!("{name} is None"), "leave the key out: what is left out has its default"));
    }
    if let Ok(flag) = value.cast::<PyBool>() {
        toml.push_str(if flag.is_true() { "true" } else { "false" });
    } else if value.is_instance_of::<PyInt>() {
        let number = integer(name, value, "a number")?.and_then(|number| i64::try_from(number).ok());
        let number =
            number.ok_or_else(|| mistake(format!("{name} is out of range"), "no number of a job is so large"))?;
        toml.push_str(&number.to_string());
    } else if value.is_instance_of::<PyFloat>() {
        let number = number(name, value)?;
        toml.push_str(&if number.is_nan() { String::from("nan") } else { format!("{number:?}") });
    } else if value.is_instance_of::<PyString>() {
        let text = text(name, value)?;
        if text.len() > LONGEST_PATH {
            return Err(mistake(format!("{name} is a text of {} bytes", text.len()), "give a name or a path"));
        }
        write_toml_text(&text, toml);
    } else if let Some(entries) = entries(value)? {
        toml.push_str("{ ");
        let entries = each(name, &entries, "a dict", |item| {
            let (key, value) = item.extract::<(Bound<'_, PyAny>, Bound<'_, PyAny>)>()?;
            let mut entry = String::new();
            write_toml_text(&text(&format!("a key of {name}"), &key)?, &mut entry);
            entry.push_str(" = ");
            write_toml(name, &value, depth + 1, &mut entry)?;
            Ok(entry)
        })?;
        toml.push_str(&entries.join(", "));
        toml.push_str(" }");
    } else if value.hasattr("__fspath__")? {
        let path = path(name, value)?.into_os_string().into_string();
        let path = path.map_err(|_| mistake(format!("{name} is not UTF-8"), "rename the file or its folder"))?;
        write_toml_text(&path, toml);
    } else if value.hasattr("tolist")? {
        // Numbers and arrays of numpy.
        write_toml(name, &value.call_method0("tolist")?, depth + 1, toml)?;
    } else {
        if value.len().is_ok_and(|length| length > MOST_ITEMS) {
            return Err(mistake(
                format!("{name} is too long"),
                format!("no list of a job has more than {MOST_ITEMS} items"),
            ));
        }
        let entries = each(name, value, "a bool, a number, a text, a list or a dict", |item| {
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

/// A text as a basic string of TOML.
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
