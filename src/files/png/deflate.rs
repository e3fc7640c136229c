//! Deflate for the rows of a picture: one block with Huffman codes that fit it, of literals and runs of zeros.
//!
//! Differences of neighbouring pixels hardly ever repeat, but for zeros: a search for other matches costs most of an
//! encoder's time and gains nothing here, codes that fit gain a seventh of the bytes.

/// Bits of the longest code: four of them and what is left of a byte fit into 64.
const LONGEST_CODE: usize = 14;
/// Bits of a code, of what it stands for beside it, and of the one distance that there is.
const LONGEST_PIECE: usize = LONGEST_CODE + 5 + 1;
/// Literals, the end, and the codes of lengths.
const SYMBOLS: usize = 286;
const END: usize = 256;
/// Shortest and longest match.
const MATCHES: [usize; 2] = [3, 258];
/// Of each code of lengths the shortest one, and how many bits say how much longer it is: eight codes of one length, then
/// four each of 2, 4, 8, 16 and 32 lengths, and the longest.
const LENGTHS: [(usize, u32); 29] = {
    let mut lengths = [(MATCHES[1], 0); 29];
    let mut code = 0;
    while code < 28 {
        let bits = if code < 8 { 0 } else { code / 4 - 1 };
        lengths[code] = (MATCHES[0] + if bits == 0 { code } else { (4 + code % 4) << bits }, bits as u32);
        code += 1;
    }
    lengths
};

/// The number of the code of a length in [`LENGTHS`].
fn code_of(length: usize) -> usize {
    LENGTHS.partition_point(|(shortest, _)| *shortest <= length) - 1
}

/// What a row is made of.
trait Pieces {
    /// Eight literals.
    fn eight(&mut self, bytes: [u8; 8]);
    /// One literal.
    fn one(&mut self, byte: u8);
    /// Zeros behind a zero, as many as one match holds.
    fn zeros(&mut self, count: usize);
}

/// Takes a row apart.
#[inline(always)]
fn take_apart(row: &[u8], pieces: &mut impl Pieces) {
    let mut at = 0;
    while let Some(&eight) = row[at..].first_chunk::<8>() {
        if eight != [0; 8] {
            pieces.eight(eight);
            at += 8;
            continue;
        }
        let eights = row[at..].as_chunks::<8>().0.iter().take_while(|eight| **eight == [0; 8]).count();
        let mut left = 8 * eights - 1;
        pieces.one(0);
        while left >= MATCHES[0] {
            let count = left.min(MATCHES[1]);
            pieces.zeros(count);
            left -= count;
        }
        (0..left).for_each(|_| pieces.one(0));
        at += 8 * eights;
    }
    row[at..].iter().for_each(|byte| pieces.one(*byte));
}

/// How often each symbol occurs.
pub struct Histogram {
    /// In four places, so that the same byte twice need not wait.
    literals: [[u32; 256]; 4],
    lengths: [u32; LENGTHS.len()],
}

impl Histogram {
    /// Of nothing.
    pub fn new() -> Self {
        Self { literals: [[0; 256]; 4], lengths: [0; LENGTHS.len()] }
    }

    /// Counts a row.
    pub fn add(&mut self, row: &[u8]) {
        take_apart(row, self);
    }

    /// Every symbol occurs: not all rows need have been counted.
    fn weights(&self) -> [u32; SYMBOLS] {
        let mut weights = [1; SYMBOLS];
        for (value, weight) in weights[..END].iter_mut().enumerate() {
            *weight += 8 * self.literals.iter().map(|counts| counts[value]).sum::<u32>();
        }
        weights[END + 1..].iter_mut().zip(self.lengths).for_each(|(weight, count)| *weight += 8 * count);
        weights
    }
}

impl Pieces for Histogram {
    #[inline(always)]
    fn eight(&mut self, bytes: [u8; 8]) {
        for (k, byte) in bytes.into_iter().enumerate() {
            self.literals[k % 4][usize::from(byte)] += 1;
        }
    }

    #[inline(always)]
    fn one(&mut self, byte: u8) {
        self.literals[0][usize::from(byte)] += 1;
    }

    fn zeros(&mut self, count: usize) {
        self.lengths[code_of(count)] += 1;
    }
}

/// Bits, and how many they are.
#[derive(Clone, Copy, Default)]
struct Code {
    bits: u32,
    count: u32,
}

/// A stream being written into a buffer, which may be that of an earlier one.
pub struct Deflate<'a> {
    out: &'a mut Vec<u8>,
    at: usize,
    bits: u64,
    count: u32,
    literals: [Code; 256],
    /// Of a match with this many bytes, with its distance.
    matches: [Code; MATCHES[1] + 1],
    end: Code,
}

impl<'a> Deflate<'a> {
    /// Starts a block with codes for these symbols behind the first `at` bytes of `out`.
    pub fn new(out: &'a mut Vec<u8>, at: usize, histogram: &Histogram) -> Self {
        let lengths = code_lengths(&histogram.weights());
        let codes = codes(&lengths);
        let mut literals = [Code::default(); 256];
        literals.copy_from_slice(&codes[..256]);
        let mut matches = [Code::default(); MATCHES[1] + 1];
        for (length, piece) in matches.iter_mut().enumerate().skip(MATCHES[0]) {
            let number = code_of(length);
            let ((shortest, extra), code) = (LENGTHS[number], codes[END + 1 + number]);
            // The bit of the distance is 0: one byte back.
            *piece =
                Code { bits: code.bits | ((length - shortest) as u32) << code.count, count: code.count + extra + 1 };
        }
        let mut stream = Self { out, at, bits: 0, count: 0, literals, matches, end: codes[END] };
        stream.describe(&lengths);
        stream
    }

    /// The block's head: the last one, of codes that follow.
    fn describe(&mut self, lengths: &[u8; SYMBOLS]) {
        // Order in which the lengths of the codes for lengths of codes are told.
        const ORDER: [usize; 19] = [16, 17, 18, 0, 8, 7, 9, 6, 10, 5, 11, 4, 12, 3, 13, 2, 14, 1, 15];
        self.reserve(1024);
        let head = [(1, 1), (2, 2), (SYMBOLS as u32 - 257, 5), (0, 5), (ORDER.len() as u32 - 4, 4)];
        head.into_iter().for_each(|(bits, count)| self.put(u64::from(bits), count));
        // Four bits for each length from 0 to 15 are a code, too.
        ORDER.into_iter().for_each(|length| self.put(if length < 16 { 4 } else { 0 }, 3));
        let one_distance = [1];
        for length in lengths.iter().chain(&one_distance) {
            self.put(u64::from(length.reverse_bits() >> 4), 4);
        }
    }

    /// Writes a row.
    pub fn row(&mut self, row: &[u8]) {
        // A byte is a literal, or is in a match of at least three.
        self.reserve(row.len() * LONGEST_CODE / 8);
        take_apart(row, self);
    }

    /// Ends the stream. The bytes that it ends after.
    pub fn finish(mut self) -> usize {
        self.reserve(8);
        self.put(u64::from(self.end.bits), self.end.count);
        let odd = (8 - self.count) % 8;
        self.put(0, odd);
        self.at
    }

    /// Makes room for so many bytes, and the eight that are written at a time.
    fn reserve(&mut self, bytes: usize) {
        let wanted = self.at + bytes + 16 + LONGEST_PIECE;
        if self.out.len() < wanted {
            self.out.resize(wanted.max(self.out.len() * 3 / 2), 0);
        }
    }

    #[inline(always)]
    fn put(&mut self, bits: u64, count: u32) {
        self.bits |= bits << self.count;
        self.count += count;
        self.out[self.at..][..8].copy_from_slice(&self.bits.to_le_bytes());
        self.at += (self.count / 8) as usize;
        self.bits >>= self.count & !7;
        self.count &= 7;
    }
}

impl Pieces for Deflate<'_> {
    #[inline(always)]
    fn eight(&mut self, bytes: [u8; 8]) {
        for four in bytes.as_chunks::<4>().0 {
            let [a, b, c, d] = four.map(|byte| self.literals[usize::from(byte)]);
            let first = u64::from(a.bits) | u64::from(b.bits) << a.count;
            let second = u64::from(c.bits) | u64::from(d.bits) << c.count;
            let half = a.count + b.count;
            self.put(first | second << half, half + c.count + d.count);
        }
    }

    #[inline(always)]
    fn one(&mut self, byte: u8) {
        let code = self.literals[usize::from(byte)];
        self.put(u64::from(code.bits), code.count);
    }

    #[inline(always)]
    fn zeros(&mut self, count: usize) {
        let code = self.matches[count];
        self.put(u64::from(code.bits), code.count);
    }
}

/// Lengths of the shortest codes of at most [`LONGEST_CODE`] bits, by package-merge: of the lists of leaves and pairs of the
/// list before, each item taken makes the codes of its leaves a bit longer.
fn code_lengths(weights: &[u32; SYMBOLS]) -> [u8; SYMBOLS] {
    let mut order: [usize; SYMBOLS] = std::array::from_fn(|symbol| symbol);
    order.sort_unstable_by_key(|symbol| (weights[*symbol], *symbol));
    let leaves = order.map(|symbol| u64::from(weights[symbol]));
    let mut items = leaves.to_vec();
    // Of each list: which items are leaves.
    let mut lists = vec![vec![true; SYMBOLS]];
    for _ in 1..LONGEST_CODE {
        let mut pairs = items.as_chunks::<2>().0.iter().map(|[a, b]| a + b).peekable();
        let (mut next, mut is_leaf, mut alone) = (Vec::new(), Vec::new(), leaves.iter().peekable());
        loop {
            let leaf = match (alone.peek(), pairs.peek()) {
                (Some(leaf), Some(pair)) => **leaf <= *pair,
                (Some(_), None) => true,
                (None, Some(_)) => false,
                (None, None) => break,
            };
            let item = if leaf { alone.next().copied() } else { pairs.next() };
            next.extend(item);
            is_leaf.push(leaf);
        }
        drop(pairs);
        items = next;
        lists.push(is_leaf);
    }
    let mut lengths = [0; SYMBOLS];
    let mut taken = 2 * SYMBOLS - 2;
    for is_leaf in lists.iter().rev() {
        let leaves = is_leaf[..taken].iter().filter(|leaf| **leaf).count();
        order[..leaves].iter().for_each(|symbol| lengths[*symbol] += 1);
        taken = 2 * (taken - leaves);
    }
    lengths
}

/// The codes of these lengths, as Deflate numbers them; first bit lowest.
fn codes(lengths: &[u8; SYMBOLS]) -> [Code; SYMBOLS] {
    // The next code of each length, from the first on.
    let mut next = [0_u32; LONGEST_CODE + 1];
    for length in 1..LONGEST_CODE {
        let count = lengths.iter().filter(|one| usize::from(**one) == length).count() as u32;
        next[length + 1] = (next[length] + count) << 1;
    }
    lengths.map(|length| {
        let code = next[usize::from(length)];
        next[usize::from(length)] += 1;
        Code { bits: code.reverse_bits() >> (32 - u32::from(length)), count: u32::from(length) }
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn codes_fill_the_tree_and_none_is_too_long() {
        let mut weights = [1; SYMBOLS];
        let fibonacci = |k: usize| (0..k.min(40)).fold((1_u32, 1_u32), |(a, b), _| (b, a + b)).0;
        for number in 0..4 {
            for (k, weight) in weights.iter_mut().enumerate() {
                *weight = match number {
                    0 => 1,
                    1 => fibonacci(k),
                    2 => 1 + (k as u32 * 7919) % 1000,
                    _ => {
                        if k == 0 {
                            u32::MAX
                        } else {
                            1
                        }
                    }
                };
            }
            let lengths = code_lengths(&weights);
            assert!(lengths.iter().all(|length| (1..=LONGEST_CODE).contains(&usize::from(*length))));
            let filled: u32 = lengths.iter().map(|length| 1 << (LONGEST_CODE - usize::from(*length))).sum();
            assert_eq!(filled, 1 << LONGEST_CODE, "{number}");
            for a in 0..SYMBOLS {
                assert!((0..SYMBOLS).all(|b| weights[a] <= weights[b] || lengths[a] <= lengths[b]), "{number}");
            }
        }
    }

    #[test]
    fn lengths_of_matches_have_the_codes_of_the_format() {
        assert_eq!([3, 10, 11, 12, 13, 34, 226, 227, 257, 258].map(code_of), [0, 7, 8, 8, 9, 15, 26, 27, 27, 28]);
        for length in MATCHES[0]..=MATCHES[1] {
            let (shortest, extra) = LENGTHS[code_of(length)];
            assert!(length - shortest < 1 << extra || (length == shortest && extra == 0), "{length}");
        }
    }
}
