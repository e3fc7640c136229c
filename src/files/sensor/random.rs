//! What may be drawn at random of a sensor: its numbers, by their paths, and its background.

use serde::Serialize;

use super::Sensor;
use super::quantity::Quantity;
use gelsim_core::optics::background::Pattern;
use gelsim_core::optics::led::Led;
use gelsim_core::optics::light_pattern::LightPattern;

/// What of a sensor is drawn anew for each sample.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct SensorDistribution {
    /// Numbers, by their dotted paths below `[sensor]`.
    pub numbers: Vec<(String, Quantity)>,
    /// Background images of which each sample gets one; empty if all samples have the same. In a job these are files or
    /// glob patterns, in a plan files.
    pub backgrounds: Vec<String>,
    /// SHA-256 of each background, if given; always given in a plan.
    pub background_sha256: Vec<String>,
}

impl SensorDistribution {
    /// Returns true if every sample has the same sensor.
    pub fn is_empty(&self) -> bool {
        self.numbers.is_empty() && self.backgrounds.is_empty() && self.background_sha256.is_empty()
    }

    /// Returns the distribution of the number at a dotted path from the top of a job, if it is drawn.
    pub fn distribution_at(&self, path: &str) -> Option<&Quantity> {
        let below = path.strip_prefix("sensor.")?;
        self.numbers.iter().find(|(known, _)| known == below).map(|(_, quantity)| quantity)
    }
}

impl Sensor {
    /// Returns the numbers that may vary from sample to sample, each with its dotted path below `[sensor]`. Numbers
    /// that decide the geometry of the image or the shape of the pad are left out.
    pub fn numbers_mut(&mut self) -> Vec<(String, &mut f64)> {
        let Self { gelpad_thickness_mm, gelpad_youngs_modulus_kpa, gelpad_poisson_ratio, darkening, .. } = self;
        let mut numbers = vec![
            (String::from("gelpad_thickness_mm"), gelpad_thickness_mm),
            (String::from("gelpad_youngs_modulus_kpa"), gelpad_youngs_modulus_kpa),
            (String::from("gelpad_poisson_ratio"), gelpad_poisson_ratio),
            (String::from("darkening"), darkening),
        ];
        push_elements(&mut numbers, "stray_light", self.stray_light.iter_mut().flatten());
        let look = &mut self.rendered_background;
        push_elements(&mut numbers, "rendered_background.color", &mut look.color);
        for (key, number) in [
            ("glow", &mut look.glow),
            ("glow_reach_mm", &mut look.glow_reach_mm),
            ("vignette", &mut look.vignette),
            ("grain", &mut look.grain),
            ("grain_size_mm", &mut look.grain_size_mm),
            ("dust_per_cm2", &mut look.dust_per_cm2),
            ("dust_size_mm", &mut look.dust_size_mm),
        ] {
            numbers.push((format!("rendered_background.{key}"), number));
        }
        if let Some(pattern) = look.pattern.as_deref_mut() {
            let Pattern { red, green, blue } = pattern;
            push_channels(&mut numbers, "rendered_background.pattern", [red, green, blue]);
        }
        for (i, led) in self.led.iter_mut().enumerate() {
            let Led { azimuth_deg, elevation_deg, angular_size_deg, distance_mm, color, intensity, pattern, .. } = led;
            for (key, number) in [
                ("azimuth_deg", azimuth_deg),
                ("elevation_deg", elevation_deg),
                ("distance_mm", distance_mm),
                ("intensity", intensity),
            ] {
                numbers.push((format!("led.{i}.{key}"), number));
            }
            push_elements(&mut numbers, &format!("led.{i}.angular_size_deg"), angular_size_deg);
            push_elements(&mut numbers, &format!("led.{i}.color"), color);
            if let Some(pattern) = pattern.as_deref_mut() {
                let LightPattern { red, green, blue } = pattern;
                push_channels(&mut numbers, &format!("led.{i}.pattern"), [red, green, blue]);
            }
        }
        numbers
    }

    /// Makes a sensor with `leds` LEDs that has every number of [`Sensor::numbers_mut`].
    pub fn with_every_number(leds: usize) -> Self {
        let pattern = Pattern { red: [0.0; 15], green: [0.0; 15], blue: [0.0; 15] };
        let coefficients = || vec![1.0, 0.0, 0.0];
        let light = LightPattern { red: coefficients(), green: coefficients(), blue: coefficients() };
        let led = Led { pattern: Some(Box::new(light)), ..Led::default() };
        let mut sensor = Self { stray_light: Some([0.0; 3]), led: vec![led; leds], ..Self::default() };
        sensor.rendered_background.pattern = Some(Box::new(pattern));
        sensor
    }
}

/// Adds the elements of a list, each with its index in the path.
fn push_elements<'a>(
    numbers: &mut Vec<(String, &'a mut f64)>,
    path: &str,
    list: impl IntoIterator<Item = &'a mut f64>,
) {
    numbers.extend(list.into_iter().enumerate().map(|(k, number)| (format!("{path}.{k}"), number)));
}

/// Adds the coefficients of red, green and blue.
fn push_channels<'a>(numbers: &mut Vec<(String, &'a mut f64)>, path: &str, channels: [&'a mut [f64]; 3]) {
    for (name, coefficients) in ["red", "green", "blue"].into_iter().zip(channels) {
        push_elements(numbers, &format!("{path}.{name}"), coefficients);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_are_where_their_paths_say() {
        let mut sensor = Sensor::with_every_number(2);
        let mut expected = Vec::new();
        for (k, (path, number)) in sensor.numbers_mut().into_iter().enumerate() {
            *number = 1000.0 + k as f64;
            expected.push((path, *number));
        }
        let tree = serde_json::to_value(&sensor).expect("a table");
        for (path, number) in expected {
            assert_eq!(tree.pointer(&format!("/{}", path.replace('.', "/"))), Some(&number.into()), "{path}");
        }
    }

    #[test]
    fn what_differs_between_units_is_among_them() {
        let unit = super::super::unit::UnitVariation { variation: 1.0, ..Default::default() };
        for stray_light in [None, Some([0.1; 3])] {
            let mut sensor = Sensor { unit: Some(unit.clone()), stray_light, ..Sensor::with_every_number(2) };
            let spreads: Vec<_> = sensor.spread_groups().into_iter().flat_map(|group| group.numbers).collect();
            let numbers: Vec<String> = sensor.numbers_mut().into_iter().map(|(path, _)| path).collect();
            assert!(spreads.iter().all(|spread| numbers.contains(&spread.path)), "{spreads:?}");
            assert_eq!(spreads.iter().any(|spread| spread.path == "led.0.intensity"), stray_light.is_none());
        }
    }
}
