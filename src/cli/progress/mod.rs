//! Progress of a run: a bar on a terminal, a line every few seconds in a log of JSON.

use std::sync::atomic::Ordering;
use std::time::{Duration, Instant};

use serde_json::json;

pub(super) mod bar;

use super::log::{Format, Log};
use bar::Bar;
use gelsim_dataset::generate::{ExpectedWork, RunMonitor};
use gelsim_job::label::GENERATOR;

/// Time between two lines of a log.
const PERIOD: Duration = Duration::from_secs(5);

/// Shows the progress of a run.
pub(super) struct Progress {
    log: Log,
    bar: Bar,
    /// When rendering started, and when the next line is due; `None` before it starts.
    started: Option<(Instant, Instant)>,
}

impl Progress {
    /// Creates the display of a run that begins now.
    pub fn new(log: Log) -> Self {
        let bar = Bar::new(!log.quiet && log.format == Format::Text, "samples");
        Self { log, bar, started: None }
    }

    /// Returns how long to wait before the next update. Without a bar that is the time until the end of the work is
    /// noticed.
    pub fn time_to_update(&self) -> Duration {
        Duration::from_millis(if self.bar.is_hidden() { 5 } else { 100 })
    }

    /// Updates bar and log.
    pub fn show(&mut self, watch: &RunMonitor) {
        let Some(expected) = watch.expected.get() else { return };
        let now = Instant::now();
        let (rendered, written) = (watch.rendered.load(Ordering::Relaxed), watch.written.load(Ordering::Relaxed));
        match &mut self.started {
            None => {
                self.started = Some((now, now + PERIOD));
                self.log.write_event("start", start_fields(expected));
                self.bar.start(expected.samples);
            }
            Some((started, due)) if now >= *due => {
                *due = now + PERIOD;
                let seconds = (now - *started).as_secs_f64();
                let per_s = rendered as f64 / seconds;
                let left_s = (expected.samples - rendered.min(expected.samples)) as f64 / per_s;
                self.log.write_event(
                    "progress",
                    json!({
                        "samples": rendered,
                        "samples_in_all": expected.samples,
                        "shards": written,
                        "shards_in_all": expected.shards,
                        "seconds": seconds,
                        "samples_per_s": per_s,
                        // Not a number of JSON until the first sample is done.
                        "seconds_left": left_s.is_finite().then_some(left_s),
                    }),
                );
            }
            Some(_) => {}
        }
        self.bar.show(rendered, &format!("{written}/{} shards", expected.shards));
    }

    /// Removes the bar.
    pub fn end(self) {
        self.bar.end();
    }
}

fn start_fields(expected: &ExpectedWork) -> serde_json::Value {
    json!({
        "generator": GENERATOR,
        "samples": expected.samples,
        "shards": expected.shards,
        "shards_there_already": expected.skipped,
    })
}
