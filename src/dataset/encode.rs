//! The files of a sample, in the order in which they stand in a shard.

use std::io;

use serde::Serialize;
use serde_json::ser::{CompactFormatter, Formatter};

use crate::config::output::{Exr, Layer, Pixel};
use crate::dataset::{exr, png};
use crate::gelpad::SURFACE_BORDER;
use crate::grid::Grid;
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
    // Layers have the image's geometry.
    let seen = |plane: Vec<f32>| match &sample.lens {
        Some(lens) => lens.warp_plane(&Grid { width, height, data: plane }).data,
        None => plane,
    };
    for layer in &plan.layers {
        let single = |name, plane: Vec<f32>| exr::encode(width, height, &[(name, &seen(plane))], plan.exr);
        let bytes = match layer {
            Layer::Depth => single("Z", sample.depth.below_pad().data),
            Layer::Surface => single("Z", sample.contact.surface.inner(SURFACE_BORDER).data),
            Layer::Contact => match &sample.lens {
                Some(lens) => png::encode_grey(width, height, &lens.warp_mask(&sample.contact.mask).data),
                None => png::encode_grey(width, height, &sample.contact.mask.data),
            },
            Layer::Normal => {
                let mut normals = normals(&sample.contact, &plan.camera);
                if sample.lens.is_some() {
                    let plane = |k: usize| seen(normals.iter().map(|normal| normal[k]).collect());
                    let [x, y, z] = std::array::from_fn(plane);
                    for (k, normal) in normals.iter_mut().enumerate() {
                        // Interpolated normals are a little short.
                        let length = (x[k] * x[k] + y[k] * y[k] + z[k] * z[k]).sqrt();
                        *normal = [x[k] / length, y[k] / length, z[k] / length];
                    }
                }
                let plane = |k: usize| normals.iter().map(|normal| normal[k]).collect::<Vec<f32>>();
                let (x, y, z) = (plane(0), plane(1), plane(2));
                exr::encode(width, height, &[("X", &x), ("Y", &y), ("Z", &z)], plan.exr)
            }
            Layer::Reference => png::encode_rgb(width, height, &plan.ready.body.untouched.rgb),
            Layer::Pressure => {
                // Half floats end at 65504 kPa, which a stiff pad exceeds.
                let storage = Exr { pixel: Pixel::Float, ..plan.exr };
                let pressure = sample.contact.pressure.as_ref().map(|pressure| seen(pressure.data.clone()));
                let pressure = pressure.unwrap_or_else(|| vec![0.0; width * height]);
                exr::encode(width, height, &[("P", &pressure)], storage)
            }
            Layer::Markers => markers(sample),
        };
        members.push(Member { suffix: layer.suffix(), bytes });
    }
    members.push(Member { suffix: "json", bytes: json(&sample.label) });
    members
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
