//! The header of an npy file: type, order and shape of what follows, and the values that it makes of the bytes.

use half::f16;

/// The header, and the data after it; `allowed` are the types that are taken.
pub(super) fn split<'a>(bytes: &'a [u8], allowed: &str) -> Result<(Header<'a>, &'a [u8]), String> {
    let (text, data) = split_text(bytes).ok_or("not an npy file")?;
    Ok((Header::read(text, allowed)?, data))
}

/// The header's text and the data.
fn split_text(bytes: &[u8]) -> Option<(&[u8], &[u8])> {
    let (version, rest) = bytes.strip_prefix(b"\x93NUMPY")?.split_first_chunk::<2>()?;
    let (length, rest) = match version {
        [1, _] => rest.split_first_chunk().map(|(length, rest)| (usize::from(u16::from_le_bytes(*length)), rest)),
        [2 | 3, _] => rest.split_first_chunk().map(|(length, rest)| (u32::from_le_bytes(*length) as usize, rest)),
        _ => None,
    }?;
    rest.split_at_checked(length)
}

/// What numbers are.
#[derive(Clone, Copy, PartialEq, Eq)]
pub(super) enum Kind {
    Float,
    Signed,
    Unsigned,
    /// True or false, a byte each.
    Truth,
}

/// How one value is stored.
#[derive(Clone, Copy)]
pub(super) struct Number {
    pub(super) kind: Kind,
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
        let (kind, size) = rest.split_at_checked(1)?;
        let (kind, sizes) = match kind {
            "f" => (Kind::Float, ["2", "4", "8"].as_slice()),
            "i" => (Kind::Signed, ["1", "2", "4", "8"].as_slice()),
            "u" => (Kind::Unsigned, ["1", "2", "4", "8"].as_slice()),
            "b" => (Kind::Truth, ["1"].as_slice()),
            _ => return None,
        };
        let size = sizes.contains(&size).then(|| size.parse().ok())??;
        Some(Self { kind, is_big_endian, size })
    }

    fn read(self, bytes: &[u8]) -> f64 {
        let mut ordered = [0; 8];
        let ordered_bytes = &mut ordered[..self.size];
        ordered_bytes.copy_from_slice(bytes);
        if self.is_big_endian {
            ordered_bytes.reverse();
        }
        let bits = u64::from_le_bytes(ordered);
        match (self.kind, self.size) {
            (Kind::Unsigned, _) => bits as f64,
            (Kind::Truth, _) => f64::from(u8::from(bits != 0)),
            (Kind::Signed, size) => {
                let unused = 64 - 8 * size as u32;
                ((bits << unused) as i64 >> unused) as f64
            }
            (Kind::Float, 2) => f16::from_bits(bits as u16).to_f64(),
            (Kind::Float, 4) => f32::from_bits(bits as u32).into(),
            (Kind::Float, _) => f64::from_bits(bits),
        }
    }

    /// The largest value; `None` of floats.
    pub(super) fn most(self) -> Option<f32> {
        match self.kind {
            Kind::Unsigned => Some((u64::MAX >> (64 - 8 * self.size)) as f32),
            Kind::Truth => Some(1.0),
            Kind::Float | Kind::Signed => None,
        }
    }
}

/// What a header says.
pub(super) struct Header<'a> {
    /// NumPy's name of the type.
    pub(super) name: &'a str,
    pub(super) number: Number,
    pub(super) is_fortran: bool,
    pub(super) shape: Vec<usize>,
}

impl<'a> Header<'a> {
    /// From a Python dictionary such as `{'descr': '<f4', 'fortran_order': False, 'shape': (3, 4), }`.
    fn read(text: &'a [u8], allowed: &str) -> Result<Self, String> {
        let mut words = Words(str::from_utf8(text).map_err(|_| "its header is not text")?);
        let (mut number, mut is_fortran, mut shape) = (None, None, None);
        words.expect('{')?;
        while !words.skip('}') {
            let key = words.quoted()?;
            words.expect(':')?;
            match key {
                "descr" => {
                    let name = words.quoted().map_err(|_| "its values are records, not numbers")?;
                    number = Some((name, Number::named(name).ok_or_else(|| unknown(name, allowed))?));
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
            (Some((name, number)), Some(is_fortran), Some(shape)) => Ok(Self { name, number, is_fortran, shape }),
            _ => Err(String::from("its header lacks `descr`, `fortran_order` or `shape`")),
        }
    }

    /// Length of the data; `None` if no memory is that large.
    pub(super) fn bytes(&self) -> Option<usize> {
        self.shape.iter().try_fold(self.number.size, |length, size| length.checked_mul(*size))
    }

    /// The values in C order.
    pub(super) fn values<T: Copy>(&self, data: &[u8], cast: impl Fn(f64) -> T) -> Result<Vec<T>, String> {
        let Self { number, shape, .. } = self;
        if self.bytes() != Some(data.len()) {
            let sizes: Vec<String> = shape.iter().map(usize::to_string).collect();
            let (sizes, size, found) = (sizes.join(" x "), number.size, data.len());
            return Err(format!("it says {sizes} values of {size} bytes, but {found} bytes follow"));
        }
        let values: Vec<T> = match self.name {
            // What nearly all files hold, without a look at its kind for every value.
            "<f4" => data.as_chunks().0.iter().map(|bytes| cast(f32::from_le_bytes(*bytes).into())).collect(),
            "<f8" => data.as_chunks().0.iter().map(|bytes| cast(f64::from_le_bytes(*bytes))).collect(),
            _ => data.chunks_exact(number.size).map(|bytes| cast(number.read(bytes))).collect(),
        };
        if !self.is_fortran {
            return Ok(values);
        }
        let in_c_order = |mut rest: usize| {
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

pub(super) const HEIGHTS: &str = "float16, float32, float64, uint8, uint16, uint32, uint64, bool";
pub(super) const NUMBERS: &str = "float16, float32, float64, int8 to int64, uint8 to uint64";

/// What is said of a type that is not taken.
pub(super) fn unknown(name: &str, allowed: &str) -> String {
    let name = name.escape_debug();
    format!("its values are of type `{name}`; allowed: {allowed}: convert it, as array.astype(\"float32\") does")
}

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

    /// Whole numbers in parentheses.
    fn shape(&mut self) -> Result<Vec<usize>, String> {
        /// Most that NumPy makes.
        const MOST_AXES: usize = 64;
        self.expect('(')?;
        let mut shape = Vec::new();
        while !self.skip(')') {
            let text = self.0.trim_start();
            let end = text.find(|c: char| !c.is_ascii_digit()).unwrap_or(text.len());
            if end == 0 || shape.len() == MOST_AXES {
                return Err(format!("its shape is no list of up to {MOST_AXES} whole numbers"));
            }
            shape.push(text[..end].parse().map_err(|_| "its array is too large")?);
            self.0 = &text[end..];
            if !self.skip(',') {
                self.expect(')')?;
                break;
            }
        }
        Ok(shape)
    }
}
