//! A line of text every few seconds, where the command is built without a bar: as `pip install` builds it.

use std::cell::Cell;
use std::io::IsTerminal;
use std::time::{Duration, Instant};

use crate::cli::say;

/// Between two lines.
const PERIOD: Duration = Duration::from_secs(5);

/// Lines on standard error.
pub struct Bar {
    visible: bool,
    samples: Cell<u64>,
    due: Cell<Instant>,
}

impl Bar {
    /// Lines that are written if they are `wanted` and there is a terminal.
    pub fn new(wanted: bool) -> Self {
        let visible = wanted && std::io::stderr().is_terminal();
        Self { visible, samples: Cell::new(0), due: Cell::new(Instant::now() + PERIOD) }
    }

    /// True if nobody sees them.
    pub fn is_hidden(&self) -> bool {
        !self.visible
    }

    /// Starts to count towards `samples`.
    pub fn start(&self, samples: u64) {
        self.samples.set(samples);
    }

    /// Says how many samples there are, and what else is to be said, if a line is due.
    pub fn show(&self, samples: u64, message: String) {
        let now = Instant::now();
        if self.visible && now >= self.due.get() {
            self.due.set(now + PERIOD);
            say(&format!("{samples}/{} samples, {message}", self.samples.get()));
        }
    }

    /// Says no more.
    pub fn end(self) {}
}
