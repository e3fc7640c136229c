//! Long work on a thread of its own, with a display of its progress, which signals can stop.

use std::io;
use std::sync::Arc;
use std::sync::atomic::{AtomicUsize, Ordering};

use signal_hook::consts::{SIGINT, SIGTERM};

use super::log::Log;
use super::progress::Progress;
use super::{Failure, threads_failure};
use gelsim_dataset::generate::RunMonitor;

/// Runs `work`, which watches the monitor's stop flag. Returns its result, and the signal that came; 0 if none did.
pub(super) fn run_interruptible<T: Send>(
    log: Log,
    work: impl FnOnce(&RunMonitor) -> T + Send,
) -> Result<(T, usize), Failure> {
    let watch = Arc::new(RunMonitor::default());
    let signal = stop_on_signals(&watch).map_err(|error| {
        Failure::access_denied(&format!("cannot watch for signals: {error}"), &error, "nothing was begun")
    })?;
    let result = std::thread::scope(|scope| {
        let worker = std::thread::Builder::new().spawn_scoped(scope, || work(&watch));
        let worker = worker.map_err(|error| threads_failure(&error))?;
        let mut progress = Progress::new(log);
        while !worker.is_finished() {
            progress.show(&watch);
            std::thread::sleep(progress.time_to_update());
        }
        progress.show(&watch);
        progress.end();
        Ok::<_, Failure>(worker.join())
    })?;
    let result = result.unwrap_or_else(|panic| std::panic::resume_unwind(panic));
    Ok((result, signal.load(Ordering::Relaxed)))
}

/// Sets the monitor's stop flag on SIGINT and SIGTERM and records which signal it was; a second one ends the process at
/// once.
fn stop_on_signals(watch: &Arc<RunMonitor>) -> io::Result<Arc<AtomicUsize>> {
    let seen = Arc::new(AtomicUsize::new(0));
    let mut signals = signal_hook::iterator::Signals::new([SIGINT, SIGTERM])?;
    let (watch, noted) = (Arc::clone(watch), Arc::clone(&seen));
    std::thread::Builder::new().spawn(move || {
        for signal in signals.forever() {
            if noted.swap(signal as usize, Ordering::Relaxed) != 0 {
                std::process::exit(128 + signal);
            }
            watch.stop.store(true, Ordering::Relaxed);
        }
    })?;
    Ok(seen)
}
