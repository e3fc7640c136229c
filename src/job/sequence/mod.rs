//! A sequence of a plan: drawn at random, moved, pressed frame by frame, described.

use std::sync::Arc;

use crate::config::output::OnUnhealthy;
use crate::config::sequence::{Phase, Sequence, SequenceFriction};
use crate::force::{DEEPEST, depth_of};
use crate::label::Label;
use crate::plan::Plan;
use crate::sample::{MOST_ATTEMPTS, Sample, Unfit};
use crate::scene::Scene;
use gelsim_core::base::clock::{Clock, Seconds};
use gelsim_core::base::rng;
use gelsim_core::depth::texture::TexturePlacement;
use gelsim_core::effects::{Effect, PerEffect};
use gelsim_core::gelpad::elastic::shear::Friction;
use gelsim_core::mesh::clusters::Clusters;
use gelsim_core::pose::Pose;
use gelsim_core::simulator::Press;
use gelsim_files::sensor::quantity::Quantity;

pub mod label;
pub mod motion;
pub(crate) mod timeline;

use label::{FrameLabel, SequenceInfo, SequenceLabel};
use motion::{DrawnPhase, Goal, Mover};
use timeline::{End, Timeline};

/// A force is found to this share.
const FORCE_TOLERANCE: f64 = 2e-3;

/// Pixels along the longer side of the view of which the contact rolls at most one in a step.
pub(crate) const ROLLING_PX: f64 = 160.0;

/// A sequence that may go into the dataset.
pub struct Accepted<L = SequenceLabel> {
    /// Its label.
    pub label: L,
    /// The same in one.
    pub summary: Label,
    /// What was drawn before it and rejected.
    pub rejected: Vec<Label>,
    /// CPU seconds of all frames.
    pub seconds: Seconds,
    /// The same for each effect.
    pub effects: PerEffect<f64>,
}

/// Draws and renders sequence `index`, again if it is not sound and the plan wants that, and shows each frame to
/// `each`, which is told when a sequence begins anew, and ends the work by an error.
pub fn accept<E: From<Unfit>>(
    plan: &Plan,
    index: u64,
    each: impl FnMut(Shown) -> Result<(), E>,
) -> Result<Accepted, E> {
    accept_by(plan, each, |attempt, each| render(plan, index, attempt, each))
}

/// The same of what `render` renders of the draw after so many rejected ones, and shows frame by frame.
pub fn accept_by<S, L, E: From<Unfit>>(
    plan: &Plan,
    mut each: impl FnMut(Shown<S>) -> Result<(), E>,
    render: impl Fn(u32, &mut dyn FnMut(S, u32) -> Result<(), E>) -> Result<Accepted<L>, E>,
) -> Result<Accepted<L>, E> {
    let mut rejected: Vec<Label> = Vec::new();
    loop {
        let attempt = rejected.len() as u32;
        each(Shown::Begin)?;
        let mut done = render(attempt, &mut |frame, number| each(Shown::Frame(Box::new(frame), number)))?;
        let sound = done.summary.health.healthy || plan.output().on_unhealthy == OnUnhealthy::Keep;
        if sound {
            done.rejected = rejected;
            return Ok(done);
        }
        if plan.output().on_unhealthy == OnUnhealthy::Fail || attempt + 1 == MOST_ATTEMPTS {
            return Err(Unfit(Box::new(done.summary)).into());
        }
        rejected.push(done.summary);
    }
}

/// What is shown of a sequence while it is rendered.
pub enum Shown<S = Sample> {
    /// A draw begins; what was shown before is rejected.
    Begin,
    /// A frame and its number. Its label is that of a press.
    Frame(Box<S>, u32),
}

/// A sequence as it was drawn.
struct Drawn {
    /// At its start, the object just touching the pad.
    scene: Scene,
    object: Arc<Clusters>,
    phases: Vec<DrawnPhase>,
    friction: Friction,
    frame_rate_hz: f64,
}

impl Drawn {
    fn new(plan: &Plan, sequence: &Sequence, index: u64, attempt: u32) -> Self {
        let draw = Drawer { plan, redrawn: rng::redrawn(index, attempt) };
        let phases = draw.phases(sequence, |k, phase| match (&phase.depth_mm, &phase.force_n) {
            (Some(depth), _) => Goal::Depth(draw.of_phase(k, "depth", depth)),
            (None, Some(force)) => Goal::Force(draw.of_phase(k, "force", force)),
            (None, None) => Goal::Stay,
        });
        let scene = Scene::draw(plan, index, attempt);
        let friction = draw.friction(sequence, &scene);
        let object = scene.clusters.clone().expect("an object is drawn");
        Self { phases, friction, frame_rate_hz: sequence.frame_rate_hz, object, scene }
    }
}

/// Draws the phases of a sequence.
pub(crate) struct Drawer<'a> {
    pub plan: &'a Plan,
    /// Number of the streams.
    pub redrawn: u64,
}

impl Drawer<'_> {
    /// A quantity of phase `number`.
    pub fn of_phase(&self, number: usize, name: &str, quantity: &Quantity) -> f64 {
        quantity.sample(&mut rng::stream(self.plan.seed(), &format!("phase {number} {name}"), self.redrawn))
    }

    /// The phases; `goal` draws what each comes to.
    pub fn phases(&self, sequence: &Sequence, goal: impl Fn(usize, &Phase) -> Goal) -> Vec<DrawnPhase> {
        let drawn = |(k, phase): (usize, &Phase)| DrawnPhase {
            name: phase.name.clone().unwrap_or_default(),
            duration_s: self.of_phase(k, "duration", &phase.duration_s),
            goal: goal(k, phase),
            shift_mm: [self.of_phase(k, "x", &phase.x_mm), self.of_phase(k, "y", &phase.y_mm)],
            twist_deg: self.of_phase(k, "twist", &phase.twist_deg),
            tilt_deg: self.of_phase(k, "tilt", &phase.tilt_deg),
            tilt_azimuth_deg: self.of_phase(k, "tilt azimuth", &phase.tilt_azimuth_deg),
            profile: phase.profile,
        };
        sequence.phase.iter().enumerate().map(drawn).collect()
    }

    /// What holds a pad to the object.
    pub fn friction(&self, sequence: &Sequence, scene: &Scene) -> Friction {
        let friction = match &sequence.friction {
            SequenceFriction::Stick => Friction::Stick,
            SequenceFriction::Coefficient(quantity) => Friction::Coulomb {
                coefficient: quantity.sample(&mut rng::stream(self.plan.seed(), "sequence friction", self.redrawn)),
            },
        };
        scene.material.friction.unwrap_or(friction)
    }
}

/// Renders sequence `index` as it is drawn after `attempt` draws were rejected, until `each`, which is shown the frames, fails.
pub fn render<E>(
    plan: &Plan,
    index: u64,
    attempt: u32,
    mut each: impl FnMut(Sample, u32) -> Result<(), E>,
) -> Result<Accepted, E> {
    let plan = plan.of_sample(index, attempt);
    let mut clock = Clock::start();
    let sequence = plan.job().sequence.as_ref().expect("a job of sequences");
    let mut drawn = Drawn::new(plan, sequence, index, attempt);
    let mut total = Seconds { scene: clock.lap(), ..Seconds::default() };
    let simulator = drawn.scene.simulator(plan);
    let mut sliding = simulator.sliding(drawn.friction).expect("a model that knows tractions");
    let (plane, start) = (drawn.scene.plane, drawn.scene.over_plane);
    let laid = TexturePlacement::with(&start);
    let noise_key = drawn.scene.camera.noise_key;
    let view = simulator.view();
    let longest_mm = (0..2).map(|k| view.resolution_px[k] as f64 * view.mm_per_px[k]).fold(0.0, f64::max);
    let about_mm = drawn.scene.motion.about_mm;
    let object = Arc::clone(&drawn.object);
    let mover = Mover::new(&object, drawn.scene.side, start, about_mm, 0.0, longest_mm / ROLLING_PX);

    let rate = drawn.frame_rate_hz;
    let phases = std::mem::take(&mut drawn.phases);
    let mut timeline = Timeline::new(&phases, rate, mover);
    let mut labels: Vec<FrameLabel> = Vec::new();
    let mut first: Option<Label> = None;
    let mut effects = PerEffect::<f64>::default();
    for number in 0..timeline.frames() {
        let mut clock = Clock::start();
        let press = pressed(plan, &drawn.scene, laid);
        let mut steps = timeline.frame(number, |phase, mover| {
            end_of(phase, mover, simulator.sensor().gelpad.thickness_mm, |pose, depth_mm| {
                simulator.force_n(&sliding, &press, plane.placed(pose), depth_mm)
            })
        });
        steps.iter_mut().for_each(|step| step.pose = plane.placed(step.pose));
        total.scene += clock.lap();

        let mover = timeline.mover();
        drawn.scene.pose = plane.placed(mover.pose);
        drawn.scene.indentation_depth_mm = mover.depth_mm.max(0.0);
        // The first frame's noise is a press's.
        drawn.scene.camera.noise_key = match number {
            0 => noise_key,
            _ => rng::stream(noise_key, "sequence frame noise", number).bits(),
        };
        let press = pressed(plan, &drawn.scene, laid);
        let impression = simulator.press_next(&press, &steps, &mut sliding);
        let mut clock = Clock::start();
        let mut label = Label::describe(plan, &drawn.scene, &simulator, &impression, None);
        if let Some(reason) = timeline.missed().filter(|_| label.health.healthy) {
            label.health.healthy = false;
            label.health.reason = reason.to_owned();
        }
        let seconds = Seconds { label: clock.lap(), ..impression.seconds };
        total.add(&seconds);
        for effect in Effect::ALL {
            effects[effect] += impression.effects.seconds[effect];
        }
        first.get_or_insert_with(|| label.clone());
        let slid = impression.sliding.as_ref();
        let t_s = (number + 1) as f64 / rate;
        labels.push(FrameLabel::new(number as u32, t_s, timeline.phase(), label.clone(), slid));
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
    Ok(Accepted { label, summary, rejected: Vec::new(), seconds: total, effects })
}

/// A frame's press, with the texture where it lay at the start.
pub(crate) fn pressed(plan: &Plan, scene: &Scene, laid: TexturePlacement) -> Press {
    let mut press = scene.press(plan);
    press.texture = press.texture.map(|texture| texture.laid_out(laid));
    press
}

/// What a phase comes to; `press_n` presses the object at a pose so deep.
fn end_of(phase: &DrawnPhase, mover: &Mover<'_>, thickness_mm: f64, press_n: impl Fn(Pose, f64) -> f64) -> End {
    let wanted_n = match phase.goal {
        Goal::Stay => return End::at(mover.depth_mm),
        Goal::Depth(mm) => return End::at(mm),
        Goal::Force(newtons) => newtons,
    };
    // Where the object is then, whatever its depth.
    let mut there = mover.clone();
    there.go(phase, 1.0, mover.depth_mm, &mut Vec::new());
    let force_n = |depth_mm: f64| press_n(there.at_depth(depth_mm), depth_mm);
    let deepest = DEEPEST * thickness_mm;
    let most_n = force_n(deepest);
    if most_n < wanted_n {
        let reason = format!(
            "phase `{}` wants {wanted_n:.3} N, but at {deepest:.3} mm, {DEEPEST} of the pad's thickness, there are only {most_n:.3} N",
            phase.name
        );
        return End { depth_mm: deepest, force_n: wanted_n, missed: Some(reason) };
    }
    let depth_mm = depth_of(wanted_n, (deepest, most_n), FORCE_TOLERANCE, force_n);
    End { depth_mm, force_n: wanted_n, missed: None }
}
