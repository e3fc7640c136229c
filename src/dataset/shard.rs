//! Writes a shard on disk, a tar or a folder, so that it is either complete or absent.
//!
//! The order of steps makes every state after a crash recoverable: the shard is written beside its final place, synced
//! and renamed; then the stats file is written in the same way. A shard is complete if its stats file is there.

use crate::container::ShardContainer;
use gelsim_files::fail_point::Step;
use std::fs;
use std::io;
use std::path::PathBuf;

use super::archive::Member;
use super::lock::Lock;
use super::paths::ShardPaths;
use super::stats::ShardStats;
use super::{cleanup, container};
use gelsim_files::write::{sync_folder, write_atomically};
use gelsim_job::layout::Shard;

/// A shard that is being written.
pub struct ShardWriter {
    paths: ShardPaths,
    files: container::ContainerWriter,
    /// What is known of the shard so far. The caller counts each sample here that it appends.
    pub stats: ShardStats,
    finished: bool,
    _lock: Lock,
}

impl ShardWriter {
    /// Starts a shard. The caller has taken its lock.
    pub fn create(paths: ShardPaths, lock: Lock, shard: &Shard, fingerprint: &str) -> io::Result<Self> {
        let files = paths.container.create(&paths.partial, &paths.data, shard)?;
        Step::ShardBegun.pause_if_requested(&paths.data);
        let stats = ShardStats::new(shard, paths.container, fingerprint);
        Ok(Self { paths, files, stats, finished: false, _lock: lock })
    }

    /// Appends the files of a sample. Samples must come in the order of the shard.
    pub fn append(&mut self, key: &str, members: &[Member]) -> io::Result<()> {
        self.files.append(key, members)?;
        Step::SampleAppended.pause_if_requested(&self.paths.data);
        Ok(())
    }

    /// Brings the shard to disk under its final name, then its stats. The error names the file that could not be
    /// written.
    pub fn finish(mut self) -> Result<ShardStats, (PathBuf, io::Error)> {
        self.finish_files().map_err(|error| (self.paths.partial.clone(), error))?;
        self.write_stats().map_err(|error| (self.paths.stats.clone(), error))?;
        Ok(self.stats.clone())
    }

    fn finish_files(&mut self) -> io::Result<()> {
        (self.stats.bytes, self.stats.sha256) = self.files.finish(&self.paths.partial)?;
        Step::ShardSynced.pause_if_requested(&self.paths.data);
        // Stats of an earlier, damaged shard are removed first: they must not vouch for the new one, even for a moment.
        match fs::remove_file(&self.paths.stats) {
            Err(error) if error.kind() != io::ErrorKind::NotFound => return Err(error),
            _ => {}
        }
        Step::OldStatsRemoved.pause_if_requested(&self.paths.data);
        self.paths.container.put_in_place(&self.paths.partial, &self.paths.data)?;
        Step::ShardInPlace.pause_if_requested(&self.paths.data);
        self.finished = true;
        sync_folder(&self.paths.data)
    }

    fn write_stats(&self) -> io::Result<()> {
        write_atomically(&self.paths.stats, self.stats.to_text()?.as_bytes())
    }
}

impl Drop for ShardWriter {
    fn drop(&mut self) {
        if !self.finished {
            // After an error or a stop, the partial shard is of no use: the next run would begin it anew.
            let _ = cleanup::remove_path(&self.paths.partial);
        }
    }
}
