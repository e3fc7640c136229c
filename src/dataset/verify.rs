//! Re-reads a dataset and names everything in it that is not as it was written.
//!
//! Looks at the dataset alone: the meshes and pictures that it was made from need not be there.

use crate::container::ShardContainer;
use std::collections::BTreeSet;
use std::io;
use std::path::Path;

use rayon::prelude::*;

use super::cleanup;
use super::folder::recorded_version;
use super::imagefolder;
use super::lock::holder;
use super::manifest::Manifest;
use super::recorded::Recorded;
use super::refused::Refused;
use super::stats::Stats;
use super::versioned::Versioned;
use gelsim_files::input;
use gelsim_job::config::output::Container;
use gelsim_job::layout::Shard;

mod described;
mod finding;
mod samples;

use described::{described, of_this_job};
pub use finding::{Cure, Finding, cures};
pub use samples::check;
use samples::check_files;

/// How thoroughly to look.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum CheckLevel {
    /// Sizes only.
    Sizes,
    /// Checksums.
    Checksums,
    /// Checksums; and every sample's files decoded, every label read.
    Everything,
}

/// What a dataset turned out to be.
#[derive(Clone, Debug, Default)]
pub struct Verified {
    /// Shards that there should be.
    pub shards: u64,
    /// Samples in the shards that are there.
    pub samples: u64,
    /// Bytes of the shards that are there.
    pub bytes: u64,
    /// Everything that is wrong, by file.
    pub findings: Vec<Finding>,
    /// The version of gelsim that made it, if it is another one than this: what job and stats make of the rest is then not
    /// known, and not compared.
    pub made_by: Option<String>,
}

/// What one shard turned out to be.
pub struct Looked {
    /// Which one.
    pub shard: Shard,
    /// Its stats, if they can be read.
    pub stats: Option<Stats>,
    /// Everything that is wrong with it.
    pub findings: Vec<Finding>,
    /// Nothing is there of it.
    absent: bool,
    /// Of the shard as it is.
    sha256: Option<String>,
    /// Its bytes as they are, if it can be read.
    bytes: Option<u64>,
}

/// Looks at every file of the dataset at `root`. Refuses a folder that is no dataset, or a newer gelsim's.
pub fn verify(root: &Path, depth: CheckLevel) -> Result<Verified, Refused> {
    let recorded = Recorded::open(root).map_err(Refused::Usage)?;
    // A newer gelsim's is refused.
    Manifest::read(&root.join("dataset.json"))?;
    let made_by = recorded_version(root).filter(|version| version != env!("CARGO_PKG_VERSION"));
    let of_job = of_this_job(&recorded, &look(&recorded, CheckLevel::Sizes)?, made_by.as_deref());
    // By the job of others nothing in the shards could be judged.
    let foreign = of_job.iter().any(|finding| finding.cure == Cure::GenerateByJob);
    let looked = look(&recorded, if foreign { depth.min(CheckLevel::Checksums) } else { depth })?;
    let mut verified = Verified { shards: looked.len() as u64, made_by, ..Verified::default() };
    for one in &looked {
        if let Some(bytes) = one.bytes {
            verified.bytes += bytes;
            verified.samples += one.stats.as_ref().map_or(0, |stats| stats.samples);
        }
        if depth > CheckLevel::Sizes {
            verified.findings.extend(exchanged(&recorded, one, &looked));
        }
    }
    verified.findings.extend(absent(&recorded, &looked));
    verified.findings.extend(strays(&recorded, looked.iter().map(|one| one.shard)));
    verified.findings.extend(of_job);
    verified.findings.extend(described(&recorded, &looked, verified.made_by.is_some()));
    verified.findings.extend(looked.into_iter().flat_map(|one| one.findings));
    // What is wrong with a file as a whole comes before what is wrong in it.
    verified.findings.sort_by(|a, b| a.file.cmp(&b.file));
    Ok(verified)
}

/// A shard that has another one's place.
fn exchanged(recorded: &Recorded, one: &Looked, all: &[Looked]) -> Option<Finding> {
    let container = recorded.job.output.container;
    let length = one.bytes?;
    let mut others = all.iter().filter(|other| other.shard != one.shard);
    let there = match &one.sha256 {
        Some(there) => there.clone(),
        // Of its length there is another.
        None if others.any(|other| other.stats.as_ref().is_some_and(|stats| stats.bytes == length)) => {
            container.checksum(&recorded.paths(&one.shard).data).ok()?.1
        }
        None => return None,
    };
    if one.stats.as_ref().is_some_and(|stats| stats.sha256 == there) {
        return None;
    }
    let written = |looked: &&Looked| looked.stats.as_ref().is_some_and(|stats| stats.sha256 == there);
    let other = all.iter().find(written).filter(|other| other.shard != one.shard)?;
    Some(Finding::new(container.file(&one.shard), format!("is the content of {}", container.file(&other.shard))))
}

/// Checks every shard of a dataset and its stats.
pub fn look(recorded: &Recorded, depth: CheckLevel) -> Result<Vec<Looked>, Refused> {
    let shards: Vec<Shard> = (0..recorded.layout.shard_count()).map(|number| recorded.layout.shard(number)).collect();
    shards.into_par_iter().map(|shard| look_at(recorded, shard, depth)).collect()
}

fn look_at(recorded: &Recorded, shard: Shard, depth: CheckLevel) -> Result<Looked, Refused> {
    let paths = recorded.paths(&shard);
    let (file, stats_name) = (paths.container.file(&shard), format!("stats/{}.json", shard.name()));
    let stats = Stats::read(&paths.stats)?;
    let mut findings = Vec::new();
    let absent = ![&paths.stats, &paths.data, &paths.lock].iter().any(|path| path.symlink_metadata().is_ok());
    if absent {
        return Ok(Looked { shard, stats: None, sha256: None, bytes: None, findings, absent });
    }
    let mut wrong = |file: &str, what: String| findings.push(Finding::new(file, what));
    match &stats {
        None if paths.stats.exists() => wrong(&stats_name, String::from("is not what was written")),
        None => wrong(&stats_name, String::from("is missing")),
        Some(stats) if stats.file != file => wrong(&stats_name, format!("is about {}", stats.file)),
        Some(stats) if stats.samples != shard.samples => {
            wrong(&stats_name, format!("counts {} samples, the job {}", stats.samples, shard.samples));
        }
        Some(_) => {}
    }
    let (mut sha256, mut bytes) = (None, None);
    let as_long = |length: u64| stats.as_ref().is_none_or(|stats| stats.bytes == length);
    // What is as long as nothing that was written is not worth reading.
    let measured = paths.container.measure(&paths.data).and_then(|length| match depth {
        CheckLevel::Checksums | CheckLevel::Everything if as_long(length) => {
            paths.container.checksum(&paths.data).map(|(length, found)| (length, Some(found)))
        }
        _ => Ok((length, None)),
    });
    match measured {
        Ok((length, found)) => {
            let same = |stats: &&Stats| found.as_ref().is_none_or(|found| stats.sha256 == *found);
            if let Some(stats) = stats.as_ref().filter(|stats| stats.bytes != length || !same(stats)) {
                let with = |hash: &str| format!(" with SHA-256 {hash}");
                let [of_this, of_that] = match &found {
                    Some(found) => [with(found), with(&stats.sha256)],
                    None => Default::default(),
                };
                let there = format!("it has {length} bytes{of_this}");
                let written = format!("{} bytes{of_that} were written", stats.bytes);
                wrong(&file, format!("is not what was written: {there}, {written}"));
            }
            (sha256, bytes) = (found, Some(length));
        }
        Err(error) if error.kind() == io::ErrorKind::NotFound => {
            // A killed run leaves its name there.
            let writer = match &*holder(input::open_inside(&paths.lock).ok().map(|(file, _)| file)) {
                "" => String::new(),
                writer => format!("; {writer} writes it, or was stopped"),
            };
            wrong(&file, format!("is missing{writer}"));
        }
        // Of a link to a folder the system says that it is none.
        Err(_) if paths.data.is_symlink() => {
            let what = "is a symbolic link, and links are not followed";
            findings.push(Finding::new(&*file, what).mended_by(Cure::Remove(file.clone())));
        }
        Err(error) => wrong(&file, error.to_string()),
    }
    if depth == CheckLevel::Everything && bytes.is_some() {
        let vouched = findings.is_empty();
        let (mistakes, counted) = check_files(&paths, recorded, shard);
        // The shard that stats vouch for is only made again without them.
        let cure = if vouched { Cure::Remove(stats_name.clone()) } else { Cure::Generate };
        let differs = stats.as_ref().filter(|_| mistakes.is_empty()).and_then(|stats| stats.differs(&counted));
        let mistakes = mistakes.into_iter().map(|what| Finding::new(&*file, what));
        let differs = differs.map(|what| Finding::new(&*stats_name, what));
        findings.extend(mistakes.chain(differs).map(|finding| finding.mended_by(cure.clone())));
    }
    Ok(Looked { shard, stats, sha256, bytes, findings, absent })
}

/// Files in data/ and stats/, and in `shards` that are folders, that belong to no shard: readers would take them for data.
/// Beside shards, what begins with a dot is a run's that goes on, or a program's that shows folders; within one it is in the way
/// of whoever replaces or copies the shard.
pub fn strays(recorded: &Recorded, shards: impl Iterator<Item = Shard> + Clone) -> Vec<Finding> {
    let (mut found, mut unread) = (Vec::new(), Vec::new());
    let mut stray = |folder: &str, name: &str| {
        let file = format!("{folder}/{name}");
        found.push(Finding::new(&*file, "belongs to no shard").mended_by(Cure::Remove(file)));
    };
    let container = recorded.job.output.container;
    let data = shards.clone().map(|shard| container.file_name(&shard)).collect();
    let stats = shards.clone().map(|shard| format!("{}.json", shard.name())).collect();
    for (folder, known) in [("data", data), ("stats", stats)] {
        let known: BTreeSet<String> = known;
        let names = match cleanup::entries(&recorded.root.join(folder)) {
            Ok(names) => names,
            Err(error) => {
                unread.push(Finding::new(folder, format!("cannot be looked through: {error}")));
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
            let others = imagefolder::others(&recorded.paths(&shard).data).unwrap_or_default();
            others.iter().for_each(|name| stray(&container.file(&shard), name));
        }
    }
    found.extend(unread);
    found.sort_by(|a, b| a.file.cmp(&b.file));
    found
}

/// Shards of which nothing is there, those that follow each other at once.
pub fn absent(recorded: &Recorded, looked: &[Looked]) -> Vec<Finding> {
    let file = |one: &Looked| recorded.job.output.container.file(&one.shard);
    let runs = looked.chunk_by(|a, b| a.absent == b.absent).filter(|run| run[0].absent);
    let said = |run: &[Looked]| match run {
        [.., last] if run.len() > 1 => {
            format!("is missing, as are all shards after it up to {}, {} in all", file(last), run.len())
        }
        _ => String::from("is missing"),
    };
    runs.map(|run| Finding::new(file(&run[0]), said(run))).collect()
}
