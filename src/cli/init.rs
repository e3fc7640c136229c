//! `gelsim init`

use std::io::ErrorKind;
use std::path::{Path, PathBuf};

use clap::Args;

use super::inspect::presets;
use super::log::Log;
use super::store::local_output;
use super::{Failure, print, say};
use gelsim_files::diagnostic::{Report, user_error};
use gelsim_files::sensor::PRESETS;
use gelsim_files::spelling::shell_word;
use gelsim_files::write::write_new;
use gelsim_job::inspection::SensorPad;
use gelsim_lab::inspect::job;

/// The job that `init` writes.
pub const TEMPLATE: &str = include_str!("template.toml");

/// The mesh that it presses until there is another: its name in the job, and what is written where there is no such file.
const STARTER: (&str, &[u8]) = ("my-object.obj", include_bytes!("my-object.obj"));

/// Write a commented job to start from, or one for the meshes of a folder.
#[derive(Debug, Args)]
#[command(after_help = "\
Example:
  gelsim init my-job.toml
  gelsim init --sensor digit --objects meshes my-job.toml

Without --objects the job presses my-object.obj, a peg 8 mm wide, which is written beside it where no such file is: put your \
mesh in its place.")]
pub struct Init {
    /// Preset of the sensor
    #[arg(long, value_name = "PRESET", value_parser = presets())]
    sensor: Option<String>,
    /// Folder of meshes that are pressed: the job names them, their units and classes
    #[arg(long, value_name = "FOLDER")]
    objects: Option<PathBuf>,
    /// The file to write; on standard output if left out
    #[arg(value_name = "FILE.toml", value_parser = local_output())]
    file: Option<PathBuf>,
}

impl Init {
    pub(super) fn run(self) -> Result<(), Failure> {
        let exists = |path: &Path| user_error(format!("{} exists already", path.display()), "choose another name");
        // Before meshes are looked at, and again as it is written.
        if let Some(path) = self.file.as_deref().filter(|path| path.symlink_metadata().is_ok()) {
            return Err(exists(path).into());
        }
        let (text, notes) = match &self.objects {
            None => (template(self.sensor.as_deref()), Report::default()),
            Some(folder) => {
                let sensor = self.sensor.as_deref().unwrap_or(PRESETS[0].0);
                let written = job::of_folder(folder, sensor, self.file.as_deref())?;
                (written.text, written.notes)
            }
        };
        Log::text(false).notes(&notes);
        let Some(path) = &self.file else {
            return print(&text);
        };
        if !create(path, text.as_bytes())? {
            return Err(exists(path).into());
        }
        let starter = path.with_file_name(STARTER.0);
        let is_starter = self.objects.is_none() && create(&starter, STARTER.1)?;
        let and = if is_starter { format!(" and {}, a peg to press", starter.display()) } else { String::new() };
        let sheet = shell_word(&path.with_extension("png"));
        say(&format!("wrote {}{and}; next: gelsim preview {} --out {sheet}", path.display(), shell_word(path)));
        Ok(())
    }
}

/// Writes a new file; false if there is one already.
fn create(path: &Path, bytes: &[u8]) -> Result<bool, Failure> {
    match write_new(path, bytes) {
        Ok(()) => Ok(true),
        Err(error) if error.kind() == ErrorKind::AlreadyExists => Ok(false),
        Err(error) => Err(Failure::denied(&format!("{}: {error}", path.display()), &error, "it was not written")),
    }
}

/// The template, for a preset if one is named: what its pad and its gel's shape make of poses and depths.
fn template(sensor: Option<&str>) -> String {
    let named = sensor.and_then(|name| Some((name, SensorPad::preset(name)?)));
    let Some((name, pad)) = named else { return TEMPLATE.to_owned() };
    let line = |line: &str| match line {
        "# [sensor]" => String::from("[sensor]"),
        _ if line.starts_with("# preset = ") => format!("preset = \"{name}\""),
        _ if line.starts_with("x_mm = [") => job::places(name, &pad).trim_end().to_owned(),
        _ if line.starts_with("depth_mm = [") => job::depths(&pad),
        line => line.to_owned(),
    };
    // The second coordinate is written with the first.
    let lines = TEMPLATE.lines().filter(|written| !written.starts_with("y_mm = [")).map(line);
    lines.map(|line| line + "\n").collect()
}
