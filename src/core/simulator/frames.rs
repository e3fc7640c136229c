//! Frames of a sequence, in which an object slides, turns and rolls on the pad.

use crate::base::clock::ThreadClock;
use crate::curved::sequence::MovingObject;
use crate::depth::texture::{Texture, TexturePlacement};
use crate::effects::{Effect, EffectPolicy};
use crate::gelpad;
use crate::gelpad::elastic::shear::Friction;
use crate::gelpad::sliding::{CaptureInput, ObjectStep, Sliding, SlidingPad};
use crate::impression::Impression;
use crate::pose::Pose;

use super::{Press, PressError, Simulator};

impl Simulator {
    /// Begins a sequence with this friction; `None` if the model of the gelpad knows no tractions, or solves finite
    /// strain, which sequences do not.
    pub fn sliding(&self, friction: Friction) -> Option<Sliding> {
        self.frame_pad().map(|pad| Sliding::new(pad, friction))
    }

    /// Returns the pad under objects that slide, prepared on first use; `None` if the model of the gelpad knows no
    /// tractions, or solves finite strain.
    fn frame_pad(&self) -> Option<&SlidingPad> {
        let gelpad::Model::Elastic(elastic) = &self.models.gelpad else { return None };
        if elastic.strain_correction {
            return None;
        }
        Some(self.frame_pad.get_or_init(|| {
            let relaxation = match self.policy {
                EffectPolicy::Without(Effect::Relaxation) => &[][..],
                _ => &self.sensor.relaxation,
            };
            Box::new(SlidingPad::new(elastic, &self.sensor.gelpad, relaxation, &self.view))
        }))
    }

    /// Presses the object in the next frame of a sequence.
    ///
    /// The object goes through `steps`, the last of which leads to the pose of `press`; `sliding` remembers what
    /// friction did. The texture lies where it lay at the start of the sequence. The shear of `press` is ignored.
    ///
    /// # Panics
    ///
    /// If [`Simulator::try_press_next`] returns an error.
    pub fn press_next(&self, press: &Press, steps: &[ObjectStep], sliding: &mut Sliding) -> Impression {
        self.try_press_next(press, steps, sliding).unwrap_or_else(|error| panic!("{error}"))
    }

    /// Presses the object in the next frame of a sequence as [`Simulator::press_next`] does, and returns what cannot be
    /// pressed as an error. After an error, `sliding` is unchanged.
    ///
    /// # Errors
    ///
    /// Those of [`Simulator::try_press`]; also if a step is not finite, or leads farther than
    /// [`ObjectStep::FARTHEST_MM`] allows, or if `sliding` was begun on another sensor.
    pub fn try_press_next(
        &self,
        press: &Press,
        steps: &[ObjectStep],
        sliding: &mut Sliding,
    ) -> Result<Impression, PressError> {
        self.check_press(press)?;
        if !self.frame_pad().is_some_and(|pad| sliding.matches_pad(pad)) {
            return Err(PressError::OtherSensor);
        }
        if !steps.iter().all(ObjectStep::is_finite) {
            return Err(PressError::NotFinite("step"));
        }
        if !steps.iter().all(ObjectStep::stays_near) {
            return Err(PressError::TooFar);
        }
        Ok(self.render_next_frame(press, steps, sliding))
    }

    fn render_next_frame(&self, press: &Press, steps: &[ObjectStep], sliding: &mut Sliding) -> Impression {
        let mut clock = ThreadClock::start();
        match &self.curved {
            Some(curved) => curved.advance(sliding, steps, &self.moving_object(press)),
            None => sliding.advance(steps, &press.indenter, self.contact_conditions(press)),
        }
        let carried = |texture: &Texture| {
            let placement =
                texture.placement.unwrap_or_else(|| TexturePlacement::at_pose_over(&press.indenter.pose, &press.plane));
            texture.with_placement(sliding.texture_placement(placement))
        };
        let press = Press { texture: press.texture.as_ref().map(carried), shear: None, ..press.clone() };
        let seconds = clock.lap();
        let mut impression = self.render_press(&press, Some(sliding));
        impression.seconds.gelpad += seconds;
        impression.effects.seconds[Effect::Friction] += seconds;
        impression
    }

    /// Returns the normal force of the entire object on the pad, N, if it were pressed in at `pose` in the next frame
    /// of a sequence. On a flat pad its deepest point lies `depth_mm` below the pad; on a gel that is not flat, the
    /// pose alone says how deep it is.
    pub fn force_n(&self, sliding: &Sliding, press: &Press, pose: Pose, depth_mm: f64) -> f64 {
        match &self.curved {
            Some(curved) => curved.force_n(sliding, &self.moving_object(press), &pose),
            None => sliding.normal_force_n(&press.indenter, pose, depth_mm, self.contact_conditions(press)),
        }
    }

    /// Returns the normal force of the entire object on the pad, N, after the steps of a frame, without changing the
    /// state.
    pub fn force_after_n(&self, sliding: &Sliding, press: &Press, steps: &[ObjectStep]) -> f64 {
        let mut after = sliding.clone();
        match &self.curved {
            Some(curved) => {
                curved.advance(&mut after, steps, &self.moving_object(press));
                after.pressing_force_on_gel_n()
            }
            None => {
                after.advance(steps, &press.indenter, self.contact_conditions(press));
                0.0 - after.wrench().force_n[2]
            }
        }
    }

    /// Returns the object of a press as it moves over a gel that is not flat.
    fn moving_object<'a>(&'a self, press: &'a Press) -> MovingObject<'a> {
        MovingObject {
            indenter: &press.indenter,
            plane: &press.plane,
            texture: self.contact_conditions(press).texture,
            thickness_mm: self.sensor.gelpad.thickness_mm,
        }
    }

    /// Returns what decides, besides the object's shape, where it meets the pad; the effect that the policy leaves out
    /// is not in it.
    fn contact_conditions<'a>(&'a self, press: &'a Press) -> CaptureInput<'a> {
        let keeps = |effect| self.policy != EffectPolicy::Without(effect);
        CaptureInput {
            camera: &self.view,
            texture: press.texture.as_ref().filter(|_| keeps(Effect::Texture)),
            drop_mm: self.drop_mm.as_deref().filter(|_| keeps(Effect::RestShape)),
        }
    }
}
