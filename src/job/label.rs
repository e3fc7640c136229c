//! The label of a sample: one documented struct that is the JSON label and its JSON Schema.
//!
//! The set of keys is the same for every sample of every dataset. Floats are always written with a decimal point, and
//! null stands only for what cannot be known of a sample, or was not said of an object.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::health::Health;
use crate::layout::Split;
use crate::plan::Plan;
use crate::scene::Scene;
use crate::steps::Steps;
use gelsim_core::base::grid::Grid;
use gelsim_core::camera::CameraParams;
use gelsim_core::effects::{Note, PerEffect};
use gelsim_core::impression::Impression;
use gelsim_core::simulator::Simulator;

mod contact;
mod pressed;
mod sensor;
mod share;

pub use contact::{ContactLabel, MarkersLabel, NumericsLabel};
pub use pressed::{MaterialLabel, ObjectLabel, PoseLabel, ShearLabel, TextureLabel};
pub use sensor::{BackgroundLabel, LedLabel, SensorLabel};
pub use share::{PressedLabel, ShareLabel};
use share::{Share, objects};

/// Program and version.
pub const GENERATOR: &str = concat!("gelsim ", env!("CARGO_PKG_VERSION"));

/// Version of the label's keys and their meaning.
pub const SCHEMA_VERSION: u32 = 1;

/// What the labels of presses, sequences and grips begin with.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct LabelHeader {
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
    /// What was pressed, or is held; of several objects the first.
    pub object: ObjectLabel,
}

/// What a sample was simulated with.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct ModelsLabel {
    /// Fidelity level.
    pub fidelity: String,
    /// Model of the gelpad.
    pub gelpad_model: String,
    /// Model of the light.
    pub optics_model: String,
}

/// What is known about a sample.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct Label {
    /// Which sample it is, and of what.
    #[serde(flatten)]
    pub header: LabelHeader,
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
    /// What it was simulated with.
    #[serde(flatten)]
    pub models: ModelsLabel,
    /// For each effect whether it ran and why or why not.
    pub effects: PerEffect<Note>,
    /// How well the gelpad model solved its problem, and how far the light is from what was measured.
    pub numerics: NumericsLabel,
    /// What a check of the sample found.
    pub health: Health,
    /// What the values of 16-bit layers mean; all 0 where `output.depth_format` is another.
    pub png16: Steps,
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
        let Impression { contact, camera, effects, .. } = impression;
        let (models, thickness_mm) = (simulator.models(), simulator.sensor().gelpad.thickness_mm);
        let whole = Share::of(impression, simulator.view(), &contact.mask);
        let object = ObjectLabel::of(plan, scene);
        let pose = PoseLabel::of(&scene.pose);
        let objects = objects(plan, scene, simulator, impression, numbered, (&object, &pose, &whole));
        Self {
            header: LabelHeader {
                schema_version: SCHEMA_VERSION,
                generator: GENERATOR.to_owned(),
                key: key(scene.index),
                index: scene.index,
                seed: plan.seed(),
                attempt: scene.attempt,
                split: scene.split,
                object,
            },
            pose,
            indentation_depth_mm: scene.indentation_depth_mm,
            objects,
            unplaced_objects: scene.unplaced,
            texture: TextureLabel::of(scene),
            shear: ShearLabel::of(plan, scene, simulator, contact.tangential.as_ref()),
            sensor: SensorLabel::of(plan, scene, simulator),
            contact: ContactLabel::of(impression, &whole, simulator.view()),
            markers: MarkersLabel::of(impression, simulator.view()),
            camera: *camera,
            models: ModelsLabel {
                fidelity: plan.fidelity().name().to_owned(),
                gelpad_model: models.gelpad.name().to_owned(),
                optics_model: models.optics.name().to_owned(),
            },
            effects: effects.notes.clone(),
            numerics: NumericsLabel::of(plan, scene, contact, thickness_mm),
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
