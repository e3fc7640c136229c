//! `gelsim compare`

use std::fs;
use std::io;
use std::path::{Path, PathBuf};

use clap::Args;

use super::log::Log;
use super::store::local_output;
use super::terminal::columns;
use super::{Failure, print, say};
use gelsim_files::diagnostic::{Diagnostics, Report, user_error};
use gelsim_files::png;
use gelsim_files::write::write_output;
use gelsim_lab::compare::{compare, picture, report};

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
    #[arg(short, long, value_name = "DIR", value_parser = local_output())]
    out: Option<PathBuf>,
    /// What counts as the contact: the annotated circle with its radius times this
    #[arg(long, value_name = "FACTOR", default_value_t = 1.3, value_parser = factor)]
    dilate: f64,
    /// Print a line for each pair, too
    #[arg(long)]
    per_image: bool,
}

fn factor(text: &str) -> Result<f64, String> {
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
        let comparison = compare(&self.real, &self.sim, self.dilate)?;
        let mut notes = Diagnostics::default();
        notes.extend(comparison.diagnostics.iter().cloned());
        Log::text(false).notes(&Report::new(&notes, &[]));
        if let Some(folder) = &self.out {
            let failed = |path: &Path, error: &io::Error| {
                Failure::denied(&format!("{}: {error}", path.display()), error, "choose another place with --out")
            };
            fs::create_dir_all(folder).map_err(|error| failed(folder, &error))?;
            let write = |name: &str, bytes: &[u8]| {
                let path = folder.join(name);
                write_output(&path, bytes).map_err(|error| failed(&path, &error))
            };
            write("compare.csv", &report::csv(&comparison))?;
            write("compare.json", &report::to_json(&comparison))?;
            match picture::best_median_worst(&comparison)? {
                Some(sheet) => {
                    let (width, height) = (sheet.width() as usize, sheet.height() as usize);
                    write("compare.png", &png::encode_rgb(width, height, &sheet))?;
                }
                // One of an earlier comparison would be taken for this one's.
                None => match fs::remove_file(folder.join("compare.png")) {
                    Err(error) if error.kind() != io::ErrorKind::NotFound => {
                        return Err(failed(&folder.join("compare.png"), &error));
                    }
                    _ => {}
                },
            }
        }
        print(&report::table(&comparison, self.per_image, columns()))?;
        if let Some(folder) = &self.out {
            say(&format!("-> {}", folder.display()));
        }
        Ok(())
    }
}
