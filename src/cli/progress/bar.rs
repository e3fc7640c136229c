//! The progress bar of long work.

use indicatif::{ProgressBar, ProgressDrawTarget, ProgressState, ProgressStyle};

use crate::terminal;
use gelsim_lab::numbers::HumanDuration;

/// A bar on standard error, as wide as the terminal.
pub struct Bar(ProgressBar);

/// Columns from which on the bar also has its message and rate.
const WIDE_COLUMNS: usize = 72;

impl Bar {
    /// Creates a bar that counts `things`. It is shown if it is `wanted` and standard error is a terminal whose lines
    /// can be redrawn.
    pub fn new(wanted: bool, things: &str) -> Self {
        let wide = format!("{{wide_bar}} {{human_pos}}/{{human_len}} {things}  {{msg}}  {{rate}}  {{left}}");
        Self::with_templates(wanted, &wide, "{wide_bar} {human_pos}/{human_len}  {left}")
    }

    /// Creates a bar that counts thousandths of some work.
    pub fn in_thousandths(wanted: bool) -> Self {
        let bar = Self::with_templates(wanted, "{wide_bar} {percent:>3} %  {msg}", "{wide_bar} {percent:>3} %");
        bar.start(1000);
        bar
    }

    fn with_templates(wanted: bool, wide: &str, narrow: &str) -> Self {
        let is_shown = wanted && terminal::can_redraw_stderr();
        let target = if is_shown { ProgressDrawTarget::stderr() } else { ProgressDrawTarget::hidden() };
        let is_wide = terminal::stderr_display().columns.is_none_or(|columns| columns >= WIDE_COLUMNS);
        // The templates are fixed; a mistake in one would only make the bar look plain.
        let style = ProgressStyle::with_template(if is_wide { wide } else { narrow })
            .unwrap_or(ProgressStyle::default_bar())
            .with_key("rate", |state: &ProgressState, out: &mut dyn std::fmt::Write| {
                if let Some(per_s) = steps_per_second(state) {
                    let _ = write!(out, "{per_s:.0}/s");
                }
            })
            .with_key("left", |state: &ProgressState, out: &mut dyn std::fmt::Write| {
                if let (Some(per_s), Some(all)) = (steps_per_second(state), state.len()) {
                    let seconds = all.saturating_sub(state.pos()) as f64 / per_s;
                    let _ = write!(out, "{} left", HumanDuration(seconds));
                }
            });
        Self(ProgressBar::with_draw_target(None, target).with_style(style))
    }

    /// Returns true if the bar is not shown.
    pub fn is_hidden(&self) -> bool {
        self.0.is_hidden()
    }

    /// Starts to count towards `all`.
    pub fn start(&self, all: u64) {
        self.0.set_length(all);
        self.0.reset_elapsed();
    }

    /// Shows how many are done, and a message.
    pub fn show(&self, done: u64, message: &str) {
        self.0.set_message(message.to_owned());
        self.0.set_position(done);
    }

    /// Counts one more.
    pub fn advance(&self) {
        self.0.inc(1);
    }

    /// Removes the bar.
    pub fn end(self) {
        self.0.finish_and_clear();
    }
}

/// Returns the steps per second since the start; `None` in the first half second and before the first step.
fn steps_per_second(state: &ProgressState) -> Option<f64> {
    let seconds = state.elapsed().as_secs_f64();
    (seconds > 0.5 && state.pos() > 0).then(|| state.pos() as f64 / seconds)
}
