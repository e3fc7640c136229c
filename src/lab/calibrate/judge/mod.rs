//! Checks whether presses, their table and the fit as a whole can be right, which no single press tells.
//!
//! Before the fit: units ([`scale`]), background against presses ([`background`]), circles against what changed
//! ([`circles`]). After it: whether it explains what presses change ([`fit`]). Every threshold lies between the values
//! of real sensors and those of the same presses with one thing wrong (tests/reality/judge.rs prints both).

use super::Session;
use gelsim_files::diagnostic::{Diagnostic, Severity};

pub mod background;
pub mod circles;
pub mod fit;
pub mod scale;

/// Judges background and circles together: misplaced circles make a background look touched, and a background in
/// another order makes circles look empty.
pub fn judge_images(session: &Session) -> Vec<Diagnostic> {
    let of_background = background::assess_background(session);
    let is_changed = of_background.compared.as_ref().is_some_and(|found| !found.found.is_nothing());
    let matched = is_changed.then(|| background::match_background(session.clone()).0);
    let circles = circles::judge_circles(matched.as_ref().unwrap_or(session));
    let are_elsewhere = circles.iter().any(|found| found.severity == Severity::Error);
    let kept = |found: &background::BackgroundFinding| !(are_elsewhere && found.depends_on_circles);
    let of_background = of_background.findings.into_iter().filter(kept).map(|found| found.diagnostic);
    of_background.chain(circles).collect()
}

/// Findings, the likely causes first.
#[derive(Clone, Debug, Default)]
pub struct Findings(pub Vec<Diagnostic>);

impl Findings {
    /// Returns true if something is so wrong that the result would be useless.
    pub fn are_hopeless(&self) -> bool {
        self.0.iter().any(|found| found.severity == Severity::Error)
    }

    /// Turns errors into warnings, for users who want a result nevertheless.
    pub fn into_warnings(self) -> Self {
        let as_warning = |found: Diagnostic| match found.severity {
            Severity::Error => Diagnostic { severity: Severity::Warning, ..found },
            _ => found,
        };
        Self(self.0.into_iter().map(as_warning).collect())
    }

    /// Adds findings.
    pub fn extend(&mut self, more: impl IntoIterator<Item = Diagnostic>) {
        self.0.extend(more);
    }
}
