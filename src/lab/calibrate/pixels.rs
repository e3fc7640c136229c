//! Pixels of presses to learn from: what the surface is like at each, and by how much it changed the picture.

use image::RgbImage;

use super::Observation;
use gelsim_core::base::grid::Rect;
use gelsim_core::base::grid::Resolution;
use gelsim_core::base::rng::Stream;
use gelsim_core::base::view::SURFACE_BORDER;
use gelsim_core::base::view::View;
use gelsim_core::gelpad::Contact;
use gelsim_core::optics::calibrated::beyond::Range;
use gelsim_core::optics::calibrated::response::{INPUTS, SECTORS};
use gelsim_core::optics::coarse::Coarse;
use gelsim_core::optics::normals::normals;
use gelsim_core::optics::shadow::casting::Casting;

/// How far from its centre a press is looked at, in radii of its circle: its halo ends there.
pub const REACH: f64 = 3.5;
/// As far as errors are counted.
pub const DILATE: f64 = 1.3;
/// Level from which a pixel of the background counts as white.
const SATURATED: u8 = 254;
/// Fraction of the pixels that come from the contact and its rim.
const NEAR: f64 = 0.65;

/// Pixels of one press, or of several.
#[derive(Clone, Debug, Default)]
pub struct Pixels {
    /// n_x and n_y.
    pub normals: Vec<[f32; 2]>,
    /// Displacement and place, mm, and the hidden fraction of the sky in each direction.
    pub inputs: Vec<[f32; INPUTS]>,
    /// Picture less background, as fractions of full scale.
    pub change: Vec<[f32; 3]>,
    /// The background there, as fractions of full scale.
    pub background: Vec<[f32; 3]>,
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
        self.background.extend_from_slice(&other.background);
        self.clipped.extend_from_slice(&other.clipped);
    }

    /// The pixels of a press at `places`; how much of the sky is hidden there is left open, and 0.
    pub fn from_press(
        places: &[usize],
        observation: &Observation,
        contact: &Contact,
        background: &RgbImage,
        camera: &View,
    ) -> Self {
        let width = camera.resolution_px[0];
        let normals = normals(contact, camera);
        let mut pixels = Self::default();
        for &at in places {
            let (x, y) = (at % width, at / width);
            let [x_mm, y_mm] = camera.point_mm([x as f64 + 0.5, y as f64 + 0.5]);
            let mut inputs = [0.0; INPUTS];
            inputs[0] = contact.surface.at(x + SURFACE_BORDER, y + SURFACE_BORDER);
            (inputs[1], inputs[2]) = (x_mm as f32, y_mm as f32);
            pixels.inputs.push(inputs);
            let [nx, ny, _] = normals[at];
            pixels.normals.push([nx, ny]);
            let color = |image: &RgbImage| image.get_pixel(x as u32, y as u32).0;
            let (real, rest) = (color(&observation.image), color(background));
            pixels.change.push(std::array::from_fn(|k| (f32::from(real[k]) - f32::from(rest[k])) / 255.0));
            pixels.background.push(rest.map(|level| f32::from(level) / 255.0));
            pixels.clipped.push(real.map(|level| f32::from(i8::from(level == 255) - i8::from(level == 0))));
        }
        pixels
    }

    /// Finds out how much of the sky is hidden at each of the `places` of a press.
    pub fn look_up(&mut self, places: &[usize], contact: &Contact, camera: &View) {
        let [width, height] = camera.resolution_px;
        let every_pixel = Coarse::new(Resolution::Full);
        let casting = Casting::new(every_pixel, &contact.surface, camera, true, |pitch, _| {
            gelsim_core::optics::calibrated::response::sky(pitch)
        });
        let visible_sky = casting.map(|casting| casting.shares(camera, Rect::whole(width, height))).unwrap_or_default();
        for (inputs, &at) in self.inputs.iter_mut().zip(places) {
            for (input, visible) in inputs[INPUTS - SECTORS..].iter_mut().zip(&visible_sky) {
                *input = visible.as_ref().map_or(0.0, |visible| 1.0 - visible.values.at(at % width, at / width));
            }
        }
    }
}

/// Fraction of a press's pixels that may be steeper or deeper than it is said to be: at a rim a few are by chance.
const BY_CHANCE: f64 = 0.005;
/// Presses that must have been as steep or as deep, so that one whose circle is wrong does not decide.
const WITNESSES: usize = 2;

/// How far presses go together: steepest and deepest that at least two of them were.
pub fn range(presses: &[&Pixels]) -> Range {
    // The value that the given fraction of the pixels exceeds, then the second largest of the presses'.
    let reached = |value: &dyn Fn(&Pixels, usize) -> f32| {
        let mut each: Vec<f32> = presses
            .iter()
            .map(|press| {
                let mut values: Vec<f32> = (0..press.len()).map(|k| value(press, k)).collect();
                values.sort_by(|a, b| b.total_cmp(a));
                values.get((BY_CHANCE * values.len() as f64) as usize).copied().unwrap_or_default()
            })
            .collect();
        each.sort_by(|a, b| b.total_cmp(a));
        each.get(WITNESSES.min(each.len().max(1)) - 1).copied().unwrap_or_default().max(0.0)
    };
    let steepest = reached(&|press, k| {
        let [x, y] = press.normals[k];
        (x * x + y * y).sqrt()
    });
    Range {
        steepest: steepest.clamp(1e-3, 1.0),
        heights_mm: [-reached(&|press, k| -press.inputs[k][0]), reached(&|press, k| press.inputs[k][0])],
    }
}

/// Up to `most` pixels of a press, drawn at random: those near its contact and those of its halo. Those that are
/// saturated in the background, and those under dots, say nothing.
pub fn places(observation: &Observation, background: &RgbImage, most: usize, random: &mut Stream) -> Vec<usize> {
    let width = background.width() as usize;
    let [x, y] = observation.circle.centre_px;
    let (mut near, mut far) = (Vec::new(), Vec::new());
    for (at, color) in background.pixels().enumerate() {
        let (across, down) = ((at % width) as f64 - x, (at / width) as f64 - y);
        let distance = libm::hypot(across, down) / observation.circle.radius_px;
        let is_shown = color.0.iter().all(|level| *level < SATURATED) && !observation.is_inked(at);
        if distance < REACH && is_shown {
            if distance < DILATE { near.push(at) } else { far.push(at) }
        }
    }
    let wanted = |fraction: f64| (fraction * most as f64) as usize;
    let mut drawn = random.some_of(near, wanted(NEAR));
    drawn.extend(random.some_of(far, wanted(1.0 - NEAR)));
    drawn
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_range_is_what_two_presses_reached_and_neither_one_of_them_nor_a_few_pixels_decide() {
        let press = |steepest: f32, heights_mm: [f32; 2]| {
            let mut pixels = Pixels::default();
            for k in 0..1000 {
                let share = k as f32 / 999.0;
                pixels.normals.push([0.6 * steepest * share, -0.8 * steepest * share]);
                let mut inputs = [0.0; INPUTS];
                inputs[0] = heights_mm[0] + share * (heights_mm[1] - heights_mm[0]);
                pixels.inputs.push(inputs);
                pixels.change.push([0.0; 3]);
            }
            // By chance.
            (pixels.normals[0], pixels.inputs[0][0]) = ([0.0, 1.0], 9.0);
            pixels
        };
        let presses =
            [press(0.3, [-0.1, 0.2]), press(0.9, [-0.5, 2.0]), press(0.5, [-0.2, 0.6]), press(0.4, [0.0, 0.5])];
        let Range { steepest, heights_mm: [low, high] } = range(&presses.each_ref());
        assert!((steepest - 0.5).abs() < 0.01 && (high - 0.6).abs() < 0.01 && (low + 0.2).abs() < 0.01);
        let level = range(&[&press(0.0, [0.0; 2]), &press(0.0, [0.0; 2])]);
        assert_eq!(level, Range { steepest: 1e-3, heights_mm: [-0.0, 0.0] });
        assert_eq!(range(&[]), level);
    }
}
