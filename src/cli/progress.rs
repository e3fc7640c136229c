//! How far a run has come: a bar on a terminal, a line every few seconds in a log of JSON.

use std::io::IsTerminal;
use std::sync::atomic::Ordering;
use std::time::{Duration, Instant};

use indicatif::{ProgressBar, ProgressDrawTarget, ProgressState, ProgressStyle};
use serde_json::json;

use super::log::{Format, Log};
use crate::generate::{Expected, Watch};
use crate::label::GENERATOR;

/// Between two lines of a log.
const PERIOD: Duration = Duration::from_secs(5);

/// Shows how far a run has come.
pub(super) struct Progress {
    log: Log,
    bar: ProgressBar,
    /// Since when samples are rendered, and when the next line is due.
    started: Option<(Instant, Instant)>,
}

impl Progress {
    /// Of a run that begins now.
    pub fn new(log: Log) -> Self {
        let visible = !log.quiet && log.format == Format::Text && std::io::stderr().is_terminal();
        let target = if visible { ProgressDrawTarget::stderr() } else { ProgressDrawTarget::hidden() };
        let template = "{bar:32} {human_pos}/{human_len} samples  {msg}  {rate}  {eta} left";
        let style = ProgressStyle::with_template(template).unwrap_or(ProgressStyle::default_bar()).with_key(
            "rate",
            |state: &ProgressState, out: &mut dyn std::fmt::Write| {
                // What cannot be written to the terminal is only not seen.
                let _ = write!(out, "{:.0} samples/s", state.per_sec());
            },
        );
        Self { log, bar: ProgressBar::with_draw_target(None, target).with_style(style), started: None }
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
                self.bar.set_length(expected.samples);
                self.bar.reset_elapsed();
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
        self.bar.set_message(format!("{written}/{} shards", expected.shards));
        self.bar.set_position(rendered);
    }

    /// Clears the bar.
    pub fn end(self) {
        self.bar.finish_and_clear();
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
