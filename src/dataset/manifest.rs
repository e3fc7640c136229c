//! `dataset.json` and `wids.json`: what the dataset is and which shards it has.
//!
//! Neither holds a time, a host or an absolute path: they are the same for one run and for any division of it.

use std::collections::BTreeMap;

use serde::{Deserialize, Serialize};
use serde_json::json;

use super::recorded::{Recorded, RecordedObject};
use super::stats::Stats;
use super::versioned::Versioned;
use gelsim_job::config::output::Container;
use gelsim_job::label::SCHEMA_VERSION;
use gelsim_job::layers::DepthFormat;
use gelsim_job::layout::Split;
use gelsim_job::plan::{classes, fingerprint, level};

/// Version of the manifest's keys and their meaning.
pub const MANIFEST_VERSION: u32 = 1;

/// `dataset.json`.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct Manifest {
    /// [`MANIFEST_VERSION`] of the generator that wrote it.
    pub manifest_version: u32,
    /// Name of the dataset.
    pub name: String,
    /// What made it.
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
    /// What a shard is.
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

/// What made the dataset.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct Generator {
    /// Program.
    pub name: String,
    /// Version.
    pub version: String,
}

/// A class.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct Class {
    /// Its name.
    pub name: String,
    /// Its samples.
    pub samples: u64,
}

/// An object.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct ObjectEntry {
    /// Its name in labels.
    pub id: String,
    /// Its class.
    pub class: String,
    /// SHA-256 of the mesh file.
    pub mesh_sha256: String,
}

/// A shard.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct ShardEntry {
    /// The tar or folder, relative to the dataset's folder.
    pub file: String,
    /// Its split.
    pub split: String,
    /// Its samples.
    pub samples: u64,
    /// Its bytes.
    pub bytes: u64,
    /// Its SHA-256.
    pub sha256: String,
}

impl Versioned for Manifest {
    const NEWEST: u32 = MANIFEST_VERSION;

    fn version(&self) -> u32 {
        self.manifest_version
    }
}

impl Manifest {
    /// Describes a dataset from the stats of all its shards, in order.
    pub fn new(recorded: &Recorded, stats: &[Stats]) -> Self {
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
            fingerprint: fingerprint(job),
            label_schema_version: SCHEMA_VERSION,
            seed: job.dataset.seed,
            samples: layout.samples(),
            fidelity: level(job).name().to_owned(),
            layers: output.layers_in_order().iter().map(|layer| layer.suffix(output.depth_format)).collect(),
            depth_format: output.depth_format,
            container: output.container,
            splits: Split::ALL
                .into_iter()
                .map(|split| (split.name().to_owned(), layout.samples_in(split)))
                .filter(|(_, samples)| *samples > 0)
                .collect(),
            classes: classes(objects.iter().map(|object| object.class.as_str()))
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

    /// The WebDataset index (wids-shard-index-v1), which only tars have.
    pub fn wids(&self) -> Option<serde_json::Value> {
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
