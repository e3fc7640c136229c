//! A dataset that is there, as its own job.toml describes it. The meshes and pictures it was made from need not be.

use crate::container::ShardContainer;
use std::ops::ControlFlow;
use std::path::{Path, PathBuf};

use super::archive::{Files, Head};
use super::paths::Paths;
use gelsim_files::diagnostic::user_error;
use gelsim_files::diagnostic::{Diagnostics, Report};
use gelsim_files::store::Address;
use gelsim_job::config::object::Object;
use gelsim_job::config::output::Container;
use gelsim_job::config::{self, Job, Overrides};
use gelsim_job::label::key;
use gelsim_job::layout::{Layout, Shard};
use gelsim_job::plan::{ids, name};

/// A dataset's folder.
pub struct Recorded {
    /// The folder.
    pub root: PathBuf,
    /// The job that made it, every default written out.
    pub job: Job,
    /// Its samples, splits and shards.
    pub layout: Layout,
}

/// An object as the job records it.
pub struct RecordedObject {
    /// Unique name in the labels.
    pub id: String,
    /// Class in the labels.
    pub class: String,
    /// SHA-256 of the mesh file.
    pub sha256: String,
}

const RESOLVED: &str = "a resolved job has a name, and of each object path and hash";

/// The first key that every resolved job has and this one does not.
fn missing(job: &Job) -> Option<String> {
    let object = |(i, object): (usize, &Object)| match (&object.path, &object.sha256) {
        (None, _) => Some(format!("object.{i}.path")),
        (_, None) => Some(format!("object.{i}.sha256")),
        _ => None,
    };
    let name = job.dataset.name.is_none().then(|| String::from("dataset.name"));
    name.or_else(|| job.object.iter().enumerate().find_map(object))
}

impl Recorded {
    /// Opens the dataset at `root`.
    pub fn open(root: &Path) -> Result<Self, Report> {
        if Address::is_one(root) {
            let message = format!("{} is in an object store, and is read from a folder", root.display());
            return Err(user_error(
                message,
                "copy it, for example with `aws s3 sync` (docs/stores.md), and name the copy",
            ));
        }
        let path = root.join("job.toml");
        if !path.exists() {
            let message = format!("{} is no dataset: there is no job.toml in it", root.display());
            return Err(user_error(
                message,
                "name the folder that `gelsim generate` wrote, the one with data/ and stats/; a job.toml that was lost \
                 is written again by `gelsim generate JOB.toml --out` that folder",
            ));
        }
        let mut problems = Diagnostics::default();
        let written = config::read(&path, &Overrides::default(), &mut problems)?;
        if !problems.is_empty() {
            return Err(Report::new(&problems, &written.document.sources));
        }
        if let Some(key) = missing(&written.job) {
            let message = format!("{} has no `{key}`, as every dataset's job has", path.display());
            return Err(user_error(message, "it is written again by `gelsim generate JOB.toml --out` that folder"));
        }
        Ok(Self::new(root, written.job))
    }

    /// The dataset of a resolved job at `root`.
    pub fn new(root: &Path, job: Job) -> Self {
        Self { root: root.to_owned(), layout: Layout::from_dataset(&job.dataset), job }
    }

    /// Its name.
    pub fn name(&self) -> &str {
        self.job.dataset.name.as_deref().expect(RESOLVED)
    }

    /// Width and height of the images, px; of a gripper's right finger, if it is that.
    pub fn resolution_px(&self, right: bool) -> [u32; 2] {
        let finger = self.job.gripper.as_ref().and_then(|gripper| gripper.right.as_deref()).filter(|_| right);
        finger.unwrap_or(&self.job.sensor).resolution_px
    }

    /// True if it has an index of its tars.
    pub fn has_index(&self) -> bool {
        self.job.output.container == Container::Tar
    }

    /// The objects, in the order of the job.
    pub fn objects(&self) -> Vec<RecordedObject> {
        let entries = &self.job.object;
        let named = |entry: &Object| name(entry.path.as_deref().expect(RESOLVED), entry.part.as_deref());
        let ids = ids(entries.iter().map(named).collect());
        let objects = entries.iter().zip(ids).map(|(entry, id)| RecordedObject {
            class: entry.class.clone().unwrap_or_else(|| id.clone()),
            sha256: entry.sha256.clone().expect(RESOLVED),
            id,
        });
        objects.collect()
    }

    /// The files of sample `index`, which must be below the number of samples.
    pub fn sample(&self, index: u64) -> Result<Files, String> {
        let (shard, key) = (self.layout.shard_of(index), key(index));
        let mut found = None;
        let visit = |files: Files| match files.key == key {
            true => {
                found = Some(files);
                ControlFlow::Break(())
            }
            false => ControlFlow::Continue(()),
        };
        let read = self.read(&shard, |head| head.key == key, visit);
        let read = read.and_then(|()| found.ok_or(format!("sample {key} is not in it")));
        read.map_err(|reason| format!("{}: {reason}", self.paths(&shard).data.display()))
    }

    /// Shows the samples of a shard to `visit`, in order, with those of their files that are `wanted`; the others are not
    /// read.
    pub fn read(
        &self,
        shard: &Shard,
        wanted: impl FnMut(Head<'_>) -> bool,
        visit: impl FnMut(Files) -> ControlFlow<()>,
    ) -> Result<(), String> {
        let Paths { container, data, .. } = self.paths(shard);
        container.read(&data, wanted, visit)
    }

    /// The names of a shard.
    pub fn paths(&self, shard: &Shard) -> Paths {
        Paths::new(&self.root, shard, self.job.output.container)
    }
}
