//! Motion in the pad's plane, and a frame that goes along.

use glam::{DMat3, DVec3};

use super::elastic::history::Moved;
use crate::base::angle::Turn;
use crate::pose::Pose;

/// Where a frame that goes with an object lies in the sensor's.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct PlanarFrame {
    /// Of its origin, mm.
    pub origin_mm: [f64; 2],
    /// From x towards y, rad; counts on over whole turns.
    pub angle_rad: f64,
}

/// A motion of the object's surface in the pad's plane.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct PlanarMotion {
    /// mm.
    pub shift_mm: [f64; 2],
    /// From x towards y, rad.
    pub turn_rad: f64,
    /// What it turns about, mm.
    pub about_mm: [f64; 2],
}

/// The axes of a frame at a moment, for many places.
#[derive(Clone, Copy, Debug)]
pub struct Axes {
    origin_mm: [f64; 2],
    turn: Turn,
}

impl Axes {
    /// A direction in the frame, in the sensor's.
    pub fn turned(&self, direction: [f64; 2]) -> [f64; 2] {
        self.turn.out(direction)
    }

    /// Where a place in the frame is in the sensor's.
    pub fn to_sensor(&self, place_mm: [f64; 2]) -> [f64; 2] {
        let at = self.turn.out(place_mm);
        [0, 1].map(|k| self.origin_mm[k] + at[k])
    }

    /// Where a place in the sensor's frame is in it.
    pub fn to_frame(&self, place_mm: [f64; 2]) -> [f64; 2] {
        self.turn.back([0, 1].map(|k| place_mm[k] - self.origin_mm[k]))
    }
}

impl PlanarFrame {
    /// Its axes where it is.
    pub(crate) fn axes(&self) -> Axes {
        Axes { origin_mm: self.origin_mm, turn: Turn::new(self.angle_rad) }
    }

    /// Moves it; the motion as the frame itself sees it.
    pub(crate) fn moved(&mut self, motion: PlanarMotion) -> Moved {
        let PlanarMotion { shift_mm, turn_rad, about_mm } = motion;
        let by = Turn::new(turn_rad).moves([0, 1].map(|k| self.origin_mm[k] - about_mm[k]));
        let by = [0, 1].map(|k| shift_mm[k] + by[k]);
        let shift_mm = Turn::new(self.angle_rad).back(by);
        self.origin_mm = [0, 1].map(|k| self.origin_mm[k] + by[k]);
        self.angle_rad += turn_rad;
        Moved { shift_mm, turn_rad }
    }

    /// An object's pose as the frame sees it.
    pub(crate) fn inverse(&self, pose: Pose) -> Pose {
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
