//! A grip of a plan: one object between two fingers, drawn at random, balanced between them, pressed into both, described.
//!
//! The gripper's frame has its origin in the middle between the undeformed pads, z from the left pad to the right one. The left
//! finger's frame is parallel to it; the right finger's is turned half about y, so that y is down in both images and x the
//! opposite way. The object is free along z and held as the pose turns it.

use std::sync::Arc;

use crate::config::gripper::Gripper;
use crate::config::output::OnUnhealthy;
use crate::label::Label;
use crate::placing::NO_CONTACT_GAP_MM;
use crate::plan::Plan;
use crate::sample::{self, MOST_ATTEMPTS, Sample, Unfit};
use crate::scene::Scene;
use gelsim_core::base::clock::{Clock, Seconds};
use gelsim_core::base::rng;
use gelsim_core::effects::{Effect, PerEffect};
use gelsim_core::gelpad::Contact;
use gelsim_files::sensor::quantity::Quantity;

pub mod balance;
mod fingers;
pub mod label;
pub mod sequence;

use balance::{Hold, gripped, squeezed};
use fingers::{Fingers, unbalanced};
use label::GripLabel;

/// Names of the fingers, which begin the names of their files.
pub const FINGERS: [&str; 2] = ["left", "right"];

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
    let pair = Fingers::draw(plan, index, attempt);
    let closing = Closing::draw(gripper, |name, quantity| {
        quantity.sample(&mut rng::stream(plan.seed(), name, rng::redrawn(index, attempt)))
    });
    let draw_s = clock.lap();

    let force_n = |k: usize, depth_mm: f64| {
        let press = pair.scenes[k].at_depth(depth_mm).press(pair.plans[k]);
        pair.simulators[k].total_force_n(&press).unwrap_or(f64::NAN)
    };
    let touches = Scene::touches(plan, index, attempt);
    let mut hold = pair.search(&force_n, |fingers| match closing {
        _ if !touches => Hold::open(NO_CONTACT_GAP_MM),
        Closing::Width(width_mm) => squeezed(fingers, pair.object_width_mm - width_mm, pair.place_mm(), None),
        Closing::Squeeze(squeeze_mm) => squeezed(fingers, squeeze_mm, pair.place_mm(), None),
        Closing::Force(newtons) => gripped(fingers, newtons),
    });
    let search_s = clock.lap();

    let mut fingers = [0, 1].map(|k| {
        let scene = pair.scenes[k].at_depth(hold.depth_mm[k]);
        sample::press_with(pair.plans[k], &scene, Arc::clone(&pair.simulators[k]))
    });
    let mut clock = Clock::start();
    let forces_n = fingers.each_ref().map(|finger| finger.impression.contact.total.total_force_n);
    hold.balanced &= forces_n.iter().all(Option::is_some);
    let reason = hold.missed.take().or_else(|| unbalanced(&hold, forces_n));
    fingers.iter_mut().for_each(|finger| not_healthy(&mut finger.label, reason.as_deref()));
    let moments = fingers
        .each_ref()
        .map(|finger| moment(&finger.impression.contact, finger.simulator.sensor().gelpad.youngs_modulus_kpa));
    let gripper = pair.describe(&hold, &fingers[0].label.pose, forces_n, moments);
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

/// Says of a finger that is healthy by itself why the grip is not.
fn not_healthy(label: &mut Label, reason: Option<&str>) {
    if let Some(reason) = reason.filter(|_| label.health.healthy) {
        label.health.healthy = false;
        label.health.reason = reason.to_owned();
    }
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
    let whole = contact.total.total_force_n?;
    let captured = (newtons * sums[2] - whole).abs() <= 1e-3 * whole;
    captured.then(|| [newtons * sums[0], newtons * sums[1]])
}
