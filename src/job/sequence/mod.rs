//! Renders sequences of a plan: each is drawn at random, moved, pressed frame by frame, and labelled.

use std::sync::Arc;

use crate::config::output::OnUnhealthy;
use crate::config::sequence::{Phase, Sequence, SequenceFriction};
use crate::force::{FORCE_TOLERANCE, MAX_DEPTH_RATIO, find_depth_for_force};
use crate::label::Label;
use crate::plan::Plan;
use crate::sample::{MAX_ATTEMPTS, RejectedSample, Sample};
use crate::scene::Scene;
use gelsim_core::base::clock::{Seconds, ThreadClock};
use gelsim_core::base::rng;
use gelsim_core::depth::texture::TexturePlacement;
use gelsim_core::effects::{Effect, PerEffect};
use gelsim_core::gelpad::elastic::shear::Friction;
use gelsim_core::gelpad::sliding::ObjectStep;
use gelsim_core::impression::Impression;
use gelsim_core::mesh::clusters::Clusters;
use gelsim_core::simulator::Press;
use gelsim_files::sensor::quantity::Quantity;

pub mod label;
pub mod motion;
pub(crate) mod timeline;

use label::{FrameLabel, PhaseLabel, SequenceInfo, SequenceLabel};
use motion::{DrawnPhase, ObjectMover, PartOfPhase, PhaseGoal};
use timeline::{PhaseEnd, Timeline};

/// In one step the contact rolls at most over one of this many parts of the view's longer side.
const ROLLING_PX: f64 = 160.0;

/// A sequence that may go into the dataset, and the rejected draws before it.
pub struct AcceptedSequence<L = SequenceLabel> {
    /// Label of the sequence.
    pub label: L,
    /// One label that stands for all frames; see [`SequenceLabel::summary`].
    pub summary: Label,
    /// Labels of the draws before it that were rejected.
    pub rejected: Vec<Label>,
    /// CPU seconds of all frames.
    pub seconds: Seconds,
    /// CPU seconds of each effect, in all frames.
    pub effects: PerEffect<f64>,
}

/// Draws and renders sequence `index`, again if it is not healthy and the plan rejects such, and calls `each` with
/// every event. An error of `each` ends the work.
pub fn accept_sequence<E: From<RejectedSample>>(
    plan: &Plan,
    index: u64,
    each: impl FnMut(SequenceEvent) -> Result<(), E>,
) -> Result<AcceptedSequence, E> {
    accept_rendered(plan, each, |attempt, each| render(plan, index, attempt, each))
}

/// Renders sequences by `render` until one is accepted, as [`accept_sequence`] does. `render` gets the number of
/// rejected draws, and calls its argument with each frame.
pub fn accept_rendered<S, L, E: From<RejectedSample>>(
    plan: &Plan,
    mut each: impl FnMut(SequenceEvent<S>) -> Result<(), E>,
    render: impl Fn(u32, &mut dyn FnMut(S, u32) -> Result<(), E>) -> Result<AcceptedSequence<L>, E>,
) -> Result<AcceptedSequence<L>, E> {
    let mut rejected: Vec<Label> = Vec::new();
    loop {
        let attempt = rejected.len() as u32;
        each(SequenceEvent::Begin)?;
        let mut done = render(attempt, &mut |frame, number| each(SequenceEvent::Frame(Box::new(frame), number)))?;
        let accepted = done.summary.health.healthy || plan.output().on_unhealthy == OnUnhealthy::Keep;
        if accepted {
            done.rejected = rejected;
            return Ok(done);
        }
        if plan.output().on_unhealthy == OnUnhealthy::Fail || attempt + 1 == MAX_ATTEMPTS {
            return Err(RejectedSample(Box::new(done.summary)).into());
        }
        rejected.push(done.summary);
    }
}

/// What happens while a sequence is rendered.
pub enum SequenceEvent<S = Sample> {
    /// A draw begins. Frames that came before are rejected.
    Begin,
    /// A frame and its number. Its label is that of a press.
    Frame(Box<S>, u32),
}

/// A sequence as it was drawn.
struct DrawnSequence {
    /// The scene at the start, with the object just touching the pad.
    scene: Scene,
    object: Arc<Clusters>,
    phases: Vec<DrawnPhase>,
    friction: Friction,
    frame_rate_hz: f64,
}

impl DrawnSequence {
    fn new(plan: &Plan, sequence: &Sequence, index: u64, attempt: u32) -> Self {
        let draw = SequenceDrawer { plan, redrawn: rng::redraw_index(index, attempt) };
        let phases = draw.draw_phases(sequence, |k, phase| match (&phase.depth_mm, &phase.force_n) {
            (Some(depth), _) => PhaseGoal::Depth(draw.draw_for_phase(k, "depth", depth)),
            (None, Some(force)) => PhaseGoal::Force(draw.draw_for_phase(k, "force", force)),
            (None, None) => PhaseGoal::Stay,
        });
        let scene = Scene::draw(plan, index, attempt);
        let friction = draw.draw_friction(sequence, &scene);
        let object = scene.clusters.clone().expect("an object is drawn");
        Self { phases, friction, frame_rate_hz: sequence.frame_rate_hz, object, scene }
    }
}

/// Draws the quantities of a sequence.
pub(crate) struct SequenceDrawer<'a> {
    pub plan: &'a Plan,
    /// Index of the random streams.
    pub redrawn: u64,
}

impl SequenceDrawer<'_> {
    /// Draws a quantity of phase `number`.
    pub fn draw_for_phase(&self, number: usize, name: &str, quantity: &Quantity) -> f64 {
        quantity.sample(&mut rng::random_stream(self.plan.seed(), &format!("phase {number} {name}"), self.redrawn))
    }

    /// Draws the phases. `goal` draws the depth or force at the end of each.
    pub fn draw_phases(&self, sequence: &Sequence, goal: impl Fn(usize, &Phase) -> PhaseGoal) -> Vec<DrawnPhase> {
        let drawn = |(k, phase): (usize, &Phase)| DrawnPhase {
            name: phase.name.clone().unwrap_or_default(),
            duration_s: self.draw_for_phase(k, "duration", &phase.duration_s),
            goal: goal(k, phase),
            shift_mm: [self.draw_for_phase(k, "x", &phase.x_mm), self.draw_for_phase(k, "y", &phase.y_mm)],
            twist_deg: self.draw_for_phase(k, "twist", &phase.twist_deg),
            tilt_deg: self.draw_for_phase(k, "tilt", &phase.tilt_deg),
            tilt_azimuth_deg: self.draw_for_phase(k, "tilt azimuth", &phase.tilt_azimuth_deg),
            profile: phase.profile,
        };
        sequence.phase.iter().enumerate().map(drawn).collect()
    }

    /// Draws the friction between the pad and the object.
    pub fn draw_friction(&self, sequence: &Sequence, scene: &Scene) -> Friction {
        let friction = match &sequence.friction {
            SequenceFriction::Stick => Friction::Stick,
            SequenceFriction::Coefficient(quantity) => Friction::Coulomb {
                coefficient: quantity.sample(&mut rng::random_stream(
                    self.plan.seed(),
                    "sequence friction",
                    self.redrawn,
                )),
            },
        };
        scene.material.friction.unwrap_or(friction)
    }
}

/// Renders sequence `index` as it is drawn after `attempt` rejected draws. Calls `each` with every frame, and stops at
/// its first error.
pub fn render<E>(
    plan: &Plan,
    index: u64,
    attempt: u32,
    mut each: impl FnMut(Sample, u32) -> Result<(), E>,
) -> Result<AcceptedSequence, E> {
    let plan = plan.for_sample(index, attempt);
    let mut clock = ThreadClock::start();
    let sequence = plan.job().sequence.as_ref().expect("a job of sequences");
    let mut drawn = DrawnSequence::new(plan, sequence, index, attempt);
    let mut total = Seconds { scene: clock.lap(), ..Seconds::default() };
    let simulator = drawn.scene.simulator(plan);
    let mut sliding = simulator.sliding(drawn.friction).expect("a model that knows tractions");
    let (plane, start) = (drawn.scene.plane, drawn.scene.over_plane);
    let placement = TexturePlacement::at_pose(&start);
    let noise_key = drawn.scene.camera.noise_key;
    let view = simulator.view();
    let longest_mm = (0..2).map(|k| view.resolution_px[k] as f64 * view.mm_per_px[k]).fold(0.0, f64::max);
    let about_mm = drawn.scene.motion.about_mm;
    let object = Arc::clone(&drawn.object);
    let relaxes = !simulator.sensor().relaxation.is_empty();
    let mover = ObjectMover::new(&object, drawn.scene.facing, start, about_mm, 0.0, longest_mm, relaxes);

    let rate = drawn.frame_rate_hz;
    let phases = std::mem::take(&mut drawn.phases);
    let mut timeline = Timeline::new(&phases, rate, mover);
    let mut labels: Vec<FrameLabel> = Vec::new();
    let mut first: Option<Label> = None;
    let mut effects = PerEffect::<f64>::default();
    for number in 0..timeline.frame_count() {
        let mut clock = ThreadClock::start();
        let press = build_frame_press(plan, &drawn.scene, placement);
        let mut steps = timeline.advance_to_frame(number, |phase, mover| {
            find_phase_end(phase, mover, simulator.sensor().gelpad.thickness_mm, |at_end, depth_mm| {
                if relaxes {
                    let mut steps = steps_through_phase(phase, mover, depth_mm, rate);
                    steps.iter_mut().for_each(|step| step.pose = plane.pose_in_sensor(step.pose));
                    simulator.force_after_n(&sliding, &press, &steps)
                } else {
                    simulator.force_n(&sliding, &press, plane.pose_in_sensor(at_end.at_depth(depth_mm)), depth_mm)
                }
            })
        });
        steps.iter_mut().for_each(|step| step.pose = plane.pose_in_sensor(step.pose));
        total.scene += clock.lap();

        let mover = timeline.mover();
        drawn.scene.pose = plane.pose_in_sensor(mover.pose);
        drawn.scene.indentation_depth_mm = mover.depth_mm.max(0.0);
        // The noise of the first frame is that of a press.
        drawn.scene.camera.noise_key = match number {
            0 => noise_key,
            _ => rng::random_stream(noise_key, "sequence frame noise", number).next_bits(),
        };
        let press = build_frame_press(plan, &drawn.scene, placement);
        let impression = simulator.press_next(&press, &steps, &mut sliding);
        let mut clock = ThreadClock::start();
        let mut label = Label::describe(plan, &drawn.scene, &simulator, &impression, None);
        let missed =
            timeline.failure().map(str::to_owned).or_else(|| find_force_beyond(timeline.phase()?, &impression));
        if let Some(reason) = missed.filter(|_| label.health.healthy) {
            label.health.healthy = false;
            label.health.reason = reason;
        }
        let seconds = Seconds { label: clock.lap(), ..impression.seconds };
        total.add(&seconds);
        for effect in Effect::ALL {
            effects[effect] += impression.effects.seconds[effect];
        }
        first.get_or_insert_with(|| label.clone());
        let sliding_state = impression.sliding.as_ref();
        let t_s = (number + 1) as f64 / rate;
        labels.push(FrameLabel::new(number as u32, t_s, timeline.phase_name(), label.clone(), sliding_state));
        each(Sample { simulator: Arc::clone(&simulator), impression, numbered: None, label, seconds }, number as u32)?;
    }
    let info = SequenceInfo {
        frame_rate_hz: rate,
        frames: labels.len() as u32,
        friction_coefficient: drawn.friction.coefficient(),
        phases: timeline.into_labels(),
        ..SequenceInfo::default()
    };
    let first = first.expect("a sequence has a frame");
    let label = SequenceLabel::new(&first, info, labels);
    let summary = label.summary().expect("a sequence has a frame");
    Ok(AcceptedSequence { label, summary, rejected: Vec::new(), seconds: total, effects })
}

/// Returns why a phase that wants a force is not met, if the object presses with much more than what a sequence computes:
/// the contact in view and a little beyond.
fn find_force_beyond(phase: &PhaseLabel, impression: &Impression) -> Option<String> {
    /// Largest ratio of the force of the entire object to that which is computed.
    const MOST: f64 = 1.25;
    let (all_n, computed_n) =
        (impression.contact.total.total_force_n?, -impression.sliding.as_ref()?.wrench.force_n[2]);
    let is_beyond = phase.force_n > 0.0 && impression.contact.total.cut_by_view && all_n > MOST * computed_n;
    is_beyond.then(|| {
        format!(
            "phase `{}` wants {:.3} N, but the object presses with {all_n:.3} N, of which {computed_n:.3} N are in view and 1.5 \
             thicknesses around it, where sequences find their forces",
            phase.name, phase.force_n
        )
    })
}

/// Makes the press of a frame, with the texture placed on the object as at the start.
pub(crate) fn build_frame_press(plan: &Plan, scene: &Scene, placement: TexturePlacement) -> Press {
    let mut press = scene.to_press(plan);
    press.texture = press.texture.map(|texture| texture.with_placement(placement));
    press
}

/// Returns the steps through a phase that ends at a depth.
fn steps_through_phase(
    phase: &DrawnPhase,
    mover: &ObjectMover<'_>,
    depth_mm: f64,
    frame_rate_hz: f64,
) -> Vec<ObjectStep> {
    let mut timeline = Timeline::new(std::slice::from_ref(phase), frame_rate_hz, mover.clone());
    let frames = 0..timeline.frame_count();
    frames.flat_map(|frame| timeline.advance_to_frame(frame, |_, _| PhaseEnd::at_depth(depth_mm))).collect()
}

/// Returns the depth at the end of a phase. `press_n` returns the force at a depth, N, of the object where the phase ends.
fn find_phase_end(
    phase: &DrawnPhase,
    mover: &ObjectMover<'_>,
    thickness_mm: f64,
    press_n: impl Fn(&ObjectMover<'_>, f64) -> f64,
) -> PhaseEnd {
    let wanted_n = match phase.goal {
        PhaseGoal::Stay => return PhaseEnd::at_depth(mover.depth_mm),
        PhaseGoal::Depth(mm) => return PhaseEnd::at_depth(mm),
        PhaseGoal::Force(newtons) => newtons,
    };
    // A force is wanted at the phase's end, so search at the place to which its motion leads.
    let mut at_end = mover.clone();
    let whole = PartOfPhase { share: 1.0, depth_mm: mover.depth_mm, duration_s: phase.duration_s };
    at_end.advance(phase, whole, &mut Vec::new());
    let force_n = |depth_mm: f64| press_n(&at_end, depth_mm);
    let deepest = MAX_DEPTH_RATIO * thickness_mm;
    let most_n = force_n(deepest);
    if most_n < wanted_n {
        let reason = format!(
            "phase `{}` wants {wanted_n:.3} N, but at {deepest:.3} mm, {MAX_DEPTH_RATIO} of the pad's thickness, there are only {most_n:.3} N",
            phase.name
        );
        return PhaseEnd { depth_mm: deepest, force_n: wanted_n, failure: Some(reason) };
    }
    let depth_mm = find_depth_for_force(wanted_n, (deepest, most_n), FORCE_TOLERANCE, force_n);
    PhaseEnd { depth_mm, force_n: wanted_n, failure: None }
}
