//! The label of a sample. One documented struct is both the JSON label and its JSON Schema.
//!
//! Every sample of every dataset has the same keys. Floats are always written with a decimal point. Null stands only
//! for what cannot be known of a sample, or was not given for an object.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::force::FORCE_TOLERANCE;
use crate::health::Health;
use crate::layout::Split;
use crate::plan::Plan;
use crate::scene::Scene;
use crate::steps::Steps;
use gelsim_core::base::grid::Grid;
use gelsim_core::camera::CameraParams;
use gelsim_core::effects::{EffectNote, PerEffect};
use gelsim_core::impression::Impression;
use gelsim_core::simulator::Simulator;

mod contact;
mod pressed;
mod sensor;
mod share;

pub use contact::{ContactLabel, MarkersLabel, NumericsLabel};
pub use pressed::{MaterialLabel, ObjectLabel, PoseLabel, ShearLabel, TextureLabel};
pub use sensor::{BackgroundLabel, LedLabel, SensorLabel};
use share::{ContactShare, describe_objects};
pub use share::{PressedLabel, ShareLabel};

/// Program and version.
pub const GENERATOR: &str = concat!("gelsim ", env!("CARGO_PKG_VERSION"));

/// Version of the label's keys and their meaning.
pub const SCHEMA_VERSION: u32 = 1;

/// The common beginning of the labels of presses, sequences and grips.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct LabelHeader {
    /// Version of this schema.
    pub schema_version: u32,
    /// Program and version that made the sample.
    pub generator: String,
    /// Nine digits with which the names of the sample's files begin.
    pub key: String,
    /// Number of the sample in the dataset.
    pub index: u64,
    /// Seed of the job.
    pub seed: u64,
    /// Number of draws of the sample that were rejected before this one.
    pub attempt: u32,
    /// Split to which the sample belongs.
    pub split: Split,
    /// The object that was pressed or is held; the first of several.
    pub object: ObjectLabel,
}

/// The models by which a sample was simulated.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct ModelsLabel {
    /// Fidelity level.
    pub fidelity: String,
    /// Model of the gelpad.
    pub gelpad_model: String,
    /// Model of the light.
    pub optics_model: String,
}

/// Label of a press.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct Label {
    /// Which sample it is, and of what.
    #[serde(flatten)]
    pub header: LabelHeader,
    /// Pose of the object: p = R (scale q) + t takes a point q of the mesh (mm) to the sensor's frame (mm).
    pub pose: PoseLabel,
    /// Depth of the object's lowest point below the undeformed pad, mm.
    pub indentation_depth_mm: f64,
    /// Normal force of all objects that was wanted, N; 0 if a depth was.
    #[serde(default)]
    pub wanted_force_n: f64,
    /// Fraction of the wanted force within which the depth was found; 0 if a depth was wanted.
    #[serde(default)]
    pub force_tolerance: f64,
    /// All objects that were pressed in together, each with its share of the contact; `object` is the first.
    #[serde(default)]
    pub objects: Vec<PressedLabel>,
    /// Number of further objects that should have been pressed in with them, but for which there was no place.
    #[serde(default)]
    pub unplaced_objects: u32,
    /// Micro relief of the object.
    pub texture: TextureLabel,
    /// Motion of the object in the pad's plane.
    pub shear: ShearLabel,
    /// The sensor.
    pub sensor: SensorLabel,
    /// The contact, as far as it is in view.
    pub contact: ContactLabel,
    /// The pad's markers.
    pub markers: MarkersLabel,
    /// The camera.
    pub camera: CameraParams,
    /// The models by which it was simulated.
    #[serde(flatten)]
    pub models: ModelsLabel,
    /// For each effect whether it ran, and why or why not.
    pub effects: PerEffect<EffectNote>,
    /// How well the gelpad model solved its problem, and how much of the light is extrapolated.
    pub numerics: NumericsLabel,
    /// Result of the check of the sample.
    pub health: Health,
    /// Scales of 16-bit layers; all 0 if `output.depth_format` is another.
    pub png16: Steps,
}

/// Returns the nine-digit key of a sample.
pub fn sample_key(index: u64) -> String {
    format!("{index:09}")
}

impl Label {
    /// Makes the label of a press of `plan`. For several objects, `numbered` has the number of the object at each pixel
    /// ([`Impression::instance_mask`]).
    pub fn describe(
        plan: &Plan,
        scene: &Scene,
        simulator: &Simulator,
        impression: &Impression,
        numbered: Option<&Grid<u8>>,
    ) -> Self {
        let Impression { contact, camera, effects, .. } = impression;
        let (models, thickness_mm) = (simulator.models(), simulator.sensor().gelpad.thickness_mm);
        let total = ContactShare::from_mask(impression, simulator.view(), &contact.mask);
        let object = ObjectLabel::from_scene(plan, scene);
        let pose = PoseLabel::from_pose(&scene.pose);
        let objects = describe_objects(plan, scene, simulator, impression, numbered, (&object, &pose, &total));
        Self {
            header: LabelHeader {
                schema_version: SCHEMA_VERSION,
                generator: GENERATOR.to_owned(),
                key: sample_key(scene.index),
                index: scene.index,
                seed: plan.seed(),
                attempt: scene.attempt,
                split: scene.split,
                object,
            },
            pose,
            indentation_depth_mm: scene.indentation_depth_mm,
            wanted_force_n: scene.wanted_force_n,
            force_tolerance: *scene.force_found.as_ref().unwrap_or(&FORCE_TOLERANCE),
            objects,
            unplaced_objects: scene.unplaced,
            texture: TextureLabel::from_scene(scene),
            shear: ShearLabel::from_scene(plan, scene, simulator, contact.tangential.as_ref()),
            sensor: SensorLabel::from_scene(plan, scene, simulator),
            contact: ContactLabel::from_impression(impression, &total, simulator.view()),
            markers: MarkersLabel::from_impression(impression, simulator.view()),
            camera: *camera,
            models: ModelsLabel {
                fidelity: plan.fidelity().name().to_owned(),
                gelpad_model: models.gelpad.name().to_owned(),
                optics_model: models.optics.name().to_owned(),
            },
            effects: effects.notes.clone(),
            numerics: NumericsLabel::from_contact(plan, scene, contact, thickness_mm),
            health: Health::check(scene, impression, thickness_mm),
            png16: Steps::new(&plan.layers(), plan.job.output.depth_format, thickness_mm),
        }
    }
}

impl Label {
    /// Returns the depth of the deepest of all pressed objects below the undeformed pad, mm.
    pub fn deepest_mm(&self) -> f64 {
        self.objects.iter().fold(self.indentation_depth_mm, |deepest, object| deepest.max(object.indentation_depth_mm))
    }
}
