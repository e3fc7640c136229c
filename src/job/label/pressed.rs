//! The part of a label about the object, its pose and its motion.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::plan::Plan;
use crate::scene::{DrawnTexture, PressSource, Scene};
use gelsim_core::gelpad::elastic::shear::Friction;
use gelsim_core::gelpad::tangential::TangentialMotion;
use gelsim_core::pose::Pose;
use gelsim_core::simulator::Simulator;

/// The object that was pressed.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct ObjectLabel {
    /// Unique name of the object in the dataset.
    pub id: String,
    /// Its class.
    pub class: String,
    /// Number of the class among the dataset's classes, sorted by name.
    pub class_index: u32,
    /// SHA-256 of the mesh file's bytes, or of all files if it names others; empty if a depth frame stands for the
    /// object.
    pub mesh_sha256: String,
    /// Path of the mesh file as the job names it, or as its pattern found it; empty if a depth frame stands for the
    /// object.
    #[serde(default)]
    pub path: String,
    /// Factor on the object's size: p = R (scale q) + t.
    #[serde(default = "unscaled")]
    pub scale: f64,
    /// Material of the object.
    #[serde(default)]
    pub material: MaterialLabel,
}

/// Material of an object; null stands for what the job does not give.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct MaterialLabel {
    /// Young's modulus, kPa; null if the object is rigid.
    pub youngs_modulus_kpa: Option<f64>,
    /// Poisson ratio; null if the object is rigid.
    pub poisson_ratio: Option<f64>,
    /// Coefficient of friction between pad and object; null if the object has none of its own, so that the job's holds.
    pub friction: Option<f64>,
}

fn unscaled() -> f64 {
    1.0
}

/// Pose of an object.
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

/// Micro relief of the object. Without texture the pattern is empty and every number is 0.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct TextureLabel {
    /// Name of the pattern.
    pub pattern: String,
    /// Depth of the valleys below the peaks, mm.
    pub amplitude_mm: f64,
    /// Scale of the pattern, mm.
    pub scale_mm: f64,
    /// Direction of the pattern on the object, degrees.
    pub angle_deg: f64,
}

/// Motion of the object in the pad's plane after it was pressed in.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct ShearLabel {
    /// Motion along x and y, mm.
    pub shift_mm: [f64; 2],
    /// Turn from x towards y, degrees.
    pub twist_deg: f64,
    /// Point about which it was turned, mm from the middle of the image.
    pub about_mm: [f64; 2],
    /// Force on the pad along x and y, N; null if the job moves objects but the sensor has no markers to show it, or
    /// the gelpad model has no tractions.
    pub force_n: Option<[f64; 2]>,
    /// Torque on the pad about `about_mm`, from x towards y, N mm; null if `force_n` is null.
    pub torque_nmm: Option<f64>,
    /// Fraction of the contact that slips; null if `force_n` is null.
    pub slipping: Option<f64>,
}

impl ShearLabel {
    pub(super) fn from_scene(
        plan: &Plan,
        scene: &Scene,
        simulator: &Simulator,
        tangential: Option<&TangentialMotion>,
    ) -> Self {
        // Without any motion there is no traction. With motion, the tractions of all samples are known, or of none.
        let known = simulator.knows_tractions() || !plan.sampling.moves_objects;
        let outcome = tangential.and_then(|tangential| tangential.shear.as_ref());
        let youngs_modulus_kpa = simulator.sensor().gelpad.youngs_modulus_kpa;
        // 1 kPa mm^2 is 1 mN.
        let newtons = |per_modulus: f64| 1e-3 * youngs_modulus_kpa * per_modulus;
        Self {
            shift_mm: scene.motion.shift_mm,
            twist_deg: scene.motion.twist_rad.to_degrees(),
            about_mm: scene.motion.about_mm,
            force_n: known.then(|| outcome.map_or([0.0; 2], |outcome| outcome.force.map(newtons))),
            torque_nmm: known.then(|| outcome.map_or(0.0, |outcome| newtons(outcome.moment))),
            slipping: known.then(|| outcome.map_or(0.0, |outcome| outcome.slipping)),
        }
    }

    /// Returns the label of an object that is not moved after the press.
    pub fn without_motion() -> Self {
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

impl ObjectLabel {
    pub(super) fn from_scene(plan: &Plan, scene: &Scene) -> Self {
        let (id, class, mesh_sha256, path) = match &scene.pressed {
            PressSource::Object(number) => {
                let object = &plan.sampling.objects[*number];
                (&object.id, &object.class, object.sha256.clone(), object.path.clone())
            }
            PressSource::Frame(frame) => (&frame.id, &frame.class, String::new(), String::new()),
        };
        Self {
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
}

pub(super) fn class_index(plan: &Plan, class: &str) -> u32 {
    let index = match class {
        // Without class names for the frames there is a single class.
        "" => 0,
        class => plan.class_index(class).expect("a plan has the classes of all that is pressed"),
    };
    index as u32
}

impl PoseLabel {
    pub(super) fn from_pose(pose: &Pose) -> Self {
        Self {
            quaternion_xyzw: pose.quaternion_xyzw(),
            translation_mm: pose.translation_mm.to_array(),
            yaw_deg: pose.angles.yaw_deg,
            tilt_deg: pose.angles.tilt_deg,
            tilt_azimuth_deg: pose.angles.tilt_azimuth_deg,
        }
    }
}

impl TextureLabel {
    pub(super) fn from_scene(scene: &Scene) -> Self {
        let of = |texture: &DrawnTexture| Self {
            pattern: texture.pattern.to_owned(),
            amplitude_mm: texture.sample.amplitude_mm,
            scale_mm: texture.sample.scale_mm,
            angle_deg: texture.sample.angle_deg,
        };
        scene.texture.as_ref().map(of).unwrap_or_default()
    }
}
