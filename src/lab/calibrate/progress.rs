//! Counts the progress of a calibration in training steps. Other work counts as the number of steps that take as long.

use std::sync::atomic::{AtomicU64, Ordering};

/// Is called with the part of the work that is done, 0 to 1, and what is being done.
pub type ProgressCallback<'a> = &'a (dyn Fn(f64, &str) + Sync);

/// Progress of work of a known size.
pub struct ProgressMeter<'a> {
    done: AtomicU64,
    all: u64,
    callback: ProgressCallback<'a>,
}

impl<'a> ProgressMeter<'a> {
    /// Starts the progress of `all` steps.
    pub fn new(all: u64, callback: ProgressCallback<'a>) -> Self {
        Self { done: AtomicU64::new(0), all: all.max(1), callback }
    }

    /// Adds steps that are done, and reports what they were for.
    pub fn advance(&self, steps: u64, what: &str) {
        let done = self.done.fetch_add(steps, Ordering::Relaxed) + steps;
        (self.callback)(done.min(self.all) as f64 / self.all as f64, what);
    }
}
