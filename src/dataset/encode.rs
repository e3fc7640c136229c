//! The files of a sample, in the order in which they stand in a shard.

use std::io;

use serde::Serialize;
use serde_json::ser::{CompactFormatter, Formatter};

use crate::config::output::{Coding, Exr, Layer, Pixel};
use crate::dataset::decode::channels;
use crate::dataset::{exr, npy, png};
use crate::gelpad::SURFACE_BORDER;
use crate::grid::Grid;
use crate::optics::normals::normals;
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
        let bytes = match layer {
            Layer::Depth | Layer::Surface | Layer::Normal | Layer::Pressure => float_layer(plan, sample, *layer),
            Layer::Contact => match &sample.lens {
                Some(lens) => png::encode_grey(width, height, &lens.warp_mask(&sample.contact.mask).data),
                None => png::encode_grey(width, height, &sample.contact.mask.data),
            },
            Layer::Reference => png::encode_rgb(width, height, &plan.ready.body.untouched.rgb),
            Layer::Markers => markers(sample),
        };
        members.push(Member::new(layer.suffix(plan.job.output.depth_format), bytes));
    }
    members.push(Member::new("json", json(&sample.label)));
    members
}

/// Encodes a layer of floats in the format that the job wants.
fn float_layer(plan: &Plan, sample: &Sample, layer: Layer) -> Vec<u8> {
    let (width, height) = (sample.image.width, sample.image.height);
    let planes = planes(plan, sample, layer);
    let planes: Vec<&[f32]> = planes.iter().map(Vec::as_slice).collect();
    match layer.coding(plan.job.output.depth_format) {
        Coding::Npy => npy::encode(width, height, &planes),
        Coding::Png16 => sample.label.png16.encode(layer, width, height, planes[0]),
        _ => {
            let storage = match layer {
                // Half floats end at 65504 kPa, which a stiff pad exceeds.
                Layer::Pressure => Exr { pixel: Pixel::Float, ..plan.exr },
                _ => plan.exr,
            };
            let named: Vec<(&str, &[f32])> = channels(layer).iter().copied().zip(planes).collect();
            exr::encode(width, height, &named, storage)
        }
    }
}

/// The planes of a layer of floats, in the image's geometry.
fn planes(plan: &Plan, sample: &Sample, layer: Layer) -> Vec<Vec<f32>> {
    let (width, height) = (sample.image.width, sample.image.height);
    let seen = |plane: Vec<f32>| match &sample.lens {
        Some(lens) => lens.warp_plane(&Grid { width, height, data: plane }).data,
        None => plane,
    };
    match layer {
        Layer::Depth => vec![seen(sample.depth.below_pad().data)],
        Layer::Surface => vec![seen(sample.contact.surface.inner(SURFACE_BORDER).data)],
        Layer::Normal => {
            let normals = normals(&sample.contact, &plan.camera);
            let mut planes = [0, 1, 2].map(|k| seen(normals.iter().map(|normal| normal[k]).collect()));
            if sample.lens.is_some() {
                let [x, y, z] = &mut planes;
                for ((x, y), z) in x.iter_mut().zip(y).zip(z) {
                    // Interpolated normals are a little short.
                    let length = (*x * *x + *y * *y + *z * *z).sqrt();
                    (*x, *y, *z) = (*x / length, *y / length, *z / length);
                }
            }
            planes.into()
        }
        Layer::Pressure => {
            let pressure = sample.contact.pressure.as_ref().map(|pressure| seen(pressure.data.clone()));
            vec![pressure.unwrap_or_else(|| vec![0.0; width * height])]
        }
        Layer::Contact | Layer::Markers | Layer::Reference => Vec::new(),
    }
}

/// The markers' positions, px, at rest and moved: two lists of pairs.
fn markers(sample: &Sample) -> Vec<u8> {
    #[derive(Default, Serialize)]
    struct Positions {
        rest_px: Vec<[f64; 2]>,
        moved_px: Vec<[f64; 2]>,
    }
    let size = [sample.image.width, sample.image.height];
    let mut positions = Positions::default();
    if let Some(ink) = &sample.ink {
        (positions.rest_px, positions.moved_px) = ink.seen(sample.lens.as_ref(), size).unzip();
    }
    json(&positions)
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
