//! Motion in the pad's plane, and a frame that moves with the object.

use glam::{DMat3, DVec3};

use super::elastic::friction_history::FrameMotion;
use crate::base::angle::PlanarRotation;
use crate::pose::Pose;

/// Position of a frame that moves with an object, in the sensor's frame.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct PlanarFrame {
    /// Its origin, mm.
    pub origin_mm: [f64; 2],
    /// Its rotation from x towards y, rad; it is not reduced to one turn.
    pub angle_rad: f64,
}

/// A motion of the object's surface in the pad's plane.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct PlanarMotion {
    /// Translation, mm.
    pub shift_mm: [f64; 2],
    /// Rotation from x towards y, rad.
    pub turn_rad: f64,
    /// Centre of the rotation, mm.
    pub about_mm: [f64; 2],
}

/// The axes of a frame at one moment, for converting many points.
#[derive(Clone, Copy, Debug)]
pub struct FrameAxes {
    origin_mm: [f64; 2],
    rotation: PlanarRotation,
}

impl FrameAxes {
    /// Converts a direction in the frame to the sensor's frame.
    pub fn direction_to_sensor(&self, direction: [f64; 2]) -> [f64; 2] {
        self.rotation.rotate(direction)
    }

    /// Converts a direction in the sensor's frame to this frame.
    pub fn direction_to_frame(&self, direction: [f64; 2]) -> [f64; 2] {
        self.rotation.rotate_back(direction)
    }

    /// Converts a point in the frame to the sensor's frame.
    pub fn to_sensor(&self, place_mm: [f64; 2]) -> [f64; 2] {
        let at = self.rotation.rotate(place_mm);
        [0, 1].map(|k| self.origin_mm[k] + at[k])
    }

    /// Converts a point in the sensor's frame to this frame.
    pub fn to_frame(&self, place_mm: [f64; 2]) -> [f64; 2] {
        self.rotation.rotate_back([0, 1].map(|k| place_mm[k] - self.origin_mm[k]))
    }
}

impl PlanarFrame {
    /// Returns the frame's axes at its present position.
    pub(crate) fn axes(&self) -> FrameAxes {
        FrameAxes { origin_mm: self.origin_mm, rotation: PlanarRotation::new(self.angle_rad) }
    }

    /// Moves the frame, and returns the motion along the frame's own axes.
    pub(crate) fn move_by(&mut self, motion: PlanarMotion) -> FrameMotion {
        let PlanarMotion { shift_mm, turn_rad, about_mm } = motion;
        let by = PlanarRotation::new(turn_rad).displacement([0, 1].map(|k| self.origin_mm[k] - about_mm[k]));
        let by = [0, 1].map(|k| shift_mm[k] + by[k]);
        let shift_mm = PlanarRotation::new(self.angle_rad).rotate_back(by);
        self.origin_mm = [0, 1].map(|k| self.origin_mm[k] + by[k]);
        self.angle_rad += turn_rad;
        FrameMotion { shift_mm, turn_rad }
    }

    /// Converts an object's pose to this frame.
    pub(crate) fn pose_in_frame(&self, pose: Pose) -> Pose {
        let (sin, cos) = libm::sincos(-self.angle_rad);
        let about_z = DMat3::from_cols(DVec3::new(cos, sin, 0.0), DVec3::new(-sin, cos, 0.0), DVec3::Z);
        let [x, y] = self.axes().to_frame([pose.translation_mm.x, pose.translation_mm.y]);
        Pose {
            rotation: about_z * pose.rotation,
            translation_mm: DVec3::new(x, y, pose.translation_mm.z),
            angles: pose.angles,
        }
    }
}
