//! A grip of a plan: one object between two fingers, drawn at random, balanced between them, pressed into both, described.
//!
//! The gripper's frame has its origin in the middle between the undeformed pads, z from the left pad to the right one. The left
//! finger's frame is parallel to it; the right finger's is turned half about y, so that y is down in both images and x the
//! opposite way. The object is free along z and held as the pose turns it.

use std::sync::Arc;

use crate::core::base::clock::{Clock, Seconds};
use crate::core::base::rng;
use crate::core::effects::{Effect, PerEffect};
use crate::core::gelpad;
use crate::core::gelpad::Contact;
use crate::core::mesh::clusters::Clusters;
use crate::core::simulator::Simulator;
use crate::files::sensor::quantity::Quantity;
use crate::job::config::gripper::Gripper;
use crate::job::config::output::OnUnhealthy;
use crate::job::label::{Label, PoseLabel};
use crate::job::placing::NO_CONTACT_GAP_MM;
use crate::job::plan::Plan;
use crate::job::sample::{self, MOST_ATTEMPTS, Sample, Unfit};
use crate::job::scene::Scene;

pub mod balance;
pub mod label;

use balance::{Finger, Hold, gripped, squeezed};
use label::{FrameLabel, GripLabel, GripperLabel};

/// Names of the fingers, which begin the names of their files.
pub const FINGERS: [&str; 2] = ["left", "right"];

/// Of the contact solver's tolerance, the share to which the object's place between the fingers is found.
const PLACE: f64 = 0.1;

/// A grip, rendered.
pub struct Grip {
    /// What the left and the right finger feel. Their labels are those of presses.
    pub fingers: [Sample; 2],
    /// What is known of it.
    pub label: GripLabel,
    /// The same in one.
    pub summary: Label,
    /// CPU seconds of both fingers.
    pub seconds: Seconds,
    /// The same of each effect.
    pub effects: PerEffect<f64>,
}

/// A grip that may go into the dataset, and the draws of it that may not.
pub struct Accepted {
    /// The grip.
    pub grip: Grip,
    /// What was drawn before it and rejected.
    pub rejected: Vec<Label>,
}

/// How far the fingers close.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Closing {
    /// To a distance between the undeformed pads, mm.
    Width(f64),
    /// By so much more than the object is wide, mm.
    Squeeze(f64),
    /// To a normal force of each finger, N.
    Force(f64),
}

impl Closing {
    fn draw(gripper: &Gripper, draw: impl Fn(&str, &Quantity) -> f64) -> Self {
        let Gripper { width_mm, squeeze_mm, force_n, .. } = gripper;
        match (width_mm, squeeze_mm, force_n) {
            (Some(width), ..) => Self::Width(draw("gripper width", width)),
            (None, Some(squeeze), _) => Self::Squeeze(draw("gripper squeeze", squeeze)),
            (None, None, Some(force)) => Self::Force(draw("gripper force", force)),
            (None, None, None) => unreachable!("a plan's gripper says how far it closes"),
        }
    }
}

/// Renders grip `index` as it is drawn after `attempt` draws were rejected.
pub fn render(plan: &Plan, index: u64, attempt: u32) -> Grip {
    let plan = plan.of_sample(index, attempt);
    let mut clock = Clock::start();
    let gripper = plan.job().gripper.as_ref().expect("a job of a gripper");
    let plans = [plan, plan.right()];
    let left = Scene::draw(plan, index, attempt);
    let right = left.faced(plans[1]);
    let simulators = [left.simulator(plans[0]), right.simulator(plans[1])];
    let scenes = [left, right];
    let object = scenes[0].clusters.clone().expect("an object is drawn");
    let object_width_mm = width_mm(&scenes, &object);
    let draw = |name: &str, quantity: &Quantity| {
        quantity.sample(&mut rng::stream(plan.seed(), name, rng::redrawn(index, attempt)))
    };
    let closing = Closing::draw(gripper, draw);

    let draw_s = clock.lap();

    let force_n = |k: usize| {
        let (plan, simulator, scene) = (plans[k], &*simulators[k], &scenes[k]);
        move |depth_mm: f64| simulator.total_force_n(&scene.at_depth(depth_mm).press(plan)).unwrap_or(f64::NAN)
    };
    let (on_left, on_right) = (force_n(0), force_n(1));
    let searched = [finger(&simulators[0], &on_left), finger(&simulators[1], &on_right)];
    let searched = searched.each_ref();
    let place_mm = PLACE * 1e-3 * tolerance_um(&simulators[0]).max(tolerance_um(&simulators[1]));
    let mut hold = match closing {
        _ if !Scene::touches(plan, index, attempt) => Hold::open(NO_CONTACT_GAP_MM),
        Closing::Width(width_mm) => squeezed(searched, object_width_mm - width_mm, place_mm),
        Closing::Squeeze(squeeze_mm) => squeezed(searched, squeeze_mm, place_mm),
        Closing::Force(newtons) => gripped(searched, newtons),
    };
    let search_s = clock.lap();

    let scenes = [0, 1].map(|k| scenes[k].at_depth(hold.depth_mm[k]));
    let [left, right] = [0, 1].map(|k| sample::press_with(plans[k], &scenes[k], Arc::clone(&simulators[k])));
    let mut clock = Clock::start();
    let forces = [&left, &right].map(|finger| finger.impression.contact.whole.total_force_n);
    hold.balanced &= forces.iter().all(Option::is_some);
    let reason = hold.missed.take().or_else(|| unbalanced(&hold, forces));
    let mut fingers = [left, right];
    if let Some(reason) = reason {
        for finger in fingers.iter_mut().filter(|finger| finger.label.health.healthy) {
            finger.label.health.healthy = false;
            finger.label.health.reason.clone_from(&reason);
        }
    }
    let gripper = describe(&hold, object_width_mm, &fingers);
    let label = GripLabel::new(gripper, fingers[0].label.clone(), fingers[1].label.clone());
    let mut seconds = Seconds { scene: draw_s, gelpad: search_s, label: clock.lap(), ..Seconds::default() };
    let mut effects = PerEffect::<f64>::default();
    for finger in &fingers {
        seconds.add(&finger.seconds);
        for effect in Effect::ALL {
            effects[effect] += finger.impression.effects.seconds[effect];
        }
    }
    Grip { summary: label.summary(), fingers, label, seconds, effects }
}

/// Renders grip `index`, again and again if the plan rejects unhealthy ones. Stages of rejected draws count in its seconds.
pub fn accept(plan: &Plan, index: u64) -> Result<Accepted, Unfit> {
    let mut rejected: Vec<Label> = Vec::new();
    let mut grip = render(plan, index, 0);
    loop {
        let again = rejected.len() as u32 + 1;
        match plan.output().on_unhealthy {
            _ if grip.summary.health.healthy => break,
            OnUnhealthy::Keep => break,
            OnUnhealthy::Reject if again < MOST_ATTEMPTS => {}
            OnUnhealthy::Reject | OnUnhealthy::Fail => return Err(Unfit(Box::new(grip.summary))),
        }
        let next = render(plan, index, again);
        let before = std::mem::replace(&mut grip, next);
        grip.seconds.add(&before.seconds);
        rejected.push(before.summary);
    }
    Ok(Accepted { grip, rejected })
}

fn finger<'a>(simulator: &Simulator, force_n: &'a dyn Fn(f64) -> f64) -> Finger<'a> {
    let material = simulator.sensor().gelpad;
    let ratio = material.poisson_ratio;
    let modulus_kpa = material.youngs_modulus_kpa / (1.0 - ratio * ratio);
    Finger { force_n, thickness_mm: material.thickness_mm, modulus_kpa }
}

fn tolerance_um(simulator: &Simulator) -> f64 {
    match &simulator.models().gelpad {
        gelpad::Model::Elastic(elastic) => elastic.tolerance_um,
        // Refused by the plan.
        model => unreachable!("{} knows no force", model.name()),
    }
}

/// Width of the object along the closing axis, mm.
fn width_mm(scenes: &[Scene; 2], object: &Clusters) -> f64 {
    // Heights of its lowest points over one plane that both pads' axes begin in.
    let [left, right] = scenes.each_ref().map(|scene| {
        let mut pose = scene.pose;
        pose.translation_mm.z = 0.0;
        pose.lowest_mm(object)
    });
    0.0 - left - right
}

/// Why forces that were to be equal are not.
fn unbalanced(hold: &Hold, forces: [Option<f64>; 2]) -> Option<String> {
    (!hold.balanced).then(|| match forces {
        [Some(left), Some(right)] => {
            format!("the forces of the fingers are not in balance: {left:.4} N on the left, {right:.4} N on the right")
        }
        _ => String::from("the force of a finger is not known, so that nothing says whether the object is in balance"),
    })
}

/// How the object is held.
fn describe(hold: &Hold, object_width_mm: f64, fingers: &[Sample; 2]) -> GripperLabel {
    let width_mm = object_width_mm - hold.depth_mm[0] - hold.depth_mm[1];
    let PoseLabel { translation_mm: [x, y, z], .. } = fingers[0].label.pose;
    let pose = PoseLabel { translation_mm: [x, y, z - 0.5 * width_mm], ..fingers[0].label.pose.clone() };
    let forces = fingers.each_ref().map(|finger| finger.impression.contact.whole.total_force_n);
    let both = forces[0].zip(forces[1]);
    let frame = |quaternion_xyzw| FrameLabel { quaternion_xyzw, translation_mm: [0.0, 0.0, 0.5 * width_mm] };
    GripperLabel {
        width_mm,
        object_width_mm,
        pose,
        left_frame: frame([0.0, 0.0, 0.0, 1.0]),
        right_frame: frame([0.0, 1.0, 0.0, 0.0]),
        force_n: both.map(|(left, right)| 0.5 * (left + right)),
        residual_n: both.map(|(left, right)| left - right),
        torque_nmm: torque_nmm(fingers),
        balanced: hold.balanced,
        presses: hold.presses,
    }
}

/// Torque of both fingers' normal forces on the object about the gripper's x and y.
fn torque_nmm(fingers: &[Sample; 2]) -> Option<[f64; 2]> {
    let moments = fingers.each_ref().map(|finger| {
        let modulus_kpa = finger.simulator.sensor().gelpad.youngs_modulus_kpa;
        moment(&finger.impression.contact, modulus_kpa)
    });
    let ([x, y], [facing_x, facing_y]) = (moments[0]?, moments[1]?);
    // The left pad pushes along +z, r x f = (y f, -x f); the right one along -z, at -x of its own.
    Some([y - facing_y, 0.0 - x - facing_x].map(|nmm| nmm + 0.0))
}

/// First moment of a pad's pressure, along x and y of its own, N mm; `None` where some of it is beyond what was captured.
fn moment(contact: &Contact, modulus_kpa: f64) -> Option<[f64; 2]> {
    let Some(load) = &contact.load else { return contact.force_n.filter(|force| *force == 0.0).map(|_| [0.0; 2]) };
    let mut sums = [0.0; 3];
    for y in 0..load.pressure.height {
        let at_y = load.origin_mm[1] + y as f64 * load.mm_per_px[1];
        for (x, pressure) in load.pressure.row(y).iter().enumerate() {
            let pressure = f64::from(*pressure);
            sums[0] += pressure * (load.origin_mm[0] + x as f64 * load.mm_per_px[0]);
            sums[1] += pressure * at_y;
            sums[2] += pressure;
        }
    }
    // kPa mm^2 are mN.
    let newtons = 1e-3 * contact.stiffened * modulus_kpa * load.mm_per_px[0] * load.mm_per_px[1];
    let whole = contact.whole.total_force_n?;
    let captured = (newtons * sums[2] - whole).abs() <= 1e-3 * whole;
    captured.then(|| [newtons * sums[0], newtons * sums[1]])
}
