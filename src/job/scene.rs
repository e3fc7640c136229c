//! One press, drawn at random from the plan: object, pose, indentation, texture, shear, markers, camera, sensor. All randomness
//! of a sample is here. What is known of a press instead, such as a simulator's depth frame, takes the place of what
//! would be drawn.

use std::sync::Arc;

use crate::config::object::POISSON_RATIO;
use crate::config::scene::At;
use crate::layout::Split;
use crate::placing::{OtherObject, TurnedObject, place_beside};
use crate::plan::Plan;
use crate::plan::draw::Place;
use crate::plan::sensors::DrawnSensor;
use gelsim_core::base::rng::{self, Stream};
use gelsim_core::camera::CameraParams;
use gelsim_core::camera::markers::MarkerPattern;
use gelsim_core::depth::indenter::{Indenter, Shape};
use gelsim_core::depth::outline::Outline;
use gelsim_core::depth::relief::Relief;
use gelsim_core::depth::texture::{Texture, TextureSample};
use gelsim_core::gelpad::elastic::shear::{Friction, Motion};
use gelsim_core::gelpad::elastic::soft::ElasticObject;
use gelsim_core::gelpad::object::ObjectMaterial;
use gelsim_core::gelpad::tangential::Shear;
use gelsim_core::mesh::clusters::Clusters;
use gelsim_core::pose::{PadPlane, Pose, Side};
use gelsim_core::sensor::Background;
use gelsim_core::simulator::{Press, Simulator};
use gelsim_files::diagnostic::Diagnostic;
use gelsim_files::sensor::quantity::Quantity;

/// Samples that are drawn to see whether objects find their places.
const PROBES: u64 = 32;

/// What is pressed into the pad.
#[derive(Clone, Debug)]
pub enum Pressed {
    /// The object of this number in the plan's sampling.
    Object(usize),
    /// Something of which a depth frame is known.
    Frame(Frame),
}

/// A depth frame, and what is known of what it shows.
#[derive(Clone, Debug)]
pub struct Frame {
    /// Name of what is seen, as labels give it.
    pub id: String,
    /// Its class; empty if nobody named one.
    pub class: String,
    /// What the camera saw: heights over a flat pad, or the surface near a gel that has a shape.
    pub shape: Shape,
}

/// A press of which the object and its place are known.
#[derive(Clone, Debug)]
pub struct KnownPress {
    /// The sample's split.
    pub split: Split,
    /// What is pressed.
    pub pressed: Pressed,
    /// Where it is.
    pub pose: Pose,
    /// How deep its lowest point reaches below the undeformed pad, mm; 0 without contact.
    pub indentation_depth_mm: f64,
}

/// A texture that was drawn.
#[derive(Clone, Debug)]
pub struct DrawnTexture {
    /// Name of its pattern.
    pub pattern: &'static str,
    /// The pattern.
    pub relief: Arc<Relief>,
    /// How it lies on the object.
    pub sample: TextureSample,
}

/// What happens in one sample.
#[derive(Clone, Debug)]
pub struct Scene {
    /// The sample's number.
    pub index: u64,
    /// How many draws of it were rejected before this one.
    pub attempt: u32,
    /// Its split.
    pub split: Split,
    /// What is pressed into the pad.
    pub pressed: Pressed,
    /// Its side that faces the pad, from which the pose begins.
    pub side: Side,
    /// Where it is.
    pub pose: Pose,
    /// How deep its lowest point reaches below the undeformed pad, mm; 0 without contact.
    pub indentation_depth_mm: f64,
    /// The texture of the object, if it has any.
    pub texture: Option<DrawnTexture>,
    /// What the object is made of.
    pub material: ObjectMaterial,
    /// How the object moves in the pad's plane after that.
    pub motion: Motion,
    /// The pattern of the pad's markers, if it has any.
    pub markers: Option<MarkerPattern>,
    /// The camera.
    pub camera: CameraParams,
    /// The sensor, if samples differ in it.
    pub sensor: Option<Box<DrawnSensor>>,
    /// Its depth is measured on the sensor's axis, and the object is beside that.
    pub beside_axis: bool,
    /// Key of what differs between units of a sensor with pins.
    pub unit_key: u64,
    /// Factor on the size of the object; 1 for a press that is known.
    pub scale: f64,
    /// The object so large; none where a depth frame stands for it.
    pub clusters: Option<Arc<Clusters>>,
    /// The plane that it is posed over: the flat pad, or one that touches a gel that is not flat.
    pub plane: PadPlane,
    /// Where it is over that plane.
    pub over_plane: Pose,
    /// The objects that are pressed in together with it.
    pub others: Vec<OtherObject>,
    /// How many more were to be, and found no place.
    pub unplaced: u32,
}

/// What is drawn of a sensor, whatever is pressed into it.
struct Finger {
    markers: Option<MarkerPattern>,
    camera: CameraParams,
    sensor: Option<Box<DrawnSensor>>,
    unit_key: u64,
}

impl Finger {
    fn draw(plan: &Plan, stream: impl Fn(&str) -> Stream) -> Self {
        let draw = |name: &str, quantity: &Quantity| quantity.sample(&mut stream(name));
        let (job, noise_key) = (&plan.job, stream("noise").bits());
        Self {
            markers: job.markers.as_ref().and_then(|markers| markers.sample(draw)),
            camera: job.camera.sample(noise_key, draw),
            sensor: plan.sensors.sample(job, &stream),
            unit_key: stream("pins").bits(),
        }
    }
}

impl Scene {
    /// Draws sample `index` for the first time, or after `attempt` draws of it were rejected. Depends on these two and on
    /// the plan's seed and distributions only.
    pub fn draw(plan: &Plan, index: u64, attempt: u32) -> Self {
        let stream = |name: &str| rng::stream(plan.seed(), name, rng::redrawn(index, attempt));
        let draw = |name: &str, quantity: &Quantity| quantity.sample(&mut stream(name));
        let (split, position) = plan.layout.split_of(index);
        let object = plan.sampling.draw[split.number()].pick(Place {
            seed: plan.seed(),
            position,
            index: rng::redrawn(index, attempt),
            first: attempt == 0,
        });

        let indentation = &plan.job.indentation;
        let touches = Self::touches(plan, index, attempt);
        let turned = TurnedObject::draw(plan, object, touches, stream);
        let position_mm = [draw("x", &plan.job.pose.x_mm), draw("y", &plan.job.pose.y_mm)];
        let pose = turned.at(position_mm, plan.job.pose.anchor);
        let TurnedObject { side, scale, clusters: scaled, depth_mm, .. } = turned;
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
        let (others, unplaced) = place_beside(plan, split, rng::redrawn(index, attempt), touches, first, &plane);
        let press = KnownPress { split, pressed: Pressed::Object(object), pose, indentation_depth_mm };
        let mut scene = Self::given(plan, index, attempt, press);
        scene.motion.about_mm = position_mm;
        scene.beside_axis = beside_axis;
        scene.scale = scale;
        scene.side = side;
        scene.clusters = Some(scaled);
        (scene.plane, scene.over_plane) = (plane, over_plane);
        (scene.others, scene.unplaced) = (others, unplaced);
        scene
    }

    /// Whether the object of a draw touches the pad, or stays just above it.
    pub fn touches(plan: &Plan, index: u64, attempt: u32) -> bool {
        let mut stream = rng::stream(plan.seed(), "contact", rng::redrawn(index, attempt));
        stream.unit() >= plan.job.indentation.no_contact
    }

    /// The same object as a gripper's right finger sees it, which faces this one, with what that finger's own plan draws of
    /// it. How deep it is pressed is left open.
    pub fn faced(&self, right: &Plan) -> Self {
        // Streams of its own: two fingers are two sensors.
        let seed = rng::stream(right.seed(), "right finger", 0).bits();
        let redrawn = rng::redrawn(self.index, self.attempt);
        let finger = Finger::draw(right, |name| rng::stream(seed, name, redrawn));
        let Motion { shift_mm: [x, y], twist_rad, about_mm } = self.motion;
        let mirrored = |[x, y]: [f64; 2]| [0.0 - x, y];
        let pose = self.pose.faced();
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

    /// The same with the object's lowest point so deep below the undeformed pad, mm; negative over it. Nothing changes where
    /// the object is no mesh.
    pub fn at_depth(&self, depth_mm: f64) -> Self {
        let Some(clusters) = &self.clusters else { return self.clone() };
        let pose = self.pose.lowered(-depth_mm, clusters);
        Self { pose, over_plane: pose, indentation_depth_mm: depth_mm.max(0.0), ..self.clone() }
    }

    /// A press that is known; all else is drawn as for sample `index` after `attempt` rejected draws. Shear turns about
    /// the pose's origin.
    pub fn given(plan: &Plan, index: u64, attempt: u32, press: KnownPress) -> Self {
        let stream = |name: &str| rng::stream(plan.seed(), name, rng::redrawn(index, attempt));
        let draw = |name: &str, quantity: &Quantity| quantity.sample(&mut stream(name));
        let KnownPress { split, pressed, pose, indentation_depth_mm } = press;
        let job = &plan.job;
        let number = match &pressed {
            Pressed::Object(number) => Some(*number),
            Pressed::Frame(_) => None,
        };
        let own = number.and_then(|number| {
            job.object[number].texture.as_ref().zip(plan.sampling.objects[number].textures.as_ref())
        });
        let (texture, reliefs) = own.unwrap_or((&job.texture, &plan.sampling.textures));
        let texture = (!reliefs.is_empty()).then(|| {
            let mut offset = stream("texture offset");
            let pattern = stream("texture pattern").below(reliefs.len());
            let sample = TextureSample {
                amplitude_mm: draw("texture amplitude", &texture.amplitude_mm),
                scale_mm: draw("texture scale", &texture.scale_mm),
                angle_deg: draw("texture angle", &texture.angle_deg),
                offset: [offset.unit(), offset.unit()],
            };
            DrawnTexture { pattern: texture.patterns[pattern].name(), relief: Arc::clone(&reliefs[pattern]), sample }
        });
        let material = number.map_or_else(ObjectMaterial::default, |number| {
            let entry = &job.object[number];
            let drawn =
                |name: &str, quantity: &Option<Quantity>| quantity.as_ref().map(|quantity| draw(name, quantity));
            let soft = drawn("object modulus", &entry.youngs_modulus_kpa).map(|youngs_modulus_kpa| ElasticObject {
                youngs_modulus_kpa,
                poisson_ratio: drawn("object poisson ratio", &entry.poisson_ratio).unwrap_or(POISSON_RATIO),
            });
            let friction = drawn("object friction", &entry.friction);
            ObjectMaterial { soft, friction: friction.map(|coefficient| Friction::Coulomb { coefficient }) }
        });
        let shear = &job.shear;
        let motion = Motion {
            shift_mm: [draw("shear x", &shear.x_mm), draw("shear y", &shear.y_mm)],
            twist_rad: draw("twist", &shear.twist_deg).to_radians(),
            about_mm: [pose.translation_mm.x, pose.translation_mm.y],
        };
        let Finger { markers, camera, sensor, unit_key } = Finger::draw(plan, stream);
        let clusters = number.map(|number| Arc::clone(&plan.sampling.objects[number].clusters));
        Self {
            index,
            attempt,
            split,
            pressed,
            side: Side::MinusZ,
            pose,
            indentation_depth_mm,
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
            others: Vec::new(),
            unplaced: 0,
        }
    }

    /// How deep the deepest of its objects reaches below the undeformed pad, mm; 0 without contact.
    pub fn deepest_mm(&self) -> f64 {
        self.others.iter().fold(self.indentation_depth_mm, |deepest, other| deepest.max(other.indentation_depth_mm))
    }

    /// The outlines of its objects in the plane that they are posed over, the first one's before the others'; none of what a
    /// depth frame stands for.
    pub fn outlines(&self) -> Vec<Outline> {
        let first = self.clusters.iter().map(|clusters| Outline::of(clusters, &self.over_plane));
        first.chain(self.others.iter().map(|other| other.outline.clone())).collect()
    }

    /// What is pressed, and where.
    pub fn indenter(&self, plan: &Plan) -> Indenter {
        if let (Some(first), false) = (&self.clusters, self.others.is_empty()) {
            let others = self.others.iter().map(|other| Indenter::clusters(Arc::clone(&other.clusters), other.pose));
            let first = Indenter::clusters(Arc::clone(first), self.pose);
            let all: Vec<Indenter> = std::iter::once(first).chain(others).collect();
            if let Some(together) = Indenter::together(&all) {
                return Indenter::of_known_depth(together.shape().clone(), *together.pose(), self.deepest_mm());
            }
        }
        let shape = match (&self.pressed, &self.clusters) {
            (Pressed::Frame(frame), _) => frame.shape.clone(),
            (Pressed::Object(_), Some(clusters)) => Shape::Mesh(Arc::clone(clusters)),
            (Pressed::Object(number), None) => Shape::Mesh(Arc::clone(&plan.sampling.objects[*number].clusters)),
        };
        // Measured elsewhere than at the lowest point, the depth does not say whether that reaches into the pad.
        let depth_mm = match (&shape, plan.job.indentation.at) {
            (Shape::Mesh(clusters), At::Axis) => -self.pose.lowest_mm(clusters),
            _ => self.indentation_depth_mm,
        };
        Indenter::of_known_depth(shape, self.pose, depth_mm)
    }

    /// The simulator of its sensor: that of the plan where all samples have the same. Another one shares with it what both
    /// have in common.
    pub fn simulator(&self, plan: &Plan) -> Arc<Simulator> {
        let Some(drawn) = &self.sensor else { return Arc::clone(&plan.simulator) };
        let nominal = plan.simulator.sensor();
        let mut sensor = drawn.numbers.to_simulated(plan.job.markers.as_ref(), &plan.job.camera);
        sensor.calibration = nominal.calibration.clone();
        sensor.rest_surface = nominal.rest_surface.clone();
        if let Some(photograph) = plan.sensors.photographs.get(drawn.photograph) {
            sensor.background = Background::Photograph(Arc::clone(&photograph.image));
        }
        Arc::new(plan.simulator.variant(sensor))
    }

    /// What the simulator is to do.
    pub fn press(&self, plan: &Plan) -> Press {
        let texture = |DrawnTexture { relief, sample, .. }: &DrawnTexture| Texture {
            relief: Arc::clone(relief),
            sample: *sample,
            laid: None,
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

/// What to say where more than a tenth of a job's objects find no place among the others of their press: seen on its first samples.
pub fn crowded(plan: &Plan) -> Option<Diagnostic> {
    if plan.job().objects_per_sample().most < 2 {
        return None;
    }
    let (mut placed, mut unplaced) = (0, 0);
    let samples = plan.layout.samples().min(PROBES);
    for index in 0..samples {
        let scene = Scene::draw(plan.of_sample(index, 0), index, 0);
        placed += 1 + scene.others.len() as u64;
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
