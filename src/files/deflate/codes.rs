//! Huffman codes that fit what is written.

use super::{Content, FARTHEST, MATCHES, Pieces};

/// Bits of the longest code: four of them and what is left of a byte fit into 64.
pub const LONGEST_CODE: usize = 14;
/// Literals, the end, and the codes of lengths.
const SYMBOLS: usize = 286;
const END: usize = 256;
/// Codes of distances.
const DISTANCES: usize = 30;
/// Codes of lengths of codes, and bits of the longest of them.
const LENGTHS_OF_CODES: usize = 19;
const LONGEST_OF_LENGTHS: usize = 7;
/// Most bytes of a block's head: 17 bits, three for each code of lengths, and for each length a code and as much beside it.
pub const HEAD_BYTES: usize = (17 + 3 * LENGTHS_OF_CODES + 2 * LONGEST_OF_LENGTHS * (SYMBOLS + DISTANCES)) / 8 + 1;

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

/// The number in [`LENGTHS`] of each length.
const OF_LENGTH: [u8; MATCHES[1] + 1] = {
    let mut numbers = [0; MATCHES[1] + 1];
    let mut length = MATCHES[0];
    let mut code = 0;
    while length <= MATCHES[1] {
        if code + 1 < LENGTHS.len() && LENGTHS[code + 1].0 <= length {
            code += 1;
        }
        numbers[length] = code as u8;
        length += 1;
    }
    numbers
};

/// The code of a distance, how many bits say how much farther it is, and these bits: four codes of one distance, then two
/// each of 2, 4, 8 and so on.
#[inline(always)]
fn of_distance(distance: usize) -> (usize, u32, u64) {
    debug_assert!((1..=FARTHEST).contains(&distance));
    let less = distance - 1;
    if less < 4 {
        return (less, 0, 0);
    }
    let bits = less.ilog2() - 1;
    (2 * bits as usize + (less >> bits), bits, (less & ((1 << bits) - 1)) as u64)
}

/// How often each symbol occurs.
pub struct Histogram {
    /// In four places, so that the same byte twice need not wait.
    literals: [[u32; 256]; 4],
    lengths: [u32; LENGTHS.len()],
    distances: [u32; DISTANCES],
}

impl Histogram {
    /// Of nothing.
    pub fn new() -> Self {
        Self { literals: [[0; 256]; 4], lengths: [0; LENGTHS.len()], distances: [0; DISTANCES] }
    }

    /// Counts what is to be written.
    pub fn add(&mut self, content: &impl Content) {
        content.pieces(self);
    }

    fn weights(&self) -> [u32; SYMBOLS] {
        let mut weights = [0; SYMBOLS];
        for (value, weight) in weights[..END].iter_mut().enumerate() {
            *weight = self.literals.iter().map(|counts| counts[value]).sum();
        }
        weights[END] = 1;
        weights[END + 1..].copy_from_slice(&self.lengths);
        weights
    }
}

impl Pieces for Histogram {
    #[inline(always)]
    fn literals(&mut self, bytes: &[u8]) {
        let (fours, rest) = bytes.as_chunks::<4>();
        for four in fours {
            for (counts, byte) in self.literals.iter_mut().zip(four) {
                counts[usize::from(*byte)] += 1;
            }
        }
        rest.iter().for_each(|byte| self.literals[0][usize::from(*byte)] += 1);
    }

    #[inline(always)]
    fn again(&mut self, length: usize, distance: usize) {
        self.lengths[usize::from(OF_LENGTH[length])] += 1;
        self.distances[of_distance(distance).0] += 1;
    }
}

/// Bits, first bit lowest, and how many they are.
#[derive(Clone, Copy, Default)]
pub struct Code {
    pub bits: u32,
    pub count: u32,
}

/// The codes of a block.
pub struct Codes {
    pub literals: [Code; 256],
    pub end: Code,
    lengths: [Code; LENGTHS.len()],
    distances: [Code; DISTANCES],
    /// Bits of each symbol's code and of each distance's, 0 of one that does not occur.
    bits: [u8; SYMBOLS + DISTANCES],
}

impl Codes {
    /// For what has been counted: nothing else can be written.
    pub fn of(histogram: &Histogram) -> Self {
        Self::with(&histogram.weights(), &histogram.distances)
    }

    /// For more than what has been counted: any bytes may occur, matches at all distances that have been seen, or at 1.
    pub fn estimated(histogram: &Histogram) -> Self {
        Self::with(&histogram.weights().map(|weight| 1 + 8 * weight), &histogram.distances)
    }

    fn with(symbols: &[u32; SYMBOLS], distances: &[u32; DISTANCES]) -> Self {
        let mut bits = [0; SYMBOLS + DISTANCES];
        let (of_symbols, of_distances) = bits.split_at_mut(SYMBOLS);
        code_lengths(symbols, LONGEST_CODE, of_symbols);
        code_lengths(distances, LONGEST_CODE, of_distances);
        let codes: [Code; SYMBOLS] = codes(of_symbols);
        let distances = self::codes(of_distances);
        let mut literals = [Code::default(); END];
        let mut lengths = [Code::default(); LENGTHS.len()];
        literals.copy_from_slice(&codes[..END]);
        lengths.copy_from_slice(&codes[END + 1..]);
        Self { literals, end: codes[END], lengths, distances, bits }
    }

    /// The bits of a match, and how many.
    #[inline(always)]
    pub fn again(&self, length: usize, distance: usize) -> (u64, u32) {
        let number = usize::from(OF_LENGTH[length]);
        let ((shortest, longer), code) = (LENGTHS[number], self.lengths[number]);
        let (of_distance, farther, rest) = of_distance(distance);
        let far = self.distances[of_distance];
        let length = u64::from(code.bits) | ((length - shortest) as u64) << code.count;
        let distance = u64::from(far.bits) | rest << far.count;
        let before = code.count + longer;
        (length | distance << before, before + far.count + farther)
    }

    /// Gives `put` the head of a block: what it is, and the lengths of its codes.
    pub fn head(&self, last: bool, mut put: impl FnMut(u32, u32)) {
        // Order in which the lengths of the codes for lengths of codes are told.
        const ORDER: [usize; LENGTHS_OF_CODES] = [16, 17, 18, 0, 8, 7, 9, 6, 10, 5, 11, 4, 12, 3, 13, 2, 14, 1, 15];
        let told = told(&self.bits);
        let mut counts = [0; LENGTHS_OF_CODES];
        told.iter().for_each(|told| counts[told.symbol] += 1);
        let mut lengths = [0; LENGTHS_OF_CODES];
        code_lengths(&counts, LONGEST_OF_LENGTHS, &mut lengths);
        let codes: [Code; LENGTHS_OF_CODES] = codes(&lengths);
        put(u32::from(last), 1);
        put(2, 2);
        put(SYMBOLS as u32 - 257, 5);
        put(DISTANCES as u32 - 1, 5);
        put(LENGTHS_OF_CODES as u32 - 4, 4);
        ORDER.iter().for_each(|symbol| put(u32::from(lengths[*symbol]), 3));
        for Told { symbol, more } in told {
            let code = codes[symbol];
            put(code.bits | more.bits << code.count, code.count + more.count);
        }
    }
}

/// A length of a code, or how often one is repeated.
struct Told {
    symbol: usize,
    more: Code,
}

/// Lengths of codes as a block tells them: with those that are the same in a row together.
fn told(lengths: &[u8]) -> Vec<Told> {
    let mut told = Vec::with_capacity(lengths.len());
    for same in lengths.chunk_by(|a, b| a == b) {
        let symbol = usize::from(same[0]);
        let mut left = same.len();
        if symbol > 0 {
            told.push(Told { symbol, more: Code::default() });
            left -= 1;
        }
        while left > 0 {
            // The symbol, the fewest that it stands for and the most, and the bits that say how many.
            let (repeat, fewest, most, count) = match (symbol, left) {
                (0, 11..) => (18, 11, 138, 7),
                (0, 3..) => (17, 3, 10, 3),
                (_, 3..) => (16, 3, 6, 2),
                _ => (symbol, 1, 1, 0),
            };
            let taken = left.min(most);
            told.push(Told { symbol: repeat, more: Code { bits: (taken - fewest) as u32, count } });
            left -= taken;
        }
    }
    told
}

/// Lengths of codes of at most `longest` bits, the shortest that there are while none has to be cut, 0 for what does not
/// occur. One code alone takes a bit, and two there are at least, for decoders that want a whole tree.
fn code_lengths(weights: &[u32], longest: usize, lengths: &mut [u8]) {
    // Weight and symbol in one number, by which they are sorted.
    let mut leaves = [0_u64; SYMBOLS];
    let mut count = 0;
    for (symbol, weight) in weights.iter().enumerate() {
        leaves[count] = leaf(*weight, symbol);
        count += usize::from(*weight > 0);
    }
    for symbol in (0..2).filter(|symbol| weights[*symbol] == 0).take(2_usize.saturating_sub(count)) {
        leaves[count] = leaf(1, symbol);
        count += 1;
    }
    let leaves = &mut leaves[..count];
    leaves.sort_unstable();
    let mut weights = [0; SYMBOLS];
    for (weight, leaf) in weights.iter_mut().zip(&*leaves) {
        *weight = leaf >> 32;
    }
    let mut depths = weights;
    loop {
        let deepest = depths_of(&mut depths[..count]);
        if deepest as usize <= longest {
            break leaves.iter().zip(depths).for_each(|(leaf, depth)| lengths[*leaf as u32 as usize] = depth as u8);
        }
        // Rare ones come nearer to the others, in the same order.
        weights.iter_mut().for_each(|weight| *weight = weight.div_ceil(2));
        depths = weights;
    }
}

fn leaf(weight: u32, symbol: usize) -> u64 {
    u64::from(weight) << 32 | symbol as u64
}

/// Puts how deep leaves lie in place of their weights, from the lightest to the heaviest, where the two lightest of leaves and
/// pairs are made a pair until one is left. How deep the deepest lies. Source: Moffat and Katajainen (1995), "In-place calculation
/// of minimum-redundancy codes".
fn depths_of(nodes: &mut [u64]) -> u64 {
    let count = nodes.len();
    // Pairs come about from the lightest to the heaviest, too: each takes the place of a leaf that is in one, and later its own
    // weight is replaced by the place of the pair that it is in.
    let (mut leaf, mut pair) = (0, 0);
    for next in 0..count - 1 {
        let mut both = 0;
        for _ in 0..2 {
            if leaf < count && (pair == next || nodes[leaf] <= nodes[pair]) {
                both += nodes[leaf];
                leaf += 1;
            } else {
                both += nodes[pair];
                nodes[pair] = next as u64;
                pair += 1;
            }
        }
        nodes[next] = both;
    }
    // The last pair is the root; the others lie one deeper than the pair that they are in.
    nodes[count - 2] = 0;
    for pair in (0..count - 2).rev() {
        nodes[pair] = nodes[nodes[pair] as usize] + 1;
    }
    // At each depth there is room for twice the pairs above it: what of it no pairs take, leaves do, the heaviest first.
    let (mut pairs, mut leaves) = (count - 1, count);
    let (mut depth, mut room) = (0, 1);
    while leaves > 0 {
        let taken = nodes[..pairs].iter().rev().take_while(|of_pair| **of_pair == depth).count();
        pairs -= taken;
        for _ in taken..room {
            leaves -= 1;
            nodes[leaves] = depth;
        }
        room = 2 * taken;
        depth += 1;
    }
    depth - 1
}

/// The codes of these lengths, as Deflate numbers them.
fn codes<const N: usize>(lengths: &[u8]) -> [Code; N] {
    let mut counts = [0_u32; LONGEST_CODE + 1];
    lengths.iter().filter(|length| **length > 0).for_each(|length| counts[usize::from(*length)] += 1);
    // The next code of each length, from the first on.
    let mut next = [0_u32; LONGEST_CODE + 1];
    for length in 1..LONGEST_CODE {
        next[length + 1] = (next[length] + counts[length]) << 1;
    }
    std::array::from_fn(|symbol| match u32::from(lengths[symbol]) {
        0 => Code::default(),
        count => {
            let code = &mut next[count as usize];
            *code += 1;
            Code { bits: (*code - 1).reverse_bits() >> (32 - count), count }
        }
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn codes_fill_the_tree_and_none_is_too_long() {
        let fibonacci = |k: usize| (0..k.min(40)).fold((1_u32, 1_u32), |(a, b), _| (b, a + b)).0;
        let weights: [&dyn Fn(usize) -> u32; 7] = [
            &|_| 1,
            &fibonacci,
            &|k| 1 + (k as u32 * 7919) % 1000,
            &|k| if k == 0 { u32::MAX } else { 1 },
            &|k| u32::from(k % 7 == 3) * k as u32,
            &|k| u32::from(k == 200),
            &|_| 0,
        ];
        for (number, weight) in weights.iter().enumerate() {
            let weights: [u32; SYMBOLS] = std::array::from_fn(weight);
            for longest in [LONGEST_CODE, 9] {
                let mut lengths = [0; SYMBOLS];
                code_lengths(&weights, longest, &mut lengths);
                let filled: u32 =
                    lengths.iter().filter(|one| **one > 0).map(|one| 1 << (longest - usize::from(*one))).sum();
                assert_eq!(filled, 1 << longest, "{number}");
                for a in (0..SYMBOLS).filter(|a| weights[*a] > 0) {
                    assert!(lengths[a] > 0, "{number}");
                    assert!(
                        (0..SYMBOLS).all(|b| weights[a] <= weights[b] || lengths[a] <= lengths[b] || weights[b] == 0)
                    );
                }
            }
        }
    }

    #[test]
    fn lengths_and_distances_of_matches_have_the_codes_of_the_format() {
        assert_eq!(
            [3, 10, 11, 12, 13, 34, 226, 227, 257, 258].map(|length| OF_LENGTH[length]),
            [0, 7, 8, 8, 9, 15, 26, 27, 27, 28]
        );
        for length in MATCHES[0]..=MATCHES[1] {
            let (shortest, extra) = LENGTHS[usize::from(OF_LENGTH[length])];
            assert!(length - shortest < 1 << extra || (length == shortest && extra == 0), "{length}");
        }
        let distances = [1, 4, 5, 6, 7, 9, 12, 13, 24_576, 24_577, 32_768].map(of_distance);
        let expected = [(0, 0, 0), (3, 0, 0), (4, 1, 0), (4, 1, 1), (5, 1, 0), (6, 2, 0), (6, 2, 3), (7, 2, 0)];
        assert_eq!(distances[..8], expected);
        assert_eq!(distances[8..], [(28, 13, 8191), (29, 13, 0), (29, 13, 8191)]);
    }
}
