//! Re-reads a dataset and names everything in it that is not as it was written.
//!
//! Looks at the dataset alone: the meshes and pictures that it was made from need not be there.

use std::collections::BTreeSet;
use std::fmt;
use std::fs;
use std::io::{self, BufReader, Read};
use std::ops::ControlFlow;
use std::path::Path;

use rayon::prelude::*;
use serde::Deserialize;
use serde_json::Value;

use super::archive::{self, Files};
use super::layout::{Shard, Split};
use super::manifest::Manifest;
use super::recorded::Recorded;
use super::shard::Paths;
use super::stats::{Stats, sha256_of};
use super::versioned::{Unreadable, Versioned};
use super::{exr, png};
use crate::config::diagnostic::Report;
use crate::config::output::Layer;
use crate::label::{Label, SCHEMA_VERSION, key};
use crate::plan::usage;

/// How thoroughly to look.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Depth {
    /// Checksums only.
    Checksums,
    /// Checksums; and every sample's files decoded, every label read.
    Everything,
}

/// Something that is wrong.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Finding {
    /// The file, relative to the dataset's folder.
    pub file: String,
    /// What is wrong with it.
    pub what: String,
}

impl Finding {
    fn new(file: impl Into<String>, what: impl Into<String>) -> Self {
        Self { file: file.into(), what: what.into() }
    }
}

impl fmt::Display for Finding {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}: {}", self.file, self.what)
    }
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
}

/// What one shard turned out to be.
struct Looked {
    shard: Shard,
    stats: Option<Stats>,
    /// Of the tar as it is.
    sha256: Option<String>,
    /// Length of the tar as it is, if it can be read.
    bytes: Option<u64>,
    findings: Vec<Finding>,
}

/// Looks at every file of the dataset at `root`. Refuses a folder that is no dataset, or a newer gelsim's.
pub fn verify(root: &Path, depth: Depth) -> Result<Verified, Report> {
    let recorded = Recorded::open(root)?;
    let manifest = newer_refused("dataset.json", Manifest::read(&root.join("dataset.json")))?;
    let shards: Vec<Shard> = (0..recorded.layout.shard_count()).map(|number| recorded.layout.shard(number)).collect();
    let looked = shards.into_par_iter().map(|shard| look(&recorded, shard, depth));
    let looked: Vec<Looked> = looked.collect::<Result<_, _>>()?;

    let mut verified = Verified { shards: looked.len() as u64, ..Verified::default() };
    for one in &looked {
        if let Some(bytes) = one.bytes {
            verified.bytes += bytes;
            verified.samples += one.stats.as_ref().map_or(0, |stats| stats.samples);
        }
        verified.findings.extend(exchanged(one, &looked));
    }
    verified.findings.extend(strays(root, &looked));
    match &manifest {
        Some(manifest) => verified.findings.extend(described(&recorded, manifest, &looked)),
        None => verified.findings.push(Finding::new("dataset.json", "is missing or not whole")),
    }
    verified.findings.extend(looked.into_iter().flat_map(|one| one.findings));
    // What is wrong with a file as a whole comes before what is wrong in it.
    verified.findings.sort_by(|a, b| a.file.cmp(&b.file));
    Ok(verified)
}

/// A shard that has another one's place.
fn exchanged(one: &Looked, all: &[Looked]) -> Option<Finding> {
    let there = one.sha256.as_deref()?;
    if one.stats.as_ref().is_some_and(|stats| stats.sha256 == there) {
        return None;
    }
    let written = |looked: &&Looked| looked.stats.as_ref().is_some_and(|stats| stats.sha256 == there);
    let other = all.iter().find(written).filter(|other| other.shard != one.shard)?;
    Some(Finding::new(
        format!("data/{}.tar", one.shard.name()),
        format!("is the content of data/{}.tar", other.shard.name()),
    ))
}

fn newer_refused<T>(name: &str, read: Result<Option<T>, Unreadable>) -> Result<Option<T>, Report> {
    match read {
        Ok(found) => Ok(found),
        Err(Unreadable::Io(error)) => Err(Report::message(format!("{name}: {error}"))),
        Err(Unreadable::Newer(version)) => {
            let message = format!("{name} was written by gelsim {version}, which is newer than this one");
            Err(usage(message, "verify it with that version"))
        }
    }
}

/// Checks one shard and its stats.
fn look(recorded: &Recorded, shard: Shard, depth: Depth) -> Result<Looked, Report> {
    let paths = Paths::new(&recorded.root, &shard);
    let (tar, stats_name) = (format!("data/{}.tar", shard.name()), format!("stats/{}.json", shard.name()));
    let stats = newer_refused(&stats_name, Stats::read(&paths.stats))?;
    let mut findings = Vec::new();
    let mut wrong = |file: &str, what: String| findings.push(Finding::new(file, what));
    match &stats {
        None if paths.stats.exists() => wrong(&stats_name, String::from("is not whole")),
        None => wrong(&stats_name, String::from("is missing")),
        Some(stats) if stats.file != tar => wrong(&stats_name, format!("is about {}", stats.file)),
        Some(stats) if stats.samples != shard.samples => {
            wrong(&stats_name, format!("counts {} samples, the job {}", stats.samples, shard.samples));
        }
        Some(_) => {}
    }
    let (mut sha256, mut bytes) = (None, None);
    match fs::metadata(&paths.tar).and_then(|meta| Ok((meta.len(), sha256_of(&paths.tar)?))) {
        Ok((length, found)) => {
            if let Some(stats) = stats.as_ref().filter(|stats| stats.sha256 != found) {
                let written = format!("{} bytes with SHA-256 {} were written", stats.bytes, stats.sha256);
                wrong(&tar, format!("is not what was written: it has {length} bytes with SHA-256 {found}, {written}"));
            }
            (sha256, bytes) = (Some(found), Some(length));
        }
        Err(error) if error.kind() == io::ErrorKind::NotFound => wrong(&tar, String::from("is missing")),
        Err(error) => wrong(&tar, error.to_string()),
    }
    if depth == Depth::Everything && bytes.is_some() {
        let opened = fs::File::open(&paths.tar).map_err(|error| vec![error.to_string()]);
        let found =
            opened.map_or_else(|error| error, |file| check(BufReader::with_capacity(1 << 18, file), recorded, shard));
        found.into_iter().for_each(|what| wrong(&tar, what));
    }
    Ok(Looked { shard, stats, sha256, bytes, findings })
}

/// Mistakes named for one shard; the rest are counted.
const MOST_NAMED: usize = 10;

/// Checks a shard's tar: the samples that `recorded` says it has, each with its files, each file what it should be.
pub fn check(tar: impl Read, recorded: &Recorded, shard: Shard) -> Vec<String> {
    let mut found = Vec::new();
    let mut expected = recorded.layout.indices(shard);
    let read = archive::read(tar, |files| {
        match expected.next() {
            Some(index) => check_sample(&files, recorded, shard.split, index, &mut found),
            None => found.push(format!("sample {} is one too many", files.key)),
        }
        ControlFlow::Continue(())
    });
    found.extend(read.err());
    let missing: Vec<String> = expected.map(key).collect();
    match missing.as_slice() {
        [] => {}
        [only] => found.push(format!("sample {only} is missing")),
        [first, .., last] => found.push(format!("{} samples are missing: {first} to {last}", missing.len())),
    }
    if found.len() > MOST_NAMED {
        let more = found.len() - MOST_NAMED;
        found.truncate(MOST_NAMED);
        found.push(format!("and {more} more mistakes"));
    }
    found
}

fn check_sample(files: &Files, recorded: &Recorded, split: Split, index: u64, found: &mut Vec<String>) {
    let key = key(index);
    if files.key != key {
        found.push(format!("sample {} stands where {key} belongs", files.key));
        return;
    }
    let mut layers = recorded.job.output.layers.clone();
    layers.sort();
    layers.dedup();
    let expected = std::iter::once("tactile.png").chain(layers.iter().map(|layer| layer.suffix())).chain(["json"]);
    let (expected, there): (BTreeSet<&str>, BTreeSet<&str>) =
        (expected.collect(), files.members.iter().map(|(suffix, _)| suffix.as_str()).collect());
    found.extend(expected.difference(&there).map(|suffix| format!("{key}.{suffix} is missing")));
    found.extend(there.difference(&expected).map(|suffix| format!("{key}.{suffix} does not belong there")));
    let size = recorded.job.sensor.resolution_px.map(|px| px as usize);
    for (suffix, bytes) in files.members.iter().filter(|(suffix, _)| expected.contains(suffix.as_str())) {
        let layer = layers.iter().copied().find(|layer| layer.suffix() == suffix);
        let checked = match (suffix.as_str(), layer) {
            ("json", _) => check_label(bytes, recorded, split, index),
            (_, None | Some(Layer::Reference)) => check_png(bytes, size, image::ColorType::Rgb8),
            (_, Some(Layer::Contact)) => check_png(bytes, size, image::ColorType::L8),
            (_, Some(Layer::Markers)) => check_markers(bytes),
            (_, Some(Layer::Normal)) => check_exr(bytes, size, &["X", "Y", "Z"], f32::NEG_INFINITY),
            (_, Some(Layer::Surface)) => check_exr(bytes, size, &["Z"], f32::NEG_INFINITY),
            (_, Some(Layer::Depth)) => check_exr(bytes, size, &["Z"], 0.0),
            (_, Some(Layer::Pressure)) => check_exr(bytes, size, &["P"], 0.0),
        };
        found.extend(checked.err().map(|what| format!("{key}.{suffix}: {what}")));
    }
}

fn check_png(bytes: &[u8], [width, height]: [usize; 2], color: image::ColorType) -> Result<(), String> {
    // Before it is unpacked: what it says it is must be what belongs there.
    let (size, found) = png::header(bytes)?;
    if size != [width, height] || found != color {
        return Err(format!("is {}x{} px {found:?}, not {width}x{height} {color:?}", size[0], size[1]));
    }
    png::decode(bytes).map(|_| ())
}

fn check_exr(bytes: &[u8], [width, height]: [usize; 2], channels: &[&str], least: f32) -> Result<(), String> {
    let (size, names) = exr::header(bytes)?;
    if size != [width, height] || names != channels {
        let size = format!("{}x{} px", size[0], size[1]);
        return Err(format!("is {size} of {names:?}, not {width}x{height} of {channels:?}"));
    }
    let planes = exr::planes(bytes)?;
    for (name, values) in &planes.channels {
        if let Some(at) = values.iter().position(|value| !value.is_finite() || *value < least) {
            return Err(format!("channel {name} is {} in column {}, row {}", values[at], at % width, at / width));
        }
    }
    Ok(())
}

/// Two lists of as many pairs of numbers.
fn check_markers(bytes: &[u8]) -> Result<(), String> {
    #[derive(Deserialize)]
    #[serde(deny_unknown_fields)]
    struct Positions {
        rest_px: Vec<[f64; 2]>,
        moved_px: Vec<[f64; 2]>,
    }
    let positions: Positions = serde_json::from_slice(bytes).map_err(|error| error.to_string())?;
    match positions.rest_px.len() == positions.moved_px.len() {
        true => Ok(()),
        false => Err(format!("{} rest, {} moved", positions.rest_px.len(), positions.moved_px.len())),
    }
}

/// The label's keys and types are those of its schema, and it is about the sample.
fn check_label(bytes: &[u8], recorded: &Recorded, split: Split, index: u64) -> Result<(), String> {
    let value: Value = serde_json::from_slice(bytes).map_err(|error| error.to_string())?;
    if let Some(version) = value["schema_version"].as_u64().filter(|version| *version != u64::from(SCHEMA_VERSION)) {
        return Err(format!("has version {version} of the schema, this gelsim knows {SCHEMA_VERSION}"));
    }
    let label = Label::deserialize(&value).map_err(|error| error.to_string())?;
    // Read and written again it must be the same: no key too many.
    if serde_json::to_value(&label).ok().as_ref() != Some(&value) {
        return Err(String::from("has keys that the schema does not know"));
    }
    let same = label.index == index
        && label.key == key(index)
        && label.split == split
        && label.seed == recorded.job.dataset.seed
        && [label.sensor.width_px, label.sensor.height_px] == recorded.job.sensor.resolution_px;
    if same { Ok(()) } else { Err(String::from("is not about this sample")) }
}

/// Files in data/ and stats/ that belong to no shard. What begins with a dot is a run's that goes on.
fn strays(root: &Path, looked: &[Looked]) -> Vec<Finding> {
    let mut found = Vec::new();
    for (folder, ending) in [("data", "tar"), ("stats", "json")] {
        let known: BTreeSet<String> = looked.iter().map(|one| format!("{}.{ending}", one.shard.name())).collect();
        for entry in fs::read_dir(root.join(folder)).into_iter().flatten().filter_map(Result::ok) {
            let name = entry.file_name().to_string_lossy().into_owned();
            if !name.starts_with('.') && !known.contains(&name) {
                found.push(Finding::new(format!("{folder}/{name}"), "belongs to no shard"));
            }
        }
    }
    found
}

/// Where manifest and index say something else than the shards' stats.
fn described(recorded: &Recorded, manifest: &Manifest, looked: &[Looked]) -> Vec<Finding> {
    let mut found = Vec::new();
    let mut wrong = |file: &str, what: String| found.push(Finding::new(file, what));
    if manifest.shards.len() != looked.len() || manifest.samples != recorded.layout.samples() {
        let (shards, samples) = (manifest.shards.len(), manifest.samples);
        let all = recorded.layout.samples();
        let what = format!("lists {samples} samples in {shards} shards, the job has {all} in {}", looked.len());
        wrong("dataset.json", what);
    }
    for (entry, one) in manifest.shards.iter().zip(looked) {
        let Some(stats) = &one.stats else { continue };
        if (&entry.file, entry.samples, entry.bytes, &entry.sha256)
            != (&stats.file, stats.samples, stats.bytes, &stats.sha256)
        {
            wrong("dataset.json", format!("says of {} what stats/{}.json does not", entry.file, one.shard.name()));
        }
        if stats.fingerprint != manifest.fingerprint {
            wrong(&format!("stats/{}.json", one.shard.name()), String::from("is of another job than dataset.json"));
        }
    }
    let wids =
        fs::read(recorded.root.join("wids.json")).ok().and_then(|text| serde_json::from_slice::<Value>(&text).ok());
    match wids {
        None => wrong("wids.json", String::from("is missing or not whole")),
        Some(wids) if wids != manifest.wids() => wrong("wids.json", String::from("is not the index of dataset.json")),
        Some(_) => {}
    }
    if !recorded.root.join("README.md").is_file() {
        wrong("README.md", String::from("is missing"));
    }
    found
}
