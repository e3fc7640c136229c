//! The end of a dataset: manifest, index and card, written once all its shards are there.
//!
//! Whoever finishes last does it, and doing it again gives the same bytes.

use gelsim_files::fail_point::Step;
use std::path::PathBuf;

use super::card::descriptions;
use super::cleanup;
use super::folder;
use super::lock::Lock;
use super::recorded::Recorded;
use super::refused::Refused;
use super::stats::Stats;
use super::verify::{CheckLevel, Finding, absent, look, strays};
use gelsim_files::diagnostic::Report;
use gelsim_files::diagnostic::user_error;
use gelsim_files::input::{self, MOST_METADATA_BYTES};
use gelsim_files::write::write_whole;
use gelsim_job::plan::fingerprint;

/// What became of it.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Finalized {
    /// The dataset is whole and described.
    Whole {
        /// Bytes of its shards.
        bytes: u64,
    },
    /// Something is missing or broken, and nothing was changed.
    Wanting(Vec<Finding>),
}

/// Describes the dataset if all its shards are there and, as far as `depth` looks, what was written. Otherwise it says
/// what is wrong, and changes nothing.
pub fn finalize(recorded: &Recorded, depth: CheckLevel) -> Result<Finalized, Refused> {
    let (mut stats, mut findings) = (Vec::new(), Vec::new());
    let fingerprint = fingerprint(&recorded.job);
    let all = look(recorded, depth)?;
    findings.extend(absent(recorded, &all));
    for looked in all {
        findings.extend(looked.findings);
        let of_this_job = |stats: &Stats| stats.fingerprint == fingerprint;
        match looked.stats {
            Some(found) if of_this_job(&found) => stats.push(found),
            Some(_) => {
                findings.push(Finding::new(format!("stats/{}.json", looked.shard.name()), "is of another job"));
            }
            None => {}
        }
    }
    let shards = (0..recorded.layout.shard_count()).map(|number| recorded.layout.shard(number));
    findings.extend(strays(recorded, shards));
    if !findings.is_empty() {
        return Ok(Finalized::Wanting(findings));
    }
    Step::DatasetChecked.reached(&recorded.root);
    let failed = |path: PathBuf| move |error| Refused::Io(path, error);
    let lock = cleanup::lock(&recorded.root);
    let _alone = Lock::wait(&lock).map_err(failed(lock.clone()))?;
    // Another process may have raised the number of samples since.
    let samples = recorded.layout.samples();
    let what = match folder::recorded_samples(&recorded.root) {
        Some(there) if there == samples => None,
        Some(_) => Some(format!("no longer says {samples} samples")),
        None => Some(String::from("cannot be read, or is not what was written")),
    };
    if let Some(what) = what {
        return Ok(Finalized::Wanting(vec![Finding::new("job.toml", what)]));
    }
    cleanup::sweep(&recorded.root).map_err(failed(recorded.root.clone()))?;
    Step::DatasetSwept.reached(&recorded.root);
    for (name, text) in descriptions(recorded, &stats) {
        let path = recorded.root.join(name);
        // What is the same stays, so that nobody who reads it is disturbed.
        if !input::read_inside(&path, MOST_METADATA_BYTES).is_ok_and(|there| there == text.as_bytes()) {
            write_whole(&path, text.as_bytes()).map_err(failed(path.clone()))?;
        }
    }
    Step::DatasetDescribed.reached(&recorded.root);
    Ok(Finalized::Whole { bytes: stats.iter().map(|stats| stats.bytes).sum() })
}

/// Refuses a dataset that another version of gelsim made: this one would describe it otherwise.
pub fn same_version(recorded: &Recorded) -> Result<(), Report> {
    let here = env!("CARGO_PKG_VERSION");
    match folder::recorded_version(&recorded.root) {
        Some(there) if there != here => {
            let message = format!("{} was made by gelsim {there}, this is {here}", recorded.root.display());
            Err(user_error(message, "use that version"))
        }
        _ => Ok(()),
    }
}
