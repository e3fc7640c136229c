//! `gelsim report`: writes an HTML page about a dataset.

use std::path::{Path, PathBuf};

use clap::Args;

use super::store::local_path_parser;
use super::{Failure, for_each_dataset, output_file, print_result, print_to_stderr};
use gelsim_dataset::cleanup::{self, REPORT_FILE};
use gelsim_dataset::lock::Lock;
use gelsim_dataset::sensor_set::{SensorSet, list_dataset_folders};
use gelsim_files::input::RelativePaths;
use gelsim_lab::report::set::{SetRow, render_set};
use gelsim_lab::report::{self, DatasetReport};

/// Write one HTML page about a dataset: counts by class and split, distributions of contact, pose and brightness,
/// effects, health, time, size, some samples, the configuration. It needs no network and no scripts.
#[derive(Debug, Args)]
#[command(after_help = "\
Example:
  gelsim report out/quickstart
  gelsim report out/quickstart --out quickstart.html

Only labels are read, and images of at most 1000 samples. What is missing or damaged is named at the top, and the page is \
made from what is there; gelsim verify looks at every byte.")]
pub struct Report {
    /// The dataset's folder, or that of a set of sensors: each dataset has its page, and the set's leads to them
    #[arg(value_name = "DIR")]
    dir: PathBuf,
    /// The page to write [default: DIR/report.html]
    #[arg(short, long, value_name = "FILE.html", value_parser = local_path_parser())]
    out: Option<PathBuf>,
}

impl Report {
    pub(super) fn run(self) -> Result<(), Failure> {
        if let Some(out) = &self.out {
            output_file::check_output_path(out, &["html"], REPORT_FILE)?;
        }
        let out = self.out.clone().unwrap_or_else(|| self.dir.join(REPORT_FILE));
        if SensorSet::find(&self.dir)?.is_none() {
            self.write_dataset_page(&self.dir, &out)?;
            return print_result(&format!("{}\n", out.display()));
        }
        // A page for each dataset, and one that leads to them.
        let mut rows = Vec::new();
        let folder_of_page = output_file::parent_folder(&out);
        let failed = |error| Failure::from_path(folder_of_page, &error);
        let mut seen_from_page = RelativePaths::seen_from(folder_of_page).map_err(failed)?;
        let with_slashes = |path: &Path| path.to_string_lossy().replace('\\', "/");
        let all_written = for_each_dataset(&list_dataset_folders(&self.dir)?, |folder| {
            let page = folder.join(REPORT_FILE);
            let dataset = self.write_dataset_page(folder, &page)?;
            let name = with_slashes(folder.strip_prefix(&self.dir).unwrap_or(folder));
            let link = seen_from_page.make_relative(&page).map_err(failed)?;
            rows.push(SetRow::new(name, with_slashes(&link), &dataset));
            Ok(true)
        });
        if rows.is_empty() {
            return all_written;
        }
        let name = self.dir.canonicalize().ok().and_then(|root| Some(root.file_name()?.to_string_lossy().into_owned()));
        output_file::write_whole_file(&out, render_set(&name.unwrap_or_default(), &rows).as_bytes())?;
        print_result(&format!("{}\n", out.display()))?;
        all_written
    }

    /// Writes the page about the dataset in a folder, and prints its warnings.
    fn write_dataset_page(&self, folder: &Path, out: &Path) -> Result<DatasetReport, Failure> {
        let dataset = report::read_dataset(folder)?;
        for warning in dataset.list_warnings() {
            print_to_stderr(&format!("warning: {warning}"));
        }
        Self::write_page(folder, out, dataset.to_html().as_bytes())?;
        Ok(dataset)
    }

    /// Writes the complete page. If it goes into the dataset's folder, holds the dataset's lock: a run that finishes
    /// the dataset removes partial files there.
    fn write_page(root: &Path, out: &Path, page: &[u8]) -> Result<(), Failure> {
        let folder = output_file::parent_folder(out);
        let same = |a: &Path, b: &Path| matches!((a.canonicalize(), b.canonicalize()), (Ok(a), Ok(b)) if a == b);
        let lock = cleanup::lock_path(root);
        let _alone = if same(folder, root) {
            Some(Lock::acquire(&lock).map_err(|error| {
                Failure::access_denied(&format!("{}: {error}", lock.display()), &error, "nothing was written")
            })?)
        } else {
            None
        };
        output_file::write_whole_file(out, page)
    }
}
