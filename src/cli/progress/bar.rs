//! The bar, where the command is built with one.

use indicatif::{ProgressBar, ProgressDrawTarget, ProgressState, ProgressStyle};

use crate::terminal;
use gelsim_lab::numbers::HumanDuration;

/// A bar on standard error, as wide as the terminal.
pub struct Bar(ProgressBar);

/// In fewer columns a bar of less says it.
const WIDE: usize = 72;

impl Bar {
    /// One of so many `things`, which is shown if it is `wanted` and there is a terminal that lines can be drawn over on.
    pub fn new(wanted: bool, things: &str) -> Self {
        let wide = format!("{{wide_bar}} {{human_pos}}/{{human_len}} {things}  {{msg}}  {{rate}}  {{left}}");
        Self::of(wanted, &wide, "{wide_bar} {human_pos}/{human_len}  {left}")
    }

    /// The same of thousandths of some work.
    pub fn thousandths(wanted: bool) -> Self {
        let bar = Self::of(wanted, "{wide_bar} {percent:>3} %  {msg}", "{wide_bar} {percent:>3} %");
        bar.start(1000);
        bar
    }

    fn of(wanted: bool, wide: &str, narrow: &str) -> Self {
        let is_shown = wanted && terminal::is_drawn_on();
        let target = if is_shown { ProgressDrawTarget::stderr() } else { ProgressDrawTarget::hidden() };
        let is_wide = terminal::errors().columns.is_none_or(|columns| columns >= WIDE);
        // What cannot be written to the terminal is only not seen.
        let style = ProgressStyle::with_template(if is_wide { wide } else { narrow })
            .unwrap_or(ProgressStyle::default_bar())
            .with_key("rate", |state: &ProgressState, out: &mut dyn std::fmt::Write| {
                if let Some(per_s) = per_s(state) {
                    let _ = write!(out, "{per_s:.0}/s");
                }
            })
            .with_key("left", |state: &ProgressState, out: &mut dyn std::fmt::Write| {
                if let (Some(per_s), Some(all)) = (per_s(state), state.len()) {
                    let seconds = all.saturating_sub(state.pos()) as f64 / per_s;
                    let _ = write!(out, "{} left", HumanDuration(seconds));
                }
            });
        Self(ProgressBar::with_draw_target(None, target).with_style(style))
    }

    /// True if nobody sees it.
    pub fn is_hidden(&self) -> bool {
        self.0.is_hidden()
    }

    /// Starts to count towards `all`.
    pub fn start(&self, all: u64) {
        self.0.set_length(all);
        self.0.reset_elapsed();
    }

    /// Shows how many there are, and what else is to be said.
    pub fn show(&self, done: u64, message: &str) {
        self.0.set_message(message.to_owned());
        self.0.set_position(done);
    }

    /// One more is done.
    pub fn advance(&self) {
        self.0.inc(1);
    }

    /// Clears it.
    pub fn end(self) {
        self.0.finish_and_clear();
    }
}

/// Steps a second from the start on, once that is known.
fn per_s(state: &ProgressState) -> Option<f64> {
    let seconds = state.elapsed().as_secs_f64();
    (seconds > 0.5 && state.pos() > 0).then(|| state.pos() as f64 / seconds)
}
