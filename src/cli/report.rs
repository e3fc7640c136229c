//! `gelsim report`

use std::path::{Path, PathBuf};

use clap::Args;

use super::store::local_output;
use super::{Failure, output_file, print, say};
use gelsim_dataset::cleanup::{self, REPORT};
use gelsim_dataset::lock::Lock;
use gelsim_lab::report;

/// Write one HTML page about a dataset: counts by class and split, distributions of contact, pose and brightness, effects,
/// health, time, size, some samples, the configuration. It needs no network and no scripts.
#[derive(Debug, Args)]
#[command(after_help = "\
Example:
  gelsim report out/quickstart
  gelsim report out/quickstart --out quickstart.html

Only labels are read, and images of at most 1000 samples. What is missing or damaged is named at the top, and the page is \
made from what is there; gelsim verify looks at every byte.")]
pub struct Report {
    /// The dataset's folder
    #[arg(value_name = "DIR")]
    dir: PathBuf,
    /// The page to write [default: DIR/report.html]
    #[arg(short, long, value_name = "FILE.html", value_parser = local_output())]
    out: Option<PathBuf>,
}

impl Report {
    pub(super) fn run(self) -> Result<(), Failure> {
        if let Some(out) = &self.out {
            output_file::check(out, &["html"], REPORT)?;
        }
        let out = self.out.clone().unwrap_or_else(|| self.dir.join(REPORT));
        let dataset = report::read(&self.dir)?;
        for warning in dataset.warnings() {
            say(&format!("warning: {warning}"));
        }
        let page = dataset.html();
        self.write(&out, page.as_bytes())?;
        print(&format!("{}\n", out.display()))
    }

    /// Writes the complete page. Who finishes the dataset sweeps up partial files in its folder, so not at the same
    /// time.
    fn write(&self, out: &Path, page: &[u8]) -> Result<(), Failure> {
        let folder = output_file::folder_of(out);
        let same = |a: &Path, b: &Path| matches!((a.canonicalize(), b.canonicalize()), (Ok(a), Ok(b)) if a == b);
        let lock = cleanup::lock(&self.dir);
        let _alone = if same(folder, &self.dir) {
            Some(Lock::wait(&lock).map_err(|error| {
                Failure::denied(&format!("{}: {error}", lock.display()), &error, "nothing was written")
            })?)
        } else {
            None
        };
        output_file::write(out, page)
    }
}
