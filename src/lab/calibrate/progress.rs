//! How far a calibration has come, counted in steps of training; other work counts as so many of them as take as long.

use std::sync::atomic::{AtomicU64, Ordering};

/// Who is told which part of the work is done, 0 to 1, and what is being done.
pub type Heard<'a> = &'a (dyn Fn(f64, &str) + Sync);

/// Work of a known size.
pub struct Work<'a> {
    done: AtomicU64,
    all: u64,
    heard: Heard<'a>,
}

impl<'a> Work<'a> {
    /// So many steps.
    pub fn new(all: u64, heard: Heard<'a>) -> Self {
        Self { done: AtomicU64::new(0), all: all.max(1), heard }
    }

    /// So many more steps are done; what they were for.
    pub fn add(&self, steps: u64, what: &str) {
        let done = self.done.fetch_add(steps, Ordering::Relaxed) + steps;
        (self.heard)(done.min(self.all) as f64 / self.all as f64, what);
    }
}
