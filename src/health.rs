//! Whether a sample is sound, and what becomes of one that is not: kept, drawn again, or the end of the run.
//!
//! The check looks at what every sample promises: finite numbers, a surface between the pad's back and one thickness
//! above its front, and a solver that reached its tolerance. What a sensor legitimately does (clipped light, an object
//! deeper than the pad) is counted in the label and is no illness.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::camera::Image;
use crate::depth::Depth;
use crate::gelpad::Contact;
use crate::label::Label;
use crate::plan::Plan;
use crate::render::{Sample, attempt};
use crate::scene::{Pressed, Scene};

/// What a check of the sample found.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
pub struct Health {
    /// True if the sample is sound: finite, within bounds, its contact solved.
    pub healthy: bool,
    /// Why not; empty if it is.
    pub reason: String,
    /// True if every number computed for the sample is finite.
    pub finite: bool,
    /// Pixels with a channel below 0 or above full scale, cut when quantised.
    pub clipped_px: u64,
    /// Pixels with a channel at full scale.
    pub saturated_px: u64,
    /// Pixels where the object was limited to the pad's thickness.
    pub over_thickness_px: u64,
    /// Pixels of a depth frame that its camera could not see; 0 for a mesh.
    pub unseen_px: u64,
}

/// What becomes of an unhealthy sample.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum OnUnhealthy {
    /// It stays; its label says what is wrong.
    #[default]
    Keep,
    /// It is listed in the shard's stats, and the sample is drawn again, at most 100 times.
    Reject,
    /// The run stops.
    Fail,
}

/// Draws of one sample before the run gives up.
pub const MOST_ATTEMPTS: u32 = 100;

/// How far beyond the pad's back rounding and the solver's tolerance may take the surface, in thicknesses.
const SLACK: f32 = 1e-3;

/// How far a healthy surface may lie from the undeformed pad, and an object reach below it, mm.
pub fn bound_mm(thickness_mm: f64) -> f64 {
    thickness_mm * (1.0 + f64::from(SLACK))
}

impl Health {
    /// Checks a sample of a pad `thickness_mm` thick.
    pub fn check(scene: &Scene, image: &Image, depth: &Depth, contact: &Contact, thickness_mm: f64) -> Self {
        let finite = image.finite && contact.finite;
        let [lowest, highest] = contact.range_mm();
        let thickness = thickness_mm as f32;
        let bounded = lowest >= -thickness * (1.0 + SLACK) && highest <= thickness * (1.0 + SLACK);
        let numerics = &contact.numerics;
        let reason = match (finite, bounded, numerics.converged) {
            (false, ..) => String::from("not every number is finite"),
            (_, false, _) => format!("the surface lies between {lowest} and {highest} mm in a pad of {thickness} mm"),
            (.., false) => format!(
                "the contact is not solved: {:.3} um are left after {} iterations",
                numerics.residual_um.unwrap_or_default(),
                numerics.iterations
            ),
            _ => String::new(),
        };
        Self {
            healthy: reason.is_empty(),
            reason,
            finite,
            clipped_px: image.clipped_px,
            saturated_px: image.saturated_px,
            over_thickness_px: depth.over_thickness_px,
            unseen_px: match &scene.pressed {
                Pressed::Object(_) => 0,
                Pressed::Frame(frame) => frame.unseen_px,
            },
        }
    }
}

/// A sample that may go into the dataset, and the draws of it that may not.
pub struct Accepted {
    /// The sample.
    pub sample: Sample,
    /// What was drawn before it and rejected.
    pub rejected: Vec<Label>,
}

/// A sample of which no draw may go into the dataset: the label of the last one.
#[derive(Debug)]
pub struct Unfit(pub Box<Label>);

/// Sample `index` as a dataset would have it; its first draw if no draw may go into one.
pub fn shown(plan: &Plan, index: u64) -> Sample {
    accept(plan, index).map_or_else(|_| attempt(plan, index, 0), |accepted| accepted.sample)
}

/// Renders sample `index`, again and again if the plan rejects unhealthy ones. Stages of rejected draws count in the
/// sample's seconds.
pub fn accept(plan: &Plan, index: u64) -> Result<Accepted, Unfit> {
    let mut rejected: Vec<Label> = Vec::new();
    let mut sample = attempt(plan, index, 0);
    loop {
        let again = rejected.len() as u32 + 1;
        match plan.on_unhealthy {
            _ if sample.label.health.healthy => break,
            OnUnhealthy::Keep => break,
            OnUnhealthy::Reject if again < MOST_ATTEMPTS => {}
            OnUnhealthy::Reject | OnUnhealthy::Fail => return Err(Unfit(Box::new(sample.label))),
        }
        let next = attempt(plan, index, again);
        let before = std::mem::replace(&mut sample, next);
        sample.seconds.add(&before.seconds);
        rejected.push(before.label);
    }
    Ok(Accepted { sample, rejected })
}
