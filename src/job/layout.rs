//! Which sample is in which split and which shard.
//!
//! The split of a sample depends on its number and the shares only, so it stays when samples are added. Splits are
//! interleaved evenly (Bresenham's line): the test split takes sample i when i * share passes a whole number, the
//! validation split likewise among the rest. Shares are held in whole billionths and all steps are exact, so that 200
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

    /// Its name in files and labels.
    pub fn name(self) -> &'static str {
        match self {
            Self::Train => "train",
            Self::Val => "val",
            Self::Test => "test",
        }
    }

    /// Its place in [`Split::ALL`].
    pub fn number(self) -> usize {
        self as usize
    }
}

/// The samples of a dataset, divided into splits and shards.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Layout {
    samples: u64,
    samples_per_shard: u64,
    /// Test samples among all samples.
    test: Share,
    /// Validation samples among those that are not test samples.
    val: Share,
}

/// A part of a whole, in billionths.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
struct Share {
    part: u128,
    whole: u128,
}

impl Share {
    /// How many of the first `count` are in the part.
    fn share_of(self, count: u64) -> u64 {
        (u128::from(count) * self.part / self.whole) as u64
    }

    fn holds(self, index: u64) -> bool {
        self.share_of(index + 1) > self.share_of(index)
    }

    /// Index of the member number `position` of the part.
    fn member(self, position: u64) -> u64 {
        ((u128::from(position) + 1) * self.whole).div_ceil(self.part) as u64 - 1
    }

    /// Index of the member number `position` of what is not in the part.
    fn rest(self, position: u64) -> u64 {
        (u128::from(position) * self.whole / (self.whole - self.part)) as u64
    }
}

/// One shard: consecutive members of one split.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Shard {
    /// Number in the dataset: all of train, then val, then test.
    pub number: u64,
    /// Its split.
    pub split: Split,
    /// Number within the split.
    pub in_split: u64,
    /// Position in the split of the first sample.
    pub first: u64,
    /// Number of samples.
    pub samples: u64,
}

impl Shard {
    /// Its name without folder and ending, such as `train-000000`.
    pub fn name(&self) -> String {
        format!("{}-{:06}", self.split.name(), self.in_split)
    }
}

impl Layout {
    /// That of a job, whose numbers need not be checked yet.
    pub fn from_dataset(dataset: &Dataset) -> Self {
        Self::new(dataset.samples.unwrap_or(1), dataset.samples_per_shard, dataset.splits)
    }

    /// `samples` samples; the shares are taken as parts of their sum. Sound for any numbers, so that it can be made
    /// before they are checked.
    pub fn new(samples: u64, samples_per_shard: u64, splits: Splits) -> Self {
        let [train, val, test] =
            [splits.train, splits.val, splits.test].map(|share| (share.clamp(0.0, 1.0) * 1e9).round() as u128);
        let all = (train + val + test).max(1);
        Self {
            samples,
            samples_per_shard: samples_per_shard.max(1),
            test: Share { part: test, whole: all },
            val: Share { part: val, whole: (train + val).max(1) },
        }
    }

    /// Number of samples in all.
    pub fn samples(&self) -> u64 {
        self.samples
    }

    /// Number of samples in a split.
    pub fn samples_in(&self, split: Split) -> u64 {
        let test = self.test.share_of(self.samples);
        let val = self.val.share_of(self.samples - test);
        match split {
            Split::Train => self.samples - test - val,
            Split::Val => val,
            Split::Test => test,
        }
    }

    /// The split of a sample, and its position there.
    pub fn split_of(&self, index: u64) -> (Split, u64) {
        let before = self.test.share_of(index);
        if self.test.holds(index) {
            return (Split::Test, before);
        }
        let rest = index - before;
        let before = self.val.share_of(rest);
        if self.val.holds(rest) { (Split::Val, before) } else { (Split::Train, rest - before) }
    }

    /// The sample at a position of a split: the inverse of [`Layout::split_of`].
    pub fn index_of(&self, split: Split, position: u64) -> u64 {
        match split {
            Split::Test => self.test.member(position),
            Split::Val => self.test.rest(self.val.member(position)),
            Split::Train => self.test.rest(self.val.rest(position)),
        }
    }

    /// Number of shards in all.
    pub fn shard_count(&self) -> u64 {
        Split::ALL.iter().map(|split| self.shards_in(*split)).sum()
    }

    fn shards_in(&self, split: Split) -> u64 {
        self.samples_in(split).div_ceil(self.samples_per_shard)
    }

    /// Shard number `number`, which must be below [`Layout::shard_count`].
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
        Shard { number, split, in_split, first, samples }
    }

    /// The shard that sample `index` is in.
    pub fn shard_of(&self, index: u64) -> Shard {
        let (split, position) = self.split_of(index);
        let before: u64 = Split::ALL[..split.number()].iter().map(|split| self.shards_in(*split)).sum();
        self.shard(before + position / self.samples_per_shard)
    }

    /// The samples of a shard, in order.
    pub fn indices(&self, shard: Shard) -> impl Iterator<Item = u64> + '_ {
        (shard.first..shard.first + shard.samples).map(move |position| self.index_of(shard.split, position))
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
                for (offset, index) in layout.indices(shard).enumerate() {
                    prop_assert_eq!(layout.split_of(index), (shard.split, shard.first + offset as u64));
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
