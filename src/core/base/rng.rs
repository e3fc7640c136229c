//! The only place where a random generator is made.
//!
//! Randomness is addressed, not advanced: every quantity of every sample has a stream of its own, known by job seed,
//! name and sample index. So sample 4711 is the same alone, in any shard and at any thread count, and a draw added
//! to one moves no other. ChaCha with 8 rounds is counter based and the same on every machine; logarithms and
//! cosines come from `libm` for the same reason.

use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;

/// Random numbers of one name and number.
pub struct Stream(ChaCha8Rng);

/// The stream at (`seed`, `name`, `index`). Its owner names it, in at most 24 bytes; the name is part of the seed, so that
/// renaming it changes every dataset.
pub fn stream(seed: u64, name: &str, index: u64) -> Stream {
    let mut key = [0; 32];
    key[..8].copy_from_slice(&seed.to_le_bytes());
    let name = name.as_bytes();
    key[8..8 + name.len()].copy_from_slice(name);
    let mut generator = ChaCha8Rng::from_seed(key);
    generator.set_stream(index);
    Stream(generator)
}

/// The number of the streams of sample `index`, below 2^32, when it is drawn after `attempt` rejected draws.
pub fn redrawn(index: u64, attempt: u32) -> u64 {
    index | u64::from(attempt) << 32
}

impl Stream {
    /// Uniform in [0, 1), in steps of 2^-53.
    pub fn unit(&mut self) -> f64 {
        (self.0.next_u64() >> 11) as f64 * (1.0 / (1_u64 << 53) as f64)
    }

    /// Uniform among 0 .. `count` - 1; 0 if `count` is 0.
    pub fn below(&mut self, count: usize) -> usize {
        ((self.unit() * count as f64) as usize).min(count.saturating_sub(1))
    }

    /// Up to `count` of the values, drawn without putting back.
    pub fn some_of<T>(&mut self, mut values: Vec<T>, count: usize) -> Vec<T> {
        for k in 0..count.min(values.len()) {
            let other = k + self.below(values.len() - k);
            values.swap(k, other);
        }
        values.truncate(count);
        values
    }

    /// 64 random bits.
    pub fn bits(&mut self) -> u64 {
        self.0.next_u64()
    }

    /// A standard normal number (Box and Muller 1958).
    pub fn normal(&mut self) -> f64 {
        let radius = libm::sqrt(-2.0 * libm::log(1.0 - self.unit()));
        radius * libm::cos(std::f64::consts::TAU * self.unit())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_stream_depends_on_seed_name_and_index_and_on_nothing_else() {
        let first = stream(7, "yaw", 4711).unit();
        assert_eq!(first, stream(7, "yaw", 4711).unit());
        assert_ne!(first, stream(8, "yaw", 4711).unit());
        assert_ne!(first, stream(7, "tilt", 4711).unit());
        assert_ne!(first, stream(7, "yaw", 4712).unit());
        // Pinned: a change here changes every dataset ever made.
        assert_eq!(first, PINNED);
    }

    const PINNED: f64 = 0.671_236_366_881_652_1;
}
