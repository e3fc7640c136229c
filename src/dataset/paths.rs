//! The paths of a shard's files in a dataset's folder.

use crate::container::ShardContainer;
use std::path::{Path, PathBuf};

use gelsim_job::config::output::Container;
use gelsim_job::layout::Shard;

/// The paths of a shard.
#[derive(Clone, Debug)]
pub struct ShardPaths {
    /// Whether the shard is a tar or a folder.
    pub container: Container,
    /// The tar or folder.
    pub data: PathBuf,
    /// The tar or folder while it is written.
    pub partial: PathBuf,
    /// The stats file.
    pub stats: PathBuf,
    /// The lock file.
    pub lock: PathBuf,
}

impl ShardPaths {
    /// Returns the paths of `shard` in the dataset at `root`.
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
