//! `gelsim inspect`: checks meshes, and says what a sensor would see of them.

use std::path::PathBuf;

use clap::Args;
use clap::builder::{PossibleValuesParser, TypedValueParser};

use super::progress::bar::Bar;
use super::terminal::stdout_columns;
use super::{Failure, print_file, print_result, terminal};
use gelsim_dataset::encode::to_json_line;
use gelsim_files::diagnostic::Severity;
use gelsim_files::diagnostic::user_error;
use gelsim_files::mesh::{ENDINGS, MeshReadOptions, UrdfShapes};
use gelsim_files::number_format::format_count;
use gelsim_files::sensor::PRESETS;
use gelsim_job::config::object::Unit;
use gelsim_job::inspection::SensorPad;
use gelsim_lab::inspect::{InspectReport, Inspection, inspect_mesh, inspect_meshes, set, text};

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
    /// The meshes, or folders of meshes, which are listed in a table: .obj, .stl, .ply, .off, .glb, .gltf, .dae, .3mf
    /// or .urdf
    #[arg(value_name = "MESH", required = true)]
    meshes: Vec<PathBuf>,
    /// Unit of their coordinates [default: the one that the file says, else mm]
    #[arg(long, value_parser = crate::length_unit_parser())]
    unit: Option<Unit>,
    /// Folders of packages to search for the meshes of a robot (.urdf), besides those around it and in ROS_PACKAGE_PATH
    #[arg(long, value_name = "DIR", num_args = 1..)]
    packages: Vec<String>,
    /// Which shapes of a robot's links to take
    #[arg(long, value_name = "SHAPES", default_value = "visual", value_parser = urdf_shapes_parser())]
    urdf: UrdfShapes,
    /// Preset of the sensor to compare them with
    #[arg(long, value_name = "PRESET", default_value = PRESETS[0].0, value_parser = preset_name_parser())]
    sensor: String,
    /// Print JSON instead of text
    #[arg(long)]
    json: bool,
    /// End with status 1 also if a mesh has a warning
    #[arg(long)]
    strict: bool,
}

/// Parses the name of a sensor preset.
pub(super) fn preset_name_parser() -> PossibleValuesParser {
    PossibleValuesParser::new(PRESETS.map(|(name, _)| name))
}

/// Parses which shapes of a robot's links to take.
fn urdf_shapes_parser() -> impl TypedValueParser<Value = UrdfShapes> {
    PossibleValuesParser::new(UrdfShapes::ALL.map(UrdfShapes::name))
        .map(|name| UrdfShapes::ALL.into_iter().find(|shapes| shapes.name() == name).unwrap_or_default())
}

impl Inspect {
    fn mesh_reading(&self) -> MeshReadOptions<'_> {
        MeshReadOptions { mm_per_unit: self.unit.map(Unit::mm_per_unit), urdf: self.urdf, packages: &self.packages }
    }

    pub(super) fn run(self) -> Result<(), Failure> {
        let failed = || Failure::runtime(format!("the preset {} cannot be read", self.sensor));
        let pad = SensorPad::from_preset(&self.sensor).ok_or_else(failed)?;
        let mut paths = Vec::new();
        let mut is_set = false;
        for path in &self.meshes {
            let (found, several) = set::find_meshes(path).map_err(|error| Failure::runtime(error.to_string()))?;
            if found.is_empty() {
                let message = format!("there is no mesh in {}", path.display());
                return Err(user_error(message, format!("meshes are files that end in {ENDINGS}")).into());
            }
            paths.extend(found);
            is_set |= several;
        }
        if !self.json {
            print_result(&text::format_heading(&pad))?;
        }
        let meshes = if is_set { self.inspect_all(&paths, &pad) } else { self.inspect_one_by_one(&paths, &pad)? };
        let verdict = self.check_severity(&meshes);
        if self.json {
            let text = to_json_line(&InspectReport { pad, meshes });
            print_file(&(String::from_utf8_lossy(&text) + "\n"))?;
        } else if is_set {
            print_result(
                &(set::to_text_table(&meshes, &pad)
                    + "\n"
                    + &text::format_summary(&meshes)
                    + &set::format_totals(&meshes, &pad)),
            )?;
            let found = set::collect_findings(&meshes);
            if !found.is_empty() {
                print_result(&format!("\n{}\n", found.render(terminal::stdout_display())))?;
            }
        } else if meshes.len() > 1 {
            print_result(&text::format_summary(&meshes))?;
        }
        verdict
    }

    /// Inspects all meshes, with a progress bar.
    fn inspect_all(&self, paths: &[PathBuf], pad: &SensorPad) -> Vec<Inspection> {
        let bar = Bar::new(true, "meshes");
        bar.start(paths.len() as u64);
        let found = inspect_meshes(paths, self.mesh_reading(), pad, || bar.advance());
        bar.end();
        found
    }

    /// Inspects the meshes one by one, and prints what was found before it goes on to the next.
    fn inspect_one_by_one(&self, paths: &[PathBuf], pad: &SensorPad) -> Result<Vec<Inspection>, Failure> {
        let mut meshes = Vec::with_capacity(paths.len());
        for path in paths {
            let inspection = inspect_mesh(path, self.mesh_reading(), pad);
            if !self.json {
                print_result(&text::format_inspection(&inspection, pad, stdout_columns()))?;
            }
            meshes.push(inspection);
        }
        Ok(meshes)
    }

    /// Fails if a mesh has an error, or with `--strict` a warning.
    fn check_severity(&self, meshes: &[Inspection]) -> Result<(), Failure> {
        let (bearable, what) = if self.strict {
            (Some(Severity::Note), "errors or warnings")
        } else {
            (Some(Severity::Warning), "errors")
        };
        let bad = meshes.iter().filter(|mesh| mesh.severity > bearable).count();
        match bad {
            0 => Ok(()),
            _ => Err(Failure::runtime(format!("{what} in {bad} of {}", format_count(meshes.len(), "mesh", "meshes")))),
        }
    }
}
