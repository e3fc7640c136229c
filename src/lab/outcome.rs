//! What a run says of its samples at its end.

use crate::numbers::HumanCount;
use gelsim_dataset::generate::RunSummary;
use gelsim_files::diagnostic::{Diagnostic, Diagnostics, Report};

/// What to do about a run that [`explain_hopeless_run`] describes.
pub const HOPELESS_RUN_HELP: &str = "health.reason in their labels says why; gelsim plan shows what the job does";

/// Returns why a run was in vain, if none of its samples is healthy, nor of those that were there already. What it wrote
/// stays.
pub fn explain_hopeless_run(done: &RunSummary) -> Option<String> {
    match done.samples + done.samples_there {
        samples if samples == 0 || done.unhealthy + done.unhealthy_there < samples => None,
        1 => Some(String::from("the sample is not healthy")),
        samples => Some(format!("none of the {} samples is healthy", HumanCount(samples))),
    }
}

/// Returns what a run tells of its samples. `no_contact` is the fraction of them that is meant to touch nothing; `None`
/// if a warning before the run has said that more of them may.
pub fn note_outcome(done: &RunSummary, no_contact: Option<f64>) -> Report {
    let mut notes = Diagnostics::default();
    notes.extend(no_contact.and_then(|no_contact| warn_of_misses(done, no_contact)));
    notes.extend(note_unmeasured_light(done));
    Report::new(&notes, &[])
}

/// Warns of samples without contact: if there are more than the job means to have, by a fifth of all and two standard
/// deviations of their number.
fn warn_of_misses(done: &RunSummary, no_contact: f64) -> Option<Diagnostic> {
    let samples = done.samples as f64;
    let (meant, spread) = (no_contact * samples, (no_contact * (1.0 - no_contact) * samples).sqrt());
    let missed = done.samples - done.in_contact;
    (missed as f64 > meant + 0.2 * samples + 2.0 * spread).then(|| {
        let message = format!(
            "{} of {} samples touch nothing, where indentation.no_contact = {no_contact} means {}",
            HumanCount(missed),
            HumanCount(done.samples),
            HumanCount(meant.round() as u64),
        );
        Diagnostic::warning(message).help("gelsim plan says what brings them into contact, if anything does")
    })
}

/// Returns a note if samples use light outside the calibrated range.
fn note_unmeasured_light(done: &RunSummary) -> Option<Diagnostic> {
    done.light.note().map(|note| {
        Diagnostic::note(note)
            .help("leave such samples out by numerics.light_outside_range in their labels, or press less deep")
    })
}
