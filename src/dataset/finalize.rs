//! Completes a dataset: writes its manifest, index and card once all its shards are there.
//!
//! The process that finishes last does it. Doing it again gives the same bytes.

use gelsim_files::fail_point::Step;
use std::path::PathBuf;

use super::card::render_descriptions;
use super::cleanup;
use super::dataset_error::DatasetError;
use super::folder;
use super::lock::Lock;
use super::recorded::RecordedDataset;
use super::verify::{CheckLevel, DatasetFinding, check_job, check_shards, find_missing_shards, find_stray_files};
use gelsim_files::diagnostic::Report;
use gelsim_files::diagnostic::user_error;
use gelsim_files::input::{self, MAX_METADATA_BYTES};
use gelsim_files::write::write_atomically;

/// The result of [`finalize`].
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Finalized {
    /// The dataset is complete, and its manifest, index and card are written.
    Valid {
        /// Bytes of its shards.
        bytes: u64,
    },
    /// Something is missing or damaged, and nothing was changed.
    Invalid(Vec<DatasetFinding>),
}

/// Writes the manifest, index and card if all shards are there and valid, checked as far as `depth` says. If not, it
/// changes nothing and returns what is wrong.
pub fn finalize(recorded: &RecordedDataset, depth: CheckLevel) -> Result<Finalized, DatasetError> {
    let (mut stats, mut findings) = (Vec::new(), Vec::new());
    let all = check_shards(recorded, depth)?;
    findings.extend(find_missing_shards(recorded, &all));
    findings.extend(check_job(recorded, &all, None));
    for looked in all {
        findings.extend(looked.findings);
        stats.extend(looked.stats);
    }
    let shards = (0..recorded.layout.shard_count()).map(|number| recorded.layout.shard(number));
    findings.extend(find_stray_files(recorded, shards));
    if !findings.is_empty() {
        return Ok(Finalized::Invalid(findings));
    }
    // The lock is taken only now: the checks above may take long, and shards do not change once they are written.
    Step::DatasetChecked.pause_if_requested(&recorded.root);
    let failed = |path: PathBuf| move |error| DatasetError::Io(path, error);
    let lock = cleanup::lock_path(&recorded.root);
    let _alone = Lock::acquire(&lock).map_err(failed(lock.clone()))?;
    // Another process may have raised the number of samples meanwhile.
    let samples = recorded.layout.sample_count();
    let what = match folder::recorded_samples(&recorded.root) {
        Some(recorded) if recorded == samples => None,
        Some(_) => Some(format!("no longer says {samples} samples")),
        None => Some(String::from("cannot be read, or is not what was written")),
    };
    if let Some(what) = what {
        return Ok(Finalized::Invalid(vec![DatasetFinding::new("job.toml", what)]));
    }
    cleanup::remove_leftovers(&recorded.root).map_err(failed(recorded.root.clone()))?;
    Step::DatasetSwept.pause_if_requested(&recorded.root);
    for (name, text) in render_descriptions(recorded, &stats) {
        let path = recorded.root.join(name);
        // A file that would not change is left alone, so that nobody who reads it is disturbed.
        if !input::read_without_links(&path, MAX_METADATA_BYTES).is_ok_and(|found| found == text.as_bytes()) {
            write_atomically(&path, text.as_bytes()).map_err(failed(path.clone()))?;
        }
    }
    Step::DatasetDescribed.pause_if_requested(&recorded.root);
    Ok(Finalized::Valid { bytes: stats.iter().map(|stats| stats.bytes).sum() })
}

/// Refuses a dataset that another version of gelsim made, since this version would write other files. The error says
/// which version to use.
pub fn check_same_version(recorded: &RecordedDataset) -> Result<(), Report> {
    let here = env!("CARGO_PKG_VERSION");
    match folder::recorded_version(&recorded.root) {
        Some(version) if version != here => {
            let message = format!("{} was made by gelsim {version}, this is {here}", recorded.root.display());
            Err(user_error(message, "use that version"))
        }
        _ => Ok(()),
    }
}
