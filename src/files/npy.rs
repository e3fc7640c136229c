//! Reads and writes arrays of numbers in NumPy's file format (NEP 1: npy 1.0 to 3.0).
//!
//! Planes of float32 and images are written. The reader takes float16, float32, float64 and integers, in either byte
//! order, in C or Fortran order. It is our own, since `npyz` multiplies the sizes that a header claims without a check,
//! and takes as much memory as the header says it has.

use gelsim_core::base::grid::Grid;

mod header;

use header::{HEIGHT_TYPES, Header, NUMBER_TYPES, NumberKind, explain_unknown_type, split_header};

pub use header::read_announced_bytes;

/// The content of a file of heights, which has two dimensions.
#[derive(Clone, Debug, PartialEq)]
pub struct HeightArray {
    /// The values, first axis down, second axis to the right. Never empty. NaN and infinities are kept.
    pub values: Grid<f32>,
    /// The largest value of the file's integer type; `None` for floats.
    pub max_value: Option<f32>,
}

/// The content of a file of any shape.
#[derive(Clone, Debug, PartialEq)]
pub struct NumberArray {
    /// Sizes of the axes; empty for a single number.
    pub shape: Vec<usize>,
    /// The values, last axis fastest. NaN and infinities are kept; integers beyond 2^53 are rounded.
    pub values: Vec<f64>,
}

/// Returns width and height of an array of rows and columns. A first or last axis of size 1 is ignored. Returns `None`
/// for any other shape.
pub fn plane_size(shape: &[usize]) -> Option<[usize; 2]> {
    match *shape {
        [height, width] | [height, width, 1] | [1, height, width] => Some([width, height]),
        _ => None,
    }
}

/// Reads a file of rows and columns whose values are not signed integers. The error says what is wrong with it.
pub fn decode_height_array(bytes: &[u8]) -> Result<HeightArray, String> {
    let (header, data) = split_header(bytes, HEIGHT_TYPES)?;
    let Some([width, height]) = plane_size(&header.shape) else {
        let shape = &header.shape;
        return Err(format!("its array is of shape {shape:?}, and one of rows and columns is wanted: save that alone"));
    };
    if header.number.kind == NumberKind::Signed {
        return Err(explain_unknown_type(header.type_name, HEIGHT_TYPES));
    }
    let data = header.read_values(data, |value| value as f32)?;
    if data.is_empty() {
        return Err(String::from("it has no value"));
    }
    Ok(HeightArray { values: Grid { width, height, data }, max_value: header.number.max_value() })
}

/// Reads a file of any shape. The error says what is wrong with it.
pub fn decode_numbers(bytes: &[u8]) -> Result<NumberArray, String> {
    let (header, data) = split_header(bytes, NUMBER_TYPES)?;
    if header.number.kind == NumberKind::Bool {
        return Err(explain_unknown_type(header.type_name, NUMBER_TYPES));
    }
    let values = header.read_values(data, |value| value)?;
    Ok(NumberArray { shape: header.shape, values })
}

/// Reads, from the beginning of a file up to the end of its header, the shape of its data and their number of bytes.
pub fn read_announced_shape(beginning: &[u8]) -> Result<(Vec<usize>, usize), String> {
    let (header, _) = split_header(beginning, NUMBER_TYPES)?;
    let bytes = header.data_bytes().ok_or("its array is too large")?;
    Ok((header.shape, bytes))
}

/// Encodes rows and columns of float32, version 1.0, little endian, in C order. Several planes become a third axis.
pub fn encode(width: usize, height: usize, planes: &[&[f32]]) -> Vec<u8> {
    let channels = if planes.len() == 1 { String::new() } else { format!(", {}", planes.len()) };
    let mut bytes = build_header("<f4", &format!("{height}, {width}{channels}"), 4 * width * height * planes.len());
    match planes {
        [plane] => plane.iter().for_each(|value| bytes.extend(value.to_le_bytes())),
        planes => {
            for i in 0..width * height {
                planes.iter().for_each(|plane| bytes.extend(plane[i].to_le_bytes()));
            }
        }
    }
    bytes
}

/// Encodes rows and columns of 8-bit RGB as an array of uint8 of shape (H, W, 3). Up to 8192 px on a side the data
/// begin at byte 128.
pub fn encode_rgb(width: usize, height: usize, rgb: &[u8]) -> Vec<u8> {
    let mut bytes = build_header("|u1", &format!("{height}, {width}, 3"), rgb.len());
    bytes.extend(rgb);
    bytes
}

/// Builds all that stands before the data, version 1.0, in C order. Reserves room for `room` bytes of data behind it.
fn build_header(name: &str, shape: &str, room: usize) -> Vec<u8> {
    /// NumPy begins the data at a multiple of this.
    const ALIGNED: usize = 64;
    /// Offset of the header's length: behind the magic bytes and the version.
    const LENGTH_AT: usize = 8;
    let text = format!("{{'descr': '{name}', 'fortran_order': False, 'shape': ({shape}), }}");
    let start = (LENGTH_AT + 2 + text.len() + 1).next_multiple_of(ALIGNED);
    let mut bytes = Vec::with_capacity(start + room);
    bytes.extend(b"\x93NUMPY\x01\x00");
    bytes.extend(((start - LENGTH_AT - 2) as u16).to_le_bytes());
    bytes.extend(text.as_bytes());
    bytes.resize(start - 1, b' ');
    bytes.push(b'\n');
    bytes
}

/// Refuses a file whose values are not float32, little endian, in C order.
pub fn check_float32(bytes: &[u8]) -> Result<(), String> {
    let (Header { type_name: name, is_fortran, .. }, _) = split_header(bytes, NUMBER_TYPES)?;
    match (name, is_fortran) {
        ("<f4", false) => Ok(()),
        _ => Err(format!(
            "its values are of type `{}`{}, not `<f4`",
            name.escape_debug(),
            if is_fortran { " in Fortran order" } else { "" }
        )),
    }
}

#[cfg(test)]
mod tests {
    use half::f16;

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
        decode_height_array(&file(header, data)).unwrap_err()
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
                    assert_eq!(decode_height_array(&bytes).unwrap().values, expected, "{mark}{name} {order}");
                }
            }
        }
    }

    /// The header is what `numpy.save` writes for `numpy.zeros((36, 48), "<f4")`.
    #[test]
    fn what_is_written_has_numpys_header_and_comes_back() {
        let plane: Vec<f32> = (0..36 * 48).map(|k| k as f32 * -0.37).collect();
        let bytes = encode(48, 36, &[&plane]);
        let expected = "\u{1}\0v\0{'descr': '<f4', 'fortran_order': False, 'shape': (36, 48), }";
        assert_eq!(&bytes[..6], b"\x93NUMPY");
        assert_eq!(bytes[6..128], format!("{expected:<121}\n").into_bytes());
        assert_eq!(decode_height_array(&bytes).unwrap().values.data, plane);
        let three = encode(48, 36, &[&plane, &plane, &plane]);
        assert_eq!(decode_numbers(&three).unwrap().shape, [36, 48, 3]);
        // Wherever the text ends, the data begins at a multiple of 64.
        for width in [1, 10, 100_000, 10_000_000] {
            assert_eq!(encode(width, 0, &[&[]]).len() % 64, 0, "{width}");
        }
    }

    #[test]
    fn integers_come_with_the_most_that_their_type_holds() {
        let of = |descr: &str, size: usize| {
            let array = decode_height_array(&file(&header(descr, "False", "(1, 1)"), &vec![0xff; size])).unwrap();
            assert_eq!(array.max_value, array.max_value.map(|_| array.values.data[0]));
            array.max_value
        };
        assert_eq!(of("|u1", 1), Some(255.0));
        assert_eq!(of("<u2", 2), Some(65535.0));
        assert_eq!(of(">u8", 8), Some(u64::MAX as f32));
        assert!(decode_height_array(&file(&header("<f8", "False", "(1, 1)"), &[0; 8])).unwrap().max_value.is_none());
    }

    /// As `numpy.save` writes `numpy.array([[True, False]])`.
    #[test]
    fn truths_are_heights_and_no_numbers() {
        let bytes = file(&header("|b1", "False", "(1, 2)"), &[1, 0]);
        let array = decode_height_array(&bytes).unwrap();
        assert_eq!((array.values.data, array.max_value), (vec![1.0, 0.0], Some(1.0)));
        let said = decode_numbers(&bytes).unwrap_err();
        assert!(said.contains("`|b1`; allowed: float16") && said.contains("int8 to int64"), "{said}");
        assert!(!failure(&header("<i4", "False", "(1, 1)"), &[0; 4]).contains("int8 to"), "which is then refused");
    }

    #[test]
    fn an_axis_of_one_before_or_behind_rows_and_columns_is_none() {
        for shape in ["(2, 3)", "(1, 2, 3)", "(2, 3, 1)"] {
            let read = decode_height_array(&file(&header("|u1", "False", shape), &[0, 1, 2, 3, 4, 5])).unwrap().values;
            assert_eq!((read.width, read.height, read.data[4]), (3, 2, 4.0), "{shape}");
        }
    }

    /// As `numpy.save` writes `numpy.arange(-4, 8).reshape(2, 3, 2)`, also with `order="F"`.
    #[test]
    fn an_array_of_any_shape_is_read_with_its_last_axis_fastest_and_with_signs() {
        let counted: Vec<i8> = (-4..8).collect();
        let fortran = [-4_i8, 2, -2, 4, 0, 6, -3, 3, -1, 5, 1, 7];
        let expected = NumberArray { shape: vec![2, 3, 2], values: counted.iter().map(|v| f64::from(*v)).collect() };
        for (order, values) in [("False", counted.as_slice()), ("True", &fortran)] {
            let little = |size: usize| -> Vec<u8> {
                values.iter().flat_map(|v| i64::from(*v).to_le_bytes().into_iter().take(size)).collect()
            };
            for size in [1, 2, 4, 8] {
                let bytes = file(&header(&format!("<i{size}"), order, "(2, 3, 2)"), &little(size));
                assert_eq!(decode_numbers(&bytes).as_ref(), Ok(&expected), "i{size} {order}");
            }
            let big: Vec<u8> = values.iter().flat_map(|v| f64::from(*v).to_be_bytes()).collect();
            assert_eq!(decode_numbers(&file(&header(">f8", order, "(2, 3, 2)"), &big)).as_ref(), Ok(&expected));
        }
        let single = decode_numbers(&file(&header("<i8", "True", "()"), &125_i64.to_le_bytes()));
        assert_eq!(single, Ok(NumberArray { shape: vec![], values: vec![125.0] }));
        let none = decode_numbers(&file(&header("<f4", "True", "(3, 0, 2)"), &[]));
        assert_eq!(none, Ok(NumberArray { shape: vec![3, 0, 2], values: vec![] }));
    }

    #[test]
    fn versions_two_and_three_have_a_longer_length_and_keys_come_in_any_order() {
        let text = "{\"shape\":(1,1),\"fortran_order\":False,\"descr\":\"|u1\"}";
        for version in [2, 3] {
            let mut bytes = vec![0x93, b'N', b'U', b'M', b'P', b'Y', version, 0];
            bytes.extend((text.len() as u32).to_le_bytes());
            bytes.extend(text.as_bytes());
            bytes.push(7);
            assert_eq!(decode_height_array(&bytes).unwrap().values.data, [7.0]);
            // A header of 4 GB that is not there.
            bytes[8..12].fill(0xff);
            assert_eq!(decode_height_array(&bytes), Err(String::from("not an npy file")));
        }
    }

    /// As `numpy.save` writes arrays of these types.
    #[test]
    fn the_length_of_data_is_known_for_every_type_but_objects() {
        let bytes = |descr: &str, shape: &str| read_announced_bytes(&file(&header(descr, "False", shape), &[]));
        for (descr, each) in
            [("<f4", 4), ("|b1", 1), ("<c16", 16), ("|S5", 5), ("<U3", 12), ("<M8[ns]", 8), ("|V7", 7), (">i2", 2)]
        {
            assert_eq!(bytes(descr, "(2, 3)"), Some(6 * each), "{descr}");
        }
        assert_eq!((bytes("<f8", "(0,)"), bytes("<f8", "()")), (Some(0), Some(8)));
        assert_eq!(read_announced_shape(&file(&header("<c8", "False", "(2, 3)"), &[])).ok(), None);
        for descr in ["|O", "f4", "<f", "", "<f4x", "<x4", "é4"] {
            assert_eq!(bytes(descr, "(2, 3)"), None, "{descr}");
        }
        assert_eq!(bytes("<f8", "(4294967296, 4294967296)"), None);
        let records = "{'descr': [('x', '<f4')], 'fortran_order': False, 'shape': (1, 1), }";
        assert_eq!(read_announced_bytes(&file(records, &[])), None);
        assert_eq!(read_announced_bytes(b"\x93NUMPY\x01\x00"), None);
    }

    #[test]
    fn what_is_no_two_dimensional_array_of_numbers_is_refused_with_a_reason() {
        let huge = header("<f4", "False", "(4294967296, 4294967296)");
        assert!(failure(&huge, &[0; 4]).contains("4294967296 x 4294967296 values of 4 bytes, but 4 bytes follow"));
        assert!(failure(&header("<f4", "False", "(1, 99999999999999999999)"), &[]).contains("too large"));
        assert!(failure(&header("<f4", "False", "(2, 2)"), &[0; 15]).contains("but 15 bytes follow"));
        assert!(failure(&header("<f4", "False", "(0, 5)"), &[]).contains("no value"));
        for shape in ["()", "(4,)", "(4)", "(2, 2, 2)", "(1, 1, 2, 2)"] {
            let said = failure(&header("|u1", "False", shape), &[0; 4]);
            assert!(said.contains("one of rows and columns is wanted: save that alone"), "{shape}: {said}");
        }
        for (shape, expected) in
            [("(-1, 4)", "no list"), ("4", "lacks a `(`"), ("(4 4)", "lacks a `)`"), ("(4, 4", "no list")]
        {
            assert!(failure(&header("|u1", "False", shape), &[0; 4]).contains(expected), "{shape}");
        }
        assert!(failure(&header("|u1", "False", &format!("({})", "1,".repeat(65))), &[0]).contains("up to 64"));
        assert!(failure(&header("<i4", "False", "(1, 1)"), &[0; 4]).contains("of type `<i4`; allowed: float16"));
        for name in ["|O", "<f1", "<i3", "|b2", "<c8", "<", "", "<f16", "é4"] {
            assert!(failure(&header(name, "False", "(1, 1)"), &[0; 4]).contains("its values are of type `"), "{name}");
        }
        let records = "{'descr': [('x', '<f4')], 'fortran_order': False, 'shape': (1, 1), }";
        assert!(failure(records, &[0; 4]).contains("records"));
        assert!(failure("{'descr': '<f4'}", &[]).contains("lacks"));
        assert!(failure(&"(".repeat(60_000), &[]).contains("lacks a `{`"));
        assert!(decode_height_array(b"\x93NUMPY\x09\x00").is_err());
        assert!(decode_height_array(b"").is_err());
    }
}
