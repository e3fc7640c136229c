//! A dataset on disk: shards, their stats, and the files that describe the whole.
//!
//! ```text
//! OUT/README.md  dataset.json  job.toml  wids.json
//! OUT/data/train-000000.tar    OUT/stats/train-000000.json
//! ```

pub mod archive;
pub mod card;
pub mod encode;
pub mod exr;
pub mod folder;
pub mod heights;
pub mod layout;
pub mod manifest;
pub mod names;
pub mod npy;
pub mod npz;
pub mod png;
pub mod recorded;
pub mod shard;
pub mod stats;
pub mod unpack;
pub mod verify;
pub mod versioned;
