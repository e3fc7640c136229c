//! Which object a sample gets.
//!
//! Within a split samples are numbered from 0. As many consecutive ones as the split has classes are a block, and a block
//! has each class as often as its weight says, rounded up or down, in an order drawn at random: so a split of a handful of
//! samples has every class. Systematic sampling: with weights laid end to end from 0 to 1, slot j of n takes the class at
//! (j + offset) / n; offsets follow the golden ratio from block to block, so that fractions even out (Weyl 1916). An
//! object's split and place in it do not depend on the number of samples; neither does what is drawn here.

use std::collections::BTreeMap;

use gelsim_core::base::rng::{self, Stream};

/// How the objects of one split are drawn.
#[derive(Clone, Debug)]
pub enum Draw {
    /// By weight, evenly over the split.
    Weighted(Weighted),
    /// One after the other.
    InTurn(Vec<usize>),
}

/// Objects to be drawn by weight.
#[derive(Clone, Debug)]
pub struct Weighted {
    /// Number of the split, for the streams.
    split: u64,
    /// Of each class, sorted by name: its objects' numbers with the running sum of their weights, and the running sum of
    /// the classes' weights.
    classes: Vec<(Vec<(usize, f64)>, f64)>,
}

/// Where a sample stands.
#[derive(Clone, Copy, Debug)]
pub struct Place {
    /// Seed of the job.
    pub seed: u64,
    /// Its position in its split.
    pub position: u64,
    /// Number of the sample's own streams.
    pub index: u64,
    /// It is drawn for the first time. Another draw is free to take another class: one that is never healthy would end
    /// the run.
    pub first: bool,
}

impl Draw {
    /// Where there is nothing to draw from.
    pub const NOTHING: [Self; 3] = [const { Self::InTurn(Vec::new()) }; 3];

    /// The object of a sample.
    pub fn pick(&self, at: Place) -> usize {
        match self {
            Self::InTurn(objects) => objects[(at.position % objects.len() as u64) as usize],
            Self::Weighted(weighted) => weighted.pick(at),
        }
    }

    /// Another object beside the sample's own: by weight, whatever came before; where objects come in turn, any of them.
    pub fn pick_beside(&self, stream: &mut Stream) -> usize {
        match self {
            Self::InTurn(objects) => objects[stream.below(objects.len())],
            Self::Weighted(weighted) => {
                let weight = stream.unit() * weighted.total();
                weighted.at(weight, stream)
            }
        }
    }
}

impl Weighted {
    /// Objects of split number `split`, each with its number, its class and its weight above 0.
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

    fn pick(&self, at: Place) -> usize {
        let mut own = rng::stream(at.seed, "object", at.index);
        let weight = self.total() * if at.first { self.balanced(at) } else { own.unit() };
        self.at(weight, &mut own)
    }

    /// The sum of all weights.
    fn total(&self) -> f64 {
        self.classes.last().map_or(0.0, |(_, sum)| *sum)
    }

    /// An object of the class that is at `weight` of the classes' weights laid end to end.
    fn at(&self, weight: f64, own: &mut Stream) -> usize {
        let class = self.classes.partition_point(|(_, sum)| *sum <= weight).min(self.classes.len() - 1);
        let objects = &self.classes[class].0;
        let weight = own.unit() * objects.last().map_or(0.0, |(_, sum)| *sum);
        objects[objects.partition_point(|(_, sum)| *sum <= weight).min(objects.len() - 1)].0
    }

    /// Where in the weights laid end to end from 0 to 1 a sample takes its class.
    fn balanced(&self, at: Place) -> f64 {
        /// 2^64 over the golden ratio.
        const GOLDEN: u64 = 0x9e37_79b9_7f4a_7c15;
        let slots = self.classes.len() as u64;
        let (block, within) = (at.position / slots, at.position % slots);
        let first = rng::stream(at.seed, "object offset", self.split).bits();
        // Off the ends of a slot, where rounding may take it to the neighbour.
        let steps = first.wrapping_add(block.wrapping_mul(GOLDEN)) >> 44;
        let offset = (steps as f64 + 0.5) / (1_u64 << 20) as f64;
        let order: Vec<u64> = (0..slots).collect();
        let mut random = rng::stream(at.seed, "object order", block * 3 + self.split);
        let slot = random.some_of(order, slots as usize)[within as usize];
        (slot as f64 + offset) / slots as f64
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn draw(classes: &[(&str, f64)], split: usize) -> Draw {
        let objects = classes.iter().enumerate().map(|(number, (class, weight))| (number, *class, *weight));
        Draw::Weighted(Weighted::new(split, objects))
    }

    fn counts(classes: &[(&str, f64)], split: usize, samples: u64) -> Vec<u64> {
        let draw = draw(classes, split);
        let mut counts = vec![0; classes.len()];
        for position in 0..samples {
            counts[draw.pick(Place { seed: 7, position, index: 10 * position, first: true })] += 1;
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
        let redrawn = |index| draw.pick(Place { seed: 7, position: 0, index, first: false });
        let of_b = (0..1000).filter(|index| redrawn(*index) == 1).count();
        assert!((700..800).contains(&of_b), "{of_b}");
        assert_eq!(Draw::InTurn(vec![3, 5]).pick(Place { seed: 7, position: 7, index: 0, first: true }), 5);
    }
}
