//! Renders sequences of grips, frame by frame: fingers close on an object, hold it while it slides along both, and
//! open.
//!
//! Only the object moves in the pads' plane, with the phases and steps of a sequence of one finger whose depth is half
//! the squeeze. Each step is balanced between both fingers. Each finger makes the step in its own frame, and keeps its
//! own state of friction.

use std::sync::Arc;

use super::balance::{GripBalance, TOLERANCE, balance_force, balance_squeeze};
use super::fingers::{FingerPair, explain_imbalance};
use super::label::{GripFrameLabel, GripPhaseLabel, GripSequenceInfo, GripSequenceLabel};
use super::mark_unhealthy;
use crate::label::Label;
use crate::plan::Plan;
use crate::sample::{RejectedSample, Sample};
use crate::sequence::label::FrameLabel;
use crate::sequence::motion::{DrawnPhase, ObjectMover, PhaseGoal};
use crate::sequence::timeline::{PhaseEnd, Timeline};
use crate::sequence::{AcceptedSequence, SequenceDrawer, SequenceEvent, accept_rendered, build_frame_press};
use gelsim_core::base::clock::{Seconds, ThreadClock};
use gelsim_core::base::rng;
use gelsim_core::depth::texture::TexturePlacement;
use gelsim_core::effects::{Effect, PerEffect};
use gelsim_core::gelpad::planar::PlanarMotion;
use gelsim_core::gelpad::sliding::{ObjectStep, Sliding};
use gelsim_core::pose::Pose;
use gelsim_core::simulator::Press;

/// A frame as both fingers see it.
pub type FingerSamples = [Sample; 2];

/// Draws and renders sequence `index`, again if it is not healthy and the plan rejects such, and calls `each` with
/// every event.
pub fn accept_grip_sequence<E: From<RejectedSample>>(
    plan: &Plan,
    index: u64,
    each: impl FnMut(SequenceEvent<FingerSamples>) -> Result<(), E>,
) -> Result<AcceptedSequence<GripSequenceLabel>, E> {
    accept_rendered(plan, each, |attempt, each| render(plan, index, attempt, each))
}

/// The last balance that was found.
struct LastBalance {
    /// Half the squeeze, mm.
    depth_mm: f64,
    hold: GripBalance,
}

/// The state of both fingers between frames.
struct GripState<'a> {
    fingers: FingerPair<'a>,
    sliding: [Sliding; 2],
    /// Placement of the texture at the start, for each finger.
    texture_placements: [TexturePlacement; 2],
    last_balance: Option<LastBalance>,
    /// Whether the force depends on the place: the object touches beyond a view, or a pad is not flat.
    place_counts: bool,
}

impl GripState<'_> {
    /// Returns what is pressed into finger `k`.
    fn finger_press(&self, k: usize) -> Press {
        build_frame_press(self.fingers.plans[k], &self.fingers.scenes[k], self.texture_placements[k])
    }

    /// Returns the pose of the object in the frame of finger `k`, at a depth there. `left` is its pose in the left
    /// finger's frame.
    fn finger_pose(&self, k: usize, left: Pose, depth_mm: f64) -> Pose {
        let own = if k == 0 { left } else { left.seen_by_opposite_pad() };
        own.lowered(-depth_mm, &self.fingers.object)
    }

    /// Returns the normal force of finger `k` on the object at a pose and depth, N.
    fn finger_force_n(&self, presses: &[Press; 2], left: Pose, k: usize, depth_mm: f64) -> f64 {
        let pose = self.finger_pose(k, left, depth_mm);
        self.fingers.simulators[k].force_n(&self.sliding[k], &presses[k], pose, depth_mm)
    }

    /// Finds where both fingers press equally an object at a pose that is squeezed by twice `depth_mm`.
    fn find_balance(&mut self, presses: &[Press; 2], left: Pose, depth_mm: f64) -> GripBalance {
        if let Some(last) = self.last_balance.as_ref().filter(|last| last.depth_mm == depth_mm && !self.place_counts) {
            return GripBalance { presses: 0, ..last.hold.clone() };
        }
        let known = self.last_balance.as_ref().filter(|last| last.depth_mm > 0.0);
        let begin = known.map(|last| last.hold.depth_mm[0] / (2.0 * last.depth_mm));
        let force_n = |k: usize, depth_mm: f64| self.finger_force_n(presses, left, k, depth_mm);
        let place_mm = self.fingers.place_tolerance_mm();
        let hold =
            self.fingers.search_balance(&force_n, |fingers| balance_squeeze(fingers, 2.0 * depth_mm, place_mm, begin));
        self.last_balance = Some(LastBalance { depth_mm, hold: hold.clone() });
        hold
    }
}

/// Renders sequence `index` as it is drawn after `attempt` rejected draws. Calls `each` with every frame, and stops at
/// its first error.
pub fn render<E>(
    plan: &Plan,
    index: u64,
    attempt: u32,
    mut each: impl FnMut(FingerSamples, u32) -> Result<(), E>,
) -> Result<AcceptedSequence<GripSequenceLabel>, E> {
    let plan = plan.for_sample(index, attempt);
    let mut clock = ThreadClock::start();
    let sequence = plan.job().sequence.as_ref().expect("a job of sequences");
    let pair = FingerPair::draw(plan, index, attempt);
    let object = Arc::clone(&pair.object);
    let object_width_mm = pair.object_width_mm;
    let draw = SequenceDrawer { plan, redrawn: rng::redraw_index(index, attempt) };
    let phases = draw.draw_phases(sequence, |k, phase| match (&phase.width_mm, &phase.squeeze_mm, &phase.force_n) {
        (Some(width), ..) => PhaseGoal::Depth(0.5 * (object_width_mm - draw.draw_for_phase(k, "width", width))),
        (None, Some(squeeze), _) => PhaseGoal::Depth(0.5 * draw.draw_for_phase(k, "squeeze", squeeze)),
        (None, None, Some(force)) => PhaseGoal::Force(draw.draw_for_phase(k, "force", force)),
        (None, None, None) => PhaseGoal::Stay,
    });
    let friction = draw.draw_friction(sequence, &pair.scenes[0]);
    let sliding =
        pair.simulators.each_ref().map(|simulator| simulator.sliding(friction).expect("a model that knows tractions"));
    let start = pair.scenes[0].over_plane;
    let about_mm = pair.scenes[0].motion.about_mm;
    let noise_keys = pair.scenes.each_ref().map(|scene| scene.camera.noise_key);
    let view = pair.simulators[0].view();
    let longest_mm = (0..2).map(|k| view.resolution_px[k] as f64 * view.mm_per_px[k]).fold(0.0, f64::max);
    let mover = ObjectMover::new(&object, pair.scenes[0].facing, start, about_mm, 0.0, longest_mm, false);
    let uneven = pair.simulators.iter().any(|simulator| simulator.drop_mm().is_some());
    let placements = pair.scenes.each_ref().map(|scene| TexturePlacement::at_pose(&scene.over_plane));
    let mut state =
        GripState { fingers: pair, sliding, texture_placements: placements, last_balance: None, place_counts: uneven };

    let rate = sequence.frame_rate_hz;
    let mut timeline = Timeline::new(&phases, rate, mover);
    let mut total = Seconds { scene: clock.lap(), ..Seconds::default() };
    let mut effects = PerEffect::<f64>::default();
    let mut frames: Vec<GripFrameLabel> = Vec::new();
    let mut first: Option<[Label; 2]> = None;
    for number in 0..timeline.frame_count() {
        let mut clock = ThreadClock::start();
        let presses = [0, 1].map(|k| state.finger_press(k));
        let before = timeline.mover().pose;
        let steps = timeline.advance_to_frame(number, |phase, mover| find_phase_end(phase, mover, &state, &presses));
        let mut of_frame = GripBalance { depth_mm: [0.0; 2], presses: 0, balanced: true, failure: None };
        let mut own: [Vec<ObjectStep>; 2] = Default::default();
        for step in &steps {
            // On a flat pad the place in the plane does not matter to the balance, and the texture's placement is that
            // of the frame before.
            let place = if uneven { step.pose } else { before };
            let hold = state.find_balance(&presses, place, step.depth_mm);
            for (k, steps) in own.iter_mut().enumerate() {
                let depth_mm = hold.depth_mm[k];
                let motion = if k == 0 { step.motion } else { mirror_motion(step.motion) };
                let pose = state.finger_pose(k, step.pose, depth_mm);
                steps.push(ObjectStep { pose, depth_mm, motion, duration_s: step.duration_s });
            }
            of_frame = GripBalance {
                depth_mm: hold.depth_mm,
                presses: of_frame.presses + hold.presses,
                balanced: of_frame.balanced && hold.balanced,
                failure: of_frame.failure.take().or(hold.failure),
            };
        }
        total.scene += clock.lap();

        let samples = [0, 1].map(|k| {
            let scene = &mut state.fingers.scenes[k];
            // Every frame has at least one step.
            if let Some(step) = own[k].last() {
                scene.pose = step.pose;
                scene.indentation_depth_mm = step.depth_mm.max(0.0);
            }
            // The noise of the first frame is that of a press.
            scene.camera.noise_key = match number {
                0 => noise_keys[k],
                _ => rng::random_stream(noise_keys[k], "sequence frame noise", number).next_bits(),
            };
            let press = state.finger_press(k);
            let (plan, simulator) = (state.fingers.plans[k], Arc::clone(&state.fingers.simulators[k]));
            let impression = simulator.press_next(&press, &own[k], &mut state.sliding[k]);
            let mut clock = ThreadClock::start();
            let label = Label::describe(plan, &state.fingers.scenes[k], &simulator, &impression, None);
            let seconds = Seconds { label: clock.lap(), ..impression.seconds };
            Sample { simulator, impression, numbered: None, label, seconds }
        });
        state.place_counts = uneven || samples.iter().any(|finger| finger.impression.contact.total.cut_by_view);
        let frame = describe_frame(&state, of_frame, &timeline, number, samples, rate);
        let (frame, samples) = frame;
        for finger in &samples {
            total.add(&finger.seconds);
            for effect in Effect::ALL {
                effects[effect] += finger.impression.effects.seconds[effect];
            }
        }
        first.get_or_insert_with(|| samples.each_ref().map(|finger| finger.label.clone()));
        frames.push(frame);
        each(samples, number as u32)?;
    }
    let phases = timeline.into_labels().into_iter().map(|phase| GripPhaseLabel {
        name: phase.name,
        duration_s: phase.duration_s,
        first_frame: phase.first_frame,
        frames: phase.frames,
        width_mm: object_width_mm - 2.0 * phase.depth_mm,
        force_n: phase.force_n,
        shift_mm: phase.shift_mm,
        twist_deg: phase.twist_deg,
    });
    let info = GripSequenceInfo {
        frame_rate_hz: rate,
        frames: frames.len() as u32,
        friction_coefficient: friction.coefficient(),
        phases: phases.collect(),
        ..GripSequenceInfo::default()
    };
    let label = GripSequenceLabel::new(first.expect("a sequence has a frame"), info, frames);
    let summary = label.summary().expect("a sequence has a frame");
    Ok(AcceptedSequence { label, summary, rejected: Vec::new(), seconds: total, effects })
}

/// Makes the label of a frame, and marks its fingers with what is wrong with the grip.
fn describe_frame(
    state: &GripState<'_>,
    mut hold: GripBalance,
    timeline: &Timeline<'_>,
    number: u64,
    mut samples: FingerSamples,
    rate: f64,
) -> (GripFrameLabel, FingerSamples) {
    let wrenches = samples.each_ref().map(|finger| finger.impression.sliding.as_ref().map(|sliding| sliding.wrench));
    let forces_n = wrenches.map(|wrench| wrench.map(|wrench| 0.0 - wrench.force_n[2]));
    // The balance was found for the place before the frame's motion. What counts is the force with which the fingers
    // press afterwards.
    if let [Some(left), Some(right)] = forces_n {
        hold.balanced &= (left - right).abs() <= 2.0 * TOLERANCE * left.max(right) || hold.presses > 0;
    }
    let missed = hold.failure.take().or_else(|| timeline.failure().map(str::to_owned));
    let reason = missed.or_else(|| explain_imbalance(&hold, forces_n));
    samples.iter_mut().for_each(|finger| mark_unhealthy(&mut finger.label, reason.as_deref()));
    // For forces at z = 0 the torque is (y fz, -x fz), and fz is below 0.
    let moments = wrenches.map(|wrench| wrench.map(|wrench| [wrench.torque_nmm[1], 0.0 - wrench.torque_nmm[0]]));
    let gripper = state.fingers.describe_grip(&hold, &samples[0].label.pose, forces_n, moments);
    let (index, t_s, phase) = (number as u32, (number + 1) as f64 / rate, timeline.phase_name());
    let [left, right] = samples
        .each_ref()
        .map(|finger| FrameLabel::new(index, t_s, phase, finger.label.clone(), finger.impression.sliding.as_ref()));
    (GripFrameLabel { index, t_s, phase: phase.to_owned(), gripper, left, right }, samples)
}

/// Returns half the squeeze at the end of a phase.
fn find_phase_end(
    phase: &DrawnPhase,
    mover: &ObjectMover<'_>,
    state: &GripState<'_>,
    presses: &[Press; 2],
) -> PhaseEnd {
    let wanted_n = match phase.goal {
        PhaseGoal::Stay => return PhaseEnd::at_depth(mover.depth_mm),
        PhaseGoal::Depth(mm) => return PhaseEnd::at_depth(mm),
        PhaseGoal::Force(newtons) => newtons,
    };
    let force_n = |k: usize, depth_mm: f64| state.finger_force_n(presses, mover.pose, k, depth_mm);
    let hold = state.fingers.search_balance(&force_n, |fingers| balance_force(fingers, wanted_n));
    let missed = hold.failure.map(|reason| format!("phase `{}`: {reason}", phase.name));
    PhaseEnd { depth_mm: 0.5 * (hold.depth_mm[0] + hold.depth_mm[1]), force_n: wanted_n, failure: missed }
}

/// Mirrors a motion into the plane of the opposite pad.
fn mirror_motion(motion: PlanarMotion) -> PlanarMotion {
    let PlanarMotion { shift_mm, turn_rad, about_mm } = motion;
    let mirrored = |[x, y]: [f64; 2]| [0.0 - x, y];
    PlanarMotion { shift_mm: mirrored(shift_mm), turn_rad: 0.0 - turn_rad, about_mm: mirrored(about_mm) }
}
