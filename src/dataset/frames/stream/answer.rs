//! Writes the answer to a frame of a stream as named parts, for readers in any language: a header, then for each part
//! its own header and its values. All is little endian, and a C compiler lays both headers out without a gap.
//!
//! docs/how-to/streams.md describes the bytes and has readers.

use std::borrow::Cow;
use std::io::{self, Write};

use serde::Serialize;

use crate::content::{LayerContent, Positions, layer_content};
use crate::encode::to_json_line;
use gelsim_files::diagnostic::Diagnostic;
use gelsim_job::layers::OutputLayer;
use gelsim_job::sample::Sample;

/// The first bytes of an answer; the last one is the version.
const MAGIC: [u8; 4] = *b"GSF1";

/// Most bytes of a part's name.
const MAX_NAME: usize = 32;

/// Most bytes of the name of a type.
const MAX_TYPE: usize = 8;

/// Most axes of a part.
const MAX_AXES: usize = 3;

/// Type of a part that is UTF-8 text in JSON. Those of arrays are NumPy's: `|u1`, `<f4`, `<f8`.
const JSON: &str = "json";

/// The frame to which an answer belongs.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct AnswerNumber {
    /// Number of the frame in the stream, from 0.
    pub frame: u64,
    /// Number of its sequence, from 0: how many resets came before.
    pub sequence: u32,
}

/// Whether the frame was rendered, with its number in the header.
#[derive(Clone, Copy)]
enum Status {
    Rendered = 0,
    Skipped = 1,
}

/// A named array, or text in JSON.
struct Part<'a> {
    name: Cow<'static, str>,
    type_name: &'static str,
    shape: Vec<usize>,
    bytes: Cow<'a, [u8]>,
}

/// Writes the answer to a rendered frame: the tactile image, `layers` in their order, and the label, as JSON, if there is
/// one.
pub fn write_rendered(
    output: &mut impl Write,
    number: AnswerNumber,
    sample: &Sample,
    layers: &[OutputLayer],
    label: Option<Vec<u8>>,
) -> io::Result<()> {
    let image = &sample.impression.image;
    let mut parts = vec![Part {
        name: Cow::Borrowed("tactile"),
        type_name: "|u1",
        shape: vec![image.height, image.width, 3],
        bytes: Cow::Borrowed(&image.rgb),
    }];
    layers.iter().for_each(|layer| push_layer(&mut parts, sample, *layer));
    parts.extend(label.map(|label| Part::from_json("label", label)));
    write_parts(output, number, Status::Rendered, &parts)
}

/// Writes the answer to a frame that was skipped: what is wrong with it, and what to do about it if that is known.
pub fn write_skipped(output: &mut impl Write, number: AnswerNumber, problem: &Diagnostic) -> io::Result<()> {
    #[derive(Serialize)]
    struct Problem<'a> {
        message: &'a str,
        help: Option<&'a str>,
    }
    let told = Problem { message: &problem.message, help: problem.help.as_deref() };
    write_parts(output, number, Status::Skipped, &[Part::from_json("problem", to_json_line(&told))])
}

/// Appends the parts of a layer: one for a layer of pixels, one for each list of positions.
fn push_layer<'a>(parts: &mut Vec<Part<'a>>, sample: &'a Sample, layer: OutputLayer) {
    let image = &sample.impression.image;
    let several = layer.spec().form.values_per_px().filter(|count| *count > 1);
    let shape = [image.height, image.width].into_iter().chain(several).collect();
    let name = Cow::Borrowed(layer.name());
    match layer_content(sample, layer) {
        LayerContent::Floats(values) => {
            parts.push(Part { name, type_name: "<f4", shape, bytes: Cow::Owned(to_bytes(&values, f32::to_le_bytes)) });
        }
        LayerContent::Bytes(bytes) => parts.push(Part { name, type_name: "|u1", shape, bytes }),
        LayerContent::Markers(Positions { rest_px, moved_px, rest_mm, moved_mm }) => {
            let mut push = |list: &str, axes: usize, values: &[f64]| {
                parts.push(Part {
                    name: Cow::Owned(format!("{}.{list}", layer.name())),
                    type_name: "<f8",
                    shape: vec![values.len() / axes, axes],
                    bytes: Cow::Owned(to_bytes(values, f64::to_le_bytes)),
                });
            };
            push("rest_px", 2, rest_px.as_flattened());
            push("moved_px", 2, moved_px.as_flattened());
            // Without a pin in view they are empty, and there all the same.
            if layer == OutputLayer::Pins {
                push("rest_mm", 3, rest_mm.as_flattened());
                push("moved_mm", 3, moved_mm.as_flattened());
            }
        }
    }
}

/// Converts numbers to their bytes one after another.
fn to_bytes<T: Copy, const N: usize>(values: &[T], convert: impl Fn(T) -> [u8; N]) -> Vec<u8> {
    let mut bytes = vec![0; N * values.len()];
    bytes.as_chunks_mut().0.iter_mut().zip(values).for_each(|(bytes, value)| *bytes = convert(*value));
    bytes
}

impl Part<'_> {
    fn from_json(name: &'static str, bytes: Vec<u8>) -> Self {
        Self { name: Cow::Borrowed(name), type_name: JSON, shape: vec![bytes.len()], bytes: Cow::Owned(bytes) }
    }

    /// Returns the 64 bytes that stand before the values.
    fn header(&self) -> Vec<u8> {
        let mut header = Vec::with_capacity(64);
        header.extend(self.name.as_bytes());
        header.resize(MAX_NAME, 0);
        header.extend(self.type_name.as_bytes());
        header.resize(MAX_NAME + MAX_TYPE, 0);
        header.extend((self.shape.len() as u32).to_le_bytes());
        for axis in 0..MAX_AXES {
            header.extend(self.shape.get(axis).map_or(0, |size| *size as u32).to_le_bytes());
        }
        header.extend((self.bytes.len() as u64).to_le_bytes());
        header
    }
}

fn write_parts(
    output: &mut impl Write,
    AnswerNumber { frame, sequence }: AnswerNumber,
    status: Status,
    parts: &[Part<'_>],
) -> io::Result<()> {
    let headers: Vec<Vec<u8>> = parts.iter().map(Part::header).collect();
    let length: usize = headers.iter().map(Vec::len).chain(parts.iter().map(|part| part.bytes.len())).sum();
    output.write_all(&MAGIC)?;
    output.write_all(&(status as u32).to_le_bytes())?;
    output.write_all(&frame.to_le_bytes())?;
    output.write_all(&sequence.to_le_bytes())?;
    output.write_all(&(parts.len() as u32).to_le_bytes())?;
    output.write_all(&(length as u64).to_le_bytes())?;
    for (header, part) in headers.iter().zip(parts) {
        output.write_all(header)?;
        output.write_all(&part.bytes)?;
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_name_of_every_part_fits_its_place_with_a_zero_behind_it() {
        let longest = OutputLayer::ALL.map(|layer| layer.name().len() + ".moved_px".len()).into_iter().max();
        assert!(longest < Some(MAX_NAME));
    }

    /// The example of docs/how-to/streams.md.
    #[test]
    fn a_skipped_frame_is_these_bytes() {
        let mut bytes = Vec::new();
        let number = AnswerNumber { frame: 258, sequence: 3 };
        write_skipped(&mut bytes, number, &Diagnostic::new("it is late")).expect("memory");
        let text = br#"{"message":"it is late","help":null}"#;
        let mut expected = b"GSF1\x01\0\0\0\x02\x01\0\0\0\0\0\0\x03\0\0\0\x01\0\0\0\x64\0\0\0\0\0\0\0".to_vec();
        expected.extend(b"problem\0\0\0\0\0\0\0\0\0\0\0\0\0\0\0\0\0\0\0\0\0\0\0\0\0json\0\0\0\0");
        expected.extend(b"\x01\0\0\0\x24\0\0\0\0\0\0\0\0\0\0\0\x24\0\0\0\0\0\0\0");
        expected.extend(text);
        assert_eq!((bytes.as_slice(), text.len()), (expected.as_slice(), 36));
    }
}
