//! Verifies a dataset: reads it again and reports everything in it that is not as it was written.
//!
//! Only the dataset itself is read. The meshes and images from which it was made need not exist.

use crate::container::ShardContainer;
use std::collections::BTreeSet;
use std::io;
use std::path::Path;

use rayon::prelude::*;

use super::cleanup;
use super::dataset_error::DatasetError;
use super::folder::recorded_version;
use super::imagefolder;
use super::lock::read_holder;
use super::manifest::Manifest;
use super::recorded::RecordedDataset;
use super::stats::ShardStats;
use super::versioned::Versioned;
use gelsim_files::input;
use gelsim_job::config::output::Container;
use gelsim_job::layout::Shard;

mod described;
mod finding;
mod samples;

use described::check_descriptions;
pub(crate) use described::check_job;
pub use finding::{DatasetFinding, JOB_PLACEHOLDER, Remedy, list_remedy_commands};
use samples::check_shard_files;
pub use samples::check_tar;

/// How thoroughly a dataset is checked.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum CheckLevel {
    /// The sizes of files.
    Sizes,
    /// Sizes and checksums.
    Checksums,
    /// Sizes and checksums; every sample's files are decoded, and every label is read.
    Everything,
}

/// The result of [`verify`].
#[derive(Clone, Debug, Default)]
pub struct VerifyReport {
    /// Number of shards that the dataset should have.
    pub shards: u64,
    /// Samples in the shards that exist.
    pub samples: u64,
    /// Bytes of the shards that exist.
    pub bytes: u64,
    /// Everything that is wrong, in the order of files.
    pub findings: Vec<DatasetFinding>,
    /// The version of gelsim that made the dataset, if it is not this one. What job and stats should give is then
    /// unknown, and not compared.
    pub made_by: Option<String>,
}

/// The result of checking one shard.
pub struct ShardCheck {
    /// The shard.
    pub shard: Shard,
    /// Its stats, if they can be read.
    pub stats: Option<ShardStats>,
    /// Everything that is wrong with it.
    pub findings: Vec<DatasetFinding>,
    /// Whether nothing of it exists.
    absent: bool,
    /// SHA-256 of the shard as it is, if it was computed.
    sha256: Option<String>,
    /// Bytes of the shard as it is, if it can be read.
    bytes: Option<u64>,
}

/// Checks every file of the dataset at `root`. Refuses a folder that is no dataset, or one of a newer gelsim.
pub fn verify(root: &Path, depth: CheckLevel) -> Result<VerifyReport, DatasetError> {
    let recorded = RecordedDataset::open(root).map_err(DatasetError::Usage)?;
    // This refuses a dataset of a newer gelsim.
    Manifest::read(&root.join("dataset.json"))?;
    let made_by = recorded_version(root).filter(|version| version != env!("CARGO_PKG_VERSION"));
    let of_job = check_job(&recorded, &check_shards(&recorded, CheckLevel::Sizes)?, made_by.as_deref());
    // If job.toml is not the job of the shards, their content cannot be judged by it.
    let foreign = of_job.iter().any(|finding| finding.remedy == Remedy::GenerateByJob);
    let looked = check_shards(&recorded, if foreign { depth.min(CheckLevel::Checksums) } else { depth })?;
    let mut verified = VerifyReport { shards: looked.len() as u64, made_by, ..VerifyReport::default() };
    for one in &looked {
        if let Some(bytes) = one.bytes {
            verified.bytes += bytes;
            verified.samples += one.stats.as_ref().map_or(0, |stats| stats.samples);
        }
        if depth > CheckLevel::Sizes {
            verified.findings.extend(find_exchanged_shard(&recorded, one, &looked));
        }
    }
    verified.findings.extend(find_missing_shards(&recorded, &looked));
    verified.findings.extend(find_stray_files(&recorded, looked.iter().map(|one| one.shard)));
    verified.findings.extend(of_job);
    verified.findings.extend(check_descriptions(&recorded, &looked, verified.made_by.is_some()));
    verified.findings.extend(looked.into_iter().flat_map(|one| one.findings));
    // A stable sort: what is wrong with a file as such stays before what is wrong in it.
    verified.findings.sort_by(|a, b| a.file.cmp(&b.file));
    Ok(verified)
}

/// Finds out whether a shard has the content of another one. Returns a finding if it has.
fn find_exchanged_shard(recorded: &RecordedDataset, one: &ShardCheck, all: &[ShardCheck]) -> Option<DatasetFinding> {
    let container = recorded.job.output.container;
    let length = one.bytes?;
    let mut others = all.iter().filter(|other| other.shard != one.shard);
    let sha256 = match &one.sha256 {
        Some(sha256) => sha256.clone(),
        // Only a shard of the same length can be another one: read it only then.
        None if others.any(|other| other.stats.as_ref().is_some_and(|stats| stats.bytes == length)) => {
            container.checksum(&recorded.shard_paths(&one.shard).data).ok()?.1
        }
        None => return None,
    };
    if one.stats.as_ref().is_some_and(|stats| stats.sha256 == sha256) {
        return None;
    }
    let written = |looked: &&ShardCheck| looked.stats.as_ref().is_some_and(|stats| stats.sha256 == sha256);
    let other = all.iter().find(written).filter(|other| other.shard != one.shard)?;
    Some(DatasetFinding::new(
        container.relative_path(&one.shard),
        format!("is the content of {}", container.relative_path(&other.shard)),
    ))
}

/// Checks every shard of a dataset and its stats.
pub fn check_shards(recorded: &RecordedDataset, depth: CheckLevel) -> Result<Vec<ShardCheck>, DatasetError> {
    let shards: Vec<Shard> = (0..recorded.layout.shard_count()).map(|number| recorded.layout.shard(number)).collect();
    shards.into_par_iter().map(|shard| check_shard(recorded, shard, depth)).collect()
}

fn check_shard(recorded: &RecordedDataset, shard: Shard, depth: CheckLevel) -> Result<ShardCheck, DatasetError> {
    let paths = recorded.shard_paths(&shard);
    let (file, stats_name) = (paths.container.relative_path(&shard), format!("stats/{}.json", shard.name()));
    let (stats, unreadable) = match ShardStats::read(&paths.stats) {
        Ok(stats) => (stats, None),
        Err(DatasetError::Io(_, error)) => (None, Some(error)),
        Err(of_newer) => return Err(of_newer),
    };
    let mut findings = Vec::new();
    let absent = ![&paths.stats, &paths.data, &paths.lock].iter().any(|path| path.symlink_metadata().is_ok());
    if absent {
        return Ok(ShardCheck { shard, stats: None, sha256: None, bytes: None, findings, absent });
    }
    let damage = match (&stats, unreadable) {
        (_, Some(error)) => Some(error.to_string()),
        (None, None) if paths.stats.exists() => Some(String::from("is not what was written")),
        (None, None) => Some(String::from("is missing")),
        (Some(stats), None) if stats.file != file => Some(format!("is about {}", stats.file)),
        (Some(stats), None) if stats.samples != shard.samples => {
            Some(format!("counts {} samples, the job {}", stats.samples, shard.samples))
        }
        (Some(_), None) => None,
    };
    findings.extend(damage.map(|what| {
        let finding = DatasetFinding::new(&*stats_name, what);
        // A run writes over a file alone: what else stands there must go first.
        let is_other = paths.stats.symlink_metadata().is_ok_and(|found| !found.is_file());
        if is_other { finding.with_remedy(Remedy::Remove(stats_name.clone())) } else { finding }
    }));
    let mut wrong = |file: &str, what: String| findings.push(DatasetFinding::new(file, what));
    let (mut sha256, mut bytes) = (None, None);
    let as_long = |length: u64| stats.as_ref().is_none_or(|stats| stats.bytes == length);
    // A shard that does not have the length that was written need not be read.
    let measured = paths.container.measure_bytes(&paths.data).and_then(|length| match depth {
        CheckLevel::Checksums | CheckLevel::Everything if as_long(length) => {
            paths.container.checksum(&paths.data).map(|(length, found)| (length, Some(found)))
        }
        _ => Ok((length, None)),
    });
    match measured {
        Ok((length, found)) => {
            let same = |stats: &&ShardStats| found.as_ref().is_none_or(|found| stats.sha256 == *found);
            if let Some(stats) = stats.as_ref().filter(|stats| stats.bytes != length || !same(stats)) {
                let with = |hash: &str| format!(" with SHA-256 {hash}");
                let [of_this, of_that] = match &found {
                    Some(found) => [with(found), with(&stats.sha256)],
                    None => Default::default(),
                };
                let actual = format!("it has {length} bytes{of_this}");
                let written = format!("{} bytes{of_that} were written", stats.bytes);
                wrong(&file, format!("is not what was written: {actual}, {written}"));
            }
            (sha256, bytes) = (found, Some(length));
        }
        Err(error) if error.kind() == io::ErrorKind::NotFound => {
            // A killed run leaves its name in the lock.
            let writer = match &*read_holder(input::open_without_links(&paths.lock).ok().map(|(file, _)| file)) {
                "" => String::new(),
                writer => format!("; {writer} writes it, or was stopped"),
            };
            wrong(&file, format!("is missing{writer}"));
        }
        // The system's error for a link to a folder would only say that it is no folder.
        Err(_) if paths.data.is_symlink() => {
            let what = "is a symbolic link, and links are not followed";
            findings.push(DatasetFinding::new(&*file, what).with_remedy(Remedy::Remove(file.clone())));
        }
        Err(error) => wrong(&file, error.to_string()),
    }
    if depth == CheckLevel::Everything && bytes.is_some() {
        let vouched = findings.is_empty();
        let (mistakes, counted) = check_shard_files(&paths, recorded, shard);
        // If the stats agree with the shard, it would count as complete: it is made again only once they are removed.
        let remedy = if vouched { Remedy::Remove(stats_name.clone()) } else { Remedy::Generate };
        let differs = stats.as_ref().filter(|_| mistakes.is_empty()).and_then(|stats| stats.find_difference(&counted));
        let mistakes = mistakes.into_iter().map(|what| DatasetFinding::new(&*file, what));
        let differs = differs.map(|what| DatasetFinding::new(&*stats_name, what));
        findings.extend(mistakes.chain(differs).map(|finding| finding.with_remedy(remedy.clone())));
    }
    Ok(ShardCheck { shard, stats, sha256, bytes, findings, absent })
}

/// Finds files in data/ and stats/, and in `shards` that are folders, that belong to no shard: readers would take them
/// for data. Beside shards, hidden files are ignored, since they belong to a run that goes on or to a file manager.
/// Within a folder they are in the way of a replacement or copy, and are reported.
pub fn find_stray_files(
    recorded: &RecordedDataset,
    shards: impl Iterator<Item = Shard> + Clone,
) -> Vec<DatasetFinding> {
    let (mut found, mut unread) = (Vec::new(), Vec::new());
    let mut stray = |folder: &str, name: &str| {
        let file = format!("{folder}/{name}");
        found.push(DatasetFinding::new(&*file, "belongs to no shard").with_remedy(Remedy::Remove(file)));
    };
    let container = recorded.job.output.container;
    let data = shards.clone().map(|shard| container.file_name(&shard)).collect();
    let stats = shards.clone().map(|shard| format!("{}.json", shard.name())).collect();
    for (folder, known) in [("data", data), ("stats", stats)] {
        let known: BTreeSet<String> = known;
        let names = match cleanup::list_folder(&recorded.root.join(folder)) {
            Ok(names) => names,
            Err(error) => {
                unread.push(DatasetFinding::new(folder, format!("cannot be looked through: {error}")));
                continue;
            }
        };
        for name in names.iter().map(|name| name.to_string_lossy()) {
            if !known.contains(&*name) && !name.starts_with('.') {
                stray(folder, &name);
            }
        }
    }
    if container == Container::Folder {
        for shard in shards {
            let others = imagefolder::list_foreign_files(&recorded.shard_paths(&shard).data).unwrap_or_default();
            others.iter().for_each(|name| stray(&container.relative_path(&shard), name));
        }
    }
    found.extend(unread);
    found.sort_by(|a, b| a.file.cmp(&b.file));
    found
}

/// Finds shards of which nothing exists. Those that follow each other make one finding.
pub fn find_missing_shards(recorded: &RecordedDataset, looked: &[ShardCheck]) -> Vec<DatasetFinding> {
    let file = |one: &ShardCheck| recorded.job.output.container.relative_path(&one.shard);
    let runs = looked.chunk_by(|a, b| a.absent == b.absent).filter(|run| run[0].absent);
    let said = |run: &[ShardCheck]| match run {
        [.., last] if run.len() > 1 => {
            format!("is missing, as are all shards after it up to {}, {} in all", file(last), run.len())
        }
        _ => String::from("is missing"),
    };
    runs.map(|run| DatasetFinding::new(file(&run[0]), said(run))).collect()
}
