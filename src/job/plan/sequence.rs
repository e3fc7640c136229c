//! Checks the ranges of `[sequence]`, and what may not stand beside it.

use super::check::JobChecker;
use super::sensors::number_support;
use super::{chosen_models, remedies};
use crate::config::Job;
use crate::config::scene::At;
use crate::config::sequence::{Sequence, SequenceFriction};
use gelsim_core::gelpad;
use gelsim_core::gelpad::USUAL_DEPTHS;
use gelsim_files::number_format::{format_number, round_bound};

/// Most frames of a sequence, since four digits number them.
const MAX_FRAMES: f64 = 10_000.0;

/// Most phases of a sequence.
const MAX_PHASES: usize = 1000;

/// Checks `[sequence]` and what stands beside it. The pad's thickness is known only if `sensor_known`.
pub fn check_sequence(check: &mut JobChecker<'_>, job: &Job, sequence: &Sequence, sensor_known: bool) {
    for (key, given) in [("depth_mm", &job.indentation.depth_mm), ("force_n", &job.indentation.force_n)] {
        let help = match job.gripper {
            None => "leave it out: each [[sequence.phase]] says depth_mm or force_n",
            Some(_) => "leave it out: each [[sequence.phase]] says squeeze_mm, width_mm or force_n",
        };
        if given.is_some() {
            let message = "the phases of a sequence say how deep the object is";
            check.report_error(&format!("indentation.{key}"), message, help);
        }
    }
    if job.indentation.at != At::Lowest {
        let help = match job.gripper {
            None => "leave it out: a phase's depth_mm is that of the object's lowest point",
            Some(_) => "leave it out: an object is held where both fingers press it equally",
        };
        check.report_error("indentation.at", "the phases of a sequence say how deep the object is", help);
    }
    if job.indentation.no_contact != 0.0 {
        let help = match job.gripper {
            None => "leave it out: a phase may end above the pad, depth_mm = -0.1",
            Some(_) => "leave it out: a phase may end beside the object, squeeze_mm = -0.2",
        };
        check.report_error("indentation.no_contact", "the phases of a sequence say whether the object touches", help);
    }
    if job.shear.has_motion() {
        let help = "leave [shear] out: each [[sequence.phase]] has x_mm, y_mm and twist_deg";
        check.report_error("shear", "the phases of a sequence move the object", help);
    }
    match chosen_models(job).gelpad {
        gelpad::Model::Elastic(elastic) if elastic.friction.is_some() => {
            let help = "leave it out: [sequence] friction holds while the object is pressed in, too";
            check.report_error("gelpad.elastic.friction", "a sequence has a friction of its own", help);
        }
        model if model.knows_tractions() => {}
        model => {
            let message =
                format!("the gelpad model `{}` knows no tractions, which a sequence carries on", model.name());
            let key = if check.document.get("gelpad").is_some() { "gelpad" } else { "fidelity" };
            check.report_error(key, message, remedies::suggest_solving_gelpad(check.document));
        }
    }
    if job.fidelity.is_some_and(|fidelity| fidelity.level().is_none()) {
        let help = "name a level: fidelity = \"standard\"";
        check.report_error("fidelity", "the level of a sequence is not chosen by an error or a time", help);
    }
    let rate = sequence.frame_rate_hz;
    check.require_in_range("sequence.frame_rate_hz", rate, 1e-3..=1e4, "Hz");
    if let SequenceFriction::Coefficient(coefficient) = &sequence.friction {
        check.require_quantity_in_range("sequence.friction.coefficient", coefficient, 0.0..=10.0, "");
    }
    if sequence.phase.is_empty() {
        let [_, deep] = USUAL_DEPTHS.map(|share| format_number(share * remedies::min_thickness_mm(job)));
        let depth = match job.gripper {
            None => format!("depth_mm = {deep}"),
            Some(_) => String::from("force_n = 1.0"),
        };
        let help = format!("for example [[sequence.phase]] with name = \"press\", duration_s = 0.4 and {depth}");
        check.report_missing("sequence.phase", &help);
    }
    if sequence.phase.len() > MAX_PHASES {
        let message = format!("{} phases are too many", sequence.phase.len());
        check.report_error("sequence.phase", message, format!("allowed: up to {MAX_PHASES}"));
    }
    let [thickness, _] = number_support(job, "gelpad_thickness_mm", job.sensor.gelpad_thickness_mm);
    let known = sensor_known && check.is_valid("sensor.gelpad_thickness_mm") && check.is_valid("sensor.unit");
    for (k, phase) in sequence.phase.iter().enumerate().take(MAX_PHASES) {
        let path = |key: &str| format!("sequence.phase.{k}.{key}");
        match &phase.name {
            None if check.document.get(&path("name")).is_none() && !check.is_misspelt(&path("name")) => {
                let message = format!("missing key `name` in [[sequence.phase]] number {}", k + 1);
                check.report_grouped_error(
                    &path("name"),
                    "phases have no `name`",
                    message,
                    "for example name = \"press\"",
                );
            }
            None => {}
            Some(name) if name.is_empty() => {
                check.report_error(&path("name"), "the phase's name is empty", "for example name = \"press\"");
            }
            Some(_) => {}
        }
        check.require_quantity_in_range(&path("duration_s"), &phase.duration_s, 0.0..=3600.0, "s");
        if let Some(depth) = &phase.depth_mm {
            match known {
                true => {
                    check.require_depth_in_range(&path("depth_mm"), depth, -1e3, thickness, "the gelpad is as thick as")
                }
                // Without the thickness, only a general limit holds.
                false => check.require_quantity_in_range(&path("depth_mm"), depth, -1e3..=1e3, "mm"),
            }
        }
        if let Some(force) = &phase.force_n {
            check.require_quantity_in_range(&path("force_n"), force, 1e-6..=1e6, "N");
            if phase.depth_mm.is_some() {
                check.report_error(&path("force_n"), "both `depth_mm` and `force_n` say how deep", "keep one of them");
            }
        }
        for (key, closing) in [("width_mm", &phase.width_mm), ("squeeze_mm", &phase.squeeze_mm)] {
            if closing.is_some() && job.gripper.is_none() {
                let message = format!("`{key}` is of two fingers, and this job has one");
                check.report_error(&path(key), message, "write depth_mm or force_n in its place");
            }
        }
        check.require_quantity_in_range(&path("x_mm"), &phase.x_mm, -1e3..=1e3, "mm");
        check.require_quantity_in_range(&path("y_mm"), &phase.y_mm, -1e3..=1e3, "mm");
        check.require_quantity_in_range(&path("twist_deg"), &phase.twist_deg, -3600.0..=3600.0, "degrees");
        check.require_quantity_in_range(&path("tilt_deg"), &phase.tilt_deg, -90.0..=90.0, "degrees");
        check.require_quantity_in_range(
            &path("tilt_azimuth_deg"),
            &phase.tilt_azimuth_deg,
            -3600.0..=3600.0,
            "degrees",
        );
    }
    let longest: f64 = sequence.phase.iter().map(|phase| phase.duration_s.support().1).sum();
    if longest * rate > MAX_FRAMES && check.is_valid("sequence") {
        let message = format!("a sequence may have {:.0} frames", longest * rate);
        check.report_error(
            "sequence.phase",
            message,
            format!(
                "allowed: up to {MAX_FRAMES}; write frame_rate_hz = {}, or shorten phases",
                round_bound(MAX_FRAMES / longest, true)
            ),
        );
    }
}
