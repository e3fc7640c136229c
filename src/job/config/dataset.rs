//! `[dataset]`: the number of samples, their seed, shards and splits.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// The `[dataset]` table.
#[derive(Clone, Debug, Serialize, Deserialize, JsonSchema)]
#[serde(default, deny_unknown_fields)]
pub struct Dataset {
    /// Name of the dataset: letters, digits, `-`, `_` and `.`; the default output folder is `out/NAME`.
    #[schemars(required)]
    pub name: Option<String>,
    /// Number of samples, at least 1.
    #[schemars(required)]
    pub samples: Option<u64>,
    /// Seed from which all randomness comes, 0 to 2^53 - 1.
    pub seed: u64,
    /// Seed of what belongs to the sensor and not to the press, such as noise, markers and what `[sensor.unit]` draws;
    /// `seed` if left out. Jobs with one `seed` and different ones of these press the same objects in the same way.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub sensor_seed: Option<u64>,
    /// Samples in a full shard, 1 to 1,000,000.
    pub samples_per_shard: u64,
    /// Fraction of the samples in each split; the fractions sum to 1.
    pub splits: Splits,
    /// Whether samples or objects are divided between the splits.
    pub split_by: SplitBy,
    /// How a sample gets its object.
    pub object_order: ObjectOrder,
}

impl Default for Dataset {
    fn default() -> Self {
        Self {
            name: None,
            samples: None,
            seed: 0,
            sensor_seed: None,
            samples_per_shard: 100,
            splits: Splits { train: 1.0, val: 0.0, test: 0.0 },
            split_by: SplitBy::default(),
            object_order: ObjectOrder::default(),
        }
    }
}

/// Fractions of the splits.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(default, deny_unknown_fields)]
pub struct Splits {
    /// Fraction for training.
    pub train: f64,
    /// Fraction for validation.
    pub val: f64,
    /// Fraction for testing.
    pub test: f64,
}

impl Splits {
    /// Returns the fractions in the order of the splits.
    pub fn shares(&self) -> [f64; 3] {
        [self.train, self.val, self.test]
    }
}

/// What is kept together when the dataset is split.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum SplitBy {
    /// Every split sees every object.
    #[default]
    Sample,
    /// All samples of an object are in one split, so that the objects of the test split are unseen in training.
    Object,
}

impl SplitBy {
    /// Returns the name in a job.
    pub fn name(self) -> &'static str {
        match self {
            Self::Sample => "sample",
            Self::Object => "object",
        }
    }
}

/// How a sample gets its object.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum ObjectOrder {
    /// Drawn at random by weight, but evenly: if all classes weigh the same, every class of a split occurs among as
    /// many consecutive samples of the split as it has classes.
    #[default]
    Weighted,
    /// One object after the other, in the order of the job, again and again. Weights are not used.
    InTurn,
}
