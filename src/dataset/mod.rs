//! A dataset on disk: shards, their stats, and the files that describe the whole.
//!
//! ```text
//! OUT/README.md  dataset.json  job.toml  wids.json
//! OUT/data/train-000000.tar    OUT/stats/train-000000.json    or the folder OUT/data/train-000000
//! ```

pub mod archive;
pub mod card;
pub mod container;
pub mod content;
pub mod decode;
pub mod encode;
pub mod exr;
pub mod finalize;
pub mod folder;
pub mod heights;
pub mod imagefolder;
pub mod layout;
pub mod manifest;
pub mod names;
pub mod npy;
pub mod npz;
pub mod png;
pub mod png16;
pub mod recorded;
pub mod shard;
pub mod stats;
pub mod unpack;
pub mod verify;
pub mod versioned;
