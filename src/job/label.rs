//! The label of a sample: one documented struct that is the JSON label and its JSON Schema.
//!
//! The set of keys is the same for every sample of every dataset. Floats are always written with a decimal point, and
//! null stands only for what cannot be known of a sample, or was not said of an object.

use std::f64::consts::PI;

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::core::base::grid::Grid;
use crate::core::base::view::View;
use crate::core::camera::CameraParams;
use crate::core::effects::{Note, PerEffect};
use crate::core::gelpad::elastic::LARGEST_STRAIN;
use crate::core::gelpad::elastic::shear::Friction;
use crate::core::gelpad::tangential::TangentialMotion;
use crate::core::impression::Impression;
use crate::core::optics::led::Led;
use crate::core::pose::Pose;
use crate::core::sensor::{Background, Sensor};
use crate::core::simulator::Simulator;
use crate::job::health::Health;
use crate::job::layout::Split;
use crate::job::plan::Plan;
use crate::job::scene::{Pressed, Scene};
use crate::job::steps::Steps;

mod share;

pub use share::{PressedLabel, ShareLabel};
use share::{Share, objects};

/// Program and version.
pub const GENERATOR: &str = concat!("gelsim ", env!("CARGO_PKG_VERSION"));

/// Version of the label's keys and their meaning.
pub const SCHEMA_VERSION: u32 = 1;

/// What is known about a sample.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct Label {
    /// Version of this schema.
    pub schema_version: u32,
    /// Program and version that made the sample.
    pub generator: String,
    /// Nine digits that begin the names of the sample's members.
    pub key: String,
    /// Number of the sample in the dataset.
    pub index: u64,
    /// Seed of the job.
    pub seed: u64,
    /// How many draws of the sample were rejected before this one.
    pub attempt: u32,
    /// Split that the sample belongs to.
    pub split: Split,
    /// What was pressed; of several objects the first.
    pub object: ObjectLabel,
    /// Where it was: p = R (scale q) + t takes a point q of the mesh (mm) to the sensor's frame (mm).
    pub pose: PoseLabel,
    /// How deep the object's lowest point reaches below the undeformed pad, mm.
    pub indentation_depth_mm: f64,
    /// All that was pressed in together, each with its share of the contact: `object` first.
    #[serde(default)]
    pub objects: Vec<PressedLabel>,
    /// How many more were to be pressed in with them, and found no place among them.
    #[serde(default)]
    pub unplaced_objects: u32,
    /// Micro relief of the object.
    pub texture: TextureLabel,
    /// How the object was moved in the pad's plane.
    pub shear: ShearLabel,
    /// The sensor.
    pub sensor: SensorLabel,
    /// The contact, as far as it is in view.
    pub contact: ContactLabel,
    /// The pad's markers.
    pub markers: MarkersLabel,
    /// The camera.
    pub camera: CameraParams,
    /// Fidelity level.
    pub fidelity: String,
    /// Model of the gelpad.
    pub gelpad_model: String,
    /// Model of the light.
    pub optics_model: String,
    /// For each effect whether it ran and why or why not.
    pub effects: PerEffect<Note>,
    /// How well the gelpad model solved its problem, and how far the light is from what was measured.
    pub numerics: NumericsLabel,
    /// What a check of the sample found.
    pub health: Health,
    /// What the values of 16-bit layers mean; all 0 where `output.depth_format` is another.
    pub png16: Steps,
}

/// What was pressed.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct ObjectLabel {
    /// Unique name of the object in the dataset.
    pub id: String,
    /// Its class.
    pub class: String,
    /// Number of the class among the dataset's classes, sorted by name.
    pub class_index: u32,
    /// SHA-256 of the mesh file's bytes, of all files where it names others; empty where a depth frame stands for the object.
    pub mesh_sha256: String,
    /// Path of the mesh file as the job names it, or as its pattern found it; empty where a depth frame stands for the object.
    #[serde(default)]
    pub path: String,
    /// Factor on the object's size: p = R (scale q) + t.
    #[serde(default = "unscaled")]
    pub scale: f64,
    /// What it is made of.
    #[serde(default)]
    pub material: MaterialLabel,
}

/// What an object is made of; null is what nobody said of it.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct MaterialLabel {
    /// Young's modulus, kPa; null if the object is rigid.
    pub youngs_modulus_kpa: Option<f64>,
    /// Poisson ratio; null if the object is rigid.
    pub poisson_ratio: Option<f64>,
    /// Coefficient of friction between pad and object; null if the object has none of its own, but the job's.
    pub friction: Option<f64>,
}

fn unscaled() -> f64 {
    1.0
}

/// Where the object was.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct PoseLabel {
    /// Rotation R as a unit quaternion x, y, z, w with w >= 0.
    pub quaternion_xyzw: [f64; 4],
    /// Translation t, mm.
    pub translation_mm: [f64; 3],
    /// Turn about z, degrees.
    pub yaw_deg: f64,
    /// Tilt, degrees.
    pub tilt_deg: f64,
    /// Direction of the tilt's axis, degrees.
    pub tilt_azimuth_deg: f64,
}

/// Micro relief of the object. Without texture the pattern is empty and every number 0.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct TextureLabel {
    /// Name of the pattern.
    pub pattern: String,
    /// How far valleys lie below peaks, mm.
    pub amplitude_mm: f64,
    /// The pattern's scale, mm.
    pub scale_mm: f64,
    /// The pattern's direction on the object, degrees.
    pub angle_deg: f64,
}

/// How the object was moved in the pad's plane after it was pressed in.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct ShearLabel {
    /// Along x and y, mm.
    pub shift_mm: [f64; 2],
    /// From x towards y, degrees.
    pub twist_deg: f64,
    /// Point that it was turned about, mm from the middle of the image.
    pub about_mm: [f64; 2],
    /// Force on the pad along x and y, N; null if the job moves objects but
    /// the sensor has no markers to show it, or the gelpad model knows no tractions.
    pub force_n: Option<[f64; 2]>,
    /// Torque on the pad about that point, from x towards y, N mm; null likewise.
    pub torque_nmm: Option<f64>,
    /// Share of the contact that slips; null likewise.
    pub slipping: Option<f64>,
}

/// The pad's markers, or the pins inside it, as far as they are in view.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct MarkersLabel {
    /// How many there are.
    pub count: u32,
    /// Mean distance from where they rest, px.
    pub mean_motion_px: f64,
    /// Largest distance from where they rest, px.
    pub max_motion_px: f64,
}

/// The sensor.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct SensorLabel {
    /// Its name.
    pub name: String,
    /// Columns of every layer, px.
    pub width_px: u32,
    /// Rows of every layer, px.
    pub height_px: u32,
    /// Distance between pixel centres along x and y, mm.
    pub mm_per_px: [f64; 2],
    /// Thickness of the gelpad, mm.
    pub gelpad_thickness_mm: f64,
    /// Young's modulus of the gelpad, kPa.
    pub gelpad_youngs_modulus_kpa: f64,
    /// Poisson ratio of the gelpad.
    pub gelpad_poisson_ratio: f64,
    /// Share of the light lost where the pad is pressed down to the shell.
    pub darkening: f64,
    /// Red, green and blue of the untouched pad that are not the LEDs' light; empty if their light is not scaled by it.
    pub stray_light: Vec<f64>,
    /// The LEDs, in the order of the sensor.
    pub leds: Vec<LedLabel>,
    /// The image of the untouched pad.
    pub background: BackgroundLabel,
}

/// An LED of the sensor.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct LedLabel {
    /// Its name.
    pub name: String,
    /// Direction towards it, degrees from +x towards +y.
    pub azimuth_deg: f64,
    /// Angle over the pad's plane, degrees.
    pub elevation_deg: f64,
    /// Width and height as the pad sees it, degrees.
    pub angular_size_deg: [f64; 2],
    /// Distance from the middle of the image, mm.
    pub distance_mm: f64,
    /// Red, green and blue share of its light.
    pub color: [f64; 3],
    /// Brightness.
    pub intensity: f64,
}

/// The image of the untouched pad: a file, or the numbers that it is rendered from.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct BackgroundLabel {
    /// Name of its file; empty if it is rendered.
    pub file: String,
    /// SHA-256 of that file in lower-case hex; empty if it is rendered.
    pub sha256: String,
    /// Red, green and blue of the diffuse light; this and the others are 0 if it is a file, or shows the light of
    /// the sensor's lamps.
    pub color: [f64; 3],
    /// Brightness that each LED adds at its edge of the image.
    pub glow: f64,
    /// Distance over which that falls to 37 %, mm.
    pub glow_reach_mm: f64,
    /// Share of the light lost in the corners.
    pub vignette: f64,
    /// Standard deviation of the coating's grain.
    pub grain: f64,
    /// Size of the grain, mm.
    pub grain_size_mm: f64,
    /// Specks of dust per cm^2.
    pub dust_per_cm2: f64,
    /// Size of the specks, mm.
    pub dust_size_mm: f64,
    /// The 15 coefficients of red, then of green, then of blue by which the colour varies over the pad; empty if it does
    /// not.
    pub pattern: Vec<f64>,
}

/// The contact, as far as it is in view. Without contact every number is 0.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct ContactLabel {
    /// True if any pixel in view touches.
    pub in_contact: bool,
    /// Area that touches, mm^2.
    pub area_mm2: f64,
    /// Share of the view that touches.
    pub fraction: f64,
    /// Mean position of the pixels that touch, mm from the middle of the image; on a gel that is not flat from its axis.
    pub centroid_mm: [f64; 2],
    /// Mean position of the pixels of the contact layer, px: the first pixel's centre is at (0.5, 0.5).
    #[serde(default)]
    pub centroid_px: [f64; 2],
    /// Radius of a disc of that area, mm.
    #[serde(default)]
    pub equivalent_radius_mm: f64,
    /// Radius of a disc of as many pixels as the contact layer has, px.
    #[serde(default)]
    pub equivalent_radius_px: f64,
    /// Smallest box around them, px: x0, y0, x1, y1, half open.
    pub bbox_px: [u32; 4],
    /// Largest depth of the object below the undeformed pad, mm.
    pub max_depth_mm: f64,
    /// Normal force in view, N; null if the model knows none, or something that is not known decides it.
    pub force_n: Option<f64>,
    /// Normal force of the whole object, in view and beyond, N; null if it is not known.
    #[serde(default)]
    pub total_force_n: Option<f64>,
    /// Why one of these forces is null; empty if both are known.
    #[serde(default)]
    pub force_unknown: String,
    /// True if the object touches the pad beyond the view, too. Of a depth frame: if it touches the pad at the frame's border.
    #[serde(default)]
    pub cut_by_view: bool,
    /// Share of the area in which the object touches the pad that is in view, 0 to 1; null for a depth frame, of which
    /// nothing is known beyond the view.
    #[serde(default)]
    pub in_view_fraction: Option<f64>,
    /// Largest pressure, kPa; null if the model knows none.
    pub peak_pressure_kpa: Option<f64>,
    /// Force of the object on a gel that is not flat, in the sensor's frame, N; empty on a flat pad, whose normal force is
    /// along -z.
    #[serde(default)]
    pub force_vector_n: Vec<f64>,
    /// Its moment about the gel's tip, N mm; empty likewise.
    #[serde(default)]
    pub torque_nmm: Vec<f64>,
}

/// How well the gelpad model solved its problem, and how far the light is from what was measured.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct NumericsLabel {
    /// True if its tolerance was reached; also for models without iteration.
    pub converged: bool,
    /// Iterations.
    pub iterations: u32,
    /// Largest violation of the contact conditions in the image, um; null if the model has none.
    pub residual_um: Option<f64>,
    /// Indentation depth over pad thickness.
    pub strain: f64,
    /// True if the strain is over 0.5, where the linear theory of the elastic pad has ended.
    pub beyond_theory: bool,
    /// Largest error of the surface within 2 mm of the contact that the model's linear theory is expected to have,
    /// um, within a factor of two, or of 2.5 for most contacts that stick; 0 if no edge of a contact is in view, null if it is not known.
    pub model_error_um: Option<f64>,
    /// Share of the pixels in contact whose slope or displacement lies beyond the presses that the sensor's optics were
    /// calibrated on, 0 to 1; 0 without contact and where the optics are not calibrated.
    #[serde(default)]
    pub light_outside_range: f64,
}

/// The nine-digit key of a sample.
pub fn key(index: u64) -> String {
    format!("{index:09}")
}

impl Label {
    /// Describes what a press of `plan` gave. Of several objects `numbered` says which of them is where
    /// ([`Impression::numbered`]).
    pub fn describe(
        plan: &Plan,
        scene: &Scene,
        simulator: &Simulator,
        impression: &Impression,
        numbered: Option<&Grid<u8>>,
    ) -> Self {
        let Impression { contact, markers, pins, lens, camera, effects, .. } = impression;
        let (sensor, models) = (simulator.sensor(), simulator.models());
        let thickness_mm = sensor.gelpad.thickness_mm;
        let View { resolution_px: [width, height], mm_per_px } = *simulator.view();
        let whole = Share::of(impression, simulator.view(), &contact.mask);
        let object = object(plan, scene);
        let pose = PoseLabel::of(&scene.pose);
        let objects = objects(plan, scene, simulator, impression, numbered, (&object, &pose, &whole));
        Self {
            schema_version: SCHEMA_VERSION,
            generator: GENERATOR.to_owned(),
            key: key(scene.index),
            index: scene.index,
            seed: plan.seed(),
            attempt: scene.attempt,
            split: scene.split,
            object,
            pose,
            indentation_depth_mm: scene.indentation_depth_mm,
            objects,
            unplaced_objects: scene.unplaced,
            texture: scene.texture.as_ref().map_or_else(TextureLabel::default, |texture| TextureLabel {
                pattern: texture.pattern.to_owned(),
                amplitude_mm: texture.sample.amplitude_mm,
                scale_mm: texture.sample.scale_mm,
                angle_deg: texture.sample.angle_deg,
            }),
            shear: shear(plan, scene, simulator, contact.tangential.as_ref()),
            sensor: SensorLabel {
                name: sensor.name.clone(),
                width_px: width as u32,
                height_px: height as u32,
                mm_per_px,
                gelpad_thickness_mm: thickness_mm,
                gelpad_youngs_modulus_kpa: sensor.gelpad.youngs_modulus_kpa,
                gelpad_poisson_ratio: sensor.gelpad.poisson_ratio,
                darkening: sensor.darkening,
                stray_light: sensor.stray_light.iter().flatten().copied().collect(),
                leds: sensor.leds.iter().map(LedLabel::new).collect(),
                background: background(plan, scene, sensor),
            },
            contact: ContactLabel {
                in_contact: whole.pixels > 0,
                area_mm2: whole.area_mm2,
                fraction: whole.pixels as f64 / (width * height) as f64,
                centroid_mm: whole.centroid_mm,
                centroid_px: whole.in_image.centroid_px,
                equivalent_radius_mm: libm::sqrt(whole.area_mm2 / PI),
                equivalent_radius_px: libm::sqrt(whole.in_image.pixels as f64 / PI),
                bbox_px: whole.bbox_px,
                max_depth_mm: if whole.pixels > 0 { f64::from(impression.depth.deepest_mm) } else { 0.0 },
                force_n: contact.force_n,
                total_force_n: contact.whole.total_force_n,
                force_unknown: contact.whole.force_unknown.to_owned(),
                cut_by_view: contact.whole.cut_by_view,
                in_view_fraction: contact.whole.in_view_fraction,
                peak_pressure_kpa: contact.peak_pressure_kpa,
                force_vector_n: impression.wrench.iter().flat_map(|wrench| wrench.force_n).collect(),
                torque_nmm: impression.wrench.iter().flat_map(|wrench| wrench.torque_nmm).collect(),
            },
            markers: match (markers, pins) {
                (Some(markers), _) => MarkersLabel::of(markers.in_view(lens.as_ref(), [width, height])),
                (None, Some(pins)) => {
                    let places = pins.in_view([width, height]);
                    MarkersLabel::of(places.filter_map(|(rest, moved)| rest.px.zip(moved.px)))
                }
                (None, None) => MarkersLabel::default(),
            },
            camera: *camera,
            fidelity: plan.fidelity().name().to_owned(),
            gelpad_model: models.gelpad.name().to_owned(),
            optics_model: models.optics.name().to_owned(),
            effects: effects.notes.clone(),
            numerics: NumericsLabel {
                converged: contact.numerics.converged,
                iterations: contact.numerics.iterations,
                residual_um: contact.numerics.residual_um,
                strain: scene.deepest_mm() / thickness_mm,
                beyond_theory: scene.deepest_mm() > LARGEST_STRAIN * thickness_mm,
                model_error_um: contact.numerics.model_error_um,
                light_outside_range: plan.simulator.shader().share_beyond(contact),
            },
            health: Health::check(scene, impression, thickness_mm),
            png16: Steps::new(&plan.layers(), plan.job.output.depth_format, thickness_mm),
        }
    }
}

impl Label {
    /// How deep the deepest of what was pressed reaches below the undeformed pad, mm.
    pub fn deepest_mm(&self) -> f64 {
        self.objects.iter().fold(self.indentation_depth_mm, |deepest, object| deepest.max(object.indentation_depth_mm))
    }
}

impl ShearLabel {
    /// Of what was not moved after the press.
    pub fn still() -> Self {
        Self {
            shift_mm: [0.0; 2],
            twist_deg: 0.0,
            about_mm: [0.0; 2],
            force_n: Some([0.0; 2]),
            torque_nmm: Some(0.0),
            slipping: Some(0.0),
        }
    }
}

fn object(plan: &Plan, scene: &Scene) -> ObjectLabel {
    let (id, class, mesh_sha256, path) = match &scene.pressed {
        Pressed::Object(number) => {
            let object = &plan.sampling.objects[*number];
            (&object.id, &object.class, object.sha256.clone(), object.path.clone())
        }
        Pressed::Frame(frame) => (&frame.id, &frame.class, String::new(), String::new()),
    };
    ObjectLabel {
        id: id.clone(),
        class: class.clone(),
        class_index: class_index(plan, class),
        mesh_sha256,
        path,
        scale: scene.scale,
        material: MaterialLabel {
            youngs_modulus_kpa: scene.material.soft.map(|soft| soft.youngs_modulus_kpa),
            poisson_ratio: scene.material.soft.map(|soft| soft.poisson_ratio),
            friction: scene.material.friction.and_then(Friction::coefficient),
        },
    }
}

fn class_index(plan: &Plan, class: &str) -> u32 {
    let index = match class {
        // Nobody named the classes of the frames: there is one.
        "" => 0,
        class => plan.class_index(class).expect("a plan has the classes of all that is pressed"),
    };
    index as u32
}

impl PoseLabel {
    fn of(pose: &Pose) -> Self {
        Self {
            quaternion_xyzw: pose.quaternion_xyzw(),
            translation_mm: pose.translation_mm.to_array(),
            yaw_deg: pose.angles.yaw_deg,
            tilt_deg: pose.angles.tilt_deg,
            tilt_azimuth_deg: pose.angles.tilt_azimuth_deg,
        }
    }
}

impl LedLabel {
    fn new(led: &Led) -> Self {
        let Led { name, azimuth_deg, elevation_deg, angular_size_deg, distance_mm, color, intensity, position_mm: _ } =
            led.clone();
        Self { name, azimuth_deg, elevation_deg, angular_size_deg, distance_mm, color, intensity }
    }
}

fn background(plan: &Plan, scene: &Scene, sensor: &Sensor) -> BackgroundLabel {
    let number = scene.sensor.as_ref().map_or(0, |drawn| drawn.photograph);
    let photograph = plan.sensors.photographs.get(number);
    let (file, sha256) = photograph.map_or_else(Default::default, |own| (own.file.clone(), own.sha256.clone()));
    match &sensor.background {
        Background::Rendered(look) if sensor.lamps.is_empty() => BackgroundLabel {
            file,
            sha256,
            color: look.color,
            glow: look.glow,
            glow_reach_mm: look.glow_reach_mm,
            vignette: look.vignette,
            grain: look.grain,
            grain_size_mm: look.grain_size_mm,
            dust_per_cm2: look.dust_per_cm2,
            dust_size_mm: look.dust_size_mm,
            pattern: look.pattern.iter().flat_map(|own| [own.red, own.green, own.blue]).flatten().collect(),
        },
        // A photograph, or what the lamps show.
        _ => BackgroundLabel {
            file,
            sha256,
            color: [0.0; 3],
            glow: 0.0,
            glow_reach_mm: 0.0,
            vignette: 0.0,
            grain: 0.0,
            grain_size_mm: 0.0,
            dust_per_cm2: 0.0,
            dust_size_mm: 0.0,
            pattern: Vec::new(),
        },
    }
}

fn shear(plan: &Plan, scene: &Scene, simulator: &Simulator, tangential: Option<&TangentialMotion>) -> ShearLabel {
    // Without any push there is no traction; else nothing is known of one sample only if nothing is known of any.
    let known = simulator.knows_tractions() || !plan.sampling.moves_objects;
    let outcome = tangential.and_then(|tangential| tangential.shear.as_ref());
    let youngs_modulus_kpa = simulator.sensor().gelpad.youngs_modulus_kpa;
    // kPa mm^2 are mN.
    let newtons = |per_modulus: f64| 1e-3 * youngs_modulus_kpa * per_modulus;
    ShearLabel {
        shift_mm: scene.motion.shift_mm,
        twist_deg: scene.motion.twist_rad.to_degrees(),
        about_mm: scene.motion.about_mm,
        force_n: known.then(|| outcome.map_or([0.0; 2], |outcome| outcome.force.map(newtons))),
        torque_nmm: known.then(|| outcome.map_or(0.0, |outcome| newtons(outcome.moment))),
        slipping: known.then(|| outcome.map_or(0.0, |outcome| outcome.slipping)),
    }
}

impl MarkersLabel {
    /// Of places at rest and now, px.
    fn of(places: impl Iterator<Item = ([f64; 2], [f64; 2])>) -> Self {
        let (mut label, mut sum) = (Self::default(), 0.0);
        for (rest, moved) in places {
            let distance = libm::hypot(moved[0] - rest[0], moved[1] - rest[1]);
            label.count += 1;
            sum += distance;
            label.max_motion_px = label.max_motion_px.max(distance);
        }
        label.mean_motion_px = sum / f64::from(label.count.max(1));
        label
    }
}
