//! Frames of a sequence: an object that slides, turns and rolls on the pad.

use crate::base::clock::Clock;
use crate::curved::sequence::MovingObject;
use crate::depth::texture::{Laid, Texture};
use crate::effects::{Effect, EffectPolicy};
use crate::gelpad;
use crate::gelpad::elastic::shear::Friction;
use crate::gelpad::sliding::{FramePad, Ground, ObjectStep, Sliding};
use crate::impression::Impression;
use crate::pose::Pose;

use super::{Press, Simulator};

impl Simulator {
    /// An object that is to slide, turn and roll on the pad; `None` if the model of the gelpad knows no tractions.
    pub fn sliding(&self, friction: Friction) -> Option<Sliding> {
        match &self.models.gelpad {
            gelpad::Model::Elastic(elastic) => {
                let pad = || FramePad::new(elastic, &self.sensor.gelpad, &self.view);
                Some(Sliding::new(self.frame_pad.get_or_init(pad), friction))
            }
            _ => None,
        }
    }

    /// The next frame of a sequence: the object goes through `steps`, the last of which leads to where `press` has it, and
    /// friction remembers in `sliding` what it did. The press's texture lies where it lay at the start of the sequence; its
    /// shear is left out.
    ///
    /// # Panics
    ///
    /// If the indenter is a height map of another size than the sensor's image, or one that is pressed into a gel that has a shape.
    pub fn press_next(&self, press: &Press, steps: &[ObjectStep], sliding: &mut Sliding) -> Impression {
        let mut clock = Clock::start();
        match &self.curved {
            Some(curved) => curved.advance(sliding, steps, &self.moving(press)),
            None => sliding.advance(steps, &press.indenter, self.ground(press)),
        }
        let carried = |texture: &Texture| {
            let laid = texture.laid.unwrap_or_else(|| Laid::over(&press.indenter.pose, &press.plane));
            texture.laid_out(sliding.carried(laid))
        };
        let press = Press { texture: press.texture.as_ref().map(carried), shear: None, ..press.clone() };
        let seconds = clock.lap();
        let mut impression = self.pressed(&press, Some(sliding));
        impression.seconds.gelpad += seconds;
        impression.effects.seconds[Effect::Friction] += seconds;
        impression
    }

    /// Normal force of the whole object on the pad if it were pressed so deep at a pose, N.
    pub fn force_n(&self, sliding: &Sliding, press: &Press, pose: Pose, depth_mm: f64) -> f64 {
        match &self.curved {
            Some(curved) => curved.force_n(sliding, &self.moving(press), &pose),
            None => sliding.normal_force_n(&press.indenter, pose, depth_mm, self.ground(press)),
        }
    }

    /// What moves over a gel that is not flat.
    fn moving<'a>(&'a self, press: &'a Press) -> MovingObject<'a> {
        MovingObject {
            indenter: &press.indenter,
            plane: &press.plane,
            texture: self.ground(press).texture,
            thickness_mm: self.sensor.gelpad.thickness_mm,
        }
    }

    /// What beside the object's shape decides where it meets the pad, unless it is left out.
    fn ground<'a>(&'a self, press: &'a Press) -> Ground<'a> {
        let unless = |effect| self.policy != EffectPolicy::Without(effect);
        Ground {
            camera: &self.view,
            texture: press.texture.as_ref().filter(|_| unless(Effect::Texture)),
            drop_mm: self.drop_mm.as_deref().filter(|_| unless(Effect::RestShape)),
        }
    }
}
