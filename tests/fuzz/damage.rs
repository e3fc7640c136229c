//! Damage to the bytes of a file, as disks, downloads and hostile people do it.

use proptest::prelude::*;
use proptest::sample::Index;

/// One thing that happens to a file.
#[derive(Clone, Debug)]
enum Damage {
    /// A bit is turned over.
    Flip(Index, u8),
    /// The rest is lost.
    Cut(Index),
    /// A part is lost.
    Lose(Index, usize),
    /// A part comes again and again.
    Repeat(Index, usize, usize),
    /// A part of another file takes the place of what was there.
    Splice(Index, Index, Index, usize),
    /// Digits become another number.
    Number(Index, &'static str),
    /// Four or eight bytes become a number of a binary header.
    Binary(Index, u64, usize),
}

const NUMBERS: [&str; 10] =
    ["0", "-1", "1e308", "-1e-320", "nan", "inf", "4294967295", "18446744073709551616", "1e999999", ""];

/// A file of `inputs` after up to eight accidents.
pub fn damaged(inputs: Vec<Vec<u8>>) -> impl Strategy<Value = Vec<u8>> {
    let binary = prop::sample::select(vec![0, 1, 0x7fff_ffff, 0x8000_0000, 0xffff_ffff, u64::MAX, 1 << 63]);
    let one = prop_oneof![
        3 => (any::<Index>(), 0..8_u8).prop_map(|(at, bit)| Damage::Flip(at, bit)),
        1 => any::<Index>().prop_map(Damage::Cut),
        2 => (any::<Index>(), 1..40_usize).prop_map(|(at, length)| Damage::Lose(at, length)),
        2 => (any::<Index>(), 1..40_usize, 1..30_usize).prop_map(|(at, length, times)| Damage::Repeat(at, length, times)),
        2 => (any::<Index>(), any::<Index>(), any::<Index>(), 1..200_usize)
            .prop_map(|(at, other, from, length)| Damage::Splice(at, other, from, length)),
        2 => (any::<Index>(), prop::sample::select(NUMBERS.to_vec())).prop_map(|(at, text)| Damage::Number(at, text)),
        2 => (any::<Index>(), binary, prop::sample::select(vec![1, 2, 4, 8]))
            .prop_map(|(at, value, size)| Damage::Binary(at, value, size)),
    ];
    (any::<Index>(), prop::collection::vec(one, 1..8)).prop_map(move |(start, accidents)| {
        accidents.iter().fold(start.get(&inputs).clone(), |bytes, accident| with_damage(bytes, accident, &inputs))
    })
}

fn with_damage(mut bytes: Vec<u8>, damage: &Damage, inputs: &[Vec<u8>]) -> Vec<u8> {
    // One past the end is a place too.
    let place = |at: &Index, bytes: &[u8]| at.index(bytes.len() + 1);
    match damage {
        Damage::Flip(at, bit) => {
            let at = place(at, &bytes);
            bytes.get_mut(at).into_iter().for_each(|byte| *byte ^= 1 << bit);
        }
        Damage::Cut(at) => bytes.truncate(place(at, &bytes)),
        Damage::Lose(at, length) => {
            let at = place(at, &bytes);
            bytes.drain(at..bytes.len().min(at + length));
        }
        Damage::Repeat(at, length, times) => {
            let at = place(at, &bytes);
            let part = bytes[at..bytes.len().min(at + length)].repeat(*times);
            bytes.splice(at..at, part);
        }
        Damage::Splice(at, other, from, length) => {
            let (at, other) = (place(at, &bytes), other.get(inputs));
            let from = place(from, other);
            let part = other[from..other.len().min(from + length)].to_vec();
            let end = bytes.len().min(at + part.len());
            bytes.splice(at..end, part);
        }
        Damage::Number(at, text) => {
            let at = place(at, &bytes);
            let is_digit = |byte: &u8| byte.is_ascii_digit() || matches!(byte, b'.' | b'-');
            let start = bytes[at..].iter().position(is_digit).map_or(bytes.len(), |found| at + found);
            let length = bytes[start..].iter().take_while(|byte| is_digit(byte)).count();
            bytes.splice(start..start + length, text.bytes());
        }
        Damage::Binary(at, value, size) => {
            let at = place(at, &bytes);
            let end = bytes.len().min(at + size);
            bytes[at..end].copy_from_slice(&value.to_le_bytes()[..end - at]);
        }
    }
    bytes
}
