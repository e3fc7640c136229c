//! Where the files of a shard are in a dataset's folder.

use crate::container::ShardContainer;
use std::path::{Path, PathBuf};

use gelsim_job::config::output::Container;
use gelsim_job::layout::Shard;

/// The names that a shard has on disk.
#[derive(Clone, Debug)]
pub struct Paths {
    /// What the shard is.
    pub container: Container,
    /// The tar or folder.
    pub data: PathBuf,
    /// The same while it is written.
    pub partial: PathBuf,
    /// The stats file.
    pub stats: PathBuf,
    /// The lock file.
    pub lock: PathBuf,
}

impl Paths {
    /// The names of `shard` in the dataset at `root`.
    pub fn new(root: &Path, shard: &Shard, container: Container) -> Self {
        let (name, file_name) = (shard.name(), container.file_name(shard));
        let data = root.join("data");
        Self {
            container,
            partial: data.join(format!(".{file_name}.partial")),
            stats: root.join("stats").join(format!("{name}.json")),
            lock: data.join(format!(".{name}.lock")),
            data: data.join(file_name),
        }
    }
}
