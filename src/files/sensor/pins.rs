//! `[sensor.pins]`: pins inside a gel that is not flat, and their positions.

use std::sync::Arc;

use serde::{Deserialize, Serialize};

use gelsim_core::camera::pins::{Along, MountRing, Pins};

/// Pins inside the skin, seen white on black.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "formats", derive(schemars::JsonSchema))]
#[serde(deny_unknown_fields)]
#[cfg_attr(feature = "formats", schemars(rename = "SensorPins"))]
pub struct PinDistribution {
    /// How the pins are arranged.
    #[serde(default)]
    pub layout: PinLayout,
    /// SHA-256 of the layout's file in lower-case hex; if given, another content is refused.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub layout_sha256: Option<String>,
    /// The positions in that file, once it was read, mm.
    #[serde(skip)]
    pub places_mm: Option<Arc<Vec<[f64; 2]>>>,
    /// Number of pins, 1 to 10000. Not with a layout from a file.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub count: Option<u32>,
    /// Distance from ring to ring, or from pin to pin, over the skin, mm. Not with a layout from a file.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub spacing_mm: Option<f64>,
    /// Rotation of the layout from x towards y, degrees.
    #[serde(default)]
    pub turn_deg: f64,
    /// Distance from the outer skin to a pin's tip, mm.
    pub length_mm: f64,
    /// Diameter of the white tips, mm.
    pub diameter_mm: f64,
    /// Standard deviation of the smoothing by which the inner skin follows the outer one, mm.
    #[serde(default)]
    pub skin_smoothing_mm: f64,
    /// The direction in which points of the skin move under a press.
    #[serde(default)]
    pub along: Along,
    /// Fraction of the gel's motion in its own plane that the skin, which is stiffer than the gel, takes part in, 0 to
    /// 1.
    #[serde(default = "default_in_plane")]
    pub in_plane: f64,
    /// Standard deviation of the smoothing by which the skin follows what friction drags along it, mm; 0: as the gel does.
    /// A stiff skin moves more as a whole.
    #[serde(default)]
    pub drag_smoothing_mm: f64,
    /// Standard deviation of the diameters from sample to sample, as a fraction.
    #[serde(default)]
    pub size_jitter: f64,
    /// Standard deviation of the tips' positions from sample to sample, mm.
    #[serde(default)]
    pub place_jitter_mm: f64,
    /// The ring that holds the skin, if the camera sees it.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub mount: Option<MountRing>,
}

/// How pins are arranged.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "formats", derive(schemars::JsonSchema))]
#[serde(rename_all = "snake_case")]
pub enum PinLayout {
    /// One in the middle, and on each ring six more than on the one inside it.
    #[default]
    Rings,
    /// Each pin has six neighbours at the same distance.
    Hexagonal,
    /// Positions from a CSV file, relative to the file this stands in: columns x_mm and y_mm, mm from the tip over the
    /// gel.
    File(String),
}

fn default_in_plane() -> f64 {
    1.0
}

impl PinDistribution {
    /// Converts to the pins of the simulator.
    pub fn to_pins(&self) -> Pins {
        Pins {
            at_mm: self.compute_positions(),
            length_mm: self.length_mm,
            diameter_mm: self.diameter_mm,
            skin_smoothing_mm: self.skin_smoothing_mm,
            along: self.along,
            in_plane: self.in_plane,
            drag_smoothing_mm: self.drag_smoothing_mm,
            size_jitter: self.size_jitter,
            place_jitter_mm: self.place_jitter_mm,
            mount: self.mount,
        }
    }

    /// Returns the distance of the outermost pin from the tip, mm.
    pub fn reach_mm(&self) -> f64 {
        self.compute_positions().iter().map(|[x, y]| libm::hypot(*x, *y)).fold(0.0, f64::max)
    }

    /// Computes the positions of the pins, mm over the skin from the tip. Rings and hexagons are in order from the
    /// middle outwards.
    fn compute_positions(&self) -> Vec<[f64; 2]> {
        let turn = self.turn_deg.to_radians();
        let at = |radius: f64, angle: f64| {
            let (sin, cos) = libm::sincos(angle + turn);
            [radius * cos, radius * sin]
        };
        let count = self.count.unwrap_or_default() as usize;
        let spacing_mm = self.spacing_mm.unwrap_or_default();
        match &self.layout {
            PinLayout::Rings => {
                let mut places = vec![[0.0; 2]];
                let mut ring = 1;
                while places.len() < count {
                    let pins = (6 * ring).min(count - places.len());
                    let step = 2.0 * std::f64::consts::PI / pins as f64;
                    places.extend((0..pins).map(|k| at(ring as f64 * spacing_mm, k as f64 * step)));
                    ring += 1;
                }
                places
            }
            PinLayout::Hexagonal => {
                let reach = libm::ceil(libm::sqrt(count as f64)) as i64 + 1;
                let steps = (-reach..=reach).flat_map(|a| (-reach..=reach).map(move |b| (a, b)));
                // Sort by the squared distance from the middle in units of the spacing, an exact whole number, then by
                // angle.
                let mut nodes: Vec<(i64, f64)> = steps
                    .map(|(a, b)| {
                        let (x, y) = (a as f64 + 0.5 * b as f64, b as f64 * libm::sqrt(0.75));
                        (a * a + a * b + b * b, libm::atan2(y, x))
                    })
                    .collect();
                nodes.sort_by(|a, b| a.0.cmp(&b.0).then(a.1.total_cmp(&b.1)));
                let place = |(square, angle): (i64, f64)| at(spacing_mm * libm::sqrt(square as f64), angle);
                nodes.into_iter().take(count).map(place).collect()
            }
            PinLayout::File(_) => {
                let turned = |[x, y]: &[f64; 2]| at(libm::hypot(*x, *y), libm::atan2(*y, *x));
                self.places_mm.iter().flat_map(|places| places.iter().map(turned)).collect()
            }
        }
    }
}

/// Reads the positions in a table of pins, mm. The errors name the line and the column.
#[cfg(feature = "formats")]
pub fn parse_pin_table(path: &str, bytes: &[u8]) -> Result<Vec<[f64; 2]>, Vec<String>> {
    use crate::place_table::{PlaceKind, parse_places};

    let kind = PlaceKind { name: "pin", max_diameter_mm: None, is_distinct: false };
    Ok(parse_places(path, bytes, kind)?.into_iter().map(|pin| pin.at_mm).collect())
}

#[cfg(test)]
mod tests {
    use super::*;

    fn pins(layout: PinLayout, count: u32) -> PinDistribution {
        PinDistribution {
            layout,
            layout_sha256: None,
            places_mm: None,
            count: Some(count),
            spacing_mm: Some(2.0),
            turn_deg: 10.0,
            length_mm: 1.0,
            diameter_mm: 1.0,
            skin_smoothing_mm: 0.0,
            along: Along::Normal,
            in_plane: 1.0,
            drag_smoothing_mm: 0.0,
            size_jitter: 0.0,
            place_jitter_mm: 0.0,
            mount: None,
        }
    }

    #[test]
    fn both_layouts_keep_pins_apart_and_fill_from_the_middle() {
        for (layout, closest_mm) in [(PinLayout::Rings, 1.99), (PinLayout::Hexagonal, 1.9999)] {
            for count in [1, 2, 7, 100, 331] {
                let places = pins(layout.clone(), count).compute_positions();
                assert_eq!((places.len(), places[0]), (count as usize, [0.0; 2]));
                let apart = |a: &[f64; 2], b: &[f64; 2]| libm::hypot(a[0] - b[0], a[1] - b[1]);
                let pairs = places.iter().enumerate().flat_map(|(k, a)| places[..k].iter().map(move |b| apart(a, b)));
                let closest = pairs.fold(f64::INFINITY, f64::min);
                assert!(closest > closest_mm, "{layout:?} {count}: {closest}");
            }
            let reach_mm = pins(layout, 331).reach_mm();
            assert!((reach_mm - 20.0).abs() < 2.0, "{reach_mm}");
        }
    }
}
