//! Builds the Huffman codes of a Deflate block (RFC 1951) from how often its symbols occur.

use super::{MATCH_LENGTHS, MAX_DISTANCE, TokenSink, TokenSource};

/// Bits of the longest code. Four such codes and the rest of a byte fit into 64 bits.
pub const MAX_CODE_BITS: usize = 14;
/// Number of symbols: literals, the end of the block, and the codes of match lengths.
const SYMBOL_COUNT: usize = 286;
const END_OF_BLOCK: usize = 256;
/// Number of codes of distances.
const DISTANCE_CODE_COUNT: usize = 30;
/// Number of symbols by which a block writes the lengths of its codes.
const CODE_LENGTH_SYMBOLS: usize = 19;
/// Bits of the longest code of such a symbol.
const MAX_CODE_LENGTH_BITS: usize = 7;
/// Most bytes of a block's header: 17 bits, three for each code of a code length, and for each code length a code and
/// as many extra bits.
pub const MAX_HEADER_BYTES: usize =
    (17 + 3 * CODE_LENGTH_SYMBOLS + 2 * MAX_CODE_LENGTH_BITS * (SYMBOL_COUNT + DISTANCE_CODE_COUNT)) / 8 + 1;

/// The shortest match length of each length code, and the number of extra bits that say how much longer the match is:
/// eight codes of one length, then four each of 2, 4, 8, 16 and 32 lengths, and the longest.
const LENGTH_CODES: [(usize, u32); 29] = {
    let mut lengths = [(MATCH_LENGTHS[1], 0); 29];
    let mut code = 0;
    while code < 28 {
        let bits = if code < 8 { 0 } else { code / 4 - 1 };
        lengths[code] = (MATCH_LENGTHS[0] + if bits == 0 { code } else { (4 + code % 4) << bits }, bits as u32);
        code += 1;
    }
    lengths
};

/// The index in [`LENGTH_CODES`] of each match length.
const LENGTH_TO_CODE: [u8; MATCH_LENGTHS[1] + 1] = {
    let mut numbers = [0; MATCH_LENGTHS[1] + 1];
    let mut length = MATCH_LENGTHS[0];
    let mut code = 0;
    while length <= MATCH_LENGTHS[1] {
        if code + 1 < LENGTH_CODES.len() && LENGTH_CODES[code + 1].0 <= length {
            code += 1;
        }
        numbers[length] = code as u8;
        length += 1;
    }
    numbers
};

/// Returns the code of a distance, the number of its extra bits, and these bits. There are four codes of one distance,
/// then two each of 2, 4, 8 and so on.
#[inline(always)]
fn encode_distance(distance: usize) -> (usize, u32, u64) {
    debug_assert!((1..=MAX_DISTANCE).contains(&distance));
    let less = distance - 1;
    if less < 4 {
        return (less, 0, 0);
    }
    let bits = less.ilog2() - 1;
    (2 * bits as usize + (less >> bits), bits, (less & ((1 << bits) - 1)) as u64)
}

/// How often each symbol occurs in a block.
pub struct Histogram {
    /// Counted in four tables, so that two equal bytes in a row do not wait for each other.
    literals: [[u32; 256]; 4],
    lengths: [u32; LENGTH_CODES.len()],
    distances: [u32; DISTANCE_CODE_COUNT],
}

impl Histogram {
    /// Makes a histogram in which nothing has been counted.
    pub fn new() -> Self {
        Self { literals: [[0; 256]; 4], lengths: [0; LENGTH_CODES.len()], distances: [0; DISTANCE_CODE_COUNT] }
    }

    /// Counts the tokens of `content`.
    pub fn count_tokens(&mut self, content: &impl TokenSource) {
        content.emit_tokens(self);
    }

    fn symbol_weights(&self) -> [u32; SYMBOL_COUNT] {
        let mut weights = [0; SYMBOL_COUNT];
        for (value, weight) in weights[..END_OF_BLOCK].iter_mut().enumerate() {
            *weight = self.literals.iter().map(|counts| counts[value]).sum();
        }
        weights[END_OF_BLOCK] = 1;
        weights[END_OF_BLOCK + 1..].copy_from_slice(&self.lengths);
        weights
    }
}

impl TokenSink for Histogram {
    #[inline(always)]
    fn push_literals(&mut self, bytes: &[u8]) {
        let (fours, rest) = bytes.as_chunks::<4>();
        for four in fours {
            for (counts, byte) in self.literals.iter_mut().zip(four) {
                counts[usize::from(*byte)] += 1;
            }
        }
        rest.iter().for_each(|byte| self.literals[0][usize::from(*byte)] += 1);
    }

    #[inline(always)]
    fn push_match(&mut self, length: usize, distance: usize) {
        self.lengths[usize::from(LENGTH_TO_CODE[length])] += 1;
        self.distances[encode_distance(distance).0] += 1;
    }
}

/// The bits of a code, the first one lowest, and their number.
#[derive(Clone, Copy, Default)]
pub struct Code {
    pub bits: u32,
    pub count: u32,
}

/// The Huffman codes of a block.
pub struct HuffmanCodes {
    pub literals: [Code; 256],
    pub end: Code,
    lengths: [Code; LENGTH_CODES.len()],
    distances: [Code; DISTANCE_CODE_COUNT],
    /// Length in bits of the code of each symbol and then of each distance; 0 for one that does not occur.
    code_lengths: [u8; SYMBOL_COUNT + DISTANCE_CODE_COUNT],
}

impl HuffmanCodes {
    /// Builds the codes for exactly what has been counted. Nothing else can be written with them.
    pub fn from_histogram(histogram: &Histogram) -> Self {
        Self::from_weights(&histogram.symbol_weights(), &histogram.distances)
    }

    /// Builds codes for content of which only a part has been counted: any byte may occur, and matches at the distances
    /// that have been seen, or at 1.
    pub fn from_estimate(histogram: &Histogram) -> Self {
        // Every symbol gets a weight, so that each has a code; those that were seen weigh more.
        Self::from_weights(&histogram.symbol_weights().map(|weight| 1 + 8 * weight), &histogram.distances)
    }

    fn from_weights(symbols: &[u32; SYMBOL_COUNT], distances: &[u32; DISTANCE_CODE_COUNT]) -> Self {
        let mut bits = [0; SYMBOL_COUNT + DISTANCE_CODE_COUNT];
        let (of_symbols, of_distances) = bits.split_at_mut(SYMBOL_COUNT);
        compute_code_lengths(symbols, MAX_CODE_BITS, of_symbols);
        compute_code_lengths(distances, MAX_CODE_BITS, of_distances);
        let codes: [Code; SYMBOL_COUNT] = assign_codes(of_symbols);
        let distances = self::assign_codes(of_distances);
        let mut literals = [Code::default(); END_OF_BLOCK];
        let mut lengths = [Code::default(); LENGTH_CODES.len()];
        literals.copy_from_slice(&codes[..END_OF_BLOCK]);
        lengths.copy_from_slice(&codes[END_OF_BLOCK + 1..]);
        Self { literals, end: codes[END_OF_BLOCK], lengths, distances, code_lengths: bits }
    }

    /// Returns the bits of a match, and their number.
    #[inline(always)]
    pub fn encode_match(&self, length: usize, distance: usize) -> (u64, u32) {
        let number = usize::from(LENGTH_TO_CODE[length]);
        let ((shortest, longer), code) = (LENGTH_CODES[number], self.lengths[number]);
        let (of_distance, farther, rest) = encode_distance(distance);
        let far = self.distances[of_distance];
        let length = u64::from(code.bits) | ((length - shortest) as u64) << code.count;
        let distance = u64::from(far.bits) | rest << far.count;
        let before = code.count + longer;
        (length | distance << before, before + far.count + farther)
    }

    /// Writes the header of a block, piece by piece, with `put(bits, count)`: its type and the lengths of its codes.
    pub fn write_header(&self, last: bool, mut put: impl FnMut(u32, u32)) {
        // The order in which the format writes the lengths of the codes of code lengths.
        const ORDER: [usize; CODE_LENGTH_SYMBOLS] = [16, 17, 18, 0, 8, 7, 9, 6, 10, 5, 11, 4, 12, 3, 13, 2, 14, 1, 15];
        let told = run_length_encode(&self.code_lengths);
        let mut counts = [0; CODE_LENGTH_SYMBOLS];
        told.iter().for_each(|told| counts[told.symbol] += 1);
        let mut lengths = [0; CODE_LENGTH_SYMBOLS];
        compute_code_lengths(&counts, MAX_CODE_LENGTH_BITS, &mut lengths);
        let codes: [Code; CODE_LENGTH_SYMBOLS] = assign_codes(&lengths);
        // The block's head by RFC 1951: last block or not, type 2 (dynamic codes), and three counts less their least
        // values.
        put(u32::from(last), 1);
        put(2, 2);
        put(SYMBOL_COUNT as u32 - 257, 5);
        put(DISTANCE_CODE_COUNT as u32 - 1, 5);
        put(CODE_LENGTH_SYMBOLS as u32 - 4, 4);
        ORDER.iter().for_each(|symbol| put(u32::from(lengths[*symbol]), 3));
        for CodeLengthToken { symbol, extra_bits: more } in told {
            let code = codes[symbol];
            put(code.bits | more.bits << code.count, code.count + more.count);
        }
    }
}

/// One symbol of the list of code lengths: a length, or how often one is repeated.
struct CodeLengthToken {
    symbol: usize,
    extra_bits: Code,
}

/// Encodes the lengths of codes as a block writes them, with runs of equal ones put together.
fn run_length_encode(lengths: &[u8]) -> Vec<CodeLengthToken> {
    let mut told = Vec::with_capacity(lengths.len());
    for same in lengths.chunk_by(|a, b| a == b) {
        let symbol = usize::from(same[0]);
        let mut left = same.len();
        if symbol > 0 {
            told.push(CodeLengthToken { symbol, extra_bits: Code::default() });
            left -= 1;
        }
        while left > 0 {
            // The symbol, the fewest and the most repeats that it stands for, and its number of extra bits.
            let (repeat, fewest, most, count) = match (symbol, left) {
                (0, 11..) => (18, 11, 138, 7),
                (0, 3..) => (17, 3, 10, 3),
                (_, 3..) => (16, 3, 6, 2),
                _ => (symbol, 1, 1, 0),
            };
            let taken = left.min(most);
            told.push(CodeLengthToken { symbol: repeat, extra_bits: Code { bits: (taken - fewest) as u32, count } });
            left -= taken;
        }
    }
    told
}

/// Computes the lengths of the codes, at most `longest` bits: the shortest possible ones, unless one would be too long.
/// A symbol that does not occur has 0. There are always two codes or more, of one bit at least, since some decoders
/// want a complete tree.
fn compute_code_lengths(weights: &[u32], longest: usize, lengths: &mut [u8]) {
    // Weight and symbol are packed into one number, by which the leaves are sorted.
    let mut leaves = [0_u64; SYMBOL_COUNT];
    let mut count = 0;
    for (symbol, weight) in weights.iter().enumerate() {
        // Written even if the symbol does not occur: the next one then takes its place.
        leaves[count] = pack_leaf(*weight, symbol);
        count += usize::from(*weight > 0);
    }
    // Symbols that do not occur fill up to two codes.
    for symbol in (0..2).filter(|symbol| weights[*symbol] == 0).take(2_usize.saturating_sub(count)) {
        leaves[count] = pack_leaf(1, symbol);
        count += 1;
    }
    let leaves = &mut leaves[..count];
    leaves.sort_unstable();
    let mut weights = [0; SYMBOL_COUNT];
    for (weight, leaf) in weights.iter_mut().zip(&*leaves) {
        *weight = leaf >> 32;
    }
    let mut depths = weights;
    loop {
        let deepest = replace_weights_by_depths(&mut depths[..count]);
        if deepest as usize <= longest {
            break leaves.iter().zip(depths).for_each(|(leaf, depth)| lengths[*leaf as u32 as usize] = depth as u8);
        }
        // A code is too long: halve the weights, which brings rare symbols nearer to the others and keeps their order.
        weights.iter_mut().for_each(|weight| *weight = weight.div_ceil(2));
        depths = weights;
    }
}

fn pack_leaf(weight: u32, symbol: usize) -> u64 {
    u64::from(weight) << 32 | symbol as u64
}

/// Replaces the weights of leaves, sorted from the lightest, by their depths in the Huffman tree, and returns the
/// greatest depth. Source: Moffat and Katajainen (1995), "In-place calculation of minimum-redundancy codes".
fn replace_weights_by_depths(nodes: &mut [u64]) -> u64 {
    let count = nodes.len();
    // Pairs are formed from the lightest to the heaviest, too. Each takes the place of a leaf that is already in a
    // pair, and later its weight is replaced by the index of the pair that it is in.
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
    // The last pair is the root. Every other pair lies one deeper than the pair that it is in.
    nodes[count - 2] = 0;
    for pair in (0..count - 2).rev() {
        nodes[pair] = nodes[nodes[pair] as usize] + 1;
    }
    // Each depth has room for twice as many nodes as there are pairs above it. Leaves take the room that pairs leave,
    // the heaviest first.
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

/// Numbers the codes of these lengths as Deflate does.
fn assign_codes<const N: usize>(lengths: &[u8]) -> [Code; N] {
    let mut counts = [0_u32; MAX_CODE_BITS + 1];
    lengths.iter().filter(|length| **length > 0).for_each(|length| counts[usize::from(*length)] += 1);
    // The next free code of each length.
    let mut next = [0_u32; MAX_CODE_BITS + 1];
    for length in 1..MAX_CODE_BITS {
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
            let weights: [u32; SYMBOL_COUNT] = std::array::from_fn(weight);
            for longest in [MAX_CODE_BITS, 9] {
                let mut lengths = [0; SYMBOL_COUNT];
                compute_code_lengths(&weights, longest, &mut lengths);
                let filled: u32 =
                    lengths.iter().filter(|one| **one > 0).map(|one| 1 << (longest - usize::from(*one))).sum();
                assert_eq!(filled, 1 << longest, "{number}");
                for a in (0..SYMBOL_COUNT).filter(|a| weights[*a] > 0) {
                    assert!(lengths[a] > 0, "{number}");
                    assert!(
                        (0..SYMBOL_COUNT)
                            .all(|b| weights[a] <= weights[b] || lengths[a] <= lengths[b] || weights[b] == 0)
                    );
                }
            }
        }
    }

    #[test]
    fn lengths_and_distances_of_matches_have_the_codes_of_the_format() {
        assert_eq!(
            [3, 10, 11, 12, 13, 34, 226, 227, 257, 258].map(|length| LENGTH_TO_CODE[length]),
            [0, 7, 8, 8, 9, 15, 26, 27, 27, 28]
        );
        for length in MATCH_LENGTHS[0]..=MATCH_LENGTHS[1] {
            let (shortest, extra) = LENGTH_CODES[usize::from(LENGTH_TO_CODE[length])];
            assert!(length - shortest < 1 << extra || (length == shortest && extra == 0), "{length}");
        }
        let distances = [1, 4, 5, 6, 7, 9, 12, 13, 24_576, 24_577, 32_768].map(encode_distance);
        let expected = [(0, 0, 0), (3, 0, 0), (4, 1, 0), (4, 1, 1), (5, 1, 0), (6, 2, 0), (6, 2, 3), (7, 2, 0)];
        assert_eq!(distances[..8], expected);
        assert_eq!(distances[8..], [(28, 13, 8191), (29, 13, 0), (29, 13, 8191)]);
    }
}
