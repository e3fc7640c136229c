//! Long work on a thread of its own, while its progress is shown and signals can stop it.

use std::io;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering};

use signal_hook::consts::{SIGINT, SIGTERM, SIGXFSZ};

use super::log::Log;
use super::progress::Progress;
use super::{Failure, no_threads};
use gelsim_dataset::generate::Watch;

/// Does the work, which looks at the watch. Its result, and the signal that came; 0 if none did.
pub(super) fn long_run<T: Send>(log: Log, work: impl FnOnce(&Watch) -> T + Send) -> Result<(T, usize), Failure> {
    let watch = Arc::new(Watch::default());
    let signal = raise_on_signals(&watch)
        .map_err(|error| Failure::denied(&format!("cannot watch for signals: {error}"), &error, "nothing was begun"))?;
    let result = std::thread::scope(|scope| {
        let worker = std::thread::Builder::new().spawn_scoped(scope, || work(&watch));
        let worker = worker.map_err(|error| no_threads(&error))?;
        let mut progress = Progress::new(log);
        while !worker.is_finished() {
            progress.show(&watch);
            std::thread::sleep(progress.pause());
        }
        progress.show(&watch);
        progress.end();
        Ok::<_, Failure>(worker.join())
    })?;
    let result = result.unwrap_or_else(|panic| std::panic::resume_unwind(panic));
    Ok((result, signal.load(Ordering::Relaxed)))
}

/// Raises the watch's stop flag on SIGINT and SIGTERM and notes which it was; a second one ends the process at once.
/// SIGXFSZ ends nothing: a file beyond a limit of the user's is an error where it is written.
fn raise_on_signals(watch: &Arc<Watch>) -> io::Result<Arc<AtomicUsize>> {
    let seen = Arc::new(AtomicUsize::new(0));
    signal_hook::flag::register(SIGXFSZ, Arc::new(AtomicBool::new(false)))?;
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
