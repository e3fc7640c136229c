//! The label of a grip: what holds for both fingers, how the object is held, and what each finger feels of it.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::core::camera::CameraParams;
use crate::core::effects::{Effect, Note, PerEffect};
use crate::job::health::Health;
use crate::job::label::{
    ContactLabel, Label, MarkersLabel, NumericsLabel, ObjectLabel, PoseLabel, SensorLabel, ShearLabel, TextureLabel,
};
use crate::job::layout::Split;
use crate::job::steps::Steps;

/// What is known about a grip.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct GripLabel {
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
    /// What is held.
    pub object: ObjectLabel,
    /// Micro relief of the object.
    pub texture: TextureLabel,
    /// Fidelity level.
    pub fidelity: String,
    /// Model of the gelpads.
    pub gelpad_model: String,
    /// Model of the light.
    pub optics_model: String,
    /// How it is held.
    pub gripper: GripperLabel,
    /// What the left finger feels.
    pub left: FingerLabel,
    /// What the right finger feels.
    pub right: FingerLabel,
}

/// How an object is held. The gripper's frame has its origin in the middle between the undeformed pads, z from the left pad to
/// the right one, and x and y as the left finger's image has them: right and down.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct GripperLabel {
    /// Distance between the undeformed pads, mm.
    pub width_mm: f64,
    /// Width of the object along z as it is turned, mm: less the gripper's width, the indentation depths of both fingers
    /// together.
    pub object_width_mm: f64,
    /// Where the object is: p = R (scale q) + t takes a point q of the mesh (mm) to the gripper's frame (mm). The angles are
    /// those of the left finger.
    pub pose: PoseLabel,
    /// From the gripper's frame to the left finger's.
    pub left_frame: FrameLabel,
    /// From the gripper's frame to the right finger's: half a turn about y.
    pub right_frame: FrameLabel,
    /// Normal force of each finger, the mean of both, N; null if one is not known.
    pub force_n: Option<f64>,
    /// Normal force of the left finger less that of the right one, N; null likewise.
    pub residual_n: Option<f64>,
    /// Torque of both fingers' normal forces on the object about x and y, N mm, which a gripper would have to hold; null if the
    /// pressure of one goes on beyond what is simulated of it.
    pub torque_nmm: Option<[f64; 2]>,
    /// True if the forces are equal within a thousandth, or the place where they are is known within a tenth of the contact
    /// solver's tolerance.
    pub balanced: bool,
    /// Contacts that were solved to find it.
    pub presses: u32,
}

/// A frame in another one: p' = R p + t.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct FrameLabel {
    /// Rotation R as a unit quaternion x, y, z, w.
    pub quaternion_xyzw: [f64; 4],
    /// Translation t, mm.
    pub translation_mm: [f64; 3],
}

/// What a finger feels, as the label of a press has it.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct FingerLabel {
    /// Where the object is in this finger's frame: p = R (scale q) + t. The angles are to the object as this finger meets it:
    /// the right finger after half a turn about y.
    pub pose: PoseLabel,
    /// How deep the object's point that is lowest over this pad reaches below it, mm.
    pub indentation_depth_mm: f64,
    /// How the object was moved in this pad's plane.
    pub shear: ShearLabel,
    /// The sensor.
    pub sensor: SensorLabel,
    /// The contact, as far as it is in view.
    pub contact: ContactLabel,
    /// The pad's markers.
    pub markers: MarkersLabel,
    /// The camera.
    pub camera: CameraParams,
    /// For each effect whether it ran and why or why not.
    pub effects: PerEffect<Note>,
    /// How well the gelpad model solved its problem, and how far the light is from what was measured.
    pub numerics: NumericsLabel,
    /// What a check of the finger's image and contact found, and of the balance.
    pub health: Health,
    /// What the values of 16-bit layers mean; all 0 where `output.depth_format` is another.
    pub png16: Steps,
}

impl FingerLabel {
    fn new(press: Label) -> Self {
        let Label { pose, indentation_depth_mm, shear, sensor, contact, markers, camera, .. } = press;
        let Label { effects, numerics, health, png16, .. } = press;
        Self { pose, indentation_depth_mm, shear, sensor, contact, markers, camera, effects, numerics, health, png16 }
    }
}

impl GripLabel {
    /// Of what presses of both fingers would be labelled.
    pub fn new(gripper: GripperLabel, left: Label, right: Label) -> Self {
        Self {
            schema_version: left.schema_version,
            generator: left.generator.clone(),
            key: left.key.clone(),
            index: left.index,
            seed: left.seed,
            attempt: left.attempt,
            split: left.split,
            object: left.object.clone(),
            texture: left.texture.clone(),
            fidelity: left.fidelity.clone(),
            gelpad_model: left.gelpad_model.clone(),
            optics_model: left.optics_model.clone(),
            gripper,
            left: FingerLabel::new(left),
            right: FingerLabel::new(right),
        }
    }

    /// Both fingers, with their names.
    pub fn fingers(&self) -> [(&'static str, &FingerLabel); 2] {
        [("left", &self.left), ("right", &self.right)]
    }

    /// One label for what counts whole samples: that of the finger with the larger contact; healthy and solved if both are, with
    /// the effects that ran in either.
    pub fn summary(&self) -> Label {
        let most = match self.right.contact.area_mm2 > self.left.contact.area_mm2 {
            true => &self.right,
            false => &self.left,
        };
        let most = most.clone();
        let mut effects = most.effects.clone();
        for effect in Effect::ALL {
            if let Some((_, finger)) = self.fingers().into_iter().find(|(_, finger)| finger.effects[effect].ran) {
                effects[effect] = finger.effects[effect].clone();
            }
        }
        let mut health = most.health.clone();
        if let Some((name, finger)) = self.fingers().into_iter().find(|(_, finger)| !finger.health.healthy) {
            health = finger.health.clone();
            health.reason = format!("{name} finger: {}", health.reason);
        }
        let converged = self.fingers().iter().all(|(_, finger)| finger.numerics.converged);
        Label {
            schema_version: self.schema_version,
            generator: self.generator.clone(),
            key: self.key.clone(),
            index: self.index,
            seed: self.seed,
            attempt: self.attempt,
            split: self.split,
            object: self.object.clone(),
            pose: most.pose,
            indentation_depth_mm: most.indentation_depth_mm,
            // A gripper holds one.
            objects: Vec::new(),
            unplaced_objects: 0,
            texture: self.texture.clone(),
            shear: most.shear,
            sensor: most.sensor,
            contact: most.contact,
            markers: most.markers,
            camera: most.camera,
            fidelity: self.fidelity.clone(),
            gelpad_model: self.gelpad_model.clone(),
            optics_model: self.optics_model.clone(),
            effects,
            numerics: NumericsLabel { converged, ..most.numerics },
            health,
            png16: most.png16,
        }
    }
}
