//! `gelsim init`

use std::fs::OpenOptions;
use std::io::Write;
use std::path::PathBuf;

use clap::Args;

use super::inspect::presets;
use super::store::local_output;
use super::{Failure, print, say};
use crate::files::diagnostic::user_error;
use crate::files::sensor::PRESETS;
use crate::lab::inspect::job as template;

/// The job that `init` writes.
pub const TEMPLATE: &str = include_str!("template.toml");

/// Write a commented job to start from, or one for the meshes of a folder.
#[derive(Debug, Args)]
#[command(after_help = "\
Example:
  gelsim init my-job.toml
  gelsim init --sensor digit --objects meshes my-job.toml")]
pub struct Init {
    /// Preset of the sensor
    #[arg(long, value_name = "PRESET", value_parser = presets(), requires = "objects")]
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
        let (text, next) = match &self.objects {
            None => (TEMPLATE.to_owned(), "put a mesh into it, then gelsim generate"),
            Some(folder) => {
                let sensor = self.sensor.as_deref().unwrap_or(PRESETS[0].0);
                (template::of_folder(folder, sensor, self.file.as_deref())?, "gelsim preview")
            }
        };
        let Some(path) = self.file else {
            return print(&text);
        };
        let failed = |error: std::io::Error| Failure::running(format!("{}: {error}", path.display()));
        let mut file = match OpenOptions::new().write(true).create_new(true).open(&path) {
            Err(error) if error.kind() == std::io::ErrorKind::AlreadyExists => {
                return Err(user_error(format!("{} exists already", path.display()), "choose another name").into());
            }
            opened => opened.map_err(failed)?,
        };
        file.write_all(text.as_bytes()).map_err(failed)?;
        say(&format!("wrote {0}; next: {next} {0}", path.display()));
        Ok(())
    }
}
