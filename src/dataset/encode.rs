//! The files of a sample, in the order in which they stand in a shard.

use crate::config::output::{Exr, Layer};
use crate::dataset::{exr, png};
use crate::depth::Camera;
use crate::gelpad::SURFACE_BORDER;
use crate::grid::Rect;
use crate::optics::background::Reference;
use crate::optics::normals::normals;
use crate::render::Sample;

/// One file of a sample.
pub struct Member {
    /// The end of its name, after key and dot.
    pub suffix: &'static str,
    /// Its content.
    pub bytes: Vec<u8>,
}

/// Encodes the tactile image, the layers and the label.
pub fn members(sample: &Sample, layers: &[Layer], storage: Exr, camera: &Camera, rest: &Reference) -> Vec<Member> {
    let image = &sample.image;
    let (width, height) = (image.width, image.height);
    let mut members = vec![Member { suffix: "tactile.png", bytes: png::encode_rgb(width, height, &image.rgb) }];
    for layer in layers {
        let single = |name, plane: &[f32]| exr::encode(width, height, &[(name, plane)], storage);
        let bytes = match layer {
            Layer::Depth => {
                let margin = sample.depth.margin_px;
                let view = Rect { x0: margin, y0: margin, x1: margin + width, y1: margin + height };
                single("Z", &sample.depth.overlap.crop(view).data)
            }
            Layer::Surface => {
                let border = SURFACE_BORDER;
                let view = Rect { x0: border, y0: border, x1: border + width, y1: border + height };
                single("Z", &sample.contact.surface.crop(view).data)
            }
            Layer::Contact => png::encode_grey(width, height, &sample.contact.mask.data),
            Layer::Normal => {
                let normals = normals(&sample.contact, camera);
                let plane = |k: usize| normals.iter().map(|normal| normal[k]).collect::<Vec<f32>>();
                let (x, y, z) = (plane(0), plane(1), plane(2));
                exr::encode(width, height, &[("X", &x), ("Y", &y), ("Z", &z)], storage)
            }
            Layer::Reference => png::encode_rgb(width, height, &rest.rgb),
            // The plan refuses layers that the models cannot give.
            Layer::Pressure | Layer::Markers => continue,
        };
        members.push(Member { suffix: layer.suffix(), bytes });
    }
    let json = serde_json::to_vec(&sample.label).expect("a label has string keys and finite or null numbers");
    members.push(Member { suffix: "json", bytes: json });
    members
}
