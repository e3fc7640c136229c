//! The files of a sample, in the order in which they stand in a shard.

use std::io;

use serde::Serialize;
use serde_json::ser::{CompactFormatter, Formatter};

use crate::config::output::{Exr, Layer, Pixel};
use crate::dataset::{exr, png};
use crate::gelpad::SURFACE_BORDER;
use crate::label::Label;
use crate::optics::normals::normals;
use crate::plan::Plan;
use crate::render::Sample;

/// One file of a sample.
pub struct Member {
    /// The end of its name, after key and dot.
    pub suffix: &'static str,
    /// Its content.
    pub bytes: Vec<u8>,
}

/// Encodes the tactile image, the layers and the label.
pub fn members(plan: &Plan, sample: &Sample) -> Vec<Member> {
    let image = &sample.image;
    let (width, height) = (image.width, image.height);
    let mut members = vec![Member { suffix: "tactile.png", bytes: png::encode_rgb(width, height, &image.rgb) }];
    for layer in &plan.layers {
        let single = |name, plane: &[f32]| exr::encode(width, height, &[(name, plane)], plan.exr);
        let bytes = match layer {
            Layer::Depth => single("Z", &sample.depth.below_pad().data),
            Layer::Surface => single("Z", &sample.contact.surface.inner(SURFACE_BORDER).data),
            Layer::Contact => png::encode_grey(width, height, &sample.contact.mask.data),
            Layer::Normal => {
                let normals = normals(&sample.contact, &plan.camera);
                let plane = |k: usize| normals.iter().map(|normal| normal[k]).collect::<Vec<f32>>();
                let (x, y, z) = (plane(0), plane(1), plane(2));
                exr::encode(width, height, &[("X", &x), ("Y", &y), ("Z", &z)], plan.exr)
            }
            Layer::Reference => png::encode_rgb(width, height, &plan.untouched),
            Layer::Pressure => {
                // Half floats end at 65504 kPa, which a stiff pad exceeds.
                let storage = Exr { pixel: Pixel::Float, ..plan.exr };
                let none = vec![0.0; width * height];
                let pressure = sample.contact.pressure.as_ref().map_or(&none, |pressure| &pressure.data);
                exr::encode(width, height, &[("P", pressure)], storage)
            }
            // The plan refuses layers that the models cannot give.
            Layer::Markers => continue,
        };
        members.push(Member { suffix: layer.suffix(), bytes });
    }
    members.push(Member { suffix: "json", bytes: json(&sample.label) });
    members
}

fn json(label: &Label) -> Vec<u8> {
    let mut bytes = Vec::new();
    let mut serializer = serde_json::Serializer::with_formatter(&mut bytes, DecimalPoints);
    label.serialize(&mut serializer).expect("a label has string keys and finite or null numbers");
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
