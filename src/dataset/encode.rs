//! The files of a sample, in the order in which they stand in a shard.

use std::io;

use serde::Serialize;
use serde_json::ser::{CompactFormatter, Formatter};

use crate::config::output::{Coding, Exr, Layer, Pixel};
use crate::dataset::content::{Content, content};
use crate::dataset::decode::channels;
use crate::dataset::{exr, npy, png};
use crate::plan::Plan;
use crate::render::Sample;

/// One file of a sample.
pub struct Member {
    /// The end of its name, after key and dot.
    pub suffix: String,
    /// Its content.
    pub bytes: Vec<u8>,
}

impl Member {
    fn new(suffix: impl Into<String>, bytes: Vec<u8>) -> Self {
        Self { suffix: suffix.into(), bytes }
    }
}

/// Encodes the tactile image, the layers and the label.
pub fn members(plan: &Plan, sample: &Sample) -> Vec<Member> {
    let image = &sample.image;
    let (width, height) = (image.width, image.height);
    let mut members = vec![Member::new("tactile.png", png::encode_rgb(width, height, &image.rgb))];
    for layer in &plan.layers {
        let bytes = match content(plan, sample, *layer) {
            Content::Floats(plane) => float_layer(plan, sample, *layer, &[&plane]),
            Content::Vectors(vectors) => {
                let planes: [Vec<f32>; 3] = [0, 1, 2].map(|k| vectors.iter().map(|vector| vector[k]).collect());
                float_layer(plan, sample, *layer, &planes.each_ref().map(Vec::as_slice))
            }
            Content::Grey(grey) => png::encode_grey(width, height, &grey),
            Content::Rgb(rgb) => png::encode_rgb(width, height, rgb),
            Content::Markers(positions) => json(&positions),
        };
        members.push(Member::new(layer.suffix(plan.job.output.depth_format), bytes));
    }
    members.push(Member::new("json", json(&sample.label)));
    members
}

/// Encodes a layer of floats in the format that the job wants.
fn float_layer(plan: &Plan, sample: &Sample, layer: Layer, planes: &[&[f32]]) -> Vec<u8> {
    let (width, height) = (sample.image.width, sample.image.height);
    match layer.coding(plan.job.output.depth_format) {
        Coding::Npy => npy::encode(width, height, planes),
        Coding::Png16 => sample.label.png16.encode(layer, width, height, planes[0]),
        _ => {
            let storage = match layer {
                // Half floats end at 65504 kPa, which a stiff pad exceeds.
                Layer::Pressure => Exr { pixel: Pixel::Float, ..plan.exr },
                _ => plan.exr,
            };
            let named: Vec<(&str, &[f32])> = channels(layer).iter().copied().zip(planes.iter().copied()).collect();
            exr::encode(width, height, &named, storage)
        }
    }
}

/// A value as JSON on one line, its floats with a decimal point; those that are not finite become null.
pub fn json(value: &impl Serialize) -> Vec<u8> {
    let mut bytes = Vec::new();
    let mut serializer = serde_json::Serializer::with_formatter(&mut bytes, DecimalPoints);
    value.serialize(&mut serializer).expect("all that is written has string keys");
    bytes
}

/// Compact JSON in which every float has a decimal point, so that no reader takes it for a whole number: 1.0e-7 where
/// serde_json alone writes 1e-7.
struct DecimalPoints;

impl Formatter for DecimalPoints {
    fn write_f64<W: ?Sized + io::Write>(&mut self, writer: &mut W, value: f64) -> io::Result<()> {
        let mut text = Vec::with_capacity(24);
        CompactFormatter.write_f64(&mut text, value)?;
        match text.iter().position(|byte| *byte == b'e') {
            Some(at) if !text.contains(&b'.') => {
                writer.write_all(&text[..at])?;
                writer.write_all(b".0")?;
                writer.write_all(&text[at..])
            }
            _ => writer.write_all(&text),
        }
    }
}
