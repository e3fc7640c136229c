//! The files of a sample, in the order in which they stand in a shard.

use std::io;

use serde::Serialize;
use serde_json::ser::{CompactFormatter, Formatter};

use crate::core::base::clock::{Clock, Seconds};
use crate::core::effects::PerEffect;
use crate::dataset::archive::Member;
use crate::dataset::content::{Content, content};
use crate::files::exr::Exr;
use crate::files::{exr, npy, png};
use crate::job::label::Label;
use crate::job::layers::{Coding, Form, OutputLayer};
use crate::job::plan::Plan;
use crate::job::sample::{Accepted, Sample, Unfit, accept, render};
use crate::job::sequence::{self, Shown};

/// A sample made and encoded. Its images are not kept.
pub struct Made {
    /// Its label; of a sequence what counts of it as a whole.
    pub label: Label,
    /// What was drawn before it and rejected.
    pub rejected: Vec<Label>,
    /// Its files.
    pub members: Vec<Member>,
    /// CPU seconds of its stages.
    pub seconds: Seconds,
    /// The same of each effect.
    pub effects: PerEffect<f64>,
}

/// Makes sample `index` as a dataset has it: a press, or a sequence.
pub fn make(plan: &Plan, index: u64) -> Result<Made, Unfit> {
    match plan.job().sequence {
        None => accept(plan, index).map(|accepted| press(plan, accepted)),
        Some(_) => sequence(plan, |each| sequence::accept(plan, index, each)),
    }
}

/// The same of its first draw if no draw of it may go into a dataset.
pub fn make_shown(plan: &Plan, index: u64) -> Made {
    make(plan, index).unwrap_or_else(|_| match plan.job().sequence {
        None => press(plan, Accepted { sample: render(plan, index), rejected: Vec::new() }),
        Some(_) => {
            let first = |each: &mut dyn FnMut(Shown)| {
                let each = |sample, number| each(Shown::Frame(Box::new(sample), number));
                Ok::<_, std::convert::Infallible>(sequence::render(plan, index, 0, each))
            };
            let Ok(made) = sequence(plan, first);
            made
        }
    })
}

/// Encodes a press.
pub fn press(plan: &Plan, Accepted { sample, rejected }: Accepted) -> Made {
    let mut clock = Clock::start();
    let members = members(plan, &sample);
    let seconds = Seconds { encode: clock.lap(), ..sample.seconds };
    Made { label: sample.label, rejected, members, seconds, effects: sample.impression.effects.seconds }
}

/// Encodes a sequence that `draw` shows frame by frame: only their files are kept.
fn sequence<E>(
    plan: &Plan,
    draw: impl FnOnce(&mut dyn FnMut(Shown)) -> Result<sequence::Accepted, E>,
) -> Result<Made, E> {
    let (mut members, mut encode) = (Vec::new(), 0.0);
    let accepted = draw(&mut |shown| match shown {
        Shown::Begin => members.clear(),
        Shown::Frame(sample, number) => {
            let mut clock = Clock::start();
            for mut member in layers(plan, &sample) {
                member.suffix = format!("{}.{}", frame(number), member.suffix);
                members.push(member);
            }
            encode += clock.lap();
        }
    })?;
    let mut clock = Clock::start();
    members.push(Member::new("json", json(&accepted.label)));
    let seconds = Seconds { encode: encode + clock.lap(), ..accepted.seconds };
    let sequence::Accepted { summary, rejected, effects, .. } = accepted;
    Ok(Made { label: summary, rejected, members, seconds, effects })
}

/// What stands in the names of a frame's files, after the sample's key.
pub fn frame(number: u32) -> String {
    format!("f{number:04}")
}

/// Encodes the tactile image, the layers and the label.
pub fn members(plan: &Plan, sample: &Sample) -> Vec<Member> {
    let mut members = layers(plan, sample);
    members.push(Member::new("json", json(&sample.label)));
    members
}

/// Encodes the tactile image and the layers.
pub fn layers(plan: &Plan, sample: &Sample) -> Vec<Member> {
    let image = &sample.impression.image;
    let (width, height) = (image.width, image.height);
    let mut members = vec![Member::new("tactile.png", png::encode_rgb(width, height, &image.rgb))];
    for layer in &plan.layers() {
        let bytes = match content(sample, *layer) {
            Content::Floats(values) => match layer.channels().len() {
                0 | 1 => float_layer(plan, sample, *layer, &[&values]),
                count => {
                    let plane = |k: usize| values.iter().skip(k).step_by(count).copied().collect();
                    let planes: Vec<Vec<f32>> = (0..count).map(plane).collect();
                    float_layer(plan, sample, *layer, &planes.iter().map(Vec::as_slice).collect::<Vec<_>>())
                }
            },
            Content::Bytes(bytes) => match layer.spec().form {
                Form::Rgb => png::encode_rgb(width, height, &bytes),
                _ => png::encode_grey(width, height, &bytes),
            },
            Content::Markers(positions) => json(&positions),
        };
        members.push(Member::new(layer.suffix(plan.output().depth_format), bytes));
    }
    members
}

/// Encodes a layer of floats in the format that the job wants.
fn float_layer(plan: &Plan, sample: &Sample, layer: OutputLayer, planes: &[&[f32]]) -> Vec<u8> {
    let (width, height) = (sample.impression.image.width, sample.impression.image.height);
    match layer.coding(plan.output().depth_format) {
        Coding::Npy => npy::encode(width, height, planes),
        Coding::Png16(scale) => sample.label.png16.encode(scale, width, height, planes[0]),
        _ => {
            let pixel = match layer.spec().form {
                Form::Floats { pixel, .. } => pixel.unwrap_or(plan.output().exr.pixel),
                _ => plan.output().exr.pixel,
            };
            let named: Vec<(&str, &[f32])> = layer.channels().iter().copied().zip(planes.iter().copied()).collect();
            exr::encode(width, height, &named, Exr { pixel, ..plan.output().exr })
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
