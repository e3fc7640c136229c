//! Assigns samples to splits and shards.
//!
//! The split of a sample depends only on its number and the fractions, so it stays when samples are added. Splits are
//! interleaved evenly (Bresenham's line): the test split takes sample i if i * fraction passes a whole number, and the
//! validation split does so among the rest. Fractions are kept in whole billionths and all steps are exact, so that 200
//! samples at 0.8 / 0.1 / 0.1 are 160, 20 and 20.

use serde::{Deserialize, Serialize};

use crate::config::dataset::{Dataset, Splits};

/// A split of a dataset.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize, schemars::JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum Split {
    /// For training.
    Train,
    /// For validation.
    Val,
    /// For testing.
    Test,
}

impl Split {
    /// All splits, in the order of their shards.
    pub const ALL: [Self; 3] = [Self::Train, Self::Val, Self::Test];

    /// Returns the name in files and labels.
    pub fn name(self) -> &'static str {
        match self {
            Self::Train => "train",
            Self::Val => "val",
            Self::Test => "test",
        }
    }

    /// Returns the index in [`Split::ALL`].
    pub fn number(self) -> usize {
        self as usize
    }
}

/// The samples of a dataset, divided into splits and shards.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Layout {
    samples: u64,
    samples_per_shard: u64,
    /// Test samples, as a fraction of all samples.
    test: Fraction,
    /// Validation samples, as a fraction of those that are not test samples.
    val: Fraction,
}

/// An exact fraction, in billionths.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
struct Fraction {
    numerator: u128,
    denominator: u128,
}

impl Fraction {
    /// Returns how many of the first `count` samples are in the part.
    fn count_in_part(self, count: u64) -> u64 {
        (u128::from(count) * self.numerator / self.denominator) as u64
    }

    fn contains_index(self, index: u64) -> bool {
        self.count_in_part(index + 1) > self.count_in_part(index)
    }

    /// Returns the index of the member number `position` of the part.
    fn member_index(self, position: u64) -> u64 {
        ((u128::from(position) + 1) * self.denominator).div_ceil(self.numerator) as u64 - 1
    }

    /// Returns the index of the sample number `position` that is not in the part.
    fn non_member_index(self, position: u64) -> u64 {
        (u128::from(position) * self.denominator / (self.denominator - self.numerator)) as u64
    }
}

/// A shard: consecutive members of one split.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Shard {
    /// Number in the dataset: all of train, then val, then test.
    pub number: u64,
    /// The split.
    pub split: Split,
    /// Number within the split.
    pub number_in_split: u64,
    /// Position of the first sample in the split.
    pub first_position: u64,
    /// Number of samples.
    pub samples: u64,
}

impl Shard {
    /// Returns the name without folder and extension, such as `train-000000`.
    pub fn name(&self) -> String {
        format!("{}-{:06}", self.split.name(), self.number_in_split)
    }
}

impl Layout {
    /// Makes the layout of a job, whose numbers need not be checked yet.
    pub fn from_dataset(dataset: &Dataset) -> Self {
        Self::new(dataset.samples.unwrap_or(1), dataset.samples_per_shard, dataset.splits)
    }

    /// Makes the layout of `samples` samples. The fractions are taken relative to their sum. It works for any numbers,
    /// so that it can be made before they are checked.
    pub fn new(samples: u64, samples_per_shard: u64, splits: Splits) -> Self {
        let [train, val, test] =
            [splits.train, splits.val, splits.test].map(|share| (share.clamp(0.0, 1.0) * 1e9).round() as u128);
        let all = (train + val + test).max(1);
        Self {
            samples,
            samples_per_shard: samples_per_shard.max(1),
            test: Fraction { numerator: test, denominator: all },
            val: Fraction { numerator: val, denominator: (train + val).max(1) },
        }
    }

    /// Returns the number of samples in all splits.
    pub fn sample_count(&self) -> u64 {
        self.samples
    }

    /// Returns the number of samples in a split.
    pub fn samples_in(&self, split: Split) -> u64 {
        let test = self.test.count_in_part(self.samples);
        let val = self.val.count_in_part(self.samples - test);
        match split {
            Split::Train => self.samples - test - val,
            Split::Val => val,
            Split::Test => test,
        }
    }

    /// Returns the split of a sample, and its position there.
    pub fn split_of(&self, index: u64) -> (Split, u64) {
        let before = self.test.count_in_part(index);
        if self.test.contains_index(index) {
            return (Split::Test, before);
        }
        let rest = index - before;
        let before = self.val.count_in_part(rest);
        if self.val.contains_index(rest) { (Split::Val, before) } else { (Split::Train, rest - before) }
    }

    /// Returns the sample at a position of a split: the inverse of [`Layout::split_of`].
    pub fn index_of(&self, split: Split, position: u64) -> u64 {
        match split {
            Split::Test => self.test.member_index(position),
            Split::Val => self.test.non_member_index(self.val.member_index(position)),
            Split::Train => self.test.non_member_index(self.val.non_member_index(position)),
        }
    }

    /// Returns the number of shards in all splits.
    pub fn shard_count(&self) -> u64 {
        Split::ALL.iter().map(|split| self.shards_in(*split)).sum()
    }

    fn shards_in(&self, split: Split) -> u64 {
        self.samples_in(split).div_ceil(self.samples_per_shard)
    }

    /// Returns the shard number `number`, which must be below [`Layout::shard_count`].
    pub fn shard(&self, number: u64) -> Shard {
        let mut in_split = number;
        let mut split = Split::Train;
        for candidate in Split::ALL {
            split = candidate;
            let count = self.shards_in(candidate);
            if in_split < count {
                break;
            }
            in_split -= count;
        }
        let first = in_split * self.samples_per_shard;
        let samples = self.samples_per_shard.min(self.samples_in(split).saturating_sub(first));
        Shard { number, split, number_in_split: in_split, first_position: first, samples }
    }

    /// Returns the shard that sample `index` is in.
    pub fn shard_of(&self, index: u64) -> Shard {
        let (split, position) = self.split_of(index);
        let before: u64 = Split::ALL[..split.number()].iter().map(|split| self.shards_in(*split)).sum();
        self.shard(before + position / self.samples_per_shard)
    }

    /// Iterates over the samples of a shard, in order.
    pub fn sample_indices(&self, shard: Shard) -> impl Iterator<Item = u64> + '_ {
        (shard.first_position..shard.first_position + shard.samples)
            .map(move |position| self.index_of(shard.split, position))
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    #[test]
    fn shares_that_divide_evenly_are_met_exactly() {
        let layout = Layout::new(200, 100, Splits { train: 0.8, val: 0.1, test: 0.1 });
        assert_eq!(Split::ALL.map(|split| layout.samples_in(split)), [160, 20, 20]);
        let names: Vec<String> = (0..layout.shard_count()).map(|n| layout.shard(n).name()).collect();
        assert_eq!(names, ["train-000000", "train-000001", "val-000000", "test-000000"]);
        assert_eq!(layout.shard(1).samples, 60);
    }

    proptest! {
        #[test]
        fn every_sample_is_in_exactly_one_shard(
            samples in 1..2000_u64, per_shard in 1..300_u64, val in 0..=10_u32, test in 0..=10_u32,
        ) {
            let share = |parts: u32| f64::from(parts) / 20.0;
            let splits = Splits { train: share(20 - val - test), val: share(val), test: share(test) };
            let layout = Layout::new(samples, per_shard, splits);
            let mut seen = vec![false; samples as usize];
            for number in 0..layout.shard_count() {
                let shard = layout.shard(number);
                prop_assert!(shard.samples > 0 && shard.samples <= per_shard);
                for (offset, index) in layout.sample_indices(shard).enumerate() {
                    prop_assert_eq!(layout.split_of(index), (shard.split, shard.first_position + offset as u64));
                    prop_assert_eq!(layout.shard_of(index), shard);
                    prop_assert!(!std::mem::replace(&mut seen[index as usize], true));
                }
            }
            prop_assert!(seen.iter().all(|seen| *seen));
        }

        #[test]
        fn a_sample_keeps_its_split_when_samples_are_added(index in 0..1000_u64, more in 1..100_000_u64) {
            let splits = Splits { train: 0.7, val: 0.2, test: 0.1 };
            let small = Layout::new(index + 1, 10, splits);
            let large = Layout::new(index + 1 + more, 10, splits);
            prop_assert_eq!(small.split_of(index), large.split_of(index));
        }
    }
}
