//! `gelsim list`: lists presets, fidelity levels, effects, layers and meshes.

use clap::{Args, ValueEnum};
use serde_json::{Value, json};

use super::{Failure, print_file, print_result};
use gelsim_core::base::gel::{GelCapsule, GelDome};
use gelsim_core::effects::Effect;
use gelsim_core::fidelity::Fidelity;
use gelsim_core::optics::LightSource;
use gelsim_files::sensor::shape::SensorShape;
use gelsim_files::sensor::{PRESETS, Sensor, read_preset};
use gelsim_job::layers::OutputLayer;

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
#[command(after_help = "\
Example:
  gelsim list sensors
  gelsim list levels --json")]
pub struct List {
    /// What to list
    what: What,
    /// Print JSON instead of text
    #[arg(long)]
    json: bool,
}

#[derive(Clone, Copy, Debug, ValueEnum)]
enum What {
    /// Sensor presets with their main values
    Sensors,
    /// Fidelity levels and the models that they use
    #[value(alias = "rungs")]
    Levels,
    /// Effects and what enables them
    Effects,
    /// Layers that a sample may have besides its tactile image
    Layers,
    /// Meshes in the project's `objects` folder
    Objects,
}

/// One item of a list: a line of text, and a JSON value.
type ListRow = (String, Value);

impl List {
    pub(super) fn run(self) -> Result<(), Failure> {
        let rows = match self.what {
            What::Sensors => {
                let row = |name| read_preset(name).map(|sensor| sensor_row(name, &sensor));
                PRESETS.into_iter().filter_map(|(name, _)| row(name)).collect()
            }
            What::Levels => Fidelity::ALL.into_iter().map(fidelity_row).collect::<Result<Vec<ListRow>, Failure>>()?,
            What::Effects => {
                Effect::ALL.into_iter().map(|effect| format_row(13, effect.name(), effect.summary())).collect()
            }
            What::Layers => OutputLayer::ALL.into_iter().map(layer_row).collect(),
            What::Objects => OBJECTS
                .iter()
                .map(|name| format!("objects/{name}.obj"))
                .map(|path| (path.clone(), json!({ "path": path })))
                .collect(),
        };
        let (lines, values): (Vec<String>, Vec<Value>) = rows.into_iter().unzip();
        if self.json {
            print_file(&format!("{:#}\n", Value::Array(values)))
        } else {
            print_result(&(lines.join("\n") + "\n"))
        }
    }
}

fn format_row(width: usize, name: &str, summary: &str) -> ListRow {
    (format!("{name:<width$}  {summary}"), json!({ "name": name, "summary": summary }))
}

fn sensor_row(name: &str, sensor: &Sensor) -> ListRow {
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
        (Some(pins), _) => format!("{} pins", pins.to_pins().at_mm.len()),
        (None, 0) => format!("{} LEDs", sensor.led.len()),
        (None, lamps) => format!("{lamps} lamps"),
    };
    let line = format!(
        "{name:<16}  {w}x{h} px, {size}, gelpad {} mm {} kPa nu {}, {lights}",
        sensor.gelpad_thickness_mm, sensor.gelpad_youngs_modulus_kpa, sensor.gelpad_poisson_ratio,
    );
    let value = json!({
        "name": name,
        "resolution_px": [w, h],
        "field_of_view_mm": sensor.shape.is_none().then_some([x, y]),
        "shape": sensor.shape.is_some().then_some(&size),
        "gelpad_thickness_mm": sensor.gelpad_thickness_mm,
        "gelpad_youngs_modulus_kpa": sensor.gelpad_youngs_modulus_kpa,
        "gelpad_poisson_ratio": sensor.gelpad_poisson_ratio,
        "lights": lights,
    });
    (line, value)
}

fn fidelity_row(level: Fidelity) -> Result<ListRow, Failure> {
    let failed = |error: serde_json::Error| Failure::runtime(error.to_string());
    let (led, calibrated) = (level.models(LightSource::Leds), level.models(LightSource::Calibration));
    let gelpad = serde_json::to_value(&led.gelpad).map_err(failed)?;
    let optics = serde_json::to_value(&led.optics).map_err(failed)?;
    let with_calibration = serde_json::to_value(&calibrated.optics).map_err(failed)?;
    let name = level.name();
    let line = format!(
        "{name:<13}  {}\n{:<13}  gelpad: {}\n{:<13}  optics: {}; with a calibration, {}",
        level.summary(),
        "",
        describe_value(&gelpad),
        "",
        describe_value(&optics),
        describe_value(&with_calibration),
    );
    let value = json!({ "name": name, "summary": level.summary(), "gelpad": gelpad, "optics": optics, "optics_where_measured": with_calibration });
    Ok((line, value))
}

/// Formats a model and its parameters: `elastic, resolution half, tolerance_um 1`.
fn describe_value(value: &Value) -> String {
    match value {
        Value::Object(fields) => {
            let fields = fields.iter().filter(|(_, value)| !value.is_null());
            let words = fields.map(|(name, value)| match value {
                Value::Object(inner) if inner.is_empty() => name.clone(),
                Value::Object(inner) if inner.len() > 1 => format!("{name} ({})", describe_value(value)),
                value => format!("{name} {}", describe_value(value)),
            });
            words.collect::<Vec<_>>().join(", ")
        }
        Value::Array(items) => items.iter().map(describe_value).collect::<Vec<_>>().join(" "),
        Value::String(text) => text.clone(),
        value => value.to_string(),
    }
}

fn layer_row(layer: OutputLayer) -> ListRow {
    let (unit, meaning) = (layer.spec().unit, layer.spec().meaning);
    let line = match unit {
        Some(unit) => format!("{:<10}  {meaning}, {unit}", layer.name()),
        None => format!("{:<10}  {meaning}", layer.name()),
    };
    (line, json!({ "name": layer.name(), "unit": unit, "meaning": meaning }))
}
