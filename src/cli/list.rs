//! `gelsim list`

use clap::{Args, ValueEnum};

use super::Failure;
use crate::config::sensor::{PRESETS, Sensor};
use crate::fidelity::Rung;

/// Effects, with what calls for them.
pub const EFFECTS: [(&str, &str); 3] = [
    ("deformation", "the pad's shape under and around the object; runs where the object reaches into the pad"),
    ("shading", "light of the LEDs on the deformed surface; runs where the surface is not flat"),
    ("darkening", "loss of light with depth; runs where the surface is pressed in and the optics model has it"),
];

/// The meshes in the project's `objects` folder.
pub const OBJECTS: [&str; 27] = [
    "bolt", "brick", "coin", "cone", "crossed_ridges", "cube", "cylinder", "cylinder_shell", "dots", "flat_face",
    "gear", "grating", "hexagon_nut", "key", "knurl", "letter", "parallel_ridges", "phillips_screw", "prism_corner",
    "prism_edge", "rope", "socket_screw", "sphere", "thin_ridge", "torus", "washer", "wave",
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
    /// Rungs of the accuracy ladder and what they choose
    Rungs,
    /// Effects and what calls for them
    Effects,
    /// Meshes in the project's `objects` folder
    Objects,
}

impl List {
    pub(super) fn run(self) -> Result<(), Failure> {
        match self.what {
            What::Sensors => {
                for (name, text) in PRESETS {
                    let sensor: Sensor = toml::from_str(text).map_err(|error| Failure::running(error.to_string()))?;
                    let ([w, h], [x, y]) = (sensor.resolution_px, sensor.field_of_view_mm);
                    println!(
                        "{name:<14} {w}x{h} px, {x} x {y} mm, gelpad {} mm {} kPa nu {}, {} LEDs",
                        sensor.gelpad_thickness_mm,
                        sensor.gelpad_youngs_modulus_kpa,
                        sensor.gelpad_poisson_ratio,
                        sensor.led.len(),
                    );
                }
            }
            What::Rungs => {
                for rung in Rung::ALL {
                    let choices = rung.choices();
                    let inline = |value: Result<serde_json::Value, _>| value.map(|v| v.to_string());
                    let values = (inline(serde_json::to_value(&choices.gelpad)), inline(serde_json::to_value(&choices.optics)));
                    let (Ok(gelpad), Ok(optics)) = values else { continue };
                    println!("{:<10} gelpad {gelpad}\n{:<10} optics {optics}", rung.name(), "");
                }
            }
            What::Effects => EFFECTS.iter().for_each(|(name, what)| println!("{name:<12} {what}")),
            What::Objects => OBJECTS.iter().for_each(|name| println!("objects/{name}.obj")),
        }
        Ok(())
    }
}
