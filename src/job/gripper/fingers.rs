//! The two fingers of a draw and the object between them, as the search for the balance sees them.

use std::sync::Arc;

use super::balance::{FingerModel, GripBalance};
use super::label::{GripperLabel, TransformLabel};
use crate::label::PoseLabel;
use crate::plan::Plan;
use crate::scene::Scene;
use gelsim_core::mesh::clusters::Clusters;
use gelsim_core::simulator::Simulator;

/// Tolerance of the object's place between the fingers, as a fraction of the contact solver's tolerance.
const PLACE_TOLERANCE: f64 = 0.1;

/// The left and the right finger of a draw.
pub struct FingerPair<'a> {
    /// Plans of the fingers.
    pub plans: [&'a Plan; 2],
    /// The object in the frame of each finger, just touching its pad.
    pub scenes: [Scene; 2],
    /// Simulators of the fingers.
    pub simulators: [Arc<Simulator>; 2],
    /// The object between them.
    pub object: Arc<Clusters>,
    /// Width of the object along the closing axis, mm.
    pub object_width_mm: f64,
}

impl<'a> FingerPair<'a> {
    /// Draws the fingers and the object of sample `index`; `plan` is that of the draw.
    pub fn draw(plan: &'a Plan, index: u64, attempt: u32) -> Self {
        let plans = [plan, plan.right_finger()];
        let left = Scene::draw(plan, index, attempt);
        let right = left.seen_from_finger(plans[1]);
        let simulators = [left.simulator(plans[0]), right.simulator(plans[1])];
        let object = left.clusters.clone().expect("an object is drawn");
        let scenes = [left, right];
        // Heights of the lowest points of both sides over a common plane, in which both frames have their origin.
        let [towards_left, towards_right] = scenes.each_ref().map(|scene| {
            let mut pose = scene.pose;
            pose.translation_mm.z = 0.0;
            pose.lowest_mm(&object)
        });
        Self { plans, scenes, simulators, object, object_width_mm: 0.0 - towards_left - towards_right }
    }

    /// Runs a search for the balance. `force_n` gives the normal force, N, of finger 0 or 1 at a depth, mm; NaN if it
    /// is not known.
    pub fn search_balance<T>(
        &self,
        force_n: &dyn Fn(usize, f64) -> f64,
        search: impl FnOnce([&FingerModel<'_>; 2]) -> T,
    ) -> T {
        let forces = [0, 1].map(|k| move |depth_mm: f64| force_n(k, depth_mm));
        let fingers = [0, 1].map(|k| {
            let material = self.simulators[k].sensor().gelpad;
            let ratio = material.poisson_ratio;
            FingerModel {
                force_n: &forces[k],
                thickness_mm: material.thickness_mm,
                modulus_kpa: material.youngs_modulus_kpa / (1.0 - ratio * ratio),
            }
        });
        search(fingers.each_ref())
    }

    /// Returns the tolerance of the object's place, mm.
    pub fn place_tolerance_mm(&self) -> f64 {
        let tolerance_um = |simulator: &Arc<Simulator>| {
            // The plan refuses other models for a gripper.
            simulator.models().gelpad.contact_solver().expect("a model that knows forces").tolerance_um
        };
        PLACE_TOLERANCE * 1e-3 * self.simulators.iter().map(tolerance_um).fold(0.0, f64::max)
    }

    /// Describes how the object is held. `forces_n` are the normal forces of both fingers, N, and `moments_nmm` the
    /// first moments of their pressures, N mm, each if known. `left` is the object's pose in the left finger's frame.
    pub fn describe_grip(
        &self,
        hold: &GripBalance,
        left: &PoseLabel,
        forces_n: [Option<f64>; 2],
        moments_nmm: [Option<[f64; 2]>; 2],
    ) -> GripperLabel {
        let width_mm = self.object_width_mm - hold.depth_mm[0] - hold.depth_mm[1];
        let [x, y, z] = left.translation_mm;
        let both = forces_n[0].zip(forces_n[1]);
        let frame = |quaternion_xyzw| TransformLabel { quaternion_xyzw, translation_mm: [0.0, 0.0, 0.5 * width_mm] };
        GripperLabel {
            width_mm,
            object_width_mm: self.object_width_mm,
            pose: PoseLabel { translation_mm: [x, y, z - 0.5 * width_mm], ..left.clone() },
            left_frame: frame([0.0, 0.0, 0.0, 1.0]),
            right_frame: frame([0.0, 1.0, 0.0, 0.0]),
            force_n: both.map(|(left, right)| 0.5 * (left + right)),
            residual_n: both.map(|(left, right)| left - right),
            // The left pad pushes along +z: r x f = (y f, -x f). The right one pushes along -z, and its own x is the
            // opposite of the gripper's.
            torque_nmm: moments_nmm[0]
                .zip(moments_nmm[1])
                .map(|([x, y], [facing_x, facing_y])| [y - facing_y, 0.0 - x - facing_x].map(|nmm| nmm + 0.0)),
            balanced: hold.balanced,
            presses: hold.presses,
        }
    }
}

/// Says why the forces are not equal, or returns `None` if they are.
pub fn explain_imbalance(hold: &GripBalance, forces_n: [Option<f64>; 2]) -> Option<String> {
    (!hold.balanced).then(|| match forces_n {
        [Some(left), Some(right)] => {
            format!("the forces of the fingers are not in balance: {left:.4} N on the left, {right:.4} N on the right")
        }
        _ => String::from("the force of a finger is not known, so that nothing says whether the object is in balance"),
    })
}
