//! The threads that read meshes and render.
//!
//! A process that was forked from another has its memory, but not its threads: who waits for those waits for ever. So a pool
//! belongs to a process, and nothing here uses rayon's global one. Whoever takes the lock holds the GIL, as does whoever
//! forks: no child finds it taken.

use std::mem::forget;
use std::process;
use std::sync::{Arc, Mutex, PoisonError};

use gelsim_cli::MOST_THREADS;
use pyo3::prelude::*;
use rayon::{ThreadPool, ThreadPoolBuilder};

use crate::arguments::{Given, whole};
use crate::errors::{mistake, running};

struct Pool {
    process: u32,
    threads: usize,
    pool: Arc<ThreadPool>,
}

/// The pool that was used last.
static LAST: Mutex<Option<Pool>> = Mutex::new(None);

/// A number of threads that a user gave.
pub fn checked(threads: Given<'_, '_>) -> PyResult<Option<usize>> {
    let allowed = format!("give 1 to {MOST_THREADS}, or leave it out for all cores");
    match whole("threads", threads, &allowed)? {
        Some(0) => Err(mistake("threads=0 cannot work", allowed)),
        Some(count) if count > MOST_THREADS as u64 => {
            Err(mistake(format!("threads={count} are more than any machine has cores"), allowed))
        }
        threads => Ok(threads.map(|count| count as usize)),
    }
}

/// Python is asked once in each process: what it answers with is Python's code, which `arrays::scanner` avoids, too.
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

/// How many threads a run of its own takes: all cores if none, and one in a process that multiprocessing started.
pub fn threads_or_default(py: Python<'_>, threads: Option<usize>) -> PyResult<Option<usize>> {
    Ok(if threads.is_none() && started_by_multiprocessing(py)? { Some(1) } else { threads })
}

/// A pool of so many threads. If nobody says how many: all cores, and one in a process that multiprocessing started, as a
/// worker of a loader is.
pub fn pool(py: Python<'_>, threads: Option<usize>) -> PyResult<Arc<ThreadPool>> {
    let threads = threads_or_default(py, threads)?.unwrap_or(0);
    let process = process::id();
    let mut last = LAST.lock().unwrap_or_else(PoisonError::into_inner);
    match &*last {
        Some(pool) if (pool.process, pool.threads) == (process, threads) => return Ok(Arc::clone(&pool.pool)),
        _ => {}
    }
    let built = ThreadPoolBuilder::new().num_threads(threads).build();
    let pool = Arc::new(built.map_err(|error| running(format!("cannot start threads: {error}")))?);
    let before = last.replace(Pool { process, threads, pool: Arc::clone(&pool) });
    if let Some(before) = before.filter(|before| before.process != process) {
        // Its threads are not there, so they cannot be told to end.
        forget(before);
    }
    Ok(pool)
}
