//! Two fingers and the object between them: drawn, and searched for the balance.

use std::sync::Arc;

use super::balance::{Finger, Hold};
use super::label::{GripperLabel, TransformLabel};
use crate::label::PoseLabel;
use crate::plan::Plan;
use crate::scene::Scene;
use gelsim_core::gelpad;
use gelsim_core::mesh::clusters::Clusters;
use gelsim_core::simulator::Simulator;

/// Of the contact solver's tolerance, the share to which the object's place between the fingers is found.
const PLACE: f64 = 0.1;

/// The left and the right finger of a sample.
pub struct Fingers<'a> {
    /// Their plans.
    pub plans: [&'a Plan; 2],
    /// The object as each sees it, just touching its pad.
    pub scenes: [Scene; 2],
    /// Their sensors.
    pub simulators: [Arc<Simulator>; 2],
    /// What is between them.
    pub object: Arc<Clusters>,
    /// Its width along the closing axis, mm.
    pub object_width_mm: f64,
}

impl<'a> Fingers<'a> {
    /// Those of a draw of sample `index`; `plan` is that of the draw.
    pub fn draw(plan: &'a Plan, index: u64, attempt: u32) -> Self {
        let plans = [plan, plan.right()];
        let left = Scene::draw(plan, index, attempt);
        let right = left.faced(plans[1]);
        let simulators = [left.simulator(plans[0]), right.simulator(plans[1])];
        let object = left.clusters.clone().expect("an object is drawn");
        let scenes = [left, right];
        // Heights of the lowest points over one plane, in which both frames have their origin.
        let [towards_left, towards_right] = scenes.each_ref().map(|scene| {
            let mut pose = scene.pose;
            pose.translation_mm.z = 0.0;
            pose.lowest_mm(&object)
        });
        Self { plans, scenes, simulators, object, object_width_mm: 0.0 - towards_left - towards_right }
    }

    /// Searches for the balance by the normal force (N; NaN where it is not known) of finger 0 or 1 at a depth (mm).
    pub fn search<T>(&self, force_n: &dyn Fn(usize, f64) -> f64, search: impl FnOnce([&Finger<'_>; 2]) -> T) -> T {
        let forces = [0, 1].map(|k| move |depth_mm: f64| force_n(k, depth_mm));
        let fingers = [0, 1].map(|k| {
            let material = self.simulators[k].sensor().gelpad;
            let ratio = material.poisson_ratio;
            Finger {
                force_n: &forces[k],
                thickness_mm: material.thickness_mm,
                modulus_kpa: material.youngs_modulus_kpa / (1.0 - ratio * ratio),
            }
        });
        search(fingers.each_ref())
    }

    /// How well the object's place is to be known, mm.
    pub fn place_mm(&self) -> f64 {
        let tolerance_um = |simulator: &Arc<Simulator>| match &simulator.models().gelpad {
            gelpad::Model::Elastic(elastic) => elastic.tolerance_um,
            // Refused by the plan.
            model => unreachable!("{} knows no force", model.name()),
        };
        PLACE * 1e-3 * self.simulators.iter().map(tolerance_um).fold(0.0, f64::max)
    }

    /// How the object is held, with the normal forces of both fingers, N, and the first moments of their pressures, N mm, where
    /// these are known. `left` is the object's pose in the left finger's frame.
    pub fn describe(
        &self,
        hold: &Hold,
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
            // The left pad pushes along +z, r x f = (y f, -x f); the right one along -z, at -x of its own.
            torque_nmm: moments_nmm[0]
                .zip(moments_nmm[1])
                .map(|([x, y], [facing_x, facing_y])| [y - facing_y, 0.0 - x - facing_x].map(|nmm| nmm + 0.0)),
            balanced: hold.balanced,
            presses: hold.presses,
        }
    }
}

/// Why forces that were to be equal are not; nothing if they are.
pub fn unbalanced(hold: &Hold, forces_n: [Option<f64>; 2]) -> Option<String> {
    (!hold.balanced).then(|| match forces_n {
        [Some(left), Some(right)] => {
            format!("the forces of the fingers are not in balance: {left:.4} N on the left, {right:.4} N on the right")
        }
        _ => String::from("the force of a finger is not known, so that nothing says whether the object is in balance"),
    })
}
