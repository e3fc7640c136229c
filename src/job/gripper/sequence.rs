//! A sequence of a gripper: fingers that close on an object, hold it while it slides along both, and open; frame by frame.
//!
//! What moves in the pads' plane is the object, as in a sequence of one finger, whose phases and steps these are: of a depth of
//! half the squeeze. Each step is balanced between both fingers, each of which goes through it as its own frame has it, and
//! remembers friction by itself.

use std::sync::Arc;

use super::balance::{Hold, TOLERANCE, gripped, squeezed};
use super::fingers::{Fingers, unbalanced};
use super::label::{GripFrameLabel, GripPhaseLabel, GripSequenceInfo, GripSequenceLabel};
use super::not_healthy;
use crate::label::Label;
use crate::plan::Plan;
use crate::sample::{Sample, Unfit};
use crate::sequence::label::FrameLabel;
use crate::sequence::motion::{DrawnPhase, Goal, Mover};
use crate::sequence::timeline::{End, Timeline};
use crate::sequence::{Accepted, Drawer, ROLLING_PX, Shown, accept_by, pressed};
use gelsim_core::base::clock::{Clock, Seconds};
use gelsim_core::base::rng;
use gelsim_core::depth::texture::TexturePlacement;
use gelsim_core::effects::{Effect, PerEffect};
use gelsim_core::gelpad::planar::PlanarMotion;
use gelsim_core::gelpad::sliding::{ObjectStep, Sliding};
use gelsim_core::pose::Pose;
use gelsim_core::simulator::Press;

/// A frame as both fingers have it.
pub type Pair = [Sample; 2];

/// Draws and renders sequence `index`, again if it is not sound and the plan wants that, and shows each frame to `each`.
pub fn accept<E: From<Unfit>>(
    plan: &Plan,
    index: u64,
    each: impl FnMut(Shown<Pair>) -> Result<(), E>,
) -> Result<Accepted<GripSequenceLabel>, E> {
    accept_by(plan, each, |attempt, each| render(plan, index, attempt, each))
}

/// The balance as it was found last.
struct Last {
    /// Half the squeeze, mm.
    depth_mm: f64,
    hold: Hold,
}

/// Both fingers under way.
struct UnderWay<'a> {
    pair: Fingers<'a>,
    sliding: [Sliding; 2],
    /// Where the texture lay at the start.
    laid: [TexturePlacement; 2],
    last: Option<Last>,
    /// The object touched beyond a view, or a pad is not flat: another place may be another force.
    place_counts: bool,
}

impl UnderWay<'_> {
    /// What is pressed into finger `k`, at a place in the left finger's frame.
    fn press(&self, k: usize) -> Press {
        pressed(self.pair.plans[k], &self.pair.scenes[k], self.laid[k])
    }

    /// The same place in the frame of finger `k`, so deep.
    fn pose(&self, k: usize, left: Pose, depth_mm: f64) -> Pose {
        let own = if k == 0 { left } else { left.faced() };
        own.lowered(-depth_mm, &self.pair.object)
    }

    /// Normal force of finger `k` on the object at a place, N.
    fn force_n(&self, presses: &[Press; 2], left: Pose, k: usize, depth_mm: f64) -> f64 {
        let pose = self.pose(k, left, depth_mm);
        self.pair.simulators[k].force_n(&self.sliding[k], &presses[k], pose, depth_mm)
    }

    /// Where the fingers press equally, of an object at a place, squeezed by twice `depth_mm`.
    fn balance(&mut self, presses: &[Press; 2], left: Pose, depth_mm: f64) -> Hold {
        if let Some(last) = self.last.as_ref().filter(|last| last.depth_mm == depth_mm && !self.place_counts) {
            return Hold { presses: 0, ..last.hold.clone() };
        }
        let known = self.last.as_ref().filter(|last| last.depth_mm > 0.0);
        let begin = known.map(|last| last.hold.depth_mm[0] / (2.0 * last.depth_mm));
        let force_n = |k: usize, depth_mm: f64| self.force_n(presses, left, k, depth_mm);
        let place_mm = self.pair.place_mm();
        let hold = self.pair.search(&force_n, |fingers| squeezed(fingers, 2.0 * depth_mm, place_mm, begin));
        self.last = Some(Last { depth_mm, hold: hold.clone() });
        hold
    }
}

/// Renders sequence `index` as it is drawn after `attempt` draws were rejected, until `each`, which is shown the frames, fails.
pub fn render<E>(
    plan: &Plan,
    index: u64,
    attempt: u32,
    mut each: impl FnMut(Pair, u32) -> Result<(), E>,
) -> Result<Accepted<GripSequenceLabel>, E> {
    let plan = plan.of_sample(index, attempt);
    let mut clock = Clock::start();
    let sequence = plan.job().sequence.as_ref().expect("a job of sequences");
    let pair = Fingers::draw(plan, index, attempt);
    let object = Arc::clone(&pair.object);
    let object_width_mm = pair.object_width_mm;
    let draw = Drawer { plan, redrawn: rng::redrawn(index, attempt) };
    let phases = draw.phases(sequence, |k, phase| match (&phase.width_mm, &phase.squeeze_mm, &phase.force_n) {
        (Some(width), ..) => Goal::Depth(0.5 * (object_width_mm - draw.of_phase(k, "width", width))),
        (None, Some(squeeze), _) => Goal::Depth(0.5 * draw.of_phase(k, "squeeze", squeeze)),
        (None, None, Some(force)) => Goal::Force(draw.of_phase(k, "force", force)),
        (None, None, None) => Goal::Stay,
    });
    let friction = draw.friction(sequence, &pair.scenes[0]);
    let sliding =
        pair.simulators.each_ref().map(|simulator| simulator.sliding(friction).expect("a model that knows tractions"));
    let start = pair.scenes[0].over_plane;
    let about_mm = pair.scenes[0].motion.about_mm;
    let noise_keys = pair.scenes.each_ref().map(|scene| scene.camera.noise_key);
    let view = pair.simulators[0].view();
    let longest_mm = (0..2).map(|k| view.resolution_px[k] as f64 * view.mm_per_px[k]).fold(0.0, f64::max);
    let mover = Mover::new(&object, pair.scenes[0].side, start, about_mm, 0.0, longest_mm / ROLLING_PX);
    let uneven = pair.simulators.iter().any(|simulator| simulator.drop_mm().is_some());
    let laid = pair.scenes.each_ref().map(|scene| TexturePlacement::with(&scene.over_plane));
    let mut under_way = UnderWay { pair, sliding, laid, last: None, place_counts: uneven };

    let rate = sequence.frame_rate_hz;
    let mut timeline = Timeline::new(&phases, rate, mover);
    let mut total = Seconds { scene: clock.lap(), ..Seconds::default() };
    let mut effects = PerEffect::<f64>::default();
    let mut frames: Vec<GripFrameLabel> = Vec::new();
    let mut first: Option<[Label; 2]> = None;
    for number in 0..timeline.frames() {
        let mut clock = Clock::start();
        let presses = [0, 1].map(|k| under_way.press(k));
        let before = timeline.mover().pose;
        let steps = timeline.frame(number, |phase, mover| end_of(phase, mover, &under_way, &presses));
        let mut of_frame = Hold { depth_mm: [0.0; 2], presses: 0, balanced: true, missed: None };
        let mut own: [Vec<ObjectStep>; 2] = Default::default();
        for step in &steps {
            // On a flat pad the place in its plane does not matter, and the frame that goes with the object is still here.
            let place = if uneven { step.pose } else { before };
            let hold = under_way.balance(&presses, place, step.depth_mm);
            for (k, steps) in own.iter_mut().enumerate() {
                let depth_mm = hold.depth_mm[k];
                let motion = if k == 0 { step.motion } else { facing(step.motion) };
                steps.push(ObjectStep { pose: under_way.pose(k, step.pose, depth_mm), depth_mm, motion });
            }
            of_frame = Hold {
                depth_mm: hold.depth_mm,
                presses: of_frame.presses + hold.presses,
                balanced: of_frame.balanced && hold.balanced,
                missed: of_frame.missed.take().or(hold.missed),
            };
        }
        total.scene += clock.lap();

        let samples = [0, 1].map(|k| {
            let scene = &mut under_way.pair.scenes[k];
            // A frame has a step.
            if let Some(step) = own[k].last() {
                scene.pose = step.pose;
                scene.indentation_depth_mm = step.depth_mm.max(0.0);
            }
            // The first frame's noise is a press's.
            scene.camera.noise_key = match number {
                0 => noise_keys[k],
                _ => rng::stream(noise_keys[k], "sequence frame noise", number).bits(),
            };
            let press = under_way.press(k);
            let (plan, simulator) = (under_way.pair.plans[k], Arc::clone(&under_way.pair.simulators[k]));
            let impression = simulator.press_next(&press, &own[k], &mut under_way.sliding[k]);
            let mut clock = Clock::start();
            let label = Label::describe(plan, &under_way.pair.scenes[k], &simulator, &impression, None);
            let seconds = Seconds { label: clock.lap(), ..impression.seconds };
            Sample { simulator, impression, numbered: None, label, seconds }
        });
        under_way.place_counts = uneven || samples.iter().any(|finger| finger.impression.contact.total.cut_by_view);
        let frame = described(&under_way, of_frame, &timeline, number, samples, rate);
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
    Ok(Accepted { label, summary, rejected: Vec::new(), seconds: total, effects })
}

/// The label of a frame, and its fingers with what is wrong with the grip.
fn described(
    under_way: &UnderWay<'_>,
    mut hold: Hold,
    timeline: &Timeline<'_>,
    number: u64,
    mut samples: Pair,
    rate: f64,
) -> (GripFrameLabel, Pair) {
    let wrenches = samples.each_ref().map(|finger| finger.impression.sliding.as_ref().map(|slid| slid.wrench));
    let forces_n = wrenches.map(|wrench| wrench.map(|wrench| 0.0 - wrench.force_n[2]));
    // Found for the place before the frame's motion: what the fingers then press with is what counts.
    if let [Some(left), Some(right)] = forces_n {
        hold.balanced &= (left - right).abs() <= 2.0 * TOLERANCE * left.max(right) || hold.presses > 0;
    }
    let missed = hold.missed.take().or_else(|| timeline.missed().map(str::to_owned));
    let reason = missed.or_else(|| unbalanced(&hold, forces_n));
    samples.iter_mut().for_each(|finger| not_healthy(&mut finger.label, reason.as_deref()));
    // Of what presses at z = 0, torque is (y fz, -x fz), and fz is below 0.
    let moments = wrenches.map(|wrench| wrench.map(|wrench| [wrench.torque_nmm[1], 0.0 - wrench.torque_nmm[0]]));
    let gripper = under_way.pair.describe(&hold, &samples[0].label.pose, forces_n, moments);
    let (index, t_s, phase) = (number as u32, (number + 1) as f64 / rate, timeline.phase());
    let [left, right] = samples
        .each_ref()
        .map(|finger| FrameLabel::new(index, t_s, phase, finger.label.clone(), finger.impression.sliding.as_ref()));
    (GripFrameLabel { index, t_s, phase: phase.to_owned(), gripper, left, right }, samples)
}

/// What a phase comes to: half the squeeze at its end.
fn end_of(phase: &DrawnPhase, mover: &Mover<'_>, under_way: &UnderWay<'_>, presses: &[Press; 2]) -> End {
    let wanted_n = match phase.goal {
        Goal::Stay => return End::at(mover.depth_mm),
        Goal::Depth(mm) => return End::at(mm),
        Goal::Force(newtons) => newtons,
    };
    let force_n = |k: usize, depth_mm: f64| under_way.force_n(presses, mover.pose, k, depth_mm);
    let hold = under_way.pair.search(&force_n, |fingers| gripped(fingers, wanted_n));
    let missed = hold.missed.map(|reason| format!("phase `{}`: {reason}", phase.name));
    End { depth_mm: 0.5 * (hold.depth_mm[0] + hold.depth_mm[1]), force_n: wanted_n, missed }
}

/// A motion in the plane of the pad that faces the one that it is seen from.
fn facing(motion: PlanarMotion) -> PlanarMotion {
    let PlanarMotion { shift_mm, turn_rad, about_mm } = motion;
    let mirrored = |[x, y]: [f64; 2]| [0.0 - x, y];
    PlanarMotion { shift_mm: mirrored(shift_mm), turn_rad: 0.0 - turn_rad, about_mm: mirrored(about_mm) }
}
