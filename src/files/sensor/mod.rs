//! Sensor files and `[sensor]` tables: camera window, gelpad, LEDs, the look of the untouched pad, and the presets.

pub mod camera;
pub mod markers;
pub mod pins;
pub mod quantity;
pub mod random;
pub mod shape;
pub mod unit;

use std::sync::Arc;

use camera::CameraDistribution;
use gelsim_core::base::gel::GelShape;
use gelsim_core::camera::projection::LensModel;
use gelsim_core::gelpad::material::Material;
use gelsim_core::optics::{Illumination, LightSource};
use gelsim_core::sensor::{self, Background, Markers};
use markers::MarkerDistribution;
use pins::PinDistribution;
use serde::{Deserialize, Serialize};
use shape::SensorShape;
use unit::UnitVariation;

use gelsim_core::depth::rest_surface::Grain;
use gelsim_core::gelpad::elastic::relaxation::RelaxationMode;
use gelsim_core::optics::background::RenderedBackground;
use gelsim_core::optics::lamps::Lamp;
use gelsim_core::optics::led::Led;
use gelsim_core::optics::near_light::bounce::Coat;
use gelsim_core::optics::near_light::window::Window;
use gelsim_core::optics::residual::LightResidual;

macro_rules! presets {
    ($($name:literal),* $(,)?) => {
        /// The presets in the binary: names and texts of their sensor files.
        pub const PRESETS: [(&str, &str); [$($name),*].len()] =
            [$(($name, include_str!(concat!("../presets/", $name, ".toml")))),*];
    };
}

// The files in `configs/sensors`, the default first. `presets` is a link to that folder, so that they are in the published crate.
presets! {
    "gelsight-2014", "gelsight-2017", "gelsight-mini", "digit", "gelsight-series2", "tactip", "geltip", "allsight",
}

/// A sensor. What a sensor file leaves out is as in the preset it names, or as in `gelsight-2014`.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "formats", derive(schemars::JsonSchema))]
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
    /// How the gelpad relaxes in sequences; none by default.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub gelpad_relaxation: Vec<RelaxationMode>,
    /// Coefficient of friction of the gelpad, 0 to 10: the default of `[sequence] friction`.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub gelpad_friction_coefficient: Option<f64>,
    /// A real image of the untouched pad, relative to the file this stands in; without it the sensor renders its own.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub background: Option<String>,
    /// SHA-256 of the background file in lower-case hex; if given, another content is refused.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub background_sha256: Option<String>,
    /// The table that `gelsim calibrate` wrote, relative to the file this stands in. The optics model `calibrated`
    /// needs it.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub calibration: Option<String>,
    /// SHA-256 of the calibration file in lower-case hex; if given, another content is refused.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub calibration_sha256: Option<String>,
    /// Shape of a gel that a camera inside sees through `lens`. Without it the gel is flat, or nearly (`rest_shape`).
    #[serde(skip_serializing_if = "Option::is_none")]
    pub shape: Option<SensorShape>,
    /// Lens and place of the camera, for a sensor with a `shape`. Without it the camera looks from straight below,
    /// without perspective.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub lens: Option<LensModel>,
    /// Pins inside a gel that has a `shape`.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub pins: Option<PinDistribution>,
    /// Height of a pad that is nearly flat.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub rest_shape: Option<RestShape>,
    /// Relief of the pad's coating.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub grain: Option<Grain>,
    /// Dots printed on the pad. A job's `[markers]` table overrides single keys of it.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub markers: Option<MarkerDistribution>,
    /// The camera. A job's `[camera]` table overrides single keys of it.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub camera: Option<CameraDistribution>,
    /// Fraction of the light that is lost where the pad is pressed down to the shell, 0 to 1. A job's
    /// `optics.phong.darkening` overrides it.
    pub darkening: f64,
    /// Red, green and blue light of the untouched pad that does not come from the LEDs, 0 to 1. A change of LED light
    /// is scaled, pixel by pixel, by the rest of the background image. Without this key it is not scaled.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub stray_light: Option<[f64; 3]>,
    /// Light that the LEDs leave unexplained, as presses of a ball show it.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub light_residual: Option<Box<LightResidual>>,
    /// The window between gel and air. In it the pad sees the LEDs a second time; used by the optics model `led`.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub window: Option<Window>,
    /// Reflection of the coat; used by the optics model `led`.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub coat: Option<Coat>,
    /// Look of the untouched pad if there is no `background`. Not used with lamps, which show it.
    pub rendered_background: RenderedBackground,
    /// The LEDs.
    pub led: Vec<Led>,
    /// Lamps whose light was measured one by one, none or six. The optics model `lamps` needs them.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub lamp: Vec<Lamp>,
    /// How much units of this kind of sensor differ, and how much of that is drawn.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub unit: Option<UnitVariation>,
}

impl Sensor {
    /// Returns the material of the gelpad.
    pub fn gelpad_material(&self) -> Material {
        Material {
            thickness_mm: self.gelpad_thickness_mm,
            youngs_modulus_kpa: self.gelpad_youngs_modulus_kpa,
            poisson_ratio: self.gelpad_poisson_ratio,
        }
    }

    /// Converts to the sensor of the simulator, with these markers and this camera. What is in files is left out.
    pub fn to_simulator_sensor(
        &self,
        markers: Option<&MarkerDistribution>,
        camera: &CameraDistribution,
    ) -> sensor::Sensor {
        let resolution_px = self.resolution_px.map(|px| px as usize);
        let mut sensor = sensor::Sensor::new(&self.name, resolution_px, self.field_of_view_mm, self.gelpad_material());
        sensor.relaxation = self.gelpad_relaxation.clone();
        sensor.shape = self.gel_shape();
        sensor.lens = self.lens.unwrap_or_default();
        sensor.pins = self.pins.as_ref().map(PinDistribution::to_pins);
        sensor.coating = self.grain;
        sensor.background = Background::Rendered(self.rendered_background.clone());
        sensor.leds = self.led.clone();
        sensor.lamps = self.lamp.clone();
        sensor.darkening = self.darkening;
        sensor.stray_light = self.stray_light;
        sensor.light_residual = self.light_residual.as_deref().cloned().map(Arc::new);
        sensor.window = self.window;
        sensor.coat = self.coat.unwrap_or_default();
        sensor.markers =
            markers.map(|markers| Markers { print: markers.to_marker_print(), pattern: markers.constant_pattern() });
        sensor.camera = camera.background_params();
        sensor
    }

    /// Returns the shape of the gel, or `None` for a flat gel or for a mesh that was not read.
    pub fn gel_shape(&self) -> Option<GelShape> {
        self.shape.as_ref().and_then(SensorShape::to_gel_shape)
    }

    /// Returns what is known of the sensor's light: calibrated, six lamps, or LEDs only.
    pub fn light_source(&self) -> LightSource {
        LightSource::new(self.calibration.is_some(), &self.lamp)
    }

    /// Returns the sensor's light, without the background image.
    pub fn illumination(&self) -> Illumination<'_> {
        Illumination {
            leds: &self.led,
            lamps: &self.lamp,
            field_of_view_mm: self.field_of_view_mm,
            thickness_mm: self.gelpad_thickness_mm,
            is_photograph: self.background.is_some(),
            darkening: self.darkening,
            stray_light: self.stray_light,
            residual: self.light_residual.as_deref(),
            window: self.window.as_ref(),
            coat: self.coat.unwrap_or_default(),
        }
    }
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
            gelpad_relaxation: Vec::new(),
            gelpad_friction_coefficient: None,
            background: None,
            background_sha256: None,
            calibration: None,
            calibration_sha256: None,
            shape: None,
            lens: None,
            pins: None,
            rest_shape: None,
            grain: None,
            markers: None,
            camera: None,
            darkening: 0.35,
            stray_light: None,
            light_residual: None,
            window: None,
            coat: None,
            rendered_background: RenderedBackground::default(),
            led: vec![
                led("white", 0.0, [1.0, 1.0, 1.0], 0.5),
                led("blue", 90.0, [0.15, 0.3, 1.0], 1.0),
                led("red", 180.0, [1.0, 0.2, 0.2], 1.0),
                led("green", 270.0, [0.15, 1.0, 0.35], 0.8),
            ],
            lamp: Vec::new(),
            unit: None,
        }
    }
}

/// Height of a pad that is nearly flat.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "formats", derive(schemars::JsonSchema))]
#[serde(rename_all = "snake_case")]
pub enum RestShape {
    /// Part of a ball, highest in the middle of the image.
    Dome(Dome),
    /// An image of heights, stretched over the view: white is highest.
    HeightMap(HeightMap),
}

/// See [`RestShape::Dome`].
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "formats", derive(schemars::JsonSchema))]
#[serde(deny_unknown_fields)]
pub struct Dome {
    /// Radius of the ball, mm, at least half the view's diagonal.
    pub radius_mm: f64,
}

/// See [`RestShape::HeightMap`].
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "formats", derive(schemars::JsonSchema))]
#[serde(deny_unknown_fields)]
pub struct HeightMap {
    /// Grey PNG of 8 or 16 bits, two-dimensional npy array or EXR picture of one channel, relative to the file this stands
    /// in. Floats are from 0 to 1.
    pub path: String,
    /// Height of white over black, or of 1 over 0, mm.
    pub height_mm: f64,
    /// SHA-256 of the file in lower-case hex; if given, another content is refused.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub sha256: Option<String>,
}

/// The error for a name that no preset has.
#[derive(Clone, PartialEq, Eq, thiserror::Error)]
#[error("no sensor preset is called `{name}`; there are {}", PRESETS.map(|(name, _)| name).join(", "))]
pub struct UnknownPreset {
    /// The name that was asked for.
    pub name: String,
}

/// Writes the message: `main` and `expect` show errors by `Debug`.
impl std::fmt::Debug for UnknownPreset {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        std::fmt::Display::fmt(self, f)
    }
}

/// Reads the sensor file of a preset by a name of [`PRESETS`]. Returns `None` for any other name.
pub fn read_preset(name: &str) -> Option<Sensor> {
    let (_, text) = PRESETS.iter().find(|(known, _)| *known == name)?;
    Some(toml::from_str(text).expect("presets are sensors and name no file: a test reads them all"))
}

/// Loads a preset by a name of [`PRESETS`].
///
/// # Errors
///
/// If no preset has this name. The message lists all names.
pub fn load_preset(name: &str) -> Result<sensor::Sensor, UnknownPreset> {
    let written = read_preset(name).ok_or_else(|| UnknownPreset { name: name.to_owned() })?;
    let camera = written.camera.clone().unwrap_or_default();
    Ok(written.to_simulator_sensor(written.markers.as_ref(), &camera))
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

    #[test]
    fn every_preset_can_be_simulated_and_names_no_file() {
        for (name, text) in PRESETS {
            let written: Sensor = toml::from_str(text).expect("a sensor");
            assert!(written.background.is_none() && written.calibration.is_none() && written.rest_shape.is_none());
            let sensor = load_preset(name).expect("it is there");
            assert_eq!((sensor.name.as_str(), sensor.check()), (name, Ok(())));
        }
        let error = load_preset("digits").expect_err("no such sensor");
        assert!(error.to_string().contains("gelsight-mini, digit, gelsight-series2"), "{error}");
    }
}
