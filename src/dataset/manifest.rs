//! Makes `dataset.json` and `wids.json`, which say what the dataset is and which shards it has.
//!
//! Neither holds a time, a host or an absolute path: they are the same whether one run made the dataset or many.

use std::collections::BTreeMap;

use serde::{Deserialize, Serialize};
use serde_json::json;

use super::recorded::{RecordedDataset, RecordedObject};
use super::stats::ShardStats;
use super::versioned::Versioned;
use gelsim_job::config::output::Container;
use gelsim_job::label::SCHEMA_VERSION;
use gelsim_job::layers::DepthFormat;
use gelsim_job::layout::Split;
use gelsim_job::plan::{compute_fingerprint, job_fidelity, list_classes};

/// Version of the manifest's keys and their meaning.
pub const MANIFEST_VERSION: u32 = 1;

/// The content of `dataset.json`.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct Manifest {
    /// [`MANIFEST_VERSION`] of the generator that wrote it.
    pub manifest_version: u32,
    /// Name of the dataset.
    pub name: String,
    /// The program that made it.
    pub generator: Generator,
    /// SHA-256 over everything that decides the bytes of a sample.
    pub fingerprint: String,
    /// Version of the labels' schema.
    pub label_schema_version: u32,
    /// Seed of all randomness.
    pub seed: u64,
    /// Number of samples.
    pub samples: u64,
    /// Fidelity level.
    pub fidelity: String,
    /// Layers beside the tactile image.
    pub layers: Vec<String>,
    /// Format of the float layers among them.
    #[serde(default)]
    pub depth_format: DepthFormat,
    /// Whether shards are tars or folders.
    #[serde(default)]
    pub container: Container,
    /// Samples per split.
    pub splits: BTreeMap<String, u64>,
    /// Classes in the order of their `class_index`, with their samples.
    pub classes: Vec<Class>,
    /// The objects.
    pub objects: Vec<ObjectEntry>,
    /// The shards, in order.
    pub shards: Vec<ShardEntry>,
}

/// The program that made the dataset.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct Generator {
    /// Name of the program.
    pub name: String,
    /// Version of the program.
    pub version: String,
}

/// A class.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct Class {
    /// Name of the class.
    pub name: String,
    /// Number of its samples.
    pub samples: u64,
}

/// An object of the dataset.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct ObjectEntry {
    /// Name in the labels.
    pub id: String,
    /// Class in the labels.
    pub class: String,
    /// SHA-256 of the mesh file.
    pub mesh_sha256: String,
}

/// A shard of the dataset.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct ShardEntry {
    /// The tar or folder, relative to the dataset's folder.
    pub file: String,
    /// Split to which it belongs.
    pub split: String,
    /// Number of samples.
    pub samples: u64,
    /// Size of the tar, or of the folder's files, bytes.
    pub bytes: u64,
    /// SHA-256 of the tar, or the checksum of the folder.
    pub sha256: String,
}

impl Versioned for Manifest {
    const NEWEST: u32 = MANIFEST_VERSION;

    fn from_json(text: &[u8]) -> serde_json::Result<Self> {
        serde_json::from_slice(text)
    }

    fn version(&self) -> u32 {
        self.manifest_version
    }
}

impl Manifest {
    /// Makes the manifest from the stats of all shards of a dataset, in order.
    pub fn new(recorded: &RecordedDataset, stats: &[ShardStats]) -> Self {
        let (job, layout, objects) = (&recorded.job, &recorded.layout, recorded.objects());
        let output = &job.output;
        let samples_of = |class: &str| stats.iter().filter_map(|stats| stats.classes.get(class)).sum();
        let shards = stats.iter().enumerate().map(|(number, stats)| ShardEntry {
            file: stats.file.clone(),
            split: layout.shard(number as u64).split.name().to_owned(),
            samples: stats.samples,
            bytes: stats.bytes,
            sha256: stats.sha256.clone(),
        });
        Self {
            manifest_version: MANIFEST_VERSION,
            name: recorded.name().to_owned(),
            generator: Generator { name: "gelsim".to_owned(), version: env!("CARGO_PKG_VERSION").to_owned() },
            fingerprint: compute_fingerprint(job),
            label_schema_version: SCHEMA_VERSION,
            seed: job.dataset.seed,
            samples: layout.sample_count(),
            fidelity: job_fidelity(job).name().to_owned(),
            layers: output.layers_in_order().iter().map(|layer| layer.file_suffix(output.depth_format)).collect(),
            depth_format: output.depth_format,
            container: output.container,
            splits: Split::ALL
                .into_iter()
                .map(|split| (split.name().to_owned(), layout.samples_in(split)))
                .filter(|(_, samples)| *samples > 0)
                .collect(),
            classes: list_classes(objects.iter().map(|object| object.class.as_str()))
                .into_iter()
                .map(|name| Class { samples: samples_of(&name), name })
                .collect(),
            objects: objects
                .into_iter()
                .map(|RecordedObject { id, class, sha256 }| ObjectEntry { id, class, mesh_sha256: sha256 })
                .collect(),
            shards: shards.collect(),
        }
    }

    /// Returns the WebDataset index (wids-shard-index-v1), or `None` for a dataset of folders.
    pub fn to_wids_index(&self) -> Option<serde_json::Value> {
        let shards: Vec<_> = self
            .shards
            .iter()
            .map(|shard| json!({ "url": shard.file, "nsamples": shard.samples, "filesize": shard.bytes }))
            .collect();
        (self.container == Container::Tar).then(|| {
            json!({
                "__kind__": "wids-shard-index-v1",
                "wids_version": 1,
                "name": self.name,
                "shardlist": shards,
            })
        })
    }
}
