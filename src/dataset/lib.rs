//! A dataset on disk: shards, their stats, and the files that describe it.
//!
//! ```text
//! OUT/README.md  dataset.json  job.toml  wids.json
//! OUT/data/train-000000.tar    OUT/stats/train-000000.json    or the folder OUT/data/train-000000
//! ```

pub mod archive;
pub mod card;
pub mod cleanup;
pub mod container;
pub mod content;
pub mod dataset_error;
pub mod decode;
pub mod encode;
pub mod finalize;
pub mod folder;
pub mod forecast;
pub mod frames;
pub mod generate;
pub mod imagefolder;
pub mod labels;
pub mod lock;
pub mod logs;
pub mod manifest;
pub mod mirror;
pub mod paths;
pub mod recorded;
mod self_hash;
pub mod sensor_set;
pub mod shard;
pub mod spool;
pub mod stats;
pub mod verify;
pub mod versioned;
mod workers;
