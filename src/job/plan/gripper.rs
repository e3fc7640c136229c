//! The ranges of `[gripper]`, what may not stand beside it, and the right finger's sensor.

use super::check::Check;
use super::presets::OtherSensor;
use super::{Scope, chosen_models, fill, gel, ranges, remedies};
use crate::config::Job;
use crate::config::document::Document;
use crate::config::gripper::Gripper;
use crate::config::output::Container;
use crate::config::scene::At;
use crate::config::sequence::Sequence;
use gelsim_core::gelpad;
use gelsim_core::gelpad::USUAL_DEPTHS;
use gelsim_files::diagnostic::Diagnostics;
use gelsim_files::figures::figure;
use gelsim_files::sensor::quantity::Quantity;

/// `[gripper]`, and what stands beside it. `right` is the job of the right finger, where that has a sensor of its own; the
/// thickness of gelpads is only sure if `sensor_known`.
pub fn check(check: &mut Check<'_>, job: &Job, gripper: &Gripper, right: Option<&Job>, sensor_known: bool) {
    if let Some(sequence) = &job.sequence {
        finger(check, job);
        phases(check, job, sequence, right, sensor_known);
        for (key, _) in gripper.closings().into_iter().filter(|(_, closing)| closing.is_some()) {
            let help = format!("leave it out: each [[sequence.phase]] may have {key}");
            check.error(&format!("gripper.{key}"), "the phases of a sequence say how far the fingers close", help);
        }
        folder(check, job);
        return;
    }
    if job.indentation.depth_mm.is_some() {
        let help = "leave it out: squeeze_mm under [gripper] is the depth of both fingers together";
        check.error("indentation.depth_mm", "a gripper's width or force says how deep each finger is pressed", help);
    }
    if job.indentation.at != At::Lowest {
        let help = "leave it out: an object is held where both fingers press it equally";
        check.error("indentation.at", "a gripper's width or force says how deep each finger is pressed", help);
    }
    check.number("indentation.no_contact", job.indentation.no_contact, 0.0..=1.0, "");
    if job.fidelity.is_some_and(|fidelity| fidelity.level().is_none()) {
        let help = "name a level: fidelity = \"standard\"";
        check.error("fidelity", "the level of a gripper is not chosen by an error or a time", help);
    }
    folder(check, job);
    finger(check, job);

    if !one_of(check, &gripper.closings(), |key| format!("gripper.{key}")) {
        let both_mm = thicknesses(check, job, right, sensor_known).unwrap_or(8.0);
        let [low, high] = USUAL_DEPTHS.map(|share| figure(share * both_mm));
        let help = format!(
            "for example force_n = [0.5, 2.0]; or squeeze_mm = [{low}, {high}]; or width_mm, a little less than the object is wide"
        );
        check.missing("gripper.force_n", &help);
    }
    if let Some(width) = &gripper.width_mm {
        check.quantity("gripper.width_mm", width, 0.0..=1e4, "mm");
    }
    if let Some(force) = &gripper.force_n {
        check.quantity("gripper.force_n", force, 1e-6..=1e6, "N");
    }
    if let Some(squeeze) = &gripper.squeeze_mm {
        squeezed(check, "gripper.squeeze_mm", squeeze, 0.0, thicknesses(check, job, right, sensor_known));
    }
}

/// The phases of a sequence of a gripper, beyond what those of any sequence are.
fn phases(check: &mut Check<'_>, job: &Job, sequence: &Sequence, right: Option<&Job>, sensor_known: bool) {
    let most_mm = thicknesses(check, job, right, sensor_known);
    for (k, phase) in sequence.phase.iter().enumerate() {
        let path = |key: &str| format!("sequence.phase.{k}.{key}");
        if phase.depth_mm.is_some() {
            let help = "write squeeze_mm, the depth of both fingers together, width_mm or force_n";
            check.error(&path("depth_mm"), "a gripper's fingers are pressed equally, whatever their depths", help);
        }
        if phase.tilt_deg.support() != (0.0, 0.0) {
            let message = "an object between two fingers does not roll over one of them";
            check.error(&path("tilt_deg"), message, "leave it out");
        }
        let closings = [("force_n", &phase.force_n), ("width_mm", &phase.width_mm), ("squeeze_mm", &phase.squeeze_mm)];
        one_of(check, &closings, |key| path(key));
        if let Some(width) = &phase.width_mm {
            check.quantity(&path("width_mm"), width, 0.0..=1e4, "mm");
        }
        if let Some(squeeze) = &phase.squeeze_mm {
            squeezed(check, &path("squeeze_mm"), squeeze, -1e3, most_mm);
        }
    }
}

/// Refuses all but the first of what was written of the keys that say how far fingers close; true if one was.
fn one_of(check: &mut Check<'_>, closings: &[(&str, &Option<Quantity>)], path: impl Fn(&str) -> String) -> bool {
    let mut written = closings.iter().filter(|(_, closing)| closing.is_some()).map(|(key, _)| *key);
    let Some(first) = written.next() else { return false };
    for other in written {
        let message = format!("both `{first}` and `{other}` say how far the fingers close");
        check.error(&path(other), message, "keep one of them");
    }
    true
}

/// The thicknesses of both gelpads together, the smallest that may be drawn, mm; `None` where they are not known.
fn thicknesses(check: &Check<'_>, job: &Job, right: Option<&Job>, sensor_known: bool) -> Option<f64> {
    let sound = ["sensor.gelpad_thickness_mm", "sensor.unit", "gripper.right"].iter().all(|path| check.sound(path));
    (sensor_known && sound).then(|| remedies::thinnest_mm(job) + remedies::thinnest_mm(right.unwrap_or(job)))
}

fn squeezed(check: &mut Check<'_>, path: &str, squeeze: &Quantity, least_mm: f64, most_mm: Option<f64>) {
    match most_mm {
        Some(most_mm) => check.depth(path, squeeze, least_mm, most_mm, "both gelpads together are as thick as"),
        None => check.quantity(path, squeeze, least_mm..=2e3, "mm"),
    }
}

fn folder(check: &mut Check<'_>, job: &Job) {
    if job.output.container == Container::Folder {
        let message = "a row of metadata.jsonl has one tactile image, and a grip has two";
        check.error("output.container", message, "leave it out: a tar holds both fingers");
    }
}

/// What a finger must be.
fn finger(check: &mut Check<'_>, job: &Job) {
    let model = chosen_models(job).gelpad;
    if !matches!(model, gelpad::Model::Elastic(_)) {
        let message =
            format!("the gelpad model `{}` knows no force, by which two fingers hold an object", model.name());
        let key = if check.document.get("gelpad").is_some() { "gelpad" } else { "fidelity" };
        check.error(key, message, remedies::solving_gelpad(check.document));
    }
    if job.sensor.shape.is_some() {
        let message = format!("the gel of `{}` has a shape: a gripper's fingers are flat sensors", job.sensor.name);
        let help = format!(
            "take flat sensors, such as preset = \"digit\"; or press with one finger: {}",
            remedies::single_presses(job, "[gripper]")
        );
        check.error("sensor.shape", message, help);
    }
}

/// The sensor of the right finger; what is wrong with it goes to `problems`.
pub(super) fn right_finger(
    scope: Scope,
    left: &Job,
    (mut job, document): (Job, Document),
    problems: &mut Diagnostics,
) -> Option<OtherSensor> {
    let mut check = Check { document: &document, problems };
    fill(&mut job);
    gel::read(&mut check, &mut job.sensor);
    let models = [left, &job].map(|job| chosen_models(job).optics.name());
    if models[0] != models[1] {
        let message = format!(
            "the light of `{}` is `{}`, that of `{}` is `{}`",
            left.sensor.name, models[0], job.sensor.name, models[1]
        );
        let help = match models.contains(&"lamps") {
            true => "take two sensors with LEDs, or twice the same: leave [gripper.right] out",
            false => "a job has one model of the light: write optics = \"phong\", which every sensor with LEDs has",
        };
        check.error("sensor", message, help);
    }
    finger(&mut check, &job);
    ranges::models(&mut check, &job);
    OtherSensor::checked(scope, job, check)
}
