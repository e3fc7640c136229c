//! `[sensor.unit]`: how much units of one kind of sensor differ.
//!
//! Every number is a standard deviation between units; what is drawn stays within two of them. `variation` scales all of
//! them. Sources and guesses: docs/sensors.md, "How much units differ".

use serde::{Deserialize, Serialize};

use super::Sensor;
use gelsim_core::optics::background::{self, Pattern};

/// Standard deviations beyond which nothing is drawn.
pub const MOST_DEVIATIONS: f64 = 2.0;

/// The `[sensor.unit]` table: standard deviations between units of the sensor's kind.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "formats", derive(schemars::JsonSchema))]
#[serde(default, deny_unknown_fields)]
#[cfg_attr(feature = "formats", schemars(rename = "UnitVariation"))]
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

/// Share of the variance of colours, and of the brightness of LEDs, that all of a unit's have in common: measured on the colours
/// of untouched pads (docs/sensors.md, "How much units differ").
const IN_COMMON: f64 = 0.92;

/// Numbers of a sensor that differ between units, and are drawn together.
#[derive(Clone, Debug, PartialEq)]
pub struct Spreads {
    /// Names the group among those of the sensor.
    pub name: String,
    /// How their deviations go together.
    pub together: Together,
    /// The numbers.
    pub numbers: Vec<Spread>,
}

/// How the deviations of a group of numbers go together.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Together {
    /// By a share that all have in common.
    Common,
    /// As the coefficients of a polynomial do whose parts of each order are free.
    Pattern,
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

impl Spreads {
    /// By how many standard deviations each number of a unit lies from the others' middle, from standard normal numbers: all within
    /// [`MOST_DEVIATIONS`].
    pub fn deviations(&self, mut normal: impl FnMut() -> f64) -> Vec<f64> {
        let mut draw = || match self.together {
            Together::Common => {
                let common = IN_COMMON.sqrt() * normal();
                let own = (1.0 - IN_COMMON).sqrt();
                self.numbers
                    .iter()
                    .map(|_| if self.numbers.len() == 1 { normal() } else { common + own * normal() })
                    .collect()
            }
            Together::Pattern => background::together(&std::array::from_fn(|_| normal())).to_vec(),
        };
        let within = |drawn: &Vec<f64>| drawn.iter().all(|deviations| deviations.abs() <= MOST_DEVIATIONS);
        (0..1000).map(|_| draw()).find(within).unwrap_or_else(|| vec![0.0; self.numbers.len()])
    }
}

impl Sensor {
    /// The numbers in which its units differ, in as far as a job wants them to; none of them twice.
    pub fn spreads(&self) -> Vec<Spreads> {
        let Some(unit) = self.unit.as_ref().filter(|unit| unit.variation != 0.0) else { return Vec::new() };
        let mut groups = Vec::new();
        let mut add = |name: &str, together, numbers: Vec<(String, f64)>, relative: bool| {
            if numbers.iter().any(|(_, deviation)| *deviation != 0.0) {
                let scaled = |(path, deviation)| Spread { path, deviation: deviation * unit.variation, relative };
                let numbers = numbers.into_iter().map(scaled).collect();
                groups.push(Spreads { name: name.to_owned(), together, numbers });
            }
        };
        // Lamps show the pad as it was measured.
        let rendered = self.background.is_none() && self.lamp.is_empty();
        let of_leds =
            |key: &str, deviation| (0..self.led.len()).map(|i| (format!("led.{i}.{key}"), deviation)).collect();
        if !(rendered && self.stray_light.is_some()) {
            add("led.intensity", Together::Common, of_leds("intensity", unit.led_intensity), true);
        }
        for i in 0..self.led.len() {
            for (key, deviation) in [("azimuth_deg", unit.led_azimuth_deg), ("elevation_deg", unit.led_elevation_deg)] {
                let path = format!("led.{i}.{key}");
                add(&path, Together::Common, vec![(path.clone(), deviation)], false);
            }
        }
        if rendered {
            let color = |k: usize| (format!("rendered_background.color.{k}"), unit.background_color[k]);
            add("rendered_background.color", Together::Common, [0, 1, 2].map(color).to_vec(), true);
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
                add(&name, Together::Pattern, numbers, false);
            }
        }
        for (path, deviation) in
            [("gelpad_thickness_mm", unit.gelpad_thickness), ("gelpad_youngs_modulus_kpa", unit.gelpad_youngs_modulus)]
        {
            add(path, Together::Common, vec![(String::from(path), deviation)], true);
        }
        groups
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use gelsim_core::base::rng::stream;

    /// Deviations of many units, by number.
    fn drawn(spreads: &Spreads) -> Vec<Vec<f64>> {
        (0..2000)
            .map(|unit| {
                let mut stream = stream(1, "units", unit);
                spreads.deviations(|| stream.normal())
            })
            .collect()
    }

    fn correlation(units: &[Vec<f64>], i: usize, j: usize) -> f64 {
        let sum = |of: &dyn Fn(&Vec<f64>) -> f64| units.iter().map(of).sum::<f64>();
        sum(&|unit| unit[i] * unit[j]) / (sum(&|unit| unit[i] * unit[i]) * sum(&|unit| unit[j] * unit[j])).sqrt()
    }

    fn group(sensor: &Sensor, name: &str) -> Spreads {
        sensor.spreads().into_iter().find(|group| group.name == name).unwrap_or_else(|| panic!("{name} is not drawn"))
    }

    fn sensor() -> Sensor {
        Sensor {
            unit: Some(Unit { variation: 1.0, ..Unit::default() }),
            stray_light: None,
            ..Sensor::with_every_number(3)
        }
    }

    #[test]
    fn colours_and_leds_go_up_and_down_together_and_stay_within_two_deviations() {
        for name in ["rendered_background.color", "led.intensity"] {
            let units = drawn(&group(&sensor(), name));
            assert!(units.iter().flatten().all(|deviations| deviations.abs() <= MOST_DEVIATIONS));
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
        assert!(units.iter().flatten().all(|deviations| deviations.abs() <= MOST_DEVIATIONS));
        // y^2 and y^4 take each other back; x and y know nothing of each other.
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
