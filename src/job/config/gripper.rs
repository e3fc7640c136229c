//! `[gripper]`: each sample is one object between two fingers. The left finger has `[sensor]`, the right one the same
//! or another sensor.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use gelsim_files::sensor::Sensor;
use gelsim_files::sensor::quantity::Quantity;
use gelsim_files::sensor::random::SensorDistribution;

/// The `[gripper]` table. One of `width_mm`, `squeeze_mm` and `force_n` says how far the fingers close.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(default, deny_unknown_fields)]
pub struct Gripper {
    /// Distance between the undeformed pads, mm, 0 to 10000. If the object is thinner, neither finger touches it.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub width_mm: Option<Quantity>,
    /// How much closer the pads are than the object is wide in its pose, mm: the sum of the indentation depths of both
    /// fingers, 0 to the sum of the thicknesses of both gelpads.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub squeeze_mm: Option<Quantity>,
    /// Normal force of each finger, N. The width that gives it is searched for.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub force_n: Option<Quantity>,
    /// Sensor of the right finger: a preset, a file, or every key of a sensor file. Without it both fingers have
    /// `[sensor]`. `[markers]` and `[camera]` of the job then hold for the left finger only.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub right: Option<Box<Sensor>>,
    /// What is drawn anew for each sample of the right finger's sensor.
    #[serde(skip)]
    pub right_random: SensorDistribution,
}

impl Gripper {
    /// Returns the keys of which one says how far the fingers close, with their values.
    pub fn closings(&self) -> [(&'static str, &Option<Quantity>); 3] {
        [("width_mm", &self.width_mm), ("squeeze_mm", &self.squeeze_mm), ("force_n", &self.force_n)]
    }
}
