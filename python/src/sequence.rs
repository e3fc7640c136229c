//! Sequences of `gelsim.Simulator`: frame after frame, with friction that remembers; several sensors at once.

use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Arc, Mutex, PoisonError};

use gelsim_core::base::rng;
use gelsim_core::depth::indenter::Shape;
use gelsim_core::depth::texture::TexturePlacement;
use gelsim_core::gelpad::elastic::shear::Friction;
use gelsim_core::gelpad::planar::PlanarMotion;
use gelsim_core::gelpad::sliding::{ObjectStep, Sliding};
use gelsim_core::mesh::clusters::Clusters;
use gelsim_core::pose::Pose;
use gelsim_core::simulator::Simulator;
use gelsim_dataset::frames::sequence::{find_position_error, motion_between, turn_rad};
use gelsim_job::plan::Plan;
use gelsim_job::scene::{DrawnTexture, Scene};
use gelsim_job::sequence::label::FrameLabel;
use gelsim_job::sequence::motion::count_relaxing_steps;
use glam::{DMat3, DQuat, DVec3};
use pyo3::prelude::*;
use rayon::prelude::*;

use crate::arguments::{OptionalArgument, extract_number, extract_whole_number};
use crate::errors::{mistake_error, name_sensors, panic_error, runtime_error, usage_error};
use crate::job::ALLOWED_SEEDS;
use crate::sensor::ALLOWED_INDICES;
use crate::simulator::{
    Engine, ObjectPlace, ObjectSite, PlacedObject, Pressing, TextureArgument, build_scene, label_sample,
};
use crate::threads::{extract_thread_count, shared_pool};

/// A contact rolls in one step by at most the longer side of the view over this.
const ROLLING_PX: f64 = 160.0;

/// Largest turn in one step, degrees: friction takes the straight chord for the path.
const MAX_TURN_DEG: f64 = 5.0;

/// Most steps in a frame: how an object moved that turned further is unknown.
const MAX_STEPS: f64 = 400.0;

/// Fraction of the depth at which an object first touches within its frame, as in a job's sequences.
const FIRST_TOUCH: f64 = 1.0 / 16.0;

/// Friction unless the caller gives one, as in a job's `[sequence]`.
const DEFAULT_FRICTION: Friction = Friction::Coulomb { coefficient: 0.6 };

/// The number of the next frame that is rendered.
static NEXT_FRAME: AtomicU64 = AtomicU64::new(0);

/// The sequence of a simulator. Its lock is taken only while the GIL is held, and only briefly: a process that is forked
/// never finds it taken.
pub struct Sequence(Mutex<SequenceState>);

/// State of a sequence.
enum SequenceState {
    /// Before its first frame.
    Begun(SequenceStart),
    Moving(Box<MovingSequence>),
    /// A thread is rendering a frame of it: the one with this number among all frames of the process.
    Busy(u64),
}

/// Settings with which a sequence begins.
#[derive(Clone, Copy)]
struct SequenceStart {
    friction: Friction,
    index: u64,
    seed: u64,
}

/// State of a sequence after a frame.
struct MovingSequence {
    begun: SequenceStart,
    /// Scene of the first frame. What it draws for print, camera and unit holds for all frames.
    first_scene: Scene,
    simulator: Arc<Simulator>,
    sliding: Sliding,
    last_pose: Pose,
    last_depth_mm: f64,
    /// Placement of the texture in the first frame: it moves with the object.
    texture_placement: TexturePlacement,
    frame_count: u64,
}

/// A frame that was read and can be rendered.
struct Step {
    object: PlacedObject,
    texture: Option<DrawnTexture>,
    duration_s: f64,
}

/// What a caller gives of a frame: the object's name, the object, its place and its texture.
type StepArguments<'py> = (String, Bound<'py, PyAny>, Option<ObjectPlace>, Option<TextureArgument>);

/// State of a sequence while a frame of it is rendered. It is put back when this is dropped, which needs the GIL.
struct TakenState<'a> {
    engine: &'a Engine,
    frame: u64,
    begun: SequenceStart,
    /// `None` before the first frame, and after a frame that failed.
    moving: Option<Box<MovingSequence>>,
}

impl Default for Sequence {
    fn default() -> Self {
        let begun = SequenceStart { friction: DEFAULT_FRICTION, index: 0, seed: 0 };
        Self(Mutex::new(SequenceState::Begun(begun)))
    }
}

impl Sequence {
    /// Begins a new sequence.
    pub fn begin(
        &self,
        friction: Option<f64>,
        index: OptionalArgument<'_, '_>,
        seed: OptionalArgument<'_, '_>,
    ) -> PyResult<()> {
        let begun = SequenceStart {
            friction: friction.map_or(Friction::Stick, |coefficient| Friction::Coulomb { coefficient }),
            index: extract_whole_number("index", index, ALLOWED_INDICES)?.unwrap_or(0),
            seed: extract_whole_number("seed", seed, ALLOWED_SEEDS)?.unwrap_or(0),
        };
        *self.0.lock().unwrap_or_else(PoisonError::into_inner) = SequenceState::Begun(begun);
        Ok(())
    }
}

impl Drop for TakenState<'_> {
    fn drop(&mut self) {
        let mut sequence = self.engine.sequence.0.lock().unwrap_or_else(PoisonError::into_inner);
        // Another sequence may have begun meanwhile.
        if matches!(*sequence, SequenceState::Busy(frame) if frame == self.frame) {
            let begun = SequenceState::Begun(self.begun);
            *sequence = self.moving.take().map_or(begun, SequenceState::Moving);
        }
    }
}

/// Renders the next frame of the sequence of each engine; of several at once on the threads of a pool. Nothing is
/// rendered if one of the frames cannot be.
#[pyfunction]
pub fn step_all(
    py: Python<'_>,
    engines: Vec<Bound<'_, Engine>>,
    steps: Vec<StepArguments<'_>>,
    duration_s: &Bound<'_, PyAny>,
    threads: OptionalArgument<'_, '_>,
) -> PyResult<Vec<Pressing>> {
    let threads = extract_thread_count(threads)?;
    let duration_s = extract_number("duration_s", duration_s)?;
    if !(0.0..=1e6).contains(&duration_s) {
        let help = "seconds since the frame before, 0 to 1000000";
        return Err(mistake_error(format!("duration_s={duration_s} is out of range"), help));
    }
    let (mut taken, mut wrong) = (Vec::new(), Vec::new());
    for (number, (engine, arguments)) in engines.iter().zip(steps).enumerate() {
        match engine.get().read_step(py, arguments, duration_s).and_then(|step| Ok((engine.get().take(&step)?, step))) {
            Ok(ready) => taken.push(ready),
            Err(error) => wrong.push((number, error)),
        }
    }
    if !wrong.is_empty() {
        return Err(name_sensors(py, wrong, engines.len()));
    }
    let rendered: Vec<_> = if taken.len() > 1 {
        let pool = shared_pool(py, threads)?;
        py.detach(|| pool.install(|| taken.into_par_iter().map(TakenState::render_next).collect()))
    } else {
        py.detach(|| taken.into_iter().map(TakenState::render_next).collect())
    };
    rendered.into_iter().map(|(_, frame)| frame).collect()
}

impl Engine {
    /// Reads the next frame. Fails if it cannot be rendered by itself.
    fn read_step(&self, py: Python<'_>, given: StepArguments<'_>, duration_s: f64) -> PyResult<Step> {
        let (name, object, pose, texture) = given;
        if !self.plan.simulator.models().gelpad.knows_tractions() {
            let message = format!("fidelity `{}` knows no friction, and so no sequence", self.plan.fidelity().name());
            return Err(mistake_error(message, "take a finer level, such as gelsim.Simulator(sensor, \"draft\")"));
        }
        if let Some(strain) = self.plan.simulator.models().gelpad.strain_settings() {
            let (what, help) = match strain.thorough {
                true => ("the fidelity level finite-strain", "take gelsim.Simulator(sensor, \"high\")"),
                false => ("gelpad.elastic.strain_correction", "leave it out"),
            };
            return Err(mistake_error(format!("{what} is for single presses, not for the frames of a sequence"), help));
        }
        if pose.is_none() {
            let help =
                "gelsim.Placement says where the object is of which heights are given; a mesh takes gelsim.Pose, too";
            return Err(mistake_error("a frame of a sequence needs a pose: friction follows the object", help));
        }
        let object = self.read_object(py, &name, &object, pose.as_ref())?;
        if let Some(problem) = find_position_error(&object.site.pose) {
            return Err(usage_error(&problem.into()));
        }
        let texture = texture.map(|cut| self.make_texture(py, &cut)).transpose()?;
        Ok(Step { object, texture, duration_s })
    }

    /// Takes the state of the sequence for its next frame. Fails if that cannot follow the last one, and changes nothing
    /// then.
    fn take(&self, step: &Step) -> PyResult<TakenState<'_>> {
        let mut sequence = self.sequence.0.lock().unwrap_or_else(PoisonError::into_inner);
        if let SequenceState::Moving(moving) = &*sequence {
            moving.check_step(&self.plan, &step.object)?;
        }
        let frame = NEXT_FRAME.fetch_add(1, Ordering::Relaxed);
        let (begun, moving) = match std::mem::replace(&mut *sequence, SequenceState::Busy(frame)) {
            SequenceState::Begun(begun) => (begun, None),
            SequenceState::Moving(moving) => (moving.begun, Some(moving)),
            SequenceState::Busy(other) => {
                *sequence = SequenceState::Busy(other);
                let help = "simulator.copy() has a sequence of its own, and simulator.reset() begins another one";
                return Err(runtime_error(format!(
                    "another thread is at a frame of this simulator's sequence: {help}"
                )));
            }
        };
        Ok(TakenState { engine: self, frame, begun, moving })
    }
}

impl TakenState<'_> {
    /// Renders the next frame. Returns the state after it, too.
    fn render_next((mut state, step): (Self, Step)) -> (Self, PyResult<Pressing>) {
        let frame = catch_unwind(AssertUnwindSafe(|| {
            let plan = state.engine.plan_with_seed(state.begun.seed)?;
            let (moving, frame) = render_next_frame(&plan, (state.begun, state.moving.take()), step);
            state.moving = Some(moving);
            Ok(frame)
        }));
        (state, frame.unwrap_or_else(|panic| Err(panic_error("this frame", &*panic))))
    }
}

/// Renders the frame after `moving`, or the first one of a sequence. Returns the new state, and the frame.
fn render_next_frame(
    plan: &Plan,
    (begun, moving): (SequenceStart, Option<Box<MovingSequence>>),
    Step { object, texture, duration_s }: Step,
) -> (Box<MovingSequence>, Pressing) {
    let site = object.site;
    let ObjectSite { pose, depth_mm, plane: tangent, .. } = site;
    let shape = object.shape.clone();
    let drawn = build_scene(plan, begun.index, object, texture);
    let mut moving = moving.unwrap_or_else(|| {
        let simulator = drawn.simulator(plan);
        let sliding = simulator.sliding(begun.friction).expect("the model knows tractions");
        let placement = TexturePlacement::at_pose(&pose);
        // In the first frame the object comes straight down to its pose.
        let last = match tangent {
            Some(plane) => Pose { translation_mm: pose.translation_mm + depth_mm * plane.axes.z_axis, ..pose },
            None => shape.clusters().map_or(pose, |mesh| pose.lowered(0.0, mesh)),
        };
        Box::new(MovingSequence {
            begun,
            first_scene: drawn.clone(),
            simulator,
            sliding,
            last_pose: last,
            last_depth_mm: 0.0,
            texture_placement: placement,
            frame_count: 0,
        })
    });
    let noise_key = moving.first_scene.camera.noise_key;
    // The first frame has the noise of a press; each further one its own.
    let noise_key = match moving.frame_count {
        0 => noise_key,
        frame => rng::random_stream(noise_key, "sequence frame noise", frame).next_bits(),
    };
    let Scene { pressed, pose, plane, indentation_depth_mm, motion, texture, .. } = drawn;
    let first = moving.first_scene.clone();
    let mut scene = Scene { pressed, pose, over_plane: pose, plane, indentation_depth_mm, motion, texture, ..first };
    scene.camera.noise_key = noise_key;
    let mut press = scene.to_press(plan);
    press.texture = press.texture.map(|texture| texture.with_placement(moving.texture_placement));
    press.shear = None;
    let steps = moving.plan_steps(plan, &shape, &site, duration_s);
    let impression = moving.simulator.press_next(&press, &steps, &mut moving.sliding);
    let sample = label_sample(plan, &scene, Arc::clone(&moving.simulator), impression);
    let sliding = sample.impression.sliding.as_ref();
    let frame = FrameLabel::new(moving.frame_count as u32, 0.0, "", sample.label.clone(), sliding);
    let number = moving.frame_count;
    (moving.last_pose, moving.last_depth_mm, moving.frame_count) = (pose, depth_mm, number + 1);
    (moving, Pressing::new(sample, Some((number, frame))))
}

impl MovingSequence {
    /// Fails if the object has turned too far since the previous frame.
    fn check_step(&self, plan: &Plan, object: &PlacedObject) -> PyResult<()> {
        // Heights cannot be turned on the way, so a height map gets a single step.
        let most = if matches!(object.shape, Shape::Mesh(_)) { MAX_STEPS } else { 2.0 };
        let normal = object.site.plane.unwrap_or_default().axes.z_axis;
        if self.count_longest_steps(plan, &object.shape, &object.site.pose, normal) <= most + 1e-9 {
            return Ok(());
        }
        let turn_deg = turn_rad(self.last_pose, object.site.pose, normal).to_degrees();
        let about = if normal == DVec3::Z { "z" } else { "the gel's normal" };
        let message =
            format!("the object has turned too far since the frame before ({turn_deg:.1} degrees about {about})");
        Err(mistake_error(
            message,
            "give frames between, in which it turns by 10 degrees at most; reset() begins another sequence",
        ))
    }

    /// Returns how many of the longest allowed steps lead from the last pose to another on a pad with this normal; a
    /// fraction of one for less.
    fn count_longest_steps(&self, plan: &Plan, shape: &Shape, to: &Pose, normal: DVec3) -> f64 {
        let turned = to.rotation * self.last_pose.rotation.transpose() * normal;
        let tilt_deg = turned.dot(normal).clamp(-1.0, 1.0).acos().to_degrees();
        let longest_mm = longest_mm(plan);
        let radius_mm = match shape.clusters() {
            Some(mesh) => {
                let reach = [DVec3::X, DVec3::Y, DVec3::Z]
                    .map(|axis| mesh.extreme(axis.to_array()).max(mesh.extreme((-axis).to_array())));
                reach.into_iter().fold(1e-6, f64::max)
            }
            None => longest_mm,
        };
        let most_tilt_deg = (longest_mm / ROLLING_PX / radius_mm).to_degrees().clamp(0.05, MAX_TURN_DEG);
        let turn_deg = turn_rad(self.last_pose, *to, normal).to_degrees().abs();
        (turn_deg / MAX_TURN_DEG).max(tilt_deg / most_tilt_deg)
    }

    /// Plans the steps from the last frame to the next, as a job's sequences do.
    fn plan_steps(&self, plan: &Plan, shape: &Shape, site: &ObjectSite, duration_s: f64) -> Vec<ObjectStep> {
        let ObjectSite { pose: to, depth_mm, plane: tangent, deepest_mm } = *site;
        let (from, from_mm, plane) = (self.last_pose, self.last_depth_mm, tangent.unwrap_or_default());
        // What a frame shows cannot be seen from elsewhere, so it gets a single step.
        let Shape::Mesh(mesh) = shape else {
            let motion = deepest_mm.map_or_else(PlanarMotion::default, |now| motion_between(from, to, now, &plane));
            return vec![ObjectStep { pose: to, depth_mm, motion, duration_s }];
        };
        let mut way = self.count_longest_steps(plan, shape, &to, plane.axes.z_axis);
        if !plan.simulator.sensor().relaxation.is_empty() {
            let shift_mm = (plane.axes.transpose() * (to.translation_mm - from.translation_mm)).truncate().length();
            way = way.max(count_relaxing_steps(longest_mm(plan), shift_mm, [from_mm, depth_mm]));
        }
        // A step ends just after the first touch, so that friction begins near its true place.
        let touches =
            (from_mm <= 0.0 && depth_mm > 0.0).then(|| (FIRST_TOUCH * depth_mm - from_mm) / (depth_mm - from_mm));
        let [from_turn, to_turn] = [from, to].map(|pose| DQuat::from_mat3(&pose.rotation));
        let mut before = from;
        let mut steps = Vec::new();
        let mut start = 0.0;
        for end in touches.into_iter().chain([1.0]) {
            let count = (way * (end - start) - 1e-9).ceil().clamp(1.0, MAX_STEPS) as u32;
            for step in 1..=count {
                let share = start + (end - start) * f64::from(step) / f64::from(count);
                let (pose, depth_mm) = if end == 1.0 && step == count {
                    (to, depth_mm)
                } else {
                    let depth_mm = from_mm + (depth_mm - from_mm) * share;
                    let rotation = DMat3::from_quat(from_turn.slerp(to_turn, share));
                    let translation_mm = from.translation_mm.lerp(to.translation_mm, share);
                    let between = Pose { rotation, translation_mm, ..to };
                    (if tangent.is_some() { between } else { between.lowered(0.0 - depth_mm, mesh) }, depth_mm)
                };
                let deepest = if tangent.is_some() {
                    deepest_point(&self.simulator, mesh, &pose)
                } else {
                    lowest_point(mesh, &pose)
                };
                let motion = motion_between(before, pose, deepest, &plane);
                let duration_s = duration_s * (end - start) / f64::from(count);
                steps.push(ObjectStep { pose, depth_mm, motion, duration_s });
                before = pose;
            }
            start = end;
        }
        steps
    }
}

/// Returns the longer side of the view, mm.
fn longest_mm(plan: &Plan) -> f64 {
    let view = plan.simulator.view();
    (0..2).map(|k| view.resolution_px[k] as f64 * view.mm_per_px[k]).fold(0.0, f64::max)
}

/// Returns the point of a placed mesh that is deepest in a gel, or nearest to it, mm.
fn deepest_point(simulator: &Simulator, mesh: &Clusters, pose: &Pose) -> DVec3 {
    let (plane, depth_mm) = simulator.find_contact_plane(mesh, pose);
    plane.origin_mm - depth_mm * plane.axes.z_axis
}

/// Returns the lowest point of a placed mesh, mm.
fn lowest_point(mesh: &Clusters, pose: &Pose) -> DVec3 {
    let down = (pose.rotation.transpose() * DVec3::NEG_Z).to_array();
    // Points within 1 um of the lowest count, and their middle is taken: the middle of a flat face.
    let lowest = mesh.extreme_point(down, mesh.extreme(down), 1e-3);
    let centre = DVec3::from_array(mesh.centre_mm());
    pose.rotation * (centre + DVec3::from_array(lowest)) + pose.translation_mm
}
