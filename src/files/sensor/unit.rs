//! `[sensor.unit]`: how much units of one kind of sensor differ.
//!
//! Every number is a standard deviation between units; what is drawn stays within two of them. `variation` scales all of
//! them. Sources and guesses: docs/sensors.md, "How much units differ".

use serde::{Deserialize, Serialize};

use super::Sensor;
use crate::core::optics::background::Pattern;

/// Standard deviations beyond which nothing is drawn.
pub const MOST_DEVIATIONS: f64 = 2.0;

/// The `[sensor.unit]` table: standard deviations between units of the sensor's kind.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "datasets", derive(schemars::JsonSchema))]
#[serde(default, deny_unknown_fields)]
#[cfg_attr(feature = "datasets", schemars(rename = "UnitVariation"))]
pub struct Unit {
    /// Share of these standard deviations by which each sample's sensor is another unit, 0 to 1: at 0 all samples are of
    /// one unit, at 1 they differ as real units do.
    pub variation: f64,
    /// Brightness of each LED, as a share of it. Not used where the LEDs' light follows that of a rendered background, by
    /// `stray_light`.
    pub led_intensity: f64,
    /// Direction of each LED, degrees.
    pub led_azimuth_deg: f64,
    /// Elevation of each LED, degrees.
    pub led_elevation_deg: f64,
    /// Red, green and blue of a rendered background, as a share of them.
    pub background_color: [f64; 3],
    /// Each coefficient of a rendered background's pattern; 0.05 where it is left out.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub background_pattern: Option<Box<Pattern>>,
    /// Thickness of the gelpad, as a share of it.
    pub gelpad_thickness: f64,
    /// Young's modulus of the gelpad, as a share of it.
    pub gelpad_youngs_modulus: f64,
}

impl Default for Unit {
    fn default() -> Self {
        Self {
            variation: 0.0,
            led_intensity: 0.2,
            led_azimuth_deg: 3.0,
            led_elevation_deg: 3.0,
            background_color: [0.2; 3],
            background_pattern: None,
            gelpad_thickness: 0.03,
            gelpad_youngs_modulus: 0.1,
        }
    }
}

/// A number of a sensor that differs between units.
#[derive(Clone, Debug, PartialEq)]
pub struct Spread {
    /// Dotted path below `[sensor]`.
    pub path: String,
    /// Standard deviation.
    pub deviation: f64,
    /// It is a share of the number.
    pub relative: bool,
}

impl Spread {
    /// The number of a unit that lies `deviations` standard deviations from the others' middle.
    pub fn shifted(&self, value: f64, deviations: f64) -> f64 {
        let by = self.deviation * deviations;
        if self.relative { value * (1.0 + by) } else { value + by }
    }
}

impl Sensor {
    /// The numbers in which its units differ, in as far as a job wants them to; none of them twice.
    pub fn spreads(&self) -> Vec<Spread> {
        let Some(unit) = self.unit.as_ref().filter(|unit| unit.variation != 0.0) else { return Vec::new() };
        let mut spreads = Vec::new();
        let mut add = |path: String, deviation: f64, relative: bool| {
            if deviation != 0.0 {
                spreads.push(Spread { path, deviation: deviation * unit.variation, relative });
            }
        };
        // Lamps show the pad as it was measured.
        let rendered = self.background.is_none() && self.lamp.is_empty();
        for i in 0..self.led.len() {
            if !(rendered && self.stray_light.is_some()) {
                add(format!("led.{i}.intensity"), unit.led_intensity, true);
            }
            add(format!("led.{i}.azimuth_deg"), unit.led_azimuth_deg, false);
            add(format!("led.{i}.elevation_deg"), unit.led_elevation_deg, false);
        }
        if rendered {
            for (k, deviation) in unit.background_color.iter().enumerate() {
                add(format!("rendered_background.color.{k}"), *deviation, true);
            }
        }
        if rendered && self.rendered_background.pattern.is_some() {
            let own = unit.background_pattern.as_deref();
            let channels = [
                ("red", own.map(|own| own.red)),
                ("green", own.map(|own| own.green)),
                ("blue", own.map(|own| own.blue)),
            ];
            for (channel, deviations) in channels {
                for (k, deviation) in deviations.unwrap_or([0.05; 15]).into_iter().enumerate() {
                    add(format!("rendered_background.pattern.{channel}.{k}"), deviation, false);
                }
            }
        }
        add(String::from("gelpad_thickness_mm"), unit.gelpad_thickness, true);
        add(String::from("gelpad_youngs_modulus_kpa"), unit.gelpad_youngs_modulus, true);
        spreads
    }
}
