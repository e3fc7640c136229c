//! `gelsim compare`: measures how far simulated images are from real ones.

use std::fs;
use std::io;
use std::path::{Path, PathBuf};

use clap::Args;

use super::log::Log;
use super::store::local_path_parser;
use super::terminal::stdout_columns;
use super::{Failure, print_result, print_to_stderr};
use gelsim_files::diagnostic::{Diagnostics, Report, user_error};
use gelsim_files::png;
use gelsim_files::write::write_output;
use gelsim_lab::compare::{compare_folders, picture, report};

/// Measure how far simulated images are from real ones: MAE, PSNR and SSIM of pairs, over the whole image and over the
/// contact, and which way the simulated images are off as a set.
#[derive(Debug, Args)]
#[command(after_help = "\
Example:
  gelsim compare real/gelsight_taxim simulated/gelsight_taxim --out comparison
  gelsim compare real out/quickstart

REAL and SIM are folders of a sensor, with annotations.csv (columns file, centre_x_px, centre_y_px, radius_px) or with \
images of 8 bits a channel in it or in images/; folders of such folders, one per sensor; or datasets.

Sensors are told by their folders' names, unless there is one on each side. Within a sensor, images pair by their paths \
relative to its folder, then by their names without folders. Images of datasets never pair: where no image does, only \
the sets are compared.")]
pub struct Compare {
    /// Real images
    #[arg(value_name = "REAL")]
    real: PathBuf,
    /// Simulated images
    #[arg(value_name = "SIM")]
    sim: PathBuf,
    /// Folder for compare.csv, compare.json and compare.png
    #[arg(short, long, value_name = "DIR", value_parser = local_path_parser())]
    out: Option<PathBuf>,
    /// Radius of what counts as the contact, over that of the annotated circle
    #[arg(long, value_name = "FACTOR", default_value_t = 1.3, value_parser = parse_factor)]
    dilate: f64,
    /// Also print a line for each pair
    #[arg(long)]
    per_image: bool,
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
        let comparison = compare_folders(&self.real, &self.sim, self.dilate)?;
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
}
