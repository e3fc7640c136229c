//! What the layers of a sample hold, in the image's geometry: lens distortion included. Files and Python's arrays are both
//! made from this.

use std::borrow::Cow;

use serde::Serialize;

use crate::config::output::Layer;
use crate::gelpad::SURFACE_BORDER;
use crate::grid::Grid;
use crate::optics::normals::normals;
use crate::plan::Plan;
use crate::render::Sample;

/// What one layer holds. Pixels are row-major, as many as the image has.
pub enum Content<'a> {
    /// A number per pixel.
    Floats(Vec<f32>),
    /// A vector X, Y, Z per pixel.
    Vectors(Vec<[f32; 3]>),
    /// A byte per pixel.
    Grey(Cow<'a, [u8]>),
    /// Red, green and blue per pixel.
    Rgb(&'a [u8]),
    /// The markers.
    Markers(Positions),
}

/// Markers in view, px: the first pixel's centre is at (0.5, 0.5).
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct Positions {
    /// Where each was printed.
    pub rest_px: Vec<[f64; 2]>,
    /// Where the pad carried it.
    pub moved_px: Vec<[f64; 2]>,
}

/// What `layer` of a sample of `plan` holds.
pub fn content<'a>(plan: &'a Plan, sample: &'a Sample, layer: Layer) -> Content<'a> {
    let (width, height) = (sample.image.width, sample.image.height);
    let seen = |plane: Vec<f32>| match &sample.lens {
        Some(lens) => lens.warp_plane(&Grid { width, height, data: plane }).data,
        None => plane,
    };
    match layer {
        Layer::Depth => Content::Floats(seen(sample.depth.below_pad().data)),
        Layer::Surface => Content::Floats(seen(sample.contact.surface.inner(SURFACE_BORDER).data)),
        Layer::Normal => {
            let mut normals = normals(&sample.contact, &plan.camera);
            if sample.lens.is_some() {
                let planes = [0, 1, 2].map(|k| seen(normals.iter().map(|normal| normal[k]).collect()));
                for (i, normal) in normals.iter_mut().enumerate() {
                    let [x, y, z] = planes.each_ref().map(|plane| plane[i]);
                    // Interpolated normals are a little short.
                    let length = (x * x + y * y + z * z).sqrt();
                    *normal = [x / length, y / length, z / length];
                }
            }
            Content::Vectors(normals)
        }
        Layer::Pressure => {
            let pressure = sample.contact.pressure.as_ref().map(|pressure| seen(pressure.data.clone()));
            Content::Floats(pressure.unwrap_or_else(|| vec![0.0; width * height]))
        }
        Layer::Contact => Content::Grey(match &sample.lens {
            Some(lens) => lens.warp_mask(&sample.contact.mask).data.into(),
            None => (&sample.contact.mask.data).into(),
        }),
        Layer::Reference => Content::Rgb(&plan.ready.body.untouched.rgb),
        Layer::Markers => Content::Markers(match &sample.ink {
            Some(ink) => {
                let (rest_px, moved_px) = ink.seen(sample.lens.as_ref(), [width, height]).unzip();
                Positions { rest_px, moved_px }
            }
            None => Positions::default(),
        }),
    }
}
