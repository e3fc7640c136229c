//! Writes a dataset: shards in parallel, each complete or absent. A run stops cleanly and continues where it stopped.
//!
//! Shards that are there already are read first, and made again if they are not what was written. `workers.rs` decides
//! which thread renders what. No byte depends on it, since a shard is a function of the plan and the shard's number.

use crate::container::ShardContainer;
use gelsim_files::fail_point::Step;
use std::any::Any;
use std::collections::HashSet;
use std::io;
use std::ops::Range;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::sync::{Arc, OnceLock};
use std::time::Instant;

use rayon::prelude::*;
use rustix::process::{Resource, getrlimit};

use crate::cleanup::{self, DATA_FOLDER};
use crate::dataset_error::DatasetError;
use crate::encode::{EncodedSample, FrameStorage, SampleError, make_samples};
use crate::finalize::{Finalized, finalize};
use crate::folder::{KnownJob, Replaced, check_still_ours, prepare_folder, recorded_samples, require_usable_folder};
use crate::lock::Lock;
use crate::manifest::Manifest;
use crate::mirror::StoreMirror;
use crate::paths::ShardPaths;
use crate::recorded::RecordedDataset;
use crate::sensor_set;
use crate::shard::ShardWriter;
use crate::stats::{LightRange, ShardStats};
use crate::verify::{CheckLevel, DatasetFinding, Remedy};
use crate::versioned::Versioned;
use crate::workers::{ShardClaim, Workers};
use gelsim_files::diagnostic::{Report, user_error};
use gelsim_files::store::{Store, StoreFailure, find_store_error as store_said};
use gelsim_job::config::output::Container;
use gelsim_job::layout::Shard;
use gelsim_job::plan::{CALIBRATION_FOLDER, Plan, SetMember};
use gelsim_job::sample::RejectedSample;

/// What to generate, and where.
#[derive(Clone)]
pub struct GenerateRequest {
    /// Folder of the dataset; for a dataset in a store, a folder for shards on their way there.
    pub root: PathBuf,
    /// Numbers of the shards to write, in the order of the plan; `None` for all.
    pub shards: Option<Range<u64>>,
    /// Number of threads; `None` for all cores.
    pub threads: Option<usize>,
    /// Whether to replace a dataset that is there.
    pub overwrite: bool,
}

/// What a run has done.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct RunSummary {
    /// Datasets: one, or one for each sensor of a set.
    pub sensors: usize,
    /// Samples rendered, those of all sensors.
    pub samples: u64,
    /// Shards written.
    pub shards: u64,
    /// Shards that were there already.
    pub skipped: u64,
    /// Samples in these.
    pub samples_there: u64,
    /// How many of these are not healthy.
    pub unhealthy_there: u64,
    /// Shards that were damaged and made again.
    pub damaged: Vec<String>,
    /// Draws that were rejected and drawn again.
    pub rejected: u64,
    /// Written samples that are not healthy.
    pub unhealthy: u64,
    /// Written samples whose contact was not solved to the tolerance.
    pub unconverged: u64,
    /// Written samples that show contact.
    pub in_contact: u64,
    /// Objects for which there was no place among the others of their samples.
    pub unplaced_objects: u64,
    /// How much of the written contacts lies outside the calibrated range of the optics.
    pub light: LightRange,
    /// Bytes of the written shards.
    pub bytes: u64,
    /// Wall time, s.
    pub seconds: f64,
    /// Number of samples of the dataset before this run made it larger.
    pub grown_from: Option<u64>,
    /// Calibration presses of a set that were rendered.
    pub calibration_samples: u64,
    /// Whether the dataset is complete, with its manifest and card.
    pub complete: bool,
}

/// Why a run ended early. Finished shards stay, and the same command continues.
#[derive(Debug)]
pub enum GenerateError {
    /// Something that the user wrote is wrong; nothing was written.
    Usage(Report),
    /// Reading or writing failed.
    Io(PathBuf, io::Error),
    /// Other processes are writing some of the shards: the names of the shards and of the processes.
    Held(Vec<String>),
    /// The dataset cannot be completed: it holds something that belongs to no shard.
    Invalid(Vec<DatasetFinding>),
    /// A sample is unhealthy, and the job allows no such sample.
    Unhealthy(RejectedSample),
    /// Rendering a sample panicked, which is a bug. Holds the number of the sample and the message.
    Panicked(u64, String),
    /// The stop flag was raised.
    Interrupted,
}

impl GenerateRequest {
    /// A run that makes a part of a dataset leaves what runs beside it have made.
    fn replaced(&self) -> Replaced {
        match (self.overwrite, &self.shards) {
            (false, _) => Replaced::Nothing,
            (true, Some(_)) => Replaced::OtherJobs,
            (true, None) => Replaced::All,
        }
    }
}

impl RunSummary {
    /// Counts a shard that was there already.
    fn count_there(&mut self, stats: &ShardStats) {
        self.skipped += 1;
        self.samples_there += stats.samples;
        self.unhealthy_there += stats.unhealthy;
    }

    /// Adds a shard that this run has written.
    fn count_shard(&mut self, stats: &ShardStats) {
        self.shards += 1;
        self.samples += stats.samples;
        self.bytes += stats.bytes;
        self.rejected += stats.rejected;
        self.unhealthy += stats.unhealthy;
        self.unconverged += stats.unconverged;
        self.in_contact += stats.in_contact;
        self.unplaced_objects += stats.unplaced_objects;
        self.light.add(&stats.light);
    }
}

impl From<DatasetError> for GenerateError {
    fn from(refused: DatasetError) -> Self {
        match refused {
            DatasetError::Usage(report) => Self::Usage(report),
            DatasetError::Io(path, error) => Self::Io(path, error),
        }
    }
}

/// Signals between a run and its caller.
#[derive(Default)]
pub struct RunMonitor {
    /// Set to stop the run. Presses under way are finished, sequences end after a frame, and both are dropped; complete
    /// shards stay.
    pub stop: Arc<AtomicBool>,
    /// Samples rendered so far.
    pub rendered: AtomicU64,
    /// Shards written so far.
    pub written: AtomicU64,
    /// Samples and shards of this run in all, once they are known.
    pub expected: OnceLock<ExpectedWork>,
}

/// The work of a run.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct ExpectedWork {
    /// Samples to render.
    pub samples: u64,
    /// Shards to write.
    pub shards: u64,
    /// Shards that are there already.
    pub skipped: u64,
}

/// One dataset of a run: its plan, its folder, and the store that it is mirrored to.
struct Target<'a> {
    plan: &'a Plan,
    root: PathBuf,
    mirror: Option<StoreMirror<'a>>,
    known_job: KnownJob,
}

/// Makes sample `index` of several plans: [`make_samples`], or a replacement in tests.
type DrawSamples = dyn Fn(&[&Plan], u64, &[FrameStorage<'_>]) -> Result<Vec<EncodedSample>, SampleError> + Sync;

/// Most shards of a set that all threads together have open.
const MAX_OPEN: u64 = 256;

/// Returns how many shards of a set a thread writes together. They share their contacts. Each has a file and a lock
/// open, and as many files again are left for everything else.
fn shards_together(threads: usize) -> usize {
    let allowed = getrlimit(Resource::Nofile).current.unwrap_or(u64::MAX);
    ((allowed / 4).min(MAX_OPEN) as usize / threads.max(1)).max(1)
}

/// Generates the dataset, or those shards of it that the request names. For a job with `[sensors]` that is a dataset for
/// each, in a folder below `request.root`. The run that makes the first shard also makes the calibration presses.
pub fn generate(plan: &Plan, request: &GenerateRequest, watch: &RunMonitor) -> Result<RunSummary, GenerateError> {
    if let Some(members) = plan.sensor_set() {
        return generate_set(plan, &members, request, watch);
    }
    let target = Target { plan, root: request.root.clone(), mirror: None, known_job: KnownJob::default() };
    run_generation(&[target], request, watch, &make_samples)
}

fn generate_set(
    plan: &Plan,
    members: &[SetMember],
    request: &GenerateRequest,
    watch: &RunMonitor,
) -> Result<RunSummary, GenerateError> {
    // All of it before the first change, so that a set that is refused stays as it is.
    require_usable_folders(plan, members, request)?;
    sensor_set::prepare_set_folder(&request.root, members, plan.calibration.is_some(), request.overwrite)?;
    let mut calibration_samples = 0;
    if let Some((presses, request)) = calibration_request(plan, request) {
        // What is shown of progress is that of the set.
        let watch = RunMonitor { stop: Arc::clone(&watch.stop), ..RunMonitor::default() };
        calibration_samples = generate(presses, &request, &watch)?.samples;
    }
    let targets: Vec<Target<'_>> = members
        .iter()
        .map(|member| Target {
            plan: &member.plan,
            root: request.root.join(&member.folder),
            mirror: None,
            known_job: KnownJob::default(),
        })
        .collect();
    let done = run_generation(&targets, request, watch, &make_samples)?;
    Ok(RunSummary { calibration_samples, ..done })
}

/// Returns the calibration presses that a run makes, if it makes any.
fn calibration_request<'a>(plan: &'a Plan, request: &GenerateRequest) -> Option<(&'a Plan, GenerateRequest)> {
    let presses = plan.calibration.as_deref()?;
    let makes_them = request.shards.as_ref().is_none_or(|shards| shards.contains(&0));
    let root = request.root.join(CALIBRATION_FOLDER);
    makes_them.then(|| (presses, GenerateRequest { root, shards: None, ..request.clone() }))
}

/// Refuses folders that a set may not use, those of its datasets and of its calibration presses among them.
fn require_usable_folders(plan: &Plan, members: &[SetMember], request: &GenerateRequest) -> Result<(), DatasetError> {
    let (has_calibration, overwrite) = (plan.calibration.is_some(), request.overwrite);
    sensor_set::require_usable_set_folder(&request.root, members, has_calibration, overwrite)?;
    for member in members {
        require_usable_folder(&request.root.join(&member.folder), &member.plan, request.replaced())?;
    }
    match calibration_request(plan, request) {
        Some((presses, request)) => match presses.sensor_set() {
            Some(members) => require_usable_folders(presses, &members, &request),
            None => require_usable_folder(&request.root, presses, request.replaced()),
        },
        None => Ok(()),
    }
}

/// Generates the dataset into an object store. Paths in its job.toml are those of a dataset in the plan's default
/// folder.
pub fn generate_in_store(
    store: &dyn Store,
    plan: &Plan,
    request: &GenerateRequest,
    watch: &RunMonitor,
) -> Result<RunSummary, GenerateError> {
    if plan.output().container == Container::Folder {
        let message = "a shard that is a folder cannot be put into a store as one object: it is a file for each image";
        let help = "leave output.container = \"folder\" out, or generate to a folder and copy that";
        return Err(GenerateError::Usage(user_error(message, help)));
    }
    let mirror = StoreMirror::create(store, &request.root)?;
    let targets =
        [Target { plan, root: mirror.root().to_owned(), mirror: Some(mirror), known_job: KnownJob::default() }];
    run_generation(&targets, request, watch, &make_samples).map_err(|error| match error {
        GenerateError::Io(_, error) if store_said(&error).is_some_and(|said| said.cause == StoreFailure::Stopped) => {
            GenerateError::Interrupted
        }
        GenerateError::Usage(report) => with_store_address(&targets, DatasetError::Usage(report)).into(),
        GenerateError::Io(path, error) => with_store_address(&targets, DatasetError::Io(path, error)).into(),
        other => other,
    })
}

/// Returns an error with addresses in the store in place of paths in the folders that mirror it.
fn with_store_address(targets: &[Target<'_>], refused: DatasetError) -> DatasetError {
    let mirrors = targets.iter().filter_map(|target| target.mirror.as_ref());
    mirrors.fold(refused, |refused, mirror| mirror.with_store_address(refused))
}

/// Prepares the folder of a dataset. Returns its earlier number of samples, if it will have more.
fn prepare_target(
    target: &Target<'_>,
    wanted: &Range<u64>,
    request: &GenerateRequest,
) -> Result<Option<u64>, GenerateError> {
    let Target { plan, root, mirror, .. } = target;
    let grown_from = match mirror {
        None => prepare_folder(root, root, plan, request.replaced())?,
        Some(mirror) => {
            let stats = |number| format!("stats/{}.json", plan.layout.shard(number).name());
            let stats: HashSet<String> = wanted.clone().map(stats).collect();
            mirror.fetch(|name| request.overwrite || stats.contains(name))?;
            let grown_from = prepare_folder(root, &plan.default_output(), plan, request.replaced())?;
            mirror.push_beginning(plan)?;
            grown_from
        }
    };
    // This refuses a dataset that a newer gelsim has completed.
    read_versioned::<Manifest>(&root.join("dataset.json"))?;
    Ok(grown_from)
}

/// Shards of the same number that one thread writes together.
struct ShardGroup {
    shard: Shard,
    /// Their datasets, as indices into the targets of the run.
    targets: Vec<usize>,
}

/// A sample to make, for each of some targets.
#[derive(Clone)]
struct SampleRequest {
    index: u64,
    targets: Arc<[usize]>,
}

/// What became of a group of shards.
#[derive(Default)]
struct WrittenShards {
    stats: Vec<ShardStats>,
    /// Shards that other processes are writing.
    held: Vec<String>,
}

fn run_generation(
    targets: &[Target<'_>],
    request: &GenerateRequest,
    watch: &RunMonitor,
    draw: &DrawSamples,
) -> Result<RunSummary, GenerateError> {
    let start = Instant::now();
    let layout = &targets[0].plan.layout;
    let wanted = request.shards.clone().unwrap_or(0..layout.shard_count());
    let mut done = RunSummary { sensors: targets.len(), ..RunSummary::default() };
    for target in targets {
        let grown_from = prepare_target(target, &wanted, request)?;
        done.grown_from = done.grown_from.or(grown_from);
    }
    let pool = rayon::ThreadPoolBuilder::new().num_threads(request.threads.unwrap_or(0)).build();
    let pool = pool.map_err(|error| GenerateError::Io(request.root.clone(), io::Error::other(error)))?;

    let look = |(number, target): (u64, &Target<'_>)| {
        let shard = layout.shard(number);
        // A mirror has only the lengths of shards.
        let level = if target.mirror.is_some() { CheckLevel::Sizes } else { CheckLevel::Checksums };
        let stop = watch.stop.load(Ordering::Relaxed);
        if stop { Err(GenerateError::Interrupted) } else { find_shard(target.plan, &target.root, &shard, level) }
    };
    let places: Vec<(u64, &Target<'_>)> =
        wanted.clone().flat_map(|number| targets.iter().map(move |target| (number, target))).collect();
    let found: Vec<ShardState> = pool.install(|| places.into_par_iter().map(look).collect::<Result<_, _>>())?;
    let together = shards_together(pool.current_num_threads());
    let mut missing = Vec::new();
    for (number, states) in wanted.clone().zip(found.chunks(targets.len())) {
        let shard = layout.shard(number);
        let mut lacking = Vec::new();
        for (target, state) in states.iter().enumerate() {
            match state {
                ShardState::Valid(stats) => done.count_there(stats),
                ShardState::Missing => lacking.push(target),
                ShardState::Damaged => {
                    done.damaged.push(name_in_set(targets, target, &shard.name()));
                    lacking.push(target);
                }
            }
        }
        missing.extend(lacking.chunks(together).map(|targets| ShardGroup { shard, targets: targets.to_vec() }));
    }
    let samples = missing.iter().map(|group| group.shard.samples * group.targets.len() as u64).sum();
    let shards = missing.iter().map(|group| group.targets.len() as u64).sum();
    // No other thread sets it, so this cannot fail.
    let _ = watch.expected.set(ExpectedWork { samples, shards, skipped: done.skipped });

    let run = GenerationRun { targets, watch, draw, failed: AtomicBool::new(false) };
    let largest = missing.iter().map(|group| group.targets.len()).max().unwrap_or(1);
    let workers = Workers::new(missing, pool.current_num_threads(), largest);
    let results = pool.broadcast(|_| {
        let mut written = Vec::new();
        while let Some(claim) = workers.claim_shard() {
            if run.failed.load(Ordering::Relaxed) {
                break;
            }
            let result = run.write_shards(&claim);
            // One failed shard stops the others. A shard that another process is writing does not.
            run.failed.fetch_or(result.is_err(), Ordering::Relaxed);
            written.push(result);
        }
        // Threads without a shard of their own help those that have one.
        workers.help_others(|request| run.encode_samples(&request));
        written
    });

    let mut held = Vec::new();
    let mut error = None;
    for result in results.into_iter().flatten() {
        match result {
            Ok(written) => {
                written.stats.iter().for_each(|stats| done.count_shard(stats));
                held.extend(written.held);
            }
            // Report the cause, not the interruptions that followed from it in other threads.
            Err(GenerateError::Interrupted) => error = Some(error.unwrap_or(GenerateError::Interrupted)),
            Err(cause) => error = Some(cause),
        }
    }
    if let Some(stopped) = error {
        return Err(stopped);
    }
    // This is done also if another process holds a shard: the process that finishes last completes the dataset.
    done.complete = true;
    for target in targets {
        done.complete &= finish_dataset(target, &wanted, &held)?;
    }
    if !done.complete && !held.is_empty() {
        held.sort();
        return Err(GenerateError::Held(held));
    }
    done.seconds = start.elapsed().as_secs_f64();
    Ok(done)
}

/// Returns the name of something of a target in messages: in a set it stands behind its folder.
fn name_in_set(targets: &[Target<'_>], target: usize, name: &str) -> String {
    match targets[target].root.file_name().filter(|_| targets.len() > 1) {
        Some(folder) => format!("{}/{name}", folder.display()),
        None => name.to_owned(),
    }
}

/// Completes a dataset if all its shards are there, and returns whether they are. `held` are shards of any dataset that
/// other processes are writing.
fn finish_dataset(target: &Target<'_>, wanted: &Range<u64>, held: &[String]) -> Result<bool, GenerateError> {
    let Target { plan, root, mirror, .. } = target;
    if let Some(mirror) = mirror {
        mirror.refresh(&plan.layout)?;
    }
    let finalized = finalize(&RecordedDataset::new(root, plan.job().clone()), CheckLevel::Sizes)?;
    let findings = match finalized {
        Finalized::Valid { .. } => {
            mirror.as_ref().map_or(Ok(()), StoreMirror::push_descriptions)?;
            return Ok(true);
        }
        Finalized::Invalid(findings) => findings,
    };
    if findings.iter().any(|finding| matches!(finding.remedy, Remedy::Remove(_))) {
        return Err(GenerateError::Invalid(findings));
    }
    if !held.is_empty() {
        return Ok(false);
    }
    // What this run has just written or read exists. If it is found missing now, it cannot be read, which is an error,
    // unless another run has made the dataset larger meanwhile.
    let container = plan.output().container;
    let files = |shard: Shard| [container.relative_path(&shard), format!("stats/{}.json", shard.name())];
    let ours: HashSet<String> = wanted.clone().flat_map(|number| files(plan.layout.shard(number))).collect();
    // The folders exist, too: one that cannot be listed may hold something that belongs to no shard.
    let is_ours = |finding: &DatasetFinding| {
        matches!(&*finding.file, "job.toml" | "data" | "stats") || ours.contains(&finding.file)
    };
    if let Some(DatasetFinding { file, what, .. }) = findings.into_iter().find(is_ours)
        && recorded_samples(root).is_none_or(|samples| samples == plan.layout.sample_count())
    {
        return Err(GenerateError::Io(root.join(file), io::Error::other(what)));
    }
    Ok(false)
}

/// The state of a shard on disk.
enum ShardState {
    /// There is no such shard of this job.
    Missing,
    /// Its stats are there, but its data are not what they describe.
    Damaged,
    /// It is complete and valid.
    Valid(Box<ShardStats>),
}

/// Looks for a shard of this job. At `CheckLevel::Sizes` only its size is checked, otherwise all of it is read.
fn find_shard(plan: &Plan, root: &Path, shard: &Shard, level: CheckLevel) -> Result<ShardState, GenerateError> {
    let paths = ShardPaths::new(root, shard, plan.output().container);
    // The last shard of a split had fewer samples before the dataset grew, so its stats may be of that time.
    let is_ours = |stats: &ShardStats| stats.belongs_to(shard, paths.container, &plan.fingerprint);
    let Some(stats) = read_versioned::<ShardStats>(&paths.stats)?.filter(is_ours) else {
        return Ok(ShardState::Missing);
    };
    let valid = if level == CheckLevel::Sizes { stats.matches_size(&paths) } else { stats.matches_checksum(&paths) };
    let valid = valid.map_err(|error| GenerateError::Io(paths.data.clone(), error))?;
    Ok(if valid { ShardState::Valid(Box::new(stats)) } else { ShardState::Damaged })
}

/// Reads a file of the dataset if it exists and is valid. It is an error if a newer gelsim wrote it, since it is not
/// ours to replace.
fn read_versioned<T: Versioned>(path: &Path) -> Result<Option<T>, GenerateError> {
    Ok(T::read(path)?)
}

/// What all threads of a run share.
struct GenerationRun<'a> {
    targets: &'a [Target<'a>],
    watch: &'a RunMonitor,
    draw: &'a DrawSamples,
    /// Whether a thread has failed.
    failed: AtomicBool,
}

/// What comes of a request for a sample: one for each of its targets.
type EncodedSamples = Result<Vec<EncodedSample>, GenerateError>;

impl GenerationRun<'_> {
    fn write_shards(
        &self,
        claim: &ShardClaim<'_, ShardGroup, SampleRequest, EncodedSamples>,
    ) -> Result<WrittenShards, GenerateError> {
        let ShardGroup { shard, targets } = &claim.shard;
        let mut result = WrittenShards::default();
        let mut open = Vec::new();
        for number in targets {
            match self.open_shard(*number, shard)? {
                OpenShard::Open(writer) => open.push((*number, *writer)),
                OpenShard::Valid(stats) => result.stats.push(*stats),
                OpenShard::Held(holder) => result.held.push(holder),
            }
        }
        self.watch.written.fetch_add(result.stats.len() as u64, Ordering::Relaxed);
        if open.is_empty() {
            return Ok(result);
        }
        let together: Arc<[usize]> = open.iter().map(|(number, _)| *number).collect();
        let indices = self.targets[0].plan.layout.sample_indices(*shard);
        let requests = indices.map(|index| SampleRequest { index, targets: Arc::clone(&together) }).collect();
        let write = |samples: EncodedSamples| -> Result<(), GenerateError> {
            for ((_, ShardInProgress { writer, partial, .. }), sample) in open.iter_mut().zip(samples?) {
                writer
                    .append(&sample.label.header.key, &sample.members)
                    .map_err(|error| GenerateError::Io(partial.clone(), error))?;
                writer.stats.count_sample(&sample.label, sample.rejected, &sample.seconds, &sample.effects);
            }
            Ok(())
        };
        claim.make_in_order(requests, |request| self.encode_samples(&request), write)?;
        for (number, ShardInProgress { writer, partial, paths, older }) in open {
            let stats = writer.finish().map_err(|(path, error)| GenerateError::Io(path, error))?;
            if let Some(mirror) = &self.targets[number].mirror {
                mirror.push_shard(&paths, &stats, older)?;
            }
            Step::ShardDone.pause_if_requested(&partial);
            self.watch.written.fetch_add(1, Ordering::Relaxed);
            result.stats.push(stats);
        }
        Ok(result)
    }

    /// Begins a shard of a target, unless it is there or another process is writing it.
    fn open_shard(&self, number: usize, shard: &Shard) -> Result<OpenShard, GenerateError> {
        let Target { plan, root, mirror, known_job } = &self.targets[number];
        let paths = ShardPaths::new(root, shard, plan.output().container);
        let lock = {
            // Under the dataset's lock: a run that replaces the dataset either finds this shard locked, or has done so
            // before and is found out below.
            let of_all = cleanup::lock_path(root);
            let _alone = Lock::acquire(&of_all).map_err(|error| GenerateError::Io(of_all.clone(), error))?;
            let taken = Lock::try_acquire(&paths.lock).map_err(|error| GenerateError::Io(paths.lock.clone(), error))?;
            match mirror {
                None => check_still_ours(root, plan, known_job)?,
                Some(mirror) => mirror.still_ours(plan)?,
            }
            taken
        };
        let lock = match lock {
            Ok(lock) => lock,
            Err(holder) => {
                let name = name_in_set(self.targets, number, &shard.name());
                return Ok(OpenShard::Held(format!("{name} is being written by {holder}")));
            }
        };
        Step::ShardLocked.pause_if_requested(&paths.data);
        // Another process may have finished the shard since it was looked for.
        if mirror.is_none()
            && let ShardState::Valid(stats) = find_shard(plan, root, shard, CheckLevel::Checksums)?
        {
            return Ok(OpenShard::Valid(stats));
        }
        let (partial, older) = (paths.partial.clone(), paths.stats.exists());
        let writer = ShardWriter::create(paths.clone(), lock, shard, &plan.fingerprint)
            .map_err(|error| GenerateError::Io(partial.clone(), error))?;
        Ok(OpenShard::Open(Box::new(ShardInProgress { writer, partial, paths, older })))
    }

    fn encode_samples(&self, request: &SampleRequest) -> EncodedSamples {
        let SampleRequest { index, targets } = request;
        let stop = || self.watch.stop.load(Ordering::Relaxed) || self.failed.load(Ordering::Relaxed);
        if stop() {
            return Err(GenerateError::Interrupted);
        }
        let plans: Vec<&Plan> = targets.iter().map(|number| self.targets[*number].plan).collect();
        let folders: Vec<PathBuf> = targets.iter().map(|number| self.targets[*number].root.join(DATA_FOLDER)).collect();
        let keep: Vec<FrameStorage<'_>> =
            folders.iter().map(|folder| FrameStorage::OnDisk { folder, stop: &stop }).collect();
        // A panic leaves nothing changed outside, so that unwinding is safe.
        let made = catch_unwind(AssertUnwindSafe(|| (self.draw)(&plans, *index, &keep)));
        self.watch.rendered.fetch_add(plans.len() as u64, Ordering::Relaxed);
        let made = made.map_err(|panic| GenerateError::Panicked(*index, panic_message(&*panic)))?;
        made.map_err(|error| match error {
            SampleError::Rejected(rejected) => GenerateError::Unhealthy(rejected),
            SampleError::Io(path, error) => GenerateError::Io(path, error),
            SampleError::Stopped => GenerateError::Interrupted,
        })
    }
}

/// A shard that is being written.
struct ShardInProgress {
    writer: ShardWriter,
    partial: PathBuf,
    paths: ShardPaths,
    /// Whether there were stats of it before.
    older: bool,
}

/// What is found where a shard should be written.
enum OpenShard {
    Open(Box<ShardInProgress>),
    Valid(Box<ShardStats>),
    Held(String),
}

/// Returns the message of a panic.
pub fn panic_message(panic: &(dyn Any + Send)) -> String {
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
            let request = GenerateRequest { root: root.clone(), shards: None, threads: Some(threads), overwrite: true };
            let broken = |plans: &[&Plan], index: u64, keep: &[FrameStorage<'_>]| match index {
                27 => panic!("injected"),
                _ => make_samples(plans, index, keep),
            };
            let targets = [Target { plan: &plan, root: root.clone(), mirror: None, known_job: KnownJob::default() }];
            match run_generation(&targets, &request, &RunMonitor::default(), &broken) {
                Err(GenerateError::Panicked(27, message)) => assert_eq!(message, "injected"),
                other => panic!("{other:?}"),
            }
            // On one thread the shards before it are finished; on several they may be under way, and then are dropped.
            let there = |number| find_shard(&plan, &root, &plan.layout.shard(number), CheckLevel::Checksums);
            let finished = |number| matches!(there(number), Ok(ShardState::Valid(_)));
            assert!(threads > 1 || finished(0) && finished(1));
            assert!(!root.join("data/train-000002.tar").exists());
            let partials = std::fs::read_dir(root.join("data")).expect("a folder").filter_map(Result::ok);
            assert_eq!(partials.filter(|entry| entry.file_name().to_string_lossy().starts_with('.')).count(), 0);

            let request = GenerateRequest { overwrite: false, ..request };
            let done = generate(&plan, &request, &RunMonitor::default()).expect("the same command goes on");
            assert!(done.complete);
            assert!(threads > 1 || (done.shards, done.skipped) == (1, 2), "{done:?}");
        }
    }
}
