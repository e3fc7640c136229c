//! One shard on disk: a tar or a folder, whole or not there at all.
//!
//! The order of events makes every state after a crash recoverable: the shard is written beside its final place, synced,
//! renamed; then the stats file, likewise. A shard is complete if its stats file is there.

use crate::container::ShardContainer;
use gelsim_files::fail_point::Step;
use std::fs;
use std::io;
use std::path::PathBuf;

use super::archive::Member;
use super::lock::Lock;
use super::paths::Paths;
use super::stats::Stats;
use super::{cleanup, container};
use gelsim_files::write::{sync_folder, write_whole};
use gelsim_job::layout::Shard;

/// A shard being written.
pub struct Writer {
    paths: Paths,
    files: container::Writer,
    /// What is known of the shard so far; whoever appends samples counts them here.
    pub stats: Stats,
    finished: bool,
    _lock: Lock,
}

impl Writer {
    /// Starts a shard of which the lock is held.
    pub fn create(paths: Paths, lock: Lock, shard: &Shard, fingerprint: &str) -> io::Result<Self> {
        let files = paths.container.create(&paths.partial, &paths.data, shard)?;
        Step::ShardBegun.reached(&paths.data);
        let stats = Stats::new(shard, paths.container, fingerprint);
        Ok(Self { paths, files, stats, finished: false, _lock: lock })
    }

    /// Appends a sample's files. Samples must come in the order of the shard.
    pub fn append(&mut self, key: &str, members: &[Member]) -> io::Result<()> {
        self.files.append(key, members)?;
        Step::SampleAppended.reached(&self.paths.data);
        Ok(())
    }

    /// Brings the shard to disk under its final name, then its stats. On failure, the file that could not be written.
    pub fn finish(mut self) -> Result<Stats, (PathBuf, io::Error)> {
        self.finish_files().map_err(|error| (self.paths.partial.clone(), error))?;
        self.write_stats().map_err(|error| (self.paths.stats.clone(), error))?;
        Ok(self.stats.clone())
    }

    fn finish_files(&mut self) -> io::Result<()> {
        (self.stats.bytes, self.stats.sha256) = self.files.finish(&self.paths.partial)?;
        Step::ShardSynced.reached(&self.paths.data);
        // A stats file of an earlier, damaged shard must not vouch for the new one while both are exchanged.
        match fs::remove_file(&self.paths.stats) {
            Err(error) if error.kind() != io::ErrorKind::NotFound => return Err(error),
            _ => {}
        }
        Step::OldStatsRemoved.reached(&self.paths.data);
        self.paths.container.put_in_place(&self.paths.partial, &self.paths.data)?;
        Step::ShardInPlace.reached(&self.paths.data);
        self.finished = true;
        sync_folder(&self.paths.data)
    }

    fn write_stats(&self) -> io::Result<()> {
        write_whole(&self.paths.stats, self.stats.to_text()?.as_bytes())
    }
}

impl Drop for Writer {
    fn drop(&mut self) {
        if !self.finished {
            // After an error or a stop: what is left behind would only be overwritten.
            let _ = cleanup::remove(&self.paths.partial);
        }
    }
}
