//! `gelsim schema`: prints the JSON Schema of a file format.

use clap::{Args, ValueEnum};

use super::{Failure, print_file};
use gelsim_augment::config::Augment;
use gelsim_files::sensor::Sensor;
use gelsim_job::config::Job;
use gelsim_job::gripper::label::{GripLabel, GripSequenceLabel};
use gelsim_job::label::Label;
use gelsim_job::schema::{with_distributions, with_short_forms};
use gelsim_job::sequence::label::SequenceLabel;

/// Print the JSON Schema of a file format.
#[derive(Debug, Args)]
#[command(after_help = "Example:\n  gelsim schema job > job.schema.json")]
pub struct Schema {
    /// Which format
    what: Format,
}

/// The formats that have a schema.
#[derive(Clone, Copy, Debug, ValueEnum)]
pub enum Format {
    /// The job file
    Job,
    /// The label of a sample
    Label,
    /// The label of a sample that is a sequence
    Sequence,
    /// The label of a sample that is a grip of two fingers
    Grip,
    /// The label of a sample that is a sequence of grips
    GripSequence,
    /// A sensor file
    Sensor,
    /// An AUGMENT.toml
    Augment,
}

/// Returns the JSON Schema of a format, as text with a final newline.
pub fn schema_text(format: Format) -> String {
    let schema = match format {
        Format::Job => with_short_forms(with_distributions(schemars::schema_for!(Job))),
        Format::Label => schemars::schema_for!(Label).to_value(),
        Format::Sequence => schemars::schema_for!(SequenceLabel).to_value(),
        Format::Grip => schemars::schema_for!(GripLabel).to_value(),
        Format::GripSequence => schemars::schema_for!(GripSequenceLabel).to_value(),
        Format::Sensor => with_distributions(schemars::schema_for!(Sensor)),
        Format::Augment => schemars::schema_for!(Augment).to_value(),
    };
    format!("{schema:#}\n")
}

impl Schema {
    pub(super) fn run(self) -> Result<(), Failure> {
        print_file(&schema_text(self.what))
    }
}
