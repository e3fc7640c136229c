//! Reads the header of an npy file (type, order and shape of the data) and the values in its data.

use half::f16;

/// Splits a file into its header and its data. `allowed` lists the types that are taken, for messages.
pub(super) fn split_header<'a>(bytes: &'a [u8], allowed: &str) -> Result<(Header<'a>, &'a [u8]), String> {
    let (text, data) = split_text(bytes).ok_or("not an npy file")?;
    Ok((Header::read(text, allowed)?, data))
}

/// Splits a file into the header's text and the data.
fn split_text(bytes: &[u8]) -> Option<(&[u8], &[u8])> {
    let (version, rest) = bytes.strip_prefix(b"\x93NUMPY")?.split_first_chunk::<2>()?;
    let (length, rest) = match version {
        [1, _] => rest.split_first_chunk().map(|(length, rest)| (usize::from(u16::from_le_bytes(*length)), rest)),
        [2 | 3, _] => rest.split_first_chunk().map(|(length, rest)| (u32::from_le_bytes(*length) as usize, rest)),
        _ => None,
    }?;
    rest.split_at_checked(length)
}

/// Kinds of numbers.
#[derive(Clone, Copy, PartialEq, Eq)]
pub(super) enum NumberKind {
    Float,
    Signed,
    Unsigned,
    /// True or false, one byte each.
    Bool,
}

/// How a value is stored.
#[derive(Clone, Copy)]
pub(super) struct NumberType {
    pub(super) kind: NumberKind,
    is_big_endian: bool,
    size: usize,
}

impl NumberType {
    /// Parses NumPy's name of a type, such as `<f4`.
    fn from_name(name: &str) -> Option<Self> {
        let (is_big_endian, rest) = match name.split_at_checked(1)? {
            ("<" | "|", rest) => (false, rest),
            (">", rest) => (true, rest),
            _ => return None,
        };
        let (kind, size) = rest.split_at_checked(1)?;
        let (kind, sizes) = match kind {
            "f" => (NumberKind::Float, ["2", "4", "8"].as_slice()),
            "i" => (NumberKind::Signed, ["1", "2", "4", "8"].as_slice()),
            "u" => (NumberKind::Unsigned, ["1", "2", "4", "8"].as_slice()),
            "b" => (NumberKind::Bool, ["1"].as_slice()),
            _ => return None,
        };
        let size = sizes.contains(&size).then(|| size.parse().ok())??;
        Some(Self { kind, is_big_endian, size })
    }

    fn read_value(self, bytes: &[u8]) -> f64 {
        let mut ordered = [0; 8];
        let ordered_bytes = &mut ordered[..self.size];
        ordered_bytes.copy_from_slice(bytes);
        if self.is_big_endian {
            ordered_bytes.reverse();
        }
        let bits = u64::from_le_bytes(ordered);
        match (self.kind, self.size) {
            (NumberKind::Unsigned, _) => bits as f64,
            (NumberKind::Bool, _) => f64::from(u8::from(bits != 0)),
            (NumberKind::Signed, size) => {
                let unused = 64 - 8 * size as u32;
                // Shift the sign bit to the top and back, which extends it.
                ((bits << unused) as i64 >> unused) as f64
            }
            (NumberKind::Float, 2) => f16::from_bits(bits as u16).to_f64(),
            (NumberKind::Float, 4) => f32::from_bits(bits as u32).into(),
            (NumberKind::Float, _) => f64::from_bits(bits),
        }
    }

    /// Returns the largest value of an integer type; `None` for floats and signed integers.
    pub(super) fn max_value(self) -> Option<f32> {
        match self.kind {
            NumberKind::Unsigned => Some((u64::MAX >> (64 - 8 * self.size)) as f32),
            NumberKind::Bool => Some(1.0),
            NumberKind::Float | NumberKind::Signed => None,
        }
    }
}

/// What a header says.
pub(super) struct Header<'a> {
    /// NumPy's name of the type.
    pub(super) type_name: &'a str,
    pub(super) number: NumberType,
    pub(super) is_fortran: bool,
    pub(super) shape: Vec<usize>,
}

/// Reads, from the beginning of an npy file up to the end of its header, the number of bytes of its data, also of a type
/// that is not taken. Returns `None` if the header does not say it.
pub fn read_announced_bytes(beginning: &[u8]) -> Option<u64> {
    let (text, _) = split_text(beginning)?;
    let WrittenHeader { type_name, shape, .. } = WrittenHeader::read(text).ok()?;
    // `<c16`, `|S5`, `<U3`, `<M8[ns]`: the byte order, the kind and the size.
    let (kind, size) = type_name.strip_prefix(['<', '>', '|'])?.split_at_checked(1)?;
    let end = size.find('[').unwrap_or(size.len());
    let each = match kind {
        "b" | "i" | "u" | "f" | "c" | "S" | "V" | "M" | "m" => 1,
        "U" => 4,
        // Python objects, which are as long as they are.
        _ => return None,
    };
    let each = size[..end].parse::<u64>().ok()?.checked_mul(each)?;
    shape.iter().try_fold(each, |length, size| length.checked_mul(*size as u64))
}

/// What a header says, before its type is looked up.
struct WrittenHeader<'a> {
    type_name: &'a str,
    is_fortran: bool,
    shape: Vec<usize>,
}

impl<'a> WrittenHeader<'a> {
    /// Parses a Python dictionary such as `{'descr': '<f4', 'fortran_order': False, 'shape': (3, 4), }`.
    fn read(text: &'a [u8]) -> Result<Self, String> {
        let mut words = HeaderParser(str::from_utf8(text).map_err(|_| "its header is not text")?);
        let (mut type_name, mut is_fortran, mut shape) = (None, None, None);
        words.expect_mark('{')?;
        while !words.skip_mark('}') {
            let key = words.parse_quoted()?;
            words.expect_mark(':')?;
            match key {
                "descr" => {
                    type_name = Some(words.parse_quoted().map_err(|_| "its values are records, not numbers")?);
                }
                "fortran_order" => is_fortran = Some(words.parse_bool()?),
                "shape" => shape = Some(words.parse_shape()?),
                _ => return Err(format!("its header has an unknown key `{}`", key.escape_debug())),
            }
            if !words.skip_mark(',') {
                words.expect_mark('}')?;
                break;
            }
        }
        match (type_name, is_fortran, shape) {
            (Some(type_name), Some(is_fortran), Some(shape)) => Ok(Self { type_name, is_fortran, shape }),
            _ => Err(String::from("its header lacks `descr`, `fortran_order` or `shape`")),
        }
    }
}

impl<'a> Header<'a> {
    fn read(text: &'a [u8], allowed: &str) -> Result<Self, String> {
        let WrittenHeader { type_name, is_fortran, shape } = WrittenHeader::read(text)?;
        let number = NumberType::from_name(type_name).ok_or_else(|| explain_unknown_type(type_name, allowed))?;
        Ok(Self { type_name, number, is_fortran, shape })
    }

    /// Returns the number of bytes of the data, or `None` if no memory is that large.
    pub(super) fn data_bytes(&self) -> Option<usize> {
        self.shape.iter().try_fold(self.number.size, |length, size| length.checked_mul(*size))
    }

    /// Reads the values, in C order.
    pub(super) fn read_values<T: Copy>(&self, data: &[u8], cast: impl Fn(f64) -> T) -> Result<Vec<T>, String> {
        let Self { number, shape, .. } = self;
        if self.data_bytes() != Some(data.len()) {
            let sizes: Vec<String> = shape.iter().map(usize::to_string).collect();
            let (sizes, size, found) = (sizes.join(" x "), number.size, data.len());
            return Err(format!("it says {sizes} values of {size} bytes, but {found} bytes follow"));
        }
        let values: Vec<T> = match self.type_name {
            // Nearly all files have these two types: read them without a look at the kind for every value.
            "<f4" => data.as_chunks().0.iter().map(|bytes| cast(f32::from_le_bytes(*bytes).into())).collect(),
            "<f8" => data.as_chunks().0.iter().map(|bytes| cast(f64::from_le_bytes(*bytes))).collect(),
            _ => data.chunks_exact(number.size).map(|bytes| cast(number.read_value(bytes))).collect(),
        };
        if !self.is_fortran {
            return Ok(values);
        }
        let in_c_order = |mut rest: usize| {
            // Find the index in Fortran order of the value with this index in C order, axis by axis from the last.
            let (mut place, mut stride) = (0, values.len());
            for size in shape.iter().rev() {
                stride /= size;
                place += rest % size * stride;
                rest /= size;
            }
            values[place]
        };
        Ok((0..values.len()).map(in_c_order).collect())
    }
}

pub(super) const HEIGHT_TYPES: &str = "float16, float32, float64, uint8, uint16, uint32, uint64, bool";
pub(super) const NUMBER_TYPES: &str = "float16, float32, float64, int8 to int64, uint8 to uint64";

/// Makes the message for a type that is not taken.
pub(super) fn explain_unknown_type(name: &str, allowed: &str) -> String {
    let name = name.escape_debug();
    format!("its values are of type `{name}`; allowed: {allowed}: convert it, as array.astype(\"float32\") does")
}

/// Parses the header's text; holds what is left of it.
struct HeaderParser<'a>(&'a str);

impl<'a> HeaderParser<'a> {
    fn skip_mark(&mut self, mark: char) -> bool {
        let rest = self.0.trim_start();
        self.0 = rest.strip_prefix(mark).unwrap_or(rest);
        self.0.len() < rest.len()
    }

    fn expect_mark(&mut self, mark: char) -> Result<(), String> {
        if self.skip_mark(mark) { Ok(()) } else { Err(format!("its header lacks a `{mark}`")) }
    }

    fn parse_quoted(&mut self) -> Result<&'a str, String> {
        let quote = if self.skip_mark('\'') { '\'' } else { '"' };
        if quote == '"' {
            self.expect_mark('"')?;
        }
        let (text, rest) = self.0.split_once(quote).ok_or("its header has an open quote")?;
        self.0 = rest;
        if text.len() > 64 { Err(String::from("its header has a long text")) } else { Ok(text) }
    }

    fn parse_bool(&mut self) -> Result<bool, String> {
        let text = self.0.trim_start();
        let found = [("True", true), ("False", false)].into_iter().find(|(name, _)| text.starts_with(name));
        let (name, truth) = found.ok_or("its `fortran_order` is neither True nor False")?;
        self.0 = &text[name.len()..];
        Ok(truth)
    }

    /// Parses whole numbers in parentheses.
    fn parse_shape(&mut self) -> Result<Vec<usize>, String> {
        /// The most axes that NumPy makes.
        const MAX_AXES: usize = 64;
        self.expect_mark('(')?;
        let mut shape = Vec::new();
        while !self.skip_mark(')') {
            let text = self.0.trim_start();
            let end = text.find(|c: char| !c.is_ascii_digit()).unwrap_or(text.len());
            if end == 0 || shape.len() == MAX_AXES {
                return Err(format!("its shape is no list of up to {MAX_AXES} whole numbers"));
            }
            shape.push(text[..end].parse().map_err(|_| "its array is too large")?);
            self.0 = &text[end..];
            if !self.skip_mark(',') {
                self.expect_mark(')')?;
                break;
            }
        }
        Ok(shape)
    }
}
