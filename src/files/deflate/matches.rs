//! Finds what repeats.

use super::{Content, FARTHEST, Pieces};

/// Bytes of which only runs of zeros are looked for.
pub struct Runs<'a>(pub &'a [u8]);

impl Content for Runs<'_> {
    fn bytes(&self) -> &[u8] {
        self.0
    }

    #[inline(always)]
    fn pieces(&self, pieces: &mut impl Pieces) {
        let eights = |from: usize| self.0[from..].as_chunks::<8>().0.iter();
        let (mut at, mut told) = (0, 0);
        loop {
            at += 8 * eights(at).take_while(|eight| **eight != [0; 8]).count();
            let run = 8 * eights(at).take_while(|eight| **eight == [0; 8]).count();
            if run == 0 {
                break pieces.literals(&self.0[told..]);
            }
            // The first zero is the one that is repeated.
            pieces.literals(&self.0[told..=at]);
            pieces.copy(run - 1, 1);
            at += run;
            told = at;
        }
    }
}

/// So many bits of a hash say where bytes were seen last.
const HASH_BITS: u32 = 12;
/// The bytes that are hashed: fewer of them often cost more as a match than as they are.
const HASHED: u32 = 5;
/// After so many bytes without a match every second one is passed over, after twice as many two of three, and so on.
const PATIENCE: usize = 64;

/// Looks for matches: runs of one byte, and what was seen before, where a hash remembers it.
pub struct Finder {
    /// Where bytes of this hash were seen last.
    seen: Box<[u32; 1 << HASH_BITS]>,
    matches: Vec<Match>,
}

impl Default for Finder {
    fn default() -> Self {
        Self { seen: Box::new([0; 1 << HASH_BITS]), matches: Vec::new() }
    }
}

/// Bytes that are those a distance before.
struct Match {
    from: usize,
    length: usize,
    distance: usize,
}

/// Bytes and the matches in them.
pub struct Found<'a> {
    bytes: &'a [u8],
    matches: &'a [Match],
}

impl Finder {
    /// Looks through bytes, up to 4 GB.
    pub fn find<'a>(&'a mut self, bytes: &'a [u8]) -> Found<'a> {
        self.matches.clear();
        self.seen.fill(0);
        let eight = |at: usize| bytes.get(at..)?.first_chunk().map(|eight| u64::from_le_bytes(*eight));
        let (mut at, mut told) = (1, 0);
        while let (Some(here), Some(before)) = (eight(at), eight(at - 1)) {
            let mut earlier = at - 1;
            if (here ^ before) as u32 != 0 {
                let hashed = here << (64 - 8 * HASHED);
                let hash = hashed.wrapping_mul(0x9e37_79b9_7f4a_7c15) >> (64 - HASH_BITS);
                earlier = std::mem::replace(&mut self.seen[hash as usize], at as u32) as usize;
                // The first byte of all is not remembered.
                let other = if earlier == 0 { !here } else { eight(earlier).unwrap_or(!here) };
                if (other ^ here) << (64 - 8 * HASHED) != 0 || at - earlier > FARTHEST {
                    at += 1 + (at - told) / PATIENCE;
                    continue;
                }
            }
            let more = common(&bytes[at..], &bytes[earlier..]);
            // Bytes that were passed over may belong to it.
            let behind = bytes[told..at].iter().rev().zip(bytes[..earlier].iter().rev());
            let behind = behind.take_while(|(a, b)| a == b).count();
            self.matches.push(Match { from: at - behind, length: behind + more, distance: at - earlier });
            at += more;
            told = at;
        }
        Found { bytes, matches: &self.matches }
    }
}

/// How many bytes are the same from the start on.
#[inline(always)]
fn common(a: &[u8], b: &[u8]) -> usize {
    let eights = a.as_chunks::<8>().0.iter().zip(b.as_chunks::<8>().0);
    let mut same = 0;
    for (a, b) in eights {
        let differ = u64::from_le_bytes(*a) ^ u64::from_le_bytes(*b);
        if differ != 0 {
            return same + (differ.trailing_zeros() / 8) as usize;
        }
        same += 8;
    }
    same + a[same..].iter().zip(&b[same..]).take_while(|(a, b)| a == b).count()
}

impl Content for Found<'_> {
    fn bytes(&self) -> &[u8] {
        self.bytes
    }

    #[inline(always)]
    fn pieces(&self, pieces: &mut impl Pieces) {
        let mut told = 0;
        for Match { from, length, distance } in self.matches {
            pieces.literals(&self.bytes[told..*from]);
            pieces.copy(*length, *distance);
            told = from + length;
        }
        pieces.literals(&self.bytes[told..]);
    }
}
