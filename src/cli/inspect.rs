//! `gelsim inspect`

use std::path::PathBuf;

use clap::Args;
use clap::builder::PossibleValuesParser;

use super::{Failure, print};
use crate::dataset::encode::json;
use crate::files::figures::counted;
use crate::files::sensor::PRESETS;
use crate::job::config::object::Unit;
use crate::lab::inspect::findings::Severity;
use crate::lab::inspect::{InspectReport, Inspection, SensorPad, inspect, text};

/// Say what meshes are like and what a sensor would see of them: size and likely unit, holes and other flaws, each of
/// the six sides against view and pad. Ends with status 1 if a mesh has an error.
#[derive(Debug, Args)]
#[command(after_help = "\
Example:
  gelsim inspect objects/*.obj
  gelsim inspect mug.stl --unit m --sensor digit
  gelsim inspect mug.stl --json")]
pub struct Inspect {
    /// The meshes: .obj, .stl, .ply, .off, .glb, .gltf, .dae, .3mf or .urdf
    #[arg(value_name = "MESH", required = true)]
    meshes: Vec<PathBuf>,
    /// Unit of their coordinates, if not the one that the file says, or mm
    #[arg(long, value_enum)]
    unit: Option<Unit>,
    /// Preset of the sensor that they are held against
    #[arg(long, value_name = "PRESET", default_value = PRESETS[0].0, value_parser = presets())]
    sensor: String,
    /// Print JSON instead of text
    #[arg(long)]
    json: bool,
    /// End with status 1 if a mesh has a warning, too
    #[arg(long)]
    strict: bool,
}

fn presets() -> PossibleValuesParser {
    PossibleValuesParser::new(PRESETS.map(|(name, _)| name))
}

impl Inspect {
    pub(super) fn run(self) -> Result<(), Failure> {
        let failed = || Failure::running(format!("the preset {} cannot be read", self.sensor));
        let pad = SensorPad::preset(&self.sensor).ok_or_else(failed)?;
        let mut meshes = Vec::with_capacity(self.meshes.len());
        if !self.json {
            print(&text::heading(&pad))?;
        }
        for path in &self.meshes {
            let inspection = inspect(path, self.unit, &pad);
            if !self.json {
                print(&text::block(&inspection, &pad))?;
            }
            meshes.push(inspection);
        }
        let verdict = self.verdict(&meshes);
        if self.json {
            let text = json(&InspectReport { pad, meshes });
            print(&(String::from_utf8_lossy(&text) + "\n"))?;
        } else if meshes.len() > 1 {
            print(&text::summary(&meshes))?;
        }
        verdict
    }

    fn verdict(&self, meshes: &[Inspection]) -> Result<(), Failure> {
        let (bearable, what) = match self.strict {
            true => (Severity::Note, "errors or warnings"),
            false => (Severity::Warning, "errors"),
        };
        let bad = meshes.iter().filter(|mesh| mesh.severity > bearable).count();
        match bad {
            0 => Ok(()),
            _ => Err(Failure::running(format!("{what} in {bad} of {}", counted(meshes.len(), "mesh", "meshes")))),
        }
    }
}
