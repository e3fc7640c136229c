//! Labels of an output: those of real samples with what they had, those of synthetic ones in the same columns.

use csv::{ReaderBuilder, StringRecord, WriterBuilder};
use serde_json::{Map, Value};

use crate::input::columns::{self, Meaning, is_own};
use crate::input::{Form, Set};
use crate::trace::{Trace, TraceColumns};
use gelsim_dataset::encode::json;
use gelsim_job::label::Label;

/// Writes the labels of one set.
pub struct Labels<'a> {
    /// The set.
    pub set: &'a Set,
    /// Columns of the trace.
    pub trace: TraceColumns,
    /// The column of the split, where the output has splits of its own.
    pub split: Option<String>,
}

/// What a synthetic sample is, for the columns of a real set.
pub struct Synthetic<'a> {
    /// Its label.
    pub label: &'a Label,
    /// The point that was placed, mm from the middle of the image.
    pub place_mm: [f64; 2],
    /// Further columns, such as files of layers.
    pub files: Vec<(String, String)>,
}

impl Labels<'_> {
    /// The first line of a table in CSV, which has these columns; nothing of other units.
    pub fn header(&self, form: &Form) -> Vec<u8> {
        let Form::Csv(names) = form else { return Vec::new() };
        let split = self.added_split(names);
        record(names.iter().chain(split).chain(&self.trace.0).map(String::as_str))
    }

    /// The column of the split, if a table with these columns has none yet.
    fn added_split(&self, names: &[String]) -> Option<&String> {
        self.split.as_ref().filter(|split| !names.contains(split))
    }

    /// The label of a real sample, or of one made of it. `text` is the real one's; `changes` are columns that have another
    /// value.
    pub fn real(&self, form: &Form, text: &str, split: &str, changes: &[(&str, Value)], trace: &Trace) -> Vec<u8> {
        match form {
            Form::Csv(names) => {
                let mut cells = cells(text);
                let mut set = |column: &str, value: &str| {
                    if let Some(index) = names.iter().position(|name| name == column) {
                        cells[index] = value.to_owned();
                    }
                };
                for (column, value) in changes {
                    set(column, value.as_str().unwrap_or_default());
                }
                self.split.iter().for_each(|column| set(column, split));
                self.finished(names, cells, split, trace)
            }
            form => {
                let mut bytes = match (changes, &self.split) {
                    ([], None) => self.trace.append(text, trace),
                    _ => {
                        let mut map = object(text);
                        for (column, value) in changes {
                            columns::set(&mut map, column, value.clone());
                        }
                        if let Some(column) = &self.split {
                            columns::set(&mut map, column, Value::from(split));
                        }
                        self.trace.set(&mut map, trace);
                        json(&map)
                    }
                };
                bytes.extend((*form == Form::JsonLines).then_some(b'\n'));
                bytes
            }
        }
    }

    fn finished(&self, names: &[String], mut cells: Vec<String>, split: &str, trace: &Trace) -> Vec<u8> {
        cells.extend(self.added_split(names).map(|_| split.to_owned()));
        record(cells.iter().map(String::as_str).chain(trace.values()))
    }

    /// The label of a synthetic sample that is called `name`: its image's file, or its key.
    pub fn synthetic(&self, form: &Form, sample: &Synthetic<'_>, split: &str, name: &str, trace: &Trace) -> Vec<u8> {
        let mut values = self.values(sample, split);
        if *form != Form::Tar {
            values.push((self.set.image.clone(), Value::from(name)));
        }
        values.extend(sample.files.iter().map(|(column, file)| (column.clone(), Value::from(file.as_str()))));
        match form {
            Form::Csv(names) => {
                let mut cells = vec![String::new(); names.len()];
                for (column, value) in values {
                    if let Some(index) = names.iter().position(|name| *name == column) {
                        cells[index] = value.as_str().map_or_else(|| value.to_string(), str::to_owned);
                    }
                }
                self.finished(names, cells, split, trace)
            }
            form => {
                let listed = |path: &str| values.iter().any(|(column, _)| column.starts_with(&format!("{path}.")));
                let mut map = emptied(&self.set.example, "", &listed);
                if is_own(&self.set.example) {
                    let Ok(Value::Object(own)) = serde_json::to_value(sample.label) else { return Vec::new() };
                    for (key, value) in own {
                        if let Some(there) = map.get_mut(&key) {
                            *there = value;
                        }
                    }
                    if *form == Form::Tar && map.contains_key("key") {
                        map.insert(String::from("key"), Value::from(name));
                    }
                }
                values.into_iter().for_each(|(column, value)| columns::set(&mut map, &column, value));
                self.trace.set(&mut map, trace);
                let mut bytes = json(&map);
                bytes.extend((*form == Form::JsonLines).then_some(b'\n'));
                bytes
            }
        }
    }

    /// The columns whose meaning is known, and their values.
    fn values(&self, sample: &Synthetic<'_>, split: &str) -> Vec<(String, Value)> {
        let Synthetic { label, place_mm, .. } = sample;
        let own = is_own(&self.set.example);
        let value = |meaning: Meaning| {
            Some(match meaning {
                Meaning::Object => Value::from(label.header.object.id.as_str()),
                Meaning::Class => Value::from(label.header.object.class.as_str()),
                Meaning::Split => Value::from(split),
                Meaning::Group => return None,
                Meaning::Depth => Value::from(label.indentation_depth_mm),
                // The complete label is there, and says where the mesh's origin is.
                Meaning::X | Meaning::Y if own => return None,
                Meaning::X => Value::from(place_mm[0]),
                Meaning::Y => Value::from(place_mm[1]),
                Meaning::Yaw => Value::from(label.pose.yaw_deg),
                Meaning::Tilt => Value::from(label.pose.tilt_deg),
                Meaning::TiltAzimuth => Value::from(label.pose.tilt_azimuth_deg),
                Meaning::QuaternionX => Value::from(label.pose.quaternion_xyzw[0]),
                Meaning::QuaternionY => Value::from(label.pose.quaternion_xyzw[1]),
                Meaning::QuaternionZ => Value::from(label.pose.quaternion_xyzw[2]),
                Meaning::QuaternionW => Value::from(label.pose.quaternion_xyzw[3]),
            })
        };
        let known = Meaning::ALL.into_iter().filter_map(|meaning| {
            let column = self.set.columns.name(meaning)?;
            Some((column.to_owned(), value(meaning)?))
        });
        let split = self.split.iter().map(|column| (column.clone(), Value::from(split)));
        known.chain(split).collect()
    }
}

/// The keys of a label in JSON; only objects are let in when labels are read.
pub fn object(text: &str) -> Map<String, Value> {
    serde_json::from_str(text).expect("an object, as when it was read")
}

/// An object with the same keys and nothing in them; of lists, those of which elements are `listed` keep their length.
fn emptied(map: &Map<String, Value>, at: &str, listed: &impl Fn(&str) -> bool) -> Map<String, Value> {
    let nothing = |(key, value): (&String, &Value)| {
        let path = if at.is_empty() { key.clone() } else { format!("{at}.{key}") };
        let nothing = match value {
            Value::Object(inner) => Value::Object(emptied(inner, &path, listed)),
            Value::Array(items) if listed(&path) => Value::Array(vec![Value::Null; items.len()]),
            _ => Value::Null,
        };
        (key.clone(), nothing)
    };
    map.iter().map(nothing).collect()
}

/// The cells of one record.
pub fn cells(text: &str) -> Vec<String> {
    let mut reader = ReaderBuilder::new().has_headers(false).flexible(true).from_reader(text.as_bytes());
    let mut record = StringRecord::new();
    // What was read before can be read again.
    let _ = reader.read_record(&mut record);
    record.iter().map(str::to_owned).collect()
}

/// One record as text.
fn record<'a>(cells: impl Iterator<Item = &'a str>) -> Vec<u8> {
    let mut writer = WriterBuilder::new().from_writer(Vec::new());
    writer.write_record(cells).expect("memory takes what is written");
    writer.into_inner().expect("memory takes what is written")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn cells_come_back_as_they_were_written() {
        let odd = ["plain", "with, comma", "with \"quotes\"", "two\nlines", ""];
        let text = String::from_utf8(record(odd.into_iter())).expect("UTF-8");
        assert_eq!(cells(&text), odd);
    }

    #[test]
    fn what_a_synthetic_sample_cannot_fill_is_null_in_the_same_keys() {
        let map = serde_json::from_str(r#"{"a":1,"b":{"c":[1],"d":"x","e":[2,3]}}"#).expect("JSON");
        let nothing = serde_json::to_string(&emptied(&map, "", &|path| path == "b.e")).expect("JSON");
        assert_eq!(nothing, r#"{"a":null,"b":{"c":null,"d":null,"e":[null,null]}}"#);
    }
}
