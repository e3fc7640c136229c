//! Chooses the object of each sample.
//!
//! Within a split samples are numbered from 0. As many consecutive samples as the split has classes are a block. A
//! block has each class as often as its weight says, rounded up or down, in a random order, so that even a split of a
//! few samples has every class. This is systematic sampling: with weights laid end to end from 0 to 1, slot j of n
//! takes the class at (j + offset) / n. Offsets follow the golden ratio from block to block, so that fractions even out
//! (Weyl 1916). An object's split and its place there do not depend on the number of samples, and neither does what is
//! drawn here.

use std::collections::BTreeMap;

use gelsim_core::base::rng::{self, RandomStream};

/// How the objects of a split are chosen.
#[derive(Clone, Debug)]
pub enum ObjectSampler {
    /// By weight, evenly over the split.
    Weighted(WeightedSampler),
    /// One after the other.
    InTurn(Vec<usize>),
}

/// Chooses objects by weight.
#[derive(Clone, Debug)]
pub struct WeightedSampler {
    /// Number of the split, which selects the random streams.
    split: u64,
    /// For each class, in the order of names: the indices of its objects with the running sum of their weights, and the
    /// running sum of the classes' weights.
    classes: Vec<(Vec<(usize, f64)>, f64)>,
}

/// The position of a draw.
#[derive(Clone, Copy, Debug)]
pub struct SamplePosition {
    /// Seed of the job.
    pub seed: u64,
    /// Position of the sample in its split.
    pub position: u64,
    /// Index of the draw's own random streams.
    pub index: u64,
    /// Whether it is the first draw of the sample. A later draw may take another class, since a class that is never
    /// healthy would end the run.
    pub is_first_draw: bool,
}

impl ObjectSampler {
    /// Samplers for a plan without objects to choose from.
    pub const NONE: [Self; 3] = [const { Self::InTurn(Vec::new()) }; 3];

    /// Returns the object of a sample.
    pub fn pick_object(&self, at: SamplePosition) -> usize {
        match self {
            Self::InTurn(objects) => objects[(at.position % objects.len() as u64) as usize],
            Self::Weighted(weighted) => weighted.pick_object(at),
        }
    }

    /// Returns how many samples follow each other until the first object comes again; 1 if that is random.
    pub fn turn_length(&self) -> u64 {
        match self {
            Self::InTurn(objects) => objects.len().max(1) as u64,
            Self::Weighted(_) => 1,
        }
    }

    /// Returns a further object beside the sample's own: by weight, independent of earlier ones. If objects come in
    /// turn, it is any of them.
    pub fn pick_other_object(&self, stream: &mut RandomStream) -> usize {
        match self {
            Self::InTurn(objects) => objects[stream.uniform_below(objects.len())],
            Self::Weighted(weighted) => {
                let weight = stream.uniform() * weighted.total_weight();
                weighted.object_at_weight(weight, stream)
            }
        }
    }
}

impl WeightedSampler {
    /// Makes the sampler of a split. Each object has an index, a class and a weight above 0.
    pub fn new<'a>(split: usize, objects: impl Iterator<Item = (usize, &'a str, f64)>) -> Self {
        let mut by_class: BTreeMap<&str, Vec<(usize, f64)>> = BTreeMap::new();
        for (number, class, weight) in objects {
            let class = by_class.entry(class).or_default();
            let before = class.last().map_or(0.0, |(_, sum)| *sum);
            class.push((number, before + weight));
        }
        let mut sum = 0.0;
        let with_sums = by_class.into_values().map(|class| {
            sum += class.last().map_or(0.0, |(_, weight)| *weight);
            (class, sum)
        });
        Self { split: split as u64, classes: with_sums.collect() }
    }

    fn pick_object(&self, at: SamplePosition) -> usize {
        let mut own = rng::random_stream(at.seed, "object", at.index);
        let weight = self.total_weight() * if at.is_first_draw { self.balanced_position(at) } else { own.uniform() };
        self.object_at_weight(weight, &mut own)
    }

    /// Returns the sum of all weights.
    fn total_weight(&self) -> f64 {
        self.classes.last().map_or(0.0, |(_, sum)| *sum)
    }

    /// Returns an object of the class at `weight`, with the classes' weights laid end to end.
    fn object_at_weight(&self, weight: f64, own: &mut RandomStream) -> usize {
        let class = self.classes.partition_point(|(_, sum)| *sum <= weight).min(self.classes.len() - 1);
        let objects = &self.classes[class].0;
        let weight = own.uniform() * objects.last().map_or(0.0, |(_, sum)| *sum);
        objects[objects.partition_point(|(_, sum)| *sum <= weight).min(objects.len() - 1)].0
    }

    /// Returns the position, from 0 to 1, in the classes' weights laid end to end at which a sample takes its class.
    fn balanced_position(&self, at: SamplePosition) -> f64 {
        /// 2^64 over the golden ratio.
        const GOLDEN: u64 = 0x9e37_79b9_7f4a_7c15;
        let slots = self.classes.len() as u64;
        let (block, within) = (at.position / slots, at.position % slots);
        let first = rng::random_stream(at.seed, "object offset", self.split).next_bits();
        // Keep off the ends of a slot, where rounding could reach the next one.
        let steps = first.wrapping_add(block.wrapping_mul(GOLDEN)) >> 44;
        let offset = (steps as f64 + 0.5) / (1_u64 << 20) as f64;
        let order: Vec<u64> = (0..slots).collect();
        let mut random = rng::random_stream(at.seed, "object order", block * 3 + self.split);
        let slot = random.sample_without_replacement(order, within as usize + 1)[within as usize];
        (slot as f64 + offset) / slots as f64
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn draw(classes: &[(&str, f64)], split: usize) -> ObjectSampler {
        let objects = classes.iter().enumerate().map(|(number, (class, weight))| (number, *class, *weight));
        ObjectSampler::Weighted(WeightedSampler::new(split, objects))
    }

    fn counts(classes: &[(&str, f64)], split: usize, samples: u64) -> Vec<u64> {
        let draw = draw(classes, split);
        let mut counts = vec![0; classes.len()];
        for position in 0..samples {
            counts
                [draw.pick_object(SamplePosition { seed: 7, position, index: 10 * position, is_first_draw: true })] +=
                1;
        }
        counts
    }

    #[test]
    fn a_block_has_every_class_once_where_they_weigh_the_same() {
        let eight = ["a", "b", "c", "d", "e", "f", "g", "h"].map(|class| (class, 0.7));
        for blocks in [1, 2, 50] {
            assert_eq!(counts(&eight, 1, 8 * blocks), [blocks; 8], "{blocks}");
        }
        assert_ne!(counts(&eight, 1, 3), counts(&eight, 2, 3), "splits have orders of their own");
    }

    #[test]
    fn weights_are_frequencies_whatever_the_order() {
        let counts = counts(&[("a", 1.0), ("b", 4.0), ("c", 0.1), ("a", 0.4)], 0, 5500);
        for (count, expected) in counts.iter().zip([1000_i64, 4000, 100, 400]) {
            let most = if expected == 4000 || expected == 100 { 5 } else { 60 };
            assert!((*count as i64 - expected).abs() <= most, "{counts:?}");
        }
    }

    #[test]
    fn other_draws_are_by_weight_alone() {
        let draw = draw(&[("a", 1.0), ("b", 3.0)], 0);
        let redrawn = |index| draw.pick_object(SamplePosition { seed: 7, position: 0, index, is_first_draw: false });
        let of_b = (0..1000).filter(|index| redrawn(*index) == 1).count();
        assert!((700..800).contains(&of_b), "{of_b}");
        assert_eq!(
            ObjectSampler::InTurn(vec![3, 5]).pick_object(SamplePosition {
                seed: 7,
                position: 7,
                index: 0,
                is_first_draw: true
            }),
            5
        );
    }
}
