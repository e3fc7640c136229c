//! The label of a sample as a file has it: of a press, of a sequence, or of a grip.

use serde::Serialize;
use serde_json::Value;

use crate::job::gripper::FINGERS;
use crate::job::gripper::label::GripLabel;
use crate::job::label::{Label, SCHEMA_VERSION};
use crate::job::sequence::label::SequenceLabel;

/// A label that was read.
#[derive(Clone, Debug, PartialEq)]
pub enum SampleLabel {
    /// Of a press.
    Press(Box<Label>),
    /// Of a sequence; with what counts of it as a whole.
    Sequence(Box<SequenceLabel>, Box<Label>),
    /// Of a grip; likewise.
    Grip(Box<GripLabel>, Box<Label>),
}

impl SampleLabel {
    /// Reads it; what is wrong with it.
    pub fn read(bytes: &[u8]) -> Result<Self, String> {
        let value: Value = serde_json::from_slice(bytes).map_err(|error| error.to_string())?;
        if let Some(version) = value["schema_version"].as_u64().filter(|version| *version != u64::from(SCHEMA_VERSION))
        {
            return Err(format!("has version {version} of the schema, this gelsim knows {SCHEMA_VERSION}"));
        }
        Self::of(value)
    }

    fn of(value: Value) -> Result<Self, String> {
        let said = |error: serde_json::Error| error.to_string();
        if value.get("gripper").is_some() {
            let label: Box<GripLabel> = serde_json::from_value(value).map_err(said)?;
            let summary = label.summary();
            return Ok(Self::Grip(label, Box::new(summary)));
        }
        if value.get("sequence").is_none() {
            return serde_json::from_value(value).map(Self::Press).map_err(said);
        }
        let label: Box<SequenceLabel> = serde_json::from_value(value).map_err(said)?;
        if label.frames.len() != label.common.sequence.frames as usize {
            return Err(format!("{} frames, it says {}", label.frames.len(), label.common.sequence.frames));
        }
        let summary = label.summary().ok_or_else(|| String::from("a sequence without frames"))?;
        Ok(Self::Sequence(label, Box::new(summary)))
    }

    /// The same, if it has no key that the schema does not know.
    pub fn read_strictly(bytes: &[u8]) -> Result<Self, String> {
        let label = Self::read(bytes)?;
        let written = match &label {
            Self::Press(label) => value(&**label),
            Self::Sequence(label, _) => value(&**label),
            Self::Grip(label, _) => value(&**label),
        };
        let same = serde_json::from_slice::<Value>(bytes).is_ok_and(|read| Some(read) == written);
        if same { Ok(label) } else { Err(String::from("has keys that the schema does not know")) }
    }

    /// What counts of the sample as a whole.
    pub fn summary(&self) -> &Label {
        match self {
            Self::Press(label) => label,
            Self::Sequence(_, summary) | Self::Grip(_, summary) => summary,
        }
    }

    /// The frames of a sequence.
    pub fn sequence(&self) -> Option<&SequenceLabel> {
        match self {
            Self::Press(_) | Self::Grip(..) => None,
            Self::Sequence(label, _) => Some(label),
        }
    }

    /// Both fingers of a grip.
    pub fn grip(&self) -> Option<&GripLabel> {
        match self {
            Self::Press(_) | Self::Sequence(..) => None,
            Self::Grip(label, _) => Some(label),
        }
    }
}

/// The end of a file's name, after its sample's key, with the frame or the finger that it begins with, if it is a file of one.
pub fn split(suffix: &str) -> (Option<&str>, &str) {
    let is_frame = |name: &str| {
        name.strip_prefix('f').is_some_and(|number| number.len() >= 4 && number.bytes().all(|c| c.is_ascii_digit()))
    };
    match suffix.split_once('.') {
        Some((name, rest)) if is_frame(name) || FINGERS.contains(&name) => (Some(name), rest),
        _ => (None, suffix),
    }
}

fn value(label: &impl Serialize) -> Option<Value> {
    serde_json::to_value(label).ok()
}
