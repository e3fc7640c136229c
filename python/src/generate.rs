//! `gelsim.generate`: a dataset on disk, as the command writes it.

use std::panic::{AssertUnwindSafe, catch_unwind};
use std::path::{Path, PathBuf};
use std::sync::atomic::Ordering;
use std::sync::mpsc::{RecvTimeoutError, channel};
use std::thread;
use std::time::Duration;

use gelsim_dataset::folder::recorded_fidelity;
use gelsim_dataset::generate::{Done, GenerateError, Request, Watch, generate as write};
use gelsim_dataset::verify::{Cure, Finding};
use gelsim_files::store::{Address, mistaken_output};
use gelsim_job::label::key;
use gelsim_job::plan::Plan;
use gelsim_job::probe::foresee;
use pyo3::exceptions::PyInterruptedError;
use pyo3::prelude::*;
use pyo3::types::PyDict;
use rayon::ThreadPoolBuilder;

use crate::arguments::{Given, flag, path as a_path};
use crate::errors::{mistake, panicked, running, usage, warn};
use crate::job::{Job, overrides, settled};
use crate::threads::{checked, threads_or_default};

/// How often Python may look at signals.
const LOOK: Duration = Duration::from_millis(50);

/// Writes a dataset; what was done, by name. `gelsim.generate` is this.
#[pyfunction]
#[pyo3(signature = (job, out, samples, seed, fidelity, all_effects, set, threads, overwrite))]
#[expect(clippy::too_many_arguments, reason = "they are the command's flags")]
pub fn generate<'py>(
    py: Python<'py>,
    job: &Bound<'py, PyAny>,
    out: &Bound<'py, PyAny>,
    samples: Given<'_, 'py>,
    seed: Given<'_, 'py>,
    fidelity: Given<'_, 'py>,
    all_effects: Given<'_, 'py>,
    set: Given<'_, 'py>,
    threads: Given<'_, 'py>,
    overwrite: Given<'_, 'py>,
) -> PyResult<Bound<'py, PyDict>> {
    let root = a_path("out", out)?;
    if root.as_os_str().as_encoded_bytes().contains(&0) {
        return Err(mistake("out has a NUL in it", "give the path of a folder"));
    }
    if let Some(reason) = mistaken_output(&root) {
        return Err(mistake(format!("out: {reason}"), "give the path of a folder"));
    }
    if Address::is_one(&root) {
        let help = "write to a folder and copy that, or run the command: gelsim generate JOB --out s3://BUCKET/PREFIX";
        return Err(mistake(format!("out: {} is in an object store", root.display()), help));
    }
    let (threads, overwrite) = (checked(threads)?, flag("overwrite", overwrite)?);
    let overrides = overrides(samples, seed, fidelity, all_effects, set)?;
    let plan = match job.cast::<Job>() {
        Ok(job) if overrides.set.is_empty() && overrides.fidelity.is_none() => job.get().plan(),
        Ok(_) => {
            let message = "a job that was loaded stays as it is";
            return Err(mistake(message, "give samples, seed, fidelity, all_effects and set to gelsim.Job.load"));
        }
        Err(_) => {
            let path = a_path("job", job)?;
            let pool = crate::threads::pool(py, threads)?;
            let recorded = if overwrite { None } else { recorded_fidelity(&root) };
            let read = || {
                let plan = Plan::load(&path, &overrides)?;
                match recorded.filter(|_| plan.open_choice().is_some()) {
                    Some(level) => Ok(plan.with_fidelity(level)),
                    None => settled(plan),
                }
            };
            let plan = py.detach(|| pool.install(read)).map_err(|report| usage(&report))?;
            warn(py, &py.detach(|| pool.install(|| foresee(&plan))).notes)?;
            plan.into()
        }
    };
    let request = Request { root: root.clone(), shards: None, threads: threads_or_default(py, threads)?, overwrite };
    let done = watched(py, &plan, &request)?;
    let done = done.map_err(|panic| panicked("the run", &*panic))?.map_err(|error| stopped(error, plan.seed()))?;
    summary(py, &done, &root)
}

/// Writes it, on threads of its own, while Python looks at signals: what a handler raises stops the run, and is raised when that has
/// ended.
fn watched(py: Python<'_>, plan: &Plan, request: &Request) -> PyResult<thread::Result<Result<Done, GenerateError>>> {
    let watch = Watch::default();
    // Of its own, so that nobody else waits for it: what divides its work outside of any pool takes threads that a forked process
    // has not.
    let pool = ThreadPoolBuilder::new().num_threads(request.threads.unwrap_or(0)).build();
    let pool = pool.map_err(|error| running(format!("cannot start threads: {error}")))?;
    // Nothing outside is changed by what panics.
    let run = || catch_unwind(AssertUnwindSafe(|| pool.install(|| write(plan, request, &watch))));
    // Only there handlers run; another thread does not come back to Python before the work is done.
    let threading = py.import("threading")?;
    let is_main = threading.call_method0("current_thread")?.is(&threading.call_method0("main_thread")?);
    if !is_main {
        return Ok(py.detach(run));
    }
    thread::scope(|scope| {
        let (tell, mut told) = channel();
        // Whoever waits for it does so until it is told.
        scope.spawn(move || drop(tell.send(run())));
        let mut raised = None;
        loop {
            let heard;
            // Its end goes along: threads do not share it.
            (heard, told) = py.detach(move || (told.recv_timeout(LOOK), told));
            match heard {
                Ok(done) => return raised.map_or(Ok(done), Err),
                Err(RecvTimeoutError::Disconnected) => return Err(running("the thread that writes has ended")),
                Err(RecvTimeoutError::Timeout) => {}
            }
            if let Err(error) = py.check_signals() {
                watch.stop.store(true, Ordering::Relaxed);
                raised.get_or_insert(error);
            }
        }
    })
}

/// What to raise for a run that ended early.
fn stopped(error: GenerateError, seed: u64) -> PyErr {
    match error {
        GenerateError::Usage(report) => usage(&report),
        GenerateError::Io(path, error) => {
            running(format!("{}: {error}; what is finished stays, the same call goes on from there", path.display()))
        }
        GenerateError::Held(holders) => {
            running(format!("{}; all other shards are done, the same call checks again", holders.join("; ")))
        }
        GenerateError::Wanting(findings) => {
            let strays = findings.iter().filter(|finding| matches!(finding.cure, Cure::Remove(_)));
            let named: Vec<String> = strays.map(Finding::to_string).collect();
            running(format!("{}; readers would take it for data: remove it, and call again", named.join("; ")))
        }
        GenerateError::Unhealthy(unfit) => running(format!(
            "{unfit}; set={{\"output.on_unhealthy\": \"keep\"}} takes such samples, \"reject\" draws them again"
        )),
        GenerateError::Panicked(index, said) => {
            running(format!("sample {} (seed {seed}) brought gelsim down, which is a bug: {said}", key(index)))
        }
        GenerateError::Interrupted => PyInterruptedError::new_err("stopped; finished shards stay"),
    }
}

fn summary<'py>(py: Python<'py>, done: &Done, root: &Path) -> PyResult<Bound<'py, PyDict>> {
    let dict = PyDict::new(py);
    dict.set_item("path", PathBuf::from(root))?;
    for (name, count) in [
        ("samples", done.samples),
        ("shards", done.shards),
        ("shards_there_already", done.skipped),
        ("rejected", done.rejected),
        ("unhealthy", done.unhealthy),
        ("unconverged", done.unconverged),
        ("in_contact", done.in_contact),
        ("unplaced_objects", done.unplaced_objects),
        ("bytes", done.bytes),
    ] {
        dict.set_item(name, count)?;
    }
    dict.set_item("shards_made_again", &done.damaged)?;
    dict.set_item("light_outside_range", done.light.share_outside())?;
    dict.set_item("seconds", done.seconds)?;
    dict.set_item("complete", done.complete)?;
    Ok(dict)
}
