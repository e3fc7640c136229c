//! A dataset on disk, as its own job.toml describes it. The meshes and images from which it was made need not exist.

use crate::container::ShardContainer;
use std::ops::ControlFlow;
use std::path::{Path, PathBuf};

use super::archive::{MemberHead, SampleFiles};
use super::paths::ShardPaths;
use super::sensor_set::SensorSet;
use gelsim_files::diagnostic::user_error;
use gelsim_files::diagnostic::{Diagnostics, Report};
use gelsim_files::spelling::quote_for_shell;
use gelsim_files::store::StoreAddress;
use gelsim_job::config::object::Object;
use gelsim_job::config::output::Container;
use gelsim_job::config::{self, Job, Overrides};
use gelsim_job::label::sample_key;
use gelsim_job::layout::{Layout, Shard};
use gelsim_job::plan::{make_unique_ids, object_name};

/// A dataset's folder.
pub struct RecordedDataset {
    /// The folder.
    pub root: PathBuf,
    /// The job that made it, every default written out.
    pub job: Job,
    /// Its splits and shards.
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

/// Why the keys that a resolved job always has can be expected.
const RESOLVED_JOB_KEYS: &str = "a resolved job has a name, and of each object path and hash";

/// Finds the first key that every resolved job has and this one lacks.
fn find_missing_key(job: &Job) -> Option<String> {
    let object = |(i, object): (usize, &Object)| match (&object.path, &object.sha256) {
        (None, _) => Some(format!("object.{i}.path")),
        (_, None) => Some(format!("object.{i}.sha256")),
        _ => None,
    };
    let name = job.dataset.name.is_none().then(|| String::from("dataset.name"));
    name.or_else(|| job.object.iter().enumerate().find_map(object))
}

impl RecordedDataset {
    /// Opens the dataset at `root`. The error says what is wrong with its job.toml, and how to restore it.
    pub fn open(root: &Path) -> Result<Self, Report> {
        if StoreAddress::is_address(root) {
            let message = format!("{} is in an object store, and is read from a folder", root.display());
            return Err(user_error(
                message,
                "copy it, for example with `aws s3 sync` (docs/how-to/stores.md), and name the copy",
            ));
        }
        let path = root.join("job.toml");
        if let (false, Some(set)) = (path.exists(), SensorSet::find(root).ok().flatten()) {
            let message = format!("{} is a set of {} sensors, each a dataset", root.display(), set.sensors.len());
            let first = root.join(&set.sensors[0].folder);
            return Err(user_error(message, format!("name the folder of one of them, such as {}", first.display())));
        }
        if !path.exists() {
            let message = format!("{} is no dataset: there is no job.toml in it", root.display());
            if let Some(set) = SensorSet::find_owner(root) {
                let folder = quote_for_shell(&set);
                let help = format!("it belongs to a set: gelsim generate JOB.toml --out {folder} makes it again");
                return Err(user_error(message, help));
            }
            return Err(user_error(
                message,
                "name the folder that `gelsim generate` wrote, the one with data/ and stats/; a job.toml that was lost \
                 is written again by `gelsim generate JOB.toml --out` that folder",
            ));
        }
        let mut problems = Diagnostics::default();
        let written = config::read_job(&path, &Overrides::default(), &mut problems)?;
        if !problems.is_empty() {
            return Err(Report::new(&problems, &written.document.sources));
        }
        if let Some(key) = find_missing_key(&written.job) {
            let message = format!("{} has no `{key}`, as every dataset's job has", path.display());
            return Err(user_error(message, "it is written again by `gelsim generate JOB.toml --out` that folder"));
        }
        Ok(Self::new(root, written.job))
    }

    /// Returns the dataset of a resolved job at `root`.
    pub fn new(root: &Path, job: Job) -> Self {
        Self { root: root.to_owned(), layout: Layout::from_dataset(&job.dataset), job }
    }

    /// Returns the name of the dataset.
    pub fn name(&self) -> &str {
        self.job.dataset.name.as_deref().expect(RESOLVED_JOB_KEYS)
    }

    /// Returns the width and height of the images, px. With `right`, they are those of a gripper's right finger.
    pub fn resolution_px(&self, right: bool) -> [u32; 2] {
        let finger = self.job.gripper.as_ref().and_then(|gripper| gripper.right.as_deref()).filter(|_| right);
        finger.unwrap_or(&self.job.sensor).resolution_px
    }

    /// Returns true if the dataset has an index, which only tars have.
    pub fn has_index(&self) -> bool {
        self.job.output.container == Container::Tar
    }

    /// Returns the objects, in the order of the job.
    pub fn objects(&self) -> Vec<RecordedObject> {
        let entries = &self.job.object;
        let named =
            |entry: &Object| object_name(entry.path.as_deref().expect(RESOLVED_JOB_KEYS), entry.part.as_deref());
        let ids = make_unique_ids(entries.iter().map(named).collect());
        let objects = entries.iter().zip(ids).map(|(entry, id)| RecordedObject {
            class: entry.class.clone().unwrap_or_else(|| id.clone()),
            sha256: entry.sha256.clone().expect(RESOLVED_JOB_KEYS),
            id,
        });
        objects.collect()
    }

    /// Reads the files of sample `index`, which must be below the number of samples.
    pub fn read_sample(&self, index: u64) -> Result<SampleFiles, String> {
        let (shard, key) = (self.layout.shard_of(index), sample_key(index));
        let mut found = None;
        let visit = |files: SampleFiles| match files.key == key {
            true => {
                found = Some(files);
                ControlFlow::Break(())
            }
            false => ControlFlow::Continue(()),
        };
        let read = self.visit_samples(&shard, |head| head.key == key, visit);
        let read = read.and_then(|()| found.ok_or(format!("sample {key} is not in it")));
        read.map_err(|reason| format!("{}: {reason}", self.shard_paths(&shard).data.display()))
    }

    /// Calls `visit` with the samples of a shard, in order, until that breaks off. Only files for which `wanted`
    /// returns true are read.
    pub fn visit_samples(
        &self,
        shard: &Shard,
        wanted: impl FnMut(MemberHead<'_>) -> bool,
        visit: impl FnMut(SampleFiles) -> ControlFlow<()>,
    ) -> Result<(), String> {
        let ShardPaths { container, data, .. } = self.shard_paths(shard);
        container.visit_samples(&data, wanted, visit)
    }

    /// Returns the paths of a shard.
    pub fn shard_paths(&self, shard: &Shard) -> ShardPaths {
        ShardPaths::new(&self.root, shard, self.job.output.container)
    }
}
