//! The bar, where the command is built with one.

use std::io::IsTerminal;

use indicatif::{ProgressBar, ProgressDrawTarget, ProgressState, ProgressStyle};

/// A bar on standard error.
pub struct Bar(ProgressBar);

impl Bar {
    /// One of samples that is shown if it is `wanted` and there is a terminal.
    pub fn new(wanted: bool) -> Self {
        Self::of(wanted, "{bar:32} {human_pos}/{human_len} samples  {msg}  {rate}  {eta} left")
    }

    /// The same of thousandths of some work.
    pub fn thousandths(wanted: bool) -> Self {
        let bar = Self::of(wanted, "{bar:32} {percent:>3} %  {msg}");
        bar.start(1000);
        bar
    }

    fn of(wanted: bool, template: &str) -> Self {
        let visible = wanted && std::io::stderr().is_terminal();
        let target = if visible { ProgressDrawTarget::stderr() } else { ProgressDrawTarget::hidden() };
        let style = ProgressStyle::with_template(template).unwrap_or(ProgressStyle::default_bar()).with_key(
            "rate",
            |state: &ProgressState, out: &mut dyn std::fmt::Write| {
                // What cannot be written to the terminal is only not seen.
                let _ = write!(out, "{:.0} samples/s", state.per_sec());
            },
        );
        Self(ProgressBar::with_draw_target(None, target).with_style(style))
    }

    /// True if nobody sees it.
    pub fn is_hidden(&self) -> bool {
        self.0.is_hidden()
    }

    /// Starts to count towards `samples`.
    pub fn start(&self, samples: u64) {
        self.0.set_length(samples);
        self.0.reset_elapsed();
    }

    /// Shows how many there are, and what else is to be said.
    pub fn show(&self, done: u64, message: String) {
        self.0.set_message(message);
        self.0.set_position(done);
    }

    /// Clears it.
    pub fn end(self) {
        self.0.finish_and_clear();
    }
}
