//! Presses one object into several sensors. Sensors of the same pad and view compute its contact once.

use super::{Press, PressError, PressedPad, Simulator};
use crate::impression::Impression;

impl Simulator {
    /// Presses the same object into several sensors, each with the markers and the camera of its own press, and calls
    /// `each` with their impressions, in order.
    ///
    /// Every impression equals that of [`Simulator::try_press`] to the bit; only the CPU seconds differ. The presses
    /// must agree in all but `markers`, `camera` and `unit_key` where their simulators
    /// [share a contact](Simulator::shares_contact).
    ///
    /// # Errors
    ///
    /// As [`Simulator::try_press`], for the first press that has one; then nothing is pressed.
    pub fn try_press_together(presses: &[(&Self, &Press)], mut each: impl FnMut(Impression)) -> Result<(), PressError> {
        presses.iter().try_for_each(|(simulator, press)| simulator.check_press(press))?;
        // The pads that were pressed and are pressed again, each with the first simulator that has it.
        let mut known: Vec<(&Self, PressedPad)> = Vec::new();
        for (number, (simulator, press)) in presses.iter().enumerate() {
            if simulator.curved.is_some() {
                each(simulator.render_press(press, None));
                continue;
            }
            let found = known.iter().position(|(first, _)| first.shares_contact(simulator));
            let is_pressed_again = presses[number + 1..].iter().any(|(later, _)| simulator.shares_contact(later));
            let pad = match (found, is_pressed_again) {
                (Some(found), true) => known[found].1.for_another(),
                // The last sensor of a pad takes what is known of it.
                (Some(found), false) => known.swap_remove(found).1.into_another(),
                (None, false) => simulator.press_pad(press, None),
                (None, true) => {
                    let pad = simulator.press_pad(press, None);
                    known.push((simulator, pad.clone()));
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
