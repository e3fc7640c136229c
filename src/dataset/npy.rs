//! Two-dimensional arrays of numbers in NumPy's file format (NEP 1: npy 1.0 to 3.0).
//!
//! Our own reader: `npyz` multiplies the sizes that a header claims without checking, and takes as much memory as it
//! says the header has. Taken are float16, float32, float64 and unsigned integers, in either byte order, in C or Fortran order.

use half::f16;

use crate::grid::Grid;

/// What a file holds.
#[derive(Clone, Debug, PartialEq)]
pub struct Array {
    /// Its values, first axis down, second axis to the right. Never empty; NaN and infinities stay what they are.
    pub values: Grid<f32>,
    /// The largest value that the integer type of the file can hold; `None` for floats.
    pub most: Option<f32>,
}

/// Reads a file. On failure, what is wrong with it.
pub fn decode(bytes: &[u8]) -> Result<Array, String> {
    let (header, data) = split(bytes).ok_or("not an npy file")?;
    let Header { number, is_fortran, shape: [rows, columns] } = Header::read(header)?;
    let length = rows.checked_mul(columns).and_then(|count| count.checked_mul(number.size));
    if length != Some(data.len()) {
        let size = number.size;
        return Err(format!("it says {rows} x {columns} values of {size} bytes, but {} bytes follow", data.len()));
    }
    if data.is_empty() {
        return Err(String::from("it has no value"));
    }
    let mut values: Vec<f32> = data.chunks_exact(number.size).map(|bytes| number.read(bytes)).collect();
    if is_fortran {
        values = (0..rows * columns).map(|at| values[at % columns * rows + at / columns]).collect();
    }
    Ok(Array { values: Grid { width: columns, height: rows, data: values }, most: number.most() })
}

/// The header's text and the data.
fn split(bytes: &[u8]) -> Option<(&[u8], &[u8])> {
    let (version, rest) = bytes.strip_prefix(b"\x93NUMPY")?.split_first_chunk::<2>()?;
    let (length, rest) = match version {
        [1, _] => rest.split_first_chunk().map(|(length, rest)| (usize::from(u16::from_le_bytes(*length)), rest)),
        [2 | 3, _] => rest.split_first_chunk().map(|(length, rest)| (u32::from_le_bytes(*length) as usize, rest)),
        _ => None,
    }?;
    rest.split_at_checked(length)
}

/// How one value is stored.
#[derive(Clone, Copy)]
struct Number {
    is_float: bool,
    is_big_endian: bool,
    size: usize,
}

impl Number {
    /// From NumPy's name of the type, such as `<f4`.
    fn named(name: &str) -> Option<Self> {
        let (is_big_endian, rest) = match name.split_at_checked(1)? {
            ("<" | "|", rest) => (false, rest),
            (">", rest) => (true, rest),
            _ => return None,
        };
        let (is_float, size) = match rest {
            "f2" => (true, 2),
            "f4" => (true, 4),
            "f8" => (true, 8),
            "u1" => (false, 1),
            "u2" => (false, 2),
            "u4" => (false, 4),
            "u8" => (false, 8),
            _ => return None,
        };
        Some(Self { is_float, is_big_endian, size })
    }

    fn read(self, bytes: &[u8]) -> f32 {
        let mut ordered = [0; 8];
        let ordered_bytes = &mut ordered[..self.size];
        ordered_bytes.copy_from_slice(bytes);
        if self.is_big_endian {
            ordered_bytes.reverse();
        }
        let bits = u64::from_le_bytes(ordered);
        match (self.is_float, self.size) {
            (false, _) => bits as f32,
            (true, 2) => f16::from_bits(bits as u16).to_f32(),
            (true, 4) => f32::from_bits(bits as u32),
            (true, _) => f64::from_bits(bits) as f32,
        }
    }

    fn most(self) -> Option<f32> {
        (!self.is_float).then(|| (u64::MAX >> (64 - 8 * self.size)) as f32)
    }
}

struct Header {
    number: Number,
    is_fortran: bool,
    shape: [usize; 2],
}

impl Header {
    /// From a Python dictionary such as `{'descr': '<f4', 'fortran_order': False, 'shape': (3, 4), }`.
    fn read(text: &[u8]) -> Result<Self, String> {
        let mut words = Words(str::from_utf8(text).map_err(|_| "its header is not text")?);
        let (mut number, mut is_fortran, mut shape) = (None, None, None);
        words.expect('{')?;
        while !words.skip('}') {
            let key = words.quoted()?;
            words.expect(':')?;
            match key {
                "descr" => {
                    let name = words.quoted().map_err(|_| "its values are records, not numbers")?;
                    let unknown = || format!("its values are of type `{}`; {KNOWN}", name.escape_debug());
                    number = Some(Number::named(name).ok_or_else(unknown)?);
                }
                "fortran_order" => is_fortran = Some(words.truth()?),
                "shape" => shape = Some(words.shape()?),
                _ => return Err(format!("its header has an unknown key `{}`", key.escape_debug())),
            }
            if !words.skip(',') {
                words.expect('}')?;
                break;
            }
        }
        match (number, is_fortran, shape) {
            (Some(number), Some(is_fortran), Some(shape)) => Ok(Self { number, is_fortran, shape }),
            _ => Err(String::from("its header lacks `descr`, `fortran_order` or `shape`")),
        }
    }
}

const KNOWN: &str = "allowed: float16, float32, float64, uint8, uint16, uint32, uint64";

/// What is left of the header's text.
struct Words<'a>(&'a str);

impl<'a> Words<'a> {
    fn skip(&mut self, mark: char) -> bool {
        let rest = self.0.trim_start();
        self.0 = rest.strip_prefix(mark).unwrap_or(rest);
        self.0.len() < rest.len()
    }

    fn expect(&mut self, mark: char) -> Result<(), String> {
        if self.skip(mark) { Ok(()) } else { Err(format!("its header lacks a `{mark}`")) }
    }

    fn quoted(&mut self) -> Result<&'a str, String> {
        let quote = if self.skip('\'') { '\'' } else { '"' };
        if quote == '"' {
            self.expect('"')?;
        }
        let (text, rest) = self.0.split_once(quote).ok_or("its header has an open quote")?;
        self.0 = rest;
        if text.len() > 64 { Err(String::from("its header has a long text")) } else { Ok(text) }
    }

    fn truth(&mut self) -> Result<bool, String> {
        let text = self.0.trim_start();
        let found = [("True", true), ("False", false)].into_iter().find(|(name, _)| text.starts_with(name));
        let (name, truth) = found.ok_or("its `fortran_order` is neither True nor False")?;
        self.0 = &text[name.len()..];
        Ok(truth)
    }

    /// Two whole numbers in parentheses.
    fn shape(&mut self) -> Result<[usize; 2], String> {
        const TWO: &str = "its array does not have two dimensions";
        self.expect('(')?;
        let mut shape = [0; 2];
        for (axis, size) in shape.iter_mut().enumerate() {
            let text = self.0.trim_start();
            let end = text.find(|c: char| !c.is_ascii_digit()).unwrap_or(text.len());
            *size = text[..end].parse().map_err(|_| if end == 0 { TWO } else { "its array is too large" })?;
            self.0 = &text[end..];
            if !self.skip(',') && axis == 0 {
                return Err(String::from(TWO));
            }
        }
        self.expect(')').map_err(|_| TWO)?;
        Ok(shape)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn file(header: &str, data: &[u8]) -> Vec<u8> {
        let mut bytes = b"\x93NUMPY\x01\x00".to_vec();
        bytes.extend((header.len() as u16).to_le_bytes());
        bytes.extend(header.as_bytes());
        bytes.extend(data);
        bytes
    }

    fn header(descr: &str, order: &str, shape: &str) -> String {
        format!("{{'descr': '{descr}', 'fortran_order': {order}, 'shape': {shape}, }}          \n")
    }

    fn failure(header: &str, data: &[u8]) -> String {
        decode(&file(header, data)).unwrap_err()
    }

    /// As `numpy.save` writes `numpy.array([[0, 1, 2], [3, 4, 5]])`.
    #[test]
    fn every_type_order_and_byte_order_gives_the_same_array() {
        let expected = Grid { width: 3, height: 2, data: vec![0.0, 1.0, 2.0, 3.0, 4.0, 5.0] };
        for (order, values) in [("False", [0, 1, 2, 3, 4, 5_u8]), ("True", [0, 3, 1, 4, 2, 5])] {
            let stored = |name: &str| -> Vec<Vec<u8>> {
                let store = |v: u8| match name {
                    "f2" => f16::from_f32(v.into()).to_le_bytes().to_vec(),
                    "f4" => f32::from(v).to_le_bytes().to_vec(),
                    "f8" => f64::from(v).to_le_bytes().to_vec(),
                    "u1" => vec![v],
                    "u2" => u16::from(v).to_le_bytes().to_vec(),
                    "u4" => u32::from(v).to_le_bytes().to_vec(),
                    _ => u64::from(v).to_le_bytes().to_vec(),
                };
                values.map(store).to_vec()
            };
            for name in ["f2", "f4", "f8", "u1", "u2", "u4", "u8"] {
                let little = stored(name);
                let big: Vec<Vec<u8>> = little.iter().map(|value| value.iter().rev().copied().collect()).collect();
                for (mark, values) in [("<", &little), (">", &big)] {
                    let bytes = file(&header(&format!("{mark}{name}"), order, "(2, 3)"), &values.concat());
                    assert_eq!(decode(&bytes).unwrap().values, expected, "{mark}{name} {order}");
                }
            }
        }
    }

    #[test]
    fn integers_come_with_the_most_that_their_type_holds() {
        let of = |descr: &str, size: usize| {
            let array = decode(&file(&header(descr, "False", "(1, 1)"), &vec![0xff; size])).unwrap();
            assert_eq!(array.most, array.most.map(|_| array.values.data[0]));
            array.most
        };
        assert_eq!(of("|u1", 1), Some(255.0));
        assert_eq!(of("<u2", 2), Some(65535.0));
        assert_eq!(of(">u8", 8), Some(u64::MAX as f32));
        assert!(decode(&file(&header("<f8", "False", "(1, 1)"), &[0; 8])).unwrap().most.is_none());
    }

    #[test]
    fn versions_two_and_three_have_a_longer_length_and_keys_come_in_any_order() {
        let text = "{\"shape\":(1,1),\"fortran_order\":False,\"descr\":\"|u1\"}";
        for version in [2, 3] {
            let mut bytes = vec![0x93, b'N', b'U', b'M', b'P', b'Y', version, 0];
            bytes.extend((text.len() as u32).to_le_bytes());
            bytes.extend(text.as_bytes());
            bytes.push(7);
            assert_eq!(decode(&bytes).unwrap().values.data, [7.0]);
            // A header of 4 GB that is not there.
            bytes[8..12].fill(0xff);
            assert_eq!(decode(&bytes), Err(String::from("not an npy file")));
        }
    }

    #[test]
    fn what_is_no_two_dimensional_array_of_numbers_is_refused_with_a_reason() {
        let huge = header("<f4", "False", "(4294967296, 4294967296)");
        assert!(failure(&huge, &[0; 4]).contains("4294967296 x 4294967296 values of 4 bytes, but 4 bytes follow"));
        assert!(failure(&header("<f4", "False", "(1, 99999999999999999999)"), &[]).contains("too large"));
        assert!(failure(&header("<f4", "False", "(2, 2)"), &[0; 15]).contains("but 15 bytes follow"));
        assert!(failure(&header("<f4", "False", "(0, 5)"), &[]).contains("no value"));
        for shape in ["()", "(4,)", "(1, 2, 2)", "(-1, 4)", "4"] {
            let message = failure(&header("|u1", "False", shape), &[0; 4]);
            assert!(message.contains("two dimensions") || message.contains("lacks a `(`"), "{shape}: {message}");
        }
        assert!(failure(&header("<i4", "False", "(1, 1)"), &[0; 4]).contains("of type `<i4`; allowed: float16"));
        assert!(failure(&header("|O", "False", "(1, 1)"), &[0; 4]).contains("of type `|O`"));
        let records = "{'descr': [('x', '<f4')], 'fortran_order': False, 'shape': (1, 1), }";
        assert!(failure(records, &[0; 4]).contains("records"));
        assert!(failure("{'descr': '<f4'}", &[]).contains("lacks"));
        assert!(failure(&"(".repeat(60_000), &[]).contains("lacks a `{`"));
        assert!(decode(b"\x93NUMPY\x09\x00").is_err());
        assert!(decode(b"").is_err());
    }
}
