//! Writes a dataset: shards in parallel, each whole or not at all; stops cleanly and goes on where it stopped.
//!
//! Every thread takes the next shard that is not there yet. Within a shard, blocks of samples are rendered in
//! parallel and appended in order, so that threads without a shard of their own help the others. No bytes depend on
//! who renders what: a shard is a function of plan and shard number.

use std::io;
use std::ops::Range;
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicBool, AtomicU64, AtomicUsize, Ordering};
use std::time::Instant;

use rayon::prelude::*;

use crate::config::diagnostic::Report;
use crate::dataset::card;
use crate::dataset::encode::{Member, members};
use crate::dataset::folder::{self, Refused, prepare};
use crate::dataset::layout::Shard;
use crate::dataset::manifest::Manifest;
use crate::dataset::shard::{Lock, Paths, Stats, Writer, write_whole};
use crate::effects::PerEffect;
use crate::label::Label;
use crate::plan::Plan;
use crate::render::{Clock, Seconds, render};

/// Samples that are rendered before the first of them is written: bounds memory, and keeps helping threads busy.
const BLOCK: usize = 16;

/// What to generate and where.
pub struct Request {
    /// Folder of the dataset.
    pub root: PathBuf,
    /// Shards to write, numbers in plan order; all of them if absent.
    pub shards: Option<Range<u64>>,
    /// Threads; all cores if absent.
    pub threads: Option<usize>,
    /// Replace a dataset that is there.
    pub overwrite: bool,
}

/// What a run did.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Done {
    /// Samples rendered.
    pub samples: u64,
    /// Shards written.
    pub shards: u64,
    /// Shards that were there already.
    pub skipped: u64,
    /// Bytes of the written shards.
    pub bytes: u64,
    /// Wall time, s.
    pub seconds: f64,
    /// True if the dataset is complete and described.
    pub complete: bool,
}

/// Why a run ended early. Finished shards stay; the same command goes on.
#[derive(Debug)]
pub enum Stopped {
    /// Something the user wrote is wrong; nothing was written.
    Usage(Report),
    /// Reading or writing failed.
    Io(PathBuf, io::Error),
    /// Other processes are writing some of the shards: names and holders.
    Held(Vec<String>),
    /// The stop flag was raised.
    Interrupted,
}

impl From<Refused> for Stopped {
    fn from(refused: Refused) -> Self {
        match refused {
            Refused::Usage(report) => Self::Usage(report),
            Refused::Io(path, error) => Self::Io(path, error),
        }
    }
}

/// Signals between a run and who watches it.
#[derive(Default)]
pub struct Watch {
    /// Raise to stop: samples under way are finished and dropped, complete shards stay.
    pub stop: AtomicBool,
    /// Samples rendered so far.
    pub rendered: AtomicU64,
    /// Samples of this run in all, set when it is known.
    pub expected: AtomicU64,
}

/// Generates the dataset, or the shards of it that were asked for.
pub fn generate(plan: &Plan, request: &Request, watch: &Watch) -> Result<Done, Stopped> {
    let start = Instant::now();
    let count = plan.layout.shard_count();
    let wanted = request.shards.clone().unwrap_or(0..count);
    prepare(&request.root, plan, request.overwrite)?;
    let mut done = Done::default();
    let mut missing = Vec::new();
    for number in wanted {
        let shard = plan.layout.shard(number);
        match complete(plan, &request.root, &shard)? {
            Some(_) => done.skipped += 1,
            None => missing.push(shard),
        }
    }
    watch.expected.store(missing.iter().map(|shard| shard.samples).sum(), Ordering::Relaxed);

    let pool = rayon::ThreadPoolBuilder::new().num_threads(request.threads.unwrap_or(0)).build();
    let pool = pool.map_err(|error| Stopped::Io(request.root.clone(), io::Error::other(error)))?;
    let next = AtomicUsize::new(0);
    let failed = AtomicBool::new(false);
    let results = pool.broadcast(|_| {
        let mut written = Vec::new();
        while let Some(shard) = missing.get(next.fetch_add(1, Ordering::Relaxed)) {
            if failed.load(Ordering::Relaxed) {
                break;
            }
            let result = write_shard(plan, &request.root, shard, watch, &failed);
            failed.fetch_or(matches!(result, Err(Stopped::Io(..) | Stopped::Interrupted)), Ordering::Relaxed);
            written.push(result);
        }
        written
    });

    let mut held = Vec::new();
    let mut error = None;
    for result in results.into_iter().flatten() {
        match result {
            Ok(stats) => {
                done.shards += 1;
                done.samples += stats.samples;
                done.bytes += stats.bytes;
            }
            Err(Stopped::Held(names)) => held.extend(names),
            // The cause, not the stops that it brought about elsewhere.
            Err(stopped @ Stopped::Io(..)) => error = Some(stopped),
            Err(stopped) => error = Some(error.unwrap_or(stopped)),
        }
    }
    if let Some(stopped) = error {
        return Err(stopped);
    }
    // Also after a shard was held: who finishes last describes the dataset, whoever that is.
    done.complete = finalize(plan, &request.root)?;
    if !done.complete && !held.is_empty() {
        held.sort();
        return Err(Stopped::Held(held));
    }
    done.seconds = start.elapsed().as_secs_f64();
    Ok(done)
}

/// The stats of a shard that is complete and of this job.
fn complete(plan: &Plan, root: &Path, shard: &Shard) -> Result<Option<Stats>, Stopped> {
    let paths = Paths::new(root, shard);
    let stats = paths.complete().map_err(|error| Stopped::Io(paths.stats.clone(), error))?;
    Ok(stats.filter(|stats| stats.fingerprint == plan.fingerprint))
}

fn write_shard(plan: &Plan, root: &Path, shard: &Shard, watch: &Watch, failed: &AtomicBool) -> Result<Stats, Stopped> {
    let paths = Paths::new(root, shard);
    let partial = paths.partial.clone();
    let io = |error| Stopped::Io(partial.clone(), error);
    let lock = match Lock::take(&paths.lock).map_err(|error| Stopped::Io(paths.lock.clone(), error))? {
        Ok(lock) => lock,
        Err(holder) => return Err(Stopped::Held(vec![format!("{} is being written by {holder}", shard.name())])),
    };
    // Another process may have finished it since we looked.
    if let Some(stats) = complete(plan, root, shard)? {
        return Ok(stats);
    }
    let mut writer = Writer::create(paths, lock, shard, &plan.fingerprint).map_err(io)?;
    let indices: Vec<u64> = plan.layout.indices(*shard).collect();
    for block in indices.chunks(BLOCK) {
        let encoded: Vec<Option<Encoded>> = block
            .par_iter()
            .map(|&index| {
                let stop = watch.stop.load(Ordering::Relaxed) || failed.load(Ordering::Relaxed);
                (!stop).then(|| {
                    let encoded = encode(plan, index);
                    watch.rendered.fetch_add(1, Ordering::Relaxed);
                    encoded
                })
            })
            .collect();
        for sample in encoded {
            let sample = sample.ok_or(Stopped::Interrupted)?;
            writer.append(&sample.label, &sample.members, &sample.seconds, &sample.effects).map_err(io)?;
        }
    }
    writer.finish().map_err(io)
}

struct Encoded {
    label: Label,
    members: Vec<Member>,
    seconds: Seconds,
    effects: PerEffect<f64>,
}

fn encode(plan: &Plan, index: u64) -> Encoded {
    let sample = render(plan, index);
    let mut clock = Clock::start();
    let members = members(plan, &sample);
    let seconds = Seconds { encode: clock.lap(), ..sample.seconds };
    Encoded { label: sample.label, members, seconds, effects: sample.effects }
}

/// Writes manifest, index and card once all shards are there. False while some are missing.
pub fn finalize(plan: &Plan, root: &Path) -> Result<bool, Stopped> {
    let mut stats = Vec::new();
    for number in 0..plan.layout.shard_count() {
        match complete(plan, root, &plan.layout.shard(number))? {
            Some(found) => stats.push(found),
            None => return Ok(false),
        }
    }
    let lock = folder::lock(root);
    let _alone = Lock::wait(&lock).map_err(|error| Stopped::Io(lock.clone(), error))?;
    folder::sweep(root).map_err(|error| Stopped::Io(root.to_owned(), error))?;
    let manifest = Manifest::new(plan, &stats);
    let pretty = |value: &serde_json::Value| format!("{value:#}\n");
    let json = |value: Result<serde_json::Value, serde_json::Error>, path: &Path| {
        value.map_err(|error| Stopped::Io(path.to_owned(), io::Error::other(error)))
    };
    let path = root.join("dataset.json");
    let dataset = pretty(&json(serde_json::to_value(&manifest), &path)?);
    let files = [
        ("dataset.json", dataset),
        ("wids.json", pretty(&manifest.wids())),
        ("README.md", card::card(plan, &manifest)),
    ];
    for (name, text) in files {
        let path = root.join(name);
        write_whole(&path, text.as_bytes()).map_err(|error| Stopped::Io(path.clone(), error))?;
    }
    Ok(true)
}
