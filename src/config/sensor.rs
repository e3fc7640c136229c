//! `[sensor]` and sensor files: camera window, gelpad, LEDs and the look of the untouched pad.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::camera::{self, print::Markers};
use crate::gelpad::rest::{Grain, RestShape};

/// The presets that are inside the binary: name and text of the sensor file.
pub const PRESETS: [(&str, &str); 4] = [
    ("gelsight-2014", include_str!("../../configs/sensors/gelsight-2014.toml")),
    ("gelsight-2017", include_str!("../../configs/sensors/gelsight-2017.toml")),
    ("gelsight-mini", include_str!("../../configs/sensors/gelsight-mini.toml")),
    ("digit", include_str!("../../configs/sensors/digit.toml")),
];

/// A sensor. What a sensor file leaves out is as in the preset it names, or as in `gelsight-2014`.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(default, deny_unknown_fields)]
pub struct Sensor {
    /// Preset to start from.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub preset: Option<String>,
    /// Sensor file to start from, relative to the file this stands in.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub file: Option<String>,
    /// Name written to the labels.
    pub name: String,
    /// Width and height of the image, px, 1 to 8192.
    pub resolution_px: [u32; 2],
    /// Width and height of the pad's window that the image shows, mm.
    pub field_of_view_mm: [f64; 2],
    /// Thickness of the gelpad over the rigid shell, mm.
    pub gelpad_thickness_mm: f64,
    /// Young's modulus of the gelpad, kPa.
    pub gelpad_youngs_modulus_kpa: f64,
    /// Poisson ratio of the gelpad, 0 to 0.4999.
    pub gelpad_poisson_ratio: f64,
    /// A real image of the untouched pad, relative to the file this stands in; without it the sensor renders its own.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub background: Option<String>,
    /// SHA-256 of the background file in lower-case hex; if given, another content is refused.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub background_sha256: Option<String>,
    /// The table that `gelsim calibrate` wrote, relative to the file this stands in: what the optics model `calibrated`
    /// knows of this sensor.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub calibration: Option<String>,
    /// SHA-256 of that file in lower-case hex; if given, another content is refused.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub calibration_sha256: Option<String>,
    /// Shape of a pad that is not flat.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub rest_shape: Option<RestShape>,
    /// Relief of the pad's coating.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub grain: Option<Grain>,
    /// Dots printed on the pad. A job's `[markers]` table overrides single keys of it.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub markers: Option<Markers>,
    /// The camera. A job's `[camera]` table overrides single keys of it.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub camera: Option<camera::Settings>,
    /// How the untouched pad looks where there is no `background`.
    pub rendered_background: RenderedBackground,
    /// The LEDs.
    pub led: Vec<Led>,
}

impl Default for Sensor {
    fn default() -> Self {
        let led = |name: &str, azimuth_deg, color, intensity| Led {
            name: name.to_owned(),
            azimuth_deg,
            color,
            intensity,
            ..Led::default()
        };
        Self {
            preset: None,
            file: None,
            name: String::from("gelsight-2014"),
            resolution_px: [640, 480],
            field_of_view_mm: [20.0, 15.0],
            gelpad_thickness_mm: 3.0,
            gelpad_youngs_modulus_kpa: 145.0,
            gelpad_poisson_ratio: 0.48,
            background: None,
            background_sha256: None,
            calibration: None,
            calibration_sha256: None,
            rest_shape: None,
            grain: None,
            markers: None,
            camera: None,
            rendered_background: RenderedBackground::default(),
            led: vec![
                led("white", 0.0, [1.0, 1.0, 1.0], 0.5),
                led("blue", 90.0, [0.15, 0.3, 1.0], 1.0),
                led("red", 180.0, [1.0, 0.2, 0.2], 1.0),
                led("green", 270.0, [0.15, 1.0, 0.35], 0.8),
            ],
        }
    }
}

/// An LED.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(default, deny_unknown_fields)]
pub struct Led {
    /// What messages and docs call it.
    pub name: String,
    /// Direction towards the LED in the image plane, degrees from +x (right) towards +y (down).
    pub azimuth_deg: f64,
    /// Angle of the LED over the pad's plane on the camera's side, degrees, 0 to 90.
    pub elevation_deg: f64,
    /// Angles under which the pad sees the LED or the row of LEDs, degrees, 0 to 90: width along the pad, height over it.
    /// They say how soft shadows are at their sides and at their ends.
    pub angular_size_deg: [f64; 2],
    /// Distance from the middle of the image, mm; used by the optics model `led`.
    pub distance_mm: f64,
    /// Red, green and blue share of the light, 0 to 1.
    pub color: [f64; 3],
    /// Brightness that a surface facing the LED gains, as a share of full scale before k_d and k_s; 0 or more.
    pub intensity: f64,
}

impl Default for Led {
    fn default() -> Self {
        // The paper's L rises by 0.15 over a horizontal length of 1.
        let elevation_deg = 8.530_765_609_948_133;
        Self {
            name: String::from("led"),
            azimuth_deg: 0.0,
            elevation_deg,
            angular_size_deg: [40.0, 10.0],
            distance_mm: 20.0,
            color: [1.0; 3],
            intensity: 1.0,
        }
    }
}

/// Parameters of the image that an untouched pad gives where no real one is at hand.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(default, deny_unknown_fields)]
pub struct RenderedBackground {
    /// Red, green and blue of the diffuse light in the pad's middle, 0 to 1.
    pub color: [f64; 3],
    /// Brightness that each LED adds at its edge of the image, times its colour and intensity.
    pub glow: f64,
    /// Distance over which that brightness falls to 37 %, mm.
    pub glow_reach_mm: f64,
    /// Share of the light that is lost in the image's corners, 0 to 1.
    pub vignette: f64,
    /// Standard deviation of the coating's grain, as a share of full scale.
    pub grain: f64,
    /// Size of the grain, mm.
    pub grain_size_mm: f64,
}

impl Default for RenderedBackground {
    fn default() -> Self {
        Self {
            color: [0.46, 0.44, 0.48],
            glow: 0.28,
            glow_reach_mm: 5.0,
            vignette: 0.22,
            grain: 0.006,
            grain_size_mm: 0.12,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_first_preset_file_says_what_the_defaults_are() {
        let read: Sensor = toml::from_str(PRESETS[0].1).expect("the preset is a sensor");
        assert_eq!(read, Sensor::default());
        let keys: toml::Table = toml::from_str(PRESETS[0].1).expect("the preset is TOML");
        let all = toml::Table::try_from(Sensor::default()).expect("a sensor is a table");
        assert!(all.keys().eq(keys.keys()), "every key is written out: {:?} against {:?}", all, keys);
    }
}
