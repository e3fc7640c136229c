//! Moves the object of a sequence: divides phases into steps.

use glam::{DMat3, DVec3};

use super::ROLLING_PX;
use crate::config::sequence::Profile;
use gelsim_core::base::angle::sin_cos_deg;
use gelsim_core::gelpad::planar::PlanarMotion;
use gelsim_core::gelpad::sliding::ObjectStep;
use gelsim_core::mesh::clusters::Clusters;
use gelsim_core::pose::{Pose, rotation_about};

/// The greatest turn in a step, degrees. The friction model takes the chord of the turn for the path.
const MAX_TURN_DEG: f64 = 5.0;

/// The greatest share of its depth by which an object is lifted in a step. What slips meanwhile loses its traction on
/// the way.
const MAX_FALL: f64 = 0.25;

/// The greatest change of the depth in a step on a pad that relaxes, over the larger depth. The loads are taken to change
/// at a constant rate in a step.
const RELAXING_CHANGE: f64 = 0.15;

/// The greatest shift in a step on a pad that relaxes, over the longer side of the view.
const RELAXING_SHIFT: f64 = 0.02;

/// A phase as it was drawn.
#[derive(Clone, Debug, PartialEq)]
pub struct DrawnPhase {
    /// Name of the phase.
    pub name: String,
    /// Duration, s.
    pub duration_s: f64,
    /// What is reached at the end of the phase.
    pub goal: PhaseGoal,
    /// Motion in the pad's plane, mm.
    pub shift_mm: [f64; 2],
    /// Turn from x towards y, degrees.
    pub twist_deg: f64,
    /// Tilt about an axis in the pad's plane, degrees.
    pub tilt_deg: f64,
    /// Direction of that axis, degrees from x towards y.
    pub tilt_azimuth_deg: f64,
    /// How the motion proceeds with time.
    pub profile: Profile,
}

/// A part of a phase.
#[derive(Clone, Copy, Debug)]
pub struct PartOfPhase {
    /// Fraction of the phase's motion.
    pub share: f64,
    /// Indentation depth at the end, mm.
    pub depth_mm: f64,
    /// Duration, s.
    pub duration_s: f64,
}

/// How deep an object is at the end of a phase.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum PhaseGoal {
    /// As deep as before.
    Stay,
    /// This deep, mm.
    Depth(f64),
    /// As deep as this force presses it, N.
    Force(f64),
}

/// A moving object.
#[derive(Clone, Debug)]
pub struct ObjectMover<'a> {
    object: &'a Clusters,
    /// The rotation from which the angles of the pose begin.
    facing: DMat3,
    /// Pose of the object.
    pub pose: Pose,
    /// Depth of its lowest point, mm.
    pub depth_mm: f64,
    /// The point of the object about which it is twisted.
    pivot: DVec3,
    /// The greatest tilt of a step, degrees.
    most_tilt_deg: f64,
    /// True on a pad that relaxes. What it remembers of a step lies where the object was at its end.
    relaxes: bool,
    /// The longer side of the view, mm.
    longest_mm: f64,
}

impl<'a> ObjectMover<'a> {
    /// Makes an object at the start of its motion. `about_mm` is the point that the pose places, and `longest_mm` the
    /// longer side of the view.
    pub fn new(
        object: &'a Clusters,
        facing: DMat3,
        pose: Pose,
        about_mm: [f64; 2],
        depth_mm: f64,
        longest_mm: f64,
        relaxes: bool,
    ) -> Self {
        let pivot = DVec3::new(about_mm[0], about_mm[1], pose.lowest_mm(object));
        let pivot = pose.rotation.transpose() * (pivot - pose.translation_mm);
        let reach = [DVec3::X, DVec3::Y, DVec3::Z].map(|axis| {
            let of = |axis: DVec3| object.extreme(axis.to_array());
            of(axis).max(of(-axis))
        });
        let radius_mm = reach.into_iter().fold(1e-6, f64::max);
        let most_tilt_deg = (longest_mm / ROLLING_PX / radius_mm).to_degrees().clamp(0.05, MAX_TURN_DEG);
        Self { object, facing, pose, depth_mm, pivot, most_tilt_deg, relaxes, longest_mm }
    }

    /// Returns the position of the point about which the object is twisted, mm.
    fn pivot_mm(&self) -> [f64; 2] {
        let at = self.pose.rotation * self.pivot + self.pose.translation_mm;
        [at.x, at.y]
    }

    /// Returns the pose at another depth.
    pub fn at_depth(&self, depth_mm: f64) -> Pose {
        self.pose.lowered(-depth_mm, self.object)
    }

    /// Moves on by a part of a phase. Appends the steps on the way to `steps`.
    pub fn advance(&mut self, phase: &DrawnPhase, part_of_phase: PartOfPhase, steps: &mut Vec<ObjectStep>) {
        let PartOfPhase { share, depth_mm, duration_s } = part_of_phase;
        let [twist, tilt] = [phase.twist_deg, phase.tilt_deg].map(|degrees| share * degrees);
        let fall = if self.depth_mm > 0.0 { (self.depth_mm - depth_mm.max(0.0)) / self.depth_mm } else { 0.0 };
        let count = (twist.abs() / MAX_TURN_DEG).max(tilt.abs() / self.most_tilt_deg).max(fall / MAX_FALL);
        let count = if self.relaxes { count.max(self.count_relaxing_steps(phase, share, depth_mm)) } else { count };
        // The tolerance keeps rounding from adding a step.
        let count = libm::ceil(count - 1e-9).max(1.0) as u32;
        let part = 1.0 / f64::from(count);
        let from_mm = self.depth_mm;
        for step in 1..=count {
            let to_mm = if step == count { depth_mm } else { from_mm + (depth_mm - from_mm) * f64::from(step) * part };
            let shift_mm = phase.shift_mm.map(|mm| share * part * mm);
            let moved = self.take_step(shift_mm, part * twist, part * tilt, phase.tilt_azimuth_deg, to_mm);
            steps.push(ObjectStep { duration_s: part * duration_s, ..moved });
        }
    }

    /// Returns the number of steps into which a motion on a pad that relaxes is divided at least.
    fn count_relaxing_steps(&self, phase: &DrawnPhase, share: f64, depth_mm: f64) -> f64 {
        let shift_mm = share.abs() * libm::hypot(phase.shift_mm[0], phase.shift_mm[1]);
        count_relaxing_steps(self.longest_mm, shift_mm, [self.depth_mm, depth_mm])
    }

    fn take_step(
        &mut self,
        shift_mm: [f64; 2],
        twist_deg: f64,
        tilt_deg: f64,
        azimuth_deg: f64,
        depth_mm: f64,
    ) -> ObjectStep {
        if tilt_deg != 0.0 {
            // Tilt about the point that touches first: the object rolls, so that point stays and another one touches
            // next.
            let down = (self.pose.rotation.transpose() * DVec3::NEG_Z).to_array();
            let lowest = self.object.extreme_point(down, self.object.extreme(down), 1e-3);
            let centre = DVec3::from_array(self.object.centre_mm());
            let point = self.pose.rotation * (centre + DVec3::from_array(lowest)) + self.pose.translation_mm;
            let (sin, cos) = sin_cos_deg(azimuth_deg);
            self.rotate_about(rotation_about(DVec3::new(cos, sin, 0.0), tilt_deg), point);
        }
        let about_mm = self.pivot_mm();
        if twist_deg != 0.0 {
            self.rotate_about(rotation_about(DVec3::Z, twist_deg), DVec3::new(about_mm[0], about_mm[1], 0.0));
        }
        self.pose.translation_mm += DVec3::new(shift_mm[0], shift_mm[1], 0.0);
        self.pose = self.pose.lowered(-depth_mm, self.object);
        self.depth_mm = depth_mm;
        if tilt_deg != 0.0 || twist_deg != 0.0 {
            let turned = Pose { rotation: self.pose.rotation * self.facing.transpose(), ..self.pose };
            self.pose.angles = Pose::from_quaternion(turned.quaternion_xyzw(), [0.0; 3]).angles;
        }
        let motion = PlanarMotion { shift_mm, turn_rad: twist_deg.to_radians(), about_mm };
        ObjectStep { pose: self.pose, depth_mm, motion, duration_s: 0.0 }
    }

    fn rotate_about(&mut self, rotation: DMat3, about_mm: DVec3) {
        self.pose.rotation = rotation * self.pose.rotation;
        self.pose.translation_mm = about_mm + rotation * (self.pose.translation_mm - about_mm);
    }
}

/// Returns the number of steps into which a motion over a pad that relaxes is divided at least: a shift in a view whose
/// longer side is `longest_mm`, from one depth to another.
pub fn count_relaxing_steps(longest_mm: f64, shift_mm: f64, depths_mm: [f64; 2]) -> f64 {
    let [from_mm, to_mm] = depths_mm.map(|mm| mm.max(0.0));
    let change = (to_mm - from_mm).abs() / to_mm.max(from_mm).max(1e-9);
    (shift_mm / (RELAXING_SHIFT * longest_mm)).max(change / RELAXING_CHANGE)
}

/// Returns the number of frames of a sequence of this length, at least 1.
pub fn count_frames(duration_s: f64, frame_rate_hz: f64) -> u64 {
    // The tolerance keeps rounding from adding a frame.
    (libm::ceil(duration_s * frame_rate_hz - 1e-9) as u64).max(1)
}
