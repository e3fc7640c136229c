//! `gelsim.generate`: writes a dataset to disk, as the command does.

use std::panic::{AssertUnwindSafe, catch_unwind};
use std::path::{Path, PathBuf};
use std::sync::atomic::Ordering;
use std::sync::mpsc::{RecvTimeoutError, channel};
use std::thread;
use std::time::Duration;

use gelsim_dataset::folder::recorded_fidelity;
use gelsim_dataset::generate::{GenerateError, GenerateRequest, RunMonitor, RunSummary, generate as write};
use gelsim_dataset::verify::{DatasetFinding, Remedy};
use gelsim_files::store::{StoreAddress, explain_mistaken_output};
use gelsim_job::label::sample_key;
use gelsim_job::plan::Plan;
use gelsim_job::probe::preview_job;
use gelsim_lab::outcome::{HOPELESS_RUN_HELP, explain_hopeless_run, note_outcome};
use pyo3::exceptions::PyInterruptedError;
use pyo3::prelude::*;
use pyo3::types::PyDict;
use rayon::ThreadPoolBuilder;

use crate::arguments::{OptionalArgument, extract_flag, extract_path as a_path};
use crate::errors::{emit_warnings, mistake_error, panic_error, runtime_error, usage_error};
use crate::job::{Job, extract_overrides, settle_fidelity};
use crate::threads::{extract_thread_count, threads_or_default};

/// Time between two looks at signals.
const SIGNAL_INTERVAL: Duration = Duration::from_millis(50);

/// Writes a dataset, and returns what was made as a dictionary. This is `gelsim.generate`.
#[pyfunction]
#[pyo3(signature = (job, out, samples, seed, fidelity, all_effects, set, threads, overwrite))]
#[expect(clippy::too_many_arguments, reason = "they are the command's flags")]
pub fn generate<'py>(
    py: Python<'py>,
    job: &Bound<'py, PyAny>,
    out: &Bound<'py, PyAny>,
    samples: OptionalArgument<'_, 'py>,
    seed: OptionalArgument<'_, 'py>,
    fidelity: OptionalArgument<'_, 'py>,
    all_effects: OptionalArgument<'_, 'py>,
    set: OptionalArgument<'_, 'py>,
    threads: OptionalArgument<'_, 'py>,
    overwrite: OptionalArgument<'_, 'py>,
) -> PyResult<Bound<'py, PyDict>> {
    let root = a_path("out", out)?;
    if root.as_os_str().as_encoded_bytes().contains(&0) {
        return Err(mistake_error("out has a NUL in it", "give the path of a folder"));
    }
    if let Some(reason) = explain_mistaken_output(&root) {
        return Err(mistake_error(format!("out: {reason}"), "give the path of a folder"));
    }
    if StoreAddress::is_address(&root) {
        let help = "write to a folder and copy that, or run the command: gelsim generate JOB --out s3://BUCKET/PREFIX";
        return Err(mistake_error(format!("out: {} is in an object store", root.display()), help));
    }
    let (threads, overwrite) = (extract_thread_count(threads)?, extract_flag("overwrite", overwrite)?);
    let overrides = extract_overrides(samples, seed, fidelity, all_effects, set)?;
    let mut may_miss = false;
    let plan = match job.cast::<Job>() {
        Ok(job) if overrides.set.is_empty() && overrides.fidelity.is_none() => job.get().plan(),
        Ok(_) => {
            let message = "a job that was loaded stays as it is";
            return Err(mistake_error(message, "give samples, seed, fidelity, all_effects and set to gelsim.Job.load"));
        }
        Err(_) => {
            let path = a_path("job", job)?;
            let pool = crate::threads::shared_pool(py, threads)?;
            let read = || {
                let plan = Plan::load(&path, &overrides)?;
                let begun = plan.dataset_folders(&root).swap_remove(0);
                let recorded = if overwrite { None } else { recorded_fidelity(&begun) };
                match recorded.filter(|_| plan.open_fidelity_choice().is_some()) {
                    Some(level) => Ok(plan.with_fidelity(level)),
                    None => settle_fidelity(plan),
                }
            };
            let plan = py.detach(|| pool.install(read)).map_err(|report| usage_error(&report))?;
            let foreseen = py.detach(|| pool.install(|| preview_job(&plan)));
            may_miss = foreseen.may_miss;
            emit_warnings(py, &foreseen.notes)?;
            plan.into()
        }
    };
    let request =
        GenerateRequest { root: root.clone(), shards: None, threads: threads_or_default(py, threads)?, overwrite };
    let done = run_watching_signals(py, &plan, &request)?;
    let done =
        done.map_err(|panic| panic_error("the run", &*panic))?.map_err(|error| stopped_error(error, plan.seed()))?;
    // A warning from before the run is not repeated after it.
    let no_contact = plan.job().indentation.no_contact;
    emit_warnings(py, &note_outcome(&done, Some(no_contact).filter(|_| !may_miss)))?;
    if let Some(message) = explain_hopeless_run(&done) {
        return Err(runtime_error(format!("{message} in {}: {HOPELESS_RUN_HELP}", root.display())));
    }
    summary_dict(py, &done, &root)
}

/// Writes the dataset on threads of its own while Python handles signals. An exception that a handler raises stops the
/// run, and is raised when the run has ended.
fn run_watching_signals(
    py: Python<'_>,
    plan: &Plan,
    request: &GenerateRequest,
) -> PyResult<thread::Result<Result<RunSummary, GenerateError>>> {
    let watch = RunMonitor::default();
    // A pool of its own, so that the run waits for nobody else. Work outside of any pool would use rayon's global pool,
    // whose threads a forked process lacks.
    let pool = ThreadPoolBuilder::new().num_threads(request.threads.unwrap_or(0)).build();
    let pool = pool.map_err(|error| runtime_error(format!("cannot start threads: {error}")))?;
    // A panic leaves nothing half changed that is used later.
    let run = || catch_unwind(AssertUnwindSafe(|| pool.install(|| write(plan, request, &watch))));
    // Python runs handlers only on its main thread. On any other, the signals of the run would never be seen.
    let threading = py.import("threading")?;
    let is_main = threading.call_method0("current_thread")?.is(&threading.call_method0("main_thread")?);
    if !is_main {
        return Ok(py.detach(run));
    }
    thread::scope(|scope| {
        let (tell, mut told) = channel();
        // The scope waits for the thread in any case; the channel only tells when it is done.
        scope.spawn(move || drop(tell.send(run())));
        let mut raised = None;
        loop {
            let heard;
            // The receiver moves into the closure and back, because it cannot be shared between threads.
            (heard, told) = py.detach(move || (told.recv_timeout(SIGNAL_INTERVAL), told));
            match heard {
                Ok(done) => return raised.map_or(Ok(done), Err),
                Err(RecvTimeoutError::Disconnected) => return Err(runtime_error("the thread that writes has ended")),
                Err(RecvTimeoutError::Timeout) => {}
            }
            if let Err(error) = py.check_signals() {
                watch.stop.store(true, Ordering::Relaxed);
                raised.get_or_insert(error);
            }
        }
    })
}

/// Returns the exception for a run that ended early, with what is left of its work.
fn stopped_error(error: GenerateError, seed: u64) -> PyErr {
    match error {
        GenerateError::Usage(report) => usage_error(&report),
        GenerateError::Io(path, error) => runtime_error(format!(
            "{}: {error}; what is finished stays, the same call goes on from there",
            path.display()
        )),
        GenerateError::Held(holders) => {
            runtime_error(format!("{}; all other shards are done, the same call checks again", holders.join("; ")))
        }
        GenerateError::Invalid(findings) => {
            let strays = findings.iter().filter(|finding| matches!(finding.remedy, Remedy::Remove(_)));
            let named: Vec<String> = strays.map(DatasetFinding::to_string).collect();
            runtime_error(format!("{}; readers would take it for data: remove it, and call again", named.join("; ")))
        }
        GenerateError::Unhealthy(unfit) => runtime_error(format!(
            "{unfit}; set={{\"output.on_unhealthy\": \"keep\"}} takes such samples, \"reject\" draws them again"
        )),
        GenerateError::Panicked(index, said) => runtime_error(format!(
            "sample {} (seed {seed}) brought gelsim down, which is a bug: {said}",
            sample_key(index)
        )),
        GenerateError::Interrupted => PyInterruptedError::new_err("stopped; finished shards stay"),
    }
}

/// Returns what a run made as a dictionary.
fn summary_dict<'py>(py: Python<'py>, done: &RunSummary, root: &Path) -> PyResult<Bound<'py, PyDict>> {
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
