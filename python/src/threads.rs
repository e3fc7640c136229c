//! The threads that read meshes and render.
//!
//! A forked process has the memory of its parent, but not its threads: whoever waits for those waits forever. So each
//! process makes its own pool, and nothing here uses rayon's global one. The locks are taken only while the GIL is
//! held, and a process that forks holds it, too: no child finds a lock taken.

use std::mem::forget;
use std::process;
use std::sync::{Arc, Mutex, PoisonError};

use gelsim_cli::MAX_THREADS;
use pyo3::prelude::*;
use rayon::{ThreadPool, ThreadPoolBuilder};

use crate::arguments::{OptionalArgument, extract_whole_number};
use crate::errors::{mistake_error, runtime_error};

/// A pool, with the process that made it.
struct Pool {
    process: u32,
    threads: usize,
    pool: Arc<ThreadPool>,
}

/// The pool that was used last.
static LAST: Mutex<Option<Pool>> = Mutex::new(None);

/// Reads a number of threads; `None` for all cores.
pub fn extract_thread_count(threads: OptionalArgument<'_, '_>) -> PyResult<Option<usize>> {
    let allowed = format!("give 1 to {MAX_THREADS}, or leave it out for all cores");
    match extract_whole_number("threads", threads, &allowed)? {
        Some(0) => Err(mistake_error("threads=0 cannot work", allowed)),
        Some(count) if count > MAX_THREADS as u64 => {
            Err(mistake_error(format!("threads={count} are more than any machine has cores"), allowed))
        }
        threads => Ok(threads.map(|count| count as usize)),
    }
}

/// Returns true if multiprocessing started this process. Asks Python once per process: the question runs Python code,
/// which [`crate::arrays`] avoids, too.
fn started_by_multiprocessing(py: Python<'_>) -> PyResult<bool> {
    static KNOWN: Mutex<Option<(u32, bool)>> = Mutex::new(None);
    let known = *KNOWN.lock().unwrap_or_else(PoisonError::into_inner);
    if let Some((_, started)) = known.filter(|(process, _)| *process == process::id()) {
        return Ok(started);
    }
    let started = !py.import("multiprocessing")?.call_method0("parent_process")?.is_none();
    *KNOWN.lock().unwrap_or_else(PoisonError::into_inner) = Some((process::id(), started));
    Ok(started)
}

/// Returns the number of threads for a run: as given, else one in a process that multiprocessing started, else `None`
/// for all cores.
pub fn threads_or_default(py: Python<'_>, threads: Option<usize>) -> PyResult<Option<usize>> {
    Ok(if threads.is_none() && started_by_multiprocessing(py)? { Some(1) } else { threads })
}

/// Returns a pool of so many threads, by default as many as [`threads_or_default`] says: a worker of a data loader has
/// one.
pub fn shared_pool(py: Python<'_>, threads: Option<usize>) -> PyResult<Arc<ThreadPool>> {
    let threads = threads_or_default(py, threads)?.unwrap_or(0);
    let process = process::id();
    let mut last = LAST.lock().unwrap_or_else(PoisonError::into_inner);
    match &*last {
        Some(pool) if (pool.process, pool.threads) == (process, threads) => return Ok(Arc::clone(&pool.pool)),
        _ => {}
    }
    let built = ThreadPoolBuilder::new().num_threads(threads).build();
    let pool = Arc::new(built.map_err(|error| runtime_error(format!("cannot start threads: {error}")))?);
    let before = last.replace(Pool { process, threads, pool: Arc::clone(&pool) });
    if let Some(before) = before.filter(|before| before.process != process) {
        // After a fork the old pool's threads do not exist here. Dropping it would wait for them forever.
        forget(before);
    }
    Ok(pool)
}
