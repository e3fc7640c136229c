//! Trace of each sample of an output to its source: three columns of its label.

use serde_json::{Map, Value};

use super::input::LabelFormat;

/// Source of a sample.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Source {
    /// A real sample as it was.
    Real,
    /// A real image as other LEDs, another pad or camera would have shown it.
    Photometric,
    /// The simulated counterpart of a real sample.
    Counterpart,
    /// A new sample of a job.
    Synthetic,
}

impl Source {
    /// All sources.
    pub const ALL: [Self; 4] = [Self::Real, Self::Photometric, Self::Counterpart, Self::Synthetic];

    /// Name in labels.
    pub fn name(self) -> &'static str {
        match self {
            Self::Real => "real",
            Self::Photometric => "photometric",
            Self::Counterpart => "twin",
            Self::Synthetic => "synthetic",
        }
    }
}

/// Where a sample comes from, as its label states it.
#[derive(Clone, Debug, PartialEq)]
pub struct Trace {
    /// Source of the sample.
    pub source: Source,
    /// Key of the real sample that it derives from; for others empty, or in CSV the sample's own name.
    pub source_key: String,
    /// Values drawn for it, as JSON; for a real one empty, or in CSV an empty object.
    pub augmentation: String,
}

impl Trace {
    /// Fills what is empty if labels are CSV; `own` is the sample's own name. In a split without any text, pandas would
    /// take the column for numbers, and such splits do not fit those with text.
    pub fn fill_for_csv(&mut self, form: &LabelFormat, own: &str) {
        if !matches!(form, LabelFormat::Csv(_)) {
            return;
        }
        if self.source_key.is_empty() {
            self.source_key = own.to_owned();
        }
        if self.augmentation.is_empty() {
            self.augmentation = String::from("{}");
        }
    }

    /// Values in the order of [`TraceColumns`].
    pub fn column_values(&self) -> [&str; 3] {
        [self.source.name(), &self.source_key, &self.augmentation]
    }
}

/// Names of the three columns of the trace.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct TraceColumns(pub [String; 3]);

impl TraceColumns {
    /// Creates the names, with `prefix` before each.
    pub fn new(prefix: &str) -> Self {
        Self(["source", "source_key", "augmentation"].map(|name| format!("{prefix}{name}")))
    }

    /// Appends a trace to the text of a JSON object. The rest of the text is unchanged.
    pub fn append_to_json(&self, object: &str, trace: &Trace) -> Vec<u8> {
        let body = object.trim_end().strip_suffix('}').unwrap_or(object).trim_end();
        let mut text = body.to_owned();
        for (name, value) in self.0.iter().zip(trace.column_values()) {
            let comma = if text.ends_with('{') { "" } else { "," };
            text += &format!("{comma}{}:{}", Value::from(name.as_str()), Value::from(value));
        }
        text.push('}');
        text.into_bytes()
    }

    /// Inserts a trace into an object.
    pub fn insert_into(&self, object: &mut Map<String, Value>, trace: &Trace) {
        for (name, value) in self.0.iter().zip(trace.column_values()) {
            object.insert(name.clone(), Value::from(value));
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_label_keeps_its_text_and_gets_three_keys() {
        let trace =
            Trace { source: Source::Counterpart, source_key: String::from("a\"b"), augmentation: String::from("{}") };
        let columns = TraceColumns::new("x_");
        let append = |text: &str| String::from_utf8(columns.append_to_json(text, &trace)).expect("UTF-8");
        let end = "\"x_source\":\"twin\",\"x_source_key\":\"a\\\"b\",\"x_augmentation\":\"{}\"}";
        assert_eq!(append("{\"n\": 1e-7 }\n"), format!("{{\"n\": 1e-7,{end}"));
        assert_eq!(append("{ }"), format!("{{{end}"));
        let mut map = Map::new();
        columns.insert_into(&mut map, &trace);
        assert_eq!(serde_json::to_string(&map).expect("JSON"), format!("{{{end}"));
    }
}
