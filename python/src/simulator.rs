//! The engine of `gelsim.Simulator`: presses meshes and height maps one by one, or frame after frame with friction.
//! `python/gelsim/simulator.py` has the class that users see.

use std::any::Any;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::{Arc, Mutex, PoisonError};

use gelsim_core::base::clock::Seconds;
use gelsim_core::base::rng;
use gelsim_core::depth::height_map::HeightMap;
use gelsim_core::depth::indenter::Shape;
use gelsim_core::depth::patterns::Procedural;
use gelsim_core::depth::relief::Relief;
use gelsim_core::depth::texture::{TexturePlacement, TextureSample};
use gelsim_core::gelpad::elastic::elastic_object::ElasticObject;
use gelsim_core::gelpad::elastic::shear::{Friction, Motion};
use gelsim_core::gelpad::planar::PlanarMotion;
use gelsim_core::gelpad::sliding::{ObjectStep, Sliding};
use gelsim_core::gelpad::tangential::Shear;
use gelsim_core::impression::Impression;
use gelsim_core::mesh::clusters::Clusters;
use gelsim_core::pose::{Anchor, Angles, PadPlane, Pose, Side};
use gelsim_core::simulator::Simulator;
use gelsim_dataset::encode::to_json_line;
use gelsim_dataset::frames::sequence::{find_lowest_point, motion_between, turn_rad};
use gelsim_job::label::Label;
use gelsim_job::layers::OutputLayer;
use gelsim_job::layout::Split;
use gelsim_job::plan::{Plan, SampleSources};
use gelsim_job::sample::Sample;
use gelsim_job::scene::{DepthFrame, DrawnTexture, KnownPress, PressSource, Scene};
use gelsim_job::sequence::label::FrameLabel;
use gelsim_job::sequence::motion::count_relaxing_steps;
use glam::{DMat3, DQuat, DVec3};
use pyo3::prelude::*;
use pyo3::types::PyDict;

use crate::arguments::{OptionalArgument, extract_assignments, extract_number, extract_whole_number};
use crate::arrays::{image_array, layer_array, parse_json};
use crate::depth::DepthMaps;
use crate::errors::{emit_warnings, find_by_name, mistake_error, panic_error, runtime_error, usage_error};
use crate::job::ALLOWED_SEEDS;
use crate::mesh::ReadyMesh;
use crate::sensor::{ALLOWED_INDICES, Sensor};

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

/// A sensor prepared at a fidelity level; held by `gelsim.Simulator`.
#[pyclass(frozen, module = "gelsim._native")]
pub struct Engine {
    plan: Plan,
    /// Reliefs of the patterns that were used so far.
    reliefs: Mutex<Vec<(&'static str, Arc<Relief>)>>,
    /// State of the sequence. Locks are taken only while the GIL is held, and only briefly: a process that is forked
    /// never finds one taken.
    sequence: Mutex<SequenceState>,
}

/// State of a sequence.
enum SequenceState {
    /// Before its first frame.
    Begun(SequenceStart),
    Moving(Box<MovingSequence>),
    /// A thread is rendering a frame of it.
    Busy,
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

/// Place of an object, given as `gelsim.Pose` or as `gelsim.Placement`.
#[derive(FromPyObject)]
pub enum ObjectPlace {
    #[pyo3(transparent)]
    Posed(PoseArgument),
    #[pyo3(transparent)]
    Placed(PlacementArgument),
}

/// `gelsim.Pose`. The Python class has checked its numbers.
#[derive(FromPyObject)]
pub struct PoseArgument {
    depth_mm: f64,
    x_mm: f64,
    y_mm: f64,
    yaw_deg: f64,
    tilt_deg: f64,
    tilt_azimuth_deg: f64,
    face: String,
    anchor: String,
}

/// `gelsim.Placement`.
#[derive(FromPyObject)]
pub struct PlacementArgument {
    translation_mm: [f64; 3],
    quaternion_xyzw: [f64; 4],
}

/// `gelsim.Texture`.
#[derive(FromPyObject)]
pub struct TextureArgument {
    pattern: String,
    amplitude_mm: f64,
    scale_mm: f64,
    angle_deg: f64,
    offset: [f64; 2],
}

/// `gelsim.Shear`.
#[derive(FromPyObject)]
pub struct ShearArgument {
    x_mm: f64,
    y_mm: f64,
    twist_deg: f64,
}

/// Result of a press; held by `gelsim.Impression`.
#[pyclass(frozen, module = "gelsim._native")]
pub struct Pressing {
    sample: Sample,
    /// Label of the frame, in a sequence.
    frame: Option<FrameLabel>,
    number: Option<u64>,
}

/// An object that was read, and its pose.
struct PlacedObject {
    name: String,
    shape: Shape,
    pose: Pose,
    /// Depth of its lowest point, mm; 0 or less without contact.
    depth_mm: f64,
    /// Point about which a shear turns it, mm.
    about_mm: [f64; 2],
}

impl ObjectPlace {
    /// Returns the pose of a mesh, its depth, mm, and the point about which it turns, mm.
    fn resolve_for_mesh(&self, clusters: &Clusters) -> PyResult<(Pose, f64, [f64; 2])> {
        match self {
            Self::Posed(PoseArgument { depth_mm, x_mm, y_mm, yaw_deg, tilt_deg, tilt_azimuth_deg, face, anchor }) => {
                let side = find_by_name("face", face, ["+x", "-x", "+y", "-y", "+z", "-z"].into_iter().zip(SIDES))?;
                let anchors = [Anchor::Bounds, Anchor::Origin, Anchor::Contact];
                let anchor = find_by_name("anchor", anchor, ["bounds", "origin", "contact"].into_iter().zip(anchors))?;
                let [yaw_deg, tilt_deg, tilt_azimuth_deg] = [*yaw_deg, *tilt_deg, *tilt_azimuth_deg];
                let angles = Angles { yaw_deg, tilt_deg, tilt_azimuth_deg };
                let pose = Pose::new(side, angles, [*x_mm, *y_mm], anchor, 0.0 - depth_mm, clusters);
                check_finite_pose(&pose).map(|pose| (pose, *depth_mm, [*x_mm, *y_mm]))
            }
            Self::Placed(placed) => {
                let pose = placed.to_pose()?;
                let DVec3 { x, y, .. } = pose.translation_mm;
                Ok((pose, 0.0 - pose.lowest_mm(clusters), [x, y]))
            }
        }
    }
}

impl PlacementArgument {
    fn to_pose(&self) -> PyResult<Pose> {
        check_finite_pose(&Pose::from_quaternion(self.quaternion_xyzw, self.translation_mm))
    }
}

/// Sides in the order of their names.
const SIDES: [Side; 6] = [Side::PlusX, Side::MinusX, Side::PlusY, Side::MinusY, Side::PlusZ, Side::MinusZ];

/// Fails if a pose has values that are not finite.
fn check_finite_pose(pose: &Pose) -> PyResult<Pose> {
    let is_finite = pose.rotation.is_finite() && pose.translation_mm.is_finite();
    let refused =
        || mistake_error("pose has values that are not finite", "give lengths in mm, and a quaternion other than 0");
    if is_finite { Ok(*pose) } else { Err(refused()) }
}

impl Engine {
    /// Reads an object, a mesh or a height map, and its place. Fails if the two do not fit each other or the sensor.
    fn read_object(
        &self,
        py: Python<'_>,
        name: &str,
        given: &Bound<'_, PyAny>,
        place: Option<&ObjectPlace>,
    ) -> PyResult<PlacedObject> {
        let thickness_mm = self.plan.thickness_mm();
        if let Ok(mesh) = given.cast::<ReadyMesh>() {
            let clusters = &mesh.get().clusters;
            let help = "pose=gelsim.Pose(0.5) presses it in by 0.5 mm, in the middle of the image";
            let place = place.ok_or_else(|| mistake_error("a mesh needs a pose", help))?;
            let (pose, depth_mm, about_mm) = place.resolve_for_mesh(clusters)?;
            if depth_mm > thickness_mm {
                let message = format!("the object is {depth_mm:.3} mm deep in a pad of {thickness_mm} mm");
                return Err(mistake_error(message, "press it less deep, or move the pose out of the pad, along z"));
            }
            let shape = Shape::Mesh(Arc::clone(clusters));
            return Ok(PlacedObject { name: name.to_owned(), shape, pose, depth_mm, about_mm });
        }
        let sensor = self.plan.simulator.sensor();
        if sensor.shape.is_some() {
            let message = "this sensor's gel has a shape, over which heights have no meaning";
            return Err(mistake_error(
                message,
                "press a mesh, or depth frames of a camera inside by gelsim.Sensor.render",
            ));
        }
        let input = DepthMaps::extract_input(given, false)?;
        let depth = DepthMaps::new(&input);
        let ([width, height], found) = (self.plan.simulator.view().resolution_px, depth.resolution_px());
        if depth.batch_size().is_some() {
            return Err(mistake_error(
                "heights of several presses",
                "give one map (rows, columns); gelsim.Sensor.render takes several",
            ));
        }
        if found != [width, height] {
            let message =
                format!("depth_mm has {} rows and {} columns, the sensor {height} and {width}", found[1], found[0]);
            let help =
                format!("gelsim.Simulator(..., resolution_px=({}, {})) has as many as the map", found[0], found[1]);
            return Err(mistake_error(message, help));
        }
        let seen = py.detach(|| depth.inspect(0..1, thickness_mm));
        emit_warnings(py, &depth.report_findings(&seen, thickness_mm).map_err(|report| usage_error(&report))?)?;
        let map = HeightMap { above_mm: depth.above_mm(0), unseen_px: 0 };
        // The values were checked, but another thread may write to the array meanwhile.
        if map.above_mm.data.iter().any(|mm| mm.is_nan() || *mm == f32::NEG_INFINITY) {
            return Err(runtime_error("depth_mm has changed while it was read; give a copy: depth_mm.copy()"));
        }
        let pose = match place {
            None => Pose::IDENTITY,
            Some(ObjectPlace::Placed(placed)) => placed.to_pose()?,
            Some(ObjectPlace::Posed(_)) => {
                let help = "gelsim.Placement says where the object is that the heights show, or leave pose out";
                return Err(mistake_error("heights are where they are: gelsim.Pose does not move them", help));
            }
        };
        let (depth_mm, DVec3 { x, y, .. }) = (map.indentation_depth_mm(), pose.translation_mm);
        let shape = Shape::HeightMap(Arc::new(map));
        Ok(PlacedObject { name: name.to_owned(), shape, pose, depth_mm, about_mm: [x, y] })
    }

    /// Returns a texture as it was asked for. The relief of a pattern is made once.
    fn make_texture(&self, py: Python<'_>, cut: &TextureArgument) -> PyResult<DrawnTexture> {
        const PATTERNS: [(&str, Procedural); 5] = [
            ("noise", Procedural::Noise),
            ("brushed", Procedural::Brushed),
            ("knurled", Procedural::Knurled),
            ("woven", Procedural::Woven),
            ("dimples", Procedural::Dimples),
        ];
        let find = |(name, pattern): (&'static str, Procedural)| (name, (name, pattern));
        let (pattern, procedural) = find_by_name("pattern", &cut.pattern, PATTERNS.map(find))?;
        let reliefs = || self.reliefs.lock().unwrap_or_else(PoisonError::into_inner);
        let known = reliefs().iter().find(|(known, _)| *known == pattern).map(|(_, relief)| Arc::clone(relief));
        let relief = match known {
            Some(relief) => relief,
            None => {
                let relief = Arc::new(py.detach(|| Relief::procedural(procedural)));
                reliefs().push((pattern, Arc::clone(&relief)));
                relief
            }
        };
        let TextureArgument { amplitude_mm, scale_mm, angle_deg, offset, .. } = *cut;
        Ok(DrawnTexture { pattern, relief, sample: TextureSample { amplitude_mm, scale_mm, angle_deg, offset } })
    }

    fn panic_error(&self, what: &str, panic: &(dyn Any + Send)) -> PyErr {
        panic_error(what, panic)
    }
}

/// Makes the scene of an object, with everything else drawn as for sample `index`.
fn build_scene(plan: &Plan, index: u64, object: PlacedObject, texture: Option<DrawnTexture>) -> Scene {
    let PlacedObject { name, shape, pose, depth_mm, about_mm } = object;
    let pressed = PressSource::Frame(DepthFrame { id: name, class: String::new(), shape });
    let indentation_depth_mm = depth_mm.max(0.0);
    let mut scene = Scene::from_known_press(
        plan,
        index,
        0,
        KnownPress { split: Split::Train, pressed, pose, indentation_depth_mm },
    );
    scene.motion.about_mm = about_mm;
    scene.texture = texture.or(scene.texture);
    scene
}

/// Makes the sample of an impression, with its label.
fn label_sample(plan: &Plan, scene: &Scene, simulator: Arc<Simulator>, impression: Impression) -> Sample {
    let label = Label::describe(plan, scene, &simulator, &impression, None);
    let seconds: Seconds = impression.seconds;
    Sample { simulator, impression, numbered: None, label, seconds }
}

#[pymethods]
impl Engine {
    #[new]
    fn new(
        py: Python<'_>,
        sensor: &Sensor,
        fidelity: &Bound<'_, PyAny>,
        resolution_px: Option<[usize; 2]>,
        set: OptionalArgument<'_, '_>,
        flow: bool,
    ) -> PyResult<Self> {
        let layers = if flow { vec![OutputLayer::Flow] } else { Vec::new() };
        let set = extract_assignments("set", set)?;
        let plan = sensor.plan_with(py, crate::errors::fidelity_level(fidelity)?, resolution_px, &set, &layers)?;
        emit_warnings(py, &sensor.new_notes(&plan))?;
        let begun = SequenceStart { friction: DEFAULT_FRICTION, index: 0, seed: 0 };
        Ok(Self { plan, reliefs: Mutex::default(), sequence: Mutex::new(SequenceState::Begun(begun)) })
    }

    /// Returns a copy with a sequence of its own.
    fn copy(&self) -> Self {
        let reliefs = self.reliefs.lock().unwrap_or_else(PoisonError::into_inner).clone();
        let begun = SequenceStart { friction: DEFAULT_FRICTION, index: 0, seed: 0 };
        Self {
            plan: self.plan.clone(),
            reliefs: Mutex::new(reliefs),
            sequence: Mutex::new(SequenceState::Begun(begun)),
        }
    }

    #[getter]
    fn resolution_px(&self) -> (usize, usize) {
        self.plan.simulator.view().resolution_px.into()
    }

    #[getter]
    fn fidelity(&self) -> &'static str {
        self.plan.fidelity().name()
    }

    /// Renders one press.
    #[expect(clippy::too_many_arguments, reason = "each is a keyword of Python's")]
    fn press(
        &self,
        py: Python<'_>,
        name: &str,
        object: &Bound<'_, PyAny>,
        pose: Option<ObjectPlace>,
        texture: Option<TextureArgument>,
        shear: Option<ShearArgument>,
        friction: Option<f64>,
        youngs_modulus_kpa: Option<f64>,
        poisson_ratio: f64,
        index: OptionalArgument<'_, '_>,
        seed: OptionalArgument<'_, '_>,
    ) -> PyResult<Pressing> {
        let index = extract_whole_number("index", index, ALLOWED_INDICES)?.unwrap_or(0);
        let plan = self.plan_with_seed(extract_whole_number("seed", seed, ALLOWED_SEEDS)?.unwrap_or(0))?;
        let object = self.read_object(py, name, object, pose.as_ref())?;
        let texture = texture.map(|cut| self.make_texture(py, &cut)).transpose()?;
        if youngs_modulus_kpa.is_some() && !plan.simulator.models().gelpad.knows_tractions() {
            let message = format!("fidelity `{}` takes every object for rigid", plan.fidelity().name());
            return Err(mistake_error(message, "take a finer level, or leave youngs_modulus_kpa out"));
        }
        let gelpad = &plan.simulator.models().gelpad;
        if friction.is_some() && gelpad.friction().is_some() && gelpad.strain_settings().is_some() {
            let message = "at finite strain the pad sticks to every object: one with a friction is not simulated";
            return Err(mistake_error(message, "leave friction out, or take gelsim.Simulator(sensor, \"high\")"));
        }
        if shear.is_some() && !plan.simulator.knows_tractions() {
            let message = "nothing shows how the pad moves in its own plane, and so no shear";
            let help = "gelsim.Simulator(..., flow=True) at a finer level than `paper`, or a sensor with markers";
            return Err(mistake_error(message, help));
        }
        let rendered = catch_unwind(AssertUnwindSafe(|| {
            py.detach(|| {
                let mut scene = build_scene(&plan, index, object, texture);
                scene.material.friction = friction.map(|coefficient| Friction::Coulomb { coefficient });
                scene.material.soft =
                    youngs_modulus_kpa.map(|youngs_modulus_kpa| ElasticObject { youngs_modulus_kpa, poisson_ratio });
                let mut press = scene.to_press(&plan);
                if let Some(ShearArgument { x_mm, y_mm, twist_deg }) = shear {
                    let Motion { about_mm, .. } = scene.motion;
                    scene.motion = Motion { shift_mm: [x_mm, y_mm], twist_rad: twist_deg.to_radians(), about_mm };
                    press.shear = Some(Shear { motion: scene.motion, friction: plan.job().shear.friction });
                }
                let simulator = scene.simulator(&plan);
                let impression = simulator.press_with(&press);
                let sampling = SampleSources {
                    objects: Vec::new(),
                    classes: Vec::new(),
                    object_samplers: plan.sampling.object_samplers.clone(),
                    textures: Vec::new(),
                    moves_objects: press.shear.is_some(),
                };
                // The label describes a shear only if the plan moves objects.
                let mut plan = plan;
                plan.sampling = Arc::new(sampling);
                label_sample(&plan, &scene, simulator, impression)
            })
        }));
        let sample = rendered.map_err(|panic| self.panic_error("this press", &*panic))?;
        Ok(Pressing { sample, frame: None, number: None })
    }

    /// Begins a new sequence.
    fn reset(
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
        *self.sequence.lock().unwrap_or_else(PoisonError::into_inner) = SequenceState::Begun(begun);
        Ok(())
    }

    /// Renders the next frame of the sequence.
    fn step(
        &self,
        py: Python<'_>,
        name: &str,
        object: &Bound<'_, PyAny>,
        pose: Option<ObjectPlace>,
        texture: Option<TextureArgument>,
        duration_s: &Bound<'_, PyAny>,
    ) -> PyResult<Pressing> {
        let duration_s = extract_number("duration_s", duration_s)?;
        if !(0.0..=1e6).contains(&duration_s) {
            let help = "seconds since the frame before, 0 to 1000000";
            return Err(mistake_error(format!("duration_s={duration_s} is out of range"), help));
        }
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
        let object = self.read_object(py, name, object, pose.as_ref())?;
        let texture = texture.map(|cut| self.make_texture(py, &cut)).transpose()?;
        let taken = {
            let mut sequence = self.sequence.lock().unwrap_or_else(PoisonError::into_inner);
            // Checked while the sequence still has its state: a step that is refused changes nothing.
            if let SequenceState::Moving(moving) = &*sequence {
                moving.check_step(&self.plan, &object)?;
            }
            std::mem::replace(&mut *sequence, SequenceState::Busy)
        };
        let (begun, moving) = match taken {
            SequenceState::Begun(begun) => (begun, None),
            SequenceState::Moving(moving) => (moving.begun, Some(moving)),
            SequenceState::Busy => {
                let help = "simulator.copy() has a sequence of its own, and simulator.reset() begins another one";
                return Err(runtime_error(format!(
                    "another thread is at a frame of this simulator's sequence: {help}"
                )));
            }
        };
        // The lock is free while a frame is rendered; `Busy` holds the place.
        let put_back = |state: SequenceState| *self.sequence.lock().unwrap_or_else(PoisonError::into_inner) = state;
        let rendered = catch_unwind(AssertUnwindSafe(|| {
            py.detach(|| {
                let plan = self.plan_with_seed(begun.seed)?;
                Ok(render_next_frame(&plan, (begun, moving), object, texture, duration_s))
            })
        }));
        match rendered {
            Ok(Ok((moving, pressing))) => {
                put_back(SequenceState::Moving(moving));
                Ok(pressing)
            }
            Ok(Err(error)) => {
                put_back(SequenceState::Begun(begun));
                Err(error)
            }
            Err(panic) => {
                put_back(SequenceState::Begun(begun));
                Err(self.panic_error("this frame", &*panic))
            }
        }
    }
}

impl Engine {
    /// Returns the plan with this seed.
    fn plan_with_seed(&self, seed: u64) -> PyResult<Plan> {
        let layers = self.plan.layers();
        self.plan.with_samples(seed, &layers).map_err(|report| usage_error(&report))
    }
}

/// Renders the frame after `moving`, or the first one of a sequence. Returns the new state, and the frame.
fn render_next_frame(
    plan: &Plan,
    (begun, moving): (SequenceStart, Option<Box<MovingSequence>>),
    object: PlacedObject,
    texture: Option<DrawnTexture>,
    duration_s: f64,
) -> (Box<MovingSequence>, Pressing) {
    let (pose, depth_mm, shape) = (object.pose, object.depth_mm, object.shape.clone());
    let drawn = build_scene(plan, begun.index, object, texture);
    let mut moving = moving.unwrap_or_else(|| {
        let simulator = drawn.simulator(plan);
        let sliding = simulator.sliding(begun.friction).expect("the model knows tractions");
        let placement = TexturePlacement::at_pose(&pose);
        // In the first frame the object comes straight down to its pose.
        let last = shape.clusters().map_or(pose, |mesh| pose.lowered(0.0, mesh));
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
    let Scene { pressed, pose, indentation_depth_mm, motion, texture, .. } = drawn;
    let mut scene =
        Scene { pressed, pose, over_plane: pose, indentation_depth_mm, motion, texture, ..moving.first_scene.clone() };
    scene.camera.noise_key = noise_key;
    let mut press = scene.to_press(plan);
    press.texture = press.texture.map(|texture| texture.with_placement(moving.texture_placement));
    press.shear = None;
    let steps = moving.plan_steps(plan, &scene, depth_mm, duration_s);
    let impression = moving.simulator.press_next(&press, &steps, &mut moving.sliding);
    let sample = label_sample(plan, &scene, Arc::clone(&moving.simulator), impression);
    let sliding = sample.impression.sliding.as_ref();
    let frame = FrameLabel::new(moving.frame_count as u32, 0.0, "", sample.label.clone(), sliding);
    let number = moving.frame_count;
    (moving.last_pose, moving.last_depth_mm, moving.frame_count) = (pose, depth_mm, number + 1);
    (moving, Pressing { sample, frame: Some(frame), number: Some(number) })
}

impl MovingSequence {
    /// Fails if the object has turned too far since the previous frame.
    fn check_step(&self, plan: &Plan, object: &PlacedObject) -> PyResult<()> {
        // Heights cannot be turned on the way, so a height map gets a single step.
        let most = if matches!(object.shape, Shape::Mesh(_)) { MAX_STEPS } else { 2.0 };
        if self.count_longest_steps(plan, &object.shape, &object.pose) <= most + 1e-9 {
            return Ok(());
        }
        let turn_deg = turn_rad(self.last_pose, object.pose, DVec3::Z).to_degrees();
        let message = format!("the object has turned too far since the frame before ({turn_deg:.1} degrees about z)");
        Err(mistake_error(
            message,
            "give frames between, in which it turns by 10 degrees at most; reset() begins another sequence",
        ))
    }

    /// Returns how many of the longest allowed steps lead from the last pose to another; a fraction of one for less.
    fn count_longest_steps(&self, plan: &Plan, shape: &Shape, to: &Pose) -> f64 {
        let tilt_deg =
            (to.rotation * self.last_pose.rotation.transpose()).z_axis.z.clamp(-1.0, 1.0).acos().to_degrees();
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
        let turn_deg = turn_rad(self.last_pose, *to, DVec3::Z).to_degrees().abs();
        (turn_deg / MAX_TURN_DEG).max(tilt_deg / most_tilt_deg)
    }

    /// Plans the steps from the last frame to the pose of a scene, as a job's sequences do.
    fn plan_steps(&self, plan: &Plan, scene: &Scene, depth_mm: f64, duration_s: f64) -> Vec<ObjectStep> {
        let PressSource::Frame(DepthFrame { shape, .. }) = &scene.pressed else { return Vec::new() };
        let (from, from_mm, to) = (self.last_pose, self.last_depth_mm, scene.pose);
        let plane = PadPlane::default();
        let Some(mesh) = shape.clusters() else {
            let lowest = match shape {
                Shape::HeightMap(map) => find_lowest_point(map, plan.simulator.view()),
                _ => None,
            };
            let motion = lowest.map_or_else(PlanarMotion::default, |now| motion_between(from, to, now, &plane));
            return vec![ObjectStep { pose: to, depth_mm, motion, duration_s }];
        };
        let mut way = self.count_longest_steps(plan, shape, &to);
        if !plan.simulator.sensor().relaxation.is_empty() {
            let shift_mm = (to.translation_mm - from.translation_mm).truncate().length();
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
                    (Pose { rotation, translation_mm, ..to }.lowered(0.0 - depth_mm, mesh), depth_mm)
                };
                let motion = motion_between(before, pose, lowest_point(mesh, &pose), &plane);
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

/// Returns the lowest point of a placed mesh, mm.
fn lowest_point(mesh: &Clusters, pose: &Pose) -> DVec3 {
    let down = (pose.rotation.transpose() * DVec3::NEG_Z).to_array();
    // Points within 1 um of the lowest count, and their middle is taken: the middle of a flat face.
    let lowest = mesh.extreme_point(down, mesh.extreme(down), 1e-3);
    let centre = DVec3::from_array(mesh.centre_mm());
    pose.rotation * (centre + DVec3::from_array(lowest)) + pose.translation_mm
}

#[pymethods]
impl Pressing {
    /// Returns the tactile image.
    fn image<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        image_array(py, &self.sample)
    }

    /// Returns a layer by its name; None if the sensor or the fidelity level does not have it.
    fn layer<'py>(&self, py: Python<'py>, name: &str) -> PyResult<Option<Bound<'py, PyAny>>> {
        let wanted = find_by_name("layer", name, OutputLayer::ALL.map(|layer| (layer.name(), layer)))?;
        let (impression, simulator) = (&self.sample.impression, &self.sample.simulator);
        let is_there = match wanted {
            OutputLayer::Pressure => simulator.models().gelpad.knows_pressure(),
            OutputLayer::Flow => simulator.knows_tractions(),
            // At finite strain those of a pad that sticks are not known.
            OutputLayer::Traction => {
                let model = &simulator.models().gelpad;
                simulator.knows_tractions() && (model.strain_settings().is_none() || model.friction().is_none())
            }
            OutputLayer::Markers => impression.markers.is_some(),
            OutputLayer::Pins => impression.pins.is_some(),
            OutputLayer::Lamps => !simulator.sensor().lamps.is_empty(),
            OutputLayer::Slip => impression.sliding.is_some(),
            // Untouched pins would be those of another unit.
            OutputLayer::Untouched => {
                let differ =
                    |pins: &gelsim_core::camera::pins::Pins| pins.size_jitter > 0.0 || pins.place_jitter_mm > 0.0;
                !simulator.sensor().pins.as_ref().is_some_and(differ)
            }
            _ => true,
        };
        if is_there { layer_array(py, &self.sample, wanted).map(Some) } else { Ok(None) }
    }

    /// Returns the label. In a sequence it also has what only a frame's label has.
    fn label<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        let label = parse_json(py, &to_json_line(&self.sample.label))?;
        if let Some(frame) = &self.frame {
            let frame = parse_json(py, &to_json_line(frame))?.cast_into::<PyDict>()?;
            for key in ["wrench", "slip", "numerics", "health"] {
                label.set_item(key, frame.get_item(key)?)?;
            }
        }
        Ok(label)
    }

    /// Number in the sequence, from 0; None for a press.
    #[getter]
    fn frame(&self) -> Option<u64> {
        self.number
    }
}
