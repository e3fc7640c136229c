//! The label of a sequence: what holds for all of its frames, and a list of what each frame shows.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::health::Health;
use crate::label::{
    ContactLabel, Label, LabelHeader, MarkersLabel, ModelsLabel, NumericsLabel, PoseLabel, SensorLabel, ShearLabel,
    TextureLabel,
};
use crate::steps::Steps;
use gelsim_core::camera::CameraParams;
use gelsim_core::effects::{Effect, EffectNote, PerEffect};
use gelsim_core::impression::SlidingState;

/// Label of a sequence.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct SequenceLabel {
    /// What holds for all of its frames.
    #[serde(flatten)]
    pub common: CommonLabel,
    /// The frames, in their order.
    pub frames: Vec<FrameLabel>,
}

/// A frame with what holds for all frames of its sequence: a row of metadata.jsonl.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct FrameRow {
    /// What holds for all frames.
    #[serde(flatten)]
    pub common: CommonLabel,
    /// The frame.
    pub frame: FrameLabel,
}

/// A frame of a sequence that goes on: the label of a press, with wrench and state of friction. The label of the
/// complete sequence is not known before its end.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct StepLabel {
    /// The frame as a press, with `numerics` and `health` of the frame.
    #[serde(flatten)]
    pub press: Label,
    /// Force and torque of the object on the pad, in view and up to 1.5 pad thicknesses beyond.
    pub wrench: WrenchLabel,
    /// State of friction.
    pub slip: SlipLabel,
}

/// What holds for all frames of a sequence.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct CommonLabel {
    /// Which sample it is, and of what.
    #[serde(flatten)]
    pub header: LabelHeader,
    /// Micro relief of the object.
    pub texture: TextureLabel,
    /// The sensor.
    pub sensor: SensorLabel,
    /// The camera.
    pub camera: CameraParams,
    /// The models by which it was simulated.
    #[serde(flatten)]
    pub models: ModelsLabel,
    /// Scales of 16-bit layers; all 0 if `output.depth_format` is another.
    pub png16: Steps,
    /// Course of the sequence.
    pub sequence: SequenceInfo,
}

/// Course of a sequence.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct SequenceInfo {
    /// Frames per second.
    pub frame_rate_hz: f64,
    /// Number of frames.
    pub frames: u32,
    /// Coefficient of friction between pad and object; null if nothing slips.
    pub friction_coefficient: Option<f64>,
    /// Time of the first frame in which more than a twentieth of the contact slips, s; null if there is none.
    pub first_slip_s: Option<f64>,
    /// Time of the first frame in which all of the contact slips, s; null if there is none.
    pub gross_slip_s: Option<f64>,
    /// The phases, in their order.
    pub phases: Vec<PhaseLabel>,
}

/// A phase of a sequence.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct PhaseLabel {
    /// Name of the phase.
    pub name: String,
    /// Duration, s.
    pub duration_s: f64,
    /// Number of its first frame; that of the next phase if it is shorter than a frame.
    pub first_frame: u32,
    /// Number of its frames.
    pub frames: u32,
    /// Indentation depth at the end of the phase, mm; below 0 the object is above the pad.
    pub depth_mm: f64,
    /// Normal force that was wanted at the end of the phase, N; 0 if a depth was wanted, or nothing.
    pub force_n: f64,
    /// Motion of the object in the pad's plane, mm.
    pub shift_mm: [f64; 2],
    /// Turn of the object from x towards y, degrees.
    pub twist_deg: f64,
    /// Tilt of the object about the lowest point, degrees.
    pub tilt_deg: f64,
    /// Direction of the tilt's axis, degrees.
    pub tilt_azimuth_deg: f64,
}

/// Label of a frame of a sequence.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct FrameLabel {
    /// Number of the frame, counted from 0; four digits of it stand in the names of its files.
    pub index: u32,
    /// Time since the start of the sequence, s.
    pub t_s: f64,
    /// Name of the phase that it is in.
    pub phase: String,
    /// Pose of the object: p = R q + t takes a point q of the mesh (mm) to the sensor's frame (mm).
    pub pose: PoseLabel,
    /// Depth of the object's lowest point below the undeformed pad, mm; 0 if it is above.
    pub indentation_depth_mm: f64,
    /// The contact, as far as it is in view.
    pub contact: ContactLabel,
    /// Force and torque of the object on the pad, in view and up to 1.5 pad thicknesses beyond.
    pub wrench: WrenchLabel,
    /// State of friction.
    pub slip: SlipLabel,
    /// The pad's markers.
    pub markers: MarkersLabel,
    /// How well the gelpad model solved its problem, and how much of the light is extrapolated.
    pub numerics: NumericsLabel,
    /// Result of the check of the frame.
    pub health: Health,
    /// For each effect whether it ran, and why or why not.
    pub effects: PerEffect<EffectNote>,
}

/// Force and torque of the object on the pad, in the sensor's frame, about the middle of the image on the undeformed
/// pad.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct WrenchLabel {
    /// Force along x, y and z, N; pressing is negative.
    pub force_n: [f64; 3],
    /// Torque about x, y and z, N mm.
    pub torque_nmm: [f64; 3],
}

/// State of friction in a frame.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct SlipLabel {
    /// How much of the contact slips.
    pub state: SlipState,
    /// Fraction of the contact that sticks, 0 to 1; 0 without contact.
    pub stick_fraction: f64,
    /// How far the pad has slid along the object since they touched, as a mean over the contact, mm.
    pub displacement_mm: [f64; 2],
    /// Energy that slip has turned into heat since the frame before, N mm.
    pub dissipated_nmm: f64,
    /// Number of iterations for the tractions.
    pub iterations: u32,
    /// Residual of Coulomb's law, um.
    pub residual_um: f64,
}

/// How much of a contact slips.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum SlipState {
    /// At most a twentieth of the contact, or nothing touches.
    #[default]
    None,
    /// More than a twentieth of the contact, but not all of it.
    Incipient,
    /// All of the contact.
    Gross,
}

/// Fraction of a contact that may slip while the contact still counts as sticking, since its rim always slips.
const STICKING_RIM_SHARE: f64 = 0.05;

impl SlipLabel {
    fn new(sliding: &SlidingState) -> Self {
        let slip = sliding.slip;
        let state = match (slip.touches, slip.gross) {
            (false, _) => SlipState::None,
            (true, true) => SlipState::Gross,
            (true, false) if slip.stick_fraction >= 1.0 - STICKING_RIM_SHARE => SlipState::None,
            (true, false) => SlipState::Incipient,
        };
        Self {
            state,
            stick_fraction: slip.stick_fraction,
            displacement_mm: slip.displacement_mm,
            dissipated_nmm: slip.heat_nmm,
            iterations: slip.iterations,
            residual_um: 1e3 * slip.residual_mm,
        }
    }
}

impl FrameLabel {
    /// Makes the label of a frame from the label that a press of it would have, and from the state of friction.
    pub fn new(index: u32, t_s: f64, phase: &str, press: Label, sliding: Option<&SlidingState>) -> Self {
        let Label { pose, indentation_depth_mm, contact, markers, mut numerics, mut health, effects, .. } = press;
        if let Some(sliding) = sliding.filter(|sliding| !sliding.slip.converged) {
            numerics.converged = false;
            if health.healthy {
                health.healthy = false;
                let residual_um = 1e3 * sliding.slip.residual_mm;
                health.reason = format!("friction is not solved: {residual_um:.3} um are left");
            }
        }
        let wrench = sliding.map_or_else(WrenchLabel::default, |sliding| WrenchLabel {
            force_n: sliding.wrench.force_n,
            torque_nmm: sliding.wrench.torque_nmm,
        });
        Self {
            index,
            t_s,
            phase: phase.to_owned(),
            pose,
            indentation_depth_mm,
            contact,
            wrench,
            slip: sliding.map_or_else(SlipLabel::default, SlipLabel::new),
            markers,
            numerics,
            health,
            effects,
        }
    }
}

impl StepLabel {
    /// Makes the label of a frame from the label that a press of it would have, and from its entry in a sequence.
    pub fn new(press: Label, frame: &FrameLabel) -> Self {
        let FrameLabel { wrench, slip, numerics, health, .. } = frame.clone();
        Self { press: Label { numerics, health, ..press }, wrench, slip }
    }
}

impl SequenceLabel {
    /// Makes the label of a sequence from the label that a press of its first frame would have, and from its frames.
    pub fn new(first: &Label, mut sequence: SequenceInfo, frames: Vec<FrameLabel>) -> Self {
        let when = |wanted: &dyn Fn(&SlipLabel) -> bool| {
            frames.iter().find(|frame| wanted(&frame.slip)).map(|frame| frame.t_s)
        };
        sequence.first_slip_s = when(&|slip| slip.state != SlipState::None);
        sequence.gross_slip_s = when(&|slip| slip.state == SlipState::Gross);
        let common = CommonLabel {
            header: first.header.clone(),
            texture: first.texture.clone(),
            sensor: first.sensor.clone(),
            camera: first.camera,
            models: first.models.clone(),
            png16: first.png16,
            sequence,
        };
        Self { common, frames }
    }

    /// Iterates over rows of metadata.jsonl, one for each frame.
    pub fn to_rows(&self) -> impl Iterator<Item = FrameRow> {
        self.frames.iter().map(|frame| FrameRow { common: self.common.clone(), frame: frame.clone() })
    }

    /// Returns one label that stands for the complete sequence: that of the frame with the largest contact, healthy and
    /// converged only if all frames are, and with the effects that ran in any. Returns `None` without frames.
    pub fn summary(&self) -> Option<Label> {
        let by_area = |a: &&FrameLabel, b: &&FrameLabel| a.contact.area_mm2.total_cmp(&b.contact.area_mm2);
        let most = self.frames.iter().max_by(by_area)?.clone();
        let mut effects = most.effects.clone();
        for effect in Effect::ALL {
            if let Some(frame) = self.frames.iter().find(|frame| frame.effects[effect].ran) {
                effects[effect] = frame.effects[effect].clone();
            }
        }
        let mut health = most.health.clone();
        if let Some(frame) = self.frames.iter().find(|frame| !frame.health.healthy) {
            health = frame.health.clone();
            health.reason = format!("frame {}: {}", frame.index, health.reason);
        }
        let converged = self.frames.iter().all(|frame| frame.numerics.converged);
        let common = &self.common;
        Some(Label {
            header: common.header.clone(),
            pose: most.pose,
            indentation_depth_mm: most.indentation_depth_mm,
            wanted_force_n: 0.0,
            force_tolerance: 0.0,
            objects: Vec::new(),
            unplaced_objects: 0,
            texture: common.texture.clone(),
            shear: ShearLabel::without_motion(),
            sensor: common.sensor.clone(),
            contact: most.contact,
            markers: most.markers,
            camera: common.camera,
            models: common.models.clone(),
            effects,
            numerics: NumericsLabel { converged, ..most.numerics },
            health,
            png16: common.png16,
        })
    }
}
