//! Checks `[gripper]`, what may not stand beside it, and the right finger's sensor.

use super::check::JobChecker;
use super::presets::OtherSensor;
use super::{Scope, chosen_models, fill_defaults, gel, ranges, remedies};
use crate::config::Job;
use crate::config::document::Document;
use crate::config::gripper::Gripper;
use crate::config::output::Container;
use crate::config::scene::At;
use crate::config::sequence::Sequence;
use gelsim_core::gelpad::USUAL_DEPTHS;
use gelsim_files::diagnostic::Diagnostics;
use gelsim_files::number_format::format_number;
use gelsim_files::sensor::quantity::Quantity;

/// Checks `[gripper]` and what stands beside it. `right` is the job of the right finger if that has a sensor of its
/// own. The thickness of gelpads is known only if `sensor_known`.
pub fn check_gripper(
    check: &mut JobChecker<'_>,
    job: &Job,
    gripper: &Gripper,
    right: Option<&Job>,
    sensor_known: bool,
) {
    if let Some(sequence) = &job.sequence {
        check_finger(check, job);
        check_grip_phases(check, job, sequence, right, sensor_known);
        for (key, _) in gripper.closings().into_iter().filter(|(_, closing)| closing.is_some()) {
            let help = format!("leave it out: each [[sequence.phase]] may have {key}");
            check.report_error(
                &format!("gripper.{key}"),
                "the phases of a sequence say how far the fingers close",
                help,
            );
        }
        refuse_folder_container(check, job);
        return;
    }
    for (key, given) in [("depth_mm", &job.indentation.depth_mm), ("force_n", &job.indentation.force_n)] {
        if given.is_some() {
            let help = match key {
                "depth_mm" => "leave it out: squeeze_mm under [gripper] is the depth of both fingers together",
                _ => "leave it out: force_n under [gripper] is the force of each finger",
            };
            let message = "a gripper's width or force says how deep each finger is pressed";
            check.report_error(&format!("indentation.{key}"), message, help);
        }
    }
    if job.indentation.at != At::Lowest {
        let help = "leave it out: an object is held where both fingers press it equally";
        check.report_error("indentation.at", "a gripper's width or force says how deep each finger is pressed", help);
    }
    check.require_in_range("indentation.no_contact", job.indentation.no_contact, 0.0..=1.0, "");
    if job.fidelity.is_some_and(|fidelity| fidelity.level().is_none()) {
        let help = "name a level: fidelity = \"standard\"";
        check.report_error("fidelity", "the level of a gripper is not chosen by an error or a time", help);
    }
    refuse_folder_container(check, job);
    check_finger(check, job);

    if !require_one_closing(check, &gripper.closings(), |key| format!("gripper.{key}")) {
        let both_mm = total_thickness_mm(check, job, right, sensor_known).unwrap_or(8.0);
        let [low, high] = USUAL_DEPTHS.map(|share| format_number(share * both_mm));
        let help = format!(
            "for example force_n = [0.5, 2.0]; or squeeze_mm = [{low}, {high}]; or width_mm, a little less than the object is wide"
        );
        check.report_missing("gripper.force_n", &help);
    }
    if let Some(width) = &gripper.width_mm {
        check.require_quantity_in_range("gripper.width_mm", width, 0.0..=1e4, "mm");
    }
    if let Some(force) = &gripper.force_n {
        check.require_quantity_in_range("gripper.force_n", force, 1e-6..=1e6, "N");
    }
    if let Some(squeeze) = &gripper.squeeze_mm {
        check_squeeze(check, "gripper.squeeze_mm", squeeze, 0.0, total_thickness_mm(check, job, right, sensor_known));
    }
}

/// Checks the phases of a sequence of grips for what is special to them.
fn check_grip_phases(
    check: &mut JobChecker<'_>,
    job: &Job,
    sequence: &Sequence,
    right: Option<&Job>,
    sensor_known: bool,
) {
    let most_mm = total_thickness_mm(check, job, right, sensor_known);
    for (k, phase) in sequence.phase.iter().enumerate() {
        let path = |key: &str| format!("sequence.phase.{k}.{key}");
        if phase.depth_mm.is_some() {
            let help = "write squeeze_mm, the depth of both fingers together, width_mm or force_n";
            check.report_error(
                &path("depth_mm"),
                "a gripper's fingers are pressed equally, whatever their depths",
                help,
            );
        }
        if phase.tilt_deg.support() != (0.0, 0.0) {
            let message = "an object between two fingers does not roll over one of them";
            check.report_error(&path("tilt_deg"), message, "leave it out");
        }
        let closings = [("force_n", &phase.force_n), ("width_mm", &phase.width_mm), ("squeeze_mm", &phase.squeeze_mm)];
        require_one_closing(check, &closings, |key| path(key));
        if let Some(width) = &phase.width_mm {
            check.require_quantity_in_range(&path("width_mm"), width, 0.0..=1e4, "mm");
        }
        if let Some(squeeze) = &phase.squeeze_mm {
            check_squeeze(check, &path("squeeze_mm"), squeeze, -1e3, most_mm);
        }
    }
}

/// Refuses all but the first of those keys that say how far the fingers close. Returns true if there is one.
fn require_one_closing(
    check: &mut JobChecker<'_>,
    closings: &[(&str, &Option<Quantity>)],
    path: impl Fn(&str) -> String,
) -> bool {
    let mut written = closings.iter().filter(|(_, closing)| closing.is_some()).map(|(key, _)| *key);
    let Some(first) = written.next() else { return false };
    for other in written {
        let message = format!("both `{first}` and `{other}` say how far the fingers close");
        check.report_error(&path(other), message, "keep one of them");
    }
    true
}

/// Returns the smallest sum of the thicknesses of both gelpads that may be drawn, mm; `None` if they are not known.
fn total_thickness_mm(check: &JobChecker<'_>, job: &Job, right: Option<&Job>, sensor_known: bool) -> Option<f64> {
    let valid = ["sensor.gelpad_thickness_mm", "sensor.unit", "gripper.right"].iter().all(|path| check.is_valid(path));
    (sensor_known && valid).then(|| remedies::min_thickness_mm(job) + remedies::min_thickness_mm(right.unwrap_or(job)))
}

fn check_squeeze(check: &mut JobChecker<'_>, path: &str, squeeze: &Quantity, least_mm: f64, most_mm: Option<f64>) {
    match most_mm {
        Some(most_mm) => {
            check.require_depth_in_range(path, squeeze, least_mm, most_mm, "both gelpads together are as thick as")
        }
        None => check.require_quantity_in_range(path, squeeze, least_mm..=2e3, "mm"),
    }
}

fn refuse_folder_container(check: &mut JobChecker<'_>, job: &Job) {
    if job.output.container == Container::Folder {
        let message = "a row of metadata.jsonl has one tactile image, and a grip has two";
        check.report_error("output.container", message, "leave it out: a tar holds both fingers");
    }
}

/// Checks that a sensor can be a gripper's finger: it is flat and its gelpad model has forces.
fn check_finger(check: &mut JobChecker<'_>, job: &Job) {
    let model = chosen_models(job).gelpad;
    if !model.knows_pressure() {
        let message =
            format!("the gelpad model `{}` knows no force, by which two fingers hold an object", model.name());
        let key = if check.document.get("gelpad").is_some() { "gelpad" } else { "fidelity" };
        check.report_error(key, message, remedies::suggest_solving_gelpad(check.document));
    }
    if job.sensor.shape.is_some() {
        let message = format!("the gel of `{}` has a shape: a gripper's fingers are flat sensors", job.sensor.name);
        let help = format!(
            "take flat sensors, such as preset = \"digit\"; or press with one finger: {}",
            remedies::suggest_single_presses(job, "[gripper]")
        );
        check.report_error("sensor.shape", message, help);
    }
}

/// Checks and builds the sensor of the right finger. Errors go to `problems`.
pub(super) fn resolve_right_finger(
    scope: Scope,
    left: &Job,
    (mut job, document): (Job, Document),
    problems: &mut Diagnostics,
) -> Option<OtherSensor> {
    let mut check = JobChecker { document: &document, problems };
    fill_defaults(&mut job);
    gel::read_gel_files(&mut check, &mut job);
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
        check.report_error("sensor", message, help);
    }
    check_finger(&mut check, &job);
    ranges::check_models(&mut check, &job);
    OtherSensor::check_and_build(scope, job, check)
}
