//! Re-reads a dataset and names everything in it that is not as it was written.
//!
//! Looks at the dataset alone: the meshes and pictures that it was made from need not be there.

use std::collections::BTreeSet;
use std::fmt;
use std::fs;
use std::io::{self, Read};
use std::ops::ControlFlow;
use std::path::Path;

use rayon::prelude::*;
use serde::Deserialize;
use serde_json::Value;

use super::archive::{self, Files};
use super::cleanup::DESCRIPTIONS;
use super::finalize::descriptions;
use super::folder::{is_as_written, recorded_text, recorded_version};
use super::lock::holder;
use super::manifest::Manifest;
use super::paths::Paths;
use super::recorded::Recorded;
use super::refused::Refused;
use super::stats::Stats;
use super::versioned::Versioned;
use super::{decode, imagefolder};
use crate::core::base::clock::Seconds;
use crate::core::effects::PerEffect;
use crate::files::{exr, input, npy, png};
use crate::job::config::output::Container;
use crate::job::label::{Label, SCHEMA_VERSION, key};
use crate::job::layers::{Coding, Form, OutputLayer, Scale};
use crate::job::layout::{Shard, Split};
use crate::job::plan::fingerprint;
use crate::job::steps;
use crate::job::steps::Steps;

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

/// Something that is wrong.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Finding {
    /// The file, relative to the dataset's folder.
    pub file: String,
    /// What is wrong with it.
    pub what: String,
    /// What mends it.
    pub cure: Cure,
}

/// What mends a finding: all that is asked for, in this order.
#[derive(Clone, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Cure {
    /// The file is to be removed, relative to the dataset's folder.
    Remove(String),
    /// The dataset is to be generated again, which makes what is wanting, by its own job.
    Generate,
    /// The same, by the job that the user has: the dataset's own is lost.
    GenerateByJob,
    /// The dataset is to be described again.
    Finalize,
}

impl Finding {
    /// About a file, relative to the dataset's folder, that `gelsim generate` makes again.
    pub fn new(file: impl Into<String>, what: impl Into<String>) -> Self {
        Self { file: file.into(), what: what.into(), cure: Cure::Generate }
    }

    /// The same with another cure.
    pub fn mended_by(self, cure: Cure) -> Self {
        Self { cure, ..self }
    }
}

impl fmt::Display for Finding {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}: {}", self.file, self.what)
    }
}

/// The commands that mend what was found in the dataset at `root`, in order.
pub fn cures(root: &Path, findings: &[Finding]) -> Vec<String> {
    let cures: BTreeSet<&Cure> = findings.iter().map(|finding| &finding.cure).collect();
    let own = cures.contains(&Cure::Generate) || cures.iter().any(|cure| matches!(cure, Cure::Remove(_)));
    let (folder, lost) = (shell_word(root), cures.contains(&Cure::GenerateByJob));
    let command = |cure: &&Cure| match cure {
        Cure::Remove(file) => {
            let path = root.join(file);
            Some(format!("rm {}{}", if path.is_dir() { "-r " } else { "" }, shell_word(&path)))
        }
        Cure::Generate | Cure::GenerateByJob | Cure::Finalize => None,
    };
    let job = if lost { String::from("JOB.toml") } else { shell_word(&root.join("job.toml")) };
    let last = match own || lost {
        // Ends with a description, too.
        true => Some(format!("gelsim generate {job} --out {folder}")),
        false => cures.contains(&Cure::Finalize).then(|| format!("gelsim finalize {folder}")),
    };
    cures.iter().filter_map(command).chain(last).collect()
}

/// A path as a shell takes it.
fn shell_word(path: &Path) -> String {
    let text = path.display().to_string();
    let plain = |letter: char| letter.is_ascii_alphanumeric() || "/._-+=:@%".contains(letter);
    if text.chars().all(plain) { text } else { format!("'{}'", text.replace('\'', "'\\''").escape_debug()) }
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

/// Mistakes named for one shard; the rest are counted.
const MOST_NAMED: usize = 10;

/// Checks a shard on disk, in a folder also its metadata.jsonl, and counts what its labels say.
fn check_files(paths: &Paths, recorded: &Recorded, shard: Shard) -> (Vec<String>, Stats) {
    let mut counted = Stats::new(&shard, paths.container, "");
    let mut rows = match paths.container {
        Container::Tar => None,
        Container::Folder => Some(imagefolder::Rows::open(&paths.data, &shard.name())),
    };
    let mut found = check_samples(recorded, shard, &mut counted, |visit| {
        paths.container.read(
            &paths.data,
            |_| true,
            |files| {
                if let Some(Ok(rows)) = &mut rows {
                    rows.compare(&files);
                }
                visit(files)
            },
        )
    });
    found.extend(rows.and_then(|rows| rows.map_or_else(Some, imagefolder::Rows::finish)));
    (found, counted)
}

/// Checks a shard that is a tar: the samples that `recorded` says it has, each with its files, each file what it should
/// be.
pub fn check(tar: impl Read, recorded: &Recorded, shard: Shard) -> Vec<String> {
    let mut counted = Stats::new(&shard, Container::Tar, "");
    check_samples(recorded, shard, &mut counted, |visit| archive::read(tar, visit))
}

/// Checks the samples of a shard, which `read` shows to what it is given, and counts them.
fn check_samples(
    recorded: &Recorded,
    shard: Shard,
    counted: &mut Stats,
    read: impl FnOnce(&mut dyn FnMut(Files) -> ControlFlow<()>) -> Result<(), String>,
) -> Vec<String> {
    let mut found = Vec::new();
    let mut expected = recorded.layout.indices(shard);
    let read = read(&mut |files: Files| {
        match expected.next() {
            Some(index) => {
                if let Some(label) = check_sample(&files, recorded, shard.split, index, &mut found) {
                    counted.count(&label, Vec::new(), &Seconds::default(), &PerEffect::default());
                    counted.rejected += u64::from(label.attempt);
                }
            }
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

/// Checks the files of a sample; its label, if that is what it should be.
fn check_sample(
    files: &Files,
    recorded: &Recorded,
    split: Split,
    index: u64,
    found: &mut Vec<String>,
) -> Option<Label> {
    let key = key(index);
    if files.key != key {
        found.push(format!("sample {} stands where {key} belongs", files.key));
        return None;
    }
    let mut label = None;
    let format = recorded.job.output.depth_format;
    let layers = recorded.job.output.layers_in_order();
    let suffixes: Vec<(String, OutputLayer)> = layers.into_iter().map(|layer| (layer.suffix(format), layer)).collect();
    let of_layers = suffixes.iter().map(|(suffix, _)| suffix.as_str());
    let (expected, there): (BTreeSet<&str>, BTreeSet<&str>) = (
        of_layers.chain(["tactile.png", "json"]).collect(),
        files.members.iter().map(|(suffix, _)| suffix.as_str()).collect(),
    );
    found.extend(expected.difference(&there).map(|suffix| format!("{key}.{suffix} is missing")));
    found.extend(there.difference(&expected).map(|suffix| format!("{key}.{suffix} does not belong there")));
    let size = recorded.job.sensor.resolution_px.map(|px| px as usize);
    for (suffix, bytes) in files.members.iter().filter(|(suffix, _)| expected.contains(suffix.as_str())) {
        let layer = suffixes.iter().find(|(of, _)| of == suffix).map(|(_, layer)| *layer);
        let checked = match layer.map(|layer| (layer, layer.spec().form)) {
            None if suffix == "json" => check_label(bytes, recorded, split, index).map(|read| label = Some(read)),
            None | Some((_, Form::Rgb)) => check_png(bytes, size, image::ColorType::Rgb8),
            Some((_, Form::Grey)) => check_png(bytes, size, image::ColorType::L8),
            Some((_, Form::Positions)) => check_markers(bytes),
            Some((layer, Form::Floats { least, .. })) => check_floats(layer, layer.coding(format), least, bytes, size),
        };
        found.extend(checked.err().map(|what| format!("{key}.{suffix}: {what}")));
    }
    label
}

fn check_png(bytes: &[u8], [width, height]: [usize; 2], color: image::ColorType) -> Result<(), String> {
    // Before it is unpacked: what it says it is must be what belongs there.
    let (size, found) = png::header(bytes)?;
    if size != [width, height] || found != color {
        return Err(format!("is {}x{} px {found:?}, not {width}x{height} {color:?}", size[0], size[1]));
    }
    png::decode(bytes).map(|_| ())
}

/// A layer of floats is what belongs there, finite, and nowhere below `least`.
fn check_floats(
    layer: OutputLayer,
    coding: Coding,
    least: f32,
    bytes: &[u8],
    [width, height]: [usize; 2],
) -> Result<(), String> {
    let channels = layer.channels();
    match coding {
        Coding::Exr => {
            // Before it is unpacked.
            let (size, names) = exr::header(bytes)?;
            if size != [width, height] || names != channels {
                let size = format!("{}x{} px", size[0], size[1]);
                return Err(format!("is {size} of {names:?}, not {width}x{height} of {channels:?}"));
            }
        }
        Coding::Npy => npy::check_float32(bytes)?,
        Coding::Png16(scale) => return check_steps(scale, bytes, [width, height]),
        Coding::Png | Coding::Json => {}
    }
    let planes = decode::planes(layer, coding, bytes, &Steps::default())?;
    if [planes.width, planes.height] != [width, height] {
        return Err(format!("is {}x{} px, not {width}x{height}", planes.width, planes.height));
    }
    for (name, values) in &planes.channels {
        if let Some(at) = values.iter().position(|value| !value.is_finite() || *value < least) {
            return Err(format!("channel {name} is {} in column {}, row {}", values[at], at % width, at / width));
        }
    }
    Ok(())
}

/// A layer in 16-bit steps is a picture of that kind, and has no value that stands for what is not finite.
fn check_steps(scale: Scale, bytes: &[u8], size: [usize; 2]) -> Result<(), String> {
    check_png(bytes, size, image::ColorType::L16)?;
    let none = steps::values(bytes)?.data.iter().position(|value| scale.zero_key().is_some() && *value == 0);
    match none {
        Some(at) => Err(format!("is not finite in column {}, row {}", at % size[0], at / size[0])),
        None => Ok(()),
    }
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
fn check_label(bytes: &[u8], recorded: &Recorded, split: Split, index: u64) -> Result<Label, String> {
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
    if same { Ok(label) } else { Err(String::from("is not about this sample")) }
}

/// Files in data/ and stats/, and in `shards` that are folders, that belong to no shard: readers would take them for data.
/// What begins with a dot is a run's that goes on, or a program's that shows folders.
pub fn strays(recorded: &Recorded, shards: impl Iterator<Item = Shard> + Clone) -> Vec<Finding> {
    let mut found = Vec::new();
    let mut stray = |folder: &str, name: &str| {
        if !name.starts_with('.') {
            let file = format!("{folder}/{name}");
            found.push(Finding::new(&*file, "belongs to no shard").mended_by(Cure::Remove(file)));
        }
    };
    let container = recorded.job.output.container;
    let data = shards.clone().map(|shard| container.file_name(&shard)).collect();
    let stats = shards.clone().map(|shard| format!("{}.json", shard.name())).collect();
    for (folder, known) in [("data", data), ("stats", stats)] {
        let known: BTreeSet<String> = known;
        for entry in fs::read_dir(recorded.root.join(folder)).into_iter().flatten().filter_map(Result::ok) {
            let name = entry.file_name().to_string_lossy().into_owned();
            if !known.contains(&name) {
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

/// Where job.toml is not what was written, and stats are of another job than it or of another version.
fn of_this_job(recorded: &Recorded, looked: &[Looked], made_by: Option<&str>) -> Vec<Finding> {
    let stats = || looked.iter().filter_map(|one| Some((one.shard, one.stats.as_ref()?)));
    let ours = match made_by {
        None => fingerprint(&recorded.job),
        // Only that version could say. They must at least agree.
        Some(_) => stats().next().map_or_else(String::new, |(_, stats)| stats.fingerprint.clone()),
    };
    let version = made_by.unwrap_or(env!("CARGO_PKG_VERSION"));
    let agrees = stats().all(|(_, stats)| stats.fingerprint == ours);
    let text = recorded_text(&recorded.root).unwrap_or_default();
    let mut found = Vec::new();
    if !is_as_written(&text) {
        let (what, cure) = match agrees {
            true => ("is not what was written", Cure::Generate),
            false => ("is not what was written, and not the job of its shards", Cure::GenerateByJob),
        };
        found.push(Finding::new("job.toml", what).mended_by(cure));
        return found;
    }
    for (shard, stats) in stats() {
        let file = format!("stats/{}.json", shard.name());
        if stats.fingerprint != ours {
            found.push(Finding::new(&*file, "is of another job than job.toml"));
        }
        if stats.generator != version {
            found.push(Finding::new(file, format!("was written by gelsim {}, job.toml by {version}", stats.generator)));
        }
    }
    found
}

/// Where manifest, index and card are not what job and stats make of them; of another version's, whether they are there.
fn described(recorded: &Recorded, looked: &[Looked], by_another: bool) -> Vec<Finding> {
    let stats = looked.iter().map(|one| one.stats.clone()).collect::<Option<Vec<Stats>>>();
    let Some(stats) = stats.filter(|_| !by_another) else {
        // They are made when the last shard is.
        let wanting = |name: &&str| !recorded.root.join(name).is_file();
        let names = DESCRIPTIONS.into_iter().filter(|name| *name != "wids.json" || recorded.has_index());
        return names.filter(|name| wanting(name)).map(|name| Finding::new(name, "is missing")).collect();
    };
    let check = |(name, expected): (&str, String)| {
        let what = match input::read_inside(&recorded.root.join(name), input::MOST_METADATA_BYTES) {
            Ok(there) if there == expected.as_bytes() => return None,
            Ok(there) => difference(&String::from_utf8_lossy(&there), &expected),
            Err(error) if error.kind() == io::ErrorKind::NotFound => String::from("is missing"),
            Err(error) => error.to_string(),
        };
        Some(Finding::new(name, what).mended_by(Cure::Finalize))
    };
    descriptions(recorded, &stats).into_iter().filter_map(check).collect()
}

/// Where a text is not what it should be: the first key of JSON, or the first line.
fn difference(there: &str, expected: &str) -> String {
    if let Ok(expected) = serde_json::from_str::<Value>(expected) {
        return match serde_json::from_str::<Value>(there).map(|there| first_difference("", &there, &expected)) {
            Ok(Some(what)) => what,
            Ok(None) => String::from("is not as it was written, though it says the same"),
            Err(_) => String::from("is not whole"),
        };
    }
    let line = there.lines().zip(expected.lines()).take_while(|(a, b)| a == b).count() + 1;
    format!("is not what was written, from line {line} on")
}

/// The first key, by its dotted path, whose value differs.
fn first_difference(path: &str, there: &Value, expected: &Value) -> Option<String> {
    let below = |key: &str| if path.is_empty() { key.to_owned() } else { format!("{path}.{key}") };
    match (there, expected) {
        (Value::Object(a), Value::Object(b)) => {
            let mut keys = a.keys().chain(b.keys().filter(|key| !a.contains_key(*key)));
            keys.find_map(|key| match (a.get(key), b.get(key)) {
                (Some(a), Some(b)) => first_difference(&below(key), a, b),
                (Some(_), None) => Some(format!("has the key {}, which does not belong there", below(key))),
                _ => Some(format!("has no {}", below(key))),
            })
        }
        (Value::Array(a), Value::Array(b)) if a.len() == b.len() => {
            let mut pairs = a.iter().zip(b).enumerate();
            pairs.find_map(|(at, (a, b))| first_difference(&below(&at.to_string()), a, b))
        }
        (Value::Array(a), Value::Array(b)) => Some(format!("has {} {path}, the shards {}", a.len(), b.len())),
        (a, b) => (a != b).then(|| format!("says {path} is {}, the shards {}", shortened(a), shortened(b))),
    }
}

/// A value, cut where it is long.
fn shortened(value: &Value) -> String {
    let text = value.to_string();
    match text.char_indices().nth(80) {
        Some((at, _)) => format!("{}..", &text[..at]),
        None => text,
    }
}
