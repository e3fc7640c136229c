//! The engine of `gelsim.Simulator`, which presses meshes and height maps one by one.
//! `python/gelsim/simulator.py` has the class that users see.

use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::{Arc, Mutex, OnceLock, PoisonError};

use gelsim_core::base::clock::Seconds;
use gelsim_core::depth::height_map::HeightMap;
use gelsim_core::depth::indenter::Shape;
use gelsim_core::depth::patterns::Procedural;
use gelsim_core::depth::relief::Relief;
use gelsim_core::depth::texture::TextureSample;
use gelsim_core::gelpad::elastic::elastic_object::ElasticObject;
use gelsim_core::gelpad::elastic::shear::{Friction, Motion};
use gelsim_core::gelpad::tangential::Shear;
use gelsim_core::impression::Impression;
use gelsim_core::mesh::clusters::Clusters;
use gelsim_core::pose::{Anchor, Angles, PadPlane, Pose, Side};
use gelsim_core::simulator::Simulator;
use gelsim_dataset::encode::to_json_line;
use gelsim_dataset::frames::reader::{FrameReader, SeenFrame};
use gelsim_dataset::frames::sequence::find_lowest_point;
use gelsim_files::diagnostic::{Diagnostics, Report};
use gelsim_job::label::Label;
use gelsim_job::layers::OutputLayer;
use gelsim_job::layout::Split;
use gelsim_job::plan::{Plan, SampleSources};
use gelsim_job::sample::Sample;
use gelsim_job::scene::{DepthFrame, DrawnTexture, KnownPress, PressSource, Scene};
use gelsim_job::sequence::label::{FrameLabel, StepLabel};
use glam::DVec3;
use pyo3::prelude::*;
use pyo3::sync::PyOnceLock;

use crate::arguments::{OptionalArgument, extract_assignments, extract_whole_number};
use crate::arrays::{image_array, layer_array, parse_json};
use crate::depth::DepthMaps;
use crate::errors::{emit_warnings, find_by_name, mistake_error, panic_error, runtime_error, usage_error};
use crate::job::ALLOWED_SEEDS;
use crate::mesh::ReadyMesh;
use crate::sensor::{ALLOWED_INDICES, FROM_LENS, Sensor, read_distances};
use crate::sequence::Sequence;

/// A sensor prepared at a fidelity level; held by `gelsim.Simulator`.
#[pyclass(frozen, module = "gelsim._native")]
pub struct Engine {
    pub plan: Plan,
    /// Reliefs of the patterns that were used so far.
    reliefs: Mutex<Vec<(&'static str, Arc<Relief>)>>,
    pub sequence: Sequence,
    /// Reader of depth frames inside a gel that has a shape, made when the first one comes.
    inside: OnceLock<FrameReader>,
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
    /// Pixels of the image until Python has them: red, green and blue of each.
    rgb: Mutex<Vec<u8>>,
    image: PyOnceLock<Py<PyAny>>,
    /// Number and label of the frame, in a sequence.
    frame: Option<(u64, FrameLabel)>,
}

/// An object that was read, and where it is.
pub struct PlacedObject {
    name: String,
    pub shape: Shape,
    pub site: ObjectSite,
    /// Point about which a shear turns it, mm.
    about_mm: [f64; 2],
}

/// Where an object is.
#[derive(Clone, Copy)]
pub struct ObjectSite {
    pub pose: Pose,
    /// How deep it reaches into the pad, mm; 0 or less without contact.
    pub depth_mm: f64,
    /// The plane along whose normal that is, if the object may be anywhere on a gel that has a shape.
    pub plane: Option<PadPlane>,
    /// The point of it that is deepest, mm; of frames, which cannot be moved to see it elsewhere.
    pub deepest_mm: Option<DVec3>,
}

impl ObjectPlace {
    /// Places a mesh. A `Pose` presses it along z, as a job does; a `Placement` may be anywhere on a gel that has a shape.
    fn place_mesh(&self, name: &str, clusters: &Arc<Clusters>, simulator: &Simulator) -> PyResult<PlacedObject> {
        let shape = Shape::Mesh(Arc::clone(clusters));
        let name = name.to_owned();
        match self {
            Self::Posed(PoseArgument { depth_mm, x_mm, y_mm, yaw_deg, tilt_deg, tilt_azimuth_deg, face, anchor }) => {
                let side = find_by_name("face", face, ["+x", "-x", "+y", "-y", "+z", "-z"].into_iter().zip(SIDES))?;
                let anchors = [Anchor::Bounds, Anchor::Origin, Anchor::Contact];
                let anchor = find_by_name("anchor", anchor, ["bounds", "origin", "contact"].into_iter().zip(anchors))?;
                let [yaw_deg, tilt_deg, tilt_azimuth_deg] = [*yaw_deg, *tilt_deg, *tilt_azimuth_deg];
                let angles = Angles { yaw_deg, tilt_deg, tilt_azimuth_deg };
                let pose = Pose::new(side, angles, [*x_mm, *y_mm], anchor, 0.0 - depth_mm, clusters);
                let (pose, depth_mm) = (check_finite_pose(&pose)?, *depth_mm);
                let site = ObjectSite { pose, depth_mm, plane: None, deepest_mm: None };
                Ok(PlacedObject { name, shape, site, about_mm: [*x_mm, *y_mm] })
            }
            Self::Placed(placed) => {
                let pose = placed.to_pose()?;
                let DVec3 { x, y, .. } = pose.translation_mm;
                let (plane, depth_mm) = simulator.find_contact_plane(clusters, &pose);
                let plane = simulator.sensor().shape.is_some().then_some(plane);
                let site = ObjectSite { pose, depth_mm, plane, deepest_mm: None };
                Ok(PlacedObject { name, shape, site, about_mm: [x, y] })
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
    pub fn read_object(
        &self,
        py: Python<'_>,
        name: &str,
        given: &Bound<'_, PyAny>,
        place: Option<&ObjectPlace>,
    ) -> PyResult<PlacedObject> {
        let thickness_mm = self.plan.thickness_mm();
        if let Ok(mesh) = given.cast::<ReadyMesh>() {
            let clusters = &mesh.get().clusters;
            let mut notes = Diagnostics::default();
            notes.extend(mesh.get().unit_warning(self.plan.simulator.sensor().field_of_view_mm));
            emit_warnings(py, &Report::new(&notes, &[]))?;
            let help = "pose=gelsim.Pose(0.5) presses it in by 0.5 mm, in the middle of the image";
            let place = place.ok_or_else(|| mistake_error("a mesh needs a pose", help))?;
            let object = place.place_mesh(name, clusters, &self.plan.simulator)?;
            if object.site.depth_mm > thickness_mm {
                let message =
                    format!("the object is {:.3} mm deep in a pad of {thickness_mm} mm", object.site.depth_mm);
                return Err(mistake_error(message, "press it less deep, or move the pose out of the pad, along z"));
            }
            return Ok(object);
        }
        let simulator = &self.plan.simulator;
        let is_curved = simulator.sensor().shape.is_some();
        let input = DepthMaps::extract_input(given, is_curved)?;
        let depth = DepthMaps::new(&input);
        let ([width, height], found) = (simulator.view().resolution_px, depth.resolution_px());
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
        let pose = match place {
            None => Pose::IDENTITY,
            Some(ObjectPlace::Placed(placed)) => placed.to_pose()?,
            Some(ObjectPlace::Posed(_)) => {
                let help = "gelsim.Placement says where the object is that the heights show, or leave pose out";
                return Err(mistake_error("heights are where they are: gelsim.Pose does not move them", help));
            }
        };
        let DVec3 { x, y, .. } = pose.translation_mm;
        let placed = |shape, depth_mm, plane, deepest_mm| {
            let site = ObjectSite { pose, depth_mm, plane, deepest_mm };
            PlacedObject { name: name.to_owned(), shape, site, about_mm: [x, y] }
        };
        if is_curved {
            let reader = self.inside_reader(found)?;
            let seen = py.detach(|| read_distances(reader, &depth, 0))?;
            let depth_mm = seen.indentation_depth_mm();
            let SeenFrame::Gel(frame) = seen else { unreachable!("the gel has a shape") };
            let deepest = frame.deepest_contact();
            let plane = deepest.map_or_else(PadPlane::default, |(at, _)| PadPlane::tangent_at(at.point_mm, at.normal));
            let shape = py.detach(|| frame.to_shape(&pose));
            return Ok(placed(shape, depth_mm, Some(plane), deepest.map(|(_, point_mm)| point_mm)));
        }
        let seen = py.detach(|| depth.inspect(0..1, thickness_mm));
        emit_warnings(py, &depth.report_findings(&seen, thickness_mm).map_err(|report| usage_error(&report))?)?;
        let map = HeightMap { above_mm: depth.above_mm(0), unseen_px: 0 };
        // The values were checked, but another thread may write to the array meanwhile.
        if map.above_mm.data.iter().any(|mm| mm.is_nan() || *mm == f32::NEG_INFINITY) {
            return Err(runtime_error("depth_mm has changed while it was read; give a copy: depth_mm.copy()"));
        }
        let (depth_mm, deepest_mm) = (map.indentation_depth_mm(), find_lowest_point(&map, simulator.view()));
        Ok(placed(Shape::HeightMap(Arc::new(map)), depth_mm, None, deepest_mm))
    }

    /// Returns the reader of the depth frames of a camera inside the gel.
    fn inside_reader(&self, size_px: [usize; 2]) -> PyResult<&FrameReader> {
        if self.inside.get().is_none() {
            let help = "press a mesh, or render depth frames with gelsim.Sensor.render, which takes other cameras";
            let reader = FrameReader::new(FROM_LENS, &self.plan.simulator, size_px);
            // Another thread may have been faster; both made the same.
            let _ = self.inside.set(reader.map_err(|problem| mistake_error(problem.message, help))?);
        }
        Ok(self.inside.get().expect("it was just set"))
    }

    /// Returns a texture as it was asked for. The relief of a pattern is made once.
    pub fn make_texture(&self, py: Python<'_>, cut: &TextureArgument) -> PyResult<DrawnTexture> {
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
}

/// Makes the scene of an object, with everything else drawn as for sample `index`.
pub fn build_scene(plan: &Plan, index: u64, object: PlacedObject, texture: Option<DrawnTexture>) -> Scene {
    let PlacedObject { name, shape, about_mm, site: ObjectSite { pose, depth_mm, plane, .. } } = object;
    let pressed = PressSource::Frame(DepthFrame { id: name, class: String::new(), shape });
    let indentation_depth_mm = depth_mm.max(0.0);
    let mut scene = Scene::from_known_press(
        plan,
        index,
        0,
        KnownPress { split: Split::Train, pressed, pose, indentation_depth_mm },
    );
    scene.motion.about_mm = about_mm;
    scene.plane = plane.unwrap_or_default();
    scene.texture = texture.or(scene.texture);
    scene
}

/// Makes the sample of an impression, with its label.
pub fn label_sample(plan: &Plan, scene: &Scene, simulator: Arc<Simulator>, impression: Impression) -> Sample {
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
        Ok(Self { plan, reliefs: Mutex::default(), sequence: Sequence::default(), inside: OnceLock::new() })
    }

    /// Returns a copy with a sequence of its own.
    fn copy(&self) -> Self {
        let reliefs = self.reliefs.lock().unwrap_or_else(PoisonError::into_inner).clone();
        Self {
            plan: self.plan.clone(),
            reliefs: Mutex::new(reliefs),
            sequence: Sequence::default(),
            inside: OnceLock::new(),
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

    #[getter]
    fn field_of_view_mm(&self) -> (f64, f64) {
        self.plan.simulator.sensor().field_of_view_mm.into()
    }

    #[getter]
    fn gelpad_thickness_mm(&self) -> f64 {
        self.plan.thickness_mm()
    }

    #[getter]
    fn is_flat(&self) -> bool {
        self.plan.simulator.sensor().shape.is_none()
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
        let sample = rendered.map_err(|panic| panic_error("this press", &*panic))?;
        Ok(Pressing::new(sample, None))
    }

    /// Begins a new sequence, and makes ready what its first frame needs.
    fn reset(
        &self,
        py: Python<'_>,
        friction: Option<f64>,
        index: OptionalArgument<'_, '_>,
        seed: OptionalArgument<'_, '_>,
    ) -> PyResult<()> {
        self.sequence.begin(friction, index, seed)?;
        py.detach(|| self.plan.simulator.sliding(Friction::Stick));
        Ok(())
    }
}

impl Engine {
    /// Returns the plan with this seed.
    pub fn plan_with_seed(&self, seed: u64) -> PyResult<Plan> {
        let layers = self.plan.layers();
        self.plan.with_samples(seed, &layers).map_err(|report| usage_error(&report))
    }
}

impl Pressing {
    pub fn new(mut sample: Sample, frame: Option<(u64, FrameLabel)>) -> Self {
        let rgb = std::mem::take(&mut sample.impression.image.rgb);
        Self { sample, rgb: Mutex::new(rgb), image: PyOnceLock::new(), frame }
    }
}

#[pymethods]
impl Pressing {
    /// Returns the tactile image, the same array every time.
    fn image<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        let make = || {
            let rgb = std::mem::take(&mut *self.rgb.lock().unwrap_or_else(PoisonError::into_inner));
            image_array(py, &self.sample, rgb).map(Bound::unbind)
        };
        self.image.get_or_try_init(py, make).map(|image| image.bind(py).clone())
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
        let press = &self.sample.label;
        let label = match &self.frame {
            None => to_json_line(press),
            Some((_, frame)) => to_json_line(&StepLabel::new(press.clone(), frame)),
        };
        parse_json(py, &label)
    }

    /// Number in the sequence, from 0; None for a press.
    #[getter]
    fn frame(&self) -> Option<u64> {
        self.frame.as_ref().map(|(number, _)| *number)
    }
}
