//! One press, drawn at random from the plan: object, pose, indentation, texture, shear, markers, camera. All randomness
//! of a sample is here. What is known of a press instead, such as a simulator's depth frame, takes the place of what
//! would be drawn.

use std::sync::Arc;

use crate::camera::Shot;
use crate::camera::print::Pattern;
use crate::config::quantity::Quantity;
use crate::dataset::layout::Split;
use crate::depth::texture::Cut;
use crate::gelpad::elastic::shear::Motion;
use crate::plan::Plan;
use crate::rng::{self, Stage};

pub mod frame;
pub mod pose;

use frame::Frame;
use pose::{Angles, Pose};

/// Distance between the pad and an object that does not touch it, mm.
pub const NO_CONTACT_GAP_MM: f64 = 0.1;

/// What is pressed into the pad.
#[derive(Clone, Debug)]
pub enum Pressed {
    /// The object of this number in [`Plan::objects`].
    Object(usize),
    /// Something of which a depth frame is known.
    Frame(Arc<Frame>),
}

/// A press of which the object and its place are known.
#[derive(Clone, Debug)]
pub struct Press {
    /// The sample's split.
    pub split: Split,
    /// What is pressed.
    pub pressed: Pressed,
    /// Where it is.
    pub pose: Pose,
    /// How deep its lowest point reaches below the undeformed pad, mm; 0 without contact.
    pub indentation_depth_mm: f64,
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
    /// Where it is.
    pub pose: Pose,
    /// How deep its lowest point reaches below the undeformed pad, mm; 0 without contact.
    pub indentation_depth_mm: f64,
    /// The texture of the object, if the job has any.
    pub cut: Option<Cut>,
    /// How the object moves in the pad's plane after that.
    pub motion: Motion,
    /// The pattern of the pad's markers, if it has any.
    pub markers: Option<Pattern>,
    /// The camera.
    pub shot: Shot,
}

impl Scene {
    /// Draws sample `index` for the first time, or after `attempt` draws of it were rejected. Depends on these two and on
    /// the plan's seed and laws only.
    pub fn draw(plan: &Plan, index: u64, attempt: u32) -> Self {
        let stream = |stage: Stage| rng::stream(plan.seed, stage, rng::redrawn(index, attempt));
        let draw = |stage: Stage, quantity: &Quantity| stream(stage).draw(quantity);
        let (split, position) = plan.layout.split_of(index);
        let object = plan.draw[split.number()].pick(position, || stream(Stage::Object).unit());

        let law = &plan.pose;
        let face = pose::draw_face(law.face, &mut stream(Stage::Face));
        let angles = Angles {
            yaw_deg: draw(Stage::Yaw, &law.yaw_deg),
            tilt_deg: draw(Stage::Tilt, &law.tilt_deg),
            tilt_azimuth_deg: draw(Stage::TiltAzimuth, &law.tilt_azimuth_deg),
        };
        let position_mm = [draw(Stage::X, &law.x_mm), draw(Stage::Y, &law.y_mm)];

        let touches = stream(Stage::Contact).unit() >= plan.no_contact;
        let depth_mm = draw(Stage::Indentation, &plan.indentation_mm);
        let lowest_mm = if touches { -depth_mm } else { NO_CONTACT_GAP_MM };
        let pose = Pose::new(face, angles, position_mm, law.anchor, lowest_mm, &plan.objects[object].clusters);
        let indentation_depth_mm = if touches { depth_mm } else { 0.0 };
        let press = Press { split, pressed: Pressed::Object(object), pose, indentation_depth_mm };
        let mut scene = Self::given(plan, index, attempt, press);
        scene.motion.about_mm = position_mm;
        scene
    }

    /// A press that is known; all else is drawn as for sample `index` after `attempt` rejected draws. Shear turns about
    /// the pose's origin.
    pub fn given(plan: &Plan, index: u64, attempt: u32, press: Press) -> Self {
        let stream = |stage: Stage| rng::stream(plan.seed, stage, rng::redrawn(index, attempt));
        let draw = |stage: Stage, quantity: &Quantity| stream(stage).draw(quantity);
        let Press { split, pressed, pose, indentation_depth_mm } = press;
        let cut = (!plan.textures.is_empty()).then(|| {
            let texture = &plan.texture;
            let mut offset = stream(Stage::TextureOffset);
            Cut {
                pattern: stream(Stage::TexturePattern).below(plan.textures.len()),
                amplitude_mm: draw(Stage::TextureAmplitude, &texture.amplitude_mm),
                scale_mm: draw(Stage::TextureScale, &texture.scale_mm),
                angle_deg: draw(Stage::TextureAngle, &texture.angle_deg),
                offset: [offset.unit(), offset.unit()],
            }
        });
        let shear = &plan.shear;
        let motion = Motion {
            shift_mm: [draw(Stage::ShearX, &shear.x_mm), draw(Stage::ShearY, &shear.y_mm)],
            twist_rad: draw(Stage::Twist, &shear.twist_deg).to_radians(),
            about_mm: [pose.translation_mm.x, pose.translation_mm.y],
        };
        let noise_key = stream(Stage::Noise).bits();
        Self {
            index,
            attempt,
            split,
            pressed,
            pose,
            indentation_depth_mm,
            cut,
            motion,
            markers: plan.markers.as_ref().and_then(|markers| markers.draw(draw)),
            shot: Shot::draw(&plan.settings, noise_key, draw).gated(plan.gate),
        }
    }
}
