//! `[sequence]`: each sample is a sequence of frames in which an object is pressed in, slides, turns, rolls and is lifted.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use gelsim_files::sensor::quantity::Quantity;

/// The `[sequence]` table.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(default, deny_unknown_fields)]
pub struct Sequence {
    /// Frames per second, above 0 to 10000. Frame k is taken k + 1 frame times after the start.
    pub frame_rate_hz: f64,
    /// Friction between the pad and the object, drawn once for each sequence.
    pub friction: SequenceFriction,
    /// Phases of the motion, one after the other. The object begins just touching the pad.
    #[schemars(required)]
    pub phase: Vec<Phase>,
}

impl Default for Sequence {
    fn default() -> Self {
        Self { frame_rate_hz: 25.0, friction: SequenceFriction::default(), phase: Vec::new() }
    }
}

/// Friction between the pad and the object in a sequence.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum SequenceFriction {
    /// Nothing slips.
    Stick,
    /// The pad slips where the traction would be larger than this multiple of the pressure, 0 to 10.
    Coefficient(Quantity),
}

impl Default for SequenceFriction {
    fn default() -> Self {
        Self::Coefficient(Quantity::Constant(0.6))
    }
}

/// A phase of a sequence: `[[sequence.phase]]`.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(default, deny_unknown_fields)]
pub struct Phase {
    /// Name of the phase in labels.
    #[schemars(required)]
    pub name: Option<String>,
    /// Duration, s, 0 to 3600.
    pub duration_s: Quantity,
    /// Indentation depth at the end of the phase, mm; below 0 the object is above the pad. Without this and `force_n`
    /// the depth does not change.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub depth_mm: Option<Quantity>,
    /// Normal force at the end of the phase, N, in place of `depth_mm`: the depth that gives it is searched for. With a
    /// gripper it is the force of each finger.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub force_n: Option<Quantity>,
    /// With a gripper, in place of `force_n`: distance between the undeformed pads at the end of the phase, mm.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub width_mm: Option<Quantity>,
    /// With a gripper, in place of `force_n`: how much closer the pads are than the object is wide at the end of the
    /// phase, mm; below 0 they do not touch the object.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub squeeze_mm: Option<Quantity>,
    /// Motion of the object along x in this phase, mm.
    pub x_mm: Quantity,
    /// Motion of the object along y in this phase, mm.
    pub y_mm: Quantity,
    /// Turn in this phase about the point that the pose places, degrees from x towards y.
    pub twist_deg: Quantity,
    /// Tilt in this phase about the lowest point, degrees: the object rolls on the pad and does not slide.
    pub tilt_deg: Quantity,
    /// Direction of the tilt's axis, degrees from x towards y.
    pub tilt_azimuth_deg: Quantity,
    /// How the motion proceeds with time.
    pub profile: Profile,
}

/// How a motion proceeds with time.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum Profile {
    /// At a constant speed.
    #[default]
    Linear,
    /// From rest to rest with the least jerk: 10 s^3 - 15 s^4 + 6 s^5.
    Smooth,
}

impl Profile {
    /// Returns the fraction of the motion that is done after the fraction `time` of the duration, each from 0 to 1.
    pub fn progress_at(self, time: f64) -> f64 {
        match self {
            Self::Linear => time,
            Self::Smooth => (time * time * time * (10.0 + time * (6.0 * time - 15.0))).clamp(0.0, 1.0),
        }
    }
}
