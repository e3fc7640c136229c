//! The part of a label about the sensor.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::plan::Plan;
use crate::scene::Scene;
use gelsim_core::base::view::View;
use gelsim_core::optics::led::{Led, LedPlace};
use gelsim_core::sensor::{Background, Sensor};
use gelsim_core::simulator::Simulator;

/// The sensor.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct SensorLabel {
    /// Its name.
    pub name: String,
    /// Columns of every layer, px.
    pub width_px: u32,
    /// Rows of every layer, px.
    pub height_px: u32,
    /// Distance between pixel centres along x and y, mm.
    pub mm_per_px: [f64; 2],
    /// Thickness of the gelpad, mm.
    pub gelpad_thickness_mm: f64,
    /// Young's modulus of the gelpad, kPa.
    pub gelpad_youngs_modulus_kpa: f64,
    /// Poisson ratio of the gelpad.
    pub gelpad_poisson_ratio: f64,
    /// Fraction of the light that is lost where the pad is pressed down to the shell.
    pub darkening: f64,
    /// Red, green and blue light of the untouched pad that does not come from the LEDs; empty if the LEDs' light is not
    /// scaled by the background.
    pub stray_light: Vec<f64>,
    /// The LEDs, in the order of the sensor.
    pub leds: Vec<LedLabel>,
    /// Distance of the window, mm, in which the pad sees the LEDs a second time, and its refractive index; empty if
    /// there is none.
    #[serde(default)]
    pub window: Vec<f64>,
    /// Share of the light that the coat scatters.
    #[serde(default)]
    pub albedo: f64,
    /// The image of the untouched pad.
    pub background: BackgroundLabel,
}

/// An LED of the sensor.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct LedLabel {
    /// Its name.
    pub name: String,
    /// Direction towards the LED, degrees from +x towards +y.
    pub azimuth_deg: f64,
    /// Angle of the LED over the pad's plane, degrees.
    pub elevation_deg: f64,
    /// Width and height of the LED as the pad sees it, degrees.
    pub angular_size_deg: [f64; 2],
    /// Distance from the middle of the image, mm.
    pub distance_mm: f64,
    /// Where it is, mm; empty if azimuth, elevation and distance say it.
    #[serde(default)]
    pub position_mm: Vec<f64>,
    /// Width and height, mm; empty if they follow from `angular_size_deg`.
    #[serde(default)]
    pub size_mm: Vec<f64>,
    /// Exponent of the cosine with which its light falls off about the direction to the middle of the image.
    #[serde(default)]
    pub lobe: f64,
    /// Red, green and blue of its light.
    pub color: [f64; 3],
    /// Brightness.
    pub intensity: f64,
    /// Factors on the colour over the pad: six coefficients of red, then of green, then of blue; empty if there are
    /// none.
    #[serde(default)]
    pub pattern: Vec<f64>,
}

/// The image of the untouched pad: a file, or the numbers from which it is rendered.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct BackgroundLabel {
    /// Name of its file; empty if it is rendered.
    pub file: String,
    /// SHA-256 of that file in lower-case hex; empty if it is rendered.
    pub sha256: String,
    /// Red, green and blue of the diffuse light. This and the following numbers are 0 if the image is a file or shows
    /// the light of the sensor's lamps.
    pub color: [f64; 3],
    /// Brightness that each LED adds at its edge of the image.
    pub glow: f64,
    /// Distance over which the glow falls to 37 %, mm.
    pub glow_reach_mm: f64,
    /// Fraction of the light that is lost in the corners.
    pub vignette: f64,
    /// Standard deviation of the coating's grain.
    pub grain: f64,
    /// Size of the grain, mm.
    pub grain_size_mm: f64,
    /// Specks of dust per cm^2.
    pub dust_per_cm2: f64,
    /// Size of the specks, mm.
    pub dust_size_mm: f64,
    /// The 15 coefficients of red, then of green, then of blue by which the colour varies over the pad; empty if it
    /// does not vary.
    pub pattern: Vec<f64>,
}

impl SensorLabel {
    pub(super) fn from_scene(plan: &Plan, scene: &Scene, simulator: &Simulator) -> Self {
        let (sensor, View { resolution_px: [width, height], mm_per_px }) = (simulator.sensor(), *simulator.view());
        Self {
            name: sensor.name.clone(),
            width_px: width as u32,
            height_px: height as u32,
            mm_per_px,
            gelpad_thickness_mm: sensor.gelpad.thickness_mm,
            gelpad_youngs_modulus_kpa: sensor.gelpad.youngs_modulus_kpa,
            gelpad_poisson_ratio: sensor.gelpad.poisson_ratio,
            darkening: sensor.darkening,
            stray_light: sensor.stray_light.iter().flatten().copied().collect(),
            leds: sensor.leds.iter().map(LedLabel::new).collect(),
            window: sensor.window.map_or_else(Vec::new, |own| vec![own.distance_mm, own.refractive_index]),
            albedo: sensor.coat.albedo,
            background: BackgroundLabel::from_scene(plan, scene, sensor),
        }
    }
}

impl LedLabel {
    fn new(led: &Led) -> Self {
        let [azimuth_deg, elevation_deg, distance_mm] = match led.position_mm {
            None => [led.azimuth_deg, led.elevation_deg, led.distance_mm],
            // Only its position says where it is.
            Some(_) => {
                let LedPlace { direction, azimuth: (sin, cos), distance_mm } = led.place();
                let elevation = libm::asin((-direction[2]).clamp(-1.0, 1.0));
                [libm::atan2(sin, cos).to_degrees(), elevation.to_degrees(), distance_mm]
            }
        };
        let led = led.clone();
        Self {
            name: led.name,
            azimuth_deg,
            elevation_deg,
            angular_size_deg: led.angular_size_deg,
            distance_mm,
            position_mm: led.position_mm.iter().flatten().copied().collect(),
            size_mm: led.size_mm.iter().flatten().copied().collect(),
            lobe: led.lobe,
            color: led.color,
            intensity: led.intensity,
            pattern: led.pattern.iter().flat_map(|pattern| pattern.all_terms()).flatten().collect(),
        }
    }
}

impl BackgroundLabel {
    fn from_scene(plan: &Plan, scene: &Scene, sensor: &Sensor) -> Self {
        let number = scene.sensor.as_ref().map_or(0, |drawn| drawn.photograph);
        let photograph = plan.sensors.photographs.get(number);
        let (file, sha256) = photograph.map_or_else(Default::default, |own| (own.file.clone(), own.sha256.clone()));
        match &sensor.background {
            Background::Rendered(look) if sensor.lamps.is_empty() => Self {
                file,
                sha256,
                color: look.color,
                glow: look.glow,
                glow_reach_mm: look.glow_reach_mm,
                vignette: look.vignette,
                grain: look.grain,
                grain_size_mm: look.grain_size_mm,
                dust_per_cm2: look.dust_per_cm2,
                dust_size_mm: look.dust_size_mm,
                pattern: look.pattern.iter().flat_map(|own| [own.red, own.green, own.blue]).flatten().collect(),
            },
            // The image is a photograph, or is made of the lamps' light.
            _ => Self {
                file,
                sha256,
                color: [0.0; 3],
                glow: 0.0,
                glow_reach_mm: 0.0,
                vignette: 0.0,
                grain: 0.0,
                grain_size_mm: 0.0,
                dust_per_cm2: 0.0,
                dust_size_mm: 0.0,
                pattern: Vec::new(),
            },
        }
    }
}
