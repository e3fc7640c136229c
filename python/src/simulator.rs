//! What `gelsim.Simulator` is made of: meshes and height maps pressed one by one, or frame after frame. `python/gelsim/simulator.py` is
//! the class that users see.

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
use gelsim_core::gelpad::elastic::shear::{Friction, Motion};
use gelsim_core::gelpad::elastic::soft::ElasticObject;
use gelsim_core::gelpad::planar::PlanarMotion;
use gelsim_core::gelpad::sliding::{ObjectStep, Sliding};
use gelsim_core::gelpad::tangential::Shear;
use gelsim_core::impression::Impression;
use gelsim_core::mesh::clusters::Clusters;
use gelsim_core::pose::{Anchor, Angles, PadPlane, Pose, Side};
use gelsim_core::simulator::Simulator;
use gelsim_dataset::encode::json;
use gelsim_dataset::frames::sequence::{lowest_mm, motion, turn_rad};
use gelsim_job::label::Label;
use gelsim_job::layers::OutputLayer;
use gelsim_job::layout::Split;
use gelsim_job::plan::{Plan, Sampling};
use gelsim_job::sample::Sample;
use gelsim_job::scene::{DrawnTexture, Frame, KnownPress, Pressed, Scene};
use gelsim_job::sequence::label::FrameLabel;
use glam::{DMat3, DQuat, DVec3};
use pyo3::prelude::*;
use pyo3::types::PyDict;

use crate::arguments::{Given, assignments, whole};
use crate::arrays::{image, layer, parsed};
use crate::depth::Depth;
use crate::errors::{mistake, named, panicked, running, usage, warn};
use crate::job::LARGEST_SEED;
use crate::mesh::ReadyMesh;
use crate::sensor::{LARGEST_INDEX, Sensor};

/// Pixels along the longer side of the view of which a contact rolls at most one in a step.
const ROLLING_PX: f64 = 160.0;

/// Largest turn of a step, degrees: the law of friction takes its chord for the way.
const MOST_TURN_DEG: f64 = 5.0;

/// Steps of a frame: an object that goes further has gone a way that nobody knows.
const MOST_STEPS: f64 = 400.0;

/// Share of the depth at which an object first touches in its frame, as in a job's sequences.
const FIRST_TOUCH: f64 = 1.0 / 16.0;

/// What holds the pad to an object if nobody says it, as in a job's `[sequence]`.
const FRICTION: Friction = Friction::Coulomb { coefficient: 0.6 };

/// A sensor made ready at a fidelity level; `gelsim.Simulator` has one.
#[pyclass(frozen, module = "gelsim._native")]
pub struct Engine {
    plan: Plan,
    /// The patterns that were cut into objects.
    reliefs: Mutex<Vec<(&'static str, Arc<Relief>)>>,
    /// Locks are taken with the GIL only, and not for long: no process that is forked finds one taken.
    sequence: Mutex<Sequence>,
}

/// Where a sequence is.
enum Sequence {
    /// Before its first frame.
    Begun(Begun),
    Moving(Box<Moving>),
    /// A thread is at a frame of it.
    Busy,
}

/// What a sequence begins with.
#[derive(Clone, Copy)]
struct Begun {
    friction: Friction,
    index: u64,
    seed: u64,
}

/// A sequence after a frame.
struct Moving {
    begun: Begun,
    /// The first frame: what is drawn of print, camera and unit holds for all.
    first: Scene,
    simulator: Arc<Simulator>,
    sliding: Sliding,
    last: Pose,
    last_depth_mm: f64,
    /// Where the texture lay in the first frame.
    laid: TexturePlacement,
    frames: u64,
}

/// Where an object is, as `gelsim.Pose` or as `gelsim.Placement` says it.
#[derive(FromPyObject)]
pub enum Place {
    #[pyo3(transparent)]
    Posed(Posed),
    #[pyo3(transparent)]
    Placed(Placed),
}

/// `gelsim.Pose`, which has checked its numbers.
#[derive(FromPyObject)]
pub struct Posed {
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
pub struct Placed {
    translation_mm: [f64; 3],
    quaternion_xyzw: [f64; 4],
}

/// `gelsim.Texture`.
#[derive(FromPyObject)]
pub struct Cut {
    pattern: String,
    amplitude_mm: f64,
    scale_mm: f64,
    angle_deg: f64,
    offset: [f64; 2],
}

/// `gelsim.Shear`.
#[derive(FromPyObject)]
pub struct Pushed {
    x_mm: f64,
    y_mm: f64,
    twist_deg: f64,
}

/// What a press gave; `gelsim.Impression` has one.
#[pyclass(frozen, module = "gelsim._native")]
pub struct Pressing {
    sample: Sample,
    /// Of a frame of a sequence.
    frame: Option<FrameLabel>,
    number: Option<u64>,
}

/// An object that was read, and where it is.
struct Object {
    name: String,
    shape: Shape,
    pose: Pose,
    /// How deep its lowest point is, mm; 0 or less without contact.
    depth_mm: f64,
    /// The point that a shear turns it about, mm.
    about_mm: [f64; 2],
}

impl Place {
    /// The pose of a mesh, how deep that is, and the point that it places.
    fn of_mesh(&self, clusters: &Clusters) -> PyResult<(Pose, f64, [f64; 2])> {
        match self {
            Self::Posed(Posed { depth_mm, x_mm, y_mm, yaw_deg, tilt_deg, tilt_azimuth_deg, face, anchor }) => {
                let side = named("face", face, ["+x", "-x", "+y", "-y", "+z", "-z"].into_iter().zip(SIDES))?;
                let anchors = [Anchor::Bounds, Anchor::Origin, Anchor::Contact];
                let anchor = named("anchor", anchor, ["bounds", "origin", "contact"].into_iter().zip(anchors))?;
                let [yaw_deg, tilt_deg, tilt_azimuth_deg] = [*yaw_deg, *tilt_deg, *tilt_azimuth_deg];
                let angles = Angles { yaw_deg, tilt_deg, tilt_azimuth_deg };
                let pose = Pose::new(side, angles, [*x_mm, *y_mm], anchor, 0.0 - depth_mm, clusters);
                finite(&pose).map(|pose| (pose, *depth_mm, [*x_mm, *y_mm]))
            }
            Self::Placed(placed) => {
                let pose = placed.pose()?;
                let DVec3 { x, y, .. } = pose.translation_mm;
                Ok((pose, 0.0 - pose.lowest_mm(clusters), [x, y]))
            }
        }
    }
}

impl Placed {
    fn pose(&self) -> PyResult<Pose> {
        finite(&Pose::placed(self.quaternion_xyzw, self.translation_mm))
    }
}

/// In the order of their names.
const SIDES: [Side; 6] = [Side::PlusX, Side::MinusX, Side::PlusY, Side::MinusY, Side::PlusZ, Side::MinusZ];

/// Refuses a pose that is none.
fn finite(pose: &Pose) -> PyResult<Pose> {
    let is_finite = pose.rotation.is_finite() && pose.translation_mm.is_finite();
    let refused =
        || mistake("pose has values that are not finite", "give lengths in mm, and a quaternion other than 0");
    if is_finite { Ok(*pose) } else { Err(refused()) }
}

impl Engine {
    /// Reads what is pressed, and where.
    fn object(&self, py: Python<'_>, name: &str, given: &Bound<'_, PyAny>, place: Option<&Place>) -> PyResult<Object> {
        let thickness_mm = self.plan.thickness_mm();
        if let Ok(mesh) = given.cast::<ReadyMesh>() {
            let clusters = &mesh.get().clusters;
            let help = "pose=gelsim.Pose(0.5) presses it in by 0.5 mm, in the middle of the image";
            let place = place.ok_or_else(|| mistake("a mesh needs a pose", help))?;
            let (pose, depth_mm, about_mm) = place.of_mesh(clusters)?;
            if depth_mm > thickness_mm {
                let message = format!("the object is {depth_mm:.3} mm deep in a pad of {thickness_mm} mm");
                return Err(mistake(message, "press it less deep, or move the pose out of the pad, along z"));
            }
            let shape = Shape::Mesh(Arc::clone(clusters));
            return Ok(Object { name: name.to_owned(), shape, pose, depth_mm, about_mm });
        }
        let sensor = self.plan.simulator.sensor();
        if sensor.shape.is_some() {
            let message = "this sensor's gel has a shape, over which heights have no meaning";
            return Err(mistake(message, "press a mesh, or depth frames of a camera inside by gelsim.Sensor.render"));
        }
        let input = Depth::array(given, false)?;
        let depth = Depth::new(&input);
        let ([width, height], found) = (self.plan.simulator.view().resolution_px, depth.resolution_px());
        if depth.batch().is_some() {
            return Err(mistake(
                "heights of several presses",
                "give one map (rows, columns); gelsim.Sensor.render takes several",
            ));
        }
        if found != [width, height] {
            let message =
                format!("depth_mm has {} rows and {} columns, the sensor {height} and {width}", found[1], found[0]);
            let help =
                format!("gelsim.Simulator(..., resolution_px=({}, {})) has as many as the map", found[0], found[1]);
            return Err(mistake(message, help));
        }
        let seen = py.detach(|| depth.look(0..1, thickness_mm));
        warn(py, &depth.judge(&seen, thickness_mm).map_err(|report| usage(&report))?)?;
        let map = HeightMap { above_mm: depth.above_mm(0), unseen_px: 0 };
        // It was looked at, but whoever writes to the array does not wait.
        if map.above_mm.data.iter().any(|mm| mm.is_nan() || *mm == f32::NEG_INFINITY) {
            return Err(running("depth_mm has changed while it was read; give a copy: depth_mm.copy()"));
        }
        let pose = match place {
            None => Pose::IDENTITY,
            Some(Place::Placed(placed)) => placed.pose()?,
            Some(Place::Posed(_)) => {
                let help = "gelsim.Placement says where the object is that the heights show, or leave pose out";
                return Err(mistake("heights are where they are: gelsim.Pose does not move them", help));
            }
        };
        let (depth_mm, DVec3 { x, y, .. }) = (map.indentation_depth_mm(), pose.translation_mm);
        let shape = Shape::HeightMap(Arc::new(map));
        Ok(Object { name: name.to_owned(), shape, pose, depth_mm, about_mm: [x, y] })
    }

    /// A texture that was asked for.
    fn texture(&self, py: Python<'_>, cut: &Cut) -> PyResult<DrawnTexture> {
        const PATTERNS: [(&str, Procedural); 5] = [
            ("noise", Procedural::Noise),
            ("brushed", Procedural::Brushed),
            ("knurled", Procedural::Knurled),
            ("woven", Procedural::Woven),
            ("dimples", Procedural::Dimples),
        ];
        let find = |(name, pattern): (&'static str, Procedural)| (name, (name, pattern));
        let (pattern, procedural) = named("pattern", &cut.pattern, PATTERNS.map(find))?;
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
        let Cut { amplitude_mm, scale_mm, angle_deg, offset, .. } = *cut;
        Ok(DrawnTexture { pattern, relief, sample: TextureSample { amplitude_mm, scale_mm, angle_deg, offset } })
    }

    fn bug(&self, what: &str, panic: &(dyn Any + Send)) -> PyErr {
        panicked(what, panic)
    }
}

/// An object as a scene, with what is drawn for sample `index`.
fn scene(plan: &Plan, index: u64, object: Object, texture: Option<DrawnTexture>) -> Scene {
    let Object { name, shape, pose, depth_mm, about_mm } = object;
    let pressed = Pressed::Frame(Frame { id: name, class: String::new(), shape });
    let indentation_depth_mm = depth_mm.max(0.0);
    let mut scene =
        Scene::given(plan, index, 0, KnownPress { split: Split::Train, pressed, pose, indentation_depth_mm });
    scene.motion.about_mm = about_mm;
    scene.texture = texture.or(scene.texture);
    scene
}

fn described(plan: &Plan, scene: &Scene, simulator: Arc<Simulator>, impression: Impression) -> Sample {
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
        set: Given<'_, '_>,
        flow: bool,
    ) -> PyResult<Self> {
        let layers = if flow { vec![OutputLayer::Flow] } else { Vec::new() };
        let set = assignments("set", set)?;
        let plan = sensor.plan(py, crate::errors::fidelity_level(fidelity)?, resolution_px, &set, &layers)?;
        warn(py, &sensor.news(&plan))?;
        let begun = Begun { friction: FRICTION, index: 0, seed: 0 };
        Ok(Self { plan, reliefs: Mutex::default(), sequence: Mutex::new(Sequence::Begun(begun)) })
    }

    /// The same with a sequence of its own.
    fn copy(&self) -> Self {
        let reliefs = self.reliefs.lock().unwrap_or_else(PoisonError::into_inner).clone();
        let begun = Begun { friction: FRICTION, index: 0, seed: 0 };
        Self { plan: self.plan.clone(), reliefs: Mutex::new(reliefs), sequence: Mutex::new(Sequence::Begun(begun)) }
    }

    #[getter]
    fn resolution_px(&self) -> (usize, usize) {
        self.plan.simulator.view().resolution_px.into()
    }

    #[getter]
    fn fidelity(&self) -> &'static str {
        self.plan.fidelity().name()
    }

    /// One press.
    #[expect(clippy::too_many_arguments, reason = "each is a keyword of Python's")]
    fn press(
        &self,
        py: Python<'_>,
        name: &str,
        object: &Bound<'_, PyAny>,
        pose: Option<Place>,
        texture: Option<Cut>,
        shear: Option<Pushed>,
        friction: Option<f64>,
        youngs_modulus_kpa: Option<f64>,
        poisson_ratio: f64,
        index: Given<'_, '_>,
        seed: Given<'_, '_>,
    ) -> PyResult<Pressing> {
        let index = whole("index", index, LARGEST_INDEX)?.unwrap_or(0);
        let plan = self.seeded(whole("seed", seed, LARGEST_SEED)?.unwrap_or(0))?;
        let object = self.object(py, name, object, pose.as_ref())?;
        let texture = texture.map(|cut| self.texture(py, &cut)).transpose()?;
        if youngs_modulus_kpa.is_some() && !plan.simulator.models().gelpad.knows_tractions() {
            let message = format!("fidelity `{}` takes every object for rigid", plan.fidelity().name());
            return Err(mistake(message, "take a finer level, or leave youngs_modulus_kpa out"));
        }
        if shear.is_some() && !plan.simulator.knows_tractions() {
            let message = "nothing shows how the pad moves in its own plane, and so no shear";
            let help = "gelsim.Simulator(..., flow=True) at a finer level than `paper`, or a sensor with markers";
            return Err(mistake(message, help));
        }
        let rendered = catch_unwind(AssertUnwindSafe(|| {
            py.detach(|| {
                let mut scene = scene(&plan, index, object, texture);
                scene.material.friction = friction.map(|coefficient| Friction::Coulomb { coefficient });
                scene.material.soft =
                    youngs_modulus_kpa.map(|youngs_modulus_kpa| ElasticObject { youngs_modulus_kpa, poisson_ratio });
                let mut press = scene.press(&plan);
                if let Some(Pushed { x_mm, y_mm, twist_deg }) = shear {
                    let Motion { about_mm, .. } = scene.motion;
                    scene.motion = Motion { shift_mm: [x_mm, y_mm], twist_rad: twist_deg.to_radians(), about_mm };
                    press.shear = Some(Shear { motion: scene.motion, friction: plan.job().shear.friction });
                }
                let simulator = scene.simulator(&plan);
                let impression = simulator.press_with(&press);
                let sampling = Sampling {
                    objects: Vec::new(),
                    classes: Vec::new(),
                    draw: plan.sampling.draw.clone(),
                    textures: Vec::new(),
                    moves_objects: press.shear.is_some(),
                };
                // Its label says of a shear what is known only where objects are moved.
                let mut plan = plan;
                plan.sampling = Arc::new(sampling);
                described(&plan, &scene, simulator, impression)
            })
        }));
        let sample = rendered.map_err(|panic| self.bug("this press", &*panic))?;
        Ok(Pressing { sample, frame: None, number: None })
    }

    /// Begins another sequence.
    fn reset(&self, friction: Option<f64>, index: Given<'_, '_>, seed: Given<'_, '_>) -> PyResult<()> {
        let begun = Begun {
            friction: friction.map_or(Friction::Stick, |coefficient| Friction::Coulomb { coefficient }),
            index: whole("index", index, LARGEST_INDEX)?.unwrap_or(0),
            seed: whole("seed", seed, LARGEST_SEED)?.unwrap_or(0),
        };
        *self.sequence.lock().unwrap_or_else(PoisonError::into_inner) = Sequence::Begun(begun);
        Ok(())
    }

    /// The next frame of the sequence.
    fn step(
        &self,
        py: Python<'_>,
        name: &str,
        object: &Bound<'_, PyAny>,
        pose: Option<Place>,
        texture: Option<Cut>,
    ) -> PyResult<Pressing> {
        if !self.plan.simulator.models().gelpad.knows_tractions() {
            let message = format!("fidelity `{}` knows no friction, and so no sequence", self.plan.fidelity().name());
            return Err(mistake(message, "take a finer level, such as gelsim.Simulator(sensor, \"draft\")"));
        }
        if pose.is_none() {
            let help =
                "gelsim.Placement says where the object is of which heights are given; a mesh takes gelsim.Pose, too";
            return Err(mistake("a frame of a sequence needs a pose: friction follows the object", help));
        }
        let object = self.object(py, name, object, pose.as_ref())?;
        let texture = texture.map(|cut| self.texture(py, &cut)).transpose()?;
        let taken = {
            let mut sequence = self.sequence.lock().unwrap_or_else(PoisonError::into_inner);
            // Nothing of what cannot be right changes it.
            if let Sequence::Moving(moving) = &*sequence {
                moving.check(&self.plan, &object)?;
            }
            std::mem::replace(&mut *sequence, Sequence::Busy)
        };
        let (begun, moving) = match taken {
            Sequence::Begun(begun) => (begun, None),
            Sequence::Moving(moving) => (moving.begun, Some(moving)),
            Sequence::Busy => {
                let help = "simulator.copy() has a sequence of its own, and simulator.reset() begins another one";
                return Err(running(format!("another thread is at a frame of this simulator's sequence: {help}")));
            }
        };
        let put_back = |state: Sequence| *self.sequence.lock().unwrap_or_else(PoisonError::into_inner) = state;
        let rendered = catch_unwind(AssertUnwindSafe(|| {
            py.detach(|| {
                let plan = self.seeded(begun.seed)?;
                Ok(next(&plan, begun, moving, object, texture))
            })
        }));
        match rendered {
            Ok(Ok((moving, pressing))) => {
                put_back(Sequence::Moving(moving));
                Ok(pressing)
            }
            Ok(Err(error)) => {
                put_back(Sequence::Begun(begun));
                Err(error)
            }
            Err(panic) => {
                put_back(Sequence::Begun(begun));
                Err(self.bug("this frame", &*panic))
            }
        }
    }
}

impl Engine {
    /// The plan with this seed.
    fn seeded(&self, seed: u64) -> PyResult<Plan> {
        let layers = self.plan.layers();
        self.plan.with_samples(seed, &layers).map_err(|report| usage(&report))
    }
}

/// Renders the frame after `moving`, or the first one.
fn next(
    plan: &Plan,
    begun: Begun,
    moving: Option<Box<Moving>>,
    object: Object,
    texture: Option<DrawnTexture>,
) -> (Box<Moving>, Pressing) {
    let (pose, depth_mm, shape) = (object.pose, object.depth_mm, object.shape.clone());
    let drawn = scene(plan, begun.index, object, texture);
    let mut moving = moving.unwrap_or_else(|| {
        let simulator = drawn.simulator(plan);
        let sliding = simulator.sliding(begun.friction).expect("the model knows tractions");
        let laid = TexturePlacement::with(&pose);
        // It comes down to where it is.
        let last = shape.clusters().map_or(pose, |mesh| pose.lowered(0.0, mesh));
        Box::new(Moving { begun, first: drawn.clone(), simulator, sliding, last, last_depth_mm: 0.0, laid, frames: 0 })
    });
    let noise_key = moving.first.camera.noise_key;
    // The first frame's noise is a press's.
    let noise_key = match moving.frames {
        0 => noise_key,
        frame => rng::stream(noise_key, "sequence frame noise", frame).bits(),
    };
    let Scene { pressed, pose, indentation_depth_mm, motion, texture, .. } = drawn;
    let mut scene =
        Scene { pressed, pose, over_plane: pose, indentation_depth_mm, motion, texture, ..moving.first.clone() };
    scene.camera.noise_key = noise_key;
    let mut press = scene.press(plan);
    press.texture = press.texture.map(|texture| texture.laid_out(moving.laid));
    press.shear = None;
    let steps = moving.steps(plan, &scene, depth_mm);
    let impression = moving.simulator.press_next(&press, &steps, &mut moving.sliding);
    let sample = described(plan, &scene, Arc::clone(&moving.simulator), impression);
    let slid = sample.impression.sliding.as_ref();
    let frame = FrameLabel::new(moving.frames as u32, 0.0, "", sample.label.clone(), slid);
    let number = moving.frames;
    (moving.last, moving.last_depth_mm, moving.frames) = (pose, depth_mm, number + 1);
    (moving, Pressing { sample, frame: Some(frame), number: Some(number) })
}

impl Moving {
    /// Refuses an object that has gone too far since the frame before.
    fn check(&self, plan: &Plan, object: &Object) -> PyResult<()> {
        // Nobody knows what heights were on the way.
        let most = if matches!(object.shape, Shape::Mesh(_)) { MOST_STEPS } else { 2.0 };
        if self.way(plan, &object.shape, &object.pose) <= most + 1e-9 {
            return Ok(());
        }
        let turn_deg = turn_rad(self.last, object.pose, DVec3::Z).to_degrees();
        let message = format!("the object has turned too far since the frame before ({turn_deg:.1} degrees about z)");
        Err(mistake(
            message,
            "give frames between, in which it turns by 10 degrees at most; reset() begins another sequence",
        ))
    }

    /// How many of the longest steps lead from the last frame to a pose.
    fn way(&self, plan: &Plan, shape: &Shape, to: &Pose) -> f64 {
        let tilt_deg = (to.rotation * self.last.rotation.transpose()).z_axis.z.clamp(-1.0, 1.0).acos().to_degrees();
        let view = plan.simulator.view();
        let longest_mm =
            [0, 1].map(|k| view.resolution_px[k] as f64 * view.mm_per_px[k]).into_iter().fold(0.0, f64::max);
        let radius_mm = match shape.clusters() {
            Some(mesh) => {
                let reach = [DVec3::X, DVec3::Y, DVec3::Z]
                    .map(|axis| mesh.extreme(axis.to_array()).max(mesh.extreme((-axis).to_array())));
                reach.into_iter().fold(1e-6, f64::max)
            }
            None => longest_mm,
        };
        let most_tilt_deg = (longest_mm / ROLLING_PX / radius_mm).to_degrees().clamp(0.05, MOST_TURN_DEG);
        let turn_deg = turn_rad(self.last, *to, DVec3::Z).to_degrees().abs();
        (turn_deg / MOST_TURN_DEG).max(tilt_deg / most_tilt_deg)
    }

    /// The way from the last frame to where a scene has the object, as a job's sequences go it.
    fn steps(&self, plan: &Plan, scene: &Scene, depth_mm: f64) -> Vec<ObjectStep> {
        let Pressed::Frame(Frame { shape, .. }) = &scene.pressed else { return Vec::new() };
        let (from, from_mm, to) = (self.last, self.last_depth_mm, scene.pose);
        let plane = PadPlane::default();
        let Some(mesh) = shape.clusters() else {
            let lowest = match shape {
                Shape::HeightMap(map) => lowest_mm(map, plan.simulator.view()),
                _ => None,
            };
            let motion = lowest.map_or_else(PlanarMotion::default, |now| motion(from, to, now, &plane));
            return vec![ObjectStep { pose: to, depth_mm, motion }];
        };
        let way = self.way(plan, shape, &to);
        // What touches first does so at the end of a step: early in the frame.
        let touches =
            (from_mm <= 0.0 && depth_mm > 0.0).then(|| (FIRST_TOUCH * depth_mm - from_mm) / (depth_mm - from_mm));
        let [from_turn, to_turn] = [from, to].map(|pose| DQuat::from_mat3(&pose.rotation));
        let mut before = from;
        let mut steps = Vec::new();
        let mut start = 0.0;
        for end in touches.into_iter().chain([1.0]) {
            let count = (way * (end - start) - 1e-9).ceil().clamp(1.0, MOST_STEPS) as u32;
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
                let motion = motion(before, pose, lowest_of(mesh, &pose), &plane);
                steps.push(ObjectStep { pose, depth_mm, motion });
                before = pose;
            }
            start = end;
        }
        steps
    }
}

/// The lowest point of a placed mesh, mm.
fn lowest_of(mesh: &Clusters, pose: &Pose) -> DVec3 {
    let down = (pose.rotation.transpose() * DVec3::NEG_Z).to_array();
    // Within a micrometre: a flat face counts with its middle.
    let lowest = mesh.extreme_point(down, mesh.extreme(down), 1e-3);
    let centre = DVec3::from_array(mesh.centre_mm());
    pose.rotation * (centre + DVec3::from_array(lowest)) + pose.translation_mm
}

#[pymethods]
impl Pressing {
    /// The tactile image.
    fn image<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        image(py, &self.sample)
    }

    /// A layer by its name; None where the sensor or the level has none.
    fn layer<'py>(&self, py: Python<'py>, name: &str) -> PyResult<Option<Bound<'py, PyAny>>> {
        let wanted = named("layer", name, OutputLayer::ALL.map(|layer| (layer.name(), layer)))?;
        let (impression, simulator) = (&self.sample.impression, &self.sample.simulator);
        let is_there = match wanted {
            OutputLayer::Pressure => simulator.models().gelpad.knows_pressure(),
            OutputLayer::Flow => simulator.knows_tractions(),
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
        if is_there { layer(py, &self.sample, wanted).map(Some) } else { Ok(None) }
    }

    /// The label, in a sequence with what the frame's has besides.
    fn label<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        let label = parsed(py, &json(&self.sample.label))?;
        if let Some(frame) = &self.frame {
            let frame = parsed(py, &json(frame))?.cast_into::<PyDict>()?;
            for key in ["wrench", "slip", "numerics", "health"] {
                label.set_item(key, frame.get_item(key)?)?;
            }
        }
        Ok(label)
    }

    /// Its number in the sequence, from 0; None of a press.
    #[getter]
    fn frame(&self) -> Option<u64> {
        self.number
    }
}
