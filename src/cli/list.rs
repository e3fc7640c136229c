//! `gelsim list`

use clap::{Args, ValueEnum};

use super::{Failure, print};
use crate::core::base::gel::{GelCapsule, GelDome};
use crate::core::effects::Effect;
use crate::core::fidelity::Fidelity;
use crate::core::optics::LightSource;
use crate::files::sensor::shape::SensorShape;
use crate::files::sensor::{PRESETS, Sensor};

/// The meshes in the project's `objects` folder.
pub const OBJECTS: [&str; 29] = [
    "bolt",
    "brick",
    "coin",
    "cone",
    "crossed_ridges",
    "cube",
    "cylinder",
    "cylinder_shell",
    "dots",
    "edge_slab",
    "flat_face",
    "gear",
    "grating",
    "hexagon_nut",
    "key",
    "knurl",
    "letter",
    "parallel_ridges",
    "phillips_screw",
    "prism_corner",
    "prism_edge",
    "rope",
    "slab",
    "socket_screw",
    "sphere",
    "thin_ridge",
    "torus",
    "washer",
    "wave",
];

/// List what can be chosen.
#[derive(Debug, Args)]
#[command(after_help = "Example:\n  gelsim list sensors")]
pub struct List {
    /// What to list
    what: What,
}

#[derive(Clone, Copy, Debug, ValueEnum)]
enum What {
    /// Sensor presets with their main values
    Sensors,
    /// Fidelity levels and what they choose
    #[value(name = "rungs")]
    Levels,
    /// Effects and what calls for them
    Effects,
    /// Meshes in the project's `objects` folder
    Objects,
}

impl List {
    pub(super) fn run(self) -> Result<(), Failure> {
        let lines: Vec<String> = match self.what {
            What::Sensors => {
                let line = |(name, text)| {
                    let sensor: Sensor = toml::from_str(text).map_err(|error| Failure::running(error.to_string()))?;
                    let ([w, h], [x, y]) = (sensor.resolution_px, sensor.field_of_view_mm);
                    let size = match &sensor.shape {
                        None => format!("{x} x {y} mm"),
                        Some(SensorShape::Dome(GelDome { radius_mm })) => format!("dome of radius {radius_mm} mm"),
                        Some(SensorShape::Capsule(GelCapsule { radius_mm, length_mm })) => {
                            format!("finger of radius {radius_mm} mm, {length_mm} mm long")
                        }
                        Some(SensorShape::Mesh(mesh)) => format!("shaped as {}", mesh.path),
                    };
                    let lights = match (&sensor.pins, sensor.lamp.len()) {
                        (Some(pins), _) => format!("{} pins", pins.pins().at_mm.len()),
                        (None, 0) => format!("{} LEDs", sensor.led.len()),
                        (None, lamps) => format!("{lamps} lamps"),
                    };
                    Ok(format!(
                        "{name:<16} {w}x{h} px, {size}, gelpad {} mm {} kPa nu {}, {lights}",
                        sensor.gelpad_thickness_mm, sensor.gelpad_youngs_modulus_kpa, sensor.gelpad_poisson_ratio,
                    ))
                };
                PRESETS.into_iter().map(line).collect::<Result<_, Failure>>()?
            }
            What::Levels => {
                let line = |level: Fidelity| {
                    let (choices, measured) = (level.models(LightSource::Leds), level.models(LightSource::Calibration));
                    let failed = |error: serde_json::Error| Failure::running(error.to_string());
                    let gelpad = serde_json::to_string(&choices.gelpad).map_err(failed)?;
                    let optics = serde_json::to_string(&choices.optics).map_err(failed)?;
                    let measured = serde_json::to_string(&measured.optics).map_err(failed)?;
                    Ok(format!(
                        "{:<10} gelpad {gelpad}\n{:<10} optics {optics}, {measured} where measured",
                        level.name(),
                        ""
                    ))
                };
                Fidelity::ALL.into_iter().map(line).collect::<Result<_, Failure>>()?
            }
            What::Effects => {
                Effect::ALL.into_iter().map(|effect| format!("{:<13} {}", effect.name(), effect.summary())).collect()
            }
            What::Objects => OBJECTS.iter().map(|name| format!("objects/{name}.obj")).collect(),
        };
        print(&(lines.join("\n") + "\n"))
    }
}
