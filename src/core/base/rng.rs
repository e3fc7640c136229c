//! The only place where random generators are made.
//!
//! Random numbers are addressed, not advanced: every quantity of every sample has its own stream, identified by the
//! job's seed, a name and the sample's index. So sample 4711 is the same alone, in any shard and with any number of
//! threads, and an additional draw for one quantity does not change the others. ChaCha with 8 rounds is counter based
//! and gives the same numbers on every machine; logarithms and cosines come from `libm` for the same reason.

use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;

/// The random numbers of one seed, name and index.
pub struct RandomStream(ChaCha8Rng);

/// Returns the stream at (`seed`, `name`, `index`). `name` has at most 24 bytes. It is part of the seed, so renaming a
/// stream changes every dataset.
pub fn random_stream(seed: u64, name: &str, index: u64) -> RandomStream {
    let mut key = [0; 32];
    // The key has 32 bytes: 8 of the seed, 24 of the name.
    key[..8].copy_from_slice(&seed.to_le_bytes());
    let name = name.as_bytes();
    key[8..8 + name.len()].copy_from_slice(name);
    let mut generator = ChaCha8Rng::from_seed(key);
    generator.set_stream(index);
    RandomStream(generator)
}

/// Returns the stream index of sample `index` (below 2^32) after `attempt` rejected draws.
pub fn redraw_index(index: u64, attempt: u32) -> u64 {
    index | u64::from(attempt) << 32
}

impl RandomStream {
    /// Draws a number uniformly from [0, 1), in steps of 2^-53.
    pub fn uniform(&mut self) -> f64 {
        (self.0.next_u64() >> 11) as f64 * (1.0 / (1_u64 << 53) as f64)
    }

    /// Draws a whole number uniformly from 0 .. `count` - 1; 0 if `count` is 0.
    pub fn uniform_below(&mut self, count: usize) -> usize {
        ((self.uniform() * count as f64) as usize).min(count.saturating_sub(1))
    }

    /// Draws up to `count` of the values, without replacement.
    pub fn sample_without_replacement<T>(&mut self, mut values: Vec<T>, count: usize) -> Vec<T> {
        for k in 0..count.min(values.len()) {
            let other = k + self.uniform_below(values.len() - k);
            values.swap(k, other);
        }
        values.truncate(count);
        values
    }

    /// Draws 64 random bits.
    pub fn next_bits(&mut self) -> u64 {
        self.0.next_u64()
    }

    /// Draws a standard normal number (Box and Muller 1958).
    pub fn standard_normal(&mut self) -> f64 {
        // 1 - uniform() lies in (0, 1], so that the logarithm is finite.
        let radius = libm::sqrt(-2.0 * libm::log(1.0 - self.uniform()));
        radius * libm::cos(std::f64::consts::TAU * self.uniform())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_stream_depends_on_seed_name_and_index_and_on_nothing_else() {
        let first = random_stream(7, "yaw", 4711).uniform();
        assert_eq!(first, random_stream(7, "yaw", 4711).uniform());
        assert_ne!(first, random_stream(8, "yaw", 4711).uniform());
        assert_ne!(first, random_stream(7, "tilt", 4711).uniform());
        assert_ne!(first, random_stream(7, "yaw", 4712).uniform());
        // Pinned: a change here changes every dataset ever made.
        assert_eq!(first, PINNED);
    }

    const PINNED: f64 = 0.671_236_366_881_652_1;
}
