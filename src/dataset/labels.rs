//! Reads the label of a sample: of a press, of a sequence, or of a grip.

use serde::{Serialize, Serializer};
use serde_json::Value;

use gelsim_job::gripper::FINGER_NAMES;
use gelsim_job::gripper::label::{GripLabel, GripSequenceLabel};
use gelsim_job::label::{Label, SCHEMA_VERSION, SensorLabel};
use gelsim_job::sequence::label::SequenceLabel;

/// A label that was read, with a summary for the kinds that have no single [`Label`].
#[derive(Clone, Debug, PartialEq)]
pub enum SampleLabel {
    /// The label of a press.
    Press(Box<Label>),
    /// The label of a sequence, and its summary.
    Sequence(Box<SequenceLabel>, Box<Label>),
    /// The label of a grip, and its summary.
    Grip(Box<GripLabel>, Box<Label>),
    /// The label of a sequence of grips, and its summary.
    GripSequence(Box<GripSequenceLabel>, Box<Label>),
}

impl SampleLabel {
    /// Reads a label. The error says what is wrong with it.
    pub fn read(bytes: &[u8]) -> Result<Self, String> {
        let value: Value = serde_json::from_slice(bytes).map_err(|error| error.to_string())?;
        if let Some(version) = value["schema_version"].as_u64().filter(|version| *version != u64::from(SCHEMA_VERSION))
        {
            return Err(format!("has version {version} of the schema, this gelsim knows {SCHEMA_VERSION}"));
        }
        Self::from_value(value)
    }

    fn from_value(value: Value) -> Result<Self, String> {
        let said = |error: serde_json::Error| error.to_string();
        if value.get("gripper").is_some() {
            let label: Box<GripLabel> = serde_json::from_value(value).map_err(said)?;
            let summary = label.summary();
            return Ok(Self::Grip(label, Box::new(summary)));
        }
        let none = || String::from("a sequence without frames");
        if value.get("sequence").is_some() && value.get("left").is_some() {
            let label: Box<GripSequenceLabel> = serde_json::from_value(value).map_err(said)?;
            if label.frames.len() != label.sequence.frames as usize {
                return Err(format!("{} frames, it says {}", label.frames.len(), label.sequence.frames));
            }
            let summary = label.summary().ok_or_else(none)?;
            return Ok(Self::GripSequence(label, Box::new(summary)));
        }
        if value.get("sequence").is_none() {
            return serde_json::from_value(value).map(Self::Press).map_err(said);
        }
        let label: Box<SequenceLabel> = serde_json::from_value(value).map_err(said)?;
        if label.frames.len() != label.common.sequence.frames as usize {
            return Err(format!("{} frames, it says {}", label.frames.len(), label.common.sequence.frames));
        }
        let summary = label.summary().ok_or_else(none)?;
        Ok(Self::Sequence(label, Box::new(summary)))
    }

    /// Reads a label and checks that its keys are exactly those of the schema. The error says what is wrong with it.
    pub fn read_strictly(bytes: &[u8]) -> Result<Self, String> {
        let label = Self::read(bytes)?;
        let read = serde_json::from_slice(bytes).map_err(|error| error.to_string())?;
        match serde_json::to_value(&label).ok().and_then(|written| find_difference(&read, &written, "")) {
            None => Ok(label),
            Some(difference) => Err(difference),
        }
    }

    /// Returns the label of a press, or the summary of any other sample.
    pub fn summary(&self) -> &Label {
        match self {
            Self::Press(label) => label,
            Self::Sequence(_, summary) | Self::Grip(_, summary) | Self::GripSequence(_, summary) => summary,
        }
    }

    /// Returns the sensors in the label: one, or those of both fingers.
    pub fn sensors(&self) -> Vec<&SensorLabel> {
        match self {
            Self::Press(label) | Self::Sequence(_, label) => vec![&label.sensor],
            Self::Grip(label, _) => vec![&label.left.sensor, &label.right.sensor],
            Self::GripSequence(label, _) => vec![&label.left.sensor, &label.right.sensor],
        }
    }

    /// Returns the number of frames of a sequence and the frames per second; `None` for a single press or grip.
    pub fn frames(&self) -> Option<(u32, f64)> {
        match self {
            Self::Press(_) | Self::Grip(..) => None,
            Self::Sequence(label, _) => Some((label.common.sequence.frames, label.common.sequence.frame_rate_hz)),
            Self::GripSequence(label, _) => Some((label.sequence.frames, label.sequence.frame_rate_hz)),
        }
    }
}

impl Serialize for SampleLabel {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        match self {
            Self::Press(label) => label.serialize(serializer),
            Self::Sequence(label, _) => label.serialize(serializer),
            Self::Grip(label, _) => label.serialize(serializer),
            Self::GripSequence(label, _) => label.serialize(serializer),
        }
    }
}

/// The parts of a file's suffix, which stands behind its sample's key.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct SuffixParts<'a> {
    /// The frame of a sequence to which the file belongs.
    pub frame: Option<&'a str>,
    /// The finger of a gripper to which the file belongs.
    pub finger: Option<&'a str>,
    /// The rest: the layer and its format.
    pub layer: &'a str,
}

/// Splits a suffix into a frame and a finger, if it names such, and the rest.
pub fn split_suffix(suffix: &str) -> SuffixParts<'_> {
    let is_frame = |name: &str| {
        name.strip_prefix('f').is_some_and(|number| number.len() >= 4 && number.bytes().all(|c| c.is_ascii_digit()))
    };
    let (frame, rest) = match suffix.split_once('.') {
        Some((name, rest)) if is_frame(name) => (Some(name), rest),
        _ => (None, suffix),
    };
    let (finger, layer) = match rest.split_once('.') {
        Some((name, layer)) if FINGER_NAMES.contains(&name) => (Some(name), layer),
        _ => (None, rest),
    };
    SuffixParts { frame, finger, layer }
}

/// Finds the first place, at `place` or below, in which a label differs from what the schema makes of it. Returns what
/// differs there, or `None`.
fn find_difference(read: &Value, written: &Value, place: &str) -> Option<String> {
    let beneath = |key: &str| if place.is_empty() { String::from(key) } else { format!("{place}.{key}") };
    match (read, written) {
        (Value::Object(read), Value::Object(written)) => {
            let unknown = read.keys().find(|key| !written.contains_key(*key));
            let lacking = written.keys().find(|key| !read.contains_key(*key));
            let unknown = unknown.map(|key| format!("has `{}`, which the schema does not know", beneath(key)));
            let lacking = || lacking.map(|key| format!("lacks `{}`", beneath(key)));
            let deeper = || read.iter().find_map(|(key, value)| find_difference(value, &written[key], &beneath(key)));
            unknown.or_else(lacking).or_else(deeper)
        }
        (Value::Array(read), Value::Array(written)) if read.len() == written.len() => {
            let mut pairs = read.iter().zip(written).enumerate();
            pairs.find_map(|(number, (read, written))| find_difference(read, written, &format!("{place}[{number}]")))
        }
        _ => (read != written).then(|| format!("has {read} at `{place}` instead of {written}")),
    }
}
