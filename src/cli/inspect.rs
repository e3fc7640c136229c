//! `gelsim inspect`

use std::path::PathBuf;

use clap::Args;
use clap::builder::{PossibleValuesParser, TypedValueParser};

use super::progress::bar::Bar;
use super::terminal::columns;
use super::{Failure, print, terminal};
use gelsim_dataset::encode::json;
use gelsim_files::diagnostic::Severity;
use gelsim_files::diagnostic::user_error;
use gelsim_files::figures::counted;
use gelsim_files::mesh::{ENDINGS, Reading, UrdfShapes};
use gelsim_files::sensor::PRESETS;
use gelsim_job::config::object::Unit;
use gelsim_job::inspection::SensorPad;
use gelsim_lab::inspect::{InspectReport, Inspection, inspect, inspect_set, set, text};

/// Say what meshes are like and what a sensor would see of them: size and likely unit, holes and other flaws, each of
/// the six sides against view and pad. Ends with status 1 if a mesh has an error.
#[derive(Debug, Args)]
#[command(after_help = "\
Example:
  gelsim inspect objects/*.obj
  gelsim inspect mug.stl --unit m --sensor digit
  gelsim inspect meshes/
  gelsim inspect mug.stl --json")]
pub struct Inspect {
    /// The meshes, or folders of them, of which there is a table: .obj, .stl, .ply, .off, .glb, .gltf, .dae, .3mf or .urdf
    #[arg(value_name = "MESH", required = true)]
    meshes: Vec<PathBuf>,
    /// Unit of their coordinates, if not the one that the file says, or mm
    #[arg(long, value_parser = crate::unit_of_length())]
    unit: Option<Unit>,
    /// Folders of packages in which the meshes of a robot may be (.urdf), beside those around it and of ROS_PACKAGE_PATH
    #[arg(long, value_name = "DIR", num_args = 1..)]
    packages: Vec<String>,
    /// Which shapes of a robot's links are meant
    #[arg(long, value_name = "SHAPES", default_value = "visual", value_parser = shapes())]
    urdf: UrdfShapes,
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

/// The names of sensors that are built in.
pub(super) fn presets() -> PossibleValuesParser {
    PossibleValuesParser::new(PRESETS.map(|(name, _)| name))
}

/// The names of the shapes of links.
fn shapes() -> impl TypedValueParser<Value = UrdfShapes> {
    PossibleValuesParser::new(UrdfShapes::ALL.map(UrdfShapes::name))
        .map(|name| UrdfShapes::ALL.into_iter().find(|shapes| shapes.name() == name).unwrap_or_default())
}

impl Inspect {
    fn reading(&self) -> Reading<'_> {
        Reading { mm_per_unit: self.unit.map(Unit::mm), urdf: self.urdf, packages: &self.packages }
    }

    pub(super) fn run(self) -> Result<(), Failure> {
        let failed = || Failure::running(format!("the preset {} cannot be read", self.sensor));
        let pad = SensorPad::preset(&self.sensor).ok_or_else(failed)?;
        let mut paths = Vec::new();
        let mut is_set = false;
        for path in &self.meshes {
            let (found, several) = set::meshes(path).map_err(|error| Failure::running(error.to_string()))?;
            if found.is_empty() {
                let message = format!("there is no mesh in {}", path.display());
                return Err(user_error(message, format!("meshes are files that end in {ENDINGS}")).into());
            }
            paths.extend(found);
            is_set |= several;
        }
        if !self.json {
            print(&text::heading(&pad))?;
        }
        let meshes = if is_set { self.together(&paths, &pad) } else { self.one_by_one(&paths, &pad)? };
        let verdict = self.verdict(&meshes);
        if self.json {
            let text = json(&InspectReport { pad, meshes });
            print(&(String::from_utf8_lossy(&text) + "\n"))?;
        } else if is_set {
            print(&(set::table(&meshes, &pad) + "\n" + &text::summary(&meshes) + &set::totals(&meshes, &pad)))?;
            let found = set::findings(&meshes);
            if !found.is_empty() {
                print(&format!("\n{}\n", found.render(terminal::output())))?;
            }
        } else if meshes.len() > 1 {
            print(&text::summary(&meshes))?;
        }
        verdict
    }

    /// Looks at all of them while a bar shows how far it is.
    fn together(&self, paths: &[PathBuf], pad: &SensorPad) -> Vec<Inspection> {
        let bar = Bar::new(true, "meshes");
        bar.start(paths.len() as u64);
        let found = inspect_set(paths, self.reading(), pad, || bar.advance());
        bar.end();
        found
    }

    /// Prints what there is to say of each before the next is looked at.
    fn one_by_one(&self, paths: &[PathBuf], pad: &SensorPad) -> Result<Vec<Inspection>, Failure> {
        let mut meshes = Vec::with_capacity(paths.len());
        for path in paths {
            let inspection = inspect(path, self.reading(), pad);
            if !self.json {
                print(&text::block(&inspection, pad, columns()))?;
            }
            meshes.push(inspection);
        }
        Ok(meshes)
    }

    fn verdict(&self, meshes: &[Inspection]) -> Result<(), Failure> {
        let (bearable, what) = if self.strict {
            (Some(Severity::Note), "errors or warnings")
        } else {
            (Some(Severity::Warning), "errors")
        };
        let bad = meshes.iter().filter(|mesh| mesh.severity > bearable).count();
        match bad {
            0 => Ok(()),
            _ => Err(Failure::running(format!("{what} in {bad} of {}", counted(meshes.len(), "mesh", "meshes")))),
        }
    }
}
