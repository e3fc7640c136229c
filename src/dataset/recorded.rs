//! A dataset that is there, as its own job.toml describes it. The meshes and pictures it was made from need not be.

use std::ops::ControlFlow;
use std::path::{Path, PathBuf};

use super::archive::{self, Files};
use super::layout::Layout;
use super::shard::Paths;
use crate::config::diagnostic::{Problems, Report};
use crate::config::{self, Job, Overrides};
use crate::label::key;
use crate::plan::usage;

/// A dataset's folder.
pub struct Recorded {
    /// The folder.
    pub root: PathBuf,
    /// The job that made it, every default written out.
    pub job: Job,
    /// Its samples, splits and shards.
    pub layout: Layout,
}

impl Recorded {
    /// Opens the dataset at `root`.
    pub fn open(root: &Path) -> Result<Self, Report> {
        let path = root.join("job.toml");
        if !path.exists() {
            let message = format!("{} is no dataset: there is no job.toml in it", root.display());
            return Err(usage(message, "name the folder that `gelsim generate` wrote, the one with data/ and stats/"));
        }
        let mut problems = Problems::default();
        let written = config::read(&path, &Overrides::default(), &mut problems)?;
        if !problems.is_empty() {
            return Err(Report::new(&problems, &written.document.sources));
        }
        let dataset = &written.job.dataset;
        let layout = Layout::new(dataset.samples.unwrap_or(1), dataset.samples_per_shard, dataset.splits);
        Ok(Self { root: root.to_owned(), job: written.job, layout })
    }

    /// The files of sample `index`, which must be below the number of samples.
    pub fn sample(&self, index: u64) -> Result<Files, String> {
        let path = Paths::new(&self.root, &self.layout.shard_of(index)).tar;
        let key = key(index);
        let mut found = None;
        let visit = |files: Files| match files.key == key {
            true => {
                found = Some(files);
                ControlFlow::Break(())
            }
            false => ControlFlow::Continue(()),
        };
        let read = archive::open(&path, visit).and_then(|()| found.ok_or(format!("sample {key} is not in it")));
        read.map_err(|reason| format!("{}: {reason}", path.display()))
    }
}
