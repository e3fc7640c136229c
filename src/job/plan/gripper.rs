//! The ranges of `[gripper]`, what may not stand beside it, and the right finger's sensor.

use super::check::Check;
use super::sensors::support;
use super::{OtherSensor, Scope, chosen_models, fill, gel, ranges};
use crate::core::gelpad;
use crate::files::diagnostic::Diagnostics;
use crate::job::config::Job;
use crate::job::config::document::Document;
use crate::job::config::gripper::Gripper;
use crate::job::config::output::Container;
use crate::job::config::scene::At;

/// `[gripper]`, and what stands beside it. `right` is the job of the right finger, where that has a sensor of its own; the
/// thickness of gelpads is only sure if `sensor_known`.
pub fn check(check: &mut Check<'_>, job: &Job, gripper: &Gripper, right: Option<&Job>, sensor_known: bool) {
    if job.sequence.is_some() {
        let message = "a gripper's samples are single grips: sequences of two fingers are not simulated";
        check.error("sequence", message, "leave [sequence] out, or leave [gripper] out");
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
        let help = "name a level, such as fidelity = \"standard\"";
        check.error("fidelity", "the level of a gripper is not chosen by an error or a time", help);
    }
    if job.output.container == Container::Folder {
        let message = "a row of metadata.jsonl has one tactile image, and a grip has two";
        check.error("output.container", message, "leave it out: a tar holds both fingers");
    }
    finger(check, job);

    let written: Vec<&str> =
        gripper.closings().into_iter().filter_map(|(key, quantity)| quantity.as_ref().map(|_| key)).collect();
    match written.as_slice() {
        [] => {
            check.missing("gripper.width_mm", "for example force_n = [1.0, 5.0], squeeze_mm = 1.0 or width_mm = 20.0")
        }
        [_] => {}
        [first, others @ ..] => {
            for other in others {
                let message = format!("both `{first}` and `{other}` say how far the fingers close");
                check.error(&format!("gripper.{other}"), message, "keep one of them");
            }
        }
    }
    if let Some(width) = &gripper.width_mm {
        check.quantity("gripper.width_mm", width, 0.0..=1e4, "mm");
    }
    if let Some(force) = &gripper.force_n {
        check.quantity("gripper.force_n", force, 1e-6..=1e6, "N");
    }
    if let Some(squeeze) = &gripper.squeeze_mm {
        let thinnest = |job: &Job| support(job, "gelpad_thickness_mm", job.sensor.gelpad_thickness_mm)[0];
        let both = thinnest(job) + thinnest(right.unwrap_or(job));
        let known = sensor_known && check.sound("sensor.gelpad_thickness_mm") && check.sound("gripper.right");
        let most = if known && check.sound("sensor.unit") { both } else { 2e3 };
        check.quantity("gripper.squeeze_mm", squeeze, 0.0..=most, "mm, the thicknesses of both gelpads");
        if squeeze.support().1 == most && check.sound("gripper.squeeze_mm") {
            let message = format!("squeeze_mm may be {most}, which presses both pads flat to their shells");
            check.error("gripper.squeeze_mm", message, format!("stay below {most} mm"));
        }
    }
}

/// What a finger must be.
fn finger(check: &mut Check<'_>, job: &Job) {
    let model = chosen_models(job).gelpad;
    if !matches!(model, gelpad::Model::Elastic(_)) {
        let message =
            format!("the gelpad model `{}` knows no force, by which two fingers hold an object", model.name());
        let key = if check.document.get("gelpad").is_some() { "gelpad" } else { "fidelity" };
        check.error(key, message, "choose fidelity = \"draft\" or better, or gelpad.elastic");
    }
    if job.sensor.shape.is_some() {
        let message = format!("the gel of `{}` has a shape: a gripper's fingers are flat sensors", job.sensor.name);
        check.error("sensor.shape", message, "take flat sensors, or press with one finger, without [gripper]");
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
        check.error("sensor", message, "a job has one model of the light: name one that both sensors have in `optics`");
    }
    finger(&mut check, &job);
    ranges::models(&mut check, &job);
    OtherSensor::checked(scope, job, check)
}
