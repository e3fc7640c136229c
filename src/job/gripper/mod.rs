//! Renders grips of a plan: one object between two fingers is drawn at random, balanced between them, pressed into both
//! pads, and labelled.
//!
//! The gripper's frame has its origin in the middle between the undeformed pads, with z from the left pad to the right
//! one. The left finger's frame is parallel to it. The right finger's frame is turned by half a turn about y, so that y
//! is down in both images and x is reversed. The object is free along z and held in its pose otherwise.

use std::sync::Arc;

use crate::config::gripper::Gripper;
use crate::config::output::OnUnhealthy;
use crate::label::Label;
use crate::placing::NO_CONTACT_GAP_MM;
use crate::plan::Plan;
use crate::sample::{self, MAX_ATTEMPTS, RejectedSample, Sample};
use crate::scene::Scene;
use gelsim_core::base::clock::{Seconds, ThreadClock};
use gelsim_core::base::rng;
use gelsim_core::effects::{Effect, PerEffect};
use gelsim_core::gelpad::total_contact::pressure_moment_nmm;
use gelsim_files::sensor::quantity::Quantity;

pub mod balance;
mod fingers;
pub mod label;
pub mod sequence;

use balance::{GripBalance, balance_force, balance_squeeze};
use fingers::{FingerPair, explain_imbalance};
use label::GripLabel;

/// Names of the fingers. The names of their files begin with them.
pub const FINGER_NAMES: [&str; 2] = ["left", "right"];

/// A rendered grip.
pub struct Grip {
    /// What the left and the right finger feel. Their labels are those of presses.
    pub fingers: [Sample; 2],
    /// Label of the grip.
    pub label: GripLabel,
    /// One label that stands for both fingers; see [`GripLabel::summary`].
    pub summary: Label,
    /// CPU seconds of both fingers.
    pub seconds: Seconds,
    /// CPU seconds of each effect, in both fingers.
    pub effects: PerEffect<f64>,
}

/// A grip that may go into the dataset, and the rejected draws before it.
pub struct AcceptedGrip {
    /// The grip.
    pub grip: Grip,
    /// Labels of the draws before it that were rejected.
    pub rejected: Vec<Label>,
}

/// How far the fingers close.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Closing {
    /// To this distance between the undeformed pads, mm.
    Width(f64),
    /// To this much less than the object's width, mm.
    Squeeze(f64),
    /// To this normal force of each finger, N.
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

/// Renders grip `index` as it is drawn after `attempt` rejected draws.
pub fn render(plan: &Plan, index: u64, attempt: u32) -> Grip {
    let plan = plan.for_sample(index, attempt);
    let mut clock = ThreadClock::start();
    let gripper = plan.job().gripper.as_ref().expect("a job of a gripper");
    let pair = FingerPair::draw(plan, index, attempt);
    let closing = Closing::draw(gripper, |name, quantity| {
        quantity.sample(&mut rng::random_stream(plan.seed(), name, rng::redraw_index(index, attempt)))
    });
    let draw_s = clock.lap();

    let force_n = |k: usize, depth_mm: f64| {
        let press = pair.scenes[k].at_depth(depth_mm).to_press(pair.plans[k]);
        pair.simulators[k].total_force_n(&press).unwrap_or(f64::NAN)
    };
    let touches = Scene::should_touch(plan, index, attempt);
    let mut hold = pair.search_balance(&force_n, |fingers| match closing {
        _ if !touches => GripBalance::open(NO_CONTACT_GAP_MM),
        Closing::Width(width_mm) => {
            balance_squeeze(fingers, pair.object_width_mm - width_mm, pair.place_tolerance_mm(), None)
        }
        Closing::Squeeze(squeeze_mm) => balance_squeeze(fingers, squeeze_mm, pair.place_tolerance_mm(), None),
        Closing::Force(newtons) => balance_force(fingers, newtons),
    });
    // The search is part of the gelpad's work, so its time counts to that stage.
    let search_s = clock.lap();

    let mut fingers = [0, 1].map(|k| {
        let scene = pair.scenes[k].at_depth(hold.depth_mm[k]);
        sample::press_with_simulator(pair.plans[k], &scene, Arc::clone(&pair.simulators[k]))
    });
    let mut clock = ThreadClock::start();
    let forces_n = fingers.each_ref().map(|finger| finger.impression.contact.total.total_force_n);
    // Without both forces nothing says that they are in balance.
    hold.balanced &= forces_n.iter().all(Option::is_some);
    let reason = hold.failure.take().or_else(|| explain_imbalance(&hold, forces_n));
    fingers.iter_mut().for_each(|finger| mark_unhealthy(&mut finger.label, reason.as_deref()));
    let moments = fingers.each_ref().map(|finger| {
        pressure_moment_nmm(&finger.impression.contact, finger.simulator.sensor().gelpad.youngs_modulus_kpa)
    });
    let gripper = pair.describe_grip(&hold, &fingers[0].label.pose, forces_n, moments);
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

/// Renders grip `index`, again and again if the plan rejects unhealthy ones. The CPU time of rejected draws counts in
/// its seconds.
pub fn accept_grip(plan: &Plan, index: u64) -> Result<AcceptedGrip, RejectedSample> {
    let mut rejected: Vec<Label> = Vec::new();
    let mut grip = render(plan, index, 0);
    loop {
        let again = rejected.len() as u32 + 1;
        match plan.output().on_unhealthy {
            _ if grip.summary.health.healthy => break,
            OnUnhealthy::Keep => break,
            OnUnhealthy::Reject if again < MAX_ATTEMPTS => {}
            OnUnhealthy::Reject | OnUnhealthy::Fail => return Err(RejectedSample(Box::new(grip.summary))),
        }
        let next = render(plan, index, again);
        let before = std::mem::replace(&mut grip, next);
        grip.seconds.add(&before.seconds);
        rejected.push(before.summary);
    }
    Ok(AcceptedGrip { grip, rejected })
}

/// Marks a finger that is healthy by itself as unhealthy, with the reason that concerns the grip. Does nothing without
/// a reason.
fn mark_unhealthy(label: &mut Label, reason: Option<&str>) {
    if let Some(reason) = reason.filter(|_| label.health.healthy) {
        label.health.healthy = false;
        label.health.reason = reason.to_owned();
    }
}
