//! Finds repeated bytes in the data to be packed.

use super::{MAX_DISTANCE, TokenSink, TokenSource};

/// Bytes in which only runs of zeros are searched for.
pub struct ZeroRuns<'a>(pub &'a [u8]);

impl TokenSource for ZeroRuns<'_> {
    fn bytes(&self) -> &[u8] {
        self.0
    }

    #[inline(always)]
    fn emit_tokens(&self, pieces: &mut impl TokenSink) {
        let (mut at, mut told) = (0, 0);
        loop {
            at += count_before(&self.0[at..], true);
            let run = count_before(&self.0[at..], false);
            if run == 0 {
                break pieces.push_literals(&self.0[told..]);
            }
            // The first zero is a literal; the match repeats it.
            pieces.push_literals(&self.0[told..=at]);
            pieces.push_long_match(run - 1, 1);
            at += run;
            told = at;
        }
    }
}

/// Counts the bytes before the first eight bytes that are all zeros, or, without `zeros`, that are not; eights count from
/// the first byte.
#[inline(always)]
fn count_before(bytes: &[u8], zeros: bool) -> usize {
    let ends = |eight: &[u8; 8]| (u64::from_ne_bytes(*eight) == 0) == zeros;
    let eights = bytes.as_chunks::<8>().0;
    // Sixteen eights at once, as most of them do not end.
    let mut before = 0;
    for sixteen in eights.as_chunks::<16>().0 {
        if sixteen.iter().fold(false, |any, eight| any | ends(eight)) {
            break;
        }
        before += sixteen.len();
    }
    8 * (before + eights[before..].iter().take_while(|eight| !ends(eight)).count())
}

/// Bits of the hash by which [`MatchFinder`] remembers where bytes were seen last.
const HASH_BITS: u32 = 12;
/// Number of bytes that are hashed. A match of fewer bytes often costs more than the bytes themselves.
const HASHED_BYTES: u32 = 5;
/// The search skips bytes where nothing matches: after this many bytes without a match every second one, after twice as
/// many two of three, and so on.
const SKIP_AFTER_BYTES: usize = 64;

/// Searches for matches: runs of one byte, and bytes that a hash says were seen before.
pub struct MatchFinder {
    /// The position at which bytes of each hash were seen last; 0 for none.
    last_seen: Box<[u32; 1 << HASH_BITS]>,
    matches: Vec<Match>,
}

impl Default for MatchFinder {
    fn default() -> Self {
        Self { last_seen: Box::new([0; 1 << HASH_BITS]), matches: Vec::new() }
    }
}

/// A run of bytes that equals the bytes `distance` before it.
struct Match {
    from: usize,
    length: usize,
    distance: usize,
}

/// Bytes together with the matches found in them.
pub struct MatchedBytes<'a> {
    bytes: &'a [u8],
    matches: &'a [Match],
}

impl MatchFinder {
    /// Searches `bytes`, up to 4 GB, for matches.
    pub fn find_matches<'a>(&'a mut self, bytes: &'a [u8]) -> MatchedBytes<'a> {
        self.matches.clear();
        self.last_seen.fill(0);
        let eight = |at: usize| bytes.get(at..)?.first_chunk().map(|eight| u64::from_le_bytes(*eight));
        let (mut at, mut told) = (1, 0);
        while let (Some(here), Some(before)) = (eight(at), eight(at - 1)) {
            let mut earlier = at - 1;
            // Four bytes that equal the ones just before are a run of one byte, which needs no hash.
            if (here ^ before) as u32 != 0 {
                let hashed = here << (64 - 8 * HASHED_BYTES);
                let hash = hashed.wrapping_mul(0x9e37_79b9_7f4a_7c15) >> (64 - HASH_BITS);
                earlier = std::mem::replace(&mut self.last_seen[hash as usize], at as u32) as usize;
                // Position 0 stands for "never seen", so a match with the very first byte is not looked for.
                let other = if earlier == 0 { !here } else { eight(earlier).unwrap_or(!here) };
                if (other ^ here) << (64 - 8 * HASHED_BYTES) != 0 || at - earlier > MAX_DISTANCE {
                    at += 1 + (at - told) / SKIP_AFTER_BYTES;
                    continue;
                }
            }
            let more = count_common_bytes(&bytes[at..], &bytes[earlier..]);
            // Bytes that were skipped may belong to the match.
            let behind = bytes[told..at].iter().rev().zip(bytes[..earlier].iter().rev());
            let behind = behind.take_while(|(a, b)| a == b).count();
            self.matches.push(Match { from: at - behind, length: behind + more, distance: at - earlier });
            at += more;
            told = at;
        }
        MatchedBytes { bytes, matches: &self.matches }
    }
}

/// Counts how many bytes are equal from the start.
#[inline(always)]
fn count_common_bytes(a: &[u8], b: &[u8]) -> usize {
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

impl TokenSource for MatchedBytes<'_> {
    fn bytes(&self) -> &[u8] {
        self.bytes
    }

    #[inline(always)]
    fn emit_tokens(&self, pieces: &mut impl TokenSink) {
        let mut told = 0;
        for Match { from, length, distance } in self.matches {
            pieces.push_literals(&self.bytes[told..*from]);
            pieces.push_long_match(*length, *distance);
            told = from + length;
        }
        pieces.push_literals(&self.bytes[told..]);
    }
}
