//! Frames of a sequence: an object that slides, turns and rolls on the pad.

use crate::core::base::clock::Clock;
use crate::core::curved::sequence::MovingObject;
use crate::core::depth::texture::{Laid, Texture};
use crate::core::effects::{Effect, EffectPolicy};
use crate::core::gelpad;
use crate::core::gelpad::elastic::shear::Friction;
use crate::core::gelpad::sliding::{FramePad, Ground, ObjectStep, Sliding};
use crate::core::impression::Impression;
use crate::core::pose::Pose;

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
    /// ```
    /// use gelsim::{Fidelity, Friction, Indenter, ObjectStep, PlanarMotion, Pose, Press, Sensor, Simulator};
    ///
    /// # fn main() -> Result<(), Box<dyn std::error::Error>> {
    /// let sensor = Sensor::preset("gelsight-2014")?.with_resolution([80, 60]);
    /// let simulator = Simulator::new(&sensor, Fidelity::Draft)?;
    /// let view = sensor.view();
    /// let mut sliding = simulator.sliding(Friction::Coulomb { coefficient: 0.3 }).expect("an elastic pad");
    /// let mut wrench = Default::default();
    /// for frame in 0..12 {
    ///     // A ball of 4 mm: pressed in for four frames, then pushed to the right.
    ///     let (deep, right, by) = (0.2 * f64::from(frame.min(3) + 1), 0.2 * f64::from((frame - 3).max(0)), 0.2);
    ///     let ball = |i: usize| {
    ///         let [x, y] = view.point_mm([(i % 80) as f64 + 0.5, (i / 80) as f64 + 0.5]);
    ///         let left = 16.0 - (x - right) * (x - right) - y * y;
    ///         if left > 0.0 { (deep - 4.0 + left.sqrt()) as f32 } else { f32::NEG_INFINITY }
    ///     };
    ///     let pose = Pose::placed([0.0, 0.0, 0.0, 1.0], [right, 0.0, -deep]);
    ///     let indenter = Indenter { pose, ..Indenter::height_map([80, 60], (0..80 * 60).map(ball).collect())? };
    ///     let shift_mm = [if frame > 3 { by } else { 0.0 }, 0.0];
    ///     let motion = PlanarMotion { shift_mm, ..PlanarMotion::default() };
    ///     let step = ObjectStep { pose, depth_mm: indenter.depth_mm, motion };
    ///     let impression = simulator.press_next(&Press::new(indenter, &sensor), &[step], &mut sliding);
    ///     wrench = impression.sliding.expect("a frame of a sequence").wrench;
    /// }
    /// let [x, _, z] = wrench.force_n;
    /// assert!(x > 0.25 * -z && x < 0.301 * -z, "{wrench:?}"); // it slips
    /// # Ok(())
    /// # }
    /// ```
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
