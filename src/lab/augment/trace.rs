//! Where each sample of an output comes from: three columns of its label.

use serde_json::{Map, Value};

/// What a sample is.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Source {
    /// A real sample as it was.
    Real,
    /// A real image as other LEDs, another pad or camera would have shown it.
    Photometric,
    /// The simulation of a real sample.
    Counterpart,
    /// A new sample of a job.
    Synthetic,
}

impl Source {
    /// All of them.
    pub const ALL: [Self; 4] = [Self::Real, Self::Photometric, Self::Counterpart, Self::Synthetic];

    /// As it stands in labels.
    pub fn name(self) -> &'static str {
        match self {
            Self::Real => "real",
            Self::Photometric => "photometric",
            Self::Counterpart => "twin",
            Self::Synthetic => "synthetic",
        }
    }
}

/// What a label says of where its sample comes from.
#[derive(Clone, Debug, PartialEq)]
pub struct Trace {
    /// What it is.
    pub source: Source,
    /// The real sample that it comes from; empty of a synthetic one.
    pub source_key: String,
    /// What was drawn for it, as JSON; empty of a real one.
    pub augmentation: String,
}

impl Trace {
    /// Its values, in the order of [`TraceColumns`].
    pub fn values(&self) -> [&str; 3] {
        [self.source.name(), &self.source_key, &self.augmentation]
    }
}

/// Names of the three columns.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct TraceColumns(pub [String; 3]);

impl TraceColumns {
    /// With `prefix` before each.
    pub fn new(prefix: &str) -> Self {
        Self(["source", "source_key", "augmentation"].map(|name| format!("{prefix}{name}")))
    }

    /// Appends a trace to the text of a JSON object, which stays as it is otherwise.
    pub fn append(&self, object: &str, trace: &Trace) -> Vec<u8> {
        let body = object.trim_end().strip_suffix('}').unwrap_or(object).trim_end();
        let mut text = body.to_owned();
        for (name, value) in self.0.iter().zip(trace.values()) {
            let comma = if text.ends_with('{') { "" } else { "," };
            text += &format!("{comma}{}:{}", Value::from(name.as_str()), Value::from(value));
        }
        text.push('}');
        text.into_bytes()
    }

    /// Sets a trace in an object.
    pub fn set(&self, object: &mut Map<String, Value>, trace: &Trace) {
        for (name, value) in self.0.iter().zip(trace.values()) {
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
        let append = |text: &str| String::from_utf8(columns.append(text, &trace)).expect("UTF-8");
        let end = "\"x_source\":\"twin\",\"x_source_key\":\"a\\\"b\",\"x_augmentation\":\"{}\"}";
        assert_eq!(append("{\"n\": 1e-7 }\n"), format!("{{\"n\": 1e-7,{end}"));
        assert_eq!(append("{ }"), format!("{{{end}"));
        let mut map = Map::new();
        columns.set(&mut map, &trace);
        assert_eq!(serde_json::to_string(&map).expect("JSON"), format!("{{{end}"));
    }
}
