//! Draws one press at random from the plan: object, pose, indentation, texture, shear, markers, camera, sensor. All
//! randomness of a sample is here. If a press is known otherwise, as from a simulator's depth frame, that replaces what
//! would be drawn.

use std::sync::Arc;

use glam::DMat3;

use crate::config::object::DEFAULT_POISSON_RATIO;
use crate::config::scene::At;
use crate::force::{MAX_DEPTH_RATIO, press_for_force};
use crate::layout::Split;
use crate::placing::{OtherObject, TurnedObject, place_other_objects};
use crate::plan::Plan;
use crate::plan::object_sampler::SamplePosition;
use crate::plan::sensors::DrawnSensor;
use gelsim_core::base::rng::{self, RandomStream};
use gelsim_core::camera::CameraParams;
use gelsim_core::camera::markers::MarkerPattern;
use gelsim_core::depth::indenter::{Indenter, Shape};
use gelsim_core::depth::outline::Outline;
use gelsim_core::depth::relief::Relief;
use gelsim_core::depth::texture::{Texture, TextureSample};
use gelsim_core::gelpad::elastic::elastic_object::ElasticObject;
use gelsim_core::gelpad::elastic::shear::{Friction, Motion};
use gelsim_core::gelpad::object_material::ObjectMaterial;
use gelsim_core::gelpad::tangential::Shear;
use gelsim_core::mesh::clusters::Clusters;
use gelsim_core::pose::{PadPlane, Pose};
use gelsim_core::simulator::{Press, Simulator};
use gelsim_files::diagnostic::Diagnostic;
use gelsim_files::sensor::quantity::Quantity;

/// Number of samples that are drawn to see whether their objects find places.
const PROBES: u64 = 32;

/// What is pressed into the pad.
#[derive(Clone, Debug)]
pub enum PressSource {
    /// The object with this index in the plan's sampling.
    Object(usize),
    /// Something that a depth frame shows.
    Frame(DepthFrame),
}

/// A depth frame, and what is known of the object in it.
#[derive(Clone, Debug)]
pub struct DepthFrame {
    /// Name of the object in labels.
    pub id: String,
    /// Class of the object; empty if none was given.
    pub class: String,
    /// The shape that the camera saw: heights over a flat pad, or the surface near a gel with a shape.
    pub shape: Shape,
}

/// A press whose object and pose are known.
#[derive(Clone, Debug)]
pub struct KnownPress {
    /// Split of the sample.
    pub split: Split,
    /// What is pressed.
    pub pressed: PressSource,
    /// Its pose.
    pub pose: Pose,
    /// Depth of its lowest point below the undeformed pad, mm; 0 without contact.
    pub indentation_depth_mm: f64,
}

/// A texture that was drawn.
#[derive(Clone, Debug)]
pub struct DrawnTexture {
    /// Name of the pattern.
    pub pattern: &'static str,
    /// The pattern.
    pub relief: Arc<Relief>,
    /// How the pattern lies on the object.
    pub sample: TextureSample,
}

/// What happens in one sample.
#[derive(Clone, Debug)]
pub struct Scene {
    /// Index of the sample.
    pub index: u64,
    /// Number of draws of it that were rejected before this one.
    pub attempt: u32,
    /// Split of the sample.
    pub split: Split,
    /// What is pressed into the pad.
    pub pressed: PressSource,
    /// The rotation that turns what is pressed of the object towards the pad, from which the pose begins.
    pub facing: DMat3,
    /// Pose of the object in the sensor's frame.
    pub pose: Pose,
    /// Depth of its lowest point below the undeformed pad, mm; 0 without contact.
    pub indentation_depth_mm: f64,
    /// Normal force that was wanted, N; 0 if a depth was.
    pub wanted_force_n: f64,
    /// Fraction of it within which the depth was found, 0 if a depth was wanted; or why none was found.
    pub force_found: Result<f64, String>,
    /// The texture of the object, if it has any.
    pub texture: Option<DrawnTexture>,
    /// Material of the object.
    pub material: ObjectMaterial,
    /// Motion of the object in the pad's plane after the press.
    pub motion: Motion,
    /// The pattern of the pad's markers, if it has any.
    pub markers: Option<MarkerPattern>,
    /// The camera.
    pub camera: CameraParams,
    /// The sensor, if samples differ in it.
    pub sensor: Option<Box<DrawnSensor>>,
    /// Whether the depth is measured on the sensor's axis and the object misses that.
    pub beside_axis: bool,
    /// Key of what differs between units of a sensor with pins.
    pub unit_key: u64,
    /// Factor on the size of the object; 1 for a known press.
    pub scale: f64,
    /// The scaled object; `None` if a depth frame stands for it.
    pub clusters: Option<Arc<Clusters>>,
    /// The plane over which it is posed: the flat pad, or one that touches a gel that is not flat.
    pub plane: PadPlane,
    /// Its pose over that plane.
    pub over_plane: Pose,
    /// The objects that are pressed in beside it.
    pub other_objects: Vec<OtherObject>,
    /// Number of further objects for which there was no place.
    pub unplaced: u32,
}

/// What is drawn of a sensor, independent of what is pressed into it.
struct SensorDraw {
    markers: Option<MarkerPattern>,
    camera: CameraParams,
    sensor: Option<Box<DrawnSensor>>,
    unit_key: u64,
}

impl SensorDraw {
    fn draw(plan: &Plan, stream: impl Fn(&str) -> RandomStream) -> Self {
        let draw = |name: &str, quantity: &Quantity| quantity.sample(&mut stream(name));
        let (job, noise_key) = (&plan.job, stream("noise").next_bits());
        Self {
            markers: job.markers.as_ref().and_then(|markers| markers.sample_pattern(draw)),
            camera: job.camera.sample_params(noise_key, draw),
            sensor: plan.sensors.sample(job, &stream),
            unit_key: stream("pins").next_bits(),
        }
    }
}

impl Scene {
    /// Draws sample `index`, for the first time or after `attempt` rejected draws. The result depends only on these two
    /// and on the plan's seed and distributions.
    pub fn draw(plan: &Plan, index: u64, attempt: u32) -> Self {
        let stream = |name: &str| rng::random_stream(plan.seed(), name, rng::redraw_index(index, attempt));
        let draw = |name: &str, quantity: &Quantity| quantity.sample(&mut stream(name));
        let (split, position) = plan.layout.split_of(index);
        let object = plan.sampling.object_samplers[split.number()].pick_object(SamplePosition {
            seed: plan.seed(),
            position,
            index: rng::redraw_index(index, attempt),
            is_first_draw: attempt == 0,
        });

        let indentation = &plan.job.indentation;
        let touches = Self::should_touch(plan, index, attempt);
        let turned = TurnedObject::draw(plan, object, touches, stream);
        let mut position_mm = [draw("x", &plan.job.pose.x_mm), draw("y", &plan.job.pose.y_mm)];
        if let Some(grid) = plan.job.pose.grid {
            let place_mm = grid.place_mm(position / plan.sampling.object_samplers[split.number()].turn_length());
            position_mm = std::array::from_fn(|k| position_mm[k] + place_mm[k]);
        }
        let pose = turned.pose_at(position_mm, plan.job.pose.anchor);
        let TurnedObject { facing, scale, clusters: scaled, depth_mm, .. } = turned;
        let clusters = &*scaled;
        let on_axis = match indentation.at {
            At::Axis if touches => pose.with_axis_at(-depth_mm, clusters),
            _ => Some(pose),
        };
        let (beside_axis, pose) = (on_axis.is_none(), on_axis.unwrap_or(pose));
        let over_plane = pose;
        let place = &plan.job.pose;
        let mut plane = PadPlane::default();
        let pose = match (&plan.simulator.sensor().shape, &place.from_tip_mm, &place.around_deg) {
            (None, _, _) | (_, None, None) => pose,
            (Some(shape), from_tip, around) => {
                let [from_tip_mm, around_deg] = [("from tip", from_tip), ("around", around)]
                    .map(|(name, quantity)| quantity.as_ref().map_or(0.0, |quantity| draw(name, quantity)));
                let (axes, origin_mm) = shape.frame_at(from_tip_mm, around_deg);
                plane = PadPlane { axes, origin_mm };
                pose.within(axes, origin_mm)
            }
        };
        let indentation_depth_mm = if touches { depth_mm } else { 0.0 };
        let first = (clusters, &over_plane);
        let (others, unplaced) =
            place_other_objects(plan, split, rng::redraw_index(index, attempt), touches, first, &plane);
        let press = KnownPress { split, pressed: PressSource::Object(object), pose, indentation_depth_mm };
        let mut scene = Self::from_press_of(plan, index, attempt, press, Some(Arc::clone(&scaled)));
        scene.motion.about_mm = position_mm;
        scene.beside_axis = beside_axis;
        scene.scale = scale;
        scene.facing = facing;
        (scene.plane, scene.over_plane) = (plane, over_plane);
        (scene.other_objects, scene.unplaced) = (others, unplaced);
        if let Some(force) = indentation.force_n.as_ref().filter(|_| touches) {
            scene.wanted_force_n = draw("indentation force", force);
        }
        scene
    }

    /// Draws sample `index` as [`Scene::draw`] does, and presses its objects as deep as the force that was drawn takes
    /// them, if one was.
    pub fn draw_pressed(plan: &Plan, index: u64, attempt: u32) -> Self {
        let scene = Self::draw(plan, index, attempt);
        if scene.wanted_force_n > 0.0 { scene.press_by_force(plan) } else { scene }
    }

    /// Presses the objects, which just touch the pad, as deep as the wanted force takes them.
    fn press_by_force(self, plan: &Plan) -> Self {
        let simulator = self.simulator(plan);
        let most_mm = MAX_DEPTH_RATIO * simulator.sensor().gelpad.thickness_mm;
        let (depth_mm, force_found) = press_for_force(self.wanted_force_n, most_mm, |depth_mm| {
            simulator.total_force_n(&self.lowered_by(depth_mm).to_press(plan))
        });
        Self { force_found, ..self.lowered_by(depth_mm) }
    }

    /// Returns the scene with all objects this much deeper, mm.
    fn lowered_by(&self, depth_mm: f64) -> Self {
        let mut lowered = self.clone();
        lowered.over_plane.translation_mm.z -= depth_mm;
        lowered.pose = self.plane.pose_in_sensor(lowered.over_plane);
        lowered.indentation_depth_mm += depth_mm;
        for other in &mut lowered.other_objects {
            other.pose.translation_mm -= depth_mm * self.plane.axes.z_axis;
            other.indentation_depth_mm += depth_mm;
        }
        lowered
    }

    /// Returns whether the object of a draw should touch the pad, or stay just above it.
    pub fn should_touch(plan: &Plan, index: u64, attempt: u32) -> bool {
        let mut stream = rng::random_stream(plan.seed(), "contact", rng::redraw_index(index, attempt));
        stream.uniform() >= plan.job.indentation.no_contact
    }

    /// Returns the same object as the opposite finger of a gripper sees it, with what that finger's own plan `right`
    /// draws. The depth is not set.
    pub fn seen_from_finger(&self, right: &Plan) -> Self {
        // The right finger draws from streams of its own, since the two are different sensors.
        let seed = rng::random_stream(right.sensor_seed(), "right finger", 0).next_bits();
        let redrawn = rng::redraw_index(self.index, self.attempt);
        let finger = SensorDraw::draw(right, |name| rng::random_stream(seed, name, redrawn));
        let Motion { shift_mm: [x, y], twist_rad, about_mm } = self.motion;
        let mirrored = |[x, y]: [f64; 2]| [0.0 - x, y];
        let pose = self.pose.seen_by_opposite_pad();
        Self {
            pose,
            over_plane: pose,
            motion: Motion { shift_mm: mirrored([x, y]), twist_rad: 0.0 - twist_rad, about_mm: mirrored(about_mm) },
            markers: finger.markers,
            camera: finger.camera,
            sensor: finger.sensor,
            unit_key: finger.unit_key,
            ..self.clone()
        }
    }

    /// Returns the same press as another sensor sees it, with what that sensor's own plan draws of markers, camera and
    /// unit. The two sensors must have the same pad and view.
    pub fn seen_by_sensor(&self, other: &Plan) -> Self {
        let redrawn = rng::redraw_index(self.index, self.attempt);
        let drawn = SensorDraw::draw(other, |name| rng::random_stream(other.sensor_seed(), name, redrawn));
        let SensorDraw { markers, camera, sensor, unit_key } = drawn;
        Self { markers, camera, sensor, unit_key, ..self.clone() }
    }

    /// Returns the scene with the object's lowest point this deep below the undeformed pad, mm; negative above it.
    /// Nothing changes if the object is no mesh.
    pub fn at_depth(&self, depth_mm: f64) -> Self {
        let Some(clusters) = &self.clusters else { return self.clone() };
        let pose = self.pose.lowered(-depth_mm, clusters);
        Self { pose, over_plane: pose, indentation_depth_mm: depth_mm.max(0.0), ..self.clone() }
    }

    /// Makes the scene of a known press. All else is drawn as for sample `index` after `attempt` rejected draws. Shear
    /// turns about the pose's origin.
    pub fn from_known_press(plan: &Plan, index: u64, attempt: u32, press: KnownPress) -> Self {
        let clusters = match &press.pressed {
            PressSource::Object(number) => Some(plan.sampling.objects[*number].geometry.clusters()),
            PressSource::Frame(_) => None,
        };
        Self::from_press_of(plan, index, attempt, press, clusters)
    }

    /// Makes the scene of a known press of an object with this geometry, which may have to be read.
    fn from_press_of(
        plan: &Plan,
        index: u64,
        attempt: u32,
        press: KnownPress,
        clusters: Option<Arc<Clusters>>,
    ) -> Self {
        let stream = |name: &str| rng::random_stream(plan.seed(), name, rng::redraw_index(index, attempt));
        let draw = |name: &str, quantity: &Quantity| quantity.sample(&mut stream(name));
        let KnownPress { split, pressed, pose, indentation_depth_mm } = press;
        let job = &plan.job;
        let number = match &pressed {
            PressSource::Object(number) => Some(*number),
            PressSource::Frame(_) => None,
        };
        let own = number.and_then(|number| {
            job.object[number].texture.as_ref().zip(plan.sampling.objects[number].textures.as_ref())
        });
        let (texture, reliefs) = own.unwrap_or((&job.texture, &plan.sampling.textures));
        let texture = (!reliefs.is_empty()).then(|| {
            let mut offset = stream("texture offset");
            let pattern = stream("texture pattern").uniform_below(reliefs.len());
            let sample = TextureSample {
                amplitude_mm: draw("texture amplitude", &texture.amplitude_mm),
                scale_mm: draw("texture scale", &texture.scale_mm),
                angle_deg: draw("texture angle", &texture.angle_deg),
                offset: [offset.uniform(), offset.uniform()],
            };
            DrawnTexture { pattern: texture.patterns[pattern].name(), relief: Arc::clone(&reliefs[pattern]), sample }
        });
        let material = number.map_or_else(ObjectMaterial::default, |number| {
            let entry = &job.object[number];
            let drawn =
                |name: &str, quantity: &Option<Quantity>| quantity.as_ref().map(|quantity| draw(name, quantity));
            let elastic = drawn("object modulus", &entry.youngs_modulus_kpa).map(|youngs_modulus_kpa| ElasticObject {
                youngs_modulus_kpa,
                poisson_ratio: drawn("object poisson ratio", &entry.poisson_ratio).unwrap_or(DEFAULT_POISSON_RATIO),
            });
            let friction = drawn("object friction", &entry.friction);
            ObjectMaterial { soft: elastic, friction: friction.map(|coefficient| Friction::Coulomb { coefficient }) }
        });
        let shear = &job.shear;
        let motion = Motion {
            shift_mm: [draw("shear x", &shear.x_mm), draw("shear y", &shear.y_mm)],
            twist_rad: draw("twist", &shear.twist_deg).to_radians(),
            about_mm: [pose.translation_mm.x, pose.translation_mm.y],
        };
        let redrawn = rng::redraw_index(index, attempt);
        let SensorDraw { markers, camera, sensor, unit_key } =
            SensorDraw::draw(plan, |name| rng::random_stream(plan.sensor_seed(), name, redrawn));
        Self {
            index,
            attempt,
            split,
            pressed,
            facing: DMat3::IDENTITY,
            pose,
            indentation_depth_mm,
            wanted_force_n: 0.0,
            force_found: Ok(0.0),
            texture,
            material,
            motion,
            markers,
            camera,
            sensor,
            beside_axis: false,
            unit_key,
            scale: 1.0,
            clusters,
            plane: PadPlane::default(),
            over_plane: pose,
            other_objects: Vec::new(),
            unplaced: 0,
        }
    }

    /// Returns the depth of the deepest of its objects below the undeformed pad, mm; 0 without contact.
    pub fn deepest_mm(&self) -> f64 {
        self.other_objects
            .iter()
            .fold(self.indentation_depth_mm, |deepest, other| deepest.max(other.indentation_depth_mm))
    }

    /// Returns how far what is pressed reaches below the undeformed pad, mm; 0 without contact. Its depth may be measured
    /// on the sensor's axis, where it need not be deepest.
    pub fn reach_mm(&self, plan: &Plan) -> f64 {
        match plan.job.indentation.at {
            At::Axis => self.indenter(plan).depth_mm().max(0.0),
            _ => self.deepest_mm(),
        }
    }

    /// Returns the outlines of its objects in the plane over which they are posed, the first object's first. Empty for
    /// a depth frame.
    pub fn outlines(&self) -> Vec<Outline> {
        let first = self.clusters.iter().map(|clusters| Outline::of(clusters, &self.over_plane));
        first.chain(self.other_objects.iter().map(|other| other.outline.clone())).collect()
    }

    /// Returns what is pressed, with its pose.
    pub fn indenter(&self, plan: &Plan) -> Indenter {
        // Several objects are pressed as one mesh.
        if let (Some(first), false) = (&self.clusters, self.other_objects.is_empty()) {
            let others =
                self.other_objects.iter().map(|other| Indenter::clusters(Arc::clone(&other.clusters), other.pose));
            let first = Indenter::clusters(Arc::clone(first), self.pose);
            let all: Vec<Indenter> = std::iter::once(first).chain(others).collect();
            if let Some(together) = Indenter::join_meshes(&all) {
                return Indenter::of_known_depth(together.shape().clone(), *together.pose(), self.deepest_mm());
            }
        }
        let shape = match (&self.pressed, &self.clusters) {
            (PressSource::Frame(frame), _) => frame.shape.clone(),
            (PressSource::Object(_), Some(clusters)) => Shape::Mesh(Arc::clone(clusters)),
            (PressSource::Object(number), None) => Shape::Mesh(plan.sampling.objects[*number].geometry.clusters()),
        };
        // If the depth is measured elsewhere than at the lowest point, it does not say whether that reaches into the
        // pad.
        let depth_mm = match (&shape, plan.job.indentation.at) {
            (Shape::Mesh(clusters), At::Axis) => -self.pose.lowest_mm(clusters),
            _ => self.indentation_depth_mm,
        };
        Indenter::of_known_depth(shape, self.pose, depth_mm)
    }

    /// Returns the simulator of the scene's sensor. It is that of the plan if all samples have the same sensor;
    /// otherwise it shares with that what both have in common.
    pub fn simulator(&self, plan: &Plan) -> Arc<Simulator> {
        let Some(drawn) = &self.sensor else { return Arc::clone(&plan.simulator) };
        Arc::new(plan.simulator_of(drawn))
    }

    /// Returns a press of the same objects by another sensor, with what this scene's sensor draws.
    pub fn press_again(&self, press: &Press) -> Press {
        let mut again = press.clone();
        (again.markers, again.camera, again.unit_key) = (self.markers, self.camera, self.unit_key);
        again
    }

    /// Converts to the press that the simulator renders.
    pub fn to_press(&self, plan: &Plan) -> Press {
        let texture = |DrawnTexture { relief, sample, .. }: &DrawnTexture| Texture {
            relief: Arc::clone(relief),
            sample: *sample,
            placement: None,
        };
        let friction = plan.job.shear.friction;
        let mut press = Press::new(self.indenter(plan), plan.simulator.sensor());
        press.texture = self.texture.as_ref().map(texture);
        press.material = self.material;
        press.shear = plan.sampling.moves_objects.then_some(Shear { motion: self.motion, friction });
        press.markers = self.markers;
        press.camera = self.camera;
        press.unit_key = self.unit_key;
        press.plane = self.plane;
        press
    }
}

/// Makes a warning if more than a tenth of a job's objects find no place among the others of their press, as drawn for
/// its first samples.
pub fn note_crowded_scenes(plan: &Plan) -> Option<Diagnostic> {
    if plan.job().objects_per_sample().max < 2 {
        return None;
    }
    let (mut placed, mut unplaced) = (0, 0);
    let samples = plan.layout.sample_count().min(PROBES);
    for index in 0..samples {
        let scene = Scene::draw(plan.for_sample(index, 0), index, 0);
        placed += 1 + scene.other_objects.len() as u64;
        unplaced += u64::from(scene.unplaced);
    }
    (10 * unplaced > placed + unplaced).then(|| {
        let message = format!(
            "of the {} objects of the first {samples} samples {unplaced} find no place among the others",
            placed + unplaced
        );
        let help = "spread x_mm and y_mm in [pose], take smaller objects, or lower scene.objects_per_sample";
        Diagnostic::warning(message).help(help)
    })
}
