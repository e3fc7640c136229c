//! A depth frame that is a message of a log.

use std::sync::Arc;

use super::camera::DepthUnit;
use crate::logs::messages;
use crate::logs::{Entry, Log, Topic};
use gelsim_core::base::grid::Grid;

/// The message of a log that holds a frame.
#[derive(Clone, Debug)]
pub struct FrameMessage {
    log: Arc<Log>,
    entry: Entry,
    unit: DepthUnit,
}

impl FrameMessage {
    /// Makes it of a message of a log whose frames have this unit.
    pub fn new(log: Arc<Log>, entry: Entry, unit: DepthUnit) -> Self {
        Self { log, entry, unit }
    }

    /// Reads the frame. The error says what is wrong with it.
    pub fn read(&self) -> Result<Grid<f64>, String> {
        let Topic { kind, serialization, .. } = &self.log.topics[self.entry.topic as usize];
        let (Some(kind), Some(serialization)) = (kind, serialization) else {
            return Err(String::from("it is no image"));
        };
        let (frame, unit) = messages::decode_depth(*kind, *serialization, &self.log.read(&self.entry)?)?;
        match unit == self.unit {
            true => Ok(frame),
            false => Err(String::from("its encoding is not that of the first frame, whose values have another unit")),
        }
    }

    /// Returns when the frame was taken, ns since the epoch.
    pub fn stamp_ns(&self) -> u64 {
        self.entry.stamp_ns
    }

    /// Returns when the frame was written to the log, ns since the epoch.
    pub fn log_ns(&self) -> u64 {
        self.entry.log_ns
    }
}
