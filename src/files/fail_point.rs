//! Steps of a dataset's life at which a test can hold a run, to kill it there or to change what it has written.
//!
//! The environment variable [`FAIL_POINT_VARIABLE`] names a step and, after a colon, a shard or file if only one is
//! meant: `shard renamed: train-000002`. A run that reaches the step reports it on standard error and waits for a line,
//! or the end, of its standard input. Nothing is ended or changed here: if the variable is set by mistake, it costs a
//! message and a keypress. If it is not set, a step only checks that.

use std::io::{self, Write};
use std::path::Path;
use std::sync::OnceLock;

/// The environment variable that names a step.
pub const FAIL_POINT_VARIABLE: &str = "GELSIM_FAIL_POINT";

macro_rules! steps {
    ($($step:ident, $name:literal, $what:literal;)*) => {
        /// A step, named by what has just been done.
        #[derive(Clone, Copy, Debug, PartialEq, Eq)]
        pub enum Step { $(#[doc = $what] $step,)* }

        impl Step {
            /// All steps, in the order of a dataset's life.
            pub const ALL: &[Self] = &[$(Self::$step),*];

            /// Returns the step's name in [`FAIL_POINT_VARIABLE`].
            pub fn name(self) -> &'static str {
                match self { $(Self::$step => $name,)* }
            }
        }
    };
}

steps! {
    OldShardRemoved, "old shard removed", "A shard, or its stats, of the dataset to be replaced is gone.";
    OldFolderRemoved, "old folder removed", "One of the folders of the dataset to be replaced is gone.";
    OldFileRemoved, "old file removed", "A file that described a dataset to be replaced, or to grow, is gone.";
    FoldersMade, "folders made", "The dataset's folders are there.";
    DatasetLocked, "dataset locked", "Nobody else begins or describes the dataset.";
    FileBegun, "file begun", "An empty file stands beside the place of one that must be complete or absent.";
    FileWritten, "file written", "That file is written and synced.";
    FileRenamed, "file renamed", "That file has its name.";
    ShardLocked, "shard locked", "Nobody else writes the shard.";
    ShardBegun, "shard begun", "The shard is there under its partial name, empty.";
    SampleAppended, "sample appended", "One more sample is in the partial shard, or in the buffer before it.";
    ShardWritten, "shard written", "All samples are in the partial shard.";
    ShardSynced, "shard synced", "The partial shard is on disk.";
    OldStatsRemoved, "old stats removed", "No stats vouch for what is in the shard's place.";
    OldShardAside, "old shard aside", "The shard's place is free: a folder that was there has another name.";
    ShardRenamed, "shard renamed", "The shard has its final name.";
    ShardInPlace, "shard in place", "The folder that was there before is gone.";
    ShardDone, "shard done", "The shard has stats and is no longer locked.";
    DatasetChecked, "dataset checked", "All shards have been found.";
    DatasetSwept, "dataset swept", "Nothing is left of killed runs.";
    DatasetDescribed, "dataset described", "The dataset is complete, and its index and card are written.";
}

impl Step {
    /// Waits if [`FAIL_POINT_VARIABLE`] names this step. If it also names a file, it must be that of `path`, with or
    /// without its extension and the suffix of a partial file.
    pub fn pause_if_requested(self, path: &Path) {
        static HELD: OnceLock<Option<String>> = OnceLock::new();
        if let Some(held) = HELD.get_or_init(|| std::env::var(FAIL_POINT_VARIABLE).ok())
            && let Some(of) = held.strip_prefix(self.name())
        {
            let name = path.file_name().unwrap_or_default().to_string_lossy();
            let name = name.trim_start_matches('.').trim_end_matches(".partial");
            let this = of.strip_prefix(": ").map_or(of.is_empty(), |of| {
                name.strip_prefix(of).is_some_and(|ending| ending.is_empty() || ending.starts_with('.'))
            });
            if this {
                // If nobody listens or answers, the run goes on.
                let _ = writeln!(io::stderr(), "{FAIL_POINT_VARIABLE}: {}: {name}; waiting for a line", self.name());
                let _ = io::stdin().read_line(&mut String::new());
            }
        }
    }
}
