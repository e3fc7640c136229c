//! Labels of an output: those of real samples as they were, those of synthetic ones in the same columns.

use std::collections::BTreeMap;

use csv::{ReaderBuilder, StringRecord, WriterBuilder};
use serde_json::{Map, Value};

use crate::input::columns::{self, ColumnMeaning, is_own_label};
use crate::input::{LabelFormat, RealDataset};
use crate::trace::{Trace, TraceColumns};
use gelsim_dataset::encode::to_json_line;
use gelsim_job::label::Label;

/// Writes the labels of one set.
pub struct LabelWriter<'a> {
    /// The real dataset.
    pub set: &'a RealDataset,
    /// Columns of the trace.
    pub trace: TraceColumns,
    /// Column of the split, if the output has new splits.
    pub split: Option<String>,
    /// Number of each class in labels of gelsim.
    pub class_numbers: BTreeMap<String, u64>,
}

/// A synthetic sample, for the columns of a real set.
pub struct SyntheticSample<'a> {
    /// Key of the sample in the output.
    pub key: &'a str,
    /// Label of the sample, as in a dataset of its job.
    pub label: &'a Label,
    /// The point that was placed, mm from the middle of the image.
    pub place_mm: [f64; 2],
    /// Further columns, such as files of layers.
    pub files: Vec<(String, String)>,
}

impl LabelWriter<'_> {
    /// Encodes the first line of a CSV table with these columns; empty for other formats.
    pub fn encode_csv_header(&self, form: &LabelFormat) -> Vec<u8> {
        let LabelFormat::Csv(names) = form else { return Vec::new() };
        let split = self.added_split_column(names);
        encode_csv_record(names.iter().chain(split).chain(&self.trace.0).map(String::as_str))
    }

    /// Returns the column of the split if a table with these columns does not have it yet.
    fn added_split_column(&self, names: &[String]) -> Option<&String> {
        self.split.as_ref().filter(|split| !names.contains(split))
    }

    /// Encodes the label of a real sample, or of one derived from it. `text` is the real one's; `changes` are columns
    /// with other values.
    pub fn encode_real_label(
        &self,
        form: &LabelFormat,
        text: &str,
        split: &str,
        changes: &[(&str, Value)],
        trace: &Trace,
    ) -> Vec<u8> {
        match form {
            LabelFormat::Csv(names) => {
                let mut cells = parse_csv_record(text);
                let mut set = |column: &str, value: &str| {
                    if let Some(index) = names.iter().position(|name| name == column) {
                        cells[index] = value.to_owned();
                    }
                };
                for (column, value) in changes {
                    set(column, value.as_str().unwrap_or_default());
                }
                self.split.iter().for_each(|column| set(column, split));
                self.encode_csv_row(names, cells, split, trace)
            }
            form => {
                let mut bytes = match (changes, &self.split) {
                    ([], None) => self.trace.append_to_json(text, trace),
                    _ => {
                        let mut map = parse_object(text);
                        for (column, value) in changes {
                            columns::set_value(&mut map, column, value.clone());
                        }
                        if let Some(column) = &self.split {
                            columns::set_value(&mut map, column, Value::from(split));
                        }
                        self.trace.insert_into(&mut map, trace);
                        to_json_line(&map)
                    }
                };
                bytes.extend((*form == LabelFormat::JsonLines).then_some(b'\n'));
                bytes
            }
        }
    }

    fn encode_csv_row(&self, names: &[String], mut cells: Vec<String>, split: &str, trace: &Trace) -> Vec<u8> {
        cells.extend(self.added_split_column(names).map(|_| split.to_owned()));
        encode_csv_record(cells.iter().map(String::as_str).chain(trace.column_values()))
    }

    /// Encodes the label of a synthetic sample; `name` is its image's file as labels have it.
    pub fn encode_synthetic_label(
        &self,
        form: &LabelFormat,
        sample: &SyntheticSample<'_>,
        split: &str,
        name: &str,
        trace: &Trace,
    ) -> Vec<u8> {
        let mut values = self.known_column_values(sample, split);
        if *form != LabelFormat::Tar {
            values.push((self.set.image_column.clone(), Value::from(name)));
        }
        values.extend(sample.files.iter().map(|(column, file)| (column.clone(), Value::from(file.as_str()))));
        match form {
            LabelFormat::Csv(names) => {
                let mut cells = vec![String::new(); names.len()];
                for (column, value) in values {
                    if let Some(index) = names.iter().position(|name| *name == column) {
                        cells[index] = value.as_str().map_or_else(|| value.to_string(), str::to_owned);
                    }
                }
                self.encode_csv_row(names, cells, split, trace)
            }
            form => {
                let listed = |path: &str| values.iter().any(|(column, _)| column.starts_with(&format!("{path}.")));
                let mut map = clear_values(&self.set.example, "", &listed);
                if is_own_label(&self.set.example) {
                    let Ok(Value::Object(mut own)) = serde_json::to_value(sample.label) else { return Vec::new() };
                    own.insert(String::from("key"), Value::from(sample.key));
                    self.number_classes_of(&mut own);
                    for (key, value) in own {
                        if let Some(slot) = map.get_mut(&key) {
                            *slot = value;
                        }
                    }
                }
                values.into_iter().for_each(|(column, value)| columns::set_value(&mut map, &column, value));
                self.trace.insert_into(&mut map, trace);
                let mut bytes = to_json_line(&map);
                bytes.extend((*form == LabelFormat::JsonLines).then_some(b'\n'));
                bytes
            }
        }
    }

    /// Gives the classes in a label of the job the numbers that they have in the set.
    fn number_classes_of(&self, label: &mut Map<String, Value>) {
        let renumber = |object: &mut Value| {
            let number = object.get("class").and_then(Value::as_str).and_then(|class| self.class_numbers.get(class));
            if let (Some(number), Some(slot)) = (number.copied(), object.get_mut("class_index")) {
                *slot = Value::from(number);
            }
        };
        label.get_mut("object").into_iter().for_each(renumber);
        label.get_mut("objects").and_then(Value::as_array_mut).into_iter().flatten().for_each(renumber);
    }

    /// Returns the columns whose meaning is known, with their values.
    fn known_column_values(&self, sample: &SyntheticSample<'_>, split: &str) -> Vec<(String, Value)> {
        let SyntheticSample { label, place_mm, .. } = sample;
        let own = is_own_label(&self.set.example);
        let value = |meaning: ColumnMeaning| {
            Some(match meaning {
                ColumnMeaning::Object => Value::from(label.header.object.id.as_str()),
                ColumnMeaning::Class => Value::from(label.header.object.class.as_str()),
                ColumnMeaning::Split => Value::from(split),
                ColumnMeaning::Group => return None,
                ColumnMeaning::Depth => Value::from(label.indentation_depth_mm),
                // The complete label is written, which has the place of the mesh's origin.
                ColumnMeaning::X | ColumnMeaning::Y if own => return None,
                ColumnMeaning::X => Value::from(place_mm[0]),
                ColumnMeaning::Y => Value::from(place_mm[1]),
                ColumnMeaning::Yaw => Value::from(label.pose.yaw_deg),
                ColumnMeaning::Tilt => Value::from(label.pose.tilt_deg),
                ColumnMeaning::TiltAzimuth => Value::from(label.pose.tilt_azimuth_deg),
                ColumnMeaning::QuaternionX => Value::from(label.pose.quaternion_xyzw[0]),
                ColumnMeaning::QuaternionY => Value::from(label.pose.quaternion_xyzw[1]),
                ColumnMeaning::QuaternionZ => Value::from(label.pose.quaternion_xyzw[2]),
                ColumnMeaning::QuaternionW => Value::from(label.pose.quaternion_xyzw[3]),
            })
        };
        let known = ColumnMeaning::ALL.into_iter().filter_map(|meaning| {
            let column = self.set.columns.column_of(meaning)?;
            Some((column.to_owned(), value(meaning)?))
        });
        let split = self.split.iter().map(|column| (column.clone(), Value::from(split)));
        known.chain(split).collect()
    }
}

/// Parses a label in JSON. Labels that are no objects were refused when they were read.
pub fn parse_object(text: &str) -> Map<String, Value> {
    serde_json::from_str(text).expect("an object, as when it was read")
}

/// Returns an object with the same keys but empty values. Lists whose elements are `listed` keep their length.
fn clear_values(map: &Map<String, Value>, at: &str, listed: &impl Fn(&str) -> bool) -> Map<String, Value> {
    let nothing = |(key, value): (&String, &Value)| {
        let path = if at.is_empty() { key.clone() } else { format!("{at}.{key}") };
        let nothing = match value {
            Value::Object(inner) => Value::Object(clear_values(inner, &path, listed)),
            Value::Array(items) if listed(&path) => Value::Array(vec![Value::Null; items.len()]),
            _ => Value::Null,
        };
        (key.clone(), nothing)
    };
    map.iter().map(nothing).collect()
}

/// Parses the cells of one record.
pub fn parse_csv_record(text: &str) -> Vec<String> {
    let mut reader = ReaderBuilder::new().has_headers(false).flexible(true).from_reader(text.as_bytes());
    let mut record = StringRecord::new();
    // The text was read before, so it can be read again.
    let _ = reader.read_record(&mut record);
    record.iter().map(str::to_owned).collect()
}

/// Encodes one record as text.
fn encode_csv_record<'a>(cells: impl Iterator<Item = &'a str>) -> Vec<u8> {
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
        let text = String::from_utf8(encode_csv_record(odd.into_iter())).expect("UTF-8");
        assert_eq!(parse_csv_record(&text), odd);
    }

    #[test]
    fn what_a_synthetic_sample_cannot_fill_is_null_in_the_same_keys() {
        let map = serde_json::from_str(r#"{"a":1,"b":{"c":[1],"d":"x","e":[2,3]}}"#).expect("JSON");
        let nothing = serde_json::to_string(&clear_values(&map, "", &|path| path == "b.e")).expect("JSON");
        assert_eq!(nothing, r#"{"a":null,"b":{"c":null,"d":null,"e":[null,null]}}"#);
    }
}
