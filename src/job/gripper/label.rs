//! The labels of a grip and of a sequence of grips: what holds for both fingers, how the object is held, and what each
//! finger feels.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::health::Health;
use crate::label::{
    ContactLabel, Label, LabelHeader, MarkersLabel, ModelsLabel, NumericsLabel, PoseLabel, SensorLabel, ShearLabel,
    TextureLabel,
};
use crate::sequence::label::{CommonLabel, FrameLabel, SequenceInfo, SequenceLabel, SlipState};
use crate::steps::Steps;
use gelsim_core::camera::CameraParams;
use gelsim_core::effects::{Effect, EffectNote, PerEffect};

/// Label of a grip.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct GripLabel {
    /// Which sample it is, and of what.
    #[serde(flatten)]
    pub header: LabelHeader,
    /// Micro relief of the object.
    pub texture: TextureLabel,
    /// The models by which it was simulated.
    #[serde(flatten)]
    pub models: ModelsLabel,
    /// How the object is held.
    pub gripper: GripperLabel,
    /// What the left finger feels.
    pub left: FingerLabel,
    /// What the right finger feels.
    pub right: FingerLabel,
}

/// How an object is held. The gripper's frame has its origin in the middle between the undeformed pads, z from the left
/// pad to the right one, and x and y as in the left finger's image: right and down.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct GripperLabel {
    /// Distance between the undeformed pads, mm.
    pub width_mm: f64,
    /// Width of the object along z in its pose, mm. The gripper's width is this less the sum of the indentation depths
    /// of both fingers.
    pub object_width_mm: f64,
    /// Pose of the object: p = R (scale q) + t takes a point q of the mesh (mm) to the gripper's frame (mm). The angles
    /// are those of the left finger.
    pub pose: PoseLabel,
    /// Transform from the gripper's frame to the left finger's.
    pub left_frame: TransformLabel,
    /// Transform from the gripper's frame to the right finger's: half a turn about y.
    pub right_frame: TransformLabel,
    /// Normal force of each finger, as the mean of both, N; null if one of them is not known.
    pub force_n: Option<f64>,
    /// Normal force of the left finger less that of the right one, N; null if one of them is not known.
    pub residual_n: Option<f64>,
    /// Torque of both fingers' normal forces on the object about x and y, N mm, which a gripper would have to hold;
    /// null if the pressure of one finger extends beyond what was simulated.
    pub torque_nmm: Option<[f64; 2]>,
    /// True if the forces are equal within a thousandth, or if the place where they are is known within a tenth of the
    /// contact solver's tolerance.
    pub balanced: bool,
    /// Number of contacts that were solved to find the balance.
    pub presses: u32,
}

/// Transform from one frame to another: p' = R p + t.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct TransformLabel {
    /// Rotation R as a unit quaternion x, y, z, w.
    pub quaternion_xyzw: [f64; 4],
    /// Translation t, mm.
    pub translation_mm: [f64; 3],
}

/// What a finger feels, with the keys of a press's label.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct FingerLabel {
    /// Pose of the object in this finger's frame: p = R (scale q) + t. The angles describe the object as this finger
    /// meets it; for the right finger that is after half a turn about y.
    pub pose: PoseLabel,
    /// Depth below the undeformed pad of the object's point that is lowest over this pad, mm.
    pub indentation_depth_mm: f64,
    /// Motion of the object in this pad's plane.
    pub shear: ShearLabel,
    /// The sensor.
    pub sensor: SensorLabel,
    /// The contact, as far as it is in view.
    pub contact: ContactLabel,
    /// The pad's markers.
    pub markers: MarkersLabel,
    /// The camera.
    pub camera: CameraParams,
    /// For each effect whether it ran, and why or why not.
    pub effects: PerEffect<EffectNote>,
    /// How well the gelpad model solved its problem, and how much of the light is extrapolated.
    pub numerics: NumericsLabel,
    /// Result of the check of the finger's image and contact, and of the balance.
    pub health: Health,
    /// Scales of 16-bit layers; all 0 if `output.depth_format` is another.
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
    /// Makes the label of a grip from the labels that presses of both fingers would have.
    pub fn new(gripper: GripperLabel, left: Label, right: Label) -> Self {
        Self {
            header: left.header.clone(),
            texture: left.texture.clone(),
            models: left.models.clone(),
            gripper,
            left: FingerLabel::new(left),
            right: FingerLabel::new(right),
        }
    }

    /// Returns both fingers, with their names.
    pub fn fingers(&self) -> [(&'static str, &FingerLabel); 2] {
        [("left", &self.left), ("right", &self.right)]
    }

    /// Returns one label that stands for the complete grip, as `merge_labels` makes it.
    pub fn summary(&self) -> Label {
        let [left, right] = [&self.left, &self.right].map(|finger| self.finger_label(finger));
        merge_labels(left, right)
    }

    /// Returns the label of a press into one finger.
    fn finger_label(&self, finger: &FingerLabel) -> Label {
        let finger = finger.clone();
        Label {
            header: self.header.clone(),
            pose: finger.pose,
            indentation_depth_mm: finger.indentation_depth_mm,
            wanted_force_n: 0.0,
            force_tolerance: 0.0,
            // A gripper holds a single object.
            objects: Vec::new(),
            unplaced_objects: 0,
            texture: self.texture.clone(),
            shear: finger.shear,
            sensor: finger.sensor,
            contact: finger.contact,
            markers: finger.markers,
            camera: finger.camera,
            models: self.models.clone(),
            effects: finger.effects,
            numerics: finger.numerics,
            health: finger.health,
            png16: finger.png16,
        }
    }
}

/// Merges the labels of both fingers: that of the finger with the larger contact, healthy and converged only if both
/// are, and with the effects that ran in either.
fn merge_labels(left: Label, right: Label) -> Label {
    let converged = left.numerics.converged && right.numerics.converged;
    let ill = [("left", &left), ("right", &right)].into_iter().find(|(_, finger)| !finger.health.healthy);
    let ill = ill.map(|(name, finger)| (format!("{name} finger: {}", finger.health.reason), finger.health.clone()));
    let (mut most, other) = if right.contact.area_mm2 > left.contact.area_mm2 { (right, left) } else { (left, right) };
    for effect in Effect::ALL {
        if !most.effects[effect].ran && other.effects[effect].ran {
            most.effects[effect] = other.effects[effect].clone();
        }
    }
    if let Some((reason, health)) = ill {
        most.health = Health { reason, ..health };
    }
    most.numerics.converged = converged;
    most
}

/// Label of a sequence of grips.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct GripSequenceLabel {
    /// Which sample it is, and of what.
    #[serde(flatten)]
    pub header: LabelHeader,
    /// Micro relief of the object.
    pub texture: TextureLabel,
    /// The models by which it was simulated.
    #[serde(flatten)]
    pub models: ModelsLabel,
    /// Course of the sequence.
    pub sequence: GripSequenceInfo,
    /// What holds for the left finger in all frames.
    pub left: MovingFingerLabel,
    /// What holds for the right finger in all frames.
    pub right: MovingFingerLabel,
    /// The frames, in their order.
    pub frames: Vec<GripFrameLabel>,
}

/// What holds for a finger in all frames of a sequence.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct MovingFingerLabel {
    /// The sensor.
    pub sensor: SensorLabel,
    /// The camera.
    pub camera: CameraParams,
    /// Scales of 16-bit layers; all 0 if `output.depth_format` is another.
    pub png16: Steps,
}

/// Course of a sequence of grips.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct GripSequenceInfo {
    /// Frames per second.
    pub frame_rate_hz: f64,
    /// Number of frames.
    pub frames: u32,
    /// Coefficient of friction between each pad and the object; null if nothing slips.
    pub friction_coefficient: Option<f64>,
    /// Time of the first frame in which more than a twentieth of a finger's contact slips, s; null if there is none.
    pub first_slip_s: Option<f64>,
    /// Time of the first frame in which all of both fingers' contacts slips, s; null if there is none.
    pub gross_slip_s: Option<f64>,
    /// The phases, in their order.
    pub phases: Vec<GripPhaseLabel>,
}

/// A phase of a sequence of grips.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct GripPhaseLabel {
    /// Name of the phase.
    pub name: String,
    /// Duration, s.
    pub duration_s: f64,
    /// Number of its first frame; that of the next phase if it is shorter than a frame.
    pub first_frame: u32,
    /// Number of its frames.
    pub frames: u32,
    /// Distance between the undeformed pads at the end of the phase, mm.
    pub width_mm: f64,
    /// Normal force of each finger that was wanted at the end of the phase, N; 0 if none was.
    pub force_n: f64,
    /// Motion of the object in the gripper's x and y, mm.
    pub shift_mm: [f64; 2],
    /// Turn of the object from x towards y, degrees.
    pub twist_deg: f64,
}

/// A frame of a sequence of grips.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct GripFrameLabel {
    /// Number of the frame.
    pub index: u32,
    /// Time of the frame after the start, s.
    pub t_s: f64,
    /// Name of the phase that it is in.
    pub phase: String,
    /// How the object is held. Its forces are those of `wrench`.
    pub gripper: GripperLabel,
    /// What the left finger feels.
    pub left: FrameLabel,
    /// What the right finger feels.
    pub right: FrameLabel,
}

impl GripSequenceLabel {
    /// Makes the label of a sequence from the labels that presses of its first frame would have, and from its frames.
    pub fn new([left, right]: [Label; 2], mut sequence: GripSequenceInfo, frames: Vec<GripFrameLabel>) -> Self {
        let when = |wanted: &dyn Fn(SlipState, SlipState) -> bool| {
            let found = frames.iter().find(|frame| wanted(frame.left.slip.state, frame.right.slip.state));
            found.map(|frame| frame.t_s)
        };
        sequence.first_slip_s = when(&|left, right| left != SlipState::None || right != SlipState::None);
        sequence.gross_slip_s = when(&|left, right| left == SlipState::Gross && right == SlipState::Gross);
        let moving = |press: &Label| MovingFingerLabel {
            sensor: press.sensor.clone(),
            camera: press.camera,
            png16: press.png16,
        };
        Self {
            left: moving(&left),
            right: moving(&right),
            header: left.header,
            texture: left.texture,
            models: left.models,
            sequence,
            frames,
        }
    }

    /// Returns both fingers, with their names.
    pub fn fingers(&self) -> [(&'static str, &MovingFingerLabel); 2] {
        [("left", &self.left), ("right", &self.right)]
    }

    /// Returns one label that stands for the complete sequence: the summaries of both fingers, merged. Returns `None`
    /// without frames.
    pub fn summary(&self) -> Option<Label> {
        let of_finger = |moving: &MovingFingerLabel, own: fn(&GripFrameLabel) -> &FrameLabel| {
            let common = CommonLabel {
                header: self.header.clone(),
                texture: self.texture.clone(),
                sensor: moving.sensor.clone(),
                camera: moving.camera,
                models: self.models.clone(),
                png16: moving.png16,
                sequence: SequenceInfo::default(),
            };
            SequenceLabel { common, frames: self.frames.iter().map(own).cloned().collect() }.summary()
        };
        Some(merge_labels(of_finger(&self.left, |frame| &frame.left)?, of_finger(&self.right, |frame| &frame.right)?))
    }
}
