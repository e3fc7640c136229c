//! Deflate (RFC 1951) in zlib streams (RFC 1950), with Huffman codes that fit the differences of neighbouring pixels.
//!
//! General crates do this for any bytes. This module is quicker on images, since it writes literals eight at a time and
//! does not search noise for matches that it does not have.

mod codes;
mod matches;

pub use codes::{Histogram, HuffmanCodes};
pub use matches::{MatchFinder, ZeroRuns};

use codes::{MAX_CODE_BITS, MAX_HEADER_BYTES};
use gelsim_core::base::simd::simd_dispatch;
use simd_adler32::Adler32;

/// Length of the shortest and of the longest match, bytes.
const MATCH_LENGTHS: [usize; 2] = [3, 258];
/// The greatest distance of a match, bytes.
const MAX_DISTANCE: usize = 1 << 15;
/// The first bytes of a zlib stream.
const ZLIB_HEADER: [u8; 2] = [0x78, 0x01];

/// Bytes that can be split into literals and matches.
pub trait TokenSource {
    /// The bytes themselves.
    fn bytes(&self) -> &[u8];
    /// Sends the tokens of the bytes to `pieces`, in order.
    fn emit_tokens(&self, pieces: &mut impl TokenSink);
}

/// Receives the tokens of a stream.
pub trait TokenSink {
    /// Takes bytes as they are.
    fn push_literals(&mut self, bytes: &[u8]);
    /// Takes one match: `length` bytes that equal the bytes `distance` before them. The length is one that a single
    /// match can have.
    fn push_match(&mut self, length: usize, distance: usize);

    /// Takes a match of any length of three or more, in pieces as long as one match can be.
    #[inline(always)]
    fn push_long_match(&mut self, mut length: usize, distance: usize) {
        let [shortest, longest] = MATCH_LENGTHS;
        while length > longest {
            // At least the shortest length must be left for the last match.
            let count = longest.min(length - shortest);
            self.push_match(count, distance);
            length -= count;
        }
        self.push_match(length, distance);
    }
}

/// Writes a zlib stream into a buffer and replaces what the buffer held.
pub struct ZlibWriter<'a> {
    out: &'a mut Vec<u8>,
    tail: BitWriter,
    sum: Adler32,
}

impl<'a> ZlibWriter<'a> {
    /// Begins a stream.
    pub fn new(out: &'a mut Vec<u8>) -> Self {
        Self { out, tail: BitWriter { at: ZLIB_HEADER.len(), bits: 0, count: 0 }, sum: Adler32::new() }
    }

    /// Begins a block with these codes; `last` says that no other block follows.
    pub fn begin_block(&mut self, codes: &HuffmanCodes, last: bool) {
        let (out, mut tail) = self.reserve(MAX_HEADER_BYTES);
        codes.write_header(last, |bits, count| tail.write_bits(out, u64::from(bits), count));
        self.tail = tail;
    }

    /// Writes bytes into the block begun last. The codes must be those of the block and fit the content.
    pub fn write(&mut self, codes: &HuffmanCodes, content: &impl TokenSource) {
        self.sum.write(content.bytes());
        // A literal takes at most the longest code, and a match no more than its bytes would. The dispatch is for the
        // faster shifts of processors with wide vectors.
        let (out, tail) = self.reserve(content.bytes().len() * MAX_CODE_BITS / 8);
        self.tail = simd_dispatch(
            #[inline(always)]
            move || {
                let mut written = TokenWriter { out, tail, codes };
                content.emit_tokens(&mut written);
                written.tail
            },
        );
    }

    /// Ends the block that was begun with these codes.
    pub fn end_block(&mut self, codes: &HuffmanCodes) {
        let (out, mut tail) = self.reserve(MAX_CODE_BITS);
        tail.write_bits(out, u64::from(codes.end.bits), codes.end.count);
        self.tail = tail;
    }

    /// Ends the stream. The buffer then holds the stream and nothing else.
    pub fn finish(mut self) {
        let (out, mut tail) = self.reserve(1);
        // The last byte is filled up with zeros.
        let odd = (8 - tail.count) % 8;
        tail.write_bits(out, 0, odd);
        self.out.truncate(tail.at);
        self.out[..ZLIB_HEADER.len()].copy_from_slice(&ZLIB_HEADER);
        self.out.extend(self.sum.finish().to_be_bytes());
    }

    /// Makes room for `bytes` more bytes and a last write of 8, and returns the buffer and the end of what is written.
    fn reserve(&mut self, bytes: usize) -> (&mut [u8], BitWriter) {
        // A write stores eight bytes, more than it advances.
        let wanted = self.tail.at + bytes + 16;
        if self.out.len() < wanted {
            self.out.resize(wanted.max(self.out.len() * 3 / 2), 0);
        }
        (self.out, self.tail)
    }
}

/// The end of a stream, and the bits of its last byte that are not yet written. A copy of it stays in registers while
/// much is written.
#[derive(Clone, Copy)]
struct BitWriter {
    at: usize,
    bits: u64,
    count: u32,
}

/// Most bits that are written at a time. Up to 7 bits of a byte are left from before, and 64 in all would not fit the
/// shifts.
const MAX_BITS: u32 = 56;

impl BitWriter {
    /// Writes up to [`MAX_BITS`] bits.
    #[inline(always)]
    fn write_bits(&mut self, out: &mut [u8], bits: u64, count: u32) {
        self.bits |= bits << self.count;
        self.count += count;
        // Always writes eight bytes, which is quicker than to write as many as are complete; the next write replaces
        // the rest.
        out[self.at..][..8].copy_from_slice(&self.bits.to_le_bytes());
        self.at += (self.count / 8) as usize;
        self.bits >>= self.count & !7;
        self.count &= 7;
    }
}

struct TokenWriter<'a> {
    out: &'a mut [u8],
    tail: BitWriter,
    codes: &'a HuffmanCodes,
}

impl TokenWriter<'_> {
    /// Returns the bits of four literals, and their number.
    #[inline(always)]
    fn encode_four_literals(&self, bytes: [u8; 4]) -> (u64, u32) {
        let [a, b, c, d] = bytes.map(|byte| self.codes.literals[usize::from(byte)]);
        let first = u64::from(a.bits) | u64::from(b.bits) << a.count;
        let second = u64::from(c.bits) | u64::from(d.bits) << c.count;
        let half = a.count + b.count;
        (first | second << half, half + c.count + d.count)
    }
}

impl TokenSink for TokenWriter<'_> {
    #[inline(always)]
    fn push_literals(&mut self, bytes: &[u8]) {
        let (eights, rest) = bytes.as_chunks::<8>();
        for [a, b, c, d, e, f, g, h] in eights {
            let (first, second) =
                (self.encode_four_literals([*a, *b, *c, *d]), self.encode_four_literals([*e, *f, *g, *h]));
            // Mostly all eight fit into one write.
            if first.1 + second.1 <= MAX_BITS {
                self.tail.write_bits(self.out, first.0 | second.0 << first.1, first.1 + second.1);
            } else {
                self.tail.write_bits(self.out, first.0, first.1);
                self.tail.write_bits(self.out, second.0, second.1);
            }
        }
        for byte in rest {
            let code = self.codes.literals[usize::from(*byte)];
            self.tail.write_bits(self.out, u64::from(code.bits), code.count);
        }
    }

    #[inline(always)]
    fn push_match(&mut self, length: usize, distance: usize) {
        let (bits, count) = self.codes.encode_match(length, distance);
        self.tail.write_bits(self.out, bits, count);
    }
}

#[cfg(test)]
mod tests {
    use miniz_oxide::inflate::decompress_to_vec_zlib;
    use proptest::prelude::*;

    use super::*;

    /// Writes a stream of two blocks of the same content with these codes.
    fn stream(content: &impl TokenSource, codes: &HuffmanCodes) -> Vec<u8> {
        let mut out = Vec::new();
        let mut stream = ZlibWriter::new(&mut out);
        for last in [false, true] {
            stream.begin_block(codes, last);
            stream.write(codes, content);
            stream.end_block(codes);
        }
        stream.finish();
        out
    }

    fn check(content: &impl TokenSource, bytes: &[u8], more: Option<HuffmanCodes>) {
        let mut histogram = Histogram::new();
        histogram.count_tokens(content);
        for codes in
            [HuffmanCodes::from_histogram(&histogram), HuffmanCodes::from_estimate(&histogram)].iter().chain(&more)
        {
            let unpacked = decompress_to_vec_zlib(&stream(content, codes)).expect("a stream");
            assert!(unpacked == [bytes, bytes].concat());
        }
    }

    /// Checks a round trip with both ways to search for matches.
    fn check_both(bytes: &[u8]) {
        // Codes from an estimate can write runs of which none was counted.
        check(&ZeroRuns(bytes), bytes, Some(HuffmanCodes::from_estimate(&Histogram::new())));
        check(&MatchFinder::default().find_matches(bytes), bytes, None);
    }

    proptest! {
        #[test]
        fn any_bytes_come_back(
            runs in proptest::collection::vec((any::<u8>(), 0..700_usize, 1..5_u8), 0..40),
            far in 0..2_usize,
        ) {
            // Runs, patterns, and all of it once more from so far away that some of it is out of reach.
            let mut bytes: Vec<u8> = Vec::new();
            for (value, count, period) in runs {
                bytes.extend((0..count).map(|k| value.wrapping_add((k % usize::from(period)) as u8)));
            }
            bytes.resize(bytes.len() + far * 30_000, 0);
            bytes.extend_from_within(..);
            check_both(&bytes);
        }
    }

    #[test]
    fn few_bytes_come_back() {
        for count in 0..40 {
            for bytes in [vec![0; count], vec![9; count], (0..count as u8).collect()] {
                check_both(&bytes);
            }
        }
    }
}
