//! Writes a dataset: shards in parallel, each whole or not at all; stops cleanly and goes on where it stopped.
//!
//! What is there already is read first, and made again where it is not what was written. Who renders what is in `workers.rs`; no
//! bytes depend on it: a shard is a function of plan and shard number.

use crate::container::ShardContainer;
use gelsim_files::fail_point::Step;
use std::any::Any;
use std::collections::HashSet;
use std::io;
use std::ops::Range;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::path::{Path, PathBuf};
use std::sync::OnceLock;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::time::Instant;

use rayon::prelude::*;

use crate::cleanup::{self, DATA};
use crate::encode::{Keep, Made, Unmade, make};
use crate::finalize::{Finalized, finalize};
use crate::folder::{prepare, recorded_samples, still_ours};
use crate::lock::Lock;
use crate::manifest::Manifest;
use crate::mirror::Mirror;
use crate::paths::Paths;
use crate::recorded::Recorded;
use crate::refused::Refused;
use crate::shard::Writer;
use crate::stats::{LightRange, Stats};
use crate::verify::{CheckLevel, Cure, Finding};
use crate::versioned::Versioned;
use crate::workers::{Claim, Workers};
use gelsim_files::diagnostic::{Report, user_error};
use gelsim_files::store::{Cause, Store, said as store_said};
use gelsim_job::config::output::Container;
use gelsim_job::layout::Shard;
use gelsim_job::plan::Plan;
use gelsim_job::sample::Unfit;

/// What to generate and where.
#[derive(Clone)]
pub struct Request {
    /// Folder of the dataset; for one in a store, a folder for shards on their way there.
    pub root: PathBuf,
    /// Shards to write, numbers in plan order; all of them if absent.
    pub shards: Option<Range<u64>>,
    /// Threads; all cores if absent.
    pub threads: Option<usize>,
    /// Replace a dataset that is there.
    pub overwrite: bool,
}

/// What a run did.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Done {
    /// Samples rendered.
    pub samples: u64,
    /// Shards written.
    pub shards: u64,
    /// Shards that were there already.
    pub skipped: u64,
    /// Shards that were there but not as they were written, and so were made again.
    pub damaged: Vec<String>,
    /// Draws that were rejected and drawn again.
    pub rejected: u64,
    /// Samples written that are not healthy.
    pub unhealthy: u64,
    /// Samples written whose contact was not solved to the tolerance.
    pub unconverged: u64,
    /// Samples written that show contact.
    pub in_contact: u64,
    /// Objects that found no place among the others of their samples.
    pub unplaced_objects: u64,
    /// How much of the written contacts the optics were not calibrated on.
    pub light: LightRange,
    /// Bytes of the written shards.
    pub bytes: u64,
    /// Wall time, s.
    pub seconds: f64,
    /// Samples of the dataset before this run made it larger.
    pub grown_from: Option<u64>,
    /// True if the dataset is complete and described.
    pub complete: bool,
}

/// Why a run ended early. Finished shards stay; the same command goes on.
#[derive(Debug)]
pub enum GenerateError {
    /// Something the user wrote is wrong; nothing was written.
    Usage(Report),
    /// Reading or writing failed.
    Io(PathBuf, io::Error),
    /// Other processes are writing some of the shards: names and holders.
    Held(Vec<String>),
    /// The dataset cannot be described: something is there that belongs to no shard.
    Wanting(Vec<Finding>),
    /// A sample is unhealthy, and the job wants no such sample.
    Unhealthy(Unfit),
    /// Rendering a sample panicked, which is a bug: the sample's number and what was said.
    Panicked(u64, String),
    /// The stop flag was raised.
    Interrupted,
}

impl From<Refused> for GenerateError {
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
    /// Raise to stop: presses under way are finished, sequences end after a frame, and both are dropped, complete shards stay.
    pub stop: AtomicBool,
    /// Samples rendered so far.
    pub rendered: AtomicU64,
    /// Shards written so far.
    pub written: AtomicU64,
    /// Samples and shards of this run in all, once they are known.
    pub expected: OnceLock<Expected>,
}

/// What a run has to do.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Expected {
    /// Samples to render.
    pub samples: u64,
    /// Shards to write.
    pub shards: u64,
    /// Shards that are there already.
    pub skipped: u64,
}

/// Makes a sample of a plan: [`make`], but for tests.
type Draw = dyn Fn(&Plan, u64, Keep<'_>) -> Result<Made, Unmade> + Sync;

/// Generates the dataset, or the shards of it that were asked for.
pub fn generate(plan: &Plan, request: &Request, watch: &Watch) -> Result<Done, GenerateError> {
    run(plan, request, None, watch, &make)
}

/// The same in an object store. Paths in its job.toml are those of a dataset in the plan's default folder.
pub fn generate_in(store: &dyn Store, plan: &Plan, request: &Request, watch: &Watch) -> Result<Done, GenerateError> {
    if plan.output().container == Container::Folder {
        let message = "a shard that is a folder cannot be put into a store whole: it is a file for each image";
        let help = "leave output.container = \"folder\" out, or generate to a folder and copy that";
        return Err(GenerateError::Usage(user_error(message, help)));
    }
    let mirror = Mirror::begin(store, &request.root)?;
    let here = Request { root: mirror.root().to_owned(), ..request.clone() };
    run(plan, &here, Some(&mirror), watch, &make).map_err(|error| match error {
        GenerateError::Io(_, error) if store_said(&error).is_some_and(|said| said.cause == Cause::Stopped) => {
            GenerateError::Interrupted
        }
        GenerateError::Usage(report) => mirror.in_its_words(Refused::Usage(report)).into(),
        GenerateError::Io(path, error) => mirror.in_its_words(Refused::Io(path, error)).into(),
        other => other,
    })
}

fn run(
    plan: &Plan,
    request: &Request,
    mirror: Option<&Mirror<'_>>,
    watch: &Watch,
    draw: &Draw,
) -> Result<Done, GenerateError> {
    let start = Instant::now();
    let root = &request.root;
    let wanted = request.shards.clone().unwrap_or(0..plan.layout.shard_count());
    let grown_from = match mirror {
        None => prepare(root, root, plan, request.overwrite)?,
        Some(mirror) => {
            let stats = |number| format!("stats/{}.json", plan.layout.shard(number).name());
            let stats: HashSet<String> = wanted.clone().map(stats).collect();
            mirror.fetch(|name| request.overwrite || stats.contains(name))?;
            let grown_from = prepare(root, &plan.default_output(), plan, request.overwrite)?;
            mirror.push_beginning(plan)?;
            grown_from
        }
    };
    known::<Manifest>(&root.join("dataset.json"))?;
    let pool = rayon::ThreadPoolBuilder::new().num_threads(request.threads.unwrap_or(0)).build();
    let pool = pool.map_err(|error| GenerateError::Io(root.clone(), io::Error::other(error)))?;

    let mut done = Done { grown_from, ..Done::default() };
    let mut missing = Vec::new();
    let level = if mirror.is_some() { CheckLevel::Sizes } else { CheckLevel::Checksums };
    let there = |number| {
        let shard = plan.layout.shard(number);
        let stop = watch.stop.load(Ordering::Relaxed);
        if stop { Err(GenerateError::Interrupted) } else { Ok((shard, there(plan, root, &shard, level)?)) }
    };
    let found: Vec<(Shard, ShardState)> =
        pool.install(|| wanted.clone().into_par_iter().map(there).collect::<Result<_, _>>())?;
    for (shard, there) in found {
        match there {
            ShardState::Whole(_) => done.skipped += 1,
            ShardState::Missing => missing.push(shard),
            ShardState::Damaged => {
                done.damaged.push(shard.name());
                missing.push(shard);
            }
        }
    }
    let samples = missing.iter().map(|shard| shard.samples).sum();
    // Nobody else sets it.
    let _ = watch.expected.set(Expected { samples, shards: missing.len() as u64, skipped: done.skipped });

    let run = Run { plan, root, mirror, watch, draw, failed: AtomicBool::new(false) };
    let workers = Workers::new(missing, pool.current_num_threads());
    let results = pool.broadcast(|_| {
        let mut written = Vec::new();
        while let Some(claim) = workers.claim() {
            if run.failed.load(Ordering::Relaxed) {
                break;
            }
            let result = run.write_shard(&claim);
            run.failed.fetch_or(!matches!(result, Ok(_) | Err(GenerateError::Held(_))), Ordering::Relaxed);
            watch.written.fetch_add(u64::from(result.is_ok()), Ordering::Relaxed);
            written.push(result);
        }
        workers.help(|index| run.encode(index));
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
                done.rejected += stats.rejected;
                done.unhealthy += stats.unhealthy;
                done.unconverged += stats.unconverged;
                done.in_contact += stats.in_contact;
                done.unplaced_objects += stats.unplaced_objects;
                done.light.add(&stats.light);
            }
            Err(GenerateError::Held(names)) => held.extend(names),
            // The cause, not the stops that it brought about elsewhere.
            Err(GenerateError::Interrupted) => error = Some(error.unwrap_or(GenerateError::Interrupted)),
            Err(cause) => error = Some(cause),
        }
    }
    if let Some(stopped) = error {
        return Err(stopped);
    }
    // Also after a shard was held: who finishes last describes the dataset, whoever that is.
    if let Some(mirror) = mirror {
        mirror.refresh(&plan.layout)?;
    }
    let finalized = finalize(&Recorded::new(root, plan.job().clone()), CheckLevel::Sizes)?;
    done.complete = matches!(finalized, Finalized::Whole { .. });
    if let Some(mirror) = mirror.filter(|_| done.complete) {
        mirror.push_descriptions()?;
    }
    let findings = match finalized {
        Finalized::Whole { .. } => Vec::new(),
        Finalized::Wanting(findings) => findings,
    };
    if findings.iter().any(|finding| matches!(finding.cure, Cure::Remove(_))) {
        return Err(GenerateError::Wanting(findings));
    }
    if !done.complete && !held.is_empty() {
        held.sort();
        return Err(GenerateError::Held(held));
    }
    // What this run has just written or read is there, so that it cannot be read now; unless another one made the dataset
    // larger meanwhile.
    let container = plan.output().container;
    let files = |shard: Shard| [container.file(&shard), format!("stats/{}.json", shard.name())];
    let ours: HashSet<String> = wanted.flat_map(|number| files(plan.layout.shard(number))).collect();
    // So are the folders: one that cannot be looked through may hold what belongs to no shard.
    let is_ours =
        |finding: &Finding| matches!(&*finding.file, "job.toml" | "data" | "stats") || ours.contains(&finding.file);
    if let Some(Finding { file, what, .. }) = findings.into_iter().find(is_ours)
        && recorded_samples(root).is_none_or(|samples| samples == plan.layout.samples())
    {
        return Err(GenerateError::Io(root.join(file), io::Error::other(what)));
    }
    done.seconds = start.elapsed().as_secs_f64();
    Ok(done)
}

/// What is there of a shard.
enum ShardState {
    /// Nothing that counts.
    Missing,
    /// Its stats, but not the tar that they describe.
    Damaged,
    /// All of it.
    Whole(Box<Stats>),
}

/// Looks for a shard of this job, and reads it unless `level` is its size.
fn there(plan: &Plan, root: &Path, shard: &Shard, level: CheckLevel) -> Result<ShardState, GenerateError> {
    let paths = Paths::new(root, shard, plan.output().container);
    // The last shard of a split was shorter before the dataset grew.
    let is_ours = |stats: &Stats| stats.is_of(shard, paths.container, &plan.fingerprint);
    let Some(stats) = known::<Stats>(&paths.stats)?.filter(is_ours) else { return Ok(ShardState::Missing) };
    let whole = if level == CheckLevel::Sizes { stats.measures(&paths) } else { stats.vouches_for(&paths) };
    let whole = whole.map_err(|error| GenerateError::Io(paths.data.clone(), error))?;
    Ok(if whole { ShardState::Whole(Box::new(stats)) } else { ShardState::Damaged })
}

/// A file of the dataset, if it is there and whole. One that a newer gelsim wrote is not ours to replace.
fn known<T: Versioned>(path: &Path) -> Result<Option<T>, GenerateError> {
    Ok(T::read(path)?)
}

/// What all threads of a run share.
struct Run<'a> {
    plan: &'a Plan,
    root: &'a Path,
    mirror: Option<&'a Mirror<'a>>,
    watch: &'a Watch,
    draw: &'a Draw,
    /// One of them has failed.
    failed: AtomicBool,
}

impl Run<'_> {
    fn write_shard(&self, claim: &Claim<'_, Shard, Result<Made, GenerateError>>) -> Result<Stats, GenerateError> {
        let Self { plan, root, mirror, .. } = *self;
        let shard = &claim.shard;
        let paths = Paths::new(root, shard, plan.output().container);
        let partial = paths.partial.clone();
        let io = |error| GenerateError::Io(partial.clone(), error);
        let lock = {
            // Another run that replaces the dataset meanwhile finds the shard locked, or is found to have done it.
            let of_all = cleanup::lock(root);
            let _alone = Lock::wait(&of_all).map_err(|error| GenerateError::Io(of_all.clone(), error))?;
            let taken = Lock::take(&paths.lock).map_err(|error| GenerateError::Io(paths.lock.clone(), error))?;
            match mirror {
                None => still_ours(root, plan)?,
                Some(mirror) => mirror.still_ours(plan)?,
            }
            taken
        };
        let lock = match lock {
            Ok(lock) => lock,
            Err(holder) => {
                return Err(GenerateError::Held(vec![format!("{} is being written by {holder}", shard.name())]));
            }
        };
        Step::ShardLocked.reached(&paths.data);
        // Another process may have finished it since we looked.
        if mirror.is_none()
            && let ShardState::Whole(stats) = there(plan, root, shard, CheckLevel::Checksums)?
        {
            return Ok(*stats);
        }
        let older = paths.stats.exists();
        let mut writer = Writer::create(paths.clone(), lock, shard, &plan.fingerprint).map_err(io)?;
        let write = |sample: Result<Made, GenerateError>| -> Result<(), GenerateError> {
            let sample = sample?;
            writer.append(&sample.label.header.key, &sample.members).map_err(io)?;
            writer.stats.count(&sample.label, sample.rejected, &sample.seconds, &sample.effects);
            Ok(())
        };
        claim.in_order(plan.layout.indices(*shard).collect(), |index| self.encode(index), write)?;
        let stats = writer.finish().map_err(|(path, error)| GenerateError::Io(path, error))?;
        if let Some(mirror) = mirror {
            mirror.push_shard(&paths, &stats, older)?;
        }
        Step::ShardDone.reached(&partial);
        Ok(stats)
    }

    fn encode(&self, index: u64) -> Result<Made, GenerateError> {
        let stop = || self.watch.stop.load(Ordering::Relaxed) || self.failed.load(Ordering::Relaxed);
        if stop() {
            return Err(GenerateError::Interrupted);
        }
        let keep = Keep::OnDisk { folder: &self.root.join(DATA), stop: &stop };
        // Nothing outside is changed by what panics.
        let made = catch_unwind(AssertUnwindSafe(|| (self.draw)(self.plan, index, keep)));
        self.watch.rendered.fetch_add(1, Ordering::Relaxed);
        let made = made.map_err(|panic| GenerateError::Panicked(index, said(&*panic)))?;
        made.map_err(|unmade| match unmade {
            Unmade::Unfit(unfit) => GenerateError::Unhealthy(unfit),
            Unmade::Io(path, error) => GenerateError::Io(path, error),
            Unmade::Stopped => GenerateError::Interrupted,
        })
    }
}

/// The message of a panic.
pub fn said(panic: &(dyn Any + Send)) -> String {
    let text = panic.downcast_ref::<String>().map(String::as_str).or(panic.downcast_ref::<&str>().copied());
    text.unwrap_or("no message").to_owned()
}

#[cfg(test)]
mod tests {
    use super::*;
    use gelsim_job::config::Overrides;

    /// 30 small samples in shards of 10.
    fn job(folder: &Path) -> Plan {
        let ball = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../objects/sphere.obj");
        let text = format!(
            "dataset = {{ name = \"t\", samples = 30, samples_per_shard = 10, seed = 5 }}\n\
             sensor.resolution_px = [24, 18]\nindentation.depth_mm = 0.5\nobject = [{{ path = {ball:?} }}]\n"
        );
        let path = folder.join("job.toml");
        std::fs::write(&path, text).expect("a file");
        Plan::load(&path, &Overrides::default()).expect("a sound job")
    }

    #[test]
    fn a_panic_in_a_worker_ends_the_run_with_the_samples_number_and_finished_shards_stay() {
        let folder = tempfile::tempdir().expect("a folder");
        let plan = job(folder.path());
        let root = folder.path().join("out");
        for threads in [1, 4] {
            let request = Request { root: root.clone(), shards: None, threads: Some(threads), overwrite: true };
            let broken = |plan: &Plan, index: u64, keep: Keep<'_>| match index {
                27 => panic!("injected"),
                _ => make(plan, index, keep),
            };
            match run(&plan, &request, None, &Watch::default(), &broken) {
                Err(GenerateError::Panicked(27, message)) => assert_eq!(message, "injected"),
                other => panic!("{other:?}"),
            }
            // On one thread the shards before it are finished; on several they may be under way, and then are dropped.
            let there = |number| there(&plan, &root, &plan.layout.shard(number), CheckLevel::Checksums);
            let finished = |number| matches!(there(number), Ok(ShardState::Whole(_)));
            assert!(threads > 1 || finished(0) && finished(1));
            assert!(!root.join("data/train-000002.tar").exists());
            let partials = std::fs::read_dir(root.join("data")).expect("a folder").filter_map(Result::ok);
            assert_eq!(partials.filter(|entry| entry.file_name().to_string_lossy().starts_with('.')).count(), 0);

            let request = Request { overwrite: false, ..request };
            let done = generate(&plan, &request, &Watch::default()).expect("the same command goes on");
            assert!(done.complete);
            assert!(threads > 1 || (done.shards, done.skipped) == (1, 2), "{done:?}");
        }
    }
}
