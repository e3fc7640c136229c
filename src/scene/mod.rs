//! One press, drawn at random from the plan: object, pose, indentation. All randomness of a sample is here.

use crate::dataset::layout::Split;
use crate::plan::Plan;
use crate::rng::{Stage, stream};

pub mod pose;

use pose::{Angles, Pose};

/// Distance between the pad and an object that does not touch it, mm.
pub const NO_CONTACT_GAP_MM: f64 = 0.1;

/// What happens in one sample.
#[derive(Clone, Debug)]
pub struct Scene {
    /// The sample's number.
    pub index: u64,
    /// Its split.
    pub split: Split,
    /// Number of the object in [`Plan::objects`].
    pub object: usize,
    /// Where the object is.
    pub pose: Pose,
    /// How deep its lowest point reaches below the undeformed pad, mm; 0 without contact.
    pub indentation_depth_mm: f64,
}

impl Scene {
    /// Draws sample `index`. Depends on the plan's seed and laws and on `index` only.
    pub fn draw(plan: &Plan, index: u64) -> Self {
        let draw = |stage, quantity| stream(plan.seed, stage, index).draw(quantity);
        let (split, position) = plan.layout.split_of(index);
        let object = plan.draw[split.number()].pick(position, || stream(plan.seed, Stage::Object, index).unit());

        let law = &plan.pose;
        let face = pose::draw_face(law.face, &mut stream(plan.seed, Stage::Face, index));
        let angles = Angles {
            yaw_deg: draw(Stage::Yaw, &law.yaw_deg),
            tilt_deg: draw(Stage::Tilt, &law.tilt_deg),
            tilt_azimuth_deg: draw(Stage::TiltAzimuth, &law.tilt_azimuth_deg),
        };
        let position_mm = [draw(Stage::X, &law.x_mm), draw(Stage::Y, &law.y_mm)];

        let touches = stream(plan.seed, Stage::Contact, index).unit() >= plan.no_contact;
        let depth_mm = draw(Stage::Indentation, &plan.indentation_mm);
        let lowest_mm = if touches { -depth_mm } else { NO_CONTACT_GAP_MM };
        let pose = Pose::new(face, angles, position_mm, law.anchor, lowest_mm, &plan.objects[object].clusters);
        Self { index, split, object, pose, indentation_depth_mm: if touches { depth_mm } else { 0.0 } }
    }
}
