//! Checks what a job may not have beside a gelpad model that solves finite strain.

use super::check::JobChecker;
use super::{Plan, Scope, chosen_models};
use crate::config::Job;
use crate::layers::OutputLayer;
use gelsim_core::fidelity::Fidelity;
use gelsim_core::gelpad;
use gelsim_core::gelpad::elastic::shear::Friction;

/// Checks a job whose gelpad model solves finite strain: only single presses into flat pads are.
pub fn check_strain(check: &mut JobChecker<'_>, job: &Job, scope: Scope) {
    let model = chosen_models(job).gelpad;
    if model.strain_settings().is_none() {
        return;
    }
    // The frames of a simulator are a sequence only if the command line says so, which reports it.
    let is_sequence = job.sequence.is_some() && scope != Scope::Frames;
    let refused = [
        (job.gripper.is_some(), "gripper", "a gripper's two fingers"),
        (is_sequence, "sequence", "the frames of a sequence"),
        (job.sensor.shape.is_some(), "sensor.shape", "a gel that has a shape"),
    ];
    // One of them is enough to choose another model.
    if let Some((_, path, what)) = refused.into_iter().find(|(refused, ..)| *refused) {
        let (message, help) = describe_refusal(check, &model, what);
        let keys = ["gelpad.elastic.strain_correction", "gelpad", "fidelity"];
        let written = keys.into_iter().find(|key| check.document.get(key).is_some());
        check.report_error(written.unwrap_or(path), message, help);
    }
    if let Some(index) = job.output.layers.iter().position(|layer| *layer == OutputLayer::Traction)
        && model.friction() == Some(Friction::Stick)
    {
        let message = "the tractions of a pad that sticks at finite strain are not known";
        check.report_error(&format!("output.layers.{index}"), message, "leave `traction` out, or take a linear pad");
    }
    if let Some(Friction::Coulomb { .. }) = model.friction() {
        let path = format!("gelpad.{}.friction", model.name());
        let message = "at finite strain the pad sticks or slides freely: Coulomb friction is not simulated";
        let help = match &model {
            gelpad::Model::Elastic(_) => "leave strain_correction out, or write friction = \"stick\"",
            _ => "write friction = \"stick\"; or take the model elastic, which knows Coulomb friction",
        };
        check.report_error(&path, message, help);
    }
}

impl Plan {
    /// Returns true if the samples of the job can be simulated at a level: one that solves finite strain knows single
    /// presses into flat pads, without Coulomb friction.
    pub fn allows_level(&self, level: Fidelity) -> bool {
        let Job { sequence, gripper, object, sensor, .. } = &self.job;
        let friction = self.simulator.models().gelpad.friction();
        let slips = matches!(friction, Some(Friction::Coulomb { .. }))
            || friction.is_some() && object.iter().any(|object| object.friction.is_some());
        let fits = sequence.is_none() && gripper.is_none() && sensor.shape.is_none() && !slips;
        let unknown = friction.is_some() && self.job.output.layers.contains(&OutputLayer::Traction);
        let is_linear = level.models(sensor.light_source()).gelpad.strain_settings().is_none();
        is_linear || fits && !unknown && self.other_sensors.iter().all(|other| other.allows_level(level))
    }
}

/// Returns the message that finite strain is not solved for `what`, and what to do.
fn describe_refusal(check: &JobChecker<'_>, model: &gelpad::Model, what: &str) -> (String, &'static str) {
    match model {
        gelpad::Model::Elastic(_) => {
            (format!("`strain_correction` is for single presses into a flat pad, not for {what}"), "leave it out")
        }
        _ if check.document.get("gelpad").is_some() => (
            format!("the gelpad model `{}` is for single presses into a flat pad, not for {what}", model.name()),
            "write gelpad = \"elastic\" in place of the model",
        ),
        _ => (
            format!("the fidelity level finite-strain is for single presses into a flat pad, not for {what}"),
            "use fidelity = \"high\"",
        ),
    }
}
