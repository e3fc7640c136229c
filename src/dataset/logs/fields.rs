//! The fields of a message, one after the other: as ROS 2 writes them (CDR: each number at a multiple of its own size,
//! in either order of bytes) and as ROS 1 does (packed, little endian).

/// How the fields of a message became bytes.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Serialization {
    /// ROS 1.
    Ros1,
    /// ROS 2: CDR with its header of four bytes.
    Cdr,
}

impl Serialization {
    /// Returns the serialization that a log calls so; `None` for those that cannot be read.
    pub fn from_name(name: &str) -> Option<Self> {
        match name {
            "ros1" => Some(Self::Ros1),
            "cdr" => Some(Self::Cdr),
            _ => None,
        }
    }
}

/// A place in a message, at which the next field begins.
pub struct Fields<'a> {
    bytes: &'a [u8],
    at: usize,
    serialization: Serialization,
    is_big_endian: bool,
}

impl<'a> Fields<'a> {
    /// Returns the first field of a message. The error says that its CDR is of another kind.
    pub fn new(message: &'a [u8], serialization: Serialization) -> Result<Self, String> {
        let (bytes, is_big_endian) = match (serialization, message) {
            (Serialization::Ros1, _) => (message, false),
            (Serialization::Cdr, [0, order @ (0 | 1), _, _, rest @ ..]) => (rest, *order == 0),
            (Serialization::Cdr, [a, b, ..]) => {
                return Err(format!("its CDR is of the kind {a:02x} {b:02x}, not 00 01"));
            }
            (Serialization::Cdr, _) => return Err(CUT.to_owned()),
        };
        Ok(Self { bytes, at: 0, serialization, is_big_endian })
    }

    /// Reads a number of N bytes, the lowest first.
    fn number<const N: usize>(&mut self) -> Result<[u8; N], String> {
        let at = match self.serialization {
            Serialization::Cdr => self.at.next_multiple_of(N),
            Serialization::Ros1 => self.at,
        };
        let mut bytes = *self.bytes.get(at..).and_then(<[u8]>::first_chunk::<N>).ok_or(CUT)?;
        self.at = at + N;
        if self.is_big_endian {
            bytes.reverse();
        }
        Ok(bytes)
    }

    /// Reads a byte.
    pub fn u8(&mut self) -> Result<u8, String> {
        self.number().map(u8::from_le_bytes)
    }

    /// Reads a whole number.
    pub fn u32(&mut self) -> Result<u32, String> {
        self.number().map(u32::from_le_bytes)
    }

    /// Reads a whole number.
    pub fn u16(&mut self) -> Result<u16, String> {
        self.number().map(u16::from_le_bytes)
    }

    /// Reads a whole number.
    pub fn u64(&mut self) -> Result<u64, String> {
        self.number().map(u64::from_le_bytes)
    }

    /// Reads a float.
    pub fn f64(&mut self) -> Result<f64, String> {
        self.number().map(f64::from_le_bytes)
    }

    /// Reads as many floats as there are.
    pub fn floats<const N: usize>(&mut self) -> Result<[f64; N], String> {
        let mut floats = [0.0; N];
        for float in &mut floats {
            *float = self.f64()?;
        }
        Ok(floats)
    }

    /// Reads a list of bytes, which says its length.
    pub fn bytes(&mut self) -> Result<&'a [u8], String> {
        let length = self.u32()? as usize;
        let found = self.bytes.get(self.at..).and_then(|rest| rest.get(..length)).ok_or(CUT)?;
        self.at += length;
        Ok(found)
    }

    /// Reads a text.
    pub fn text(&mut self) -> Result<&'a str, String> {
        let bytes = self.bytes()?;
        // CDR ends it with a zero, which counts.
        let bytes = match self.serialization {
            Serialization::Cdr => bytes.strip_suffix(&[0]).unwrap_or(bytes),
            Serialization::Ros1 => bytes,
        };
        str::from_utf8(bytes).map_err(|_| String::from("a text in it is not UTF-8"))
    }

    /// Reads a header and returns its time, ns since the epoch, and its frame.
    pub fn header(&mut self) -> Result<(u64, &'a str), String> {
        if self.serialization == Serialization::Ros1 {
            self.u32()?; // seq
        }
        let [seconds, nanoseconds] = [self.u32()?, self.u32()?].map(u64::from);
        Ok((seconds * 1_000_000_000 + nanoseconds, self.text()?))
    }
}

/// The error of a message that ends too early.
const CUT: &str = "it ends within its fields";

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_stand_at_multiples_of_their_size_in_either_order_and_packed_in_ros1() {
        let little = [0, 1, 0, 0, 7, 0, 0, 0, 2, 0, 0, 0, b'a', 0, 0, 0, 0, 0, 0, 0, 0, 0, 0xf8, 0x3f];
        let padded = [&little[..16], &[9, 9, 9, 9], &little[16..]].concat();
        let big = [0, 0, 0, 0, 7, 0, 0, 0, 0, 0, 0, 2, b'a', 0, 0, 0, 0, 0, 0, 0, 0x3f, 0xf8, 0, 0, 0, 0, 0, 0];
        let read = |bytes: &[u8], serialization| {
            let mut fields = Fields::new(bytes, serialization)?;
            Ok::<_, String>((fields.u8()?, fields.text()?.to_owned(), fields.f64()?))
        };
        let expected = Ok((7, String::from("a"), 1.5));
        assert_eq!(read(&padded, Serialization::Cdr), expected);
        assert_eq!(read(&big, Serialization::Cdr), expected);
        let packed = [&[7, 1, 0, 0, 0, b'a'], &1.5_f64.to_le_bytes()[..]].concat();
        assert_eq!(read(&packed, Serialization::Ros1), expected);
        for cut in 0..padded.len() {
            assert!(read(&padded[..cut], Serialization::Cdr).is_err(), "{cut}");
        }
        assert!(read(&[0, 7, 0, 0, 1], Serialization::Cdr).unwrap_err().contains("00 07"));
        // Four gigabytes are claimed.
        assert!(read(&[7, 255, 255, 255, 255, b'a'], Serialization::Ros1).is_err());
    }
}
