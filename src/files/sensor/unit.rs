//! `[sensor.unit]`: how much units of one kind of sensor differ.
//!
//! Every number is a standard deviation between units. Draws stay within two standard deviations. `variation` scales
//! all of them. Sources and guesses: docs/reference/presets.md, "How much units differ".

use serde::{Deserialize, Serialize};

use super::Sensor;
use gelsim_core::optics::background::{self, Pattern};

/// The greatest deviation that is drawn, in standard deviations.
pub const MAX_DEVIATIONS: f64 = 2.0;

/// The `[sensor.unit]` table: standard deviations between units of the sensor's kind.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "formats", derive(schemars::JsonSchema))]
#[serde(default, deny_unknown_fields)]
#[cfg_attr(feature = "formats", schemars(rename = "UnitVariation"))]
pub struct UnitVariation {
    /// How much each sample's sensor is another unit, as a fraction of these standard deviations, 0 to 1: at 0 all
    /// samples are of one unit, at 1 they differ as real units do.
    pub variation: f64,
    /// Brightness of all LEDs together, as a fraction of it. Not used if `stray_light` makes the LEDs' light follow that
    /// of a rendered background.
    pub led_intensity: f64,
    /// Each coefficient of an LED's pattern but the first.
    pub led_pattern: f64,
    /// Direction of each LED, degrees.
    pub led_azimuth_deg: f64,
    /// Elevation of each LED, degrees.
    pub led_elevation_deg: f64,
    /// Red, green and blue of a rendered background, as a fraction of them.
    pub background_color: [f64; 3],
    /// Each coefficient of a rendered background's pattern; 0.05 if left out.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub background_pattern: Option<Box<Pattern>>,
    /// Thickness of the gelpad, as a fraction of it.
    pub gelpad_thickness: f64,
    /// Young's modulus of the gelpad, as a fraction of it.
    pub gelpad_youngs_modulus: f64,
}

impl Default for UnitVariation {
    fn default() -> Self {
        Self {
            variation: 0.0,
            led_intensity: 0.2,
            led_pattern: 0.1,
            led_azimuth_deg: 3.0,
            led_elevation_deg: 3.0,
            background_color: [0.2; 3],
            background_pattern: None,
            gelpad_thickness: 0.03,
            gelpad_youngs_modulus: 0.1,
        }
    }
}

/// Fraction of the variance of colours, and of the brightness of LEDs, that all colours or LEDs of a unit have in
/// common. It was measured on the colours of untouched pads (docs/reference/presets.md, "How much units differ").
const COMMON_VARIANCE_SHARE: f64 = 0.92;

/// Numbers of a sensor that differ between units and are drawn together.
#[derive(Clone, Debug, PartialEq)]
pub struct SpreadGroup {
    /// Name of the group, unique in the sensor.
    pub name: String,
    /// How the deviations of the numbers are correlated.
    pub correlation: Correlation,
    /// The numbers.
    pub numbers: Vec<NumberSpread>,
}

/// How the deviations of a group of numbers are correlated.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Correlation {
    /// All of them share a common part.
    Common,
    /// Like the coefficients of a polynomial whose parts of each order are independent.
    Pattern,
}

/// A number of a sensor that differs between units.
#[derive(Clone, Debug, PartialEq)]
pub struct NumberSpread {
    /// Dotted path of the number below `[sensor]`.
    pub path: String,
    /// Standard deviation, in the number's unit or as a fraction of it.
    pub deviation: f64,
    /// Whether the deviation is a fraction of the number.
    pub relative: bool,
}

impl NumberSpread {
    /// Returns the number of a unit that lies `deviations` standard deviations from the mean of all units.
    pub fn shift_value(&self, value: f64, deviations: f64) -> f64 {
        let by = self.deviation * deviations;
        if self.relative { value * (1.0 + by) } else { value + by }
    }
}

impl SpreadGroup {
    /// Draws, for each number of a unit, how many standard deviations it lies from the mean of all units. `normal`
    /// returns standard normal numbers. All deviations are within [`MAX_DEVIATIONS`].
    pub fn draw_deviations(&self, mut normal: impl FnMut() -> f64) -> Vec<f64> {
        let mut draw = || match self.correlation {
            Correlation::Common => {
                // The common and the own part add up to a variance of 1.
                let common = COMMON_VARIANCE_SHARE.sqrt() * normal();
                let own = (1.0 - COMMON_VARIANCE_SHARE).sqrt();
                self.numbers
                    .iter()
                    .map(|_| if self.numbers.len() == 1 { normal() } else { common + own * normal() })
                    .collect()
            }
            Correlation::Pattern => background::correlate_coefficients(&std::array::from_fn(|_| normal())).to_vec(),
        };
        // Drawing again keeps the correlation, which clamping single numbers would break.
        let within = |drawn: &Vec<f64>| drawn.iter().all(|deviations| deviations.abs() <= MAX_DEVIATIONS);
        (0..1000).map(|_| draw()).find(within).unwrap_or_else(|| vec![0.0; self.numbers.len()])
    }
}

impl Sensor {
    /// Returns the numbers in which the sensor's units differ, as far as a job asks for it. No number is in two groups.
    pub fn spread_groups(&self) -> Vec<SpreadGroup> {
        let Some(unit) = self.unit.as_ref().filter(|unit| unit.variation != 0.0) else { return Vec::new() };
        let mut groups = Vec::new();
        let mut add = |name: &str, together, numbers: Vec<(String, f64)>, relative: bool| {
            if numbers.iter().any(|(_, deviation)| *deviation != 0.0) {
                let scaled = |(path, deviation)| NumberSpread { path, deviation: deviation * unit.variation, relative };
                let numbers = numbers.into_iter().map(scaled).collect();
                groups.push(SpreadGroup { name: name.to_owned(), correlation: together, numbers });
            }
        };
        // Lamps show the pad as it was measured, so nothing of its look is drawn.
        let rendered = self.background.is_none() && self.lamp.is_empty();
        let of_leds =
            |key: &str, deviation| (0..self.led.len()).map(|i| (format!("led.{i}.{key}"), deviation)).collect();
        if !(rendered && self.stray_light.is_some()) {
            add("led.intensity", Correlation::Common, of_leds("intensity", unit.led_intensity), true);
        }
        // One that is given by its position has no direction that could differ.
        for i in (0..self.led.len()).filter(|i| self.led[*i].position_mm.is_none()) {
            for (key, deviation) in [("azimuth_deg", unit.led_azimuth_deg), ("elevation_deg", unit.led_elevation_deg)] {
                let path = format!("led.{i}.{key}");
                add(&path, Correlation::Common, vec![(path.clone(), deviation)], false);
            }
        }
        for (i, led) in self.led.iter().enumerate() {
            let Some(pattern) = &led.pattern else { continue };
            for (channel, coefficients) in ["red", "green", "blue"].into_iter().zip(pattern.channels()) {
                for k in 1..coefficients.len() {
                    let path = format!("led.{i}.pattern.{channel}.{k}");
                    add(&path, Correlation::Common, vec![(path.clone(), unit.led_pattern)], false);
                }
            }
        }
        if rendered {
            let color = |k: usize| (format!("rendered_background.color.{k}"), unit.background_color[k]);
            add("rendered_background.color", Correlation::Common, [0, 1, 2].map(color).to_vec(), true);
        }
        if rendered && self.rendered_background.pattern.is_some() {
            let own = unit.background_pattern.as_deref();
            let channels = [
                ("red", own.map(|own| own.red)),
                ("green", own.map(|own| own.green)),
                ("blue", own.map(|own| own.blue)),
            ];
            for (channel, deviations) in channels {
                let name = format!("rendered_background.pattern.{channel}");
                let deviations = deviations.unwrap_or([0.05; 15]).into_iter().enumerate();
                let numbers = deviations.map(|(k, deviation)| (format!("{name}.{k}"), deviation)).collect();
                add(&name, Correlation::Pattern, numbers, false);
            }
        }
        for (path, deviation) in
            [("gelpad_thickness_mm", unit.gelpad_thickness), ("gelpad_youngs_modulus_kpa", unit.gelpad_youngs_modulus)]
        {
            add(path, Correlation::Common, vec![(String::from(path), deviation)], true);
        }
        groups
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use gelsim_core::base::rng::random_stream;

    /// Deviations of many units, by number.
    fn drawn(spreads: &SpreadGroup) -> Vec<Vec<f64>> {
        (0..2000)
            .map(|unit| {
                let mut stream = random_stream(1, "units", unit);
                spreads.draw_deviations(|| stream.standard_normal())
            })
            .collect()
    }

    fn correlation(units: &[Vec<f64>], i: usize, j: usize) -> f64 {
        let sum = |of: &dyn Fn(&Vec<f64>) -> f64| units.iter().map(of).sum::<f64>();
        sum(&|unit| unit[i] * unit[j]) / (sum(&|unit| unit[i] * unit[i]) * sum(&|unit| unit[j] * unit[j])).sqrt()
    }

    fn group(sensor: &Sensor, name: &str) -> SpreadGroup {
        sensor
            .spread_groups()
            .into_iter()
            .find(|group| group.name == name)
            .unwrap_or_else(|| panic!("{name} is not drawn"))
    }

    fn sensor() -> Sensor {
        Sensor {
            unit: Some(UnitVariation { variation: 1.0, ..UnitVariation::default() }),
            stray_light: None,
            ..Sensor::with_every_number(3)
        }
    }

    #[test]
    fn colours_and_leds_go_up_and_down_together_and_stay_within_two_deviations() {
        for name in ["rendered_background.color", "led.intensity"] {
            let units = drawn(&group(&sensor(), name));
            assert!(units.iter().flatten().all(|deviations| deviations.abs() <= MAX_DEVIATIONS));
            for (i, j) in [(0, 1), (0, 2), (1, 2)] {
                let together = correlation(&units, i, j);
                assert!((0.85..0.95).contains(&together), "{name} {i}, {j}: {together}");
            }
        }
    }

    #[test]
    fn a_pattern_varies_over_the_pad_less_than_its_coefficients_would_alone() {
        let spreads = group(&sensor(), "rendered_background.pattern.green");
        let units = drawn(&spreads);
        assert!(units.iter().flatten().all(|deviations| deviations.abs() <= MAX_DEVIATIONS));
        // y^2 and y^4 are anticorrelated; x and y are independent.
        assert!(correlation(&units, 2, 4) < -0.8 && correlation(&units, 1, 5).abs() < 0.1);
        let at = |coefficients: &dyn Fn(usize) -> f64| {
            let pattern = Pattern { red: [0.0; 15], green: std::array::from_fn(coefficients), blue: [0.0; 15] };
            let places = (0..21).map(|k| 0.1 * f64::from(k) - 1.0);
            let squares: f64 = places
                .clone()
                .flat_map(|x| places.clone().map(move |y| (x, y)))
                .map(|(x, y)| pattern.polynomial(x, y)[1].powi(2))
                .sum();
            squares / 441.0
        };
        let together: f64 = units.iter().map(|unit| at(&|k| unit[k])).sum::<f64>() / units.len() as f64;
        let alone: f64 = (0..15).map(|own| at(&|k| f64::from(u8::from(k == own)))).sum();
        assert!(together < 0.4 * alone, "{together} against {alone}");
    }
}
