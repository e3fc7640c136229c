//! `[gripper]`: each sample is one object between two fingers, `[sensor]` on the left and another one, or the same, on the
//! right.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use gelsim_files::sensor::Sensor;
use gelsim_files::sensor::quantity::Quantity;
use gelsim_files::sensor::random::SensorDistribution;

/// The `[gripper]` table. One of `width_mm`, `squeeze_mm` and `force_n` says how far the fingers close.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(default, deny_unknown_fields)]
pub struct Gripper {
    /// Distance between the undeformed pads, mm, 0 to 10000. Where the object is thinner, neither finger touches it.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub width_mm: Option<Quantity>,
    /// How much closer the pads are than the object is wide as it is turned, mm: the indentation depths of both fingers
    /// together, 0 to the thicknesses of both gelpads.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub squeeze_mm: Option<Quantity>,
    /// Normal force of each finger, N: the width is found.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub force_n: Option<Quantity>,
    /// The right finger's sensor: a preset, a file, or every key of a sensor file. Without it both fingers have that of
    /// `[sensor]`. `[markers]` and `[camera]` of the job are then the left finger's.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub right: Option<Box<Sensor>>,
    /// What of the right finger's sensor is drawn anew for each sample.
    #[serde(skip)]
    pub right_random: SensorDistribution,
}

impl Gripper {
    /// The keys of which one says how far the fingers close, with what is written of each.
    pub fn closings(&self) -> [(&'static str, &Option<Quantity>); 3] {
        [("width_mm", &self.width_mm), ("squeeze_mm", &self.squeeze_mm), ("force_n", &self.force_n)]
    }
}
