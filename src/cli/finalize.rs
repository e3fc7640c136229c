//! `gelsim finalize`

use std::path::PathBuf;

use crate::lab::numbers::{HumanBytes, HumanCount};
use clap::Args;

use super::verify::mended_by;
use super::{Failure, print};
use crate::dataset::finalize::{Finalized, finalize, same_version};
use crate::dataset::recorded::Recorded;
use crate::dataset::verify::CheckLevel;

/// Describe a dataset that was made in parts: once all its shards are there and are what was written, write dataset.json,
/// wids.json and README.md. Otherwise name the shards that are missing or broken, with exit status 1. Doing it again changes
/// nothing. A run that finds all shards there does it by itself.
#[derive(Debug, Args)]
#[command(after_help = "\
Example:
  gelsim generate job.toml --out presses --partition 0/2
  gelsim generate job.toml --out presses --partition 1/2
  gelsim finalize presses

Below what is wrong it names the commands that mend it; shards that are whole stay as they are.")]
pub struct Finalize {
    /// The dataset's folder
    #[arg(value_name = "DIR")]
    dir: PathBuf,
    /// Compare the shards' sizes only, not their checksums
    #[arg(long)]
    quick: bool,
}

impl Finalize {
    pub(super) fn run(self) -> Result<(), Failure> {
        let recorded = Recorded::open(&self.dir)?;
        same_version(&recorded)?;
        let depth = if self.quick { CheckLevel::Sizes } else { CheckLevel::Checksums };
        let finalized = finalize(&recorded, depth)?;
        let [samples, shards] = [recorded.layout.samples(), recorded.layout.shard_count()].map(HumanCount);
        let all = format!("{}: {samples} samples in {shards} shards", self.dir.display());
        match finalized {
            Finalized::Whole { bytes } => print(&format!("{all}, {}: finalized\n", HumanBytes(bytes))),
            Finalized::Wanting(findings) => {
                let named: String = findings.iter().map(|finding| format!("{finding}\n")).collect();
                print(&format!("{named}{all}: not finalized\n{}", mended_by(&self.dir, &findings)))?;
                // What is wrong has been said.
                Err(Failure::reported(1))
            }
        }
    }
}
