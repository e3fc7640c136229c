//! How the object of a sequence moves: from phases to steps, and from steps to frames.

use glam::{DMat3, DVec3};

use crate::config::sequence::Profile;
use gelsim_core::base::angle::sin_cos_deg;
use gelsim_core::gelpad::planar::PlanarMotion;
use gelsim_core::gelpad::sliding::ObjectStep;
use gelsim_core::mesh::clusters::Clusters;
use gelsim_core::pose::{Pose, Side, about};

/// Largest turn in a step, degrees: the law of friction takes its chord for the way.
const MOST_TURN_DEG: f64 = 5.0;

/// A phase as it was drawn.
#[derive(Clone, Debug, PartialEq)]
pub struct DrawnPhase {
    /// Its name.
    pub name: String,
    /// s.
    pub duration_s: f64,
    /// What the object comes to at its end.
    pub goal: Goal,
    /// mm.
    pub shift_mm: [f64; 2],
    /// Degrees from x towards y.
    pub twist_deg: f64,
    /// Degrees about an axis of this direction, degrees.
    pub tilt_deg: f64,
    /// Degrees from x towards y.
    pub tilt_azimuth_deg: f64,
    /// How it goes with time.
    pub profile: Profile,
}

/// How deep an object is at the end of a phase.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Goal {
    /// As deep as before.
    Stay,
    /// So deep, mm.
    Depth(f64),
    /// As deep as this force takes it, N.
    Force(f64),
}

/// An object under way.
#[derive(Clone, Debug)]
pub struct Mover<'a> {
    object: &'a Clusters,
    side: Side,
    /// Where the object is.
    pub pose: Pose,
    /// How deep its lowest point is, mm.
    pub depth_mm: f64,
    /// What it is twisted about, on the object.
    pivot: DVec3,
    /// Largest tilt of a step, degrees.
    most_tilt_deg: f64,
}

impl<'a> Mover<'a> {
    /// At the start: `about_mm` is the point that the pose places, `finest_mm` how far the contact may roll in a step.
    pub fn new(
        object: &'a Clusters,
        side: Side,
        pose: Pose,
        about_mm: [f64; 2],
        depth_mm: f64,
        finest_mm: f64,
    ) -> Self {
        let pivot = DVec3::new(about_mm[0], about_mm[1], pose.lowest_mm(object));
        let pivot = pose.rotation.transpose() * (pivot - pose.translation_mm);
        let reach = [DVec3::X, DVec3::Y, DVec3::Z].map(|axis| {
            let of = |axis: DVec3| object.extreme(axis.to_array());
            of(axis).max(of(-axis))
        });
        let radius_mm = reach.into_iter().fold(1e-6, f64::max);
        let most_tilt_deg = (finest_mm / radius_mm).to_degrees().clamp(0.05, MOST_TURN_DEG);
        Self { object, side, pose, depth_mm, pivot, most_tilt_deg }
    }

    /// Where the point that it is twisted about stands, mm.
    fn about_mm(&self) -> [f64; 2] {
        let at = self.pose.rotation * self.pivot + self.pose.translation_mm;
        [at.x, at.y]
    }

    /// Where it would be at another depth.
    pub fn at_depth(&self, depth_mm: f64) -> Pose {
        self.pose.lowered(-depth_mm, self.object)
    }

    /// Goes on by the share `share` of a phase's motion and comes to a depth; the steps on the way.
    pub fn go(&mut self, phase: &DrawnPhase, share: f64, depth_mm: f64, steps: &mut Vec<ObjectStep>) {
        let [twist, tilt] = [phase.twist_deg, phase.tilt_deg].map(|degrees| share * degrees);
        let count = (twist.abs() / MOST_TURN_DEG).max(tilt.abs() / self.most_tilt_deg);
        let count = libm::ceil(count - 1e-9).max(1.0) as u32;
        let part = 1.0 / f64::from(count);
        let from_mm = self.depth_mm;
        for step in 1..=count {
            let to_mm = if step == count { depth_mm } else { from_mm + (depth_mm - from_mm) * f64::from(step) * part };
            let shift_mm = phase.shift_mm.map(|mm| share * part * mm);
            steps.push(self.step(shift_mm, part * twist, part * tilt, phase.tilt_azimuth_deg, to_mm));
        }
    }

    fn step(
        &mut self,
        shift_mm: [f64; 2],
        twist_deg: f64,
        tilt_deg: f64,
        azimuth_deg: f64,
        depth_mm: f64,
    ) -> ObjectStep {
        if tilt_deg != 0.0 {
            // About the point that touches first: it stays where it is, and another one touches next.
            let down = (self.pose.rotation.transpose() * DVec3::NEG_Z).to_array();
            let lowest = self.object.extreme_point(down, self.object.extreme(down), 1e-3);
            let centre = DVec3::from_array(self.object.centre_mm());
            let point = self.pose.rotation * (centre + DVec3::from_array(lowest)) + self.pose.translation_mm;
            let (sin, cos) = sin_cos_deg(azimuth_deg);
            self.turn(about(DVec3::new(cos, sin, 0.0), tilt_deg), point);
        }
        let about_mm = self.about_mm();
        if twist_deg != 0.0 {
            self.turn(about(DVec3::Z, twist_deg), DVec3::new(about_mm[0], about_mm[1], 0.0));
        }
        self.pose.translation_mm += DVec3::new(shift_mm[0], shift_mm[1], 0.0);
        self.pose = self.pose.lowered(-depth_mm, self.object);
        self.depth_mm = depth_mm;
        if tilt_deg != 0.0 || twist_deg != 0.0 {
            let turned = Pose { rotation: self.pose.rotation * self.side.rotation().transpose(), ..self.pose };
            self.pose.angles = Pose::placed(turned.quaternion_xyzw(), [0.0; 3]).angles;
        }
        let motion = PlanarMotion { shift_mm, turn_rad: twist_deg.to_radians(), about_mm };
        ObjectStep { pose: self.pose, depth_mm, motion }
    }

    fn turn(&mut self, rotation: DMat3, about_mm: DVec3) {
        self.pose.rotation = rotation * self.pose.rotation;
        self.pose.translation_mm = about_mm + rotation * (self.pose.translation_mm - about_mm);
    }
}

/// Frames that a sequence of this length has.
pub fn frames(duration_s: f64, frame_rate_hz: f64) -> u64 {
    (libm::ceil(duration_s * frame_rate_hz - 1e-9) as u64).max(1)
}
