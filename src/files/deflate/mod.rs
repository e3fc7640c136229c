//! Deflate (RFC 1951) in zlib streams (RFC 1950) for differences of neighbouring values: blocks with Huffman codes that fit them.
//!
//! Crates do this for any bytes. Here literals go eight at a time, and what noise makes of a picture is not searched for
//! matches: there are none.

mod codes;
mod matches;

pub use codes::{Codes, Histogram};
pub use matches::{Finder, Runs};

use codes::{HEAD_BYTES, LONGEST_CODE};
use gelsim_core::base::simd::simd_dispatch;
use simd_adler32::Adler32;

/// Shortest and longest match.
const MATCHES: [usize; 2] = [3, 258];
/// How far back a match lies at most.
const FARTHEST: usize = 1 << 15;
/// A zlib stream begins so.
const HEAD: [u8; 2] = [0x78, 0x01];

/// Bytes that know how they are taken apart.
pub trait Content {
    /// The bytes themselves.
    fn bytes(&self) -> &[u8];
    /// Takes them apart.
    fn pieces(&self, pieces: &mut impl Pieces);
}

/// What bytes are taken apart into.
pub trait Pieces {
    /// Bytes as they are.
    fn literals(&mut self, bytes: &[u8]);
    /// As many bytes as one match holds, which are those a distance before.
    fn again(&mut self, length: usize, distance: usize);

    /// Three bytes or more, which are those a distance before.
    #[inline(always)]
    fn copy(&mut self, mut length: usize, distance: usize) {
        let [shortest, longest] = MATCHES;
        while length > longest {
            // What is left must be a match, too.
            let count = longest.min(length - shortest);
            self.again(count, distance);
            length -= count;
        }
        self.again(length, distance);
    }
}

/// A stream being written into a buffer, in place of what is in it.
pub struct Zlib<'a> {
    out: &'a mut Vec<u8>,
    tail: Tail,
    sum: Adler32,
}

impl<'a> Zlib<'a> {
    /// Begins a stream.
    pub fn new(out: &'a mut Vec<u8>) -> Self {
        Self { out, tail: Tail { at: HEAD.len(), bits: 0, count: 0 }, sum: Adler32::new() }
    }

    /// Begins a block of these codes, the stream's last one or not.
    pub fn begin(&mut self, codes: &Codes, last: bool) {
        let (out, mut tail) = self.room(HEAD_BYTES);
        codes.head(last, |bits, count| tail.put(out, u64::from(bits), count));
        self.tail = tail;
    }

    /// Writes bytes into the block that was begun with these codes, which were made for them.
    pub fn write(&mut self, codes: &Codes, content: &impl Content) {
        self.sum.write(content.bytes());
        // More than a match of the bytes takes. With wide vectors come shifts by any number of bits.
        let (out, tail) = self.room(content.bytes().len() * LONGEST_CODE / 8);
        self.tail = simd_dispatch(
            #[inline(always)]
            move || {
                let mut written = Written { out, tail, codes };
                content.pieces(&mut written);
                written.tail
            },
        );
    }

    /// Ends the block that was begun with these codes.
    pub fn end(&mut self, codes: &Codes) {
        let (out, mut tail) = self.room(LONGEST_CODE);
        tail.put(out, u64::from(codes.end.bits), codes.end.count);
        self.tail = tail;
    }

    /// Ends the stream: the buffer holds it and nothing else.
    pub fn finish(mut self) {
        let (out, mut tail) = self.room(1);
        let odd = (8 - tail.count) % 8;
        tail.put(out, 0, odd);
        self.out.truncate(tail.at);
        self.out[..HEAD.len()].copy_from_slice(&HEAD);
        self.out.extend(self.sum.finish().to_be_bytes());
    }

    /// The buffer, with room for so many bytes and those that are written at a time, and where it goes on.
    fn room(&mut self, bytes: usize) -> (&mut [u8], Tail) {
        let wanted = self.tail.at + bytes + 16;
        if self.out.len() < wanted {
            self.out.resize(wanted.max(self.out.len() * 3 / 2), 0);
        }
        (self.out, self.tail)
    }
}

/// Where a stream goes on, and the bits of the byte there. A copy of it lies in registers while much is written.
#[derive(Clone, Copy)]
struct Tail {
    at: usize,
    bits: u64,
    count: u32,
}

/// So many bits are written at a time beside what is left of a byte: not all 64 may be done with at once.
const MOST_BITS: u32 = 56;

impl Tail {
    /// Writes up to [`MOST_BITS`].
    #[inline(always)]
    fn put(&mut self, out: &mut [u8], bits: u64, count: u32) {
        self.bits |= bits << self.count;
        self.count += count;
        out[self.at..][..8].copy_from_slice(&self.bits.to_le_bytes());
        self.at += (self.count / 8) as usize;
        self.bits >>= self.count & !7;
        self.count &= 7;
    }
}

struct Written<'a> {
    out: &'a mut [u8],
    tail: Tail,
    codes: &'a Codes,
}

impl Written<'_> {
    /// The bits of four literals, and how many.
    #[inline(always)]
    fn four(&self, bytes: [u8; 4]) -> (u64, u32) {
        let [a, b, c, d] = bytes.map(|byte| self.codes.literals[usize::from(byte)]);
        let first = u64::from(a.bits) | u64::from(b.bits) << a.count;
        let second = u64::from(c.bits) | u64::from(d.bits) << c.count;
        let half = a.count + b.count;
        (first | second << half, half + c.count + d.count)
    }
}

impl Pieces for Written<'_> {
    #[inline(always)]
    fn literals(&mut self, bytes: &[u8]) {
        let (eights, rest) = bytes.as_chunks::<8>();
        for [a, b, c, d, e, f, g, h] in eights {
            let (first, second) = (self.four([*a, *b, *c, *d]), self.four([*e, *f, *g, *h]));
            // Most of the time there is room for all of them.
            if first.1 + second.1 <= MOST_BITS {
                self.tail.put(self.out, first.0 | second.0 << first.1, first.1 + second.1);
            } else {
                self.tail.put(self.out, first.0, first.1);
                self.tail.put(self.out, second.0, second.1);
            }
        }
        for byte in rest {
            let code = self.codes.literals[usize::from(*byte)];
            self.tail.put(self.out, u64::from(code.bits), code.count);
        }
    }

    #[inline(always)]
    fn again(&mut self, length: usize, distance: usize) {
        let (bits, count) = self.codes.again(length, distance);
        self.tail.put(self.out, bits, count);
    }
}

#[cfg(test)]
mod tests {
    use miniz_oxide::inflate::decompress_to_vec_zlib;
    use proptest::prelude::*;

    use super::*;

    /// A stream of two blocks of the same content, with these codes.
    fn stream(content: &impl Content, codes: &Codes) -> Vec<u8> {
        let mut out = Vec::new();
        let mut stream = Zlib::new(&mut out);
        for last in [false, true] {
            stream.begin(codes, last);
            stream.write(codes, content);
            stream.end(codes);
        }
        stream.finish();
        out
    }

    fn check(content: &impl Content, bytes: &[u8], more: Option<Codes>) {
        let mut histogram = Histogram::new();
        histogram.add(content);
        for codes in [Codes::of(&histogram), Codes::estimated(&histogram)].iter().chain(&more) {
            let unpacked = decompress_to_vec_zlib(&stream(content, codes)).expect("a stream");
            assert!(unpacked == [bytes, bytes].concat());
        }
    }

    /// In both ways to look for matches.
    fn check_both(bytes: &[u8]) {
        // Runs may be written with codes for which none was counted.
        check(&Runs(bytes), bytes, Some(Codes::estimated(&Histogram::new())));
        check(&Finder::default().find(bytes), bytes, None);
    }

    proptest! {
        #[test]
        fn any_bytes_come_back(
            runs in proptest::collection::vec((any::<u8>(), 0..700_usize, 1..5_u8), 0..40),
            far in 0..2_usize,
        ) {
            // Runs, patterns, and the whole once more, from so far away that some of it is out of reach.
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
