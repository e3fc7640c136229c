//! Checks whether a sample is healthy.
//!
//! The check covers what every sample promises: finite numbers, a surface between the pad's back and one thickness
//! above its front, and a solver that reached its tolerance. What can happen to a real sensor, too (clipped light, an
//! object deeper than the pad), is only counted in the label.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::scene::{PressSource, Scene};
use gelsim_core::impression::Impression;

/// Result of the check of a sample.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
pub struct Health {
    /// True if the sample is healthy: finite, within bounds, its contact solved.
    pub healthy: bool,
    /// Why the sample is not healthy; empty if it is.
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

/// How far beyond the pad's back rounding and the solver's tolerance may take the surface, as a fraction of the
/// thickness.
const SLACK: f32 = 1e-3;

/// Returns how far a healthy surface may lie from the undeformed pad, and an object may reach below it, mm.
pub fn max_displacement_mm(thickness_mm: f64) -> f64 {
    thickness_mm * (1.0 + f64::from(SLACK))
}

impl Health {
    /// Checks a sample on a pad `thickness_mm` thick.
    pub fn check(scene: &Scene, impression: &Impression, thickness_mm: f64) -> Self {
        let Impression { image, depth, contact, .. } = impression;
        let finite = image.finite && contact.finite;
        let [lowest, highest] = contact.range_mm();
        let thickness = thickness_mm as f32;
        let bounded = lowest >= -thickness * (1.0 + SLACK) && highest <= thickness * (1.0 + SLACK);
        let numerics = &contact.numerics;
        let reason = match (finite, bounded, numerics.converged) {
            _ if scene.beside_axis => {
                String::from("the object is beside the sensor's axis, on which its depth is measured")
            }
            _ if let Err(reason) = &scene.force_found => reason.clone(),
            (false, ..) => String::from("not every number is finite"),
            (_, false, _) => format!("the surface lies between {lowest} and {highest} mm in a pad of {thickness} mm"),
            (.., false) => format!(
                "the contact is not solved: {:.3} um are left after {} iterations",
                numerics.residual_um.unwrap_or_default(),
                numerics.iterations
            ),
            _ if image.rgb.iter().all(|value| *value == u8::MAX) && !image.rgb.is_empty() => {
                String::from("the image is white all over")
            }
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
                PressSource::Object(_) => 0,
                PressSource::Frame(frame) => frame.shape.unseen_px(),
            },
        }
    }
}
