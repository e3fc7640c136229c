//! Presses one object into several sensors. Sensors of the same pad and view compute its contact once.

use std::sync::Arc;

use super::{Press, PressError, PressedPad, Simulator};
use crate::depth::indenter::Shape;
use crate::impression::Impression;

impl Simulator {
    /// Presses objects into several sensors, and calls `each` with their impressions, in order. Presses of the
    /// [same contact](Press::has_same_contact) into simulators that [share it](Simulator::shares_contact) compute it
    /// once.
    ///
    /// Every impression equals that of [`Simulator::try_press`] to the bit; only the CPU seconds differ.
    ///
    /// # Errors
    ///
    /// As [`Simulator::try_press`], for the first press that has one; then nothing is pressed.
    pub fn try_press_together(presses: &[(&Self, &Press)], mut each: impl FnMut(Impression)) -> Result<(), PressError> {
        presses.iter().try_for_each(|(simulator, press)| simulator.check_press(press))?;
        let is_same = |(one, of_one): (&Self, &Press), (other, of_other): (&Self, &Press)| {
            one.shares_contact(other) && of_one.has_same_contact(of_other)
        };
        // The pads that were pressed and are pressed again, each with its first simulator and press.
        let mut known: Vec<((&Self, &Press), PressedPad)> = Vec::new();
        for (number, &(simulator, press)) in presses.iter().enumerate() {
            if simulator.curved.is_some() {
                each(simulator.render_press(press, None));
                continue;
            }
            let found = known.iter().position(|(first, _)| is_same(*first, (simulator, press)));
            let is_pressed_again = presses[number + 1..].iter().any(|later| is_same((simulator, press), *later));
            let pad = match (found, is_pressed_again) {
                (Some(found), true) => known[found].1.for_another(),
                // The last sensor of a pad takes what is known of it.
                (Some(found), false) => known.swap_remove(found).1.into_another(),
                (None, false) => simulator.press_pad(press, None),
                (None, true) => {
                    let pad = simulator.press_pad(press, None);
                    known.push(((simulator, press), pad.clone()));
                    pad
                }
            };
            each(simulator.light_pad(press, pad, None));
        }
        Ok(())
    }

    /// Returns true if an object leaves the same contact on both sensors: their flat pads, views and models of the pad
    /// are the same, and so is what they compute of it.
    pub fn shares_contact(&self, other: &Self) -> bool {
        let pad = |of: &Self| {
            let asked = (of.in_plane.is_some(), of.shader.averages_within_pixels());
            (of.view, of.sensor.gelpad, of.sensor.window_mm(), of.policy, asked)
        };
        let is_flat = |of: &Self| of.curved.is_none();
        is_flat(self)
            && is_flat(other)
            && pad(self) == pad(other)
            && self.models.gelpad == other.models.gelpad
            && self.sensor.rest_surface == other.sensor.rest_surface
    }
}

impl Press {
    /// Returns true if both press the same object in the same way: they may differ in markers, camera and unit. Shapes
    /// and reliefs are the same if they share their memory.
    pub fn has_same_contact(&self, other: &Self) -> bool {
        let is_same_shape = match (&self.indenter.shape, &other.indenter.shape) {
            (Shape::Mesh(one), Shape::Mesh(other)) => Arc::ptr_eq(one, other),
            (Shape::HeightMap(one), Shape::HeightMap(other)) => Arc::ptr_eq(one, other),
            (Shape::Seen(one), Shape::Seen(other)) => Arc::ptr_eq(one, other),
            _ => false,
        };
        let is_same_texture = match (&self.texture, &other.texture) {
            (None, None) => true,
            (Some(one), Some(other)) => {
                Arc::ptr_eq(&one.relief, &other.relief)
                    && (one.sample, one.placement) == (other.sample, other.placement)
            }
            _ => false,
        };
        let rest = |of: &Self| (of.indenter.pose, of.indenter.depth_mm, of.material, of.shear, of.plane);
        is_same_shape && is_same_texture && rest(self) == rest(other)
    }
}
