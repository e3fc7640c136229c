//! Pixels of presses to learn from: what the surface is like at each, and by how much it changed the picture.

use image::RgbImage;

use super::Seen;
use crate::depth::Camera;
use crate::gelpad::Contact;
use crate::grid::Rect;
use crate::optics::calibrated::response::{INPUTS, Response};
use crate::optics::coarse::Coarse;
use crate::optics::normals::normals;
use crate::optics::shadow::casting::Casting;
use crate::rng::Stream;

/// How far from its centre a press is looked at, in radii of its circle: its halo ends there.
pub const REACH: f64 = 3.5;
/// As far as errors are counted.
pub const DILATE: f64 = 1.3;
/// Share of the pixels that come from the contact and its rim.
const NEAR: f64 = 0.65;

/// Pixels of one press, or of several.
#[derive(Clone, Debug, Default)]
pub struct Pixels {
    /// n_x and n_y.
    pub normals: Vec<[f32; 2]>,
    /// Displacement and place, mm, and the hidden share of the sky in each direction.
    pub inputs: Vec<[f32; INPUTS]>,
    /// Picture less background, as shares of full scale.
    pub change: Vec<[f32; 3]>,
    /// 1 where the picture is white, -1 where it is black, 0 elsewhere: the change may be larger than it shows.
    pub clipped: Vec<[f32; 3]>,
}

impl Pixels {
    /// How many.
    pub fn len(&self) -> usize {
        self.change.len()
    }

    /// True if there are none.
    pub fn is_empty(&self) -> bool {
        self.change.is_empty()
    }

    /// Adds another press's.
    pub fn append(&mut self, other: &Self) {
        self.normals.extend_from_slice(&other.normals);
        self.inputs.extend_from_slice(&other.inputs);
        self.change.extend_from_slice(&other.change);
        self.clipped.extend_from_slice(&other.clipped);
    }

    /// Up to `most` pixels of a press, drawn at random: those near its contact and those of its halo. Those that are
    /// saturated in the background say nothing.
    pub fn of(
        seen: &Seen,
        contact: &Contact,
        background: &RgbImage,
        camera: &Camera,
        most: usize,
        random: &mut Stream,
    ) -> Self {
        let [width, height] = camera.resolution_px;
        let surface = &contact.surface;
        let whole = Rect::whole(width, height);
        let casting =
            Casting::new(Coarse::new(crate::gelpad::elastic::Resolution::Full), surface, camera, true, Response::sky);
        let shares = casting.map(|casting| casting.shares(camera, whole)).unwrap_or_default();
        let normals = normals(contact, camera);
        let [x, y] = seen.circle.centre_px;
        let (mut near, mut far) = (Vec::new(), Vec::new());
        for (at, color) in background.pixels().enumerate() {
            let (across, down) = ((at % width) as f64 - x, (at / width) as f64 - y);
            let distance = libm::hypot(across, down) / seen.circle.radius_px;
            if distance < REACH && !color.0.iter().any(|level| *level >= 254) {
                if distance < DILATE { near.push(at) } else { far.push(at) }
            }
        }
        let mut pixels = Self::default();
        let wanted = |share: f64| (share * most as f64) as usize;
        for (from, count) in [(near, wanted(NEAR)), (far, wanted(1.0 - NEAR))] {
            let mut from = from;
            // The first `count` of a random order.
            for k in 0..count.min(from.len()) {
                let other = k + random.below(from.len() - k);
                from.swap(k, other);
                let at = from[k];
                let (px, py) = (at % width, at / width);
                let [x_mm, y_mm] = camera.point_mm([px as f64 + 0.5, py as f64 + 0.5]);
                let mut inputs = [0.0; INPUTS];
                inputs[0] = surface.at(px + 1, py + 1);
                (inputs[1], inputs[2]) = (x_mm as f32, y_mm as f32);
                for (input, share) in inputs[3..].iter_mut().zip(&shares) {
                    *input = share.as_ref().map_or(0.0, |share| 1.0 - share.values.at(px, py));
                }
                let [nx, ny, _] = normals[at];
                let (real, rest) =
                    (seen.image.get_pixel(px as u32, py as u32), background.get_pixel(px as u32, py as u32));
                pixels.normals.push([nx, ny]);
                pixels.inputs.push(inputs);
                let channel = |k: usize| f32::from(i16::from(real[k]) - i16::from(rest[k])) / 255.0;
                pixels.change.push(std::array::from_fn(channel));
                let end = |k: usize| f32::from(i8::from(real[k] == 255) - i8::from(real[k] == 0));
                pixels.clipped.push(std::array::from_fn(end));
            }
        }
        pixels
    }
}
