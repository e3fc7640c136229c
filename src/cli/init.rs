//! `gelsim init`: writes a job to start from.

use std::io::ErrorKind;
use std::path::{Path, PathBuf};

use clap::Args;

use super::inspect::preset_name_parser;
use super::log::Log;
use super::store::local_path_parser;
use super::{Failure, print_file, print_to_stderr};
use gelsim_files::diagnostic::{Report, user_error};
use gelsim_files::sensor::{PRESETS, load_preset};
use gelsim_files::spelling::quote_for_shell;
use gelsim_files::write::write_new;
use gelsim_job::inspection::SensorPad;
use gelsim_lab::inspect::job;

/// The job that `init` writes unless it is given meshes.
pub const TEMPLATE: &str = include_str!("template.toml");

/// Mesh that the template presses until the user has another: its name in the job, and the bytes written if there is no
/// such file.
const STARTER_MESH: (&str, &[u8]) = ("my-object.obj", include_bytes!("my-object.obj"));

/// Write a commented job to start from, or one for the meshes of a folder.
#[derive(Debug, Args)]
#[command(after_help = "\
Example:
  gelsim init my-job.toml
  gelsim init --sensor digit --objects meshes my-job.toml

Without --objects the job presses my-object.obj, a peg 8 mm wide, which is written beside it unless there is such a file: put your \
mesh in its place.")]
pub struct Init {
    /// Preset of the sensor
    #[arg(long, value_name = "PRESET", value_parser = preset_name_parser())]
    sensor: Option<String>,
    /// Folder of meshes to press: the job lists them with their units and classes
    #[arg(long, value_name = "FOLDER")]
    objects: Option<PathBuf>,
    /// The file to write [default: standard output]
    #[arg(value_name = "FILE.toml", value_parser = local_path_parser())]
    file: Option<PathBuf>,
}

impl Init {
    pub(super) fn run(self) -> Result<(), Failure> {
        let exists = |path: &Path| user_error(format!("{} exists already", path.display()), "choose another name");
        // Checked before the meshes are read, and again as the file is written.
        if let Some(path) = self.file.as_deref().filter(|path| path.symlink_metadata().is_ok()) {
            return Err(exists(path).into());
        }
        let (text, notes) = match &self.objects {
            None => (fill_template(self.sensor.as_deref()), Report::default()),
            Some(folder) => {
                let sensor = self.sensor.as_deref().unwrap_or(PRESETS[0].0);
                let written = job::job_for_folder(folder, sensor, self.file.as_deref())?;
                (written.text, written.notes)
            }
        };
        Log::plain_text(false).print_notes(&notes);
        let Some(path) = &self.file else {
            return print_file(&text);
        };
        if !create_file(path, text.as_bytes())? {
            return Err(exists(path).into());
        }
        let starter = path.with_file_name(STARTER_MESH.0);
        let is_starter = self.objects.is_none() && create_file(&starter, STARTER_MESH.1)?;
        let and = if is_starter { format!(" and {}, a peg to press", starter.display()) } else { String::new() };
        let sheet = quote_for_shell(&path.with_extension("png"));
        print_to_stderr(&format!(
            "wrote {}{and}\nnext: gelsim preview {} --out {sheet}",
            path.display(),
            quote_for_shell(path)
        ));
        Ok(())
    }
}

/// Writes a new file. Returns false if there is one already.
fn create_file(path: &Path, bytes: &[u8]) -> Result<bool, Failure> {
    match write_new(path, bytes) {
        Ok(()) => Ok(true),
        Err(error) if error.kind() == ErrorKind::AlreadyExists => Ok(false),
        Err(error) => {
            Err(Failure::access_denied(&format!("{}: {error}", path.display()), &error, "it was not written"))
        }
    }
}

/// Returns the template. For a named preset it has that sensor, and poses and depths that suit its pad and its gel's
/// shape.
fn fill_template(sensor: Option<&str>) -> String {
    let named = sensor.and_then(|name| Some((name, SensorPad::from_preset(name)?)));
    let Some((name, pad)) = named else { return TEMPLATE.to_owned() };
    let pose = job::format_pose_lines(name, &pad);
    let line = |line: &str| match line {
        "# [sensor]" => String::from("[sensor]"),
        _ if line.starts_with("# preset = ") => format!("preset = \"{name}\""),
        _ if line.starts_with("# resolution_px = ") => {
            let [width, height] = pad.resolution_px;
            let key = format!("# resolution_px = [{width}, {height}]");
            format!("{key:<42}{}", &line[line.rfind('#').unwrap_or_default()..])
        }
        _ if line.starts_with("x_mm = [") => pose.trim_end().to_owned(),
        _ if line.starts_with("depth_mm = [") => job::format_depth_line(&pad),
        line => line.to_owned(),
    };
    // Dots are printed on flat pads, and shear shows by them.
    let flat_only = TEMPLATE.find("#   [markers]").zip(TEMPLATE.find("#   [camera]"));
    let template = match flat_only {
        Some((from, until)) if load_preset(name).is_ok_and(|sensor| sensor.shape.is_some()) => {
            [&TEMPLATE[..from], &TEMPLATE[until..]].concat()
        }
        _ => TEMPLATE.to_owned(),
    };
    let has_pins = load_preset(name).is_ok_and(|sensor| sensor.pins.is_some());
    // The second coordinate is written with the first. Pins are seen before a colour.
    let is_left_out =
        |written: &&str| written.starts_with("y_mm = [") || has_pins && written.starts_with("# background = ");
    let lines = template.lines().filter(|written| !is_left_out(written)).map(line);
    lines.map(|line| line + "\n").collect()
}
