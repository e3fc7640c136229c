//! How far a run has come: a bar on a terminal, a line every few seconds in a log of JSON.

use std::sync::atomic::Ordering;
use std::time::{Duration, Instant};

use serde_json::json;

pub(super) mod bar;

use super::log::{Format, Log};
use bar::Bar;
use gelsim_dataset::generate::{Expected, Watch};
use gelsim_job::label::GENERATOR;

/// Between two lines of a log.
const PERIOD: Duration = Duration::from_secs(5);

/// Shows how far a run has come.
pub(super) struct Progress {
    log: Log,
    bar: Bar,
    /// Since when samples are rendered, and when the next line is due.
    started: Option<(Instant, Instant)>,
}

impl Progress {
    /// Of a run that begins now.
    pub fn new(log: Log) -> Self {
        let bar = Bar::new(!log.quiet && log.format == Format::Text, "samples");
        Self { log, bar, started: None }
    }

    /// How long to wait until it is worth being shown again.
    pub fn pause(&self) -> Duration {
        Duration::from_millis(if self.bar.is_hidden() { 5 } else { 100 })
    }

    /// Shows where the run is.
    pub fn show(&mut self, watch: &Watch) {
        let Some(expected) = watch.expected.get() else { return };
        let now = Instant::now();
        let (rendered, written) = (watch.rendered.load(Ordering::Relaxed), watch.written.load(Ordering::Relaxed));
        match &mut self.started {
            None => {
                self.started = Some((now, now + PERIOD));
                self.log.event("start", start(expected));
                self.bar.start(expected.samples);
            }
            Some((started, due)) if now >= *due => {
                *due = now + PERIOD;
                let seconds = (now - *started).as_secs_f64();
                let per_s = rendered as f64 / seconds;
                let left_s = (expected.samples - rendered.min(expected.samples)) as f64 / per_s;
                self.log.event(
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

    /// Clears the bar.
    pub fn end(self) {
        self.bar.end();
    }
}

fn start(expected: &Expected) -> serde_json::Value {
    json!({
        "generator": GENERATOR,
        "samples": expected.samples,
        "shards": expected.shards,
        "shards_there_already": expected.skipped,
    })
}
