//! Converts a frame to what is pressed in: heights over a flat pad, or the surface that a camera inside a gel sees.

use std::sync::Arc;

use super::camera::DepthCamera;
use super::check::FrameReach;
use super::heights::FrameHeights;
use super::inside::{InsideCamera, InsideFrame};
use gelsim_core::base::grid::Grid;
use gelsim_core::base::view::View;
use gelsim_core::depth::height_map::HeightMap;
use gelsim_core::depth::indenter::Shape;
use gelsim_core::pose::Pose;
use gelsim_core::simulator::Simulator;
use gelsim_files::diagnostic::Diagnostic;

/// A depth camera at the place that a sensor gives it.
pub enum FrameReader {
    /// Under a flat pad.
    Pad {
        /// The camera.
        camera: DepthCamera,
        /// The view of the sensor's own camera.
        view: View,
        /// Thickness of the pad, mm.
        thickness_mm: f64,
    },
    /// Inside a gel with a shape.
    Gel(Box<InsideCamera>),
}

/// What a frame shows.
pub enum SeenFrame<'a> {
    /// Heights over a flat pad.
    Pad(HeightMap, FrameReach),
    /// The surface near a gel with a shape.
    Gel(Box<InsideFrame<'a>>),
}

impl FrameReader {
    /// Makes a reader for frames of this size. The error says why such a camera cannot see the sensor's gel.
    pub fn new(camera: DepthCamera, simulator: &Simulator, size_px: [usize; 2]) -> Result<Self, Diagnostic> {
        let sensor = simulator.sensor();
        Ok(match &sensor.shape {
            Some(shape) => Self::Gel(Box::new(InsideCamera::new(camera, sensor, shape, size_px)?)),
            None => Self::Pad { camera, view: *simulator.view(), thickness_mm: sensor.gelpad.thickness_mm },
        })
    }

    /// Reads a frame. The error says what is wrong with it.
    pub fn read(&self, frame: Grid<f64>) -> Result<SeenFrame<'_>, Diagnostic> {
        match self {
            Self::Pad { camera, view, thickness_mm } => {
                let heights = camera.to_heights(frame, view)?;
                let reach = FrameReach::from_surface(&heights, *thickness_mm);
                let FrameHeights { above_mm, unseen_px } = heights;
                Ok(SeenFrame::Pad(HeightMap { above_mm, unseen_px }, reach))
            }
            Self::Gel(camera) => Ok(SeenFrame::Gel(Box::new(camera.read_frame(frame)?))),
        }
    }
}

impl SeenFrame<'_> {
    /// Returns the range of the frame's heights.
    pub fn reach(&self) -> FrameReach {
        match self {
            Self::Pad(_, reach) => *reach,
            Self::Gel(frame) => frame.reach(),
        }
    }

    /// Returns how deep the deepest point reaches below the undeformed pad, mm; 0 without contact.
    pub fn indentation_depth_mm(&self) -> f64 {
        match self {
            Self::Pad(map, _) => map.indentation_depth_mm(),
            Self::Gel(frame) => 0.0 - frame.reach().lowest_mm.min(0.0),
        }
    }

    /// Returns the frame as a shape that an object at a pose presses in.
    pub fn into_shape(self, pose: &Pose) -> Shape {
        match self {
            Self::Pad(map, _) => Shape::HeightMap(Arc::new(map)),
            Self::Gel(frame) => frame.to_shape(pose),
        }
    }
}
