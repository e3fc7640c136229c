//! Frames of a sequence: an object that slides, turns and rolls on the pad.

use crate::base::clock::Clock;
use crate::curved::sequence::MovingObject;
use crate::depth::texture::{Texture, TexturePlacement};
use crate::effects::{Effect, EffectPolicy};
use crate::gelpad;
use crate::gelpad::elastic::shear::Friction;
use crate::gelpad::sliding::{FramePad, Ground, ObjectStep, Sliding};
use crate::impression::Impression;
use crate::pose::Pose;

use super::{Press, PressError, Simulator};

impl Simulator {
    /// An object that is to slide, turn and roll on the pad; `None` if the model of the gelpad knows no tractions.
    pub fn sliding(&self, friction: Friction) -> Option<Sliding> {
        self.frame_pad().map(|pad| Sliding::new(pad, friction))
    }

    fn frame_pad(&self) -> Option<&FramePad> {
        let gelpad::Model::Elastic(elastic) = &self.models.gelpad else { return None };
        Some(self.frame_pad.get_or_init(|| FramePad::new(elastic, &self.sensor.gelpad, &self.view)))
    }

    /// The next frame of a sequence: the object goes through `steps`, the last of which leads to where `press` has it, and
    /// friction remembers in `sliding` what it did. The press's texture lies where it lay at the start of the sequence; its
    /// shear is left out.
    ///
    /// # Panics
    ///
    /// Where [`Simulator::try_press_next`] gives an error.
    pub fn press_next(&self, press: &Press, steps: &[ObjectStep], sliding: &mut Sliding) -> Impression {
        self.try_press_next(press, steps, sliding).unwrap_or_else(|error| panic!("{error}"))
    }

    /// The next frame of a sequence, as [`Simulator::press_next`]. After an error `sliding` is as it was.
    ///
    /// # Errors
    ///
    /// As [`Simulator::try_press`]; also if a step is not finite, or if `sliding` was begun on another sensor.
    pub fn try_press_next(
        &self,
        press: &Press,
        steps: &[ObjectStep],
        sliding: &mut Sliding,
    ) -> Result<Impression, PressError> {
        self.check_press(press)?;
        if !self.frame_pad().is_some_and(|pad| sliding.is_over(pad)) {
            return Err(PressError::OtherSensor);
        }
        if !steps.iter().all(ObjectStep::is_finite) {
            return Err(PressError::NotFinite("step"));
        }
        Ok(self.pressed_next(press, steps, sliding))
    }

    fn pressed_next(&self, press: &Press, steps: &[ObjectStep], sliding: &mut Sliding) -> Impression {
        let mut clock = Clock::start();
        match &self.curved {
            Some(curved) => curved.advance(sliding, steps, &self.moving(press)),
            None => sliding.advance(steps, &press.indenter, self.ground(press)),
        }
        let carried = |texture: &Texture| {
            let laid = texture.laid.unwrap_or_else(|| TexturePlacement::over(&press.indenter.pose, &press.plane));
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
