//! `gelsim report`

use std::path::{Path, PathBuf};

use clap::Args;

use super::store::local_output;
use super::{Failure, print, say};
use crate::dataset::cleanup::{self, REPORT};
use crate::dataset::lock::Lock;
use crate::files::diagnostic::user_error;
use crate::files::write::write_output;
use crate::lab::report;

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
        let out = self.out.clone().unwrap_or_else(|| self.dir.join(REPORT));
        let html = out.extension().is_some_and(|ending| ending.eq_ignore_ascii_case("html"));
        if !html || out.is_dir() {
            let message = format!("{} cannot be the page's name", out.display());
            return Err(user_error(message, "name a file that ends in .html with --out").into());
        }
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
        let failed = |path: &Path, error: std::io::Error| Failure::running(format!("{}: {error}", path.display()));
        let folder = out.parent().filter(|folder| !folder.as_os_str().is_empty()).unwrap_or(Path::new("."));
        let same = |a: &Path, b: &Path| matches!((a.canonicalize(), b.canonicalize()), (Ok(a), Ok(b)) if a == b);
        let lock = cleanup::lock(&self.dir);
        let _alone = match same(folder, &self.dir) {
            true => Some(Lock::wait(&lock).map_err(|error| failed(&lock, error))?),
            false => None,
        };
        write_output(out, page).map_err(|error| failed(out, error))
    }
}
