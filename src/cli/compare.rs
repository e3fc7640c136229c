//! `gelsim compare`: measures how far simulated images, or forces, are from real ones.

use std::fs;
use std::io;
use std::path::{Path, PathBuf};

use clap::Args;

use super::log::Log;
use super::store::local_path_parser;
use super::terminal::stdout_columns;
use super::{Failure, print_result, print_to_stderr};
use gelsim_files::diagnostic::{Diagnostic, Diagnostics, Report, user_error};
use gelsim_files::input;
use gelsim_files::number_format::format_count;
use gelsim_files::png;
use gelsim_files::write::write_output;
use gelsim_job::plan::standalone;
use gelsim_lab::compare::force::compare_forces;
use gelsim_lab::compare::{compare_folders, picture, report};

/// Measure how far simulated images are from real ones: MAE, PSNR and SSIM of pairs, over the whole image and over the
/// contact, and which way the simulated images are off as a set. With --force, how far simulated forces are.
#[derive(Debug, Args)]
#[command(after_help = "\
Example:
  gelsim compare real/gelsight_taxim simulated/gelsight_taxim --out comparison
  gelsim compare real out/quickstart
  gelsim compare --force forces.csv --sensor mine.toml --out comparison

REAL and SIM are folders of a sensor, with annotations.csv (columns file, centre_x_px, centre_y_px, radius_px) or with \
images of 8 bits a channel in it or in images/; folders of such folders, one per sensor; or datasets.

Sensors are told by their folders' names, unless there is one on each side. Within a sensor, images pair by their paths \
relative to its folder, then by their names without folders. Images of datasets never pair: where no image does, only \
the sets are compared.

FORCES.csv is a table of presses with measured forces, as gelsim calibrate --force reads it.")]
pub struct Compare {
    /// Real images
    #[arg(value_name = "REAL", required_unless_present = "force")]
    real: Option<PathBuf>,
    /// Simulated images
    #[arg(value_name = "SIM", required_unless_present = "force")]
    sim: Option<PathBuf>,
    /// Compare the forces of the presses in this table instead of images
    #[arg(long, value_name = "FORCES.csv", requires = "sensor", conflicts_with_all = ["real", "sim", "dilate"])]
    force: Option<PathBuf>,
    /// With --force the sensor that is simulated
    #[arg(long, value_name = "PRESET|SENSOR.toml", requires = "force")]
    sensor: Option<String>,
    /// With --force: add this to depth_mm, as gelsim calibrate --fit-zero found it
    #[arg(long, value_name = "MM", requires = "force", allow_hyphen_values = true, value_parser = parse_zero)]
    zero_mm: Option<f64>,
    /// Folder for compare.csv, compare.json and compare.png; with --force for force.csv and force.json
    #[arg(short, long, value_name = "DIR", value_parser = local_path_parser())]
    out: Option<PathBuf>,
    /// Radius of what counts as the contact, over that of the annotated circle
    #[arg(long, value_name = "FACTOR", default_value_t = 1.3, value_parser = parse_factor)]
    dilate: f64,
    /// Also print a line for each pair, or with --force for each press
    #[arg(long)]
    per_image: bool,
}

/// Why a gel that has a shape has no simulated forces here, and what to do instead.
const FLAT_ONLY: [&str; 2] = [
    "forces are compared on flat pads, and the sensor's gel has a shape",
    "simulate the presses with a job, and compare `contact.force_n` of its labels with the measured forces",
];

fn parse_zero(text: &str) -> Result<f64, String> {
    match text.parse::<f64>() {
        Ok(mm) if (-100.0..=100.0).contains(&mm) => Ok(mm),
        _ => Err(String::from("write a number from -100 to 100")),
    }
}

fn parse_factor(text: &str) -> Result<f64, String> {
    match text.parse::<f64>() {
        Ok(factor) if factor.is_finite() && factor > 0.0 => Ok(factor),
        _ => Err(String::from("write a number above 0, for example 1.3 for a circle that is 30 % larger")),
    }
}

impl Compare {
    pub(super) fn run(self) -> Result<(), Failure> {
        if let Some(folder) = &self.out
            && folder.exists()
            && !folder.is_dir()
        {
            let message = format!("{} is not a folder", folder.display());
            return Err(user_error(message, "choose a folder with --out").into());
        }
        if let (Some(table), Some(sensor)) = (&self.force, &self.sensor) {
            return self.compare_forces(table, sensor);
        }
        let (Some(real), Some(sim)) = (&self.real, &self.sim) else {
            return Err(user_error("nothing to compare", "see gelsim compare --help").into());
        };
        if let Some(folder) =
            self.out.as_ref().filter(|out| [real, sim].iter().any(|side| input::is_same_path(out, side)))
        {
            let message = format!("the results would lie among the images in {}", folder.display());
            return Err(user_error(message, "choose another folder with --out").into());
        }
        let comparison = compare_folders(real, sim, self.dilate)?;
        let mut notes = Diagnostics::default();
        notes.extend(comparison.diagnostics.iter().cloned());
        Log::plain_text(false).print_notes(&Report::new(&notes, &[]));
        if let Some(folder) = &self.out {
            let failed = |path: &Path, error: &io::Error| {
                Failure::access_denied(
                    &format!("{}: {error}", path.display()),
                    error,
                    "choose another place with --out",
                )
            };
            fs::create_dir_all(folder).map_err(|error| failed(folder, &error))?;
            let write = |name: &str, bytes: &[u8]| {
                let path = folder.join(name);
                write_output(&path, bytes).map_err(|error| failed(&path, &error))
            };
            write("compare.csv", &report::to_csv(&comparison))?;
            write("compare.json", &report::to_json(&comparison))?;
            match picture::draw_best_median_worst(&comparison)? {
                Some(sheet) => {
                    let (width, height) = (sheet.width() as usize, sheet.height() as usize);
                    write("compare.png", &png::encode_rgb(width, height, &sheet))?;
                }
                // The picture of an earlier comparison would be mistaken for this one's.
                None => match fs::remove_file(folder.join("compare.png")) {
                    Err(error) if error.kind() != io::ErrorKind::NotFound => {
                        return Err(failed(&folder.join("compare.png"), &error));
                    }
                    _ => {}
                },
            }
        }
        print_result(&report::to_text_table(&comparison, self.per_image, stdout_columns()))?;
        if let Some(folder) = &self.out {
            print_to_stderr(&format!("-> {}", folder.display()));
        }
        Ok(())
    }

    /// Compares simulated forces with those of a table.
    fn compare_forces(&self, table: &Path, sensor: &str) -> Result<(), Failure> {
        let sensor = standalone::load_flat_sensor(sensor, FLAT_ONLY)?.written;
        let comparison = compare_forces(table, &sensor, self.zero_mm.unwrap_or(0.0))?;
        Log::plain_text(false).print_notes(&comparison.doubts);
        if comparison.rows_left_out > 0 {
            let rows = format_count(comparison.rows_left_out, "row is", "rows are");
            Log::plain_text(false).print_note(&format!("{rows} left out, where the indenter is lifted"));
        }
        let has_shear = comparison.presses.iter().any(|press| press.has_measured_shear);
        if has_shear && sensor.gelpad_friction_coefficient.is_none() {
            let help = "write gelpad_friction_coefficient into the sensor file";
            let note =
                Diagnostic::note("tangential forces are not compared: the sensor has no coefficient of friction");
            Log::plain_text(false).print_notes(&note.help(help).into());
        }
        if let Some(folder) = &self.out {
            let failed = |path: &Path, error: &io::Error| {
                let message = format!("{}: {error}", path.display());
                Failure::access_denied(&message, error, "choose another place with --out")
            };
            fs::create_dir_all(folder).map_err(|error| failed(folder, &error))?;
            for (name, bytes) in [("force.csv", comparison.to_csv()), ("force.json", comparison.to_json())] {
                let path = folder.join(name);
                write_output(&path, &bytes).map_err(|error| failed(&path, &error))?;
            }
        }
        print_result(&comparison.to_text_table(self.per_image, stdout_columns()))?;
        if let Some(folder) = &self.out {
            print_to_stderr(&format!("-> {}", folder.display()));
        }
        Ok(())
    }
}
