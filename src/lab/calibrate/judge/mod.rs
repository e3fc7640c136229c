//! Whether presses, their table and the fit as a whole can be right: what no single press says.
//!
//! Before the fit: units ([`scale`]), background against presses ([`background`]), circles against what changed
//! ([`circles`]). After it: whether it explains what presses change ([`fit`]). Every threshold stands between what real
//! sensors have and what the same presses have when one thing about them is wrong (tests/reality/judge.rs prints both).

use super::Session;
use gelsim_files::diagnostic::{Diagnostic, Severity};

pub mod background;
pub mod circles;
pub mod fit;
pub mod scale;

/// What speaks against background and circles, which are looked at together: circles that are elsewhere make a background look
/// touched, and a background in another order makes circles look empty.
pub fn images(session: &Session) -> Vec<Diagnostic> {
    let of_background = background::look(session);
    let is_changed = of_background.compared.as_ref().is_some_and(|found| !found.found.is_nothing());
    let matched = is_changed.then(|| background::matched(session.clone()).0);
    let circles = circles::findings(matched.as_ref().unwrap_or(session));
    let are_elsewhere = circles.iter().any(|found| found.severity == Severity::Error);
    let kept = |found: &background::Finding| !(are_elsewhere && found.depends_on_circles);
    let of_background = of_background.findings.into_iter().filter(kept).map(|found| found.diagnostic);
    of_background.chain(circles).collect()
}

/// What was found, the likely causes first.
#[derive(Clone, Debug, Default)]
pub struct Findings(pub Vec<Diagnostic>);

impl Findings {
    /// True if something is so wrong that a result would be none.
    pub fn are_hopeless(&self) -> bool {
        self.0.iter().any(|found| found.severity == Severity::Error)
    }

    /// The same as warnings, for those who want a result all the same.
    pub fn forgiven(self) -> Self {
        let as_warning = |found: Diagnostic| match found.severity {
            Severity::Error => Diagnostic { severity: Severity::Warning, ..found },
            _ => found,
        };
        Self(self.0.into_iter().map(as_warning).collect())
    }

    /// Adds what was found elsewhere.
    pub fn extend(&mut self, more: impl IntoIterator<Item = Diagnostic>) {
        self.0.extend(more);
    }
}
