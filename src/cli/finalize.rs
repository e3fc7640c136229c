//! `gelsim finalize`: writes the index and card of a finished dataset.

use std::path::{Path, PathBuf};
use std::sync::atomic::AtomicBool;

use clap::Args;
use gelsim_lab::numbers::{HumanBytes, HumanCount};

use super::store::{parse_address, staging_folder};
use super::verify::suggest_repair;
use super::{Failure, for_each_dataset, print_result};
use gelsim_dataset::finalize::{Finalized, check_same_version, finalize};
use gelsim_dataset::mirror::finalize_in_store;
use gelsim_dataset::recorded::RecordedDataset;
use gelsim_dataset::sensor_set::list_dataset_folders;
use gelsim_dataset::verify::CheckLevel;
use gelsim_files::store::{StoreAddress, open_store};

/// Finish a dataset that was made in parts: if all its shards exist and are as they were written, write dataset.json,
/// wids.json and README.md. Otherwise name the shards that are missing or damaged, with exit status 1. Doing it again
/// changes nothing. A run that finds all shards finalizes the dataset by itself.
#[derive(Debug, Args)]
#[command(after_help = "\
Example:
  gelsim generate job.toml --out presses --partition 0/2
  gelsim generate job.toml --out presses --partition 1/2
  gelsim finalize presses

Below what is wrong it names the commands that fix it; valid shards stay as they are.")]
pub struct Finalize {
    /// The dataset's folder, that of a set of sensors, or its address in a store
    #[arg(value_name = "DIR")]
    dir: PathBuf,
    /// Compare the shards' sizes only, not their checksums
    #[arg(long)]
    quick: bool,
    /// Folder for what is read from a store [default: the folder for temporary files]
    #[arg(long, value_name = "DIR")]
    staging: Option<PathBuf>,
}

impl Finalize {
    pub(super) fn run(self) -> Result<(), Failure> {
        let depth = if self.quick { CheckLevel::Sizes } else { CheckLevel::Checksums };
        let store = parse_address(&self.dir)?;
        let folders = if store.is_some() { vec![self.dir.clone()] } else { list_dataset_folders(&self.dir)? };
        for_each_dataset(&folders, |folder| self.finalize_dataset(folder, store.as_ref(), depth))
    }

    /// Finalizes one dataset, prints what became of it, and returns true if it is complete.
    fn finalize_dataset(&self, root: &Path, store: Option<&StoreAddress>, depth: CheckLevel) -> Result<bool, Failure> {
        let (finalized, layout) = match store {
            None => {
                let recorded = RecordedDataset::open(root)?;
                check_same_version(&recorded)?;
                (finalize(&recorded, depth)?, recorded.layout)
            }
            Some(address) => {
                // Never set: nothing is half written if a signal ends the process, so there is nothing to stop in
                // order.
                let never = AtomicBool::new(false);
                let store = open_store(address, &never).map_err(|error| Failure::from_path(root, &error))?;
                finalize_in_store(&*store, &staging_folder(self.staging.clone()), depth)?
            }
        };
        let samples = HumanCount(layout.sample_count()).of("sample");
        let all = format!("{}: {samples} in {}", root.display(), HumanCount(layout.shard_count()).of("shard"));
        match finalized {
            Finalized::Valid { bytes } => {
                print_result(&format!("{all}, {}: finalized\n", HumanBytes(bytes)))?;
                Ok(true)
            }
            Finalized::Invalid(findings) => {
                let named: String = findings.iter().map(|finding| format!("{finding}\n")).collect();
                let repair = match store {
                    None => suggest_repair(root, &findings),
                    Some(address) => format!(
                        "remove the stats of shards that are not what was written, then\n  gelsim generate JOB.toml --out {address}\n"
                    ),
                };
                print_result(&format!("{named}{all}: not finalized\n{repair}"))?;
                Ok(false)
            }
        }
    }
}
