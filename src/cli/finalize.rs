//! `gelsim finalize`

use std::path::PathBuf;
use std::sync::atomic::AtomicBool;

use clap::Args;
use gelsim_lab::numbers::{HumanBytes, HumanCount};

use super::store::{address, staging};
use super::verify::mended_by;
use super::{Failure, print};
use gelsim_dataset::finalize::{Finalized, finalize, same_version};
use gelsim_dataset::mirror::finalize_in;
use gelsim_dataset::recorded::Recorded;
use gelsim_dataset::verify::CheckLevel;
use gelsim_files::store::open;

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
    /// The dataset's folder, or its address in a store
    #[arg(value_name = "DIR")]
    dir: PathBuf,
    /// Compare the shards' sizes only, not their checksums
    #[arg(long)]
    quick: bool,
    /// Folder for what is read of a store [default: that for temporary files]
    #[arg(long, value_name = "DIR")]
    staging: Option<PathBuf>,
}

impl Finalize {
    pub(super) fn run(self) -> Result<(), Failure> {
        let depth = if self.quick { CheckLevel::Sizes } else { CheckLevel::Checksums };
        let store = address(&self.dir)?;
        let (finalized, layout) = match &store {
            None => {
                let recorded = Recorded::open(&self.dir)?;
                same_version(&recorded)?;
                (finalize(&recorded, depth)?, recorded.layout)
            }
            Some(address) => {
                // Nothing is half written when a signal ends it.
                let never = AtomicBool::new(false);
                let store = open(address, &never).map_err(|error| Failure::from_path(&self.dir, &error))?;
                finalize_in(&*store, &staging(self.staging), depth)?
            }
        };
        let [samples, shards] = [layout.samples(), layout.shard_count()].map(HumanCount);
        let all = format!("{}: {samples} samples in {shards} shards", self.dir.display());
        match finalized {
            Finalized::Whole { bytes } => print(&format!("{all}, {}: finalized\n", HumanBytes(bytes))),
            Finalized::Wanting(findings) => {
                let named: String = findings.iter().map(|finding| format!("{finding}\n")).collect();
                let mended = match &store {
                    None => mended_by(&self.dir, &findings),
                    Some(address) => format!(
                        "remove the stats of shards that are not what was written, then\n  gelsim generate JOB.toml --out {address}\n"
                    ),
                };
                print(&format!("{named}{all}: not finalized\n{mended}"))?;
                // What is wrong has been said.
                Err(Failure::reported(1))
            }
        }
    }
}
