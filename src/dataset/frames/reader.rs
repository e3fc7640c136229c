//! From a frame's values to what is pressed in: heights over a flat pad, or the surface that a camera inside a gel sees.

use std::sync::Arc;

use super::camera::DepthCamera;
use super::check::Reach;
use super::heights::Heights;
use super::inside::{InsideCamera, InsideFrame};
use gelsim_core::base::grid::Grid;
use gelsim_core::base::view::View;
use gelsim_core::depth::height_map::HeightMap;
use gelsim_core::depth::indenter::Shape;
use gelsim_core::pose::Pose;
use gelsim_core::simulator::Simulator;
use gelsim_files::diagnostic::Diagnostic;

/// A depth camera in the place that a sensor gives it.
pub enum FrameReader {
    /// Under a flat pad.
    Pad {
        /// The camera.
        camera: DepthCamera,
        /// What the sensor's own camera shows.
        view: View,
        /// Thickness of the pad, mm.
        thickness_mm: f64,
    },
    /// Inside a gel that has a shape.
    Gel(Box<InsideCamera>),
}

/// What a frame shows.
pub enum SeenFrame<'a> {
    /// Heights over a flat pad.
    Pad(HeightMap, Reach),
    /// The surface near a gel that has a shape.
    Gel(Box<InsideFrame<'a>>),
}

impl FrameReader {
    /// For frames of this size. On failure, why the sensor's gel cannot be seen by such a camera.
    pub fn new(camera: DepthCamera, simulator: &Simulator, size_px: [usize; 2]) -> Result<Self, Diagnostic> {
        let sensor = simulator.sensor();
        Ok(match &sensor.shape {
            Some(shape) => Self::Gel(Box::new(InsideCamera::new(camera, sensor, shape, size_px)?)),
            None => Self::Pad { camera, view: *simulator.view(), thickness_mm: sensor.gelpad.thickness_mm },
        })
    }

    /// What a frame shows. On failure, what is wrong with it.
    pub fn read(&self, frame: Grid<f64>) -> Result<SeenFrame<'_>, Diagnostic> {
        match self {
            Self::Pad { camera, view, thickness_mm } => {
                let heights = camera.heights(frame, view)?;
                let reach = Reach::from_surface(&heights, *thickness_mm);
                let Heights { above_mm, unseen_px } = heights;
                Ok(SeenFrame::Pad(HeightMap { above_mm, unseen_px }, reach))
            }
            Self::Gel(camera) => Ok(SeenFrame::Gel(Box::new(camera.look(frame)?))),
        }
    }
}

impl SeenFrame<'_> {
    /// How far it reaches.
    pub fn reach(&self) -> Reach {
        match self {
            Self::Pad(_, reach) => *reach,
            Self::Gel(frame) => frame.reach(),
        }
    }

    /// How deep the deepest point reaches below the undeformed pad, mm; 0 without contact.
    pub fn depth_mm(&self) -> f64 {
        match self {
            Self::Pad(map, _) => map.indentation_depth_mm(),
            Self::Gel(frame) => 0.0 - frame.reach().lowest_mm.min(0.0),
        }
    }

    /// As something to be pressed in, of an object at a pose.
    pub fn pressed(self, pose: &Pose) -> Shape {
        match self {
            Self::Pad(map, _) => Shape::HeightMap(Arc::new(map)),
            Self::Gel(frame) => frame.pressed(pose),
        }
    }
}
